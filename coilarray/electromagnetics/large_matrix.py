"""Inductance matrices larger than memory, computed in square blocks of paths on any pool of workers into one file.

Within a block, pairs of equal shapes at equal offsets are computed once, as in `coilarray.inductance_matrix`; equal
pairs in different blocks are computed again. The blocks decide which of two pairs that differ by rounding stands for
both, and where sums are split among threads. Entries therefore agree with those in memory to 1e-12 of L, but not to the
last bit (tests/circuit/test_volumes.py).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np
import xarray as xr

from coilarray.compute.arrays import FloatArray
from coilarray.compute.large_file import LargeFile, Variable, fill_large
from coilarray.compute.memory import require_memory
from coilarray.compute.store import content_key
from coilarray.compute.threads import Progress, ranges
from coilarray.compute.workers import Pool
from coilarray.electromagnetics.inductance import Accuracy, inductance_matrix, mutual_inductance
from coilarray.electromagnetics.neumann import BYTES_A_PAIR
from coilarray.electromagnetics.source import Source, as_conductors
from coilarray.errors import OutputError
from coilarray.geometry import CoilArray, Conductor
from coilarray.geometry.overlap import require_apart

_PATHS = 256  # rows and columns of a block
_VARIABLE = Variable("inductance", ("path", "other"), "H", "inductance matrix")


@dataclass(frozen=True, eq=False)
class MatrixBlock:
    """The paths of some rows and some columns of a matrix; no columns for a block on the diagonal."""

    rows: tuple[Conductor, ...]
    columns: tuple[Conductor, ...]
    accuracy: Accuracy


def write_inductance_matrix(
    path: Path, source: Source, pool: Pool, *, accuracy: Accuracy = "full", progress: Progress | None = None
) -> None:
    """Write the inductance matrix of any number of paths.

    Parameters
    ----------
    path : Path
        The .nc file to make or replace. Finished blocks are kept in the folder PATH.parts until all are done, and
        writing the same matrix again continues from there.
    source : CoilArray or sequence of Conductor
        Current paths of the matrix.
    pool : Pool
        Workers that compute the blocks, from `coilarray.compute.workers.workers`; on a Dask cluster with
        ``workers(cluster="tcp://host:8786")``. This process writes the file.
    accuracy : {"full", "screen"}
        Accuracy of the inductances; see `coilarray.inductance_matrix`.
    progress : callable, optional
        Called with (done, total) as blocks are done, those of an earlier run included.

    Raises
    ------
    GeometryError
        A thin filament, whose self-inductance is infinite, or traces of an array that overlap, as `inductance_matrix`.
    MemoryLimitError
        The blocks in flight need more memory than is allowed.
    OutputError
        Too little space on the disk, an unfinished file of another matrix, or a file that cannot be written.
    ClusterError
        Lost workers; see `coilarray.compute.workers.Pool.run`.

    Notes
    -----
    The netCDF file holds ``inductance`` (path, other) in H, the whole symmetric matrix with 8 bytes an entry. Open it
    with `xarray.open_dataset`, which reads only what is selected.

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
    require_apart(conductors, source.stackup if isinstance(source, CoilArray) else None)
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

    def task(number: int) -> MatrixBlock:
        rows, columns = pairs[number]
        return MatrixBlock(conductors[slice(*rows)], () if rows == columns else conductors[slice(*columns)], accuracy)

    def write(file: LargeFile, number: int, values: FloatArray) -> float:
        (row, _), (column, _) = pairs[number]
        for first, start, block in ((row, column, values), (column, row, values.T)):  # and its mirror image
            for k, entries in enumerate(block, start=first):
                file.write(_VARIABLE.name, k * len(conductors) + start, entries)
        return 0.0

    key = content_key("inductance matrix", accuracy, conductors)
    fill_large(path, frame, [_VARIABLE], key, len(pairs), task, matrix_block, write, pool, progress=progress)


def matrix_block(block: MatrixBlock) -> FloatArray:
    """Return the inductances between rows and columns in H, shape (rows, columns); workers run this function."""
    if not block.columns:
        return inductance_matrix(block.rows, accuracy=block.accuracy, allow_overlaps=True)  # looked for before
    return mutual_inductance(block.rows, block.columns, accuracy=block.accuracy)
