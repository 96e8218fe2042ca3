"""Writing of recordings, with the temperature beside the scans.

A scan is one transaction in SQLite's write-ahead log, so a kill loses only a scan that was not
added yet. Once a second, and at the end of every position, the log is also flushed to disk. A power
cut loses only the scans after the last flush.
"""

from __future__ import annotations

import json
import math
import re
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import asdict
from importlib import metadata
from pathlib import Path

from coilarray.compute.files import writing
from coilarray.compute.store import delete_database, locked_database
from coilarray.compute.threads import Progress
from coilarray.design.model import Design
from coilarray.design.write import design_document
from coilarray.errors import HardwareError, OutputError
from coilarray.hardware.board.connect import Board
from coilarray.hardware.record.recording import (
    PLAIN,
    GridPlace,
    RecordedSession,
    Recording,
    create_tables,
    insert_row,
    is_blank,
    reading,
    require_recording,
    scan_checksum,
    sign_row,
)
from coilarray.hardware.scan.readings import RawScan, Reader
from coilarray.hardware.scan.settings import ScanSettings
from coilarray.hardware.wire.buses import BoardRestarted, held_signals

PERIOD = 1.0  # time in s from reading to reading
COLDEST, WARMEST = -100.0, 300.0
"""Range of accepted temperatures in °C. A sensor of the 1-wire bus without power shows 85 °C."""

_OUTDATED = 5.0  # s after which the last reading is outdated
_SLAVE = re.compile(r"(?s).*crc=\w+ YES\s.*t=(-?\d+)\s*")
_LONGEST = 4096  # bytes


def file_temperature(path: Path) -> float:
    """Read a temperature in °C from a file."""
    try:
        with path.open("rb") as file:
            text = file.read(_LONGEST).decode("ascii", errors="replace").strip()
    except (OSError, ValueError) as error:
        raise HardwareError(f"cannot read the temperature {path}: {getattr(error, 'strerror', error)}.") from None
    slave = _SLAVE.fullmatch(text)
    try:
        value = int(slave[1]) / 1000 if slave else float(text) if "." in text else int(text) / 1000
    except ValueError:
        value = math.nan
    if not COLDEST <= value <= WARMEST:
        raise HardwareError(
            f"{path} must hold a temperature from {COLDEST:g} to {WARMEST:g} °C, as a whole number in 0.001 °C or "
            f"with a decimal point in °C; got {text[:40]!r}."
        )
    return value


@contextmanager
def thermometer(path: Path) -> Iterator[Callable[[], float | None]]:
    """Read a file once a second, and return its temperature in °C."""
    # None if it is outdated or can no longer be read
    latest = (file_temperature(path), time.monotonic())
    ended = threading.Event()

    def follow() -> None:
        nonlocal latest
        while not ended.wait(PERIOD):
            try:
                latest = file_temperature(path), time.monotonic()
            except HardwareError:
                continue

    def temperature() -> float | None:
        value, when = latest
        return value if time.monotonic() - when <= _OUTDATED else None

    threading.Thread(target=follow, daemon=True, name="thermometer").start()
    try:
        yield temperature
    finally:
        ended.set()  # a sensor of the 1-wire bus may take a second to answer, and it is not awaited


_DURABLE = 1.0  # s
_PATIENCE = 5.0  # s to wait for another program that writes
Thermometer = Callable[[], float | None]
"""Function that returns the temperature in °C, or None if it is not known at present."""


class Recorder:
    """A recording that is open for writing, after `start`."""

    # Every method writes completely or not at all.

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection
        self._session: RecordedSession | None = None
        self._number = 0
        self._durable = -math.inf
        self.thermometer: Thermometer | None = None

    @property
    def started(self) -> bool:
        """Whether a session has begun."""
        return self._session is not None

    @property
    def session(self) -> RecordedSession:
        """Session that was started last."""
        if self._session is None:
            raise ValueError("a recorder must be started first.")
        return self._session

    def start(
        self, session: RecordedSession, campaign: str | None = None, thermometer: Thermometer | None = None
    ) -> None:
        """Begin a session, the first of which creates the recording."""
        # `campaign` is its plan as JSON. `thermometer` returns the temperature in °C, if known.
        with reading(self.path):
            blank = is_blank(self._connection)
        if not blank:
            _require_same(Recording(self.path, self._connection), session, campaign)
        _log_ahead(self.path, self._connection)
        values = {
            **{name: getattr(session, name) for name in PLAIN},
            "identity": json.dumps(asdict(session.identity)),
            "boot": session.identity.boot,
            "emulated": session.identity.emulated,
            "settings": session.settings.to_json(),
            "settings_hash": session.settings.hash,
            "capacitances": json.dumps(dict(session.capacitances)),
            "design_document": json.dumps(dict(session.design_document)),
        }
        with self._transaction(durable=True) as connection:
            if is_blank(connection):
                create_tables(connection)
                if campaign is not None:
                    insert_row(connection, "campaign", {"plan": campaign})
            self._number = insert_row(connection, "session", values)
        self._session, self.thermometer = session, thermometer

    def add(self, scan: RawScan, stage: str, *, position: int | None = None, depth: float | None = None) -> None:
        """Write a scan, which must be of this session and its settings."""
        settings, boot = self.session.settings, self.session.identity.boot
        if scan.boot != boot:
            raise BoardRestarted(
                f"the board restarted: its session was {boot:08X}, that of scan {scan.sequence} is another."
            )
        if scan.configuration != settings.hash or len(scan.samples) != len(settings.states):
            raise HardwareError(
                f"scan {scan.sequence} has the settings {scan.configuration:04X} and {len(scan.samples)} states; "
                f"the board was set to {settings.hash:04X} and {len(settings.states)}."
            )
        if not (math.isfinite(scan.time) and math.isfinite(scan.received)):
            raise HardwareError(f"scan {scan.sequence} must have finite times; got {scan.time} and {scan.received} s.")
        temperature = None if self.thermometer is None else self.thermometer()
        with self._transaction(durable=time.monotonic() - self._durable > _DURABLE) as connection:
            (number,) = connection.execute("SELECT coalesce(max(id), 0) + 1 FROM scan").fetchone()
            where = (number, self._number, position, stage, depth, temperature)
            connection.execute(
                "INSERT INTO scan (id, session, position, stage, depth, temperature, sequence, time, received, "
                "checksum) VALUES (?,?,?,?,?,?,?,?,?,?)",
                (*where, scan.sequence, scan.time, scan.received, scan_checksum(*where, scan)),
            )
            words = [(one.msb, one.lsb, one.status, int(one.fault)) for one in scan.samples]
            connection.executemany(
                "INSERT INTO sample (scan, state, msb, lsb, status, fault) VALUES (?,?,?,?,?,?)",
                [(number, k, *word) for k, word in enumerate(words)],
            )

    def count(self) -> int:
        """Return the number of scans in the recording."""
        with reading(self.path):
            return int(self._connection.execute("SELECT count(*) FROM scan").fetchone()[0])

    def finished(self) -> frozenset[int]:
        """Return the numbers of the places measured to their end."""
        with reading(self.path):
            rows = self._connection.execute("SELECT place FROM position WHERE finished IS NOT NULL")
            return frozenset(place for (place,) in rows)

    def begin(self, place: GridPlace) -> int:
        """Begin a place of the campaign."""
        values = {"place": place.number, "repeat": place.repeat, "depth": place.depth, "y": place.y, "x": place.x}
        with self._transaction(durable=False) as connection:
            return insert_row(connection, "position", {"session": self._number, **values})

    def finish(self, position: int) -> None:
        """Mark a position as measured to its end."""
        with self._transaction(durable=True) as connection:
            connection.execute("UPDATE position SET finished = ? WHERE id = ?", (time.time(), position))
            sign_row(connection, "position", position)

    def add_self_test(self, symptoms: Sequence[str], findings: Sequence[str]) -> None:
        """Write the symptoms and findings of a self-test."""
        values: dict[str, object] = {"session": self._number, "time": time.time()}
        values |= {"symptoms": json.dumps(list(symptoms)), "findings": json.dumps(list(findings))}
        with self._transaction(durable=True) as connection:
            insert_row(connection, "self_test", values)

    @contextmanager
    def _transaction(self, *, durable: bool) -> Iterator[sqlite3.Connection]:
        """Make the writes of a block one transaction."""
        connection = self._connection
        with held_signals(), writing(self.path, sqlite3.Error):  # no Ctrl-C within a write
            connection.execute(f"PRAGMA synchronous = {'FULL' if durable else 'NORMAL'}")
            try:
                connection.execute("BEGIN IMMEDIATE")
                yield connection
                connection.execute("COMMIT")
            except BaseException:
                with suppress(sqlite3.Error):  # some failures have already ended it
                    connection.execute("ROLLBACK")
                raise
        if durable:
            self._durable = time.monotonic()


def begin_session(board: Board, settings: ScanSettings, design: Design) -> RecordedSession:
    """Return a session of a configured board that begins now."""
    capacitance = design.circuit.switches.tank_capacitance
    return RecordedSession(
        started=time.time(),
        identity=board.identity,
        port=board.port,
        settings=settings,
        wiring=board.wiring.name,
        capacitances={state.name: capacitance for state in settings.states},
        design=design.name,
        design_hash=design.digest,
        design_document=design_document(design),
        version=metadata.version("coilarray"),
    )


@contextmanager
def open_recorder(path: Path, *, resume: bool = False) -> Iterator[Recorder]:
    """Open a file for a new or resumed recording."""
    lock = Path(f"{path}.lock")
    with ExitStack() as opened:
        held = opened.enter_context(
            locked_database(lock, f"another program is recording into {path}; name another file.")
        )
        opened.callback(_delete_lock, held, lock)
        with writing(path, sqlite3.Error, ValueError):
            there = path.exists()
            taken = there and path.stat().st_size > 0
            connection = sqlite3.connect(path.absolute(), isolation_level=None, timeout=_PATIENCE)
        opened.enter_context(closing(connection))
        recorder = Recorder(path, connection)
        try:
            if taken:
                _require_resumable(path, connection, resume=resume)
            else:
                _log_ahead(path, connection)
            yield recorder
        finally:
            with suppress(sqlite3.Error):  # one file is left, unless it is read
                connection.execute("PRAGMA journal_mode = DELETE")
            connection.close()
            if not (there or recorder.started):
                delete_database(path)


def _delete_lock(held: sqlite3.Connection, lock: Path) -> None:
    held.close()
    with suppress(OSError):
        lock.unlink()


def record_stream(
    reader: Reader,
    recorder: Recorder,
    *,
    scans: int | None = None,
    seconds: float | None = None,
    interval: float = 0.0,
    progress: Progress | None = None,
) -> int:
    """Record a number of scans, or for a time (s)."""
    count, first = 0, None
    with closing(reader.scans(interval)) as stream:
        for scan in stream:
            first = scan.time if first is None else first
            passed = scan.time - first
            if seconds is not None and passed > seconds:
                break
            recorder.add(scan, "stream")
            count += 1
            if progress is not None and scans is not None:
                progress(count, scans)
            elif progress is not None and seconds is not None:
                progress(round(10 * passed), math.ceil(10 * seconds))
            if count == scans:
                break
    return count


def _log_ahead(path: Path, connection: sqlite3.Connection) -> None:
    """Let readers and a recorder not wait for each other."""
    # SQLite's write-ahead log, which makes a missing file
    with writing(path, sqlite3.Error):
        connection.execute("PRAGMA journal_mode = WAL")


def _require_resumable(path: Path, connection: sqlite3.Connection, *, resume: bool) -> None:
    with reading(path):
        if is_blank(connection):  # killed before the session began
            return
        require_recording(connection, path)
        if not resume:
            scans = connection.execute("SELECT count(*) FROM scan").fetchone()[0]
            raise OutputError(f"{path} already is a recording, of {scans} scans; resume it or name another file.")
        first = connection.execute("PRAGMA quick_check(1)").fetchone()[0]
    if first != "ok":
        raise HardwareError(f"{path} is damaged: {' '.join(str(first).split())}.")


def _require_same(recording: Recording, session: RecordedSession, campaign: str | None) -> None:
    before = recording.sessions[0]
    pairs = (
        (
            "board",
            *("emulated" if one.identity.emulated else "real" for one in (before, session)),
        ),  # first: another board has other settings too
        ("design", before.design_hash[:12], session.design_hash[:12]),
        ("wiring", before.wiring, session.wiring),
        ("hash of settings", f"{before.settings.hash:04X}", f"{session.settings.hash:04X}"),
        ("states", ",".join(recording.states), ",".join(state.name for state in session.settings.states)),
        ("clock", f"{before.settings.clock:.10g} Hz", f"{session.settings.clock:.10g} Hz"),
    )
    for what, then, now in pairs:
        if then != now:
            raise HardwareError(f"cannot continue {recording.path}: its {what} was {then}; now it is {now}.")
    if recording.campaign != campaign:
        what = "no campaign" if recording.campaign is None else "another campaign" if campaign else "a campaign"
        raise HardwareError(f"cannot continue {recording.path}: it is of {what}.")
