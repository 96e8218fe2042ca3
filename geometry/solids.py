"""Closed solids of the board: copper, barrels, laminate and the sheets on top."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.errors import GeometryError
from coilarray.geometry.array import CoilArray
from coilarray.geometry.copper import Drill, board_outline, disc, drills, layer_copper
from coilarray.geometry.sheet import Sheet

if TYPE_CHECKING:
    import trimesh


def solids(array: CoilArray, sheets: Sequence[Sheet] = ()) -> dict[str, trimesh.Trimesh]:
    """Build the closed solids of a board and the sheets that lie on it.

    Parameters
    ----------
    array : CoilArray
        The board.
    sheets : sequence of Sheet
        From the board upwards; each covers the whole board. Names all different.

    Returns
    -------
    dict of str to trimesh.Trimesh
        In m, z = 0 at the top face of the top copper. The keys:

        - ``copper/<layer>/<coil>``: trace and pads as one, with the holes cut out, as thick as the layer.
        - ``barrel/<coil>/<n>``: hollow cylinder in the coil's n-th hole (n from 0, in the order of `drills`), from the
          top of the uppermost to the bottom of the lowest layer it pierces.
        - ``board``: the laminate as a whole, from the bottom of the top copper to the top of the bottom copper, less
          the holes through the whole board. Inner copper and blind holes lie inside it. A board of one copper layer
          has none.
        - ``sheet/<name>``: stacked upwards from z = 0.

    Raises
    ------
    GeometryError
        Two sheets of the same name.

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
    names = [sheet.name for sheet in sheets]
    if len(set(names)) != len(names):
        raise GeometryError(f"sheet names must differ; got {', '.join(names)}.")
    parts = {key: solid.copy() for key, solid in _board(array).items()}
    outline = board_outline(array)
    z = 0.0
    for sheet in sheets:
        parts[f"sheet/{sheet.name}"] = _extruded(outline, z, z + sheet.thickness)
        z += sheet.thickness
    return parts


@functools.lru_cache(maxsize=1)  # a report shows one board in two scenes
def _board(array: CoilArray) -> dict[str, trimesh.Trimesh]:
    """Copper, barrels and laminate; kept, so callers get copies."""
    stackup = array.stackup
    holes = drills(array)
    parts: dict[str, trimesh.Trimesh] = {}
    for layer in stackup.names:
        drilled = shapely.union_all([_hole(hole) for hole in holes if layer in hole.layers])
        bottom, top = stackup.span(layer)
        for net, copper in layer_copper(array, layer).items():
            parts[f"copper/{layer}/{net}"] = _extruded(shapely.difference(copper, drilled), bottom, top)
    for net in array.names:
        for n, hole in enumerate(hole for hole in holes if hole.net == net):
            wall = shapely.difference(_hole(hole), disc(hole.x, hole.y, hole.diameter - 2 * hole.plating))
            bottom, top = stackup.span(hole.layers[-1])[0], stackup.span(hole.layers[0])[1]
            parts[f"barrel/{net}/{n}"] = _extruded(wall, bottom, top)
    if len(stackup.names) > 1:
        through = shapely.union_all([_hole(hole) for hole in holes if hole.layers == stackup.names])
        bottom, top = stackup.span(stackup.names[-1])[1], stackup.span(stackup.names[0])[0]
        parts["board"] = _extruded(shapely.difference(board_outline(array), through), bottom, top)
    return parts


def _hole(hole: Drill) -> shapely.Polygon:
    return disc(hole.x, hole.y, hole.diameter)


def _extruded(shape: BaseGeometry, bottom: float, top: float) -> trimesh.Trimesh:
    """Make a closed prism over every polygon of `shape`, from `bottom` to `top` in m."""
    import trimesh  # takes longer to import than the rest of the geometry together

    parts = shapely.get_parts(shape)
    prisms = [trimesh.creation.extrude_polygon(part, top - bottom, engine="earcut") for part in parts]
    vertices, faces = trimesh.util.append_faces([prism.vertices for prism in prisms], [prism.faces for prism in prisms])
    return trimesh.Trimesh(vertices + np.array([0.0, 0.0, bottom]), faces, process=False)
