"""The leads of all coils of a new design led to a connector at one edge of its board."""

from __future__ import annotations

from dataclasses import replace

from coilarray.errors import DesignError, RuleViolationError
from coilarray.geometry import require_rules
from coilarray.geometry.values import Side
from coilarray.studies.create.plan import Plan

_DISTANCES = (5.0, 6.0, 8.0, 10.0)  # mm from the coils; those of several rows begin with the second, for ways between
_LONGER, _FURTHER = 0.5e-3, 1e-3  # m that leads get longer from each distance to the next, and coils lie further apart


def with_connector(plan: Plan, side: Side, *, movable: bool) -> Plan:
    """Find room for the ways of all leads: a distance of the connector, longer leads, and coils that are `movable`.

    DesignError where no lead finds a way, or a rule is broken: the line of the roomiest board that was tried.
    """
    problem = ""
    several = plan.arrangement.rows > 1 or plan.arrangement.lattice == "rings"
    for k, distance in list(enumerate(_DISTANCES))[several:]:
        further = k * _FURTHER if movable else 0.0
        ways = {"side": side, "distance_mm": distance}
        tried = replace(plan, connector=ways, lead=plan.lead + k * _LONGER, pitch=plan.pitch + further)
        try:
            require_rules(tried.design.array, tried.rules)
        except (DesignError, RuleViolationError) as error:
            problem = str(error).removeprefix(f"{plan.name}: ")
        else:
            return tried
    raise DesignError(problem)
