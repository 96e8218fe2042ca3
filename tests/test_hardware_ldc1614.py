"""LDC1614: codes, frequencies and limits against the data sheet's own examples."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coilarray.hardware import (
    check_channel,
    code_to_frequency,
    drive_for,
    frequency_to_code,
    inductance_from_frequency,
    settle_count,
)
from coilarray.hardware.ldc1614_limits import AMPLITUDE


def test_code_of_two_megahertz():
    # 2 MHz at f_ref 21.7 MHz: code 0x17982F3, one step 0.0808 Hz
    assert frequency_to_code(2e6, 21.7e6) == 0x17982F3
    assert code_to_frequency(2, 21.7e6) - code_to_frequency(1, 21.7e6) == pytest.approx(0.0808, rel=1e-3)


@given(st.integers(1, (1 << 28) - 2), st.integers(1, 15))
def test_there_and_back(code, divider):
    # float64 holds 28 bits exactly
    assert frequency_to_code(code_to_frequency(code, 21.7e6, divider=divider), 21.7e6, divider=divider) == code


def test_offset():
    # one step of OFFSET is 4096 codes
    assert code_to_frequency(5000, 20e6, offset=3) == pytest.approx(code_to_frequency(5000 + 3 * 4096, 20e6), rel=1e-15)


def test_inductance():
    # 120 pF and 2 MHz: 52.77 µH
    assert inductance_from_frequency(2e6, 120e-12) == pytest.approx(52.77e-6, rel=1e-4)


@given(st.floats(600, 88e3))  # above, the smallest current passes 1.8 V
def test_every_resistance_of_the_table_has_a_drive(R):
    drive = drive_for(R)
    if drive is None:  # the table's rows leave no gap
        raise AssertionError(R)
    assert drive.amplitude == pytest.approx(4 * R * drive.current / math.pi)
    # rows of the table are rounded to three digits: the lower end may be missed by that
    assert AMPLITUDE[0] * 0.99 <= drive.amplitude <= AMPLITUDE[1]


def test_drive_prefers_the_larger_current():
    # 33 kΩ fits the rows of 32 µA and 40 µA
    drive = drive_for(33e3)
    assert (drive.code, drive.current) == (6, pytest.approx(40e-6))
    assert drive.amplitude == pytest.approx(4 * 33e3 * 40e-6 / math.pi)
    assert drive_for(91e3) is None
    assert drive_for(math.inf) is None


def test_limits():
    kept = check_channel(1.93e6, 33e3, 48, 8e6)
    assert all(limit.kept for limit in kept)
    broken = {limit.name for limit in check_channel(6e6, 100.0, 0.5, 7e6) if not limit.kept}
    assert broken == {
        "sensor frequency by divider over reference", "frequency over self-resonance", "R_p (Ω)", "quality factor",
    }  # fmt: skip
    assert {limit.name for limit in check_channel(9e6, 5e3, 20, reference=40e6) if not limit.kept} == {
        "reference frequency (Hz)", "FIN_DIVIDER",
    }  # fmt: skip
    assert [limit.name for limit in check_channel(500.0, 33e3, 48) if not limit.kept] == ["sensor frequency (Hz)"]
    # both ends of the drive table
    assert all(limit.kept for R in (600.0, 90e3) for limit in check_channel(1.9e6, R, 48))
    # a divider of two lets 6 MHz pass
    assert "sensor frequency by divider over reference" not in {
        limit.name for limit in check_channel(6e6, 33e3, 48, divider=2) if not limit.kept
    }


@pytest.mark.parametrize(("quality", "count"), [(10, 7), (20, 14), (40, 28)])
def test_settle_count(quality, count):
    # data sheet's rule at 21.7 MHz and 2 MHz
    assert settle_count(2e6, quality, 21.7e6) == count
    assert settle_count(10e6, 1, 21.7e6) == 4


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: code_to_frequency(0, 21.7e6), "the ends mark a range error"),
        (lambda: code_to_frequency((1 << 28) - 1, 21.7e6), "the ends mark a range error"),
        (lambda: code_to_frequency(1, math.nan), "reference must be positive and finite"),
        (lambda: code_to_frequency(1, 1e6, divider=16), "divider must be 1 to 15; got 16"),
        (lambda: code_to_frequency(1, 1e6, offset=-1), "offset must be 0 to 65535; got -1"),
        (lambda: frequency_to_code(30e6, 21.7e6), "outside 1 to"),
        (lambda: inductance_from_frequency(0, 1e-12), "frequency must be positive and finite; got 0"),
        (lambda: inductance_from_frequency(1e6, -1), "capacitance must be positive and finite; got -1"),
        (lambda: drive_for(0), "parallel_resistance must be positive; got 0"),
        (lambda: check_channel(0, 1e3, 10), "frequency must be positive; got 0"),
        (lambda: settle_count(1e6, -1), "quality_factor must be positive; got -1"),
    ],
)
def test_bad_input(call, message):
    with pytest.raises(ValueError, match=message):
        call()
