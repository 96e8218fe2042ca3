"""``coilarray target`` and what `locate` makes of its file: one coil below a ball."""

import csv
from pathlib import Path

import pytest
import xarray as xr
from support.command_line import runner, successes
from support.contacts import few_turns

from coilarray import load_design, target_map

pytestmark = pytest.mark.slow

good, answer = successes()
run, refused = runner()

TARGET = """[target]
shape = "sphere"
diameter_mm = 8
material = "aluminium"
distances_mm = [1, 2, 3, 4, 6]
x_mm = [0, 0]
y_mm = [0, 0]
step_mm = 1

[field]
"""


@pytest.fixture
def ball(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = few_turns("gast_fem")
    bare = text.partition("[[elastomer]]")[0]
    rest = "[circuit]" + text.partition("[circuit]")[2].partition("[assumed]")[0]
    Path("ball.toml").write_text(bare + rest.replace("[field]\n", TARGET), encoding="utf-8")


def test_the_files_and_the_output_have_the_numbers_of_the_map(ball, capsys):
    data = answer(capsys, "target", "ball.toml", "--ideal", "--out", "t.csv")
    expected = target_map(load_design("ball.toml"), network="ideal")
    assert (data["body"], data["material"], data["noise"]) == ("sphere", "aluminium", expected.attrs["sigma"])
    delta = expected.delta.values.ravel()
    assert [row["delta"] for row in data["target"]] == pytest.approx(delta)
    (base,) = data["target_base"]
    assert base["base_frequency_Hz"] == pytest.approx(float(expected.base_frequency[0]))
    change = [(1 + d) ** -0.5 - 1 for d in delta]  # f is 1/(2π√(LC)), and C stays
    assert [row["frequency_change"] for row in data["target"]] == pytest.approx(change)
    with Path("t.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["delta"]) for row in rows] == pytest.approx(delta)
    assert [float(row["base_frequency_Hz"]) for row in rows] == pytest.approx([base["base_frequency_Hz"]] * len(rows))
    assert [float(row["frequency_change"]) for row in rows] == pytest.approx(change)
    assert [float(row["quality_factor"]) for row in rows] == pytest.approx(expected.quality_factor.values.ravel())
    assert data["target_range"][0]["range_m"] == pytest.approx(float(expected.range[0]))
    assert data["target_coupling"] == []  # one coil
    good(capsys, "target", "ball.toml", "--ideal", "--distance-mm", "1:3:5", "--plot", "t.png")
    assert sorted(path.name for path in Path().iterdir()) == ["ball.toml", "t.csv", "t.png", "target.nc"]
    with xr.open_dataset("target.nc", engine="h5netcdf") as kept:
        reading = float(kept.delta.sel(distance=2e-3, method="nearest").squeeze())
    out = good(capsys, "locate", "--model", "target.nc", f"coil1={reading}")
    assert "distance (mm)" in out
    assert "2.000" in out
    assert "target.nc must have delta over depth" in refused(capsys, "paper", "fit", "target.nc")
    (quick,) = answer(capsys, "target", "ball.toml", "--ideal", "--distance-mm", "1", "--accuracy", "screen")["target"]
    assert quick["delta"] == pytest.approx(delta[0], rel=1e-2)  # 1e-3 of L and of its change, which nearly cancel
    assert quick["delta"] != pytest.approx(delta[0], rel=1e-9)
    assert sorted(path.name for path in Path().glob("target*")) == ["target.nc"]  # of the command without --json


def test_what_is_wrong_is_one_line(ball, capsys):
    line = refused(capsys, "target", "gast_fem")
    assert "the design gast_fem has no [target]: add one, for example with shape" in line
    assert all(load_design(name).target for name in line.rstrip(".").partition("have one are ")[2].split(", "))
    # without DESIGN: a distance is refused only where there is a target
    assert "rising numbers of mm, above 0" in refused(capsys, "target", "--distance-mm", "0,1")
    assert "--noise must be above 0 and at most 1; got 0" in refused(
        capsys, "target", "ball.toml", "--ideal", "--noise", "0"
    )
    assert "--distance-mm must be rising numbers of mm, above 0" in refused(
        capsys, "target", "ball.toml", "--distance-mm", "0,1"
    )
    assert "--out must end in .nc or .csv" in refused(capsys, "target", "ball.toml", "--out", "t.txt")
