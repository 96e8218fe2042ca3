"""Normal distribution between bounds: its probability, and draws from it.

The method is separation of variables (A. Genz, J. Comput. Graph. Stat. 1, 141, 1992). The variables are drawn one after
another, each normal given the variables before it and cut off at its bounds. The product of the probabilities inside
the bounds is the weight of a draw, and its mean is the probability of the box.
"""

from __future__ import annotations

import numpy as np
from scipy.special import log_ndtr, logsumexp, ndtri_exp
from scipy.stats import chi2, qmc

from coilarray.compute.arrays import FloatArray

_DRAWS = 4096  # of a scrambled Sobol sequence


def bounded_normal(
    mean: FloatArray, covariance: FloatArray, low: FloatArray, high: FloatArray, count: int, freedom: float = np.inf
) -> tuple[FloatArray, float]:
    """Draw from a normal distribution of n variables with bounds.

    The bounds have the shape (n,). Returns draws, shape (count, n), and the logarithm of the probability of the box
    before it was cut out. With a finite `freedom` it is Student's distribution, whose scale is only estimated. The
    probability always belongs to the normal distribution.

    Examples
    --------
    >>> draws, probability = bounded_normal(np.zeros(1), np.eye(1), np.zeros(1), np.full(1, np.inf), 1000)
    >>> round(probability, 6), bool((draws >= 0).all()), round(float(draws.mean()), 1)
    (-0.693147, True, 0.8)
    """
    n = len(mean)
    lower = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    parts = np.clip(qmc.Sobol(n + 1, seed=np.random.default_rng(0)).random(_DRAWS), 1e-12, 1 - 1e-12)
    normal, weight = _separated(mean, lower, low, high, parts[:, :n], np.ones(_DRAWS))
    probability = float(logsumexp(weight) - np.log(_DRAWS))
    if np.isfinite(freedom):
        scale = np.sqrt(freedom / chi2.ppf(parts[:, n], freedom))
        normal, weight = _separated(mean, lower, low, high, parts[:, :n], scale)
    shares = np.exp(weight - logsumexp(weight))
    order = np.random.default_rng(0).permutation(_DRAWS)  # every fourth point of the sequence would not fill the space
    kept = np.searchsorted(np.cumsum(shares[order]), (np.arange(count) + 0.5) / count).clip(max=_DRAWS - 1)
    return normal[order[kept]], probability


def _separated(
    mean: FloatArray, lower: FloatArray, low: FloatArray, high: FloatArray, parts: FloatArray, scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Draw points, with the logarithms of their weights.

    `parts` are numbers between 0 and 1.
    """
    normal, weight = np.zeros_like(parts), np.zeros(len(parts))
    for k in range(len(mean)):
        shift = mean[k] + scale * (normal @ lower[k])
        a, b = ((bound[k] - shift) / (scale * lower[k, k]) for bound in (low, high))
        upper = a > 0  # both tails are taken at the left, where logarithms are exact
        left, right = np.where(upper, -b, a), np.where(upper, -a, b)
        below, above = log_ndtr(left), log_ndtr(right)
        mass = above + np.log1p(-np.exp(np.minimum(below - above, -1e-300)))
        at = ndtri_exp(np.minimum(np.logaddexp(below, np.log(parts[:, k]) + mass), above))
        normal[:, k] = np.clip(np.where(upper, -at, at), a, b)
        weight += mass
    return np.clip(mean + scale[:, None] * (normal @ lower.T), low, high), weight
