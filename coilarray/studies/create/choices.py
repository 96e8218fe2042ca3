"""Choices for a new design, with their defaults."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, get_args

from coilarray.design.fab_limits import load_profile
from coilarray.design.switch_parts import PARTS, PartName
from coilarray.errors import DesignError
from coilarray.geometry.arcs import SIDES, Side
from coilarray.geometry.array import LatticeKind

_RINGS = {7: 1, 19: 2, 37: 3}
_TRIANGLE = 3
_MOST = 1000
_COILS = "coils must be as 1, 6 (a row), 4x4 (columns by rows), 3-hex, 7-hex, 19-hex or 37-hex; got {!r}."
Shape = Literal["hexagon", "square", "circle", "rectangle", "racetrack"]
SHAPES: tuple[Shape, ...] = get_args(Shape)
LONG_SHAPES: tuple[Shape, ...] = ("rectangle", "racetrack")
"""Shapes with a width and a height."""
Overlap = Literal["none", "decoupled"]
_FROM_TO = {
    "size": (0.5e-3, 1.0, 1e3, "mm"),
    "pitch": (0.5e-3, 1.0, 1e3, "mm"),
    "inductance": (1e-9, 0.1, 1e6, "µH"),
    "frequency": (1e3, 1e9, 1e-6, "MHz"),
    "capacitance": (1e-12, 1e-3, 1e12, "pF"),
}
"""Range of each choice in SI, with its option's unit."""


@dataclass(frozen=True)
class Arrangement:
    """Lattice of the coils and its repetitions."""

    lattice: LatticeKind
    columns: int = 1
    rows: int = 1

    @property
    def keys(self) -> dict[str, Any]:
        """Entries of ``[array]``."""
        if self.lattice == "single":
            return {"lattice": "single"}
        if self.lattice == "rings":
            return {"lattice": "rings", "rings": self.columns}
        rows = {"rows": self.rows} if self.lattice not in ("linear", "triangle") else {}
        return {"lattice": self.lattice, "columns": self.columns, **rows}

    @property
    def few(self) -> Arrangement:
        """The same arrangement, reduced to coils with different neighbours."""
        return replace(self, columns=min(self.columns, 1 if self.lattice == "rings" else 3), rows=min(self.rows, 3))

    @property
    def fewest(self) -> Arrangement:
        """A few coils with neighbours in every direction."""
        if self.lattice == "rings":
            return Arrangement("hexagonal", 2, 2)
        return replace(self, columns=min(self.columns, 2), rows=min(self.rows, 2))


def read_arrangement(coils: str | int, shape: str = "square") -> Arrangement:
    """Read the number and arrangement of the coils.

    The text is 1, 6 for a row, 4x4, 3-hex (a triangle), or 7-hex (rings about a centre). Hexagons
    and circles in 4x4 lie on a hexagonal lattice with equally far neighbours.
    """
    found = re.fullmatch(r"(\d{1,9})(?:x(\d{1,9})|(-hex))?", str(coils).strip().lower().replace("×", "x"))
    count, rows, ring = found.groups() if found else ("0", None, None)
    first, second = int(count), int(rows or 1)
    if ring and first == _TRIANGLE:
        return Arrangement("triangle", 2)
    if ring and first in _RINGS:
        return Arrangement("rings", _RINGS[first])
    if first * second < 1 or ring:
        raise DesignError(_COILS.format(coils))
    if first * second > _MOST:
        raise DesignError(f"coils must be at most {_MOST}; got {first * second} in {coils!r}.")
    if first == second == 1:
        return Arrangement("single")
    if second == 1:
        return Arrangement("linear", first)
    if first == 1:  # a column, which a hexagonal lattice would make a zigzag
        return Arrangement("square", 1, second)
    return Arrangement("hexagonal" if shape in ("hexagon", "circle") else "square", first, second)


def read_size(text: str) -> float | tuple[float, float]:
    """Read a size in mm, 16 or 20x12, in m."""
    try:
        sides = [float(side) * 1e-3 for side in text.lower().replace("×", "x").split("x")]
    except ValueError:
        sides = []
    if len(sides) not in (1, 2):
        raise DesignError(f"size must be a width, as 16, or width and height, as 20x12; got {text[:40]!r}.")
    return sides[0] if len(sides) == 1 else (sides[0], sides[1])


@dataclass(frozen=True)
class Choices:
    """Checked choices for a new design in SI."""

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
        for what, allowed in (
            ("shape", SHAPES),
            ("overlap", get_args(Overlap)),
            ("connector", (None, *SIDES)),
            ("switches", (None, *PARTS)),
        ):
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
        """Width and height of a coil in m."""
        usual = (20e-3, 12e-3) if self.shape in LONG_SHAPES else 16e-3
        size = usual if self.size is None else self.size
        return size if isinstance(size, tuple) else (size, size)

    @property
    def layers_of_fab(self) -> int | None:
        """Layers of the named service's boards, None for any number."""
        return None if self.fab is None else load_profile(self.fab).rules.max_layers

    @cached_property
    def arrangement(self) -> Arrangement:
        """Arrangement of the coils."""
        return read_arrangement(self.coils, self.shape)
