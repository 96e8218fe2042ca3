"""The command ``board calibrate``: known constants found again, a file that the library reads, mistakes in one line."""

from pathlib import Path

import numpy as np
import pytest
import tomli_w
from support.command_line import runner, successes, toml_file
from support.quick_coils import series_tank
from support.recorded_boards import WIRING_TEXT, QuickWorld, campaign_file, stream_file, two_coils_document

from coilarray.hardware.record.calibration import calibrate_board, load_calibration
from coilarray.hardware.record.recording import open_recording

pytestmark = pytest.mark.usefixtures("own_folder")
_, refused = runner("board", "calibrate")
good, answer = successes("board", "calibrate")
campaign, _ = successes("board", "campaign")
_, compared = successes("board", "compare")

TRUE = 52e-6  # H, of the quick board's coils


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Folder with a stream at rest and a campaign of a board whose clock is off and which warms up."""
    folder = tmp_path_factory.mktemp("recordings")
    board = {"noise": 2e-7, "drift": 0.01, "oscillator": 42e6}
    stream_file(folder / "rest.sqlite", 60, **board)
    campaign_file(folder / "campaign.sqlite", **board)
    return folder


@pytest.mark.slow
def test_the_file_is_that_of_the_library(capsys, recordings):
    true = series_tank(TRUE, 120e-12, QuickWorld().resistance).frequency
    inductances = ("--inductance-uH", "coil1=52", "--inductance-uH", "coil2=52", "--inductance-error", "0.01")
    frequency = ("--frequency-MHz", f"coil1={true * 1e-6!r}", "--frequency-error", "1e-7")
    data = answer(capsys, recordings / "rest.sqlite", *inductances, *frequency, "--out", "b.toml")
    found = load_calibration("b.toml")
    options = {"inductances": {"coil1": 52e-6, "coil2": 52e-6}, "inductance_error": 0.01, "frequency_error": 1e-7}
    options |= {"known_frequency": ("coil1", true * 1e-6 * 1e6), "made": found.made}  # as the option rounds it
    with open_recording(recordings / "rest.sqlite") as recording:
        assert found == calibrate_board(recording, source="coilarray board calibrate rest.sqlite", **options)
    assert (data["emulated"], data["clock_from"], data["file"]) == (True, "known frequency", "b.toml")
    # 0.01 K/s over some 6 s of 13e-6/K, and noise
    assert data["clock_Hz"] == pytest.approx(42e6, rel=1e-6)
    assert [one["state"] for one in data["channels"]] == ["coil1", "coil2"]
    assert data["channels"][0]["capacitance_F"] == found.channels[0].capacitance


def test_every_line_of_an_emulated_board_says_so(capsys, recordings):
    out = good(capsys, recordings / "campaign.sqlite", "--inductance-uH", "52")
    first, *_, last = lines = out.splitlines()
    assert all(line.startswith("[emulator] ") for line in lines)
    assert (first, last) == ("[emulator] clock 43400000 Hz, from the settings", "[emulator] wrote board.toml")
    assert "proves nothing" not in out
    # two coils: half of 4·13 + (48 − 42 − 13) + 4 pF of the bus and 42 pF of a coil's end
    assert "[emulator] expected from the design: 120 pF, 165.5 pF with the capacitances of its switches" in out
    found = load_calibration("board.toml")
    assert set(found.capacitances) == {"coil1", "coil2"}


@pytest.mark.slow
@pytest.mark.usefixtures("no_noisy_copies")
def test_the_whole_way_from_the_emulator(capsys):
    """campaign, calibrate, compare: all physics of two coils on both sides, scale 1 within noise.

    The emulator interpolates in a table that is right to 1e-3 of the largest δ; the noise is chosen above that.
    """
    Path("two_coils.toml").write_text(tomli_w.dumps(two_coils_document()))
    Path("wiring.toml").write_text(WIRING_TEXT)
    noise = ("--emulate", "noise=1e-6", "--emulate", "drift=0.002")
    x, y = np.linspace(-12.64, -0.64, 7).tolist(), np.linspace(-4, 4, 5).tolist()
    plan = toml_file(Path("plan.toml"), x_mm=x, y_mm=y)
    campaign(capsys, "two_coils.toml", "--wiring", "wiring.toml", "--plan", plan, *noise, "--out", "run.sqlite")
    good(capsys, "run.sqlite", "--simulated")
    both, known = ("run.sqlite", "two_coils.toml"), ("--calibration", "board.toml")
    data = compared(capsys, *both, *known, "--out", "page.html")
    assert data["emulated"] is True
    for row in data["scales"][:1]:  # the second coil lies beside the map
        assert row["scale"] == pytest.approx(1.0, abs=4 * row["scale_std"] + 1e-3)
        assert row["scale_std"] < 5e-3
        assert row["shift_x_m"] == pytest.approx(0.0, abs=4 * row["shift_x_std_m"] + 5e-6)
    for row in data["remains"]:
        assert row["rms_after"] == pytest.approx(row["noise"], rel=0.5)  # 35 positions: 12 %
    for row in data["inductances"]:
        assert row["ratio"] == pytest.approx(1.0, rel=1e-6)  # by construction, and it is said
    assert any("is no test of either" in note for note in data["notes"])
    # not by construction: both with the design's capacitor and all strays
    for row in compared(capsys, *both)["inductances"]:
        assert row["ratio"] == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("REST", "--out", "board.json"), "--out must end in .toml"),
        (("REST", "--inductance-uH", "-3"), "--inductance-uH must be STATE=VALUE with a positive number; got '-3'"),
        (("REST", "--inductance-uH", "coil1=inf"), "--inductance-uH must be STATE=VALUE with a positive number"),
        (("REST", "--inductance-uH", "coil1=1", "--inductance-uH", "coil1=2"), "once for each"),
        (("REST", "--inductance-uH", "52", "--inductance-uH", "coil1=2"), "one value for all states, or"),
        (("REST", "--inductance-uH", "coil7=52"), "has no state 'coil7'"),
        (("REST", "--inductance-uH", "52", "--simulated"), "cannot be given together"),
        (("REST", "--inductance-uH", "52", "--inductance-error", "2"), "must be 0 to 0.5; got 2"),
        (("REST", "--frequency-MHz", "2"), "--frequency-MHz must be STATE=VALUE"),
        (("REST", "--frequency-MHz", "=2"), "has no state ''"),
    ],
)
def test_bad_input(capsys, recordings, arguments, words):
    given = [recordings / "rest.sqlite" if one == "REST" else one for one in arguments]
    assert words in refused(capsys, *given)
    assert list(Path().iterdir()) == []  # nothing half-written
