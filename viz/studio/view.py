"""Scene of a board sent as images, and turned with the mouse."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from coilarray.design.model import Design
from coilarray.viz.scenes.board import CoilColours, board_in_pieces, recoloured
from coilarray.viz.scenes.design import bare_scene, first_states
from coilarray.viz.scenes.draw import bar_of, draw_parts, gradient, set_camera, text_name
from coilarray.viz.scenes.results import colours_of_delta
from coilarray.viz.scenes.scene import FILLED, SIDES, Camera, Part, Scene, Side, Text, aim
from coilarray.viz.studio.job import Step
from coilarray.viz.studio.session import Panel, Session


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

    def coloured(self, colours: CoilColours) -> Scene:
        """Colour the copper by values of the coils."""
        return Scene(recoloured(self.copper, colours)) + self.rest

    def by_delta(self, delta: Mapping[str, float | None], least: float = 0.0) -> Scene:
        """Colour the copper by δ, see `colours_of_delta`."""
        return self.coloured(colours_of_delta(delta_by_coil(self.design, delta), least))


SIZE = (900, 560)
"""Width and height in pixels until the page sends its."""

_SMOOTH_AFTER = 0.5  # s without a change before edges are smoothed
_ENCODING = 0.003  # s between two tests if a picture is encoded
_LOOKS = 600  # largest number of these tests, as a hidden page gets no pictures
_SAMPLES = 8  # samples per pixel of a smooth picture, which takes three times as long
_SAME = 1e-6  # tolerance of the camera's numbers
_RESIZED = 0.03  # relative change of a side above which texts are drawn again
_NARROW = 1.2  # width over height below which letters and lines become smaller
_LEAST_LETTER = 9.0  # least legible height of letters in pixels
_RULER = 26.0  # pixels that a text of a ruler may reach beyond the scene to either side
_HEIGHT = 900.0  # height in pixels of the picture for which letters are given


class SceneView:
    """View of one scene at a time.

    `at_rest` gets True after a smooth picture was sent, and False if it is out of date.
    """

    def __init__(self, server: Any, at_rest: Callable[[bool], None]) -> None:
        import pyvista
        from trame.widgets import vtk

        self._plotter = cast("Any", pyvista.Plotter(off_screen=True, window_size=list(SIZE)))
        self._window = self._plotter.render_window
        self._window.SetMultiSamples(0)
        self._server, self._at_rest = server, at_rest
        self._scene: Scene | None = None
        self._sent: Callable[[], None] | None = None
        self._hidden: set[str] = set()
        self._aimed: Camera | None = None  # the last aim
        self._side: Side = "oblique"
        self._drawn_size = SIZE
        self._timers: dict[str, asyncio.TimerHandle] = {}  # of smoothing, sending and resizing
        quality = {"interactive_ratio": 1, "interactive_quality": 70, "still_quality": 92}
        self.widget = vtk.VtkRemoteView(self._window, ref="scene", trame_server=server, **quality)
        style = self._plotter.iren.interactor.GetInteractorStyle()
        style.AddObserver("StartInteractionEvent", lambda *_: self._rough())
        style.AddObserver("EndInteractionEvent", lambda *_: self._smooth_soon())
        self._window.AddObserver("WindowResizeEvent", lambda *_: self._later("resizing", 0.1, self._fit))

    def show(self, scene: Scene, sent: Callable[[], None] | None = None) -> None:
        """Draw another scene with the user's camera, then call `sent`."""
        self._sent = sent or self._sent
        camera, aimed = self._camera(), self._aimed
        # whether the user has moved the aimed camera
        moved = (
            self._scene is not None
            and aimed is not None
            and not np.allclose((*camera.focus, camera.scale), (*aimed.focus, aimed.scale), rtol=_SAME, atol=_SAME)
        )
        self._scene, self._drawn_size = scene, self._size
        self._plotter.set_background("white")
        self._plotter.renderer.RemoveAllViewProps()  # but keeps its lights
        draw_parts(_fitted(scene, self._size), self._plotter)
        self._aim(scene)
        self._hide(scene)
        if moved:
            set_camera(self._plotter, camera)
        self._push()

    def look_from(self, side: Side) -> None:
        """Turn the camera to a side."""
        self._side, self._aimed = side, None
        if self._scene is not None:
            self._aim(self._scene)
            self._push()

    def hide(self, groups: Iterable[str]) -> None:
        """Hide these groups of the scene, and show all others."""
        self._hidden = set(groups)
        if self._scene is not None:
            self._hide(self._scene)
        self._push()

    def close(self) -> None:
        """Release the window."""
        self._forget(*self._timers)
        # Trame would create the window again for a pending image, and never removes its observers.
        self._server.protocol_call("viewport.image.push.enabled", self._id, False)
        while "result" in self._server.protocol_call("viewport.image.push.observer.remove", self._id):
            pass
        self._window.RemoveAllObservers()
        self._plotter.close()

    def _hide(self, scene: Scene) -> None:
        """Hide the actors of hidden groups, and show the others."""
        actors = self._plotter.actors  # PyVista makes it again each time
        groups = {part.name: part.group for part in scene.parts}
        for text in scene.texts:
            groups[f"{text_name(replace(text, height=_letters(text, self._drawn_size)))}-labels"] = text.group
        for name, group in groups.items():
            if group and name in actors:
                actors[name].SetVisibility(group not in self._hidden)

    def _aim(self, scene: Scene) -> None:
        """Aim from the side, or from the user's last direction."""
        room = max(0.0, _RULER / self._size[0] - (1.0 - FILLED) / 2)
        side = self._side if self._aimed is None else self._camera()
        set_camera(self._plotter, aim(scene.bounds, self._size, side, room, room))
        self._aimed = self._camera()

    def _push(self) -> None:
        self._rough()
        self._send(False)
        self._smooth_soon()

    def _rough(self) -> None:
        """Use one sample per pixel until the picture rests."""
        self._forget("smoothing", "sending")
        self._window.SetMultiSamples(0)
        self._at_rest(False)

    def _smooth_soon(self) -> None:
        def smooth() -> None:
            self._window.SetMultiSamples(_SAMPLES)
            self._send(True)

        self._later("smoothing", _SMOOTH_AFTER, smooth)

    def _send(self, smooth: bool) -> None:
        """Render, and send the picture once it is encoded."""
        protocol = self._server.protocol  # None before the first message of the page
        app = None if protocol is None else protocol.getSharedObject("app")
        if app is None:
            self.widget.update()
            self._was_sent(smooth)
            return
        app.InvalidateCache(self._window)
        self._send_encoded(app, smooth, _LOOKS)

    def _send_encoded(self, app: Any, smooth: bool, looks: int) -> None:
        """Send the picture if encoded, or test again soon."""
        self._forget("sending")
        quality = self._server.protocol_call("viewport.image.push.quality.get", self._id)["quality"]
        app.StillRenderToBuffer(self._window, 0, quality)
        if app.GetHasImagesBeingProcessed(self._window) and looks:
            self._later("sending", _ENCODING, self._send_encoded, app, smooth, looks - 1)
            return
        app.InvokeEvent("UpdateEvent")  # sends the encoded picture, and renders nothing
        self._was_sent(smooth)

    def _was_sent(self, smooth: bool) -> None:
        sent, self._sent = self._sent, None
        if sent is not None:
            sent()
        if smooth:
            self._at_rest(True)

    def _fit(self) -> None:
        """Draw letters and lines for another height."""
        change = np.abs(np.divide(self._size, self._drawn_size) - 1).max()
        if self._scene is not None and change > _RESIZED:
            self.show(self._scene)

    def _later(self, name: str, seconds: float, function: Callable[..., None], *arguments: Any) -> None:
        """Call a function later, unless requested again or forgotten."""
        self._forget(name)
        self._timers[name] = asyncio.get_running_loop().call_later(seconds, function, *arguments)

    def _forget(self, *names: str) -> None:
        for name in names:
            if name in self._timers:
                self._timers[name].cancel()

    @property
    def _id(self) -> Any:
        """Name of the window between the server and the page."""
        return self.widget.module.id(self._window)

    @property
    def _size(self) -> tuple[int, int]:
        width, height = self._plotter.window_size
        return width, height

    def _camera(self) -> Camera:
        camera = self._plotter.camera
        return Camera(camera.position, camera.focal_point, camera.up, camera.parallel_scale)


def _fitted(scene: Scene, size: tuple[int, int]) -> Scene:
    """Scene for a narrow picture, without its notes."""
    part = _part(size)
    parts = tuple(replace(one, line_width=one.line_width * part) for one in scene.parts)
    texts = tuple(replace(text, height=_letters(text, size)) for text in scene.texts)
    return Scene(parts, texts)


def _letters(text: Text, size: tuple[int, int]) -> float:
    """Legible height of a text's letters."""
    return max(text.height * _part(size), _LEAST_LETTER * _HEIGHT / size[1])


def _part(size: tuple[int, int]) -> float:
    return min(1.0, size[0] / (_NARROW * size[1]))


_STOPS = 24  # colours of a bar

Maker = Callable[[Design, BoardParts], Scene | None]
"""Function that makes a scene in a thread, or None."""


class ScenePanel(Panel):
    """Panel with the view and its scene."""

    def __init__(self, session: Session, tabs: Mapping[str, Maker], metal: Maker) -> None:
        self._tabs, self._metal = tabs, metal  # scenes of tabs, and of designs with metal
        self._parts: BoardParts | None = None
        self._expected = 0  # number of the last scene that makes the shown scene stale
        self._alone: tuple[Design, bool, Scene] | None = None  # the last scene without results, with or without sheets
        self._drawn: Scene | None = None
        problem = session.setup.rendering_problem or ("not shown" if session.setup.services.alone else None)
        self._view = None if problem else SceneView(session.server, lambda rests: self._set("scene_rests", rests))
        values = {
            "scene_problem": problem or "", "scene_rests": False, "scene_sides": list(SIDES),
            "hidden_groups": [], "legend": _legend(Scene()), "scene_sheets": False,
        }  # fmt: skip
        super().__init__(session, values, look_from=self._look_from)

    @property
    def html(self) -> str:
        """HTML of the view, empty if nothing can be rendered."""
        return "" if self._view is None else str(self._view.widget.html)

    def expect(self) -> None:
        """Mark the picture as stale."""
        self._expected += 1
        if self._view is not None and "scene" not in self._state.stale:
            self._set("stale", [*self._state.stale, "scene"])

    def steps(self) -> list[Step]:
        """Make the step that computes the current scene."""
        if self._view is None:
            return []
        design, number = self._session.work.design, self._expected
        tab, sheets = str(self._state.tab), bool(self._state.scene_sheets)

        def compute() -> tuple[Design, int, Scene]:
            return design, number, self._scene(design, tab, sheets)

        return [Step("scene", compute, self._show, partial(self._set, "scene_problem"))]

    def close(self) -> None:
        """Release the window."""
        if self._view is not None:
            self._view.close()

    def _scene(self, design: Design, tab: str, sheets: bool) -> Scene:
        """Compute a scene in a thread, maybe with lifted sheets."""
        if self._parts is None or self._parts.design is not design:
            self._parts = BoardParts(design, *board_in_pieces(design.placed))
        scene = self._tabs[tab](design, self._parts) if tab in self._tabs else None
        if scene is None and (design.plates or design.target is not None):
            scene = self._metal(design, self._parts)
        if scene is not None:
            return scene
        if self._alone is None or self._alone[0] is not design or self._alone[1] != sheets:
            self._alone = design, sheets, bare_scene(design, sheets=sheets)
        return self._alone[2]

    def _show(self, found: tuple[Design, int, Scene]) -> None:
        if self._view is None:
            return
        design, number, scene = found

        def sent() -> None:
            with self._state as state:
                state.legend, state.scene_problem = _legend(scene), ""
                if number == self._expected:
                    self._session.arrived("scene", design)

        if scene is self._drawn:
            sent()
        else:
            self._drawn = scene
            self._view.show(scene, sent)

    def _set(self, name: str, value: Any) -> None:
        with self._state as state:
            state[name] = value

    def _look_from(self, side: str) -> None:
        if self._view is not None and side in SIDES:
            self._view.look_from(side)

    def hide(self) -> None:
        """Hide the groups that the page names."""
        if self._view is not None:
            self._view.hide(self._state.hidden_groups)


def _legend(scene: Scene) -> dict[str, Any]:
    bars = [bar_of(scale, _STOPS) for scale in scene.scales]
    return {
        "groups": [{"name": name, "colour": gradient(colours)} for name, colours in scene.groups.items()],
        "bars": [{"title": title, "colours": gradient(colours), "ticks": ticks} for title, colours, ticks in bars],
        "notes": list(scene.notes),
    }
