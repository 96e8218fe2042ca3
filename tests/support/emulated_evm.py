"""The firmware of TI's evaluation module in front of an emulated converter, as far as public sources describe it."""

from __future__ import annotations

from collections.abc import Callable

from coilarray.hardware.wire.buses import Clock, RegisterBus
from coilarray.hardware.wire.evm import FAQ_COMMANDS, REPLY_LENGTH, EvmCommands, crc8
from coilarray.hardware.wire.faults import BusFault, DeviceLost

_START = 0x05
_BLOCK = 0x30  # number of a block of a stream
_ANSWER_TIME = 1.5e-3  # s from a command to its answer, a guess
_BLOCK_TIME = 10e-3  # s from block to block of a stream, another
_NO_COMMAND, _NO_CHIP, _WRONG_CHECKSUM = 1, 2, 3  # error codes, invented: no source lists them
_BEFORE_PAYLOAD, _LONGEST = 5, 26


class EmulatedEvm:
    """The module as the port that it offers: a `coilarray.hardware.wire.serial_ports.BytePort`.

    Parameters
    ----------
    bus : RegisterBus
        Bus to the converter.
    clock : Clock
        Clock of the module.
    commands : EvmCommands, optional
        Commands that the firmware takes; by default those of TI's FAQ. To all others it answers FF 00 4C.
    sealed : bool
        Whether its answers end with a CRC-8.
    address : int
        I²C address of the converter.
    name : str
        Name of the port.
    to_computer : callable, optional
        Function that returns what becomes of an answer on its way; nothing happens to it by default.

    Notes
    -----
    `streaming` is whether it sends blocks of a stream, `unplugged` whether its port is gone.
    """

    def __init__(
        self,
        bus: RegisterBus,
        clock: Clock,
        *,
        commands: EvmCommands | None = FAQ_COMMANDS,
        sealed: bool = True,
        address: int = 0x2A,
        name: str = "emulated EVM",
        to_computer: Callable[[bytes], bytes] | None = None,
    ) -> None:
        self.name = name
        self.streaming = self.unplugged = False
        self._bus, self._clock, self._commands = bus, clock, commands
        self._sealed, self._address = sealed, address
        self._to_computer = to_computer or bytes
        self._selected = 0
        self._coming, self._going = b"", b""

    def read(self, seconds: float) -> bytes:
        """Return what it has sent, or wait."""
        self._check()
        if not self._going and seconds > 0:
            self._clock.sleep(min(seconds, _BLOCK_TIME) if self.streaming else seconds)
            if self.streaming:
                self._going += self._answer(_BLOCK, bytes(17))
        taken, self._going = self._going, b""
        return taken

    def write(self, data: bytes) -> None:
        """Take bytes of commands, and answer those that are whole."""
        self._check()
        self._coming += data
        while (command := self._next()) is not None:
            self._clock.sleep(_ANSWER_TIME)
            self._going += self._to_computer(self._obey(command))

    def close(self) -> None:
        """Close the port; the module keeps what it does."""

    def _check(self) -> None:
        if self.unplugged:
            raise DeviceLost(f"{self.name} is gone: no such device.")

    def _next(self) -> bytes | None:
        """Return the next command that has come."""
        while self._coming:
            end = _BEFORE_PAYLOAD + self._coming[4] + 1 if len(self._coming) > 4 else 0
            if self._coming[0] != 0x4C or end > _BEFORE_PAYLOAD + _LONGEST + 1:
                self._coming = self._coming[1:]
            elif not end or len(self._coming) < end:
                return None
            else:
                command, self._coming = self._coming[:end], self._coming[end:]
                return command
        return None

    def _obey(self, command: bytes) -> bytes:
        number, payload = command[1], command[_BEFORE_PAYLOAD:-1]
        known = self._commands
        if known is None or number not in {known.read, known.write, known.select, _START, known.stop}:
            return b"\xff\x00\x4c"
        if command[-1] != crc8(command[:-1]):
            return self._answer(number, b"", _WRONG_CHECKSUM)
        if number in (_START, known.stop):
            self.streaming = number == _START
            return self._answer(number, payload)
        address, *arguments = payload
        if address != self._address:
            return self._answer(number, b"", _NO_CHIP)
        try:
            return self._transfer(known, number, arguments)
        except BusFault:
            return self._answer(number, b"", _NO_CHIP)

    def _transfer(self, known: EvmCommands, number: int, arguments: list[int]) -> bytes:
        match arguments:
            case [register, high, low] if number == known.write:
                self._bus.write(register, high << 8 | low)
                return self._answer(number, bytes([self._address, *arguments]))
            case [register] if number == known.select:
                self._selected = register
                return self._answer(number, bytes([self._address, register]))
            case [2] if number == known.read and known.select is not None:
                value = self._bus.read(self._selected)
                return self._answer(number, bytes([self._address, *value.to_bytes(2, "big")]))
            case [register, 2] if number == known.read:
                value = self._bus.read(register)
                return self._answer(number, bytes([self._address, register, *value.to_bytes(2, "big")]))
        return self._answer(number, b"", _NO_COMMAND)

    def _answer(self, number: int, payload: bytes, error: int = 0) -> bytes:
        body = bytes([0x4C, number, 0x01, error, len(payload)]) + payload
        seal = bytes([crc8(body)]) if self._sealed else b""
        return (body + seal).ljust(REPLY_LENGTH - 1, b"\0") + (seal or b"\0")
