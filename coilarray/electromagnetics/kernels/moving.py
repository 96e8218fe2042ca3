"""Neumann sums of a path that moves beside a fixed one.

Of windings, a few turns with weights stand for all, as in `kernels.turns`, and a second set of
weights tells how well. Two filaments of half the current stand for the width of a bar.
"""

from __future__ import annotations

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.electromagnetics.kernels import kernel
from coilarray.electromagnetics.kernels.paths import MOST_NODES, NODES, WEIGHTS, closest_offset, least_distances
from coilarray.electromagnetics.kernels.segments import dot, log_of_ratio, moved, norm

_LEAST = least_distances(-13.8)  # ln 1e-6: error of the Gauss rules along the moved filaments


@kernel
def moved_sums(fixed: FloatArray, moving: FloatArray, rotation: FloatArray, shift: FloatArray, out: FloatArray) -> None:
    """Add ∬ dl·dl'/R of a moved path to `out` (0:2), by both sets of weights.

    The distance of the nearest rows goes to `out` (2), zero if they need more nodes than there are.
    Rows of filaments hold start (0:3), unit direction (3:6), length (6) and the two weights (7:9).
    """
    turned = np.empty(7)
    for j in range(moving.shape[0]):
        length = moving[j, 6]
        turned[6] = length
        for axis in range(3):
            turned[axis], turned[3 + axis] = shift[axis], 0.0
            for other in range(3):
                turned[axis] += rotation[axis, other] * moving[j, other]
                turned[3 + axis] += rotation[axis, other] * moving[j, 3 + other]
        along = (turned[3], turned[4], turned[5])
        better, worse = 0.0, 0.0
        for i in range(fixed.shape[0]):
            a = fixed[i, 6]
            direction = (fixed[i, 3], fixed[i, 4], fixed[i, 5])
            cosine = dot(direction, along)
            if abs(cosine) < 1e-12:
                continue
            apart = (turned[0] - fixed[i, 0], turned[1] - fixed[i, 1], turned[2] - fixed[i, 2])
            distance = norm(closest_offset(apart, fixed[i], turned))
            nodes = 2
            while nodes < MOST_NODES and distance < _LEAST[nodes] * length:
                nodes += 1
            out[2] = min(out[2], distance if distance >= _LEAST[nodes] * length else 0.0)
            total = 0.0
            for k in range(nodes):
                point = moved(apart, 0.5 * length * (1.0 + NODES[nodes, k]), along)
                ways = norm(point) + norm(moved(point, -a, direction))
                total += WEIGHTS[nodes, k] * log_of_ratio(ways + a, ways - a, a / ways)
            value = 0.5 * length * cosine * total
            better += fixed[i, 7] * value
            worse += fixed[i, 8] * value
        out[0] += moving[j, 7] * better
        out[1] += moving[j, 8] * worse
