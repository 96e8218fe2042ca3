"""Goal files, their variables, and goals that fit any design: what they say and take, and what they refuse."""

import dataclasses
import math
from types import SimpleNamespace

import pytest

from coilarray import Array, Design, Spiral, load_design
from coilarray.design.model import build_design_file
from coilarray.design.vary import vary
from coilarray.design.write import as_file
from coilarray.errors import GoalError
from coilarray.report.studies import Chosen, target_missed
from coilarray.studies.optimize.derive import NAMES, adjusted, derive_goal, parse_bound
from coilarray.studies.optimize.goal import Axis, Goal, Trial, axes_of, changes_of, parse_goal, start_parameters
from coilarray.studies.optimize.run import study_name
from coilarray.studies.quantities import evaluate
from coilarray.studies.sweep import parse_axis

PITCH = '[[variable]]\nentry = "array.pitch_mm"\nlow = 11\nhigh = 14\n'
LEAST = '[[objective]]\nquantity = "rms_k"\ndirection = "minimize"\n'
GOOD = "schema = 1\n" + PITCH + LEAST


def goal_of(*parts, head="schema = 1\n") -> Goal:
    return parse_goal(head + "\n".join(parts))


def test_scores_and_violations():
    goal = goal_of(
        PITCH,
        '[[objective]]\nquantity = "q"\ntarget = 30.0',
        '[[objective]]\nquantity = "rms_k"\ndirection = "maximize"',
        '[[constraint]]\nquantity = "span_mm"\nat_least = 80\nat_most = 100',
        '[[constraint]]\nquantity = "fab_margin_mm"\nat_least = 0',
    )
    values = {"q": 28.0, "rms_k": 0.25, "span_mm": 70.0, "fab_margin_mm": -0.5}
    assert goal.scores(values) == (2.0, 0.25)
    # relative to a bound that is not zero, so that mm and µH add up
    assert goal.violations(values) == {"span_mm >= 80.0": 0.125, "span_mm <= 100.0": -0.3, "fab_margin_mm >= 0.0": 0.5}
    touching = {**values, "span_mm": math.nextafter(80.0, 0.0), "fab_margin_mm": 0.0}
    assert max(goal.violations(touching).values()) <= 0.0  # a rounded sum breaks no bound


def test_what_tells_studies_apart(design):
    def name(*parts, head="schema = 1\n", of=design):
        return study_name(of, goal_of(*parts, head=head))

    plain = name(PITCH, LEAST)
    assert plain.startswith("gast2020-")
    # more of the same, other words and other numbers to look at: the same points
    assert name(PITCH, LEAST, "[search]\ntrials = 7\npolish = 3\nsampler = 'tpe'") == plain
    assert name(PITCH, LEAST, head='schema = 1\ntitle = "other"\nwatch = ["q"]\n') == plain
    further = ["seed = 1", "batch = 1", "sampler = 'random'"]
    others = [
        name(PITCH.replace("14", "15"), LEAST), name(PITCH, LEAST.replace("minimize", "maximize")),
        name(PITCH, LEAST, '[[constraint]]\nquantity = "q"\nat_least = 1'),
        name(PITCH, LEAST, of=load_design("gast_fem")), *(name(PITCH, LEAST, f"[search]\n{one}") for one in further),
    ]  # fmt: skip
    assert len({plain, *others}) == len(others) + 1


@pytest.mark.parametrize(("text", "message"), [
    ("", "goal: schema is missing."), ("schema = 2", "schema must be at most 1; got 2"),
    ("schema = 1", "variable is missing"),
    ("schema = 1\n" + PITCH, "objective is missing"),
    ("schema = 1\nvariables = []", "the file has no key 'variables'; did you mean variable?"),
    ("schema = 1\n" + PITCH + "hihg = 2\n" + LEAST, "variable.0 has no key 'hihg'; did you mean high?"),
    ("schema = 1\n" + PITCH.replace("14", "11") + LEAST, "variable.0 needs low below high; got 11 and 11"),
    ("schema = 1\n" + PITCH.replace("high = 14", "") + LEAST, "variable.0 needs low and high, or choices"),
    ("schema = 1\n" + PITCH + "choices = [12, 13]\n" + LEAST, "variable.0 needs either low and high or choices"),
    ("schema = 1\n" + PITCH + "step = 0.7\n" + LEAST, "variable.0 needs a whole number of steps of 0.7"),
    ("schema = 1\n" + PITCH + "step = 5e-324\n" + LEAST, "variable.0 needs at most 1e+09 steps from low to high"),
    ("schema = 1\n" + PITCH + "step = 0.5\nlog = true\n" + LEAST, "variable.0 may have step or log, not both"),
    ("schema = 1\n" + PITCH.replace("11", "0") + "log = true\n" + LEAST, "variable.0 needs low above 0"),
    ("schema = 1\n" + PITCH + PITCH + LEAST, "the goal names the entry array.pitch_mm in more than one variable"),
    (GOOD + LEAST, "the goal needs a different quantity in every objective"),
    ("schema = 1\n[[variable]]\nentry = 'a'\nchoices = [1, 1]\n" + LEAST, "variable.0 needs choices that differ"),
    ("schema = 1\n[[variable]]\nentry = 'a'\nchoices = [[1], [1.0]]\n" + LEAST, "needs choices that differ"),
    ("schema = 1\n[[variable]]\nentry = 'a'\nchoices = [1, 1979-05-27]\n" + LEAST, "choices that are numbers"),
    (GOOD.replace("rms_k", "rms_q"),
     "objective.0.quantity cannot be: there is no quantity 'rms_q'; did you mean rms_k?"),
    (GOOD.replace('"rms_k"', '"k"'), "objective.0.quantity cannot be: k needs the"),
    (GOOD + "target = 1\n", "objective.0 needs exactly one of direction"),
    (GOOD + "[[constraint]]\nquantity = 'q'", "constraint.0 needs at_least, at_most"),
    (GOOD + "[[constraint]]\nquantity = 'q'\nat_least = 2\nat_most = 1",
     "constraint.0 needs at_least up to at_most; got 2 and 1"),
    ("schema = 1\nvariable = []\n" + LEAST, "variable must"), ("schema = ", "goal: not valid TOML"),
    ("schema = 1\n" + PITCH.replace("14", '"14"') + LEAST, "variable.0.high must be a number; got '14'"),
    ("schema = 1\n[[variable]]\nentry = 'a'\nchoices = [1]\n" + LEAST, "variable.0.choices must"),
    (GOOD.replace('"rms_k"', "7"), "objective.0.quantity cannot be"),
    (GOOD.replace("minimize", "least"), "direction must"),
    (GOOD + "[search]\ntrials = 0", "search.trials must be at least 1; got 0"),
    (GOOD + "[search]\nseed = -1", "search.seed must be at least 0; got -1"),
    (GOOD + "[search]\nsampler = 'best'", "search.sampler must be"),
])  # fmt: skip
def test_mistakes(text, message):
    with pytest.raises(GoalError) as caught:
        parse_goal(text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_axes_know_the_design(design):
    goal = goal_of(
        PITCH + "step = 0.5\n",
        '[[variable]]\nentry = "array.columns"\nlow = 4\nhigh = 8\nstep = 2',
        '[[variable]]\nentry = "coils.hexagon.turns_per_layer"\nlow = 15\nhigh = 30\nlog = true',
        '[[variable]]\nentry = "stackup.dielectric_thickness_mm.1"\nlow = 0.1\nhigh = 0.7',
        '[[variable]]\nentry = "circuit.terminations.coil2"\nchoices = ["short", "open"]',
        '[[variable]]\nentry = "array.layer_shift_per_row"\nlow = 0\nhigh = 2',
        LEAST,
    )
    pitch, columns, turns, dielectric, coil2, shift = axes_of(goal, design)
    assert (pitch.whole, pitch.continuous, pitch.start) == (False, False, 13.28)
    assert (columns.whole, columns.start) == (True, 6)
    assert (turns.whole, turns.continuous, turns.start) == (False, True, 30.0)  # half a turn is a turn too
    thickness = design.array.stackup.dielectric_thickness[1] * 1e3
    assert (dielectric.continuous, dielectric.start) == (True, pytest.approx(thickness, rel=1e-12))
    assert (coil2.choices, coil2.start) == (('"short"', '"open"'), None)
    assert (shift.whole, shift.start) == (True, None)  # the design does not say it; its type does
    start = {"array.columns": 6, "coils.hexagon.turns_per_layer": 30.0, dielectric.entry: dielectric.start}
    assert start_parameters([columns, turns, dielectric]) == start
    assert start_parameters([pitch]) is start_parameters([coil2]) is None  # between two steps; not in the design
    changed = {"circuit.terminations.coil2": "open", "array.columns": 4}
    assert changes_of([coil2, columns], {**changed, "circuit.terminations.coil2": '"open"'}) == changed


@pytest.mark.parametrize(("variable", "message"), [
    ('entry = "array.pitch"\nlow = 1\nhigh = 2', "variable.0.low: array has no key 'pitch'; did you mean pitch_mm"),
    ('entry = "array.pitch_mm"\nlow = -1\nhigh = 2', "variable.0.low: array.pitch_mm must be greater than 0; got"),
    ('entry = "array.columns"\nlow = 1.5\nhigh = 3', "variable.0.low: array.columns must be a whole number"),
    ('entry = "array.columns"\nlow = 2\nhigh = 4\nstep = 0.5', "variable.0.step must be a whole number, as array."),
    ('entry = "array.lattice"\nchoices = ["linear", "round"]', "variable.0.choices: array.lattice must be"),
    ('entry = "array"\nchoices = [1, 2]', "variable.0.choices: array is a table"),
    ('entry = "stackup.dielectric_thickness_mm.7"\nlow = 1\nhigh = 2', "must have a number from 0 to 2"),
])  # fmt: skip
def test_variables_that_do_not_fit(design, variable, message):
    with pytest.raises(GoalError) as caught:
        axes_of(goal_of(f"[[variable]]\n{variable}\n", LEAST), design)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("axis", [
    Axis("a", (), 0.3, 11.3, step=0.1), Axis("a", (), -3, 9, step=3.0, whole=True),
    Axis("a", ('"x"', "[true]", "4")),
])  # fmt: skip
def test_steps_and_choices(axis):
    distribution = axis.distribution()
    last = len(axis.choices) - 1 if axis.choices else distribution.high
    values = [axis.value(distribution.to_external_repr(k)) for k in (0 if not axis.whole else -3, last)]
    expected = ["x", 4] if axis.choices else [axis.low, axis.high]
    assert values == expected
    assert [axis.value(axis.parameter(value)) for value in values] == values
    assert not axis.continuous


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
PITCH_KEY, SIZE = "array.pitch_mm", "coils.sq.outer_across_flats_mm"


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
    low = variable(derive_goal(["worst_k"], PAD).goal, PITCH_KEY).low
    assert margin(vary(PAD, {PITCH_KEY: low})) >= -0.001
    assert margin(vary(PAD, {PITCH_KEY: low - turn})) < -0.001
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
    assert [(one.entry, one.low, one.high) for one in wish.variables] == [(PITCH_KEY, 12.0, 16.0)]


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


def test_a_missed_target_names_the_rule_that_holds_it():
    """Two squares on the same copper: nearer to k = 0 they would overlap, and only layers of their own free them."""
    file = as_file(Design(Array.row(Spiral(4, 12e-3, 8, 0.2e-3, 0.2e-3), 2, 13e-3), name="pair"))
    goal = derive_goal(["decouple"], file, []).goal
    key = goal.objectives[0].quantity

    def trial(place, pitch, k, off):
        return Trial("search", place, {"array.pitch_mm": pitch}, {key: k}, (abs(k),), {"fab_margin_mm": off})

    start, best, refused_one = trial(0, 13.0, -0.03, 0.0), trial(1, 12.5, -0.02, 0.0), trial(2, 9.0, 0.001, 2.0)
    result = SimpleNamespace(goal=goal, start=start, trials=(best, refused_one), file=file, design=file.design)
    chosen = Chosen("best", best, file.design)
    stops, why, freed = target_missed(result, chosen)
    assert stops == f"{key} stops at −0.02, beside its target 0."
    assert "It would be 0.001 at array.pitch_mm = 9, which is refused: The copper of coil1 and coil2 overlaps" in why
    assert "coil1 and coil2 share copper. array.layers with layers of their own" in freed
    result.trials = (best,)
    assert "Neighbours lie on the same copper, so they cannot overlap." in target_missed(result, chosen)[1]
    assert target_missed(result, Chosen("best", trial(3, 9.0, 1e-5, 0.0), file.design)) == []
