"""Readings of the sensor at a place of the indenter.

The position is located from them, and both are described in words.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import xarray as xr

from coilarray.compute.display_units import true_minus
from coilarray.design.model import Design
from coilarray.errors import LocalizeError
from coilarray.localize.forward import ForwardModel, forward_model
from coilarray.localize.inverse import Location, locate
from coilarray.paper.ellipse import Ellipse, fit_ellipses
from coilarray.paper.ellipse_model import EllipseModel, EllipsePosition, ellipse_model, locate_x
from coilarray.response.dataset import on_board
from coilarray.response.setup import indentation_of
from coilarray.viz.scenes.touch import off_middle

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
    """First x, y and depth of the indenter in m.

    The place is off the centre of the map.
    """
    setup = indentation_of(sensor.design)
    return *off_middle(setup), max(setup.depths)


def touched(sensor: Sensor, x: float, y: float, depth: float) -> Touched:
    """Press at a place on the board in m.

    A place beyond the response is moved to its edge.
    """
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
    """Fit the paper's model to the response at one depth.

    `row` is its origin. If the fit is impossible, the reason is returned.
    """
    x, y = (np.arange(axis[0], axis[-1] + _STEP / 2, _STEP) for axis in (model.x, model.y))
    x, y = (np.minimum(axis, last[-1]) for axis, last in ((x, model.x), (y, model.y)))
    points = np.empty((len(y), len(x), 3))
    points[..., 0], points[..., 1], points[..., 2] = x, y[:, None], depth
    try:
        delta = model.delta(points)
        coords = {"depth": [depth], "y": y - row[1], "x": x - row[0], "state": list(model.states)}
        map_ = xr.Dataset({"delta": (("depth", "y", "x", "state"), delta[None])}, coords)
        return ellipse_model(fit_ellipses(map_, refinement=_REFINEMENT, connected=False))
    except LocalizeError as error:
        return str(error)


def crossing_line(touch: Touched) -> str:
    """Describe the position by the paper's ellipses in a line.

    If there is no position, the line gives the reason.
    """
    if touch.crossing is None:
        return f"ellipses: {touch.problem}"
    meet, (x0, y0) = touch.crossing, touch.row
    first, second = meet.coils
    either = " or ".join(f"{(y0 + sign * meet.y) * 1e3:.2f}" for sign in (1, -1))
    return true_minus(f"ellipses of {first} and {second} meet at x = {(x0 + meet.x) * 1e3:.2f}, y = {either} mm")
