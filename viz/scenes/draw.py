"""Put a scene into a PyVista plotter.

This makes the actors, texts, legend, colour bars and the camera. Actors are the same for windows,
pictures and pages, and need no screen.
"""

from __future__ import annotations

import math
import textwrap
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.compute.display_units import PLAIN, true_minus
from coilarray.viz.datasets.meshes import surface_of
from coilarray.viz.palette import FAINT, INK
from coilarray.viz.scenes.scene import Camera, Part, Scale, Scene, Side, Text, aim, seen_from

if TYPE_CHECKING:
    import pyvista

_HEIGHT, _WIDTH = 900, 1400  # pixels of the reference picture, with letters and lines in their nominal sizes
# The legend in pixels of the reference picture: letters, mean width, line, sign with room, rim.
_LEGEND, _LETTER, _LINE, _SIGN, _RIM = 17, 10.2, 29, 24, 40
_BAR, _BAR_HEIGHT = 250, 100  # width of a colour bar, and height with its texts, in pixels of the reference picture
_SHADES = 96  # colours of a bar
_PLAIN = 1e-2  # least unitless value that is shown without a power of ten
# Notes in pixels of the reference picture: letters, a line, their lower edge with room above them.
_NOTE, _NOTE_LINE, _NOTE_RIM = 15, 17.5, 40
_WIDE = 0.3  # half the mean width of a letter over its height
_COLOURS = "colour"  # array of red, green and blue
_SHARP = 30.0  # angle in degrees between triangles above which their edge stays sharp
_BEHIND = 2.0  # units of polygon offset
_ANGLE = 22.0  # degrees from the lower to the upper edge of an oblique picture
_POLISH = 18.0  # exponent of the reflected light of a metal
_PEELS = 6  # surfaces behind each other that are seen through in order
_BLUR, _SHADE = 0.06, 0.32  # width of a shadow over the boards' diagonal, and its opacity
_FAINTEST = 0.2  # opacity of a fading part at the lower end of its scale, over the opacity at the upper end
_DARK = 1.5  # sum of red, green and blue of a background below which letters are light
NIGHT = "#14181d"
"""Background of pictures for dark pages."""


def draw(scene: Scene, plotter: pyvista.Plotter, *, side: Side = "oblique", dark: bool = False) -> None:
    """Draw a whole scene on white, or on `dark` paper with light letters.

    The `scene` is drawn at the first position of its slider. The `plotter` gets the actors, with
    lengths in mm. A part or text replaces another with the same name. The `side` "cut" is into the
    open quarter of a dent, and oblique views are in perspective.
    """
    view: Any = plotter  # PyVista's decorators lose the signatures of its methods, differently in each version
    scene = scene.still()
    view.set_background(NIGHT if dark else "white")
    size = (view.window_size[0], view.window_size[1])
    pixel = pixel_of(size)
    free = size[0] / pixel - _NOTE_RIM - (_BAR + _RIM) * len(scene.scales)  # the notes end before the bars
    wrapped = (textwrap.wrap(note, max(round(free / (_NOTE * 0.55)), 30)) for note in scene.notes)
    scene = replace(scene, notes=tuple(chain(*wrapped)))
    camera = camera_of(scene, size, side)
    texts = [text for text in scene.texts if side not in text.hidden_from]
    draw_parts(replace(scene, texts=legible(texts, camera, size)), plotter, pixel)
    if scene.groups:
        _legend(view, scene)
    for place, scale in enumerate(scene.scales):
        _bar(view, scale, place)
    if camera.angle:
        _shadow(view, scene)
        view.enable_depth_peeling(_PEELS)
        _lights(view, camera)
    set_camera(plotter, camera)


def legible(texts: Sequence[Text], camera: Camera, size: tuple[int, int]) -> tuple[Text, ...]:
    """Texts that stand on no other in a picture: names before numbers."""
    pixel, kept, boxes = pixel_of(size), set[int](), list[shapely.Polygon]()
    order = sorted(range(len(texts)), key=lambda k: (not texts[k].always, not texts[k].bold))
    places = seen_from(camera, [text.position for text in texts], size) * size if texts else np.empty((0, 2))
    for k in order:
        (x, y), height = places[k].tolist(), texts[k].height * pixel
        half = _WIDE * len(texts[k].text) * height
        box = shapely.box(x - half, y - height / 2, x + half, y + height / 2)
        if not any(box.intersects(other) for other in boxes):
            kept.add(k)
            boxes.append(box)
    return tuple(text for k, text in enumerate(texts) if k in kept)


def _lights(view: Any, camera: Camera) -> None:
    """Light from the upper left, near enough for a sheen on copper, and weaker light from the camera."""
    from coilarray.viz.extra_3d import pyvista

    view.remove_all_lights()
    focus, length = np.array(camera.focus), camera.scale
    along = np.cross(camera.up, np.subtract(camera.position, focus))
    along /= np.linalg.norm(along)
    key = focus + length * (np.array(camera.up) * 0.9 - 0.8 * along + [0.0, 0.0, 1.7])
    for light, place, near in ((0.75, key, True), (0.45, np.array(camera.position), False)):
        lamp = pyvista.Light(position=place, focal_point=focus, intensity=light, light_type="scene light")
        lamp.positional, lamp.cone_angle = near, 90.0
        view.add_light(lamp)


def _shadow(view: Any, scene: Scene) -> None:
    """Soft shadow of the boards on the paper below them."""
    from coilarray.viz.extra_3d import pyvista

    boards = [part.mesh.bounds for part in scene.parts if part.shadow]
    if not boards:
        return
    (x_min, x_max), (y_min, y_max), (low, _) = (
        (min(b[2 * k] for b in boards), max(b[2 * k + 1] for b in boards)) for k in range(3)
    )
    blur = _BLUR * math.hypot(x_max - x_min, y_max - y_min)
    x, y = (np.linspace(a - 2 * blur, b + 2 * blur, 90) for a, b in ((x_min, x_max), (y_min, y_max)))
    sheet = pyvista.RectilinearGrid(x + blur / 2, y - blur / 2, [low - blur / 3])
    across, along = (
        (np.tanh(2 * (at - a) / blur) - np.tanh(2 * (at - b) / blur)) / 2
        for at, a, b in ((x, x_min, x_max), (y, y_min, y_max))
    )
    dark = np.zeros((x.size * y.size, 4), dtype=np.uint8)
    dark[:, 3] = np.rint(255 * _SHADE * np.outer(along, across)).ravel()
    sheet.point_data["shade"] = dark
    quiet = {"lighting": False, "render": False, "reset_camera": False}
    view.add_mesh(surface_of(sheet), scalars="shade", rgba=True, name="shadow", **quiet)


def draw_parts(scene: Scene, plotter: pyvista.Plotter, pixel: float | None = None) -> None:
    """Draw only the parts, texts and notes of a scene."""
    view: Any = plotter
    if pixel is None:
        pixel = view.window_size[1] / _HEIGHT
    known, ink = set(view.actors), _ink(view)
    for part in scene.parts:
        if part.name in known:
            view.remove_actor(part.name, reset_camera=False, render=False)
        inked = replace(part, colour=ink) if part.colour == INK else part
        view.renderer.AddActor(actor_of(inked, pixel))  # PyVista's own method searches all others for its name
    alike: dict[str, list[Text]] = defaultdict(list)
    for text in scene.texts:
        alike[text_name(text)].append(text)
    for name, texts in alike.items():
        # In PyVista, texts of one actor give way to each other if they meet, but not to texts of
        # another actor.
        points = np.array([text.position for text in texts], dtype=np.float64)
        view.add_point_labels(
            points, [text.text for text in texts], name=name, font_size=round(texts[0].height * pixel),
            font_file=font_file(texts[0].bold), text_color=ink, shape=None, show_points=False,
            justification_horizontal="center", justification_vertical="center", always_visible=True, shadow=True,
            reset_camera=False, render=False,
        )  # fmt: skip
    if scene.notes:
        look = {"font_size": round(_NOTE * pixel / 2), "font_file": font_file()}  # PyVista's points have two pixels
        view.add_text("\n".join(scene.notes), position=(0.02, 0.025), viewport=True, color=ink, name="notes", **look)


def actor_of(part: Part, pixel: float = 1.0) -> Any:
    """Make the pyvista.Actor of a part, with its colours in the mesh."""
    from vtkmodules.vtkRenderingCore import vtkPolyDataMapper

    from coilarray.viz.extra_3d import pyvista

    mapper = vtkPolyDataMapper()  # PyVista's own makes a slow table of colours each time
    surface, colours, on_cells = coloured_surface(part)
    mapper.SetInputDataObject(surface)
    mapper.SetScalarVisibility(colours is not None)
    if colours is not None:
        (surface.cell_data if on_cells else surface.point_data)[_COLOURS] = colours
        mapper.SetScalarModeToUseCellFieldData() if on_cells else mapper.SetScalarModeToUsePointFieldData()
        mapper.SelectColorArray(_COLOURS)
        mapper.SetColorModeToDirectScalars()
    if part.sunk:
        mapper.SetResolveCoincidentTopologyToPolygonOffset()
        mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(_BEHIND, _BEHIND)
    properties = pyvista.Property(
        color=part.colour, opacity=part.opacity, line_width=part.line_width * pixel, lighting=part.lit,
        ambient=part.ambient, diffuse=part.diffuse, specular=part.shine, specular_power=_POLISH,
        interpolation="Phong" if part.smooth else "Flat", culling="back" if part.closed else None,
    )  # fmt: skip
    actor = pyvista.Actor(mapper=mapper, prop=properties, name=part.name)
    actor.SetPickable(False)
    return actor


def coloured_surface(part: Part) -> tuple[pyvista.PolyData, npt.NDArray[np.uint8] | None, bool]:
    """Bare surface of a part, its colours if any, and whether they are of cells."""
    # The colours (n, 3) are red, green and blue, (n, 4) with the opacity. Points of a smooth part have normals.
    mesh: Any = surface_of(part.mesh)
    surface: pyvista.PolyData = mesh.copy(deep=False)
    surface.clear_data()
    surface.points = np.asarray(mesh.points, dtype=np.float32)  # as graphics cards take them
    colours, on_cells = None, part.scale is not None and part.scale.array in mesh.cell_data
    if part.scale is not None:
        values = (mesh.cell_data if on_cells else mesh.point_data)[part.scale.array]
        colours = part.scale.colours_of(values)
        if part.fade:
            strength = np.searchsorted(part.scale.values(256), np.asarray(values)) / 256
            colours = np.column_stack((colours, np.rint(255 * (_FAINTEST + (1 - _FAINTEST) * strength))))
        colours = np.ascontiguousarray(colours, dtype=np.uint8)
    if part.smooth:
        target = surface.cell_data if on_cells else surface.point_data
        if colours is not None:
            target[_COLOURS] = colours
        surface = surface.compute_normals(
            cell_normals=False, split_vertices=True, feature_angle=_SHARP, auto_orient_normals=False
        )
        if colours is not None:
            colours = np.asarray((surface.cell_data if on_cells else surface.point_data)[_COLOURS])
    return surface, colours, on_cells


def text_name(text: Text) -> str:
    """Name of the actor of texts that look alike."""
    return f"texts {text.group} {text.height:g}{' bold' if text.bold else ''}{' always' if text.always else ''}"


def camera_of(scene: Scene, size: tuple[int, int], side: Side = "oblique") -> Camera:
    """Camera that shows all of a scene, in perspective if oblique."""
    angle = 0.0 if side in ("top", "front", "right") else _ANGLE
    meshes = [part.mesh for part in scene.parts if part.mesh.n_points]
    points = np.concatenate([np.asarray(mesh.points, dtype=np.float64) for mesh in meshes])
    if scene.texts:
        points = np.vstack((points, [text.position for text in scene.texts]))
    notes = _NOTE_RIM + _NOTE_LINE * len(scene.notes) if scene.notes else 0.0
    bottom = max(notes, _BAR_HEIGHT if scene.scales else 0.0) * pixel_of(size) / size[1]
    if side == "oblique" and any(part.upright for part in scene.parts):
        side = "low"
    camera = aim(points, size, side, bottom=bottom, angle=angle)
    if not scene.groups:
        return camera
    width, height = legend_size(scene, size)
    seen = np.unique(np.round(seen_from(camera, points, size), 2), axis=0)
    covered = shapely.MultiPoint(seen).convex_hull.intersects(shapely.box(0.0, 1.0 - height, width, 1.0))
    return aim(points, size, side, left=width, bottom=bottom, angle=angle) if covered else camera


def legend_size(scene: Scene, size: tuple[int, int]) -> tuple[float, float]:
    """Size of a scene's legend over the picture."""
    pixel = pixel_of(size)
    longest = max((len(group) for group in scene.groups), default=0)
    width, height = _RIM + _SIGN + _LETTER * longest, _RIM + _LINE * len(scene.groups)
    return width * pixel / size[0], height * pixel / size[1]


def set_camera(plotter: pyvista.Plotter, camera: Camera) -> None:
    """Let a plotter look through a camera."""
    view: Any = plotter
    view.camera_position = [camera.position, camera.focus, camera.up]
    view.camera.parallel_scale, view.camera.parallel_projection = camera.scale, not camera.angle
    if camera.angle:
        view.camera.view_angle = camera.angle
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
    pixel, height = pixel_of(view.window_size), view.window_size[1]
    look = {"font_size": round(_LEGEND * pixel / 2), "font_file": font_file()}  # PyVista's points have two pixels
    for row, (group, colours) in enumerate(scene.groups.items()):
        y = height - (_RIM + (row + 1) * _LINE) * pixel
        # A scale of colours shows its ends, each in one half of the sign.
        halves = {"■": colours[0]} if len(colours) == 1 else {"◧": colours[0], "◨": colours[-1]}
        for half, colour in halves.items():
            shown = _ink(view) if colour == INK else colour
            view.add_text(half, position=(_RIM * pixel, y), color=shown, name=f"legend sign {group} {half}", **look)
        view.add_text(group, position=((_RIM + _SIGN) * pixel, y), color=_ink(view), name=f"legend {group}", **look)


def _bar(view: Any, scale: Scale, place: int) -> None:
    """Put a colour bar with its title and numbers at the lower right."""
    from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D

    from coilarray.viz.extra_3d import pyvista

    title, colours, ticks = bar_of(scale, _SHADES)
    pixel = pixel_of(view.window_size)
    width, left = _BAR * pixel, view.window_size[0] - (_BAR + _RIM) * (place + 1) * pixel
    steps = (width / _SHADES, 14 * pixel, 1.0)
    bar = pyvista.ImageData(dimensions=(_SHADES + 1, 2, 1), spacing=steps, origin=(left, 44 * pixel, 0.0))
    mapper, actor = vtkPolyDataMapper2D(), vtkActor2D()
    surface = surface_of(bar)
    surface.cell_data[_COLOURS] = np.array([pyvista.Color(colour).int_rgb for colour in colours], dtype=np.uint8)
    surface.cell_data.active_scalars_name = _COLOURS
    mapper.SetInputData(surface)
    actor.SetMapper(mapper)
    view.renderer.AddViewProp(actor)
    places = np.linspace(left, left + width, len(ticks)).tolist()
    words = [(title, left + width / 2, 64.0), *((tick, at, 22.0) for tick, at in zip(ticks, places, strict=True))]
    for text, at, height in words:
        look = {"font_size": round(_NOTE * pixel / 2), "font_file": font_file(), "color": _ink(view)}
        name = f"bar {title}" if text == title else f"tick {place} {at:.0f}"
        word = view.add_text(text, position=(at, height * pixel), name=name, **look)
        word.prop.justification_horizontal = "center"


def _ink(view: Any) -> str:
    return INK if sum(view.background_color.float_rgb) > _DARK else FAINT


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
    return unit.factor, unit.label(scale.title) + (", log" if scale.logarithmic else "")


def bar_of(scale: Scale, stops: int) -> tuple[str, tuple[str, ...], list[str]]:
    """Title, colours ``#rrggbb`` at equal steps, and numbers of a colour bar."""
    factor, title = shown_units(scale)
    ticks = [true_minus(f"{value * factor + 0.0:.3g}") for value in scale.ticks.tolist()]
    return title, scale.steps(stops), ticks


def gradient(colours: Sequence[str], towards: str = "right") -> str:
    """CSS background that shows colours along a direction."""
    return colours[0] if len(colours) == 1 else f"linear-gradient(to {towards}, {', '.join(colours)})"


def font_file(bold: bool = False) -> str:
    """Font file of all texts."""
    import matplotlib

    return f"{matplotlib.get_data_path()}/fonts/ttf/DejaVuSans{'-Bold' if bold else ''}.ttf"
