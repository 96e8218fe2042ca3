"""Tab of touching: a dragged indenter, with δ and position."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import true_minus
from coilarray.design.model import Design
from coilarray.errors import DesignError, LocalizeError
from coilarray.localize.forward import ForwardModel, forward_model, table_grid
from coilarray.localize.inverse import Location, locate, location_lines
from coilarray.response.dataset import on_board
from coilarray.response.setup import indentation_of
from coilarray.viz.scenes.board import VEILED, scene_of_dent
from coilarray.viz.scenes.design import dent_of_design, off_middle
from coilarray.viz.scenes.results import scene_of_location
from coilarray.viz.scenes.scene import Scene
from coilarray.viz.studio.session import Panel, Session
from coilarray.viz.studio.view import BoardParts, circle, delta_bars, drawing, location_marks, top_view
from coilarray.viz.studio.work import number_of, place_text

_SHOWN = 1e-5  # m, last digit of a place on the page, as a place at the edge may be rounded beyond it
_LEAST = 0.5  # mm, radius of a drawn indenter


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

    def __init__(self, session: Session) -> None:
        self._tables: dict[str, xr.Dataset] = {}  # responses by the digest of their design
        self._model: ForwardModel | None = None  # of the current design
        self._touched: Touched | None = None
        self._dent: tuple[Design, float, xr.Dataset] | None = None
        values = {
            "touch": drawing(session.work.design, {}), "bars": [], "located": [], "touch_note": "",
            "touch_ready": False, "touch_work": "", "place": {"x": "", "y": "", "depth": ""}, "place_error": "",
            "can_touch": False, "pressing": False,
        }  # fmt: skip
        session.state.client_only("pressing")
        super().__init__(
            session, values, "place_error", compute_table=self._compute, press=self._press, press_at=self._press_at
        )

    def show(self, design: Design, *, anew: bool) -> None:
        """Show a design's board, `anew` for other files or coils."""
        state = self._state
        state.can_touch, state.touch_work = design.indentation is not None, touch_work(design)
        table = self._tables.get(design.digest)
        if table is not None:
            self._take_table(table)
            return
        self._model = self._touched = None
        state.touch_ready, state.touch, state.bars, state.located = False, drawing(design, {}), [], []
        changed = "The design has changed: its response is to be computed anew." if self._tables and not anew else ""
        state.touch_note = (
            changed
            if design.indentation is not None
            else (
                "Nothing presses on this board: the design has no [indenter] and [indentation]. "
                "A sheet that Build lays on the board brings both."
            )
        )

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

        def note(text: str = "Cancelled.") -> None:
            self._state.touch_note = text

        document, text = session.work.opened.document, f"response of {design.name}"
        if session.start_bar("table", text, table_of, document, design.name, done=done, cancelled=note):
            note("")

    def _take_table(self, table: xr.Dataset) -> None:
        setup = indentation_of(self._session.work.design)
        self._model = forward_model(on_board(table))
        self._state.touch_ready, self._state.touch_note = True, ""
        self._put(*off_middle(setup), max(setup.depths))

    def _press(self, across: float, down: float) -> None:
        if self._touched is not None:
            x, y = top_view(self._session.work.design).place(across, down)
            self._put(x, y, float(self._touched.place[2]))
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
        """Press at a place and show the result."""
        if self._model is None:
            return
        design, state = self._session.work.design, self._state
        touch = self._touched = touched(self._model, x, y, depth)
        x, y, depth = touch.place.tolist()
        view = top_view(design)
        radius = max(indentation_of(design).indenter.radius_at(depth) * 1e3, _LEAST)
        marks = location_marks(view, touch.location)
        look = f'id="indenter" fill="none" stroke="#0072B2" stroke-width="{3 * view.line:g}"'
        state.touch = drawing(design, touch.delta, marks + circle(x, y, radius, look))
        state.bars = delta_bars(touch.delta.items())
        state.located = location_lines(touch.location)
        state.place_error = ""
        state.place = {name: place_text(value) for name, value in zip(("x", "y", "depth"), (x, y, depth), strict=True)}


def touch_work(design: Design) -> str:
    """Name the response to compute, empty without an indenter.

    >>> from coilarray import load_design
    >>> touch_work(load_design("starter"))
    'δ of 3 states at 6 depths and 49 × 25 places'
    """
    if design.indentation is None:
        return ""
    depths, x, y = table_grid(design)
    states = f"{len(design.plan)} states" if len(design.plan) > 1 else "one state"
    return f"δ of {states} at {len(depths)} depths and {len(x)} × {len(y)} places"
