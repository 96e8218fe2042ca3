"""Start of the windings, leads and connector of a new design, within every fabrication rule."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.compute.arrays import FloatArray
from coilarray.design.board_tables import ConnectorTable
from coilarray.errors import DesignError, GeometryError, RuleViolationError
from coilarray.geometry import Placement, require_rules, route_leads
from coilarray.geometry.arcs import Side
from coilarray.geometry.connector import NoWayError
from coilarray.studies.create.plan import Plan

_MOVES, _MOVE = 13, 0.5e-3  # steps, and their length in m, by which coils are moved apart for their terminals
_LONGEST_LEAD, _LEAD_STEP = 1.0, 0.25e-3  # widths of a coil, and m
_SHORT = 1e-9  # m: no lead is a point
_MOST_TRIALS = 3  # of lengths at one start, as rules may break that the quick look does not see
_DISTANCES = (5.0, 6.0, 8.0, 10.0)  # mm from the coils; for several rows from the second on, with room for ways between
_PITCH_STEP = 0.5e-3  # m
_LONGER, _FURTHER = 0.5e-3, 1e-3  # m by which leads get longer and coils lie further apart at each distance


def with_terminals(plan: Plan, *, movable: bool) -> Plan:
    """Find the start of the windings and their leads, with every fabrication rule kept.

    Holes go through the whole board. Holes of coils that overlap must lie in the hole of a neighbour's winding or
    beside all of them. Coils side by side that are `movable` are moved apart until there is room. Raises DesignError
    with the broken rule at the usual start.
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
    """Yield lengths of leads in m at which no hole meets the winding of another coil."""
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
        [
            line
            for other, own in zip(placements, windings, strict=True)
            if other is not place and set(place.layers) & set(other.layers)
            for line in own
        ]
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


def _windings(place: Placement) -> npt.NDArray[np.object_]:
    """Pieces of a coil's centre lines without leads, in the frame of the board."""
    outline = shapely.Polygon(place.coil.outline).buffer(place.coil.trace_width)
    pieces = shapely.get_parts(shapely.intersection([shapely.LineString(line) for line in place.coil.lines], outline))
    return np.array([shapely.LineString(place.to_board(shapely.get_coordinates(piece))) for piece in pieces])


def _nearest(points: FloatArray, lines: npt.NDArray[np.object_]) -> float:
    return float(np.min(shapely.distance(np.asarray(shapely.points(points))[:, None], lines), initial=np.inf))


def _apart(lines: npt.NDArray[np.object_], others: npt.NDArray[np.object_]) -> float:
    return float(np.min(np.asarray(shapely.distance(lines[:, None], others)), initial=np.inf))


def with_connector(plan: Plan, side: Side, *, movable: bool) -> Plan:
    """Find room for all leads to a connector.

    The distance of the connector, the length of the leads and, if `movable`, the pitch of the coils are increased.
    Raises DesignError with the problem of the roomiest board. The search stops early if less than half of the coils are
    routed, and neighbours that may not move are too near for the leads of a row between them.
    """
    problem = ""
    several = plan.arrangement.rows > 1 or plan.arrangement.lattice in ("triangle", "rings")
    for k, distance in list(enumerate(_DISTANCES))[several:]:
        further = k * _FURTHER if movable else 0.0
        tried = replace(plan, lead=plan.lead + k * _LONGER, pitch=plan.pitch + further)
        ways = ConnectorTable(side=side, distance_mm=distance)
        try:
            require_rules(route_leads(tried.design.array, ways.build()), tried.rules)
        except NoWayError as error:
            coils, roomy = len(tried.design.array.placements), _roomy_pitch(tried, side)
            tight = several and tried.pitch < roomy
            pitch = f"a pitch of about {roomy * 1e3:g} mm" if tight else "another pitch"
            problem = (
                f"connector: at most {error.routed} of {coils} coils can be routed to the {side} edge at a pitch of "
                f"{tried.pitch * 1e3:g} mm; try {pitch}, smaller coils, another side, or no connector."
            )
            if tight and not movable and 2 * error.routed < coils:
                break
        except (GeometryError, RuleViolationError) as error:
            problem = f"connector: {str(error).removeprefix(f'{plan.name}: ')}"
        else:
            return replace(tried, connector=ways.model_dump(exclude_unset=True))
    raise DesignError(problem)


def _roomy_pitch(plan: Plan, side: Side) -> float:
    """Estimate a pitch in m at which the leads of a whole row pass beside each other."""
    across, passing = (
        (plan.size[-1], plan.arrangement.columns)
        if side in ("left", "right")
        else (plan.size[0], plan.arrangement.rows)
    )
    winding = plan.winding
    room = plan.lead + passing * (winding.trace_width + winding.gap) + winding.gap
    return math.ceil((across + room) / _PITCH_STEP * (1 - 1e-9)) * _PITCH_STEP
