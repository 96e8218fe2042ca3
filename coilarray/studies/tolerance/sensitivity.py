"""Linearized spread: derivatives by central differences, and the contribution of every error to the variance.

With the outputs q, the errors e of the board and independent contributors c that move the errors equally,

    q ≈ q₀ + Σ_c J_c c,   J_c = Σ_(e moved by c) ∂q/∂e,   var q = Σ_c (J_c σ_c)².
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.studies.tolerance.tolerances import Contributor

STEPS = (1.0, 0.5)
"""Half widths of the central differences in standard deviations. The second gives the derivative, both its check."""


def error_steps(contributors: Sequence[Contributor]) -> dict[str, float]:
    """Return the standard deviation in SI of every moved error.

    The errors are in the order of the contributors.
    """
    variances: dict[str, float] = {}
    for one in contributors:
        for target in one.targets:
            variances[target] = variances.get(target, 0.0) + one.deviation**2
    return {target: math.sqrt(variance) for target, variance in variances.items()}


def difference_points(steps: dict[str, float]) -> list[dict[str, float]]:
    """Errors of the boards that `Sensitivity` needs.

    For each error and each of `STEPS` there is a board above and a board below.
    """
    return [{name: sign * part * step} for name, step in steps.items() for part in STEPS for sign in (1.0, -1.0)]


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Effects of one standard deviation of every contributor.

    The effects are J_c σ_c in the units of the outputs. `effects` come from the smaller step and `wide_effects` from
    the larger step. Both have the shape (contributors, outputs). If they differ much, the output is not linear over the
    errors.
    """

    effects: FloatArray
    wide_effects: FloatArray

    @property
    def deviation(self) -> FloatArray:
        """Standard deviation of every output, shape (outputs,)."""
        return np.asarray(np.sqrt((self.effects**2).sum(axis=0)))

    @property
    def shares(self) -> FloatArray:
        """Share of every contributor in the variance of every output.

        The array has the shape (contributors, outputs). It is 0 for an output without variance.
        """
        variance = (self.effects**2).sum(axis=0)
        return np.asarray(np.divide(self.effects**2, variance, out=np.zeros_like(self.effects), where=variance > 0))

    @property
    def step_change(self) -> FloatArray:
        """Largest change of an effect by the larger step.

        It is given in standard deviations of the output, shape (outputs,).
        """
        change = np.abs(self.wide_effects - self.effects).max(axis=0)
        deviation = self.deviation
        return np.asarray(np.divide(change, deviation, out=np.zeros_like(change), where=deviation > 0))

    def joined(self, other: Sensitivity) -> Sensitivity:
        """Append the outputs of another sensitivity.

        Both have the same contributors.
        """
        return Sensitivity(np.hstack((self.effects, other.effects)), np.hstack((self.wide_effects, other.wide_effects)))

    def through(self, matrix: FloatArray) -> Sensitivity:
        """Return the sensitivity of linear functions of the outputs.

        The matrix has the shape (others, outputs).
        """
        return Sensitivity(self.effects @ matrix.T, self.wide_effects @ matrix.T)


def sensitivity(contributors: Sequence[Contributor], steps: dict[str, float], values: FloatArray) -> Sensitivity:
    """Compute the sensitivity from the outputs of all boards.

    `values` are the outputs at all `difference_points`, shape (points, outputs). `steps` come from `error_steps`.
    """
    names = list(steps)
    pairs = values.reshape(len(names), len(STEPS), 2, -1)
    spans = 2 * np.outer(list(steps.values()), STEPS)[..., None]
    wide, narrow = np.moveaxis((pairs[:, :, 0] - pairs[:, :, 1]) / spans, 1, 0)
    moved = np.zeros((len(contributors), len(names)))
    for k, one in enumerate(contributors):
        moved[k, [names.index(target) for target in one.targets]] = one.deviation
    return Sensitivity(moved @ narrow, moved @ wide)
