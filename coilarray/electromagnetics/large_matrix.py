"""Inductance matrices larger than memory: square blocks of paths on any pool of workers, into one file.

Within a block pairs of equal shapes at equal offsets are computed once, as in `coilarray.inductance_matrix`; alike
pairs of different blocks are computed again. Which of two pairs that differ by rounding stands for both, and how a sum
is cut among threads, depends on the blocks, so entries agree with those in memory to 1e-12 of L and not to the last bit
(tests/circuit/test_volumes.py).
"""

from __future__ import annotations

import hashlib
import itertools
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.compute.code_version import code_version
from coilarray.compute.large_file import LargeFile, Variable, open_large
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import Progress, ranges
from coilarray.compute.workers import Pool
from coilarray.electromagnetics.inductance import Accuracy, inductance_matrix, mutual_inductance
from coilarray.electromagnetics.neumann import BYTES_A_PAIR
from coilarray.electromagnetics.source import Source, as_conductors
from coilarray.errors import GeometryError, OutputError
from coilarray.geometry import Conductor

FloatArray = npt.NDArray[np.float64]

_PATHS = 256  # in a block
_VARIABLE = Variable("inductance", ("path", "other"), "H", "inductance matrix")


@dataclass(frozen=True, eq=False)
class MatrixBlock:
    """Some rows and some columns of a matrix; no columns where they are the rows.

    Parameters
    ----------
    rows, columns : tuple of Conductor
        Their paths.
    accuracy : {"full", "screen"}
        As in `coilarray.inductance_matrix`.
    """

    rows: tuple[Conductor, ...]
    columns: tuple[Conductor, ...]
    accuracy: Accuracy


def write_inductance_matrix(
    path: Path,
    source: Source,
    pool: Pool,
    *,
    accuracy: Accuracy = "full",
    progress: Progress | None = None,
) -> None:
    """Write the inductance matrix of any number of paths.

    Parameters
    ----------
    path : Path
        The file to make or replace, .nc; what is not finished stands in the folder PATH.parts and is gone on with when
        the same matrix is written again.
    source, accuracy
        As in `coilarray.inductance_matrix`.
    pool : Pool
        From `coilarray.compute.workers.workers`; with ``workers(cluster="tcp://host:8786")`` the blocks are computed by
        the workers of a Dask cluster, and written here.
    progress : callable, optional
        Called with (done, total) as blocks are done, those of an earlier run included.

    Raises
    ------
    GeometryError
        A thin filament: its self-inductance is infinite.
    MemoryLimitError
        Less memory than the blocks in flight need.
    OutputError
        Too little room on the disk, an unfinished file of another matrix, or a file that cannot be written.
    ClusterError
        As `Pool.run`.

    Notes
    -----
    The file is netCDF with ``inductance`` (path, other) in H, all of the symmetric matrix, 8 bytes an entry; open it
    with `xarray.open_dataset`, which reads what is selected.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from coilarray.compute.workers import workers
    >>> square = np.array([[0, 0, 0], [1e-2, 0, 0], [1e-2, 1e-2, 0], [0, 1e-2, 0], [0, 1e-4, 0]])
    >>> loops = [Conductor(square + [0, 0, height], 0.15e-3, 35e-6) for height in (0.0, 2e-3)]
    >>> with TemporaryDirectory() as folder, workers() as pool:
    ...     write_inductance_matrix(Path(folder, "L.nc"), loops, pool)
    ...     with xr.open_dataset(Path(folder, "L.nc"), engine="h5netcdf") as matrix:
    ...         print(np.round(matrix.inductance.values * 1e9, 2))
    [[37.64  8.24]
     [ 8.24 37.64]]
    """
    conductors = as_conductors(source)
    if path.suffix.lower() != ".nc":
        raise OutputError(f"a matrix is written as .nc; got {path}.")
    tiles = ranges(len(conductors), _PATHS)
    pairs = list(itertools.combinations_with_replacement(tiles, 2))
    require_memory(
        (BYTES_A_PAIR + 48.0) * min(_PATHS, len(conductors)) ** 2 * (pool.capacity + 1),
        f"a matrix in blocks of {_PATHS} paths, {pool.capacity} in flight,",
        "take fewer workers",
    )
    numbers = np.arange(len(conductors))
    frame = xr.Dataset(
        coords={"path": numbers, "other": numbers}, attrs={"coilarray_version": metadata.version("coilarray")}
    )
    with open_large(path, frame, [_VARIABLE], _key(conductors, accuracy), len(pairs)) as file:
        missing = file.missing
        done = len(pairs) - len(missing)
        if progress is not None and done:
            progress(done, len(pairs))
        work = (_block(conductors, *pairs[number], accuracy) for number in missing)
        for index, values in pool.run(matrix_block, work):
            if isinstance(values, str):
                raise GeometryError(values)
            _write(file, len(conductors), *pairs[missing[index]], values)
            file.finish(missing[index])
            done += 1
            if progress is not None:
                progress(done, len(pairs))


def matrix_block(block: MatrixBlock) -> FloatArray:
    """Inductances between rows and columns in H, shape (rows, columns); this is what workers run."""
    if not block.columns:
        return inductance_matrix(block.rows, accuracy=block.accuracy)
    return mutual_inductance(block.rows, block.columns, accuracy=block.accuracy)


def _block(
    conductors: tuple[Conductor, ...], rows: tuple[int, int], columns: tuple[int, int], accuracy: Accuracy
) -> MatrixBlock:
    others = () if rows == columns else conductors[slice(*columns)]
    return MatrixBlock(conductors[slice(*rows)], others, accuracy)


def _write(file: LargeFile, count: int, rows: tuple[int, int], columns: tuple[int, int], values: FloatArray) -> None:
    """Write a block and its mirror image below the diagonal."""
    for (first, _), (start, _), block in ((rows, columns, values), (columns, rows, values.T)):
        for row, entries in enumerate(block, start=first):
            file.write(_VARIABLE.name, row * count + start, entries)


def _key(conductors: tuple[Conductor, ...], accuracy: Accuracy) -> str:
    """Name of all that enters the numbers and the attributes: blocks of two versions are never mixed."""
    digest = hashlib.sha256(repr((code_version(), accuracy)).encode())
    for conductor in conductors:
        for array in (conductor.vertices, conductor.widths, conductor.thicknesses):
            digest.update(repr(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:24]
