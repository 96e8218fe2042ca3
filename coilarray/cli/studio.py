"""``coilarray studio``."""

from __future__ import annotations

import math
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Annotated

import typer

from coilarray.cli.board_options import EMULATOR, WiringName, is_emulator, marked
from coilarray.cli.shared import DesignArgument, number_option
from coilarray.errors import GeometryError, NetworkError, OutputError

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.compute.threads import Progress
    from coilarray.design.model import Design, Indentation
    from coilarray.hardware.record.live_tracking import LiveReading
    from coilarray.viz.studio.services import BoardFrame, BoardRequest, Document, Summary

_LONGEST = 86_400.0  # s
_TOUR, _PERIOD, _STEP = 3600.0, 40.0, 1.0  # s: duration of the emulated finger's tour, one turn, one step


def studio(
    design: DesignArgument = None,
    host: Annotated[
        str | None, typer.Option(help="Host to listen on; every browser then needs the token of the address.")
    ] = None,
    port: Annotated[int, typer.Option(help="TCP port of the page; 0 takes a free one.")] = 8070,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
    folder: Annotated[
        Path | None, typer.Option(help="Folder of designs, reports and runs; by default that of DESIGN.")
    ] = None,
    board: Annotated[str, typer.Option(help="Board of the tab of that name, as --port of coilarray live.")] = EMULATOR,
    wiring: WiringName = None,
    linger: Annotated[
        float,
        number_option(("--linger",), 0, _LONGEST, "Seconds before it ends after the last page is closed; 0 for never."),
    ] = 20.0,
) -> None:
    """Change a design in the browser and see its results at once.

    It has sliders for the design, the board in three dimensions, couplings and margins; switches for every coil with
    the field; an indenter to drag over the board; runs of an optimisation; the live board or its emulator. The page is
    served to this computer alone unless --host is given, and loads nothing from other hosts. Ctrl-C ends it.

    Example: coilarray studio gast2020

    Example: coilarray studio better.toml --host 0.0.0.0 --no-browser
    """
    where = _folder(design, folder)
    from coilarray.viz.studio.server import LOOPBACK, Address, bind, check_studio, new_token

    address = Address(LOOPBACK if host is None else host, port, "" if host is None else new_token())
    check_studio()
    from coilarray.design.model import load_design_file
    from coilarray.viz.studio.services import Services
    from coilarray.viz.studio.shelf import Shelf
    from coilarray.viz.studio.work import work_on

    def ready(url: str) -> None:
        typer.echo(f"studio: {url} (Ctrl-C ends it)")
        if browser:
            Thread(target=webbrowser.open, args=(url,), daemon=True).start()

    opened = load_design_file(design)
    work = work_on(opened, Path(design).name if design else opened.design.name)
    with bind(address) as listening:
        from coilarray.viz.studio.server import serve

        services = Services(kept_response, write_report, watch_board, port=board, wiring=wiring, summarize=summarize)
        with suppress(KeyboardInterrupt):  # where the loop cannot handle signals
            serve(work, Shelf(where), services, address, listening, linger=linger, ready=ready)
    typer.echo("coilarray: the studio has ended", err=True)


def _folder(design: str | None, folder: Path | None) -> Path:
    """Return the folder that the page can read and write."""
    named = Path(design).parent if design and Path(design).is_file() else Path()
    where = (folder or named).resolve()
    if not where.is_dir():
        raise OutputError(f"--folder must be a folder; got {where}.")
    return where


def summarize(design: Design, coupling: xr.Dataset, response: xr.Dataset | None) -> Summary:
    """See `coilarray.viz.studio.services.Summarize`; the numbers are those of the report."""
    from coilarray.circuit.impedance import scan_design
    from coilarray.geometry import check_rules
    from coilarray.report.summary import summary_table, verdicts
    from coilarray.viz.studio.services import Summary

    margins = check_rules(design.array, design.rules)
    try:
        scan = scan_design(design)
    except (GeometryError, NetworkError):  # as in the report
        scan = None
    table = summary_table(coupling, scan, margins, response)
    return Summary(table.headers, table.cells(), verdicts(scan, margins))


# These run in processes of their own, and are therefore functions of a module with plain arguments.


def write_report(document: Document, name: str, folder: Path, progress: Progress) -> Path:
    """See `coilarray.viz.studio.services.WriteReport`."""
    from coilarray.design.model import build_design_file
    from coilarray.report.write import write_report as write

    return write(build_design_file(document, name), folder, progress=progress).page


def kept_response(document: Document, name: str, progress: Progress) -> xr.Dataset:
    """See `coilarray.viz.studio.services.ResponseTable`; stored like that of ``coilarray locate``."""
    from coilarray.cli.maps import stored_table
    from coilarray.design.model import build_design

    return stored_table(build_design(document, name), progress)


def watch_board(request: BoardRequest, send: Callable[[BoardFrame], None], stopped: Callable[[], bool]) -> None:
    """See `coilarray.viz.studio.services.WatchBoard`; a finger moves in circles on an emulated board."""
    from contextlib import closing

    from coilarray.cli.board_options import BoardOptions, opened_board
    from coilarray.design.model import build_design
    from coilarray.hardware.record.live_tracking import LiveTracker
    from coilarray.hardware.scan.readings import read_scan
    from coilarray.localize.forward import forward_model
    from coilarray.response.coordinates import on_board
    from coilarray.viz.studio.services import BoardFrame

    design = build_design(request.document, request.name)
    line, emulated = request.port, is_emulator(request.port)

    def wait(done: int, total: int) -> None:
        part = f" {100 * done / total:.0f} %" if total else ""
        send(BoardFrame(f"{line}; response of the design{part} …", emulated, 0, {}))

    options = BoardOptions(request.port, request.wiring)
    with opened_board(options, design, real_time=True, progress=wait) as (board, settings):
        line = marked(board.line, emulated=board.emulated)
        model = None
        if design.indentation is not None:
            model = forward_model(on_board(kept_response(request.document, request.name, wait)))
        tracker, going = LiveTracker(model), False
        capacitance = design.circuit.switches.tank_capacitance
        with closing(board.reader.scans()) as scans:
            for scan in scans:
                if stopped():
                    return
                reading = tracker.take(read_scan(scan, settings, capacitance))
                send(_frame(reading, line, emulated=board.emulated))
                if board.emulator is not None and design.indentation is not None and not (going or reading.waiting):
                    going = True
                    board.emulator.indenter.follow(_round(design.indentation, board.emulator.clock.now()))


def _frame(reading: LiveReading, line: str, *, emulated: bool) -> BoardFrame:
    from coilarray.viz.studio.services import BoardFrame

    deltas = {state.name: state.delta for state in reading.states}
    doubts = {state.name: f"{state.verdict}: {', '.join(state.reasons)}" for state in reading.states if state.reasons}
    told = (reading.waiting, reading.location, reading.problem, reading.rate, reading.lost)
    return BoardFrame(line, emulated, reading.sequence, deltas, doubts, *told)


def _round(setup: Indentation, start: float) -> list[tuple[float, float, float, float]]:
    """Return the path of a finger that moves in circles on the map of a design: time in s, x, y and depth in m."""
    (x, a), (y, b) = (((axis[0] + axis[-1]) / 2, 0.4 * (axis[-1] - axis[0])) for axis in (setup.x, setup.y))
    path = [(start, x + a, y, 0.0)]
    for k in range(int(_TOUR / _STEP)):
        angle = 2 * math.pi * k * _STEP / _PERIOD
        at = start + 1.0 + k * _STEP
        path.append((at, x + a * math.cos(angle), y + b * math.sin(angle), setup.depths[-1]))
    return path
