"""The local solver: it finds minima that are known, keeps bounds, and goes on where it was stopped."""

import math
from contextlib import suppress
from functools import partial

import pytest
from support.optimize_points import StandIn

from coilarray.studies.optimize import optimize_with, parse_goal
from coilarray.studies.optimize.goal import Axis

pytestmark = pytest.mark.slow

GOAL = """
schema = 1
variable = [
  {{ entry = "array.pitch_mm", low = 10, high = 16 }},
  {{ entry = "elastomer.0.thickness_mm", low = 2, high = {high}, log = true }},
  {{ entry = "array.columns", low = 5, high = 6 }},
]
{wanted}
[search]
trials = {trials}
polish = {polish}
"""
LEAST = '[[objective]]\nquantity = "worst_k"\ndirection = "minimize"\n'


def goal_of(wanted=LEAST, polish=60, high=20, trials=12, text=GOAL):
    return parse_goal(text.format(wanted=wanted, polish=polish, high=high, trials=trials))


def bowl_at(change):
    """A bowl around (12.3, 5.0) that no grid point of the box hits, its floor lower for 6 columns."""
    pitch, base = change.get("array.pitch_mm", 13.28), change.get("elastomer.0.thickness_mm", 6.0)
    bowl = (pitch - 12.3) ** 2 + 0.3 * (base - 5.0) ** 2 + (5.0 if change.get("array.columns", 6) == 5 else 0.2)
    # a root at pitch 12.7, flat there in no direction
    return {"worst_k": bowl, "q": -bowl, "span_mm": pitch, "rms_k": pitch + 0.1 * (base - 6) - 12.7}


Bowl = partial(StandIn, bowl_at)


def polished(result):
    return [trial for trial in result.trials if trial.kind == "polish"]


def test_the_bottom_of_a_bowl(design, tmp_path):
    result = optimize_with(design, goal_of(), tmp_path, Bowl())
    assert result.best.kind == "polish"
    assert result.best.changes["array.columns"] == 6
    # quadratic models of a quadratic: to the square root of the rounding of a value of 0.2
    assert result.best.changes["array.pitch_mm"] == pytest.approx(12.3, abs=1e-4)
    assert result.best.changes["elastomer.0.thickness_mm"] == pytest.approx(5.0, abs=1e-3)
    assert {trial.changes["array.columns"] for trial in polished(result)} == {6}  # a whole number stays
    assert len(polished(result)) <= 60
    largest = LEAST.replace("worst_k", "q").replace("minimize", "maximize")
    mirrored = optimize_with(design, goal_of(largest), tmp_path, Bowl())
    assert mirrored.best.changes["array.pitch_mm"] == pytest.approx(12.3, abs=1e-4)


def test_bounds_of_the_box_and_constraints(design, tmp_path):
    wanted = LEAST + '[[constraint]]\nquantity = "span_mm"\nat_least = 13.0\n'
    result = optimize_with(design, goal_of(wanted, high=4), tmp_path, Bowl())
    assert not result.start_inside
    # the nearest point of the quadrant pitch ≥ 13, base ≤ 4 to the centre is its corner
    assert result.best.changes["array.pitch_mm"] == pytest.approx(13.0, abs=1e-5)
    assert result.best.changes["elastomer.0.thickness_mm"] == pytest.approx(4.0, rel=1e-6)
    assert result.best.quantities["span_mm"] >= 13.0
    assert all(2 <= trial.changes["elastomer.0.thickness_mm"] <= 4 for trial in polished(result))


def test_a_root(design, tmp_path):
    wanted = '[[objective]]\nquantity = "rms_k"\ntarget = 0.0\n'
    result = optimize_with(design, goal_of(wanted), tmp_path, Bowl())
    assert result.best.scores[0] < 1e-6  # of values of the order of 1 across the box
    assert result.best.quantities["rms_k"] == pytest.approx(0.0, abs=1e-6)


def test_stops_and_goes_on(design, tmp_path):
    whole = optimize_with(design, goal_of(polish=24), tmp_path / "a", Bowl())
    asked = 0
    for end in (17, 5, None):
        bowl = Bowl(end=end)
        with suppress(KeyboardInterrupt):
            resumed = optimize_with(design, goal_of(polish=24), tmp_path / "b", bowl)
        asked += len(bowl.asked) - 1  # the start each time
    assert [trial.changes for trial in resumed.trials] == [trial.changes for trial in whole.trials]
    count = len(polished(whole))
    assert 15 < count <= 24  # it ends where points would be closer than 1 µm
    assert asked == 11 + count  # nothing twice
    more = Bowl()
    longer = optimize_with(design, goal_of(polish=30), tmp_path / "b", more)
    assert polished(longer)[:count] == polished(whole)
    assert len(more.asked) == 1 + len(polished(longer)) - count


def test_the_best_never_gets_worse_with_more_points(design, tmp_path):
    """Two dips, the narrow one deeper: what the local solver found in it stays when the search ends up in the other."""

    def dips(change):
        pitch = change.get("array.pitch_mm", 13.28)
        return {"worst_k": 5 - 3 * math.exp(-(((pitch - 11) / 0.4) ** 2)) - 2 * math.exp(-((pitch - 15) ** 2))}

    variable = 'schema = 1\nvariable = [{ entry = "array.pitch_mm", low = 10, high = 16 }]\n'
    found = []
    for seed in (2, 4, 5):
        bests, counts = [], []
        for trials in (1, 2, 4, 8):
            search = f'[search]\ntrials = {trials}\nbatch = 1\npolish = 20\nsampler = "random"\nseed = {seed}\n'
            result = optimize_with(design, parse_goal(variable + LEAST + search), tmp_path, StandIn(dips))
            names = [trial.name for trial in result.trials]
            assert len(set(names)) == len(names) > result.found
            bests.append(result.best.scores[0])
            counts.append(len(polished(result)))
        assert bests == sorted(bests, reverse=True)
        found.append((result.best, counts[-2]))
    # at least once the best is from where an earlier run began
    assert any(best.kind == "polish" and best.place < before for best, before in found)


def test_every_point_can_be_made(design, tmp_path):
    """Lengths to 1 µm: what is written to best.toml is what was evaluated."""
    result = optimize_with(design, goal_of(polish=24), tmp_path, Bowl())
    for trial in result.trials:
        for entry in ("array.pitch_mm", "elastomer.0.thickness_mm"):
            assert trial.changes[entry] == round(trial.changes[entry], 3)
    # unless the bounds are as close as that, or are no such length
    closer = Axis("array.pitch_mm", low=13.0, high=13.005)
    assert closer.value(13.00312) == 13.00312
    assert Axis("array.pitch_mm", low=13.0004, high=14.0).value(13.00042) == 13.0004  # a bound is kept
    assert Axis("array.pitch_mm", high=1.0, start=0.1524).value(0.1524) == 0.1524  # and the design's own value
    assert Axis("array.direction_deg", high=360.0).value(0.123456) == 0.123456
