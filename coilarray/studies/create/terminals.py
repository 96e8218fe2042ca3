"""Start of the windings and length of the leads, chosen to keep every fabrication rule."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.compute.arrays import FloatArray
from coilarray.errors import DesignError, RuleViolationError
from coilarray.geometry import Placement, require_rules
from coilarray.studies.create.plan import Plan

_MOVES, _MOVE = 13, 0.5e-3  # steps, and their length in m, by which coils are moved apart for their terminals
_LONGEST_LEAD, _LEAD_STEP = 1.0, 0.25e-3  # widths of a coil, and m
_SHORT = 1e-9  # m: no lead is a point
_MOST_TRIALS = 3  # of lengths at one start, as rules may break that the quick look does not see


def with_terminals(plan: Plan, *, movable: bool) -> Plan:
    """Find the start of the windings and their leads.

    The start is a corner or side, and every fabrication rule is kept. Holes go through the whole board. Holes of coils
    that overlap must lie in the hole of a neighbour's winding or beside all of them. Coils side by side that are
    `movable` are moved apart until there is room.

    Raises
    ------
    DesignError
        If there is no such place. The message describes the broken rule at the usual start.
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
    """Yield plans with possible starts, leads and pitches."""
    starts = range(len(plan.starts))
    if plan.sets > 1:
        for start in starts:
            begun = replace(plan, start=start)
            yield from (replace(begun, lead=length) for length in islice(_clear_leads(begun), _MOST_TRIALS))
        return
    for move in range(_MOVES if movable and plan.arrangement.lattice != "single" else 1):
        for start in starts:
            yield replace(plan, pitch=plan.pitch + move * _MOVE, start=start)


def _clear_leads(plan: Plan) -> Iterator[float]:
    """Yield lengths of leads in m with clear terminals.

    No hole of a coil then meets the winding of another coil.
    """
    placements = replace(plan, arrangement=plan.arrangement.few, elastomer=False).design.array.placements
    windings = [_windings(place) for place in placements]
    others = [np.concatenate([*windings[:k], *windings[k + 1 :]]) for k in range(len(windings))]
    coil = placements[0].coil
    beside = plan.rules.min_gap + coil.trace_width / 2
    for place, lines in zip(placements, others, strict=True):
        if _nearest(place.to_board(coil.via_points), lines) < beside + plan.via_pad / 2:
            return
    terminals, pad = coil.terminal_points, 0.0 if coil.terminal is None else coil.terminal.pad
    outwards = terminals.mean(axis=0) / float(np.hypot(*terminals.mean(axis=0)))
    alike = [
        [line for other, own in zip(placements, windings, strict=True) if _meets(place, other) for line in own]
        for place in placements
    ]
    for longer in np.arange(0.0, _LONGEST_LEAD * plan.width, _LEAD_STEP).tolist():
        ends = terminals + longer * outwards
        leads = [
            np.asarray(
                shapely.linestrings(
                    [place.to_board(np.array(both)) for both in zip(terminals, ends + _SHORT, strict=True)]
                )
            )
            for place in placements
        ]
        if all(
            _nearest(place.to_board(ends), others[k]) >= beside + pad / 2
            and _nearest(
                place.to_board(np.vstack((ends, coil.via_points))), np.concatenate([*leads[:k], *leads[k + 1 :]])
            )
            >= beside + pad / 2
            and _apart(leads[k], np.array(alike[k])) >= beside + coil.trace_width / 2
            for k, place in enumerate(placements)
        ):
            yield plan.lead + longer


def _meets(place: Placement, other: Placement) -> bool:
    """Whether another coil lies on the same layers."""
    return other is not place and bool(set(place.layers) & set(other.layers))


def _windings(place: Placement) -> npt.NDArray[np.object_]:
    """Pieces of a coil's lines without leads.

    The centre lines are in the frame of the board.
    """
    outline = shapely.Polygon(place.coil.outline).buffer(place.coil.trace_width)
    pieces = shapely.get_parts(shapely.intersection([shapely.LineString(line) for line in place.coil.lines], outline))
    return np.array([shapely.LineString(place.to_board(shapely.get_coordinates(piece))) for piece in pieces])


def _nearest(points: FloatArray, lines: npt.NDArray[np.object_]) -> float:
    return float(np.min(shapely.distance(np.asarray(shapely.points(points))[:, None], lines), initial=np.inf))


def _apart(lines: npt.NDArray[np.object_], others: npt.NDArray[np.object_]) -> float:
    return float(np.min(np.asarray(shapely.distance(lines[:, None], others)), initial=np.inf))
