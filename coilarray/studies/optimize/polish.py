"""Refinement of the best point of a search with a local solver: SciPy's COBYQA, which needs no derivatives.

T. M. Ragonneau, Model-Based Derivative-Free Optimization Methods and Software, PhD thesis, Hong Kong Polytechnic
University (2022): quadratic models in a trust region, bounds always kept, constraints by sequential quadratic
programming. Variables are scaled to the unit box, and scores by the score of the first point. A distance to a target is
squared, which makes it smooth. Whole numbers, steps and choices are not changed.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.studies.optimize.goal import Goal
from coilarray.studies.optimize.search import Evaluate, frozen_trial, stored_trial
from coilarray.studies.optimize.space import Axis
from coilarray.studies.optimize.study_file import StudyFile
from coilarray.studies.optimize.trials import Trial, trial_of

_FIRST_RADIUS = 0.05  # of the unit box; the sampler has explored the rest
_LAST_RADIUS = 1e-7
_WORSE = 10.0  # cost of an impossible point, relative to the first point
_INSIDE = 1e-7  # of a bound: the solver's own tolerance, so that points which it allows are allowed
_MOST_EVALUATIONS = 1_000_000


def polish_problem(goal: Goal, axes: Sequence[Axis], best: Trial | None) -> str:
    """Return the reason why polishing is impossible.

    It is empty if polishing is possible. The reason is one line.
    """
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
    """Improve the `best` point of a search with one objective.

    Only its continuous variables change. New trials are added to the study. Trials in the study are not evaluated
    again, and the number of trials is limited by the goal. `report` is called with each trial. Raises OutputError if
    the study cannot be written.
    """
    from scipy.optimize import Bounds, NonlinearConstraint, minimize

    local = _Local(goal, axes, best, store, evaluate, report)
    n = len(local.begin)
    constraints = [NonlinearConstraint(local.violations, -np.inf, -_INSIDE)] if best.violations else []
    with suppress(_EnoughError):
        minimize(
            local.cost,
            local.begin,
            method="COBYQA",
            bounds=Bounds(np.zeros(n), np.ones(n)),
            constraints=constraints,
            # the evaluations are counted here
            options={"maxfev": _MOST_EVALUATIONS, "initial_tr_radius": _FIRST_RADIUS, "final_tr_radius": _LAST_RADIUS},
        )


class _EnoughError(Exception):
    """The goal's number of points has been evaluated."""


@dataclass
class _Local:
    """Cost and violations of the points chosen by the solver.

    There is one trial for each point.
    """

    _goal: Goal
    _axes: Sequence[Axis]
    _best: Trial
    _store: StudyFile
    _evaluate: Evaluate
    _report: Callable[[Trial], None]

    def __post_init__(self) -> None:
        goal, axes, best = self._goal, self._axes, self._best
        self._free = [axis for axis in axes if axis.continuous]
        self.begin = np.array([axis.part(best.changes[axis.entry]) for axis in self._free])
        self._tried = 0
        self._seen = {json.dumps(best.changes): best} if goal.search.accuracy == "full" else {}
        stored = [stored_trial(goal, axes, frozen) for frozen in self._store.trials()]
        self._stored = {json.dumps(trial.changes): trial for trial in stored if trial.kind == "polish"}
        self._objective = goal.objectives[0]
        self._unit = abs(best.scores[0]) or 1.0

    def cost(self, point: FloatArray) -> float:
        """Return the value that the solver minimizes.

        It is 1 or −1 at the first point.
        """
        trial = self._at(point)
        if trial.reason:
            return _WORSE
        score = trial.scores[0] / self._unit
        if self._objective.target is not None:
            return score * score
        return -score if self._objective.maximized else score

    def violations(self, point: FloatArray) -> FloatArray:
        """Return the violation of each bound.

        An impossible point violates all bounds.
        """
        trial = self._at(point)
        return np.array([trial.violations.get(key, 1.0) for key in self._best.violations])

    def _at(self, point: FloatArray) -> Trial:
        """Return the trial at a point of the unit box.

        The solver asks for its cost and its violations separately.
        """
        changes = dict(self._best.changes)
        parts = zip(self._free, point.tolist(), strict=True)
        changes |= {axis.entry: axis.value(axis.at(part)) for axis, part in parts}
        key = json.dumps(changes)
        if key in self._seen:  # points closer than the fabrication resolution are one point
            return self._seen[key]
        if self._tried >= self._goal.polish:
            raise _EnoughError
        trial = self._stored.get(key)
        if trial is None:
            ((_, outcome),) = self._evaluate([changes], "full")
            trial = trial_of(self._goal, "polish", len(self._stored), changes, outcome)
            parameters = {axis.entry: axis.parameter(changes[axis.entry]) for axis in self._axes}
            self._store.add(frozen_trial(self._axes, parameters, trial))
            self._stored[key] = trial
        self._tried += 1
        self._report(trial)
        self._seen[key] = trial
        return trial
