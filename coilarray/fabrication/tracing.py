"""Coils of a board, found by following its nets."""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count, pairwise
from math import dist

import numpy as np
import shapely

from coilarray.compute.arrays import FloatArray
from coilarray.errors import BoardError, GeometryError
from coilarray.fabrication.board import BoardCopper, Copper, CopperArea, Hole, SurfacePad, Track
from coilarray.fabrication.track_graph import JOINED, TracedCoil, follow, natural_order, require_followable, track_graph
from coilarray.geometry.arcs import place_in_mm
from coilarray.geometry.array import Array, Placement
from coilarray.geometry.coil import VIA, PlatedHole, path_coil
from coilarray.geometry.copper import groups
from coilarray.geometry.stackup import Stackup

LEAST_TURNS = 0.9  # turns from which a net is a coil: a loop lacks the space between its leads
_SHOWN = 12  # names in a message
_REASONS = 3  # nets in a message, with the reason why they are not coils
_LONGEST_WHY = 200  # characters of a reason


@dataclass(frozen=True)
class Tracing:
    """Coils of a board, and `left_out` nets with tracks, with the reason."""

    coils: tuple[TracedCoil, ...]
    left_out: dict[str, str]


def trace_coils(board: BoardCopper, nets: Sequence[str] | None = None) -> Tracing:
    """Find the coils of a board, which are the wanted `nets` if given.

    By default every net and piece of copper without a net is a coil if it is a single path of at
    least `LEAST_TURNS`, whose turns no pad or hole joins. Raises BoardError for a wanted net that
    is no coil, or without any coil. The current enters at the lower number of a pad: 1 before 2, A2
    before A10. If only one end is numbered, it enters there, but a lone pad 2 is the end. Otherwise
    it enters at the end whose track comes first in the file.
    """
    found: dict[str | None, _NetCopper] = {}
    for kind in ("tracks", "holes", "pads", "areas"):
        for item in getattr(board, kind):
            getattr(found.setdefault(item.net, _NetCopper()), kind).append(item)
    nameless = found.pop(None, _NetCopper())
    by_net = {net: copper for net, copper in found.items() if net is not None}
    if nets is None:
        require_followable(nameless.tracks)  # before any shape is made
    obstacles = Obstacles(nameless.all)
    if nets is not None:
        for net in nets:
            if net not in by_net:
                known = sorted(by_net)
                close = difflib.get_close_matches(net, known, n=1)
                hint = f"did you mean {close[0]}? The" if close else "the"
                more = "" if len(known) <= _SHOWN else f" and {len(known) - _SHOWN} more"
                has = f"{hint} board has {', '.join(known[:_SHOWN])}{more}"
                has = has if known else "the board's copper has no nets"
                raise BoardError(f"{board.source}: there is no net {net!r}; {has}.")
            if not by_net[net].tracks and not by_net[net].areas:
                raise BoardError(f"{board.source}: net {net} has no track.{_drawn(nameless)}")
        return Tracing(tuple(_trace_net(net, by_net[net], obstacles) for net in dict.fromkeys(nets)), {})
    coils: list[TracedCoil] = []
    left_out: dict[str, str] = {}
    for net, copper in sorted(by_net.items(), key=lambda item: natural_order(item[0])):
        if copper.tracks:
            try:
                coil = _trace_net(net, copper, obstacles)
                _require_turns(coil)
                coils.append(coil)
            except BoardError as error:
                left_out[net] = str(error)
    _trace_nameless(nameless, by_net, coils, left_out)
    if not coils:
        why = "".join(f"; {net}: {reason}" for net, reason in list(left_out.items())[:_REASONS])
        why = why if len(why) <= _LONGEST_WHY else f"{why[:_LONGEST_WHY]}…"
        raise BoardError(
            f"{board.source}: no net is one path from end to end with a whole turn{why or '; it has no tracks.'}"
            f"{_drawn(nameless)}"
        )
    return Tracing(tuple(coils), left_out)


@dataclass(frozen=True, eq=False)
class _NetCopper:
    """Copper of one net by kind, in file order."""

    tracks: list[Track] = field(default_factory=list)
    holes: list[Hole] = field(default_factory=list)
    pads: list[SurfacePad] = field(default_factory=list)
    areas: list[CopperArea] = field(default_factory=list)

    @property
    def all(self) -> list[Copper]:
        """All copper of the net."""
        return [*self.tracks, *self.holes, *self.pads, *self.areas]

    @property
    def stands(self) -> list[Copper]:
        """Holes, pads, and tracks without a length: they may join paths."""
        dots = [track for track in self.tracks if dist(track.start, track.end) <= JOINED]
        return [*self.holes, *self.pads, *dots]


def _drawn(nameless: _NetCopper) -> str:
    """Hint at copper without a net or tracks."""
    hint = ""
    if nameless.tracks:
        hint += f" The board has {len(nameless.tracks)} tracks without a net, the first at {nameless.tracks[0].where}."
    if nameless.areas:
        hint += (
            f" Of its copper without a net, {len(nameless.areas)} pieces are drawn shapes or zones: a coil must be "
            "tracks."
        )
    return hint


def _trace_net(net: str, copper: _NetCopper, obstacles: Obstacles) -> TracedCoil:
    """Trace the coil of one net, or raise BoardError."""
    if copper.areas:
        area = copper.areas[0]
        raise BoardError(
            f"{area.where}: net {net} has {area.what} on {area.layer}, which cannot be taken as a current path."
        )
    graph = track_graph(copper.tracks, copper.holes, copper.pads)
    pieces = graph.components()
    if len(pieces) != 1:
        at = " and ".join(
            f"at {graph.place(piece[0])} on {graph.edges[piece[0]].layer} ({graph.where(piece[0])})"
            for piece in pieces[:2]
        )
        raise BoardError(
            f"{copper.tracks[0].where}: net {net} must be one piece of copper; it has {len(pieces)} that do not meet"
            f"{', ' if at else ''}{at}."
        )
    coil = replace(follow(net, f"net {net}", graph, pieces[0]), net=net)
    obstacles.refuse_contact(f"net {net}", coil)
    refuse_bridges(f"net {net}", coil, copper.stands)
    return coil


def _trace_nameless(
    nameless: _NetCopper, named: Mapping[str, _NetCopper], coils: list[TracedCoil], left_out: dict[str, str]
) -> None:
    """Add the pieces of copper without a net: coils under new names, others under their place."""
    graph = track_graph(nameless.tracks, nameless.holes, nameless.pads)
    pieces = graph.components()
    if not pieces:
        return
    names = (name for k in count(1) if (name := f"coil{k}") not in named)
    foreign = [Obstacles(copper.all, f"of net {net}") for net, copper in named.items()]
    own = [frozenset(id(nameless.tracks[graph.edges[index].track]) for index in piece) for piece in pieces]
    in_pieces = frozenset().union(*own)  # without pads and holes that lie wholly on others
    others_tracks = [track for track in nameless.tracks if id(track) in in_pieces]
    others = Obstacles([*others_tracks, *nameless.areas, *_joints(nameless, own)])
    for piece, tracks in zip(pieces, own, strict=True):
        what = f"copper without a net at {graph.place(piece[0])}"
        try:
            coil = follow(what, what, graph, piece)
            _require_turns(coil)
            others.refuse_contact(what, coil, tracks)
            refuse_bridges(what, coil, nameless.stands)
            for obstacles in foreign:
                obstacles.refuse_contact(f"tracks without a net, {what}", coil)
            coils.append(replace(coil, name=next(names)))
        except BoardError as error:
            left_out[what] = str(error)


def _joints(nameless: _NetCopper, own: Sequence[frozenset[int]]) -> list[Copper]:
    """Holes and pads that join several pieces, of which `own` are the ids of the tracks."""
    piece_of = {track: number for number, tracks in enumerate(own) for track in tracks}
    tracks = [track for track in nameless.tracks if id(track) in piece_of]
    tree = shapely.STRtree([shape for track in tracks for shape in track.copper.values()])
    found: list[Copper] = []
    for stand in nameless.stands:
        met = set()
        for layer, shape in stand.copper.items():
            near = [tracks[k] for k in tree.query(shape, "intersects").tolist()]
            met |= {piece_of[id(track)] for track in near if track.layer == layer}
        if len(met) > 1:
            found.append(stand)
    return found


def _require_turns(coil: TracedCoil) -> None:
    if (turns := abs(coil.turns)) < LEAST_TURNS:
        raise BoardError(f"it makes {turns:.2f} turns around a place; a coil makes at least one.")


_OVERLAP = 1e-6  # m: copper that meets by less only touches


class Obstacles:
    """Copper that no coil may touch, of an owner in messages: "of net A"."""

    def __init__(self, copper: Iterable[Copper], whose: str = "without a net") -> None:
        self._whose = whose
        self._found = [(item, layer, shape) for item in copper for layer, shape in item.copper.items()]
        self._tree = shapely.STRtree([shape for _, _, shape in self._found])

    def refuse_contact(self, what: str, coil: TracedCoil, own: frozenset[int] = frozenset()) -> None:
        """Raise BoardError if an obstacle, unless its id is an `own`, lies on the path."""
        segments = list(_segments(coil))
        lines = [segment.line for segment in segments]
        within = [max(segment.width / 2 - _OVERLAP, 0.0) for segment in segments]
        for k, index in self._tree.query(lines, predicate="dwithin", distance=within).T.tolist():
            item, layer, _ = self._found[index]
            if layer == segments[k].layer and id(item) not in own:
                at = place_in_mm(*lines[k].coords[0])
                raise BoardError(f"{item.where}: {item.what} {self._whose} touches {what} on {layer} at {at}.")


def refuse_bridges(what: str, coil: TracedCoil, items: Sequence[Copper]) -> None:
    """Raise BoardError if pads or holes of the coil's net join stretches."""
    # Stretches within them must follow each other along the path, and the path outside them run no longer than its
    # width, a bend beside the pad.
    segments = list(_segments(coil))
    tree = shapely.STRtree([segment.line for segment in segments])
    shapes = [item.copper for item in items]
    entries = [(k, layer, shape) for k, layers in enumerate(shapes) for layer, shape in layers.items()]
    geometries = np.array([shape for _, _, shape in entries], dtype=object)
    pairs = shapely.STRtree(geometries).query(geometries, predicate="intersects").T.tolist()
    met = ((entries[i][0], entries[j][0]) for i, j in pairs if entries[i][1] == entries[j][1])
    overlapping: dict[int, list[int]] = {}
    for k, lowest in enumerate(groups(len(shapes), met)):
        overlapping.setdefault(lowest, []).append(k)
    for group in overlapping.values():
        stretches = []  # begin and end (m) along the path within the copper, and the segment
        for layer, shape in ((layer, shape) for k in group for layer, shape in shapes[k].items()):
            for index in tree.query(shape, predicate="dwithin", distance=coil.widest / 2).tolist():
                segment = segments[index]
                within = max(segment.width / 2 - _OVERLAP, 0.0)
                if segment.layer != layer or not shapely.dwithin(shape, segment.line, within):
                    continue
                part = shapely.get_coordinates(segment.line & shape.buffer(within + _OVERLAP))
                along = segment.begin + shapely.line_locate_point(segment.line, shapely.points(part))
                stretches.append((float(along.min()), float(along.max()), index))
        stretches.sort()
        covered = stretches[0][1] if stretches else 0.0
        for begin, end, index in stretches:
            segment = segments[index]
            if begin - covered > segment.width:
                item = items[group[0]]
                at = place_in_mm(*segment.line.interpolate(begin - segment.begin).coords[0])
                raise BoardError(
                    f"{item.where}: {item.what} bridges turns of {what}: it also touches it on {segment.layer} at {at}."
                )
            covered = max(covered, end)


@dataclass(frozen=True, eq=False)
class _Segment:
    """Straight piece of a path from `begin` (m) along it."""

    layer: str
    line: shapely.LineString
    width: float
    begin: float


def _segments(coil: TracedCoil) -> Iterator[_Segment]:
    along = 0.0
    for line, layer, widths in zip(coil.lines, coil.layers, coil.widths, strict=True):
        for (a, b), width in zip(pairwise(line.tolist()), widths.tolist(), strict=True):
            yield _Segment(layer, shapely.LineString((a, b)), width, along)
            along += dist(a, b)


SAME_SHAPE = 2e-9  # agreement in m of points and widths of equal coils; board files round to 1 nm
_GRID = 1e-9  # m: resolution of board files
_GAP_GRID = 1e-6  # m: to which the gap of the turns is given
_PLATING = 25e-6
_ALONG = 0.9  # cosine of the angle between traces from which they run side by side
_MARGIN = 2e-3


@dataclass(frozen=True)
class TracedArray:
    """Array of shared coils, with assumed keys and sentences about it."""

    array: Array
    assumed: dict[str, str]
    notes: tuple[str, ...]


def traced_array(board: BoardCopper, coils: Sequence[TracedCoil]) -> TracedArray:
    """Place traced coils, about the centre of their area, on the board's stack-up."""
    # The gap is that by `turn_gap`, or else the trace width. Of several sizes of holes a coil has the commonest.
    assumed = {**board.assumed, "coils.*.via.plating_um": f"board files do not say; usual, {_PLATING * 1e6:g} µm"}
    notes = [*board.notes]
    shapes: list[Placement] = []
    placements = []
    for coil in coils:
        placement = next((same for shape in shapes if (same := _shifted(shape, coil)) is not None), None)
        if placement is None:
            placement = _placed(coil, assumed)
            shapes.append(placement)
        placements.append(placement)
        notes += _notes(coil)
    joining = [hole for coil in coils for hole in (*coil.vias, *coil.ends) if isinstance(hole, Hole)]
    through = {hole.layers == board.stackup.names for hole in joining}
    if len(through) > 1:
        notes.append(
            "Some holes go through the whole board and some do not; all taken as reaching only what they join."
        )
    array = Array(_stackup(board, assumed, notes), tuple(placements), 0.0, False not in through)
    array = _with_margin(array, board, assumed, notes)
    for coil in coils:
        at = f"{place_in_mm(*coil.path[0])} on {coil.layers[0]}"
        first, last = ("" if end is None else end.number for end in coil.ends)
        if first == last:
            at += ", where its first track is, for its ends have no numbers to tell them apart"
        else:
            at = f"pad {first}, {at}" if first else f"{at}, opposite to pad {last}"
        notes.append(f"{coil.name}: the current enters at {at}.")
    return TracedArray(array, assumed, tuple(notes))


def _stackup(board: BoardCopper, assumed: dict[str, str], notes: list[str]) -> Stackup:
    """Return the board's stack-up, of two layers only the first if the other has no copper."""
    copper = {item.layer for items in (board.tracks, board.pads, board.areas) for item in items}
    copper.update(layer for hole in board.holes for layer in hole.layers)
    names = board.stackup.names
    if len(names) != 2 or copper != {names[0]}:
        return board.stackup
    notes.append(f"{names[1]} has no copper and is left out: the design has one layer, {names[0]}.")
    for key in ("dielectric_thickness_mm", "dielectric_epsilon_r"):
        assumed.pop(f"stackup.{key}", None)
    return Stackup(names[:1], board.stackup.copper_thickness[:1], (), ())


def _shifted(shape: Placement, traced: TracedCoil) -> Placement | None:
    """Return a placement of a known shape, or None."""
    coil = shape.coil
    if [len(line) for line in coil.lines] != [len(line) for line in traced.lines]:
        return None
    if any(np.abs(a - b).max() > SAME_SHAPE for a, b in zip(coil.widths, traced.widths, strict=True)):
        return None
    shift = _on_grid(np.vstack(traced.lines).mean(axis=0) - np.vstack(coil.lines).mean(axis=0))
    if any(np.abs(a + shift - b).max() > SAME_SHAPE for a, b in zip(coil.lines, traced.lines, strict=True)):
        return None
    if _holes(traced) != (coil.via, coil.terminal):
        return None
    return Placement(traced.name, coil, traced.layers, float(shift[0]), float(shift[1]))


def _placed(traced: TracedCoil, assumed: dict[str, str]) -> Placement:
    """Return a placement with a new coil."""
    origin = _on_grid(np.array(traced.centre))
    measured = turn_gap(traced.lines, traced.layers, traced.widths)
    gap = _GAP_GRID if measured is None else max(round(measured / _GAP_GRID), 1) * _GAP_GRID
    try:
        coil = path_coil([line - origin for line in traced.lines], traced.widths, gap, *_holes(traced))
        if measured is None:
            coil = replace(coil, gap=coil.trace_width)
            assumed[f"coils.{traced.name}.gap_mm"] = "no turns side by side; the trace width"
        return Placement(traced.name, coil, traced.layers, float(origin[0]), float(origin[1]))
    except GeometryError as error:
        raise BoardError(f"{traced.where}: coil {traced.name}: {error}") from None


def _on_grid(point: FloatArray) -> FloatArray:
    return np.asarray(np.round(point / _GRID) * _GRID)


def _holes(traced: TracedCoil) -> tuple[PlatedHole, PlatedHole | None]:
    """Return the commonest sizes of vias and of terminals, None unless both ends have a hole."""
    found: list[PlatedHole | None] = []
    ends = [end for end in traced.ends if isinstance(end, Hole)]
    for holes in (traced.vias, ends if len(ends) == len(traced.ends) else ()):
        sizes = Counter((hole.drill, hole.pad) for hole in holes).most_common(1)
        try:
            found.append(PlatedHole(*sizes[0][0], _PLATING) if sizes else None)
        except GeometryError as error:
            where = next(hole.where for hole in holes if (hole.drill, hole.pad) == sizes[0][0])
            raise BoardError(f"{where}: hole of {traced.name}: {error}") from None
    return found[0] or VIA, found[1]  # a coil on one layer does not use its via


def _notes(coil: TracedCoil) -> Iterator[str]:
    """Yield the simplifications of a traced coil, as sentences."""
    ends = [end for end in coil.ends if isinstance(end, Hole)]
    for kind, holes in (("vias", coil.vias), ("terminals", ends)):
        if len({(hole.drill, hole.pad) for hole in holes}) > 1:
            yield f"{coil.name}: {kind} of several sizes, all taken as the commonest."
    if len(ends) == 1:
        yield f"{coil.name}: one end has a plated hole and the other none; both taken without."
    if any(isinstance(end, SurfacePad) for end in coil.ends):
        yield f"{coil.name}: pads without a hole at its ends left out; the trace ends in their centres."
    if coil.passed:
        yield f"{coil.name}: {len(coil.passed)} of the holes on the path join none of its lines and are left out."


def _with_margin(array: Array, board: BoardCopper, assumed: dict[str, str], notes: list[str]) -> Array:
    """Set the board's margin from the edge in its file."""
    if board.edge is None:
        assumed["board.margin_mm"] = f"the board file has no outline; {_MARGIN * 1e3:g} mm"
        return replace(array, board_margin=_MARGIN)
    outside = np.array([1, 1, -1, -1]) * (np.array(array.bounds) - np.array(board.edge))
    margin = max(float(outside.min()), 0.0)
    if np.ptp(outside) > _GAP_GRID:
        margins = ", ".join(f"{value * 1e3:.4g}" for value in outside.tolist())
        notes.append(
            f"The edge of the board is {margins} mm from the coils (left, bottom, right, top); a design has one "
            "margin, here the smallest."
        )
    return replace(array, board_margin=round(margin / _GAP_GRID) * _GAP_GRID)


def turn_gap(lines: Sequence[FloatArray], layers: Sequence[str], widths: Sequence[FloatArray]) -> float | None:
    """Median gap in m of parallel traces, edge to edge, weighted by length.

    From the middle of each segment it is that to the nearest trace of the layer with the same
    direction, so leads, opposite sides of a loop and the legs of a hairpin do not count. `lines`
    (n, 2) and `widths` (n − 1,) are in m. None if no two traces run so.
    """
    gaps: list[float] = []
    weights: list[float] = []
    for layer in dict.fromkeys(layers):
        own = [k for k, name in enumerate(layers) if name == layer]
        start = np.vstack([lines[k][:-1] for k in own])
        step = np.vstack([np.diff(lines[k], axis=0) for k in own])
        width = np.concatenate([widths[k] for k in own])
        length = np.hypot(*step.T)
        along = step / length[:, None]
        for i in range(len(start)):
            parallel = along @ along[i] > _ALONG
            parallel[i] = False
            from_middle, way = start[parallel] - start[i] - step[i] / 2, step[parallel]
            part = -(from_middle @ along[i]) / (way @ along[i])
            beside = (part >= 0) & (part <= 1)
            normal = np.array([-along[i, 1], along[i, 0]])
            across = np.abs((from_middle + part[:, None] * way) @ normal)[beside]
            apart = across - (width[i] + width[parallel][beside]) / 2
            apart = apart[apart > 0]
            if apart.size:
                gaps.append(float(apart.min()))
                weights.append(float(length[i]))
    if not gaps:
        return None
    order = np.argsort(gaps)
    share = np.cumsum(np.array(weights)[order])
    return gaps[int(order[np.searchsorted(share, share[-1] / 2)])]
