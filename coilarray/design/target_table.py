"""Table of a body that moves over the board."""

from __future__ import annotations

from typing import Any, Literal, Self

from pydantic import Field, model_validator

from coilarray.design.places_table import PlacesTable
from coilarray.design.plates import FlatTable, MaterialTable, Shape
from coilarray.design.units import SCALES, Millimetres, require_rising
from coilarray.geometry import Ball, FinitePlate, Plate, Target

_MM, _DEG = SCALES["mm"], SCALES["deg"]
_NAME = "target"


class MovedTable(PlacesTable):
    """Where a target is moved: the same for all bodies."""

    distances_mm: list[Millimetres] = Field(default=[1.0, 2.0, 4.0, 8.0], min_length=1)
    """Distances of the target's nearest point from the highest face of board and sheets, rising."""

    @model_validator(mode="after")
    def _rising(self) -> Self:
        require_rising("distances_mm", self.distances_mm)
        return self

    def moved(self) -> dict[str, Any]:
        """Return distances and places in SI.

        `Target` takes them.
        """
        return {"distances": tuple(distance / 1e3 for distance in self.distances_mm), **self.places()}


class FlatTarget(FlatTable, MovedTable):
    """``[target]`` of every shape but the sphere."""

    shape: Shape
    """Outline; a plate is infinite."""

    @model_validator(mode="after")
    def _no_places_of_a_plate(self) -> Self:
        for key in PlacesTable.model_fields:
            if self.shape == "plate" and getattr(self, key) is not None:
                raise ValueError(f'has no {key} for shape = "plate", which is an infinite plate')
        return self

    def build(self) -> Target:
        """Return the target in SI."""
        material, outline, thickness = self.flat(_NAME)
        if outline is None:
            return Target(Plate(_NAME, 0.0, thickness, material), **self.moved())
        tilt = (self.tilt_deg * _DEG, self.tilt_direction_deg * _DEG)
        return Target(FinitePlate(_NAME, outline, (0.0, 0.0, 0.0), thickness, material, *tilt), **self.moved())


class SphereTarget(MaterialTable, MovedTable):
    """``[target]`` with ``shape = "sphere"``."""

    shape: Literal["sphere"]
    """A ball."""
    diameter_mm: Millimetres
    """Diameter of the sphere."""

    @model_validator(mode="after")
    def _some_material(self) -> Self:
        if self.substance(_NAME) is None:
            raise ValueError("needs a material, or conductivity_MS_per_m and relative_permeability")
        return self

    def build(self) -> Target:
        """Return the target in SI."""
        material = self.substance(_NAME)
        assert material is not None  # the validator has checked it
        return Target(Ball(self.diameter_mm * _MM / 2, material), **self.moved())
