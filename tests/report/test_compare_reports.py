"""``benchmarks/compare_reports.py``: every changed number is printed, with its size, and nothing else."""

import json
import runpy
from pathlib import Path

import pytest
import xarray as xr

compare = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "compare_reports.py"))["main"]
ROWS = "coil,inductance_H,kept\na,1e-06,True\nb,2e-06,False\n"


def folder(path, *, rows=ROWS, data=None, values=(1.0, 0.0, float("nan")), name="B"):
    """A small report: one table, one JSON file, one array."""
    path.mkdir()
    (path / "parts.csv").write_text(rows, encoding="utf-8")
    content = {"provenance": {"date": str(path)}, "limits": [0.5, {"low": 1.0}], "coils": [{"coil": "a", "M_H": 3e-6}]}
    (path / "report.json").write_text(json.dumps({**content, **(data or {})}), encoding="utf-8")
    field = xr.Dataset({name: ("x", list(values))}, {"x": [1.0, 2.0, 3.0]}, {"design": "a", "date": str(path)})
    field.to_netcdf(path / "field.nc", engine="h5netcdf")
    return path


@pytest.fixture
def old(tmp_path):
    return folder(tmp_path / "old")


@pytest.mark.slow
@pytest.mark.parametrize(("changes", "lines"), [
    ({}, []),
    # rounding: of each number, and around zero of the largest one of its array
    ({"rows": ROWS.replace("2e-06", "2.000000000000001e-06"), "values": (1.0, 1e-13, float("nan"))}, []),
    # the order of rows and columns does not matter
    ({"rows": "inductance_H,coil,kept\n2e-06,b,False\n1e-06,a,True\n"}, []),
    ({"rows": ROWS.replace("2e-06", "2.2e-06")}, ["inductance_H [b, False #1]: 2e-06 → 2.2e-06 (+0.0909)"]),
    ({"rows": ROWS.replace(",inductance_H", ",L_H")}, ["missing column inductance_H", "new column L_H"]),
    ({"rows": ROWS + "c,3e-06,True\n"}, ["[c, True #1]"] * 3),
    ({"data": {"limits": [0.5, {"low": 1.1}]}}, ["limits.1.low: 1 → 1.1 (+0.0909)"]),
    ({"data": {"coils": [{"coil": "a", "M_H": 6e-6}]}}, ["coils.M_H [a #1]: 3e-06 → 6e-06 (+0.5)"]),
    ({"data": {"title": "new"}}, ["new entry title"]),
    ({"values": (2.0, 0.0, float("nan"))}, ["field.nc: B [0 of 3]: 1 → 2 (+0.5)"]),
    ({"values": (1.0, 0.0, 1.0)}, ["field.nc: B [2 of 3]: nan → 1"]),
    ({"name": "H"}, ["missing variable B", "new variable H"]),
])  # fmt: skip
def test_every_change_is_one_line(tmp_path, old, capsys, changes, lines):
    code = compare([str(old), str(folder(tmp_path / "new", **changes))])
    *printed, last = capsys.readouterr().out.splitlines()
    assert code == bool(lines)
    assert len(printed) == len(lines)
    assert all(expected in line for expected, line in zip(lines, printed, strict=True))
    assert last.startswith(f"{len(lines)} differences" if lines else "no number changed by more than 1e-09")


def test_names_and_tolerance_are_options(tmp_path, old, capsys):
    rows = ROWS.replace(",inductance_H", ",L_H").replace("2e-06", "2.02e-06")
    new = str(folder(tmp_path / "new", rows=rows))
    assert compare([str(old), new, "--rename", "parts.csv:inductance_H=L_H"]) == 1
    assert "L_H [b, False #1]" in capsys.readouterr().out
    assert compare([str(old), new, "--rename", "parts:inductance_H=L_H", "--tolerance", "0.02"]) == 0


def test_files_of_one_folder_are_named(tmp_path, old, capsys):
    new = folder(tmp_path / "new")
    (new / "parts.csv").rename(new / "pairs.csv")
    assert compare([str(old), str(new)]) == 1
    assert capsys.readouterr().out.splitlines()[:2] == ["missing file parts.csv", "new file pairs.csv"]
    (tmp_path / "empty").mkdir()
    assert compare([str(tmp_path / "empty"), str(new)]) == 1
