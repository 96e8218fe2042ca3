"""Detection of presses in δ, despite noise and slow drift.

At rest δ follows a straight line in time, fitted to the latest seconds, so that drift is not
detected as a press. A deviation from the line beyond the noise is a press. It ends when little of
the deviation remains.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import fdtri

from coilarray.compute.arrays import FloatArray

if TYPE_CHECKING:  # takes a second to load and is not needed without a model
    from coilarray.localize.inverse import Location

FALSE_ALARM = 1e-9  # probability that noise alone begins a press in a scan, once in four months at 100 scans/s
REMAINS = 0.25  # part of the largest deviation below which a press has ended, as a finger is unsteady
_MEMORY = 5.0  # s over which the line at rest is fitted, or the number of scans in the baseline if they take longer
_AVERAGED = 200  # scans over which the noise is averaged
_PER_DIFFERENCE = 2 / 3  # degrees of freedom of a difference of successive values, which share one (von Neumann 1941)
_SPREAD = 1e-12  # of times, relative, below which it is rounding
_CODE = 8e-8  # least step of δ: a code is 4e-8 of a frequency of 2 MHz at a reference of 21.7 MHz
_ROUNDING = _CODE / math.sqrt(12)  # least noise of δ, by a rounded code


@dataclass(frozen=True, eq=False)
class Press:
    """Press, from its begin on."""

    number: int  # from 1
    begin: float  # s since the first scan
    end: float | None  # likewise, None while it lasts
    delta: float  # largest deviation of the δ of a state from rest, with its sign
    location: Location | None  # at the largest deviation with a location


def baseline_text(scans: int) -> str:
    """Return the text that the baseline needs more scans.

    >>> baseline_text(2)
    'baseline: scans without an indentation still wanted: 2'
    """
    return f"baseline: scans without an indentation still wanted: {scans}"


class PressDetector:
    """Detector of presses in the δ of successive scans.

    `baseline` has times in s and δ of at least two scans at rest. With n values in a scan, the mean
    of the n squared deviations from the line over their variance has Fisher's F distribution of n
    and ν degrees of freedom at rest, if σ² is estimated with ν. The variance is σ² (1 + h), where h
    is the variance of the line itself, which grows during a press. σ² is estimated from differences
    of successive scans at rest, in which a drift cancels (J. von Neumann, Ann. Math. Statist. 12,
    1941, 367). The line is fitted by least squares with weights exp(−age/5 s) (R. G. Brown,
    Smoothing, Forecasting and Prediction, 1963). If a press ends off the line, the line restarts
    from as many successive scans on a common line as the baseline has. Until then the next press
    must be four times as large as the remaining deviation.
    """

    def __init__(self, baseline: Sequence[tuple[float, Mapping[str, float]]], number: int = 0) -> None:
        self.number = number
        self._scans = len(baseline)
        self._names = tuple(dict.fromkeys(name for _, delta in baseline for name in delta))
        self._line = self._fresh = _Line(len(self._names))
        self._variance, self._freedom = 0.0, 0.0
        self._before = np.full(len(self._names), np.nan)
        self._press: Press | None = None
        self._largest = self._located = self._least = 0.0  # root mean squares of deviations
        for time, delta in baseline:
            self._line.advance(time)
            self._add(self._row(delta))

    def take(self, time: float, delta: Mapping[str, float], location: Location | None = None) -> Press | None:
        """Return the press during a scan or ending with it."""
        values = self._row(delta)
        self._line.advance(time)
        off, deviation, limit = self._deviation(self._line, values)
        if not off.size:
            return self._press
        if self._press is None:
            self._least = min(self._least, deviation)
            if deviation <= max(limit, self._least / REMAINS):
                if deviation <= limit:
                    self._add(values)
                    return None
                self._fresh.advance(time)  # a scan of a line that may replace the old
                _, apart, most = self._deviation(self._fresh, values)
                if apart > most:
                    self._fresh = _Line(len(self._names))
                    self._fresh.advance(time)
                self._fresh.add(values, 1.0)
                if self._fresh.count >= self._scans:
                    self._line, self._fresh, self._least = self._fresh, _Line(len(self._names)), 0.0
                return None
            self.number += 1
            self._press = Press(self.number, time, None, 0.0, None)
            self._largest = self._located = 0.0
        if deviation > self._largest:
            self._largest = deviation
            self._press = replace(self._press, delta=float(off[np.abs(off).argmax()]))
        if location is not None and location.modes and deviation > self._located:
            self._located = deviation
            self._press = replace(self._press, location=location)
        press = self._press
        if deviation < max(limit / 2, REMAINS * self._largest):
            press, self._press, self._least = replace(press, end=time), None, deviation
            self._before, self._fresh = np.full(len(self._names), np.nan), _Line(len(self._names))
        return press

    def _row(self, delta: Mapping[str, float]) -> FloatArray:
        return np.array([delta.get(name, math.nan) for name in self._names])

    def _deviation(self, line: _Line, values: FloatArray) -> tuple[FloatArray, float, float]:
        """Return deviations from a line, their rms and its limit."""
        expected, uncertainty = line.now()
        known = np.isfinite(values) & np.isfinite(expected)
        off = (values - expected)[known]
        if not off.size:
            return off, 0.0, 0.0
        variance = self._variance * (1 + float(uncertainty[known].mean()))
        limit = math.sqrt(_quantile(off.size, max(round(self._freedom), 1)) * variance)
        return off, math.sqrt(float(off @ off) / off.size), limit

    def _add(self, values: FloatArray) -> None:
        self._line.add(values, math.exp(-self._line.step / _MEMORY) if self._line.count >= self._scans else 1.0)
        steps = (values - self._before)[np.isfinite(values) & np.isfinite(self._before)]
        self._before = values
        if steps.size:
            more, before = _PER_DIFFERENCE * steps.size, min(self._freedom, _AVERAGED * float(steps.size))
            found = float(steps @ steps) / (2 * steps.size) + _ROUNDING**2
            self._variance += (found - self._variance) * more / (before + more)
            self._freedom = before + more


class _Line:
    """Weighted lines in time, as sums about the present."""

    def __init__(self, states: int) -> None:
        self.count = 0
        self.step = 0.0  # s since the time before
        self._time = math.nan
        self._sums = np.zeros((5, states))  # of w, w u, w u², w δ and w u δ with u = time − present

    def advance(self, time: float) -> None:
        """Advance to a time in s, never backwards."""
        self.step = step = max(time - self._time, 0.0) if math.isfinite(self._time) else 0.0
        self._time = time
        weight, first, second, one, moment = self._sums
        second += step * (step * weight - 2 * first)
        first -= step * weight
        moment -= step * one

    def add(self, values: FloatArray, kept: float) -> None:
        """Add the present δ, after multiplying earlier weights by `kept`."""
        self.count += 1
        known = np.isfinite(values)
        self._sums *= kept
        self._sums[0] += known
        self._sums[3] += np.where(known, values, 0.0)

    def now(self) -> tuple[FloatArray, FloatArray]:
        """Return the present values and variances, NaN before two times."""
        weight, first, second, one, moment = self._sums
        spread = weight * second - first**2
        with np.errstate(divide="ignore", invalid="ignore"):
            spread = np.where(spread > _SPREAD * weight * second, spread, np.nan)
            return (second * one - first * moment) / spread, second / spread


@lru_cache(maxsize=4096)
def _quantile(values: int, freedom: int) -> float:
    return float(fdtri(values, freedom, 1 - FALSE_ALARM))
