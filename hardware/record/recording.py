"""Reading of recordings, and their summaries.

Every scan has its raw words, the place of the indenter, and the settings of the board.
"""

from __future__ import annotations

import json
import math
import sqlite3
from collections import Counter
from collections.abc import Generator, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coilarray.design.model import Design, build_design
from coilarray.errors import HardwareError
from coilarray.hardware.record.recording_file import (
    check_pages,
    check_references,
    connect_to_read,
    is_whole,
    reading,
    require_recording,
    scan_checksum,
    table_rows,
)
from coilarray.hardware.scan.readings import (
    Identity,
    RawSample,
    RawScan,
    Reason,
    SampleFault,
    StateReading,
    Verdict,
    read_scan,
)
from coilarray.hardware.scan.settings import ScanSettings

if TYPE_CHECKING:
    from coilarray.hardware.record.campaign import Campaign


@dataclass(frozen=True)
class GridPlace:
    """One position of the indenter in a campaign."""

    number: int  # in the order of the campaign, from 0
    repeat: int  # number of the pass over the whole grid, from 0
    depth: float  # m
    y: float  # m from the map's origin
    x: float  # m, likewise


@dataclass(frozen=True, eq=False)
class RecordedSession:
    """Properties of all scans while a board is open."""

    started: float  # s since the epoch
    identity: Identity
    port: str
    settings: ScanSettings
    wiring: str
    capacitances: Mapping[str, float]  # of the tank in F by state, as assumed while measuring
    design: str
    design_hash: str  # digest of the design
    design_document: Mapping[str, Any]  # as input for `coilarray.design.model.build_design`
    version: str  # of this program


@dataclass(frozen=True)
class RecordedScan:
    """A scan and the circumstances of its measurement."""

    number: int  # in the recording, rising
    scan: RawScan
    session: int  # index in `Recording.sessions`
    stage: str  # part of the measurement: "stream", "single", "baseline" or "peak"
    position: int | None  # number of the attempt at a place; `Recording.positions` holds the finished attempts
    place: GridPlace | None
    depth: float | None  # of the indenter in m if known; 0 if it does not touch
    temperature: float | None  # in °C, if a thermometer was given and its reading known


@dataclass(frozen=True)
class RecordedSelfTest:
    """Result of a self-test before or after a campaign."""

    session: int  # index in `Recording.sessions`
    time: float  # s since the epoch
    symptoms: tuple[str, ...]  # deviations from a good board
    findings: tuple[str, ...]  # faults that each explain the deviations alone

    @property
    def passed(self) -> bool:
        """Whether no fault was visible."""
        return not self.symptoms


class Recording:
    """A recording that is open for reading."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection
        with reading(path):
            require_recording(connection, path)
        rows = self.rows("session")
        self._sessions = {int(row["id"]): k for k, row in enumerate(rows)}
        self.sessions = tuple(self._session(row) for row in rows)
        self.campaign = next((str(row["plan"]) for row in self.rows("campaign")), None)
        if not self.sessions:
            raise HardwareError(f"{path} is damaged: it has no session.")

    @property
    def emulated(self) -> bool:
        """Whether the board was an emulator."""
        return any(session.identity.emulated for session in self.sessions)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states of a scan, in order."""
        return tuple(state.name for state in self.sessions[0].settings.states)

    @cached_property
    def design(self) -> Design:
        """Design of the first session."""
        return build_design(self.sessions[0].design_document, str(self.path))

    def self_tests(self) -> tuple[RecordedSelfTest, ...]:
        """Return the self-tests in time order."""
        return tuple(self._self_test(row) for row in self.rows("self_test"))

    def count(self) -> int:
        """Return the number of scans."""
        with reading(self.path):
            return int(self._connection.execute("SELECT count(*) FROM scan").fetchone()[0])

    def positions(self) -> dict[int, GridPlace]:
        """Return the finished places by position number."""
        rows = [row for row in self.rows("position") if row["finished"] is not None]
        rows.sort(key=lambda row: row["place"])
        return {row["id"]: _place(row) for row in rows}

    def scans(self, *, after: int = 0, finished: bool = False) -> Generator[RecordedScan]:
        """Read the scans in the order of measurement."""
        with closing(self._scans(after)) as found:
            for scan, ended in found:
                if ended or not finished:
                    yield scan

    def _scans(self, after: int) -> Generator[tuple[RecordedScan, bool]]:
        """Read the scans after a number."""
        query = """
            SELECT scan.id, scan.session, scan.position, scan.stage, scan.depth, scan.sequence, scan.time,
                   scan.received, scan.temperature, scan.checksum,
                   sample.state, sample.msb, sample.lsb, sample.status, sample.fault
            FROM scan JOIN sample ON sample.scan = scan.id
            WHERE scan.id > ? ORDER BY scan.id, sample.state
        """
        before, positions = after, _Positions(self)
        with reading(self.path), closing(self._connection.execute(query, (after,))) as rows:
            for number, group in groupby(rows, key=lambda row: row[0]):
                if number != before + 1:
                    raise HardwareError(f"{self.path} is damaged: scan {before + 1} is missing.")
                before = number
                yield self._scan(list(group), positions)

    def check(self) -> None:
        """Read the whole file to check it for damage."""
        check_references(self._connection, self.path)
        self.self_tests()
        self.positions()
        for _ in self.scans():
            pass

    def rows(self, table: str, which: str = "", *values: Any) -> list[dict[str, Any]]:
        """Read rows of a table other than the scans."""
        with reading(self.path):
            rows = table_rows(self._connection, table, which, *values)
        for row in rows:
            if not is_whole(table, row):
                name = {"self_test": "self-test"}.get(table, table)
                raise HardwareError(f"{self.path} is damaged: {name} {row['id']}: its checksum is wrong.")
        return rows

    def _scan(self, rows: list[tuple[Any, ...]], positions: _Positions) -> tuple[RecordedScan, bool]:
        """Build a scan from its rows and check it."""
        number, session, position, stage, depth, sequence, time, received, celsius, kept = rows[0][:10]
        try:
            index = self._sessions[session]
            settings, identity = self.sessions[index].settings, self.sessions[index].identity
            if [row[10] for row in rows] != list(range(len(settings.states))):
                raise ValueError(f"a scan has {len(rows)} samples of {len(settings.states)} states")
            samples = tuple(
                RawSample(msb, lsb, status, SampleFault(fault))
                for msb, lsb, status, fault in (row[11:] for row in rows)
            )
            scan = RawScan(sequence, time, received, settings.hash, identity.boot, samples)
            if kept != scan_checksum(number, session, position, stage, depth, celsius, scan):
                raise ValueError("its checksum is wrong")
            place, ended = (None, False) if position is None else positions[position]
            return RecordedScan(number, scan, index, stage, position, place, depth, celsius), ended
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise HardwareError(f"{self.path} is damaged: scan {number}: {error}.") from None

    def _self_test(self, row: Mapping[str, Any]) -> RecordedSelfTest:
        try:
            symptoms, findings = (tuple(json.loads(row[name])) for name in ("symptoms", "findings"))
            return RecordedSelfTest(self._sessions[row["session"]], row["time"], symptoms, findings)
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
            raise HardwareError(f"{self.path} is damaged: self-test {row['id']}: {error}.") from None

    def _session(self, row: Mapping[str, Any]) -> RecordedSession:
        """Build a session from its row and check it."""
        try:
            settings = ScanSettings.from_json(row["settings"])
            if settings.hash != row["settings_hash"]:
                raise ValueError("the settings are not those of their hash")
            return RecordedSession(
                started=row["started"],
                identity=Identity(**json.loads(row["identity"])),
                port=row["port"],
                settings=settings,
                wiring=row["wiring"],
                capacitances=json.loads(row["capacitances"]),
                design=row["design"],
                design_hash=row["design_hash"],
                design_document=json.loads(row["design_document"]),
                version=row["version"],
            )
        except (KeyError, TypeError, ValueError, OverflowError, AttributeError, RecursionError, HardwareError) as error:
            raise HardwareError(f"{self.path} is damaged: session {row['id']}: {error}.") from None


class _Positions(dict[int, tuple[GridPlace, bool]]):
    """Place of every position by its number.

    The place, and whether it was finished, is read when a scan first needs it.
    """

    def __init__(self, recording: Recording) -> None:
        super().__init__()
        self._recording = recording

    def __missing__(self, number: int) -> tuple[GridPlace, bool]:
        for row in self._recording.rows("position", "WHERE id = ?", number):
            self[number] = _place(row), row["finished"] is not None
            return self[number]
        raise ValueError(f"its position {number} is missing")


def _place(row: Mapping[str, Any]) -> GridPlace:
    """Return the place in the row of a position."""
    return GridPlace(row["place"], row["repeat"], row["depth"], row["y"], row["x"])


@contextmanager
def open_recording(path: Path) -> Iterator[Recording]:
    """Open a recording for reading.

    A program that writes it at the same time is not disturbed. The structure of the file is checked at once, and its
    contents on reading.
    """
    with closing(connect_to_read(path)) as connection:
        check_pages(connection, path)
        yield Recording(path, connection)


def iso_time(seconds: float) -> str:
    """Return a time as ISO 8601, to a second."""
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="seconds")


class StateSummary:
    """Statistics of the readings of a state."""

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
    """Summary of a whole recording."""

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
    """Read a whole recording of any kind and summarize it."""
    from coilarray.hardware.record.campaign import Campaign

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
        for state, one in zip(states, readings, strict=True):
            state.add(one, pressed=(scan.depth or 0.0) > 0)
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
