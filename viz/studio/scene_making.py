"""Scenes of the studio from results on the page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr

from coilarray.circuit.network import StateResult
from coilarray.design.model import Design
from coilarray.response.setup import indentation_of, target_of
from coilarray.viz.datasets.field import AMOUNT
from coilarray.viz.scenes.board import VEILED, CoilColours, recoloured, scene_of_dent, scene_of_sheets
from coilarray.viz.scenes.field import scale_of_field, scene_of_slices
from coilarray.viz.scenes.metal import (
    Position,
    around_board,
    at_their_largest,
    eddies_of_plates,
    eddies_of_target,
    eddy_parts,
    scale_of_eddies,
    scene_of_plates,
    scene_of_target,
    working_point,
)
from coilarray.viz.scenes.results import colours_of_currents, colours_of_delta, scene_of_location
from coilarray.viz.scenes.scene import Part, Scene
from coilarray.viz.studio.metal import Moved
from coilarray.viz.studio.switching import UnitFields
from coilarray.viz.studio.top_view import delta_by_coil
from coilarray.viz.studio.touch import Touched


@dataclass(frozen=True, eq=False)
class BoardParts:
    """Board in pieces.

    They are computed once and can have other colours.
    """

    design: Design
    copper: tuple[Part, ...]  # one part per layer
    rest: Scene  # laminate, barrels, names and rulers

    def coloured(self, colours: CoilColours) -> Scene:
        """Colour the copper by values of the coils."""
        return Scene(recoloured(self.copper, colours)) + self.rest


def switched_scene(board: BoardParts, fields: UnitFields | None, result: StateResult) -> Scene:
    """Scene of a switch state.

    The board is coloured by the currents of the state. Above it is a plane of B for 1 mA in its first coil. The
    `fields` are None for a design with plates, because beside plates they differ at every frequency.
    """
    names = board.design.array.names
    first = names.index(result.state.measured[0][0])
    scene = board.coloured(colours_of_currents(result.currents, first))
    if fields is None:
        return scene + Scene(notes=("B beside plates is shown by coilarray view --show board,field.",))
    plane = fields.plane(result.currents.real * 1e-3)
    if np.asarray(plane.point_data[AMOUNT]).max(initial=0.0) > 0:
        scene += scene_of_slices([plane], scale_of_field([plane]))
    note = f"B in phase, {fields.height * 1e3:g} mm above the board, without elastomer; 1 mA."
    return scene + Scene(notes=(note,))


def metal_scene(board: BoardParts, moved: Moved | None, step: int, coupling: xr.Dataset | None) -> Scene:
    """Scene of a board with sheets, plates and the target.

    The target is at one of its distances. With a `coupling`, eddy currents are shown for 1 mA in the middle coil.
    """
    design, within = board.design, around_board(board.design.array)
    scene = scene_of_sheets(design.array, design.sheets) + scene_of_plates(design.plates, within)
    scene += Scene(board.copper) + board.rest
    distances = [] if moved is None else [moved.distances[step]]
    place = (0.0, 0.0) if moved is None else moved.place
    scale, of_target = None, None
    if coupling is not None:
        coil = design.array.middle_coil
        operation = working_point(design, coupling, coil, 1e-3, terminated=True)
        phasors = eddies_of_plates(design, design.plates, operation, within)
        found = [one for one in eddies_of_target(design, place, distances, operation, within) if one is not None]
        eddies, when = at_their_largest([*phasors, *found])
        scale = scale_of_eddies(eddies)
        for number, one in enumerate(eddies[: len(phasors)]):
            scene += Scene(eddy_parts(f"eddies of plate {number}", one, scale, within))
        of_target = eddies[-1] if found else None
        scene += Scene(notes=(f"Eddy currents {when}; 1 mA in {coil}.",))
    for distance in distances:
        height = target_of(design).height(design.top, distance)
        position = Position(distance, (*place, height), of_target)
        scene += scene_of_target(target_of(design).body, [position], within, scale, 0).still()
    return scene


def touched_scene(board: BoardParts, dent: xr.Dataset, touch: Touched) -> Scene:
    """Scene of a touch.

    The board is coloured by δ. Over it are the dent (one depth) in the sheets and the located position.
    """
    design, setup = board.design, indentation_of(board.design)
    scene = coloured_by_delta(board, touch.delta)
    x, y = touch.at
    x_min, y_min, x_max, y_max = design.array.bounds
    if x_min < x < x_max and y_min < y < y_max:
        scene += scene_of_dent(design.array, design.sheets, dent, setup.indenter, (x, y), opacity=VEILED)
    top = sum(sheet.thickness for sheet in design.sheets)
    return scene + scene_of_location(touch.location, bounds=design.array.bounds, top=top, truth=touch.at)


def coloured_by_delta(board: BoardParts, delta: Mapping[str, float | None], least: float = 0.0) -> Scene:
    """Scene of a board with its copper coloured by δ.

    `least` has the same meaning as in `colours_of_delta`.
    """
    return board.coloured(colours_of_delta(delta_by_coil(board.design, delta), least))
