"""The commands with a board without switches, on emulated ones of two coils: the results are those of the switches."""

import json

import pytest
import tomli_w
from support import recorded_boards
from support.command_line import runner, successes, toml_file
from support.contacts import coarse_maps

from coilarray.cli.main import main

pytestmark = pytest.mark.slow

board = recorded_boards.board
GROVE, FOUR = "emulator?channels=0,1&clock=40MHz", "emulator?channels=0,1,2,3"
measure, measure_record = successes("board", "measure")
_, calibrate_record = successes("board", "calibrate")
_, info_record = successes("board", "info")
look, look_record = successes("board", "test")
_, compare_record = successes("board", "compare")
run_live, _ = runner("board", "live")
_, measure_refused = runner("board", "measure")


@pytest.fixture(scope="module")
def design(board):
    """File of the design."""
    return board[0]


def measured(capsys, *arguments):
    """Inductances in H by coil, without noise, all of them good."""
    states = measure_record(capsys, *arguments, "--single", "--emulate", "noise=0")["states"]
    assert {state["verdict"] for state in states} == {"good"}
    return {state["state"]: state["inductance_H"] for state in states}


@pytest.fixture(scope="module")
def ideal(board, tmp_path_factory):
    """The switched board with switches without resistance, as arguments."""
    document = recorded_boards.two_coils_document()
    path = tmp_path_factory.mktemp("ideal") / "two_coils.toml"
    path.write_text(tomli_w.dumps({**document, "circuit": {**document["circuit"], "short_resistance_ohm": 0.0}}))
    return (path, *board[1:])


def test_one_line_gives_the_inductances(board, ideal, design, tmp_path, capsys):
    """Of the design's switches there are none: as with ideal ones, whatever resistance the design gives them."""
    switched = measured(capsys, *ideal)
    # L (1 + 1/Q²), with 5 Ω more
    assert measured(capsys, *board)["coil1"] > switched["coil1"] * (1 + 1e-4)
    for port in (GROVE, FOUR, "emulator?channels=1,0"):
        # the same circuit, the other coil grounded; a step of the code of any clock is 2e-7 of an inductance at most
        assert measured(capsys, design, "--port", port) == pytest.approx(switched, rel=4e-7)
    second = toml_file(tmp_path / "second.toml", coils=["coil2"])
    one = measured(capsys, design, "--port", "emulator?channels=0&clock=12MHz", "--settings", second)
    # the other coil is open here, not grounded: its coupling no longer lowers the inductance
    assert one["coil2"] > switched["coil2"] * 1.001


def test_a_recording_is_made_shown_calibrated_and_replayed(design, tmp_path, capsys):
    run, constants = tmp_path / "run.sqlite", tmp_path / "board.toml"
    recorded = measure_record(capsys, design, "--port", GROVE, "--scans", "12", "--rate", "50", "--out", run)
    assert recorded["scans"] == 12
    assert {state["good"] for state in recorded["states"]} == {12}
    assert info_record(capsys, run)["wiring"] == "channels"
    found = calibrate_record(capsys, run, "--simulated", "--out", constants)
    assert (found["clock_Hz"], [channel["state"] for channel in found["channels"]]) == (40e6, ["coil1", "coil2"])
    fast = toml_file(tmp_path / "fast.toml", replay_speed=0.0)
    code, out, _ = run_live(capsys, "--recording", run, "--settings", fast, "--no-locate", "--json")
    last = json.loads(out.splitlines()[-1])
    assert (code, last["baseline_scans_missing"]) == (0, 0)
    assert all(abs(value) < 1e-4 for value in last["delta"].values())  # δ of a board at rest: noise of 1e-6
    # going on takes the same kind of board
    first = toml_file(tmp_path / "first.toml", coils=["coil1"])
    other = ("--port", "emulator?channels=0&clock=12MHz", "--settings", first, "--resume", "--out", run)
    refused = measure_refused(capsys, design, *other)
    assert "cannot continue" in refused


@pytest.mark.usefixtures(
    "no_noisy_copies", "own_store"
)  # a kept contact of other depths has another mesh: 2e-3 of δ on a coarse one
def test_a_campaign_is_compared_with_its_design(design, tmp_path, capsys):
    recording = tmp_path / "campaign.sqlite"
    plan = toml_file(tmp_path / "plan.toml", x_mm=[-10.0, -5.0, 0.0], y_mm=[-3.0, 0.0, 3.0], depth_mm=[1.0])
    grid = ("--plan", str(plan), "--emulate", "noise=1e-8")
    with coarse_maps():
        assert main(["board", "campaign", str(design), "--port", FOUR, *grid, "--out", str(recording)]) == 0
        capsys.readouterr()
        beside = compare_record(capsys, recording, design)
    assert (beside["emulated"], beside["only_measured"], beside["only_simulated"]) == (True, [], [])
    scales = {row["state"]: row["scale"] for row in beside["scales"]}
    # the emulated board is the design; a step of the codes is 1e-7 of L, the largest delta is above 1e-4
    assert scales == pytest.approx({"coil1": 1.0, "coil2": 1.0}, rel=5e-3)
    assert max(row["rms_before"] for row in beside["remains"]) < 1e-6
    for row in beside["inductances"]:  # of one converter, none with the resistance of a switch
        assert row["ratio"] == pytest.approx(1.0, abs=4e-7)


def test_the_board_is_tested_and_what_is_not_verified_is_told(design, tmp_path, capsys):
    out = look(capsys, design, "--port", GROVE, "--find-drives")
    assert "self-test passed" in out
    assert "sensed by" not in out  # of coils at channels f alone is measured: no columns without any value
    assert "[emulator] coil    f (MHz)\n" in out
    assert "LDC1614 (5449/3055), channels 0, 1, 40 MHz at CLKIN" in out
    third = toml_file(tmp_path / "third.toml", coils=["coil3"])
    assert look_record(capsys, "--list", "--port", "emulator?channels=1", "--settings", third)["wiring"] == "channels"


@pytest.mark.parametrize(("arguments", "words"), [
    (("--port", "emulator?channels=0"), "1 channels (0) for 2 coils; none is left for coil2"),
    (("--port", GROVE, "--wiring", "six_coils"), "has switches; a port with channels has none"),
    (("--port", GROVE, "--rate", "10000"), "rate must be at most"),
])  # fmt: skip
def test_what_cannot_be_is_one_line(design, capsys, arguments, words):
    assert words in measure_refused(capsys, design, *arguments, "--single")


@pytest.mark.parametrize(("port", "coils", "words"), [
    (GROVE, ["coil1", "coil9"], "there is no coil 'coil9'"),
    ("emulator", ["coil1"], "coils can be named only for a port with channels instead of switches"),
])  # fmt: skip
def test_coils_that_cannot_be_are_one_line(design, tmp_path, capsys, port, coils, words):
    settings = toml_file(tmp_path / "coils.toml", coils=coils)
    assert words in measure_refused(capsys, design, "--port", port, "--settings", settings, "--single")
