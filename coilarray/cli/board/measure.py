"""Commands that read a board: ``coilarray board test``, ``measure`` and ``campaign``."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager, nullcontext
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from coilarray.cli import shared
from coilarray.cli.board.options import BoardOptions, board_command, is_emulator, opened_board
from coilarray.cli.board.recordings import reading_cells, summary_parts
from coilarray.compute.display_units import DisplayUnit
from coilarray.compute.table import Column, Table, text_table
from coilarray.errors import HardwareError

if TYPE_CHECKING:
    from coilarray.cli.board.files import StageTable
    from coilarray.design.model import Design
    from coilarray.hardware.board.connect import Board
    from coilarray.hardware.board.microcontroller import MicrocontrollerReader
    from coilarray.hardware.board.self_test import SelfTest
    from coilarray.hardware.record.campaign import Stage
    from coilarray.hardware.record.recorder import Recorder
    from coilarray.hardware.scan.readings import RawScan, Reader
    from coilarray.hardware.scan.settings import ScanSettings


_KINDS = {"serial": "serial ports", "linux": "buses of this computer", "ftdi": "adapters"}
_CHAIN = {
    "same": "wired back, returns what was sent",
    "differ": "wired back, does not return what was sent",
    "none": "not wired back, so that a broken data line shows only as coils that do not oscillate",
}
_MOST_LINES = 6  # symptoms and faults shown; all of them with --json
RUN = Path("run.sqlite")
_SCANS, _MOST_SCANS = 100, 100_000_000
_LONGEST = 1e7  # s
_MET = 0.98  # part of --rate below which a slower rate is reported
_PATIENCE = 10.0  # s in which the port of a board that restarted may come back


@board_command(without=("rate",))
def self_test(
    design: shared.DesignArgument = None,
    only_list: Annotated[
        bool, typer.Option("--list", help="Only list the ports of this computer, and say what answers at --port.")
    ] = False,
    find_drives: Annotated[
        bool,
        typer.Option(
            "--find-drives", help="Find the drive current (IDRIVE) of every coil. Run it where the board will be used."
        ),
    ] = False,
    *,
    options: BoardOptions,
    as_json: shared.AsJson = False,
) -> None:
    """Test every switch and coil of a board.

    It lists the ports of this computer too. The exit code is 2 if the board has a fault. Run it
    once with every new board: until it has passed, the order of the switches' bits is an
    assumption. It detects stuck switches, broken and shorted coils, and switches assigned to the
    wrong coils, from which coils oscillate and how neighbouring coils couple.

    Options of a port follow a question mark: i2c:1?mode=2&readback=yes for the switches, with
    ftdi://... also address=0x2B, and baud=9600 of a serial port.

    Without switches, coils are wired to the channels of the converter:
    i2c:1?channels=0,1&clock=40MHz (clock at the pin CLKIN, internal by default). The self-test then
    reports which coils oscillate.

    Example: coilarray board test --port /dev/ttyACM0

    Example: coilarray board test --list
    """
    if only_list and find_drives:
        raise HardwareError("--list cannot be given with --find-drives.")
    from coilarray.hardware.board import self_test as tests
    from coilarray.hardware.board.connect import open_board, wiring_of_board
    from coilarray.hardware.wire.ports import parse_port

    place = parse_port(options.port)
    opened = options.design_file(design).design
    drives = result = None
    if only_list:
        # ports are listed without a design, which decides on the coils of an emulator
        named = opened if design is not None or is_emulator(options.port) else None
        wired = wiring_of_board(place, named, options.wiring, options.file.coils)
        with open_board(options.port, design=opened, wiring=wired) as board:
            record, line = _record(board), board.line
    else:
        with (
            shared.progress_bar("self-test") as progress,
            opened_board(options, opened, real_time=False) as (board, settings),
        ):
            if find_drives:
                drives = tests.find_drives(board.reader, settings)
                states = tuple(replace(state, drive=drives[state.name].code) for state in settings.states)
            record = _record(board, board.check_chain())
            trying = settings if drives is None else replace(settings, states=states)
            result = tests.self_test(board.reader, board.wiring, trying, progress=progress)
            line = board.line
    parts: list[str | Table] = [
        *(f"{title}: {', '.join(record['ports'][kind]) or 'none'}" for kind, title in _KINDS.items()),
        line,
    ]
    if record["chain"] is not None:
        parts.append(f"end of the chain of switches: {_CHAIN[record['chain']]}")
    if drives is not None:
        codes = ", ".join(f"{name} = {drive.code}" for name, drive in drives.items())
        rows = [(name, str(one.code), str(one.proposed), ", ".join(one.reasons)) for name, one in drives.items()]
        parts.append(text_table(("coil", "IDRIVE", "proposed", "not good"), rows))
        parts.append(f"for the file of --settings: drives = {{ {codes} }}")
    if result is not None:
        parts += _test_parts(result)
    tried = {
        "drives": None if drives is None else {name: asdict(drive) for name, drive in drives.items()},
        "self_test": result and {"passed": result.passed, **asdict(result)},
    }
    shared.print_result(record | tried, as_json=as_json, lines=parts, emulated=record["emulated"])
    if result is not None and not result.passed:
        raise HardwareError(f"the self-test of {options.port} has failed: {result.symptoms[0]}.")


def _record(one: Board, chain: str | None = None) -> dict[str, Any]:
    from coilarray.hardware.wire.ports import found_ports

    return {
        "emulated": one.emulated,
        "port": one.port,
        "identity": asdict(one.identity),
        "wiring": one.wiring.name,
        "assumed": dict(one.wiring.assumed),
        "ports": found_ports(),
        "chain": chain,
    }


def _test_parts(result: SelfTest) -> list[str | Table]:
    rise = DisplayUnit("10⁻⁶", 1e6, 1)
    columns = (
        Column("coil"),
        Column("f", unit="Hz", shown=DisplayUnit("MHz", 1e-6, 6)),
        Column("turned", "f reversed", "Hz", DisplayUnit("MHz", 1e-6, 6)),
        Column("felt_by", "sensed by"),
        *(
            Column(end, f"neighbour rises, {text} grounded", "1", rise)
            for end, text in (("both", "ends"), ("a", "end a"), ("b", "end b"))
        ),
    )
    rows = tuple(
        (
            check.coil,
            *("" if value is None else value for value in (check.frequency, check.turned)),
            check.felt_by or "",
            *(check.rises.get(end, "") for end in ("both", "a", "b")),
        )
        for check in result.coils
    )
    # of coils at channels nothing but f is measured
    parts: list[str | Table] = [Table("self_test", "", columns, rows).without_empty_columns()]
    if result.passed:
        parts.append("self-test passed: the board agrees with its wiring, as far as the test can show")
        title = "one question is left open; press on a coil in `coilarray board live` to settle it:"
        listed = [(title, result.untested)]
    else:
        listed = [("self-test failed:", result.symptoms), ("any one of these explains it:", result.findings)]
    for title, lines in listed:
        more = [f"  … and {len(lines) - _MOST_LINES} more (--json)"] if len(lines) > _MOST_LINES else []
        parts += [title, *(f"  {line}" for line in lines[:_MOST_LINES]), *more] if lines else []
    if not (result.passed or result.findings):
        parts.append("no single known fault explains it")
    return parts


@board_command()
def measure(
    design: shared.DesignArgument = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Recording to write (SQLite); run.sqlite by default, none with --single."),
    ] = None,
    scans: Annotated[
        int | None,
        typer.Option(help="Number of scans, including those already recorded with --resume; 100 by default."),
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(help="Duration instead of a number of scans, by the clock of the board.")
    ] = None,
    single: Annotated[
        bool, typer.Option("--single", help="Print one scan; write a file only where --out names one.")
    ] = False,
    resume: shared.Resume = False,
    *,
    options: BoardOptions,
    as_json: shared.AsJson = False,
) -> None:
    """Measure with a board and record every scan.

    The raw words of a scan are in the file as soon as they arrive: a run that is killed loses at
    most the scan in progress. A recording is never overwritten, --resume continues it. Without
    --port an emulator replaces the board, in virtual time, and every line of the output says so.
    `coilarray board info` shows and converts a recording, and `coilarray board campaign` measures
    the response to an indenter on a grid.

    Example: coilarray board measure gast2020 --port /dev/ttyACM0 --scans 500 --out run.sqlite

    Example: coilarray board measure starter --port "i2c:1?channels=0,1" --settings board.toml
    --single
    """
    modes = {"--single": single, "--scans": scans is not None, "--seconds": seconds is not None}
    given = [name for name, is_given in modes.items() if is_given]
    if len(given) > 1:
        raise HardwareError(f"{' and '.join(given)} cannot be given together.")
    if scans is not None and not 1 <= scans <= _MOST_SCANS:
        raise HardwareError(f"--scans must be 1 to {_MOST_SCANS}; got {scans}.")
    if seconds is not None and not 0 < seconds <= _LONGEST:
        raise HardwareError(f"--seconds must be positive and at most {_LONGEST:g}; got {seconds:g}.")
    if single and resume:
        raise HardwareError("--resume is not for --single.")
    path = out or RUN
    shared.check_file("--out", path, None)
    opened = options.design_file(design).design
    from coilarray.hardware.record.recorder import begin_session, open_recorder, record_stream

    with (
        nullcontext() if single and out is None else open_recorder(path, resume=resume) as recorder,
        shared.progress_bar("scans") as progress,
        opened_board(options, opened, real_time=False, progress=progress) as (board, settings),
    ):
        if single or recorder is None:
            raw = board.reader.scan()
            if recorder is not None:
                recorder.start(begin_session(board, settings, opened), thermometer=board.thermometer)
                recorder.add(raw, "single")
            _print_scan(raw, board, settings, opened, as_json=as_json)
            return
        with recorded_session(recorder, board, settings, opened, quiet=as_json):
            there, wanted = recorder.count(), scans or _SCANS
            if seconds is not None:
                record_stream(board.reader, recorder, seconds=seconds, progress=progress)
            elif there < wanted:
                record_stream(
                    board.reader,
                    recorder,
                    scans=wanted - there,
                    progress=lambda done, _: progress(there + done, wanted),
                )
    summary = print_recording(path, as_json=as_json)
    rate = summary["rate_per_s"]
    if not as_json and options.rate is not None and rate is not None and rate < _MET * options.rate:
        text = f"the board reached {rate:.4g} scans/s; --rate asked for {options.rate:g}"
        shared.say(text, emulated=summary["emulated"])


@contextmanager
def recorded_session(
    recorder: Recorder, board: Board, settings: ScanSettings, design: Design, plan: str | None = None, *, quiet: bool
) -> Iterator[None]:
    """Record a session, and after a failure count kept scans."""
    from coilarray.hardware.record.recorder import begin_session

    recorder.start(begin_session(board, settings, design), plan, board.thermometer)
    if not quiet:
        shared.say(board.line, emulated=board.emulated)
    try:
        yield
    except BaseException:
        kept = f"coilarray: {recorder.count()} scans are kept in {recorder.path}; --resume continues from there"
        shared.say(kept, err=True, emulated=board.emulated)
        raise


def print_recording(path: Path, *, as_json: bool) -> dict[str, Any]:
    """Print a summary of a recording, and return it."""
    from coilarray.hardware.record.recording import open_recording, summarize_recording

    with open_recording(path) as recording:
        summary = summarize_recording(recording)
    shared.print_result(summary, as_json=as_json, lines=summary_parts(summary), emulated=summary["emulated"])
    return summary


def _print_scan(raw: RawScan, board: Board, settings: ScanSettings, design: Design, *, as_json: bool) -> None:
    from coilarray.hardware.scan.readings import read_scan

    scan = read_scan(raw, settings, design.circuit.switches.tank_capacitance)
    states = [
        {
            "state": state.name,
            "frequency_Hz": state.frequency,
            "inductance_H": state.inductance,
            "verdict": state.verdict,
            "reasons": [str(reason) for reason in state.reasons],
        }
        for state in scan.states
    ]
    rows = [
        (state.name, *reading_cells(state.frequency, state.inductance), state.verdict, ", ".join(state.reasons))
        for state in scan.states
    ]
    table = text_table(("state", "f (MHz)", "L_eff (µH)", "verdict", "why"), rows)
    data = {"emulated": board.emulated, "board": board.line, "time_s": scan.time, "states": states}
    shared.print_result(data, as_json=as_json, lines=[board.line, table], emulated=board.emulated)


@board_command()
def campaign(
    design: shared.DesignArgument = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Recording to write (SQLite).")] = RUN,
    resume: shared.Resume = False,
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
    as_json: shared.AsJson = False,
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
    from coilarray.cli.board.files import CampaignPlan, read_file

    shared.check_file("--out", out, None)
    file, opened = read_file(CampaignPlan, "plan", plan), options.design_file(design).design
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
    from coilarray.hardware.wire.buses import Clock
    from coilarray.response.dataset import map_origin

    rows = (file.x, file.y, file.depths)
    *along, depths = (None if row is None else [value * 1e-3 for value in row] for row in rows)
    x, y = shared.from_map_origin(opened.indentation, *along)
    grid = design_campaign(
        opened, x=x, y=y, depths=depths, repeats=file.repeats, scans=file.average, dwell=file.dwell,
        speed=file.speed * 1e-3,
    )  # fmt: skip
    if dry_run:
        counts = f"{len(grid.x)} × {len(grid.y)} positions, {len(grid.depths)} depths, {grid.repeats} repeats"
        line = f"{counts}: {grid.size} indentations, at least {grid.seconds / 60:.1f} min without scans and travel"
        shared.print_result({**grid.to_record(), "least_seconds": grid.seconds}, as_json=as_json, lines=[line])
        return
    asked = not is_emulator(options.port) and stage is None

    def told(done: int, total: int) -> None:
        shared.say(f"{done} of {total} positions are measured.", err=True)

    with (
        open_recorder(out, resume=resume) as recorder,
        # a bar would overwrite the questions to a person
        nullcontext(told) if asked else shared.progress_bar("positions") as progress,
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
            clock = Clock() if board.emulator is None else board.emulator.clock
            reconnect = partial(_reconnect, board) if isinstance(board.reader, MicrocontrollerReader) else None
            run_campaign(grid, board.reader, moving, recorder, clock, progress=progress, reconnect=reconnect)
            after = self_test(board.reader, board.wiring, settings)
            recorder.add_self_test(after.symptoms, after.findings)
    print_recording(out, as_json=as_json)


def _reconnect(board: Board) -> Reader:
    """Reopen a microcontroller that restarted, unlike other boards."""
    board.reader = cast("MicrocontrollerReader", board.reader).reconnect(_PATIENCE)
    return board.reader


def _stage(stage: StageTable | None, board: Board, origin: tuple[float, float], *, yes: bool) -> Stage:
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
    _answer(f"{text} Then press Enter. ")


def _agree(text: str) -> None:
    if _answer(f"{text} [y/N] ").strip().lower() not in ("y", "yes"):
        raise HardwareError("the move of the stage was not confirmed.")


def _answer(text: str) -> str:
    typer.echo(text, nl=False, err=True)
    answer = sys.stdin.readline()
    if not answer:
        raise HardwareError("no answer: standard input has ended.")
    return answer
