"""Closed solids of the board: copper, barrels, laminate and the sheets on top."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import shapely

from coilarray.geometry.array import CoilArray
from coilarray.geometry.prisms import Prism, board_prisms, sheet_prisms
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
    on_top = sheet_solids(array, sheets)
    return {key: solid.copy() for key, solid in _board(array).items()} | on_top


def sheet_solids(array: CoilArray, sheets: Sequence[Sheet]) -> dict[str, trimesh.Trimesh]:
    """Build the sheets of `solids` alone, which takes much less time; GeometryError for two of the same name."""
    return {key: _extruded(prism) for key, prism in sheet_prisms(array, sheets).items()}


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
