"""Whether the answer about rendering is right, cheap to ask again, and never fatal."""

import importlib.util
import os
import subprocess
import sys

import pytest

import coilarray as ca
from coilarray import viz
from coilarray.errors import MissingDependencyError
from coilarray.viz import offscreen

EGL = "vtkEGLRenderWindow"
WORKS = offscreen._Answer(None, EGL)
ASK = "from coilarray.viz import rendering_problem; print(rendering_problem())"


@pytest.fixture
def fresh(monkeypatch):
    """A process that has not probed yet, with no screen and no choice of the user."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "VTK_DEFAULT_OPENGL_WINDOW", offscreen.NO_RENDERING):
        monkeypatch.setenv(name, "")  # so that what a probe sets is taken back
        monkeypatch.delenv(name)
    offscreen._probe.cache_clear()
    yield monkeypatch
    offscreen._probe.cache_clear()


def test_the_environment_variable_switches_rendering_off_without_a_probe(fresh):
    fresh.setattr(offscreen, "_run_probe", lambda environment: pytest.fail("probed"))
    fresh.setenv(offscreen.NO_RENDERING, "1")
    problem = offscreen.rendering_problem()
    assert problem is not None
    assert offscreen.NO_RENDERING in problem


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the packages are those of Linux")
def test_a_machine_without_drivers_gets_one_line_that_names_the_packages():
    # the EGL dispatcher finds no vendor's driver: what it does on a machine without Mesa
    bare = {
        **{k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", offscreen.NO_RENDERING)},
        "VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow",
        "__EGL_VENDOR_LIBRARY_FILENAMES": os.devnull,
    }
    child = subprocess.run([sys.executable, "-c", ASK], env=bare, capture_output=True, text=True, check=True)
    if child.stdout.strip() == "None":
        pytest.skip("VTK renders here without EGL, through OSMesa")
    assert "apt-get install libegl1 libgl1-mesa-dri" in child.stdout
    assert len(child.stdout.splitlines()) == 1


@pytest.mark.parametrize("missing", ["pyvista", "vtkmodules"])
def test_without_pyvista_one_line_says_so_and_nothing_is_tried(fresh, missing):
    fresh.setattr(offscreen, "_run_probe", lambda environment: pytest.fail("probed"))
    fresh.setattr(importlib.util, "find_spec", lambda name: None if name == missing else name)
    for problem, what in (
        (offscreen.rendering_problem(), "pictures in three dimensions"),
        (offscreen.window_problem(), "windows"),  # and not that there is no screen
    ):
        assert problem.startswith(f"{what} need PyVista, which is not installed: ")
        assert problem.endswith('[3d]".')


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux has machines without a screen")
@pytest.mark.parametrize(
    ("before", "works", "after"), [(None, True, EGL), (None, False, None), ("vtkOSOpenGLRenderWindow", True, None)]
)
def test_without_a_screen_a_working_probe_chooses_egl_here_too_unless_the_user_has_chosen(fresh, before, works, after):
    if before is not None:
        fresh.setenv("VTK_DEFAULT_OPENGL_WINDOW", before)
    tried = []
    answer = WORKS if works else offscreen._Answer("no")
    fresh.setattr(offscreen, "_run_probe", lambda environment: tried.append(environment) or answer)
    offscreen.rendering_problem()
    assert tried[0]["VTK_DEFAULT_OPENGL_WINDOW"] == (before or EGL)
    assert os.environ.get("VTK_DEFAULT_OPENGL_WINDOW") == (before or after)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux has machines without a screen")
@pytest.mark.parametrize(
    ("display", "wayland", "window", "chosen", "told"),
    [
        (None, None, EGL, None, "neither DISPLAY nor WAYLAND_DISPLAY is set"),
        (None, "wayland-0", EGL, None, "there is no X server (DISPLAY is not set)"),
        (":7", None, EGL, None, "DISPLAY=:7 does not answer"),
        (":7", None, "vtkOSOpenGLRenderWindow", None, "DISPLAY=:7 does not answer"),
        (":7", None, EGL, EGL, "VTK_DEFAULT_OPENGL_WINDOW=vtkEGLRenderWindow renders without"),
        (":7", None, "vtkXOpenGLRenderWindow", None, None),
    ],
)
def test_a_window_needs_a_screen_that_answers(fresh, display, wayland, window, chosen, told):
    for name, value in (("VTK_DEFAULT_OPENGL_WINDOW", chosen), ("DISPLAY", display), ("WAYLAND_DISPLAY", wayland)):
        if value is not None:
            fresh.setenv(name, value)
    fresh.setattr(offscreen, "_run_probe", lambda environment: offscreen._Answer(None, window))
    problem = offscreen.window_problem()
    assert (told is None) == (problem is None)
    assert told is None or told in problem
    assert offscreen.window_problem() == problem


@pytest.mark.slow
@pytest.mark.usefixtures("rendering")
def test_a_screen_that_does_not_answer_is_gone_round(fresh):
    # VTK falls back to EGL with a warning each time, unless it is told to begin with it
    code = """
from coilarray.viz import offscreen
assert offscreen.rendering_problem() is None
print(offscreen.window_problem())
exec(offscreen._PROBE)  # a picture in this process
"""
    environment = {**os.environ, "DISPLAY": ":4095"}
    environment.pop("VTK_DEFAULT_OPENGL_WINDOW", None)
    child = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert "DISPLAY=:4095 does not answer" in child.stdout
    assert child.stderr == ""


def test_importing_the_package_loads_neither_vtk_nor_matplotlib_and_every_name_is_there():
    code = "import sys, coilarray.viz as v; print([m for m in sys.modules if m.split('.')[0] in %r])"
    heavy = ("vtk", "vtkmodules", "pyvista", "matplotlib")
    child = subprocess.run([sys.executable, "-c", code % (heavy,)], capture_output=True, text=True, check=True)
    assert child.stdout.strip() == "[]"
    import coilarray.viz as viz

    assert all(callable(getattr(viz, name)) for name in viz.__all__)
    with pytest.raises(AttributeError, match=r"No coilarray\.viz attribute plot_nothing"):
        getattr(viz, "plot_" + "nothing")


def test_scenes_without_pyvista_say_which_extra_brings_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)  # as if it were not installed
    monkeypatch.delitem(sys.modules, "coilarray.viz.extra_3d", raising=False)
    with pytest.raises(MissingDependencyError, match=r"^pictures in three dimensions need PyVista, .*\[3d\]\"\.$"):
        viz.scene_of_design(ca.load_design("starter"))
