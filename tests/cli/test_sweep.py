"""The command ``sweep``: the numbers of the library, one line for every mistake, and sweeps that go on."""

import csv
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support.command_line import runner, successes
from support.patience import until

from coilarray import load_design
from coilarray.cli.main import main
from coilarray.compute.workers import open_executor
from coilarray.studies.sweep import Axis, plan_sweep, run_sweep

pytestmark = pytest.mark.usefixtures("own_folder", "own_store")
_, refused = runner("sweep", "starter")
good, answer = successes("sweep", "starter")

PATIENCE = 600.0  # s for what takes a few where nobody else computes
PITCHES = (12.0, 14.0, 16.0)
SMALL = ("--vary", "array.pitch_mm=12:16:3", "--quantity", "span_mm", "--quantity", "board_area_mm2")
ONE = ("--workers", "1")
VARY = ("--vary", "array.pitch_mm=12,13")
SPAN = ("--quantity", "span_mm")


@pytest.fixture(scope="module")
def expected():
    """What the library says."""
    plan = plan_sweep(load_design("starter"), [Axis("array.pitch_mm", PITCHES)], ["span_mm", "board_area_mm2"])
    with open_executor() as pool:
        return run_sweep(plan, pool)


def kept(folder="cache"):
    """Results in a cache; what begins with a dot is still being written."""
    return sorted(path for path in Path(folder).glob("??/*.json") if not path.name.startswith("."))


@pytest.mark.slow
def test_the_file_is_the_dataset_of_the_library(capsys, expected):
    out = good(capsys, *SMALL, *ONE, "--out", "s.nc", "--plot", "s.svg")
    with xr.open_dataset("s.nc", engine="h5netcdf") as saved:
        xr.testing.assert_identical(saved.load(), expected)
    assert Path("s.svg").read_text(encoding="utf-8").startswith("<?xml")
    assert out.splitlines()[-2:] == ["wrote s.nc: 3 points over array.pitch_mm", "wrote s.svg"]
    assert len(kept()) == 3


@pytest.mark.slow
def test_what_breaks_rules_is_marked_and_neither_an_extreme_nor_the_best(capsys):
    """The starter's coils overlap on the same copper below some 9 mm: the smallest board, and none to be made."""
    pitches = ("--vary", "array.pitch_mm=6,7,12,14", "--goal", "minimize board_area_mm2", *ONE)
    data = answer(capsys, *pitches, "--out", "s.csv")
    assert [row["fab_broken"] > 0 for row in data["points"]] == [True, True, False, False]
    assert [point["entries"] for point in data["best"]] == [{"array.pitch_mm": 12}]
    out = good(capsys, *pitches, *SPAN, "--out", "s.csv", "--plot", "s.svg")
    rows = {line.split()[0]: line.split(maxsplit=4)[4:] for line in out.splitlines() if line.strip()[:1].isdigit()}
    assert rows == {"6": ["breaks rules (1)"], "7": ["breaks rules (1)"], "12": [], "14": []}
    assert re.search(r"^\(1\) The copper of coil1 and coil2 overlaps on L1, by up to", out, re.MULTILINE)
    assert "fab_broken" not in out  # nobody asked for it
    assert "breaks fabrication rules" in Path("s.svg").read_text(encoding="utf-8")


@pytest.mark.slow
def test_of_many_points_the_extremes_are_printed(capsys, monkeypatch):
    monkeypatch.setattr("coilarray.cli.studies._MOST_ROWS", 1)
    out = good(capsys, "--vary", "array.pitch_mm=6,7,12,14", *SPAN, *ONE)
    (row,) = (" ".join(line.split()) for line in out.splitlines() if line.startswith("span_mm"))
    assert "array.pitch_mm = 12 " in row
    assert row.endswith("array.pitch_mm = 14")
    assert "2 of 4 points break fabrication rules (fab_broken in the file): left out of the table" in out
    out = good(capsys, "--vary", "array.pitch_mm=6,7", *SPAN, *ONE)
    assert "2 of 2 points break fabrication rules (fab_broken in the file): still in the table" in out
    out = good(capsys, *SMALL, *BAD, *ONE)
    assert "3 of 6 points give no design, such as: starter: circuit.tank must be" in out


BAD = ("--vary", "circuit.tank=coil,nowhere")  # every other point gives no design


def test_every_point_with_its_reason(capsys, expected):
    out = good(capsys, *SMALL, *BAD, "--out", "s.csv", *ONE)
    assert out.count("no design (1)") == 3
    assert "(1) starter: circuit.tank must be" in out
    rows = list(csv.DictReader(Path("s.csv").read_text(encoding="utf-8").splitlines()))
    assert list(rows[0]) == ["array.pitch_mm", "circuit.tank", "span_mm", "board_area_mm2", "fab_broken", "reason"]
    data = answer(capsys, *SMALL, *BAD, *ONE)
    assert data["design_hash"] == expected.attrs["design_hash"]
    assert (data["file"], data["sampling"], data["accuracy"]) == (None, "grid", "full")
    assert not Path("sweep.nc").exists()
    points = data["points"]
    assert [point["array.pitch_mm"] for point in points] == np.repeat(PITCHES, 2).tolist()
    for got, wanted, bad in zip(points[::2], expected.span_mm.values.tolist(), points[1::2], strict=True):
        assert (got["span_mm"], got["reason"], bad["span_mm"]) == (wanted, "", None)
        assert bad["reason"].startswith("starter: circuit.tank must be 'converter' or 'coil'")
    for row, point in zip(rows, points, strict=True):
        assert row == {key: "" if value is None else str(value) for key, value in point.items()}


def test_a_sweep_without_any_result_has_an_empty_table(capsys):
    """Designs there are, but none has the quantity."""
    assert main(["sweep", "gast_fem", "--vary", "board.margin_mm=1,2", "--goal", "minimize worst_k", *ONE]) == 0
    out = capsys.readouterr().out
    assert "no point has a value of the goal" in out.splitlines()
    assert out.splitlines()[0].split() == ["board.margin_mm", "remark"]
    assert "(1) the design gast_fem has only one coil" in out


@pytest.mark.slow
def test_the_best_of_a_sweep_by_a_goal(capsys):
    wish = ("--goal", "minimize board_area_mm2", "--vary", "array.pitch_mm=10:14:3")
    out = good(capsys, *wish, *ONE)
    best, last = out.splitlines()[-2:]
    assert best.startswith("minimize board_area_mm2: board_area_mm2 = ")
    assert best.endswith(" at array.pitch_mm = 10")
    assert last == "wrote sweep.nc: 3 points over array.pitch_mm"
    data = answer(capsys, *wish, "--quantity", "span_mm", *ONE)
    (point,) = data["best"]
    assert point["entries"] == {"array.pitch_mm": 10.0}
    assert point["quantities"]["board_area_mm2"] == min(one["board_area_mm2"] for one in data["points"])
    assert {"span_mm", "fab_margin_mm"} <= set(data["points"][0])  # what the goal keeps, too


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (SPAN, "a sweep needs --vary KEY=START:STOP:COUNT, such as"),
        (VARY, "a sweep needs --quantity or --goal; coilarray optimize --list-quantities"),
        (("--vary", "array.pitch_mm", *SPAN), "--vary must be KEY=START:STOP:COUNT or KEY=A,B,…; got 'array.pitch_mm'"),
        (("--vary", "array.pich_mm=1,2", *SPAN), "array has no key 'pich_mm'; did you mean pitch_mm?"),
        ((*VARY, "--quantity", "span"), "there is no quantity 'span'; did you mean span_mm?"),
        ((*VARY, *SPAN, "--samples", "0"), "a sweep must have 1 to 100000 points; got 0."),
        ((*VARY, *SPAN, "--accuracy", "half"), "'half'"),
        ((*VARY, *SPAN, "--workers", "2", "--cluster", "tcp://a:1"), "it cannot be given with --cluster."),
        ((*VARY, *SPAN, "--cache", "taken"), "cannot make the folder taken: a file has that name."),
    ],
)
def test_a_mistake_is_one_line_before_any_work(capsys, monkeypatch, arguments, message):
    monkeypatch.setattr("coilarray.studies.sweep.evaluate", lambda *_, **__: pytest.fail("work has begun"))
    Path("taken").touch()
    assert message in refused(capsys, *arguments)
    assert not list(Path().glob("s*.*"))


START = """
import sys, time
from contextlib import contextmanager
import coilarray.cli.shared as shared

def tell(done, total):
    while done >= 5:  # however late the interrupt is sent, the sweep is not over
        time.sleep(0.01)  # not long: another thread may take the signal, which does not wake this one

@contextmanager
def telling(*_):
    yield tell

shared.progress_bar = telling
from coilarray.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
def test_an_interrupted_sweep_says_what_is_kept_and_goes_on(capsys, monkeypatch):
    """With two processes; tests/compute/test_under_load.py has all commands with one."""
    vary = [f"{12 + k / 8:g}" for k in range(20)]
    arguments = ["--vary", f"array.pitch_mm={','.join(vary)}", *SPAN, "--out", "s.csv"]
    command = [sys.executable, "-c", START, "sweep", "starter", *arguments, "--workers", "2"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes, start_new_session=True) as process:
        try:
            until(lambda: len(kept()) >= 3, within=PATIENCE)
            os.killpg(process.pid, signal.SIGINT)  # to all of the group, as a terminal does
            out, err = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    assert (process.returncode, out) == (130, "")
    told, last = err.splitlines()
    assert last == "coilarray: interrupted"
    done = len(kept())
    assert 3 <= done < 20
    number, rest = told.removeprefix("coilarray: ").split(" ", 1)
    # one may be written when the interrupt comes, and not be counted
    assert int(number) in (done, done - 1)
    assert rest == f"of 20 points are kept in {Path('cache').resolve()}; the same command continues from there"
    assert not Path("s.csv").exists()
    computed = []
    made_up = {"span_mm": 0.25, "fab_broken": 0.0}
    monkeypatch.setattr("coilarray.studies.sweep.evaluate", lambda *_, **__: computed.append(1) or made_up)
    good(capsys, *arguments, "--workers", "1")  # in this process
    assert len(computed) == 20 - done
    assert len(kept()) == 20
    values = [float(row["span_mm"]) for row in csv.DictReader(Path("s.csv").read_text().splitlines())]
    assert values.count(0.25) == 20 - done
