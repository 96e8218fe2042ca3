"""``coilarray report``."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from coilarray.cli import shared
from coilarray.report.drawing import drawing_beside

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    import xarray as xr

    from coilarray.compute.table import Table


_COMPILE = "from coilarray.electromagnetics import kernels; kernels.compile_kernels()"
_LAST = "paths._rows_sum-*.nbi"  # of the kernels that every command compiles: the index of its code on disk


@contextmanager
def compiling_beside() -> Iterator[None]:
    """Compile kernels in another process while the block runs.

    Nothing happens on one core, without numba, if the kernels are on disk, or if numba may not
    write beside them.
    """
    kept = Path(os.environ.get("NUMBA_CACHE_DIR") or Path(__file__).parents[1] / "electromagnetics/kernels/__pycache__")
    off = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")
    there = next((folder for folder in (kept, *kept.parents) if os.access(folder, os.F_OK)), kept)
    if off or (os.cpu_count() or 1) < 2 or any(kept.rglob(_LAST)) or not os.access(there, os.W_OK):
        yield
        return
    quiet = subprocess.DEVNULL
    # what goes wrong there goes wrong here too, and is said here
    child = subprocess.Popen([sys.executable, "-P", "-c", _COMPILE], stdin=quiet, stdout=quiet, stderr=quiet)
    try:
        yield
    finally:
        child.kill()
        child.wait()


def report(
    design: shared.DesignArgument = None,
    out: Annotated[Path, shared.file_option(("--out", "-o"), "Folder for report.html and the folder report.")] = Path(),
    distortion: Annotated[
        Path | None, typer.Option(help="Result of `coilarray paper distortion --out` (.nc), to be included.")
    ] = None,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Write the report of a design, with tables and pictures.

    Writes report.html, and the folder report with its numbers as CSV, JSON and netCDF.

    Example: coilarray report gast2020 --out results
    """
    shared.check_folder(out)
    with compiling_beside(), drawing_beside():
        from coilarray.compute.netcdf import read_checked
        from coilarray.paper.distortion import DISTORTION
        from coilarray.report.write import write_report

        opened = shared.open_design_file(design, allow_violations=allow_violations)
        causes = None if distortion is None else read_checked(distortion, DISTORTION)
        with shared.progress_bar(f"report of {opened.design.name}") as progress:
            made = write_report(opened, out, distortion=causes, progress=progress)
    if made.rendering_problem is not None:
        typer.echo(f"coilarray: note: {made.rendering_problem}", err=True)
    if as_json:
        shared.print_json(made.data)
        return
    typer.echo(f"wrote {made.page} and the data in {made.folder}{os.sep}")
    for line in made.verdicts:
        typer.echo(line)
    if made.summary is not None:
        typer.echo(made.summary.text(shared.terminal_width(), title=False))
        if opened.assumed:
            typer.echo(f"{len(opened.assumed)} values of the design are assumed; the page says which, and why.")
        typer.echo("")
    typer.echo(_summary(opened.design.array.centres, made.coupling).text(shared.terminal_width()))


def _summary(centres: npt.NDArray[np.float64], coupling: xr.Dataset) -> Table:
    """Short table of the coils."""
    import numpy as np

    from coilarray.compute.display_units import number_text
    from coilarray.compute.table import text_table

    names = coupling.coil.values.tolist()
    distance = np.hypot(*(centres[:, None] - centres[None, :]).transpose(2, 0, 1))
    np.fill_diagonal(distance, np.inf)
    columns = (
        (coupling.open_inductance, 1e6, 3), (coupling.effective_inductance, 1e6, 3), (coupling.frequency, 1e-6, 4),
        (coupling.ideal_effective_inductance, 1e6, 3),
    )  # fmt: skip
    rows = []
    for a, name in enumerate(names):
        # neighbours: the coils at the least distance, to a twentieth
        near = np.flatnonzero(np.isfinite(distance[a]) & (distance[a] <= 1.05 * distance[a].min()))
        numbers = [f"{float(values[a]) * factor:.{digits}f}" for values, factor, digits in columns]
        neighbours = ", ".join(f"{names[b]} {number_text(float(coupling.coupling[a, b]), 4, '+')}" for b in near)
        rows.append([name, *numbers, neighbours or "none"])
    return text_table(("coil", "L (µH)", "L_eff (µH)", "f (MHz)", "L_eff ideal (µH)", "k to the neighbours"), rows)
