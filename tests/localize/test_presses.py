"""Press events: begin and end against noise, drift and what remains; on signals whose noise is known."""

import math

import numpy as np
import pytest
from scipy.stats import f as fisher

from coilarray.localize.inverse import Location, Mode
from coilarray.localize.presses import FALSE_ALARM, REMAINS, PressDetector

NAMES = [f"coil{k}" for k in range(1, 7)]
SIGMA = 3e-7
STEP = 0.3  # s


def rows(count, *, seed=0, states=6, sigma=SIGMA, drift=0.0, bend=0.0):
    """Noise of known σ on a drift in 1/s and a bend in 1/s²."""
    time = STEP * np.arange(count)
    noise = sigma * np.random.default_rng(seed).standard_normal((count, states))
    return noise + (drift * time + bend * time**2)[:, None]


def found(values, *, baseline=10, gaps=()):
    """All presses in rows of δ, by number; `gaps` are (scan, state) without a value."""

    def delta(k):
        return {NAMES[j]: value for j, value in enumerate(values[k].tolist()) if (k, j) not in gaps}

    detector = PressDetector([(STEP * k, delta(k)) for k in range(baseline)])
    presses = {}
    for k in range(baseline, len(values)):
        press = detector.take(STEP * k, delta(k))
        if press is not None:
            presses[press.number] = press
    return list(presses.values())


def with_presses(values, height, times, width=6):
    """Press for `width` scans at some of them, each coil by its own part of the height."""
    pressed = values.copy()
    for at in times:
        pressed[at : at + width] += height * np.linspace(1.0, 0.1, values.shape[1])
    return pressed


@pytest.mark.slow
@pytest.mark.parametrize("drift", [0.0, 2.6e-7, -5e-7])  # 1/s: 0.6 K/min of an internal oscillator; twice as much
def test_noise_and_drift_are_no_press(drift):
    # 8000 scans: 8e-6 false alarms are expected
    assert [found(rows(2000, seed=seed, drift=drift)) for seed in range(4)] == [[]] * 4


def test_nor_is_a_drift_that_bends():
    # a line of 5 s lags behind b t² by some b (5 s)²: a third of σ here
    assert found(rows(2000, bend=4e-9)) == []


def test_the_threshold_is_fishers_quantile():
    """A step just above it is found, one just below it is not, without noise but that of the baseline."""
    baseline, count = 200, 6
    values = rows(baseline + 1, seed=1, states=count)
    values[-1] = 0.0
    freedom = 2 / 3 * count * (baseline - 1)
    # baselines show σ to some 3 %, and the line's own noise adds 2 %
    limit = SIGMA * math.sqrt(fisher.isf(FALSE_ALARM, count, freedom))
    for factor, number in ((0.9, 0), (1.1, 1)):
        values[-1] = factor * limit
        assert len(found(values, baseline=baseline)) == number


@pytest.mark.parametrize("drift", [0.0, 2.6e-7])
@pytest.mark.parametrize("height", [1e-5, 1e-3])
def test_every_press_is_found_once(height, drift):
    times = list(range(30, 900, 15))
    presses = found(with_presses(rows(950, drift=drift), height, times))
    assert [press.number for press in presses] == list(range(1, len(times) + 1))
    np.testing.assert_allclose([press.begin for press in presses], STEP * np.array(times))
    np.testing.assert_allclose([press.end for press in presses], STEP * (np.array(times) + 6))
    # the largest of six scans; a drift is known to a part of σ
    np.testing.assert_allclose([press.delta for press in presses], height, atol=6 * SIGMA)


def test_a_press_that_wavers_is_one_press():
    values = with_presses(rows(80), 1e-3, [30], width=30)
    values[31:60:2] *= 1.2 * REMAINS
    assert len(found(values)) == 1
    values[31:60:2] *= 0.8 * REMAINS / (1.2 * REMAINS)
    assert len(found(values)) == 15


def test_a_long_press_ends_in_spite_of_the_drift_meanwhile():
    values = with_presses(rows(3000, drift=0.0), 1e-3, [100], width=2000)
    values += (3e-8 * STEP * np.arange(3000))[:, None]  # 6e-5 by the end
    (press,) = found(values)
    assert press.end == pytest.approx(2100 * STEP)


def test_what_remains_is_the_new_rest():
    values = rows(200)
    values[60:90] += 1e-3
    values[90:] += 2e-5  # 60 σ: the layer has not come back
    values[150:160] += 1e-5  # less than four times that, but seen from the new line
    first, second = found(values)
    assert first.end == pytest.approx(90 * STEP)
    assert (second.begin, second.end) == (pytest.approx(150 * STEP), pytest.approx(160 * STEP))


def test_states_without_a_value_are_left_out():
    gaps = {(k, 0) for k in range(20, 40)} | {(k, j) for k in (50, 51) for j in range(6)}
    (press,) = found(with_presses(rows(60), 1e-4, [30]), gaps=gaps)
    assert press.begin == pytest.approx(30 * STEP)
    assert press.delta == pytest.approx(0.82e-4, rel=0.02)  # of the second coil


def test_codes_that_never_change_have_the_noise_of_their_rounding():
    values = np.zeros((60, 6))
    values[20, 0] = 8e-8  # one code of one coil
    assert found(values) == []
    values[30:40] = 1e-6
    assert len(found(values)) == 1


def test_the_location_is_that_of_the_largest_deviation():
    values = with_presses(rows(20), 1e-4, [12], width=4)
    values[13] *= 2.0
    deltas = [dict(zip(NAMES, row, strict=True)) for row in values.tolist()]
    detector = PressDetector([(STEP * k, deltas[k]) for k in range(10)])
    locations = [Location("found", modes=(Mode(1e-3 * k, 0.0, 1e-3, np.eye(3), 0.0),)) for k in range(20)]
    presses = [detector.take(STEP * k, deltas[k], locations[k]) for k in range(10, 20)]
    assert [press is not None for press in presses] == [False] * 2 + [True] * 5 + [False] * 3
    last = presses[6]
    assert (last.number, last.begin, last.end) == (1, 12 * STEP, 16 * STEP)
    assert last.location is locations[13]
    assert [press.end for press in presses[2:6]] == [None] * 4
