"""Optimization of a design: the start, the search, the local solver and the result."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from coilarray.compute.store import Store
from coilarray.compute.workers import open_executor
from coilarray.design.model import Design, DesignFile
from coilarray.design.vary import vary
from coilarray.design.write import as_file
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.errors import CoilarrayError, GoalError
from coilarray.studies import quantities
from coilarray.studies.optimize.derive import keeping_rules
from coilarray.studies.optimize.goal import Goal, Trial, best_of, better_than, trial_of
from coilarray.studies.optimize.search import (
    Evaluate,
    Outcome,
    open_study,
    polish,
    polish_problem,
    search,
    stored_trial,
)
from coilarray.studies.optimize.space import Axis, axes_of, start_parameters
from coilarray.studies.points import evaluate_points

SearchProgress: TypeAlias = Callable[[int, int, Trial | None], None]
"""Function of the number of known points, their largest number, and the best point of a single objective."""


@dataclass(frozen=True, eq=False)
class Optimization:
    """Result of an optimization.

    `axes` are the variables. `file` and `start` are the design from which the search started, and `start_inside` is
    whether it lies within the bounds of the variables. `goal` has at least as many trials as an earlier run. `trials`
    are of the search, then of the local solver, including the `found` trials of earlier runs. `front` are the trials
    that are better than the start by the first objective, with one objective the best alone, and empty if no trial
    keeps all bounds. `polish_problem` is the reason why the local solver did not run.
    """

    file: DesignFile
    goal: Goal
    axes: tuple[Axis, ...]
    start: Trial
    start_inside: bool
    trials: tuple[Trial, ...]
    front: tuple[Trial, ...]
    found: int
    polish_problem: str

    @property
    def design(self) -> Design:
        """The given design."""
        return self.file.design

    @property
    def best(self) -> Trial | None:
        """Best trial of one objective, None if none is better than the start."""
        return self.front[0] if len(self.goal.objectives) == 1 and self.front else None

    def values(self, trial: Trial) -> Mapping[str, Any]:
        """Return the variables' values of a trial by entry, None where the start has none.

        Returns
        -------
        mapping of str to object
            Value in the unit of the entry, by the entry.
        """
        return {axis.entry: axis.start for axis in self.axes} if trial.kind == "start" else trial.changes

    def designs(self) -> tuple[Design, ...]:
        """Return the designs of the front.

        Returns
        -------
        tuple of Design
            A design for every point of the front, in its order.
        """
        return tuple(vary(self.file, trial.changes) for trial in self.front)


def optimize_design(
    design: Design | DesignFile,
    goal: Goal,
    folder: str | Path,
    workers: int | Executor = 1,
    cache: Store | None = None,
    *,
    progress: SearchProgress | None = None,
) -> Optimization:
    """Search from a design for better designs, and continue a killed run.

    Entries that are not variables of the goal stay unchanged. Boards that cannot be made are excluded, see
    `keeping_rules`. `folder` has the study, ``study.db``. `workers` are a number of local processes or an executor, on
    which the points do not depend. `cache` keeps evaluated points. `progress` is a `SearchProgress`. Raises GoalError
    if a variable does not fit the design or it lacks a quantity, OutputError if the study cannot be used, and
    MissingDependencyError without Optuna.

    Returns
    -------
    Optimization
        All trials, the best designs and the input of the search.
    """
    file = as_file(design)
    require_coils(file.design, goal)
    goal = keeping_rules(goal, file)

    with open_executor(workers) as executor:

        def evaluate(changes: Sequence[Mapping[str, Any]], accuracy: Accuracy) -> Iterator[tuple[int, Outcome]]:
            points = evaluate_points(file, changes, goal.quantities, executor, cache, accuracy=accuracy)
            for index, outcome in points:
                if isinstance(outcome, str) and not changes[index]:
                    try:
                        quantities.evaluate(file.design, goal.quantities)
                    except GoalError:  # the start lacks a coil or an indentation
                        raise
                    except CoilarrayError:  # it may disappear in the search
                        pass
                yield index, outcome

        return optimize_with(design, goal, folder, evaluate, progress=progress)


def optimize_with(
    design: Design | DesignFile,
    goal: Goal,
    folder: str | Path,
    evaluate: Evaluate,
    *,
    progress: SearchProgress | None = None,
) -> Optimization:
    """Search as `optimize_design` does, with any `Evaluate` function."""
    file = as_file(design)
    axes = axes_of(goal, file)
    inside = start_parameters(axes) is not None
    with open_study(Path(folder), file.design, goal) as store:
        points = [trial.user_attrs["point"] for trial in store.trials()]
        found = len(points)
        known = max((point["place"] + 1 for point in points if point["kind"] == "search"), default=0)
        if known > goal.search.trials:  # no known point is left out
            goal = goal.model_copy(update={"search": goal.search.model_copy(update={"trials": known})})
        ((_, outcome),) = evaluate([{}], "full")
        start = trial_of(goal, "start", 0, {}, outcome)
        single = len(goal.objectives) == 1
        total = goal.search.trials + (goal.polish if single else 0)
        seen: list[Trial] = []
        best: Trial | None = None

        def count(trial: Trial) -> None:
            nonlocal best
            seen.append(trial)
            if single:
                best = best_of([trial] if best is None else [best, trial], goal)
            if progress is not None:
                progress(len(seen), total, best)

        tried = search(goal, axes, outcome, store, evaluate, count)
        best = best_of(tried, goal) if single else None
        problem = polish_problem(goal, axes, best)
        if not problem and best is not None:
            polish(goal, axes, best, store, evaluate, count)
        stored = (stored_trial(goal, axes, frozen) for frozen in store.trials())  # also of runs with another start
        polished = sorted((trial for trial in stored if trial.kind == "polish"), key=lambda trial: trial.place)
        tried = _confirmed(goal, start, tried + polished, evaluate)
    return Optimization(file, goal, axes, start, inside, tuple(tried), better_than(start, tried, goal), found, problem)


def require_coils(design: Design, goal: Goal) -> None:
    """Raise GoalError if a goal names a missing coil, before anything is computed."""
    evaluation = quantities.Evaluation(design)
    for key in goal.quantities:
        for coil in quantities.request(key).coils:
            evaluation.coil(coil)


def _confirmed(goal: Goal, start: Trial, trials: Sequence[Trial], evaluate: Evaluate) -> list[Trial]:
    """Compute the front in full accuracy, and watched quantities that it lacks."""
    known = {trial.name: trial for trial in trials}
    full = {
        trial.name
        for trial in trials
        if trial.accuracy == "full" and all(key in trial.quantities for key in goal.quantities)
    }
    while waiting := [trial for trial in better_than(start, list(known.values()), goal) if trial.name not in full]:
        for index, outcome in evaluate([trial.changes for trial in waiting], "full"):
            old = waiting[index]
            known[old.name] = trial_of(goal, old.kind, old.place, old.changes, outcome)
            full.add(old.name)
    return list(known.values())
