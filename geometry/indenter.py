"""Rigid bodies that are pressed into the elastomer: what each looks like from below.

The tip is at r = 0 and points downwards; `profile` is the height of the surface above the tip. Axial bodies are bodies
of revolution and r is the distance from the axis; plane ones are infinitely long along y and r is |x|.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt

from coilarray.errors import GeometryError

FloatArray = npt.NDArray[np.float64]

Symmetry = Literal["axial", "plane"]
"""``"axial"``: a body of revolution; ``"plane"``: infinitely long along y."""


def _require_length(what: str, value: float) -> None:
    """Refuse a length that is not positive and finite."""
    if not (math.isfinite(value) and value > 0):
        raise GeometryError(f"{what} must be positive and finite; got {value} m.")


def _round_profile(radius: float, r: npt.ArrayLike) -> FloatArray:
    """Height of a circle of `radius` above its lowest point, R − √(R² − r²); inf beyond it."""
    distance = np.asarray(r, dtype=float)
    inside = distance <= radius
    square = np.where(inside, distance, 0.0) ** 2
    height = square / (radius + np.sqrt(radius**2 - square))  # the same as R − √(R² − r²), without cancellation
    return np.where(inside, height, np.inf)


def _round_radius_at(radius: float, height: float) -> float:
    """Half the chord of a circle at a height above its lowest point, at most its radius."""
    if height >= radius:
        return radius
    return math.sqrt(height * (2 * radius - height))


@dataclass(frozen=True)
class Hemisphere:
    """The lower half of a ball, as on the tip of a rod of the same radius.

    Parameters
    ----------
    radius : float
        In m.

    Raises
    ------
    GeometryError
        A radius that is not positive and finite.

    Examples
    --------
    >>> ball = Hemisphere(radius=2.5e-3)
    >>> ball.profile([0.0, 1.5e-3, 2.5e-3, 3e-3])
    array([0.    , 0.0005, 0.0025,    inf])
    """

    radius: float
    name: ClassVar[str] = "hemisphere"
    symmetry: ClassVar[Symmetry] = "axial"

    def __post_init__(self) -> None:
        _require_length("radius of a hemisphere", self.radius)

    @property
    def reach(self) -> float:
        """Largest radius in m at which it can touch."""
        return self.radius

    def profile(self, r: npt.ArrayLike) -> FloatArray:
        """Height above the tip in m at the radii `r` in m, R − √(R² − r²); inf beyond the reach."""
        return _round_profile(self.radius, r)

    def radius_at(self, height: float) -> float:
        """Radius in m of the cut at a height in m above the tip, at most the reach."""
        return _round_radius_at(self.radius, height)


@dataclass(frozen=True)
class Paraboloid:
    """A paraboloid of revolution: what a ball looks like from near its tip.

    Parameters
    ----------
    radius : float
        Radius of curvature at the tip in m.

    Raises
    ------
    GeometryError
        A radius that is not positive and finite.

    Examples
    --------
    >>> Paraboloid(radius=2.5e-3).profile([0.0, 1e-3])
    array([0.    , 0.0002])
    """

    radius: float
    name: ClassVar[str] = "paraboloid"
    symmetry: ClassVar[Symmetry] = "axial"

    def __post_init__(self) -> None:
        _require_length("radius of a paraboloid", self.radius)

    @property
    def reach(self) -> float:
        """Largest radius in m at which it can touch: it has no end."""
        return math.inf

    def profile(self, r: npt.ArrayLike) -> FloatArray:
        """Height above the tip in m at the radii `r` in m, r²/(2R)."""
        return np.asarray(r, dtype=float) ** 2 / (2 * self.radius)

    def radius_at(self, height: float) -> float:
        """Radius in m of the cut at a height in m above the tip."""
        return math.sqrt(2 * self.radius * height)


@dataclass(frozen=True)
class FlatPunch:
    """The flat end of a rod.

    Parameters
    ----------
    radius : float
        Of the rod in m.

    Raises
    ------
    GeometryError
        A radius that is not positive and finite.

    Examples
    --------
    >>> FlatPunch(radius=1e-3).profile([0.0, 1e-3, 2e-3])
    array([ 0.,  0., inf])
    """

    radius: float
    name: ClassVar[str] = "flat punch"
    symmetry: ClassVar[Symmetry] = "axial"

    def __post_init__(self) -> None:
        _require_length("radius of a flat punch", self.radius)

    @property
    def reach(self) -> float:
        """Largest radius in m at which it can touch."""
        return self.radius

    def profile(self, r: npt.ArrayLike) -> FloatArray:
        """Height above the tip in m at the radii `r` in m: 0 under the punch, inf beyond it."""
        return np.where(np.asarray(r, dtype=float) <= self.radius, 0.0, np.inf)

    def radius_at(self, height: float) -> float:
        """Radius in m of the cut at any height above the tip."""
        return self.radius


@dataclass(frozen=True)
class Cone:
    """A cone with its tip down.

    Parameters
    ----------
    half_angle : float
        Between the axis and the surface in rad; near π/2 the cone is blunt.
    radius : float, optional
        Where the cone ends, in m; without it the cone has no end.

    Raises
    ------
    GeometryError
        An angle that is not between 0 and π/2, or a radius that is not positive.

    Examples
    --------
    >>> Cone(half_angle=np.pi / 4, radius=1e-3).profile([0.0, 5e-4, 2e-3]).round(6)
    array([0.    , 0.0005,    inf])
    """

    half_angle: float
    radius: float = math.inf
    name: ClassVar[str] = "cone"
    symmetry: ClassVar[Symmetry] = "axial"

    def __post_init__(self) -> None:
        if not 0 < self.half_angle < math.pi / 2:
            raise GeometryError(f"half angle of a cone must be between 0 and π/2 rad; got {self.half_angle} rad.")
        if not self.radius > 0:
            raise GeometryError(f"radius of a cone must be positive; got {self.radius} m.")

    @property
    def reach(self) -> float:
        """Largest radius in m at which it can touch."""
        return self.radius

    def profile(self, r: npt.ArrayLike) -> FloatArray:
        """Height above the tip in m at the radii `r` in m, r/tan(half angle); inf beyond the reach."""
        distance = np.asarray(r, dtype=float)
        return np.where(distance <= self.radius, distance / math.tan(self.half_angle), np.inf)

    def radius_at(self, height: float) -> float:
        """Radius in m of the cut at a height in m above the tip, at most the reach."""
        return min(height * math.tan(self.half_angle), self.radius)


@dataclass(frozen=True)
class CylinderEdge:
    """An infinitely long cylinder that lies on the sample along y: plane strain.

    Parameters
    ----------
    radius : float
        In m.

    Raises
    ------
    GeometryError
        A radius that is not positive and finite.

    Examples
    --------
    >>> CylinderEdge(radius=2.5e-3).symmetry
    'plane'
    """

    radius: float
    name: ClassVar[str] = "cylinder edge"
    symmetry: ClassVar[Symmetry] = "plane"

    def __post_init__(self) -> None:
        _require_length("radius of a cylinder edge", self.radius)

    @property
    def reach(self) -> float:
        """Largest |x| in m at which it can touch."""
        return self.radius

    def profile(self, r: npt.ArrayLike) -> FloatArray:
        """Height above the tip in m at r = |x| in m, R − √(R² − x²); inf beyond the reach."""
        return _round_profile(self.radius, r)

    def radius_at(self, height: float) -> float:
        """Half width in m of the cut at a height in m above the tip, at most the reach."""
        return _round_radius_at(self.radius, height)


Indenter = Hemisphere | Paraboloid | FlatPunch | Cone | CylinderEdge
"""Any of the indenters."""
