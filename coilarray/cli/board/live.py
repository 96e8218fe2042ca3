"""``coilarray board live``, and its readings for the page of the studio.

The page is the studio's, so that there is one display for both. A browser is on every system,
unlike a toolkit for windows, and can show a board at another computer.
"""

from __future__ import annotations

import json
import math
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray.cli import shared
from coilarray.cli.board.options import BoardOptions, board_command, is_emulator, opened_board
from coilarray.compute.display_units import PER_MILLION, number_text, true_minus
from coilarray.compute.table import fill
from coilarray.compute.threads import Progress
from coilarray.errors import HardwareError, OutputError

if TYPE_CHECKING:
    from coilarray.circuit.noise_budget import NoiseBudget
    from coilarray.design.model import Design, DesignFile, Indentation
    from coilarray.hardware.board.connect import Board
    from coilarray.hardware.record.live_tracking import LiveReading, LiveState
    from coilarray.hardware.scan.readings import ScanReading
    from coilarray.hardware.scan.settings import ScanSettings
    from coilarray.localize.forward import ForwardModel
    from coilarray.viz.studio.job import Link
    from coilarray.viz.studio.services import BoardFrame, BoardRequest

_REDRAW = 0.1  # s, at least, from picture to picture
_BAR, _LEAST_SCALE = 40, 1e-4  # characters; δ at the end of a bar, at least
_FADE = 0.98  # of the scale of the bars from scan to scan
QUIT, ZERO = "q", "z"  # orders to a display: end, or measure the baseline again
_MOST_SCANS = 100_000_000
_LONGEST_GAP = 5.0  # s that a replay waits at most from scan to scan
_LOCATE = 0.05  # s, at least, from position to position of a board
_TOUR = 3600.0  # s: duration of the path of the emulated finger
_STEP = 3.2  # s of the path at one place
_FIRST = 5  # points of the path until the finger has pressed once
_TOLD = 0.1  # s from message to message to the page
_LINGER = 5.0  # s to load the page again before the window counts as closed


@contextmanager
def pressed_keys() -> Iterator[Callable[[], str]]:
    """Yield a reader of newly pressed keys; the terminal is restored."""
    try:
        watched = sys.stdin.isatty() and sys.stdout.isatty()
    except ValueError:  # closed
        watched = False
    if not watched:
        yield lambda: ""
        return
    if sys.platform == "win32":
        import msvcrt

        def waiting() -> str:
            keys = ""
            while msvcrt.kbhit():
                keys += msvcrt.getwch()
            return keys

        yield waiting
        return
    import os
    import select
    import termios
    import tty

    keyboard = sys.stdin.fileno()

    def ready() -> str:
        keys = b""
        while select.select([keyboard], [], [], 0)[0]:
            more = os.read(keyboard, 64)
            if not more:
                break
            keys += more
        return keys.decode("ascii", errors="ignore")

    before = termios.tcgetattr(keyboard)
    try:
        tty.setcbreak(keyboard)
        yield ready
    finally:
        termios.tcsetattr(keyboard, termios.TCSADRAIN, before)


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
    locate: Annotated[bool, typer.Option("--locate/--no-locate", help="Find the position of the indentation.")] = True,
    scans: Annotated[int | None, typer.Option(help="End after this number of scans; never by default.")] = None,
    reference: shared.References = None,
    plot: Annotated[
        bool, typer.Option("--plot", help="Show curves, position and presses on a page in the browser.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Recording of every scan to write (SQLite); none by default.")
    ] = None,
    *,
    options: BoardOptions,
    as_json: Annotated[bool, typer.Option("--json", help="Print one line of JSON in SI units for each scan.")] = False,
) -> None:
    """Show δ of every coil and the position, scan by scan.

    The first scans, without an indentation, are the baseline. The key z measures it again, q ends.
    Piped output has one line for each scan. A press begins when δ exceeds noise and drift of the
    baseline. Without --port an emulator replaces the board, every line says so, and a finger moves
    over it unless --emulate says otherwise. Ctrl-C, or closing the window of --plot, leaves the
    board at rest: all coils grounded, the converter asleep. The file of --settings has the number
    of baseline scans, their noise and the speed of a replay.

    Example: coilarray board live gast2020 --port /dev/ttyACM0

    Example: coilarray board live gast2020 --port /dev/ttyACM0 --plot --out touches.sqlite
    --reference coil6

    Example: coilarray board live --recording run.sqlite
    """
    asked = LiveOptions(options, recording=recording, reference=tuple(reference or ()), scans=scans, out=out)
    if plot and as_json:
        raise HardwareError("--plot cannot be given with --json.")
    if recording is None:
        file = options.design_file(design)
    else:
        from coilarray.design.model import build_design_file
        from coilarray.hardware.record.recording import open_recording

        with open_recording(recording) as recorded:
            first = recorded.sessions[0]
            if design is not None:
                file = shared.open_design_file(design, allow_violations=True)
            else:
                file = build_design_file(first.design_document, first.design)
    if plot:
        show_window(asked, file, locate=locate)
        return
    with ExitStack() as opened:
        with shared.progress_bar(f"response of {file.design.name}") as progress:  # over before the first scan is shown
            source = opened.enter_context(live_source(asked, file.design, locate=locate, progress=progress))
        if not as_json and recording is None:
            shared.say(source.line.removeprefix(shared.MARK), emulated=source.emulated)
        if not as_json and asked.reference:
            shared.say(less_text(asked.reference), emulated=source.emulated)
        keys = opened.enter_context(pressed_keys())  # before the screen, which takes the place of standard output
        record = partial(live_record, emulated=source.emulated, reference=asked.reference)
        if as_json:
            show = _lines(lambda reading: json.dumps(record(reading), allow_nan=False))
        elif sys.stdout.isatty():
            show = opened.enter_context(_screen(source.emulated, asked.reference))
        else:
            show = _lines(lambda reading: shared.marked(plain_line(reading), emulated=source.emulated))
        readings = live_readings(source, asked, lambda: keys().lower())
        for reading in opened.enter_context(closing(readings)):
            try:
                show(reading)
            except BrokenPipeError:  # the reader of the pipe has ended
                shared.drop_output()
                return


def _lines(text: Callable[[LiveReading], str]) -> Callable[[LiveReading], None]:

    def show(reading: LiveReading) -> None:
        sys.stdout.write(text(reading) + "\n")
        sys.stdout.flush()

    return show


@contextmanager
def _screen(emulated: bool, reference: Sequence[str]) -> Iterator[Callable[[LiveReading], None]]:
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
                width = (shared.terminal_width() or 80) - len(shared.MARK) * emulated
                text = fill("\n".join(screen_lines(reading, scale, reference)), width)
                picture.update(Text(shared.marked(text, emulated=emulated), no_wrap=True), refresh=True)

        yield show


def live_record(reading: LiveReading, *, emulated: bool, reference: Sequence[str] = ()) -> dict[str, Any]:
    """Return a reading for JSON, in SI units."""
    from coilarray.report.position import location_record

    return {
        "emulated": emulated,
        "sequence": reading.sequence,
        "time_s": reading.time,
        "rate_per_s": reading.rate,
        "lost": reading.lost,
        "baseline_scans_missing": reading.waiting,
        "noise": reading.noise,
        "common_noise": reading.common_noise,
        "delta": {state.name: state.delta for state in reading.states},
        **({"less_reference": list(reference)} if reference else {}),
        "verdicts": {state.name: state.verdict for state in reading.states},
        "reasons": {state.name: list(state.reasons) for state in reading.states if state.reasons},
        "position": reading.location and location_record(reading.location),
        "problem": reading.problem or None,
        "press": reading.press
        and {
            "number": reading.press.number,
            "begin_s": reading.press.begin,
            "end_s": reading.press.end,  # null while it lasts
            "delta": reading.press.delta,
            "position": reading.press.location and location_record(reading.press.location),
        },
        **({} if reading.temperature is None else {"temperature_C": reading.temperature}),
    }


def plain_line(reading: LiveReading) -> str:
    """Return a reading in one line for people."""
    states = (f"{state.name} {_delta_text(state)}" for state in reading.states)
    return "  ".join(
        part for part in (f"{reading.elapsed:.3f} s", *states, _place_text(reading), *_beside(reading)) if part
    )


def less_text(reference: Sequence[str]) -> str:
    """Say that δ is corrected."""
    return f"δ less that of {' and '.join(reference)}"


def _beside(reading: LiveReading) -> list[str]:
    """Return the rest of a line: press and temperature."""
    texts = []
    if reading.press is not None:
        begun = f"press {reading.press.number} since {reading.press.begin:.2f} s"
        ended = true_minus(f"press {reading.press.number} ended, δ {reading.press.delta * 1e6:+.1f}")
        texts.append(begun if reading.press.end is None else ended)
    if reading.temperature is not None:
        texts.append(true_minus(f"{reading.temperature:.2f} °C"))
    return texts


def screen_lines(reading: LiveReading, scale: float, reference: Sequence[str] = ()) -> list[str]:
    """Return the screen's lines; a bar is full at |δ| = `scale`."""
    width = max((len(state.name) for state in reading.states), default=0)
    lines = [f"δ in 10⁻⁶; a full bar is {scale * 1e6:.0f}"]
    for state in reading.states:
        why = "" if state.verdict == "good" and not state.reasons else f" {state.verdict}: {', '.join(state.reasons)}"
        bar = "█" * round(_BAR * min(abs(state.delta or 0.0) / scale, 1.0))
        lines.append(f"{state.name:<{width}} {_delta_text(state):>9} {bar:<{_BAR}}{why}")
    lines.append(_place_text(reading))
    rate = "–" if reading.rate is None else f"{reading.rate:.2f}"
    noise = "" if reading.noise is None else f", noise of δ {PER_MILLION.text(reading.noise, '.2')} of each coil"
    if reading.common_noise is not None:
        noise += f", {PER_MILLION.text(reading.common_noise, '.2')} common to all"
    less = f", {less_text(reference)}" if reference else ""
    beside = "".join(f", {text}" for text in _beside(reading))
    lines.append(f"{rate} scans/s, {reading.lost} lost{noise}{less}{beside}; z zero, q quit")
    return lines


def _delta_text(state: LiveState) -> str:
    if state.delta is None:
        return "bad" if state.verdict == "bad" else "–"
    return number_text(state.delta * 1e6, 1, "+")


def _place_text(reading: LiveReading) -> str:
    if reading.waiting:
        from coilarray.localize.presses import baseline_text

        return baseline_text(reading.waiting)
    if reading.location is None:
        return reading.problem
    from coilarray.localize.inverse import mode_text

    found = reading.location
    places = "; or ".join(map(mode_text, found.modes)) if found.verdict in ("found", "border") else ""
    return f"{found.verdict}: {places}" if places else found.verdict


@dataclass(frozen=True)
class LiveOptions:
    """Checked options of a live display, plain for another process."""

    board: BoardOptions
    recording: Path | None = None  # to be replayed instead of reading a board
    reference: tuple[str, ...] = ()  # states that nothing touches
    scans: int | None = None  # after which to end
    out: Path | None = None  # recording to write

    def __post_init__(self) -> None:
        names = ("port", "wiring", "rate", "emulate")
        given = [f"--{one}" for one in names if getattr(self.board, one) not in (getattr(BoardOptions, one), [])]
        if self.recording is not None and given:
            raise HardwareError(
                f"--recording replays a file; it cannot be given with {' and '.join(given)}, which "
                f"{'is' if len(given) == 1 else 'are'} for a board."
            )
        if self.scans is not None and not 1 <= self.scans <= _MOST_SCANS:
            raise HardwareError(f"--scans must be 1 to {_MOST_SCANS}; got {self.scans}.")
        if self.out is not None and self.recording is not None:
            raise HardwareError("--out records a board; it cannot be given with --recording.")
        shared.check_file("--out", self.out, None)


@dataclass(frozen=True)
class LiveSource:
    """Readings, each with whether the indenter rests, and their origin."""

    readings: Iterator[tuple[ScanReading, bool]]
    line: str  # for people
    emulated: bool
    states: tuple[str, ...]  # of a scan
    budget: NoiseBudget | None  # None for a design of another board
    begin: Callable[[], None] = lambda: None  # to be called once the baseline is complete
    model: ForwardModel | None = None  # for positions, if they are wanted


def live_readings(source: LiveSource, options: LiveOptions, orders: Callable[[], str]) -> Generator[LiveReading]:
    """Evaluate scan after scan, until `orders` returns `QUIT`."""
    # Positions are computed at most twenty times a second, so as never to delay the scans of a board.
    from coilarray.hardware.record.live_tracking import LiveTracker

    file = options.board.file
    tracker = LiveTracker(
        source.model,
        baseline_scans=file.baseline_scans,
        budget=source.budget,
        noise=file.noise,
        reference=options.reference,
    )
    limited = options.recording is None or file.replay_speed > 0
    located, begun = -math.inf, False
    for count, (scan, at_rest) in enumerate(source.readings, start=1):
        asked = orders()
        if QUIT in asked:
            return
        if ZERO in asked:
            tracker.rezero()
        wanted = not limited or time.monotonic() - located >= _LOCATE
        reading = tracker.take(scan, at_rest=at_rest, want_location=wanted)
        if reading.location is not None:
            located = time.monotonic()
        if not (begun or reading.waiting):
            begun = True
            source.begin()
        yield reading
        if count == options.scans:
            return


@contextmanager
def live_source(options: LiveOptions, design: Design, *, locate: bool, progress: Progress) -> Iterator[LiveSource]:
    """Open the recording or the board, which rests afterwards."""
    from coilarray.design.scan_states import referenced_names

    # A wrong port or file must fail before the table is computed, which may take minutes; the
    # emulator cannot.
    early = locate and options.recording is None and is_emulator(options.board.port)
    model = _model(design, progress) if early else None
    with _replay(options, design) if options.recording is not None else _stream(options, design, progress) as source:
        if options.reference:
            referenced_names(source.states, options.reference, HardwareError)
        if locate and not early:
            model = _model(design, progress)
        yield replace(source, model=model)


def _model(design: Design, progress: Progress) -> ForwardModel:
    from coilarray.localize.forward import forward_model
    from coilarray.response.dataset import on_board

    return forward_model(on_board(shared.stored_table(design, progress=progress)))


@contextmanager
def _stream(asked: LiveOptions, design: Design, progress: Progress) -> Iterator[LiveSource]:
    from coilarray.hardware.record.recorder import begin_session, open_recorder
    from coilarray.hardware.scan.readings import read_scan

    with ExitStack() as opened:
        recorder = None if asked.out is None else opened.enter_context(open_recorder(asked.out))
        board, settings = opened.enter_context(opened_board(asked.board, design, real_time=True, progress=progress))
        begin = _finger(board, design, asked.board)
        budget = _budget(asked, design, settings)
        capacitance = design.circuit.switches.tank_capacitance
        scans = opened.enter_context(closing(board.reader.scans()))
        if recorder is not None:
            recorder.start(begin_session(board, settings, design), thermometer=board.thermometer)

        def readings() -> Iterator[tuple[ScanReading, bool]]:
            for scan in scans:
                if recorder is not None:
                    recorder.add(scan, "stream")
                temperature = None if board.thermometer is None else board.thermometer()
                yield read_scan(scan, settings, capacitance, temperature=temperature), True

        line, states = (
            shared.marked(board.line, emulated=board.emulated),
            tuple(state.name for state in settings.states),
        )
        yield LiveSource(readings(), line, board.emulated, states, budget, begin)


def _budget(asked: LiveOptions, design: Design, settings: ScanSettings) -> NoiseBudget | None:
    if asked.board.file.noise is not None or not {one.name for one in settings.states} <= {
        one.name for one in design.plan
    }:
        return None
    from coilarray.hardware.scan.settings import board_budget

    return board_budget(design, settings, baseline_scans=asked.board.file.baseline_scans)


def _finger(board: Board, design: Design, options: BoardOptions) -> Callable[[], None]:
    """Return a mover of an emulator's finger after the baseline."""
    from coilarray.hardware.emulator.board import Place

    emulator, setup = board.emulator, design.indentation
    if emulator is None:
        return lambda: None
    press = options.press_on(design)
    if press is not None:
        emulator.world.check(Place(*press))
        return partial(emulator.indenter.press, *press)
    if setup is None:
        return lambda: None
    for _, *place in tour(setup, 0.0)[:_FIRST]:
        emulator.world.check(Place(*place))
    return lambda: emulator.indenter.follow(tour(setup, emulator.clock.now()))


@contextmanager
def _replay(options: LiveOptions, design: Design) -> Iterator[LiveSource]:
    from coilarray.hardware.record.recording import open_recording
    from coilarray.hardware.scan.readings import read_scan

    path, speed = options.recording or Path(), options.board.file.replay_speed
    with open_recording(path) as recording:

        def readings() -> Generator[tuple[ScanReading, bool]]:
            session, when = -1, 0.0
            with closing(recording.scans()) as scans:
                for one in scans:
                    if one.session == session and speed > 0:
                        time.sleep(min(max((one.scan.time - when) / speed, 0.0), _LONGEST_GAP))
                    session, when = one.session, one.scan.time
                    own = recording.sessions[session]
                    reading = read_scan(one.scan, own.settings, own.capacitances, temperature=one.temperature)
                    yield reading, not (one.depth or 0.0) > 0

        line = f"{path.name}: recording of {recording.sessions[0].identity.kind}, design {recording.sessions[0].design}"
        with closing(readings()) as replayed:
            yield LiveSource(
                replayed,
                shared.marked(line, emulated=recording.emulated),
                recording.emulated,
                recording.states,
                _budget(options, design, recording.sessions[0].settings),
            )


def tour(setup: Indentation, start: float) -> list[tuple[float, float, float, float]]:
    """Path of a finger over the map: s, then m."""
    path = [(start, setup.x[0], setup.y[0], 0.0)]
    for k in range(int(_TOUR / _STEP)):
        at = start + k * _STEP
        # multiples of the golden ratio and √2: places that spread evenly and never repeat
        x = setup.x[0] + (setup.x[-1] - setup.x[0]) * ((0.5 + k * 0.6180339887498949) % 1)
        y = setup.y[0] + (setup.y[-1] - setup.y[0]) * ((0.5 + k * 0.4142135623730951) % 1)
        depth = setup.depths[-1] * (1.0 - 0.4 * (k % 3) / 2)
        path += [(at + 0.5, x, y, 0.0), (at + 1.0, x, y, depth), (at + 2.7, x, y, depth), (at + 3.0, x, y, 0.0)]
    return path


def show_window(options: LiveOptions, file: DesignFile, *, locate: bool) -> None:
    """Serve a page with the live display until closed."""
    from coilarray.viz.studio.services import LOOPBACK, Address, Services, bind, check_studio
    from coilarray.viz.studio.work import Shelf, work_on

    check_studio()
    from coilarray.viz.studio.server import serve

    if options.out is not None and options.out.exists():
        raise OutputError(f"--out: {options.out} exists; name another file.")
    failures: list[str] = []

    def ready(url: str) -> None:
        shared.say(f"live display: {url}  (Ctrl-C, or closing the page, ends it)")
        threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()

    services = Services(
        watch_board=partial(watch_board, options, locate),
        port=options.board.port,
        recording=None if options.recording is None else str(options.recording),
        reference=options.reference,
        log=None if options.out is None else str(options.out),
        alone=True,
        failed=failures.append,
    )
    with bind(Address(LOOPBACK, 0)) as listening, suppress(KeyboardInterrupt):
        work = work_on(file, file.design.name)
        serve(work, Shelf(Path.cwd()), services, Address(LOOPBACK, 0), listening, linger=_LINGER, ready=ready)
    if failures:
        raise HardwareError(failures[-1])


# This runs in a process of its own, and is therefore a function of a module with plain arguments.


def watch_board(base: LiveOptions, locate: bool, request: BoardRequest, link: Link) -> None:
    """Send readings to a page, other options from `base`."""
    from coilarray.design.model import build_design
    from coilarray.viz.studio.services import BoardFrame

    design, board = build_design(request.document, request.name), base.board
    if request.recording is not None:
        board = replace(BoardOptions(), settings=board.settings)
    elif request.port != board.port:
        board = replace(board, port=request.port, emulate=board.emulate if is_emulator(request.port) else None)
    options = replace(
        base,
        board=board,
        recording=None if request.recording is None else Path(request.recording),
        reference=tuple(request.reference),
        out=None if request.log is None or request.recording is not None else Path(request.log),
    )

    def wait(done: int, total: int) -> None:
        part = f" {100 * done / total:.0f} %" if total else ""
        name, emulated = request.recording or request.port, request.recording is None and is_emulator(request.port)
        link.send([BoardFrame(f"{name}; response of the design{part} …", emulated, 0, {})])

    frames: list[BoardFrame] = []
    sent = -math.inf
    locates = locate and design.indentation is not None
    with (
        live_source(options, design, locate=locates, progress=wait) as source,
        closing(live_readings(source, options, link.orders)) as readings,
    ):
        for reading in readings:
            states = reading.states
            frames.append(
                BoardFrame(
                    line=source.line,
                    emulated=source.emulated,
                    sequence=reading.sequence,
                    delta={state.name: state.delta for state in states},
                    reasons={one.name: f"{one.verdict}: {', '.join(one.reasons)}" for one in states if one.reasons},
                    waiting=reading.waiting,
                    location=reading.location,
                    problem=reading.problem,
                    rate=reading.rate,
                    lost=reading.lost,
                    time=reading.elapsed,
                    press=reading.press,
                    temperature=reading.temperature,
                )
            )
            if time.monotonic() - sent >= _TOLD:
                link.send(frames)
                frames, sent = [], time.monotonic()
        link.send(frames)
