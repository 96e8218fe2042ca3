"""Datasets on disk as netCDF, written whole or not at all, with a checksum behind them that is checked on reading."""

from __future__ import annotations

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

    def write(temporary: Path) -> None:
        dataset.to_netcdf(temporary, engine="h5netcdf")
        seal_file(temporary)

    write_atomically(path, write)


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
