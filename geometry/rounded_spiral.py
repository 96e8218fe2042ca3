"""Centre lines of spirals with parallel sides and round corners: rectangles, racetracks, circles, rounded polygons.

Side k of a layer, counted from 0, is parallel to side k mod N of the enclosing polygon and lies w/2 + (w + s)·k/N
further in. The turns therefore keep the gap s everywhere on the sides. The corner after side k is an arc about the same
centre in every turn, so that they keep it in the corners too, until its radius would fall below one trace width; inner
turns keep that radius. A winding starts and ends in the middle of a side.

A circle is a square whose corners are as round as can be: quarter circles joined by straight pieces of a quarter pitch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.errors import GeometryError, require_positive
from coilarray.geometry.arcs import Arc, rounded_line
from coilarray.geometry.spiral import Sense, Winding


@dataclass(frozen=True)
class RoundedSpiral(Winding):
    """A planar spiral with parallel sides, wound inwards on even layers and outwards on odd ones.

    Raises GeometryError for a size that is not positive and finite, fewer than 3 sides, sizes that differ where there
    are not four sides, a radius that does not fit, or more turns than fit.

    Parameters
    ----------
    extent, breadth : float
        Sizes in m between the outer copper edges, along the direction in which the winding starts and across it; twice
        the apothem for other numbers of sides than four, for which both are equal.
    turns : float
        Turns a layer, a positive multiple of 1/sides.
    trace_width, gap : float
        Width of the trace and of the space between turns in m.
    corner_radius : float
        Radius in m of the outer copper edge at the corners, up to half of the smaller size; 0 for sharp corners.
    sides : int
        Sides of the enclosing polygon, at least 3.
    direction : float
        Angle in rad of the place where the outermost turn starts, the middle of a side, seen from the centre.
    winding : {"ccw", "cw"}
        Sense of rotation of the current seen from above (+z).

    Examples
    --------
    >>> circle = RoundedSpiral(20e-3, 20e-3, 8, 0.2e-3, 0.2e-3, corner_radius=10e-3)
    >>> [round(float(x) * 1e3, 6) + 0.0 for x in circle.centre_line()[0]], len(circle.arcs())
    ([9.9, 0.0], 32)
    """

    extent: float
    breadth: float
    turns: float
    trace_width: float
    gap: float
    corner_radius: float = 0.0
    sides: int = 4
    direction: float = 0.0
    winding: Sense = "ccw"

    def __post_init__(self) -> None:
        for name in ("extent", "breadth", "turns", "trace_width", "gap"):
            require_positive(name, getattr(self, name), "")
        if self.sides != 4 and self.breadth != self.extent:
            raise GeometryError(
                f"extent and breadth must be equal for {self.sides} sides; got {self.extent} m and {self.breadth} m."
            )
        smaller = min(self.extent, self.breadth) / 2
        if not 0 <= self.corner_radius <= smaller * (1 + 1e-12):
            raise GeometryError(
                f"corner_radius must be 0 to {smaller * 1e3:g} mm, half of the smaller size; "
                f"got {self.corner_radius * 1e3:g} mm."
            )
        self._require_turns(smaller, max(self.trace_width / 2, self._least_radius), "direction")

    @property
    def is_circle(self) -> bool:
        """True if the enclosing shape is a circle."""
        return self.sides == 4 and self.extent == self.breadth == 2 * self.corner_radius

    @property
    def is_racetrack(self) -> bool:
        """True if the enclosing shape ends in half circles."""
        return self.sides == 4 and self.corner_radius == min(self.extent, self.breadth) / 2

    @property
    def inner_apothem(self) -> float:
        """Distance in m from the centre to the nearest side of the centre line at its inner end."""
        return min(self.extent, self.breadth) / 2 - self.trace_width / 2 - self.pitch * self.turns

    def centre_line(self, layer: int = 0) -> FloatArray:
        """Vertices of one layer as `Winding.centre_line`, with arcs as short straight pieces.

        Returns
        -------
        ndarray, shape (n, 2)
            Vertices in m, from the outer end to the inner one.
        """
        return self._rounded(layer)[0]

    def arcs(self, layer: int = 0) -> tuple[Arc, ...]:
        """Return the arcs of the centre line of one layer.

        Returns
        -------
        tuple of Arc
            Arcs, in the order of the path.
        """
        return self._rounded(layer)[1]

    def outline(self) -> FloatArray:
        """Points of the enclosing shape (the nominal outer copper edge), shape (n, 2), x and y in m.

        Returns
        -------
        ndarray, shape (n, 2)
            Points in m.
        """
        sides = np.arange(self.sides + 1)
        middle = self._corners(sides, np.zeros(self.sides + 1))
        line = np.vstack((self._foot(sides[:1], np.zeros(1)), middle, self._foot(sides[:1], np.zeros(1))))
        return rounded_line(line, [self.corner_radius] * self.sides)[0][:-1]

    def rim(self, step: int) -> FloatArray:
        """Middle in m of the side number `step` of the outermost turn, shape (2,).

        Returns
        -------
        ndarray, shape (2,)
            x and y in m.
        """
        return np.asarray(self._foot(np.array([step]), np.array([self.trace_width / 2]))[0])

    @property
    def _least_radius(self) -> float:
        return min(self.corner_radius, self.trace_width)

    def _rounded(self, layer: int) -> tuple[FloatArray, tuple[Arc, ...]]:
        k = np.arange(self.steps + 1)
        inset = self.trace_width / 2 + self.pitch * (k if layer % 2 == 0 else self.steps - k) / self.sides
        sides = layer * self.steps + k
        ends = self._foot(sides[[0, -1]], inset[[0, -1]])
        corners = np.vstack((ends[:1], self._corners(sides, inset), ends[1:]))
        radii = np.maximum(self.corner_radius - np.maximum(inset[:-1], inset[1:]), self._least_radius)
        if self.corner_radius:
            # the first and the last half side may be a little short for the arc
            half = math.tan(math.pi / self.sides)
            for end, corner in ((0, 0), (-1, -1)):
                room = float(np.hypot(*(ends[end] - corners[1:-1][corner]))) / half
                radii[corner] = min(radii[corner], room)
        return rounded_line(corners, radii.tolist())

    def _normals(self, sides: IntArray) -> tuple[FloatArray, FloatArray]:
        """Give unit vectors from the centre to sides, shape (n, 2), and the distances of the enclosing sides in m."""
        angle = self.direction + self._turned(sides)
        distance = np.where((self.sides == 4) & (sides % 2 == 1), self.breadth, self.extent) / 2
        return np.column_stack((np.cos(angle), np.sin(angle))), distance

    def _foot(self, sides: IntArray, inset: FloatArray) -> FloatArray:
        """Points in m of sides, moved in by `inset`, that are nearest to the centre."""
        normal, distance = self._normals(sides)
        return np.asarray((distance - inset)[:, None] * normal)

    def _corners(self, sides: IntArray, inset: FloatArray) -> FloatArray:
        """Points in m where each side, moved in by `inset`, meets the following one, shape (n − 1, 2)."""
        normal, distance = self._normals(sides)
        (a, b), p = (normal[:-1], normal[1:]), distance - inset
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        x = (p[:-1] * b[:, 1] - p[1:] * a[:, 1]) / cross
        y = (p[1:] * a[:, 0] - p[:-1] * b[:, 0]) / cross
        return np.column_stack((x, y))
