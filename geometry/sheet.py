"""Flat sheets that lie on the board: the elastomer layers."""

from __future__ import annotations

import math
from dataclasses import dataclass

from coilarray.errors import GeometryError


@dataclass(frozen=True)
class Sheet:
    """A flat sheet of uniform thickness that covers the board.

    Parameters
    ----------
    name : str
        For example ``"base"`` or ``"magnetic"``.
    thickness : float
        In m.
    relative_permeability : float
        1 for a plain elastomer, above 1 for a filled one.
    """

    name: str
    thickness: float
    relative_permeability: float = 1.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.thickness) and self.thickness > 0):
            raise GeometryError(
                f"thickness of sheet {self.name!r} must be positive and finite; got {self.thickness} m."
            )
        if not (math.isfinite(self.relative_permeability) and self.relative_permeability >= 1):
            raise GeometryError(
                f"relative permeability of sheet {self.name!r} must be at least 1; got {self.relative_permeability}."
            )
