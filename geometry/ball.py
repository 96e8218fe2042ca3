"""A sphere of metal or ferrite over the board."""

from __future__ import annotations

from dataclasses import dataclass

from coilarray.errors import require_positive
from coilarray.geometry.material import Material


@dataclass(frozen=True)
class Ball:
    """Solid sphere of one material, without a position.

    `radius` in m must be positive and finite. Otherwise GeometryError is raised.
    """

    radius: float
    material: Material

    def __post_init__(self) -> None:
        require_positive("radius of a sphere", self.radius)
