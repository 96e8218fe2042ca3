"""``coilarray board campaign``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from coilarray.cli.board.info import FORMATS, write_response
from coilarray.cli.board.measure import RUN, print_recording, recorded_session
from coilarray.cli.board.options import BoardOptions, board_command, is_emulator, marked, opened_board
from coilarray.cli.replacing import replacing, require_own
from coilarray.cli.shared import (
    AllowViolations,
    AsJson,
    Depths,
    DesignArgument,
    PlacesX,
    PlacesY,
    Resume,
    check_file,
    from_map_origin,
    lengths,
    open_design,
    print_result,
    progress_bar,
)
from coilarray.errors import HardwareError, OutputError

if TYPE_CHECKING:
    from coilarray.compute.threads import Progress
    from coilarray.hardware.board.connect import Board
    from coilarray.hardware.board.self_test import SelfTest
    from coilarray.hardware.record.campaign import Campaign
    from coilarray.hardware.record.recorder import Recorder
    from coilarray.hardware.record.stages import Dialect, Stage
    from coilarray.hardware.scan.reader import Reader
    from coilarray.hardware.scan.settings import ScanSettings

_PERSON = "person"
_DIALECTS = ("grbl", "marlin")
_PATIENCE = 10.0  # s in which the port of a board that restarted may come back


@board_command()
def campaign(
    design: DesignArgument = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Recording to write (SQLite).")] = RUN,
    resume: Resume = False,
    x_mm: PlacesX = None,
    y_mm: PlacesY = None,
    depth_mm: Depths = None,
    repeats: Annotated[int, typer.Option(help="Number of passes over the whole grid.")] = 1,
    average: Annotated[int, typer.Option(help="Number of scans at every baseline and every peak.")] = 1,
    dwell_s: Annotated[float, typer.Option(help="Wait at full depth before the peak is measured.")] = 0.5,
    speed_mm_s: Annotated[float, typer.Option(help="Speed of the indenter, down and up.")] = 1.5,
    stage: Annotated[
        str | None,
        typer.Option(
            help="What moves the indenter: person, prompted for every position (the default with a real board); or "
            "a G-code machine, grbl:PORT or marlin:PORT, with x and y on the board and z = 0 at contact."
        ),
    ] = None,
    reach_mm: Annotated[
        str | None,
        typer.Option(metavar="XMIN,XMAX,YMIN,YMAX,DEPTH", help="Limits of the travel of a G-code stage, on the board."),
    ] = None,
    clearance_mm: Annotated[
        float | None,
        typer.Option(
            help="Height over the sheets at which a G-code stage travels and the baselines are measured; 2 by default."
        ),
    ] = None,
    home: Annotated[
        bool,
        typer.Option(
            "--home",
            help="Home a G-code stage first, $H of GRBL or G28 of Marlin; needed where it restarts as its port opens.",
        ),
    ] = False,
    yes: Annotated[
        bool,
        typer.Option("--yes", help="Move a G-code stage without asking; not at the first use of its port."),
    ] = False,
    ignore_self_test: Annotated[
        bool, typer.Option("--ignore-self-test", help="Continue even if the self-test fails.")
    ] = False,
    plan: Annotated[bool, typer.Option("--plan", help="Only print the grid and how long it would take.")] = False,
    response: Annotated[
        Path | None, typer.Option(help="Also write the measured response (.nc or .csv), as coilarray board info does.")
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Replace a response file that the command did not write itself.")
    ] = False,
    *,
    options: BoardOptions,
    as_json: AsJson = False,
    allow_violations: AllowViolations = False,
) -> None:
    """Measure while an indenter presses on a grid of positions.

    The result is the response of every coil. Steps at every position: measure the baseline, indent, wait, measure the
    peak, relax. The grid is that of the design unless options change it. Every scan is in the file as soon as it
    arrives; --resume measures the positions that are missing. A campaign begins and ends with a self-test of switches
    and coils, since scans alone do not show every fault. Without --port an emulator replaces board and indenter, in
    virtual time, and every line of the output says so.

    A G-code stage begins with a slow move, which a person confirms. One that restarts when its port is opened has
    forgotten where it is, and is refused without --home.

    Example: coilarray board campaign gast2020 --out campaign.sqlite --response measured.nc

    Example: coilarray board campaign --port COM5 --stage grbl:COM6 --reach-mm -30,30,-10,10,1.2 --resume
    """
    *places, depths = (
        lengths(option, text) for option, text in (("--x-mm", x_mm), ("--y-mm", y_mm), ("--depth-mm", depth_mm))
    )
    check_file("--out", out, None)
    check_file("--response", response, [f".{one}" for one in FORMATS])
    if response is not None and response.resolve() == out.resolve():
        raise OutputError(f"--response must be another file than the recording {out}.")
    written = [] if response is None else [response]
    require_own("board campaign", written, force=force)
    opened = open_design(design, allow_violations=allow_violations)
    x, y = from_map_origin(opened.indentation, *places)
    from coilarray.hardware.record.campaign import design_campaign
    from coilarray.hardware.record.recorder import open_recorder
    from coilarray.hardware.record.recording import open_recording
    from coilarray.response.dataset import map_origin

    make_stage = _stage_maker(stage, reach_mm, clearance_mm, options.port, map_origin(opened.indentation), home, yes)
    grid = design_campaign(
        opened, x=x, y=y, depths=depths, repeats=repeats, scans=average, dwell=dwell_s, speed=speed_mm_s * 1e-3
    )
    if plan:
        _print_plan(grid, as_json=as_json)
        return
    asked = not is_emulator(options.port) and stage in (None, _PERSON)
    with (
        open_recorder(out, resume=resume) as recorder,
        _positions_in_lines() if asked else progress_bar("positions") as progress,
        opened_board(options, opened, real_time=False, progress=progress) as (board, settings),
        closing(make_stage(board)) as moving,
    ):
        moving.check(grid.places)
        before = _tested(board, settings, "before", ignore=ignore_self_test)
        with recorded_session(recorder, board, settings, opened, grid.to_json(), quiet=as_json):
            recorder.add_self_test(before.symptoms, before.findings)
            _run(grid, board, moving, recorder, progress)
            after = _tested(board, settings, "after", ignore=True)
            recorder.add_self_test(after.symptoms, after.findings)
    summary = print_recording(out, as_json=as_json)
    if response is not None:
        with replacing("board campaign", *written, force=force), open_recording(out) as recording:
            wrote = write_response(recording, response)
        if not as_json:
            typer.echo(marked(wrote, emulated=summary.emulated))


def _print_plan(grid: Campaign, *, as_json: bool) -> None:
    counts = f"{len(grid.x)} × {len(grid.y)} positions, {len(grid.depths)} depths, {grid.repeats} repeats"
    line = f"{counts}: {grid.size} indentations, at least {grid.seconds / 60:.1f} min without scans and travel"
    print_result({**grid.to_record(), "least_seconds": grid.seconds}, as_json=as_json, lines=[line])


def _tested(board: Board, settings: ScanSettings, when: str, *, ignore: bool) -> SelfTest:
    """Test every switch and coil, and configure the board again."""
    from coilarray.hardware.board.self_test import self_test

    result = self_test(board.reader, board.wiring, settings)
    board.reader.configure(settings)
    if not (result.passed or ignore):
        raise HardwareError(
            f"the self-test {when} the campaign has failed: {result.symptoms[0]}; see `coilarray board test`, "
            "or continue with --ignore-self-test."
        )
    return result


def _run(grid: Campaign, board: Board, stage: Stage, recorder: Recorder, progress: Progress) -> None:
    from coilarray.hardware.record.campaign import run_campaign
    from coilarray.hardware.wire.buses import ComputerClock

    clock = ComputerClock() if board.emulator is None else board.emulator.clock
    run_campaign(grid, board.reader, stage, recorder, clock, progress=progress, reconnect=_reconnecting(board))


def _reconnecting(board: Board) -> Callable[[], Reader] | None:
    """Return what reopens a microcontroller that restarted; None for other boards, which cannot restart."""
    from coilarray.hardware.board.microcontroller import MicrocontrollerReader

    if not isinstance(board.reader, MicrocontrollerReader):
        return None
    current: MicrocontrollerReader = board.reader

    def reconnect() -> Reader:
        nonlocal current
        board.reader = current = current.reconnect(_PATIENCE)
        return current

    return reconnect


@contextmanager
def _positions_in_lines() -> Iterator[Progress]:
    """Show the progress in lines: a bar would overwrite the questions to a person."""

    def update(done: int, total: int) -> None:
        typer.echo(f"{done} of {total} positions are measured.", err=True)

    yield update


def _stage_maker(
    stage: str | None,
    reach_mm: str | None,
    clearance_mm: float | None,
    port: str,
    origin: tuple[float, float],
    home: bool,
    yes: bool,
) -> Callable[[Board], Stage]:
    """Return a function that makes the stage once the board is open; options that do not fit are refused at once."""
    kind, _, stage_port = (stage or _PERSON).partition(":")
    if stage not in (None, _PERSON) and not (kind in _DIALECTS and stage_port):
        raise HardwareError(f"--stage must be {_PERSON}, grbl:PORT or marlin:PORT; got {stage!r}.")
    if stage is not None and is_emulator(port):
        raise HardwareError("--stage is for a real board; the emulator has its own.")
    if (kind in _DIALECTS) != (reach_mm is not None):
        raise HardwareError("--reach-mm must be given with a G-code stage, and only with one.")
    if clearance_mm is not None and reach_mm is None:
        raise HardwareError("--clearance-mm is for a G-code stage.")
    for option, given in (("--home", home), ("--yes", yes)):
        if given and reach_mm is None:
            raise HardwareError(f"{option} is for a G-code stage.")
    if stage_port == port:
        raise HardwareError(f"--stage and --port must be different ports; got {port} twice.")
    from coilarray.hardware.record.stages import EmulatedStage, GcodeStage, PersonStage, StageLimits
    from coilarray.hardware.wire.serial_ports import choose_serial_port, open_serial_port

    if reach_mm is None:
        return lambda board: PersonStage(_ask, origin) if board.emulator is None else EmulatedStage(board.emulator)
    try:
        x_min, x_max, y_min, y_max, depth = (float(part) * 1e-3 for part in reach_mm.split(","))
    except ValueError:
        raise HardwareError(f"--reach-mm must be XMIN,XMAX,YMIN,YMAX,DEPTH; got {reach_mm!r}.") from None
    limits = StageLimits((x_min, x_max), (y_min, y_max), depth)
    if clearance_mm is not None:
        limits = StageLimits(limits.x, limits.y, depth, clearance_mm * 1e-3)
    dialect: Dialect = "marlin" if kind == "marlin" else "grbl"

    def made(_: Board) -> Stage:
        found = choose_serial_port(stage_port)
        opened = open_serial_port(found.name)
        confirm = None if yes else _agree
        return GcodeStage(opened, limits, dialect, confirm=confirm, home=home, identity=str(found), origin=origin)

    return made


def _ask(text: str) -> None:
    """Show a text and wait for the Enter key."""
    _answer(f"{text} Then press Enter. ")


def _agree(text: str) -> None:
    """Show a text and wait for a yes; HardwareError for any other answer."""
    if _answer(f"{text} [y/N] ").strip().lower() not in ("y", "yes"):
        raise HardwareError("the move of the stage was not confirmed.")


def _answer(text: str) -> str:
    typer.echo(text, nl=False, err=True)
    answer = sys.stdin.readline()
    if not answer:
        raise HardwareError("no answer: standard input has ended.")
    return answer
