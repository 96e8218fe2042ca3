"""Kinds of values shared by all shapes, and the form of a place in messages."""

from __future__ import annotations

from typing import Literal, get_args

from coilarray.compute.display_units import true_minus

Point = tuple[float, float]
"""x and y, in m unless stated otherwise."""
Side = Literal["right", "top", "left", "bottom"]
SIDES: tuple[Side, ...] = get_args(Side)
"""Sides in the order of the quarter turns from +x to their outward normals."""


def place_in_mm(x: float, y: float) -> str:
    """Write a place in m as "(1.5, 2) mm"."""
    numbers = (round(float(value) * 1e3, 3) + 0.0 for value in (x, y))  # + 0.0: no −0
    return true_minus("({:.4g}, {:.4g}) mm".format(*numbers))
