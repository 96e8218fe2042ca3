"""``coilarray distortion``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from coilarray import viz
from coilarray.cli import shared

if TYPE_CHECKING:
    from coilarray.compute.table import Table


def distortion(
    design: shared.DesignArgument = None,
    coil: Annotated[
        list[str] | None, typer.Option(help="Coil to evaluate; may be repeated. coil1 to coil3 by default.")
    ] = None,
    posterior: Annotated[
        Path | None,
        typer.Option(
            help="Result of `coilarray calibrate` (calibration.nc), from which the uncertainty of x0 is found."
        ),
    ] = None,
    draws: Annotated[
        int, typer.Option(min=2, help="Number of designs drawn from the posterior of that calibration.")
    ] = 16,
    out: Annotated[Path | None, shared.out_option("Also write every number: .nc or .csv.", ".nc", ".csv")] = None,
    plot: Annotated[Path | None, shared.plot_option("x0 and its causes over δ")] = None,
    force: shared.Force = False,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Predict how the ellipses' centre x0 moves with δ, and why.

    The map of the design is evaluated as in the paper; then each cause is switched off in turn. Nothing is fitted to
    x0. The difference between prediction and Table A1 is printed, without the levels of δ at which too little of the
    ellipse is inside the window. It takes about a minute.

    Example: coilarray distortion gast2020 --out distortion.nc --plot distortion.png
    """
    from coilarray.paper.distortion import distortion as split
    from coilarray.report import localize_tables

    file = shared.open_design_file(design, allow_violations=allow_violations)
    opened = file.design
    states = coil or ["coil1", "coil2", "coil3"]
    drawn, imperfections = [], None
    if posterior is not None:
        from coilarray.compute.netcdf import read_checked
        from coilarray.studies.calibrate.calibration import CALIBRATION, calibrated_imperfections, posterior_draws

        calibration = read_checked(posterior, CALIBRATION)
        drawn, imperfections = posterior_draws(file, calibration, draws), calibrated_imperfections(calibration)
    with shared.progress_bar("maps of the causes") as progress:
        result = split(opened, states, imperfections=imperfections, draws=drawn, progress=progress)
    shared.write_numbers(out, result, localize_tables.distortion_table(result).csv)
    shared.draw(plot, lambda: viz.distortion_figure(result))
    remaining = localize_tables.residual_table(result)
    made = (localize_tables.cause_table(result), localize_tables.indenter_table(result), remaining)
    tables = [table for table in made if table.rows]
    data = {**shared.design_record(opened), **{table.name: table.records() for table in tables}}
    shared.print_result(data, as_json=as_json, tables=tables, lines=[_verdict(remaining)], files=(out, plot))


def _verdict(remaining: Table) -> str:
    """One line about what remains."""
    parts = []
    for row in remaining.records():
        published, remains = row["published_rms_m"], row["residual_rms_m"]
        if isinstance(published, float) and isinstance(remains, float):
            parts.append(f"{row['coil']} {remains * 1e3:.2f} of {published * 1e3:.2f} mm")
    if not parts:
        return "No coil is in Table A1: there is nothing to compare with."
    hidden = sum(int(row["undetermined"]) for row in remaining.records())
    left_out = f" Levels of δ left out as undetermined: {hidden}." if hidden else ""
    return "Difference from the published x0 − centre, rms: " + "; ".join(parts) + "." + left_out
