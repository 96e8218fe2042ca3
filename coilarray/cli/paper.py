"""``coilarray paper``: evaluations of Gast & Zimmermann (2020)."""

from pathlib import Path
from typing import Annotated

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.compute.files import write_text
from coilarray.errors import LocalizeError


def fit(
    source: Annotated[
        str | None,
        typer.Argument(metavar="MAP|DESIGN", help="Response (.nc), measured or computed, or a design [gast2020]."),
    ] = None,
    depth_mm: Annotated[
        float | None,
        shared.number_option(
            "--depth-mm", 0, shared.LONGEST_MM, "Depth of the map; the first one by default.", above=True
        ),
    ] = None,
    coil: Annotated[
        list[str] | None, typer.Option(help="Coil to fit; may be repeated. By default all with closed curves.")
    ] = None,
    out: Annotated[Path | None, shared.out_option("Also write the model: .json.", ".json")] = None,
    plot: Annotated[Path | None, shared.plot_option("A, B and x0 over δ")] = None,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Fit the ellipse model of Gast & Zimmermann (2020).

    Fits ellipses to the curves of equal δ of a response, and polynomials of δ to their A, B and x0.
    They are printed in mm beside the paper's Table A1 for coils of the same names. The comparison
    makes sense for the paper's board only.

    Example: coilarray paper fit gast2020 --out model.json --plot model.png
    """
    depth = None if depth_mm is None else depth_mm * 1e-3
    from coilarray.paper.ellipse import fit_ellipses
    from coilarray.paper.ellipse_model import ellipse_model, model_to_json, published_model
    from coilarray.report.position import fit_table, polynomial_table
    from coilarray.response.map import response_map
    from coilarray.response.setup import indentation_of

    if shared.is_map(source):
        response = shared.read_map(Path(str(source)))
    else:
        design = shared.open_design(source, allow_violations=allow_violations)
        states = [state.name for state in design.plan]
        for name in coil or ():
            if name not in states:
                raise LocalizeError(f"--coil must be one of {', '.join(states)}; got {name}.")
        depths = indentation_of(design).depths[:1] if depth is None else [depth]
        with shared.progress_bar("response") as progress:
            response = response_map(design, depths=depths, accuracy="auto", progress=progress)
    fits = fit_ellipses(response, depth, states=coil)
    model = ellipse_model(fits)
    tables = (polynomial_table(model), fit_table(fits, model))
    if out is not None:
        write_text(out, model_to_json(model, f"coilarray paper fit {source or 'gast2020'}"))
    shared.draw(plot, lambda: viz.ellipse_parameter_figure(fits, model, published_model()))
    data = {table.name: table.records() for table in tables}
    shared.print_result(data, as_json=as_json, tables=tables, files=(out, plot))


def distortion(
    design: shared.DesignArgument = None,
    coil: Annotated[
        list[str] | None, typer.Option(help="Coil to evaluate; may be repeated. coil1 to coil3 by default.")
    ] = None,
    posterior: Annotated[
        Path | None, typer.Option(help="Result of `coilarray calibrate` (calibration.nc), for the errors of x0.")
    ] = None,
    draws: Annotated[int, typer.Option(min=2, help="Number of designs drawn from that posterior.")] = 16,
    out: Annotated[Path | None, shared.out_option("Also write every number: .nc or .csv.", ".nc", ".csv")] = None,
    plot: Annotated[Path | None, shared.plot_option("x0 and its causes over δ")] = None,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Predict how the ellipses' centre x0 moves with δ.

    The map of the design is evaluated as in the paper, then each cause is switched off in turn.
    Nothing is fitted to x0. The difference between prediction and Table A1 is printed, without the
    levels of δ at which too little of the ellipse is inside the window. It takes about a minute.

    Example: coilarray paper distortion gast2020 --out distortion.nc --plot distortion.png
    """
    from coilarray.paper.distortion import distortion as causes_of
    from coilarray.report import position

    file = shared.open_design_file(design, allow_violations=allow_violations)
    states = coil or ["coil1", "coil2", "coil3"]
    drawn, imperfections = [], None
    if posterior is not None:
        from coilarray.compute.netcdf import read_checked
        from coilarray.studies.calibrate.calibration import CALIBRATION, calibrated_imperfections, posterior_draws

        calibration = read_checked(posterior, CALIBRATION)
        drawn, imperfections = posterior_draws(file, calibration, draws), calibrated_imperfections(calibration)
    with shared.progress_bar("maps of the causes") as progress:
        result = causes_of(file.design, states, imperfections=imperfections, draws=drawn, progress=progress)
    shared.write_numbers(out, result, position.distortion_table(result).csv)
    shared.draw(plot, lambda: viz.distortion_figure(result))
    remaining = position.residual_table(result)
    made = (position.cause_table(result), position.indenter_table(result), remaining)
    tables = [table for table in made if table.rows]
    data = {**shared.design_record(file.design), **{table.name: table.records() for table in tables}}
    compared = []  # with the paper, coil by coil
    for row in remaining.records():
        published, remains = row["published_rms_m"], row["residual_rms_m"]
        if isinstance(published, float) and isinstance(remains, float):
            compared.append(f"{row['coil']} {remains * 1e3:.2f} of {published * 1e3:.2f} mm")
    verdict = "No coil is in Table A1: there is nothing to compare with."
    if compared:
        hidden = sum(int(row["undetermined"]) for row in remaining.records())
        left_out = f" Levels of δ left out as undetermined: {hidden}." if hidden else ""
        verdict = f"Difference from the published x0 − centre, rms: {'; '.join(compared)}.{left_out}"
    shared.print_result(data, as_json=as_json, tables=tables, lines=[verdict], files=(out, plot))
