"""LDC1614 results: which words are a measurement, by the data sheet's rules written out once more for the tests."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.converter_words import result_words

from coilarray.errors import HardwareError
from coilarray.hardware.scan.reader import RawSample, SampleFault
from coilarray.hardware.scan.readings import (
    ALL_FLAGS,
    LARGEST_CODE,
    QUARTER,
    READY,
    Reason,
    Result,
    decode_result,
    judge,
)

codes = st.integers(0, LARGEST_CODE)
results = st.builds(Result, codes, st.booleans(), st.booleans(), st.booleans(), st.booleans())
statuses = st.sampled_from([READY, READY | 0x400, READY | 0x200]) | st.integers(0, 0xFFFF)
LEGAL = 0x0179, 0x82F3  # 2 MHz at 21.7 MHz


def _sample(result, status=READY):
    return RawSample(*result_words(result), status)


@given(results)
def test_there_and_back(result):
    assert decode_result(*result_words(result)) == result


@given(st.integers(0, 0xFFFF), st.integers(0, 0xFFFF))
def test_words_there_and_back(msb, lsb):
    result = decode_result(msb, lsb)
    assert result_words(result) == (msb, lsb)
    assert 0 <= result.code <= LARGEST_CODE


def test_flags_are_not_in_the_code():
    # the bug of several drivers: flags left in the number, and the words turned round
    assert decode_result(0xF179, 0x82F3) == Result(0x17982F3, True, True, True, True)
    # a value that a public issue shows as 0x1b3d3d64: an amplitude flag and 0xb3d3d64
    assert decode_result(0x1B3D, 0x3D64) == Result(0xB3D3D64, amplitude=True)


@given(results, statuses)
def test_verdict(result, status):
    """Against the rules bit by bit, written from the data sheet's table of STATUS and not with the code's own table."""
    verdict, reasons = judge(_sample(result, status))
    bad_flags = result.under_range or result.over_range or result.watchdog or result.code in (0, LARGEST_CODE)
    bad_status = status & 0b0011_1001_0000_0000 or status & 0b1100_0000_1011_0111 or status & 0b100_1000 != 0b100_1000
    doubtful = result.amplitude or status & 0b0000_0110_0000_0000 or result.code >= 1 << 26
    assert verdict == ("bad" if bad_flags or bad_status else "doubtful" if doubtful else "good")
    assert bool(reasons) == (verdict != "good")
    assert len(set(reasons)) == len(reasons)


@pytest.mark.parametrize(
    ("status", "verdict", "reason"),
    [
        (0x0048, "good", None),
        (0x2048, "bad", Reason.UNDER_RANGE),
        (0x1048, "bad", Reason.OVER_RANGE),
        (0x0848, "bad", Reason.WATCHDOG),
        (0x0448, "doubtful", Reason.AMPLITUDE_HIGH),
        (0x0248, "doubtful", Reason.AMPLITUDE_LOW),
        (0x0148, "bad", Reason.ZERO_COUNT),
        (0x0040, "bad", Reason.NOT_READY),
        (0x0008, "bad", Reason.NOT_READY),
        (0x0000, "bad", Reason.NOT_READY),
        (0x4048, "bad", Reason.ANOTHER_CHANNEL),
        (0x004C, "bad", Reason.ANOTHER_CHANNEL),
        (0x0049, "bad", Reason.ANOTHER_CHANNEL),
        (0x00C8, "bad", Reason.IMPOSSIBLE),
        (0xFFFF, "bad", Reason.IMPOSSIBLE),
    ],
)
def test_status(status, verdict, reason):
    assert judge(RawSample(*LEGAL, status)) == (verdict, () if reason is None else (reason,))


@pytest.mark.parametrize(
    ("result", "verdict", "reasons"),
    [
        (Result(0), "bad", (Reason.UNDER_RANGE,)),
        (Result(1), "good", ()),
        (Result(QUARTER - 1), "good", ()),
        (Result(QUARTER), "doubtful", (Reason.ABOVE_QUARTER,)),
        (Result(LARGEST_CODE - 1), "doubtful", (Reason.ABOVE_QUARTER,)),
        (Result(LARGEST_CODE), "bad", (Reason.OVER_RANGE,)),
        (Result(0, under_range=True), "bad", (Reason.UNDER_RANGE,)),
        (Result(5000, watchdog=True, amplitude=True), "bad", (Reason.WATCHDOG, Reason.AMPLITUDE)),
        (Result(5000, amplitude=True), "doubtful", (Reason.AMPLITUDE,)),
    ],
)
def test_codes_and_flags(result, verdict, reasons):
    assert judge(_sample(result)) == (verdict, reasons)


def test_range_marks_need_no_flags():
    # 0 and 0xFFFFFFF mark a range error even where ERROR_CONFIG asks for nothing
    assert judge(_sample(Result(0)), error_config=0)[0] == "bad"
    assert judge(_sample(Result(LARGEST_CODE)), error_config=0)[0] == "bad"


@pytest.mark.parametrize(
    ("msb_bit", "config_bits"), [(15, (15,)), (14, (14,)), (13, (13,)), (12, (12, 11))], ids=["UR", "OR", "WD", "AE"]
)
def test_flags_come_only_where_they_are_asked_for(msb_bit, config_bits):
    sample = RawSample(0x0179 | 1 << msb_bit, 0x82F3, READY)
    assert Reason.IMPOSSIBLE not in judge(sample, error_config=ALL_FLAGS)[1]
    none = ALL_FLAGS & ~sum(1 << bit for bit in config_bits)
    assert Reason.IMPOSSIBLE in judge(sample, error_config=none)[1]
    for bit in config_bits:  # either bit is enough for the amplitude
        assert Reason.IMPOSSIBLE not in judge(sample, error_config=none | 1 << bit)[1]


def test_offset_moves_the_quarter():
    # one step of OFFSET is 4096 codes
    assert judge(_sample(Result(QUARTER - 4097)), offset=1) == ("good", ())
    assert judge(_sample(Result(QUARTER - 4096)), offset=1) == ("doubtful", (Reason.ABOVE_QUARTER,))


def test_status_says_which_amplitude():
    assert judge(RawSample(0x1179, 0x82F3, 0x0448)) == ("doubtful", (Reason.AMPLITUDE_HIGH,))


@pytest.mark.parametrize("fault", [fault for fault in SampleFault if fault is not SampleFault.NONE])
def test_faults_are_bad_whatever_the_words(fault):
    assert judge(RawSample(*LEGAL, READY, fault)) == ("bad", (Reason[fault.name],))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: decode_result(0x10000, 0), "msb must be 0 to 0xFFFF; got 0x10000"),
        (lambda: decode_result(0, -1), "lsb must be 0 to 0xFFFF; got -0x1"),
        (lambda: judge(RawSample(*LEGAL, 0x10000)), "status must be 0 to 0xFFFF; got 0x10000"),
    ],
)
def test_refused(call, message):
    with pytest.raises(HardwareError, match=message):
        call()
