"""Alignment of two response maps by a scale of δ and a shift in x and y.

    measured(x, y) ≈ scale · other(x − shift_x, y − shift_y)

by least squares over the same set of places for every trial shift, so that nothing is extrapolated and the set does not
change while the shift is searched.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from coilarray.compute.arrays import BoolArray, FloatArray
from coilarray.errors import LocalizeError
from coilarray.localize.forward import ForwardModel

LEAST_PLACES = 8
"""Least number of places for a shift. With fewer places only the scale is determined."""

_ROUNDING = 1e-9  # of a table's extent, by which a place may lie outside and still count as on the edge
_FLAT = 1e-9  # of the other columns, below which the slope by an unknown counts as zero
_CONDITION = 1e12  # of the equations, beyond which they determine nothing
_AT_END = 1e-3  # of its range, as the solver stays inside bounds and stops a little before them
_CLOSE = 1e-14  # relative, convergence to rounding


@dataclass(frozen=True, eq=False)
class Alignment:
    """Scale and shift of one map onto another, with their standard deviations by the given noise.

    The scale is the factor of the other map's δ, NaN if that map is flat. The shift along x and y in m is NaN along an
    axis without a search, or if its standard deviation is greater than the largest shift: the map does not determine
    it, and it is taken as 0. `used` (places,) marks the places that were used. A shift that is `at_limit` is at the end
    of the searched range, and the true shift beyond. `scatter` is the root of the residuals' sum of squares over the
    degrees of freedom, in δ, NaN without any.
    """

    scale: float
    shift: tuple[float, float]
    scale_std: float
    shift_std: tuple[float, float]
    used: BoolArray
    at_limit: bool
    scatter: float


def inside(model: ForwardModel, places: FloatArray, margin: tuple[float, float] = (0.0, 0.0)) -> BoolArray:
    """Test which places (n, 3) lie in a model's table.

    A margin along x and y in m is kept. Rounding puts no place outside. Places are x, y and depth in m. The depth
    counts if the model has more than one.
    """
    free = model.free
    room = np.array([*margin, 0.0])[free]
    slack = _ROUNDING * (model.upper - model.lower)[free]
    low, high = (model.lower[free] + room - slack), (model.upper[free] - room + slack)
    return np.asarray(((places[:, free] >= low) & (places[:, free] <= high)).all(axis=1))


def values_at(model: ForwardModel, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """δ (n,) of a model of one state and its slopes (n, 2) in 1/m along x and y, at places `inside`."""
    delta, jacobian = model.linear(places)
    return delta[:, 0], jacobian[:, 0, :2]


def align(
    model: ForwardModel,
    places: npt.ArrayLike,
    measured: npt.ArrayLike,
    *,
    largest_shift: tuple[float, float],
    noise: npt.ArrayLike | None = None,
) -> Alignment:
    """Fit the scale and shift that bring the map of a model of one state onto values measured at places (n, 3).

    Places are x, y and depth in m. Only those are used that stay in the model's table under the `largest_shift` along x
    and y in m. With fewer than 8 such places no shift is searched, and also not along an axis where this is 0. All
    places have the same weight. The standard deviations belong to this estimate under the given noise of δ, by default
    the scatter of the residuals, (JᵀJ)⁻¹ Jᵀ diag(σ²) J (JᵀJ)⁻¹. They do not include other differences of the maps.
    Raises LocalizeError for arguments that are not finite or do not fit each other.
    """
    at, values = np.asarray(places, dtype=np.float64), np.asarray(measured, dtype=np.float64)
    sigma = None if noise is None else np.asarray(noise, dtype=np.float64)
    _check(model, at, values, largest_shift, sigma)
    used = inside(model, at, largest_shift)
    axes = [k for k in (0, 1) if largest_shift[k] > 0]
    if used.sum() < LEAST_PLACES:
        used, axes = inside(model, at), []
    at, values = at[used], values[used]
    simulated = values_at(model, at)[0]
    if not float(simulated @ simulated) > 0:  # a δ of 1e-200 counts as zero
        return Alignment(np.nan, (np.nan, np.nan), np.nan, (np.nan, np.nan), used, False, np.nan)
    each = None if sigma is None else np.broadcast_to(sigma, used.shape)[used]
    unknowns, deviations, scatter = _solve(model, at, values, largest_shift, axes, each)
    while axes and not (deviations[1:] <= 1).all():  # NaN is not determined
        axes = [axis for axis, known in zip(axes, deviations[1:] <= 1, strict=True) if known]
        unknowns, deviations, scatter = _solve(model, at, values, largest_shift, axes, each)
    shift, shift_std = np.full(2, np.nan), np.full(2, np.nan)
    steps = np.asarray(largest_shift)[axes]
    shift[axes], shift_std[axes] = unknowns[1:] * steps, deviations[1:] * steps
    at_limit = bool((np.abs(unknowns[1:]) > 1 - _AT_END).any())
    (x, y), (x_std, y_std) = shift.tolist(), shift_std.tolist()
    return Alignment(float(unknowns[0]), (x, y), float(deviations[0]), (x_std, y_std), used, at_limit, scatter)


def _solve(
    model: ForwardModel,
    places: FloatArray,
    values: FloatArray,
    largest_shift: tuple[float, float],
    axes: Sequence[int],
    sigma: FloatArray | None,
) -> tuple[FloatArray, FloatArray, float]:
    """Scale and shifts in units of the largest shifts, standard deviations and residual scatter."""
    steps = np.asarray(largest_shift)[list(axes)]
    size = float(np.sqrt(np.mean(values**2))) or 1.0

    def moved(unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
        shifted = places.copy()
        shifted[:, axes] -= unknowns[1:] * steps
        return values_at(model, shifted)

    def remains(unknowns: FloatArray) -> FloatArray:
        return np.asarray((values - unknowns[0] * moved(unknowns)[0]) / size)

    def slopes(unknowns: FloatArray) -> FloatArray:
        delta, gradient = moved(unknowns)
        return np.column_stack((-delta, unknowns[0] * gradient[:, axes] * steps)) / size

    unmoved = values_at(model, places)[0]
    solution = np.array([float(values @ unmoved) / float(unmoved @ unmoved), *np.zeros(len(axes))])
    if axes:
        limit = np.array([np.inf, *np.ones(len(axes))])
        solution = least_squares(
            remains, solution, slopes, bounds=(-limit, limit), xtol=_CLOSE, ftol=_CLOSE, gtol=_CLOSE
        ).x
    remaining = remains(solution)
    freedom = len(values) - len(solution)
    scatter = float(np.sqrt(remaining @ remaining / freedom)) * size if freedom else np.nan
    noise = np.full(len(values), scatter) if sigma is None else sigma
    return solution, _deviations(slopes(solution), noise / size), scatter


def _deviations(jacobian: FloatArray, sigma: FloatArray) -> FloatArray:
    """Compute the standard deviations of the unknowns. They are NaN if the places do not determine an unknown."""
    result = np.full(jacobian.shape[1], np.nan)
    lengths = np.linalg.norm(jacobian, axis=0)
    known = np.flatnonzero(lengths > _FLAT * lengths.max())
    columns = jacobian[:, known] / lengths[known]
    if len(sigma) < len(known) or np.linalg.cond(columns) > _CONDITION:
        return result
    gain = np.linalg.pinv(columns) / lengths[known, None]
    result[known] = np.sqrt((gain**2 * sigma**2).sum(axis=1))
    return result


def _check(
    model: ForwardModel,
    places: FloatArray,
    values: FloatArray,
    largest_shift: tuple[float, float],
    sigma: FloatArray | None,
) -> None:
    """Check the arguments of `align`."""
    if len(model.states) != 1:
        raise LocalizeError(f"a map is aligned with a model of one state; this one has {', '.join(model.states)}.")
    if places.ndim != 2 or places.shape[1] != 3 or values.shape != places.shape[:1]:
        raise LocalizeError(f"places must have shape (n, 3) and measured (n,); got {places.shape} and {values.shape}.")
    if not (np.isfinite(places).all() and np.isfinite(values).all()):
        raise LocalizeError("places and measured values must be finite.")
    if not (np.isfinite(largest_shift).all() and min(largest_shift) >= 0):
        raise LocalizeError(f"largest_shift must be two lengths in m that are not negative; got {largest_shift}.")
    if sigma is not None:
        if sigma.shape not in ((), values.shape):
            raise LocalizeError(f"noise must be one number or one for each place; got shape {sigma.shape}.")
        if not (np.isfinite(sigma) & (sigma >= 0)).all():
            raise LocalizeError("noise must be finite and not negative.")
