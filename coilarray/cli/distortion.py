"""``coilarray distortion``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from coilarray import viz
from coilarray.cli import shared

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.localize.calibration import Calibration
    from coilarray.report.tables import Table

Base = Literal["bonded", "frictionless"]
_BASES: tuple[Base, ...] = ("bonded", "frictionless")


def distortion(
    design: shared.DesignArgument = None,
    coil: Annotated[
        list[str] | None, typer.Option(help="Coil to look at; may be repeated. coil1 to coil3 by default.")
    ] = None,
    calibrated: Annotated[
        bool,
        typer.Option("--calibrate", help="Also fit what the paper leaves open to its A, B and peaks, never to x0."),
    ] = False,
    base: Annotated[
        Base | None,
        typer.Option(help="How the lowest sheet lies on the board; the design's by default, both calibrated."),
    ] = None,
    out: Annotated[Path | None, shared.out_option("Also write every number: .nc or .csv.", ".nc", ".csv")] = None,
    plot: Annotated[Path | None, shared.plot_option("x0 and its causes over δ")] = None,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Predict how the ellipses' centre x0 moves with δ, and what moves it.

    The map of the design goes through the paper's own processing; each cause is then switched off. Nothing is fitted
    to x0. What remains between the prediction and Table A1 is printed. It takes minutes, with --calibrate many.

    Example: coilarray distortion gast2020 --out distortion.nc --plot distortion.png
    """
    from coilarray.localize.calibration import apply, calibrate
    from coilarray.localize.distortion import distortion as split
    from coilarray.report import localize_tables

    opened = shared.open_design(design, allow_violations=allow_violations)
    states = coil or ["coil1", "coil2", "coil3"]
    if base is not None:
        opened, _ = apply(opened, {}, base)
    with shared.progress_bar("maps of the causes") as progress:
        result = split(opened, states, progress=progress)
    found: dict[str, Calibration] = {}
    if calibrated:
        for one in _BASES if base is None else (base,):
            with shared.progress_bar(f"calibration, {one}") as progress:
                found[one] = calibrate(opened, states, base=one, progress=progress)
        result = _with_predictions(result, found)
    shared.write_numbers(out, result, localize_tables.distortion_table(result).csv)
    shared.draw(plot, lambda: viz.distortion_figure(result))
    remaining = localize_tables.residual_table(result)
    tables = [localize_tables.cause_table(result), remaining]
    if found:
        fitted = {name: one.result for name, one in found.items()}
        tables += [localize_tables.calibration_table(fitted), localize_tables.misfit_table(fitted)]
        tables += [localize_tables.correlation_table(name, one) for name, one in fitted.items()]
    data = {**shared.design_record(opened), **{table.name: table.records() for table in tables}}
    shared.print_result(data, as_json=as_json, tables=tables, lines=[_verdict(remaining)], files=(out, plot))


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


def _verdict(remaining: Table) -> str:
    """One line about what remains."""
    parts = []
    for row in remaining.records():
        published, remains = row["published_rms_m"], row["residual_rms_m"]
        if isinstance(published, float) and isinstance(remains, float):
            parts.append(f"{row['coil']} {row['prediction']} {remains * 1e3:.2f} of {published * 1e3:.2f} mm")
    if not parts:
        return "No coil is in Table A1: there is nothing to compare with."
    return "Not explained of the published x0 − centre, rms: " + "; ".join(parts) + "."
