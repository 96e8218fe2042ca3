"""Page of an optimisation, and tables of tolerances."""

import itertools
import json
import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr

from coilarray.circuit.coupling import provenance
from coilarray.compute.display_units import PERCENT, DisplayUnit, true_minus, value_text
from coilarray.compute.files import make_folder, write_text
from coilarray.compute.table import Column, Details, Group, Picture, Section, Table, Value, Warn, cell, dataset_table
from coilarray.design.boards import check_boards
from coilarray.design.model import Design
from coilarray.design.vary import vary
from coilarray.errors import CoilarrayError
from coilarray.geometry.rules import Margin, broken_rules
from coilarray.report.page import draw, html_page, now, provenance_section
from coilarray.report.summary import unread_words
from coilarray.studies.optimize.derive import neighbours
from coilarray.studies.optimize.goal import Axis, Objective, Trial, held_back
from coilarray.studies.optimize.run import Optimization, design_names
from coilarray.studies.quantities import QUANTITIES, Evaluation, request
from coilarray.studies.sweep import RULES, UNREAD, Sweep
from coilarray.viz import boards_figure, plot_convergence, plot_front

_CHEAP = ("geometry", "coupling", "circuit")  # costs of the quantities that the page always shows
_MOST_REASONS = 5
_MOST_BEST = 20
_NUMBERS = re.compile(r"\d+")
_MOST_FRONTS = 3  # pictures of pairs of objectives
_REACHED = 0.01  # of the start's distance from a target, and of the target
_LAYERS_OF_THEIR_OWN = (
    "array.layers with layers of their own for neighbours frees them, such as "
    '[["L1", "L2"], ["L3", "L4"]] (coilarray init --overlap decoupled).'
)
_MOST_SHOWN = 3  # contributors of an output in the table of spreads

_PERCENT, _MICROMETRES, _MILLIMETRES, _MILLIRADIANS = (
    DisplayUnit(symbol, factor, 3, significant=True)
    for symbol, factor in (("%", 100.0), ("µm", 1e6), ("mm", 1e3), ("mrad", 1e3))
)
_FILE_UNITS = {  # units of a tolerance file by its tables
    "etch": _MICROMETRES, "registration": _MICROMETRES, "rotation": _MILLIRADIANS, "dielectric": _PERCENT,
    "copper": _PERCENT, "placement": _MILLIMETRES, "permeability": _PERCENT, "elastomer": _MILLIMETRES,
    "capacitance": _PERCENT, "plate_distance": _MILLIMETRES, "plate_thickness": _PERCENT, "conductivity": _PERCENT,
    "target_tilt": _MILLIRADIANS,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Chosen:
    """Design beside the start, with the name of its file."""

    label: str
    trial: Trial
    design: Design


def write_optimization_report(result: Optimization, folder: str | Path) -> Path:
    """Write ``report.html`` of an optimisation in a folder."""
    path = Path(folder) / "report.html"
    make_folder(path.parent)
    chosen = chosen_designs(result)
    goal, several = result.goal, len(result.goal.objectives) > 1
    fronts = _front_pictures(result, chosen)
    boards = {f"{result.design.name}, as given": result.design.array}
    boards |= {one.label: one.design.array for one in chosen}
    files = ["File of the design: `best.toml`."] if result.front else []
    if several:
        files = [
            "Shown are the ends of the Pareto front, and the point nearest to the best of every objective where the "
            "front spans the unit box. Files of all its designs: `pareto_NN.toml`."
        ]
    trials, reasons = trial_table(result), reason_table(result)
    warnings: list[Warn] = []
    if not result.front:
        text = none_better(result)
        warnings = [Warn(f"{text[0].upper()}{text[1:]}. No design is written beside this page.")]
    elif not result.start.feasible:
        reason = f": {result.start.reason}" if result.start.reason else ""
        warnings = [Warn(f"The given design does not keep all bounds{reason}.")]
    sections = [Section("Before and after", (
        Group("text", (quantity_table(result, chosen),)), Group("text", (variable_table(result, chosen),)),
        *files,
    ))]  # fmt: skip
    if fronts:
        words = "No feasible point is better than a point of the front in every objective. Far-off points are left out."
        sections.append(Section("Pareto front", (words, *fronts)))
    sections += [
        Section("Boards", (
            draw("boards", "The boards from above, all copper layers, at one scale.", boards_figure(boards)),
        )),
        Section("Convergence", (
            *_convergence_pictures(result),
            *([f"No local solver: {result.polish_problem}"] if result.polish_problem else []),
        )),
        Section(trials.title, (Details("All trials: `trials.csv`", (trials,), open=several),)),
    ]  # fmt: skip
    if reasons.rows:
        sections.append(Section(reasons.title, (Group("text", (reasons,)),)))
    name = result.design.title or result.design.name
    page = html_page(
        goal.title or f"Optimisation of {result.design.name}",
        [name, _search_words(result), *warnings],
        [*sections, provenance_section(
            {**provenance(result.design), "date": now()},
            "The goal, the trials and all numbers: `result.json` and `trials.csv`.",
        )],
        title=f"{name} – optimisation",
    )  # fmt: skip
    write_text(path, page)
    return path


def _search_words(result: Optimization) -> str:
    goal, searched = result.goal, sum(trial.kind == "search" for trial in result.trials)
    wanted = ", ".join(f"**{objective.wish}**" for objective in goal.objectives)
    kept = f"; kept: {', '.join(constraint.wish for constraint in goal.constraints)}" if goal.constraints else ""
    refined = len(result.trials) - searched
    impossible = sum(bool(trial.reason) for trial in result.trials)
    return (
        f"Wanted: {wanted}{kept}. {searched} points of the sampler {goal.sampler} (seed {goal.search.seed})"
        f"{f' and {refined} of the local solver' if refined else ''}; "
        f"{sum(trial.feasible for trial in result.trials)} keep all bounds"
        f"{f', {impossible} give no design' if impossible else ''}."
    )


def chosen_designs(result: Optimization) -> tuple[Chosen, ...]:
    """Return the best design, or a front's ends and middle."""
    labels = [Path(name).stem for name in design_names(result)]
    places = set(range(len(result.front)))
    if len(places) > 2:
        signs = np.array([-1.0 if objective.maximized else 1.0 for objective in result.goal.objectives])
        costs = signs * np.array([trial.scores for trial in result.front])
        spread = np.ptp(costs, axis=0)
        scaled = (costs - costs.min(axis=0)) / np.where(spread > 0, spread, 1.0)
        places = {0, len(result.front) - 1, int(np.linalg.norm(scaled, axis=1).argmin())}
    return tuple(Chosen(labels[k], result.front[k], vary(result.file, result.front[k].changes)) for k in sorted(places))


def none_better(result: Optimization) -> str:
    """Describe a search that has found no better design."""
    start = result.start
    if not start.feasible:
        broken = ", ".join(bound for bound, violation in start.violations.items() if violation > 0)
        why = f": {start.reason.rstrip('.')}" if start.reason else f", as it breaks {broken}"
        return f"no design is found that keeps all bounds; the given design does not either{why}"
    kept = [trial for trial in result.trials if trial.feasible and trial.scores and not _is_start(result, trial)]
    text = "no design is better than the one at hand, which keeps all bounds"
    objective = result.goal.objectives[0]
    if kept and len(result.goal.objectives) == 1:
        best = (max if objective.maximized else min)(trial.scores[0] for trial in kept)
        shown = f"{objective.quantity} is {start.quantities[objective.quantity]:.6g}"
        goal, of_it = ("", "") if objective.target is None else (f", {start.scores[0]:.6g} from its target", " from it")
        text += f": {shown} for the given design{goal}, and {best:.6g}{of_it} at best in the search"
    return text


def _is_start(result: Optimization, trial: Trial) -> bool:
    return all(
        value == axis.start
        or (isinstance(value, float) and isinstance(axis.start, int | float) and math.isclose(value, axis.start))
        for axis in result.axes
        for value in [trial.changes[axis.entry]]
    )


def variable_table(result: Optimization, chosen: Sequence[Chosen]) -> Table:
    """Return the variables with range, start and chosen values."""
    columns = (
        Column("entry"), Column("start", "given"), *(Column(one.label) for one in chosen), Column("allowed", "may be"),
    )  # fmt: skip
    rows = tuple(
        (axis.entry, _shown(axis.start), *(_shown(one.trial.changes[axis.entry]) for one in chosen), _allowed(axis))
        for axis in result.axes
    )
    return Table("variables", "Variables", columns, rows)


def at_ends(result: Optimization, chosen: Sequence[Chosen]) -> list[str]:
    """List the variables that end at a bound."""
    lines = []
    for axis in result.axes:
        if axis.choices:
            continue
        values = [one.trial.changes[axis.entry] for one in chosen]
        ends = [end for end in (axis.low, axis.high) if any(math.isclose(value, end) for value in values)]
        if ends:
            shown = " and ".join(f"{end:g}" for end in ends)
            lines.append(f"{axis.entry} ends at a bound of its range, {shown}: the bound decides, not the goal.")
    return lines


def target_missed(result: Optimization, best: Chosen) -> list[str]:
    """Say which rule keeps a goal with a target from it, and what may free it."""
    objective = result.goal.objectives[0]
    start = result.start.scores[0] if result.start.scores else math.inf
    if objective.target is None or best.trial.scores[0] <= _REACHED * max(abs(objective.target), min(start, 1.0)):
        return []
    reached = best.trial.quantities[objective.quantity]
    lines = [f"{objective.quantity} stops at {_shown(reached)}, beside its target {objective.target:g}."]
    if held := held_back((*result.trials, best.trial)):
        trial, limits = held
        at = ", ".join(f"{entry} = {_shown(value)}" for entry, value in trial.changes.items())
        design = vary(result.file, trial.changes)
        rules = broken_rules(margins := check_boards(design))
        why = rules[0] if rules else f"It breaks {', '.join(limits)}."
        lines.append(f"It would be {_shown(trial.quantities[objective.quantity])} at {at}, which is refused: {why}")
        worst = next((one for one in margins if not one.kept), None)
        if worst is not None and worst.feature.count(" – ") == 1:
            lines.append(_freed_by(design, worst))
    elif result.design.array.neighbours and neighbours(result.design).share_copper:
        lines.append(f"Neighbours lie on the same copper, so they cannot overlap. {_LAYERS_OF_THEIR_OWN}")
    return lines


def _freed_by(design: Design, worst: Margin) -> str:
    """Say what parts the copper of two coils that is too close."""
    on = {one.name: one.layers for one in design.array.placements}
    one, other = worst.feature.split(" – ")
    if set(on.get(one, ())) & set(on.get(other, ())):
        return f"{one} and {other} share copper. {_LAYERS_OF_THEIR_OWN}"
    return (
        "A hole of one of them is in the other's copper. board.through_holes = false frees it, whose vias span only "
        "the layers of their coil, and so do leads on another side."
    )


def quantity_table(result: Optimization, chosen: Sequence[Chosen], keys: Sequence[str] = ()) -> Table:
    """Return `keys`, or goal and cheap quantities, before and after."""
    columns = (
        Column("quantity"),
        Column("unit"),
        Column("wish", "goal"),
        Column("start", "given"),
        *(Column(one.label) for one in chosen),
        Column("says", "what it is"),
    )
    wishes: dict[str, list[str]] = {key: [] for key in result.goal.quantities}
    for objective in result.goal.objectives:
        target = objective.target
        wishes[objective.quantity].append(f"{objective.direction}" if target is None else f"to {target:g}")
    for constraint in result.goal.constraints:
        wishes[constraint.quantity].append(true_minus(constraint.wish.removeprefix(constraint.quantity).strip()))
    wanted = {key: ", ".join(texts) or "watched" for key, texts in wishes.items()}
    cheap = [q.name for q in QUANTITIES.values() if q.cost in _CHEAP and not any(o.required for o in q.options)]
    keys = keys or tuple(dict.fromkeys((*result.goal.quantities, *cheap)))
    values = [
        _quantities(design, trial, keys)
        for design, trial in ((result.design, result.start), *((one.design, one.trial) for one in chosen))
    ]
    rows = tuple(
        (
            key,
            "" if request(key).quantity.unit == "1" else request(key).quantity.unit,
            wanted.get(key, ""),
            *(_shown(of_design.get(key)) for of_design in values),
            request(key).quantity.says,
        )
        for key in keys
        if key in result.goal.quantities or any(key in of_design for of_design in values)  # one coil has no k
    )
    return Table("quantities", "Quantities", columns, rows)


def trial_table(result: Optimization) -> Table:
    """Return the front, or the best trials of one objective."""
    several = len(result.goal.objectives) > 1
    sign = -1 if result.goal.objectives[0].maximized else 1
    others = [t for t in result.trials if t.feasible and t.kind == "search" and t not in result.front]
    ranked = [] if several else sorted(others, key=lambda trial: sign * trial.scores[0])
    shown = (*result.front, *ranked[:_MOST_BEST])
    names = [Path(name).stem for name in design_names(result)] if several else [""] * len(shown)
    entries = [axis.entry for axis in result.axes]
    columns = (
        *([Column("file")] if several else []),
        *map(Column, ("trial", "accuracy", *result.goal.quantities, *entries)),
    )
    rows = tuple(
        (
            *([name] if several else []),
            trial.name,
            trial.accuracy,
            *(_shown(trial.quantities.get(key)) for key in result.goal.quantities),
            *(_shown(trial.changes[entry]) for entry in entries),
        )
        for name, trial in zip(names, shown, strict=True)
    )
    return Table("trials", "Designs of the front" if several else "Best points", columns, rows)


def reason_table(result: Optimization) -> Table:
    """Return the reasons for invalid points, the most frequent first."""
    kinds = kinds_of([trial.reason for trial in result.trials if trial.reason])
    columns = (Column("reason", "for example"), Column("points", unit="1"))
    return Table("reasons", "Points that give no design", columns, tuple(kinds))


def kinds_of(reasons: Sequence[str]) -> list[tuple[str, int]]:
    """Return the most frequent reasons, whose numbers may differ, and their counts."""
    kinds = Counter(map(_without_numbers, reasons))
    example = {_without_numbers(reason): reason for reason in reversed(reasons)}
    return [(example[kind], count) for kind, count in kinds.most_common(_MOST_REASONS)]


def _without_numbers(reason: str) -> str:
    return _NUMBERS.sub("#", reason)


def point_table(plan: Sweep, result: xr.Dataset) -> tuple[Table, list[str]]:
    """Return the points of a sweep, and why some are refused, alike reasons once."""
    reasons = [str(reason) for reason in result.reason.values.ravel()]
    broken, unread = (
        result[key].values.ravel() if key in result else np.zeros(len(reasons)) for key in (RULES, UNREAD)
    )
    kinds: dict[str, str] = {}
    remarks = []
    for k, point in enumerate(plan.points):
        said = (
            "no design" if reasons[k] else "breaks rules" if broken[k] > 0 else "not readable" if unread[k] > 0 else ""
        )
        if said == "breaks rules":
            reasons[k] = broken_rules(check_boards(vary(plan.file, point)))[0]
        elif said == "not readable":
            reasons[k] = unread_words(vary(plan.file, point))
        if said:
            kinds.setdefault(_without_numbers(reasons[k]), reasons[k])
            said += f" ({1 + list(kinds).index(_without_numbers(reasons[k]))})"
        remarks.append(said)
    shown = [one for one in plan.requests if one.key not in (RULES, UNREAD)]
    columns = (
        *(Column(axis.key, axis.key) for axis in plan.axes),
        *(Column(one.key, one.key, one.quantity.unit, DisplayUnit(significant=True, digits=5)) for one in shown),
        Column("remark"),
    )
    values = zip(*(result[one.key].values.ravel().tolist() for one in shown), strict=True)
    rows = tuple(
        (*map(value_text, point.values()), *map(cell, row), remark)
        for point, row, remark in zip(plan.points, values, remarks, strict=True)
    )
    notes = [f"({k}) {reason}" for k, reason in enumerate(kinds.values(), start=1)]
    return Table("points", "", columns, rows).without_empty_columns(), notes


def _convergence_pictures(result: Optimization) -> list[Picture]:
    trials, start = result.trials, result.start.scores
    pictures = []
    for k, objective in enumerate(result.goal.objectives):
        axes = plot_convergence(
            [trial.scores[k] if trial.scores else math.nan for trial in trials],
            [trial.feasible for trial in trials],
            label=_axis_label(objective),
            maximized=objective.maximized,
            polished_from=next((n for n, trial in enumerate(trials) if trial.kind == "polish"), None),
            start=start[k] if start else None,
            log=objective.target is not None,
        )
        caption = f"Score of every trial in turn: {objective.wish}. Points that break a bound may lie outside."
        pictures.append(draw(f"convergence_{k}", caption, axes))
    return pictures


def _axis_label(objective: Objective) -> str:
    """Quantity of a score, whose name contains the unit."""
    return objective.quantity if objective.target is None else f"|{objective.quantity} − {objective.target:g}|"


def _front_pictures(result: Optimization, chosen: Sequence[Chosen]) -> list[Picture]:
    possible = [trial for trial in result.trials if trial.scores]
    if not possible:
        return []
    place = {trial.name: k for k, trial in enumerate(possible)}
    objectives, start = result.goal.objectives, result.start.scores
    pictures = []
    for i, j in list(itertools.combinations(range(len(objectives)), 2))[:_MOST_FRONTS]:
        ahead: Literal["pre", "post"] = "pre" if objectives[i].maximized else "post"
        axes = plot_front(
            [(trial.scores[i], trial.scores[j]) for trial in possible],
            [trial.feasible for trial in possible],
            [place[trial.name] for trial in result.front],
            labels=(_axis_label(objectives[i]), _axis_label(objectives[j])),
            start=(start[i], start[j]) if start else None,
            named={place[one.trial.name]: one.label for one in chosen},
            stairs=ahead if len(objectives) == 2 else None,
        )
        wishes = " and ".join(objectives[k].wish for k in (i, j))
        pictures.append(draw(f"front_{i}_{j}", f"Pareto front: {wishes}. The star is the given design.", axes))
    return pictures


def _quantities(design: Design, trial: Trial, keys: Sequence[str]) -> dict[str, float]:
    known = dict(trial.quantities)
    evaluation = Evaluation(design)
    for key in keys:
        if key not in known:
            try:
                known[key] = request(key).value(evaluation)
            except CoilarrayError:  # a design without the quantity shows none
                continue
    return known


def _allowed(axis: Axis) -> str:
    if axis.choices:
        return " or ".join(_shown(json.loads(choice)) for choice in axis.choices)
    steps = f", in steps of {axis.step:g}" if axis.step is not None else ", whole" if axis.whole else ""
    return f"{axis.low:g} to {axis.high:g}{steps}"


def _shown(value: Any) -> str:
    return true_minus(f"{value:.5g}") if isinstance(value, float) else value_text(value)


def _significant(digits: int) -> DisplayUnit:
    return DisplayUnit(digits=digits, significant=True)


def spread_table(result: xr.Dataset) -> Table:
    """Return nominal values, both spreads and largest contributors by output."""
    import xarray as xr

    sampled = ("sample_mean", "sample_deviation", "ratio", "ratio_error")
    columns: dict[str, object] = {name: np.nan for name in sampled if name not in result}
    for k, (name, text) in enumerate((("low", "2.5 %"), ("high", "97.5 %"))):
        value = result.percentiles.isel(percentile=k, drop=True) if "percentiles" in result else xr.DataArray(np.nan)
        columns[name] = value.assign_attrs(long_name=text)
    largest = [_largest(result.isel(output=k)) for k in range(result.sizes["output"])]
    columns["largest"] = ("output", largest, {"long_name": "largest shares of the linear variance"})
    names = ("output", "nominal", "linear_deviation", *sampled, "low", "high", "largest")
    shown = {name: _significant(2) for name in ("linear_deviation", "sample_deviation")}
    shown |= {name: _significant(4) for name in ("nominal", "sample_mean", "low", "high")}
    shown |= {name: DisplayUnit(digits=2) for name in ("ratio", "ratio_error")}
    return dataset_table("spread", "Spread", result.assign(columns), names, shown)


def share_table(result: xr.Dataset) -> Table:
    """Return the contributors of every output, the largest first."""
    columns = (
        Column("output"),
        Column("contributor"),
        Column("effect", "effect of 1 σ", "1", _significant(3)),
        Column("share", "share of the variance", "1", PERCENT),
    )
    rows: list[tuple[Value, ...]] = []
    for k, name in enumerate(result.output.values.tolist()):
        at = result.isel(output=k)
        for m in _ranking(at):
            rows.append((name, str(at.contributor.values[m]), float(at.effect[m]), float(at.share[m])))
    return Table("shares", "Contributors", columns, tuple(rows))


def error_table(result: xr.Dataset) -> Table:
    """Return the contributors with distribution and, if assumed, the reason."""
    names = ("contributor", "distribution", "deviation", "unit", "assumed")
    return dataset_table("errors", "Errors", result, names, {"deviation": _significant(3)})


def given_table(result: xr.Dataset) -> Table:
    """Return the tables of a tolerance file with standard deviations."""
    columns = (
        Column("table", "error"), Column("distribution"), Column("board_deviation", "σ of the board", "1"),
        Column("layer_deviation", "σ of a layer", "1"), Column("unit"), Column("assumed"),
    )  # fmt: skip
    rows: list[tuple[Value, ...]] = []
    tables, parts = result.table.values, result.part.values
    names = list(dict.fromkeys(tables.tolist()))
    for name in names:
        there = np.flatnonzero(tables == name)
        of_part: list[Value] = []
        for part in ("board", "layer"):
            found = [k for k in there if parts[k] == part]
            of_part.append(float(result.deviation[found[0]]) if found else "")
        first = result.isel(contributor=there[0])
        rows.append((name, str(first.distribution.values), *of_part, str(first.unit.values), str(first.assumed.values)))
    return Table("given", "Errors", columns, tuple(rows), tuple(_FILE_UNITS[name] for name in names))


def yield_table(result: xr.Dataset) -> Table:
    """Return the share of good boards by limit and overall.

    In the linear model every board can be made. Among the drawn boards, a board that cannot be made
    is bad.
    """
    if "limit" not in result.dims:
        return Table("yield", "Yield", (), ())
    names = ("linear_yield", "sample_yield", "sample_yield_low", "sample_yield_high")
    known = result.assign({name: np.nan for name in names if name not in result})
    return dataset_table("yield", "Yield", known, ("limit", *names), dict.fromkeys(names, PERCENT))


def sample_table(result: xr.Dataset) -> Table:
    """Return errors, outputs and failure of the drawn boards."""
    units = zip(result.contributor.values.tolist(), result.unit.values.tolist(), strict=True)
    columns = (
        *(Column(name if unit == "1" else f"{name} ({unit})") for name, unit in units),
        *map(Column, result.output.values.tolist()),
        Column("failure"),
    )
    boards = zip(result.error.values.tolist(), result.value.values.tolist(), result.failure.values, strict=True)
    rows = tuple((*errors, *map(cell, values), str(failure)) for errors, values, failure in boards)
    return Table("samples", "Boards", columns, rows)


def _largest(at: xr.Dataset) -> str:
    shown = [(str(at.contributor.values[m]), float(at.share[m])) for m in _ranking(at)[:_MOST_SHOWN]]
    return "; ".join(f"{name} {share * 100:.0f} %" for name, share in shown if share >= 0.005)


def _ranking(at: xr.Dataset) -> list[int]:
    return [int(m) for m in np.argsort(-at.share.values, kind="stable")]
