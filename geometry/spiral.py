"""Centre lines of polygonal and circular spirals, one layer at a time.

The vertex rule: with N sides a turn, vertex k lies at the angle 2πk/N from the first corner, on the polygon whose
apothem is (outer edge apothem − w/2) − (w + s)·k/N. The winding therefore shrinks by one pitch w + s a turn, and its
outer edge touches the enclosing polygon at the first corner. A circle is the same rule with the radius in place of
the apothem and many sides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from coilarray.errors import GeometryError
from coilarray.geometry.values import FloatArray, require_positive

Winding = Literal["ccw", "cw"]


def apothem_from_size(size: float, sides: int, *, across: Literal["flats", "corners"]) -> float:
    """Apothem in m of a regular polygon from its size.

    Parameters
    ----------
    size : float
        Size in m: twice the apothem (`across="flats"`; for odd `sides` too) or twice the circumradius
        (`across="corners"`).
    sides : int
        Number of sides, at least 3.
    across : {"flats", "corners"}
        How `size` is measured.

    Raises
    ------
    GeometryError
        A size that is not positive and finite, fewer than 3 sides, or another word for `across`.

    Examples
    --------
    >>> round(apothem_from_size(23e-3, 6, across="corners") * 1e3, 4)
    9.9593
    """
    require_positive("size", size)
    if sides < 3:
        raise GeometryError(f"sides must be at least 3; got {sides}.")
    if across == "flats":
        return size / 2
    if across != "corners":
        raise GeometryError(f"size must be measured across flats or corners; got {across!r}.")
    return size / 2 * math.cos(math.pi / sides)


@dataclass(frozen=True)
class Spiral:
    """A planar spiral, wound inwards on even layers and outwards on odd ones.

    Every layer starts at the angle where the one before ended, so that the current keeps its sense of rotation and
    the ends to be joined lie above each other.

    Raises GeometryError for a size that is not positive and finite, fewer than 3 sides, or more turns than fit.

    Parameters
    ----------
    sides : int
        Straight segments a turn: the polygon's sides, or the resolution of a circle. At least 3.
    outer_apothem : float
        Distance in m from the centre to the outer copper edge of the enclosing polygon's sides (circle: its radius).
    turns : float
        Turns a layer, a positive multiple of 1/sides.
    trace_width, gap : float
        Width of the trace and of the space between turns in m.
    first_corner : float
        Angle in rad of the corner where the outermost turn starts; 0 is the +x axis.
    winding : {"ccw", "cw"}
        Sense of rotation of the current seen from above (+z).
    circular : bool
        True: the vertices lie on a circular (Archimedean) spiral.
    """

    sides: int
    outer_apothem: float
    turns: float
    trace_width: float
    gap: float
    first_corner: float = 0.0
    winding: Winding = "ccw"
    circular: bool = False

    def __post_init__(self) -> None:
        if self.sides < 3:
            raise GeometryError(f"sides must be at least 3; got {self.sides}.")
        for name in ("outer_apothem", "turns", "trace_width", "gap"):
            require_positive(name, getattr(self, name), "")
        if not math.isfinite(self.first_corner):
            raise GeometryError(f"first_corner must be finite; got {self.first_corner}.")
        if self.winding not in ("ccw", "cw"):
            raise GeometryError(f"winding must be 'ccw' or 'cw'; got {self.winding!r}.")
        steps = self.turns * self.sides
        if abs(steps - round(steps)) > 1e-9 * steps:
            near = max(round(steps), 1)
            raise GeometryError(
                f"turns must be a multiple of 1/{self.sides}, for example {near / self.sides:.12g}; got {self.turns:g}."
            )
        if self.inner_apothem - self.trace_width / 2 <= 0:
            fit = math.floor((self.outer_apothem - self.trace_width) / self.pitch * self.sides) / self.sides
            raise GeometryError(
                f"{self.turns:g} turns of {self.trace_width * 1e3:g} mm trace and {self.gap * 1e3:g} mm gap do not fit "
                f"into {self.outer_apothem * 1e3:g} mm from edge to centre; at most {max(fit, 0):.4g} turns do."
            )

    @property
    def pitch(self) -> float:
        """Distance in m from turn to turn."""
        return self.trace_width + self.gap

    @property
    def steps(self) -> int:
        """Number of straight segments of one layer."""
        return round(self.turns * self.sides)

    @property
    def inner_apothem(self) -> float:
        """Apothem in m of the centre line at its inner end."""
        return self.outer_apothem - self.trace_width / 2 - self.pitch * self.turns

    def centre_line(self, layer: int = 0) -> FloatArray:
        """Vertices of one layer in the direction of the current: even layers, from 0, run inwards, odd ones outwards.

        Returns
        -------
        ndarray, shape (steps + 1, 2)
            x, y in m, centre at the origin.
        """
        k = np.arange(self.steps + 1)
        inwards = k if layer % 2 == 0 else self.steps - k
        apothem = (self.outer_apothem - self.trace_width / 2) - self.pitch * inwards / self.sides
        radius = apothem if self.circular else apothem / math.cos(math.pi / self.sides)
        # the whole number of steps keeps corners of different turns and layers on the same rays
        step = (layer * self.steps + k) % self.sides
        turn = 2 * math.pi * step / self.sides
        angle = self.first_corner + (turn if self.winding == "ccw" else -turn)
        return np.column_stack((radius * np.cos(angle), radius * np.sin(angle)))

    def outline(self) -> FloatArray:
        """Corners of the enclosing polygon (the nominal outer copper edge), shape (sides, 2), x and y in m."""
        radius = self.outer_apothem if self.circular else self.outer_apothem / math.cos(math.pi / self.sides)
        angle = self.first_corner + 2 * math.pi * np.arange(self.sides) / self.sides
        return np.column_stack((radius * np.cos(angle), radius * np.sin(angle)))
