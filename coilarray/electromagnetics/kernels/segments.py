"""Exact fields B and A of straight current segments.

With u = X − P0, v = X − P1 and d = P1 − P0 = u − v (B: Hanson & Hirshman, Phys. Plasmas 9, 4410,
2002),

    B = µ0 I/4π · (|u| + |v|) / (|u||v| (|u||v| + u·v)) · d × u
    A = µ0 I/4π · d/|d| · ln((|u| + |v| + |d|) / (|u| + |v| − |d|))

For u·v < 0 (beside the segment) |u||v| + u·v cancels. There it equals |d × u|²/(|u||v| − u·v),
which does not cancel. Neighbours in a polyline share a vertex and so a square root.
"""

from __future__ import annotations

import math

import numpy as np

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.electromagnetics.kernels import kernel

ON_WIRE = 1e-12  # of the segment's length: a point nearer than this counts as on the segment, which then adds nothing
_LN_2 = math.log(2.0)
Vector = tuple[float, float, float]


@kernel
def dot(u: Vector, v: Vector) -> float:
    """Scalar product."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@kernel
def cross(u: Vector, v: Vector) -> Vector:
    """Vector product."""
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@kernel
def moved(p: Vector, t: float, u: Vector) -> Vector:
    """Point p + t u."""
    return p[0] + t * u[0], p[1] + t * u[1], p[2] + t * u[2]


@kernel
def norm(u: Vector) -> float:
    """Length of a vector."""
    return math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])


@kernel
def add_magnetic_field(
    x: FloatArray, y: FloatArray, z: FloatArray, vertices: FloatArray, starts: IntArray, weights: FloatArray,
    bx: FloatArray, by: FloatArray, bz: FloatArray, away: FloatArray,
) -> None:  # fmt: skip
    """Add the B of polylines at a block of points.

    `vertices` (m, 3) holds all polylines in sequence, polyline c being rows starts[c]:starts[c + 1]
    with the weight µ0 I/4π. `away` is scratch.
    """
    n = x.shape[0]
    for c in range(starts.shape[0] - 1):
        weight = weights[c]
        first = starts[c]
        for i in range(n):
            ux, uy, uz = x[i] - vertices[first, 0], y[i] - vertices[first, 1], z[i] - vertices[first, 2]
            away[i] = math.sqrt(ux * ux + uy * uy + uz * uz)
        for s in range(first, starts[c + 1] - 1):
            px, py, pz = vertices[s, 0], vertices[s, 1], vertices[s, 2]
            dx, dy, dz = vertices[s + 1, 0] - px, vertices[s + 1, 1] - py, vertices[s + 1, 2] - pz
            length2 = dx * dx + dy * dy + dz * dz
            on_wire2 = (ON_WIRE * length2) * (ON_WIRE * length2)
            for i in range(n):
                ux, uy, uz = x[i] - px, y[i] - py, z[i] - pz
                vx, vy, vz = ux - dx, uy - dy, uz - dz
                a = away[i]
                b = math.sqrt(vx * vx + vy * vy + vz * vz)
                away[i] = b
                ab = a * b
                dot = ux * vx + uy * vy + uz * vz
                cx, cy, cz = dy * uz - dz * uy, dz * ux - dx * uz, dx * uy - dy * ux
                c2 = cx * cx + cy * cy + cz * cz
                beside = dot < 0.0
                top = (a + b) * (ab - dot if beside else 1.0)
                bottom = ab * (c2 if beside else ab + dot)
                off = (c2 > on_wire2) | (dot > 0.0)
                factor = weight * top / (bottom if off else 1.0)
                factor = factor if off else 0.0
                bx[i] += factor * cx
                by[i] += factor * cy
                bz[i] += factor * cz


@kernel
def log_of_ratio(top: float, bottom: float, ratio: float) -> float:
    """Compute ln(top/bottom) without a branch.

    With top/bottom = 2^k m, m near one, the result is k ln 2 + 2 atanh((m − 1)/(m + 1)). For k = 0
    the argument of atanh is `ratio`, tanh of half of the result, without the rounding of m − 1.
    """
    # The difference of two floating-point numbers' bits is near the difference of their logarithms
    # to base 2, times 2^52.
    k = (np.float64(top).view(np.int64) - np.float64(bottom).view(np.int64) + (1 << 51)) >> 52
    scaled = bottom * np.int64((k + 1023) << 52).view(np.float64)
    q = ratio if k == 0 else (top - scaled) / (top + scaled)
    q2 = q * q  # at most 0.042; twelve terms of the series leave 1e-17
    series = 1.0 / 23.0
    for m in range(10, -1, -1):
        series = series * q2 + 1.0 / (2 * m + 1)
    return 2.0 * q * series + _LN_2 * k


@kernel
def add_vector_potential(
    x: FloatArray, y: FloatArray, z: FloatArray, vertices: FloatArray, starts: IntArray, weights: FloatArray,
    ax: FloatArray, ay: FloatArray, az: FloatArray, away: FloatArray,
) -> None:  # fmt: skip
    """Add the A of polylines, with the arguments of `add_magnetic_field`."""
    n = x.shape[0]
    for c in range(starts.shape[0] - 1):
        weight = weights[c]
        first = starts[c]
        for i in range(n):
            ux, uy, uz = x[i] - vertices[first, 0], y[i] - vertices[first, 1], z[i] - vertices[first, 2]
            away[i] = math.sqrt(ux * ux + uy * uy + uz * uz)
        for s in range(first, starts[c + 1] - 1):
            px, py, pz = vertices[s, 0], vertices[s, 1], vertices[s, 2]
            dx, dy, dz = vertices[s + 1, 0] - px, vertices[s + 1, 1] - py, vertices[s + 1, 2] - pz
            length2 = dx * dx + dy * dy + dz * dz
            length = math.sqrt(length2)
            on_wire2 = (ON_WIRE * length2) * (ON_WIRE * length2)
            scale = weight / length
            for i in range(n):
                ux, uy, uz = x[i] - px, y[i] - py, z[i] - pz
                vx, vy, vz = ux - dx, uy - dy, uz - dz
                a = away[i]
                b = math.sqrt(vx * vx + vy * vy + vz * vz)
                away[i] = b
                ab = a * b
                dot = ux * vx + uy * vy + uz * vz
                cx, cy, cz = dy * uz - dz * uy, dz * ux - dx * uz, dx * uy - dy * ux
                c2 = cx * cx + cy * cy + cz * cz
                beside = dot < 0.0
                off = (c2 > on_wire2) | (dot > 0.0)
                total = a + b
                ends = total + length
                # the argument of the logarithm, with (|u| + |v|)² − |d|² = 2 (|u||v| + u·v)
                top = ends * ends * (ab - dot if beside else 1.0)
                bottom = 2.0 * (c2 if beside else ab + dot)
                factor = scale * log_of_ratio(top, bottom if off else 1.0, length / total)
                factor = factor if off else 0.0
                ax[i] += factor * dx
                ay[i] += factor * dy
                az[i] += factor * dz
