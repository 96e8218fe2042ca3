"""Readings of a live display, of a board or of a recording, evaluated scan by scan and logged."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from coilarray.cli.board.options import BoardOptions, is_emulator, marked, opened_board
from coilarray.cli.shared import check_file
from coilarray.errors import HardwareError

if TYPE_CHECKING:
    from coilarray.circuit.noise_budget import NoiseBudget
    from coilarray.compute.threads import Progress
    from coilarray.design.model import Design, Indentation
    from coilarray.hardware.board.connect import Board
    from coilarray.hardware.record.live_tracking import LiveReading
    from coilarray.hardware.scan.readings import ScanReading
    from coilarray.hardware.scan.settings import ScanSettings
    from coilarray.localize.forward import ForwardModel

QUIT, ZERO = "q", "z"
"""Orders to a running display: end, and measure the baseline again."""

_MOST_SCANS = 100_000_000
_FASTEST = 1000.0  # times the recorded speed
_LONGEST_GAP = 5.0  # s that a replay waits at most from scan to scan
_LOCATE = 0.05  # s, at least, from position to position of a board
_TOUR = 3600.0  # s: duration of the path of the emulated finger
_STEP = 3.2  # s of the path at one place
_FIRST = 5  # points of the path until the finger has pressed once


@dataclass(frozen=True)
class LiveOptions:
    """Options of a live display, checked; plain values that can be sent to another process.

    Raises
    ------
    HardwareError, OutputError
        An invalid value: which option, and what is allowed.
    """

    board: BoardOptions
    recording: Path | None = None  # to be replayed instead of reading a board
    speed: float = 1.0  # of a replay, as multiple of the recorded one; 0 without any waiting
    baseline: int = 10  # scans
    noise: float | None = None  # of δ, beside that of the readings; that of the design's budget by default
    reference: tuple[str, ...] = ()  # states that nothing touches
    scans: int | None = None  # after which to end
    log: Path | None = None
    force: bool = False  # whether the log may replace a file

    def __post_init__(self) -> None:
        from coilarray.hardware.record.live_log import check_log
        from coilarray.hardware.record.live_tracking import LiveTracker

        if self.recording is not None and self.board.given:
            given = self.board.given
            raise HardwareError(
                f"--recording replays a file; it cannot be given with {' and '.join(given)}, which "
                f"{'is' if len(given) == 1 else 'are'} for a board."
            )
        if self.recording is None and self.speed != 1.0:
            raise HardwareError("--speed is for --recording; a board is read as fast as --rate says.")
        if self.scans is not None and not 1 <= self.scans <= _MOST_SCANS:
            raise HardwareError(f"--scans must be 1 to {_MOST_SCANS}; got {self.scans}.")
        if not 0 <= self.speed <= _FASTEST:
            raise HardwareError(f"--speed must be 0 to {_FASTEST:g}; got {self.speed:g}.")
        LiveTracker(None, baseline_scans=self.baseline, noise=self.noise)  # refuses what is invalid
        if self.log is not None:
            check_file("--log", self.log, (".csv", ".nc"))
            check_log(self.log, force=self.force)

    @property
    def opens_first(self) -> bool:
        """Whether the source is opened before the table for positions is computed, which may take minutes.

        A wrong port or file must fail before that wait; but the finger of an emulator moves as soon as it is opened.
        """
        return self.recording is not None or not is_emulator(self.board.port)


@dataclass(frozen=True)
class LiveSource:
    """Readings of scans, each with whether the indenter is at rest, and their origin."""

    readings: Iterator[tuple[ScanReading, bool]]
    line: str  # for people
    emulated: bool
    states: tuple[str, ...]  # of a scan
    temperature: bool  # whether there is a thermometer
    budget: NoiseBudget | None  # of the board as it is read; None if the design is another one
    begin: Callable[[], None] = lambda: None  # to be called once the baseline is complete


def live_readings(
    source: LiveSource, options: LiveOptions, design: Design, model: ForwardModel | None, orders: Callable[[], str]
) -> Generator[LiveReading]:
    """Evaluate scan after scan, and log it; `orders` returns those of `QUIT` and `ZERO` given since its last call.

    A position is computed at most twenty times a second, so that it never delays the scans of a board.
    """
    from coilarray.hardware.record.live_tracking import LiveTracker

    tracker = LiveTracker(
        model, baseline_scans=options.baseline, budget=source.budget, noise=options.noise, reference=options.reference
    )
    limited = options.recording is None or options.speed > 0
    located, begun = -math.inf, False
    with _logged(source, options, design) as log:
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
            log(reading)
            yield reading
            if count == options.scans:
                return


@contextmanager
def _logged(source: LiveSource, options: LiveOptions, design: Design) -> Iterator[Callable[[LiveReading], None]]:
    """Yield a function that writes a reading into the log of the options, if there is one."""
    if options.log is None:
        yield lambda reading: None
        return
    from coilarray.hardware.record.live_log import open_log

    attributes = {"design": design.name, "design_hash": design.digest, "board": source.line}
    if options.reference:
        attributes["reference_coils"] = ", ".join(options.reference)
    with open_log(
        options.log, source.states, emulated=source.emulated, temperature=source.temperature, attributes=attributes,
        force=options.force,
    ) as log:  # fmt: skip
        yield log.add


@contextmanager
def live_source(options: LiveOptions, design: Design, *, progress: Progress) -> Iterator[LiveSource]:
    """Open the recording or the board of the options; a board rests afterwards.

    `progress` gets (done, total) while the response of an emulated board is computed. HardwareError for a reference
    that is not a state.
    """
    from coilarray.design.scan_states import referenced_names

    with _replay(options, design) if options.recording is not None else _stream(options, design, progress) as source:
        if options.reference:
            referenced_names(source.states, options.reference, HardwareError)
        yield source


@contextmanager
def _stream(asked: LiveOptions, design: Design, progress: Progress) -> Iterator[LiveSource]:
    from coilarray.hardware.scan.readings import read_scan

    options = asked.board
    lifted = replace(options, emulate=[text for text in options.emulate or () if text not in _held_back(options)])
    with ExitStack() as opened:
        board, settings = opened.enter_context(opened_board(lifted, design, real_time=True, progress=progress))
        begin = _finger(board, design, options)
        budget = _budget(asked, design, settings)
        capacitance = design.circuit.switches.tank_capacitance
        scans = opened.enter_context(closing(board.reader.scans()))
        thermometer = board.thermometer

        def readings() -> Iterator[tuple[ScanReading, bool]]:
            for scan in scans:
                temperature = None if thermometer is None else thermometer()
                yield read_scan(scan, settings, capacitance, temperature=temperature), True

        yield LiveSource(
            readings(),
            marked(board.line, emulated=board.emulated),
            board.emulated,
            tuple(state.name for state in settings.states),
            thermometer is not None,
            budget,
            begin,
        )


def _budget(asked: LiveOptions, design: Design, settings: ScanSettings) -> NoiseBudget | None:
    """Return the noise budget of a board with these settings; None if the noise is given, or the states differ."""
    if asked.noise is not None or not {one.name for one in settings.states} <= {one.name for one in design.plan}:
        return None
    from coilarray.hardware.scan.board_network import board_budget

    return board_budget(design, settings, baseline_scans=asked.baseline)


def _finger(board: Board, design: Design, options: BoardOptions) -> Callable[[], None]:
    """Return a function that moves the finger of an emulator after the baseline; what it needs is computed here."""
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
    for _, *place in tour(setup, 0.0)[:_FIRST]:
        emulator.world.check(Place(*place))
    return lambda: emulator.indenter.follow(tour(setup, emulator.clock.now()))


def _held_back(options: BoardOptions) -> list[str]:
    """Return the options of the emulator that wait for the baseline: a finger that presses from the start."""
    return [text for text in options.emulate or () if text.startswith("press=")]


@contextmanager
def _replay(options: LiveOptions, design: Design) -> Iterator[LiveSource]:
    """Yield the readings of a recording in the recorded order and time."""
    from coilarray.hardware.record.recording import open_recording
    from coilarray.hardware.scan.readings import read_scan

    path, speed = options.recording or Path(), options.speed
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
                marked(line, emulated=recording.emulated),
                recording.emulated,
                recording.states,
                recording.has_temperatures,
                _budget(options, design, recording.sessions[0].settings),
            )


def tour(setup: Indentation, start: float) -> list[tuple[float, float, float, float]]:
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
