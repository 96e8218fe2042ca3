"""What the sensor reads where the indenter presses, and where that puts it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import xarray as xr

from coilarray.design.model import Design, Indentation
from coilarray.errors import LocalizeError
from coilarray.localize.ellipse import Ellipse, fit_ellipses
from coilarray.localize.ellipse_model import EllipseModel, EllipsePosition, ellipse_model, locate_x
from coilarray.localize.forward import ForwardModel, forward_model
from coilarray.localize.inverse import Location, locate
from coilarray.response.setup import indentation_of

NOISE = 1e-5
"""Standard deviation of δ that a position is told with."""

_STEP = 1e-3  # m between the points of a map that ellipses are fitted to
_REFINEMENT = 5  # of it; 20, the default, moves x0 by less than 0.1 mm and takes ten times as long
_LEAST_DELTA = 3 * NOISE  # below it a coil's ellipse is noise


@dataclass(frozen=True, eq=False)
class Sensor:
    """A design that can be pressed, with its response.

    Parameters
    ----------
    design : Design
        With an indentation.
    model : ForwardModel
        Of its response.
    """

    design: Design
    model: ForwardModel

    @property
    def setup(self) -> Indentation:
        """The indentation of the design."""
        return indentation_of(self.design)


@dataclass(frozen=True, eq=False)
class Touched:
    """One place of the indenter, and what is read there.

    Parameters
    ----------
    at : tuple of float
        x and y in m from the map's origin.
    depth : float
        In m.
    delta : mapping of str to float
        δ of every state.
    location : Location
        From these δ, without noise in them.
    ellipses : mapping of str to Ellipse
        Of the paper's model, by state, where it has one for the δ.
    crossing : EllipsePosition or None
        Where the paper's model puts the indenter.
    problem : str
        Why there are no ellipses or no crossing; empty where there are.
    """

    at: tuple[float, float]
    depth: float
    delta: Mapping[str, float]
    location: Location
    ellipses: Mapping[str, Ellipse]
    crossing: EllipsePosition | None
    problem: str


def sensor_of(design: Design, table: xr.Dataset) -> Sensor:
    """Put a design and its response table together.

    Raises
    ------
    LocalizeError
        A table of another design, or none.
    ElastomerError
        A design without an indentation.
    """
    indentation_of(design)
    if table.attrs.get("design_hash") != design.digest:
        raise LocalizeError("the response table is that of another design.")
    return Sensor(design, forward_model(table))


def first_place(sensor: Sensor) -> tuple[float, float, float]:
    """Return where the indenter begins: x, y and depth in m, off the middle of the map, where a position is told."""
    setup = sensor.setup
    x, y = (np.array(axis) for axis in (setup.x, setup.y))
    return float(x.mean() + np.ptp(x) / 8), float(y.mean() + np.ptp(y) / 4), max(setup.depths)


def touched(sensor: Sensor, x: float, y: float, depth: float) -> Touched:
    """Press somewhere; a place beyond the response is moved to its edge.

    Parameters
    ----------
    sensor : Sensor
        The board.
    x, y : float
        In m from the map's origin.
    depth : float
        In m.
    """
    low, high = sensor.model.lower, sensor.model.upper
    point = np.clip([x, y, depth], low, high)
    delta = sensor.model.delta(point)
    readings = dict(zip(sensor.model.states, delta.tolist(), strict=True))
    location = locate(sensor.model, delta, noise=NOISE)
    ellipses, crossing, problem = _by_ellipses(sensor.model, float(point[2]), readings)
    return Touched((float(point[0]), float(point[1])), float(point[2]), readings, location, ellipses, crossing, problem)


def _by_ellipses(
    model: ForwardModel, depth: float, readings: Mapping[str, float]
) -> tuple[Mapping[str, Ellipse], EllipsePosition | None, str]:
    fitted = _ellipse_model(model, round(depth, 6))
    if isinstance(fitted, str):
        return {}, None, fitted
    ellipses = {}
    for coil in fitted.coils:
        delta = readings[coil.name]
        if delta >= _LEAST_DELTA and coil.covers(delta):
            try:
                ellipses[coil.name] = coil.ellipse(delta)
            except LocalizeError:  # the polynomials have none there
                continue
    try:
        return ellipses, locate_x(fitted, readings), ""
    except LocalizeError as error:
        return ellipses, None, str(error)


@lru_cache(maxsize=16)
def _ellipse_model(model: ForwardModel, depth: float) -> EllipseModel | str:
    """Fit the paper's model to the response at one depth, or say why that cannot be."""
    x, y = (np.arange(axis[0], axis[-1] + _STEP / 2, _STEP) for axis in (model.x, model.y))
    x, y = (np.minimum(axis, last[-1]) for axis, last in ((x, model.x), (y, model.y)))
    points = np.empty((len(y), len(x), 3))
    points[..., 0], points[..., 1], points[..., 2] = x, y[:, None], depth
    try:
        delta = model.delta(points)
        coords = {"depth": [depth], "y": y, "x": x, "state": list(model.states)}
        map_ = xr.Dataset({"delta": (("depth", "y", "x", "state"), delta[None])}, coords)
        return ellipse_model(fit_ellipses(map_, refinement=_REFINEMENT, connected=False))
    except LocalizeError as error:
        return str(error)
