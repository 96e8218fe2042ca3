"""Metal plates near the board: infinite plates, and flat pieces of any outline, also tilted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import shapely

from coilarray.compute.arrays import FloatArray
from coilarray.errors import GeometryError, require_positive
from coilarray.geometry.material import Material
from coilarray.geometry.values import Point

TOUCHING = 1e-9
"""Length in m by which touching bodies may overlap through rounding of summed thicknesses."""
_CORNERS = 96  # of the polygon that stands for a circle of the same area


@dataclass(frozen=True)
class Plate:
    """Infinite flat plate parallel to the board.

    It stands for a plate that is wide compared with the coils.

    Parameters
    ----------
    name : str
        Name of the plate.
    z : float
            Height of its lower face in m. The upper face of the board is at 0.
    thickness : float
        Thickness in m.
    material : Material
            Material of the plate.

    Raises
    ------
    GeometryError
            If the height is not finite, or the thickness is not positive.
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
        """Return the plate moved up by `height` in m.

        Returns
        -------
        Plate
            The plate in its new place.
        """
        return replace(self, z=self.z + height)


@dataclass(frozen=True)
class Disc:
    """Circular outline, given by its radius in m."""

    radius: float

    def __post_init__(self) -> None:
        require_positive("radius of a disc", self.radius)

    @property
    def exterior(self) -> tuple[Point, ...]:
        """Corners in m of a polygon of the same area.

        It lies about the centre, anticlockwise.
        """
        return _circle(self.radius)

    @property
    def holes(self) -> tuple[tuple[Point, ...], ...]:
        """Empty, because a disc has no hole."""
        return ()


@dataclass(frozen=True)
class Rectangle:
    """Rectangular outline, given by width and height in m.

    The width lies along x and the height along y.
    """

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

    @property
    def holes(self) -> tuple[tuple[Point, ...], ...]:
        """Empty, because a rectangle has no hole."""
        return ()


@dataclass(frozen=True)
class Ring:
    """Outline between two circles about one centre.

    `radius` is the larger radius and `inner_radius` the smaller radius, both in m.
    """

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
        """Polygon corners in m for the outer circle, anticlockwise.

        Polygon and circle have the same area.
        """
        return _circle(self.radius)

    @property
    def holes(self) -> tuple[tuple[Point, ...], ...]:
        """Polygon corners in m for the inner circle.

        Polygon and circle have the same area.
        """
        return (_circle(self.inner_radius),)


@dataclass(frozen=True)
class Polygon:
    """Outline of any polygon, with holes.

    Parameters
    ----------
    exterior : tuple of points
            Corners (x, y) in m about the centre of the plate, in either sense. The first corner is not repeated.
    holes : tuple of such tuples
        Corners of each hole.

    Raises
    ------
    GeometryError
            If there are fewer than three corners, the outline crosses itself, or holes touch or are not inside.
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

    Without a tilt it is parallel to the board.

    Parameters
    ----------
    name : str
        Name of the plate.
    outline : Outline
            Outline about the plate's centre.
    centre : tuple of float
            x, y and z in m of the outline's origin, in the middle of the thickness. The board's upper face is at z = 0.
    thickness : float
        Thickness in m.
    material : Material
            Material of the plate.
    tilt : float
            Angle in rad by which the plate rises towards `tilt_direction`, less than a right angle.
    tilt_direction : float
        Angle in rad from the x axis.

    Raises
    ------
    GeometryError
            If a value is not allowed.
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
        """Unit vectors of the plate's x, y and normal.

        Dimensionless, in the frame of the board, as the rows of an array of shape (3, 3).
        """
        cos, sin = math.cos(self.tilt_direction), math.sin(self.tilt_direction)
        rise, run = math.sin(self.tilt), math.cos(self.tilt)
        along, across = np.array([cos * run, sin * run, rise]), np.array([-sin, cos, 0.0])
        normal = np.array([-cos * rise, -sin * rise, run])
        return np.array([cos * along - sin * across, sin * along + cos * across, normal])

    def on_board(self, points: FloatArray | Sequence[Point]) -> FloatArray:
        """Transform points of the mid-plane to the board's frame.

        The points are given in the plate's own x and y in m, shape (n, 2).

        Returns
        -------
        ndarray, shape (n, 3)
            Positions in the frame of the board in m.
        """
        return np.asarray(np.array(self.centre) + np.asarray(points) @ self.axes[:2])

    def lifted(self, height: float) -> FinitePlate:
        """Return the plate moved up by `height` in m.

        Returns
        -------
        FinitePlate
            The plate in its new place.
        """
        x, y, z = self.centre
        return replace(self, centre=(x, y, z + height))

    @property
    def heights(self) -> tuple[float, float]:
        """Heights in m of its lowest and its highest point."""
        z = self.on_board(self.outline.exterior)[:, 2]
        half = self.thickness / 2 * math.cos(self.tilt)
        return float(z.min()) - half, float(z.max()) + half
