"""History of δ for a plot.

It takes the same memory for any length, because it has the least and largest value in each of many equal times.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from coilarray.compute.arrays import FloatArray

SPANS = (10.0, 60.0, 600.0, 3600.0)
"""Lengths in s of the histories that are kept."""

BINS = 300
"""Number of equal times of each history."""


class History:
    """δ of some states over the latest `SPANS`.

    Examples
    --------
    >>> history = History(["L1"])
    >>> for k in range(1000):
    ...     history.add(0.01 * k, {"L1": 1e-3 if k == 500 else 0.0})
    >>> times, least, largest = history.values(10.0)
    >>> bool(largest[0].max() == 1e-3), len(times) <= BINS
    (True, True)
    """

    def __init__(self, states: Sequence[str]) -> None:
        self.states = tuple(states)
        self.end = 0.0  # s
        shape = (len(SPANS), BINS, len(self.states))
        self._least, self._largest = np.full(shape, np.nan), np.full(shape, np.nan)
        self._seen = np.zeros(shape[:2], dtype=bool)
        self._last = [-1] * len(SPANS)  # number of the latest time, counted from 0 s

    def add(self, time: float, delta: Mapping[str, float | None]) -> None:
        """Add a scan.

        `time` in s never falls. None stands for no value.
        """
        self.end = time
        values = np.array([delta.get(name) for name in self.states], dtype=np.float64)  # None is NaN
        for k, span in enumerate(SPANS):
            number = math.floor(time / (span / BINS))
            new = min(number - self._last[k], BINS)
            if new > 0:
                forgotten = np.arange(number - new + 1, number + 1) % BINS
                self._least[k, forgotten] = self._largest[k, forgotten] = np.nan
                self._seen[k, forgotten] = False
                self._last[k] = number
            at = self._last[k] % BINS
            self._seen[k, at] = True
            np.fmin(self._least[k, at], values, out=self._least[k, at])
            np.fmax(self._largest[k, at], values, out=self._largest[k, at])

    def values(self, span: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Read least and largest δ (state, time) over time.

        They cover one of the `SPANS`. Times without a scan are left out. NaN is a time with scans but without a value
        of the state.
        """
        k = SPANS.index(span)
        numbers = np.arange(max(self._last[k] - BINS + 1, 0), self._last[k] + 1)
        numbers = numbers[self._seen[k, numbers % BINS]]
        at = numbers % BINS
        return (numbers + 0.5) * (span / BINS), self._least[k, at].T, self._largest[k, at].T
