"""Studies of a design: ``coilarray sweep``, ``optimize`` and ``tolerance``."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.compute.display_units import value_text
from coilarray.compute.files import write_text
from coilarray.compute.store import open_store
from coilarray.compute.table import Table, text_table
from coilarray.errors import GoalError

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.design.model import DesignFile
    from coilarray.studies.optimize.derive import DerivedGoal
    from coilarray.studies.optimize.goal import Goal, Trial
    from coilarray.studies.optimize.run import Optimization, SearchProgress


_MOST_BEST = 5  # points of a front that are printed
_MOST_ROWS = 16  # points of a sweep that are printed one by one
_ERRORS_OFF = 3.0  # standard errors
_NAMED = 6  # outputs in a line


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
    from coilarray.report import studies as report  # Matplotlib too, for which no point waits

    reasons = [reason for reason in result.reason.values.ravel().tolist() if reason]
    data = {
        "file": out and str(out),
        **shared.design_record(opened),
        "sampling": plan.sampling,
        "accuracy": plan.accuracy,
        "points": records(result),
    }
    lines: list[str] = []
    tables: list[Table] = []
    if wanted is not None:
        best = best_points(plan, result, wanted)
        data["best"] = [{"entries": dict(point.changes), "quantities": dict(point.quantities)} for point in best]
        lines += _best_lines(best, wanted) if len(reasons) < points else ["no point has a value of the goal"]
    if not as_json and points <= _MOST_ROWS:
        with shared.progress_bar("reasons of refused points"):
            table, notes = report.point_table(plan, result)
        tables, lines = [table], [*notes, *lines, *shared.missing_capacitance(opened, asked)]
    elif not as_json:
        read, makeable = is_read(result), keeps_rules(result)
        if bool((makeable & read).any()):
            makeable = makeable & read
        shown = result.where(makeable) if bool(makeable.any()) else result  # what cannot be made has no extremes
        rows = [
            extremes(shown, one.key, one.quantity.unit)
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
        kinds = report.kinds_of(reasons)
        lines += [f"{count} of {points} points give no design, such as: {reason}" for reason, count in kinds]
    if not as_json:
        lines.append(
            f"wrote {out}: {points} point{'s' if points > 1 else ''} over {', '.join(map(str, result.reason.dims))}"
        )
    shared.print_result(data, as_json=as_json, tables=tables, lines=lines, files=[plot])


def _best_lines(best: Sequence[Trial], goal: Goal) -> list[str]:
    wishes = " and ".join(objective.wish for objective in goal.objectives)
    if not best:
        return [f"{wishes}: no point keeps all bounds: {', '.join(bound.wish for bound in goal.constraints)}"]
    names = [objective.quantity for objective in goal.objectives]
    return [
        f"{wishes}: {', '.join(f'{name} = {value_text(point.quantities[name])}' for name in names)} at "
        + ", ".join(f"{entry} = {value_text(value)}" for entry, value in point.changes.items())
        for point in best[:_MOST_BEST]
    ]


def records(result: xr.Dataset) -> list[dict[str, Any]]:
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


def extremes(result: xr.Dataset, key: str, unit: str) -> list[str]:
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


def optimize(
    design: Annotated[
        str | None, typer.Argument(metavar="DESIGN", help="Design file (TOML) or name of a bundled design.")
    ] = None,
    goal: Annotated[
        str | None,
        typer.Argument(metavar="GOAL", help="Goal file (TOML), or a name as for --goal.", show_default=False),
    ] = None,
    wish: shared.Goals = None,
    vary: shared.Vary = None,
    keep: Annotated[
        list[str] | None,
        typer.Option(
            "--keep",
            help="Bound in addition to those of the goal: QUANTITY>=VALUE or QUANTITY<=VALUE; may be repeated.",
        ),
    ] = None,
    template: Annotated[
        Path | None,
        shared.file_option(
            ("--template",), "Write the goal for this design to a commented file, and exit.", (".toml",)
        ),
    ] = None,
    force: shared.Force = False,
    out: Annotated[Path, shared.out_option("Folder for the results and the points.")] = Path("optimization"),
    trials: Annotated[
        int | None, shared.number_option("--trials", 1, 1_000_000, "Number of points to try; the goal's by default.")
    ] = None,
    workers: shared.Workers = None,
    cluster: shared.Cluster = None,
    cache: shared.Cache = None,
    list_quantities: Annotated[
        bool, typer.Option("--list-quantities", help="Print the quantities that a goal may use, and exit.")
    ] = False,
    as_json: shared.AsJson = False,
) -> None:
    """Search for the design that meets a goal best.

    A goal says which entries of the design may change, which quantities to minimise or maximise,
    and which bounds to keep. Named goals fit any design, as they take their ranges from it.
    --template writes a goal to a file to edit. Every point is stored in the folder as soon as it is
    computed: the same command resumes a run that was stopped, and a larger --trials continues it.
    Writes trials.csv, result.json, report.html and the best designs. If no design is better than
    the given one, none is written and the exit code is 1.

    Example: coilarray optimize gast2020 worst_k --trials 100 --out better

    Example: coilarray optimize my_board.toml --vary array.pitch_mm=12:16 --goal worst_k

    Example: coilarray optimize my_board.toml smallest --keep "inductance_uH[coil1]>=18" --template
    goal.toml
    """
    if list_quantities:
        from coilarray.studies.quantities import QUANTITIES

        rows = []
        for one in QUANTITIES.values():
            options = ", ".join(option.name + (" (needed)" if option.required else "") for option in one.options)
            rows.append((one.name, one.unit, options, one.cost, one.says))
        table = text_table(("quantity", "unit", "options", "needs", "what it is"), rows)
        shared.print_result({"quantities": table.records()}, as_json=as_json, tables=[table])
        return
    if design is None or not (goal or wish):
        raise GoalError("a design and a goal must be given, as in: coilarray optimize gast2020 worst_k.")
    shared.check_workers(workers, cluster)
    from coilarray.design.model import load_design_file
    from coilarray.studies.optimize.goal import axes_of

    opened = load_design_file(design)
    derived = _goal(opened, goal, wish or (), vary or (), keep or ())
    axes_of(derived.goal, opened)  # mistakes before anything is made and any process is started
    if template is not None:
        shared.require_new(template, force=force)
        head = (
            f"A goal for {design}; every range and bound follows from that design, and can be changed here:\n"
            f"    coilarray optimize {design} {template}\n"
            "Quantities: coilarray optimize --list-quantities. An entry is a dotted key of the design file, with low "
            "and\nhigh (step = 0.1 and log = true are possible too) or choices."
        )
        write_text(template, derived.text(head))
        shared.say(f"wrote {template}; next: coilarray optimize {design} {template}")
        return
    from coilarray.report.studies import write_optimization_report
    from coilarray.studies.optimize import run
    from coilarray.studies.optimize.derive import keeping_rules

    wanted = derived.goal
    if trials is not None:
        wanted = wanted.model_copy(update={"search": wanted.search.model_copy(update={"trials": trials})})
    run.require_coils(opened.design, wanted)
    wanted = keeping_rules(wanted, opened)
    kept = open_store(cache)
    found = len(run.read_studies(out).get(run.study_name(opened.design, wanted), []))
    if found:
        shared.say(f"coilarray: going on with {found} points of an earlier run in {out}", err=True)
    with (
        shared.resumable(lambda done: f"{done} points are kept in {out}", found) as counting,
        shared.chosen_workers(workers, cluster) as used,
        _progress(wanted) as show,
    ):
        result = run.optimize_design(opened, wanted, out, used, kept, progress=counting(show))
    files = (*run.write_optimization(result, out), write_optimization_report(result, out))
    data = {**run.result_data(result), "files": [str(path) for path in files]}
    shared.print_result(data, as_json=as_json, lines=[] if as_json else _lines(result), files=files)
    if not result.front:
        raise typer.Exit(1)
    if not as_json and (best := out / "best.toml") in files:
        shared.say(f"next: coilarray report {shlex.quote(str(best))}")


def _goal(
    file: DesignFile, named: str | None, wishes: Sequence[str], vary: Sequence[str], keep: Sequence[str]
) -> DerivedGoal:
    from coilarray.studies.optimize.derive import DerivedGoal, adjusted, derive_goal, is_named, load_goal, parse_bound
    from coilarray.studies.sweep import parse_axis

    axes, bounds = [parse_axis(text) for text in vary], [parse_bound(text) for text in keep]
    if named is None or is_named(named):
        return adjusted(derive_goal([*([named] if named else []), *wishes], file, axes), (), bounds)
    if wishes:
        raise GoalError(f"{named} is a goal file; --goal cannot be given with it.")
    return adjusted(DerivedGoal(load_goal(named, file), {}), axes, bounds)


def _lines(result: Optimization) -> list[str | Table]:
    from coilarray.geometry import check_rules
    from coilarray.report import studies as report
    from coilarray.report.summary import unread_words

    searched = sum(trial.kind == "search" for trial in result.trials)
    refined = len(result.trials) - searched
    tried = f"{searched} points tried{f', {refined} more to refine the best' if refined else ''}; "
    tried += f"{sum(trial.feasible for trial in result.trials)} keep all bounds"
    if not result.front:
        reasons = report.reason_table(result).rows[:1]
        often = [f"the most frequent reason why points give no design: {row[0]}" for row in reasons]
        return [f"{tried}: {report.none_better(result)}", *often]
    chosen = report.chosen_designs(result)
    quantities = report.quantity_table(result, chosen, result.goal.quantities).without("says")
    lines: list[str | Table] = [tried, "", quantities, "", report.variable_table(result, chosen), ""]
    lines += [*report.at_ends(result, chosen), *report.target_missed(result, chosen[0])]
    designs = {one.label: one.design for one in chosen}
    broken = [label for label, of in designs.items() if not all(m.kept for m in check_rules(of.array, of.rules))]
    if broken:
        lines.append(f"{', '.join(broken)} break fabrication rules (coilarray check), which the goal allows")
    lines += [f"{one.label}: {words}" for one in chosen if (words := unread_words(one.design))]
    if len(result.goal.objectives) > 1:
        lines.append(f"Pareto front: {len(result.front)} designs")
    return lines


@contextmanager
def _progress(goal: Goal) -> Iterator[SearchProgress]:
    first = goal.objectives[0].quantity
    with shared.progress_bar("search") as show:

        def progress(done: int, total: int, best: Trial | None) -> None:
            show(done, total, "" if best is None else f"best {first} {best.quantities[first]:.5g}")

        yield progress


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
    from coilarray.report.studies import given_table, sample_table, spread_table, yield_table
    from coilarray.studies.tolerance import analyse, check_analysis, load_tolerances, typical_text

    if template is not None:
        shared.require_new(template, force=force)
        write_text(template, typical_text())
        shared.say(f"wrote {template}")
        return
    opened = shared.open_design(design, allow_violations=allow_violations, boards=True)
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
        # long, so that it comes after all that may be refused; its bar ends before that of the boards begins
        known = None if read.positions is None else shared.kept_table(opened)
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
    from coilarray.report.studies import error_table, share_table, spread_table, yield_table

    tables = (error_table(result), spread_table(result), share_table(result), yield_table(result))
    return {**result.attrs, **{one.name: one.records() for one in tables}}


def _remarks(result: xr.Dataset) -> list[str]:
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
