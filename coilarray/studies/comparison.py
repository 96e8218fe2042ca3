"""Comparison of a measured with a simulated response: scale, shift, residuals, ellipses.

Nothing is extrapolated. The simulated map is interpolated at the measured positions. Positions outside of it are left
out and counted. The ellipses of both come from the same positions with the same settings, since window and spacing of a
map affect them (`coilarray.paper.ellipse`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.compute.arrays import BoolArray, FloatArray
from coilarray.compute.threads import Progress
from coilarray.errors import LocalizeError
from coilarray.localize.forward import ForwardModel, forward_model
from coilarray.paper.ellipse import PARAMETERS, STEP, fit_ellipses
from coilarray.response.dataset import RESPONSE
from coilarray.studies.alignment import align, inside, values_at

SOURCES = ("measured", "simulated")
"""Labels of the dimension ``source``."""

REPLICATES = 16
"""Number of noisy maps for the standard deviations of the ellipses, which are then known to 18 %."""

_LEAST_SHARE = 0.5  # of the noisy maps: if fewer have a level, its scatter is NaN
_DIMS = ("depth", "y", "x", "state")
_LEAST_FOR_SHIFT = 4  # measured positions along an axis
_SAME_DEPTH = 1e-6  # relative
_Compared = dict[str, Any]
"""Figures of one state at one depth by the names of the dataset. Maps have the shape (y, x)."""


def compare_responses(
    measured: xr.Dataset,
    simulated: xr.Dataset,
    *,
    largest_shift: float | None = None,
    replicates: int = REPLICATES,
    seed: int = 0,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compare a measured response with a simulated one.

    Parameters
    ----------
    measured : xarray.Dataset
        Response with ``delta`` (depth, y, x, state) and coordinates in m, NaN where a position was not measured. If it
        has ``delta_std``, the standard deviation of δ, this is the noise. If the attribute ``repeats`` gives the number
        of readings in a mean δ, ``delta_std`` is for a single reading.
    simulated : xarray.Dataset
        Response without NaN, at least four x and four y. It may be another measured response, whose ``delta_std`` is
        then added to the noise.
    largest_shift : float, optional
        Largest shift of the search, in m. By default the measured map's own spacing along each axis. Shifts are
        searched with the positions that are in the simulated map by this much, so let it be larger than the measured
        map.
    replicates : int
        Number of noisy maps for the standard deviations of the ellipses, if there is ``delta_std``. 0 for no standard
        deviations.
    seed : int
        Seed of their noise.
    progress : callable, optional
        Called with (done, total).

    Returns
    -------
    xarray.Dataset
        Comparison of the common states and depths at the positions that both have: dimensions ``depth``, ``y``, ``x``,
        ``state``, ``axis`` (x, y), ``source`` (measured, simulated) and ``level``. NaN for unknown values.

        - ``delta`` (source, depth, y, x, state)
        - ``residual_before`` and ``residual_after`` (depth, y, x, state): measured minus simulated, as it is, and
          scaled and shifted
        - ``base_inductance`` (source, state): in H, if both have it

        For every depth and state

        - ``scale`` and, with an axis, ``shift`` in m, which bring the simulated map onto the measured map
        - ``at_limit``: whether the best shift is beyond the largest shift
        - ``rms_before``, ``rms_after``, ``correlation_before`` and ``correlation_after``
        - the standard deviation of each of these, whose name ends in ``_std``
        - ``noise``: its level in δ if it is known
        - ``points``: the number of positions

        For the ellipse of every level of δ (source, depth, state, level)

        - ``x0``, ``A`` and ``B`` in m, and their standard deviations, whose names end in ``_std``
        - ``undetermined``: whether the points of the level do not determine its ellipse
        - ``ellipse_problem`` (source, depth, state): why there are no ellipses

        Attributes: ``only_measured`` and ``only_simulated`` are states of a single response. ``depths_left_out`` in m
        and ``points_left_out`` were measured but are not in the simulated map. ``points_missing`` were not measured.
        ``noise_from`` is "delta_std" or "residuals". The attributes of both are kept as ``measured_…`` and
        ``simulated_…``.

    Raises
    ------
    LocalizeError
        Datasets that are not responses, no common state, depth or position, largest shift or replicates that are
        negative.

    Notes
    -----
    The standard deviations of scale, shift, rms and correlation are the effect of the noise of the readings on them, to
    first order. If no noise is known, it is taken from the scatter of the residuals of the fit. Noise of the simulated
    side (a second measurement) also biases the scale towards zero, by noise² over the mean square of its map.

    Examples
    --------
    >>> from coilarray.paper.published import published_map
    >>> simulated = published_map()
    >>> found = compare_responses(simulated.assign(delta=1.1 * simulated.delta), simulated)
    >>> found.scale.round(6).values.tolist(), float(abs(found["shift"]).max().round(9))
    ([[1.1, 1.1, 1.1]], 0.0)
    """
    if replicates < 0:
        raise LocalizeError(f"replicates must not be negative; got {replicates}.")
    reads = _measured(measured)
    simulated = RESPONSE.checked(simulated, "a simulated response")
    states, alone = _common_states(reads, simulated)
    model = forward_model(simulated).select(states)
    kept, depths_out = _common_depths(reads.sel(state=states), model)
    noise = _noise(kept, simulated.sel(state=states))
    largest_shifts = _largest_shifts(kept, largest_shift)

    def compared(k: int, j: int) -> _Compared:
        level = None if noise is None else noise[k, ..., j]
        return _compared(kept.isel(depth=k, state=j), model.select([states[j]]), level, largest_shifts)

    rows = [[compared(k, j) for j in range(len(states))] for k in range(kept.sizes["depth"])]
    if not any(one["points"] for row in rows for one in row):
        raise LocalizeError("no measured position is in the simulated map.")
    count, total = 0, 2 * kept.sizes["depth"] * len(states)

    def fit(response: xr.Dataset, own: FloatArray | None) -> LevelCurves:
        """Fit level curves, with a common seed."""
        nonlocal count
        curves = level_curves(response, own, replicates=replicates, seed=seed)
        count += 1
        if progress is not None:
            progress(count, total)
        return curves

    windows = _windows(kept, simulated, model, own_noise(kept))
    result = _dataset(kept, simulated, rows, _ellipses(windows, fit))
    known = "residuals" if noise is None else "delta_std"
    return result.assign_attrs({**alone, "depths_left_out": depths_out, "noise_from": known})


def _compared(
    measured: xr.Dataset, model: ForwardModel, sigma: FloatArray | None, largest_shift: tuple[float, float]
) -> _Compared:
    """Compare a map (y, x) with the model of its state; `sigma` is the noise of both together."""
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
    figures: _Compared = {
        "simulated": before.reshape(shape),
        "residual_before": (values - before).reshape(shape),
        "residual_after": (values - after).reshape(shape),
        "noise": float(np.sqrt(np.mean(given[used] ** 2))) if given is not None and used.any() else np.nan,
        "points": int(used.sum()),
        "left_out": int((np.isfinite(values) & ~there).sum()),
        "missing": int(np.isnan(values).sum()),
    }
    figures |= {name: getattr(found, name) for name in ("scale", "scale_std", "shift", "shift_std", "at_limit")}
    read, spread = values[used], noise[used]
    pairs = {
        "rms_before": _rms(read, before[used], spread),
        "correlation_before": _correlation(read, before[used], spread),
        "rms_after": _rms(read, after[used], spread),
        "correlation_after": _correlation(read, shifted[used], spread),
    }
    for name, pair in pairs.items():
        figures[name], figures[f"{name}_std"] = pair
    return figures


def _rms(measured: FloatArray, other: FloatArray, noise: FloatArray) -> tuple[float, float]:
    """Root mean square of the difference, with standard deviation.

    The standard deviation is under noise. A residual r is misfit and noise, E r² = μ² + σ² and var r² = 4μ²σ² + 2σ⁴,
    which r² estimates as 4r²σ² − 2σ⁴.
    """
    remains = measured - other
    if not remains.size or not np.isfinite(remains).all():
        return np.nan, np.nan
    rms = float(np.sqrt(np.mean(remains**2)))
    least = float(2 * np.sum(noise**4))
    variance = max(float(4 * np.sum(remains**2 * noise**2)) - least, least)
    return rms, float(np.sqrt(variance)) / (2 * rms * remains.size) if rms else 0.0


def _correlation(measured: FloatArray, other: FloatArray, noise: FloatArray) -> tuple[float, float]:
    """Pearson's coefficient and its deviation under noise, with 1 − ρ treated as rms² above."""
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


def _windows(
    measured: xr.Dataset, simulated: xr.Dataset, model: ForwardModel, noise: FloatArray | None
) -> tuple[tuple[xr.Dataset, FloatArray | None], ...]:
    """Both maps at the measured positions that are in the simulated map, with their noise."""
    x, y = measured.x.values, measured.y.values
    along = inside(model, np.column_stack((x, np.full_like(x, model.y[0]), np.full_like(x, model.depth[-1]))))
    across = inside(model, np.column_stack((np.full_like(y, model.x[0]), y, np.full_like(y, model.depth[-1]))))
    window = measured.isel(x=np.flatnonzero(along), y=np.flatnonzero(across))
    grid = np.meshgrid(window.depth.values, window.y.values, window.x.values, indexing="ij")
    points = np.clip(np.stack(grid[::-1], axis=-1), model.lower, model.upper)
    sampled = xr.Dataset({"delta": (_DIMS, model.linear(points)[0])}, {name: window[name] for name in _DIMS})
    places = {name: simulated[name] for name in ("coil", "coil_x", "coil_y") if name in simulated.coords}
    cut = None if noise is None else noise[:, across][:, :, along]
    return (window, cut), (sampled.assign_coords(places), None)


def _ellipses(windows: Sequence[tuple[xr.Dataset, FloatArray | None]], fit: Callable[..., LevelCurves]) -> xr.Dataset:
    """Ellipses of every level of both maps. The dimensions are source, depth, state, level."""
    dims = ("source", "depth", "state")
    shape = (len(windows), *(windows[0][0].sizes[name] for name in dims[1:]))
    curves = {}
    for side, k, j in np.ndindex(shape):
        response, noise = windows[side]
        curves[side, k, j] = fit(response.isel(depth=[k], state=[j]), None if noise is None else noise[k, ..., j])
    count = max(one.values.shape[1] for one in curves.values())
    values, deviations = (np.full((3, *shape, count), np.nan) for _ in range(2))
    undetermined = np.zeros((*shape, count), dtype=bool)
    problems = np.empty(shape, dtype=object)
    for place, one in curves.items():
        reached = one.values.shape[1]
        values[(slice(None), *place, slice(reached))] = one.values
        deviations[(slice(None), *place, slice(reached))] = one.deviations
        undetermined[(*place, slice(reached))] = one.undetermined
        problems[place] = one.problem
    described = dict(zip(PARAMETERS, ("centre of the ellipse", "semi-axis along x", "semi-axis along y"), strict=True))
    data: dict[str, object] = {}
    for k, (name, text) in enumerate(described.items()):
        data[name] = ((*dims, "level"), values[k], {"units": "m", "long_name": text})
        data[f"{name}_std"] = ((*dims, "level"), deviations[k], {"units": "m", "long_name": f"± {name}"})
    data["undetermined"] = ((*dims, "level"), undetermined, {"long_name": "the points do not determine the ellipse"})
    data["ellipse_problem"] = (dims, problems.astype(str), {"long_name": "why there is no ellipse"})
    return xr.Dataset(data, {"level": ("level", level_axis(count), {"units": "1", "long_name": "δ of the level"})})


def _measured(response: xr.Dataset) -> xr.Dataset:
    """Check a response that may have gaps. Its dimensions are put in the common order."""
    return RESPONSE.checked(response, "a measured response").transpose(*_DIMS, ...)


def _common_states(measured: xr.Dataset, simulated: xr.Dataset) -> tuple[list[str], dict[str, str]]:
    """States of both responses and states of only one. The common states are in the measured order."""
    first, second = ([str(name) for name in data["state"].values] for data in (measured, simulated))
    common = [name for name in first if name in second]
    if not common:
        raise LocalizeError(
            f"the two responses have no state in common: measured {', '.join(first)}; simulated {', '.join(second)}."
        )
    alone = {
        "only_measured": [name for name in first if name not in second],
        "only_simulated": [name for name in second if name not in first],
    }
    return common, {key: ", ".join(names) for key, names in alone.items()}


def _common_depths(measured: xr.Dataset, model: ForwardModel) -> tuple[xr.Dataset, str]:
    """Keep the measured depths that are in the simulated map; also list the other depths in m."""
    depths = measured.depth.values
    if len(model.depth) > 1:
        slack = _SAME_DEPTH * model.depth[-1]
        there = (depths >= model.depth[0] - slack) & (depths <= model.depth[-1] + slack)
    else:
        there = np.isclose(depths, model.depth[0], rtol=_SAME_DEPTH, atol=0)
    if not there.any():
        listed, known = (", ".join(f"{value * 1e3:.4g}" for value in values) for values in (depths, model.depth))
        raise LocalizeError(f"the two responses have no depth in common: measured {listed} mm; simulated {known} mm.")
    return measured.isel(depth=np.flatnonzero(there)), ", ".join(f"{value:.6g}" for value in depths[~there])


def _noise(measured: xr.Dataset, simulated: xr.Dataset) -> FloatArray | None:
    """Return the deviation of measured minus simulated δ (depth, y, x, state); None without any noise."""
    own, other = (own_noise(data) for data in (measured, simulated))
    if own is None and other is None:
        return None
    level = 0.0 if other is None else np.sqrt(np.mean(other**2, axis=(0, 1, 2)))
    return np.hypot(0.0 if own is None else own, level) * np.ones(measured.delta.shape)


def own_noise(response: xr.Dataset) -> FloatArray | None:
    """Return the standard deviation of δ (depth, y, x, state).

    A position without a value takes the value of its state. It is ``delta_std``, or with the attribute ``repeats`` the
    standard deviation of the mean. None if the response does not have it.
    """
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


def _largest_shifts(measured: xr.Dataset, largest_shift: float | None) -> tuple[float, float]:
    """Largest shift along x and y in m. It is 0 along an axis with too few positions."""
    if largest_shift is not None and not (np.isfinite(largest_shift) and largest_shift >= 0):
        raise LocalizeError(f"largest_shift must be finite and not negative; got {largest_shift} m.")
    found = []
    for name in ("x", "y"):
        axis = measured[name].values
        few = len(axis) < _LEAST_FOR_SHIFT
        found.append(0.0 if few else float(np.median(np.diff(axis))) if largest_shift is None else largest_shift)
    return found[0], found[1]


def _dataset(
    measured: xr.Dataset, simulated: xr.Dataset, rows: list[list[_Compared]], ellipses: xr.Dataset
) -> xr.Dataset:
    """Dataset of all figures of the comparison."""

    def stacked(name: str) -> npt.NDArray[np.generic]:
        return np.array([[one[name] for one in row] for row in rows])

    def maps(name: str) -> FloatArray:
        return np.moveaxis(stacked(name).astype(np.float64), 1, -1)  # depth, y, x, state

    both = ("depth", "state")
    one = {"units": "1"}
    data: dict[str, object] = {
        "delta": (("source", *_DIMS), np.stack([measured.delta.values, maps("simulated")]), one),
        "residual_before": (_DIMS, maps("residual_before"), {**one, "long_name": "measured less simulated δ"}),
        "residual_after": (
            _DIMS,
            maps("residual_after"),
            {**one, "long_name": "measured less scaled and shifted simulated δ"},
        ),
        "at_limit": (both, stacked("at_limit"), {"long_name": "at the limit of the search"}),
        "noise": (both, stacked("noise"), {**one, "long_name": "noise of δ"}),
        "points": (both, stacked("points"), {**one, "long_name": "positions"}),
    }
    for name in ("scale", "rms_before", "rms_after", "correlation_before", "correlation_after"):
        text = name.replace("_", " ")
        data[name] = (both, stacked(name), {**one, "long_name": text})
        data[f"{name}_std"] = (both, stacked(f"{name}_std"), {**one, "long_name": f"± {text}"})
    for name, text in (("shift", "shift"), ("shift_std", "± shift")):
        data[name] = ((*both, "axis"), stacked(name), {"units": "m", "long_name": text})
    if "base_inductance" in measured and "base_inductance" in simulated:
        states = measured.state.values
        pair = [side.base_inductance.sel(state=states).values for side in (measured, simulated)]
        data["base_inductance"] = (("source", "state"), np.array(pair), {"units": "H", "long_name": "L_0"})
    coords = {name: measured[name] for name in _DIMS}
    for name in ("depth", "y", "x"):  # a response of other programs may not have them
        coords[name] = coords[name].assign_attrs({"long_name": name, **measured[name].attrs, "units": "m"})
    places = {name: simulated[name] for name in ("coil", "coil_x", "coil_y") if name in simulated.coords}
    result = xr.Dataset(data, {**coords, **places, "source": list(SOURCES), "axis": ["x", "y"]})
    said = {
        f"{who}_{key}": value
        for who, of in zip(SOURCES, (measured, simulated), strict=True)
        for key, value in of.attrs.items()
    }
    counts = {f"points_{name}": sum(one[name] for row in rows for one in row) for name in ("left_out", "missing")}
    return result.merge(ellipses).assign_attrs({**said, **counts})


@dataclass(frozen=True, eq=False)
class LevelCurves:
    """Ellipses of the levels STEP, 2·STEP, … of δ.

    They are for one state at one depth. `values` and `deviations`, shape (3, levels), are x0, A and B in m and their
    standard deviations. They are NaN if a level has no ellipse, and the deviations are also NaN if no noise is known.
    `undetermined`, shape (levels,), marks the levels whose points do not determine the ellipse, see
    `coilarray.paper.ellipse`. `problem` is the reason why there is no ellipse at all, empty if there are some.
    """

    values: FloatArray
    deviations: FloatArray
    undetermined: BoolArray
    problem: str = ""


def level_curves(
    response: xr.Dataset, noise: npt.ArrayLike | None = None, *, replicates: int = REPLICATES, seed: int = 0
) -> LevelCurves:
    """Fit the ellipses of a map and of noisy copies.

    The map has one depth and one state. The copies give the standard deviations. `fit_ellipses` is used with its own
    settings. `noise`, shape (y, x), is the standard deviation of δ. Fewer than 2 `replicates` give no standard
    deviations. The copies add noise to a map that may already have it. Their scatter is still right if the noise is
    small compared with the width of a level.
    """
    try:
        if not np.isfinite(response.delta.values).all():
            raise LocalizeError("the map has gaps.")
        fits = fit_ellipses(response).isel(state=0)
    except LocalizeError as error:
        return LevelCurves(np.empty((3, 0)), np.empty((3, 0)), np.empty(0, dtype=bool), str(error))
    values, undetermined = _parameters(fits), fits.undetermined.values
    unknown = np.full_like(values, np.nan)
    if noise is None or replicates < 2:
        return LevelCurves(values, unknown, undetermined)
    sigma = xr.DataArray(np.asarray(noise, dtype=np.float64), dims=("y", "x"))
    random = np.random.default_rng(seed)
    runs = np.full((replicates, *values.shape), np.nan)
    for run in runs:
        try:
            shaken = response.assign(delta=response.delta + sigma * random.standard_normal(sigma.shape))
            noisy = _parameters(fit_ellipses(shaken).isel(state=0))
        except LocalizeError:  # the noise has removed the hill
            continue
        run[:, : noisy.shape[1]] = noisy[:, : values.shape[1]]
    count = np.isfinite(runs).sum(axis=0)
    known = np.isfinite(values) & (count >= max(2.0, _LEAST_SHARE * replicates))
    mean = np.nansum(runs, axis=0) / np.maximum(count, 1)
    scatter = np.sqrt(np.nansum((runs - mean) ** 2, axis=0) / np.maximum(count - 1, 1))
    return LevelCurves(values, np.where(known, scatter, unknown), undetermined)


def level_axis(count: int) -> FloatArray:
    """Return the δ of the first `count` levels."""
    return np.asarray(STEP * np.arange(1, count + 1), dtype=np.float64)


def _parameters(fits: xr.Dataset) -> FloatArray:
    """x0, A and B, shape (3, levels)."""
    return fits[[*PARAMETERS]].to_dataarray().values
