"""LDC1614: registers, codes, frequencies, limits and times against the data sheet's own examples.

Addresses and values after a reset are compared in test_emulator_chip.py, whose chip has the same table.
"""

import functools
import math
import operator
import re
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.emulated_reader import oscillation_frequency

from coilarray.circuit.converter_limits import (
    AMPLITUDE_HIGH,
    AMPLITUDE_LOW,
    DRIVE_CURRENTS,
    DRIVE_WINDOW,
    check_channel,
    drive_for,
)
from coilarray.design.readout import conversion_time
from coilarray.errors import HardwareError
from coilarray.hardware import code_to_frequency, inductance_from_frequency, settle_count
from coilarray.hardware.chips.ldc1614 import (
    ASLEEP,
    bus_time,
    decode,
    deglitch_for,
    encode,
    input_divider,
    register,
    registers,
    settle_time,
)  # fmt: skip


def test_code_of_two_megahertz():
    # 2 MHz at f_ref 21.7 MHz: code 0x17982F3, one step 0.0808 Hz
    assert code_to_frequency(0x17982F3, 21.7e6) == pytest.approx(2e6, abs=0.05)
    assert code_to_frequency(2, 21.7e6) - code_to_frequency(1, 21.7e6) == pytest.approx(0.0808, rel=1e-3)
    assert code_to_frequency(1000, 21.7e6, divider=3) == pytest.approx(3 * code_to_frequency(1000, 21.7e6), rel=1e-15)
    # no losses are the limit of few
    L = inductance_from_frequency(2e6, 120e-12)
    assert inductance_from_frequency(2e6, 120e-12, 1e12) == pytest.approx(L, rel=1e-13)  # first order: 5 ns·ω/Q = 6e-14
    assert oscillation_frequency(L, 120e-12) == pytest.approx(2e6, rel=1e-14)


@pytest.mark.parametrize(("quality", "shift"), [(10, -0.81), (20, -0.28), (40, -0.11)])
def test_losses_lower_the_frequency(quality, shift):
    # facts: shift in percent for 52.8 µH and 120 pF, printed to a hundredth
    lossless = oscillation_frequency(52.8e-6, 120e-12)
    lossy = oscillation_frequency(52.8e-6, 120e-12, quality)
    assert (lossy / lossless - 1) * 100 == pytest.approx(shift, abs=0.0101)


@given(st.floats(1e3, 10e6), st.floats(1e-12, 1e-6), st.floats(2, 1e4) | st.just(math.inf))
def test_lossy_inductance_there_and_back(frequency, capacitance, quality):
    L = inductance_from_frequency(frequency, capacitance, quality)
    # at Q = 2 and 10 MHz the cubic's two roots come near each other, which costs about ten roundings
    assert oscillation_frequency(L, capacitance, quality) == pytest.approx(frequency, rel=1e-13)
    # equation 1 itself
    period = math.sqrt(L * capacitance)
    square = 1 - 1 / quality**2 - 5e-9 / (quality * period)
    assert 2 * math.pi * frequency * period == pytest.approx(math.sqrt(square), rel=1e-12)
    # losses lower the frequency, so a smaller inductance explains it
    assert L <= inductance_from_frequency(frequency, capacitance) * (1 + 1e-15)


@given(st.floats(600, 88e3))  # above, the smallest current passes 1.8 V
def test_every_resistance_of_the_table_has_a_drive(R):
    drive = drive_for(R)
    assert drive is not None  # the table's rows leave no gap
    assert drive.amplitude == pytest.approx(4 * R * drive.current / math.pi)
    # rows of the table are rounded to three digits: the lower end may be missed by that
    assert AMPLITUDE_LOW * 0.99 <= drive.amplitude <= AMPLITUDE_HIGH


# data sheet, table 42: IDRIVE, current in µA, smallest and largest R_p in kΩ
TABLE_42 = """
0:16/60.0/90.0 1:18/51.8/77.6 2:20/44.6/66.9 3:23/38.4/57.6 4:28/33.7/49.7 5:32/29.5/42.8 6:40/23.6/36.9
7:46/20.5/31.8 8:52/18.1/27.4 9:59/16.1/23.6 10:72/13.1/20.4 11:82/11.5/17.6 12:95/9.92/15.1 13:110/8.57/13.0
14:127/7.42/11.2 15:146/6.46/9.69 16:169/5.58/8.35 17:195/4.83/7.20 18:212/4.45/6.21 19:244/3.86/5.35
20:297/3.17/4.61 21:342/2.76/3.97 22:424/2.22/3.42 23:489/1.93/2.95 24:551/1.71/2.54 25:635/1.48/2.19
26:763/1.24/1.89 27:880/1.07/1.63 28:1017/0.93/1.40 29:1173/0.80/1.21 30:1355/0.70/1.05 31:1563/0.60/0.90
"""
ROWS = [tuple(float(word) for word in re.split("[:/]", entry)) for entry in TABLE_42.split()]


def test_drive_table():
    """Of the rows that hold R_p the one with the largest current is taken, unless its amplitude passes the clamps."""
    assert [DRIVE_CURRENTS[int(code)] for code, *_ in ROWS] == [pytest.approx(row[1] * 1e-6) for row in ROWS]
    ends = sorted({end * 1e3 for row in ROWS for end in row[2:]})
    for R in [end * factor for end in ends for factor in (1 - 1e-9, 1, 1 + 1e-9)]:
        rows = [row for row in ROWS if row[2] * 1e3 <= R <= row[3] * 1e3]
        unclamped = [row for row in rows if 4 * R * row[1] * 1e-6 / math.pi <= 1.8]
        wanted = max((unclamped or rows), default=None)
        drive = drive_for(R)
        assert (None if drive is None else drive.code) == (None if wanted is None else wanted[0]), R
    assert drive_for(math.inf) is None
    # equation 12: I = π V/(4 R_p)
    drive = drive_for(5.7e3)
    assert math.pi * drive.amplitude / (4 * 5.7e3) == pytest.approx(drive.current, rel=1e-12)
    (window,) = (limit for limit in check_channel(1.93e6, 33e3, 48) if limit.name == DRIVE_WINDOW)
    assert (window.value, window.low, window.high) == (33e3, 1e3, 100e3)  # the electrical characteristics


@given(st.floats(1e3, 10e6), st.floats(1e6, 35e6))
def test_input_divider_is_the_least(frequency, reference):
    if frequency >= 15 / 4 * reference:
        with pytest.raises(ValueError, match="must be below 15/4 of"):
            input_divider(frequency, reference)
        return
    divider = input_divider(frequency, reference)
    assert frequency / divider < reference / 4
    least = 2 if frequency >= 8.75e6 else 1
    assert divider == least or frequency / (divider - 1) >= reference / 4


def test_limits():
    # the lowest input filter above the sensor
    assert [deglitch_for(f) for f in (1e3, 0.99e6, 1e6, 3.29e6, 3.3e6, 9.99e6, 10e6)] == [1, 1, 4, 4, 5, 5, 7]

    def broken(*channel, **given):
        return {limit.name for limit in check_channel(*channel, **given) if not limit.kept}

    ratio = "sensor frequency by divider over reference"
    assert broken(1.93e6, 33e3, 48, 8e6) == set()
    assert broken(6e6, 100.0, 0.5, 7e6, divider=1) == {
        ratio,
        "frequency over self-resonance",
        "R_p (Ω)",
        "quality factor",
    }
    assert broken(9e6, 5e3, 20, reference=40e6, divider=1) == {"FIN_DIVIDER"}
    assert broken(500.0, 33e3, 48) == {"sensor frequency (Hz)"}
    # the window of the electrical characteristics, and above 90 kΩ no row of table 42: 16 µA make more than 1.8 V
    assert broken(1.9e6, 1e3, 48) | broken(1.9e6, 90e3, 48) == set()
    assert broken(1.9e6, 999.0, 48) == broken(1.9e6, 600.0, 48) == broken(1.9e6, 100.1e3, 48) == {"R_p (Ω)"}
    weakest = "amplitude with the smallest drive current"
    assert broken(1.9e6, 90.1e3, 48) == broken(1.9e6, 100e3, 48) == {f"{weakest} (V peak)"}
    (said,) = (limit.words for limit in check_channel(1.9e6, 95e3, 48) if not limit.kept)
    assert said == f"{weakest} is 1.935 V peak; it must be at most 1.8 V peak"
    assert broken(6e6, 33e3, 48) == set()  # a divider of two, the least that will do, lets 6 MHz pass


@pytest.mark.parametrize(("quality", "count"), [(10, 7), (20, 14), (40, 28)])
def test_settle_count(quality, count):
    # data sheet's rule at 21.7 MHz and 2 MHz
    assert (settle_count(2e6, quality, 21.7e6), settle_count(10e6, 1, 21.7e6)) == (count, 4)


@pytest.mark.parametrize(("call", "message"), [
    *((partial(code_to_frequency, end, 21.7e6), "the ends mark a range error") for end in (0, (1 << 28) - 1)),
    (lambda: code_to_frequency(1, math.nan), "reference must be positive and finite"),
    (lambda: code_to_frequency(1, 1e6, divider=16), "divider must be 1 to 15; got 16"),
    (lambda: inductance_from_frequency(0, 1e-12), "frequency must be positive and finite; got 0"),
    (lambda: inductance_from_frequency(1e6, -1), "capacitance must be positive and finite; got -1"),
    (lambda: inductance_from_frequency(1e6, 1e-9, 1.0), "quality_factor must be above 1; got 1.0"),
    (lambda: inductance_from_frequency(1e6, 1e-9, math.nan), "quality_factor must be above 1; got nan"),
    (lambda: inductance_from_frequency(50e6, 1e-12, 1.2), "no inductance oscillates at 50000000.0 Hz"),
    (lambda: drive_for(math.nan), "parallel_resistance must be positive; got nan"),
    *((partial(deglitch_for, f), "frequency must be 1 kHz to 10 MHz") for f in (999.0, 10.1e6)),
    (lambda: drive_for(0), "parallel_resistance must be positive; got 0"),
    (lambda: check_channel(0, 1e3, 10), "frequency must be positive; got 0"),
    (lambda: settle_count(1e6, -1), "quality_factor must be positive; got -1"),
])  # fmt: skip
def test_bad_input(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_times_of_the_parts():
    for count, clocks in ((0, 32), (2, 32), (3, 48), (0x100, 4096)):
        assert settle_time(count, 21.7e6) == pytest.approx(clocks / 21.7e6, rel=1e-12)
    # facts: 48.321 ms, 240 µs; the data sheet's example: RCOUNT 0x04D6 at 20 MHz converts in about 0.99 ms
    assert conversion_time(0xFFFF, 21.7e6) * 1e3 == pytest.approx(48.321, abs=5e-4)
    assert conversion_time(0x04D6, 20e6) == pytest.approx(0.99e-3, abs=0.005e-3)
    assert (bus_time(reads=2), bus_time(writes=2)) == pytest.approx((240e-6, 190e-6), rel=1e-12)
    # an external oscillator of 40 MHz by two cannot give the scan time of the paper
    assert 6 * conversion_time(0xFFFF, 20e6) > 314e-3


FIXED_DRIVE = {"RP_OVERRIDE_EN": 1, "SENSOR_ACTIVATE_SEL": 0, "AUTO_AMP_DIS": 1}


def test_what_can_be_written():
    read_only = {name for name, entry in registers().items() if not entry.writable_mask}
    data = {f"DATA{k}_{part}" for k in range(4) for part in ("MSB", "LSB")}
    assert read_only == data | {"STATUS", "MANUFACTURER_ID", "DEVICE_ID"}
    assert [entry.address for entry in registers().values()] == sorted({e.address for e in registers().values()})


@pytest.mark.parametrize("name", registers())
def test_every_bit_once(name):
    masks = [field.mask for field in register(name).fields]
    assert sum(masks) == functools.reduce(operator.or_, masks) == 0xFFFF
    assert all(field.reset <= field.largest for field in register(name).fields)


@pytest.mark.parametrize(("name", "fields", "value"), [
    # the data sheet's worked examples
    ("RCOUNT0", {"RCOUNT0": 0x04D6}, 0x04D6),
    ("MUX_CONFIG", {"AUTOSCAN_EN": 1, "DEGLITCH": 4}, 0x820C),
    *(("DRIVE_CURRENT0", {"IDRIVE0": code}, word) for code, word in ((18, 0x9000), (31, 0xF800), (19, 0x9800))),
    ("CONFIG", {"SLEEP_MODE_EN": 0, "REF_CLK_SRC": 1, **FIXED_DRIVE}, 0x1601),
    # of the reference board
    ("CLOCK_DIVIDERS0", {"FIN_DIVIDER0": 1, "FREF_DIVIDER0": 2}, 0x1002),
    ("CONFIG", FIXED_DRIVE, 0x3401),
    ("RESET_DEV", {"RESET_DEV": 1}, 0x8000),
])  # fmt: skip
def test_registers_of_the_data_sheets_examples(name, fields, value):
    assert encode(name, fields) == value
    assert decode(name, value) | fields == decode(name, value)
    assert register("CONFIG").field("SLEEP_MODE_EN").mask == ASLEEP


@pytest.mark.parametrize(("call", "message"), [
    # a stuck bus is no CONFIG; the reset value of the dividers is reserved, so the register must be programmed
    *((partial(decode, "CONFIG", stuck), "CONFIG must read") for stuck in (0x0000, 0xFFFF)),
    (lambda: decode("CONFIG", 0x10000), "CONFIG holds 0 to 0xFFFF; got 0x10000"),
    (lambda: register("RCOUNT4"), "no register 'RCOUNT4'"),
    (lambda: encode("STATUS", {}), "STATUS is read-only"),
    *((partial(encode, "CONFIG", {name: 1}), f"CONFIG has the fields ACTIVE_CHAN, .*; got '{name}'")
      for name in ("SLEEP", "RESERVED")),
    *((partial(encode, "CONFIG", {"ACTIVE_CHAN": value}), f"ACTIVE_CHAN must be .* 0 to 3; got {value}")
      for value in (4, -1, 1.0, True)),
    (lambda: encode("RCOUNT0", {"RCOUNT0": 4}), "RCOUNT0 must be 5 to 65535; got 4"),
    (lambda: encode("CLOCK_DIVIDERS1", {}), "FIN_DIVIDER1 must be 1 to 15; got 0"),
    (lambda: encode("CLOCK_DIVIDERS1", {"FIN_DIVIDER1": 1}), "FREF_DIVIDER1 must be 1 to 1023; got 0"),
    (lambda: encode("MUX_CONFIG", {"DEGLITCH": 3}), "DEGLITCH must be 1, 4, 5 or 7"),
    (lambda: encode("DRIVE_CURRENT0", {"INIT_IDRIVE0": 1}), "INIT_IDRIVE0 must be 0 when it is written; got 1"),
])  # fmt: skip
def test_registers_refuse(call, message):
    with pytest.raises(HardwareError, match=message):
        call()
