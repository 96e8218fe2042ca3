"""Frequencies of the effect of metal, and interpolation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BarycentricInterpolator

from coilarray.compute.arrays import ComplexArray, FloatArray, NumberArray
from coilarray.errors import MetalError

_INTERPOLATION = 1e-5  # error of the change between the frequencies at which it is computed
_ROUNDING = 1e-9  # of a frequency


def checked_frequencies(frequencies: npt.ArrayLike, *, positive: bool = False) -> FloatArray:
    """Return frequencies (f,) in Hz ≥ 0 (`positive`: > 0), or raise MetalError."""
    found = np.asarray(frequencies, dtype=np.float64)
    allowed = np.isfinite(found) & ((found > 0) if positive else (found >= 0))
    if found.ndim != 1 or not found.size or not allowed.all():
        least = "positive and finite numbers" if positive else "finite numbers of at least 0"
        raise MetalError(f"frequencies must be one row of {least}; got {found} Hz.")
    return found


@dataclass(frozen=True)
class FrequencyBand:
    """Frequencies from `low` to `high` in Hz with Chebyshev nodes.

    ΔL − jΔR/ω over log f has its nearest poles at ±jπ/2, the poles of a single time constant.
    Polynomials through n points of a band of the half width w have an error of ρ⁻ⁿ, ρ = π/(2w) +
    √(π²/(4w²) + 1) (Trefethen, Approximation Theory, ch. 8).
    """

    low: float
    high: float
    error: float = _INTERPOLATION

    @cached_property
    def nodes(self) -> FloatArray:
        """Frequencies in Hz, rising, as many as the band needs."""
        low, high = math.log(self.low), math.log(self.high)
        half = (high - low) / 2
        if half == 0:
            return np.array([self.low])
        pole = np.pi / 2 / half
        count = math.ceil(-math.log(self.error) / math.log(pole + math.hypot(pole, 1)))
        angle = np.pi * (np.arange(count)[::-1] + 0.5) / count
        return np.asarray(np.exp((low + high) / 2 + half * np.cos(angle)))

    @cached_property
    def _lagrange(self) -> BarycentricInterpolator:
        return BarycentricInterpolator(np.log(self.nodes), np.eye(len(self.nodes)))

    def holds(self, frequencies: FloatArray) -> bool:
        """Test whether all frequencies in Hz lie in the band."""
        low, high = frequencies.min(), frequencies.max()
        return bool(low >= self.low * (1 - _ROUNDING) and high <= self.high * (1 + _ROUNDING))

    def shares(self, frequencies: FloatArray) -> FloatArray:
        """Weights (f, nodes) of the values at the nodes, within the band."""
        if not self.holds(frequencies):
            raise MetalError(
                f"the effect of metal is known from {self.low:.6g} to {self.high:.6g} Hz; got {frequencies.min():.6g} "
                f"to {frequencies.max():.6g} Hz."
            )
        if len(self.nodes) == 1:
            return np.ones((len(frequencies), 1))
        return np.asarray(self._lagrange(np.log(frequencies)))


@dataclass(frozen=True, eq=False)
class ChangeOverFrequency:
    """Changes ΔL − jΔR/ω in H at a band's nodes (cases…, nodes, n, n), constant beyond."""

    band: FrequencyBand
    values: NumberArray

    def shares(self, frequencies: FloatArray) -> FloatArray:
        """Weights (f, nodes) of the nodes' values at frequencies in Hz."""
        return self.band.shares(np.clip(frequencies, self.band.low, self.band.high))

    def at(self, frequency: float) -> ComplexArray:
        """Change (cases…, n, n) of all cases at a frequency in Hz."""
        return np.asarray(np.einsum("f,...fij->...ij", self.shares(np.array([frequency]))[0], self.values))

    def of_each(self, frequencies: FloatArray, cases: slice = slice(None)) -> ComplexArray:
        """Change (cases, n, n) of each case at its own frequency in Hz."""
        return np.asarray(np.einsum("cf,cfij->cij", self.shares(frequencies), self.values[cases], optimize=True))
