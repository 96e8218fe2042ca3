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
from coilarray.electromagnetics.kernels.segments import Vector, cross, dot, log_of_ratio, moved, norm

Line = tuple[float, float]  # a and b of a density a + b x
PARALLEL_SIN2 = 1e-9  # sin² of the angle below which the panel rule replaces the skew form, which errs like 1e-17/sin²
COLLINEAR = 1e-13  # of the lengths: distance of parallel lines that count as one
_NEAR = 1e-3  # of the distances to the ends; nearer, r1 + r2 − length would lose more than three digits
_ON_LINE = 1e-32  # of the distances to the ends; least r1 + r2 − length, so that its logarithm is finite

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_NODES_16, _WEIGHTS_16 = np.polynomial.legendre.leggauss(16)


@kernel
def _second_integral(z: float, rho2: float) -> float:
    """Second antiderivative z asinh(z/ρ) − √(z² + ρ²) of 1/√(z² + ρ²), for z ≥ 0, ρ > 0."""
    r = math.sqrt(z * z + rho2)
    return 0.5 * z * log_of_ratio((r + z) * (r + z), rho2, z / r) - r


@kernel
def _on_the_line(z: float) -> float:
    """Second antiderivative for ρ → 0 without the cancelling terms."""
    return z * math.log(z) - z if z != 0.0 else 0.0


@kernel
def parallel_filaments(rho: float, offset: float, length_1: float, length_2: float) -> float:
    """Integral ∬ dz dz'/R over [0, length_1] and `offset` + [0, length_2], `rho` apart."""
    z0, z1, z2, z3 = abs(offset + length_2), abs(offset), abs(offset + length_2 - length_1), abs(offset - length_1)
    if rho == 0.0:
        return _on_the_line(z0) - _on_the_line(z1) - _on_the_line(z2) + _on_the_line(z3)
    rho2 = rho * rho
    first, second = _second_integral(z0, rho2) - _second_integral(z1, rho2), _second_integral(z2, rho2)
    return first - second + _second_integral(z3, rho2)


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
def _near_potential(at: Vector, u: Vector, length: float) -> float:
    """Potential ∫ dl/R of a segment at a point near or on it.

    With ρ from the line and a, b along it from the ends, r1 + r2 − length = (r1 − a) + (r2 − b) is
    a sum of positive parts ρ²/(r + a) for a > 0, so nothing cancels.
    """
    across = cross(u, at)
    rho2 = dot(across, across)
    a = dot(u, at)
    b = length - a
    r1, r2 = math.sqrt(a * a + rho2), math.sqrt(b * b + rho2)
    gap = (rho2 / (r1 + a) if a > 0.0 else r1 - a) + (rho2 / (r2 + b) if b > 0.0 else r2 - b)
    total = r1 + r2
    smallest = _ON_LINE * total  # where this is infinite, it is multiplied by a zero length
    return log_of_ratio(total + length, gap if gap > smallest else smallest, length / total)


@kernel
def _graded(u: Vector, length_1: float, q0: Vector, v: Vector, start: float, end: float, finest: float) -> float:
    """Integrate a potential along q0 + t v, in panels that halve from `end` towards `start`."""
    total = 0.0
    far = end
    while far != start:
        near = start + 0.5 * (far - start)
        if abs(near - start) < finest:
            near = start
        half, middle = 0.5 * (far - near), 0.5 * (far + near)
        for g in range(_NODES.shape[0]):
            at = moved(q0, middle + half * _NODES[g], v)
            r1, r2 = norm(at), norm(moved(at, -length_1, u))
            value = (
                _near_potential(at, u, length_1) if _is_near(r1, r2, length_1) else _line_potential(r1, r2, length_1)
            )
            total += abs(half) * _WEIGHTS[g] * value
        far = near
    return total


@kernel
def _panels(u: Vector, length_1: float, q0: Vector, v: Vector, length_2: float) -> float:
    """Neumann's integral ∬ dl dl'/R of nearly parallel filaments, the first from the origin.

    Closed inner integral, and a Gauss rule on panels that halve towards the places where the outer
    point passes an end of the inner filament, and where the lines cross.
    """
    cosine = dot(u, v)
    at_0 = -dot(q0, v)
    at_1 = at_0 + length_1 * cosine
    # across the first line: from it to the start of the second, and the drift of the second
    apart, drift = moved(q0, -dot(q0, u), u), moved(v, -cosine, u)
    drift2 = dot(drift, drift)
    crossing = -dot(apart, drift) / drift2 if drift2 > 0.0 else 0.0
    low, high = min(max(min(at_0, at_1), 0.0), length_2), min(max(at_0, at_1, 0.0), length_2)
    crossing = min(max(crossing, 0.0), length_2)
    places = (0.0, min(low, crossing), max(low, min(high, crossing)), max(high, crossing), length_2)
    total = 0.0
    # The distance to the line is least at the crossing. Nothing varies faster than on its scale.
    finest = max(norm(moved(apart, crossing, drift)), 1e-15 * length_2)
    for k in range(4):
        start, end = places[k], places[k + 1]
        between = start if k == 0 else end if k == 3 else 0.5 * (start + end)
        total += _graded(u, length_1, q0, v, start, between, finest)
        total += _graded(u, length_1, q0, v, end, between, finest)
    return total


@kernel
def _angle_between(x1: float, y1: float, x2: float, y2: float) -> float:
    """Angle atan2(y1, x1) − atan2(y2, x2) below π, for x1, x2 > 0."""
    return math.atan2(y1 * x2 - y2 * x1, x1 * x2 + y1 * y2)


@kernel
def filament_pair(u: Vector, length_1: float, q: Vector, v: Vector, length_2: float) -> float:
    """Neumann's integral of the filaments s u and q + t v, inf if they overlap."""
    cosine = dot(u, v)
    w = cross(u, v)
    sine2 = dot(w, w)
    if sine2 < PARALLEL_SIN2:
        return _nearly_parallel(u, length_1, q, v, length_2, cosine, sine2)
    # from the feet of the common perpendicular to the ends, along u and along v
    a1, b1 = -dot(cross(q, v), w) / sine2, -dot(cross(q, u), w) / sine2
    a2, b2 = length_1 + a1, length_2 + b1
    sine = math.sqrt(sine2)
    height = abs(dot(q, w)) / sine
    end = moved(q, length_2, v)
    r11, r12, r21, r22 = norm(q), norm(end), norm(moved(q, -length_1, u)), norm(moved(end, -length_1, u))
    if (
        _is_near(r21, r22, length_2)
        or _is_near(r11, r12, length_2)
        or _is_near(r12, r22, length_1)
        or _is_near(r11, r21, length_1)
    ):
        start = (-q[0], -q[1], -q[2])
        total = (
            a2 * _near_potential(moved(start, length_1, u), v, length_2)
            - a1 * _near_potential(start, v, length_2)
            + b2 * _near_potential(end, u, length_1)
            - b1 * _near_potential(q, u, length_1)
        )
    else:
        total = a2 * _line_potential(r21, r22, length_2) - a1 * _line_potential(r11, r12, length_2)
        total += b2 * _line_potential(r12, r22, length_1) - b1 * _line_potential(r11, r21, length_1)
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
    u: Vector, length_1: float, q: Vector, v: Vector, length_2: float, cosine: float, sine2: float
) -> float:
    """Neumann's integral of parallel or nearly parallel filaments."""
    sign = 1.0
    if cosine < 0.0:  # turn the second filament round
        q, v = moved(q, length_2, v), (-v[0], -v[1], -v[2])
        sign = -1.0
    offset = dot(q, u)
    apart = moved(q, -offset, u)
    rho = norm(apart)
    extent = length_1 + length_2
    one_line = COLLINEAR * extent
    at_end = moved(moved(apart, length_2, v), -length_2 * abs(cosine), u)
    if max(rho, norm(at_end)) < one_line:  # at both ends of the second filament
        overlap = min(length_1, offset + length_2) - max(0.0, offset)
        if overlap > one_line:
            return sign * math.inf
        return sign * parallel_filaments(0.0, offset, length_1, length_2)
    if sine2 * extent * extent < COLLINEAR * COLLINEAR * rho * rho:
        return sign * parallel_filaments(rho, offset, length_1, length_2)
    return sign * abs(cosine) * _panels(u, length_1, q, v, length_2)


@kernel
def filament_pair_far(
    u: Vector, length_1: float, q: Vector, v: Vector, length_2: float, nodes: FloatArray, weights: FloatArray
) -> float:
    """Compute `filament_pair` by Gauss rules, at distances above both lengths."""
    h1, h2 = 0.5 * length_1, 0.5 * length_2
    middles = moved(moved(q, h2, v), -h1, u)
    total = 0.0
    for i in range(nodes.shape[0]):
        apart = moved(middles, -h1 * nodes[i], u)
        inner = 0.0
        for j in range(nodes.shape[0]):
            inner += weights[j] / norm(moved(apart, h2 * nodes[j], v))
        total += weights[i] * inner
    return dot(u, v) * h1 * h2 * total


@kernel
def _corner_cell(
    x_end: float, y_end: float, in_x: Line, in_y: Line, offset: float, length_1: float, length_2: float
) -> float:
    """Integrate densities a + b x and a + b y times K from the origin to (x_end, y_end).

    K is the filament integral at √(x² + y²). Each of two triangles in polar coordinates has the
    variable dθ/cos θ, and r = R τ³ makes r ln r smooth.
    """
    if x_end == 0.0 or y_end == 0.0:
        return 0.0
    total = 0.0
    width, height = abs(x_end), abs(y_end)
    for side in range(2):
        along, across = (width, height) if side == 0 else (height, width)  # along: the triangle's side on an axis
        # u = asinh(tan θ), with θ measured from that axis; tan θ runs to across/along
        u_end = math.asinh(across / along)
        for i in range(_NODES_16.shape[0]):
            u = 0.5 * u_end * (1.0 + _NODES_16[i])
            tangent = math.sinh(u)
            secant = math.sqrt(1.0 + tangent * tangent)
            radius = along * secant
            angle_weight = 0.5 * u_end * _WEIGHTS_16[i] / secant  # dθ = du / cosh u
            c, s = (1.0 if side == 0 else tangent) / secant, (tangent if side == 0 else 1.0) / secant
            inner = 0.0
            for j in range(_NODES_16.shape[0]):
                tau = 0.5 * (1.0 + _NODES_16[j])
                r = radius * tau * tau * tau
                x = math.copysign(r * c, x_end)
                y = math.copysign(r * s, y_end)
                density = (in_x[0] + in_x[1] * x) * (in_y[0] + in_y[1] * y)
                weight = 0.5 * _WEIGHTS_16[j] * 3.0 * tau * tau * radius * r * density
                inner += weight * parallel_filaments(r, offset, length_1, length_2)
            total += angle_weight * inner
    return math.copysign(1.0, x_end) * math.copysign(1.0, y_end) * total


@kernel
def _pieces(size_1: float, start_2: float, size_2: float, pieces: FloatArray) -> int:
    """Count the pieces low, high, a, b of the density a + b x of x2 − x1, cut at zero.

    x1 and x2 are uniform on [0, size_1] and `start_2` + [0, size_2].
    """
    small, large = min(size_1, size_2), max(size_1, size_2)
    first, last, slope = start_2 - size_1, start_2 + size_2, 1.0 / (small * large)
    edges = (first, first + small, last - small, last)
    lines = ((-slope * first, slope), (1.0 / large, 0.0), (slope * last, -slope))
    count = 0
    for i in range(3):
        for part in range(2):
            low = edges[i] if part == 0 else max(edges[i], 0.0)
            high = min(edges[i + 1], 0.0) if part == 0 else edges[i + 1]
            if high > low:
                a, b = lines[i]
                pieces[count, 0], pieces[count, 1], pieces[count, 2], pieces[count, 3] = low, high, a, b
                count += 1
    return count


@kernel
def _cell(x_piece: FloatArray, y_piece: FloatArray, offset: float, length_1: float, length_2: float) -> float:
    """Integrate two densities times K over two `_pieces`."""
    x0, x1, ax, bx = x_piece[0], x_piece[1], x_piece[2], x_piece[3]
    y0, y1, ay, by = y_piece[0], y_piece[1], y_piece[2], y_piece[3]
    if math.hypot(max(0.0, x0, -x1), max(0.0, y0, -y1)) < 0.75 * max(x1 - x0, y1 - y0):
        total = 0.0
        for i in range(2):
            for j in range(2):
                x, y = x1 if i == 0 else x0, y1 if j == 0 else y0
                cell = _corner_cell(x, y, (ax, bx), (ay, by), offset, length_1, length_2)
                total += cell if i == j else -cell
        return total
    total = 0.0
    for i in range(_NODES_16.shape[0]):
        x = 0.5 * (x0 + x1) + 0.5 * (x1 - x0) * _NODES_16[i]
        for j in range(_NODES_16.shape[0]):
            y = 0.5 * (y0 + y1) + 0.5 * (y1 - y0) * _NODES_16[j]
            weight = _WEIGHTS_16[i] * _WEIGHTS_16[j] * (ax + bx * x) * (ay + by * y)
            total += weight * parallel_filaments(math.hypot(x, y), offset, length_1, length_2)
    area: float = 0.25 * (x1 - x0) * (y1 - y0)
    return area * total


@kernel
def parallel_bars(
    length_1: float, width_1: float, thickness_1: float,
    length_2: float, width_2: float, thickness_2: float,
    dx: float, dy: float, dz: float,
) -> float:  # fmt: skip
    """Mean of ∬ dz dz'/R over two bars, the second at (dx, dy, dz)."""
    x, y = np.empty((6, 4)), np.empty((6, 4))
    x_count, y_count = _pieces(width_1, dx, width_2, x), _pieces(thickness_1, dy, thickness_2, y)
    total = 0.0
    for i in range(x_count):
        for j in range(y_count):
            total += _cell(x[i], y[j], dz, length_1, length_2)
    return total


@kernel
def bar_self(length: float, width: float, thickness: float) -> float:
    """Mean of ∬ dz dz'/R of one bar with itself."""
    # The density is even in x and y, so four times one quadrant suffices.
    in_x, in_y = (1.0 / width, -1.0 / (width * width)), (1.0 / thickness, -1.0 / (thickness * thickness))
    return 4.0 * _corner_cell(width, thickness, in_x, in_y, 0.0, length, length)
