"""Causes of the motion of a fitted centre with δ.

The computed maps are processed as in the paper, with each cause switched off in turn. Nothing here
is fitted to x0. The effect of a cause is the part that x0 loses if the cause is switched off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.coupling import provenance
from coilarray.compute.arrays import FloatArray
from coilarray.compute.netcdf import Entry, Schema
from coilarray.compute.threads import Progress
from coilarray.design.model import Design
from coilarray.design.scan_states import Passive, ScanState
from coilarray.errors import LocalizeError
from coilarray.geometry import MATERIALS, Conductor, Hemisphere
from coilarray.paper.ellipse import PARAMETERS, fit_ellipses, refined_map
from coilarray.paper.ellipse_model import published_model, undetermined_levels
from coilarray.response.map import Imperfections, inductance_changes, respond, response_map
from coilarray.response.setup import indentation_of, map_axes

DELTAS = np.arange(1e-4, 1.0e-3 + 1e-6, 2.5e-5)
"""δ at which x0 is compared, in the range where the paper's polynomials were fitted."""
TILT = 35e-6 / 100e-3  # the paper's vertical deviation of an axis, 35 µm in 100 mm, taken as a tilt along x
_WIDE = (18e-3, 12e-3)  # the wide window is larger by this on each side, along x and y
_FINE = 2  # parts of the grid's step
_SEEDS = 8
_BALLS = ("steel", "aluminium", "ferrite")  # materials that a hemisphere may have
_OF_LEVELS = ("neighbours", "state", "delta")
_METRES = Entry("m", _OF_LEVELS, needed=True, gaps=True)
_PUBLISHED = Entry("m", _OF_LEVELS[1:], needed=True, gaps=True)
DISTORTION = Schema(
    LocalizeError, "effects and ellipses over cause, neighbours, state and delta",
    {
        "effect": Entry("m", ("cause", "state", "delta"), needed=True, gaps=True),
        "rms": Entry("m", ("cause", "state"), needed=True, gaps=True),
        "rms_residual": Entry("m", ("state",), needed=True, gaps=True),
        "centre": Entry("m", ("state",), needed=True),
        **dict.fromkeys(PARAMETERS, _METRES),
        **{f"published_{name}": _PUBLISHED for name in PARAMETERS},
        "undetermined": Entry("", _OF_LEVELS, needed=True, flag=True),
        "published_undetermined": Entry("", _OF_LEVELS[1:], needed=True, flag=True),
        "neighbours": Entry(None, ("neighbours",), needed=True, names=("grounded", "open")),
        "state": Entry(None, ("state",), needed=True),
        "delta": Entry("1", ("delta",), needed=True),
        "cause": Entry(None, ("cause",), needed=True),
        "x0_std": replace(_METRES, needed=False),
        "effect_std": Entry("m", ("cause", "state", "delta"), gaps=True),
        "rms_std": Entry("m", ("cause", "state"), gaps=True),
        **{f"indenter_{name}": replace(_METRES, dims=("indenter", *_OF_LEVELS[1:])) for name in PARAMETERS},
        "indenter_peak": Entry("1", ("indenter", "state"), needed=True),
        "indenter": Entry(None, ("indenter",), needed=True, names=("without",)),
    },
    together=(("x0_std", "effect_std", "rms_std"),),
)  # fmt: skip
"""Schema of the result of `distortion` when it is read from a file."""


@dataclass(frozen=True, eq=False)
class EllipseCurves:
    """Ellipse parameters x0, A and B over δ, (states, deltas) in m.

    They are NaN if the map has no such level. `undetermined` marks levels whose points do not
    determine the ellipse.
    """

    x0: FloatArray
    A: FloatArray
    B: FloatArray
    undetermined: npt.NDArray[np.bool_]

    @property
    def determined_x0(self) -> FloatArray:
        """x0 if the points determine it, else NaN."""
        return np.where(self.undetermined, np.nan, self.x0)


def distortion(
    design: Design,
    states: Sequence[str] = ("coil1", "coil2", "coil3"),
    deltas: npt.ArrayLike = DELTAS,
    *,
    imperfections: Imperfections | None = None,
    draws: Sequence[tuple[Design, Imperfections]] = (),
    progress: Progress | None = None,
) -> xr.Dataset:
    """Predict x0(δ), A(δ), B(δ) and the causes of their distortion.

    The first depth and the grid of the design's indentation are used. `states` are states of the
    scan, each named after its coil, and `deltas` (n,) rising levels of δ. `imperfections` are
    deviations of the experiment in every map. `draws`, none or at least two, are other possible
    designs, as `coilarray.studies.calibrate.calibration.posterior_draws` returns them. Their
    scatter is the error of x0 and of the effect of the neighbours.

    The result has the variables of `DISTORTION`. The neighbours are ``grounded`` (as in the
    design's scan) and ``open``. Published values are from Table A1. ``effect`` is the part of x0
    that is lost without the cause. An indenter is ``without`` a material, or of steel, aluminium or
    ferrite. ``indenter_peak`` is the largest δ of its map. Values are NaN at levels that a map does
    not reach. Effects and root mean squares leave undetermined levels out.

    The causes are ``all neighbours`` and each neighbour (opened), ``window`` (18 and 12 mm wider,
    as far as the sample reaches), ``grid`` (half the step), ``ellipse`` (fitted centre minus the
    middle of the level curve on y = 0, on the wide and fine map), ``winding and leads`` (each coil
    averaged with itself turned by half a turn), ``layers`` (all coils at one height), ``tilt`` and
    ``noise``. Tilt and noise are switched on, since the computed map has neither. The effect of
    noise is the standard deviation of x0 for the design's noise budget: each coil's own noise of δ,
    the attribute ``noise``, and the common noise, once a map. Materials of the indenter are also
    switched on, if it is a hemisphere without a material: eddy currents and magnetisation of a
    ball, with L_0 read as it just touches the sheets.
    """
    names = design.array.names
    for state in states:
        if state not in names or state not in [s.name for s in design.plan]:
            raise LocalizeError(f"a state must be measured and named after its coil; got {state!r}.")
    if len(draws) == 1:
        raise LocalizeError("draws must be 0 or at least 2; got 1.")
    levels = np.asarray(deltas, dtype=np.float64)
    given = imperfections or Imperfections()
    maps = _Maps(design, given, progress, len(draws))
    base = maps.plain()
    curves = ellipse_curves(base, states, levels)

    def without(response: xr.Dataset) -> FloatArray:
        """Part of x0 that is lost in another map."""
        return curves.determined_x0 - ellipse_curves(response, states, levels).determined_x0

    opened = ellipse_curves(_opened(design, base, names), states, levels)
    effects = {"all neighbours": curves.determined_x0 - opened.determined_x0}
    effects |= {f"neighbour {name}": without(_opened(design, base, (name,))) for name in names}
    both = maps.plain(widen=_WIDE, parts=_FINE)
    effects["window"] = without(maps.plain(widen=_WIDE))
    effects["grid"] = without(maps.plain(parts=_FINE))
    effects["ellipse"] = ellipse_curves(both, states, levels).determined_x0 - _middles(both, states, levels)
    effects["winding and leads"] = without(maps.turned(base))
    effects["layers"] = without(maps.levelled(base))
    tilted = replace(given, tilt=(given.tilt[0] + TILT, given.tilt[1]))
    effects["tilt"] = -without(_Maps(design, tilted, maps.count).plain())
    effects["noise"] = _scatter(base, states, levels)
    solid = maps.of_materials(base)
    of_balls = {name: ellipse_curves(response, states, levels) for name, response in solid.items()}
    effects |= {f"indenter of {name}": one.determined_x0 - curves.determined_x0 for name, one in of_balls.items()}
    result = _dataset(design, states, levels, curves, opened, effects).assign_attrs(noise=base.attrs["noise"])
    dims, kinds = ("indenter", "state", "delta"), {"without": curves, **of_balls}
    for name in PARAMETERS:
        values = [np.where(one.undetermined, np.nan, getattr(one, name)) for one in kinds.values()]
        result[f"indenter_{name}"] = (dims, np.array(values), {"units": "m"})
    peaks = [one.delta.isel(depth=0).sel(state=list(states)).max(("x", "y")) for one in (base, *solid.values())]
    result["indenter_peak"] = (dims[:2], np.array(peaks), {"units": "1"})
    result = result.assign_coords(indenter=list(kinds))
    if not draws:
        return result
    drawn = []
    for one, errors in draws:
        response = _Maps(one, errors, maps.count).plain()
        pair = (response, _opened(one, response, names))
        drawn.append([ellipse_curves(each, states, levels).determined_x0 for each in pair])
    return result.assign(_errors(result, np.array(drawn)))


def _errors(result: xr.Dataset, drawn: FloatArray) -> dict[str, xr.DataArray]:
    """Deviations of x0 over draws, (draw, 2, state, delta): grounded and open neighbours."""
    effect, rms = np.full(result.effect.shape, np.nan), np.full(result.rms.shape, np.nan)
    neighbours = drawn[:, 0] - drawn[:, 1]
    effect[0], rms[0] = neighbours.std(axis=0, ddof=1), _rms(neighbours).std(axis=0, ddof=1)
    found = {"x0": drawn.std(axis=0, ddof=1), "effect": effect, "rms": rms}
    return {f"{name}_std": result[name].copy(data=values) for name, values in found.items()}


class _Maps:
    """Maps of a design on several grids, counted for progress."""

    def __init__(self, design: Design, imperfections: Imperfections, progress: Progress | None, draws: int = 0) -> None:
        self._design, self._imperfections = design, imperfections
        self._progress, self._done, self._total = progress, 0, 7 + draws

    def count(self, done: int = 1, total: int = 1) -> None:
        if done == total:
            self._done += 1
            if self._progress is not None:
                self._progress(self._done, self._total)

    def plain(self, widen: tuple[float, float] = (0.0, 0.0), parts: int = 1) -> xr.Dataset:
        """Compute the map of the first depth.

        The window is wider by `widen` in m on each side, up to the sample's edges.
        """
        setup = indentation_of(self._design).in_ellipse_window()
        x, y = (_axis(given, more, parts) for given, more in zip((setup.x, setup.y), widen, strict=True))
        depths, given = setup.depths[:1], self._imperfections
        if any(widen):
            x, y = (
                axis[(axis >= low) & (axis <= high)]
                for axis, low, high in zip((x, y), *setup.reachable(depths[0]), strict=True)
            )
        return response_map(self._design, depths=depths, x=x, y=y, imperfections=given, progress=self.count)

    def turned(self, base: xr.Dataset) -> xr.Dataset:
        """Average every coil with itself turned by half a turn."""
        paths = self._design.array.conductors()
        about = zip(paths, self._design.array.centres, strict=True)
        turned = [_placed(path, path.vertices * [-1.0, -1.0, 1.0] + [*(2 * centre), 0.0]) for path, centre in about]
        change = self._change(base, [*paths, *turned])
        n = len(paths)
        mean = sum(change[..., i : i + n, j : j + n] for i in (0, n) for j in (0, n)) / 4
        return respond(self._design, base, inductance_change=np.asarray(mean))

    def levelled(self, base: xr.Dataset) -> xr.Dataset:
        """Put all coils at the mean height of their copper."""
        paths = self._design.array.conductors()
        heights = np.array([(path.vertices[:, 2].max() + path.vertices[:, 2].min()) / 2 for path in paths])
        rises = zip(paths, heights.mean() - heights, strict=True)
        level = [_placed(path, np.add(path.vertices, [0.0, 0.0, rise])) for path, rise in rises]
        return respond(self._design, base, inductance_change=self._change(base, level))

    def of_materials(self, base: xr.Dataset) -> dict[str, xr.Dataset]:
        """Compute maps with metal and ferrite balls as indenter, if any."""
        setup = indentation_of(self._design)
        if setup.material is not None or not isinstance(setup.indenter, Hemisphere):
            return {}
        at, given = {"depths": base.depth, "x": base.x, "y": base.y}, self._imperfections
        solid = {name: replace(setup, material=MATERIALS[name]) for name in _BALLS}
        return {
            name: response_map(replace(self._design, indentation=one), **at, imperfections=given)
            for name, one in solid.items()
        }

    def _change(self, base: xr.Dataset, paths: Sequence[Conductor]) -> FloatArray:
        """Change of the inductances in H with other paths."""
        axes = map_axes(self._design, base.depth, base.x, base.y)
        frequency = base.attrs.get("metal_frequency_Hz")
        change = inductance_changes(
            self._design, axes, paths=paths, imperfections=self._imperfections, frequency=frequency
        )
        self.count()
        return change


def _axis(given: Sequence[float], more: float, parts: int) -> FloatArray:
    """Extend the positions on both sides and divide their step."""
    axis = np.asarray(given)
    if len(axis) < 2:
        return axis
    step = (axis[-1] - axis[0]) / (len(axis) - 1)
    beyond = round(more / step)
    count = (len(axis) - 1 + 2 * beyond) * parts + 1
    return np.linspace(axis[0] - beyond * step, axis[-1] + beyond * step, count)


def _placed(path: Conductor, vertices: FloatArray) -> Conductor:
    return Conductor(vertices, path.widths, path.thicknesses, path.areas, path.name)


def _opened(design: Design, base: xr.Dataset, names: Sequence[str]) -> xr.Dataset:
    """Open some coils wherever they are not measured."""
    opened: Passive = "open"

    def state(given: ScanState) -> ScanState:
        measured = {name for name, _ in given.measured}
        return replace(given, exceptions={**given.exceptions, **{n: opened for n in names if n not in measured}})

    return respond(design, base, plan=[state(given) for given in design.plan])


def ellipse_curves(response: xr.Dataset, states: Sequence[str], levels: FloatArray) -> EllipseCurves:
    """Fit the ellipses of the first depth at levels, linear between."""
    fits = fit_ellipses(response, states=states)
    curves = np.full((len(PARAMETERS), len(states), len(levels)), np.nan)
    undetermined = np.zeros((len(states), len(levels)), dtype=bool)
    for j, state in enumerate(states):
        kept = fits.sel(state=state).isel(step=np.flatnonzero(fits.refused.sel(state=state) == "")).sortby("delta")
        for k, name in enumerate(PARAMETERS):
            curves[k, j] = np.interp(levels, kept.delta, kept[name], left=np.nan, right=np.nan)
        undetermined[j] = np.interp(levels, kept.delta, kept.undetermined) > 0  # one of the two neighbouring steps is
    x0, A, B = curves
    return EllipseCurves(x0, A, B, undetermined & np.isfinite(x0))


def _middles(response: xr.Dataset, states: Sequence[str], levels: FloatArray) -> FloatArray:
    """Middle in m of a hill's two crossings of a level on y = 0."""
    middles = np.full((len(states), len(levels)), np.nan)
    for row, state in enumerate(states):
        fine = refined_map(response.delta.isel(depth=0).sel(state=state))
        line = fine.sel(y=0.0, method="nearest").values
        x, top = fine.x.values, int(np.argmax(line))
        for k, level in enumerate(levels):
            below = np.flatnonzero(line < level)
            left, right = below[below < top], below[below > top]
            if line[top] > level and len(left) and len(right):
                edges = [
                    np.interp(level, line[[outer, inner]], x[[outer, inner]])
                    for outer, inner in ((left[-1], left[-1] + 1), (right[0], right[0] - 1))
                ]
                middles[row, k] = sum(edges) / 2
    return middles


def _scatter(base: xr.Dataset, states: Sequence[str], levels: FloatArray) -> FloatArray:
    """Scatter of x0 in m over seeded maps with noise.

    Common noise is drawn once per map, as L_0 is read once. It shifts the level of a whole map.
    """
    runs = []
    for seed in range(_SEEDS):
        random = np.random.default_rng(seed)
        delta = base.delta + base.attrs["noise"] * random.standard_normal(base.delta.shape)
        if "common_noise" in base:
            drawn = xr.DataArray(random.standard_normal(base.sizes["drift_cause"]), dims="drift_cause")
            delta = delta + (base.common_noise * drawn).sum("drift_cause")
        runs.append(ellipse_curves(base.assign(delta=delta), states, levels).determined_x0)
    return np.asarray(np.std(runs, axis=0, ddof=1))


def _dataset(
    design: Design,
    states: Sequence[str],
    levels: FloatArray,
    grounded: EllipseCurves,
    opened: EllipseCurves,
    effects: dict[str, FloatArray],
) -> xr.Dataset:
    origin = indentation_of(design).origin_point
    centre = np.array([design.array.centres[design.array.names.index(state)][0] - origin[0] for state in states])
    dims, metres = ("state", "delta"), {"units": "m"}
    published, effect = _published(states, levels), np.array(list(effects.values()))
    data: dict[str, object] = {}
    for name in (*PARAMETERS, "undetermined"):
        told = {"long_name": "the window does not determine the ellipse"} if name == "undetermined" else metres
        data[name] = (("neighbours", *dims), np.array([getattr(grounded, name), getattr(opened, name)]), told)
        data[f"published_{name}"] = (dims, getattr(published, name), told)
    residual = grounded.determined_x0 - published.determined_x0
    data["effect"] = (("cause", *dims), effect, {**metres, "long_name": "what x0 loses without the cause"})
    data["rms"] = (("cause", "state"), _rms(effect), metres)
    data["rms_residual"] = ("state", _rms(residual), {**metres, "long_name": "predicted less published x0, rms"})
    data["centre"] = ("state", centre, {**metres, "long_name": "centre of the coil, x"})
    return xr.Dataset(
        data,
        coords={
            "neighbours": ["grounded", "open"],
            "state": list(states),
            "delta": ("delta", levels, {"units": "1"}),
            "cause": list(effects),
        },
        attrs=provenance(design),
    )


def _published(states: Sequence[str], levels: FloatArray) -> EllipseCurves:
    """Ellipses of Table A1, NaN for other states."""
    curves = np.full((len(PARAMETERS), len(states), len(levels)), np.nan)
    hidden = np.zeros((len(states), len(levels)), dtype=bool)
    for coil in published_model().coils:
        if coil.name in states:
            row = list(states).index(coil.name)
            curves[:, row] = [np.polyval(getattr(coil, name), levels) for name in PARAMETERS]
            hidden[row] = undetermined_levels(coil, levels)
    x0, A, B = curves
    return EllipseCurves(x0, A, B, hidden)


def _rms(values: FloatArray) -> FloatArray:
    """Root mean square over δ without NaN, NaN if nothing is left."""
    count = np.isfinite(values).sum(axis=-1)
    return np.asarray(np.sqrt(np.nansum(values**2, axis=-1) / np.where(count > 0, count, np.nan)))
