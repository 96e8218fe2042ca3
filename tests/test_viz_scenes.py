"""Scenes: what stands in them, and that a picture shows something; without rendering, the one line that says so."""

from __future__ import annotations

import math

import numpy as np
import pytest
from matplotlib.image import imread

from coilarray.errors import MissingDependencyError
from coilarray.geometry import (
    CoilArray,
    Leads,
    Placement,
    PlatedHole,
    Sheet,
    Spiral,
    Stackup,
    apothem_from_size,
    lattice,
    path_coil,
    spiral_coil,
)
from coilarray.viz import board_scene, rendering_problem, save_board_picture, show_board
from coilarray.viz.offscreen import NO_RENDERING

SHEETS = (Sheet("base", 6e-3), Sheet("magnetic", 2e-3, 2.7))


@pytest.fixture(scope="module")
def board():
    spiral = Spiral(6, apothem_from_size(23e-3, 6, across="corners"), 5, 0.1e-3, 0.1e-3, first_corner=math.pi / 2)
    coil = spiral_coil(spiral, 2, PlatedHole(0.2e-3, 0.45e-3), Leads(2e-3, 1.5e-3, PlatedHole(0.5e-3, 1e-3)))
    points, _ = lattice("linear", 13.28e-3, 2)
    pairs = (("L1", "L2"), ("L3", "L4"))
    placements = tuple(Placement(f"C{i + 1}", coil, pairs[i % 2], *point) for i, point in enumerate(points.tolist()))
    return CoilArray(Stackup(("L1", "L2", "L3", "L4"), (35e-6,) * 4, (0.215e-3,) * 3, (4.5,) * 3), placements)


@pytest.fixture
def plotter():
    problem = rendering_problem()
    if problem is not None:
        pytest.skip(problem)
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=(320, 180))
    yield plotter
    plotter.close()


def test_a_scene_holds_every_part(board, plotter):
    board_scene(board, SHEETS, plotter=plotter)
    expected = {"board", "barrels", "sheet base", "sheet magnetic", *(f"copper L{k}" for k in (1, 2, 3, 4))}
    assert expected <= set(plotter.actors)
    legend = plotter.legend
    texts = [legend.GetEntryString(k) for k in range(legend.GetNumberOfEntries())]
    assert texts[:3] == ["magnetic 2 mm", "base 6 mm", "copper L1"]


def test_sheets_can_be_left_out(board, plotter):
    board_scene(board, SHEETS, plotter=plotter, show_sheets=False)
    assert not [name for name in plotter.actors if "sheet" in name]
    assert plotter.bounds[5] < 1.0  # mm: nothing stands above the board


def test_the_whole_scene_is_in_view(board, plotter):
    board_scene(board, SHEETS, plotter=plotter)
    plotter.render()
    x_min, x_max, y_min, y_max, z_min, z_max = plotter.bounds
    renderer = plotter.renderer
    for corner in [(x, y, z) for x in (x_min, x_max) for y in (y_min, y_max) for z in (z_min, z_max)]:
        renderer.SetWorldPoint(*corner, 1.0)
        renderer.WorldToDisplay()
        across, up, _ = renderer.GetDisplayPoint()
        assert 0 < across < 320
        assert 0 < up < 180


def test_a_picture_has_its_size_and_shows_copper(board, plotter, tmp_path):
    path = tmp_path / "board.png"
    save_board_picture(board, path, SHEETS, size=(400, 225))
    picture = imread(path)[..., :3]
    assert picture.shape == (225, 400, 3)
    red, green, blue = np.moveaxis(picture, -1, 0)
    assert (green > red + 0.05).mean() > 0.05  # the laminate
    assert (red > blue + 0.2).sum() > 50  # copper of the upper layers
    assert (picture.min(axis=-1) > 0.99).mean() > 0.1  # white paper around it
    assert [entry.name for entry in tmp_path.iterdir()] == ["board.png"]


def test_a_board_of_one_layer_has_no_laminate_and_is_drawn(plotter):
    coil = path_coil([[(0, 0), (1e-2, 0), (1e-2, 5e-3)]], 0.5e-3, 0.2e-3, PlatedHole(0.3e-3, 0.6e-3))
    single = CoilArray(Stackup(("top",), (35e-6,), (), ()), (Placement("A", coil, ("top",), 0, 0),))
    board_scene(single, plotter=plotter)
    assert "copper top" in plotter.actors
    assert "board" not in plotter.actors


def test_without_rendering_a_picture_is_refused_in_one_line(board, tmp_path, monkeypatch):
    monkeypatch.setenv(NO_RENDERING, "1")
    with pytest.raises(MissingDependencyError, match=NO_RENDERING):
        save_board_picture(board, tmp_path / "board.png")
    assert not list(tmp_path.iterdir())
    monkeypatch.setenv("DISPLAY", ":0")
    with pytest.raises(MissingDependencyError, match=NO_RENDERING):
        show_board(board)


def test_without_a_screen_no_window_is_opened(board, monkeypatch):
    monkeypatch.setattr("coilarray.viz.scenes.has_screen", lambda: False)
    with pytest.raises(MissingDependencyError, match="needs a screen"):
        show_board(board)
