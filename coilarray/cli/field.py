"""``coilarray field``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray.cli import shared
from coilarray.errors import GeometryError
from coilarray.viz.offscreen import require_pyvista

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.compute.arrays import FloatArray
    from coilarray.design.model import Design

    Axes = tuple[FloatArray, FloatArray, FloatArray]

_LARGEST_MA = 1e9
_SPACING = shared.number_option(("--spacing-mm",), shared.SMALLEST_MM, shared.LONGEST_MM, "Distance of the points.")
_MOST_POINTS = 20_000_000  # 24 bytes a point and array; more needs more memory than a desk computer has to spare


def field(
    design: shared.DesignArgument = None,
    coil: Annotated[str | None, typer.Option(help="Coil that is measured; the middle one by default.")] = None,
    z_mm: Annotated[
        str | None, typer.Option(help="Height above the board, or FROM:TO for a volume; the design's plane by default.")
    ] = None,
    spacing_mm: Annotated[float, _SPACING] = 0.5,
    current_mA: Annotated[float, typer.Option("--current-mA", help="Current in that coil.")] = 1.0,
    others_open: shared.OthersOpen = False,
    distance_mm: Annotated[
        float | None,
        shared.number_option(
            ("--distance-mm",), shared.SMALLEST_MM, shared.LONGEST_MM, "Distance of an infinite target; without it."
        ),
    ] = None,
    out: shared.FieldFile = Path("field.nc"),
    force: shared.Force = False,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Write the magnetic field over the board.

    Computes B on a plane or in a volume while one coil is measured, in free space or beside the design's infinite
    plates, and writes it as netCDF or VTK. Of a target it is only with --distance-mm. Magnetic sheets change only the
    currents. Traces are taken as thin wires along their middle lines, so that B is not that of the trace nearer to it
    than its width.

    Example: coilarray field gast2020 --coil coil3 --z-mm 1:9 --out field.vtr
    """
    if not abs(current_mA) <= _LARGEST_MA:
        raise GeometryError(f"--current-mA must be at most {_LARGEST_MA:g}; got {current_mA:g}.")
    heights = None if z_mm is None else _heights(z_mm)
    if out is not None and out.suffix.lower() == ".vtr":
        require_pyvista("files for ParaView")
    from coilarray.circuit.coupling import couple_design

    opened = shared.open_design(design, allow_violations=allow_violations)
    names = opened.array.names
    active = opened.array.middle_coil if coil is None else coil
    if active not in names:
        raise GeometryError(f"--coil must be one of {', '.join(names)}; got {active}.")
    axes = _axes(opened, heights, spacing_mm)
    if distance_mm is not None:
        from coilarray.response.target import with_target_as_plate

        opened = with_target_as_plate(opened, (0.0, 0.0), distance_mm * 1e-3)
    coupling = couple_design(opened)
    peak = _write(opened, coupling, active, axes, out, current=current_mA * 1e-3, terminated=not others_open)
    shape = [len(axis) for axis in axes]
    data = {
        **shared.design_record(opened), "file": out and str(out), "coil": active,
        "others": "open" if others_open else "as terminated", "current_A": current_mA * 1e-3,
        "target_distance_m": distance_mm and distance_mm * 1e-3, "shape": shape, "peak_Bz_T": peak,
    }  # fmt: skip
    points = " × ".join(map(str, shape))
    without = "" if opened.target is None else ", without the target"
    line = f"wrote {out}: {points} points, {active} active{without}, largest |B_z| {peak * 1e6:.4g} µT"
    shared.print_result(data, as_json=as_json, lines=[line])


def _axes(design: Design, heights: tuple[float, float] | None, spacing_mm: float) -> Axes:
    """x, y and z of the grid in m."""
    import numpy as np

    x_min, y_min, x_max, y_max = design.array.bounds
    low, high = (design.field_height, design.field_height) if heights is None else heights
    ranges = ((x_min, x_max), (y_min, y_max), (low, high))
    # at most a step apart
    counts = [math.ceil((end - start) / (spacing_mm * 1e-3) * (1 - 1e-12)) + 1 for start, end in ranges]
    count = math.prod(counts)
    if count > _MOST_POINTS:
        raise GeometryError(f"--spacing-mm {spacing_mm:g} gives {count} points; at most {_MOST_POINTS} are allowed.")
    x, y, z = (np.linspace(start, end, n) for (start, end), n in zip(ranges, counts, strict=True))
    return x, y, z


def _write(design: Design, coupling: xr.Dataset, active: str, axes: Axes, out: Path | None, **setting: Any) -> float:
    """Compute the field in memory for a current in A, write it where a file is given; return the largest |B_z| in T."""
    from coilarray.circuit.operating_field import operating_field
    from coilarray.compute.files import write_text
    from coilarray.compute.netcdf import save_dataset
    from coilarray.viz import field_grid
    from coilarray.viz.datasets.meshes import vtk_text

    with shared.progress_bar(f"field at {math.prod(map(len, axes))} points") as progress:
        result = operating_field(design, coupling, active, *axes, **setting, progress=progress)
    if out is not None and out.suffix.lower() == ".nc":
        save_dataset(result, out)
    elif out is not None:
        grid = field_grid(result.x.values, result.y.values, result.z.values, result.B.values)
        write_text(out, vtk_text(grid))
    return float(abs(result.B.sel(component="z")).max())


def _heights(text: str) -> tuple[float, float]:
    parts = text.split(":")
    try:
        values = [float(part) * 1e-3 for part in parts]
    except ValueError:
        values = []
    far = not all(abs(value) <= shared.LONGEST_MM * 1e-3 for value in values)
    if len(values) not in (1, 2) or far or values != sorted(values):
        raise GeometryError(
            f"--z-mm must be a number or FROM:TO with FROM below TO, at most {shared.LONGEST_MM:g}; got {text!r}."
        )
    return values[0], values[-1]
