"""The command ``tolerance``: its numbers are those of the library, and every mistake is one line."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
import xarray as xr
from support.command_line import mistakes, runner, successes
from support.tolerance_boards import loops

from coilarray import load_design
from coilarray.design.bundled import read
from coilarray.design.write import design_document
from coilarray.studies.tolerance import analyse, load_tolerances
from coilarray.studies.tolerance.tolerances import Positions

pytestmark = pytest.mark.slow

_, refused = runner("tolerance")
good, _ = successes("tolerance")

K, L = "k[upper,lower]", "inductance_uH[upper]"
FILE = """
schema = 1
others = "none"
[etch]
layer_um = 1
[dielectric]
board_percent = 1
[[limit]]
quantity = "k[upper,lower]"
at_most = 0.256
"""


@pytest.fixture(autouse=True)
def _files(own_folder, own_store):
    Path("loops.toml").write_text(tomli_w.dumps(design_document(loops())), encoding="utf-8")
    Path("fab.toml").write_text(FILE, encoding="utf-8")


def computed(capsys, *arguments):
    """Run on the loops in this process and return what is printed."""
    return good(capsys, "loops.toml", "fab.toml", "--workers", "1", "--allow-violations", *arguments)


def test_the_numbers_of_every_file_are_those_of_the_library(capsys):
    eight = ("--samples", "8", "--seed", "3")
    data = json.loads(computed(capsys, *eight, "--json", "--out", "spread.nc"))
    result = analyse(load_design("loops.toml"), load_tolerances("fab.toml"), samples=8, seed=3)
    assert data["design_hash"] == load_design("loops.toml").digest
    assert (data["seed"], data["accuracy"]) == (3, "screen")
    assert [row["output"] for row in data["spread"]] == result.output.values.tolist()
    for key in ("nominal", "linear_deviation", "sample_deviation", "ratio"):
        # the same computation once more
        np.testing.assert_allclose([row[key] for row in data["spread"]], result[key], rtol=1e-9)
    assert [row["limit"] for row in data["yield"]] == [f"{K} ≤ 0.256", "all limits"]
    assert [row["contributor"] for row in data["errors"]] == result.contributor.values.tolist()
    assert len(data["shares"]) == result.sizes["output"] * result.sizes["contributor"]
    with xr.open_dataset("spread.nc", engine="h5netcdf") as read:
        np.testing.assert_allclose(read.value, result.value, rtol=1e-9)
        assert read.failure.values.tolist() == [""] * 8
    out = computed(capsys, *eight, "--out", "spread.csv", "--plot", "spread.png")
    assert out.endswith("wrote spread.csv\nwrote spread.png\n")
    assert Path("spread.png").read_bytes().startswith(b"\x89PNG")
    rows = list(csv.DictReader(Path("spread.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["output"] for row in rows] == result.output.values.tolist()
    np.testing.assert_allclose([float(row["ratio"]) for row in rows], result.ratio, rtol=1e-9)
    computed(capsys, *eight, "--out", "spread.json")
    samples = json.loads(Path("spread.json").read_text(encoding="utf-8"))["samples"]
    np.testing.assert_allclose([row[K] for row in samples], result.value.sel(output=K), rtol=1e-9)


def test_the_tables_name_errors_outputs_and_limits(capsys):
    out = computed(capsys, "--samples", "8", "-q", K)
    lines = out.splitlines()
    assert any(line.split()[:2] == ["etch", "normal"] and line.endswith("µm") for line in lines)
    assert any(line.startswith(K) and "dielectric, board" in line for line in lines)
    assert any(line.startswith(f"{K} ≤ 0.256") for line in lines)
    assert "\\" not in out
    # a nominal one, two for each of three errors, and the drawn ones
    assert "15 boards computed" in out
    assert "the interval of the yield is for independent boards, and approximate for Sobol points" in out
    assert "drawn boards that cannot be made count as bad; the linear yield ignores them" in out


def test_typical_values_are_shown_as_assumed_and_are_the_template(capsys):
    out = good(capsys, "loops.toml", "--workers", "1", "--allow-violations", "--samples", "0", "-q", K)
    assert "houses state ±20 % of the width" in out
    assert good(capsys, "--template", "own.toml") == "wrote own.toml\n"
    assert load_tolerances("own.toml").spreads == load_tolerances().spreads


@pytest.fixture(scope="module")
def linear(tmp_path_factory):
    """A file of the starter under small strain, which is quick."""
    path = tmp_path_factory.mktemp("linear") / "linear.toml"
    path.write_text(read("starter").replace('strain = "finite"', 'strain = "linear"'), encoding="utf-8")
    return path


POSITIONS = "\n[positions]\nx_mm = [3]\ny_mm = [1, 3]\ndepth_mm = 0.3\nnoise = 1e-7\n"


def test_positions_go_to_the_analysis_with_the_kept_table(capsys, monkeypatch, linear):
    """What it makes of them is in tests/studies/test_tolerance_analysis.py."""
    seen = {}

    def without_positions(design, wanted, *, table, **settings):
        seen.update(positions=wanted.positions, table=table)
        result = analyse(design, replace(wanted, positions=None), **settings)
        return result.assign_attrs(found="7 of 8", undetermined="dielectric")

    monkeypatch.setattr("coilarray.studies.tolerance.analyse", without_positions)
    monkeypatch.setattr("coilarray.cli.shared.kept_table", lambda design: "the table")
    Path("fab.toml").write_text(f"schema = 1\n[placement]\nboard_mm = 0.05{POSITIONS}", encoding="utf-8")
    out = good(capsys, linear, "fab.toml", "--workers", "1", "--samples", "8", "-q", "span_mm")
    assert seen == {"positions": Positions((3e-3,), (1e-3, 3e-3), 0.3 * 1e-3, 1e-7), "table": "the table"}
    assert "found without doubt in 7 of 8; the others" in out
    assert "taken as known, as a reading has almost no information about it: dielectric" in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("-q", "foo"), "there is no quantity 'foo'"),
        (("--samples", "5"), "samples must be 0 or at least 8; got 5"),
        ((), "the limit worst ≤ 1 does not name an output"),
    ],
)
def test_mistakes_show_before_the_table_is_computed(capsys, monkeypatch, arguments, message):
    monkeypatch.setattr("coilarray.localize.forward.table_for", lambda *_, **__: pytest.fail("must come last"))
    limit = '[[limit]]\nquantity = "worst"\nat_most = 1\n' if not arguments else ""
    Path("places.toml").write_text(f"schema = 1\n{POSITIONS}{limit}", encoding="utf-8")
    assert message in refused(capsys, "starter", "places.toml", "--samples", "0", *arguments)


test_mistakes_are_one_line = mistakes(
    runner("tolerance", "--workers", "1", "--allow-violations")[1],
    (("loops.toml", "nothing.toml"), "there is no tolerance file nothing.toml"),
    (("loops.toml", "loops.toml"), "loops.toml: "),
    (("loops.toml", "--accuracy", "best"), "'best' is not one of"),
    (("loops.toml", "--workers", "2", "--cluster", "tcp://a:1"), "--workers is for processes on this machine"),
)


def test_positions_need_an_indenter(capsys):
    Path("places.toml").write_text(f"schema = 1\n{POSITIONS}", encoding="utf-8")
    line = refused(capsys, "loops.toml", "places.toml", "--allow-violations")
    assert "positions need [indenter] and [indentation]" in line
