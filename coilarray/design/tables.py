"""The whole design file, and its tables of the circuit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from coilarray.constants import RESISTIVITY_COPPER
from coilarray.design import body_tables
from coilarray.design.board_tables import AnyCoil, BoardTable, ConnectorTable, FreeArray, LatticeArray, StackupTable
from coilarray.design.fabs import FabTable
from coilarray.design.keys import Degrees, Name, Position, Relative, Table
from coilarray.design.ports import Port
from coilarray.design.readout import INTERNAL_CLOCK, LARGEST_RCOUNT, SMALLEST_RCOUNT, Converter
from coilarray.design.scan_states import PARTS, PartName, Passive, ScanState, Switches, terminated_state
from coilarray.design.surface_tables import SurfaceArray
from coilarray.geometry import Pose

if TYPE_CHECKING:
    from coilarray.design.model import Board, Circuit

SCHEMA = 1  # version of the design file format
_StrayPicofarads = Annotated[float, Field(ge=0, le=1e6)]
_Ohms = Annotated[float, Field(ge=0, le=1e9)]
_PositiveOhms = Annotated[float, Field(gt=0, le=1e9)]
_Picofarads = Annotated[float, Field(ge=1e-6, le=1e12)]
_Scans = Annotated[int, Field(ge=1, le=1_000_000)]
_PartsPerMillion = Annotated[float, Field(ge=-100_000, le=100_000)]
_Termination = Literal["short", "open", "ground one end", "ground other end", "load"]
_SHORT = "short_resistance_ohm"
_OF_SWITCHES = (
    "capacitance_pF", "switch_off_capacitance_pF", "terminal_capacitance_pF", "bus_capacitance_pF",
    "lead_inductance_nH", "tank",
)  # fmt: skip
_OF_PART = {  # Keys of ``[circuit]`` that a part replaces, each with the reason why its value is assumed
    _SHORT: "two closed switches, typical at 5 V",
    "switch_off_capacitance_pF": "from the off isolation of the same switches with another bus, or not verified",
    "terminal_capacitance_pF": "its pins at the end of a coil; typical, not verified; traces not counted",
    "bus_capacitance_pF": "a pin of each of its switches on the bus, and the converter's; typical, not verified; "
    "traces not counted",
}


def passive_of(termination: _Termination) -> Passive:
    """Return the termination of a coil by its word."""
    return "ground" if termination == "short" else termination


def termination_of(passive: Passive) -> _Termination:
    """Return the word of a termination in ``[circuit]``."""
    return "short" if passive == "ground" else passive


class PortTable(Table):
    """``[[circuit.ports]]``: a coil with a source, tank or load of its own."""

    ATTRIBUTES: ClassVar = {
        "source_ohm": "source_resistance",
        "load_ohm": "load_resistance",
        "series_pF": "series_capacitance",
        "parallel_pF": "parallel_capacitance",
    }

    coil: str
    """Name of the coil; a coil has one port at most."""
    source_ohm: _PositiveOhms | None = None
    """Internal resistance of the source at the terminals, which have a source or a load."""
    load_ohm: _PositiveOhms | None = None
    """Resistance of the load at the terminals."""
    series_pF: _Picofarads | None = None  # noqa: N815 - the unit
    """Capacitor between the coil and the terminals; a direct connection by default."""
    parallel_pF: _Picofarads | None = None  # noqa: N815 - the unit
    """Capacitor across the coil or the terminals; none by default."""
    parallel_at: Literal["coil", "terminals"] = "coil"
    """Place of the parallel capacitor beside a series capacitor."""
    capacitor_quality: Annotated[float, Field(gt=0, le=1e9)] | None = None
    """Quality factor of the capacitors at the frequency of the link; without losses by default."""

    @classmethod
    def of(cls, port: Port, names: Mapping[str, str]) -> dict[str, Any]:
        """Return the entries of a port, its coil with another name."""
        entries = cls.entries_of(port) | {"coil": names[port.coil]}
        return {key: entry for key, entry in entries.items() if (key, entry) != ("parallel_at", "coil")}


class CircuitTable(Table):
    """``[circuit]``: tank and terminations."""

    ATTRIBUTES: ClassVar = {
        "capacitance_pF": "tank_capacitance",
        "switch_off_capacitance_pF": "off_capacitance",
        "tank": "tank_at",
    }

    capacitance_pF: _Picofarads = 120  # noqa: N815 - the unit
    """Capacitance of the tank capacitor."""
    short_resistance_ohm: _Ohms = 0.0
    """Resistance of two closed switches: they ground a passive coil, or join the measured one to
    the converter."""
    switches: PartName | None = None
    """Part of the switches, ADG714, ADG738 or ADG739, with values for keys that are not given."""
    resistivity_ohm_m: Annotated[float, Field(ge=1e-10, le=1.0)] = RESISTIVITY_COPPER
    """Resistivity of the copper."""
    switch_off_capacitance_pF: _StrayPicofarads = 0.0  # noqa: N815 - the unit
    """Capacitance through each open switch."""
    terminal_capacitance_pF: _StrayPicofarads = 0.0  # noqa: N815 - the unit
    """Capacitance from each terminal of a coil to ground."""
    bus_capacitance_pF: _StrayPicofarads = 0.0  # noqa: N815 - the unit
    """Capacitance from each side of the measuring bus to ground."""
    lead_inductance_nH: Annotated[float, Field(ge=0, le=1e9)] = 0.0  # noqa: N815 - the unit
    """Inductance of each lead from the bus to the converter."""
    tank: Literal["converter", "coil"] = "converter"
    """Place of the capacitor: at the converter, or one at each coil."""
    elastomer_permittivity: Relative = 1.0
    """Relative permittivity of all sheets."""
    default_termination: _Termination = "short"
    """State of every coil that is not being measured."""
    terminations: dict[str, _Termination] = Field(default_factory=dict)
    """States of coils by name that differ from it."""
    link_frequency_MHz: Annotated[float, Field(gt=0, le=1e6)] | None = None  # noqa: N815 - the unit
    """Frequency at which the ports work, such as 13.56; needed with `[[circuit.ports]]`."""
    ports: list[PortTable] = Field(default_factory=list)
    """Coils with a source, tank or load of their own."""

    @property
    def of_part(self) -> dict[str, str]:
        """Keys with assumed values of the part, and the reasons."""
        left = {} if self.switches is None else _OF_PART
        return {key: f"{self.switches}: {why}" for key, why in left.items() if key not in self.model_fields_set}

    def build_switches(self, coils: int) -> Switches:
        """Return switches and tank for a number of coils."""
        given = Switches(on_resistance=self.short_resistance_ohm / 2, **self.in_si(*_OF_SWITCHES))
        if self.switches is None:
            return given
        part = PARTS[self.switches]
        counted = part.capacitances(replace(given, on_resistance=part.on_resistance), coils)
        names = ("on_resistance" if key == _SHORT else self.attribute(key)[0] for key in self.of_part)
        return replace(given, **{name: getattr(counted, name) for name in names})

    @classmethod
    def of(cls, circuit: Circuit, names: Mapping[str, str]) -> dict[str, Any]:
        """Return the entries of a circuit without defaults."""
        table = {
            **switch_entries(circuit.switches),
            **cls.entries_of(circuit, "resistivity_ohm_m", "elastomer_permittivity"),
            "default_termination": termination_of(circuit.default_termination),
            "terminations": {names[coil]: termination_of(passive) for coil, passive in circuit.terminations.items()},
            **cls.entries_of(circuit, "link_frequency_MHz"),
        }
        entries = cls.not_by_default(table)
        if circuit.part is not None:  # even a default has a meaning then: the part's value does not count
            entries |= {"switches": circuit.part} | {key: table[key] for key in _OF_PART}
        if circuit.ports:
            entries["ports"] = [PortTable.of(port, names) for port in circuit.ports]
        return {key: entries[key] for key in cls.model_fields if key in entries}


def switch_entries(switches: Switches) -> dict[str, Any]:
    """Return the entries of switches and tank in ``[circuit]``."""
    return {_SHORT: 2.0 * switches.on_resistance, **CircuitTable.entries_of(switches, *_OF_SWITCHES)}


class ReadoutTable(Table):
    """``[readout]``: settings and stability of the converter, for the noise and drift of readings."""

    ATTRIBUTES: ClassVar = {
        "clock_ppm_per_K": "clock_per_kelvin",
        "clock_ppm_per_V": "clock_per_volt",
        **{f"{what}_ppm_per_K": f"{what}_per_kelvin" for what in ("capacitor", "board", "copper", "switch")},
    }

    converter: Converter = "LDC1614"
    """Chip that reads the coils; with "none" the limits of a converter are not checked."""
    rcount: Annotated[int, Field(ge=SMALLEST_RCOUNT, le=LARGEST_RCOUNT)] = LARGEST_RCOUNT
    """RCOUNT, the length of a conversion."""
    clock_MHz: Annotated[float, Field(ge=1, le=100)] = INTERNAL_CLOCK * 1e-6  # noqa: N815 - the unit
    """Clock of the converter."""
    external_clock: bool = False
    """Whether a crystal oscillator is the clock, instead of the converter's own."""
    reference_divider: Annotated[int, Field(ge=1, le=1023)] = 2
    """Divider from the clock to the reference frequency."""
    resolution_ppm: Annotated[float, Field(gt=0, le=1000)] | None = None
    """Relative standard deviation of a frequency at RCOUNT 0x800; by default 0.8, assumed."""
    clock_jitter_ps: Annotated[float, Field(ge=0, le=1e6)] | None = None
    """Standard deviation of one period of the clock; zero by default."""
    amplitude_V: Annotated[float, Field(gt=0, le=100)] = 1.5  # noqa: N815 - the unit
    """Peak voltage of the sensors."""
    averaged_scans: _Scans = 1
    """Number of scans averaged for a reading."""
    baseline_scans: _Scans = 10
    """Number of scans averaged for L_0."""
    temperature_change_K: Annotated[float, Field(ge=0, le=1000)] = 0.1  # noqa: N815 - the unit
    """Change of the board's temperature from L_0 to the reading, its standard deviation."""
    supply_change_mV: Annotated[float, Field(ge=0, le=10_000)] = 1.0  # noqa: N815 - the unit
    """Change of the supply from L_0 to the reading, its standard deviation."""
    clock_ppm_per_K: _PartsPerMillion | None = None  # noqa: N815 - the unit
    """Change of the clock with temperature; by default that of the kind of clock."""
    clock_ppm_per_V: _PartsPerMillion | None = None  # noqa: N815 - the unit
    """Change of the clock with the supply; by default that of the kind of clock."""
    capacitor_ppm_per_K: _PartsPerMillion | None = None  # noqa: N815 - the unit
    """Change of the tank's capacitance with temperature; by default 30, assumed."""
    board_ppm_per_K: _PartsPerMillion | None = None  # noqa: N815 - the unit
    """Expansion of the board; by default 14, assumed."""
    copper_ppm_per_K: _PartsPerMillion | None = None  # noqa: N815 - the unit
    """Change of the copper's resistance with temperature; by default 3930."""
    switch_ppm_per_K: _PartsPerMillion | None = None  # noqa: N815 - the unit
    """Change of a closed switch's resistance with temperature; by default 1900, assumed."""


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
    load_ohm: Annotated[float, Field(gt=0, le=1e9)] = 50.0
    """Load resistance of a coil that is loaded."""

    def build(self, terminations: Mapping[str, Passive]) -> ScanState:
        """Return the state, other coils with terminations from ``[circuit]``."""
        measured = tuple((name.removeprefix("-"), -1 if name.startswith("-") else 1) for name in self.measure)
        if self.others is None:
            return terminated_state(self.name, measured, terminations, self.connection, self.exceptions, self.load_ohm)
        return ScanState(self.name, measured, self.connection, self.others, self.exceptions, self.load_ohm)

    @classmethod
    def of(cls, state: ScanState, name: str, names: Mapping[str, str]) -> dict[str, Any]:
        """Return the entries of a state with other names."""
        return {
            "name": name,
            "measure": [f"{'-' if sense < 0 else ''}{names[coil]}" for coil, sense in state.measured],
            "connection": state.connection,
            "others": state.others,
            "exceptions": {names[coil]: passive for coil, passive in state.exceptions.items()},
            "load_ohm": float(state.load_resistance),
        }


class PlacedBoardTable(Table):
    """``[[boards]]``: another board in space, a design of its own."""

    name: Name
    """Name of the board, before the names of its coils, such as receiver/coil1."""
    design: str | dict[str, Any]
    """File of its design beside this file, a bundled design, or the tables of a design."""
    x_mm: Position = 0.0
    """x of its origin."""
    y_mm: Position = 0.0
    """y of its origin."""
    z_mm: Position = 0.0
    """Height of its top copper face above that of this board."""
    turn_deg: list[Degrees] = Field(default_factory=lambda: [0.0, 0.0, 0.0], min_length=3, max_length=3)
    """Turns about the fixed axes x, y and z through its origin, in this order."""

    @property
    def pose(self) -> Pose:
        """Place of the board."""
        return Pose(**self.in_si(without=("name", "design")))

    @classmethod
    def of(cls, board: Board, name: str, design: str | dict[str, Any]) -> dict[str, Any]:
        """Return the entries of a board with its file or tables."""
        return {"name": name, "design": design} | cls.entries_of(board.pose, without=("name", "design"))


class FieldTable(Table):
    """``[field]``: the plane on which reports show the field."""

    height_mm: Position = 6.0
    """Height of the plane above the board's top copper face."""


class Document(Table):
    """The whole file."""

    schema_: Annotated[int, Field(ge=SCHEMA, le=SCHEMA)] = Field(alias="schema")
    """Version of the file format."""
    name: Name
    """Name of the design: letters, digits and _ . + -"""
    title: str = ""
    """Title in reports."""
    source: str = ""
    """Where the design comes from."""
    author: str = ""
    """Author in reports."""
    revision: str = ""
    """Revision in reports, for example B."""
    stackup: StackupTable
    coils: dict[Name, Annotated[AnyCoil, Field(discriminator="shape")]]
    array: Annotated[LatticeArray | FreeArray | SurfaceArray, Field(discriminator="lattice")]
    connector: ConnectorTable | None = None
    board: BoardTable = BoardTable()
    elastomer: list[body_tables.SheetTable] = Field(default_factory=list)
    plate: list[body_tables.PlateTable] = Field(default_factory=list)
    indenter: Annotated[body_tables.IndenterTable, Field(discriminator="shape")] | None = None
    indentation: body_tables.IndentationTable | None = None
    target: Annotated[body_tables.FlatTarget | body_tables.SphereTarget, Field(discriminator="shape")] | None = None
    circuit: CircuitTable = CircuitTable()
    readout: ReadoutTable = ReadoutTable()
    scan: list[StateTable] = Field(default_factory=list)
    boards: list[PlacedBoardTable] = Field(default_factory=list)
    field: FieldTable = FieldTable()
    fab: FabTable = FabTable()
    assumed: dict[str, str] = Field(default_factory=dict)
    """Values that had to be assumed, by their dotted key, with the reason; reports mark them."""
