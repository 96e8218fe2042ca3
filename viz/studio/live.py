"""Tab of the live board, its emulator or a recording: history of δ, presses, the position, and a log.

The readings come from another process, several at once. The page requests a drawing after it has shown the last
drawing. So a slow page drops drawings, never scans.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import number_text, true_minus
from coilarray.design.model import Design
from coilarray.errors import CoilarrayError
from coilarray.localize.inverse import Location, location_lines
from coilarray.localize.presses import Press, baseline_text
from coilarray.viz.palette import INK
from coilarray.viz.scenes.scene import Scene
from coilarray.viz.studio.drawing import (
    LEAST,
    BoardParts,
    TopView,
    board_drawing,
    coloured_by_delta,
    delta_bars,
    delta_fills,
    pins,
    state_colours,
    top_view,
)
from coilarray.viz.studio.job import ZERO, Outcome
from coilarray.viz.studio.services import BoardFrame, BoardRequest
from coilarray.viz.studio.session import Panel, Session

SPANS = (10.0, 60.0, 600.0, 3600.0)
"""Lengths in s of the histories that are kept."""

BINS = 300
"""Number of equal times of each history."""


class History:
    """δ of some states over the latest `SPANS`.

    Examples
    --------
    >>> history = History(["L1"])
    >>> for k in range(1000):
    ...     history.add(0.01 * k, {"L1": 1e-3 if k == 500 else 0.0})
    >>> times, least, largest = history.values(10.0)
    >>> bool(largest[0].max() == 1e-3), len(times) <= BINS
    (True, True)
    """

    def __init__(self, states: Sequence[str]) -> None:
        self.states = tuple(states)
        self.end = 0.0  # s
        shape = (len(SPANS), BINS, len(self.states))
        self._least, self._largest = np.full(shape, np.nan), np.full(shape, np.nan)
        self._seen = np.zeros(shape[:2], dtype=bool)
        self._last = [-1] * len(SPANS)  # number of the latest time, counted from 0 s

    def add(self, time: float, delta: Mapping[str, float | None]) -> None:
        """Add a scan at a time in s that never falls."""
        self.end = time
        values = np.array([delta.get(name) for name in self.states], dtype=np.float64)  # None is NaN
        for k, span in enumerate(SPANS):
            number = math.floor(time / (span / BINS))
            new = min(number - self._last[k], BINS)
            if new > 0:
                forgotten = np.arange(number - new + 1, number + 1) % BINS
                self._least[k, forgotten] = self._largest[k, forgotten] = np.nan
                self._seen[k, forgotten] = False
                self._last[k] = number
            at = self._last[k] % BINS
            self._seen[k, at] = True
            np.fmin(self._least[k, at], values, out=self._least[k, at])
            np.fmax(self._largest[k, at], values, out=self._largest[k, at])

    def values(self, span: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Read least and largest δ (state, time) over time.

        They cover one of the `SPANS`. NaN is a time with scans but without a value of the state.
        """
        k = SPANS.index(span)
        numbers = np.arange(max(self._last[k] - BINS + 1, 0), self._last[k] + 1)
        numbers = numbers[self._seen[k, numbers % BINS]]
        at = numbers % BINS
        return (numbers + 0.5) * (span / BINS), self._least[k, at].T, self._largest[k, at].T


TAB, WINDOW = (520.0, 300.0), (1500.0, 400.0)
"""Width and height of the drawing of the curves in the studio and in a separate window, in its own unit."""

_LEFT, _RIM, _TOP, _FOOT = 64.0, 10.0, 16.0, 44.0  # about the axes
_LEAST_RANGE = 2e-6  # of δ, so that noise of a board at rest does not fill the picture
_ROOM = 0.06  # of the range of δ, above and below
_TICKS = 6


def curves(
    history: History, span: float, colours: Mapping[str, str], presses: Iterable[Press], size: tuple[float, float] = TAB
) -> dict[str, Any]:
    """Curves of δ over the last `span` in s.

    `span` is one of the `SPANS`. The axis of δ reaches from the least to the largest value shown.
    """
    times, least, largest = history.values(span)
    stop = max(history.end, span)
    start, right, bottom = stop - span, size[0] - _RIM, size[1] - _FOOT
    low, high = _limits(least, largest)

    def across(time: float) -> float:
        return round(_LEFT + (right - _LEFT) * (time - start) / span, 1)

    def down(delta: float) -> float:
        return round(bottom - (bottom - _TOP) * (delta - low) / (high - low), 1)

    shown = [
        {"name": name, "colour": colours.get(name, INK), "path": _path(times, least[k], largest[k], across, down)}
        for k, name in enumerate(history.states)
    ]
    marks = []
    for press in presses:
        end = history.end if press.end is None else press.end
        if end >= start:
            left = max(across(press.begin), _LEFT)
            marks.append({"number": press.number, "x": left, "width": max(round(across(end) - left, 1), 1.0)})
    return {
        "box": f"0 0 {size[0]:g} {size[1]:g}",
        "axes": {"x": _LEFT, "y": _TOP, "width": right - _LEFT, "height": bottom - _TOP},
        "x": [{"at": across(tick), "text": f"{tick:g}"} for tick in _ticks(start, stop)],
        "y": [{"at": down(tick * 1e-6), "text": true_minus(f"{tick:g}")} for tick in _ticks(low * 1e6, high * 1e6)],
        "curves": shown,
        "presses": marks,
    }


def _path(times: FloatArray, least: FloatArray, largest: FloatArray, across: Any, down: Any) -> str:
    """Path of a curve through the least and largest values."""
    parts, before, reach = [], False, 0.0
    for time, a, b in zip(times.tolist(), least.tolist(), largest.tolist(), strict=True):
        if math.isnan(a):
            before = False
            continue
        x, first, last = across(time), a, b
        if before and abs(b - reach) < abs(a - reach):  # continue with the nearer value
            first, last = b, a
        parts.append(f"{'L' if before else 'M'}{x:g},{down(first):g}")
        if first != last or not before:
            parts.append(f"L{x:g},{down(last):g}")
        before, reach = True, last
    return "".join(parts)


def _limits(least: FloatArray, largest: FloatArray) -> tuple[float, float]:
    """Find the limits of the axis of δ."""
    known = np.isfinite(least)
    low = float(least[known].min(initial=0.0)) if known.any() else 0.0
    high = float(largest[known].max(initial=0.0)) if known.any() else 0.0
    missing = max(_LEAST_RANGE - (high - low), 0.0)
    room = _ROOM * (high - low + missing)
    return low - missing / 2 - room, high + missing / 2 + room


def _ticks(low: float, high: float) -> list[float]:
    ticks = MaxNLocator(_TICKS, steps=[1, 2, 5, 10]).tick_values(low, high)
    return [float(f"{tick:.12g}") + 0.0 for tick in ticks if low <= tick <= high]


def press_row(press: Press) -> dict[str, Any]:
    """Texts of a press for a list."""
    place, depth = "–", "–"
    if press.location is not None and press.location.modes:
        best = press.location.modes[0]
        known = (*best.known_deviations, None, None, None)[:3]
        x, y, depth = map(_length, (best.x, best.y, best.depth), known)
        place = f"{x}, {y}"
    return {
        "number": press.number,
        "begin": f"{press.begin:.2f}",
        "lasted": "…" if press.end is None else f"{press.end - press.begin:.2f}",
        "place": place,
        "depth": depth,
        "delta": true_minus(f"{press.delta * 1e6:+.0f}"),
    }


def press_places(view: TopView, presses: Iterable[Press]) -> list[dict[str, Any]]:
    """Known places of presses with their numbers."""
    places = []
    for press in presses:
        if press.location is not None and press.location.modes:
            x, y = view.point(press.location.modes[0].x, press.location.modes[0].y)
            places.append({"number": press.number, "x": x, "y": y})
    return places


def _length(value: float, sigma: float | None) -> str:
    return number_text(value * 1e3, 2) + ("" if sigma is None else f" ± {sigma * 1e3:.2f}")


def nearest_place(location: Location, before: tuple[float, float] | None) -> tuple[float, float]:
    """Place in m of the mode nearest the last place."""
    modes = location.modes
    if before is None:
        return modes[0].x, modes[0].y
    best = min(modes, key=lambda mode: math.hypot(mode.x - before[0], mode.y - before[1]))
    return best.x, best.y


def trail_lines(view: TopView, trail: Sequence[tuple[int, float, float]]) -> list[dict[str, Any]]:
    """Lines of a trail of (number of the press, x, y in m)."""
    lines = []
    for k, ((press, *start), (other, *end)) in enumerate(pairwise(trail), start=1):
        if press == other:
            (x1, y1), (x2, y2) = view.point(*start), view.point(*end)
            lines.append({"x1": x1, "y1": y1, "x2": x2, "y2": y2, "opacity": round(k / len(trail), 2)})
    return lines


_JOB = "board"
_PATIENCE = 8.0  # s, time in which a board can be put to rest
_MOST_PRESSES = 500  # largest number that is kept for the marks and the list
_LISTED = 50  # number shown in the list
_MARKED = 12  # number shown on the board
_TRAIL = 60  # places
_SPAN = 60.0  # s
_RECORDING = ".sqlite"  # suffix of a recording, also of a log
_SPAN_NAMES = {10.0: "10 s", 60.0: "1 min", 600.0: "10 min", 3600.0: "1 h"}
_NOTHING = History(())


class LivePanel(Panel):
    """Panel with the readings of a board as they arrive."""

    def __init__(self, session: Session) -> None:
        self._design: Design = session.work.design
        self._view: TopView = top_view(session.work.design)
        self._colours: dict[str, str] = {}
        self._frame: BoardFrame | None = None
        self._history, self._shift = _NOTHING, 0.0
        self._presses: dict[int, Press] = {}
        self._trail: deque[tuple[int, float, float]] = deque(maxlen=_TRAIL)
        self._new = False
        services = session.setup.services
        self._size = WINDOW if services.alone else TAB
        values = {
            "can_watch": services.watch_board is not None, "alone": services.alone, "live_port": services.port,
            "live_recording": services.recording, "live_recordings": [], "live_reference": list(services.reference),
            "live_states": [], "live_log": services.log or "", "live_running": False, "live_line": "",
            "live_problem": "", "live_scan": 0, "live_other": False, "live_paused": False, "live_span": _SPAN,
            "live_spans": [{"value": span, "title": _SPAN_NAMES[span]} for span in SPANS], "live_corrected": "",
            "live_logged": "", "live_temperature": "",
        }  # fmt: skip
        super().__init__(
            session,
            values,
            start_board=self.start,
            stop_board=lambda: session.stop_job(_JOB),
            zero_board=self._zero,
            look_at_board=self._look,
            pause_board=self._pause,
            span_of_board=self._choose_span,
            list_recordings=self._list,
        )
        self.show(session.work.design)

    def show(self, design: Design) -> None:
        """Show another design."""
        state = self._session.state
        state.live_other = bool(state.live_running) and design.digest != self._design.digest
        if state.live_running:
            return
        self._design, self._view, self._frame = design, top_view(design), None
        self._colours = state_colours(design)
        state.live_states = [one.name for one in design.plan]
        state.live_reference = [name for name in state.live_reference if name in state.live_states]
        self._forget()
        state.live_plan = board_drawing(design, self._view)
        state.live_bars, state.live_lines, state.live_pins, state.live_fills = [], [], [], {}

    def scene(self, design: Design, board: BoardParts) -> Scene | None:
        """Board coloured by the last δ, or None before it."""
        frame = self._frame
        if frame is None or not _has_delta(frame) or self._design is not design:
            return None
        return coloured_by_delta(board, frame.delta, LEAST)

    def start(self) -> None:
        """Begin to read a board or a recording."""
        session, state = self._session, self._session.state
        services = session.setup.services
        watch = services.watch_board
        if watch is None:
            return
        design = session.work.design
        recording, log = state.live_recording or None, str(state.live_log or "").strip()
        try:
            request = BoardRequest(
                session.work.opened.document,
                design.name,
                port=str(state.live_port).strip(),
                recording=None if recording is None else str(self._file(recording, services.recording)),
                reference=tuple(map(str, state.live_reference)),
                log=str(self._file(log, services.log)) if log else None,
            )
        except CoilarrayError as error:
            state.live_problem = str(error)
            return
        if session.start_job(_JOB, watch, request, on_message=self._take, on_end=self._ended, patience=_PATIENCE):
            self.show(design)
            state.update({
                "live_running": True, "live_problem": "", "live_line": "opening …", "live_paused": False,
                "live_corrected": " and ".join(request.reference), "live_logged": request.log or "",
                "live_temperature": "",
            })  # fmt: skip

    def _file(self, name: str, given: str | None) -> Path:
        """Find a recording of the folder by its name."""
        return Path(name) if name == given else self._session.setup.shelf.file(name, (_RECORDING,))

    def _list(self) -> None:
        self._session.state.live_recordings = self._session.setup.shelf.files(_RECORDING)

    def _zero(self) -> None:
        self._session.tell_job(_JOB, ZERO)

    def _pause(self) -> None:
        state = self._session.state
        state.live_paused = not state.live_paused
        if not state.live_paused:
            self._draw()

    def _choose_span(self, span: float) -> None:
        if float(span) in SPANS:
            self._session.state.live_span = float(span)
            self._draw()

    def _forget(self) -> None:
        self._history, self._shift = _NOTHING, 0.0
        self._presses.clear()
        self._trail.clear()
        self._session.state.live_plot = curves(self._history, _SPAN, {}, (), self._size)
        self._session.state.update({"live_presses": [], "live_places": [], "live_trail": []})

    def _take(self, frames: Sequence[BoardFrame]) -> None:
        """Keep every scan."""
        for frame in frames:
            self._keep(frame)
        self._new = True
        if not self._session.state.live_running or self._frame is None:
            return
        if not _has_delta(self._frame):
            self._session.state.live_line = self._frame.line

    def _keep(self, frame: BoardFrame) -> None:
        """Add a scan to history, presses and trail."""
        before, self._frame = self._frame, frame
        if not frame.delta:
            return
        if self._history is _NOTHING:
            self._history = History(tuple(frame.delta))
        if before is not None and before.delta and frame.time < before.time:  # the board has restarted
            self._shift = self._history.end
        time = frame.time + self._shift
        self._history.add(time, frame.delta)
        last = self._presses.get(max(self._presses, default=0))
        if frame.press is not None:
            self._presses[frame.press.number] = _later(frame.press, self._shift)
            if len(self._presses) > _MOST_PRESSES:
                del self._presses[min(self._presses)]
            if frame.location is not None and frame.location.modes:
                number = frame.press.number
                at = self._trail[-1][1:] if self._trail and self._trail[-1][0] == number else None
                self._trail.append((number, *nearest_place(frame.location, at)))
        elif last is not None and last.end is None:  # the baseline was measured again meanwhile
            self._presses[last.number] = replace(last, end=time)

    def _look(self) -> None:
        """Draw new readings, if there are any."""
        if self._new and not self._session.state.live_paused:
            self._draw()

    def _draw(self) -> None:
        """Draw the last readings."""
        frame, state = self._frame, self._session.state
        self._new = False
        if frame is None:
            return
        state.live_scan, state.live_line = frame.sequence, frame.line
        presses = list(self._presses.values())
        state.live_plot = curves(self._history, state.live_span, self._colours, presses, self._size)
        state.live_presses = [press_row(press) for press in presses[: -_LISTED - 1 : -1]]
        state.live_places = press_places(self._view, presses[-_MARKED:])
        state.live_trail = trail_lines(self._view, list(self._trail))
        state.live_bars = [
            {**bar, "why": frame.reasons.get(bar["name"], ""), "colour": self._colours.get(bar["name"], "")}
            for bar in delta_bars(frame.delta.items(), LEAST)
        ]
        state.live_fills = delta_fills(self._design, frame.delta, LEAST)
        if frame.location is not None or frame.waiting:
            state.live_pins = [] if frame.location is None else pins(self._view, frame.location)
        state.live_lines = _lines(frame)
        if frame.temperature is not None:
            state.live_temperature = true_minus(f"{frame.temperature:.2f} °C")
        if state.tab == "live" and not state.alone and _has_delta(frame):
            self._session.redraw(moving=True)

    def _ended(self, outcome: Outcome) -> None:
        """Show why the readings have ended."""
        state = self._session.state
        state.live_running = False
        self._draw()
        state.live_line = "" if outcome.kind == "failed" else "stopped" if outcome.kind == "cancelled" else "ended"
        state.live_problem = outcome.problem
        state.live_other = False
        if outcome.kind == "failed":
            self._session.setup.services.failed(outcome.problem)
        if not self._session.is_current(self._design):
            self.show(self._session.work.design)


def _later(press: Press, shift: float) -> Press:
    """Shift a press by a time in s."""
    return replace(press, begin=press.begin + shift, end=None if press.end is None else press.end + shift)


def _has_delta(frame: BoardFrame) -> bool:
    """Check if a frame has δ."""
    return bool(frame.delta) and not frame.waiting


def _lines(frame: BoardFrame) -> list[str]:
    """Lines under the bars."""
    if not frame.delta:
        return []
    if frame.waiting:
        where = [baseline_text(frame.waiting)]
    elif frame.location is not None:
        where = location_lines(frame.location)
    else:
        where = [frame.problem] if frame.problem else []
    rate = "" if frame.rate is None else f"{frame.rate:.2f} scans/s, "
    return [*where, f"{rate}{frame.lost} lost"]
