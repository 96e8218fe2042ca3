"""Arrays larger than memory in one netCDF file, filled block by block, that an interrupted run can go on with.

The file is laid out before the first number is there: its variables are contiguous, so that blocks go straight to
their place and nothing of the file's own structure changes afterwards. It stands in a folder beside the target, with a
journal of the blocks that are done, and gets its name when all are. A run that is killed at any moment loses the blocks
that it was computing.
"""

from __future__ import annotations

import math
import os
import shutil
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from coilarray.compute.files import make_folder, write_atomically
from coilarray.errors import OutputError

if TYPE_CHECKING:
    import xarray as xr

FloatArray = npt.NDArray[np.float64]

_DATA, _JOURNAL = "data.nc", "journal.db"
_ITEM = 8  # bytes
_FORMAT = "1"


@dataclass(frozen=True)
class Variable:
    """One variable of the file, of float64.

    Parameters
    ----------
    name : str
        In the file.
    dims : tuple of str
        Dimensions, coordinates of the frame.
    units, long_name : str
        Attributes.
    """

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
        """Figure of every block that is done, by its number."""
        return dict(self._connection.execute("SELECT number, figure FROM block"))

    @property
    def missing(self) -> list[int]:
        """Numbers of the blocks that are not done."""
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
        """Note that all of a block is written, with a figure to be kept of it; OutputError where that fails."""
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
    """Return the folder that an unfinished file stands in, beside its target."""
    return path.with_name(f"{path.name}.parts")


@contextmanager
def open_large(
    path: Path, frame: xr.Dataset, variables: Sequence[Variable], key: str, blocks: int
) -> Iterator[LargeFile]:
    """Open a file to be filled for the length of a ``with`` block; it gets its name if all blocks are done by then.

    Parameters
    ----------
    path : Path
        The file to make or replace, .nc; its folder is made where it does not exist.
    frame : xarray.Dataset
        Coordinates and attributes.
    variables : sequence of Variable
        Over the frame's dimensions.
    key : str
        Of all that enters the numbers: an unfinished file of the same key is gone on with.
    blocks : int
        Number of blocks.

    Yields
    ------
    LargeFile

    Raises
    ------
    OutputError
        Too little room on the disk, an unfinished file of another key, one that another run is filling, or a file
        that cannot be written.
    """
    if os.path.isdir(path):  # told before the work, not after it; false for names that are too long
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
        if named or empty:  # what is done stays otherwise, and what is another run's
            _discard(folder)


@contextmanager
def _journal(folder: Path) -> Iterator[sqlite3.Connection]:
    """Open the journal, which no other process can meanwhile: its lock ends with this one."""
    path = folder / _JOURNAL
    try:
        connection = sqlite3.connect(path, timeout=0, isolation_level=None)
    except sqlite3.Error as error:
        raise OutputError(f"cannot write {path}: {error}.") from None
    with closing(connection):
        try:
            connection.execute("PRAGMA locking_mode = EXCLUSIVE")
            connection.execute("BEGIN EXCLUSIVE")
            connection.execute("CREATE TABLE IF NOT EXISTS layout (key TEXT)")
            connection.execute("CREATE TABLE IF NOT EXISTS block (number INTEGER PRIMARY KEY, figure REAL)")
            connection.execute("COMMIT")  # the lock stays
        except sqlite3.Error as error:
            if "locked" in str(error):
                raise OutputError(f"another run is filling {folder}; wait for it or give another file.") from None
            raise OutputError(f"cannot use {path}: {error}.") from None
        yield connection


def _lay_out(
    path: Path, connection: sqlite3.Connection, frame: xr.Dataset, variables: Sequence[Variable], key: str
) -> None:
    """Lay out the file where it does not stand yet."""
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
    """Write a frame and contiguous variables without values, whose room is taken at once."""
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
    """Place of every variable's first value in the file."""
    import h5py

    with h5py.File(path, "r") as file:
        return {variable.name: int(file[variable.name].id.get_offset()) for variable in variables}


def _discard(folder: Path) -> None:
    """Remove what this module made in a folder, and the folder where nothing else is in it."""
    for name in (_DATA, _JOURNAL, f"{_JOURNAL}-journal"):
        (folder / name).unlink(missing_ok=True)
    with suppress(OSError):
        folder.rmdir()
