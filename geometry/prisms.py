"""The board and its sheets as prisms: outline, lower and upper face of every solid piece."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.errors import GeometryError
from coilarray.geometry.array import CoilArray
from coilarray.geometry.copper import Drill, board_outline, copper_by_layer, disc, drills
from coilarray.geometry.sheet import Sheet


@dataclass(frozen=True)
class Prism:
    """A flat piece with upright walls.

    Parameters
    ----------
    shape : shapely.Polygon or shapely.MultiPolygon
        Outline in m; circles are those of `coilarray.geometry.copper.disc`.
    bottom, top : float
        Heights of the two faces in m.
    """

    shape: BaseGeometry
    bottom: float
    top: float


def board_prisms(array: CoilArray) -> dict[str, Prism]:
    """Divide a board into copper, barrels and laminate.

    Parameters
    ----------
    array : CoilArray
        The board.

    Returns
    -------
    dict of str to Prism
        Prisms by the keys of `coilarray.geometry.solids`.

    Examples
    --------
    >>> from coilarray.geometry import Placement, PlatedHole, Stackup, path_coil
    >>> coil = path_coil([[(0, 0), (1e-2, 0)]], 0.2e-3, 0.2e-3, PlatedHole(0.3e-3, 0.6e-3))
    >>> board = CoilArray(Stackup(("top",), (35e-6,), (), ()), (Placement("A", coil, ("top",), 0, 0),))
    >>> [(key, prism.bottom) for key, prism in board_prisms(board).items()]
    [('copper/top/A', -3.5e-05)]
    """
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
    """Stack sheets on a board, upwards from z = 0.

    Parameters
    ----------
    array : CoilArray
        The board; each sheet covers all of it.
    sheets : sequence of Sheet
        Sheets from the board upwards; names all different.

    Returns
    -------
    dict of str to Prism
        Prisms by ``sheet/<name>``.

    Raises
    ------
    GeometryError
        Two sheets of the same name.
    """
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
