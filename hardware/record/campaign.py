"""Campaign of the same recorded sequence on a grid.

It follows Gast & Zimmermann (2020, sect. 3.3). At every position the indenter is moved there
without touching (baseline), pressed in slowly to a depth, held for a dwell (peak), and lifted
slowly. An interrupted campaign continues with the positions that were not measured to their end.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import pairwise, product
from typing import Any

from coilarray.compute.threads import Progress
from coilarray.design.model import Design
from coilarray.errors import HardwareError, shown
from coilarray.hardware.record.recorder import Recorder
from coilarray.hardware.record.recording import GridPlace
from coilarray.hardware.record.stages import Stage
from coilarray.hardware.scan.readings import Reader, read_scan
from coilarray.hardware.wire.buses import BoardRestarted, BusFault, Clock, NoAnswer

SPEED = 1.5e-3
"""Speed of indenting and relaxing in m/s, as in the paper."""
DWELL = 0.5
"""Time at full depth before the peak is measured, in s, as in the paper."""
TRIES = 3
"""Number of attempts at one position before the campaign is given up."""

_MOST_PLACES = 1_000_000
_SHOWN = 120  # characters of a wrong plan in messages
_FARTHEST, _DEEPEST, _FASTEST, _LONGEST, _MOST_SCANS = 1.0, 0.1, 0.1, 3600.0, 1000  # m, m, m/s, s


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
        """Raise HardwareError for an invalid value."""
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
    """Make the campaign of a design's [indentation].

    It lies in the design's window for ellipses, for gast2020 in the grid of the paper. Positions
    and depths in m and the sequence of `Campaign` may be given instead.
    """
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
    """A campaign in progress."""

    campaign: Campaign
    reader: Reader
    stage: Stage
    recorder: Recorder
    clock: Clock
    reconnect: Callable[[], Reader] | None

    def measure(self, place: GridPlace) -> None:
        """Measure a position."""
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
        """Configure the board again after a fault."""
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
