"""Evaluated points of a search, and the best of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import xarray as xr

from coilarray.electromagnetics.inductance import Accuracy
from coilarray.studies.optimize.goal import Goal
from coilarray.studies.sweep import UNREAD, Sweep, is_read, keeps_rules

_ROUNDING = 1e-9  # of a score: less is not a gain
RULES = ("fab_margin_mm", "fab_broken")
"""Quantities by which a goal treats the fabrication rules."""


@dataclass(frozen=True)
class Trial:
    """An evaluated point of a search.

    Parameters
    ----------
    kind : {"start", "search", "polish"}
        Origin of the point: the design itself if it lies outside the bounds, the sampler, or the local solver.
    place : int
        Number of the point among the points of its kind, from 0.
    changes : mapping of str to object
        Changed entries of the design, in the units of their keys. Empty for the start.
    quantities : mapping of str to float
        Values by name, in the unit of the name. Empty for an impossible point.
    scores : tuple of float
        Score of every objective, see `Goal.scores`. Empty for an impossible point.
    violations : mapping of str to float
        Violation of every bound, see `Goal.violations`.
    reason : str
        Reason why the point is impossible, in one line. Empty for a possible point.
    accuracy : {"full", "screen"}
        Accuracy of the inductances, see `coilarray.electromagnetics.inductance.Accuracy`.
    """

    kind: Literal["start", "search", "polish"]
    place: int
    changes: Mapping[str, Any]
    quantities: Mapping[str, float]
    scores: tuple[float, ...]
    violations: Mapping[str, float]
    reason: str = ""
    accuracy: Accuracy = "full"

    @property
    def feasible(self) -> bool:
        """Whether the point is possible and keeps every bound."""
        return not self.reason and all(violation <= 0 for violation in self.violations.values())

    @property
    def name(self) -> str:
        """Kind and place, such as "search 12"."""
        return self.kind if self.kind == "start" else f"{self.kind} {self.place}"


def trial_of(
    goal: Goal,
    kind: Literal["start", "search", "polish"],
    place: int,
    changes: Mapping[str, Any],
    outcome: Mapping[str, float] | str,
    accuracy: Accuracy = "full",
) -> Trial:
    """Judge a point by a goal.

    `outcome` is the reason why the point has no quantities, or the quantities of the goal by name. Merely watched
    quantities may be missing.
    """
    if isinstance(outcome, str):
        return Trial(kind, place, changes, {}, (), {}, outcome, accuracy)
    values = {key: float(outcome[key]) for key in goal.quantities if key in outcome}
    return Trial(kind, place, changes, values, goal.scores(values), goal.violations(values), accuracy=accuracy)


def best_of(trials: Sequence[Trial], goal: Goal) -> Trial | None:
    """Return the feasible trial with the best score.

    The goal has one objective. Of equal trials it is the first.
    """
    sign = -1 if goal.objectives[0].maximized else 1
    return min((trial for trial in trials if trial.feasible), key=lambda trial: sign * trial.scores[0], default=None)


def front_of(trials: Sequence[Trial], goal: Goal) -> tuple[Trial, ...]:
    """Return the Pareto front of the trials.

    It is in the order of the first objective. It consists of feasible trials that no other trial beats. Of equal trials
    it has only one.
    """
    signs = [-1 if objective.maximized else 1 for objective in goal.objectives]
    scores = {k: trial.scores for k, trial in enumerate(trials) if trial.feasible}
    return tuple(trials[k] for k in unbeaten(scores, signs))


def unbeaten(scores: Mapping[int, Sequence[float]], signs: Sequence[int]) -> list[int]:
    """Return the numbers of the Pareto front's points.

    They are sorted by the first score. A sign of −1 marks a maximum.
    """
    costs = {k: [sign * score for sign, score in zip(signs, of, strict=True)] for k, of in scores.items()}
    front: list[int] = []
    # sorted by all costs, a point is not beaten by a later point
    for k in sorted(costs, key=lambda k: costs[k]):
        if not any(all(a <= b for a, b in zip(costs[other], costs[k], strict=True)) for other in front):
            front.append(k)
    return front


def better_than(start: Trial, trials: Sequence[Trial], goal: Goal) -> tuple[Trial, ...]:
    """Return the Pareto front of the start and the trials.

    The start and trials that are equally good but for rounding are left out. The front is empty if no trial is better
    than the start in any objective. It is complete if the start breaks a bound.
    """
    signs = [-1 if objective.maximized else 1 for objective in goal.objectives]

    def gains(trial: Trial) -> bool:
        pairs = zip(signs, trial.scores, start.scores, strict=True)
        return any(sign * (before - now) > _ROUNDING * abs(before) for sign, now, before in pairs)

    front = front_of((start, *trials), goal)
    return tuple(trial for trial in front if trial.kind != "start" and (not start.feasible or gains(trial)))


def best_points(plan: Sweep, result: xr.Dataset, goal: Goal) -> tuple[Trial, ...]:
    """Return the best points of a sweep by a goal.

    They are the best point, or the Pareto front for several objectives. They are empty if no point keeps all bounds.
    The result has the quantities of the goal, as `coilarray.sweep` returns it. Points that break fabrication rules, and
    points that no converter can read, are left out, unless the goal treats them itself.
    """
    free = any(name.startswith(RULES) for name in goal.quantities)
    kept, read = (of(result).values.ravel().tolist() for of in (keeps_rules, is_read))
    any_read = UNREAD in goal.quantities
    columns = {key: result[key].values.ravel().tolist() for key in goal.quantities}
    reasons = result.reason.values.ravel().tolist()
    trials = []
    for k, changes in enumerate(plan.points):
        values = {key: column[k] for key, column in columns.items()}
        reason = reasons[k] or ("" if all(map(math.isfinite, values.values())) else "it lacks a quantity.")
        reason = reason or ("" if free or kept[k] else "it breaks fabrication rules.")
        reason = reason or ("" if any_read or read[k] else "no LDC1614 can read it.")
        trials.append(trial_of(goal, "search", k, changes, reason or values, plan.accuracy))
    return front_of(trials, goal)
