"""Keys of positions above the board.

Indentations and targets share them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from coilarray.design.units import Point, Position, Range, Table, require_rising
from coilarray.design.window import MOST_POSITIONS

StepMillimetres = Annotated[float, Field(ge=1e-3, le=10_000)]
Positions = Annotated[list[Position], Field(min_length=1, max_length=100_000)]

_WHOLE_STEPS = 1e-6  # part of a step by which a range may miss a whole number of steps


class PlacesTable(Table):
    """Positions above the board, relative to an origin."""

    x_mm: Range | None = None
    """Range [low, high] of the positions along x; by default over all coils."""
    y_mm: Range | None = None
    """The same along y."""
    step_mm: StepMillimetres | None = None
    """Spacing of the positions; chosen for the coils by default."""
    x_positions_mm: Positions | None = None
    """Instead of a range and a step: every x, rising."""
    y_positions_mm: Positions | None = None
    """Every y, rising."""
    origin: str | None = None
    """Name of the coil whose centre is the origin of x and y; the board's origin by default."""
    origin_mm: Point | None = None
    """Point [x, y] on the board that is the origin of x and y."""

    @model_validator(mode="after")
    def _consistent_places(self) -> Self:
        """Refuse contradicting keys and too many positions."""
        if self.origin is not None and self.origin_mm is not None:
            raise ValueError("needs one of origin and origin_mm, not both")
        ranges = (self.x_mm, self.y_mm, self.step_mm)
        lists = (self.x_positions_mm, self.y_positions_mm)
        over_array = lists == ranges[:2] == (None, None)
        if not over_array and (
            None in (ranges if lists == (None, None) else lists) or (lists != (None, None) and ranges != (None,) * 3)
        ):
            raise ValueError(
                "needs x_mm, y_mm and step_mm, or x_positions_mm and y_positions_mm, or none of these for positions "
                "over all coils"
            )
        for key, values in (("x_mm", self.x_mm), ("y_mm", self.y_mm)):
            if values is not None and self.step_mm is not None:
                low, high = values
                self._check_range(key, low, high, self.step_mm)
        for key, positions in (("x_positions_mm", lists[0]), ("y_positions_mm", lists[1])):
            require_rising(key, positions or ())
        count = math.prod(map(len, self.positions()))
        if count > MOST_POSITIONS:
            raise ValueError(f"may have {MOST_POSITIONS} positions; x_mm, y_mm and step_mm give {count}")
        return self

    @staticmethod
    def _check_range(key: str, low: float, high: float, step: float) -> None:
        """Refuse a range without a whole number of steps."""
        if low > high:
            raise ValueError(f"needs {key} from low to high; got [{low:g}, {high:g}]")
        steps = (high - low) / step
        if abs(steps - round(steps)) > _WHOLE_STEPS:
            raise ValueError(
                f"needs {key} to span a whole number of steps of {step:g} mm; {low:g} to {high:g} are {steps:g}"
            )
        if steps >= MOST_POSITIONS:
            raise ValueError(f"may have {MOST_POSITIONS} positions; {key} and step_mm give {steps + 1:g}")

    def positions(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the x and y of the map in m.

        The ends are included. They are empty if they follow from the array.
        """
        if self.x_mm is None or self.y_mm is None or self.step_mm is None:
            x, y = (tuple(v / 1e3 for v in values or ()) for values in (self.x_positions_mm, self.y_positions_mm))
        else:
            x, y = map_positions(self.x_mm, self.step_mm), map_positions(self.y_mm, self.step_mm)
        return x, y

    def places(self) -> dict[str, Any]:
        """Return x, y, origin and step in SI.

        `Indentation` and `Target` take them.
        """
        x, y = self.positions()
        at_x, at_y = (0.0, 0.0) if self.origin_mm is None else self.origin_mm
        return {
            "x": x,
            "y": y,
            "origin": self.origin,
            "origin_point": (at_x * 1e-3, at_y * 1e-3),
            "step": None if self.step_mm is None or x else self.step_mm * 1e-3,
        }


def map_positions(bounds: Sequence[float], step: float) -> tuple[float, ...]:
    """Return the positions of a range in m.

    The range [low, high] and its step are in mm.
    """
    low, high = bounds
    steps = round((high - low) / step)
    # Divided, not multiplied by 1e-3: positions are labels, and -26 mm must be -0.026 m.
    return tuple((low + (high - low) * k / max(steps, 1)) / 1e3 for k in range(steps + 1))
