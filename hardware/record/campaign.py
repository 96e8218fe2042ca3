"""Campaign of the same recorded sequence on a grid, and the stages that move the indenter.

It follows Gast & Zimmermann (2020, sect. 3.3). At every position the indenter is moved there
without touching (baseline), pressed in slowly to a depth, held for a dwell (peak), and lifted
slowly. An interrupted campaign continues with the positions that were not measured to their end.
"""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import pairwise, product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from coilarray.compute.files import make_folder, write_text
from coilarray.compute.threads import Progress
from coilarray.design.model import Design
from coilarray.errors import HardwareError, OutputError, shown
from coilarray.hardware.record.recorder import Recorder
from coilarray.hardware.record.recording import GridPlace
from coilarray.hardware.scan.readings import Reader, read_scan
from coilarray.hardware.wire.buses import BoardRestarted, BusFault, Clock, NoAnswer
from coilarray.hardware.wire.ports import OpenSerialPort

if TYPE_CHECKING:
    from coilarray.hardware.emulator.board import EmulatedBoard


SPEED = 1.5e-3  # speed of indenting and relaxing in m/s, as in the paper
DWELL = 0.5  # time at full depth before the peak is measured, in s, as in the paper
TRIES = 3  # number of attempts at one position before the campaign is given up
Dialect = Literal["grbl", "marlin"]  # firmware of a machine that speaks G-code
_MOST_PLACES = 1_000_000
_SHOWN = 120  # characters of a wrong plan in messages
_FARTHEST, _DEEPEST, _FASTEST, _LONGEST, _MOST_SCANS = 1.0, 0.1, 0.1, 3600.0, 1000  # m, m, m/s, s
_TRAVEL = 20e-3  # m/s, of the emulated stage between positions
_SLOW = 5e-3  # m/s, of the first move of a machine
_WAIT = {"grbl": "G4 P0.01", "marlin": "M400"}  # answered when all earlier movements are over
_HOME = {"grbl": "$H", "marlin": "G28"}
_REFUSALS = ("error", "alarm", "!!", "resend")  # GRBL's and Marlin's answers to a failed line
_GREETING = re.compile(r"grbl|marlin|for help\]|(start|reset|powerup)$", re.IGNORECASE)  # at start
_LONGEST_LINE, _MOST_AT_ONCE = 512, 4096  # bytes to keep of an unfinished line
_MOST_BYTES = 65536  # of answers to one line
_QUIET = 0.3  # s after the greeting, for its last lines
_ROUNDING = 1e-12  # m, of a position and its origin


class Stage:
    """Mover of the indenter. Positions are in m from the map's origin, speeds in m/s."""

    def check(self, places: Sequence[GridPlace]) -> None:
        """Refuse places outside the range of the stage."""

    def move(self, x: float, y: float) -> None:
        """Go to a position, lifted off."""

    def indent(self, depth: float, speed: float) -> None:
        """Indent to a depth in m below contact."""

    def relax(self, speed: float) -> None:
        """Lift off."""

    def retreat(self) -> None:
        """Lift off after a failure if this needs no person."""

    def close(self) -> None:
        """Release the machine without ever raising."""


class PersonStage(Stage):
    """A person who moves the indenter by hand."""

    # `ask` returns when its instruction was carried out. The map has its `origin` in m on the board.

    def __init__(self, ask: Callable[[str], None], origin: tuple[float, float] = (0.0, 0.0)) -> None:
        self._ask, self._origin = ask, origin
        self._where = ""

    def move(self, x: float, y: float) -> None:
        """Ask for a position."""
        at_x, at_y = self._origin
        self._where = f"x = {_mm(at_x + x)}, y = {_mm(at_y + y)} mm"
        self._ask(f"Move the indenter to {self._where}, without touching.")

    def indent(self, depth: float, speed: float) -> None:
        """Ask for a depth."""
        self._ask(f"Press {_mm(depth)} mm deep at {self._where}, at {_mm(speed)} mm/s, and hold it.")

    def relax(self, speed: float) -> None:
        """Ask for lifting off."""
        self._ask(f"Lift the indenter off at {_mm(speed)} mm/s.")


class EmulatedStage(Stage):
    """Stage that moves the indenter of an emulated board."""

    def __init__(self, board: EmulatedBoard) -> None:
        self._board, self._indenter, self._clock = board, board.indenter, board.clock
        self._x = self._y = self._depth = 0.0

    def check(self, places: Sequence[GridPlace]) -> None:
        """Refuse places that the emulated sample does not have."""
        from coilarray.hardware.emulator.board import Place

        for place in places:
            self._board.world.check(Place(place.x, place.y, place.depth))

    def move(self, x: float, y: float) -> None:
        """Go to a position, lifted off."""
        self._indenter.lift()
        self._clock.sleep(math.hypot(x - self._x, y - self._y) / _TRAVEL)
        self._x, self._y = x, y

    def indent(self, depth: float, speed: float) -> None:
        """Indent."""
        self._clock.sleep(depth / speed)
        self._indenter.press(self._x, self._y, depth)
        self._depth = depth

    def relax(self, speed: float) -> None:
        """Lift off."""
        self._clock.sleep(self._depth / speed)
        self.retreat()

    def retreat(self) -> None:
        """Lift off at once."""
        self._indenter.lift()
        self._depth = 0.0


@dataclass(frozen=True)
class StageLimits:
    """Range of a machine, beyond which no position is sent."""

    x: tuple[float, float]  # least and greatest position on the board in m
    y: tuple[float, float]  # m
    depth: float  # greatest depth below the point of contact in m
    clearance: float = 2e-3  # height in m above contact, for travels and baselines

    def __post_init__(self) -> None:
        for name, (low, high) in (("x", self.x), ("y", self.y)):
            if not -_FARTHEST <= low <= high <= _FARTHEST:
                raise HardwareError(f"{name} of a stage must rise and be at most {_FARTHEST} m; got {low} to {high} m.")
        for name, value in (("depth", self.depth), ("clearance", self.clearance)):
            if not 0 < value <= _DEEPEST:
                raise HardwareError(f"{name} of a stage must be positive and at most {_DEEPEST} m; got {value} m.")


class GcodeStage(Stage):
    """A machine with three axes that takes G-code in mm.

    Most machines restart when their port is opened and then no longer know their position. Such a
    machine is not moved before it has homed itself. A person confirms its first move, which is slow,
    because only this move shows that its zero is at contact.

    It answers every line by ``ok``, like GRBL and Marlin. Its work origin must be set: x and y of
    the board, z = 0 where the indenter just touches, z upwards. Only ``G21``, ``G90``, ``G0``,
    ``G1``, the command that waits for the end of a movement and, with `home`, the homing command
    are ever sent. Except for homing, nothing moves before the first call of `move`.
    """

    def __init__(
        self,
        port: OpenSerialPort,
        limits: StageLimits,
        dialect: Dialect = "grbl",
        *,
        confirm: Callable[[str], None] | None,
        home: bool = False,
        identity: str = "",
        origin: tuple[float, float] = (0.0, 0.0),
        greeting: float = 3.0,
        patience: float = 5.0,
        longest: float = 120.0,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._port, self._limits, self._dialect, self._origin = port, limits, dialect, origin
        self._patience, self._longest, self._now = patience, longest, now
        self._rest = b""  # of a line that has not ended yet
        self._due = 0  # lines that were sent but not answered: several after an interrupt
        self._ready = False
        self._moved = False  # the first, slow move is over, and confirmed
        self._identity, self._confirm = f"{dialect} {identity or port.name}", confirm
        try:
            if dialect not in get_args(Dialect):
                raise HardwareError(f"the stage must speak {' or '.join(get_args(Dialect))}; got {dialect!r}.")
            if confirm is None and self._identity not in _confirmed_machines():
                raise HardwareError(
                    f"a person must confirm the first move at the first use of the stage at {port.name}; "
                    "leave out --yes this once."
                )
            # most machines announce their start, and the whole announcement is read
            greeted = any(_GREETING.search(answer) for answer in self._answers(now() + greeting))
            for _ in self._answers(now() + _QUIET):
                pass
            if home:
                self._ask(f"The stage at {port.name} will now home itself with {_HOME[dialect]}.")
                self._send(_HOME[dialect], longest)
            elif greeted:
                raise self._restarted("when its port was opened")
            for line in ("G21", "G90"):
                self._send(line, 0.0)
        except BaseException:
            port.close()
            raise
        self._ready = True

    def check(self, places: Sequence[GridPlace]) -> None:
        """Refuse places outside the limits of the machine."""
        (x_min, x_max), (y_min, y_max), deepest = self._limits.x, self._limits.y, self._limits.depth
        for place in places:
            x, y = self._origin[0] + place.x, self._origin[1] + place.y
            axes = ((x_min, x, x_max), (y_min, y, y_max), (0.0, place.depth, deepest))
            if not all(low - _ROUNDING <= value <= high + _ROUNDING for low, value, high in axes):
                raise HardwareError(
                    f"the stage at {self._port.name} reaches x {_mm(x_min)} to {_mm(x_max)}, y {_mm(y_min)} to "
                    f"{_mm(y_max)} mm on the board and {_mm(deepest)} mm deep; the campaign goes to x = {_mm(x)}, "
                    f"y = {_mm(y)}, depth {_mm(place.depth)} mm."
                )

    def move(self, x: float, y: float) -> None:
        """Lift off and go to a position in m."""
        self.check([GridPlace(0, 0, 0.0, y, x)])
        at_x, at_y = self._origin[0] + x, self._origin[1] + y
        up, across = f"Z{_word(self._limits.clearance)}", f"X{_word(at_x)} Y{_word(at_y)}"
        if self._moved:
            self._go(f"G0 {up}", self._longest)
            self._go(f"G0 {across}", self._longest)
            return
        place = f"{_mm(self._limits.clearance)} mm over the contact at x = {_mm(at_x)}, y = {_mm(at_y)} mm on the board"
        slowly = f"will now go slowly to {place}. Keep a hand at its emergency stop."
        self._ask(f"The stage at {self._port.name} {slowly}")
        for way in (up, across):
            self._go(f"G1 {way} F{_feed(_SLOW)}", 2 * _FARTHEST / _SLOW)
        self._ask(f"The indenter must now be {place}: is it there?")
        self._moved = True
        if self._confirm is not None and self._identity not in (known := _confirmed_machines()):
            with suppress(OutputError):
                make_folder(_machines_file().parent)
                write_text(_machines_file(), "\n".join(sorted({*known, self._identity})))

    def indent(self, depth: float, speed: float) -> None:
        """Indent to a depth in m."""
        if not 0 < depth <= self._limits.depth:
            raise HardwareError(
                f"depth of the stage must be positive and at most {self._limits.depth * 1e3:g} mm; "
                f"got {depth * 1e3:g} mm."
            )
        way = self._limits.clearance + depth
        self._go(f"G1 Z{_word(-depth)} F{_feed(speed)}", way / speed)

    def relax(self, speed: float) -> None:
        """Lift off at a speed in m/s."""
        way = self._limits.clearance + self._limits.depth
        self._go(f"G1 Z{_word(self._limits.clearance)} F{_feed(speed)}", way / speed)

    def retreat(self) -> None:
        """Lift off, if a person has confirmed the position."""
        if self._ready and self._moved:
            with suppress(HardwareError):
                self._go(f"G0 Z{_word(self._limits.clearance)}", self._longest)

    def close(self) -> None:
        """Release the port without ever raising."""
        self._port.close()

    def _go(self, line: str, seconds: float) -> None:
        self._send(line, seconds)
        self._send(_WAIT[self._dialect], seconds)

    def _send(self, line: str, seconds: float) -> None:
        self._due += 1
        self._port.write(f"{line}\n".encode("ascii"))
        until = self._now() + seconds + self._patience
        for answer in self._answers(until):
            low = answer.lower()
            if low == "ok" or low.startswith("ok "):
                self._due -= 1
                if not self._due:
                    return
            if low.startswith(_REFUSALS):
                raise self._failed(f"refused {line!r}: {shown(answer)}")
            if _GREETING.search(answer):
                raise self._restarted(f"at {line!r}")
        raise self._failed(f"did not answer {line!r} within {seconds + self._patience:.3g} s")

    def _ask(self, text: str) -> None:
        if self._confirm is not None:
            self._confirm(text)

    def _restarted(self, when: str) -> HardwareError:
        return self._failed(
            f"restarted {when}, so it does not know where it is; home = true in the plan lets it home itself with "
            f"{_HOME[self._dialect]} first, for which it needs limit switches"
        )

    def _failed(self, what: str) -> HardwareError:
        self._ready = False  # from now on only its user moves it
        return HardwareError(f"the stage at {self._port.name} {what}.")

    def _answers(self, until: float) -> Iterator[str]:
        """Yield lines that come before a deadline."""
        taken = 0
        while True:
            while b"\n" in self._rest:
                line, _, self._rest = self._rest.partition(b"\n")
                yield line.decode("ascii", "replace").strip()
            left = until - self._now()
            data = self._port.read(max(left, 0.0))
            if left <= 0 and not data:
                return
            taken += len(data)
            self._rest = (self._rest + data)[-_LONGEST_LINE - _MOST_AT_ONCE :]
            if taken > _MOST_BYTES:
                raise self._failed("sends without end; is it really a stage")


def _machines_file() -> Path:
    import platformdirs

    return platformdirs.user_state_path("coilarray", appauthor=False) / "stages.txt"


def _confirmed_machines() -> set[str]:
    try:
        return set(_machines_file().read_text(encoding="utf-8").splitlines())
    except (OSError, UnicodeDecodeError):  # no file yet
        return set()


def _mm(value: float) -> str:
    """Return a length in mm, for people."""
    return f"{value * 1e3:.4g}"


def _word(value: float) -> str:
    """Return a coordinate in mm, for the machine."""
    return f"{value * 1e3:.4f}"


def _feed(speed: float) -> str:
    """Return a speed in mm/min, for the machine."""
    if not (math.isfinite(speed) and speed > 0):
        raise HardwareError(f"speed of the stage must be positive; got {speed} m/s.")
    return f"{speed * 60e3:.2f}"


@dataclass(frozen=True)
class Campaign:
    """Positions, depths and sequence of a campaign."""

    x: tuple[float, ...]  # m from the map's origin, as y, rising
    y: tuple[float, ...]
    depths: tuple[float, ...]  # of the indentation in m, rising
    repeats: int = 1  # passes over the whole grid
    scans: int = 1  # at every baseline and every peak
    dwell: float = DWELL  # s at full depth before the peak is measured
    speed: float = SPEED  # of indenting and relaxing in m/s

    def __post_init__(self) -> None:
        _require_rising("x", self.x, -_FARTHEST, _FARTHEST)
        _require_rising("y", self.y, -_FARTHEST, _FARTHEST)
        _require_rising("depths", self.depths, 0.0, _DEEPEST)
        if self.depths[0] <= 0:
            raise HardwareError(f"depths of a campaign must be positive; got {self.depths[0]} m.")
        for name, count in (("repeats", self.repeats), ("scans", self.scans)):
            if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= _MOST_SCANS:
                raise HardwareError(f"{name} of a campaign must be 1 to {_MOST_SCANS}; got {shown(count)}.")
        if not 0 <= self.dwell <= _LONGEST:
            raise HardwareError(f"dwell of a campaign must be 0 to {_LONGEST:g} s; got {self.dwell} s.")
        if not 0 < self.speed <= _FASTEST:
            raise HardwareError(f"speed of a campaign must be positive and at most {_FASTEST:g} m/s; got {self.speed}.")
        if self.size > _MOST_PLACES:
            raise HardwareError(f"a campaign must have at most {_MOST_PLACES} positions; got {self.size}.")

    @property
    def size(self) -> int:
        """Number of indentations."""
        return self.repeats * len(self.y) * len(self.x) * len(self.depths)

    @cached_property
    def places(self) -> tuple[GridPlace, ...]:
        """Every position in the order of measurement."""
        grid = product(range(self.repeats), self.y, self.x, self.depths)
        return tuple(GridPlace(number, repeat, depth, y, x) for number, (repeat, y, x, depth) in enumerate(grid))

    @property
    def seconds(self) -> float:
        """Time in s for pressing, dwelling and lifting."""
        pressing = sum(2 * depth / self.speed + self.dwell for depth in self.depths)
        return self.size / len(self.depths) * pressing

    def to_record(self) -> dict[str, Any]:
        """Return the campaign as plain values in SI, for JSON."""
        return {
            "positions": self.size,
            "x_m": list(self.x),
            "y_m": list(self.y),
            "depths_m": list(self.depths),
            "repeats": self.repeats,
            "scans": self.scans,
            "dwell_s": self.dwell,
            "speed_m_per_s": self.speed,
        }

    def to_json(self) -> str:
        """Return the campaign as JSON in one line."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Campaign:
        """Read a campaign from the JSON of `to_json`."""
        try:
            values = json.loads(text)
            values |= {name: tuple(float(value) for value in values[name]) for name in ("x", "y", "depths")}
            return cls(**values)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError, OverflowError) as error:
            raise HardwareError(f"the plan of a campaign cannot be read: {str(error)[:_SHOWN]}.") from None


def design_campaign(
    design: Design,
    *,
    x: Sequence[float] | None = None,
    y: Sequence[float] | None = None,
    depths: Sequence[float] | None = None,
    **sequence: Any,
) -> Campaign:
    """Make the campaign of a design's [indentation], lengths in m."""
    # By default it lies in the window for ellipses, for gast2020 in the grid of the paper.
    setup = design.indentation
    if setup is None:
        raise HardwareError(f"the design {design.name} has no [indenter] and [indentation]; a campaign needs them.")
    setup = setup.in_ellipse_window()
    return Campaign(
        setup.x if x is None else tuple(x),
        setup.y if y is None else tuple(y),
        setup.depths if depths is None else tuple(depths),
        **sequence,
    )


def run_campaign(
    campaign: Campaign,
    reader: Reader,
    stage: Stage,
    recorder: Recorder,
    clock: Clock,
    *,
    progress: Progress | None = None,
    reconnect: Callable[[], Reader] | None = None,
) -> None:
    """Measure every position that is not measured yet."""
    stage.check(campaign.places)
    done = recorder.finished()
    count = len(done)
    update = progress or (lambda done, total: None)
    update(count, campaign.size)
    run = _Run(campaign, reader, stage, recorder, clock, reconnect)
    try:
        for place in campaign.places:
            if place.number not in done:
                run.measure(place)
                count += 1
                update(count, campaign.size)
    except BaseException:
        stage.retreat()
        raise


class _BadScanError(HardwareError):
    """A scan in which a state has no value."""


@dataclass
class _Run:
    campaign: Campaign
    reader: Reader
    stage: Stage
    recorder: Recorder
    clock: Clock
    reconnect: Callable[[], Reader] | None

    def measure(self, place: GridPlace) -> None:
        for attempt in range(1, TRIES + 1):
            position = self.recorder.begin(place)
            try:
                self._press(place, position)
            except (NoAnswer, BusFault, BoardRestarted, _BadScanError) as error:
                if attempt == TRIES:
                    raise HardwareError(
                        f"at x = {place.x * 1e3:.4g}, y = {place.y * 1e3:.4g} mm from the map's origin a scan failed "
                        f"{TRIES} times: {error}"
                    ) from None
                self.stage.relax(self.campaign.speed)
                self._configure_again()
            else:
                self.recorder.finish(position)
                self.stage.relax(self.campaign.speed)
                return

    def _press(self, place: GridPlace, position: int) -> None:
        self.stage.move(place.x, place.y)
        self._scan("baseline", position, 0.0)
        self.stage.indent(place.depth, self.campaign.speed)
        self.clock.sleep(self.campaign.dwell)
        self._scan("peak", position, place.depth)

    def _scan(self, stage: str, position: int, depth: float) -> None:
        """Record the scans of a stage and check their values."""
        session = self.recorder.session
        for _ in range(self.campaign.scans):
            raw = self.reader.scan()
            self.recorder.add(raw, stage, position=position, depth=depth)
            for state in read_scan(raw, session.settings, session.capacitances).states:
                if state.verdict == "bad":
                    raise _BadScanError(f"{state.name} gave no value: {', '.join(state.reasons)}.")

    def _configure_again(self) -> None:
        session = self.recorder.session
        try:
            self.reader.configure(session.settings)
        except BoardRestarted as fault:  # the reader's session is over
            if self.reconnect is None:
                raise BoardRestarted(f"{str(fault).rstrip('.')}; run again to continue the recording.") from None
            self.reader = self.reconnect()
            self.reader.configure(session.settings)
        if self.reader.identity.boot != session.identity.boot:
            again = replace(session, identity=self.reader.identity, started=time.time())
            self.recorder.start(again, self.campaign.to_json(), self.recorder.thermometer)


def _require_rising(name: str, values: tuple[float, ...], least: float, most: float) -> None:
    rising = all(low < high for low, high in pairwise(values))
    if not (values and all(math.isfinite(value) for value in values) and rising):
        raise HardwareError(f"{name} of a campaign must be finite and rising, in m; got {shown(list(values))}.")
    if values[0] < least or values[-1] > most:
        raise HardwareError(f"{name} of a campaign must be {least:g} to {most:g} m; got {shown(list(values))}.")
