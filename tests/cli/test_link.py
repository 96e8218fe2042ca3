"""The command ``link``: the numbers of the library, and one line for every mistake."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support.command_line import runner, successes

from coilarray import Array, Design, Spiral, load_design
from coilarray.design.write import design_text
from coilarray.studies.link import columns, link, pose_grid

pytestmark = pytest.mark.usefixtures("own_folder", "own_store")
_, refused = runner("link", "reader.toml")
good, answer = successes("link", "reader.toml")

PLACED = """
[[boards]]
name = "tag"
design = "tag.toml"
z_mm = 8.0
turn_deg = [0, 10, 0]
"""
UP = ("--move", "tag", "--z-mm", "6:12:3")


@pytest.fixture(autouse=True)
def files(own_folder):
    reader = Design(Array.row(Spiral(4, 20e-3, 3, 0.5e-3, 0.5e-3), 1), name="reader")
    tag = Design(Spiral(6, 12e-3, 4, 0.3e-3, 0.3e-3).as_array(), name="tag")
    Path("tag.toml").write_text(design_text(tag), encoding="utf-8")
    Path("reader.toml").write_text(design_text(reader) + PLACED, encoding="utf-8")


@pytest.mark.slow
def test_files_and_json_are_the_numbers_of_the_library(capsys):
    poses = pose_grid(z=np.array([6.0, 9.0, 12.0]) * 1e-3, turn_y=np.radians(10.0))
    expected = link(load_design("reader.toml"), {"tag": poses}, frequency=1e6)
    out = good(capsys, *UP, "--frequency-MHz", "1", "--out", "link.nc", "--plot", "link.svg")
    assert out.splitlines()[0].split()[:3] == ["z", "(mm)", "k"]  # of the only pair; the coordinate with its unit
    assert "U (V/A)" in out
    with xr.open_dataset("link.nc", engine="h5netcdf") as saved:
        xr.testing.assert_allclose(saved.load(), expected, rtol=1e-12)
    assert Path("link.svg").read_text(encoding="utf-8").startswith("<?xml")
    assert "--force" in refused(capsys, *UP, "--out", "link.nc")
    data = answer(capsys, *UP, "--frequency-MHz", "1", "--out", "link.csv", "--force")
    flat = columns(expected)
    assert [row["z_mm"] for row in data["poses"]] == [6.0, 9.0, 12.0]
    for name in flat.data_vars:
        np.testing.assert_allclose([row[name] for row in data["poses"]], flat[name].values, rtol=1e-12)
    assert Path("link.csv").read_text(encoding="utf-8").splitlines()[0].startswith('z_mm,"M_uH[coil1')


def test_many_poses_are_shown_by_their_extremes(capsys):
    out = good(capsys, "--move", "tag", "--x-mm", "-8:8:1", "--y-mm", "-1,0,1")
    assert "smallest" in out
    assert "51 poses" in out
    assert "--frequency-MHz" in out  # without it there are k and M only


def test_several_pairs_have_rows_and_not_columns(capsys):
    reader = Design(Array.row(Spiral(4, 20e-3, 3, 0.5e-3, 0.5e-3), 3, 25e-3), name="reader")
    Path("reader.toml").write_text(design_text(reader) + PLACED, encoding="utf-8")
    lines = good(capsys, "--move", "tag", "--z-mm", "6,9").splitlines()
    assert lines[0].split()[:3] == ["z", "(mm)", "pair"]
    assert [line.split()[0] for line in lines[1:7]] == ["6", "6", "6", "9", "9", "9"]
    assert not lines[7][:1].isdigit()  # one block


def test_a_single_pose_is_a_row(capsys):
    (row,) = answer(capsys, "--move", "tag", "--x-mm", "3", "--plot", "one.png")["poses"]
    assert row["z_mm"] == 8.0


BAD = {
    "a step of zero": (("--move", "tag", "--z-mm", "1:20:0"), "1:20:0"),
    "a step away from the end": (("--move", "tag", "--z-mm", "1:20:-1"), "1:20:-1"),
    "too many": (("--move", "tag", "--z-mm", "0:1:1e-9"), "1e-9"),
    "not a number": (("--move", "tag", "--z-mm", "high"), "high"),
    "not finite": (("--move", "tag", "--z-mm", "1:inf:1"), "inf"),
    "not finite alone": (("--move", "tag", "--turn-deg", "0,nan,0"), "nan"),
    "one angle": (("--move", "tag", "--turn-deg", "90"), "--turn-deg"),
    "twice the same": (("--move", "tag", "--x-mm", "1,1"), "1,1"),
    "unknown board": (("--move", "antenna", "--z-mm", "5"), "antenna"),
    "no board": (("--z-mm", "5"), "--move"),
    "no place": (("--move", "tag"), "--z-mm"),
    "cut through": (("--move", "tag", "--z-mm", "0.1"), "pose 1"),
    "a frequency of zero": ((*UP, "--frequency-MHz", "0"), "frequency"),
}


@pytest.mark.parametrize(("options", "says"), BAD.values(), ids=BAD)
def test_mistakes_are_one_line(capsys, options, says):
    assert says in refused(capsys, *options)
    assert not Path("link.nc").exists()


@pytest.mark.slow
def test_a_page_has_a_slider_over_the_poses(capsys):
    good(capsys, *UP, "--film", "motion.html")
    page = Path("motion.html").read_text(encoding="utf-8")
    assert "z = 12 mm" in page
    assert "--film" in refused(capsys, *UP, "--film", "motion.avi")
