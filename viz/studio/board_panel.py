"""Tab of the live board or its emulator: δ of every coil and the position of the finger."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from coilarray.design.model import Design
from coilarray.viz.scenes.scene import Scene
from coilarray.viz.studio.job import Outcome
from coilarray.viz.studio.panel import Panel
from coilarray.viz.studio.scene_making import BoardParts, coloured_by_delta
from coilarray.viz.studio.services import BoardFrame, BoardRequest, Stopped, Tell
from coilarray.viz.studio.top_view import TopView, board_drawing, delta_bars, delta_fills, pins, top_view
from coilarray.viz.studio.touch import location_lines

if TYPE_CHECKING:
    from coilarray.viz.studio.page import Page

_JOB = "board"
_PATIENCE = 8.0  # s; time in which a board can be put to rest


class BoardPanel(Panel):
    """Panel with the readings of a board as they arrive."""

    def __init__(self, page: Page) -> None:
        self._design: Design = page.work.design
        self._view: TopView = top_view(page.work.design)
        self._frame: BoardFrame | None = None
        services = page.setup.services
        values = {
            "can_watch": services.watch_board is not None, "board_port": services.port, "board_running": False,
            "board_line": "", "board_problem": "", "board_scan": 0, "board_other": False,
        }  # fmt: skip
        super().__init__(page, values, start_board=self._start, stop_board=lambda: page.stop_job(_JOB))
        self.show(page.work.design)

    def show(self, design: Design) -> None:
        """Show another design; a running board keeps the design with which it was started."""
        state = self._page.state
        state.board_other = bool(state.board_running) and design.digest != self._design.digest
        if state.board_running:
            return
        self._design, self._view, self._frame = design, top_view(design), None
        state.board_plan = board_drawing(design, self._view)
        state.board_bars, state.board_lines, state.board_pins, state.board_fills = [], [], [], {}

    def scene(self, design: Design, board: BoardParts) -> Scene | None:
        """Return the board coloured by the last δ, or None before the first; runs in a thread."""
        frame = self._frame
        if frame is None or not _has_delta(frame) or self._design is not design:
            return None
        return coloured_by_delta(board, frame.delta)

    def _start(self) -> None:
        page = self._page
        services = page.setup.services
        watch = services.watch_board
        if watch is None:
            return
        design = page.work.design
        request = BoardRequest(page.work.opened.document, design.name, services.port, services.wiring)
        if page.start_job(
            _JOB, _watch, (watch, request), on_message=self._take, on_end=self._ended, patience=_PATIENCE
        ):
            self.show(design)
            page.state.update({"board_running": True, "board_problem": "", "board_line": "opening …"})

    def _take(self, frame: BoardFrame) -> None:
        state = self._page.state
        self._frame = frame
        state.board_scan = frame.sequence
        state.board_line = frame.line
        state.board_bars = [
            {**bar, "why": frame.reasons.get(bar["name"], "")} for bar in delta_bars(frame.delta.items())
        ]
        state.board_fills = delta_fills(self._design, frame.delta)
        state.board_pins = [] if frame.location is None else pins(self._view, frame.location)
        state.board_lines = _lines(frame)
        if state.tab == "board" and _has_delta(frame):
            self._page.redraw()

    def _ended(self, outcome: Outcome) -> None:
        state = self._page.state
        state.board_running = False
        state.board_line = "" if outcome.kind == "failed" else "stopped"
        state.board_problem = outcome.problem
        state.board_other = False
        if not self._page.is_current(self._design):
            self.show(self._page.work.design)


def _has_delta(frame: BoardFrame) -> bool:
    """Return whether a frame has δ: the first ones come while the board is opened, or before there is a baseline."""
    return bool(frame.delta) and not frame.waiting


def _lines(frame: BoardFrame) -> list[str]:
    """Return the lines under the bars: position of the finger or why it is unknown, and rate of the scans."""
    if not frame.delta:
        return []
    if frame.waiting:
        where = [f"baseline: {frame.waiting} more scans without an indentation"]
    elif frame.location is not None:
        where = location_lines(frame.location)
    else:
        where = [frame.problem] if frame.problem else []
    rate = "" if frame.rate is None else f"{frame.rate:.2f} scans/s, "
    return [*where, f"{rate}{frame.lost} lost"]


def _watch(item: Any, tell: Tell, stopped: Stopped) -> None:
    watch, request = item
    watch(request, tell, stopped)
