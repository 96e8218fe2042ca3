"""Exact partial inductance of parallel rectangular bars.

The bars have a uniform current density, and nothing cancels. The closed form of Hoer & Love (J. Res. NBS 69C, 127,
1965) loses (length/width)⁴ digits in float64. The same quantity is the mean of the filament formula over both
cross-sections. It is a two-dimensional integral over the lateral offset (x, y) with a weight that is piecewise linear
in each. It is computed cell by cell. Next to the logarithmic singularity at zero offset polar coordinates make the
integrand smooth.
"""

from __future__ import annotations

import math

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.electromagnetics.kernels.compiled import kernel
from coilarray.electromagnetics.kernels.filaments import parallel_filaments

_GAUSS_16 = np.polynomial.legendre.leggauss(16)
_NODES, _WEIGHTS = np.ascontiguousarray(_GAUSS_16[0]), np.ascontiguousarray(_GAUSS_16[1])


@kernel
def _corner_cell(
    x_end: float, y_end: float, ax: float, bx: float, ay: float, by: float,
    offset: float, length_1: float, length_2: float,
) -> float:  # fmt: skip
    """Integrate (ax + bx x)(ay + by y) K from the origin to (x_end, y_end).

    K is the filament integral at the lateral distance √(x² + y²). In polar coordinates there are two triangles on
    either side of the diagonal, each with dθ/cos θ as variable, and r = R τ³ so that r ln r becomes smooth.
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
        for i in range(_NODES.shape[0]):
            u = 0.5 * u_end * (1.0 + _NODES[i])
            tangent = math.sinh(u)
            secant = math.sqrt(1.0 + tangent * tangent)
            radius = along * secant
            cos_axis, sin_axis = 1.0 / secant, tangent / secant
            angle_weight = 0.5 * u_end * _WEIGHTS[i] / secant  # dθ = du / cosh u
            c = cos_axis if side == 0 else sin_axis
            s = sin_axis if side == 0 else cos_axis
            inner = 0.0
            for j in range(_NODES.shape[0]):
                tau = 0.5 * (1.0 + _NODES[j])
                r = radius * tau * tau * tau
                x = math.copysign(r * c, x_end)
                y = math.copysign(r * s, y_end)
                density = (ax + bx * x) * (ay + by * y)
                inner += (
                    0.5 * _WEIGHTS[j] * 3.0 * tau * tau * radius * r * density
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
    for i in range(_NODES.shape[0]):
        x = 0.5 * (x0 + x1) + 0.5 * (x1 - x0) * _NODES[i]
        for j in range(_NODES.shape[0]):
            y = 0.5 * (y0 + y1) + 0.5 * (y1 - y0) * _NODES[j]
            total += (
                _WEIGHTS[i] * _WEIGHTS[j] * (ax + bx * x) * (ay + by * y)
                * parallel_filaments(math.hypot(x, y), offset, length_1, length_2)
            )  # fmt: skip
    return 0.25 * (x1 - x0) * (y1 - y0) * total


@kernel
def _offset_density(
    start_1: float, size_1: float, start_2: float, size_2: float, edges: FloatArray, lines: FloatArray
) -> None:
    """Density of x2 − x1 for variables that are uniform on two intervals.

    It has 4 edges and the 3 lines a + b x between them.
    """
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
    """Mean of ∬ dz dz'/R over the cross-sections of two bars along z.

    Bar 1 is [0, width_1] × [0, thickness_1] × [0, length_1]. Bar 2 starts at (dx, dy, dz).
    """
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
