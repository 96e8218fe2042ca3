"""Which scans of a stream are given out: those of this stream and these settings, each once, in order."""

from __future__ import annotations

from dataclasses import dataclass, replace

from coilarray.hardware.wire.faults import BoardRestarted
from coilarray.hardware.wire.protocol.messages import ScanMessage


@dataclass(frozen=True)
class GateCounts:
    """What a gate met so far.

    Parameters
    ----------
    passed : int
        Scans given out.
    lost : int
        Missing numbers of the sequence before scans that were given out.
    repeated : int
        Scans held back: their number, or a later one, had been given out.
    stale : int
        Scans held back: older than the stream, or than a scan before them.
    misfit : int
        Scans held back: another number of states than the settings have.
    """

    passed: int = 0
    lost: int = 0
    repeated: int = 0
    stale: int = 0
    misfit: int = 0

    def __add__(self, other: GateCounts) -> GateCounts:
        return GateCounts(
            self.passed + other.passed,
            self.lost + other.lost,
            self.repeated + other.repeated,
            self.stale + other.stale,
            self.misfit + other.misfit,
        )


def same_settings(scan: ScanMessage, configuration: int) -> bool:
    """Whether a scan was measured with the settings of this hash."""
    return scan.configuration == configuration


class ScanGate:
    """Judges the scans of one stream.

    Parameters
    ----------
    configuration : int
        Hash of the settings.
    states : int
        Of the settings.
    start : int
        Unwrapped time of the board in µs before the stream began.
    """

    def __init__(self, *, configuration: int, states: int, start: int) -> None:
        self._configuration, self._states = configuration, states
        self._newest = start
        self._sequence = -1
        self._counts = GateCounts()

    @property
    def counts(self) -> GateCounts:
        """What was met so far."""
        return self._counts

    def passes(self, scan: ScanMessage, time: int) -> bool:
        """Whether to give out a scan whose unwrapped time in µs is given; counts it.

        Raises
        ------
        BoardRestarted
            The board measures with other settings.
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
