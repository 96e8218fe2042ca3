"""Registers of an emulated LDC1614 and its I²C bus.

The module follows the data sheet's register table and text (Texas Instruments SNOSCY9A), not any
driver. `Setting` decodes the registers, `Resonator` is the tank that the converter drives, and `Run`
counts its cycles.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from coilarray.circuit.converter_limits import (
    AMPLITUDE_HIGH,
    AMPLITUDE_LOW,
    DIVIDED_FROM,
    DRIVE_CURRENTS,
    SENSOR_FREQUENCY,
)
from coilarray.design.readout import LARGEST_RCOUNT, conversion_time
from coilarray.hardware.chips import ldc1614
from coilarray.hardware.wire.buses import BusFault, BusTimeout, Clock

if TYPE_CHECKING:
    from coilarray.hardware.emulator.board import EmulatedBoard

AMPLITUDE_STOPS = 0.6  # peak voltage in V below which the oscillation stops
_SEQUENCES = {0b00: 2, 0b01: 3, 0b10: 4, 0b11: 2}  # channels of RR_SEQUENCE
WATCHDOG = 5.2e-3  # time in s without oscillation after which the chip gives up and starts the sensor again
# Assumed size of an effect that the data sheet only mentions. Clamps pull the frequency, and a
# small amplitude is noisier.
_CLAMP_PULL = -1e-3
_HIGH_CURRENT = 4.0  # 1.56 mA become about 6 mA
_UNTOUCHED = 4  # conversions that are counted individually before unread ones are skipped


@dataclass(frozen=True)
class Resonator:
    """Coil and capacitor at resonance at the converter's oscillator."""

    frequency: float  # in Hz
    parallel_resistance: float  # in Ω, inf without losses
    quality_factor: float  # of the whole tank

    def amplitude(self, current: float) -> float:
        """Peak voltage 4 R_p I/π in V (eq. 12)."""
        return 4 * self.parallel_resistance * current / math.pi

    def automatic_drive(self) -> int:
        """Return the IDRIVE code that the chip chooses itself."""
        kept = [code for code, current in enumerate(DRIVE_CURRENTS) if self.amplitude(current) <= AMPLITUDE_HIGH]
        return max(kept, default=0)


@dataclass(frozen=True)
class ChannelSetting:
    """Decoded registers of one channel."""

    rcount: int
    offset: int
    settle: int
    fin_divider: int
    fref_divider: int
    drive: int


@dataclass(frozen=True)
class Setting:
    """Decoded registers of a chip when it was woken."""

    channels: tuple[ChannelSetting, ...]
    sequence: tuple[int, ...]
    external: bool
    fixed_drive: bool
    fixed_amplitude: bool
    high_current: bool
    deglitch: int

    @staticmethod
    def of(registers: Mapping[int, int]) -> Setting:
        """Decode the registers of a chip."""
        config, mux = registers[0x1A], registers[0x1B]
        scan = bool(mux >> 15)
        channels = []
        for k in range(ldc1614.CHANNELS):
            rcount, offset, settle, dividers, drive = (registers[first + k] for first in (0x08, 0x0C, 0x10, 0x14, 0x1E))
            channels.append(ChannelSetting(rcount, offset, settle, dividers >> 12, dividers & 0x3FF, drive >> 11))
        sequence = tuple(range(_SEQUENCES[mux >> 13 & 0b11])) if scan else (config >> 14,)
        return Setting(
            channels=tuple(channels),
            sequence=sequence,
            external=bool(config >> 9 & 1),
            fixed_drive=bool(config >> 12 & 1),
            fixed_amplitude=bool(config >> 10 & 1),
            high_current=bool(config >> 6 & 1),
            deglitch=mux & 0b111,
        )

    @property
    def scan(self) -> bool:
        """Whether several channels take turns."""
        return len(self.sequence) > 1

    def problems(self, clock: float) -> Iterator[str]:
        """Yield the violations of the data sheet."""
        if not clock:
            yield "the chip was woken with an external clock, but the pin CLKIN is grounded."
        elif self.external and not ldc1614.EXTERNAL_CLOCK_RANGE[0] <= clock <= ldc1614.EXTERNAL_CLOCK_RANGE[1]:
            yield f"the pin CLKIN has {clock:.4g} Hz; 2 to 40 MHz are allowed."
        if self.high_current and self.sequence != (0,):
            yield "HIGH_CURRENT_DRV was set although channel 0 is not the only one."
        if self.deglitch not in ldc1614.DEGLITCH:
            yield f"DEGLITCH is {self.deglitch:#05b}, which is reserved."
        for channel in self.sequence:
            one = self.channels[channel]
            if one.fin_divider == 0 or one.fref_divider == 0:
                yield f"CLOCK_DIVIDERS{channel} holds a divider 0, which is reserved."
                continue
            if one.rcount <= (8 if self.scan else 4):
                yield f"RCOUNT{channel} is {one.rcount}, which is reserved."
            if self.scan and one.settle <= 3:
                yield f"SETTLECOUNT{channel} is {one.settle}; with several channels it must be more than 3."
            reference = clock / one.fref_divider
            largest = ldc1614.largest_reference(external=self.external, channels=len(self.sequence))
            if reference > largest:
                yield f"the reference of channel {channel} is {reference:.4g} Hz; at most {largest:.4g} Hz are allowed."


@dataclass(frozen=True)
class Result:
    """Result of a conversion, with its errors."""

    channel: int
    code: int  # of 28 bits
    last: bool  # whether it completes the sequence of channels, so that data are ready
    under_range: bool = False
    over_range: bool = False
    watchdog: bool = False  # no oscillation for too long
    high: bool = False  # the amplitude
    low: bool = False
    no_edges: bool = False  # no edge was counted
    drive: int | None = None  # IDRIVE code, if the chip searched for it by itself


class Run:
    """The chip from waking until sleep, with fixed registers.

    `take` is called with every result at its time, and `note` with a text if the setting does not
    suit the sensor. Unread conversions overwrite each other. If there are many, only the first and
    the last few are counted.
    """

    def __init__(
        self,
        surroundings: EmulatedBoard,
        setting: Setting,
        time: float,
        take: Callable[[Result], None],
        note: Callable[[str], None],
        random: np.random.Generator,
    ) -> None:
        self._surroundings, self._setting, self._random = surroundings, setting, random
        self._take, self._note = take, note
        self._turn = 0  # position in the sequence of channels
        self._done = 0  # number of conversions
        self._found: dict[int, int] = {}  # drive codes that the chip chose itself, by channel
        self._time = time + ldc1614.WAKE_CYCLES / surroundings.clock_of(time, external=False)
        self._activate()

    def advance(self, until: float, *, changing: bool) -> None:
        """Simulate everything up to a time in s."""
        # A running conversion is counted up to now if something around the chip is `changing`, otherwise only if it
        # has ended or the watchdog may fire.
        while self._time < until:
            if not self._counting:
                self._time = self._end
                self._begin_count()
            elif changing or self._end <= until or self._watched(until):
                self._count(until)
            else:
                break

    @property
    def _channel(self) -> int:
        return self._setting.sequence[self._turn]

    @property
    def _one(self) -> ChannelSetting:
        return self._setting.channels[self._channel]

    def _reference(self) -> float:
        """Return the reference frequency of the channel in Hz."""
        clock, one = self._surroundings.clock_of(self._time, external=self._setting.external), self._one
        return clock / one.fref_divider if one.fref_divider and one.fin_divider else 0.0

    def _activate(self) -> None:
        self._just_started = True
        reference = self._reference()
        self._counting = False
        self._quiet_since: float | None = self._time
        if reference == 0:
            self._time = self._end = math.inf  # no result ever comes
        else:
            self._end = self._time + 16 * max(self._one.settle, ldc1614.LEAST_SETTLE_COUNT) / reference

    def _watched(self, until: float) -> bool:
        return not self._setting.scan and self._quiet_since is not None and self._quiet_since + WATCHDOG <= until

    def _begin_count(self) -> None:
        self._reference_now = self._reference()
        self._length = conversion_time(self._one.rcount, self._reference_now)
        self._end = self._time + self._length
        self._cycles = 0.0
        self._high = self._low = False
        self._least_amplitude = math.inf
        self._counting = True  # last: Ctrl-C at any line puts the chip to sleep

    def _count(self, until: float) -> None:
        stop = min(self._end, until)
        sensor = self._surroundings.sensor(self._channel, (self._time + stop) / 2)
        frequency, amplitude = self._oscillation(sensor)
        self._high |= amplitude > AMPLITUDE_HIGH
        self._low |= amplitude < AMPLITUDE_LOW
        self._least_amplitude = min(self._least_amplitude, amplitude)
        if self._just_started and sensor is not None:
            self._judge_start(sensor)
        self._just_started = False
        if amplitude >= AMPLITUDE_STOPS:
            self._quiet_since = None
        elif self._quiet_since is None:
            self._quiet_since = self._time
        if self._quiet_since is not None and self._watched(stop):
            self._time = max(self._quiet_since + WATCHDOG, self._time)
            self._take(Result(self._channel, 0, True, under_range=True, watchdog=True, low=True))
            self._time += WATCHDOG * max(math.floor((until - self._time) / WATCHDOG) - _UNTOUCHED, 0)
            self._activate()
            return
        self._cycles += frequency * (stop - self._time)
        self._time = stop
        if stop == self._end:
            self._finish(sensor)
            if self._setting.scan or self._done < _UNTOUCHED:
                return
            turn = self._length + ldc1614.SWITCH_TIME + ldc1614.SWITCH_CYCLES / self._reference_now
            unseen = math.floor((until - self._time) / turn) - _UNTOUCHED
            if unseen > 0:  # unread conversions are left out, except the last few
                self._done += unseen
                self._time += unseen * turn
                self._begin_count()

    def _finish(self, sensor: Resonator | None) -> None:
        one = self._one
        last = self._turn == len(self._setting.sequence) - 1
        ratio = self._cycles / (self._length * one.fin_divider * self._reference_now)
        if self._cycles > 0:
            weaker = max(1.0, AMPLITUDE_LOW / max(self._least_amplitude, AMPLITUDE_STOPS))
            spread = self._surroundings.noise * math.sqrt(LARGEST_RCOUNT / one.rcount) * weaker
            ratio *= 1 + spread * self._random.standard_normal()
        code = round((ratio - one.offset / 0x10000) * ldc1614.FULL_SCALE)
        self._take(
            Result(
                self._channel,
                min(max(code, 0), ldc1614.FULL_SCALE - 1),
                last,
                under_range=code <= 0,
                over_range=code >= ldc1614.FULL_SCALE - 1,
                high=self._high,
                low=self._low,
                no_edges=self._cycles < 1,
                drive=self._automatic(sensor),
            )
        )
        self._done += 1
        self._turn = (self._turn + 1) % len(self._setting.sequence)
        self._time += ldc1614.SWITCH_TIME + ldc1614.SWITCH_CYCLES / self._reference_now
        if self._setting.scan:
            self._activate()
        else:
            self._begin_count()

    def _judge_start(self, sensor: Resonator) -> None:
        """Check the settling time and frequency of the sensor."""
        one = self._one
        needed = math.ceil(sensor.quality_factor * self._reference_now / (16 * sensor.frequency))
        if max(one.settle, ldc1614.LEAST_SETTLE_COUNT) < needed:
            self._low = True  # the amplitude is still growing
            self._note(f"SETTLECOUNT{self._channel} is {one.settle}; this sensor needs {needed}.")
        if not SENSOR_FREQUENCY[0] <= sensor.frequency <= SENSOR_FREQUENCY[1]:
            self._note(
                f"the sensor of channel {self._channel} has {sensor.frequency:.4g} Hz; 1 kHz to 10 MHz are allowed."
            )
        share = sensor.frequency / one.fin_divider / self._reference_now
        if share >= 0.25:
            self._note(
                f"the input of channel {self._channel} is {share:.3g} of the reference; it must be below a quarter."
            )
        if one.offset / 0x10000 >= share:
            self._note(f"OFFSET{self._channel} is {one.offset}; it must be below the sensor's {share * 0x10000:.0f}.")
        if sensor.frequency >= DIVIDED_FROM and one.fin_divider < 2:
            self._note(f"FIN_DIVIDER{self._channel} must be at least 2 for a sensor of {sensor.frequency:.4g} Hz.")

    def _oscillation(self, sensor: Resonator | None) -> tuple[float, float]:
        """Return the frequency in Hz and the amplitude in V."""
        if sensor is None:
            return 0.0, 0.0
        code = self._one.drive
        if not self._setting.fixed_drive:
            code = self._found.setdefault(self._channel, sensor.automatic_drive())
        amplitude = sensor.amplitude(DRIVE_CURRENTS[code] * (_HIGH_CURRENT if self._setting.high_current else 1.0))
        frequency = sensor.frequency if amplitude >= AMPLITUDE_STOPS else 0.0
        if frequency > ldc1614.DEGLITCH.get(self._setting.deglitch, math.inf):
            frequency = 0.0  # suppressed by the input filter
        elif amplitude > AMPLITUDE_HIGH:
            frequency *= 1 + _CLAMP_PULL * (min(amplitude, 2 * AMPLITUDE_HIGH) / AMPLITUDE_HIGH - 1)
        return frequency, amplitude

    def _automatic(self, sensor: Resonator | None) -> int | None:
        """Return the drive that the chip chose."""
        if self._setting.fixed_drive and self._setting.fixed_amplitude:
            return None
        if self._channel not in self._found or not self._setting.fixed_amplitude:
            self._found[self._channel] = len(DRIVE_CURRENTS) - 1 if sensor is None else sensor.automatic_drive()
        return self._found[self._channel]


_BUS_TIMEOUT = 25e-3  # s until a master gives up a bus that is held down
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

    _frozen: int | None  # STATUS until it is read
    _announced: bool  # whether INTB had a reason to be asserted since waking

    def __init__(
        self, clock: Clock, surroundings: EmulatedBoard, *, misuse: Misuse | None = None, seed: int = 0
    ) -> None:
        self.clock, self.surroundings = clock, surroundings
        self.misuse = misuse or Misuse(strict=True)
        self.table = {register.address: register for register in ldc1614.registers().values()}
        self.resets = 0
        self.excused = False
        """Whether undocumented use is ignored until CLOCK_DIVIDERS0 is written again."""
        self._random = np.random.default_rng(seed)
        self._run: Run | None = None
        self._reset()

    @property
    def interrupt(self) -> bool:
        """Whether the pin INTB is pulled low."""
        self._look()
        ready = self._drdy and self.registers[_ERROR_CONFIG] & 1
        return bool(ready or self._interrupting) and not self.registers[_CONFIG] & _INTB_DIS

    @property
    def asleep(self) -> bool:
        """Whether the chip sleeps."""
        return bool(self.registers[_CONFIG] & _SLEEP)

    def read(self, address: int) -> int:
        """Return a register with all side effects of reading."""
        self._look()
        if address not in self.table:
            self._note(f"register {address:#04x} was read; it is not documented.")
            return 0
        if address < 2 * ldc1614.CHANNELS:
            return self._read_data(address >> 1, lsb=bool(address & 1))
        if address != _STATUS:
            return self.registers[address]
        if not (self.asleep or self._announced):
            self._note("STATUS was read after waking before INTB was asserted.")
        value = self._ready_bits() if self._frozen is None else self._frozen
        self._frozen, self._interrupting = None, False
        if value & _DRDY:  # a DRDY that a frozen register hides is still to be seen
            self._drdy = False
        return value

    def write(self, address: int, value: int) -> None:
        """Write a register like the bus."""
        self._look()
        register = self.table.get(address)
        if register is None or not register.writable_mask:
            what = "is read-only" if register else "is not documented"
            self._note(f"{value:#06x} was written to register {address:#04x}, which {what}.")
            return
        if address == _DIVIDERS:
            self.excused = False
        self._check_write(register, value)
        if address == _RESET:
            if value & _RESET_BIT:
                self._reset()
            return
        kept = self.registers[address] & ~register.writable_mask
        self.registers[address] = kept | value & register.writable_mask
        if address == _CONFIG and value & _SLEEP:
            self._run = None
            self._forget_results()
            for channel in range(ldc1614.CHANNELS):
                self.registers[_DRIVE + channel] &= ~_INIT_DRIVE
        elif address == _CONFIG and self._run is None:  # it wakes
            now, setting, around = self.clock.now(), Setting.of(self.registers), self.surroundings
            for problem in setting.problems(around.clock_of(now, external=setting.external)):
                self._note(problem)
            self._run = Run(around, setting, now, self._take, self._note, self._random)

    def advance(self) -> None:
        """Simulate the chip up to now."""
        if self._run is not None:
            self._run.advance(self.clock.now(), changing=True)

    def _look(self) -> None:
        if self._run is not None:
            self._run.advance(self.clock.now(), changing=False)

    def _note(self, what: str) -> None:
        if not self.excused:
            self.misuse.note(what)

    def _reset(self) -> None:
        self.resets += 1
        self.registers = {address: register.reset for address, register in self.table.items()}
        self._run = None
        self._forget_results()

    def _forget_results(self) -> None:
        self._codes = [0] * ldc1614.CHANNELS
        self._flags = [0] * ldc1614.CHANNELS
        self._latched = [0] * ldc1614.CHANNELS
        self._fresh = [False] * ldc1614.CHANNELS  # MSB was read, LSB not yet
        self._unread = [False] * ldc1614.CHANNELS
        self._drdy = False
        self._interrupting = False  # by an error
        self._announced = False
        self._frozen = None

    def _check_write(self, register: ldc1614.Register, value: int) -> None:
        if not 0 <= value <= 0xFFFF:
            raise ValueError(f"value must be 0 to 0xFFFF; got {value:#x}.")
        # reserved bits that must be written unchanged
        constant = sum(one.mask for one in register.fields if one.reserved and not one.meaning.startswith("RO"))
        wrong = (value ^ register.reset) & constant
        if wrong:
            self._note(
                f"{register.name} was written with {value:#06x}: reserved bits {wrong:#06x} must be "
                f"{register.reset & wrong:#06x}."
            )
        if self.asleep or register.address == _RESET:
            return
        if register.address == _CONFIG:
            if not value & _SLEEP and value != self.registers[_CONFIG]:
                self._note(f"CONFIG was changed to {value:#06x} while the chip was active.")
        else:
            self._note(f"{register.name} was written while the chip was active.")

    def _take(self, result: Result) -> None:
        channel, config = result.channel, self.registers[_ERROR_CONFIG]
        raised = [result.under_range, result.over_range, result.watchdog, result.high, result.low]
        shown = [happened and bool(config & 1 << 15 - k) for k, happened in enumerate(raised)]
        self._codes[channel] = result.code
        self._flags[channel] = shown[0] << 3 | shown[1] << 2 | shown[2] << 1 | (shown[3] or shown[4])
        self._unread[channel] = True
        self._drdy = self._drdy or result.last
        if result.drive is not None:
            kept = self.registers[_DRIVE + channel] & ~_INIT_DRIVE
            self.registers[_DRIVE + channel] = kept | result.drive << 6
        happened = [*raised, result.no_edges]
        interrupting = [one and bool(config & 1 << 7 - k) for k, one in enumerate(happened)]
        self._interrupting = self._interrupting or any(interrupting)
        self._announced = self._announced or result.last or any(interrupting)
        if any(interrupting) and self._frozen is None:
            errors = sum(1 << 13 - k for k, one in enumerate(interrupting) if one)
            self._frozen = channel << 14 | errors | self._ready_bits()

    def _ready_bits(self) -> int:
        ready = _DRDY if self._drdy and self.registers[_ERROR_CONFIG] & 1 else 0
        return ready | sum(1 << 3 - channel for channel in range(ldc1614.CHANNELS) if self._unread[channel])

    def _read_data(self, channel: int, *, lsb: bool) -> int:
        """Return a data register of a channel with all side effects of reading."""
        name = f"DATA{channel}_LSB" if lsb else f"DATA{channel}_MSB"
        if self.asleep:
            self._note(f"{name} was read while the chip slept, which clears it.")
        if lsb:
            if not (self.asleep or self._fresh[channel]):
                self._note(f"{name} was read without DATA{channel}_MSB before it.")
            self._fresh[channel] = False
            return self._latched[channel]
        value = self._flags[channel] << 12 | self._codes[channel] >> 16
        self._latched[channel] = self._codes[channel] & 0xFFFF
        self._fresh[channel], self._unread[channel], self._flags[channel] = True, False, 0
        if self._frozen is not None and self._frozen >> 14 == channel:
            self._frozen, self._interrupting = None, False
        return value


class EmulatedBus:
    """I²C bus to one converter."""

    def __init__(self, chip: Ldc1614, clock: Clock, *, speed: float = ldc1614.BUS_RATE) -> None:
        self.chip = chip
        self.clock = clock
        self.speed = speed
        self._refused = 0
        self._flips: list[int] = []
        self._held = False

    def read(self, register: int) -> int:
        """Return a register."""
        self._pass(ldc1614.READ_BITS, register)
        return self._damaged(self.chip.read(register))

    def write(self, register: int, value: int) -> None:
        """Write a register."""
        self._pass(ldc1614.WRITE_BITS, register)
        arriving = self._damaged(value)
        if arriving != value:
            self.chip.excused = True
        self.chip.write(register, arriving)

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
        if not ldc1614.SLOWEST_BUS_RATE <= self.speed <= ldc1614.BUS_RATE:
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
