"""Chips that remember, the compiled firmware, a pseudo-terminal and the driver, for tests that spoil one of them."""

import itertools
import random
import time
from contextlib import closing

import pytest

from coilarray.hardware.board.microcontroller import MicrocontrollerReader
from coilarray.hardware.emulator import VirtualClock
from coilarray.hardware.wire.link import LinkTimes
from coilarray.hardware.wire.serial_ports import open_serial_port
from support import patience
from support.emulated_reader import quick_settings
from support.firmware_host import FirmwareHost
from support.witnessed_chips import Witness, WitnessedChain, WitnessedConverter

COILS = ("coil1", "coil3", "coil4")
SETTINGS = quick_settings(coils=COILS)
LONGEST = 0.05  # s: a scan in which no state has a result
TIMES = LinkTimes(reply=0.04, attempts=14, opening=0.1, gap=3.0, least_gap=1.6, heartbeat=2.0, ping=0.05, foreign=200)
COMMAND = TIMES.attempts * (TIMES.reply + LONGEST)  # s until a command is given up
GAP = TIMES.least_gap + 2 * LONGEST  # s until a stream is
OPENING = 2 * COMMAND + 30 * (TIMES.reply + LONGEST)  # s that a new session and its settings may take
SLACK = 2.0  # s in which this process runs and computes instead of waiting
_COUNTED = 0.05  # s between two looks at the clock that count at most; a port is waited for in steps of 0.02 s


class DriverClock:
    """Real time for a driver whose board is a thread of the same process.

    What a busy computer takes away does not count: the board had no time to answer then either.
    """

    sleep = staticmethod(time.sleep)

    def __init__(self):
        self._seconds, self._last = 0.0, time.monotonic()

    def now(self):
        now = time.monotonic()
        self._seconds += min(now - self._last, _COUNTED)
        self._last = now
        return self._seconds


class Bench:
    """Chips, firmware and driver; `reader` is configured."""

    def __init__(self, seed):
        self.noise = random.Random(seed)
        self.clock = VirtualClock(4294.0)  # the board's microseconds wrap a second later
        self.converter = WitnessedConverter(self.clock, SETTINGS)
        self.chain = WitnessedChain(self.clock, self.converter, len(SETTINGS.safe_words))
        self.host = FirmwareHost(self.converter, self.chain, self.clock)
        self.witness = Witness(self.converter)
        self.reader = self.open()
        self.reader.configure(SETTINGS)

    def open(self):
        port = open_serial_port(self.host.port)
        try:
            return MicrocontrollerReader(port, times=TIMES, clock=DriverClock(), reopen=self.open)
        except BaseException:
            port.close()
            raise

    def renew(self):
        """A new session after one that has ended."""
        with lasting(OPENING):
            self.reader = self.reader.reconnect()
            self.reader.configure(SETTINGS)

    def scans(self, count):
        """Fetch so many scans of a stream, each looked at; the stream is closed."""
        with closing(self.reader.scans()) as stream:
            drained(itertools.islice(stream, count), self)

    def goes_on(self):
        """Whether reading resumes: streams and single scans, all good."""
        named, accepted = self.witness.named.total(), self.witness.accepted
        self.scans(2)
        self.witness.look(self.reader.scan())
        assert (self.witness.accepted - accepted, self.witness.named.total()) == (3 * len(COILS), named)
        return True

    def close(self):
        with lasting(COMMAND):
            self.reader.close()
        self.host.close()


def lasting(seconds):
    """A block that must not take longer than its timeouts, and what it computes."""
    return patience.lasting(seconds + SLACK)


def meets(fault, call, seconds, match=None):
    """Whether a call ends with this fault in time."""
    with lasting(seconds), pytest.raises(fault, match=match):
        call()
    return True


def drained(stream, bench):
    for scan in stream:
        bench.witness.look(scan)
