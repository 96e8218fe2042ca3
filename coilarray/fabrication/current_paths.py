"""Paths of the current in copper: windings between branches, pads and holes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from math import log

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

from coilarray.constants import MU_0
from coilarray.errors import BoardError
from coilarray.fabrication.board import Hole, SurfacePad
from coilarray.fabrication.copper_graph import JOINED, CopperGraph
from coilarray.fabrication.traced_coil import LEAST_TURNS, TracedCoil, natural_order
from coilarray.geometry.arcs import Point, place_in_mm
from coilarray.geometry.copper import groups

STRAIGHT = 1.5  # of the diagonal of the bounds: shorter copper makes no turn
_MOST_RINGS = 400  # planes and grids have more: their rings are taken as open without a look
_NO_HOLE = 0.05  # of a squared width: a smaller hole in copper is none
_APART = 0.5  # of the size of a winding: windings farther apart are two coils
_BESIDE = 10.0  # m, more than any way: a tree follows centre lines where there are any
_ALIKE = 0.97  # of the most turns, that the shortest way between two ends must make
Way = list[tuple[int, int]]  # edges of the graph with the node at their end, after a first edge −1 with the first node


@dataclass(frozen=True)
class Ring:
    """Copper that closes around an `inside`, with the place in m where and the reason that this gives."""

    at: Point
    reason: str
    inside: BaseGeometry


@dataclass(frozen=True, eq=False)
class Found:
    """Coils in connected copper, or the reason why there are none and its place in m.

    `way` is that with the most turns, whether it is a coil or not.
    """

    coils: tuple[TracedCoil, ...]
    reason: str = ""
    at: Point | None = None
    way: TracedCoil | None = None
    ringed: bool = False  # the current has several ways


class Piece:
    """Connected copper: a tree of ways, and the rings that close between them."""

    def __init__(self, graph: CopperGraph, nodes: Sequence[int], edges: Sequence[int]) -> None:
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

        self.graph = graph
        weight = graph.weight
        # ends of overlapping lines are one node of the tree, named by one of them
        real = {node: k for k, node in enumerate(nodes)}
        own = np.array(edges, dtype=np.int64)
        lapped = ((real[a], real[b]) for a, b in graph.edges[own[graph.overlap[own]]].tolist())
        self._name = {node: nodes[k] for node, k in zip(nodes, groups(len(nodes), lapped), strict=True)}
        self.nodes = list(dict.fromkeys(self._name.values()))
        self._number = {node: k for k, node in enumerate(self.nodes)}
        self._real, self._step = real, dict[tuple[int, int], int]()
        self._edge: dict[tuple[int, int], int] = {}
        beside = []  # edges between nodes that a shorter one joins
        for edge in sorted(edges, key=lambda edge: weight[edge]):
            a, b = graph.edges[edge].tolist()
            self._step.setdefault((a, b), edge)
            a, b = sorted((self._name[a], self._name[b]))
            if a != b and self._edge.setdefault((a, b), edge) != edge:
                beside.append(edge)
        steps = np.array(list(self._step.values()))
        i, j = (np.array([real[node] for node in column]) for column in graph.edges[steps].T.tolist())
        self._matrix = coo_array((weight[steps], (i, j)), shape=(len(nodes), len(nodes))).tocsr()
        kept, count = np.array(list(self._edge.values()), dtype=np.int64), len(self.nodes)
        i, j = np.array([[self._number[node] for node in pair] for pair in self._edge]).reshape(-1, 2).T
        self._degree = np.bincount(graph.edges[kept].ravel(), minlength=len(graph.nodes))
        along_lines = weight[kept] + np.where(graph.drawn[kept], 0.0, _BESIDE)
        tree = minimum_spanning_tree(coo_array((along_lines, (i, j)), shape=(count, count)).tocsr())
        order, before = breadth_first_order(tree, 0, directed=False)
        self._before, self._depth = before.tolist(), [0] * count
        for k in order[1:].tolist():
            self._depth[k] = self._depth[self._before[k]] + 1
        in_tree = {self._between(self.nodes[k], self.nodes[self._before[k]]) for k in order[1:].tolist()}
        self._closing = [edge for edge in kept.tolist() if edge not in in_tree] + beside
        self.rings: list[Ring] = []
        self._parts: dict[tuple[int, int], TracedCoil] = {}
        self.around = self._tree(in_tree)
        self.stands: dict[int, list[Hole | SurfacePad]] = {}
        for node in nodes:
            if node in graph.stands:
                self.stands.setdefault(self._name[node], []).extend(graph.stands[node])
        self._prune()

    def _between(self, a: int, b: int) -> int:
        return self._edge[(min(a, b), max(a, b))]

    def _tree(self, in_tree: set[int]) -> dict[int, dict[int, int]]:
        """Edges of the tree by both ends, with the copper of open rings as one node."""
        top = list(range(len(self.nodes)))  # of nodes in the copper of rings, a node for all

        def first(k: int) -> int:
            while top[k] != k:
                top[k] = top[top[k]]
                k = top[k]
            return k

        self._loose: set[int] = set()
        checked = 0
        for edge in self._closing:
            a, b = (self._number[self._name[node]] for node in self.graph.edges[edge].tolist())
            self._loose |= {self.nodes[a], self.nodes[b]}
            if first(a) == first(b):
                continue
            ring = self._ring(a, b)
            own = [edge, *(self._between(self.nodes[i], self.nodes[j]) for i, j in pairwise(ring))]
            inside = shapely.Polygon(self.graph.nodes[[self.nodes[k] for k in ring]] if len(ring) > 2 else None)
            # both sides of a ring no wider than its copper carry the current alike
            if inside.area <= float(self.graph.width[own].max()) * float(self.graph.length[own].sum()) / 2:
                continue
            checked += 1
            if checked > _MOST_RINGS or self._is_open(ring, own, inside.buffer(0)):
                for k in ring:
                    top[first(k)] = first(a)
        self._group = {node: self.nodes[first(k)] for k, node in enumerate(self.nodes)}
        around: dict[int, dict[int, int]] = {self._group[node]: {} for node in self.nodes}
        for edge in in_tree:
            a, b = (self._group[self._name[node]] for node in self.graph.edges[edge].tolist())
            if a != b:
                around[a][b] = around[b][a] = edge
        return around

    def _ring(self, a: int, b: int) -> list[int]:
        """Nodes on the tree's way between two nodes, by number."""
        left, right = [a], [b]
        while left[-1] != right[-1]:
            side = left if self._depth[left[-1]] >= self._depth[right[-1]] else right
            side.append(self._before[side[-1]])
        return [*left, *right[-2::-1]]

    def _is_open(self, ring: Sequence[int], own: Sequence[int], inside: BaseGeometry) -> bool:
        """Whether the copper of a ring's `own` edges has a hole inside that is wider than the copper."""
        graph = self.graph
        copper = [
            graph.items[graph.edge_item[each]].copper.get(graph.layers[graph.edge_layer[each]], shapely.Polygon())
            for each in own
        ]
        copper += [
            shape for k in ring for stand in graph.stands.get(self.nodes[k], ()) for shape in stand.copper.values()
        ]
        copper += [graph.areas[self.nodes[k]].shape for k in ring if self.nodes[k] in graph.areas]
        hole = inside - shapely.union_all(copper)
        if hole.area <= _NO_HOLE * float(graph.width[own].max()) ** 2:
            return False
        # what joins the ways is named: a pad, or the shortest copper at a fork
        forked = self._degree[graph.edges[own]].max(axis=1) > 2
        bridge = own[np.lexsort((graph.length[own], ~forked, graph.drawn[own]))[0]]
        item = graph.items[graph.edge_item[bridge]]
        at = graph.nodes[graph.edges[bridge]].mean(axis=0)
        layer = graph.layers[graph.edge_layer[bridge]]
        reason = (
            f"{item.where}: {item.what} closes a ring of copper on {layer} at {place_in_mm(*at)}, in which the current "
            "has two ways."
        )
        self.rings.append(Ring((float(at[0]), float(at[1])), reason, inside))
        return True

    def _prune(self) -> None:
        """Take away what carries no current: whiskers, cut rings, and pads beside the way."""
        graph, around = self.graph, self.around
        held: set[int] = set()  # ends in areas
        for node in list(around):
            if len(around[node]) == 1 and (node in self.stands or node in graph.areas):
                ((other, edge),) = around[node].items()
                if not graph.drawn[edge] and (node in graph.areas or len(around[other]) > 2):
                    self.stands.setdefault(other, []).extend(self.stands.pop(node, ()))
                    held.add(other)
                    del around[node], around[other][node]
        ends = [node for node, others in around.items() if len(others) == 1]
        for end in ends:
            if end in self.stands or end in held or len(around.get(end, ())) != 1:
                continue
            run = [end]
            while len(onward := [node for node in around[run[-1]] if node not in run[-2:-1]]) == 1 and (
                len(run) == 1 or run[-1] not in self.stands
            ):
                run += onward
            fork, own = run[-1], [around[a][b] for a, b in pairwise(run)]
            widest = graph.width[[*around[fork].values()]].max()
            short = graph.length[own].sum() <= widest + graph.width[own[0]]
            if (len(around[fork]) > 2 and short) or (end in self._loose and self._degree[end] > 1):
                for node, other in pairwise(run):
                    del around[other][node], around[node]

    def longest(self, start: int, without: frozenset[int] = frozenset()) -> list[int]:
        """Longest way of the tree from a node."""
        length, came = {start: 0.0}, {start: start}
        waiting = [start]
        while waiting:
            here = waiting.pop()
            for other, edge in self.around[here].items():
                if other not in length and other not in without:
                    length[other] = length[here] + float(self.graph.length[edge])
                    came[other] = here
                    waiting.append(other)
        way = [max(length, key=lambda node: length[node])]
        while way[-1] != start:
            way.append(came[way[-1]])
        return way[::-1]

    def coils(self) -> Found:
        """Find the coils, or the reason why there are none."""
        found: list[TracedCoil] = []
        best: TracedCoil | None = None
        rings = {group for node, group in self._group.items() if node != group}
        waiting: list[tuple[int, ...]] = [(self.longest(next(iter(self.around)))[-1],)]  # start, or fork and branch
        while waiting:
            *fork, start = waiting.pop()
            way = [*fork, *self.longest(start, frozenset(fork))]
            on = {*way}  # with the first nodes of the branches beside it
            arms = {node: [other for other in self.around[node] if other not in on] for node in way[len(fork) :]}
            winding = {node: [arm for arm in own if self._winds(node, arm)] for node, own in arms.items()}
            waiting += [(node, arm) for node, own in winding.items() for arm in own]
            cuts = [k for k, node in enumerate(way) if 0 < k < len(way) - 1 and (winding.get(node) or node in rings)]
            for first, last in pairwise([0, *cuts, len(way) - 1]):
                for coil in self._coils_on(way[first : last + 1], arms):
                    if abs(coil.turns) >= LEAST_TURNS and not self._is_ringed(coil):
                        found.append(coil)
                    if best is None or (abs(coil.turns), coil.length) > (abs(best.turns), best.length):
                        best = coil
        if found:
            return Found(_set_back(found), way=best)
        if self.rings:
            return Found((), self.rings[0].reason, self.rings[0].at, best, ringed=True)
        if best is None:
            return Found((), "it has no way from end to end.")
        x, y = best.path[0].tolist()
        reason = f"it makes {abs(best.turns):.2f} turns around a place; a coil makes at least one."
        return Found((), reason, (x, y), best)

    def between(self, first: int, last: int) -> TracedCoil:
        """Follow the way between two nodes of the tree, or raise BoardError."""
        if self.rings:
            raise BoardError(self.rings[0].reason)
        return self._traced(self._shortest(first, last))

    def _is_ringed(self, coil: TracedCoil) -> bool:
        """Whether a ring of the same copper is a turn of the coil."""
        places = [shapely.Point(pole.x, pole.y) for pole in coil.poles]
        return any(ring.inside.contains(place) for ring in self.rings for place in places)

    def _winds(self, node: int, arm: int) -> bool:
        """Whether the longest way of a branch makes turns."""
        way = self.longest(arm, frozenset((node,)))
        places = self.graph.nodes[way]
        length = np.hypot(*np.diff(places, axis=0).T).sum()
        if len(way) < 3 or length < STRAIGHT * np.hypot(*np.ptp(places, axis=0)):
            return False
        return abs(self._traced(self._shortest(arm, way[-1])).turns) >= LEAST_TURNS

    def _shortest(self, first: int, last: int) -> Way:
        """Shortest way in the copper between two nodes."""
        from scipy.sparse.csgraph import dijkstra

        a, b = self._real[first], self._real[last]
        real = [*self._real]
        before: list[int] = dijkstra(self._matrix, False, np.array(a), True)[1].ravel().tolist()
        way = [b]
        while way[-1] != a:
            way.append(before[way[-1]])
        nodes = [real[k] for k in way[::-1]]
        steps = (self._step[min(pair), max(pair)] for pair in pairwise(nodes))
        return [(-1, first), *zip(steps, nodes[1:], strict=True)]

    def _real_end(self, way: Sequence[int], end: int) -> int:
        """Node of the graph at an end of a tree's way, which may be the copper of a ring."""
        one, other = (way[0], way[1]) if end == 0 else (way[-1], way[-2])
        ends = self.graph.edges[self.around[one][other]].tolist()
        return int(next(node for node in ends if self._group[self._name[node]] == one))

    def _coils_on(self, way: Sequence[int], arms: dict[int, list[int]]) -> Iterator[TracedCoil]:
        """Yield the windings on a way, cut at pads and branches outside of them."""
        if len(way) < 2:
            return
        nodes = [self._real_end(way, 0), *way[1:-1], self._real_end(way, -1)]
        path = self._shortest(nodes[0], nodes[-1])
        whole = self._part(path, 0, len(path) - 1)
        names = [self._name[node] for _, node in path]
        on = {name: k for k, name in enumerate(names)}
        length = np.cumsum([0.0, *(float(self.graph.length[edge]) for edge, _ in path[1:])])
        stops = sorted({
            0, len(path) - 1,
            *(on[node] for node in nodes[1:-1] if node in on and (arms.get(node) or self._pads(node))),
        })  # fmt: skip
        if abs(whole.turns) < LEAST_TURNS and len(stops) < 3:
            yield whole
            return
        turns = whole.winding
        if turns is not None and abs(whole.turns) > 1.5:
            begin, end = turns.begin, turns.end
            if (whole.path[0] != self.graph.nodes[path[0][1]]).any():  # it begins at the other end
                begin, end = length[-1] - end, length[-1] - begin
            first = max((k for k in stops if length[k] <= begin + 1e-9), default=0)
            last = min((k for k in stops if length[k] >= end - 1e-9), default=len(path) - 1)
        else:
            most = abs(whole.turns)
            pairs = sorted(
                ((i, j) for i in stops for j in stops if i < j), key=lambda pair: length[pair[1]] - length[pair[0]]
            )
            made = ((i, j) for i, j in pairs if abs(self._part(path, i, j).turns) >= max(_ALIKE * most, LEAST_TURNS))
            first, last = next(made, (0, len(path) - 1))
        halves = [k for k in stops if first < k < last and self._apart(path, first, k, last)]
        for begin, end in pairwise([first, *halves, last]):
            coil = self._part(path, begin, end)
            arms_here = [(names[k], arm) for k in range(begin, end + 1) for arm in arms.get(names[k], ())]
            others = {name for node, arm in arms_here for name in self._names(node, arm)}
            others.update(name for k in stops if not first <= k <= last for name in self._pads(names[k]))
            others.difference_update(_name(end) for end in coil.ends if end is not None)
            named = " and ".join(sorted(others, key=natural_order))
            notes = (f"what leads on to {named} is left out.",) if named else ()
            yield replace(coil, notes=(*coil.notes, *notes))

    def _apart(self, path: Way, first: int, middle: int, last: int) -> bool:
        """Whether there are windings on both sides of a node about places of their own."""
        sides = [self._part(path, first, middle), self._part(path, middle, last)]
        if min(abs(side.turns) for side in sides) < LEAST_TURNS:
            return False
        size = min(float(np.hypot(*np.ptp(side.path, axis=0))) for side in sides)
        return bool(np.hypot(*np.subtract(sides[0].centre, sides[1].centre)) > _APART * size)

    def _part(self, path: Way, first: int, last: int) -> TracedCoil:
        ends = path[first][1], path[last][1]
        if ends not in self._parts:
            self._parts[ends] = self._traced([(-1, path[first][1]), *path[first + 1 : last + 1]])
        return self._parts[ends]

    def _pads(self, node: int) -> list[str]:
        """Names of the pads at a node of the tree."""
        return [_name(stand) for stand in self.stands.get(node, ()) if stand.kind == "pad"]

    def _names(self, node: int, arm: int) -> list[str]:
        """Names of the pads on a branch, or its last place."""
        waiting, names = [(node, arm)], []
        while waiting:
            before, here = waiting.pop()
            names += self._pads(here)
            waiting += [(here, other) for other in self.around[here] if other != before]
        return names or [f"an end at {self.graph.place(self.longest(arm, frozenset((node,)))[-1])}"]

    def _traced(self, way: Way) -> TracedCoil:
        """Make the coil of a way, which begins at the lower number of a pad."""
        graph = self.graph
        notes = []
        kept = [way[0]]
        for (edge, node), following in zip(way[1:], [*way[2:], None], strict=True):
            if following and node in graph.areas and not graph.drawn[[edge, following[0]]].any():
                notes.append(self._bridged(node, kept[-1][1], following[1], edge))
            else:
                kept.append((edge, node))
        terminals, firsts = [], []
        for edge, node in ((kept[1][0], kept[0][1]), kept[-1]):
            stands = self.stands.get(self._name[node], ())
            terminals.append(min(stands, key=lambda stand: stand.kind == "via", default=None))
            start = getattr(graph.items[graph.edge_item[edge]], "start", graph.nodes[node])
            firsts.append((int(graph.edge_item[edge]), float(np.hypot(*(graph.nodes[node] - start)))))
        if _is_reversed(terminals, firsts):
            nodes = [node for _, node in kept][::-1]
            kept = [(-1, nodes[0]), *zip([edge for edge, _ in kept[1:]][::-1], nodes[1:], strict=True)]
            terminals.reverse()
        lines, layers, widths, vias, passed = [], [], [], [], list[Hole]()
        at = kept[0][1]
        for layer, run in groupby(kept[1:], key=lambda step: graph.edge_layer[step[0]]):
            on_layer = list(run)
            nodes = [at, *(node for _, node in on_layer)]
            lines.append(graph.nodes[nodes])
            layers.append(graph.layers[int(layer)])
            widths.append(graph.width[[edge for edge, _ in on_layer]])
            passed += [hole for node in nodes[1:-1] for hole in self._holes(node)[:1]]
            at = nodes[-1]
            vias += self._holes(at)[:1]
        if self._holes(at):
            vias.pop()
        items = [graph.items[graph.edge_item[edge]] for edge, _ in kept[1:]]
        parts = {getattr(item, "part", "") for item in items}
        return TracedCoil(
            "", tuple(lines), tuple(layers), tuple(widths), tuple(vias), (terminals[0], terminals[1]), tuple(passed),
            items[0].where, part=parts.pop() if len(parts) == 1 else "",
            notes=tuple(dict.fromkeys(filter(None, notes))),
        )  # fmt: skip

    def _holes(self, node: int) -> list[Hole]:
        return [stand for stand in self.graph.stands.get(node, ()) if isinstance(stand, Hole)]

    def _bridged(self, node: int, before: int, after: int, edge: int) -> str:
        """Say how far a way through a wide shape may be wrong, or raise BoardError."""
        area, graph = self.graph.areas[node], self.graph
        width = float(graph.width[edge])
        way = shapely.LineString(graph.nodes[[before, after]])
        at = place_in_mm(*graph.nodes[node])
        if (way - area.shape).length > width:  # the copper of the lines that lead in
            raise BoardError(
                f"{area.where}: {area.what} on {area.layer} at {at} is wide, bent, and in the way of the current, "
                "which cannot be followed there."
            )
        if way.length <= 2 * width:
            return ""
        # at most all of the inductance of a ribbon as wide as the lead: Grover 1946, ch. 5
        most = MU_0 / (2 * np.pi) * way.length * (log(2 * way.length / width) + 0.5)
        return (
            f"{area.what} on {area.layer} at {at} is crossed the shortest way, {way.length * 1e3:.3g} mm; its "
            f"inductance is wrong by at most {most * 1e9:.2g} nH."
        )


def _set_back(coils: Sequence[TracedCoil]) -> tuple[TracedCoil, ...]:
    """Shorten coils at ends that they share by the width of their trace, so that their copper is apart."""
    ends = [(coil.layers[k], *np.round(coil.path[k] / JOINED).tolist()) for coil in coils for k in (0, -1)]
    made = [*coils]
    for place in (k for k, end in enumerate(ends) if ends.count(end) > 1):
        coil, k = made[place // 2], -(place % 2)
        lines, widths, terminals = [*coil.lines], [*coil.widths], [*coil.ends]
        line = shapely.LineString(lines[k])
        back = min(float(widths[k][k]), 0.9 * line.length)
        kept = substring(line, back, line.length) if k == 0 else substring(line, 0.0, line.length - back)
        lines[k] = shapely.get_coordinates(kept)
        widths[k] = widths[k][1 - len(lines[k]) :] if k == 0 else widths[k][: len(lines[k]) - 1]
        terminals[k] = None
        note = "it ends a trace width before the place that it shares with others."
        made[place // 2] = replace(
            coil, lines=tuple(lines), widths=tuple(widths), ends=(terminals[0], terminals[1]),
            notes=tuple(dict.fromkeys((*coil.notes, note))), _known={},
        )  # fmt: skip
    return tuple(made)


def _name(stand: Hole | SurfacePad) -> str:
    """Return U1.3 of a pad with the value of its part, or its place."""
    if not stand.part or not stand.number:
        return f"a {stand.kind} at {place_in_mm(stand.x, stand.y)}"
    return f"{stand.part}.{stand.number}{f' ({stand.value})' * bool(stand.value)}"


def _is_reversed(ends: Sequence[Hole | SurfacePad | None], firsts: Sequence[tuple[int, float]]) -> bool:
    """Whether the current enters at the last of two ends: by numbers of pads, then by the file."""
    numbers = ["" if end is None else end.number for end in ends]
    if sorted(numbers) == ["", "2"]:  # the pad 1 is missing, not the pad 3
        return numbers[0] == "2"
    first, last = (((not number, natural_order(number)), order) for number, order in zip(numbers, firsts, strict=True))
    return last < first
