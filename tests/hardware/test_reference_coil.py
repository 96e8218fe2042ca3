"""Drift correction by reference coils: what is common goes exactly, what is not stays, and noise adds in quadrature."""

import numpy as np
import pytest
import xarray as xr
from support.localize_boards import FIELD, board
from support.recorded_boards import QuickWorld, configured, quick_board
from support.refusals import refused

from coilarray.errors import HardwareError
from coilarray.hardware.emulator import Drift
from coilarray.hardware.record.live_tracking import LiveTracker
from coilarray.hardware.record.recorded_response import less_reference, response_less_reference
from coilarray.hardware.scan.readings import read_scan
from coilarray.localize.forward import forward_model
from coilarray.localize.inverse import locate

MODEL = forward_model(board(FIELD))
FAR = [MODEL.states[-1]]


def test_common_drift_goes_and_noise_adds_in_quadrature():
    random = np.random.default_rng(3)
    drift, noise = np.linspace(0, 4e-5, 20_000), 1e-6
    delta = {name: drift + noise * random.standard_normal(drift.size) for name in "abcd"}
    one, two = less_reference(delta, "d")["a"], less_reference(delta, "cd")["a"]
    # 20,000 scans tell a standard deviation to 0.5 %; twice that twice
    assert one.std() == pytest.approx(noise * np.sqrt(2), rel=0.02)
    assert two.std() == pytest.approx(noise * np.sqrt(1.5), rel=0.02)
    assert abs(one[:1000].mean() - one[-1000:].mean()) < 5 * noise * np.sqrt(2 * 2 / 1000)


def test_a_missing_reading_of_a_reference_gives_no_value():
    left = less_reference({"a": [1e-3, 2e-3], "b": [0.0, 0.0], "c": [0.0, np.nan]}, ["b", "c"])
    np.testing.assert_array_equal(left["a"], [1e-3, np.nan])


def test_the_model_of_what_is_left_finds_the_place_even_where_the_reference_is_pressed():
    """A drift of 3e-5 moves the place by tenths of a millimetre without the reference, by nothing with it."""
    point, drift = np.array([3e-3, 2e-3, 1e-3]), 3e-5
    readings = dict(zip(MODEL.states, MODEL.delta(point) + drift, strict=True))
    assert readings[FAR[0]] > 3 * drift  # the reference is pressed too
    left = less_reference(readings, FAR)
    best = locate(MODEL.referenced(FAR), left, noise=1e-5).best
    assert (best.x, best.y, best.depth) == pytest.approx(point, abs=1e-9)  # where the solver ends
    drifted = locate(MODEL, readings, noise=1e-4).best
    assert np.hypot(drifted.x - point[0], drifted.y - point[1]) + abs(drifted.depth - point[2]) > 1e-5


def live(count, *, reference=(), drift=None, noise=0.0, press_at=None, dead_from=None):
    """Evaluate scans of the quick board; its second coil is out of reach of the finger."""
    readings, world = [], QuickWorld()
    with quick_board(noise=noise, drift=drift, world=world) as opened:
        settings, tracker = configured(opened), LiveTracker(None, reference=reference)
        for k, scan in enumerate(opened.reader.scans()):
            readings.append(tracker.take(read_scan(scan, settings, 120e-12)))
            if k == press_at:
                opened.emulator.indenter.press(-10e-3, 0.0, 1e-3)
            if k == dead_from:
                world.dead.add("coil2")
            if k == count - 1:
                return readings


WARMING = Drift(rate=0.01)
PER_KELVIN = -26e-6  # of L: the internal oscillator falls by 13 ppm/K, which reads as a higher frequency


def test_the_live_display_is_corrected():
    readings, others = (live(60, reference=names, drift=WARMING) for names in ((), ["coil2"]))
    plain, corrected = readings[-1], others[-1]
    warmer = 0.01 * (plain.elapsed - np.mean([one.elapsed for one in readings[:10]]))  # K, since the baseline
    assert plain.states[0].delta == pytest.approx(PER_KELVIN * warmer, rel=0.05)
    assert corrected.states[0].delta == pytest.approx(0.0, abs=2e-7)  # codes of 8e-8, of both coils
    assert corrected.states[1].delta == plain.states[1].delta  # its own is shown as it is


def test_a_press_is_found_under_the_correction():
    readings = live(40, reference=["coil2"], drift=WARMING, press_at=20)
    assert readings[-1].states[0].delta == pytest.approx(0.8e-3 * np.exp(-100 / 64), rel=5e-3)
    assert readings[-1].press.begin == readings[21].elapsed


def test_a_response_less_its_reference():
    delta = np.arange(12.0).reshape(1, 2, 2, 3) * 1e-4
    coords = {"depth": [1e-3], "y": [0.0, 1e-3], "x": [0.0, 1e-3], "state": ["a", "b", "c"]}
    dims = ("depth", "y", "x", "state")
    response = xr.Dataset({"delta": (dims, delta), "delta_std": (dims, np.full_like(delta, 3e-6))}, coords)
    left = response_less_reference(response, ["b", "c"])
    assert left.state.values.tolist() == ["a"]
    np.testing.assert_allclose(left.delta.values[..., 0], delta[..., 0] - delta[..., 1:].mean(axis=-1))
    np.testing.assert_allclose(left.delta_std, 3e-6 * np.sqrt(1.5))
    assert left.attrs["reference_coils"] == "b, c"
    refused(HardwareError, "a reference coil must be one of a, b, c", response_less_reference, response, ["d"])
