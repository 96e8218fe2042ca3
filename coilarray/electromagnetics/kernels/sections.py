"""Cross-sections of parallel traces.

The module has mean logarithms of cell pairs, and the unit-current fields on every segment. The mutual inductance per
length of two infinitely long parallel bars is −µ0/2π times the mean of ln r over both cross-sections. In closed form
this is the fourth difference of a fourth antiderivative of ln r (twice in x, twice in z; the two-dimensional limit of
Hoer & Love, J. Res. NBS 69C, 127, 1965),

    F(x, z) = −[(x⁴ − 6x²z² + z⁴)/2 · ln(x² + z²) − 4x³z·atan(z/x) − 4xz³·atan(x/z)]/24,

with 25/12 to subtract. The differences cancel as (distance/size)⁴. Cells further apart than `NEAR` sizes therefore take
the expansion of Re ln ζ, ζ = x + iz, in the moments of the cells. The first moment left out is the sixth.
"""

from __future__ import annotations

import math

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.electromagnetics.kernels.compiled import kernel
from coilarray.electromagnetics.kernels.segments import log_of_ratio

NEAR = 6.0  # sides of the larger cell up to which the closed form is used


@kernel
def _antiderivative(x: float, z: float) -> float:
    """Return −24 F of the module's text, even in x and z."""
    x, z = abs(x), abs(z)
    x2, z2 = x * x, z * z
    r2 = x2 + z2
    if r2 == 0.0:
        return 0.0
    angle = math.atan2(z, x)
    quartic = 0.5 * (x2 * x2 - 6.0 * x2 * z2 + z2 * z2) * math.log(r2)
    return quartic - 4.0 * x * z * (x2 * angle + z2 * (0.5 * math.pi - angle))


@kernel
def _moments(w1: float, t1: float, w2: float, t2: float) -> tuple[float, float]:
    """Moments of the offset between points of two cells.

    They are the difference of the variances, halved, and the fourth cumulants, divided by four.
    """
    a1, a2, b1, b2 = w1 * w1, w2 * w2, t1 * t1, t2 * t2
    sx, sz = (a1 + a2) / 12.0, (b1 + b2) / 12.0
    fourth = (a1 * a1 + a2 * a2 + b1 * b1 + b2 * b2) / 80.0 + (a1 * a2 + b1 * b2) / 24.0 - 6.0 * sx * sz
    return 0.5 * (sx - sz), 0.25 * fourth


@kernel
def _far_mean_log(x: float, z: float, spread: float, fourth: float) -> float:
    """Mean of ln r between distant cells (x, z) apart by `_moments`.

    Without a branch, many are computed at once.
    """
    r2 = x * x + z * z
    inverse = 1.0 / r2
    cosine, sine = (x * x - z * z) * inverse, 2.0 * x * z * inverse
    logarithm = log_of_ratio(r2, 1.0, (r2 - 1.0) / (r2 + 1.0))
    return 0.5 * logarithm - spread * cosine * inverse - fourth * (cosine * cosine - sine * sine) * (inverse * inverse)


@kernel
def _near_mean_log(x: float, z: float, w1: float, t1: float, w2: float, t2: float) -> float:
    """Mean of ln r between cells w1 × t1 and w2 × t2 in closed form."""
    total = 0.0
    for i in range(4):
        xi = x + (0.5 * w1 if i & 1 else -0.5 * w1) + (0.5 * w2 if i & 2 else -0.5 * w2)
        sign_x = 1.0 if (i & 1) == (i >> 1) else -1.0
        for k in range(4):
            zk = z + (0.5 * t1 if k & 1 else -0.5 * t1) + (0.5 * t2 if k & 2 else -0.5 * t2)
            sign_z = 1.0 if (k & 1) == (k >> 1) else -1.0
            total += sign_x * sign_z * _antiderivative(xi, zk)
    return -total / (24.0 * w1 * t1 * w2 * t2) - 25.0 / 12.0


@kernel
def pair_logs(first: FloatArray, second: FloatArray, x: float, z: float, out: FloatArray) -> None:
    """Mean of ln r between the cells of two traces (x, z) apart.

    `first` (n, 4) holds x, z, width, thickness of each cell about its trace's centre. `second` (4, m) holds the same
    for the other trace, one per row, so that the processor takes several at once. `out` has shape (n, m).
    """
    xs, zs, ws, ts = second[0], second[1], second[2], second[3]
    for i in range(first.shape[0]):
        dx, dz, w, t = x - first[i, 0], z - first[i, 1], first[i, 2], first[i, 3]
        for k in range(xs.shape[0]):
            spread, fourth = _moments(w, t, ws[k], ts[k])
            out[i, k] = _far_mean_log(dx + xs[k], dz + zs[k], spread, fourth)
        for k in range(xs.shape[0]):
            near = NEAR * max(w, t, ws[k], ts[k])
            if (dx + xs[k]) ** 2 + (dz + zs[k]) ** 2 <= near * near:
                out[i, k] = _near_mean_log(dx + xs[k], dz + zs[k], w, t, ws[k], ts[k])


@kernel
def transverse_fields(
    points: FloatArray, own: IntArray, lateral: FloatArray, normal: FloatArray, vertices: FloatArray, starts: IntArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Field H of unit current in every polyline along two axes, in 1/m.

    `points` on segments, `lateral` and `normal` have shape (n, 3). `own` (n,) is the row of `vertices` where the
    point's own segment begins, which adds nothing. `vertices` (m, 3) holds all polylines, polyline c being rows
    starts[c]:starts[c + 1]. `out` (n, polylines, 2) receives H·lateral and H·normal. The formula is from
    `kernels.segments`.
    """
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for c in range(starts.shape[0] - 1):
            hx, hy, hz = 0.0, 0.0, 0.0
            vx, vy, vz = x - vertices[starts[c], 0], y - vertices[starts[c], 1], z - vertices[starts[c], 2]
            b = math.sqrt(vx * vx + vy * vy + vz * vz)
            for s in range(starts[c], starts[c + 1] - 1):
                ux, uy, uz, a = vx, vy, vz, b
                vx, vy, vz = x - vertices[s + 1, 0], y - vertices[s + 1, 1], z - vertices[s + 1, 2]
                b = math.sqrt(vx * vx + vy * vy + vz * vz)
                if s == own[i]:
                    continue
                dot = ux * vx + uy * vy + uz * vz
                cx, cy, cz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx  # u × v = d × u
                if dot < 0.0:
                    c2 = cx * cx + cy * cy + cz * cz
                    if c2 == 0.0:
                        continue
                    factor = (a + b) * (a * b - dot) / (a * b * c2)
                else:
                    factor = (a + b) / (a * b * (a * b + dot))
                hx += factor * cx
                hy += factor * cy
                hz += factor * cz
            scale = 1.0 / (4.0 * math.pi)
            out[i, c, 0] = scale * (hx * lateral[i, 0] + hy * lateral[i, 1] + hz * lateral[i, 2])
            out[i, c, 1] = scale * (hx * normal[i, 0] + hy * normal[i, 1] + hz * normal[i, 2])
