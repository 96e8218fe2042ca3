"""Drift correction by reference coils: what is common goes exactly, what is not stays, and noise adds in quadrature."""

import numpy as np
import pytest
from support.localize_boards import FIELD, board
from support.refusals import refused

from coilarray.errors import HardwareError, LocalizeError
from coilarray.hardware.record.reference_coil import less_reference
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


@pytest.mark.parametrize(
    ("reference", "message"),
    [
        ([], "reference coils must be named once each"),
        (["a", "a"], "reference coils must be named once each"),
        (["z"], "a reference coil must be one of a, b; got 'z'"),
        (["a", "b"], "must leave another state"),
    ],
)
def test_references_that_cannot_be(reference, message):
    refused(HardwareError, message, less_reference, {"a": 0.0, "b": 0.0}, reference)


def test_the_model_refuses_an_unknown_reference():
    refused(LocalizeError, "a reference coil must be one of", MODEL.referenced, ["nowhere"])
