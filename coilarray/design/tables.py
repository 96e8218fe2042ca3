"""The tables of a design file as pydantic models, and how they become geometry.

Numbers stay in the units of their key names up to the `build` methods, which return SI.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, ValidationError, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from coilarray.constants import RESISTIVITY_COPPER
from coilarray.design.fab_limits import FabTable
from coilarray.design.scan_states import Passive, ScanState
from coilarray.design.units import (
    Degrees,
    HalfAngle,
    Kilopascals,
    LimitMillimetres,
    LoadOhms,
    Micrometres,
    Millimetres,
    Name,
    Nanohenries,
    Ohms,
    Picofarads,
    Point,
    PoissonsRatio,
    Position,
    Range,
    Relative,
    Resistivity,
    StepMillimetres,
    StrayPicofarads,
    Table,
    Turns,
)
from coilarray.errors import DesignError, GeometryError
from coilarray.geometry import (
    Coil,
    Cone,
    CylinderEdge,
    FlatPunch,
    Hemisphere,
    Leads,
    Paraboloid,
    Placement,
    PlatedHole,
    Sheet,
    Spiral,
    Stackup,
    apothem_from_size,
    lattice,
    path_coil,
    spiral_coil,
)

SCHEMA = 1
"""Version of the design file format."""

_MM, _UM, _DEG, _KPA = 1e-3, 1e-6, math.pi / 180, 1e3

_MOST_SEGMENTS = 100_000
_MOST_POSITIONS = 100_000
_WHOLE_STEPS = 1e-6  # of a step: what a range may lack of a whole number of them
_LONGEST_VALUE = 80  # characters shown of a wrong value


class StackupTable(Table):
    """``[stackup]``: copper layers and dielectrics, top to bottom."""

    layers: list[Name] = Field(min_length=1)
    copper_thickness_um: list[Micrometres]
    dielectric_thickness_mm: list[Millimetres] = Field(default_factory=list)
    dielectric_epsilon_r: list[Relative] = Field(default_factory=list)

    def build(self) -> Stackup:
        """Return the stack-up in SI."""
        return Stackup(
            tuple(self.layers),
            tuple(value * _UM for value in self.copper_thickness_um),
            tuple(value * _MM for value in self.dielectric_thickness_mm),
            tuple(self.dielectric_epsilon_r),
        )


class ViaTable(Table):
    """``[coils.NAME.via]``: the holes that join a coil's layers."""

    drill_mm: Millimetres = 0.2
    pad_mm: Millimetres = 0.45
    plating_um: Micrometres = 25

    def build(self) -> PlatedHole:
        """Return the hole in SI."""
        return PlatedHole(self.drill_mm * _MM, self.pad_mm * _MM, self.plating_um * _UM)


class LeadsTable(Table):
    """``[coils.NAME.leads]``: leads and terminals."""

    length_mm: Millimetres = 2.0
    spacing_mm: Millimetres = 1.5
    pad_mm: Millimetres = 1.0
    drill_mm: Millimetres = 0.5

    def build(self, plating: float) -> Leads:
        """Return the leads in SI."""
        terminal = PlatedHole(self.drill_mm * _MM, self.pad_mm * _MM, plating)
        return Leads(self.length_mm * _MM, self.spacing_mm * _MM, terminal)


class SpiralTable(Table):
    """What polygonal and circular spirals share."""

    turns_per_layer: Turns
    winding_layers: Annotated[int, Field(ge=1, le=64)] = 2
    trace_width_mm: Millimetres
    gap_mm: Millimetres
    first_corner_deg: Degrees = 0.0
    winding: Literal["ccw", "cw"] = "ccw"
    return_lead: bool = False
    via: ViaTable = ViaTable()
    leads: LeadsTable | None = None

    def spiral(self, sides: int, apothem: float, *, circular: bool) -> Coil:
        """Return the coil in SI from its sides (segments a turn) and outer apothem in m."""
        spiral = Spiral(
            sides=sides,
            outer_apothem=apothem,
            turns=self.turns_per_layer,
            trace_width=self.trace_width_mm * _MM,
            gap=self.gap_mm * _MM,
            first_corner=self.first_corner_deg * _DEG,
            winding=self.winding,
            circular=circular,
        )
        segments = spiral.steps * self.winding_layers
        if segments > _MOST_SEGMENTS:
            raise GeometryError(f"a coil may have {_MOST_SEGMENTS} segments; this one has {segments}.")
        via = self.via.build()
        leads = None if self.leads is None else self.leads.build(via.plating)
        return spiral_coil(spiral, self.winding_layers, via, leads, return_lead=self.return_lead)


class PolygonCoil(SpiralTable):
    """``[coils.NAME]`` with ``shape = "polygon"``."""

    shape: Literal["polygon"]
    sides: Annotated[int, Field(ge=3, le=1000)] = 6
    outer_across_flats_mm: Millimetres | None = None
    outer_across_corners_mm: Millimetres | None = None

    @model_validator(mode="after")
    def _one_size(self) -> PolygonCoil:
        if (self.outer_across_flats_mm is None) == (self.outer_across_corners_mm is None):
            raise ValueError("needs exactly one of outer_across_flats_mm and outer_across_corners_mm")
        return self

    def build(self) -> Coil:
        """Return the coil in SI."""
        if self.outer_across_flats_mm is not None:
            apothem = apothem_from_size(self.outer_across_flats_mm * _MM, self.sides, across="flats")
        else:
            assert self.outer_across_corners_mm is not None  # the validator has seen to it
            apothem = apothem_from_size(self.outer_across_corners_mm * _MM, self.sides, across="corners")
        return self.spiral(self.sides, apothem, circular=False)


class CircleCoil(SpiralTable):
    """``[coils.NAME]`` with ``shape = "circle"``."""

    shape: Literal["circle"]
    outer_diameter_mm: Millimetres
    segments_per_turn: Annotated[int, Field(ge=8, le=1000)] = 96

    def build(self) -> Coil:
        """Return the coil in SI."""
        return self.spiral(self.segments_per_turn, self.outer_diameter_mm / 2 * _MM, circular=True)


def _number_or_list(value: object) -> Literal["number", "list"]:
    return "list" if isinstance(value, list) else "number"


# one width for all segments, or one for each segment of each line
TraceWidths = Annotated[
    Annotated[Millimetres, Tag("number")] | Annotated[list[list[Millimetres]], Tag("list")],
    Discriminator(_number_or_list),
]


class PathCoil(Table):
    """``[coils.NAME]`` with ``shape = "path"``: any centre lines, each on one copper layer."""

    shape: Literal["path"]
    lines_mm: list[list[Point]] = Field(min_length=1)
    trace_width_mm: TraceWidths
    gap_mm: Millimetres
    via: ViaTable = ViaTable()
    terminals: bool = True  # plated holes at both ends
    terminal_pad_mm: Millimetres = 1.0
    terminal_drill_mm: Millimetres = 0.5

    def build(self) -> Coil:
        """Return the coil in SI."""
        via, width = self.via.build(), self.trace_width_mm
        terminal = PlatedHole(self.terminal_drill_mm * _MM, self.terminal_pad_mm * _MM, via.plating)
        return path_coil(
            [[(x * _MM, y * _MM) for x, y in line] for line in self.lines_mm],
            [[each * _MM for each in line] for line in width] if isinstance(width, list) else width * _MM,
            self.gap_mm * _MM,
            via,
            terminal if self.terminals else None,
        )


class PlacementTable(Table):
    """``[[array.placements]]``: one coil of a free array."""

    name: Name
    coil: str
    layers: list[str]
    x_mm: Position
    y_mm: Position
    rotation_deg: Degrees = 0.0


class FreeArray(Table):
    """``[array]`` with ``lattice = "free"``."""

    lattice: Literal["free"]
    placements: list[PlacementTable] = Field(min_length=1)

    def build(self, coils: Mapping[str, Coil]) -> list[Placement]:
        """Return the placements in SI; DesignError for a coil that is not there."""
        return [
            Placement(
                place.name,
                _coil(coils, place.coil, f"array.placements.{index}.coil"),
                tuple(place.layers),
                place.x_mm * _MM,
                place.y_mm * _MM,
                place.rotation_deg * _DEG,
            )
            for index, place in enumerate(self.placements)
        ]


class LatticeArray(Table):
    """``[array]`` with a regular lattice."""

    lattice: Literal["linear", "square", "hexagonal"]
    coil: str
    columns: Annotated[int, Field(ge=1, le=1000)]
    rows: Annotated[int, Field(ge=1, le=1000)] = 1
    pitch_mm: Millimetres
    direction_deg: Degrees = 0.0
    rotation_deg: Degrees = 0.0
    layers: list[list[str]] = Field(min_length=1)
    layer_shift_per_row: int | None = None
    names: list[Name] | None = None

    def build(self, coils: Mapping[str, Coil]) -> list[Placement]:
        """Return the placements in SI; DesignError for a coil that is not there."""
        points, indices = lattice(
            self.lattice, self.pitch_mm * _MM, self.columns, self.rows, direction=self.direction_deg * _DEG
        )
        names = [f"coil{k + 1}" for k in range(len(points))] if self.names is None else self.names
        if len(names) != len(points):
            raise DesignError(f"array.names must have {len(points)} names, one a coil; got {len(names)}.")
        # (i − j) mod 3 differs between all neighbours of a hexagonal lattice, (i + j) mod 2 between those of a square
        # one, and (i + 2j) mod 4 between its diagonal neighbours too
        square_shift = 2 if len(self.layers) == 4 else 1
        default_shift = -1 if self.lattice == "hexagonal" else square_shift
        shift = default_shift if self.layer_shift_per_row is None else self.layer_shift_per_row
        coil = _coil(coils, self.coil, "array.coil")
        return [
            Placement(
                name,
                coil,
                tuple(self.layers[(i + shift * j) % len(self.layers)]),
                x,
                y,
                self.rotation_deg * _DEG,
            )
            for name, (x, y), (i, j) in zip(names, points.tolist(), indices.tolist(), strict=True)
        ]


class BoardTable(Table):
    """``[board]``."""

    margin_mm: LimitMillimetres = 2.0
    through_holes: bool = True


class SheetTable(Table):
    """``[[elastomer]]``: one sheet on top of the board."""

    name: Name
    thickness_mm: Millimetres
    relative_permeability: Relative = 1.0
    youngs_modulus_kPa: Kilopascals | None = None  # noqa: N815 - the unit
    poissons_ratio: PoissonsRatio = 0.4999

    def build(self) -> Sheet:
        """Return the sheet in SI."""
        modulus = None if self.youngs_modulus_kPa is None else self.youngs_modulus_kPa * _KPA
        return Sheet(self.name, self.thickness_mm * _MM, self.relative_permeability, modulus, self.poissons_ratio)


class HemisphereTable(Table):
    """``[indenter]`` with ``shape = "hemisphere"``."""

    shape: Literal["hemisphere"]
    radius_mm: Millimetres

    def build(self) -> Hemisphere:
        """Return the indenter in SI."""
        return Hemisphere(self.radius_mm * _MM)


class ParaboloidTable(Table):
    """``[indenter]`` with ``shape = "paraboloid"``; the radius is that of curvature at the tip."""

    shape: Literal["paraboloid"]
    radius_mm: Millimetres

    def build(self) -> Paraboloid:
        """Return the indenter in SI."""
        return Paraboloid(self.radius_mm * _MM)


class FlatPunchTable(Table):
    """``[indenter]`` with ``shape = "flat_punch"``."""

    shape: Literal["flat_punch"]
    radius_mm: Millimetres

    def build(self) -> FlatPunch:
        """Return the indenter in SI."""
        return FlatPunch(self.radius_mm * _MM)


class ConeTable(Table):
    """``[indenter]`` with ``shape = "cone"``; the angle is between its axis and its side."""

    shape: Literal["cone"]
    half_angle_deg: HalfAngle
    radius_mm: Millimetres | None = None

    def build(self) -> Cone:
        """Return the indenter in SI."""
        angle = self.half_angle_deg * _DEG
        return Cone(angle) if self.radius_mm is None else Cone(angle, self.radius_mm * _MM)


class CylinderEdgeTable(Table):
    """``[indenter]`` with ``shape = "cylinder_edge"``: a long cylinder that lies along y."""

    shape: Literal["cylinder_edge"]
    radius_mm: Millimetres

    def build(self) -> CylinderEdge:
        """Return the indenter in SI."""
        return CylinderEdge(self.radius_mm * _MM)


class IndentationTable(Table):
    """``[indentation]``: how deep and where the indenter presses."""

    base: Literal["bonded", "frictionless"] = "bonded"
    depths_mm: list[Millimetres] = Field(min_length=1)
    x_mm: Range
    y_mm: Range
    step_mm: StepMillimetres
    origin: str | None = None
    sample_radius_mm: Millimetres | None = None
    sample_x_mm: Range | None = None
    sample_y_mm: Range | None = None

    @model_validator(mode="after")
    def _consistent(self) -> IndentationTable:
        if not all(shallow < deep for shallow, deep in itertools.pairwise(self.depths_mm)):
            raise ValueError(f"needs depths_mm that rise from each to the next; got {self.depths_mm}")
        for key, (low, high) in (("x_mm", self.x_mm), ("y_mm", self.y_mm)):
            if low > high:
                raise ValueError(f"needs {key} from low to high; got [{low:g}, {high:g}]")
            steps = (high - low) / self.step_mm
            if abs(steps - round(steps)) > _WHOLE_STEPS:
                raise ValueError(
                    f"needs {key} to span a whole number of steps of {self.step_mm:g} mm; "
                    f"{low:g} to {high:g} are {steps:g}"
                )
        count = math.prod(round((high - low) / self.step_mm) + 1 for low, high in (self.x_mm, self.y_mm))
        if count > _MOST_POSITIONS:
            raise ValueError(f"may have {_MOST_POSITIONS} positions; x_mm, y_mm and step_mm give {count}")
        if (self.sample_x_mm is None) != (self.sample_y_mm is None):
            raise ValueError("needs both sample_x_mm and sample_y_mm, or neither")
        for key, bounds in (("sample_x_mm", self.sample_x_mm), ("sample_y_mm", self.sample_y_mm)):
            if bounds is not None and not bounds[0] < bounds[1]:
                raise ValueError(f"needs {key} from low to high, with a width; got [{bounds[0]:g}, {bounds[1]:g}]")
        return self

    def positions(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the x and the y of the map in m, ends included."""
        x, y = (self._row(*bounds) for bounds in (self.x_mm, self.y_mm))
        return x, y

    def sample_bounds(self) -> tuple[float, float, float, float] | None:
        """Return the edges (x_min, y_min, x_max, y_max) of the sample in m, or None where it covers everything."""
        if self.sample_x_mm is None or self.sample_y_mm is None:
            return None
        (x_min, x_max), (y_min, y_max) = self.sample_x_mm, self.sample_y_mm
        return x_min * _MM, y_min * _MM, x_max * _MM, y_max * _MM

    def _row(self, low: float, high: float) -> tuple[float, ...]:
        steps = round((high - low) / self.step_mm)
        # divided, not multiplied by 1e-3: positions are labels, and -26 mm is to be -0.026 m
        return tuple((low + (high - low) * k / max(steps, 1)) / 1e3 for k in range(steps + 1))


class CircuitTable(Table):
    """``[circuit]``: tank and terminations."""

    capacitance_pF: Picofarads = 120  # noqa: N815 - the unit
    short_resistance_ohm: Ohms = 0.0
    resistivity_ohm_m: Resistivity = RESISTIVITY_COPPER
    switch_off_capacitance_pF: StrayPicofarads = 0.0  # noqa: N815 - the unit
    terminal_capacitance_pF: StrayPicofarads = 0.0  # noqa: N815 - the unit
    bus_capacitance_pF: StrayPicofarads = 0.0  # noqa: N815 - the unit
    lead_inductance_nH: Nanohenries = 0.0  # noqa: N815 - the unit
    tank: Literal["converter", "coil"] = "converter"
    elastomer_permittivity: Relative = 1.0
    default_termination: Literal["short", "open"] = "short"
    terminations: dict[str, Literal["short", "open"]] = Field(default_factory=dict)


class StateTable(Table):
    """``[[scan]]``: one state of the multiplexer; a minus before a measured coil turns its terminals round."""

    name: Name
    measure: list[str] = Field(min_length=1)
    connection: Literal["series", "parallel"] = "series"
    others: Passive | None = None
    exceptions: dict[str, Passive] = Field(default_factory=dict)
    load_ohm: LoadOhms = 50.0

    def build(self, names: Sequence[str], terminated: Sequence[Passive]) -> ScanState:
        """Return the state; coils that it does not mention are as in ``[circuit]``."""
        measured = tuple((name.removeprefix("-"), -1 if name.startswith("-") else 1) for name in self.measure)
        exceptions = dict(self.exceptions)
        if self.others is None:
            taken = {name for name, _ in measured} | set(exceptions)
            exceptions |= {
                name: passive
                for name, passive in zip(names, terminated, strict=True)
                if name not in taken and passive != "ground"
            }
        return ScanState(self.name, measured, self.connection, self.others or "ground", exceptions, self.load_ohm)


class FieldTable(Table):
    """``[field]``: the plane on which reports show the field."""

    height_mm: Position = 6.0


class Document(Table):
    """The whole file."""

    schema_: Annotated[int, Field(ge=SCHEMA, le=SCHEMA)] = Field(alias="schema")
    name: Name
    title: str = ""
    source: str = ""
    stackup: StackupTable
    coils: dict[Name, Annotated[PolygonCoil | CircleCoil | PathCoil, Field(discriminator="shape")]]
    array: Annotated[LatticeArray | FreeArray, Field(discriminator="lattice")]
    board: BoardTable = BoardTable()
    elastomer: list[SheetTable] = Field(default_factory=list)
    indenter: (
        Annotated[
            HemisphereTable | ParaboloidTable | FlatPunchTable | ConeTable | CylinderEdgeTable,
            Field(discriminator="shape"),
        ]
        | None
    ) = None
    indentation: IndentationTable | None = None
    circuit: CircuitTable = CircuitTable()
    scan: list[StateTable] = Field(default_factory=list)
    field: FieldTable = FieldTable()
    fab: FabTable = FabTable()
    assumed: dict[str, str] = Field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _renamed_tables(cls, document: object) -> object:
        if isinstance(document, Mapping) and "rules" in document:
            raise PydanticCustomError("unknown_key", "has a table [rules], which is now called [fab]")
        return document


def _coil(coils: Mapping[str, Coil], name: str, key: str) -> Coil:
    if name not in coils:
        raise DesignError(f"{key} names no coil shape; [coils] has {', '.join(coils) or 'none'}; got {name!r}.")
    return coils[name]


def first_error(error: ValidationError, document: Mapping[str, Any]) -> str:
    """Describe the first mistake of a document in one line: the key, what is allowed, what was given."""
    errors = error.errors(include_url=False)
    more = "" if len(errors) == 1 else f" (and {len(errors) - 1} more)"
    return f"{_describe(errors[0], document)}{more}"


def _describe(details: ErrorDetails, document: Mapping[str, Any]) -> str:
    where: list[str | int] = []
    table: Any = document
    for part in details["loc"]:
        if part == "[key]":  # the key itself is wrong, not its value
            continue
        # pydantic adds the tag of a union's member; the file has no such key
        if isinstance(table, Mapping) and part not in table and part in (table.get("shape"), table.get("lattice")):
            continue
        if part in ("number", "list") and not (isinstance(table, Mapping) and part in table):
            continue
        where.append(part)
        try:
            table = table[part]
        except (KeyError, IndexError, TypeError):
            table = None
    key = ".".join(str(part) for part in where)
    kind, got = details["type"], details.get("input")
    if kind == "unknown_key":
        return f"{key or 'the file'} {details['msg']}."
    if kind == "missing":
        return f"{key} is missing."
    if kind in ("union_tag_not_found", "union_tag_invalid"):
        tag = str(details["ctx"]["discriminator"]).strip("'")
        allowed = {
            "coils": "'polygon', 'circle' or 'path'",
            "array": "'linear', 'square', 'hexagonal' or 'free'",
            "indenter": "'hemisphere', 'paraboloid', 'flat_punch', 'cone' or 'cylinder_edge'",
        }[str(where[0])]
        value = got.get(tag) if isinstance(got, Mapping) else None
        return f"{key}.{tag} must be {allowed}; got {'nothing' if value is None else repr(value)}."
    if kind == "value_error":
        return f"{key} {details['msg'].removeprefix('Value error, ')}."
    if kind == "string_pattern_mismatch":
        return f"{key} may have letters, digits, _ . + and, not first, -; got {_shown(got)}."
    limits = details.get("ctx", {})
    wanted = {
        "too_short": f"have at least {limits.get('min_length')} entries",
        "too_long": f"have at most {limits.get('max_length')} entries",
        "string_too_short": "not be empty",
        "greater_than": f"be greater than {limits.get('gt', 0):g}",
        "greater_than_equal": f"be at least {limits.get('ge', 0):g}",
        "less_than_equal": f"be at most {limits.get('le', 0):g}",
        "less_than": f"be less than {limits.get('lt', 0):g}",
        "finite_number": "be a finite number",
        "float_type": "be a number",
        "int_type": "be a whole number",
        "bool_type": "be true or false",
        "string_type": "be a text",
        "list_type": "be a list",
        "model_type": "be a table",
        "dict_type": "be a table",
        "literal_error": f"be {limits.get('expected')}",
    }.get(kind, details["msg"].removeprefix("Input should ").removeprefix("Value error, "))
    return f"{key} must {wanted}; got {_shown(got)}."


def _shown(value: object) -> str:
    """Show a value of the file, cut where it is long."""
    text = repr(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}…"
