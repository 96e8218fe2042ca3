"""Drift of L_0: polynomials found again within their standard errors, and reported where no polynomial describes it."""

from dataclasses import replace

import numpy as np
import pytest
from support.quick_recordings import GRID, campaign_file, stream_file
from support.refusals import refused

from coilarray.errors import HardwareError
from coilarray.hardware.emulator import Drift as Warming
from coilarray.hardware.record.recorded_response import recorded_series
from coilarray.hardware.record.recording import open_recording
from coilarray.hardware.record.stability import Drift, fit_drift, fit_drifts

TIME = np.linspace(100.0, 4000.0, 150)
L_0 = 52e-6


def curve(*coefficients, time=TIME):
    """Relative change over the time in ks."""
    return sum(c * (time / 1e3) ** k for k, c in enumerate(coefficients))


@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_polynomial_without_noise_is_found_exactly(order):
    change = curve(0.0, *[3e-5, -2e-5, 1e-5][:order])
    drift = fit_drift(TIME, L_0 * (1 + change), order=order)
    value, error = drift.at(TIME)
    np.testing.assert_allclose(value, L_0 * (1 + change), rtol=1e-14)  # rounding
    assert drift.scatter < 1e-14
    np.testing.assert_allclose(error, 0.0, atol=1e-14)


def test_rate_is_that_at_the_middle():
    drift = fit_drift(TIME, L_0 * (1 + curve(0.0, 0.0, 1e-5)), order=2)
    middle = (TIME[0] + TIME[-1]) / 2
    # d ln L/dt = 2c t/(1 + c t²)
    assert drift.rate == pytest.approx(2e-11 * middle / (1 + 1e-11 * middle**2), rel=1e-9)


def test_standard_errors_are_those_of_repeated_measurements():
    """200 runs: a scatter is known to 5 %, a mean to 7 % of a standard deviation."""
    change, random = curve(0.0, 2e-5, -1e-5), np.random.default_rng(0)
    runs = [fit_drift(TIME, L_0 * (1 + change + 1e-6 * random.standard_normal(TIME.size)), order=2) for _ in range(200)]
    at = np.linspace(TIME[0], TIME[-1], 9)
    values = np.array([run.at(at)[0] for run in runs]) / L_0 - 1
    reported = np.mean([run.at(at)[1] for run in runs], axis=0)
    np.testing.assert_allclose(values.std(axis=0), reported, rtol=0.2)
    assert np.abs((values.mean(axis=0) - curve(0.0, 2e-5, -1e-5, time=at)) / reported).max() < 0.35
    rates = np.array([run.rate for run in runs])
    assert rates.std() == pytest.approx(np.mean([run.rate_error for run in runs]), rel=0.2)
    assert np.mean([run.scatter for run in runs]) == pytest.approx(1e-6, rel=0.02)
    assert np.mean([run.smooth for run in runs]) > 0.98  # three standard deviations, one-sided


@pytest.mark.parametrize(("coefficients", "order"), [((5e-6,), 1), ((5e-6, 8e-6), 2), ((0.0, 0.0, 8e-6), 3)])
def test_the_lowest_order_that_will_do_is_taken(coefficients, order):
    noise = 1e-6 * np.random.default_rng(1).standard_normal(TIME.size)
    drift = fit_drift(TIME, L_0 * (1 + curve(0.0, *coefficients) + noise))
    assert len(drift.coefficients) == order
    assert drift.smooth


def test_what_no_polynomial_describes_is_reported():
    swing = 2e-5 * np.sin(TIME / 100)
    noise = 1e-6 * np.random.default_rng(2).standard_normal(TIME.size)
    step = np.where(TIME > 2000, 1e-4, 0.0)
    assert [fit_drift(TIME, L_0 * (1 + change + noise)).smooth for change in (swing, step, 0.0)] == [False, False, True]


def test_scans_without_a_value_are_left_out():
    values = L_0 * (1 + curve(0.0, 1e-5))
    values[::3] = np.nan
    np.testing.assert_allclose(fit_drift(TIME, values).at(TIME)[0], L_0 * (1 + curve(0.0, 1e-5)), rtol=1e-14)


def test_nothing_is_said_far_beyond_the_scans():
    drift = fit_drift(np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 9.0]), np.full(7, L_0))
    assert drift.gap == 4.0
    value, error = drift.at([-4.1, -4.0, 13.0, 13.1])
    assert np.isnan(value).tolist() == np.isnan(error).tolist() == [True, False, False, True]


@pytest.mark.parametrize(
    ("time", "values", "options", "words"),
    [
        (TIME, np.full(149, L_0), {}, "rows of one length"),
        (TIME[:6], np.full(6, L_0), {}, "a drift of order 1 needs 7 scans at rest; coil1 has 6"),
        (TIME[:7], np.full(7, L_0), {"order": 2}, "a drift of order 2 needs 8 scans at rest"),
        (TIME, np.full(150, np.nan), {}, "coil1 has 0"),
        (TIME[::-1], np.full(150, L_0), {}, "must be finite and rise"),
        *((TIME, np.full(150, L_0), {"order": order}, f"must be 1 to 3; got {order}") for order in (0, 4)),
    ],
)
def test_bad_input(time, values, options, words):
    refused(HardwareError, words, fit_drift, time, values, state="coil1", **options)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"stop": 0.0}, "a time that rises"),
        ({"inductance": -1.0}, "a positive inductance"),
        ({"scatter": 1e308}, "a scatter below 1"),
        ({"scatter": float("nan")}, "finite numbers"),
        ({"coefficients": ()}, "1 to 3 coefficients"),
        ({"covariance": ((1.0,),)}, "a square covariance"),
        ({"covariance": ((1.0, 2.0), (2.0, 1.0))}, "must not be negative"),
    ],
)
def test_a_drift_that_cannot_be(change, words):
    good = Drift(0.0, 1.0, 0.1, L_0, (1e-6,), ((1e-12, 0.0), (0.0, 1e-12)), 1e-6, True, "coil1", 0, 1, 1.7e9)
    refused(HardwareError, words, replace, good, **change)


def test_an_emulated_boards_warming_is_found(tmp_path):
    """The clock falls by 13 ppm/K: f is read that much higher, L twice that lower. These coils know no temperature."""
    path = stream_file(tmp_path / "run.sqlite", 200, noise=2e-7, drift=Warming(rate=0.02))
    with open_recording(path) as recording:
        series = recorded_series(recording)
        drifts = fit_drifts(series, ((recording.sessions[0].identity.boot, recording.sessions[0].started),))
    assert [drift.state for drift in drifts] == ["coil1", "coil2"]
    for drift in drifts:
        assert drift.rate == pytest.approx(-26e-6 * 0.02, abs=4 * drift.rate_error)
        assert drift.rate_error < 0.02 * abs(drift.rate)
        assert drift.smooth
        # L ∝ f⁻²: twice the noise of a frequency; 200 scans tell it to 5 %
        assert drift.scatter == pytest.approx(4e-7, rel=0.25)


@pytest.mark.slow
def test_baselines_of_a_campaign_alone_count(tmp_path):
    path = campaign_file(tmp_path / "run.sqlite", noise=2e-7, drift=Warming(rate=0.01))
    with open_recording(path) as recording:
        series = recorded_series(recording)
        sessions = tuple((session.identity.boot, session.started) for session in recording.sessions)
        drifts = fit_drifts(series, sessions, order=1)
        refused(HardwareError, "must be 1 to 3", fit_drifts, series, sessions, order=7)
    assert (series.stage == "baseline").sum() == GRID.size
    for drift in drifts:  # peaks would be up to 8e-4 above
        assert drift.rate == pytest.approx(-26e-8, abs=4 * drift.rate_error)
        assert (drift.boot, drift.started) == sessions[0]
    assert fit_drifts(series.isel(scan=slice(0, 8)), sessions) == ()
