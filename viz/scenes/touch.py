"""An indenter that moves over the board: the scenes of a film."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from coilarray.compute.threads import Progress
from coilarray.design.model import Design, Indentation
from coilarray.elastomer.contact import indent
from coilarray.errors import GeometryError
from coilarray.localize.forward import forward_model
from coilarray.response.map import response_map
from coilarray.response.setup import indentation_of
from coilarray.viz.scenes.board import CoilColours, copper_parts, recoloured, scene_of_board
from coilarray.viz.scenes.dent import VEILED, scene_of_dent
from coilarray.viz.scenes.draw import shown_units
from coilarray.viz.scenes.scene import Scale, Scene, Text, symmetric

FloatArray = npt.NDArray[np.float64]

DELTA = "delta (1)"
"""Name of the cell array of each coil's relative change of inductance."""

_STEPS = 5  # positions of the response in the thickness of all sheets, as `coilarray.localize.forward` needs them
_BELOW = 0.17  # from a coil's name down to its number, in the coil's length along y
_LEAST_STEPS = 3  # along each axis: four positions carry a cubic


@dataclass(frozen=True, eq=False)
class Touch:
    """A way of the indenter, with δ of every coil along it.

    Parameters
    ----------
    design : Design
        The board.
    depth : float
        In m.
    places : ndarray, shape (n, 2)
        Of the indenter in m from the map's origin.
    delta : ndarray, shape (n, coils)
        δ of the first state that measures each coil; NaN for a coil that none measures.
    """

    design: Design
    depth: float
    places: FloatArray
    delta: FloatArray

    def scenes(self) -> Iterator[Scene]:
        """Return what is seen at every place: the dented sheets, the indenter, and the copper coloured by δ."""
        design, setup = self.design, indentation_of(self.design)
        pressed = indent(design.sheets, setup.indenter, [self.depth], base=setup.base, radius=setup.sample_radius)
        dent, copper, scale = pressed.isel(depth=0), copper_parts(design.array), self.scale
        for (x, y), delta in zip(self.places.tolist(), self.delta, strict=True):
            on_board = (x + setup.origin_point[0], y + setup.origin_point[1])
            where = f"x = {x * 1e3:+.1f} mm, y = {y * 1e3:+.1f} mm, {self.depth * 1e3:g} mm deep".replace("-", "−")
            coils = Scene(
                recoloured(copper, CoilColours(delta, scale)), self._numbers(delta), (f"The indenter is at {where}.",)
            )
            yield coils + scene_of_dent(design.array, design.sheets, dent, setup.indenter, on_board, opacity=VEILED)

    def _numbers(self, delta: FloatArray) -> tuple[Text, ...]:
        """δ of every coil below its name, in the unit of the colour bar."""
        factor, _ = shown_units(self.scale)
        below = _BELOW * float(np.ptp(self.design.array.placements[0].coil.outline[:, 1]))
        return tuple(
            Text(f"{round(value * factor):+d}".replace("-", "−"), (x * 1e3, (y - below) * 1e3, 0.0), 16.0)
            for value, (x, y) in zip(delta.tolist(), self.design.array.centres.tolist(), strict=True)
            if math.isfinite(value)
        )

    @property
    def scale(self) -> Scale:
        """One scale of δ for the whole way."""
        return symmetric(DELTA, "δ", "", self.delta)

    def board(self) -> Scene:
        """Return what stands still: the board without its copper."""
        board = scene_of_board(self.design.array)
        return replace(board, parts=tuple(part for part in board.parts if not part.name.startswith("copper ")))


def touch_along(
    design: Design,
    corners: Sequence[tuple[float, float]] | None = None,
    *,
    count: int = 48,
    depth: float | None = None,
    progress: Progress | None = None,
) -> Touch:
    """Compute what an indenter does on its way over the board.

    Parameters
    ----------
    design : Design
        With the tables ``[indenter]`` and ``[indentation]``.
    corners : sequence of (float, float), optional
        Of the way, in m from the map's origin, at least two; by default straight along x over all coils, at the
        middle of the map in y.
    count : int
        Of places, in equal steps, at least 2.
    depth : float, optional
        In m; the deepest of the design by default.
    progress : callable, optional
        Called with (done, total) as the response is computed.

    Returns
    -------
    Touch

    Raises
    ------
    ElastomerError
        A design without an indenter, or an indentation that cannot be.
    GeometryError
        A way that leaves the board or has no length, or too few places.
    """
    setup = indentation_of(design)
    if count < 2:
        raise GeometryError(f"a film must have at least 2 pictures; got {count}.")
    way = np.array(_default_way(design, setup) if corners is None else corners, dtype=np.float64)
    places = _along(way, count)
    _require_on_board(design, setup, places)
    deep = max(setup.depths) if depth is None else depth
    thickness = sum(sheet.thickness for sheet in design.sheets)
    x, y = (_positions(places[:, k], thickness / _STEPS) for k in range(2))
    response = response_map(design, depths=[deep], x=x, y=y, progress=progress)
    model = forward_model(response)
    points = np.column_stack((places, np.full(len(places), deep)))
    by_state = dict(zip(model.states, model.delta(points).T, strict=True))
    first = first_states(design)
    nothing = np.full(len(places), np.nan)
    delta = [by_state[first[coil]] if coil in first else nothing for coil in design.array.names]
    return Touch(design, deep, places, np.column_stack(delta))


def first_states(design: Design) -> dict[str, str]:
    """Return the first state of the plan that measures each coil, by the name of the coil."""
    return {state.measured[0][0]: state.name for state in reversed(design.plan)}


def _default_way(design: Design, setup: Indentation) -> list[tuple[float, float]]:
    outlines = np.concatenate([place.to_board(place.coil.outline) for place in design.array.placements])
    x = outlines[:, 0] - setup.origin_point[0]
    y = (setup.y[0] + setup.y[-1]) / 2
    return [(float(x.min()), y), (float(x.max()), y)]


def _along(way: FloatArray, count: int) -> FloatArray:
    """Places in equal steps along a way."""
    length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))]
    if not (np.isfinite(length).all() and length[-1] > 0):
        raise GeometryError("the way of an indenter must have a length; all its corners are one.")
    at = np.linspace(0.0, length[-1], count)
    return np.column_stack([np.interp(at, length, way[:, k]) for k in range(2)])


def _require_on_board(design: Design, setup: Indentation, places: FloatArray) -> None:
    on_board = places + setup.origin_point
    x_min, y_min, x_max, y_max = design.array.bounds
    inside = ((on_board > [x_min, y_min]) & (on_board < [x_max, y_max])).all(axis=1)
    if not inside.all():
        x, y = places[~inside][0] * 1e3
        low = (np.array([x_min, y_min]) - setup.origin_point) * 1e3
        high = (np.array([x_max, y_max]) - setup.origin_point) * 1e3
        raise GeometryError(
            f"the way of the indenter must be over the board, from ({low[0]:.4g}, {low[1]:.4g}) to "
            f"({high[0]:.4g}, {high[1]:.4g}) mm of the map; got ({x:.4g}, {y:.4g}) mm."
        )


def _positions(values: FloatArray, step: float) -> FloatArray:
    """Positions at most a step apart over all values, at least four."""
    low, high = float(values.min()), float(values.max())
    short = _LEAST_STEPS * step - (high - low)
    if short > 0:
        low, high = low - short / 2, high + short / 2
    return np.linspace(low, high, math.ceil((high - low) / step - 1e-9) + 1)
