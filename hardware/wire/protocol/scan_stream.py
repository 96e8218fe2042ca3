"""Scans of a stream, each once and in order.

The module unwraps the board's time and decides which scans to accept.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace

from coilarray.hardware.wire.faults import BoardRestarted
from coilarray.hardware.wire.protocol.messages import ScanMessage

_WRAP = 1 << 32  # µs of the board's clock, 71.6 minutes


class BoardTime:
    """Unwrapped time of a board with a 32-bit clock.

    The computer's clock is the guide. The two clocks may differ by half a wrap (35 minutes) between two readings, so
    pauses of any length are bridged. A board whose clock is off by 1 % may be silent for 59 hours.

    Examples
    --------
    >>> time = BoardTime()
    >>> time.unwrap(0xFFFFFFFF, now=100.0), time.unwrap(9, now=100.1)
    (4294967295, 4294967305)
    """

    def __init__(self) -> None:
        self._newest: int | None = None
        self._then = 0.0

    def unwrap(self, microseconds: int, now: float) -> int:
        """Return the board's time without wraps in µs.

        It counts since the wrap before the first reading. `microseconds` is the time from the board, 0 to 2³² − 1,
        perhaps older than a previous time. `now` is the computer's time in s, which never steps back.
        """
        if self._newest is None:
            self._newest, self._then = microseconds, now
            return microseconds
        expected = self._newest + (now - self._then) * 1e6
        unwrapped = microseconds + _WRAP * round((expected - microseconds) / _WRAP)
        if unwrapped > self._newest:
            self._newest, self._then = unwrapped, now
        return unwrapped


@dataclass(frozen=True)
class GateCounts:
    """Counts of the scans at a gate."""

    passed: int = 0
    lost: int = 0  # missing numbers of the sequence before accepted scans
    repeated: int = 0  # rejected because their number, or a later one, had been accepted
    stale: int = 0  # rejected because they are older than the stream or than an earlier scan
    misfit: int = 0  # rejected because they have another number of states than the settings

    def __add__(self, other: GateCounts) -> GateCounts:
        return GateCounts(*map(sum, zip(astuple(self), astuple(other), strict=True)))


def same_settings(scan: ScanMessage, configuration: int) -> bool:
    """Check whether a scan was measured with these settings.

    The settings are given by their hash.
    """
    return scan.configuration == configuration


class ScanGate:
    """Filter of the scans of one stream.

    It uses the hash of the settings and the number of their states. The stream began after `start`, an unwrapped time
    of the board in µs.
    """

    def __init__(self, *, configuration: int, states: int, start: int) -> None:
        self._configuration, self._states = configuration, states
        self._newest = start
        self._sequence = -1
        self._counts = GateCounts()

    @property
    def counts(self) -> GateCounts:
        """Counts so far."""
        return self._counts

    def passes(self, scan: ScanMessage, time: int) -> bool:
        """Decide whether to accept a scan, and count it.

        `time` is its unwrapped time in µs. A board that measures with other settings raises BoardRestarted.
        """
        counts = self._counts
        if time < self._newest:
            self._counts = replace(counts, stale=counts.stale + 1)
            return False
        if not same_settings(scan, self._configuration):
            raise BoardRestarted(
                f"the board measures with the settings {scan.configuration:04X}, not with {self._configuration:04X}; "
                "configure it again."
            )
        if len(scan.samples) != self._states:
            self._counts = replace(counts, misfit=counts.misfit + 1)
            return False
        if scan.sequence <= self._sequence:
            self._counts = replace(counts, repeated=counts.repeated + 1)
            return False
        lost = scan.sequence - self._sequence - 1
        self._counts = replace(counts, passed=counts.passed + 1, lost=counts.lost + lost)
        self._sequence, self._newest = scan.sequence, time
        return True
