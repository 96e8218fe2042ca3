"""``coilarray fit``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.cli.maps import depth_in_metres, one_map


def fit(
    source: Annotated[
        str | None,
        typer.Argument(
            metavar="MAP|DESIGN",
            help="Response as netCDF (.nc), measured or of `coilarray response`, or a design; gast2020 by default.",
        ),
    ] = None,
    depth_mm: Annotated[float | None, typer.Option(help="Depth of the map; the first one by default.")] = None,
    coil: Annotated[
        list[str] | None,
        typer.Option(help="Coil to fit; may be repeated. By default all whose curves close within the map."),
    ] = None,
    out: Annotated[Path | None, shared.out_option("Also write the model: .json.", ".json")] = None,
    plot: Annotated[Path | None, shared.plot_option("A, B and x0 over δ")] = None,
    force: shared.Force = False,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Fit the ellipse model of Gast & Zimmermann (2020).

    Fits ellipses to the curves of equal δ of a response, and polynomials of δ to their A, B and x0. They are printed in
    mm beside those of the paper's Table A1 for coils of the same names, a comparison that makes sense for the paper's
    board only.

    Example: coilarray fit gast2020 --out model.json --plot model.png
    """
    depth = depth_in_metres(depth_mm)
    from coilarray.compute.files import write_text
    from coilarray.paper.ellipse import fit_ellipses
    from coilarray.paper.ellipse_model import ellipse_model, model_to_json
    from coilarray.paper.published import published_model
    from coilarray.report.localize_tables import fit_table, polynomial_table

    response = one_map(source, depth, allow_violations=allow_violations, coils=coil or ())
    fits = fit_ellipses(response, depth, states=coil)
    model = ellipse_model(fits)
    polynomials, steps = polynomial_table(model), fit_table(fits, model)
    if out is not None:
        write_text(out, model_to_json(model, f"coilarray fit {source or 'gast2020'}"))
    shared.draw(plot, lambda: viz.ellipse_parameter_figure(fits, model, published_model()))
    data = {"polynomials": polynomials.records(), "fits": steps.records()}
    shared.print_result(data, as_json=as_json, tables=(polynomials, steps), files=(out, plot))
