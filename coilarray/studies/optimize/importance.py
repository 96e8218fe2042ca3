"""Importance of the variables: PED-ANOVA over the points of a search.

S. Watanabe, A. Bansal, F. Hutter, PED-ANOVA: Efficiently Quantifying Hyperparameter Importance in Arbitrary Subspaces,
IJCAI 2023. The importance of a variable is the Pearson divergence between its distribution among the best tenth of the
points and its distribution among all points. The numbers of all variables add up to 1. A variable of no importance may
still matter in combination with another variable, or outside the searched region.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from coilarray.studies.optimize.goal import Goal
from coilarray.studies.optimize.space import Axis, distributions_of
from coilarray.studies.optimize.study_file import quiet
from coilarray.studies.optimize.trials import Trial

LEAST_POINTS = 30
"""Smallest number of feasible points for an importance. The best tenth of fewer would be two points."""


def importance(goal: Goal, axes: Sequence[Axis], trials: Sequence[Trial]) -> list[dict[str, float]]:
    """Compute the importance of each variable.

    For each objective it is the share of the variable in reaching the best tenth of the points. There is a dictionary
    for each objective, with the largest share first. Only feasible points of the search count. The points of the local
    solver lie too close together. Empty if there are fewer than `LEAST_POINTS` such points, or if all are equal.
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
