"""Mutual inductance of current paths while some of them move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import Progress, ranges, run_blocks
from coilarray.constants import MU_0
from coilarray.electromagnetics.field import Source, as_conductors
from coilarray.electromagnetics.inductance import pair_inductance, self_inductance
from coilarray.electromagnetics.kernels.moving import moved_sums
from coilarray.electromagnetics.kernels.paths import INNER
from coilarray.electromagnetics.kernels.turns import find_series, series_members, series_rules
from coilarray.electromagnetics.neumann import segment_table
from coilarray.errors import GeometryError
from coilarray.geometry import Conductor, Pose

_DISAGREE = 2e-3  # of √(L L'), between the two rules for the turns; the better errs some 30 times less
_POSES_A_BLOCK, _EXACT_A_BLOCK = 16, 64


def moved_inductance(
    fixed: Source, moved: Source, poses: Sequence[Pose], *, progress: Progress | None = None
) -> FloatArray:
    """Compute the mutual inductances in H of fixed paths with moved ones.

    Parameters
    ----------
    fixed, moved : Array, Conductor, polyline or sequence of them
        Current paths. Those that move are given where they are before any pose.
    poses : sequence of Pose
        Poses of all moved paths together.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    ndarray, shape (poses, fixed paths, moved paths)
        Mutual inductances in H.

    Raises
    ------
    GeometryError
        No poses, or two thin filaments that overlap on one line.
    MemoryLimitError
        More values than `coilarray.compute.memory.allowed_memory` allows.

    Notes
    -----
    A few turns stand for a winding, with the weights of `coilarray.electromagnetics.kernels.turns`,
    and two filaments for the width of a trace. Where two sets of weights differ too much, as of
    windings nearer than a few pitches, the pair is computed by `coilarray.mutual_inductance`. The
    error is below 1e-4 of the larger self-inductance at distances of a trace width and more.

    Examples
    --------
    >>> import coilarray as ca
    >>> coil = ca.Spiral(6, 16e-3, 12, 0.15e-3, 0.15e-3)
    >>> M = moved_inductance(coil, coil, [Pose(z=z) for z in (2e-3, 5e-3, 10e-3)])
    >>> (M[:, 0, 0] * 1e6).round(3).tolist()
    [5.469, 2.564, 0.928]
    """
    first, second = as_conductors(fixed), as_conductors(moved)
    if not poses:
        raise GeometryError("at least one pose is needed; got none.")
    require_memory(24.0 * len(poses) * len(first) * len(second), f"inductances at {len(poses)} poses", "take fewer")
    tables, others = [_filaments(path) for path in first], [_filaments(path) for path in second]
    M, check = (np.zeros((len(poses), len(first), len(second))) for _ in range(2))

    def block(start: int, stop: int) -> None:
        out = np.zeros(2)
        for number in range(start, stop):
            rotation, shift = np.array(poses[number].rotation), poses[number].shift
            for i, table in enumerate(tables):
                for k, other in enumerate(others):
                    out[:] = 0.0
                    moved_sums(table, other, rotation, shift, out)
                    M[number, i, k], check[number, i, k] = MU_0 / (4 * np.pi) * out

    pieces = ranges(len(poses), _POSES_A_BLOCK)
    run_blocks(lambda piece: block(*piece), list(pieces), progress=progress)
    thick = not any(path.is_filament for path in (*first, *second))
    scale = np.sqrt(np.outer(self_inductance(first), self_inductance(second))) if thick else np.abs(M).max()
    doubtful = ~(np.abs(M - check) <= _DISAGREE * scale)
    number, i, k = np.nonzero(doubtful)
    for start, stop in ranges(len(number), _EXACT_A_BLOCK):
        where = number[start:stop], i[start:stop], k[start:stop]
        M[where] = _exact(first, second, poses, *where)
    return M


def _exact(
    first: Sequence[Conductor], second: Sequence[Conductor], poses: Sequence[Pose],
    number: IntArray, i: IntArray, k: IntArray,
) -> FloatArray:  # fmt: skip
    """Mutual inductances of single pairs in H, segment by segment."""
    there = [second[path].posed(poses[pose]) for pose, path in zip(number.tolist(), k.tolist(), strict=True)]
    return pair_inductance([*first, *there], i, len(first) + np.arange(len(there)))


def _filaments(path: Conductor) -> FloatArray:
    """Rows of `kernels.moving` that stand for a path."""
    table = segment_table(path)
    series = find_series(table)
    members, weights, check, counts = series_rules(int(series[:, 2].max()))
    rows, weight = series_members(series, members, weights, check, counts)
    _, worse = series_members(series, members, check, check, counts)
    chosen = table[rows]
    chosen[:, :3] += path.vertices[0]
    aside = INNER * chosen[:, 10:11] * chosen[:, 7:10]
    if not aside.any():
        return np.ascontiguousarray(np.column_stack((chosen[:, :7], weight, worse)))
    sides = [np.column_stack((chosen[:, :3] + s * aside, chosen[:, 3:7], weight / 2, worse / 2)) for s in (1, -1)]
    return np.ascontiguousarray(np.concatenate(sides))
