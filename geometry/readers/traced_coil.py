"""A coil found on a board: one path from end to end."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from coilarray.geometry.readers.board_copper import Hole, SurfacePad
from coilarray.geometry.values import FloatArray, Point

# Of the squared length of a path: an area that it runs around below this is none.
_NO_AREA = 1e-6


@dataclass(frozen=True, eq=False)
class TracedCoil:
    """A net that is one path from end to end.

    Parameters
    ----------
    name : str
        Name of the net; "coil1", "coil2", … where the board names none.
    lines : tuple of ndarray, each of shape (n, 2)
        Centre lines in m, in the direction of the current, each on one layer.
    layers : tuple of str
        Copper layer of each line.
    widths : tuple of ndarray, each of shape (n − 1,)
        Width of every segment in m.
    vias : tuple of Hole
        Between consecutive lines.
    ends : tuple of (Hole, SurfacePad or None)
        What stands at the beginning and at the end of the path.
    passed : tuple of Hole
        Holes along the path that lead to no other layer.
    where : str
        "file:line" of its first track.
    net : str or None
        Its net; None where the board names none.
    """

    name: str
    lines: tuple[FloatArray, ...]
    layers: tuple[str, ...]
    widths: tuple[FloatArray, ...]
    vias: tuple[Hole, ...]
    ends: tuple[Hole | SurfacePad | None, Hole | SurfacePad | None]
    passed: tuple[Hole, ...]
    where: str
    net: str | None = None

    @property
    def widest(self) -> float:
        """Largest width in m."""
        return max(float(widths.max()) for widths in self.widths)

    @property
    def path(self) -> FloatArray:
        """All lines as one, without the vias; shape (n, 2), in m."""
        return np.vstack([self.lines[0][:1], *(line[1:] for line in self.lines)])

    @property
    def length(self) -> float:
        """Length of the path in m, vias not counted."""
        return float(np.hypot(*np.diff(self.path, axis=0).T).sum())

    @property
    def centre(self) -> Point:
        """Centre in m of the area that the path runs around; the middle of its bounds where it runs around none."""
        path = self.path
        x, y = 0.5 * (path.min(axis=0) + path.max(axis=0)) if _runs_around_nothing(path) else _centroid(path)
        return float(x), float(y)

    @property
    def turns(self) -> float:
        """How often the path runs around its centre, anticlockwise positive; 0 where it runs around nothing."""
        if _runs_around_nothing(self.path):
            return 0.0
        points = self.path - self.centre
        a, b = points[:-1], points[1:]
        return float(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)).sum() / (2 * math.pi))


def _cross(points: FloatArray) -> FloatArray:
    """Twice the signed area of the triangle of the origin and each side of the closed path."""
    following = np.roll(points, -1, axis=0)
    return np.asarray(points[:, 0] * following[:, 1] - points[:, 1] * following[:, 0])


def _runs_around_nothing(path: FloatArray) -> bool:
    area = _cross(path - path[0]).sum() / 2
    return bool(abs(area) <= _NO_AREA * np.hypot(*np.diff(path, axis=0).T).sum() ** 2)


def _centroid(path: FloatArray) -> FloatArray:
    """Centroid of the area that a path, closed by a straight line, runs around; each part as often as it does so."""
    points = path - path[0]
    cross = _cross(points)
    return np.asarray(
        path[0] + ((points + np.roll(points, -1, axis=0)) * cross[:, None]).sum(axis=0) / (3 * cross.sum())
    )
