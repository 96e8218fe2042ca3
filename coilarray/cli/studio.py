"""``coilarray studio``."""

from __future__ import annotations

import webbrowser
from contextlib import suppress
from functools import partial
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Annotated

import typer

from coilarray.cli.board.live_source import LiveOptions, watch_board
from coilarray.cli.board.options import EMULATOR, BoardOptions, SettingsFile, WiringName
from coilarray.cli.shared import DesignArgument, number_option
from coilarray.errors import GeometryError, NetworkError, OutputError

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.compute.threads import Progress
    from coilarray.design.model import Design
    from coilarray.viz.studio.services import Document, Summary

_LONGEST = 86_400.0  # s


def studio(
    design: DesignArgument = None,
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
        number_option(
            ("--linger",), 0, _LONGEST, "Seconds after the last page is closed until the studio ends; 0 for never."
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
        typer.echo(f"studio: {url} (Ctrl-C ends it)")
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
    typer.echo("coilarray: the studio has ended", err=True)


def summarize(design: Design, coupling: xr.Dataset, response: xr.Dataset | None) -> Summary:
    """Summarize a design with the numbers of the report."""
    from coilarray.circuit.coupling import scan_design
    from coilarray.design.write import design_document
    from coilarray.geometry import check_rules
    from coilarray.geometry.usual_values import unusual_values
    from coilarray.report.summary import position_bounds, summary_table, verdicts
    from coilarray.viz.studio.services import Summary

    margins = check_rules(design.array, design.rules)
    try:
        scan = scan_design(design)
    except (GeometryError, NetworkError):  # as in the report
        scan = None
    bounds = None if response is None else position_bounds(response, design.array)
    table = summary_table(coupling, scan, margins, response, bounds=bounds).brief()
    lines = [*unusual_values(design_document(design)), *verdicts(scan, ())]  # the page says which rules are broken
    return Summary(table, lines, converter=scan is not None)


# These run in processes of their own, and are therefore functions of a module with plain arguments.


def write_report(document: Document, name: str, folder: Path, progress: Progress) -> Path:
    """Write the report of a design and return its page."""
    from coilarray.design.model import build_design_file
    from coilarray.report.write import write_report as write

    return write(build_design_file(document, name), folder, progress=progress).page


def kept_response(document: Document, name: str, progress: Progress) -> xr.Dataset:
    """Return the stored response table of a design."""
    from coilarray.cli.maps import stored_table
    from coilarray.design.model import build_design

    return stored_table(build_design(document, name), progress=progress)
