"""Points along the segments of a winding and directions across."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray, IntArray


def lateral_axes(vertices: FloatArray) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Horizontal unit vectors u × z across segments (n, 3), and a mask of them.

    The mask (n,) is of the segments that are not vertical.
    """
    steps = np.diff(vertices, axis=0)
    across = np.hypot(steps[:, 0], steps[:, 1])
    flat = across > 1e-9 * np.linalg.norm(steps, axis=1)
    safe = np.where(flat, across, 1.0)
    return np.column_stack((steps[:, 1] / safe, -steps[:, 0] / safe, np.zeros(len(steps)))) * flat[:, None], flat


def gauss_points(
    vertices: FloatArray, widths: FloatArray, segments: IntArray, rules: Sequence[tuple[float, int]]
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Gauss points along segments: segment (n,), length in m (n,), point (n, 3).

    `rules` has (least length in widths, points), rising. The points keep half a width away from the corners. There the
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
