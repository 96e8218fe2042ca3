"""Windows: on a virtual screen they open and close; notebooks show a page instead."""

import html
import os
import shutil
import subprocess
import sys
from types import SimpleNamespace

import pytest
import pyvista
from support.patience import PATIENCE

from coilarray.viz.offscreen import NO_RENDERING
from coilarray.viz.scenes.pictures import show
from coilarray.viz.scenes.scene import Part, Scene, Text

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
    # what the user would see, then the window is closed
    shown(plotter, interactive=False, auto_close=False)
    seen = plotter.screenshot(return_img=True)
    red = ((seen[..., 0] > 150) & (seen[..., 1] < 80)).sum()
    print(plotter.render_window.GetClassName(), red)
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


def test_a_window_opens_and_shows_the_scene(screen):
    child = subprocess.run(
        [sys.executable, "-c", SEEN], env=screen, capture_output=True, text=True, timeout=5 * PATIENCE, check=False
    )
    assert child.returncode == 0, child.stderr
    seen, gone = child.stdout.splitlines()
    assert "DISPLAY=:4095 does not answer" in gone
    window, red = seen.split()
    assert window == "vtkXOpenGLRenderWindow"
    assert int(red) > 10_000


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
