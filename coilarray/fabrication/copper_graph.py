"""Graph of a board's copper: centre lines, holes and pads that overlap are joined."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.compute.threads import Progress
from coilarray.errors import BoardError
from coilarray.fabrication.board import BoardCopper, Copper, CopperArea, Hole, SurfacePad
from coilarray.fabrication.centre_lines import centre_lines
from coilarray.geometry.arcs import place_in_mm
from coilarray.geometry.copper import groups

JOINED = 1e-6  # distance in m below which places are one, whatever lies there
_OVERLAP = 1e-6  # m: copper that meets by less only touches
_DETOUR = 1.2  # of the length of copper that no centre line follows: ways along centre lines are preferred
_LOWER = 1e-4  # of a length, for every layer further down: of equal ways the uppermost is taken
_MOST_PAIRS = 2e7  # of an end and a track whose bounds meet; each takes a few microseconds
_SAMPLE = 1000  # ends by which they are counted
Shapes = npt.NDArray[np.object_]


@dataclass(frozen=True, eq=False)
class CopperGraph:
    """Places of copper in m, and the ways between them.

    `nodes` (n, 2) in m are on one `layer` (n,) by number, or on several if a hole joins them.
    `edges` (m, 2) are numbers of nodes, with a `length` (m,) and a `width` (m,) in m, the layer
    `edge_layer` (m,), and the number `edge_item` (m,) of their copper in `items`. `drawn` (m,) says
    that a centre line follows the edge, and `overlap` (m,) that it joins overlapping lines.
    `stands` are the holes and pads of a node, `areas` the numbers of nodes that stand for an area.
    `piece` (n,) numbers connected copper.
    """

    nodes: FloatArray
    edges: IntArray
    length: FloatArray
    width: FloatArray
    edge_layer: IntArray
    edge_item: IntArray
    drawn: npt.NDArray[np.bool_]
    overlap: npt.NDArray[np.bool_]
    items: Sequence[Copper]
    layers: Sequence[str]
    stands: dict[int, list[Hole | SurfacePad]]
    areas: dict[int, CopperArea]
    piece: IntArray

    @cached_property
    def weight(self) -> FloatArray:
        """Length in m by which the shortest way is chosen, shape (m,)."""
        preference = np.where(self.drawn, 1.0, _DETOUR) + _LOWER * self.edge_layer
        return np.asarray(np.maximum(self.length * preference, 1e-12))  # an edge of no weight is none to scipy

    def place(self, node: int) -> str:
        """Place of a node, for messages."""
        return place_in_mm(*self.nodes[node])


@dataclass(eq=False)
class _Layer:
    """Centre lines and other copper of one layer, being joined."""

    number: int
    ends: FloatArray  # (n, 2, 2) in m
    width: FloatArray  # (n,)
    item: IntArray  # (n,)
    shapes: Shapes  # (k,) of holes, pads and areas
    hub: FloatArray  # (k, 2), their places
    hub_item: IntArray  # (k,)
    places: list[tuple[float, float]] = field(default_factory=list)
    cuts: list[tuple[int, float, int]] = field(default_factory=list)  # line, part of it, place
    bridges: list[tuple[int, int, float, int, bool]] = field(default_factory=list)  # places, width, item, an overlap

    def __post_init__(self) -> None:
        self.lines: Shapes = np.asarray(shapely.linestrings(self.ends))
        self.span = np.hypot(*(self.ends[:, 1] - self.ends[:, 0]).T)
        self.places = [(x, y) for x, y in np.vstack((self.ends.reshape(-1, 2), self.hub)).tolist()]
        n = len(self.lines)
        self.cuts = [(k, float(end), 2 * k + end) for k in range(n) for end in (0, 1)]

    @property
    def first_hub(self) -> int:
        """Number of the first place of a hole, pad or area."""
        return 2 * len(self.lines)

    def along(self, line: IntArray, points: FloatArray) -> FloatArray:
        """Parts (m,) of lines at which points (m, 2) lie."""
        start, step = self.ends[line, 0], self.ends[line, 1] - self.ends[line, 0]
        return np.asarray(np.clip(((points - start) * step).sum(axis=1) / self.span[line] ** 2, 0.0, 1.0))

    def cut(self, line: int, part: float, place: int | None = None) -> int:
        """Cut a line at a part of it, and return the place."""
        reach = JOINED / self.span[line]
        if part <= reach or part >= 1 - reach:
            return 2 * line + int(part > 0.5)
        if place is None:
            a, b = self.ends[line]
            self.places.append(tuple((a + part * (b - a)).tolist()))
            place = len(self.places) - 1
        self.cuts.append((line, part, place))
        return place

    def near(self, shapes: Shapes, reach: FloatArray) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
        """Yield shapes and lines whose copper meets, with their distance in m.

        `reach` (m,) is half the width in m of the shapes. Lines are taken by classes of width, so
        that a wide one makes no others look near.
        """
        classes = np.ceil(np.log2(self.width))
        for size in np.unique(classes):
            own = np.flatnonzero(classes == size)
            widest = float(self.width[own].max()) / 2
            tree = shapely.STRtree(self.lines[own])
            found, index = tree.query(shapes, predicate="dwithin", distance=np.maximum(reach + widest, JOINED))
            line = own[index]
            apart = shapely.distance(shapes[found], self.lines[line])
            met = (apart <= JOINED) | (apart < reach[found] + self.width[line] / 2 - _OVERLAP)
            yield found[met], line[met], apart[met]

    def join_lines(self) -> list[tuple[int, int, float]]:
        """Cut lines where others end on or cross them, and return overlaps: place, line, part."""
        first, second = shapely.STRtree(self.lines).query(self.lines, predicate="intersects")
        first, second = first[first < second], second[first < second]
        apart = np.array([
            np.hypot(*(self.ends[first, a] - self.ends[second, b]).T) for a in (0, 1) for b in (0, 1)
        ])  # fmt: skip
        crossed = apart.min(axis=0, initial=np.inf) > JOINED
        meet = shapely.intersection(self.lines[first[crossed]], self.lines[second[crossed]])
        for i, j, point in zip(first[crossed].tolist(), second[crossed].tolist(), meet.tolist(), strict=True):
            if isinstance(point, shapely.Point) and not point.is_empty:
                at = np.array([[point.x, point.y]])
                place = self.cut(i, float(self.along(np.array([i]), at)[0]))
                self.cut(j, float(self.along(np.array([j]), at)[0]), place)
        overlaps = []
        places = np.array(self.places[: self.first_hub] or np.empty((0, 2)))
        for ends, lines, apart in self.near(np.asarray(shapely.points(places)), np.repeat(self.width, 2) / 2):
            part = self.along(lines, places[ends])
            for k in np.flatnonzero(ends // 2 != lines).tolist():
                if apart[k] <= JOINED:
                    self.cut(int(lines[k]), float(part[k]), int(ends[k]))
                else:
                    overlaps.append((int(ends[k]), int(lines[k]), float(part[k])))
        return overlaps

    def edges(self) -> FloatArray:
        """Rows (m, 7): both places, width in m, item, whether drawn, whether an overlap, layer."""
        ends, line = self.parts()
        drawn = np.column_stack((ends, self.width[line], self.item[line], np.tile([1.0, 0.0], (len(line), 1))))
        bridges = [(*bridge[:4], 0.0, bridge[4]) for bridge in self.bridges]
        rows = np.vstack((drawn, np.array(bridges).reshape(-1, 6)))
        return np.column_stack((rows, np.full(len(rows), self.number)))

    def merged(self) -> IntArray:
        """Lowest number of the places that are one with each."""
        from scipy.spatial import KDTree

        near = KDTree(np.array(self.places).reshape(-1, 2)).query_pairs(JOINED, output_type="ndarray")
        return np.array(groups(len(self.places), near), dtype=np.int64)

    def parts(self) -> tuple[IntArray, IntArray]:
        """Places (m, 2) at the ends of the lines' parts, and their lines (m,)."""
        line, part, place = np.array(self.cuts).reshape(-1, 3).T
        order = np.lexsort((part, line))
        line, place = line[order].astype(np.int64), place[order].astype(np.int64)
        within = line[1:] == line[:-1]
        return np.column_stack((place[:-1], place[1:]))[within], line[:-1][within]

    def bridge(self, overlaps: Sequence[tuple[int, int, float]]) -> None:
        """Join ends to lines that their copper reaches, unless a way as short does so."""
        if not overlaps:
            return
        node = self.merged()
        pairs, lines = self.parts()
        around: dict[int, list[tuple[int, float, int]]] = {}
        places = np.array(self.places)
        lengths = np.hypot(*(places[pairs[:, 0]] - places[pairs[:, 1]]).T).tolist()
        for (a, b), length, line in zip(node[pairs].tolist(), lengths, lines.tolist(), strict=True):
            around.setdefault(a, []).append((b, length, line))
            around.setdefault(b, []).append((a, length, line))
        by_node: dict[int, list[tuple[int, int, float]]] = {}
        for overlap in overlaps:
            by_node.setdefault(int(node[overlap[0]]), []).append(overlap)
        for start, found in by_node.items():
            reach = max(self.width[place // 2] + self.width[line] for place, line, _ in found)
            distance = _reached(start, around, float(reach))
            for place, line, part in found:
                within = self.width[place // 2] + self.width[line]
                if distance.get(line, np.inf) > within:
                    width, item = float(self.width[place // 2]), int(self.item[place // 2])
                    self.bridges.append((place, self.cut(line, part), width, item, True))

    def join_shapes(self) -> None:
        """Join holes, pads and areas to the lines that their copper meets, and to each other."""
        for hub, line, _ in self.near(self.shapes, np.zeros(len(self.shapes))):
            inside = np.stack([
                shapely.distance(self.shapes[hub], shapely.points(self.ends[line, end])) < self.width[line] / 2
                for end in (0, 1)
            ]).T  # fmt: skip
            part = self.along(line, self.hub[hub])
            beside = self.ends[line, 0] + part[:, None] * (self.ends[line, 1] - self.ends[line, 0])
            centred = np.hypot(*(beside - self.hub[hub]).T) <= JOINED
            for k in range(len(hub)):
                own, on = self.first_hub + int(hub[k]), int(line[k])
                if centred[k]:
                    self.cut(on, float(part[k]), own)
                    continue
                places = [2 * on + end for end in (0, 1) if inside[k, end]] or [self.cut(on, float(part[k]))]
                for place in places:
                    self.bridges.append((place, own, float(self.width[on]), int(self.hub_item[hub[k]]), False))
        i, j = shapely.STRtree(self.shapes).query(self.shapes, predicate="intersects")
        bounds = shapely.bounds(self.shapes).reshape(-1, 4)
        sizes = (bounds[:, 2:] - bounds[:, :2]).min(axis=1)
        for a, b in zip(i[i < j].tolist(), j[i < j].tolist(), strict=True):
            width = float(min(sizes[a], sizes[b]))
            self.bridges.append((self.first_hub + a, self.first_hub + b, width, int(self.hub_item[a]), False))


def _reached(start: int, around: dict[int, list[tuple[int, float, int]]], limit: float) -> dict[int, float]:
    """Distance in m along the copper from a node to the lines within a limit."""
    lines: dict[int, float] = {}
    done: set[int] = set()
    waiting = [(0.0, start)]
    while waiting:
        distance, here = heapq.heappop(waiting)
        if here in done:
            continue
        done.add(here)
        for other, length, line in around.get(here, ()):
            lines.setdefault(line, distance)
            if distance + length <= limit and other not in done:
                heapq.heappush(waiting, (distance + length, other))
    return lines


def require_followable(lines: Shapes, where: str) -> None:
    """Refuse centre lines whose bounds overlap so often that following takes minutes."""
    points = np.asarray(shapely.points(shapely.get_coordinates(lines)))
    sample = points[:: max(len(points) // _SAMPLE, 1)]
    pairs = shapely.STRtree(lines).query(sample).shape[1] / max(len(sample), 1) * len(points)
    if pairs > _MOST_PAIRS:
        raise BoardError(
            f"{where}: {len(lines)} tracks lie across each other too often to be followed: their bounds meet about "
            f"{pairs:.0e} times, and may {_MOST_PAIRS:.0e} times."
        )


def copper_graph(board: BoardCopper, progress: Progress | None = None) -> CopperGraph:
    """Join the copper of a board where it overlaps, by layers and through holes.

    Tracks, drawn lines and narrow drawn shapes are followed along their centres. They are cut
    where others end on them or cross them. An end is joined to a line that its copper reaches.
    Holes, pads and wide shapes are joined to all the copper that they meet.
    """
    layers = board.stackup.names
    items: list[Copper] = []
    lines: dict[str, list[tuple[FloatArray, FloatArray, int]]] = {layer: [] for layer in layers}
    shapes: dict[str, list[tuple[BaseGeometry, tuple[float, float], int]]] = {layer: [] for layer in layers}
    for track in board.tracks:
        ends = np.array((track.start, track.end))
        if np.hypot(*(ends[1] - ends[0])) > JOINED:
            lines[track.layer].append((ends, np.array([track.width]), len(items)))
        else:
            shapes[track.layer].append((track.copper[track.layer], track.start, len(items)))
        items.append(track)
    stands: list[Hole | SurfacePad] = [*board.holes, *board.pads]
    for stand in stands:
        for layer, shape in stand.copper.items():
            shapes[layer].append((shape, (stand.x, stand.y), len(items)))
        items.append(stand)
    for area in board.areas:
        found = centre_lines(area.shape)
        lines[area.layer] += [(line, widths, len(items)) for line, widths in found]
        if not found:
            at = area.shape.representative_point()
            shapes[area.layer].append((area.shape, (at.x, at.y), len(items)))
        items.append(area)
    joined = [_joined(k, lines[layer], shapes[layer], items) for k, layer in enumerate(layers)]
    for k, copper in enumerate(joined):
        copper.bridge(copper.join_lines())
        copper.join_shapes()
        if progress is not None:
            progress(k + 1, len(joined))
    return _graph(joined, items, layers)


def _joined(
    number: int,
    lines: Sequence[tuple[FloatArray, FloatArray, int]],
    shapes: Sequence[tuple[BaseGeometry, tuple[float, float], int]],
    items: Sequence[Copper],
) -> _Layer:
    pieces = [np.stack((line[:-1], line[1:]), axis=1) for line, _, _ in lines]
    ends = np.vstack(pieces) if pieces else np.empty((0, 2, 2))
    width = np.concatenate([widths for _, widths, _ in lines]) if lines else np.empty(0)
    item = np.repeat([k for _, _, k in lines], [len(widths) for _, widths, _ in lines]).astype(np.int64)
    outlines = np.array([shape for shape, _, _ in shapes], dtype=object)
    hub = np.array([at for _, at, _ in shapes]).reshape(-1, 2)
    if len(ends):
        require_followable(np.asarray(shapely.linestrings(ends)), items[item[0]].where)
    return _Layer(number, ends, width, item, outlines, hub, np.array([k for _, _, k in shapes], dtype=np.int64))


def _graph(joined: Sequence[_Layer], items: Sequence[Copper], layers: Sequence[str]) -> CopperGraph:
    """Make nodes of the places of all layers, and collect the edges between them."""
    counts = np.cumsum([0, *(len(layer.places) for layer in joined)])
    hubs: dict[int, list[int]] = {}  # places by the number of a hole, pad or area
    same, edges = [], []
    for layer, first in zip(joined, counts.tolist(), strict=False):
        same.append(np.column_stack((layer.merged(), np.arange(len(layer.places)))) + first)
        edges.append(layer.edges() + np.array([first, first, 0, 0, 0, 0, 0]))
        for k, item in enumerate(layer.hub_item.tolist()):
            hubs.setdefault(item, []).append(first + layer.first_hub + k)
    same.append(np.array([(own[0], other) for own in hubs.values() for other in own[1:]]).reshape(-1, 2))
    lowest = np.array(groups(int(counts[-1]), np.vstack(same)), dtype=np.int64)
    used, node = np.unique(lowest, return_inverse=True)
    nodes = np.array([place for layer in joined for place in layer.places]).reshape(-1, 2)[used]
    stands: dict[int, list[Hole | SurfacePad]] = {}
    areas: dict[int, CopperArea] = {}
    for number, own in hubs.items():
        here, item = int(node[own[0]]), items[number]
        if isinstance(item, CopperArea):
            areas[here] = item
        elif isinstance(item, (Hole, SurfacePad)):
            if here not in stands:
                nodes[here] = item.x, item.y
            stands.setdefault(here, []).append(item)
    rows = np.vstack(edges)
    pairs = np.sort(node[rows[:, :2].astype(np.int64)], axis=1)
    # of edges between the same nodes on a layer the first is kept, with the largest width, lines before bridges
    order = np.lexsort((-rows[:, 2], -rows[:, 4]))
    order = order[np.unique(np.column_stack((pairs, rows[:, 6]))[order], axis=0, return_index=True)[1]]
    order = np.sort(order[pairs[order, 0] != pairs[order, 1]])
    pairs, (width, of, drawn, overlap, on) = pairs[order], rows[order, 2:].T
    length = np.hypot(*(nodes[pairs[:, 0]] - nodes[pairs[:, 1]]).T)
    piece = np.array(groups(len(nodes), pairs), dtype=np.int64)
    return CopperGraph(
        nodes, pairs, length, width, on.astype(np.int64), of.astype(np.int64), drawn > 0, overlap > 0, items, layers,
        stands, areas, piece,
    )  # fmt: skip
