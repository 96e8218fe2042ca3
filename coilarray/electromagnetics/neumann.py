"""Neumann's double integral over pairs of current paths.

Equal pairs are computed once. Pairs whose bounding boxes lie apart are replaced by equivalent
currents at the Chebyshev nodes of the boxes, as 1/R is smooth there and equals its interpolation
from the nodes of either box. A path is then the vector W_p = ∫ L_p dl at every node p, with the
Lagrange polynomials L_p, and

    ∬ dl·dl'/R = Σ_pq W_p·W'_q / |x_p − x'_q|

as in the black-box fast multipole method (Fong & Darve, J. Comput. Phys. 228, 8712, 2009).

The other pairs are summed segment by segment. Their paths are cut into flat parts, as the layers of
a planar coil, and the rest. A layer is often another layer turned over, so pairs of parts that
differ only by a reflection are summed once.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import Literal

import numpy as np

from coilarray.compute.arrays import BoolArray, FloatArray, IntArray
from coilarray.compute.threads import Progress, ranges, run_blocks
from coilarray.electromagnetics.field import first_of_each
from coilarray.electromagnetics.kernels.bars import bar_self
from coilarray.electromagnetics.kernels.paths import INNER, add_node_sums, mutual_sum, own_mutual_sum
from coilarray.electromagnetics.kernels.turns import find_series, series_members, series_rules, series_sum
from coilarray.errors import GeometryError
from coilarray.geometry import Conductor

MOST_PARTS = 16  # of one path; a path with more parts is not cut
_MIRRORS = np.array(list(itertools.product((1.0, -1.0), repeat=3)))
Accuracy = Literal["full", "screen"]
"""Accuracy of inductance: ``full`` reaches 1e-6 of L and k, ``screen`` takes a tenth of the time.

``screen`` is for searches among windings of many turns whose results are computed again in full. It
reaches 1e-4 of L, 5e-5 in k on the bundled boards, some 1e-4 for other weakly coupled windings, and
up to 1 % of k for windings that lie on each other.
"""
OWN_NEAR_WIDTHS = 160.7  # distance in widths up to which the cross-section counts within a path
MUTUAL_NEAR_WIDTHS = 1003.0  # the same between two paths: (1/1000)² is 1e-6 of a weak coupling
# Of two paths, and of one path. Screening leaves out 1/(12·15²) = 4e-5 of a pair, 5e-3 of
# overlapping coils.
_NEAR_WIDTHS = {"full": (MUTUAL_NEAR_WIDTHS, OWN_NEAR_WIDTHS), "screen": (4.0, 15.0)}
_SAME_SIDE = 1e-9  # 1 − cosine of the angle of two widths; smaller angles are none
_SAME_SIZE = 1e-12  # of the largest; sizes of bars that differ by less are equal
_FEW, _BLOCKS_A_PAIR = 32, 8  # distinct pairs of parts up to which each is cut into blocks on any number of cores
_TWO_PATHS, _ONE_PATH, _ITSELF = 0, 1, 2  # a part with a part of another path, of its own path, or itself
# Task: pairs of paths, their weights, and the sum that each gets times its weight
_Block = tuple[IntArray, FloatArray | float, Callable[[], FloatArray | float]]
MOST_NODES = 16  # along a side of the box; nearer pairs need more and are left to the sums over segments
_LOG_TOLERANCE = math.log(1e-7)  # of ρ^−n times (gap/half + 1)², as M of two windings falls faster than M of pieces
_NONE = 1e-9  # of the box; smaller extents count as zero
BYTES_A_PAIR = 400.0  # peak memory per pair of paths
_THIN = 200.0  # winding extent in widths; beyond it the widths change distant pairs by less than 3e-7 of L
_SAME_PLACE = 1e-12  # of the paths' extent; offsets and shapes that differ by less are equal
_SAME_SHAPE = 1e-8  # of a path itself at most, in arrays that are far larger than the path
_LEAST_STEP = 1e-18  # of the paths' extent; offsets are counted in 64 bits
_NODE_PAIRS = 20_000_000  # in a block of far pairs, some 20 ms
_NODE_PAIRS_A_BAR_PAIR = 20  # node pairs that take as long as a pair of bars; with fewer bars, the bars are summed


def bounding_boxes(paths: Sequence[FloatArray]) -> FloatArray:
    """Middle and half extent in m of paths (m, 3), (paths, 2, 3)."""
    low = np.array([vertices.min(axis=0) for vertices in paths])
    high = np.array([vertices.max(axis=0) for vertices in paths])
    return np.stack(((low + high) / 2, (high - low) / 2), axis=1)


def nodes_needed(first: FloatArray, second: FloatArray, shifts: FloatArray) -> IntArray:
    """Numbers of nodes along x and y, and z, of boxes and moved boxes, too near over `MOST_NODES`."""
    between = np.abs(second[:, 0] + shifts - first[:, 0]) - first[:, 1] - second[:, 1]
    gap = np.maximum(between, 0.0)
    half = np.maximum(first[:, 1], second[:, 1])
    sizes = np.column_stack((half[:, :2].max(axis=1), half[:, 2]))
    none = _NONE * half.max(axis=1)[:, None]
    # Singularities beside the interval [−1, 1] lie beyond its ends, those above anywhere.
    lengths = np.maximum(sizes, none)
    beside = np.arccosh(1.0 + np.hypot(gap[:, 0], gap[:, 1])[:, None] / lengths)
    above = np.arcsinh(gap[:, 2][:, None] / lengths)
    with np.errstate(divide="ignore"):
        apart_by = np.log1p(np.hypot(*gap.T[:2]) / half.max(axis=1))[:, None]
        count = np.ceil((2 * apart_by - _LOG_TOLERANCE) / np.maximum(beside, above))
    apart = gap.max(axis=1)[:, None] > 0
    count = np.where((sizes <= none) & apart, 1.0, np.maximum(count, 2.0))
    return np.asarray(np.minimum(count, MOST_NODES + 1.0), dtype=np.int64)


def equivalent_currents(
    segments: FloatArray, count: int, count_z: int, current: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Chebyshev nodes in m of the box of segments (m, 2, 3), and currents ∫ L I dl in A m there.

    There are `count` nodes along x and y. Polynomials along a segment are integrated exactly.
    """
    ((centre, extent),) = bounding_boxes([segments.reshape(-1, 3)])
    gauss, weight = np.polynomial.legendre.leggauss(count + (count_z + 1) // 2)
    step = segments[:, 1] - segments[:, 0]
    places = (segments[:, :1] + 0.5 * (1.0 + gauss)[:, None] * step[:, None]).reshape(-1, 3)
    pieces = (0.5 * current * weight[:, None] * step[:, None]).reshape(-1, 3)
    local = np.clip((places - centre) / np.where(extent > 0, extent, 1.0), -1.0, 1.0)
    counts = (count, count, count_z)
    along_x, along_y, along_z = (_lagrange(n, local[:, axis]) for axis, n in enumerate(counts))
    upwards = (along_z[:, :, None] * pieces[:, None, :]).reshape(len(places), -1)
    across = (along_y[:, :, None] * upwards[:, None, :]).reshape(len(places), -1)
    axes = [centre[axis] + extent[axis] * _chebyshev(n) for axis, n in enumerate(counts)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return nodes, (along_x.T @ across).reshape(-1, 3)


def _chebyshev(n: int) -> FloatArray:
    return np.asarray(np.cos(np.pi * (np.arange(n) + 0.5) / n))


def _lagrange(n: int, t: FloatArray) -> FloatArray:
    """Lagrange polynomials of the Chebyshev nodes at −1 ≤ t ≤ 1, (points, n)."""
    at_points, at_nodes = (np.polynomial.chebyshev.chebvander(x, n - 1) for x in (t, _chebyshev(n)))
    at_points[:, 0] *= 0.5
    return np.asarray(2.0 / n * at_points @ at_nodes.T)


def path_sums(
    conductors: Sequence[Conductor],
    first: IntArray,
    second: IntArray,
    accuracy: Accuracy = "full",
    *,
    progress: Progress | None = None,
) -> FloatArray:
    """Mean of Neumann's ∬ dl·dl'/R of pairs in m, inf for thin filaments that overlap."""
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
    rounded = 2.0 ** np.round(np.log2(own))  # copies that differ by rounding then have the same
    quanta = np.minimum(_SAME_PLACE * extent, _SAME_SHAPE * rounded)  # largest difference of equal paths
    shapes, of_path = _shapes(conductors, quanta)
    origin = np.array([conductor.vertices[0] for conductor in conductors])
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
    near |= thin[classes.first] & thin[classes.second]  # these must reach 1e-11, not a part of L
    blocks = _far_blocks(shapes, classes, np.flatnonzero(~near), nodes)  # first, as they take long
    blocks += _near_blocks(shapes, classes, np.flatnonzero(near), quantum, accuracy)
    sums = np.zeros(len(classes.shift))
    values = run_blocks(lambda block: block[2](), blocks, progress=progress)
    for (numbers, weights, _), value in zip(blocks, values, strict=True):
        np.add.at(sums, numbers, weights * value)
    return np.asarray(sums[of_pair])


def segment_table(conductor: Conductor) -> FloatArray:
    """Rows of `kernels.paths` for a path from the origin, (segments, 12)."""
    vertices = conductor.vertices - conductor.vertices[0]
    steps = np.diff(vertices, axis=0)
    length = np.linalg.norm(steps, axis=1)
    u = steps / length[:, None]
    return np.ascontiguousarray(
        np.column_stack((vertices[:-1], u, length, conductor.across, conductor.widths, conductor.thicknesses))
    )


@dataclass(frozen=True, eq=False)
class _Shape:
    """Path that starts at the origin, shared by its copies."""

    table: FloatArray
    quantum: float
    is_filament: bool
    known: dict[tuple[int, int], tuple[FloatArray, FloatArray]] = field(default_factory=dict)

    @cached_property
    def seen_from_afar(self) -> FloatArray:
        """Segments (m, 2, 3) that share the current, two per wide bar."""
        start, step = self.table[:, :3], self.table[:, 3:6] * self.table[:, 6:7]
        lines = np.stack((start, start + step), axis=1)
        width = np.sqrt(np.average(self.table[:, 10] ** 2, weights=self.table[:, 6]))
        if np.ptp(lines, axis=(0, 1)).max() > _THIN * width:
            return lines
        aside = (INNER * self.table[:, 10:11] * self.table[:, 7:10])[:, None]
        return np.concatenate((lines - aside, lines + aside))

    def currents(self, count: int, count_z: int) -> tuple[FloatArray, FloatArray]:
        key, lines = (count, count_z), self.seen_from_afar
        if key not in self.known:
            self.known[key] = equivalent_currents(lines, count, count_z, len(self.table) / len(lines))
        return self.known[key]


@dataclass(frozen=True, eq=False)
class _Classes:
    """Distinct pairs of shapes (n,) and their shifts (n, 3) in m."""

    first: IntArray
    second: IntArray
    shift: FloatArray


def _shapes(conductors: Sequence[Conductor], quanta: FloatArray) -> tuple[list[_Shape], IntArray]:
    """Distinct shapes to `quanta` in m, and the shape of each path."""
    tables = [segment_table(conductor) for conductor in conductors]
    keys = []
    for conductor, table, quantum in zip(conductors, tables, quanta.tolist(), strict=True):
        columns = np.column_stack((table[:, :3], table[:, 6:7], table[:, 10:12]))
        end = conductor.vertices[-1] - conductor.vertices[0]
        steps = np.round(np.append(columns.ravel(), end) / quantum) + 0.0  # widths may be more than an integer holds
        keys.append((quantum, steps.tobytes() + (np.round(table[:, 7:10], 6) + 0.0).tobytes()))
    examples, of_path = first_of_each(keys)
    return [_Shape(tables[k], float(quanta[k]), conductors[k].is_filament) for k in examples], of_path


def _classes(a: IntArray, b: IntArray, shift: FloatArray, quantum: float) -> tuple[_Classes, IntArray]:
    """Distinct triples (shape, shape, shift), with M(a, b, d) = M(b, a, −d), and their numbers."""
    steps = np.round(shift / quantum).astype(np.int64)
    example, number, turn = pair_classes(np.column_stack((a, b, steps)), np.column_stack((b, a, -steps)))
    turned = turn[example]
    first, second = np.where(turned, b[example], a[example]), np.where(turned, a[example], b[example])
    return _Classes(first, second, np.where(turned[:, None], -1.0, 1.0) * shift[example]), number


def _near_blocks(
    shapes: list[_Shape], classes: _Classes, near: IntArray, quantum: float, accuracy: Accuracy
) -> list[_Block]:
    """Tasks for pairs summed by segments, once for parts that mirror each other."""
    if not len(near):
        return []
    numbers, paths = np.unique(np.concatenate((classes.first[near], classes.second[near])), return_inverse=True)
    wanted = [shapes[number] for number in numbers.tolist()]
    found = find_parts([shape.table for shape in wanted], np.array([shape.quantum for shape in wanted]))
    pairs = _pairs(found, paths[: len(near)], paths[len(near) :], classes.shift[near])
    if not len(pairs.of):
        return []
    pairs, example, number = _part_classes(found, pairs, quantum)
    members = np.split(np.argsort(number, kind="stable"), np.cumsum(np.bincount(number))[:-1])
    pieces = _BLOCKS_A_PAIR if accuracy == "full" and len(example) <= _FEW else 1
    series = cache(lambda part: find_series(found.tables[part]))
    blocks: list[_Block] = []
    for k, of_class in zip(example.tolist(), members, strict=True):
        a, b = int(pairs.first[k]), int(pairs.second[k])
        table, other, kind = found.tables[a], found.tables[b], pairs.kind[k]
        near_widths = _NEAR_WIDTHS[accuracy][0 if kind == _TWO_PATHS else 1]
        of_both = None if accuracy == "full" else (series(a), series(b))
        work: Callable[[int, int], float]
        if kind == _ITSELF:
            work = partial(_own_sum, table, of_both, near_widths)
        else:
            work = _pair_sum(table, other, pairs.mirror[k], pairs.shift[k], near_widths, of_both)
        edges = np.linspace(0, len(table), min(len(table), pieces) + 1).round().astype(int).tolist()
        of, weight = near[pairs.of[of_class]], pairs.weight[of_class]
        blocks += [(of, weight, partial(work, *part)) for part in itertools.pairwise(edges)]
    return blocks


def _far_blocks(shapes: list[_Shape], classes: _Classes, far: IntArray, nodes: IntArray) -> list[_Block]:
    """Tasks for the pairs that are replaced by equivalent currents."""
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
                work_of = partial(_far_block, shapes, classes, gathered, nodes)
                blocks.append((np.concatenate(gathered), 1.0, work_of))
                gathered, work = [], 0
    if gathered:
        work_of = partial(_far_block, shapes, classes, gathered, nodes)
        blocks.append((np.concatenate(gathered), 1.0, work_of))
    return blocks


def _far_block(shapes: list[_Shape], classes: _Classes, groups: list[IntArray], nodes: IntArray) -> FloatArray:
    """Sum groups of far pairs over their nodes."""
    values = [np.zeros(len(group)) for group in groups]
    for group, sums in zip(groups, values, strict=True):
        counts, shift = nodes[group[0]].tolist(), np.ascontiguousarray(classes.shift[group])
        a, b = (shapes[kind[group[0]]].currents(*counts) for kind in (classes.first, classes.second))
        add_node_sums(a[0], a[1], np.ascontiguousarray(b[0].T), np.ascontiguousarray(b[1].T), shift, sums)
    return np.concatenate(values)


@dataclass(frozen=True, eq=False)
class PathParts:
    """Parts of several paths and their distinct shapes.

    `tables` are rows of `kernels.paths` of the distinct parts from the origin. `flat` and `upright`
    (distinct,) mark parts at one height and vertical parts. `first` (paths + 1,) is the first part
    of each path. Part k is the distinct part `number[k]`, mirrored by the signs `mirror[k]` of its
    coordinates, moved to `origin[k]` in m from the start of its path, its current of the `sign[k]`.
    """

    tables: list[FloatArray]
    flat: BoolArray
    upright: BoolArray
    first: IntArray
    number: IntArray
    mirror: FloatArray
    sign: FloatArray
    origin: FloatArray


def find_parts(tables: Sequence[FloatArray], quanta: FloatArray) -> PathParts:
    """Cut paths (rows of `kernels.paths`) into parts, alike to the `quanta` (paths,) in m."""
    cut = [_cut(table, quantum) for table, quantum in zip(tables, quanta.tolist(), strict=True)]
    first = np.concatenate(([0], np.cumsum([len(parts) for parts in cut])))
    parts = [part for of_path in cut for part in of_path]
    steps = np.repeat(quanta, np.diff(first))
    points = [_vertices(part) for part in parts]
    spans = np.array([np.abs(p[-1] - p[0]) for p in points])  # the same for a mirror image
    marks = np.column_stack(([float(len(part)) for part in parts], steps, spans, [part[:, 6].sum() for part in parts]))
    slack = np.column_stack((np.zeros((len(parts), 2)), np.outer(steps, (2.0, 2.0, 2.0)), 2.0 * marks[:, 0] * steps))
    number, mirror, sign = np.zeros(len(parts), dtype=np.int64), np.ones((len(parts), 3)), np.ones(len(parts))
    origin = np.array([p[0] for p in points])
    distinct: list[int] = []
    for k, part in enumerate(parts):
        number[k] = len(distinct)
        for candidate in np.flatnonzero((np.abs(marks[distinct] - marks[k]) <= slack[k]).all(axis=1)).tolist():
            found = _image(parts[distinct[candidate]], part, steps[k])
            if found is not None:
                number[k], mirror[k], sign[k] = candidate, *found
                if sign[k] < 0:
                    origin[k] = points[k][-1]
                break
        else:
            distinct.append(k)
    chosen = [
        np.ascontiguousarray(np.column_stack((parts[k][:, :3] - parts[k][0, :3], parts[k][:, 3:]))) for k in distinct
    ]
    height = np.array([np.ptp(points[k][:, 2]) if not parts[k][:, 9].any() else np.inf for k in distinct])
    upright = np.array([not table[:, 3:5].any() for table in chosen])
    return PathParts(chosen, height <= steps[distinct], upright, first, number, mirror, sign, origin)


def mirrored(table: FloatArray, mirror: FloatArray) -> FloatArray:
    """Rows of a mirrored part, the lateral direction left of the current."""
    image = table.copy()
    image[:, :3] *= mirror
    image[:, 3:6] *= mirror
    image[:, 7:10] *= mirror * (mirror[0] * mirror[1])
    return image


def _cut(table: FloatArray, quantum: float) -> list[FloatArray]:
    """Cut a path into flat runs of segments and the rest."""
    level = table[:, 5] == 0.0
    change = (level[1:] != level[:-1]) | (level[1:] & (np.abs(np.diff(table[:, 2])) > quantum))
    cuts = np.flatnonzero(change) + 1
    return np.split(table, cuts) if len(cuts) < MOST_PARTS else [table]


def _vertices(table: FloatArray) -> FloatArray:
    return np.vstack((table[:, :3], table[-1:, :3] + table[-1:, 3:6] * table[-1:, 6:7]))


def _image(table: FloatArray, other: FloatArray, quantum: float) -> tuple[FloatArray, float] | None:
    """Mirror and current direction that relate two parts, or None."""
    points, sizes = _vertices(table), table[:, [6, 10, 11]]
    others, other_sizes = _vertices(other), other[:, [6, 10, 11]]
    for sign in (1.0, -1.0):
        order = slice(None, None, int(sign))
        if (np.abs(sizes - other_sizes[order]) > quantum).any():
            continue
        steps, other_steps = points - points[0], others[order] - others[order][0]
        for mirror in _MIRRORS:
            alike = np.abs((mirror * table[:, 7:10] * other[order, 7:10]).sum(axis=1)) > 1.0 - _SAME_SIDE
            if (np.abs(mirror * steps - other_steps) <= quantum).all() and alike.all():
                return mirror, sign
    return None


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Pairs of parts, the second mirrored and moved, that count `weight` times in a pair of paths."""

    of: IntArray
    weight: FloatArray
    kind: IntArray
    first: IntArray
    second: IntArray
    mirror: FloatArray
    shift: FloatArray


def _pairs(parts: PathParts, first: IntArray, second: IntArray, shift: FloatArray) -> _Pairs:
    """Cut pairs of paths into part pairs, the first turned back."""
    rows = []
    for k, (a, b) in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
        P, Q = np.mgrid[parts.first[a] : parts.first[a + 1], parts.first[b] : parts.first[b + 1]].reshape(2, -1)
        kind = np.full(len(P), _TWO_PATHS)
        if a == b and not shift[k].any():
            P, Q = P[P <= Q], Q[P <= Q]
            kind = np.where(P == Q, _ITSELF, _ONE_PATH)
        rows.append(np.stack((np.full(len(P), k), P, Q, kind)))
    of, P, Q, kind = np.concatenate(rows, axis=1)
    i, j = parts.number[P], parts.number[Q]
    counts = ~(parts.flat[i] & parts.upright[j] | parts.upright[i] & parts.flat[j])  # right angles add nothing
    of, P, Q, kind, i, j = of[counts], P[counts], Q[counts], kind[counts], i[counts], j[counts]
    weight = parts.sign[P] * parts.sign[Q] * np.where(kind == _ONE_PATH, 2.0, 1.0)
    back = parts.mirror[P]
    moved = back * (parts.origin[Q] - parts.origin[P] + shift[of])
    moved[kind == _ITSELF] = 0.0
    return _Pairs(of, weight, kind, i, j, back * parts.mirror[Q], moved)


def _part_classes(parts: PathParts, pairs: _Pairs, quantum: float) -> tuple[_Pairs, IntArray, IntArray]:
    """Pairs in common form, an example of each class, pairs' classes.

    M(a, gb, d) = M(b, ga, −gd) for a mirror g, and of two flat parts either may be the upper.
    """
    turned = -pairs.mirror * pairs.shift
    steps, mirror = np.round(pairs.shift / quantum).astype(np.int64), pairs.mirror.astype(np.int64)
    other_steps = -mirror * steps
    flat = parts.flat[pairs.first] & parts.flat[pairs.second]
    for ways in (steps, other_steps):
        ways[flat, 2] = np.abs(ways[flat, 2])
    key = np.column_stack((pairs.kind, pairs.first, pairs.second, mirror, steps))
    other_key = np.column_stack((pairs.kind, pairs.second, pairs.first, mirror, other_steps))
    example, number, turn = pair_classes(key, other_key)
    first, second = np.where(turn, pairs.second, pairs.first), np.where(turn, pairs.first, pairs.second)
    alike = replace(pairs, first=first, second=second, shift=np.where(turn[:, None], turned, pairs.shift))
    return alike, example, number


def pair_classes(key: IntArray, turned: IntArray) -> tuple[IntArray, IntArray, BoolArray]:
    """Group equal pairs into classes.

    Rows of `key` and `turned` (n, columns) mean the same. The result is one pair of each class, the
    class of each pair (n,), and where `turned` is used.
    """
    turn, undecided = np.zeros(len(key), dtype=bool), np.ones(len(key), dtype=bool)
    for column in range(key.shape[1]):
        turn |= undecided & (turned[:, column] < key[:, column])
        undecided &= turned[:, column] == key[:, column]
    number = np.zeros(len(key), dtype=np.int64)
    for column in np.where(turn[:, None], turned, key).T:
        if (column != column[0]).any():
            values, place = np.unique(column, return_inverse=True)
            number = np.unique(number * len(values) + place, return_inverse=True)[1]
    return np.unique(number, return_index=True)[1], number, turn


def _own_sum(
    table: FloatArray, series: tuple[IntArray, IntArray] | None, near_widths: float, start: int, stop: int
) -> float:
    """Sum a part's rows start:stop with the part itself."""
    if not table[:, 10].all():
        return np.inf  # of a thin filament
    if series is None:
        mutual = own_mutual_sum(table, start, stop, near_widths, 0)
        return float(mutual + _bars_alone(table[start:stop], np.ones(stop - start)))
    rules = series_rules(int(series[0][:, 2].max()))
    rows, weights = series_members(series[0], *rules)
    mutual = series_sum(table, table, np.zeros(3), series[0], series[1], True, near_widths, *rules)
    return float(2.0 * mutual + _bars_alone(table[rows], weights))


def _pair_sum(
    table: FloatArray, other: FloatArray, mirror: FloatArray, shift: FloatArray, near_widths: float,
    series: tuple[IntArray, IntArray] | None,
) -> Callable[[int, int], float]:  # fmt: skip
    """Sum function of rows start:stop with a mirrored and moved part."""
    second = other if (mirror > 0).all() else mirrored(other, mirror)

    def between(start: int, stop: int) -> float:
        return float(mutual_sum(table, second, shift, start, stop, near_widths, 0))

    def above(start: int, stop: int) -> float:
        alike = [(table[i : i + 1], second[i : i + 1]) for i in range(start, stop)]
        facing = sum(mutual_sum(*bars, shift, 0, 1, near_widths, 0) for bars in alike)
        return float(facing + own_mutual_sum(table, start, stop, near_widths, 0, shift))

    if series is not None:  # of all rows, in one piece
        of_first, of_second = series
        rules = series_rules(int(max(one[:, 2].max() for one in series)))
        whole = partial(series_sum, table, second, shift, of_first, of_second, False, near_widths, *rules)
        return lambda start, stop: float(whole())
    # of a flat part above its copy, rows i, j relate as j, i
    flat = not table[:, [5, 9]].any() and not np.ptp(table[:, 2])
    straight = flat and bool((mirror[:2] > 0).all()) and not shift[:2].any()
    return above if table is other and straight else between


def _bars_alone(rows: FloatArray, weights: FloatArray) -> float:
    """Weighted sum of ∬ dl·dl'/R of bars with themselves."""
    sizes = rows[:, [6, 10, 11]]
    alike = np.round(sizes / (_SAME_SIZE * sizes.max(axis=0)))
    _, example, which = np.unique(alike, axis=0, return_index=True, return_inverse=True)
    counts = np.bincount(which.ravel(), weights)
    return float(sum(c * bar_self(*size) for size, c in zip(sizes[example], counts, strict=True)))
