"""Arcs through three points as straight pieces."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Point = tuple[float, float]

# Largest distance in m of a straight piece from its arc.
CHORD_ERROR = 0.9e-6


def arc_points(start: Point, middle: Point, end: Point, error: float = CHORD_ERROR) -> FloatArray:
    """Points on the arc from `start` over `middle` to `end`.

    Parameters
    ----------
    start, middle, end : tuple of float
        In m; `middle` may lie anywhere between the ends. Where all three lie on a line the arc is that line. Where
        start and end are one point the arc is the whole circle, with `middle` opposite.
    error : float
        Largest distance in m of the chords from the arc.

    Returns
    -------
    ndarray, shape (n >= 2, 2)
        In m; the first and last are `start` and `end` themselves.

    Examples
    --------
    >>> points = arc_points((1e-3, 0.0), (0.0, 1e-3), (-1e-3, 0.0))
    >>> len(points), bool((abs(np.hypot(*points.T) - 1e-3) < 1e-15).all())
    (39, True)
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
    step = 2 * math.acos(max(1 - error / radius, 0.0))
    pieces = max(1, math.ceil(abs(turn) / step))
    angles = first + turn * np.linspace(0, 1, pieces + 1)
    points = centre + radius * np.column_stack((np.cos(angles), np.sin(angles)))
    points[0], points[-1] = a, c
    return points


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
