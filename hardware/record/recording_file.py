"""SQLite file of a recording, with its tables and checksums.

Every row has a checksum of its values and its number. The checksum of a scan includes its samples
and its temperature. Scans are numbered from 1 without a gap, and SQLite's own check notices lost
pages and lost entries of a page. Therefore every single flipped bit that removes or changes data of
a result is noticed.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from coilarray.compute.checksum import checksum
from coilarray.errors import HardwareError
from coilarray.hardware.scan.readings import RawScan

APPLICATION = 0x636F696C
"""SQLite's application_id of a database of this program: "coil"."""
SCHEMA = 3
"""Version of the tables: SQLite's user_version."""

_LONGEST_TEXT = 160  # characters of SQLite's message to show
_TABLES = """
CREATE TABLE session (              -- from opening a board to letting go of it
    id INTEGER PRIMARY KEY,
    checksum TEXT NOT NULL,         -- of this row, as of the others below
    started REAL NOT NULL,          -- s since the epoch
    identity TEXT NOT NULL,         -- JSON: what answered
    boot INTEGER NOT NULL,
    emulated INTEGER NOT NULL,
    port TEXT NOT NULL,
    settings TEXT NOT NULL,         -- JSON: sent to the board
    settings_hash INTEGER NOT NULL, -- of every scan of this session
    wiring TEXT NOT NULL,
    capacitances TEXT NOT NULL,     -- JSON: F by state, as L was computed with while measuring
    design TEXT NOT NULL,           -- its name
    design_hash TEXT NOT NULL,
    design_document TEXT NOT NULL,  -- JSON: the design file
    version TEXT NOT NULL           -- of this program
);
CREATE TABLE self_test (            -- of the switches and coils, before and after a campaign
    id INTEGER PRIMARY KEY,
    checksum TEXT NOT NULL,
    session INTEGER NOT NULL REFERENCES session (id),
    time REAL NOT NULL,             -- s since the epoch
    symptoms TEXT NOT NULL,         -- JSON: what a good board does not show; none if it has passed
    findings TEXT NOT NULL          -- JSON: faults that each alone explain it
);
CREATE TABLE campaign (             -- none or one row
    id INTEGER PRIMARY KEY CHECK (id = 1),
    checksum TEXT NOT NULL,
    plan TEXT NOT NULL              -- JSON: grid and sequence
);
CREATE TABLE position (             -- of the indenter, one row for every time it was begun
    id INTEGER PRIMARY KEY,
    checksum TEXT NOT NULL,
    session INTEGER NOT NULL REFERENCES session (id),
    place INTEGER NOT NULL,         -- in the order of the campaign, from 0
    repeat INTEGER NOT NULL,        -- of the whole grid, from 0
    depth REAL NOT NULL,            -- to which is pressed, in m
    y REAL NOT NULL,                -- in m from the map's origin
    x REAL NOT NULL,
    finished REAL                   -- s since the epoch; null while it is measured, or where it was broken off
);
CREATE UNIQUE INDEX finished_places ON position (place) WHERE finished IS NOT NULL;
CREATE TABLE scan (
    id INTEGER PRIMARY KEY,
    checksum TEXT NOT NULL,         -- with that of its samples
    session INTEGER NOT NULL REFERENCES session (id),
    position INTEGER REFERENCES position (id),
    stage TEXT NOT NULL,            -- what was going on: stream, single, baseline, peak
    depth REAL,                     -- of the indenter in m where it is known, 0 where it does not touch
    temperature REAL,               -- of the board or beside it in °C, where a thermometer was given
    sequence INTEGER NOT NULL,      -- as the board counts
    time REAL NOT NULL,             -- s by the board's clock
    received REAL NOT NULL          -- s since the epoch by the computer's clock
);
CREATE INDEX scans_of_positions ON scan (position);
CREATE TABLE sample (
    scan INTEGER NOT NULL REFERENCES scan (id),
    state INTEGER NOT NULL,         -- in the order of the settings, from 0
    msb INTEGER NOT NULL,           -- register DATA0_MSB with its error flags
    lsb INTEGER NOT NULL,           -- register DATA0_LSB
    status INTEGER NOT NULL,        -- register STATUS
    fault INTEGER NOT NULL,         -- 0, or why there are no words
    PRIMARY KEY (scan, state)
) WITHOUT ROWID;
"""
_NAMES = {"session", "self_test", "campaign", "position", "scan", "sample"}


def create_tables(connection: sqlite3.Connection) -> None:
    """Make an empty database a recording."""
    connection.execute(f"PRAGMA application_id = {APPLICATION}")
    connection.execute(f"PRAGMA user_version = {SCHEMA}")
    for statement in _TABLES.split(";\n"):
        if statement.strip():
            connection.execute(statement)


def insert_row(connection: sqlite3.Connection, table: str, values: dict[str, Any]) -> int:
    """Add a row with its checksum to a table."""
    names, marks = ", ".join([*values, "checksum"]), "?, " * len(values)
    row = connection.execute(f"INSERT INTO {table} ({names}) VALUES ({marks}'')", list(values.values()))
    sign_row(connection, table, int(row.lastrowid or 0))
    return int(row.lastrowid or 0)


def insert_scan(
    connection: sqlite3.Connection,
    session: int,
    position: int | None,
    stage: str,
    depth: float | None,
    temperature: float | None,
    scan: RawScan,
) -> None:
    """Add a scan with samples, temperature and checksum."""
    (number,) = connection.execute("SELECT coalesce(max(id), 0) + 1 FROM scan").fetchone()
    when = (scan.sequence, scan.time, scan.received)
    known = scan_checksum(number, session, position, stage, depth, temperature, scan)
    connection.execute(
        "INSERT INTO scan (id, session, position, stage, depth, temperature, sequence, time, received, checksum) "
        "VALUES (?,?,?,?,?,?,?,?,?,?)",
        (number, session, position, stage, depth, temperature, *when, known),
    )
    connection.executemany(
        "INSERT INTO sample (scan, state, msb, lsb, status, fault) VALUES (?,?,?,?,?,?)",
        [
            (number, k, sample.msb, sample.lsb, sample.status, int(sample.fault))
            for k, sample in enumerate(scan.samples)
        ],
    )


def sign_row(connection: sqlite3.Connection, table: str, number: int) -> None:
    """Store the checksum of a row's values in the file."""
    found = connection.execute(f"SELECT * FROM {table} WHERE id = ?", (number,))
    row = dict(zip([column[0] for column in found.description], found.fetchone(), strict=True))
    connection.execute(f"UPDATE {table} SET checksum = ? WHERE id = ?", (_row_checksum(table, row), number))


def table_rows(connection: sqlite3.Connection, path: Path, table: str) -> list[dict[str, Any]]:
    """Return the rows of a table, checked by their checksums."""
    found = connection.execute(f"SELECT * FROM {table} NOT INDEXED ORDER BY id")
    names = [column[0] for column in found.description]
    rows = [dict(zip(names, row, strict=True)) for row in found]
    for row in rows:
        if row["checksum"] != _row_checksum(table, row):
            raise HardwareError(f"{path} is damaged: {table.replace('_', '-')} {row['id']}: its checksum is wrong.")
    return rows


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
    """Open a file read-only.

    This works while a recorder writes the file, and in a folder that is not writable.
    """
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
    """Shorten a text of SQLite to one line."""
    line = "".join(character if character.isprintable() else " " for character in " ".join(text.split()))
    return line if len(line) <= _LONGEST_TEXT else f"{line[:_LONGEST_TEXT]}…"


def _pragma(connection: sqlite3.Connection, name: str) -> int:
    return int(connection.execute(f"PRAGMA {name}").fetchone()[0])
