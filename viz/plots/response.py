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

from coilarray.viz.datasets.overlays import at_depth, of_state
from coilarray.viz.palette import DIVERGING, INK, PALE, curve_look
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
    write_name,
    zero_line,
)

if TYPE_CHECKING:
    import xarray as xr

FloatArray = npt.NDArray[np.float64]

MOST_MAPS = 12
"""Largest number of states in `response_figure`."""

_BANDS, _TICKS = 20, 9  # largest numbers of bands of colour, and of ticks beside them
_STEPS = (1, 2, 5, 10)
_NOTHING = 0.01  # share of the largest δ below which a map is white and has no zero line
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

    Colours are symmetric about zero, and white where |δ| is below 1 % of its maximum; a dashed line marks the change of
    sign. Between the positions δ is interpolated linearly; nothing is drawn beside a position without a value.

    Parameters
    ----------
    response : xarray.Dataset
        Response with ``delta`` (depth, y, x, state) and the coordinates in m; at least two x and two y.
    state : str
        Name of the state.
    depth : int
        Index of the depth in the dataset.
    ax : Axes, optional
        Axes to draw into, in mm.
    outlines : sequence of array_like, each of shape (m, 2)
        Corners of the coils in m from the same origin as x and y, first point not repeated.

    Raises
    ------
    ValueError
        If the dataset has no such state or depth, or the map has a single row.

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
    ax = ax or new_axes(*figure_size(*window.size))
    bands = _draw_map(ax, response, delta, window, scale)
    colour_bar(ax, bands, scale.unit.label("δ")).set_ticks(MaxNLocator(_TICKS, steps=_STEPS))
    plan_axes(ax)
    ax.set_title(f"Response of {state}, {MM.text(response.depth[depth])} deep")
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
        Name of the only state that is drawn; all by default.
    depth : int, optional
        Index of the only depth that is drawn; None for all.
    ax : Axes, optional
        Axes to draw into, mm across. Dotted lines mark the centres of the coils.
    along : {"x", "y"}
        Direction of the line; the other coordinate is the one nearest to zero.

    Raises
    ------
    ValueError
        If the dataset has no such state or depth.

    Examples
    --------
    >>> import numpy as np, xarray as xr
    >>> x = np.linspace(-20e-3, 20e-3, 21)
    >>> delta = 1e-3 * np.exp(-((x / 8e-3) ** 2))[None, None, :, None]
    >>> coil = {"state": ["coil1"], "coil": ["coil1"], "coil_x": ("coil", [0.0]), "coil_y": ("coil", [0.0])}
    >>> axes = {"depth": [1e-3], "y": [0.0], "x": x}
    >>> ax = plot_response_profile(xr.Dataset({"delta": (("depth", "y", "x", "state"), delta)}, axes | coil))
    >>> round(float(ax.lines[0].get_ydata().max()), 3), ax.get_ylabel()
    (1.0, 'δ (10⁻³)')
    """
    across = "y" if along == "x" else "x"
    delta = _delta(response, state=state, depth=depth)
    row = delta.isel({across: int(np.abs(delta[across].values).argmin())})
    shown = axis_unit(row)
    ax = ax or new_axes(*_PROFILE)
    at = MM.of(row[along])
    states = np.atleast_1d(row.state.values).tolist()
    depths = np.atleast_1d(row.depth.values).tolist()
    curves = [(name, value, row.sel(_kept(row, state=name, depth=value)).values) for value in depths for name in states]
    for k, (name, value, values) in enumerate(curves):
        deep = MM.text(value)
        label = name if len(depths) == 1 else deep if len(states) == 1 else f"{name}, {deep}"
        ax.plot(at, shown.of(values), label=label, marker="o" if at.size == 1 else "", **curve_look(k))
    zero_line(ax)
    for centre in MM.of(response[f"coil_{along}"]).tolist():
        if at.min() <= centre <= at.max():
            ax.axvline(centre, color=PALE, linewidth=0.8, linestyle=":", zorder=0)
    if at.size > 1:
        ax.set_xlim(at.min(), at.max())
    title = f"Response at {across} = {MM.text(row[across])}"
    title += "" if state is None else f", {state}"
    title += "" if depth is None else f", {MM.text(response.depth[depth])} deep"
    ax.set(xlabel=MM.label(along), ylabel=shown.label("δ"), title=title)
    legend_beside(ax, math.ceil(len(curves) / 16))
    return ax


@styled
def plot_bell_curve(
    response: xr.Dataset, state: str | None = None, ax: Axes | None = None, along: Literal["x", "y"] = "x"
) -> Axes:
    """Draw δ of one coil along a line through its centre for every depth, with its peak and its width at half of it.

    Dots are the positions of the response, curves cubic splines through those that have a value. A bar marks the width
    at half the peak. The legend gives both, without the width where δ does not fall to half on both sides.

    Parameters
    ----------
    response : xarray.Dataset
        Result of `coilarray.response_map` or `coilarray.response.two_dimensional` with at least two positions along the
        line.
    state : str, optional
        Name of the state of a map; by default the one with the largest δ for the deepest dent in the middle of the map.
    ax : Axes, optional
        Axes to draw into, mm across. A dotted line marks the centre of the coil.
    along : {"x", "y"}
        Direction of the line; on a map the other coordinate is the one nearest to the centre of the coil.

    Raises
    ------
    ValueError
        If the map has no such state, or fewer than two positions have a value.

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
    shown = axis_unit(rows)
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
        label = true_minus(f"{MM.text(depth)}: {peak}{width}")
        ax.plot(at, values, ".", color=look["color"], markersize=4)
        ax.plot(fine, delta(fine), label=label, **look)
        if width:
            ax.plot([left, right], [top / 2, top / 2], "|-", color=look["color"], linewidth=0.8, markersize=7)
    zero_line(ax)
    if centre is not None:
        ax.axvline(float(MM.of(centre)), color=PALE, linewidth=0.8, linestyle=":", zorder=0)
    ax.set_xlim(at[0], at[-1])
    faint_grid(ax)
    ax.set(xlabel=MM.label(along), ylabel=shown.label("δ"), title=f"Bell curve of {name}" if name else "Bell curve")
    legend_beside(ax, title="depth: peak, width")
    return ax


@styled
def response_figure(response: xr.Dataset, outlines: Sequence[npt.ArrayLike] = ()) -> Figure:
    """Draw the response to the deepest dent, one map per state with a common colour bar.

    A response along a single line, or at a single position, is drawn as one curve per state instead. At most
    `MOST_MAPS` states are shown, those in the middle.

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
    """Sides of a map in mm, and the outlines of the coils in m."""

    x: tuple[float, float]
    y: tuple[float, float]
    outlines: Sequence[npt.ArrayLike]

    @property
    def size(self) -> tuple[float, float]:
        return self.x[1] - self.x[0], self.y[1] - self.y[0]


@dataclass(frozen=True)
class _Scale:
    """Unit of δ and, in it, the edges of the bands of colour and the |δ| below which a map is white."""

    unit: AxisUnit
    levels: FloatArray
    nothing: float


def _maps(response: xr.Dataset, outlines: Sequence[npt.ArrayLike], note: str) -> Figure:
    """Draw one map of the deepest dent for each state, and one colour bar."""
    names = response.state.values.tolist()
    deepest = _delta(response, state=None, depth=-1)
    window, scale = _window(response, outlines), _scale(deepest.values)
    across, up = window.size
    columns = _columns(len(names), across / up)
    rows = math.ceil(len(names) / columns)
    width, height = figure_size(columns * across, rows * up)
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
    figure.suptitle(f"Response, {MM.text(response.depth[-1])} deep{note}", x=0.01, ha="left", fontsize="large")
    return figure


def _columns(count: int, shape: float) -> int:
    """Choose the number of columns that brings a grid of maps, each of this width over height, near `_GRID_SHAPE`."""

    def misfit(columns: int) -> float:
        return abs(math.log(columns * shape / math.ceil(count / columns) / _GRID_SHAPE))

    return min(range(1, count + 1), key=misfit)


def _draw_map(ax: Axes, response: xr.Dataset, delta: xr.DataArray, window: _Window, scale: _Scale) -> QuadContourSet:
    """Fill axes in mm with δ (y, x), its zero line, and the coils with their names."""
    x, y = MM.of(delta.x), MM.of(delta.y)
    values = scale.unit.of(delta)
    bands = ax.contourf(x, y, values, levels=scale.levels, cmap=DIVERGING)
    # a change of sign among positions without a response means nothing
    felt = np.ma.array(values, mask=maximum_filter(np.abs(np.nan_to_num(values)), 3) < scale.nothing)
    felt = np.ma.masked_invalid(felt)
    if felt.count() and felt.min() < 0 < felt.max():
        ax.contour(x, y, felt, levels=[0.0], colors=INK, linewidths=0.8, linestyles="--")
    draw_outlines(ax, window.outlines)
    _name_coils(ax, response, x)
    ax.set(xlim=window.x, ylim=window.y, aspect="equal")
    return bands


def _scale(delta: FloatArray) -> _Scale:
    """Choose the power of ten, and bands of colour symmetric about zero."""
    unit = axis_unit(delta, "1")
    limit = largest(unit.of(delta))
    levels = np.asarray(MaxNLocator(_BANDS, symmetric=True, steps=_STEPS).tick_values(-limit, limit))
    nothing = _NOTHING * limit
    edges = np.sort(np.r_[levels[levels != 0], -nothing, nothing])
    return _Scale(unit, edges, nothing)


def _window(response: xr.Dataset, outlines: Sequence[npt.ArrayLike]) -> _Window:
    """Return the window that shows the whole map and, in height, the coils that it touches."""
    x, y = MM.of(response.x), MM.of(response.y)
    shapes = [MM.of(outline) for outline in outlines]
    touched = [s for s in shapes if s[:, 0].min() < x.max() and s[:, 0].max() > x.min()]
    edges = np.concatenate([y, *(shape[:, 1] for shape in touched)])
    rim = 0.02 * np.ptp(edges)
    return _Window((float(x.min()), float(x.max())), (float(edges.min() - rim), float(edges.max() + rim)), outlines)


def _name_coils(ax: Axes, response: xr.Dataset, x: FloatArray) -> None:
    """Write the names of the coils at those centres that lie within the map."""
    names, centres = response.coil.values.tolist(), (MM.of(response.coil_x), MM.of(response.coil_y))
    for name, at, across in zip(names, *centres, strict=True):
        if x.min() < at < x.max():
            write_name(ax, at, across, name, fontsize=8)


def _delta(response: xr.Dataset, *, state: str | None, depth: int | None) -> xr.DataArray:
    """Return δ of one state or of all, at one depth or at all."""
    chosen = response if state is None else of_state(response, state)
    delta: xr.DataArray = (chosen if depth is None else at_depth(chosen, depth)).delta
    return delta


def _kept(row: xr.DataArray, **labels: object) -> dict[str, object]:
    """Return the labels of the dimensions that are not selected yet."""
    return {name: label for name, label in labels.items() if name in row.dims}


def _bell(response: xr.Dataset, state: str | None, along: str) -> tuple[xr.DataArray, float | None, str]:
    """Return δ (depth, along) of a state on the line nearest to its coil, the coil's place on it in m, and the name."""
    if "state" not in response.dims:  # the two-dimensional model, which has one coil
        return response.delta.transpose("depth", along), None, str(response.attrs.get("coil", ""))
    name = _in_the_middle(response) if state is None else state
    delta = _delta(response, state=name, depth=None)
    across = "y" if along == "x" else "x"
    of_coil = response.sel(coil=name) if name in response.coil.values else None
    beside = 0.0 if of_coil is None else float(of_coil[f"coil_{across}"])
    row = delta.isel({across: int(np.abs(delta[across].values - beside).argmin())})
    return row.transpose("depth", along), None if of_coil is None else float(of_coil[f"coil_{along}"]), name


def _in_the_middle(response: xr.Dataset) -> str:
    """Return the name of the state with the largest δ for the deepest dent in the middle of a map."""
    middle = {axis: response.sizes[axis] // 2 for axis in ("x", "y")}
    there = response.delta.isel(depth=-1, **middle).fillna(-np.inf)
    return str(response.state.values[int(there.argmax("state"))])


def _half_width(delta: CubicSpline, fine: FloatArray) -> tuple[float, float]:
    """Return the places left and right of the peak where a curve falls to half of it; NaN where it does not."""
    values = delta(fine)
    peak, half = int(values.argmax()), float(values.max()) / 2
    crossings = delta.solve(half, extrapolate=False)
    left, right = crossings[crossings < fine[peak]], crossings[crossings > fine[peak]]
    if half <= 0 or not left.size or not right.size:
        return math.nan, math.nan
    return float(left.max()), float(right.min())
