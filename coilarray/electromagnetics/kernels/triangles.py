"""Integrals of 1/r over pairs of triangles.

∫∫ dA dA'/|x − x'| of near pairs follows from the closed form of the inner integral (Wilton et al.,
IEEE Trans. Antennas Propag. 32, 276 (1984)) at the nodes of a rule over the outer triangle. Far
pairs follow from the moments of both up to the second order, A A' (1/R + ½ (S + S'):∇∇(1/R)), R
between the centroids and A S = ∫ (x − c)(x − c)ᵀ dA.

Double layers of linear functions λ: ∫ dA ∫ dA' λ(x') n'·(x − x')/|x − x'|³, with the inner integral
λ(x) Ω − d ∇λ·Σ m ∫ dl/|x − x'| over the edges, Ω the solid angle, d the height of x over the plane
and m the edges' outward normals in it.
"""

from __future__ import annotations

import math

import numpy as np

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.electromagnetics.kernels import kernel
from coilarray.electromagnetics.kernels.segments import Vector, cross, dot, moved, norm

_NEAR = 2.5  # sums of both radii; beyond, the moments err by some 1e-4 of a pair
_A, _B = (6.0 - math.sqrt(15.0)) / 21.0, (6.0 + math.sqrt(15.0)) / 21.0
_WA, _WB = (155.0 - math.sqrt(15.0)) / 1200.0, (155.0 + math.sqrt(15.0)) / 1200.0
# Radon's rule of degree 5: barycentric coordinates and weight
_RULE = np.array(
    [[1 / 3, 1 / 3, 1 / 3, 9 / 40]]
    + [[*np.roll((1 - 2 * a, a, a), k), weight] for a, weight in ((_A, _WA), (_B, _WB)) for k in (2, 1, 0)]
)


@kernel
def triangle_pairs(corners: FloatArray, other: FloatArray, first: int, integrals: FloatArray) -> None:
    """Write the integrals (k, n) in m³ of triangle pairs.

    If `corners` are the triangles of `other` from number `first` on, or their mirror images, only
    the integrals up to the diagonal are written. If `first` is n, all are.
    """
    n = other.shape[0]
    moments, areas = np.empty((n, 10)), np.empty(n)
    for j in range(n):
        _moments(other[j], moments[j])
        areas[j] = _area(other[j])
    own = np.empty(10)
    for i in range(corners.shape[0]):
        _moments(corners[i], own)
        area = _area(corners[i])
        for j in range(min(first + i + 1, n)):
            dx, dy, dz = own[0] - moments[j, 0], own[1] - moments[j, 1], own[2] - moments[j, 2]
            r2 = dx * dx + dy * dy + dz * dz
            near = _NEAR * (own[9] + moments[j, 9])
            if r2 > near * near:
                inverse = 1.0 / r2
                xx, yy, zz = own[3] + moments[j, 3], own[4] + moments[j, 4], own[5] + moments[j, 5]
                xy, yz, zx = own[6] + moments[j, 6], own[7] + moments[j, 7], own[8] + moments[j, 8]
                along = xx * dx * dx + yy * dy * dy + zz * dz * dz + 2 * (xy * dx * dy + yz * dy * dz + zx * dz * dx)
                shape = 1.0 + (1.5 * along * inverse - 0.5 * (xx + yy + zz)) * inverse
                integrals[i, j] = area * areas[j] * shape * math.sqrt(inverse)
            else:
                integrals[i, j] = 0.5 * (_near_pair(corners[i], other[j]) + _near_pair(other[j], corners[i]))


@kernel
def _corner(t: FloatArray, k: int) -> Vector:
    return t[k, 0], t[k, 1], t[k, 2]


@kernel
def _place(t: FloatArray, q: int) -> Vector:
    a, b, c = _RULE[q, 0], _RULE[q, 1], _RULE[q, 2]
    return moved(moved(moved((0.0, 0.0, 0.0), a, _corner(t, 0)), b, _corner(t, 1)), c, _corner(t, 2))


@kernel
def _normal(t: FloatArray) -> tuple[Vector, float]:
    """Return a triangle's unit normal and twice its area."""
    first = _corner(t, 0)
    n = cross(moved(_corner(t, 1), -1.0, first), moved(_corner(t, 2), -1.0, first))
    double = norm(n)
    return (n[0] / double, n[1] / double, n[2] / double), double


@kernel
def _area(t: FloatArray) -> float:
    return 0.5 * _normal(t)[1]


@kernel
def _moments(t: FloatArray, out: FloatArray) -> None:
    """Centroid, second moments xx, yy, zz, xy, yz, zx over the area, radius."""
    for a in range(3):
        out[a] = (t[0, a] + t[1, a] + t[2, a]) / 3.0
    for a in range(3):
        b = (a + 1) % 3
        square, product = 0.0, 0.0
        for c in range(3):
            square += (t[c, a] - out[a]) ** 2
            product += (t[c, a] - out[a]) * (t[c, b] - out[b])
        out[3 + a], out[6 + a] = square / 12.0, product / 12.0
    farthest = 0.0
    for c in range(3):
        farthest = max(farthest, (t[c, 0] - out[0]) ** 2 + (t[c, 1] - out[1]) ** 2 + (t[c, 2] - out[2]) ** 2)
    out[9] = math.sqrt(farthest)


@kernel
def _near_pair(outer: FloatArray, inner: FloatArray) -> float:
    """Integral of 1/r of two near triangles in m³."""
    total = 0.0
    for q in range(_RULE.shape[0]):
        total += _RULE[q, 3] * _potential(inner, _place(outer, q))
    return total * _area(outer)


@kernel
def _potential(t: FloatArray, at: Vector) -> float:
    """Potential ∫ dA'/|x − x'|, Σ p ln((r₊ + l₊)/(r₋ + l₋)) − |d| (angles) over edges."""
    normal, _ = _normal(t)
    d = abs(dot(moved(at, -1.0, _corner(t, 0)), normal))
    total = 0.0
    for k in range(3):
        _, p, logarithm, angle = _edge(t, k, at, normal, d)
        total += p * logarithm - d * angle
    return total


@kernel
def _edge(t: FloatArray, k: int, at: Vector, normal: Vector, d: float) -> tuple[Vector, float, float, float]:
    """Return normal, distance, ∫ dl/r and angle of an edge.

    The normal is outward, in the plane, the distance of the point along it. `d` is its distance
    from the plane. The angles of all edges add up to the solid angle.
    """
    a, b = moved(_corner(t, k), -1.0, at), moved(_corner(t, (k + 1) % 3), -1.0, at)
    side = moved(b, -1.0, a)
    length = norm(side)
    s = (side[0] / length, side[1] / length, side[2] / length)
    start, stop, outward = dot(a, s), dot(b, s), cross(s, normal)
    p, ra, rb = dot(a, outward), norm(a), norm(b)
    away2 = p * p + d * d  # of the line
    if away2 < 1e-24 * length * length:
        return outward, p, 0.0, 0.0  # on the line of the edge, with p ln → 0
    angle = math.atan2(p * stop, away2 + d * rb) - math.atan2(p * start, away2 + d * ra) if d > 0.0 else 0.0
    return outward, p, _along(start, stop, ra, rb, away2), angle


@kernel
def _along(start: float, stop: float, ra: float, rb: float, away2: float) -> float:
    """Integrate dl/r along an edge from `start` to `stop`, `ra` and `rb` from the point."""
    if start > 0.0:
        return math.log((rb + stop) / (ra + start))
    if stop < 0.0:
        return math.log((ra - start) / (rb - stop))
    return math.log((rb + stop) * (ra - start) / away2)


@kernel
def double_layers(
    corners: FloatArray, other: FloatArray, nodes: IntArray, factor: float, integrals: FloatArray
) -> None:
    """Add `factor` times double-layer integrals (k, n) in m².

    The layers are on the `other` triangles, linear functions that are 1 at one of the corners
    `nodes` (l, 3). Normals point to the side from which the corners are anticlockwise.
    """
    radii = np.empty(other.shape[0])
    centres = np.empty((other.shape[0], 3))
    moments = np.empty(10)
    for j in range(other.shape[0]):
        _moments(other[j], moments)
        centres[j], radii[j] = moments[:3], moments[9]
    part = np.empty(3)
    for i in range(corners.shape[0]):
        t = corners[i]
        _moments(t, moments)
        area = factor * _area(t)
        for j in range(other.shape[0]):
            dx, dy, dz = moments[0] - centres[j, 0], moments[1] - centres[j, 1], moments[2] - centres[j, 2]
            near = _NEAR * (moments[9] + radii[j])
            far = dx * dx + dy * dy + dz * dz > near * near
            for q in range(1 if far else _RULE.shape[0]):  # the first node of the rule is the centroid
                _layer(other[j], _place(t, q), part)
                share = area if far else area * _RULE[q, 3]
                for corner in range(3):
                    integrals[i, nodes[j, corner]] += share * part[corner]


@kernel
def _layer(t: FloatArray, at: Vector, out: FloatArray) -> None:
    """Integrals ∫ λ_c n·(x − x')/|x − x'|³ dA' of a triangle's linear functions, 0 in its plane."""
    normal, double = _normal(t)
    d = dot(moved(at, -1.0, _corner(t, 0)), normal)
    out[0] = out[1] = out[2] = 0.0
    if abs(d) < 1e-9 * math.sqrt(double):
        return
    angle, sum_ = 0.0, (0.0, 0.0, 0.0)  # solid angle, and Σ m ∫ dl/|x − x'|
    for k in range(3):
        outward, _, logarithm, turn = _edge(t, k, at, normal, abs(d))
        sum_, angle = moved(sum_, logarithm, outward), angle + turn
    angle = angle if d > 0.0 else -angle
    for k in range(3):
        corner = _corner(t, (k + 1) % 3)  # of the opposite side
        slope = cross(normal, moved(_corner(t, (k + 2) % 3), -1.0, corner))
        at_foot = dot(slope, moved(at, -1.0, corner))  # λ at the foot of x in the plane, times `double`
        out[k] = (at_foot * angle - d * dot(slope, sum_)) / double
