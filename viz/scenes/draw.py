"""Put a scene into a PyVista plotter.

This makes the actors, texts, legend, colour bars and the camera. Actors are the same for windows,
pictures and pages, and need no screen.
"""

from __future__ import annotations

import itertools
import textwrap
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from coilarray.compute.display_units import PLAIN, true_minus
from coilarray.viz.datasets.meshes import surface_of
from coilarray.viz.palette import INK
from coilarray.viz.scenes.scene import Camera, Part, Scale, Scene, Side, Text, aim, seen_from

if TYPE_CHECKING:
    import pyvista

BAR_WIDTH = 0.085
"""Width of one colour bar with its numbers, over the width of the picture."""

_HEIGHT, _WIDTH = 900, 1400  # pixels of the reference picture, with letters and lines in their nominal sizes
# The legend in pixels of the reference picture: letters, mean width, line, sign with room, rim.
_LEGEND, _LETTER, _LINE, _SIGN, _RIM = 17, 10.2, 29, 24, 40
_TICKS = 5  # numbers on a colour bar
_TITLE = 13  # letters in a line of its title
_PLAIN = 1e-2  # least unitless value that is shown without a power of ten
_FONT_FILE = 4  # VTK_FONT_FILE of vtkTextProperty
# Notes in pixels of the reference picture: letters, a line, their lower edge with room above them.
_NOTE, _NOTE_LINE, _NOTE_RIM = 15, 17.5, 40
_COLOURS = "colour"  # array of red, green and blue
_SHARP = 30.0  # angle in degrees between triangles above which their edge stays sharp
_BEHIND = 2.0  # units of polygon offset


Panel = tuple[float, float]
"""Width and height of a panel at the top left, over the sides of the picture."""


def draw(scene: Scene, plotter: pyvista.Plotter, *, side: Side = "oblique", panel: Panel | None = None) -> None:
    """Draw a whole scene on white.

    Parameters
    ----------
    scene : Scene
        Scene that is drawn, at the first position of its slider.
    plotter : pyvista.Plotter
        Plotter that gets the actors. Lengths are in mm. A part or text replaces another with the
        same name.
    side : {"oblique", "top", "front", "right"}
        Side from which it is seen.
    panel : tuple of float, optional
        Size of a panel that stands in place of the legend.
    """
    view: Any = plotter  # PyVista's decorators lose the signatures of its methods, differently in each version
    scene = scene.still()
    view.set_background("white")
    pixel = pixel_of(view.window_size)
    shown = replace(scene, texts=tuple(text for text in scene.texts if side not in text.hidden_from))
    draw_parts(shown, plotter, pixel)
    if panel is None and scene.groups:
        _legend(view, scene)
    for place, scale in enumerate(scene.scales):
        _bar(view, scale, place)
    set_camera(plotter, camera_of(scene, (view.window_size[0], view.window_size[1]), side, panel))


def draw_parts(scene: Scene, plotter: pyvista.Plotter, pixel: float | None = None) -> None:
    """Draw only the parts, texts and notes of a scene."""
    view: Any = plotter
    if pixel is None:
        pixel = view.window_size[1] / _HEIGHT
    known = set(view.actors)
    for part in scene.parts:
        if part.name in known:
            view.remove_actor(part.name, reset_camera=False, render=False)
        view.renderer.AddActor(actor_of(part, pixel))  # PyVista's own method searches all others for its name
    alike: dict[str, list[Text]] = defaultdict(list)
    for text in scene.texts:
        alike[text_name(text)].append(text)
    for name, texts in alike.items():
        # In PyVista, texts of one actor give way to each other if they meet, but not to texts of
        # another actor.
        points = np.array([text.position for text in texts], dtype=np.float64)
        view.add_point_labels(
            points, [text.text for text in texts], name=name, font_size=round(texts[0].height * pixel),
            font_file=font_file(texts[0].bold), text_color=INK, shape=None, show_points=False,
            justification_horizontal="center", justification_vertical="center", always_visible=True,
            reset_camera=False, render=False,
        )  # fmt: skip
    if scene.notes:
        look = {"font_size": round(_NOTE * pixel / 2), "font_file": font_file()}  # PyVista's points have two pixels
        view.add_text("\n".join(scene.notes), position=(0.02, 0.025), viewport=True, color=INK, name="notes", **look)


def actor_of(part: Part, pixel: float = 1.0) -> Any:
    """Make the pyvista.Actor of a part, with its colours in the mesh."""
    from vtkmodules.vtkRenderingCore import vtkPolyDataMapper

    from coilarray.viz.extra_3d import pyvista

    mapper = vtkPolyDataMapper()  # PyVista's own makes a slow table of colours each time
    mapper.SetInputDataObject(_surface(part))
    mapper.SetScalarVisibility(part.scale is not None)
    if part.scale is not None:
        on_cells = part.scale.array in part.mesh.cell_data
        mapper.SetScalarModeToUseCellFieldData() if on_cells else mapper.SetScalarModeToUsePointFieldData()
        mapper.SelectColorArray(_COLOURS)
        mapper.SetColorModeToDirectScalars()
    if part.sunk:
        mapper.SetResolveCoincidentTopologyToPolygonOffset()
        mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(_BEHIND, _BEHIND)
    properties = pyvista.Property(
        color=part.colour, opacity=part.opacity, line_width=part.line_width * pixel, lighting=part.lit,
        ambient=part.ambient, diffuse=part.diffuse, interpolation="Phong" if part.smooth else "Flat",
        culling="back" if part.closed else None,
    )  # fmt: skip
    actor = pyvista.Actor(mapper=mapper, prop=properties, name=part.name)
    actor.SetPickable(False)
    return actor


def _surface(part: Part) -> pyvista.PolyData:
    mesh: Any = surface_of(part.mesh)
    surface: pyvista.PolyData = mesh.copy(deep=False)
    surface.clear_data()
    surface.points = np.asarray(mesh.points, dtype=np.float32)  # as graphics cards take them
    if part.scale is not None:
        on_cells = part.scale.array in mesh.cell_data
        values = (mesh.cell_data if on_cells else mesh.point_data)[part.scale.array]
        target = surface.cell_data if on_cells else surface.point_data
        target[_COLOURS] = np.ascontiguousarray(part.scale.colours_of(values))
    if part.smooth:
        surface = surface.compute_normals(
            cell_normals=False, split_vertices=True, feature_angle=_SHARP, auto_orient_normals=False
        )
    return surface


def text_name(text: Text) -> str:
    """Name of the actor of texts that look alike."""
    return f"texts {text.group} {text.height:g}{' bold' if text.bold else ''}{' always' if text.always else ''}"


def camera_of(scene: Scene, size: tuple[int, int], side: Side = "oblique", panel: Panel | None = None) -> Camera:
    """Camera that shows all of a scene."""
    free = {
        "right": BAR_WIDTH * len(scene.scales),
        "bottom": (_NOTE_RIM + _NOTE_LINE * len(scene.notes)) * pixel_of(size) / size[1] if scene.notes else 0.0,
    }
    camera = aim(scene.bounds, size, side, **free)
    if not scene.groups:
        return camera
    width, height = legend_size(scene, size) if panel is None else panel
    corners = np.array(list(itertools.product(*np.reshape(scene.bounds, (3, 2)))))
    hull = shapely.MultiPoint(seen_from(camera, corners, size)).convex_hull
    covered = hull.intersects(shapely.box(0.0, 1.0 - height, width, 1.0))
    return aim(scene.bounds, size, side, left=width, **free) if covered else camera


def legend_size(scene: Scene, size: tuple[int, int]) -> Panel:
    """Size of a scene's legend over the picture."""
    pixel = pixel_of(size)
    longest = max((len(group) for group in scene.groups), default=0)
    width, height = _RIM + _SIGN + _LETTER * longest, _RIM + _LINE * len(scene.groups)
    return width * pixel / size[0], height * pixel / size[1]


def set_camera(plotter: pyvista.Plotter, camera: Camera) -> None:
    """Let a plotter look through a camera."""
    view: Any = plotter
    view.enable_parallel_projection()
    view.camera_position = [camera.position, camera.focus, camera.up]
    view.camera.parallel_scale = camera.scale
    view.reset_camera_clipping_range()


def pixel_of(size: Sequence[int]) -> float:
    """Pixels per pixel of the reference picture.

    In a narrow picture they are fewer, so that legend and bars have room.

    >>> pixel_of((1600, 900)), pixel_of((960, 540)), pixel_of((700, 900))
    (1.0, 0.6, 0.5)
    """
    width, height = size
    return min(height / _HEIGHT, width / _WIDTH)


def _legend(view: Any, scene: Scene) -> None:
    """Write every group in ink, beside a square of its colour."""
    pixel, height = pixel_of(view.window_size), view.window_size[1]
    look = {"font_size": round(_LEGEND * pixel / 2), "font_file": font_file()}  # PyVista's points have two pixels
    for row, (group, colours) in enumerate(scene.groups.items()):
        y = height - (_RIM + (row + 1) * _LINE) * pixel
        # A scale of colours shows its ends, each in one half of the sign.
        halves = {"■": colours[0]} if len(colours) == 1 else {"◧": colours[0], "◨": colours[-1]}
        for half, colour in halves.items():
            view.add_text(half, position=(_RIM * pixel, y), color=colour, name=f"legend sign {group} {half}", **look)
        view.add_text(group, position=((_RIM + _SIGN) * pixel, y), color=INK, name=f"legend {group}", **look)


def _bar(view: Any, scale: Scale, place: int) -> None:
    from coilarray.viz.extra_3d import pyvista

    factor, title = shown_units(scale)
    mapper: Any = pyvista.DataSetMapper(dataset=pyvista.PolyData())
    ends = (scale.low * factor, scale.high * factor)
    mapper.lookup_table = pyvista.LookupTable(
        cmap=scale.colours, scalar_range=ends, log_scale=scale.logarithmic, n_values=256
    )
    pixel = pixel_of(view.window_size)
    bar = view.add_scalar_bar(
        title=textwrap.fill(title, _TITLE),  # keeps it clear of the title of the next bar
        mapper=mapper, vertical=True, n_labels=_TICKS, fmt="%.3g", width=0.35 * BAR_WIDTH, height=0.55,
        position_x=1.0 - BAR_WIDTH * (place + 1), position_y=0.2, title_font_size=round(17 * pixel),
        label_font_size=round(16 * pixel), color=INK, unconstrained_font_size=True, render=False,
    )  # fmt: skip
    bar.SetVerticalTitleSeparation(round(12 * pixel))
    for text in (bar.GetTitleTextProperty(), bar.GetLabelTextProperty()):
        text.SetFontFamily(_FONT_FILE)
        text.SetFontFile(font_file())


def shown_units(scale: Scale) -> tuple[float, str]:
    """Factor to the numbers on a colour bar, and title.

    >>> shown_units(Scale("B", "B", "T", 1e-8, 2e-6))
    (1000000.0, 'B (µT)')
    >>> shown_units(Scale("k", "k", "", -0.05, 0.05))
    (1.0, 'k')
    """
    from coilarray.viz.plots.style import axis_unit  # loads Matplotlib

    plain = not scale.unit and scale.high >= _PLAIN
    unit = PLAIN if plain else axis_unit([scale.low, scale.high], scale.unit)
    return unit.factor, unit.label(scale.title)


def bar_of(scale: Scale, stops: int) -> tuple[str, tuple[str, ...], list[str]]:
    """Title, colours ``#rrggbb`` at equal steps, and numbers of a colour bar."""
    factor, title = shown_units(scale)
    ticks = [true_minus(f"{value * factor:.3g}") for value in scale.values(_TICKS).tolist()]
    return title, scale.steps(stops), ticks


def gradient(colours: Sequence[str], towards: str = "right") -> str:
    """CSS background that shows colours along a direction."""
    return colours[0] if len(colours) == 1 else f"linear-gradient(to {towards}, {', '.join(colours)})"


def font_file(bold: bool = False) -> str:
    """Font file of all texts."""
    import matplotlib

    return f"{matplotlib.get_data_path()}/fonts/ttf/DejaVuSans{'-Bold' if bold else ''}.ttf"
