"""Closed solids of the board, prisms all: copper, barrels, laminate and the sheets on top."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.errors import GeometryError
from coilarray.geometry.array import CoilArray
from coilarray.geometry.copper import Drill, board_outline, copper_by_layer, disc, drills
from coilarray.geometry.plate import FinitePlate, Plate
from coilarray.geometry.sheet import Sheet

if TYPE_CHECKING:
    import trimesh


def solids(array: CoilArray, sheets: Sequence[Sheet] = ()) -> dict[str, trimesh.Trimesh]:
    """Build the closed solids of a board and the sheets that lie on it.

    Raises GeometryError for two sheets of the same name.

    Parameters
    ----------
    array : CoilArray
        The board.
    sheets : sequence of Sheet
        Sheets from the board upwards, each as large as the board; names all different.

    Returns
    -------
    dict of str to trimesh.Trimesh
        Meshes in m, z = 0 at the top face of the top copper. The keys:

        - ``copper/<layer>/<coil>``: trace and pads as one, with the holes cut out, as thick as the layer.
        - ``barrel/<coil>/<n>``: hollow cylinder in the coil's n-th hole (n from 0, in the order of `drills`; a pad
          without a hole does not count), from the top of the uppermost to the bottom of the lowest layer it pierces.
        - ``board``: the laminate as a whole, from the bottom of the top copper to the top of the bottom copper, less
          the holes through the whole board. Inner copper and blind holes lie inside it. A board of one copper layer
          has none.
        - ``sheet/<name>``: stacked upwards from z = 0.

    Notes
    -----
    Every solid is watertight and its volume is that of its outline times its height. Circles have 128 corners.

    Examples
    --------
    >>> from coilarray.geometry import CoilArray, Placement, PlatedHole, Sheet, Stackup, path_coil
    >>> coil = path_coil([[(0, 0), (1e-2, 0)]], 0.2e-3, 0.2e-3, PlatedHole(0.3e-3, 0.6e-3))
    >>> board = CoilArray(Stackup(("top",), (35e-6,), (), ()), (Placement("A", coil, ("top",), 0, 0),))
    >>> parts = solids(board, [Sheet("base", 6e-3)])
    >>> sorted(parts), round(float(parts["copper/top/A"].volume) * 1e9, 6)
    (['copper/top/A', 'sheet/base'], 0.07)
    """
    on_top = sheet_solids(array, sheets)
    return {key: solid.copy() for key, solid in _board(array).items()} | on_top


def sheet_solids(array: CoilArray, sheets: Sequence[Sheet]) -> dict[str, trimesh.Trimesh]:
    """Build the sheets of `solids` alone, which takes much less time; GeometryError for two of the same name."""
    return {key: _extruded(prism) for key, prism in sheet_prisms(array, sheets).items()}


def plate_solid(plate: Plate | FinitePlate, within: tuple[float, float, float, float]) -> trimesh.Trimesh:
    """Build the solid of a metal plate in m; one without end gets the rectangle x_min, y_min, x_max, y_max in m."""
    if isinstance(plate, Plate):
        return _extruded(Prism(shapely.box(*within), *plate.heights))
    outline = shapely.Polygon(plate.outline.exterior, plate.outline.holes)
    solid = _extruded(Prism(outline, -plate.thickness / 2, plate.thickness / 2))
    solid.vertices = np.asarray(solid.vertices) @ plate.axes + plate.centre
    return solid


@functools.lru_cache(maxsize=1)  # a report shows one board in two scenes
def _board(array: CoilArray) -> dict[str, trimesh.Trimesh]:
    """Copper, barrels and laminate; kept, so callers get copies."""
    return {key: _extruded(prism) for key, prism in board_prisms(array).items()}


def _extruded(prism: Prism) -> trimesh.Trimesh:
    """Make a closed prism over every polygon of the outline."""
    import trimesh  # takes longer to import than the rest of the geometry together

    pieces = shapely.get_parts(prism.shape)
    height = prism.top - prism.bottom
    meshes = [trimesh.creation.extrude_polygon(piece, height, engine="earcut") for piece in pieces]
    vertices, faces = trimesh.util.append_faces([mesh.vertices for mesh in meshes], [mesh.faces for mesh in meshes])
    return trimesh.Trimesh(vertices + np.array([0.0, 0.0, prism.bottom]), faces, process=False)


@dataclass(frozen=True)
class Prism:
    """A flat piece with upright walls: its outline and the heights of its two faces, in m.

    Circles of the outline are those of `coilarray.geometry.copper.disc`.
    """

    shape: BaseGeometry
    bottom: float
    top: float


def board_prisms(array: CoilArray) -> dict[str, Prism]:
    """Divide a board into copper, barrels and laminate, by the keys of `coilarray.geometry.solids`."""
    stackup = array.stackup
    holes = [hole for hole in drills(array) if hole.drilled]
    pieces: dict[str, Prism] = {}
    for layer, nets in copper_by_layer(array).items():
        drilled = shapely.union_all([_hole(hole) for hole in holes if layer in hole.layers])
        for net, copper in nets.items():
            pieces[f"copper/{layer}/{net}"] = Prism(shapely.difference(copper, drilled), *stackup.span(layer))
    for net in array.names:
        for n, hole in enumerate(hole for hole in holes if hole.net == net):
            wall = shapely.difference(_hole(hole), disc(hole.x, hole.y, hole.diameter - 2 * hole.plating))
            bottom, top = stackup.span(hole.layers[-1])[0], stackup.span(hole.layers[0])[1]
            pieces[f"barrel/{net}/{n}"] = Prism(wall, bottom, top)
    if len(stackup.names) > 1:
        through = shapely.union_all([_hole(hole) for hole in holes if hole.layers == stackup.names])
        bottom, top = stackup.span(stackup.names[-1])[1], stackup.span(stackup.names[0])[0]
        pieces["board"] = Prism(shapely.difference(board_outline(array), through), bottom, top)
    return pieces


def sheet_prisms(array: CoilArray, sheets: Sequence[Sheet]) -> dict[str, Prism]:
    """Stack sheets as large as the board upwards from z = 0, by ``sheet/<name>``; GeometryError for two of one name."""
    names = [sheet.name for sheet in sheets]
    if len(set(names)) != len(names):
        raise GeometryError(f"sheet names must differ; got {', '.join(names)}.")
    outline = board_outline(array)
    pieces: dict[str, Prism] = {}
    z = 0.0
    for sheet in sheets:
        pieces[f"sheet/{sheet.name}"] = Prism(outline, z, z + sheet.thickness)
        z += sheet.thickness
    return pieces


def _hole(hole: Drill) -> shapely.Polygon:
    return disc(hole.x, hole.y, hole.diameter)
