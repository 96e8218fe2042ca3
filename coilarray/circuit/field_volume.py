"""Fields of an array in operation on grids larger than memory: block by block on any pool of workers, into one file.

A block is a run of consecutive points of the grid, x slowest and z fastest. Every point is summed over the segments in
the order of `coilarray.circuit.operating_field.operating_field`, and the blocks cut the points where that does, so the
numbers are the same to the last bit on one kind of machine.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.operating_field import operating_currents, operating_field
from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.large_file import LargeFile, Variable, fill_large
from coilarray.compute.memory import require_memory
from coilarray.compute.store import content_key
from coilarray.compute.threads import Progress, ranges
from coilarray.compute.workers import Pool
from coilarray.design.model import Design
from coilarray.electromagnetics.field import magnetic_field
from coilarray.errors import GeometryError, MetalError, OutputError
from coilarray.geometry import Conductor

_ALIGNED = 512  # points; `magnetic_field` sums so many at once, and others give other last digits
_MOST_POINTS, _MOST_PAIRS = 2**18, 2e10  # of points and segments in a block, some seconds of work
_BYTES_A_POINT = 200.0  # of a block: its points, the fields, and their copies on the way
_BYTES_ON_DISK = 48.0  # a point


@dataclass(frozen=True, eq=False)
class FieldBlock:
    """Points `start` to `stop` of a grid, z fastest, and the currents (paths,) in A whose field is wanted there.

    The `axes` are x, y and z of the grid in m.
    """

    conductors: tuple[Conductor, ...]
    currents: ComplexArray
    axes: tuple[FloatArray, FloatArray, FloatArray]
    start: int
    stop: int


def write_field_volume(
    path: Path,
    design: Design,
    coupling: xr.Dataset,
    active: str,
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    z: npt.ArrayLike,
    pool: Pool,
    *,
    current: float = 1.0,
    terminated: bool = True,
    progress: Progress | None = None,
) -> float:
    """Write B on a grid of any size while one coil is measured; return the largest |B_z| in phase in T.

    The arguments are those of `coilarray.circuit.operating_field.operating_field`, and of
    `coilarray.electromagnetics.large_matrix.write_inductance_matrix` for the file, the workers and what they raise.

    Notes
    -----
    The file is that of `operating_field`, netCDF with ``B`` and ``B_quadrature`` (x, y, z, component) in T, 48 bytes a
    point; open it with `xarray.open_dataset`, which reads what is selected. Blocks have up to 262 144 points, 13 MB
    that come back from a worker, of which two are in flight for each. Measured on the bundled starter board: 13.8
    million points, 0.66 GB, took 28 s with one worker of Dask, and this process had 0.34 GB of memory at the most.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from coilarray import couple_design, load_design
    >>> from coilarray.compute.workers import workers
    >>> design = load_design("gast2020")
    >>> with TemporaryDirectory() as folder, workers() as pool:
    ...     where = Path(folder, "volume.nc")
    ...     coupling = couple_design(design, ideal=True)
    ...     peak = write_field_volume(where, design, coupling, "coil2", [0.0], [0.0], [1e-3, 2e-3], pool)
    ...     with xr.open_dataset(where, engine="h5netcdf") as volume:
    ...         print(volume.B.shape, peak == abs(volume.B[..., 2]).max().item())
    (1, 1, 2, 3) True
    """
    axes = _axis(x), _axis(y), _axis(z)
    if not all(len(axis) and np.isfinite(axis).all() for axis in axes):
        raise GeometryError("x, y and z must be finite, one value or more each.")
    if path.suffix.lower() != ".nc":
        raise OutputError(f"a volume is written as .nc; got {path}.")
    if design.plates:
        raise MetalError(
            f"B is written block by block only without plates; {design.name} has the plate {design.plates[0].name!r}: "
            "compute a smaller grid in memory."
        )
    sample = operating_field(
        design, coupling, active, *(axis[:1] for axis in axes), current=current, terminated=terminated
    )
    currents = current * operating_currents(design, coupling, active, terminated=terminated)
    conductors = design.array.conductors()
    require_memory(
        bytes_needed(design, axes, pool)[1], f"a volume with {pool.capacity} blocks in flight", "take fewer workers"
    )
    blocks = [FieldBlock(conductors, currents, axes, start, stop) for start, stop in _blocks(conductors, axes)]
    frame = xr.Dataset(
        coords={
            **{name: (name, axis, {"units": "m"}) for name, axis in zip("xyz", axes, strict=True)},
            "component": sample.component.values,
        },
        attrs=sample.attrs,
    )
    variables = [
        Variable(str(name), tuple(map(str, one.dims)), one.attrs["units"], one.attrs["long_name"])
        for name, one in sample.data_vars.items()
    ]

    def write(file: LargeFile, number: int, fields: FloatArray) -> float:
        for variable, values in zip(variables, fields, strict=True):
            file.write(variable.name, 3 * blocks[number].start, values)
        return float(np.abs(fields[0, :, 2]).max())

    key = content_key("field volume", sample.attrs, currents, axes, conductors)
    peaks = fill_large(
        path, frame, variables, key, len(blocks), blocks.__getitem__, field_block, write, pool, progress=progress
    )
    return max(peaks.values())


def block_count(design: Design, axes: Sequence[FloatArray]) -> int:
    """Return the number of blocks that the field of a design on a grid has."""
    return len(_blocks(design.array.conductors(), axes))


def bytes_needed(design: Design, axes: Sequence[FloatArray], pool: Pool) -> tuple[float, float]:
    """Bytes that a volume takes on the disk, and that its blocks in flight take in memory, workers included."""
    largest = max(stop - start for start, stop in _blocks(design.array.conductors(), axes))
    return _BYTES_ON_DISK * math.prod(map(len, axes)), _BYTES_A_POINT * largest * (pool.capacity + 1)


def _blocks(conductors: Sequence[Conductor], axes: Sequence[FloatArray]) -> list[tuple[int, int]]:
    """Flat indices of the blocks; they depend on the grid and the paths alone."""
    segments = sum(len(conductor.lengths) for conductor in conductors)
    size = _ALIGNED * max(1, min(_MOST_POINTS, int(_MOST_PAIRS / segments)) // _ALIGNED)
    return ranges(math.prod(map(len, axes)), size)


def field_block(block: FieldBlock) -> FloatArray:
    """B in phase and in quadrature at the points of a block, shape (2, points, 3) in T; this is what workers run."""
    where = np.unravel_index(np.arange(block.start, block.stop), [len(axis) for axis in block.axes])
    points = np.column_stack([axis[index] for axis, index in zip(block.axes, where, strict=True)])
    parts = (block.currents.real, block.currents.imag)
    return np.stack([magnetic_field(block.conductors, points, part) for part in parts])


def _axis(values: npt.ArrayLike) -> FloatArray:
    return np.atleast_1d(np.asarray(values, dtype=np.float64))
