"""Points: the numbers of the quantities whatever the pool, each design computed once, interrupted runs that go on."""

import dataclasses
import itertools
from concurrent.futures import Executor, Future

import numpy as np
import pytest

from coilarray import load_design
from coilarray.compute.store import open_store
from coilarray.compute.workers import open_executor
from coilarray.design.vary import vary
from coilarray.studies.quantities import evaluate
from coilarray.studies.sweep import evaluate_points

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
@pytest.mark.parametrize("accuracy", ["full", "screen"])
def test_two_processes_compute_the_same_bits_as_this_one(accuracy):
    design = load_design("gast2020")
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
