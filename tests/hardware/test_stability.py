"""The Allan deviation against a published data set, known noises and their slopes.

The published set is that of W. J. Riley, NIST SP 1065 (2008), test suite: 9 values of NBS monograph 140, and
1000 of a generator of random numbers.
"""

import numpy as np
import pytest
from support.refusals import refused

from coilarray.errors import HardwareError
from coilarray.hardware.record.stability import allan_deviation, stability

NINE = [892, 809, 823, 798, 671, 644, 883, 903, 677]


def deviations(values, factors):
    return allan_deviation(np.array(values, dtype=float)[:, None], factors)[:, 0]


def thousand():
    """SP 1065: n → 16807 n mod (2³¹ − 1) from 1234567890, divided by 2³¹ − 1."""
    n, values = 1234567890, []
    for _ in range(1000):
        values.append(n / 2147483647)
        n = 16807 * n % 2147483647
    return values


def test_the_deviations_are_the_published_ones():
    """To the seven digits that are printed."""
    assert deviations(NINE, [1, 2]) == pytest.approx([91.22945, 85.95287], rel=1e-7)
    assert deviations(thousand(), [1, 10, 100]) == pytest.approx([2.922319e-1, 9.159953e-2, 3.241343e-2], rel=2e-7)


@pytest.mark.parametrize(("kind", "slope"), [("white", -0.5), ("walk", 0.5), ("drift", 1.0)])
def test_slopes_are_those_of_the_noise(kind, slope):
    random = np.random.default_rng(11)
    values = {
        "white": random.standard_normal(40_000),
        "walk": np.cumsum(random.standard_normal(40_000)),
        "drift": np.arange(40_000.0),
    }[kind]
    factors = 2 ** np.arange(3, 9)  # of a random walk short averages are still bent, long ones few
    found = deviations(values, factors)
    # 80 independent means at the longest: 8 % over a factor of 32
    assert np.polyfit(np.log(factors), np.log(found), 1)[0] == pytest.approx(slope, abs=0.05)
    if kind == "drift":
        assert found == pytest.approx(factors / np.sqrt(2))


def test_lost_scans_leave_gaps():
    """Every third scan is lost: the deviation over one period is that of the neighbours that are there."""
    random = np.random.default_rng(1)
    time = 0.3 * np.arange(3000)
    kept = np.arange(3000) % 3 != 2
    delta = 1e-6 * random.standard_normal((3000, 2)) + np.array([0.0, 1e-9]) * time[:, None]
    found = stability(time[kept], delta[kept], ["a", "b"], expected=[1e-6, 1e-6])
    assert found.attrs == {"period": pytest.approx(0.3), "scans": 2000}
    assert found.scan_noise.values == pytest.approx([1e-6, 1e-6], rel=0.05)  # 1000 pairs: 2 %
    assert found.tau.values[0] == pytest.approx(0.3)
    assert abs(found.drift.values - [0.0, 1e-9]) == pytest.approx(0.0, abs=4 * float(found.drift_error.max()))


@pytest.mark.parametrize(
    ("time", "delta", "message"),
    [
        (np.arange(7.0), np.zeros((7, 1)), "at least 8 scans at rest; got 7"),
        (np.zeros(9), np.zeros((9, 1)), "must be finite and rise"),
        (np.arange(9.0), np.zeros((9, 2)), r"1 states at 9 times need δ \(9, 1\); got \(9, 2\)"),
        (np.r_[np.arange(9.0), 1e4], np.zeros((10, 1)), "must follow each other"),
        (np.arange(9.0), np.full((9, 1), np.nan), "a has fewer than 8 readings"),
    ],
)
def test_no_stability_of_too_few_scans(time, delta, message):
    refused(HardwareError, message, stability, time, delta, ["a"])
