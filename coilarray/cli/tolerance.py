"""``coilarray tolerance``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.cli.maps import kept_table
from coilarray.errors import GoalError

if TYPE_CHECKING:
    import xarray as xr


_ERRORS_OFF = 3.0  # standard errors
_NAMED = 6  # outputs in a line


def tolerance(
    design: shared.DesignArgument = None,
    tolerances: Annotated[
        Path | None,
        typer.Argument(metavar="TOLERANCE", help="Tolerance file (TOML); typical values of board houses by default."),
    ] = None,
    quantity: shared.Quantities = None,
    samples: Annotated[int, typer.Option(help="Number of boards to draw, 0 or at least 8; best a power of 2.")] = 64,
    seed: Annotated[int, typer.Option(help="Seed of the drawn boards.")] = 0,
    accuracy: shared.Accuracy = "screen",
    workers: shared.Workers = None,
    cluster: shared.Cluster = None,
    cache: shared.Cache = None,
    out: Annotated[
        Path | None,
        shared.out_option("Also write every number: .nc, .json, or the spread as .csv.", ".nc", ".json", ".csv"),
    ] = None,
    plot: Annotated[Path | None, shared.plot_option("shares and histograms")] = None,
    template: Annotated[
        Path | None,
        shared.file_option(
            ("--template",), "Write the typical values to a tolerance file to edit (.toml), and exit.", (".toml",)
        ),
    ] = None,
    force: shared.Force = False,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Predict how much fabricated boards differ, and why.

    Quantities are L and k of all coils by default, of more than 7 coils k of neighbours only.
    Etching, registration, thicknesses, placement, permeability and tank capacitor have
    distributions, with one share common to a board and one for each layer. The spread is
    linearised, checked on randomly drawn boards, and split by cause. Limits in the tolerance file
    give a yield. With [positions] in that file (x_mm, y_mm, depth_mm, noise) the analysis includes
    δ, and the error of a position found with the response table of the nominal board.

    Example: coilarray tolerance gast2020 --samples 128 --out spread.csv --plot spread.png

    Example: coilarray tolerance gast2020 --template fab.toml

    Example: coilarray tolerance gast2020 fab.toml
    """
    shared.check_workers(workers, cluster)
    from contextlib import ExitStack

    from coilarray.compute.files import write_text
    from coilarray.compute.store import open_store
    from coilarray.report.tables import given_table, sample_table, spread_table, yield_table
    from coilarray.studies.tolerance import analyse, check_analysis, load_tolerances, typical_text

    if template is not None:
        shared.require_new(template, force=force)
        write_text(template, typical_text())
        typer.echo(f"wrote {template}")
        return
    opened = shared.open_design(design, allow_violations=allow_violations)
    read = load_tolerances(tolerances)
    if read.positions is not None and opened.indentation is None:
        raise GoalError(f"positions need [indenter] and [indentation], which the design {opened.name} does not have.")
    settings: dict[str, Any] = {"quantities": quantity or (), "samples": samples, "seed": seed, "accuracy": accuracy}
    check_analysis(opened, read, **settings)
    kept = open_store(cache)
    with (
        shared.resumable(lambda done: f"{done} boards are kept in {kept.folder}") as counting,
        shared.chosen_workers(workers, cluster) as used,
        ExitStack() as bars,
    ):
        # long, so that it comes after all that may be refused; its bar ends before that of the
        # boards begins
        known = None if read.positions is None else kept_table(opened)
        show = counting(bars.enter_context(shared.progress_bar("boards")))
        result = analyse(opened, read, **settings, table=known, workers=used, cache=kept, progress=show)
    if out is not None and out.suffix.lower() == ".json":
        samples_of = {"samples": sample_table(result).records()} if "value" in result else {}
        write_text(out, json.dumps({**_numbers(result), **samples_of}, indent=1, allow_nan=False) + "\n")
    else:
        shared.write_numbers(out, result, spread_table(result).csv)
    shared.draw(plot, lambda: viz.tolerance_figure(result))
    tables = (given_table(result), spread_table(result), yield_table(result))
    shown = [one.without_empty_columns() for one in tables if one.rows]
    asked = [*(quantity or read.quantities), *(() if read.positions is None else ("q",))]
    lines = [*shared.missing_capacitance(opened, asked), *_remarks(result)]
    shared.print_result(_numbers(result), as_json=as_json, tables=shown, lines=lines, files=(out, plot))


def _numbers(result: xr.Dataset) -> dict[str, Any]:
    """Everything except the drawn boards, for JSON."""
    from coilarray.report.tables import error_table, share_table, spread_table, yield_table

    tables = (error_table(result), spread_table(result), share_table(result), yield_table(result))
    return {**result.attrs, **{one.name: one.records() for one in tables}}


def _remarks(result: xr.Dataset) -> list[str]:
    """Sentences below the tables."""
    import numpy as np

    boards, drawn = int(result.attrs["boards"]), int(result.sizes.get("sample", 0))
    lines = [
        f"{boards} boards computed: the nominal one, {boards - drawn - 1} with one error each, {drawn} drawn; "
        "the shares of board and layer add up"
    ]
    off = np.abs(result.ratio - 1) > _ERRORS_OFF * result.ratio_error if "ratio" in result else None
    bent = [] if off is None else [str(name) for name in result.output.values[off.values]]
    if bent:
        more = f" and {len(bent) - _NAMED} more" if len(bent) > _NAMED else ""
        lines.append(
            f"not linear over these errors, so that only the drawn boards are valid: {', '.join(bent[:_NAMED])}{more}"
        )
    if "failure" in result:
        failures = [reason for reason in result.failure.values.tolist() if reason]
        if failures:
            lines.append(f"{len(failures)} of {result.sizes['sample']} drawn boards failed; the first: {failures[0]}")
    if "linear_yield" in result:
        lines.append("drawn boards that cannot be made count as bad; the linear yield ignores them")
    if "sample_yield" in result:
        lines.append("the interval of the yield is for independent boards, and approximate for Sobol points")
    if "not_read" in result.attrs:
        bad = "; they count as bad in the yield of what it reads" if "sample_yield" in result else ""
        lines.append(f"an LDC1614 cannot read all of it on {result.attrs['not_read']} (unread in the file){bad}")
    if result.attrs.get("undetermined"):
        lines.append(f"taken as known, as a reading has almost no information about it: {result.attrs['undetermined']}")
    if "found" in result.attrs and "value" in result:
        lines.append(
            f"found without doubt in {result.attrs['found']}; the others are at the border of the map or do "
            "not fit within the noise"
        )
    return lines
