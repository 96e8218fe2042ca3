"""Place of the emulated indenter.

It is pressed and lifted at once, or moves along a path in time.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

from coilarray.errors import HardwareError


class Place(NamedTuple):
    """Position from the map's origin and depth, in m."""

    x: float
    y: float
    depth: float


LIFTED = Place(0.0, 0.0, 0.0)
"""Place of an indenter without contact."""


class Indenter:
    """Indenter on the emulated sensor.

    `before_change` is called before it moves. `check` is called with every place on its path and refuses places that it
    cannot reach.

    >>> indenter = Indenter()
    >>> indenter.follow([(0.0, 0.0, 0.0, 0.0), (1.0, 2e-3, 0.0, 1e-3)])
    >>> indenter.at(0.5)
    Place(x=0.001, y=0.0, depth=0.0005)
    """

    def __init__(
        self, before_change: Callable[[], None] = lambda: None, check: Callable[[Place], None] = lambda place: None
    ) -> None:
        self._before_change, self._check = before_change, check
        self._times: list[float] = [0.0]
        self._places: list[Place] = [LIFTED]

    def press(self, x: float, y: float, depth: float) -> None:
        """Press at once at a position to a depth.

        `x`, `y` and `depth` are in m.
        """
        self.follow([(0.0, x, y, depth)])

    def lift(self) -> None:
        """Lift at once."""
        last = self._places[-1]
        self.press(last.x, last.y, 0.0)

    def follow(self, path: Sequence[tuple[float, float, float, float]]) -> None:
        """Move along straight lines through points in time.

        Each point has a rising time in s by the board's clock, and x, y and depth in m. The indenter stands still
        before the first and after the last time. A HardwareError is raised for an empty path, times that do not rise, a
        negative depth, a value that is not finite, or a place that the indenter cannot reach.
        """
        times = [point[0] for point in path]
        if not path or not all(math.isfinite(value) for point in path for value in point):
            raise HardwareError("a path of the indenter must have at least one point, all finite.")
        if any(later <= earlier for earlier, later in pairwise(times)):
            raise HardwareError("times of a path of the indenter must rise.")
        if min(point[3] for point in path) < 0:
            raise HardwareError("depths of a path of the indenter must not be negative.")
        places = [Place(*point[1:]) for point in path]
        for place in places:
            self._check(place)
        self._before_change()
        self._times, self._places = times, places

    def at(self, time: float) -> Place:
        """Return the place of the indenter.

        `time` is in s.
        """
        after = bisect_right(self._times, time)
        if after == 0 or after == len(self._times):
            return self._places[max(after - 1, 0)]
        start, stop = self._times[after - 1 : after + 1]
        share = (time - start) / (stop - start)
        return Place(*(a + share * (b - a) for a, b in zip(*self._places[after - 1 : after + 1], strict=True)))
