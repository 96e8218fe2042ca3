"""``coilarray board live``, and the keys that it obeys."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray.cli.board.live_source import LiveOptions, live_readings, live_source, show_window
from coilarray.cli.board.options import BoardOptions, board_command
from coilarray.cli.shared import MARK, References, drop_output, marked, open_design_file, progress_bar
from coilarray.compute.display_units import number_text, true_minus
from coilarray.errors import HardwareError

if TYPE_CHECKING:
    from coilarray.design.model import DesignFile
    from coilarray.hardware.record.live_tracking import LiveReading, LiveState


@contextmanager
def pressed_keys() -> Iterator[Callable[[], str]]:
    """Yield a function that returns the newly pressed keys.

    The terminal is as it was when the block is left.
    """
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


_REDRAW = 0.1  # s, at least, from picture to picture
_BAR, _LEAST_SCALE = 40, 1e-4  # characters; δ at the end of a bar, at least
_FADE = 0.98  # of the scale of the bars from scan to scan


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
    reference: References = None,
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
    file = _design_file(design, asked)
    if plot:
        show_window(asked, file, locate=locate)
        return
    with ExitStack() as opened:
        with progress_bar(f"response of {file.design.name}") as progress:  # over before the first scan is shown
            source = opened.enter_context(live_source(asked, file.design, locate=locate, progress=progress))
        if not as_json and recording is None:
            typer.echo(source.line)
        if not as_json and asked.reference:
            typer.echo(marked(less_text(asked.reference), emulated=source.emulated))
        keys = opened.enter_context(pressed_keys())  # before the screen, which takes the place of standard output
        record = partial(live_record, emulated=source.emulated, reference=asked.reference)
        if as_json:
            show = _lines(lambda reading: json.dumps(record(reading), allow_nan=False))
        elif sys.stdout.isatty():
            show = opened.enter_context(_screen(source.emulated, asked.reference))
        else:
            show = _lines(lambda reading: marked(plain_line(reading), emulated=source.emulated))
        readings = live_readings(source, asked, lambda: keys().lower())
        for reading in opened.enter_context(closing(readings)):
            try:
                show(reading)
            except BrokenPipeError:  # the reader of the pipe has ended
                drop_output()
                return


def _design_file(design: str | None, asked: LiveOptions) -> DesignFile:
    """Return the given design, or the recording's."""
    if asked.recording is None:
        return asked.board.design_file(design)
    from coilarray.design.model import build_design_file
    from coilarray.hardware.record.recording import open_recording

    with open_recording(asked.recording) as opened:
        first = opened.sessions[0]
        if design is not None:
            return open_design_file(design, allow_violations=True)
        return build_design_file(first.design_document, first.design)


def _lines(text: Callable[[LiveReading], str]) -> Callable[[LiveReading], None]:
    """Return a function that prints a line per scan."""

    def show(reading: LiveReading) -> None:
        sys.stdout.write(text(reading) + "\n")
        sys.stdout.flush()

    return show


@contextmanager
def _screen(emulated: bool, reference: Sequence[str]) -> Iterator[Callable[[LiveReading], None]]:
    """Draw the latest scan, at most ten times a second."""
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
                lines = screen_lines(reading, scale, reference)
                picture.update(Text("\n".join(f"{mark}{line}" for line in lines), no_wrap=True), refresh=True)

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
    """Return the screen's lines of bars, position and rate.

    A bar is full at |δ| = `scale`.
    """
    width = max((len(state.name) for state in reading.states), default=0)
    lines = [f"δ in 10⁻⁶; a full bar is {scale * 1e6:.0f}"]
    for state in reading.states:
        why = "" if state.verdict == "good" and not state.reasons else f" {state.verdict}: {', '.join(state.reasons)}"
        bar = "█" * round(_BAR * min(abs(state.delta or 0.0) / scale, 1.0))
        lines.append(f"{state.name:<{width}} {_delta_text(state):>9} {bar:<{_BAR}}{why}")
    lines.append(_place_text(reading))
    rate = "–" if reading.rate is None else f"{reading.rate:.2f}"
    noise = "" if reading.noise is None else f", noise of δ {reading.noise:.1e} of each coil"
    if reading.common_noise is not None:
        noise += f", {reading.common_noise:.1e} common to all"
    less = f", {less_text(reference)}" if reference else ""
    beside = "".join(f", {text}" for text in _beside(reading))
    lines.append(f"{rate} scans/s, {reading.lost} lost{noise}{less}{beside}; z zero, q quit")
    return lines


def _delta_text(state: LiveState) -> str:
    if state.delta is None:
        return "bad" if state.verdict == "bad" else "–"
    return number_text(state.delta * 1e6, 1, "+")


def _place_text(reading: LiveReading) -> str:
    """Return the position, or why it is unknown."""
    if reading.waiting:
        from coilarray.localize.presses import baseline_text

        return baseline_text(reading.waiting)
    if reading.location is None:
        return reading.problem
    from coilarray.localize.inverse import mode_text

    found = reading.location
    places = "; or ".join(map(mode_text, found.modes)) if found.verdict in ("found", "border") else ""
    return f"{found.verdict}: {places}" if places else found.verdict
