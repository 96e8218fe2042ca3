"""Equivalent currents of a distant path.

They are at the Chebyshev nodes of its bounding box. Between two boxes that lie apart 1/R is smooth, so it equals its
interpolation from the nodes of either box. A path is then represented by the vector W_p = ∫ L_p dl at every node p,
with the Lagrange polynomials L_p, and

    ∬ dl·dl'/R = Σ_pq W_p·W'_q / |x_p − x'_q|

as in the black-box fast multipole method (Fong & Darve, J. Comput. Phys. 228, 8712, 2009).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coilarray.compute.arrays import FloatArray, IntArray

MOST_NODES = 16  # along a side of the box; nearer pairs need more and are left to the sums over segments
_LOG_TOLERANCE = math.log(1e-7)  # of ρ^−n times (gap/half + 1)², as M of two windings falls faster than M of pieces
_NONE = 1e-9  # of the box; smaller extents count as zero


@dataclass(frozen=True, eq=False)
class EquivalentCurrents:
    """Currents ∫ L I dl of a path in A m at nodes in m, (n, 3) each."""

    nodes: FloatArray
    currents: FloatArray


def bounding_boxes(paths: Sequence[FloatArray]) -> FloatArray:
    """Middle and half extent in m of paths (m, 3), (paths, 2, 3)."""
    low = np.array([vertices.min(axis=0) for vertices in paths])
    high = np.array([vertices.max(axis=0) for vertices in paths])
    return np.stack(((low + high) / 2, (high - low) / 2), axis=1)


def nodes_needed(first: FloatArray, second: FloatArray, shifts: FloatArray) -> IntArray:
    """Numbers of nodes along x and y, and along z, of box pairs, (n, 2).

    The second of the `bounding_boxes` is moved by `shifts` (n, 3) in m. A value above `MOST_NODES` means that they are
    too near each other.
    """
    between = np.abs(second[:, 0] + shifts - first[:, 0]) - first[:, 1] - second[:, 1]
    gap = np.maximum(between, 0.0)
    half = np.maximum(first[:, 1], second[:, 1])
    sizes = np.column_stack((half[:, :2].max(axis=1), half[:, 2]))
    none = _NONE * half.max(axis=1)[:, None]
    # Singularities beside the interval [−1, 1] lie beyond its ends, those above it anywhere along it.
    lengths = np.maximum(sizes, none)
    beside = np.arccosh(1.0 + np.hypot(gap[:, 0], gap[:, 1])[:, None] / lengths)
    above = np.arcsinh(gap[:, 2][:, None] / lengths)
    with np.errstate(divide="ignore"):
        apart_by = np.log1p(np.hypot(*gap.T[:2]) / half.max(axis=1))[:, None]
        count = np.ceil((2 * apart_by - _LOG_TOLERANCE) / np.maximum(beside, above))
    apart = gap.max(axis=1)[:, None] > 0
    count = np.where((sizes <= none) & apart, 1.0, np.maximum(count, 2.0))
    return np.asarray(np.minimum(count, MOST_NODES + 1.0), dtype=np.int64)


def equivalent_currents(segments: FloatArray, count: int, count_z: int, current: float = 1.0) -> EquivalentCurrents:
    """Currents of segments (m, 2, 3) in m at Chebyshev nodes of their box.

    There are `count` nodes along x and y, and `count_z` along z. `current` is the current of every segment in A.
    Polynomials along a segment are integrated exactly.
    """
    ((centre, extent),) = bounding_boxes([segments.reshape(-1, 3)])
    gauss, weight = np.polynomial.legendre.leggauss(count + (count_z + 1) // 2)
    step = segments[:, 1] - segments[:, 0]
    places = (segments[:, :1] + 0.5 * (1.0 + gauss)[:, None] * step[:, None]).reshape(-1, 3)
    pieces = (0.5 * current * weight[:, None] * step[:, None]).reshape(-1, 3)
    local = np.clip((places - centre) / np.where(extent > 0, extent, 1.0), -1.0, 1.0)
    counts = (count, count, count_z)
    along_x, along_y, along_z = (_lagrange(n, local[:, axis]) for axis, n in enumerate(counts))
    upwards = (along_z[:, :, None] * pieces[:, None, :]).reshape(len(places), -1)
    across = (along_y[:, :, None] * upwards[:, None, :]).reshape(len(places), -1)
    axes = [centre[axis] + extent[axis] * _chebyshev(n) for axis, n in enumerate(counts)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return EquivalentCurrents(nodes, (along_x.T @ across).reshape(-1, 3))


def _chebyshev(n: int) -> FloatArray:
    return np.asarray(np.cos(np.pi * (np.arange(n) + 0.5) / n))


def _lagrange(n: int, t: FloatArray) -> FloatArray:
    """Lagrange polynomials of the Chebyshev nodes at −1 ≤ t ≤ 1, (points, n)."""
    at_points, at_nodes = (np.polynomial.chebyshev.chebvander(x, n - 1) for x in (t, _chebyshev(n)))
    at_points[:, 0] *= 0.5
    return np.asarray(2.0 / n * at_points @ at_nodes.T)
