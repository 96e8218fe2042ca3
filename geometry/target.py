"""A rigid piece of metal that is moved over the board: a target."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

from coilarray.errors import GeometryError, require_finite
from coilarray.geometry.ball import Ball
from coilarray.geometry.plate import FinitePlate, Plate

Body: TypeAlias = Plate | FinitePlate | Ball
"""Possible bodies of a target. The position of a plate has no effect, its tilt has."""


@dataclass(frozen=True)
class Target:
    """Rigid body moved to places at distances above the board.

    Parameters
    ----------
    body : Plate, FinitePlate or Ball
        The body. Its own position has no effect.
    distances : tuple of float
        Gaps in m between its nearest point and the highest face of board and sheets, in rising order.
    x, y : tuple of float
        Places of its centre in m, relative to `origin_point`. If both are empty, `coilarray.Design` sets an even grid
        over all coils. An infinite plate has one place.
    origin : str or None
        Name of the coil whose centre is the origin. None if `origin_point` is given.
    origin_point : tuple of float
        x and y in m of the origin on the board. `coilarray.Design` sets it if `origin` names a coil.
    step : float or None
        Distance in m of the places that `coilarray.Design` sets. By default it follows from the coils.
    over_array : tuple of tuple of float
        The x and y set by `coilarray.Design`. They are replaced for another array.

    Raises
    ------
    GeometryError
        If there is no distance, distances do not rise from above zero, x has no y, or an infinite plate has places.

    Examples
    --------
    >>> from coilarray.geometry import MATERIALS, Plate
    >>> target = Target(Plate("target", 0.0, 1e-3, MATERIALS["aluminium"]), (1e-3, 2e-3))
    >>> target.height(0.5e-3, 2e-3)
    0.0025
    """

    body: Body
    distances: tuple[float, ...]
    x: tuple[float, ...] = ()
    y: tuple[float, ...] = ()
    origin: str | None = None
    origin_point: tuple[float, float] = (0.0, 0.0)
    step: float | None = None
    over_array: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())

    def __post_init__(self) -> None:
        if not self.distances or not all(near < far for near, far in pairwise((0.0, *self.distances))):
            raise GeometryError(
                "distances of a target must rise from above zero, at least one; "
                f"got {', '.join(f'{distance * 1e3:g}' for distance in self.distances) or 'none'} mm."
            )
        require_finite("distances and places of a target", *self.distances, *self.x, *self.y, *self.origin_point)
        if bool(self.x) != bool(self.y):
            raise GeometryError("a target must have both x and y, or neither.")
        if isinstance(self.body, Plate) and max(len(self.x), len(self.y)) > 1:
            raise GeometryError("an infinite plate is the same everywhere: as a target it must have one x and one y.")

    @property
    def kind(self) -> str:
        """Kind of body, as in design files, such as ``"disc"``.

        It is ``"plate"``, the name of an outline, or ``"sphere"``.
        """
        if isinstance(self.body, Plate):
            return "plate"
        return type(self.body.outline).__name__.lower() if isinstance(self.body, FinitePlate) else "sphere"

    @property
    def extent(self) -> float:
        """Height of the body in m.

        It is measured from the lowest to the highest point.
        """
        if isinstance(self.body, Plate | FinitePlate):
            low, high = self.body.heights
            return high - low
        return 2 * self.body.radius

    def height(self, face: float, distance: float) -> float:
        """Height in m of the body's centre.

        The body is at a given distance. For an infinite plate it is the height of the lower face. `distance` is
        measured from `face` to the body's nearest point. Both are in m.

        Returns
        -------
        float
            z in m.
        """
        if isinstance(self.body, Plate):
            below = 0.0
        elif isinstance(self.body, FinitePlate):
            below = self.body.centre[2] - self.body.heights[0]
        else:
            below = self.body.radius
        return face + distance + below
