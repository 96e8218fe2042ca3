"""Neumann sums over the bars of two current paths.

A row of a segment table holds, in m: start (0:3), unit direction (3:6), length (6), unit lateral direction (7:10),
width (10), thickness (11). Each pair of bars is the mean of filament pairs over both cross-sections:

* far apart against the cross-section: the centre lines;
* parallel: the lateral offset of the two filaments has a triangular density (equal widths), integrated by a Gauss
  rule on each half with as many nodes as the nearest singularity demands; bars that nearly touch go to `bars`;
* at an angle: Gauss rules across both widths, and more where they meet in a corner.

A filament pair is the closed form near and a Gauss rule along both where the distance exceeds twice the length.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from coilarray.kernels.bars import parallel_bars
from coilarray.kernels.compiled import kernel
from coilarray.kernels.filaments import filament_pair, filament_pair_far

FloatArray = npt.NDArray[np.float64]

MAX_NODES = 16
"""Largest Gauss rule in the tables."""
NODE_PAIR = 12.0
"""Beyond this many widths two nodes with the variance of the cross-section suffice for parallel bars."""
THICK = 6.0
"""Beyond this many widths the thickness of bars at an angle does not count."""
TOUCHING = 0.5
"""Bars at an angle and nearer than this many widths are taken to meet."""
PARALLEL_SIN2 = 4e-4
"""Bars below this sin² of the angle share their lateral direction (turns of a spiral are tilted by 3e-3)."""
_LOG_TOLERANCE = -16.1  # ln 1e-7: error of the rules across the cross-section, relative to the pair's variation
_LOG_TOLERANCE_THICKNESS = -11.5  # ln 1e-5: the thickness changes a pair by about 1 %
_LOG_TOLERANCE_LENGTH = -20.8  # ln 1e-9: error of the rules along distant filaments


def _gauss_tables() -> tuple[FloatArray, FloatArray]:
    nodes, weights = np.zeros((MAX_NODES + 1, MAX_NODES)), np.zeros((MAX_NODES + 1, MAX_NODES))
    for n in range(1, MAX_NODES + 1):
        nodes[n, :n], weights[n, :n] = np.polynomial.legendre.leggauss(n)
    return nodes, weights


_NODES, _WEIGHTS = _gauss_tables()


@kernel
def _closest_offset(dx: float, dy: float, dz: float, a: FloatArray, b: FloatArray) -> tuple[float, float, float]:
    """Shortest vector from the first segment to the second; (dx, dy, dz) leads from start to start."""
    cosine = a[3] * b[3] + a[4] * b[4] + a[5] * b[5]
    du = dx * a[3] + dy * a[4] + dz * a[5]
    dv = dx * b[3] + dy * b[4] + dz * b[5]
    sine2 = 1.0 - cosine * cosine
    s = (du - cosine * dv) / sine2 if sine2 > 1e-12 else 0.5 * a[6]
    s = min(max(s, 0.0), a[6])
    t = cosine * s - dv
    t = min(max(t, 0.0), b[6])
    s = min(max(cosine * t + du, 0.0), a[6])
    t = min(max(cosine * s - dv, 0.0), b[6])
    return (
        dx + t * b[3] - s * a[3],
        dy + t * b[4] - s * a[4],
        dz + t * b[5] - s * a[5],
    )


@kernel
def _log_bernstein(x: float, y: float) -> float:
    """Give ln ρ of the Bernstein ellipse of [−1, 1] through x + iy: a Gauss rule of n nodes errs like ρ^(−2n)."""
    return math.log(0.5 * (math.hypot(x - 1.0, y) + math.hypot(x + 1.0, y)) + math.sqrt(
        max(0.25 * (math.hypot(x - 1.0, y) + math.hypot(x + 1.0, y)) ** 2 - 1.0, 0.0)
    ))  # fmt: skip


@kernel
def _filaments(
    a: FloatArray, b: FloatArray, px: float, py: float, pz: float, qx: float, qy: float, qz: float, nodes: int
) -> float:
    if nodes > 0:
        return filament_pair_far(
            px, py, pz, a[3], a[4], a[5], a[6], qx, qy, qz, b[3], b[4], b[5], b[6],
            _NODES[nodes, :nodes], _WEIGHTS[nodes, :nodes],
        )  # fmt: skip
    return filament_pair(px, py, pz, a[3], a[4], a[5], a[6], qx, qy, qz, b[3], b[4], b[5], b[6])


@kernel
def _parallel_pair(
    a: FloatArray, b: FloatArray, gx: float, gy: float, gz: float, cosine: float,
    qx: float, qy: float, qz: float, nodes: int, extra: int,
) -> float:  # fmt: skip
    """Mean over the cross-sections of two (nearly) parallel bars of equal width and thickness."""
    width, thickness = a[10], a[11]
    nx, ny, nz = a[7], a[8], a[9]
    mx, my, mz = a[4] * nz - a[5] * ny, a[5] * nx - a[3] * nz, a[3] * ny - a[4] * nx
    lateral = abs(gx * nx + gy * ny + gz * nz)
    normal = abs(gx * mx + gy * my + gz * mz)
    axial = abs(gx * a[3] + gy * a[4] + gz * a[5])
    # nearest singularities of the half rules on [0, width] and [0, thickness]
    log_w = _log_bernstein((lateral - 0.5 * width) / (0.5 * width), math.hypot(normal, axial) / (0.5 * width))
    beside = math.hypot(max(lateral - width, 0.0), axial)
    log_t = _log_bernstein((normal - 0.5 * thickness) / (0.5 * thickness), beside / (0.5 * thickness))
    if 2.0 * MAX_NODES * log_w < -_LOG_TOLERANCE or 2.0 * MAX_NODES * log_t < -_LOG_TOLERANCE_THICKNESS:
        # almost touching: the exact bars, in the first one's frame, with the small tilt left out
        sx, sy, sz = qx, qy, qz
        if cosine < 0.0:
            sx, sy, sz = qx + b[6] * b[3], qy + b[6] * b[4], qz + b[6] * b[5]
        ex, ey, ez = sx - a[0], sy - a[1], sz - a[2]
        half = 0.5 * b[6]
        cx, cy, cz = ex + math.copysign(half, cosine) * b[3], ey + math.copysign(half, cosine) * b[4], 0.0
        cz = ez + math.copysign(half, cosine) * b[5]
        return cosine * parallel_bars(
            a[6], width, thickness, b[6], width, thickness,
            cx * nx + cy * ny + cz * nz, cx * mx + cy * my + cz * mz, ex * a[3] + ey * a[4] + ez * a[5],
        )  # fmt: skip
    n_w = min((math.ceil(-_LOG_TOLERANCE / (2.0 * log_w))) + extra, MAX_NODES)
    n_t = min((math.ceil(-_LOG_TOLERANCE_THICKNESS / (2.0 * log_t))) + extra, MAX_NODES)
    total = 0.0
    norm = 0.0
    for k in range(n_w):
        x = 0.5 * (1.0 + _NODES[n_w, k])
        weight_x = _WEIGHTS[n_w, k] * (1.0 - x)
        for m in range(n_t):
            z = 0.5 * (1.0 + _NODES[n_t, m])
            weight = weight_x * _WEIGHTS[n_t, m] * (1.0 - z)
            norm += 4.0 * weight
            for quadrant in range(4):
                sx = width * x * (1.0 if quadrant < 2 else -1.0)
                sz = thickness * z * (1.0 if quadrant % 2 == 0 else -1.0)
                total += weight * _filaments(
                    a, b, a[0], a[1], a[2],
                    qx + sx * nx + sz * mx, qy + sx * ny + sz * my, qz + sx * nz + sz * mz, nodes,
                )  # fmt: skip
    return total / norm


@kernel
def _angled_pair(
    a: FloatArray, b: FloatArray, distance: float, qx: float, qy: float, qz: float, nodes: int, extra: int
) -> float:
    """Mean over the cross-sections of two bars at an angle, or parallel ones of different size."""
    size = max(a[10], b[10])
    if distance < TOUCHING * size:
        return _touching_pair(a, b, qx, qy, qz, nodes, extra)
    log_rho = _log_bernstein(1.0 + 2.0 * distance / size, 0.0)
    n = min((math.ceil(-_LOG_TOLERANCE / (2.0 * log_rho))) + extra, MAX_NODES)
    # two nodes with the variance of the difference of two offsets across the thickness, or one where it is too thin
    half = math.sqrt((a[11] * a[11] + b[11] * b[11]) / 12.0) if distance < THICK * size else 0.0
    mx, my, mz = a[4] * a[9] - a[5] * a[8], a[5] * a[7] - a[3] * a[9], a[3] * a[8] - a[4] * a[7]
    total = 0.0
    for k in range(n):
        s = 0.5 * a[10] * _NODES[n, k]
        px, py, pz = a[0] + s * a[7], a[1] + s * a[8], a[2] + s * a[9]
        for m in range(n):
            t = 0.5 * b[10] * _NODES[n, m]
            rx, ry, rz = qx + t * b[7], qy + t * b[8], qz + t * b[9]
            weight = 0.25 * _WEIGHTS[n, k] * _WEIGHTS[n, m]
            if half == 0.0:
                total += weight * _filaments(a, b, px, py, pz, rx, ry, rz, nodes)
            else:
                for sign in (-1.0, 1.0):
                    h = sign * half
                    total += (
                        0.5 * weight * _filaments(a, b, px, py, pz, rx + h * mx, ry + h * my, rz + h * mz, nodes)
                    )
    return total


@kernel
def _touching_pair(a: FloatArray, b: FloatArray, qx: float, qy: float, qz: float, nodes: int, extra: int) -> float:
    """Mean over the cross-sections of two bars at an angle that meet, as neighbours in a path do.

    The integrand has a kink where the two filaments meet end to end, at equal lateral offsets, so the second width
    is cut there; the thickness rounds the kink off and enters by its triangular offset density.
    """
    n = min(5 + extra, MAX_NODES)
    n_z = min(3 + extra, MAX_NODES)
    thickness = 0.5 * (a[11] + b[11])
    mx, my, mz = a[4] * a[9] - a[5] * a[8], a[5] * a[7] - a[3] * a[9], a[3] * a[8] - a[4] * a[7]
    same = 1.0 if a[3] * b[3] + a[4] * b[4] + a[5] * b[5] > 0.0 else -1.0
    total = 0.0
    norm = 0.0
    for k in range(n):
        s = 0.5 * a[10] * _NODES[n, k]
        px, py, pz = a[0] + s * a[7], a[1] + s * a[8], a[2] + s * a[9]
        cut = min(max(same * s, -0.5 * b[10]), 0.5 * b[10])
        for side in range(2):
            low = -0.5 * b[10] if side == 0 else cut
            half = 0.5 * ((cut if side == 0 else 0.5 * b[10]) - low)
            for m in range(n):
                t = low + half * (1.0 + _NODES[n, m])
                rx, ry, rz = qx + t * b[7], qy + t * b[8], qz + t * b[9]
                for c in range(n_z):
                    z = 0.5 * (1.0 + _NODES[n_z, c])
                    weight = _WEIGHTS[n, k] * half * _WEIGHTS[n, m] * _WEIGHTS[n_z, c] * (1.0 - z)
                    norm += 2.0 * weight
                    for sign in (-1.0, 1.0):
                        h = sign * z * thickness
                        total += weight * _filaments(a, b, px, py, pz, rx + h * mx, ry + h * my, rz + h * mz, nodes)
    return total / norm


@kernel
def bar_pair(a: FloatArray, b: FloatArray, shift: FloatArray, reach: float, extra: int) -> float:
    """∬ dl·dl'/R of two bars, rows `a` and `b` of segment tables, the second moved by `shift`, averaged.

    Farther apart than `reach` widths they are their centre lines: that leaves out about (1/reach)²/12 of the pair.
    `extra` adds nodes to every rule, for convergence studies.
    """
    cosine = a[3] * b[3] + a[4] * b[4] + a[5] * b[5]
    if abs(cosine) < 1e-15:
        return 0.0
    qx, qy, qz = b[0] + shift[0], b[1] + shift[1], b[2] + shift[2]
    dx, dy, dz = qx - a[0], qy - a[1], qz - a[2]
    mx = dx + 0.5 * (b[6] * b[3] - a[6] * a[3])
    my = dy + 0.5 * (b[6] * b[4] - a[6] * a[4])
    mz = dz + 0.5 * (b[6] * b[5] - a[6] * a[5])
    centre_distance = math.sqrt(mx * mx + my * my + mz * mz)
    longest = max(a[6], b[6])
    nodes = 0
    if centre_distance > 2.0 * longest:
        log_rho = _log_bernstein(2.0 * centre_distance / longest - 1.0, 0.0)
        nodes = min((math.ceil(-_LOG_TOLERANCE_LENGTH / (2.0 * log_rho))) + extra, MAX_NODES)
    size = max(a[10], b[10], a[11], b[11])
    if size == 0.0 or centre_distance - 0.5 * (a[6] + b[6]) > reach * size:
        return _filaments(a, b, a[0], a[1], a[2], qx, qy, qz, nodes)
    gx, gy, gz = _closest_offset(dx, dy, dz, a, b)
    distance = math.sqrt(gx * gx + gy * gy + gz * gz)
    parallel = 1.0 - cosine * cosine < PARALLEL_SIN2 and a[10] == b[10] and a[11] == b[11]
    if distance > reach * size:
        return _filaments(a, b, a[0], a[1], a[2], qx, qy, qz, nodes)
    if not parallel:
        return _angled_pair(a, b, distance, qx, qy, qz, nodes, extra)
    if distance > NODE_PAIR * size:
        # In the plane across the bars the kernel is harmonic, so only the difference of the variances counts.
        variance = (a[10] * a[10] - a[11] * a[11]) / 6.0
        step = math.sqrt(abs(variance))
        nx, ny, nz = a[7], a[8], a[9]
        if variance < 0.0:
            nx, ny, nz = a[4] * a[9] - a[5] * a[8], a[5] * a[7] - a[3] * a[9], a[3] * a[8] - a[4] * a[7]
        return 0.5 * (
            _filaments(a, b, a[0], a[1], a[2], qx + step * nx, qy + step * ny, qz + step * nz, nodes)
            + _filaments(a, b, a[0], a[1], a[2], qx - step * nx, qy - step * ny, qz - step * nz, nodes)
        )
    return _parallel_pair(a, b, gx, gy, gz, cosine, qx, qy, qz, nodes, extra)


@kernel
def mutual_sum(
    first: FloatArray, second: FloatArray, shift: FloatArray, start: int, stop: int, reach: float, extra: int
) -> float:
    """Sum of `bar_pair` over rows start:stop of `first` and all rows of `second` moved by `shift`."""
    total = 0.0
    for i in range(start, stop):
        row = 0.0
        for j in range(second.shape[0]):
            row += bar_pair(first[i], second[j], shift, reach, extra)
        total += row
    return total


@kernel
def own_mutual_sum(path: FloatArray, start: int, stop: int, reach: float, extra: int) -> float:
    """Twice the sum of `bar_pair` over the pairs i < j of one path with start ≤ i < stop."""
    shift = np.zeros(3)
    total = 0.0
    for i in range(start, stop):
        row = 0.0
        for j in range(i + 1, path.shape[0]):
            row += bar_pair(path[i], path[j], shift, reach, extra)
        total += row
    return 2.0 * total
