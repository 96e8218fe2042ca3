"""Inductance of current paths and coupling coefficients of an array."""

from __future__ import annotations

from typing import get_args

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import Progress
from coilarray.constants import MU_0
from coilarray.electromagnetics.field import Source, as_conductors
from coilarray.electromagnetics.kernels.bars import bar_self, filament_pair, parallel_bars
from coilarray.electromagnetics.neumann import BYTES_A_PAIR, path_sums
from coilarray.electromagnetics.neumann import Accuracy as Accuracy
from coilarray.errors import LARGEST, GeometryError
from coilarray.geometry import Array, Conductor
from coilarray.geometry.conductor import SMALLEST
from coilarray.geometry.rules import require_apart

_SCALE = MU_0 / (4 * np.pi)
_SHORT = 1e-3  # length over distance below which a short series is more accurate than the closed forms
_UNLIKE = 1e8  # ratio of two bar sizes above which no digit may be right


def straight_filaments(p1: npt.ArrayLike, p2: npt.ArrayLike, q1: npt.ArrayLike, q2: npt.ArrayLike) -> float:
    """Compute the mutual inductance of two straight thin filaments in H.

    The filaments p1–p2 and q1–q2, points (3,) in m, may lie in any position. The sign follows their
    directions. A filament of length zero, or two filaments that overlap on one line, raise a
    GeometryError.

    Closed form of Campbell (Phys. Rev. 5, 452, 1915). See also Grover, Inductance Calculations
    (1946), ch. 7. The closed form loses digits if one filament is shorter than a thousandth of
    their distance. Then the exact integral over the longer filament is integrated over the shorter
    by the two-point Gauss rule, to 1e-11.

    >>> M = straight_filaments([0, 0, 0], [1, 0, 0], [0, 0.1, 0], [1, 0.1, 0])
    >>> round(M * 1e9, 6)
    418.647078
    """
    ends = (("first", p1, p2), ("second", q1, q2))
    first, second = (Conductor(np.array((start, end)), name=f"the {which} filament") for which, start, end in ends)
    (l1,), (l2,) = first.lengths, second.lengths
    u = (first.vertices[1] - first.vertices[0]) / l1
    v = (second.vertices[1] - second.vertices[0]) / l2
    short, long = sorted((first, second), key=lambda path: float(path.lengths[0]))
    (start, end), (at, other) = short.vertices, long.vertices
    part = np.clip(((start + end) / 2 - at) @ (other - at) / long.lengths[0] ** 2, 0.0, 1.0)
    if short.lengths[0] < _SHORT * np.linalg.norm(at + part * (other - at) - (start + end) / 2):
        points = (start + end) / 2 + np.array([[-1.0], [1.0]]) * (end - start) / np.sqrt(12)  # Gauss points
        ways = np.linalg.norm(points[:, None] - long.vertices, axis=-1).sum(axis=1)
        mean = (2 * np.arctanh(long.lengths[0] / ways)).mean()
        return float(_SCALE * (u @ v) * short.lengths[0] * mean)
    integral = filament_pair(tuple(u), l1, tuple(second.vertices[0] - first.vertices[0]), tuple(v), l2)
    if not np.isfinite(integral):
        raise GeometryError("the two filaments overlap on one line: their mutual inductance is infinite.")
    return float(_SCALE * integral)


def rectangular_bars(
    size_1: tuple[float, float, float],
    size_2: tuple[float, float, float] | None = None,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> float:
    """Compute the partial inductance of parallel rectangular bars in H.

    The bars have a uniform current density. `size_1` and `size_2` are length, width and thickness
    in m. `offset` leads from the corner of the first bar to the corner of the second along these,
    in m. A single bar gives its self-inductance. Sizes outside 1e-30 to 1e30 m or with a ratio
    above 1e8, a longest side below about 1e-5 of the extent of the pair, and an offset beyond 1e30
    m raise a GeometryError.

    This is the quantity of Hoer & Love, J. Res. NBS 69C, 127 (1965), whose closed form loses about
    (length/width)⁴ digits. The relative error is 1e-10 if all sizes are within a factor of 10, 1e-7
    within 1e4, and 1e-4 at worst.

    >>> round(rectangular_bars((1.0, 0.1, 0.1)) * 1e9, 6)
    570.425359
    """
    for size in (size_1, size_2 or size_1):
        if len(size) != 3 or not all(SMALLEST <= value <= LARGEST for value in size):
            raise GeometryError(
                f"length, width and thickness of a bar must be positive, {SMALLEST:g} to {LARGEST:g} m; got {size}."
            )
    if len(offset) != 3 or not all(abs(value) <= LARGEST for value in offset):
        raise GeometryError(
            f"the offset between two bars must be finite, three numbers up to {LARGEST:g} m; got {offset}."
        )
    sizes = np.array([size_1, size_2 or size_1], dtype=np.float64)
    # ∬ dV dV'/R is the same along any axis. The kernel keeps its digits where the bars are longest.
    order = np.roll(np.arange(3), -int(np.argmax(sizes.prod(axis=0))))
    areas = sizes[:, 1:].prod(axis=1).prod() / sizes[:, order[1:]].prod(axis=1).prod()
    apart = np.abs(np.asarray(offset, dtype=np.float64) + (sizes[1] - sizes[0]) / 2) if size_2 else np.zeros(3)
    distance = float(np.linalg.norm(apart))
    if distance > sizes.max() / _SHORT:  # mean of 1/R to second order in size over distance
        moments = (sizes**2).sum(axis=0) / 12
        mean = (1 + moments @ (3 * (apart / distance) ** 2 - 1) / (2 * distance**2)) / distance
        return float(_SCALE * sizes[:, 0].prod() * mean)
    extent = np.linalg.norm(apart + sizes.sum(axis=0) / 2)
    if sizes.max() > _UNLIKE * sizes.min() or extent**2 > _UNLIKE**1.25 * sizes[:, order[0]].prod():
        raise GeometryError(
            f"the sizes of the bars differ too much to be computed; got {size_1} and {size_2 or size_1} m."
        )
    if size_2 is None:
        return float(_SCALE * bar_self(*sizes[0, order]) / areas)
    across_up_along = np.roll(np.asarray(offset, dtype=np.float64)[order], -1)
    return float(_SCALE * parallel_bars(*sizes[:, order].ravel(), *across_up_along) / areas)


def self_inductance(source: Source) -> FloatArray:
    """Compute the self-inductance of every current path in H.

    Parameters
    ----------
    source : Array, Conductor, polyline or sequence of them
        See `coilarray.electromagnetics.field.as_conductors`. Every segment needs a cross-section.

    Returns
    -------
    ndarray, shape (paths,)
        Self-inductances in H. A thin filament, whose self-inductance is infinite, raises a
        GeometryError.
    """
    conductors = as_conductors(source)
    each = np.arange(len(conductors))
    return np.diag(_matrix(conductors, each, each, "full")).copy()


def mutual_inductance(first: Source, second: Source, *, accuracy: Accuracy = "full") -> FloatArray:
    """Compute the mutual inductances between two sources in H.

    Parameters
    ----------
    first, second : Array, Conductor, polyline or sequence of them
        Current paths, also thin filaments. Two filaments that overlap on one line raise a
        GeometryError.
    accuracy : {"full", "screen"}
        ``full`` reaches 1e-6, ``screen`` is quicker, see `coilarray.inductance_matrix`.

    Returns
    -------
    ndarray, shape (paths of first, paths of second)
        Mutual inductances in H. More pairs than fit into memory raise a MemoryLimitError.

    Examples
    --------
    >>> hexagon = [[np.cos(k * np.pi / 3), np.sin(k * np.pi / 3), 0] for k in range(7)]
    >>> lifted = [[x, y, 0.1] for x, y, z in hexagon]
    >>> round(float(mutual_inductance([hexagon], [lifted])[0, 0]) * 1e6, 4)
    2.6301
    """
    a, b = as_conductors(first), as_conductors(second)
    _require_memory(len(a) + len(b), len(a) * len(b))
    rows, columns = np.indices((len(a), len(b)))
    return _matrix(a + b, rows.ravel(), len(a) + columns.ravel(), accuracy)[: len(a), len(a) :]


def pair_inductance(source: Source, first: IntArray, second: IntArray, *, accuracy: Accuracy = "full") -> FloatArray:
    """Compute the mutual inductance of selected pairs in H."""
    M = _matrix(tuple(as_conductors(source)), first, second, accuracy)[first, second]
    return np.asarray(M)


def inductance_matrix(
    source: Source, *, accuracy: Accuracy = "full", allow_overlaps: bool = False, progress: Progress | None = None
) -> FloatArray:
    """Compute the inductance matrix of current paths in H.

    Neumann's integral is averaged over the cross-sections. Pairs of equal shape at equal offset,
    layers that mirror each other included, are computed once (`coilarray.electromagnetics.neumann`).

    The 1e-6 holds for traces wider than thick, with gaps of a quarter of their width or more and
    sides of a few widths, as a convergence study shows. Shorter sides or narrower gaps cost up to
    2e-5, also in a single turn of wide copper, and copper thicker than wide costs more. Traces run
    from vertex to vertex with square ends. The true, mitred corner of a trace as wide as a tenth of
    its turns changes L by some 1e-3.

    Parameters
    ----------
    source : Array, Conductor, polyline or sequence of them
        Current paths. Every segment needs a cross-section, with a uniform current density (direct
        current).
    accuracy : {"full", "screen"}
        ``full`` reaches 1e-6 of L and k. ``screen`` takes a tenth of the time, for searches whose
        results are computed again, see `Accuracy`.
    allow_overlaps : bool
        If True, also compute copper that overlaps other copper, as if each path were insulated.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    ndarray, shape (paths, paths)
        Symmetric matrix in H with the self-inductances on the diagonal. Positive M means that
        currents in the direction of the paths link the same way. A thin filament, or traces that
        overlap on a layer, of two paths or two turns of one, as `coilarray.geometry.check_rules`
        measures it, raise a GeometryError, more paths than fit into memory a MemoryLimitError.

    Examples
    --------
    >>> square = [[0, 0, 0], [1e-2, 0, 0], [1e-2, 1e-2, 0], [0, 1e-2, 0], [0, 1e-4, 0]]
    >>> loop = Conductor(square, 0.15e-3, 35e-6)
    >>> round(float(inductance_matrix(loop)[0, 0]) * 1e9, 2)
    37.64
    """
    conductors = as_conductors(source)
    _require_memory(len(conductors), len(conductors) * (len(conductors) + 1) // 2)
    if not allow_overlaps:
        if isinstance(source, Array):  # a bent board does not meet itself
            require_apart(source.flat_conductors(), source.stackup)
        else:
            require_apart(conductors)
    return _matrix(conductors, *np.triu_indices(len(conductors)), accuracy, progress)


def coupling_matrix(inductance: npt.ArrayLike) -> FloatArray:
    """Compute the coupling coefficients k_ij = M_ij/√(L_i L_j).

    Parameters
    ----------
    inductance : array_like, shape (n, n)
        Symmetric inductance matrix in H. One that is not square and finite with a positive diagonal
        raises a ValueError.

    Returns
    -------
    ndarray, shape (n, n)
        Dimensionless coefficients with a unit diagonal.

    Examples
    --------
    >>> coupling_matrix([[4e-6, 1e-6], [1e-6, 1e-6]])
    array([[1. , 0.5],
           [0.5, 1. ]])
    """
    L = np.asarray(inductance, dtype=np.float64)
    if L.ndim != 2 or L.shape[0] != L.shape[1]:
        raise ValueError(f"an inductance matrix must be square; got shape {L.shape}.")
    if not np.isfinite(L).all():
        raise ValueError("an inductance matrix must be finite; at least one entry is not.")
    diagonal = np.diag(L)
    if not (diagonal > 0).all():
        raise ValueError(f"every self-inductance must be positive; got {diagonal.min()} H.")
    root = np.sqrt(diagonal)
    k = L / np.outer(root, root)
    np.fill_diagonal(k, 1.0)
    return np.asarray(k)


def _require_memory(paths: int, pairs: int) -> None:
    require_memory(
        BYTES_A_PAIR * pairs + 8.0 * paths**2, f"the inductance matrix of {paths} paths", "compute it in pieces"
    )


def _matrix(
    conductors: tuple[Conductor, ...],
    first: IntArray,
    second: IntArray,
    accuracy: Accuracy,
    progress: Progress | None = None,
) -> FloatArray:
    """Symmetric inductance matrix in H, zero except for the wanted pairs."""
    if accuracy not in get_args(Accuracy):
        raise GeometryError(f"accuracy must be one of {', '.join(get_args(Accuracy))}; got {accuracy!r}.")
    values = _SCALE * path_sums(conductors, first, second, accuracy, progress=progress)
    infinite = np.flatnonzero(~np.isfinite(values))
    if len(infinite):
        i, j = first[infinite[0]], second[infinite[0]]
        raise GeometryError(
            f"{conductors[i].name} and {conductors[j].name} overlap on one line, where the mutual inductance of thin "
            "filaments is infinite."
        )
    L = np.zeros((len(conductors), len(conductors)))
    L[first, second] = L[second, first] = values
    return L
