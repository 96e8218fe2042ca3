"""Arrays larger than memory in one netCDF file, filled block by block; an interrupted run can be continued.

The file is laid out before the first number is computed: its variables are contiguous, so that each block is written
straight to its place and the structure of the file never changes. Until all blocks are done the file lies in a folder
beside the target, together with a journal of the finished blocks. A run that is killed loses only the blocks that it
was computing. The journal has a checksum of what was written of every block: one that has changed since is computed
anew. The finished file ends in a checksum of all of it, see `coilarray.compute.checksum`.
"""

from __future__ import annotations

import hashlib
import io
import json
import logging
import math
import os
import shutil
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.compute.checksum import checksum, checksum_of_bytes, seal_file
from coilarray.compute.files import make_folder, write_atomically, writing
from coilarray.compute.store import locked_database
from coilarray.compute.threads import Progress
from coilarray.compute.workers import Pool
from coilarray.errors import GeometryError, OutputError

if TYPE_CHECKING:
    import xarray as xr

Item = TypeVar("Item")
Result = TypeVar("Result")

_LOG = logging.getLogger(__name__)
_DATA, _JOURNAL = "data.nc", "journal.db"
_ITEM = 8  # bytes
_FORMAT = "2"
_AT_ONCE = 1 << 20  # bytes
_PAGE = 4096  # bytes
_TABLES = {
    # of the file without values: the first byte of every variable, its length in bytes, the checksum of the rest of it
    "layout": "key TEXT, starts TEXT, size INTEGER, frame TEXT, checksum TEXT",
    # pieces of a block are [first byte, number of bytes, checksum]
    "block": "number INTEGER PRIMARY KEY, figure REAL, pieces TEXT, checksum TEXT",
}


@dataclass(frozen=True)
class Variable:
    """One float64 variable of the file: its name, dimensions, which are coordinates of the frame, and attributes."""

    name: str
    dims: tuple[str, ...]
    units: str
    long_name: str


class LargeFile:
    """A file that is being filled; `open_large` makes one."""

    def __init__(self, path: Path, starts: dict[str, int], connection: sqlite3.Connection, blocks: int) -> None:
        self._path, self._starts, self._connection, self._blocks = path, starts, connection, blocks
        self._stream = path.open("r+b")
        self._pieces: list[tuple[int, int, str]] = []  # of the block that is being written

    @property
    def finished(self) -> dict[int, float]:
        """Figure of every finished block by its number."""
        return dict(self._connection.execute("SELECT number, figure FROM block"))

    @property
    def missing(self) -> list[int]:
        """Numbers of the unfinished blocks."""
        done = self.finished
        return [number for number in range(self._blocks) if number not in done]

    def write(self, name: str, start: int, values: FloatArray) -> None:
        """Write consecutive values of a variable from the flat index `start` on; OutputError if that fails."""
        first, data = self._starts[name] + _ITEM * start, np.ascontiguousarray(values, dtype="<f8").tobytes()
        self._pieces.append((first, len(data), checksum_of_bytes(data)))
        with writing(self._path):
            self._stream.seek(first)
            self._stream.write(data)

    def finish(self, number: int, figure: float = 0.0) -> None:
        """Record a block as written, with a figure to keep of it; OutputError if that fails."""
        with writing(self._path, sqlite3.Error):
            self._stream.flush()
            os.fsync(self._stream.fileno())  # on the disk before the journal says so
            row = (number, float(figure), json.dumps(self._pieces))
            self._connection.execute("INSERT OR REPLACE INTO block VALUES (?, ?, ?, ?)", (*row, checksum(*row)))
            self._pieces.clear()

    def close(self) -> None:
        """Close the file, whatever is in it."""
        self._stream.close()


def parts_folder(path: Path) -> Path:
    """Return the folder of an unfinished file, beside its target."""
    return path.with_name(f"{path.name}.parts")


@contextmanager
def open_large(
    path: Path, frame: xr.Dataset, variables: Sequence[Variable], key: str, blocks: int
) -> Iterator[LargeFile]:
    """Open a file to be filled within a ``with`` block, which gets its final name once all blocks are done.

    `path` is the .nc file to make or replace, `frame` has its coordinates and attributes. An unfinished file of the
    same `key`, a hash of everything that decides the numbers, is continued. OutputError for too little space on the
    disk, an unfinished file of another key, a file that another run is filling, or one that cannot be written.
    """
    if os.path.isdir(path):  # refused before the work; false for names that are too long
        raise OutputError(f"cannot write {path}: it is a folder.")
    folder = parts_folder(path)
    make_folder(folder)
    empty = complete = named = False
    try:
        # no other process can open the journal meanwhile
        busy = f"another run is filling {folder}; wait for it or give another file."
        with writing(path), locked_database(folder / _JOURNAL, busy) as connection:
            try:
                for name, columns in _TABLES.items():
                    connection.execute(f"CREATE TABLE IF NOT EXISTS {name} ({columns})")
                starts = _lay_out(path, connection, frame, variables, f"{_FORMAT} {key} {blocks}")
                with closing(LargeFile(folder / _DATA, starts, connection, blocks)) as file:
                    yield file
                    complete = not file.missing
            finally:
                empty = _is_empty(connection)
        if complete:
            with writing(path):
                seal_file(folder / _DATA)
                (folder / _DATA).replace(path)
            named = True
    except sqlite3.Error as error:
        more = "" if empty else "; delete the folder to begin anew"
        raise OutputError(f"cannot use {folder / _JOURNAL}: {error}{more}.") from None
    finally:
        if named or empty:  # else finished blocks stay, and so does the file of another run
            _discard(folder)
        with suppress(OSError):  # where something is in it
            folder.rmdir()


def fill_large(
    path: Path,
    frame: xr.Dataset,
    variables: Sequence[Variable],
    key: str,
    blocks: int,
    task: Callable[[int], Item],
    compute: Callable[[Item], Result],
    write: Callable[[LargeFile, int, Result], float],
    pool: Pool,
    *,
    progress: Progress | None = None,
) -> dict[int, float]:
    """Compute the missing blocks of a file on a pool of workers, and write each as it comes; see `open_large`.

    `task` makes the input of the block of a number, `compute` its values from that, on a worker, and `write` writes
    them to the file and returns the figure to keep of them. `progress` is called with (done, total), blocks of an
    earlier run included. Returns the figure of every block by its number. GeometryError says why the first block was
    refused; ClusterError as `coilarray.compute.workers.Pool.run`.
    """
    with open_large(path, frame, variables, key, blocks) as file:
        missing = file.missing
        done = blocks - len(missing)
        if progress is not None and done:
            progress(done, blocks)
        for index, values in pool.run(compute, map(task, missing)):
            if isinstance(values, str):
                raise GeometryError(values)
            file.finish(missing[index], write(file, missing[index], values))
            done += 1
            if progress is not None:
                progress(done, blocks)
        return file.finished


def _is_empty(connection: sqlite3.Connection) -> bool:
    """Return whether a journal has no finished block; False if it cannot be read."""
    with suppress(sqlite3.Error):
        (tables,) = connection.execute("SELECT count(*) FROM sqlite_master WHERE name = 'block'").fetchone()
        return not tables or connection.execute("SELECT count(*) FROM block").fetchone() == (0,)
    return False


def _lay_out(
    path: Path, connection: sqlite3.Connection, frame: xr.Dataset, variables: Sequence[Variable], key: str
) -> dict[str, int]:
    """Make the file where there is none yet that is whole; return the first byte of every variable."""
    data = parts_folder(path) / _DATA
    laid_out = connection.execute("SELECT key FROM layout").fetchone()
    begun = data.exists() and connection.execute("SELECT count(*) FROM block").fetchone() != (0,)
    if begun and laid_out != (key,):
        raise OutputError(
            f"{data.parent} holds another unfinished file, for other inputs or from another version; delete it or "
            "name another file."
        )
    sizes = {variable.name: _ITEM * math.prod(frame.sizes[dim] for dim in variable.dims) for variable in variables}
    if begun:
        if (starts := _whole_layout(connection, data, sizes)) is not None:
            _discard_damaged(connection, data)
            return starts
        _LOG.warning("coilarray: %s is damaged; all of it is computed anew.", data)
    for table, columns in _TABLES.items():
        connection.execute(f"DROP TABLE {table}")
        connection.execute(f"CREATE TABLE {table} ({columns})")
    size, free = sum(sizes.values()), shutil.disk_usage(data.parent).free
    if size > free:
        raise OutputError(f"{path} needs {size / 1e9:.3g} GB on the disk; {free / 1e9:.3g} GB are free.")
    write_atomically(data, lambda temporary: _make(temporary, frame, variables))
    starts = _starts(data, variables)
    length = data.stat().st_size
    row = (key, json.dumps(starts), length, _frame_checksum(data, starts, sizes, length))
    connection.execute("INSERT INTO layout VALUES (?, ?, ?, ?, ?)", (*row, checksum(*row)))
    return starts


def _whole_layout(connection: sqlite3.Connection, data: Path, sizes: dict[str, int]) -> dict[str, int] | None:
    """Return the first byte of every variable of an unfinished file; None if its frame is not as it was written."""
    *row, expected = connection.execute("SELECT key, starts, size, frame, checksum FROM layout").fetchone()
    if checksum(*row) != expected or data.stat().st_size < row[2]:
        return None
    starts: dict[str, int] = json.loads(row[1])
    if _frame_checksum(data, starts, sizes, row[2]) != row[3]:
        return None
    os.truncate(data, row[2])  # a run that was killed while it gave the file its name has left a seal
    return starts


def _frame_checksum(data: Path, starts: dict[str, int], sizes: dict[str, int], size: int) -> str:
    """Return the checksum of all of a file but the values of its variables: of coordinates, attributes, structure."""
    digest, at = hashlib.blake2b(), 0
    with data.open("rb") as file:
        for start, end in [*sorted((start, start + sizes[name]) for name, start in starts.items()), (size, size)]:
            file.seek(at)
            while block := file.read(min(_AT_ONCE, start - at)):
                digest.update(block)
                at += len(block)
            at = end
    return digest.hexdigest()


def _discard_damaged(connection: sqlite3.Connection, data: Path) -> None:
    """Take back the blocks whose values, or whose rows in the journal, are not as they were written."""
    rows = connection.execute("SELECT number, figure, pieces, checksum FROM block").fetchall()
    with data.open("rb") as file:

        def whole(first: int, length: int, expected: str) -> bool:
            file.seek(first)
            return checksum_of_bytes(file.read(length)) == expected

        damaged = [
            number
            for number, figure, pieces, expected in rows
            if checksum(number, figure, pieces) != expected or not all(whole(*piece) for piece in json.loads(pieces))
        ]
    if damaged:
        connection.executemany("DELETE FROM block WHERE number = ?", [(number,) for number in damaged])
        _LOG.warning(
            "coilarray: %d of %d blocks in %s are damaged; they are computed again.", len(damaged), len(rows), data
        )


def _make(path: Path, frame: xr.Dataset, variables: Sequence[Variable]) -> None:
    """Write a frame and contiguous variables without values; their disk space is allocated at once."""
    from h5py import h5d, h5p

    from coilarray.compute.netcdf import netcdf_in

    layout = h5p.create(h5p.DATASET_CREATE)
    layout.set_layout(h5d.CONTIGUOUS)
    layout.set_alloc_time(h5d.ALLOC_TIME_EARLY)
    layout.set_fill_time(h5d.FILL_TIME_NEVER)
    memory = _SparseFile()
    with netcdf_in(memory, frame) as file:
        for variable in variables:
            made = file.create_variable(variable.name, variable.dims, np.dtype("<f8"), dcpl=layout)
            made.attrs.update(units=variable.units, long_name=variable.long_name)
    memory.copy_to(path)


class _SparseFile(io.RawIOBase):
    """A file in memory, of which only what was written takes any; all else is zero."""

    def __init__(self) -> None:
        self._pages: dict[int, bytearray] = {}  # by number
        self._at = self._size = 0

    def copy_to(self, path: Path) -> None:
        """Write it to the disk; OSError if that fails."""
        with path.open("wb") as file:
            for number, page in sorted(self._pages.items()):
                file.seek(number * _PAGE)
                file.write(page)
            file.truncate(self._size)

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def truncate(self, size: int | None = None) -> int:
        self._size = self._at if size is None else size
        return self._size

    def write(self, data: Any) -> int:
        values = memoryview(data).cast("B")
        for number, inside, part in self._parts(len(values)):
            self._pages.setdefault(number, bytearray(_PAGE))[inside] = values[part]
        self._at += len(values)
        self._size = max(self._size, self._at)
        return len(values)

    def readinto(self, buffer: Any) -> int:
        values = memoryview(buffer).cast("B")
        count = min(len(values), max(0, self._size - self._at))
        for number, inside, part in self._parts(count):
            values[part] = self._pages.get(number, bytearray(_PAGE))[inside]
        self._at += count
        return count

    def _parts(self, count: int) -> Iterator[tuple[int, slice, slice]]:
        """Return page, place in the page and place in the data of the next bytes."""
        done = 0
        while done < count:
            number, first = divmod(self._at + done, _PAGE)
            last = min(_PAGE, first + count - done)
            yield number, slice(first, last), slice(done, done + last - first)
            done += last - first


def _starts(path: Path, variables: Sequence[Variable]) -> dict[str, int]:
    """Return the byte offset of every variable in the file."""
    import h5py

    with h5py.File(path, "r") as file:
        return {variable.name: int(file[variable.name].id.get_offset()) for variable in variables}


def _discard(folder: Path) -> None:
    """Delete the files of this module in a folder."""
    for name in (_DATA, _JOURNAL, f"{_JOURNAL}-journal"):
        (folder / name).unlink(missing_ok=True)
