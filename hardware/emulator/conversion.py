"""Waking, settling and counting of an emulated LDC1614.

`Setting` decodes the registers, `Resonator` is the tank that the converter drives, and `Run` counts
its cycles.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from coilarray.circuit.converter_limits import (
    AMPLITUDE_HIGH,
    AMPLITUDE_LOW,
    DIVIDED_FROM,
    DRIVE_CURRENTS,
    SENSOR_FREQUENCY,
)
from coilarray.design.readout import LARGEST_RCOUNT, conversion_time
from coilarray.hardware.chips.ldc1614 import (
    CHANNELS,
    DEGLITCH,
    EXTERNAL_CLOCK_RANGE,
    FULL_SCALE,
    LEAST_SETTLE_COUNT,
    SWITCH_CYCLES,
    SWITCH_TIME,
    WAKE_CYCLES,
    largest_reference,
)

AMPLITUDE_STOPS = 0.6
"""Peak voltage in V below which the oscillation stops."""
_SEQUENCES = {0b00: 2, 0b01: 3, 0b10: 4, 0b11: 2}  # channels of RR_SEQUENCE
WATCHDOG = 5.2e-3
"""Time in s without oscillation after which the chip gives up and starts the sensor again."""
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


class Surroundings(Protocol):
    """Everything connected to a converter."""

    def sensor(self, channel: int, time: float) -> Resonator | None:
        """Return the tank at a channel."""

    def internal_clock(self, time: float) -> float:
        """Return the frequency of the chip's oscillator in Hz."""

    def external_clock(self, time: float) -> float | None:
        """Return the frequency at the pin CLKIN in Hz."""

    @property
    def noise(self) -> float:
        """Relative standard deviation of a frequency."""


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
        sequence = tuple(range(_SEQUENCES[mux >> 13 & 0b11])) if scan else (config >> 14,)
        return Setting(
            channels=tuple(
                ChannelSetting(
                    registers[0x08 + k],
                    registers[0x0C + k],
                    registers[0x10 + k],
                    registers[0x14 + k] >> 12,
                    registers[0x14 + k] & 0x3FF,
                    registers[0x1E + k] >> 11,
                )
                for k in range(CHANNELS)
            ),
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

    def problems(self, clock: float | None) -> Iterator[str]:
        """Yield the violations of the data sheet."""
        if clock is None:
            yield "the chip was woken with an external clock, but the pin CLKIN is grounded."
        elif self.external and not EXTERNAL_CLOCK_RANGE[0] <= clock <= EXTERNAL_CLOCK_RANGE[1]:
            yield f"the pin CLKIN has {clock:.4g} Hz; 2 to 40 MHz are allowed."
        if self.high_current and self.sequence != (0,):
            yield "HIGH_CURRENT_DRV was set although channel 0 is not the only one."
        if self.deglitch not in DEGLITCH:
            yield f"DEGLITCH is {self.deglitch:#05b}, which is reserved."
        for channel in self.sequence:
            yield from self._channel_problems(channel, clock)

    def _channel_problems(self, channel: int, clock: float | None) -> Iterator[str]:
        """Yield the violations of the data sheet in one channel."""
        one = self.channels[channel]
        if one.fin_divider == 0 or one.fref_divider == 0:
            yield f"CLOCK_DIVIDERS{channel} holds a divider 0, which is reserved."
            return
        if one.rcount <= (8 if self.scan else 4):
            yield f"RCOUNT{channel} is {one.rcount}, which is reserved."
        if self.scan and one.settle <= 3:
            yield f"SETTLECOUNT{channel} is {one.settle}; with several channels it must be more than 3."
        if clock is None:
            return
        reference = clock / one.fref_divider
        largest = largest_reference(external=self.external, channels=len(self.sequence))
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
        surroundings: Surroundings,
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
        self._time = time + WAKE_CYCLES / surroundings.internal_clock(time)
        self._activate()

    def advance(self, until: float, *, changing: bool) -> None:
        """Simulate everything up to a time in s.

        If something around the chip is `changing`, a running conversion is counted up to now.
        Otherwise it is counted only if it has ended or the watchdog may fire.
        """
        while self._time < until:
            if not self._counting:
                self._time = self._end
                self._begin_count()
            elif changing or self._end <= until or self._watched(until):
                self._count(until)
            else:
                break

    # ------------------------------------------------------------------- phases

    @property
    def _channel(self) -> int:
        return self._setting.sequence[self._turn]

    def _reference(self) -> float:
        """Return the reference frequency of the channel in Hz."""
        source = self._surroundings.external_clock if self._setting.external else self._surroundings.internal_clock
        clock = source(self._time)
        if clock is None:
            return 0.0
        one = self._setting.channels[self._channel]
        return clock / one.fref_divider if one.fref_divider and one.fin_divider else 0.0

    def _activate(self) -> None:
        """Start the sensor and let it settle."""
        self._just_started = True
        reference = self._reference()
        self._counting = False
        self._quiet_since: float | None = self._time
        if reference == 0:
            self._time = self._end = math.inf  # no result ever comes
        else:
            self._end = (
                self._time + 16 * max(self._setting.channels[self._channel].settle, LEAST_SETTLE_COUNT) / reference
            )

    def _watched(self, until: float) -> bool:
        """Check whether the watchdog may fire by a time."""
        return not self._setting.scan and self._quiet_since is not None and self._quiet_since + WATCHDOG <= until

    def _begin_count(self) -> None:
        """Start a conversion of the channel."""
        self._reference_now = self._reference()
        self._length = conversion_time(self._setting.channels[self._channel].rcount, self._reference_now)
        self._end = self._time + self._length
        self._cycles = 0.0
        self._high = self._low = False
        self._least_amplitude = math.inf
        self._counting = True  # last: Ctrl-C at any line puts the chip to sleep

    def _count(self, until: float) -> None:
        """Count to the end of the conversion."""
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
            self._leave_out(until)

    def _finish(self, sensor: Resonator | None) -> None:
        """End a conversion and start the next."""
        one = self._setting.channels[self._channel]
        last = self._turn == len(self._setting.sequence) - 1
        ratio = self._cycles / (self._length * one.fin_divider * self._reference_now)
        if self._cycles > 0:
            weaker = max(1.0, AMPLITUDE_LOW / max(self._least_amplitude, AMPLITUDE_STOPS))
            spread = self._surroundings.noise * math.sqrt(LARGEST_RCOUNT / one.rcount) * weaker
            ratio *= 1 + spread * self._random.standard_normal()
        code = round((ratio - one.offset / 0x10000) * FULL_SCALE)
        self._take(
            Result(
                self._channel,
                min(max(code, 0), FULL_SCALE - 1),
                last,
                under_range=code <= 0,
                over_range=code >= FULL_SCALE - 1,
                high=self._high,
                low=self._low,
                no_edges=self._cycles < 1,
                drive=self._automatic(sensor),
            )
        )
        self._done += 1
        self._turn = (self._turn + 1) % len(self._setting.sequence)
        self._time += SWITCH_TIME + SWITCH_CYCLES / self._reference_now
        if self._setting.scan:
            self._activate()
        else:
            self._begin_count()

    def _leave_out(self, until: float) -> None:
        """Skip all unread conversions except the last few."""
        if self._setting.scan or self._done < _UNTOUCHED:
            return
        turn = self._length + SWITCH_TIME + SWITCH_CYCLES / self._reference_now
        unseen = math.floor((until - self._time) / turn) - _UNTOUCHED
        if unseen > 0:
            self._done += unseen
            self._time += unseen * turn
            self._begin_count()

    # ------------------------------------------------------------------- the sensor

    def _judge_start(self, sensor: Resonator) -> None:
        """Check the settling time and frequency of the sensor."""
        one = self._setting.channels[self._channel]
        needed = math.ceil(sensor.quality_factor * self._reference_now / (16 * sensor.frequency))
        if max(one.settle, LEAST_SETTLE_COUNT) < needed:
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
        code = self._setting.channels[self._channel].drive
        if not self._setting.fixed_drive:
            code = self._found.setdefault(self._channel, sensor.automatic_drive())
        amplitude = sensor.amplitude(DRIVE_CURRENTS[code] * (_HIGH_CURRENT if self._setting.high_current else 1.0))
        frequency = sensor.frequency if amplitude >= AMPLITUDE_STOPS else 0.0
        if frequency > DEGLITCH.get(self._setting.deglitch, math.inf):
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
