"""``coilarray check``: limits of a house, what it prints and writes, exit codes, and one line for every mistake."""

import csv
import functools
import json
import re
from pathlib import Path

import pytest
from support.command_line import mistakes, runner, successes

from coilarray import load_design
from coilarray.compute.table import Column
from coilarray.design import fabs
from coilarray.design.bundled import read
from coilarray.design.fabs import load_profile
from coilarray.geometry import check_rules

pytestmark = pytest.mark.usefixtures("own_folder")
run, refused = runner("check")
good, answer = successes("check")


def rows_of(out):
    """Rows of the printed table by their number: rule, layer and the rest."""
    lines = ([cell.strip() for cell in line.replace("✖ ", "").split("  ") if cell.strip()] for line in out.splitlines())
    return {int(cells[0]): cells[1:] for cells in lines if len(cells) > 3 and cells[0].isdigit()}


def changed(old, new):
    """Write the starter design with another passage."""
    text = read("starter")
    assert old in text
    Path("d.toml").write_text(text.replace(old, new), encoding="utf-8")
    return "d.toml"


def named(layers):
    """Name the layers L1, L2, … of the starter as a row does."""
    layers = sorted(layers)
    return f"{layers[0]}–{layers[-1]}" if len(layers) > 2 else ", ".join(layers)


@functools.cache
def margins(name, profile=None):
    """Margins of a bundled design to the limits of a profile, by default to its own."""
    design = load_design(name)
    return check_rules(design.array, design.rules if profile is None else load_profile(profile).rules)


@pytest.mark.slow
def test_a_kept_design(capsys):
    out, found = good(capsys, "starter"), margins("starter")
    assert "margins to the limits of the design" in out
    assert out.startswith("✔ Can be made")
    printed = rows_of(out)
    # one row for each rule and layer, the worst of it, in order and numbered from 1; one where layers have the same
    smallest, first, layers = {}, {}, {}
    for margin in found:
        smallest.setdefault((margin.rule, margin.layer), margin)
    for margin in smallest.values():
        row = margin.rule, round(margin.value * 1e9), round(margin.limit * 1e9)
        first.setdefault(row, margin)
        layers.setdefault(row, []).append(margin.layer)
    assert len(first) < len(smallest)
    assert list(printed) == list(range(1, len(first) + 1))
    assert [row[:2] for row in printed.values()] == [[row[0], named(layers[row])] for row in first]
    for row, margin in zip(printed.values(), first.values(), strict=True):
        assert row[2] == margin.feature
        numbers = [margin.value * 1e3, margin.limit * 1e3, margin.margin * 1e3]
        assert [float(cell.replace("−", "-")) for cell in row[3:6]] == pytest.approx(numbers, abs=0.5e-3)  # to 1 µm
    # in the order that the title says
    kinds = [2 if one.feature == "board" else one.unit != "m" for one in first.values() if one.kept]
    assert "the worst first, the bare board last" in " ".join(out.split())
    assert kinds == sorted(kinds)
    assert f"… and {len(found) - len(smallest)} more (--all)" in out
    every = good(capsys, "starter", "--all")
    assert "(--all)" not in every
    assert len(rows_of(every)) == len(found)


@pytest.mark.lowest
def test_no_number_is_minus_zero(capsys):
    """Places of symmetric coils lie within rounding of the axes, on either side."""
    out = good(capsys, "gast_fem", "--all") + good(capsys, "gast_fem")
    assert not re.search(r"−0\.0*(\s|$)", out)
    assert Column("x", unit="m").texts([-2e-19, -5.1e-7]) == ["0.000", "−0.001"]


@pytest.mark.slow
def test_the_limits_of_a_house(capsys):
    def broken_of(house):
        code, out, err = run(capsys, "gast2020", "--fab", house)
        assert (code, len(err.splitlines())) == (2, 1)
        # the gap of the calibration is the furthest below its limit
        assert err.startswith("coilarray: error: spacing within net of coil")
        return out, {row[0] for row in rows_of(out).values() if any(cell.startswith("−") for cell in row[3:6])}

    out, broken = broken_of("oshpark-4-layer")
    assert "margins to the limits of OSH Park, 4 layers" in out
    # the paper's 0.1 mm traces are finer than 5 mil, its 0.2 mm holes than 10 mil, and 35 um is more than 0.5 oz
    assert broken == {"drill", "trace width", "spacing within net", "copper thickness, at most"}
    assert broken_of("multi-cb-35um")[1] == {"spacing within net"}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["oshpark-4-layer", "jlcpcb-2-layer"])
def test_the_exit_code_is_2_where_a_rule_is_broken(capsys, name):
    kept = all(margin.kept for margin in margins("starter", name))
    assert run(capsys, "starter", "--fab", name)[0] == (0 if kept else 2)
    assert ("limits are broken" in good(capsys, "starter", "--fab", name, "--allow-violations")) is not kept


@pytest.mark.slow
def test_json(capsys):
    code, out, err = run(capsys, "gast2020", "--json", "--fab", "jlcpcb-4-layer")
    assert code == 2  # and the numbers nevertheless
    assert len(err.splitlines()) == 1
    data, profile = json.loads(out), load_profile("jlcpcb-4-layer")
    assert data["design_hash"] == load_design("gast2020").digest
    assert data["fab"]["read"] == profile.read.isoformat()
    assert [(source["title"], source["url"]) for source in data["fab"]["sources"]] == list(profile.sources)
    assert data["fab"]["assumed"] == profile.assumed
    for row, margin in zip(data["rules"], margins("gast2020", profile.name), strict=True):
        assert (row["rule"], row["margin"], row["kept"]) == (margin.rule, margin.margin, margin.kept)
        assert row["unit"] == (margin.unit or "1")
    assert answer(capsys, "starter")["fab"] is None


@pytest.mark.slow
def test_files_are_written_even_where_a_rule_is_broken(capsys):
    """The picture has the numbers of the table."""
    code, out, _ = run(capsys, "starter", "--fab", "oshpark-4-layer", "--out", "m.csv", "--picture", "m.svg")
    assert code == 2
    assert "wrote m.csv\nwrote m.svg\n" in out
    assert sorted(path.name for path in Path().iterdir()) == ["m.csv", "m.svg"]
    rows = csv.DictReader(Path("m.csv").read_text(encoding="utf-8").splitlines())
    assert [float(row["margin"]) for row in rows] == [one.margin for one in margins("starter", "oshpark-4-layer")]
    text = Path("m.svg").read_text(encoding="utf-8")
    assert text.startswith("<?xml")
    first = next(number for number, row in rows_of(out).items() if row[0] == "drill")
    labels = [part.split('"')[0] for part in text.split('id="')[1:]]
    assert any(str(first) in label.split(", ") for label in labels)


def test_list_fabs(capsys):
    out = good(capsys, "no_such_design", "--list-fabs")
    for name in fabs.names():
        profile = load_profile(name)
        (line,) = (line for line in out.splitlines() if line.startswith(f"{name} "))
        assert profile.title in line
        assert profile.read.isoformat() in line


test_mistakes_are_one_line_and_leave_no_file = mistakes(
    refused,
    (("starter", "--fab", "x"), f"--fab must be one of {', '.join(fabs.names())}; got 'x'."),
    (("starter", "--fab", ""), "--fab must be one of "),
    (("starter", "--out", "a" * 300 + ".csv"), "a.csv: File name too long."),
)
