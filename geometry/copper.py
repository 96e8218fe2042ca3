"""Copper and holes of a board: outlines by layer, and closed solids."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Literal, cast

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.errors import GeometryError
from coilarray.geometry.array import Array, Placement
from coilarray.geometry.bodies import FinitePlate, Plate
from coilarray.geometry.conductor import Form
from coilarray.geometry.elastomer import Sheet

if TYPE_CHECKING:
    import trimesh

# A mitre longer than this many half widths is cut off flat. 2 is the tip of an equilateral
# triangle. 4 leaves room for corners down to 29°.
MITRE_LIMIT = 4.0
_QUADRANT = 32  # segments per quarter circle: the polygon of a 1 mm pad stays within 0.2 µm of the circle
_SAME_CORNER = 1e-10  # m, of strips that are cut beside each other


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
    found = (feature for placement in array.placements for feature in _features_of(array, placement))
    return tuple(sorted(found, key=lambda feature: feature.kind != "trace"))


def _features_of(array: Array, placement: Placement) -> Iterator[CopperFeature]:
    for line, widths, layer in placement.traces():
        yield CopperFeature(layer, placement.name, "trace", trace_outline(line, widths))
    for hole in drills_of(array, placement):
        for layer in hole.layers:
            yield CopperFeature(layer, hole.net, hole.kind, disc(hole.x, hole.y, hole.pad))


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
        layers, via = stackup.names if array.through_holes else stackup.between(first, last), coil.via
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
    """Unite the copper of every net on every layer that has any."""
    copper: dict[str, dict[str, BaseGeometry]] = {layer: {} for layer in array.stackup.names}
    united: dict[tuple[int, tuple[str, ...]], dict[str, BaseGeometry]] = {}  # equal coils once
    for placement in array.placements:
        key = id(placement.coil), placement.layers
        if key not in united:
            shapes: dict[str, list[shapely.Polygon]] = {}
            for feature in _features_of(array, placement.at_origin()):
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
    """Cut a line (n, 2) where its widths (n − 1,) change."""
    starts = [0, *(np.flatnonzero(np.diff(widths)) + 1).tolist(), len(widths)]
    return [(line[first : last + 1], float(widths[first])) for first, last in pairwise(starts)]


def segment_rectangles(ends: FloatArray, widths: FloatArray) -> FloatArray:
    """Rectangles (n, 4, 2), anticlockwise, about segments (n, 2, 2)."""
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
    pieces = [simple_outline(piece, width) or _pieced_outline(piece, width) for piece, width in runs]
    # the joint fills the corner and makes the pieces overlap, so their union is one polygon
    for (piece, width), (_, following) in pairwise(runs):
        pieces.append(disc(float(piece[-1, 0]), float(piece[-1, 1]), min(width, following)))
    return pieces[0] if len(pieces) == 1 else cast(shapely.Polygon, shapely.union_all(pieces))


def simple_outline(line: FloatArray, width: float) -> shapely.Polygon | None:
    """Outline of a trace of one width, None if it overlaps.

    It is built from the offset corners of `line` (n, 2) in m. The general buffer of GEOS simplifies its
    input by up to 1 % of the distance, which shows in the area of a finely divided circle.
    """
    offset = _corners(line, width)[1]
    if offset is None:
        return None
    ribbon = shapely.Polygon(np.vstack((line + offset, (line - offset)[::-1])))
    return ribbon if ribbon.is_valid else None


def _corners(line: FloatArray, width: float) -> tuple[tuple[FloatArray, FloatArray], FloatArray | None]:
    """Find normals (n − 1, 2), mitres (n − 2, 2) and side offsets (n, 2) in m.

    A mitre beyond the limit is zero. The offsets are None if there is one, or if a segment is shorter
    than its corners.
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


def _pieced_outline(line: FloatArray, width: float) -> shapely.Polygon:
    """Unite segments and corners of a trace that overlaps itself."""
    half, (left, mitre) = width / 2, _corners(line, width)[0]
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


@dataclass(frozen=True)
class Prism:
    """Outline in m with the heights of its two faces."""

    shape: BaseGeometry
    bottom: float
    top: float


def solids(array: Array, sheets: Sequence[Sheet] = ()) -> dict[str, trimesh.Trimesh]:
    """Build the closed solids of a board and its sheets.

    Raises GeometryError if two sheets have the same name. Returns meshes in m, with z = 0 at the
    top face of the top copper, by these keys:

    - ``copper/<layer>/<coil>``: trace and pads as one solid, as thick as the layer, without holes.
    - ``barrel/<coil>/<n>``: hollow cylinder in the coil's n-th hole, from the top of the uppermost
      to the bottom of the lowest layer it pierces. n counts from 0 in the order of `drills`,
      without pads that have no hole.
    - ``board``: the laminate, from the bottom of the top copper to the top of the bottom copper,
      without the holes through the whole board. Inner copper and blind holes lie inside it. A board
      of one copper layer has no laminate.
    - ``sheet/<name>``: stacked upwards from z = 0.

    They are bent as the board, in facets of 3.4° at most.

    Every solid is watertight, and its volume is the area of its outline times its height. Circles
    have 128 corners.

    >>> from coilarray.geometry import Array, Placement, PlatedHole, Sheet, Stackup, path_coil
    >>> coil = path_coil([[(0, 0), (1e-2, 0)]], 0.2e-3, 0.2e-3, PlatedHole(0.3e-3, 0.6e-3))
    >>> board = Array(Stackup(("top",), (35e-6,), (), ()), (Placement("A", coil, ("top",), 0, 0),))
    >>> parts = solids(board, [Sheet("base", 6e-3)])
    >>> sorted(parts), round(float(parts["copper/top/A"].volume) * 1e9, 6)
    (['copper/top/A', 'sheet/base'], 0.07)
    """
    on_top = sheet_solids(array, sheets)
    return {key: solid.copy() for key, solid in board_solids(array).items()} | on_top


def sheet_solids(array: Array, sheets: Sequence[Sheet]) -> dict[str, trimesh.Trimesh]:
    """Build the sheets of `solids` alone, which is much faster."""
    return _as_bent(array, sheet_prisms(array, sheets))


def _as_bent(array: Array, prisms: Mapping[str, Prism]) -> dict[str, trimesh.Trimesh]:
    form = array.form
    if form is None:
        return {key: _extruded(prism) for key, prism in prisms.items()}
    strips = np.array(form.strips(array.bounds))
    return {key: _bent(prism, form, strips) for key, prism in prisms.items()}


def plate_solid(plate: Plate | FinitePlate, within: tuple[float, float, float, float]) -> trimesh.Trimesh:
    """Build a metal plate, an infinite one `within` a rectangle, in m."""
    if isinstance(plate, Plate):
        return _extruded(Prism(shapely.box(*within), *plate.heights))
    outline = shapely.Polygon(plate.outline.exterior, plate.outline.holes)
    solid = _extruded(Prism(outline, -plate.thickness / 2, plate.thickness / 2))
    solid.vertices = np.asarray(solid.vertices) @ plate.axes + plate.centre
    return solid


@lru_cache(maxsize=4)  # a report shows its boards in two scenes
def board_solids(array: Array) -> Mapping[str, trimesh.Trimesh]:
    """Copper, barrels and laminate of `solids`, cached: do not change."""
    import trimesh  # takes longer to import than the rest of the geometry together

    if array.form is not None:
        return _as_bent(array, board_prisms(array))
    holes = _holes(array)
    at = np.array([(hole.x, hole.y) for hole in holes]).reshape(-1, 2)
    nets = np.array([hole.net for hole in holes])
    reach = max((hole.diameter / 2 for hole in holes), default=0.0)
    pierced = {layer: np.array([layer in hole.layers for hole in holes]) for layer in array.stackup.names}
    built: dict[tuple[int, tuple[str, ...], float], list[tuple[str, str, Prism, trimesh.Trimesh]]] = {}
    pieces: dict[str, trimesh.Trimesh] = {}
    for place in array.placements:
        key = id(place.coil), place.layers, place.rotation
        if key not in built:  # equal coils once, about the origin
            alone = replace(array, placements=(replace(place, x=0.0, y=0.0),))
            copper = [("copper", layer, prism) for layer, _, prism in _copper(alone)]
            barrels = [("barrel", str(n), prism) for _, n, prism in _barrels(alone)]
            built[key] = [(kind, part, prism, _extruded(prism)) for kind, part, prism in (*copper, *barrels)]
        away = np.array([place.x, place.y, 0.0])
        for kind, part, prism, solid in built[key]:
            name = f"copper/{part}/{place.name}" if kind == "copper" else f"barrel/{place.name}/{part}"
            whole = solid
            if kind == "copper" and len(holes):
                foreign = np.flatnonzero((nets != place.name) & pierced[part])
                near = foreign[shapely.dwithin(prism.shape, shapely.points(at[foreign] - away[:2]), reach)]
                moved = [replace(holes[k], x=holes[k].x - place.x, y=holes[k].y - place.y) for k in near.tolist()]
                whole = _extruded(_drilled(prism, moved)) if moved else solid
            pieces[name] = trimesh.Trimesh(whole.vertices + away, whole.faces, process=False)
    laminate = _laminate(array)
    return pieces if laminate is None else {**pieces, "board": _extruded(laminate)}


def _extruded(prism: Prism) -> trimesh.Trimesh:
    """Make a closed prism over every polygon of the outline."""
    import trimesh

    vertices, faces = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)]
    for flat, lid in _lids(prism.shape):
        faces.append(sum(map(len, vertices)) + _with_walls(lid, len(flat)))
        vertices += [np.column_stack((flat, np.full(len(flat), height))) for height in (prism.bottom, prism.top)]
    return trimesh.Trimesh(np.vstack(vertices), np.vstack(faces), process=False)


def _bent(prism: Prism, form: Form, strips: npt.NDArray[np.object_]) -> trimesh.Trimesh:
    """Bend a prism in strips, which stay joined."""
    import trimesh
    from scipy.spatial import KDTree

    points, lids, count = [], [], 0
    for part in shapely.intersection(prism.shape, strips):
        for flat, lid in _lids(part):
            points.append(flat)
            lids.append(lid + count)
            count += len(flat)
    flat = np.vstack(points)
    # corners on the cuts, which both strips have
    number = np.array(groups(count, KDTree(flat).query_pairs(_SAME_CORNER)))
    used, lid = np.unique(number[np.vstack(lids)], return_inverse=True)
    flat, lid = flat[used], lid.reshape(-1, 3)
    vertices = [np.column_stack((flat, np.full(len(flat), height))) for height in (prism.bottom, prism.top)]
    return trimesh.Trimesh(form.surface(np.vstack(vertices)), _with_walls(lid, len(flat)), process=False)


def _lids(shape: BaseGeometry) -> Iterator[tuple[FloatArray, IntArray]]:
    """Yield corners (n, 2) and triangles, counter-clockwise, of every polygon."""
    from mapbox_earcut import triangulate_float64

    for piece in shapely.get_parts(shape):
        if isinstance(piece, shapely.Polygon) and not piece.is_empty:
            rings = [shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(piece)]
            flat = np.vstack(rings)
            ends = np.cumsum([len(ring) for ring in rings], dtype=np.uint32)
            lid = triangulate_float64(flat, ends).reshape(-1, 3).astype(np.int64)
            (ux, uy), (vx, vy) = ((flat[lid[:, k]] - flat[lid[:, 0]]).T for k in (1, 2))
            yield flat, lid[:, ::-1] if (ux * vy - uy * vx).sum() < 0 else lid


def _with_walls(lid: IntArray, n: int) -> IntArray:
    """Close a lower and an upper lid of n corners by walls."""
    edges = lid[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    # the triangles leave out corners on straight lines: their own rim closes the walls
    start, end = edges[~np.isin(edges @ (n, 1), edges @ (1, n))].T
    walls = (np.column_stack((start, end, end + n)), np.column_stack((start, end + n, start + n)))
    return np.vstack((lid + n, lid[:, ::-1], *walls))


def board_prisms(array: Array) -> dict[str, Prism]:
    """Divide a board into prisms, with the keys of `solids`."""
    copper = {f"copper/{layer}/{net}": prism for layer, net, prism in _copper(array)}
    barrels = {f"barrel/{net}/{n}": prism for net, n, prism in _barrels(array)}
    laminate = _laminate(array)
    return {**copper, **barrels, **({} if laminate is None else {"board": laminate})}


def _copper(array: Array) -> Iterator[tuple[str, str, Prism]]:
    """Yield layer, net and prism of all copper, without holes."""
    holes = _holes(array)
    for layer, nets in copper_by_layer(array).items():
        through = [hole for hole in holes if layer in hole.layers]
        for net, shape in nets.items():
            yield layer, net, _drilled(Prism(shape, *array.stackup.span(layer)), through)


def _barrels(array: Array) -> Iterator[tuple[str, int, Prism]]:
    """Yield net, number and prism of all barrels."""
    stackup, holes = array.stackup, _holes(array)
    for net in array.names:
        for n, hole in enumerate(hole for hole in holes if hole.net == net):
            bore, inside = (disc(hole.x, hole.y, hole.diameter - less) for less in (0.0, 2 * hole.plating))
            wall = shapely.difference(bore, inside)
            yield net, n, Prism(wall, stackup.span(hole.layers[-1])[0], stackup.span(hole.layers[0])[1])


def _laminate(array: Array) -> Prism | None:
    stackup = array.stackup
    if len(stackup.names) == 1:
        return None
    whole = Prism(board_outline(array), stackup.span(stackup.names[-1])[1], stackup.span(stackup.names[0])[0])
    return _drilled(whole, [hole for hole in _holes(array) if hole.layers == stackup.names])


def sheet_prisms(array: Array, sheets: Sequence[Sheet]) -> dict[str, Prism]:
    """Sheets as large as the board, stacked from 0."""
    names = [sheet.name for sheet in sheets]
    if len(set(names)) != len(names):
        raise GeometryError(f"sheet names must differ; got {', '.join(names)}.")
    outline = board_outline(array)
    heights = accumulate((sheet.thickness for sheet in sheets), initial=0.0)
    return {f"sheet/{name}": Prism(outline, *span) for name, span in zip(names, pairwise(heights), strict=True)}


def _holes(array: Array) -> list[Drill]:
    return [hole for hole in drills(array) if hole.drilled]


def _drilled(prism: Prism, holes: Sequence[Drill]) -> Prism:
    bored = shapely.union_all([disc(hole.x, hole.y, hole.diameter) for hole in holes])
    return replace(prism, shape=shapely.difference(prism.shape, bored))
