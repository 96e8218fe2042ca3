"""Stability of a board's readings at rest.

It is the Allan deviation of every state against the averaging time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.stats import chi2

from coilarray.compute.arrays import FloatArray
from coilarray.compute.netcdf import variables
from coilarray.errors import HardwareError
from coilarray.hardware.record.baseline_drift import fit_drift

CONFIDENCE = 0.683
"""Probability of the confidence intervals: one standard deviation."""

FEWEST = 8
"""Number of scans that an Allan deviation needs."""
_SPAN = 3  # longest average, as a part of the whole
_MOST_GAPS = 10  # places of scans in time for each scan


@dataclass(frozen=True, eq=False)
class AllanDeviation:
    """Overlapping Allan deviation of a row of values.

    Parameters
    ----------
    factors : ndarray of int, shape (n,)
        Numbers of neighbouring values that are averaged.
    deviation, low, high : ndarray, shape (n,)
        The deviation, and the ends of its confidence interval.
    """

    factors: npt.NDArray[np.intp]
    deviation: FloatArray
    low: FloatArray
    high: FloatArray


def allan_deviation(
    values: npt.ArrayLike, *, factors: npt.ArrayLike | None = None, confidence: float = CONFIDENCE
) -> AllanDeviation:
    """Compute the overlapping Allan deviation of equidistant values.

    Parameters
    ----------
    values : array_like, shape (n,)
        At least 8 values at equal distances in time. NaN if a value is missing.
    factors : array_like of int, shape (n,), optional
        Numbers of values that are averaged. 1, 2, 4, … up to a third of all by default.
    confidence : float
        Probability of the confidence intervals, between 0 and 1.

    Returns
    -------
    AllanDeviation
        Without the factors for which too many values are missing.

    Raises
    ------
    HardwareError
        Fewer values, factors that are not from 1 to half of all, or a confidence that is not between 0 and 1.

    Notes
    -----
    The method is the overlapping Allan variance of W. J. Riley, Handbook of Frequency Stability Analysis, NIST SP 1065
    (2008). σ²(m) is half the mean square of the differences of neighbouring means of m values, over all places.
    Intervals come from χ² with its degrees of freedom for white noise or for a random walk, whichever are fewer, so
    they hold for both. Differences with a missing value are left out, and their share of the degrees of freedom with
    them. White noise falls with the root of m, a random walk grows with it, and a steady drift grows with m.

    Examples
    --------
    >>> found = allan_deviation(np.random.default_rng(0).standard_normal(4096))
    >>> found.factors[:3].tolist(), np.round(found.deviation[:3], 2)
    ([1, 2, 4], array([1. , 0.7, 0.5]))
    """
    y = np.asarray(values, dtype=np.float64)
    if y.ndim != 1 or np.isfinite(y).sum() < FEWEST:
        raise HardwareError(f"an Allan deviation needs at least {FEWEST} values in a row; got {np.isfinite(y).sum()}.")
    if not 0 < confidence < 1:
        raise HardwareError(f"confidence must be between 0 and 1; got {confidence}.")
    missing = ~np.isfinite(y)
    y = np.where(missing, 0.0, y - y[~missing].mean())
    sums, gaps = (np.concatenate(([0.0], np.cumsum(row))) for row in (y, missing))
    octaves = 2 ** np.arange(int(np.log2(len(y) / _SPAN)) + 1)
    wanted = np.atleast_1d(octaves if factors is None else np.asarray(factors, dtype=np.intp))
    if not ((wanted >= 1) & (2 * wanted <= len(y))).all():
        raise HardwareError(f"factors must be 1 to {len(y) // 2}; got {wanted.tolist()}.")
    rows = []
    for m in wanted.tolist():
        differences = (sums[2 * m :] - 2 * sums[m:-m] + sums[: -2 * m]) / m
        whole = gaps[2 * m :] == gaps[: -2 * m]
        if not whole.any():
            continue
        variance = float(np.mean(differences[whole] ** 2)) / 2
        freedom = max(_freedom(len(y) + 1, m) * whole.mean(), 1.0)
        ends = chi2.ppf([(1 + confidence) / 2, (1 - confidence) / 2], freedom)
        rows.append((m, *np.sqrt(variance * np.array([1.0, *(freedom / ends)]))))
    kept, *columns = zip(*rows, strict=True)
    return AllanDeviation(np.array(kept, dtype=np.intp), *map(np.array, columns))


def _freedom(n: int, m: int) -> float:
    """Degrees of freedom of the overlapping estimate.

    The estimate uses sums at n times. White noise and random walk are compared, and the smaller number is returned.
    """
    white = (3 * (n - 1) / (2 * m) - 2 * (n - 2) / n) * 4 * m**2 / (4 * m**2 + 5)
    walk = (n - 2) / m * ((n - 1) ** 2 - 3 * m * (n - 1) + 4 * m**2) / (n - 3) ** 2
    return min(white, walk)


def stability(
    time: npt.ArrayLike, delta: npt.ArrayLike, states: Sequence[str], *, expected: npt.ArrayLike | None = None
) -> xr.Dataset:
    """Compute the stability of δ of a board at rest.

    Parameters
    ----------
    time : array_like, shape (n,)
        Times of the scans in s, rising.
    delta : array_like, shape (n, states)
        δ of every scan and state, or any quantity relative to L. NaN if a scan has no value.
    states : sequence of str
        Names of the states.
    expected : array_like, shape (states,), optional
        Expected standard deviation of one scan, from `coilarray.circuit.noise_budget.NoiseBudget.scan_noise`.

    Returns
    -------
    xarray.Dataset
        Over ``state`` and ``tau``, the averaging time in s: ``deviation``, the overlapping Allan deviation of δ, and
        ``low`` and ``high``, the ends of its 68 % confidence interval. They are NaN if a state has too few values. Over
        ``state``: ``scan_noise``, the deviation of single scans, which for white noise is their standard deviation;
        ``drift`` and ``drift_error``, change of δ in 1/s by a straight line; ``expected`` if it is given. Attributes
        ``period`` in s, from scan to scan, and ``scans``.

    Raises
    ------
    HardwareError
        Fewer than 8 scans, times that do not rise, shapes that do not fit, a state without 8 values, or gaps that are
        ten times as long as all scans.

    Notes
    -----
    The converter measures one coil after the other, so it sees each state for a part of the time only. White noise is
    not affected by this. Noise that is faster than a scan is aliased.
    """
    t, values = np.asarray(time, dtype=np.float64), np.asarray(delta, dtype=np.float64)
    if t.ndim != 1 or values.shape != (len(t), len(states)):
        raise HardwareError(
            f"{len(states)} states at {t.size} times need δ {(t.size, len(states))}; got {values.shape}."
        )
    if len(t) < FEWEST:
        raise HardwareError(f"an Allan deviation needs at least {FEWEST} scans at rest; got {len(t)}.")
    steps = np.diff(t)
    if not (np.isfinite(t).all() and (steps > 0).all()):
        raise HardwareError("the times of scans must be finite and rise.")
    period = float(np.median(steps))
    places = np.concatenate(([0], np.cumsum(np.maximum(np.round(steps / period), 1)))).astype(np.intp)
    if places[-1] >= _MOST_GAPS * len(t):
        raise HardwareError(f"scans at rest must follow each other; these have gaps of {steps.max():.3g} s.")
    even = np.full((places[-1] + 1, len(states)), np.nan)
    even[places] = values
    found = []
    for k, name in enumerate(states):
        if np.isfinite(values[:, k]).sum() < FEWEST:
            raise HardwareError(f"{name} has fewer than {FEWEST} readings at rest.")
        found.append(allan_deviation(even[:, k]))
    factors = max((one.factors for one in found), key=len)
    rows = np.full((3, len(states), len(factors)), np.nan)
    for k, one in enumerate(found):
        rows[:, k, : len(one.factors)] = one.deviation, one.low, one.high
    lines = [fit_drift(t, 1 + column, order=1, state=name) for name, column in zip(states, values.T, strict=True)]
    both, state = ("state", "tau"), ("state",)
    table = [
        ("deviation", both, rows[0], "1", "Allan deviation of δ"),
        ("low", both, rows[1], "1", "lower end of its interval"),
        ("high", both, rows[2], "1", "upper end of its interval"),
        ("scan_noise", state, rows[0, :, 0], "1", "noise of a scan"),
        ("drift", state, [line.rate for line in lines], "1/s", "drift of δ"),
        ("drift_error", state, [line.rate_error for line in lines], "1/s", "± drift"),
    ]
    if expected is not None:
        table.append(("expected", state, np.asarray(expected, dtype=np.float64), "1", "noise of a scan by the budget"))
    return xr.Dataset(
        variables(*table),
        coords={"state": list(states), "tau": ("tau", factors * period, {"units": "s", "long_name": "averaging time"})},
        attrs={"period": period, "scans": len(t)},
    )
