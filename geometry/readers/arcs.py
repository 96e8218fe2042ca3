"""Arcs through three points as straight pieces."""

from __future__ import annotations

import math

import numpy as np

from coilarray.geometry.values import FloatArray, Point

CHORD_ERROR = 0.9e-6
"""Largest distance in m of a straight piece from its arc."""

_LEAST_PIECES = 3  # of which the inner points lie no further outside than the error


def arc_points(start: Point, middle: Point, end: Point, error: float = CHORD_ERROR) -> FloatArray:
    """Points in m, shape (n >= 2, 2), on the arc from `start` over `middle` to `end`, which are its first and last.

    `middle` may lie anywhere between the ends. Where all three lie on a line the arc is that line; where start and end
    are one point it is the whole circle, with `middle` opposite. The pieces are at most `error` (m) from the arc.

    The inner points lie a little outside the arc, so that the pieces enclose the same area with its centre as the arc
    does: with n pieces of angle φ, (n − 2) r² sin φ + 2 R r sin φ = n R² φ. Points on the arc would make every coil of
    arcs too small.

    Examples
    --------
    >>> points = arc_points((1e-3, 0.0), (0.0, 1e-3), (-1e-3, 0.0))
    >>> len(points), bool((abs(np.hypot(*points.T) - 1e-3) < 0.9e-6).all())
    (39, True)
    >>> area = 0.5 * (points[:-1, 0] * points[1:, 1] - points[1:, 0] * points[:-1, 1]).sum()
    >>> round(float(area / (0.5 * np.pi * 1e-6)), 12)
    1.0
    """
    a, b, c = (np.array(point) for point in (start, middle, end))
    centre = _centre(a, b, c)
    if centre is None:
        return np.array([a, c])
    radius = float(np.hypot(*(a - centre)))
    first, over, last = (math.atan2(*(point - centre)[::-1]) for point in (a, b, c))
    turn = (last - first) % (2 * math.pi) or 2 * math.pi
    if (over - first) % (2 * math.pi) > turn:
        turn -= 2 * math.pi
    # chords of this angle have the sagitta `error`; the arc sine keeps it above 0 for the largest radius
    step = 4 * math.asin(math.sqrt(min(error / (2 * radius), 0.5)))
    pieces = max(_LEAST_PIECES, math.ceil(abs(turn) / step))
    angles = first + turn * np.linspace(0, 1, pieces + 1)
    inner = radius * _inner_radius(pieces, abs(turn) / pieces)
    points = centre + inner * np.column_stack((np.cos(angles), np.sin(angles)))
    points[0], points[-1] = a, c
    return points


def _inner_radius(pieces: int, angle: float) -> float:
    """Radius of the inner points over that of the arc: the positive root of the equation in `arc_points`."""
    middle, area = pieces - 2, pieces * angle / math.sin(angle)
    return (math.sqrt(1 + middle * area) - 1) / middle


def _centre(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray | None:
    """Centre of the circle through three points, None where they lie on a line."""
    if np.array_equal(a, c):
        return None if np.array_equal(a, b) else (a + b) / 2
    p, q = b - a, c - a
    cross = float(p[0] * q[1] - p[1] * q[0])
    # the sagitta of a flatter arc is below the resolution of any board file
    if abs(cross) <= 1e-10 * float(np.hypot(*q)):
        return None
    u, v = float(p @ p), float(q @ q)
    return np.asarray(a + np.array([q[1] * u - p[1] * v, p[0] * v - q[0] * u]) / (2 * cross))
