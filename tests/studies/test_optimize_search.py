"""The search and the local solver: they find what is known, try the same points however run, and lose nothing."""

import json
import math
import sys
import threading
from contextlib import suppress
from dataclasses import replace
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.optimize_points import StandIn
from support.patience import PATIENCE

from coilarray.errors import MissingDependencyError, OutputError
from coilarray.report.studies import none_better
from coilarray.studies.optimize import Trial, front_of, optimize_with, parse_goal
from coilarray.studies.optimize.goal import Axis, better_than
from coilarray.studies.optimize.run import FILE, read_studies, study_name

pytestmark = pytest.mark.slow

# quantities of the stand-in below, which computes them from the entries alone
GOAL = """
schema = 1
{watch}
variable = [
  {{ entry = "array.pitch_mm", low = 10, high = 16 }},
  {{ entry = "elastomer.0.thickness_mm", low = 2, high = 20, log = true }},
  {{ entry = "array.columns", low = 2, high = 9 }},
  {{ entry = "circuit.default_termination", choices = ["short", "open"] }},
]
{wanted}
[search]
trials = {trials}
sampler = "{sampler}"
seed = 3
batch = {batch}
population = 6
polish = 0
"""
LEAST = '[[objective]]\nquantity = "worst_k"\ndirection = "minimize"\n'
MOST = '[[objective]]\nquantity = "span_mm"\ndirection = "maximize"\n'
BOUND = '[[constraint]]\nquantity = "rms_k"\nat_most = 1.0\n'


def goal_of(wanted=LEAST, sampler="tpe", trials=20, batch=4, watch="", replaced=("", "")):
    text = GOAL.format(wanted=wanted, sampler=sampler, trials=trials, batch=batch, watch=watch)
    return parse_goal(text.replace(*replaced))


TERMINATION = "circuit.default_termination"
START = {"array.pitch_mm": 13.28, "elastomer.0.thickness_mm": 6.0, "array.columns": 6, TERMINATION: "short"}


def quantities(changes):
    """Outcome of one point: bowls around a pitch of 12.5 with 6 columns, and none beyond 15 mm."""
    pitch, base, columns, termination = {**START, **changes}.values()
    if pitch > 15:
        return "the coils do not touch."
    bowl = (pitch - 12.5) ** 2 + 0.05 * (base - 8) ** 2 + 0.3 * (columns - 6) ** 2
    others = {"span_mm": pitch * columns, "rms_k": base / 12, "board_area_mm2": columns * base}
    return {"worst_k": bowl + 0.5 * (termination == "open"), **others}


Points = partial(StandIn, quantities)


def points_of(result):
    return [(trial.place, dict(trial.changes), trial.scores, trial.reason) for trial in result.trials]


def test_finds_the_least(design, tmp_path):
    goal = goal_of(trials=80, batch=8)
    seen = []
    result = optimize_with(design, goal, tmp_path, Points(), progress=lambda *now: seen.append(now))
    assert result.best.changes["array.columns"] == 6
    assert result.best.changes[TERMINATION] == "short"
    # the bowl's floor is 0, the start is at 1.6; 80 points in four variables come within a tenth of that
    assert result.best.scores[0] < 0.16 < result.start.scores[0]
    assert result.front == (result.best,)
    assert [done for done, _, _ in seen] == list(range(1, 81))
    assert {total for _, total, _ in seen} == {80}
    bests = [best.scores[0] for _, _, best in seen if best is not None]
    assert bests == sorted(bests, reverse=True)
    assert bests[-1] == result.best.scores[0]


def test_start_comes_first_where_it_lies_inside(design, tmp_path):
    points = Points()
    result = optimize_with(design, goal_of(trials=4), tmp_path, points)
    assert result.start_inside
    first = result.trials[0]
    assert first.changes == START
    assert first.quantities == result.start.quantities
    assert len(points.asked) == 4  # the start once, for both
    other = optimize_with(design, goal_of(trials=4, replaced=("high = 16", "high = 13")), tmp_path, Points())
    assert not other.start_inside
    assert other.start.changes == {}
    assert all(trial.changes["array.pitch_mm"] <= 13 for trial in other.trials)
    for points, inside in zip(read_studies(tmp_path).values(), (True, False), strict=True):
        assert [point["place"] for point in points if point["start"]] == [0] * inside


@pytest.mark.parametrize(("sampler", "wanted"), [
    ("tpe", LEAST + BOUND), ("nsga2", LEAST + MOST + BOUND), ("random", LEAST),
])  # fmt: skip
def test_same_points_however_it_is_run(design, tmp_path, sampler, wanted):
    goal = goal_of(wanted, sampler, trials=18)
    whole = optimize_with(design, goal, tmp_path / "whole", Points())
    different = [len({json.dumps(trial.changes) for trial in whole.trials[:k]}) for k in (14, 18)]
    assert different[1] > 14  # not one point again and again
    backwards = optimize_with(design, goal, tmp_path / "backwards", Points(order=reversed))
    assert points_of(backwards) == points_of(whole)
    # stopped in the middle of a batch, its last points first, and again, and fewer points than in the end at first
    asked = 0
    for end, trials in ((6, 18), (4, 18), (None, 14), (None, 18)):
        part = Points(order=reversed, end=end)
        with suppress(KeyboardInterrupt):
            resumed = optimize_with(design, goal_of(wanted, sampler, trials=trials), tmp_path / "parts", part)
        asked += len(part.asked) - 1  # the start each time
        with suppress(OSError), (tmp_path / "parts" / FILE).open("a") as file:
            file.write('{"study": "gast2020-')  # a kill while a line is written
    assert points_of(resumed) == points_of(whole)
    assert resumed.found == different[0]
    assert asked == different[1] - 1  # the first being the start: nothing twice


def test_bounds_and_impossible_points(design, tmp_path):
    goal = goal_of(LEAST + '[[constraint]]\nquantity = "span_mm"\nat_least = 90\n', trials=64, batch=8)
    result = optimize_with(design, goal, tmp_path, Points())
    impossible = [trial for trial in result.trials if trial.reason]
    assert impossible
    for t in impossible:
        assert t.changes["array.pitch_mm"] > 15
        assert (t.reason, t.quantities, t.scores, t.feasible) == ("the coils do not touch.", {}, (), False)
    # least at pitch 15 with 6 columns is 6.25, at 7 columns with a pitch of 12.86 it is 0.3 + 0.13
    assert result.best.changes["array.columns"] == 7
    assert result.best.quantities["span_mm"] >= 90
    best = min(t.scores[0] for t in result.trials if t.scores and t.quantities["span_mm"] >= 90)
    assert result.best.scores[0] == best < 1.0


def test_a_best_that_is_no_better_than_the_start(design, tmp_path):
    """The start is the bottom of the bowl: nothing is chosen, whether or not the variables could give it."""

    def bowl(changes):
        pitch = changes.get("array.pitch_mm", 13.28)
        return {**quantities({}), "worst_k": 1.0 + (pitch - 13.28) ** 2}

    near = LEAST.replace('direction = "minimize"', "target = 0.5")
    for high, inside, wanted, words in (
        (16, True, LEAST, "worst_k is 1 for the given design, and {:.6g}"),
        (13, False, LEAST, "worst_k is 1 for the given design, and {:.6g}"),
        (16, True, near, "worst_k is 1 for the given design, 0.5 from its target, and {:.6g} from it"),
    ):
        goal = goal_of(wanted, trials=8, replaced=("high = 16", f"high = {high}"))
        result = optimize_with(design, goal, tmp_path, StandIn(bowl))
        assert (result.start_inside, result.best, result.front) == (inside, None, ())
        assert all(trial.feasible for trial in result.trials)
        tried = [trial.scores[0] for trial in result.trials if trial.changes != START]
        assert len(tried) == 8 - inside
        assert none_better(result).endswith(f": {words.format(min(tried))} at best in the search")
    # noise of the last bits is no gain, a start that breaks a bound is no rival
    start, goal = Trial("start", 0, {}, {}, (1.0,), {"bound": 0.0}), goal_of()
    noise, gain = (Trial("search", k, {}, {}, (score,), {"bound": 0.0}) for k, score in enumerate((1 - 1e-12, 0.9)))
    assert better_than(start, [noise], goal) == ()
    assert better_than(start, [noise, gain], goal) == (gain,)
    assert better_than(replace(start, scores=(0.5,), violations={"bound": 1.0}), [noise], goal) == (noise,)


def test_two_objectives(design, tmp_path):
    result = optimize_with(design, goal_of(LEAST + MOST, "nsga2", trials=64, batch=8), tmp_path, Points())
    assert result.best is None
    assert "several objectives" in result.polish_problem
    scores = [trial.scores for trial in result.front]
    assert len(scores) >= 3
    assert scores == sorted(scores)
    assert [span for _, span in scores] == sorted(span for _, span in scores)  # more of one costs of the other
    small, large = result.start.scores
    assert all(bowl < small or span > large for bowl, span in scores)  # nothing that the start beats
    assert max(score[1] for score in scores) > 1.3 * result.start.scores[1]
    for design_of, trial in zip(result.designs(), result.front, strict=True):
        assert len(design_of.array.names) == trial.changes["array.columns"]


def test_more_may_be_watched_later(design, tmp_path):
    first = optimize_with(design, goal_of(trials=24), tmp_path, Points())
    points = Points()
    again = optimize_with(design, goal_of(trials=24, watch='watch = ["board_area_mm2"]'), tmp_path, points)
    assert points_of(again) == points_of(first)
    assert len(points.asked) == 2  # the start and the best
    assert again.best.quantities["board_area_mm2"] == quantities(again.best.changes)["board_area_mm2"]
    assert "board_area_mm2" in again.start.quantities


def test_screened_points_are_confirmed(design, tmp_path):
    """Screening makes scores a little too good here: what is found by it is computed again, until the front is true."""
    asked = []

    def screened(changes, accuracy):
        for index, change in enumerate(changes):
            asked.append((accuracy, change))
            outcome = quantities(change)
            if accuracy == "screen" and isinstance(outcome, dict):
                outcome = {**outcome, "worst_k": 0.9 * outcome["worst_k"], "span_mm": outcome["span_mm"] + 4.0}
            yield index, outcome

    wanted = LEAST + '[[constraint]]\nquantity = "span_mm"\nat_least = 76\n'
    goal = goal_of(wanted, trials=40, batch=8, replaced=("polish = 0", 'polish = 0\naccuracy = "screen"'))
    result = optimize_with(design, goal, tmp_path, screened)
    assert {trial.accuracy for trial in result.trials} == {"screen", "full"}
    assert {trial.accuracy for trial in result.front} == {result.start.accuracy} == {"full"}
    assert asked[0] == ("full", {})
    assert [accuracy for accuracy, _ in asked[1:41]] == ["screen"] * 40  # the start again, to be like the others
    again = asked[41:]
    assert {accuracy for accuracy, _ in again} == {"full"}
    for trial, changes in ((result.start, {}), (result.best, result.best.changes)):
        assert trial.quantities == {key: quantities(changes)[key] for key in goal.quantities}
    assert result.best.quantities["span_mm"] >= 76
    assert result.best.changes in [changes for _, changes in again]
    assert len(again) > 1  # the best by screening was none
    assert not any(t.feasible for t in result.trials if t.scores and t.scores[0] < result.best.scores[0])


def test_points_in_the_file(design, tmp_path):
    goal = goal_of(LEAST + BOUND, trials=20)
    result = optimize_with(design, goal, tmp_path, Points())
    assert len(read_studies(tmp_path)[study_name(design, goal)]) == 20
    assert read_studies(tmp_path / "none") == {}
    assert not (tmp_path / "none").exists()
    ((name, points),) = read_studies(tmp_path).items()
    assert name == study_name(design, goal)
    for trial, point in zip(result.trials, sorted(points, key=lambda point: point["place"]), strict=True):
        assert point["objectives"][0]["quantity"] == "worst_k"
        assert (point["changes"], point["quantities"]) == (trial.changes, trial.quantities)
        assert (point["violations"], point["reason"]) == (trial.violations, trial.reason)
    # fewer points: those of the earlier run stay
    again = Points()
    assert (
        points_of(optimize_with(design, goal_of(LEAST + BOUND, trials=8), tmp_path, again))[:8] == points_of(result)[:8]
    )
    assert len(again.asked) == 1


def test_one_search_at_a_time_in_a_folder(design, tmp_path):
    goal = goal_of(trials=3)
    inside, leave = threading.Event(), threading.Event()

    def slow(changes, accuracy):
        inside.set()
        assert leave.wait(PATIENCE)
        yield from Points()(changes)

    running = threading.Thread(target=optimize_with, args=(design, goal, tmp_path, slow))
    running.start()
    assert inside.wait(PATIENCE)
    try:
        with pytest.raises(OutputError, match="another search is running in"):
            optimize_with(design, goal, tmp_path, Points())
    finally:
        leave.set()
        running.join()
    assert optimize_with(design, goal, tmp_path, Points()).found == 3


@pytest.mark.parametrize("name", [FILE, "points.lock"])
def test_files_that_are_none_of_ours(design, tmp_path, name):
    (tmp_path / name).write_text("no points, " * 100)
    with pytest.raises(OutputError, match=f"cannot (use|write) .*{name}"):
        optimize_with(design, goal_of(), tmp_path, Points())


def test_missing_optuna(design, tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(MissingDependencyError, match=r"need Optuna, which is not installed: .*\[optimize\]"):
        optimize_with(design, goal_of(), tmp_path, Points())


SCORES = st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4), st.booleans()), max_size=12)


@given(SCORES)
def test_front_is_what_no_other_point_beats(points):
    trials = [
        Trial("search", k, {}, {}, (float(a), float(b)), {"bound": 0.0 if kept else 1.0})
        for k, (a, b, kept) in enumerate(points)
    ]
    kept = [trial for trial in trials if trial.feasible]

    def beats(one, other):  # small first score, large second
        (a, b), (c, d) = one.scores, other.scores
        return a <= c and b >= d and (a, b) != (c, d)

    expected = {trial.scores for trial in kept if not any(beats(other, trial) for other in kept)}
    assert [trial.scores for trial in front_of(trials, goal_of(LEAST + MOST))] == sorted(expected)


BOX = """
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


def box_of(wanted=LEAST, polish=60, high=20, trials=12, text=BOX):
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
    result = optimize_with(design, box_of(), tmp_path, Bowl())
    assert result.best.kind == "polish"
    assert result.best.changes["array.columns"] == 6
    # quadratic models of a quadratic: to the square root of the rounding of a value of 0.2
    assert result.best.changes["array.pitch_mm"] == pytest.approx(12.3, abs=1e-4)
    assert result.best.changes["elastomer.0.thickness_mm"] == pytest.approx(5.0, abs=1e-3)
    assert {trial.changes["array.columns"] for trial in polished(result)} == {6}  # a whole number stays
    assert len(polished(result)) <= 60
    largest = LEAST.replace("worst_k", "q").replace("minimize", "maximize")
    mirrored = optimize_with(design, box_of(largest), tmp_path, Bowl())
    assert mirrored.best.changes["array.pitch_mm"] == pytest.approx(12.3, abs=1e-4)


def test_bounds_of_the_box_and_constraints(design, tmp_path):
    wanted = LEAST + '[[constraint]]\nquantity = "span_mm"\nat_least = 13.0\n'
    result = optimize_with(design, box_of(wanted, high=4), tmp_path, Bowl())
    assert not result.start_inside
    # the nearest point of the quadrant pitch ≥ 13, base ≤ 4 to the centre is its corner
    assert result.best.changes["array.pitch_mm"] == pytest.approx(13.0, abs=1e-5)
    assert result.best.changes["elastomer.0.thickness_mm"] == pytest.approx(4.0, rel=1e-6)
    assert result.best.quantities["span_mm"] >= 13.0
    assert all(2 <= trial.changes["elastomer.0.thickness_mm"] <= 4 for trial in polished(result))


def test_a_root(design, tmp_path):
    wanted = '[[objective]]\nquantity = "rms_k"\ntarget = 0.0\n'
    result = optimize_with(design, box_of(wanted), tmp_path, Bowl())
    assert result.best.scores[0] < 1e-6  # of values of the order of 1 across the box
    assert result.best.quantities["rms_k"] == pytest.approx(0.0, abs=1e-6)


def test_stops_and_goes_on(design, tmp_path):
    whole = optimize_with(design, box_of(polish=24), tmp_path / "a", Bowl())
    asked = 0
    for end in (17, 5, None):
        bowl = Bowl(end=end)
        with suppress(KeyboardInterrupt):
            resumed = optimize_with(design, box_of(polish=24), tmp_path / "b", bowl)
        asked += len(bowl.asked) - 1  # the start each time
    assert [trial.changes for trial in resumed.trials] == [trial.changes for trial in whole.trials]
    count = len(polished(whole))
    assert 15 < count <= 24  # it ends where points would be closer than 1 µm
    assert asked == 11 + count  # nothing twice
    more = Bowl()
    longer = optimize_with(design, box_of(polish=30), tmp_path / "b", more)
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
    result = optimize_with(design, box_of(polish=24), tmp_path, Bowl())
    for trial in result.trials:
        for entry in ("array.pitch_mm", "elastomer.0.thickness_mm"):
            assert trial.changes[entry] == round(trial.changes[entry], 3)
    # unless the bounds are as close as that, or are no such length
    closer = Axis("array.pitch_mm", low=13.0, high=13.005)
    assert closer.value(13.00312) == 13.00312
    assert Axis("array.pitch_mm", low=13.0004, high=14.0).value(13.00042) == 13.0004  # a bound is kept
    assert Axis("array.pitch_mm", high=1.0, start=0.1524).value(0.1524) == 0.1524  # and the design's own value
    assert Axis("array.direction_deg", high=360.0).value(0.123456) == 0.123456
