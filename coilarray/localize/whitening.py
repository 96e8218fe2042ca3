"""Whitening of readings and slopes, with noise that is partly common to all coils.

The drift of a clock or a capacitor of all coils changes every δ by one random number. With D the variances of the noise
that is independent from state to state, and C the drift of every state by every common cause,

    Σ = D + C Cᵀ,      W = (1 − P Γ Pᵀ) D^(−1/2),      D^(−1/2) C = P S Qᵀ,      Γ = 1 − (1 + S²)^(−1/2),

has W Σ Wᵀ = 1, so that χ² = |W e|² for residuals e, and the Fisher information is (W J)ᵀ (W J). For a single cause,
with u = D^(−1/2) c, it is P = u/|u| and Γ = 1 − 1/√(1 + |u|²).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from coilarray.compute.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Whitening:
    """Whitening W of one covariance or many.

    Many covariances, one for each reading, are on leading axes.

    Parameters
    ----------
    deviations : ndarray, shape (…, states)
        Roots of D.
    directions : ndarray, shape (…, states, rank)
        P, orthonormal. The rank is 0 without common causes.
    shares : ndarray, shape (…, rank)
        Γ.
    """

    deviations: FloatArray
    directions: FloatArray
    shares: FloatArray

    def slopes(self, values: FloatArray) -> FloatArray:
        """Return W times columns (…, states, columns)."""
        scaled = values / self.deviations[..., None]
        if not self.shares.shape[-1]:
            return np.asarray(scaled)
        along = self.directions.swapaxes(-1, -2) @ scaled
        return np.asarray(scaled - self.directions @ (self.shares[..., None] * along))

    def residuals(self, values: FloatArray) -> FloatArray:
        """Return W times values of every state, shape (…, states)."""
        return self.slopes(values[..., None])[..., 0]

    def chi_square(self, values: FloatArray) -> FloatArray:
        """χ² of residuals (…, states), shape (…)."""
        return np.asarray((self.residuals(values) ** 2).sum(axis=-1))

    def of(self, rows: Any) -> Whitening:
        """Take some of many covariances by an index of the leading axis; a single one is for all."""
        if self.deviations.ndim == 1:
            return self
        return Whitening(self.deviations[rows], self.directions[rows], self.shares[rows])


def whitening(deviations: FloatArray, common: FloatArray) -> Whitening:
    """Make W from independent deviations and common drifts.

    The standard deviations (…, states) are positive. The common drifts have the shape (states, causes).

    Examples
    --------
    >>> W = whitening(np.array([3e-7, 3e-7]), np.array([[4e-6], [4e-6]]))
    >>> covariance = np.diag([9e-14, 9e-14]) + 16e-12
    >>> np.round(W.slopes(W.slopes(covariance).T), 9) + 0.0
    array([[1., 0.],
           [0., 1.]])
    """
    directions, sizes, _ = np.linalg.svd(common / deviations[..., None], full_matrices=False)
    return Whitening(deviations, directions, 1 - 1 / np.sqrt(1 + sizes**2))
