"""Flat sheets that lie on the board, the elastomer layers, and the even or uneven seat under them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

from coilarray.errors import GeometryError, require_positive

RigidBase = Literal["bonded", "frictionless"]
"""Contact of the lowest sheet with a rigid board: glued, or free to slide but not to lift off."""
Strain = Literal["finite", "linear"]
"""Large deformations of neo-Hookean sheets, or linear elasticity."""
KPA_PER_MM = 1e6
"""Stiffness of a seat of 1 kPa/mm in Pa/m."""


@dataclass(frozen=True)
class Sheet:
    """Flat sheet of uniform thickness that covers the board.

    Raises GeometryError if a value is not allowed.

    Parameters
    ----------
    name : str
        Name of the sheet, for example ``"base"`` or ``"magnetic"``.
    thickness : float
        Thickness in m.
    relative_permeability : float
        1 for a plain elastomer, above 1 for a filled elastomer.
    youngs_modulus : float or None
        Young's modulus in Pa. None if it is unknown, in which case the sheet cannot be indented.
    poissons_ratio : float
        Poisson's ratio from 0 to 0.5. 0.5 is incompressible.
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

    The pressure at a point is proportional to its displacement. The seat stands for a film, trapped air or the
    roughness between a sheet and a board on which it was not cast.

    Parameters
    ----------
    stiffness : float
        Pressure per displacement normal to the board in Pa/m, positive and finite. 4.3 kPa/mm are 4.3e6 Pa/m. Under
        large deformations it is the force per undeformed area, as the shear stress is.
    shear : float
        Shear stress per displacement along the board in Pa/m. 0 lets the sheet slide.

    Raises
    ------
    GeometryError
        If a value is not allowed.

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
    """Deviation of a sample's seat from an even, clamped seat.

    Parameters
    ----------
    stiffness_slope : tuple of float
        Relative change of the seat's stiffness along x and y in 1/m. The stiffness at a position is 1 + slope ·
        position times the stiffness at the origin of the map. The shear stiffness changes by the same factor.
    gap_slope : tuple of float
        Rise of the gap between the seat and a flat sample along x and y in m per m, from the origin of the map. A
        negative gap is set to zero, because the sample would tilt with a seat that is flat everywhere. The gap has an
        effect only if the sample can lift: a seat that also pulls is a linear spring, whose length at rest changes
        nothing.
    lifts : bool
        Whether the sample can lift off its seat.
    weight : float
        Pressure in Pa by which its weight holds a sample that can lift.

    Raises
    ------
    GeometryError
        If a value is not finite, or the weight is below zero.
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
"""Seat that is the same everywhere and pulls as it pushes."""
