"""SQLite file of a recording, its reading, and its summary.

Every scan has its raw words, the place of the indenter, and the settings of the board. Every row
has a checksum of its values and its number. The checksum of a scan includes its samples and its
temperature. Scans are numbered from 1 without a gap, and SQLite's own check notices lost pages and
lost entries of a page. Therefore every single flipped bit that removes or changes data of a result
is noticed.
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
from importlib import resources
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from coilarray.compute.arrays import BoolArray, FloatArray
from coilarray.compute.files import checksum
from coilarray.design.model import Design, build_design
from coilarray.errors import HardwareError
from coilarray.hardware.scan.readings import Identity, RawSample, RawScan, SampleFault, read_scan
from coilarray.hardware.scan.settings import ScanSettings

APPLICATION = 0x636F696C  # SQLite's application_id of a database of this program: "coil"
SCHEMA = 3  # version of the tables: SQLite's user_version
_LONGEST_TEXT = 160  # characters of SQLite's message to show
_NAMES = {"session", "self_test", "campaign", "position", "scan", "sample"}


def create_tables(connection: sqlite3.Connection) -> None:
    """Make an empty database a recording."""
    connection.execute(f"PRAGMA application_id = {APPLICATION}")
    connection.execute(f"PRAGMA user_version = {SCHEMA}")
    tables = resources.files("coilarray.hardware.record").joinpath("recording.sql").read_text(encoding="utf-8")
    for statement in filter(str.strip, tables.split(";\n")):
        connection.execute(statement)


def insert_row(connection: sqlite3.Connection, table: str, values: dict[str, Any]) -> int:
    """Add a row with its checksum to a table."""
    names, marks = ", ".join([*values, "checksum"]), "?, " * len(values)
    row = connection.execute(f"INSERT INTO {table} ({names}) VALUES ({marks}'')", list(values.values()))
    sign_row(connection, table, int(row.lastrowid or 0))
    return int(row.lastrowid or 0)


def sign_row(connection: sqlite3.Connection, table: str, number: int) -> None:
    """Store the checksum of a row's values in the file."""
    found = connection.execute(f"SELECT * FROM {table} WHERE id = ?", (number,))
    row = dict(zip([column[0] for column in found.description], found.fetchone(), strict=True))
    connection.execute(f"UPDATE {table} SET checksum = ? WHERE id = ?", (_row_checksum(table, row), number))


def scan_checksum(
    number: int,
    session: int,
    position: int | None,
    stage: str,
    depth: float | None,
    temperature: float | None,
    scan: RawScan,
) -> str:
    """Return the checksum of a scan."""
    known = [None if value is None else float(value) for value in (depth, temperature, scan.time, scan.received)]
    words = [(sample.msb, sample.lsb, sample.status, int(sample.fault)) for sample in scan.samples]
    return checksum("scan", number, session, position, stage, known, scan.sequence, words)


def is_blank(connection: sqlite3.Connection) -> bool:
    """Check whether a database is empty."""
    tables = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    return not tables and not _pragma(connection, "application_id") and not _pragma(connection, "user_version")


def require_recording(connection: sqlite3.Connection, path: Path) -> None:
    """Refuse a file that is not a recording."""
    if is_blank(connection):
        raise HardwareError(f"{path} is not a recording: it is empty.")
    if _pragma(connection, "application_id") != APPLICATION:
        raise HardwareError(f"{path} is not a recording: it is a database of another program.")
    schema = _pragma(connection, "user_version")
    if schema != SCHEMA:
        raise HardwareError(
            f"{path} is a recording of schema {schema}, which another version of coilarray wrote; "
            f"this one reads schema {SCHEMA}."
        )
    names = {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    if not names >= _NAMES:
        raise HardwareError(f"{path} is damaged: the table {min(_NAMES - names)} is missing.")


def connect_to_read(path: Path) -> sqlite3.Connection:
    """Open a file read-only, also in a folder that is not writable."""
    try:
        if path.is_dir():
            raise HardwareError(f"cannot read {path}: it is a folder.")
        if not path.is_file():
            raise HardwareError(f"there is no file {path}.")
        with path.open("rb"):
            pass
        waiting = Path(f"{path}-wal").exists()
    except OSError as error:
        raise HardwareError(f"cannot read {path}: {error.strerror}.") from None
    except ValueError as error:  # a name with a zero byte
        raise HardwareError(f"cannot read {str(path)!r}: {error}.") from None
    with reading(path):
        try:
            return _connected(path, "mode=ro")
        except sqlite3.OperationalError:
            if waiting:
                raise
            return _connected(path, "mode=ro&immutable=1")  # or SQLite makes another file


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Convert errors of SQLite to one line."""
    try:
        yield
    except sqlite3.OperationalError as error:
        raise HardwareError(f"cannot read {path}: {_one_line(str(error))}.") from None
    except UnicodeDecodeError:  # SQLite quotes a damaged file in its error
        raise HardwareError(f"{path} is damaged: it has texts that are not UTF-8.") from None
    except sqlite3.DatabaseError as error:
        what = "not a recording" if "not a database" in str(error) else "damaged"
        raise HardwareError(f"{path} is {what}: {_one_line(str(error))}.") from None


def check_database(connection: sqlite3.Connection, path: Path, pragma: str) -> None:
    """Run one of SQLite's own checks on the whole file."""
    with reading(path):
        first = connection.execute(f"PRAGMA {pragma}").fetchone()
    if first is not None and first != ("ok",):
        raise HardwareError(f"{path} is damaged: {_one_line(' '.join(map(str, first)))}.")


def _connected(path: Path, how: str) -> sqlite3.Connection:
    """Open a database file and check that it is readable."""
    connection = sqlite3.connect(f"{path.absolute().as_uri()}?{how}", uri=True, isolation_level=None, timeout=5.0)
    try:
        connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except (sqlite3.Error, UnicodeDecodeError):
        connection.close()
        raise
    return connection


def _row_checksum(table: str, row: dict[str, Any]) -> str:
    return checksum(table, {name: value for name, value in row.items() if name != "checksum"})


def _one_line(text: str) -> str:
    line = "".join(character if character.isprintable() else " " for character in " ".join(text.split()))
    return line if len(line) <= _LONGEST_TEXT else f"{line[:_LONGEST_TEXT]}…"


def _pragma(connection: sqlite3.Connection, name: str) -> int:
    return int(connection.execute(f"PRAGMA {name}").fetchone()[0])


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


PLAIN = ("started", "port", "wiring", "design", "design_hash", "version")
"""Fields of a session that its row has as they are."""


@dataclass(frozen=True)
class RecordedScan:
    """A scan and the circumstances of its measurement."""

    number: int  # in the recording, rising
    scan: RawScan
    session: int  # index in `Recording.sessions`
    stage: str  # part of the measurement: "stream", "single", "baseline" or "peak"
    position: int | None  # number of the attempt at a place, see `Recording.positions`
    place: GridPlace | None
    depth: float | None  # of the indenter in m if known, 0 without contact
    temperature: float | None  # in °C, if a thermometer was given and its reading known


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

    def self_tests(self) -> list[dict[str, Any]]:
        """Return the self-tests in time order, as JSON has them."""
        found = []
        for row in self.rows("self_test"):
            try:
                symptoms, findings = (list(json.loads(row[name])) for name in ("symptoms", "findings"))
                session, time = self._sessions[row["session"]], iso_time(row["time"])
            except _UNREADABLE as error:
                raise HardwareError(f"{self.path} is damaged: self-test {row['id']}: {error}.") from None
            found.append(
                {"session": session, "time": time, "passed": not symptoms, "symptoms": symptoms, "findings": findings}
            )
        return found

    def count(self) -> int:
        """Return the number of scans."""
        with reading(self.path):
            return int(self._connection.execute("SELECT count(*) FROM scan").fetchone()[0])

    def positions(self) -> dict[int, GridPlace]:
        """Return the finished places by position number."""
        rows = [row for row in self.rows("position") if row["finished"] is not None]
        return {row["id"]: _place(row) for row in sorted(rows, key=lambda row: row["place"])}

    def scans(self) -> Generator[RecordedScan]:
        """Read the scans in the order of measurement."""
        query = """
            SELECT scan.id, scan.session, scan.position, scan.stage, scan.depth, scan.sequence, scan.time,
                   scan.received, scan.temperature, scan.checksum,
                   sample.state, sample.msb, sample.lsb, sample.status, sample.fault
            FROM scan JOIN sample ON sample.scan = scan.id ORDER BY scan.id, sample.state
        """
        before, places = 0, {row["id"]: _place(row) for row in self.rows("position")}
        with reading(self.path), closing(self._connection.execute(query)) as rows:
            for number, group in groupby(rows, key=lambda row: row[0]):
                if number != before + 1:
                    raise HardwareError(f"{self.path} is damaged: scan {before + 1} is missing.")
                before = number
                yield self._scan(list(group), places)

    def check(self) -> None:
        """Read the whole file to check it for damage."""
        check_database(self._connection, self.path, "foreign_key_check")
        self.self_tests()
        self.positions()
        for _ in self.scans():
            pass

    def rows(self, table: str) -> list[dict[str, Any]]:
        """Read the rows of a table other than the scans, checked by their checksums."""
        with reading(self.path):
            found = self._connection.execute(f"SELECT * FROM {table} NOT INDEXED ORDER BY id")
            names = [column[0] for column in found.description]
            rows = [dict(zip(names, row, strict=True)) for row in found]
        for row in rows:
            if row["checksum"] != _row_checksum(table, row):
                name = f"{table.replace('_', '-')} {row['id']}"
                raise HardwareError(f"{self.path} is damaged: {name}: its checksum is wrong.")
        return rows

    def _scan(self, rows: list[tuple[Any, ...]], places: dict[int, GridPlace]) -> RecordedScan:
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
            if position is not None and position not in places:  # begun after the others were read
                places |= {row["id"]: _place(row) for row in self.rows("position")}
            place = None if position is None else places[position]
            return RecordedScan(number, scan, index, stage, position, place, depth, celsius)
        except _UNREADABLE as error:
            raise HardwareError(f"{self.path} is damaged: scan {number}: {error}.") from None

    def _session(self, row: Mapping[str, Any]) -> RecordedSession:
        try:
            settings = ScanSettings.from_json(row["settings"])
            if settings.hash != row["settings_hash"]:
                raise ValueError("the settings are not those of their hash")
            return RecordedSession(
                identity=Identity(**json.loads(row["identity"])),
                settings=settings,
                capacitances=json.loads(row["capacitances"]),
                design_document=json.loads(row["design_document"]),
                **{name: row[name] for name in PLAIN},
            )
        except (*_UNREADABLE, HardwareError) as error:
            raise HardwareError(f"{self.path} is damaged: session {row['id']}: {error}.") from None


_UNREADABLE = (KeyError, TypeError, ValueError, OverflowError, AttributeError, RecursionError)
"""Errors of values in a row that no recorder wrote."""


def _place(row: Mapping[str, Any]) -> GridPlace:
    return GridPlace(row["place"], row["repeat"], row["depth"], row["y"], row["x"])


@contextmanager
def open_recording(path: Path) -> Iterator[Recording]:
    """Open a recording for reading, without disturbing its writer."""
    # The structure of the file is checked at once, its contents on reading.
    with closing(connect_to_read(path)) as connection:
        check_database(connection, path, "integrity_check(1)")
        yield Recording(path, connection)


def iso_time(seconds: float) -> str:
    """Return a time as ISO 8601, to a second."""
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="seconds")


def summarize_recording(recording: Recording) -> dict[str, Any]:
    """Summarize a whole recording in plain SI values for JSON.

    ``lost_scans`` are numbered by the board but never arrived. ``seconds`` and ``rate_per_s`` leave
    out the pauses between sessions. ``relative_noise`` is the relative standard deviation of L at
    rest, from differences of successive scans, in which a drift cancels and which have twice the
    variance of a reading.
    """
    from coilarray.hardware.record.campaign import Campaign

    names, first = recording.states, recording.sessions[0]
    verdicts: list[Counter[str]] = [Counter() for _ in names]
    reasons: list[Counter[str]] = [Counter() for _ in names]
    values: list[FloatArray] = []  # frequency and inductance by state, of every scan
    at_rest: list[bool] = []
    spans: list[list[float]] = [[] for _ in recording.sessions]  # first and last time
    counts, lost = [0] * len(spans), 0
    before = (-1, 0)  # session and number of the last scan of a stream
    for one in recording.scans():
        session, scan = recording.sessions[one.session], one.scan
        if one.stage == "stream":
            if before[0] == one.session:
                lost += max(scan.sequence - before[1] - 1, 0)
            before = (one.session, scan.sequence)
        states = read_scan(scan, session.settings, session.capacitances).states
        for k, state in enumerate(states):
            verdicts[k][state.verdict] += 1
            reasons[k].update(map(str, state.reasons))
        values.append(np.array([(state.frequency, state.inductance) for state in states], dtype=np.float64))
        at_rest.append(not (one.depth or 0.0) > 0)
        spans[one.session] = [*spans[one.session][:1], scan.time]
        counts[one.session] += 1
    seconds = sum(span[-1] - span[0] for span in spans if span)
    steps = sum(max(count - 1, 0) for count in counts)
    plan = None if recording.campaign is None else Campaign.from_json(recording.campaign)
    columns = np.array(values).reshape(-1, len(names), 2).transpose(1, 2, 0)
    rest = np.array(at_rest, dtype=bool)
    return {
        "file": str(recording.path),
        "emulated": recording.emulated,
        "design": first.design,
        "design_hash": first.design_hash,
        "wiring": first.wiring,
        "coilarray_version": first.version,
        "sessions": [
            {
                "started": iso_time(session.started),
                "board": session.identity.kind,
                "port": session.port,
                "boot": f"{session.identity.boot:08X}",
                "settings_hash": f"{session.settings.hash:04X}",
                "scans": count,
            }
            for session, count in zip(recording.sessions, counts, strict=True)
        ],
        "scans": sum(counts),
        "lost_scans": lost,
        "seconds": seconds,
        "rate_per_s": steps / seconds if plan is None and seconds > 0 else None,
        "states": [
            {
                "state": name,
                **_statistics(columns[k, 0], columns[k, 1], rest),
                **{verdict: verdicts[k][verdict] for verdict in ("good", "doubtful", "bad")},
                "reasons": dict(reasons[k].most_common()),
            }
            for k, name in enumerate(names)
        ],
        "campaign": None if plan is None else {**plan.to_record(), "measured": len(recording.positions())},
        "self_tests": recording.self_tests(),
    }


def _statistics(frequency: FloatArray, inductance: FloatArray, rest: BoolArray) -> dict[str, float | None]:
    """Return the means of a state and the noise of its scans at `rest`."""
    known = np.isfinite(inductance)
    steps = np.diff(inductance[known & rest])
    mean = float(inductance[known].mean()) if known.any() else None
    return {
        "frequency_Hz": float(frequency[known].mean()) if known.any() else None,
        "inductance_H": mean,
        "relative_noise": math.sqrt((steps**2).mean() / 2) / mean if mean and len(steps) else None,
    }
