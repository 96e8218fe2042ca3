"""The commands measure, campaign and info, on an emulated board of two coils."""

import contextlib
import io
import json
import shutil

import numpy as np
import pytest
from support import recorded_boards, refusals
from support.command_line import runner, successes, toml_file

from coilarray.cli.board import measure as measure_command
from coilarray.cli.main import main
from coilarray.compute.netcdf import load_part
from coilarray.errors import HardwareError
from coilarray.hardware.board.direct import DirectReader
from coilarray.hardware.record.recording import open_recording

pytestmark = pytest.mark.slow

board = recorded_boards.board
measure, measure_record = successes("board", "measure")
measure_campaign, campaign_record = successes("board", "campaign")
scan_info, scan_info_record = successes("board", "info")
measure_refused, campaign_refused, scan_info_refused = (
    runner("board", one)[1] for one in ("measure", "campaign", "info")
)
locate, _ = runner("locate")
COIL1 = -6.64  # mm on the board along x: the origin of the map
GRID = {"x_mm": [-9.64, -6.64, -3.64], "y_mm": [0.0, 2.0], "depth_mm": [0.5, 1.0]}


@pytest.fixture(scope="module")
def grid(tmp_path_factory):
    """Option for a plan of a small campaign."""
    return "--plan", toml_file(tmp_path_factory.mktemp("plan") / "plan.toml", **GRID)


@pytest.fixture(scope="module")
def measured(board, grid, tmp_path_factory):
    """A campaign as the command records it."""
    path = tmp_path_factory.mktemp("campaign") / "campaign.sqlite"
    assert main(["board", "campaign", *map(str, (*board, *grid)), "--out", str(path)]) == 0
    return path


@pytest.fixture
def campaign(measured, tmp_path, capsys):
    return shutil.copy(measured, tmp_path / "campaign.sqlite")


def test_the_plan_of_a_campaign(board, grid, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # pressing and lifting take (0.5 + 1) mm · 2/(1.5 mm/s) for both depths, dwelling 2 · 0.5 s, at 6 positions
    text = "3 × 2 positions, 2 depths, 1 repeats: 12 indentations, at least 0.3 min without scans and travel"
    assert measure_campaign(capsys, *board, *grid, "--dry-run") == f"{text}\n"
    assert campaign_record(capsys, *board, *grid, "--dry-run")["least_seconds"] == pytest.approx(6 * 3.0)
    assert list(tmp_path.iterdir()) == []


def all_marked(text):
    return bool(text) and all(line.startswith("[emulator]") for line in text.splitlines())


def test_single(board, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    out = measure(capsys, *board, "--single", "--emulate", "noise=0")
    assert all_marked(out)
    assert [line.split()[1] for line in out.splitlines()] == ["emulator:", "state", "coil1", "coil2"]
    only = toml_file(tmp_path / "only.toml", states=["coil2"])
    pressed = measure_record(capsys, *board, "--single", "--settings", only, "--emulate", "press=0,0,1")
    assert pressed["emulated"] is True
    (state,) = pressed["states"]
    assert (state["state"], state["verdict"], state["reasons"]) == ("coil2", "good", [])
    assert list(tmp_path.iterdir()) == [only]  # no file


def test_a_rate_that_is_not_reached_is_reported(board, tmp_path, capsys, monkeypatch):
    options = (*board, "--scans", 20, "--rate", 20, "--out")
    assert measure_record(capsys, *options, tmp_path / "a.sqlite")["rate_per_s"] == pytest.approx(20, rel=0.02)
    assert "asked for" not in measure(capsys, *options, tmp_path / "b.sqlite")
    slow = DirectReader.scan  # a board that takes its time between two scans

    def scans(self, interval=0.0):
        while True:
            self._clock.sleep(0.01)
            yield slow(self)

    monkeypatch.setattr(DirectReader, "scans", scans)
    out = measure(capsys, *options, tmp_path / "c.sqlite")
    (line,) = [line for line in out.splitlines() if "asked for" in line]
    assert line.startswith("[emulator] the board reached 16.")  # 50 ms and 10 ms
    assert line.endswith(" scans/s; --rate asked for 20")


def test_stream(board, tmp_path, capsys):
    path = tmp_path / "run.sqlite"
    out = measure(capsys, *board, "--scans", 12, "--out", path)
    assert all_marked(out)
    assert "12 scans of 2 states" in out
    for scans in ([12, 8], [12, 8, 0]):  # the 12 count
        found = measure_record(capsys, *board, "--scans", 20, "--out", path, "--resume")
        assert (found["scans"], found["emulated"]) == (20, True)
        assert [session["scans"] for session in found["sessions"]] == scans
    assert [one.name for one in tmp_path.iterdir()] == ["run.sqlite"]


def test_campaign(board, grid, campaign, tmp_path, capsys):
    out = scan_info(capsys, campaign, "--out", tmp_path / "campaign.nc")
    assert all_marked(out)
    assert "campaign: 12 of 12 positions are measured" in out
    assert [line for line in out.splitlines() if "self-test" in line] == ["[emulator] self-test passed"] * 2
    response = load_part(tmp_path / "campaign.nc")
    assert (response.delta.shape, response.attrs["emulated"]) == ((2, 2, 3, 2), 1)
    assert scan_info_record(capsys, campaign, "--out", tmp_path / "long.csv")["campaign"] == {
        "positions": 12, "measured": 12, "x_m": [-0.003, 0.0, 0.003], "y_m": [0.0, 0.002],
        "depths_m": [0.0005, 0.001], "repeats": 1, "scans": 1, "dwell_s": 0.5, "speed_m_per_s": 0.0015,
    }  # fmt: skip
    lines = (tmp_path / "long.csv").read_text().splitlines()
    assert lines[0] == "depth_m,y_m,x_m,state,delta,delta_std,checksum"
    assert len(lines) == 1 + response.delta.size + 1  # the last line has the checksum
    before = campaign.read_bytes()
    # nothing is left to measure
    assert all_marked(measure_campaign(capsys, *board, *grid, "--out", campaign, "--resume"))
    with open_recording(campaign) as recording:
        assert recording.count() == 24
    assert before != campaign.read_bytes()  # but that it was tried


@pytest.fixture
def stuck(monkeypatch):
    """Let a switch to ground stay open, which changes L by little: every scan is good."""
    opened_board = measure_command.opened_board

    @contextlib.contextmanager
    def with_fault(*arguments, **options):
        with opened_board(*arguments, **options) as (opened, settings):
            chain = opened.emulator.chain
            chain.stick(*chain.find(1, 0, "ground"), "open")
            yield opened, settings

    monkeypatch.setattr(measure_command, "opened_board", with_fault)


def test_a_campaign_on_a_board_with_a_stuck_switch_is_refused(board, grid, stuck, tmp_path, capsys):
    path = tmp_path / "run.sqlite"
    line = campaign_refused(capsys, *board, *grid, "--out", path)
    assert "the self-test before the campaign has failed: " in line
    assert line.endswith("or continue with --ignore-self-test.")
    assert list(tmp_path.iterdir()) == []
    out = measure_campaign(capsys, *board, *grid, "--out", path, "--ignore-self-test")
    assert out.count("[emulator] self-test failed: ") == 2
    found = scan_info_record(capsys, path)
    assert [test["passed"] for test in found["self_tests"]] == [False, False]
    assert any("stays open" in text for text in found["self_tests"][0]["findings"])
    assert {state["bad"] for state in found["states"]} == {0}  # the scans do not tell


def test_series_for_locate(board, tmp_path, capsys):
    run = tmp_path / "run.sqlite"
    measure(capsys, *board, "--scans", 40, "--out", run)
    measure(capsys, *board, "--scans", 42, "--out", run, "--resume", "--emulate", "press=-4.64,1,0.8")
    for ending in ("csv", "nc"):
        scan_info(capsys, run, "--out", tmp_path / f"run.{ending}", "--baseline", 20)
    series = load_part(tmp_path / "run.nc")
    assert series.delta.sel(state="coil1")[-1] > 1e-4
    assert np.abs(series.delta[:20]).max() < 5e-6
    rows = (tmp_path / "run.csv").read_text().splitlines()
    assert rows[0] == "time_s,coil1,coil2,temperature_C,checksum"
    # a part of the file, which has no checksum then
    (tmp_path / "last.csv").write_text("".join(row.rpartition(",")[0] + "\n" for row in (rows[0], rows[-2])))
    # a recorded reading on the table of a recorded campaign of that depth: the position comes out
    x, y = np.linspace(COIL1 - 6, COIL1 + 6, 7).tolist(), np.linspace(-4, 4, 5).tolist()
    plan = toml_file(tmp_path / "plan.toml", x_mm=x, y_mm=y, depth_mm=[0.8])
    measure_campaign(capsys, *board, "--plan", plan, "--out", tmp_path / "map.sqlite")
    scan_info(capsys, tmp_path / "map.sqlite", "--out", tmp_path / "map.nc")
    code, out, err = locate(capsys, "--model", tmp_path / "map.nc", tmp_path / "last.csv", "--noise", 1e-6, "--json")
    assert code == 0
    assert all_marked(err)  # that the map is of an emulator
    (position,) = json.loads(out)["positions"]
    assert float(load_part(tmp_path / "map.nc").attrs["origin_x"]) == pytest.approx(COIL1 * 1e-3)
    assert position["x_m"] == pytest.approx(-4.64e-3, abs=0.1e-3)  # a cubic through steps of 2 mm
    assert abs(position["y_m"]) == pytest.approx(1e-3, abs=0.2e-3)  # both coils are symmetric in y


def test_never_overwritten(board, grid, campaign, tmp_path, capsys):
    before = campaign.read_bytes()
    line = measure_refused(capsys, *board, "--out", campaign)
    assert line.endswith(f"{campaign} already is a recording, of 24 scans; resume it or name another file.")
    assert "it is of a campaign" in measure_refused(capsys, *board, "--out", campaign, "--resume")
    twice = toml_file(tmp_path / "plan.toml", **GRID, repeats=2)
    for other, message in (
        (("--plan", twice), "it is of another campaign"),
        ((*grid, "--rate", 20), "its hash of settings was"),
    ):
        assert message in campaign_refused(capsys, *board, *other, "--out", campaign, "--resume")
    assert campaign.read_bytes() == before
    foreign = tmp_path / "notes.txt"
    foreign.write_text("my notes\n" * 1000)
    assert "is not a recording" in measure_refused(capsys, *board, "--out", foreign)
    assert foreign.read_text() == "my notes\n" * 1000
    assert sorted(one.name for one in tmp_path.iterdir()) == ["campaign.sqlite", "notes.txt", "plan.toml"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--single", "--scans", 3], "--single and --scans cannot be given together"),
        (["--scans", 3, "--seconds", 3], "--scans and --seconds cannot be given together"),
        (["--scans", 0], "--scans must be 1 to"),
        (["--seconds", "nan"], "--seconds must be positive"),
        (["--single", "--resume"], "--resume is not for --single"),
        (["--wiring", "no.toml"], "no.toml"),
        (["--rate", 0], "--rate must be positive"),
        (["--rate", 1e9], "rate"),
        (["--emulate", "seed=1", "--port", "COM5"], "--emulate is for the emulator"),
        (
            ["--emulate", "colour=1"],
            "--emulate must be KEY=VALUE with a key of seed, noise, drift, clock_MHz, press",
        ),
        (["--emulate", "seed"], "--emulate must be KEY=VALUE"),
        *((["--emulate", f"seed={seed}"], "--emulate seed must be a whole number") for seed in ("-1", "9" * 30)),
        (["--emulate", "noise=nan"], "--emulate noise must be a finite number of at least 0"),
        (["--emulate", "drift=fast"], "--emulate drift must be a finite number"),
        (["--emulate", "press=1,2,-3"], "--emulate press must be 3 finite numbers, the last of at least 0"),
        (["--emulate", "press=0,0,1", "--emulate", "press=0,0,1"], "--emulate must give press once"),
        (["--out", "no/folder/run.sqlite"], "cannot write no/folder/run.sqlite: there is no folder no/folder"),
        (["--out", "."], "cannot write .: it is a folder"),
    ],
)
def test_bad_input(board, tmp_path, capsys, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert message in measure_refused(capsys, *board, *arguments)
    assert list(tmp_path.iterdir()) == []  # nothing is made


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"states": ["coil9"]}, "has no state 'coil9'"),
        ({"states": ["coil1", "coil1"]}, "named once"),
        ({"clock_MHz": 60.0}, "clock_MHz must be 35 to 55 of the converter's own oscillator; got 60."),
        ({"external_clock": True}, "must have clock_MHz beside external_clock"),
        ({"drive": 32}, "drive must be at most 31; got 32"),
        ({"drives": {"coil7": 3}}, "a drive names the coil 'coil7'"),
        ({"discard": 16}, "discard must be at most 15; got 16"),
        ({"colour": 1}, "has no key 'colour'"),
    ],
)
def test_bad_settings(board, tmp_path, capsys, settings, message):
    path = toml_file(tmp_path / "settings.toml", **settings)
    line = measure_refused(capsys, *board, "--settings", path, "--out", tmp_path / "run.sqlite")
    assert message in line
    assert list(tmp_path.iterdir()) == [path]


STAGE = {"machine": "grbl", "port": "COM4", "x_mm": [0.0, 1.0], "y_mm": [0.0, 1.0], "depth_mm": 1.0}


@pytest.mark.parametrize(
    ("plan", "options", "message"),
    [
        ({"x_mm": [3.0, 1.0]}, (), "x of a campaign must be finite and rising"),
        ({"depth_mm": [0.0]}, (), "depths of a campaign must be positive"),
        ({"repeats": 0}, (), "repeats must be at least 1; got 0"),
        ({"speed_mm_s": 0.0}, (), "speed_mm_s must be greater than 0"),
        ({"x_mm": [0.0, 500.0]}, (), "x of the emulated indenter must be"),
        ({"stage": STAGE}, (), "stage is for a real board"),
        ({"stage": {**STAGE, "machine": "robot"}}, ("--port", "COM5"), "stage.machine must be 'grbl' or 'marlin'"),
        ({"stage": {**STAGE, "port": "COM5"}}, ("--port", "COM5"), "stage.port and --port must be different"),
        ({"stage": {**STAGE, "x_mm": [0.0]}}, ("--port", "COM5"), "stage.x_mm must have at least 2 entries"),
        ({}, ("--yes",), "--yes is for a G-code stage"),
    ],
)
def test_bad_campaigns(board, tmp_path, capsys, monkeypatch, plan, options, message):
    monkeypatch.chdir(tmp_path)
    path = toml_file(tmp_path / "plan.toml", **plan)
    assert message in campaign_refused(capsys, *board, "--plan", path, *options)
    assert list(tmp_path.iterdir()) == [path]  # nothing is made


@pytest.mark.parametrize(
    ("typed", "message"),
    [("y\n", None), ("Yes\n", None), *[(no, "not confirmed") for no in ("\n", "n\n")], ("", "no answer")],
)
def test_a_move_of_the_stage_is_confirmed_by_a_yes_only(capsys, monkeypatch, typed, message):
    monkeypatch.setattr("sys.stdin", io.StringIO(typed))
    if message is None:
        measure_command._agree("It will move.")
    else:
        refusals.refused(HardwareError, message, measure_command._agree, "It will move.")
    assert capsys.readouterr().err == "It will move. [y/N] "


def test_a_design_of_other_coils(board, tmp_path, capsys):
    line = measure_refused(capsys, "gast2020", *board[1:], "--out", tmp_path / "run.sqlite")
    assert "has no coil 'coil3' of the design gast2020" in line
    assert list(tmp_path.iterdir()) == []


def test_bad_conversions(campaign, tmp_path, capsys):
    for arguments, message in (
        ((tmp_path / "nothing.sqlite",), "there is no file"),
        ((tmp_path,), f"cannot read {tmp_path}: it is a folder"),
        ((campaign, "--out", tmp_path / "a.txt"), "--out must end in .nc or .csv"),
        ((campaign, "--out", tmp_path / "no" / "a.csv"), "there is no folder"),
        ((campaign, "--baseline", 0), "--baseline must be at least 1"),
    ):
        assert message in scan_info_refused(capsys, *arguments)
    renamed = tmp_path / "campaign.nc"
    campaign.rename(renamed)
    assert "must be another file than the recording" in scan_info_refused(capsys, renamed, "--out", renamed)
    with open_recording(renamed) as recording:
        assert recording.count() == 24


def test_calibration(campaign, tmp_path, capsys):
    calibrate, _ = successes("board", "calibrate")
    constants, plain, scaled = tmp_path / "board.toml", tmp_path / "plain.nc", tmp_path / "scaled.nc"
    calibrate(capsys, campaign, "--inductance-uH", 50, "--out", constants)
    scan_info(capsys, campaign, "--out", plain)
    scan_info(capsys, campaign, "--out", scaled, "--calibration", constants)
    np.testing.assert_allclose(load_part(scaled).base_inductance, 50e-6, rtol=1e-6)
    np.testing.assert_allclose(load_part(scaled).delta, load_part(plain).delta, atol=1e-12)
    constants.write_text(recorded_boards.unsealed_text(constants).replace('board = "emulator"', 'board = "XMC 2Go"'))
    out = scan_info(capsys, campaign, "--out", scaled, "--calibration", constants)
    assert out.endswith("[emulator] the calibration is for the board “XMC 2Go”, the recording is of “emulator”\n")
    line = scan_info_refused(capsys, campaign, "--series", "--out", scaled, "--calibration", constants)
    assert "--calibration is for the response" in line
    assert "no.toml" in scan_info_refused(capsys, campaign, "--out", scaled, "--calibration", tmp_path / "no.toml")
