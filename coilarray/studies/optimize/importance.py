"""Importance of the variables: PED-ANOVA over the points of a search.

S. Watanabe, A. Bansal, F. Hutter, PED-ANOVA: Efficiently Quantifying Hyperparameter Importance in Arbitrary Subspaces,
IJCAI 2023. For each variable, how differently it is distributed among the best tenth of the points than among all of
them, by the Pearson divergence; the numbers of all variables add up to 1. A variable of no importance may still matter
beside another one, or outside the region that was searched.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from coilarray.studies.optimize.goal import Goal
from coilarray.studies.optimize.space import Axis, distributions_of
from coilarray.studies.optimize.study_file import quiet
from coilarray.studies.optimize.trials import Trial

LEAST_POINTS = 30
"""Smallest number of feasible points for an importance; the best tenth of fewer would be two points."""


def importance(goal: Goal, axes: Sequence[Axis], trials: Sequence[Trial]) -> list[dict[str, float]]:
    """Return for each objective the share of each variable in reaching the best tenth of the points, the largest first.

    Only feasible points of the search count: those of the local solver lie close together and would say little. Empty
    where there are fewer than `LEAST_POINTS` of them, or where all are equal.
    """
    from optuna import create_study
    from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances
    from optuna.trial import create_trial

    points = [trial for trial in trials if trial.kind == "search" and trial.feasible]
    if len(points) < LEAST_POINTS:
        return [{} for _ in goal.objectives]
    distributions = distributions_of(axes)
    parts = []
    for k, direction in enumerate(goal.directions):
        with quiet():
            study = create_study(direction=direction)
        for point in points:
            parameters = {axis.entry: axis.parameter(point.changes[axis.entry]) for axis in axes}
            study.add_trial(create_trial(params=parameters, distributions=distributions, value=point.scores[k]))
        found = get_param_importances(study, evaluator=PedAnovaImportanceEvaluator())
        parts.append(found if all(math.isfinite(part) for part in found.values()) else {})
    return parts
