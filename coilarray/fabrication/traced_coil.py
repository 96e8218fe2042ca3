"""A coil as it was found in the copper of a board."""

import re
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.fabrication.board import Hole, SurfacePad
from coilarray.geometry.arcs import Point
from coilarray.geometry.winding import FlatPath, Pole, Turns, find_turns, turns_about

_BEND = 1.5  # turns; a bend makes less about a place within it
_NO_AREA = 1e-6  # of the squared length of a path: a smaller area that it runs around counts as zero
LEAST_TURNS = 0.9  # turns from which a path is a coil: a loop lacks the space between its leads


@dataclass(frozen=True, eq=False)
class TracedCoil:
    """Path of the current in the copper, from end to end."""

    name: str  # coil1, coil2, … without a `net`
    lines: tuple[FloatArray, ...]  # (n, 2), with the current, each on one of `layers`
    layers: tuple[str, ...]
    widths: tuple[FloatArray, ...]  # (n − 1,)
    vias: tuple[Hole, ...]
    ends: tuple[Hole | SurfacePad | None, Hole | SurfacePad | None]
    passed: tuple[Hole, ...]  # holes along the path that lead to no other layer
    where: str
    net: str | None = None
    part: str = ""  # reference of the footprint that has all of it
    notes: tuple[str, ...] = ()
    _known: dict[str, Turns | None] = field(default_factory=dict, repr=False, compare=False)  # kept by `replace`

    @property
    def widest(self) -> float:
        """Largest width in m."""
        return max(float(widths.max()) for widths in self.widths)

    @property
    def path(self) -> FloatArray:
        """All lines joined (n, 2), without the vias, in m."""
        return np.vstack([self.lines[0][:1], *(line[1:] for line in self.lines)])

    @property
    def length(self) -> float:
        """Length of the path in m, without the vias."""
        return float(np.hypot(*np.diff(self.path, axis=0).T).sum())

    @cached_property
    def _cross(self) -> FloatArray:
        """Twice the signed areas in m² of the triangles from the beginning to each side."""
        points = self.path - self.path[0]
        following = np.roll(points, -1, axis=0)
        return np.asarray(points[:, 0] * following[:, 1] - points[:, 1] * following[:, 0])

    @property
    def _runs_around_nothing(self) -> bool:
        return bool(abs(self._cross.sum() / 2) <= _NO_AREA * self.length**2)

    @property
    def centre(self) -> Point:
        """Centre in m of the enclosed area, or the middle of the bounds."""
        path = self.path
        if self._runs_around_nothing:
            x, y = 0.5 * (path.min(axis=0) + path.max(axis=0))
        else:  # each part counts as often as the path runs around it
            both = path + np.roll(path, -1, axis=0) - 2 * path[0]
            x, y = path[0] + (both * self._cross[:, None]).sum(axis=0) / (3 * self._cross.sum())
        return float(x), float(y)

    @property
    def winding(self) -> Turns | None:
        """Winding part of the path, without its leads."""
        if "winding" not in self._known:
            self._known["winding"] = find_turns(FlatPath.of_lines(self.lines, self.widths))
        return self._known["winding"]

    @cached_property
    def poles(self) -> tuple[Pole, ...]:
        """Places about which the path winds, most turns first."""
        # A single loop and a meander, whose bends are no turns, have their centre: 0 turns around nothing.
        found = self.winding
        if found is not None:
            several = len(found.poles) > 1
            poles = [
                replace(pole, turns=found.own_turns(pole) if several else turns_about(self.path, (pole.x, pole.y)))
                for pole in found.poles
            ]
            poles.sort(key=lambda pole: -round(abs(pole.turns), 6))
            if abs(poles[0].turns) > _BEND:
                return tuple(poles)
        centre = self.centre
        return (Pole(*centre, 0.0 if self._runs_around_nothing else turns_about(self.path, centre)),)

    @property
    def turns(self) -> float:
        """Turns about the main pole, anticlockwise positive."""
        return self.poles[0].turns


def natural_order(name: str) -> list[tuple[bool, int, str]]:
    """Return a sort key that counts numbers in names: 7, A2, A10, B1."""
    parts = re.findall(r"[0-9]+|[^0-9]+", name)
    return [(not part.isdecimal(), int(part) if part.isdecimal() else 0, part) for part in parts]
