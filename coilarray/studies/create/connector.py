"""The leads of all coils of a new design, routed to a connector at one edge of its board."""

from __future__ import annotations

import math
from dataclasses import replace

from coilarray.design.tables import ConnectorTable
from coilarray.errors import DesignError, GeometryError, RuleViolationError
from coilarray.geometry import require_rules, route_leads
from coilarray.geometry.connector import NoWayError
from coilarray.geometry.values import Side
from coilarray.studies.create.plan import Plan

_DISTANCES = (5.0, 6.0, 8.0, 10.0)  # mm from the coils; for several rows from the second on, with room for ways between
_PITCH_STEP = 0.5e-3  # m
_LONGER, _FURTHER = 0.5e-3, 1e-3  # m by which leads get longer and coils lie further apart at each distance


def with_connector(plan: Plan, side: Side, *, movable: bool) -> Plan:
    """Find room for all leads to a connector.

    The distance of the connector, the length of the leads and, if `movable`, the pitch of the coils are increased.
    Raises DesignError with the problem of the roomiest board if a lead finds no way or a rule is broken. The search
    stops early if less than half of the coils are routed, and neighbours that may not move are too near for the leads
    of a row between them.
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
    """Estimate a pitch in m with room for all leads.

    The leads of a whole row or column of coils then pass beside each other's leads.
    """
    across, passing = (plan.size[-1], plan.arrangement.columns) if side in ("left", "right") else (
        plan.size[0], plan.arrangement.rows)  # fmt: skip
    winding = plan.winding
    room = plan.lead + passing * (winding.trace_width + winding.gap) + winding.gap
    return math.ceil((across + room) / _PITCH_STEP * (1 - 1e-9)) * _PITCH_STEP
