"""``coilarray report``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from coilarray.cli.shared import AllowViolations, AsJson, DesignArgument, open_design, print_json, progress_bar

if TYPE_CHECKING:
    import xarray as xr
    from rich.table import Table


def report(
    design: DesignArgument = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for report.html and report/.")] = Path(),
    as_json: AsJson = False,
    allow_violations: AllowViolations = False,
) -> None:
    """Write the coupling report of a design: report.html and the folder report (CSV, JSON, netCDF).

    Example: coilarray report gast2020 --out results
    """
    from coilarray.report import write_report

    opened = open_design(design, allow_violations=allow_violations)
    with progress_bar(f"report of {opened.name}") as progress:
        made = write_report(opened, out, progress)
    if made.rendering_problem is not None:
        typer.echo(f"coilarray: note: {made.rendering_problem}", err=True)
    if as_json:
        print_json(made.data)
        return
    from rich.console import Console

    console = Console(soft_wrap=True, highlight=False)
    console.print(f"wrote {made.page} and the data in {made.folder}{_separator()}", markup=False)
    console.print(_summary(opened.array.centres, made.coupling))


def _separator() -> str:
    import os

    return os.sep


def _summary(centres: object, coupling: xr.Dataset) -> Table:
    import numpy as np
    from rich.table import Table

    names = coupling.coil.values.tolist()
    at = np.asarray(centres)
    distance = np.hypot(*(at[:, None] - at[None, :]).transpose(2, 0, 1))
    np.fill_diagonal(distance, np.inf)
    table = Table(show_edge=False, pad_edge=False)
    for header in ("coil", "L (µH)", "L_eff (µH)", "f (MHz)"):
        table.add_column(header, justify="left" if header == "coil" else "right")
    table.add_column("k to the neighbours")
    for a, name in enumerate(names):
        # neighbours: the coils at the least distance, to a twentieth
        near = np.flatnonzero(np.isfinite(distance[a]) & (distance[a] <= 1.05 * distance[a].min()))
        table.add_row(
            name,
            f"{float(coupling.open_inductance[a]) * 1e6:.3f}",
            f"{float(coupling.effective_inductance[a]) * 1e6:.3f}",
            f"{float(coupling.frequency[a]) / 1e6:.4f}",
            ", ".join(f"{names[b]} {float(coupling.coupling[a, b]):+.4f}" for b in near) or "none",
        )
    return table
