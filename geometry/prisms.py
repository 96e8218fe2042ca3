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
