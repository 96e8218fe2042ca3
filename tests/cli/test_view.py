"""The command ``view``: it writes what is asked for, and every mistake is one line before anything is computed."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import pyvista
from matplotlib.image import imread
from PIL import Image
from support.command_line import mistakes, runner, successes

from coilarray import load_design
from coilarray.compute.netcdf import save_dataset
from coilarray.design.bundled import read
from coilarray.localize.forward import forward_model
from coilarray.response.map import response_map
from coilarray.viz.datasets.results import DELTA
from coilarray.viz.offscreen import NO_RENDERING

pytestmark = pytest.mark.slow

_, refused = runner("view")
good, _ = successes("view")
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
    assert good(capsys, "starter", "--screenshot", "top.png", *look) == "wrote top.png\n"
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
    out = good(capsys, "starter", *items, "--html", "page.html", "--vtk", "parts")
    assert "Black: coil1 is measured, the others as terminated" in out
    assert Path("page.html").read_text(encoding="utf-8").count("<title>starter</title>") == 1
    copper = pyvista.read("parts/copper_L1.vtp")
    assert {"coil", "current in phase (A/A)"} <= set(copper.cell_data.keys())
    assert good(capsys, "starter", "--vtk", "board.vtm") == "wrote board, board.vtm\n"


@renders
def test_a_film_along_a_way(capsys, linear):
    way = ("--path-mm", "-3,0 3,1", "--depth-mm", "0.3", "--frames", "3", "--rate", "2", "--size", "160x90")
    assert good(capsys, linear, "--movie", "touch.gif", *way) == "wrote touch.gif: 3 pictures, 1.5 s\n"
    with Image.open("touch.gif") as film:
        assert (film.n_frames, film.size) == (3, (160, 90))


def test_a_map_of_a_file_is_draped(capsys, linear):
    grid = {"depths": [0.3e-3], "x": [-5e-3, 0, 5e-3], "y": [-2e-3, 2e-3]}
    response = response_map(load_design(linear), **grid, ideal=True)
    save_dataset(response, Path("map.nc"))
    items = ("--show", "response", "--response", "map.nc", "--coil", "coil1")
    out = good(capsys, linear, *items, "--vtk", "parts")
    assert out.startswith("δ of coil1 at the indenter, 0.3 mm deep.")
    mesh = pyvista.read("parts/response.vtp")
    expected = response.delta.sel(state="coil1").values.ravel()
    np.testing.assert_array_equal(np.sort(mesh.point_data[DELTA]), np.sort(expected))


def test_a_reading_is_located(capsys, linear):
    design = load_design(linear)
    x, y = np.linspace(-14e-3, 14e-3, 11), np.linspace(-5e-3, 5e-3, 5)
    table = response_map(design, depths=[0.3e-3, 0.6e-3], x=x, y=y, ideal=True)
    save_dataset(table, Path("table.nc"))
    delta = forward_model(table).delta([-2e-3, 4e-3, 0.5e-3])
    reading = ",".join(f"{name}={value!r}" for name, value in zip(design.array.names, delta.tolist(), strict=True))
    items = ("--show", "location", "--table", "table.nc", "--reading", reading, "--noise", "1e-6")
    out = good(capsys, linear, *items, "--vtk", "parts")
    assert "found: x = −2.00 ± " in out
    # one of the pins: a board that is nearly symmetric has a second place for the reading
    place = 1e3 * np.add(design.indentation.origin_point, [-2e-3, 4e-3])
    pins = [pyvista.read(path).points[0][:2] for path in Path("parts").glob("pin_*.vtp")]
    assert min(np.hypot(*(pin - place)) for pin in pins) < 0.01  # mm; the reading has no errors


test_mistakes_are_one_line = mistakes(
    runner("view", "starter")[1],
    (("--show", "board,fields"), "--show must be of board, elastomer, dent, plates, target, eddies, field,"),
    (("--from", "below"), "'below' is not one of 'oblique', 'top', 'front', 'right'"),
    (("--size", "big"), "--size must be as 1600x900; got 'big'"),
    (("--vtk", "no/p.vtm"), "cannot write no/p.vtm: there is no folder no"),
    (("--vtk", "/dev/null/p"), "cannot make the folder /dev/null: a file has that name"),
    (("--coil", "x", "--show", "field", "--vtk", "p"), "there is no coil 'x'"),
    (("--current-mA", "0"), "--current-mA must be at most 1e+09 and not 0; got 0"),
    (("--spacing-mm", "nan"), "--spacing-mm must be 1e-06 to 100000; got nan"),
    (("--spacing-mm", "1e-4", "--show", "surfaces", "--vtk", "p"), "GB of memory; at most 1 GB is allowed"),
    (("--depth-mm", "-1"), "--depth-mm must be 1e-06 to 100000; got -1"),
    (("--response", "m.nc"), "--response is for --show response"),
    (("--reading", "coil1=1"), "--reading is for --show location"),
    (("--table", "t.nc"), "--table is for --show location"),
    (("--show", "response", "--response", "m.nc"), "there is no file m.nc"),
    (("--show", "location", "--reading", "7"), "READINGS must be coil1="),
    (("--path-mm", "0,0 1,1"), "--path-mm is for --movie"),
    (("--movie", "m.gif", "--path-mm", "0,0 1,nan"), "--path-mm must be two or more points in mm"),
    (("--movie", "m.gif", "--frames", "1"), "--frames must be 2 to 1000; got 1"),
    (("--movie", "m.gif", "--show", "field"), "--show is not for --movie"),
    (("--movie", "m.gif", "--at-mm", "0", "0"), "--at-mm is not for --movie"),
    (("--movie", "m.gif", "--distance-mm", "1"), "--distance-mm is not for --movie"),
    (("--distance-mm", "1"), "--distance-mm is for a design with a [target]; starter has none"),
)


def test_what_cannot_be_written_is_refused_before_anything_is_computed(capsys, monkeypatch):
    monkeypatch.setattr("coilarray.viz.scenes.design.scene_of_design", lambda *_: pytest.fail("computed"))
    Path("taken").touch()
    assert "cannot make the folder taken: a file has that name" in refused(capsys, "starter", "--vtk", "taken")
    assert "cannot make the folder taken" in refused(capsys, "starter", "--html", "b.html", "--vtk", "taken/parts")
    assert [path.name for path in Path().iterdir()] == ["taken"]


@renders
def test_pictures_that_cannot_be_are_one_line(capsys):
    line = refused(capsys, "starter", "--screenshot", "b.png", "--size", "90000x9")
    assert "sides of 1 to 6000 pixels; got 90000x9" in line
    assert list(Path().iterdir()) == []


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux has machines without a screen")
def test_a_window_without_a_screen_is_one_line(capsys, monkeypatch):
    assert "neither DISPLAY nor WAYLAND_DISPLAY is set" in refused(capsys, "starter")


@pytest.mark.parametrize("option", [(), ("--screenshot", "b.png"), ("--movie", "m.gif")])
def test_without_rendering_it_is_one_line(capsys, monkeypatch, option):
    monkeypatch.setenv(NO_RENDERING, "1")
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("coilarray.viz.scenes.design.scene_of_design", lambda *_: pytest.fail("computed"))
    assert NO_RENDERING in refused(capsys, "starter", *option)
    assert list(Path().iterdir()) == []


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the packages are those of Linux")
def test_a_machine_without_mesa_gets_one_line():
    changed = {"VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow", "__EGL_VENDOR_LIBRARY_FILENAMES": os.devnull}
    program = [sys.executable, "-c", "from coilarray.cli.main import run; run()", "view", "starter"]
    child = subprocess.run(
        [*program, "--screenshot", "b.png"], env=os.environ | changed, capture_output=True, text=True, check=False
    )
    if child.returncode == 0:
        pytest.skip("VTK renders here without EGL, through OSMesa")
    assert child.returncode == 2
    (line,) = child.stderr.splitlines()
    assert "install the system packages libegl1 libgl1-mesa-dri" in line
    assert list(Path().iterdir()) == []
