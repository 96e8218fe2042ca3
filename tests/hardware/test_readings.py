"""Readings: which words are a measurement, by the data sheet's rules written out once more, and its inductance."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.emulated_reader import code_of, oscillation_frequency, result_words, settings_of

from coilarray.design.scan_states import ScanState
from coilarray.errors import HardwareError
from coilarray.hardware.scan.readings import (
    LARGEST_CODE,
    QUARTER,
    RawSample,
    RawScan,
    Reason,
    SampleFault,
    judge,
    read_scan,
)
from coilarray.hardware.scan.wiring import load_wiring

UNDER, OVER, WATCHDOG, AMPLITUDE = 8, 4, 2, 1  # flags of the upper word
READY = 0x0048  # STATUS of a result of channel 0 without an error: DRDY and UNREADCONV0
statuses = st.sampled_from([READY, READY | 0x400, READY | 0x200]) | st.integers(0, 0xFFFF)
LEGAL = 0x0179, 0x82F3  # 2 MHz at 21.7 MHz


def _sample(code, flags=0, status=READY):
    return RawSample(*result_words(code, flags), status)


@given(st.integers(0, LARGEST_CODE), st.integers(0, 15), statuses)
def test_verdict(code, flags, status):
    """Against the rules bit by bit, written from the data sheet's table of STATUS and not with the code's own table."""
    verdict, reasons = judge(_sample(code, flags, status))
    bad_flags = flags & (UNDER | OVER | WATCHDOG) or code in (0, LARGEST_CODE)
    bad_status = status & 0b0011_1001_0000_0000 or status & 0b1100_0000_1011_0111 or status & 0b100_1000 != 0b100_1000
    doubtful = flags & AMPLITUDE or status & 0b0000_0110_0000_0000 or code >= 1 << 26
    assert verdict == ("bad" if bad_flags or bad_status else "doubtful" if doubtful else "good")
    assert bool(reasons) == (verdict != "good")
    assert len(set(reasons)) == len(reasons)


@pytest.mark.parametrize(("status", "verdict", "reason"), [
    (0x0048, "good", None), (0x2048, "bad", Reason.UNDER_RANGE), (0x1048, "bad", Reason.OVER_RANGE),
    (0x0848, "bad", Reason.WATCHDOG), (0x0148, "bad", Reason.ZERO_COUNT), (0x0448, "doubtful", Reason.AMPLITUDE_HIGH),
    (0x0248, "doubtful", Reason.AMPLITUDE_LOW),
    *((status, "bad", Reason.NOT_READY) for status in (0x0040, 0x0008, 0x0000)),
    *((status, "bad", Reason.ANOTHER_CHANNEL) for status in (0x4048, 0x004C, 0x0049)),
    *((status, "bad", Reason.IMPOSSIBLE) for status in (0x00C8, 0xFFFF)),
])  # fmt: skip
def test_status(status, verdict, reason):
    assert judge(RawSample(*LEGAL, status)) == (verdict, () if reason is None else (reason,))


@pytest.mark.parametrize(("sample", "verdict", "reasons"), [
    (_sample(0), "bad", (Reason.UNDER_RANGE,)),
    (_sample(1), "good", ()),
    (_sample(QUARTER - 1), "good", ()),
    (_sample(QUARTER), "doubtful", (Reason.ABOVE_QUARTER,)),
    (_sample(LARGEST_CODE - 1), "doubtful", (Reason.ABOVE_QUARTER,)),
    (_sample(LARGEST_CODE), "bad", (Reason.OVER_RANGE,)),
    (_sample(0, UNDER), "bad", (Reason.UNDER_RANGE,)),
    (_sample(5000, WATCHDOG | AMPLITUDE), "bad", (Reason.WATCHDOG, Reason.AMPLITUDE)),
    (_sample(5000, AMPLITUDE), "doubtful", (Reason.AMPLITUDE,)),
    (_sample(5000, AMPLITUDE, 0x0448), "doubtful", (Reason.AMPLITUDE_HIGH,)),  # STATUS says which
    *((RawSample(*LEGAL, READY, fault), "bad", (Reason[fault.name],)) for fault in SampleFault if fault),
])  # fmt: skip
def test_codes_and_flags(sample, verdict, reasons):
    assert judge(sample) == (verdict, reasons)


WIRING = load_wiring()
SETTINGS = settings_of(WIRING)
ONE = settings_of(WIRING, [ScanState("coil1", (("coil1", 1),))])
GOOD = RawSample(0x0179, 0x82F3, READY)
C = 120e-12


def _scan(samples, settings=SETTINGS):
    return RawScan(7, 1.5, 1e9, settings.hash, 0xB007, tuple(samples))


def _one(sample, settings=ONE, **given):
    (state,) = read_scan(_scan([sample], settings), settings, C, **given).states
    return state


def test_golden_reading():
    # facts: code 0x17982F3 at 21.7 MHz is 2 MHz, and with 120 pF 52.77 µH
    reading = read_scan(_scan([GOOD] * 6), SETTINGS, C)
    assert [state.name for state in reading.states] == list(WIRING.coils)
    assert reading.states[0].frequency == pytest.approx(2e6, abs=0.05)  # half a step of 0.0808 Hz
    assert reading.states[0].inductance == pytest.approx(52.77e-6, rel=1e-4)
    of_scan = reading.verdict, reading.sequence, reading.time, reading.received, reading.boot
    assert of_scan == ("good", 7, 1.5, 1e9, 0xB007)
    assert set(reading.inductances) == set(WIRING.coils)


@given(
    L=st.floats(5e-6, 200e-6), capacitance=st.floats(50e-12, 500e-12), quality=st.floats(5, 200) | st.just(math.inf),
    divider=st.integers(2, 4),
)  # fmt: skip
def test_inductance_there_and_back(L, capacitance, quality, divider):
    """From L to the nearest code and back: half a step of the code, twice in L."""
    plan = [ScanState("coil1", (("coil1", 1),))]
    settings = replace(settings_of(WIRING, plan, frequency=8e6), fin_divider=divider)
    f = oscillation_frequency(L, capacitance, quality)
    code = code_of(f, settings.reference, divider)
    (state,) = read_scan(_scan([_sample(code)], settings), settings, capacitance, qualities=quality).states
    if f > 10e6:
        assert (state.inductance, state.verdict) == (None, "bad")
        return
    step = divider * settings.reference / (1 << 28)
    assert state.frequency == pytest.approx(f, abs=0.51 * step)
    # dL/L = −2 df/f, a little more with the converter's delay at a low quality factor
    assert state.inductance == pytest.approx(L, rel=1.5 * step / f)
    assert (state.verdict == "good") == (f / divider < settings.reference / 4)


def test_capacitances_and_qualities_by_name():
    capacitances = {coil: (100 + k) * 1e-12 for k, coil in enumerate(WIRING.coils)}
    qualities = {coil: 20.0 + k for k, coil in enumerate(WIRING.coils)}
    for state in read_scan(_scan([GOOD] * 6), SETTINGS, capacitances, qualities=qualities).states:
        f = oscillation_frequency(state.inductance, capacitances[state.name], qualities[state.name])
        assert f == pytest.approx(state.frequency, rel=1e-13)  # rounding


def test_a_better_clock():
    # frequency goes with the clock, inductance with its inverse square
    plain, better = _one(GOOD), _one(GOOD, clock=1.01 * ONE.clock)
    assert better.frequency == pytest.approx(1.01 * plain.frequency, rel=1e-14)
    assert better.inductance == pytest.approx(plain.inductance / 1.01**2, rel=1e-14)


@pytest.mark.parametrize(("change", "given", "message"), [
    ({"configuration": SETTINGS.hash ^ 1}, {}, "scan 7 was measured with the settings [0-9A-F]{4}, not with"),
    ({"samples": (GOOD,) * 5}, {}, "scan 7 must have 6 states; got 5"),
    ({"samples": (GOOD,) * 7}, {}, "scan 7 must have 6 states; got 7"),
    ({}, {"capacitances": {"coil1": C}}, "the capacitance of coil2 must be given"),
    ({}, {"capacitances": 0.0}, "the capacitance of coil1 must be positive and finite; got 0.0 F"),
    ({}, {"capacitances": math.nan}, "the capacitance of coil1 must be positive and finite; got nan F"),
    ({}, {"qualities": {"coil1": 20.0}}, "the quality factor of coil2 must be given"),
    ({}, {"qualities": 1.9}, "the quality factor of coil1 must be at least 2; got 1.9"),
    ({}, {"qualities": math.nan}, "the quality factor of coil1 must be at least 2; got nan"),
    ({}, {"clock": 0.0}, "clock must be positive and finite; got 0.0 Hz"),
    ({}, {"clock": math.inf}, "clock must be positive and finite; got inf Hz"),
])  # fmt: skip
def test_refused(change, given, message):
    with pytest.raises(HardwareError, match=message):
        read_scan(replace(_scan([GOOD] * 6), **change), SETTINGS, **{"capacitances": C, **given})
