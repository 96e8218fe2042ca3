"""Scenes of a film with a moving indenter."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr

from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import true_minus
from coilarray.compute.threads import Progress
from coilarray.design.model import Design, Indentation
from coilarray.localize.forward import forward_model
from coilarray.response.dataset import on_board
from coilarray.response.map import response_map
from coilarray.response.setup import contact_at, indentation_of
from coilarray.viz.datasets.results import DELTA
from coilarray.viz.scenes.board import VEILED, CoilColours, board_in_pieces, recoloured, scene_of_dent
from coilarray.viz.scenes.draw import shown_units
from coilarray.viz.scenes.scene import Part, Scale, Scene, Text, about_zero

_STEPS = 5  # positions of the response per thickness of all sheets, as `coilarray.localize.forward` needs them
_BELOW = 0.17  # distance from a coil's name down to its number, over the coil's length along y


@dataclass(frozen=True, eq=False)
class Touch:
    """Path of the indenter with δ of every coil."""

    design: Design
    depth: float  # m
    places: FloatArray  # shape (n, 2), m on the board
    delta: FloatArray  # shape (n, coils), of the first state that measures each coil, or NaN

    @cached_property
    def _board(self) -> tuple[tuple[Part, ...], Scene]:
        """Copper of the board, and the rest."""
        return board_in_pieces(self.design.array)

    @property
    def scale(self) -> Scale:
        """Scale of δ for the whole path."""
        return about_zero(DELTA, "δ", "", self.delta)

    def board(self) -> Scene:
        """Board without its copper, which does not change."""
        return self._board[1]

    def scenes(self) -> Iterator[Scene]:
        """Make one scene per place."""
        array, setup, scale = self.design.array, indentation_of(self.design), self.scale
        dent = dent_of_design(self.design, self.depth)
        factor, _ = shown_units(scale)
        below = _BELOW * float(np.ptp(array.placements[0].coil.outline[:, 1]))
        for (x, y), delta in zip(self.places.tolist(), self.delta, strict=True):
            where = true_minus(f"x = {x * 1e3:+.1f} mm, y = {y * 1e3:+.1f} mm, {self.depth * 1e3:g} mm deep")
            numbers = tuple(
                Text(true_minus(f"{round(value * factor):+d}"), (across * 1e3, (along - below) * 1e3, 0.0), 16.0)
                for value, (across, along) in zip(delta.tolist(), array.centres.tolist(), strict=True)
                if math.isfinite(value)
            )
            coils = recoloured(self._board[0], CoilColours(delta, scale))
            scene = Scene(coils, numbers, (f"The indenter is at {where}.",))
            yield scene + scene_of_dent(array, self.design.sheets, dent, setup.indenter, (x, y), opacity=VEILED)


def touch_along(
    design: Design, *, count: int = 48, depth: float | None = None, progress: Progress | None = None
) -> Touch:
    """Compute δ along a path of the indenter.

    The path has `count` places at equal steps along x over all coils through the middle coil.
    `depth` in m is by default the deepest of the design.
    """
    setup, array = indentation_of(design), design.array
    outlines = np.concatenate([place.to_board(place.coil.outline) for place in array.placements])
    low, high = (end + setup.origin_point[1] for end in (setup.y[0], setup.y[-1]))
    line = float(np.clip(array.centres[array.names.index(array.middle_coil), 1], low, high))
    along = np.linspace(outlines[:, 0].min(), outlines[:, 0].max(), count)
    places = np.column_stack((along, np.full(count, line)))
    deep = max(setup.depths) if depth is None else depth
    # the spline of the model needs four positions along y too
    step = sum(sheet.thickness for sheet in design.sheets) / _STEPS
    x = np.linspace(along[0], along[-1], max(math.ceil(float(np.ptp(along)) / step - 1e-9) + 1, 4))
    y = line + step * np.linspace(-1.5, 1.5, 4)
    x, y = x - setup.origin_point[0], y - setup.origin_point[1]
    response = response_map(design, depths=[deep], x=x, y=y, accuracy="auto", progress=progress)
    model = forward_model(on_board(response))
    by_state = dict(zip(model.states, model.delta(np.column_stack((places, np.full(count, deep)))).T, strict=True))
    first, nothing = first_states(design), np.full(count, np.nan)
    delta = [by_state[first[coil]] if coil in first else nothing for coil in array.names]
    return Touch(design, deep, places, np.column_stack(delta))


def first_states(design: Design) -> dict[str, str]:
    """First state of the plan that measures each coil."""
    return {state.measured[0][0]: state.name for state in reversed(design.plan)}


def off_middle(setup: Indentation) -> tuple[float, float]:
    """Place on the board off the map's centre in m.

    On a symmetric board's middle line δ has no first-order dependence and so no ellipse.
    """
    x, y = (np.add(axis, origin) for axis, origin in zip((setup.x, setup.y), setup.origin_point, strict=True))
    return float(x.mean() + np.ptp(x) / 8), float(y.mean() + np.ptp(y) / 4)


def dent_of_design(design: Design, depth: float) -> xr.Dataset:
    """Press into a design's sheets to a depth in m, see `indent`."""
    return contact_at(indentation_of(design), design.sheets, np.array([depth])).isel(depth=0)
