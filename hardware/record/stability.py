"""Allan deviation and drift of a board at rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.stats import linregress

from coilarray.compute.arrays import FloatArray
from coilarray.compute.netcdf import variables
from coilarray.errors import HardwareError

FEWEST = 8  # number of scans that an Allan deviation needs
_SPAN = 3  # longest average, as a part of the whole
_MOST_GAPS = 10  # places of scans in time for each scan


def allan_deviation(values: FloatArray, factors: Sequence[int]) -> FloatArray:
    """Overlapping Allan deviation of equidistant values (n, columns).

    The result has the shape (factors, columns), NaN if too many values are missing. The method is
    the overlapping Allan variance of W. J. Riley, Handbook of Frequency Stability Analysis, NIST SP
    1065 (2008). σ²(m) is half the mean square of the differences of neighbouring means of m values,
    over all places without a missing value. White noise falls with the root of m, a random walk
    grows with it, and a steady drift grows with m.

    >>> noise = np.random.default_rng(0).standard_normal((4096, 1))
    >>> np.round(allan_deviation(noise, [1, 2, 4]), 2).ravel()
    array([1. , 0.7, 0.5])
    """
    missing = ~np.isfinite(values)
    y = np.where(missing, 0.0, values - np.nanmean(values, axis=0))
    sums, gaps = (np.cumsum(np.pad(rows.astype(float), ((1, 0), (0, 0))), axis=0) for rows in (y, missing))
    deviations = np.full((len(factors), values.shape[1]), np.nan)
    for k, m in enumerate(factors):
        differences = (sums[2 * m :] - 2 * sums[m:-m] + sums[: -2 * m]) / m
        whole = gaps[2 * m :] == gaps[: -2 * m]
        count = whole.sum(axis=0)
        squares = np.where(whole, differences**2, 0.0).sum(axis=0)
        deviations[k] = np.where(count > 0, np.sqrt(squares / np.maximum(count, 1) / 2), np.nan)
    return deviations


def stability(
    time: npt.ArrayLike, delta: npt.ArrayLike, states: Sequence[str], *, expected: npt.ArrayLike | None = None
) -> xr.Dataset:
    """Compute the stability of δ of a board at rest.

    The `time` (n,) of the scans is in s, rising. `delta` (n, states) is δ, or any quantity relative
    to L, NaN if a scan has no value, for the `states` of these names. `expected` (states,) is the
    standard deviation of one scan, from `coilarray.circuit.noise_budget.NoiseBudget.scan_noise`.

    The result has over ``state`` and ``tau``, the averaging time in s, the overlapping Allan
    ``deviation`` of δ, NaN if a state has too few values, and over ``state`` ``scan_noise``, the
    deviation of single scans, ``drift`` and ``drift_error``, the change of δ in 1/s by a straight
    line, and ``expected`` if it is given. Its attributes are ``period`` in s, from scan to scan,
    and ``scans``. The converter measures the coils in turn, which does not affect white noise.
    Noise that is faster than a scan is aliased.
    """
    t, values = np.asarray(time, dtype=np.float64), np.asarray(delta, dtype=np.float64)
    if t.ndim != 1 or values.shape != (len(t), len(states)):
        raise HardwareError(
            f"{len(states)} states at {t.size} times need δ {(t.size, len(states))}; got {values.shape}."
        )
    if len(t) < FEWEST:
        raise HardwareError(f"an Allan deviation needs at least {FEWEST} scans at rest; got {len(t)}.")
    steps, known = np.diff(t), np.isfinite(values)
    if not (np.isfinite(t).all() and (steps > 0).all()):
        raise HardwareError("the times of scans must be finite and rise.")
    for name, count in zip(states, known.sum(axis=0), strict=True):
        if count < FEWEST:
            raise HardwareError(f"{name} has fewer than {FEWEST} readings at rest.")
    period = float(np.median(steps))
    places = np.concatenate(([0], np.cumsum(np.maximum(np.round(steps / period), 1)))).astype(np.intp)
    if places[-1] >= _MOST_GAPS * len(t):
        raise HardwareError(f"scans at rest must follow each other; these have gaps of {steps.max():.3g} s.")
    even = np.full((places[-1] + 1, len(states)), np.nan)
    even[places] = values
    factors = 2 ** np.arange(int(np.log2(len(even) / _SPAN)) + 1)
    deviation = allan_deviation(even, factors.tolist()).T
    lines = [linregress(t[kept], column[kept]) for kept, column in zip(known.T, values.T, strict=True)]
    state = ("state",)
    table = [
        ("deviation", ("state", "tau"), deviation, "1", "Allan deviation of δ"),
        ("scan_noise", state, deviation[:, 0], "1", "noise of a scan"),
        ("drift", state, [line.slope for line in lines], "1/s", "drift of δ"),
        ("drift_error", state, [line.stderr for line in lines], "1/s", "± drift"),
    ]
    if expected is not None:
        table.append(("expected", state, np.asarray(expected, dtype=np.float64), "1", "noise of a scan by the budget"))
    return xr.Dataset(
        variables(*table),
        coords={"state": list(states), "tau": ("tau", factors * period, {"units": "s", "long_name": "averaging time"})},
        attrs={"period": period, "scans": len(t)},
    )
