"""Flux density B of polylines on an NVIDIA GPU.

The sum of `kernels.segments` with a thread per point, by `numba.cuda` of numba-cuda (extra
``cuda``) or else numba's own, deprecated target. It has run in numba's simulator only, never on a
GPU.
"""

from __future__ import annotations

import math

import numpy as np
from numba import cuda

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.electromagnetics.kernels.segments import ON_WIRE
from coilarray.errors import MissingDependencyError

_THREADS = 128  # in a block
_POINTS = 1 << 22  # at once: 0.2 GB of the GPU's memory


@cuda.jit
def _sum_segments(
    points: FloatArray, vertices: FloatArray, starts: IntArray, weights: FloatArray, field: FloatArray
) -> None:
    """Sum the field of segments at one point per thread."""
    i = cuda.grid(1)  # type: ignore[attr-defined]
    if i >= points.shape[0]:
        return
    x, y, z = points[i, 0], points[i, 1], points[i, 2]
    bx, by, bz = 0.0, 0.0, 0.0
    for c in range(starts.shape[0] - 1):
        first = starts[c]
        ux, uy, uz = x - vertices[first, 0], y - vertices[first, 1], z - vertices[first, 2]
        a = math.sqrt(ux * ux + uy * uy + uz * uz)
        for s in range(first, starts[c + 1] - 1):
            dx = vertices[s + 1, 0] - vertices[s, 0]
            dy = vertices[s + 1, 1] - vertices[s, 1]
            dz = vertices[s + 1, 2] - vertices[s, 2]
            vx, vy, vz = ux - dx, uy - dy, uz - dz
            b = math.sqrt(vx * vx + vy * vy + vz * vz)
            length2 = dx * dx + dy * dy + dz * dz
            dot = ux * vx + uy * vy + uz * vz
            cx, cy, cz = dy * uz - dz * uy, dz * ux - dx * uz, dx * uy - dy * ux
            c2 = cx * cx + cy * cy + cz * cz
            if dot >= 0.0:
                factor = weights[c] * (a + b) / (a * b * (a * b + dot)) if a * b > 0.0 else 0.0
            elif c2 > (ON_WIRE * length2) ** 2:
                factor = weights[c] * (a + b) * (a * b - dot) / (a * b * c2)
            else:
                factor = 0.0
            bx += factor * cx
            by += factor * cy
            bz += factor * cz
            # The next segment begins here, but its u is taken from the vertex. Differences would
            # add up roundings.
            ux, uy, uz = x - vertices[s + 1, 0], y - vertices[s + 1, 1], z - vertices[s + 1, 2]
            a = b
    field[i, 0], field[i, 1], field[i, 2] = bx, by, bz


def magnetic_field_on_gpu(
    points: FloatArray, vertices: FloatArray, starts: IntArray, weights: FloatArray
) -> FloatArray:
    """Compute B in T as `kernels.segments.add_magnetic_field`, or raise MissingDependencyError."""
    if not cuda.is_available():  # type: ignore[no-untyped-call]
        raise MissingDependencyError(
            "backend='cuda' needs an NVIDIA GPU, its driver, the CUDA toolkit and the extra cuda; numba finds no GPU. "
            "Use backend='cpu'."
        )
    on_gpu = [cuda.to_device(np.ascontiguousarray(array)) for array in (vertices, starts, weights)]
    field = np.empty_like(points)
    for start in range(0, len(points), _POINTS):
        part = cuda.to_device(np.ascontiguousarray(points[start : start + _POINTS]))
        out = cuda.device_array(part.shape, dtype=np.float64)
        _sum_segments[-(-len(part) // _THREADS), _THREADS](part, *on_gpu, out)
        field[start : start + _POINTS] = out.copy_to_host()
    return field
