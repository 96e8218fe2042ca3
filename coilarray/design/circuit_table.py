"""Tables of a design file about the coils' circuit.

They are pydantic models.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Literal

from pydantic import Field

from coilarray.constants import RESISTIVITY_COPPER
from coilarray.design.scan_states import Passive, ScanState, Switches, terminated_state
from coilarray.design.switch_parts import PARTS, PartName
from coilarray.design.units import Name, Relative, Table

Picofarads = Annotated[float, Field(ge=1e-6, le=1e12)]
StrayPicofarads = Annotated[float, Field(ge=0, le=1e6)]
Nanohenries = Annotated[float, Field(ge=0, le=1e9)]
Ohms = Annotated[float, Field(ge=0, le=1e9)]
LoadOhms = Annotated[float, Field(gt=0, le=1e9)]
Resistivity = Annotated[float, Field(ge=1e-10, le=1.0)]
Termination = Literal["short", "open", "ground one end", "ground other end", "load"]
PASSIVE: Mapping[Termination, Passive] = {
    "short": "ground", "open": "open", "ground one end": "ground one end", "ground other end": "ground other end",
    "load": "load",
}  # fmt: skip
"""Termination of a coil by its word in ``[circuit]``."""
OF_PART = {
    "short_resistance_ohm": "on_resistance", "switch_off_capacitance_pF": "off_capacitance",
    "terminal_capacitance_pF": "terminal_capacitance", "bus_capacitance_pF": "bus_capacitance",
}  # fmt: skip
"""Keys of ``[circuit]`` that a part replaces, each with the name of its value in `Switches`."""


class CircuitTable(Table):
    """``[circuit]``: tank and terminations."""

    capacitance_pF: Picofarads = 120  # noqa: N815 - the unit
    """Capacitance of the tank capacitor."""
    short_resistance_ohm: Ohms = 0.0
    """Resistance of two closed switches: they ground a passive coil, or join the measured one to the converter."""
    switches: PartName | None = None
    """Part of the switches, whose values are taken for keys that are not given: ADG714, ADG738 or ADG739."""
    resistivity_ohm_m: Resistivity = RESISTIVITY_COPPER
    """Resistivity of the copper."""
    switch_off_capacitance_pF: StrayPicofarads = 0.0  # noqa: N815 - the unit
    """Capacitance through each open switch."""
    terminal_capacitance_pF: StrayPicofarads = 0.0  # noqa: N815 - the unit
    """Capacitance from each terminal of a coil to ground."""
    bus_capacitance_pF: StrayPicofarads = 0.0  # noqa: N815 - the unit
    """Capacitance from each side of the measuring bus to ground."""
    lead_inductance_nH: Nanohenries = 0.0  # noqa: N815 - the unit
    """Inductance of each lead from the bus to the converter."""
    tank: Literal["converter", "coil"] = "converter"
    """Place of the capacitor: at the converter, or one at each coil."""
    elastomer_permittivity: Relative = 1.0
    """Relative permittivity of all sheets."""
    default_termination: Termination = "short"
    """State of every coil that is not being measured."""
    terminations: dict[str, Termination] = Field(default_factory=dict)
    """States of coils by name that differ from it."""

    @property
    def of_part(self) -> dict[str, str]:
        """Keys whose values are left to the part.

        Each has the name of its value in `Switches`.
        """
        keys = {} if self.switches is None else OF_PART
        return {key: name for key, name in keys.items() if key not in self.model_fields_set}

    def build_switches(self, coils: int) -> Switches:
        """Return switches and tank of a board.

        The board has `coils` coils.
        """
        given = Switches(
            on_resistance=self.short_resistance_ohm / 2,
            off_capacitance=self.switch_off_capacitance_pF * 1e-12,
            terminal_capacitance=self.terminal_capacitance_pF * 1e-12,
            bus_capacitance=self.bus_capacitance_pF * 1e-12,
            lead_inductance=self.lead_inductance_nH * 1e-9,
            tank_capacitance=self.capacitance_pF * 1e-12,
            tank_at=self.tank,
        )
        if self.switches is None:
            return given
        part = PARTS[self.switches]
        counted = part.capacitances(replace(given, on_resistance=part.on_resistance), coils)
        return replace(given, **{name: getattr(counted, name) for name in self.of_part.values()})


class StateTable(Table):
    """``[[scan]]``: one state of the multiplexer; a minus before a measured coil reverses its terminals."""

    name: Name
    """Name of the state."""
    measure: list[str] = Field(min_length=1)
    """Coils at the converter; a minus before a name reverses its terminals."""
    connection: Literal["series", "parallel"] = "series"
    """How several measured coils are joined."""
    others: Passive | None = None
    """State of all coils that are not mentioned; that of `[circuit]` by default."""
    exceptions: dict[str, Passive] = Field(default_factory=dict)
    """States of coils by name that differ from it."""
    load_ohm: LoadOhms = 50.0
    """Load resistance of a coil that is loaded."""

    def build(self, terminations: Mapping[str, Passive]) -> ScanState:
        """Return the state.

        Coils that it does not mention have their terminations from ``[circuit]``.
        """
        measured = tuple((name.removeprefix("-"), -1 if name.startswith("-") else 1) for name in self.measure)
        if self.others is None:
            return terminated_state(self.name, measured, terminations, self.connection, self.exceptions, self.load_ohm)
        return ScanState(self.name, measured, self.connection, self.others, self.exceptions, self.load_ohm)
