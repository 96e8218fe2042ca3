"""Where a winding is looked at: points along its segments, and the radial cut that crosses its turns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray, IntArray

_STEEPEST = 0.5  # sine of the smallest angle at which a segment may cross the cut
_ENCLOSED = 1e-6  # of length times size: less area is none
_GAP = 3.0  # in pitches: turns that lie further apart are two bundles
_DIRECTIONS = 64  # how many of the longest segments are tried as normals


def lateral_axes(vertices: FloatArray) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Horizontal unit vectors u × z across the segments, shape (n, 3), and which segments are not vertical, (n,)."""
    steps = np.diff(vertices, axis=0)
    across = np.hypot(steps[:, 0], steps[:, 1])
    flat = across > 1e-9 * np.linalg.norm(steps, axis=1)
    safe = np.where(flat, across, 1.0)
    return np.column_stack((steps[:, 1] / safe, -steps[:, 0] / safe, np.zeros(len(steps)))) * flat[:, None], flat


Cut = tuple[IntArray, FloatArray, FloatArray, FloatArray]
"""Crossed segments, shape (k,), their x and z in the cut, and the sign of their direction along its normal (z × x)."""


def radial_cut(vertices: FloatArray, widths: FloatArray) -> Cut:
    """Cut a winding by the half plane from its centre that crosses most length of turns squarely, in their middles.

    x counts from the centre. Vertical segments are left out, and so are leads, which come and go or pass the turns at
    a distance. Nothing may be crossed.
    """
    lateral, flat = lateral_axes(vertices)
    length = np.linalg.norm(np.diff(vertices, axis=0), axis=1) * flat
    nothing = np.empty(0)
    best, found = 0.0, (nothing.astype(np.int64), nothing, nothing, nothing)
    if not flat.any():
        return found
    from_centre = vertices - [*_centre(vertices[:, :2], length), 0.0]

    def cut(direction: FloatArray, shift: float) -> tuple[float, Cut]:
        """Return the turns that a shifted half plane crosses, and before them their length, less where not squarely."""
        side = from_centre[:, :2] @ (-direction[1], direction[0]) - shift
        along = from_centre[:, :2] @ direction
        sine = lateral[:, :2] @ direction
        crossed = np.flatnonzero(((side[:-1] < 0) != (side[1:] < 0)) & (np.abs(sine) > _STEEPEST))
        part = side[crossed] / (side[crossed] - side[crossed + 1])
        x = along[crossed] + part * np.diff(along)[crossed]
        score = (length * sine * np.abs(sine))[crossed]

        def only(chosen: npt.NDArray[np.bool_]) -> None:
            nonlocal crossed, part, x, score
            crossed, part, x, score = crossed[chosen], part[chosen], x[chosen], score[chosen]

        only(x > -0.5 * widths[crossed])  # before the sum: the other half of a symmetric winding would cancel it
        only(score * score.sum() > 0)
        only(_together(x, widths[crossed]))
        z = vertices[crossed, 2] + part * np.diff(vertices[:, 2])[crossed]
        return abs(float(score.sum())), (crossed, x, z, np.sign(score))

    longest = np.argsort(-length, kind="stable")[: min(_DIRECTIONS, int(flat.sum()))]
    normals = lateral[longest, :2]
    directions = np.unique(np.round(np.concatenate((normals, -normals)), 6), axis=0)
    for direction in directions / np.hypot(directions[:, :1], directions[:, 1:]):
        score, (crossed, *_) = cut(direction, 0.0)
        if score > best * (1 + 1e-6):
            middles = 0.5 * (from_centre[crossed, :2] + from_centre[crossed + 1, :2])
            best, found = score, cut(direction, float(np.median(middles @ (-direction[1], direction[0]))))[1]
    return found


def _centre(points: FloatArray, length: FloatArray) -> FloatArray:
    """Centre of the area that a path encloses, as often as it winds about each part; without any, of its length.

    Leads come and go side by side and enclose little, however long they are.
    """
    middle = 0.5 * (points[1:] + points[:-1])
    about = (length[:, None] * middle).sum(axis=0) / length.sum()
    start, end = points - about, np.roll(points, -1, axis=0) - about
    doubled = start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]
    if abs(doubled.sum()) < _ENCLOSED * length.sum() * np.ptp(points, axis=0).max():
        return np.asarray(about)
    return np.asarray(about + ((start + end) * doubled[:, None]).sum(axis=0) / (3.0 * doubled.sum()))


def _together(x: FloatArray, widths: FloatArray) -> npt.NDArray[np.bool_]:
    """Which of the crossings lie with most others, no gap of several pitches between them."""
    if not len(x):
        return np.ones(0, dtype=bool)
    order = np.argsort(x)
    gaps = np.diff(x[order])
    pitches = gaps[gaps > 0.5 * widths.min()]  # less lies between turns of two layers
    pitch = float(np.median(pitches)) if len(pitches) else np.inf
    bundle = np.concatenate(([0], np.cumsum(gaps > _GAP * pitch)))[np.argsort(order)]
    return np.asarray(bundle == np.bincount(bundle).argmax())


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
