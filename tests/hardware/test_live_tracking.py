"""From scan to scan: baselines, δ, positions, and scans without values, on boards of known formula.

Drift correction by reference coils: what is common goes exactly, what is not stays, and noise adds in quadrature.
"""

import numpy as np
import pytest
import xarray as xr
from support.localize_boards import FIELD, bells, board
from support.recorded_boards import QuickWorld, configured, quick_board
from support.refusals import refused

from coilarray.circuit.noise_budget import Cause, NoiseBudget
from coilarray.design.readout import Readout
from coilarray.errors import HardwareError
from coilarray.hardware.record.live_tracking import LiveTracker
from coilarray.hardware.record.recorded_response import less_reference, response_less_reference
from coilarray.hardware.scan.readings import Reason, ScanReading, StateReading, read_scan
from coilarray.localize.forward import forward_model
from coilarray.localize.inverse import locate

NAMES = [f"coil{k + 1}" for k in range(len(FIELD))]
L_0 = np.linspace(50e-6, 54e-6, len(NAMES))
MODEL = forward_model(board(FIELD))
POINT = (3e-3, 2e-3, 1e-3)


def scan(number, delta=None, *, noise=None, boot=1, bad=(), sequence=None, names=NAMES):
    """Reading of the board with a δ of every coil."""
    change = np.zeros(len(NAMES)) if delta is None else np.asarray(delta)
    scatter = 0.0 if noise is None else noise.standard_normal(len(NAMES)) * 1e-6
    values = L_0 * (1 + change) * (1 + scatter)
    states = tuple(
        StateReading(name, None, None, "bad", (Reason.WATCHDOG,))
        if name in bad
        else StateReading(name, 2e6, value, "good")
        for name, value in zip(names, values.tolist(), strict=True)
    )
    return ScanReading(number if sequence is None else sequence, 0.25 * number, 0.0, boot, states)


def ready(**options):
    """A tracker that has its baseline."""
    tracker = LiveTracker(MODEL)
    for number in range(10):
        tracker.take(scan(number, **options))
    return tracker


def deltas(reading):
    return [state.delta for state in reading.states]


PRESSED = bells(np.array(POINT), FIELD)


def test_the_baseline_comes_first():
    tracker = LiveTracker(MODEL)
    for number in range(9):
        reading = tracker.take(scan(number))
        assert reading.waiting == 9 - number
        assert deltas(reading) == [None] * 5
        assert (reading.location, reading.problem, reading.noise) == (None, "", None)
    reading = tracker.take(scan(9))
    assert (reading.waiting, reading.location.verdict) == (0, "nothing pressed")
    np.testing.assert_allclose(deltas(reading), 0.0, atol=1e-15)
    # zero anew
    tracker = ready()
    assert tracker.take(scan(10, PRESSED)).location.verdict == "found"
    tracker.rezero()
    for number in range(11, 21):
        reading = tracker.take(scan(number, PRESSED))
        assert reading.waiting == max(20 - number, 0)
    np.testing.assert_allclose(deltas(reading), 0.0, atol=1e-15)


def test_delta_and_position_are_those_of_the_library():
    tracker = ready()
    reading = tracker.take(scan(10, PRESSED))
    np.testing.assert_allclose(deltas(reading), PRESSED, atol=1e-15)
    expected = locate(MODEL, dict(zip(NAMES, PRESSED, strict=True)), noise=reading.noise)
    assert reading.location.verdict == "found" == expected.verdict
    assert reading.location.best.x == pytest.approx(expected.best.x, abs=1e-9)
    assert reading.location.best.x == pytest.approx(POINT[0], abs=0.05e-3)
    assert tracker.take(scan(11, PRESSED), want_location=False).location is None


def test_noise_is_that_of_the_baseline_and_the_tables():
    random = np.random.default_rng(0)
    tracker = LiveTracker(None, baseline_scans=200, noise=2e-6)
    for number in range(200):
        reading = tracker.take(scan(number, noise=random))
    # 1e-6 of each scan, 1e-6/√200 of the baseline, 2e-6 of the table; 1000 values tell the first to 2 %
    assert reading.noise == pytest.approx(np.hypot(2e-6, 1e-6), rel=0.02)
    assert (reading.location, reading.problem) == (None, "")  # nobody asked
    # a baseline without any scatter has the noise of the budget
    tracker = LiveTracker(None, budget=budget())
    for number in range(10):
        reading = tracker.take(scan(number))
    assert reading.noise == pytest.approx(5e-6 * np.sqrt(1 + 1 / 200))
    assert reading.common_noise == 0.0


def test_scans_known_to_press_are_not_of_the_baseline():
    tracker = LiveTracker(MODEL, baseline_scans=3)
    for number in range(6):
        reading = tracker.take(scan(number, PRESSED if number % 2 else None), at_rest=number % 2 == 0)
    np.testing.assert_allclose(deltas(reading), PRESSED, atol=1e-15)


def test_a_silent_coil_is_left_out():
    tracker = LiveTracker(MODEL)
    for number in range(29):
        assert tracker.take(scan(number, bad=["coil2"])).waiting > 0
    tracker.take(scan(29, bad=["coil2"]))
    reading = tracker.take(scan(30, PRESSED, bad=["coil2"]))
    assert (reading.states[1].delta, reading.states[1].verdict) == (None, "bad")
    assert "does not oscillate" in reading.states[1].reasons[0]
    others = {name: value for name, value in zip(NAMES, PRESSED, strict=True) if name != "coil2"}
    expected = locate(MODEL.select(list(others)), others, noise=reading.noise)
    assert reading.location.best.x == pytest.approx(expected.best.x, abs=1e-9)
    late = tracker.take(scan(31, PRESSED))  # it speaks again, but has no baseline
    assert (late.states[1].delta, late.states[1].reasons) == (None, ("no baseline",))


def test_rate_and_lost_scans():
    tracker = LiveTracker(None)
    assert tracker.take(scan(0)).rate is None
    assert tracker.take(scan(1)).rate == pytest.approx(4.0)
    reading = tracker.take(scan(4))  # two are missing
    assert (reading.lost, reading.rate, reading.elapsed) == (2, pytest.approx(2.0), 1.0)
    again = tracker.take(scan(2, boot=7))  # restarted
    assert (again.lost, again.rate, again.elapsed) == (2, None, 0.0)
    assert tracker.take(scan(3, boot=7)).rate == pytest.approx(4.0)
    back = tracker.take(scan(1, boot=7, sequence=0))  # a new stream: time and sequence begin again
    assert (back.lost, back.rate) == (2, None)


def test_bad_input():
    refused(HardwareError, "at least 2 scans; got 1", LiveTracker, MODEL, baseline_scans=1)
    for noise in (0.0, float("nan")):
        refused(HardwareError, f"noise must be positive and finite; got {noise:g}", LiveTracker, MODEL, noise=noise)


def budget(own=0.0, clock=0.0):
    """A budget of the five coils with changes of each coil's own and of a common clock, and noise of a scan of 5e-6."""
    none, every = np.zeros(len(NAMES)), np.ones(len(NAMES))
    causes = (
        Cause("converter", 5e-6 * every, none, none, False, "", assumed=False),
        Cause("capacitors", none, none, own * every, False, "", assumed=False),
        Cause("clock", none, none, clock * every, True, "", assumed=False),
    )
    return NoiseBudget(tuple(NAMES), causes, Readout(averaged_scans=1, baseline_scans=200))


@pytest.mark.parametrize("model", [MODEL, None])
def test_noise_is_measured_and_changes_are_of_the_budget(model):
    """1e-6 of a scan as measured, not the budget's 5e-6; 1000 values tell it to 2 %."""
    random = np.random.default_rng(3)
    tracker = LiveTracker(model, baseline_scans=200, budget=budget(own=2e-6, clock=7e-6))
    for number in range(200):
        reading = tracker.take(scan(number, noise=random))
    assert reading.noise == pytest.approx(np.hypot(2e-6, 1e-6), rel=0.02)
    assert reading.common_noise == pytest.approx(7e-6)


@pytest.mark.parametrize("model", [MODEL, None])
@pytest.mark.parametrize("reference", [NAMES[3:], NAMES[4:]])
def test_white_noise_counts_once_with_a_reference(model, reference):
    """Each δ has 1e-6 of its own, and all have that of the mean of the references, once; the clock goes."""
    random = np.random.default_rng(4)
    tracker = LiveTracker(model, baseline_scans=200, budget=budget(clock=7e-6), reference=reference)
    for number in range(200):
        reading = tracker.take(scan(number, noise=random))
    # 800 differences with a scatter in common tell it to 4 %
    assert reading.noise == pytest.approx(1e-6, rel=0.1)
    assert reading.common_noise == pytest.approx(1e-6 / np.sqrt(len(reference)), rel=0.1)


def test_a_location_takes_the_noise_that_is_said():
    """Twice as much of each coil's own, twice the errors; what is common to all goes for the most part with depth."""
    tracker = LiveTracker(MODEL, budget=budget(own=2e-6))
    for number in range(10):
        tracker.take(scan(number, noise=np.random.default_rng(number)))
    reading = tracker.take(scan(10, PRESSED))
    expected = locate(MODEL, dict(zip(NAMES, PRESSED, strict=True)), noise=reading.noise)
    assert reading.location.best.known_deviations == pytest.approx(expected.best.known_deviations, rel=1e-3)


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
    # a missing reading of a reference gives no value
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


def live(count, *, reference=(), drift=0.0, noise=0.0, press_at=None, dead_from=None):
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


WARMING = 0.01  # K/s
PER_KELVIN = -26e-6  # of L: the internal oscillator falls by 13 ppm/K, which reads as a higher frequency


def test_the_live_display_is_corrected():
    readings, others = (live(60, reference=names, drift=WARMING) for names in ((), ["coil2"]))
    plain, corrected = readings[-1], others[-1]
    warmer = 0.01 * (plain.elapsed - np.mean([one.elapsed for one in readings[:10]]))  # K, since the baseline
    assert plain.states[0].delta == pytest.approx(PER_KELVIN * warmer, rel=0.05)
    assert corrected.states[0].delta == pytest.approx(0.0, abs=2e-7)  # codes of 8e-8, of both coils
    assert corrected.states[1].delta == plain.states[1].delta  # its own is shown as it is
    # a press is found under the correction
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
