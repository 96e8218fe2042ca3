"""Tables of a design file about sheets, indenter and metal, and default positions of a map.

`in_si` or `build` makes the values, `entries_of` or `of` the entries in the units of their keys.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain, combinations
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, TypeAlias

import numpy as np
import shapely
from pydantic import Field, model_validator

from coilarray import geometry
from coilarray.compute.arrays import FloatArray
from coilarray.design.keys import (
    DEG,
    MM,
    LimitMillimetres,
    Millimetres,
    Name,
    Point,
    Position,
    Range,
    Relative,
    Table,
    entry_of,
    nearest_entry,
    require_rising,
)
from coilarray.errors import DesignError
from coilarray.geometry.bodies import TOUCHING
from coilarray.geometry.elastomer import KPA_PER_MM, Base, Strain

if TYPE_CHECKING:
    from coilarray.design.model import Indentation

_WHOLE_STEPS = 1e-6  # part of a step by which a range may miss a whole number of steps
_FEMTOMETRE = 1e-15

SeatSlope = Annotated[float, Field(ge=-1, le=1)]  # change of a seat along the board, per mm or in mm per mm
Corners = Annotated[list[Point], Field(min_length=3, max_length=10_000)]
PositionList = Annotated[list[Position], Field(min_length=1, max_length=100_000)]
Shape = Literal["plate", "disc", "rectangle", "ring", "polygon"]
Flat: TypeAlias = geometry.Plate | geometry.FinitePlate
_SIZES: Mapping[Shape, tuple[str, ...]] = {  # Keys of the sizes that each shape needs. A polygon may have holes too.
    "plate": (),
    "disc": ("diameter_mm",),
    "rectangle": ("width_mm", "height_mm"),
    "ring": ("diameter_mm", "inner_diameter_mm"),
    "polygon": ("corners_mm",),
}
_OUTLINES: Mapping[Shape, Callable[[Mapping[str, Any]], geometry.Outline | None]] = {
    "plate": lambda sizes: None,
    "disc": lambda sizes: geometry.Disc(sizes["diameter"] / 2),
    "rectangle": lambda sizes: geometry.Rectangle(sizes["width"], sizes["height"]),
    "ring": lambda sizes: geometry.Ring(sizes["diameter"] / 2, sizes["inner_diameter"] / 2),
    "polygon": lambda sizes: geometry.Polygon(sizes["exterior"], sizes["holes"]),
}
"""Outlines of each shape from its sizes in SI."""
_UNEVEN = (
    *("seat_stiffness_slope_x_per_mm", "seat_stiffness_slope_y_per_mm"),
    *("seat_gap_slope_x_mm_per_mm", "seat_gap_slope_y_mm_per_mm", "seat_lifts", "seat_weight_Pa"),
)
MOST_POSITIONS = 100_000  # most positions of a map
# Parts of the narrowest coil for the finest and the coarsest step, which resolve its response.
_PARTS = {"indentation": (12.0, 6.0), "target": (12.0, 4.0)}
_PARTS_OF_ONE = (32.0, 12.0)  # of a single coil, whose map is small
_POSITIONS = {"indentation": 2000.0, "target": 500.0}  # of a map, if the step allows. Targets are wide
_ROUND = 0.1e-3  # m. A step is a multiple of it, and a multiple of five times it from there on

Positions = tuple[tuple[float, ...], tuple[float, ...]]
Edges = tuple[float, float, float, float]  # x_min, y_min, x_max, y_max in m


class SheetTable(Table):
    """``[[elastomer]]``: one sheet on top of the board."""

    name: Name
    """Name of the sheet."""
    thickness_mm: Millimetres
    """Thickness of the sheet."""
    relative_permeability: Relative = 1.0
    """Relative permeability, above 1 if it is filled with iron powder."""
    youngs_modulus_kPa: Annotated[float, Field(ge=1e-6, le=1e9)] | None = None  # noqa: N815 - the unit
    """Young's modulus; needed if something presses on it."""
    poissons_ratio: Annotated[float, Field(ge=0, le=0.5)] = 0.4999
    """Poisson's ratio, up to 0.5, which keeps the volume."""


class MaterialTable(Table):
    """Keys of a conductor: a named material, or its values."""

    material: str | None = None
    """Name of the material; or give the two keys that follow."""
    conductivity_MS_per_m: Annotated[float, Field(ge=0, le=1e6)] | None = None  # noqa: N815 - the unit
    """Electrical conductivity."""
    relative_permeability: Annotated[float, Field(ge=1, le=1e6)] | None = None
    """Relative permeability; 1 by default."""

    @model_validator(mode="after")
    def _known_material(self) -> Self:
        if self.material is not None and self.material not in geometry.MATERIALS:
            close = difflib.get_close_matches(self.material, geometry.MATERIALS, n=1)
            hint = f"; did you mean {close[0]}?" if close else ""
            raise ValueError(
                f"needs a material of {', '.join(geometry.MATERIALS)}, or conductivity_MS_per_m; "
                f"got {self.material!r}{hint}"
            )
        if self.material is not None and (self.conductivity_MS_per_m, self.relative_permeability) != (None, None):
            raise ValueError("needs either a material, or conductivity_MS_per_m and relative_permeability; got both")
        return self

    def substance(self, name: str) -> geometry.Material | None:
        """Return the material in SI, called `name` if not known."""
        if self.material is not None:
            return geometry.MATERIALS[self.material]
        if self.conductivity_MS_per_m is None and self.relative_permeability is None:
            return None
        conductivity = self.in_si("conductivity_MS_per_m")["conductivity"]
        return geometry.Material(name, conductivity or 0.0, self.relative_permeability or 1.0)

    @classmethod
    def of_material(cls, material: geometry.Material) -> dict[str, Any]:
        """Return the entries of a material, not a perfect conductor."""
        if geometry.MATERIALS.get(material.name) == material:
            return {"material": material.name}
        if math.isinf(material.conductivity):
            raise DesignError(f"a design file has no perfect conductor; got {material.name!r}.")
        entries = cls.entries_of(material, "conductivity_MS_per_m")
        magnetic = material.relative_permeability != 1
        return entries | (cls.entries_of(material, "relative_permeability") if magnetic else {})


class FlatTable(MaterialTable):
    """Keys of a flat piece: shape and sizes, thickness and material; without a shape it is wide."""

    ATTRIBUTES: ClassVar = {"corners_mm": "exterior"}

    shape: Shape = "plate"
    """Outline; a plate is infinite."""
    thickness_mm: Millimetres
    """Thickness."""
    diameter_mm: Millimetres | None = None
    """Diameter of a disc, outer diameter of a ring."""
    inner_diameter_mm: Millimetres | None = None
    """Inner diameter of a ring."""
    width_mm: Millimetres | None = None
    """Size of a rectangle along x."""
    height_mm: Millimetres | None = None
    """Size of a rectangle along y."""
    corners_mm: Corners | None = None
    """Corners [x, y] of a polygon."""
    holes_mm: list[Corners] = Field(default_factory=list)
    """Holes of a polygon, each as corners [x, y]."""
    tilt_deg: Annotated[float, Field(gt=-90, lt=90)] = 0.0
    """Angle to the board."""
    tilt_direction_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    """Direction in which the tilted piece rises; 0 is +x."""

    @model_validator(mode="after")
    def _sizes_of_its_shape(self) -> Self:
        needed = _SIZES[self.shape]
        for key in dict.fromkeys(key for keys in _SIZES.values() for key in keys):
            if (getattr(self, key) is not None) != (key in needed):
                raise ValueError(f'{"needs" if key in needed else "has no"} {key} for shape = "{self.shape}"')
        if self.holes_mm and self.shape != "polygon":
            raise ValueError(f'has no holes_mm for shape = "{self.shape}"')
        if self.diameter_mm and self.inner_diameter_mm and self.inner_diameter_mm >= self.diameter_mm:
            raise ValueError(
                f"needs inner_diameter_mm below its diameter_mm of {self.diameter_mm:g}; got {self.inner_diameter_mm:g}"
            )
        if self.shape == "plate" and (self.tilt_deg or self.tilt_direction_deg):
            raise ValueError('has no tilt for shape = "plate", which is an infinite plate')
        if (self.material, self.conductivity_MS_per_m, self.relative_permeability) == (None, None, None):
            raise ValueError("needs a material, or conductivity_MS_per_m and relative_permeability")
        return self

    def piece(self, name: str, x: float = 0.0, y: float = 0.0, lower: float = 0.0) -> Flat:
        """Return the piece in SI, with its lower face's middle."""
        material = self.substance(name)
        assert material is not None  # the validator has checked it
        sizes = self.in_si(*FlatTable.model_fields)
        outline, thickness = _OUTLINES[self.shape](sizes), sizes["thickness"]
        if outline is None:
            return geometry.Plate(name, lower, thickness, material)
        centre = (x, y, lower + thickness / 2)
        return geometry.FinitePlate(name, outline, centre, thickness, material, sizes["tilt"], sizes["tilt_direction"])

    @classmethod
    def of_piece(cls, plate: Flat) -> dict[str, Any]:
        """Return the entries of a flat piece but its place."""
        table: dict[str, Any] = cls.entries_of(plate, "thickness_mm") | cls.of_material(plate.material)
        if isinstance(plate, geometry.Plate):
            return table
        match plate.outline:
            case geometry.Disc(radius):
                table |= {"shape": "disc", "diameter_mm": entry_of(radius, MM / 2)}
            case geometry.Rectangle():
                table |= {"shape": "rectangle"} | cls.entries_of(plate.outline, "width_mm", "height_mm")
            case geometry.Ring(radius, inner):
                sizes = {"diameter_mm": entry_of(radius, MM / 2), "inner_diameter_mm": entry_of(inner, MM / 2)}
                table |= {"shape": "ring"} | sizes
            case geometry.Polygon(_, holes):
                keys = ("corners_mm", "holes_mm") if holes else ("corners_mm",)
                table |= {"shape": "polygon"} | cls.entries_of(plate.outline, *keys)
        angles = {"tilt_deg": plate.tilt, "tilt_direction_deg": math.remainder(plate.tilt_direction, 2 * math.pi)}
        return table | {key: entry_of(angle, DEG) for key, angle in angles.items() if angle}


class PlateTable(FlatTable):
    """``[[plate]]``: metal above or below the board that stays where it is."""

    name: Name
    """Name of the plate."""
    z_mm: Position | None = None
    """Height of its lower face, below its centre if tilted; z = 0 is the top of the first layer."""
    distance_mm: LimitMillimetres | None = None
    """Instead of z_mm: the gap to the sheets above the board or to the board's underside."""
    side: Literal["above", "below"] | None = None
    """With distance_mm: the side of the board."""
    x_mm: Position = 0.0
    """x of the centre of a shape with an outline."""
    y_mm: Position = 0.0
    """y of the centre of a shape with an outline."""

    @model_validator(mode="after")
    def _one_height(self) -> Self:
        if (self.z_mm is None) == (self.distance_mm is None):
            raise ValueError("needs exactly one of z_mm and distance_mm")
        if (self.side is None) != (self.distance_mm is None):
            raise ValueError('needs side = "above" or "below" with distance_mm, and only with it')
        if self.shape == "plate" and (self.x_mm or self.y_mm):
            raise ValueError('has no x_mm and y_mm for shape = "plate", which is an infinite plate')
        return self

    def build(self, top: float, underside: float) -> Flat:
        """Return the plate in SI, for heights in m of the sheets' top and the board's underside."""
        plate = self.piece(self.name, self.x_mm * MM, self.y_mm * MM, (self.z_mm or 0.0) * MM)
        if self.distance_mm is None:
            return plate
        low, high = plate.heights
        gap = self.distance_mm * MM
        return plate.lifted(top + gap - low if self.side == "above" else underside - gap - high)

    @classmethod
    def of(cls, plate: Flat) -> dict[str, Any]:
        """Return the entries of a plate but its name."""
        if isinstance(plate, geometry.Plate):
            return cls.of_piece(plate) | cls.entries_of(plate, "z_mm")
        x, y, z = plate.centre
        places = {"x_mm": x, "y_mm": y, "z_mm": z - plate.thickness / 2}
        return cls.of_piece(plate) | {key: entry_of(place, MM) for key, place in places.items()}


def check_plates(plates: Sequence[Flat], top: float, lowest_copper: float) -> None:
    """Refuse plates of one name, or in anything else, for heights in m of sheets and coils.

    Below `lowest_copper` plates may lie in the board, such as a copper pour.
    """
    names = [plate.name for plate in plates]
    if len(set(names)) != len(names):
        raise DesignError(f"plates must have different names; got {', '.join(names)}.")
    for k, plate in enumerate(plates):
        low, high = plate.heights
        if low < top - TOUCHING and high > lowest_copper + TOUCHING:
            raise DesignError(
                f"plate.{k} must lie above the sheets and the board (z above {top * 1e3:g} mm) or below the coils' "
                f"copper (z below {lowest_copper * 1e3:g} mm); {plate.name!r} lies from {low * 1e3:g} to "
                f"{high * 1e3:g} mm."
            )
    for (_, one), (m, other) in combinations(enumerate(plates), 2):
        (low, high), (floor, roof) = one.heights, other.heights
        if low >= roof - TOUCHING or floor >= high - TOUCHING:
            continue
        areas = [
            shapely.Polygon(plate.on_board(plate.outline.exterior), [*map(plate.on_board, plate.outline.holes)])
            for plate in (one, other)
            if isinstance(plate, geometry.FinitePlate)
        ]
        if len(areas) < 2 or (areas[0] & areas[1]).area > 0:
            raise DesignError(f"plate.{m} must not overlap another plate; {other.name!r} reaches into {one.name!r}.")


class RoundTable(MaterialTable):
    """``[indenter]`` of every shape without an edge; without a material it is nothing to the field.

    A paraboloid has the radius of curvature at its tip. A cylinder edge is a long cylinder along y.
    """

    shape: Literal["hemisphere", "paraboloid", "cylinder_edge"]
    """Shape of the tip; a cylinder edge is a long cylinder that lies along y."""
    radius_mm: Millimetres
    """Radius; of a paraboloid that of the curvature at its tip."""

    def build(self) -> geometry.Indenter:
        """Return the indenter in SI."""
        radius = self.radius_mm * MM
        if self.shape == "cylinder_edge":
            return geometry.CylinderEdge(radius)
        return geometry.Paraboloid(radius) if self.shape == "paraboloid" else geometry.Hemisphere(radius)


class PunchTable(MaterialTable):
    """``[indenter]`` with ``shape = "flat_punch"``."""

    shape: Literal["flat_punch"]
    """A cylinder that presses with its flat end."""
    radius_mm: Millimetres
    """Radius of the punch."""
    edge_radius_mm: Millimetres | None = None
    """Radius of its rounded edge, a tenth of its radius by default; then gast2020's sheets take 0.3
    radii of depth."""

    def build(self) -> geometry.FlatPunch:
        """Return the indenter in SI."""
        return geometry.FlatPunch(**self.in_si("radius_mm", "edge_radius_mm"))


class ConeTable(MaterialTable):
    """``[indenter]`` with ``shape = "cone"``; the angle is between its axis and its side."""

    shape: Literal["cone"]
    """A cone that presses with its tip; large deformations do not reach far under some 45°."""
    half_angle_deg: Annotated[float, Field(gt=0, lt=90)]
    """Angle between its axis and its side."""
    radius_mm: Millimetres | None = None
    """Radius at which the cone ends; it is infinite by default."""
    edge_radius_mm: Millimetres | None = None
    """Radius of the rounded edge where it ends; a tenth of that radius by default."""

    def build(self) -> geometry.Cone:
        """Return the indenter in SI."""
        sizes = self.in_si()
        return geometry.Cone(sizes["half_angle"], sizes["radius"] or math.inf, sizes["edge_radius"])


IndenterTable: TypeAlias = RoundTable | PunchTable | ConeTable


def indenter_entries(indenter: geometry.Indenter, material: geometry.Material | None) -> dict[str, Any]:
    """Return the table of an indenter."""
    table: dict[str, Any] = {"shape": indenter.name.replace(" ", "_")}
    if isinstance(indenter, geometry.Cone):
        table |= ConeTable.entries_of(indenter, "half_angle_deg")
    if math.isfinite(indenter.radius):
        table |= RoundTable.entries_of(indenter, "radius_mm")
    if isinstance(indenter, geometry.Cone | geometry.FlatPunch):
        table |= ConeTable.entries_of(indenter, "edge_radius_mm")
    return table if material is None else table | MaterialTable.of_material(material)


class PlacesTable(Table):
    """Positions above the board, relative to an origin."""

    x_mm: Range | None = None
    """Range [low, high] of the positions along x; by default over all coils."""
    y_mm: Range | None = None
    """The same along y."""
    step_mm: Annotated[float, Field(ge=1e-3, le=10_000)] | None = None
    """Spacing of the positions; chosen for the coils by default."""
    x_positions_mm: PositionList | None = None
    """Instead of a range and a step: every x, rising."""
    y_positions_mm: PositionList | None = None
    """Every y, rising."""
    origin: str | None = None
    """Name of the coil whose centre is the origin of x and y; the board's origin by default."""
    origin_mm: Point | None = None
    """Point [x, y] on the board that is the origin of x and y."""

    @model_validator(mode="after")
    def _consistent_places(self) -> Self:
        if self.origin is not None and self.origin_mm is not None:
            raise ValueError("needs one of origin and origin_mm, not both")
        ranges = (self.x_mm, self.y_mm, self.step_mm)
        lists = (self.x_positions_mm, self.y_positions_mm)
        over_array = lists == ranges[:2] == (None, None)
        if not over_array and (
            None in (ranges if lists == (None, None) else lists) or (lists != (None, None) and ranges != (None,) * 3)
        ):
            raise ValueError(
                "needs x_mm, y_mm and step_mm, or x_positions_mm and y_positions_mm, or none of these for positions "
                "over all coils"
            )
        for key, values in (("x_mm", self.x_mm), ("y_mm", self.y_mm)):
            if values is None or self.step_mm is None:
                continue
            (low, high), step = values, self.step_mm
            if low > high:
                raise ValueError(f"needs {key} from low to high; got [{low:g}, {high:g}]")
            steps = (high - low) / step
            if abs(steps - round(steps)) > _WHOLE_STEPS:
                raise ValueError(
                    f"needs {key} to span a whole number of steps of {step:g} mm; {low:g} to {high:g} are {steps:g}"
                )
            if steps >= MOST_POSITIONS:
                raise ValueError(f"may have {MOST_POSITIONS} positions; {key} and step_mm give {steps + 1:g}")
        for key, positions in (("x_positions_mm", lists[0]), ("y_positions_mm", lists[1])):
            require_rising(key, positions or ())
        count = math.prod(map(len, self.positions()))
        if count > MOST_POSITIONS:
            raise ValueError(f"may have {MOST_POSITIONS} positions; x_mm, y_mm and step_mm give {count}")
        return self

    def positions(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return x and y in m, empty without a range."""
        if self.x_mm is None or self.y_mm is None or self.step_mm is None:
            return _in_m(self.x_positions_mm or ()), _in_m(self.y_positions_mm or ())
        return _even_positions(self.x_mm, self.step_mm), _even_positions(self.y_mm, self.step_mm)

    def places(self) -> dict[str, Any]:
        """Return x, y, origin and step in SI."""
        x, y = self.positions()
        point = (0.0, 0.0) if self.origin_mm is None else self.in_si("origin_mm")["origin"]
        step = None if x else self.in_si("step_mm")["step"]
        return {"x": x, "y": y, "origin": self.origin, "origin_point": point, "step": step}

    @classmethod
    def of_places(cls, setup: Indentation | geometry.Target, names: Mapping[str, str]) -> dict[str, Any]:
        """Return the entries of positions and their origin."""
        table: dict[str, Any]
        x, y = ([_label(value) for value in row] for row in (setup.x, setup.y))
        step = next((round(row[1] - row[0], 9) for row in (x, y) if len(row) > 1), 1.0)
        if (setup.x, setup.y) == setup.over_array:
            table = cls.entries_of(setup, "step_mm")
        elif _is_even(x, step) and _is_even(y, step):
            table = {"x_mm": [x[0], x[-1]], "y_mm": [y[0], y[-1]], "step_mm": step}
        else:
            table = {"x_positions_mm": x, "y_positions_mm": y}
        if setup.origin is not None:
            table["origin"] = names[setup.origin]
        elif any(setup.origin_point):
            table["origin_mm"] = [entry_of(value, MM) for value in setup.origin_point]
        return table


# Positions are labels, and -26 mm must be -0.026 m: divided by 1e3, not multiplied by 1e-3.
def _in_m(positions: Iterable[float]) -> tuple[float, ...]:
    return tuple(position / 1e3 for position in positions)


def _even_positions(bounds: Sequence[float], step: float) -> tuple[float, ...]:
    low, high = bounds
    steps = round((high - low) / step)
    return _in_m(low + (high - low) * k / max(steps, 1) for k in range(steps + 1))


def _label(value: float) -> float:
    return nearest_entry(1e3 * value, value, lambda entry: entry / 1e3)


def _is_even(row: Sequence[float], step: float) -> bool:
    if step <= 0 or round((row[-1] - row[0]) / step) != len(row) - 1:
        return False
    return np.allclose(_even_positions((row[0], row[-1]), step), np.array(row) / 1e3, rtol=0, atol=_FEMTOMETRE)


class IndentationTable(PlacesTable):
    """``[indentation]``: how deep and where the indenter presses."""

    strain: Strain = "finite"
    """Large deformations (neo-Hookean), or linear elasticity, faster and some percent less exact."""
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
    """Pressure of the sheets' own weight, which holds them down on a seat if they may lift off."""
    depths_mm: list[Millimetres] = Field(min_length=1)
    """Depths of the indentation, rising."""
    sample_radius_mm: Millimetres | None = None
    """Radius of a round sample with a free edge; infinite without it and the next two."""
    sample_x_mm: Range | None = None
    """Range of a rectangular sample with free sides along x, from the origin of the positions."""
    sample_y_mm: Range | None = None
    """The same along y."""
    ellipse_x_mm: Range | None = None
    """Range of the positions along x to which ellipses are fitted; all of the map by default."""
    ellipse_y_mm: Range | None = None
    """The same along y."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        require_rising("depths_mm", self.depths_mm)
        if (self.base == "seat") != (self.seat_stiffness_kPa_per_mm is not None):
            raise ValueError('needs seat_stiffness_kPa_per_mm for base = "seat", and for no other base')
        if self.base != "seat" and self.seat_shear_kPa_per_mm is not None:
            raise ValueError(f'needs base = "seat" for seat_shear_kPa_per_mm; got base = "{self.base}"')
        on_rectangle = self.base == "seat" and self.sample_x_mm is not None and not self.sample_radius_mm
        if self._unevenness() != geometry.EVEN and not on_rectangle:
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

    def values(self) -> dict[str, Any]:
        """Return the values in SI, as `coilarray.Indentation` takes them."""
        base: Base = "frictionless" if self.base == "frictionless" else "bonded"
        if self.seat_stiffness_kPa_per_mm is not None:
            shear = (self.seat_shear_kPa_per_mm or 0.0) * KPA_PER_MM
            base = geometry.Seat(self.seat_stiffness_kPa_per_mm * KPA_PER_MM, shear)
        values = self.in_si("depths_mm", "sample_radius_mm", "strain")
        for what in ("sample", "ellipse"):
            x, y = getattr(self, f"{what}_x_mm"), getattr(self, f"{what}_y_mm")
            values[f"{what}_bounds"] = None if x is None else _in_m((x[0], y[0], x[1], y[1]))
        return values | {"base": base, "unevenness": self._unevenness(), **self.places()}

    def _unevenness(self) -> geometry.Unevenness:
        stiffer_x, stiffer_y, wider_x, wider_y, lifts, weight = self.in_si(*_UNEVEN).values()
        return geometry.Unevenness((stiffer_x, stiffer_y), (wider_x, wider_y), lifts, weight)

    @classmethod
    def of(cls, setup: Indentation, names: Mapping[str, str]) -> dict[str, Any]:
        """Return the entries of an indentation."""
        table: dict[str, Any] = {"strain": setup.strain}
        if isinstance(setup.base, geometry.Seat):
            table |= {"base": "seat", "seat_stiffness_kPa_per_mm": entry_of(setup.base.stiffness, KPA_PER_MM)}
            if setup.base.shear:
                table["seat_shear_kPa_per_mm"] = entry_of(setup.base.shear, KPA_PER_MM)
        else:
            table["base"] = setup.base
        seat: geometry.Unevenness = setup.unevenness
        values = ((entry_of(slope, 1e3) for slope in seat.stiffness_slope), seat.gap_slope, (seat.lifts, seat.weight))
        table |= {key: value for key, value in zip(_UNEVEN, chain(*values), strict=True) if value}
        table |= cls.entries_of(setup, "depths_mm") | cls.of_places(setup, names)
        table |= cls.entries_of(setup, "sample_radius_mm")
        for what, bounds in (("sample", setup.sample_bounds), ("ellipse", setup.ellipse_bounds)):
            if bounds is not None:
                x_min, y_min, x_max, y_max = map(_label, bounds)
                table |= {f"{what}_x_mm": [x_min, x_max], f"{what}_y_mm": [y_min, y_max]}
        return table


class MovedTable(PlacesTable):
    """Where a target is moved: the same for all bodies."""

    distances_mm: list[Millimetres] = Field(default=[1.0, 2.0, 4.0, 8.0], min_length=1)
    """Distances of the target's nearest point from the highest face of board and sheets, rising."""

    @model_validator(mode="after")
    def _rising(self) -> Self:
        require_rising("distances_mm", self.distances_mm)
        return self

    def of_body(self, body: Flat | geometry.Ball) -> geometry.Target:
        """Return the target in SI."""
        return geometry.Target(body, distances=_in_m(self.distances_mm), **self.places())


class FlatTarget(FlatTable, MovedTable):
    """``[target]`` of every shape but the sphere."""

    shape: Shape
    """Outline; a plate is infinite."""

    @model_validator(mode="after")
    def _no_places_of_a_plate(self) -> Self:
        for key in PlacesTable.model_fields:
            if self.shape == "plate" and getattr(self, key) is not None:
                raise ValueError(f'has no {key} for shape = "plate", which is an infinite plate')
        return self

    def build(self) -> geometry.Target:
        """Return the target in SI."""
        piece = self.piece("target")
        return self.of_body(piece if isinstance(piece, geometry.Plate) else piece.lifted(-piece.thickness / 2))


class SphereTarget(MaterialTable, MovedTable):
    """``[target]`` with ``shape = "sphere"``."""

    shape: Literal["sphere"]
    """A ball."""
    diameter_mm: Millimetres
    """Diameter of the sphere."""

    @model_validator(mode="after")
    def _some_material(self) -> Self:
        if self.substance("target") is None:
            raise ValueError("needs a material, or conductivity_MS_per_m and relative_permeability")
        return self

    def build(self) -> geometry.Target:
        """Return the target in SI."""
        material = self.substance("target")
        assert material is not None  # the validator has checked it
        return self.of_body(geometry.Ball(self.diameter_mm * MM / 2, material))


def target_entries(target: geometry.Target, names: Mapping[str, str]) -> dict[str, Any]:
    """Return the table of a target."""
    body = target.body
    if isinstance(body, geometry.Ball):
        size = {"shape": "sphere", "diameter_mm": entry_of(body.radius, MM / 2)}
        table = size | MaterialTable.of_material(body.material)
    else:
        table = {"shape": "plate", **FlatTable.of_piece(body)}
    table["distances_mm"] = list(map(_label, target.distances))
    return table if isinstance(body, geometry.Plate) else table | PlacesTable.of_places(target, names)


def array_window(
    array: geometry.Array,
    origin: tuple[float, float],
    step: float | None = None,
    within: Edges | None = None,
    table: str = "indentation",
) -> Positions:
    """Return an even grid over all coils from an origin.

    Positions are multiples of the step in m: a twelfth of the narrowest coil, up to a sixth to
    avoid more than 2000 positions, up to a quarter for 500 of a target, a thirty-second up to a
    twelfth of a single coil, and wider above 100000. Without a position in `within` its middle is
    the only one.
    """
    bounds = np.reshape(array.outline_bounds, (2, 2)) - origin
    if step is None:
        sides = [np.ptp(place.to_board(place.coil.outline), axis=0).min() for place in array.placements]
        finest, coarsest = (float(min(sides)) / part for part in (_PARTS[table] if len(sides) > 1 else _PARTS_OF_ONE))
        even = math.sqrt(float(np.prod(np.ptp(bounds, axis=0))) / _POSITIONS[table])
        chosen = _round(min(max(even, finest), coarsest))
    else:
        chosen = step
    first, last = _multiples(bounds, chosen, within)
    while math.prod((last - first + 1).tolist()) > MOST_POSITIONS:
        if step is not None:
            raise DesignError(
                f"{table}.step_mm of {step * 1e3:g} gives more than {MOST_POSITIONS} positions over all coils."
            )
        chosen = _round(1.1 * chosen + 5 * _ROUND)  # rounding cannot take this back
        first, last = _multiples(bounds, chosen, within)
    x, y = (
        _in_m(round((a + k) * chosen * 1e3, 9) for k in range(round(b - a) + 1))
        for a, b in zip(first.tolist(), last.tolist(), strict=True)
    )
    return x, y


def _round(step: float) -> float:
    unit = _ROUND if step < 5 * _ROUND else 5 * _ROUND
    return max(round(step / unit), 1) * unit


def _multiples(bounds: FloatArray, step: float, within: Edges | None) -> tuple[FloatArray, FloatArray]:
    first, last = np.floor(bounds[0] / step + 1e-9), np.ceil(bounds[1] / step - 1e-9)
    if within is not None:
        first = np.maximum(first, np.ceil(np.array(within[:2]) / step - 1e-9))
        last = np.minimum(last, np.floor(np.array(within[2:]) / step + 1e-9))
        empty = last < first
        middle = (np.array(within[:2]) + within[2:]) / 2 / step
        first, last = np.where(empty, middle, first), np.where(empty, middle, last)
    return first, last
