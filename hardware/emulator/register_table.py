"""Registers of the LDC1614 as the data sheet's table gives them: reset values, what can be written, what must be."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from importlib import resources

_TABLE = "ldc1614_registers.csv"
_ONLY_FOUR = "LDC1614 only"


@dataclass(frozen=True)
class Register:
    """One register of 16 bits.

    Parameters
    ----------
    address : int
        Its address.
    name : str
        As in the data sheet.
    reset : int
        Value after a reset.
    writable : int
        Bits that keep what is written.
    constant : int
        Bits that must be written as they are after a reset.
    four_channels : bool
        Whether chips of two channels lack it.
    """

    address: int
    name: str
    reset: int
    writable: int
    constant: int
    four_channels: bool

    @property
    def read_only(self) -> bool:
        """Whether nothing of it can be written."""
        return self.writable == 0


@cache
def register_table() -> dict[int, Register]:
    """Return all registers by address.

    Examples
    --------
    >>> hex(register_table()[0x1A].reset)
    '0x2801'
    """
    rows: dict[int, list[dict[str, str]]] = {}
    text = resources.files("coilarray.hardware.chips").joinpath(_TABLE).read_text(encoding="utf-8")
    for row in csv.DictReader(text.splitlines()):
        rows.setdefault(int(row["address"], 16), []).append(row)
    return {address: _register(address, fields) for address, fields in rows.items()}


def _register(address: int, fields: list[dict[str, str]]) -> Register:
    reset = writable = constant = 0
    for field in fields:
        low, high = int(field["lsb"]), int(field["msb"])
        mask = (1 << high + 1) - (1 << low)
        reset |= int(field["reset"], 0) << low
        if field["bitfield"] == "RESERVED" and not field["meaning"].startswith("RO"):
            constant |= mask
        if field["meaning"].startswith("RW"):
            writable |= mask
    first = fields[0]
    return Register(address, first["name"], reset, writable, constant, all(_ONLY_FOUR in f["meaning"] for f in fields))
