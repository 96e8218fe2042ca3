"""Small stand-ins for the two chips of a board, with every fault at hand; they know no physics."""

from __future__ import annotations

from collections.abc import Callable

from coilarray.hardware.wire.buses import BusFault

RESETS = {
    0x08: 0x0080, 0x0C: 0, 0x10: 0, 0x14: 0, 0x18: 0, 0x19: 0, 0x1A: 0x2801, 0x1B: 0x020F, 0x1C: 0, 0x1E: 0,
    0x7E: 0x5449, 0x7F: 0x3055,
}  # fmt: skip
TRANSFER = 120e-6  # s, 48 bits at 400 kHz


class StubConverter:
    """A `RegisterBus` to registers that remember; a conversion takes `conversion` seconds and gives `code()`."""

    def __init__(self, clock, code: Callable[[], int] = lambda: 0x1798_2F3, conversion: float = 1e-3) -> None:
        self.clock, self.code, self.conversion = clock, code, conversion
        self.registers = dict(RESETS)
        self.fault: Callable[[str, int], None] = lambda verb, register: None  # raises what a transfer should raise
        self.extra_status, self.converts = 0, True  # error bits that the next conversions bring
        self.cleared, self.log = 0, []
        self._ready, self._lsb = None, 0

    @property
    def asleep(self) -> bool:
        return bool(self.registers[0x1A] & 0x2000)

    def reset(self) -> None:
        """As by a dip of the supply."""
        self.registers = dict(RESETS)
        self._ready = None

    def read(self, register: int) -> int:
        self.clock.sleep(TRANSFER)
        self.fault("read", register)
        value = self._value(register)
        self.log.append(("read", register, value))
        return value

    def _value(self, register: int) -> int:
        if register == 0x18:
            ready = self.converts and self._ready is not None and self.clock.now() >= self._ready
            return (0x48 | self.extra_status) if ready else 0
        if register == 0x00:
            self._lsb = self.code() & 0xFFFF
            return self.code() >> 16
        return self._lsb if register == 0x01 else self.registers.get(register, 0)

    def write(self, register: int, value: int) -> None:
        self.clock.sleep(TRANSFER)
        self.fault("write", register)
        self.log.append(("write", register, value))
        if register == 0x1C:
            self.reset()
            return
        self.registers[register] = value
        if register == 0x1A:
            self._ready = None if self.asleep else self.clock.now() + self.conversion

    def clear(self) -> None:
        self.cleared += 1


class StubChain:
    """A `SwitchChain` that remembers all it was sent."""

    def __init__(self, clock, converter: StubConverter, devices: int = 6, *, wired_back: bool = False) -> None:
        self.clock, self.converter, self.wired_back = clock, converter, wired_back
        self.words = bytes(devices)
        self.history: list[tuple[bytes, bool]] = []  # with whether the converter slept
        self.corrupt: Callable[[bytes], bytes] = lambda words: words  # what comes back

    def shift(self, words: bytes) -> bytes | None:
        self.clock.sleep(50e-6)
        before, self.words = self.words, bytes(words)
        self.history.append((self.words, self.converter.asleep))
        return self.corrupt(before) if self.wired_back else None


class I2cSlave:
    """A slave with 16-bit registers on two open-drain wires; notes everything that the converter does not allow.

    `transfers` has one entry for each start: the address byte, then the bytes that the master sent.
    """

    def __init__(self, bus, address: int = 0x2A) -> None:
        self.bus, self.address = bus, address
        self.master = {"scl": True, "sda": True}  # what the master lets the wires do
        self.holds_sda = False  # the slave pulls it down
        self.stuck_scl = False
        self.clocks = 0
        self.misuse: list[str] = []
        self.transfers: list[list[int]] = []
        self.stops = 0
        self._idle()

    def _idle(self) -> None:
        self.receiving, self.bits, self.count, self.bytes = False, 0, 0, []
        self.sending: list[int] = []
        self.acknowledging = False
        self.done = True  # nothing more is expected of the master

    @property
    def scl(self) -> bool:
        return self.master["scl"] and not self.stuck_scl

    @property
    def sda(self) -> bool:
        return self.master["sda"] and not self.holds_sda

    def drive(self, wire: str, level: bool) -> None:
        """The master pulls a wire down or lets it go."""
        scl, sda = self.scl, self.sda
        self.master[wire] = level
        if scl and self.scl and sda != self.sda:
            self._start() if sda else self._stop()
        elif not scl and self.scl:
            self.clocks += 1
            self._rise()
        elif scl and not self.scl:
            self._fall()

    def line(self, scl: int, sda: int) -> int:
        """The master drives both wires at once; return the level of SDA."""
        levels = {"sda": bool(sda), "scl": bool(scl)}
        for wire in ("sda", "scl") if scl else ("scl", "sda"):  # a change of SDA at an edge is no start or stop
            self.drive(wire, levels[wire])
        return int(self.sda)

    def _start(self) -> None:
        if not self.done and not (len(self.bytes) == 2 and self.count <= 1):  # a repeated one after the pointer
            self.misuse.append("start within a transfer")
        self.pointer = self.bytes[1] if len(self.bytes) == 2 else None
        self._idle()
        self.transfers.append([])
        self.receiving, self.done = True, False

    def _stop(self) -> None:
        self.stops += 1
        if not self.done and len(self.bytes) not in (0, 4):
            self.misuse.append("early stop")
        self.holds_sda = False
        self._idle()

    def _rise(self) -> None:
        if self.receiving and not self.acknowledging:
            self.bits = self.bits << 1 | self.sda
            self.count += 1
        elif self.sending and self.count == 8:  # the master's acknowledgement
            self.sending.pop(0)
            if self.sda != (not self.sending):
                self.misuse.append("wrong acknowledgement")
            if self.sda:  # the master has enough
                self.sending.clear()
            self.count, self.done = -1, not self.sending

    def _fall(self) -> None:
        if self.acknowledging:
            self.acknowledging = self.holds_sda = False
            self._send()
        elif self.receiving and self.count == 8:
            self._take(self.bits)
        elif self.sending:
            self.count += 1
            self._send()
        elif not self.receiving:
            self.holds_sda = False

    def _send(self) -> None:
        """Put the next bit on the wire, or let it go for the acknowledgement."""
        if self.sending:
            self.holds_sda = self.count < 8 and not self.sending[0] >> (7 - self.count) & 1

    def _take(self, byte: int) -> None:
        self.bytes.append(byte)
        self.transfers[-1].append(byte)
        self.bits = self.count = 0
        if len(self.bytes) == 1 and byte >> 1 != self.address:
            self.receiving, self.done = False, True
            return
        try:
            if len(self.bytes) == 1 and byte & 1:
                value = self.bus.read(self.pointer)
                self.sending, self.receiving = [value >> 8, value & 0xFF], False
            if len(self.bytes) == 4:
                self.bus.write(self.bytes[1], self.bytes[2] << 8 | self.bytes[3])
                self.done = True
        except BusFault:
            self.receiving, self.done, self.sending = False, True, []
            return
        self.acknowledging = self.holds_sda = True


class ShiftRegisters:
    """A chain that takes data as the clock falls, gives it as the clock rises, and latches as SYNC rises."""

    def __init__(self, chain, devices: int) -> None:
        self.chain, self.devices = chain, devices
        self.level = {"din": False, "sclk": False, "sync": True}
        self.register = [0] * (8 * devices)  # [0] is nearest to the master
        self.dout = False
        self.clocks = 0
        self.frames: list[int] = []  # clocks of each
        self.moved = 0

    def drive(self, wire: str, level: bool) -> None:
        before, self.level[wire] = self.level[wire], level
        if wire == "sync" and before != level:
            self._frame(level)
        elif wire == "sclk" and before != level and not self.level["sync"]:
            if level:
                self.dout = bool(self.register[-1])
            else:
                self.register = [int(self.level["din"]), *self.register[:-1]]
                self.clocks += 1

    def _frame(self, ended: bool) -> None:
        if not ended:
            self.clocks = 0
            return
        self.frames.append(self.clocks)
        bits = self.register[::-1]
        words = [int("".join(map(str, bits[start : start + 8])), 2) for start in range(0, len(bits), 8)]
        self.chain.shift(bytes(words))
