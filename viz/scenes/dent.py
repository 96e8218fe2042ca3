"""Scene of a dent.

It has the deformed sheets on the board and the indenter, with a quarter of them cut out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from coilarray.geometry.array import CoilArray
from coilarray.geometry.indenter import Indenter
from coilarray.geometry.sheet import Sheet
from coilarray.viz.datasets.elastomer import dented_sheet_meshes, indenter_mesh
from coilarray.viz.datasets.overlays import at_depth
from coilarray.viz.datasets.triangles import MM_PER_M
from coilarray.viz.palette import METAL, SHEETS, cycled
from coilarray.viz.scenes.board import Box, scene_of_board, sheet_label
from coilarray.viz.scenes.camera import Direction, aim
from coilarray.viz.scenes.draw import draw, set_camera
from coilarray.viz.scenes.scene import Part, Scene

if TYPE_CHECKING:
    import pyvista
    import xarray as xr


VEILED = 0.13
"""Opacity of dented sheets through which the coils are visible."""

_INTO_THE_CUT = Direction(math.radians(28), math.radians(-118))
_WIDTH = 2.5  # width shown on each side of a dent, in stack thicknesses
_TALL = 0.7  # height of the indenter over the thickness of the stack


def dent_scene(
    array: CoilArray,
    sheets: Sequence[Sheet],
    indentation: xr.Dataset,
    indenter: Indenter,
    *,
    plotter: pyvista.Plotter,
    depth: int = -1,
    centre: tuple[float, float] = (0.0, 0.0),
) -> None:
    """Put a dent into a plotter.

    It has the board, the deformed sheets on it and the indenter. A quarter of them is cut out.

    Parameters
    ----------
    array : CoilArray
        Board that is drawn.
    sheets : sequence of Sheet
        Indented sheets from the board upwards.
    indentation, depth : xarray.Dataset and int
        Result of `coilarray.indent`, and index of the depth in it. The default is the deepest.
    indenter, centre : Indenter and tuple of float
        Body that made the dent, and its x and y on the board in m.
    plotter : pyvista.Plotter
        Plotter that gets the actors. Lengths are in mm.

    Raises
    ------
    ValueError
        If the dataset has no such depth, or the centre is not on the board.
    """
    at = at_depth(indentation, depth)
    box = _around(array, centre, _WIDTH * float(at.height[-1]))
    scene = scene_of_dent(array, sheets, at, indenter, centre, box) + scene_of_board(array, box=box)
    draw(scene, plotter)
    set_camera(plotter, aim(scene.bounds, (plotter.window_size[0], plotter.window_size[1]), _INTO_THE_CUT))


def scene_of_dent(
    array: CoilArray,
    sheets: Sequence[Sheet],
    dent: xr.Dataset,
    indenter: Indenter,
    centre: tuple[float, float],
    box: Box | None = None,
    *,
    opacity: float = 1.0,
) -> Scene:
    """Scene of the deformed sheets and the indenter.

    It shows one depth of an indentation, without the board. The arguments are the same as for `dent_scene`. A `box`
    x_min, y_min, x_max, y_max in m shows this part of the sheets, by default all over the board. A centre outside it
    raises a ValueError.
    """
    extent = array.bounds if box is None else box
    thickness = float(dent.height[-1])
    deep = float(dent.depth)
    body = indenter_mesh(indenter, thickness - deep, centre, extent, _TALL * thickness)
    label = f"{indenter.name}, {deep * MM_PER_M:g} mm deep"
    parts = [Part("indenter", body, label, METAL, smooth=True, ambient=0.3)]
    colours = cycled(SHEETS, [sheet.name for sheet in sheets])
    thick = {sheet.name: sheet.thickness for sheet in sheets}
    for name, mesh in reversed(dented_sheet_meshes(dent, sheets, centre, extent).items()):
        group = sheet_label(name, thick[name])
        parts.append(Part(f"sheet {name}", mesh, group, colours[name], smooth=True, ambient=0.2, opacity=opacity))
    return Scene(tuple(parts))


def name_heights(array: CoilArray, thickness: float, centre: tuple[float, float]) -> npt.NDArray[np.float64]:
    """Heights of the coils' names in m."""
    open_ = (array.centres < centre).all(axis=1)
    return np.where(open_, 0.0, thickness)


def _around(array: CoilArray, centre: tuple[float, float], half: float) -> Box:
    """Square about a point in m, cut to the board."""
    x_min, y_min, x_max, y_max = array.bounds
    x, y = centre
    if not (x_min < x < x_max and y_min < y < y_max):
        raise ValueError(f"centre must be on the board, {array.bounds} m; got {centre} m.")
    return max(x_min, x - half), max(y_min, y - half), min(x_max, x + half), min(y_max, y + half)
