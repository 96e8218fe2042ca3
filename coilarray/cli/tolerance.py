"""``coilarray tolerance``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.cli.maps import depth_in_metres, kept_table
from coilarray.errors import GoalError

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.design.model import Design
    from coilarray.studies.tolerance import Positions

_LARGEST_STEP_CHANGE = 0.05  # of a standard deviation
_ERRORS_OFF = 3.0  # standard errors
_NAMED = 6  # outputs in a line


def tolerance(
    design: shared.DesignArgument = None,
    tolerances: Annotated[
        Path | None,
        typer.Argument(metavar="TOLERANCE", help="Tolerance file (TOML); typical values of board houses by default."),
    ] = None,
    quantity: Annotated[
        list[str] | None,
        typer.Option(
            "--quantity",
            "-q",
            help='Quantity to compute, such as worst_k or "k[coil1,coil2]"; may be repeated. L and k of all coils by '
            "default, of more than 7 coils k of neighbours only.",
        ),
    ] = None,
    x_mm: Annotated[
        str | None, typer.Option(help="Positions of the indenter along x, such as 0,5 or START:STOP:COUNT.")
    ] = None,
    y_mm: Annotated[str | None, typer.Option(help="Positions of the indenter along y; 0 by default.")] = None,
    depth_mm: Annotated[
        float | None, typer.Option(help="Depth of the indentation; the design's first depth by default.")
    ] = None,
    noise: Annotated[float | None, shared.noise_option("Standard deviation of δ in a reading.")] = None,
    table: shared.TableFile = None,
    samples: Annotated[int, typer.Option(help="Number of boards to draw, 0 or at least 8; best a power of 2.")] = 64,
    seed: Annotated[int, typer.Option(help="Seed of the drawn boards.")] = 0,
    sampling: Annotated[
        Literal["sobol", "random"], typer.Option(help="Draw evenly spread errors (Sobol points), or independent ones.")
    ] = "sobol",
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

    Etching, registration, thicknesses, placement, permeability and tank capacitor have distributions, with one share
    common to a board and one for each layer. The spread is linearised, checked on randomly drawn boards, and split by
    cause; limits in the tolerance file give a yield. With --x-mm the analysis includes δ, and the error of a position
    found with the response table of the nominal board.

    Example: coilarray tolerance gast2020 --samples 128 --out spread.csv --plot spread.png

    Example: coilarray tolerance gast2020 fab.toml --x-mm 0,5 --y-mm 4 --table table.nc
    """
    shared.check_workers(workers, cluster)
    from contextlib import ExitStack
    from dataclasses import replace

    from coilarray.compute.files import write_text
    from coilarray.compute.store import open_store
    from coilarray.report.tolerance_tables import given_table, sample_table, spread_table, yield_table
    from coilarray.studies.tolerance import analyse, check_analysis, load_tolerances, typical_text

    if template is not None:
        write_text(template, typical_text())
        typer.echo(f"wrote {template}")
        return
    opened = shared.open_design(design, allow_violations=allow_violations)
    read = load_tolerances(tolerances)
    positions = _positions(opened, read.positions, x_mm, y_mm, depth_mm, noise)
    if positions is None and table is not None:
        raise GoalError("--table is for positions; it needs --x-mm, or [positions] in the file.")
    wanted = replace(read, positions=positions)
    settings: dict[str, Any] = {"quantities": quantity or (), "samples": samples, "seed": seed}
    settings |= {"sampling": sampling, "accuracy": accuracy}
    check_analysis(opened, wanted, **settings, with_table=table is not None and table.exists())
    kept = open_store(cache)
    with (
        shared.resumable(lambda done: f"{done} boards are kept in {kept.folder}") as counting,
        shared.chosen_workers(workers, cluster) as used,
        ExitStack() as bars,
    ):
        # long, so that it comes after all that may be refused; its bar ends before that of the boards begins
        known = None if positions is None else kept_table(opened, table)
        show = counting(bars.enter_context(shared.progress_bar("boards")))
        result = analyse(opened, wanted, **settings, table=known, workers=used, cache=kept, progress=show)
    if out is not None and out.suffix.lower() == ".json":
        samples_of = {"samples": sample_table(result).records()} if "value" in result else {}
        write_text(out, json.dumps({**_numbers(result), **samples_of}, indent=1, allow_nan=False) + "\n")
    else:
        shared.write_numbers(out, result, spread_table(result).csv)
    shared.draw(plot, lambda: viz.tolerance_figure(result))
    tables = (given_table(result), spread_table(result), yield_table(result))
    shown = [one.without_empty_columns() for one in tables if one.rows]
    asked = [*(quantity or wanted.quantities), *(() if positions is None else ("q",))]
    lines = [*shared.missing_capacitance(opened, asked), *_remarks(result)]
    shared.print_result(_numbers(result), as_json=as_json, tables=shown, titles=True, lines=lines, files=(out, plot))


def _positions(
    design: Design, given: Positions | None, x_mm: str | None, y_mm: str | None, depth_mm: float | None,
    noise: float | None,
) -> Positions | None:  # fmt: skip
    """Positions from the options, which override those of the file."""
    from coilarray.studies.tolerance import Positions

    if x_mm is None and given is None:
        for option, value in (("--y-mm", y_mm), ("--depth-mm", depth_mm), ("--noise", noise)):
            if value is not None:
                raise GoalError(f"{option} needs --x-mm, or [positions] in the file.")
        return None
    if design.indentation is None:
        raise GoalError(f"positions need [indenter] and [indentation], which the design {design.name} does not have.")
    depth = depth_in_metres(depth_mm)
    base = given or Positions((), (0.0,), design.indentation.depths[0])
    return Positions(
        tuple(shared.lengths("--x-mm", x_mm) or base.x),
        tuple(shared.lengths("--y-mm", y_mm) or base.y),
        base.depth if depth is None else depth,
        base.noise if noise is None else noise,
    )


def _numbers(result: xr.Dataset) -> dict[str, Any]:
    """Everything except the drawn boards, for JSON."""
    from coilarray.report.tolerance_tables import error_table, share_table, spread_table, yield_table

    tables = (error_table(result), spread_table(result), share_table(result), yield_table(result))
    return {**result.attrs, **{one.name: one.records() for one in tables}}


def _remarks(result: xr.Dataset) -> list[str]:
    """Sentences below the tables."""
    boards, drawn = int(result.attrs["boards"]), int(result.sizes.get("sample", 0))
    lines = [
        f"{boards} boards computed: the nominal one, {boards - drawn - 1} with one error each, {drawn} drawn; "
        "the shares of board and layer add up"
    ]
    bent = _not_linear(result)
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


def _not_linear(result: xr.Dataset) -> list[str]:
    """Name the outputs whose linearised spread disagrees with half the step or with the drawn boards."""
    import numpy as np

    bent = result.step_change.values > _LARGEST_STEP_CHANGE
    if "ratio" in result:
        off = np.abs(result.ratio.values - 1)
        bent |= np.nan_to_num(off) > _ERRORS_OFF * np.nan_to_num(result.ratio_error.values)
    return [str(name) for name in result.output.values[bent]]
