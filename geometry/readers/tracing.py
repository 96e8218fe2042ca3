"""Follow the nets of a board from one end to the other: the coils in it."""

from __future__ import annotations

import difflib
from collections.abc import Container, Sequence
from dataclasses import dataclass, field, replace
from itertools import count

import shapely

from coilarray.errors import BoardError
from coilarray.geometry.readers.board_copper import BoardCopper, CopperArea, Hole, SurfacePad, Track
from coilarray.geometry.readers.following import follow, place, where
from coilarray.geometry.readers.natural_order import natural_order
from coilarray.geometry.readers.traced_coil import TracedCoil
from coilarray.geometry.readers.track_graph import TrackGraph, track_graph

LEAST_TURNS = 0.9
"""Turns from which a net counts as a coil: a single loop lacks the space between its two leads. A track that goes out
and comes back beside itself is a narrow loop, and counts."""

_OVERLAP = 1e-6  # m: copper that meets by less only touches
_SHOWN = 12  # names in a message
_REASONS = 3  # nets in a message, with why they are no coils


@dataclass(frozen=True)
class Tracing:
    """What a board holds.

    Parameters
    ----------
    coils : tuple of TracedCoil
        In the order of the wanted nets; where none were named, of the names, numbers in them counted, and then the
        ones without a net in the order of the file.
    left_out : dict of str to str
        Nets with tracks that are no coils, and why.
    """

    coils: tuple[TracedCoil, ...]
    left_out: dict[str, str]


def trace_coils(board: BoardCopper, nets: Sequence[str] | None = None) -> Tracing:
    """Find the coils of a board.

    Parameters
    ----------
    board : BoardCopper
        What a reader has found.
    nets : sequence of str, optional
        Names of the nets that are coils. Without them, every net (and every piece of copper that has no net) that
        is one path from end to end with at least `LEAST_TURNS` turns is one; the others are left out.

    Returns
    -------
    Tracing

    Raises
    ------
    BoardError
        With `nets`: one that the board does not have, has no track, branches, is closed, comes in several pieces,
        crosses itself, has copper that is no track, or is touched by copper without a net. Without: no coil at all.
        The message names file, line and position.

    Notes
    -----
    The current enters at the pad with the lower number (1 before 2, A2 before A10); where only one end has a numbered
    pad, there; where neither has, or both have the same number, at the end whose track comes first in the file.
    """
    by_net, nameless = _by_net(board)
    obstacles = _Obstacles([*nameless.tracks, *nameless.areas])
    if nets is not None:
        for net in nets:
            if net not in by_net:
                raise BoardError(f"{board.source}: {_unknown(net, sorted(by_net))}")
            if not by_net[net].tracks and not by_net[net].areas:
                raise BoardError(f"{board.source}: net {net} has no track.{_drawn(nameless)}")
        return Tracing(tuple(_trace_net(net, by_net[net], obstacles) for net in dict.fromkeys(nets)), {})
    coils: list[TracedCoil] = []
    left_out: dict[str, str] = {}
    for net, copper in sorted(by_net.items(), key=lambda item: natural_order(item[0])):
        if copper.tracks:
            try:
                coil = _trace_net(net, copper, obstacles)
            except BoardError as error:
                left_out[net] = str(error)
                continue
            if _winds(coil):
                coils.append(coil)
            else:
                left_out[net] = _too_few(coil)
    _trace_nameless(nameless, by_net, coils, left_out)
    if not coils:
        why = "".join(f"; {net}: {reason}" for net, reason in list(left_out.items())[:_REASONS])
        raise BoardError(
            f"{board.source}: no net is one path from end to end with a whole turn{why or '; it has no tracks.'}"
            f"{_drawn(nameless)}"
        )
    return Tracing(tuple(coils), left_out)


@dataclass(frozen=True, eq=False)
class _NetCopper:
    """The copper of one net, each kind in the order of the file."""

    tracks: list[Track] = field(default_factory=list)
    holes: list[Hole] = field(default_factory=list)
    pads: list[SurfacePad] = field(default_factory=list)
    areas: list[CopperArea] = field(default_factory=list)


def _by_net(board: BoardCopper) -> tuple[dict[str, _NetCopper], _NetCopper]:
    """Sort a board's copper by net, in the order of the tracks, then of the rest; and give what has none."""
    found: dict[str | None, _NetCopper] = {}
    for track in board.tracks:
        found.setdefault(track.net, _NetCopper()).tracks.append(track)
    for hole in board.holes:
        found.setdefault(hole.net, _NetCopper()).holes.append(hole)
    for pad in board.pads:
        found.setdefault(pad.net, _NetCopper()).pads.append(pad)
    for area in board.areas:
        found.setdefault(area.net, _NetCopper()).areas.append(area)
    return {net: copper for net, copper in found.items() if net is not None}, found.get(None, _NetCopper())


class _Obstacles:
    """Copper without a net, which no net may touch."""

    def __init__(self, copper: Sequence[Track | CopperArea]) -> None:
        self._copper = copper
        self._tree = shapely.STRtree(
            [
                shapely.LineString((each.start, each.end)).buffer(each.width / 2)
                if isinstance(each, Track)
                else each.shape
                for each in copper
            ]
        )

    def refuse_contact(self, what: str, graph: TrackGraph, piece: Sequence[int]) -> None:
        """Raise where one of them lies on a path."""
        edges = [graph.edges[index] for index in piece]
        lines = [shapely.LineString(graph.points(edge)) for edge in edges]
        reach = [max(edge.width / 2 - _OVERLAP, 0.0) for edge in edges]
        for k, index in self._tree.query(lines, predicate="dwithin", distance=reach).T.tolist():
            other = self._copper[index]
            if other.layer == edges[k].layer:
                kind = "a track" if isinstance(other, Track) else other.what
                raise BoardError(
                    f"{other.where}: {kind} without a net touches {what} on {other.layer} at {place(graph, piece[k])}."
                )


def _unknown(net: str, known: Sequence[str]) -> str:
    if not known:
        return f"there is no net {net!r}; the board's copper has no nets."
    close = difflib.get_close_matches(net, known, n=1)
    hint = f"did you mean {close[0]}? The" if close else "the"
    more = "" if len(known) <= _SHOWN else f" and {len(known) - _SHOWN} more"
    return f"there is no net {net!r}; {hint} board has {', '.join(known[:_SHOWN])}{more}."


def _drawn(nameless: _NetCopper) -> str:
    """Hint at copper that could be a coil if it were tracks."""
    if not nameless.areas:
        return ""
    return (
        f" Of its copper without a net, {len(nameless.areas)} pieces are drawn shapes or zones: a coil must be tracks."
    )


def _trace_net(net: str, copper: _NetCopper, obstacles: _Obstacles) -> TracedCoil:
    if copper.areas:
        area = copper.areas[0]
        raise BoardError(f"{area.where}: net {net} has {area.what} on {area.layer}, which is no current path.")
    tracks = copper.tracks
    graph = track_graph(tracks, copper.holes, copper.pads)
    pieces = graph.components()
    if len(pieces) != 1:
        at = " and ".join(f"at {place(graph, piece[0])} ({where(graph, piece[0], tracks)})" for piece in pieces[:2])
        raise BoardError(
            f"{tracks[0].where}: net {net} must be one piece of copper; it has {len(pieces)} that do not meet"
            f"{', ' if at else ''}{at}."
        )
    obstacles.refuse_contact(f"net {net}", graph, pieces[0])
    return follow(net, f"net {net}", graph, pieces[0], tracks)


def _trace_nameless(
    nameless: _NetCopper, taken: Container[str], coils: list[TracedCoil], left_out: dict[str, str]
) -> None:
    """Add the pieces of copper without a net: coils by new names, other copper by its place."""
    graph = track_graph(nameless.tracks, nameless.holes, nameless.pads)
    free_names = (name for k in count(1) if (name := f"coil{k}") not in taken)
    obstacles = _Obstacles(nameless.areas)
    for piece in graph.components():
        what = f"copper without a net at {place(graph, piece[0])}"
        try:
            obstacles.refuse_contact(what, graph, piece)
            coil = follow(what, what, graph, piece, nameless.tracks)
        except BoardError as error:
            left_out[what] = str(error)
            continue
        if _winds(coil):
            coils.append(replace(coil, name=next(free_names)))
        else:
            left_out[what] = _too_few(coil)


def _winds(coil: TracedCoil) -> bool:
    return abs(coil.turns) >= LEAST_TURNS


def _too_few(coil: TracedCoil) -> str:
    return f"it makes {abs(coil.turns):.2f} turns around its centre; a coil makes at least one."
