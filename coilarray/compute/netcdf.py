"""Datasets on disk as netCDF, written whole or not at all, with a checksum behind them that is checked on reading.

A file is made in memory and written as a whole: HDF5 crashes the process where it cannot write, as on a full disk.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import xarray as xr

from coilarray.compute.checksum import check_seal, seal_file
from coilarray.compute.files import write_atomically


def variables(
    *rows: tuple[str, tuple[str, ...], Any, str, str],
) -> dict[str, tuple[tuple[str, ...], Any, dict[str, str]]]:
    """Variables of a dataset from rows of a name, dimensions, values, the unit ("" for none), and the name in words."""
    return {
        name: (dims, values, ({"units": unit} if unit else {}) | {"long_name": words})
        for name, dims, values, unit, words in rows
    }


def save_dataset(dataset: xr.Dataset, path: Path) -> None:
    """Write a dataset as netCDF, whole or not at all; OutputError where that fails."""
    memory = io.BytesIO()
    with netcdf_in(memory, dataset):
        pass

    def write(temporary: Path) -> None:
        temporary.write_bytes(memory.getbuffer())
        seal_file(temporary)

    write_atomically(path, write)


@contextmanager
def netcdf_in(memory: io.IOBase, dataset: xr.Dataset) -> Iterator[Any]:
    """Write a dataset into a file in memory; within the block more can be added to the h5netcdf.File that it gets."""
    import h5netcdf
    from xarray.backends import H5NetCDFStore

    with h5netcdf.File(memory, "w") as file:
        dataset.dump_to_store(H5NetCDFStore(file))
        yield file


def load_part(path: Path) -> xr.Dataset | None:
    """Read a dataset from a netCDF file; None where there is no such file, or none that can be read.

    DamagedError for a file that `save_dataset` wrote and that has changed since. Files of other programs have no
    checksum, and are read as they are.
    """
    try:
        check_seal(path)
        with xr.open_dataset(path, engine="h5netcdf") as dataset:
            return dataset.load()
    except (OSError, ValueError, KeyError):
        return None
