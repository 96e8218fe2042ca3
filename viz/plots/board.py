"""Plans of a board: the copper of one layer, and all layers seen from above."""

from __future__ import annotations

from collections.abc import Mapping

import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.patches import Circle, Patch, PathPatch
from matplotlib.path import Path

from coilarray.geometry.array import CoilArray
from coilarray.geometry.copper import Drill, board_outline, copper_features, drills
from coilarray.viz.palette import COILS, INK, LAYERS, cycled
from coilarray.viz.plots.axis_units import MM
from coilarray.viz.plots.style import figure_size, legend_above, new_axes, plan_axes, styled, write_name

_TRANSLUCENT = 0.6


@styled
def plot_copper(array: CoilArray, layer: str, ax: Axes | None = None) -> Axes:
    """Draw the copper of one layer, each coil in its own colour, with holes and the edge of the board, in mm.

    Parameters
    ----------
    array : CoilArray
        Board that is drawn.
    layer : str
        Name of the copper layer.
    ax : Axes, optional
        Axes to draw into, in mm.

    Raises
    ------
    GeometryError
        If the board has no such layer.

    Examples
    --------
    >>> from coilarray import load_design
    >>> plot_copper(load_design("gast2020").array, "L1").get_title(loc="left")
    'Copper L1'
    """
    array.stackup.index(layer)
    ax = ax or _board_axes(array)
    colours = cycled(COILS, array.names)
    features = [feature for feature in copper_features(array) if feature.layer == layer]
    for feature in features:
        # no add_patch, which would search every edge for the limits of the axes
        ax.add_artist(_patch(feature.shape, facecolor=colours[feature.net], linewidth=0))
    _draw_holes(ax, tuple(drill for drill in drills(array) if layer in drill.layers))
    present = {feature.net for feature in features if feature.kind == "trace"}
    _legend(ax, {name: colour for name, colour in colours.items() if name in present}, 1.0)
    _finish_board(ax, array, f"Copper {layer}")
    return ax


@styled
def plot_board(array: CoilArray, ax: Axes | None = None) -> Axes:
    """Draw all copper layers seen from above, translucent, with the names of the coils: the board without rendering.

    Parameters
    ----------
    array : CoilArray
        Board that is drawn.
    ax : Axes, optional
        Axes to draw into, in mm.

    Examples
    --------
    >>> from coilarray import load_design
    >>> ax = plot_board(load_design("gast2020").array)
    >>> [text.get_text() for text in ax.texts][:2], ax.get_xlabel()
    (['coil1', 'coil2'], 'x (mm)')
    """
    ax = ax or _board_axes(array)
    colours = cycled(LAYERS, array.stackup.names)
    features = copper_features(array)
    for layer in reversed(array.stackup.names):
        for feature in features:
            if feature.layer == layer:
                ax.add_artist(_patch(feature.shape, facecolor=colours[layer], linewidth=0, alpha=_TRANSLUCENT))
    _draw_holes(ax, drills(array))
    for name, (x, y) in zip(array.names, MM.of(array.centres), strict=True):
        write_name(ax, x, y, name, weight="bold")
    _legend(ax, {f"copper {layer}": colour for layer, colour in colours.items()}, _TRANSLUCENT)
    _finish_board(ax, array, "Board from above")
    return ax


def _board_axes(array: CoilArray) -> Axes:
    x_min, y_min, x_max, y_max = array.bounds
    return new_axes(*figure_size(x_max - x_min, y_max - y_min))


def _draw_holes(ax: Axes, holes: tuple[Drill, ...]) -> None:
    places = [(MM.of((hole.x, hole.y)), hole.diameter / 2 * MM.factor) for hole in holes if hole.drilled]
    circles = [Circle((x, y), radius) for (x, y), radius in places]
    ax.add_collection(PatchCollection(circles, facecolor="white", edgecolor=INK, linewidth=0.3))


def _patch(shape: shapely.Polygon, **look: object) -> PathPatch:
    """Return one patch in mm of a polygon in m, holes left open."""
    rings = [shape.exterior, *shape.interiors]
    signs = [1, *[-1] * len(shape.interiors)]  # holes run the other way round, so that they stay open
    paths = [
        Path(MM.of(ring.coords)[:: 1 if ring.is_ccw == (sign > 0) else -1, :2], closed=True)
        for ring, sign in zip(rings, signs, strict=True)
    ]
    return PathPatch(Path.make_compound_path(*paths), **look)


def _finish_board(ax: Axes, array: CoilArray, title: str) -> None:
    outline = board_outline(array)
    ax.add_patch(_patch(outline, facecolor="none", edgecolor=INK, linewidth=1.0))
    x_min, y_min, x_max, y_max = MM.of(outline.bounds).tolist()
    rim = 0.02 * (x_max - x_min + y_max - y_min)
    ax.set(xlim=(x_min - rim, x_max + rim), ylim=(y_min - rim, y_max + rim), title=title)
    plan_axes(ax)


def _legend(ax: Axes, colours: Mapping[str, str], alpha: float) -> None:
    handles = [Patch(color=colour, label=text, alpha=alpha, linewidth=0) for text, colour in colours.items()]
    legend_above(ax, min(len(handles), 6), handles=handles, handlelength=1.0)
