"""Neumann's double integral over pairs of current paths: pairs that lie alike are computed once.

Pairs whose bounding boxes lie apart go through `coilarray.equivalent_currents`, the others segment by segment.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import Literal

import numpy as np
import numpy.typing as npt

from coilarray.blocks import Progress, cores, ranges, run_blocks
from coilarray.equivalent_currents import (
    MOST_NODES,
    EquivalentCurrents,
    bounding_boxes,
    equivalent_currents,
    nodes_needed,
)
from coilarray.errors import GeometryError
from coilarray.geometry import Conductor
from coilarray.kernels.bars import bar_self
from coilarray.kernels.node_pairs import add_node_sums
from coilarray.kernels.paths import INNER, mutual_sum, own_mutual_sum
from coilarray.kernels.turns import find_series, own_series_sum, series_members, series_rules, series_sum

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

Accuracy = Literal["full", "screen"]
"""``full``: 1e-6 of L and k. ``screen``: a tenth of the time for windings of many turns, for searches whose results
are computed again in full: 1e-4 of L, 5e-5 in k on the bundled boards, some 1e-4 for other weakly coupled windings, and
up to 1 % of k where windings lie on each other (tests/test_inductance_screen.py)."""

_Sums = tuple[IntArray, FloatArray]  # numbers of distinct pairs, and what is to be added to their sums
_Block = Callable[[], _Sums]

BYTES_A_PAIR = 400.0
"""Of memory that sums over many pairs take."""
OWN_REACH = 160.0
"""Widths up to which the cross-section counts within one path (tests/test_inductance_convergence.py)."""
MUTUAL_REACH = 120.0
"""Widths up to which the cross-section counts between two paths (tests/test_inductance_convergence.py)."""
_THIN = 200.0  # widths in the extent of a winding whose widths count from afar by less than 3e-7 of L
# the same for screening: leaves out 1/(12·15²) = 4e-5 of a pair, and 5e-3 of one where coils overlap
_SCREEN_OWN_REACH, _SCREEN_MUTUAL_REACH = 15.0, 4.0
_SAME_PLACE = 1e-12  # of the paths' extent; offsets and shapes that differ by less are the same pair
_SAME_SHAPE = 1e-8  # of a path itself at the most, in arrays that are far larger than it
_LEAST_STEP = 1e-18  # of the paths' extent: offsets are counted in 64 bits
_NODE_PAIRS = 20_000_000  # in a block of far pairs: some 20 ms
_NODE_PAIRS_A_BAR_PAIR = 20  # that take as long; where there are fewer bars, they are summed
_BLOCKS_A_CLASS = 8  # of near pairs, where there are few of them


def path_sums(
    conductors: Sequence[Conductor],
    first: IntArray,
    second: IntArray,
    accuracy: Accuracy = "full",
    progress: Progress | None = None,
) -> FloatArray:
    """∬ dl·dl'/R of pairs of paths, averaged over the cross-sections.

    Parameters
    ----------
    conductors : sequence of Conductor
        All paths.
    first, second : ndarray of int, shape (n,)
        Numbers of the paths of each pair; equal ones for a path with itself.
    accuracy : {"full", "screen"}
        See `Accuracy`.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    ndarray, shape (n,)
        In m; µ0/4π times these are inductances. Infinite for thin filaments that run over each other on one line.

    Raises
    ------
    GeometryError
        A thin filament with itself.
    """
    if not len(first):
        return np.zeros(0)
    for i in np.unique(first[first == second]).tolist():
        if conductors[i].is_filament:
            raise GeometryError(
                f"{conductors[i].name} has segments without a cross-section: the self-inductance of a thin filament "
                "is infinite; give widths and thicknesses."
            )
    extent = float(np.ptp(np.concatenate([conductor.vertices for conductor in conductors]), axis=0).max())
    own = np.array([np.ptp(conductor.vertices, axis=0).max() for conductor in conductors])
    quanta = _same(extent, own)
    shapes, of_path, origin = _shapes(conductors, quanta)
    shift = origin[second] - origin[first]
    quantum = max(float(quanta.min()), _LEAST_STEP * extent)
    classes, of_pair = _classes(of_path[first], of_path[second], shift, quantum)
    boxes = bounding_boxes([shape.seen_from_afar.reshape(-1, 3) for shape in shapes])
    nodes = nodes_needed(boxes[classes.first], boxes[classes.second], classes.shift)
    segments = np.array([len(shape.table) for shape in shapes])
    node_pairs = nodes[:, 0] ** 4 * nodes[:, 1] ** 2
    near = nodes.max(axis=1) > MOST_NODES
    near |= node_pairs > _NODE_PAIRS_A_BAR_PAIR * segments[classes.first] * segments[classes.second]
    thin = np.array([shape.is_filament for shape in shapes])
    near |= thin[classes.first] & thin[classes.second]  # these are promised to 1e-11, not to a part of L
    blocks = _far_blocks(shapes, classes, np.flatnonzero(~near), nodes)  # first, for they are long
    blocks += _near_blocks(shapes, classes, np.flatnonzero(near), accuracy)
    sums = np.zeros(len(classes.shift))
    for numbers, values in run_blocks(lambda block: block(), blocks, progress):
        np.add.at(sums, numbers, values)
    return np.asarray(sums[of_pair])


def _same(extent: float, own: FloatArray) -> FloatArray:
    """Differences in m that do not make another shape or offset, for paths as large as `own` in all of `extent`."""
    rounded = 2.0 ** np.round(np.log2(own))  # so that copies that differ by rounding have the same
    return np.asarray(np.minimum(_SAME_PLACE * extent, _SAME_SHAPE * rounded))


def segment_table(conductor: Conductor) -> FloatArray:
    """Rows of `coilarray.kernels.paths`, the first vertex moved to the origin; shape (segments, 12)."""
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


class _Shape:
    """A path that starts at the origin, shared by all its copies."""

    def __init__(self, conductor: Conductor, table: FloatArray) -> None:
        self.table = table
        self.is_filament = conductor.is_filament
        self.currents = cache(self._currents)

    @cached_property
    def series(self) -> IntArray:
        """Sides of successive turns, see `coilarray.kernels.turns.find_series`."""
        return find_series(self.table)

    @cached_property
    def seen_from_afar(self) -> FloatArray:
        """Segments that share the current: the centre lines, or two a bar where their width counts; (m, 2, 3)."""
        start, step = self.table[:, :3], self.table[:, 3:6] * self.table[:, 6:7]
        lines = np.stack((start, start + step), axis=1)
        width = np.sqrt(np.average(self.table[:, 10] ** 2, weights=self.table[:, 6]))
        if np.ptp(lines, axis=(0, 1)).max() > _THIN * width:
            return lines
        aside = (INNER * self.table[:, 10:11] * self.table[:, 7:10])[:, None]
        return np.concatenate((lines - aside, lines + aside))

    def _currents(self, count: int, count_z: int) -> EquivalentCurrents:
        lines = self.seen_from_afar
        return equivalent_currents(lines, count, count_z, len(self.table) / len(lines))


@dataclass(frozen=True, eq=False)
class _Classes:
    """Distinct pairs: numbers of their shapes, (n,) each, and the shift of the second in m, (n, 3)."""

    first: IntArray
    second: IntArray
    shift: FloatArray


def _shapes(conductors: Sequence[Conductor], quanta: FloatArray) -> tuple[list[_Shape], IntArray, FloatArray]:
    """Distinct shapes (to `quanta` in m, one a path), the shape of every path, and the paths' starting points."""
    shapes: list[_Shape] = []
    known: dict[tuple[float, bytes], int] = {}
    of_path = []
    for conductor, quantum in zip(conductors, quanta.tolist(), strict=True):
        table = segment_table(conductor)
        columns = np.column_stack((table[:, :3], table[:, 6:7], table[:, 10:12]))
        end = conductor.vertices[-1] - conductor.vertices[0]
        key = quantum, np.round(np.append(columns.ravel(), end) / quantum).astype(np.int64).tobytes()
        if key not in known:
            known[key] = len(shapes)
            shapes.append(_Shape(conductor, table))
        of_path.append(known[key])
    return shapes, np.array(of_path), np.array([conductor.vertices[0] for conductor in conductors])


def _classes(a: IntArray, b: IntArray, shift: FloatArray, quantum: float) -> tuple[_Classes, IntArray]:
    """Every distinct (shape, shape, shift) once, and the number of that of each pair; M(a, b, d) = M(b, a, −d)."""
    steps = np.round(shift / quantum).astype(np.int64)
    key, turned = np.column_stack((a, b, steps)), np.column_stack((b, a, -steps))
    turn, undecided = np.zeros(len(key), dtype=bool), np.ones(len(key), dtype=bool)
    for column in range(key.shape[1]):
        turn |= undecided & (turned[:, column] < key[:, column])
        undecided &= turned[:, column] == key[:, column]
    key[turn] = turned[turn]
    number = np.zeros(len(key), dtype=np.int64)
    for column in key.T:
        values, place = np.unique(column, return_inverse=True)
        number = np.unique(number * len(values) + place, return_inverse=True)[1]
    _, example = np.unique(number, return_index=True)
    signs = np.where(turn[example], -1.0, 1.0)
    return _Classes(key[example, 0], key[example, 1], signs[:, None] * shift[example]), number


def _near_blocks(shapes: list[_Shape], classes: _Classes, near: IntArray, accuracy: Accuracy) -> list[_Block]:
    """Work on the pairs that are summed segment by segment."""
    parts = _BLOCKS_A_CLASS if accuracy == "full" and len(near) < 4 * cores() else 1
    blocks: list[_Block] = []
    for k in near.tolist():
        a, b = shapes[classes.first[k]], shapes[classes.second[k]]
        own = a is b and not (classes.shift[k] != 0).any()
        rows = len(a.table)
        edges = np.linspace(0, rows, min(rows, parts) + 1).round().astype(int).tolist()
        for start, stop in itertools.pairwise(edges):
            work = partial(_own_sum, a, start, stop) if own else partial(_pair_sum, a, b, classes.shift[k], start, stop)
            blocks.append(partial(_near_block, k, work, accuracy))
    return blocks


def _near_block(k: int, work: Callable[[Accuracy], float], accuracy: Accuracy) -> _Sums:
    return np.array([k]), np.array([work(accuracy)])


def _own_sum(shape: _Shape, start: int, stop: int, accuracy: Accuracy) -> float:
    """Sum of the rows start:stop of a path with the path itself."""
    if shape.is_filament:
        return np.inf
    if accuracy == "full":
        rows = np.arange(start, stop)
        mutual = own_mutual_sum(shape.table, start, stop, OWN_REACH, 0)
        return float(mutual + _bars_alone(shape.table[rows], np.ones(len(rows))))
    rules = series_rules(int(shape.series[:, 2].max()))
    rows, weights = series_members(shape.series, *rules)
    mutual = own_series_sum(shape.table, shape.series, _SCREEN_OWN_REACH, *rules)
    return float(mutual + _bars_alone(shape.table[rows], weights))


def _pair_sum(a: _Shape, b: _Shape, shift: FloatArray, start: int, stop: int, accuracy: Accuracy) -> float:
    """Sum of the rows start:stop of a path with another one."""
    if accuracy == "full":
        return float(mutual_sum(a.table, b.table, shift, start, stop, MUTUAL_REACH, 0))
    rules = series_rules(int(max(a.series[:, 2].max(), b.series[:, 2].max())))
    return float(series_sum(a.table, b.table, shift, a.series, b.series, _SCREEN_MUTUAL_REACH, *rules))


def _bars_alone(rows: FloatArray, weights: FloatArray) -> float:
    """Weighted sum of ∬ dl·dl'/R of every bar with itself; equal ones are computed once."""
    sizes = rows[:, [6, 10, 11]]
    alike = np.round(sizes / (_SAME_PLACE * sizes.max(axis=0)))
    _, example, which = np.unique(alike, axis=0, return_index=True, return_inverse=True)
    counts = np.bincount(which.ravel(), weights)
    return float(sum(c * bar_self(*size) for size, c in zip(sizes[example], counts, strict=True)))


def _far_blocks(shapes: list[_Shape], classes: _Classes, far: IntArray, nodes: IntArray) -> list[_Block]:
    """Work on the pairs that equivalent currents stand for."""
    order = far[np.lexsort((nodes[far, 1], nodes[far, 0], classes.second[far], classes.first[far]))]
    alike = np.column_stack((classes.first[order], classes.second[order], nodes[order]))
    cuts = np.flatnonzero((np.diff(alike, axis=0) != 0).any(axis=1)) + 1
    blocks: list[_Block] = []
    gathered: list[IntArray] = []
    work = 0
    for group in np.split(order, cuts) if len(order) else []:
        size = int(nodes[group[0], 0] ** 4 * nodes[group[0], 1] ** 2)
        for start, stop in ranges(len(group), max(1, _NODE_PAIRS // size)):
            gathered.append(group[start:stop])
            work += size * (stop - start)
            if work >= _NODE_PAIRS:
                blocks.append(partial(_far_block, shapes, classes, gathered, nodes))
                gathered, work = [], 0
    if gathered:
        blocks.append(partial(_far_block, shapes, classes, gathered, nodes))
    return blocks


def _far_block(shapes: list[_Shape], classes: _Classes, groups: list[IntArray], nodes: IntArray) -> _Sums:
    values = [np.zeros(len(group)) for group in groups]
    for group, sums in zip(groups, values, strict=True):
        count, count_z = nodes[group[0]].tolist()
        a = shapes[classes.first[group[0]]].currents(count, count_z)
        b = shapes[classes.second[group[0]]].currents(count, count_z)
        add_node_sums(
            a.nodes, a.currents, np.ascontiguousarray(b.nodes.T), np.ascontiguousarray(b.currents.T),
            np.ascontiguousarray(classes.shift[group]), sums,
        )  # fmt: skip
    return np.concatenate(groups), np.concatenate(values)
