"""Distances of boards in space."""

from __future__ import annotations

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.geometry.array import Array
from coilarray.geometry.pose import Pose

_SUM = 1e3  # weight of the sum of all shares, in sizes
_MEET = 1e-8  # of the size; hulls that are nearer meet
_SHRUNK = 1e-6  # of the size, by which boards that touch may overlap
_PIECES = 12  # along each edge of a bent board


def board_pieces(array: Array, pose: Pose, top: float = 0.0) -> FloatArray:
    """Return the corners of convex pieces of a board in space in m, shape (pieces, 8, 3).

    `top` is the height in m of sheets on the board. A flat board is one piece. A bent board has
    straight pieces, whose faces lie within 1 % of the bend radius of the board's for a half turn.
    """
    x_min, y_min, x_max, y_max = array.bounds
    x, y, z = (
        np.linspace(low, high, count + 1)
        for low, high, count in (
            (x_min, x_max, 1 if array.form is None else _PIECES),
            (y_min, y_max, 1 if array.form is None else _PIECES),
            (-array.stackup.thickness, top, 1),
        )
    )
    points = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
    placed = pose.apply(points if array.form is None else array.form.surface(points))
    shifted = [placed[i : len(x) - 1 + i, j : len(y) - 1 + j] for i in (0, 1) for j in (0, 1)]
    return np.concatenate(shifted, axis=-2).reshape(-1, 8, 3)


def hull_distance(one: FloatArray, other: FloatArray) -> tuple[float, FloatArray]:
    """Return the distance in m of the convex hulls of points, 0 if they meet, and its place (3,).

    The nearest points are mixtures of the points with shares that are not negative (C. L. Lawson,
    R. J. Hanson, Solving Least Squares Problems, ch. 23).
    """
    from scipy.optimize import nnls  # takes longer than all else of `check`

    middle = (one.mean(axis=0) + other.mean(axis=0)) / 2
    size = float(np.ptp(np.concatenate((one, other)), axis=0).max())
    mixed = np.concatenate((one - middle, middle - other)).T / size
    sums = _SUM * np.repeat(np.eye(2), (len(one), len(other)), axis=1)
    shares, _ = nnls(np.vstack((mixed, sums)), np.array([0.0, 0.0, 0.0, _SUM, _SUM]))
    first, second = np.split(shares, [len(one)])
    nearest = first @ one / first.sum()
    apart = float(np.linalg.norm(nearest - second @ other / second.sum()))
    return (apart if apart > _MEET * size else 0.0), nearest


def boards_apart(one: FloatArray, other: FloatArray) -> float:
    """Return the least distance in m of two boards of convex pieces, 0 if they meet."""
    return min(hull_distance(a, b)[0] for a in one for b in other)


def cut_through(one: FloatArray, other: FloatArray) -> FloatArray | None:
    """Return a point (3,) in m that two boards of convex pieces share, if they do more than touch."""
    shrunk = []
    for pieces in (one, other):
        middle = pieces.mean(axis=1, keepdims=True)
        shrunk.append(middle + (pieces - middle) * (1 - _SHRUNK))
    low, high = ([edge(body, axis=1) for body in shrunk] for edge in (np.min, np.max))
    near = ((low[0][:, None] <= high[1]) & (low[1] <= high[0][:, None])).all(axis=-1)
    for i, k in np.argwhere(near).tolist():
        apart, place = hull_distance(shrunk[0][i], shrunk[1][k])
        if not apart:
            return place
    return None


def free_shift(fixed: FloatArray, moved: FloatArray) -> float:
    """Return a shift in m along +z, to 1 %, after which a board is clear of another."""
    low, high = 0.0, float(fixed[..., 2].max() - moved[..., 2].min())
    while high - low > 0.01 * high:
        middle = (low + high) / 2
        clear = cut_through(fixed, moved + np.array([0.0, 0.0, middle])) is None
        low, high = (low, middle) if clear else (middle, high)
    return high
