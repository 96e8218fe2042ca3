"""LDC1614 timing: the equations, the paper's scan time, and the rates that six coils can be measured at."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coilarray.errors import HardwareError
from coilarray.hardware.chips.ldc1614 import (
    bus_time,
    conversion_time,
    rcount_for,
    settle_time,
    state_time,
    wake_time,
)

REFERENCE = 21.7e6
references = st.floats(1e6, 55e6)


def test_paper_scan_time():
    # six times wake, full resolution and reading the result; Gast & Zimmermann (2020) print 293.5 ms
    parts = state_time(0xFFFF, 0, REFERENCE)
    scan = 6 * (parts.wake + parts.conversion + parts.result)
    assert scan == pytest.approx(293.6e-3, abs=0.05e-3)  # as printed in the facts, to a tenth of a ms
    assert scan == pytest.approx(293.5e-3, rel=6e-4)
    # an external oscillator of 40 MHz by two cannot be it
    assert 6 * conversion_time(0xFFFF, 20e6) > 314e-3


def test_parts():
    # facts: 48.321 ms, 0.378 ms, 240 µs
    assert conversion_time(0xFFFF, REFERENCE) * 1e3 == pytest.approx(48.321, abs=5e-4)
    assert wake_time() * 1e3 == pytest.approx(0.378, abs=5e-4)
    assert bus_time(reads=2) == pytest.approx(240e-6, rel=1e-12)
    assert bus_time(writes=2) == pytest.approx(190e-6, rel=1e-12)
    # facts: status 120 µs, switches 50 µs; three writes of 95 µs: drive current, waking, sleeping
    assert state_time(0xFFFF, 0, REFERENCE).control == pytest.approx(455e-6, rel=1e-12)
    # at a quarter of the bus clock four times as long
    assert bus_time(reads=3, writes=3, rate=100e3) == pytest.approx(4 * bus_time(reads=3, writes=3), rel=1e-12)
    # data sheet's example: RCOUNT 0x04D6 at 20 MHz converts in about 0.99 ms
    assert conversion_time(0x04D6, 20e6) == pytest.approx((16 * 0x04D6 + 4) / 20e6, rel=1e-12)


@pytest.mark.parametrize(("rate", "rcount"), [(10, 21270), (20, 9968), (50, 3187), (100, 927)])
def test_rate_ladder(rate, rcount):
    # facts: about 0.98 ms for each of six coils beside the conversion (0.9833 ms reproduces all rows)
    overhead = wake_time() + bus_time(reads=3, writes=2) + 50e-6 + settle_time(8, REFERENCE)
    assert overhead == pytest.approx(0.98e-3, abs=0.01e-3)
    assert rcount_for(1 / (6 * rate) - overhead, REFERENCE) == pytest.approx(rcount, abs=5)


@pytest.mark.parametrize(("count", "clocks"), [(0, 32), (1, 32), (2, 32), (3, 48), (0x100, 4096)])
def test_settling(count, clocks):
    assert settle_time(count, REFERENCE) == pytest.approx(clocks / REFERENCE, rel=1e-12)


@given(st.integers(5, 0xFFFF), references)
def test_there_and_back(rcount, reference):
    assert rcount_for(conversion_time(rcount, reference), reference) == rcount


@given(st.floats(5e-6, 1.0), references)
def test_the_largest_that_fits(duration, reference):
    if duration * reference < 84:
        with pytest.raises(HardwareError, match="a conversion takes at least"):
            rcount_for(duration, reference)
        return
    rcount = rcount_for(duration, reference)
    tolerance = 1 + 1e-11  # a duration that is a count but for rounding gets that count
    assert conversion_time(rcount, reference) <= duration * tolerance
    assert rcount == 0xFFFF or conversion_time(rcount + 1, reference) > duration


@given(st.integers(5, 0xFFFF), st.integers(0, 0xFFFF), references)
def test_state_is_its_parts(rcount, settle_count, reference):
    parts = state_time(rcount, settle_count, reference)
    assert parts.total == pytest.approx(
        parts.wake + parts.settle + parts.conversion + parts.result + parts.control, rel=1e-12
    )
    assert parts.until_ready < parts.measuring < parts.total


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: conversion_time(4, 1e6), "RCOUNT must be 5 to 65535; got 4"),
        (lambda: conversion_time(0x10000, 1e6), "RCOUNT must be 5 to 65535; got 65536"),
        (lambda: conversion_time(5, 0.0), "a clock must be positive and finite; got 0.0 Hz"),
        (lambda: rcount_for(1.0, math.nan), "a clock must be positive and finite; got nan Hz"),
        (lambda: rcount_for(math.nan, 1e6), "a duration must be positive and finite; got nan s"),
        (lambda: rcount_for(1e-6, 1e6), "a conversion takes at least 84 µs; got 1 µs"),
        (lambda: settle_time(-1, 1e6), "SETTLECOUNT must be 0 to 65535; got -1"),
        (lambda: settle_time(0x10000, 1e6), "SETTLECOUNT must be 0 to 65535; got 65536"),
        (lambda: wake_time(-1.0), "a clock must be positive and finite; got -1.0 Hz"),
        (lambda: bus_time(reads=1, rate=0.0), "a clock must be positive and finite; got 0.0 Hz"),
        (lambda: state_time(5, 0, 1e6, bus_rate=0.0), "a clock must be positive and finite; got 0.0 Hz"),
    ],
)
def test_refused(call, message):
    with pytest.raises(HardwareError, match=message):
        call()
