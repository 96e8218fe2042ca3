"""Kinds of values that all shapes share, and how messages show a place."""

from __future__ import annotations

from typing import Literal, get_args

from coilarray.compute.display_units import true_minus

Point = tuple[float, float]
"""x and y in m, where nothing else is said."""
Side = Literal["right", "top", "left", "bottom"]
SIDES: tuple[Side, ...] = get_args(Side)
"""Sides by the quarter turns from +x to their outward normals."""


def place_in_mm(x: float, y: float) -> str:
    """Write a place in m as a message has it, as "(1.5, 2) mm"."""
    numbers = (round(float(value) * 1e3, 3) + 0.0 for value in (x, y))  # + 0.0: no −0
    return true_minus("({:.4g}, {:.4g}) mm".format(*numbers))
