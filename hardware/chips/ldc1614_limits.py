"""Limits of the LDC1614: which coils it can drive, and on which clocks it runs.

Texas Instruments SNOSCY9A: electrical characteristics (R_p), table 42 (drive current), table 43 (clocks, counts),
section 8.1.5 (amplitude, equation 12).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from coilarray.compute.display_units import DisplayUnit, display_unit
from coilarray.design.readout import INTERNAL_CLOCK
from coilarray.hardware.chips.converters import FAMILIES, Family
from coilarray.hardware.chips.ldc1614 import (
    EXTERNAL_CLOCK_RANGE,
    INTERNAL_CLOCK_RANGE,
    LARGEST_RCOUNT,
    SMALLEST_RCOUNT,
)

REFERENCE = INTERNAL_CLOCK / 2
"""Reference frequency in Hz: the internal oscillator's typical 43.4 MHz by the divider 2 that one channel needs."""
AMPLITUDE_LOW, AMPLITUDE_HIGH = 1.2, 1.8
"""Allowed peak voltage of the sensor in V: below it measures poorly, above it the input clamps act."""
_SHOWN = {"Ω": DisplayUnit("kΩ", 1e-3)}
DRIVE_WINDOW = "R_p (Ω)"
"""Name of the limit of `check_channel` that holds the parallel resistance to `RESISTANCE`."""
RESISTANCE = (1e3, 100e3)
"""Allowed parallel resistance of a sensor in Ω, of the electrical characteristics; the rows of table 42 are for 0.6 to
90 kΩ."""
SENSOR_FREQUENCY = (1e3, 10e6)
"""Allowed frequency of a sensor in Hz."""
_AMPLITUDE_ROUNDING = 0.01  # the rows of the table are rounded to three digits
LARGEST_REFERENCE = 35e6
"""Largest reference frequency with one channel in Hz."""
_LARGEST_SCANNING, _LARGEST_SCANNING_EXTERNAL = 55e6, 40e6  # Hz, with several channels
_LEAST_SCANNING_RCOUNT, LEAST_SCANNING_SETTLE_COUNT = 9, 4
DEGLITCH = {1: 1e6, 4: 3.3e6, 5: 10e6, 7: 33e6}
"""Cut-off frequencies of the input filter in Hz by code; the application table prints 0b011 for the last."""
DIVIDED_FROM = 8.75e6
"""Frequency of a sensor in Hz from which FIN_DIVIDER must be at least 2."""
_LARGEST_SHARE_OF_REFERENCE = 0.25
_LARGEST_SHARE_OF_SELF_RESONANCE = 0.8
_SMALLEST_QUALITY = 1.0
_LARGEST_INPUT_DIVIDER = 15

# IDRIVE codes 0 to 31: current in µA, smallest and largest R_p in kΩ
_DRIVE = (
    (16, 60.0, 90.0), (18, 51.8, 77.6), (20, 44.6, 66.9), (23, 38.4, 57.6), (28, 33.7, 49.7), (32, 29.5, 42.8),
    (40, 23.6, 36.9), (46, 20.5, 31.8), (52, 18.1, 27.4), (59, 16.1, 23.6), (72, 13.1, 20.4), (82, 11.5, 17.6),
    (95, 9.92, 15.1), (110, 8.57, 13.0), (127, 7.42, 11.2), (146, 6.46, 9.69), (169, 5.58, 8.35), (195, 4.83, 7.20),
    (212, 4.45, 6.21), (244, 3.86, 5.35), (297, 3.17, 4.61), (342, 2.76, 3.97), (424, 2.22, 3.42), (489, 1.93, 2.95),
    (551, 1.71, 2.54), (635, 1.48, 2.19), (763, 1.24, 1.89), (880, 1.07, 1.63), (1017, 0.93, 1.40),
    (1173, 0.80, 1.21), (1355, 0.70, 1.05), (1563, 0.60, 0.90),
)  # fmt: skip
DRIVE_CURRENTS = tuple(1e-6 * microamperes for microamperes, _, _ in _DRIVE)
"""Currents of the IDRIVE codes 0 to 31 in A."""


@dataclass(frozen=True)
class Drive:
    """A setting of the sensor drive.

    Parameters
    ----------
    code : int
        IDRIVE code, 0 to 31.
    current : float
        Drive current in A.
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
        Name of the limited quantity, with its unit.
    value, low, high : float
        Value, and the range it must be in.
    """

    name: str
    value: float
    low: float
    high: float

    @property
    def kept(self) -> bool:
        """True if the value is in the range."""
        return self.low <= self.value <= self.high

    @property
    def words(self) -> str:
        """Name, value and allowed range for people, in customary units.

        >>> Limit("quality factor", 5.0, 10.0, math.inf).words, Limit(DRIVE_WINDOW, 101e3, 1e3, 100e3).words
        ('quality factor is 5; it must be at least 10', 'R_p is 101 kΩ; it must be 1 kΩ to 100 kΩ')
        """
        name, value, allowed = self._texts()
        return f"{name} is {value}; it must be {allowed}"

    @property
    def refusal(self) -> str:
        """The same as a sentence of an error.

        >>> Limit("clock (Hz)", 30e6, 35e6, 55e6).refusal
        'clock must be 35 MHz to 55 MHz; got 30 MHz.'
        """
        name, value, allowed = self._texts()
        return f"{name} must be {allowed}; got {value}."

    def _texts(self) -> tuple[str, str, str]:
        """Return name, value and allowed range."""
        name, _, unit = self.name.removesuffix(")").partition(" (")
        shown = _SHOWN.get(unit) or display_unit(unit)
        counts = not unit and float(self.value).is_integer()
        value, low, high = (shown.text(one, ".6" if counts else ".4") for one in (self.value, self.low, self.high))
        if math.isinf(self.high):
            allowed = f"at least {low}"
        else:
            allowed = f"at most {high}" if self.low <= 0 else f"{low} to {high}"
        return name, value, allowed


def drive_for(parallel_resistance: float) -> Drive | None:
    """Return the drive setting for a `parallel_resistance` R_p of the tank at resonance in Ω.

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
    """
    _require_positive(parallel_resistance=parallel_resistance)
    fitting = [
        drive_of(code, parallel_resistance)
        for code, (_, low, high) in enumerate(_DRIVE)
        if low * 1e3 <= parallel_resistance <= high * 1e3
    ]
    # some rows of the table exceed the clamps by a few percent; their neighbours below do not
    below_the_clamps = [drive for drive in fitting if drive.amplitude <= AMPLITUDE_HIGH]
    return max(below_the_clamps or fitting, key=lambda drive: drive.current, default=None)


def drive_of(code: int, parallel_resistance: float) -> Drive:
    """Return the current of an IDRIVE code, 0 to 31, and the amplitude that it gives an R_p in Ω (equation 12).

    >>> round(drive_of(6, 33e3).amplitude, 2)
    1.68
    """
    if not 0 <= code < len(_DRIVE):
        raise ValueError(f"code must be 0 to {len(_DRIVE) - 1}; got {code}.")
    _require_positive(parallel_resistance=parallel_resistance)
    current = DRIVE_CURRENTS[code]
    return Drive(code, current, 4 * parallel_resistance * current / math.pi)


def check_channel(
    frequency: float,
    parallel_resistance: float,
    quality_factor: float,
    self_resonance: float = math.inf,
    *,
    reference: float = REFERENCE,
    divider: int | None = None,
) -> tuple[Limit, ...]:
    """Check every limit of one channel.

    Parameters
    ----------
    frequency : float
        Frequency of the sensor in Hz.
    parallel_resistance : float
        Parallel resistance R_p of the sensor at resonance in Ω.
    quality_factor : float
        Quality factor of the sensor.
    self_resonance : float
        Self-resonance of the coil in Hz.
    reference : float
        Reference frequency f_ref in Hz.
    divider : int, optional
        FIN_DIVIDER, 1 to 15; by default the least that will do, as the driver sets it.

    Returns
    -------
    tuple of Limit
        All limits, kept or not. An R_p that is allowed but too large for every row of table 42 breaks the limit of the
        amplitude that the smallest drive current makes. Channel 0 alone can be driven harder than `DRIVE_WINDOW` says,
        down to 250 Ω (HIGH_CURRENT_DRV). An uncalibrated internal oscillator may be a fifth below `reference`.

    Raises
    ------
    ValueError
        A value that is not positive.

    Examples
    --------
    >>> all(limit.kept for limit in check_channel(1.9e6, 33e3, 48.0, 8e6))
    True
    >>> [limit.name for limit in check_channel(6e6, 33e3, 48.0, divider=1) if not limit.kept]
    ['sensor frequency by divider over reference']
    """
    _require_positive(frequency=frequency, quality_factor=quality_factor, self_resonance=self_resonance)
    _require_positive(reference=reference)
    if divider is None:
        divider = min(_least_divider(frequency, reference), _LARGEST_INPUT_DIVIDER)
    _require_positive(divider=divider)
    drive = drive_for(parallel_resistance)
    share = frequency / divider / reference
    limits = [
        Limit("sensor frequency (Hz)", frequency, *SENSOR_FREQUENCY),
        Limit("sensor frequency by divider over reference", share, 0, _LARGEST_SHARE_OF_REFERENCE),
        Limit("frequency over self-resonance", frequency / self_resonance, 0, _LARGEST_SHARE_OF_SELF_RESONANCE),
        Limit(DRIVE_WINDOW, parallel_resistance, *RESISTANCE),
        Limit("quality factor", quality_factor, _SMALLEST_QUALITY, math.inf),
        Limit("reference frequency (Hz)", reference, 0, LARGEST_REFERENCE),
        Limit("FIN_DIVIDER", divider, 2 if frequency >= DIVIDED_FROM else 1, _LARGEST_INPUT_DIVIDER),
    ]  # fmt: skip
    if drive is not None:
        low, high = AMPLITUDE_LOW * (1 - _AMPLITUDE_ROUNDING), AMPLITUDE_HIGH * (1 + 2 * _AMPLITUDE_ROUNDING)
        limits.append(Limit("amplitude (V peak)", drive.amplitude, low, high))
    elif RESISTANCE[0] <= parallel_resistance <= RESISTANCE[1]:
        smallest = drive_of(0, parallel_resistance).amplitude
        limits.append(Limit("amplitude with the smallest drive current (V peak)", smallest, 0, AMPLITUDE_HIGH))
    return tuple(limits)


def settle_count(frequency: float, quality_factor: float, reference: float = REFERENCE) -> int:
    """Return the least SETTLECOUNT, ⌈Q f_ref/(16 f)⌉ and at least 4.

    `frequency` f is that of the sensor and `reference` f_ref that of the converter, both in Hz; `quality_factor` Q is
    the sensor's.

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
    _require_positive(frequency=frequency, quality_factor=quality_factor, reference=reference)
    return max(LEAST_SCANNING_SETTLE_COUNT, math.ceil(quality_factor * reference / (16 * frequency)))


def largest_reference(*, external: bool = False, channels: int = 1) -> float:
    """Return the largest reference frequency in Hz of a converter that scans a number of channels.

    The clock is its own oscillator or, where it is `external`, at the pin CLKIN.

    >>> largest_reference(), largest_reference(channels=2), largest_reference(external=True, channels=2)
    (35000000.0, 55000000.0, 40000000.0)
    """
    if channels == 1:
        return LARGEST_REFERENCE
    return _LARGEST_SCANNING_EXTERNAL if external else _LARGEST_SCANNING


def smallest_rcount(channels: int = 1, family: Family = "LDC") -> int:
    """Return the least RCOUNT of a converter that scans a number of channels.

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
    """Check the limits of clock (in Hz) and counts of a converter that scans a number of channels.

    All limits are returned, kept or not; ValueError for a clock or divider that is not positive. With one channel and
    the internal oscillator (not `external`, the pin CLKIN) FREF_DIVIDER must be at least 2 at any frequency.

    >>> [limit.name for limit in check_clock(40e6, 1, external=True) if not limit.kept]
    ['reference frequency (Hz)']
    """
    _require_positive(clock=clock, divider=divider)
    return (
        Limit("clock (Hz)", clock, *(EXTERNAL_CLOCK_RANGE if external else INTERNAL_CLOCK_RANGE)),
        Limit("FREF_DIVIDER", divider, _least_reference_divider(external, channels), 0x3FF),
        Limit("reference frequency (Hz)", clock / divider, 0, largest_reference(external=external, channels=channels)),
        Limit("RCOUNT", rcount, smallest_rcount(channels, family), LARGEST_RCOUNT),
        Limit("SETTLECOUNT", settle_count, 0 if channels == 1 else LEAST_SCANNING_SETTLE_COUNT, 0xFFFF),
    )


def reference_divider(clock: float, *, external: bool = False, channels: int = 1) -> int:
    """Return the least FREF_DIVIDER of a clock in Hz: the largest reference gives the best resolution.

    `channels` is the number of channels that the converter scans.

    >>> reference_divider(43.4e6), reference_divider(32e6, external=True), reference_divider(43.4e6, channels=2)
    (2, 1, 1)
    """
    _require_positive(clock=clock)
    most = largest_reference(external=external, channels=channels)
    return max(_least_reference_divider(external, channels), math.ceil(clock / most))


def _least_reference_divider(external: bool, channels: int) -> int:
    return 1 if external or channels > 1 else 2  # an oscillator of 55 MHz must stay below the limit of one channel


def input_divider(frequency: float, reference: float) -> int:
    """Return the least FIN_DIVIDER for a sensor's frequency and a reference frequency in Hz.

    The divided frequency must be below a quarter of the reference, and the divider at least 2 from 8.75 MHz; ValueError
    where no divider brings it below.

    >>> input_divider(2e6, 21.7e6), input_divider(6e6, 21.7e6)
    (1, 2)
    """
    _require_positive(frequency=frequency, reference=reference)
    divider = _least_divider(frequency, reference)
    if divider > _LARGEST_INPUT_DIVIDER:
        shown, of_reference = map(_frequency_text, (frequency, reference))
        raise ValueError(f"frequency {shown} must be below {_LARGEST_INPUT_DIVIDER}/4 of {of_reference}.")
    return divider


def _least_divider(frequency: float, reference: float) -> int:
    least = math.floor(4 * frequency / reference) + 1  # below a quarter, not at it
    return max(least, 2 if frequency >= DIVIDED_FROM else 1)


def deglitch_for(frequency: float) -> int:
    """Return the code of DEGLITCH, the lowest input filter above a sensor's frequency of 1 kHz to 10 MHz.

    >>> deglitch_for(2e6)
    4
    """
    low, high = SENSOR_FREQUENCY
    if not low <= frequency <= high:
        low_text, high_text, shown = map(_frequency_text, (low, high, frequency))
        raise ValueError(f"frequency must be {low_text} to {high_text}; got {shown}.")
    return next(code for code, edge in DEGLITCH.items() if frequency < edge)


def _frequency_text(frequency: float) -> str:
    return f"{frequency * 1e-6:g} MHz" if frequency >= 1e6 else f"{frequency * 1e-3:g} kHz"


def _require_positive(**values: float) -> None:
    for name, value in values.items():
        if not value > 0:
            raise ValueError(f"{name} must be positive; got {value}.")
