"""Scenes of a board in three dimensions: what is drawn, in which colour, seen from where."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from coilarray.errors import MissingDependencyError
from coilarray.files import write_atomically
from coilarray.geometry.array import CoilArray
from coilarray.geometry.indenter import Indenter
from coilarray.geometry.sheet import Sheet
from coilarray.geometry.solids import solids
from coilarray.viz.datasets import (
    MM_PER_M,
    at_depth,
    barrel_mesh,
    board_mesh,
    copper_mesh,
    dented_sheet_meshes,
    indenter_mesh,
    sheet_meshes,
)
from coilarray.viz.offscreen import has_screen, rendering_problem
from coilarray.viz.palette import BARREL, INK, LAMINATE, LAYERS, SHEETS, cycled

if TYPE_CHECKING:
    import pyvista
    import xarray as xr

_ELEVATION, _AZIMUTH = math.radians(48), math.radians(-97)  # from where the camera looks, seen from the board
_DENT_ELEVATION, _DENT_AZIMUTH = math.radians(28), math.radians(-118)  # into the quarter that is cut out
_DENT_WIDTH = 2.5  # thicknesses of the stack shown on each side of a dent
_STEEL = "#7C828A"
_FILLED = 0.88  # of the picture's height or width by the scene, without the numbers of the rulers


def board_scene(
    array: CoilArray, sheets: Sequence[Sheet] = (), *, plotter: pyvista.Plotter, show_sheets: bool = True
) -> None:
    """Put a board into a plotter: laminate, copper, barrels, coil names, legend and a scale in mm, and aim the camera.

    Copper is coloured by layer; the laminate is translucent, so that the lower layers show through it. The sheets
    are lifted off the board and off each other and drawn as thin glass with clear edges.

    Parameters
    ----------
    array : CoilArray
        The board.
    sheets : sequence of Sheet
        The elastomer on it, the lowest first.
    plotter : pyvista.Plotter
        Filled with actors; lengths in mm.
    show_sheets : bool
        False leaves the sheets out.
    """
    scene: Any = plotter  # PyVista's decorators lose the signatures of its methods, each version in its own way
    shown = {sheet.name: sheet for sheet in sheets} if show_sheets else {}
    parts = solids(array, tuple(shown.values()))
    board = board_mesh(parts)
    entries: list[list[str]] = []
    scene.set_background("white")

    # raised until the nearest edge of the lowest sheet stands above the farthest edge of the board
    lift = (array.bounds[3] - array.bounds[1]) * math.tan(_ELEVATION)
    raised = sheet_meshes(parts, lift, lift / 3)
    colours = cycled(SHEETS, list(shown))
    for name, mesh in reversed(raised.items()):
        scene.add_mesh(mesh, color=colours[name], opacity=0.12, lighting=False, name=f"sheet {name}")
        _outline(scene, mesh, colours[name], name=f"edges of sheet {name}")
        entries.append([f"{name} {shown[name].thickness * MM_PER_M:g} mm", colours[name]])
    for layer, colour in cycled(LAYERS, array.stackup.names).items():
        copper = copper_mesh(parts, array.names, layer)
        if copper.n_cells:
            scene.add_mesh(copper, color=colour, ambient=0.45, diffuse=0.6, name=f"copper {layer}")
            entries.append([f"copper {layer}", colour])
    barrels = barrel_mesh(parts, array.names)
    if barrels.n_cells:
        scene.add_mesh(barrels, color=BARREL, name="barrels")
        entries.append(["barrels", BARREL])
    if board.n_cells:
        laminate = scene.add_mesh(board, color=LAMINATE, opacity=0.3, ambient=0.3, name="board")
        # copper may share a face with the board: draw the board just behind it
        laminate.mapper.SetResolveCoincidentTopologyToPolygonOffset()
        laminate.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(2.0, 2.0)
        _outline(scene, board, LAMINATE, name="edges of board")
        entries.append(["laminate", LAMINATE])

    if raised:
        _risers(scene, array, max(mesh.bounds[4] for mesh in raised.values()))
    _coil_names(scene, array)
    _rulers(scene, array)
    scene.add_legend(entries, face="rectangle", bcolor=None, size=(0.11, 0.033 * len(entries)), loc="upper left")
    _aim(scene)


def save_board_picture(
    array: CoilArray, path: Path, sheets: Sequence[Sheet] = (), size: tuple[int, int] = (1600, 900)
) -> None:
    """Render a board off-screen into an image file.

    Parameters
    ----------
    array, sheets
        As in `board_scene`.
    path : Path
        Where to; the suffix (.png, .jpg, .bmp, .tif) sets the format. It appears only when it is complete.
    size : tuple of int
        Width and height of the picture in pixels.

    Raises
    ------
    MissingDependencyError
        Where this machine cannot render; the text names the system packages.
    """
    with _off_screen(size) as plotter:
        board_scene(array, sheets, plotter=plotter)
        write_atomically(path, lambda temporary: _screenshot(plotter, temporary))


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
    """Put a dent into a plotter: the board, the deformed sheets on it and the indenter, a quarter of them cut out.

    Parameters
    ----------
    array : CoilArray
        The board.
    sheets : sequence of Sheet
        From the board upwards, as they were indented.
    indentation : xarray.Dataset
        As `coilarray.elastomer.indent` returns it.
    indenter : Indenter
        The body that made the dent.
    plotter : pyvista.Plotter
        Filled with actors; lengths in mm.
    depth : int
        Position of the depth in the dataset; the deepest by default.
    centre : tuple of float
        x and y in m of the indenter on the board.

    Raises
    ------
    ValueError
        A depth that the dataset does not have, or a centre that is not on the board.
    """
    scene: Any = plotter
    at = at_depth(indentation, depth)
    thickness = float(at.height[-1])
    extent = _around(array, centre, _DENT_WIDTH * thickness)
    parts = solids(array)
    box = [MM_PER_M * edge for edge in (extent[0], extent[2], extent[1], extent[3])]
    entries: list[list[str]] = []
    scene.set_background("white")
    scene.add_mesh(
        indenter_mesh(indenter, thickness - float(at.depth), centre, extent, 0.7 * thickness),
        color=_STEEL,
        split_sharp_edges=True,
        smooth_shading=True,
        ambient=0.3,
        name="indenter",
    )
    entries.append([f"{indenter.name}, {float(at.depth) * MM_PER_M:g} mm deep", _STEEL])
    colours = cycled(SHEETS, [sheet.name for sheet in sheets])
    for name, mesh in reversed(dented_sheet_meshes(at, sheets, centre, extent).items()):
        scene.add_mesh(
            mesh, color=colours[name], split_sharp_edges=True, smooth_shading=True, ambient=0.2, name=f"sheet {name}"
        )
        thick = next(sheet.thickness for sheet in sheets if sheet.name == name)
        entries.append([f"{name} {thick * MM_PER_M:g} mm", colours[name]])
    for layer, colour in cycled(LAYERS, array.stackup.names).items():
        copper = copper_mesh(parts, array.names, layer)
        near = copper.clip_box([*box, *copper.bounds[4:]], invert=False) if copper.n_cells else copper
        if near.n_cells:
            scene.add_mesh(near, color=colour, ambient=0.45, diffuse=0.6, name=f"copper {layer}")
            entries.append([f"copper {layer}", colour])
    board = board_mesh(parts)
    if board.n_cells:
        near = board.clip_box([*box, *board.bounds[4:]], invert=False)
        scene.add_mesh(near, color=LAMINATE, opacity=0.3, ambient=0.3, name="board")
        entries.append(["laminate", LAMINATE])
    scene.add_legend(entries, face="rectangle", bcolor=None, size=(0.16, 0.033 * len(entries)), loc="upper left")
    _aim(scene, _DENT_ELEVATION, _DENT_AZIMUTH)


def save_dent_picture(
    array: CoilArray,
    path: Path,
    sheets: Sequence[Sheet],
    indentation: xr.Dataset,
    indenter: Indenter,
    depth: int = -1,
    centre: tuple[float, float] = (0.0, 0.0),
    size: tuple[int, int] = (1600, 900),
) -> None:
    """Render a dent off-screen into an image file.

    Parameters
    ----------
    array, sheets, indentation, indenter, depth, centre
        As in `dent_scene`.
    path, size
        As in `save_board_picture`.

    Raises
    ------
    ValueError
        As in `dent_scene`.
    MissingDependencyError
        Where this machine cannot render; the text names the system packages.
    """
    with _off_screen(size) as plotter:
        dent_scene(array, sheets, indentation, indenter, plotter=plotter, depth=depth, centre=centre)
        write_atomically(path, lambda temporary: _screenshot(plotter, temporary))


def show_board(array: CoilArray, sheets: Sequence[Sheet] = ()) -> None:
    """Open a window with the board and return when the user closes it.

    Raises
    ------
    MissingDependencyError
        Where there is no screen, or this machine cannot render.
    """
    if not has_screen():
        raise MissingDependencyError("a window needs a screen, and neither DISPLAY nor WAYLAND_DISPLAY is set.")
    problem = rendering_problem()
    if problem is not None:
        raise MissingDependencyError(problem)
    import pyvista

    plotter: Any = pyvista.Plotter(title="coilarray")
    plotter.enable_anti_aliasing("ssaa")
    board_scene(array, sheets, plotter=plotter)
    plotter.show()


@contextmanager
def _off_screen(size: tuple[int, int]) -> Iterator[Any]:
    """Open a plotter that has no window; MissingDependencyError where this machine cannot render."""
    problem = rendering_problem()
    if problem is not None:
        raise MissingDependencyError(problem)
    import pyvista

    plotter: Any = pyvista.Plotter(off_screen=True, window_size=list(size))
    try:
        plotter.enable_anti_aliasing("ssaa")  # several samples a pixel: turns are about as wide as a pixel
        yield plotter
    finally:
        plotter.close()


def _around(array: CoilArray, centre: tuple[float, float], half: float) -> tuple[float, float, float, float]:
    """Square about a point cut to the board, in m."""
    x_min, y_min, x_max, y_max = array.bounds
    x, y = centre
    if not (x_min < x < x_max and y_min < y < y_max):
        raise ValueError(f"centre must be on the board, {array.bounds} m; got {centre} m.")
    return max(x_min, x - half), max(y_min, y - half), min(x_max, x + half), min(y_max, y + half)


def _screenshot(scene: Any, path: Path) -> None:
    scene.screenshot(path, return_img=False)


def _outline(scene: Any, mesh: pyvista.PolyData, colour: str, *, name: str) -> None:
    """Draw the edges of a mesh's bounding box, which for a board and its sheets are its own."""
    scene.add_mesh(mesh.outline(), color=colour, line_width=_pixels(scene, 2), lighting=False, name=name)


def _risers(scene: Any, array: CoilArray, top: float) -> None:
    """Draw upright lines from the board's far corners to the height `top` in mm: along them the sheets were lifted."""
    import pyvista

    x_min, _, x_max, y_max = (MM_PER_M * edge for edge in array.bounds)
    lines = pyvista.line_segments_from_points([(x, y_max, height) for x in (x_min, x_max) for height in (0.0, top)])
    scene.add_mesh(lines, color="#BBBBBB", line_width=_pixels(scene, 1.5), lighting=False, name="risers")


def _coil_names(scene: Any, array: CoilArray) -> None:
    """Write every coil's name into the middle of its winding."""
    points = np.column_stack((array.centres * MM_PER_M, np.zeros(len(array.names))))
    _write(scene, points, list(array.names), 24, bold=True, name="coil names")


def _rulers(scene: Any, array: CoilArray) -> None:
    """Draw scales in mm along the front and the left edge of the board."""
    import pyvista
    from matplotlib.ticker import MaxNLocator

    x_min, y_min, x_max, y_max = (MM_PER_M * edge for edge in array.bounds)
    length = 0.012 * (x_max - x_min + y_max - y_min)
    for axis, (low, high), at in (("x", (x_min, x_max), y_min), ("y", (y_min, y_max), x_min)):
        ticks = np.asarray(MaxNLocator(10 if axis == "x" else 4, steps=[1, 2, 5, 10]).tick_values(low, high))
        ticks = ticks[(ticks >= low) & (ticks <= high)]

        def place(along: float, outwards: float, axis: str = axis, at: float = at) -> tuple[float, float, float]:
            return (along, at - outwards, 0.0) if axis == "x" else (at - outwards, along, 0.0)

        marks = pyvista.line_segments_from_points([place(t, d) for t in ticks for d in (0.0, length)])
        scene.add_mesh(marks, color=INK, line_width=_pixels(scene, 1.5), lighting=False, name=f"ticks {axis}")
        _write(scene, [place(t, 2.2 * length) for t in ticks], [f"{t:g}" for t in ticks], 17, name=f"{axis} numbers")
        _write(scene, [place((low + high) / 2, 5 * length)], [f"{axis} (mm)"], 17, name=f"{axis} title")


def _write(
    scene: Any,
    points: npt.ArrayLike,
    texts: list[str],
    height: float,
    *,
    name: str,
    bold: bool = False,
) -> None:
    """Write texts centred on points in mm, in letters of `height` pixels in a picture 900 pixels high."""
    scene.add_point_labels(
        np.asarray(points, dtype=np.float64),
        texts,
        font_size=round(_pixels(scene, height)),
        text_color=INK,
        bold=bold,
        shape=None,
        show_points=False,
        always_visible=True,
        justification_horizontal="center",
        justification_vertical="center",
        reset_camera=False,
        name=name,
    )


def _aim(scene: Any, elevation: float = _ELEVATION, azimuth: float = _AZIMUTH) -> None:
    """Look at the whole scene obliquely from the front, without perspective so that lengths compare."""
    sine, cosine = math.sin(elevation), math.cos(elevation)
    towards = np.array([cosine * math.cos(azimuth), cosine * math.sin(azimuth), sine])
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    upwards = np.cross(towards, right)
    corners = np.array(list(itertools.product(*np.reshape(scene.bounds, (3, 2)))))
    seen = corners @ np.column_stack((right, upwards))
    middle, extent = (seen.min(axis=0) + seen.max(axis=0)) / 2, np.ptp(seen, axis=0)
    focus = middle[0] * right + middle[1] * upwards
    distance = 2.0 * float(np.linalg.norm(np.ptp(corners, axis=0)))
    width, height = scene.window_size
    scene.enable_parallel_projection()
    scene.camera_position = [focus + distance * towards, focus, (0.0, 0.0, 1.0)]
    scene.camera.parallel_scale = max(extent[1], extent[0] * height / width) / 2 / _FILLED
    scene.reset_camera_clipping_range()


def _pixels(scene: Any, at_900: float) -> float:
    """Size in pixels of something that measures `at_900` in a picture 900 pixels high."""
    return at_900 * float(scene.window_size[1]) / 900
