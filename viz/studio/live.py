"""Tabs of pressing: a dragged indenter with δ and position, and the live board.

The readings of a board, its emulator or a recording come from another process, several at once. The
page requests a drawing after it has shown the last drawing. So a slow page drops drawings, never
scans.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from typing import Any, NamedTuple, TypeGuard

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.ticker import MaxNLocator

from coilarray.circuit.network import Network
from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import number_text, true_minus
from coilarray.design.model import Design
from coilarray.errors import DesignError, LocalizeError
from coilarray.localize.forward import ForwardModel, forward_model, table_grid
from coilarray.localize.inverse import Location, locate, location_lines
from coilarray.localize.presses import Press, baseline_text
from coilarray.response.dataset import on_board
from coilarray.response.map import Imperfections, response_map
from coilarray.response.setup import indentation_of
from coilarray.viz.datasets.results import uncertainty_ellipse
from coilarray.viz.palette import INK, coil_colours
from coilarray.viz.scenes.board import VEILED, scene_of_dent
from coilarray.viz.scenes.design import dent_of_design, off_middle
from coilarray.viz.scenes.results import CONFIDENCE, colours_of_delta, scene_of_location
from coilarray.viz.scenes.scene import Scene
from coilarray.viz.studio.job import ZERO, Outcome, Step
from coilarray.viz.studio.services import BoardFrame, BoardRequest
from coilarray.viz.studio.session import Panel, Session
from coilarray.viz.studio.view import BoardParts, delta_by_coil
from coilarray.viz.studio.work import number_of, place_text

LEAST = 1e-4  # least δ at which bars and colours are full
RED = "#D55E00"
"""Colour of positions that are found."""

_BORDER = 0.02  # width of the rim over the width of the board
_LETTER = 0.035  # largest height of letters over the width of the drawing
_LETTER_OF_PITCH = 0.22  # and over the distance of neighbours, so that names of six letters do not overlap
_NAME = 'text-anchor="middle" dominant-baseline="central" fill="#202020" stroke="#fff" paint-order="stroke"'
_COARSE = 0.7  # distance of the places of a first map, in thicknesses of the sheets
_SHOWN = 1e-5  # m, last digit of a place on the page, as a place at the edge may be rounded beyond it
_LEAST = 0.5  # mm, radius of a drawn indenter
_FOLLOWS = "δ of a coarse map; the position follows with the full map."


@dataclass(frozen=True)
class TopView:
    """Board from above in mm, with y reversed."""

    left: float
    top: float
    width: float
    height: float

    @property
    def line(self) -> float:
        """Width of a thin line."""
        return round(0.0022 * self.width, 3)


def top_view(design: Design) -> TopView:
    """Coordinates of a drawing of a board."""
    x_min, y_min, x_max, y_max = (edge * 1e3 for edge in design.array.bounds)
    rim = _BORDER * (x_max - x_min)
    return TopView(x_min - rim, -y_max - rim, x_max - x_min + 2 * rim, y_max - y_min + 2 * rim)


def drawing(design: Design, delta: Mapping[str, float | None], marks: str = "", least: float = 0.0) -> dict[str, Any]:
    """SVG of a board with coils coloured by δ."""
    view, array = top_view(design), design.array
    colours = coil_colours(array.names, array.centres)
    edges = [(x, y) for x in array.bounds[::2] for y in array.bounds[1::2]]
    look = f'class="board" fill="#eef5ee" stroke="#3F8F4F" stroke-width="{view.line}"'
    parts = [polygon(np.array(edges)[[0, 1, 3, 2]], look)]
    fills = ["none"] * len(array.names)
    if delta:
        of_coils = colours_of_delta(delta_by_coil(design, delta), least)
        fills = [f"rgb{tuple(one)}" for one in of_coils.scale.colours_of(of_coils.values[: len(fills)]).tolist()]
    for place, fill in zip(array.placements, fills, strict=True):
        stroke = f'stroke="{colours[place.name]}" stroke-width="{1.5 * view.line:g}"'
        parts.append(polygon(place.to_board(place.coil.outline), f'fill="{fill}" fill-opacity="0.75" {stroke}'))
    letter = min(_LETTER * view.width, _LETTER_OF_PITCH * array.least_distance * 1e3)
    look = f'{_NAME} font-size="{letter:.3f}" stroke-width="{1.5 * view.line:g}" font-weight="600"'
    for name, (x, y) in zip(array.names, array.centres * 1e3, strict=True):
        parts.append(f'<text x="{x:.3f}" y="{-y:.3f}" {look}>{escape(name)}</text>')
    return {
        "box": f"{view.left:.3f} {view.top:.3f} {view.width:.3f} {view.height:.3f}",
        "ratio": round(view.width / view.height, 4),
        "svg": "".join(parts) + marks,
    }


def polygon(points: npt.ArrayLike, look: str, kind: str = "polygon") -> str:
    """Polygon or polyline through points (n, 2) in m."""
    corners = " ".join(f"{x:.3f},{-y:.3f}" for x, y in np.asarray(points) * 1e3)
    return f'<{kind} points="{corners}" {look}/>'


def circle(x: float, y: float, radius: float, look: str) -> str:
    """Circle at a place in m, its radius in mm."""
    return f'<circle cx="{x * 1e3:.3f}" cy="{-y * 1e3:.3f}" r="{radius:.3f}" {look}/>'


def location_marks(view: TopView, location: Location) -> str:
    """Possible positions of a location with 95 % ellipses."""
    marks = []
    stroke = f'stroke="{RED}" stroke-width="{view.line}"'
    for k, mode in enumerate(location.modes):
        covariance = mode.covariance[:2, :2]
        if np.isfinite(covariance).all() and None not in mode.known_deviations[:2]:
            ellipse = np.asarray(uncertainty_ellipse((mode.x, mode.y), covariance, CONFIDENCE).points) * 1e-3
            marks.append(polygon(ellipse[:, :2], f'class="ellipse" fill="{RED}" fill-opacity="0.15" {stroke}'))
        fill = "#fff" if k else RED
        marks.append(circle(mode.x, mode.y, 4 * view.line, f'class="pin" fill="{fill}" {stroke}'))
    return "".join(marks)


def state_colours(design: Design) -> dict[str, str]:
    """Colour of each state, by its first coil."""
    colours = coil_colours(design.array.names, design.array.centres)
    return {state.name: colours.get(state.measured[0][0], INK) for state in design.plan}


def delta_bars(delta: Iterable[tuple[str, float | None]], least: float = 0.0) -> list[dict[str, Any]]:
    """Texts of δ in 10⁻⁶, and lengths of their bars."""
    # in per cent of half the width, full at the largest δ or at `least`
    pairs = list(delta)
    largest = max([least, *(abs(value) for _, value in pairs if value is not None)]) or 1.0
    bars = []
    for name, value in pairs:
        text = "–" if value is None else number_text(value * 1e6, 1, "+")
        bars.append({"name": name, "text": text, "part": 0.0 if value is None else round(50 * value / largest, 2)})
    return bars


class Touched(NamedTuple):
    """Place of the indenter with its readings."""

    place: FloatArray  # x and y on the board, and depth in m
    delta: dict[str, float]  # δ of every state
    location: Location  # located from these δ, which have no noise


def touched(model: ForwardModel, x: float, y: float, depth: float) -> Touched:
    """Press at a place on the board in m."""
    place = np.clip([x, y, depth], model.lower, model.upper)
    delta = model.delta(place)
    try:
        location = locate(model, delta)
    except LocalizeError as error:  # one or two coils do not determine x, y and depth
        location = Location("refused", str(error))
    return Touched(place, dict(zip(model.states, delta.tolist(), strict=True)), location)


class TouchPanel(Panel):
    """Panel with the indenter on the board."""

    def __init__(self, session: Session, network: Callable[[], Network | None]) -> None:
        self._network = network  # of the current design, if it is known
        self._tables: dict[str, xr.Dataset] = {}  # responses by the digest of their design
        self._coarse: set[str] = set()  # digests of designs with a first map only
        self._model: ForwardModel | None = None  # of the current design
        self._touched: Touched | None = None
        self._dent: tuple[Design, float, xr.Dataset] | None = None
        values = {
            "touch": drawing(session.work.design, {}), "bars": [], "located": [], "touch_note": "",
            "touch_ready": False, "touch_coarse": False,
            "place": {"x": "", "y": "", "depth": ""}, "place_error": "",
            "can_touch": False,
        }  # fmt: skip
        super().__init__(
            session, values, "place_error", compute_table=self._compute, press_at=self._press_at,
            press_on=self._press_on,
        )  # fmt: skip

    def show(self, design: Design, *, anew: bool) -> None:
        """Show a design's board, `anew` for other files or coils."""
        state = self._state
        state.can_touch = design.indentation is not None
        table = self._tables.get(design.digest)
        if table is not None:
            self._take_table(table)
            return
        self._model = self._touched = None
        state.touch_ready = state.touch_coarse = False
        state.touch, state.bars, state.located = drawing(design, {}), [], []
        note = "The design has changed: its response is to be computed anew." if self._tables and not anew else ""
        if design.indentation is None:
            note = "Nothing presses on this board: the design has no [indenter] and [indentation]. "
            note += "A sheet that Build lays on the board brings both."
        state.touch_note = note

    def begin(self) -> None:
        """Compute a coarse map at once for the open tab, and then the full map."""
        session, network = self._session, self._network()
        design = session.work.design
        known = design.digest in self._tables or design.digest in self._coarse
        if session.state.tab != "touch" or known or network is None or design.indentation is None:
            return

        def show(table: xr.Dataset) -> None:
            if session.work.design.digest == design.digest and design.digest not in self._tables:
                self._take_table(table, coarse=True)
                session.redraw()
                self._compute()

        self._coarse.add(design.digest)
        self._state.touch_note = "A coarse map is computed first."
        fail = partial(session.say, place="touch_note")
        session.slow.ask([Step("touch", lambda: coarse_table(design, network), show, fail)])

    def scene(self, design: Design, board: BoardParts) -> Scene | None:
        """Scene of the touch or None, made in a thread."""
        touch = self._touched
        if touch is None or not self._session.is_current(design) or touch.place[2] <= 0:
            return None
        x, y, depth = touch.place.tolist()
        if self._dent is None or self._dent[0] is not design or self._dent[1] != depth:
            self._dent = design, depth, dent_of_design(design, depth)
        array, bounds = design.array, design.array.bounds
        scene = board.by_delta(touch.delta)
        if bounds[0] < x < bounds[2] and bounds[1] < y < bounds[3]:
            indenter, dent = indentation_of(design).indenter, self._dent[2]
            scene += scene_of_dent(array, design.sheets, dent, indenter, (x, y), opacity=VEILED)
        if self._state.touch_coarse:
            return scene + Scene(notes=(_FOLLOWS,))
        return scene + scene_of_location(touch.location, bounds=bounds, top=design.top, truth=(x, y))

    def _compute(self) -> None:
        session = self._session
        design, table_of = session.work.design, session.setup.services.response_table
        if table_of is None:
            return

        def done(table: xr.Dataset) -> None:
            self._tables[design.digest] = table
            if session.work.design.digest == design.digest:
                self._take_table(table)
                session.redraw()
            else:
                note("The design has changed since: its response is to be computed anew.")

        def note(text: str = "") -> None:
            self._state.touch_note = text

        document, text = session.work.opened.document, f"response of {design.name}"
        if session.start_bar("table", text, table_of, document, design.name, done=done, cancelled=note):
            note()

    def _take_table(self, table: xr.Dataset, *, coarse: bool = False) -> None:
        setup = indentation_of(self._session.work.design)
        before = None if self._touched is None else self._touched.place.tolist()
        self._model = forward_model(on_board(table))
        self._state.touch_ready, self._state.touch_coarse, self._state.touch_note = True, coarse, ""
        self._put(*(before or (*off_middle(setup), max(setup.depths))))

    def _press_on(self, x_mm: float, y_mm: float) -> None:
        if self._touched is not None:
            self._put(x_mm * 1e-3, y_mm * 1e-3, float(self._touched.place[2]))
            self._session.redraw()

    def _press_at(self, x: str, y: str, depth: str) -> None:
        """Press at numbers in mm."""
        if self._model is None:
            return
        numbers = []
        limits = zip(self._model.lower.tolist(), self._model.upper.tolist(), strict=True)
        for name, text, (low, high) in zip(("x", "y", "depth"), (x, y, depth), limits, strict=True):
            number = number_of(name, text) * 1e-3
            if not low - _SHOWN <= number <= high + _SHOWN:
                line = f"{name} must be {low * 1e3:.2f} to {high * 1e3:.2f} mm; got {number * 1e3:g}."
                raise DesignError(true_minus(line))
            numbers.append(number)
        self._put(*numbers)
        self._session.redraw()

    def _put(self, x: float, y: float, depth: float) -> None:
        if self._model is None:
            return
        design, state = self._session.work.design, self._state
        touch = self._touched = touched(self._model, x, y, depth)
        x, y, depth = touch.place.tolist()
        view = top_view(design)
        radius = max(indentation_of(design).indenter.radius_at(depth) * 1e3, _LEAST)
        marks = "" if state.touch_coarse else location_marks(view, touch.location)
        look = f'id="indenter" fill="none" stroke="#0072B2" stroke-width="{3 * view.line:g}"'
        state.touch = drawing(design, touch.delta, marks + circle(x, y, radius, look))
        state.bars = delta_bars(touch.delta.items())
        state.located = [_FOLLOWS] if state.touch_coarse else location_lines(touch.location)
        state.place_error = ""
        state.place = {name: place_text(value) for name, value in zip(("x", "y", "depth"), (x, y, depth), strict=True)}


def coarse_table(design: Design, network: Network) -> xr.Dataset:
    """Response at few depths and places, with a circuit that is already solved."""
    spacing = _COARSE * sum(sheet.thickness for sheet in design.sheets)
    depths, x, y = table_grid(design, spacing=spacing)
    solved = Imperfections(network=network)
    return response_map(design, depths=depths[[len(depths) // 2 - 1, -1]], x=x, y=y, imperfections=solved)


SPANS = {10.0: "10 s", 60.0: "1 min", 600.0: "10 min", 3600.0: "1 h"}  # times in s over which curves are shown
BINS = 300  # number of equal times of a curve
_KEPT = 2_000_000  # values of δ that are kept at most


class History:
    """δ of some states of the latest scans."""

    def __init__(self, states: Sequence[str]) -> None:
        self.states = tuple(states)
        self.end = 0.0  # s
        most = _KEPT // max(len(self.states), 1)
        self._count, self._time, self._delta = 0, np.empty(most), np.empty((most, len(self.states)))

    def add(self, time: float, delta: Mapping[str, float | None]) -> None:
        """Add a scan at a rising time in s."""
        if self._count == len(self._time):  # the older half is forgotten
            half = self._count // 2
            for kept in (self._time, self._delta):
                kept[:half] = kept[-half:]
            self._count = half
        self.end = self._time[self._count] = time
        # None is NaN
        self._delta[self._count] = np.array([delta.get(name) for name in self.states], dtype=np.float64)
        self._count += 1

    def values(self, span: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Least and largest δ (state, time) of the last `span`, NaN if unknown."""
        step = span / BINS
        numbers = np.floor(self._time[: self._count] / step)
        first = int(np.searchsorted(numbers, math.floor(self.end / step) - BINS + 1))
        delta, numbers = self._delta[first : self._count], numbers[first:]
        begins = np.flatnonzero(np.diff(numbers, prepend=-1.0))
        least, largest = (function.reduceat(delta, begins).T for function in (np.fmin, np.fmax))
        return (numbers[begins] + 0.5) * step, least, largest


TAB, WINDOW = (520.0, 300.0), (1500.0, 400.0)  # width and height of the curves in studio and window
_LEFT, _RIM, _TOP, _FOOT = 64.0, 10.0, 16.0, 44.0  # about the axes
_LEAST_RANGE = 2e-6  # of δ, so that noise of a board at rest does not fill the picture
_ROOM = 0.06  # of the range of δ, above and below
_TICKS = 6


def curves(
    history: History, span: float, colours: Mapping[str, str], presses: Iterable[Press], size: tuple[float, float] = TAB
) -> dict[str, Any]:
    """Curves of δ over the last `span` in s."""
    times, least, largest = history.values(span)
    stop = max(history.end, span)
    start = stop - span
    right, bottom = size[0] - _RIM, size[1] - _FOOT
    low, high = float(np.nanmin(least, initial=0.0)), float(np.nanmax(largest, initial=0.0))
    missing = max(_LEAST_RANGE - (high - low), 0.0)
    room = _ROOM * (high - low + missing) + missing / 2
    low, high = low - room, high + room

    def across(time: float) -> float:
        return round(_LEFT + (right - _LEFT) * (time - start) / span, 1)

    def down(delta: float) -> float:
        return round(bottom - (bottom - _TOP) * (delta - low) / (high - low), 1)

    def path(k: int) -> str:
        parts, step = [], "M"
        for time, a, b in zip(times.tolist(), least[k].tolist(), largest[k].tolist(), strict=True):
            if math.isnan(a):
                step = "M"
                continue
            x = across(time)
            parts.append(f"{step}{x:g},{down(a):g}L{x:g},{down(b):g}")
            step = "L"
        return "".join(parts)

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
        "curves": [
            {"name": name, "colour": colours.get(name, INK), "path": path(k)} for k, name in enumerate(history.states)
        ],
        "presses": marks,
    }


def _ticks(low: float, high: float) -> list[float]:
    ticks = MaxNLocator(_TICKS, steps=[1, 2, 5, 10]).tick_values(low, high)
    return [float(f"{tick:.12g}") + 0.0 for tick in ticks if low <= tick <= high]


def press_row(press: Press) -> list[str]:
    """Return the cells of a press in s, mm and 10⁻⁶."""
    place, depth = "–", "–"
    if press.location is not None and press.location.modes:
        best = press.location.modes[0]
        deviations = (*best.known_deviations, None, None, None)
        x, y, depth = (
            "–" if sigma is None else f"{number_text(value * 1e3, 2)} ± {sigma * 1e3:.2f}"
            for value, sigma in zip((best.x, best.y, best.depth), deviations, strict=False)
        )
        place = f"{x}, {y}"
    lasted = "…" if press.end is None else f"{press.end - press.begin:.2f}"
    delta = true_minus(f"{press.delta * 1e6:+.0f}")
    return [str(press.number), f"{press.begin:.2f}", lasted, place, depth, delta]


_PATIENCE = 8.0  # s, time in which a board can be put to rest
_MOST_PRESSES = 500  # largest number that is kept for the marks and the list
_LISTED = 50  # number shown in the list
_MARKED = 12  # number shown on the board
_TRAIL = 60  # places
_RECORDING = ".sqlite"  # suffix of a recording, also of a log


class LivePanel(Panel):
    """Panel with the readings of a board as they arrive."""

    def __init__(self, session: Session) -> None:
        self._design: Design = session.work.design  # of the board that is read
        self._frame: BoardFrame | None = None
        self._history = History(())
        self._presses: dict[int, Press] = {}
        self._trail: deque[tuple[float, float]] = deque(maxlen=_TRAIL)  # of the present press
        self._new = False
        services = session.setup.services
        values = {
            "can_watch": services.watch_board is not None, "alone": services.alone, "live_port": services.port,
            "live_recording": services.recording, "live_recordings": [], "live_reference": list(services.reference),
            "live_states": [], "live_log": services.log or "", "live_running": False, "live_line": "",
            "live_problem": "", "live_scan": 0, "live_other": False, "live_paused": False, "live_span": 60.0,
            "live_spans": [{"value": span, "title": title} for span, title in SPANS.items()], "live_corrected": "",
            "live_logged": "", "live_temperature": "", "live_board_words": "",
        }  # fmt: skip
        super().__init__(
            session, values, "live_problem", start_board=self.start, stop_board=lambda: session.tell_job("board"),
            zero_board=lambda: session.tell_job("board", ZERO), look_at_board=self._look, list_recordings=self._list,
        )  # fmt: skip
        self.show(session.work.design)

    def show(self, design: Design) -> None:
        """Show another design, unless a board is read."""
        state = self._state
        state.live_other = bool(state.live_running) and design.digest != self._design.digest
        if not state.live_running:
            self._design, self._frame = design, None
            state.live_states = [one.name for one in design.plan]
            state.live_reference = [name for name in state.live_reference if name in state.live_states]
            self._forget(())
            self.draw()

    def scene(self, design: Design, board: BoardParts) -> Scene | None:
        """Board coloured by the last δ, or None before it."""
        frame = self._frame
        return board.by_delta(frame.delta, LEAST) if _has_delta(frame) and self._design is design else None

    def start(self, port: str | None, recording: str | None, reference: list[str], log: str | None) -> None:
        """Begin to read a board or a recording, as `BoardRequest` says."""
        session, state, services = self._session, self._state, self._session.setup.services
        if services.watch_board is None:
            return

        def file(name: str, given: str | None) -> str | None:
            return name or None if name in ("", given) else str(session.setup.shelf.file(name, (_RECORDING,)))

        design = session.work.design
        request = BoardRequest(
            session.work.opened.document,
            design.name,
            port=(port or "").strip(),
            recording=file(recording or "", services.recording),
            reference=tuple(reference),
            log=file((log or "").strip(), services.log),
        )
        if session.start_job(
            "board", services.watch_board, request, on_message=self._take, on_end=self._ended, patience=_PATIENCE
        ):
            self.show(design)
            state.update({
                "live_running": True, "live_problem": "", "live_line": "opening …", "live_paused": False,
                "live_corrected": " and ".join(request.reference), "live_logged": request.log or "",
                "live_temperature": "",
            })  # fmt: skip

    def _list(self) -> None:
        self._state.live_recordings = self._session.setup.shelf.files(_RECORDING)

    def _forget(self, states: Sequence[str]) -> None:
        self._history = History(states)
        self._presses.clear()
        self._trail.clear()

    def _take(self, frames: Sequence[BoardFrame]) -> None:
        for taken in frames:
            frame, before = taken, self._frame
            if before is not None and frame.location is None and not (frame.waiting or frame.problem):
                frame = replace(frame, location=before.location)  # positions are rarer than scans
            self._frame = frame
            if not frame.delta:
                self._say(frame)
                continue
            if not self._history.states or frame.time < self._history.end:  # the board may have restarted
                self._forget(tuple(frame.delta))
            self._history.add(frame.time, frame.delta)
            self._follow(frame)
        self._new = True

    def _follow(self, frame: BoardFrame) -> None:
        last = self._presses.get(max(self._presses, default=0))
        if frame.press is None:
            if last is not None and last.end is None:  # the baseline was measured again meanwhile
                self._presses[last.number] = replace(last, end=frame.time)
            return
        if last is None or frame.press.number != last.number:
            self._trail.clear()
        self._presses[frame.press.number] = frame.press
        if len(self._presses) > _MOST_PRESSES:
            del self._presses[min(self._presses)]
        if frame.location is not None and frame.location.modes:
            places = [(mode.x, mode.y) for mode in frame.location.modes]
            near = [math.dist(place, self._trail[-1]) for place in places] if self._trail else [0.0]
            self._trail.append(places[near.index(min(near))])

    def _look(self) -> None:
        if self._new and not self._state.live_paused:
            self.draw()

    def draw(self) -> None:
        """Draw the last readings."""
        frame, state, design = self._frame, self._state, self._design
        self._new = False
        delta = {} if frame is None else frame.delta
        colours, presses = state_colours(design), list(self._presses.values())
        state.live_plot = curves(self._history, state.live_span, colours, presses, WINDOW if state.alone else TAB)
        state.live_presses = [press_row(press) for press in presses[: -_LISTED - 1 : -1]]
        state.live_board = drawing(design, delta, self._marks(presses[-_MARKED:]), LEAST)
        reasons = {} if frame is None else frame.reasons
        state.live_bars = [
            {**bar, "why": reasons.get(bar["name"], ""), "colour": colours.get(bar["name"], "")}
            for bar in delta_bars(delta.items(), LEAST)
        ]
        state.live_lines = [] if frame is None else _lines(frame)
        if frame is not None:
            state.live_scan = frame.sequence
            self._say(frame)
            if frame.temperature is not None:
                state.live_temperature = true_minus(f"{frame.temperature:.2f} °C")
        if _has_delta(frame) and state.tab == "live" and not state.alone:
            self._session.redraw(moving=True)

    def _say(self, frame: BoardFrame) -> None:
        """Name the board in words, with its details beside them."""
        waits = "" if frame.delta else frame.line.partition("; ")[2]
        board = "Emulated board" if frame.emulated else frame.line.partition("; ")[0]
        self._state.live_line, self._state.live_board_words = f"{board}{waits and f': {waits}'}", frame.line

    def _marks(self, presses: Iterable[Press]) -> str:
        """Numbered presses, trail of the present press, last position."""
        view, frame = top_view(self._design), self._frame
        marks = []
        for press in presses:
            if press.location is not None and press.location.modes:
                x, y = press.location.modes[0].x, press.location.modes[0].y
                shift, letter = 2.5 * view.line, 12 * view.line
                text = f'<text x="{x * 1e3 + shift:.3f}" y="{-y * 1e3 - shift:.3f}" font-size="{letter:.3f}">'
                marks.append(f"{circle(x, y, 1.6 * view.line, '')}{text}{press.number}</text>")
        look = f'fill="none" stroke="{RED}" stroke-width="{1.5 * view.line:g}" stroke-linecap="round"'
        marks.append(polygon(np.reshape(self._trail, (-1, 2)), look, "polyline"))
        if frame is not None and frame.location is not None:
            marks.append(location_marks(view, frame.location))
        return "".join(marks)

    def _ended(self, outcome: Outcome) -> None:
        state = self._state
        state.live_running = state.live_other = False
        self.draw()
        state.live_line = {"failed": "", "cancelled": "stopped", "done": "ended"}[outcome.kind]
        state.live_problem = outcome.problem
        if outcome.kind == "failed":
            self._session.setup.services.failed(outcome.problem)
        if not self._session.is_current(self._design):
            self.show(self._session.work.design)


def _has_delta(frame: BoardFrame | None) -> TypeGuard[BoardFrame]:
    return frame is not None and bool(frame.delta) and not frame.waiting


def _lines(frame: BoardFrame) -> list[str]:
    if not frame.delta:
        return []
    if frame.waiting:
        where = [baseline_text(frame.waiting)]
    elif frame.location is not None:
        where = location_lines(frame.location)
    else:
        where = [frame.problem] if frame.problem else []
    rate = "" if frame.rate is None else f"{frame.rate:.1f} scans a second, "
    return [*where, f"{rate}{frame.lost or 'none'} lost."]
