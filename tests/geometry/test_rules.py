"""Fabrication rules: known distances come back as margins, shorts are negative, sound coils pass.

Who checks whom: closed formulas for parallel traces, pads and overlaps; for whole spirals the distance of their turns,
taken turn by turn with shapely.
"""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from support.boards import FOUR_LAYERS, LEADS, VIA, many_layers, one_coil, reference_board, round_spiral
from support.refusals import refused

from coilarray.errors import GeometryError, RuleViolationError
from coilarray.geometry import Array, Placement, PlatedHole, RoundedSpiral, Spiral, path_coil
from coilarray.geometry.coil import Coil
from coilarray.geometry.rules import KEPT_WITHIN, FabRules, check_rules, require_rules

W, GAP = 0.2e-3, 0.2e-3
RULES = FabRules()
ROUNDING = 1e-12  # m: coordinates of at most 0.1 m in float64, a few operations


def margins(array, rule, rules=RULES):
    return {(m.layer, m.feature): m for m in check_rules(array, rules) if m.rule == rule}


def spacing(array, layer="L1"):
    """What the rules say of the distances within the net A on a layer."""
    return margins(array, "spacing within net")[(layer, "A")]


def broken(array, rules=RULES):
    return [m for m in check_rules(array, rules) if not m.kept]


def board(*lines, width=W, terminal=None, via=VIA, **options):
    """Board with one coil A of these lines, or several coils A, B, … where each entry is a list of lines."""
    stackup = many_layers(4)
    coils = [path_coil(each, width, GAP, via, terminal) for each in lines]
    placements = [Placement(chr(65 + k), c, stackup.names[: len(c.lines)], 0, 0) for k, c in enumerate(coils)]
    return Array(stackup, tuple(placements), **options)


def straight(y, x0=0.0, x1=5e-3):
    return [[(x0, y), (x1, y)]]


def test_the_reference_board_keeps_the_default_rules():
    array = reference_board(count=2)
    require_rules(array, FabRules(min_gap=0.1e-3))
    worst = margins(array, "spacing within net")[("L1", "C1")]
    assert worst.value == pytest.approx(turn_to_turn(array.placements[0].coil.lines[0][2:-1], 6), abs=ROUNDING)
    assert -KEPT_WITHIN < worst.margin < 0
    require_rules(reference_board(through_holes=False), RULES)


def test_a_pad_without_a_hole_has_no_rule_of_holes():
    bare = path_coil([[(0, 0), (5e-3, 0)]], 1e-3, 1e-3, VIA, LEADS.terminal)
    array = Array(FOUR_LAYERS, (Placement("A", bare, ("L2",), 0, 0),), through_holes=False)
    rules = {margin.rule for margin in check_rules(array, FabRules(max_aspect_ratio=10))}
    assert not rules & {"drill", "annular ring", "hole spacing", "aspect ratio"}
    drilled = check_rules(replace(array, through_holes=True), FabRules(max_aspect_ratio=10))
    assert {"drill", "annular ring", "aspect ratio"} <= {margin.rule for margin in drilled}


SHAPES = {
    **{f"{sides} sides": partial(Spiral, sides, 12e-3 if sides == 3 else 16e-3) for sides in (3, 4, 5, 6, 8)},
    "circle": partial(RoundedSpiral, 16e-3, 16e-3, corner_radius=8e-3),
    "rectangle": partial(RoundedSpiral, 13e-3, 20e-3),
    "racetrack": partial(RoundedSpiral, 20e-3, 14e-3, corner_radius=7e-3, direction=math.pi / 2),
    "rounded triangle": partial(RoundedSpiral, 14e-3, 14e-3, corner_radius=3e-3, sides=3, direction=0.3),
    "rounded hexagon": partial(RoundedSpiral, 14e-3, 14e-3, corner_radius=7e-3, sides=6),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "winding", "layers"),
    [
        *((f"{n} sides", *kind) for n in (3, 4, 5, 6, 8) for kind in [("cw", 2), ("cw", 3), ("ccw", 6)]),
        *(("circle", "ccw", 6), ("rectangle", "cw", 3), ("racetrack", "cw", 2), ("rounded triangle", "ccw", 3)),
        ("rounded hexagon", "cw", 1),
    ],
)
def test_wound_coils_of_every_kind_are_free_of_violations(shape, winding, layers):
    # nominal gap 10 µm above the limit: the turns of a triangle come up to 5 µm closer than nominal; with six layers
    # three vias lie at one corner
    rules = FabRules(min_gap=0.13e-3)
    sides = SHAPES[shape](turns=1, width=0.12e-3, gap=0.14e-3).sides
    for turns in (6, 5 + 1 / sides):
        spiral = SHAPES[shape](turns=turns, width=0.12e-3, gap=0.14e-3, winding=winding)
        for return_lead in (False, True)[: 1 + layers % 2]:
            coil = replace(spiral, layers=layers, return_lead=return_lead).coil()
            assert broken(one_coil(coil, rotation=1.234), rules) == []
        assert broken(one_coil(replace(spiral, layers=layers, leads=None).coil()), rules) == []


@pytest.mark.slow
@given(rotation=st.floats(-7, 7), shape=st.sampled_from(list(SHAPES)))
@settings(max_examples=15)
def test_margins_do_not_depend_on_rotation(rotation, shape):
    coil = SHAPES[shape](turns=3, width=0.15e-3, gap=0.2e-3).coil()
    for rule in ("spacing within net", "annular ring", "hole spacing"):
        here = {key: m.margin for key, m in margins(one_coil(coil), rule).items()}
        turned = {key: m.margin for key, m in margins(one_coil(coil, rotation=rotation), rule).items()}
        assert turned == pytest.approx(here, abs=ROUNDING)


def turn_to_turn(line, sides):
    """Least distance of the turns of a spiral of traces of 0.1 mm."""
    segments = shapely.linestrings(np.stack((line[:-1], line[1:]), axis=1))
    return min(shapely.distance(segments[:-n], segments[n:]).min() for n in range(sides - 1, sides + 2)) - 0.1e-3


def test_turn_spacing_is_the_distance_of_consecutive_turns():
    for sides in (3, 4, 6):
        spiral = Spiral(sides, 16e-3, 10, 0.1e-3, 0.2e-3)
        value = spacing(one_coil(replace(spiral, layers=1, leads=None).coil())).value
        assert value == pytest.approx(turn_to_turn(spiral.centre_line(), sides), abs=ROUNDING)
    # turns too close are found
    worst = spacing(one_coil(round_spiral(6e-3, 10, 0.1e-3, 0.08e-3, layers=1, leads=None).coil()))
    # arcs about one centre keep their distance, parallel pieces of 2° but for 1.5e-4 of the pitch of 0.18 mm
    assert worst.margin == pytest.approx(-0.02e-3, abs=1.5e-4 * 0.18e-3)
    assert 3.5e-3 < math.hypot(worst.x, worst.y) < 6e-3


def test_hairpins():
    for gap in (0.05e-3, 0.1e-3, 0.3e-3):
        array = board([[(0, 0), (5e-3, 0), (5e-3, W + gap), (0, W + gap)]])
        assert spacing(array).margin == pytest.approx(gap - 0.1e-3, abs=ROUNDING)
    # with legs that diverge
    array = board([[(0, 0.6e-3), (5e-3, 0.25e-3), (5e-3, 0), (0, 0)]])
    # counted from 0.9 mm along the copper, where the legs are a little over 0.25 mm apart from centre to centre
    assert -0.05e-3 < spacing(array).margin < -0.02e-3
    notch = board([[(0, 5e-3), (5e-3, 0.25e-3), (5e-3, 0), (0, 0)]])
    assert broken(notch) == []


def test_corners_and_finely_divided_arcs_are_no_gap():
    for phi in np.radians([40, 60, 90, 120, 179]).tolist():
        array = board([[(0, 0), (5e-3, 0), (5e-3 - 5e-3 * math.cos(phi), 5e-3 * math.sin(phi))]])
        assert margins(array, "spacing within net") == {}
    t = np.linspace(0, math.pi, 200)
    for radius in (0.4e-3, 1e-3, 4e-3):
        assert broken(board([radius * np.column_stack((np.cos(t), np.sin(t)))])) == []


def test_a_lead_across_its_own_winding_is_a_short():
    spiral = Spiral(6, 16e-3, 5, 0.15e-3, 0.15e-3)
    coil = replace(spiral, layers=1, leads=None).coil()
    line = np.vstack((coil.lines[0], [10e-3, 0.0]))  # from the inner end straight out
    refused(GeometryError, "crosses itself", path_coil, [line], 0.15e-3, 0.15e-3, VIA)
    crossing = one_coil(Coil((line,), (np.full(len(line) - 1, 0.15e-3),), 0.15e-3, VIA, None, coil.outline))
    # centre lines meet: minus the trace width
    assert spacing(crossing).value == pytest.approx(-0.15e-3, abs=ROUNDING)
    refused(RuleViolationError, "spacing within net of A on layer L1", require_rules, crossing, RULES)


def test_an_inner_pad_against_the_next_turn():
    for overlap in (-0.05e-3, 0.02e-3, 0.2e-3):
        y = VIA.pad / 2 + W / 2 - overlap
        array = board([[(-3e-3, y), (3e-3, y), (3e-3, -2e-3), (0, -2e-3), (0, 0)], [(0, 0), (0, -1e-3)]])
        assert spacing(array).margin == pytest.approx(-overlap - 0.1e-3, abs=ROUNDING)


def test_separate_pads_and_barrels_of_one_net():
    lines = [
        [(0, 0), (3e-3, 0)],
        [(3e-3, 0), (3e-3, 3e-3), (0, 3e-3)],
        [(0, 3e-3), (0, 6e-3), (6e-3, 6e-3), (6e-3, -1e-3), (3e-3, -1e-3), (3e-3, 5e-3)],
    ]
    worst = spacing(board(lines), "L3")
    assert worst.value == pytest.approx(-(VIA.pad + W) / 2, abs=ROUNDING)
    assert (worst.x, worst.y) == pytest.approx((3e-3, 0), abs=ROUNDING)
    assert broken(board(lines, through_holes=False)) == []
    # pads
    far, near = 0.6e-3, 0.5e-3
    array = board([[(0, 0), (3e-3, 0)], [(3e-3, 0), (0, far)], [(0, far), (0, 3e-3)]], via=PlatedHole(0.2e-3, 0.4e-3))
    assert broken(array) == []
    lines = [[(-3e-3, 0), (0, 0)], [(0, 0), (2e-3, 2e-3), (0, 4e-3), (0, near)], [(0, near), (-3e-3, near)]]
    close = board(lines, via=PlatedHole(0.2e-3, 0.45e-3))
    # no trace there, only the two pads
    assert spacing(close, "L4").value == pytest.approx(near - 0.45e-3, abs=ROUNDING)


@given(gap=st.floats(-0.15e-3, 0.9e-3))
@settings(max_examples=20)
def test_clearance_is_continuous_through_contact(gap):
    array = board(straight(0), straight(W + gap))
    margin = margins(array, "clearance")[("L1", "A – B")].margin
    # penetration of two strips is the width of their overlap; the inscribed circle is found to 0.1 µm
    assert margin == pytest.approx(gap - 0.1e-3, abs=ROUNDING if gap > 0 else 2.1e-7)


def test_overlaps_of_two_nets():
    array = board(straight(0), [[(2e-3, -2e-3), (2e-3, 2e-3)]])
    worst = margins(array, "clearance")[("L1", "A – B")]
    assert worst.value == pytest.approx(-W, abs=2.1e-7)  # tolerance of the inscribed circle
    assert (worst.x, worst.y) == pytest.approx((2e-3, 0), abs=1e-6)
    # whole windings
    coil = Spiral(6, 16e-3, 20, 0.1e-3, 0.1e-3, layers=1, leads=None).coil()
    array = Array(many_layers(1), (Placement("A", coil, ("L1",), 0, 0), Placement("B", coil, ("L1",), 3e-3, 1e-3)))
    assert margins(array, "clearance")[("L1", "A – B")].margin < -0.1e-3  # hundreds of crossings, each with its circle
    # a through hole meets foreign copper on a layer that it does not use
    other = Placement("B", path_coil(straight(0, 2e-3, 6e-3), W, GAP, VIA), ("L4",), 0, 0)
    mine = Placement("A", path_coil([[(0, 0), (4e-3, 0)], [(4e-3, 0), (4e-3, 4e-3)]], W, GAP, VIA), ("L1", "L2"), 0, 0)
    worst = margins(Array(FOUR_LAYERS, (mine, other)), "clearance")[("L4", "A – B")]
    assert worst.value < -0.9 * W
    assert margins(Array(FOUR_LAYERS, (mine, other), through_holes=False), "clearance") == {}


def test_what_is_listed_and_in_which_order():
    assert margins(board(straight(0), straight(5e-3)), "clearance") == {}
    assert margins(board(straight(0), straight(W + 0.95e-3)), "clearance") != {}
    # the worst comes first
    values = [round(m.margin, 12) for m in check_rules(reference_board(count=2, turns=5), RULES)]
    assert values == sorted(values)
    # at its limits a design passes, a micrometre more does not
    assert broken(board(straight(0), straight(W + 0.1e-3), width=W)) == []
    assert broken(board(straight(0), straight(W + 0.0989e-3), width=W)) != []
    assert broken(board(straight(0), width=0.1e-3)) == []


def test_holes_widths_and_edge():
    hole = PlatedHole(0.25e-3, 0.55e-3)
    array = board([[(0, 0), (0.3e-3 + 0.25e-3, 0)]], width=0.12e-3, terminal=hole, board_margin=0.25e-3)
    expected = {"trace width": 0.02e-3, "drill": 0.05e-3, "annular ring": 0.05e-3, "hole spacing": 0.05e-3}
    for rule, margin in (*expected.items(), ("edge clearance", -0.05e-3)):
        assert margins(array, rule)[("L1", "A")].margin == pytest.approx(margin, abs=ROUNDING)
    assert margins(array, "edge clearance")[("L4", "A")].margin == pytest.approx(-0.05e-3, abs=ROUNDING)
    # of two nets
    hole = PlatedHole(0.3e-3, 0.4e-3)
    array = board(straight(0), straight(0.35e-3), terminal=hole)
    worst = margins(array, "hole spacing")[("L1", "A – B")]
    assert worst.margin == pytest.approx(0.05e-3 - 0.25e-3, abs=ROUNDING)


def test_the_place_of_a_narrow_trace_lies_on_its_copper_and_not_in_the_hole_at_its_end():
    array = board(straight(0), terminal=PlatedHole(0.3e-3, 0.6e-3))
    narrow = margins(array, "trace width")[("L1", "A")]
    line = array.placements[0].coil.lines[0]
    assert (narrow.x, narrow.y) == pytest.approx(line[:2].mean(axis=0))
    assert all(math.hypot(narrow.x - x, narrow.y - y) > 0.3e-3 for x, y in line)


def test_limits_must_be_finite_and_not_negative():
    for name in ("min_trace", "min_gap", "min_drill", "min_annular_ring", "min_edge_clearance"):
        for value in (-1e-4, math.nan, math.inf):
            refused(GeometryError, f"{name} must be finite and not negative", FabRules, **{name: value})


def test_the_error_names_layer_feature_margin_and_the_rest():
    array = board(straight(0), straight(W + 0.04e-3))
    message = r"^clearance of A – B on layer L1 is 0\.04 mm at \(.*\) mm, margin -0\.06 mm to the limit of 0\.1 mm\.$"
    refused(RuleViolationError, message, require_rules, array, RULES)
    refused(RuleViolationError, r"; 2 more are broken\.$", require_rules, array, FabRules(min_trace=0.21e-3))


def test_progress_counts_every_coil_on_every_layer():
    board, seen = reference_board(), []
    check_rules(board, FabRules(), progress=lambda *step: seen.append(step))
    total = len(board.stackup.names) * len(board.placements)
    assert seen == [(k + 1, total) for k in range(total)]
