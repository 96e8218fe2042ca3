"""Magnetic field and vector potential of current paths."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from coilarray.blocks import Progress, ranges, run_blocks
from coilarray.conductors import Source, as_conductors
from coilarray.constants import MU_0
from coilarray.errors import GeometryError
from coilarray.kernels.segments import add_magnetic_field, add_vector_potential

FloatArray = npt.NDArray[np.float64]

# 512 points of seven arrays fit a 32 KiB first-level cache
_BLOCK = 512
# blocks a task: enough work to outweigh the hand-over to a thread
_BLOCKS_A_TASK = 16


def magnetic_field(
    source: Source, points: npt.ArrayLike, currents: npt.ArrayLike = 1.0, progress: Progress | None = None
) -> FloatArray:
    """Magnetic flux density B of current paths in free space.

    Parameters
    ----------
    source : CoilArray, Conductor, polyline or sequence of them
        See `coilarray.conductors.as_conductors`. Each segment acts as a thin filament on its centre line.
    points : array_like, shape (..., 3)
        In m.
    currents : array_like, shape (paths,) or scalar
        In A, in the direction of the paths.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    ndarray, shape (..., 3)
        In T.

    Raises
    ------
    GeometryError
        Points or currents of another shape, or that are not finite.

    Notes
    -----
    Exact for straight segments (Hanson & Hirshman, Phys. Plasmas 9, 4410, 2002). A point on a segment, nearer than
    1e-12 of its length, gets nothing from that segment: the mean of the field around the wire.

    Examples
    --------
    >>> loop = [[np.cos(t), np.sin(t), 0] for t in np.linspace(0, 2 * np.pi, 721)]
    >>> B = magnetic_field([loop], [0, 0, 0])
    >>> bool(abs(B[2] / (MU_0 / 2) - 1) < 1e-4)
    True
    """
    return _evaluate(add_magnetic_field, source, points, currents, progress)


def vector_potential(
    source: Source, points: npt.ArrayLike, currents: npt.ArrayLike = 1.0, progress: Progress | None = None
) -> FloatArray:
    """Magnetic vector potential A (Coulomb gauge for closed paths) of current paths in free space.

    Parameters
    ----------
    source, points, currents, progress
        As in `magnetic_field`.

    Returns
    -------
    ndarray, shape (..., 3)
        In T·m.

    Raises
    ------
    GeometryError
        As `magnetic_field`.

    Notes
    -----
    The potential of a thin filament is infinite on it. A point nearer to a segment than 1e-12 of its length gets
    nothing from that segment.
    """
    return _evaluate(add_vector_potential, source, points, currents, progress)


def grid_points(x: npt.ArrayLike, y: npt.ArrayLike, z: npt.ArrayLike) -> FloatArray:
    """Points of a rectangular grid.

    Parameters
    ----------
    x, y, z : array_like, shape (nx,), (ny,), (nz,) or scalar
        In m.

    Returns
    -------
    ndarray, shape (nx, ny, nz, 3)
        In m.
    """
    axes = (np.atleast_1d(np.asarray(axis, dtype=np.float64)) for axis in (x, y, z))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def _evaluate(
    kernel: Callable[..., None],
    source: Source,
    points: npt.ArrayLike,
    currents: npt.ArrayLike,
    progress: Progress | None,
) -> FloatArray:
    conductors = as_conductors(source)
    where = np.asarray(points, dtype=np.float64)
    if where.ndim == 0 or where.shape[-1] != 3:
        raise GeometryError(f"points must have shape (..., 3); got {where.shape}.")
    if not np.isfinite(where).all():
        raise GeometryError("points must be finite; at least one is not.")
    try:
        current = np.array(np.broadcast_to(np.asarray(currents, dtype=np.float64), (len(conductors),)))
    except ValueError:
        raise GeometryError(
            f"currents must be one number or {len(conductors)}, one a path; got shape {np.shape(currents)}."
        ) from None
    if not np.isfinite(current).all():
        raise GeometryError("currents must be finite; at least one is not.")
    used = [c for c in range(len(conductors)) if current[c] != 0]
    field = np.zeros((where.size // 3, 3))
    if not used or not field.size:
        return field.reshape(where.shape)
    vertices = np.concatenate([conductors[c].vertices for c in used])
    starts = np.cumsum([0, *(len(conductors[c].vertices) for c in used)])
    weights = MU_0 / (4 * np.pi) * current[used]
    flat = where.reshape(-1, 3)

    def work(task: tuple[int, int]) -> None:
        for start, stop in ranges(task[1] - task[0], _BLOCK):
            rows = slice(task[0] + start, task[0] + stop)
            x, y, z = np.ascontiguousarray(flat[rows].T)
            out = np.zeros((3, len(x)))
            kernel(x, y, z, vertices, starts, weights, out[0], out[1], out[2], np.empty(len(x)))
            field[rows] = out.T

    run_blocks(work, ranges(len(flat), _BLOCK * _BLOCKS_A_TASK), progress)
    return field.reshape(where.shape)
