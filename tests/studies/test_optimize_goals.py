"""Goals that fit any design: what they take from it, checked against its geometry and its rules.

What                                   checked against
least pitch and largest size           the rules of the board house, which break just beyond
ranges and bounds                      the design itself, which lies within all of them
the text of a goal                     the goal, which it reads back to
"""

import dataclasses

import pytest

from coilarray import load_design
from coilarray.design.model import build_design_file
from coilarray.design.vary import vary
from coilarray.errors import GoalError
from coilarray.studies.optimize.derive import NAMES, adjusted, derive_goal, parse_bound
from coilarray.studies.optimize.goal import axes_of, parse_goal, start_parameters
from coilarray.studies.quantities import evaluate
from coilarray.studies.sweep import parse_axis

COIL = {
    "shape": "polygon", "sides": 4, "outer_across_flats_mm": 14.0, "turns_per_layer": 4, "trace_width_mm": 0.3,
    "gap_mm": 0.2, "first_corner_deg": 45, "via": {"drill_mm": 0.3, "pad_mm": 0.6},
}  # fmt: skip
STACKUP = {
    "layers": ["L1", "L2"], "copper_thickness_um": [35, 35], "dielectric_thickness_mm": [1.5],
    "dielectric_epsilon_r": [4.5],
}  # fmt: skip
LAYERS = ["L1", "L2"]


def pads(lattice, **tables):
    """Square coils of two layers in a lattice."""
    array = lattice if "placements" in lattice else {"coil": "sq", "layers": [LAYERS], **lattice}
    return build_design_file(
        {"schema": 1, "name": "pad", "stackup": STACKUP, "coils": {"sq": COIL}, "array": array, **tables}
    )


SINGLE = {"lattice": "linear", "columns": 1, "pitch_mm": 15.0}
PAD, ONE = pads({"lattice": "square", "columns": 3, "rows": 2, "pitch_mm": 15.0}), pads(SINGLE)
MOVED = pads(SINGLE, target={"shape": "sphere", "material": "brass", "diameter_mm": 8, "distances_mm": [1, 2, 6]})
PLACES = [{"name": name, "coil": "sq", "layers": LAYERS, "x_mm": x, "y_mm": 0} for name, x in (("a", 0), ("b", 14.5))]
FREE = pads({"lattice": "free", "placements": PLACES})
PATH = {
    "shape": "path", "lines_mm": [[[0, 0], [8, 0], [8, 8]], [[8, 8], [0, 8], [0, 1]]], "trace_width_mm": 0.3,
    "gap_mm": 0.2,
}  # fmt: skip
WIRE = pads({"lattice": "free", "placements": PLACES}, coils={"sq": PATH})
PITCH, SIZE = "array.pitch_mm", "coils.sq.outer_across_flats_mm"


def variable(goal, entry):
    (found,) = [one for one in goal.variables if one.entry == entry]
    return found


def margin(design):
    return evaluate(design, ["fab_margin_mm"])["fab_margin_mm"]


@pytest.mark.parametrize(("file", "names"), [
    (PAD, ("worst_k", "decouple")), (ONE, ("smallest",)), (FREE, ("worst_k", "decouple")),
    (load_design("starter"), ("worst_k", "decouple", "position_error")),
    (load_design("gast2020"), ("worst_k", "decouple", "position_error")),
    (MOVED, ("range", "resolution")),
])  # fmt: skip
def test_the_design_itself_lies_within_its_goals(file, names):
    for name in names:
        derived = derive_goal([name], file)
        goal = derived.goal
        assert start_parameters(axes_of(goal, file)) is not None
        assert parse_goal(derived.text(f"two\nlines of {name}")) == goal
        bounds = [bound for bound in goal.constraints if bound.quantity.endswith(("_mm", "_mm2"))]
        values = evaluate(getattr(file, "design", file), [bound.quantity for bound in bounds])
        assert bounds
        for bound in bounds:
            assert max(bound.violations(values[bound.quantity]).values()) <= 0
        assert set(derived.comments) >= {("variable", one.entry) for one in goal.variables}


def test_ranges_end_where_the_rules_do():
    """Coils of one copper layer as near as they may be, and a turn beyond: some sides of a spiral lie a turn within."""
    turn = 0.5 + 0.1  # mm, and what ranges are rounded to
    low = variable(derive_goal(["worst_k"], PAD).goal, PITCH).low
    assert margin(vary(PAD, {PITCH: low})) >= -0.001
    assert margin(vary(PAD, {PITCH: low - turn})) < -0.001
    high = variable(derive_goal(["worst_k"], FREE).goal, SIZE).high
    assert margin(vary(FREE, {SIZE: high - 0.1})) >= -0.001 > margin(vary(FREE, {SIZE: high + turn}))


def test_what_each_goal_takes_from_the_design():
    pair = derive_goal(["decouple"], PAD)
    assert pair.goal.objectives[0].quantity == "k[coil2,coil5]"  # the column in the middle
    assert "on the same copper" in pair.comments["objective", pair.goal.objectives[0].quantity]
    assert derive_goal(["decouple"], load_design("gast2020")).goal.objectives[0].quantity == "k[coil3,coil4]"
    layers = variable(derive_goal(["worst_k"], load_design("gast2020")).goal, "array.layers").choices
    assert len(layers) == 3  # ways to share four layers between two
    small = derive_goal(["smallest"], ONE).goal
    wanted = evaluate(ONE.design, ["inductance_uH[coil1]", "q"])
    bounds = {bound.quantity: bound.at_least for bound in small.constraints}
    assert bounds["inductance_uH[coil1]"] == pytest.approx(wanted["inductance_uH[coil1]"], rel=1e-2)
    assert bounds["q"] == pytest.approx(0.8 * wanted["q"], rel=1e-2)
    told = derive_goal(["range", "resolution"], MOVED).goal
    assert [one.wish for one in told.objectives] == [
        "maximize target_range_mm[coil1]", "minimize target_deviation_um[coil1,distance_mm=2]",
    ]  # fmt: skip
    trace = variable(small, "coils.sq.trace_width_mm")
    assert (trace.low, trace.high) == (0.1, 0.3)  # the limit of [fab], and what it is
    broken = dataclasses.replace(PAD.design, rules=dataclasses.replace(PAD.design.rules, min_gap=0.25e-3))
    kept = derive_goal(["decouple"], broken).goal.constraints[0].at_least
    assert margin(broken) * 1.01 < kept <= margin(broken) < -0.04  # by which the design breaks the rule already


def test_several_goals_and_wishes_are_one():
    starter = load_design("starter")
    both = derive_goal(["worst_k", "position_error"], starter).goal
    assert [objective.quantity for objective in both.objectives] == ["worst_k", "position_error_mm"]
    assert (both.sampler, both.polish) == ("nsga2", 0)
    assert len({one.entry for one in both.variables}) == len(both.variables) == 4
    wish = derive_goal(["maximize q", "k[coil1,coil2]=0"], starter, [parse_axis("array.pitch_mm=12:16")]).goal
    assert [objective.wish for objective in wish.objectives] == ["maximize q", "bring k[coil1,coil2] to 0"]
    assert [(one.entry, one.low, one.high) for one in wish.variables] == [(PITCH, 12.0, 16.0)]


def test_what_the_command_line_gives_takes_the_place_of_the_derived():
    derived = derive_goal(["worst_k"], PAD)
    keep = [parse_bound("board_area_mm2<=2500"), parse_bound("span_mm >= 40"), parse_bound("span_mm<=50")]
    axes = [parse_axis("array.pitch_mm=14:16:5"), parse_axis("coils.sq.winding_layers=1,2")]
    goal = adjusted(derived, axes, keep).goal
    bounds = {bound.quantity: (bound.at_least, bound.at_most) for bound in goal.constraints}
    assert bounds["board_area_mm2"] == (None, 2500.0)
    assert bounds["span_mm"] == (40.0, 50.0)
    assert set(bounds) == {"fab_margin_mm", "covered_mm2", "board_area_mm2", "span_mm"}
    pitch, layers = goal.variables
    assert (pitch.low, pitch.high, pitch.step, layers.choices) == (14.0, 16.0, 0.5, [1, 2])
    assert parse_goal(adjusted(derived, axes, keep).text("")) == goal
    assert adjusted(derived, [], []) is derived


@pytest.mark.parametrize(("wishes", "file", "message"), [
    (["worst_k"], ONE, "has only one coil, and so no coupling"),
    (["decouple"], ONE, "has only one coil, and so no coupling"),
    (["position_error"], PAD, r"has no \[indenter\] and \[indentation\]"),
    (["position_error"], load_design("gast_fem"), "needs 3 states of the scan for x, y and the depth; gast_fem has 1"),
    (["range"], PAD, r"has no \[target\]"),
    (["least"], PAD, f"must be one of {', '.join(NAMES)}, or minimize QUANTITY"),
    (["minimize worst"], PAD, "there is no quantity 'worst'; did you mean worst_k"),
])  # fmt: skip
def test_goals_that_a_design_has_not(wishes, file, message):
    with pytest.raises(GoalError, match=message):
        derive_goal(wishes, file)
