"""Scene of a board as arrays that the page draws itself."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.colors import to_rgb

from coilarray.design.model import Board, Design
from coilarray.geometry.pose import Pose
from coilarray.viz.datasets.meshes import MM_PER_M
from coilarray.viz.palette import INK
from coilarray.viz.scenes.board import CoilColours, board_in_pieces, recoloured
from coilarray.viz.scenes.design import bare_scene, first_states
from coilarray.viz.scenes.draw import bar_of, coloured_surface, gradient
from coilarray.viz.scenes.results import colours_of_delta
from coilarray.viz.scenes.scene import ANGLES, SIDES, Part, Scene
from coilarray.viz.studio.job import Step
from coilarray.viz.studio.session import Panel, Session

_STOPS = 24  # colours of a bar
_KEPT = 3  # scenes whose arrays a page may still ask for
_BEHIND = 2e-4  # by which a sunk surface lies behind, of the picture's depth
_WIDE = 1.25  # width over height of a board that has its results below it
_COILS = 255  # largest number of coils that a byte counts


def delta_by_coil(design: Design, delta: Mapping[str, float | None]) -> npt.NDArray[np.float64]:
    """δ of each coil's first measured state, or NaN."""
    states = first_states(design)
    return np.array([delta.get(states.get(name, "")) for name in design.coil_names], dtype=np.float64)  # None is NaN


@dataclass(frozen=True, eq=False)
class BoardParts:
    """Board in pieces."""

    design: Design
    copper: tuple[Part, ...]  # one part per layer
    rest: Scene  # laminate, barrels, names and rulers

    @cached_property
    def plain(self) -> Scene:
        """Board without results."""
        return Scene(self.copper) + self.rest

    @cached_property
    def lifted(self) -> Scene:
        """Board with its sheets lifted off it."""
        return bare_scene(self.design, sheets=True)

    def coloured(self, colours: CoilColours) -> Scene:
        """Colour the copper by values of the coils."""
        return Scene(recoloured(self.copper, colours)) + self.rest

    def by_delta(self, delta: Mapping[str, float | None], least: float = 0.0) -> Scene:
        """Colour the copper by δ, see `colours_of_delta`."""
        return self.coloured(colours_of_delta(delta_by_coil(self.design, delta), least))


@dataclass(frozen=True, eq=False)
class Packed:
    """Scene for the page: its words as JSON, and its arrays by their names."""

    words: dict[str, Any]
    arrays: dict[str, bytes] = field(default_factory=dict)


def packed(scene: Scene) -> Packed:
    """Pack a scene at the first position of its slider. Lengths are in mm."""
    scene = scene.still()
    arrays: dict[str, bytes] = {}

    def kept(array: npt.NDArray[Any]) -> dict[str, Any]:
        data = np.ascontiguousarray(array).tobytes()
        key = hashlib.blake2b(data, digest_size=8).hexdigest()
        arrays[key] = data
        return {"key": key, "length": len(data)}

    parts = []
    for part in scene.parts:
        look = {
            "group": part.group, "colour": list(to_rgb(part.colour)), "opacity": part.opacity, "lit": part.lit,
            "ambient": part.ambient, "diffuse": part.diffuse, "behind": _BEHIND if part.sunk else 0.0,
            "closed": part.closed, "gloss": part.shine, "width": part.line_width, "ink": part.colour == INK,
            "channels": 4 if part.fade else 3,
        }  # fmt: skip
        for lines, count, found in _shapes(part):
            parts.append(
                look | {"lines": lines, "count": count, "arrays": {name: kept(one) for name, one in found.items()}}
            )
    bounds = scene.bounds
    texts = [
        {
            "text": text.text, "at": list(text.position), "height": text.height, "bold": text.bold,
            "group": text.group, "hidden": list(text.hidden_from), "always": text.always,
        }
        for text in scene.texts
    ]  # fmt: skip
    radius = math.hypot(*np.ptp(np.reshape(bounds, (3, 2)), axis=1)) / 2
    return Packed({"parts": parts, "texts": texts, "bounds": list(bounds), "radius": radius}, arrays)


def _shapes(part: Part) -> list[tuple[bool, int, dict[str, npt.NDArray[Any]]]]:
    """Lines and triangles of a part: whether lines, their number of vertices or lines, and arrays."""
    surface, colours, on_cells = coloured_surface(part)
    points = np.asarray(surface.points, dtype=np.float32)
    found = []
    lines = surface.GetLines()
    if lines.GetNumberOfCells():
        offsets, joined = (_numbers(one) for one in (lines.GetOffsetsArray(), lines.GetConnectivityArray()))
        first = np.delete(np.arange(len(joined)), offsets[1:] - 1)
        ends = np.column_stack((joined[first], joined[first + 1]))
        segments: dict[str, npt.NDArray[Any]] = {"points": points[ends]}
        if colours is not None:
            of_line = np.searchsorted(offsets, first, side="right") - 1
            segments["colours"] = colours[of_line if on_cells else ends[:, 0]]
        found.append((True, len(ends), segments))
    if surface.GetPolys().GetNumberOfCells() or surface.GetStrips().GetNumberOfCells():
        if not surface.is_all_triangles:
            surface = surface.triangulate()  # keeps the points
        corners = surface.regular_faces.astype(np.uint32)
        arrays: dict[str, npt.NDArray[Any]] = {"points": points}
        coils = part.mesh.cell_data.get("coil") if len(part.mesh.cell_data) else None
        if part.smooth and "Normals" in surface.point_data:
            arrays["normals"] = np.asarray(surface.point_data["Normals"], dtype=np.float32)
        if coils is not None and len(coils) == len(corners):  # solids of coils share no points
            of_point = np.zeros(len(points), dtype=np.uint8)
            of_point[corners.ravel()] = np.repeat(np.minimum(coils + 1, _COILS), 3)
            arrays["coils"] = of_point
            if colours is not None and on_cells:
                of_points = np.zeros((len(points), colours.shape[1]), dtype=np.uint8)
                of_points[corners.ravel()] = np.repeat(colours, 3, axis=0)
                colours, on_cells = of_points, False
        if colours is not None and on_cells:
            arrays = {name: one[corners.ravel()] for name, one in arrays.items()}
            arrays["colours"] = np.repeat(colours[-len(corners) :], 3, axis=0)
        else:
            arrays["index"] = corners
            if colours is not None:
                arrays["colours"] = colours
        found.append((False, corners.size, arrays))
    return found


def _numbers(array: Any) -> npt.NDArray[np.int64]:
    from vtkmodules.util import numpy_support

    convert: Any = numpy_support.vtk_to_numpy
    return np.asarray(convert(array), dtype=np.int64)


def plan_of(design: Design) -> dict[str, Any]:
    """Outlines of the coils and of the first board in space, in mm."""
    # They take no time. `movable` coils can be dragged: on a flat board at its own place.
    coils = []
    for board in design.placed:
        for place in board.array.placements:
            coils.append({
                "name": f"{board.prefix}{place.name}", "x": place.x * 1e3, "y": place.y * 1e3, "turn": place.rotation,
                "outline": _in_space(board, place.to_board(place.coil.outline)),
                "centre": _in_space(board, np.array([[place.x, place.y]]))[0],
            })  # fmt: skip
    own = design.placed[0]
    x_min, y_min, x_max, y_max = own.array.bounds
    corners = np.array([(x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max)])
    movable = own.array.form is None and own.pose == Pose()
    wide = x_max - x_min > _WIDE * (y_max - y_min)
    return {
        "digest": design.digest, "movable": movable, "wide": wide, "coils": coils, "box": _in_space(own, corners),
    }  # fmt: skip


def _in_space(board: Board, points: npt.NDArray[np.float64]) -> list[list[float]]:
    """Points (n, 2) of a board in m as places in space in mm."""
    flat = np.column_stack((points[:, :2], np.zeros(len(points))))
    placed: list[list[float]] = np.round(MM_PER_M * board.in_space(flat), 4).tolist()
    return placed


Maker = Callable[[Design, BoardParts], Scene | None]  # function that makes a scene in a thread, or None


class ScenePanel(Panel):
    """Panel with the picture of the board."""

    def __init__(self, session: Session, tabs: Mapping[str, Maker], metal: Maker) -> None:
        self._tabs, self._metal = tabs, metal  # scenes of tabs, and of designs with metal
        self._parts: BoardParts | None = None
        self._expected = 0  # number of the last scene that makes the shown scene stale
        self._drawn: tuple[Scene, Packed] | None = None
        self._sent: dict[int, tuple[Design, int, Scene, Packed]] = {}
        problem = session.setup.rendering_problem or ("not shown" if session.setup.services.alone else None)
        self._off = problem is not None
        session.state.client_only("hidden_groups", "hovered", "picked", "legend")
        values = {
            "scene_problem": problem or "", "scene": {}, "plan": {}, "hovered": "", "picked": "",
            "scene_sides": [{"name": side, "angles": ANGLES[side]} for side in SIDES],
            "hidden_groups": [], "legend": _legend(Scene()), "scene_sheets": False,
        }  # fmt: skip
        super().__init__(session, values, scene_shown=self._shown)

    def show(self, design: Design) -> None:
        """Show at once where the coils of a design are."""
        if not self._off:
            self._set("plan", plan_of(design))

    def arrays(self, keys: str) -> bytes | None:
        """Arrays by their keys with commas, one after the other, or None if they are gone."""
        known = {key: data for *_, one in self._sent.values() for key, data in one.arrays.items()}
        wanted = keys.split(",")
        return b"".join(known[key] for key in wanted) if all(key in known for key in wanted) else None

    def expect(self) -> None:
        """Mark the picture as stale."""
        self._expected += 1
        if not self._off and "scene" not in self._state.stale:
            self._set("stale", [*self._state.stale, "scene"])

    def steps(self) -> list[Step]:
        """Make the step that computes the current scene."""
        if self._off:
            return []
        design, number = self._session.work.design, self._expected
        tab, sheets = str(self._state.tab), bool(self._state.scene_sheets)

        def compute() -> tuple[Design, int, Scene, Packed]:
            scene = self._scene(design, tab, sheets)
            same = self._drawn is not None and self._drawn[0] is scene
            one = self._drawn[1] if same and self._drawn else packed(scene)
            return design, number, scene, replace(one, words=one.words | {"tab": tab})

        return [Step("scene", compute, self._send, partial(self._set, "scene_problem"))]

    def _scene(self, design: Design, tab: str, sheets: bool) -> Scene:
        """Compute a scene in a thread, maybe with lifted sheets."""
        if self._parts is None or self._parts.design is not design:
            self._parts = BoardParts(design, *board_in_pieces(design.placed))
        scene = self._tabs[tab](design, self._parts) if tab in self._tabs else None
        if scene is None and (design.plates or design.target is not None):
            scene = self._metal(design, self._parts)
        return scene or (self._parts.lifted if sheets else self._parts.plain)

    def _send(self, found: tuple[Design, int, Scene, Packed]) -> None:
        """Send a scene; its arrays are asked for by the page."""
        design, _, scene, one = found
        self._drawn = scene, one
        number = max(self._sent, default=0) + 1
        self._sent[number] = found
        for old in list(self._sent)[:-_KEPT]:
            del self._sent[old]
        poses = [
            {"name": place.name, "x": place.x * 1e3, "y": place.y * 1e3, "turn": place.rotation}
            for place in design.array.placements
        ]
        of = {"number": number, "page": self._session.key, "digest": design.digest, "poses": poses}
        self._state.scene = {**one.words, **of, "legend": _legend(scene)}

    def _shown(self, number: int) -> None:
        if number not in self._sent:
            return
        design, expected, *_ = self._sent[number]
        with self._state as state:
            state.scene_problem = ""
            if expected == self._expected:
                self._session.arrived("scene", design)

    def _set(self, name: str, value: Any) -> None:
        with self._state as state:
            state[name] = value


def _legend(scene: Scene) -> dict[str, Any]:
    bars = [bar_of(scale, _STOPS) for scale in scene.scales]
    return {
        "groups": [{"name": name, "colour": gradient(colours)} for name, colours in scene.groups.items()],
        "bars": [{"title": title, "colours": gradient(colours), "ticks": ticks} for title, colours, ticks in bars],
        "notes": list(scene.notes),
    }
