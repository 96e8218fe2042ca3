"""``coilarray view`` and ``coilarray studio``."""

from __future__ import annotations

import math
import re
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.cli.board.live import LiveOptions, watch_board
from coilarray.cli.board.options import EMULATOR, BoardOptions, SettingsFile, WiringName
from coilarray.compute.files import write_text
from coilarray.compute.threads import Progress
from coilarray.errors import GeometryError, NetworkError, OutputError
from coilarray.viz.offscreen import require_pyvista

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.design.model import Design
    from coilarray.viz.scenes.design import Item, Touch
    from coilarray.viz.scenes.scene import Scene, Side
    from coilarray.viz.studio.services import Document, Summary


Kind = Literal["window", "picture", "film", "page", "parts", "field"]
_KINDS: dict[str, Kind] = {
    ".png": "picture", ".gif": "film", ".mp4": "film", ".html": "page", ".vtm": "parts",
    ".nc": "field", ".vtr": "field",
}  # fmt: skip
_SIZE = re.compile(r"(\d{1,6})x(\d{1,6})")
_FRAMES, _RATE = 48, 12.0  # pictures of a film, and pictures per second
_SPACING_MM = 0.5  # of points of the field
_MOST_POINTS = 20_000_000  # 24 bytes a point and array; more needs more memory than a desk computer has to spare
_NOT_OF_FIELDS = {"--show", "--from", "--size", "--layers", "--at-mm", "--depth-mm"}
_NOT_OF_FILMS = {"--layers", "--coil", "--spacing-mm", "--at-mm", "--z-mm"}
_LONGEST = 86_400.0  # s


def _length(name: str, text: str) -> Any:
    return shared.number_option(name, shared.SMALLEST_MM, shared.LONGEST_MM, text)


def view(
    design: shared.DesignArgument = None,
    show: Annotated[
        str | None,
        typer.Option(
            help="Items to show, separated by commas: board, elastomer (the sheets, lifted off the board), dent, "
            "plates, target (on a page with a slider for its distance), eddies (eddy currents in plates and "
            "target), field (B on an upright plane, with arrows), map (B on a level plane), lines (of B), currents "
            "(of the passive coils), coupling, location. By default the board, with its plates and target."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        shared.out_option(
            "File to write instead of a window: a picture (.png), a film of the indenter over the board, or with "
            "--show target of the target (.gif, .mp4), "
            "a page to turn the scene in a browser (.html), parts for ParaView (.vtm), or the numbers of "
            "the field (.nc, .vtr).",
        ),
    ] = None,
    side: Annotated[
        Literal["oblique", "top", "front", "right"], typer.Option("--from", help="Side from which the scene is seen.")
    ] = "oblique",
    size: Annotated[
        str | None, typer.Option(help="Pixels of picture and film; 1600x900 and 960x540 by default.")
    ] = None,
    layers: Annotated[str | None, typer.Option(help="Copper layers shown, as L1,L3; all by default.")] = None,
    coil: Annotated[
        str | None, typer.Option(help='The measured coil, the middle one by default; on a page "each", with a slider.')
    ] = None,
    at_mm: Annotated[
        tuple[float, float] | None,
        typer.Option(
            help="x and y of indenter or target on the board; by default off the middle of the board, or at the coil."
        ),
    ] = None,
    depth_mm: Annotated[
        float | None, _length("--depth-mm", "Depth of the dent; the largest of the design by default.")
    ] = None,
    distance_mm: Annotated[
        float | None, _length("--distance-mm", "Distance of the target; the smallest of the design by default.")
    ] = None,
    spacing_mm: Annotated[
        float | None, _length("--spacing-mm", "Spacing of the points of B; 0.5 on planes and 1 in a box by default.")
    ] = None,
    z_mm: Annotated[
        str | None,
        typer.Option(help="Height of .nc and .vtr above the board, or FROM:TO for a volume; the design's by default."),
    ] = None,
    as_json: shared.AsJson = False,
) -> None:
    """Show a design in three dimensions, or its magnetic field.

    Opens a window, or writes a file. B is in phase with a current of 1 mA in the measured coil, in
    free space or beside infinite plates. The target that is shown with it is one of them, at one
    distance.

    The numbers of the field (.nc, .vtr) are on a plane or in a volume above the board, of a target
    only with --distance-mm. Magnetic sheets change only the currents. Traces are thin wires along
    their middle lines, so B is not the field of the trace nearer to it than its width.

    Example: coilarray view gast2020 --out board.png

    Example: coilarray view gast2020 --show board,field,lines --coil coil3 --out field.html

    Example: coilarray view gast2020 --out touch.gif

    Example: coilarray view gast2020 --coil coil3 --z-mm 1:9 --out field.vtr
    """
    kind = _kind(out)
    pixels: dict[str, tuple[int, int]] = {}
    if size is not None:
        if (match := _SIZE.fullmatch(size)) is None:
            raise OutputError(f"--size must be as 1600x900; got {size!r}.")
        pixels = {"size": (int(match[1]), int(match[2]))}
    items: tuple[Item, ...] = ()
    if show is not None:
        from coilarray.viz.scenes.design import ITEMS

        wanted = [name.strip() for name in show.split(",")]
        for name in wanted:
            if name not in ITEMS:
                raise OutputError(f"--show must be of {', '.join(ITEMS)}; got {name!r}.")
        items = tuple(item for item in ITEMS if item in wanted)
        if kind == "film" and set(items) - {"board"} not in ({"dent"}, {"target"}):
            raise OutputError(f"--show of a film must be dent or target; got {show!r}.")
    given = {
        "--show": show, "--from": side if side != "oblique" else None, "--size": size, "--layers": layers,
        "--coil": coil, "--at-mm": at_mm, "--depth-mm": depth_mm, "--distance-mm": distance_mm,
        "--spacing-mm": spacing_mm, "--z-mm": z_mm,
    }  # fmt: skip
    unused = {"film": _NOT_OF_FILMS, "field": _NOT_OF_FIELDS}.get(kind, {"--z-mm"})
    for option, value in given.items():
        if value is not None and option in unused:
            what = {"film": "a film, which shows δ of all coils", "field": "the numbers of a field"}
            raise OutputError(f"{option} is not for {what.get(kind, 'a scene, but for .nc and .vtr')}.")
    if distance_mm is not None and kind != "field" and items and "target" not in items:
        raise OutputError("--distance-mm is for --show target.")
    heights = None if z_mm is None else _heights(z_mm)
    if kind == "parts" or (out is not None and out.suffix.lower() == ".vtr"):
        require_pyvista("files for ParaView")
    opened = shared.open_design(design, allow_violations=True, boards=True)
    depth, spacing, distance = (
        None if length is None else length * 1e-3 for length in (depth_mm, spacing_mm, distance_mm)
    )
    if kind == "field" and out is not None:
        line, data = _write_field(opened, out, coil, heights, spacing_mm or _SPACING_MM, distance)
        shared.print_result({**shared.design_record(opened), **data}, as_json=as_json, lines=[line])
        return
    from coilarray.viz.scenes.design import (
        View,
        board_and_metal,
        scene_of_coils,
        scene_of_design,
        target_along,
        touch_along,
    )

    items, each = items or board_and_metal(opened), coil == "each" and kind == "page"
    if distance is not None and "target" not in items:
        raise OutputError(f"--distance-mm is for a design with a [target]; {opened.name} has none.")
    _check_machine(kind, out, pixels)
    notes: list[str] = []
    if kind == "film" and out is not None:
        of_target = "target" in items and (opened.indentation is None or distance is not None or show is not None)
        if of_target and depth is not None:
            raise OutputError("--depth-mm is for a film of the indenter.")
        along = partial(target_along, distance=distance) if of_target else partial(touch_along, depth=depth)
        pictures = _write_film(out, side, pixels, partial(along, opened))
        lines = [f"wrote {out}: {pictures} pictures, {pictures / _RATE:.3g} s"]
    else:
        asked = View(
            show=items, layers=None if layers is None else tuple(name.strip() for name in layers.split(",")),
            coil=None if each else coil,
            spacing=spacing, at=None if at_mm is None else (at_mm[0] * 1e-3, at_mm[1] * 1e-3), depth=depth,
            distance=distance, table=shared.kept_table(opened) if "location" in items else None,
        )  # fmt: skip
        with ExitStack() as bar:

            def track(text: str) -> Any:
                bar.close()  # of the work before
                return bar.enter_context(shared.progress_bar(text))

            scene = (scene_of_coils if each else scene_of_design)(opened, asked, track)
        notes = list(scene.notes)
        written = [out]
        if out is None:
            viz.show(scene, side=side)
        elif kind == "parts":
            written = list(viz.save_vtk(scene, out))
        elif kind == "page":
            viz.save_page(scene, out, title=opened.name, side=side)
        else:
            viz.save_picture(scene, out, side=side, dark=False, **pixels)
        lines = [*notes, *([] if out is None else [f"wrote {', '.join(map(str, written))}"])]
    data = {**shared.design_record(opened), "file": out and str(out), "notes": notes}
    shared.print_result(data, as_json=as_json, lines=lines)


def _kind(out: Path | None) -> Kind:
    if out is None:
        return "window"
    kind = _KINDS.get(out.suffix.lower())
    if kind is None:
        raise OutputError(f"--out must end in {', '.join(_KINDS)}; got {out}.")
    shared.check_file("--out", out, None)
    return kind


def _check_machine(kind: Kind, out: Path | None, pixels: dict[str, tuple[int, int]]) -> None:
    """Refuse before a long computation what this machine cannot show."""
    from coilarray.viz.scenes.pictures import check_movie, check_page, check_rendering, check_window

    if kind == "page":
        check_page()
    elif kind == "picture":
        check_rendering(**pixels)
    elif kind == "film" and out is not None:
        check_movie(out, rate=_RATE, **pixels)
    elif kind == "window":
        check_window()


def _write_film(out: Path, side: Side, pixels: dict[str, tuple[int, int]], along: Callable[..., Touch]) -> int:
    with shared.progress_bar("response") as progress:
        touch = along(count=_FRAMES, progress=progress)
    with shared.progress_bar("film") as progress:

        def counted() -> Iterator[Scene]:
            for done, scene in enumerate(touch.scenes(), start=1):
                yield scene
                progress(done, len(touch.places))

        viz.save_movie(touch.board(), counted(), out, side=side, rate=_RATE, **pixels)
    return len(touch.places)


def _write_field(
    design: Design,
    out: Path,
    coil: str | None,
    heights: tuple[float, float] | None,
    spacing_mm: float,
    distance: float | None,
) -> tuple[str, dict[str, object]]:
    active = design.array.middle_coil if coil is None else coil
    if active not in design.coil_names:
        raise GeometryError(f"--coil must be one of {', '.join(design.coil_names)}; got {active}.")
    x_min, y_min, x_max, y_max = design.array.bounds
    ranges = ((x_min, x_max), (y_min, y_max), heights or (design.field_height, design.field_height))
    shape = [math.ceil((end - start) / (spacing_mm * 1e-3) * (1 - 1e-12)) + 1 for start, end in ranges]
    if (count := math.prod(shape)) > _MOST_POINTS:
        raise GeometryError(f"--spacing-mm {spacing_mm:g} gives {count} points; at most {_MOST_POINTS} are allowed.")
    import numpy as np

    from coilarray.circuit.coupling import couple_design, operating_field
    from coilarray.compute.netcdf import save_dataset
    from coilarray.viz.datasets.meshes import vtk_text
    from coilarray.viz.datasets.results import field_grid

    if distance is not None:
        from coilarray.response.target import with_target_as_plate

        design = with_target_as_plate(design, (0.0, 0.0), distance)
    axes = (np.linspace(start, end, n) for (start, end), n in zip(ranges, shape, strict=True))
    coupling = couple_design(design)
    with shared.progress_bar(f"field at {count} points") as progress:
        result = operating_field(design, coupling, active, *axes, current=1e-3, progress=progress)
    if out.suffix.lower() == ".nc":
        save_dataset(result, out)
    else:
        write_text(out, vtk_text(field_grid(result.x.values, result.y.values, result.z.values, result.B.values)))
    peak = float(abs(result.B.sel(component="z")).max())
    without = "" if design.target is None else ", without the target"
    line = f"wrote {out}: {' × '.join(map(str, shape))} points, {active} active{without}, largest |B_z| "
    data = {
        "file": str(out), "coil": active, "current_A": 1e-3, "target_distance_m": distance, "shape": shape,
        "peak_Bz_T": peak,
    }  # fmt: skip
    return f"{line}{peak * 1e6:.4g} µT at 1 mA", data


def _heights(text: str) -> tuple[float, float]:
    try:
        values = [float(part) * 1e-3 for part in text.split(":")]
    except ValueError:
        values = []
    far = not all(abs(value) <= shared.LONGEST_MM * 1e-3 for value in values)
    if len(values) not in (1, 2) or far or values != sorted(values):
        raise GeometryError(
            f"--z-mm must be a number or FROM:TO with FROM below TO, at most {shared.LONGEST_MM:g}; got {text!r}."
        )
    return values[0], values[-1]


def studio(
    design: shared.DesignArgument = None,
    host: Annotated[
        str | None, typer.Option(help="Host to listen on, for browsers of other computers; by default this one alone.")
    ] = None,
    port: Annotated[int, typer.Option(help="TCP port of the page; 0 for a free one.")] = 8070,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
    folder: Annotated[
        Path | None, typer.Option(help="Folder of designs, reports and runs; by default that of DESIGN.")
    ] = None,
    board: Annotated[str, typer.Option(help="Board for the tab Live, as --port of coilarray board live.")] = EMULATOR,
    wiring: WiringName = None,
    settings: SettingsFile = None,
    linger: Annotated[
        float,
        shared.number_option(
            "--linger", 0, _LONGEST, "Seconds after the last page is closed until the studio ends; 0 for never."
        ),
    ] = 20.0,
) -> None:
    """Change a design in the browser and see the results.

    It has sliders for the design, the board in three dimensions, couplings and margins, the field
    with switches for every coil, an indenter to drag over the board, optimisations, and the live
    board or its emulator. The page is served to this computer alone unless --host is given, always
    under the printed address, whose token keeps other accounts out. It loads nothing from other
    hosts. Ctrl-C ends it.

    Example: coilarray studio gast2020

    Example: coilarray studio better.toml --host 0.0.0.0 --no-browser
    """
    where = (folder or (Path(design).parent if design and Path(design).is_file() else Path())).resolve()
    if not where.is_dir():
        raise OutputError(f"--folder must be a folder; got {where}.")
    live = LiveOptions(BoardOptions(board, wiring, settings=settings))
    from coilarray.viz.studio.services import LOOPBACK, Address, bind, check_studio

    address = Address(LOOPBACK if host is None else host, port, alone=host is None)
    check_studio()
    from coilarray.design.model import load_design_file
    from coilarray.viz.studio.services import Services
    from coilarray.viz.studio.work import Shelf, work_on

    def ready(url: str) -> None:
        shared.say(f"studio: {url} (Ctrl-C ends it)")
        if browser:
            Thread(target=webbrowser.open, args=(url,), daemon=True).start()

    opened = load_design_file(design)
    work = work_on(opened, Path(design).name if design else opened.design.name)
    with bind(address) as listening:
        from coilarray.viz.studio.server import serve

        watch = partial(watch_board, live, True)
        services = Services(kept_response, write_report, watch, port=board, summarize=summarize)
        with suppress(KeyboardInterrupt):  # where the loop cannot handle signals
            serve(work, Shelf(where), services, address, listening, linger=linger, ready=ready)
    shared.say("coilarray: the studio has ended", err=True)


def summarize(design: Design, coupling: xr.Dataset, response: xr.Dataset | None) -> Summary:
    """Summarize a design with the numbers of the report."""
    from coilarray.circuit.coupling import scan_design
    from coilarray.design.boards import check_boards
    from coilarray.design.write import design_document
    from coilarray.geometry.usual_values import unusual_values
    from coilarray.report.summary import position_bounds, summary_table, verdicts
    from coilarray.viz.studio.services import Summary

    margins = check_boards(design)
    try:
        scan = scan_design(design)
    except (GeometryError, NetworkError):  # as in the report
        scan = None
    bounds = None if response is None else position_bounds(response, design.array)
    table = summary_table(coupling, scan, margins, response, bounds=bounds).brief().without("key")
    lines = [*unusual_values(design_document(design)), *verdicts(scan, ())]  # the page says which rules are broken
    return Summary(table, lines, converter=scan is not None and "readable" in scan)


# These run in processes of their own, and are therefore functions of a module with plain arguments.


def write_report(document: Document, name: str, folder: Path, progress: Progress) -> Path:
    """Write the report of a design and return its page."""
    from coilarray.design.model import build_design_file
    from coilarray.report.write import write_report as write

    return write(build_design_file(document, name), folder, progress=progress).page


def kept_response(document: Document, name: str, progress: Progress) -> xr.Dataset:
    """Return the stored response table of a design."""
    from coilarray.design.model import build_design

    return shared.stored_table(build_design(document, name), progress=progress)
