"""Where the windings begin and how long the leads are, so that every fabrication rule is kept."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.errors import DesignError, RuleViolationError
from coilarray.geometry import Placement, require_rules
from coilarray.geometry.values import FloatArray
from coilarray.studies.create.plan import Plan

_MOVES, _MOVE = 13, 0.5e-3  # by how much coils are moved apart until their terminals have room, in m
_LONGEST_LEAD, _LEAD_STEP = 1.5, 0.25e-3  # widths of a coil, and m


def with_terminals(plan: Plan, *, movable: bool) -> Plan:
    """Find the corner or side at which the windings begin, and leads, with which every fabrication rule is kept.

    Holes go through the whole board: those of coils that overlap must lie in the hole of a neighbour's winding or
    beside all of them. Coils side by side that are `movable` are moved apart until there is room.

    Raises
    ------
    DesignError
        No such place; the line says what is broken in the usual one.
    """
    problem = None
    for tried in _candidates(plan, movable=movable):
        try:
            for arrangement in dict.fromkeys((plan.arrangement.few, plan.arrangement)):
                board = replace(tried, arrangement=arrangement, elastomer=False)
                require_rules(board.design.array, board.rules)
        except (RuleViolationError, DesignError) as error:
            problem = problem or error
        else:
            return tried
    raise DesignError(
        "there is no place for terminals that keeps every rule"
        + (f"; in the usual one {problem}" if problem else ": the holes of the neighbours are too small for them.")
    )


def _candidates(plan: Plan, *, movable: bool) -> Iterator[Plan]:
    starts = range(len(plan.starts))
    if plan.sets > 1:
        for start in starts:
            begun = replace(plan, start=start)
            yield from (replace(begun, lead=length) for length in _clear_leads(begun))
        return
    for move in range(_MOVES if movable and plan.arrangement.lattice != "single" else 1):
        for start in starts:
            yield replace(plan, pitch=plan.pitch + move * _MOVE, start=start)


def _clear_leads(plan: Plan) -> Iterator[float]:
    """Give the lengths of leads in m with which no hole of a coil meets the winding of another one."""
    placements = replace(plan, arrangement=plan.arrangement.few, elastomer=False).design.array.placements
    windings = [_windings(place) for place in placements]
    others = [np.concatenate([*windings[:k], *windings[k + 1 :]]) for k in range(len(windings))]
    coil = placements[0].coil
    beside = plan.rules.min_gap + coil.trace_width / 2
    for place, lines in zip(placements, others, strict=True):
        if _nearest(place.to_board(coil.via_points), lines) < beside + plan.via_pad / 2:
            return
    terminals = coil.terminal_points
    outwards = terminals.mean(axis=0) / float(np.hypot(*terminals.mean(axis=0)))
    pad = 0.0 if coil.terminal is None else coil.terminal.pad
    for longer in np.arange(0.0, _LONGEST_LEAD * plan.width, _LEAD_STEP).tolist():
        moved = terminals + longer * outwards
        if all(
            _nearest(place.to_board(moved), lines) >= beside + pad / 2
            for place, lines in zip(placements, others, strict=True)
        ):
            yield plan.lead + longer


def _windings(place: Placement) -> npt.NDArray[np.object_]:
    """Pieces of the centre lines of a coil on the board, without its leads."""
    outline = shapely.Polygon(place.coil.outline).buffer(place.coil.trace_width)
    pieces = shapely.get_parts(shapely.intersection([shapely.LineString(line) for line in place.coil.lines], outline))
    return np.array([shapely.LineString(place.to_board(shapely.get_coordinates(piece))) for piece in pieces])


def _nearest(points: FloatArray, lines: npt.NDArray[np.object_]) -> float:
    return float(np.min(shapely.distance(np.asarray(shapely.points(points))[:, None], lines), initial=np.inf))
