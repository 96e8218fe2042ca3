"""What an LDC1614 does between its registers: waking, settling, counting, and what can go wrong while it counts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from coilarray.hardware.emulator.chip_setting import DEGLITCH, Setting
from coilarray.hardware.emulator.tank import (
    AMPLITUDE_HIGH,
    AMPLITUDE_LOW,
    AMPLITUDE_STOPS,
    DRIVE_CURRENTS,
    Resonator,
)

FULL_RESOLUTION = 0xFFFF
"""RCOUNT at which the noise of a converter is given."""
WATCHDOG = 5.2e-3
"""Time in s without oscillation after which the chip gives up and starts the sensor again."""
_FULL_SCALE = 1 << 28
_WAKE_CYCLES = 16384
# from channel to channel; taken also for the slot before each conversion of a single one, whose length is not given
_SWITCH_TIME, _SWITCH_CYCLES = 692e-9, 5
_LEAST_SETTLE = 2  # what 0 and 1 count as
_DIVIDED_FROM = 8.75e6  # Hz of the sensor
# not in the data sheet, which says only that there is an effect: the clamps pull the frequency, and a small amplitude
# is noisier
_CLAMP_PULL = -1e-3
_HIGH_CURRENT = 4.0  # 1.56 mA become about 6 mA
_UNTOUCHED = 4  # conversions that are counted one by one before the chip's idle turns are left out


class Surroundings(Protocol):
    """What is connected to a converter."""

    def sensor(self, channel: int, time: float) -> Resonator | None:
        """Return the tank at a channel; None where nothing can oscillate."""

    def internal_clock(self, time: float) -> float:
        """Return the frequency of the chip's own oscillator in Hz."""

    def external_clock(self, time: float) -> float | None:
        """Return the frequency at the pin CLKIN in Hz; None where it is grounded."""

    @property
    def noise(self) -> float:
        """Relative standard deviation of a frequency at full resolution and good amplitude."""


@dataclass(frozen=True)
class Result:
    """The end of a conversion.

    Parameters
    ----------
    channel, code : int
        Which channel, and its 28 bits.
    last : bool
        Whether it ends a turn over all channels, so that data is ready.
    under_range, over_range, watchdog, high, low, no_edges : bool
        What went wrong: below and above what the code holds, no oscillation for too long, amplitude too high and too
        low, not one edge counted.
    drive : int or None
        IDRIVE code that the chip found by itself; None where it did not look.
    """

    channel: int
    code: int
    last: bool
    under_range: bool = False
    over_range: bool = False
    watchdog: bool = False
    high: bool = False
    low: bool = False
    no_edges: bool = False
    drive: int | None = None


class Run:
    """The chip from one waking to the next sleep.

    Parameters
    ----------
    surroundings : Surroundings
        What is connected.
    setting : Setting
        Registers at the time of waking.
    time : float
        Of waking in s.
    take : callable
        Given every result at its time.
    note : callable
        Given what of the setting does not suit the sensor.
    random : numpy.random.Generator
        For the noise.

    Notes
    -----
    Nothing runs while nobody looks: `advance` catches up. Of many conversions that nobody saw only the first and the
    last few are counted, as they overwrite each other.
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
        self._surroundings = surroundings
        self._setting = setting
        self._take, self._note = take, note
        self._random = random
        self._turn = 0  # in the sequence of channels
        self._done = 0  # conversions
        self._found: dict[int, int] = {}  # drives that the chip chose itself
        self._time = time + _WAKE_CYCLES / surroundings.internal_clock(time)
        self._activate()

    def advance(self, until: float, *, changing: bool) -> None:
        """Do everything that happens up to a time in s.

        Parameters
        ----------
        until : float
            In s.
        changing : bool
            Whether something around the chip is about to change: then a conversion is counted as far as it has come,
            else only where it has ended or the watchdog may bark.
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
        """Return the reference frequency of the channel in Hz; 0 where nothing can be counted."""
        source = self._surroundings.external_clock if self._setting.external else self._surroundings.internal_clock
        clock = source(self._time)
        if clock is None or self._channel >= len(self._setting.channels):
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
            self._time = self._end = math.inf  # nothing ever comes
        else:
            self._end = self._time + 16 * max(self._setting.channels[self._channel].settle, _LEAST_SETTLE) / reference

    def _watched(self, until: float) -> bool:
        """Whether the watchdog may bark by a time in s."""
        return not self._setting.scan and self._quiet_since is not None and self._quiet_since + WATCHDOG <= until

    def _begin_count(self) -> None:
        self._counting = True
        self._reference_now = self._reference()
        self._length = (16 * self._setting.channels[self._channel].rcount + 4) / self._reference_now
        self._end = self._time + self._length
        self._cycles = 0.0
        self._high = self._low = False
        self._least_amplitude = math.inf

    def _count(self, until: float) -> None:
        """Count to the end of the conversion, or as far as is known."""
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
        one = self._setting.channels[self._channel]
        last = self._turn == len(self._setting.sequence) - 1
        ratio = self._cycles / (self._length * one.fin_divider * self._reference_now)
        if self._cycles > 0:
            weaker = max(1.0, AMPLITUDE_LOW / max(self._least_amplitude, AMPLITUDE_STOPS))
            spread = self._surroundings.noise * math.sqrt(FULL_RESOLUTION / one.rcount) * weaker
            ratio *= 1 + spread * self._random.standard_normal()
        code = round((ratio - one.offset / 0x10000) * _FULL_SCALE)
        self._take(
            Result(
                self._channel,
                min(max(code, 0), _FULL_SCALE - 1),
                last,
                under_range=code <= 0,
                over_range=code >= _FULL_SCALE - 1,
                high=self._high,
                low=self._low,
                no_edges=self._cycles < 1,
                drive=self._automatic(sensor),
            )
        )
        self._done += 1
        self._turn = (self._turn + 1) % len(self._setting.sequence)
        self._time += _SWITCH_TIME + _SWITCH_CYCLES / self._reference_now
        if self._setting.scan:
            self._activate()
        else:
            self._begin_count()

    def _leave_out(self, until: float) -> None:
        """Skip conversions that nobody saw, all but the last few."""
        if self._setting.scan or self._done < _UNTOUCHED:
            return
        turn = self._length + _SWITCH_TIME + _SWITCH_CYCLES / self._reference_now
        unseen = math.floor((until - self._time) / turn) - _UNTOUCHED
        if unseen > 0:
            self._time += unseen * turn
            self._begin_count()

    # ------------------------------------------------------------------- the sensor

    def _judge_start(self, sensor: Resonator) -> None:
        """Look whether the sensor had the time to settle, and whether its frequency suits the input."""
        one = self._setting.channels[self._channel]
        needed = math.ceil(sensor.quality_factor * self._reference_now / (16 * sensor.frequency))
        if max(one.settle, _LEAST_SETTLE) < needed:
            self._low = True  # the amplitude is still growing
            self._note(f"SETTLECOUNT{self._channel} is {one.settle}; this sensor needs {needed}.")
        if sensor.frequency >= _DIVIDED_FROM and one.fin_divider < 2:
            self._note(f"FIN_DIVIDER{self._channel} must be at least 2 for a sensor of {sensor.frequency:.4g} Hz.")

    def _oscillation(self, sensor: Resonator | None) -> tuple[float, float]:
        """Frequency in Hz that reaches the counter and amplitude in V; both 0 where nothing oscillates."""
        if sensor is None:
            return 0.0, 0.0
        amplitude = sensor.amplitude(self._current(sensor))
        frequency = sensor.frequency if amplitude >= AMPLITUDE_STOPS else 0.0
        if frequency > DEGLITCH.get(self._setting.deglitch, math.inf):
            frequency = 0.0  # the input filter takes it
        elif amplitude > AMPLITUDE_HIGH:
            frequency *= 1 + _CLAMP_PULL * (min(amplitude, 2 * AMPLITUDE_HIGH) / AMPLITUDE_HIGH - 1)
        return frequency, amplitude

    def _current(self, sensor: Resonator) -> float:
        code = self._setting.channels[self._channel].drive
        if not self._setting.fixed_drive:
            code = self._found.setdefault(self._channel, sensor.automatic_drive())
        current = DRIVE_CURRENTS[code]
        return current * _HIGH_CURRENT if self._setting.high_current else current

    def _automatic(self, sensor: Resonator | None) -> int | None:
        """Drive that the chip has found; with the correction on it looks again after every conversion."""
        if self._setting.fixed_drive and self._setting.fixed_amplitude:
            return None
        if self._channel not in self._found or not self._setting.fixed_amplitude:
            self._found[self._channel] = len(DRIVE_CURRENTS) - 1 if sensor is None else sensor.automatic_drive()
        return self._found[self._channel]
