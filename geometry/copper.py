"""Outlines of traces, pads and holes by layer."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, cast

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.compute.arrays import FloatArray
from coilarray.geometry.array import Array, Placement

# A mitre longer than this many half widths is cut off flat. 2 is the tip of an equilateral
# triangle. 4 leaves room for corners down to 29°.
MITRE_LIMIT = 4.0
# Segments per quarter circle: the polygon of a 1 mm pad stays within 0.2 µm of the circle.
_QUADRANT = 32


@dataclass(frozen=True)
class CopperFeature:
    """Piece of copper on one layer, line or pad.

    `net` is the name of the coil. `shape` is the outline in m on the board, without the drilled
    hole.
    """

    layer: str
    net: str
    kind: Literal["trace", "via", "terminal"]
    shape: shapely.Polygon


@dataclass(frozen=True)
class Drill:
    """Plated hole with pads, or bare pad of a terminal.

    `net` is the name of the coil. `x`, `y`, the `diameter` of the hole, the diameter of its pads,
    and the thickness of its copper barrel are in m. The hole has a pad on each of the `layers` that
    it pierces, top to bottom. A bare pad is not `drilled`.
    """

    net: str
    kind: Literal["via", "terminal"]
    x: float
    y: float
    diameter: float
    pad: float
    layers: tuple[str, ...]
    plating: float
    drilled: bool = True


def copper_features(array: Array) -> tuple[CopperFeature, ...]:
    """Return every piece of copper.

    There is a trace for each line of a coil, and a pad for each hole and pierced layer.

    >>> from coilarray.geometry import Array, Placement, PlatedHole, Stackup, path_coil
    >>> board = Stackup(("top", "bottom"), (35e-6, 35e-6), (0.2e-3,), (4.5,))
    >>> coil = path_coil([[(0, 0), (1e-2, 0)], [(1e-2, 0), (0, 0)]], 0.2e-3, 0.2e-3, PlatedHole(0.3e-3, 0.6e-3))
    >>> features = copper_features(Array(board, (Placement("A", coil, ("top", "bottom"), 0.0, 0.0),)))
    >>> [(feature.layer, feature.kind) for feature in features]
    [('top', 'trace'), ('bottom', 'trace'), ('top', 'via'), ('bottom', 'via')]
    """
    placements = array.placements
    return (
        *(trace for placement in placements for trace in _traces_of(placement)),
        *(pad for placement in placements for pad in _pads_of(array, placement)),
    )


def _traces_of(placement: Placement) -> Iterator[CopperFeature]:
    for line, widths, layer in placement.traces():
        yield CopperFeature(layer, placement.name, "trace", trace_outline(line, widths))


def _pads_of(array: Array, placement: Placement) -> Iterator[CopperFeature]:
    for drill in drills_of(array, placement):
        for layer in drill.layers:
            yield CopperFeature(layer, drill.net, drill.kind, disc(drill.x, drill.y, drill.pad))


def drills(array: Array) -> tuple[Drill, ...]:
    """Return every hole and pad, vias before terminals."""
    return tuple(drill for placement in array.placements for drill in drills_of(array, placement))


def drills_of(array: Array, placement: Placement) -> list[Drill]:
    """Return the holes and pads of one coil."""
    coil, stackup, name = placement.coil, array.stackup, placement.name
    holes = []
    for (x, y), first, last in zip(
        placement.to_board(coil.via_points), placement.layers, placement.layers[1:], strict=False
    ):
        layers = stackup.names if array.through_holes else stackup.between(first, last)
        via = coil.via
        holes.append(Drill(name, "via", float(x), float(y), via.drill, via.pad, layers, via.plating))
    terminal = coil.terminal
    if terminal is not None:
        ends = (placement.layers[0], placement.layers[-1])
        for (x, y), layer in zip(placement.to_board(coil.terminal_points), ends, strict=True):
            layers = stackup.names if array.through_holes else (layer,)
            drilled = len(layers) > 1 or len(stackup.names) == 1
            sizes = (terminal.drill, terminal.pad)
            holes.append(Drill(name, "terminal", float(x), float(y), *sizes, layers, terminal.plating, drilled))
    return holes


def copper_by_layer(array: Array) -> dict[str, dict[str, BaseGeometry]]:
    """Unite the copper of every net on every layer.

    Layers are given from top to bottom, nets in the order of the coils. Nets without copper on a
    layer are left out.
    """
    copper: dict[str, dict[str, BaseGeometry]] = {layer: {} for layer in array.stackup.names}
    united: dict[tuple[int, tuple[str, ...]], dict[str, BaseGeometry]] = {}  # equal coils once
    for placement in array.placements:
        key = id(placement.coil), placement.layers
        if key not in united:
            shapes: dict[str, list[shapely.Polygon]] = {}
            origin = placement.at_origin()
            for feature in (*_traces_of(origin), *_pads_of(array, origin)):
                shapes.setdefault(feature.layer, []).append(feature.shape)
            united[key] = {layer: shapely.union_all(parts) for layer, parts in shapes.items()}
        for layer, shape in united[key].items():
            copper[layer][placement.name] = shapely.transform(shape, placement.to_board)
    return copper


def board_outline(array: Array) -> shapely.Polygon:
    """Edge of the board in m, the rectangle of `Array.bounds`."""
    return shapely.box(*array.bounds)


def disc(x: float, y: float, diameter: float) -> shapely.Polygon:
    """Polygon in m with 128 corners on a circle."""
    return shapely.Point(x, y).buffer(diameter / 2, quad_segs=_QUADRANT)


def uniform_runs(line: FloatArray, widths: FloatArray) -> list[tuple[FloatArray, float]]:
    """Cut a line (n, 2) where its widths (n − 1,) change.

    Every piece begins at the end of the piece before.
    """
    starts = [0, *(np.flatnonzero(np.diff(widths)) + 1).tolist(), len(widths)]
    return [(line[first : last + 1], float(widths[first])) for first, last in pairwise(starts)]


def segment_rectangles(ends: FloatArray, widths: FloatArray) -> FloatArray:
    """Rectangles (n, 4, 2) of given widths about segments (n, 2, 2).

    They do not extend beyond the ends of the segments. The corners are anticlockwise.
    """
    start, stop = ends[:, 0], ends[:, 1]
    along = stop - start
    along *= (widths / 2 / np.hypot(*along.T))[:, None]
    left = np.column_stack((-along[:, 1], along[:, 0]))
    return np.stack((start - left, stop - left, stop + left, start + left), axis=1)


def groups(count: int, pairs: Iterable[tuple[int, int]]) -> list[int]:
    """Lowest index that pairs connect with each of `count` indices."""
    from scipy.sparse import coo_array  # slow to import, and needed only to read a board
    from scipy.sparse.csgraph import connected_components

    i, j = np.array(list(pairs), dtype=np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(i), dtype=bool), (i, j)), shape=(count, count))
    label = connected_components(graph, directed=False)[1]
    return cast(list[int], np.unique(label, return_index=True)[1][label].tolist())


def trace_outline(line: FloatArray, widths: npt.ArrayLike) -> shapely.Polygon:
    """Outline in m of a trace with centre `line` (n, 2).

    It has flat ends, mitred corners, and round corners where the width changes.
    """
    runs = uniform_runs(line, np.broadcast_to(np.asarray(widths, dtype=np.float64), (len(line) - 1,)))
    ribbons = [
        simple_outline(piece, width) or _pieced_outline(piece, width / 2, *_corners(piece, width)[0])
        for piece, width in runs
    ]
    # the joint fills the corner and makes the pieces overlap, so their union is one polygon
    joints = [
        disc(float(piece[-1, 0]), float(piece[-1, 1]), min(width, following))
        for (piece, width), (_, following) in pairwise(runs)
    ]
    return ribbons[0] if not joints else cast(shapely.Polygon, shapely.union_all([*ribbons, *joints]))


def simple_outline(line: FloatArray, width: float) -> shapely.Polygon | None:
    """Outline of a trace of one width without overlaps.

    None if corners or runs of the trace meet. The outline is built from the offset corners of
    `line` (n, 2) in m. The general buffer of GEOS simplifies its input by up to 1 % of the
    distance, which shows in the area of a finely divided circle.
    """
    offset = _corners(line, width)[1]
    if offset is None:
        return None
    ribbon = shapely.Polygon(np.vstack((line + offset, (line - offset)[::-1])))
    return ribbon if ribbon.is_valid else None


def _corners(line: FloatArray, width: float) -> tuple[tuple[FloatArray, FloatArray], FloatArray | None]:
    """Find normals, mitres and side offsets of a line.

    Their shapes are (n − 1, 2), (n − 2, 2) and (n, 2), the offsets in m. A mitre beyond the limit
    is zero. The offsets are None if there is such a mitre, or if a segment is shorter than its
    corners.
    """
    half = width / 2
    step = np.diff(line, axis=0)
    length = np.hypot(*step.T)
    along = step / length[:, None]
    left = np.column_stack((-along[:, 1], along[:, 0]))
    # the corner points of the ribbon lie at ±half·(n1 + n2)/(1 + n1·n2) from the vertex
    cosine = (left[:-1] * left[1:]).sum(axis=1)
    mitre = (left[:-1] + left[1:]) / np.maximum(1 + cosine, 1e-12)[:, None]
    overlap = half * np.sqrt(np.maximum(1 - cosine, 0) / np.maximum(1 + cosine, 1e-12))
    taken = np.concatenate(([0.0], overlap)) + np.concatenate((overlap, [0.0]))
    sharp = np.hypot(*mitre.T) > MITRE_LIMIT
    free = not sharp.any() and (taken < length).all()
    offset = half * np.vstack((left[:1], mitre, left[-1:])) if free else None
    return (left, np.where(sharp[:, None], 0.0, mitre)), offset


def _pieced_outline(line: FloatArray, half: float, left: FloatArray, mitre: FloatArray) -> shapely.Polygon:
    """Unite segments and corners of a trace that overlaps itself."""
    side = half * left
    rectangles = np.stack((line[:-1] + side, line[1:] + side, line[1:] - side, line[:-1] - side), axis=1)
    # +1: the corner opens on the right
    turn = np.sign(left[:-1, 0] * left[1:, 1] - left[:-1, 1] * left[1:, 0])[:, None]
    corner, before, after = line[1:-1], -turn * side[:-1], -turn * side[1:]
    tip = np.where((mitre == 0).all(axis=1, keepdims=True), 0.5 * (before + after), -turn * half * mitre)
    # the wedge starts slightly inside, so the union leaves no slit between it and the rectangles
    inside = -1e-3 * (before + after)
    wedges = np.stack((corner + before, corner + tip, corner + after, corner + inside), axis=1)
    pieces = [shapely.polygons(rectangles), shapely.polygons(wedges[turn[:, 0] != 0])]
    # connected, as every piece overlaps the next
    return cast(shapely.Polygon, shapely.union_all(np.concatenate(pieces)))
