"""Tracks, holes and pads of one net as a graph: nodes where ends meet, edges of straight copper."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.geometry.readers.board_copper import Hole, SurfacePad, Track

Point = tuple[float, float]

JOINED = 1e-6
"""Ends closer than this many m are one place, whatever lies there."""


@dataclass(frozen=True, eq=False)
class TrackNode:
    """A place where ends of tracks meet.

    Parameters
    ----------
    x, y : float
        In m: the centre of its hole or pad, else the first end that lies there.
    hole : Hole or None
        What joins its layers.
    pad : Hole or SurfacePad or None
        The pad of a footprint that it lies on.
    edges : tuple of int
        Indices of the edges that end here.
    """

    x: float
    y: float
    hole: Hole | None
    pad: Hole | SurfacePad | None
    edges: tuple[int, ...]


@dataclass(frozen=True)
class TrackEdge:
    """Straight copper between two nodes.

    Parameters
    ----------
    ends : tuple of int
        Indices of its nodes.
    layer : str
        Of the copper.
    width : float
        In m.
    track : int
        Index of the track that it is a part of.
    """

    ends: tuple[int, int]
    layer: str
    width: float
    track: int


@dataclass(frozen=True, eq=False)
class TrackGraph:
    """Nodes with at least one edge, and edges, no two of one layer between the same nodes."""

    nodes: tuple[TrackNode, ...]
    edges: tuple[TrackEdge, ...]

    def points(self, edge: TrackEdge) -> tuple[Point, Point]:
        """Return the places of an edge's two ends in m."""
        a, b = (self.nodes[number] for number in edge.ends)
        return (a.x, a.y), (b.x, b.y)

    def components(self) -> list[list[int]]:
        """Return the indices of the edges that hang together, in the order of their tracks."""
        sets = _Sets(len(self.nodes))
        for edge in self.edges:
            sets.unite(*edge.ends)
        found: dict[int, list[int]] = {}
        for index, edge in enumerate(self.edges):
            found.setdefault(sets.of(edge.ends[0]), []).append(index)
        return list(found.values())


@dataclass(frozen=True)
class _Piece:
    """Part of a track between two of the places that it runs over; `track` is the index of the whole."""

    layer: str
    start: Point
    end: Point
    width: float
    track: int


@dataclass(frozen=True, eq=False)
class _Stand:
    """A hole or pad where it meets one layer."""

    layer: str
    at: Point
    size: float
    what: Hole | SurfacePad


class _Sets:
    """Disjoint sets of indices that can be united."""

    def __init__(self, count: int) -> None:
        self._above = list(range(count))

    def of(self, index: int) -> int:
        while self._above[index] != index:
            self._above[index] = self._above[self._above[index]]
            index = self._above[index]
        return index

    def unite(self, one: int, other: int) -> None:
        low, high = sorted((self.of(one), self.of(other)))
        self._above[high] = low


def track_graph(tracks: Sequence[Track], holes: Sequence[Hole], pads: Sequence[SurfacePad]) -> TrackGraph:
    """Join tracks of one net at their ends, at holes and at pads.

    Parameters
    ----------
    tracks, holes, pads : sequences
        Of one net, or of copper whose nets are not known.

    Returns
    -------
    TrackGraph

    Notes
    -----
    A track is divided wherever another track's end, a hole or a pad lies on its centre line to within `JOINED`; parts
    that then lie on each other count once, with the larger width. So tracks that overlap lengthwise become one path,
    and a track that ends on the middle of another one gives a node of three edges. A loose end, where nothing else
    stands or ends, is led on to the centre of the hole or pad that it lies in, or to another loose end that its
    round cap reaches.

    Examples
    --------
    >>> tracks = [
    ...     Track("F.Cu", (0, 0), (6e-3, 0), 2e-4, "A", "file:1"),
    ...     Track("F.Cu", (4e-3, 0), (9e-3, 0), 2e-4, "A", "file:2"),
    ... ]
    >>> graph = track_graph(tracks, [], [])
    >>> len(graph.edges), [len(node.edges) for node in graph.nodes]
    (3, [1, 2, 2, 1])
    """
    stands = [
        *(_Stand(layer, (hole.x, hole.y), hole.pad, hole) for hole in holes for layer in hole.layers),
        *(_Stand(pad.layer, (pad.x, pad.y), pad.size, pad) for pad in pads),
    ]
    pieces = _divided(tracks, stands)
    pieces += _bridges(pieces, stands)
    return _graph(pieces, stands)


def _divided(tracks: Sequence[Track], stands: Sequence[_Stand]) -> list[_Piece]:
    """Cut tracks where ends, holes and pads lie on them; tracks without a length are dropped."""
    long = [k for k, track in enumerate(tracks) if math.dist(track.start, track.end) > JOINED]
    marks = [(tracks[k].layer, at) for k in long for at in (tracks[k].start, tracks[k].end)]
    marks += [(stand.layer, stand.at) for stand in stands]
    cuts: dict[int, list[Point]] = {k: [] for k in long}
    lines = shapely.STRtree([shapely.LineString((tracks[k].start, tracks[k].end)) for k in long])
    for mark, index in lines.query(_points(marks), predicate="dwithin", distance=JOINED).T.tolist():
        track, (layer, at) = tracks[long[index]], marks[mark]
        if track.layer == layer and min(math.dist(at, track.start), math.dist(at, track.end)) > JOINED:
            cuts[long[index]].append(at)
    pieces = []
    for k in long:
        track = tracks[k]
        places = [track.start, *_sorted_from(track.start, cuts[k]), track.end]
        pieces += [_Piece(track.layer, a, b, track.width, k) for a, b in pairwise(places) if math.dist(a, b) > JOINED]
    return pieces


def _sorted_from(start: Point, places: list[Point]) -> list[Point]:
    return sorted(places, key=lambda at: math.dist(at, start))


def _bridges(pieces: Sequence[_Piece], stands: Sequence[_Stand]) -> list[_Piece]:
    """Copper from loose ends to the pad or the other loose end that they overlap."""
    ends = [(piece, at) for piece in pieces for at in (piece.start, piece.end)]
    places = [*((piece.layer, at) for piece, at in ends), *((stand.layer, stand.at) for stand in stands)]
    company = [0] * len(places)
    for i, j in _close_pairs(places, JOINED):
        company[i] += 1
        company[j] += 1
    loose = [k for k in range(len(ends)) if not company[k]]
    bridges = []
    free = []
    for k in loose:
        piece, at = ends[k]
        around = [stand for stand in stands if stand.layer == piece.layer and math.dist(stand.at, at) <= stand.size / 2]
        if around:
            nearest = min(around, key=lambda stand: math.dist(stand.at, ends[k][1]))
            bridges.append(_Piece(piece.layer, at, nearest.at, piece.width, piece.track))
        else:
            free.append(k)
    widest = max((ends[k][0].width for k in free), default=0.0)
    met: set[int] = set()
    for i, j in _close_pairs([(ends[k][0].layer, ends[k][1]) for k in free], widest / 2):
        (one, at), (other, there) = ends[free[i]], ends[free[j]]
        reach = min(one.width, other.width) / 2
        if one is not other and not {i, j} & met and math.dist(at, there) <= reach:
            met |= {i, j}
            bridges.append(_Piece(one.layer, at, there, min(one.width, other.width), one.track))
    return bridges


def _close_pairs(places: Sequence[tuple[str, Point]], distance: float) -> list[tuple[int, int]]:
    """Pairs i < j of places on one layer that are at most `distance` in m apart."""
    points = _points(places)
    pairs = shapely.STRtree(points).query(points, predicate="dwithin", distance=distance).T.tolist()
    return [(i, j) for i, j in pairs if i < j and places[i][0] == places[j][0]]


def _points(places: Sequence[tuple[str, Point]]) -> npt.NDArray[np.object_]:
    return np.asarray(shapely.points(np.array([at for _, at in places]).reshape(-1, 2)))


def _graph(pieces: Sequence[_Piece], stands: Sequence[_Stand]) -> TrackGraph:
    places = [
        *((stand.layer, stand.at) for stand in stands),
        *((piece.layer, at) for piece in pieces for at in (piece.start, piece.end)),
    ]
    sets = _Sets(len(places))
    for i, j in _close_pairs(places, JOINED):
        sets.unite(i, j)
    first: dict[int, int] = {}
    for k, stand in enumerate(stands):  # a hole joins its layers
        sets.unite(k, first.setdefault(id(stand.what), k))
    edges: dict[tuple[str, int, int], TrackEdge] = {}
    for k, piece in enumerate(pieces):
        a, b = (sets.of(len(stands) + 2 * k + end) for end in (0, 1))
        if a == b:
            continue
        key = (piece.layer, min(a, b), max(a, b))
        twin = edges.get(key)
        width = piece.width if twin is None else max(piece.width, twin.width)
        edges[key] = TrackEdge((a, b), piece.layer, width, piece.track) if twin is None else replace(twin, width=width)
    return _numbered(sets, places, stands, list(edges.values()))


def _numbered(
    sets: _Sets, places: Sequence[tuple[str, Point]], stands: Sequence[_Stand], edges: Sequence[TrackEdge]
) -> TrackGraph:
    """Return the graph with the nodes that have edges numbered from 0, and what stands at each."""
    numbers: dict[int, int] = {}
    ends_at: list[list[int]] = []
    numbered = []
    for index, edge in enumerate(edges):
        for end in edge.ends:
            if end not in numbers:
                numbers[end] = len(numbers)
                ends_at.append([])
            ends_at[numbers[end]].append(index)
        numbered.append(replace(edge, ends=(numbers[edge.ends[0]], numbers[edge.ends[1]])))
    here: dict[int, list[Hole | SurfacePad]] = {}
    for k, stand in enumerate(stands):
        here.setdefault(sets.of(k), []).append(stand.what)
    nodes = []
    for root, number in numbers.items():
        standing = here.get(root, [])
        hole = next((what for what in standing if isinstance(what, Hole)), None)
        pad = next((what for what in standing if not (isinstance(what, Hole) and what.kind == "via")), None)
        x, y = places[root][1]  # the lowest index of a set: a hole or pad where one stands there
        nodes.append(TrackNode(x, y, hole, pad, tuple(ends_at[number])))
    return TrackGraph(tuple(nodes), tuple(numbered))
