"""Current paths of any description, their magnetic field and vector potential."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import Any, Literal, Protocol, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import Progress, cores, ranges, run_blocks
from coilarray.constants import MU_0
from coilarray.electromagnetics.kernels.segments import add_magnetic_field, add_vector_potential
from coilarray.errors import LARGEST, GeometryError
from coilarray.geometry import Conductor

Backend = Literal["cpu", "cuda"]
_BLOCK = 512  # 512 points of seven arrays fit a 32 KiB first-level cache
# Blocks per task: enough to outweigh the hand-over to a thread, fewer for idle cores.
_BLOCKS_A_TASK, _TASKS_A_CORE = 16, 4
# Memory beside the points: the field and the mask of finite points. A grid also needs its
# coordinates and points.
_BYTES_A_POINT, _BYTES_A_GRID_POINT = 27.0, 48.0
_LARGEST_CURRENT = 1e30  # A; with `LARGEST` every field stays in the range of float64
_IN_PIECES = "compute it in pieces"
_Paths = tuple[FloatArray, IntArray, FloatArray]  # vertices, starts and weights µ0 I/4π, see `kernels.segments`


class HasConductors(Protocol):
    """Spiral, coil, array or design."""

    def conductors(self) -> tuple[Conductor, ...]:
        """Return the current paths."""


Source: TypeAlias = (  # current paths: spiral, coil, array, design, conductor, polyline (n + 1, 3) in m, or several
    HasConductors | Conductor | npt.NDArray[np.float64] | Sequence[HasConductors | Conductor | npt.ArrayLike]
)


def as_conductors(source: Source, *, flat: bool = False) -> tuple[Conductor, ...]:
    """Return the current paths of any coil description, arrays in m as thin filaments.

    `flat` gives those of the flat boards, before they are bent.
    """
    items: list[Any]
    if isinstance(source, Conductor) or hasattr(source, "conductors"):
        items = [source]
    elif not isinstance(source, Iterable) or isinstance(source, str):
        raise GeometryError(
            "current paths must be a Spiral, Coil, Array, Design or Conductor, points, or a list of them; "
            f"got {source!r:.60}."
        )
    else:
        items = [source] if isinstance(source, np.ndarray) and source.ndim == 2 else list(source)
    if not items:
        raise GeometryError("at least one current path is needed; got none.")
    if not isinstance(items[0], Conductor) and not hasattr(items[0], "conductors") and np.ndim(items[0]) == 1:
        items = [items]
    found: list[Conductor] = []
    for number, item in enumerate(items, start=1):
        paths = getattr(item, "conductors", None)
        if flat:
            paths = getattr(item, "flat_conductors", paths)
        if isinstance(item, Conductor):
            found.append(item)
        else:
            found += [Conductor(item, name=f"path {number}")] if paths is None else paths()
    return tuple(found)


def require_level(path: Conductor, result: str) -> None:
    """Refuse a path whose widths are tilted, for a result that needs a flat board."""
    if not path.is_level:
        raise GeometryError(
            f"{result} is computed for flat boards only; the widths of {path.name} are tilted against the x-y plane."
        )


def magnetic_field(
    source: Source,
    points: npt.ArrayLike,
    currents: npt.ArrayLike = 1.0,
    *,
    progress: Progress | None = None,
    backend: Backend = "cpu",
) -> FloatArray:
    """Compute the magnetic flux density of current paths in T.

    Exact for straight segments (Hanson & Hirshman, Phys. Plasmas 9, 4410, 2002). A point nearer to
    a segment than 1e-12 of its length counts as on the segment and gets no contribution from it.
    This is the mean of the field around the wire.

    Parameters
    ----------
    source : Array, Conductor, polyline or sequence of them
        Current paths, see `as_conductors`. Each segment acts as a thin filament on its centre line.
    points : array_like, shape (..., 3)
        Positions in m where the field is evaluated.
    currents : array_like, shape (paths,) or scalar
        Currents in A, positive in the direction of the paths.
    progress : callable, optional
        Called with (done, total) as the work goes on.
    backend : {"cpu", "cuda"}
        Device that computes: all cores of the processor, or an NVIDIA GPU through numba.cuda, whose
        absence raises a MissingDependencyError.

    Returns
    -------
    ndarray, shape (..., 3)
        Flux density B in free space in T. Points or currents of a wrong shape or not finite raise a
        GeometryError, more points than fit into memory a MemoryLimitError.

    Examples
    --------
    >>> loop = [[np.cos(t), np.sin(t), 0] for t in np.linspace(0, 2 * np.pi, 721)]
    >>> B = magnetic_field([loop], [0, 0, 0])
    >>> bool(abs(B[2] / (MU_0 / 2) - 1) < 1e-4)
    True
    """
    where, paths = _checked(source, points, currents)
    if backend == "cuda":
        from coilarray.electromagnetics.kernels.cuda_segments import magnetic_field_on_gpu

        return magnetic_field_on_gpu(where.reshape(-1, 3), *paths).reshape(where.shape)
    if backend != "cpu":
        raise GeometryError(f"backend must be one of {', '.join(get_args(Backend))}; got {backend!r}.")
    return _on_processor(add_magnetic_field, where, paths, progress)


def vector_potential(
    source: Source, points: npt.ArrayLike, currents: npt.ArrayLike = 1.0, *, progress: Progress | None = None
) -> FloatArray:
    """Compute the magnetic vector potential of current paths in T·m.

    The result, shape (..., 3), is A in free space in T·m, in the Coulomb gauge for closed paths.
    The `source`, the `points` in m, the `currents` in A, `progress` and all errors are as in
    `magnetic_field`. The potential of a thin filament is infinite on it. A point nearer to a
    segment than 1e-12 of its length gets no contribution from that segment.
    """
    return _on_processor(add_vector_potential, *_checked(source, points, currents), progress)


def grid_points(x: npt.ArrayLike, y: npt.ArrayLike, z: npt.ArrayLike) -> FloatArray:
    """Return the points (nx, ny, nz, 3) of a rectangular grid in m.

    The coordinates `x`, `y` and `z` along each axis in m are (n,) or a scalar. Axes of a wrong
    shape or not finite raise a GeometryError, too many points a MemoryLimitError.
    """
    axes = [np.atleast_1d(np.asarray(axis, dtype=np.float64)) for axis in (x, y, z)]
    for name, axis in zip("xyz", axes, strict=True):
        if axis.ndim != 1 or not np.isfinite(axis).all():
            raise GeometryError(f"{name} must be one finite number, or n{name} of them; got shape {axis.shape}.")
    count = math.prod(axis.size for axis in axes)
    require_memory(_BYTES_A_GRID_POINT * count, f"a grid of {count} points", _IN_PIECES)
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def first_of_each(keys: Iterable[Hashable]) -> tuple[list[int], IntArray]:
    """Places of the first of all equal keys, and their number for each key."""
    known: dict[Hashable, int] = {}
    number = np.array([known.setdefault(key, len(known)) for key in keys], dtype=np.int64)
    return np.unique(number, return_index=True)[1].tolist(), number


def _checked(source: Source, points: npt.ArrayLike, currents: npt.ArrayLike) -> tuple[FloatArray, _Paths]:
    """Check points and currents, and join the paths that carry a current."""
    conductors = as_conductors(source)
    try:
        where = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError):
        raise GeometryError("points must be numbers of shape (..., 3).") from None
    if where.ndim == 0 or where.shape[-1] != 3:
        raise GeometryError(f"points must have shape (..., 3); got {where.shape}.")
    require_memory(_BYTES_A_POINT * (where.size // 3), f"the field at {where.size // 3} points", _IN_PIECES)
    if not np.isfinite(where).all():
        raise GeometryError("points must be finite; at least one is not.")
    if where.size and max(where.max(), -where.min()) > LARGEST:
        raise GeometryError(f"points must be at most {LARGEST:g} m from the origin; at least one is not.")
    try:
        current = np.array(np.broadcast_to(np.asarray(currents, dtype=np.float64), (len(conductors),)))
    except (TypeError, ValueError):
        raise GeometryError(
            f"currents must be one number or {len(conductors)}, one a path; got shape {np.shape(currents)}."
        ) from None
    if not (np.abs(current) <= _LARGEST_CURRENT).all():  # also rejects NaN
        raise GeometryError(f"currents must be finite and at most {_LARGEST_CURRENT:g} A; at least one is not.")
    used = [c for c in range(len(conductors)) if current[c] != 0]
    vertices = np.concatenate([np.zeros((0, 3)), *(conductors[c].vertices for c in used)])
    starts = np.cumsum([0, *(len(conductors[c].vertices) for c in used)])
    weights = MU_0 / (4 * np.pi) * current[used]
    return where, (vertices, starts, weights)


def _on_processor(
    kernel: Callable[..., None], where: FloatArray, paths: _Paths, progress: Progress | None
) -> FloatArray:
    """Run a kernel over blocks of points on all cores."""
    points = where.reshape(-1, 3)
    field = np.zeros_like(points)
    if not len(paths[2]) or not field.size:
        return field.reshape(where.shape)

    def work(task: tuple[int, int]) -> None:
        for start, stop in ranges(task[1] - task[0], _BLOCK):
            rows = slice(task[0] + start, task[0] + stop)
            x, y, z = np.ascontiguousarray(points[rows].T)
            out = np.zeros((3, len(x)))
            kernel(x, y, z, *paths, out[0], out[1], out[2], np.empty(len(x)))
            field[rows] = out.T

    blocks = -(-len(field) // (_BLOCK * _TASKS_A_CORE * cores()))
    run_blocks(work, ranges(len(field), _BLOCK * min(blocks, _BLOCKS_A_TASK)), progress=progress)
    return field.reshape(where.shape)
