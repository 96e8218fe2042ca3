"""DXF drawings of the board, in millimetres, through ezdxf."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely

from coilarray.compute.arrays import FloatArray
from coilarray.compute.extras import import_extra
from coilarray.compute.files import require_suffix, write_atomically
from coilarray.errors import OutputError
from coilarray.geometry.arcs import pieces_of
from coilarray.geometry.array import Array
from coilarray.geometry.copper import Drill, board_outline, copper_by_layer, drills

if TYPE_CHECKING:
    from ezdxf.document import Drawing
    from ezdxf.layouts.layout import Modelspace

_MM = 1e3
# Digits of a coordinate in mm: far below anything made, and short numbers in the file.
_DIGITS = 9
_TEXT_HEIGHT = 1.5  # mm
_RELEASE = "R2010"  # the first that every program of today reads and that is UTF-8 throughout
# colours of the AutoCAD colour index, away from the black or white of the background
_LAYER_COLOURS = (1, 5, 3, 6, 30, 4)
_DRILL_COLOUR, _OUTLINE_COLOUR, _SILK_COLOUR = 8, 7, 2
_NOT_IN_NAMES = '<>/\\":;?*|=`'


def write_dxf(array: Array, path: Path) -> None:
    """Write the board as a DXF drawing in mm.

    Parameters
    ----------
    array : Array
        The board.
    path : Path
        File name ending in ``.dxf``. The file is written completely or not at all.

    Raises
    ------
    OutputError
        If the suffix is different, DXF cannot hold the names of the copper layers, or the file cannot be written.
    MissingDependencyError
        If ezdxf is not installed or broken.

    Notes
    -----
    x points to the right, y upwards, and the origin is the origin of the design. The layers:

    - ``copper_<layer>``: edges of the copper of each coil, traces and pads united, as closed polylines without width.
      A polyline inside another is a hole. Cutters, field solvers and CAM programs read this layer. Drilled holes are
      not cut out.
    - ``path_<layer>``: centre lines of the traces as polylines with the width of each segment, arcs as arcs, for
      programs that route. Switched off and not plotted, because it shows the same copper again.
    - ``drill``: a circle for each hole, with its diameter. Holes that are not through the whole board lie on layers of
      their own, named by the copper they pierce, such as ``drill_L1_L2``.
    - ``outline``: edge of the board.
    - ``silk``: names of the coils at their centres.

    Examples
    --------
    >>> from coilarray.geometry import PlatedHole, Placement, Stackup, path_coil
    >>> coil = path_coil([[(0, 0), (1e-2, 0)]], 0.2e-3, 0.2e-3, PlatedHole(0.3e-3, 0.6e-3))
    >>> board = Array(Stackup(("top",), (35e-6,), (), ()), (Placement("A", coil, ("top",), 0, 0),))
    >>> write_dxf(board, Path("board.dwg"))
    Traceback (most recent call last):
    coilarray.errors.OutputError: cannot write board.dwg: the suffix must be .dxf; got '.dwg'.
    """
    require_suffix(path, ".dxf")
    names = array.stackup.names
    listed = ", ".join(names)
    if any(character in name for name in names for character in _NOT_IN_NAMES):
        raise OutputError(f"cannot write {path}: names of layers must be free of {_NOT_IN_NAMES}; got {listed}.")
    if len({name.casefold() for name in names}) < len(names):
        raise OutputError(f"cannot write {path}: names of layers must differ in more than capitals; got {listed}.")
    drawing = _drawing(array)
    write_atomically(path, drawing.saveas)


def _drawing(array: Array) -> Drawing:
    """Make the drawing of a board."""
    ezdxf = import_extra("ezdxf", "DXF files", package="ezdxf", extra="fab")
    drawing: Drawing = ezdxf.new(_RELEASE, units=ezdxf.units.MM)
    holes = [hole for hole in drills(array) if hole.drilled]
    _add_layers(drawing, array, holes)
    space = drawing.modelspace()
    for name, nets in reversed(copper_by_layer(array).items()):  # the top in front
        for copper in nets.values():
            for ring in shapely.get_rings(shapely.get_parts(copper)):
                _add_ring(space, ring, f"copper_{name}")
    _add_paths(space, array)
    for hole in holes:
        x, y = _in_mm(np.array([hole.x, hole.y])).tolist()
        space.add_circle((x, y), hole.diameter / 2 * _MM, dxfattribs={"layer": _drill_layer(array, hole)})
    outline = board_outline(array)
    _add_ring(space, outline.exterior, "outline")
    for placement in array.placements:
        x, y = _in_mm(np.array([placement.x, placement.y])).tolist()
        text = space.add_text(placement.name, height=_TEXT_HEIGHT, dxfattribs={"layer": "silk"})
        text.set_placement((x, y), align=ezdxf.enums.TextEntityAlignment.MIDDLE_CENTER)
    x_min, y_min, x_max, y_max = _in_mm(np.array(outline.bounds)).tolist()
    space.reset_extents((x_min, y_min, 0), (x_max, y_max, 0))
    # programs open the drawing on the whole board
    drawing.set_modelspace_vport(1.1 * max(x_max - x_min, y_max - y_min), ((x_min + x_max) / 2, (y_min + y_max) / 2))
    return drawing


def _add_layers(drawing: Drawing, array: Array, holes: Iterable[Drill]) -> None:
    """Add the layers of the drawing, with their colours."""
    for k, name in enumerate(array.stackup.names):
        colour = _LAYER_COLOURS[k % len(_LAYER_COLOURS)]
        drawing.layers.add(f"copper_{name}", color=colour)
        drawing.layers.add(f"path_{name}", color=colour, plot=False).off()
    for name in sorted({_drill_layer(array, hole) for hole in holes}):
        drawing.layers.add(name, color=_DRILL_COLOUR)
    drawing.layers.add("outline", color=_OUTLINE_COLOUR)
    drawing.layers.add("silk", color=_SILK_COLOUR)


def _drill_layer(array: Array, hole: Drill) -> str:
    return "drill" if hole.layers == array.stackup.names else "_".join(("drill", *hole.layers))


def _add_paths(space: Modelspace, array: Array) -> None:
    """Add the centre lines of all traces.

    They have widths and arcs.
    """
    for placement in array.placements:
        for k, (line, widths, layer) in enumerate(placement.traces()):
            pieces = list(pieces_of(line, placement.coil.arcs_of(k)))
            # a vertex carries width and bulge of the piece that begins there, but no piece begins at the last vertex
            begun = np.array([(widths[piece.first] * _MM, piece.bulge) for piece in pieces])
            begun = np.vstack((begun, (begun[-1, 0], 0.0)))
            places = _in_mm(line[[piece.first for piece in pieces] + [len(line) - 1]])
            vertices = np.column_stack((places, begun[:, [0, 0, 1]])).tolist()
            space.add_lwpolyline(vertices, format="xyseb", dxfattribs={"layer": f"path_{layer}"})


def _add_ring(space: Modelspace, ring: shapely.LinearRing, layer: str) -> None:
    corners = _in_mm(shapely.get_coordinates(ring))[:-1]  # the closing edge is implied
    space.add_lwpolyline(corners.tolist(), close=True, dxfattribs={"layer": layer})


def _in_mm(lengths: FloatArray) -> FloatArray:
    return np.round(lengths * _MM, _DIGITS) + 0.0  # + 0.0: no −0 in the file
