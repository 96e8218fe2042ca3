"""Test in a child process whether this machine can render."""

from __future__ import annotations

import functools
import importlib.util
import os
import signal
import subprocess
import sys
import threading
from typing import NamedTuple

from coilarray.compute.extras import not_installed
from coilarray.errors import MissingDependencyError

NO_RENDERING = "COILARRAY_NO_RENDERING"
"""Environment variable that makes `rendering_problem` report a problem if 1."""

_WINDOW = "VTK_DEFAULT_OPENGL_WINDOW"
_OFF_SCREEN_WINDOW = "vtkEGLRenderWindow"
_WITHOUT_SCREEN = ("EGL", "OSOpenGL", "OSMesa")  # in the class names of VTK's render windows without a screen
_TIMEOUT = 60.0  # s, as a cold start from a slow disk takes ten
_INSTEAD = "write a picture, film, page or VTK files instead"

# The same as PyVista does, without loading it, which takes longer.
_PROBE = """
import vtkmodules.vtkRenderingOpenGL2
from vtkmodules.vtkFiltersSources import vtkSphereSource
from vtkmodules.vtkRenderingCore import (
    vtkActor, vtkPolyDataMapper, vtkRenderer, vtkRenderWindow, vtkWindowToImageFilter,
)
sphere, mapper, actor = vtkSphereSource(), vtkPolyDataMapper(), vtkActor()
mapper.SetInputConnection(sphere.GetOutputPort())
actor.SetMapper(mapper)
renderer, window, picture = vtkRenderer(), vtkRenderWindow(), vtkWindowToImageFilter()
renderer.AddActor(actor)
window.SetOffScreenRendering(True)
window.SetSize(64, 64)
window.AddRenderer(renderer)
picture.SetInput(window)
picture.Update()
low, high = picture.GetOutput().GetScalarRange()
if low == high:
    raise SystemExit("the picture is blank")
print(window.GetClassName())
"""

_lock = threading.Lock()


def rendering_problem() -> str | None:
    """Explain in a line why 3-D pictures are impossible, or None.

    The line names the packages to install. The first call starts a child process that renders a
    sphere, which takes about a second. Later calls, from any thread, return the same result at
    once. If no screen answers and the user has not chosen otherwise, a successful test also sets
    ``VTK_DEFAULT_OPENGL_WINDOW`` in this process, so that VTK renders through EGL. With the
    environment variable ``COILARRAY_NO_RENDERING=1`` the line names this variable, and nothing is
    tested.
    """
    return switched_off() or _answer().problem


def switched_off() -> str | None:
    """Explain that the environment forbids rendering, or None."""
    if os.environ.get(NO_RENDERING, "") in ("", "0"):
        return None
    return f"3-D rendering is switched off by the environment variable {NO_RENDERING}; unset it to render."


def window_problem() -> str | None:
    """Explain in one line why no window can be opened, or None."""
    if missing := _missing("windows"):
        return missing
    if not has_screen():
        return f"a window needs a screen, and neither DISPLAY nor WAYLAND_DISPLAY is set; {_INSTEAD}."
    problem = rendering_problem()
    if problem is not None:
        return problem
    answer = _answer()
    if not without_screen(answer.window):
        return None
    if answer.chosen == answer.window:
        return f"a window needs a screen, and {_WINDOW}={answer.chosen} renders without one; unset it, or {_INSTEAD}."
    return silent_screen()


def silent_screen() -> str:
    """Explain in one line that the screen does not answer."""
    screen = os.environ.get("DISPLAY")
    which = "there is no X server (DISPLAY is not set)" if screen is None else f"DISPLAY={screen} does not answer"
    return f"a window needs a screen, and {which}; {_INSTEAD}."


def without_screen(window: str) -> bool:
    """Check if a class of VTK's windows has no screen."""
    return any(word in window for word in _WITHOUT_SCREEN)


def has_screen() -> bool:
    """Check if the environment names a screen, on Linux."""
    return not sys.platform.startswith("linux") or any(os.environ.get(k) for k in ("DISPLAY", "WAYLAND_DISPLAY"))


class _Answer(NamedTuple):
    """Result of the test."""

    problem: str | None
    window: str = ""
    chosen: str | None = None


def _answer() -> _Answer:
    with _lock:  # functools.cache alone would let two threads probe at the same time
        return _probe()


def require_pyvista(purpose: str, extra: str = "3d") -> None:
    """Raise MissingDependencyError without PyVista, before anything is computed."""
    if missing := _missing(purpose, extra):
        raise MissingDependencyError(missing)


def _missing(purpose: str = "pictures in three dimensions", extra: str = "3d") -> str:
    there = all(map(importlib.util.find_spec, ("pyvista", "vtkmodules")))
    return "" if there else not_installed(purpose, "PyVista", extra)


@functools.cache
def _probe() -> _Answer:
    """Test rendering, and set the window that works."""
    if missing := _missing():
        return _Answer(missing)
    choice = {} if has_screen() or _WINDOW in os.environ else {_WINDOW: _OFF_SCREEN_WINDOW}
    answer = _run_probe({**os.environ, **choice})
    if answer.problem is None:
        if answer.window == _OFF_SCREEN_WINDOW:
            # Also if a named screen does not answer. VTK would try it first and complain each time.
            choice = {} if _WINDOW in os.environ else {_WINDOW: _OFF_SCREEN_WINDOW}
        chosen = os.environ.get(_WINDOW)
        os.environ.update(choice)
        return answer._replace(chosen=chosen)
    if sys.platform.startswith("linux"):
        # Only the wheels of VTK before 9.4 need libgl1 and libxrender1.
        packages = "libegl1 libgl1-mesa-dri libgl1 libxrender1"
        remedy = f"install the system packages {packages} (Debian, Ubuntu: apt-get install {packages})"
    else:
        remedy = "install or update the graphics driver"
    return _Answer(f"3-D rendering is not available here ({answer.problem}); {remedy}.")


def _run_probe(environment: dict[str, str]) -> _Answer:
    """Render a sphere in a child process."""
    try:
        child = subprocess.run(
            [sys.executable, "-P", "-c", _PROBE],  # without the working folder
            env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True,
            errors="replace", timeout=_TIMEOUT, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return _Answer(f"a trial picture took more than {_TIMEOUT:g} s")
    except OSError as error:
        return _Answer(f"no trial picture could be made: {error.strerror}")
    if child.returncode == 0:
        lines = child.stdout.split()
        return _Answer(None, lines[-1] if lines else "")
    if child.returncode < 0:
        return _Answer(f"a trial picture ended with {signal.Signals(-child.returncode).name}")
    lines = child.stderr.strip().splitlines()
    return _Answer(f"a trial picture failed: {lines[-1] if lines else f'exit code {child.returncode}'}")
