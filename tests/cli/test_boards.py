"""Commands on a design of two boards: all coils, or one line that names the other board."""

import json

import pytest

from coilarray.cli.main import main
from coilarray.design.model import Design
from coilarray.design.write import design_text
from coilarray.geometry import Spiral
from coilarray.geometry.array import Array


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """File of two facing coils."""
    folder = tmp_path_factory.mktemp("pair")
    alone = design_text(Design(Array.row(Spiral(6, 12e-3, 4, 0.2e-3, 0.2e-3), 1), name="reader"))
    (folder / "tag.toml").write_text(alone)
    placed = '\n[[boards]]\nname = "tag"\ndesign = "tag.toml"\nz_mm = 8.0\nturn_deg = [180, 0, 0]\n'
    (folder / "pair.toml").write_text(alone + placed)
    return str(folder / "pair.toml")


def test_check_knows_each_board_and_the_clearance_between_them(pair, capsys):
    assert main(["check", pair, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    layers = {row["layer"] for row in found["rules"]}
    assert {"L1", "tag/L1"} <= layers
    # their upper faces face each other
    (between,) = found["board_clearances"]
    assert (between["board"], between["other"]) == ("reader", "tag")
    assert between["clearance_m"] == pytest.approx(8e-3, abs=1e-9)


@pytest.mark.slow
def test_the_pose_of_a_board_is_swept(pair, tmp_path, capsys):
    out = tmp_path / "k.csv"
    command = ["sweep", pair, "--vary", "boards.tag.z_mm=5:20:2", "--quantity", "k[coil1,tag/coil1]", "--out", str(out)]
    assert main([*command, "--accuracy", "screen"]) == 0
    near, far = (abs(float(line.split(",")[1])) for line in out.read_text().splitlines()[1:])
    assert 0.003 < far < near < 0.4


ONE_BOARD = (
    "calibrate {} data.nc", "paper distortion {}", "optimize {} --goal decouple",
    "check {} --picture p.png",
)  # fmt: skip


@pytest.mark.parametrize("command", ONE_BOARD)
def test_commands_of_one_board_name_the_other(pair, command, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(command.format(pair).split(" ")) == 2
    said = capsys.readouterr().err
    assert "reader" in said
    assert "board" in said
    assert not list(tmp_path.iterdir())
