"""LDC1614 inductance-to-digital converter: code, sensor frequency and inductance.

Equations 3 and 6 of the data sheet, Texas Instruments SNOSCY9A.
"""

from __future__ import annotations

import math

CODE_BITS = 28
"""Width of a conversion result."""
_FULL_SCALE = 1 << CODE_BITS


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


def inductance_from_frequency(frequency: float, capacitance: float) -> float:
    """Inductance of a lossless tank, L = 1/((2πf)² C).

    Parameters
    ----------
    frequency : float
        In Hz.
    capacitance : float
        All capacitance across the coil in F, the converter's input pins included.

    Returns
    -------
    float
        In H.

    Raises
    ------
    ValueError
        A value that is not positive and finite.

    Examples
    --------
    >>> round(inductance_from_frequency(2e6, 120e-12) * 1e6, 2)
    52.77
    """
    for name, value in (("frequency", frequency), ("capacitance", capacitance)):
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} must be positive and finite; got {value}.")
    return 1 / ((2 * math.pi * frequency) ** 2 * capacitance)


def _check(reference: float, divider: int, offset: int) -> None:
    if not (math.isfinite(reference) and reference > 0):
        raise ValueError(f"reference must be positive and finite; got {reference} Hz.")
    if not 1 <= divider <= 15:
        raise ValueError(f"divider must be 1 to 15; got {divider}.")
    if not 0 <= offset <= 0xFFFF:
        raise ValueError(f"offset must be 0 to 65535; got {offset}.")
