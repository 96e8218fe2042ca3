"""``coilarray field``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from coilarray.cli.shared import AllowViolations, AsJson, DesignArgument, open_design, print_json, progress_bar
from coilarray.errors import GeometryError, OutputError

if TYPE_CHECKING:
    import xarray as xr

_SUFFIXES = (".nc", ".vtr")
_FARTHEST_MM = 100_000.0
_LARGEST_MA = 1e9
_MOST_POINTS = 20_000_000  # 24 bytes a point and array; more needs more memory than a desk computer has to spare


def field(
    design: DesignArgument = None,
    coil: Annotated[str | None, typer.Option(help="Coil that carries the current; the middle one by default.")] = None,
    z_mm: Annotated[
        str | None,
        typer.Option("--z-mm", help="Height above the board, or FROM:TO for a volume; the design's plane by default."),
    ] = None,
    spacing_mm: Annotated[float, typer.Option("--spacing-mm", help="Distance of the points.")] = 0.5,
    current_mA: Annotated[float, typer.Option("--current-mA", help="Current in the coil.")] = 1.0,
    others_open: Annotated[bool, typer.Option("--others-open", help="All other coils open.")] = False,
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write: .nc (netCDF) or .vtr (ParaView).")] = Path(
        "field.nc"
    ),
    as_json: AsJson = False,
    allow_violations: AllowViolations = False,
) -> None:
    """Write the field over the board.

    B on a plane or in a volume while one coil is measured, as netCDF or VTK, in free space. Traces count as thin wires
    on their middle lines, so points nearer to the copper than a trace is wide show the wire's field, not the trace's.

    Example: coilarray field gast2020 --coil coil3 --z-mm 1:9 --out field.vtr
    """
    if out.suffix.lower() not in _SUFFIXES:
        raise OutputError(f"--out must end in {' or '.join(_SUFFIXES)}; got {out}.")
    if not 1e-6 <= spacing_mm <= _FARTHEST_MM:
        raise GeometryError(f"--spacing-mm must be 1e-06 to {_FARTHEST_MM:g}; got {spacing_mm:g}.")
    if not abs(current_mA) <= _LARGEST_MA:
        raise GeometryError(f"--current-mA must be at most {_LARGEST_MA:g}; got {current_mA:g}.")
    heights = None if z_mm is None else _heights(z_mm)
    from coilarray.coupling import couple_design
    from coilarray.near_field import operating_field

    opened = open_design(design, allow_violations=allow_violations)
    names = opened.array.names
    active = names[(len(names) - 1) // 2] if coil is None else coil
    if active not in names:
        raise GeometryError(f"--coil must be one of {', '.join(names)}; got {active}.")
    x_min, y_min, x_max, y_max = opened.array.bounds
    step = spacing_mm * 1e-3
    low, high = (opened.field_height, opened.field_height) if heights is None else heights
    ranges = ((x_min, x_max), (y_min, y_max), (low, high))
    count = math.prod(_points(start, end, step) for start, end in ranges)
    if count > _MOST_POINTS:
        raise GeometryError(
            f"--spacing-mm {spacing_mm:g} gives {count} points; at most {_MOST_POINTS} are allowed: widen the spacing."
        )
    import numpy as np

    axes = tuple(np.linspace(start, end, _points(start, end, step)) for start, end in ranges)
    coupling = couple_design(opened)
    with progress_bar(f"field at {count} points") as progress:
        result = operating_field(
            opened,
            coupling,
            active,
            axes[0],
            axes[1],
            axes[2],
            current=current_mA * 1e-3,
            terminated=not others_open,
            progress=progress,
        )
    _save(result, out)
    peak = abs(result.B.sel(component="z")).max().item()
    if as_json:
        print_json(
            {
                "file": str(out), "design": opened.name, "design_hash": opened.digest, "coil": active,
                "others": "open" if others_open else "as terminated", "current_A": current_mA * 1e-3,
                "shape": [len(axis) for axis in axes], "peak_Bz_T": peak,
            }
        )  # fmt: skip
    else:
        shape = " × ".join(str(len(axis)) for axis in axes)
        typer.echo(f"wrote {out}: {shape} points, {active} active, largest |B_z| {peak * 1e6:.4g} µT")


def _heights(text: str) -> tuple[float, float]:
    parts = text.split(":")
    try:
        values = [float(part) * 1e-3 for part in parts]
    except ValueError:
        values = []
    if (
        len(values) not in (1, 2)
        or not all(abs(value) <= _FARTHEST_MM * 1e-3 for value in values)
        or values != sorted(values)
    ):
        raise GeometryError(
            f"--z-mm must be a number or FROM:TO with FROM below TO, at most {_FARTHEST_MM:g}; got {text!r}."
        )
    return values[0], values[-1]


def _points(low: float, high: float, step: float) -> int:
    """Count the points from low to high that are at most a step apart."""
    return math.ceil((high - low) / step * (1 - 1e-12)) + 1


def _save(result: xr.Dataset, path: Path) -> None:
    if path.suffix.lower() == ".nc":
        from coilarray.storage import save_dataset

        save_dataset(result, path)
        return
    from coilarray.files import write_atomically
    from coilarray.viz import field_grid

    grid = field_grid(result.x.values, result.y.values, result.z.values, result.B.values)
    write_atomically(path, grid.save)
