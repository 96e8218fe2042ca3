"""Draw the errors of boards, and compute the spread of their outputs.

With the outputs q, the errors e of the board and independent contributors c that move the errors equally,

    q ≈ q₀ + Σ_c J_c c,   J_c = Σ_(e moved by c) ∂q/∂e,   var q = Σ_c (J_c σ_c)².
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri
from scipy.stats import binomtest, qmc

from coilarray.compute.arrays import BoolArray, FloatArray
from coilarray.errors import GoalError
from coilarray.studies.tolerance.tolerances import Contributor, Limit

Sampling = Literal["sobol", "random"]
"""Scrambled Sobol points, which fill the range of every error evenly and are paired again, or independent points."""
MOST_SAMPLES = 1_000_000
_LEAST_TAIL = 2.0**-40  # a probability of 0 or 1 would lie at infinity
_BLOCK, _MOST_PAIRED = 64, 4096  # boards that are paired at once at first, and from which Sobol's own pairing is good
_WELL_PAIRED = 6  # errors of which 64 Sobol points correlate by 0.2 at the most
_MOST_CLEARED = 0.6  # errors, of the boards of a block, up to which each can be uncorrelated to all before
STEPS = (1.0, 0.5)
"""Half widths of the central differences in standard deviations. The second gives the derivative, both its check."""
LEAST_SAMPLES = 8
"""Smallest number of boards for a sampled spread."""
_ENOUGH = 32  # values whose fourth moment is known to better than its own size, in a normal distribution
CENTRAL = (2.5, 97.5)
"""Percentiles between which 95 % of the boards lie."""


def draw(contributors: Sequence[Contributor], count: int, seed: int = 0, sampling: Sampling = "sobol") -> FloatArray:
    """Draw the errors of boards in SI, shape (count, contributors).

    Equal seeds give equal boards, and a larger count begins with the same boards. A power of 2 from 64 on suits Sobol
    points best. Raises GoalError if the count or the seed is not allowed, or there are more contributors than
    dimensions of Sobol points.
    """
    if not 0 <= count <= MOST_SAMPLES:
        raise GoalError(f"samples must be 0 to {MOST_SAMPLES}; got {count}.")
    if seed < 0:
        raise GoalError(f"seed must not be negative; got {seed}.")
    if sampling == "sobol":
        dimensions = len(contributors)
        if dimensions > qmc.Sobol.MAXDIM:
            raise GoalError(f"Sobol points have at most {qmc.Sobol.MAXDIM} dimensions; got {dimensions} errors.")
        random = np.random.default_rng(seed)
        sequence = qmc.Sobol(dimensions, scramble=True, seed=random)
        quantiles = _paired(sequence.random_base2(max(count - 1, _BLOCK - 1).bit_length()), random)[:count]
    else:
        quantiles = np.random.default_rng(seed).random((count, len(contributors)))
    quantiles = np.clip(quantiles, _LEAST_TAIL, 1 - _LEAST_TAIL)
    uniform = np.array([one.distribution == "uniform" for one in contributors])
    unit = np.where(uniform, np.sqrt(3) * (2 * quantiles - 1), ndtri(quantiles))
    return np.asarray(unit * [one.deviation for one in contributors])


def _paired(points: FloatArray, random: np.random.Generator) -> FloatArray:
    """Pair the coordinates of Sobol points again, without correlation.

    `points` have the shape (n, dimensions). For some pairs of the first 36 dimensions 64 Sobol points have correlations
    of 0.7, which made the spread of two errors wrong by 20 %. After pairing the correlations are 0.09. Each block of
    64, 64, 128, … points keeps its values of each coordinate, of which every equal part of its range has a single
    value. The order of the values is the order of random numbers, from which the correlation with the earlier
    coordinates is removed (Owen, J. Am. Stat. Assoc. 89, 1517, 1994).
    """
    if points.shape[1] <= _WELL_PAIRED:
        return points
    paired = points.copy()
    low, high = 0, _BLOCK
    while low < min(len(points), _MOST_PAIRED):
        boards, errors = points[low:high].shape
        cleared = errors if errors <= _MOST_CLEARED * boards else boards // 4
        before = np.full((boards, 1), boards**-0.5)  # orthonormal columns
        for k in range(errors):
            order = np.asarray(random.standard_normal(boards))
            order = order - before @ (before.T @ order)
            paired[low:high, k][np.argsort(order, kind="stable")] = np.sort(points[low:high, k])
            if k < cleared:
                score = np.asarray(ndtri(np.clip(paired[low:high, k], _LEAST_TAIL, 1 - _LEAST_TAIL)))
                score = score - before @ (before.T @ score)
                before = np.column_stack((before, score / np.linalg.norm(score)))
        low, high = high, 2 * high
    return paired


def errors_of(contributors: Sequence[Contributor], values: npt.ArrayLike) -> dict[str, float]:
    """Add up contributions (contributors,) in SI to every error of one board, by name."""
    errors: dict[str, float] = {}
    for one, value in zip(contributors, np.asarray(values, dtype=np.float64).tolist(), strict=True):
        for target in one.targets:
            errors[target] = errors.get(target, 0.0) + value
    return errors


def error_steps(contributors: Sequence[Contributor]) -> dict[str, float]:
    """Return the standard deviation in SI of every moved error, in the order of contributors."""
    variances: dict[str, float] = {}
    for one in contributors:
        for target in one.targets:
            variances[target] = variances.get(target, 0.0) + one.deviation**2
    return {target: math.sqrt(variance) for target, variance in variances.items()}


def difference_points(steps: dict[str, float]) -> list[dict[str, float]]:
    """Errors of the boards that `Sensitivity` needs: above and below, for each of `STEPS`."""
    return [{name: sign * part * step} for name, step in steps.items() for part in STEPS for sign in (1.0, -1.0)]


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Effects J_c σ_c of one standard deviation of every contributor in the units of the outputs.

    `effects` come from the smaller step and `wide_effects` from the larger step. Both have the shape (contributors,
    outputs). If they differ much, the output is not linear over the errors.
    """

    effects: FloatArray
    wide_effects: FloatArray

    @property
    def deviation(self) -> FloatArray:
        """Standard deviation of every output, shape (outputs,)."""
        return np.asarray(np.sqrt((self.effects**2).sum(axis=0)))

    @property
    def shares(self) -> FloatArray:
        """Share of every contributor in the variance of every output, 0 without variance."""
        variance = (self.effects**2).sum(axis=0)
        return np.asarray(np.divide(self.effects**2, variance, out=np.zeros_like(self.effects), where=variance > 0))

    @property
    def step_change(self) -> FloatArray:
        """Largest change of an effect by the larger step, in deviations of the output."""
        change = np.abs(self.wide_effects - self.effects).max(axis=0)
        deviation = self.deviation
        return np.asarray(np.divide(change, deviation, out=np.zeros_like(change), where=deviation > 0))

    def joined(self, other: Sensitivity) -> Sensitivity:
        """Append the outputs of another sensitivity with the same contributors."""
        return Sensitivity(np.hstack((self.effects, other.effects)), np.hstack((self.wide_effects, other.wide_effects)))

    def through(self, matrix: FloatArray) -> Sensitivity:
        """Return the sensitivity of linear functions (others, outputs) of the outputs."""
        return Sensitivity(self.effects @ matrix.T, self.wide_effects @ matrix.T)


def sensitivity(contributors: Sequence[Contributor], steps: dict[str, float], values: FloatArray) -> Sensitivity:
    """Compute the sensitivity from the outputs (points, outputs) at all `difference_points`."""
    names = list(steps)
    pairs = values.reshape(len(names), len(STEPS), 2, -1)
    spans = 2 * np.outer(list(steps.values()), STEPS)[..., None]
    wide, narrow = np.moveaxis((pairs[:, :, 0] - pairs[:, :, 1]) / spans, 1, 0)
    moved = np.zeros((len(contributors), len(names)))
    for k, one in enumerate(contributors):
        moved[k, [names.index(target) for target in one.targets]] = one.deviation
    return Sensitivity(moved @ narrow, moved @ wide)


def deviation_error(values: FloatArray) -> FloatArray:
    """Estimate the standard error of a sampled standard deviation of values (n, …).

    var(s²) = (μ₄ − s⁴ (n − 3)/(n − 1))/n for any distribution with fourth central moment μ₄, and ds = ds²/2s. A normal
    distribution has s/√(2(n − 1)) (Kendall & Stuart, The Advanced Theory of Statistics, vol. 1, ch. 10). It is taken as
    the lower limit if there are too few values to determine μ₄. For Sobol points the estimate is too large rather than
    too small.
    """
    n = len(values)
    variance = values.var(axis=0, ddof=1)
    fourth = ((values - values.mean(axis=0)) ** 4).mean(axis=0)
    of_variance = np.sqrt(np.maximum(fourth - variance**2 * (n - 3) / (n - 1), 0.0) / n)
    deviation = np.sqrt(variance)
    error = np.divide(of_variance, 2 * deviation, out=np.zeros_like(deviation), where=deviation > 0)
    return np.asarray(error if n >= _ENOUGH else np.maximum(error, deviation / np.sqrt(2 * (n - 1))))


def kept(limits: Sequence[Limit], names: Sequence[str], values: FloatArray) -> BoolArray:
    """Whether boards (n, outputs) keep limits, shape (n, limits). NaN keeps no limit."""
    columns = values[:, [names.index(limit.quantity) for limit in limits]]
    low, high = np.array([limit.at_least for limit in limits]), np.array([limit.at_most for limit in limits])
    return np.asarray((columns >= low) & (columns <= high))


@dataclass(frozen=True)
class Yield:
    """Share of good boards with Wilson's interval, which holds the true share with 95 %.

    Boards of Sobol points are not independent, and reach this only approximately.
    """

    share: float
    low: float
    high: float


def yield_of(good: int, count: int) -> Yield:
    """Return the share of `good` boards among drawn boards."""
    interval = binomtest(good, count).proportion_ci(0.95, method="wilson")
    return Yield(good / count, float(interval.low), float(interval.high))
