"""Coil and capacitor as the converter's oscillator meets them."""

from __future__ import annotations

import math
from dataclasses import dataclass

# IDRIVE codes 0 to 31 in A: table 42 of the data sheet
DRIVE_CURRENTS = tuple(
    1e-6 * microamperes
    for microamperes in (
        16, 18, 20, 23, 28, 32, 40, 46, 52, 59, 72, 82, 95, 110, 127, 146,
        169, 195, 212, 244, 297, 342, 424, 489, 551, 635, 763, 880, 1017, 1173, 1355, 1563,
    )
)  # fmt: skip

AMPLITUDE_STOPS = 0.6
"""Peak voltage in V below which the oscillation stops."""
AMPLITUDE_LOW = 1.2
"""Peak voltage in V below which the converter warns."""
AMPLITUDE_HIGH = 1.8
"""Peak voltage in V above which the converter warns and its clamps act."""


@dataclass(frozen=True)
class Resonator:
    """A tank at its resonance.

    Parameters
    ----------
    frequency : float
        In Hz.
    parallel_resistance : float
        R_p in Ω; infinite without losses.
    quality_factor : float
        Of the whole tank.
    """

    frequency: float
    parallel_resistance: float
    quality_factor: float

    def amplitude(self, current: float) -> float:
        """Peak voltage in V that a drive current in A keeps up: V = 4 R_p I/π (eq. 12).

        Examples
        --------
        >>> round(Resonator(2e6, 33e3, 40.0).amplitude(40e-6), 2)
        1.68
        """
        return 4 * self.parallel_resistance * current / math.pi

    def automatic_drive(self) -> int:
        """Code that the chip's own adjustment ends at: the largest current that stays below the clamps."""
        kept = [code for code, current in enumerate(DRIVE_CURRENTS) if self.amplitude(current) <= AMPLITUDE_HIGH]
        return max(kept, default=0)


def series_tank(inductance: float, capacitance: float, resistance: float) -> Resonator | None:
    """Resonator of L and R in series, across C.

    Parameters
    ----------
    inductance, capacitance, resistance : float
        In H, F and Ω.

    Returns
    -------
    Resonator or None
        Where Im Y = 0: ω² = 1/(LC) − (R/L)², R_p = L/(R C). None where there is no such frequency: R ≥ √(L/C), at
        which nothing oscillates.

    Examples
    --------
    >>> round(series_tank(52.77e-6, 120e-12, 0.0).frequency, -3)
    2000000.0
    """
    squared = 1 / (inductance * capacitance) - (resistance / inductance) ** 2
    if squared <= 0:
        return None
    frequency = math.sqrt(squared) / (2 * math.pi)
    if resistance == 0:
        return Resonator(frequency, math.inf, math.inf)
    return Resonator(
        frequency, inductance / (resistance * capacitance), 2 * math.pi * frequency * inductance / resistance
    )
