"""The converter's internal clock: each chip has its own frequency, which falls as it warms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

CLOCK_RANGE = (35e6, 43.4e6, 55e6)
"""Least, typical and greatest frequency of the internal oscillator in Hz."""
ROOM_TEMPERATURE = 25.0
"""In °C; the frequency of a chip is given there."""


@dataclass(frozen=True)
class Oscillator:
    """Internal oscillator of one chip.

    Parameters
    ----------
    frequency : float
        At room temperature in Hz.
    temperature_coefficient : float
        Relative change in 1/K.
    ageing : float
        Relative change in 1/s.

    Examples
    --------
    >>> round(Oscillator().at(0.0, 35.0) - 43.4e6)
    -5642
    """

    frequency: float = CLOCK_RANGE[1]
    temperature_coefficient: float = -13e-6
    ageing: float = 0.0

    def at(self, time: float, temperature: float) -> float:
        """Frequency in Hz at a time in s and a temperature in °C."""
        return self.frequency * (
            1 + self.temperature_coefficient * (temperature - ROOM_TEMPERATURE) + self.ageing * time
        )


def any_oscillator(seed: int) -> Oscillator:
    """Oscillator of a chip taken at random: anywhere in the range that the data sheet allows."""
    low, _, high = CLOCK_RANGE
    return Oscillator(float(np.random.default_rng(seed).uniform(low, high)))
