"""LDC1614 inductance-to-digital converter: code, sensor frequency and inductance.

Equations 1, 3 and 6 of the data sheet, Texas Instruments SNOSCY9A.
"""

from __future__ import annotations

import math

CODE_BITS = 28
"""Width of a conversion result."""
_FULL_SCALE = 1 << CODE_BITS
_DELAY = 5e-9  # s, of the converter's drive


def code_to_frequency(code: int, reference: float, *, divider: int = 1, offset: int = 0) -> float:
    """Sensor frequency of a conversion result, f = divider · f_ref · (code/2²⁸ + offset/2¹⁶).

    Parameters
    ----------
    code : int
        28-bit result. 0 and 0xFFFFFFF are the chip's marks for under- and over-range and are refused.
    reference : float
        Reference frequency f_ref in Hz (clock by its divider).
    divider : int
        FIN_DIVIDER of the channel, 1 to 15.
    offset : int
        OFFSET register of the channel, 0 to 65535.

    Returns
    -------
    float
        In Hz.

    Raises
    ------
    ValueError
        A value outside its range.

    Examples
    --------
    >>> round(code_to_frequency(0x17982F3, 21.7e6))
    2000000
    """
    _check(reference, divider, offset)
    if not 0 < code < _FULL_SCALE - 1:
        raise ValueError(f"code must be 1 to {_FULL_SCALE - 2:#x} (the ends mark a range error); got {code:#x}.")
    return divider * reference * (code / _FULL_SCALE + offset / (1 << 16))


def frequency_to_code(frequency: float, reference: float, *, divider: int = 1, offset: int = 0) -> int:
    """Conversion result nearest to a sensor frequency in Hz; the inverse of `code_to_frequency`.

    Raises
    ------
    ValueError
        A value outside its range, or a frequency that the 28 bits do not hold.

    Examples
    --------
    >>> hex(frequency_to_code(2e6, 21.7e6))
    '0x17982f3'
    """
    _check(reference, divider, offset)
    code = round((frequency / (divider * reference) - offset / (1 << 16)) * _FULL_SCALE)
    if not 0 < code < _FULL_SCALE - 1:
        raise ValueError(f"frequency {frequency} Hz gives the code {code:#x}, outside 1 to {_FULL_SCALE - 2:#x}.")
    return code


def inductance_from_frequency(frequency: float, capacitance: float, quality_factor: float = math.inf) -> float:
    """Inductance of a tank that oscillates at a frequency; without losses L = 1/((2πf)² C).

    Parameters
    ----------
    frequency : float
        In Hz.
    capacitance : float
        All capacitance across the coil in F, the converter's input pins included.
    quality_factor : float
        Of the tank, R_p √(C/L); by default no losses.

    Returns
    -------
    float
        In H.

    Raises
    ------
    ValueError
        A frequency or capacitance that is not positive and finite, a quality factor that is not above 1, or a frequency
        that no inductance has with these losses and the converter's delay.

    Notes
    -----
    Equation 1: f = √(1 − 1/Q² − 5 ns/(Q √(LC))) / (2π √(LC)). With u = √(LC) and Ω = 2πf it is the cubic
    Ω² u³ − (1 − 1/Q²) u + 5 ns/Q = 0, of which the largest root is the inductance of a real sensor; at the others the
    delay would be a large part of the period.

    Examples
    --------
    >>> round(inductance_from_frequency(2e6, 120e-12) * 1e6, 2)
    52.77
    >>> round(inductance_from_frequency(2e6, 120e-12, 20.0) * 1e6, 2)
    52.47
    """
    for name, value in (("frequency", frequency), ("capacitance", capacitance)):
        _check_positive(name, value)
    damping = _damping(quality_factor)
    p, q = (value / (2 * math.pi * frequency) ** 2 for value in (damping, _DELAY / quality_factor))
    cosine = 1.5 * q / p * math.sqrt(3 / p)
    if cosine > 1:
        raise ValueError(f"no inductance oscillates at {frequency} Hz with a quality factor of {quality_factor}.")
    return (2 * math.sqrt(p / 3) * math.cos(math.acos(-cosine) / 3)) ** 2 / capacitance


def frequency_from_inductance(inductance: float, capacitance: float, quality_factor: float = math.inf) -> float:
    """Frequency at which a tank oscillates, equation 1; the inverse of `inductance_from_frequency`.

    Parameters
    ----------
    inductance : float
        In H.
    capacitance : float
        All capacitance across the coil in F, the converter's input pins included.
    quality_factor : float
        Of the tank; by default no losses.

    Returns
    -------
    float
        In Hz.

    Raises
    ------
    ValueError
        An inductance or capacitance that is not positive and finite, a quality factor that is not above 1, or a tank
        whose period the converter's delay rules.

    Examples
    --------
    >>> f = frequency_from_inductance(52.8e-6, 120e-12)
    >>> round((frequency_from_inductance(52.8e-6, 120e-12, 20.0) / f - 1) * 100, 2)
    -0.28
    """
    for name, value in (("inductance", inductance), ("capacitance", capacitance)):
        _check_positive(name, value)
    period = math.sqrt(inductance * capacitance)  # by 2π
    damping, delay = _damping(quality_factor), _DELAY / (quality_factor * period)
    if 1.5 * delay > damping:  # from here on a smaller inductance would oscillate more slowly
        raise ValueError(
            f"{inductance} H, {capacitance} F and quality factor {quality_factor} are too fast and too lossy."
        )
    return math.sqrt(damping - delay) / (2 * math.pi * period)


def _damping(quality_factor: float) -> float:
    if not quality_factor > 1:
        raise ValueError(f"quality_factor must be above 1; got {quality_factor}.")
    return 1 - 1 / quality_factor**2


def _check_positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"{name} must be positive and finite; got {value}.")


def _check(reference: float, divider: int, offset: int) -> None:
    _check_positive("reference", reference)
    if not 1 <= divider <= 15:
        raise ValueError(f"divider must be 1 to 15; got {divider}.")
    if not 0 <= offset <= 0xFFFF:
        raise ValueError(f"offset must be 0 to 65535; got {offset}.")
