"""The SQLite file of a recording: its tables, what tells it from other files, and its errors in one line."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

from coilarray.errors import HardwareError

APPLICATION = 0x636F696C
""""coil", by which a database of this program is known: SQLite's application_id."""
SCHEMA = 1
"""Of the tables: SQLite's user_version."""

_TABLES = """
CREATE TABLE session (              -- from opening a board to letting go of it
    id INTEGER PRIMARY KEY,
    started REAL NOT NULL,          -- s since the epoch
    identity TEXT NOT NULL,         -- JSON: what answered
    boot INTEGER NOT NULL,
    emulated INTEGER NOT NULL,
    port TEXT NOT NULL,
    settings TEXT NOT NULL,         -- JSON: what the board was told
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
    session INTEGER NOT NULL REFERENCES session (id),
    time REAL NOT NULL,             -- s since the epoch
    symptoms TEXT NOT NULL,         -- JSON: what a good board does not show; none where it has passed
    findings TEXT NOT NULL          -- JSON: faults that each alone explain it
);
CREATE TABLE campaign (             -- none or one row
    id INTEGER PRIMARY KEY CHECK (id = 1),
    plan TEXT NOT NULL              -- JSON: grid and sequence
);
CREATE TABLE position (             -- of the indenter, one row for every time it was begun
    id INTEGER PRIMARY KEY,
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
    session INTEGER NOT NULL REFERENCES session (id),
    position INTEGER REFERENCES position (id),
    stage TEXT NOT NULL,            -- what was going on: stream, single, baseline, peak
    depth REAL,                     -- of the indenter in m where it is known, 0 where it does not touch
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
# earlier versions neither make nor miss this table, and so it is no reason for another schema
_TEMPERATURES = """
CREATE TABLE IF NOT EXISTS temperature (
    scan INTEGER PRIMARY KEY REFERENCES scan (id),
    celsius REAL NOT NULL           -- of the board or beside it, where a thermometer was given
)
"""
_NAMES = {"session", "self_test", "campaign", "position", "scan", "sample"}


def create_tables(connection: sqlite3.Connection) -> None:
    """Make an empty database a recording, within the transaction that is open."""
    connection.execute(f"PRAGMA application_id = {APPLICATION}")
    connection.execute(f"PRAGMA user_version = {SCHEMA}")
    for statement in _TABLES.split(";\n"):
        if statement.strip():
            connection.execute(statement)


def add_temperatures(connection: sqlite3.Connection) -> None:
    """Give a recording its table of temperatures where it has none, within the transaction that is open."""
    connection.execute(_TEMPERATURES)


def has_temperatures(connection: sqlite3.Connection) -> bool:
    """Whether a recording has a table of temperatures."""
    query = "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name = 'temperature'"
    return bool(connection.execute(query).fetchone()[0])


def is_blank(connection: sqlite3.Connection) -> bool:
    """Whether a database holds nothing at all, as after a kill before its first transaction."""
    tables = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    return not tables and not _pragma(connection, "application_id") and not _pragma(connection, "user_version")


def require_recording(connection: sqlite3.Connection, path: Path) -> None:
    """Refuse another program's database, and a recording of a newer version, with a HardwareError."""
    if is_blank(connection):
        raise HardwareError(f"{path} is no recording: it is empty.")
    if _pragma(connection, "application_id") != APPLICATION:
        raise HardwareError(f"{path} is no recording: it is a database of another program.")
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
    """Open a file read-only, also while a recorder writes it, and also where nothing may be written beside it.

    HardwareError for a file that is not there, cannot be read or is no database.
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
            return _connected(path, "mode=ro&immutable=1")  # SQLite else wants to make a file beside it


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn what SQLite says of a file into one line."""
    try:
        yield
    except sqlite3.OperationalError as error:
        raise HardwareError(f"cannot read {path}: {_one_line(str(error))}.") from None
    except UnicodeDecodeError:  # SQLite quotes a damaged file in its error
        raise HardwareError(f"{path} is damaged: it has texts that are not UTF-8.") from None
    except sqlite3.DatabaseError as error:
        what = "no recording" if "not a database" in str(error) else "damaged"
        raise HardwareError(f"{path} is {what}: {_one_line(str(error))}.") from None


def check_pages(connection: sqlite3.Connection, path: Path) -> None:
    """Look through the whole file for damage; HardwareError names the first that is found."""
    with reading(path):
        for pragma in ("integrity_check(1)", "foreign_key_check"):
            first = connection.execute(f"PRAGMA {pragma}").fetchone()
            if first is not None and first != ("ok",):
                raise HardwareError(f"{path} is damaged: {_one_line(' '.join(map(str, first)))}.")


def _connected(path: Path, how: str) -> sqlite3.Connection:
    connection = sqlite3.connect(
        f"file:{quote(str(path.absolute()))}?{how}", uri=True, isolation_level=None, timeout=5.0
    )
    try:
        connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except (sqlite3.Error, UnicodeDecodeError):
        connection.close()
        raise
    return connection


def _one_line(text: str) -> str:
    """Return a text of SQLite, which may have several lines and names out of a damaged file, in one."""
    return "".join(character if character.isprintable() else " " for character in " ".join(text.split()))


def _pragma(connection: sqlite3.Connection, name: str) -> int:
    return int(connection.execute(f"PRAGMA {name}").fetchone()[0])
