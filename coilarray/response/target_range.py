"""Range of a target and resolution of its distance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import xarray as xr
from scipy.interpolate import make_interp_spline

from coilarray.circuit.readability import readable_of
from coilarray.compute.arrays import FloatArray
from coilarray.compute.netcdf import variables
from coilarray.errors import MetalError, require_positive

STEPS = (1e-6, 1e-5, 1e-4)
"""Changes of distance in m whose resolution limit is reported.

For each, the farthest distance is given at which it is resolved.
"""
FACTOR = 3.0
"""Fewest standard deviations of |δ| for a target's detection.

The standard deviation is of a single reading.
"""
_FINE = 4001  # distances between the first and the last


def ranges_of(response: xr.Dataset, noise: float) -> xr.Dataset:
    """Find range and resolution of every state.

    They are computed at the place of the largest |δ| at the least distance.

    Parameters
    ----------
    response : xarray.Dataset
        ``delta`` (distance, y, x, state) of `coilarray.response.target.target_map`, and ``readable``, if present.
    noise : float
        Standard deviation σ of δ in a reading, positive.

    Returns
    -------
    xarray.Dataset
        ``best_x`` and ``best_y`` (state) are in m. ``distance_deviation`` (distance, state) is the standard deviation
        σ/|δ'| of a distance in m. ``range`` (state) is the distance in m at which |δ| has fallen to `FACTOR` σ.
        ``resolved_distance`` (step, state) is the distance up to which a ``step`` of distance in m is no less than the
        standard deviation. Both are NaN if this holds nowhere, and the last distance if it holds everywhere, with
        ``range_is_least`` and ``resolved_is_least`` set. ``nearest_readable`` (state) is the least distance in m that
        the converter reads, or NaN. Attributes ``sigma`` and ``range_factor``.

    Raises
    ------
    MetalError
        Noise that is not positive and finite.

    Notes
    -----
    Distances and places that the converter cannot read do not count. This applies to all places, and to other distances
    at the place where |δ| is the largest. Between the distances ln |δ| is a cubic spline, as δ falls about
    exponentially. If δ changes its sign, δ itself is the spline.
    """
    require_noise(noise)
    distance = response.distance.values
    delta = response.delta.transpose("distance", "state", "y", "x").values
    seen = readable_of(response).transpose("distance", "state", "y", "x").values
    states = delta.shape[1]
    deviation = np.full((len(distance), states), np.nan)
    nearest = np.full(states, np.nan)
    found, least = np.full((1 + len(STEPS), states), np.nan), np.zeros((1 + len(STEPS), states), dtype=np.bool_)
    rows, columns = np.zeros((2, states), dtype=np.intp)
    for s in range(states):
        at, read = delta[:, s].reshape(len(distance), -1), seen[:, s].reshape(len(distance), -1)
        counted = read.any(axis=0) if read.any() else ~read.any(axis=0)
        best = int(np.where(counted, np.abs(at[read.any(axis=1).argmax()]), -1.0).argmax())
        rows[s], columns[s] = np.unravel_index(best, delta.shape[2:])
        if not read[:, best].any():
            continue
        first = int(read[:, best].argmax())
        last = first + int(np.append(~read[first:, best], True).argmax())
        d = distance[first:last]
        nearest[s] = d[0]
        curve, slope = _curve(d, at[first:last, best])
        fine = np.geomspace(d[0], d[-1], _FINE) if len(d) > 1 else d
        size = np.abs(curve(fine)) / (FACTOR * noise)
        margins = [size]
        if len(d) > 1:
            with np.errstate(divide="ignore"):
                deviation[first:last, s] = noise / np.abs(slope(d))
            margins += [np.abs(slope(fine)) * step / noise for step in STEPS]
        for k, margin in enumerate(margins):
            found[k, s], beyond = _until(fine, margin)
            least[k, s] = beyond and last == len(distance)
    rows_of = (
        ("best_x", ("state",), response.x.values[columns], "m", "x where |δ| is the largest"),
        ("best_y", ("state",), response.y.values[rows], "m", "y where |δ| is the largest"),
        ("distance_deviation", ("distance", "state"), deviation, "m", "± distance"),
        ("nearest_readable", ("state",), nearest, "m", "least distance that the converter reads"),
        ("range", ("state",), found[0], "m", f"distance at which |δ| is {FACTOR:g} times the noise"),
        ("range_is_least", ("state",), least[0], "", "whether the range is longer"),
        ("resolved_distance", ("step", "state"), found[1:], "m", "distance up to which a step is resolved"),
        ("resolved_is_least", ("step", "state"), least[1:], "", "whether it is longer"),
    )
    step = ("step", np.array(STEPS), {"units": "m", "long_name": "change of distance"})
    return xr.Dataset(variables(*rows_of), coords={"step": step}, attrs={"sigma": noise, "range_factor": FACTOR})


def require_noise(noise: float) -> None:
    """Refuse noise of δ that is not positive and finite.

    The error is a MetalError.
    """
    require_positive("noise", noise, "", MetalError)


Curve = Callable[[FloatArray], FloatArray]


def _curve(distance: FloatArray, delta: FloatArray) -> tuple[Curve, Curve]:
    """δ over the distance, and its slope."""
    degree = min(3, len(distance) - 1)
    one_sign = bool((delta > 0).all() or (delta < 0).all())
    spline = make_interp_spline(distance, np.log(np.abs(delta)) if one_sign else delta, k=degree)
    if not one_sign:
        return spline, spline.derivative() if degree else np.zeros_like
    sign, change = np.sign(delta[0]), spline.derivative() if degree else np.zeros_like

    def value(at: FloatArray) -> FloatArray:
        return np.asarray(sign * np.exp(spline(at)))

    return value, lambda at: np.asarray(value(at) * change(at))


def _until(distance: FloatArray, margin: FloatArray) -> tuple[float, bool]:
    """Distance up to which a margin is at least 1.

    A flag tells whether this holds to the end. The distance is NaN if the margin begins below 1.
    """
    below = np.flatnonzero(margin < 1)
    if not len(below):
        return float(distance[-1]), True
    k = int(below[0])
    if k == 0:
        return float("nan"), False
    share = (margin[k - 1] - 1) / (margin[k - 1] - margin[k])
    return float(distance[k - 1] + share * (distance[k] - distance[k - 1])), False
