"""The bus between a driver and the emulated converter, and what can go wrong on it."""

from __future__ import annotations

from coilarray.hardware.emulator.ldc1614_chip import Ldc1614
from coilarray.hardware.wire.buses import Clock
from coilarray.hardware.wire.faults import BusFault, BusTimeout

ADDRESS = 0x2A
"""With the pin ADDR low."""
_READ_BITS, _WRITE_BITS = 48, 38  # on the wire, start and stop included
_TIMEOUT = 25e-3  # s until a master gives up a bus that is held down


class EmulatedBus:
    """I²C to one converter: a `coilarray.hardware.wire.buses.RegisterBus`.

    Parameters
    ----------
    chip : Ldc1614
        What answers.
    clock : Clock
        Time of the board; every transaction takes its time on the wire.
    speed : float
        In Hz.
    """

    def __init__(self, chip: Ldc1614, clock: Clock, *, speed: float = 400e3) -> None:
        self.chip = chip
        self.clock = clock
        self.speed = speed
        self.transactions = 0
        self.log: list[tuple[str, int, int]] | None = None
        """Where it is a list, every transaction is noted in it: "read" or "write", register, value."""
        self._refused = 0
        self._flips: list[int] = []
        self._held = False

    def read(self, register: int) -> int:
        """Return a register; BusFault where the chip does not answer."""
        self._pass(_READ_BITS, register)
        value = self._damaged(self.chip.read(register))
        self._note("read", register, value)
        return value

    def write(self, register: int, value: int) -> None:
        """Write a register; BusFault where the chip does not answer."""
        self._pass(_WRITE_BITS, register)
        arriving = self._damaged(value)
        if arriving != value:
            self.chip.excuse()
        self.chip.write(register, arriving)
        self._note("write", register, value)

    def clear(self) -> None:
        """Nine clocks and a stop: the chip lets go of the bus."""
        self.clock.sleep(10 / self.speed)
        self._held = False

    def close(self) -> None:
        """Let go of the bus."""

    def refuse(self, transactions: int = 1) -> None:
        """Let the chip not acknowledge the next transactions."""
        self._refused = transactions

    def hold(self) -> None:
        """Hold the data line down, as a chip does whose transfer was cut off, until the bus is cleared."""
        self._held = True

    def flip(self, *bits: int) -> None:
        """Damage the next transactions, one bit of the value in each, in turn. No checksum would tell."""
        self._flips += bits

    def _pass(self, bits: int, register: int) -> None:
        self.transactions += 1
        if self._held:
            self.clock.sleep(_TIMEOUT)
            raise BusTimeout(f"the bus is held down; register {register:#04x} was not reached.")
        if self._refused or not self.chip.answers:
            self._refused = max(self._refused - 1, 0)
            self.clock.sleep(10 / self.speed)
            raise BusFault(f"the converter did not acknowledge register {register:#04x}.")
        self.clock.sleep(bits / self.speed)

    def _damaged(self, value: int) -> int:
        return value ^ (1 << self._flips.pop(0)) if self._flips else value

    def _note(self, kind: str, register: int, value: int) -> None:
        if self.log is not None:
            self.log.append((kind, register, value))
