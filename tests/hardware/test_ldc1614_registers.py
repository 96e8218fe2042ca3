"""LDC1614 registers: the table covers every bit once, resets and settings are the data sheet's, nothing illegal."""

import functools
import operator

import pytest

from coilarray.errors import HardwareError
from coilarray.hardware.chips.ldc1614 import (
    ASLEEP,
    DEVICE,
    MANUFACTURER,
    decode,
    encode,
    register,
    registers,
)

RESETS = {
    **{f"DATA{k}_{part}": 0 for k in range(4) for part in ("MSB", "LSB")},
    **{f"RCOUNT{k}": 0x0080 for k in range(4)},
    **{f"{name}{k}": 0 for name in ("OFFSET", "SETTLECOUNT", "CLOCK_DIVIDERS", "DRIVE_CURRENT") for k in range(4)},
    "STATUS": 0, "ERROR_CONFIG": 0, "CONFIG": 0x2801, "MUX_CONFIG": 0x020F, "RESET_DEV": 0,
    "MANUFACTURER_ID": 0x5449, "DEVICE_ID": 0x3055,
}  # fmt: skip
ADDRESSES = {
    "DATA0_MSB": 0x00, "DATA3_LSB": 0x07, "RCOUNT0": 0x08, "OFFSET0": 0x0C, "SETTLECOUNT0": 0x10,
    "CLOCK_DIVIDERS3": 0x17, "STATUS": 0x18, "ERROR_CONFIG": 0x19, "CONFIG": 0x1A, "MUX_CONFIG": 0x1B,
    "RESET_DEV": 0x1C, "DRIVE_CURRENT0": 0x1E, "DRIVE_CURRENT3": 0x21, "MANUFACTURER_ID": 0x7E, "DEVICE_ID": 0x7F,
}  # fmt: skip
FIXED_DRIVE = {"RP_OVERRIDE_EN": 1, "SENSOR_ACTIVATE_SEL": 0, "AUTO_AMP_DIS": 1}
WRITABLE = [name for name, entry in registers().items() if entry.writable_mask]


def test_resets_and_what_can_be_written():
    # data sheet, pages 15 to 33
    assert {name: entry.reset for name, entry in registers().items()} == RESETS
    assert (RESETS["MANUFACTURER_ID"], RESETS["DEVICE_ID"]) == (MANUFACTURER, DEVICE)
    # what can be written
    assert set(WRITABLE) == set(RESETS) - {
        *(f"DATA{k}_{part}" for k in range(4) for part in ("MSB", "LSB")), "STATUS", "MANUFACTURER_ID", "DEVICE_ID",
    }  # fmt: skip


def test_addresses():
    assert {name: register(name).address for name in ADDRESSES} == ADDRESSES
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
def test_examples(name, fields, value):
    assert encode(name, fields) == value
    assert decode(name, value) | fields == decode(name, value)
    assert register("CONFIG").field("SLEEP_MODE_EN").mask == ASLEEP


@pytest.mark.parametrize(("call", "message"), [
    # a stuck bus is no CONFIG; the reset value of the dividers is reserved, so the register must be programmed
    *((functools.partial(decode, "CONFIG", stuck), "CONFIG must read") for stuck in (0x0000, 0xFFFF)),
    (lambda: decode("CONFIG", 0x10000), "CONFIG holds 0 to 0xFFFF; got 0x10000"),
    (lambda: register("RCOUNT4"), "no register 'RCOUNT4'"),
    (lambda: encode("STATUS", {}), "STATUS is read-only"),
    *((functools.partial(encode, "CONFIG", {name: 1}), f"CONFIG has the fields ACTIVE_CHAN, .*; got '{name}'")
      for name in ("SLEEP", "RESERVED")),
    *((functools.partial(encode, "CONFIG", {"ACTIVE_CHAN": value}), f"ACTIVE_CHAN must be .* 0 to 3; got {value}")
      for value in (4, -1, 1.0, True)),
    (lambda: encode("RCOUNT0", {"RCOUNT0": 4}), "RCOUNT0 must be 5 to 65535; got 4"),
    (lambda: encode("CLOCK_DIVIDERS1", {}), "FIN_DIVIDER1 must be 1 to 15; got 0"),
    (lambda: encode("CLOCK_DIVIDERS1", {"FIN_DIVIDER1": 1}), "FREF_DIVIDER1 must be 1 to 1023; got 0"),
    (lambda: encode("MUX_CONFIG", {"DEGLITCH": 3}), "DEGLITCH must be 1, 4, 5 or 7"),
    (lambda: encode("DRIVE_CURRENT0", {"INIT_IDRIVE0": 1}), "INIT_IDRIVE0 must be 0 when it is written; got 1"),
])  # fmt: skip
def test_refused(call, message):
    with pytest.raises(HardwareError, match=message):
        call()
