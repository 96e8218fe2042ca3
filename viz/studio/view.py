"""View of a scene on the page.

It is drawn here, sent to the page as images, and turned there with the mouse.
"""

from __future__ import annotations

import asyncio
import io
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, cast

import numpy as np
from PIL import Image

from coilarray.viz.scenes.draw import draw_parts, set_camera, text_name
from coilarray.viz.scenes.scene import FILLED, Camera, Scene, Side, Text, aim, aim_again, direction

SIZE = (900, 560)
"""Width and height of the picture in pixels before the page sends its own."""

_SMOOTH_AFTER = 0.5  # s without a change before edges are smoothed
_ENCODING = 0.003  # s between two tests if a picture is encoded
_LOOKS = 600  # largest number of these tests, as a hidden page gets no pictures
_SAMPLES = 8  # samples per pixel of a smooth picture, which takes three times as long
_SAME = 1e-6  # tolerance of the camera's numbers
_LARGEST = (5120, 5120)  # largest width and height in pixels
_RESIZED = 0.03  # relative change of a side above which texts are drawn again
_NARROW = 1.2  # width over height below which letters and lines become smaller
_LEAST_LETTER = 9.0  # least legible height of letters in pixels
_RULER = 26.0  # pixels that a text of a ruler may reach beyond the scene to either side
_HEIGHT = 900.0  # height in pixels of the picture for which letters are given


class SceneView:
    """View of one scene at a time.

    It is on the page of a trame `server`. `at_rest` is called with True after a smooth picture was sent, and with False
    if it is out of date.
    """

    def __init__(self, server: Any, at_rest: Callable[[bool], None]) -> None:
        import pyvista
        from trame.widgets import vtk

        self._plotter = cast("Any", pyvista.Plotter(off_screen=True, window_size=list(SIZE)))
        self._window = self._plotter.render_window
        self._window.SetMultiSamples(0)
        self._beside: Any = None  # renders `picture`
        self._server, self._at_rest = server, at_rest
        self._scene: Scene | None = None
        self._sent: Callable[[], None] | None = None
        self._hidden: set[str] = set()
        self._beside_bounds: tuple[float, ...] = ()
        self._aimed: Camera | None = None  # the last aim
        self._side: Side = "oblique"
        self._drawn_size = SIZE
        self._timers: dict[str, asyncio.TimerHandle] = {}  # of smoothing, sending and resizing
        quality = {"interactive_ratio": 1, "interactive_quality": 70, "still_quality": 92}
        self.widget = vtk.VtkRemoteView(self._window, ref="scene", trame_server=server, **quality)
        style = self._plotter.iren.interactor.GetInteractorStyle()
        style.AddObserver("StartInteractionEvent", lambda *_: self._rough())
        style.AddObserver("EndInteractionEvent", lambda *_: self._smooth_soon())
        self._window.AddObserver("WindowResizeEvent", lambda *_: self._resized())

    def show(self, scene: Scene, sent: Callable[[], None]) -> None:
        """Draw another scene.

        `sent` is called with its first picture. The whole scene is seen from the user's direction, unless the user has
        moved or zoomed the picture.
        """
        self._sent = sent
        self._show(scene)

    def _show(self, scene: Scene) -> None:
        """Draw another scene with the user's camera."""
        moved = self._scene is not None and not self._is_aimed()
        camera = self._camera()
        self._scene = scene
        self._draw()
        if moved:
            set_camera(self._plotter, camera)
        self._push()

    def look_from(self, side: Side) -> None:
        """Turn the camera to a side.

        It is aimed at the whole scene.
        """
        self._side = side
        if self._scene is not None:
            self._aimed = None
            self._aim()
            self._push()

    def make_room_for(self, scene: Scene | None) -> None:
        """Aim the camera at all of another scene too.

        A `picture` of the other scene is shown beside. None stands for no other scene.
        """
        bounds = () if scene is None else scene.bounds
        aimed, self._beside_bounds = self._beside_bounds != bounds and self._is_aimed(), bounds
        if aimed:
            self._aim()
            self._push()

    def picture(self, scene: Scene) -> bytes:
        """Picture of another scene as a PNG file.

        It has the same size, camera and hidden groups.
        """
        if self._beside is None:
            import pyvista

            self._beside = cast("Any", pyvista.Plotter(off_screen=True))
        plotter = self._beside
        plotter.window_size = list(self._size)
        plotter.set_background("white")
        plotter.renderer.RemoveAllViewProps()
        shown = [part for part in scene.parts if part.group not in self._hidden]
        texts = [text for text in scene.texts if text.group not in self._hidden]
        draw_parts(_fitted(Scene(tuple(shown), tuple(texts)), self._size), plotter)
        set_camera(plotter, self._camera())
        plotter.render()
        buffer = io.BytesIO()
        Image.fromarray(plotter.screenshot(return_img=True)).save(buffer, format="png", compress_level=3)
        return buffer.getvalue()

    def hide(self, groups: Iterable[str]) -> None:
        """Hide these groups of the scene, and show all others."""
        self._hidden = set(groups)
        self._hide()
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
        if self._beside is not None:
            self._beside.close()

    def _draw(self) -> None:
        """Draw the scene for the size of the picture."""
        if self._scene is None:
            return
        self._plotter.set_background("white")
        self._plotter.renderer.RemoveAllViewProps()  # but keeps its lights
        draw_parts(_fitted(self._scene, self._size), self._plotter)
        self._aim()
        self._drawn_size = self._size
        self._hide()

    def _hide(self) -> None:
        """Hide the actors of hidden groups, and show the others."""
        if self._scene is None:
            return
        actors = self._plotter.actors  # PyVista makes it again each time
        for part in self._scene.parts:
            if part.group:
                actors[part.name].SetVisibility(part.group not in self._hidden)
        for text in self._scene.texts:
            height = _letters(text, self._drawn_size)
            name = f"{text_name(text.group, height, text.bold, text.always)}-labels"
            if text.group and name in actors:
                actors[name].SetVisibility(text.group not in self._hidden)

    def _aim(self) -> None:
        """Aim at the scene and the scene beside.

        The direction is the chosen side, or as the user has turned the scene since.
        """
        if self._scene is not None:
            lowest, highest = np.reshape([*self._scene.bounds, *self._beside_bounds], (-1, 3, 2)).T
            bounds = cast("Any", tuple(np.column_stack([lowest.min(axis=1), highest.max(axis=1)]).ravel().tolist()))
            room = max(0.0, _RULER / self._size[0] - (1.0 - FILLED) / 2)
            set_camera(
                self._plotter,
                aim(bounds, self._size, direction(self._side), left=room, right=room)
                if self._aimed is None
                else aim_again(self._camera(), bounds, self._size, left=room, right=room),
            )
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
        self._later("smoothing", _SMOOTH_AFTER, self._smooth)

    def _smooth(self) -> None:
        self._window.SetMultiSamples(_SAMPLES)
        self._send(True)

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
        """Send the picture if encoded, or test again soon.

        It is rendered if necessary. The widget would send the last picture once more, and look for the new picture half
        a second later.
        """
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

    def _resized(self) -> None:
        """Draw letters and lines for another height.

        This happens once the size of the page is constant.
        """
        width, height = (min(side, most) for side, most in zip(self._size, _LARGEST, strict=True))
        if (width, height) != self._size:  # the page may ask for any size
            self._window.SetSize(width, height)
        self._later("resizing", 0.1, self._fit)

    def _fit(self) -> None:
        change = np.abs(np.divide(self._size, self._drawn_size) - 1).max()
        if self._scene is not None and change > _RESIZED:
            self._show(self._scene)

    def _later(self, name: str, seconds: float, function: Callable[..., None], *arguments: Any) -> None:
        """Call a function after some seconds.

        It is not called if it is requested again or forgotten before.
        """
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
        """Width and height of the picture in pixels."""
        width, height = self._plotter.window_size
        return width, height

    def _camera(self) -> Camera:
        camera = self._plotter.camera
        return Camera(camera.position, camera.focal_point, camera.up, camera.parallel_scale)

    def _is_aimed(self) -> bool:
        """Check that the user has kept the aimed camera.

        The picture was not moved or zoomed since the camera was aimed.
        """
        if self._aimed is None:
            return False
        now, then = ((*one.focus, one.scale) for one in (self._camera(), self._aimed))
        return bool(np.allclose(now, then, rtol=_SAME, atol=_SAME))


def _fitted(scene: Scene, size: tuple[int, int]) -> Scene:
    """Scene whose letters and lines fit a narrow picture.

    It has no notes, because the page shows them.
    """
    part = _part(size)
    parts = tuple(replace(one, line_width=one.line_width * part) for one in scene.parts)
    texts = tuple(replace(text, height=_letters(text, size)) for text in scene.texts)
    return Scene(parts, texts)


def _letters(text: Text, size: tuple[int, int]) -> float:
    """Legible height of a text's letters.

    It is in pixels of a picture 900 pixels high, and legible in this picture.
    """
    return max(text.height * _part(size), _LEAST_LETTER * _HEIGHT / size[1])


def _part(size: tuple[int, int]) -> float:
    return min(1.0, size[0] / (_NARROW * size[1]))
