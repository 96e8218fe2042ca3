"""Can an LDC1614 drive this coil? Its limits, checked for one channel.

Texas Instruments SNOSCY9A: table 42 (drive current), table 43 (frequencies), section 8.1.5 (amplitude, equation 12).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

REFERENCE = 43.4e6 / 2
"""Reference frequency in Hz: the internal oscillator's typical 43.4 MHz by the divider 2 that one channel needs."""
AMPLITUDE = (1.2, 1.8)
"""Allowed peak voltage of the sensor in V: below it measures poorly, above it the input clamps act."""
_AMPLITUDE_ROUNDING = 0.01  # the rows of the table are rounded to three digits
_SENSOR_FREQUENCY = (1e3, 10e6)
_LARGEST_REFERENCE = 35e6  # with one channel
_DIVIDED_FROM = 8.75e6  # Hz; FIN_DIVIDER must be at least 2 from here
_LARGEST_SHARE_OF_REFERENCE = 0.25
_LARGEST_SHARE_OF_SELF_RESONANCE = 0.8
_SMALLEST_QUALITY = 1.0

# IDRIVE codes 0 to 31: current in µA, smallest and largest R_p in kΩ
_DRIVE = (
    (16, 60.0, 90.0), (18, 51.8, 77.6), (20, 44.6, 66.9), (23, 38.4, 57.6), (28, 33.7, 49.7), (32, 29.5, 42.8),
    (40, 23.6, 36.9), (46, 20.5, 31.8), (52, 18.1, 27.4), (59, 16.1, 23.6), (72, 13.1, 20.4), (82, 11.5, 17.6),
    (95, 9.92, 15.1), (110, 8.57, 13.0), (127, 7.42, 11.2), (146, 6.46, 9.69), (169, 5.58, 8.35), (195, 4.83, 7.20),
    (212, 4.45, 6.21), (244, 3.86, 5.35), (297, 3.17, 4.61), (342, 2.76, 3.97), (424, 2.22, 3.42), (489, 1.93, 2.95),
    (551, 1.71, 2.54), (635, 1.48, 2.19), (763, 1.24, 1.89), (880, 1.07, 1.63), (1017, 0.93, 1.40),
    (1173, 0.80, 1.21), (1355, 0.70, 1.05), (1563, 0.60, 0.90),
)  # fmt: skip


@dataclass(frozen=True)
class Drive:
    """A setting of the sensor drive.

    Parameters
    ----------
    code : int
        IDRIVE, 0 to 31.
    current : float
        In A.
    amplitude : float
        Peak voltage of the sensor in V, 4 R_p I/π.
    """

    code: int
    current: float
    amplitude: float


@dataclass(frozen=True)
class Limit:
    """One limit of the converter.

    Parameters
    ----------
    name : str
        What is limited, with its unit.
    value, low, high : float
        The value and the range it must be in.
    """

    name: str
    value: float
    low: float
    high: float

    @property
    def kept(self) -> bool:
        """True where the value is in the range."""
        return self.low <= self.value <= self.high


def drive_for(parallel_resistance: float) -> Drive | None:
    """Drive setting for a parallel resistance at resonance.

    Parameters
    ----------
    parallel_resistance : float
        R_p in Ω.

    Returns
    -------
    Drive or None
        The largest current whose row of table 42 holds R_p and whose amplitude stays below the clamps; None where
        no row holds R_p.

    Raises
    ------
    ValueError
        A resistance that is not positive.

    Examples
    --------
    >>> drive_for(33e3).code
    6
    >>> drive_for(100.0) is None
    True
    """
    if not parallel_resistance > 0:
        raise ValueError(f"parallel_resistance must be positive; got {parallel_resistance} Ω.")
    fitting = [
        Drive(code, current * 1e-6, 4 * parallel_resistance * current * 1e-6 / math.pi)
        for code, (current, low, high) in enumerate(_DRIVE)
        if low * 1e3 <= parallel_resistance <= high * 1e3
    ]
    # some rows of the table reach past the clamps by a few percent; their neighbours below do not
    below_the_clamps = [drive for drive in fitting if drive.amplitude <= AMPLITUDE[1]]
    return max(below_the_clamps or fitting, key=lambda drive: drive.current, default=None)


def check_channel(
    frequency: float,
    parallel_resistance: float,
    quality_factor: float,
    self_resonance: float = math.inf,
    *,
    reference: float = REFERENCE,
    divider: int = 1,
) -> tuple[Limit, ...]:
    """Check every limit of one channel.

    Parameters
    ----------
    frequency : float
        Of the sensor in Hz.
    parallel_resistance : float
        R_p of the sensor at resonance in Ω.
    quality_factor : float
        Of the sensor.
    self_resonance : float
        Of the coil in Hz.
    reference : float
        f_ref in Hz.
    divider : int
        FIN_DIVIDER, 1 to 15.

    Returns
    -------
    tuple of Limit
        R_p by the drive currents of table 42; channel 0 alone can be driven harder, down to 250 Ω (HIGH_CURRENT_DRV).
        The reference is typical: an uncalibrated internal oscillator may be a fifth lower.

    Raises
    ------
    ValueError
        A value that is not positive.

    Examples
    --------
    >>> all(limit.kept for limit in check_channel(1.9e6, 33e3, 48.0, 8e6))
    True
    >>> [limit.name for limit in check_channel(6e6, 33e3, 48.0) if not limit.kept]
    ['sensor frequency by divider over reference']
    """
    given = {"frequency": frequency, "quality_factor": quality_factor, "self_resonance": self_resonance,
             "reference": reference, "divider": divider}  # fmt: skip
    for name, value in given.items():
        if not value > 0:
            raise ValueError(f"{name} must be positive; got {value}.")
    drive = drive_for(parallel_resistance)
    share = frequency / divider / reference
    limits = [
        Limit("sensor frequency (Hz)", frequency, *_SENSOR_FREQUENCY),
        Limit("sensor frequency by divider over reference", share, 0, _LARGEST_SHARE_OF_REFERENCE),
        Limit("frequency over self-resonance", frequency / self_resonance, 0, _LARGEST_SHARE_OF_SELF_RESONANCE),
        Limit("R_p (Ω)", parallel_resistance, _DRIVE[-1][1] * 1e3, _DRIVE[0][2] * 1e3),
        Limit("quality factor", quality_factor, _SMALLEST_QUALITY, math.inf),
        Limit("reference frequency (Hz)", reference, 0, _LARGEST_REFERENCE),
        Limit("FIN_DIVIDER", divider, 2 if frequency >= _DIVIDED_FROM else 1, 15),
    ]  # fmt: skip
    if drive is not None:
        low, high = AMPLITUDE
        limits.append(
            Limit(
                "amplitude (V peak)",
                drive.amplitude,
                low * (1 - _AMPLITUDE_ROUNDING),
                high * (1 + 2 * _AMPLITUDE_ROUNDING),
            )
        )
    return tuple(limits)


def settle_count(frequency: float, quality_factor: float, reference: float = REFERENCE) -> int:
    """Least SETTLECOUNT, ⌈Q f_ref/(16 f)⌉ and at least 4.

    Raises
    ------
    ValueError
        A value that is not positive.

    Examples
    --------
    >>> settle_count(2e6, 20, 21.7e6)
    14
    """
    for name, value in (("frequency", frequency), ("quality_factor", quality_factor), ("reference", reference)):
        if not value > 0:
            raise ValueError(f"{name} must be positive; got {value}.")
    return max(4, math.ceil(quality_factor * reference / (16 * frequency)))
