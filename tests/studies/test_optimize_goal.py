"""Goal files and their variables: what they say, what they refuse, and the coordinates that they become."""

from __future__ import annotations

import math

import pytest

from coilarray import load_design
from coilarray.errors import GoalError
from coilarray.studies.optimize.goal import Axis, Goal, axes_of, changes_of, parse_goal, start_parameters
from coilarray.studies.optimize.run import study_name

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
    ("schema = 1\nvariable = []\n" + LEAST, "variable must have at least 1 entry"),
    ("schema = 1\n" + PITCH, "objective is missing"),
    ("schema = 1\nvariables = []", "the file has no key 'variables'; did you mean variable?"),
    ("schema = 1\n" + PITCH + "hihg = 2\n" + LEAST, "variable.0 has no key 'hihg'; did you mean high?"),
    ("schema = 1\n" + PITCH.replace("14", '"14"') + LEAST, "variable.0.high must be a number; got '14'"),
    ("schema = 1\n" + PITCH.replace("14", "11") + LEAST, "variable.0 needs low below high; got 11 and 11"),
    ("schema = 1\n" + PITCH.replace("high = 14", "") + LEAST, "variable.0 needs low and high, or choices"),
    ("schema = 1\n" + PITCH + "choices = [12, 13]\n" + LEAST, "variable.0 needs either low and high or choices"),
    ("schema = 1\n" + PITCH + "step = 0.7\n" + LEAST, "variable.0 needs a whole number of steps of 0.7"),
    ("schema = 1\n" + PITCH + "step = 5e-324\n" + LEAST, "variable.0 needs at most 1e+09 steps from low to high"),
    ("schema = 1\n" + PITCH + "step = 1e-9\n" + LEAST, "variable.0 needs at most 1e+09 steps from low to high"),
    ("schema = 1\n" + PITCH + "step = 0.5\nlog = true\n" + LEAST, "variable.0 may have step or log, not both"),
    ("schema = 1\n" + PITCH.replace("11", "0") + "log = true\n" + LEAST, "variable.0 needs low above 0"),
    ("schema = 1\n" + PITCH + PITCH + LEAST, "the goal names the entry array.pitch_mm in more than one variable"),
    (GOOD + LEAST, "the goal needs a different quantity in every objective"),
    ("schema = 1\n[[variable]]\nentry = 'a'\nchoices = [1]\n" + LEAST, "variable.0.choices must have at least 2"),
    ("schema = 1\n[[variable]]\nentry = 'a'\nchoices = [1, 1]\n" + LEAST, "variable.0 needs choices that differ"),
    ("schema = 1\n[[variable]]\nentry = 'a'\nchoices = [12, 12.0]\n" + LEAST, "variable.0 needs choices that differ"),
    ("schema = 1\n[[variable]]\nentry = 'a'\nchoices = [[1], [1.0]]\n" + LEAST, "needs choices that differ"),
    ("schema = 1\n[[variable]]\nentry = 'a'\nchoices = [1, 1979-05-27]\n" + LEAST, "choices that are numbers"),
    (GOOD.replace("rms_k", "rms_q"),
     "objective.0.quantity cannot be: there is no quantity 'rms_q'; did you mean rms_k?"),
    (GOOD.replace('"rms_k"', "7"), "objective.0.quantity cannot be: a quantity must be"),
    (GOOD.replace('"rms_k"', '"k"'), "objective.0.quantity cannot be: k needs the"),
    (GOOD + "target = 1\n", "objective.0 needs exactly one of direction"),
    (GOOD.replace("minimize", "least"), "direction must be 'minimize' or 'maximize'"),
    (GOOD + "[[constraint]]\nquantity = 'q'", "constraint.0 needs at_least, at_most"),
    (GOOD + "[[constraint]]\nquantity = 'q'\nat_least = 2\nat_most = 1",
     "constraint.0 needs at_least up to at_most; got 2 and 1"),
    (GOOD + "[search]\ntrials = 0", "search.trials must be at least 1; got 0"),
    (GOOD + "[search]\nseed = -1", "search.seed must be at least 0; got -1"),
    (GOOD + "[search]\nsampler = 'best'", "search.sampler must be 'tpe', 'nsga2'"),
    ("schema = ", "goal: not valid TOML"), ("schema = 1\nx = " + "[" * 5000, "goal: not valid TOML"),
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
    ('entry = "coils.octagon.turns_per_layer"\nlow = 1\nhigh = 2', "variable.0.low: coils.octagon"),
    ('entry = "stackup.dielectric_thickness_mm.7"\nlow = 1\nhigh = 2', "must have a number from 0 to 2"),
    ('entry = "array.lattice"\nlow = 1\nhigh = 2', "variable.0.low: array.lattice must be 'single', 'linear'"),
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
