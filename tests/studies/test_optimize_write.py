"""The files, pictures and page of an optimisation."""

import csv
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from support.optimize_points import StandIn

from coilarray import load_design
from coilarray.design.bundled import read
from coilarray.design.model import build_design_file, load_design_file, parse_design_file
from coilarray.errors import OutputError
from coilarray.report.optimization import chosen_designs, quantity_table, write_optimization_report
from coilarray.studies.optimize import optimize_with, parse_goal, write_optimization
from coilarray.studies.optimize.write import LEAST_POINTS, importance, result_data, trial_text
from coilarray.studies.quantities import evaluate
from coilarray.viz.palette import VERMILLION
from coilarray.viz.plots.optimize import boards_figure, plot_convergence, plot_front, plot_importance

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
    read = parse_design_file(trial_text(board, single.best, "best"))
    assert set(board.assumed) - set(read.assumed) == {"array.pitch_mm", "array.layers"}
    assert read.assumed.items() <= board.assumed.items()
    bare = build_design_file({**board.document, "assumed": {"array.pitch_mm": "why"}})
    assert "assumed" not in trial_text(bare, single.best, "best")


def test_unwritable(single, tmp_path):
    (tmp_path / "file").write_text("")
    for write in (write_optimization, write_optimization_report):
        with pytest.raises(OutputError, match="cannot make the folder"):
            write(single, tmp_path / "file")


def test_importance(single, double):
    (parts,) = importance(single.goal, single.axes, single.trials)
    assert sum(parts.values()) == pytest.approx(1.0)
    assert min(parts.values()) >= 0
    assert min(parts, key=parts.get) == "array.layers"  # which do not enter the area
    assert len(importance(double.goal, double.axes, double.trials)) == 2
    few = [trial for trial in single.trials if trial.feasible][: LEAST_POINTS - 1]
    assert importance(single.goal, single.axes, few) == [{}]


def test_quantities_that_no_design_has_are_left_out(single):
    """One coil has no couplings, of which the page had rows of dashes."""
    one = replace(single, file=parse_design_file(read("gast_fem"), "gast_fem"))
    found = quantity_table(one, (), ("fab_broken", "rms_k", "covered_mm2")).rows
    assert [row[0] for row in found] == ["fab_broken", "covered_mm2"]


def test_chosen_designs(single, double):
    assert [one.label for one in chosen_designs(single)] == ["best"]
    chosen = chosen_designs(double)
    assert (chosen[0].label, chosen[-1].label) == ("pareto_01", f"pareto_{len(double.front):02d}")
    assert len(chosen) == 3
    # the one between is nearest to the best of both, of the front scaled to the unit box
    scores = np.array([trial.scores for trial in double.front])
    scaled = (scores - scores.min(axis=0)) / np.ptp(scores, axis=0)
    assert chosen[1].trial is double.front[int((scaled**2).sum(axis=1).argmin())]


@pytest.mark.slow
@pytest.mark.usefixtures("small_pictures")
def test_page(single, double, tmp_path, monkeypatch):
    monkeypatch.setattr("coilarray.report.optimization._CHEAP", ("geometry",))  # circuits of six designs take long
    pages = [write_optimization_report(result, tmp_path).read_text(encoding="utf-8") for result in (single, double)]
    for page in pages:
        assert "http" not in re.sub(r"<[^>]*>", "", page)
        assert not re.search(r"<(script|link|iframe)|src=\"(?!data:image/png;base64,)", page)
        assert "Smaller &amp; better" in page
        for heading in ("Before and after", "Boards", "Convergence", "Importance", "Points that give no design"):
            assert f"<h2>{heading}</h2>" in page
        assert "is too much." in page
    one, two = pages
    assert one.count("<img") == 3  # boards, convergence, importance
    assert two.count("<img") == 6  # and the front; the others for both objectives
    assert "<code>best.toml</code>" in one
    assert "<h2>Pareto front</h2>" in two
    assert f"{single.best.quantities['span_mm']:.5g}" in one
    assert "fab_broken" in one  # watched
    # quantities that nobody asked for, before and after
    covered = f"{evaluate(single.design, ['covered_mm2'])['covered_mm2']:.5g}"
    assert f"<td>covered_mm2</td><td>mm²</td><td></td><td>{covered}</td>" in one


@pytest.mark.slow
@pytest.mark.usefixtures("small_pictures")
def test_page_where_nothing_is_found(starter, tmp_path, monkeypatch):
    monkeypatch.setattr("coilarray.report.optimization._CHEAP", ("geometry",))
    goal = parse_goal(GOAL.format(second="", trials=4).replace("at_least = 30", "at_least = 4000"))
    result = optimize_with(starter, goal, tmp_path, StandIn(quantities))
    page = write_optimization_report(result, tmp_path).read_text(encoding="utf-8")
    assert "No design is found that keeps all bounds; the given design does not either, as it breaks" in page
    assert "Too few points" in page
    assert [path.name for path in write_optimization(result, tmp_path)] == ["trials.csv", "result.json"]


def test_convergence_picture():
    scores = [5.0, np.nan, 3.0, 4.0, 1.0]
    feasible = [True, False, True, True, False]
    ax = plot_convergence(scores, feasible, label="q", polished_from=3, start=6.0)
    (best,) = [line for line in ax.lines if line.get_label() == "best so far"]
    assert best.get_ydata().tolist() == [5, 5, 3, 3, 3]
    points = {c.get_label(): c.get_offsets() for c in ax.collections}
    assert points["keeps all bounds"][:, 1].tolist() == [5, 3, 4]
    low, high = ax.get_ylim()
    assert low < 3 < 6 < high
    up = plot_convergence(scores, feasible, label="q", maximized=True)
    assert up.lines[0].get_ydata().tolist() == [5, 5, 5, 5, 5]
    assert plot_convergence([2.0, 0.1], [True, True], label="q", log=True).get_yscale() == "log"
    assert plot_convergence([2.0, 0.0], [True, True], label="q", log=True).get_yscale() == "linear"
    assert not plot_convergence([np.nan], [False], label="q").lines
    with pytest.raises(ValueError, match="rows of one length"):
        plot_convergence([1.0], [True, True], label="q")


def test_front_picture():
    points = [(1.0, 5.0), (3.0, 1.0), (2.0, 2.0), (90.0, 90.0), (0.0, 0.0)]
    feasible = [True, True, True, True, False]
    named = {2: "middle"}
    ax = plot_front(points, feasible, [0, 1, 2], labels=("a", "b"), start=(4.0, 4.0), named=named, stairs="post")
    shown = {c.get_label(): c for c in ax.collections}
    assert shown["Pareto front"].get_offsets().tolist() == [[1, 5], [2, 2], [3, 1]]
    assert shown["Pareto front"].get_facecolors()[0].tolist() == pytest.approx(to_rgba(VERMILLION))
    assert shown["given design"].get_offsets().tolist() == [[4, 4]]
    assert len(shown["keeps all bounds"].get_offsets()) == 4
    assert [text.get_text() for text in ax.texts] == ["middle"]
    assert ax.lines[0].get_drawstyle() == "steps-post"
    assert ax.get_xlim()[1] < 10  # the far-off point does not make the front a dot
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("a", "b")
    assert plot_front(points, [False] * 5, [], labels=("a", "b")).collections
    alone = plot_front(points, feasible, [1], labels=("a", "b")).collections
    assert [one.get_label() for one in alone] == ["keeps all bounds", "best"]  # one point is no front
    with pytest.raises(ValueError, match="shape"):
        plot_front(points, [True], [], labels=("a", "b"))


def test_importance_and_board_pictures(starter):
    ax = plot_importance({"pitch": 0.75, "columns": 0.25}, title="what")
    assert [bar.get_width() for bar in ax.patches] == [75, 25]
    assert [text.get_text() for text in ax.texts] == ["75 %", "25 %"]
    few = load_design("gast_fem")
    figure = boards_figure({"one": starter.array, "other": few.array})
    upper, lower = figure.axes
    assert (upper.get_title(loc="left"), lower.get_title(loc="left")) == ("one", "other")
    assert upper.get_xlim() == lower.get_xlim()  # one scale
    assert upper.get_xlim()[1] > starter.array.bounds[2] * 1e3
