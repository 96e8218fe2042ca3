"""Self and mutual inductance of current paths, and the coupling coefficients of an array."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from coilarray.blocks import Progress, cores, run_blocks
from coilarray.conductors import Source, as_conductors
from coilarray.constants import MU_0
from coilarray.errors import GeometryError
from coilarray.geometry import Conductor
from coilarray.kernels.bars import bar_self, parallel_bars
from coilarray.kernels.filaments import filament_pair
from coilarray.kernels.paths import mutual_sum, own_mutual_sum
from coilarray.kernels.turns import find_series, own_series_sum, series_members, series_rules, series_sum

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

Accuracy = Literal["full", "screen"]
"""``full``: 1e-6 of L and k. ``screen``: a tenth of the time for windings of many turns, for searches whose results
are computed again in full: 1e-4 of L, 5e-5 in k on the bundled boards, some 1e-4 for other weakly coupled windings, and
up to 1 % of k where windings lie on each other (tests/test_inductance_screen.py)."""

_SCALE = MU_0 / (4 * np.pi)
_SAME_PLACE = 1e-12  # of the sources' extent; offsets and shapes that differ by less are the same pair

OWN_REACH = 160.0
"""Widths up to which the cross-section counts within one path (tests/test_inductance_convergence.py)."""
MUTUAL_REACH = 40.0
"""Widths up to which the cross-section counts between two paths (tests/test_inductance_convergence.py)."""
# the same for screening: leaves out 1/(12·15²) = 4e-5 of a pair, and 5e-3 of one where coils overlap
_SCREEN_OWN_REACH, _SCREEN_MUTUAL_REACH = 15.0, 4.0


def straight_filaments(p1: npt.ArrayLike, p2: npt.ArrayLike, q1: npt.ArrayLike, q2: npt.ArrayLike) -> float:
    """Mutual inductance of two straight thin filaments in any position.

    Parameters
    ----------
    p1, p2, q1, q2 : array_like, shape (3,)
        Start and end of the first and the second filament in m.

    Returns
    -------
    float
        In H; the sign follows the directions.

    Raises
    ------
    GeometryError
        A filament of length zero, or two that run over each other on one line (infinite).

    Notes
    -----
    Closed form of Campbell (Phys. Rev. 5, 452, 1915); Grover, Inductance Calculations (1946), ch. 7.

    Examples
    --------
    >>> M = straight_filaments([0, 0, 0], [1, 0, 0], [0, 0.1, 0], [1, 0.1, 0])
    >>> round(M * 1e9, 6)
    418.647078
    """
    first, second = _filament(p1, p2, "first"), _filament(q1, q2, "second")
    (l1,), (l2,) = first.lengths, second.lengths
    u = (first.vertices[1] - first.vertices[0]) / l1
    v = (second.vertices[1] - second.vertices[0]) / l2
    arguments = [*first.vertices[0], *u, l1, *second.vertices[0], *v, l2]
    integral = filament_pair(*arguments)
    if not np.isfinite(integral):
        raise GeometryError("the two filaments run over each other on one line: their mutual inductance is infinite.")
    return float(_SCALE * integral)


def _filament(start: npt.ArrayLike, end: npt.ArrayLike, which: str) -> Conductor:
    return Conductor(np.stack((np.asarray(start), np.asarray(end))), name=f"the {which} filament")


def rectangular_bars(
    size_1: tuple[float, float, float],
    size_2: tuple[float, float, float] | None = None,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> float:
    """Partial inductance of two parallel rectangular bars, or of one bar, with uniform current density.

    Parameters
    ----------
    size_1, size_2 : tuple of float
        Length, width and thickness in m. Without `size_2` the self-inductance of the first bar.
    offset : tuple of float
        From the corner of the first bar to that of the second, along length, width and thickness, in m.

    Returns
    -------
    float
        In H.

    Raises
    ------
    GeometryError
        A size that is not positive and finite, or an offset that is not finite.

    Notes
    -----
    The quantity of Hoer & Love, J. Res. NBS 69C, 127 (1965), to 1e-11 relative (their closed form loses about
    (length/width)⁴ digits).

    Examples
    --------
    >>> round(rectangular_bars((1.0, 0.1, 0.1)) * 1e9, 6)
    570.425359
    """
    for size in (size_1, size_2 or size_1):
        if not all(np.isfinite(value) and value > 0 for value in size):
            raise GeometryError(f"length, width and thickness of a bar must be positive and finite; got {size}.")
    if not np.isfinite(offset).all():
        raise GeometryError(f"the offset between two bars must be finite; got {offset}.")
    if size_2 is None:
        return float(_SCALE * bar_self(*size_1))
    along, across, up = offset
    return float(_SCALE * parallel_bars(*size_1, *size_2, across, up, along))


def self_inductance(source: Source) -> FloatArray:
    """Self-inductance of every current path.

    Parameters
    ----------
    source : CoilArray, Conductor, polyline or sequence of them
        See `coilarray.conductors.as_conductors`. Every segment needs a cross-section.

    Returns
    -------
    ndarray, shape (paths,)
        In H.

    Raises
    ------
    GeometryError
        A thin filament: its self-inductance is infinite.
    """
    conductors = as_conductors(source)
    return np.diag(_matrix(conductors, [(i, i) for i in range(len(conductors))], "full")).copy()


def mutual_inductance(first: Source, second: Source, *, accuracy: Accuracy = "full") -> FloatArray:
    """Mutual inductance between every path of one source and every path of another.

    Parameters
    ----------
    first, second : CoilArray, Conductor, polyline or sequence of them
        Thin filaments are allowed.
    accuracy : {"full", "screen"}
        See `Accuracy`.

    Returns
    -------
    ndarray, shape (paths of first, paths of second)
        In H.

    Raises
    ------
    GeometryError
        Two thin filaments that run over each other on one line.

    Examples
    --------
    >>> hexagon = [[np.cos(k * np.pi / 3), np.sin(k * np.pi / 3), 0] for k in range(7)]
    >>> lifted = [[x, y, 0.1] for x, y, z in hexagon]
    >>> round(float(mutual_inductance([hexagon], [lifted])[0, 0]) * 1e6, 4)
    2.6301
    """
    a, b = as_conductors(first), as_conductors(second)
    wanted = itertools.product(range(len(a)), range(len(a), len(a) + len(b)))
    return _matrix(a + b, wanted, accuracy)[: len(a), len(a) :]


def inductance_matrix(source: Source, progress: Progress | None = None, *, accuracy: Accuracy = "full") -> FloatArray:
    """Inductance matrix of the paths: L_ii on the diagonal, M_ij off it.

    Parameters
    ----------
    source : CoilArray, Conductor, polyline or sequence of them
        Every segment needs a cross-section. The current density is uniform in it (direct current).
    progress : callable, optional
        Called with (done, total) as the work goes on.
    accuracy : {"full", "screen"}
        See `Accuracy`.

    Returns
    -------
    ndarray, shape (paths, paths)
        In H, symmetric. Positive M means that currents in the direction of the paths link the same way.

    Raises
    ------
    GeometryError
        A thin filament: its self-inductance is infinite.

    Notes
    -----
    Neumann's integral averaged over the cross-sections. Pairs of equal shapes at equal offsets are computed once,
    so identical coils on a lattice cost one evaluation a distinct offset. The rules are set for 1e-6 of L and of k for
    traces wider than thick, with gaps of a quarter of their width or more and sides of a few widths;
    `tests/test_inductance_convergence.py` holds the study. Shorter sides or narrower gaps than that cost up to 2e-5,
    copper thicker than wide more. Traces run from vertex to vertex with square ends: the true, mitred corner of a
    trace as wide as a tenth of its turns changes L by some 1e-3.

    Examples
    --------
    >>> square = [[0, 0, 0], [1e-2, 0, 0], [1e-2, 1e-2, 0], [0, 1e-2, 0], [0, 1e-4, 0]]
    >>> loop = Conductor(square, 0.15e-3, 35e-6)
    >>> round(float(inductance_matrix(loop)[0, 0]) * 1e9, 2)
    37.64
    """
    conductors = as_conductors(source)
    wanted = itertools.combinations_with_replacement(range(len(conductors)), 2)
    return _matrix(conductors, wanted, accuracy, progress)


def coupling_matrix(inductance: npt.ArrayLike) -> FloatArray:
    """Coupling coefficients k_ij = M_ij/√(L_i L_j) of an inductance matrix.

    Parameters
    ----------
    inductance : array_like, shape (n, n)
        In H, symmetric with a positive diagonal.

    Returns
    -------
    ndarray, shape (n, n)
        Dimensionless, ones on the diagonal.

    Raises
    ------
    ValueError
        A matrix that is not square or has a diagonal entry that is not positive.

    Examples
    --------
    >>> coupling_matrix([[4e-6, 1e-6], [1e-6, 1e-6]])
    array([[1. , 0.5],
           [0.5, 1. ]])
    """
    L = np.asarray(inductance, dtype=np.float64)
    if L.ndim != 2 or L.shape[0] != L.shape[1]:
        raise ValueError(f"an inductance matrix must be square; got shape {L.shape}.")
    diagonal = np.diag(L)
    if not (diagonal > 0).all():
        raise ValueError(f"every self-inductance must be positive; got {diagonal.min()} H.")
    root = np.sqrt(diagonal)
    k = L / np.outer(root, root)
    np.fill_diagonal(k, 1.0)
    return np.asarray(k)


def standing_for_all(path: Conductor, accuracy: Accuracy) -> tuple[IntArray, FloatArray]:
    """Segments whose weighted sum stands for that over a whole path.

    Parameters
    ----------
    path : Conductor
        Any.
    accuracy : {"full", "screen"}
        ``full`` takes every segment once; ``screen`` a few turns of a winding, for sums of what changes smoothly from
        turn to turn.

    Returns
    -------
    segments : ndarray, shape (n,)
        Their numbers.
    weights : ndarray, shape (n,)
        Adding up to the number of segments.
    """
    if accuracy == "full":
        return np.arange(len(path.lengths)), np.ones(len(path.lengths))
    series = find_series(_segment_table(path))
    return series_members(series, *series_rules(int(series[:, 2].max())))


@dataclass(frozen=True, eq=False)
class _Shape:
    """The segment table of a path that starts at the origin, shared by all its copies."""

    table: FloatArray
    is_filament: bool

    @cached_property
    def series(self) -> IntArray:
        """Sides of successive turns, see `coilarray.kernels.turns.find_series`."""
        return find_series(self.table)


def _segment_table(conductor: Conductor) -> FloatArray:
    """Rows of `coilarray.kernels.paths`, the first vertex moved to the origin."""
    vertices = conductor.vertices - conductor.vertices[0]
    steps = np.diff(vertices, axis=0)
    length = np.linalg.norm(steps, axis=1)
    u = steps / length[:, None]
    lateral = np.column_stack((-u[:, 1], u[:, 0], np.zeros(len(u))))
    across = np.linalg.norm(lateral, axis=1)
    vertical = across < 1e-9
    lateral[vertical], across[vertical] = (1.0, 0.0, 0.0), 1.0
    lateral /= across[:, None]
    return np.ascontiguousarray(
        np.column_stack((vertices[:-1], u, length, lateral, conductor.widths, conductor.thicknesses))
    )


def _shapes(conductors: tuple[Conductor, ...], quantum: float) -> tuple[list[_Shape], list[int], FloatArray]:
    """Distinct shapes (to `quantum` in m), the shape of every path, and the paths' starting points."""
    shapes: list[_Shape] = []
    known: dict[bytes, int] = {}
    of_path: list[int] = []
    for conductor in conductors:
        table = _segment_table(conductor)
        columns = np.column_stack((table[:, :3], table[:, 6:7], table[:, 10:12]))
        end = conductor.vertices[-1] - conductor.vertices[0]
        key = np.round(np.append(columns.ravel(), end) / quantum).astype(np.int64).tobytes()
        if key not in known:
            known[key] = len(shapes)
            shapes.append(_Shape(table, conductor.is_filament))
        of_path.append(known[key])
    return shapes, of_path, np.array([conductor.vertices[0] for conductor in conductors])


def _matrix(
    conductors: tuple[Conductor, ...],
    wanted: Iterable[tuple[int, int]],
    accuracy: Accuracy,
    progress: Progress | None = None,
) -> FloatArray:
    """Symmetric matrix of the wanted pairs of paths (i ≤ j) in H, zero elsewhere."""
    extent = float(np.ptp(np.concatenate([conductor.vertices for conductor in conductors]), axis=0).max())
    quantum = _SAME_PLACE * extent
    shapes, of_path, origin = _shapes(conductors, quantum)
    n = len(conductors)
    # every distinct (shape, shape, offset) once; M(i, j, d) = M(j, i, −d)
    pairs: dict[tuple[int, int, int, int, int], list[tuple[int, int]]] = {}
    shifts: dict[tuple[int, int, int, int, int], FloatArray] = {}
    for i, j in wanted:
        if i == j and conductors[i].is_filament:
            raise GeometryError(
                f"{conductors[i].name} has segments without a cross-section: the self-inductance of a thin filament "
                "is infinite; give widths and thicknesses."
            )
        a, b, shift = of_path[i], of_path[j], origin[j] - origin[i]
        x, y, z = np.round(shift / quantum).astype(np.int64).tolist()
        if (b, a, -x, -y, -z) < (a, b, x, y, z):
            a, b, x, y, z, shift = b, a, -x, -y, -z, -shift
        pairs.setdefault((a, b, x, y, z), []).append((i, j))
        shifts.setdefault((a, b, x, y, z), shift)
    blocks = []
    for key in pairs:
        rows = len(shapes[key[0]].table)
        parts = min(rows, 8 if accuracy == "full" and len(pairs) < 4 * cores() else 1)
        blocks += [(key, start, stop) for start, stop in _row_ranges(rows, parts)]
    if accuracy == "full":
        sums = run_blocks(lambda block: _block_sum(shapes, shifts, *block), blocks, progress)
    else:
        sums = run_blocks(lambda block: _screened_sum(shapes, shifts, block[0]), blocks, progress)
    totals = dict.fromkeys(pairs, 0.0)
    for (key, _, _), part in zip(blocks, sums, strict=True):
        totals[key] += part
    L = np.zeros((n, n))
    for key, places in pairs.items():
        for i, j in places:
            L[i, j] = L[j, i] = _SCALE * totals[key]
    if not np.isfinite(L).all():
        i, j = np.argwhere(~np.isfinite(L))[0].tolist()
        raise GeometryError(
            f"{conductors[i].name} and {conductors[j].name} run over each other on one line: "
            "the mutual inductance of thin filaments is infinite there."
        )
    return L


def _row_ranges(rows: int, parts: int) -> list[tuple[int, int]]:
    edges = np.linspace(0, rows, parts + 1).round().astype(int).tolist()
    return list(itertools.pairwise(edges))


def _block_sum(
    shapes: list[_Shape],
    shifts: dict[tuple[int, int, int, int, int], FloatArray],
    key: tuple[int, int, int, int, int],
    start: int,
    stop: int,
) -> float:
    a, b = shapes[key[0]].table, shapes[key[1]].table
    if key[0] == key[1] and key[2:] == (0, 0, 0):
        if shapes[key[0]].is_filament:
            return np.inf
        return float(own_mutual_sum(a, start, stop, OWN_REACH, 0) + _bars_alone(a[start:stop], np.ones(stop - start)))
    return float(mutual_sum(a, b, shifts[key], start, stop, MUTUAL_REACH, 0))


def _screened_sum(
    shapes: list[_Shape], shifts: dict[tuple[int, int, int, int, int], FloatArray], key: tuple[int, int, int, int, int]
) -> float:
    """All of a pair of paths by a few turns that stand for the others."""
    a, b = shapes[key[0]], shapes[key[1]]
    rules = series_rules(int(max(a.series[:, 2].max(), b.series[:, 2].max())))
    if key[0] == key[1] and key[2:] == (0, 0, 0):
        if a.is_filament:
            return np.inf
        rows, weights = series_members(a.series, *rules)
        return float(own_series_sum(a.table, a.series, _SCREEN_OWN_REACH, *rules) + _bars_alone(a.table[rows], weights))
    return float(series_sum(a.table, b.table, shifts[key], a.series, b.series, _SCREEN_MUTUAL_REACH, *rules))


def _bars_alone(rows: FloatArray, weights: FloatArray) -> float:
    """Weighted sum of ∬ dl·dl'/R of every bar with itself; equal ones are computed once."""
    sizes, which = np.unique(np.round(rows[:, [6, 10, 11]], 15), axis=0, return_inverse=True)
    counts = np.bincount(which.ravel(), weights)
    return float(sum(c * bar_self(*size) for size, c in zip(sizes, counts, strict=True)))
