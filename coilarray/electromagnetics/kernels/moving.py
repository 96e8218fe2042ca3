"""Neumann sums of a path that moves beside a fixed one.

Of series of turns (`kernels.turns`) that lie apart a few members stand for all. Others are halved,
down to single turns. Filaments at the nodes of a Gauss rule across a bar stand for it: one far
away, two, three nearby. The difference of the variances of width and thickness counts, as 1/R is
harmonic across a bar. The moved filaments have Gauss nodes along them, at which the potential of
the fixed is exact, as in `kernels.paths`. Bars that are nearer still are listed, for that module.

Rows of filaments hold start (0:3), unit direction (3:6), length (6), half the width towards the
Gauss nodes across (7:10), the larger side (10) and the distance of `close` bars (11), all in m.
"""

from __future__ import annotations

import math

import numpy as np

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.electromagnetics.kernels import kernel
from coilarray.electromagnetics.kernels.bars import filament_pair
from coilarray.electromagnetics.kernels.paths import MOST_NODES, NODES, WEIGHTS, closest_offset, least_distances
from coilarray.electromagnetics.kernels.segments import dot, log_of_ratio, moved, norm

_LEAST = least_distances(-9.2)  # ln 1e-4: error of the Gauss rules along the moved filaments
_ACROSS = (2.5, 25.0)  # sides of distance from which two filaments stand for a bar, and one
_APART = 0.1  # breadths of distance from which a few turns stand for a series
_MEMBERS = 5  # turns that stand for a series, all of a series that is not halved
_FEW = 12  # most nodes of turns that are taken by the distance of their series


@kernel
def _add_nodes(row: FloatArray, weight: float, nodes: int, across: int, batch: FloatArray, count: int) -> int:
    """Add nodes of a moved bar to a batch of places (0:3) and currents (3:6)."""
    for side in range(across):
        aside = NODES[across, side]
        for k in range(nodes):
            along = 0.5 * row[6] * (1.0 + NODES[nodes, k])
            current = 0.25 * row[6] * WEIGHTS[across, side] * WEIGHTS[nodes, k] * weight
            for axis in range(3):
                batch[axis, count] = row[axis] + along * row[3 + axis] + aside * row[7 + axis]
                batch[3 + axis, count] = current * row[3 + axis]
            count += 1
    return count


@kernel
def _evaluate(row: FloatArray, across: int, batch: FloatArray, count: int) -> float:
    """Sum the potential of a fixed bar over a batch."""
    x, y, z, cx, cy, cz, values = batch[0], batch[1], batch[2], batch[3], batch[4], batch[5], batch[6]
    length = row[6]
    dx, dy, dz = row[3], row[4], row[5]
    total = 0.0
    for side in range(across):
        aside, share = NODES[across, side], 0.5 * WEIGHTS[across, side]
        px, py, pz = row[0] + aside * row[7], row[1] + aside * row[8], row[2] + aside * row[9]
        for i in range(count):
            ux, uy, uz = x[i] - px, y[i] - py, z[i] - pz
            vx, vy, vz = ux - length * dx, uy - length * dy, uz - length * dz
            ways = math.sqrt(ux * ux + uy * uy + uz * uz) + math.sqrt(vx * vx + vy * vy + vz * vz)
            current = cx[i] * dx + cy[i] * dy + cz[i] * dz
            values[i] = current * log_of_ratio(ways + length, ways - length, length / ways)
        for i in range(count):
            total += share * values[i]
    return total


@kernel
def _nodes_across(distance: float, size: float) -> int:
    return 1 if distance >= _ACROSS[1] * size else (2 if distance >= _ACROSS[0] * size else 3)


@kernel
def _nodes_along(distance: float, length: float) -> int:
    """Return the number of nodes, above MOST_NODES where none suffices."""
    nodes = 2
    while nodes <= MOST_NODES and distance < _LEAST[nodes] * length:
        nodes += 1
    return nodes


@kernel
def _distance(a: FloatArray, b: FloatArray) -> float:
    return norm(closest_offset((b[0] - a[0], b[1] - a[1], b[2] - a[2]), a, b))


@kernel
def _exact_pair(a: FloatArray, b: FloatArray, across: int) -> float:
    """Pair of bars by the closed form of their filaments."""
    u, v = (a[3], a[4], a[5]), (b[3], b[4], b[5])
    if abs(dot(u, v)) < 1e-12:
        return 0.0
    total = 0.0
    for i in range(across):
        start = moved((a[0], a[1], a[2]), NODES[across, i], (a[7], a[8], a[9]))
        for k in range(across):
            other = moved((b[0], b[1], b[2]), NODES[across, k], (b[7], b[8], b[9]))
            weight = 0.25 * WEIGHTS[across, i] * WEIGHTS[across, k]
            total += weight * filament_pair(u, a[6], moved(other, -1.0, start), v, b[6])
    return total


@kernel
def _breadth(rows: FloatArray, first: int, stride: int, count: int) -> float:
    """Distance from the first to the last of a series."""
    p, q = rows[first], rows[first + (count - 1) * stride]
    return norm((q[0] - p[0], q[1] - p[1], q[2] - p[2]))


@kernel
def _series_distance(
    fixed: FloatArray, i: int, di: int, m: int, moving: FloatArray, j: int, dj: int, n: int, most: float
) -> float:
    """Lower bound of two series' distance, a rough one above `most`."""
    slack = 0.5 * (_breadth(fixed, i, di, m) + _breadth(moving, j, dj, n))
    distance = _distance(fixed[i + m // 2 * di], moving[j + n // 2 * dj]) - slack
    if distance >= most or m * n == 1:
        return distance
    nearest = np.inf
    for k in range(min(m, 3)):  # the first, the middle and the last
        a = fixed[i + (m - 1) * k // max(min(m, 3) - 1, 1) * di]
        for q in range(min(n, 3)):
            b = moving[j + (n - 1) * q // max(min(n, 3) - 1, 1) * dj]
            nearest = min(nearest, _distance(a, b))
    return max(distance, nearest - 0.5 * slack if max(m, n) > 3 else nearest)


@kernel
def _halve(stack: IntArray, left: int, i: int, di: int, m: int, j: int, dj: int, n: int) -> int:
    """Put the halves of series with many members on the stack."""
    half_m, half_n = m // 2 if m > _MEMBERS else m, n // 2 if n > _MEMBERS else n
    for k in range(2 if half_m < m else 1):
        for q in range(2 if half_n < n else 1):
            stack[left, 0], stack[left, 1] = i + k * half_m * di, m - half_m if k else half_m
            stack[left, 2], stack[left, 3] = j + q * half_n * dj, n - half_n if q else half_n
            left += 1
    return left


@kernel
def moved_sum(
    fixed: FloatArray, of_fixed: IntArray, moving: FloatArray, of_moving: IntArray,
    members: IntArray, weights: FloatArray, counts: IntArray, close: IntArray,
) -> tuple[float, int]:  # fmt: skip
    """Sum ∬ dl·dl'/R of a path and a moved path, but for `close` bars.

    Rows of each path are followed by its series: first row, stride and number. The next three are
    `series_rules`. The numbers of close bars go to `close` (most, 2). The result is the sum in m,
    and how many these are, also beyond the most.
    """
    batch, filled = np.empty((3, 7, 3 * _MEMBERS * MOST_NODES)), np.zeros(3, np.int64)
    stack = np.empty((256, 4), np.int64)
    total, listed = 0.0, 0
    for a in range(of_fixed.shape[0]):
        di = of_fixed[a, 1]
        for b in range(of_moving.shape[0]):
            dj = of_moving[b, 1]
            stack[0, 0], stack[0, 1] = of_fixed[a, 0], of_fixed[a, 2]
            stack[0, 2], stack[0, 3] = of_moving[b, 0], of_moving[b, 2]
            left = 1
            while left > 0:
                left -= 1
                i, m, j, n = stack[left]
                side, longest = max(fixed[i, 10], moving[j, 10]), max(moving[j, 6], moving[j + (n - 1) * dj, 6])
                least = max(_ACROSS[0] * side, fixed[i, 11], moving[j, 11], _LEAST[_FEW] * longest)
                if m > _MEMBERS:
                    least = max(least, _APART * _breadth(fixed, i, di, m))
                if n > _MEMBERS:
                    least = max(least, _APART * _breadth(moving, j, dj, n))
                distance = _series_distance(fixed, i, di, m, moving, j, dj, n, least)
                if distance >= least:
                    across, nodes, count = _nodes_across(distance, side), _nodes_along(distance, longest), int(0.0)
                    for k in range(counts[n]):
                        row = moving[j + members[n, k] * dj]
                        count = _add_nodes(row, weights[n, k], nodes, across, batch[0], count)
                    for k in range(counts[m]):
                        row = fixed[i + members[m, k] * di]
                        total += weights[m, k] * _evaluate(row, across, batch[0], count)
                    continue
                if max(m, n) > _MEMBERS:
                    left = _halve(stack, left, i, di, m, j, dj, n)
                    continue
                for k in range(i, i + m * di, di):
                    filled[:] = 0
                    for q in range(j, j + n * dj, dj):
                        distance = _distance(fixed[k], moving[q])
                        if distance < max(fixed[k, 11], moving[q, 11]):
                            if listed < close.shape[0]:
                                close[listed, 0], close[listed, 1] = k, q
                            listed += 1
                            continue
                        across = _nodes_across(distance, max(fixed[k, 10], moving[q, 10]))
                        nodes = _nodes_along(distance, moving[q, 6])
                        if nodes > MOST_NODES:
                            total += _exact_pair(fixed[k], moving[q], across)
                            continue
                        add_to = batch[across - 1], filled[across - 1]
                        filled[across - 1] = _add_nodes(moving[q], 1.0, nodes, across, *add_to)
                    for across in range(1, 4):
                        total += _evaluate(fixed[k], across, batch[across - 1], filled[across - 1])
    return total, listed
