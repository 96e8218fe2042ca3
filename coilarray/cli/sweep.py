"""``coilarray sweep``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.compute.display_units import value_text
from coilarray.compute.table import Table, text_table
from coilarray.errors import GoalError

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.studies.optimize.goal import Goal, Trial

_MOST_BEST = 5  # points of a front that are printed


def sweep(
    design: shared.DesignArgument = None,
    vary: shared.Vary = None,
    quantity: shared.Quantities = None,
    goal: shared.Goals = None,
    samples: Annotated[
        int | None,
        typer.Option(help="Number of sampled points, instead of all combinations; --vary is then KEY=START:STOP."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the samples.")] = 0,
    accuracy: shared.Accuracy = "full",
    workers: shared.Workers = None,
    cluster: shared.Cluster = None,
    cache: shared.Cache = None,
    out: shared.NumbersFile = Path("sweep.nc"),
    plot: Annotated[Path | None, shared.plot_option("the quantities")] = None,
    as_json: shared.AsJson = False,
) -> None:
    """Compute quantities of a design on a grid or at samples.

    Entries of the design are varied. Every point is stored as soon as it is computed, so that the
    same command resumes an interrupted sweep and no point is computed twice. A point that gives no
    design is empty in the file, with the reason. Values are in the unit of their name. Points that
    break fabrication rules are marked by fab_broken in the file and by crosses in the plot, points
    that no LDC1614 reads by converter_unread. They are left out of the table, unless there are no
    others, and are never the best. With --goal the quantities of the goal are computed too, and the
    best points are printed. The entries that the goal varies are the default of --vary.

    Example: coilarray sweep gast2020 --vary array.pitch_mm=12:15:7 --quantity worst_k --out
    sweep.nc --plot sweep.png

    Example: coilarray sweep my_board.toml --vary array.pitch_mm=12:16 --goal worst_k
    """
    shared.check_workers(workers, cluster)
    from coilarray.compute.store import open_store
    from coilarray.design.model import load_design_file
    from coilarray.studies.optimize.goal import best_points
    from coilarray.studies.sweep import RULES, UNREAD, is_read, keeps_rules, parse_axis, plan_sweep, run_sweep

    file = load_design_file(design)
    opened = file.design
    axes, wanted = [parse_axis(text) for text in vary or ()], None
    asked = list(quantity or ())
    if goal:
        from coilarray.studies.optimize.derive import axis_of, derive_goal

        wanted = derive_goal(goal, file, axes).goal
        axes = axes or [axis_of(variable) for variable in wanted.variables]
        asked += wanted.quantities
    if not axes:
        raise GoalError("a sweep needs --vary KEY=START:STOP:COUNT, such as --vary circuit.capacitance_pF=80:120:5.")
    if not asked:
        raise GoalError("a sweep needs --quantity or --goal; coilarray optimize --list-quantities shows all.")
    plan = plan_sweep(file, axes, asked, samples, seed, accuracy)
    kept = open_store(cache)
    points = len(plan.points)
    with (
        shared.resumable(lambda done: f"{done} of {points} points are kept in {kept.folder}") as counting,
        shared.chosen_workers(workers, cluster, points) as used,
        shared.progress_bar(f"{points} points") as show,
    ):
        result = run_sweep(plan, used, kept, progress=counting(show))
    shared.write_numbers(out, result, lambda: result.to_dataframe().to_csv(lineterminator="\n"))
    shared.draw(plot, lambda: viz.sweep_figure(result))
    reasons = [reason for reason in result.reason.values.ravel().tolist() if reason]
    data = {
        "file": out and str(out),
        **shared.design_record(opened),
        "sampling": plan.sampling,
        "accuracy": plan.accuracy,
        "points": _records(result),
    }
    lines: list[str] = []
    tables: list[Table] = []
    if wanted is not None:
        best = best_points(plan, result, wanted)
        data["best"] = [{"entries": dict(point.changes), "quantities": dict(point.quantities)} for point in best]
        lines += _best_lines(best, wanted) if len(reasons) < points else ["no point has a value of the goal"]
    if not as_json:
        read, makeable = is_read(result), keeps_rules(result)
        if bool((makeable & read).any()):
            makeable = makeable & read
        shown = result.where(makeable) if bool(makeable.any()) else result  # what cannot be made has no extremes
        rows = [
            _extremes(shown, one.key, one.quantity.unit)
            for one in plan.requests
            if one.key not in (RULES, UNREAD) or one.key in asked
        ]
        headers = ("quantity", "unit", "smallest", "where", "largest", "where")
        tables = [text_table(headers, rows)]
        broken = int((result[RULES] > 0).sum())
        if broken:
            where = "still in the table" if shown is result else "left out of the table"
            lines.append(f"{broken} of {points} points break fabrication rules ({RULES} in the file): {where}")
        if unread := int((result[UNREAD] > 0).sum()) if UNREAD in result else 0:
            where = "still in the table" if bool((~read & makeable).any()) else "left out of the table"
            lines.append(f"{unread} of {points} points cannot be read by an LDC1614 ({UNREAD} in the file): {where}")
        lines += shared.missing_capacitance(opened, asked)
        if reasons:
            lines.append(f"{len(reasons)} of {points} points have no result; the first: {reasons[0]}")
        lines.append(
            f"wrote {out}: {points} point{'s' if points > 1 else ''} over {', '.join(map(str, result.reason.dims))}"
        )
    shared.print_result(data, as_json=as_json, tables=tables, lines=lines, files=[plot])


def _best_lines(best: Sequence[Trial], goal: Goal) -> list[str]:
    """Say which points are best by a goal."""
    wishes = " and ".join(objective.wish for objective in goal.objectives)
    if not best:
        return [f"{wishes}: no point keeps all bounds: {', '.join(bound.wish for bound in goal.constraints)}"]
    names = [objective.quantity for objective in goal.objectives]
    return [
        f"{wishes}: {', '.join(f'{name} = {point.quantities[name]:.6g}' for name in names)} at "
        + ", ".join(f"{entry} = {value_text(value)}" for entry, value in point.changes.items())
        for point in best[:_MOST_BEST]
    ]


def _records(result: xr.Dataset) -> list[dict[str, Any]]:
    """Return every point with its entries, quantities and reason."""
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
    """Smallest and largest value of a quantity with their places."""
    values = result[key]
    if bool(values.isnull().all()):
        return [key, unit, "–", "", "–", ""]
    row = [key, unit]
    for place in (values.argmin(...), values.argmax(...)):
        there = values.isel(place)
        entries = [f"{name} = {value_text(value.item())}" for name, value in there.coords.items() if name != "sample"]
        row += [value_text(there.item()), ", ".join(entries)]
    return row
