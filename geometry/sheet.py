"""Flat sheets that lie on the board, the elastomer layers, and the seat that they may lie on, even or uneven."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

from coilarray.errors import GeometryError, require_positive

RigidBase = Literal["bonded", "frictionless"]
"""How the lowest sheet lies on a rigid board: glued, or free to slide but not to lift off."""
Strain = Literal["finite", "linear"]
"""Large deformations of neo-Hookean sheets, or linear elasticity."""
KPA_PER_MM = 1e6
"""Stiffness of a seat of 1 kPa/mm in Pa/m."""


@dataclass(frozen=True)
class Sheet:
    """A flat sheet of uniform thickness that covers the board.

    Raises GeometryError for a value that is not allowed.

    Parameters
    ----------
    name : str
        Name of the sheet, for example ``"base"`` or ``"magnetic"``.
    thickness : float
        Thickness in m.
    relative_permeability : float
        1 for a plain elastomer, above 1 for a filled one.
    youngs_modulus : float or None
        Young's modulus in Pa; None if it is not known, and then the sheet cannot be indented.
    poissons_ratio : float
        Poisson's ratio from 0 to 0.5; 0.5 is incompressible.
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
    """A soft support under the lowest sheet; pressure at a point is proportional to its displacement (a Winkler bed).

    What lies between a sheet and its board where it is not cast on it: a film, trapped air, the roughness of both.

    Parameters
    ----------
    stiffness : float
        Pressure per displacement normal to the board in Pa/m, positive and finite; 4.3 kPa/mm are 4.3e6 Pa/m. Under
        large deformations it is the force per undeformed area, as the shear stress is.
    shear : float
        Shear stress per displacement along the board in Pa/m; 0 lets the sheet slide.

    Raises
    ------
    GeometryError
        A value that is not allowed.

    Examples
    --------
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


Base: TypeAlias = RigidBase | Seat
"""Support of the lowest sheet: a rigid board to which it is glued or on which it slides, or a soft seat."""


@dataclass(frozen=True)
class Unevenness:
    """How the seat under a sample differs from an even one that holds it down.

    Parameters
    ----------
    stiffness_slope : tuple of float
        Relative change of the seat's stiffness along x and y in 1/m: it is 1 + slope · position times that at the
        origin of the map. Its shear stiffness changes alike.
    gap_slope : tuple of float
        Rise of the gap between the seat and a flat sample along x and y in m per m, from the origin of the map; where
        it would be negative there is none, for the sample would tilt with a seat that is flat everywhere. It counts
        only where the sample can lift: a seat that also pulls is a linear spring, whose length at rest changes nothing.
    lifts : bool
        Whether the sample can lift off its seat.
    weight : float
        Pressure in Pa by which its weight holds a sample that can lift.

    Raises
    ------
    GeometryError
        A value that is not finite, or a weight below zero.
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


EVEN = Unevenness()
"""A seat that is everywhere the same and pulls as it pushes."""
