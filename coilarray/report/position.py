"""How well the paper's ellipse model finds the positions of a response map that it was fitted to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr

from coilarray.errors import LocalizeError
from coilarray.localize.ellipse import Ellipse, fit_ellipses
from coilarray.localize.ellipse_model import SEMIAXIS_ADDITION, EllipseModel, EllipsePosition, ellipse_model, locate_x
from coilarray.report.tables import Column, Table, Value
from coilarray.response.coordinates import axis_label, in_ellipse_window, origin_of

Place = tuple[float, float]
"""Real x and y in m, as the map counts them."""


@dataclass(frozen=True, eq=False)
class MapPositions:
    """Positions that the ellipse model of a map, with nothing added to A, gives for the map's own readings.

    The depth is in m; `readings` are δ of every coil at every place of the grid, `found` the places where the model has
    a position, with A longer by `SEMIAXIS_ADDITION` as in the paper. All of them count from the map's `origin`, x and y
    in m on the board; ``axis`` names it for the label of x in mm.
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
        """Determined less real x in m over y and x on the board; NaN where there is no position."""
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
        """Return the place beside the axis of the coils whose ellipses are best known: the lesser δ is largest."""

        def rank(place: Place) -> tuple[bool, bool, float]:
            position = self.found[place]
            lesser = min(self.readings[place][coil] for coil in position.coils)
            return position.case == "two points", abs(place[1]) > 1e-9, lesser

        return max(self.found, key=rank)

    def ellipses(self, place: Place) -> dict[str, Ellipse]:
        """Return the two ellipses that meet for a place where there is a position, by their coils."""
        model = self.model.with_semiaxis_addition(SEMIAXIS_ADDITION)
        return {coil: model[coil].ellipse(self.readings[place][coil]) for coil in self.found[place].coils}


def map_positions(response: xr.Dataset) -> MapPositions:
    """Fit the ellipse model to the deepest map of a response and locate each of the map's own places.

    LocalizeError for a map with fewer than two coils whose curves close, or at none of whose places the model has a
    position.
    """
    response = in_ellipse_window(response)
    if response.sizes["state"] < 2:
        raise LocalizeError(f"a position needs two coils; the map has only {response.state.values[0]}.")
    fits = fit_ellipses(response, -1)
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
        except LocalizeError:  # the model knows no position for it: the picture leaves the place grey
            continue
    if not found:
        raise LocalizeError("the ellipses meet at none of the map's places.")
    return MapPositions(
        fits, model, float(delta.depth), readings, found, origin_of(response), axis_label(response, "x")
    )


def map_position_table(positions: MapPositions) -> Table:
    """Return one row for each place of the map on the board: real and determined x, and whose ellipses meet."""
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
