"""``coilarray optimize``."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from coilarray.cli import shared
from coilarray.compute.table import Table, text_table
from coilarray.errors import GoalError

if TYPE_CHECKING:
    from coilarray.design.model import DesignFile
    from coilarray.studies.optimize.derive import DerivedGoal
    from coilarray.studies.optimize.goal import Goal, Trial
    from coilarray.studies.optimize.run import Optimization, SearchProgress


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
    out: Annotated[Path, shared.file_option(("--out", "-o"), "Folder for the results and the points.")] = Path(
        "optimization"
    ),
    trials: Annotated[
        int | None, shared.number_option(("--trials",), 1, 1_000_000, "Number of points to try; the goal's by default.")
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
        _print_quantities(as_json=as_json)
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
        _write_template(template, derived, design)
        return
    from coilarray.compute.store import open_store
    from coilarray.report.optimization import write_optimization_report
    from coilarray.studies.optimize.derive import keeping_rules
    from coilarray.studies.optimize.run import (
        optimize_design,
        points_found,
        require_coils,
        result_data,
        write_optimization,
    )

    wanted = derived.goal
    if trials is not None:
        wanted = wanted.model_copy(update={"search": wanted.search.model_copy(update={"trials": trials})})
    require_coils(opened.design, wanted)
    wanted = keeping_rules(wanted, opened)
    kept = open_store(cache)
    found = points_found(out, opened.design, wanted)
    if found:
        typer.echo(f"coilarray: going on with {found} points of an earlier run in {out}", err=True)
    with (
        shared.resumable(lambda done: f"{done} points are kept in {out}", found) as counting,
        shared.chosen_workers(workers, cluster) as used,
        _progress(wanted) as show,
    ):
        result = optimize_design(opened, wanted, out, used, kept, progress=counting(show))
    files = (*write_optimization(result, out), write_optimization_report(result, out))
    data = {**result_data(result), "files": [str(path) for path in files]}
    shared.print_result(data, as_json=as_json, lines=[] if as_json else _lines(result), files=files)
    if not result.front:
        raise typer.Exit(1)
    if not as_json and (best := out / "best.toml") in files:
        typer.echo(f"next: coilarray report {shlex.quote(str(best))}")


def _goal(
    file: DesignFile, named: str | None, wishes: Sequence[str], vary: Sequence[str], keep: Sequence[str]
) -> DerivedGoal:
    """Read or derive the goal of the command line."""
    from coilarray.studies.optimize.derive import DerivedGoal, adjusted, derive_goal, is_named, load_goal, parse_bound
    from coilarray.studies.sweep import parse_axis

    axes, bounds = [parse_axis(text) for text in vary], [parse_bound(text) for text in keep]
    if named is None or is_named(named):
        return adjusted(derive_goal([*([named] if named else []), *wishes], file, axes), (), bounds)
    if wishes:
        raise GoalError(f"{named} is a goal file; --goal cannot be given with it.")
    return adjusted(DerivedGoal(load_goal(named, file), {}), axes, bounds)


def _write_template(path: Path, derived: DerivedGoal, design: str) -> None:
    from coilarray.compute.files import write_text

    head = (
        f"A goal for {design}; every range and bound follows from that design, and can be changed here:\n"
        f"    coilarray optimize {design} {path}\n"
        "Quantities: coilarray optimize --list-quantities. An entry is a dotted key of the design file, with low and\n"
        "high (step = 0.1 and log = true are possible too) or choices."
    )
    write_text(path, derived.text(head))
    typer.echo(f"wrote {path}; next: coilarray optimize {design} {path}")


def _print_quantities(*, as_json: bool) -> None:
    from coilarray.studies.quantities import QUANTITIES

    rows = []
    for one in QUANTITIES.values():
        options = ", ".join(option.name + (" (needed)" if option.required else "") for option in one.options)
        rows.append((one.name, one.unit, options, one.cost, one.says))
    headers = ("quantity", "unit", "options", "needs", "what it is")
    table = text_table(headers, rows)
    shared.print_result({"quantities": table.records()}, as_json=as_json, tables=[table])


def _lines(result: Optimization) -> list[str | Table]:
    """Describe the search, and compare given and best designs."""
    from coilarray.geometry import check_rules
    from coilarray.report.optimization import (
        at_ends,
        chosen_designs,
        none_better,
        quantity_table,
        reason_table,
        variable_table,
    )
    from coilarray.report.summary import unread_words

    searched = sum(trial.kind == "search" for trial in result.trials)
    refined = len(result.trials) - searched
    tried = f"{searched} points tried{f', {refined} more to refine the best' if refined else ''}; "
    tried += f"{sum(trial.feasible for trial in result.trials)} keep all bounds"
    if not result.front:
        reasons = [f"the most frequent reason why points give no design: {row[0]}" for row in reason_table(result).rows]
        return [f"{tried}: {none_better(result)}", *reasons[:1]]
    chosen = chosen_designs(result)
    lines: list[str | Table] = [tried, "", quantity_table(result, chosen, result.goal.quantities).without("says"), ""]
    lines += [variable_table(result, chosen), "", *at_ends(result, chosen)]
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
    """Show a progress bar with the best result."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task, first = bar.add_task("", total=None), goal.objectives[0].quantity

        def progress(done: int, total: int, best: Trial | None) -> None:
            text = "" if best is None else f"best {first} {best.quantities[first]:.5g}"
            bar.update(task, completed=done, total=total, description=text)

        yield progress
