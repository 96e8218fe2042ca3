"""Log of a live display as CSV.

Every scan is a line, written to the file at once. netCDF is made from it at the end. A killed program loses at most the
last line, and a power cut at most the last second. The last column is a checksum of the log up to there. The last line
of a log that was ended has the number of its lines and a checksum of the whole log.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, TypeVar

import numpy as np
import xarray as xr

from coilarray.compute.checksum import TableSeal, checked_rows, has_checksums
from coilarray.compute.files import read_text, writing
from coilarray.compute.netcdf import save_dataset
from coilarray.errors import DamagedError, OutputError
from coilarray.hardware.record.live_tracking import LiveReading
from coilarray.hardware.record.recorded_response import VERDICTS

_T = TypeVar("_T")
_DURABLE = 1.0  # s
_NETCDF = ".nc"
_BEFORE = ("time_s", "unix_s", "sequence", "emulated")
_TEMPERATURE = "temperature_C"
_VERDICT = " verdict"  # behind the name of a state
_LENGTHS = ("x_m", "y_m", "depth_m", "sigma_x_m", "sigma_y_m", "sigma_depth_m")
_UNITS = {"time_s": "s", "unix_s": "s", **dict.fromkeys(_LENGTHS, "m"), "temperature_C": "degC"}


class LiveLog:
    """A log that is open for writing.

    `open_log` opens it.
    """

    def __init__(self, file: IO[str], states: Sequence[str], *, emulated: bool, temperature: bool) -> None:
        self._file, self._seal, self._broken = file, TableSeal(), False
        self._states, self._emulated, self._temperature = tuple(states), int(emulated), temperature
        self._durable = -math.inf
        self._write(self._seal.line(log_columns(states, temperature=temperature)))

    def add(self, reading: LiveReading) -> None:
        """Write the line of a scan.

        A failure, for example a full disk, raises an OutputError.
        """
        states = {state.name: state for state in reading.states}
        deltas = [states[name].delta for name in self._states]
        verdicts = [states[name].verdict for name in self._states]
        press = None if reading.press is None else reading.press.number
        row: list[object] = [reading.elapsed, reading.received, reading.sequence, self._emulated, *deltas, *verdicts]
        row += [*_position(reading), press, *([reading.temperature] if self._temperature else [])]
        self._write(self._seal.line("" if value is None else str(value) for value in row))
        if time.monotonic() - self._durable > _DURABLE:
            with writing(self._file.name):
                os.fsync(self._file.fileno())
            self._durable = time.monotonic()

    def end(self) -> None:
        """Write the last line.

        If a line before it could not be written, the log stays cut.
        """
        if not self._broken:
            self._write(self._seal.end())

    def _write(self, line: str) -> None:
        self._broken = True
        with writing(self._file.name):
            self._file.write(line)
            self._file.flush()
        self._broken = False


def log_columns(states: Sequence[str], *, temperature: bool) -> list[str]:
    """Return the columns of a log without the checksum.

    Examples
    --------
    >>> log_columns(["L1"], temperature=False)[:6]
    ['time_s', 'unix_s', 'sequence', 'emulated', 'L1', 'L1 verdict']
    """
    verdicts = [name + _VERDICT for name in states]
    return [
        *_BEFORE,
        *states,
        *verdicts,
        "status",
        *_LENGTHS,
        "press",
        *([_TEMPERATURE] if temperature else []),
    ]


def check_log(path: Path, *, force: bool = False) -> None:
    """Refuse a log that must not be replaced.

    OutputError is raised if the log, or the lines that a killed program left, exist. `force` allows to replace them.
    """
    for there in {path, _lines_of(path)}:
        if there.exists() and not force:
            left = "" if there == path else ", the lines of a log that was not finished,"
            raise OutputError(f"{there}{left} exists; name another log, or replace it with --force.")


@contextmanager
def open_log(
    path: Path,
    states: Sequence[str],
    *,
    emulated: bool,
    temperature: bool,
    attributes: Mapping[str, Any],
    force: bool = False,
) -> Iterator[LiveLog]:
    """Open a log of live readings.

    The log is closed in whichever way the block is left.

    Parameters
    ----------
    path : Path
        File that ends in .csv or .nc. The lines of the latter are kept in ``NAME.nc.csv`` until the end.
    states : sequence of str
        Names of the states of a scan.
    emulated, temperature : bool
        Whether the board is emulated, and whether there is a column of temperatures.
    attributes : mapping
        Attributes of a netCDF file.
    force : bool
        Whether a file that exists may be replaced.

    Raises
    ------
    OutputError
        A file that `check_log` refuses, or that cannot be written.
    """
    check_log(path, force=force)
    lines = _lines_of(path)
    with writing(lines, ValueError):
        file = lines.open("w", encoding="utf-8", newline="")
    try:
        log = LiveLog(file, states, emulated=emulated, temperature=temperature)
    except OutputError:
        with suppress(OSError):
            file.close()
        lines.unlink(missing_ok=True)
        raise
    try:
        yield log
    finally:
        with writing(lines):
            try:
                log.end()
            finally:
                file.close()
        if lines != path:
            save_dataset(read_log(lines, cut=True).assign_attrs(attributes), path)
            with suppress(OSError):
                lines.unlink()


def read_log(path: Path, *, cut: bool = False) -> xr.Dataset:
    """Read the CSV of a log.

    Parameters
    ----------
    path : Path
        Log that `open_log` wrote.
    cut : bool
        Whether to read the complete lines of a log without its last line too. A killed program leaves such a log.

    Returns
    -------
    xarray.Dataset
        Over ``scan`` and ``state``: ``delta``, NaN if unknown, and ``verdict``, 0 good, 1 doubtful, 2 bad. Over
        ``scan``: the other columns by their names without the unit, NaN if empty. ``press`` is 0 if nothing presses.
        ``status`` is the verdict of `coilarray.localize.inverse.Location`, empty if no location was requested. The
        attribute ``cut`` is 1 for a log without its last line, and 0 otherwise.

    Raises
    ------
    OutputError
        A file that is not a log, a log without its last line, or an invalid line. The message gives line and column.
    """
    text = read_text(path, OutputError)
    if not text.startswith(",".join(_BEFORE)) and not has_checksums(text):
        raise OutputError(f"{path} is not a log of a live display.")
    try:
        (head, *rows), ended = checked_rows(text, path, cut=cut)
    except DamagedError as error:
        raise OutputError(str(error)) from None
    states = [name.removesuffix(_VERDICT) for name in head if name.endswith(_VERDICT)]
    if head != log_columns(states, temperature=_TEMPERATURE in head[-1:]):
        raise OutputError(f"{path} is not a log of a live display.")
    for line, row in enumerate(rows, start=2):
        if len(row) != len(head):
            raise OutputError(f"{path}, line {line}: must have {len(head)} columns; got {len(row)}.")
    columns = dict(zip(head, zip(*rows, strict=True) if rows else [()] * len(head), strict=True))

    def read(name: str, kind: Callable[[str], _T], allowed: str) -> list[_T]:
        """Convert a column."""
        found = []
        for line, field in enumerate(columns[name], start=2):
            try:
                found.append(kind(field))
            except ValueError:
                raise OutputError(f"{path}, line {line}, column {name}: must be {allowed}; got {field!r}.") from None
        return found

    def numbers(name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
        return np.array(read(name, lambda field: _finite(field) if field else math.nan, "a number"), dtype=np.float64)

    def whole(name: str, kind: Callable[[str], int]) -> np.ndarray[Any, np.dtype[np.int64]]:
        return np.array(read(name, kind, "a whole number"), dtype=np.int64)

    dims = ("scan", "state")
    names: tuple[str, ...] = VERDICTS
    verdicts = np.array([read(name + _VERDICT, names.index, ", ".join(names)) for name in states], dtype=np.int8)
    shape = (len(rows), len(states))
    return xr.Dataset(
        {
            "delta": (dims, np.array([numbers(name) for name in states]).T.reshape(shape), {"units": "1"}),
            "verdict": (
                dims, verdicts.T.reshape(shape), {"flag_values": [0, 1, 2], "flag_meanings": " ".join(VERDICTS)}
            ),
            "sequence": ("scan", whole("sequence", int)),
            "press": ("scan", whole("press", lambda field: int(field or 0))),
            "status": ("scan", np.array(columns["status"], dtype=object)),
            **{
                name.rpartition("_")[0]: ("scan", numbers(name), {"units": unit})
                for name, unit in _UNITS.items()
                if name in columns
            },
        },
        coords={"state": states},
        attrs={"emulated": int("1" in columns["emulated"]), "cut": int(not ended)},
    ).set_coords(["time", "unix"])  # fmt: skip


def _finite(field: str) -> float:
    value = float(field)
    if not math.isfinite(value):
        raise ValueError
    return value


def _lines_of(path: Path) -> Path:
    """Return the CSV file with the lines of a log."""
    return path.with_name(f"{path.name}.csv") if path.suffix.lower() == _NETCDF else path


def _position(reading: LiveReading) -> list[object]:
    """Return verdict, position and standard deviations of a reading.

    Unknown values are None.
    """
    location = reading.location
    if location is None or not location.modes:
        return [None if location is None else location.verdict, *[None] * 6]
    best = location.modes[0]
    known = (*best.known_deviations, None, None, None)[:3]
    return [location.verdict, best.x, best.y, best.depth, *known]
