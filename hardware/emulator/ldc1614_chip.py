"""Registers of an emulated LDC1614 and its I²C bus.

The module follows the data sheet's register table and text (Texas Instruments SNOSCY9A), not any
driver. `conversion` simulates waking, settling and converting.
"""

from __future__ import annotations

import numpy as np

from coilarray.hardware.chips.ldc1614 import BUS_RATE, CHANNELS, READ_BITS, SLOWEST_BUS_RATE, WRITE_BITS
from coilarray.hardware.chips.ldc1614_registers import Register, registers
from coilarray.hardware.emulator.conversion import Result, Run, Setting, Surroundings
from coilarray.hardware.wire.buses import BusFault, BusTimeout, Clock

_BUS_TIMEOUT = 25e-3  # s until a master gives up a bus that is held down
_MSB, _LSB = (0x00, 0x02, 0x04, 0x06), (0x01, 0x03, 0x05, 0x07)
_DIVIDERS, _DRIVE = 0x14, 0x1E
_STATUS, _ERROR_CONFIG, _CONFIG, _RESET = 0x18, 0x19, 0x1A, 0x1C
_SLEEP, _INTB_DIS, _DRDY = 1 << 13, 1 << 7, 1 << 6
_INIT_DRIVE = 0x1F << 6
_RESET_BIT = 1 << 15


class UndocumentedUse(Exception):  # noqa: N818 - a fault of the driver, which it may not catch
    """Use of a chip that its data sheet forbids."""


class Misuse:
    """Collection of undocumented uses."""

    _MOST = 1000  # notes to keep, so that a runaway driver does not fill the memory

    def __init__(self, strict: bool) -> None:
        self.strict = strict
        self.notes: list[str] = []

    def remark(self, what: str) -> None:
        """Note an event that may not be the driver's fault."""
        if len(self.notes) < self._MOST:
            self.notes.append(what)

    def note(self, what: str) -> None:
        """Note one undocumented use."""
        self.remark(what)
        if self.strict:
            raise UndocumentedUse(what)


class Ldc1614:
    """One converter."""

    def __init__(
        self, clock: Clock, surroundings: Surroundings, *, misuse: Misuse | None = None, seed: int = 0
    ) -> None:
        self.clock, self.surroundings = clock, surroundings
        self.misuse = misuse or Misuse(strict=True)
        self.table = {register.address: register for register in registers().values()}
        self.resets = 0
        self._excused = False
        self._random = np.random.default_rng(seed)
        self._run: Run | None = None
        self._reset()

    # ------------------------------------------------------------------ the bus

    @property
    def interrupt(self) -> bool:
        """Whether the pin INTB is pulled low."""
        self._look()
        ready = self._drdy and self._registers[_ERROR_CONFIG] & 1
        return bool(ready or self._interrupting) and not self._registers[_CONFIG] & _INTB_DIS

    @property
    def asleep(self) -> bool:
        """Whether the chip sleeps."""
        return bool(self._registers[_CONFIG] & _SLEEP)

    def read(self, address: int) -> int:
        """Return a register with all side effects of reading."""
        self._look()
        if address not in self.table:
            self._note(f"register {address:#04x} was read; it is not documented.")
            return 0
        if address in _MSB:
            return self._read_msb(_MSB.index(address))
        if address in _LSB:
            return self._read_lsb(_LSB.index(address))
        if address == _STATUS:
            return self._read_status()
        return self._registers[address]

    def write(self, address: int, value: int) -> None:
        """Write a register like the bus."""
        self._look()
        register = self.table.get(address)
        if register is None or not register.writable_mask:
            what = "is read-only" if register else "is not documented"
            self._note(f"{value:#06x} was written to register {address:#04x}, which {what}.")
            return
        if address == _DIVIDERS:
            self._excused = False
        self._check_write(register, value)
        if address == _RESET:
            if value & _RESET_BIT:
                self._reset()
            return
        kept = self._registers[address] & ~register.writable_mask
        self._registers[address] = kept | value & register.writable_mask
        if address == _CONFIG:
            self._configure(value)

    # ------------------------------------------------------- events at the chip

    def advance(self) -> None:
        """Simulate the chip up to now."""
        if self._run is not None:
            self._run.advance(self.clock.now(), changing=True)

    def excuse(self) -> None:
        """Ignore undocumented use until CLOCK_DIVIDERS0 is written again."""
        self._excused = True

    def peek(self, address: int) -> int:
        """Return a configuration register without side effects."""
        return self._registers[address]

    # -------------------------------------------------------------------- inside

    def _look(self) -> None:
        if self._run is not None:
            self._run.advance(self.clock.now(), changing=False)

    def _note(self, what: str) -> None:
        if not self._excused:
            self.misuse.note(what)

    def _reset(self) -> None:
        self.resets += 1
        self._registers = {address: register.reset for address, register in self.table.items()}
        self._run = None
        self._forget_results()

    def _forget_results(self) -> None:
        """Clear all results, flags and the status."""
        self._codes = [0] * CHANNELS
        self._flags = [0] * CHANNELS
        self._latched = [0] * CHANNELS
        self._fresh = [False] * CHANNELS  # MSB was read, LSB not yet
        self._unread = [False] * CHANNELS
        self._drdy = False
        self._interrupting = False  # by an error
        self._announced = False  # whether INTB had a reason to be asserted since waking
        self._frozen: int | None = None  # STATUS until it is read

    def _configure(self, value: int) -> None:
        """Put the chip to sleep or wake it."""
        if value & _SLEEP:
            self._run = None
            self._forget_results()
            for channel in range(CHANNELS):
                self._registers[_DRIVE + channel] &= ~_INIT_DRIVE
        elif self._run is None:
            now, setting = self.clock.now(), Setting.of(self._registers)
            around = self.surroundings
            source = around.external_clock if setting.external else around.internal_clock
            for problem in setting.problems(source(now)):
                self._note(problem)
            self._run = Run(around, setting, now, self._take, self._note, self._random)

    def _check_write(self, register: Register, value: int) -> None:
        """Note violations of the data sheet by a written value."""
        if not 0 <= value <= 0xFFFF:
            raise ValueError(f"value must be 0 to 0xFFFF; got {value:#x}.")
        wrong = (value ^ register.reset) & register.constant_mask
        if wrong:
            self._note(
                f"{register.name} was written with {value:#06x}: reserved bits {wrong:#06x} must be "
                f"{register.reset & wrong:#06x}."
            )
        if self.asleep or register.address == _RESET:
            return
        if register.address == _CONFIG:
            if not value & _SLEEP and value != self._registers[_CONFIG]:
                self._note(f"CONFIG was changed to {value:#06x} while the chip was active.")
        else:
            self._note(f"{register.name} was written while the chip was active.")

    def _take(self, result: Result) -> None:
        """Store the result of a conversion."""
        channel, config = result.channel, self._registers[_ERROR_CONFIG]
        raised = [result.under_range, result.over_range, result.watchdog, result.high, result.low]
        shown = [happened and bool(config & 1 << 15 - k) for k, happened in enumerate(raised)]
        self._codes[channel] = result.code
        self._flags[channel] = shown[0] << 3 | shown[1] << 2 | shown[2] << 1 | (shown[3] or shown[4])
        self._unread[channel] = True
        self._drdy = self._drdy or result.last
        if result.drive is not None:
            kept = self._registers[_DRIVE + channel] & ~_INIT_DRIVE
            self._registers[_DRIVE + channel] = kept | result.drive << 6
        happened = [*raised, result.no_edges]
        interrupting = [one and bool(config & 1 << 7 - k) for k, one in enumerate(happened)]
        self._interrupting = self._interrupting or any(interrupting)
        self._announced = self._announced or result.last or any(interrupting)
        if any(interrupting) and self._frozen is None:
            errors = sum(1 << 13 - k for k, one in enumerate(interrupting) if one)
            self._frozen = channel << 14 | errors | self._ready_bits()

    def _ready_bits(self) -> int:
        ready = _DRDY if self._drdy and self._registers[_ERROR_CONFIG] & 1 else 0
        return ready | sum(1 << 3 - channel for channel in range(CHANNELS) if self._unread[channel])

    def _read_status(self) -> int:
        """Return STATUS with all side effects of reading."""
        if not (self.asleep or self._announced):
            self._note("STATUS was read after waking before INTB was asserted.")
        value = self._ready_bits() if self._frozen is None else self._frozen
        self._frozen, self._interrupting = None, False
        if value & _DRDY:  # a DRDY that a frozen register hides is still to be seen
            self._drdy = False
        return value

    def _read_msb(self, channel: int) -> int:
        """Return DATAx_MSB with all side effects of reading."""
        if self.asleep:
            self._note(f"DATA{channel}_MSB was read while the chip slept, which clears it.")
        value = self._flags[channel] << 12 | self._codes[channel] >> 16
        self._latched[channel] = self._codes[channel] & 0xFFFF
        self._fresh[channel] = True
        self._unread[channel] = False
        self._flags[channel] = 0
        if self._frozen is not None and self._frozen >> 14 == channel:
            self._frozen, self._interrupting = None, False
        return value

    def _read_lsb(self, channel: int) -> int:
        """Return DATAx_LSB with all side effects of reading."""
        if self.asleep:
            self._note(f"DATA{channel}_LSB was read while the chip slept, which clears it.")
        elif not self._fresh[channel]:
            self._note(f"DATA{channel}_LSB was read without DATA{channel}_MSB before it.")
        self._fresh[channel] = False
        return self._latched[channel]


class EmulatedBus:
    """I²C bus to one converter."""

    def __init__(self, chip: Ldc1614, clock: Clock, *, speed: float = BUS_RATE) -> None:
        self.chip = chip
        self.clock = clock
        self.speed = speed
        self.log: list[tuple[str, int, int]] | None = None
        """Log of every transaction: "read" or "write", register, value. None for no log."""
        self._refused = 0
        self._flips: list[int] = []
        self._held = False

    def read(self, register: int) -> int:
        """Return a register."""
        self._pass(READ_BITS, register)
        value = self._damaged(self.chip.read(register))
        self._note("read", register, value)
        return value

    def write(self, register: int, value: int) -> None:
        """Write a register."""
        self._pass(WRITE_BITS, register)
        arriving = self._damaged(value)
        if arriving != value:
            self.chip.excuse()
        self.chip.write(register, arriving)
        self._note("write", register, value)

    def clear(self) -> None:
        """Send nine clocks and a stop to release the bus."""
        self.clock.sleep(10 / self.speed)
        self._held = False

    def close(self) -> None:
        """Release the bus."""

    def refuse(self, transactions: int = 1) -> None:
        """Make the chip ignore the next transactions."""
        self._refused = transactions

    def hold(self) -> None:
        """Hold the data line low until the bus is cleared."""
        self._held = True

    def flip(self, *bits: int) -> None:
        """Flip the given bits of the next values."""
        self._flips += bits

    def _pass(self, bits: int, register: int) -> None:
        """Spend the time of a transaction or raise its fault."""
        if not SLOWEST_BUS_RATE <= self.speed <= BUS_RATE:
            self.chip.misuse.note(f"the bus runs at {self.speed:.4g} Hz; 10 to 400 kHz are allowed.")
        if self._held:
            self.clock.sleep(_BUS_TIMEOUT)
            raise BusTimeout(f"the bus is held down; register {register:#04x} was not reached.")
        if self._refused:
            self._refused -= 1
            self.clock.sleep(10 / self.speed)
            raise BusFault(f"the converter did not acknowledge register {register:#04x}.")
        self.clock.sleep(bits / self.speed)

    def _damaged(self, value: int) -> int:
        return value ^ (1 << self._flips.pop(0)) if self._flips else value

    def _note(self, kind: str, register: int, value: int) -> None:
        if self.log is not None:
            self.log.append((kind, register, value))
