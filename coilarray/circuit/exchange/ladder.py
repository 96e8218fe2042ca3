"""Resistance over frequency as resistors and inductors.

It serves programs that know no other elements.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import nnls

from coilarray.compute.arrays import FloatArray

_CORNERS_A_DECADE = 4
_ABOVE = 30.0  # reach of the corners over the highest frequency; eddy currents begin with the frequency squared


@dataclass(frozen=True, eq=False)
class Ladder:
    """Resistor in series with parallel sections.

    Each section is a resistor and an inductor in parallel, and no element is negative. `direct` is the resistance at
    direct current in Ω. `resistances` and `inductances` (sections,) of the sections are in Ω and H.
    """

    direct: float
    resistances: FloatArray
    inductances: FloatArray

    def resistance(self, frequencies: npt.ArrayLike) -> FloatArray:
        """Real part of the impedance in Ω over frequency.

        The frequencies (f,) are in Hz.
        """
        square = self._corner_ratio(frequencies) ** 2
        return np.asarray(self.direct + (self.resistances * square / (1 + square)).sum(axis=-1))

    def inductance(self, frequencies: npt.ArrayLike) -> FloatArray:
        """Imaginary part of the impedance over ω in H.

        It is given at frequencies (f,) in Hz, and falls as the resistance grows.
        """
        return np.asarray((self.inductances / (1 + self._corner_ratio(frequencies) ** 2)).sum(axis=-1))

    def _corner_ratio(self, frequencies: npt.ArrayLike) -> FloatArray:
        """Frequency over the corner of every section, ωL/R.

        The shape is (f, sections).
        """
        omega = 2 * np.pi * np.asarray(frequencies, dtype=np.float64)
        return np.asarray(omega[..., None] * self.inductances / self.resistances)


def fit_ladder(frequencies: FloatArray, resistance: FloatArray) -> Ladder:
    """Fit a ladder to resistances over frequency.

    The resistances (f,) are in Ω, the frequencies (f,) in Hz. The fit takes the least squares of the relative error.

    Notes
    -----
    Every mode of the eddy currents adds R (ωτ)²/(1 + (ωτ)²), which is a section of R and L = τR. With corners on a
    logarithmic grid the rest is a linear fit of numbers that are not negative (Lawson & Hanson, Solving Least Squares
    Problems, 1974, ch. 23).

    Examples
    --------
    >>> f = np.geomspace(1e5, 1e7, 21)
    >>> ladder = fit_ladder(f, 10 + 4 * (f / 3e6) ** 2 / (1 + (f / 3e6) ** 2))
    >>> round(ladder.direct, 1), round(float(ladder.resistance(3e6)), 1)
    (10.0, 12.0)
    """
    low, high = frequencies[0], _ABOVE * frequencies[-1]
    corners = np.geomspace(low, high, 1 + round(_CORNERS_A_DECADE * np.log10(high / low)))
    square = (frequencies[:, None] / corners) ** 2
    columns = np.column_stack((np.ones_like(frequencies), square / (1 + square))) / resistance[:, None]
    scale = columns.max(axis=0)
    found = nnls(columns / scale, np.ones_like(resistance))[0] / scale
    used = found[1:] > 0
    sections = found[1:][used]
    return Ladder(float(found[0]), sections, sections / (2 * np.pi * corners[used]))
