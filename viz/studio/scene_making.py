"""Scenes of the studio, from what the page has computed; the same parts that all other pictures are made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from coilarray.circuit.network import StateResult
from coilarray.design.model import Design
from coilarray.elastomer.contact import indent
from coilarray.response.setup import indentation_of
from coilarray.viz.scenes.board import CoilColours, recoloured, scene_of_board, scene_of_lifted_board
from coilarray.viz.scenes.dent import scene_of_dent
from coilarray.viz.scenes.overlays import colours_of_currents, scale_of_field, scene_of_location, scene_of_slices
from coilarray.viz.scenes.scene import Part, Scene, symmetric
from coilarray.viz.studio.switching import UnitFields
from coilarray.viz.studio.top_view import delta_by_coil
from coilarray.viz.studio.touch import Touched

_VEILED = 0.13  # opacity of dented sheets: the coils are seen through them
_COPPER = "copper "


@dataclass(frozen=True, eq=False)
class BoardParts:
    """A board in pieces: what takes long is made once, and coloured anew.

    Parameters
    ----------
    design : Design
        Of the board.
    copper : tuple of Part
        A part for each layer.
    rest : Scene
        Laminate, barrels, names and rulers.
    """

    design: Design
    copper: tuple[Part, ...]
    rest: Scene

    def coloured(self, colours: CoilColours) -> Scene:
        """Return the board with values of the coils as colours of the copper."""
        return Scene(recoloured(self.copper, colours)) + self.rest


def board_parts(design: Design) -> BoardParts:
    """Take a board to pieces."""
    board = scene_of_board(design.array)
    copper = tuple(part for part in board.parts if part.name.startswith(_COPPER))
    rest = tuple(part for part in board.parts if not part.name.startswith(_COPPER))
    return BoardParts(design, copper, replace(board, parts=rest))


def plain_scene(design: Design) -> Scene:
    """Return the board with its sheets lifted off it."""
    return scene_of_lifted_board(design.array, design.sheets)


def switched_scene(board: BoardParts, fields: UnitFields, result: StateResult, current: float = 1e-3) -> Scene:
    """Return the board coloured by the currents of a state, under the plane of the field that they make.

    Parameters
    ----------
    board : BoardParts
        Of the design.
    fields : UnitFields
        Of the same design.
    result : StateResult
        Of the state.
    current : float
        Of the first measured coil in A.
    """
    names = board.design.array.names
    first = names.index(result.state.measured[0][0])
    plane = fields.plane(result.currents.real * current)
    scene = board.coloured(colours_of_currents(result.currents, first))
    if np.asarray(plane.point_data["|B| (T)"]).max(initial=0.0) > 0:
        scene += scene_of_slices([plane], scale_of_field([plane]))
    note = f"B in phase, {fields.height * 1e3:g} mm above the board, without elastomer; {current * 1e3:g} mA."
    return scene + Scene(notes=(note,))


def dent_of_design(design: Design, depth: float) -> xr.Dataset:
    """Press into the sheets of a design as deep as said in m; see `coilarray.elastomer.contact.indent`."""
    setup = indentation_of(design)
    return indent(design.sheets, setup.indenter, [depth], base=setup.base, radius=setup.sample_radius).isel(depth=0)


def touched_scene(board: BoardParts, dent: xr.Dataset, touch: Touched) -> Scene:
    """Return the board coloured by δ, the dent in the sheets over it, and where the indenter was located.

    Parameters
    ----------
    board : BoardParts
        Of the design.
    dent : xarray.Dataset
        One depth of an indentation of its sheets.
    touch : Touched
        Where it is.
    """
    design, setup = board.design, indentation_of(board.design)
    scene = coloured_by_delta(board, touch.delta)
    x, y = touch.at[0] + setup.origin_point[0], touch.at[1] + setup.origin_point[1]
    x_min, y_min, x_max, y_max = design.array.bounds
    if x_min < x < x_max and y_min < y < y_max:
        scene += scene_of_dent(design.array, design.sheets, dent, setup.indenter, (x, y), opacity=_VEILED)
    top = sum(sheet.thickness for sheet in design.sheets)
    return scene + scene_of_location(
        touch.location, origin=setup.origin_point, bounds=design.array.bounds, top=top, truth=touch.at
    )


def coloured_by_delta(board: BoardParts, delta: Mapping[str, float | None]) -> Scene:
    """Return the board with δ of every coil as the colour of its copper."""
    by_coil = delta_by_coil(board.design, delta)
    values = np.array([np.nan if value is None else value for value in by_coil.values()])
    return board.coloured(CoilColours(values, symmetric("delta (1)", "δ", "", values)))
