"""Search over the variables of a goal: batches of points from an Optuna sampler, the same on every run.

The sampler chooses all points of a batch before any of them is evaluated, and gets their results together, in the order
of the batch. A point therefore depends only on the goal, its place and the batches before it. It does not depend on the
number of workers, on their speed, or on how often the run was killed and resumed. A new sampler with its own seed is
made for each point, so its only state is the history.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from coilarray.compute.extras import import_extra
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.studies.optimize.goal import Goal
from coilarray.studies.optimize.space import Axis, changes_of, distributions_of, start_parameters
from coilarray.studies.optimize.study_file import StudyFile
from coilarray.studies.optimize.trials import Trial, trial_of

if TYPE_CHECKING:
    from optuna.samplers import BaseSampler
    from optuna.trial import FrozenTrial
    from optuna.trial import Trial as AskedTrial

Outcome: TypeAlias = Mapping[str, float] | str
"""Quantities of a point by name, or the reason why it has none."""
Evaluate: TypeAlias = Callable[[Sequence[Mapping[str, Any]], Accuracy], Iterator[tuple[int, Outcome]]]
"""Function of the changes of several points and an accuracy. It yields the index and outcome of each, in any order."""

_REBUILT = "tpe:"  # prefix of system attributes that no later point reads; storing them costs time


def search(
    goal: Goal,
    axes: Sequence[Axis],
    start: Outcome,
    store: StudyFile,
    evaluate: Evaluate,
    report: Callable[[Trial], None],
) -> list[Trial]:
    """Evaluate the points of a goal.

    They are evaluated in the order of their places. Points in the study are not evaluated again. The first point is the
    design itself, if it lies within the bounds. `start` is its outcome. `report` is called with each trial once it is
    known. Raises OutputError if the study cannot be written, and MissingDependencyError if the sampler is cmaes and its
    package is not installed.
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
    """Return a finished trial for the study.

    An impossible point is marked as pruned. `on_trial` and `on_study` are the attributes that a sampler has set on the
    trial and on the study when it chose the point.
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
    """Study in memory on which the sampler works.

    The number of a trial in it is its place. Samplers keep their state as attributes of trials and of the study. The
    attributes that a point has set are stored and recalled with it.
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
        """Return the attributes that a point has set.

        They are set on the trial and on the study. Attributes that no later point reads are left out.
        """
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
        """Report the outcome of a point.

        `asked` is None for a recalled point, which already has its constraints.
        """
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
    """Return a point of a scrambled Sobol sequence, as parameters.

    The sequence covers the unit box.
    """
    from scipy.stats import qmc

    sequence = qmc.Sobol(len(axes), seed=seed)
    if place:
        sequence.fast_forward(place)
    return {axis.entry: axis.at(float(part)) for axis, part in zip(axes, sequence.random(1)[0], strict=True)}


def _outcomes(
    goal: Goal, axes: Sequence[Axis], asked: Mapping[int, AskedTrial], start: Outcome, evaluate: Evaluate
) -> Iterator[tuple[int, Outcome]]:
    """Evaluate the points of a batch.

    The outcome of the start is known, in full accuracy.
    """
    places = list(asked)
    if 0 in asked and start_parameters(axes) is not None and goal.search.accuracy == "full":
        yield places.pop(0), start
    if places:
        changes = [changes_of(axes, asked[place].params) for place in places]
        for index, outcome in evaluate(changes, goal.search.accuracy):
            yield places[index], outcome
