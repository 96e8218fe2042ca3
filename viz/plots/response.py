"""Flat figures of the sensor response: maps of δ over the position of the indenter, profiles, and bell curves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter

from coilarray.viz.datasets import at_depth
from coilarray.viz.palette import DIVERGING, GREY, INK, PALE, curve_look
from coilarray.viz.plots.axis_units import MM, AxisUnit, axis_unit, true_minus
from coilarray.viz.plots.style import (
    colour_bar,
    draw_outlines,
    faint_grid,
    figure_size,
    largest,
    legend_beside,
    new_axes,
    plan_axes,
    styled,
)

if TYPE_CHECKING:
    import xarray as xr

FloatArray = npt.NDArray[np.float64]

MOST_MAPS = 12
"""States that `response_figure` shows at most."""

_BANDS, _TICKS = 20, 9  # of colour, and numbers beside them, at most
_STEPS = (1, 2, 5, 10)
_NOTHING = 0.01  # of the largest δ: below it a map is white and has no line of zero
_GRID_SHAPE = 1.4  # width over height of all maps together
_PROFILE = (7.5, 3.6)  # inches
_SMOOTH = 400  # points of a curve between the samples


@styled
def plot_response(
    response: xr.Dataset,
    state: str,
    depth: int = 0,
    ax: Axes | None = None,
    outlines: Sequence[npt.ArrayLike] = (),
) -> Axes:
    """Draw δ of one state over the position of the indenter, with the outlines of the coils.

    Colours are symmetric about zero, and all but white where δ is within 1 % of its largest magnitude; a dashed line
    is where it changes its sign. Between the positions δ is taken as linear; where one has no value, nothing is drawn.

    Parameters
    ----------
    response : xarray.Dataset
        With ``delta`` (depth, y, x, state) and the coordinates in m; at least two x and two y.
    state : str
        Which state.
    depth : int
        Position of the depth in the dataset.
    ax : Axes, optional
        Where to draw; in mm.
    outlines : sequence of array_like, each of shape (m, 2)
        Corners of the coils in m from the same origin as x and y, first point not repeated.

    Raises
    ------
    ValueError
        A state or a depth that the dataset does not have, or a map of a single row.

    Examples
    --------
    >>> import numpy as np, xarray as xr
    >>> x, y = np.linspace(-20e-3, 20e-3, 21), np.linspace(-6e-3, 6e-3, 7)
    >>> bell = 1e-3 * np.exp(-(x**2 + y[:, None] ** 2) / 8e-3**2)
    >>> coil = {"state": ["coil1"], "coil": ["coil1"], "coil_x": ("coil", [0.0]), "coil_y": ("coil", [0.0])}
    >>> axes = {"depth": [1e-3], "y": y, "x": x}
    >>> response = xr.Dataset({"delta": (("depth", "y", "x", "state"), bell[None, :, :, None])}, axes | coil)
    >>> ax = plot_response(response, "coil1")
    >>> ax.get_title(loc="left"), ax.child_axes[0].get_ylabel()
    ('Response of coil1, 1 mm deep', 'δ (10⁻³)')
    """
    delta = _delta(response, state=state, depth=depth).transpose("y", "x")
    if min(delta.shape) < 2:
        raise ValueError(f"a map must have at least two x and two y; got {delta.sizes['x']} and {delta.sizes['y']}.")
    window = _window(response, outlines)
    scale = _scale(delta.values)
    ax = ax or new_axes(*figure_size(window.width, window.height))
    bands = _draw_map(ax, response, delta, window, scale)
    colour_bar(ax, bands, scale.unit.label("δ")).set_ticks(MaxNLocator(_TICKS, steps=_STEPS))
    plan_axes(ax)
    ax.set_title(f"Response of {state}, {_depth_text(response, depth)} deep")
    return ax


@styled
def plot_response_profile(
    response: xr.Dataset,
    state: str | None = None,
    depth: int | None = 0,
    ax: Axes | None = None,
    along: Literal["x", "y"] = "x",
) -> Axes:
    """Draw δ along a line: one curve for each state and depth that is not fixed.

    Parameters
    ----------
    response : xarray.Dataset
        As in `plot_response`; a single position is drawn as a dot.
    state : str, optional
        Only this state; every one by default.
    depth : int, optional
        Only this position of the depth in the dataset; None for every one.
    ax : Axes, optional
        Where to draw; mm across. Dotted lines are the centres of the coils.
    along : {"x", "y"}
        Direction of the line; the other coordinate is the one nearest to zero.

    Raises
    ------
    ValueError
        A state or a depth that the dataset does not have.

    Examples
    --------
    >>> import numpy as np, xarray as xr
    >>> x, y = np.linspace(-20e-3, 20e-3, 21), np.linspace(-6e-3, 6e-3, 7)
    >>> bell = 1e-3 * np.exp(-(x**2 + y[:, None] ** 2) / 8e-3**2)
    >>> coil = {"state": ["coil1"], "coil": ["coil1"], "coil_x": ("coil", [0.0]), "coil_y": ("coil", [0.0])}
    >>> axes = {"depth": [1e-3], "y": y, "x": x}
    >>> response = xr.Dataset({"delta": (("depth", "y", "x", "state"), bell[None, :, :, None])}, axes | coil)
    >>> ax = plot_response_profile(response)
    >>> round(float(ax.lines[0].get_ydata().max()), 3), ax.get_ylabel()
    (1.0, 'δ (10⁻³)')
    """
    across = "y" if along == "x" else "x"
    delta = _delta(response, state=state, depth=depth)
    row = delta.isel({across: int(np.abs(delta[across].values).argmin())})
    shown = axis_unit(row, "1")
    ax = ax or new_axes(*_PROFILE)
    at = MM.of(row[along])
    states = np.atleast_1d(row.state.values).tolist()
    depths = np.atleast_1d(row.depth.values).tolist()
    curves = [(name, value, row.sel(_kept(row, state=name, depth=value)).values) for value in depths for name in states]
    for k, (name, value, values) in enumerate(curves):
        deep = f"{value * MM.factor:g} mm"
        label = name if len(depths) == 1 else deep if len(states) == 1 else f"{name}, {deep}"
        ax.plot(at, shown.of(values), label=label, marker="o" if at.size == 1 else "", **curve_look(k))
    ax.axhline(0.0, color=GREY, linewidth=0.8, zorder=0)
    for centre in MM.of(response[f"coil_{along}"]).tolist():
        if at.min() <= centre <= at.max():
            ax.axvline(centre, color=PALE, linewidth=0.8, linestyle=":", zorder=0)
    if at.size > 1:
        ax.set_xlim(at.min(), at.max())
    ax.set_xlabel(MM.label(along))
    ax.set_ylabel(shown.label("δ"))
    fixed = [*([] if state is None else [state]), *([] if depth is None else [f"{_depth_text(response, depth)} deep"])]
    ax.set_title(", ".join([f"Response at {across} = {float(row[across]) * MM.factor:g} mm", *fixed]))
    legend_beside(ax, math.ceil(len(curves) / 16))
    return ax


@styled
def plot_bell_curve(
    response: xr.Dataset, state: str | None = None, ax: Axes | None = None, along: Literal["x", "y"] = "x"
) -> Axes:
    """Draw δ of one coil along a line through its centre for every depth, with its peak and its width at half of it.

    Dots are the positions of the response, curves cubic splines through those that have a value. A bar is the width at
    half the peak; the legend has both, without the width where δ does not fall to the half on both sides.

    Parameters
    ----------
    response : xarray.Dataset
        As `coilarray.response_map` or `coilarray.response.two_dimensional` returns it; at least two positions along the
        line.
    state : str, optional
        Which state of a map; by default the one that feels the deepest dent in the middle of it most.
    ax : Axes, optional
        Where to draw; mm across. A dotted line is the centre of the coil.
    along : {"x", "y"}
        Direction of the line; on a map the other coordinate is the one nearest to the centre of the coil.

    Raises
    ------
    ValueError
        A state that the map does not have, or fewer than two positions with a value.

    Examples
    --------
    >>> import numpy as np, xarray as xr
    >>> x = np.linspace(-20e-3, 20e-3, 21)
    >>> bell = xr.DataArray(1e-3 * np.exp(-((x / 8e-3) ** 2))[None], {"depth": [1e-3], "x": x}, ("depth", "x"))
    >>> ax = plot_bell_curve(xr.Dataset({"delta": bell}))
    >>> [text.get_text() for text in ax.get_legend().get_texts()]  # the width is 2 √(ln 2) 8 mm
    ['1 mm: 1 × 10⁻³, 13.3 mm']
    """
    rows, centre, name = _bell(response, state, along)
    at = MM.of(rows[along])
    most = int(np.isfinite(rows.values).sum(axis=1).max())
    if most < 2:
        raise ValueError(f"a curve must have at least two {along} with a value; got {most}.")
    shown = axis_unit(rows, "1")
    ax = ax or new_axes(*_PROFILE)
    for k, depth in enumerate(rows.depth.values.tolist()):
        values = shown.of(rows.isel(depth=k))
        there = np.isfinite(values)
        if there.sum() < 2:
            continue
        delta = CubicSpline(at[there], values[there])
        fine = np.linspace(at[there][0], at[there][-1], _SMOOTH)
        look = curve_look(k)
        top, (left, right) = float(delta(fine).max()), _half_width(delta, fine)
        width = "" if math.isnan(right - left) else f", {right - left:.1f} mm"
        peak = f"{top:.3g} × {shown.symbol}" if shown.symbol else f"{top:.3g}"
        label = true_minus(f"{depth * MM.factor:g} mm: {peak}{width}")
        ax.plot(at, values, ".", color=look["color"], markersize=4)
        ax.plot(fine, delta(fine), label=label, **look)
        if width:
            ax.plot([left, right], [top / 2, top / 2], "|-", color=look["color"], linewidth=0.8, markersize=7)
    ax.axhline(0.0, color=GREY, linewidth=0.8, zorder=0)
    if centre is not None:
        ax.axvline(float(MM.of(centre)), color=PALE, linewidth=0.8, linestyle=":", zorder=0)
    ax.set_xlim(at[0], at[-1])
    faint_grid(ax)
    ax.set_xlabel(MM.label(along))
    ax.set_ylabel(shown.label("δ"))
    ax.set_title(f"Bell curve of {name}" if name else "Bell curve")
    legend_beside(ax, title="depth: peak, width")
    return ax


@styled
def response_figure(response: xr.Dataset, outlines: Sequence[npt.ArrayLike] = ()) -> Figure:
    """Draw the response to the deepest dent: one map a state with a common colour bar.

    A response along a single line, or at a single position, is drawn as one curve a state instead. Of more than
    `MOST_MAPS` states those in the middle are shown.

    Parameters
    ----------
    response, outlines
        As in `plot_response`, with any number of x and y.
    """
    names = response.state.values.tolist()
    first = max(0, (len(names) - MOST_MAPS) // 2)
    shown = response.isel(state=slice(first, first + MOST_MAPS))
    note = f" ({MOST_MAPS} of {len(names)} states, those in the middle)" if len(names) > MOST_MAPS else ""
    if min(response.sizes["x"], response.sizes["y"]) > 1:
        return _maps(shown, outlines, note)
    figure = Figure(figsize=_PROFILE)
    along: Literal["x", "y"] = "y" if response.sizes["y"] > 1 else "x"
    ax = plot_response_profile(shown, None, -1, figure.add_subplot(), along)
    ax.set_title(ax.get_title(loc="left") + note)
    return figure


@dataclass(frozen=True)
class _Window:
    """What a map shows: its sides in mm, and the outlines of the coils in m."""

    x: tuple[float, float]
    y: tuple[float, float]
    outlines: Sequence[npt.ArrayLike]

    @property
    def width(self) -> float:
        return self.x[1] - self.x[0]

    @property
    def height(self) -> float:
        return self.y[1] - self.y[0]


@dataclass(frozen=True)
class _Scale:
    """Unit of δ, the edges of its bands of colour in it, and what counts as nothing."""

    unit: AxisUnit
    levels: FloatArray
    nothing: float


def _maps(response: xr.Dataset, outlines: Sequence[npt.ArrayLike], note: str) -> Figure:
    """One map of the deepest dent for each state, and one colour bar."""
    names = response.state.values.tolist()
    deepest = _delta(response, state=None, depth=-1)
    window, scale = _window(response, outlines), _scale(deepest.values)
    columns = _columns(len(names), window.width / window.height)
    rows = math.ceil(len(names) / columns)
    width, height = figure_size(columns * window.width, rows * window.height)
    figure = Figure(figsize=(width, height + 0.3 * rows), layout="compressed")  # room for the names of the states
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    cells = axes.ravel().tolist()
    for ax, name in zip(cells, names, strict=False):
        bands = _draw_map(ax, response, deepest.sel(state=name).transpose("y", "x"), window, scale)
        ax.set_title(name)
    for ax in cells[len(names) :]:
        ax.remove()
    for ax in cells[len(names) - columns : len(names)]:  # the lowest one of every column
        ax.xaxis.set_tick_params(labelbottom=True)
        ax.set_xlabel(MM.label("x"))
    for ax in axes[:, 0]:
        ax.set_ylabel(MM.label("y"))
    bar = figure.colorbar(bands, ax=cells[: len(names)], spacing="proportional", aspect=40, fraction=0.05, pad=0.02)
    bar.set_ticks(MaxNLocator(_TICKS, steps=_STEPS))
    bar.set_label(scale.unit.label("δ"))
    figure.suptitle(f"Response, {_depth_text(response, -1)} deep{note}", x=0.01, ha="left", fontsize="large")
    return figure


def _columns(count: int, shape: float) -> int:
    """Columns of a grid of maps of this width over height, which makes the whole neither too wide nor too high."""
    return min(
        range(1, count + 1),
        key=lambda columns: abs(math.log(columns * shape / math.ceil(count / columns) / _GRID_SHAPE)),
    )


def _draw_map(ax: Axes, response: xr.Dataset, delta: xr.DataArray, window: _Window, scale: _Scale) -> QuadContourSet:
    """Fill axes in mm with δ (y, x), the line of zero, and the coils with their names."""
    x, y = MM.of(delta.x), MM.of(delta.y)
    values = scale.unit.of(delta)
    bands = ax.contourf(x, y, values, levels=scale.levels, cmap=DIVERGING)
    # a change of sign among positions that feel nothing means nothing
    felt = np.ma.array(values, mask=maximum_filter(np.abs(np.nan_to_num(values)), 3) < scale.nothing)
    felt = np.ma.masked_invalid(felt)
    if felt.count() and felt.min() < 0 < felt.max():
        ax.contour(x, y, felt, levels=[0.0], colors=INK, linewidths=0.8, linestyles="--")
    draw_outlines(ax, window.outlines)
    _name_coils(ax, response, x)
    ax.set_xlim(*window.x)
    ax.set_ylim(*window.y)
    ax.set_aspect("equal")
    return bands


def _scale(delta: FloatArray) -> _Scale:
    """Choose the power of ten, and bands about zero."""
    unit = axis_unit(delta, "1")
    limit = largest(unit.of(delta))
    levels = np.asarray(MaxNLocator(_BANDS, symmetric=True, steps=_STEPS).tick_values(-limit, limit))
    nothing = _NOTHING * limit
    edges = np.sort(np.r_[levels[levels != 0], -nothing, nothing])
    return _Scale(unit, edges, nothing)


def _window(response: xr.Dataset, outlines: Sequence[npt.ArrayLike]) -> _Window:
    """Show the whole map and, in height, the coils that it touches."""
    x, y = MM.of(response.x), MM.of(response.y)
    shapes = [MM.of(outline) for outline in outlines]
    touched = [s for s in shapes if s[:, 0].min() < x.max() and s[:, 0].max() > x.min()]
    edges = np.concatenate([y, *(shape[:, 1] for shape in touched)])
    rim = 0.02 * np.ptp(edges)
    return _Window((float(x.min()), float(x.max())), (float(edges.min() - rim), float(edges.max() + rim)), outlines)


def _name_coils(ax: Axes, response: xr.Dataset, x: FloatArray) -> None:
    """Write the names of the coils at those centres that lie within the map."""
    for name, at, across in zip(
        response.coil.values.tolist(), MM.of(response.coil_x), MM.of(response.coil_y), strict=True
    ):
        if x.min() < at < x.max():
            box = {"boxstyle": "round,pad=0.2", "facecolor": "white", "alpha": 0.8, "linewidth": 0}
            ax.text(at, across, name, ha="center", va="center", fontsize=8, bbox=box)


def _delta(response: xr.Dataset, *, state: str | None, depth: int | None) -> xr.DataArray:
    """δ of one state or of all, at one depth or at all."""
    names = response.state.values.tolist()
    if state is not None and state not in names:
        raise ValueError(f"state must be one of {', '.join(names)}; got {state!r}.")
    delta: xr.DataArray = (response if depth is None else at_depth(response, depth)).delta
    return delta if state is None else delta.sel(state=state)


def _kept(row: xr.DataArray, **labels: object) -> dict[str, object]:
    """Those of the labels whose dimension is still there."""
    return {name: label for name, label in labels.items() if name in row.dims}


def _depth_text(dataset: xr.Dataset, depth: int) -> str:
    return f"{float(dataset.depth[depth]) * MM.factor:g} mm"


def _bell(response: xr.Dataset, state: str | None, along: str) -> tuple[xr.DataArray, float | None, str]:
    """δ (depth, along) of one state on the line nearest to its coil, the coil's place on it in m, and the name."""
    if "state" not in response.dims:  # of the two-dimensional model, which has one coil
        return response.delta.transpose("depth", along), None, str(response.attrs.get("coil", ""))
    name = _in_the_middle(response) if state is None else state
    delta = _delta(response, state=name, depth=None)
    across = "y" if along == "x" else "x"
    of_coil = response.sel(coil=name) if name in response.coil.values else None
    beside = 0.0 if of_coil is None else float(of_coil[f"coil_{across}"])
    row = delta.isel({across: int(np.abs(delta[across].values - beside).argmin())})
    return row.transpose("depth", along), None if of_coil is None else float(of_coil[f"coil_{along}"]), name


def _in_the_middle(response: xr.Dataset) -> str:
    """Name of the state that feels the deepest dent in the middle of a map most."""
    middle = {axis: response.sizes[axis] // 2 for axis in ("x", "y")}
    there = response.delta.isel(depth=-1, **middle).fillna(-np.inf)
    return str(response.state.values[int(there.argmax("state"))])


def _half_width(delta: CubicSpline, fine: FloatArray) -> tuple[float, float]:
    """Places left and right of the peak where a curve is half of it; NaN where it does not come down there."""
    values = delta(fine)
    peak, half = int(values.argmax()), float(values.max()) / 2
    crossings = delta.solve(half, extrapolate=False)
    left, right = crossings[crossings < fine[peak]], crossings[crossings > fine[peak]]
    if half <= 0 or not left.size or not right.size:
        return math.nan, math.nan
    return float(left.max()), float(right.min())
