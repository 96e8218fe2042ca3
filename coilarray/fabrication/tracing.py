"""Coils of a board, found by following its nets."""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, count

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.compute.threads import Progress
from coilarray.errors import BoardError, GeometryError
from coilarray.fabrication.board import BoardCopper, Copper, Hole, SurfacePad
from coilarray.fabrication.copper_graph import CopperGraph, copper_graph
from coilarray.fabrication.current_paths import STRAIGHT, Found, Piece
from coilarray.fabrication.traced_coil import TracedCoil, natural_order
from coilarray.geometry.arcs import Point, place_in_mm
from coilarray.geometry.array import Array, Placement
from coilarray.geometry.coil import VIA, PlatedHole, path_coil
from coilarray.geometry.stackup import Stackup

_SHOWN = 12  # names in a message
_PLACE = re.compile(r"\s*([-+]?\d*\.?\d+)\s*,\s*([-+]?\d*\.?\d+)\s*")
_MANY_PADS, _FEW_TURNS = 8, 1.5  # copper with more pads and fewer turns is no coil unless it is asked for


@dataclass(frozen=True)
class LeftOut:
    """Copper of a `name` that is no coil, with the reason, and its place, length and turns."""

    name: str
    reason: str
    at: Point | None
    length: float
    turns: float


@dataclass(frozen=True)
class Tracing:
    """Coils of a board, and other copper, first that which looks most like a coil."""

    coils: tuple[TracedCoil, ...]
    left_out: tuple[LeftOut, ...]


class NoCoilError(BoardError):
    """A board without a coil, with the `left_out` copper."""

    def __init__(self, message: str, left_out: Sequence[LeftOut] = ()) -> None:
        super().__init__(message)
        self.left_out = tuple(left_out)


def trace_coils(
    board: BoardCopper,
    nets: Sequence[str] | None = None,
    ends: tuple[str, str] | None = None,
    progress: Progress | None = None,
) -> Tracing:
    """Find the coils of a board, in the copper of the wanted `nets` if given.

    Copper is connected where it overlaps, and through plated holes. A coil is the way of the
    current through connected copper that makes at least `LEAST_TURNS`. It ends at the pad, branch
    or end of the copper that is next to its winding. Branches that do not wind are left out. Where
    three windings meet, or two about places of their own and a pad or branch, each is a coil.
    `ends` are two pads as "U1.3", or places in mm as "1.5,-2", between which the way is taken
    instead.

    Raises BoardError for a wanted net or end that is not there, and NoCoilError without any coil.
    The current enters at the lower number of a pad: 1 before 2, A2 before A10. If only one end is
    numbered, it enters there, but a lone pad 2 is the end. Otherwise it enters at the end whose
    track comes first in the file.
    """
    graph = copper_graph(board, progress)
    members = _pieces(graph)
    known = {net for _, _, own in members for net in own}
    for net in nets or ():
        if net not in known:
            close = difflib.get_close_matches(net, sorted(known), n=1)
            hint = f"did you mean {close[0]}? The" if close else "the"
            more = "" if len(known) <= _SHOWN else f" and {len(known) - _SHOWN} more"
            has = f"{hint} board has {', '.join(sorted(known, key=natural_order)[:_SHOWN])}{more}"
            raise BoardError(
                f"{board.source}: there is no net {net!r}; {has if known else 'the copper of the board has no nets'}."
            )
    if ends is not None:
        return Tracing((_between(board, graph, members, ends),), ())
    coils: list[TracedCoil] = []
    left_out: list[LeftOut] = []
    straight: list[tuple[TracedCoil, tuple[str, ...]]] = []
    wanted = [member for net in dict.fromkeys(nets or ()) for member in members if net in member[2]]
    for nodes, edges, own in wanted if nets is not None else members:
        if not edges or (nets is None and not _may_wind(graph, nodes, edges)):
            continue
        try:
            found = Piece(graph, nodes, edges).coils()
        except BoardError as error:  # wide copper in the way
            found = Found((), str(error))
        pads = sum(stand.kind == "pad" for node in nodes for stand in graph.stands.get(node, ()))
        if nets is None and pads > _MANY_PADS and all(abs(coil.turns) < _FEW_TURNS for coil in found.coils):
            reason = f"it leads to {pads} pads, as a supply does; --nets takes it." if found.coils else found.reason
            found = replace(found, coils=(), reason=reason)
        coils += _named(found.coils, own, coils, known)
        if not found.coils:
            name = ", ".join(own) or f"copper without a net at {graph.place(nodes[0])}"
            length, turns = (found.way.length, abs(found.way.turns)) if found.way else (0.0, 0.0)
            left_out.append(LeftOut(name, found.reason, found.at, length, turns))
            if found.way is not None and not found.ringed:
                straight.append((found.way, own))
    for net in nets or ():  # which need not wind
        ways = [(way, own) for way, own in straight if net in own]
        if ways and not _on(coils, net):
            way, own = max(ways, key=lambda each: each[0].length)
            coils += _named((way,), own, coils, known)
    left_out.sort(key=lambda each: (-round(each.turns, 2), -each.length))
    missing = [net for net in nets or () if not _on(coils, net)]
    if missing or not coils:
        raise NoCoilError(_why_none(board, graph, missing, left_out), left_out)
    in_order = [coil for net in nets or () for coil in _on(coils, net)]
    return Tracing(tuple(dict.fromkeys(in_order or coils)), tuple(left_out))


def _on(coils: Sequence[TracedCoil], net: str) -> list[TracedCoil]:
    """Coils on a net."""
    return [coil for coil in coils if net in (coil.net or "").split(", ")]


_Member = tuple[list[int], list[int], tuple[str, ...]]  # nodes, edges and nets of connected copper


def _pieces(graph: CopperGraph) -> list[_Member]:
    """Sort the copper of a graph into connected pieces, by net and then in the order of the file."""
    nodes: dict[int, list[int]] = {}
    edges: dict[int, list[int]] = {}
    for node, piece in enumerate(graph.piece.tolist()):
        nodes.setdefault(piece, []).append(node)
    for edge, piece in enumerate(graph.piece[graph.edges[:, 0]].tolist()):
        edges.setdefault(piece, []).append(edge)
    found = []
    for piece, own in nodes.items():
        items: list[Copper] = [graph.items[k] for k in np.unique(graph.edge_item[edges.get(piece, [])]).tolist()]
        items += [stand for node in own for stand in graph.stands.get(node, ())]
        nets = sorted({item.net for item in items if item.net}, key=natural_order)
        if piece in edges or nets:
            found.append((own, edges.get(piece, []), tuple(nets)))
    return sorted(found, key=lambda member: (not member[2], [natural_order(net) for net in member[2]]))


def _may_wind(graph: CopperGraph, nodes: Sequence[int], edges: Sequence[int]) -> bool:
    """Whether connected copper is long enough to make a turn."""
    if len(edges) < 3:
        return False
    across = float(np.hypot(*np.ptp(graph.nodes[nodes], axis=0)))
    return bool(graph.length[edges].sum() >= STRAIGHT * across)


def _named(
    coils: Sequence[TracedCoil], nets: Sequence[str], others: Sequence[TracedCoil], known: Collection[str]
) -> Iterator[TracedCoil]:
    """Name coils after their net or footprint, or coil1, coil2 and so on."""
    # unlike the `others`, and the `known` nets, which are kept for their own coils
    used = {coil.name for coil in others}
    for coil in coils:
        first = nets[0] if len(nets) == 1 else coil.part or "_".join(nets)
        names = chain([first], (f"{first}_{k}" for k in count(2))) if first else (f"coil{k}" for k in count(1))
        name = next(name for name in names if name not in used and (name not in known or name in nets))
        used.add(name)
        yield replace(coil, name=name, net=", ".join(nets) or None)


def _why_none(board: BoardCopper, graph: CopperGraph, missing: Sequence[str], left_out: Sequence[LeftOut]) -> str:
    """Say why there is no coil, first of the copper that looks most like one."""
    about = [each for each in left_out if set(each.name.split(", ")) & set(missing)] if missing else left_out
    if not about:
        what = f"net {missing[0]} has no track" if missing else "there is no copper that could be a coil"
        return " ".join((f"{board.source}: {what}.", *board.notes))
    first = about[0]
    more = f" {len(about) - 1} more pieces of copper are no coils either." if len(about) > 1 else ""
    what = f"net {first.name}" if first.name in {item.net for item in graph.items} else first.name
    shape = f" ({first.turns:.3g} turns, {first.length * 1e3:.3g} mm)" if first.turns else ""
    what = f"{what[0].upper()}{what[1:]}{shape}"
    return f"{board.source}: no coil was found. {what} looks most like one: {first.reason}{more}"


def _between(board: BoardCopper, graph: CopperGraph, members: Sequence[_Member], ends: tuple[str, str]) -> TracedCoil:
    """Follow the way between two ends that the user named."""
    first, last = (_end_node(board, graph, end) for end in ends)
    if first == last:
        raise BoardError(f"{board.source}: {ends[0]} and {ends[1]} are one place.")
    for nodes, edges, own in members:
        if first in nodes and last in nodes:
            return next(_named((Piece(graph, nodes, edges).between(first, last),), own, (), ()))
    raise BoardError(f"{board.source}: no copper joins {ends[0]} and {ends[1]}.")


def _end_node(board: BoardCopper, graph: CopperGraph, end: str) -> int:
    """Node of a pad "U1.3", or nearest to a place "1.5,-2" in mm."""
    place = _PLACE.fullmatch(end)
    if place and len(graph.nodes):
        at = float(place[1]) / 1e3, float(place[2]) / 1e3
        return int(np.hypot(*(graph.nodes - at).T).argmin())
    stands = ((node, stand) for node, own in graph.stands.items() for stand in own if stand.number)
    named = {f"{stand.part}.{stand.number}": node for node, stand in stands}
    if end in named:
        return named[end]
    close = difflib.get_close_matches(end, sorted(named), n=3)
    hint = f"did you mean {' or '.join(close)}?" if close else "give a pad as U1.3, or a place in mm as 1.5,-2."
    raise BoardError(f"{board.source}: there is no pad {end!r}; {hint}")


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
    yield from (f"{coil.name}: {note}" for note in coil.notes)


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
