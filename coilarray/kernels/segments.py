"""Exact field of straight current segments: B and A of polylines.

With u = X − P0, v = X − P1 and d = P1 − P0 = u − v,

    B = µ0 I/4π · (|u| + |v|) / (|u||v| (|u||v| + u·v)) · d × u        (Hanson & Hirshman, Phys. Plasmas 9, 4410, 2002)
    A = µ0 I/4π · d/|d| · ln((|u| + |v| + |d|) / (|u| + |v| − |d|))

Where u·v < 0 (beside the segment) |u||v| + u·v cancels; there it equals |d × u|²/(|u||v| − u·v), which does not.
Neighbours in a polyline share a vertex and so a square root.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from coilarray.kernels.compiled import kernel

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

ON_WIRE = 1e-12
"""A point nearer to a segment than this fraction of its length counts as on it; the segment then adds nothing."""


@kernel
def add_magnetic_field(
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    vertices: FloatArray,
    starts: IntArray,
    weights: FloatArray,
    bx: FloatArray,
    by: FloatArray,
    bz: FloatArray,
    norm: FloatArray,
) -> None:
    """Add the B of polylines at a block of points.

    `x`, `y`, `z`, `bx`, `by`, `bz`, `norm` have shape (n,); `vertices` (m, 3) holds all polylines one after the
    other, polyline c being rows starts[c]:starts[c + 1] with the weight µ0 I/4π in `weights`; `norm` is scratch.
    """
    n = x.shape[0]
    for c in range(starts.shape[0] - 1):
        weight = weights[c]
        first = starts[c]
        for i in range(n):
            ux = x[i] - vertices[first, 0]
            uy = y[i] - vertices[first, 1]
            uz = z[i] - vertices[first, 2]
            norm[i] = math.sqrt(ux * ux + uy * uy + uz * uz)
        for s in range(first, starts[c + 1] - 1):
            px, py, pz = vertices[s, 0], vertices[s, 1], vertices[s, 2]
            dx, dy, dz = vertices[s + 1, 0] - px, vertices[s + 1, 1] - py, vertices[s + 1, 2] - pz
            length2 = dx * dx + dy * dy + dz * dz
            on_wire2 = (ON_WIRE * length2) * (ON_WIRE * length2)
            for i in range(n):
                ux = x[i] - px
                uy = y[i] - py
                uz = z[i] - pz
                vx = ux - dx
                vy = uy - dy
                vz = uz - dz
                a = norm[i]
                b = math.sqrt(vx * vx + vy * vy + vz * vz)
                norm[i] = b
                ab = a * b
                dot = ux * vx + uy * vy + uz * vz
                cx = dy * uz - dz * uy
                cy = dz * ux - dx * uz
                cz = dx * uy - dy * ux
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
def add_vector_potential(
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    vertices: FloatArray,
    starts: IntArray,
    weights: FloatArray,
    ax: FloatArray,
    ay: FloatArray,
    az: FloatArray,
    norm: FloatArray,
) -> None:
    """Add the A of polylines at a block of points; arguments as in `add_magnetic_field`.

    Far away the logarithm is a series in q = |d|/(|u| + |v|), ln((1 + q)/(1 − q)) = 2 (q + q³/3 + …), which keeps
    its relative accuracy where the logarithm's argument tends to one.
    """
    n = x.shape[0]
    for c in range(starts.shape[0] - 1):
        weight = weights[c]
        first = starts[c]
        for i in range(n):
            ux = x[i] - vertices[first, 0]
            uy = y[i] - vertices[first, 1]
            uz = z[i] - vertices[first, 2]
            norm[i] = math.sqrt(ux * ux + uy * uy + uz * uz)
        for s in range(first, starts[c + 1] - 1):
            px, py, pz = vertices[s, 0], vertices[s, 1], vertices[s, 2]
            dx, dy, dz = vertices[s + 1, 0] - px, vertices[s + 1, 1] - py, vertices[s + 1, 2] - pz
            length2 = dx * dx + dy * dy + dz * dz
            length = math.sqrt(length2)
            on_wire2 = (ON_WIRE * length2) * (ON_WIRE * length2)
            scale = weight / length
            for i in range(n):
                ux = x[i] - px
                uy = y[i] - py
                uz = z[i] - pz
                vx = ux - dx
                vy = uy - dy
                vz = uz - dz
                a = norm[i]
                b = math.sqrt(vx * vx + vy * vy + vz * vz)
                norm[i] = b
                total = a + b
                if total > 5.0 * length:
                    q = length / total
                    q2 = q * q
                    series = 1.0 / 21.0
                    for k in range(9, -1, -1):
                        series = series * q2 + 1.0 / (2 * k + 1)
                    log = 2.0 * q * series
                else:
                    dot = ux * vx + uy * vy + uz * vz
                    cx = dy * uz - dz * uy
                    cy = dz * ux - dx * uz
                    cz = dx * uy - dy * ux
                    c2 = cx * cx + cy * cy + cz * cz
                    if c2 <= on_wire2 and dot <= 0.0:
                        continue
                    gap = c2 / (a * b - dot) if dot < 0.0 else a * b + dot  # ((|u| + |v|)² − |d|²)/2
                    log = math.log((total + length) * (total + length) / (2.0 * gap))
                factor = scale * log
                ax[i] += factor * dx
                ay[i] += factor * dy
                az[i] += factor * dz
