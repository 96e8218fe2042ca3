"""Centre lines of polygonal spirals that start at a corner, one layer at a time.

The vertex rule: with N sides a turn, vertex k lies at the angle 2πk/N from the first corner, on the polygon whose
apothem is (outer edge apothem − w/2) − (w + s)·k/N. The winding therefore shrinks by one pitch w + s a turn, and its
outer edge touches the enclosing polygon at the first corner.
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

Sense = Literal["ccw", "cw"]
"""Sense of rotation of the current seen from above (+z)."""


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
    """What spirals of every shape have in common: N steps a turn, each ending one N-th of a pitch further in."""

    sides: int
    turns: float
    trace_width: float
    gap: float
    winding: Sense

    @property
    def pitch(self) -> float:
        """Distance in m from turn to turn."""
        return self.trace_width + self.gap

    @property
    def steps(self) -> int:
        """Number of sides that one layer runs along."""
        return round(self.turns * self.sides)

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
        steps = self.turns * self.sides
        if abs(steps - round(steps)) > 1e-9 * steps:
            near = max(round(steps), 1)
            raise GeometryError(
                f"turns must be a multiple of 1/{self.sides}, for example {near / self.sides:.12g}; got {self.turns:g}."
            )
        if outer - self.trace_width / 2 - self.pitch * self.turns <= least:
            fit = math.floor((outer - self.trace_width / 2 - least) / self.pitch * self.sides) / self.sides
            raise GeometryError(
                f"{self.turns:g} turns of {self.trace_width * 1e3:g} mm trace and {self.gap * 1e3:g} mm gap do not "
                f"fit into {outer * 1e3:g} mm from edge to centre; at most {max(fit, 0):.4g} turns fit."
            )


@dataclass(frozen=True)
class Spiral(Winding):
    """A planar spiral, wound inwards on even layers and outwards on odd ones.

    Every layer starts at the angle where the one before ended, so that the current keeps its sense of rotation and
    the ends to be joined lie above each other.

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
    """

    sides: int
    outer_apothem: float
    turns: float
    trace_width: float
    gap: float
    first_corner: float = 0.0
    winding: Sense = "ccw"

    def __post_init__(self) -> None:
        for name in ("outer_apothem", "turns", "trace_width", "gap"):
            require_positive(name, getattr(self, name), "")
        self._require_turns(self.outer_apothem, self.trace_width / 2, "first_corner")

    @property
    def inner_apothem(self) -> float:
        """Apothem in m of the centre line at its inner end."""
        return self.outer_apothem - self.trace_width / 2 - self.pitch * self.turns

    def centre_line(self, layer: int = 0) -> FloatArray:
        """Vertices of one layer as `Winding.centre_line`, shape (steps + 1, 2).

        Returns
        -------
        ndarray, shape (steps + 1, 2)
            Vertices in m, from the outer end to the inner one.
        """
        k = np.arange(self.steps + 1)
        inwards = k if layer % 2 == 0 else self.steps - k
        apothem = (self.outer_apothem - self.trace_width / 2) - self.pitch * inwards / self.sides
        return self._corners(layer * self.steps + k, apothem)

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
        return self._corners(np.arange(self.sides), np.full(self.sides, self.outer_apothem))

    def rim(self, step: int) -> FloatArray:
        """Corner number `step` in m of the outermost turn, shape (2,).

        Returns
        -------
        ndarray, shape (2,)
            x and y in m.
        """
        apothem = self.outer_apothem - self.trace_width / 2
        return np.asarray(self._corners(np.array([step]), np.array([apothem]))[0])

    def _corners(self, steps: IntArray, apothem: FloatArray) -> FloatArray:
        """Corners of polygons of several apothems in m, so many steps from the first one."""
        radius = apothem / math.cos(math.pi / self.sides)
        angle = self.first_corner + self._turned(steps)
        return np.column_stack((radius * np.cos(angle), radius * np.sin(angle)))
