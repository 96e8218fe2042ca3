"""Search over the variables of a goal, with its study on disk, and the local solver.

The sampler of Optuna chooses all points of a batch before any of them is evaluated, and gets their results together, in
the order of the batch. A new sampler with its own seed is made for each point, so its only state is the history. A
point therefore depends only on the goal, its place and the batches before it, but not on the workers, or on how often
the run was killed and resumed.

The study on disk is an Optuna study in SQLite that holds only finished trials. A sampler that works on disk takes one
transaction for every parameter and attribute, 45 ms per trial with six variables. Here it works in memory, and each
finished trial is written in one transaction.

The best point is refined by SciPy's COBYQA, which needs no derivatives (T. M. Ragonneau, Model-Based Derivative-Free
Optimization Methods and Software, PhD thesis, Hong Kong Polytechnic University, 2022): quadratic models in a trust
region, bounds always kept, constraints by sequential quadratic programming. Variables are scaled to the unit box, and
scores by the score of the first point. A distance to a target is squared, which makes it smooth. Whole numbers, steps
and choices are not changed.
"""

from __future__ import annotations

import json
import os
import re
import sqlite3
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.compute.extras import import_extra
from coilarray.compute.files import make_folder
from coilarray.compute.store import content_key, delete_database, locked_database
from coilarray.design.model import Design
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.errors import OutputError
from coilarray.studies.optimize.goal import Goal, Trial, trial_of
from coilarray.studies.optimize.space import Axis, changes_of, distributions_of, start_parameters

if TYPE_CHECKING:
    from optuna.samplers import BaseSampler
    from optuna.storages import RDBStorage
    from optuna.study import Study
    from optuna.trial import FrozenTrial
    from optuna.trial import Trial as AskedTrial

FILE = "study.db"
"""Name of the database in the folder of the results. Any tool for Optuna reads it."""
Outcome: TypeAlias = Mapping[str, float] | str
"""Quantities of a point by name, or the reason why it has none."""
Evaluate: TypeAlias = Callable[[Sequence[Mapping[str, Any]], Accuracy], Iterator[tuple[int, Outcome]]]
"""Function of the changes of several points and an accuracy. It yields the index and outcome of each, in any order."""
_REBUILT = "tpe:"  # prefix of system attributes that no later point reads; storing them costs time
_FIRST_RADIUS = 0.05  # of the unit box; the sampler has explored the rest
_LAST_RADIUS = 1e-7
_WORSE = 10.0  # cost of an impossible point, relative to the first point
_INSIDE = 1e-7  # of a bound: the solver's own tolerance, so that points which it allows are allowed
_MOST_EVALUATIONS = 1_000_000


class StudyFile:
    """Study on disk, made by `open_study`."""

    def __init__(self, study: Study) -> None:
        self._study = study

    def trials(self) -> list[FrozenTrial]:
        """Return every trial, in the order of writing. Raises OutputError for a damaged file."""
        try:
            return self._study.get_trials(deepcopy=False)
        except Exception as error:  # Optuna lets through the errors of SQLAlchemy and of JSON readers
            raise OutputError(f"cannot use {FILE}, it is damaged: {_first_line(error)}.") from None

    def add(self, trial: FrozenTrial) -> None:
        """Write a finished trial completely or not at all. Raises OutputError."""
        from optuna.exceptions import StorageInternalError

        try:
            self._study.add_trial(trial)
        except StorageInternalError as error:
            raise OutputError(f"cannot write {FILE}: {_first_line(error)}.") from None


@contextmanager
def open_study(folder: Path, design: Design, goal: Goal) -> Iterator[StudyFile]:
    """Open or make the study of a goal and a design in a folder, for a ``with`` block.

    The folder may hold studies of other designs and goals too. A study is identified by the code and by the whole goal
    except its trials, polish and watch. Raises OutputError if the file cannot be written or holds something else, or if
    another search is running in the folder, and MissingDependencyError if Optuna is not installed.
    """
    optuna = import_extra("optuna", "studies of an optimisation", package="Optuna", extra="optimize")
    from sqlalchemy import event

    make_folder(folder)
    path = folder / FILE
    busy = f"another search is running in {folder}; wait for it or give another folder."
    with locked_database(folder / "study.lock", busy), quiet():
        there = path.exists()
        try:
            storage = storage_on(path.resolve())
            event.listen(storage.engine, "connect", _without_waiting)
            storage.engine.dispose()  # open connections are not aware of it
            study = optuna.create_study(
                storage=storage, study_name=study_name(design, goal), directions=goal.directions, load_if_exists=True
            )
        except Exception as error:  # Optuna lets through the errors of SQLAlchemy and Alembic
            if not there:
                delete_database(path)
            raise OutputError(f"cannot use {path}: {_first_line(error)}.") from None
        try:
            yield StudyFile(study)
        finally:
            storage.remove_session()
            storage.engine.dispose()


def storage_on(file: Path | str, *, as_it_is: bool = False) -> RDBStorage:
    """Return Optuna's storage on a path or, in SQLite's form, ``file:…?mode=ro``.

    Optuna takes a URL, in which names with %, ? or # are read differently by different versions of SQLAlchemy. A
    database taken `as_it_is` is not completed first.
    """
    from optuna.storages import RDBStorage

    def connect() -> sqlite3.Connection:
        return sqlite3.connect(file, uri=isinstance(file, str), check_same_thread=False)

    url, options = f"sqlite:///{FILE}", {"creator": connect}
    return RDBStorage(url, options, skip_compatibility_check=as_it_is, skip_table_creation=as_it_is)


def points_found(folder: Path, design: Design, goal: Goal) -> int:
    """Return the number of points left by an earlier run, without making files."""
    if not os.path.exists(folder / FILE):  # pathlib raises an error if the folder may not be read
        return 0
    with open_study(folder, design, goal) as store:
        return len(store.trials())


def study_name(design: Design, goal: Goal) -> str:
    """Name of a study: of the design, with a hash of everything that determines the points."""
    key = content_key(design.digest, goal.searched(), metadata.version("optuna"))
    return f"{design.name}-{key[:16]}"


def _without_waiting(connection: sqlite3.Connection, _: object) -> None:
    """Do not wait for the disk at every trial; a power cut loses at most the last ones."""
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = NORMAL")


@contextmanager
def quiet() -> Iterator[None]:
    """Silence Optuna's notes and warnings on standard error."""
    from optuna import logging

    before = logging.get_verbosity()
    logging.set_verbosity(logging.ERROR)
    try:
        yield
    finally:
        logging.set_verbosity(before)


def _first_line(error: Exception) -> str:
    """Return the first line of an error without the class that SQLAlchemy puts before it."""
    line = (str(error).strip().splitlines() or [type(error).__name__])[0].rstrip(".")
    return re.sub(r"^\([\w.]+\) ", "", line)


def search(
    goal: Goal,
    axes: Sequence[Axis],
    start: Outcome,
    store: StudyFile,
    evaluate: Evaluate,
    report: Callable[[Trial], None],
) -> list[Trial]:
    """Evaluate the points of a goal that the study lacks, and return all by their places.

    The first point is the design itself, with the outcome `start`, if it lies within the bounds. `report` is called
    with each trial once it is known. Raises OutputError, and MissingDependencyError without the sampler's package.
    """
    if goal.sampler == "cmaes":
        import_extra("cmaes", "searches by cmaes", package="cmaes", extra="optimize")
    memory = _Memory(goal, axes)
    points = [(trial.user_attrs["point"], trial) for trial in store.trials()]
    done = {point["place"]: trial for point, trial in points if point["kind"] == "search"}
    trials: dict[int, Trial] = {}

    def know(place: int, trial: Trial) -> None:
        trials[place] = trial
        report(trial)

    for begin in range(0, goal.search.trials, goal.search.batch):
        batch = range(begin, min(begin + goal.search.batch, goal.search.trials))
        asked: dict[int, AskedTrial] = {}
        for place in batch:
            if place in done:
                memory.recall(done[place])
                know(place, stored_trial(goal, axes, done[place]))
            else:
                asked[place] = memory.ask(place)
        for place, outcome in _outcomes(goal, axes, asked, start, evaluate):
            parameters = asked[place].params
            trial = trial_of(goal, "search", place, changes_of(axes, parameters), outcome, goal.search.accuracy)
            store.add(frozen_trial(axes, parameters, trial, *memory.left_by(place)))
            know(place, trial)
        for place in batch:
            memory.tell(place, trials[place], asked.get(place))
    return [trials[place] for place in sorted(trials)]


def stored_trial(goal: Goal, axes: Sequence[Axis], frozen: FrozenTrial) -> Trial:
    """Return a trial of the study as a `Trial`."""
    point = frozen.user_attrs["point"]
    outcome = point["reason"] or frozen.user_attrs["quantities"]
    accuracy = "full" if point["kind"] == "polish" else goal.search.accuracy
    return trial_of(goal, point["kind"], point["place"], changes_of(axes, frozen.params), outcome, accuracy)


def frozen_trial(
    axes: Sequence[Axis],
    parameters: Mapping[str, Any],
    trial: Trial,
    on_trial: Mapping[str, Any] | None = None,
    on_study: Mapping[str, Any] | None = None,
) -> FrozenTrial:
    """Return a finished trial for the study, with the attributes that a sampler has set.

    An impossible point is marked as pruned.
    """
    from optuna.trial import TrialState, create_trial

    start = trial.name == "search 0" and start_parameters(axes) is not None
    point = {"kind": trial.kind, "place": trial.place, "reason": trial.reason, "start": start}
    return create_trial(
        state=TrialState.PRUNED if trial.reason else TrialState.COMPLETE,
        values=None if trial.reason else list(trial.scores),
        params=dict(parameters),
        distributions=distributions_of(axes),
        user_attrs={
            "point": {**point, "study": dict(on_study or {})},
            "quantities": dict(trial.quantities),
            "changes": dict(trial.changes),  # as evaluated: a parameter is the sampler's own number
        },
        system_attrs=dict(on_trial or {}),
        constraints=dict(trial.violations),
    )


class _Memory:
    """Study in memory on which the sampler works. The number of a trial in it is its place.

    Samplers keep their state as attributes of trials and of the study, which are stored and recalled with a point.
    """

    def __init__(self, goal: Goal, axes: Sequence[Axis]) -> None:
        from optuna import create_study
        from optuna.storages import InMemoryStorage

        self._goal, self._axes = goal, axes
        self._storage = InMemoryStorage()
        self._study = create_study(storage=self._storage, study_name="search", directions=goal.directions)
        self._id = self._storage.get_study_id_from_name("search")
        self._on_study: dict[int, dict[str, Any]] = {}

    def ask(self, place: int) -> AskedTrial:
        """Let the sampler choose a point."""
        self._study.sampler = _sampler(self._goal, place)
        fixed = start_parameters(self._axes) if place == 0 else None
        if fixed is None and self._goal.sampler == "qmc":
            fixed = _sobol_point(self._axes, self._goal.search.seed, place)
        if fixed is not None:
            self._study.enqueue_trial(fixed)
        before = dict(self._storage.get_study_system_attrs(self._id))
        trial = self._study.ask(distributions_of(self._axes))
        after = self._storage.get_study_system_attrs(self._id)
        self._on_study[place] = {key: value for key, value in after.items() if before.get(key) != value}
        return trial

    def left_by(self, place: int) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the attributes that a point has set on the trial and on the study."""
        on_trial = self._study.get_trials(deepcopy=False)[place].system_attrs
        return {key: value for key, value in on_trial.items() if not key.startswith(_REBUILT)}, self._on_study[place]

    def recall(self, stored: FrozenTrial) -> None:
        """Restore a stored trial as its batch's sampler saw it."""
        from optuna.trial import TrialState, create_trial

        for key, value in stored.user_attrs["point"]["study"].items():
            self._storage.set_study_system_attr(self._id, key, value)
        self._study.add_trial(
            create_trial(
                state=TrialState.RUNNING,
                params=stored.params,
                distributions=stored.distributions,
                system_attrs=stored.system_attrs,
            )
        )

    def tell(self, place: int, trial: Trial, asked: AskedTrial | None) -> None:
        """Report the outcome of a point. A recalled point was not `asked`, and has its constraints."""
        from optuna.trial import TrialState

        if asked is not None:
            for key, violation in trial.violations.items():
                asked.set_constraint(key, violation)
        if trial.reason:
            self._study.tell(place, state=TrialState.PRUNED)
        else:
            self._study.tell(place, list(trial.scores))


def _sampler(goal: Goal, place: int) -> BaseSampler:
    """Make the sampler of one point."""
    from optuna import samplers
    from optuna.exceptions import ExperimentalWarning

    seed = int(np.random.SeedSequence([goal.search.seed, place]).generate_state(1)[0])
    match goal.sampler:
        case "tpe":
            return samplers.TPESampler(seed=seed)
        case "nsga2":
            return samplers.NSGAIISampler(seed=seed, population_size=goal.search.population)
        case "nsga3":
            with warnings.catch_warnings():  # the goal names it, experimental or not
                warnings.simplefilter("ignore", ExperimentalWarning)
                return samplers.NSGAIIISampler(seed=seed, population_size=goal.search.population)
        case "cmaes":
            return samplers.CmaEsSampler(seed=seed)
        case "random" | "qmc":
            return samplers.RandomSampler(seed=seed)


def _sobol_point(axes: Sequence[Axis], seed: int, place: int) -> dict[str, Any]:
    """Return a point of a scrambled Sobol sequence in the unit box, as parameters."""
    from scipy.stats import qmc

    sequence = qmc.Sobol(len(axes), seed=seed)
    if place:
        sequence.fast_forward(place)
    return {axis.entry: axis.at(float(part)) for axis, part in zip(axes, sequence.random(1)[0], strict=True)}


def _outcomes(
    goal: Goal, axes: Sequence[Axis], asked: Mapping[int, AskedTrial], start: Outcome, evaluate: Evaluate
) -> Iterator[tuple[int, Outcome]]:
    """Evaluate the points of a batch; that of the start is known in full accuracy."""
    places = list(asked)
    if 0 in asked and start_parameters(axes) is not None and goal.search.accuracy == "full":
        yield places.pop(0), start
    if places:
        changes = [changes_of(axes, asked[place].params) for place in places]
        for index, outcome in evaluate(changes, goal.search.accuracy):
            yield places[index], outcome


def polish_problem(goal: Goal, axes: Sequence[Axis], best: Trial | None) -> str:
    """Return the reason why polishing is impossible in one line, or ""."""
    if len(goal.objectives) > 1:
        return "a goal with several objectives has no single best point to polish."
    if not goal.polish:
        return "the goal asks for none."
    if best is None:
        return "no point of the search keeps all constraints."
    if not any(axis.continuous for axis in axes):
        return "no variable is continuous."
    return ""


def polish(
    goal: Goal, axes: Sequence[Axis], best: Trial, store: StudyFile, evaluate: Evaluate, report: Callable[[Trial], None]
) -> None:
    """Improve the continuous variables of the `best` point of a search with one objective.

    New trials are added to the study, and its trials are not evaluated again. Raises OutputError.
    """
    from scipy.optimize import Bounds, NonlinearConstraint, minimize

    free = [axis for axis in axes if axis.continuous]
    every = (stored_trial(goal, axes, frozen) for frozen in store.trials())
    stored = {json.dumps(trial.changes): trial for trial in every if trial.kind == "polish"}
    seen = {json.dumps(best.changes): best} if goal.search.accuracy == "full" else {}
    unit, tried = abs(best.scores[0]) or 1.0, 0

    def trial_at(point: FloatArray) -> Trial:
        """Return the trial at a point of the unit box. The solver asks for cost and violations separately."""
        nonlocal tried
        parts = zip(free, point.tolist(), strict=True)
        changes = {**best.changes, **{axis.entry: axis.value(axis.at(part)) for axis, part in parts}}
        key = json.dumps(changes)
        if key in seen:  # points closer than the fabrication resolution are one point
            return seen[key]
        if tried >= goal.polish:
            raise _EnoughError
        if key not in stored:
            ((_, outcome),) = evaluate([changes], "full")
            trial = trial_of(goal, "polish", len(stored), changes, outcome)
            parameters = {axis.entry: axis.parameter(changes[axis.entry]) for axis in axes}
            store.add(frozen_trial(axes, parameters, trial))
            stored[key] = trial
        tried += 1
        report(stored[key])
        seen[key] = stored[key]
        return stored[key]

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
        """Return the violation of each bound. An impossible point violates all."""
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
