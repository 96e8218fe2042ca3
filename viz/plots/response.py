"""Figures of the sensor response, and of the indentation behind it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter

from coilarray.circuit.converter_limits import readable_of
from coilarray.compute.display_units import MM, DisplayUnit, true_minus
from coilarray.geometry.elastomer import Indenter
from coilarray.response.dataset import answering_states, as_depths, depth_words, main_line, middle_state
from coilarray.viz import palette
from coilarray.viz.datasets.meshes import indenter_outline
from coilarray.viz.datasets.results import at_depth, of_state
from coilarray.viz.plots import style

MOST_MAPS = 16
"""Largest number of states in `response_figure`."""

_BANDS, _TICKS = 20, 9  # largest numbers of bands of colour, and of ticks beside them
_STEPS = (1, 2, 5, 10)
_FELT = 0.05  # share of the largest |δ| on a line below which a state has no curve
_NAME_AT = 0.2  # of the way from the lower end of a coil to its centre
_MOST_NAMES = 9  # largest number of coils with their names on every map; the title of a map names its own coil
_NOTHING = 0.01  # share of the largest δ below which a map is white and has no zero line
_GRID_SHAPE = 1.4  # width over height of all maps together
_PROFILE = (7.5, 3.6)  # inches
_SMOOTH = 400  # points of a curve between the samples
_SHOWN = {
    "delta": "|δ|",
    "effective_inductance": "effective inductance",
    "quality_factor": "quality factor",
    "frequency": "resonance frequency",
}
_MOST_STATES = 8  # curves of a panel of a target
_LOGARITHMIC = 30.0  # last over first distance above which their axis is logarithmic


@style.styled
def plot_response(
    response: xr.Dataset, state: str, depth: int = 0, ax: Axes | None = None, outlines: Sequence[npt.ArrayLike] = ()
) -> Axes:
    """Draw a map of δ of one state.

    The `response` has ``delta`` (depth, y, x, state) and the coordinates in m, with at least two x
    and two y. The name of a `state` and the index of a `depth` are drawn over the position of the
    indenter, with the `outlines` of the coils, corners (m, 2) in m from the same origin as x and y,
    first point not repeated. The colours are symmetric about zero, or start at zero for values of
    one sign. They are white if |δ| is below 1 % of its maximum. A dashed line marks the change of
    sign. Between the positions δ is interpolated linearly. Nothing is drawn beside a position
    without a value. Raises ValueError if the dataset has no such state or depth, or the map has a
    single row.
    """
    delta = _delta(response, state=state, depth=depth).transpose("y", "x")
    if min(delta.shape) < 2:
        raise ValueError(f"a map must have at least two x and two y; got {delta.shape[1]} and {delta.shape[0]}.")
    look = _look(response, delta, outlines)
    ax = ax or style.new_axes(*style.figure_size(*look.size))
    bands = _draw_map(ax, response, delta, look)
    style.colour_bar(ax, bands, look.unit.label("δ")).set_ticks(MaxNLocator(_TICKS, steps=_STEPS))
    style.plan_axes(ax)
    ax.set_title(f"Response of {state}, {depth_words(response, depth)}")
    return ax


@style.styled
def plot_response_profile(
    response: xr.Dataset,
    state: str | None = None,
    depth: int | None = 0,
    ax: Axes | None = None,
    along: Literal["x", "y"] = "x",
) -> Axes:
    """Draw δ along a line.

    The line runs `along` x or y where |δ| of the `state` is the largest, or of the middle state if
    all are drawn. There is a curve for each state and depth that is not fixed by the name of a
    state or the index of a `depth`. States without a response on it are left out. The `response` is
    as in `plot_response`. A single position is drawn as a dot. Dotted lines mark the centres of the
    coils. Raises ValueError if the dataset has no such state or depth.
    """
    across = "y" if along == "x" else "x"
    delta = _delta(response, state=state, depth=depth)
    row = delta.isel({across: main_line(response, along, state)})
    if state is None:
        size = np.abs(np.nan_to_num(row.transpose("state", ...).values)).reshape(row.sizes["state"], -1).max(axis=1)
        row = row.isel(state=np.flatnonzero(size >= _FELT * size.max()))
    shown = style.axis_unit(row)
    ax = ax or style.new_axes(*_PROFILE)
    at = MM.of(row[along])
    row = row.expand_dims([axis for axis in ("depth", "state") if axis not in row.dims])
    states, depths = row.state.values.tolist(), row.depth.values.tolist()
    colours = style.state_colours(response, states)
    curves = [(name, value, row.sel(state=name, depth=value).values) for value in depths for name in states]
    for k, (name, value, values) in enumerate(curves):
        deep = MM.text(value)
        label = name if len(depths) == 1 else deep if len(states) == 1 else f"{name}, {deep}"
        look = palette.curve_look(k)
        if len(depths) == 1:
            look["color"] = colours[name]
        ax.plot(at, shown.of(values), label=label, marker="o" if at.size == 1 else "", **look)
    style.zero_line(ax)
    for centre in MM.of(response[f"coil_{along}"]).tolist():
        if at.min() <= centre <= at.max():
            ax.axvline(centre, color=palette.PALE, linewidth=0.8, linestyle=":", zorder=0)
    if at.size > 1:
        ax.set_xlim(at.min(), at.max())
    title = f"Response at {across} = {MM.text(row[across])}"
    title += "" if state is None else f", {state}"
    title += "" if depth is None else f", {depth_words(response, depth)}"
    ax.set(xlabel=MM.label(along), ylabel=shown.label("δ"), title=title)
    style.legend_beside(ax)
    return ax


@style.styled
def plot_bell_curve(
    response: xr.Dataset, state: str | None = None, ax: Axes | None = None, along: Literal["x", "y"] = "x"
) -> Axes:
    """Draw δ along a line through a coil's centre.

    Each depth has a curve with its peak and its width at half the peak. Dots are the positions of
    the response, and curves are cubic splines through the positions with a value. A bar marks the
    width at half the peak. The legend gives both, without a width if δ does not fall to half. A
    dotted line marks the centre of the coil.

    The `response` of `coilarray.response_map` or `coilarray.paper.two_dimensional.line_response`
    has two positions or more. The `state` is by default the state that responds nearest to the
    middle of the map. The line runs `along` x or y, at the other coordinate nearest to the centre
    of the coil. Raises ValueError if the map has no such state, or fewer than two positions have a
    value.
    """
    name, across = middle_state(response) if state is None else state, "y" if along == "x" else "x"
    delta = _delta(response, state=name, depth=None)
    of_coil = response.sel(coil=name) if name in response.coil.values else None
    beside = 0.0 if of_coil is None else float(of_coil[f"coil_{across}"])
    rows = delta.isel({across: int(np.abs(delta[across].values - beside).argmin())}).transpose("depth", along)
    at = MM.of(rows[along])
    most = int(np.isfinite(rows.values).sum(axis=1).max())
    if most < 2:
        raise ValueError(f"a curve must have at least two {along} with a value; got {most}.")
    shown = style.axis_unit(rows)
    ax = ax or style.new_axes(*_PROFILE)
    for k, depth in enumerate(rows.depth.values.tolist()):
        values = shown.of(rows.isel(depth=k))
        there = np.isfinite(values)
        if there.sum() < 2:
            continue
        spline = CubicSpline(at[there], values[there])
        fine = np.linspace(at[there][0], at[there][-1], _SMOOTH)
        look = palette.curve_look(k)
        top, (left, right) = float(spline(fine).max()), _half_width(spline, fine)
        width = "" if math.isnan(right - left) else f", {right - left:.1f} mm"
        edge = ", at the edge" if int(spline(fine).argmax()) in (0, _SMOOTH - 1) else ""
        peak = f"{top:.3g} × {shown.symbol}" if shown.symbol else f"{top:.3g}"
        label = true_minus(f"{MM.text(depth)}: {peak}{edge}{width}")
        ax.plot(at, values, ".", color=look["color"], markersize=4)
        ax.plot(fine, spline(fine), label=label, **look)
        if width:
            ax.plot([left, right], [top / 2, top / 2], "|-", color=look["color"], linewidth=0.8, markersize=7)
    style.zero_line(ax)
    if of_coil is not None:
        centre = float(MM.of(of_coil[f"coil_{along}"]))
        ax.axvline(centre, color=palette.PALE, linewidth=0.8, linestyle=":", zorder=0)
    ax.set_xlim(at[0], at[-1])
    style.faint_grid(ax)
    ax.set(xlabel=MM.label(along), ylabel=shown.label("δ"), title=f"Bell curve of {name}")
    style.legend_beside(ax, title="depth: peak, width")
    return ax


@style.styled
def response_figure(response: xr.Dataset, outlines: Sequence[npt.ArrayLike] = ()) -> Figure:
    """Draw one map per state with a common colour bar.

    The maps are the response to the deepest dent or the nearest target. A response along a single
    line, or at a single position, is drawn as one curve per state instead. At most `MOST_MAPS`
    states are shown. If more states respond, the nearest to the middle of the map are chosen. The
    `response` and the `outlines` are as in `plot_response`, with any number of x and y.
    """
    response = as_depths(response)
    names = response.state.values.tolist()
    shown = response.isel(state=answering_states(response, MOST_MAPS))
    note = f" ({MOST_MAPS} of {len(names)} states, those nearest to the middle)" if len(names) > MOST_MAPS else ""
    if min(response.sizes["x"], response.sizes["y"]) > 1:
        return _maps(shown, outlines, note)
    figure = style.new_figure(*_PROFILE)
    along: Literal["x", "y"] = "y" if response.sizes["y"] > 1 else "x"
    ax = plot_response_profile(shown, None, -1, figure.add_subplot(), along)
    ax.set_title(ax.get_title(loc="left") + note)
    return figure


@dataclass(frozen=True)
class _Look:
    """Common look of maps: sides in mm, unit of δ, edges of bands.

    Maps are white below a |δ| in this unit.
    """

    outlines: Sequence[npt.ArrayLike]  # m
    x: tuple[float, float]
    y: tuple[float, float]
    unit: DisplayUnit
    colours: str
    levels: npt.NDArray[np.float64]
    nothing: float

    @property
    def size(self) -> tuple[float, float]:
        return self.x[1] - self.x[0], self.y[1] - self.y[0]


def _maps(response: xr.Dataset, outlines: Sequence[npt.ArrayLike], note: str) -> Figure:
    names = response.state.values.tolist()
    deepest = _delta(response, state=None, depth=-1)
    look = _look(response, deepest, outlines)
    across, up = look.size

    def misfit(columns: int) -> float:
        """Distance from a good shape, and the share of empty places."""
        rows = math.ceil(len(names) / columns)
        shape = abs(math.log(columns * across / up / rows / _GRID_SHAPE))
        return shape + 2 * (rows * columns - len(names)) / len(names)

    columns = min(range(1, len(names) + 1), key=misfit)
    rows = math.ceil(len(names) / columns)
    width, height = style.figure_size(columns * across, rows * up)
    figure = style.new_figure(width, height + 0.3 * rows, layout="compressed")  # room for the names of the states
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    cells = axes.ravel().tolist()
    for ax, name in zip(cells, names, strict=False):
        bands = _draw_map(ax, response, deepest.sel(state=name).transpose("y", "x"), look)
        ax.set_title(name)
    for ax in cells[len(names) :]:
        ax.remove()
    for ax in cells[len(names) - columns : len(names)]:  # the lowest map of every column
        ax.xaxis.set_tick_params(labelbottom=True)
        ax.set_xlabel(MM.label("x"))
    for ax in axes[:, 0]:
        ax.set_ylabel(MM.label("y"))
    bar = figure.colorbar(bands, ax=cells[: len(names)], spacing="proportional", aspect=40, fraction=0.05, pad=0.02)
    bar.set_ticks(MaxNLocator(_TICKS, steps=_STEPS))
    bar.set_label(look.unit.label("δ"))
    style.main_title(figure, f"Response, {depth_words(response, -1)}{note}")
    return figure


def _draw_map(ax: Axes, response: xr.Dataset, delta: xr.DataArray, look: _Look) -> QuadContourSet:
    """Draw δ (y, x) with its zero line in mm."""
    x, y = MM.of(delta.x), MM.of(delta.y)
    values = look.unit.of(delta)
    bands = ax.contourf(x, y, values, levels=look.levels, cmap=look.colours)
    bands.set_rasterized(True)
    style.VALUES[ax] = style.map_values(x, y, values, look.unit.label("δ"), response.sizes["state"])
    # A change of sign among positions without a response has no meaning.
    felt = np.ma.array(values, mask=maximum_filter(np.abs(np.nan_to_num(values)), 3) < look.nothing)
    felt = np.ma.masked_invalid(felt)
    if felt.count() and felt.min() < 0 < felt.max():
        ax.contour(x, y, felt, levels=[0.0], colors=palette.ON_MAP, linewidths=0.8, linestyles="--")
    read = readable_of(response)
    read = read.sel({name: delta[name] for name in ("depth", "state") if name in read.dims and name in delta.coords})
    if not read.all():
        unread = (~read).transpose("y", "x").values.astype(float)
        ax.contourf(x, y, unread, levels=[0.5, 1.5], colors="none", hatches=["////"])
    style.draw_outlines(ax, look.outlines)
    shapes = [MM.of(outline) for outline in look.outlines]
    names, places = response.coil.values.tolist(), np.column_stack((MM.of(response.coil_x), MM.of(response.coil_y)))
    for name, (at, up) in zip(names, places.tolist(), strict=True):
        if len(names) <= _MOST_NAMES and x.min() < at < x.max():
            # towards the lower end of the coil, as its peak is in the middle
            own = min(shapes, key=lambda shape: float(np.hypot(*(shape.mean(axis=0) - (at, up)))), default=None)
            low = look.y[0] if own is None else float(own[:, 1].min()) * (1 - _NAME_AT) + _NAME_AT * up
            style.write_name(ax, at, low, name, fontsize=8)
    ax.set(xlim=look.x, ylim=look.y, aspect="equal")
    return bands


def _look(response: xr.Dataset, delta: xr.DataArray, outlines: Sequence[npt.ArrayLike]) -> _Look:
    x, y = MM.of(response.x), MM.of(response.y)
    shapes = [MM.of(outline) for outline in outlines]
    low, high = (x.min(), y.min()), (x.max(), y.max())
    touched = [shape for shape in shapes if (shape.min(axis=0) < high).all() and (shape.max(axis=0) > low).all()]
    edges = np.concatenate([y, *(shape[:, 1] for shape in touched)])
    rim = 0.02 * np.ptp(edges)
    unit = style.axis_unit(delta, "1")
    colours, least, most = palette.signed_colours(unit.of(delta), share=_NOTHING)
    levels = np.asarray(MaxNLocator(_BANDS, symmetric=least == -most, steps=_STEPS).tick_values(least, most))
    nothing = _NOTHING * max(-least, most)
    edges_of_white = [edge for edge, end in ((-nothing, least), (nothing, most)) if end]
    levels = np.sort(np.r_[levels[levels != 0], edges_of_white])
    sides = (float(x.min()), float(x.max())), (float(edges.min() - rim), float(edges.max() + rim))
    return _Look(outlines, *sides, unit, colours, levels, nothing)


def _delta(response: xr.Dataset, *, state: str | None, depth: int | None) -> xr.DataArray:
    chosen = response if state is None else of_state(response, state)
    delta: xr.DataArray = (chosen if depth is None else at_depth(chosen, depth)).delta
    return delta


def _half_width(delta: CubicSpline, fine: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Places where a curve falls to half its peak, or NaN."""
    values = delta(fine)
    peak, half = int(values.argmax()), float(values.max()) / 2
    crossings = delta.solve(half, extrapolate=False)
    left, right = crossings[crossings < fine[peak]], crossings[crossings > fine[peak]]
    if half <= 0 or not left.size or not right.size:
        return math.nan, math.nan
    return float(left.max()), float(right.min())


@style.styled
def plot_target(response: xr.Dataset, quantity: str = "delta", ax: Axes | None = None) -> Axes:
    """Draw a quantity against the distance of a target.

    The `response` of `coilarray.target_map` has a curve per state, at the place where the target
    changes it the most. Values that no converter can read are crossed. The `quantity` is ``delta``,
    whose magnitude is drawn on a logarithmic axis beside the noise, or ``effective_inductance``,
    ``quality_factor`` or ``frequency``, with a dotted line for each value without the target.
    Raises ValueError if the quantity is none of these.
    """
    if quantity not in _SHOWN:
        raise ValueError(f"quantity must be one of {', '.join(_SHOWN)}; got {quantity!r}.")
    states = answering_states(as_depths(response), _MOST_STATES)
    values = np.stack([_along(response, quantity, state) for state in states], axis=-1)
    base = None if quantity == "delta" else response[f"base_{quantity.removeprefix('effective_')}"].values[states]
    names = response.state.values[states].tolist()
    shown = style.axis_unit(response[quantity])
    ax = ax or style.new_axes(6.5, 3.6)
    distance, colours = MM.of(response.distance), style.state_colours(response, names)
    for k, name in enumerate(names):
        look = palette.curve_look(k) | {"color": colours[name]}
        drawn = np.abs(values[:, k]) if quantity == "delta" else shown.of(values[:, k])
        ax.plot(distance, drawn, label=name, marker="o", markersize=3.0, **look)
        if "readable" in response and (unread := ~_along(response, "readable", states[k]).astype(bool)).any():
            label = "not readable" if "not readable" not in [one.get_label() for one in ax.lines] else None
            ax.plot(distance[unread], drawn[unread], "x", color=palette.GREY, markersize=9.0, zorder=5, label=label)
        if base is not None:
            ax.axhline(float(shown.of(base[k])), color=colours[name], linewidth=0.8, linestyle=":", zorder=0)
    if base is not None:
        ax.plot([], [], color=palette.GREY, linewidth=0.8, linestyle=":", label="without the target")
    if quantity == "delta":
        ax.set_yscale("log")
        noise = float(response.attrs.get("sigma", response.attrs["noise"]))
        ax.axhline(noise, color=palette.GREY, linewidth=1.2, linestyle=":", label="noise")
    else:
        ax.ticklabel_format(axis="y", useOffset=False)
    if distance[-1] > _LOGARITHMIC * distance[0]:
        ax.set_xscale("log")
        style.logarithmic_ticks(ax.xaxis, math.log10(distance[-1] / distance[0]))
    label = _SHOWN[quantity] if quantity == "delta" else shown.label(_SHOWN[quantity])
    style.finish_curves(ax, MM.label("distance"), label)
    return ax


@style.styled
def target_figure(response: xr.Dataset) -> Figure:
    """Draw all quantities against the distance of a target.

    These are |δ|, inductance, quality factor and frequency. `response` is the result of
    `coilarray.target_map`. Every state is shown where the target changes it the most. If there are
    many states, the nearest to the middle of the map are shown.
    """
    figure = style.new_figure(9.5, 6.4)
    panels = figure.subplots(2, 2, sharex=True).ravel().tolist()
    for ax, quantity in zip(panels, _SHOWN, strict=True):
        plot_target(response, quantity, ax)
    for ax in panels[:2]:
        ax.set_xlabel("")
    style.one_legend(figure)
    words = f"{response.attrs['material'].replace('_', ' ')} {response.attrs['target']}"
    style.main_title(figure, f"Target: {words}")
    return figure


def _along(response: xr.Dataset, quantity: str, state: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Values (distance,) of a state at its best place."""
    of = response.isel(state=state)
    at = of[quantity].sel(x=float(of.best_x), y=float(of.best_y))
    return np.asarray(at.transpose("distance").values)


_WIDTH = 2.5  # stack thicknesses shown on each side of the indenter; the raised ring lies within two
_ABOVE, _BELOW = 0.45, 0.06  # thicknesses of the stack shown above its top and of the board
_FORCE_HEIGHT = 3.4  # inches


@style.styled
def plot_force_depth(indentation: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the force over the depth.

    The contact radius has an axis of its own at the right. `indentation` is the result of
    `coilarray.indent`.
    """
    ax = ax or style.new_axes(6.0, _FORCE_HEIGHT)
    depth = MM.of(indentation.depth)
    shown, name = style.axis_unit(indentation.force), _contact_name(indentation)
    (force,) = ax.plot(depth, shown.of(indentation.force), color=palette.BLUE, marker="o", markersize=4, label="force")
    right = ax.twinx()
    right.spines["right"].set_visible(True)
    look: dict[str, Any] = {"color": palette.VERMILLION, "linestyle": "--", "marker": "D", "markersize": 4}
    (radius,) = right.plot(depth, MM.of(indentation.contact_radius), label=name, **look)
    for axis in (ax, right):
        axis.set_ylim(bottom=0.0)
    ax.set_xlim(left=0.0)
    style.faint_grid(ax)
    title = f"Force over depth; base: {indentation.attrs['base']}"
    ax.set(xlabel=MM.label("depth"), ylabel=shown.label("force"), title=title)
    right.set_ylabel(MM.label(name))
    ax.legend(handles=[force, radius], loc="upper left")
    return ax


@style.styled
def plot_dent(indentation: xr.Dataset, indenter: Indenter, depth: int = -1, ax: Axes | None = None) -> Axes:
    """Draw the deformed sheets under the indenter in section.

    The section is mirrored about the axis of the `indenter` that made the dent. The flat sheets are
    dashed. `indentation` is as in `plot_force_depth`, and `depth` the index of a depth in it, by
    default the deepest. Raises ValueError if the dataset has no such depth.
    """
    at = at_depth(indentation, depth)
    height = MM.of(at.height)
    top = float(height[-1])
    half, ceiling = _section_half_width(indentation) * MM.factor, (1 + _ABOVE) * top
    ax = ax or style.new_axes(*_dent_size(indentation))
    names = at.interface.values.tolist()[1:]
    lines = []  # deformed interfaces on both sides in mm, shape (2 n − 1, 2)
    for k in range(len(height)):
        one = at.isel(interface=k)
        across, along = MM.of(one.r + one.displacement_r), MM.of(one.height + one.displacement_z)
        lines.append(np.column_stack((np.r_[-across[:0:-1], across], np.r_[along[:0:-1], along])))
    for k, (name, colour) in enumerate(palette.cycled(palette.SHEETS, names).items()):
        section = np.vstack((lines[k], lines[k + 1][::-1]))
        ax.add_patch(Polygon(section, facecolor=colour, alpha=0.5, edgecolor="none", label=name))
        ax.plot(*lines[k + 1].T, color=colour, linewidth=1.4)
        ax.hlines(height[k + 1], -half, half, color=colour, linewidth=0.8, linestyles="--")
    tip = top - float(at.depth) * MM.factor
    r, z = (MM.of(values) for values in indenter_outline(indenter, (ceiling - tip) / MM.factor))
    body = np.vstack((np.column_stack((-r[::-1], z[::-1] + tip)), np.column_stack((r, z + tip))))
    ax.add_patch(Polygon(body, facecolor="#C8C8C8", edgecolor=palette.INK, linewidth=1.0, label=indenter.name))
    ax.axhspan(-_BELOW * top, 0.0, color=palette.LAMINATE, linewidth=0, label="board")
    ax.set(xlim=(-half, half), ylim=(-_BELOW * top, ceiling), aspect="equal")
    ax.set(xlabel=MM.label("r" if at.attrs["symmetry"] == "axial" else "x"), ylabel=MM.label("z"))
    force, radius = style.axis_unit(at.force).text(at.force, ".3"), MM.text(at.contact_radius, ".3")
    title = f"{MM.text(at.depth)} deep: {force}, {_contact_name(at)} {radius}"
    ax.set_title(title, pad=22)  # points, room for the legend
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=6, borderpad=0, borderaxespad=0.4, handlelength=1.0)
    return ax


@style.styled
def indentation_figure(indentation: xr.Dataset, indenter: Indenter) -> Figure:
    """Draw the deepest dent.

    If there are several depths, the force over the depth is drawn below it. The `indentation` and
    the `indenter` are as in `plot_dent`.
    """
    width, height = _dent_size(indentation)
    heights = [height] if indentation.sizes["depth"] == 1 else [height, _FORCE_HEIGHT]
    figure = style.new_figure(width, sum(heights))
    axes = figure.subplots(len(heights), squeeze=False, height_ratios=heights).ravel()
    plot_dent(indentation, indenter, ax=axes[0])
    for ax in axes[1:]:
        plot_force_depth(indentation, ax=ax)
    return figure


def _section_half_width(indentation: xr.Dataset) -> float:
    """Half width of a section through the dent in m."""
    widest = float((indentation.r + indentation.displacement_r).max())
    return min(_WIDTH * float(indentation.height[-1]), widest)


def _dent_size(indentation: xr.Dataset) -> tuple[float, float]:
    """Size of a figure of the dent in inches."""
    width, height = style.figure_size(
        2 * _section_half_width(indentation), (1 + _ABOVE + _BELOW) * float(indentation.height[-1])
    )
    return width, height + 0.4  # for title and legend in two rows


def _contact_name(indentation: xr.Dataset) -> str:
    return "contact radius" if indentation.attrs["symmetry"] == "axial" else "half width of contact"
