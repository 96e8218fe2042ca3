"""The view of the studio without a page: at what its camera is aimed."""

import asyncio
import itertools

import numpy as np
import pytest

from coilarray import load_design
from coilarray.design.vary import vary
from coilarray.viz.scenes.board import board_scene
from coilarray.viz.scenes.scene import seen_from

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("rendering", "studio_libraries")]


def board(columns):
    return board_scene(vary(load_design("starter"), {"array.columns": columns}).array, ())


def all_in(view, scene):
    """Whether the whole box of a scene is in the picture."""
    seen = seen_from(view._camera(), list(itertools.product(*np.reshape(scene.bounds, (3, 2)))), view._size)
    return bool(((seen > 0) & (seen < 1)).all())


def out(camera):
    """The direction from a scene to the camera."""
    away = np.subtract(camera.position, camera.focus)
    return away / np.linalg.norm(away)


@pytest.mark.parametrize("side", ["oblique", "top"])
@pytest.mark.parametrize(("shown", "beside"), [(2, 6), (6, 2)])
def test_the_camera_makes_room_for_another_design_wherever_it_is_turned_unless_it_is_moved(side, shown, beside):
    from trame.app import get_server

    from coilarray.viz.studio.view import SIZE, SceneView

    async def look():
        server = get_server(f"{side}{shown}", client_type="vue3")
        view = SceneView(server, lambda rests: None)
        server.start(backend="generic", exec_mode="task", port=0, timeout=0, show_connection_info=False)
        one, other = board(shown), board(beside)
        try:
            view.show(one, lambda: None)
            view.look_from(side)
            alone = view._camera()
            assert all_in(view, one)
            assert all_in(view, other) == (beside < shown)
            view.make_room_for(other)
            assert all_in(view, one)
            assert all_in(view, other)
            view.show(one, lambda: None)  # as after every change of the design
            assert all_in(view, other)
            view._plotter.camera.azimuth += 20.0  # as the mouse turns it
            turned = out(view._camera())
            for scene in (None, other):
                view.make_room_for(scene)
                assert all_in(view, one)
                assert all_in(view, other) == (scene is other or beside < shown)
                np.testing.assert_allclose(out(view._camera()), turned, atol=1e-9)  # rounding alone
            view._window.SetSize(300, 600)  # as the page does to make room for the picture beside
            view._fit()
            assert all_in(view, one)
            assert all_in(view, other)
            view._window.SetSize(*SIZE)
            view._fit()
            view._plotter.camera.zoom(2.0)
            moved = view._camera()
            for scene in (None, other):
                view.make_room_for(scene)
                view.show(one, lambda: None)
                assert view._camera() == moved
            view.make_room_for(None)
            view.look_from(side)
            now, then = (
                np.hstack([each.position, each.focus, each.up, each.scale]) for each in (view._camera(), alone)
            )
            np.testing.assert_allclose(now, then, rtol=1e-9, atol=1e-9)
        finally:
            view.close()
            await server.stop()

    asyncio.run(look())
