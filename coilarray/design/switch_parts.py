"""Parts of switches that a board can be built with.

A part has the connections inside its package, the order of its bits, and electrical values. Values
that no public source confirmed are in `SwitchPart.unverified`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from coilarray.design.scan_states import Switches
from coilarray.errors import HardwareError, shown

CONVERTER_PIN = 4e-12
"""Capacitance of a pin of the LDC1614 to ground in F, about (TI SNOSCY9A, eq. 3)."""
PartName = Literal["ADG714", "ADG738", "ADG739"]
"""Names of the known parts."""
_NETS = 3  # nets that every end of a coil has a switch to: ground and both sides of the bus
_LOAD = 50.0  # Ω, into which the off isolation is measured
_DECADE = 10e6  # Hz, frequency of the off isolation
_FROM_MEMORY = "not verified: the table of the data sheet was not read"


@dataclass(frozen=True)
class SwitchPart:
    """Package of eight switches, each closed by one bit.

    `bits` are the names of the switches from bit 0 to bit 7, and `drains` the common pins, each
    with its switches. Values are typical. The attenuation by an open switch is in dB, at 10 MHz
    into 50 Ω. Capacitances to ground are in F, of both pins together for a closed switch.
    `unverified` has the fields that no public source confirmed, with the reason.
    """

    name: PartName
    title: str
    bits: tuple[str, ...]
    drains: Mapping[str, tuple[str, ...]]
    on_resistance: float
    off_isolation: float
    source_capacitance: float
    drain_capacitance: float
    on_capacitance: float
    unverified: Mapping[str, str] = field(default_factory=dict)

    @property
    def off_capacitance(self) -> float:
        """Capacitance through an open switch in F.

        An isolation of a into a load R at ω gives C = 10^(−a/20)/(ω R).
        """
        return float(10 ** (-self.off_isolation / 20) / (2 * math.pi * _DECADE * _LOAD))

    @property
    def closing(self) -> float:
        """Capacitance to ground in F that a closing switch adds."""
        return self.on_capacitance - self.source_capacitance - self.drain_capacitance

    def capacitances(self, switches: Switches, coils: int) -> Switches:
        """Return switches with the capacitances of this part.

        Every coil end has a switch to ground and to each side of the bus. Traces are not counted.

        >>> counted = PARTS["ADG739"].capacitances(Switches(), 6)
        >>> round(counted.terminal_capacitance * 1e12), round(counted.bus_capacitance * 1e12)
        (42, 153)
        """
        return replace(
            switches,
            off_capacitance=self.off_capacitance,
            terminal_capacitance=self.drain_capacitance * (1 if self.drains else _NETS),
            bus_capacitance=2 * coils * self.source_capacitance + self.closing + CONVERTER_PIN,
        )


_A, _B = (tuple(f"S{k}{side}" for k in range(1, 5)) for side in "AB")
_ONE_TO_EIGHT = tuple(f"S{k}" for k in range(1, 9))
_CAPACITANCES = ("source_capacitance", "drain_capacitance", "on_capacitance")
_PARTS = (
    SwitchPart(
        "ADG714", "eight switches, each with two pins of its own", _ONE_TO_EIGHT, {},
        on_resistance=2.5, off_isolation=60, source_capacitance=11e-12, drain_capacitance=11e-12, on_capacitance=22e-12,
        unverified=dict.fromkeys((*_CAPACITANCES, "off_isolation"), _FROM_MEMORY),
    ),
    SwitchPart(
        "ADG738", "eight switches with one common pin", _ONE_TO_EIGHT, {"D": _ONE_TO_EIGHT},
        on_resistance=2.5, off_isolation=55, source_capacitance=13e-12, drain_capacitance=85e-12, on_capacitance=96e-12,
        unverified=dict.fromkeys((*_CAPACITANCES, "bits"), _FROM_MEMORY)
        | {"off_isolation": "that of the ADG728, which has the same switches and another bus"},
    ),
    SwitchPart(
        "ADG739", "twice four switches with a common pin", (*_A, *_B), {"DA": _A, "DB": _B},
        on_resistance=2.5, off_isolation=55, source_capacitance=13e-12, drain_capacitance=42e-12, on_capacitance=48e-12,
        unverified=dict.fromkeys(_CAPACITANCES, _FROM_MEMORY)
        | {
            "bits": "not verified: the data sheet's table was not read; S4B first and S1A last as sibling parts "
            "suggest; the closure self-test tells",
            "off_isolation": "that of the ADG729, which has the same switches and another bus",
        },
    ),
)  # fmt: skip
PARTS: Mapping[str, SwitchPart] = {part.name: part for part in _PARTS}
"""Known parts by name. R_ON and topology are from the front pages of ADG714/715 Rev. B and
ADG738/739 Rev. A, at 5 V. Bits of the ADG714 are from ADG714/715, S8 first. Off isolation is from
ADG728/729 Rev. C, −75 dB at 1 MHz and −55 dB at 10 MHz."""


def switch_part(name: str, what: str = "wiring.device.part") -> SwitchPart:
    """Return a part by name, called `what` in messages.

    >>> switch_part("ADG739").drains["DA"]
    ('S1A', 'S2A', 'S3A', 'S4A')
    """
    if name not in PARTS:
        raise HardwareError(f"{what} must be {', '.join(PARTS)}; got {shown(name)}.")
    return PARTS[name]
