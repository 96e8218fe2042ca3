"""Centre lines of spirals with parallel sides and round corners: rectangles, racetracks, circles, rounded polygons.

The sides of a turn are parallel to the sides of the enclosing shape. With the rule "parallel", all N sides of the
outermost turn lie at the stated size, and the sides of each following turn lie one pitch w + s further in. With the
rule "corner", side k of a layer, counted from 0, lies w/2 + (w + s)·k/N further in. Along the sides the turns keep the
gap s everywhere. The corner after side k is an arc, with the same centre in every turn, so the gap is kept in the
corners too. If the radius would fall below one trace width, the inner turns keep one trace width as radius. A winding
starts and ends in the middle of a side. A winding with parallel sides and sharp corners starts at the beginning of a
side, as `Spiral` does.

A circle is a square with the largest possible corner radius: quarter circles joined by straight pieces of a quarter
pitch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.errors import GeometryError, require_positive
from coilarray.geometry.arcs import Arc, rounded_line
from coilarray.geometry.spiral import Sense, Winding, WindingRule
from coilarray.geometry.usual_values import require_coil_size, warn_unusual


@dataclass(frozen=True)
class RoundedSpiral(Winding):
    """Planar spiral with parallel sides and round or sharp corners.

    Even layers are wound inwards, odd layers outwards.

    Raises GeometryError if the size is not positive and finite, if there are fewer than 3 sides, if the two sizes
    differ without four sides, if the radius does not fit, or if the turns do not fit.

    Parameters
    ----------
    extent, breadth : float
            Sizes in m between the outer copper edges, along the direction in which the winding starts and across it.
            For a number of sides other than four, both are equal to twice the apothem.
    turns : float
            Turns per layer, a positive multiple of 1/sides.
    trace_width, gap : float
            Width of the trace and of the gap between turns in m.
    corner_radius : float
        Radius in m of the outer copper edge at the corners, up to half of the smaller size. 0 for sharp corners.
    sides : int
        Sides of the enclosing polygon, at least 3.
    direction : float
            Angle in rad of the middle of the outermost turn's first side, seen from the centre. The turn starts there.
            With parallel sides and sharp corners it starts at the beginning of the side.
    winding : {"ccw", "cw"}
        Sense of rotation of the current seen from above (+z).
    winding_rule : {"parallel", "corner"}
            "parallel": all sides of the outermost turn lie at the stated size, and each turn steps in at the end of its
            last side. "corner": each side lies 1/sides of a pitch further in than the side before. A circle always
            follows "corner": its outer edge starts on the circle of the stated size and approaches the centre steadily.

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
    winding_rule: WindingRule = "parallel"

    def __post_init__(self) -> None:
        for name in ("extent", "breadth", "turns", "trace_width", "gap"):
            require_positive(name, getattr(self, name), "")
        require_coil_size(max(self.extent, self.breadth))
        sizes = (("outer_width_mm", self.extent), ("outer_height_mm", self.breadth))
        warn_unusual((*sizes, ("trace_width_mm", self.trace_width), ("gap_mm", self.gap)))
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
        """Whether the enclosing shape is a circle."""
        return self.sides == 4 and self.extent == self.breadth == 2 * self.corner_radius

    @property
    def is_parallel(self) -> bool:
        """Whether each turn is parallel to the enclosing shape.

        This is never so for a circle.
        """
        return super().is_parallel and not self.is_circle

    @property
    def is_racetrack(self) -> bool:
        """Whether the enclosing shape ends in half circles."""
        return self.sides == 4 and self.corner_radius == min(self.extent, self.breadth) / 2

    @property
    def inner_apothem(self) -> float:
        """Apothem in m of the centre line's inner end.

        It is the distance from the centre to the nearest side there.
        """
        return min(self.extent, self.breadth) / 2 - self.trace_width / 2 - self.pitch * self._turns_in

    def centre_line(self, layer: int = 0) -> FloatArray:
        """Vertices of one layer, with arcs as short straight pieces.

        See `Winding.centre_line`.

        Returns
        -------
        ndarray, shape (n, 2)
            Vertices in m, from the outer end to the inner end.
        """
        return self._sharp_line(layer) if self._starts_at_corner else self._rounded(layer)[0]

    def arcs(self, layer: int = 0) -> tuple[Arc, ...]:
        """Return the arcs of the centre line of one layer.

        Returns
        -------
        tuple of Arc
            Arcs, in the order of the path.
        """
        return () if self._starts_at_corner else self._rounded(layer)[1]

    def outline(self) -> FloatArray:
        """Points of the enclosing shape, x and y in m.

        The shape is the nominal outer copper edge.

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
        """Middle of side number `step` of the outermost turn.

        If turns start at the beginning of a side, it is the beginning of the side.

        Returns
        -------
        ndarray, shape (2,)
            x and y in m.
        """
        if self._starts_at_corner:
            return np.asarray(self._corners(np.array([step - 1, step]), np.full(2, self.trace_width / 2))[0])
        return np.asarray(self._foot(np.array([step]), np.array([self.trace_width / 2]))[0])

    def junction(self, layer: int) -> FloatArray:
        """Point shared by the ends of `layer` and the next.

        See `Winding.junction`.

        Returns
        -------
        ndarray, shape (2,)
            x and y in m.
        """
        return self._sharp_junction(layer) if self._starts_at_corner else super().junction(layer)

    def outwards(self, step: int) -> FloatArray:
        """Outward direction at the start of side `step`.

        It is the normal of the side if turns start in its middle. Otherwise it lies between the normals of both sides
        at its beginning.

        Returns
        -------
        ndarray, shape (2,)
            Dimensionless unit vector.
        """
        sides = np.array([step - 1, step] if self._starts_at_corner else [step])
        between = self._normals(sides)[0].sum(axis=0)
        return np.asarray(between / float(np.hypot(*between)))

    @property
    def _starts_at_corner(self) -> bool:
        return self.is_parallel and not self.corner_radius

    @property
    def _least_radius(self) -> float:
        return min(self.corner_radius, self.trace_width)

    def _radii(self, inset: FloatArray) -> FloatArray:
        return np.maximum(self.corner_radius - np.maximum(inset[:-1], inset[1:]), self._least_radius)

    def _rounded(self, layer: int) -> tuple[FloatArray, tuple[Arc, ...]]:
        """Centre line of one layer, and its arcs.

        The line has the shape (n, 2), in m.
        """
        k = np.arange(self.steps + 1)
        inset = self._insets(k if layer % 2 == 0 else self.steps - k)
        sides = layer * self.steps + k
        ends = self._foot(sides[[0, -1]], inset[[0, -1]])
        if self.is_parallel:
            inner, radii = self._parallel_corners(sides, inset)
        else:
            inner, radii = self._corners(sides, inset), self._radii(inset)
        if self.corner_radius:
            # the first and the last half side may be slightly too short for the arc
            half = math.tan(math.pi / self.sides)
            for end in (0, -1):
                radii[end] = min(radii[end], float(np.hypot(*(ends[end] - inner[end]))) / half)
        return rounded_line(np.vstack((ends[:1], inner, ends[1:])), radii.tolist())

    def _normals(self, sides: IntArray) -> tuple[FloatArray, FloatArray]:
        angle = self.direction + self._turned(sides)
        distance = np.where((self.sides == 4) & (sides % 2 == 1), self.breadth, self.extent) / 2
        return np.column_stack((np.cos(angle), np.sin(angle))), distance

    def _foot(self, sides: IntArray, inset: FloatArray) -> FloatArray:
        """Points in m of sides nearest to the centre.

        The sides are moved in by `inset`.
        """
        normal, distance = self._normals(sides)
        return np.asarray((distance - inset)[:, None] * normal)
