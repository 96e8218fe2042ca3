"""Small stand-ins for the two chips of a board, with every fault at hand; they know no physics."""

from __future__ import annotations

from collections.abc import Callable

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
