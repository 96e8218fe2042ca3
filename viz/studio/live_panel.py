"""Tab of the live board, its emulator or a recording.

It shows the history of δ, the place of the finger, presses, and a log.

The readings come from another process, several at once. The page requests a drawing after it has shown the last
drawing. So a slow page drops drawings, never scans.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coilarray.compute.display_units import true_minus
from coilarray.design.model import Design
from coilarray.errors import CoilarrayError
from coilarray.localize.inverse import location_lines
from coilarray.localize.presses import Press, baseline_text
from coilarray.viz.scenes.scene import Scene
from coilarray.viz.studio.history import SPANS, History
from coilarray.viz.studio.job import Outcome
from coilarray.viz.studio.live_drawing import (
    TAB,
    WINDOW,
    curves,
    nearest_place,
    press_places,
    press_row,
    state_colours,
    trail_lines,
)
from coilarray.viz.studio.panel import Panel
from coilarray.viz.studio.scene_making import BoardParts, coloured_by_delta
from coilarray.viz.studio.services import ZERO, BoardFrame, BoardRequest, Orders, Tell
from coilarray.viz.studio.top_view import LEAST, TopView, board_drawing, delta_bars, delta_fills, pins, top_view

if TYPE_CHECKING:
    from coilarray.viz.studio.page import Page

_JOB = "board"
_PATIENCE = 8.0  # s, time in which a board can be put to rest
_MOST_PRESSES = 500  # largest number that is kept for the marks and the list
_LISTED = 50  # number shown in the list
_MARKED = 12  # number shown on the board
_TRAIL = 60  # places
_SPAN = 60.0  # s
_LOG_SUFFIXES = (".csv", ".nc")
_SPAN_NAMES = {10.0: "10 s", 60.0: "1 min", 600.0: "10 min", 3600.0: "1 h"}
_NOTHING = History(())


class LivePanel(Panel):
    """Panel with the readings of a board as they arrive."""

    def __init__(self, page: Page) -> None:
        self._design: Design = page.work.design
        self._view: TopView = top_view(page.work.design)
        self._colours: dict[str, str] = {}
        self._frame: BoardFrame | None = None
        self._history, self._shift = _NOTHING, 0.0
        self._presses: dict[int, Press] = {}
        self._trail: deque[tuple[int, float, float]] = deque(maxlen=_TRAIL)
        self._new = False
        services = page.setup.services
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
            page, values, start_board=self.start, stop_board=lambda: page.stop_job(_JOB), zero_board=self._zero,
            look_at_board=self._look, pause_board=self._pause, span_of_board=self._choose_span,
            list_recordings=self._list,
        )  # fmt: skip
        self.show(page.work.design)

    def show(self, design: Design) -> None:
        """Show another design.

        A running board keeps the design with which it was started.
        """
        state = self._page.state
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
        """Board coloured by the last δ.

        It is None before the first δ. The method runs in a thread.
        """
        frame = self._frame
        if frame is None or not _has_delta(frame) or self._design is not design:
            return None
        return coloured_by_delta(board, frame.delta, LEAST)

    def start(self) -> None:
        """Begin to read a board or a recording.

        The page names it.
        """
        page, state = self._page, self._page.state
        services = page.setup.services
        watch = services.watch_board
        if watch is None:
            return
        design = page.work.design
        recording, log = state.live_recording or None, str(state.live_log or "").strip()
        try:
            request = BoardRequest(
                page.work.opened.document,
                design.name,
                port=str(state.live_port).strip(),
                recording=None if recording is None else str(self._file(recording, services.recording, (".sqlite",))),
                reference=tuple(map(str, state.live_reference)),
                log=str(self._file(log, services.log, _LOG_SUFFIXES)) if log else None,
            )
        except CoilarrayError as error:
            state.live_problem = str(error)
            return
        if page.start_job(
            _JOB, _watch, (watch, request), on_message=self._take, on_end=self._ended, patience=_PATIENCE
        ):
            self.show(design)
            state.update({
                "live_running": True, "live_problem": "", "live_line": "opening …", "live_paused": False,
                "live_corrected": " and ".join(request.reference), "live_logged": request.log or "",
                "live_temperature": "",
            })  # fmt: skip

    def _file(self, name: str, given: str | None, suffixes: Sequence[str]) -> Path:
        """File of the folder with a name.

        It may also be the file that the caller of the studio named.
        """
        return Path(name) if name == given else self._page.setup.shelf.file(name, suffixes)

    def _list(self) -> None:
        self._page.state.live_recordings = self._page.setup.shelf.files(".sqlite")

    def _zero(self) -> None:
        self._page.tell_job(_JOB, ZERO)

    def _pause(self) -> None:
        state = self._page.state
        state.live_paused = not state.live_paused
        if not state.live_paused:
            self._draw()

    def _choose_span(self, span: float) -> None:
        if float(span) in SPANS:
            self._page.state.live_span = float(span)
            self._draw()

    def _forget(self) -> None:
        self._history, self._shift = _NOTHING, 0.0
        self._presses.clear()
        self._trail.clear()
        self._page.state.live_plot = curves(self._history, _SPAN, {}, (), self._size)
        self._page.state.update({"live_presses": [], "live_places": [], "live_trail": []})

    def _take(self, frames: Sequence[BoardFrame]) -> None:
        """Keep every scan.

        Drawings are made when the page requests them.
        """
        for frame in frames:
            self._keep(frame)
        self._new = True
        if not self._page.state.live_running or self._frame is None:
            return
        if not _has_delta(self._frame):
            self._page.state.live_line = self._frame.line

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
        if self._new and not self._page.state.live_paused:
            self._draw()

    def _draw(self) -> None:
        """Draw the last readings."""
        frame, state = self._frame, self._page.state
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
            self._page.redraw(moving=True)

    def _ended(self, outcome: Outcome) -> None:
        """Show why the readings have ended."""
        state = self._page.state
        state.live_running = False
        self._draw()
        state.live_line = "" if outcome.kind == "failed" else "stopped" if outcome.kind == "cancelled" else "ended"
        state.live_problem = outcome.problem
        state.live_other = False
        if outcome.kind == "failed":
            self._page.setup.services.failed(outcome.problem)
        if not self._page.is_current(self._design):
            self.show(self._page.work.design)


def _later(press: Press, shift: float) -> Press:
    """Shift a press by a time in s."""
    return replace(press, begin=press.begin + shift, end=None if press.end is None else press.end + shift)


def _has_delta(frame: BoardFrame) -> bool:
    """Check if a frame has δ.

    The first frames come while the board is opened, or before there is a baseline.
    """
    return bool(frame.delta) and not frame.waiting


def _lines(frame: BoardFrame) -> list[str]:
    """Lines under the bars.

    They are the position of the finger or why it is unknown, and the rate of the scans.
    """
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


def _watch(item: Any, tell: Tell, orders: Orders) -> None:
    watch, request = item
    watch(request, tell, orders)
