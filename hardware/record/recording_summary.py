"""Summary of a recording.

It gives the origin, the extent, and the quality of the readings.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import Any

from coilarray.hardware.record.campaign import Campaign
from coilarray.hardware.record.recording import RecordedSelfTest, Recording, iso_time
from coilarray.hardware.scan.readings import Reason, StateReading, Verdict, read_scan


class StateSummary:
    """Statistics of the readings of a state.

    Means are None if no reading was good or doubtful.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.verdicts: Counter[Verdict] = Counter()
        self.reasons: Counter[Reason] = Counter()
        """Numbers of readings that are not good, by reason."""
        self._count = self._steps = 0
        self._frequency = self._inductance = self._squares = 0.0  # sums
        self._last: float | None = None

    def add(self, reading: StateReading, *, pressed: bool) -> None:
        """Add a reading.

        `pressed` means that the indenter presses, so that the reading does not count for the noise.
        """
        self.verdicts[reading.verdict] += 1
        self.reasons.update(reading.reasons)
        if reading.frequency is None or reading.inductance is None:
            return
        self._count += 1
        self._frequency += reading.frequency
        self._inductance += reading.inductance
        if not pressed:
            if self._last is not None:
                self._steps += 1
                self._squares += (reading.inductance - self._last) ** 2
            self._last = reading.inductance

    @property
    def frequency(self) -> float | None:
        """Mean frequency in Hz."""
        return self._frequency / self._count if self._count else None

    @property
    def inductance(self) -> float | None:
        """Mean inductance in H."""
        return self._inductance / self._count if self._count else None

    @property
    def noise(self) -> float | None:
        """Relative standard deviation of the inductance at rest.

        It comes from differences of scans, in which a drift cancels. The difference of two readings has twice the
        variance of a single reading. The value is None if no two such scans exist.
        """
        mean = self.inductance
        return math.sqrt(self._squares / self._steps / 2) / mean if mean is not None and self._steps else None


@dataclass(frozen=True, eq=False)
class RecordingSummary:
    """Summary of a whole recording.

    Design, wiring and version of this program are taken from the first session.
    """

    file: str
    emulated: bool
    design: str
    design_hash: str
    wiring: str
    version: str
    sessions: tuple[dict[str, Any], ...]  # time, board and number of scans of each, for JSON
    scans: int
    lost: int  # scans of streams that the board numbered but that never arrived
    seconds: float  # from the first to the last scan of every session, by the board's clock
    rate: float | None  # scans/s without the pauses between sessions; None for a campaign, or too few scans
    states: tuple[StateSummary, ...]
    campaign: Campaign | None
    positions: int  # of the campaign, measured to their end
    self_tests: tuple[RecordedSelfTest, ...]  # before and after a campaign

    def to_record(self) -> dict[str, Any]:
        """Return all values as plain values in SI, for JSON."""
        plan = self.campaign
        return {
            "file": self.file,
            "emulated": self.emulated,
            "design": self.design,
            "design_hash": self.design_hash,
            "wiring": self.wiring,
            "coilarray_version": self.version,
            "sessions": list(self.sessions),
            "scans": self.scans,
            "lost_scans": self.lost,
            "seconds": self.seconds,
            "rate_per_s": self.rate,
            "states": [
                {
                    "state": state.name,
                    "frequency_Hz": state.frequency,
                    "inductance_H": state.inductance,
                    "relative_noise": state.noise,
                    **{verdict: state.verdicts[verdict] for verdict in ("good", "doubtful", "bad")},
                    "reasons": {str(reason): count for reason, count in state.reasons.items()},
                }
                for state in self.states
            ],
            "campaign": None if plan is None else {**plan.to_record(), "measured": self.positions},
            "self_tests": [
                {
                    "session": test.session,
                    "time": iso_time(test.time),
                    "passed": test.passed,
                    "symptoms": list(test.symptoms),
                    "findings": list(test.findings),
                }
                for test in self.self_tests
            ],
        }


def summarize_recording(recording: Recording) -> RecordingSummary:
    """Read a whole recording of any kind and summarize it.

    A damaged file raises a HardwareError.
    """
    states = tuple(StateSummary(name) for name in recording.states)
    times: list[list[float]] = [[] for _ in recording.sessions]
    count, lost = 0, 0
    before: tuple[int, int] | None = None  # session and number of the last scan of a stream
    for scan in recording.scans():
        session = recording.sessions[scan.session]
        if scan.stage == "stream":
            if before is not None and before[0] == scan.session:
                lost += max(scan.scan.sequence - before[1] - 1, 0)
            before = (scan.session, scan.scan.sequence)
        readings = read_scan(scan.scan, session.settings, session.capacitances).states
        for state, reading in zip(states, readings, strict=True):
            state.add(reading, pressed=(scan.depth or 0.0) > 0)
        times[scan.session].append(scan.scan.time)
        count += 1
    first = recording.sessions[0]
    seconds = sum(of_session[-1] - of_session[0] for of_session in times if of_session)
    steps = sum(len(of_session) - 1 for of_session in times if of_session)
    return RecordingSummary(
        file=str(recording.path),
        emulated=recording.emulated,
        design=first.design,
        design_hash=first.design_hash,
        wiring=first.wiring,
        version=first.version,
        sessions=tuple(
            {
                "started": iso_time(session.started),
                "board": session.identity.kind,
                "port": session.port,
                "boot": f"{session.identity.boot:08X}",
                "settings_hash": f"{session.settings.hash:04X}",
                "scans": len(of_session),
            }
            for session, of_session in zip(recording.sessions, times, strict=True)
        ),
        scans=count,
        lost=lost,
        seconds=seconds,
        rate=steps / seconds if recording.campaign is None and seconds > 0 else None,
        states=states,
        campaign=None if recording.campaign is None else Campaign.from_json(recording.campaign),
        positions=len(recording.positions()),
        self_tests=recording.self_tests(),
    )
