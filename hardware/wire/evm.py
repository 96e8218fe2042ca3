"""A converter on TI's evaluation module, by the protocol of the module's own firmware over its serial port at USB.

A command is 4C, its number, 01, two bytes of length, the payload and a CRC-8; every answer has 32 bytes: 4C, the number
of the command, 01, an error code, the length of the payload, the payload and, it seems, the CRC-8 of all that.

Sources: TI's inductive sensing FAQ (E2E thread 295036, questions 40 and 41) for commands 15 and 14; a block of a stream
in E2E thread 723630, whose CRC-8 is right; the public driver FDC2x14EVM of the INI Zurich for commands 13 and 12, which
read a register in one step. Some firmware answers FF 00 4C to the FAQ's commands (E2E threads 805053 and 1071531):
whether it takes the others is not known. Nothing of this was tried on a module.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass

from coilarray.hardware.chips.ldc1614_registers import register
from coilarray.hardware.wire.buses import Clock, ComputerClock
from coilarray.hardware.wire.faults import BusFault, BusTimeout, NoAnswer, NotABoard
from coilarray.hardware.wire.serial_ports import BytePort, choose_serial_port, open_serial_port

EVM_USB = (0x2047, 0x08F8)
"""USB vendor and product of the module; TI's examples for the MSP430 have them too."""
EVM_BUS_RATE = 15e3
"""Clock in Hz of a bus that would read a register in the time that the two steps of the module may take, about 3 ms."""
EVM_SOURCE = "clock and protocol: TI's forum and public drivers"
"""Where the module's values come from."""
REPLY_LENGTH = 32
"""Bytes of every answer, and of every block of a stream."""
_HEAD, _TAIL = 0x4C, 0x01
_REPLY_TIME = 0.25  # s
_QUIET = 0.05  # s without a byte after which nothing more comes
_LONGEST_DRAIN = 1.0  # s
_REFUSAL = b"\xff\x00\x4c"
_PAYLOAD = 5  # place of the payload in an answer
_SHOWN = 8  # bytes of an answer in a message


@dataclass(frozen=True)
class EvmCommands:
    """Title, and numbers of the commands, of a firmware; `select` is None where `read` names the register itself.

    `stop` ends a stream and has the payload `stop_payload`.
    """

    title: str
    write: int
    read: int
    select: int | None
    stop: int
    stop_payload: bytes

    @property
    def value_at(self) -> int:
        """Place of a register's value in the answer to `read`."""
        return _PAYLOAD + 1 + (self.select is None)


FAQ_COMMANDS = EvmCommands("TI's FAQ commands", write=0x15, read=0x14, select=0x15, stop=0x06, stop_payload=b"\x01")
"""Commands of TI's FAQ."""
ONE_STEP_COMMANDS = EvmCommands("one-step commands", write=0x13, read=0x12, select=None, stop=0x07, stop_payload=b"")
"""Commands of the driver FDC2x14EVM."""
_KNOWN = (FAQ_COMMANDS, ONE_STEP_COMMANDS)


def crc8(data: bytes) -> int:
    """Return the CRC-8 of polynomial 0x07, begun with 0.

    >>> f"{crc8(b'123456789'):02X}"
    'F4'
    """
    remainder = 0
    for byte in data:
        remainder ^= byte
        for _ in range(8):
            remainder = (remainder << 1 ^ (0x107 if remainder & 0x80 else 0)) & 0xFF
    return remainder


def frame(command: int, payload: bytes) -> bytes:
    """Return a command as it is sent.

    >>> frame(0x15, bytes.fromhex("2A 1B 82 0D")).hex(" ").upper()
    '4C 15 01 00 04 2A 1B 82 0D A3'
    """
    body = bytes([_HEAD, command, _TAIL]) + len(payload).to_bytes(2, "big") + payload
    return body + bytes([crc8(body)])


def open_evm(name: str, address: int) -> EvmRegisterBus:
    """Open the module at a serial port, as `choose_serial_port` names it, for a converter at an I²C address.

    HardwareError of that function and of `EvmRegisterBus`.
    """
    return EvmRegisterBus(open_serial_port(choose_serial_port(name).name), address)


class EvmRegisterBus:
    """A `RegisterBus` through the firmware of the evaluation module; opening it ends a stream that may be running.

    An answer is checked by its CRC-8 where the first answers had one. NoAnswer or NotABoard where no firmware of this
    protocol answers, DeviceLost where the port is gone; the port is then closed.
    """

    def __init__(self, port: BytePort, address: int, clock: Clock | None = None) -> None:
        self._port, self._address = port, address
        self._clock: Clock = clock or ComputerClock()
        self.sealed = False
        """Whether the answers have a CRC-8."""
        try:
            self.commands = self._known_commands()
        except BaseException:
            self.close()
            raise

    def read(self, register: int) -> int:
        """Return a register."""
        return self._value(self.commands, register)[0]

    def write(self, register: int, value: int) -> None:
        """Write a register."""
        self._exchange(self.commands.write, [register, *value.to_bytes(2, "big")], register)

    def clear(self) -> None:
        """Discard what the module still sends; it offers no way to free its bus."""
        self._drain()

    def close(self) -> None:
        """Close the port. Never raises."""
        with contextlib.suppress(Exception):
            self._port.close()

    def _known_commands(self) -> EvmCommands:
        """End a stream, and find out which commands the firmware takes and whether its answers are sealed."""
        identity = register("MANUFACTURER_ID").address
        heard, silent_converter, flood = b"", None, None
        for commands in _KNOWN:  # the second ones are sent only to firmware that does not take those of the maker
            try:
                self._port.write(frame(commands.stop, commands.stop_payload))
                self._drain()
                # three answers: by one of them that happens to fit or was damaged nothing is decided
                found = [self._value(commands, identity) for _ in range(3)]
            except NotABoard as error:
                flood = error
            except _Refused as refused:
                heard = heard or refused.heard
            except BusFault:  # its answer reports an error: of the converter, or it does not know the command
                silent_converter = silent_converter or commands
            else:
                self.sealed = sum(sealed for _, sealed in found) > 1
                return commands
        if silent_converter is not None:
            return silent_converter
        if flood is not None:
            raise flood
        if not heard:
            raise NoAnswer(
                f"no evaluation module answers at {self._port.name}: it is another device, or its firmware hangs."
            )
        if heard.startswith(_REFUSAL):
            raise NotABoard(
                f"the firmware of the evaluation module at {self._port.name} answers FF 00 4C and takes neither of the "
                "known sets of commands; load the firmware of TI's Sensing Solutions EVM GUI, or use I²C directly."
            )
        raise NotABoard(f"{self._port.name} sends {_shown(heard)}, which no evaluation module of this protocol does.")

    def _value(self, commands: EvmCommands, register: int) -> tuple[int, bool]:
        """Return a register, and whether all answers on the way were sealed."""
        sealed = True
        request = [register, 2]
        if commands.select is not None:
            sealed = _is_sealed(self._exchange(commands.select, [register], register))
            request = [2]
        answer = self._exchange(commands.read, request, register)
        at = commands.value_at
        return int.from_bytes(answer[at : at + 2], "big"), sealed and _is_sealed(answer)

    def _exchange(self, command: int, payload: list[int], register: int) -> bytes:
        """Send a command and return its answer, whose error code is 0."""
        self._port.read(0.0)  # nothing is due: what is there belongs to no command
        self._port.write(frame(command, bytes([self._address, *payload])))
        answer = self._answer()
        if len(answer) < REPLY_LENGTH or answer[:3] != bytes([_HEAD, command, _TAIL]):
            self._drain()
            raise _Refused(self._port.name, answer)
        if self.sealed and not _is_sealed(answer):
            self._drain()
            raise BusFault(f"the evaluation module at {self._port.name} sent an answer with a wrong checksum.")
        if error := answer[3]:
            raise BusFault(
                f"the evaluation module at {self._port.name} reports error {error:#04x} for register {register:#04x}."
            )
        return answer

    def _answer(self) -> bytes:
        end, answer = self._clock.now() + _REPLY_TIME, b""
        while len(answer) < REPLY_LENGTH and (left := end - self._clock.now()) > 0:
            answer += self._port.read(left)
        return answer

    def _drain(self) -> None:
        """Discard what comes until nothing does."""
        end = self._clock.now() + _LONGEST_DRAIN
        quiet = self._clock.now() + _QUIET
        while (now := self._clock.now()) < quiet:
            if now >= end:
                raise NotABoard(
                    f"{self._port.name} never stops sending: it is another device, or a module that streams."
                )
            if self._port.read(quiet - now):
                quiet = self._clock.now() + _QUIET


class _Refused(BusTimeout):
    """An invalid answer: too short, or to another command."""

    def __init__(self, name: str, heard: bytes) -> None:
        what = f"sent {_shown(heard)}, which is not an answer" if heard else f"did not answer in {_REPLY_TIME:g} s"
        super().__init__(f"the evaluation module at {name} {what}.")
        self.heard = heard


def _is_sealed(answer: bytes) -> bool:
    end = _PAYLOAD + answer[_PAYLOAD - 1]
    return end < REPLY_LENGTH and answer[end] == crc8(answer[:end])


def _shown(data: bytes) -> str:
    more = " …" if len(data) > _SHOWN else ""
    return f"{len(data)} bytes ({data[:_SHOWN].hex(' ').upper()}{more})"
