"""The command ``view``: it writes what is asked for, and every mistake is one line before anything is computed."""

import sys
from pathlib import Path

import numpy as np
import pytest
import pyvista
from matplotlib.image import imread
from PIL import Image
from support.command_line import mistakes, runner, successes
from support.contacts import IDEAL

from coilarray import load_design
from coilarray.design.bundled import read
from coilarray.response.map import response_map
from coilarray.viz.offscreen import NO_RENDERING

pytestmark = pytest.mark.slow

run, refused = runner("view")
good, answer = successes("view")
LINEAR = read("starter").replace('strain = "finite"', 'strain = "linear"')  # quick
renders = pytest.mark.usefixtures("rendering")


@pytest.fixture(autouse=True)
def _no_screen(own_folder, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)


@pytest.fixture
def linear():
    """A file of the starter under small strain."""
    Path("linear.toml").write_text(LINEAR, encoding="utf-8")
    return "linear.toml"


@renders
def test_a_picture_of_what_is_asked_for(capsys):
    look = ("--from", "top", "--size", "640x360", "--show", "board", "--layers", "L1")
    assert good(capsys, "starter", "--out", "top.png", *look) == "wrote top.png\n"
    picture = imread("top.png")[..., :3]
    assert picture.shape == (360, 640, 3)
    red, green, blue = np.moveaxis(picture, -1, 0)
    assert (green > red + 0.05).mean() > 0.2  # the laminate
    assert (red > blue + 0.3).mean() > 0.01  # L1 is vermillion,
    assert (blue > red + 0.4).mean() < 1e-3  # L3, blue, is not shown
    assert [path.name for path in Path().iterdir()] == ["top.png"]


def test_a_page_and_files_for_paraview_need_no_graphics_driver(capsys, monkeypatch):
    pytest.importorskip("trame_vtk", reason="trame-vtk is not installed")
    monkeypatch.setenv(NO_RENDERING, "1")
    items = ("--show", "board,coupling,currents", "--coil", "coil1")
    assert "Black: coil1 is measured, the others as terminated" in good(capsys, "starter", *items, "--out", "page.html")
    assert Path("page.html").read_text(encoding="utf-8").count("<title>starter</title>") == 1
    said = answer(capsys, "starter", *items, "--out", "board.vtm")
    assert (said["file"], len(said["notes"])) == ("board.vtm", 1)
    copper = pyvista.read("board.vtm")["copper L1"]
    assert {"coil", "current in phase (A/A)"} <= set(copper.cell_data.keys())
    assert good(capsys, "starter", "--out", "again.vtm") == "wrote again, again.vtm\n"


@renders
def test_a_film(capsys, linear, monkeypatch):
    monkeypatch.setattr("coilarray.cli.view._FRAMES", 3)
    options = ("--depth-mm", "0.3", "--size", "160x90")
    assert good(capsys, linear, "--out", "touch.gif", *options) == "wrote touch.gif: 3 pictures, 0.25 s\n"
    with Image.open("touch.gif") as film:
        assert (film.n_frames, film.size) == (3, (160, 90))


def test_a_position_is_located_with_the_kept_table(capsys, linear, monkeypatch):
    x, y = np.linspace(-14e-3, 14e-3, 11), np.linspace(-5e-3, 5e-3, 5)
    table = response_map(load_design(linear), depths=[0.3e-3, 0.6e-3], x=x, y=y, imperfections=IDEAL)
    monkeypatch.setattr("coilarray.cli.shared.kept_table", lambda design: table)
    code, out, err = run(
        capsys, linear, "--show", "location", "--depth-mm", "0.5", "--at-mm", "2", "3", "--out", "parts.vtm"
    )
    assert (code, err) == (0, "")
    assert "found: x = " in out
    assert list(Path("parts").glob("*pin_*.vtp"))


test_mistakes_are_one_line = mistakes(
    runner("view", "starter")[1],
    (("--show", "board,fields"), "--show must be of board, elastomer, dent, plates, target, eddies, field,"),
    (("--from", "below"), "'below' is not one of 'oblique', 'top', 'front', 'right'"),
    (("--size", "big"), "--size must be as 1600x900; got 'big'"),
    (("--out", "p.txt"), "--out must end in .png, .gif, .mp4, .html, .vtm, .nc, .vtr; got p.txt"),
    (("--out", "no/p.vtm"), "cannot write no/p.vtm: there is no folder no"),
    (("--coil", "x", "--show", "field", "--out", "p.vtm"), "there is no coil 'x'"),
    (("--spacing-mm", "nan"), "--spacing-mm must be 1e-06 to 100000; got nan"),
    (("--spacing-mm", "1e-4", "--show", "map", "--out", "p.vtm"), "GB of memory; at most 1 GB is allowed"),
    (("--depth-mm", "-1"), "--depth-mm must be 1e-06 to 100000; got -1"),
    (("--out", "m.gif", "--show", "field"), "--show of a film must be dent or target; got 'field'"),
    (("--out", "m.gif", "--show", "target"), "starter has no [target]"),
    (("--out", "m.gif", "--at-mm", "0", "0"), "--at-mm is not for a film"),
    (("--out", "f.nc", "--show", "field"), "--show is not for the numbers of a field"),
    (("--z-mm", "1"), "--z-mm is not for a scene"),
    (("--show", "board", "--distance-mm", "1"), "--distance-mm is for --show target"),
    (("--distance-mm", "1"), "--distance-mm is for a design with a [target]; starter has none"),
)


@renders
def test_pictures_that_cannot_be_are_one_line(capsys):
    line = refused(capsys, "starter", "--out", "b.png", "--size", "90000x9")
    assert "sides of 1 to 6000 pixels; got 90000x9" in line
    assert list(Path().iterdir()) == []


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux has machines without a screen")
def test_a_window_without_a_screen_is_one_line(capsys, monkeypatch):
    assert "neither DISPLAY nor WAYLAND_DISPLAY is set" in refused(capsys, "starter")


@pytest.mark.parametrize("option", [(), ("--out", "b.png"), ("--out", "m.gif")])
def test_without_rendering_it_is_one_line(capsys, monkeypatch, option):
    monkeypatch.setenv(NO_RENDERING, "1")
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("coilarray.viz.scenes.design.scene_of_design", lambda *_: pytest.fail("computed"))
    assert NO_RENDERING in refused(capsys, "starter", *option)
    assert list(Path().iterdir()) == []
