"""``coilarray sweep``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from coilarray.cli.maps import PICTURES, check_file
from coilarray.cli.shared import AsJson, Cluster, DesignArgument, Workers, print_json, print_table, progress_bar
from coilarray.errors import ClusterError

if TYPE_CHECKING:
    import xarray as xr


def sweep(
    design: DesignArgument = None,
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", help="KEY=START:STOP:COUNT or KEY=A,B,…, an entry of the design file; repeat for more."),
    ] = None,
    quantity: Annotated[
        list[str] | None,
        typer.Option("--quantity", "-q", help='What to compute, as worst_k or "k[coil1,coil2]"; repeat for more.'),
    ] = None,
    samples: Annotated[
        int | None,
        typer.Option("--samples", help="So many points instead of all combinations; KEY=START:STOP will do."),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Of the samples.")] = 0,
    accuracy: Annotated[
        Literal["full", "screen"], typer.Option("--accuracy", help="Of the inductances; screen is much faster.")
    ] = "full",
    workers: Workers = None,
    cluster: Cluster = None,
    cache: Annotated[
        Path | None, typer.Option("--cache", help="Folder of points already computed; the user's cache by default.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write: .nc (netCDF) or .csv.")] = Path("sweep.nc"),
    plot: Annotated[Path | None, typer.Option("--plot", help="Also draw the quantities: .png, .svg or .pdf.")] = None,
    as_json: AsJson = False,
) -> None:
    """Compute quantities of a design over a grid of its entries, or over samples.

    Every point is kept as it is done: an interrupted sweep goes on when the same command runs again, and no point is
    computed twice. A point that gives no design is empty in the file, with the reason. Values keep the unit of their
    name.

    Example: coilarray sweep gast2020 --vary array.pitch_mm=12:15:7 --quantity worst_k --out sweep.nc --plot sweep.png
    """
    check_file("--out", out, (".nc", ".csv"))
    check_file("--plot", plot, PICTURES)
    if workers is not None and cluster is not None:
        raise ClusterError("--workers is for processes of this machine; it cannot be given with --cluster.")
    from coilarray.compute.files import write_atomically, write_text
    from coilarray.compute.netcdf import save_dataset
    from coilarray.compute.workers import default_count
    from coilarray.compute.workers import workers as open_workers
    from coilarray.design.model import load_design_file
    from coilarray.studies.cache import open_cache
    from coilarray.studies.sweep import parse_axis, plan_sweep, run_sweep

    file = load_design_file(design)
    opened = file.design
    plan = plan_sweep(file, [parse_axis(text) for text in vary or ()], quantity or (), samples, seed, accuracy)
    kept = open_cache(cache)
    count = workers if workers is not None else min(default_count(), len(plan.points))
    done = 0
    try:
        with open_workers(count, cluster) as pool, progress_bar(f"{len(plan.points)} points") as show:

            def progress(now: int, total: int) -> None:
                nonlocal done
                done = now
                show(now, total)

            result = run_sweep(plan, pool, kept, progress=progress)
    except (KeyboardInterrupt, ClusterError):
        if done:
            typer.echo(
                f"coilarray: {done} of {len(plan.points)} points are kept in {kept.folder}; "
                "the same command goes on from there",
                err=True,
            )
        raise
    if out.suffix.lower() == ".nc":
        save_dataset(result, out)
    else:
        write_text(out, result.to_dataframe().to_csv(lineterminator="\n"))
    if plot is not None:
        from coilarray.viz.plots.sweep_grid import sweep_figure

        write_atomically(plot, sweep_figure(result).savefig)
    reasons = [reason for reason in result.reason.values.ravel().tolist() if reason]
    if as_json:
        print_json(
            {
                "file": str(out),
                "design": opened.name,
                "design_hash": opened.digest,
                "sampling": plan.sampling,
                "accuracy": plan.accuracy,
                "points": _records(result),
            }
        )
        return
    rows = [_extremes(result, one.key, one.quantity.unit) for one in plan.requests]
    print_table(("quantity", "unit", "smallest", "where", "largest", "where"), rows)
    if reasons:
        typer.echo(f"{len(reasons)} of {len(plan.points)} points have no result; the first: {reasons[0]}")
    typer.echo(f"wrote {out}: {len(plan.points)} points over {', '.join(map(str, result.reason.dims))}")
    if plot is not None:
        typer.echo(f"wrote {plot}")


def _records(result: xr.Dataset) -> list[dict[str, Any]]:
    """Every point with its entries, quantities and reason; None for a quantity that it does not have."""
    table = result.to_dataframe().reset_index().to_dict("records")
    return [
        {
            str(key): None if isinstance(value, float) and math.isnan(value) else value
            for key, value in row.items()
            if key != "sample"
        }
        for row in table
    ]


def _extremes(result: xr.Dataset, key: str, unit: str) -> list[str]:
    """Smallest and largest value of a quantity, each with where it is."""
    values = result[key]
    if bool(values.isnull().all()):
        return [key, unit, "–", "", "–", ""]
    row = [key, unit]
    for place in (values.argmin(...), values.argmax(...)):
        there = values.isel(place)
        entries = [f"{name} = {_shown(value.item())}" for name, value in there.coords.items() if name != "sample"]
        row += [_shown(there.item()), ", ".join(entries)]
    return row


def _shown(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
