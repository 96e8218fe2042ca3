"""Closed prisms of a board and the sheets on top."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.errors import GeometryError
from coilarray.geometry.array import Array
from coilarray.geometry.bodies import FinitePlate, Plate
from coilarray.geometry.copper import Drill, board_outline, copper_by_layer, disc, drills
from coilarray.geometry.elastomer import Sheet

if TYPE_CHECKING:
    import trimesh


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
    return {key: _extruded(prism) for key, prism in sheet_prisms(array, sheets).items()}


def plate_solid(plate: Plate | FinitePlate, within: tuple[float, float, float, float]) -> trimesh.Trimesh:
    """Build the solid of a metal plate in m.

    An infinite plate gets the rectangle x_min, y_min, x_max, y_max in m.
    """
    if isinstance(plate, Plate):
        return _extruded(Prism(shapely.box(*within), *plate.heights))
    outline = shapely.Polygon(plate.outline.exterior, plate.outline.holes)
    solid = _extruded(Prism(outline, -plate.thickness / 2, plate.thickness / 2))
    solid.vertices = np.asarray(solid.vertices) @ plate.axes + plate.centre
    return solid


@lru_cache(maxsize=1)  # a report shows one board in two scenes
def board_solids(array: Array) -> Mapping[str, trimesh.Trimesh]:
    """Copper, barrels and laminate of `solids`.

    The result is cached for the next caller and must not be changed.
    """
    import trimesh  # takes longer to import than the rest of the geometry together

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
    from mapbox_earcut import triangulate_float64

    vertices, faces = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)]
    for piece in shapely.get_parts(prism.shape):
        rings = [shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(piece)]
        flat, n = np.vstack(rings), sum(map(len, rings))
        ends = np.cumsum([len(ring) for ring in rings], dtype=np.uint32)
        lid = triangulate_float64(flat, ends).reshape(-1, 3).astype(np.int64)
        (ux, uy), (vx, vy) = ((flat[lid[:, k]] - flat[lid[:, 0]]).T for k in (1, 2))
        if (ux * vy - uy * vx).sum() < 0:  # clockwise
            lid = lid[:, ::-1]
        edges = lid[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        # the triangles leave out corners on straight lines: their own rim closes the walls
        start, end = edges[~np.isin(edges @ (n, 1), edges @ (1, n))].T
        first = sum(map(len, vertices))
        walls = (np.column_stack((start, end, end + n)), np.column_stack((start, end + n, start + n)))
        faces.append(first + np.vstack((lid + n, lid[:, ::-1], *walls)))
        vertices += [np.column_stack((flat, np.full(n, height))) for height in (prism.bottom, prism.top)]
    return trimesh.Trimesh(np.vstack(vertices), np.vstack(faces), process=False)


@dataclass(frozen=True)
class Prism:
    """Outline in m with the heights of its two faces.

    Circles are made by `coilarray.geometry.copper.disc`.
    """

    shape: BaseGeometry
    bottom: float
    top: float


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
    """Return the laminate, or None for a single copper layer."""
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
    """Cut holes out of a prism."""
    bored = shapely.union_all([disc(hole.x, hole.y, hole.diameter) for hole in holes])
    return replace(prism, shape=shapely.difference(prism.shape, bored))
