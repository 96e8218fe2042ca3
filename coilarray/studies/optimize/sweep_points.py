"""The points of a sweep judged by a goal."""

from __future__ import annotations

import math

import xarray as xr

from coilarray.studies.optimize.goal import Goal
from coilarray.studies.optimize.trials import Trial, front_of, trial_of
from coilarray.studies.sweep import Sweep


def best_points(plan: Sweep, result: xr.Dataset, goal: Goal) -> tuple[Trial, ...]:
    """Return the best point of a sweep by a goal, of several objectives the Pareto front; none where no bound is kept.

    The result has the quantities of the goal, as `coilarray.studies.sweep.run_sweep` returns it.
    """
    columns = {key: result[key].values.ravel().tolist() for key in goal.quantities}
    reasons = result.reason.values.ravel().tolist()
    trials = []
    for k, changes in enumerate(plan.points):
        values = {key: column[k] for key, column in columns.items()}
        reason = reasons[k] or ("" if all(map(math.isfinite, values.values())) else "it lacks a quantity.")
        trials.append(trial_of(goal, "search", k, changes, reason or values, plan.accuracy))
    return front_of(trials, goal)
