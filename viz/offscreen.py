"""Can this machine render in three dimensions? Asked in a child process, because the wrong answer ends the process."""

from __future__ import annotations

import functools
import os
import signal
import subprocess
import sys
import threading

NO_RENDERING = "COILARRAY_NO_RENDERING"
"""Environment variable: 1 makes `rendering_problem` answer as on a machine that cannot render."""

_WINDOW = "VTK_DEFAULT_OPENGL_WINDOW"
_OFF_SCREEN_WINDOW = "vtkEGLRenderWindow"
_TIMEOUT = 60.0  # s; a cold start from a slow disk takes ten

_PROBE = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(64, 64))
plotter.add_mesh(pyvista.Sphere())
raise SystemExit(0 if plotter.screenshot(return_img=True).std() > 0 else "the picture is blank")
"""

_lock = threading.Lock()


def rendering_problem() -> str | None:
    """Say in one line why pictures in three dimensions cannot be made here, or None where they can.

    The first call starts a child process that renders a sphere, which takes one to three seconds; later calls answer
    from memory. It may be called from any thread, so that the probe runs beside other work. Where there is no screen
    and the user has not chosen otherwise, a successful probe also sets ``VTK_DEFAULT_OPENGL_WINDOW`` in this process,
    so that VTK renders through EGL.

    Returns
    -------
    str or None
        One line that names the system packages to install. With the environment variable
        ``COILARRAY_NO_RENDERING=1`` it is a line that names this variable, and nothing is probed.
    """
    if os.environ.get(NO_RENDERING, "") not in ("", "0"):
        return f"3-D rendering is switched off by the environment variable {NO_RENDERING}; unset it to render."
    with _lock:  # functools.cache alone would let two threads probe at the same time
        return _probe()


def has_screen() -> bool:
    """Tell whether a window can be opened: on Linux, whether ``DISPLAY`` or ``WAYLAND_DISPLAY`` is set."""
    return not sys.platform.startswith("linux") or any(os.environ.get(k) for k in ("DISPLAY", "WAYLAND_DISPLAY"))


@functools.cache
def _probe() -> str | None:
    choice = {} if has_screen() or _WINDOW in os.environ else {_WINDOW: _OFF_SCREEN_WINDOW}
    reason = _run_probe({**os.environ, **choice})
    if reason is None:
        os.environ.update(choice)
        return None
    if sys.platform.startswith("linux"):
        # libgl1 and libxrender1 are needed by the wheels of VTK before 9.4 only
        packages = "libegl1 libgl1-mesa-dri libgl1 libxrender1"
        remedy = f"install the system packages {packages} (Debian, Ubuntu: apt-get install {packages})"
    else:
        remedy = "install or update the graphics driver"
    return f"3-D rendering is not available here ({reason}); {remedy}."


def _run_probe(environment: dict[str, str]) -> str | None:
    """Render a sphere in a child process; the reason in a few words where that fails."""
    try:
        child = subprocess.run(
            [sys.executable, "-c", _PROBE],
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"a trial picture took more than {_TIMEOUT:g} s"
    except OSError as error:
        return f"no trial picture could be made: {error.strerror}"
    if child.returncode == 0:
        return None
    if child.returncode < 0:
        return f"a trial picture ended with {signal.Signals(-child.returncode).name}"
    lines = child.stderr.strip().splitlines()
    return f"a trial picture failed: {lines[-1] if lines else f'exit code {child.returncode}'}"
