"""Drift of a state's L_0 during a recording.

It is a low polynomial of time, fitted to the scans at rest. The internal oscillator of the converter falls by about 13
ppm/K, which reads as 26 ppm/K in L. Coils and switches have coefficients of their own. Over minutes to hours the sum is
a smooth curve. A fit to all scans at rest is much more accurate than the single baseline before each indentation, so δ
loses the noise of its L_0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.compute.arrays import FloatArray
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

    Parameters
    ----------
    time, inductance : array_like, shape (n,)
        Times of the scans in s, rising, and L_0 in H. NaN if a scan has no value.
    order : int, optional
        Order of the polynomial, 1 to 3. By default the lowest order with random residuals.

    Raises
    ------
    HardwareError
        Fewer than 6 scans beyond the order, times that do not rise, another order.

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

    States of the recording with too few scans at rest are left out. `series` is as returned by
    `coilarray.hardware.record.recorded_response.recorded_series`. `sessions` are the board's session number and the
    start in s since the epoch of each session of the recording. `order` has the same meaning as in `fit_drift`.
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
    """Mark the scans of a series at rest, shape (scan,).

    In these scans the indenter is not known to press.
    """
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
