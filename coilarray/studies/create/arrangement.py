"""Number, lattice and size of the coils, read from short texts."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any

from coilarray.errors import DesignError
from coilarray.geometry.array import LatticeKind


@dataclass(frozen=True)
class Arrangement:
    """Arrangement of the coils: a lattice and its repetitions.

    The lattice is named as in a design file.
    """

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


_RINGS = {7: 1, 19: 2, 37: 3}
_TRIANGLE = 3
_MOST = 1000
_COILS = "coils must be as 1, 6 (a row), 4x4 (columns by rows), 3-hex, 7-hex, 19-hex or 37-hex; got {!r}."


def read_arrangement(coils: str | int, shape: str = "square") -> Arrangement:
    """Read the number and arrangement of the coils.

    The text is 1, 6 for a row, 4x4, 3-hex for a triangle, or 7-hex for rings about a centre. Hexagons and circles in
    rows and columns lie on a hexagonal lattice, in which all neighbours are equally far. Raises DesignError for another
    text.
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
    """Read a coil's size and return it in m.

    It is a width, or width and height. The text is in mm, with width and height as 20x12. Raises DesignError for any
    other text.
    """
    try:
        sides = [float(side) * 1e-3 for side in text.lower().replace("×", "x").split("x")]
    except ValueError:
        sides = []
    if len(sides) not in (1, 2):
        raise DesignError(f"size must be a width, as 16, or width and height, as 20x12; got {text[:40]!r}.")
    return sides[0] if len(sides) == 1 else (sides[0], sides[1])
