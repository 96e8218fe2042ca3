"""``coilarray live``."""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray.cli.board_options import EMULATOR, MARK, BoardOptions, board_command, marked, opened_board
from coilarray.cli.keys import pressed_keys
from coilarray.cli.maps import kept_table
from coilarray.cli.shared import AllowViolations, check_file, open_design, progress_bar
from coilarray.errors import HardwareError

if TYPE_CHECKING:
    from coilarray.design.model import Design, Indentation
    from coilarray.hardware.board.connect import Board
    from coilarray.hardware.record.live_tracking import LiveReading, LiveState, LiveTracker
    from coilarray.hardware.scan.readings import ScanReading
    from coilarray.localize.forward import ForwardModel
    from coilarray.localize.inverse import Mode

_MOST_SCANS = 100_000_000
_FASTEST = 1000.0  # times the recorded speed
_LONGEST_GAP = 5.0  # s that a replay waits at most from scan to scan
_REDRAW = 0.1  # s, at least, from picture to picture
_LOCATE = 0.05  # s, at least, from position to position of a board
_BAR, _LEAST_SCALE = 40, 1e-4  # characters; δ at the end of a bar, at least
_FADE = 0.98  # of the scale of the bars from scan to scan
_BLOCKS = " ▏▎▍▌▋▊▉█"
_TOUR = 3600.0  # s: duration of the path of the emulated finger
_STEP = 3.2  # s of the path at one place
_FIRST = 5  # points of the path until the finger has pressed once
_LOCATED = ("found", "border")  # verdicts whose positions are shown
_SHOWN = 2  # positions in a line


@dataclass(frozen=True)
class _Source:
    """Readings, each with whether the indenter is at rest; `begin` is called once the baseline is complete."""

    readings: Iterator[tuple[ScanReading, bool]]
    emulated: bool
    begin: Callable[[], None] = lambda: None


@board_command()
def live(
    design: Annotated[
        str | None,
        typer.Argument(
            metavar="DESIGN",
            help="Design file (TOML) or name of a bundled design; gast2020, or that of the recording, by default.",
        ),
    ] = None,
    recording: Annotated[
        Path | None, typer.Option(help="Replay a recording (.sqlite) instead of reading a board.")
    ] = None,
    speed: Annotated[float, typer.Option(help="Speed of a replay: 1 as it was recorded, 0 without any waiting.")] = 1.0,
    table: Annotated[
        Path | None, typer.Option(help="Where the table for positions is kept (.nc); in the user's cache by default.")
    ] = None,
    locate: Annotated[bool, typer.Option("--locate/--no-locate", help="Also find where the indentation is.")] = True,
    baseline: Annotated[
        int,
        typer.Option("--baseline-scans", help="Number of first scans, without an indentation, from which δ counts."),
    ] = 10,
    noise: Annotated[
        float | None,
        typer.Option(
            help="Standard deviation of δ; that of the readings is added. That of the design's noise budget by default."
        ),
    ] = None,
    scans: Annotated[int | None, typer.Option(help="Number of scans after which to end; never by default.")] = None,
    *,
    options: BoardOptions,
    as_json: Annotated[bool, typer.Option("--json", help="One line of JSON in SI units for each scan.")] = False,
    allow_violations: AllowViolations = False,
) -> None:
    """Show δ of every coil and where the indentation is, scan by scan.

    The first scans, without an indentation, are the baseline; the key z measures it again, q ends. Piped, it prints a
    line for each scan. Without --port an emulator replaces the board, every line says so, and a finger moves over it
    unless --emulate says otherwise. Ctrl-C leaves the board at rest: all coils grounded, the converter asleep.

    Example: coilarray live gast2020 --port /dev/ttyACM0

    Example: coilarray live --recording run.sqlite --speed 10
    """
    if recording is not None and (options.port != EMULATOR or options.emulate):
        raise HardwareError("--recording replays a file; it cannot be given with --port or --emulate.")
    if scans is not None and not 1 <= scans <= _MOST_SCANS:
        raise HardwareError(f"--scans must be 1 to {_MOST_SCANS}; got {scans}.")
    if not 0 <= speed <= _FASTEST:
        raise HardwareError(f"--speed must be 0 to {_FASTEST:g}; got {speed:g}.")
    check_file("--table", table, (".nc",))
    from coilarray.hardware.record.live_tracking import LiveTracker

    LiveTracker(
        None, baseline_scans=baseline, noise=noise
    )  # refuses invalid options before anything is opened or computed
    with ExitStack() as opened:
        if recording is not None:
            board, source = opened.enter_context(_replay(recording, design, speed))
            model = _model(board, table) if locate else None
        else:
            board = open_design(design, allow_violations=allow_violations)
            model = _model(board, table) if locate else None
            source = opened.enter_context(_stream(options, board, quiet=as_json))
        if as_json:
            show = _lines(lambda reading: json.dumps(live_record(reading, emulated=source.emulated), allow_nan=False))
        elif sys.stdout.isatty():
            show = opened.enter_context(_screen(source.emulated))
        else:
            show = _lines(lambda reading: marked(plain_line(reading), emulated=source.emulated))
        keys = opened.enter_context(pressed_keys())
        tracker = LiveTracker(model, baseline_scans=baseline, noise=noise)
        _run(source, tracker, show, keys, scans, limited=recording is None or speed > 0)


def _run(
    source: _Source,
    tracker: LiveTracker,
    show: Callable[[LiveReading], None],
    keys: Callable[[], str],
    scans: int | None,
    *,
    limited: bool,
) -> None:
    """Show scan after scan; `limited` limits how often a position is computed."""
    located, begun = -math.inf, False
    for count, (scan, at_rest) in enumerate(source.readings, start=1):
        pressed = keys().lower()
        if "q" in pressed:
            return
        if "z" in pressed:
            tracker.rezero()
        wanted = not limited or time.monotonic() - located >= _LOCATE
        reading = tracker.take(scan, at_rest=at_rest, want_location=wanted)
        if reading.location is not None:
            located = time.monotonic()
        if not (begun or reading.waiting):
            begun = True
            source.begin()
        try:
            show(reading)
        except BrokenPipeError:  # the reader of the pipe has ended; Python would raise again on closing the stream
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return
        if count == scans:
            return


@contextmanager
def _stream(options: BoardOptions, design: Design, *, quiet: bool) -> Iterator[_Source]:
    """Yield the readings of a board, which rests afterwards."""
    from coilarray.hardware.scan.readings import read_scan

    lifted = replace(options, emulate=[text for text in options.emulate or () if text not in _held_back(options)])
    with ExitStack() as opened:
        with progress_bar("emulator") as progress:  # over before the first scan is shown
            board, settings = opened.enter_context(opened_board(lifted, design, real_time=True, progress=progress))
            begin = _finger(board, design, options)
        if not quiet:
            typer.echo(marked(board.line, emulated=board.emulated))

        capacitance = design.circuit.switches.tank_capacitance
        scans = opened.enter_context(closing(board.reader.scans()))
        yield _Source(((read_scan(scan, settings, capacitance), True) for scan in scans), board.emulated, begin)


def _finger(board: Board, design: Design, options: BoardOptions) -> Callable[[], None]:
    """Return what moves the finger of an emulator after the baseline; compute here what that needs."""
    from coilarray.hardware.emulator.indenter import Place

    emulator, setup = board.emulator, design.indentation
    if emulator is None:
        return lambda: None
    path = options.path_of(design)
    if path is not None and _held_back(options):
        ((_, x, y, depth),) = path
        emulator.world.check(Place(x, y, depth))
        return lambda: emulator.indenter.press(x, y, depth)
    if path is not None or setup is None:
        return lambda: None
    for _, *place in _tour(setup, 0.0)[:_FIRST]:
        emulator.world.check(Place(*place))
    return lambda: emulator.indenter.follow(_tour(setup, emulator.clock.now()))


def _held_back(options: BoardOptions) -> list[str]:
    """Return the options of the emulator that take effect after the baseline: a finger that presses from the start."""
    return [text for text in options.emulate or () if text.startswith("press=")]


@contextmanager
def _replay(path: Path, design: str | None, speed: float) -> Iterator[tuple[Design, _Source]]:
    """Yield the design of a recording, and its readings in the recorded order and time."""
    from coilarray.hardware.record.recording import open_recording
    from coilarray.hardware.scan.readings import read_scan

    with open_recording(path) as recording:

        def readings() -> Generator[tuple[ScanReading, bool]]:
            session, when = -1, 0.0
            with closing(recording.scans()) as scans:
                for one in scans:
                    if one.session == session and speed > 0:
                        time.sleep(min(max((one.scan.time - when) / speed, 0.0), _LONGEST_GAP))
                    session, when = one.session, one.scan.time
                    own = recording.sessions[session]
                    yield read_scan(one.scan, own.settings, own.capacitances), not (one.depth or 0.0) > 0

        with closing(readings()) as replayed:
            opened = recording.design if design is None else open_design(design, allow_violations=True)
            yield opened, _Source(replayed, recording.emulated)


def _model(design: Design, table: Path | None) -> ForwardModel:
    """Return the forward model of a design; its table is kept for the next time."""
    from coilarray.localize.forward import forward_model
    from coilarray.response.coordinates import on_board

    return forward_model(on_board(kept_table(design, table)))


def _tour(setup: Indentation, start: float) -> list[tuple[float, float, float, float]]:
    """Return the path of a finger that presses all over the design's map: time in s, x, y and depth in m."""
    path = [(start, setup.x[0], setup.y[0], 0.0)]
    for k in range(int(_TOUR / _STEP)):
        at = start + k * _STEP
        # multiples of the golden ratio and √2: places that spread evenly and never repeat
        x = setup.x[0] + (setup.x[-1] - setup.x[0]) * ((0.5 + k * 0.6180339887498949) % 1)
        y = setup.y[0] + (setup.y[-1] - setup.y[0]) * ((0.5 + k * 0.4142135623730951) % 1)
        depth = setup.depths[-1] * (1.0 - 0.4 * (k % 3) / 2)
        path += [(at + 0.5, x, y, 0.0), (at + 1.0, x, y, depth), (at + 2.7, x, y, depth), (at + 3.0, x, y, 0.0)]
    return path


def _lines(text: Callable[[LiveReading], str]) -> Callable[[LiveReading], None]:
    """Return what prints one line per scan, at once."""

    def show(reading: LiveReading) -> None:
        sys.stdout.write(text(reading) + "\n")
        sys.stdout.flush()

    return show


@contextmanager
def _screen(emulated: bool) -> Iterator[Callable[[LiveReading], None]]:
    """Draw the latest scan on the terminal, at most ten times a second."""
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    drawn, scale = -math.inf, _LEAST_SCALE
    with Live(console=Console(highlight=False), auto_refresh=False, screen=False) as picture:

        def show(reading: LiveReading) -> None:
            nonlocal drawn, scale
            largest = max((abs(state.delta) for state in reading.states if state.delta is not None), default=0.0)
            scale = max(_LEAST_SCALE, largest, _FADE * scale)
            now = time.monotonic()
            if now - drawn >= _REDRAW:
                drawn = now
                mark = MARK if emulated else ""
                lines = screen_lines(reading, scale)
                picture.update(Text("\n".join(f"{mark}{line}" for line in lines), no_wrap=True), refresh=True)

        yield show


def live_record(reading: LiveReading, *, emulated: bool) -> dict[str, Any]:
    """Return a reading as a mapping for JSON, in SI units."""
    from coilarray.report.localize_tables import location_record

    return {
        "emulated": emulated,
        "sequence": reading.sequence,
        "time_s": reading.time,
        "rate_per_s": reading.rate,
        "lost": reading.lost,
        "baseline_scans_missing": reading.waiting,
        "noise": reading.noise,
        "delta": {state.name: state.delta for state in reading.states},
        "verdicts": {state.name: state.verdict for state in reading.states},
        "reasons": {state.name: list(state.reasons) for state in reading.states if state.reasons},
        "position": None if reading.location is None else location_record(reading.location),
        "problem": reading.problem or None,
    }


def plain_line(reading: LiveReading) -> str:
    """Return a reading in one line for people."""
    parts = [f"{reading.elapsed:.3f} s"]
    parts += [f"{state.name} {_delta_text(state)}" for state in reading.states]
    return "  ".join([*parts, _place_text(reading)])


def screen_lines(reading: LiveReading, scale: float) -> list[str]:
    """Return the lines of a picture: a bar for every state, which ends at δ = `scale`, the position, and the rate."""
    width = max((len(state.name) for state in reading.states), default=0)
    lines = [f"δ in 10⁻⁶; bars end at {scale * 1e6:.0f}"]
    for state in reading.states:
        why = "" if state.verdict == "good" and not state.reasons else f" {state.verdict}: {', '.join(state.reasons)}"
        bar = _bar(0.0 if state.delta is None else state.delta / scale)
        lines.append(f"{state.name:<{width}} {_delta_text(state):>9} {bar}{why}")
    lines.append(_place_text(reading))
    rate = "–" if reading.rate is None else f"{reading.rate:.2f}"
    noise = "" if reading.noise is None else f", noise of δ {reading.noise:.1e}"
    lines.append(f"{rate} scans/s, {reading.lost} lost{noise}; z zero, q quit")
    return lines


def _delta_text(state: LiveState) -> str:
    if state.delta is None:
        return "bad" if state.verdict == "bad" else "–"
    return f"{state.delta * 1e6:+.1f}".replace("-", "−")


def _bar(part: float) -> str:
    """Return a bar of up to 40 characters about a zero at a fifth of its length."""
    zero = _BAR // 5
    eighths = round(8 * min(max(part, -1.0), 1.0) * (_BAR - zero))
    if eighths >= 0:
        full, rest = divmod(eighths, 8)
        return (" " * zero + "│" + "█" * full + _BLOCKS[rest]).ljust(_BAR + 2)
    left = min(round(-eighths / 8), zero)
    return (" " * (zero - left) + "█" * left + "│").ljust(_BAR + 2)


def _place_text(reading: LiveReading) -> str:
    """Return where the indentation is, or why that is unknown."""
    if reading.waiting:
        return f"baseline: {reading.waiting} more scans without an indentation"
    if reading.location is None:
        return reading.problem
    from coilarray.report.localize_tables import location_record

    status = str(location_record(reading.location).get("status", reading.location.reason))
    if reading.location.verdict not in _LOCATED:
        return status
    modes = reading.location.modes
    more = f"; or {len(modes) - _SHOWN} more" if len(modes) > _SHOWN else ""
    return f"{status}: {'; or '.join(_mode_text(mode) for mode in modes[:_SHOWN])}{more}"


def _mode_text(mode: Mode) -> str:
    values = (mode.x, mode.y, mode.depth)
    parts = []
    for name, value, deviation in zip_longest(("x", "y", "depth"), values, mode.known_deviations):
        error = "" if deviation is None else f" ± {deviation * 1e3:.2f}"
        parts.append(f"{name} {value * 1e3:.2f}{error}")
    return ", ".join(parts).replace("-", "−") + " mm"
