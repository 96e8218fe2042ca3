"""Neumann sums of a path that moves beside a fixed one.

Of windings, a few turns with weights stand for all, as in `kernels.turns`, and a second set of
weights tells how well. Two filaments of half the current stand for the width of a bar.
"""

from __future__ import annotations

import math

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.electromagnetics.kernels import kernel
from coilarray.electromagnetics.kernels.paths import MOST_NODES, gauss_tables, least_distances
from coilarray.electromagnetics.kernels.segments import log_of_ratio

LOG_TOLERANCE = -13.8  # ln 1e-6: error of the Gauss rules along the moved filaments
_LEAST = least_distances(LOG_TOLERANCE)
_NODES, _WEIGHTS = gauss_tables(MOST_NODES)


@kernel
def moved_sums(fixed: FloatArray, moved: FloatArray, rotation: FloatArray, shift: FloatArray, out: FloatArray) -> None:
    """Add ∬ dl·dl'/R of a moved path to `out` (2,), by both sets of weights.

    Rows of filaments hold start (0:3), unit direction (3:6), length (6) and the two weights (7:9).
    """
    x, y, z = np.empty(MOST_NODES), np.empty(MOST_NODES), np.empty(MOST_NODES)
    for j in range(moved.shape[0]):
        length = moved[j, 6]
        sx = rotation[0, 0] * moved[j, 0] + rotation[0, 1] * moved[j, 1] + rotation[0, 2] * moved[j, 2] + shift[0]
        sy = rotation[1, 0] * moved[j, 0] + rotation[1, 1] * moved[j, 1] + rotation[1, 2] * moved[j, 2] + shift[1]
        sz = rotation[2, 0] * moved[j, 0] + rotation[2, 1] * moved[j, 1] + rotation[2, 2] * moved[j, 2] + shift[2]
        ux = rotation[0, 0] * moved[j, 3] + rotation[0, 1] * moved[j, 4] + rotation[0, 2] * moved[j, 5]
        uy = rotation[1, 0] * moved[j, 3] + rotation[1, 1] * moved[j, 4] + rotation[1, 2] * moved[j, 5]
        uz = rotation[2, 0] * moved[j, 3] + rotation[2, 1] * moved[j, 4] + rotation[2, 2] * moved[j, 5]
        better, worse = 0.0, 0.0
        for i in range(fixed.shape[0]):
            ax, ay, az, a = fixed[i, 3], fixed[i, 4], fixed[i, 5], fixed[i, 6]
            cosine = ax * ux + ay * uy + az * uz
            if abs(cosine) < 1e-12:
                continue
            dx, dy, dz = sx - fixed[i, 0], sy - fixed[i, 1], sz - fixed[i, 2]
            # distance of the two segments, at least
            along = dx * ax + dy * ay + dz * az
            du = dx * ux + dy * uy + dz * uz
            sine2 = 1.0 - cosine * cosine
            s = (along - cosine * du) / sine2 if sine2 > 1e-12 else 0.5 * a
            s = min(max(s, 0.0), a)
            t = min(max(cosine * s - du, 0.0), length)
            s = min(max(cosine * t + along, 0.0), a)
            t = min(max(cosine * s - du, 0.0), length)
            gx, gy, gz = dx + t * ux - s * ax, dy + t * uy - s * ay, dz + t * uz - s * az
            distance = math.sqrt(gx * gx + gy * gy + gz * gz)
            nodes = 2
            while nodes < MOST_NODES and distance < _LEAST[nodes] * length:
                nodes += 1
            for k in range(nodes):
                step = 0.5 * length * (1.0 + _NODES[nodes, k])
                x[k], y[k], z[k] = dx + step * ux, dy + step * uy, dz + step * uz
            total = 0.0
            for k in range(nodes):
                ex, ey, ez = x[k] - a * ax, y[k] - a * ay, z[k] - a * az
                ways = math.sqrt(x[k] * x[k] + y[k] * y[k] + z[k] * z[k]) + math.sqrt(ex * ex + ey * ey + ez * ez)
                total += _WEIGHTS[nodes, k] * log_of_ratio(ways + a, ways - a, a / ways)
            value = 0.5 * length * cosine * total
            better += fixed[i, 7] * value
            worse += fixed[i, 8] * value
        out[0] += moved[j, 7] * better
        out[1] += moved[j, 8] * worse
