"""Default positions of a response map over the array."""

from __future__ import annotations

import math

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.errors import DesignError
from coilarray.geometry import Array

MOST_POSITIONS = 100_000
"""Most positions of a map."""
# Parts of the narrowest coil for the finest and the coarsest step, which resolve its response.
_PARTS = {"indentation": (12.0, 6.0), "target": (12.0, 4.0)}
_PARTS_OF_ONE = (32.0, 12.0)  # of a single coil, whose map is small
_POSITIONS = {"indentation": 2000.0, "target": 500.0}  # of a map, if the step allows. Targets are wide
_ROUND = 0.1e-3  # m. A step is a multiple of it, and a multiple of five times it from there on

Positions = tuple[tuple[float, ...], tuple[float, ...]]


def array_window(
    array: Array,
    origin: tuple[float, float],
    step: float | None = None,
    within: tuple[float, float, float, float] | None = None,
    table: str = "indentation",
) -> Positions:
    """Return an even grid over all coils from an origin.

    Positions are multiples of the step in m. By default it is a twelfth of the narrowest coil, and
    a thirty-second of a single coil. To avoid more than 2000 positions it is up to a sixth, and to
    avoid more than 500 positions of a target up to a quarter. For a single coil it is up to a
    twelfth. On a board of thousands of coils it is wider, until 100000 positions suffice. If no
    position lies in `within` (x_min, y_min, x_max, y_max), its middle is the only one.
    """
    bounds = np.reshape(array.outline_bounds, (2, 2)) - origin
    chosen = _default_step(array, np.ptp(bounds, axis=0), table) if step is None else step
    first, last = _multiples(bounds, chosen, within)
    while math.prod((last - first + 1).tolist()) > MOST_POSITIONS:
        if step is not None:
            raise DesignError(
                f"{table}.step_mm of {step * 1e3:g} gives more than {MOST_POSITIONS} positions over all coils."
            )
        chosen = _round(1.1 * chosen + 5 * _ROUND)  # rounding cannot take this back
        first, last = _multiples(bounds, chosen, within)
    x, y = (
        # Divided by 1e3, not multiplied: positions are labels, and -26 mm must be -0.026 m.
        tuple(round((a + k) * chosen * 1e3, 9) / 1e3 for k in range(round(b - a) + 1))
        for a, b in zip(first.tolist(), last.tolist(), strict=True)
    )
    return x, y


def _default_step(array: Array, size: FloatArray, table: str) -> float:
    """Return the step in m that resolves the narrowest coil."""
    sides = [np.ptp(place.to_board(place.coil.outline), axis=0).min() for place in array.placements]
    narrowest = float(min(sides))
    finest, coarsest = (narrowest / part for part in (_PARTS[table] if len(sides) > 1 else _PARTS_OF_ONE))
    return _round(min(max(math.sqrt(float(np.prod(size)) / _POSITIONS[table]), finest), coarsest))


def _round(step: float) -> float:
    unit = _ROUND if step < 5 * _ROUND else 5 * _ROUND
    return max(round(step / unit), 1) * unit


def _multiples(
    bounds: FloatArray, step: float, within: tuple[float, float, float, float] | None
) -> tuple[FloatArray, FloatArray]:
    """Return the first and last multiples of the step."""
    first, last = np.floor(bounds[0] / step + 1e-9), np.ceil(bounds[1] / step - 1e-9)
    if within is not None:
        first = np.maximum(first, np.ceil(np.array(within[:2]) / step - 1e-9))
        last = np.minimum(last, np.floor(np.array(within[2:]) / step + 1e-9))
        empty = last < first
        middle = (np.array(within[:2]) + within[2:]) / 2 / step
        first, last = np.where(empty, middle, first), np.where(empty, middle, last)
    return first, last
