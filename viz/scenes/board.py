"""Scenes of a board with laminate, copper, names and rulers, and of the sheets on it, flat or dented."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from coilarray.compute.display_units import true_minus
from coilarray.errors import GeometryError
from coilarray.geometry.array import Array
from coilarray.geometry.elastomer import Indenter, Sheet
from coilarray.geometry.solids import board_solids, sheet_solids
from coilarray.viz.datasets.elastomer import dented_sheet_meshes, indenter_mesh, sheet_meshes
from coilarray.viz.datasets.meshes import MM_PER_M, barrel_mesh, board_mesh, copper_mesh, surface_of, with_coil_values
from coilarray.viz.datasets.results import at_depth
from coilarray.viz.palette import BARREL, INK, LAMINATE, LAYERS, METAL, SHEETS, cycled
from coilarray.viz.scenes.draw import draw, set_camera
from coilarray.viz.scenes.scene import Direction, Part, Scale, Scene, Side, Text, aim, direction

if TYPE_CHECKING:
    import pyvista
    import trimesh
    import xarray as xr


Box = tuple[float, float, float, float]

_GLASS = 0.12  # opacity of a sheet
_RISER = "#BBBBBB"
_COPPER = "copper "


@dataclass(frozen=True, eq=False)
class CoilColours:
    """Values of the coils as colours of their copper."""

    values: npt.NDArray[np.float64]  # shape (coils,), NaN for a coil without a value
    scale: Scale  # its `array` is the name of the values in the meshes


def board_scene(
    array: Array, sheets: Sequence[Sheet] = (), *, plotter: pyvista.Plotter, show_sheets: bool = True
) -> None:
    """Put a board into a plotter.

    It has laminate, copper, barrels, coil names, a legend and a scale in mm. The camera is aimed at it. Copper is
    coloured by layer. The laminate is translucent, so that the lower layers show through it. The sheets are lifted off
    the board and off each other and drawn as thin glass with clear edges.

    Parameters
    ----------
    array : Array
        Board that is drawn.
    sheets : sequence of Sheet
        Elastomer sheets on it, the lowest first.
    plotter : pyvista.Plotter
        Plotter that gets the actors. Lengths are in mm.
    show_sheets : bool
        False leaves the sheets out.
    """
    draw(scene_of_lifted_board(array, sheets if show_sheets else ()), plotter)


def scene_of_lifted_board(array: Array, sheets: Sequence[Sheet] = ()) -> Scene:
    """Scene of a board with its sheets lifted."""
    # Raised until the nearest edge of the lowest sheet stands above the farthest edge of the board.
    lift = (array.bounds[3] - array.bounds[1]) * math.tan(direction("oblique").elevation)
    above = scene_of_sheets(array, sheets, lift, lift / 3)
    risers = _risers(array, min(part.mesh.bounds[4] for part in above.parts)) if above.parts else ()
    return above + scene_of_board(array) + Scene(risers)


def scene_of_board(
    array: Array,
    *,
    layers: Sequence[str] | None = None,
    colours: CoilColours | None = None,
    box: Box | None = None,
    name_heights: npt.ArrayLike = 0.0,
) -> Scene:
    """Scene of a board.

    It has laminate, copper with a group per layer, barrels, names of the coils and rulers. `layers` are the copper
    layers that are shown, all by default. `colours` of the coils replace the layers' colours. A `box` x_min, y_min,
    x_max, y_max in m shows this part, without rulers, barrels and names. `name_heights` in m, a number or an array over
    the coils, lift the names above anything that covers the coils. A layer that the board lacks raises a GeometryError.
    """
    parts = board_solids(array)
    copper = copper_parts(array, layers, colours, box, parts)
    board = cut_upright(board_mesh(parts), box)
    # Copper may share a face with the board, so the board is drawn just behind it.
    plate = Part("board", board, "laminate", LAMINATE, opacity=0.3, ambient=0.3, sunk=True)
    laminate = [plate] if board.n_cells else []
    if box is not None:
        return Scene((*copper, *laminate))
    barrels = barrel_mesh(parts, array.names)
    through = [Part("barrels", barrels, "barrels", BARREL, closed=True)] if barrels.n_cells else []
    edges = [_edges("edges of board", board, "laminate", LAMINATE)] if laminate else []
    x_min, y_min, x_max, y_max = (MM_PER_M * edge for edge in array.bounds)
    length = 0.012 * (x_max - x_min + y_max - y_min)
    front, numbers = _ruler("x", (x_min, x_max), y_min, length)
    left, more = _ruler("y", (y_min, y_max), x_min, length)
    texts = (*coil_names(array, name_heights), *numbers, *more)
    return Scene((*copper, *through, *laminate, *edges, front, left), texts)


def copper_parts(
    array: Array,
    layers: Sequence[str] | None = None,
    colours: CoilColours | None = None,
    box: Box | None = None,
    parts: Mapping[str, trimesh.Trimesh] | None = None,
) -> tuple[Part, ...]:
    """Copper of a board, one part per layer, see `scene_of_board`."""
    parts = board_solids(array) if parts is None else parts
    copper = tuple(
        Part(name, mesh, name, colour, ambient=0.45, diffuse=0.6, closed=box is None)
        for layer, colour in _shown_layers(array, layers).items()
        if (mesh := cut_upright(copper_mesh(parts, array.names, layer), box)).n_cells and (name := f"{_COPPER}{layer}")
    )
    return copper if colours is None else recoloured(copper, colours)


def board_in_pieces(array: Array) -> tuple[tuple[Part, ...], Scene]:
    """Copper of a board for `recoloured`, and the scene of the rest."""
    board = scene_of_board(array)
    copper = tuple(part for part in board.parts if part.name.startswith(_COPPER))
    return copper, replace(board, parts=tuple(part for part in board.parts if part not in copper))


def recoloured(copper: Sequence[Part], colours: CoilColours) -> tuple[Part, ...]:
    """Give the copper of `copper_parts` other coil values."""
    values, scale = colours.values, colours.scale
    return tuple(
        replace(
            part, mesh=with_coil_values(part.mesh, values, scale.array), colour=BARREL, scale=scale, ambient=0.7,
            diffuse=0.35,
        )
        for part in copper
    )  # fmt: skip


def scene_of_sheets(array: Array, sheets: Sequence[Sheet], lift: float = 0.0, spread: float = 0.0) -> Scene:
    """Scene of flat sheets as glass, lifted as in `sheet_meshes`."""
    thick = {sheet.name: sheet.thickness for sheet in sheets}
    colours = cycled(SHEETS, list(thick))
    parts: list[Part] = []
    for name, mesh in reversed(sheet_meshes(sheet_solids(array, sheets), lift, spread).items()):
        group = sheet_label(name, thick[name])
        parts.append(Part(f"sheet {name}", mesh, group, colours[name], opacity=_GLASS, lit=False))
        parts.append(_edges(f"edges of sheet {name}", mesh, group, colours[name]))
    return Scene(tuple(parts))


def sheet_label(name: str, thickness: float) -> str:
    """Legend text of a sheet with a thickness in m."""
    return f"{name} {thickness * MM_PER_M:g} mm"


def coil_names(array: Array, heights: npt.ArrayLike = 0.0) -> tuple[Text, ...]:
    """Names over the coils' centres, at one or each height in m."""
    z = np.broadcast_to(np.asarray(heights, dtype=np.float64), (len(array.names),)) * MM_PER_M
    return tuple(
        Text(name, (x, y, up), 24.0, bold=True)
        for name, (x, y), up in zip(array.names, (array.centres * MM_PER_M).tolist(), z.tolist(), strict=True)
    )


def cut_upright(mesh: pyvista.PolyData, box: Box | None) -> Any:
    """Cut a mesh upright to a rectangle in m and leave it open there, or return it without one."""
    if box is None or not mesh.n_cells:
        return mesh
    x_min, y_min, x_max, y_max = (MM_PER_M * edge for edge in box)
    low, high = mesh.bounds[4:]
    return surface_of(mesh.clip_box([x_min, x_max, y_min, y_max, low - 1.0, high + 1.0], invert=False))


def _shown_layers(array: Array, layers: Sequence[str] | None) -> dict[str, str]:
    """Colour of every copper layer that is shown."""
    colours = cycled(LAYERS, array.stackup.names)
    for layer in layers or ():
        if layer not in colours:
            raise GeometryError(f"the board has no copper layer {layer!r}; there are {', '.join(colours)}.")
    return {name: colour for name, colour in colours.items() if layers is None or name in layers}


def _edges(name: str, mesh: pyvista.PolyData, group: str, colour: str) -> Part:
    """Edges of a mesh's bounding box."""
    return Part(name, mesh.outline(), group, colour, line_width=2.0, lit=False)


def _risers(array: Array, top: float) -> tuple[Part, ...]:
    """Upright lines from the board's far corners to `top` in mm."""
    from coilarray.viz.extra_3d import pyvista

    x_min, _, x_max, y_max = (MM_PER_M * edge for edge in array.bounds)
    lines = pyvista.line_segments_from_points([(x, y_max, height) for x in (x_min, x_max) for height in (0.0, top)])
    return (Part("risers", lines, colour=_RISER, lit=False),)


def _ruler(axis: Literal["x", "y"], ends: tuple[float, float], at: float, length: float) -> tuple[Part, list[Text]]:
    """Ticks of a length with numbers along an axis, in mm."""
    from matplotlib.ticker import MaxNLocator

    from coilarray.viz.extra_3d import pyvista

    low, high = ends
    ticks = np.asarray(MaxNLocator(10 if axis == "x" else 4, steps=[1, 2, 5, 10]).tick_values(low, high))
    ticks = ticks[(ticks >= low) & (ticks <= high)]
    edge_on: Side = "right" if axis == "x" else "front"

    def place(along: float, outwards: float) -> tuple[float, float, float]:
        """Place as far below the board as outside it, for views from the side."""
        return (along, at - outwards, -outwards) if axis == "x" else (at - outwards, along, -outwards)

    marks = pyvista.line_segments_from_points([place(t, d) for t in ticks.tolist() for d in (0.0, length)])
    texts = [Text(true_minus(f"{t:g}"), place(t, 2.2 * length), hidden_from=(edge_on,)) for t in ticks.tolist()]
    # Beyond the end of the edge it is clear of the numbers unless the board is small in the picture.
    title = Text(f"{axis} (mm)", place(high + 4 * length, 2.2 * length), hidden_from=(edge_on,), always=True)
    return Part(f"ticks {axis}", marks, colour=INK, lit=False), [*texts, title]


VEILED = 0.13
"""Opacity of dented sheets through which the coils are visible."""

_INTO_THE_CUT = Direction(math.radians(28), math.radians(-118))
_WIDTH = 2.5  # width shown on each side of a dent, in stack thicknesses
_TALL = 0.7  # height of the indenter over the thickness of the stack


def dent_scene(
    array: Array,
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
    array : Array
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
    array: Array,
    sheets: Sequence[Sheet],
    dent: xr.Dataset,
    indenter: Indenter,
    centre: tuple[float, float],
    box: Box | None = None,
    *,
    opacity: float = 1.0,
) -> Scene:
    """Scene of the deformed sheets and the indenter.

    The arguments are the same as for `dent_scene`. A `box` x_min, y_min, x_max, y_max in m shows this part of the
    sheets, by default all over the board. A centre outside it raises a ValueError.
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


def name_heights(array: Array, thickness: float, centre: tuple[float, float]) -> npt.NDArray[np.float64]:
    """Heights of the coils' names in m."""
    open_ = (array.centres < centre).all(axis=1)
    return np.where(open_, 0.0, thickness)


def _around(array: Array, centre: tuple[float, float], half: float) -> Box:
    """Square about a point in m, cut to the board."""
    x_min, y_min, x_max, y_max = array.bounds
    x, y = centre
    if not (x_min < x < x_max and y_min < y < y_max):
        raise ValueError(f"centre must be on the board, {array.bounds} m; got {centre} m.")
    return max(x_min, x - half), max(y_min, y - half), min(x_max, x + half), min(y_max, y + half)
