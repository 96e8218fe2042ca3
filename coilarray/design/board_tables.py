"""Tables of a design file about the board and coils.

Each is read by `build` and written by `of`. Numbers stay in the units of their keys, values are in
SI.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from coilarray.design.keys import (
    DEG,
    MM,
    UM,
    Degrees,
    LimitMillimetres,
    Micrometres,
    Millimetres,
    Name,
    Point,
    Position,
    Relative,
    Table,
    entry_of,
    nearest_entry,
)
from coilarray.errors import DesignError, GeometryError, listed, shown
from coilarray.geometry import (
    Array,
    Coil,
    Lattice,
    Leads,
    Placement,
    PlatedHole,
    RoundedSpiral,
    Spiral,
    Stackup,
    across_flats,
    hull_outline,
    lattice_array,
    path_coil,
)
from coilarray.geometry.arcs import SIDES, Side
from coilarray.geometry.array import Connector, LatticeKind
from coilarray.geometry.spiral import Sense, Winding, WindingRule

_MOST_SEGMENTS = 100_000
_TURNED = 1e-12  # rad
_PICOMETRE = 1e-12

Turns = Annotated[float, Field(gt=0, le=1000)]


class StackupTable(Table):
    """``[stackup]``: copper layers and dielectrics, top to bottom."""

    ATTRIBUTES: ClassVar = {"layers": "names", "dielectric_epsilon_r": "epsilon_r"}

    layers: list[Name] = Field(min_length=1)
    """Names of the copper layers, top to bottom."""
    copper_thickness_um: list[Micrometres]
    """Thickness of each copper layer."""
    dielectric_thickness_mm: list[Millimetres] = Field(default_factory=list)
    """Thickness of each dielectric, between one copper layer and the next: one value less than the
    layers."""
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
        return Stackup(**self.in_si())

    @classmethod
    def of(cls, stackup: Stackup, layers: Mapping[str, str]) -> dict[str, Any]:
        """Return the entries of a stack-up, with renamed `layers`."""
        return cls.entries_of(stackup) | {"layers": [layers[name] for name in stackup.names]}


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
        return PlatedHole(**self.in_si())


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

    def build(self, via: PlatedHole) -> Leads:
        """Return the leads in SI."""
        values = self.in_si(without=("plating_um",))
        plating = via.plating if self.plating_um is None else self.plating_um * UM
        terminal = PlatedHole(values.pop("drill"), values.pop("pad"), plating)
        return Leads(**values, terminal=terminal)

    @classmethod
    def of(cls, leads: Leads, via: PlatedHole) -> dict[str, Any]:
        """Return the entries of leads."""
        hole = ("pad_mm", "drill_mm") if leads.terminal.plating == via.plating else ("pad_mm", "drill_mm", "plating_um")
        return cls.entries_of(leads, "length_mm", "spacing_mm") | cls.entries_of(leads.terminal, *hole)


class WoundTable(Table):
    """What coils of all wound shapes share."""

    ATTRIBUTES: ClassVar = {"turns_per_layer": "turns", "winding_layers": "layers", "trace_width_mm": "width"}
    SHARED: ClassVar[tuple[str, ...]] = (
        "turns_per_layer",
        "winding_layers",
        "trace_width_mm",
        "gap_mm",
        "winding",
        "return_lead",
    )

    turns_per_layer: Turns
    """Number of turns on each layer; parts of a turn are allowed."""
    winding_layers: Annotated[int, Field(ge=1, le=64)] = 2
    """Number of layers of the winding, in series, joined by vias."""
    trace_width_mm: Millimetres
    """Width of the trace."""
    gap_mm: Millimetres
    """Distance between neighbouring turns, from copper to copper."""
    winding: Literal["ccw", "cw"] = "ccw"
    """Sense of the winding on the first layer seen from above, inwards: counter-clockwise or
    clockwise."""
    return_lead: bool = False
    """For an odd number of layers: one more layer, with a trace from the inner end out to the
    second terminal."""
    via: ViaTable = ViaTable()
    """Holes that join the layers."""
    leads: LeadsTable | None = None
    """Leads and terminals; bare ends without this table."""

    def shared(self, name: str) -> dict[str, Any]:
        """Return the arguments in SI that all spirals share."""
        via = self.via.build()
        leads = None if self.leads is None else self.leads.build(via)
        return self.in_si(*self.SHARED) | {"via": via, "leads": leads, "name": name}

    @classmethod
    def of(cls, spiral: Winding) -> dict[str, Any]:
        """Return the entries of a wound coil except its shape."""
        table = cls.entries_of(spiral, *WoundTable.SHARED) | {"via": ViaTable.entries_of(spiral.via)}
        return table if spiral.leads is None else table | {"leads": LeadsTable.of(spiral.leads, spiral.via)}


class SidedTable(WoundTable):
    """What coils of all wound shapes with sides share."""

    SHARED: ClassVar[tuple[str, ...]] = (*WoundTable.SHARED, "winding_rule")

    winding_rule: WindingRule = "parallel"
    """How turns become smaller: "parallel" sides, all of the outermost turn at the stated size,
    with a step inwards on the last side of each turn; or a part of the step at each "corner", so
    that the copper is narrower than stated."""


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
            size = self.outer_across_flats_mm * MM
        else:
            assert self.outer_across_corners_mm is not None  # the validator has checked it
            size = across_flats(self.outer_across_corners_mm * MM, self.sides)
        corner, shared = self.first_corner_deg * DEG, self.shared(name)
        if not self.corner_radius_mm:
            return _wound(Spiral(self.sides, size, first_corner=corner, **shared))
        first_side, radius = corner + _half_side(self.sides, self.winding), self.corner_radius_mm * MM
        rounded = RoundedSpiral(size, size, corner_radius=radius, sides=self.sides, direction=first_side, **shared)
        return _wound(rounded)

    @classmethod
    def of_polygon(cls, spiral: Spiral | RoundedSpiral) -> dict[str, Any]:
        """Return the entries of a polygon in its shorter size."""
        sides = spiral.sides
        flats = spiral.extent if isinstance(spiral, RoundedSpiral) else spiral.diameter
        corners = flats / math.cos(math.pi / sides) / MM
        sizes = {
            "outer_across_flats_mm": entry_of(flats, MM),
            "outer_across_corners_mm": nearest_entry(corners, flats, lambda entry: across_flats(entry * MM, sides)),
        }
        key = min(sizes, key=lambda key: len(repr(sizes[key])))
        table = {"shape": "polygon", "sides": sides, key: sizes[key]}
        if isinstance(spiral, RoundedSpiral):
            half = _half_side(sides, spiral.winding)
            table["corner_radius_mm"] = entry_of(spiral.corner_radius, MM)
            table["first_corner_deg"] = nearest_entry(
                (spiral.direction - half) / DEG, spiral.direction, lambda entry: entry * DEG + half
            )
        else:
            table["first_corner_deg"] = entry_of(spiral.first_corner, DEG)
        return table | {"winding_rule": spiral.winding_rule}


class CircleCoil(WoundTable):
    """``[coils.NAME]`` with ``shape = "circle"``."""

    shape: Literal["circle"]
    """A circular winding."""
    outer_diameter_mm: Millimetres
    """Diameter of the circle on which the outer edge of the copper starts; from there it nears the
    centre steadily, so that the copper of two layers is half of a pitch, of trace and gap,
    narrower."""
    first_corner_deg: Degrees = 0.0
    """Direction in which the winding starts; 0 is +x."""

    def build(self, name: str) -> Coil:
        """Return the coil in SI."""
        size, start = self.outer_diameter_mm * MM, self.first_corner_deg * DEG
        return _wound(RoundedSpiral(size, size, corner_radius=size / 2, direction=start, **self.shared(name)))

    @classmethod
    def of_circle(cls, spiral: RoundedSpiral) -> dict[str, Any]:
        """Return the entries of a circle's shape."""
        start = entry_of(spiral.direction, DEG)
        return {"shape": "circle", "outer_diameter_mm": entry_of(spiral.extent, MM), "first_corner_deg": start}


class OblongTable(SidedTable):
    """What rectangles and racetracks share."""

    outer_width_mm: Millimetres
    """Size of the copper along x."""
    outer_height_mm: Millimetres
    """Size of the copper along y."""
    first_side: Side = "right"
    """Side where the winding starts and its leads leave: at its middle, or over the corner at its
    beginning where corners are sharp and sides parallel."""

    def oblong(self, name: str, radius_mm: float) -> Coil:
        """Return the coil in SI from its corners' radius."""
        quarter = SIDES.index(self.first_side)
        sizes = (self.outer_width_mm * MM, self.outer_height_mm * MM)
        extent, breadth = sizes if quarter % 2 == 0 else sizes[::-1]
        radius, start = radius_mm * MM, quarter * math.pi / 2
        return _wound(RoundedSpiral(extent, breadth, corner_radius=radius, direction=start, **self.shared(name)))

    @classmethod
    def of_oblong(cls, spiral: RoundedSpiral) -> dict[str, Any]:
        """Return the entries of a shape along x and y."""
        quarter = round(spiral.direction / (math.pi / 2)) % 4
        sizes = (spiral.extent, spiral.breadth) if quarter % 2 == 0 else (spiral.breadth, spiral.extent)
        table = {
            "shape": "racetrack" if spiral.is_racetrack else "rectangle",
            "outer_width_mm": entry_of(sizes[0], MM),
            "outer_height_mm": entry_of(sizes[1], MM),
            "first_side": SIDES[quarter],
            "winding_rule": spiral.winding_rule,
        }
        return table if spiral.is_racetrack else table | {"corner_radius_mm": entry_of(spiral.corner_radius, MM)}


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


def _wound(spiral: Winding) -> Coil:
    """Return the coil of a spiral without too many segments."""
    segments = spiral.steps * spiral.layers
    if segments > _MOST_SEGMENTS:
        raise GeometryError(f"a coil may have {_MOST_SEGMENTS} segments; this one has {segments}.")
    return spiral.coil()


def _half_side(sides: int, winding: Sense) -> float:
    """Angle in rad from a corner to its side's middle."""
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
    """Centre lines as corners [x, y], one line for each copper layer; each starts where the one
    before ends."""
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
        via = self.via.build()
        plating = via.plating if self.terminal_plating_um is None else self.terminal_plating_um * UM
        terminal = PlatedHole(self.terminal_drill_mm * MM, self.terminal_pad_mm * MM, plating)
        paths = self.in_si("lines_mm", "trace_width_mm", "gap_mm")
        coil = path_coil(**paths, via=via, terminal=terminal if self.terminals else None, name=name)
        return coil if self.outline_mm is None else replace(coil, outline=np.array(self.outline_mm) * MM)

    @classmethod
    def of(cls, coil: Coil) -> dict[str, Any]:
        """Return the entries of any coil as paths."""
        widths = [[entry_of(width, MM) for width in line.tolist()] for line in coil.widths]
        uniform = {width for line in widths for width in line}
        table: dict[str, Any] = {
            "shape": "path",
            **cls.entries_of(coil, "lines_mm"),
            "trace_width_mm": uniform.pop() if len(uniform) == 1 else widths,
            **cls.entries_of(coil, "gap_mm"),
            "terminals": coil.terminal is not None,
        }
        if coil.terminal is not None:
            hole = ViaTable.entries_of(coil.terminal, "pad_mm", "drill_mm", "plating_um")
            if coil.terminal.plating == coil.via.plating:
                del hole["plating_um"]
            table |= {f"terminal_{key}": entry for key, entry in hole.items()}
        hull = hull_outline(coil)
        if hull.shape != coil.outline.shape or not np.allclose(hull, coil.outline, rtol=0, atol=_PICOMETRE):
            table |= cls.entries_of(coil, "outline_mm")
        return table | {"via": ViaTable.entries_of(coil.via)}


AnyCoil = PolygonCoil | CircleCoil | RectangleCoil | RacetrackCoil | PathCoil


def coil_entries(coil: Coil) -> dict[str, Any]:
    """Return the table of a coil's winding, or its paths."""
    if coil.wound is None or (shape := _shape_entries(coil.wound)) is None:
        return PathCoil.of(coil)
    return shape | WoundTable.of(coil.wound)


def _shape_entries(spiral: Winding) -> dict[str, Any] | None:
    """Return shape and sizes, None for a tilted rectangle."""
    if isinstance(spiral, Spiral):
        return PolygonCoil.of_polygon(spiral)
    assert isinstance(spiral, RoundedSpiral)  # no other kind exists
    if spiral.is_circle:
        return CircleCoil.of_circle(spiral)
    if spiral.sides == 4 and abs(math.remainder(spiral.direction, math.pi / 2)) < _TURNED:
        return OblongTable.of_oblong(spiral)
    return PolygonCoil.of_polygon(spiral) if spiral.extent == spiral.breadth and spiral.corner_radius else None


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

    def build(self, stackup: Stackup, coils: Mapping[str, Coil], board: BoardTable) -> Array:
        """Return the array in SI, of existing coils and layers."""
        for index, place in enumerate(self.placements):
            _check_layers(stackup, place.layers, f"array.placements.{index}.layers")
        placements = tuple(
            Placement(coil=_coil(coils, place.coil, f"array.placements.{index}.coil"), **place.in_si(without=("coil",)))
            for index, place in enumerate(self.placements)
        )
        return Array(stackup, placements, **board.in_si())


class LatticeArray(Table):
    """``[array]`` with a regular lattice or a single coil."""

    ATTRIBUTES: ClassVar = {"lattice": "kind", "layer_shift_per_row": "layer_shift"}

    lattice: LatticeKind
    """One coil, a row, rows and columns, rows shifted by half a pitch, a triangle of such rows, or
    rings of hexagons around a middle coil."""
    coil: str
    """Name of their shape, a table of `[coils]`."""
    columns: Annotated[int, Field(ge=1, le=1000)] | None = None
    """Number of coils in a row, of a triangle in its longest; of linear, square, hexagonal and
    triangle lattices."""
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
    """Copper layers of the coils, in turn along a row: neighbours that overlap must not share
    copper."""
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

    def build(self, stackup: Stackup, coils: Mapping[str, Coil], board: BoardTable) -> Array:
        """Return the array in SI, of existing coils and layers."""
        coil = _coil(coils, self.coil, "array.coil")
        _check_layers(stackup, (layer for layers in self.layers for layer in layers), "array.layers")
        given = {key: value for key, value in self.in_si(without=("coil",)).items() if value is not None}
        return lattice_array(stackup, coil, Lattice(**given), **board.in_si())

    @classmethod
    def of(cls, lattice: Lattice, coil: str, names: Mapping[str, str], layers: Mapping[str, str]) -> dict[str, Any]:
        """Return the entries of a lattice of the shape `coil`."""
        without = {"single": ("columns", "rows", "rings", "pitch_mm"), "rings": ("columns", "rows")}
        table = cls.entries_of(lattice, without=("coil", *without.get(lattice.kind, ("rings",))))
        table = {"lattice": table.pop("lattice"), "coil": coil} | table
        table["layers"] = [[layers.get(layer, layer) for layer in each] for each in lattice.layers]
        if lattice.names is not None:
            table["names"] = [names[name] for name in lattice.names]
        return table


def array_entries(
    array: Array, shapes: Sequence[str], names: Mapping[str, str], layers: Mapping[str, str]
) -> dict[str, Any]:
    """Return the table of an array, a lattice or placements."""
    if array.lattice is not None and _is_on(array.lattice, array):
        return LatticeArray.of(array.lattice, shapes[0], names, layers)
    placements = [
        {
            "name": names[place.name],
            "coil": shape,
            "layers": [layers[layer] for layer in place.layers],
            **PlacementTable.entries_of(place, "x_mm", "y_mm", "rotation_deg"),
        }
        for shape, place in zip(shapes, array.placements, strict=True)
    ]
    return {"lattice": "free", "placements": placements}


def _is_on(lattice: Lattice, array: Array) -> bool:
    """Check whether a lattice gives the placements of an array."""
    coil = array.placements[0].coil
    points = lattice.placements(coil)
    if len(array.placements) != len(points) or any(p.coil is not coil for p in array.placements):
        return False
    return all(
        (one.name, one.layers) == (other.name, other.layers)
        and max(abs(one.x - other.x), abs(one.y - other.y), abs(one.rotation - other.rotation)) < 1e-3 * _PICOMETRE
        for one, other in zip(points, array.placements, strict=True)
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
        return Connector(**self.in_si())


class BoardTable(Table):
    """``[board]``: the edge of the board, and the reach of its holes."""

    ATTRIBUTES: ClassVar = {"margin_mm": "board_margin"}

    margin_mm: LimitMillimetres = 2.0
    """Distance from the outermost copper to the edge of the board."""
    through_holes: bool = True
    """Whether vias go through the whole board; blind and buried ones join only the layers of their
    coil."""


def _check_layers(stackup: Stackup, layers: Iterable[str], key: str) -> None:
    for layer in layers:
        if layer not in stackup.names:
            known = listed(stackup.names)
            raise DesignError(f"{key} names no copper layer; stackup.layers has {known}; got {shown(layer)}.")


def _coil(coils: Mapping[str, Coil], name: str, key: str) -> Coil:
    if name not in coils:
        raise DesignError(f"{key} names no coil shape; [coils] has {', '.join(coils) or 'none'}; got {name!r}.")
    return coils[name]
