"""Sweeps: which points, which numbers at which place, each computed once, and every mistake before the work."""

import dataclasses
import itertools
import json
import math
from concurrent.futures import Executor, Future

import numpy as np
import pytest
from support.contacts import few_turns

from coilarray import Design, load_design, sweep
from coilarray.compute.store import open_store
from coilarray.compute.workers import open_executor
from coilarray.design.model import parse_design
from coilarray.design.vary import vary
from coilarray.errors import DesignError, GoalError
from coilarray.studies.quantities import evaluate
from coilarray.studies.sweep import MOST_POINTS, Axis, evaluate_points, parse_axis, plan_sweep, run_sweep

PITCH_MM = 11.0  # of the starter
PITCH, COLUMNS, LAYERS = "array.pitch_mm", "array.columns", "array.layers"


def swept(design, axes, quantities=("span_mm",), **options):
    with open_executor() as pool:
        return run_sweep(plan_sweep(design, axes, quantities, **options), pool)


@pytest.mark.parametrize(("text", "key", "values"), [
    ("array.pitch_mm=10:15:3", PITCH, (10.0, 12.5, 15.0)), ("array.pitch_mm=15:10:3", PITCH, (15.0, 12.5, 10.0)),
    ("array.pitch_mm = 0.1:0.4:4", PITCH, (0.1, 0.2, 0.3, 0.4)),  # not 0.30000000000000004
    ("array.pitch_mm=-1e-3:1e-3:3", PITCH, (-1e-3, 0.0, 1e-3)), ("array.pitch_mm=12", PITCH, (12,)),
    ("array.pitch_mm=12, 13.5", PITCH, (12, 13.5)),
    ("circuit.terminations.coil2=short,open", "circuit.terminations.coil2", ("short", "open")),
    ('circuit.tank="coil", "converter"', "circuit.tank", ("coil", "converter")),
    ("board.through_holes=true,false", "board.through_holes", (True, False)),
    ('array.layers=[["L1"],["L2"]],[["L1","L2"]]', LAYERS, ([["L1"], ["L2"]], [["L1", "L2"]])),
    ("title=2020-01-01,12:30:00", "title", ("2020-01-01", "12:30:00")),  # a design file has neither
    ("title=a=b", "title", ("a=b",)),
])  # fmt: skip
def test_an_axis_is_read_from_text(text, key, values):
    assert parse_axis("array.pitch_mm=10:15") == Axis(PITCH, (10.0, 15.0), interval=True)  # for samples
    axis = parse_axis(text)
    assert (axis.key, axis.values, axis.interval) == (key, values, False)
    assert [type(value) for value in axis.values] == [type(value) for value in values]


@pytest.mark.parametrize(("text", "message"), [
    ("array.pitch_mm", "--vary must be KEY=START:STOP:COUNT or KEY=A,B,…; got 'array.pitch_mm'"),
    ("a=1:x:3", "a must be a range of numbers, START:STOP:COUNT; got '1:x:3'"),
    ("a=1:2:1", f"a must have a range of 2 to {MOST_POINTS} different values; got '1:2:1'"),
    ("a=1e308:-1e308:3", "a must have a range of finite length; got '1e308:-1e308:3'"),
    ("a=1,nan", "a must have finite values; got nan"), ("a=1,2,1", "a must have each value once; got 1 again"),
    ("a=5:1", "a must have an interval from low to high; got 5.0, 1.0"), ("a=1:nan", "a must have finite values"),
    ("=1,2", "--vary must be KEY="), ("", "--vary must be KEY="), ("a=", "a must have at least one value"),
    ("a=1:inf:5", "a must have a range of 2"), ("a=1:2:100001", "a must have a range of 2"),
])  # fmt: skip
def test_what_is_no_axis_is_refused(text, message):
    with pytest.raises(GoalError) as caught:
        parse_axis(text)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_a_grid_has_every_number_at_its_place(starter):
    asked = ["board_area_mm2", "span_mm"]
    result = swept(starter, [Axis(PITCH, (16.0, 12.0)), Axis(COLUMNS, (3, 2))], asked)
    assert dict(result.sizes) == {PITCH: 2, COLUMNS: 2}
    for pitch in (12.0, 16.0):
        for columns in (2, 3):
            place = {PITCH: pitch, COLUMNS: columns}
            there = result.sel(place)
            assert {name: there[name].item() for name in asked} == evaluate(vary(starter, place), asked)
            # the outline of a row of equal coils grows by a pitch a coil
            expected = evaluate(vary(starter, {COLUMNS: 2}), ["span_mm"])["span_mm"] - PITCH_MM
            assert there.span_mm.item() == pytest.approx(expected + pitch * (columns - 1), rel=1e-12)
    assert set(result.reason.values.ravel().tolist()) == {""}


@pytest.mark.parametrize(("key", "values", "unit"), [
    ("circuit.capacitance_pF", (100, 200), "pF"), ("circuit.resistivity_ohm_m", (1.7e-8, 1.8e-8), "ohm m"),
    ("circuit.short_resistance_ohm", (1, 5), "ohm"), ("array.direction_deg", (0, 30), "deg"),
    ("coils.hexagon.via.plating_um", (20, 25), "µm"), ("indentation.seat_stiffness_kPa_per_mm", (4, 5), "kPa/mm"),
])  # fmt: skip
def test_units_are_those_of_the_keys(key, values, unit):
    seat = {"indentation.base": "seat", "indentation.seat_stiffness_kPa_per_mm": 4.3}
    design = vary(load_design("gast2020"), seat)
    result = swept(design, [Axis(key, values)], ["board_area_mm2"])
    assert result[key].attrs.get("units") == unit
    assert result.reason.values.tolist() == [""] * len(values)


def test_what_is_no_number_is_a_text(starter):
    axis = parse_axis('array.layers=[["L1","L2"]],[["L1","L2"],["L3","L4"]]')
    result = swept(load_design("gast2020"), [axis, Axis(COLUMNS, (2, 3))])
    assert result[LAYERS].values.tolist() == ['[["L1", "L2"]]', '[["L1", "L2"], ["L3", "L4"]]']
    assert json.loads(result[LAYERS].attrs["design_value"]) == [["L3", "L4"], ["L1", "L2"]]
    mixed = swept(starter, [Axis("board.through_holes", (True, False))])
    assert mixed["board.through_holes"].values.tolist() == ["true", "false"]


def test_a_point_that_cannot_be_is_empty_with_its_reason(starter):
    result = swept(starter, [Axis(PITCH, (12.0, -1.0)), Axis(COLUMNS, (2, 3))])
    assert np.isnan(result.span_mm.sel({PITCH: -1.0})).all()
    assert np.isfinite(result.span_mm.sel({PITCH: 12.0})).all()
    problem = "starter: array.pitch_mm must be greater than 0; got -1."
    assert result.reason.sel({PITCH: [12.0, -1.0]}).values.tolist() == [["", ""], [problem, problem]]


def test_samples_lie_in_their_axes_and_cover_them(starter):
    tank = Axis("circuit.tank", ("coil", "converter", "neither"))
    axes = [Axis(PITCH, (10.0, 20.0), interval=True), Axis(COLUMNS, (2, 5), interval=True), tank]
    plan = plan_sweep(starter, axes, ["span_mm"], samples=64, seed=3)
    assert (len(plan.points), plan.sampling) == (64, "64 points of a Sobol sequence, seed 3")
    pitch = np.sort([point[PITCH] for point in plan.points])
    # a power of two of a Sobol sequence has one point in each of as many equal parts of every axis
    np.testing.assert_array_equal(np.floor((pitch - 10) / 10 * 64), np.arange(64))
    columns = [point[COLUMNS] for point in plan.points]
    assert {type(value) for value in columns} == {int}
    assert [columns.count(k) for k in (2, 3, 4, 5)] == [16] * 4
    tanks = [point["circuit.tank"] for point in plan.points]
    assert sorted(tanks.count(name) for name in tank.values) == [21, 21, 22]


def test_samples_depend_on_the_seed_and_more_begin_with_the_same(starter):
    axes = [Axis(PITCH, (10.0, 20.0), interval=True), Axis("field.height_mm", (1.0, 9.0), interval=True)]

    def points(count, seed):
        return plan_sweep(starter, axes, ["span_mm"], samples=count, seed=seed).points

    assert points(5, 1) == points(5, 1)
    assert points(5, 1) == points(100, 1)[:5]
    assert points(5, 1) != points(5, 2)
    assert len(points(1, 1)) == 1


GOOD, GOOD_TOO = Axis(PITCH, (12, 13)), Axis(COLUMNS, (2, 3))
NO_DESIGN = "no point of the sweep gives a design; the first one: starter: "
MANY = [Axis(PITCH, tuple(range(1, 1001))), Axis(COLUMNS, tuple(range(1, 102)))]
BETWEEN = Axis(COLUMNS, (2.2, 2.8), interval=True)
NO_COIL = "no design of the sweep has a coil"


@pytest.mark.parametrize(("axes", "quantity", "options", "message"), [
    ([], "span_mm", {}, "a sweep must have at least one entry to vary."),
    ([GOOD], None, {}, "a sweep must have at least one quantity or goal."),
    ([GOOD, GOOD], "span_mm", {}, "a sweep must vary each entry once; got array.pitch_mm, array.pitch_mm."),
    ([GOOD], "k[coil1,coil9]", {}, f"k[coil1,coil9]: {NO_COIL} 'coil9'; there are coil1,"),
    ([Axis("array.pich_mm", (1, 2))], "span_mm", {}, f"{NO_DESIGN}array has no key 'pich_mm'; did you mean"),
    ([Axis(PITCH, ("wide",)), GOOD_TOO], "span_mm", {}, f"{NO_DESIGN}array.pitch_mm must be a number; got 'wide'."),
    ([Axis("name", ("a", "b"))], "span_mm", {}, f"{NO_DESIGN}name cannot be varied: it names the design"),
    ([GOOD], "span", {}, "there is no quantity 'span'; did you mean span_mm?"),
    ([GOOD], "span_mm", {"samples": 100_001}, "a sweep must have 1 to 100000 points; got 100001."),
    (MANY, "span_mm", {}, "a sweep must have 1 to 100000 points; got 101000."),
    ([BETWEEN], "span_mm", {}, "array.columns takes whole numbers; there is none from 2.2 to 2.8."),
    ([GOOD], "span_mm", {"samples": 0}, "a sweep must have 1 to 100000 points; got 0."),
    ([GOOD], "span_mm", {"samples": 3, "seed": -1}, "the seed must not be negative; got -1."),
    ([BETWEEN], "span_mm", {"samples": 3}, "array.columns takes whole numbers; there is none from 2.2 to 2.8."),
])  # fmt: skip
def test_a_wrong_sweep_is_refused_before_the_work(starter, axes, quantity, options, message):
    with pytest.raises(GoalError) as caught:
        plan_sweep(starter, axes, [] if quantity is None else [quantity], **options)
    assert str(caught.value).startswith(message)
    assert len(str(caught.value).splitlines()) == 1


def test_a_coil_that_only_some_designs_have_is_allowed(starter):
    result = swept(starter, [Axis(COLUMNS, (2, 3))], ["inductance_uH[coil3]"], accuracy="screen")
    few, enough = result["inductance_uH[coil3]"].values.tolist()
    assert math.isnan(few)
    assert enough > 0
    assert result.reason.values[0] == "the design starter has no coil 'coil3'; there are coil1, coil2."


def test_an_array_is_swept_as_a_design_of_it():
    array = load_design("starter").array
    found, expected = (sweep(each, {"array.pitch_mm": [12, 14]}, ["span_mm"]) for each in (array, Design(array)))
    assert found.span_mm.values.tolist() == expected.span_mm.values.tolist()
    with pytest.raises(DesignError, match="Array"):
        sweep("starter", {"array.pitch_mm": [12]}, ["span_mm"])


QUANTITIES = ["span_mm", "board_area_mm2"]  # shapes alone: 20 ms a point


@pytest.fixture
def cache(tmp_path):
    return open_store(tmp_path)


def pitches(*millimetres):
    return [{"array.pitch_mm": pitch} for pitch in millimetres]


def run(design, changes, quantities=QUANTITIES, cache=None, **options):
    """Outcomes in the order of the points."""
    with open_executor() as pool:
        found = dict(evaluate_points(design, changes, quantities, pool, cache, **options))
    return [found[k] for k in range(len(found))]


class Counting(Executor):
    """An executor of a user, which counts its tasks."""

    _max_workers = 1

    def __init__(self):
        self.computed = 0

    def submit(self, function, /, *arguments):
        self.computed += 1
        future = Future()
        future.set_result(function(*arguments))
        return future


class Wide(Counting):
    """An executor with room for many tasks, of which none is done before the last is there."""

    _max_workers = 8

    def __init__(self, tasks):
        super().__init__()
        self.tasks, self.waiting = tasks, []

    def submit(self, function, /, *arguments):
        self.computed += 1
        future = Future()
        self.waiting.append((future, function, arguments))
        if len(self.waiting) == self.tasks:
            for future, function, arguments in reversed(self.waiting):
                future.set_result(function(*arguments))
        return self.waiting[-1][0]


def test_outcomes_are_the_quantities_of_each_variation(starter):
    changes = [*pitches(12, 13.5, 17), {}]
    assert run(starter, changes) == [evaluate(vary(starter, change), QUANTITIES) for change in changes]


@pytest.mark.slow
def test_two_processes_compute_the_same_bits_as_this_one():
    design, accuracy = parse_design(few_turns("gast2020")), "screen"
    changes = [{"array.columns": 2, "array.pitch_mm": pitch} for pitch in (11.0, 13.28, 15.5)]
    asked = ["worst_k", {"quantity": "inductance_uH", "coil": "coil1"}]
    here = run(design, changes, asked, accuracy=accuracy)
    with open_executor(2) as pool:
        there = dict(evaluate_points(design, changes, asked, pool, accuracy=accuracy))
    assert [there[k] for k in range(3)] == here
    assert list(here[0]) == ["worst_k", "inductance_uH[coil1]"]  # canonical names, in their order
    assert here == [evaluate(vary(design, change), asked, accuracy=accuracy) for change in changes]


def test_what_cannot_be_has_its_reason(starter):
    changes = [*pitches(12, -1.0, "wide"), {"array.pich_mm": 12}, {"coils.nothing.turns_per_layer": 3}]
    good, negative, text, unknown, no_coil = run(starter, changes)
    assert good.keys() == set(QUANTITIES)
    assert negative == "starter: array.pitch_mm must be greater than 0; got -1."
    assert "did you mean pitch_mm" in unknown
    assert no_coil.startswith("starter: coils.nothing.turns_per_layer names no coil shape")
    assert "array.pitch_mm must be a number" in text
    (alone,) = run(load_design("gast_fem"), [{}], ["worst_k"])  # a quantity that the design does not have
    assert alone == "the design gast_fem has only one coil, and so no coupling."


def test_no_point_is_computed_twice(starter, cache):
    changes = pitches(12, 13, 14)
    first, second, other = Counting(), Counting(), Counting()
    expected = dict(evaluate_points(starter, changes, QUANTITIES, first, cache))
    assert first.computed == 3
    # in another order and with another one
    again = dict(evaluate_points(starter, pitches(14, 15, 13), QUANTITIES, second, cache))
    assert second.computed == 1
    assert (again[0], again[2]) == (expected[2], expected[1])
    # the same board from a file that says so, under another title, its numbers set by numpy
    near = dataclasses.replace(vary(starter, {"array.pitch_mm": 13}), title="Mine")
    points = [{}, *pitches(np.float64(14.0))]
    (_, same), (_, shifted) = evaluate_points(near, points, QUANTITIES, other, cache)
    assert other.computed == 0
    assert (same, shifted) == (expected[1], expected[2])


def test_everything_that_decides_an_outcome_is_in_its_key(starter, cache, monkeypatch):
    pool = Counting()

    def computed(design=starter, changes=({},), quantities=QUANTITIES, **options):
        before = pool.computed
        list(evaluate_points(design, changes, quantities, pool, cache, **options))
        return pool.computed - before

    assert computed() == 1
    assert computed() == 0
    assert computed(quantities=["span_mm"]) == 1
    assert computed(accuracy="screen") == 1
    assert computed(changes=pitches(15)) == 1
    assert computed(design=load_design("gast_fem")) == 1
    assert computed() == 0
    monkeypatch.setattr("coilarray.compute.store.code_version", lambda: "9.9.9+0")
    assert computed() == 1


def test_an_interrupted_run_goes_on(starter, cache):
    changes = pitches(*range(12, 20))
    first, second = Counting(), Counting()
    done = [outcome for _, outcome in itertools.islice(evaluate_points(starter, changes, QUANTITIES, first, cache), 3)]
    assert 3 <= first.computed <= 4
    found = dict(evaluate_points(starter, changes, QUANTITIES, second, cache))
    assert 4 <= second.computed <= 5
    assert [found[k] for k in range(3)] == done


@pytest.mark.parametrize("text", [
    "{", "null", "[]", '{"values": [1.0]}', '{"values": {"a": "1"}}', '{"values": {"a": true}}', '{"values": {"a": 1}}',
    '{"reason": 3}', '{"other": {}}',
])  # fmt: skip
def test_an_unreadable_entry_is_computed_again(starter, cache, text):
    pool, asked = Counting(), (starter, pitches(12, 13), QUANTITIES)
    expected = list(evaluate_points(*asked, pool, cache))
    for path in cache.folder.rglob("*.json"):
        path.write_text(text, encoding="utf-8")
    for _ in range(2):
        assert list(evaluate_points(*asked, pool, cache)) == expected
        assert pool.computed == 4


@pytest.mark.parametrize("kept", [False, True])
def test_equal_points_in_flight_are_computed_once(starter, cache, kept):
    pool, told, changes = Wide(2), [], pitches(12, 13, 12, 12.0, 13)
    options = {"cache": cache if kept else None, "progress": lambda *now: told.append(now)}
    found = list(evaluate_points(starter, changes, QUANTITIES, pool, **options))
    values = dict(found)
    assert (pool.computed, len(found)) == (2, 5)
    assert values[0] == values[2] == values[3] != values[1] == values[4]
    assert told == [(k, 5) for k in range(1, 6)]
