"""Optimization of a design: search, points on disk, local solver.

The sampler of Optuna chooses all points of a batch before any is evaluated, and gets their results
in the order of the batch. Each point has a new sampler with its own seed, so it depends only on the
goal, its place and the batches before it, not on the workers. A resumed run chooses the same points
again, and takes their outcomes from disk.

The best point is refined by SciPy's COBYQA (T. M. Ragonneau, PhD thesis, Hong Kong Polytechnic
University, 2022) in the unit box, with scores relative to the first point. A distance to a target
is squared, which makes it smooth. Whole numbers, steps and choices stay.
"""

import csv
import io
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from scipy.optimize import Bounds, NonlinearConstraint, minimize

from coilarray.circuit.coupling import provenance
from coilarray.compute.arrays import FloatArray
from coilarray.compute.extras import import_extra
from coilarray.compute.files import make_folder, write_text, writing
from coilarray.compute.store import Store, content_key, locked_database
from coilarray.compute.workers import open_executor
from coilarray.design.model import Design, DesignFile
from coilarray.design.vary import vary, vary_chosen
from coilarray.design.write import as_file, file_text
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.errors import CoilarrayError, GoalError, OutputError
from coilarray.studies import quantities
from coilarray.studies.optimize.derive import keeping_rules
from coilarray.studies.optimize.goal import (
    Axis,
    Goal,
    Trial,
    axes_of,
    better_than,
    changes_of,
    front_of,
    start_parameters,
    trial_of,
)
from coilarray.studies.sweep import Outcome, evaluate_points

FILE = "points.jsonl"  # file of the points, a line each
Evaluate: TypeAlias = Callable[[Sequence[Mapping[str, Any]], Accuracy], Iterator[tuple[int, Outcome]]]
"""Evaluates changes of points, and yields indices and outcomes."""
SearchProgress: TypeAlias = Callable[[int, int, Trial | None], None]
"""Gets numbers of known and all points, and the best."""
_FIRST_RADIUS = 0.05  # of the unit box; the sampler has explored the rest
_LAST_RADIUS = 1e-7
_WORSE = 10.0  # cost of an impossible point, relative to the first point
_INSIDE = 1e-7  # of a bound: the solver's own tolerance, so that points which it allows are allowed
_MOST_EVALUATIONS = 1_000_000
_DESIGN_NAME = re.compile(r"best\.toml|pareto_\d{2,}\.toml")


@dataclass(frozen=True, eq=False)
class Optimization:
    """Result of an optimization of a design `file` towards a `goal`.

    `axes` are its variables, and `start_inside` tells whether the design lies within their bounds.
    `trials` are of the search, then of earlier runs and of the local solver, and `found` of them
    were known at the start. `front` are the trials that beat the start by the first objective, with
    one objective the best alone, empty if no trial keeps all bounds. `polish_problem` is the reason
    why the local solver did not run.
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
        """Best trial of one objective, None without a gain."""
        return self.front[0] if len(self.goal.objectives) == 1 and self.front else None

    def values(self, trial: Trial) -> Mapping[str, Any]:
        """Return a trial's values by entry, None if missing."""
        return {axis.entry: axis.start for axis in self.axes} if trial.kind == "start" else trial.changes

    def designs(self) -> tuple[Design, ...]:
        """Return the designs of the front in its order."""
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
    """Search for better designs, and continue a killed run.

    Entries that are not variables of the `goal` stay unchanged. Boards that cannot be made are
    excluded, see `keeping_rules`. Every point is written to ``points.jsonl`` in `folder` as soon as
    it is known. `workers` are a number of local processes or an executor, on which the points do
    not depend. `cache` keeps evaluated points. `progress` is a `SearchProgress`. Raises GoalError
    if a variable does not fit the `design` or it lacks a quantity, OutputError if the file cannot
    be used, and MissingDependencyError without Optuna.
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
    with _open_points(Path(folder), file.design, goal, axes) as points:
        found = len(points.trials)
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
                best = next(iter(front_of([trial] if best is None else [best, trial], goal)), None)
            if progress is not None:
                progress(len(seen), total, best)

        tried = _search(goal, axes, points, outcome, evaluate, count)
        best = next(iter(front_of(tried, goal)), None) if single else None
        problem = ""
        if not single:
            problem = "a goal with several objectives has no single best point to polish."
        elif not goal.polish:
            problem = "the goal asks for none."
        elif best is None:
            problem = "no point of the search keeps all constraints."
        elif not any(axis.continuous for axis in axes):
            problem = "no variable is continuous."
        else:
            _polish(goal, axes, best, points, evaluate, count)
        names = {trial.name for trial in tried}
        tried += [trial for trial in points.trials.values() if trial.name not in names]
        tried = _confirmed(goal, start, tried, evaluate)
    inside = start_parameters(axes) is not None
    return Optimization(file, goal, axes, start, inside, tuple(tried), better_than(start, tried, goal), found, problem)


def require_coils(design: Design, goal: Goal) -> None:
    """Raise GoalError if a goal names a missing coil."""
    evaluation = quantities.Evaluation(design)
    for key in goal.quantities:
        for coil in quantities.request(key).coils:
            evaluation.coil(coil)


def study_name(design: Design, goal: Goal) -> str:
    """Design's name with a hash of what determines the points."""
    key = content_key(design.digest, goal.searched(), metadata.version("optuna"))
    return f"{design.name}-{key[:16]}"


def read_studies(folder: Path) -> dict[str, list[dict[str, Any]]]:
    """Read the points of a folder's studies by name."""
    # A point has the objectives of the goal, whether it is the given design (``start``), and the values of a `Trial`.
    path = folder / FILE
    try:
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    except (OSError, ValueError) as error:
        raise OutputError(f"cannot read {path}: {error}.") from None
    studies: dict[str, list[dict[str, Any]]] = {}
    for line in filter(None, lines):
        with suppress(ValueError, TypeError, KeyError, RecursionError):  # a killed run may leave part of a line
            point = json.loads(line)
            studies.setdefault(str(point["study"]), []).append(point)
    if any(lines) and not studies:
        raise OutputError(f"cannot use {path}: it has no points of an optimisation.")
    return studies


class _Points:
    """Points of a study in a file, by `_key`."""

    def __init__(self, path: Path, study: str, goal: Goal, start: Mapping[str, Any] | None) -> None:
        self._path, self._start = path, start
        self._head = {"study": study, "objectives": goal.model_dump(mode="json", by_alias=True)["objective"]}
        self.trials: dict[str, Trial] = {}
        for point in read_studies(path.parent).get(study, []):
            outcome = point["reason"] or point["quantities"]
            accuracy = point["accuracy"]
            trial = trial_of(goal, point["kind"], point["place"], point["changes"], outcome, accuracy)
            self.trials[_key(trial.changes, accuracy)] = trial

    def add(self, trial: Trial) -> None:
        start = trial.name == "search 0" and trial.changes == self._start
        line = json.dumps({**self._head, "start": start, **vars(trial)})
        with writing(self._path), self._path.open("a", encoding="utf-8") as file:
            file.write(f"\n{line}\n")  # on a line of its own, also after part of a line
        self.trials[_key(trial.changes, trial.accuracy)] = trial


def _key(changes: Mapping[str, Any], accuracy: Accuracy) -> str:
    return json.dumps([accuracy, changes])


@contextmanager
def _open_points(folder: Path, design: Design, goal: Goal, axes: Sequence[Axis]) -> Iterator[_Points]:
    # A study is code, design and goal except its trials, polish and watch. A folder has one search at a time.
    import_extra("optuna", "optimisations", package="Optuna", extra="optimize")
    make_folder(folder)
    busy = f"another search is running in {folder}; wait for it or give another folder."
    from optuna import logging

    parameters, before = start_parameters(axes), logging.get_verbosity()
    start = None if parameters is None else changes_of(axes, parameters)
    with locked_database(folder / "points.lock", busy):
        logging.set_verbosity(logging.ERROR)
        try:
            yield _Points(folder / FILE, study_name(design, goal), goal, start)
        finally:
            logging.set_verbosity(before)


def _search(
    goal: Goal,
    axes: Sequence[Axis],
    points: _Points,
    start: Outcome,
    evaluate: Evaluate,
    report: Callable[[Trial], None],
) -> list[Trial]:
    # The first is the design itself, with the outcome `start`, if it lies within the bounds.
    from optuna import create_study, samplers
    from optuna.trial import TrialState

    study = create_study(directions=["maximize" if one.maximized else "minimize" for one in goal.objectives])
    distributions = {axis.entry: axis.distribution() for axis in axes}
    first, accuracy = start_parameters(axes), goal.search.accuracy
    trials: list[Trial] = []
    for begin in range(0, goal.search.trials, goal.search.batch):
        places = range(begin, min(begin + goal.search.batch, goal.search.trials))
        asked = []
        for place in places:
            seed = int(np.random.SeedSequence([goal.search.seed, place]).generate_state(1)[0])
            match goal.sampler:
                case "tpe":
                    study.sampler = samplers.TPESampler(seed=seed)
                case "nsga2":
                    study.sampler = samplers.NSGAIISampler(seed=seed, population_size=goal.search.population)
                case "random":
                    study.sampler = samplers.RandomSampler(seed=seed)
            if place == 0 and first is not None:
                study.enqueue_trial(first)
            asked.append(study.ask(distributions))
        changes = [changes_of(axes, one.params) for one in asked]
        keys = [_key(change, accuracy) for change in changes]
        if begin == 0 and first is not None and accuracy == "full" and keys[0] not in points.trials:
            points.add(trial_of(goal, "search", 0, changes[0], start))
        batch, missing = {}, []
        for k, key in enumerate(keys):
            if (old := points.trials.get(key)) is None:
                missing.append(k)
                continue
            batch[begin + k] = trial_of(goal, "search", begin + k, changes[k], old.reason or old.quantities, accuracy)
            report(batch[begin + k])
        for index, outcome in evaluate([changes[k] for k in missing], accuracy) if missing else ():
            place = begin + missing[index]
            batch[place] = trial_of(goal, "search", place, changes[missing[index]], outcome, accuracy)
            points.add(batch[place])
            report(batch[place])
        for place, one in zip(places, asked, strict=True):
            trial = batch[place]
            for key, violation in trial.violations.items():
                one.set_constraint(key, violation)
            if trial.reason:
                study.tell(one, state=TrialState.PRUNED)
            else:
                study.tell(one, list(trial.scores))
            trials.append(trial)
    return trials


def _polish(
    goal: Goal, axes: Sequence[Axis], best: Trial, points: _Points, evaluate: Evaluate, report: Callable[[Trial], None]
) -> None:
    free = [axis for axis in axes if axis.continuous]
    seen = {_key(best.changes, "full"): best} if goal.search.accuracy == "full" else {}
    count = sum(trial.kind == "polish" for trial in points.trials.values())
    unit, tried = abs(best.scores[0]) or 1.0, 0

    def trial_at(point: FloatArray) -> Trial:
        nonlocal tried, count
        parts = zip(free, point.tolist(), strict=True)
        changes = {**best.changes, **{axis.entry: axis.value(axis.at(part)) for axis, part in parts}}
        key = _key(changes, "full")
        if key in seen:  # points closer than the fabrication resolution are one point
            return seen[key]
        if tried >= goal.polish:
            raise _EnoughError
        if key not in points.trials:
            ((_, outcome),) = evaluate([changes], "full")
            points.add(trial_of(goal, "polish", count, changes, outcome))
            count += 1
        tried += 1
        seen[key] = points.trials[key]
        report(seen[key])
        return seen[key]

    def cost(point: FloatArray) -> float:
        """Return 1 or −1 at the first point."""
        trial = trial_at(point)
        if trial.reason:
            return _WORSE
        score = trial.scores[0] / unit
        if goal.objectives[0].target is not None:
            return score * score
        return -score if goal.objectives[0].maximized else score

    def violations(point: FloatArray) -> FloatArray:
        """Violation of each bound, of all by impossible points."""
        trial = trial_at(point)
        return np.array([trial.violations.get(key, 1.0) for key in best.violations])

    begin = np.array([axis.part(best.changes[axis.entry]) for axis in free])
    with suppress(_EnoughError):
        minimize(
            cost,
            begin,
            method="COBYQA",
            bounds=Bounds(np.zeros(len(begin)), np.ones(len(begin))),
            constraints=[NonlinearConstraint(violations, -np.inf, -_INSIDE)] if best.violations else [],
            # the evaluations are counted here
            options={"maxfev": _MOST_EVALUATIONS, "initial_tr_radius": _FIRST_RADIUS, "final_tr_radius": _LAST_RADIUS},
        )


class _EnoughError(Exception):
    """The goal's number of points has been evaluated."""


def _confirmed(goal: Goal, start: Trial, trials: Sequence[Trial], evaluate: Evaluate) -> list[Trial]:
    """Compute the front in full accuracy with watched quantities."""
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


def write_optimization(result: Optimization, folder: str | Path) -> tuple[Path, ...]:
    """Write the files of an optimization into a folder.

    They are ``trials.csv``, ``result.json`` and the designs: ``best.toml``, or ``pareto_01.toml``
    and so on in the order of the first objective. Designs of an earlier search in the `folder`,
    listed in its ``result.json``, are removed. Raises OutputError. No file of the `result` is left
    half-written.
    """
    folder = Path(folder)
    make_folder(folder)
    names = design_names(result)
    entries = [variable.entry for variable in result.goal.variables]
    quantities = result.goal.quantities
    best = {(trial.kind, trial.place) for trial in result.front}
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["kind", "place", "accuracy", "feasible", "front", *entries, *quantities, "reason"])
    for trial in (result.start, *result.trials):
        about = (trial.kind, trial.place, trial.accuracy, trial.feasible, (trial.kind, trial.place) in best)
        values = (result.values(trial)[entry] for entry in entries)
        cells = (json.dumps(value) if isinstance(value, list) else value for value in values)
        writer.writerow([*about, *cells, *(trial.quantities.get(key, "") for key in quantities), trial.reason])
    texts = {
        "trials.csv": buffer.getvalue(),
        "result.json": json.dumps(result_data(result), indent=1, allow_nan=False) + "\n",
    }
    for name, trial in zip(names, result.front, strict=True):
        texts[name] = trial_text(result.file, trial, Path(name).stem, folder)
    try:
        front = json.loads((folder / "result.json").read_text(encoding="utf-8"))["front"]
        before = [str(design["file"]) for design in front]
    except (OSError, ValueError, TypeError, KeyError, RecursionError):  # no such file, or of another program
        before = []
    for old in before:
        if old not in texts and _DESIGN_NAME.fullmatch(old):
            (folder / old).unlink(missing_ok=True)
    for name, text in texts.items():
        write_text(folder / name, text)
    return tuple(folder / name for name in texts)


def design_names(result: Optimization) -> tuple[str, ...]:
    """Names of the design files in the front's order."""
    if len(result.goal.objectives) == 1:
        return ("best.toml",) * len(result.front)
    return tuple(f"pareto_{k + 1:02d}.toml" for k in range(len(result.front)))


def trial_text(file: DesignFile, trial: Trial, label: str, folder: Path) -> str:
    """Design file of a trial for a `folder`, named after design and `label`."""
    # Entries that were chosen are no longer marked as assumed.
    design = file.design
    document = vary_chosen(file.document, trial.changes)
    document["name"] = f"{design.name}-{label}"
    document["title"] = f"{design.title or design.name} – {label}"
    found = ", ".join(f"{key} = {value:.6g}" for key, value in trial.quantities.items())
    text = file_text(replace(file, document=document), folder)
    return f"# {design.name} as changed by coilarray optimize ({trial.name}): {found}\n\n{text}"


def result_data(result: Optimization) -> dict[str, Any]:
    """Return the data that `write_optimization` writes as JSON."""
    goal = result.goal
    return {
        "schema": 1,
        "provenance": provenance(result.design),
        "goal": goal.model_dump(mode="json", by_alias=True, exclude_none=True),
        "sampler": goal.sampler,
        "trials": len(result.trials),
        "found": result.found,
        "polish_problem": result.polish_problem,
        "start_inside": result.start_inside,
        "start": _record(result.start, result.values(result.start)),
        "front": [
            {"file": name, **_record(trial, trial.changes)}
            for name, trial in zip(design_names(result), result.front, strict=True)
        ],
    }


def _record(trial: Trial, values: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "trial": trial.name,
        "accuracy": trial.accuracy,
        "feasible": trial.feasible,
        "entries": dict(values),
        "quantities": dict(trial.quantities),
        "violations": dict(trial.violations),
        "reason": trial.reason,
    }
