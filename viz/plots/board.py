"""Plans of a board: copper of layers and narrowest places."""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np
import shapely
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch, PathPatch
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator

from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import MM, PLAIN, DisplayUnit, number_text, true_minus
from coilarray.fabrication.board import BoardCopper
from coilarray.fabrication.nets import board_layers
from coilarray.fabrication.traced_coil import TracedCoil
from coilarray.geometry import Coil, FinitePlate, Plate, Sheet, Stackup
from coilarray.geometry.array import Array
from coilarray.geometry.copper import Drill, board_outline, copper_features, drills
from coilarray.geometry.rules import Margin
from coilarray.viz.palette import GREY, INK, LAMINATE, LAYERS, METAL, METALS, SHEETS, coil_colours, cycled
from coilarray.viz.plots.style import figure_size, legend_above, new_axes, new_figure, plan_axes, styled, write_name

_TOGETHER = 0.025  # of the board's diagonal; nearer places share a circle
_VIEW = 10.0  # width of an enlarged place over its limit or value, whichever is larger
_LEAST_VIEW = 1e-3  # m
_MOST_ROWS = 4  # of layers in a picture
_BROKEN = "#B00020"
_LETTERS, _LEAST_LETTERS = 9.0, 3.5  # heights of names in points
MICROMETRES = DisplayUnit("µm", 1e6)
_ACROSS, _HIGHEST = 5.2, 1.3  # inches of a view with sizes, and its height over its width
_SHEER = 0.45
_FILLED = 1.02  # of a gap
_TRACES = 0.75  # height of a layer of traces in a section, over the others
_ALONG = 1e-3  # of the largest distance, less along x is none
_LETTER_OF_PITCH = 0.2  # height over the distance of neighbours; names of six letters do not overlap


@styled
def plot_copper(array: Array, layer: str, ax: Axes | None = None) -> Axes:
    """Draw the copper of one layer in mm.

    Each coil of the `array` has its own colour and its name. Holes and the edge of the board are drawn too. Raises
    GeometryError if the board has no such layer.
    """
    array.stackup.index(layer)
    colours = coil_colours(array.names, array.centres)
    features = [feature for feature in copper_features(array) if feature.layer == layer]
    drawn = [(feature.shape, colours[feature.net]) for feature in features]
    holes = [drill for drill in drills(array) if layer in drill.layers]
    named = {feature.net for feature in features if feature.kind == "trace"}
    return _draw_board(array, drawn, holes, named, f"Copper {layer}", ax)


@styled
def plot_board(array: Array, ax: Axes | None = None) -> Axes:
    """Draw an `array` from above with its sizes in mm.

    Arrows measure the board, the copper of the first coil, and its distance to the nearest coil.
    Windings are filled translucent areas in the colours of their layers.
    """
    x_min, y_min, x_max, y_max = MM.of(array.bounds).tolist()
    rim = 0.05 * max(x_max - x_min, y_max - y_min)
    limits = (x_min - rim, x_max + 2.6 * rim), (y_min - 3.2 * rim, y_max + 2.2 * rim)
    if ax is None:
        width, height = (high - low for low, high in limits)
        ax = new_axes(_ACROSS, _ACROSS * min(height / width, _HIGHEST))
    colours = cycled(LAYERS, array.stackup.names)
    bands = [
        (array.stackup.index(layer), band)
        for place in array.placements
        for line, layer in zip(place.coil.lines, place.layers, strict=True)
        for band in _bands(place.to_board(line), place.coil)
    ]
    bands.sort(key=itemgetter(0), reverse=True)  # the uppermost layer last
    drawn = [(band, colours[array.stackup.names[layer]]) for layer, band in bands]
    _draw_board(array, drawn, [one for one in drills(array) if one.drilled], set(array.names), "", ax, alpha=_SHEER)
    corners = MM.of(array.placements[0].to_board(array.placements[0].coil.outline))
    (x_left, y_low), (x_right, _) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    _measure(ax, (x_min, y_min - 2.2 * rim), (x_max, y_min - 2.2 * rim), y_min)
    _measure(ax, (x_left, y_min - rim), (x_right, y_min - rim), y_low)
    _measure(ax, (x_max + rim, y_min), (x_max + rim, y_max), x_max)
    centres = MM.of(array.centres)
    if len(centres) > 1:
        apart = np.hypot(*(centres - centres[0]).T)
        near = centres[np.argsort(apart, kind="stable")[1]]
        level = y_max + rim
        if abs(near[0] - centres[0, 0]) > _ALONG * apart.max():
            _measure(ax, (centres[0, 0], level), (near[0], level), float(centres[0, 1]))
    ax.set(xlim=limits[0], ylim=limits[1], xlabel="", ylabel="")
    ax.set_axis_off()
    handles = [Patch(color=colour, label=f"copper {layer}", alpha=_SHEER, lw=0) for layer, colour in colours.items()]
    legend_above(ax, min(len(handles), 4), handles=handles, handlelength=1.0)
    return ax


def _bands(line: FloatArray, coil: Coil) -> list[shapely.Polygon]:
    """Areas of turns with the gaps between them filled."""
    closed = _FILLED * coil.gap / 2
    path = shapely.LineString(line).buffer(coil.trace_width / 2 + closed, join_style="mitre")
    return list(shapely.get_parts(path.buffer(-closed, join_style="mitre").simplify(coil.trace_width / 4)))


def _measure(ax: Axes, start: tuple[float, float], end: tuple[float, float], edge: float) -> None:
    """Draw an arrow in mm with its length, and thin lines to the edge that it measures."""
    upright = start[0] == end[0]
    for x, y in (start, end):
        ax.plot([x, edge if upright else x], [y, y if upright else edge], color=GREY, linewidth=0.5, zorder=1)
    ax.annotate(
        "", end, start, arrowprops={"arrowstyle": "<->", "color": INK, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0}
    )
    length = number_text(math.dist(start, end), 2)
    middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
    box = {"boxstyle": "round,pad=0.15", "facecolor": "white", "linewidth": 0}
    ax.text(*middle, length, ha="center", va="center", rotation=90 if upright else 0, fontsize=8.5, bbox=box)


@styled
def plot_stack(
    stackup: Stackup,
    sheets: Sequence[Sheet] = (),
    plates: Sequence[Plate | FinitePlate] = (),
    pressed: str = "",
    ax: Axes | None = None,
) -> Axes:
    """Draw copper, dielectrics, elastomer and plates as a section.

    Every part of the `stackup`, of the elastomer `sheets` on the board, upwards, and of the metal
    `plates` above or below it has the same height, with its thickness beside it. `pressed` is the
    name of the indenter that is drawn on the elastomer, if any.
    """
    colours = cycled(LAYERS, stackup.names)
    rows: list[tuple[str, str, str, bool]] = []  # name, thickness and material, colour, whether of traces

    def metal(above: bool) -> None:
        for k, plate in enumerate(plates):
            if (plate.heights[0] >= 0) == above:
                thickness, height = MM.text(plate.thickness, ".3"), MM.text(plate.heights[0], ".3")
                words = f"{thickness} of {plate.material.words}, at z = {height}"
                rows.append((plate.name, words, METALS[k % len(METALS)], False))

    metal(True)
    for k, sheet in reversed(list(enumerate(sheets))):
        magnetic = f", µr {sheet.relative_permeability:g}" if sheet.relative_permeability > 1 else ""
        rows.append((sheet.name, f"{MM.text(sheet.thickness, '.3')}{magnetic}", SHEETS[k % len(SHEETS)], False))
    for k, name in enumerate(stackup.names):
        rows.append((f"copper {name}", MICROMETRES.text(stackup.copper_thickness[k], ".3"), colours[name], True))
        if k < len(stackup.dielectric_thickness):
            words = f"{MM.text(stackup.dielectric_thickness[k], '.3')}, εr {stackup.epsilon_r[k]:g}"
            rows.append(("laminate", words, LAMINATE, False))
    metal(False)
    ax = ax or new_axes(_ACROSS, 0.2 + 0.26 * len(rows) + 0.4 * bool(pressed))
    low = 0.0
    for name, words, colour, traces in reversed(rows):
        height = _TRACES if traces else 1.0
        if traces:
            ax.bar([0.03 + 0.1 * n for n in range(10)], height, 0.05, low, align="edge", color=colour)
        else:
            ax.bar(0.0, height, 1.0, low, align="edge", color=colour, alpha=0.75)
        for x, text, side in ((-0.03, name, "right"), (1.03, words, "left")):
            ax.text(x, low + height / 2, text, ha=side, va="center")
        low += height
    if pressed:
        ax.plot(0.5, low + 0.75, "o", color=METAL, markersize=25)
        ax.text(1.03, low + 0.75, pressed, ha="left", va="center")
    ax.set(xlim=(-0.02, 1.02), ylim=(0.0, low + 1.6 * bool(pressed)))
    ax.set_axis_off()
    return ax


def _draw_board(
    array: Array,
    drawn: Sequence[tuple[shapely.Polygon, str]],
    holes: Sequence[Drill],
    named: Container[str],
    title: str,
    ax: Axes | None,
    **look: float,
) -> Axes:
    x_min, y_min, x_max, y_max = array.bounds
    width, height = figure_size(x_max - x_min, y_max - y_min)
    ax = ax or new_axes(width, height)
    for shape, colour in drawn:
        # Without add_patch, which would search every edge for the limits of the axes.
        ax.add_artist(_patch(shape, facecolor=colour, linewidth=0, **look))
    places = [(MM.of((hole.x, hole.y)), hole.diameter / 2 * MM.factor) for hole in holes if hole.drilled]
    circles = [Circle((x, y), radius) for (x, y), radius in places]
    ax.add_collection(PatchCollection(circles, facecolor="white", edgecolor=INK, linewidth=0.3))
    inches = (width - 1.2) / (x_max - x_min)  # of one metre of the board
    size = min(_LETTERS, max(_LEAST_LETTERS, _LETTER_OF_PITCH * array.least_distance * inches * 72))
    for name, (x, y) in zip(array.names, MM.of(array.centres), strict=True):
        if name in named:
            write_name(ax, x, y, name, weight="bold", fontsize=size, clip_on=True)
    outline = board_outline(array)
    ax.add_patch(_patch(outline, facecolor="none", edgecolor=INK, linewidth=1.0, zorder=2.5))
    x_min, y_min, x_max, y_max = MM.of(outline.bounds).tolist()
    rim = 0.02 * (x_max - x_min + y_max - y_min)
    ax.set(xlim=(x_min - rim, x_max + rim), ylim=(y_min - rim, y_max + rim), title=title)
    plan_axes(ax)
    return ax


def _patch(shape: shapely.Polygon, **look: object) -> PathPatch:
    """Patch in mm of a polygon in m."""
    rings = [shape.exterior, *shape.interiors]
    signs = [1, *[-1] * len(shape.interiors)]  # holes run the other way round, so that they stay open
    paths = [
        Path(MM.of(ring.coords)[:: 1 if ring.is_ccw == (sign > 0) else -1, :2], closed=True)
        for ring, sign in zip(rings, signs, strict=True)
    ]
    return PathPatch(Path.make_compound_path(*paths), **look)


@styled
def copper_figure(
    board: BoardCopper, coils: Sequence[TracedCoil] = (), places: Sequence[tuple[str, tuple[float, float]]] = ()
) -> Figure:
    """Draw the copper of a board by layers, the paths of its coils, and places in it.

    Copper of the `board` is grey, the path of each of the `coils` has a colour and its name. The
    `places` with their names are x and y in m.
    """
    copper, colours = board_layers(board)[0], cycled(LAYERS, [coil.name for coil in coils])
    layers = [layer for layer, shapes in copper.items() if shapes] or [*copper][:1]
    shapes = [shape for layer in layers for shape in copper[layer]]
    bounds = shapely.total_bounds(shapes) if shapes else np.array([0.0, 0.0, 1e-2, 1e-2])
    width, height = figure_size(bounds[2] - bounds[0], bounds[3] - bounds[1])
    columns = math.ceil(len(layers) / _MOST_ROWS)
    rows = math.ceil(len(layers) / columns)
    figure = new_figure(columns * width, rows * height)
    for k, layer in enumerate(layers):
        ax = figure.add_subplot(rows, columns, k + 1)
        for part in shapely.get_parts(copper[layer]).tolist():
            if isinstance(part, shapely.Polygon) and not part.is_empty:
                ax.add_artist(_patch(part, facecolor=GREY, alpha=0.4, linewidth=0))
        for coil in coils:
            for line, on in zip(coil.lines, coil.layers, strict=True):
                if on == layer:
                    ax.plot(*MM.of(line).T, color=colours[coil.name], linewidth=1.2)
            if layer in coil.layers:
                x, y = MM.of(coil.centre).tolist()
                write_name(ax, x, y, coil.name, weight="bold", fontsize=_LETTERS, clip_on=True)
        for name, place in places:
            x, y = MM.of(place).tolist()
            ax.plot(x, y, "o", ms=12, mfc="none", mec=_BROKEN, mew=1.6)
            ax.annotate(name, (x, y), xytext=(8, 8), textcoords="offset points", color=_BROKEN, clip_on=True)
        x_min, y_min, x_max, y_max = MM.of(bounds).tolist()
        rim = 0.03 * (x_max - x_min + y_max - y_min)
        ax.set(xlim=(x_min - rim, x_max + rim), ylim=(y_min - rim, y_max + rim), title=f"Copper {layer}")
        plan_axes(ax)
    return figure


@dataclass(frozen=True)
class _Mark:
    """Circle on one layer."""

    numbers: tuple[int, ...]
    worst: Margin
    x: float
    y: float


@styled
def check_figure(array: Array, margins: Sequence[Margin], numbers: Sequence[int] | None = None) -> Figure:
    """Draw every copper layer with its margins circled.

    For each layer of the `array` the figure has all its copper, and beside it the enlarged place of
    its mark with the lowest number. More than four layers stand beside each other, and are smaller.
    The `margins` to mark come the worst first. Margins without a place are left out. Places close
    together share a circle, which is red if the first of them is broken. Their numbers stand beside
    it, or the first if there are more than two. These are the `numbers` of a table, in which
    several may share a row, by default 1, 2, ….
    """
    layers = array.stackup.names
    numbered = sorted(zip(numbers or range(1, len(margins) + 1), margins, strict=True), key=itemgetter(0))
    marks = {layer: _marks(array, layer, numbered) for layer in layers}
    x_min, y_min, x_max, y_max = array.bounds
    width, height = figure_size(x_max - x_min, y_max - y_min)
    columns = math.ceil(len(layers) / _MOST_ROWS)
    rows, scale = math.ceil(len(layers) / columns), columns**-0.5
    figure = new_figure(scale * columns * (width + height), scale * rows * height)
    grid = figure.add_gridspec(rows, 2 * columns, width_ratios=(width, height) * columns)
    for k, layer in enumerate(layers):
        row, column = divmod(k, columns)
        ax = plot_copper(array, layer, figure.add_subplot(grid[row, 2 * column]))
        for mark in marks[layer]:
            _circle(ax, mark)
        if marks[layer]:
            detail = figure.add_subplot(grid[row, 2 * column + 1])
            _enlarge(plot_copper(array, layer, detail), marks[layer][0])
    return figure


def _marks(array: Array, layer: str, margins: Sequence[tuple[int, Margin]]) -> list[_Mark]:
    x_min, y_min, x_max, y_max = array.bounds
    near = _TOGETHER * ((x_max - x_min) ** 2 + (y_max - y_min) ** 2) ** 0.5
    marks: list[_Mark] = []
    for number, margin in margins:
        if margin.layer != layer or margin.x is None or margin.y is None:
            continue
        for k, mark in enumerate(marks):
            if (mark.x - margin.x) ** 2 + (mark.y - margin.y) ** 2 <= near**2:
                marks[k] = _Mark((*mark.numbers, number), mark.worst, mark.x, mark.y)
                break
        else:
            marks.append(_Mark((number,), margin, margin.x, margin.y))
    return marks


def _circle(ax: Axes, mark: _Mark) -> None:
    colour = INK if mark.worst.kept else _BROKEN
    halo = [patheffects.withStroke(linewidth=3.5, foreground="white")]
    x, y = MM.of((mark.x, mark.y)).tolist()
    circle: dict[str, Any] = {"ms": 12, "mfc": "none", "mec": colour, "mew": 1.6}
    numbers = ", ".join(map(str, mark.numbers))
    ax.plot(x, y, "o", path_effects=halo, gid=numbers, **circle)
    letters: dict[str, Any] = {"xytext": (8, 8), "textcoords": "offset points", "color": colour, "weight": "bold"}
    shown = numbers if len(mark.numbers) < 3 else f"{mark.numbers[0]}, …"
    ax.annotate(shown, (x, y), path_effects=halo, **letters)


def _enlarge(ax: Axes, mark: _Mark) -> None:
    """Show the surroundings of a mark, with its values."""
    worst = mark.worst
    lengths = (worst.value, worst.limit) if worst.unit == "m" else (0.0,)
    half = max(_VIEW * max(lengths), _LEAST_VIEW) / 2 * MM.factor
    _circle(ax, mark)
    x, y = MM.of((mark.x, mark.y)).tolist()
    ax.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
    ax.xaxis.set_major_locator(MaxNLocator(4))  # the labels are long
    unit = MM if worst.unit == "m" else PLAIN
    value, limit = (unit.text(number, ".4") for number in (worst.value, worst.limit))
    title = f"{mark.numbers[0]}: {worst.rule} of {worst.feature},\n{value}, limit {limit}"
    ax.set_title(true_minus(title))
