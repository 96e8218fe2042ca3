"""Sums Σ W_p·W'_q / |x_p − x'_q| over pairs of nodes that carry currents."""

from __future__ import annotations

import math

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.electromagnetics.kernels.compiled import kernel


@kernel
def add_node_sums(
    nodes: FloatArray, currents: FloatArray, other_nodes: FloatArray, other_currents: FloatArray, shifts: FloatArray,
    sums: FloatArray,
) -> None:  # fmt: skip
    """Add the sum of two sets of nodes to `sums` (m,).

    The second set is moved by each of `shifts` (m, 3). `nodes` and `currents` have the shape (n, 3), the others (3, k),
    so that the processor takes several at once.
    """
    x, y, z = other_nodes[0], other_nodes[1], other_nodes[2]
    wx, wy, wz = other_currents[0], other_currents[1], other_currents[2]
    potential = np.empty((3, x.shape[0]))
    ax, ay, az = potential[0], potential[1], potential[2]
    for m in range(shifts.shape[0]):
        for q in range(x.shape[0]):
            ax[q], ay[q], az[q] = 0.0, 0.0, 0.0
        for p in range(nodes.shape[0]):
            px, py, pz = nodes[p, 0] - shifts[m, 0], nodes[p, 1] - shifts[m, 1], nodes[p, 2] - shifts[m, 2]
            cx, cy, cz = currents[p, 0], currents[p, 1], currents[p, 2]
            for q in range(x.shape[0]):
                dx, dy, dz = x[q] - px, y[q] - py, z[q] - pz
                inverse = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
                ax[q] += cx * inverse
                ay[q] += cy * inverse
                az[q] += cz * inverse
        total = 0.0
        for q in range(x.shape[0]):
            total += wx[q] * ax[q] + wy[q] * ay[q] + wz[q] * az[q]
        sums[m] += total
