"""Flat figures of the sensor response: maps of δ over the position of the indenter, and profiles through them."""

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
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator
from scipy.ndimage import maximum_filter

from coilarray.viz.datasets import at_depth
from coilarray.viz.palette import COILS, INK
from coilarray.viz.plots import colour_bar, figure_size, new_axes, prefix, styled

if TYPE_CHECKING:
    import xarray as xr

FloatArray = npt.NDArray[np.float64]

MOST_MAPS = 12
"""States that `response_figure` shows at most."""

_MM = 1e3  # mm in a metre
_BANDS, _TICKS = 20, 9  # of colour, and numbers beside them, at most
_STEPS = (1, 2, 5, 10)
_NOTHING = 0.01  # of the largest δ: below it a map is white and has no line of zero
_GRID_SHAPE = 1.4  # width over height of all maps together
_PROFILE = (7.5, 3.6)  # inches
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


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
    is where it changes its sign. Between the positions δ is taken as linear.

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
    """
    delta = _delta(response, state=state, depth=depth).transpose("y", "x")
    if min(delta.shape) < 2:
        raise ValueError(f"a map must have at least two x and two y; got {delta.sizes['x']} and {delta.sizes['y']}.")
    window = _window(response, outlines)
    scale = _scale(delta.values)
    ax = ax or new_axes(*figure_size(window.width, window.height))
    bands = _draw_map(ax, response, delta, window, scale)
    colour_bar(ax, bands, scale.label).set_ticks(MaxNLocator(_TICKS, steps=_STEPS))
    ax.set_xlabel("x (mm)")
    ax.set_ylabel("y (mm)")
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
    """
    across = "y" if along == "x" else "x"
    delta = _delta(response, state=state, depth=depth)
    row = delta.isel({across: int(np.abs(delta[across].values).argmin())})
    scale = _scale(row.values)
    ax = ax or new_axes(*_PROFILE)
    at = row[along].values * _MM
    states = np.atleast_1d(row.state.values).tolist()
    depths = np.atleast_1d(row.depth.values).tolist()
    curves = [(name, value, row.sel(_kept(row, state=name, depth=value)).values) for value in depths for name in states]
    for k, (name, value, values) in enumerate(curves):
        label = (
            name if len(depths) == 1 else f"{value * _MM:g} mm" if len(states) == 1 else f"{name}, {value * _MM:g} mm"
        )
        ax.plot(
            at,
            values * scale.factor,
            label=label,
            color=COILS[k % len(COILS)],
            linestyle=("-", "--", ":")[(k + k // len(COILS)) % 3],  # 18 different curves
            marker="o" if at.size == 1 else "",
        )
    ax.axhline(0.0, color="#909090", linewidth=0.8, zorder=0)
    for centre in response[f"coil_{along}"].values * _MM:
        if at.min() <= centre <= at.max():
            ax.axvline(centre, color="#B0B0B0", linewidth=0.8, linestyle=":", zorder=0)
    if at.size > 1:
        ax.set_xlim(at.min(), at.max())
    ax.set_xlabel(f"{along} (mm)")
    ax.set_ylabel(scale.label)
    fixed = [*([] if state is None else [state]), *([] if depth is None else [f"{_depth_text(response, depth)} deep"])]
    ax.set_title(", ".join([f"Response at {across} = {float(row[across]) * _MM:g} mm", *fixed]))
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), ncols=math.ceil(len(curves) / 16))
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
    """What a map shows, in mm: its sides, and the outlines of the coils."""

    x: tuple[float, float]
    y: tuple[float, float]
    outlines: tuple[FloatArray, ...]

    @property
    def width(self) -> float:
        return self.x[1] - self.x[0]

    @property
    def height(self) -> float:
        return self.y[1] - self.y[0]


@dataclass(frozen=True)
class _Scale:
    """Factor and name of an axis of δ, the edges of its bands of colour, and what counts as nothing, both scaled."""

    factor: float
    label: str
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
        ax.set_xlabel("x (mm)")
    for ax in axes[:, 0]:
        ax.set_ylabel("y (mm)")
    bar = figure.colorbar(bands, ax=cells[: len(names)], spacing="proportional", aspect=40, fraction=0.05, pad=0.02)
    bar.set_ticks(MaxNLocator(_TICKS, steps=_STEPS))
    bar.set_label(scale.label)
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
    x, y = (delta[axis].values * _MM for axis in ("x", "y"))
    values = delta.values * scale.factor
    bands = ax.contourf(x, y, values, levels=scale.levels, cmap="RdBu_r")
    # a change of sign among positions that feel nothing means nothing
    felt = np.ma.array(values, mask=maximum_filter(np.abs(values), 3) < scale.nothing)
    if felt.count() and felt.min() < 0 < felt.max():
        ax.contour(x, y, felt, levels=[0.0], colors=INK, linewidths=0.8, linestyles="--")
    for outline in window.outlines:
        ax.add_patch(Polygon(outline, closed=True, facecolor="none", edgecolor=INK, linewidth=0.8))
    _name_coils(ax, response, x)
    ax.set_xlim(*window.x)
    ax.set_ylim(*window.y)
    ax.set_aspect("equal")
    return bands


def _scale(delta: FloatArray) -> _Scale:
    """Give the power of ten that brings the largest of pure numbers between 1 and 1000, and bands about zero."""
    factor, _ = prefix(delta, "")
    exponent = -round(math.log10(factor))
    limit = float(np.abs(delta).max()) * factor or 1.0
    levels = np.asarray(MaxNLocator(_BANDS, symmetric=True, steps=_STEPS).tick_values(-limit, limit))
    nothing = _NOTHING * limit
    edges = np.sort(np.r_[levels[levels != 0], -nothing, nothing])
    return _Scale(factor, f"δ (10{str(exponent).translate(_SUPERSCRIPT)})" if exponent else "δ", edges, nothing)


def _window(response: xr.Dataset, outlines: Sequence[npt.ArrayLike]) -> _Window:
    """Show the whole map and, in height, the coils that it touches."""
    x, y = (response[axis].values * _MM for axis in ("x", "y"))
    shapes = tuple(np.asarray(outline, dtype=np.float64) * _MM for outline in outlines)
    touched = [s for s in shapes if s[:, 0].min() < x.max() and s[:, 0].max() > x.min()]
    edges = np.concatenate([y, *(shape[:, 1] for shape in touched)])
    rim = 0.02 * np.ptp(edges)
    return _Window((float(x.min()), float(x.max())), (float(edges.min() - rim), float(edges.max() + rim)), shapes)


def _name_coils(ax: Axes, response: xr.Dataset, x: FloatArray) -> None:
    """Write the names of the coils at those centres that lie within the map."""
    for name, at, across in zip(
        response.coil.values.tolist(), response.coil_x.values * _MM, response.coil_y.values * _MM, strict=True
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
    return f"{float(dataset.depth[depth]) * _MM:g} mm"
