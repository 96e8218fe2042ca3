"""``coilarray tolerance``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from coilarray.cli.maps import PICTURES, check_file, depth_in_metres, kept_table
from coilarray.cli.shared import (
    AllowViolations,
    AsJson,
    Cluster,
    DesignArgument,
    Workers,
    lengths,
    open_design,
    print_json,
    print_table,
    progress_bar,
)
from coilarray.errors import ClusterError, GoalError

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.design.model import Design
    from coilarray.report.tables import Table
    from coilarray.studies.tolerance import Positions


_LARGEST_STEP_CHANGE = 0.05  # of a standard deviation
_ERRORS_OFF = 3.0  # standard errors


def tolerance(
    design: DesignArgument = None,
    tolerances: Annotated[
        Path | None,
        typer.Argument(metavar="TOLERANCE", help="Tolerance file (TOML); typical values of board houses by default."),
    ] = None,
    quantity: Annotated[
        list[str] | None,
        typer.Option(
            "--quantity",
            "-q",
            help='What to compute, as worst_k or "k[coil1,coil2]"; repeat for more. L and k of all coils by default.',
        ),
    ] = None,
    x_mm: Annotated[
        str | None,
        typer.Option("--x-mm", help="Where the indenter presses, as 0,5 or START:STOP:COUNT; with --depth-mm."),
    ] = None,
    y_mm: Annotated[str | None, typer.Option("--y-mm", help="The same along y; 0 by default.")] = None,
    depth_mm: Annotated[
        float | None, typer.Option("--depth-mm", help="How deep it presses; the design's first depth by default.")
    ] = None,
    noise: Annotated[float | None, typer.Option("--noise", help="Standard deviation of δ in a reading.")] = None,
    table: Annotated[
        Path | None,
        typer.Option("--table", help="Where the table of the design is kept (.nc): computed if it is not there."),
    ] = None,
    samples: Annotated[int, typer.Option("--samples", help="Boards to draw, 0 or 8 and more; best a power of 2.")] = 64,
    seed: Annotated[int, typer.Option("--seed", help="Of the drawn boards.")] = 0,
    sampling: Annotated[
        Literal["sobol", "random"], typer.Option("--sampling", help="Evenly spread points, or independent ones.")
    ] = "sobol",
    accuracy: Annotated[
        Literal["full", "screen"], typer.Option("--accuracy", help="Of the inductances; screen is much faster.")
    ] = "screen",
    workers: Workers = None,
    cluster: Cluster = None,
    cache: Annotated[
        Path | None, typer.Option("--cache", help="Folder of boards already computed; the user's cache by default.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Also write every number: .nc, .json, or the spread as .csv."),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", help="Also draw shares and histograms: .png, .svg or .pdf.")
    ] = None,
    template: Annotated[
        Path | None,
        typer.Option("--template", help="Write the typical values as a tolerance file to change (.toml), and leave."),
    ] = None,
    as_json: AsJson = False,
    allow_violations: AllowViolations = False,
) -> None:
    """Say how far the boards that a fabricator makes scatter, and which error it is that scatters them.

    Etch, registration, thicknesses, placement, μr and tank have distributions with a part of each board and one of each
    layer. The spread is linearised, checked on drawn boards, and split by contributor; limits of the file give a yield.
    With --x-mm also δ, and how far from the truth the table of the nominal board locates the indenter.

    Example: coilarray tolerance gast2020 --samples 128 --out spread.csv --plot spread.png

    Example: coilarray tolerance gast2020 fab.toml --x-mm 0,5 --y-mm 4 --table table.nc
    """
    check_file("--out", out, (".nc", ".json", ".csv"))
    check_file("--plot", plot, PICTURES)
    check_file("--table", table, (".nc",))
    check_file("--template", template, (".toml",))
    if workers is not None and cluster is not None:
        raise ClusterError("--workers is for processes of this machine; it cannot be given with --cluster.")
    from contextlib import ExitStack
    from dataclasses import replace

    from coilarray.compute.files import write_atomically, write_text
    from coilarray.compute.store import open_store
    from coilarray.compute.workers import default_count
    from coilarray.compute.workers import workers as open_workers
    from coilarray.report.tolerance_tables import given_table, spread_table, yield_table
    from coilarray.studies.tolerance import analyse, check_analysis, load_tolerances, typical_text

    if template is not None:
        write_text(template, typical_text())
        typer.echo(f"wrote {template}")
        return
    opened = open_design(design, allow_violations=allow_violations)
    read = load_tolerances(tolerances)
    positions = _positions(opened, read.positions, x_mm, y_mm, depth_mm, noise)
    if positions is None and table is not None:
        raise GoalError("--table is for located positions; it needs --x-mm, or [positions] in the file.")
    wanted = replace(read, positions=positions)
    check_analysis(
        opened,
        wanted,
        quantities=quantity or (),
        samples=samples,
        seed=seed,
        sampling=sampling,
        accuracy=accuracy,
        with_table=table is not None and table.exists(),
    )
    kept = open_store(cache)
    count = default_count() if workers is None else workers
    done = 0
    try:
        with open_workers(count, cluster) as pool, ExitStack() as bars:
            # long, so that it comes after all that may be refused; its bar ends before that of the boards begins
            known = None if positions is None else kept_table(opened, table)
            show = bars.enter_context(progress_bar("boards"))

            def progress(now: int, total: int) -> None:
                nonlocal done
                done = now
                show(now, total)

            result = analyse(
                opened,
                wanted,
                quantities=quantity or (),
                samples=samples,
                seed=seed,
                sampling=sampling,
                accuracy=accuracy,
                table=known,
                pool=pool,
                cache=kept,
                progress=progress,
            )
    except (KeyboardInterrupt, ClusterError):
        if done:
            typer.echo(f"coilarray: {done} boards are kept in {kept.folder}; the same command goes on there", err=True)
        raise
    if out is not None:
        _write(result, out)
    if plot is not None:
        from coilarray.viz.plots.tolerance import tolerance_figure

        write_atomically(plot, tolerance_figure(result).savefig)
    if as_json:
        print_json(_numbers(result))
        return
    for one in (given_table(result), spread_table(result), yield_table(result)):
        if one.rows:
            _print(one)
    for line in _remarks(result):
        typer.echo(line)
    for path in (out, plot):
        if path is not None:
            typer.echo(f"wrote {path}")


def _positions(
    design: Design,
    given: Positions | None,
    x_mm: str | None,
    y_mm: str | None,
    depth_mm: float | None,
    noise: float | None,
) -> Positions | None:
    """Positions of the options, which go before those of the file."""
    from coilarray.studies.tolerance import Positions

    if x_mm is None and given is None:
        for option, value in (("--y-mm", y_mm), ("--depth-mm", depth_mm), ("--noise", noise)):
            if value is not None:
                raise GoalError(f"{option} needs --x-mm, or [positions] in the file.")
        return None
    if design.indentation is None:
        raise GoalError(f"positions need [indenter] and [indentation], which the design {design.name} does not have.")
    if noise is not None and not 0 < noise <= 1:
        raise GoalError(f"--noise must be above 0 and at most 1; got {noise:g}.")
    depth = depth_in_metres(depth_mm)
    base = given or Positions((), (0.0,), design.indentation.depths[0])
    return Positions(
        base.x if x_mm is None else tuple(lengths("--x-mm", x_mm)),
        base.y if y_mm is None else tuple(lengths("--y-mm", y_mm)),
        base.depth if depth is None else depth,
        base.noise if noise is None else noise,
    )


def _write(result: xr.Dataset, out: Path) -> None:
    import json

    from coilarray.compute.files import write_text
    from coilarray.compute.netcdf import save_dataset
    from coilarray.report.tolerance_tables import sample_table, spread_table

    match out.suffix.lower():
        case ".nc":
            save_dataset(result, out)
        case ".csv":
            write_text(out, spread_table(result).csv())
        case _:
            samples = {"samples": sample_table(result).records()} if "value" in result else {}
            write_text(out, json.dumps({**_numbers(result), **samples}, indent=1, allow_nan=False) + "\n")


def _numbers(result: xr.Dataset) -> dict[str, Any]:
    """All but the drawn boards, for JSON."""
    from coilarray.report.tolerance_tables import error_table, share_table, spread_table, yield_table

    tables = (error_table(result), spread_table(result), share_table(result), yield_table(result))
    return {**result.attrs, **{one.name: one.records() for one in tables}}


def _remarks(result: xr.Dataset) -> list[str]:
    """Collect what is to be told beside the tables."""
    lines = [f"{result.attrs['boards']} boards computed; the parts of board and layer add up"]
    bent = _not_linear(result)
    if bent:
        lines.append(f"not linear over these errors, so that the drawn boards are right: {', '.join(bent)}")
    if "failure" in result:
        failures = [reason for reason in result.failure.values.tolist() if reason]
        if failures:
            lines.append(f"{len(failures)} of {result.sizes['sample']} drawn boards failed; the first: {failures[0]}")
    if "linear_yield" in result:
        lines.append("a board that cannot be made is bad among the drawn ones; the linear yield has none of these")
    if "sample_yield" in result:
        lines.append("the interval of the yield is for independent boards; Sobol points only come near it")
    if result.attrs.get("untold"):
        lines.append(f"taken as known, for a reading tells next to nothing of it: {result.attrs['untold']}")
    if "found" in result.attrs and "value" in result:
        lines.append(f"found without doubt in {result.attrs['found']}; the others on the border or beyond noise")
    return lines


def _not_linear(result: xr.Dataset) -> list[str]:
    """Name the outputs whose linearised spread does not stand the check by half the step or by the drawn boards."""
    import numpy as np

    bent = result.step_change.values > _LARGEST_STEP_CHANGE
    if "ratio" in result:
        off = np.abs(result.ratio.values - 1)
        bent |= np.nan_to_num(off) > _ERRORS_OFF * np.nan_to_num(result.ratio_error.values)
    return [str(name) for name in result.output.values[bent]]


def _print(table: Table) -> None:
    """Print a table without the columns that are empty in every row."""
    used = [k for k in range(len(table.columns)) if any(row[k] != "" for row in table.rows)]
    cells = [[row[k] for k in used] for row in table.cells()]
    print_table([table.columns[k].header for k in used], cells, title=table.title)
    typer.echo()
