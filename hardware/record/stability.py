"""Stability of a board: the drift of L_0 of every state, and the Allan deviation at rest.

The drift is a low polynomial of time, fitted to the scans at rest. The internal oscillator of the converter falls by
about 13 ppm/K, which reads as 26 ppm/K in L. Coils and switches have coefficients of their own. Over minutes to hours
the sum is a smooth curve. A fit to all scans at rest is much more accurate than the single baseline before each
indentation, so δ loses the noise of its L_0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.stats import chi2

from coilarray.compute.arrays import FloatArray
from coilarray.compute.netcdf import variables
from coilarray.errors import HardwareError

HIGHEST_ORDER = 3
"""Highest order of the polynomial."""

_ROUNDING = 1e-9  # of the variance of a scan
_SPARE = 5  # scans beyond the number of coefficients that the estimate of the scatter needs
_ALIKE = 3.0  # standard deviations by which von Neumann's ratio may fall short of its value for white noise


@dataclass(frozen=True)
class Drift:
    """Drift of a state's L_0 within a session.

    L_0 is inductance · (1 + Σ c_k u^k), k from 1, u = (time − middle)/half.
    """

    start: float  # time of the first scan at rest, in s from the first scan of the recording
    stop: float  # time of the last scan at rest, likewise
    gap: float  # longest time between two of them in s; the curve may be extrapolated by it at both ends
    inductance: float  # L_0 at the middle in H
    coefficients: tuple[float, ...]  # c_1 … c_n, without unit
    covariance: tuple[tuple[float, ...], ...]  # of the relative inductance and the coefficients, (n + 1, n + 1)
    scatter: float  # relative standard deviation of one scan about the curve
    smooth: bool  # whether the scans scatter about the curve randomly; if False, no such curve describes L_0
    state: str = ""
    session: int = 0  # index in its recording
    boot: int = 0  # session number of the board
    started: float = 0.0  # s since the epoch; it identifies the session among others of the same board

    def __post_init__(self) -> None:
        """Raise HardwareError for implausible values."""
        terms = len(self.coefficients) + 1
        numbers = [self.started, self.start, self.stop, self.gap, self.inductance, self.scatter, *self.coefficients]
        if not all(map(math.isfinite, [*numbers, *(value for row in self.covariance for value in row)])):
            raise HardwareError(f"the drift of {self.state} must be of finite numbers.")
        if not (self.start < self.stop and self.inductance > 0 and 0 <= self.scatter < 1 and self.gap >= 0):
            raise HardwareError(
                f"the drift of {self.state} must be of a time that rises, a positive inductance and a scatter below 1."
            )
        if not 2 <= terms <= HIGHEST_ORDER + 1 or [len(row) for row in self.covariance] != [terms] * terms:
            raise HardwareError(
                f"the drift of {self.state} must have 1 to {HIGHEST_ORDER} coefficients, and a square covariance."
            )
        if not np.all(np.linalg.eigvalsh(np.array(self.covariance)) >= -_ROUNDING * self.scatter**2):
            raise HardwareError(f"the covariance of the drift of {self.state} must not be negative.")

    @property
    def rate(self) -> float:
        """Relative change of L_0 in 1/s at the middle."""
        return self.coefficients[0] / self._half

    @property
    def rate_error(self) -> float:
        """Standard error of `rate` in 1/s."""
        return math.sqrt(max(self.covariance[1][1], 0.0)) / self._half

    def at(self, time: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return L_0 in H and its relative standard error.

        `time` is in s. Both are NaN outside the range of the curve.
        """
        t = np.asarray(time, dtype=np.float64)
        u = (t - (self.start + self.stop) / 2) / self._half
        powers = u[..., None] ** np.arange(len(self.coefficients) + 1)
        value = self.inductance * (powers @ np.array([1.0, *self.coefficients]))
        error = np.sqrt(np.maximum(np.einsum("...i,ij,...j->...", powers, np.array(self.covariance), powers), 0.0))
        inside = (t >= self.start - self.gap) & (t <= self.stop + self.gap)
        return np.where(inside, value, np.nan), np.where(inside, error, np.nan)

    @property
    def _half(self) -> float:
        return (self.stop - self.start) / 2


def fit_drift(
    time: npt.ArrayLike,
    inductance: npt.ArrayLike,
    *,
    order: int | None = None,
    state: str = "",
) -> Drift:
    """Fit the drift of a state to scans at rest.

    `time` of the scans is in s, rising, and `inductance` is L_0 in H, NaN if a scan has no value. `order` of the
    polynomial is 1 to 3, by default the lowest order with random residuals.

    Notes
    -----
    The fit is unweighted least squares. J. von Neumann's ratio (Ann. Math. Statist. 12, 1941, 367) is half the mean
    square of successive differences over the mean square. Residuals count as random if it is less than three of its
    standard deviations, √n⁻¹, below one.

    Examples
    --------
    >>> time = np.arange(0.0, 600.0, 2.0)
    >>> noise = 1e-6 * np.random.default_rng(0).standard_normal(time.size)
    >>> drift = fit_drift(time, 50e-6 * (1 + 2e-8 * time + noise))
    >>> len(drift.coefficients), f"{drift.rate:.3g} ± {drift.rate_error:.1g} per s"
    (1, '1.95e-08 ± 3e-10 per s')
    """
    _check_order(order)
    t, values = np.asarray(time, dtype=np.float64), np.asarray(inductance, dtype=np.float64)
    if t.ndim != 1 or t.shape != values.shape:
        raise HardwareError(
            f"time and inductance of a drift must be rows of one length; got {t.shape}, {values.shape}."
        )
    known = np.isfinite(values)
    t, values = t[known], values[known]
    if len(t) < (order or 1) + 1 + _SPARE:
        raise HardwareError(
            f"a drift of order {order or 1} needs {(order or 1) + 1 + _SPARE} scans at rest; "
            f"{state or 'the state'} has {len(t)}."
        )
    if not np.isfinite(t).all() or any(later <= earlier for earlier, later in pairwise(t.tolist())):
        raise HardwareError("the times of a drift must be finite and rise.")
    highest = min(HIGHEST_ORDER, len(t) - 1 - _SPARE)
    first, last = (1, highest) if order is None else (order, order)
    drift = _fitted(t, values, first, state)
    while not drift.smooth and len(drift.coefficients) < last:
        drift = _fitted(t, values, len(drift.coefficients) + 1, state)
    return drift


def fit_drifts(
    series: xr.Dataset, sessions: Sequence[tuple[int, float]], *, order: int | None = None
) -> tuple[Drift, ...]:
    """Fit the drift of every session and state.

    States of the recording with too few scans at rest are left out. `sessions` are the board's session number and the
    start in s since the epoch of each session of the recording.
    """
    _check_order(order)
    rest, drifts = at_rest(series), []
    for session, (boot, started) in enumerate(sessions):
        own = rest & (series.session.values == session)
        for k, state in enumerate(series.state.values.tolist()):
            values = series.inductance.values[own, k]
            if np.isfinite(values).sum() >= (order or 1) + 1 + _SPARE:
                drift = fit_drift(series.time.values[own], values, order=order, state=state)
                drifts.append(replace(drift, session=session, boot=boot, started=started))
    return tuple(drifts)


def at_rest(series: xr.Dataset) -> npt.NDArray[np.bool_]:
    """Mark the scans of a series at rest, shape (scan,)."""
    return np.asarray(~(series.depth.values > 0))


def _check_order(order: int | None) -> None:
    if order is not None and not 1 <= order <= HIGHEST_ORDER:
        raise HardwareError(f"the order of a drift must be 1 to {HIGHEST_ORDER}; got {order}.")


def _fitted(t: FloatArray, values: FloatArray, order: int, state: str) -> Drift:
    """Fit a polynomial of the given order to one state."""
    start, stop = float(t[0]), float(t[-1])
    u = (t - (start + stop) / 2) / ((stop - start) / 2)
    powers = u[:, None] ** np.arange(order + 1)
    mean = float(values.mean())
    inverse = np.linalg.inv(powers.T @ powers)
    terms = inverse @ (powers.T @ (values / mean))
    remains = values / mean / terms[0] - powers @ (terms / terms[0])
    scatter = float(np.sqrt(remains @ remains / (len(t) - order - 1)))
    ratio = float(np.mean(np.diff(remains) ** 2) / (2 * np.mean(remains**2))) if remains.any() else 1.0
    return Drift(
        start=start,
        stop=stop,
        gap=float(np.diff(t).max()),
        inductance=mean * float(terms[0]),
        coefficients=tuple((terms[1:] / terms[0]).tolist()),
        covariance=tuple(map(tuple, (scatter**2 * inverse).tolist())),
        scatter=scatter,
        smooth=ratio > 1 - _ALIKE / math.sqrt(len(t)),
        state=state,
    )


CONFIDENCE = 0.683
"""Probability of the confidence intervals: one standard deviation."""

FEWEST = 8
"""Number of scans that an Allan deviation needs."""
_SPAN = 3  # longest average, as a part of the whole
_MOST_GAPS = 10  # places of scans in time for each scan


@dataclass(frozen=True, eq=False)
class AllanDeviation:
    """Overlapping Allan deviation of a row of values."""

    factors: npt.NDArray[np.intp]  # numbers of neighbouring values that are averaged
    deviation: FloatArray
    low: FloatArray  # ends of its confidence interval
    high: FloatArray


def allan_deviation(
    values: npt.ArrayLike, *, factors: npt.ArrayLike | None = None, confidence: float = CONFIDENCE
) -> AllanDeviation:
    """Compute the overlapping Allan deviation of equidistant values.

    `values` are at equal distances in time, NaN if a value is missing. `factors` are the numbers of values that are
    averaged, by default 1, 2, 4, … up to a third of all. Factors for which too many values are missing are left out.

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
    """Degrees of freedom of the overlapping estimate."""
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
