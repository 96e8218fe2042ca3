"""``coilarray check``: limits of a house, what it prints and writes, exit codes, and one line for every mistake."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import pytest
from support.command_line import runner

from coilarray import load_design
from coilarray.design import fabs
from coilarray.design.bundled import read
from coilarray.design.fab_limits import load_profile
from coilarray.geometry import check_rules
from coilarray.report.tables import Column

pytestmark = pytest.mark.usefixtures("own_folder")
run, _ = runner("check")


def rows_of(out):
    """Rows of the printed table by their number: rule, layer and the rest."""
    rows = {}
    for line in out.splitlines():
        cells = [cell.strip() for cell in line.split("  ") if cell.strip()]
        if len(cells) > 3 and cells[0].isdigit():
            rows[int(cells[0])] = cells[1:]
    return rows


def changed(old, new):
    """Write the starter design with another passage."""
    text = read("starter")
    assert old in text
    Path("d.toml").write_text(text.replace(old, new), encoding="utf-8")
    return "d.toml"


@pytest.mark.slow
def test_a_kept_design(capsys):
    code, out, err = run(capsys, "starter")
    assert (code, err) == (0, "")
    assert "margins to the limits of the design" in out
    assert "all margins are kept" in out
    margins = check_rules(load_design("starter").array, load_design("starter").rules)
    printed = rows_of(out)
    # one row for each rule and layer, the worst of it, in order and numbered from 1
    first = {}
    for margin in margins:
        first.setdefault((margin.rule, margin.layer), margin)
    assert list(printed) == list(range(1, len(first) + 1))
    assert [(row[0], row[1]) for row in printed.values()] == list(first)
    for row, margin in zip(printed.values(), first.values(), strict=True):
        assert row[2] == margin.feature
        assert [float(cell.replace("−", "-")) for cell in row[3:6]] == pytest.approx(
            [margin.value * 1e3, margin.limit * 1e3, margin.margin * 1e3],
            abs=0.5e-4,  # four digits of mm
        )
    assert f"… and {len(margins) - len(first)} more (--all)" in out
    assert "(--all)" not in run(capsys, "starter", "--all")[1]
    assert len(rows_of(run(capsys, "starter", "--all")[1])) == len(margins)


def test_no_number_is_minus_zero(capsys):
    """Places of symmetric coils lie within rounding of the axes, on either side."""
    out = run(capsys, "gast_fem", "--all")[1] + run(capsys, "gast_fem")[1]
    assert not re.search(r"−0\.0*(\s|$)", out)
    assert Column("x", unit="m").texts([-2e-19, -5.1e-7]) == ["0.000", "−0.001"]


@pytest.mark.slow
def test_the_limits_of_a_house(capsys):
    code, out, err = run(capsys, "gast2020", "--fab", "oshpark-4-layer")
    assert code == 2
    assert "margins to the limits of OSH Park, 4 layers" in out
    # the paper's 0.1 mm traces are finer than 5 mil, its 0.2 mm holes than 10 mil, and 35 um is more than 0.5 oz
    broken = {row[0] for row in rows_of(out).values() if any(cell.startswith("−") for cell in row[3:6])}
    assert broken == {"drill", "trace width", "spacing within net", "copper thickness"}
    assert len(err.splitlines()) == 1
    assert err.startswith("coilarray: error: drill of coil1 on layer L1 is 0.2 mm")
    assert run(capsys, "gast2020", "--fab", "multi-cb-35um")[0] == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", fabs.names())
def test_the_exit_code_is_2_where_a_rule_is_broken(capsys, name):
    kept = all(m.kept for m in check_rules(load_design("starter").array, load_profile(name).rules))
    assert run(capsys, "starter", "--fab", name)[0] == (0 if kept else 2)
    code, out, err = run(capsys, "starter", "--fab", name, "--allow-violations")
    assert (code, err) == (0, "")
    assert ("margins are broken" in out) is not kept


def test_limits_of_the_board_are_in_the_table(capsys):
    _, out, _ = run(capsys, "starter", "--fab", "jlcpcb-2-layer")
    assert ["layer count", "board", "4", "2", "−2"] in rows_of(out).values()
    _, out, _ = run(capsys, "starter", "--fab", "multi-cb-35um")
    (ratio,) = (row for row in rows_of(out).values() if row[0] == "aspect ratio")
    # 4 · 35 µm + 0.2 + 0.71 + 0.2 mm over 0.25 mm
    assert ratio[3:6] == ["5", "10", "5"]


def test_option_goes_before_the_file(capsys):
    file = changed("[fab]", '[fab]\nprofile = "oshpark-4-layer"\n#')
    _, out, _ = run(capsys, file)
    assert "margins to the limits of OSH Park, 4 layers" in out
    code, out, _ = run(capsys, file, "--fab", "multi-cb-35um", "--json")
    assert code == 0
    assert json.loads(out)["fab"]["profile"] == "multi-cb-35um"


@pytest.mark.slow
def test_json(capsys):
    code, out, err = run(capsys, "gast2020", "--json", "--fab", "jlcpcb-4-layer")
    assert code == 2  # and the numbers nevertheless
    assert len(err.splitlines()) == 1
    data = json.loads(out)
    profile = load_profile("jlcpcb-4-layer")
    design = load_design("gast2020")
    assert data["design_hash"] == design.digest
    assert data["fab"]["read"] == profile.read.isoformat()
    assert [(source["title"], source["url"]) for source in data["fab"]["sources"]] == list(profile.sources)
    assert data["fab"]["assumed"] == profile.assumed
    margins = check_rules(design.array, profile.rules)
    assert len(data["rules"]) == len(margins)
    for row, margin in zip(data["rules"], margins, strict=True):
        assert (row["rule"], row["margin"], row["kept"]) == (margin.rule, margin.margin, margin.kept)
        assert row["unit"] == (margin.unit or "1")
    code, out, _ = run(capsys, "starter", "--json")
    assert code == 0
    assert json.loads(out)["fab"] is None


@pytest.mark.slow
def test_files_are_written_even_where_a_rule_is_broken(capsys):
    code, out, _ = run(capsys, "gast2020", "--fab", "aisler-4-layer", "--out", "m.csv", "--picture", "m.svg")
    assert code == 2
    assert "wrote m.csv\nwrote m.svg\n" in out
    assert sorted(path.name for path in Path().iterdir()) == ["m.csv", "m.svg"]
    with Path("m.csv").open(encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    margins = check_rules(load_design("gast2020").array, load_profile("aisler-4-layer").rules)
    assert [float(row["margin"]) for row in rows] == [margin.margin for margin in margins]
    assert Path("m.svg").read_text(encoding="utf-8").startswith("<?xml")


@pytest.mark.slow
def test_the_picture_has_the_numbers_of_the_table(capsys):
    _, out, _ = run(capsys, "starter", "--fab", "oshpark-4-layer", "--picture", "m.svg")
    text = Path("m.svg").read_text(encoding="utf-8")
    first = next(number for number, row in rows_of(out).items() if row[0] == "drill")
    labels = [part.split('"')[0] for part in text.split('id="')[1:]]
    assert any(str(first) in label.split(", ") for label in labels)


def test_list_fabs(capsys):
    code, out, err = run(capsys, "no_such_design", "--list-fabs")
    assert (code, err) == (0, "")
    for name in fabs.names():
        profile = load_profile(name)
        (line,) = (line for line in out.splitlines() if line.startswith(f"{name} "))
        assert profile.title in line
        assert profile.read.isoformat() in line


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("starter", "--fab", "x"), f"--fab must be one of {', '.join(fabs.names())}; got 'x'."),
        (("starter", "--fab", ""), "--fab must be one of "),
        (("starter", "--picture", "m.gif"), "--picture must end in .png, .svg or .pdf; got m.gif."),
        (("starter", "--picture", "no/m.png"), "cannot write no/m.png: there is no folder no."),
        (("starter", "--out", "m.json"), "--out must end in .csv; got m.json."),
        (("starter", "--out", "no/m.csv"), "cannot write no/m.csv: there is no folder no."),
        (("starter", "--out", "a" * 300 + ".csv"), "a.csv: File name too long."),
        (("none.toml",), "there is no design file none.toml"),
    ],
)
def test_mistakes_are_one_line_and_leave_no_file(capsys, arguments, message):
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert message in err
    assert list(Path().iterdir()) == []


def test_a_file_with_the_old_table(capsys):
    code, out, err = run(capsys, changed("[fab] ", "[rules] "))
    assert (code, out) == (2, "")
    assert err == "coilarray: error: d.toml: the file has a table [rules], which is now called [fab].\n"


def test_a_file_with_an_unknown_profile(capsys):
    code, out, err = run(capsys, changed("[fab]", '[fab]\nprofile = "osh"\n#'))
    assert (code, out) == (2, "")
    assert err == f"coilarray: error: d.toml: fab has no profile 'osh'; there are {', '.join(fabs.names())}.\n"
