"""Where a winding is looked at: points along its segments, and the radial cut that crosses its turns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray, IntArray

_STEEPEST = 0.5  # sine of the smallest angle at which a segment may cross the cut
_DIRECTIONS = 64  # how many of the longest segments are tried as normals


def lateral_axes(vertices: FloatArray) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Horizontal unit vectors u × z across the segments, shape (n, 3), and which segments are not vertical, (n,)."""
    steps = np.diff(vertices, axis=0)
    across = np.hypot(steps[:, 0], steps[:, 1])
    flat = across > 1e-9 * np.linalg.norm(steps, axis=1)
    safe = np.where(flat, across, 1.0)
    return np.column_stack((steps[:, 1] / safe, -steps[:, 0] / safe, np.zeros(len(steps)))) * flat[:, None], flat


def radial_cut(vertices: FloatArray, widths: FloatArray) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Cut a winding by the half plane from its centre that crosses most length of segments squarely.

    Returns the crossed segments, shape (k,), their x (from the centre) and z in the cut, and the sign of their
    direction along its normal (z × x). Vertical segments are left out; k may be 0.
    """
    lateral, flat = lateral_axes(vertices)
    length = np.linalg.norm(np.diff(vertices, axis=0), axis=1) * flat
    nothing = np.empty(0)
    if not flat.any():
        return nothing.astype(np.int64), nothing, nothing, nothing
    middle = 0.5 * (vertices[1:, :2] + vertices[:-1, :2])
    centre = (length[:, None] * middle).sum(axis=0) / length.sum()
    from_centre = vertices[:, :2] - centre
    longest = np.argsort(-length, kind="stable")[: min(_DIRECTIONS, int(flat.sum()))]
    normals = lateral[longest, :2]
    best, found = 0.0, (nothing.astype(np.int64), nothing, nothing, nothing)
    directions = np.unique(np.round(np.concatenate((normals, -normals)), 6), axis=0)
    for direction in directions / np.hypot(directions[:, :1], directions[:, 1:]):
        side = direction[0] * from_centre[:, 1] - direction[1] * from_centre[:, 0]
        along = from_centre @ direction
        crossed = ((side[:-1] < 0) != (side[1:] < 0)) & flat
        part = side[:-1] / np.where(crossed, side[:-1] - side[1:], 1.0)
        x = along[:-1] + part * np.diff(along)
        sine = lateral[:, :2] @ direction
        crossed &= (x > -0.5 * widths) & (np.abs(sine) > _STEEPEST)
        score = float((length * sine**2)[crossed].sum())
        if score > best * (1 + 1e-6):
            z = vertices[:-1, 2] + part * np.diff(vertices[:, 2])
            best, found = score, (np.flatnonzero(crossed), x[crossed], z[crossed], np.sign(sine[crossed]))
    return found


def nearest_crossing(vertices: FloatArray, crossed: IntArray, height_range: float) -> IntArray:
    """Crossed segment nearest along the path to every segment, within `height_range`; −1 where there is none."""
    length = np.linalg.norm(np.diff(vertices, axis=0), axis=1)
    place = np.cumsum(length) - 0.5 * length
    height = 0.5 * (vertices[1:, 2] + vertices[:-1, 2])
    if not len(crossed):
        return np.full(len(length), -1)
    distance = np.abs(place[:, None] - place[crossed])
    distance[np.abs(height[:, None] - height[crossed]) > height_range] = np.inf
    nearest = distance.argmin(axis=1)
    return np.where(np.isfinite(distance.min(axis=1)), nearest, -1)


def gauss_points(
    vertices: FloatArray, widths: FloatArray, segments: IntArray, rules: Sequence[tuple[float, int]]
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Gauss points along segments: the segment and the length in m of each, shape (n,), and the points, (n, 3).

    `rules`: (least length in widths, points), rising. The points keep half a width away from the corners, where the
    field of the next segment's centre line, though not of its copper, has no bound.
    """
    steps = np.diff(vertices, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    slender = lengths / widths
    gauss = {count: np.polynomial.legendre.leggauss(count) for _, count in rules}
    counts = [max(count for least, count in rules if value >= least) for value in slender[segments]]
    of_point = np.repeat(segments, counts)
    weight = 0.5 * np.concatenate([gauss[count][1] for count in counts]) * lengths[of_point]
    node = np.concatenate([gauss[count][0] for count in counts]) * np.maximum(1.0 - 1.0 / slender[of_point], 0.0)
    return of_point, weight, vertices[of_point] + 0.5 * (1.0 + node)[:, None] * steps[of_point]
