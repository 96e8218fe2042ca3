"""Arrays larger than memory in one netCDF file, filled block by block; an interrupted run can be continued.

The file is laid out before the first number is computed: its variables are contiguous, so that each block is written
straight to its place and the structure of the file never changes. Until all blocks are done the file lies in a folder
beside the target, together with a journal of the finished blocks. A run that is killed loses only the blocks that it
was computing.
"""

from __future__ import annotations

import math
import os
import shutil
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.compute.files import make_folder, write_atomically
from coilarray.compute.store import locked_database
from coilarray.compute.threads import Progress
from coilarray.compute.workers import Pool
from coilarray.errors import GeometryError, OutputError

if TYPE_CHECKING:
    import xarray as xr

Item = TypeVar("Item")
Result = TypeVar("Result")

_DATA, _JOURNAL = "data.nc", "journal.db"
_ITEM = 8  # bytes
_FORMAT = "1"


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
        """Write consecutive values of a variable from the flat index `start` on; OutputError where that fails."""
        try:
            self._stream.seek(self._starts[name] + _ITEM * start)
            self._stream.write(np.ascontiguousarray(values, dtype="<f8").tobytes())
        except OSError as error:
            raise OutputError(f"cannot write {self._path}: {error.strerror or error}.") from None

    def finish(self, number: int, figure: float = 0.0) -> None:
        """Record a block as written, with a figure to keep of it; OutputError where that fails."""
        try:
            self._stream.flush()
            os.fsync(self._stream.fileno())  # on the disk before the journal says so
            self._connection.execute("INSERT OR REPLACE INTO block VALUES (?, ?)", (number, figure))
        except (OSError, sqlite3.Error) as error:
            raise OutputError(f"cannot write {self._path}: {getattr(error, 'strerror', None) or error}.") from None

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
        with _journal(folder) as connection:
            try:
                _lay_out(path, connection, frame, variables, f"{_FORMAT} {key} {blocks}")
                starts = _starts(folder / _DATA, variables)
                with closing(LargeFile(folder / _DATA, starts, connection, blocks)) as file:
                    yield file
                    complete = not file.missing
            finally:
                empty = connection.execute("SELECT count(*) FROM block").fetchone() == (0,)
        if complete:
            (folder / _DATA).replace(path)
            named = True
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}.") from None
    finally:
        if named or empty:  # else finished blocks stay, and so does the file of another run
            _discard(folder)


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


@contextmanager
def _journal(folder: Path) -> Iterator[sqlite3.Connection]:
    """Open the journal, which no other process can open meanwhile."""
    busy = f"another run is filling {folder}; wait for it or give another file."
    with locked_database(folder / _JOURNAL, busy) as connection:
        connection.execute("CREATE TABLE IF NOT EXISTS layout (key TEXT)")
        connection.execute("CREATE TABLE IF NOT EXISTS block (number INTEGER PRIMARY KEY, figure REAL)")
        yield connection


def _lay_out(
    path: Path, connection: sqlite3.Connection, frame: xr.Dataset, variables: Sequence[Variable], key: str
) -> None:
    """Make the file where there is none yet."""
    data = parts_folder(path) / _DATA
    laid_out = connection.execute("SELECT key FROM layout").fetchone()
    begun = data.exists() and connection.execute("SELECT count(*) FROM block").fetchone() != (0,)
    if begun and laid_out == (key,):
        return
    if begun:
        raise OutputError(
            f"{data.parent} holds another unfinished file, of other inputs or another version; "
            "delete it or give another file."
        )
    for table in ("layout", "block"):
        connection.execute(f"DELETE FROM {table}")
    size = sum(_ITEM * math.prod(frame.sizes[dim] for dim in variable.dims) for variable in variables)
    free = shutil.disk_usage(data.parent).free
    if size > free:
        raise OutputError(f"{path} needs {size / 1e9:.3g} GB on the disk; {free / 1e9:.3g} GB are free.")
    write_atomically(data, lambda temporary: _make(temporary, frame, variables))
    connection.execute("INSERT INTO layout VALUES (?)", (key,))


def _make(path: Path, frame: xr.Dataset, variables: Sequence[Variable]) -> None:
    """Write a frame and contiguous variables without values; their disk space is allocated at once."""
    import h5netcdf
    from h5py import h5d, h5p

    frame.to_netcdf(path, engine="h5netcdf")
    layout = h5p.create(h5p.DATASET_CREATE)
    layout.set_layout(h5d.CONTIGUOUS)
    layout.set_alloc_time(h5d.ALLOC_TIME_EARLY)
    layout.set_fill_time(h5d.FILL_TIME_NEVER)
    with h5netcdf.File(path, "a") as file:
        for variable in variables:
            made = file.create_variable(variable.name, variable.dims, np.dtype("<f8"), dcpl=layout)
            made.attrs.update(units=variable.units, long_name=variable.long_name)


def _starts(path: Path, variables: Sequence[Variable]) -> dict[str, int]:
    """Return the byte offset of every variable in the file."""
    import h5py

    with h5py.File(path, "r") as file:
        return {variable.name: int(file[variable.name].id.get_offset()) for variable in variables}


def _discard(folder: Path) -> None:
    """Delete the files of this module in a folder, and the folder once it is empty."""
    for name in (_DATA, _JOURNAL, f"{_JOURNAL}-journal"):
        (folder / name).unlink(missing_ok=True)
    with suppress(OSError):
        folder.rmdir()
