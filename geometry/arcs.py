"""Circular arcs as straight pieces and as rounded corners."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.compute.display_units import true_minus

Point = tuple[float, float]  # x and y, in m unless stated otherwise
Side = Literal["right", "top", "left", "bottom"]
SIDES: tuple[Side, ...] = get_args(Side)  # sides in the order of the quarter turns from +x to their outward normals


def place_in_mm(x: float, y: float) -> str:
    """Write a place in m as "(1.5, 2) mm"."""
    numbers = (round(float(value) * 1e3, 3) + 0.0 for value in (x, y))  # + 0.0: no −0
    return true_minus("({:.4g}, {:.4g}) mm".format(*numbers))


Place = Point | FloatArray
CHORD_ERROR = 0.9e-6  # largest distance in m of a straight piece from its arc
_LEAST_PIECES = 3  # with fewer, the inner points would lie further outside than the error
_FLATTEST = 2e-10  # m: an arc of less height is straight, below the resolution of any board file


def arc_points(start: Place, middle: Place, end: Place, error: float = CHORD_ERROR) -> FloatArray:
    """Points (n >= 2, 2) in m on an arc, ends included.

    `middle` lies anywhere on the arc. Three points on a line give the line. Equal ends give the whole
    circle, with `middle` opposite. The pieces are at most `error` (m) from the arc.

    The inner points lie slightly outside the arc, so that pieces and arc enclose the same area with
    the centre: with n pieces of angle φ, (n − 2) r² sin φ + 2 R r sin φ = n R² φ. Points on the arc
    would make every coil of arcs too small.

    >>> points = arc_points((1e-3, 0.0), (0.0, 1e-3), (-1e-3, 0.0))
    >>> len(points), bool((abs(np.hypot(*points.T) - 1e-3) < 0.9e-6).all())
    (39, True)
    >>> area = 0.5 * (points[:-1, 0] * points[1:, 1] - points[1:, 0] * points[:-1, 1]).sum()
    >>> round(float(area / (0.5 * np.pi * 1e-6)), 12)
    1.0
    """
    radius, turn = arc_size(start, middle, end)
    if turn == 0:
        return np.array([start, end])
    count = max(_LEAST_PIECES, math.ceil(abs(turn) / _chord_angle(radius, error)))
    # on a small radius the inner points may lie farther out than the chords lie inside
    while radius * _inner_ratio(count, abs(turn) / count) - radius > error:
        count += 1
    return _arc_pieces(start, middle, end, count)


def _inner_ratio(pieces: int, angle: float) -> float:
    """Radius of the inner points of `arc_points` over the arc's."""
    inside, area = pieces - 2, pieces * angle / math.sin(angle)
    return (math.sqrt(1 + inside * area) - 1) / inside


def _chord_angle(radius: float, error: float = CHORD_ERROR) -> float:
    """Angle in rad of a chord with sagitta `error`, above 0."""
    return 4 * math.asin(math.sqrt(min(error / (2 * radius), 0.5)))


def _arc_pieces(start: Place, middle: Place, end: Place, count: int) -> FloatArray:
    """Points of `arc_points` in m, in `count` ≥ 3 equal pieces."""
    centre = arc_centre(start, middle, end)
    if centre is None:
        return np.array([start, end])
    radius, turn = arc_size(start, middle, end)
    pieces = max(_LEAST_PIECES, count)
    angles = math.atan2(*(np.array(start) - centre)[::-1]) + turn * np.linspace(0, 1, pieces + 1)
    inner = radius * _inner_ratio(pieces, abs(turn) / pieces)
    points = centre + inner * np.column_stack((np.cos(angles), np.sin(angles)))
    points[0], points[-1] = start, end
    return np.asarray(points)


def arc_size(start: Place, middle: Place, end: Place) -> tuple[float, float]:
    """Radius in m and anticlockwise angle in rad, inf and 0 for a line."""
    centre = arc_centre(start, middle, end)
    if centre is None:
        return math.inf, 0.0
    first, over, last = (math.atan2(y - centre[1], x - centre[0]) for x, y in (start, middle, end))
    turn = (last - first) % (2 * math.pi) or 2 * math.pi
    if (over - first) % (2 * math.pi) > turn:
        turn -= 2 * math.pi
    return float(np.hypot(*(np.array(start) - centre))), turn


def arc_centre(start: Place, middle: Place, end: Place) -> FloatArray | None:
    """Centre in m of an arc, None for a line."""
    a, b, c = (np.array(point) for point in (start, middle, end))
    if np.array_equal(a, c):
        return None if np.array_equal(a, b) else (a + b) / 2
    p, q = b - a, c - a
    cross = float(p[0] * q[1] - p[1] * q[0])
    if abs(cross) <= _FLATTEST / 2 * float(np.hypot(*q)):
        return None
    u, v = float(p @ p), float(q @ q)
    return np.asarray(a + np.array([q[1] * u - p[1] * v, p[0] * v - q[0] * u]) / (2 * cross))


@dataclass(frozen=True)
class Arc:
    """Run of pieces that stand for one arc.

    It runs from vertex `first` to `last`. `bulge` is tan(θ/4) of the arc's angle θ, positive
    counter-clockwise, as in DXF files. Motions of the line do not change it.
    """

    first: int
    last: int
    bulge: float

    def shifted(self, count: int) -> Arc:
        """Return the arc with `count` more vertices before it."""
        return replace(self, first=self.first + count, last=self.last + count)

    def points(self, line: FloatArray) -> tuple[Point, Point, Point]:
        """Begin, middle and end in m of the arc of a `line`."""
        (x0, y0), (x1, y1) = line[[self.first, self.last]].tolist()
        middle = (x0 + x1 + self.bulge * (y1 - y0)) / 2, (y0 + y1 - self.bulge * (x1 - x0)) / 2
        return (x0, y0), middle, (x1, y1)


def pieces_of(line: FloatArray, arcs: Sequence[Arc]) -> Iterator[Arc]:
    """Yield a line as arcs, without a bulge if straight."""
    done = 0
    for arc in (*arcs, Arc(len(line) - 1, len(line) - 1, 0.0)):
        yield from (Arc(k, k + 1, 0.0) for k in range(done, arc.first))
        if arc.last > arc.first:
            yield arc
        done = arc.last


def coarser_line(line: FloatArray, arcs: Sequence[Arc], step: float, small: float = 0.0) -> tuple[FloatArray, IntArray]:
    """Replace arcs of a line (n, 2) in m by larger pieces.

    `step` is the largest angle of a piece in rad. Arcs of radii up to `small` (m) have three pieces.
    """
    points, pieces, done = [line[:1]], [np.zeros(0, dtype=np.int64)], 0
    for arc in arcs:
        radius, turn = arc_size(*arc.points(line))
        count = _LEAST_PIECES if radius <= small else math.ceil(abs(turn) / step - 1e-9)
        piece = _arc_pieces(*arc.points(line), count)[1:]
        points += [line[done + 1 : arc.first + 1], piece]
        pieces += [np.arange(done, arc.first), np.full(len(piece), arc.first)]
        done = arc.last
    return np.vstack([*points, line[done + 1 :]]), np.concatenate([*pieces, np.arange(done, len(line) - 1)])


def rounded_line(corners: FloatArray, radii: Sequence[float]) -> tuple[FloatArray, tuple[Arc, ...]]:
    """Round the corners of a line (n, 2) in m.

    `radii` are in m, one for each inner corner, and small enough that neighbouring arcs do not
    overlap. All pieces have the angle that the largest arc needs, so the pieces of concentric arcs
    are parallel and as far apart as the arcs.

    >>> points, (arc,) = rounded_line(np.array([[0, 0], [2e-3, 0], [2e-3, 2e-3]]), [1e-3])
    >>> (points[[0, arc.first, arc.last, -1]] * 1e3).round(6).tolist()
    [[0.0, 0.0], [1.0, 0.0], [2.0, 1.0], [2.0, 2.0]]
    """
    along = np.diff(corners, axis=0)
    along /= np.hypot(*along.T)[:, None]
    step = _chord_angle(max(radii, default=0.0) or 1.0)
    near = 1e-12 * float(np.ptp(corners))  # the straight piece between two arcs may have no length
    points, count, arcs = [corners[:1]], 1, list[Arc]()
    ends = zip(corners[1:], along, [*along[1:], along[-1]], [*radii, 0.0], strict=True)  # the last end does not turn
    for corner, before, after, radius in ends:
        turn = math.atan2(before[0] * after[1] - before[1] * after[0], float(before @ after))
        piece = corner[None]
        if radius * (1 - math.cos(turn / 2)) > _FLATTEST:
            tangent = radius * math.tan(abs(turn) / 2)
            inwards = (after - before) / float(np.hypot(*(after - before)))
            middle = corner + radius * (1 / math.cos(turn / 2) - 1) * inwards
            begin, end = corner - tangent * before, corner + tangent * after
            piece = _arc_pieces(begin, middle, end, math.ceil(abs(turn) / step - 1e-9))
        repeated = int(np.hypot(*(piece[0] - points[-1][-1])) <= near)
        points.append(piece[repeated:])
        count += len(piece) - repeated
        if len(piece) > 1:
            arcs.append(Arc(count - len(piece), count - 1, math.tan(turn / 4)))
    return np.vstack(points), tuple(arcs)
