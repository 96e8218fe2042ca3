"""Neumann sums of distant bars, and of nodes with currents.

The exact potential of one bar is evaluated at the nodes of a Gauss rule along the other. The
potential of a segment a at a point, along it, is ln((|u| + |v| + |a|)/(|u| + |v| − |a|)) with u and
v from its ends to the point. Along another segment of length ℓ at distance D from a it is analytic
out to the Bernstein ellipse ln ρ ≥ asinh(2D/ℓ), so n nodes err like ρ^(−2n). Nodes of many pairs
are evaluated together, without a branch, so that the processor does several at once.
"""

from __future__ import annotations

import math

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.electromagnetics.kernels import kernel
from coilarray.electromagnetics.kernels.segments import log_of_ratio

MOST_NODES = 32  # along one segment; pairs that need more are left to the closed forms
APART = 7.6  # distance in widths from which two nodes across suffice, for each width: ln ρ ≥ 3.45 in `kernels.paths`
CAPACITY = 4096  # nodes that are evaluated together, whose four arrays fit the caches
_LANES = 8


@kernel
def add_node_sums(
    nodes: FloatArray, currents: FloatArray, other_nodes: FloatArray, other_currents: FloatArray, shifts: FloatArray,
    sums: FloatArray,
) -> None:  # fmt: skip
    """Add the sum of two sets of nodes to `sums`, by `shifts` (m, 3).

    The others' shape (3, k) lets the processor take several at once.
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


def gauss_tables(most: int) -> tuple[FloatArray, FloatArray]:
    """Gauss nodes and weights on [−1, 1], n nodes in row n."""
    nodes, weights = np.zeros((most + 1, most)), np.zeros((most + 1, most))
    for n in range(1, most + 1):
        nodes[n, :n], weights[n, :n] = np.polynomial.legendre.leggauss(n)
    return nodes, weights


_NODES, _WEIGHTS = gauss_tables(MOST_NODES)


def least_distances(log_tolerance: float) -> FloatArray:
    """Least distances in segment lengths for errors e^`log_tolerance` of n nodes."""
    with np.errstate(divide="ignore", over="ignore"):
        return np.asarray(0.5 * np.sinh(-log_tolerance / (2.0 * np.arange(MOST_NODES + 1))))


@kernel
def node_count(distance: float, length: float, least: FloatArray) -> int:
    """Count the nodes along a segment by `least_distances`, at most MOST_NODES + 1."""
    for n in range(2, MOST_NODES + 1):
        if distance >= least[n] * length:
            return n
    return MOST_NODES + 1


@kernel
def add_nodes(
    count: int, b: FloatArray, dx: float, dy: float, dz: float, weight: float, n: int, batch: FloatArray
) -> int:
    """Collect a segment's nodes from (dx, dy, dz) in `batch` (x, y, z, weight)."""
    half = 0.5 * b[6]
    for k in range(n):
        t = half * (1.0 + _NODES[n, k])
        batch[0, count] = dx + t * b[3]
        batch[1, count] = dy + t * b[4]
        batch[2, count] = dz + t * b[5]
        batch[3, count] = weight * half * _WEIGHTS[n, k]
        count += 1
    return count


@kernel
def batch_sum(a: FloatArray, count: int, batch: FloatArray) -> float:
    """Weighted sum of the potential of row `a` over collected nodes."""
    x, y, z, weight = batch[0], batch[1], batch[2], batch[3]
    padded = (count + _LANES - 1) // _LANES * _LANES
    for i in range(count, padded):
        x[i], y[i], z[i], weight[i] = 0.0, 0.0, 2.0 * a[6], 0.0
    length = a[6]
    ex, ey, ez = length * a[3], length * a[4], length * a[5]
    for i in range(padded):
        vx = x[i] - ex
        vy = y[i] - ey
        vz = z[i] - ez
        total = math.sqrt(x[i] * x[i] + y[i] * y[i] + z[i] * z[i]) + math.sqrt(vx * vx + vy * vy + vz * vz)
        weight[i] *= log_of_ratio(total + length, total - length, length / total)
    lanes = np.zeros(_LANES)
    for i in range(0, padded, _LANES):
        for k in range(_LANES):
            lanes[k] += weight[i + k]
    value = 0.0
    for k in range(_LANES):
        value += lanes[k]
    return value
