"""Comparison of a measured with a simulated response.

For every state and depth a scale of δ and a shift in x and y are found,

    measured(x, y) ≈ scale · simulated(x − shift_x, y − shift_y)

by least squares over the same set of positions for every trial shift, so that the set does not
change while the shift is searched. Nothing is extrapolated: measured positions outside of the
simulated map, which is interpolated, are left out and counted. The ellipses of both come from the
same positions with the same settings, since window and spacing of a map affect them
(`coilarray.paper.ellipse`).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.optimize import least_squares

from coilarray.compute.arrays import BoolArray, FloatArray
from coilarray.compute.netcdf import variables
from coilarray.compute.threads import Progress
from coilarray.errors import LocalizeError
from coilarray.localize.forward import ForwardModel, forward_model
from coilarray.paper.ellipse import PARAMETERS, fit_ellipses
from coilarray.response.dataset import RESPONSE

SOURCES = ("measured", "simulated")  # labels of the dimension ``source``
LEAST_PLACES = 8  # least number of places for a shift
REPLICATES = 16  # number of noisy maps, which give deviations to 18 %
_DIMS = ("depth", "y", "x", "state")
_LEAST_FOR_SHIFT = 4  # measured positions along an axis
_SAME_DEPTH = 1e-6  # relative
_ROUNDING = 1e-9  # of a table's extent, by which a place may lie outside and still count as on the edge
_FLAT = 1e-9  # of the other columns, below which the slope by an unknown counts as zero
_CONDITION = 1e12  # of the equations, beyond which they determine nothing
_AT_END = 1e-3  # of its range, as the solver stays inside bounds and stops a little before them
_CLOSE = 1e-14  # relative, convergence to rounding


def compare_responses(
    measured: xr.Dataset, simulated: xr.Dataset, *, largest_shift: float | None = None, progress: Progress | None = None
) -> xr.Dataset:
    """Compare a measured response with a simulated one.

    The `measured` dataset has ``delta`` (depth, y, x, state) and coordinates in m, NaN where a
    position was not measured. Its ``delta_std``, the standard deviation of δ, is the noise, of a
    single reading if the attribute ``repeats`` gives the number of readings in a mean δ. The
    `simulated` one has no NaN and at least four x and four y. It may be another measured response,
    whose ``delta_std`` is then added to the noise. The search shifts by up to `largest_shift` in m,
    by default the measured map's own spacing. Only positions that are in the simulated map by this
    much are used, so let it be larger than the measured. `progress` is called with (done, total).
    Raises LocalizeError for datasets that are not responses, no common state, depth or position, or
    a largest shift that is negative.

    The result holds the common states and depths at the positions that both have, over ``depth``,
    ``y``, ``x``, ``state``, ``axis`` (x, y), ``source`` (measured, simulated) and ``level``, NaN
    for unknown values:

    - ``delta`` (source, depth, y, x, state), and ``base_inductance`` (source, state) in H
    - ``residual_before`` and ``residual_after`` (depth, y, x, state): measured minus simulated, as
      it is, and scaled and shifted
    - for every depth and state ``scale`` and, with an axis, ``shift`` in m, which bring the
      simulated map onto the measured map, ``rms_before``, ``rms_after``, ``correlation_before`` and
      ``correlation_after``, each with its standard deviation, whose name ends in ``_std``,
      ``at_limit``, whether the best shift is beyond the largest, ``noise``, its level in δ if it is
      known, and ``points``, the number of positions
    - for every depth, state and ``source`` the ellipses of `level_curves` over the level of δ,
      neither scaled nor shifted: ``x0``, ``A``, ``B``, their standard deviations, ``undetermined``
      and ``ellipse_problem``

    Of the attributes, ``only_measured`` and ``only_simulated`` are states of a single response.
    ``depths_left_out`` in m and ``points_left_out`` were measured but are not in the simulated map.
    ``points_missing`` were not measured. ``noise_from`` is "delta_std" or "residuals". The
    attributes of both are kept as ``measured_…`` and ``simulated_…``.

    The standard deviations of scale, shift, rms and correlation are the effect of the noise of the
    readings on them, to first order. If no noise is known, it is taken from the scatter of the
    residuals of the fit. Noise of the simulated side (a second measurement) also biases the scale
    towards zero, by noise² over the mean square of its map.

    >>> from coilarray.paper.ellipse_model import published_map
    >>> simulated = published_map()
    >>> found = compare_responses(simulated.assign(delta=1.1 * simulated.delta), simulated)
    >>> found.scale.round(6).values.tolist(), float(abs(found["shift"]).max().round(9))
    ([[1.1, 1.1, 1.1]], 0.0)
    """
    reads = RESPONSE.checked(measured, "a measured response").transpose(*_DIMS, ...)
    simulated = RESPONSE.checked(simulated, "a simulated response")
    first, second = ([str(name) for name in data["state"].values] for data in (reads, simulated))
    states = [name for name in first if name in second]
    if not states:
        raise LocalizeError(
            f"the two responses have no state in common: measured {', '.join(first)}; simulated {', '.join(second)}."
        )
    model = forward_model(simulated).select(states)
    depths = reads.depth.values
    if len(model.depth) > 1:
        slack = _SAME_DEPTH * model.depth[-1]
        there = (depths >= model.depth[0] - slack) & (depths <= model.depth[-1] + slack)
    else:
        there = np.isclose(depths, model.depth[0], rtol=_SAME_DEPTH, atol=0)
    if not there.any():
        listed, known = (", ".join(f"{value * 1e3:.4g}" for value in values) for values in (depths, model.depth))
        raise LocalizeError(f"the two responses have no depth in common: measured {listed} mm; simulated {known} mm.")
    kept = reads.sel(state=states).isel(depth=np.flatnonzero(there))
    noise = _noise(kept, simulated.sel(state=states))
    if largest_shift is not None and not (np.isfinite(largest_shift) and largest_shift >= 0):
        raise LocalizeError(f"largest_shift must be finite and not negative; got {largest_shift} m.")
    x_shift, y_shift = (
        0.0
        if len(axis) < _LEAST_FOR_SHIFT
        else float(np.median(np.diff(axis)))
        if largest_shift is None
        else largest_shift
        for axis in (kept.x.values, kept.y.values)
    )

    def compared(k: int, j: int) -> xr.Dataset:
        level = None if noise is None else noise[k, ..., j]
        return _compared(kept.isel(depth=k, state=j), model.select([states[j]]), level, (x_shift, y_shift))

    rows = [[compared(k, j) for j in range(len(states))] for k in range(kept.sizes["depth"])]
    found = _combined(rows, "depth", "state").transpose(*_DIMS, ...)
    if not found.points.any():
        raise LocalizeError("no measured position is in the simulated map.")
    both = np.stack([kept.delta.values, found.simulated.values])
    data = variables(("delta", ("source", *_DIMS), both, "1", "δ"))
    if "base_inductance" in kept and "base_inductance" in simulated:
        pair = [side.base_inductance.sel(state=kept.state.values).values for side in (kept, simulated)]
        data |= variables(("base_inductance", ("source", "state"), np.array(pair), "H", "L_0"))
    coords: dict[str, Any] = {name: kept[name] for name in _DIMS}
    for name in ("depth", "y", "x"):  # a response of other programs may not have them
        coords[name] = coords[name].assign_attrs({"long_name": name, **kept[name].attrs, "units": "m"})
    places = {name: simulated[name] for name in ("coil", "coil_x", "coil_y") if name in simulated.coords}
    coords |= {**places, "source": ("source", list(SOURCES)), "axis": ("axis", ["x", "y"])}
    said = {
        f"{who}_{key}": value
        for who, of in zip(SOURCES, (kept, simulated), strict=True)
        for key, value in of.attrs.items()
    }
    counts = {f"points_{name}": int(found[name].sum()) for name in ("left_out", "missing")}
    return (
        found.drop_vars(("simulated", "left_out", "missing"))
        .assign(data)
        .assign_coords(coords)
        .merge(_ellipses(kept, simulated, model, progress))
        .assign_attrs(
            {**said, **counts},
            only_measured=", ".join(name for name in first if name not in second),
            only_simulated=", ".join(name for name in second if name not in first),
            depths_left_out=", ".join(f"{value:.6g}" for value in depths[~there]),
            noise_from="residuals" if noise is None else "delta_std",
        )
    )


def _combined(rows: Sequence[Any], *dims: str) -> xr.Dataset:
    """Datasets in nested lists along new dimensions."""
    combined: xr.Dataset = xr.combine_nested(
        rows,
        dims,
        join="outer",
        fill_value={"undetermined": False},
        coords="minimal",
        compat="override",
        combine_attrs="override",
    )
    return combined


def _compared(
    measured: xr.Dataset, model: ForwardModel, sigma: FloatArray | None, largest_shift: tuple[float, float]
) -> xr.Dataset:
    shape = measured.delta.shape
    X, Y = np.meshgrid(measured.x.values, measured.y.values)
    places = np.column_stack((X.ravel(), Y.ravel(), np.full(X.size, float(measured.depth))))
    values = measured.delta.values.ravel()
    there = np.isfinite(values) & inside(model, places)
    given = None if sigma is None else sigma.ravel()
    level = None if given is None else given[there]
    found = align(model, places[there], values[there], largest_shift=largest_shift, noise=level)
    used = np.zeros(values.size, dtype=bool)
    used[there] = found.used
    before = np.full(values.size, np.nan)
    before[there] = values_at(model, places[there])[0]
    moved = places - [*np.nan_to_num(found.shift), 0.0]
    still = there & inside(model, moved)
    shifted = np.full(values.size, np.nan)
    shifted[still] = values_at(model, moved[still])[0]
    after = found.scale * shifted
    noise = np.full(values.size, found.scatter) if given is None else given
    read, spread = values[used], noise[used]
    figures = {
        "scale": (found.scale, found.scale_std),
        "rms_before": _rms(read, before[used], spread),
        "rms_after": _rms(read, after[used], spread),
        "correlation_before": _correlation(read, before[used], spread),
        "correlation_after": _correlation(read, shifted[used], spread),
    }
    of_noise = float(np.sqrt(np.mean(given[used] ** 2))) if given is not None and used.any() else np.nan
    place = ("y", "x")
    rows: list[tuple[str, tuple[str, ...], Any, str, str]] = [
        ("simulated", place, before.reshape(shape), "1", "simulated δ"),
        ("residual_before", place, (values - before).reshape(shape), "1", "measured less simulated δ"),
        ("residual_after", place, (values - after).reshape(shape), "1", "measured less scaled and shifted simulated δ"),
        ("at_limit", (), found.at_limit, "", "at the limit of the search"),
        ("noise", (), of_noise, "1", "noise of δ"),
        ("points", (), int(used.sum()), "1", "positions"),
        ("left_out", (), int((np.isfinite(values) & ~there).sum()), "1", "positions outside the simulated map"),
        ("missing", (), int(np.isnan(values).sum()), "1", "positions without a value"),
        ("shift", ("axis",), list(found.shift), "m", "shift"),
        ("shift_std", ("axis",), list(found.shift_std), "m", "± shift"),
    ]
    for name, (value, deviation) in figures.items():
        words = name.replace("_", " ")
        rows += [(name, (), value, "1", words), (f"{name}_std", (), deviation, "1", f"± {words}")]
    return xr.Dataset(variables(*rows))


@dataclass(frozen=True, eq=False)
class Alignment:
    """Scale and shift of one map onto another, with deviations."""

    scale: float  # NaN if the other map is flat
    shift: tuple[float, float]  # along x and y in m, NaN without a search, 0 if its deviation exceeds the largest shift
    scale_std: float
    shift_std: tuple[float, float]
    used: BoolArray  # (places,)
    at_limit: bool  # whether a shift is at the end of the searched range
    scatter: float  # residual standard deviation of δ, NaN without degrees of freedom


def inside(model: ForwardModel, places: FloatArray, margin: tuple[float, float] = (0.0, 0.0)) -> BoolArray:
    """Test which places (n, 3) in m lie in a model's table."""
    # Rounding puts no place outside. The depth counts if the model has more than one.
    free = model.free
    room = np.array([*margin, 0.0])[free]
    slack = _ROUNDING * (model.upper - model.lower)[free]
    low, high = (model.lower[free] + room - slack), (model.upper[free] - room + slack)
    return np.asarray(((places[:, free] >= low) & (places[:, free] <= high)).all(axis=1))


def values_at(model: ForwardModel, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """δ (n,) of a state, and slopes (n, 2)."""
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
    """Fit a state's map onto values (n,).

    Places (n, 3) are x, y and depth in m. Only places are used that stay in the model's table under
    the `largest_shift` along x and y in m. With fewer than 8 such places no shift is searched. The
    standard deviations belong to this estimate with equal weights under the given noise of δ, by
    default the scatter of the residuals: (JᵀJ)⁻¹ Jᵀ diag(σ²) J (JᵀJ)⁻¹. They do not include other
    differences of the maps.
    """
    at, values = np.asarray(places, dtype=np.float64), np.asarray(measured, dtype=np.float64)
    sigma = None if noise is None else np.asarray(noise, dtype=np.float64)
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
    """Scale, shifts by the largest, deviations and residual scatter."""
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
    noise = (np.full(len(values), scatter) if sigma is None else sigma) / size
    jacobian = slopes(solution)
    deviations = np.full(jacobian.shape[1], np.nan)  # of unknowns that are not determined
    lengths = np.linalg.norm(jacobian, axis=0)
    known = np.flatnonzero(lengths > _FLAT * lengths.max())
    columns = jacobian[:, known] / lengths[known]
    if len(noise) >= len(known) and np.linalg.cond(columns) <= _CONDITION:
        gain = np.linalg.pinv(columns) / lengths[known, None]
        deviations[known] = np.sqrt((gain**2 * noise**2).sum(axis=1))
    return solution, deviations, scatter


def _rms(measured: FloatArray, other: FloatArray, noise: FloatArray) -> tuple[float, float]:
    """Root mean square of the difference, with deviation under noise."""
    # A residual r is misfit and noise: E r² = μ² + σ², var r² = 4μ²σ² + 2σ⁴, which r² estimates as 4r²σ² − 2σ⁴.
    remains = measured - other
    if not remains.size or not np.isfinite(remains).all():
        return np.nan, np.nan
    rms = float(np.sqrt(np.mean(remains**2)))
    least = float(2 * np.sum(noise**4))
    variance = max(float(4 * np.sum(remains**2 * noise**2)) - least, least)
    return rms, float(np.sqrt(variance)) / (2 * rms * remains.size) if rms else 0.0


def _correlation(measured: FloatArray, other: FloatArray, noise: FloatArray) -> tuple[float, float]:
    """Pearson's coefficient, with deviation as 1 − ρ like `_rms`²."""
    if measured.size < 2 or not np.isfinite(other).all():
        return np.nan, np.nan
    a, b = measured - measured.mean(), other - other.mean()
    long_a, long_b = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    if not long_a * long_b:
        return np.nan, np.nan
    a, b, spread = a / long_a, b / long_b, noise / long_a
    value = float(np.clip(a @ b, -1.0, 1.0))
    least = float(np.sum(spread**4)) / 2
    return value, float(np.sqrt(max(float(np.sum(((b - value * a) * spread) ** 2)) - least, least)))


def _noise(measured: xr.Dataset, simulated: xr.Dataset) -> FloatArray | None:
    """Deviation of measured minus simulated δ, None without noise."""
    own, other = (own_noise(data) for data in (measured, simulated))
    if own is None and other is None:
        return None
    level = 0.0 if other is None else np.sqrt(np.mean(other**2, axis=(0, 1, 2)))
    return np.hypot(0.0 if own is None else own, level) * np.ones(measured.delta.shape)


def own_noise(response: xr.Dataset) -> FloatArray | None:
    """Return the deviation of δ (depth, y, x, state)."""
    # ``delta_std``, with the attribute ``repeats`` that of the mean. A position without takes its state's value.
    if "delta_std" not in response:
        return None
    spread = response["delta_std"].broadcast_like(response["delta"]).transpose(*_DIMS).values.astype(np.float64)
    known = np.isfinite(spread)
    if not known.any():
        return None
    count = known.sum(axis=(0, 1, 2))
    spread = spread / np.sqrt(float(response.attrs.get("repeats", 1)))
    squares = np.where(known, spread, 0.0) ** 2
    level = np.where(count > 0, squares.sum(axis=(0, 1, 2)) / np.maximum(count, 1), squares.sum() / known.sum())
    return np.asarray(np.where(known, spread, np.sqrt(level)))


def _ellipses(
    measured: xr.Dataset, simulated: xr.Dataset, model: ForwardModel, progress: Progress | None
) -> xr.Dataset:
    x, y = measured.x.values, measured.y.values
    along = inside(model, np.column_stack((x, np.full_like(x, model.y[0]), np.full_like(x, model.depth[-1]))))
    across = inside(model, np.column_stack((np.full_like(y, model.x[0]), y, np.full_like(y, model.depth[-1]))))
    window = measured.isel(x=np.flatnonzero(along), y=np.flatnonzero(across))
    grid = np.meshgrid(window.depth.values, window.y.values, window.x.values, indexing="ij")
    points = np.clip(np.stack(grid[::-1], axis=-1), model.lower, model.upper)
    coords = {name: window[name] for name in _DIMS}
    coords |= {name: simulated[name] for name in ("coil", "coil_x", "coil_y") if name in simulated.coords}
    sampled = xr.Dataset({"delta": (_DIMS, model.linear(points)[0])}, coords)
    noise = own_noise(measured)
    cut = None if noise is None else noise[:, across][:, :, along]
    depths, states = range(window.sizes["depth"]), range(window.sizes["state"])
    done, total = itertools.count(1), len(SOURCES) * len(depths) * len(states)

    def fitted(response: xr.Dataset, sigma: FloatArray | None, k: int, j: int) -> xr.Dataset:
        found = level_curves(response.isel(depth=[k], state=[j]), None if sigma is None else sigma[k, ..., j])
        if progress is not None:
            progress(next(done), total)
        return found

    curves = [[[fitted(*side, k, j) for j in states] for k in depths] for side in ((window, cut), (sampled, None))]
    found = _combined(curves, "source", "depth", "state").transpose("source", "depth", "state", "level")
    return found.assign(ellipse_problem=found.ellipse_problem.astype(str))


def level_curves(response: xr.Dataset, noise: FloatArray | None = None) -> xr.Dataset:
    """Fit the ellipses of a map's levels, with deviations.

    `noise` (y, x) is the standard deviation of δ. `REPLICATES` copies with this noise give the
    deviations, NaN if less than half of them have the level. The copies add noise to a map that may
    already have it. Their scatter is still right if the noise is small compared with the width of a
    level. ``ellipse_problem`` is the reason why there are none.
    """

    def ellipses(shaken: xr.Dataset) -> tuple[xr.Dataset, FloatArray]:
        """Fit with x0, A and B, shape (3, levels)."""
        fits = fit_ellipses(shaken).isel(state=0)
        return fits, fits[[*PARAMETERS]].to_dataarray().values

    levels, values, undetermined, problem = np.empty(0), np.empty((3, 0)), np.empty(0, dtype=bool), ""
    try:
        if not np.isfinite(response.delta.values).all():
            raise LocalizeError("the map has gaps.")
        fits, values = ellipses(response)
        levels, undetermined = fits.level.values, fits.undetermined.values
    except LocalizeError as error:
        problem = str(error)
    runs = np.full((REPLICATES, *values.shape), np.nan)
    if noise is not None and not problem:
        sigma, random = xr.DataArray(noise, dims=("y", "x")), np.random.default_rng(0)
        for run in runs:
            shaken = response.assign(delta=response.delta + sigma * random.standard_normal(sigma.shape))
            try:
                noisy = ellipses(shaken)[1]
            except LocalizeError:  # the noise has removed the hill
                continue
            run[:, : noisy.shape[1]] = noisy[:, : values.shape[1]]
    known = np.isfinite(values) & (np.isfinite(runs).sum(axis=0) >= max(2, REPLICATES / 2))
    deviations = np.full_like(values, np.nan)
    deviations[known] = np.nanstd(runs[:, known], axis=0, ddof=1)
    data: dict[str, object] = {}
    described = ("centre of the ellipse", "semi-axis along x", "semi-axis along y")
    for name, text, value, deviation in zip(PARAMETERS, described, values, deviations, strict=True):
        data[name] = ("level", value, {"units": "m", "long_name": text})
        data[f"{name}_std"] = ("level", deviation, {"units": "m", "long_name": f"± {name}"})
    data["undetermined"] = ("level", undetermined, {"long_name": "the points do not determine the ellipse"})
    data["ellipse_problem"] = ((), problem, {"long_name": "why there is no ellipse"})
    return xr.Dataset(data, {"level": ("level", levels, {"units": "1", "long_name": "δ of the level"})})
