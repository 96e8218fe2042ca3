"""``coilarray optimize``: what it prints and writes, going on after a stop, exit codes, one line for every mistake."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from support.command_line import runner

from coilarray import load_design
from coilarray.studies.quantities import QUANTITIES, evaluate

pytestmark = pytest.mark.slow

run, refused = runner("optimize")

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
def _cheap_goal(own_folder, monkeypatch):
    monkeypatch.setattr("coilarray.report.optimization._CHEAP", ("geometry",))  # circuits take long
    monkeypatch.setattr("coilarray.report.figures._DPI", 40)
    Path("goal.toml").write_text(GOAL, encoding="utf-8")


def test_the_whole_of_it(capsys):
    code, out, err = run(capsys, "starter", "goal.toml", "--out", "found", "--workers", "1")
    assert (code, err) == (0, "")
    assert [line.removeprefix("wrote ") for line in out.splitlines() if line.startswith("wrote ")] == [
        str(Path("found", name)) for name in ("trials.csv", "result.json", "best.toml", "report.html")
    ]
    assert all(Path("found", name).stat().st_size > 200 for name in ("study.db", "report.html"))
    with Path("found/trials.csv").open(encoding="utf-8", newline="") as lines:
        trials = list(csv.DictReader(lines))
    assert [row["kind"] for row in trials].count("search") == 10
    best = evaluate(load_design("found/best.toml"), ["board_area_mm2", "covered_mm2"])
    assert best["covered_mm2"] >= 500 * (1 - 1e-9)
    assert best["board_area_mm2"] < evaluate(load_design("starter"), ["board_area_mm2"])["board_area_mm2"]
    rows = {line.split()[0]: line.split()[1:] for line in out.splitlines() if line and not line.startswith("wrote")}
    assert rows["array.columns"][0] == "3"
    assert float(rows["board_area_mm2"][1]) == pytest.approx(best["board_area_mm2"], rel=1e-5)
    # the same command again changes nothing and says so
    before = Path("found/trials.csv").read_text(encoding="utf-8")
    code, again, err = run(capsys, "starter", "goal.toml", "--out", "found", "--workers", "1")
    assert (code, again) == (0, out)
    assert err == f"coilarray: going on with {len(trials) - 1} points of an earlier run in found\n"
    assert Path("found/trials.csv").read_text(encoding="utf-8") == before


def test_more_trials_and_json(capsys):
    assert run(capsys, "starter", "goal.toml", "--trials", "4", "--workers", "1")[0] == 0
    code, out, _ = run(capsys, "starter", "goal.toml", "--trials", "8", "--workers", "1", "--json")
    data = json.loads(out)
    assert code == 0
    assert data["goal"]["search"]["trials"] == 8
    assert data["files"][-1] == str(Path("optimization", "report.html"))
    assert data["front"][0]["quantities"]["span_mm"] > 0


def test_fewer_trials_than_are_known(capsys):
    assert run(capsys, "starter", "goal.toml", "--workers", "1")[0] == 0
    before = Path("optimization/trials.csv").read_text(encoding="utf-8")
    code, _, err = run(capsys, "starter", "goal.toml", "--workers", "1", "--trials", "3")
    assert code == 0
    assert "tried 10 points of the search; none is left out for 3" in err
    assert Path("optimization/trials.csv").read_text(encoding="utf-8") == before


def test_none_found_though_the_start_is_allowed(capsys):
    # so near that they cover too little
    text = GOAL.replace("low = 9.0", "low = 0.1").replace("high = 13.0", "high = 0.2")
    Path("far.toml").write_text(text.replace("at_least = 500", "at_least = 400"), encoding="utf-8")
    code, out, _ = run(capsys, "starter", "far.toml", "--workers", "1")
    assert code == 0
    assert "no design is found" in out
    assert "the design as it was keeps all bounds, but lies outside of what the variables may be" in out


def test_the_most_frequent_reason_where_none_is_found(capsys, monkeypatch):
    import coilarray.studies.optimize.run as module

    points = module.evaluate_points

    def walled(design, changes, *arguments, **options):
        for index, outcome in points(design, changes, *arguments, **options):
            reason = f"{index} is too near." if changes[index].get("array.columns", 4) < 4 else "too wide."
            yield index, reason if changes[index] else outcome

    monkeypatch.setattr(module, "evaluate_points", walled)
    Path("far.toml").write_text(GOAL.replace("low = 9.0", "low = 12.0"), encoding="utf-8")
    code, out, _ = run(capsys, "starter", "far.toml", "--workers", "1")
    with Path("optimization/trials.csv").open(encoding="utf-8", newline="") as lines:
        narrow = [int(row["array.columns"]) < 4 for row in csv.DictReader(lines) if row["kind"] == "search"]
    expected = "is too near." if 2 * sum(narrow) > len(narrow) else "too wide."
    assert code == 0
    (line,) = [line for line in out.splitlines() if line.startswith("the most frequent reason why points cannot be: ")]
    assert line.endswith(expected)


def test_two_processes_find_the_same(capsys):
    found = []
    for count in ("1", "2"):
        # each with a cache of its own: nothing is taken from the other
        arguments = ("--trials", "6", "--workers", count, "--cache", f"cache{count}", "--out", count, "--json")
        assert run(capsys, "starter", "goal.toml", *arguments)[0] == 0
        found.append(Path(count, "trials.csv").read_text(encoding="utf-8"))
    assert found[0] == found[1]


def test_interrupted(capsys, monkeypatch):
    import coilarray.studies.optimize.run as module

    points = module.evaluate_points

    def stopped(*arguments, **options):
        for count, point in enumerate(points(*arguments, **options)):
            if len(arguments[1]) > 1 and count == 2:
                raise KeyboardInterrupt
            yield point

    with monkeypatch.context() as patched:
        patched.setattr(module, "evaluate_points", stopped)
        code, out, err = run(capsys, "starter", "goal.toml", "--workers", "1")
    assert (code, out) == (130, "")
    assert "3 points are kept in optimization; the same command goes on from there" in err
    code, out, err = run(capsys, "starter", "goal.toml", "--workers", "1")
    assert code == 0
    assert "going on with 3 points" in err  # the start and two more
    resumed = Path("optimization/trials.csv").read_text(encoding="utf-8")
    assert run(capsys, "starter", "goal.toml", "--workers", "1", "--out", "whole")[0] == 0
    assert Path("whole/trials.csv").read_text(encoding="utf-8") == resumed


def test_several_objectives_and_none_found(capsys):
    Path("two.toml").write_text(GOAL.replace("polish = 6", "").replace(
        "[[constraint]]", '[[objective]]\nquantity = "span_mm"\ndirection = "maximize"\n[[constraint]]'), "utf-8",
    )  # fmt: skip
    text = Path("two.toml").read_text(encoding="utf-8").replace('watch = ["span_mm"]\n', "")
    Path("two.toml").write_text(text, encoding="utf-8")
    code, out, _ = run(capsys, "starter", "two.toml", "--workers", "1")
    assert code == 0
    assert "Pareto front: " in out
    assert Path("optimization/pareto_01.toml").exists()
    Path("none.toml").write_text(GOAL.replace("at_least = 500", "at_least = 50000"), encoding="utf-8")
    code, out, _ = run(capsys, "starter", "none.toml", "--workers", "1")
    assert code == 0
    assert "10 points, 0 keep all bounds: no design is found" in out
    assert not list(Path("optimization").glob("*.toml"))


def test_broken_rules_are_reported(capsys):
    # the least area has overlapping copper, of which the goal says nothing
    Path("close.toml").write_text(GOAL.replace("low = 9.0", "low = 6.0").replace("at_least = 500", "at_least = 1"))
    code, out, _ = run(capsys, "starter", "close.toml", "--workers", "1")
    assert code == 0
    assert "best break fabrication rules (coilarray check); fab_margin_mm can be a constraint" in out


def test_list_of_quantities(capsys):
    code, out, err = run(capsys, "--list-quantities")
    assert (code, err) == (0, "")
    for quantity in QUANTITIES.values():
        assert quantity.says in out
    code, out, _ = run(capsys, "--list-quantities", "--json")
    assert {row["quantity"] for row in json.loads(out)} == set(QUANTITIES)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "a design and a goal must be given"),
        (("starter",), "a design and a goal must be given"),
        (("nothing", "goal.toml"), "there is no design file nothing"),
        (("starter", "nothing.toml"), "there is no goal file"),
        (("starter", "goal.toml", "--trials", "0"), "--trials must be 1 to 1000000; got 0"),
        (("starter", "goal.toml", "--trials", "x"), "'--trials'"),
        (("starter", "goal.toml", "--workers", "0"), "the number of workers must be 1 to"),
        (("starter", "goal.toml", "--workers", "2", "--cluster", "tcp://a:1"), "cannot be given with --cluster"),
        (("starter", "goal.toml", "--cluster", "nowhere"), "cluster"),
        (("starter", "wrong.toml"), "variable.0.low: array has no key 'pich_mm'; did you mean pitch_mm?"),
        (("starter", "coil.toml", "--workers", "1"), "the design starter has no coil 'coil9'"),
        (("starter", "goal.toml", "--out", "goal.toml"), "cannot make the folder goal.toml: a file has that name"),
        (("starter", "goal.toml", "--cache", "goal.toml"), "cannot make the folder goal.toml: a file has that name"),
    ],
)  # fmt: skip
def test_mistakes(capsys, arguments, message):
    Path("wrong.toml").write_text(GOAL.replace("pitch_mm", "pich_mm"), encoding="utf-8")
    Path("coil.toml").write_text(GOAL.replace('["span_mm"]', '["inductance_uH[coil9]"]'), encoding="utf-8")
    assert message in refused(capsys, *arguments)
    assert not list(Path().rglob("study.*"))
