"""Tables of metal bodies in a design file.

The module also checks where plates lie beside the board and the sheets.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from typing import Annotated, Any, Literal

import shapely
from pydantic import Field, model_validator

from coilarray.design.units import SCALES, LimitMillimetres, Millimetres, Name, Position, Table
from coilarray.errors import DesignError
from coilarray.geometry import MATERIALS, Disc, FinitePlate, Material, Outline, Plate, Polygon, Rectangle, Ring
from coilarray.geometry.plate import TOUCHING

_MM, _DEG = SCALES["mm"], SCALES["deg"]
_MS = 1e6  # S/m

Corner = Annotated[list[Position], Field(min_length=2, max_length=2)]
Corners = Annotated[list[Corner], Field(min_length=3, max_length=10_000)]
Shape = Literal["plate", "disc", "rectangle", "ring", "polygon"]
SIZES: Mapping[Shape, tuple[str, ...]] = {
    "plate": (), "disc": ("diameter_mm",), "rectangle": ("width_mm", "height_mm"),
    "ring": ("diameter_mm", "inner_diameter_mm"), "polygon": ("corners_mm",),
}  # fmt: skip
"""Keys of the sizes that each shape needs. A polygon may have holes too."""


class MaterialTable(Table):
    """Keys of what carries eddy currents: a named material, or its conductivity and permeability."""

    material: str | None = None
    """Name of the material; or give the two keys that follow."""
    conductivity_MS_per_m: Annotated[float, Field(ge=0, le=1e6)] | None = None  # noqa: N815 - the unit
    """Electrical conductivity."""
    relative_permeability: Annotated[float, Field(ge=1, le=1e6)] | None = None
    """Relative permeability; 1 by default."""

    @model_validator(mode="after")
    def _known_material(self) -> MaterialTable:
        """Refuse an unknown material or contradicting keys."""
        if self.material is not None and self.material not in MATERIALS:
            close = difflib.get_close_matches(self.material, MATERIALS, n=1)
            hint = f"; did you mean {close[0]}?" if close else ""
            raise ValueError(
                f"needs a material of {', '.join(MATERIALS)}, or conductivity_MS_per_m; got {self.material!r}{hint}"
            )
        if self.material is not None and (self.conductivity_MS_per_m, self.relative_permeability) != (None, None):
            raise ValueError("needs either a material, or conductivity_MS_per_m and relative_permeability; got both")
        return self

    def substance(self, name: str) -> Material | None:
        """Return the material in SI.

        A material without a name gets a name of its own. The result is None if no material is given.
        """
        if self.material is not None:
            return MATERIALS[self.material]
        if self.conductivity_MS_per_m is None and self.relative_permeability is None:
            return None
        return Material(name, (self.conductivity_MS_per_m or 0.0) * _MS, self.relative_permeability or 1.0)


class FlatTable(MaterialTable):
    """Keys of a flat piece: shape and sizes, thickness and material; without a shape it is wide."""

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
    def _sizes_of_its_shape(self) -> FlatTable:
        """Refuse missing or extra keys of a shape."""
        needed = SIZES[self.shape]
        for key in {key for keys in SIZES.values() for key in keys}:
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

    def flat(self, name: str) -> tuple[Material, Outline | None, float]:
        """Return material, outline and thickness in m.

        The outline of a wide plate is None.
        """
        material = self.substance(name)
        assert material is not None  # the validator has checked it
        sizes = [getattr(self, key) for key in SIZES[self.shape]]
        return material, _OUTLINES[self.shape](sizes, self.holes_mm), self.thickness_mm * _MM


_OUTLINES: Mapping[Shape, Callable[[list[Any], list[Any]], Outline | None]] = {
    "plate": lambda sizes, holes: None,
    "disc": lambda sizes, holes: Disc(sizes[0] * _MM / 2),
    "rectangle": lambda sizes, holes: Rectangle(sizes[0] * _MM, sizes[1] * _MM),
    "ring": lambda sizes, holes: Ring(sizes[0] * _MM / 2, sizes[1] * _MM / 2),
    "polygon": lambda sizes, holes: Polygon(_points(sizes[0]), tuple(map(_points, holes))),
}


def _points(corners: Sequence[Sequence[float]]) -> tuple[tuple[float, float], ...]:
    return tuple((x * _MM, y * _MM) for x, y in corners)


class PlateTable(FlatTable):
    """``[[plate]]``: metal above or below the board that stays where it is."""

    name: Name
    """Name of the plate."""
    z_mm: Position | None = None
    """Height of its lower face (of a tilted one: below its centre); z = 0 is the top face of the first layer."""
    distance_mm: LimitMillimetres | None = None
    """Instead of z_mm: the gap to the sheets above the board or to the board's underside."""
    side: Literal["above", "below"] | None = None
    """With distance_mm: the side of the board."""
    x_mm: Position = 0.0
    """x of the centre of a shape with an outline."""
    y_mm: Position = 0.0
    """y of the centre of a shape with an outline."""

    @model_validator(mode="after")
    def _one_height(self) -> PlateTable:
        """Refuse missing or contradicting keys of the height."""
        if (self.z_mm is None) == (self.distance_mm is None):
            raise ValueError("needs exactly one of z_mm and distance_mm")
        if (self.side is None) != (self.distance_mm is None):
            raise ValueError('needs side = "above" or "below" with distance_mm, and only with it')
        if self.shape == "plate" and (self.x_mm or self.y_mm):
            raise ValueError('has no x_mm and y_mm for shape = "plate", which is an infinite plate')
        return self

    def build(self, top: float, underside: float) -> Plate | FinitePlate:
        """Return the plate in SI.

        `top` is the height of the sheets' upper face in m, and `underside` the height of the board's lower face.
        """
        material, outline, thickness = self.flat(self.name)
        lower = (self.z_mm or 0.0) * _MM
        if outline is None:
            plate: Plate | FinitePlate = Plate(self.name, lower, thickness, material)
        else:
            centre = (self.x_mm * _MM, self.y_mm * _MM, lower + thickness / 2)
            tilt = (self.tilt_deg * _DEG, self.tilt_direction_deg * _DEG)
            plate = FinitePlate(self.name, outline, centre, thickness, material, *tilt)
        if self.distance_mm is None:
            return plate
        low, high = plate.heights
        gap = self.distance_mm * _MM
        return plate.lifted(top + gap - low if self.side == "above" else underside - gap - high)


def check_plates(plates: Sequence[Plate | FinitePlate], top: float, lowest_copper: float) -> None:
    """Refuse plates of one name or in a wrong place.

    Plates in the sheets, in the coils' copper or in each other raise a DesignError. `top` is the height in m of the
    sheets' upper face, and `lowest_copper` the height of the lowest face of the coils' copper. Below it plates may lie
    in the board, such as a copper pour.
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
        if low < roof - TOUCHING and floor < high - TOUCHING and _share_ground(one, other):
            raise DesignError(f"plate.{m} must not overlap another plate; {other.name!r} reaches into {one.name!r}.")


def _share_ground(one: Plate | FinitePlate, other: Plate | FinitePlate) -> bool:
    """Check whether two plates cover a common board area."""
    if isinstance(one, Plate) or isinstance(other, Plate):
        return True
    first, second = (
        shapely.Polygon(plate.on_board(plate.outline.exterior), [plate.on_board(hole) for hole in plate.outline.holes])
        for plate in (one, other)
    )
    return bool(shapely.area(shapely.intersection(first, second)) > 0)


def flat_entries(
    plate: Plate | FinitePlate, number: Callable[[float, float], float], place: Callable[[float], float]
) -> dict[str, Any]:
    """Return the keys of a `FlatTable`.

    `number` gives the entry of a value in a unit, and `place` the entry of a value in m.
    """
    table: dict[str, Any] = {"thickness_mm": number(plate.thickness, _MM), **material_entries(plate.material, number)}
    if isinstance(plate, Plate):
        return table
    match plate.outline:
        case Disc(radius):
            table |= {"shape": "disc", "diameter_mm": number(radius, _MM / 2)}
        case Rectangle(width, height):
            table |= {"shape": "rectangle", "width_mm": number(width, _MM), "height_mm": number(height, _MM)}
        case Ring(radius, inner):
            sizes = {"diameter_mm": number(radius, _MM / 2), "inner_diameter_mm": number(inner, _MM / 2)}
            table |= {"shape": "ring"} | sizes
        case Polygon(exterior, holes):
            table |= {"shape": "polygon", "corners_mm": [[place(x), place(y)] for x, y in exterior]}
            table |= {"holes_mm": [[[place(x), place(y)] for x, y in hole] for hole in holes]} if holes else {}
    angles = {"tilt_deg": plate.tilt, "tilt_direction_deg": math.remainder(plate.tilt_direction, 2 * math.pi)}
    return table | {key: number(angle, _DEG) for key, angle in angles.items() if angle}


def material_entries(material: Material, number: Callable[[float, float], float]) -> dict[str, Any]:
    """Return the keys of a `MaterialTable`.

    `number` has the same meaning as in `flat_entries`. A perfect conductor raises a DesignError.
    """
    if MATERIALS.get(material.name) == material:
        return {"material": material.name}
    if math.isinf(material.conductivity):
        raise DesignError(f"a design file has no perfect conductor; got {material.name!r}.")
    values = {"conductivity_MS_per_m": number(material.conductivity, _MS)}
    magnetic = material.relative_permeability
    return values | ({"relative_permeability": float(magnetic)} if magnetic != 1 else {})
