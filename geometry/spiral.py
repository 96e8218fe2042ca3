"""Centre lines of polygonal spirals that start at a corner, one layer at a time.

There are two winding rules. With "parallel", the sides of a turn are parallel to the sides of the enclosing polygon.
All N sides of the outermost turn lie at the stated size, and the sides of each following turn lie one pitch w + s
further in. The last side of a turn ends on the line of the next turn's first side, and the next turn begins there. With
many sides the step inwards can be longer than the last side. The next turn then begins on an earlier side, and the
remaining sides are left out.

With "corner", vertex k lies at the angle 2πk/N from the first corner, on the polygon with the apothem (outer edge
apothem − w/2) − (w + s)·k/N. Only the first corner of the outer edge touches the enclosing polygon.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.errors import GeometryError, require_positive
from coilarray.geometry.arcs import Arc
from coilarray.geometry.usual_values import require_coil_size, warn_unusual

Sense = Literal["ccw", "cw"]
"""Sense of rotation of the current seen from above (+z)."""
WindingRule = Literal["parallel", "corner"]
"""Rule by which turns step in: on the last side only, or partly at every corner."""


def apothem_from_size(size: float, sides: int, *, across: Literal["flats", "corners"]) -> float:
    """Apothem in m of a regular polygon of given size.

    Parameters
    ----------
    size : float
            Size in m. With `across="flats"` it is twice the apothem, for odd `sides` too. With `across="corners"` it is
            twice the circumradius.
    sides : int
        Number of sides, at least 3.
    across : {"flats", "corners"}
        How `size` is measured.

    Returns
    -------
    float
        Apothem in m.

    Raises
    ------
    GeometryError
            If the size is not positive and finite, `sides` is below 3, or `across` is another word.

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


class Winding(ABC):
    """Common base of spirals with N sides per turn.

    Each turn lies one pitch further in than the turn before.
    """

    sides: int
    turns: float
    trace_width: float
    gap: float
    winding: Sense
    winding_rule: WindingRule

    @property
    def pitch(self) -> float:
        """Distance in m between neighbouring turns, centre to centre."""
        return self.trace_width + self.gap

    @property
    def steps(self) -> int:
        """Number of sides in one layer."""
        return round(self.turns * self.sides)

    @property
    def is_parallel(self) -> bool:
        """Whether each turn is parallel to the enclosing shape."""
        return self.winding_rule == "parallel"

    @property
    @abstractmethod
    def inner_apothem(self) -> float:
        """Apothem in m of the centre line's inner end.

        It is the distance from the centre to the nearest side there.
        """

    @abstractmethod
    def centre_line(self, layer: int = 0) -> FloatArray:
        """Vertices of one layer in the direction of the current.

        Layers count from 0. Even layers run inwards, odd layers outwards.

        Returns
        -------
        ndarray, shape (n, 2)
            x, y in m, centre at the origin.
        """

    @abstractmethod
    def arcs(self, layer: int = 0) -> tuple[Arc, ...]:
        """Return the arcs of the centre line of one layer."""

    @abstractmethod
    def outline(self) -> FloatArray:
        """Corners of the enclosing shape, x and y in m.

        The shape is the nominal outer copper edge. The array has the shape (n, 2).
        """

    @abstractmethod
    def rim(self, step: int) -> FloatArray:
        """Point in m where the outermost turn crosses a ray.

        The ray is the ray on which step number `step` ends. The point has the shape (2,).
        """

    def junction(self, layer: int) -> FloatArray:
        """Point shared by the ends of `layer` and the next.

        If the ends do not meet, they lie about the ray through this point.

        Returns
        -------
        ndarray, shape (2,)
            x and y in m.
        """
        return np.asarray(self.centre_line(layer)[-1])

    def outwards(self, step: int) -> FloatArray:
        """Direction of the leads at the end of a step.

        Vias inside the winding lie in the opposite direction.

        Returns
        -------
        ndarray, shape (2,)
            Dimensionless unit vector.
        """
        rim = self.rim(step)
        return np.asarray(rim / float(np.hypot(*rim)))

    @abstractmethod
    def _normals(self, sides: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return unit normals and distances in m of enclosing sides.

        The normals point from the centre to the sides and have the shape (n, 2).
        """

    @property
    def _turns_in(self) -> float:
        """Distance from the outermost to the innermost side, in pitches."""
        return (self.steps - 1) // self.sides if self.is_parallel else self.turns

    def _insets(self, inwards: IntArray) -> FloatArray:
        """Distances in m of sides from the enclosing shape.

        The sides are given by their numbers from the outer end.
        """
        turns = inwards // self.sides if self.is_parallel else inwards / self.sides
        return np.asarray(self.trace_width / 2 + self.pitch * turns)

    def _radii(self, inset: FloatArray) -> FloatArray:
        """Radii in m of the corners between successive sides.

        The sides are moved in by `inset`. The array has the shape (n − 1,).
        """
        return np.zeros(len(inset) - 1)

    def _corners(self, sides: IntArray, inset: FloatArray) -> FloatArray:
        """Intersections in m of successive sides moved in by `inset`.

        The array has the shape (n − 1, 2).
        """
        normal, distance = self._normals(sides)
        (a, b), p = (normal[:-1], normal[1:]), distance - inset
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        x = (p[:-1] * b[:, 1] - p[1:] * a[:, 1]) / cross
        y = (p[1:] * a[:, 0] - p[:-1] * b[:, 0]) / cross
        return np.column_stack((x, y))

    def _sharp_line(self, layer: int) -> FloatArray:
        """Vertices in m of a layer with sharp corners.

        The sides are parallel, and the layer starts and ends at a corner. The array has the shape (n, 2).
        """
        number = np.arange(-1, self.steps + 1)  # from the outer end; the first and the last only bound the others
        sides = layer * self.steps + number if layer % 2 == 0 else (layer + 1) * self.steps - 1 - number
        line = self._parallel_corners(sides, self._insets(np.maximum(number, 0)))[0]
        return line if layer % 2 == 0 else line[::-1]

    def _sharp_junction(self, layer: int) -> FloatArray:
        """Corner in m where a further turn would begin.

        On the outside it is a corner of the outermost polygon. The array has the shape (2,).
        """
        step = (layer + 1) * self.steps
        inset = self.trace_width / 2 + (self.pitch * (self.steps // self.sides) if layer % 2 == 0 else 0.0)
        return np.asarray(self._corners(np.array([step - 1, step]), np.full(2, inset))[0])

    def _parallel_corners(self, sides: IntArray, inset: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Corners in m between parallel sides, and their radii.

        The sides are moved in by `inset`. If the step inwards is longer than the last side of a turn, as with many
        sides, the next turn begins on the side before. Sides that are too short are left out.
        """
        while True:
            corners, radii = self._corners(sides, inset), self._radii(inset)
            normal, distance = self._normals(sides)
            (ax, ay), (bx, by) = normal[:-1].T, normal[1:].T
            turn = np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
            tangent = radii * np.tan(np.abs(turn) / 2)
            along = np.sign(turn[:-1, None]) * np.column_stack((-normal[1:-1, 1], normal[1:-1, 0]))
            straight = (np.diff(corners, axis=0) * along).sum(axis=1) - tangent[:-1] - tangent[1:]
            near = 1e-12 * float(distance.max())
            # arcs may touch end to end, but sharp corners must not coincide
            short = straight < np.where(tangent[:-1] + tangent[1:] > 0, -near, near)
            if not short.any():
                return corners, radii
            kept = np.concatenate(([True], ~short, [True]))
            sides, inset = sides[kept], inset[kept]

    def _turned(self, steps: npt.ArrayLike) -> FloatArray:
        """Angle in rad after a number of steps.

        It has the sign of the winding.
        """
        # the whole number of steps keeps corners of different turns and layers on the same rays
        angle = 2 * math.pi * (np.asarray(steps) % self.sides) / self.sides
        return np.asarray(angle if self.winding == "ccw" else -angle)

    def _require_turns(self, outer: float, least: float, direction: str) -> None:
        """Raise GeometryError if the turns do not fit.

        The outer edge lies at `outer` from the centre. The centre line must stay beyond `least`. Both are in m.
        """
        if self.sides < 3:
            raise GeometryError(f"sides must be at least 3; got {self.sides}.")
        if not math.isfinite(getattr(self, direction)):
            raise GeometryError(f"{direction} must be finite; got {getattr(self, direction)}.")
        if self.winding not in ("ccw", "cw"):
            raise GeometryError(f"winding must be 'ccw' or 'cw'; got {self.winding!r}.")
        if self.winding_rule not in ("parallel", "corner"):
            raise GeometryError(f"winding_rule must be 'parallel' or 'corner'; got {self.winding_rule!r}.")
        steps = self.turns * self.sides
        if abs(steps - round(steps)) > 1e-9 * steps:
            near = max(round(steps), 1)
            raise GeometryError(
                f"turns must be a multiple of 1/{self.sides}, for example {near / self.sides:.12g}; got {self.turns:g}."
            )
        deepest = self.steps // self.sides if self.is_parallel else self.turns
        if outer - self.trace_width / 2 - self.pitch * deepest <= least:
            pitches = max((outer - self.trace_width / 2 - least) / self.pitch, 0.0)
            fit = math.floor(pitches * self.sides) / self.sides
            if self.is_parallel and pitches:  # the last turn steps in at its end only
                fit = math.floor(pitches) + 1 - 1 / self.sides
            raise GeometryError(
                f"{self.turns:g} turns of {self.trace_width * 1e3:g} mm trace and {self.gap * 1e3:g} mm gap do not "
                f"fit into {outer * 1e3:g} mm from edge to centre; at most {fit:.4g} turns fit."
            )


@dataclass(frozen=True)
class Spiral(Winding):
    """Planar polygonal spiral, wound inwards on even layers.

    Odd layers run outwards. A layer begins at a corner of the outermost turn. A turn ends on the line of the next
    turn's first side, one pitch further in, and the next turn begins there. With the rule "corner" it ends at the same
    corner, one pitch further in. Every layer starts at the corner where the layer before ended, so the current keeps
    its sense of rotation. The outer ends of two layers lie above each other. The inner ends lie symmetrically about the
    corner, where a via joins them.

    Raises GeometryError if the size is not positive and finite, if there are fewer than 3 sides, or if the turns do not
    fit.

    Parameters
    ----------
    sides : int
            Number of sides of the polygon, at least 3.
    outer_apothem : float
            Apothem in m of the enclosing polygon, to the outer copper edge.
    turns : float
            Turns per layer, a positive multiple of 1/sides.
    trace_width, gap : float
            Width of the trace and of the gap between turns in m.
    first_corner : float
        Angle in rad of the corner where the outermost turn starts. 0 is the +x axis.
    winding : {"ccw", "cw"}
        Sense of rotation of the current seen from above (+z).
    winding_rule : {"parallel", "corner"}
            "parallel": all sides of the outermost turn lie at `outer_apothem`, and each turn steps in on its last side.
            If sides are shorter than a step, the turn ends a few sides earlier. For a coil of 100 sides, 40 mm wide
            with a pitch of 0.5 mm, it ends three sides earlier. "corner": each corner lies 1/sides of a pitch further
            in than the corner before. No side is then parallel to the enclosing polygon, and only the first corner
            reaches it.
    """

    sides: int
    outer_apothem: float
    turns: float
    trace_width: float
    gap: float
    first_corner: float = 0.0
    winding: Sense = "ccw"
    winding_rule: WindingRule = "parallel"

    def __post_init__(self) -> None:
        for name in ("outer_apothem", "turns", "trace_width", "gap"):
            require_positive(name, getattr(self, name), "")
        size = 2 * self.outer_apothem
        require_coil_size(size)
        sizes = (("outer_across_flats_mm", size), ("trace_width_mm", self.trace_width), ("gap_mm", self.gap))
        warn_unusual(sizes)
        self._require_turns(self.outer_apothem, self.trace_width / 2, "first_corner")

    @property
    def inner_apothem(self) -> float:
        """Apothem in m of the line's inner end.

        The line is the centre line.
        """
        return self.outer_apothem - self.trace_width / 2 - self.pitch * self._turns_in

    def centre_line(self, layer: int = 0) -> FloatArray:
        """Vertices of one layer, as in `Winding.centre_line`.

        Returns
        -------
        ndarray, shape (n, 2)
                Vertices in m. There are steps + 1 of them, or fewer if parallel sides are too short for the step
                inwards.
        """
        if self.is_parallel:
            return self._sharp_line(layer)
        k = np.arange(self.steps + 1)
        inwards = k if layer % 2 == 0 else self.steps - k
        apothem = (self.outer_apothem - self.trace_width / 2) - self.pitch * inwards / self.sides
        return self._on_rays(layer * self.steps + k, apothem)

    def arcs(self, layer: int = 0) -> tuple[Arc, ...]:
        """Return no arcs, because all corners are sharp.

        `layer` has no effect.

        Returns
        -------
        tuple of Arc
            Always empty.
        """
        return ()

    def outline(self) -> FloatArray:
        """Corners of the enclosing polygon, x and y in m.

        The polygon is the nominal outer copper edge.

        Returns
        -------
        ndarray, shape (sides, 2)
            Corners in m.
        """
        return self._on_rays(np.arange(self.sides), np.full(self.sides, self.outer_apothem))

    def rim(self, step: int) -> FloatArray:
        """Corner number `step` of the outermost turn, in m.

        Returns
        -------
        ndarray, shape (2,)
            x and y in m.
        """
        apothem = self.outer_apothem - self.trace_width / 2
        return np.asarray(self._on_rays(np.array([step]), np.array([apothem]))[0])

    def junction(self, layer: int) -> FloatArray:
        """Corner shared by the ends of `layer` and the next.

        See `Winding.junction`.

        Returns
        -------
        ndarray, shape (2,)
            x and y in m.
        """
        return self._sharp_junction(layer) if self.is_parallel else super().junction(layer)

    def _normals(self, sides: IntArray) -> tuple[FloatArray, FloatArray]:
        half = math.pi / self.sides if self.winding == "ccw" else -math.pi / self.sides
        angle = self.first_corner + half + self._turned(sides)
        return np.column_stack((np.cos(angle), np.sin(angle))), np.full(len(sides), self.outer_apothem)

    def _on_rays(self, steps: IntArray, apothem: FloatArray) -> FloatArray:
        """Points on polygons of given apothems.

        The points are at given steps. Apothems are in m.
        """
        radius = apothem / math.cos(math.pi / self.sides)
        angle = self.first_corner + self._turned(steps)
        return np.column_stack((radius * np.cos(angle), radius * np.sin(angle)))
