"""Damage of a recording, and a new recording of its intact scans."""

from __future__ import annotations

import sqlite3
import statistics
from collections import Counter
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from coilarray.compute.files import write_atomically, writing
from coilarray.errors import HardwareError
from coilarray.hardware.record.campaign import Campaign
from coilarray.hardware.record.recording import RecordedScan, Recording, open_recording
from coilarray.hardware.record.recording_file import (
    add_temperatures,
    connect_to_read,
    create_tables,
    insert_row,
    insert_scan,
)
from coilarray.hardware.record.write_ahead_log import log_damage

_LEAST_BYTES = 20  # that a row takes in a file
_TABLES = ("session", "campaign", "position", "self_test")


@dataclass(frozen=True)
class Damage:
    """Damaged parts of a recording."""

    scans: int  # of the recording, damaged ones included
    damaged: tuple[int, ...]  # numbers of the scans that are not whole
    others: tuple[str, ...]  # what else is not, such as "session 2"
    checksums: bool  # whether the file has checksums; without them only what cannot be read counts as damaged
    unfinished: int = 0  # positions of a campaign that were finished and lack a scan now


def find_damage(path: Path) -> Damage:
    """Read a recording as a whole and find what is damaged; HardwareError for a file that is not a recording at all."""
    try:
        with open_recording(path) as recording:
            recording.check()
            return Damage(recording.count(), (), (), recording.has_checksums)
    except HardwareError as error:
        with closing(connect_to_read(path)) as connection:
            found = _Remains(path, connection).damage()
        if found.damaged or found.others:
            return found
        return replace(found, others=(str(error).partition(" is damaged: ")[2].rstrip(".") or "its structure",))


def recover_recording(path: Path, target: Path) -> Damage:
    """Write a new recording of the intact scans of another one, and return what was lost.

    Scans are renumbered. A position of a campaign of which a scan is lost counts as not measured, so that
    ``coilarray campaign --resume`` measures it again. HardwareError if no scan is whole, OutputError if the new
    file cannot be written; the other one is only read.
    """
    with closing(connect_to_read(path)) as connection:
        remains = _Remains(path, connection)
        damage = remains.damage()
        whole = [number for number in range(1, damage.scans + 1) if number not in set(damage.damaged)]
        if not whole:
            raise HardwareError(f"{path} has no intact scan.")
        lost = remains.incomplete(whole)

        def write(temporary: Path) -> None:
            with writing(target, sqlite3.Error), closing(sqlite3.connect(temporary, isolation_level=None)) as new:
                new.execute("BEGIN")
                create_tables(new)
                if remains.has_temperatures:
                    add_temperatures(new)
                for table in _TABLES:
                    for row in remains.rows(table):
                        values = {name: value for name, value in row.items() if name != "checksum"}
                        if table == "position" and row["id"] in lost:
                            values["finished"] = None
                        insert_row(new, table, values)
                for one in map(remains.scan, whole):
                    session = remains.session_number(one.session)
                    insert_scan(new, session, one.position, one.stage, one.depth, one.temperature, one.scan)
                new.execute("COMMIT")

        write_atomically(target, write)
    return replace(damage, unfinished=len(lost))


class _Remains(Recording):
    """A recording that may be damaged: rows that are not whole are left out, and named in `broken`."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self._whole: dict[str, list[dict[str, Any]]] = {}
        self._broken: list[str] = []
        self._most = path.stat().st_size // _LEAST_BYTES
        self._connected = connection
        super().__init__(path, connection)
        log = log_damage(path)
        if log:
            self._broken.append(f"{log}, and what is behind it is lost")

    def rows(self, table: str, which: str = "", *values: Any) -> list[dict[str, Any]]:
        """Read rows of a table, those of a whole table one by one."""
        if which:
            return super().rows(table, which, *values)
        if table not in self._whole:
            self._whole[table] = []
            last = self._number(f"SELECT coalesce(max(id), 0) FROM {table}")
            if last is None:
                self._broken.append(f"the table {table}")
            for number in range(1, (last or 0) + 1):
                try:
                    (row,) = super().rows(table, "WHERE id = ?", number)
                    self._whole[table].append(row)
                except (HardwareError, ValueError):  # ValueError: there is none
                    self._broken.append(f"{table.replace('_', '-')} {number}")
        return self._whole[table]

    def damage(self) -> Damage:
        """Read every scan by itself."""
        for table in _TABLES:
            self.rows(table)
        # a number that is damaged stands in one of the three only
        queries = ("max(id) FROM scan", "max(scan) FROM sample", "count(*) FROM scan INDEXED BY scans_of_positions")
        numbers = [number for query in queries if (number := self._number(f"SELECT {query}")) is not None]
        last = int(statistics.median_low(numbers)) if numbers else 0
        damaged = tuple(number for number in range(1, last + 1) if self._read(number) is None)
        return Damage(last, damaged, tuple(self._broken), self.has_checksums)

    def incomplete(self, whole: list[int]) -> set[int]:
        """Return the numbers of the finished positions that lack one of their scans; `whole` are those there are."""
        rows = [row for row in self.rows("position") if row["finished"] is not None]
        if self.campaign is None:
            return {row["id"] for row in rows}
        scans = Counter((scan.position, scan.stage) for scan in map(self.scan, whole))
        each = Campaign.from_json(self.campaign).scans
        return {row["id"] for row in rows if any(scans[row["id"], stage] != each for stage in ("baseline", "peak"))}

    def _read(self, number: int) -> RecordedScan | None:
        try:
            return self.scan(number)
        except HardwareError:
            return None

    def _number(self, query: str) -> int | None:
        """Return a number of rows, None if it cannot be read or the file is too short for so many."""
        try:
            (found,) = self._connected.execute(query).fetchone()
        except sqlite3.Error:
            return None
        return found if isinstance(found, int) and 0 <= found <= self._most else None
