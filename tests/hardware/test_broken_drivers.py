"""The emulator and its checks find what is wrong with every driver of `broken_drivers`, and nothing in a right one."""

from __future__ import annotations

import re
from typing import ClassVar

import pytest
from support.broken_drivers import BROKEN, CAPACITANCE, DRIVES, RCOUNT, WIRING, Reading, RightDriver, findings
from support.emulated_reader import reader_of

from coilarray.hardware.scan.readings import Reason, read_scan
from coilarray.hardware.scan.settings import scan_settings


@pytest.mark.slow
@pytest.mark.parametrize("wrong", BROKEN)
def test_every_broken_driver_is_found(wrong):
    driver, finding = BROKEN[wrong]
    found = findings(driver)
    assert any(re.match(f"(?:transaction .*)?{finding}", one) for one in found), found[:5]


def test_no_broken_driver_is_named_like_another():
    assert len(BROKEN) == 32


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
        self.reader = reader_of(board)

    def configure(self):
        self.reader.configure(self.settings)

    def scan(self):
        found = read_scan(self.reader.scan(), self.settings, CAPACITANCE)
        self.reader.rest()
        return {
            state.name: Reading(state.frequency, frozenset(self._NAMES.get(r, str(r)) for r in state.reasons))
            for state in found.states
        }


@pytest.mark.parametrize("driver", [RightDriver, PackagesDriver])
def test_a_right_driver_has_no_findings(driver):
    assert findings(driver) == []
