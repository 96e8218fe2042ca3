"""Flat sheets that lie on the board: the elastomer layers."""

from __future__ import annotations

import math
from dataclasses import dataclass

from coilarray.errors import GeometryError
from coilarray.geometry.values import require_positive


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
        Young's modulus in Pa; None where it is not known, and then the sheet cannot be indented.
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
