"""Mutual inductance of current paths while some of them move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import Progress, ranges, run_blocks
from coilarray.constants import MU_0
from coilarray.electromagnetics.field import Source, as_conductors
from coilarray.electromagnetics.kernels.moving import moved_sum
from coilarray.electromagnetics.kernels.paths import mutual_sum
from coilarray.electromagnetics.kernels.turns import find_series, series_rules
from coilarray.electromagnetics.neumann import MUTUAL_NEAR_WIDTHS, segment_table
from coilarray.errors import GeometryError
from coilarray.geometry import Conductor, Pose

_FLAT = 0.25  # of the larger side; thinner bars are flat
_CLOSE, _CLOSE_THICK = 1.0, 3.0  # sides between the middles of flat and other bars that are close
_MOST_CLOSE = 4096  # close bars of two paths for which there is room at first
_POSES_A_BLOCK = 4
_NO_SHIFT = np.zeros(3)


def moved_inductance(
    fixed: Source, moved: Source, poses: Pose | Sequence[Pose], *, progress: Progress | None = None
) -> FloatArray:
    """Compute the mutual inductances in H of fixed paths with moved ones.

    The paths `moved` are given where they are before any of the `poses`, which hold for all of them
    together. The result has the shape (poses, `fixed` paths, moved paths). `progress` is called
    with (done, total) as the work goes on. Raises GeometryError without poses, or for two thin
    filaments that overlap on one line, and MemoryLimitError for more values than
    `coilarray.compute.memory.allowed_memory` allows.

    A few turns stand for all of a winding, with the weights of
    `coilarray.electromagnetics.kernels.turns`, where these lie farther apart than a tenth of their
    breadth, and one to three filaments for the cross-section of a trace. Traces that are nearer
    than a width are computed as by `coilarray.mutual_inductance`. The error is below 1e-4 of the
    larger self-inductance at distances of a trace width and more, some 1e-5 for windings of many
    turns.

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
    tables, others = [_Filaments.of(path) for path in first], [_Filaments.of(path) for path in second]
    members, weights, _, counts = series_rules(max(int(path.series[:, 2].max()) for path in (*tables, *others)))
    sums = np.empty((len(poses), len(first), len(second)))

    def block(start: int, stop: int) -> None:
        close = np.empty((_MOST_CLOSE, 2), dtype=np.int64)
        for number in range(start, stop):
            for k, other in enumerate(others):
                there = other.posed(poses[number])
                for i, table in enumerate(tables):
                    sums[number, i, k] = _sum(table, there, (members, weights, counts), close)

    run_blocks(lambda piece: block(*piece), list(ranges(len(poses), _POSES_A_BLOCK)), progress=progress)
    if not np.isfinite(sums).all():
        number, i, k = np.argwhere(~np.isfinite(sums))[0].tolist()
        raise GeometryError(
            f"{first[i].name} and {second[k].name} overlap on one line at pose {number + 1}, where the mutual "
            "inductance of thin filaments is infinite."
        )
    return MU_0 / (4 * np.pi) * sums


@dataclass(frozen=True, eq=False)
class _Filaments:
    """A path for the kernels: bars of `paths`, rows and series of `moving`."""

    bars: FloatArray
    rows: FloatArray
    series: IntArray

    @classmethod
    def of(cls, path: Conductor) -> _Filaments:
        bars = segment_table(path)
        series = find_series(bars)
        bars[:, :3] += path.vertices[0]
        width, thickness = bars[:, 10], bars[:, 11]
        wide = width > thickness
        direction = np.where(wide[:, None], bars[:, 7:10], np.cross(bars[:, 3:6], bars[:, 7:10]))
        half = 0.5 * np.sqrt(np.abs(width**2 - thickness**2))[:, None] * direction
        size = np.maximum(width, thickness)
        flat = np.minimum(width, thickness) <= _FLAT * size
        rows = np.column_stack((bars[:, :7], half, size, np.where(flat, _CLOSE, _CLOSE_THICK) * size))
        return cls(bars, np.ascontiguousarray(rows), series)

    def posed(self, pose: Pose) -> _Filaments:
        bars, rows = self.bars.copy(), self.rows.copy()
        for table in (bars, rows):
            table[:, :3] = pose.apply(table[:, :3])
            for k in (3, 7):
                table[:, k : k + 3] = table[:, k : k + 3] @ pose.rotation.T
        return _Filaments(bars, rows, self.series)


def _sum(one: _Filaments, other: _Filaments, rules: tuple[IntArray, FloatArray, IntArray], close: IntArray) -> float:
    """Sum ∬ dl·dl'/R of two paths in m."""
    total, listed = moved_sum(one.rows, one.series, other.rows, other.series, *rules, close)
    if listed > len(close):
        close = np.empty((listed, 2), dtype=np.int64)
        return _sum(one, other, rules, close)
    pairs = close[:listed]
    for i in np.unique(pairs[:, 0]).tolist():
        beside = other.bars[pairs[pairs[:, 0] == i, 1]]
        total += mutual_sum(one.bars[i : i + 1], beside, _NO_SHIFT, 0, 1, MUTUAL_NEAR_WIDTHS, 0)
    return float(total)
