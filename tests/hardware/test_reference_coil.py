"""The reference coil on the emulated board: what it takes away, what it adds, and what it cannot help against."""

import numpy as np
import pytest
from support.quick_recordings import campaign_file, stream_file
from support.recorded_boards import QuickWorld, configured, quick_board
from support.refusals import refused

from coilarray.errors import HardwareError
from coilarray.hardware.emulator import Drift
from coilarray.hardware.record.campaign import Campaign
from coilarray.hardware.record.live_tracking import LiveTracker
from coilarray.hardware.record.recorded_response import recorded_response, recorded_series
from coilarray.hardware.record.recording import open_recording
from coilarray.hardware.record.reference_coil import ReferenceCoil
from coilarray.hardware.scan.readings import read_scan

WARMING = Drift(rate=0.01)
WARMS_FAST = Drift(rate=0.1)
PER_KELVIN = -26e-6  # of L: the internal oscillator falls by 13 ppm/K, which reads as a higher frequency


def live(count, *, reference, drift=None, noise=0.0, presses=(), dead_from=None):
    """Evaluate scans of the quick board, whose second coil is out of the finger's reach."""
    readings, world = [], QuickWorld()
    with quick_board(noise=noise, drift=drift, world=world) as board:
        settings = configured(board)
        tracker = LiveTracker(None, reference=reference)
        for k, scan in enumerate(board.reader.scans()):
            readings.append(tracker.take(read_scan(scan, settings, 120e-12)))
            if k in presses:
                board.emulator.indenter.press(-10e-3, 0.0, 1e-3)
            if k == dead_from:
                world.dead.add("coil2")
            if k == count - 1:
                return readings


def test_a_drift_of_the_clock_is_taken_away():
    plain, corrected = (live(60, reference=name, drift=WARMING)[-1] for name in (None, "coil2"))
    warmer = 0.01 * (plain.elapsed - 0.45)  # K since the middle of the ten scans of 0.098 s
    assert plain.states[0].delta == pytest.approx(PER_KELVIN * warmer, rel=0.05)
    assert corrected.states[0].delta == pytest.approx(0.0, abs=2e-7)  # codes of 8e-8, of both coils
    assert corrected.states[1].delta == pytest.approx(plain.states[1].delta)  # its own is shown as it is


def test_a_press_stays_and_the_reference_shows_none():
    readings = live(40, reference="coil2", drift=WARMING, presses=[20])
    assert readings[-1].states[0].delta == pytest.approx(0.8e-3 * np.exp(-100 / 64), rel=5e-3)
    assert readings[-1].press.begin == readings[21].elapsed


def test_its_noise_is_added():
    spread = []
    for reference in (None, "coil2"):
        deltas = [one.states[0].delta for one in live(400, reference=reference, noise=1e-6)[10:]]
        spread.append(np.std(deltas))
    assert spread[1] / spread[0] == pytest.approx(np.sqrt(2), rel=0.1)  # 390 scans tell each to 3.6 %


def test_without_the_reference_there_is_no_value():
    last = live(30, reference="coil2", dead_from=20)[-1]
    assert [state.delta for state in last.states] == [None, None]
    assert last.states[0].reasons == ("the reference coil has no value",)


def test_recordings_are_read_with_it(tmp_path):
    path = stream_file(tmp_path / "run.sqlite", 60, drift=WARMING)
    with open_recording(path) as recording:
        plain, corrected = (recorded_series(recording, reference=name) for name in (None, "coil2"))
    assert float(plain.delta[-1, 0]) < -1e-6
    np.testing.assert_allclose(corrected.delta.sel(state="coil1"), 0.0, atol=2e-7)
    np.testing.assert_array_equal(corrected.delta.sel(state="coil2"), plain.delta.sel(state="coil2"))
    np.testing.assert_array_equal(corrected.frequency, plain.frequency)
    assert corrected.attrs["reference_coil"] == "coil2"
    assert "reference_coil" not in plain.attrs


def test_so_is_a_campaign(tmp_path):
    """From baseline to peak the board warms by 0.1 K: some 3e-6 of δ; the finger is far from the reference."""
    grid, found = Campaign(x=(-10e-3,), y=(0.0,), depths=(1e-3,)), []
    for k, (drift, reference) in enumerate([(None, None), (WARMS_FAST, None), (WARMS_FAST, "coil2")]):
        with open_recording(campaign_file(tmp_path / f"{k}.sqlite", grid, drift=drift)) as recording:
            found.append(float(recorded_response(recording, reference=reference).delta.sel(state="coil1").squeeze()))
    steady, warmed, corrected = found
    assert warmed - steady < -2e-6
    assert corrected == pytest.approx(steady, abs=5e-7)  # 2e-7 of the finger at the reference, and two codes of 8e-8


def test_a_name_that_is_none():
    scan = live(1, reference=None)[0]
    refused(HardwareError, "must be one of coil1, coil2; got 'coil9'", live, 1, reference="coil9")
    assert ReferenceCoil("coil9").name == "coil9"  # it is known to be none with the first scan
    assert scan.press is None
