"""LDC1614 at the level of its registers: what it answers over I²C at any moment.

Written from the data sheet's register table and text (Texas Instruments SNOSCY9A), not from any driver. What happens
between the registers, waking, settling and converting, is in `conversion`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coilarray.hardware.chips.ldc1614_registers import Register, registers
from coilarray.hardware.emulator.chip_setting import Setting
from coilarray.hardware.emulator.conversion import Result, Run, Surroundings
from coilarray.hardware.emulator.undocumented import Misuse
from coilarray.hardware.wire.buses import Clock

CHANNELS = 4
_MSB, _LSB = (0x00, 0x02, 0x04, 0x06), (0x01, 0x03, 0x05, 0x07)
_DIVIDERS, _DRIVE = 0x14, 0x1E
_STATUS, _ERROR_CONFIG, _CONFIG, _MUX, _RESET = 0x18, 0x19, 0x1A, 0x1B, 0x1C
_SLEEP, _INTB_DIS, _DRDY = 1 << 13, 1 << 7, 1 << 6
_INIT_DRIVE = 0x1F << 6
_RESET_BIT = 1 << 15
_START_UP = 2e-3  # s from the end of a shutdown until I²C answers


@dataclass(frozen=True)
class OpenPoints:
    """What the sources leave open or contradict each other in; a driver must be right either way.

    Parameters
    ----------
    status_clears_unread : bool
        Reading STATUS clears UNREADCONV too (an answer of the maker's forum); the data sheet lets only DATAx_MSB do so.
    status_gated : bool
        An error reaches STATUS only where its ERR2INT bit is set (data sheet), or always (application note SNOA959).
    flags_clear_on_read : bool
        Reading DATAx_MSB clears its four flags (data sheet); else only the next good conversion does (SNOA959).
    """

    status_clears_unread: bool = False
    status_gated: bool = True
    flags_clear_on_read: bool = True


class Ldc1614:
    """One converter.

    Parameters
    ----------
    clock : Clock
        Time of the board.
    surroundings : Surroundings
        Coils, clocks and temperature.
    channels : int
        4, or 2 for an LDC1612, which has the same identity.
    open_points : OpenPoints
        Which reading of the sources holds.
    misuse : Misuse
        Where undocumented use goes.
    seed : int
        Of the noise.
    """

    def __init__(
        self,
        clock: Clock,
        surroundings: Surroundings,
        *,
        channels: int = CHANNELS,
        open_points: OpenPoints | None = None,
        misuse: Misuse | None = None,
        seed: int = 0,
    ) -> None:
        self.clock = clock
        self.channels = channels
        self.open_points = open_points or OpenPoints()
        self.misuse = misuse or Misuse(strict=True)
        self.table = {
            register.address: register
            for register in registers().values()
            if channels == CHANNELS or not register.four_channels
        }
        self.surroundings = surroundings
        self.resets = 0
        self._excused = False
        self._random = np.random.default_rng(seed)
        self._run: Run | None = None
        self._shut_down = False
        self._answers_from = clock.now()
        self._reset()

    # ------------------------------------------------------------------ the bus

    @property
    def answers(self) -> bool:
        """Whether the chip acknowledges its address."""
        return not self._shut_down and self.clock.now() >= self._answers_from

    @property
    def interrupt(self) -> bool:
        """True while the pin INTB is pulled low."""
        self._look()
        ready = self._drdy and self._registers[_ERROR_CONFIG] & 1
        return bool(ready or self._interrupting) and not self._registers[_CONFIG] & _INTB_DIS

    @property
    def asleep(self) -> bool:
        """Whether the chip sleeps."""
        return bool(self._registers[_CONFIG] & _SLEEP)

    def read(self, address: int) -> int:
        """Return a register as the bus gives it, with everything that reading does."""
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
        """Write a register as the bus does."""
        self._look()
        register = self.table.get(address)
        if register is None or not register.writable:
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

    # --------------------------------------------------------------- what happens to it

    def advance(self) -> None:
        """Let the chip do what it does until now; to be called before anything around it changes."""
        if self._run is not None:
            self._run.advance(self.clock.now(), changing=True)

    def brown_out(self) -> None:
        """Let the supply drop for a moment: all registers are as after power-up, asleep."""
        self.excuse()
        self._reset()

    def excuse(self) -> None:
        """Blame no driver for what registers hold by accident, until CLOCK_DIVIDERS0 is written again."""
        self._excused = True

    def shut_down(self, pin: bool) -> None:
        """Drive the pin SD: high resets and switches off, low starts up again in 2 ms."""
        if pin:
            self.brown_out()
        elif self._shut_down:
            self._answers_from = self.clock.now() + _START_UP
        self._shut_down = pin

    def peek(self, address: int) -> int:
        """Return a configuration register without touching anything."""
        return self._registers[address]

    def poke(self, address: int, value: int) -> None:
        """Change a configuration register as no driver could: a bit that toppled."""
        self.excuse()
        self._registers[address] = value

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
        self._codes = [0] * CHANNELS
        self._flags = [0] * CHANNELS
        self._latched = [0] * CHANNELS
        self._fresh = [False] * CHANNELS  # MSB was read, LSB not yet
        self._unread = [False] * CHANNELS
        self._drdy = False
        self._interrupting = False  # by an error
        self._frozen: int | None = None  # what STATUS says until it is read

    def _configure(self, value: int) -> None:
        if value & _SLEEP:
            self._run = None
            self._forget_results()
        elif self._run is None:
            now, setting = self.clock.now(), Setting.of(self._registers, self.channels)
            around = self.surroundings
            for problem in setting.problems(
                (around.external_clock if setting.external else around.internal_clock)(now)
            ):
                self._note(problem)
            self._run = Run(self.surroundings, setting, now, self._take, self._note, self._random)

    def _check_write(self, register: Register, value: int) -> None:
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
        """Take over the end of a conversion."""
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
        asked = [bool(config & 1 << 7 - k) for k in range(len(happened))]
        interrupting = [one and gate for one, gate in zip(happened, asked, strict=True)]
        self._interrupting = self._interrupting or any(interrupting)
        shown_errors = interrupting if self.open_points.status_gated else happened
        if any(shown_errors) and self._frozen is None:
            errors = sum(1 << 13 - k for k, one in enumerate(shown_errors) if one)
            self._frozen = channel << 14 | errors | self._ready_bits()

    def _ready_bits(self) -> int:
        shown = self._registers[_ERROR_CONFIG] & 1 or not self.open_points.status_gated
        ready = _DRDY if self._drdy and shown else 0
        return ready | sum(1 << 3 - channel for channel in range(CHANNELS) if self._unread[channel])

    def _read_status(self) -> int:
        value = self._ready_bits() if self._frozen is None else self._frozen
        self._frozen, self._interrupting = None, False
        if value & _DRDY:  # one that a frozen register hides is still to be seen
            self._drdy = False
        if self.open_points.status_clears_unread:
            self._unread = [False] * CHANNELS
        return value

    def _read_msb(self, channel: int) -> int:
        if self.asleep:
            self._note(f"DATA{channel}_MSB was read while the chip slept, which clears it.")
        value = self._flags[channel] << 12 | self._codes[channel] >> 16
        self._latched[channel] = self._codes[channel] & 0xFFFF
        self._fresh[channel] = True
        self._unread[channel] = False
        if self.open_points.flags_clear_on_read:
            self._flags[channel] = 0
        if self._frozen is not None and self._frozen >> 14 == channel:
            self._frozen, self._interrupting = None, False
        return value

    def _read_lsb(self, channel: int) -> int:
        if not self._fresh[channel]:
            self._note(f"DATA{channel}_LSB was read without DATA{channel}_MSB before it.")
        self._fresh[channel] = False
        return self._latched[channel]
