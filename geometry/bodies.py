"""Bodies of metal or ferrite: plates, balls and targets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from types import MappingProxyType
from typing import ClassVar, TypeAlias

import numpy as np
import shapely

from coilarray.compute.arrays import FloatArray
from coilarray.constants import MU_0
from coilarray.errors import GeometryError, require_finite, require_positive
from coilarray.geometry.arcs import Point


@dataclass(frozen=True)
class Material:
    """Uniform, linear material that carries eddy currents.

    `name` is as in `MATERIALS` or your own. `conductivity` is in S/m, inf for a perfect conductor.
    `relative_permeability` is at least 1. A material has one of them, else it is air.

    >>> round(MATERIALS["copper"].skin_depth(1e6) * 1e6, 1)
    66.1
    """

    name: str
    conductivity: float
    relative_permeability: float = 1.0

    def __post_init__(self) -> None:
        if not self.conductivity >= 0:
            raise GeometryError(f"conductivity of {self.name!r} must be at least 0; got {self.conductivity} S/m.")
        if not (math.isfinite(self.relative_permeability) and self.relative_permeability >= 1):
            raise GeometryError(
                f"relative permeability of {self.name!r} must be at least 1; got {self.relative_permeability}."
            )
        if self.conductivity == 0 and self.relative_permeability == 1:
            raise GeometryError(
                f"{self.name!r} must have a conductivity above 0 or a permeability above 1; it has neither."
            )

    @property
    def words(self) -> str:
        """Name for people, such as "stainless steel"."""
        return self.name.replace("_", " ")

    def skin_depth(self, frequency: float) -> float:
        """Skin depth 1/√(π f µ σ) in m at a `frequency` in Hz."""
        product = math.pi * frequency * MU_0 * self.relative_permeability * self.conductivity
        return math.inf if product == 0 else 1 / math.sqrt(product)


_IACS = 58.0e6  # S/m, 100 % IACS
_SOURCES: tuple[tuple[Material, str], ...] = (
    (Material("copper", _IACS), "annealed copper, 100 % IACS (IEC 60028)"),
    (Material("aluminium", 0.61 * _IACS), "EN AW-1050A, 61 % IACS (ASM Handbook vol. 2)"),
    (Material("aluminium_6061", 0.43 * _IACS), "EN AW-6061-T6, 43 % IACS (ASM Handbook vol. 2)"),
    (Material("brass", 0.28 * _IACS), "C26000, CuZn30, 28 % IACS (Copper Development Association)"),
    (Material("stainless_steel", 1 / 0.72e-6), "AISI 304, 0.72 µΩm, annealed, taken as not magnetic (ASM Handbook)"),
    (Material("steel", 1 / 0.143e-6, 200.0), "AISI 1010, 0.143 µΩm (ASM Handbook); its µr of 200 is assumed"),
    (Material("bearing_steel", 1 / 0.22e-6, 100.0), "AISI 52100, 0.22 µΩm (ASM Handbook); its µr of 100 is assumed"),
    (Material("titanium", 1 / 0.56e-6), "grade 2, 0.56 µΩm (ASM Handbook vol. 2)"),
    (Material("ferrite", 0.1, 2200.0), "MnZn N87, initial µr 2200 and 10 Ωm at 25 °C (TDK)"),
)
MATERIALS: Mapping[str, Material] = MappingProxyType({material.name: material for material, _ in _SOURCES})
"""Materials by their names in files, at 20 °C unless stated otherwise."""
MATERIAL_SOURCES: Mapping[str, str] = MappingProxyType({material.name: source for material, source in _SOURCES})
"""Grade of every named material, source of its values, and assumptions."""


TOUCHING = 1e-9  # length in m by which touching bodies may overlap through rounding of summed thicknesses
_CORNERS = 96  # of the polygon that stands for a circle of the same area


@dataclass(frozen=True)
class Plate:
    """Infinite flat plate of one `material`, parallel to the board.

    It stands for a plate that is wide compared with the coils. `z` is the height of its lower face in
    m, with the upper face of the board at 0. The `thickness` is in m. Messages show its `name`.
    """

    name: str
    z: float
    thickness: float
    material: Material

    def __post_init__(self) -> None:
        if not math.isfinite(self.z):
            raise GeometryError(f"height of plate {self.name!r} must be finite; got {self.z} m.")
        require_positive(f"thickness of plate {self.name!r}", self.thickness)

    @property
    def heights(self) -> tuple[float, float]:
        """Heights in m of its lower and its upper face."""
        return self.z, self.z + self.thickness

    def lifted(self, height: float) -> Plate:
        """Return the plate moved up by `height` in m."""
        return replace(self, z=self.z + height)


@dataclass(frozen=True)
class Disc:
    """Circular outline, given by its radius in m."""

    radius: float
    holes: ClassVar[tuple[tuple[Point, ...], ...]] = ()

    def __post_init__(self) -> None:
        require_positive("radius of a disc", self.radius)

    @property
    def exterior(self) -> tuple[Point, ...]:
        """Corners in m of a polygon of equal area, anticlockwise."""
        return _circle(self.radius)


@dataclass(frozen=True)
class Rectangle:
    """Rectangular outline of `width` along x and `height` along y, in m."""

    width: float
    height: float

    def __post_init__(self) -> None:
        require_positive("width of a rectangle", self.width)
        require_positive("height of a rectangle", self.height)

    @property
    def exterior(self) -> tuple[Point, ...]:
        """Corners in m about the centre, anticlockwise."""
        x, y = self.width / 2, self.height / 2
        return (-x, -y), (x, -y), (x, y), (-x, y)

    holes: ClassVar[tuple[tuple[Point, ...], ...]] = ()


@dataclass(frozen=True)
class Ring:
    """Outline between circles of `radius` and `inner_radius` in m."""

    radius: float
    inner_radius: float

    def __post_init__(self) -> None:
        require_positive("inner radius of a ring", self.inner_radius)
        require_positive("radius of a ring", self.radius)
        if not self.inner_radius < self.radius:
            raise GeometryError(
                f"inner radius of a ring must be less than its radius of {self.radius} m; got {self.inner_radius} m."
            )

    @property
    def exterior(self) -> tuple[Point, ...]:
        """Corners in m of the outer polygon of equal area."""
        return _circle(self.radius)

    @property
    def holes(self) -> tuple[tuple[Point, ...], ...]:
        """Corners in m of the inner polygon, of equal area."""
        return (_circle(self.inner_radius),)


@dataclass(frozen=True)
class Polygon:
    """Outline of any polygon, with holes.

    Corners (x, y) of `exterior` and `holes` are in m about the centre of the plate, in either sense,
    the first not repeated. Holes are inside, and no line crosses or touches itself or another.
    """

    exterior: tuple[Point, ...]
    holes: tuple[tuple[Point, ...], ...] = ()

    def __post_init__(self) -> None:
        for corners in (self.exterior, *self.holes):
            if len(corners) < 3 or not np.isfinite(corners).all():
                raise GeometryError(f"an outline must have at least 3 finite corners; got {len(corners)}.")
        outline = shapely.Polygon(self.exterior, self.holes)
        if not outline.is_valid or outline.area == 0:
            reason = shapely.is_valid_reason(shapely.transform(outline, lambda corners: corners * 1e3))
            raise GeometryError(
                f"an outline must not cross or touch itself, and its holes must be inside; {reason} (mm)."
            )


def _circle(radius: float) -> tuple[Point, ...]:
    angle = 2 * math.pi * np.arange(_CORNERS) / _CORNERS
    corner = radius * math.sqrt(2 * math.pi / _CORNERS / math.sin(2 * math.pi / _CORNERS))
    return tuple(zip((corner * np.cos(angle)).tolist(), (corner * np.sin(angle)).tolist(), strict=True))


Outline: TypeAlias = Disc | Rectangle | Ring | Polygon
"""Outline of a plate seen from above. All kinds have `exterior` and `holes`."""


@dataclass(frozen=True)
class FinitePlate:
    """Flat plate with an outline, possibly tilted.

    `name`, `thickness` and `material` are as in `Plate`. The `outline` is about the plate's
    `centre`, whose x, y and z in m are in the middle of the thickness. The plate rises by the angle
    `tilt` in rad, less than a right angle, towards the direction `tilt_direction` in rad from the x
    axis.
    """

    name: str
    outline: Outline
    centre: tuple[float, float, float]
    thickness: float
    material: Material
    tilt: float = 0.0
    tilt_direction: float = 0.0

    def __post_init__(self) -> None:
        require_positive(f"thickness of plate {self.name!r}", self.thickness)
        if not all(map(math.isfinite, (*self.centre, self.tilt_direction))):
            raise GeometryError(f"place of plate {self.name!r} must be finite; got {self.centre} m.")
        if not abs(self.tilt) < math.pi / 2:
            raise GeometryError(
                f"tilt of plate {self.name!r} must be less than 90 degrees; got {math.degrees(self.tilt):g}."
            )

    @property
    def axes(self) -> FloatArray:
        """Unit vectors of the plate's x, y and normal on the board, dimensionless, shape (3, 3)."""
        cos, sin = math.cos(self.tilt_direction), math.sin(self.tilt_direction)
        rise, run = math.sin(self.tilt), math.cos(self.tilt)
        along, across = np.array([cos * run, sin * run, rise]), np.array([-sin, cos, 0.0])
        normal = np.array([-cos * rise, -sin * rise, run])
        return np.array([cos * along - sin * across, sin * along + cos * across, normal])

    def on_board(self, points: FloatArray | Sequence[Point]) -> FloatArray:
        """Transform points (n, 2) in m of the mid-plane to the board."""
        return np.asarray(np.array(self.centre) + np.asarray(points) @ self.axes[:2])

    def lifted(self, height: float) -> FinitePlate:
        """Return the plate moved up by `height` in m."""
        x, y, z = self.centre
        return replace(self, centre=(x, y, z + height))

    @property
    def heights(self) -> tuple[float, float]:
        """Heights in m of its lowest and its highest point."""
        z = self.on_board(self.outline.exterior)[:, 2]
        half = self.thickness / 2 * math.cos(self.tilt)
        return float(z.min()) - half, float(z.max()) + half


@dataclass(frozen=True)
class Ball:
    """Solid sphere of one `material`, with `radius` in m, without a position."""

    radius: float
    material: Material

    def __post_init__(self) -> None:
        require_positive("radius of a sphere", self.radius)


Body: TypeAlias = Plate | FinitePlate | Ball
"""Possible bodies of a target. The position of a plate has no effect, its tilt has."""


@dataclass(frozen=True)
class Target:
    """Rigid body moved to places at distances above the board.

    The position of the `body` has no effect. The `distances` in m, in rising order, are gaps
    between its nearest point and the highest face of board and sheets. `x` and `y` are places of
    its centre in m, relative to `origin_point`, the x and y in m of the origin on the board, which
    `coilarray.Design` sets for a coil of the name `origin`. If both are empty, `coilarray.Design`
    sets an even grid over all coils, with the distance `step` in m, which by default follows from
    the coils. These x and y are `over_array`, and are replaced for another array. An infinite plate
    has one place.

    >>> from coilarray.geometry import MATERIALS, Plate
    >>> target = Target(Plate("target", 0.0, 1e-3, MATERIALS["aluminium"]), (1e-3, 2e-3))
    >>> target.height(0.5e-3, 2e-3)
    0.0025
    """

    body: Body
    distances: tuple[float, ...]
    x: tuple[float, ...] = ()
    y: tuple[float, ...] = ()
    origin: str | None = None
    origin_point: tuple[float, float] = (0.0, 0.0)
    step: float | None = None
    over_array: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())

    def __post_init__(self) -> None:
        if not self.distances or not all(near < far for near, far in pairwise((0.0, *self.distances))):
            raise GeometryError(
                "distances of a target must rise from above zero, at least one; "
                f"got {', '.join(f'{distance * 1e3:g}' for distance in self.distances) or 'none'} mm."
            )
        require_finite("distances and places of a target", *self.distances, *self.x, *self.y, *self.origin_point)
        if bool(self.x) != bool(self.y):
            raise GeometryError("a target must have both x and y, or neither.")
        if isinstance(self.body, Plate) and max(len(self.x), len(self.y)) > 1:
            raise GeometryError("an infinite plate is the same everywhere: as a target it must have one x and one y.")

    @property
    def kind(self) -> str:
        """Kind of body: ``"plate"``, the name of an outline, or ``"sphere"``."""
        if isinstance(self.body, Plate):
            return "plate"
        return type(self.body.outline).__name__.lower() if isinstance(self.body, FinitePlate) else "sphere"

    @property
    def extent(self) -> float:
        """Height in m from the body's lowest to highest point."""
        if isinstance(self.body, Plate | FinitePlate):
            low, high = self.body.heights
            return high - low
        return 2 * self.body.radius

    def height(self, face: float, distance: float) -> float:
        """Height in m of the body's centre, of an infinite plate's lower face.

        `distance` is measured from `face` to the body's nearest point, both in m.
        """
        if isinstance(self.body, Plate):
            return face + distance
        below = self.body.radius if isinstance(self.body, Ball) else self.body.centre[2] - self.body.heights[0]
        return face + distance + below
