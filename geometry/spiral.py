"""Centre lines of polygonal spirals that start at a corner, one layer at a time.

Two rules. "parallel": the sides of a turn are parallel to those of the enclosing polygon, all N of the outermost turn
at the stated size, and those of each following turn one pitch w + s further in. The last side of a turn ends where it
meets the line of the next turn's first side, and there the next turn begins. Where there are so many sides that the
step is longer than the last one, it begins on a side before, and the last ones are left out.

"corner": vertex k lies at the angle 2πk/N from the first corner, on the polygon whose apothem is
(outer edge apothem − w/2) − (w + s)·k/N, so that only the first corner of the outer edge touches the enclosing polygon.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.compute.usual_values import require_coil_size, warn_unusual
from coilarray.errors import GeometryError, require_positive
from coilarray.geometry.arcs import Arc

Sense = Literal["ccw", "cw"]
"""Sense of rotation of the current seen from above (+z)."""
WindingRule = Literal["parallel", "corner"]
"""Whether a turn steps in by its pitch on its last side, or by a part of it at every corner."""


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

    Returns
    -------
    float
        Apothem in m.

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


class Winding(ABC):
    """What spirals of every shape have in common: N sides a turn, and one pitch further in after each turn."""

    sides: int
    turns: float
    trace_width: float
    gap: float
    winding: Sense
    winding_rule: WindingRule

    @property
    def pitch(self) -> float:
        """Distance in m from turn to turn."""
        return self.trace_width + self.gap

    @property
    def steps(self) -> int:
        """Number of sides that one layer runs along."""
        return round(self.turns * self.sides)

    @property
    def is_parallel(self) -> bool:
        """True if the sides of a turn have the same distance from those of the enclosing shape."""
        return self.winding_rule == "parallel"

    @property
    @abstractmethod
    def inner_apothem(self) -> float:
        """Distance in m from the centre to the nearest side of the centre line at its inner end."""

    @abstractmethod
    def centre_line(self, layer: int = 0) -> FloatArray:
        """Vertices of one layer in the direction of the current: even layers, from 0, run inwards, odd ones outwards.

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
        """Corners of the enclosing shape (the nominal outer copper edge), shape (n, 2), x and y in m."""

    @abstractmethod
    def rim(self, step: int) -> FloatArray:
        """Place in m, shape (2,), where the outermost turn would pass the ray on which step `step` ends."""

    def junction(self, layer: int) -> FloatArray:
        """Place about whose ray the ends of a layer and the next one lie; where they meet, that place.

        Returns
        -------
        ndarray, shape (2,)
            x and y in m.
        """
        return np.asarray(self.centre_line(layer)[-1])

    def outwards(self, step: int) -> FloatArray:
        """Direction of the leads where step `step` ends; vias inside lie against it.

        Returns
        -------
        ndarray, shape (2,)
            Dimensionless unit vector.
        """
        rim = self.rim(step)
        return np.asarray(rim / float(np.hypot(*rim)))

    @abstractmethod
    def _normals(self, sides: IntArray) -> tuple[FloatArray, FloatArray]:
        """Give unit vectors from the centre to sides, shape (n, 2), and the distances of the enclosing sides in m."""

    @property
    def _turns_in(self) -> float:
        """Number of pitches that the innermost side lies further in than the outermost one."""
        return (self.steps - 1) // self.sides if self.is_parallel else self.turns

    def _insets(self, inwards: IntArray) -> FloatArray:
        """Distances in m of sides, by their numbers from the outer end, from those of the enclosing shape."""
        turns = inwards // self.sides if self.is_parallel else inwards / self.sides
        return np.asarray(self.trace_width / 2 + self.pitch * turns)

    def _radii(self, inset: FloatArray) -> FloatArray:
        """Radii in m of the corners between successive sides, moved in by `inset`, shape (n − 1,)."""
        return np.zeros(len(inset) - 1)

    def _corners(self, sides: IntArray, inset: FloatArray) -> FloatArray:
        """Points in m where each side, moved in by `inset`, meets the following one, shape (n − 1, 2)."""
        normal, distance = self._normals(sides)
        (a, b), p = (normal[:-1], normal[1:]), distance - inset
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        x = (p[:-1] * b[:, 1] - p[1:] * a[:, 1]) / cross
        y = (p[1:] * a[:, 0] - p[:-1] * b[:, 0]) / cross
        return np.column_stack((x, y))

    def _sharp_line(self, layer: int) -> FloatArray:
        """Vertices in m of a layer with parallel sides that starts and ends at a corner, shape (n, 2)."""
        number = np.arange(-1, self.steps + 1)  # from the outer end; the first and the last only bound the others
        sides = layer * self.steps + number if layer % 2 == 0 else (layer + 1) * self.steps - 1 - number
        line = self._parallel_corners(sides, self._insets(np.maximum(number, 0)))[0]
        return line if layer % 2 == 0 else line[::-1]

    def _sharp_junction(self, layer: int) -> FloatArray:
        """Corner in m, shape (2,), of the polygon that a further turn would begin on, or of the outermost one."""
        step = (layer + 1) * self.steps
        inset = self.trace_width / 2 + (self.pitch * (self.steps // self.sides) if layer % 2 == 0 else 0.0)
        return np.asarray(self._corners(np.array([step - 1, step]), np.full(2, inset))[0])

    def _parallel_corners(self, sides: IntArray, inset: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Corners in m between successive sides, moved in by `inset`, and their radii in m.

        Where the step inwards takes more than the last side of a turn, as where there are many sides, it begins on the
        side before: what is too short is left out.
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
            # arcs may follow one another, sharp corners may not fall together
            short = straight < np.where(tangent[:-1] + tangent[1:] > 0, -near, near)
            if not short.any():
                return corners, radii
            kept = np.concatenate(([True], ~short, [True]))
            sides, inset = sides[kept], inset[kept]

    def _turned(self, steps: npt.ArrayLike) -> FloatArray:
        """Angle in rad of so many steps in the sense of the winding."""
        # the whole number of steps keeps corners of different turns and layers on the same rays
        angle = 2 * math.pi * (np.asarray(steps) % self.sides) / self.sides
        return np.asarray(angle if self.winding == "ccw" else -angle)

    def _require_turns(self, outer: float, least: float, direction: str) -> None:
        """Raise where turns cannot be: from the centre, the edge is at `outer`, their line beyond `least` (m)."""
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
    """A planar spiral, wound inwards on even layers and outwards on odd ones.

    A layer begins at a corner of the outermost turn. A turn ends, and the next one begins, where its last side meets
    the line of the next turn's first side, one pitch further in (or, with the rule "corner", at the same corner one
    pitch further in). Every layer starts at the corner where the one before ended, so that the current keeps its sense
    of rotation: the outer ends of two layers lie above each other, and the inner ones symmetrically about the corner,
    where a via joins them.

    Raises GeometryError for a size that is not positive and finite, fewer than 3 sides, or more turns than fit.

    Parameters
    ----------
    sides : int
        The polygon's sides, at least 3.
    outer_apothem : float
        Distance in m from the centre to the outer copper edge of the enclosing polygon's sides.
    turns : float
        Turns a layer, a positive multiple of 1/sides.
    trace_width, gap : float
        Width of the trace and of the space between turns in m.
    first_corner : float
        Angle in rad of the corner where the outermost turn starts; 0 is the +x axis.
    winding : {"ccw", "cw"}
        Sense of rotation of the current seen from above (+z).
    winding_rule : {"parallel", "corner"}
        "parallel": all sides of the outermost turn lie at `outer_apothem`, and each turn steps in on its last side.
        Where a side is too short for a step, the turn ends as many sides earlier: of 100 sides of a coil 40 mm wide
        with a pitch of 0.5 mm the last three.
        "corner": each corner lies 1/sides of a pitch further in than the one before, so that no side is parallel to
        that of the enclosing polygon and only the first corner reaches it.
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
        """Apothem in m of the centre line at its inner end."""
        return self.outer_apothem - self.trace_width / 2 - self.pitch * self._turns_in

    def centre_line(self, layer: int = 0) -> FloatArray:
        """Vertices of one layer as `Winding.centre_line`.

        Returns
        -------
        ndarray, shape (n, 2)
            Vertices in m: steps + 1, or fewer where parallel sides are too short for the step inwards.
        """
        if self.is_parallel:
            return self._sharp_line(layer)
        k = np.arange(self.steps + 1)
        inwards = k if layer % 2 == 0 else self.steps - k
        apothem = (self.outer_apothem - self.trace_width / 2) - self.pitch * inwards / self.sides
        return self._on_rays(layer * self.steps + k, apothem)

    def arcs(self, layer: int = 0) -> tuple[Arc, ...]:
        """Return no arc, whichever `layer`: all corners are sharp.

        Returns
        -------
        tuple of Arc
            Always empty.
        """
        return ()

    def outline(self) -> FloatArray:
        """Corners of the enclosing polygon (the nominal outer copper edge), shape (sides, 2), x and y in m.

        Returns
        -------
        ndarray, shape (sides, 2)
            Corners in m.
        """
        return self._on_rays(np.arange(self.sides), np.full(self.sides, self.outer_apothem))

    def rim(self, step: int) -> FloatArray:
        """Corner number `step` in m of the outermost turn, shape (2,).

        Returns
        -------
        ndarray, shape (2,)
            x and y in m.
        """
        apothem = self.outer_apothem - self.trace_width / 2
        return np.asarray(self._on_rays(np.array([step]), np.array([apothem]))[0])

    def junction(self, layer: int) -> FloatArray:
        """Corner about whose ray the ends of a layer and the next one lie, as `Winding.junction`.

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
        """Corners of polygons of several apothems in m, so many steps from the first one."""
        radius = apothem / math.cos(math.pi / self.sides)
        angle = self.first_corner + self._turned(steps)
        return np.column_stack((radius * np.cos(angle), radius * np.sin(angle)))
