"""Tables of a design file as pydantic models.

The `build` methods make their geometry. Numbers stay in the units of their key names up to these methods, which return
SI.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from coilarray.design.circuit_table import CircuitTable, StateTable
from coilarray.design.fab_limits import FabTable
from coilarray.design.places_table import PlacesTable
from coilarray.design.plates import MaterialTable, PlateTable
from coilarray.design.readout import ReadoutTable
from coilarray.design.target_table import FlatTarget, SphereTarget
from coilarray.design.units import (
    SCALES,
    Degrees,
    LimitMillimetres,
    Micrometres,
    Millimetres,
    Name,
    Point,
    Position,
    Range,
    Relative,
    Table,
    in_si,
    require_rising,
)
from coilarray.errors import DesignError, GeometryError, listed, shown
from coilarray.geometry import (
    EVEN,
    Coil,
    CoilArray,
    Cone,
    CylinderEdge,
    FlatPunch,
    Hemisphere,
    Indenter,
    Lattice,
    Leads,
    Paraboloid,
    Placement,
    PlatedHole,
    RoundedSpiral,
    Seat,
    Sheet,
    Spiral,
    Stackup,
    Unevenness,
    apothem_from_size,
    lattice_array,
    path_coil,
    spiral_coil,
)
from coilarray.geometry.array import Connector, LatticeKind
from coilarray.geometry.sheet import KPA_PER_MM, Base, Strain
from coilarray.geometry.spiral import Sense, Winding, WindingRule
from coilarray.geometry.values import SIDES, Side

SCHEMA = 1
"""Version of the design file format."""

_MM, _UM, _DEG = SCALES["mm"], SCALES["um"], SCALES["deg"]

Turns = Annotated[float, Field(gt=0, le=1000)]
Kilopascals = Annotated[float, Field(ge=1e-6, le=1e9)]
PoissonsRatio = Annotated[float, Field(ge=0, le=0.5)]
HalfAngle = Annotated[float, Field(gt=0, lt=90)]

_MOST_SEGMENTS = 100_000


class StackupTable(Table):
    """``[stackup]``: copper layers and dielectrics, top to bottom."""

    layers: list[Name] = Field(min_length=1)
    """Names of the copper layers, top to bottom."""
    copper_thickness_um: list[Micrometres]
    """Thickness of each copper layer."""
    dielectric_thickness_mm: list[Millimetres] = Field(default_factory=list)
    """Thickness of each dielectric, between one copper layer and the next: one value less than the layers."""
    dielectric_epsilon_r: list[Relative] = Field(default_factory=list)
    """Relative permittivity of each dielectric."""

    @model_validator(mode="after")
    def _one_value_a_layer(self) -> StackupTable:
        """Refuse lists that do not fit the number of layers."""
        for key, less in (("copper_thickness_um", 0), ("dielectric_thickness_mm", 1), ("dielectric_epsilon_r", 1)):
            count, expected = len(getattr(self, key)), len(self.layers) - less
            if count != expected:
                values = "1 value" if expected == 1 else f"{expected} values"
                whose = "one less than the layers" if less else "one a layer"
                raise ValueError(f"needs {values} in {key}, {whose}; got {count}")
        return self

    def build(self) -> Stackup:
        """Return the stack-up in SI."""
        return Stackup(*in_si(self).values())  # the keys are in its order


class ViaTable(Table):
    """``[coils.NAME.via]``: the holes that join a coil's layers."""

    drill_mm: Millimetres = 0.2
    """Diameter of the drilled hole."""
    pad_mm: Millimetres = 0.45
    """Diameter of the copper around it."""
    plating_um: Micrometres = 25
    """Thickness of the copper in the hole."""

    def build(self) -> PlatedHole:
        """Return the hole in SI."""
        return PlatedHole(**in_si(self))


class LeadsTable(Table):
    """``[coils.NAME.leads]``: leads and terminals."""

    length_mm: Millimetres = 2.0
    """Distance from the winding's outer end to the terminals, at least half of the spacing."""
    spacing_mm: Millimetres = 1.5
    """Distance between the two terminals."""
    pad_mm: Millimetres = 1.0
    """Diameter of the copper around a terminal's hole."""
    drill_mm: Millimetres = 0.5
    """Diameter of a terminal's hole."""
    plating_um: Micrometres | None = None
    """Thickness of the copper in a terminal's hole; that of the vias by default."""

    def build(self, plating: float) -> Leads:
        """Return the leads in SI.

        `plating` is the plating of the vias.
        """
        own = plating if self.plating_um is None else self.plating_um * _UM
        terminal = PlatedHole(self.drill_mm * _MM, self.pad_mm * _MM, own)
        return Leads(self.length_mm * _MM, self.spacing_mm * _MM, terminal)


class WoundTable(Table):
    """What coils of all wound shapes share."""

    turns_per_layer: Turns
    """Number of turns on each layer; parts of a turn are allowed."""
    winding_layers: Annotated[int, Field(ge=1, le=64)] = 2
    """Number of layers of the winding, in series, joined by vias."""
    trace_width_mm: Millimetres
    """Width of the trace."""
    gap_mm: Millimetres
    """Distance between neighbouring turns, from copper to copper."""
    winding: Literal["ccw", "cw"] = "ccw"
    """Sense of the winding on the first layer seen from above, inwards: counter-clockwise or clockwise."""
    return_lead: bool = False
    """For an odd number of layers: one more layer, with a trace from the inner end out to the second terminal."""
    via: ViaTable = ViaTable()
    """Holes that join the layers."""
    leads: LeadsTable | None = None
    """Leads and terminals; bare ends without this table."""

    def wind(self, name: str, spiral: Winding) -> Coil:
        """Return the coil in SI from its layers' winding."""
        segments = spiral.steps * self.winding_layers
        if segments > _MOST_SEGMENTS:
            raise GeometryError(f"a coil may have {_MOST_SEGMENTS} segments; this one has {segments}.")
        via = self.via.build()
        leads = None if self.leads is None else self.leads.build(via.plating)
        return spiral_coil(spiral, self.winding_layers, via, leads, return_lead=self.return_lead, name=name)

    @property
    def turns(self) -> tuple[float, float, float]:
        """Turns, and width of the trace and gap in m."""
        return self.turns_per_layer, self.trace_width_mm * _MM, self.gap_mm * _MM


class SidedTable(WoundTable):
    """What coils of all wound shapes with sides share."""

    winding_rule: WindingRule = "parallel"
    """How turns become smaller: "parallel" sides, all of the outermost turn at the stated size, with a step inwards on
    the last side of each turn; or a part of the step at each "corner", so that the copper is narrower than stated."""


class PolygonCoil(SidedTable):
    """``[coils.NAME]`` with ``shape = "polygon"``; one with round corners starts in the middle of its first side."""

    shape: Literal["polygon"]
    """A winding with straight sides: hexagon, square, octagon and so on."""
    sides: Annotated[int, Field(ge=3, le=1000)] = 6
    """Number of sides."""
    outer_across_flats_mm: Millimetres | None = None
    """Width of the copper across flats, from side to opposite side; give this or the next."""
    outer_across_corners_mm: Millimetres | None = None
    """Width of the copper across corners."""
    corner_radius_mm: LimitMillimetres = 0.0
    """Radius of the outer copper edge at the corners; sharp corners by default."""
    first_corner_deg: Degrees = 0.0
    """Direction of the corner where the winding starts; 0 is +x."""

    @model_validator(mode="after")
    def _one_size(self) -> PolygonCoil:
        if (self.outer_across_flats_mm is None) == (self.outer_across_corners_mm is None):
            raise ValueError("needs exactly one of outer_across_flats_mm and outer_across_corners_mm")
        return self

    def build(self, name: str) -> Coil:
        """Return the coil in SI."""
        if self.outer_across_flats_mm is not None:
            apothem = apothem_from_size(self.outer_across_flats_mm * _MM, self.sides, across="flats")
        else:
            assert self.outer_across_corners_mm is not None  # the validator has checked it
            apothem = apothem_from_size(self.outer_across_corners_mm * _MM, self.sides, across="corners")
        corner = self.first_corner_deg * _DEG
        if self.corner_radius_mm:
            first_side = corner + half_side(self.sides, self.winding)
            radius, how = self.corner_radius_mm * _MM, (self.winding, self.winding_rule)
            return self.wind(
                name, RoundedSpiral(2 * apothem, 2 * apothem, *self.turns, radius, self.sides, first_side, *how)
            )
        return self.wind(name, Spiral(self.sides, apothem, *self.turns, corner, self.winding, self.winding_rule))


class CircleCoil(WoundTable):
    """``[coils.NAME]`` with ``shape = "circle"``."""

    shape: Literal["circle"]
    """A circular winding."""
    outer_diameter_mm: Millimetres
    """Diameter of the circle on which the outer edge of the copper starts; from there it nears the centre steadily, so
    that the copper of two layers is half of a pitch, of trace and gap, narrower."""
    first_corner_deg: Degrees = 0.0
    """Direction in which the winding starts; 0 is +x."""

    def build(self, name: str) -> Coil:
        """Return the coil in SI."""
        size, start = self.outer_diameter_mm * _MM, self.first_corner_deg * _DEG
        return self.wind(name, RoundedSpiral(size, size, *self.turns, size / 2, direction=start, winding=self.winding))


class OblongTable(SidedTable):
    """What rectangles and racetracks share."""

    outer_width_mm: Millimetres
    """Size of the copper along x."""
    outer_height_mm: Millimetres
    """Size of the copper along y."""
    first_side: Side = "right"
    """Side where the winding starts and its leads leave: at its middle, or over the corner at its beginning where
    corners are sharp and sides parallel."""

    def oblong(self, name: str, radius_mm: float) -> Coil:
        """Return the coil in SI from its corners' radius."""
        quarter = SIDES.index(self.first_side)
        sizes = (self.outer_width_mm * _MM, self.outer_height_mm * _MM)
        extent, breadth = sizes if quarter % 2 == 0 else sizes[::-1]
        radius, start = radius_mm * _MM, quarter * math.pi / 2
        return self.wind(
            name,
            RoundedSpiral(extent, breadth, *self.turns, radius, 4, start, self.winding, self.winding_rule),
        )


class RectangleCoil(OblongTable):
    """``[coils.NAME]`` with ``shape = "rectangle"``."""

    shape: Literal["rectangle"]
    """A rectangular winding."""
    corner_radius_mm: LimitMillimetres = 0.0
    """Radius of the outer copper edge at the corners; sharp corners by default."""

    def build(self, name: str) -> Coil:
        """Return the coil in SI."""
        return self.oblong(name, self.corner_radius_mm)


class RacetrackCoil(OblongTable):
    """``[coils.NAME]`` with ``shape = "racetrack"``: the shorter sides are half circles."""

    shape: Literal["racetrack"]
    """Two straight sides, and a half circle at each end."""

    def build(self, name: str) -> Coil:
        """Return the coil in SI."""
        return self.oblong(name, min(self.outer_width_mm, self.outer_height_mm) / 2)


def half_side(sides: int, winding: Sense) -> float:
    """Angle in rad from a corner to a side's middle.

    It belongs to a polygon, and to the side that the winding follows from this corner.
    """
    return math.pi / sides if winding == "ccw" else -math.pi / sides


def _number_or_list(value: object) -> Literal["number", "list"]:
    return "list" if isinstance(value, list) else "number"


# One width for all segments, or one width for each segment of each line.
TraceWidths = Annotated[
    Annotated[Millimetres, Tag("number")] | Annotated[list[list[Millimetres]], Tag("list")],
    Discriminator(_number_or_list),
]


class PathCoil(Table):
    """``[coils.NAME]`` with ``shape = "path"``: any centre lines, each on one copper layer."""

    shape: Literal["path"]
    """Centre lines of your own."""
    lines_mm: list[list[Point]] = Field(min_length=1)
    """Centre lines as corners [x, y], one line for each copper layer; each starts where the one before ends."""
    trace_width_mm: TraceWidths
    """Width of the trace: one number, or for each line a list with one of each of its segments."""
    gap_mm: Millimetres
    """Distance to keep between traces, for the check of the board house's limits."""
    via: ViaTable = ViaTable()
    """Holes that join the lines."""
    terminals: bool = True
    """Whether both ends have plated holes."""
    terminal_pad_mm: Millimetres = 1.0
    """Diameter of the copper around a terminal's hole."""
    terminal_drill_mm: Millimetres = 0.5
    """Diameter of a terminal's hole."""
    terminal_plating_um: Micrometres | None = None
    """Thickness of the copper in a terminal's hole; that of the vias by default."""
    outline_mm: Annotated[list[Point], Field(min_length=3)] | None = None
    """Corners of the outline that pictures show; the convex hull of the lines by default."""

    def build(self, name: str) -> Coil:
        """Return the coil in SI."""
        via, width = self.via.build(), self.trace_width_mm
        plating = via.plating if self.terminal_plating_um is None else self.terminal_plating_um * _UM
        terminal = PlatedHole(self.terminal_drill_mm * _MM, self.terminal_pad_mm * _MM, plating)
        coil = path_coil(
            [[(x * _MM, y * _MM) for x, y in line] for line in self.lines_mm],
            [[each * _MM for each in line] for line in width] if isinstance(width, list) else width * _MM,
            self.gap_mm * _MM,
            via,
            terminal if self.terminals else None,
            name=name,
        )
        return coil if self.outline_mm is None else replace(coil, outline=np.array(self.outline_mm) * _MM)


AnyCoil = PolygonCoil | CircleCoil | RectangleCoil | RacetrackCoil | PathCoil


class PlacementTable(Table):
    """``[[array.placements]]``: one coil of a free array."""

    name: Name
    """Name of the coil."""
    coil: str
    """Name of its shape, a table of `[coils]`."""
    layers: list[str]
    """Copper layers of its winding, in order."""
    x_mm: Position
    """x of its centre."""
    y_mm: Position
    """y of its centre."""
    rotation_deg: Degrees = 0.0
    """Rotation about its centre, counter-clockwise."""


class FreeArray(Table):
    """``[array]`` with ``lattice = "free"``."""

    lattice: Literal["free"]
    """Every coil has a shape, layers, a place and a rotation of its own."""
    placements: list[PlacementTable] = Field(min_length=1)
    """The coils, one table each."""

    def build(self, stackup: Stackup, coils: Mapping[str, Coil], board: BoardTable) -> CoilArray:
        """Return the array in SI.

        A coil that does not exist raises a DesignError.
        """
        for index, place in enumerate(self.placements):
            _check_layers(stackup, place.layers, f"array.placements.{index}.layers")
        placements = tuple(
            Placement(coil=_coil(coils, place.coil, f"array.placements.{index}.coil"), **in_si(place, "coil"))
            for index, place in enumerate(self.placements)
        )
        return CoilArray(stackup, placements, board.margin_mm * _MM, board.through_holes)


class LatticeArray(Table):
    """``[array]`` with a regular lattice or a single coil."""

    lattice: LatticeKind
    """One coil, a row, rows and columns, rows shifted by half a pitch, a triangle of such rows, or rings of hexagons
    around a middle coil."""
    coil: str
    """Name of their shape, a table of `[coils]`."""
    columns: Annotated[int, Field(ge=1, le=1000)] | None = None
    """Number of coils in a row, of a triangle in its longest; of linear, square, hexagonal and triangle lattices."""
    rows: Annotated[int, Field(ge=1, le=1000)] = 1
    """Number of rows."""
    rings: Annotated[int, Field(ge=1, le=100)] | None = None
    """Number of rings of hexagons around the middle coil, for `lattice = "rings"`."""
    pitch_mm: Millimetres | None = None
    """Distance between the centres of neighbouring coils; a single coil has none."""
    direction_deg: Degrees = 0.0
    """Direction of the rows; 0 is +x."""
    rotation_deg: Degrees = 0.0
    """Rotation of every coil about its own centre, counter-clockwise."""
    layers: list[list[str]] = Field(min_length=1)
    """Copper layers of the coils, in turn along a row: neighbours that overlap must not share copper."""
    layer_shift_per_row: int | None = None
    """Shift of the order of layers from row to row, in coils; chosen for the lattice by default."""
    names: list[Name] | None = None
    """Names of the coils in order; coil1, coil2 and so on by default."""

    @model_validator(mode="after")
    def _wanted(self) -> LatticeArray:
        """Refuse missing or extra keys of a lattice."""
        in_rows = self.lattice in ("linear", "square", "hexagonal")
        for key, wanted in (("columns", in_rows or self.lattice == "triangle"), ("rings", self.lattice == "rings")):
            if (getattr(self, key) is not None) != wanted:
                raise ValueError(f'{"needs" if wanted else "has no"} {key} for lattice = "{self.lattice}"')
        if self.rows > 1 and not in_rows:
            raise ValueError(f'has no rows for lattice = "{self.lattice}"')
        if self.lattice == "single" and self.pitch_mm is not None:
            raise ValueError('has no pitch_mm for lattice = "single"')
        coils = self.rows * (self.columns or 1)
        if self.pitch_mm is None and (coils > 1 or self.rings):
            raise ValueError("needs pitch_mm for more than one coil")
        return self

    def build(self, stackup: Stackup, coils: Mapping[str, Coil], board: BoardTable) -> CoilArray:
        """Return the array in SI.

        A coil that does not exist raises a DesignError.
        """
        coil, own = _coil(coils, self.coil, "array.coil"), in_si(self, "coil")
        _check_layers(stackup, (layer for layers in self.layers for layer in layers), "array.layers")
        kind, shift = own.pop("lattice"), own.pop("layer_shift_per_row")
        given = {key: value for key, value in own.items() if value is not None}
        lattice = Lattice(kind, layer_shift=shift, **given)
        return lattice_array(
            stackup, coil, lattice, board_margin=board.margin_mm * _MM, through_holes=board.through_holes
        )


class ConnectorTable(Table):
    """``[connector]``: one row of holes at an edge of the board, to which the leads of all coils run."""

    side: Side = "bottom"
    """Edge of the board at which the connector is."""
    pitch_mm: Millimetres = 2.54
    """Distance from hole to hole."""
    distance_mm: Millimetres = 5.0
    """Distance of the row from the coils and their own leads."""
    at_mm: Position | None = None
    """Middle of the row along the edge; that of the array by default."""
    trace_width_mm: Millimetres | None = None
    """Width of the traces to it; that of the coils by default."""
    gap_mm: Millimetres | None = None
    """Distance between them; that of the coils by default."""

    def build(self) -> Connector:
        """Return the connector in SI."""
        return Connector(**in_si(self))


class BoardTable(Table):
    """``[board]``: the edge of the board, and the reach of its holes."""

    margin_mm: LimitMillimetres = 2.0
    """Distance from the outermost copper to the edge of the board."""
    through_holes: bool = True
    """Whether vias go through the whole board; blind and buried ones join only the layers of their coil."""


class SheetTable(Table):
    """``[[elastomer]]``: one sheet on top of the board."""

    name: Name
    """Name of the sheet."""
    thickness_mm: Millimetres
    """Thickness of the sheet."""
    relative_permeability: Relative = 1.0
    """Relative permeability, above 1 if it is filled with iron powder."""
    youngs_modulus_kPa: Kilopascals | None = None  # noqa: N815 - the unit
    """Young's modulus; needed if something presses on it."""
    poissons_ratio: PoissonsRatio = 0.4999
    """Poisson's ratio, up to 0.5, which keeps the volume."""

    def build(self) -> Sheet:
        """Return the sheet in SI."""
        return Sheet(**in_si(self))


class RoundTable(MaterialTable):
    """``[indenter]`` of every shape without an edge; without a material it is nothing to the field.

    The radius of a paraboloid is that of curvature at its tip; a cylinder edge is a long cylinder that lies along y.
    """

    shape: Literal["hemisphere", "paraboloid", "cylinder_edge"]
    """Shape of the tip; a cylinder edge is a long cylinder that lies along y."""
    radius_mm: Millimetres
    """Radius; of a paraboloid that of the curvature at its tip."""

    def build(self) -> Indenter:
        """Return the indenter in SI."""
        return _ROUND[self.shape](self.radius_mm * _MM)


_ROUND: Mapping[str, Callable[[float], Indenter]] = {
    "hemisphere": Hemisphere, "paraboloid": Paraboloid, "cylinder_edge": CylinderEdge,
}  # fmt: skip


class PunchTable(MaterialTable):
    """``[indenter]`` with ``shape = "flat_punch"``."""

    shape: Literal["flat_punch"]
    """A cylinder that presses with its flat end."""
    radius_mm: Millimetres
    """Radius of the punch."""
    edge_radius_mm: Millimetres | None = None
    """Radius of its rounded edge, a tenth of its radius by default; then gast2020's sheets take 0.3 radii of depth."""

    def build(self) -> FlatPunch:
        """Return the indenter in SI."""
        return FlatPunch(self.radius_mm * _MM, _edge(self.edge_radius_mm))


class ConeTable(MaterialTable):
    """``[indenter]`` with ``shape = "cone"``; the angle is between its axis and its side."""

    shape: Literal["cone"]
    """A cone that presses with its tip; large deformations do not reach far under a sharp one, of some 45°."""
    half_angle_deg: HalfAngle
    """Angle between its axis and its side."""
    radius_mm: Millimetres | None = None
    """Radius at which the cone ends; it is infinite by default."""
    edge_radius_mm: Millimetres | None = None
    """Radius of the rounded edge where it ends; a tenth of that radius by default."""

    def build(self) -> Cone:
        """Return the indenter in SI."""
        radius = math.inf if self.radius_mm is None else self.radius_mm * _MM
        return Cone(self.half_angle_deg * _DEG, radius, _edge(self.edge_radius_mm))


def _edge(radius_mm: float | None) -> float | None:
    return None if radius_mm is None else radius_mm * _MM


SeatSlope = Annotated[float, Field(ge=-1, le=1)]
"""Change of a seat along the board, per mm or in mm per mm."""


class IndentationTable(PlacesTable):
    """``[indentation]``: how deep and where the indenter presses."""

    strain: Strain = "finite"
    """Large deformations of neo-Hookean sheets, or linear elasticity, faster and some percent less accurate."""
    base: Literal["bonded", "frictionless", "seat"] = "bonded"
    """Support of the lowest sheet: glued to the board, sliding freely on it, or on a soft seat."""
    seat_stiffness_kPa_per_mm: Annotated[float, Field(gt=0, le=1e9)] | None = None  # noqa: N815 - the unit
    """Pressure on the seat per millimetre of its compression."""
    seat_shear_kPa_per_mm: Annotated[float, Field(ge=0, le=1e9)] | None = None  # noqa: N815 - the unit
    """Shear stress per millimetre of sliding along the seat; none by default."""
    seat_stiffness_slope_x_per_mm: SeatSlope = 0.0
    """Relative change of the seat's stiffness along x, per millimetre."""
    seat_stiffness_slope_y_per_mm: SeatSlope = 0.0
    """The same along y."""
    seat_gap_slope_x_mm_per_mm: SeatSlope = 0.0
    """Change of the gap between sheet and seat along x."""
    seat_gap_slope_y_mm_per_mm: SeatSlope = 0.0
    """The same along y."""
    seat_lifts: bool = False
    """Whether the sheet may lift off the seat."""
    seat_weight_Pa: Annotated[float, Field(ge=0, le=1e6)] = 0.0  # noqa: N815 - the unit
    """Pressure of the sheets' own weight, which holds them down on a seat that they may lift off."""
    depths_mm: list[Millimetres] = Field(min_length=1)
    """Depths of the indentation, rising."""
    sample_radius_mm: Millimetres | None = None
    """Radius of a round sample with a free edge; without it and the next two the sheets are infinite."""
    sample_x_mm: Range | None = None
    """Range of a rectangular sample with free sides along x, from the same origin as the positions."""
    sample_y_mm: Range | None = None
    """The same along y."""
    ellipse_x_mm: Range | None = None
    """Range of the positions along x to which ellipses are fitted, from the same origin; all of the map by default."""
    ellipse_y_mm: Range | None = None
    """The same along y."""

    @model_validator(mode="after")
    def _consistent(self) -> IndentationTable:
        """Refuse missing or contradicting keys."""
        require_rising("depths_mm", self.depths_mm)
        if (self.base == "seat") != (self.seat_stiffness_kPa_per_mm is not None):
            raise ValueError('needs seat_stiffness_kPa_per_mm for base = "seat", and for no other base')
        if self.base != "seat" and self.seat_shear_kPa_per_mm is not None:
            raise ValueError(f'needs base = "seat" for seat_shear_kPa_per_mm; got base = "{self.base}"')
        if self.unevenness() != EVEN and (self.base != "seat" or self.sample_x_mm is None or self.sample_radius_mm):
            raise ValueError(
                'needs base = "seat", sample_x_mm and sample_y_mm and no sample_radius_mm for an uneven or lifting seat'
            )
        for what in ("sample", "ellipse"):
            x, y = (f"{what}_{axis}_mm" for axis in "xy")
            if (getattr(self, x) is None) != (getattr(self, y) is None):
                raise ValueError(f"needs both {x} and {y}, or neither")
            for key in (x, y):
                bounds = getattr(self, key)
                if bounds is not None and not bounds[0] < bounds[1]:
                    raise ValueError(f"needs {key} from low to high, with a width; got [{bounds[0]:g}, {bounds[1]:g}]")
        return self

    def support(self) -> Base:
        """Return the support of the lowest sheet."""
        if self.seat_stiffness_kPa_per_mm is not None:
            return Seat(self.seat_stiffness_kPa_per_mm * KPA_PER_MM, (self.seat_shear_kPa_per_mm or 0.0) * KPA_PER_MM)
        return "frictionless" if self.base == "frictionless" else "bonded"

    def unevenness(self) -> Unevenness:
        """Return the difference of the seat from an even seat.

        An even seat holds the sample down.
        """
        return Unevenness(
            (self.seat_stiffness_slope_x_per_mm * 1e3, self.seat_stiffness_slope_y_per_mm * 1e3),
            (self.seat_gap_slope_x_mm_per_mm, self.seat_gap_slope_y_mm_per_mm),
            self.seat_lifts,
            self.seat_weight_Pa,
        )


def bounds_in_metres(x_mm: Range | None, y_mm: Range | None) -> tuple[float, float, float, float] | None:
    """Return the edges of ranges in m, or None.

    The edges are (x_min, y_min, x_max, y_max), and the ranges are in mm. None is returned without ranges.
    """
    if x_mm is None or y_mm is None:
        return None
    # divided, not multiplied: positions at the edges are divided too, and are within
    return x_mm[0] / 1e3, y_mm[0] / 1e3, x_mm[1] / 1e3, y_mm[1] / 1e3


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
    stackup: StackupTable
    coils: dict[Name, Annotated[AnyCoil, Field(discriminator="shape")]]
    array: Annotated[LatticeArray | FreeArray, Field(discriminator="lattice")]
    connector: ConnectorTable | None = None
    board: BoardTable = BoardTable()
    elastomer: list[SheetTable] = Field(default_factory=list)
    plate: list[PlateTable] = Field(default_factory=list)
    indenter: Annotated[RoundTable | PunchTable | ConeTable, Field(discriminator="shape")] | None = None
    indentation: IndentationTable | None = None
    target: Annotated[FlatTarget | SphereTarget, Field(discriminator="shape")] | None = None
    circuit: CircuitTable = CircuitTable()
    readout: ReadoutTable = ReadoutTable()
    scan: list[StateTable] = Field(default_factory=list)
    field: FieldTable = FieldTable()
    fab: FabTable = FabTable()
    assumed: dict[str, str] = Field(default_factory=dict)
    """Values that had to be assumed, by their dotted key, with the reason; reports mark them."""

    @model_validator(mode="before")
    @classmethod
    def _renamed_tables(cls, document: object) -> object:
        if isinstance(document, Mapping) and "rules" in document:
            raise PydanticCustomError("unknown_key", "has a table [rules], which is now called [fab]")
        return document


def _check_layers(stackup: Stackup, layers: Iterable[str], key: str) -> None:
    for layer in layers:
        if layer not in stackup.names:
            known = listed(stackup.names)
            raise DesignError(f"{key} names no copper layer; stackup.layers has {known}; got {shown(layer)}.")


def _coil(coils: Mapping[str, Coil], name: str, key: str) -> Coil:
    if name not in coils:
        raise DesignError(f"{key} names no coil shape; [coils] has {', '.join(coils) or 'none'}; got {name!r}.")
    return coils[name]
