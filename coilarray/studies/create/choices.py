"""Choices for a new design: one set of defaults for the command, its questions on a terminal, and Python."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

from coilarray.design.fab_limits import load_profile
from coilarray.design.switch_parts import PARTS, PartName
from coilarray.errors import DesignError
from coilarray.geometry.values import SIDES, Side
from coilarray.studies.create.arrangement import Arrangement, read_arrangement

Shape = Literal["hexagon", "square", "circle", "rectangle", "racetrack"]
SHAPES: tuple[Shape, ...] = get_args(Shape)
LONG_SHAPES: tuple[Shape, ...] = ("rectangle", "racetrack")
"""Shapes with a width and a height."""
Overlap = Literal["none", "decoupled"]
_FROM_TO = {
    "size": (0.5e-3, 1.0, 1e3, "mm"), "pitch": (0.5e-3, 1.0, 1e3, "mm"),
    "inductance": (1e-9, 0.1, 1e6, "µH"), "frequency": (1e3, 1e9, 1e-6, "MHz"),
    "capacitance": (1e-12, 1e-3, 1e12, "pF"),
}  # fmt: skip
"""Range of each choice in SI, wider than usual for planar coils, and the unit of its option."""


@dataclass(frozen=True)
class Choices:
    """Choices for a new design, in SI, with their defaults.

    They are described in `new_design`. Raises DesignError for choices that are evidently impossible, before any work.
    """

    coils: str | int = "3"
    shape: Shape = "hexagon"
    size: float | tuple[float, float] | None = None
    inductance: float | None = None
    layers: int | None = None
    fab: str | None = None
    pitch: float | None = None
    overlap: Overlap = "none"
    elastomer: bool = True
    frequency: float | None = None
    capacitance: float | None = None
    connector: Side | None = None
    switches: PartName | None = None
    title: str = ""

    def __post_init__(self) -> None:
        for what, allowed in (("shape", SHAPES), ("overlap", get_args(Overlap)),
                              ("connector", (None, *SIDES)), ("switches", (None, *PARTS))):  # fmt: skip
            if getattr(self, what) not in allowed:
                listed = ", ".join(word for word in allowed if word is not None)
                raise DesignError(f"{what} must be one of {listed}; got {getattr(self, what)!r}.")
        if isinstance(self.size, tuple) and self.shape not in LONG_SHAPES:
            sides = " × ".join(f"{side * 1e3:g}" for side in self.size)
            raise DesignError(f"size must be one number for a {self.shape}; got {sides} mm.")
        for one, other, why in (
            ("pitch", "overlap", "the overlap is that of the pitch"),
            ("frequency", "capacitance", "the frequency is that of the capacitance"),
        ):
            if getattr(self, one) is not None and getattr(self, other) not in (None, "none"):
                raise DesignError(f"{one} and {other} cannot both be given: {why}.")
        given = [("size", side) for side in self.sides]
        given += [(what, number) for what in _FROM_TO if what != "size" and (number := getattr(self, what)) is not None]
        for what, number in given:
            least, most, scale, unit = _FROM_TO[what]
            if not (math.isfinite(number) and number > 0):
                raise DesignError(f"{what} must be positive and finite; got {number * scale:g} {unit}.")
            if not least <= number <= most:
                raise DesignError(
                    f"{what} must be {least * scale:g} to {most * scale:g} {unit}; got {number * scale:g} {unit}."
                )
        if self.arrangement.lattice == "single" and (self.pitch is not None or self.overlap != "none"):
            raise DesignError("one coil has no neighbours: pitch and overlap are for several.")

    @property
    def sides(self) -> tuple[float, float]:
        """Width and height of a coil in m.

        By default long shapes are longer than wide.
        """
        usual = (20e-3, 12e-3) if self.shape in LONG_SHAPES else 16e-3
        size = usual if self.size is None else self.size
        return size if isinstance(size, tuple) else (size, size)

    @property
    def layers_of_fab(self) -> int | None:
        """Layers of the boards that the named service makes.

        None for a service that makes any number, and if no service is named.
        """
        return None if self.fab is None else load_profile(self.fab).rules.max_layers

    @cached_property
    def arrangement(self) -> Arrangement:
        """Arrangement of the coils."""
        return read_arrangement(self.coils, self.shape)
