"""Spread of drawn boards, and its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import binomtest

from coilarray.compute.arrays import FloatArray
from coilarray.studies.tolerance.tolerances import Limit

BoolArray = npt.NDArray[np.bool_]

LEAST_SAMPLES = 8
"""Smallest number of boards for a sampled spread."""
_ENOUGH = 32  # values whose fourth moment is known to better than its own size, in a normal distribution
CENTRAL = (2.5, 97.5)
"""Percentiles between which 95 % of the boards lie."""


def deviation_error(values: FloatArray) -> FloatArray:
    """Estimate the standard error of a sampled standard deviation.

    The values have the shape (n, …), and the result has their unit and the shape (…,). var(s²) = (μ₄ − s⁴ (n − 3)/(n −
    1))/n for any distribution with fourth central moment μ₄, and ds = ds²/2s. A normal distribution has s/√(2(n − 1))
    (Kendall & Stuart, The Advanced Theory of Statistics, vol. 1, ch. 10). It is taken as the lower limit if there are
    too few values to determine μ₄. For Sobol points the estimate is too large rather than too small.
    """
    n = len(values)
    variance = values.var(axis=0, ddof=1)
    fourth = ((values - values.mean(axis=0)) ** 4).mean(axis=0)
    of_variance = np.sqrt(np.maximum(fourth - variance**2 * (n - 3) / (n - 1), 0.0) / n)
    deviation = np.sqrt(variance)
    error = np.divide(of_variance, 2 * deviation, out=np.zeros_like(deviation), where=deviation > 0)
    return np.asarray(error if n >= _ENOUGH else np.maximum(error, deviation / np.sqrt(2 * (n - 1))))


def kept(limits: Sequence[Limit], names: Sequence[str], values: FloatArray) -> BoolArray:
    """Whether boards keep limits, shape (n, limits).

    The outputs are named and have the shape (n, outputs). NaN keeps no limit.
    """
    columns = values[:, [names.index(limit.quantity) for limit in limits]]
    low, high = np.array([limit.at_least for limit in limits]), np.array([limit.at_most for limit in limits])
    return np.asarray((columns >= low) & (columns <= high))


@dataclass(frozen=True)
class Yield:
    """Share of good boards.

    A board that cannot be made is not good. `low` and `high` are Wilson's interval. For independent boards it contains
    the true share with 95 %. Boards of Sobol points are not independent, and reach this only approximately.
    """

    share: float
    low: float
    high: float


def yield_of(good: int, count: int) -> Yield:
    """Return the share of `good` boards among drawn boards.

    There is at least one drawn board.
    """
    interval = binomtest(good, count).proportion_ci(0.95, method="wilson")
    return Yield(good / count, float(interval.low), float(interval.high))
