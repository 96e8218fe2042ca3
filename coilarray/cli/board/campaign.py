"""``coilarray board campaign``."""

from __future__ import annotations

import sys
from contextlib import closing, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from coilarray.cli.board.measure import RUN, print_recording, recorded_session
from coilarray.cli.board.options import BoardOptions, board_command, is_emulator, opened_board
from coilarray.cli.shared import AsJson, DesignArgument, Resume, check_file, from_map_origin, print_result, progress_bar
from coilarray.errors import HardwareError

if TYPE_CHECKING:
    from coilarray.cli.board.files import StageTable
    from coilarray.hardware.board.connect import Board
    from coilarray.hardware.board.microcontroller import MicrocontrollerReader
    from coilarray.hardware.record.campaign import Stage
    from coilarray.hardware.scan.readings import Reader

_PATIENCE = 10.0  # s in which the port of a board that restarted may come back


@board_command()
def campaign(
    design: DesignArgument = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Recording to write (SQLite).")] = RUN,
    resume: Resume = False,
    plan: Annotated[
        Path | None,
        typer.Option(help="File (TOML) with grid, sequence and stage of the campaign; those of the design by default."),
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="Move a G-code stage without asking; not at the first use of its port.")
    ] = False,
    ignore_self_test: Annotated[
        bool, typer.Option("--ignore-self-test", help="Continue even if the self-test fails.")
    ] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only print the grid and how long it would take.")] = False,
    *,
    options: BoardOptions,
    as_json: AsJson = False,
) -> None:
    """Measure while an indenter presses on a grid of positions.

    The result is the response of every coil. Steps at every position: measure the baseline, indent,
    wait, measure the peak, relax. The grid is the design's unless --plan has another. Every scan is
    in the file as soon as it arrives, and --resume measures the missing positions. A campaign
    begins and ends with a self-test of switches and coils, since scans alone do not show every
    fault. Without --port an emulator replaces board and indenter, in virtual time, and every line
    of the output says so.

    A person moves the indenter of a real board, or a G-code stage that the plan names. The stage
    begins with a slow move, which a person confirms. A stage that restarts when its port is opened
    has lost its position, and is refused unless the plan lets it home itself. `coilarray board
    info` converts the recording to a response.

    Example: coilarray board campaign gast2020 --out campaign.sqlite

    Example: coilarray board campaign --port /dev/ttyACM0 --plan plan.toml --resume
    """
    from coilarray.cli.board.files import read_plan

    check_file("--out", out, None)
    file, opened = read_plan(plan), options.design(design)
    stage = file.stage
    if stage is not None and is_emulator(options.port):
        raise HardwareError(f"{plan}: stage is for a real board; the emulator has its own.")
    if stage is None and yes:
        raise HardwareError("--yes is for a G-code stage, which --plan must name.")
    if stage is not None and stage.port == options.port:
        raise HardwareError(f"{plan}: stage.port and --port must be different ports; got {stage.port} twice.")
    from coilarray.hardware.board.microcontroller import MicrocontrollerReader
    from coilarray.hardware.board.self_test import self_test
    from coilarray.hardware.record.campaign import design_campaign, run_campaign
    from coilarray.hardware.record.recorder import open_recorder
    from coilarray.hardware.wire.buses import ComputerClock
    from coilarray.response.dataset import map_origin

    rows = (file.x, file.y, file.depths)
    *along, depths = (None if row is None else [value * 1e-3 for value in row] for row in rows)
    x, y = from_map_origin(opened.indentation, *along)
    grid = design_campaign(
        opened, x=x, y=y, depths=depths, repeats=file.repeats, scans=file.average, dwell=file.dwell,
        speed=file.speed * 1e-3,
    )  # fmt: skip
    if dry_run:
        counts = f"{len(grid.x)} × {len(grid.y)} positions, {len(grid.depths)} depths, {grid.repeats} repeats"
        line = f"{counts}: {grid.size} indentations, at least {grid.seconds / 60:.1f} min without scans and travel"
        print_result({**grid.to_record(), "least_seconds": grid.seconds}, as_json=as_json, lines=[line])
        return
    asked = not is_emulator(options.port) and stage is None
    with (
        open_recorder(out, resume=resume) as recorder,
        # a bar would overwrite the questions to a person
        nullcontext(_print_progress) if asked else progress_bar("positions") as progress,
        opened_board(options, opened, real_time=False, progress=progress) as (board, settings),
        closing(_stage(stage, board, map_origin(opened.indentation), yes=yes)) as moving,
    ):
        moving.check(grid.places)
        before = self_test(board.reader, board.wiring, settings)
        board.reader.configure(settings)
        if not (before.passed or ignore_self_test):
            raise HardwareError(
                f"the self-test before the campaign has failed: {before.symptoms[0]}; see `coilarray board test`, "
                "or continue with --ignore-self-test."
            )
        with recorded_session(recorder, board, settings, opened, grid.to_json(), quiet=as_json):
            recorder.add_self_test(before.symptoms, before.findings)
            clock = ComputerClock() if board.emulator is None else board.emulator.clock
            reconnect = partial(_reconnect, board) if isinstance(board.reader, MicrocontrollerReader) else None
            run_campaign(grid, board.reader, moving, recorder, clock, progress=progress, reconnect=reconnect)
            after = self_test(board.reader, board.wiring, settings)
            recorder.add_self_test(after.symptoms, after.findings)
    print_recording(out, as_json=as_json)


def _print_progress(done: int, total: int) -> None:
    typer.echo(f"{done} of {total} positions are measured.", err=True)


def _reconnect(board: Board) -> Reader:
    """Reopen a microcontroller that restarted, unlike other boards."""
    board.reader = cast("MicrocontrollerReader", board.reader).reconnect(_PATIENCE)
    return board.reader


def _stage(stage: StageTable | None, board: Board, origin: tuple[float, float], *, yes: bool) -> Stage:
    """Return the plan's machine, a person, or the emulator's stage."""
    from coilarray.hardware.record.campaign import EmulatedStage, GcodeStage, PersonStage, StageLimits
    from coilarray.hardware.wire.ports import OpenSerialPort, choose_serial_port

    if stage is None:
        return PersonStage(_ask, origin) if board.emulator is None else EmulatedStage(board.emulator)
    (x_min, x_max), (y_min, y_max) = stage.x, stage.y
    limits = StageLimits(
        (x_min * 1e-3, x_max * 1e-3), (y_min * 1e-3, y_max * 1e-3), stage.depth * 1e-3, stage.clearance * 1e-3
    )
    found = choose_serial_port(stage.port)
    return GcodeStage(
        OpenSerialPort(found.name),
        limits,
        stage.machine,
        confirm=None if yes else _agree,
        home=stage.home,
        identity=str(found),
        origin=origin,
    )


def _ask(text: str) -> None:
    """Show a text and wait for the Enter key."""
    _answer(f"{text} Then press Enter. ")


def _agree(text: str) -> None:
    """Show a text, and wait for a yes."""
    if _answer(f"{text} [y/N] ").strip().lower() not in ("y", "yes"):
        raise HardwareError("the move of the stage was not confirmed.")


def _answer(text: str) -> str:
    typer.echo(text, nl=False, err=True)
    answer = sys.stdin.readline()
    if not answer:
        raise HardwareError("no answer: standard input has ended.")
    return answer
