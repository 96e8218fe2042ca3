"""Summary of a recording: its origin, its extent, and the quality of its readings."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from coilarray.hardware.record.campaign import Campaign
from coilarray.hardware.record.recording import RecordedSelfTest, Recording
from coilarray.hardware.scan.readings import Reason, Verdict, read_scan


@dataclass(frozen=True, eq=False)
class StateSummary:
    """All readings of a state.

    Parameters
    ----------
    name : str
        Name of the state.
    frequency, inductance : float or None
        Means in Hz and H; None where nothing was good or doubtful.
    noise : float or None
        Relative standard deviation of the inductance at rest, from the differences of successive scans, in which a
        drift cancels; None where there are no two such scans.
    verdicts : mapping of str to int
        Numbers of good, doubtful and bad readings.
    reasons : mapping of Reason to int
        Numbers of readings by the reason why they are not good.
    """

    name: str
    frequency: float | None
    inductance: float | None
    noise: float | None
    verdicts: Counter[Verdict]
    reasons: Counter[Reason]


@dataclass(frozen=True, eq=False)
class RecordingSummary:
    """A recording as a whole.

    Parameters
    ----------
    file : str
        Path of the file.
    emulated : bool
        Whether the board was an emulator.
    design, design_hash, wiring, version : str
        Design, wiring and version of this program, from the first session.
    sessions : tuple of mapping
        Time, board and number of scans of every session, for JSON.
    scans : int
        Number of scans of all sessions.
    lost : int
        Number of scans of streams that the board numbered and that never arrived.
    seconds : float
        Total time from the first to the last scan of every session, by the board's clock.
    rate : float or None
        Recorded scans per second, without the pauses between sessions; None for a campaign, or too few scans.
    states : tuple of StateSummary
        Readings of every state, in the order of the scan.
    campaign : Campaign or None
        Plan of the campaign, where there is one.
    positions : int
        Number of positions of the campaign that were measured to their end.
    self_tests : tuple of RecordedSelfTest
        Self-tests before and after a campaign.
    """

    file: str
    emulated: bool
    design: str
    design_hash: str
    wiring: str
    version: str
    sessions: tuple[dict[str, Any], ...]
    scans: int
    lost: int
    seconds: float
    rate: float | None
    states: tuple[StateSummary, ...]
    campaign: Campaign | None
    positions: int
    self_tests: tuple[RecordedSelfTest, ...]

    def to_record(self) -> dict[str, Any]:
        """Return everything as plain values in SI, for JSON."""
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
                    "time": datetime.fromtimestamp(test.time, UTC).isoformat(timespec="seconds"),
                    "passed": test.passed,
                    "symptoms": list(test.symptoms),
                    "findings": list(test.findings),
                }
                for test in self.self_tests
            ],
        }


def summarize_recording(recording: Recording) -> RecordingSummary:
    """Read a whole recording of any kind and summarize it; HardwareError for a damaged file."""
    states = [_State(name) for name in recording.states]
    times: list[list[float]] = [[] for _ in recording.sessions]
    count, lost = 0, 0
    before: tuple[int, int] | None = None  # session and number of the last scan of a stream
    for scan in recording.scans():
        session = recording.sessions[scan.session]
        if scan.stage == "stream":
            if before is not None and before[0] == scan.session:
                lost += max(scan.scan.sequence - before[1] - 1, 0)
            before = (scan.session, scan.scan.sequence)
        for state, reading in zip(
            states, read_scan(scan.scan, session.settings, session.capacitances).states, strict=True
        ):
            state.verdicts[reading.verdict] += 1
            state.reasons.update(reading.reasons)
            state.add(reading.frequency, reading.inductance, pressed=(scan.depth or 0.0) > 0)
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
                "started": datetime.fromtimestamp(session.started, UTC).isoformat(timespec="seconds"),
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
        states=tuple(state.summary() for state in states),
        campaign=None if recording.campaign is None else Campaign.from_json(recording.campaign),
        positions=len(recording.positions()),
        self_tests=recording.self_tests(),
    )


class _State:
    """Gathers the readings of a state."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.verdicts: Counter[Verdict] = Counter()
        self.reasons: Counter[Reason] = Counter()
        self._count = self._steps = 0
        self._frequency = self._inductance = self._squares = 0.0  # sums
        self._last: float | None = None

    def add(self, frequency: float | None, inductance: float | None, *, pressed: bool) -> None:
        if frequency is None or inductance is None:
            return
        self._count += 1
        self._frequency += frequency
        self._inductance += inductance
        if not pressed:
            if self._last is not None:
                self._steps += 1
                self._squares += (inductance - self._last) ** 2
            self._last = inductance

    def summary(self) -> StateSummary:
        if not self._count:
            return StateSummary(self.name, None, None, None, self.verdicts, self.reasons)
        frequency, inductance = self._frequency / self._count, self._inductance / self._count
        # the difference of two readings has twice the variance of one
        noise = math.sqrt(self._squares / self._steps / 2) / inductance if self._steps else None
        return StateSummary(self.name, frequency, inductance, noise, self.verdicts, self.reasons)
