"""Limits of the LDC1614's clocks, counts and dividers.

The source is Texas Instruments SNOSCY9A, table 43. `coilarray.circuit.converter_limits` computes which coils the
converter can read and drive.
"""

from __future__ import annotations

import math

from coilarray.circuit.converter_limits import (
    LARGEST_INPUT_DIVIDER,
    REFERENCE,
    SENSOR_FREQUENCY,
    Drive,
    Limit,
    check_channel,
    drive_for,
    least_divider,
    require_each_positive,
    shown_unit,
)
from coilarray.hardware.chips.converters import FAMILIES, Family
from coilarray.hardware.chips.ldc1614 import (
    EXTERNAL_CLOCK_RANGE,
    INTERNAL_CLOCK_RANGE,
    LARGEST_RCOUNT,
    SMALLEST_RCOUNT,
)

__all__ = [
    "DEGLITCH", "LEAST_SCANNING_SETTLE_COUNT", "Drive", "Limit", "check_channel", "check_clock", "deglitch_for",
    "drive_for", "input_divider", "largest_reference", "reference_divider", "settle_count", "smallest_rcount",
]  # fmt: skip

_LARGEST_REFERENCE = 35e6  # Hz, with one channel
_LARGEST_SCANNING, _LARGEST_SCANNING_EXTERNAL = 55e6, 40e6  # Hz, with several channels
_LEAST_SCANNING_RCOUNT, LEAST_SCANNING_SETTLE_COUNT = 9, 4
DEGLITCH = {1: 1e6, 4: 3.3e6, 5: 10e6, 7: 33e6}
"""Cut-off frequencies of the input filter in Hz by code. The application table prints 0b011 for the last."""


def settle_count(frequency: float, quality_factor: float, reference: float = REFERENCE) -> int:
    """Return the least SETTLECOUNT of a sensor.

    It is ⌈Q f_ref/(16 f)⌉ and at least 4. `frequency` f of the sensor and `reference` f_ref of the converter are in Hz.
    `quality_factor` Q belongs to the sensor.

    Returns
    -------
    int
        Value of the register SETTLECOUNT, in units of 16 periods of the reference.

    Raises
    ------
    ValueError
        A value that is not positive.

    Examples
    --------
    >>> settle_count(2e6, 20, 21.7e6)
    14
    """
    require_each_positive(frequency=frequency, quality_factor=quality_factor, reference=reference)
    return max(LEAST_SCANNING_SETTLE_COUNT, math.ceil(quality_factor * reference / (16 * frequency)))


def largest_reference(*, external: bool = False, channels: int = 1) -> float:
    """Return the largest reference frequency of a converter in Hz.

    The converter scans a number of channels. The clock is its own oscillator or, if `external`, comes from the pin
    CLKIN.

    >>> largest_reference(), largest_reference(channels=2), largest_reference(external=True, channels=2)
    (35000000.0, 55000000.0, 40000000.0)
    """
    if channels == 1:
        return _LARGEST_REFERENCE
    return _LARGEST_SCANNING_EXTERNAL if external else _LARGEST_SCANNING


def smallest_rcount(channels: int = 1, family: Family = "LDC") -> int:
    """Return the least RCOUNT for a number of scanned channels.

    >>> smallest_rcount(), smallest_rcount(2), smallest_rcount(2, "FDC")
    (5, 9, 256)
    """
    return max(FAMILIES[family].smallest_rcount, SMALLEST_RCOUNT if channels == 1 else _LEAST_SCANNING_RCOUNT)


def check_clock(
    clock: float,
    divider: int,
    *,
    external: bool = False,
    rcount: int = 0xFFFF,
    settle_count: int = 0xFFFF,
    channels: int = 1,
    family: Family = "LDC",
) -> tuple[Limit, ...]:
    """Check the limits of a converter's clock and counts.

    `clock` is in Hz, and `channels` is the number of channels that the converter scans. All limits are returned, kept
    or not. A clock or divider that is not positive raises a ValueError. With one channel and the internal oscillator
    (not `external`, the pin CLKIN) FREF_DIVIDER must be at least 2 at any frequency.

    >>> [limit.name for limit in check_clock(40e6, 1, external=True) if not limit.kept]
    ['reference frequency (Hz)']
    """
    require_each_positive(clock=clock, divider=divider)
    return (
        Limit("clock (Hz)", clock, *(EXTERNAL_CLOCK_RANGE if external else INTERNAL_CLOCK_RANGE)),
        Limit("FREF_DIVIDER", divider, _least_reference_divider(external, channels), 0x3FF),
        Limit("reference frequency (Hz)", clock / divider, 0, largest_reference(external=external, channels=channels)),
        Limit("RCOUNT", rcount, smallest_rcount(channels, family), LARGEST_RCOUNT),
        Limit("SETTLECOUNT", settle_count, 0 if channels == 1 else LEAST_SCANNING_SETTLE_COUNT, 0xFFFF),
    )


def reference_divider(clock: float, *, external: bool = False, channels: int = 1) -> int:
    """Return the least FREF_DIVIDER of a clock in Hz.

    The largest reference gives the best resolution. `channels` is the number of channels that the converter scans.

    >>> reference_divider(43.4e6), reference_divider(32e6, external=True), reference_divider(43.4e6, channels=2)
    (2, 1, 1)
    """
    require_each_positive(clock=clock)
    most = largest_reference(external=external, channels=channels)
    return max(_least_reference_divider(external, channels), math.ceil(clock / most))


def _least_reference_divider(external: bool, channels: int) -> int:
    return 1 if external or channels > 1 else 2  # an oscillator of 55 MHz must stay below the limit of one channel


def input_divider(frequency: float, reference: float) -> int:
    """Return the least FIN_DIVIDER for a sensor's frequency in Hz.

    `reference` is the reference frequency in Hz. The divided frequency must be below a quarter of it, and the divider
    must be at least 2 from 8.75 MHz. A ValueError is raised if no divider is large enough.

    >>> input_divider(2e6, 21.7e6), input_divider(6e6, 21.7e6)
    (1, 2)
    """
    require_each_positive(frequency=frequency, reference=reference)
    divider = least_divider(frequency, reference)
    if divider > LARGEST_INPUT_DIVIDER:
        shown, of_reference = (shown_unit("Hz", one).text(one, ".4") for one in (frequency, reference))
        raise ValueError(f"frequency {shown} must be below {LARGEST_INPUT_DIVIDER}/4 of {of_reference}.")
    return divider


def deglitch_for(frequency: float) -> int:
    """Return the code of DEGLITCH for a sensor's frequency.

    It selects the lowest input filter above the frequency, which is from 1 kHz to 10 MHz.

    >>> deglitch_for(2e6)
    4
    """
    limit = Limit("frequency (Hz)", frequency, *SENSOR_FREQUENCY)
    if not limit.kept:
        raise ValueError(limit.refusal)
    return next(code for code, edge in DEGLITCH.items() if frequency < edge)
