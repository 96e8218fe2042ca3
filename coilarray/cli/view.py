"""``coilarray view``."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.cli.maps import kept_table, read_map
from coilarray.cli.readings import read_readings
from coilarray.errors import GeometryError, LocalizeError, OutputError
from coilarray.viz.offscreen import require_pyvista

if TYPE_CHECKING:
    from coilarray.cli.readings import Reading
    from coilarray.design.model import Design
    from coilarray.viz.scenes.design import Item, View
    from coilarray.viz.scenes.scene import Scene, Side

_LARGEST_MA = 1e9
_SIZE = re.compile(r"(\d{1,6})x(\d{1,6})")


def _length(name: str, text: str) -> Any:
    return shared.number_option((name,), shared.SMALLEST_MM, shared.LONGEST_MM, text)


def _file(name: str, text: str, *suffixes: str) -> Any:
    return shared.file_option((f"--{name}",), text, suffixes)


def view(
    design: shared.DesignArgument = None,
    show: Annotated[
        str | None,
        typer.Option(
            help="Items to show, separated by commas: board, elastomer (the sheets, lifted off the board), dent, "
            "plates, target (on a page with a slider for its distance), eddies (eddy currents in plates and "
            "target), field (B on planes, with arrows), lines (of B), surfaces (of equal B), currents (of the "
            "passive coils), coupling, response, location. By default the board, with its plates and target."
        ),
    ] = None,
    screenshot: Annotated[Path | None, _file("screenshot", "Write a picture: .png.", ".png")] = None,
    movie: Annotated[
        Path | None, _file("movie", "Write a film of the indenter moving over the board: .gif or .mp4.", ".gif", ".mp4")
    ] = None,
    html: Annotated[
        Path | None,
        _file("html", "Write a page on which the scene can be turned in a browser, without a network: .html.", ".html"),
    ] = None,
    vtk: Annotated[
        Path | None, typer.Option(help="Write for ParaView: .vtm, or a folder with a file for each part.")
    ] = None,
    side: Annotated[
        Literal["oblique", "top", "front", "right"], typer.Option("--from", help="Side from which the scene is seen.")
    ] = "oblique",
    size: Annotated[
        str | None, typer.Option(help="Pixels of picture and film; 1600x900 and 960x540 by default.")
    ] = None,
    layers: Annotated[str | None, typer.Option(help="Copper layers shown, as L1,L3; all by default.")] = None,
    coil: Annotated[str | None, typer.Option(help="The measured coil; the middle one by default.")] = None,
    others_open: shared.OthersOpen = False,
    current_mA: Annotated[
        float, typer.Option("--current-mA", help="Current in the measured coil, for the field.")
    ] = 1.0,
    spacing_mm: Annotated[
        float | None, _length("--spacing-mm", "Spacing of the points of B; 0.5 on planes and 1 in a box by default.")
    ] = None,
    at_mm: Annotated[
        tuple[float, float] | None,
        typer.Option(
            help="x and y of indenter or target on the board; by default off the middle of the board, or at the coil."
        ),
    ] = None,
    distance_mm: Annotated[
        float | None, _length("--distance-mm", "Distance of the target; the smallest of the design by default.")
    ] = None,
    depth_mm: Annotated[
        float | None, _length("--depth-mm", "Depth of the dent; the largest of the design by default.")
    ] = None,
    response: Annotated[Path | None, typer.Option(help="Response to show (.nc); computed by default.")] = None,
    reading: Annotated[
        str | None,
        typer.Option(help="δ from which to find a position, as coil1=7.1e-4,...; that of the indenter by default."),
    ] = None,
    noise: shared.Noise = None,
    table: shared.TableFile = None,
    path_mm: Annotated[
        str | None,
        typer.Option(help='Path of the film on the board, as "X,Y X,Y ..."; along x over the middle coil by default.'),
    ] = None,
    frames: Annotated[int, shared.number_option(("--frames",), 2, 1000, "Number of pictures of the film.")] = 48,
    rate: Annotated[float, typer.Option(help="Pictures of the film per second.")] = 12.0,
    force: shared.Force = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Show a design in three dimensions.

    Opens a window, or writes a picture, a film, a page or files for ParaView. B is in phase with the current, in free
    space or beside infinite plates; the target that is shown with it is one of them, at one distance.

    Example: coilarray view gast2020 --screenshot board.png

    Example: coilarray view gast2020 --show board,field,lines --coil coil3 --html field.html

    Example: coilarray view gast2020 --movie touch.gif
    """
    wanted = _Outputs(screenshot, movie, html, vtk, side, _pixels(size), rate)
    _check_vtk(vtk)
    items = () if show is None else _items(show)
    for option, given, needed in (
        ("--response", response, "response"), ("--reading", reading, "location"), ("--table", table, "location"),
        ("--distance-mm", distance_mm, "target"),
    ):  # fmt: skip
        if given is not None and needed not in (items or (needed,) * (needed == "target")):
            raise OutputError(f"{option} is for --show {needed}.")
    if movie is None and path_mm is not None:
        raise OutputError("--path-mm is for --movie.")
    if movie is not None and not wanted.still:
        for option, changed in (
            ("--show", show is not None), ("--layers", layers is not None), ("--coil", coil is not None),
            ("--others-open", others_open), ("--spacing-mm", spacing_mm is not None), ("--at-mm", at_mm is not None),
            ("--distance-mm", distance_mm is not None),
        ):  # fmt: skip
            if changed:
                raise OutputError(f"{option} is not for --movie: a film shows the dent and δ of all coils.")
    corners = None if path_mm is None else _way(path_mm)
    depth, spacing, distance = (
        None if length is None else length * 1e-3 for length in (depth_mm, spacing_mm, distance_mm)
    )
    if not 0 < abs(current_mA) <= _LARGEST_MA:
        raise GeometryError(f"--current-mA must be at most {_LARGEST_MA:g} and not 0; got {current_mA:g}.")
    located = None if reading is None else _reading(reading)
    draped = None if response is None else read_map(response)
    from coilarray.viz.scenes.design import View, board_and_metal

    opened = shared.open_design(design, allow_violations=allow_violations)
    items = items or board_and_metal(opened)
    if distance_mm is not None and "target" not in items:
        raise OutputError(f"--distance-mm is for a design with a [target]; {opened.name} has none.")
    wanted.check()
    if movie is None or wanted.still:
        asked = View(
            show=items, layers=None if layers is None else tuple(name.strip() for name in layers.split(",")),
            coil=coil, others_open=others_open, current=current_mA * 1e-3, spacing=spacing,
            at=None if at_mm is None else (at_mm[0] * 1e-3, at_mm[1] * 1e-3), depth=depth, distance=distance,
            response=draped, table=kept_table(opened, table) if "location" in items else None, reading=located,
            noise=noise,
        )  # fmt: skip
        wanted.show(_scene(opened, asked), opened.name)
    if movie is not None:
        wanted.film(opened, corners, frames, depth)


@dataclass(frozen=True)
class _Outputs:
    """Files to write (none: a window), and the view of the scene."""

    screenshot: Path | None
    movie: Path | None
    html: Path | None
    vtk: Path | None
    side: Side
    pixels: dict[str, tuple[int, int]]
    rate: float

    @property
    def still(self) -> bool:
        """True if a file of a single scene is wanted."""
        return any(path is not None for path in (self.screenshot, self.html, self.vtk))

    def check(self) -> None:
        """Refuse before a long computation what this machine cannot show."""
        from coilarray.viz.scenes.page import check_page
        from coilarray.viz.scenes.pictures import check_movie, check_rendering, check_window

        if self.html is not None:
            check_page()
        if self.screenshot is not None:
            check_rendering(**self.pixels)
        if self.movie is not None:
            check_movie(self.movie, rate=self.rate, **self.pixels)
        elif not self.still:
            check_window()

    def show(self, scene: Scene, name: str) -> None:
        """Write the files of a scene, or show it in a window."""
        for note in scene.notes:
            typer.echo(note)
        if self.screenshot is not None:
            viz.save_picture(scene, self.screenshot, side=self.side, **self.pixels)
            typer.echo(f"wrote {self.screenshot}")
        if self.html is not None:
            viz.save_page(scene, self.html, title=name, side=self.side)
            typer.echo(f"wrote {self.html}")
        if self.vtk is not None:
            typer.echo(f"wrote {', '.join(str(path) for path in viz.save_vtk(scene, self.vtk))}")
        if not self.still:
            viz.show(scene, side=self.side)

    def film(self, design: Design, corners: list[tuple[float, float]] | None, frames: int, depth: float | None) -> None:
        """Write the film of an indenter that moves over the board."""
        from coilarray.viz.scenes.touch import touch_along

        path = cast("Path", self.movie)
        with shared.progress_bar("response") as progress:
            touch = touch_along(design, corners, count=frames, depth=depth, progress=progress)
        with shared.progress_bar("film") as progress:

            def counted() -> Iterator[Scene]:
                for done, scene in enumerate(touch.scenes(), start=1):
                    yield scene
                    progress(done, frames)

            viz.save_movie(touch.board(), counted(), path, side=self.side, rate=self.rate, **self.pixels)
        typer.echo(f"wrote {path}: {frames} pictures, {frames / self.rate:.3g} s")


def _check_vtk(path: Path | None) -> None:
    """Refuse before a long computation a file .vtm, or a folder, that could not be written after it."""
    if path is not None:
        require_pyvista("files for ParaView")
    if path is None or path.suffix.lower() == ".vtm":
        shared.check_file("--vtk", path, None)
        return
    try:
        there = next(folder for folder in (path, *path.parents) if folder.exists())  # at last . or /
    except OSError as error:
        raise OutputError(f"cannot make the folder {path}: {error.strerror}.") from None
    if not there.is_dir():
        raise OutputError(f"cannot make the folder {there}: a file has that name.")
    if not os.access(there, os.W_OK):
        raise OutputError(f"cannot write {path}: the folder {there} is not writable.")


def _items(text: str) -> tuple[Item, ...]:
    from coilarray.viz.scenes.design import ITEMS

    named = [name.strip() for name in text.split(",")]
    for name in named:
        if name not in ITEMS:
            raise OutputError(f"--show must be of {', '.join(ITEMS)}; got {name!r}.")
    return tuple(item for item in ITEMS if item in named)


def _scene(design: Design, view: View) -> Scene:
    """Compute a scene, with a progress bar for each part."""
    from coilarray.viz.scenes.design import scene_of_design

    with ExitStack() as bar:

        def track(text: str) -> Any:
            bar.close()  # of the work before
            return bar.enter_context(shared.progress_bar(text))

        return scene_of_design(design, view, track)


def _pixels(text: str | None) -> dict[str, tuple[int, int]]:
    """Return width and height as the argument ``size``; nothing by default."""
    if text is None:
        return {}
    match = _SIZE.fullmatch(text)
    if match is None:
        raise OutputError(f"--size must be as 1600x900; got {text!r}.")
    return {"size": (int(match[1]), int(match[2]))}


def _way(text: str) -> list[tuple[float, float]]:
    """Return corners in m from X,Y X,Y ... in mm."""
    try:
        corners = [(float(x) * 1e-3, float(y) * 1e-3) for x, y in (part.split(",") for part in text.split())]
    except ValueError:
        corners = []
    if len(corners) < 2 or not all(abs(value) <= shared.LONGEST_MM * 1e-3 for corner in corners for value in corner):
        raise GeometryError(f'--path-mm must be two or more points in mm, as "-20,0 20,0"; got {text!r}.')
    return corners


def _reading(text: str) -> Reading:
    """Return a reading given as δ by coil, or as a file with a single reading."""
    found = read_readings(text)
    if len(found) != 1:
        raise LocalizeError(f"--reading must be one reading; {text} has {len(found)}.")
    (one,) = found
    if isinstance(one, LocalizeError):
        raise one
    return one
