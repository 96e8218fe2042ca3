"""Figures of the localization and of measurements."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse as EllipsePatch
from matplotlib.ticker import MaxNLocator

from coilarray.compute.display_units import MILLI_DELTA, MM, PER_MILLION, DisplayUnit, true_minus
from coilarray.paper.ellipse import Ellipse
from coilarray.paper.ellipse_model import EllipseModel, EllipsePosition
from coilarray.viz.datasets.results import of_state
from coilarray.viz.palette import (
    BLUE,
    COILS,
    DIVERGING,
    GREEN,
    GREY,
    INK,
    SEQUENTIAL,
    SKY,
    VERMILLION,
    CurveLook,
    curve_look,
)
from coilarray.viz.plots import style

_PARAMETERS = {"A": (BLUE, "o", "-"), "B": (VERMILLION, "s", "--"), "x0": (GREEN, "^", ":")}
_NAMES = {"A": "A", "B": "B", "x0": r"$x_0$"}

_MARGIN = 0.3  # mm
_SHARE = 0.1  # share of the largest effect; single neighbours below it have no name in the legend
_HIGHEST = 10.0  # largest height in inches of maps one below the other, and width of maps side by side
_LANDSCAPE = 1.6  # width over height above which maps stand below each other
_DECADES = 3.0  # largest range of the standard deviations on a map
_SIGMAS = {"sigma_x": "x", "sigma_y": "y", "sigma_h": "depth"}


@style.styled
def plot_ellipse_parameters(
    fits: xr.Dataset, model: EllipseModel, state: str, ax: Axes | None = None, published: EllipseModel | None = None
) -> Axes:
    """Draw A, B and x0 of a coil over δ.

    Markers are the `fits` of `coilarray.paper.ellipse.fit_ellipses` for the coil of the name
    `state`, and lines are the polynomials of the `model` through them, as in Fig. 5b of Gast &
    Zimmermann (2020). Levels whose points do not determine their ellipse are crossed out. A
    `published` model is drawn in grey if it has the coil. Raises ValueError if the fits or the
    model have no such state.
    """
    names = fits.state.values.tolist()
    if state not in names or state not in model.names:
        raise ValueError(f"state must be one of {', '.join(names)}; got {state!r}.")
    ax = ax or style.new_axes(6.0, 4.0)
    of, coil = fits.sel(state=state), model[state]
    for key, (colour, marker, line) in _PARAMETERS.items():
        look: dict[str, Any] = {"markersize": 3.5, "markerfacecolor": "none", "undetermined": of.undetermined}
        style.draw_curve(ax, MILLI_DELTA.of(of.delta), MM.of(of[key]), marker, colour, **look)
        at = np.linspace(np.nanmin(of.delta.values), np.nanmax(of.delta.values), 200)
        ax.plot(MILLI_DELTA.of(at), MM.of(np.polyval(getattr(coil, key), at)), line, color=colour, label=_NAMES[key])
    if published is not None and state in published.names:
        known = published[state]
        at = np.linspace(1e-4, min(known.highest, float(at[-1])), 200)
        for key, (_, _, line) in _PARAMETERS.items():
            label = "Table A1" if key == "A" else None
            curve = MM.of(np.polyval(getattr(known, key), at))
            ax.plot(MILLI_DELTA.of(at), curve, line, color=GREY, linewidth=1.0, label=label)
    style.zero_line(ax)
    ax.set_xlim(left=0.0)
    style.finish_curves(ax, MILLI_DELTA.label("δ"), MM.label("A, B, $x_0$"), f"Ellipses of {state}")
    return ax


@style.styled
def ellipse_parameter_figure(fits: xr.Dataset, model: EllipseModel, published: EllipseModel | None = None) -> Figure:
    """Draw `plot_ellipse_parameters` of every coil of a model.

    Each coil has its own panel. The `fits`, the `model` and the `published` model are as there.
    """
    columns = min(len(model.coils), 3)
    rows = math.ceil(len(model.coils) / columns)
    figure = style.new_figure(3.4 * columns + 1.6, 3.2 * rows)
    cells = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    for k, (ax, name) in enumerate(zip(cells, model.names, strict=False)):
        plot_ellipse_parameters(fits, model, name, ax, published)
        if k % columns:
            ax.set_ylabel("")
    for ax in cells[len(model.coils) :]:
        ax.remove()
    style.one_legend(figure)
    return figure


@style.styled
def plot_ellipses(
    ellipses: Mapping[str, Ellipse],
    position: EllipsePosition | None = None,
    real: tuple[float, float] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw the ellipses of coils and their intersections.

    The figure follows Fig. 6 of Gast & Zimmermann (2020), with at least one of the `ellipses` by
    the names of the coils. A `position` where two of them meet is drawn as dots at y and −y and a
    line at x, the `real` x and y in m as a cross. Raises ValueError if there is no ellipse.
    """
    if not ellipses:
        raise ValueError("ellipses must hold one or more; got none.")
    shapes = list(ellipses.values())
    left, right, top = MM.of(
        (min(e.x0 - e.A for e in shapes), max(e.x0 + e.A for e in shapes), max(e.B for e in shapes))
    ).tolist()
    width, height = style.figure_size(right - left, 2 * top)
    ax = ax or style.new_axes(width, height + 0.5)
    for k, (name, ellipse) in enumerate(ellipses.items()):
        x0, width, height = MM.of((ellipse.x0, 2 * ellipse.A, 2 * ellipse.B)).tolist()
        look = curve_look(k)
        curve = EllipsePatch((x0, 0.0), width, height, label=name)
        curve.set(facecolor="none", edgecolor=look["color"], linewidth=1.6, linestyle=look["linestyle"])
        ax.add_patch(curve)
        ax.plot(x0, 0.0, "+", color=look["color"])
    if position is not None:
        x, y = MM.of((position.x, position.y)).tolist()
        ax.axvline(x, color=GREY, linewidth=0.8, linestyle=":", zorder=0)
        ax.plot([x, x], [y, -y], "o", color=INK, markersize=5, label=true_minus(f"x = {x:.2f} mm, {position.case}"))
    if real is not None:
        ax.plot(*MM.of(real), "x", color=VERMILLION, markersize=7, label="real position")
    rim = 0.05 * max(right - left, 2 * top)
    ax.set(xlim=(left - rim, right + rim), ylim=(-top - rim, top + rim))
    style.plan_axes(ax)
    style.legend_above(ax, 2, "left")
    return ax


@style.styled
def plot_x_error(error: xr.DataArray, ax: Axes | None = None, outlines: Sequence[npt.ArrayLike] = ()) -> Axes:
    """Draw the error of a determined x over position.

    The figure follows Fig. 7 of Gast & Zimmermann (2020). The `error` is determined minus real x in
    m, with the dimensions y and x and their coordinates in m, and NaN at places without a position,
    which are grey. The colours are symmetric about zero. The `outlines` are corners (m, 2) of the
    coils in m, first point not repeated. Raises ValueError if there are fewer than two x or y, or
    no error at all.
    """
    values = _plane(error, "an error", "one value")
    ax = ax or style.new_axes(*_size(error))
    style.colour_bar(ax, style.signed_map(ax, error, values, outlines), MM.label("error of x"))
    ax.set_title(f"Error of x, at most {style.largest(values):.2f} mm")
    return ax


@style.styled
def plot_distortion(distortion: xr.Dataset, state: str, ax: Axes | None = None) -> Axes:
    """Draw x0 of a coil over δ.

    It is predicted with the neighbours grounded and open, and as published. Levels are crossed out
    if the window shows too little of their ellipse, and the axis fits the other levels. If the
    result has standard deviations, bands are two standard deviations of the posterior on each side.
    `distortion` is the result of `coilarray.paper.distortion.distortion`, and `state` the name of a
    coil. Raises ValueError if the dataset has no such state.
    """
    of = of_state(distortion, state)
    ax = ax or style.new_axes(6.5, 4.0)
    at = MILLI_DELTA.of(of.delta)
    curves = (
        ("neighbours grounded", of.sel(neighbours="grounded"), "", BLUE, "-"),
        ("neighbours open", of.sel(neighbours="open"), "", SKY, "--"),
        ("Table A1", of, "published_", INK, "-"),
    )
    determined = [MM.of(of.centre).ravel()]
    for label, curve, prefix, colour, line in curves:
        x0 = MM.of(curve[f"{prefix}x0"])
        if np.isfinite(x0).any():
            hidden = curve[f"{prefix}undetermined"].values
            half = 2 * MM.of(curve.x0_std) if not prefix and "x0_std" in curve else None
            style.draw_curve(ax, at, x0, line, colour, half=half, undetermined=hidden, label=label)
            determined.append(x0[np.isfinite(x0) & ~hidden])
    ax.axhline(float(MM.of(of.centre)), color=GREY, linewidth=0.8, linestyle=":", label="centre of the coil")
    shown = np.concatenate(determined)
    ax.set_ylim(shown.min() - _MARGIN, shown.max() + _MARGIN)
    style.finish_curves(ax, MILLI_DELTA.label("δ"), MM.label("$x_0$"), f"$x_0$ of {state}")
    return ax


@style.styled
def plot_causes(distortion: xr.Dataset, state: str, ax: Axes | None = None) -> Axes:
    """Draw the share of each cause in x0 over δ.

    The legend starts with the largest cause. Single neighbours are thin lines. Causes below a tenth
    of the largest cause have no name. The `distortion`, the `state` and errors are as in
    `plot_distortion`.
    """
    of = of_state(distortion, state)
    ax = ax or style.new_axes(6.5, 4.0)
    at = MILLI_DELTA.of(of.delta)
    rms = {cause: float(of.rms.sel(cause=cause)) for cause in of.cause.values.tolist()}
    rms = {cause: value for cause, value in rms.items() if math.isfinite(value)}
    largest = max(rms.values(), default=0.0)
    looks = {cause: curve_look(k) for k, cause in enumerate(sorted(rms))}  # same look of a cause in every panel
    for cause in sorted(rms, key=lambda cause: -rms[cause]):
        single = cause.startswith("neighbour ")
        named = not single or rms[cause] >= _SHARE * largest
        look = looks[cause] if named else CurveLook(color=GREY, linestyle="-")
        label = f"{cause}, {rms[cause] * MM.factor:.2f}" if named else None
        share = MM.of(of.effect.sel(cause=cause))
        half = 2 * MM.of(of.effect_std.sel(cause=cause)) if "effect_std" in of else None
        width = 0.9 if single else 1.6
        style.draw_curve(ax, at, share, look["linestyle"], look["color"], half=half, linewidth=width, label=label)
    style.zero_line(ax)
    style.finish_curves(ax, MILLI_DELTA.label("δ"), MM.label("share in $x_0$"), f"Causes for {state}, rms in mm")
    return ax


@style.styled
def distortion_figure(distortion: xr.Dataset) -> Figure:
    """Draw `plot_distortion` and `plot_causes` of a `distortion`, one row per coil."""
    states = distortion.state.values.tolist()
    figure = style.new_figure(12.5, 3.7 * len(states))
    axes = figure.subplots(len(states), 2, squeeze=False)
    for (left, right), state in zip(axes, states, strict=True):
        plot_distortion(distortion, state, left)
        plot_causes(distortion, state, right)
    return figure


@style.styled
def plot_identifiability(
    bounds: xr.Dataset, quantity: str = "sigma_x", ax: Axes | None = None, outlines: Sequence[npt.ArrayLike] = ()
) -> Axes:
    """Draw the Cramér–Rao bound of x, y or depth.

    The `bounds` of `coilarray.localize.identifiability.identifiability` are drawn over the board on
    a logarithmic scale, for the `quantity` ``sigma_x``, ``sigma_y`` or ``sigma_h``, with `outlines`
    as in `plot_x_error`. Places where the bound is infinite, or exceeds the map along x or y, are
    grey. Raises ValueError if the dataset has no such quantity, fewer than two x or y, or no value
    that is not grey.
    """
    there = [name for name in _SIGMAS if name in bounds]
    if quantity not in there:
        raise ValueError(f"quantity must be one of {', '.join(there)}; got {quantity!r}.")
    values = _plane(_determined(bounds, quantity), "a bound", "one finite value")
    finite = values[np.isfinite(values)]
    low = max(float(finite.min()), np.finfo(float).tiny)
    high = min(max(float(finite.max()), low * 1.01), low * 10**_DECADES)
    ax = ax or style.new_axes(*_size(bounds))
    look: dict[str, Any] = {"cmap": f"{SEQUENTIAL}_r", "norm": LogNorm(low, high), "rasterized": True}
    image = ax.pcolormesh(MM.of(bounds.x), MM.of(bounds.y), np.ma.masked_invalid(values), **look)
    beyond: Literal["max", "neither"] = "max" if float(finite.max()) > high else "neither"
    bar = style.colour_bar(ax, image, MM.label(f"σ of {_SIGMAS[quantity]}"), beyond)
    style.logarithmic_ticks(bar.ax.yaxis, math.log10(high / low))
    style.finish_map(ax, outlines)
    ax.set_title(f"Least standard deviation of {_SIGMAS[quantity]}, {_conditions(bounds)}")
    return ax


def _determined(bounds: xr.Dataset, quantity: str) -> xr.DataArray:
    """Finite standard deviations up to the size of the map in their direction."""
    values, axis = bounds[quantity], bounds.get(_SIGMAS[quantity])
    return values.where(np.isfinite(values) if axis is None else values <= float(np.ptp(axis.values)))


def _conditions(bounds: xr.Dataset) -> str:
    least, most = np.min(bounds.attrs["noise"]), np.max(bounds.attrs["noise"])
    shown = " to ".join(PER_MILLION.text(value, ".2") for value in np.unique([least, most]))
    common = np.max(bounds.attrs.get("common_noise", 0.0))
    beside = f", {PER_MILLION.text(common, '.2')} common" if common else ""
    return f"{MM.text(bounds.attrs['depth'])} deep, noise {shown} in δ{beside}"


@style.styled
def identifiability_figure(bounds: xr.Dataset, outlines: Sequence[npt.ArrayLike] = ()) -> Figure:
    """Draw `plot_identifiability` of all unknown quantities.

    These are x, y and, if it is unknown, the depth. Maps of a wide board stand below each other,
    other maps side by side. The `bounds` and `outlines` are as there.
    """
    there = [name for name in _SIGMAS if name in bounds and np.isfinite(_determined(bounds, name).values).any()]
    if not there:
        raise ValueError("the bounds have no finite standard deviation.")
    width, height = _size(bounds)
    across = 1 if width > _LANDSCAPE * height else len(there)
    width, height = width * across, height * (len(there) // across)
    shrink = min(1.0, _HIGHEST / max(width, height))
    figure = style.new_figure(width * shrink, height * shrink, layout="compressed")
    for ax, name in zip(figure.subplots(len(there) // across, across, squeeze=False).flat, there, strict=True):
        plot_identifiability(bounds, name, ax, outlines)
        ax.set_title(f"of {_SIGMAS[name]}")
        ax.locator_params(axis="x", nbins=9 if across == 1 else 5)
    style.main_title(figure, f"Least standard deviation, {_conditions(bounds)}")
    return figure


def _plane(data: xr.DataArray, what: str, least: str) -> npt.NDArray[np.float64]:
    """Values (y, x) in mm of a plane with a finite value, or ValueError."""
    values = MM.of(data.transpose("y", "x"))
    if min(values.shape) < 2 or not np.isfinite(values).any():
        raise ValueError(f"{what} must have at least two x and two y and {least}; got shape {values.shape}.")
    return values


def _size(data: xr.Dataset | xr.DataArray) -> tuple[float, float]:
    width, height = style.map_size(data)
    return width + 0.4, height


MOST_STATES = 6
"""Largest number of states in `comparison_figure` and `calibration_figure`."""

_STAGES = {"before": "as simulated", "after": "scaled and shifted"}
_SOURCES = {"measured": (VERMILLION, "o-"), "simulated": (BLUE, "s--")}
_BAND = 2.0  # half width of the band around x0
_WIDTHS = (1.0, 1.0, 0.6)  # of two maps and x0 beside each other
_ROW = 13.0  # inches
_LOOKS = {"A": ("o", BLUE), "B": ("s", VERMILLION), "x0": ("^", INK)}


@style.styled
def plot_readings(comparison: xr.Dataset, depth: int = 0, ax: Axes | None = None) -> Axes:
    """Draw measured over simulated δ of every state.

    `comparison` is the result of `coilarray.studies.comparison.compare_responses`, and `depth` the
    index of a depth in it. There is a dot per position, and the line of equality.
    """
    at = comparison.isel(depth=depth)
    ax = ax or style.new_axes(5.0, 4.5)
    names = at.state.values.tolist()
    ends: list[float] = []
    for k, (name, colour) in enumerate(style.state_colours(comparison, names).items()):
        measured, simulated = (MILLI_DELTA.of(at.delta.sel(state=name, source=source)).ravel() for source in _SOURCES)
        label = true_minus(f"{name}, scale {float(at.scale[k]):.3f} ± {float(at.scale_std[k]):.3f}")
        marker = "os^Dv*"[(k // len(COILS)) % 6]
        ax.plot(simulated, measured, marker, markersize=3.0, markerfacecolor="none", color=colour, label=label)
        ends += simulated[np.isfinite(simulated)].tolist()
    if ends:
        span = min(ends), max(ends)
        ax.plot(span, span, color=GREY, linewidth=0.8, zorder=0)
    title = f"Readings, {MM.text(at.depth)} deep"
    style.finish_curves(ax, MILLI_DELTA.label("simulated δ"), MILLI_DELTA.label("measured δ"), title)
    return ax


@style.styled
def plot_centres(comparison: xr.Dataset, state: str, depth: int = 0, ax: Axes | None = None) -> Axes:
    """Draw x0 of the ellipses of one state over δ.

    The values are measured and simulated, with bands of two standard deviations. Levels whose
    points do not determine their ellipse are crossed out. `comparison` and `depth` are as in
    `plot_readings`. Raises ValueError if the dataset has no such `state`.
    """
    of = of_state(comparison.isel(depth=depth), state)
    ax = ax or style.new_axes(5.0, 3.5)
    level = MILLI_DELTA.of(of.level)
    for source, (colour, line) in _SOURCES.items():
        one = of.sel(source=source)
        if np.isfinite(one.x0).any():
            half, look = _BAND * MM.of(one.x0_std), {"markersize": 3.0, "markerfacecolor": "none", "linewidth": 1.0}
            undetermined = one.undetermined
            style.draw_curve(
                ax, level, MM.of(one.x0), line, colour, half=half, undetermined=undetermined, label=source, **look
            )
    if not ax.lines:
        ax.text(0.5, 0.5, "no ellipses", ha="center", va="center", transform=ax.transAxes)
    if "coil_x" in of.coords and state in of.coil.values:
        centre = float(MM.of(of.coil_x.sel(coil=state)))
        ax.axhline(centre, color=GREY, linewidth=0.8, linestyle=":", label="centre of the coil")
    style.finish_curves(ax, MILLI_DELTA.label("δ"), MM.label("$x_0$"), f"$x_0$ of {state}")
    return ax


@style.styled
def comparison_figure(comparison: xr.Dataset, depth: int = -1, outlines: Sequence[npt.ArrayLike] = ()) -> Figure:
    """Draw a comparison, one row per state.

    A row has maps of measured minus simulated δ before and after scale and shift, in the same
    colours, and x0 of both. A response along a single line, or at a single position, is drawn by
    `plot_readings` alone. The first `MOST_STATES` states are shown. `comparison` and `depth` are as
    in `plot_readings`, by default the deepest, and `outlines` as in `coilarray.viz.plot_response`.
    """
    if min(comparison.sizes["x"], comparison.sizes["y"]) < 2:
        figure = style.new_figure(7.0, 4.5)
        plot_readings(comparison, depth, figure.add_subplot())
        return figure
    names = comparison.state.values.tolist()[:MOST_STATES]
    aspect = float(np.ptp(comparison.y.values) / np.ptp(comparison.x.values))
    height = max(1.9, _ROW / sum(_WIDTHS) * aspect + 0.9)
    figure = style.new_figure(_ROW, height * len(names) + 0.5)
    axes = figure.subplots(len(names), 3, squeeze=False, width_ratios=_WIDTHS)
    for (left, right, curve), state in zip(axes, names, strict=True):
        of = of_state(comparison.isel(depth=depth), state)
        both = np.stack([of[f"residual_{stage}"].transpose("y", "x").values for stage in _STAGES])
        shown = style.axis_unit(both, "1")
        for ax, values, stage in zip((left, right), shown.of(both), _STAGES.values(), strict=True):
            mesh = style.signed_map(ax, of, values, outlines, style.largest(shown.of(both)))
            ax.set_title(f"{state}, {stage}")
        figure.colorbar(mesh, ax=[left, right], label=shown.label("δ"), fraction=0.03, pad=0.01)
        right.set_ylabel("")
        plot_centres(comparison, state, depth, curve)
    note = f" ({len(names)} of {comparison.sizes['state']} states)" if len(names) < comparison.sizes["state"] else ""
    style.main_title(figure, f"Measured less simulated δ, {MM.text(comparison.depth[depth])} deep{note}")
    return figure


@style.styled
def calibration_figure(calibration: xr.Dataset, combination: int = 0) -> Figure:
    """Draw measured and fitted numbers, one row per state.

    The residuals are in standard deviations. For ellipses, A, B and x0 are drawn over δ, with a
    band of one standard deviation of the posterior. For a response, δ is drawn along x, and the
    residuals as a map if there are several rows. `calibration` is the dataset of
    `coilarray.studies.calibrate.calibrate`. If it has more than six states, those with the largest
    measured values are drawn, and the title mentions this. `combination` is the index of a
    combination of choices, by default the most probable.
    """
    of = calibration.isel(combination=combination)
    every = list(dict.fromkeys(of.state.values.tolist()))
    measured = np.abs(of.measured.values)
    by_size = sorted(every, key=lambda state: measured[of.state.values == state].max(), reverse=True)
    states = [state for state in every if state in by_size[:MOST_STATES]]
    figure = style.new_figure(12.5, 3.4 * len(states))
    if len(states) < len(every):
        style.main_title(figure, f"The {len(states)} of {len(every)} states with the largest values")
    axes = figure.subplots(len(states), 2, squeeze=False)
    plot = _fitted_ellipses if calibration.attrs["kind"] == "ellipses" else _fitted_response
    for state, (left, right) in zip(states, axes, strict=True):
        plot(of.isel(datum=np.flatnonzero(of.state == state)), state, left, right)
    return figure


def _fitted_ellipses(of: xr.Dataset, state: str, left: Axes, right: Axes) -> None:
    """Draw the ellipses' parameters of a state over δ."""
    known = np.isfinite(of.model.values[of.quantity == "x0"])  # else the window does not show the model's ellipse
    for name, (marker, colour) in _LOOKS.items():
        part = of.isel(datum=np.flatnonzero(of.quantity == name))
        level, model = MILLI_DELTA.of(part.level), np.where(known, MM.of(part.model), np.nan)
        left.plot(level, MM.of(part.measured), marker, color=colour, markersize=4.0, markerfacecolor="none")
        style.draw_curve(left, level, model, "-", colour, half=MM.of(part.model_std), label=_NAMES[name])
        line = "-" if (part.weight > 0).any() else "--"
        remains = np.where(known, part.residual.values, np.nan)
        right.plot(level, remains, f"{marker}{line}", color=colour, label=_NAMES[name])
    style.zero_line(right)
    style.finish_curves(left, MILLI_DELTA.label("δ"), MM.label("A, B, $x_0$"), f"{state}: lines fitted")
    style.finish_curves(right, MILLI_DELTA.label("δ"), "fitted − measured (noise)", f"{state}: residuals")


def _fitted_response(of: xr.Dataset, state: str, left: Axes, right: Axes) -> None:
    deepest = of.isel(datum=np.flatnonzero(of.depth == of.depth.max()))
    for k, y in enumerate(np.unique(deepest.y.values)):
        row = deepest.isel(datum=np.flatnonzero(deepest.y == y)).sortby("x")
        shown: dict[str, Any] = {"color": INK, "markersize": 3.0, "markerfacecolor": "none"}
        left.plot(MM.of(row.x), MILLI_DELTA.of(row.measured), "o", label="measured" if not k else None, **shown)
        left.plot(MM.of(row.x), MILLI_DELTA.of(row.model), "-", color=BLUE, label=None if k else "fitted")
    limit = style.largest(deepest.residual.values)
    colours: dict[str, Any] = {"c": deepest.residual.values, "cmap": DIVERGING, "vmin": -limit, "vmax": limit}
    dots = right.scatter(MM.of(deepest.x), MM.of(deepest.y), s=18.0, **colours)
    style.colour_bar(right, dots, "fitted − measured (noise)")
    left.set(xlabel=MM.label("x"), ylabel=MILLI_DELTA.label("δ"), title=f"{state}, {MM.text(deepest.depth[0])} deep")
    right.set(xlabel=MM.label("x"), ylabel=MM.label("y"), title=f"{state}: residuals")
    style.faint_grid(left)
    left.legend(loc="best")


@style.styled
def posterior_figure(calibration: xr.Dataset, combination: int = 0) -> Figure:
    """Draw the posterior of the unknowns.

    The diagonal has every unknown alone, and every pair is below it. Crosses are the fitted values.
    The `calibration` and the `combination` are as in `calibration_figure`.
    """
    of = calibration.isel(combination=combination)
    of = of.isel(unknown=np.flatnonzero(np.isfinite(of["value"].values)))
    labels = [name.rpartition(".")[2] for name in of.unknown.values.tolist()]
    n = len(labels)
    side = max(2.0, min(4.0, 12.0 / n))
    figure = style.new_figure(side * n + 0.8, side * n + 0.4)
    axes = figure.subplots(n, n, squeeze=False)
    draws, best = of.posterior.values, of["value"].values
    for i in range(n):
        for j in range(n):
            ax = axes[i, j]
            if j > i:
                ax.remove()
                continue
            if i == j:
                ax.hist(draws[:, i], bins=30, color=BLUE, alpha=0.6)
                ax.axvline(best[i], color=VERMILLION, linewidth=1.0)
                ax.set_yticks([])
            else:
                ax.plot(draws[:, j], draws[:, i], ".", color=BLUE, markersize=1.5, alpha=0.5)
                ax.plot(best[j], best[i], "+", color=VERMILLION, markersize=9.0)
                ax.yaxis.set_major_locator(MaxNLocator(3))
            ax.xaxis.set_major_locator(MaxNLocator(3))
            if i == n - 1:
                ax.set_xlabel(labels[j], fontsize=8)
            if j == 0 and i:
                ax.set_ylabel(labels[i], fontsize=8)
    return figure


@style.styled
def plot_evidence(calibration: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the evidence of every combination of choices.

    It is relative to the best combination, as ln of the odds. `calibration` is as in
    `calibration_figure`.
    """
    names = calibration.combination.values.tolist()
    ax = ax or style.new_axes(8.0, 0.35 * len(names) + 1.0)
    evidence = calibration.log_evidence.values
    relative = np.nan_to_num(evidence - evidence[0], nan=0.0)
    ax.barh(range(len(names)), relative, color=[BLUE if np.isfinite(one) else GREY for one in evidence])
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.set(xlabel=true_minus("ln evidence - best"), title="Combinations")
    style.faint_grid(ax, "x")
    return ax


@style.styled
def plot_stability(found: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw every state's Allan deviation against the averaging time.

    `found` is the result of `coilarray.hardware.record.stability.stability`. If it has
    ``expected``, white noise of the budget is a dotted line.
    """
    ax = ax or style.new_axes(6.5, 3.8)
    tau, names = found.tau.values, found.state.values.tolist()
    colours = style.state_colours(found, names)
    for k, name in enumerate(names):
        one = found.sel(state=name)
        known = np.isfinite(one.deviation.values)
        look = curve_look(k) | {"color": colours[name]}
        ax.plot(tau[known], one.deviation.values[known], label=name, marker="o", markersize=3.0, **look)
    ax.set(xscale="log", yscale="log")
    if "expected" in found and np.isfinite(found.expected.values).any():
        expected = float(np.nanmean(found.expected.values))
        ax.plot(tau, expected * np.sqrt(tau[0] / tau), color=GREY, linewidth=1.2, linestyle=":", label="budget, white")
    style.logarithmic_ticks(ax.xaxis, math.log10(tau[-1] / tau[0]) if len(tau) > 1 else 1.0)
    style.finish_curves(ax, DisplayUnit("s").label("averaging time"), "Allan deviation of δ")
    return ax
