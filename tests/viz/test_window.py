"""Windows: on a virtual screen they open, their switches work, and they close; nothing is left behind."""

import html
import os
import shutil
import subprocess
import sys
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest
import pyvista
from support.patience import PATIENCE

from coilarray.viz.offscreen import NO_RENDERING
from coilarray.viz.scenes.draw import draw, text_name
from coilarray.viz.scenes.pictures import add_switches, show
from coilarray.viz.scenes.scene import Part, Scene, Text, about_zero

pytestmark = pytest.mark.slow

XVFB = shutil.which("Xvfb")
SEEN = """
import os
import pyvista
from coilarray.errors import MissingDependencyError
from coilarray.viz.scenes.pictures import show
from test_window import scene

shown = pyvista.Plotter.show

def at_once(plotter):
    # what the user would see, then a click on the second switch, then the window is closed
    shown(plotter, interactive=False, auto_close=False)
    before = plotter.screenshot(return_img=True)
    interactor = plotter.iren.interactor
    interactor.SetEventInformation(30, plotter.window_size[1] - 20 - 29 - 10, 0, 0)
    for event in ("MouseMoveEvent", "LeftButtonPressEvent", "LeftButtonReleaseEvent"):
        interactor.InvokeEvent(event)
    after = plotter.screenshot(return_img=True)
    red = [((one[..., 0] > 150) & (one[..., 1] < 80)).sum() for one in (before, after)]
    print(plotter.render_window.GetClassName(), *red)
    plotter.close()

pyvista.Plotter.show = at_once
show(scene())
# a screen that has gone since it was asked is told and not waited for
os.environ["DISPLAY"] = ":4095"
try:
    show(scene())
except MissingDependencyError as error:
    print(error)
"""


def scene():
    plate = pyvista.Box((0, 20, 0, 10, 0, 1))
    red = pyvista.Box((0, 10, 0, 10, 1, 2))
    parts = (Part("plate", plate, "plate", "#00aa00"), Part("red", red, "red", "#dd0000", lit=False))
    return Scene(parts, (Text("word", (0, 0, 0), group="red"), Text("always", (20, 0, 0))))


@pytest.fixture
def screen():
    """Environment of a virtual screen."""
    if XVFB is None:
        pytest.skip("Xvfb is not installed")
    read, write = os.pipe()
    server = subprocess.Popen(
        # -noreset: else it begins anew, deaf for a moment, whenever its last window is closed
        [XVFB, "-displayfd", str(write), "-screen", "0", "1400x900x24", "-nolisten", "tcp", "-noreset"],
        pass_fds=[write],
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    with os.fdopen(read) as pipe:
        number = pipe.readline().strip()
    environment = {k: v for k, v in os.environ.items() if k not in ("WAYLAND_DISPLAY", "VTK_DEFAULT_OPENGL_WINDOW")}
    here = os.path.dirname(__file__)
    paths = [here, os.path.dirname(here), environment.get("PYTHONPATH", "")]
    yield {**environment, "DISPLAY": f":{number}", "PYTHONPATH": os.pathsep.join(filter(None, paths))}
    server.terminate()
    server.wait(timeout=PATIENCE)


def test_a_window_opens_with_switches_that_work(screen):
    child = subprocess.run(
        [sys.executable, "-c", SEEN], env=screen, capture_output=True, text=True, timeout=5 * PATIENCE, check=False
    )
    assert child.returncode == 0, child.stderr
    seen, gone = child.stdout.splitlines()
    assert "DISPLAY=:4095 does not answer" in gone
    window, before, after = seen.split()
    assert window == "vtkXOpenGLRenderWindow"
    assert int(before) > 10_000
    assert int(after) < 1000  # the frame of the switch, which is red still


def test_a_switch_of_negative_values_has_the_colour_of_the_largest():
    scale = about_zero("delta", "δ", "", [-1.0, 0.0])
    plotter = MagicMock(window_size=(400, 300))
    add_switches(Scene((Part("plate", pyvista.Plane(), "plate", scale=scale),)), plotter)
    assert plotter.add_checkbox_button_widget.call_args.kwargs["color_on"] == scale.steps(2)[0]


@pytest.mark.usefixtures("rendering")
def test_a_switch_hides_meshes_and_words_of_its_group():
    plotter = pyvista.Plotter(off_screen=True, window_size=(400, 300))
    draw(scene(), plotter, panel=(0.2, 0.2))
    assert not [name for name in plotter.actors if name.startswith("legend")]
    switches = add_switches(scene(), plotter)
    assert list(switches) == ["plate", "red"]
    words = {text.group: f"{text_name(text)}-labels" for text in scene().texts}
    assert set(words.values()) <= set(plotter.actors)
    switches["red"](False)
    assert not plotter.actors["red"].GetVisibility()
    assert not plotter.actors[words["red"]].GetVisibility()
    assert plotter.actors["plate"].GetVisibility()
    assert plotter.actors[words[""]].GetVisibility()
    switches["red"](True)
    assert plotter.actors["red"].GetVisibility()
    plotter.close()


def test_a_notebook_shows_a_page_without_a_screen(monkeypatch):
    pytest.importorskip("trame_vtk", reason="trame-vtk is not installed")
    shown = []
    display = SimpleNamespace(HTML=str, display=shown.append)
    fake = SimpleNamespace(get_ipython=lambda: SimpleNamespace(kernel=1))
    monkeypatch.setitem(sys.modules, "IPython", fake)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    monkeypatch.setenv(NO_RENDERING, "1")
    show(Scene((Part("box", pyvista.Box(), "a <b>"),)))
    (frame,) = shown
    assert frame.startswith('<iframe srcdoc="')
    page = html.unescape(frame.partition('srcdoc="')[2].partition('" sandbox')[0])
    assert "a &lt;b&gt;" in page
    assert page.count("</html>") == 1
