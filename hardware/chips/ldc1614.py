"""Registers, codes, frequencies, inductances, times and limits of the LDC1614.

Source: data sheet, Texas Instruments SNOSCY9A, equations 1, 3, 6 and 7, section 7 and table 43. Its
contradictions are described in the meaning of each field in `ldc1614_registers.csv`. Its register
tables print the conversion time without the four clocks of equation 7, which are counted here. The
LDC1612 has the first two channels and the same identity, so a program cannot distinguish them.
"""

from __future__ import annotations

import csv
import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from types import MappingProxyType

from coilarray.circuit import converter_limits
from coilarray.design.readout import DRIVE_DELAY, LARGEST_RCOUNT, SMALLEST_RCOUNT, conversion_time
from coilarray.errors import HardwareError, require_positive

MANUFACTURER = 0x5449  # register MANUFACTURER_ID
DEVICE = 0x3055  # Register DEVICE_ID. The LDC1612 has the same.
ASLEEP = 0x2000  # SLEEP_MODE_EN in the register CONFIG

# Values that the data sheet allows, by the name of the field without the channel's number.
_ALLOWED: Mapping[str, tuple[range | tuple[int, ...], str]] = {
    "RCOUNT": (range(SMALLEST_RCOUNT, LARGEST_RCOUNT + 1), f"{SMALLEST_RCOUNT} to {LARGEST_RCOUNT}"),
    "FIN_DIVIDER": (range(1, 0x10), "1 to 15"),
    "FREF_DIVIDER": (range(1, 0x400), "1 to 1023"),
    "DEGLITCH": ((1, 4, 5, 7), "1, 4, 5 or 7 (1, 3.3, 10, 33 MHz)"),
    "INIT_IDRIVE": ((0,), "0 when it is written"),
}


@dataclass(frozen=True)
class Field:
    """Bits of a register, from `lsb` to `msb`."""

    name: str  # "RESERVED" for bits that must be written as they are after a reset
    msb: int
    lsb: int
    reset: int
    writable: bool
    meaning: str

    @property
    def largest(self) -> int:
        """Largest value that the bits hold."""
        return (1 << (self.msb - self.lsb + 1)) - 1

    @property
    def mask(self) -> int:
        """Bits of the field in the register."""
        return self.largest << self.lsb

    @property
    def reserved(self) -> bool:
        """Whether the bits must not be changed."""
        return self.name == "RESERVED"


@dataclass(frozen=True)
class Register:
    """One register of 16 bits."""

    address: int
    name: str
    fields: tuple[Field, ...]

    @property
    def reset(self) -> int:
        """Value after a reset."""
        return sum(field.reset << field.lsb for field in self.fields)

    @property
    def writable_mask(self) -> int:
        """Bits that keep a written value."""
        return sum(field.mask for field in self.fields if field.writable)

    def field(self, name: str) -> Field:
        """Return a field that is not reserved."""
        named = {field.name: field for field in self.fields if not field.reserved}
        if name not in named:
            raise HardwareError(f"register {self.name} has the fields {', '.join(named)}; got {name!r}.")
        return named[name]


@functools.cache
def registers() -> Mapping[str, Register]:
    """Return all registers by name, in ascending order of addresses."""
    text = resources.files("coilarray.hardware.chips").joinpath("ldc1614_registers.csv").read_text(encoding="utf-8")
    rows: dict[tuple[int, str], list[Field]] = {}
    for row in csv.DictReader(text.splitlines()):
        field = Field(
            name=row["bitfield"],
            msb=int(row["msb"]),
            lsb=int(row["lsb"]),
            reset=int(row["reset"], 0),
            writable=row["meaning"].startswith("RW."),
            meaning=row["meaning"],
        )
        rows.setdefault((int(row["address"], 0), row["name"]), []).append(field)
    ordered = sorted(rows.items())
    return MappingProxyType({name: Register(address, name, tuple(fields)) for (address, name), fields in ordered})


def register(name: str) -> Register:
    """Return a register by its name."""
    if name not in registers():
        raise HardwareError(f"the LDC1614 has no register {name!r}.")
    return registers()[name]


def encode(name: str, fields: Mapping[str, int]) -> int:
    """Return the 16-bit value to write to a register, checked."""
    target = register(name)
    if not target.writable_mask:
        raise HardwareError(f"register {target.name} is read-only.")
    value = target.reset
    for key, given in fields.items():
        field = target.field(key)
        if isinstance(given, bool) or not isinstance(given, int) or not 0 <= given <= field.largest:
            raise HardwareError(f"{key} must be an integer from 0 to {field.largest}; got {given!r}.")
        value = value & ~field.mask | given << field.lsb
    for key, given in decode(name, value).items():
        allowed = _ALLOWED.get(key.rstrip("0123"))
        if allowed is not None and given not in allowed[0]:
            raise HardwareError(f"{key} must be {allowed[1]}; got {given}.")
    return value


def decode(name: str, value: int) -> dict[str, int]:
    """Split the value of a register into its fields.

    Wrong reserved bits are refused, because they come from another chip or a disturbed bus.

    >>> decode("CLOCK_DIVIDERS0", 0x1002)
    {'FIN_DIVIDER0': 1, 'FREF_DIVIDER0': 2}
    """
    source, fields = register(name), {}
    if not 0 <= value <= 0xFFFF:
        raise HardwareError(f"register {name} holds 0 to 0xFFFF; got {value:#x}.")
    for field in source.fields:
        bits = value >> field.lsb & field.largest
        if not field.reserved:
            fields[field.name] = bits
        elif bits != field.reset:
            raise HardwareError(
                f"bits {field.msb} to {field.lsb} of {name} must read {field.reset:#b}; got {value:#06x}."
            )
    return fields


CODE_BITS = 28  # width of a conversion result
FULL_SCALE = 1 << CODE_BITS  # Code of a frequency that equals the reference. Results are below.
INTERNAL_CLOCK_RANGE = (35e6, 55e6)
"""Smallest and largest frequency of the internal oscillator over all units in Hz."""
CLOCK_TOLERANCE = 5e-3
"""Relative change that a measured internal oscillator is allowed. It is twice the change in the
data sheet's curves of one unit between −40 and 125 °C and over the supply, 43.32 to 43.41 MHz."""
EXTERNAL_CLOCK_RANGE = (2e6, 40e6)  # smallest and largest frequency at the pin CLKIN in Hz
SLOWEST_BUS_RATE, BUS_RATE = 10e3, 400e3  # slowest and fastest clock of the I²C bus in Hz
CHANNELS = 4  # number of channels of an LDC1614
WAKE_CYCLES = 16384  # cycles of the internal oscillator from leaving sleep to starting the sensor
SWITCH_TIME, SWITCH_CYCLES = 692e-9, 5
"""Time from channel to channel in s, and additional cycles of the reference. The same is assumed
before every conversion of a single channel, for which the data sheet has no value."""
MOST_DISCARDED = 15  # largest number of conversions that a state may discard after waking
READ_BITS, WRITE_BITS = 48, 38
"""Bits on the I²C bus of reading and writing a register, with start, stop and acknowledgements."""
LEAST_SETTLE_COUNT = 2  # effective value of SETTLECOUNT 0 and 1
SWITCH_BITS = 20  # bits on the bus that take as long as the words for a chain of six at 1 MHz


def code_to_frequency(code: int, reference: float, *, divider: int = 1) -> float:
    """Return the sensor frequency of a conversion result in Hz.

    It is f = divider · f_ref · code/2²⁸, with the register OFFSET at 0, the `reference` f_ref in
    Hz, and the `divider` FIN_DIVIDER, 1 to 15. The ends of the 28-bit `code`, 0 and 0xFFFFFFF, mark
    a range error and raise ValueError, as other values outside their range.

    >>> round(code_to_frequency(0x17982F3, 21.7e6))
    2000000
    """
    require_positive("reference", reference, "", ValueError)
    if not 1 <= divider <= converter_limits.LARGEST_INPUT_DIVIDER:
        raise ValueError(f"divider must be 1 to {converter_limits.LARGEST_INPUT_DIVIDER}; got {divider}.")
    if not 0 < code < FULL_SCALE - 1:
        raise ValueError(f"code must be 1 to {FULL_SCALE - 2:#x} (the ends mark a range error); got {code:#x}.")
    return divider * reference * (code / FULL_SCALE)


def inductance_from_frequency(frequency: float, capacitance: float, quality_factor: float = math.inf) -> float:
    """Inductance of an oscillating tank in H.

    The `frequency` of the oscillation is in Hz. The total `capacitance` across the coil in F
    includes the converter's input pins. The `quality_factor` R_p √(C/L) of the tank is above 1.
    Raises ValueError for a value outside its range, or a frequency that no inductance has with
    these losses and delay.

    Without losses it is L = 1/((2πf)² C). Equation 1 is f = √(1 − 1/Q² − 5 ns/(Q √(LC))) / (2π
    √(LC)). With u = √(LC) and Ω = 2πf it becomes the cubic Ω² u³ − (1 − 1/Q²) u + 5 ns/Q = 0. Its
    largest root is the inductance of a real sensor. At the other roots the delay would be a large
    part of the period.

    >>> round(inductance_from_frequency(2e6, 120e-12) * 1e6, 2)
    52.77
    >>> round(inductance_from_frequency(2e6, 120e-12, 20.0) * 1e6, 2)
    52.47
    """
    require_positive("frequency", frequency, "", ValueError)
    require_positive("capacitance", capacitance, "", ValueError)
    if not quality_factor > 1:
        raise ValueError(f"quality_factor must be above 1; got {quality_factor}.")
    p, q = (
        value / (2 * math.pi * frequency) ** 2 for value in (1 - 1 / quality_factor**2, DRIVE_DELAY / quality_factor)
    )
    cosine = 1.5 * q / p * math.sqrt(3 / p)
    if cosine > 1:
        raise ValueError(f"no inductance oscillates at {frequency} Hz with a quality factor of {quality_factor}.")
    return (2 * math.sqrt(p / 3) * math.cos(math.acos(-cosine) / 3)) ** 2 / capacitance


def next_conversion_time(rcount: int, reference: float) -> float:
    """Return the time between a single channel's results in s."""
    return conversion_time(rcount, reference) + SWITCH_TIME + SWITCH_CYCLES / reference


def settle_time(settle_count: int, reference: float) -> float:
    """Return the time in s from starting the sensor to converting."""
    return 16 * max(settle_count, LEAST_SETTLE_COUNT) / reference


def bus_time(*, reads: int = 0, writes: int = 0, rate: float = BUS_RATE) -> float:
    """Return the time to transfer registers over I²C in s."""
    return (reads * READ_BITS + writes * WRITE_BITS) / rate


DEGLITCH = {1: 1e6, 4: 3.3e6, 5: 10e6, 7: 33e6}
"""Cut-off frequencies of the input filter in Hz. The application table prints 0b011 for 33 MHz."""


def settle_count(frequency: float, quality_factor: float, reference: float = converter_limits.REFERENCE) -> int:
    """Return the least SETTLECOUNT of a sensor.

    It is ⌈Q f_ref/(16 f)⌉ and at least 4, in units of 16 periods of the reference. The `frequency`
    f of the sensor and the `reference` f_ref of the converter are in Hz. `quality_factor` Q belongs
    to the sensor.

    >>> settle_count(2e6, 20, 21.7e6)
    14
    """
    converter_limits.require_each_positive(frequency=frequency, quality_factor=quality_factor, reference=reference)
    return max(4, math.ceil(quality_factor * reference / (16 * frequency)))


def largest_reference(*, external: bool = False, channels: int = 1) -> float:
    """Return the largest reference frequency in Hz."""
    if channels == 1:
        return 35e6
    return 40e6 if external else 55e6


def smallest_rcount(channels: int = 1) -> int:
    """Return the least RCOUNT for a number of scanned channels."""
    return SMALLEST_RCOUNT if channels == 1 else 9


def reference_divider(clock: float, *, external: bool = False, channels: int = 1) -> int:
    """Return the least FREF_DIVIDER of a clock in Hz."""
    least = 1 if external or channels > 1 else 2  # an oscillator of 55 MHz must stay below the limit of one channel
    return max(least, math.ceil(clock / largest_reference(external=external, channels=channels)))


def input_divider(frequency: float, reference: float) -> int:
    """Return the least FIN_DIVIDER for a sensor's frequency in Hz.

    The divided frequency must be below a quarter of `reference` in Hz. From 8.75 MHz the divider is
    at least 2.

    >>> input_divider(2e6, 21.7e6), input_divider(6e6, 21.7e6)
    (1, 2)
    """
    divider = converter_limits.least_divider(frequency, reference)
    if divider > converter_limits.LARGEST_INPUT_DIVIDER:
        shown, of_reference = (converter_limits.shown_unit("Hz", one).text(one, ".4") for one in (frequency, reference))
        raise ValueError(
            f"frequency {shown} must be below {converter_limits.LARGEST_INPUT_DIVIDER}/4 of {of_reference}."
        )
    return divider


def deglitch_for(frequency: float) -> int:
    """Return the code of DEGLITCH for a sensor's frequency."""
    limit = converter_limits.Limit("frequency (Hz)", frequency, *converter_limits.SENSOR_FREQUENCY)
    if not limit.kept:
        raise ValueError(limit.refusal)
    return next(code for code, edge in DEGLITCH.items() if frequency < edge)
