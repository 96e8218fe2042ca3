"""Datasets on disk as netCDF, and requirements on datasets.

A file is made in memory and written as a whole, because HDF5 crashes the process if it cannot
write, as on a full disk.
"""

import io
import math
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from coilarray.compute.files import write_bytes
from coilarray.compute.memory import require_memory
from coilarray.errors import CoilarrayError

_SHOWN = 100  # characters of names in a message
_LEAST_STEP = 1e-9  # m. Closer positions have another unit or do not belong to a map
_SLASH = "\N{DIVISION SLASH}"  # for the slash in names of coils of boards, which netCDF keeps for its groups


class _File(h5py.File):  # type: ignore[misc]  # h5py has no types
    """HDF5 file that opens each of h5netcdf's objects once."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._opened: dict[str, Any] = {}

    def __getitem__(self, name: Any) -> Any:
        if not isinstance(name, str):  # a reference
            return super().__getitem__(name)
        path = name.strip("/")
        if not path:
            return self
        if path not in self._opened:
            self._opened[path] = super().__getitem__(path)
        return self._opened[path]

    def __delitem__(self, name: str) -> None:
        self._opened.pop(name.strip("/"), None)
        super().__delitem__(name)


@dataclass(frozen=True)
class Entry:
    """Requirements on a variable, coordinate or attribute.

    `unit` is "" for any unit, and None for texts. A file may have the `dims` in any order, and with
    `fewer_dims` not all of them. `gaps` allows NaN. `rising` numbers rise by a nanometre or more,
    and begin with 0 or at least a nanometre if `low` is 0. `longest` is the length of a text.
    """

    unit: str | None
    dims: tuple[str, ...] = ()
    needed: bool = False
    low: float = -math.inf
    high: float = math.inf
    gaps: bool = False
    rising: bool = False
    fewer_dims: bool = False
    longest: int = 200
    names: tuple[str, ...] = ()
    flag: bool = False


@dataclass(frozen=True)
class Schema:
    """Requirements on a kind of dataset, other contents ignored.

    `summary` describes the kind. Each of `together` are variables of which a dataset has all or
    none.
    """

    error: type[CoilarrayError]
    summary: str
    variables: Mapping[str, Entry]
    attributes: Mapping[str, Entry] = field(default_factory=dict)
    together: tuple[tuple[str, ...], ...] = ()

    @property
    def needed(self) -> list[str]:
        """Names of the variables that a dataset must have."""
        return [name for name, entry in self.variables.items() if entry.needed]

    def checked(self, dataset: xr.Dataset, who: str) -> xr.Dataset:
        """Return a dataset in float64 with dimensions in order.

        >>> from coilarray.errors import LocalizeError
        >>> line = Schema(LocalizeError, "x", {"x": Entry("m", ("x",), needed=True, rising=True)})
        >>> line.checked(xr.Dataset(coords={"x": [1, 1]}), "line.nc")
        Traceback (most recent call last):
        coilarray.errors.LocalizeError: x of line.nc must rise; got 1 after 1.
        """
        for name, entry in self.variables.items():
            if name not in dataset.variables:
                if entry.needed:
                    raise self.error(f"{who} must have {self.summary}; {name} is missing.")
                continue
            variable = dataset[name]
            fits = set(variable.dims) <= set(entry.dims) if entry.fewer_dims else set(variable.dims) == set(entry.dims)
            if not fits:
                got = ", ".join(map(str, variable.dims))[:_SHOWN] or "nothing"
                if entry.needed:
                    raise self.error(f"{who} must have {self.summary}; {name} is over {got}.")
                raise self.error(f"{name} of {who} must be over {', '.join(entry.dims)}; got {got}.")
            if entry.needed and not variable.size:
                raise self.error(f"{name} of {who} must have at least one value.")
            values = self._values(variable.values, entry, f"{name} of {who}", variable.attrs.get("units"))
            order = tuple(dim for dim in entry.dims if dim in variable.dims)
            if values.dtype != variable.dtype or variable.dims != order:
                kept = xr.Variable(variable.dims, values, variable.attrs).transpose(*order)
                dataset = (
                    dataset.assign_coords({name: kept}) if name in dataset.coords else dataset.assign({name: kept})
                )
            if variable.dims == (name,) and entry.unit is None and len(set(values.tolist())) < values.size:
                shown = ", ".join(map(str, values.tolist()))[:_SHOWN]
                raise self.error(f"{name}s of {who} must have different names; got {shown}.")
            if entry.rising:
                if entry.low == 0 and 0 < values[0] < _LEAST_STEP:  # 0 itself may be put before it
                    least = f"0 or at {_LEAST_STEP:g} or more"
                    raise self.error(f"{name} of {who} must begin with {least}; got {values[0]:g}.")
                for before, value in pairwise(values.tolist()):
                    if value - before < _LEAST_STEP:
                        raise self.error(f"{name} of {who} must rise; got {value:g} after {before:g}.")
        for group in self.together:
            missing = [name for name in group if name not in dataset.variables]
            if 0 < len(missing) < len(group):
                raise self.error(f"{who} must have all of {', '.join(group)}, or none; {missing[0]} is missing.")
        for name, entry in self.attributes.items():
            if name in dataset.attrs:
                self._values(np.asarray(dataset.attrs[name]), entry, f"the attribute {name} of {who}", None)
        return dataset

    def _values(self, values: Any, entry: Entry, what: str, unit: Any) -> Any:
        if not entry.dims and values.ndim:
            raise self.error(f"{what} must be a single value; got an array of shape {values.shape}.")
        if entry.unit is None:
            for text in values.ravel().tolist():
                if not (isinstance(text, str) and text.isprintable() and len(text) <= entry.longest):
                    raise self.error(f"{what} must be texts of one line; got {str(text)[:40]!r}.")
            for name in entry.names:
                if name not in values:
                    raise self.error(f"{what} must have {name!r}.")
            return values
        if entry.flag:
            if values.dtype.kind != "b":
                raise self.error(f"{what} must be true or false; got {values.dtype}.")
            return values
        if values.dtype.kind not in "fiu":
            raise self.error(f"{what} must be numbers; got {values.dtype}.")
        if unit is not None and entry.unit and str(unit) != entry.unit:
            raise self.error(f"{what} must be in {entry.unit}; got {str(unit)[:40]!r}.")
        numbers = np.asarray(values, dtype=np.float64)
        wrong = ~((numbers >= entry.low) & (numbers <= entry.high) & np.isfinite(numbers))
        if entry.gaps:
            wrong &= ~np.isnan(numbers)
        if wrong.any():
            got = float(numbers[wrong].flat[0])
            limits = "" if math.isinf(entry.low) else f" and at least {entry.low:g}"
            limits += "" if math.isinf(entry.high) else f" and at most {entry.high:g}"
            raise self.error(f"{what} must be finite{limits}; got {got:g}.")
        return numbers


def variables(
    *rows: tuple[str, tuple[str, ...], Any, str, str],
) -> dict[str, tuple[tuple[str, ...], Any, dict[str, str]]]:
    """Make variables from name, dimensions, values, unit and words."""
    return {
        name: (dims, values, ({"units": unit} if unit else {}) | {"long_name": words})
        for name, dims, values, unit, words in rows
    }


def save_dataset(dataset: xr.Dataset, path: Path) -> None:
    """Write a dataset as netCDF, completely or not at all."""
    write_bytes(path, netcdf_of(dataset))


def netcdf_of(dataset: xr.Dataset) -> bytes:
    """Return the content of the netCDF file of a dataset."""
    memory = io.BytesIO()
    with netcdf_in(memory, dataset):
        pass
    return memory.getvalue()


def _renamed(dataset: xr.Dataset, old: str, new: str) -> xr.Dataset:
    """Replace a letter in names of variables and dimensions."""
    names = {name: name.replace(old, new) for name in map(str, {*dataset.variables, *dataset.dims}) if old in name}
    return dataset.rename(names) if names else dataset


@contextmanager
def netcdf_in(memory: io.IOBase, dataset: xr.Dataset, **options: Any) -> Iterator[Any]:
    """Write a dataset to memory, and yield the h5netcdf.File."""
    import h5netcdf
    from xarray.backends import H5NetCDFStore

    with _File(memory, "w", track_order=True) as opened, h5netcdf.File(opened, "w", **options) as file:
        _renamed(dataset, "/", _SLASH).dump_to_store(H5NetCDFStore(file))
        yield file


def load_part(path: Path) -> xr.Dataset | None:
    """Read a netCDF file, None if missing or unreadable."""
    try:
        return _load(path)
    except Exception:  # h5py, h5netcdf and xarray raise many kinds of errors for a damaged file
        return None


def read_checked(path: Path, *schemas: Schema) -> xr.Dataset:
    """Read a dataset and check it by its schema."""
    error = schemas[0].error
    if not path.is_file():
        raise error(f"there is no file {path}.")
    try:
        dataset = _load(path)
    except CoilarrayError:
        raise
    except Exception:  # as above
        raise error(f"cannot read {path}: it is no netCDF file, or damaged.") from None
    fitting = [one for one in schemas if all(name in dataset.variables for name in one.needed)]
    return (fitting or schemas)[0].checked(dataset, str(path))


def _load(path: Path) -> xr.Dataset:
    import h5netcdf
    from xarray.backends import H5NetCDFStore

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about the meaning of a damaged attribute
        with _File(path, "r") as opened:
            opened.attrs.get("_nc3_strict")  # an error here would leave half an object of h5netcdf, loud on stderr
            with (
                h5netcdf.File(opened, "r", decode_vlen_strings=True, phony_dims="access") as file,
                xr.open_dataset(H5NetCDFStore(file), decode_times=False) as dataset,
            ):
                require_memory(dataset.nbytes, str(path))
                return _renamed(dataset.load(), _SLASH, "/")
