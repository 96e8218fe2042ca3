"""Read-out of a design, the table ``[readout]``."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Literal, get_args

from coilarray.constants import COPPER_PER_KELVIN
from coilarray.errors import DesignError, require_finite

Converter = Literal["LDC1614", "LDC1612", "FDC2214", "none"]  # converters with the same limits, and none
SMALLEST_RCOUNT, LARGEST_RCOUNT = 5, 0xFFFF  # range of RCOUNT, the length of a conversion
INTERNAL_CLOCK = 43.4e6  # typical frequency of the converter's internal oscillator in Hz
DRIVE_DELAY = 5e-9  # delay of the converter's drive in s (SNOSCY9A, equation 1)
INTERNAL_CLOCK_PER_KELVIN = -13e-6  # change of the internal oscillator in 1/K (SNOSCY9A, section 6.5, mean of units)
RESOLUTION_RCOUNT = 0x800  # RCOUNT for which `Readout.resolution` is given
USUAL: Mapping[str, float] = {
    "resolution": 8e-7,
    "clock_jitter": 0.0,
    "capacitor_per_kelvin": 30e-6,
    "board_per_kelvin": 14e-6,
    "copper_per_kelvin": COPPER_PER_KELVIN,
    "switch_per_kelvin": 1.9e-3,
}
"""Sizes for a `Readout` without its own. `coilarray.circuit.noise_budget` has their sources."""
_POSITIVE = ("clock", "reference_divider", "resolution", "amplitude", "averaged_scans", "baseline_scans")
_NOT_NEGATIVE = ("clock_jitter", "temperature_change", "supply_change")


def conversion_time(rcount: int, reference: float) -> float:
    """Return the duration of a conversion in s, (16·RCOUNT + 4)/f_ref (SNOSCY9A, equation 7).

    >>> round(conversion_time(0xFFFF, 21.7e6) * 1e3, 3)
    48.321
    """
    return (16 * rcount + 4) / reference


@dataclass(frozen=True)
class Readout:
    """Settings and stability of the converter and its surroundings.

    Raises DesignError for a number that is not finite or outside its range, or another converter.

    Parameters
    ----------
    converter : {"LDC1614", "LDC1612", "FDC2214", "none"}
        Chip that reads the coils, whose limits count. With "none" the limits are not checked.
    rcount : int
        Length of a conversion, RCOUNT of the LDC1614: 5 to 65535.
    clock : float
        Frequency of the converter's clock in Hz.
    external_clock : bool
        Whether the clock comes from a crystal oscillator instead of the converter's own.
    reference_divider : int
        Divider from the clock to the reference frequency.
    resolution : float or None
        Relative standard deviation of a frequency at RCOUNT 0x800. It falls with the root of
        RCOUNT.
    clock_jitter : float or None
        Standard deviation of one period of the clock in s. It adds up from period to period in the
        converter's own oscillator, and does not in a crystal oscillator.
    amplitude : float
        Peak voltage of the sensors in V.
    averaged_scans, baseline_scans : int
        Number of scans that are averaged for a reading, and for L_0.
    temperature_change : float
        Standard deviation of the board's temperature from L_0 to the reading in K.
    supply_change : float
        Standard deviation of the supply from L_0 to the reading in V.
    clock_per_kelvin, clock_per_volt : float or None
        Relative change of the clock with temperature in 1/K, and with the supply in 1/V. None for
        the values that are known or assumed for the kind of clock.
    capacitor_per_kelvin, board_per_kelvin, copper_per_kelvin, switch_per_kelvin : float or None
        Relative change with temperature in 1/K of the tank's capacitance, the board's size, the
        resistance of the copper and the resistance of a closed switch. As for `resolution` and
        `clock_jitter`, None is a size that is not given, which `size` takes from `USUAL`.

    Examples
    --------
    >>> round(Readout().conversion_time * 1e3, 2), f"{Readout().frequency_noise:.2g}"
    (48.32, '1.4e-07')
    """

    converter: Converter = "LDC1614"
    rcount: int = LARGEST_RCOUNT
    clock: float = INTERNAL_CLOCK
    external_clock: bool = False
    reference_divider: int = 2
    resolution: float | None = None
    clock_jitter: float | None = None
    amplitude: float = 1.5
    averaged_scans: int = 1
    baseline_scans: int = 10
    temperature_change: float = 0.1
    supply_change: float = 1e-3
    clock_per_kelvin: float | None = None
    clock_per_volt: float | None = None
    capacitor_per_kelvin: float | None = None
    board_per_kelvin: float | None = None
    copper_per_kelvin: float | None = None
    switch_per_kelvin: float | None = None

    def __post_init__(self) -> None:
        if self.converter not in get_args(Converter):
            raise DesignError(
                f"converter of a read-out must be one of {', '.join(get_args(Converter))}; got {self.converter!r}."
            )
        for one in fields(self):
            value = getattr(self, one.name)
            if value is None or one.name == "converter":
                continue
            require_finite(f"{one.name} of a read-out", value, error=DesignError)
            if one.name in _POSITIVE and not value > 0:
                raise DesignError(f"{one.name} of a read-out must be positive; got {value}.")
            if one.name in _NOT_NEGATIVE and value < 0:
                raise DesignError(f"{one.name} of a read-out must not be negative; got {value}.")
        if not SMALLEST_RCOUNT <= self.rcount <= LARGEST_RCOUNT:
            raise DesignError(f"rcount of a read-out must be {SMALLEST_RCOUNT} to {LARGEST_RCOUNT}; got {self.rcount}.")

    @property
    def is_judged(self) -> bool:
        """Whether the limits of a converter count."""
        return self.converter != "none"

    def size(self, name: str) -> float:
        """Return the given size of a name, or the usual one, in the unit of `USUAL`.

        >>> Readout(board_per_kelvin=16e-6).size("board_per_kelvin"), Readout().size("board_per_kelvin")
        (1.6e-05, 1.4e-05)
        """
        given = getattr(self, name)
        return USUAL[name] if given is None else float(given)

    @property
    def reference(self) -> float:
        """Reference frequency in Hz."""
        return self.clock / self.reference_divider

    @property
    def conversion_time(self) -> float:
        """Duration of a conversion in s."""
        return conversion_time(self.rcount, self.reference)

    @property
    def counting_limit(self) -> float:
        """Relative step of a frequency by counting alone, 1/(16 RCOUNT)."""
        return 1 / (16 * self.rcount)

    @property
    def jitter_noise(self) -> float:
        """Relative standard deviation of the reference by clock jitter.

        It is the mean reference frequency of a conversion. The conversion lasts N periods of the
        clock, T = N/f_clk. Independent errors σ_j of the periods of an oscillator that runs free
        add up to √N σ_j. Against a resonator only the two ends of the conversion count, √2 σ_j.
        """
        periods = self.conversion_time * self.clock
        return self.size("clock_jitter") * math.sqrt(2.0 if self.external_clock else periods) / self.conversion_time

    @property
    def resolution_noise(self) -> float:
        """Relative standard deviation of a frequency by resolution.

        It is the converter's `resolution` over √(RCOUNT/0x800). TI's SNOA944 gives 8e-7 for RCOUNT
        0x800 and a sensor at a tenth of the reference, as a firmware for the LDC1612
        (RepRapFirmware, LDC1612.cpp) quotes it. Another project quotes a fall with RCOUNT^-0.8 from
        the same note, which would give a third of this at full resolution. Not verified.
        """
        return self.size("resolution") * math.sqrt(RESOLUTION_RCOUNT / self.rcount)

    @property
    def frequency_noise(self) -> float:
        """Relative standard deviation of one conversion's frequency, without the sensor's noise."""
        return math.hypot(self.resolution_noise, self.jitter_noise)
