"""``coilarray distortion``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from coilarray.cli.shared import (
    PICTURES,
    AllowViolations,
    AsJson,
    DesignArgument,
    check_file,
    open_design,
    print_json,
    print_table,
    progress_bar,
)

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.design.model import Design
    from coilarray.localize.calibration import Calibration

Base = Literal["bonded", "frictionless"]
_BASES: tuple[Base, ...] = ("bonded", "frictionless")


def distortion(
    design: DesignArgument = None,
    coil: Annotated[
        list[str] | None, typer.Option("--coil", help="Coil to look at; may be repeated. coil1 to coil3 by default.")
    ] = None,
    calibrate: Annotated[
        bool,
        typer.Option("--calibrate", help="Also fit what the paper leaves open to its A, B and peaks, never to x0."),
    ] = False,
    base: Annotated[
        Base | None,
        typer.Option(
            "--base", help="How the lowest sheet lies on the board; the design's by default, both calibrated."
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Also write every number: .nc or .csv.")] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", help="Also draw x0 and its causes over δ: .png, .svg or .pdf.")
    ] = None,
    as_json: AsJson = False,
    allow_violations: AllowViolations = False,
) -> None:
    """Predict how the ellipses' centre x0 moves with δ, and what moves it.

    The map of the design goes through the paper's own processing; each cause is then switched off. Nothing is fitted
    to x0. What remains between the prediction and Table A1 is printed. It takes minutes, with --calibrate many.

    Example: coilarray distortion gast2020 --out distortion.nc --plot distortion.png
    """
    check_file("--out", out, (".nc", ".csv"))
    check_file("--plot", plot, PICTURES)
    from coilarray.compute.files import write_atomically, write_text
    from coilarray.compute.netcdf import save_dataset
    from coilarray.localize.calibration import apply
    from coilarray.localize.distortion import distortion as split
    from coilarray.report.localize_tables import (
        calibration_table,
        cause_table,
        correlation_table,
        distortion_table,
        misfit_table,
        residual_table,
    )

    opened = open_design(design, allow_violations=allow_violations)
    states = coil or ["coil1", "coil2", "coil3"]
    bases = (base,) if base is not None else _BASES
    if base is not None:
        opened, _ = apply(opened, {}, base)
    with progress_bar("maps of the causes") as progress:
        result = split(opened, states, progress=progress)
    found: dict[str, Calibration] = {}
    if calibrate:
        for one in bases:
            found[one] = _calibrated(opened, states, one)
        result = _with_predictions(result, found)
    if out is not None and out.suffix.lower() == ".nc":
        save_dataset(result, out)
    elif out is not None:
        write_text(out, distortion_table(result).csv())
    if plot is not None:
        from coilarray.viz import distortion_figure

        write_atomically(plot, distortion_figure(result).savefig)
    fitted = {name: one.result for name, one in found.items()}
    tables = [cause_table(result), residual_table(result)]
    if fitted:
        tables += [calibration_table(fitted), misfit_table(fitted)]
        tables += [correlation_table(name, one) for name, one in fitted.items()]
    if as_json:
        named = {table.name: table.records() for table in tables}
        print_json({"design": opened.name, "design_hash": opened.digest, **named})
        return
    for table in tables:
        print_table([column.header for column in table.columns], table.cells())
        typer.echo()
    typer.echo(_verdict(result))
    for path in (out, plot):
        if path is not None:
            typer.echo(f"wrote {path}")


def _calibrated(design: Design, states: list[str], base: Base) -> Calibration:
    from coilarray.localize.calibration import calibrate

    with progress_bar(f"calibration, {base}") as progress:
        return calibrate(design, states, base=base, progress=progress)


def _with_predictions(result: xr.Dataset, found: dict[str, Calibration]) -> xr.Dataset:
    """Add x0 as predicted by every calibrated design."""
    import numpy as np

    from coilarray.localize.distortion import ellipse_curves
    from coilarray.response.map import response_map
    from coilarray.response.setup import indentation_of

    rows = []
    for one in found.values():
        depths = indentation_of(one.design).depths[:1]
        response = response_map(one.design, depths=depths, imperfections=one.imperfections)
        rows.append(ellipse_curves(response, result.state.values.tolist(), result.delta.values).x0)
    described = {"units": "m", "long_name": "x0 predicted with the calibrated values"}
    return result.assign_coords(calibration=list(found)).assign(
        calibrated_x0=(("calibration", "state", "delta"), np.array(rows), described)
    )


def _verdict(result: xr.Dataset) -> str:
    """One line about what remains."""
    from coilarray.report.localize_tables import residual_table

    parts = []
    for row in residual_table(result).records():
        published, remains = row["published_rms_m"], row["residual_rms_m"]
        if isinstance(published, float) and isinstance(remains, float):
            parts.append(f"{row['coil']} {row['prediction']} {remains * 1e3:.2f} of {published * 1e3:.2f} mm")
    if not parts:
        return "No coil is in Table A1: there is nothing to compare with."
    return "Not explained of the published x0 − centre, rms: " + "; ".join(parts) + "."
