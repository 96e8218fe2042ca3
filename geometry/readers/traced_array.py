"""Make an array of the coils that were traced on a board."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.errors import BoardError, GeometryError
from coilarray.geometry.array import Array, Placement
from coilarray.geometry.coil import PlatedHole, path_coil
from coilarray.geometry.readers.board_copper import BoardCopper, Hole, SurfacePad
from coilarray.geometry.readers.track_graph import TracedCoil
from coilarray.geometry.stackup import Stackup
from coilarray.geometry.values import place_in_mm

SAME_SHAPE = 2e-9
"""Agreement in m of points and widths for coils of one shape, but for a shift. Board files round to 1 nm."""

_GRID = 1e-9  # m: resolution of board files
_GAP_GRID = 1e-6  # m: to which the gap of the turns is given
_PLATING = 25e-6
_ALONG = 0.9  # cosine of the angle between traces from which they run side by side
_MARGIN = 2e-3
_UNUSED_VIA = PlatedHole(0.2e-3, 0.45e-3, _PLATING)  # of coils on one layer


@dataclass(frozen=True)
class TracedArray:
    """Array made from a board, with its assumed values.

    Parameters
    ----------
    array : Array
        Coils that are equal but for a shift share one `Coil`.
    assumed : dict of str to str
        Dotted keys of the design whose values are assumed, with the reason. ``coils.*.…`` stands for all shapes,
        ``coils.NAME.…`` for the shape of the coil NAME.
    notes : tuple of str
        Sentences about omissions and simplifications.
    """

    array: Array
    assumed: dict[str, str]
    notes: tuple[str, ...]


def traced_array(board: BoardCopper, coils: Sequence[TracedCoil]) -> TracedArray:
    """Place traced coils on the board's stack-up.

    Parameters
    ----------
    board : BoardCopper
        Board on which the coils were found.
    coils : sequence of TracedCoil
        At least one.

    Raises
    ------
    BoardError
        If a coil is impossible, because a pad is no larger than its hole or a line touches itself.

    Notes
    -----
    A coil's origin is the centre of the area that its path runs around. The gap is the usual distance of its turns, see
    `turn_gap`. Without turns beside each other it is the trace width. A coil has one size of via and one size of
    terminal. If the board has several, the commonest is taken, with a note.
    """
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
    through = _through(board, coils)
    if through is None:
        notes.append(
            "Some holes go through the whole board and some do not; all taken as reaching only what they join."
        )
    array = Array(_stackup(board, assumed, notes), tuple(placements), 0.0, bool(through))
    array = _with_margin(array, board, assumed, notes)
    notes += [f"{coil.name}: the current enters at {_begin(coil)}." for coil in coils]
    return TracedArray(array, assumed, tuple(notes))


def _stackup(board: BoardCopper, assumed: dict[str, str], notes: list[str]) -> Stackup:
    """Return the board's stack-up.

    If a board of two layers has copper on the first layer alone, only this layer is kept.
    """
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
    """Return a placement of a known shape.

    None if the traced coil has another shape.
    """
    coil = shape.coil
    if [len(line) for line in coil.lines] != [len(line) for line in traced.lines]:
        return None
    if any(np.abs(a - b).max() > SAME_SHAPE for a, b in zip(coil.widths, traced.widths, strict=True)):
        return None
    shift = _on_grid(np.vstack(traced.lines).mean(axis=0) - np.vstack(coil.lines).mean(axis=0))
    if any(np.abs(a + shift - b).max() > SAME_SHAPE for a, b in zip(coil.lines, traced.lines, strict=True)):
        return None
    if (_via(traced), _terminal(traced)) != (coil.via, coil.terminal):
        return None
    return Placement(traced.name, coil, traced.layers, float(shift[0]), float(shift[1]))


def _placed(traced: TracedCoil, assumed: dict[str, str]) -> Placement:
    """Return a placement with a new coil.

    The coil is made from a traced coil.
    """
    origin = _on_grid(np.array(traced.centre))
    measured = turn_gap(traced.lines, traced.layers, traced.widths)
    gap = _GAP_GRID if measured is None else max(round(measured / _GAP_GRID), 1) * _GAP_GRID
    via, terminal = _via(traced), _terminal(traced)
    try:
        coil = path_coil([line - origin for line in traced.lines], traced.widths, gap, via, terminal)
        if measured is None:
            coil = replace(coil, gap=coil.trace_width)
            assumed[f"coils.{traced.name}.gap_mm"] = "no turns side by side; the trace width"
        return Placement(traced.name, coil, traced.layers, float(origin[0]), float(origin[1]))
    except GeometryError as error:
        raise BoardError(f"{traced.where}: coil {traced.name}: {error}") from None


def _on_grid(point: FloatArray) -> FloatArray:
    return np.asarray(np.round(point / _GRID) * _GRID)


def _via(traced: TracedCoil) -> PlatedHole:
    return _commonest(traced, traced.vias) or _UNUSED_VIA


def _terminal(traced: TracedCoil) -> PlatedHole | None:
    """Return the hole at both ends.

    None if an end has no hole.
    """
    holes = [end for end in traced.ends if isinstance(end, Hole)]
    return _commonest(traced, holes) if len(holes) == len(traced.ends) else None


def _commonest(traced: TracedCoil, holes: Sequence[Hole]) -> PlatedHole | None:
    """Return the commonest size of holes, or None without holes."""
    if not holes:
        return None
    (drill, pad), _ = Counter((hole.drill, hole.pad) for hole in holes).most_common(1)[0]
    try:
        return PlatedHole(drill, pad, _PLATING)
    except GeometryError as error:
        where = next(hole.where for hole in holes if (hole.drill, hole.pad) == (drill, pad))
        raise BoardError(f"{where}: hole of {traced.name}: {error}") from None


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


def _begin(coil: TracedCoil) -> str:
    at = f"{place_in_mm(*coil.path[0])} on {coil.layers[0]}"
    first, last = ("" if end is None else end.number for end in coil.ends)
    if first == last:
        return f"{at}, where its first track is, for its ends have no numbers to tell them apart"
    return f"pad {first}, {at}" if first else f"{at}, opposite to pad {last}"


def _through(board: BoardCopper, coils: Sequence[TracedCoil]) -> bool | None:
    """Whether all holes go through the whole board.

    None if some do and some do not.
    """
    holes = [hole for coil in coils for hole in (*coil.vias, *coil.ends) if isinstance(hole, Hole)]
    through = {hole.layers == board.stackup.names for hole in holes}
    return None if len(through) > 1 else through != {False}


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
    """Median gap in m of parallel traces.

    The traces run side by side. The gap is measured edge to edge and weighted by length. The current of both traces has
    the same direction. `lines` are centre lines, each of shape (n, 2), and `widths` are the widths of their segments,
    each of shape (n − 1,), in m. None if no two traces of a layer run so. Leads, opposite sides of a loop and the legs
    of a hairpin do not count.

    Examples
    --------
    >>> there_and_back = np.array([[0, 0], [9, 0], [9, 5], [-1, 5], [-1, 1], [8, 1.0]]) * 1e-3
    >>> round(turn_gap([there_and_back], ["L1"], [np.full(5, 0.2e-3)]) * 1e3, 6)
    0.8
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
            gap = _nearest(start + step / 2, start, step, along, width, i)
            if gap is not None:
                gaps.append(gap)
                weights.append(float(length[i]))
    if not gaps:
        return None
    order = np.argsort(gaps)
    share = np.cumsum(np.array(weights)[order])
    return gaps[int(order[np.searchsorted(share, share[-1] / 2)])]


def _nearest(
    middle: FloatArray, start: FloatArray, step: FloatArray, along: FloatArray, width: FloatArray, i: int
) -> float | None:
    """Distance from segment i to the nearest parallel trace.

    It is measured from the middle of the segment, to either side, to traces with the same direction.
    """
    parallel = along @ along[i] > _ALONG
    parallel[i] = False
    from_middle, way = start[parallel] - middle[i], step[parallel]
    part = -(from_middle @ along[i]) / (way @ along[i])
    beside = (part >= 0) & (part <= 1)
    normal = np.array([-along[i, 1], along[i, 0]])
    across = np.abs((from_middle + part[:, None] * way) @ normal)[beside]
    gaps = across - (width[i] + width[parallel][beside]) / 2
    gaps = gaps[gaps > 0]
    return float(gaps.min()) if gaps.size else None
