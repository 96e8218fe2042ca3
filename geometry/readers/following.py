"""Follow one connected piece of copper from its beginning to its end."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np
import shapely

from coilarray.errors import BoardError
from coilarray.geometry.readers.board_copper import Hole, Track
from coilarray.geometry.readers.natural_order import natural_order
from coilarray.geometry.readers.traced_coil import TracedCoil
from coilarray.geometry.readers.track_graph import TrackEdge, TrackGraph, TrackNode


def follow(name: str, what: str, graph: TrackGraph, piece: Sequence[int], tracks: Sequence[Track]) -> TracedCoil:
    """Follow a piece of copper.

    Parameters
    ----------
    name : str
        Of the coil.
    what : str
        What the piece is called in messages: "net A".
    graph : TrackGraph
        What the piece is a part of.
    piece : sequence of int
        Indices of its edges, all connected.
    tracks : sequence of Track
        From which the graph was made.

    Returns
    -------
    TracedCoil
        For where it begins see `trace_coils`.

    Raises
    ------
    BoardError
        A piece that branches, is closed or crosses itself.
    """
    numbers = sorted({node for index in piece for node in graph.edges[index].ends})
    for number in numbers:
        node = graph.nodes[number]
        if len(node.edges) > 2:
            ways = ", ".join(dict.fromkeys(where(graph, index, tracks) for index in node.edges))
            raise BoardError(
                f"{where(graph, node.edges[0], tracks)}: {what} must have two ends; {len(node.edges)} ways meet at "
                f"{_at(node)} ({ways})."
            )
    ends = [number for number in numbers if len(graph.nodes[number].edges) == 1]
    if not ends:
        begins = where(graph, piece[0], tracks)
        raise BoardError(f"{begins}: {what} must have two ends; it is closed, through {place(graph, piece[0])}.")
    _refuse_crossing(what, graph, piece, tracks)
    pad_numbers = [_pad_number(graph, number) for number in ends]
    if sorted(pad_numbers) == ["", "2"]:  # the pad 1 is missing, not the pad 3
        start = ends[pad_numbers.index("")]
    else:
        start = min(ends, key=lambda number: _precedence(graph, number))
    return _traced(name, graph, list(_walk(graph, start)), tracks)


def place(graph: TrackGraph, edge: int) -> str:
    """Where an edge begins, for messages."""
    return _at(graph.nodes[graph.edges[edge].ends[0]])


def where(graph: TrackGraph, edge: int, tracks: Sequence[Track]) -> str:
    """File and line of an edge, for messages."""
    return tracks[graph.edges[edge].track].where


def _at(node: TrackNode) -> str:
    return f"({node.x * 1e3:.4g}, {node.y * 1e3:.4g}) mm"


def _precedence(graph: TrackGraph, number: int) -> tuple[bool, list[tuple[bool, int, str]], int, bool]:
    """Sort key of an end: numbered pads first, by number; then the place in the file."""
    edge = graph.edges[graph.nodes[number].edges[0]]
    pad_number = _pad_number(graph, number)
    return not pad_number, natural_order(pad_number), edge.track, edge.ends[0] != number


def _pad_number(graph: TrackGraph, number: int) -> str:
    pad = graph.nodes[number].pad
    return "" if pad is None else pad.number


def _refuse_crossing(what: str, graph: TrackGraph, piece: Sequence[int], tracks: Sequence[Track]) -> None:
    """Raise where tracks meet on a layer elsewhere than at their ends."""
    lines = [shapely.LineString(graph.points(graph.edges[index])) for index in piece]
    for i, j in shapely.STRtree(lines).query(lines, predicate="intersects").T.tolist():
        one, other = graph.edges[piece[i]], graph.edges[piece[j]]
        if i < j and one.layer == other.layer and not set(one.ends) & set(other.ends):
            x, y = shapely.get_coordinates(lines[i].intersection(lines[j]))[0] * 1e3
            raise BoardError(
                f"{where(graph, piece[i], tracks)}: {what} must be one path; it crosses itself on {one.layer} at "
                f"({x:.4g}, {y:.4g}) mm ({where(graph, piece[j], tracks)})."
            )


def _walk(graph: TrackGraph, start: int) -> Iterator[tuple[TrackEdge, int]]:
    """Give the edges from an end on, each with the node that it leads to."""
    came, here = -1, start
    while True:
        onward = [index for index in graph.nodes[here].edges if index != came]
        if not onward:
            return
        came = onward[0]
        edge = graph.edges[came]
        here = edge.ends[1] if edge.ends[0] == here else edge.ends[0]
        yield edge, here


def _traced(
    name: str, graph: TrackGraph, steps: Sequence[tuple[TrackEdge, int]], tracks: Sequence[Track]
) -> TracedCoil:
    edge, number = steps[0]
    first = edge.ends[1] if edge.ends[0] == number else edge.ends[0]
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
    begins = tracks[steps[0][0].track].where
    begin, end = graph.nodes[first], graph.nodes[at]
    ends = (begin.pad or begin.hole, end.pad or end.hole)
    return TracedCoil(name, tuple(lines), tuple(layers), tuple(widths), holes, ends, tuple(passed), begins)
