"""Copper outlines: area against length × width, pads on the right layers, unions, the edge of the board.

Who checks whom: `trace_outline` against the closed formula and against the general buffer of GEOS.
"""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from support.boards import FOUR_LAYERS, LEADS, VIA, length, one_coil, reference_board, round_spiral

from coilarray.geometry import Array, Placement, Spiral, path_coil
from coilarray.geometry.copper import board_outline, copper_by_layer, copper_features, disc, drills, trace_outline


@pytest.mark.parametrize("sides", [3, 4, 6, None])
@pytest.mark.parametrize("winding", ["ccw", "cw"])
def test_area_of_a_mitred_trace_is_length_times_width(sides, winding):
    turns = (15, 0.1e-3, 0.12e-3)
    spiral = (
        round_spiral(8e-3, *turns, winding=winding)
        if sides is None
        else Spiral(sides, 16e-3, *turns, 0.3, winding=winding)
    )
    line = spiral.centre_line()
    outline = trace_outline(line, 0.1e-3)
    assert outline.is_valid
    assert not outline.interiors
    # what a mitre adds outside it takes inside; rounding of coordinates 80 times the width over up to 1440 corners
    assert outline.area == pytest.approx(length(line) * 0.1e-3, rel=1e-11)


@given(sides=st.sampled_from([3, 4, 5, 6, 8]), corner=st.floats(-7, 7), turns=st.integers(1, 12))
@settings(max_examples=30)
def test_outline_is_the_buffer_of_the_line(sides, corner, turns):
    line = Spiral(sides, 16e-3, turns, 0.15e-3, 0.15e-3, corner).centre_line()
    outline = trace_outline(line, 0.15e-3)
    buffer = shapely.LineString(line).buffer(0.075e-3, cap_style="flat", join_style="mitre", mitre_limit=4)
    # corners of up to 60° are not simplified by the buffer: rounding only
    assert shapely.symmetric_difference(outline, buffer).area < 1e-9 * outline.area


def test_traces_that_cross_end_short_or_turn_back():
    w = 0.2e-3
    line = np.array([(0, 0), (4e-3, 0), (4e-3, 2e-3), (2e-3, 2e-3), (2e-3, -2e-3)])
    outline = trace_outline(line, w)
    assert outline.is_valid
    assert len(outline.interiors) == 1
    assert outline.area == pytest.approx(length(line) * w - w * w, rel=1e-9)  # wedges reach 0.1 % of w inside
    # a stub shorter than the width keeps all its copper
    stub = 0.05e-3
    outline = trace_outline(np.array([(0, 0), (1e-3, 0), (1e-3, stub)]), w)
    # the first segment, the square that the mitre adds, and the half of the stub that lies beyond the first segment
    assert outline.area == pytest.approx(1e-3 * w + w * w / 4 + stub * w / 2, rel=1e-6)  # wedges as above
    # a reversal is cut off flat
    sharp = math.radians(5)
    tip = np.array([(0, 0), (5e-3, 0), (5e-3 * (1 - math.cos(sharp)), 5e-3 * math.sin(sharp))])
    assert trace_outline(tip, w).bounds[2] < 5e-3 + w


def test_each_coil_has_one_trace_a_layer_and_pads_where_its_holes_are():
    array = reference_board()
    features = copper_features(array)
    traces = [(feature.net, feature.layer) for feature in features if feature.kind == "trace"]
    assert traces == [(p.name, layer) for p in array.placements for layer in p.layers]
    for kind, holes_a_coil, diameter in (("via", 1, VIA.pad), ("terminal", 2, LEADS.terminal.pad)):
        pads = [feature for feature in features if feature.kind == kind]
        assert len(pads) == 6 * holes_a_coil * 4
        # a polygon of 128 corners lacks (2π/128)²/6 = 4e-4 of the circle
        assert pads[0].shape.area == pytest.approx(math.pi / 4 * diameter**2, rel=5e-4)


def test_holes_end_where_they_are_needed_when_they_are_not_drilled_through():
    lines = [[(k * 1e-3, 0), ((k + 1) * 1e-3, 0)] for k in range(3)]
    coil = path_coil(lines, 1e-4, 1e-4, VIA, LEADS.terminal)
    placement = Placement("A", coil, ("L3", "L1", "L2"), 0, 0)
    blind = drills(Array(FOUR_LAYERS, (placement,), through_holes=False))
    assert [(hole.kind, hole.layers, hole.drilled) for hole in blind] == [
        ("via", ("L1", "L2", "L3"), True), ("via", ("L1", "L2"), True), ("terminal", ("L3",), False),
        ("terminal", ("L2",), False),
    ]  # fmt: skip
    through = drills(Array(FOUR_LAYERS, (placement,)))
    assert {(hole.layers, hole.drilled) for hole in through} == {(FOUR_LAYERS.names, True)}
    assert [hole.x for hole in through] == pytest.approx([1e-3, 2e-3, 0, 3e-3])
    # a board of one layer is drilled
    coil = path_coil([[(0, 0), (1e-2, 0)]], 1e-4, 1e-4, VIA, LEADS.terminal)
    for through in (True, False):
        assert [hole.drilled for hole in drills(one_coil(coil, through_holes=through))] == [True, True]


@pytest.mark.parametrize("through_holes", [True, False])
def test_the_copper_of_a_layer_is_its_features(through_holes):
    array = reference_board(count=2, turns=10, through_holes=through_holes)
    assert list(copper_by_layer(array)) == list(array.stackup.names)
    for layer, nets in copper_by_layer(array).items():
        for net, copper in nets.items():
            own = [piece.shape for piece in copper_features(array) if (piece.layer, piece.net) == (layer, net)]
            apart = shapely.symmetric_difference(copper, shapely.union_all(own)).area
            assert apart < 1e-12 * copper.area  # moved after they are united: the rounding of coordinates


def test_the_outline_holds_all_copper_and_circles_are_fine_enough():
    array = reference_board()
    outline = board_outline(array)
    assert outline.bounds == array.bounds
    assert all(outline.contains(feature.shape) for feature in copper_features(array))
    circle = disc(1e-3, 2e-3, 1e-3)
    corners = shapely.get_coordinates(circle) - (1e-3, 2e-3)
    np.testing.assert_allclose(np.hypot(*corners.T), 0.5e-3, rtol=1e-12)
    sagitta = 0.5e-3 - min(np.hypot(*(a + b)) / 2 for a, b in pairwise(corners))
    assert sagitta < 0.2e-6
