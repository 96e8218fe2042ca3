"""Reading of recordings.

Every scan has its raw words, the place of the indenter, and the settings of the board.
"""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Generator, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import Any

from coilarray.design.model import Design, build_design
from coilarray.errors import HardwareError
from coilarray.hardware.record.recording_file import (
    check_pages,
    check_references,
    connect_to_read,
    has_checksums,
    has_temperatures,
    is_whole,
    reading,
    require_recording,
    scan_checksum,
    table_rows,
)
from coilarray.hardware.scan.reader import Identity, RawSample, RawScan, SampleFault
from coilarray.hardware.scan.settings import ScanSettings

_PLACE = ("place", "repeat", "depth", "y", "x")
"""Columns of a position that are the fields of its `GridPlace`."""


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
    """Properties of all scans while a board is open.

    They hold from opening the board to closing it.
    """

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
    """A recording that is open for reading.

    `open_recording` opens it.

    Attributes
    ----------
    sessions : tuple of RecordedSession
        Sessions in the order in which they began.
    campaign : str or None
        Plan of the campaign as JSON (`coilarray.hardware.record.campaign.Campaign.from_json`), if there is a campaign.
    has_temperatures : bool
        Whether a thermometer was given in any session.
    has_checksums : bool
        Whether its version writes checksums. All data are then checked against them on reading.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection
        with reading(path):
            require_recording(connection, path)
            self.has_checksums, self.has_temperatures = has_checksums(connection), has_temperatures(connection)
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
        """Design of the first session.

        A design that this version cannot read raises a DesignError.
        """
        return build_design(self.sessions[0].design_document, str(self.path))

    def self_tests(self) -> tuple[RecordedSelfTest, ...]:
        """Return the self-tests in time order.

        A damaged file raises a HardwareError.
        """
        return tuple(self._self_test(row) for row in self.rows("self_test"))

    def count(self) -> int:
        """Return the number of scans."""
        with reading(self.path):
            return int(self._connection.execute("SELECT count(*) FROM scan").fetchone()[0])

    def positions(self) -> dict[int, GridPlace]:
        """Return the finished places by position number.

        They are in the order of the campaign.
        """
        rows = [row for row in self.rows("position") if row["finished"] is not None]
        rows.sort(key=lambda row: row["place"])
        return {row["id"]: GridPlace(*(row[name] for name in _PLACE)) for row in rows}

    def scans(self, *, after: int = 0, finished: bool = False) -> Generator[RecordedScan]:
        """Read the scans in the order of measurement.

        A damaged file raises a HardwareError.

        Parameters
        ----------
        after : int
            Number of a scan. Only later scans are read, for following a recording that grows.
        finished : bool
            Whether to read only scans of positions that were measured to their end.
        """
        with closing(self._scans(after)) as found:
            for scan, _, ended in found:
                if ended or not finished:
                    yield scan

    def scan_checksums(self) -> list[tuple[str, int]]:
        """Return the expected checksum and number of every scan."""
        return [(expected, scan.number) for scan, expected, _ in self._scans(0)]

    def _scans(self, after: int) -> Generator[tuple[RecordedScan, str, bool]]:
        """Read the scans after a number.

        Each scan comes with its checksum, and whether its position was finished.
        """
        celsius, beside = "NULL", ""
        if self.has_temperatures:
            celsius, beside = "temperature.celsius", "LEFT JOIN temperature ON temperature.scan = scan.id"
        kept = "scan.checksum" if self.has_checksums else "NULL"
        query = f"""
            SELECT scan.id, scan.session, scan.position, scan.stage, scan.depth, scan.sequence, scan.time,
                   scan.received, {celsius}, {kept}, sample.state, sample.msb, sample.lsb, sample.status, sample.fault
            FROM scan JOIN sample ON sample.scan = scan.id {beside}
            WHERE scan.id > ? ORDER BY scan.id, sample.state
        """
        before, positions = after, _Positions(self)
        with reading(self.path), closing(self._connection.execute(query, (after,))) as rows:
            for number, group in groupby(rows, key=lambda row: row[0]):
                if self.has_checksums and number != before + 1:
                    raise HardwareError(f"{self.path} is damaged: scan {before + 1} is missing.")
                before = number
                yield self._scan(list(group), positions)

    def check(self) -> None:
        """Read the whole file to check it for damage.

        The HardwareError names the first damage.
        """
        check_references(self._connection, self.path)
        self.self_tests()
        self.positions()
        for _ in self.scans():
            pass

    def rows(self, table: str, which: str = "", *values: Any) -> list[dict[str, Any]]:
        """Read rows of a table other than the scans.

        A row that does not match its checksum raises a HardwareError.
        """
        with reading(self.path):
            rows = table_rows(self._connection, table, which, *values)
        for row in rows:
            if not is_whole(table, row):
                name = {"self_test": "self-test"}.get(table, table)
                raise HardwareError(f"{self.path} is damaged: {name} {row['id']}: its checksum is wrong.")
        return rows

    def _scan(self, rows: list[tuple[Any, ...]], positions: _Positions) -> tuple[RecordedScan, str, bool]:
        """Build a scan from its rows and check it."""
        number, session, position, stage, depth, sequence, time, received, celsius, kept = rows[0][:10]
        try:
            index = self._sessions[session]
            settings, identity = self.sessions[index].settings, self.sessions[index].identity
            if [row[10] for row in rows] != list(range(len(settings.states))):
                raise ValueError(f"a scan has {len(rows)} samples of {len(settings.states)} states")
            samples = tuple(
                RawSample(_word(msb), _word(lsb), _word(status), SampleFault(fault))
                for msb, lsb, status, fault in (row[11:] for row in rows)
            )
            scan = RawScan(int(sequence), _finite(time), _finite(received), settings.hash, identity.boot, samples)
            at, warmth = (None if value is None else _finite(value) for value in (depth, celsius))
            expected = scan_checksum(number, session, position, str(stage), at, warmth, scan)
            if self.has_checksums and kept != expected:
                raise ValueError("its checksum is wrong")
            place, ended = (None, False) if position is None else positions[position]
            return RecordedScan(number, scan, index, str(stage), position, place, at, warmth), expected, ended
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise HardwareError(f"{self.path} is damaged: scan {number}: {error}.") from None

    def _self_test(self, row: Mapping[str, Any]) -> RecordedSelfTest:
        try:
            session, time = self._sessions[row["session"]], _date(row["time"])
            return RecordedSelfTest(session, time, _texts(row["symptoms"]), _texts(row["findings"]))
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
            raise HardwareError(f"{self.path} is damaged: self-test {row['id']}: {error}.") from None

    def _session(self, row: Mapping[str, Any]) -> RecordedSession:
        """Build a session from its row and check it."""
        try:
            settings = ScanSettings.from_json(row["settings"])
            if settings.hash != row["settings_hash"]:
                raise ValueError("the settings are not those of their hash")
            identity = _identity(json.loads(row["identity"]))
            return RecordedSession(
                started=_date(row["started"]),
                identity=identity,
                port=str(row["port"]),
                settings=settings,
                wiring=str(row["wiring"]),
                capacitances={str(name): _finite(value) for name, value in json.loads(row["capacitances"]).items()},
                design=str(row["design"]),
                design_hash=str(row["design_hash"]),
                design_document=dict(json.loads(row["design_document"])),
                version=str(row["version"]),
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
            place, repeat, *where = (row[name] for name in _PLACE)
            self[number] = GridPlace(int(place), int(repeat), *map(_finite, where)), row["finished"] is not None
            return self[number]
        raise ValueError(f"its position {number} is missing")


@contextmanager
def open_recording(path: Path) -> Iterator[Recording]:
    """Open a recording for reading.

    A program that writes it at the same time is not disturbed. A HardwareError is raised for a file that is missing,
    not a recording, of another schema, or damaged. The structure of the file is checked at once, and its contents on
    reading.
    """
    with closing(connect_to_read(path)) as connection:
        check_pages(connection, path)
        yield Recording(path, connection)


def iso_time(seconds: float) -> str:
    """Return a time as ISO 8601, to a second.

    `seconds` is in s since the epoch.
    """
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="seconds")


def _identity(values: Mapping[str, Any]) -> Identity:
    """Build the identity of a board and check its values."""
    identity = Identity(**values)
    words = (identity.manufacturer, identity.device, identity.boot)
    if not (isinstance(identity.kind, str) and isinstance(identity.emulated, bool)):
        raise TypeError("the identity of the board has values of another type")
    if not all(isinstance(word, int) and 0 <= word < 1 << 32 for word in words):
        raise ValueError(f"numbers of the board must have at most 32 bits; got {words}")
    return identity


def _word(value: Any) -> int:
    if not (isinstance(value, int) and 0 <= value <= 0xFFFF):
        raise ValueError(f"a register must hold 16 bits; got {value!r}")
    return value


def _texts(text: Any) -> tuple[str, ...]:
    """Read a list of texts in JSON."""
    texts = json.loads(text)
    if not (isinstance(texts, list) and all(isinstance(one, str) for one in texts)):
        raise TypeError("a list of texts has values of another type")
    return tuple(texts)


def _date(value: Any) -> float:
    """Return a time in s since the epoch.

    The calendar must have it.
    """
    try:
        datetime.fromtimestamp(_finite(value), UTC)
    except (OverflowError, OSError, ValueError):
        raise ValueError(f"a time must be on a day of the calendar; got {value!r} s") from None
    return float(value)


def _finite(value: Any) -> float:
    if not math.isfinite(value):
        raise ValueError(f"a number must be finite; got {value!r}")
    return float(value)
