"""Rigid indenters: what each looks like from below.

The tip is at r = 0 and points downwards; `profile` is the height of the surface above the tip. Axial bodies are bodies
of revolution and r is the distance from the axis; plane ones are infinitely long along y and r is |x|.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray
from coilarray.errors import GeometryError, require_positive

Symmetry = Literal["axial", "plane"]
"""``"axial"``: a body of revolution; ``"plane"``: infinitely long along y."""


class _Tip:
    """What all indenters share; each says its `profile` and `radius_at`."""

    radius: float
    name: ClassVar[str]
    symmetry: ClassVar[Symmetry] = "axial"

    @property
    def largest_radius(self) -> float:
        """Largest radius (of a plane body: |x|) in m at which the body can touch; inf where it has no end."""
        return self.radius

    @property
    def height(self) -> float:
        """Largest depth in m that the shape is known for; inf where it goes on, as the rod above an edge does."""
        return math.inf


@dataclass(frozen=True)
class _Body(_Tip):
    """An indenter whose first parameter is its radius."""

    radius: float

    def __post_init__(self) -> None:
        require_positive(f"radius of a {self.name}", self.radius)


class _Round(_Body):
    """A body with a circular section."""

    @property
    def height(self) -> float:
        """Radius in m: what is above the lower half is not known."""
        return self.radius

    def profile(self, r: npt.ArrayLike) -> FloatArray:
        """Height above the tip in m at the distances `r` in m, R − √(R² − r²); inf beyond R."""
        distance = np.asarray(r, dtype=float)
        inside = distance <= self.radius
        square = np.where(inside, distance, 0.0) ** 2
        height = square / (self.radius + np.sqrt(self.radius**2 - square))  # R − √(R² − r²) without cancellation
        return np.where(inside, height, np.inf)

    def radius_at(self, height: float) -> float:
        """Radius in m (of a plane body: half the width) of the cut at a height in m above the tip, at most R."""
        return self.radius if height >= self.radius else math.sqrt(height * (2 * self.radius - height))


@dataclass(frozen=True)
class Hemisphere(_Round):
    """The lower half of a ball, as on the tip of a rod of the same radius.

    Parameters
    ----------
    radius : float
        Radius in m, positive and finite; GeometryError otherwise.

    Examples
    --------
    >>> ball = Hemisphere(radius=2.5e-3)
    >>> ball.profile([0.0, 1.5e-3, 2.5e-3, 3e-3])
    array([0.    , 0.0005, 0.0025,    inf])
    """

    name: ClassVar[str] = "hemisphere"


@dataclass(frozen=True)
class Paraboloid(_Body):
    """A paraboloid of revolution: what a ball looks like from near its tip.

    `radius` is that of curvature at the tip in m, positive and finite; GeometryError otherwise.

    Examples
    --------
    >>> Paraboloid(radius=2.5e-3).profile([0.0, 1e-3])
    array([0.    , 0.0002])
    """

    name: ClassVar[str] = "paraboloid"

    @property
    def largest_radius(self) -> float:
        """Largest radius in m: infinite, as a paraboloid has no end."""
        return math.inf

    def profile(self, r: npt.ArrayLike) -> FloatArray:
        """Height above the tip in m at the radii `r` in m, r²/(2R).

        Returns
        -------
        ndarray
            Height in m, of the shape of `r`.
        """
        return np.asarray(r, dtype=float) ** 2 / (2 * self.radius)

    def radius_at(self, height: float) -> float:
        """Radius in m of the cut at a height in m above the tip.

        Returns
        -------
        float
            Radius in m.
        """
        return math.sqrt(2 * self.radius * height)


EDGE = 0.1
"""Radius of the rounded edge of a punch over the punch's own, where none is given: it takes some 5 % of the force."""


class _Edged(_Tip):
    """An indenter that ends with an edge, rounded for large deformations: a sharp one would cut the sheet."""

    edge_radius: float | None

    @property
    def rounding(self) -> float:
        """Radius of the edge in m; inf where there is no edge."""
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
    """The flat end of a rod.

    Parameters
    ----------
    radius : float
        Radius in m, positive and finite; GeometryError otherwise.
    edge_radius : float, optional
        Radius in m of its rounded edge under large deformations, at most `radius`; 10 % of it by default. Linear
        elasticity takes the edge as sharp, and so does `profile`.

    Examples
    --------
    >>> FlatPunch(radius=1e-3).profile([0.0, 1e-3, 2e-3])
    array([ 0.,  0., inf])
    """

    edge_radius: float | None = None
    name: ClassVar[str] = "flat punch"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_edge()

    def profile(self, r: npt.ArrayLike) -> FloatArray:
        """Height above the tip in m at the radii `r` in m: 0 under the punch, inf beyond it.

        Returns
        -------
        ndarray
            Height in m, of the shape of `r`.
        """
        return np.where(np.asarray(r, dtype=float) <= self.radius, 0.0, np.inf)

    def radius_at(self, height: float) -> float:
        """Radius in m of the cut at any height above the tip.

        Returns
        -------
        float
            Radius in m.
        """
        return self.radius


@dataclass(frozen=True)
class Cone(_Edged):
    """A cone with its tip down.

    Raises GeometryError for an angle or a radius that is not allowed.

    Parameters
    ----------
    half_angle : float
        Angle between the axis and the surface in rad, between 0 and π/2; near π/2 the cone is blunt.
    radius : float, optional
        Radius in m at which the cone ends, positive; without it the cone has no end.
    edge_radius : float, optional
        Radius in m of the rounded edge there, as that of a `FlatPunch`.

    Examples
    --------
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

    def profile(self, r: npt.ArrayLike) -> FloatArray:
        """Height above the tip in m at the radii `r` in m, r/tan(half angle); inf beyond the end.

        Returns
        -------
        ndarray
            Height in m, of the shape of `r`.
        """
        distance = np.asarray(r, dtype=float)
        return np.where(distance <= self.radius, distance / math.tan(self.half_angle), np.inf)

    def radius_at(self, height: float) -> float:
        """Radius in m of the cut at a height in m above the tip, at most `radius`.

        Returns
        -------
        float
            Radius in m.
        """
        return min(height * math.tan(self.half_angle), self.radius)


@dataclass(frozen=True)
class CylinderEdge(_Round):
    """An infinitely long cylinder that lies on the sample along y: plane strain.

    `radius` in m is positive and finite; GeometryError otherwise.

    Examples
    --------
    >>> CylinderEdge(radius=2.5e-3).symmetry
    'plane'
    """

    name: ClassVar[str] = "cylinder edge"
    symmetry: ClassVar[Symmetry] = "plane"


Indenter = Hemisphere | Paraboloid | FlatPunch | Cone | CylinderEdge
"""Any of the indenters."""
