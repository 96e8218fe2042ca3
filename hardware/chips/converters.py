"""Converters of the LDC1614's family with 28-bit results.

The module lists the number of channels of each converter and the features that it lacks. All of them identify
themselves with the same numbers, so a program cannot distinguish them. The sources are Texas Instruments SNOSCY9A for
the LDC1612 and LDC1614, and SNOSCZ5B for the FDC2212 and FDC2214. The latter two convert capacitances with the same
core, register addresses, drive and timing. It is not verified that they measure coils as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from coilarray.errors import HardwareError

Family = Literal["LDC", "FDC"]
"""Converters of inductance, or of capacitance."""


@dataclass(frozen=True)
class Converter:
    """Name, number of channels and family of a converter."""

    name: str
    channels: int
    family: Family = "LDC"


@dataclass(frozen=True)
class FamilyLimits:
    """Differences between the two families."""

    smallest_rcount: int  # least RCOUNT
    largest_input_divider: int  # largest FIN_DIVIDER; called FIN_SEL in the FDC
    has_offset: bool  # whether there are registers OFFSET
    finds_drive: bool  # whether the converter finds a drive current by itself and shows it in INIT_IDRIVE
    reported: tuple[str, ...]  # fields of ERROR_CONFIG that exist: the errors that can be reported


FAMILIES = MappingProxyType({
    "LDC": FamilyLimits(5, 15, True, True, (
        "UR_ERR2OUT", "OR_ERR2OUT", "WD_ERR2OUT", "AH_ERR2OUT", "AL_ERR2OUT",
        "UR_ERR2INT", "OR_ERR2INT", "WD_ERR2INT", "AH_ERR2INT", "AL_ERR2INT", "ZC_ERR2INT", "DRDY_2INT",
    )),
    "FDC": FamilyLimits(
        0x100, 2, False, False, ("WD_ERR2OUT", "AH_ERR2OUT", "AL_ERR2OUT", "WD_ERR2INT", "DRDY_2INT")
    ),
})  # fmt: skip
"""Limits of the families by their name."""
CONVERTERS = MappingProxyType({
    one.name: one
    for one in (Converter("LDC1614", 4), Converter("LDC1612", 2), Converter("FDC2214", 4, "FDC"),
                Converter("FDC2212", 2, "FDC"))
})  # fmt: skip
"""Converters by their name."""
_TWELVE_BITS = ("LDC1314", "LDC1312", "FDC2114", "FDC2112")


def converter(name: str) -> Converter:
    """Return a converter by its name, in any case."""
    known = CONVERTERS.get(name.upper())
    if known is not None:
        return known
    why = " has results of 12 bits, too coarse for δ" if name.upper() in _TWELVE_BITS else " is not known"
    raise HardwareError(f"the converter {name[:40]!r}{why}; use {', '.join(CONVERTERS)}.")
