"""The leads of all coils of a new design led to a connector at one edge of its board."""

from __future__ import annotations

from dataclasses import replace

from coilarray.design.tables import ConnectorTable
from coilarray.errors import DesignError, GeometryError, RuleViolationError
from coilarray.geometry import lead_out, require_rules
from coilarray.geometry.connector import NoWayError
from coilarray.geometry.values import Side
from coilarray.studies.create.plan import Plan

_DISTANCES = (5.0, 6.0, 8.0, 10.0)  # mm from the coils; those of several rows begin with the second, for ways between
_ADVICE = "a larger pitch, smaller coils, another side, or no connector"
_LONGER, _FURTHER = 0.5e-3, 1e-3  # m that leads get longer from each distance to the next, and coils lie further apart


def with_connector(plan: Plan, side: Side, *, movable: bool) -> Plan:
    """Find room for the ways of all leads: a distance of the connector, longer leads, and coils that are `movable`.

    DesignError where no lead finds a way, or a rule is broken: the line of the roomiest board that was tried. Where
    less than half of the coils can be led out and they cannot lie further apart, no roomier board is tried: the
    connector's distance makes no room between the coils.
    """
    problem = ""
    several = plan.arrangement.rows > 1 or plan.arrangement.lattice == "rings"
    for k, distance in list(enumerate(_DISTANCES))[several:]:
        further = k * _FURTHER if movable else 0.0
        tried = replace(plan, lead=plan.lead + k * _LONGER, pitch=plan.pitch + further)
        ways = ConnectorTable(side=side, distance_mm=distance)
        try:
            require_rules(lead_out(tried.design.array, ways.build()), tried.rules)
        except NoWayError as error:
            coils = len(tried.design.array.placements)
            problem = (
                f"connector: at most {error.led} of {coils} coils can be led to the {side} edge at a pitch of "
                f"{tried.pitch * 1e3:g} mm; choose {_ADVICE}."
            )
            if 2 * error.led < coils and not movable:
                break
        except (GeometryError, RuleViolationError) as error:
            problem = f"connector: {str(error).removeprefix(f'{plan.name}: ')}"
        else:
            return replace(tried, connector=ways.model_dump(exclude_unset=True))
    raise DesignError(problem)
