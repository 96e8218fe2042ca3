"""``coilarray measure``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from coilarray.cli.board_options import (
    EMULATOR,
    BoardOptions,
    ClockMHz,
    Coils,
    Drive,
    Emulate,
    ExternalClock,
    Port,
    Rate,
    WiringName,
    marked,
    opened_board,
)
from coilarray.cli.maps import check_file
from coilarray.cli.scan_info import print_summary
from coilarray.cli.shared import (
    AllowViolations,
    AsJson,
    DesignArgument,
    lengths,
    open_design,
    print_json,
    progress_bar,
    table_text,
)
from coilarray.errors import HardwareError

if TYPE_CHECKING:
    from coilarray.compute.threads import Progress
    from coilarray.design.model import Design
    from coilarray.hardware.board.connect import Board
    from coilarray.hardware.board.self_test import SelfTest
    from coilarray.hardware.record.campaign import Campaign
    from coilarray.hardware.record.recorder import Recorder
    from coilarray.hardware.record.stages import Stage
    from coilarray.hardware.scan.reader import Reader
    from coilarray.hardware.scan.settings import ScanSettings

_SCANS, _MOST_SCANS = 100, 100_000_000
_LONGEST = 1e7  # s
_PERSON = "person"
_DIALECTS = ("grbl", "marlin")
_RUN = "run.sqlite"
_CLEARANCE = 2e-3  # m
_PATIENCE = 10.0  # s in which the port of a board that restarted may come back
_REACHED = 0.98  # of --rate, below which the rate is told


def measure(
    design: DesignArgument = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Recording to write (SQLite); run.sqlite by default, none with --single."),
    ] = None,
    scans: Annotated[
        int | None, typer.Option("--scans", help="Scans, with those that --resume finds; 100 by default.")
    ] = None,
    seconds: Annotated[float | None, typer.Option("--seconds", help="Or how long, by the board's clock.")] = None,
    single: Annotated[
        bool, typer.Option("--single", help="Print one scan; a file only where --out names one.")
    ] = False,
    campaign: Annotated[
        bool,
        typer.Option("--campaign", help="Press on a grid; at every position: baseline, indent, dwell, peak, relax."),
    ] = False,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the recording, where it is there.")] = False,
    x_mm: Annotated[
        str | None,
        typer.Option("--x-mm", help="Positions from the map's origin, as 0,5 or START:STOP:COUNT; the design's."),
    ] = None,
    y_mm: Annotated[str | None, typer.Option("--y-mm", help="The same along y.")] = None,
    depth_mm: Annotated[str | None, typer.Option("--depth-mm", help="Depths likewise.")] = None,
    repeats: Annotated[int | None, typer.Option("--repeats", help="Of the whole grid; 1 by default.")] = None,
    average: Annotated[
        int | None, typer.Option("--average", help="Scans at every baseline and every peak; 1 by default.")
    ] = None,
    dwell_s: Annotated[
        float | None, typer.Option("--dwell-s", help="Pressed in, before the peak is measured; 0.5 by default.")
    ] = None,
    speed_mm_s: Annotated[
        float | None, typer.Option("--speed-mm-s", help="Of pressing in and lifting off; 1.5 by default.")
    ] = None,
    stage: Annotated[
        str | None,
        typer.Option(
            "--stage",
            help="What moves the indenter: person, who is asked (by default, with a real board); grbl:PORT or "
            "marlin:PORT, homed, x and y of the map, z = 0 where the indenter touches.",
        ),
    ] = None,
    reach_mm: Annotated[
        str | None,
        typer.Option("--reach-mm", metavar="XMIN,XMAX,YMIN,YMAX,DEPTH", help="Where a stage of G-code may go."),
    ] = None,
    clearance_mm: Annotated[
        float | None,
        typer.Option(
            "--clearance-mm", help="Height at which such a stage travels and baselines are measured; 2 by default."
        ),
    ] = None,
    ignore_self_test: Annotated[
        bool, typer.Option("--ignore-self-test", help="Go on with a campaign though a self-test has failed.")
    ] = False,
    port: Port = EMULATOR,
    wiring: WiringName = None,
    rate: Rate = None,
    clock_mhz: ClockMHz = None,
    external_clock: ExternalClock = False,
    drive: Drive = None,
    coil: Coils = None,
    emulate: Emulate = None,
    as_json: AsJson = False,
    allow_violations: AllowViolations = False,
) -> None:
    """Measure with a board and record every scan.

    The raw words of a scan are in the file as soon as they come: a run that is killed loses at most the scan in flight.
    A recording is never overwritten; --resume goes on with it. A campaign begins and ends with a self-test of switches
    and coils, since scans alone do not show every fault. Without --port an emulator stands in for the board, in
    virtual time, and says so on every line. `coilarray scan-info` shows and converts a recording.

    Example: coilarray measure gast2020 --port /dev/ttyACM0 --scans 500 --out run.sqlite

    Example: coilarray measure gast2020 --campaign --out campaign.sqlite
    """
    modes = {"--single": single, "--campaign": campaign, "--scans": scans is not None, "--seconds": seconds is not None}
    given = [name for name, is_given in modes.items() if is_given]
    if len(given) > 1:
        raise HardwareError(f"{' and '.join(given)} cannot be given together.")
    if scans is not None and not 1 <= scans <= _MOST_SCANS:
        raise HardwareError(f"--scans must be 1 to {_MOST_SCANS}; got {scans}.")
    if seconds is not None and not 0 < seconds <= _LONGEST:
        raise HardwareError(f"--seconds must be positive and at most {_LONGEST:g}; got {seconds:g}.")
    options = BoardOptions(port, wiring, rate, clock_mhz, external_clock, drive, coil, emulate)
    x, y, depths = (
        None if text is None else lengths(option, text)
        for option, text in (("--x-mm", x_mm), ("--y-mm", y_mm), ("--depth-mm", depth_mm))
    )
    of_campaign = {
        "--x-mm": x,
        "--y-mm": y,
        "--depth-mm": depths,
        "--repeats": repeats,
        "--average": average,
        "--dwell-s": dwell_s,
        "--speed-mm-s": speed_mm_s,
        "--stage": stage,
        "--reach-mm": reach_mm,
        "--clearance-mm": clearance_mm,
        "--ignore-self-test": ignore_self_test or None,
    }
    if not campaign:
        _refuse_given("for --campaign", of_campaign)
        if single:
            _refuse_given("not for --single", {"--resume": resume or None})
    path = out or Path(_RUN)
    check_file("--out", path, None)
    opened = open_design(design, allow_violations=allow_violations)
    if single:
        _single(options, opened, out, as_json=as_json)
        return
    from coilarray.hardware.record.campaign import DWELL, SPEED, design_campaign
    from coilarray.hardware.record.recorder import begin_session, open_recorder

    plan = mover = None
    asked = campaign and port != EMULATOR and stage in (None, _PERSON)
    if campaign:
        mover = _mover(stage, reach_mm, clearance_mm, port)
        plan = design_campaign(
            opened,
            x=x,
            y=y,
            depths=depths,
            repeats=1 if repeats is None else repeats,
            scans=1 if average is None else average,
            dwell=DWELL if dwell_s is None else dwell_s,
            speed=SPEED if speed_mm_s is None else speed_mm_s * 1e-3,
        )
    with (
        open_recorder(path, resume=resume) as recorder,
        _positions_told() if asked else progress_bar("positions" if campaign else "scans") as progress,
        opened_board(options, opened, real_time=False, progress=progress) as (board, settings),
        nullcontext() if plan is None or mover is None else closing(mover(board)) as moving,
    ):
        if plan is not None and moving is not None:
            moving.check(plan.places)
        before = None if plan is None else _tested(board, settings, "before", ignore=ignore_self_test)
        session = begin_session(board.identity, port, settings, board.wiring.name, opened)
        recorder.start(session, None if plan is None else plan.to_json())
        if not as_json:
            typer.echo(marked(board.line, emulated=board.emulated))
        try:
            if plan is not None and moving is not None and before is not None:
                recorder.add_self_test(before.symptoms, before.findings)
                _campaign(plan, board, moving, recorder, progress)
                after = _tested(board, settings, "after", ignore=True)
                recorder.add_self_test(after.symptoms, after.findings)
            else:
                _stream(board, recorder, scans, seconds, progress)
        except BaseException:
            kept = f"coilarray: {recorder.count()} scans are kept in {path}; --resume goes on from there"
            typer.echo(marked(kept, emulated=board.emulated), err=True)
            raise
    _print_result(path, rate, as_json=as_json)


def _refuse_given(what: str, options: Mapping[str, object]) -> None:
    """Refuse options that would be ignored."""
    given = [name for name, value in options.items() if value is not None]
    if given:
        raise HardwareError(f"{' and '.join(given)} {'is' if len(given) == 1 else 'are'} {what}.")


def _tested(board: Board, settings: ScanSettings, when: str, *, ignore: bool) -> SelfTest:
    """Try every switch and coil, and configure the board again."""
    from coilarray.hardware.board.self_test import self_test

    result = self_test(board.reader, board.wiring, settings)
    board.reader.configure(settings)
    if not (result.passed or ignore):
        raise HardwareError(
            f"the self-test {when} the campaign has failed: {result.symptoms[0]}; see `coilarray board --self-test`, "
            "or go on with --ignore-self-test."
        )
    return result


def _single(options: BoardOptions, design: Design, out: Path | None, *, as_json: bool) -> None:
    from coilarray.hardware.record.recorder import begin_session, open_recorder
    from coilarray.hardware.scan.readings import read_scan

    with (
        nullcontext() if out is None else open_recorder(out) as recorder,
        progress_bar("scan") as progress,
        opened_board(options, design, real_time=False, progress=progress) as (board, settings),
    ):
        raw = board.reader.scan()
        if recorder is not None:
            recorder.start(begin_session(board.identity, options.port, settings, board.wiring.name, design))
            recorder.add(raw, "single")
        scan = read_scan(raw, settings, design.circuit.switches.tank_capacitance)
        line, emulated = board.line, board.emulated
    if as_json:
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
        print_json({"emulated": emulated, "board": line, "time_s": scan.time, "states": states})
        return
    rows = [
        (
            state.name,
            "–" if state.frequency is None else f"{state.frequency * 1e-6:.6f}",
            "–" if state.inductance is None else f"{state.inductance * 1e6:.4f}",
            state.verdict,
            ", ".join(state.reasons),
        )
        for state in scan.states
    ]
    table = table_text(("state", "f in MHz", "L in µH", "verdict", "why"), rows)
    typer.echo(marked(f"{line}\n{table}", emulated=emulated))


def _stream(
    board: Board,
    recorder: Recorder,
    scans: int | None,
    seconds: float | None,
    progress: Progress,
) -> None:
    from coilarray.hardware.record.stream import record_stream

    if seconds is not None:
        record_stream(board.reader, recorder, seconds=seconds, progress=progress)
        return
    wanted, there = scans or _SCANS, recorder.count()
    if there < wanted:
        record_stream(
            board.reader,
            recorder,
            scans=wanted - there,
            progress=lambda done, _: progress(there + done, wanted),
        )


def _campaign(plan: Campaign, board: Board, stage: Stage, recorder: Recorder, progress: Progress) -> None:
    from coilarray.hardware.record.campaign import run_campaign
    from coilarray.hardware.wire.buses import ComputerClock

    clock = ComputerClock() if board.emulator is None else board.emulator.clock
    run_campaign(plan, board.reader, stage, recorder, clock, progress, reconnect=_reconnecting(board))


def _reconnecting(board: Board) -> Callable[[], Reader] | None:
    """Return what opens a microcontroller again that has restarted; other boards have nothing to open again."""
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
def _positions_told() -> Iterator[Progress]:
    """Tell the progress in lines: a bar would write over the questions to a person."""

    def told(done: int, total: int) -> None:
        typer.echo(f"{done} of {total} positions are measured.", err=True)

    yield told


def _mover(stage: str | None, reach_mm: str | None, clearance_mm: float | None, port: str) -> Callable[[Board], Stage]:
    """Return what makes the stage once the board is open; whatever cannot be a stage is refused here."""
    kind, _, stage_port = (stage or _PERSON).partition(":")
    if stage not in (None, _PERSON) and not (kind in _DIALECTS and stage_port):
        raise HardwareError(f"--stage must be {_PERSON}, grbl:PORT or marlin:PORT; got {stage!r}.")
    if stage is not None and port == EMULATOR:
        raise HardwareError("--stage is for a real board; the emulator has its own.")
    if (kind in _DIALECTS) != (reach_mm is not None):
        raise HardwareError("--reach-mm must be given with a stage of G-code, and with no other.")
    if clearance_mm is not None and reach_mm is None:
        raise HardwareError("--clearance-mm is for a stage of G-code.")
    if stage_port == port:
        raise HardwareError(f"--stage and --port must be different ports; got {port} twice.")
    from coilarray.hardware.record.gcode_stage import GcodeStage, Reach
    from coilarray.hardware.record.stages import EmulatedStage, PersonStage
    from coilarray.hardware.wire.serial_ports import open_serial_port

    if reach_mm is not None:
        reach = Reach(*_reach(reach_mm), _CLEARANCE if clearance_mm is None else clearance_mm * 1e-3)
        return lambda _: GcodeStage(open_serial_port(stage_port), reach, "marlin" if kind == "marlin" else "grbl")
    return lambda board: PersonStage(_ask) if board.emulator is None else EmulatedStage(board.emulator)


def _reach(reach_mm: str) -> tuple[tuple[float, float], tuple[float, float], float]:
    try:
        x_min, x_max, y_min, y_max, depth = (float(part) * 1e-3 for part in reach_mm.split(","))
    except ValueError:
        raise HardwareError(f"--reach-mm must be XMIN,XMAX,YMIN,YMAX,DEPTH; got {reach_mm!r}.") from None
    return (x_min, x_max), (y_min, y_max), depth


def _ask(text: str) -> None:
    """Show a text and wait for the Enter key."""
    typer.echo(f"{text} Then press Enter. ", nl=False, err=True)
    if not sys.stdin.readline():
        raise HardwareError("nobody answers: standard input has ended.")


def _print_result(out: Path, rate: float | None, *, as_json: bool) -> None:
    from coilarray.hardware.record.recording import open_recording
    from coilarray.hardware.record.recording_summary import summarize_recording

    with open_recording(out) as recording:
        summary = summarize_recording(recording)
    if as_json:
        print_json(summary.to_record())
        return
    print_summary(summary)
    if rate is not None and summary.rate is not None and summary.rate < _REACHED * rate:
        text = f"the board reached {summary.rate:.4g} scans/s; --rate asked for {rate:g}"
        typer.echo(marked(text, emulated=summary.emulated))
