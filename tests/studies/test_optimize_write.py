"""The files, pictures and page of an optimisation."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from support.optimize_points import StandIn

from coilarray.design.model import build_design_file, load_design_file, parse_design_file
from coilarray.report.studies import write_optimization_report
from coilarray.studies.optimize import optimize_with, parse_goal, write_optimization
from coilarray.studies.optimize.run import result_data, trial_text
from coilarray.studies.quantities import evaluate
from coilarray.viz.plots.studies import plot_convergence

GOAL = """
schema = 1
title = "Smaller & better"
watch = ["fab_broken"]
variable = [
  {{ entry = "array.pitch_mm", low = 8, high = 13 }},
  {{ entry = "array.columns", low = 2, high = 4 }},
  {{ entry = "array.layers", choices = [[["L1", "L2"], ["L3", "L4"]], [["L1", "L3"], ["L2", "L4"]]] }},
]
objective = [{{ quantity = "board_area_mm2", direction = "minimize" }}, {second}]
constraint = [{{ quantity = "span_mm", at_least = 30 }}]
[search]
trials = {trials}
population = 8
polish = 6
"""
SECOND = '{ quantity = "worst_k", direction = "minimize" }'


def quantities(change):
    pitch, columns = change.get("array.pitch_mm", 11.0), change.get("array.columns", 3)
    if pitch > 12.5:
        return f"a pitch of {pitch:.2f} mm is too much."
    crossed = change.get("array.layers", [["L1", "L2"]])[0][1] == "L3"
    worst = 0.01 * abs(pitch - 10.0) + 0.001 * columns + 0.01 * crossed
    layout = {"board_area_mm2": 30.0 * pitch * columns, "span_mm": 16.0 + pitch * (columns - 1), "fab_broken": 0.0}
    return {"worst_k": worst, **layout}


def searched(starter, folders, goal):
    return optimize_with(starter, parse_goal(goal), folders.mktemp("search"), StandIn(quantities))


@pytest.fixture(scope="module")
def single(starter, tmp_path_factory):
    return searched(starter, tmp_path_factory, GOAL.format(second="", trials=48))


@pytest.fixture(scope="module")
def double(starter, tmp_path_factory):
    return searched(starter, tmp_path_factory, GOAL.format(second=SECOND, trials=48).replace("polish = 6", ""))


@pytest.mark.slow
def test_csv_has_every_trial(single, tmp_path):
    write_optimization(single, tmp_path)
    start, *others = csv.DictReader((tmp_path / "trials.csv").read_text(encoding="utf-8").splitlines())
    assert (start["kind"], start["array.columns"], start["array.pitch_mm"]) == ("start", "3", "11.0")
    assert json.loads(start["array.layers"]) == [["L1", "L2"], ["L3", "L4"]]
    for row, trial in zip(others, single.trials, strict=True):
        assert (row["kind"], int(row["place"]), row["reason"]) == (trial.kind, trial.place, trial.reason)
        assert row["accuracy"] == trial.accuracy
        assert (row["feasible"], row["front"]) == (str(trial.feasible), str(trial is single.best))
        assert float(row["array.pitch_mm"]) == trial.changes["array.pitch_mm"]  # to the last bit
        assert {key: float(row[key]) for key in trial.quantities} == trial.quantities
        assert trial.quantities or row["span_mm"] == ""


@pytest.mark.slow
def test_json(single, double, tmp_path):
    write_optimization(single, tmp_path)
    data = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert data == json.loads(json.dumps(result_data(single)))
    assert data["provenance"]["design_hash"] == single.design.digest
    assert (data["goal"]["title"], data["goal"]["objective"][0]["quantity"]) == ("Smaller & better", "board_area_mm2")
    assert (data["trials"], data["found"], data["sampler"]) == (54, 0, "tpe")
    (best,) = data["front"]
    assert (best["file"], best["accuracy"]) == ("best.toml", "full")
    assert best["entries"] == dict(single.best.changes)
    assert best["quantities"]["span_mm"] >= 30
    assert data["start"]["quantities"]["board_area_mm2"] == pytest.approx(30 * 11 * 3)
    assert len(result_data(double)["front"]) == len(double.front) > 2
    assert "several objectives" in result_data(double)["polish_problem"]


@pytest.mark.slow
def test_designs_read_back(single, double, tmp_path):
    *_, best = write_optimization(single, tmp_path)
    assert best.name == "best.toml"
    file = load_design_file(best)
    read = file.design
    (found,) = single.designs()
    assert read.name == "starter-best"
    assert read.array.centres == pytest.approx(found.array.centres, abs=0)
    assert read.digest == found.digest
    assert file.values["array.pitch_mm"] == single.best.changes["array.pitch_mm"]
    assert evaluate(read, ["span_mm"])["span_mm"] > 25
    _, _, *files = write_optimization(double, tmp_path)
    assert not best.exists()  # of the search before
    assert [path.name for path in files] == [f"pareto_{k + 1:02d}.toml" for k in range(len(double.front))]
    for path, trial in zip(files, double.front, strict=True):
        assert load_design_file(path).values["array.pitch_mm"] == trial.changes["array.pitch_mm"]
    assert "# starter as changed by coilarray optimize (search" in files[0].read_text(encoding="utf-8")


def test_designs_of_the_user_stay(single, double, tmp_path):
    own = [tmp_path / name for name in ("best.toml", "pareto_99.toml", "pareto_mine.toml")]
    for path in own:
        path.write_text("mine")
    (tmp_path / "result.json").write_text('{"front": [{"file": "pareto_mine.toml"}, {"file": 3}]}')
    written = write_optimization(double, tmp_path)
    assert [path.read_text() for path in own] == ["mine"] * 3
    write_optimization(single, tmp_path)
    assert not any(path.exists() for path in written[2:])
    assert [path.read_text() for path in own[1:]] == ["mine"] * 2


def test_what_was_chosen_is_not_assumed(single):
    board = load_design_file("gast2020")
    read = parse_design_file(trial_text(board, single.best, "best", Path()))
    assert set(board.assumed) - set(read.assumed) == {"array.pitch_mm", "array.layers"}
    assert read.assumed.items() <= board.assumed.items()
    bare = build_design_file({**board.document, "assumed": {"array.pitch_mm": "why"}})
    assert "assumed" not in trial_text(bare, single.best, "best", Path())


@pytest.mark.slow
@pytest.mark.usefixtures("pictures_of_nothing")
def test_page(single, double, tmp_path, monkeypatch):
    monkeypatch.setattr("coilarray.report.studies._CHEAP", ("geometry",))  # circuits of six designs take long
    pages = [write_optimization_report(result, tmp_path).read_text(encoding="utf-8") for result in (single, double)]
    for page in pages:
        assert not re.search(r"<(link|iframe)|src=\"(?!data:image/)", page)
        assert "Smaller &amp; better" in page
        for heading in ("Before and after", "Boards", "Convergence", "Points that give no design"):
            assert f">{heading}</h2>" in page
        assert "is too much." in page
    one, two = pages
    assert one.count("<svg") == 2  # boards, convergence
    assert two.count("<svg") == 4  # and the front; the others for both objectives
    assert "<code>best.toml</code>" in one
    assert ">Pareto front</h2>" in two
    assert "fab_broken" in one  # watched
    # quantities that nobody asked for, before and after
    covered = f"{evaluate(single.design, ['covered_mm2'])['covered_mm2']:.5g}"
    assert f"<td>covered_mm2</td><td>mm²</td><td></td><td>{covered}</td>" in one


def test_convergence_picture():
    scores = [5.0, np.nan, 3.0, 4.0, 1.0]
    feasible = [True, False, True, True, False]
    ax = plot_convergence(scores, feasible, label="q", polished_from=3, start=6.0)
    (best,) = [line for line in ax.lines if line.get_label() == "best so far"]
    assert best.get_ydata().tolist() == [5, 5, 3, 3, 3]
    up = plot_convergence(scores, feasible, label="q", maximized=True)
    assert up.lines[0].get_ydata().tolist() == [5, 5, 5, 5, 5]
    assert plot_convergence([2.0, 0.1], [True, True], label="q", log=True).get_yscale() == "log"
    assert plot_convergence([2.0, 0.0], [True, True], label="q", log=True).get_yscale() == "linear"
    assert not plot_convergence([np.nan], [False], label="q").lines
