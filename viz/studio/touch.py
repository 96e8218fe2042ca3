"""Tab of touching: the indenter is dragged over the board, and δ, ellipses and the position are shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import xarray as xr

from coilarray.compute.display_units import true_minus
from coilarray.design.model import Design
from coilarray.errors import CoilarrayError, DesignError, LocalizeError
from coilarray.localize.forward import ForwardModel, forward_model, table_grid
from coilarray.localize.inverse import Location, locate, location_lines
from coilarray.paper.ellipse import Ellipse, fit_ellipses
from coilarray.paper.ellipse_model import EllipseModel, EllipsePosition, ellipse_model, locate_x
from coilarray.response.dataset import on_board
from coilarray.response.setup import indentation_of
from coilarray.viz.palette import INK
from coilarray.viz.scenes.board import VEILED, scene_of_dent
from coilarray.viz.scenes.results import scene_of_location
from coilarray.viz.scenes.scene import Scene
from coilarray.viz.scenes.touch import dent_of_design, off_middle
from coilarray.viz.studio.drawing import (
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
from coilarray.viz.studio.entries import number_of, place_text
from coilarray.viz.studio.session import Panel, Session

_STEP = 1e-3  # m between the points of a map to which ellipses are fitted
_REFINEMENT = 5  # of this map; 20, the default, moves x0 by less than 0.1 mm and takes ten times as long
_IN_A_ROW = 1e-6  # m, largest distance across a row between coils of the row
_LEAST_DELTA = 3.0  # in units of the noise; a smaller δ gives no ellipse


@dataclass(frozen=True, eq=False)
class Sensor:
    """Design with an indentation, and its response model."""

    design: Design
    model: ForwardModel  # of positions on the board


@dataclass(frozen=True, eq=False)
class Touched:
    """Place of the indenter with its readings."""

    at: tuple[float, float]  # x and y on the board in m
    depth: float  # m
    delta: Mapping[str, float]  # δ of every state
    location: Location  # located from these δ, which have no noise
    ellipses: Mapping[str, Ellipse]  # of the paper's model by state, if it has an ellipse for the δ
    crossing: EllipsePosition | None  # position by the paper's model
    row: tuple[float, float]  # place on the board of the paper's origin, for ellipses and crossing
    problem: str  # why there are no ellipses or no crossing


def sensor_of(design: Design, table: xr.Dataset) -> Sensor:
    """Join a design and its response table.

    A table of another design or an invalid table raises a LocalizeError. A design without an indentation raises an
    ElastomerError.
    """
    indentation_of(design)
    if table.attrs.get("design_hash") != design.digest:
        raise LocalizeError("the response table is that of another design.")
    return Sensor(design, forward_model(on_board(table)))


def first_place(sensor: Sensor) -> tuple[float, float, float]:
    """First x, y and depth of the indenter in m."""
    setup = indentation_of(sensor.design)
    return *off_middle(setup), max(setup.depths)


def touched(sensor: Sensor, x: float, y: float, depth: float) -> Touched:
    """Press at a place on the board in m."""
    low, high = sensor.model.lower, sensor.model.upper
    point = np.clip([x, y, depth], low, high)
    delta = sensor.model.delta(point)
    readings = dict(zip(sensor.model.states, delta.tolist(), strict=True))
    try:
        location = locate(sensor.model, delta)
    except LocalizeError as error:  # one or two coils do not determine x, y and depth
        location = Location("refused", str(error))
    row = indentation_of(sensor.design).origin_point
    ellipses, crossing, problem = _by_ellipses(sensor, float(point[2]), row, readings)
    at = (float(point[0]), float(point[1]))
    return Touched(at, float(point[2]), readings, location, ellipses, crossing, row, problem)


def _by_ellipses(
    sensor: Sensor, depth: float, row: tuple[float, float], readings: Mapping[str, float]
) -> tuple[Mapping[str, Ellipse], EllipsePosition | None, str]:
    """Locate a touch by the paper's ellipses."""
    if np.ptp(np.append(sensor.design.array.centres[:, 1], row[1])) > _IN_A_ROW:
        return {}, None, "none: the paper's model is for coils in one row along x"
    fitted = _ellipse_model(sensor.model, round(depth, 6), row)
    if isinstance(fitted, str):
        return {}, None, fitted
    ellipses = {}
    noticed = _LEAST_DELTA * np.hypot(sensor.model.noise, sensor.model.common_noise.max())
    for coil in fitted.coils:
        delta = readings[coil.name]
        if delta >= noticed and coil.covers(delta):
            try:
                ellipses[coil.name] = coil.ellipse(delta)
            except LocalizeError:  # the polynomials have no ellipse there
                continue
    try:
        return ellipses, locate_x(fitted, readings), ""
    except LocalizeError as error:
        return ellipses, None, str(error)


@lru_cache(maxsize=16)
def _ellipse_model(model: ForwardModel, depth: float, row: tuple[float, float]) -> EllipseModel | str:
    """Fit the paper's model about its origin `row` at one depth."""
    x, y = (np.arange(axis[0], axis[-1] + _STEP / 2, _STEP) for axis in (model.x, model.y))
    x, y = (np.minimum(axis, last[-1]) for axis, last in ((x, model.x), (y, model.y)))
    points = np.empty((len(y), len(x), 3))
    points[..., 0], points[..., 1], points[..., 2] = x, y[:, None], depth
    try:
        delta = model.delta(points)
        coords = {"depth": [depth], "y": y - row[1], "x": x - row[0], "state": list(model.states)}
        map_ = xr.Dataset({"delta": (("depth", "y", "x", "state"), delta[None])}, coords)
        return ellipse_model(fit_ellipses(map_, refinement=_REFINEMENT))
    except LocalizeError as error:
        return str(error)


def crossing_line(touch: Touched) -> str:
    """Describe the position by the paper's ellipses in a line."""
    if touch.crossing is None:
        return f"ellipses: {touch.problem}"
    meet, (x0, y0) = touch.crossing, touch.row
    first, second = meet.coils
    either = " or ".join(f"{(y0 + sign * meet.y) * 1e3:.2f}" for sign in (1, -1))
    return true_minus(f"ellipses of {first} and {second} meet at x = {(x0 + meet.x) * 1e3:.2f}, y = {either} mm")


def touched_scene(board: BoardParts, dent: xr.Dataset, touch: Touched) -> Scene:
    """Scene of a touch."""
    design, setup = board.design, indentation_of(board.design)
    scene = coloured_by_delta(board, touch.delta)
    x, y = touch.at
    x_min, y_min, x_max, y_max = design.array.bounds
    if x_min < x < x_max and y_min < y < y_max:
        scene += scene_of_dent(design.array, design.sheets, dent, setup.indenter, (x, y), opacity=VEILED)
    return scene + scene_of_location(touch.location, bounds=design.array.bounds, top=design.top, truth=touch.at)


def touch_drawing(design: Design, view: TopView, touch: Touched) -> dict[str, Any]:
    """Draw the marks of a touch."""
    colours = state_colours(design)
    x, y = view.point(*touch.at)
    radius = 0.0 if design.indentation is None else design.indentation.indenter.radius_at(touch.depth) * 1e3
    ellipses = []
    for state, one in touch.ellipses.items():
        cx, cy = view.point(one.x0 + touch.row[0], touch.row[1])
        ellipses.append(
            {
                "x": cx,
                "y": cy,
                "rx": round(one.A * 1e3, 3),
                "ry": round(one.B * 1e3, 3),
                "colour": colours.get(state, INK),
            }
        )
    crossing = None
    if touch.crossing is not None:
        (x0, y0), meet = touch.row, touch.crossing
        crossing = [view.point(x0 + meet.x, y0 + sign * meet.y) for sign in (1, -1)]
    return {
        "indenter": {"x": x, "y": y, "r": max(radius, 0.5)},
        "ellipses": ellipses,
        "crossing": crossing or [],
        "pins": pins(view, touch.location),
        "fills": delta_fills(design, touch.delta),
    }


_SHOWN = 1e-5  # m, last digit of a place on the page, as a place at the edge may be rounded beyond it
_NOTHING: dict[str, Any] = {
    "indenter": None, "ellipses": [], "crossing": [], "pins": [], "fills": {}
}  # fmt: skip


class TouchPanel(Panel):
    """Panel with the indenter on the board."""

    def __init__(self, session: Session) -> None:
        self._view: TopView = top_view(session.work.design)
        self._tables: dict[str, xr.Dataset] = {}
        self._sensor: Sensor | None = None
        self._touched: Touched | None = None
        self._dent: tuple[Design, float, xr.Dataset] | None = None
        values = {
            "plan": board_drawing(session.work.design, self._view), "touch": _NOTHING, "bars": [], "located": [],
            "touch_note": "", "touch_ready": False,
            "touch_work": touch_work(session.work.design), "place": {"x": "", "y": "", "depth": ""}, "place_error": "",
            "can_touch": session.work.design.indentation is not None, "dragging": False, "pressing": False
        }  # fmt: skip
        session.state.client_only("dragging", "pressing")
        super().__init__(session, values, compute_table=self._compute, press=self._press, press_at=self._press_at)

    def show(self, design: Design, *, anew: bool) -> None:
        """Show the board of a design."""
        state = self._session.state
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
        """Scene of the touch or None, made in a thread."""
        touch = self._touched
        if touch is None or self._sensor is None or self._sensor.design is not design or touch.depth <= 0:
            return None
        if self._dent is None or self._dent[0] is not design or self._dent[1] != touch.depth:
            self._dent = design, touch.depth, dent_of_design(design, touch.depth)
        return touched_scene(board, self._dent[2], touch)

    # ---------------------------------------------------------------- the response

    def _compute(self) -> None:
        """Compute the response of the design."""
        session = self._session
        design = session.work.design

        def done(table: xr.Dataset) -> None:
            """Keep the response, and use it for its design."""
            self._tables[design.digest] = table
            if session.work.design.digest == design.digest:
                self._take_table(session.work.design, table)
                session.redraw()
            else:
                note("The design has changed since: its response is to be computed anew.")

        def note(text: str = "Cancelled.") -> None:
            session.state.touch_note = text

        table, text = session.setup.services.response_table, f"response of {design.name}"
        document = session.work.opened.document
        if session.start_bar("table", text, table, document, design.name, done=done, cancelled=note):
            note("")

    def _take_table(self, design: Design, table: xr.Dataset) -> None:
        """Use a response for touches."""
        try:
            self._sensor = sensor_of(design, table)
        except CoilarrayError as error:
            self._session.state.touch_note = str(error)
            return
        self._session.state.touch_ready, self._session.state.touch_note = True, ""
        self._put(*first_place(self._sensor))

    # ---------------------------------------------------------------- the indenter

    def _press(self, across: float, down: float) -> None:
        """Press at the pointer."""
        if self._sensor is not None and self._touched is not None:
            x, y = self._view.place(float(across), float(down))
            self._put(x, y, self._touched.depth)
            self._session.redraw()

    def _press_at(self, x: str, y: str, depth: str) -> None:
        """Press at numbers in mm."""
        if self._sensor is None:
            return
        try:
            numbers = _place(self._sensor, (x, y, depth))
        except CoilarrayError as error:
            self._session.state.place_error = str(error)
            return
        self._put(*numbers)
        self._session.redraw()

    def _put(self, x: float, y: float, depth: float) -> None:
        """Press at a place and show the result."""
        if self._sensor is None:
            return
        design, state = self._sensor.design, self._session.state
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
    """Place and depth in m from texts in mm, or DesignError."""
    numbers = []
    limits = zip(sensor.model.lower.tolist(), sensor.model.upper.tolist(), strict=True)
    for name, text, (low, high) in zip(("x", "y", "depth"), texts, limits, strict=True):
        number = number_of(name, str(text)) * 1e-3
        if not low - _SHOWN <= number <= high + _SHOWN:
            line = f"{name} must be {low * 1e3:.2f} to {high * 1e3:.2f} mm; got {number * 1e3:g}."
            raise DesignError(true_minus(line))
        numbers.append(number)
    return numbers
