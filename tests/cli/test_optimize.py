"""``coilarray optimize``: what it prints and writes, going on after a stop, exit codes, one line for every mistake."""

import csv
import json
from pathlib import Path

import pytest
from support.command_line import mistakes, runner, successes

from coilarray import load_design
from coilarray.geometry import check_rules
from coilarray.report.studies import write_optimization_report
from coilarray.studies.optimize import run as optimize_run
from coilarray.studies.quantities import QUANTITIES, evaluate

pytestmark = pytest.mark.slow

run, refused = runner("optimize")
good, answer = successes("optimize")

# quantities of shapes alone are cheap
GOAL = """
schema = 1
watch = ["span_mm"]
[[variable]]
entry = "array.pitch_mm"
low = 9.0
high = 13.0
[[variable]]
entry = "array.columns"
low = 2
high = 4
[[objective]]
quantity = "board_area_mm2"
direction = "minimize"
[[constraint]]
quantity = "covered_mm2"
at_least = 500
[search]
trials = 10
batch = 4
polish = 6
"""


@pytest.fixture(autouse=True)
def _cheap_goal(own_folder, own_store, pictures_of_nothing, monkeypatch):
    monkeypatch.setattr("coilarray.report.studies._CHEAP", ("geometry",))  # circuits take long
    # the page takes longer than the search; one test here writes it
    monkeypatch.setattr("coilarray.report.studies.write_optimization_report", lambda _, out: out / "report.html")
    Path("goal.toml").write_text(GOAL, encoding="utf-8")
    Path("wrong.toml").write_text(GOAL.replace("pitch_mm", "pich_mm"), encoding="utf-8")


def found(capsys, *arguments, goal=GOAL):
    """Run a goal in this process, quietly, and return what is printed."""
    Path("goal.toml").write_text(goal, encoding="utf-8")
    return good(capsys, "starter", "goal.toml", "--workers", "1", *arguments)


def read_board(folder):
    """Area in mm² of the best board in a folder."""
    return json.loads(Path(folder, "result.json").read_text(encoding="utf-8"))["front"][0]["quantities"][
        "board_area_mm2"
    ]


def none_found(capsys, *arguments, goal):
    """Run a goal by which no design is better, and return what is printed."""
    Path("goal.toml").write_text(goal, encoding="utf-8")
    code, out, err = run(capsys, "starter", "goal.toml", "--workers", "1", *arguments)
    assert (code, err) == (1, "")
    assert not list(Path("optimization").glob("*.toml"))
    return out


def test_the_whole_of_it(capsys, monkeypatch):
    monkeypatch.setattr("coilarray.report.studies.write_optimization_report", write_optimization_report)
    out = found(capsys, "--out", "found")
    assert [line.removeprefix("wrote ") for line in out.splitlines() if line.startswith("wrote ")] == [
        str(Path("found", name)) for name in ("trials.csv", "result.json", "best.toml", "report.html")
    ]
    assert out.endswith(f"\nnext: coilarray report {Path('found', 'best.toml')}\n")
    assert all(Path("found", name).stat().st_size > 200 for name in ("points.jsonl", "report.html"))
    before = Path("found/trials.csv").read_text(encoding="utf-8")
    trials = list(csv.DictReader(before.splitlines()))
    assert [row["kind"] for row in trials].count("search") == 10
    best = evaluate(load_design("found/best.toml"), ["board_area_mm2", "covered_mm2"])
    assert best["covered_mm2"] >= 500 * (1 - 1e-9)
    assert best["board_area_mm2"] < evaluate(load_design("starter"), ["board_area_mm2"])["board_area_mm2"]
    rows = {line.split()[0]: line.split()[1:] for line in out.splitlines() if line and not line.startswith("wrote")}
    assert rows["10"][:3] == ["points", "tried,", str(len(trials) - 11)]  # the start is none of them
    assert rows["array.columns"][2:6] == ["2", "to", "4,", "whole"], out
    assert rows["board_area_mm2"][:2] == ["mm²", "minimize"]
    assert float(rows["board_area_mm2"][3]) == pytest.approx(best["board_area_mm2"], rel=1e-4)  # of five digits
    assert rows["covered_mm2"][:3] == ["mm²", "≥", "500"]
    # the same command again changes nothing and says so
    monkeypatch.setattr("coilarray.report.studies.write_optimization_report", lambda _, out: out / "report.html")
    code, again, err = run(capsys, "starter", "goal.toml", "--out", "found", "--workers", "1")
    assert (code, again) == (0, out)
    assert err == f"coilarray: going on with {len(trials) - 1} points of an earlier run in found\n"
    assert Path("found/trials.csv").read_text(encoding="utf-8") == before


def test_more_trials_and_json(capsys):
    found(capsys, "--trials", "4")
    code, out, _ = run(capsys, "starter", "goal.toml", "--trials", "8", "--workers", "1", "--json")
    data = json.loads(out)
    assert (code, data["goal"]["search"]["trials"]) == (0, 8)
    assert data["files"][-1] == str(Path("optimization", "report.html"))
    assert data["front"][0]["quantities"]["span_mm"] > 0


def test_none_found_though_the_start_is_allowed(capsys):
    # so near that they cover too little
    goal = GOAL.replace("low = 9.0", "low = 0.1").replace("high = 13.0", "high = 0.2").replace("500", "400")
    text = "no design is better than the one at hand, which keeps all bounds"
    assert text in none_found(capsys, goal=goal)
    # by far too large to be better: the best is worse than the start, and is not called best
    wider = GOAL.replace("low = 9.0", "low = 12.0").replace("low = 2\nhigh = 4", "low = 3\nhigh = 4")
    area = evaluate(load_design("starter"), ["board_area_mm2"])["board_area_mm2"]
    out = none_found(capsys, "--trials", "4", goal=wider.replace("polish = 6", "polish = 0"))
    assert f"{text}: board_area_mm2 is {area:.6g} for the given design, and" in out


def test_interrupted(capsys, monkeypatch):
    points = optimize_run.evaluate_points

    def stopped(*arguments, **options):
        for count, point in enumerate(points(*arguments, **options)):
            if len(arguments[1]) > 1 and count == 2:
                raise KeyboardInterrupt
            yield point

    with monkeypatch.context() as patched:
        patched.setattr(optimize_run, "evaluate_points", stopped)
        code, out, err = run(capsys, "starter", "goal.toml", "--workers", "1")
    assert (code, out) == (130, "")
    assert "3 points are kept in optimization; the same command continues from there" in err
    _, _, err = run(capsys, "starter", "goal.toml", "--workers", "1")
    assert "going on with 3 points" in err  # the start and two more
    resumed = Path("optimization/trials.csv").read_text(encoding="utf-8")
    found(capsys, "--out", "whole")
    assert Path("whole/trials.csv").read_text(encoding="utf-8") == resumed


def test_several_objectives_and_none_found(capsys):
    second = '[[objective]]\nquantity = "span_mm"\ndirection = "maximize"\n[[constraint]]'
    two = GOAL.replace("polish = 6", "").replace('watch = ["span_mm"]\n', "").replace("[[constraint]]", second)
    assert "Pareto front: " in found(capsys, goal=two)
    assert Path("optimization/pareto_01.toml").exists()
    out = none_found(capsys, goal=GOAL.replace("at_least = 500", "at_least = 50000"))
    assert (
        "10 points tried; 0 keep all bounds: no design is found that keeps all bounds; the given design does not" in out
    )


def test_what_breaks_rules_is_best_only_where_the_goal_lets_it(capsys):
    # the least area has overlapping copper, of which the goal says nothing
    small = GOAL.replace("low = 9.0", "low = 6.0").replace("at_least = 500", "at_least = 1")
    out = found(capsys, "--out", "kept", goal=small)
    assert "fab_margin_mm" in out
    best = load_design("kept/best.toml")
    assert all(margin.kept for margin in check_rules(best.array, best.rules))
    free = small.replace("[search]", '[[constraint]]\nquantity = "fab_broken"\nat_most = 1000\n[search]')
    out = found(capsys, "--out", "free", goal=free)
    assert "best break fabrication rules (coilarray check)" in out
    area = [read_board(folder) for folder in ("free", "kept")]
    assert area[0] < area[1]


def test_a_goal_of_the_command_line(capsys):
    """The template is the goal, and the goal finds the same as its template."""
    wishes = ("--vary", "array.pitch_mm=9:13:9", "--goal", "minimize board_area_mm2", "--keep", "covered_mm2>=500")
    out = good(capsys, "starter", *wishes, "--template", "mine.toml")
    assert out == "wrote mine.toml; next: coilarray optimize starter mine.toml\n"
    Path("edited.toml").write_text("mine", encoding="utf-8")
    assert "edited.toml exists" in refused(capsys, "starter", *wishes, "--template", "edited.toml")
    few = ("--trials", "12", "--workers", "1")
    good(capsys, "starter", *wishes, *few, "--out", "one")
    good(capsys, "starter", "mine.toml", *few, "--out", "other")
    trials = [Path(folder, "trials.csv").read_text(encoding="utf-8") for folder in ("one", "other")]
    assert trials[0] == trials[1]
    assert load_design("one/best.toml").array.names == load_design("starter").array.names


def test_list_of_quantities(capsys):
    out = good(capsys, "--list-quantities")
    for quantity in QUANTITIES.values():
        assert quantity.says in out
    assert {row["quantity"] for row in answer(capsys, "--list-quantities")["quantities"]} == set(QUANTITIES)


test_mistakes = mistakes(
    refused,
    ((), "a design and a goal must be given"),
    (("starter", "nothing.toml"), "there is no goal file nothing.toml"),
    (("starter", "least"), "there is no goal 'least': it must be a file or one of worst_k, decouple, position_error,"),
    (("starter", "goal.toml", "--goal", "worst_k"), "--goal cannot be given with it"),
    (
        ("starter", "--goal", "q"),
        "a goal must be one of worst_k, decouple, position_error, smallest, range, resolution, or minimize",
    ),
    (("starter", "worst_k", "--keep", "span_mm"), "--keep must be QUANTITY>=VALUE or QUANTITY<=VALUE; got 'span_mm'"),
    (("starter", "worst_k", "--template", "t.txt"), "--template must end in .toml"),
    (("gast_fem", "decouple"), "the design gast_fem has only one coil, and so no coupling"),
    (("starter", "goal.toml", "--trials", "0"), "--trials must be 1 to 1000000; got 0"),
    (("starter", "goal.toml", "--trials", "x"), "'--trials'"),
    (("starter", "goal.toml", "--workers", "2", "--cluster", "tcp://a:1"), "cannot be given with --cluster"),
    (("starter", "goal.toml", "--cluster", "nowhere"), "cluster"),
    (("starter", "wrong.toml"), "variable.0.low: array has no key 'pich_mm'; did you mean pitch_mm?"),
    (("starter", "goal.toml", "--out", "goal.toml"), "cannot make the folder goal.toml: a file has that name"),
    (("starter", "goal.toml", "--cache", "goal.toml"), "cannot make the folder goal.toml: a file has that name"),
)
