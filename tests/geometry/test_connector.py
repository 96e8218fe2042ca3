"""Leads routed to a connector: they reach their pads, keep every rule, and change nothing of the winding."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.boards import many_layers
from support.refusals import refused

from coilarray import Design
from coilarray.design.model import build_design
from coilarray.design.write import design_document
from coilarray.errors import GeometryError
from coilarray.fabrication.nets import Barrel, check_nets
from coilarray.geometry import (
    Connector,
    FabRules,
    Lattice,
    Leads,
    PlatedHole,
    RoundedSpiral,
    Spiral,
    check_rules,
    copper_by_layer,
    drills,
    lattice_array,
    route_leads,
)

SMALL = Leads(1.3e-3, 1.6e-3, PlatedHole(0.4e-3, 0.8e-3))


def coils(columns, rows, pitch, layers=2, start=0.0):
    spiral = RoundedSpiral(6e-3, 5e-3, 4, 0.2e-3, 0.2e-3, 1e-3, direction=start)
    coil = replace(spiral, layers=layers, leads=SMALL, return_lead=layers % 2 == 1).coil()
    names = many_layers(len(coil.lines)).names
    return lattice_array(many_layers(len(names)), coil, Lattice("square", pitch, columns, rows, (names,)))


@pytest.mark.slow
@pytest.mark.parametrize("side", ["bottom", "left", "top", "right"])
def test_leads_reach_any_side_and_keep_the_rules(side):
    array = coils(2, 2, 9e-3, layers=3 if side == "left" else 2)
    led = route_leads(array, Connector(side, pitch=1.3e-3, distance=3e-3, at=1e-3, trace_width=0.15e-3, gap=0.2e-3))
    assert [margin for margin in check_rules(led, FabRules(min_trace=0.15e-3, min_gap=0.2e-3)) if not margin.kept] == []
    ends = np.vstack([place.to_board(place.coil.terminal_points) for place in led.placements])
    along, across = (ends[:, 0], ends[:, 1]) if side in ("bottom", "top") else (ends[:, 1], ends[:, 0])
    assert np.ptp(across) < 1e-12  # one row
    assert np.diff(np.sort(along)) == pytest.approx(1.3e-3, rel=1e-9)
    assert along.mean() == pytest.approx(1e-3, rel=1e-9)
    sense = 1 if side in ("right", "top") else -1
    outermost = np.max(sense * np.array(array.bounds)[[0, 2] if side in ("left", "right") else [1, 3]])
    assert sense * across[0] == pytest.approx(outermost - array.board_margin + 3e-3, rel=1e-9)
    # every coil has its winding, and no hole but its vias and the two at the edge
    for place, before in zip(led.placements, array.placements, strict=True):
        assert before.coil.lines[0][1:].tobytes() in place.coil.lines[0].tobytes()  # but for its end, a round corner
        for line, arcs, old, old_arcs in zip(
            place.coil.lines, place.coil.arcs, before.coil.lines, before.coil.arcs, strict=True
        ):
            middles = {tuple(np.round(arc.points(line)[1], 9)) for arc in arcs}
            assert {tuple(np.round(arc.points(old)[1], 9)) for arc in old_arcs} <= middles
        np.testing.assert_allclose(place.coil.via_points, before.coil.via_points)
    holes = [Barrel(hole.x, hole.y, hole.diameter, hole.layers) for hole in drills(led)]
    copper = {layer: list(nets.values()) for layer, nets in copper_by_layer(led).items()}
    assert check_nets(led, copper, holes) == ()


@pytest.mark.slow
def test_a_way_does_not_turn_back_on_the_lead_that_it_begins_at():
    """At a pitch in ten, the corner by which two were replaced lay behind the lead's end: no board came of it."""
    coil = Spiral(
        4,
        12e-3,
        10,
        0.1524e-3,
        0.17e-3,
        math.pi / 4,
        via=PlatedHole(0.254e-3, 0.55e-3),
        leads=Leads(2.5e-3, 1.5e-3, PlatedHole(0.5e-3, 1e-3)),
    ).coil()
    array = lattice_array(many_layers(2), coil, Lattice("square", 17.77275e-3, 4, 4, (many_layers(2).names,)))
    led = route_leads(array, Connector("bottom", distance=6e-3))
    for place in led.placements:
        for line in place.coil.lines:
            steps = np.diff(line, axis=0)
            along = steps / np.linalg.norm(steps, axis=1)[:, None]
            assert (along[1:] * along[:-1]).sum(axis=1).min() > -0.99  # no turn by half a circle


def test_a_design_keeps_its_connector():
    led = route_leads(coils(2, 1, 9e-3), Connector("top", pitch=2e-3, distance=4e-3))
    document = design_document(Design(led))
    assert document["connector"] == {"side": "top", "pitch_mm": 2.0, "distance_mm": 4.0}
    assert document["array"]["lattice"] == "square"
    assert build_design(document).digest == Design(led).digest


def test_connectors_that_cannot_be():
    refused(GeometryError, "side of the connector must be right, top, left or bottom; got 'up'", Connector, "up")
    for name in ("pitch", "distance", "trace_width", "gap"):
        refused(GeometryError, f"{name} of the connector must be positive and finite", Connector, **{name: 0.0})
    message, narrow = r"more than the pads of 0\.8 mm; got 0\.7 mm: pitch_mm", Connector(pitch=0.7e-3)
    refused(GeometryError, message, route_leads, coils(2, 1, 9e-3), narrow)
    coil = RoundedSpiral(6e-3, 6e-3, 4, 0.2e-3, 0.2e-3, leads=None)
    bare = lattice_array(many_layers(2), coil, Lattice("single"))
    refused(GeometryError, "coil1 has no leads that could be routed to a connector", route_leads, bare, Connector())
    message = r"the lead of coil\d on L\d cannot be routed to the bottom edge .*connector\.distance_mm"
    refused(GeometryError, message, route_leads, coils(3, 3, 7.1e-3), Connector(pitch=1e-3))
