"""Scenes: what stands in them, where it is seen, and that a picture shows it; without rendering, the one line."""

import itertools
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
import pyvista
from matplotlib.image import imread
from support.boards import SHEETS, reference_board

from coilarray.design.model import Design
from coilarray.errors import GeometryError, MissingDependencyError, OutputError
from coilarray.viz import board_scene, save_picture, show
from coilarray.viz.offscreen import NO_RENDERING
from coilarray.viz.scenes.board import CoilColours, board_in_pieces, recoloured, scene_of_board
from coilarray.viz.scenes.draw import NIGHT, bar_of, camera_of, draw, draw_parts, legend_size, legible
from coilarray.viz.scenes.scene import Part, Scale, Scene, Side, Text, about_zero, seen_from


@pytest.fixture(scope="module")
def board():
    return reference_board(count=2, turns=5)


def legend_of(plotter):
    """Texts of the legend from the top down."""
    words = [actor for name, actor in plotter.actors.items() if name.startswith("legend ") and "sign" not in name]
    return [word.GetInput() for word in sorted(words, key=lambda word: -word.GetPosition()[1])]


def test_a_scene_holds_every_part(board, plotter):
    draw(board_scene(board, SHEETS), plotter)
    expected = {"board", "barrels", "sheet base", "sheet magnetic", *(f"copper L{k}" for k in (1, 2, 3, 4))}
    assert expected <= set(plotter.actors)
    assert legend_of(plotter)[:3] == ["magnetic 2 mm", "base 6 mm", "copper L1"]


@pytest.mark.parametrize("side", get_args(Side))
def test_the_whole_scene_is_in_view(board, plotter, side):
    scene = board_scene(board, SHEETS)
    draw(scene, plotter, side=side)
    plotter.render()
    renderer = plotter.renderer
    assert plotter.camera.parallel_projection == (side in ("top", "front", "right"))
    shown = []
    for corner in corners(scene.bounds):
        renderer.SetWorldPoint(*corner, 1.0)
        renderer.WorldToDisplay()
        across, up, _ = renderer.GetDisplayPoint()
        shown.append((across / 320, up / 180))
    # VTK's own camera puts points where `seen_from` says
    camera = camera_of(scene, (320, 180), side)
    np.testing.assert_allclose(seen_from(camera, corners(scene.bounds), (320, 180)), shown, atol=1e-5)
    everything = np.concatenate([part.mesh.points for part in scene.parts] + [[text.position for text in scene.texts]])
    seen = seen_from(camera, everything, (320, 180))
    assert seen.min() > 0
    assert seen.max() < 1
    # and fills it in one direction, to the rim and to the room of the legend
    assert np.ptp(seen, axis=0).max() > 0.6


def test_bars_legend_and_notes_have_their_room():
    # as high as the picture, and without the legend wide enough to lie under it
    mesh = pyvista.Box((0, 160, 0, 100, 0, 1))
    mesh.point_data["v"] = np.arange(8.0)
    group = "a long name of a group"
    scene = Scene((Part("box", mesh, group, scale=Scale("v", "v", "V", 0, 7)),))
    seen = seen_from(camera_of(scene, (1600, 900), "top"), corners(scene.bounds), (1600, 900))
    assert seen[:, 1].min() > 90 / 900  # of the bar with its numbers and its title
    assert seen[:, 0].min() > legend_size(scene, (1600, 900))[0] > 0.1
    bare = Scene((Part("box", mesh),))
    seen = seen_from(camera_of(bare, (1600, 900), "top"), corners(bare.bounds), (1600, 900))
    np.testing.assert_allclose(seen.min(axis=0) + seen.max(axis=0), 1.0)  # in the middle
    high = Scene((Part("box", pyvista.Box((0, 10, 0, 100, 0, 1))),), notes=("one", "two", "three"))
    low = seen_from(camera_of(high, (1600, 900), "top"), corners(high.bounds), (1600, 900))[:, 1].min()
    assert low > (0.025 * 900 + 3 * 17.5) / 900  # of three lines of 17.5 pixels above a rim of 0.025
    silent = replace(high, notes=())
    seen = seen_from(camera_of(silent, (1600, 900), "top"), corners(high.bounds), (1600, 900))
    np.testing.assert_allclose(seen.min(axis=0) + seen.max(axis=0), 1.0)  # in the middle


def corners(bounds):
    return np.array(list(itertools.product(*np.reshape(bounds, (3, 2)))))


def box(**placed):
    return pyvista.Box((0.0, 1.0, 0.0, 1.0, 0.0, placed.get("top", 1.0)))


def test_a_sum_of_scenes_has_all_of_both():
    text = Text("word", (0.0, 0.0, 9.0))
    first = Scene((Part("a", box(), "one", "#111111"),), notes=("same", "first"))
    second = Scene((Part("b", box(top=5.0), "two", "#222222"), Part("c", box())), (text,), ("same",))
    both = first + second
    assert [part.name for part in both.parts] == ["a", "b", "c"]
    assert both.groups == {"one": ("#111111",), "two": ("#222222",)}
    assert both.notes == ("same", "first")
    assert both.bounds == (0, 1, 0, 1, 0, 9)
    with pytest.raises(ValueError, match="different names; both have a"):
        both + first
    with pytest.raises(ValueError, match="at least one part"):
        _ = Scene().bounds


def test_colours_of_scales():
    linear = Scale("v", "v", "V", -1.0, 1.0, "coolwarm", missing="#123456")
    low, middle, high, beyond, nothing = linear.colours_of([-1, 0, 1, 7, np.nan]).tolist()
    assert nothing == [0x12, 0x34, 0x56]
    assert beyond == high
    assert low[2] > low[0]  # blue is below,
    assert high[0] > high[2]  # red above
    assert max(middle) - min(middle) < 5  # grey
    decades = Scale("v", "v", "V", 1e-6, 1e-4, logarithmic=True)
    equal = Scale("v", "v", "V", 0.0, 2.0)
    np.testing.assert_array_equal(decades.colours_of([1e-6, 1e-5, 1e-4]), equal.colours_of([0, 1, 2]))
    assert linear.steps(2) == tuple("#" + bytes(colour).hex() for colour in (low, high))
    np.testing.assert_allclose(decades.values(3), [1e-6, 1e-5, 1e-4])
    for values, ends in (
        ([0.1, -0.29, np.nan], (-0.3, 0.3)),
        ([0.00146, -0.00001], (0.0, 0.0015)),
        ([-0.2, np.nan], (-0.2, 0.0)),
    ):
        ranged = about_zero("v", "v", "", values)  # values of one sign have all the colours
        assert (ranged.low, ranged.high) == ends
    assert about_zero("v", "v", "", [np.nan]).high == about_zero("v", "v", "", [0.0]).high == 1.0


@pytest.mark.parametrize("largest", [1.0, 1.46e-3, 2.2, 3.1e-6, 0.45, 59.0, 7.7, 9.9e4])
def test_colour_bars_have_round_numbers_at_equal_steps(largest):
    for values in ([largest], [largest, -largest / 2]):
        scale = about_zero("v", "v", "V", values)
        ticks = scale.ticks
        np.testing.assert_allclose(np.diff(ticks), (scale.high - scale.low) / (len(ticks) - 1))
        step = float(f"{np.diff(ticks)[0]:.4e}".split("e")[0])
        assert min(abs(step - nice) for nice in (1, 1.5, 2, 2.5, 3, 4, 5, 6, 8)) < 1e-3
        assert 3 <= len(ticks) <= 6
        assert largest <= scale.high <= 1.5 * largest
        assert min(abs(ticks)) < 1e-9 * largest
    decades = Scale("v", "v", "T", 1e-8, 1e-6, logarithmic=True)
    title, _, numbers = bar_of(decades, 4)
    assert (title, numbers) == ("v (nT), log", ["10", "100", "1e+03"]) or numbers == ["0.01", "0.1", "1"]
    assert bar_of(about_zero("v", "v", "", [-2.0, 1.0]), 3)[2][0] == "−2"


def test_texts_stand_on_no_others():
    scene = Scene((Part("box", pyvista.Box((0, 100, 0, 50, 0, 1))),))
    camera = camera_of(scene, (1600, 900), "top")
    near = [Text("coil1", (50, 25, 0), 24, bold=True), Text("10", (50.5, 25, 0)), Text("20", (90, 25, 0))]
    kept = legible([near[1], *near[:1], near[2]], camera, (1600, 900))
    assert {text.text for text in kept} == {"coil1", "20"}


def test_layers_can_be_chosen_and_coils_can_have_colours_of_their_own(board):
    names = [part.name for part in scene_of_board(board, layers=["L2", "L3"]).parts]
    assert [name for name in names if name.startswith("copper")] == ["copper L2", "copper L3"]
    with pytest.raises(GeometryError, match="no copper layer 'L7'; there are L1, L2, L3, L4"):
        scene_of_board(board, layers=["L7"])
    colours = CoilColours(np.array([-1.0, 1.0]), Scale("v (V)", "v", "V", -1, 1, "coolwarm"))
    copper, rest = board_in_pieces(Design(board).placed)
    coloured = recoloured(copper, colours)
    for part in coloured:
        np.testing.assert_array_equal(part.mesh.cell_data["v (V)"], colours.values[part.mesh.cell_data["coil"]])
    assert (Scene(coloured) + rest).scales == (colours.scale,)
    assert "v (V)" not in copper[0].mesh.cell_data


def test_every_part_and_bar_is_drawn(board, plotter):
    mesh = box()
    mesh.cell_data["v"] = np.arange(6.0)
    scene = scene_of_board(board) + Scene(
        (Part("six", mesh, "sides", scale=Scale("v", "volts", "V", 0, 5)),), notes=("said",)
    )
    draw(scene, plotter)
    assert {part.name for part in scene.parts} <= set(plotter.actors)
    assert [name for name in plotter.actors if name.startswith("bar ")] == ["bar volts (V)"]
    assert legend_of(plotter) == list(scene.groups)
    assert scene.groups["sides"] == scene.scales[0].steps(3)  # its sign has the colours of its bar, not one of its own
    # drawn again it replaces what has the same name
    before = len(plotter.actors)
    draw_parts(scene, plotter)
    assert len(plotter.actors) == before


def test_colours_of_a_part_are_those_of_its_scale(plotter):
    mesh = pyvista.Plane(i_size=10, j_size=10, i_resolution=1, j_resolution=1)
    mesh.cell_data["v"] = [0.25]
    scale = Scale("v", "v", "V", 0, 1)
    draw(Scene((Part("sheet", mesh, scale=scale, lit=False),)), plotter, side="top")
    middle = plotter.screenshot(return_img=True)[90, 130]
    assert np.abs(middle.astype(int) - scale.colours_of([0.25])[0]).max() <= 1  # rounding of 8 bits


def test_a_picture_has_its_size_and_shows_copper(board, plotter, tmp_path):
    path = tmp_path / "board.png"
    save_picture(board_scene(board, SHEETS), path, size=(400, 225))
    picture = imread(path)[..., :3]
    assert picture.shape == (225, 400, 3)
    red, green, blue = np.moveaxis(picture, -1, 0)
    assert (green > red + 0.05).mean() > 0.03  # the laminate
    assert (red > blue + 0.2).sum() > 50  # copper of the upper layers
    assert (picture.min(axis=-1) > 0.99).mean() > 0.1  # white paper around it
    assert (np.ptp(picture, axis=-1) > 0.05).mean() > 0.25  # of it board and sheets
    save_picture(board_scene(board), tmp_path / "board.png", size=(400, 225), dark=True)
    corner = imread(path)[0, 0, :3]
    np.testing.assert_allclose(corner, pyvista.Color(NIGHT).float_rgb, atol=0.01)
    assert [entry.name for entry in tmp_path.iterdir()] == ["board.png"]


def test_pictures_that_cannot_be_are_refused_in_one_line(board, tmp_path, monkeypatch):
    for size in ((0, 100), (100, 100_000)):
        with pytest.raises(OutputError, match="sides of 1 to 6000 pixels"):
            save_picture(board_scene(board), tmp_path / "board.png", size=size)
    assert not list(tmp_path.iterdir())
    monkeypatch.setenv(NO_RENDERING, "1")
    with pytest.raises(MissingDependencyError, match=NO_RENDERING):
        save_picture(board_scene(board), tmp_path / "board.png")
    assert not list(tmp_path.iterdir())
    monkeypatch.setenv("DISPLAY", ":0")
    with pytest.raises(MissingDependencyError, match=NO_RENDERING):
        show(board_scene(board))


@pytest.mark.parametrize("size", [(6000, 60), (60, 6000)])
def test_the_longest_pictures_are_not_blank(size, plotter, tmp_path):
    """VTK only complains, and leaves all white, where a graphics card's textures are too small."""
    sheet = Scene((Part("sheet", pyvista.Plane(i_size=10, j_size=10), colour="red", lit=False),))
    save_picture(sheet, tmp_path / "long.png", side="top", size=size)
    assert imread(tmp_path / "long.png").shape[:2] == size[::-1]
    assert (imread(tmp_path / "long.png")[..., 1] < 0.5).any()
