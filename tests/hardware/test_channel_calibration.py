"""Clock and capacitances of a board: found again on emulated boards of which they are known."""

import math
import re

import numpy as np
import pytest
from support.contacts import IDEAL
from support.quick_coils import series_tank
from support.recorded_boards import DESIGN, QuickWorld, board_calibration, campaign_file, quick_map, stream_file
from support.refusals import refused

from coilarray.errors import HardwareError
from coilarray.hardware.record.calibration import (
    calibrate_board,
    calibrated_response,
    calibration_to_toml,
    load_calibration,
    save_calibration,
)
from coilarray.hardware.record.recorded_response import recorded_response, recorded_series
from coilarray.hardware.record.recording import open_recording
from coilarray.response.map import response_map
from coilarray.studies.comparison import compare_responses

TRUE = 52e-6  # H, of the quick board's coils
NOISE = 2e-7  # of a frequency


def calibrated(path, **options):
    with open_recording(path) as recording:
        return calibrate_board(recording, **options)


def both_responses(path, calibration):
    """Response of a campaign without and with a calibration."""
    with open_recording(path) as recording:
        return recorded_response(recording), calibrated_response(recording, calibration)


@pytest.fixture(scope="module")
def rest(tmp_path_factory):
    """A stream at rest of a board whose clock is not the typical one."""
    return stream_file(tmp_path_factory.mktemp("rest") / "run.sqlite", 50, noise=NOISE, oscillator=41.0e6)


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """A campaign on a board that warms up."""
    return campaign_file(tmp_path_factory.mktemp("campaign") / "run.sqlite", noise=NOISE, drift=0.005)


def test_known_inductances_give_inductances_back(rest):
    """The clock is 6 % off, the coils have losses: C takes up both, and L is right within its error."""
    found = calibrated(rest, inductances={"coil1": TRUE, "coil2": TRUE}, inductance_error=0.01)
    assert (found.capacitances_from, found.clock, found.clock_error) == ("known inductances", 43.4e6, None)
    for channel in found.channels:
        # true C times (43.4/41)⁻² times 1 − 1/Q², Q about 33
        assert channel.capacitance == pytest.approx(120e-12 * (41 / 43.4) ** 2, rel=2e-3)
        assert channel.standard_error == pytest.approx(0.01 * channel.capacitance, rel=1e-3)
    with open_recording(rest) as recording:
        L = recorded_series(recording, capacitances=found.capacitances).inductance
    np.testing.assert_allclose(L.mean("scan"), TRUE, rtol=1e-9)
    # without an error of the inductance it is the noise's
    for channel in calibrated(rest, inductances={"coil1": TRUE}).channels:
        # twice the noise of a frequency, in 50 scans; a scatter of 50 is known to 10 %
        assert channel.standard_error / channel.capacitance == pytest.approx(2 * NOISE / math.sqrt(50), rel=0.4)


def test_a_known_frequency_gives_the_clock(rest):
    true = series_tank(TRUE, 120e-12, QuickWorld().resistance).frequency
    found = calibrated(rest, known_frequency=("coil2", true), frequency_error=1e-7)
    assert (found.clock_from, found.channels, found.capacitances_from) == ("known frequency", [], None)
    assert found.clock == pytest.approx(41.0e6, abs=4 * found.clock_error)
    assert found.clock_error == pytest.approx(41.0e6 * math.hypot(NOISE / math.sqrt(50), 1e-7), rel=0.1)
    both = calibrated(rest, known_frequency=("coil2", true), inductances={"coil1": TRUE})
    # with the true clock the capacitance is the true one but for the losses, 1/Q² = 1.1e-3
    assert 5e-4 < both.capacitances["coil1"] / 120e-12 - 1 < 2e-3


@pytest.mark.slow
def test_simulated_inductances_are_those_of_the_response(rest):
    found = calibrated(rest, from_design=True)
    assert found.capacitances_from == "design"
    base = response_map(DESIGN, depths=[1e-3], x=[0.0], y=[0.0], imperfections=IDEAL).base_inductance
    assert [one.state for one in found.channels] == base.state.values.tolist()
    assert [one.inductance for one in found.channels] == pytest.approx(base.values.tolist(), rel=1e-9)


@pytest.mark.slow
def test_a_calibrated_response_has_the_known_inductance(campaign):
    found = calibrated(campaign, inductances={"coil1": TRUE, "coil2": 2 * TRUE})
    plain, corrected = both_responses(campaign, found.model_copy(update={"board": "another board"}))
    assert (corrected.attrs["calibration_board"], corrected.attrs["board"]) == ("another board", "emulator")
    np.testing.assert_allclose(corrected.base_inductance, [TRUE, 2 * TRUE], rtol=1e-9)
    assert plain.base_inductance[0] != pytest.approx(TRUE, rel=1e-4)  # its losses
    assert corrected.attrs["capacitance_from"] == "known inductances"
    assert "capacitance_from" not in plain.attrs


@pytest.mark.slow
@pytest.mark.usefixtures("no_noisy_copies")
def test_emulator_to_recording_to_comparison_ends_at_scale_one(campaign):
    """The whole way through converter codes and SQLite: scale 1, shift 0, and nothing but noise remains."""
    simulated = quick_map(np.arange(-12e-3, 25.1e-3, 1e-3), np.arange(-10e-3, 10.1e-3, 1e-3))
    for measured in both_responses(campaign, calibrated(campaign)):
        one = compare_responses(measured, simulated)
        # a cubic spline through positions 1 mm apart is 1e-4 of the bell off, between the positions only
        assert (np.abs(one.scale - 1) < 4 * one.scale_std + 1e-5).all()
        assert (np.abs(one["shift"]) < 4 * one.shift_std + 1e-7).all()
        assert (one.scale_std < 5e-4).all()
        np.testing.assert_allclose(one.rms_after / one.noise, 1.0, rtol=0.35)
        assert (one.correlation_after > 0.99999).all()
        assert one.attrs["measured_emulated"] == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"emulated": False}, "is of a real board, .* of an emul"),
        ({"design_hash": "0" * 64}, f"with the design 000000000000, .* with {DESIGN.digest[:12]}"),
    ],
)
def test_a_calibration_of_another_board_is_refused(campaign, change, words):
    with open_recording(campaign) as recording, pytest.raises(HardwareError, match=words):
        calibrated_response(recording, calibrated(campaign).model_copy(update=change))


def test_states_without_enough_scans_are_refused(tmp_path):
    world = QuickWorld()
    world.dead.add("coil2")
    path = stream_file(tmp_path / "run.sqlite", 20, world=world)
    refused(HardwareError, "at least 2 good scans of coil2 at rest", calibrated, path, inductances={"coil2": TRUE})
    found = calibrated(path, inductances={"coil1": TRUE})
    assert list(found.capacitances) == ["coil1"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"inductances": {"coil9": TRUE}}, "has no state 'coil9'; there are coil1, coil2"),
        *(({"inductances": {"coil1": L}}, "inductance of coil1 must be positive and fin") for L in (0.0, math.nan)),
        ({"inductances": {"coil1": 1e3}}, "channels.0.capacitance_F must be at least 1e-12"),
        ({"inductances": {"coil1": TRUE}, "from_design": True}, "must be either known or simulated, not both"),
        ({"known_frequency": ("coil1", -2e6)}, "a known frequency must be positive"),
        ({"known_frequency": ("coil1", 2e9)}, "clock_Hz must be at most 5.5e\\+07"),
    ],
)
def test_bad_input(rest, options, words):
    refused(HardwareError, words, calibrated, rest, **options)


def test_the_file_gives_every_number_back(campaign, tmp_path):
    path = tmp_path / "board.toml"
    for options in ({}, {"inductances": {"coil1": TRUE}, "known_frequency": ("coil1", 2.01e6), "source": "a „test”\n"}):
        found = calibrated(campaign, made="2025-01-01T00:00:00+00:00", **options)
        save_calibration(found, path)
        assert load_calibration(path) == found
    text = calibration_to_toml(found)
    path.write_text(text, encoding="utf-8")
    refused(HardwareError, 'board.toml is cut: .* checksum = "none" must be its first line', load_calibration, path)
    path.write_text(f'checksum = "none"\n{text}', encoding="utf-8")
    assert load_calibration(path).model_copy(update={"checksum": None}) == found


GOOD = calibration_to_toml(board_calibration(checksum="none"))


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("schema = 1", "schema = 2", "schema must be"),
        ("coilarray board calibration", "something else", 'must have kind = "coilarray board calibration"'),
        ('board = "XMC 2Go"', 'bord = "XMC 2Go"', "did you mean board"),
        ("= 43200000.0", '= "43 MHz"', "clock_Hz must be"),
        ("= 43200000.0", "= 1e9", "clock_Hz must be at most 5.5e\\+07"),
        ('from = "known frequency"', 'from = "guess"', "clock_from must be"),
        ("capacitance_F = 1.2e-10", "capacitance_F = 1.2", "channels.0.capacitance_F must be at most 1e-06"),
        ('capacitances_from = "known inductances"', "", "must have capacitances_from"),
        ('state = "coil2"', 'state = "coil1"', "a state of its own"),
    ],
)
def test_bad_files(tmp_path, before, after, words):
    assert before in GOOD
    path = tmp_path / "board.toml"
    path.write_text(GOOD.replace(before, after), encoding="utf-8")
    refused(HardwareError, f"{re.escape(str(path))}.*{words}", load_calibration, path)
