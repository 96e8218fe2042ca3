"""Registers of the LDC1614: fields, masks, resets and writable bits.

The table `ldc1614_registers.csv` follows the data sheet, Texas Instruments SNOSCY9A. Contradictions
in the data sheet are described in the meaning of the field.
"""

from __future__ import annotations

import csv
import functools
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from types import MappingProxyType

from coilarray.design.readout import LARGEST_RCOUNT, SMALLEST_RCOUNT
from coilarray.errors import HardwareError

MANUFACTURER = 0x5449
"""Register MANUFACTURER_ID."""
DEVICE = 0x3055
"""Register DEVICE_ID. The LDC1612 has the same."""
ASLEEP = 0x2000
"""SLEEP_MODE_EN in the register CONFIG."""

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
    """Bits of a register, from `lsb` to `msb`.

    The name is ``"RESERVED"`` for bits that must be written as they are after a reset.
    """

    name: str
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

    @property
    def constant_mask(self) -> int:
        """Reserved bits that must be written unchanged."""
        return sum(field.mask for field in self.fields if field.reserved and not field.meaning.startswith("RO"))

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
    """Return the 16-bit value to write to a register.

    Read-only registers, unknown fields and values that the data sheet forbids are refused.
    """
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
