"""The emulator and its checks find what is wrong with every driver of `broken_drivers`, and nothing in a right one."""

from __future__ import annotations

import re
from typing import ClassVar

import pytest
from support.broken_drivers import BROKEN, CAPACITANCE, DRIVES, RCOUNT, WIRING, Reading, RightDriver, findings

from coilarray.hardware.board.direct import DirectReader
from coilarray.hardware.scan.readings import Reason, read_scan
from coilarray.hardware.scan.settings import scan_settings

# what must be found, in whatever words; a driver that were caught for another reason would not count
EXPECTED = {
    "SwappedBytes": "sound: coil. is refused: no result",
    "SwappedBytesWritten": "sound: CONFIG was written with 0x0128: reserved bits",
    "SwappedHalves": "sound: coil. is off by",
    "ShiftedByEight": "sound: coil. is off by",
    "FlagsLeftIn": r"a weak oscillation: [\d.e+]+ Hz",
    "FlagsNotAskedFor": "a weak oscillation: not named",
    "StaleLsb": "sound: DATA0_LSB was read without DATA0_MSB",
    "DividersLeftAtZero": "sound: CLOCK_DIVIDERS0 holds a divider 0",
    "ConfigNotLast": "sound: DRIVE_CURRENT0 was written while the chip was active",
    "StatusReadTwice": "status clears unread: coil. is refused: nothing unread",
    "FirstResultAfterSwitching": "sound: coil[2-6] is off by",
    "OneDriveForAll": "sound: coil[4-6] is doubted: amplitude",
    "ClockHardWired": "sound: coil. is off by",
    "ClockNotCalibrated": "slow clock: coil. is off by",
    "FourChannelsByIdentity": "two channels: .* not documented",
    "SinglePrecision": "sound: coil. is off by",
    "OffsetForgotten": "sound: coil. is off by",
    "OffsetTwiceByReference": "sound: coil. is off by",
    "SettlesTooShort": "sound: SETTLECOUNT0 is 4; this sensor needs",
    "FilterTooLow": "sound: coil. is refused: .*no edges",
    "ReservedBitsCleared": "sound: CONFIG was written with 0x1400: reserved bits",
    "NeverLooksWhetherReady": "slow clock: coil. is refused",
    "SwallowsBusErrors": "not acknowledged: not named",
    "BusErrorsAsNumbers": "not acknowledged: not named",
    "ReadsInSleep": "sound: DATA0_MSB was read while the chip slept",
    "LeavesItAwake": "sound: not left at rest",
    "TwoCoilsAtOnce": "sound: coil[2-6] is refused",
    "GroundedWhileMeasured": "sound: the words .* make a circuit that is short",
    "WrongEndOfTheChain": "sound: coil. is off by",
    "WrongModeOfSpi": "sound: coil. is refused",
    "ReferenceTooFast": "sound: the reference of channel 0 is",
}


def test_a_right_driver_has_no_findings():
    assert findings(RightDriver) == []


@pytest.mark.parametrize("driver", BROKEN, ids=lambda driver: driver.__name__)
def test_every_broken_driver_is_found(driver):
    found = findings(driver)
    assert any(re.match(f"(?:transaction .*)?{EXPECTED[driver.__name__]}", one) for one in found), found[:5]


def test_each_has_its_expectation():
    assert {driver.__name__ for driver in BROKEN} == set(EXPECTED)


class PackagesDriver:
    """The package's own driver and conversion, behind the interface of the others."""

    _NAMES: ClassVar = {
        Reason.WATCHDOG: "under", Reason.UNDER_RANGE: "under", Reason.ZERO_COUNT: "no edges",
        Reason.NOT_ACKNOWLEDGED: "bus", Reason.BUS_TIMEOUT: "bus", Reason.AMPLITUDE: "amplitude",
        Reason.AMPLITUDE_LOW: "amplitude", Reason.AMPLITUDE_HIGH: "amplitude",
    }  # fmt: skip

    def __init__(self, board, clock=43.4e6):
        self.true_clock = clock
        self.settings = scan_settings(WIRING, rcount=RCOUNT, clock=clock, drives=DRIVES)
        self.reader = DirectReader(
            board.bus, board.switches, board.clock, WIRING.safe_words, kind="emulator", emulated=True
        )

    def configure(self):
        self.reader.configure(self.settings)

    def scan(self):
        found = read_scan(self.reader.scan(), self.settings, CAPACITANCE)
        self.reader.rest()
        return {
            state.name: Reading(state.frequency, frozenset(self._NAMES.get(r, str(r)) for r in state.reasons))
            for state in found.states
        }


def test_the_package_s_driver_has_no_findings():
    assert findings(PackagesDriver) == []
