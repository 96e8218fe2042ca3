"""The elastomer on a board and the bodies pressed in."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray
from coilarray.errors import GeometryError, require_positive

RigidBase = Literal["bonded", "frictionless"]
"""Contact of the lowest sheet with a rigid board: glued, or free to slide but not to lift off."""
Strain = Literal["finite", "linear"]  # large deformations of neo-Hookean sheets, or linear elasticity
KPA_PER_MM = 1e6  # stiffness of a seat of 1 kPa/mm in Pa/m


@dataclass(frozen=True)
class Sheet:
    """Flat sheet of uniform thickness that covers the board.

    The `name` is for example ``"base"`` or ``"magnetic"``, the `thickness` is in m, and the
    `relative_permeability` is 1 for a plain elastomer, above 1 for a filled one. `youngs_modulus`
    in Pa is None if it is unknown and the sheet cannot be indented. `poissons_ratio` is from 0 to
    0.5, which is incompressible.
    """

    name: str
    thickness: float
    relative_permeability: float = 1.0
    youngs_modulus: float | None = None
    poissons_ratio: float = 0.4999

    def __post_init__(self) -> None:
        require_positive(f"thickness of sheet {self.name!r}", self.thickness)
        if not (math.isfinite(self.relative_permeability) and self.relative_permeability >= 1):
            raise GeometryError(
                f"relative permeability of sheet {self.name!r} must be at least 1; got {self.relative_permeability}."
            )
        if self.youngs_modulus is not None:
            require_positive(f"Young's modulus of sheet {self.name!r}", self.youngs_modulus, " Pa")
        if not 0 <= self.poissons_ratio <= 0.5:
            raise GeometryError(f"Poisson's ratio of sheet {self.name!r} must be 0 to 0.5; got {self.poissons_ratio}.")

    @property
    def magnetic(self) -> bool:
        """Whether the sheet changes a magnetic field."""
        return self.relative_permeability > 1


@dataclass(frozen=True)
class Seat:
    """Soft support under the lowest sheet (a Winkler bed).

    The pressure at a point is proportional to its displacement. The seat stands for a film, trapped
    air or the roughness between a sheet and a board on which it was not cast. `stiffness` is the
    pressure per displacement normal to the board in Pa/m, `shear` the shear stress per displacement
    along the board, of which 0 lets the sheet slide. Under large deformations both are forces per
    undeformed area.

    >>> print(Seat(stiffness=4.3e6))
    seat of 4.3 kPa/mm
    """

    stiffness: float
    shear: float = 0.0

    def __post_init__(self) -> None:
        require_positive("stiffness of a seat", self.stiffness, " Pa/m")
        if not (math.isfinite(self.shear) and self.shear >= 0):
            raise GeometryError(f"shear stiffness of a seat must be finite and at least 0; got {self.shear} Pa/m.")

    def __str__(self) -> str:
        shear = f", {self.shear / KPA_PER_MM:.6g} kPa/mm along the board" if self.shear else ""
        return f"seat of {self.stiffness / KPA_PER_MM:.6g} kPa/mm{shear}"


Base: TypeAlias = RigidBase | Seat  # support of the lowest sheet: a rigid board, glued or sliding, or a soft seat


@dataclass(frozen=True)
class Unevenness:
    """Deviation of a sample's seat from an even, clamped seat.

    `stiffness_slope` is the relative change of the seat's stiffness along x and y in 1/m, from the
    origin of the map. The shear stiffness changes by the same factor. `gap_slope` is the rise of
    the gap between seat and flat sample along x and y in m per m. A negative gap is set to zero,
    because the sample would tilt. The gap has an effect only if the sample `lifts`: a seat that
    also pulls is a linear spring, whose length at rest changes nothing. `weight` is the pressure in
    Pa by which its weight holds a sample that can lift.
    """

    stiffness_slope: tuple[float, float] = (0.0, 0.0)
    gap_slope: tuple[float, float] = (0.0, 0.0)
    lifts: bool = False
    weight: float = 0.0

    def __post_init__(self) -> None:
        numbers = [*self.stiffness_slope, *self.gap_slope, self.weight]
        if not all(map(math.isfinite, numbers)) or self.weight < 0:
            raise GeometryError(
                f"slopes of a seat and the weight on it must be finite, the weight at least 0; got {numbers}."
            )


EVEN = Unevenness()  # seat that is the same everywhere and pulls as it pushes


Symmetry = Literal["axial", "plane"]  # ``"axial"`` is a body of revolution, ``"plane"`` a body infinitely long along y


class _Tip(ABC):
    """Common base of all indenters."""

    radius: float
    name: ClassVar[str]
    symmetry: ClassVar[Symmetry] = "axial"

    @property
    def largest_radius(self) -> float:
        """Largest radius in m at which the body can touch."""
        return self.radius

    @property
    def height(self) -> float:
        """Largest depth in m for which the shape is known."""
        return math.inf

    def profile(self, r: npt.ArrayLike) -> FloatArray:
        """Height in m above the tip, inf beyond the body."""
        return self._heights(np.asarray(r, dtype=float))

    @abstractmethod
    def radius_at(self, height: float) -> float:
        """Radius in m of the cut at `height` (m), half the width if plane."""

    @abstractmethod
    def _heights(self, distance: FloatArray) -> FloatArray: ...


@dataclass(frozen=True)
class _Body(_Tip):
    """Indenter whose first parameter is its radius."""

    radius: float

    def __post_init__(self) -> None:
        require_positive(f"radius of a {self.name}", self.radius)


class _Round(_Body):
    """Body with a circular section."""

    @property
    def height(self) -> float:
        """Radius in m, because only the lower half is known."""
        return self.radius

    def _heights(self, distance: FloatArray) -> FloatArray:
        inside = distance <= self.radius
        square = np.where(inside, distance, 0.0) ** 2
        # R − √(R² − r²) without cancellation
        height = square / (self.radius + np.sqrt(self.radius**2 - square))
        return np.where(inside, height, np.inf)

    def radius_at(self, height: float) -> float:
        """Radius in m of the cut at `height` (m)."""
        return self.radius if height >= self.radius else math.sqrt(height * (2 * self.radius - height))


@dataclass(frozen=True)
class Hemisphere(_Round):
    """Lower half of a ball, of a `radius` in m, like a rod's tip.

    >>> ball = Hemisphere(radius=2.5e-3)
    >>> ball.profile([0.0, 1.5e-3, 2.5e-3, 3e-3])
    array([0.    , 0.0005, 0.0025,    inf])
    """

    name: ClassVar[str] = "hemisphere"


@dataclass(frozen=True)
class Paraboloid(_Body):
    """Paraboloid of revolution, like a ball near its tip.

    `radius` is the radius of curvature at the tip in m.

    >>> Paraboloid(radius=2.5e-3).profile([0.0, 1e-3])
    array([0.    , 0.0002])
    """

    name: ClassVar[str] = "paraboloid"

    @property
    def largest_radius(self) -> float:
        """Largest radius in m, infinite for a paraboloid."""
        return math.inf

    def _heights(self, distance: FloatArray) -> FloatArray:
        return np.asarray(distance**2 / (2 * self.radius))

    def radius_at(self, height: float) -> float:
        """Radius in m of the cut at `height` (m)."""
        return math.sqrt(2 * self.radius * height)


EDGE = 0.1  # default ratio of a punch's edge radius to its radius. It reduces the force by some 5 %.


class _Edged(_Tip):
    """Indenter with an edge that is rounded for large deformations."""

    edge_radius: float | None

    @property
    def rounding(self) -> float:
        """Radius of the edge in m, inf without an edge."""
        return EDGE * self.radius if self.edge_radius is None else self.edge_radius

    def _check_edge(self) -> None:
        edge = self.edge_radius
        if edge is not None and not (0 < edge <= self.radius and math.isfinite(self.radius)):
            raise GeometryError(
                f"edge radius of a {self.name} must be positive and at most its radius, {self.radius * 1e3:g} mm; "
                f"got {edge * 1e3:g} mm."
            )


@dataclass(frozen=True)
class FlatPunch(_Edged, _Body):
    """Flat end of a rod, of a `radius` in m.

    `edge_radius` is the radius in m of its rounded edge under large deformations, at most `radius`,
    by default 10 % of it. Linear elasticity and `profile` take the edge as sharp.

    >>> FlatPunch(radius=1e-3).profile([0.0, 1e-3, 2e-3])
    array([ 0.,  0., inf])
    """

    edge_radius: float | None = None
    name: ClassVar[str] = "flat punch"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_edge()

    def _heights(self, distance: FloatArray) -> FloatArray:
        return np.where(distance <= self.radius, 0.0, np.inf)

    def radius_at(self, height: float) -> float:
        """Radius in m, which is the same at any `height`."""
        return self.radius


@dataclass(frozen=True)
class Cone(_Edged):
    """Cone with its tip down.

    `half_angle` is the angle between the axis and the surface in rad, below π/2. The cone ends at
    a `radius` in m, by default nowhere, with an `edge_radius` as in `FlatPunch`.

    >>> Cone(half_angle=np.pi / 4, radius=1e-3).profile([0.0, 5e-4, 2e-3]).round(6)
    array([0.    , 0.0005,    inf])
    """

    half_angle: float
    radius: float = math.inf
    edge_radius: float | None = None
    name: ClassVar[str] = "cone"

    def __post_init__(self) -> None:
        if not 0 < self.half_angle < math.pi / 2:
            raise GeometryError(f"half angle of a cone must be between 0 and π/2 rad; got {self.half_angle} rad.")
        if not self.radius > 0:
            raise GeometryError(f"radius of a cone must be positive; got {self.radius} m.")
        self._check_edge()

    def _heights(self, distance: FloatArray) -> FloatArray:
        return np.where(distance <= self.radius, distance / math.tan(self.half_angle), np.inf)

    def radius_at(self, height: float) -> float:
        """Radius in m of the cut at `height` (m)."""
        return min(height * math.tan(self.half_angle), self.radius)


@dataclass(frozen=True)
class CylinderEdge(_Round):
    """Infinite cylinder along y of a `radius` in m, in plane strain.

    >>> CylinderEdge(radius=2.5e-3).symmetry
    'plane'
    """

    name: ClassVar[str] = "cylinder edge"
    symmetry: ClassVar[Symmetry] = "plane"


Indenter = Hemisphere | Paraboloid | FlatPunch | Cone | CylinderEdge  # any of the indenters
