"""Surroundings of an emulated board: time, temperature, noise and indenter."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from coilarray.design.readout import INTERNAL_CLOCK, INTERNAL_CLOCK_PER_KELVIN
from coilarray.errors import HardwareError

ROOM_TEMPERATURE = 25.0
"""Temperature in °C at which the frequency of a converter's clock is given."""

_AHEAD, _BEHIND = 1e-3, 0.05  # s


class VirtualClock:
    """Clock whose time passes only in `sleep`."""

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        """Return the time in s."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        if not math.isfinite(seconds):
            raise HardwareError(f"a wait must be finite; got {seconds} s.")
        self._now += max(seconds, 0.0)


class PacedClock:
    """Clock of an emulated board in real time.

    A computer takes up to twice as long for a wait as short as 0.1 ms, a transfer. Therefore the
    waits are added up, and the computer sleeps only if they are ahead of its own clock. If it falls
    behind by more than `_BEHIND`, time goes on without the board. So a computer that is too slow
    has fewer scans and not slower seconds.
    """

    def __init__(self) -> None:
        self._time = time.monotonic()

    def now(self) -> float:
        """Return the time in s."""
        self._time = max(self._time, time.monotonic() - _BEHIND)
        return self._time

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        self._time = self.now() + max(seconds, 0.0)
        if (ahead := self._time - time.monotonic()) > _AHEAD:
            time.sleep(ahead)


@dataclass(frozen=True)
class Oscillator:
    """Internal oscillator of one converter.

    Its `frequency` at room temperature in Hz is 35 to 55 MHz, typically 43.4 MHz. It changes with
    temperature by `temperature_coefficient` in 1/K, relative.
    """

    frequency: float = INTERNAL_CLOCK
    temperature_coefficient: float = INTERNAL_CLOCK_PER_KELVIN

    def at(self, temperature: float) -> float:
        """Return the frequency in Hz at a temperature in °C."""
        return self.frequency * (1 + self.temperature_coefficient * (temperature - ROOM_TEMPERATURE))


@dataclass(frozen=True)
class Drift:
    """Temperature of the board over time."""

    rate: float = 0.0  # rate of warming in K/s
    start: float = ROOM_TEMPERATURE  # temperature in °C at the time 0

    def at(self, time: float) -> float:
        """Return the temperature in °C at a time in s."""
        return self.start + self.rate * time


@dataclass
class Conditions:
    """Surroundings of the converter, which may change at any time."""

    oscillator: Oscillator = field(default_factory=Oscillator)  # of the converter
    drift: Drift = field(default_factory=Drift)  # temperature of the board
    noise: float | None = None  # relative standard deviation of a frequency at full resolution
    clkin: float | None = None  # frequency at the pin CLKIN in Hz. None if the pin is grounded


class Place(NamedTuple):
    """Position from the map's origin and depth, in m."""

    x: float
    y: float
    depth: float


LIFTED = Place(0.0, 0.0, 0.0)
"""Place of an indenter without contact."""


class Indenter:
    """Indenter on the emulated sensor.

    `before_change` is called before it moves. `check` is called with every place on its path and
    refuses places that it cannot reach.

    >>> indenter = Indenter()
    >>> indenter.follow([(0.0, 0.0, 0.0, 0.0), (1.0, 2e-3, 0.0, 1e-3)])
    >>> indenter.at(0.5)
    Place(x=0.001, y=0.0, depth=0.0005)
    """

    def __init__(
        self, before_change: Callable[[], None] = lambda: None, check: Callable[[Place], None] = lambda place: None
    ) -> None:
        self._before_change, self._check = before_change, check
        self._path = np.array([(0.0, *LIFTED)]).T  # times, x, y and depths

    def press(self, x: float, y: float, depth: float) -> None:
        """Press at once at a position to a depth."""
        self.follow([(0.0, x, y, depth)])

    def lift(self) -> None:
        """Lift at once."""
        x, y = self._path[1:3, -1].tolist()
        self.press(x, y, 0.0)

    def follow(self, path: Sequence[tuple[float, float, float, float]]) -> None:
        """Move along straight lines through points in time.

        Each point has a rising time in s by the board's clock, and x, y and depth in m. The
        indenter stands still before the first and after the last time.
        """
        for point in path:
            self._check(Place(*point[1:]))
        self._before_change()
        self._path = np.array(path).T

    def at(self, time: float) -> Place:
        """Return the place of the indenter."""
        times, *rows = self._path
        return Place(*(float(np.interp(time, times, row)) for row in rows))
