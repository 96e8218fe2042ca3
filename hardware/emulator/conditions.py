"""Time, temperature, clock and noise around an emulated converter."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

from coilarray.design.readout import INTERNAL_CLOCK, INTERNAL_CLOCK_PER_KELVIN, Readout
from coilarray.errors import HardwareError

ROOM_TEMPERATURE = 25.0
"""Temperature in °C at which the frequency of a converter's clock is given."""

_AHEAD, _BEHIND = 1e-3, 0.05  # s


class VirtualClock:
    """Clock whose time passes only in `sleep`.

    It is a `coilarray.hardware.wire.buses.Clock`. Hours of measuring take seconds.

    Parameters
    ----------
    start : float
        Initial time in s.

    Examples
    --------
    >>> clock = VirtualClock()
    >>> clock.sleep(0.25)
    >>> clock.now()
    0.25
    """

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        """Return the time in s."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Let time pass.

        A time that is not finite raises a HardwareError.
        """
        if not math.isfinite(seconds):
            raise HardwareError(f"a wait must be finite; got {seconds} s.")
        self._now += max(seconds, 0.0)


class PacedClock:
    """Clock of an emulated board in real time.

    Time passes in `sleep` as exactly as on a board, at the pace of the computer's clock. A transfer of 0.1 ms is a
    wait. A computer takes up to twice as long for such a short wait, and its computations in between would be counted
    as well. Therefore the waits are added up, and the computer sleeps only if they are ahead of its own clock. If it
    falls behind by more than `_BEHIND`, time goes on without the board. So a computer that is too slow has fewer scans
    and not slower seconds.
    """

    def __init__(self) -> None:
        self._time = time.monotonic()

    def now(self) -> float:
        """Return the time in s.

        It differs from the computer's time by at most `_BEHIND`.
        """
        self._time = max(self._time, time.monotonic() - _BEHIND)
        return self._time

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        self._time = self.now() + max(seconds, 0.0)
        if (ahead := self._time - time.monotonic()) > _AHEAD:
            time.sleep(ahead)


@dataclass(frozen=True)
class Oscillator:
    """Internal oscillator of one converter.

    Its frequency is 35 to 55 MHz, typically 43.4 MHz, and falls as it warms.

    Parameters
    ----------
    frequency : float
        Frequency at room temperature in Hz.
    temperature_coefficient : float
        Relative change of the frequency with temperature in 1/K.
    ageing : float
        Relative change of the frequency with time in 1/s.

    Examples
    --------
    >>> round(Oscillator().at(0.0, 35.0) - 43.4e6)
    -5642
    """

    frequency: float = INTERNAL_CLOCK
    temperature_coefficient: float = INTERNAL_CLOCK_PER_KELVIN
    ageing: float = 0.0

    def at(self, time: float, temperature: float) -> float:
        """Return the frequency in Hz.

        `time` is in s, and `temperature` is in °C.
        """
        return self.frequency * (
            1 + self.temperature_coefficient * (temperature - ROOM_TEMPERATURE) + self.ageing * time
        )


@dataclass(frozen=True)
class Drift:
    """Temperature of the board over time.

    Parameters
    ----------
    rate : float
        Rate of warming in K/s.
    sway, period : float
        Amplitude in K and period in s of a sinusoidal oscillation of the temperature.
    start : float
        Temperature in °C at the time 0.
    """

    rate: float = 0.0
    sway: float = 0.0
    period: float = 600.0
    start: float = ROOM_TEMPERATURE

    def at(self, time: float) -> float:
        """Return the temperature in °C at a time in s."""
        return self.start + self.rate * time + self.sway * math.sin(2 * math.pi * time / self.period)


@dataclass
class Conditions:
    """Surroundings of the converter, which may change at any time.

    Parameters
    ----------
    oscillator : Oscillator
        Internal oscillator of the converter.
    drift : Drift
        Temperature of the board.
    noise : float
        Relative standard deviation of a frequency at full resolution. By default it is taken from `Readout`.
    clkin : float or None
        Frequency at the pin CLKIN in Hz. None if the pin is grounded.
    first_offset : float
        Error of the first conversion after sleep in codes. Each further conversion has a quarter of it. Users of the
        FDC2214, which has the same core, report tens of thousands. Neither size nor fading is verified.
    """

    oscillator: Oscillator = field(default_factory=Oscillator)
    drift: Drift = field(default_factory=Drift)
    noise: float = Readout().frequency_noise
    clkin: float | None = None
    first_offset: float = 0.0
