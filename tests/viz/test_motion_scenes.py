"""Scenes of boards that move: where the copper is at every position."""

import numpy as np

from coilarray import Array, Board, Spiral
from coilarray.geometry import Pose
from coilarray.viz.scenes.board import moving_scenes, room, scene_of_motion
from coilarray.viz.scenes.scene import Slider

COIL = Array.row(Spiral(4, 10e-3, 3, 0.3e-3, 0.3e-3), 1)
HEIGHTS = (5.0, 9.0)  # mm
MOVED = [[Board(COIL, Pose(z=height * 1e-3), "tag")] for height in HEIGHTS]
NOTES = (("low",), ("high",))


def test_moving_boards_are_where_their_poses_take_them():
    tops = [scene.parts[0].mesh.bounds[5] for scene in moving_scenes(MOVED, NOTES)]
    np.testing.assert_allclose(np.diff(tops), np.diff(HEIGHTS), rtol=1e-6)  # points of single precision
    assert [scene.notes for scene in moving_scenes(MOVED, NOTES)] == list(NOTES)


def test_all_loops_of_a_surface_that_moves_are_in_every_picture():
    loops = [[Board(COIL, Pose(x=x, z=z * 1e-3), "head") for x in (0.0, 30e-3)] for z in HEIGHTS]
    for scene in moving_scenes(loops, NOTES):
        copper = next(part for part in scene.parts if "copper" in part.name)
        assert copper.mesh.bounds[1] - copper.mesh.bounds[0] > 35  # mm, of both
        assert len({part.name for part in scene.parts}) == len(scene.parts)


def test_a_slider_shows_one_position_and_what_stays():
    scene = scene_of_motion([Board(COIL, name="")], MOVED, Slider("pose", ("5", "9"), NOTES))
    for step, moved in enumerate(moving_scenes(MOVED, NOTES)):
        moving = [part for part in scene.still(step).parts if part.step is not None]
        assert [part.mesh.bounds for part in moving] == [part.mesh.bounds for part in moved.parts]
        assert any(part.step is None for part in scene.still(step).parts)
        assert scene.still(step).notes[-1:] == NOTES[step]


def test_a_camera_sees_all_positions():
    low, high = room([at for boards in MOVED for board in boards for at in board.pieces.reshape(-1, 3)]).bounds[4:]
    # points of single precision
    np.testing.assert_allclose((low, high), (HEIGHTS[0] - 1e3 * COIL.stackup.thickness, HEIGHTS[1]), rtol=1e-6)
