"""Results on disk: datasets as netCDF, written whole or not at all."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from coilarray.compute.files import write_atomically


def save_dataset(dataset: xr.Dataset, path: Path) -> None:
    """Write a dataset as netCDF, whole or not at all; OutputError where that fails."""
    write_atomically(path, lambda temporary: _to_netcdf(dataset, temporary))


def load_part(path: Path) -> xr.Dataset | None:
    """Read a dataset that an earlier run kept; None where there is none, or none that can be read."""
    try:
        with xr.open_dataset(path, engine="h5netcdf") as dataset:
            return dataset.load()
    except (OSError, ValueError, KeyError):
        return None


def _to_netcdf(dataset: xr.Dataset, path: Path) -> None:
    dataset.to_netcdf(path, engine="h5netcdf")
