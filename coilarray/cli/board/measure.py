"""``coilarray board measure``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray.cli.board.info import reading_cells, summary_parts
from coilarray.cli.board.options import BoardOptions, board_command, marked, opened_board, print_marked
from coilarray.cli.shared import AsJson, DesignArgument, Resume, check_file, progress_bar
from coilarray.errors import HardwareError

if TYPE_CHECKING:
    from coilarray.design.model import Design
    from coilarray.hardware.board.connect import Board
    from coilarray.hardware.record.recorder import Recorder
    from coilarray.hardware.scan.readings import RawScan
    from coilarray.hardware.scan.settings import ScanSettings

RUN = Path("run.sqlite")
_SCANS, _MOST_SCANS = 100, 100_000_000
_LONGEST = 1e7  # s
_MET = 0.98  # part of --rate below which a slower rate is reported


@board_command()
def measure(
    design: DesignArgument = None,
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
    resume: Resume = False,
    *,
    options: BoardOptions,
    as_json: AsJson = False,
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
    check_file("--out", path, None)
    opened = options.design(design)
    from coilarray.hardware.record.recorder import begin_session, open_recorder, record_stream

    with (
        nullcontext() if single and out is None else open_recorder(path, resume=resume) as recorder,
        progress_bar("scans") as progress,
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
        typer.echo(marked(text, emulated=summary["emulated"]))


@contextmanager
def recorded_session(
    recorder: Recorder, board: Board, settings: ScanSettings, design: Design, plan: str | None = None, *, quiet: bool
) -> Iterator[None]:
    """Record a session, and after a failure count kept scans."""
    from coilarray.hardware.record.recorder import begin_session

    recorder.start(begin_session(board, settings, design), plan, board.thermometer)
    if not quiet:
        typer.echo(marked(board.line, emulated=board.emulated))
    try:
        yield
    except BaseException:
        kept = f"coilarray: {recorder.count()} scans are kept in {recorder.path}; --resume continues from there"
        typer.echo(marked(kept, emulated=board.emulated), err=True)
        raise


def print_recording(path: Path, *, as_json: bool) -> dict[str, Any]:
    """Print a summary of a recording, and return it."""
    from coilarray.hardware.record.recording import open_recording, summarize_recording

    with open_recording(path) as recording:
        summary = summarize_recording(recording)
    print_marked(summary, summary_parts(summary), as_json=as_json, emulated=summary["emulated"])
    return summary


def _print_scan(raw: RawScan, board: Board, settings: ScanSettings, design: Design, *, as_json: bool) -> None:
    from coilarray.compute.table import text_table
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
    table = text_table(("state", "f in MHz", "L in µH", "verdict", "why"), rows)
    data = {"emulated": board.emulated, "board": board.line, "time_s": scan.time, "states": states}
    print_marked(data, [board.line, table], as_json=as_json, emulated=board.emulated)
