"""Neumann sums over the bars of two current paths.

A row of a segment table holds, in m: start (0:3), unit direction (3:6), length (6), unit lateral
direction (7:10), width (10), thickness (11). A pair of bars is the mean of pairs of filaments:

- far apart against the cross-section: the centre lines.
- parallel: the lateral offset of the two filaments has a triangular density (equal widths),
  integrated by a Gauss rule on each half with as many nodes as the nearest singularity demands.
  Bars that nearly touch go to `bars`.
- at an angle, or parallel and of different size: Gauss rules across both widths, and more where
  they meet in a corner.

Near filament pairs are in closed form, pairs beyond twice their length by Gauss rules.

Of distant bars, the exact potential of one is evaluated at the nodes of a Gauss rule along the
other. The potential of a segment a at a point, along it, is ln((|u| + |v| + |a|)/(|u| + |v| − |a|))
with u and v from its ends to the point. Along another segment of length ℓ at distance D from a it
is analytic out to the Bernstein ellipse ln ρ ≥ asinh(2D/ℓ), so n nodes err like ρ^(−2n). Nodes of
many pairs are evaluated together, without a branch, so that the processor does several at once.
"""

from __future__ import annotations

import math

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.electromagnetics.kernels import kernel
from coilarray.electromagnetics.kernels.bars import filament_pair, filament_pair_far, parallel_bars
from coilarray.electromagnetics.kernels.segments import Vector, cross, dot, log_of_ratio, moved, norm

MOST_NODES = 32  # along one segment; pairs that need more are left to the closed forms
APART = 7.6  # distance in widths from which two nodes across suffice, for each width: ln ρ ≥ 3.45 in `kernels.paths`
CAPACITY = 4096  # nodes that are evaluated together, whose four arrays fit the caches
_LANES = 8
MAX_NODES = 16  # of the Gauss rules in the tables
# most filament pairs of a pair of bars, from three Gauss rules, and four signs or pieces
RULE_SIZE = 4 * MAX_NODES**2 * MAX_NODES
# The following numbers in widths are no round numbers. Distances are round, and rounding would
# decide on them as a coil is turned.
NODE_PAIR = 12.3  # widths of distance from which two nodes, of the cross-section's variance, suffice for parallel bars
THICK = 6.2  # widths of distance beyond which thickness does not count for bars at an angle
TOUCHING = 0.47  # widths of distance within which bars at an angle meet
# sin² of the angle of bars that share their lateral direction (a spiral's turns tilt by 3e-3)
PARALLEL_SIN2 = 4e-4
ALIGNED = 0.98  # least cosine of the angle between the widths of parallel bars that share them
_SHORT = 30.7  # widths; the corners of longer sides change a single turn by less than 1e-5
_WIDE_ANGLE = 0.97  # cosine of 14°; below it both kinks of a corner are nearly one
_WIDE_NODES, _WIDE_LAYERS = 8, 6  # most nodes of a wide corner, 6 · 8 · 3 · 8 · 6 · 2 in all
_LOG_TOLERANCE = -16.1  # ln 1e-7: error of the rules across the cross-section, relative to the pair's variation
_LOG_TOLERANCE_ANGLED = -13.8  # ln 1e-6: the same for bars at an angle, whose errors change sign from pair to pair
_LOG_TOLERANCE_THICKNESS = -11.5  # ln 1e-5: the thickness changes a pair by about 1 %
_LOG_TOLERANCE_FILAMENTS = -25.3  # ln 1e-11: error of the rules along distant thin filaments, exact otherwise
_NO_SHIFT = np.zeros(3)
INNER = 0.5 / math.sqrt(3.0)  # of a width: nodes of the two-point Gauss rule across it


@kernel
def add_node_sums(
    nodes: FloatArray, currents: FloatArray, other_nodes: FloatArray, other_currents: FloatArray, shifts: FloatArray,
    sums: FloatArray,
) -> None:  # fmt: skip
    """Add the sums of two sets of nodes, the others (3, k), by `shifts` (m, 3)."""
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


NODES, WEIGHTS = np.zeros((2, MOST_NODES + 1, MOST_NODES))  # Gauss rules on [−1, 1], n nodes in row n
for _n in range(1, MOST_NODES + 1):
    NODES[_n, :_n], WEIGHTS[_n, :_n] = np.polynomial.legendre.leggauss(_n)


def least_distances(log_tolerance: float) -> FloatArray:
    """Least distances in segment lengths for errors e^`log_tolerance` of n nodes."""
    with np.errstate(divide="ignore", over="ignore"):
        return np.asarray(0.5 * np.sinh(-log_tolerance / (2.0 * np.arange(MOST_NODES + 1))))


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


_LEAST, _LEAST_FILAMENTS = least_distances(_LOG_TOLERANCE), least_distances(_LOG_TOLERANCE_FILAMENTS)


def _triangle_tables() -> tuple[FloatArray, FloatArray]:
    """Gauss rules for 1 − |x| on [−1, 1] by Stieltjes' recurrence (Golub & Welsch 1969)."""
    half, weight = np.polynomial.legendre.leggauss(2 * MAX_NODES)  # exact for the integrands of the recurrence
    x = np.concatenate((0.5 * (half - 1.0), 0.5 * (half + 1.0)))
    density = np.tile(0.5 * weight, 2) * (1.0 - np.abs(x))
    betas: list[float] = []
    before, now = np.zeros_like(x), np.ones_like(x)
    for _ in range(MAX_NODES):
        before, now = now, x * now - (betas[-1] if betas else 0.0) * before
        betas.append(float(density @ now**2 / (density @ before**2)))
    nodes, weights = np.zeros((MAX_NODES + 1, MAX_NODES)), np.zeros((MAX_NODES + 1, MAX_NODES))
    for n in range(1, MAX_NODES + 1):
        off = np.sqrt(betas[: n - 1])
        values, vectors = np.linalg.eigh(np.diag(off, 1) + np.diag(off, -1))
        nodes[n, :n], weights[n, :n] = values, vectors[0] ** 2
    return nodes, weights


_TRIANGLE_NODES, _TRIANGLE_WEIGHTS = _triangle_tables()


@kernel
def _along(a: FloatArray) -> Vector:
    return a[3], a[4], a[5]


@kernel
def _lateral(a: FloatArray) -> Vector:
    """Direction across the width of a bar."""
    return a[7], a[8], a[9]


@kernel
def _same_side(a: FloatArray, b: FloatArray) -> float:
    """Return 1 if the lateral directions of two bars agree, else −1."""
    return 1.0 if dot(_lateral(a), _lateral(b)) > 0.0 else -1.0


@kernel
def _aligned(a: FloatArray, b: FloatArray, cosine: float) -> bool:
    """Check whether two bars are parallel, and their widths as well."""
    return 1.0 - cosine * cosine < PARALLEL_SIN2 and abs(dot(_lateral(a), _lateral(b))) > ALIGNED


@kernel
def _between(a: FloatArray, b: FloatArray, shift: FloatArray) -> tuple[Vector, float]:
    """Vector between the starts of a bar and a moved bar, and distance of their middles."""
    apart = b[0] + shift[0] - a[0], b[1] + shift[1] - a[1], b[2] + shift[2] - a[2]
    return apart, norm(moved(moved(apart, 0.5 * b[6], _along(b)), -0.5 * a[6], _along(a)))


@kernel
def closest_offset(apart: Vector, a: FloatArray, b: FloatArray) -> Vector:
    """Shortest vector between segments whose starts are `apart`."""
    u, v = _along(a), _along(b)
    cosine, du, dv = dot(u, v), dot(apart, u), dot(apart, v)
    sine2 = 1.0 - cosine * cosine
    s = (du - cosine * dv) / sine2 if sine2 > 1e-12 else 0.5 * a[6]
    s = min(max(s, 0.0), a[6])
    t = cosine * s - dv
    t = min(max(t, 0.0), b[6])
    s = min(max(cosine * t + du, 0.0), a[6])
    t = min(max(cosine * s - dv, 0.0), b[6])
    return moved(moved(apart, t, v), -s, u)


@kernel
def _log_bernstein(x: float, y: float) -> float:
    """Logarithm ln ρ of the Bernstein ellipse through x + iy, where n nodes err like ρ^(−2n)."""
    mean = 0.5 * (math.hypot(x - 1.0, y) + math.hypot(x + 1.0, y))
    return math.log(mean + math.sqrt(max(mean * mean - 1.0, 0.0)))


@kernel
def _set_offset(
    rule: FloatArray, k: int, weight: float, s: float, a: FloatArray, t: float, b: FloatArray, h: float
) -> None:
    """Write row k: filaments s and t beside two bars' middles, h apart."""
    rule[k, 0], normal = weight, cross(_along(a), _lateral(a))
    for axis in range(3):
        rule[k, 1 + axis] = t * b[7 + axis] - s * a[7 + axis] + h * normal[axis]


@kernel
def _parallel_rule(a: FloatArray, b: FloatArray, nearest: Vector, level: bool, extra: int, rule: FloatArray) -> int:
    """Offsets of equal parallel bars, none if they touch.

    `nearest` is between the nearest places. The lateral offset has a triangular density on
    [−width, width], and likewise across the thickness. Its direction is the mean of both bars, so
    that a tilt counts in second order. Bars `level` with each other have equal offsets up and down.
    """
    width, thickness = a[10], a[11]
    normal = cross(_along(a), _lateral(a))
    side = 0.5 * _same_side(a, b)
    lateral, above, axial = abs(dot(nearest, _lateral(a))), abs(dot(nearest, normal)), abs(dot(nearest, _along(a)))
    # The nearest singularities, in the plane of the complex offset.
    log_w = _log_bernstein(lateral / width, math.hypot(above, axial) / width)
    beside = math.hypot(max(lateral - width, 0.0), axial)
    log_t = _log_bernstein(above / thickness, beside / thickness)
    if 2.0 * MAX_NODES * log_w < -_LOG_TOLERANCE or 2.0 * MAX_NODES * log_t < -_LOG_TOLERANCE_THICKNESS:
        return 0
    n_w = min(math.ceil(-_LOG_TOLERANCE / (2.0 * log_w)) + extra, MAX_NODES)
    n_t = min(math.ceil(-_LOG_TOLERANCE_THICKNESS / (2.0 * log_t)) + extra, MAX_NODES)
    count = 0
    for k in range(n_w):
        across = width * _TRIANGLE_NODES[n_w, k]
        for m in range((n_t + 1) // 2 if level else n_t):
            weight = _TRIANGLE_WEIGHTS[n_w, k] * _TRIANGLE_WEIGHTS[n_t, m]
            if level and 2 * m + 1 < n_t:
                weight *= 2.0
            h = thickness * _TRIANGLE_NODES[n_t, m]
            _set_offset(rule, count, weight, -0.5 * across, a, side * across, b, h)
            count += 1
    return count


@kernel
def _two_node_offset(a: FloatArray, b: FloatArray) -> Vector:
    """Offset of two nodes with the difference of both variances of distant parallel bars."""
    variance = (a[10] * a[10] - a[11] * a[11]) / 6.0
    if variance > 0.0:
        across, side = moved(_lateral(a), _same_side(a, b), _lateral(b)), 0.5
    else:
        across, side = cross(_along(a), _lateral(a)), 1.0
    return moved((0.0, 0.0, 0.0), side * math.sqrt(abs(variance)), across)


@kernel
def _half_width(a: FloatArray) -> Vector:
    """Half of a flat bar's width with the difference of both variances, along the larger side."""
    variance = a[10] * a[10] - a[11] * a[11]
    direction = _lateral(a) if variance > 0.0 else cross(_along(a), _lateral(a))
    return moved((0.0, 0.0, 0.0), 0.5 * math.sqrt(abs(variance)), direction)


@kernel
def _angled_rule(a: FloatArray, b: FloatArray, distance: float, level: bool, extra: int, rule: FloatArray) -> int:
    """Offsets of bars at an angle or of different size.

    Nodes across the widths and, if near, two across each thickness. If not, only the difference of
    their variances counts.
    """
    size = max(a[10], b[10])
    log_rho = max(_log_bernstein(1.0 + 2.0 * distance / size, 0.0), 1e-3)  # zero where the bars cross
    n = min(math.ceil(-_LOG_TOLERANCE_ANGLED / (2.0 * log_rho)) + extra, MAX_NODES)
    count = 0
    if distance >= THICK * size:
        first, second = _half_width(a), _half_width(b)
        for k in range(n):
            for m in range(n):
                rule[count, 0] = WEIGHTS[n, k] * WEIGHTS[n, m]
                for axis in range(3):
                    rule[count, 1 + axis] = NODES[n, m] * second[axis] - NODES[n, k] * first[axis]
                count += 1
        return count
    normal, other = cross(_along(a), _lateral(a)), cross(_along(b), _lateral(b))
    # one offset for both thicknesses if they have one direction
    alike = level or abs(dot(normal, other)) > ALIGNED
    half = math.sqrt((a[11] * a[11] + (b[11] * b[11] if alike else 0.0)) / 12.0)
    of_other = 0.0 if alike else INNER * b[11]
    for k in range(n):
        for m in range(n):
            s, t = 0.5 * a[10] * NODES[n, k], 0.5 * b[10] * NODES[n, m]
            for side in range(1 if level or half == 0.0 else 2 if alike else 4):
                h = half if side % 2 == 0 else -half
                _set_offset(rule, count, WEIGHTS[n, k] * WEIGHTS[n, m], s, a, t, b, h)
                for axis in range(3):
                    rule[count, 1 + axis] += (of_other if side < 2 else -of_other) * other[axis]
                count += 1
    return count


@kernel
def _corner_rule(
    a: FloatArray, b: FloatArray, cosine: float, wide: bool, level: bool, extra: int, rule: FloatArray
) -> int:
    """Offsets of two bars that meet at an angle.

    The integrand has kinks where the end of one filament lies on the other, at offsets in the ratio
    of the cosine, either way, which is nearly one unless the angle is `wide`. The second width is
    cut there. At a wide angle the first is cut where such a cut meets an edge of the second, and in
    its middle, where both cuts cross. The thickness enters by its triangular offset density.
    """
    n = min(5 + extra, _WIDE_NODES if wide else MAX_NODES)
    n_z = min(3 + extra, _WIDE_LAYERS if wide else MAX_NODES)
    thickness, edge, other = 0.5 * (a[11] + b[11]), 0.5 * a[10], 0.5 * b[10]
    ratio = cosine if wide else math.copysign(1.0, cosine)
    near, far = min(abs(ratio) * other, edge), min(other / abs(ratio), edge)
    bounds = (-edge, -far, -near, 0.0, near, far, edge) if wide else (-edge, edge, edge, edge, edge, edge, edge)
    count = 0
    for outer in range(6):
        half = 0.5 * (bounds[outer + 1] - bounds[outer])
        if half <= 0.0:
            continue
        for k in range(n):
            s = bounds[outer] + half * (1.0 + NODES[n, k])
            one, two = min(max(s * ratio, -other), other), min(max(s / ratio, -other), other)
            cuts = (-other, min(one, two), max(one, two), other)
            for piece in range(3):
                width = 0.5 * (cuts[piece + 1] - cuts[piece])
                if width <= 0.0:
                    continue
                for m in range(n):
                    t = cuts[piece] + width * (1.0 + NODES[n, m])
                    weight = half * WEIGHTS[n, k] * width * WEIGHTS[n, m]
                    for c in range(n_z):
                        z = 0.5 * (1.0 + NODES[n_z, c])
                        for side in range(1 if level else 2):
                            h = thickness * z * (1.0 - 2.0 * side)
                            _set_offset(rule, count, weight * WEIGHTS[n_z, c] * (1.0 - z), s, a, t, b, h)
                            count += 1
    return count


@kernel
def _touching_parallel_bars(a: FloatArray, b: FloatArray, apart: Vector, cosine: float) -> float:
    """Exact integral of touching parallel bars, whose starts are `apart`."""
    # The start of the second bar that comes first along the first bar, and its middle.
    first = apart if cosine > 0.0 else moved(apart, b[6], _along(b))
    middle = moved(apart, 0.5 * b[6], _along(b))
    across = dot(middle, _lateral(a)) + 0.5 * (a[10] - b[10])
    up = dot(middle, cross(_along(a), _lateral(a))) + 0.5 * (a[11] - b[11])
    return cosine * parallel_bars(a[6], a[10], a[11], b[6], b[10], b[11], across, up, dot(first, _along(a)))


@kernel
def _ends_meet(apart: Vector, a: FloatArray, b: FloatArray, tolerance: float) -> bool:
    """Check whether ends of two segments are within `tolerance`."""
    for i in range(2):
        for j in range(2):
            if norm(moved(moved(apart, j * b[6], _along(b)), -i * a[6], _along(a))) < tolerance:
                return True
    return False


@kernel
def _offsets(
    a: FloatArray, b: FloatArray, apart: Vector, cosine: float, middles: float, near_widths: float, extra: int,
    rule: FloatArray,
) -> int:  # fmt: skip
    """Write two bars' offsets, zero for centre lines, none for touching parallel bars."""
    rule[0, 0], rule[0, 1], rule[0, 2], rule[0, 3] = 1.0, 0.0, 0.0, 0.0
    size = max(a[10], b[10], a[11], b[11])
    if size == 0.0 or middles - 0.5 * (a[6] + b[6]) >= near_widths * size:
        return 1
    nearest = closest_offset(apart, a, b)
    distance = norm(nearest)
    if distance >= near_widths * size:
        return 1
    aligned = _aligned(a, b, cosine)
    level = apart[2] == 0.0 and a[5] == 0.0 and b[5] == 0.0 and a[9] == 0.0 and b[9] == 0.0
    if aligned and a[10] == b[10] and a[11] == b[11]:
        if distance > NODE_PAIR * size:
            offset = _two_node_offset(a, b)
            for axis in range(3):
                rule[0, 1 + axis], rule[1, 1 + axis] = offset[axis], -offset[axis]
            rule[1, 0] = 1.0
            return 2
        return _parallel_rule(a, b, nearest, level, extra, rule)
    if aligned and distance < size:
        return 0
    if distance < TOUCHING * size and _ends_meet(apart, a, b, TOUCHING * size):
        wide = abs(cosine) < _WIDE_ANGLE and min(a[6], b[6]) < _SHORT * size
        return _corner_rule(a, b, cosine, wide, level, extra, rule)
    return _angled_rule(a, b, distance, level, extra, rule)


@kernel
def bar_pair(
    a: FloatArray, b: FloatArray, shift: FloatArray, near_widths: float, extra: int, rule: FloatArray
) -> float:
    """Averaged integral ∬ dl·dl'/R of two bars.

    Bars farther apart than `near_widths` widths are taken as their centre lines, which leaves out
    about (1/near_widths)²/12 of the pair. `extra` adds nodes to every rule, `rule` is scratch.
    """
    u, v = _along(a), _along(b)
    cosine = dot(u, v)
    if abs(cosine) < 1e-15:
        return 0.0
    apart, middles = _between(a, b, shift)
    count = _offsets(a, b, apart, cosine, middles, near_widths, extra, rule)
    if count == 0:
        return _touching_parallel_bars(a, b, apart, cosine)
    longest = max(a[6], b[6])
    nodes = 0  # along distant filaments
    if middles > 2.0 * longest:
        log_rho = _log_bernstein(2.0 * middles / longest - 1.0, 0.0)
        tolerance = _LOG_TOLERANCE_FILAMENTS if max(a[10], b[10], a[11], b[11]) == 0.0 else _LOG_TOLERANCE
        nodes = min(math.ceil(-tolerance / (2.0 * log_rho)) + extra, MAX_NODES)
    total = 0.0
    weights = 0.0
    for k in range(count):
        q = (apart[0] + rule[k, 1], apart[1] + rule[k, 2], apart[2] + rule[k, 3])
        if nodes > 0:
            value = filament_pair_far(u, a[6], q, v, b[6], NODES[nodes, :nodes], WEIGHTS[nodes, :nodes])
        else:
            value = filament_pair(u, a[6], q, v, b[6])
        total += rule[k, 0] * value
        weights += rule[k, 0]
    return total / weights


@kernel
def _collect(
    a: FloatArray, b: FloatArray, shift: FloatArray, near_widths: float, extra: int, count: int, batch: FloatArray
) -> int:
    """Collect nodes of distant bars, two offsets for each cross-section, or −1 for near bars."""
    apart, middles = _between(a, b, shift)
    size = max(a[10], b[10], a[11], b[11])
    distance = middles - 0.5 * (a[6] + b[6])
    if distance < max(b[6], near_widths * size):
        distance = norm(closest_offset(apart, a, b))
        if distance < APART * size or distance < 0.01 * b[6] or distance < 0.01 * a[6]:
            return -1
    least = _LEAST_FILAMENTS if size == 0.0 else _LEAST
    nodes = 2
    while nodes <= MOST_NODES and distance < least[nodes] * b[6]:
        nodes += 1
    nodes += extra
    if nodes > MOST_NODES:
        return -1
    # Offsets across the bars are ±`across` of the first, and ±`other`.
    across, other, sides = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1
    cosine = dot(_along(a), _along(b))
    if distance < near_widths * size:
        if a[10] == b[10] and a[11] == b[11] and _aligned(a, b, cosine):
            if distance < NODE_PAIR * size:
                return -1
            sides, other = 2, _two_node_offset(a, b)
        else:
            sides = 4
            across = moved((0.0, 0.0, 0.0), 2.0 * INNER, _half_width(a))
            other = moved((0.0, 0.0, 0.0), 2.0 * INNER, _half_width(b))
    for side in range(sides):
        start = moved(moved(apart, 1.0 if side % 2 == 0 else -1.0, other), -1.0 if side < 2 else 1.0, across)
        for k in range(nodes):
            along = 0.5 * b[6] * (1.0 + NODES[nodes, k])
            batch[0, count], batch[1, count], batch[2, count] = moved(start, along, _along(b))
            batch[3, count] = cosine / sides * 0.5 * b[6] * WEIGHTS[nodes, k]
            count += 1
    return count


@kernel
def _rows_sum(
    first: FloatArray, second: FloatArray, shift: FloatArray, start: int, stop: int, near_widths: float, extra: int,
    own: bool,
) -> float:  # fmt: skip
    """Sum rows start:stop of `first` with `second`, or `own` pairs i < j."""
    rule = np.empty((RULE_SIZE, 4))
    batch = np.empty((4, CAPACITY))
    total = 0.0
    for i in range(start, stop):
        near, far = 0.0, 0.0
        # A plain 0 has a type of its own, for which all kernels that take it would be compiled once
        # more.
        count, begin = int(0.0), i + 1 if own else int(0.0)
        for j in range(begin, second.shape[0] + 1):
            last = j == second.shape[0]  # lets `batch_sum` be called, and compiled into this, at one place
            if not last:
                collected = _collect(first[i], second[j], shift, near_widths, extra, count, batch)
                if collected < 0:
                    near += bar_pair(first[i], second[j], shift, near_widths, extra, rule)
                    continue
                count = collected
            if last or count > CAPACITY - 4 * MOST_NODES - 8:
                far += batch_sum(first[i], count, batch)
                count = int(0.0)
        total += near + far
    return total


# Both are one kernel, as every kernel compiles all that it calls once more.


def mutual_sum(
    first: FloatArray, second: FloatArray, shift: FloatArray, start: int, stop: int, near_widths: float, extra: int
) -> float:
    """Sum `bar_pair` over rows start:stop of `first` and all moved by `shift`."""
    return _rows_sum(first, second, shift, start, stop, near_widths, extra, False)


def own_mutual_sum(
    path: FloatArray, start: int, stop: int, near_widths: float, extra: int, shift: FloatArray = _NO_SHIFT
) -> float:
    """Twice the sum of `bar_pair` over pairs i < j of a path, j moved by `shift`."""
    return 2.0 * _rows_sum(path, path, shift, start, stop, near_widths, extra, True)
