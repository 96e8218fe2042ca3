"""Kinds of values that all shapes share, the check of a size, and how messages show a place."""

from __future__ import annotations

import math
from typing import Literal, get_args

from coilarray.errors import CoilarrayError, GeometryError

Point = tuple[float, float]
"""x and y in m, where nothing else is said."""
Side = Literal["right", "top", "left", "bottom"]
SIDES: tuple[Side, ...] = get_args(Side)
"""Sides by the quarter turns from +x to their outward normals."""


def require_positive(what: str, value: float, unit: str = " m") -> None:
    """Raise GeometryError unless a value, in m, is positive and finite; with the unit " mm" it is shown in mm."""
    if not (math.isfinite(value) and value > 0):
        shown = f"{value * 1e3:g}" if unit == " mm" else f"{value}"
        raise GeometryError(f"{what} must be positive and finite; got {shown}{unit}.")


def require_finite(what: str, *values: float, error: type[CoilarrayError] = GeometryError) -> None:
    """Raise an error unless all values are finite."""
    for value in values:
        if not math.isfinite(value):
            raise error(f"{what} must be finite; got {value}.")


def place_in_mm(x: float, y: float) -> str:
    """Write a place in m as a message has it, as "(1.5, 2) mm"."""
    return f"({x * 1e3:.4g}, {y * 1e3:.4g}) mm"
