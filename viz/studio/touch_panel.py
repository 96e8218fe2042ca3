"""Tab of touching.

The indenter is dragged over the board, and δ, ellipses and the located position are shown.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import xarray as xr

from coilarray.compute.display_units import true_minus
from coilarray.design.model import Design
from coilarray.errors import CoilarrayError, DesignError
from coilarray.localize.forward import table_grid
from coilarray.localize.inverse import location_lines
from coilarray.viz.scenes.scene import Scene
from coilarray.viz.scenes.touch import dent_of_design
from coilarray.viz.studio.entries import number_of, place_text
from coilarray.viz.studio.job import with_progress
from coilarray.viz.studio.panel import Panel
from coilarray.viz.studio.scene_making import BoardParts, touched_scene
from coilarray.viz.studio.top_view import TopView, board_drawing, delta_bars, top_view, touch_drawing
from coilarray.viz.studio.touch import Sensor, Touched, crossing_line, first_place, sensor_of, touched

if TYPE_CHECKING:
    from coilarray.viz.studio.page import Page

_SHOWN = 1e-5  # m, last digit of a place on the page, as a place at the edge may be rounded beyond it
_NOTHING: dict[str, Any] = {
    "indenter": None, "ellipses": [], "crossing": [], "pins": [], "fills": {}
}  # fmt: skip


class TouchPanel(Panel):
    """Panel with the indenter on the board."""

    def __init__(self, page: Page) -> None:
        self._view: TopView = top_view(page.work.design)
        self._tables: dict[str, xr.Dataset] = {}
        self._sensor: Sensor | None = None
        self._touched: Touched | None = None
        self._dent: tuple[Design, float, xr.Dataset] | None = None
        values = {
            "plan": board_drawing(page.work.design, self._view), "touch": _NOTHING, "bars": [], "located": [],
            "touch_note": "", "touch_ready": False,
            "touch_work": touch_work(page.work.design), "place": {"x": "", "y": "", "depth": ""}, "place_error": "",
            "can_touch": page.work.design.indentation is not None, "dragging": False, "pressing": False
        }  # fmt: skip
        page.state.client_only("dragging", "pressing")
        super().__init__(page, values, compute_table=self._compute, press=self._press, press_at=self._press_at)

    def show(self, design: Design, *, anew: bool) -> None:
        """Show the board of a design.

        Its response is shown if it was computed in this session.
        """
        state = self._page.state
        self._view = top_view(design)
        state.plan = board_drawing(design, self._view)
        state.can_touch, state.touch_work = design.indentation is not None, touch_work(design)
        table = self._tables.get(design.digest)
        if table is not None and design.indentation is not None:
            self._take_table(design, table)
            return
        self._sensor = self._touched = None
        state.touch_ready, state.touch, state.bars, state.located = False, _NOTHING, [], []
        if design.indentation is None:
            state.touch_note = (
                "Nothing presses on this board: the design has no [indenter] and [indentation]. "
                "A sheet that Build lays on the board brings both."
            )
        elif anew or not self._tables:
            state.touch_note = ""
        else:
            state.touch_note = "The design has changed: its response is to be computed anew."

    def scene(self, design: Design, board: BoardParts) -> Scene | None:
        """Scene of the touch.

        It is None without a touch. The method runs in a thread.
        """
        touch = self._touched
        if touch is None or self._sensor is None or self._sensor.design is not design or touch.depth <= 0:
            return None
        if self._dent is None or self._dent[0] is not design or self._dent[1] != touch.depth:
            self._dent = design, touch.depth, dent_of_design(design, touch.depth)
        return touched_scene(board, self._dent[2], touch)

    # ---------------------------------------------------------------- the response

    def _compute(self) -> None:
        """Compute the response of the design."""
        page = self._page
        design = page.work.design

        def done(table: xr.Dataset) -> None:
            """Keep the response, and use it for its design."""
            self._tables[design.digest] = table
            if page.work.design.digest == design.digest:
                self._take_table(page.work.design, table)
                page.redraw()
            else:
                note("The design has changed since: its response is to be computed anew.")

        def note(text: str = "Cancelled.") -> None:
            page.state.touch_note = text

        item = (page.setup.services.response_table, page.work.opened.document, design.name)
        if page.start_bar("table", f"response of {design.name}", with_progress, item, done, cancelled=note):
            note("")

    def _take_table(self, design: Design, table: xr.Dataset) -> None:
        """Use a response for touches."""
        try:
            self._sensor = sensor_of(design, table)
        except CoilarrayError as error:
            self._page.state.touch_note = str(error)
            return
        self._page.state.touch_ready, self._page.state.touch_note = True, ""
        self._put(*first_place(self._sensor))

    # ---------------------------------------------------------------- the indenter

    def _press(self, across: float, down: float) -> None:
        """Press at the pointer.

        Its place is given as shares of the drawing's sides.
        """
        if self._sensor is not None and self._touched is not None:
            x, y = self._view.place(float(across), float(down))
            self._put(x, y, self._touched.depth)
            self._page.redraw()

    def _press_at(self, x: str, y: str, depth: str) -> None:
        """Press at numbers in mm."""
        if self._sensor is None:
            return
        try:
            numbers = _place(self._sensor, (x, y, depth))
        except CoilarrayError as error:
            self._page.state.place_error = str(error)
            return
        self._put(*numbers)
        self._page.redraw()

    def _put(self, x: float, y: float, depth: float) -> None:
        """Press at a place and show the result."""
        if self._sensor is None:
            return
        design, state = self._sensor.design, self._page.state
        touch = self._touched = touched(self._sensor, x, y, depth)
        state.touch = touch_drawing(design, self._view, touch)
        state.bars = delta_bars(touch.delta.items())
        state.located = [*location_lines(touch.location), crossing_line(touch)]
        state.place_error = ""
        place = zip(("x", "y", "depth"), (*touch.at, touch.depth), strict=True)
        state.place = {name: place_text(value) for name, value in place}


def touch_work(design: Design) -> str:
    """Describe the response that a touch needs.

    It must be computed before the first touch. The text is empty if nothing can press.

    Examples
    --------
    >>> from coilarray import load_design
    >>> touch_work(load_design("starter"))
    'δ of 3 states at 6 depths and 49 × 25 places'
    """
    if design.indentation is None:
        return ""
    depths, x, y = table_grid(design)
    states = f"{len(design.plan)} states" if len(design.plan) > 1 else "one state"
    return f"δ of {states} at {len(depths)} depths and {len(x)} × {len(y)} places"


def _place(sensor: Sensor, texts: tuple[str, str, str]) -> list[float]:
    """Place and depth in m from texts in mm.

    A text that is not a number, or a number beyond the response, raises a DesignError.
    """
    numbers = []
    limits = zip(sensor.model.lower.tolist(), sensor.model.upper.tolist(), strict=True)
    for name, text, (low, high) in zip(("x", "y", "depth"), texts, limits, strict=True):
        number = number_of(name, str(text)) * 1e-3
        if not low - _SHOWN <= number <= high + _SHOWN:
            line = f"{name} must be {low * 1e3:.2f} to {high * 1e3:.2f} mm; got {number * 1e3:g}."
            raise DesignError(true_minus(line))
        numbers.append(number)
    return numbers
