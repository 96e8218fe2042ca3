"""Scenes of a board and of the sheets on it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.compute.display_units import true_minus
from coilarray.design.model import Board
from coilarray.errors import GeometryError
from coilarray.geometry.array import Array
from coilarray.geometry.copper import board_solids, sheet_prisms, sheet_solids
from coilarray.geometry.elastomer import Indenter, Sheet
from coilarray.geometry.pose import Pose
from coilarray.viz.datasets import meshes
from coilarray.viz.datasets.results import arrows_at, at_depth
from coilarray.viz.palette import BARREL, BOARDS, COPPER, INK, LAMINATE, METAL, ON_DARK, ON_MAP, SHEETS, cycled
from coilarray.viz.scenes.scene import ANGLES, Part, Scale, Scene, Side, Slider, Text, about_zero

if TYPE_CHECKING:
    import pyvista
    import xarray as xr


Box = tuple[float, float, float, float]

_HIGH = 0.15  # height of boards over their length from which z has a ruler
_LIFT = 0.5  # of the lowest sheet, over the lift that clears the board in an oblique view
_GLASS = 0.12  # opacity of a sheet
_SMOOTH = 97  # points of a bent edge of a board
_COPPER, _LAMINATE = "copper ", "laminate"
_ARROWS, _ARROW = 8, 0.8  # current arrows of a coil, and length of the longest over their distance
_WEAK = 0.01  # least current with arrows, over the largest
_OVER = 0.15  # height of an arrow above the copper over its length


@dataclass(frozen=True, eq=False)
class CoilColours:
    """Values of the coils as colours of their copper."""

    values: npt.NDArray[np.float64]  # shape (coils,), NaN for a coil without a value
    scale: Scale  # its `array` is the name of the values in the meshes


def board_scene(array: Array, sheets: Sequence[Sheet] = ()) -> Scene:
    """Scene of a board, with sheets lifted off it.

    It has laminate, copper, barrels, coil names, a legend and a scale in mm. Copper of the `array`
    is coloured by layer. The laminate is translucent, so that the lower layers show through it. The
    `sheets`, the lowest first, are lifted off the board and off each other and drawn as thin glass
    with clear edges. The scene, in mm, is to `draw`, to `show` or to save.
    """
    lift = _LIFT * (array.bounds[3] - array.bounds[1]) * math.tan(math.radians(ANGLES["oblique"][0]))
    above = scene_of_sheets(array, sheets, lift, lift / 3)
    return above + scene_of_board(array)


def scene_of_board(
    array: Array, *, layers: Sequence[str] | None = None, box: Box | None = None, name_heights: npt.ArrayLike = 0.0
) -> Scene:
    """Scene of a board: laminate, copper, barrels, names, rulers."""
    # A `box` x_min, y_min, x_max, y_max in m shows this part, without rulers, barrels and names. `name_heights` in m
    # lift the names, and leave out those of covered coils, NaN.
    _require_layers(layers, array.stackup.names)
    bare = _bare_board(array, layers, box, name_heights)
    if box is not None:
        return bare
    x_min, y_min, x_max, y_max = (meshes.MM_PER_M * edge for edge in array.bounds)
    extent = (x_min, x_max, y_min, y_max, 0.0, 0.0) if array.form is None else Scene(bare.parts).bounds
    return bare + _rulers(*extent)


def scene_of_boards(
    boards: Sequence[Board], *, layers: Sequence[str] | None = None, name_heights: npt.ArrayLike = 0.0
) -> Scene:
    """Scene of boards in space, as `scene_of_board` of each."""
    # Parts of a named board begin with its name. Several without a name are loops of a surface: their copper is
    # drawn together, without a laminate. The heights of names are of the first board.
    own, *others = boards
    if not others and own.pose == Pose():
        return scene_of_board(own.array, layers=layers, name_heights=name_heights)
    _require_layers(layers, dict.fromkeys(layer for board in boards for layer in board.array.stackup.names))
    bare, first = list[Scene](), 0
    for board in boards:
        bare.append(_bare_board(board.array, layers, None, name_heights if board is own else 0.0))
        for part in bare[-1].parts:
            if "coil" in part.mesh.cell_data:
                part.mesh.cell_data["coil"] += first
        first += len(board.array.names)
    drawn = _placed(boards, bare)
    return drawn + _rulers(*Scene(drawn.parts).bounds)


def _placed(boards: Sequence[Board], bare: Sequence[Scene]) -> Scene:
    """Scene of boards in space from those of each by itself, with parts of one name together."""
    loops = sum(not board.name for board in boards) > 1
    alike: dict[str, list[Part]] = {}
    colours = cycled(BOARDS, [board.name for board in boards if board.name])
    pairs = zip(bare, boards, strict=True)
    scenes = [in_space(scene, board, colours.get(board.name or "", "")) for scene, board in pairs]
    for board, scene in zip(boards, scenes, strict=True):
        for part in scene.parts:
            if board.name or not loops or not part.name.endswith("board"):
                alike.setdefault(part.name, []).append(part)
    parts = [
        replace(same[0], mesh=same[0].mesh.append_polydata(*(part.mesh for part in same[1:]))) if same[1:] else same[0]
        for same in alike.values()
    ]
    return Scene(tuple(parts), tuple(text for scene in scenes for text in scene.texts))


def moving_scenes(moved: Sequence[Sequence[Board]], notes: Sequence[Sequence[str]]) -> Iterator[Scene]:
    """Scenes of the same boards at one place after another, with notes, without names and rulers."""
    bare = [_bare_board(board.array, None, None, 0.0) for board in moved[0]]
    for boards, lines in zip(moved, notes, strict=True):
        yield Scene(_placed(boards, bare).parts, notes=tuple(lines))


def room(corners: npt.ArrayLike) -> Scene:
    """Invisible box about points (n, 3) in m, for a camera to have in view."""
    from coilarray.viz.extra_3d import pyvista

    ends = meshes.MM_PER_M * np.asarray(corners, dtype=np.float64)
    box = np.column_stack((ends.min(axis=0), ends.max(axis=0))).ravel()
    return Scene((Part("room", pyvista.Box(box), opacity=0.0),))


def scene_of_motion(still: Sequence[Board], moved: Sequence[Sequence[Board]], slider: Slider) -> Scene:
    """Scene of boards that stay, and of others at every position of a slider."""
    parts = [
        replace(part, name=f"{part.name}, {step + 1}", step=step)
        for step, scene in enumerate(moving_scenes(moved, slider.notes))
        for part in scene.parts
    ]
    return scene_of_boards(still) + Scene(tuple(parts), slider=slider)


def in_space(scene: Scene, board: Board, colour: str = "") -> Scene:
    """Move a scene of a board by itself to its place, its name as its group, its copper in a `colour`."""
    start = f"{board.name}: " if board.name else ""

    def moved(points: npt.ArrayLike) -> npt.NDArray[np.float64]:
        return meshes.MM_PER_M * board.pose.apply(np.asarray(points, dtype=np.float64) / meshes.MM_PER_M)

    parts = []
    for part in scene.parts:
        mesh = part.mesh.copy()
        mesh.points = moved(mesh.points)
        tone = colour if colour and _COPPER in part.name else part.colour
        group = part.group and (board.name or part.group)
        parts.append(replace(part, mesh=mesh, name=start + part.name, group=group, colour=tone))
    texts = []
    for text in scene.texts:
        x, y, z = moved(text.position).tolist()
        texts.append(replace(text, text=f"{board.prefix}{text.text}", position=(x, y, z)))
    return replace(scene, parts=tuple(parts), texts=tuple(texts))


def _require_layers(layers: Sequence[str] | None, known: Iterable[str]) -> None:
    for layer in layers or ():
        if layer not in known:
            raise GeometryError(f"the board has no copper layer {layer!r}; there are {', '.join(known)}.")


def _bare_board(array: Array, layers: Sequence[str] | None, box: Box | None, name_heights: npt.ArrayLike) -> Scene:
    solids = board_solids(array)
    parts = []
    for layer, colour in _tones(array.stackup.names).items():
        mesh = cut_upright(meshes.copper_mesh(solids, array.names, layer), box)
        if mesh.n_cells and (layers is None or layer in layers):
            name = f"{_COPPER}{layer}"
            parts.append(Part(name, mesh, name, colour, ambient=0.3, diffuse=0.65, shine=0.5, closed=box is None))
    barrels = meshes.barrel_mesh(solids, array.names)
    if barrels.n_cells and box is None:
        parts.append(Part("barrels", barrels, "barrels", BARREL, closed=True))
    board = cut_upright(meshes.board_mesh(solids), box)
    if board.n_cells:
        # Copper may share a face with the board, so the board is drawn just behind it.
        look: dict[str, Any] = {"opacity": 0.35, "ambient": 0.35, "diffuse": 0.75, "sunk": True, "shadow": True}
        parts.append(Part("board", board, _LAMINATE, LAMINATE, upright=array.form is not None, **look))
    if box is not None:
        return Scene(tuple(parts))
    if board.n_cells:
        ends = array.stackup.names[-1], array.stackup.names[0]
        span = array.stackup.span(ends[0])[1], array.stackup.span(ends[1])[0]
        parts.append(_edges("edges of board", board, _LAMINATE, LAMINATE, array, span))
    heights = np.broadcast_to(np.asarray(name_heights, dtype=np.float64), len(array.names))
    places = _as_bent(array, np.column_stack((array.centres, heights))).tolist()
    names = (Text(name, (x, y, z), 24.0, bold=True) for name, (x, y, z) in zip(array.names, places, strict=True))
    return Scene(tuple(parts), tuple(text for text in names if math.isfinite(text.position[2])))


def _tones(layers: Sequence[str]) -> dict[str, str]:
    """Tone of copper of each layer, the deeper the darker."""
    from matplotlib.colors import to_hex, to_rgb

    top, bottom = (np.array(to_rgb(tone)) for tone in COPPER)
    depth = np.linspace(0.0, 1.0, len(layers)) if len(layers) > 1 else [0.0]
    return {layer: to_hex((1 - share) * top + share * bottom) for layer, share in zip(layers, depth, strict=True)}


def _rulers(x_min: float, x_max: float, y_min: float, y_max: float, low: float, high: float) -> Scene:
    """Ticks along two edges of the lower face of a box in mm, and along an upright one of a high box."""
    length = 0.012 * (x_max - x_min + y_max - y_min)
    made = [_ruler("x", (x_min, x_max), y_min, length, low), _ruler("y", (y_min, y_max), x_min, length, low)]
    if high - low > _HIGH * max(x_max - x_min, y_max - y_min):
        made.append(_ruler("z", (low, high), x_min, length, y_max))
    return Scene(tuple(ticks for ticks, _ in made), tuple(text for _, texts in made for text in texts))


def board_in_pieces(
    boards: Sequence[Board], layers: Sequence[str] | None = None, name_heights: npt.ArrayLike = 0.0
) -> tuple[tuple[Part, ...], Scene]:
    """Copper of boards in space for `recoloured`, and the scene of the rest."""
    scene = scene_of_boards(boards, layers=layers, name_heights=name_heights)
    copper = tuple(part for part in scene.parts if _COPPER in part.name)
    return copper, replace(scene, parts=tuple(part for part in scene.parts if part not in copper))


def recoloured(copper: Sequence[Part], colours: CoilColours) -> tuple[Part, ...]:
    """Colour the copper of a board by coils' values."""
    parts = []
    for part in copper:
        mesh = part.mesh.copy()
        mesh.cell_data[colours.scale.array] = colours.values[mesh.cell_data["coil"]]
        parts.append(replace(part, mesh=mesh, colour=BARREL, scale=colours.scale, ambient=0.7, diffuse=0.35))
    return tuple(parts)


def scene_of_currents(boards: Sequence[Board], currents: npt.ArrayLike, active: int) -> Scene:
    """Scene of arrows along currents (coils,) in the copper, real."""
    # Lengths are as the roots of the currents. Arrows of the `active` coil, whose copper is dark, are light.
    strength, scenes, first = np.asarray(currents, dtype=np.float64), list[Scene](), 0
    largest = float(np.abs(strength).max(initial=0.0))
    for board in boards:
        array, parts = board.array, list[Part]()
        own = strength[first : first + len(array.names)]
        strong = set(np.flatnonzero(np.abs(own) > _WEAK * largest).tolist())
        for name, colour, chosen in (
            ("others", ON_MAP, strong - {active - first}), ("measured", ON_DARK, strong & {active - first})
        ):  # fmt: skip
            if not chosen:
                continue
            turns = (meshes.along_turn(array.placements[k], _ARROWS) for k in sorted(chosen))
            behind, ahead, distances = zip(*turns, strict=True)
            length = _ARROW * min(distances)
            height = np.full((len(chosen) * _ARROWS, 1), _OVER * length)
            start, end = (_as_bent(array, np.hstack((np.vstack(ends), height))) for ends in (behind, ahead))
            along = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
            vectors = np.repeat(own[sorted(chosen)], _ARROWS)[:, None] * along
            arrows = arrows_at((start + end) / 2, vectors, length, ("I (A)", "|I| (A)"), largest)
            parts.append(Part(f"arrows of currents, {name}", arrows, "current as arrows", colour, ambient=0.5))
        scenes.append(Scene(tuple(parts)))
        first += len(array.names)
    return _placed(boards, scenes)


def scene_of_sheets(array: Array, sheets: Sequence[Sheet], lift: float = 0.0, spread: float = 0.0) -> Scene:
    """Scene of flat sheets as glass, lifted as in `sheet_meshes`."""
    labels = _sheet_labels(sheets)
    colours = cycled(SHEETS, list(labels))
    parts: list[Part] = []
    prisms = sheet_prisms(array, sheets)
    lifts = {sheet.name: lift + place * spread for place, sheet in enumerate(sheets)}
    for name, mesh in reversed(meshes.sheet_meshes(sheet_solids(array, sheets), lift, spread).items()):
        span = prisms[f"sheet/{name}"].bottom, prisms[f"sheet/{name}"].top
        parts.append(Part(f"sheet {name}", mesh, labels[name], colours[name], opacity=_GLASS, lit=False))
        parts.append(_edges(f"edges of sheet {name}", mesh, labels[name], colours[name], array, span, lifts[name]))
    return Scene(tuple(parts))


def sheets_in_space(boards: Sequence[Board]) -> Scene:
    """Scene of the sheets of boards in space, where they lie."""
    scene = Scene()
    for board in boards:
        if board.name or board is boards[0]:  # loops of a surface have none
            scene += in_space(scene_of_sheets(board.array, board.design.sheets), board)
    return scene


def _sheet_labels(sheets: Sequence[Sheet]) -> dict[str, str]:
    return {sheet.name: f"{sheet.name} {sheet.thickness * meshes.MM_PER_M:g} mm" for sheet in sheets}


def cut_upright(mesh: pyvista.PolyData, box: Box | None) -> Any:
    """Cut a mesh upright to a rectangle in m, left open."""
    if box is None or not mesh.n_cells:
        return mesh
    x_min, y_min, x_max, y_max = (meshes.MM_PER_M * edge for edge in box)
    low, high = mesh.bounds[4:]
    cut = mesh.clip_box([x_min, x_max, y_min, y_max, low - 1.0, high + 1.0], invert=False)
    return meshes.surface_of(cut).remove_unused_points()  # which count for the bounds in VTK 9.6


def _as_bent(array: Array, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Points (n, 3) in mm of points of a flat board in m, bent as the board."""
    return meshes.MM_PER_M * (points if array.form is None else array.form.surface(points))


def _edges(
    name: str,
    mesh: pyvista.PolyData,
    group: str,
    colour: str,
    array: Array,
    span: tuple[float, float],
    lift: float = 0.0,
) -> Part:
    """Edges of a mesh's bounding box, bent as the board, with a span of heights and a lift in m."""
    lines = mesh.outline()
    if array.form is not None:
        corners = shapely.get_coordinates(shapely.box(*array.bounds))
        ring = np.vstack([np.linspace(start, stop, _SMOOTH) for start, stop in pairwise(corners)])
        around = [np.column_stack((ring, np.full(len(ring), height))) for height in span]
        upright = [np.array([(*corner, height) for height in span]) for corner in corners[:4]]
        lines = meshes.polylines([array.form.surface(line) for line in (*around, *upright)])
        lines.translate((0.0, 0.0, lift * meshes.MM_PER_M), inplace=True)
    return Part(name, lines, group, colour, line_width=2.0, lit=False)


def _ruler(
    axis: Literal["x", "y", "z"], ends: tuple[float, float], at: float, length: float, height: float
) -> tuple[Part, list[Text]]:
    """Ticks of a length with numbers along an axis, in mm."""
    # at a place on the other axis of the board, and at a height, of z at a place along y
    from matplotlib.ticker import MaxNLocator

    from coilarray.viz.extra_3d import pyvista

    low, high = ends
    ticks = np.asarray(MaxNLocator(10 if axis == "x" else 4, steps=[1, 2, 5, 10]).tick_values(low, high))
    ticks = ticks[(ticks >= low) & (ticks <= high)]
    edge_on: Side = "right" if axis == "x" else "front" if axis == "y" else "top"

    def place(along: float, outwards: float) -> tuple[float, float, float]:
        """Place equally far below and outside, for side views."""
        if axis == "z":
            return at - outwards, height, along
        beside = at - outwards, height - outwards
        return (along, *beside) if axis == "x" else (beside[0], along, beside[1])

    marks = pyvista.line_segments_from_points([place(t, d) for t in ticks.tolist() for d in (0.0, length)])
    texts = [Text(true_minus(f"{t:g}"), place(t, 2.2 * length), hidden_from=(edge_on,)) for t in ticks.tolist()]
    # Beyond the end of the edge it is clear of the numbers unless the board is small.
    beyond = 1.2 if axis == "x" else 2.2
    title = Text(f"{axis} (mm)", place(high + 2.6 * length, beyond * length), hidden_from=(edge_on,), always=True)
    return Part(f"ticks {axis}", marks, colour=INK, lit=False), [*texts, title]


VEILED = 0.13  # opacity of dented sheets through which the coils are visible
_WIDTH = 2.5  # width shown on each side of a dent, in stack thicknesses
_EXAGGERATED = 3.0  # times the real displacement, unless this reaches deeper than a share of the stack
_SOLID = 0.65
_EDGE = 40.0  # angle in degrees of an edge of a dented sheet
_TALL = 0.7  # height of the indenter over the thickness of the stack


def dent_scene(
    array: Array,
    sheets: Sequence[Sheet],
    indentation: xr.Dataset,
    indenter: Indenter,
    depth: int = -1,
    centre: tuple[float, float] = (0.0, 0.0),
) -> Scene:
    """Scene of a dent, best seen from the side "cut".

    It has the board `array`, the deformed `sheets` on it, upwards, and the `indenter`. A quarter of
    them is cut out. `indentation` is the result of `coilarray.indent`, and `depth` the index of a
    depth in it, by default the deepest. `centre` is x and y of the indenter on the board in m.
    Raises ValueError if the dataset has no such depth, or the centre is not on the board.
    """
    at = at_depth(indentation, depth)
    half = _WIDTH * float(at.height[-1])
    (x, y), (x_min, y_min, x_max, y_max) = centre, array.bounds
    if not (x_min < x < x_max and y_min < y < y_max):
        raise ValueError(f"centre must be on the board, {array.bounds} m; got {centre} m.")
    box = max(x_min, x - half), max(y_min, y - half), min(x_max, x + half), min(y_max, y + half)
    return scene_of_dent(array, sheets, at, indenter, centre, box) + scene_of_board(array, box=box)


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
    """Scene of the deformed sheets, within a `box` in m, and the indenter, cut open if opaque."""
    extent = array.bounds if box is None else box
    thickness, deep = float(dent.height[-1]), float(dent.depth)
    factor = _EXAGGERATED if _EXAGGERATED * deep < _SOLID * thickness else 1.0
    opened = opacity == 1.0  # through a veil the coils are seen without a cut
    tip = thickness - factor * deep
    body = meshes.indenter_mesh(indenter, tip, centre, extent, _TALL * thickness, factor, opened)
    label = f"{indenter.name}, {deep * meshes.MM_PER_M:g} mm deep" + (f", drawn {factor:g} ×" if factor > 1 else "")
    parts = [Part("indenter", body, label, METAL, smooth=True, ambient=0.3, shine=0.4)]
    labels = _sheet_labels(sheets)
    colours = cycled(SHEETS, list(labels))
    dented = meshes.dented_sheet_meshes(dent, sheets, centre, extent, factor, opened)
    values = np.concatenate([mesh.point_data[meshes.RISE] for mesh in dented.values()])
    scale = about_zero(meshes.RISE, "displacement upwards", "m", values) if opacity == 1.0 else None
    for name, mesh in reversed(dented.items()):
        look: dict[str, Any] = {"smooth": True, "ambient": 0.35, "diffuse": 0.7, "opacity": opacity, "scale": scale}
        if scale is not None:
            edges = mesh.extract_feature_edges(_EDGE, manifold_edges=False, non_manifold_edges=False)
            parts.append(Part(f"edges of sheet {name}", edges, labels[name], colours[name], lit=False, line_width=3.0))
        parts.append(Part(f"sheet {name}", mesh, labels[name], colours[name], **look))
    return Scene(tuple(parts))
