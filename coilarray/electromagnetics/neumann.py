"""Neumann's double integral over pairs of current paths.

Equal pairs are computed once. Pairs whose bounding boxes lie apart are replaced by equivalent
currents at the Chebyshev nodes of the boxes, as 1/R is smooth there and equals its interpolation
from the nodes of either box. A path is then the vector W_p = ∫ L_p dl at every node p, with the
Lagrange polynomials L_p, and

    ∬ dl·dl'/R = Σ_pq W_p·W'_q / |x_p − x'_q|

as in the black-box fast multipole method (Fong & Darve, J. Comput. Phys. 228, 8712, 2009). The
other pairs go segment by segment through `coilarray.electromagnetics.neumann_near`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial

import numpy as np

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.compute.threads import Progress, ranges, run_blocks
from coilarray.electromagnetics.kernels.far_pairs import add_node_sums
from coilarray.electromagnetics.kernels.paths import INNER
from coilarray.electromagnetics.neumann_near import Accuracy, Sums, pair_classes, part_blocks
from coilarray.errors import GeometryError
from coilarray.geometry import Conductor

MOST_NODES = 16  # along a side of the box; nearer pairs need more and are left to the sums over segments
_LOG_TOLERANCE = math.log(1e-7)  # of ρ^−n times (gap/half + 1)², as M of two windings falls faster than M of pieces
_NONE = 1e-9  # of the box; smaller extents count as zero
_Block = Callable[[], Sums]
BYTES_A_PAIR = 400.0  # peak memory per pair of paths
_THIN = 200.0  # winding extent in widths; beyond it the widths change distant pairs by less than 3e-7 of L
_SAME_PLACE = 1e-12  # of the paths' extent; offsets and shapes that differ by less are equal
_SAME_SHAPE = 1e-8  # of a path itself at most, in arrays that are far larger than the path
_LEAST_STEP = 1e-18  # of the paths' extent; offsets are counted in 64 bits
_NODE_PAIRS = 20_000_000  # in a block of far pairs, some 20 ms
_NODE_PAIRS_A_BAR_PAIR = 20  # node pairs that take as long as a pair of bars; with fewer bars, the bars are summed


@dataclass(frozen=True, eq=False)
class EquivalentCurrents:
    """Currents ∫ L I dl of a path in A m at nodes in m, (n, 3) each."""

    nodes: FloatArray
    currents: FloatArray


def bounding_boxes(paths: Sequence[FloatArray]) -> FloatArray:
    """Middle and half extent in m of paths (m, 3), (paths, 2, 3)."""
    low = np.array([vertices.min(axis=0) for vertices in paths])
    high = np.array([vertices.max(axis=0) for vertices in paths])
    return np.stack(((low + high) / 2, (high - low) / 2), axis=1)


def nodes_needed(first: FloatArray, second: FloatArray, shifts: FloatArray) -> IntArray:
    """Numbers of nodes along x and y, and along z, of box pairs, (n, 2).

    The second box is moved by `shifts` in m. Values above `MOST_NODES` mean boxes too near.
    """
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


def equivalent_currents(segments: FloatArray, count: int, count_z: int, current: float = 1.0) -> EquivalentCurrents:
    """Currents of segments (m, 2, 3) in m at Chebyshev nodes of their box.

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
    return EquivalentCurrents(nodes, (along_x.T @ across).reshape(-1, 3))


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
    """Compute Neumann's integral ∬ dl·dl'/R of pairs in m.

    It is averaged over cross-sections, and inf for thin filaments that overlap on one line.
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
    quanta = _tolerances(extent, own)
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
    near |= thin[classes.first] & thin[classes.second]  # these must reach 1e-11, not a part of L
    blocks = _far_blocks(shapes, classes, np.flatnonzero(~near), nodes)  # first, as they take long
    blocks += _near_blocks(shapes, classes, np.flatnonzero(near), quantum, accuracy)
    sums = np.zeros(len(classes.shift))
    for numbers, values in run_blocks(lambda block: block(), blocks, progress=progress):
        np.add.at(sums, numbers, values)
    return np.asarray(sums[of_pair])


def _tolerances(extent: float, own: FloatArray) -> FloatArray:
    """Largest difference in m of equal paths, by size `own` and `extent`."""
    rounded = 2.0 ** np.round(np.log2(own))  # copies that differ by rounding then have the same
    return np.asarray(np.minimum(_SAME_PLACE * extent, _SAME_SHAPE * rounded))


def segment_table(conductor: Conductor) -> FloatArray:
    """Rows of `kernels.paths` for a path from the origin, (segments, 12)."""
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
    """Path that starts at the origin, shared by its copies."""

    def __init__(self, conductor: Conductor, table: FloatArray, quantum: float) -> None:
        self.table, self.quantum = table, quantum
        self.is_filament = conductor.is_filament
        self.currents = cache(self._currents)

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

    def _currents(self, count: int, count_z: int) -> EquivalentCurrents:
        lines = self.seen_from_afar
        return equivalent_currents(lines, count, count_z, len(self.table) / len(lines))


@dataclass(frozen=True, eq=False)
class _Classes:
    """Distinct pairs of shapes (n,) and their shifts (n, 3) in m."""

    first: IntArray
    second: IntArray
    shift: FloatArray


def _shapes(conductors: Sequence[Conductor], quanta: FloatArray) -> tuple[list[_Shape], IntArray, FloatArray]:
    """Distinct shapes to `quanta` in m, shape numbers and starts of paths."""
    shapes: list[_Shape] = []
    known: dict[tuple[float, bytes], int] = {}
    of_path = []
    for conductor, quantum in zip(conductors, quanta.tolist(), strict=True):
        table = segment_table(conductor)
        columns = np.column_stack((table[:, :3], table[:, 6:7], table[:, 10:12]))
        end = conductor.vertices[-1] - conductor.vertices[0]
        steps = np.round(np.append(columns.ravel(), end) / quantum) + 0.0  # widths may be more than an integer holds
        key = quantum, steps.tobytes()
        if key not in known:
            known[key] = len(shapes)
            shapes.append(_Shape(conductor, table, quantum))
        of_path.append(known[key])
    return shapes, np.array(of_path), np.array([conductor.vertices[0] for conductor in conductors])


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
    """Tasks for the pairs that are summed segment by segment."""
    numbers, paths = np.unique(np.concatenate((classes.first[near], classes.second[near])), return_inverse=True)
    wanted = [shapes[number] for number in numbers.tolist()]
    first, second = paths[: len(near)], paths[len(near) :]
    quanta = np.array([shape.quantum for shape in wanted])
    blocks = part_blocks(
        [shape.table for shape in wanted], quanta, first, second, classes.shift[near], quantum, accuracy
    )
    return [partial(_near_block, near, block) for block in blocks]


def _near_block(near: IntArray, block: _Block) -> Sums:
    numbers, values = block()
    return near[numbers], values


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
                blocks.append(partial(_far_block, shapes, classes, gathered, nodes))
                gathered, work = [], 0
    if gathered:
        blocks.append(partial(_far_block, shapes, classes, gathered, nodes))
    return blocks


def _far_block(shapes: list[_Shape], classes: _Classes, groups: list[IntArray], nodes: IntArray) -> Sums:
    """Sum groups of far pairs over their nodes."""
    values = [np.zeros(len(group)) for group in groups]
    for group, sums in zip(groups, values, strict=True):
        count, count_z = nodes[group[0]].tolist()
        a = shapes[classes.first[group[0]]].currents(count, count_z)
        b = shapes[classes.second[group[0]]].currents(count, count_z)
        others = np.ascontiguousarray(b.nodes.T), np.ascontiguousarray(b.currents.T)
        add_node_sums(a.nodes, a.currents, *others, np.ascontiguousarray(classes.shift[group]), sums)
    return np.concatenate(groups), np.concatenate(values)
