"""Neumann's double integral ∬ dl·dl'/R of filaments and parallel bars.

Mutual inductance is µ0/4π times these numbers, which are in metres. The skew form of filaments is
Campbell's (Phys. Rev. 5, 452, 1915) as in Grover, Inductance Calculations (1946), ch. 7, with the
logarithms written by distances to the ends.

For parallel bars of uniform current density the closed form of Hoer & Love (J. Res. NBS 69C, 127,
1965) loses (length/width)⁴ digits in float64. Here nothing cancels: the filament formula is
averaged over both cross-sections, an integral over the lateral offset (x, y) with a weight that is
piecewise linear in each, cell by cell. Next to the logarithmic singularity at zero offset polar
coordinates make the integrand smooth.
"""

from __future__ import annotations

import math

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.electromagnetics.kernels import kernel
from coilarray.electromagnetics.kernels.segments import log_of_ratio

Point = tuple[float, float, float]

PARALLEL_SIN2 = 1e-9  # sin² of the angle below which the panel rule replaces the skew form, which errs like 1e-17/sin²
COLLINEAR = 1e-13  # of the lengths: distance of parallel lines that count as one
_NEAR = 1e-3  # of the distances to the ends; nearer, r1 + r2 − length would lose more than three digits
_ON_LINE = 1e-32  # of the distances to the ends; least r1 + r2 − length, so that its logarithm is finite

_GAUSS_12 = np.polynomial.legendre.leggauss(12)
_NODES, _WEIGHTS = np.ascontiguousarray(_GAUSS_12[0]), np.ascontiguousarray(_GAUSS_12[1])
_GAUSS_16 = np.polynomial.legendre.leggauss(16)
_NODES_16, _WEIGHTS_16 = np.ascontiguousarray(_GAUSS_16[0]), np.ascontiguousarray(_GAUSS_16[1])


@kernel
def _second_integral(z: float, rho2: float) -> float:
    """Second antiderivative z asinh(z/ρ) − √(z² + ρ²) of 1/√(z² + ρ²), for z ≥ 0, ρ > 0."""
    r = math.sqrt(z * z + rho2)
    return 0.5 * z * log_of_ratio((r + z) * (r + z), rho2, z / r) - r


@kernel
def _second_integral_on_the_line(z: float) -> float:
    """Second antiderivative for ρ → 0 without the cancelling terms."""
    return abs(z) * math.log(abs(z)) - abs(z) if z != 0.0 else 0.0


@kernel
def parallel_filaments(rho: float, offset: float, length_1: float, length_2: float) -> float:
    """Integral ∬ dz dz'/R over [0, length_1] and `offset` + [0, length_2], `rho` apart."""
    z0, z1, z2, z3 = offset + length_2, offset, offset + length_2 - length_1, offset - length_1
    if rho == 0.0:
        return (
            _second_integral_on_the_line(z0) - _second_integral_on_the_line(z1)
            - _second_integral_on_the_line(z2) + _second_integral_on_the_line(z3)
        )  # fmt: skip
    rho2 = rho * rho
    return (
        _second_integral(abs(z0), rho2) - _second_integral(abs(z1), rho2)
        - _second_integral(abs(z2), rho2) + _second_integral(abs(z3), rho2)
    )  # fmt: skip


@kernel
def _is_near(r1: float, r2: float, length: float) -> bool:
    """Check whether `_line_potential` would lose digits at r1, r2 from the ends."""
    return r1 + r2 - length < _NEAR * (r1 + r2)


@kernel
def _line_potential(r1: float, r2: float, length: float) -> float:
    """Potential ∫ dl/R of a segment at r1 and r2 from its ends."""
    total = r1 + r2
    return log_of_ratio(total + length, total - length, length / total)


@kernel
def _near_potential(x: float, y: float, z: float, ux: float, uy: float, uz: float, length: float) -> float:
    """Potential ∫ dl/R of a segment at a point near or on it.

    With ρ from the line and a, b along it from the ends, r1 + r2 − length = (r1 − a) + (r2 − b) is
    a sum of positive parts ρ²/(r + a) for a > 0, so nothing cancels.
    """
    cx, cy, cz = uy * z - uz * y, uz * x - ux * z, ux * y - uy * x
    rho2 = cx * cx + cy * cy + cz * cz
    a = ux * x + uy * y + uz * z
    b = length - a
    r1, r2 = math.sqrt(a * a + rho2), math.sqrt(b * b + rho2)
    gap = (rho2 / (r1 + a) if a > 0.0 else r1 - a) + (rho2 / (r2 + b) if b > 0.0 else r2 - b)
    total = r1 + r2
    smallest = _ON_LINE * total  # where this is infinite, it is multiplied by a zero length
    return log_of_ratio(total + length, gap if gap > smallest else smallest, length / total)


@kernel
def _distance(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> float:
    return math.sqrt((ax - bx) * (ax - bx) + (ay - by) * (ay - by) + (az - bz) * (az - bz))


@kernel
def _graded(
    p0: Point, u: Point, length_1: float, q0: Point, v: Point, start: float, end: float, finest: float
) -> float:
    """Integrate a filament's potential along q0 + t v from `start` to `end`.

    The panels halve towards `start`, the last at most `finest` long.
    """
    total = 0.0
    far = end
    while far != start:
        near = start + 0.5 * (far - start)
        if abs(near - start) < finest:
            near = start
        half, middle = 0.5 * (far - near), 0.5 * (far + near)
        for g in range(_NODES.shape[0]):
            t = middle + half * _NODES[g]
            x, y, z = q0[0] - p0[0] + t * v[0], q0[1] - p0[1] + t * v[1], q0[2] - p0[2] + t * v[2]
            r1 = math.sqrt(x * x + y * y + z * z)
            r2 = _distance(x, y, z, length_1 * u[0], length_1 * u[1], length_1 * u[2])
            value = (
                _near_potential(x, y, z, u[0], u[1], u[2], length_1)
                if _is_near(r1, r2, length_1)
                else _line_potential(r1, r2, length_1)
            )
            total += abs(half) * _WEIGHTS[g] * value
        far = near
    return total


@kernel
def _panels(p0: Point, u: Point, length_1: float, q0: Point, v: Point, length_2: float) -> float:
    """Neumann's integral ∬ dl dl'/R of nearly parallel filaments.

    Closed inner integral, and a Gauss rule on panels that halve towards the places where the outer
    point passes an end of the inner filament, and where the lines cross.
    """
    dx, dy, dz = q0[0] - p0[0], q0[1] - p0[1], q0[2] - p0[2]
    at_0 = -(dx * v[0] + dy * v[1] + dz * v[2])
    at_1 = at_0 + length_1 * (u[0] * v[0] + u[1] * v[1] + u[2] * v[2])
    # across the first line: from it to the start of the second, and the drift of the second
    offset, cosine = dx * u[0] + dy * u[1] + dz * u[2], u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
    ex, ey, ez = dx - offset * u[0], dy - offset * u[1], dz - offset * u[2]
    wx, wy, wz = v[0] - cosine * u[0], v[1] - cosine * u[1], v[2] - cosine * u[2]
    w2 = wx * wx + wy * wy + wz * wz
    crossing = -(ex * wx + ey * wy + ez * wz) / w2 if w2 > 0.0 else 0.0
    low, high = min(max(min(at_0, at_1), 0.0), length_2), min(max(at_0, at_1, 0.0), length_2)
    crossing = min(max(crossing, 0.0), length_2)
    places = (0.0, min(low, crossing), max(low, min(high, crossing)), max(high, crossing), length_2)
    total = 0.0
    # The distance to the line is least at the crossing. Nothing varies faster than on its scale.
    rx, ry, rz = ex + crossing * wx, ey + crossing * wy, ez + crossing * wz
    finest = max(math.sqrt(rx * rx + ry * ry + rz * rz), 1e-15 * length_2)
    for k in range(4):
        start, end = places[k], places[k + 1]
        between = start if k == 0 else end if k == 3 else 0.5 * (start + end)
        total += _graded(p0, u, length_1, q0, v, start, between, finest)
        total += _graded(p0, u, length_1, q0, v, end, between, finest)
    return total


@kernel
def _angle_between(x1: float, y1: float, x2: float, y2: float) -> float:
    """Angle atan2(y1, x1) − atan2(y2, x2) below π, for x1, x2 > 0."""
    return math.atan2(y1 * x2 - y2 * x1, x1 * x2 + y1 * y2)


@kernel
def filament_pair(
    p0x: float, p0y: float, p0z: float, ux: float, uy: float, uz: float, length_1: float,
    q0x: float, q0y: float, q0z: float, vx: float, vy: float, vz: float, length_2: float,
) -> float:  # fmt: skip
    """Neumann's integral of p0 + s u and q0 + t v, inf if they overlap."""
    cosine = ux * vx + uy * vy + uz * vz
    wx = uy * vz - uz * vy
    wy = uz * vx - ux * vz
    wz = ux * vy - uy * vx
    sine2 = wx * wx + wy * wy + wz * wz
    dx, dy, dz = q0x - p0x, q0y - p0y, q0z - p0z
    if sine2 < PARALLEL_SIN2:
        return _nearly_parallel(p0x, p0y, p0z, ux, uy, uz, length_1, q0x, q0y, q0z, vx, vy, vz, length_2, cosine, sine2)
    # feet of the common perpendicular, measured along u from p0 and along v from q0
    cx = dy * vz - dz * vy
    cy = dz * vx - dx * vz
    cz = dx * vy - dy * vx
    foot_1 = (cx * wx + cy * wy + cz * wz) / sine2
    cx = dy * uz - dz * uy
    cy = dz * ux - dx * uz
    cz = dx * uy - dy * ux
    foot_2 = (cx * wx + cy * wy + cz * wz) / sine2
    sine = math.sqrt(sine2)
    height = abs(dx * wx + dy * wy + dz * wz) / sine
    a1, a2 = -foot_1, length_1 - foot_1
    b1, b2 = -foot_2, length_2 - foot_2
    p1x, p1y, p1z = p0x + length_1 * ux, p0y + length_1 * uy, p0z + length_1 * uz
    q1x, q1y, q1z = q0x + length_2 * vx, q0y + length_2 * vy, q0z + length_2 * vz
    r11 = _distance(p0x, p0y, p0z, q0x, q0y, q0z)
    r12 = _distance(p0x, p0y, p0z, q1x, q1y, q1z)
    r21 = _distance(p1x, p1y, p1z, q0x, q0y, q0z)
    r22 = _distance(p1x, p1y, p1z, q1x, q1y, q1z)
    if (
        _is_near(r21, r22, length_2) or _is_near(r11, r12, length_2)
        or _is_near(r12, r22, length_1) or _is_near(r11, r21, length_1)
    ):  # fmt: skip
        total = (
            a2 * _near_potential(p1x - q0x, p1y - q0y, p1z - q0z, vx, vy, vz, length_2)
            - a1 * _near_potential(p0x - q0x, p0y - q0y, p0z - q0z, vx, vy, vz, length_2)
            + b2 * _near_potential(q1x - p0x, q1y - p0y, q1z - p0z, ux, uy, uz, length_1)
            - b1 * _near_potential(q0x - p0x, q0y - p0y, q0z - p0z, ux, uy, uz, length_1)
        )
    else:
        total = (
            a2 * _line_potential(r21, r22, length_2) - a1 * _line_potential(r11, r12, length_2)
            + b2 * _line_potential(r12, r22, length_1) - b1 * _line_potential(r11, r21, length_1)
        )  # fmt: skip
    if height > COLLINEAR * (length_1 + length_2):
        h2c = height * height * cosine
        hs = height * sine
        angle = _angle_between(hs * r22, h2c + a2 * b2 * sine2, hs * r21, h2c + a2 * b1 * sine2) - _angle_between(
            hs * r12, h2c + a1 * b2 * sine2, hs * r11, h2c + a1 * b1 * sine2
        )
        total -= height / sine * angle
    return cosine * total


@kernel
def _nearly_parallel(
    p0x: float, p0y: float, p0z: float, ux: float, uy: float, uz: float, length_1: float,
    q0x: float, q0y: float, q0z: float, vx: float, vy: float, vz: float, length_2: float,
    cosine: float, sine2: float,
) -> float:  # fmt: skip
    """Neumann's integral of parallel or nearly parallel filaments."""
    sign = 1.0
    if cosine < 0.0:  # turn the second filament round
        q0x, q0y, q0z = q0x + length_2 * vx, q0y + length_2 * vy, q0z + length_2 * vz
        vx, vy, vz = -vx, -vy, -vz
        sign = -1.0
    dx, dy, dz = q0x - p0x, q0y - p0y, q0z - p0z
    offset = dx * ux + dy * uy + dz * uz
    ex, ey, ez = dx - offset * ux, dy - offset * uy, dz - offset * uz
    rho = math.sqrt(ex * ex + ey * ey + ez * ez)
    extent = length_1 + length_2
    one_line = COLLINEAR * extent
    along = length_2 * abs(cosine)
    ex, ey, ez = ex + length_2 * vx - along * ux, ey + length_2 * vy - along * uy, ez + length_2 * vz - along * uz
    if max(rho, math.sqrt(ex * ex + ey * ey + ez * ez)) < one_line:  # at both ends of the second filament
        overlap = min(length_1, offset + length_2) - max(0.0, offset)
        if overlap > one_line:
            return sign * math.inf
        return sign * parallel_filaments(0.0, offset, length_1, length_2)
    if sine2 * extent * extent < COLLINEAR * COLLINEAR * rho * rho:
        return sign * parallel_filaments(rho, offset, length_1, length_2)
    return (
        sign * abs(cosine) * _panels((p0x, p0y, p0z), (ux, uy, uz), length_1, (q0x, q0y, q0z), (vx, vy, vz), length_2)
    )


@kernel
def filament_pair_far(
    p0x: float, p0y: float, p0z: float, ux: float, uy: float, uz: float, length_1: float,
    q0x: float, q0y: float, q0z: float, vx: float, vy: float, vz: float, length_2: float,
    nodes: FloatArray, weights: FloatArray,
) -> float:  # fmt: skip
    """Compute `filament_pair` by Gauss rules, at distances above both lengths."""
    cosine = ux * vx + uy * vy + uz * vz
    h1, h2 = 0.5 * length_1, 0.5 * length_2
    dx = q0x + h2 * vx - p0x - h1 * ux
    dy = q0y + h2 * vy - p0y - h1 * uy
    dz = q0z + h2 * vz - p0z - h1 * uz
    total = 0.0
    for i in range(nodes.shape[0]):
        s = h1 * nodes[i]
        ex, ey, ez = dx - s * ux, dy - s * uy, dz - s * uz
        inner = 0.0
        for j in range(nodes.shape[0]):
            t = h2 * nodes[j]
            rx, ry, rz = ex + t * vx, ey + t * vy, ez + t * vz
            inner += weights[j] / math.sqrt(rx * rx + ry * ry + rz * rz)
        total += weights[i] * inner
    return cosine * h1 * h2 * total


@kernel
def _corner_cell(
    x_end: float, y_end: float, ax: float, bx: float, ay: float, by: float,
    offset: float, length_1: float, length_2: float,
) -> float:  # fmt: skip
    """Integrate (ax + bx x)(ay + by y) K from the origin to (x_end, y_end).

    K is the filament integral at √(x² + y²). Each of two triangles in polar coordinates has the
    variable dθ/cos θ, and r = R τ³ makes r ln r smooth.
    """
    if x_end == 0.0 or y_end == 0.0:
        return 0.0
    total = 0.0
    width, height = abs(x_end), abs(y_end)
    for side in range(2):
        along = width if side == 0 else height  # the triangle's side on an axis
        across = height if side == 0 else width
        # u = asinh(tan θ), with θ measured from that axis; tan θ runs to across/along
        u_end = math.asinh(across / along)
        for i in range(_NODES_16.shape[0]):
            u = 0.5 * u_end * (1.0 + _NODES_16[i])
            tangent = math.sinh(u)
            secant = math.sqrt(1.0 + tangent * tangent)
            radius = along * secant
            cos_axis, sin_axis = 1.0 / secant, tangent / secant
            angle_weight = 0.5 * u_end * _WEIGHTS_16[i] / secant  # dθ = du / cosh u
            c = cos_axis if side == 0 else sin_axis
            s = sin_axis if side == 0 else cos_axis
            inner = 0.0
            for j in range(_NODES_16.shape[0]):
                tau = 0.5 * (1.0 + _NODES_16[j])
                r = radius * tau * tau * tau
                x = math.copysign(r * c, x_end)
                y = math.copysign(r * s, y_end)
                density = (ax + bx * x) * (ay + by * y)
                inner += (
                    0.5 * _WEIGHTS_16[j] * 3.0 * tau * tau * radius * r * density
                    * parallel_filaments(r, offset, length_1, length_2)
                )  # fmt: skip
            total += angle_weight * inner
    return math.copysign(1.0, x_end) * math.copysign(1.0, y_end) * total


@kernel
def _cell(
    x0: float, x1: float, y0: float, y1: float, ax: float, bx: float, ay: float, by: float,
    offset: float, length_1: float, length_2: float,
) -> float:  # fmt: skip
    """Integrate (ax + bx x)(ay + by y) K over [x0, x1] × [y0, y1]."""
    near_x = max(0.0, x0, -x1)
    near_y = max(0.0, y0, -y1)
    if math.hypot(near_x, near_y) < 0.75 * max(x1 - x0, y1 - y0):
        return (
            _corner_cell(x1, y1, ax, bx, ay, by, offset, length_1, length_2)
            - _corner_cell(x0, y1, ax, bx, ay, by, offset, length_1, length_2)
            - _corner_cell(x1, y0, ax, bx, ay, by, offset, length_1, length_2)
            + _corner_cell(x0, y0, ax, bx, ay, by, offset, length_1, length_2)
        )
    total = 0.0
    for i in range(_NODES_16.shape[0]):
        x = 0.5 * (x0 + x1) + 0.5 * (x1 - x0) * _NODES_16[i]
        for j in range(_NODES_16.shape[0]):
            y = 0.5 * (y0 + y1) + 0.5 * (y1 - y0) * _NODES_16[j]
            total += (
                _WEIGHTS_16[i] * _WEIGHTS_16[j] * (ax + bx * x) * (ay + by * y)
                * parallel_filaments(math.hypot(x, y), offset, length_1, length_2)
            )  # fmt: skip
    return 0.25 * (x1 - x0) * (y1 - y0) * total


@kernel
def _offset_density(
    start_1: float, size_1: float, start_2: float, size_2: float, edges: FloatArray, lines: FloatArray
) -> None:
    """Density of x2 − x1 for variables uniform on intervals: 4 edges and 3 lines a + b x."""
    d = start_2 - start_1
    small, large = min(size_1, size_2), max(size_1, size_2)
    edges[0] = d - size_1
    edges[1] = edges[0] + small
    edges[3] = d + size_2
    edges[2] = edges[3] - small
    slope = 1.0 / (small * large)
    lines[0, 0], lines[0, 1] = -slope * edges[0], slope
    lines[1, 0], lines[1, 1] = 1.0 / large, 0.0
    lines[2, 0], lines[2, 1] = slope * edges[3], -slope


@kernel
def parallel_bars(
    length_1: float, width_1: float, thickness_1: float,
    length_2: float, width_2: float, thickness_2: float,
    dx: float, dy: float, dz: float,
) -> float:  # fmt: skip
    """Mean of ∬ dz dz'/R over two bars, the second at (dx, dy, dz)."""
    x_edges, x_lines = np.empty(4), np.empty((3, 2))
    y_edges, y_lines = np.empty(4), np.empty((3, 2))
    _offset_density(0.0, width_1, dx, width_2, x_edges, x_lines)
    _offset_density(0.0, thickness_1, dy, thickness_2, y_edges, y_lines)
    total = 0.0
    for i in range(3):
        # A cell that straddles zero is cut there.
        for x_part in range(2):
            x0 = x_edges[i] if x_part == 0 else max(x_edges[i], 0.0)
            x1 = min(x_edges[i + 1], 0.0) if x_part == 0 else x_edges[i + 1]
            if x1 <= x0:
                continue
            for j in range(3):
                for y_part in range(2):
                    y0 = y_edges[j] if y_part == 0 else max(y_edges[j], 0.0)
                    y1 = min(y_edges[j + 1], 0.0) if y_part == 0 else y_edges[j + 1]
                    if y1 <= y0:
                        continue
                    total += _cell(
                        x0, x1, y0, y1, x_lines[i, 0], x_lines[i, 1], y_lines[j, 0], y_lines[j, 1],
                        dz, length_1, length_2,
                    )  # fmt: skip
    return total


@kernel
def bar_self(length: float, width: float, thickness: float) -> float:
    """Mean of ∬ dz dz'/R of one bar with itself."""
    # The density is even in x and y, so four times one quadrant suffices.
    return 4.0 * _corner_cell(
        width, thickness, 1.0 / width, -1.0 / (width * width), 1.0 / thickness, -1.0 / (thickness * thickness),
        0.0, length, length,
    )  # fmt: skip
