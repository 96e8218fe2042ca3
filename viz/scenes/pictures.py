"""Pictures of scenes without a window."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coilarray.compute.files import write_atomically
from coilarray.errors import MissingDependencyError, OutputError
from coilarray.geometry.array import CoilArray
from coilarray.geometry.indenter import Indenter
from coilarray.geometry.sheet import Sheet
from coilarray.viz.offscreen import rendering_problem
from coilarray.viz.scenes.board import board_scene
from coilarray.viz.scenes.camera import Side
from coilarray.viz.scenes.dent import dent_scene
from coilarray.viz.scenes.draw import draw
from coilarray.viz.scenes.scene import Scene

if TYPE_CHECKING:
    import xarray as xr

SIZE = (1600, 900)
"""Default width and height of a picture in pixels."""

# Pixels. VTK's anti-aliasing needs textures of more than twice this size, and 16384 is the limit of graphics cards and
# of Mesa. A larger picture is blank.
_LONGEST = 6000


def save_picture(scene: Scene, path: Path, *, side: Side = "oblique", size: tuple[int, int] = SIZE) -> None:
    """Render a scene off-screen into an image file.

    Parameters
    ----------
    scene : Scene
        Scene that is shown.
    path : Path
        File to write. The suffix (.png, .jpg, .bmp, .tif) sets the format. It appears only when it is complete.
    side : {"oblique", "top", "front", "right"}
        Side from which it is seen.
    size : tuple of int
        Width and height of the picture in pixels.

    Raises
    ------
    MissingDependencyError
        If this machine cannot render. The text names the system packages.
    OutputError
        If the size is not allowed, or the file cannot be written.
    """
    _save(path, size, lambda plotter: draw(scene, plotter, side=side))


def save_board_picture(
    array: CoilArray, path: Path, sheets: Sequence[Sheet] = (), size: tuple[int, int] = SIZE
) -> None:
    """Render a board off-screen into an image file.

    Parameters
    ----------
    array, sheets, path, size
        As in `board_scene` and `save_picture`.

    Raises
    ------
    MissingDependencyError, OutputError
        As `save_picture`.
    """
    _save(path, size, lambda plotter: board_scene(array, sheets, plotter=plotter))


def save_dent_picture(
    array: CoilArray,
    path: Path,
    sheets: Sequence[Sheet],
    indentation: xr.Dataset,
    indenter: Indenter,
    depth: int = -1,
    centre: tuple[float, float] = (0.0, 0.0),
    size: tuple[int, int] = SIZE,
) -> None:
    """Render a dent off-screen into an image file.

    Parameters
    ----------
    array, sheets, indentation, indenter, depth, centre, path, size
        As in `dent_scene` and `save_picture`.

    Raises
    ------
    ValueError, MissingDependencyError, OutputError
        As `dent_scene` and `save_picture`.
    """
    at: dict[str, Any] = {"depth": depth, "centre": centre}
    _save(path, size, lambda plotter: dent_scene(array, sheets, indentation, indenter, plotter=plotter, **at))


def check_rendering(size: tuple[int, int] = SIZE) -> None:
    """Refuse a picture that cannot be made here.

    It is refused before its scene is computed, with the errors of `save_picture`.
    """
    if not all(1 <= pixels <= _LONGEST for pixels in size):
        raise OutputError(f"a picture must have sides of 1 to {_LONGEST} pixels; got {size[0]}x{size[1]}.")
    problem = rendering_problem()
    if problem is not None:
        raise MissingDependencyError(problem)


@contextmanager
def off_screen(size: tuple[int, int]) -> Iterator[Any]:
    """Open a plotter without a window.

    The errors are the same as in `save_picture`.
    """
    check_rendering(size)
    from coilarray.viz.extra_3d import pyvista

    plotter: Any = pyvista.Plotter(off_screen=True, window_size=list(size))
    try:
        plotter.enable_anti_aliasing("ssaa")  # several samples per pixel, as turns are about as wide as a pixel
        yield plotter
    finally:
        plotter.close()


def _save(path: Path, size: tuple[int, int], fill: Callable[[Any], None]) -> None:
    with off_screen(size) as plotter:
        fill(plotter)
        write_atomically(path, lambda temporary: plotter.screenshot(temporary, return_img=False))
