"""Scenes of a film with a moving indenter."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import true_minus
from coilarray.compute.threads import Progress
from coilarray.design.model import Design, Indentation
from coilarray.errors import GeometryError
from coilarray.localize.forward import forward_model
from coilarray.response.dataset import on_board
from coilarray.response.map import response_map
from coilarray.response.setup import contact_at, indentation_of
from coilarray.viz.datasets.results import DELTA
from coilarray.viz.scenes.board import VEILED, CoilColours, board_in_pieces, copper_parts, recoloured, scene_of_dent
from coilarray.viz.scenes.draw import shown_units
from coilarray.viz.scenes.scene import Scale, Scene, Text, about_zero

_STEPS = 5  # positions of the response per thickness of all sheets, as `coilarray.localize.forward` needs them
_BELOW = 0.17  # distance from a coil's name down to its number, over the coil's length along y
_LEAST_STEPS = 3  # along each axis, as a cubic needs four positions


@dataclass(frozen=True, eq=False)
class Touch:
    """Path of the indenter with δ of every coil."""

    design: Design
    depth: float  # m
    places: FloatArray  # shape (n, 2), m on the board
    delta: FloatArray  # shape (n, coils), of the first state that measures each coil, or NaN

    def scenes(self) -> Iterator[Scene]:
        """Make one scene per place."""
        design, setup = self.design, indentation_of(self.design)
        dent, copper, scale = dent_of_design(design, self.depth), copper_parts(design.array), self.scale
        for (x, y), delta in zip(self.places.tolist(), self.delta, strict=True):
            where = true_minus(f"x = {x * 1e3:+.1f} mm, y = {y * 1e3:+.1f} mm, {self.depth * 1e3:g} mm deep")
            coils = Scene(
                recoloured(copper, CoilColours(delta, scale)), self._numbers(delta), (f"The indenter is at {where}.",)
            )
            yield coils + scene_of_dent(design.array, design.sheets, dent, setup.indenter, (x, y), opacity=VEILED)

    def _numbers(self, delta: FloatArray) -> tuple[Text, ...]:
        """Texts of δ below the coils' names, in the bar's unit."""
        factor, _ = shown_units(self.scale)
        below = _BELOW * float(np.ptp(self.design.array.placements[0].coil.outline[:, 1]))
        return tuple(
            Text(true_minus(f"{round(value * factor):+d}"), (x * 1e3, (y - below) * 1e3, 0.0), 16.0)
            for value, (x, y) in zip(delta.tolist(), self.design.array.centres.tolist(), strict=True)
            if math.isfinite(value)
        )

    @property
    def scale(self) -> Scale:
        """Scale of δ for the whole path."""
        return about_zero(DELTA, "δ", "", self.delta)

    def board(self) -> Scene:
        """Board without its copper, which does not change."""
        return board_in_pieces(self.design.array)[1]


def touch_along(
    design: Design,
    corners: Sequence[tuple[float, float]] | None = None,
    *,
    count: int = 48,
    depth: float | None = None,
    progress: Progress | None = None,
) -> Touch:
    """Compute δ along a path of the indenter.

    The path has `count` places at equal steps along its `corners` on the board in m. The default is a straight line
    along x over all coils through the middle coil. `depth` in m is by default the deepest of the design. A design
    without an indenter or an impossible indentation raises an ElastomerError. A path that leaves the board or has no
    length, or fewer than two places, raises a GeometryError.
    """
    setup = indentation_of(design)
    if count < 2:
        raise GeometryError(f"a film must have at least 2 pictures; got {count}.")
    way = np.array(_default_way(design, setup) if corners is None else corners, dtype=np.float64)
    places = _along(way, count)
    _require_on_board(design, places)
    deep = max(setup.depths) if depth is None else depth
    thickness = sum(sheet.thickness for sheet in design.sheets)
    x, y = (_positions(places[:, k] - setup.origin_point[k], thickness / _STEPS) for k in range(2))
    response = response_map(design, depths=[deep], x=x, y=y, reach="auto", progress=progress)
    model = forward_model(on_board(response))
    points = np.column_stack((places, np.full(len(places), deep)))
    by_state = dict(zip(model.states, model.delta(points).T, strict=True))
    first = first_states(design)
    nothing = np.full(len(places), np.nan)
    delta = [by_state[first[coil]] if coil in first else nothing for coil in design.array.names]
    return Touch(design, deep, places, np.column_stack(delta))


def first_states(design: Design) -> dict[str, str]:
    """First state of the plan that measures each coil."""
    return {state.measured[0][0]: state.name for state in reversed(design.plan)}


def off_middle(setup: Indentation) -> tuple[float, float]:
    """Place on the board off the map's centre in m.

    On the middle line of a symmetric board δ does not depend on the position to first order, so that it has no ellipse.
    """
    x, y = (np.add(axis, origin) for axis, origin in zip((setup.x, setup.y), setup.origin_point, strict=True))
    return float(x.mean() + np.ptp(x) / 8), float(y.mean() + np.ptp(y) / 4)


def dent_of_design(design: Design, depth: float) -> xr.Dataset:
    """Press into a design's sheets to a depth in m, see `indent`."""
    return contact_at(indentation_of(design), design.sheets, np.array([depth])).isel(depth=0)


def _default_way(design: Design, setup: Indentation) -> list[tuple[float, float]]:
    outlines = np.concatenate([place.to_board(place.coil.outline) for place in design.array.placements])
    low, high = (end + setup.origin_point[1] for end in (setup.y[0], setup.y[-1]))
    y = float(np.clip(design.array.centres[design.array.names.index(design.array.middle_coil), 1], low, high))
    return [(float(x), y) for x in (outlines[:, 0].min(), outlines[:, 0].max())]


def _along(way: FloatArray, count: int) -> FloatArray:
    """Places at equal steps along a path."""
    length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))]
    if not (np.isfinite(length).all() and length[-1] > 0):
        raise GeometryError("the path of the indenter must have a length; all its corners are the same.")
    at = np.linspace(0.0, length[-1], count)
    return np.column_stack([np.interp(at, length, way[:, k]) for k in range(2)])


def _require_on_board(design: Design, places: FloatArray) -> None:
    """Refuse places that are not over the board."""
    x_min, y_min, x_max, y_max = design.array.bounds
    inside = ((places > [x_min, y_min]) & (places < [x_max, y_max])).all(axis=1)
    if not inside.all():
        x, y = places[~inside][0] * 1e3
        raise GeometryError(
            f"the path of the indenter must be over the board, from ({x_min * 1e3:.4g}, {y_min * 1e3:.4g}) to "
            f"({x_max * 1e3:.4g}, {y_max * 1e3:.4g}) mm; got ({x:.4g}, {y:.4g}) mm."
        )


def _positions(values: FloatArray, step: float) -> FloatArray:
    """At least four positions over all values, at most a step apart."""
    low, high = float(values.min()), float(values.max())
    short = _LEAST_STEPS * step - (high - low)
    if short > 0:
        low, high = low - short / 2, high + short / 2
    return np.linspace(low, high, math.ceil((high - low) / step - 1e-9) + 1)
