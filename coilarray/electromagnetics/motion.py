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

_DISAGREE = 1e-3  # of √(L L'), between the two rules for the turns; the better errs some 30 times less
_NEAR_SIZES = 12.0  # sides of a bar, and
_NEAR_BREADTHS = 0.6  # breadths of a winding whose turns are not all taken: nearer pairs are summed bar by bar
_ALL = 5  # turns of a series up to which all are taken
_POSES_A_BLOCK, _EXACT_A_BLOCK = 16, 64


def moved_inductance(
    fixed: Source, moved: Source, poses: Pose | Sequence[Pose], *, progress: Progress | None = None
) -> FloatArray:
    """Compute the mutual inductances in H of fixed paths with moved ones.

    Parameters
    ----------
    fixed, moved : Array, Conductor, polyline or sequence of them
        Current paths. Those that move are given where they are before any pose.
    poses : Pose or sequence of Pose
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
    and two filaments for the cross-section of a trace. Pairs nearer than 12 widths or 0.6 breadths
    of a winding, and pairs of which two sets of weights differ, are computed by
    `coilarray.mutual_inductance`. The error is below 1e-4 of the larger self-inductance at distances
    of a trace width and more, for traces wider than thick.

    Examples
    --------
    >>> import coilarray as ca
    >>> coil = ca.Spiral(6, 16e-3, 12, 0.15e-3, 0.15e-3)
    >>> M = moved_inductance(coil, coil, [Pose(z=z) for z in (2e-3, 5e-3, 10e-3)])
    >>> (M[:, 0, 0] * 1e6).round(3).tolist()
    [5.469, 2.564, 0.928]
    """
    first, second = as_conductors(fixed), as_conductors(moved)
    poses = [poses] if isinstance(poses, Pose) else list(poses)
    wrong = [pose for pose in poses if not isinstance(pose, Pose)]
    if not poses or wrong:
        raise GeometryError(f"poses must be one Pose or more; got {f'{wrong[0]!r:.60}' if wrong else 'none'}.")
    require_memory(24.0 * len(poses) * len(first) * len(second), f"inductances at {len(poses)} poses", "take fewer")
    tables, near = zip(*map(_filaments, first), strict=True)
    others, near_too = zip(*map(_filaments, second), strict=True)
    sums = np.zeros((len(poses), len(first), len(second), 3))
    sums[..., 2] = np.inf

    def block(start: int, stop: int) -> None:
        for number in range(start, stop):
            rotation, shift = np.array(poses[number].rotation), poses[number].shift
            for i, table in enumerate(tables):
                for k, other in enumerate(others):
                    moved_sums(table, other, rotation, shift, sums[number, i, k])

    run_blocks(lambda piece: block(*piece), list(ranges(len(poses), _POSES_A_BLOCK)), progress=progress)
    M, check = MU_0 / (4 * np.pi) * np.moveaxis(sums[..., :2], -1, 0)
    thick = not any(path.is_filament for path in (*first, *second))
    scale = np.sqrt(np.outer(self_inductance(first), self_inductance(second))) if thick else np.abs(M).max()
    trusted = (np.abs(M - check) <= _DISAGREE * scale) & (sums[..., 2] > np.maximum.outer(near, near_too))
    number, i, k = np.nonzero(~trusted)
    for start, stop in ranges(len(number), _EXACT_A_BLOCK):
        where = number[start:stop], i[start:stop], k[start:stop]
        M[where] = _exact(first, second, poses, *where)
    return np.asarray(M)


def _exact(
    first: Sequence[Conductor], second: Sequence[Conductor], poses: Sequence[Pose],
    number: IntArray, i: IntArray, k: IntArray,
) -> FloatArray:  # fmt: skip
    """Mutual inductances of single pairs in H, segment by segment."""
    there = [second[path].posed(poses[pose]) for pose, path in zip(number.tolist(), k.tolist(), strict=True)]
    return pair_inductance([*first, *there], i, len(first) + np.arange(len(there)))


def _filaments(path: Conductor) -> tuple[FloatArray, float]:
    """Rows of `kernels.moving` that stand for a path, and the distance in m above which they do."""
    table = segment_table(path)
    series = find_series(table)
    few = series[series[:, 2] > _ALL]
    last = few[:, 0] + (few[:, 2] - 1) * few[:, 1]
    breadth = np.linalg.norm(path.vertices[last] - path.vertices[few[:, 0]], axis=1).max(initial=0.0)
    near = max(_NEAR_SIZES * float(table[:, 10:12].max()), _NEAR_BREADTHS * float(breadth))
    members, weights, check, counts = series_rules(int(series[:, 2].max()))
    rows, weight = series_members(series, members, weights, check, counts)
    _, worse = series_members(series, members, check, check, counts)
    chosen = table[rows]
    chosen[:, :3] += path.vertices[0]
    # across a bar 1/R is harmonic: only the difference of both variances counts
    variance = chosen[:, 10] ** 2 - chosen[:, 11] ** 2
    normal = np.cross(chosen[:, 3:6], chosen[:, 7:10])
    direction = np.where(variance[:, None] > 0, chosen[:, 7:10], normal)
    aside = INNER * np.sqrt(np.abs(variance))[:, None] * direction
    if not aside.any():
        return np.ascontiguousarray(np.column_stack((chosen[:, :7], weight, worse))), near
    sides = [np.column_stack((chosen[:, :3] + s * aside, chosen[:, 3:7], weight / 2, worse / 2)) for s in (1, -1)]
    return np.ascontiguousarray(np.concatenate(sides)), near
