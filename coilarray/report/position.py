"""Positions of a response map by the paper's ellipse model fitted to the same map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr

from coilarray.compute.table import Column, Table, Value
from coilarray.errors import LocalizeError
from coilarray.paper.ellipse import Ellipse, fit_ellipses
from coilarray.paper.ellipse_model import SEMIAXIS_ADDITION, EllipseModel, EllipsePosition, ellipse_model, locate_x
from coilarray.response.dataset import axis_label, in_ellipse_window, origin_of

Place = tuple[float, float]
"""Real x and y in m, as the map counts them."""


@dataclass(frozen=True, eq=False)
class MapPositions:
    """Positions from a map's ellipse model for its own readings.

    The model has nothing added to A. The depth is in m. `readings` are δ of every coil at every place of the grid.
    `found` are the places where the model has a position, with A longer by `SEMIAXIS_ADDITION` as in the paper. All of
    them count from the map's `origin`, x and y in m on the board. ``axis`` names it for the label of x in mm.
    """

    fits: xr.Dataset
    model: EllipseModel
    depth: float
    readings: Mapping[Place, Mapping[str, float]]
    found: Mapping[Place, EllipsePosition]
    origin: tuple[float, float] = (0.0, 0.0)
    axis: str = "x (mm)"

    @property
    def error(self) -> xr.DataArray:
        """Determined minus real x in m over y and x.

        x and y are on the board. NaN where there is no position.
        """
        x, y = (sorted({place[k] for place in self.readings}) for k in (0, 1))
        values = np.full((len(y), len(x)), np.nan)
        for (at_x, at_y), position in self.found.items():
            values[y.index(at_y), x.index(at_x)] = position.x - at_x
        on_board = {"y": np.array(y) + self.origin[1], "x": np.array(x) + self.origin[0]}
        return xr.DataArray(values, on_board, ("y", "x"))

    def largest_error(self) -> float:
        """Largest |determined − real x| in m."""
        return max(abs(position.x - x) for (x, _), position in self.found.items())

    def example(self) -> Place:
        """Return the place with the best known ellipses.

        It is beside the axis of the coils. The lesser of its two δ is the largest.
        """

        def rank(place: Place) -> tuple[bool, bool, float]:
            position = self.found[place]
            lesser = min(self.readings[place][coil] for coil in position.coils)
            return position.case == "two points", abs(place[1]) > 1e-9, lesser

        return max(self.found, key=rank)

    def ellipses(self, place: Place) -> dict[str, Ellipse]:
        """Return the two intersecting ellipses of a place.

        They are listed by their coils. The place must have a position.
        """
        model = self.model.with_semiaxis_addition(SEMIAXIS_ADDITION)
        return {coil: model[coil].ellipse(self.readings[place][coil]) for coil in self.found[place].coils}


def map_positions(response: xr.Dataset) -> MapPositions:
    """Fit the ellipse model and locate the map's own places.

    The model is fitted to the deepest map of a response. Raises LocalizeError for a map with fewer than two coils whose
    curves close, or without a place for which the model has a position.
    """
    response = in_ellipse_window(response)
    if response.sizes["state"] < 2:
        raise LocalizeError(f"a position needs two coils; the map has only {response.state.values[0]}.")
    fits = fit_ellipses(response, float(response.depth[-1]))
    model = ellipse_model(fits)
    if len(model.coils) < 2:
        raise LocalizeError(f"a position needs closed curves of two coils; the map has only those of {model.names[0]}.")
    delta = response.delta.isel(depth=-1).transpose("y", "x", "state")
    states = delta.state.values.tolist()
    readings = {
        (x, y): dict(zip(states, delta.values[j, i].tolist(), strict=True))
        for j, y in enumerate(delta.y.values.tolist())
        for i, x in enumerate(delta.x.values.tolist())
    }
    widened = model.with_semiaxis_addition(SEMIAXIS_ADDITION)
    found = {}
    for place, reading in readings.items():
        try:
            found[place] = locate_x(widened, reading)
        except LocalizeError:  # the model has no position for it, and the picture leaves the place grey
            continue
    if not found:
        raise LocalizeError("the ellipses meet at none of the map's places.")
    return MapPositions(
        fits, model, float(delta.depth), readings, found, origin_of(response), axis_label(response, "x")
    )


def map_position_table(positions: MapPositions) -> Table:
    """Return a table of the places of the map.

    A row for each place on the board has real and determined x, and the coils of the intersecting ellipses.
    """
    columns = (
        *(Column(name, unit="m") for name in ("x", "y", "determined_x", "error")),
        Column("case"),
        Column("coils"),
    )
    rows: list[tuple[Value, ...]] = []
    from_x, from_y = positions.origin
    for x, y in positions.readings:
        position = positions.found.get((x, y))
        found: tuple[Value, ...] = ("", "", "", "")
        if position is not None:
            found = (position.x + from_x, position.x - x, position.case, " and ".join(position.coils))
        rows.append((x + from_x, y + from_y, *found))
    return Table("map_positions", "Positions of the map", columns, tuple(rows))
