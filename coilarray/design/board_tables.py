"""Tables of a design file about the board and coils.

`in_si` or `build` makes the values, `entries_of` or `of` the entries in the units of their keys.
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
    Bend,
    Coil,
    Lattice,
    Leads,
    Placement,
    PlatedHole,
    RoundedSpiral,
    Spiral,
    Stackup,
    Zone,
    across_flats,
    hull_outline,
    lattice_array,
    path_coil,
)
from coilarray.geometry.arcs import SIDES, Side
from coilarray.geometry.array import LatticeKind
from coilarray.geometry.spiral import Sense, Winding, WindingRule

_MOST_SEGMENTS = 100_000
_TURNED = 1e-12  # rad
_PICOMETRE, _SAME_PLACE = 1e-12, 1e-15  # m

Turns = Annotated[float, Field(gt=0, le=1000)]
# One width for all segments, or one width for each segment of each line.
TraceWidths = Annotated[
    Annotated[Millimetres, Tag("number")] | Annotated[list[list[Millimetres]], Tag("list")],
    Discriminator(lambda value: "list" if isinstance(value, list) else "number"),
]
_Radius = Annotated[float, Field(ge=-10_000, le=10_000)]


class StackupTable(Table):
    """``[stackup]``: copper layers and dielectrics, top to bottom."""

    ATTRIBUTES: ClassVar = {"layers": "names", "dielectric_epsilon_r": "epsilon_r"}

    layers: list[Name] = Field(min_length=1)
    """Names of the copper layers, top to bottom."""
    copper_thickness_um: list[Micrometres]
    """Thickness of each copper layer."""
    dielectric_thickness_mm: list[Millimetres] = Field(default_factory=list)
    """Thickness of each dielectric between two copper layers: one value less than the layers."""
    dielectric_epsilon_r: list[Relative] = Field(default_factory=list)
    """Relative permittivity of each dielectric."""

    @model_validator(mode="after")
    def _one_value_a_layer(self) -> StackupTable:
        for key, less in (("copper_thickness_um", 0), ("dielectric_thickness_mm", 1), ("dielectric_epsilon_r", 1)):
            count, expected = len(getattr(self, key)), len(self.layers) - less
            if count != expected:
                values = "1 value" if expected == 1 else f"{expected} values"
                whose = "one less than the layers" if less else "one a layer"
                raise ValueError(f"needs {values} in {key}, {whose}; got {count}")
        return self


class ViaTable(Table):
    """``[coils.NAME.via]``: the holes that join a coil's layers."""

    drill_mm: Millimetres = 0.2
    """Diameter of the drilled hole."""
    pad_mm: Millimetres = 0.45
    """Diameter of the copper around it."""
    plating_um: Micrometres = 25
    """Thickness of the copper in the hole."""


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
        length, spacing, pad, drill, plating = self.in_si().values()
        return Leads(length, spacing, PlatedHole(drill, pad, via.plating if plating is None else plating))


class WoundTable(Table):
    """What coils of all wound shapes share."""

    ATTRIBUTES: ClassVar = {"turns_per_layer": "turns", "winding_layers": "layers", "trace_width_mm": "width"}
    turns_per_layer: Turns
    """Number of turns on each layer; parts of a turn are allowed."""
    winding_layers: Annotated[int, Field(ge=1, le=64)] = 2
    """Number of layers of the winding, in series, joined by vias."""
    trace_width_mm: Millimetres
    """Width of the trace."""
    gap_mm: Millimetres
    """Distance between neighbouring turns, from copper to copper."""
    winding: Literal["ccw", "cw"] = "ccw"
    """Winding inwards on the first layer, seen from above: counter-clockwise or clockwise."""
    return_lead: bool = False
    """For an odd number of layers: one more, with a trace from the inner end to the terminal."""
    via: ViaTable = ViaTable()
    """Holes that join the layers."""
    leads: LeadsTable | None = None
    """Leads and terminals; bare ends without this table."""

    def build(self, name: str) -> Coil:
        """Return the coil in SI."""
        via = PlatedHole(**self.via.in_si())
        leads = None if self.leads is None else self.leads.build(via)
        sided = ("winding_rule",) if isinstance(self, SidedTable) else ()
        spiral = self.spiral(self.in_si(*_WOUND, *sided) | {"via": via, "leads": leads, "name": name})
        segments = spiral.steps * spiral.layers
        if segments > _MOST_SEGMENTS:
            raise GeometryError(f"a coil may have {_MOST_SEGMENTS} segments; this one has {segments}.")
        return spiral.coil()

    def spiral(self, shared: dict[str, Any]) -> Winding:
        """Return the winding of a shape from what all share, in SI."""
        raise NotImplementedError


_WOUND = [key for key in WoundTable.model_fields if key not in ("via", "leads")]


class SidedTable(WoundTable):
    """What coils of all wound shapes with sides share."""

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
    """Width of the copper across flats, from side to opposite side; give this or outer_across_corners_mm."""
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

    def spiral(self, shared: dict[str, Any]) -> Winding:
        """Return the winding in SI."""
        if self.outer_across_flats_mm is not None:
            size = self.outer_across_flats_mm * MM
        else:
            assert self.outer_across_corners_mm is not None  # the validator has checked it
            size = across_flats(self.outer_across_corners_mm * MM, self.sides)
        corner = self.first_corner_deg * DEG
        if not self.corner_radius_mm:
            return Spiral(self.sides, size, first_corner=corner, **shared)
        side, radius = corner + _half_side(self.sides, self.winding), self.corner_radius_mm * MM
        return RoundedSpiral(size, size, corner_radius=radius, sides=self.sides, direction=side, **shared)


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

    def spiral(self, shared: dict[str, Any]) -> Winding:
        """Return the winding in SI."""
        size, start = self.outer_diameter_mm * MM, self.first_corner_deg * DEG
        return RoundedSpiral(size, size, corner_radius=size / 2, direction=start, **shared)


class OblongTable(SidedTable):
    """What rectangles and racetracks share."""

    outer_width_mm: Millimetres
    """Size of the copper along x."""
    outer_height_mm: Millimetres
    """Size of the copper along y."""
    first_side: Side = "right"
    """Side where the winding starts and its leads leave: at its middle, or over the corner at its
    beginning where corners are sharp and sides parallel."""

    def spiral(self, shared: dict[str, Any]) -> Winding:
        """Return the winding in SI."""
        quarter = SIDES.index(self.first_side)
        sizes = (self.outer_width_mm * MM, self.outer_height_mm * MM)
        extent, breadth = sizes if quarter % 2 == 0 else sizes[::-1]
        shorter = min(self.outer_width_mm, self.outer_height_mm)
        radius = self.corner_radius_mm if isinstance(self, RectangleCoil) else shorter / 2
        return RoundedSpiral(extent, breadth, corner_radius=radius * MM, direction=quarter * math.pi / 2, **shared)


class RectangleCoil(OblongTable):
    """``[coils.NAME]`` with ``shape = "rectangle"``."""

    shape: Literal["rectangle"]
    """A rectangular winding."""
    corner_radius_mm: LimitMillimetres = 0.0
    """Radius of the outer copper edge at the corners; sharp corners by default."""


class RacetrackCoil(OblongTable):
    """``[coils.NAME]`` with ``shape = "racetrack"``: the shorter sides are half circles."""

    shape: Literal["racetrack"]
    """Two straight sides, and a half circle at each end."""


def _half_side(sides: int, winding: Sense) -> float:
    """Angle in rad from a corner to its side's middle."""
    return math.pi / sides if winding == "ccw" else -math.pi / sides


class PathCoil(Table):
    """``[coils.NAME]`` with ``shape = "path"``: any centre lines, each on one copper layer."""

    shape: Literal["path"]
    """Centre lines of your own."""
    lines_mm: list[list[Point]] = Field(min_length=1)
    """Centre lines as corners [x, y], one a copper layer; each starts where the last ends."""
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
        via = PlatedHole(**self.via.in_si())
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
            hole = _terminal_entries(coil.terminal, coil.via)
            table |= {f"terminal_{key}": entry for key, entry in hole.items()}
        hull = hull_outline(coil)
        if hull.shape != coil.outline.shape or not np.allclose(hull, coil.outline, rtol=0, atol=_PICOMETRE):
            table |= cls.entries_of(coil, "outline_mm")
        return table | {"via": ViaTable.entries_of(coil.via)}


AnyCoil = PolygonCoil | CircleCoil | RectangleCoil | RacetrackCoil | PathCoil


def _terminal_entries(terminal: PlatedHole, via: PlatedHole) -> dict[str, Any]:
    """Return the entries of a terminal's hole, its plating only if it is not that of the vias."""
    keys = ("pad_mm", "drill_mm", *(("plating_um",) if terminal.plating != via.plating else ()))
    return ViaTable.entries_of(terminal, *keys)


def coil_entries(coil: Coil) -> dict[str, Any]:
    """Return the table of a coil's winding, or its paths."""
    if coil.wound is None or (table := _shape_entries(coil.wound)) is None:
        return PathCoil.of(coil)
    spiral = coil.wound
    table |= WoundTable.entries_of(spiral, *_WOUND) | {"via": ViaTable.entries_of(spiral.via)}
    if spiral.leads is not None:
        hole = _terminal_entries(spiral.leads.terminal, spiral.via)
        table["leads"] = LeadsTable.entries_of(spiral.leads, "length_mm", "spacing_mm") | hole
    return table


def _shape_entries(spiral: Winding) -> dict[str, Any] | None:
    """Return shape and sizes, None for a tilted rectangle."""
    assert isinstance(spiral, Spiral | RoundedSpiral)  # no other kind exists
    table: dict[str, Any] = {}
    sides = spiral.sides
    if isinstance(spiral, RoundedSpiral):
        if spiral.is_circle:
            start = entry_of(spiral.direction, DEG)
            return {"shape": "circle", "outer_diameter_mm": entry_of(spiral.extent, MM), "first_corner_deg": start}
        if not spiral.is_racetrack:
            table["corner_radius_mm"] = entry_of(spiral.corner_radius, MM)
        if sides == 4 and abs(math.remainder(spiral.direction, math.pi / 2)) < _TURNED:
            quarter = round(spiral.direction / (math.pi / 2)) % 4
            width, height = (spiral.extent, spiral.breadth)[:: 1 if quarter % 2 == 0 else -1]
            return {
                "shape": "racetrack" if spiral.is_racetrack else "rectangle",
                "outer_width_mm": entry_of(width, MM),
                "outer_height_mm": entry_of(height, MM),
                "first_side": SIDES[quarter],
                "winding_rule": spiral.winding_rule,
                **table,
            }
        if spiral.extent != spiral.breadth or not spiral.corner_radius:
            return None
        half = _half_side(sides, spiral.winding)
        start = nearest_entry((spiral.direction - half) / DEG, spiral.direction, lambda entry: entry * DEG + half)
        flats = spiral.extent
    else:
        flats, start = spiral.diameter, entry_of(spiral.first_corner, DEG)
    corners = flats / math.cos(math.pi / sides) / MM  # a polygon in the shorter of its sizes
    sizes = {
        "outer_across_flats_mm": entry_of(flats, MM),
        "outer_across_corners_mm": nearest_entry(corners, flats, lambda entry: across_flats(entry * MM, sides)),
    }
    key = min(sizes, key=lambda key: len(repr(sizes[key])))
    table = {"shape": "polygon", "sides": sides, key: sizes[key]} | table
    return table | {"first_corner_deg": start, "winding_rule": spiral.winding_rule}


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
        placements = []
        for index, place in enumerate(self.placements):
            require_layers(stackup, place.layers, f"array.placements.{index}.layers")
            coil = coil_named(coils, place.coil, f"array.placements.{index}.coil")
            placements.append(Placement(coil=coil, **place.in_si(without=("coil",))))
        return Array(stackup, tuple(placements), **board.of_array)


class LatticeArray(Table):
    """``[array]`` with a regular lattice or a single coil."""

    ATTRIBUTES: ClassVar = {"lattice": "kind", "layer_shift_per_row": "layer_shift"}

    lattice: LatticeKind
    """One coil, a row, rows and columns, rows shifted by half a pitch, a triangle of such rows, or
    rings of hexagons around a middle coil."""
    coil: str
    """Name of their shape, a table of `[coils]`."""
    columns: Annotated[int, Field(ge=1, le=1000)] | None = None
    """Number of coils in a row, the longest of a triangle; not of single and rings lattices."""
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
    """Copper layers of the coils, in turn along a row: overlapping neighbours must not share any."""
    layer_shift_per_row: int | None = None
    """Shift of the order of layers from row to row, in coils; chosen for the lattice by default."""
    names: list[Name] | None = None
    """Names of the coils in order; coil1, coil2 and so on by default."""

    @model_validator(mode="after")
    def _wanted(self) -> LatticeArray:
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
        coil = coil_named(coils, self.coil, "array.coil")
        require_layers(stackup, (layer for layers in self.layers for layer in layers), "array.layers")
        given = {key: value for key, value in self.in_si(without=("coil",)).items() if value is not None}
        return lattice_array(stackup, coil, Lattice(**given), **board.of_array)

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
    """Return the table of an array, a lattice only if it still gives the placements."""
    coil = array.placements[0].coil
    points = array.lattice.placements(coil) if isinstance(array.lattice, Lattice) else ()
    on_lattice = len(points) == len(array.placements) and all(
        place.coil is coil
        and (place.name, place.layers) == (point.name, point.layers)
        and max(abs(place.x - point.x), abs(place.y - point.y), abs(place.rotation - point.rotation)) < _SAME_PLACE
        for point, place in zip(points, array.placements, strict=True)
    )
    if isinstance(array.lattice, Lattice) and on_lattice:
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


class BendTable(Table):
    """``[[board.bends]]``: one bent strip of a flexible board, flat beside it."""

    radius_mm: _Radius
    """Radius of the inner face; positive bends the edges down, negative up."""
    at_mm: Position
    """Middle of the strip, across the axis of the bend, on the flat board."""
    width_mm: Millimetres
    """Width of the strip on the flat board."""


class BoardTable(Table):
    """``[board]``: the edge of the board, the reach of its holes, and how a flexible board is bent."""

    ATTRIBUTES: ClassVar = {"margin_mm": "board_margin"}

    margin_mm: LimitMillimetres = 2.0
    """Distance from the outermost copper to the edge of the board."""
    through_holes: bool = True
    """Whether vias go through the whole board; blind and buried ones join their coil's layers."""
    bend_radius_mm: _Radius | None = None
    """Radius of the round body on which the whole board lies, that of its inner face; positive bends
    the edges down, negative up; flat by default."""
    bend_far_radius_mm: _Radius | None = None
    """Radius at the other end of the board, in the direction of the axis, for a cone; bend_radius_mm
    is then that at the end where the axis starts."""
    bend_axis_deg: Degrees = 0.0
    """Direction of the straight lines of the bent board; 0 is x."""
    bend_neutral_mm: Position | None = None
    """Height of the plane that keeps its lengths; the middle of the board by default."""
    bends: list[BendTable] = Field(default_factory=list)
    """Bent strips of a board that is flat beside them, instead of bend_radius_mm."""

    @model_validator(mode="after")
    def _one_kind_of_bend(self) -> BoardTable:
        for key in ("bend_radius_mm", "bend_far_radius_mm"):
            if getattr(self, key) == 0:
                raise ValueError(f"needs {key} other than 0; leave it out for a flat board")
        if self.bend_radius_mm is None:
            if self.bend_far_radius_mm is not None:
                raise ValueError("needs bend_radius_mm beside bend_far_radius_mm")
        elif self.bends:
            raise ValueError("has both bend_radius_mm and [[board.bends]]; one of them bends the board")
        elif self.bend_far_radius_mm is not None and self.bend_radius_mm * self.bend_far_radius_mm < 0:
            raise ValueError(
                f"needs bend_radius_mm and bend_far_radius_mm of one sign; got {self.bend_radius_mm:g} and "
                f"{self.bend_far_radius_mm:g}"
            )
        for k, bend in enumerate(self.bends):
            if bend.radius_mm == 0:
                raise ValueError(f"needs bends.{k}.radius_mm other than 0; leave the bend out for a flat board")
        return self

    @property
    def of_array(self) -> dict[str, Any]:
        """Values in SI of the flat array."""
        return self.in_si("margin_mm", "through_holes")

    @property
    def is_bent(self) -> bool:
        """Whether the table bends the board."""
        return self.bend_radius_mm is not None or bool(self.bends)

    def bent(self, array: Array) -> Array:
        """Return a flat array as the table bends it."""
        if not self.is_bent:
            return array
        thickness = array.stackup.thickness
        neutral = -thickness / 2 if self.bend_neutral_mm is None else self.bend_neutral_mm * MM
        frame = Bend((Zone(1.0),), self.bend_axis_deg * DEG, neutral)
        key = "bends" if self.bends else "bend_radius_mm"
        try:
            if self.bend_radius_mm is None:
                zones = [
                    Zone(frame.neutral_radius(one.radius_mm * MM, thickness), one.at_mm * MM, one.width_mm * MM)
                    for one in self.bends
                ]
                return array.bent(replace(frame, zones=tuple(zones)))
            near, far = self.bend_radius_mm * MM, (self.bend_far_radius_mm or self.bend_radius_mm) * MM
            return array.bent(frame.between(near, far, array.bounds, thickness))
        except GeometryError as error:
            raise DesignError(f"board.{key}: {error}") from None

    @classmethod
    def of(cls, array: Array) -> dict[str, Any]:
        """Return the entries of a board."""
        table = cls.entries_of(array, "margin_mm", "through_holes")
        if array.form is None:
            return table
        bend, thickness = array.form, array.stackup.thickness
        if not isinstance(bend, Bend):
            raise DesignError(f"a design file cannot hold a board of the form {bend!r:.60}.")

        def radius(of_neutral: float) -> float:
            guess = 2 * of_neutral - bend.neutral_radius(of_neutral, thickness)
            return nearest_entry(guess / MM, of_neutral, lambda entry: bend.neutral_radius(entry * MM, thickness))

        if bend.neutral != -thickness / 2:
            table["bend_neutral_mm"] = entry_of(bend.neutral, MM)
        if bend.axis:
            table["bend_axis_deg"] = entry_of(bend.axis, DEG)
        first = bend.zones[0]
        if bend.apex is not None:
            near, far = (float(f"{one / MM:.12g}") for one in bend.end_radii(array.bounds, thickness))
            return {**table, "bend_radius_mm": near, "bend_far_radius_mm": far}
        if len(bend.zones) == 1 and first.width == math.inf:
            return {**table, "bend_radius_mm": radius(first.radius)}
        table["bends"] = [
            {"radius_mm": radius(zone.radius), **BendTable.entries_of(zone, "at_mm", "width_mm")} for zone in bend.zones
        ]
        return table


def require_layers(stackup: Stackup, layers: Iterable[str], key: str) -> None:
    """Refuse a copper layer that a board does not have."""
    for layer in layers:
        if layer not in stackup.names:
            known = listed(stackup.names)
            raise DesignError(f"{key} names no copper layer; stackup.layers has {known}; got {shown(layer)}.")


def coil_named(coils: Mapping[str, Coil], name: str, key: str) -> Coil:
    """Return the shape of a name, which a key gives."""
    if name not in coils:
        raise DesignError(f"{key} names no coil shape; [coils] has {', '.join(coils) or 'none'}; got {name!r}.")
    return coils[name]
