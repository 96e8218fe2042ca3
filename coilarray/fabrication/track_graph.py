"""Graph of tracks, and the path of a connected piece."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import groupby, pairwise

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.compute.arrays import FloatArray
from coilarray.errors import BoardError
from coilarray.fabrication.board import Hole, SurfacePad, Track
from coilarray.geometry.arcs import Point, place_in_mm
from coilarray.geometry.copper import groups
from coilarray.geometry.winding import FlatPath, Pole, find_turns, turns_about

JOINED = 1e-6  # distance in m below which ends are one place, whatever lies there
_BEND = 1.5  # turns; a bend makes less about a place within it
_NO_AREA = 1e-6  # of the squared length of a path: a smaller area that it runs around counts as zero
_MOST_PAIRS = 1e8  # of an end and a track whose bounds meet; each takes about a microsecond
_SAMPLE = 1000  # ends by which they are counted
_FEW, _CERTAIN = 20, 10.0  # ends for a quick count, and the excess from which it is certain


@dataclass(frozen=True, eq=False)
class TrackNode:
    """Place in m where `edges` end: the centre of a hole or pad, or the first end."""

    x: float
    y: float
    hole: Hole | None
    pad: Hole | SurfacePad | None
    edges: tuple[int, ...]


@dataclass(frozen=True)
class TrackEdge:
    """Straight copper between two nodes, by index, with width in m and index of its track."""

    ends: tuple[int, int]
    layer: str
    width: float
    track: int


@dataclass(frozen=True, eq=False)
class TrackGraph:
    """Nodes, each with an edge, and edges, one on a layer between two nodes."""

    nodes: dict[int, TrackNode]
    edges: tuple[TrackEdge, ...]
    tracks: Sequence[Track]

    def where(self, edge: int) -> str:
        """File and line of an edge, for messages."""
        return self.tracks[self.edges[edge].track].where

    def place(self, edge: int) -> str:
        """Place where an edge begins, for messages."""
        node = self.nodes[self.edges[edge].ends[0]]
        return place_in_mm(node.x, node.y)

    def components(self) -> list[list[int]]:
        """Return the indices of connected edges, by tracks."""
        piece = groups(max(self.nodes, default=-1) + 1, (edge.ends for edge in self.edges))
        found: dict[int, list[int]] = {}
        for index, edge in enumerate(self.edges):
            found.setdefault(piece[edge.ends[0]], []).append(index)
        return list(found.values())


@dataclass(frozen=True)
class _Piece:
    """Part of the track of index `track` between two places."""

    layer: str
    start: Point
    end: Point
    width: float
    track: int


@dataclass(frozen=True, eq=False)
class _Stand:
    """Hole or pad on one layer."""

    layer: str
    at: Point
    size: float
    what: Hole | SurfacePad


def track_graph(tracks: Sequence[Track], holes: Sequence[Hole], pads: Sequence[SurfacePad]) -> TrackGraph:
    """Join tracks at their ends, at holes and at pads.

    A track is divided wherever an end, a hole or a pad lies on its centre line to within `JOINED`.
    Parts on each other count once, with the larger width. A loose end is continued to the centre of
    the hole or pad in which it lies, or to another loose end that its round cap reaches.
    """
    require_followable(tracks)
    stands = [
        *(_Stand(layer, (hole.x, hole.y), hole.pad, hole) for hole in holes for layer in hole.layers),
        *(_Stand(pad.layer, (pad.x, pad.y), pad.size, pad) for pad in pads),
    ]
    pieces = _divided(tracks, stands)
    pieces += _bridges(pieces, stands)
    return _graph(pieces, stands, tracks)


def require_followable(tracks: Sequence[Track]) -> None:
    """Refuse tracks whose bounds overlap so often that following takes minutes."""
    ends = np.array([(track.start, track.end) for track in tracks]).reshape(-1, 2, 2)
    lines = shapely.STRtree(np.asarray(shapely.linestrings(ends)))
    points: npt.NDArray[np.object_] = np.asarray(shapely.points(ends.reshape(-1, 2)))
    for count, certain in ((_FEW, _CERTAIN), (_SAMPLE, 1.0)):  # a small sample is enough for gross excess
        sample = points[:: max(len(points) // count, 1)]
        pairs = lines.query(sample).shape[1] / max(len(sample), 1) * len(points)
        if pairs > certain * _MOST_PAIRS:
            raise BoardError(
                f"{tracks[0].where}: {len(tracks)} tracks lie across each other too often to be followed: their bounds "
                f"meet about {pairs:.0e} times, and may {_MOST_PAIRS:.0e} times."
            )


def _divided(tracks: Sequence[Track], stands: Sequence[_Stand]) -> list[_Piece]:
    """Cut tracks at ends, holes and pads on them, and drop those without a length."""
    long = [k for k, track in enumerate(tracks) if math.dist(track.start, track.end) > JOINED]
    marks = [(tracks[k].layer, at) for k in long for at in (tracks[k].start, tracks[k].end)]
    marks += [(stand.layer, stand.at) for stand in stands]
    cuts: dict[int, list[Point]] = {k: [] for k in long}
    lines = shapely.STRtree([shapely.LineString((tracks[k].start, tracks[k].end)) for k in long])
    points = _points(marks)
    for mark, index in lines.query(points, predicate="dwithin", distance=JOINED).T.tolist():
        track, (layer, at) = tracks[long[index]], marks[mark]
        if track.layer == layer and min(math.dist(at, track.start), math.dist(at, track.end)) > JOINED:
            cuts[long[index]].append(at)
    pieces = []
    for k in long:
        track = tracks[k]
        places = [track.start, *sorted(cuts[k], key=partial(math.dist, track.start)), track.end]
        pieces += [_Piece(track.layer, a, b, track.width, k) for a, b in pairwise(places) if math.dist(a, b) > JOINED]
    return pieces


def _bridges(pieces: Sequence[_Piece], stands: Sequence[_Stand]) -> list[_Piece]:
    """Copper from loose ends to pads or other ends."""
    ends = [(piece, at) for piece in pieces for at in (piece.start, piece.end)]
    places = [*((piece.layer, at) for piece, at in ends), *((stand.layer, stand.at) for stand in stands)]
    joined = {k for pair in _close_pairs(places, JOINED) for k in pair}
    loose = [k for k in range(len(ends)) if k not in joined]
    bridges = []
    tree = shapely.STRtree(_points([(stand.layer, stand.at) for stand in stands]))
    widest_stand = max((stand.size for stand in stands), default=0.0)
    found = tree.query(_points([places[k] for k in loose]), "dwithin", distance=widest_stand / 2)
    around: dict[int, list[tuple[float, Point]]] = {}
    for number, index in found.T.tolist():
        (layer, at), stand = places[loose[number]], stands[index]
        if stand.layer == layer and (apart := math.dist(stand.at, at)) <= stand.size / 2:
            around.setdefault(loose[number], []).append((apart, stand.at))
    for k, near in around.items():
        piece, at = ends[k]
        _, nearest = min(near, key=lambda place: place[0])
        bridges.append(_Piece(piece.layer, at, nearest, piece.width, piece.track))
    free = [k for k in loose if k not in around]
    widest = max((ends[k][0].width for k in free), default=0.0)
    met: set[int] = set()
    for i, j in _close_pairs([places[k] for k in free], widest / 2):
        (one, at), (other, there) = ends[free[i]], ends[free[j]]
        radius = min(one.width, other.width) / 2
        if one is not other and not {i, j} & met and math.dist(at, there) <= radius:
            met |= {i, j}
            bridges.append(_Piece(one.layer, at, there, min(one.width, other.width), one.track))
    return bridges


def _close_pairs(places: Sequence[tuple[str, Point]], distance: float) -> list[tuple[int, int]]:
    """Pairs i < j of places at most `distance` (m) apart."""
    points = _points(places)
    pairs = shapely.STRtree(points).query(points, predicate="dwithin", distance=distance).T.tolist()
    return [(i, j) for i, j in pairs if i < j and places[i][0] == places[j][0]]


def _points(places: Sequence[tuple[str, Point]]) -> npt.NDArray[np.object_]:
    return np.asarray(shapely.points(np.array([at for _, at in places]).reshape(-1, 2)))


def _graph(pieces: Sequence[_Piece], stands: Sequence[_Stand], tracks: Sequence[Track]) -> TrackGraph:
    places = [
        *((stand.layer, stand.at) for stand in stands),
        *((piece.layer, at) for piece in pieces for at in (piece.start, piece.end)),
    ]
    first: dict[int, int] = {}
    joined = [(k, first.setdefault(id(stand.what), k)) for k, stand in enumerate(stands)]  # a hole joins its layers
    node_of = groups(len(places), [*_close_pairs(places, JOINED), *joined])
    edges: dict[tuple[str, int, int], TrackEdge] = {}
    for k, piece in enumerate(pieces):
        a, b = node_of[len(stands) + 2 * k : len(stands) + 2 * k + 2]
        if a == b:
            continue
        key = (piece.layer, min(a, b), max(a, b))
        twin = edges.setdefault(key, TrackEdge((a, b), piece.layer, piece.width, piece.track))
        edges[key] = replace(twin, width=max(piece.width, twin.width))
    ends_at: dict[int, list[int]] = {}
    for index, edge in enumerate(edges.values()):
        for end in edge.ends:
            ends_at.setdefault(end, []).append(index)
    here: dict[int, list[Hole | SurfacePad]] = {}
    for k, stand in enumerate(stands):
        here.setdefault(node_of[k], []).append(stand.what)
    nodes = {}
    for lowest, own in ends_at.items():
        standing = here.get(lowest, [])
        hole = next((what for what in standing if isinstance(what, Hole)), None)
        pad = next((what for what in standing if not (isinstance(what, Hole) and what.kind == "via")), None)
        x, y = places[lowest][1]  # of a hole or pad if there is any
        nodes[lowest] = TrackNode(x, y, hole, pad, tuple(own))
    return TrackGraph(nodes, tuple(edges.values()), tracks)


@dataclass(frozen=True, eq=False)
class TracedCoil:
    """Net that is one path from end to end."""

    name: str  # coil1, coil2, … without a `net`
    lines: tuple[FloatArray, ...]  # (n, 2), with the current, each on one of `layers`
    layers: tuple[str, ...]
    widths: tuple[FloatArray, ...]  # (n − 1,)
    vias: tuple[Hole, ...]
    ends: tuple[Hole | SurfacePad | None, Hole | SurfacePad | None]
    passed: tuple[Hole, ...]  # holes along the path that lead to no other layer
    where: str
    net: str | None = None

    @property
    def widest(self) -> float:
        """Largest width in m."""
        return max(float(widths.max()) for widths in self.widths)

    @property
    def path(self) -> FloatArray:
        """All lines joined (n, 2), without the vias, in m."""
        return np.vstack([self.lines[0][:1], *(line[1:] for line in self.lines)])

    @property
    def length(self) -> float:
        """Length of the path in m, without the vias."""
        return float(np.hypot(*np.diff(self.path, axis=0).T).sum())

    @cached_property
    def _cross(self) -> FloatArray:
        """Twice the signed areas in m² of the triangles from the beginning to each side."""
        points = self.path - self.path[0]
        following = np.roll(points, -1, axis=0)
        return np.asarray(points[:, 0] * following[:, 1] - points[:, 1] * following[:, 0])

    @property
    def _runs_around_nothing(self) -> bool:
        return bool(abs(self._cross.sum() / 2) <= _NO_AREA * self.length**2)

    @property
    def centre(self) -> Point:
        """Centre in m of the enclosed area, or the middle of the bounds."""
        path = self.path
        if self._runs_around_nothing:
            x, y = 0.5 * (path.min(axis=0) + path.max(axis=0))
        else:  # each part counts as often as the path runs around it
            both = path + np.roll(path, -1, axis=0) - 2 * path[0]
            x, y = path[0] + (both * self._cross[:, None]).sum(axis=0) / (3 * self._cross.sum())
        return float(x), float(y)

    @cached_property
    def poles(self) -> tuple[Pole, ...]:
        """Places about which the path winds, most turns first."""
        # A single loop and a meander, whose bends are no turns, have their centre: 0 turns around nothing.
        found = find_turns(FlatPath.of_lines(self.lines, self.widths))
        if found is not None:
            several = len(found.poles) > 1
            poles = [
                replace(pole, turns=found.own_turns(pole) if several else turns_about(self.path, (pole.x, pole.y)))
                for pole in found.poles
            ]
            poles.sort(key=lambda pole: -round(abs(pole.turns), 6))
            if abs(poles[0].turns) > _BEND:
                return tuple(poles)
        centre = self.centre
        return (Pole(*centre, 0.0 if self._runs_around_nothing else turns_about(self.path, centre)),)

    @property
    def turns(self) -> float:
        """Turns about the main pole, anticlockwise positive."""
        return self.poles[0].turns


def natural_order(name: str) -> list[tuple[bool, int, str]]:
    """Return a sort key that counts numbers in names: 7, A2, A10, B1."""
    parts = re.findall(r"[0-9]+|[^0-9]+", name)
    return [(not part.isdecimal(), int(part) if part.isdecimal() else 0, part) for part in parts]


def follow(name: str, what: str, graph: TrackGraph, piece: Sequence[int]) -> TracedCoil:
    """Follow connected copper, `what` in messages, from end to end."""
    # A piece that branches, is closed or crosses itself raises BoardError.
    numbers = list(dict.fromkeys(node for index in piece for node in graph.edges[index].ends))
    for number in numbers:
        node = graph.nodes[number]
        if len(node.edges) > 2:
            ways = ", ".join(dict.fromkeys(map(graph.where, node.edges)))
            raise BoardError(
                f"{graph.where(node.edges[0])}: {what} must have two ends; {len(node.edges)} ways meet at "
                f"{place_in_mm(node.x, node.y)} ({ways})."
            )
    ends = [number for number in numbers if len(graph.nodes[number].edges) == 1]
    if not ends:
        begins, through = graph.where(piece[0]), graph.place(piece[0])
        raise BoardError(f"{begins}: {what} must have two ends; it is closed, through {through}.")
    lines = [
        shapely.LineString([(graph.nodes[number].x, graph.nodes[number].y) for number in graph.edges[index].ends])
        for index in piece
    ]
    for i, j in shapely.STRtree(lines).query(lines, predicate="intersects").T.tolist():
        one, other = graph.edges[piece[i]], graph.edges[piece[j]]
        if i < j and one.layer == other.layer and not set(one.ends) & set(other.ends):
            at = place_in_mm(*shapely.get_coordinates(lines[i].intersection(lines[j]))[0])
            raise BoardError(
                f"{graph.where(piece[i])}: {what} must be one path; it crosses itself on {one.layer} at {at} "
                f"({graph.where(piece[j])})."
            )
    order: list[tuple[tuple[bool, list[tuple[bool, int, str]], int, bool], int]] = []  # numbered pads, then by file
    pad_numbers = []
    for number in ends:
        edge, pad = graph.edges[graph.nodes[number].edges[0]], graph.nodes[number].pad
        pad_numbers.append("" if pad is None else pad.number)
        first_of = natural_order(pad_numbers[-1])
        order.append(((not pad_numbers[-1], first_of, edge.track, edge.ends[0] != number), number))
    only_second = sorted(pad_numbers) == ["", "2"]  # the pad 1 is missing, not the pad 3
    start = ends[pad_numbers.index("")] if only_second else min(order)[1]
    steps: list[tuple[TrackEdge, int]] = []
    came, here = -1, start
    while onward := [index for index in graph.nodes[here].edges if index != came]:
        came = onward[0]
        first, last = graph.edges[came].ends
        here = last if first == here else first
        steps.append((graph.edges[came], here))
    return _traced(name, graph, start, steps)


def _traced(name: str, graph: TrackGraph, first: int, steps: Sequence[tuple[TrackEdge, int]]) -> TracedCoil:
    """Make the coil of a path from its `first` node, of edges with their next nodes."""
    lines, layers, widths, vias = [], [], [], []
    passed: list[Hole] = []
    at = first
    for layer, run in groupby(steps, key=lambda step: step[0].layer):
        on_layer = list(run)
        numbers = [at, *(number for _, number in on_layer)]
        nodes = [graph.nodes[number] for number in numbers]
        lines.append(np.array([(node.x, node.y) for node in nodes]))
        layers.append(layer)
        widths.append(np.array([edge.width for edge, _ in on_layer]))
        passed += [node.hole for node in nodes[1:-1] if node.hole is not None]
        at = numbers[-1]
        vias.append(nodes[-1].hole)
    holes = tuple(hole for hole in vias[:-1] if hole is not None)
    begins = graph.tracks[steps[0][0].track].where
    begin, end = graph.nodes[first], graph.nodes[at]
    ends = (begin.pad or begin.hole, end.pad or end.hole)
    return TracedCoil(name, tuple(lines), tuple(layers), tuple(widths), holes, ends, tuple(passed), begins)
