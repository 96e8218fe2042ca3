"""Pose of a board in space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray
from coilarray.errors import LARGEST, GeometryError


@dataclass(frozen=True)
class Pose:
    """Turn about the axes and shift of a board.

    The board is turned about the fixed axes x, y and z, in this order, each through its own origin,
    by the angles `turn` in rad, counter-clockwise seen from the tip of the axis. Then it is shifted
    by `x`, `y` and `z` in m. Raises GeometryError for values that are not three finite angles and
    finite shifts up to 1e30 m.

    >>> import math
    >>> facing = Pose(z=8e-3, turn=(math.pi, 0.0, 0.0))
    >>> facing.apply([[1e-3, 2e-3, 0.0]]).round(6).tolist()
    [[0.001, -0.002, 0.008]]
    """

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        shift = (self.x, self.y, self.z)
        if not (isinstance(self.turn, Sequence) and len(self.turn) == 3 and all(map(_is_number, self.turn))):
            raise GeometryError(f"a pose must have three finite angles about x, y and z; got {self.turn!r} rad.")
        if not all(_is_number(value) and abs(value) <= LARGEST for value in shift):
            raise GeometryError(f"a pose must have finite shifts, up to {LARGEST:g} m; got {shift!r} m.")

    @classmethod
    def of(cls, rotation: npt.ArrayLike, shift: npt.ArrayLike) -> Pose:
        """Return the pose of a rotation matrix and a shift.

        The `rotation` of shape (3, 3) turns column vectors. It is orthogonal and without a
        reflection. The `shift` of shape (3,) is in m.
        """
        matrix = np.asarray(rotation, dtype=np.float64)
        about_y = math.atan2(-matrix[2, 0], math.hypot(matrix[0, 0], matrix[1, 0]))
        if abs(matrix[2, 0]) < 1 - _LEVEL:
            about_x, about_z = math.atan2(matrix[2, 1], matrix[2, 2]), math.atan2(matrix[1, 0], matrix[0, 0])
        else:  # turns about x and z are the same turn there
            about_x, about_z = 0.0, math.atan2(-matrix[0, 1], matrix[1, 1])
        x, y, z = np.asarray(shift, dtype=np.float64).tolist()
        return cls(x, y, z, (about_x, about_y, about_z))

    @cached_property
    def rotation(self) -> FloatArray:
        """Dimensionless matrix that turns column vectors, shape (3, 3)."""
        matrix = np.eye(3)
        for axis, angle in enumerate(self.turn):
            c, s = _cosine_and_sine(angle)
            i, k = (axis + 1) % 3, (axis + 2) % 3
            turn = np.eye(3)
            turn[[i, i, k, k], [i, k, i, k]] = c, -s, s, c
            matrix = turn @ matrix
        matrix.setflags(write=False)
        return matrix

    @property
    def shift(self) -> FloatArray:
        """Shift in m, shape (3,)."""
        return np.array([self.x, self.y, self.z])

    def apply(self, points: npt.ArrayLike) -> FloatArray:
        """Return points of the board where the pose takes them.

        `points` and result have the shape (..., 3) and are in m.
        """
        return np.asarray(np.asarray(points, dtype=np.float64) @ self.rotation.T + self.shift)

    def undo(self, points: npt.ArrayLike) -> FloatArray:
        """Return points of space in the board's own coordinates.

        `points` and result have the shape (..., 3) and are in m.
        """
        return np.asarray((np.asarray(points, dtype=np.float64) - self.shift) @ self.rotation)

    def after(self, other: Pose) -> Pose:
        """Return the pose of a board that is first moved by `other`."""
        return Pose.of(self.rotation @ other.rotation, self.apply(other.shift))


_LEVEL = 1e-14  # of the sine of the turn about y, where x and z coincide
_MANY = 1e3  # right angles, beyond which an angle's own rounding is larger than what counts as one


def _cosine_and_sine(angle: float) -> tuple[float, float]:
    """Cosine and sine that are exact at multiples of a right angle."""
    quarters = angle / (math.pi / 2)
    if abs(quarters) < _MANY and abs(quarters - round(quarters)) < 1e-12:
        whole = (1.0, 0.0, -1.0, 0.0)
        return whole[round(quarters) % 4], whole[(round(quarters) - 1) % 4]
    return math.cos(angle), math.sin(angle)


def _is_number(value: object) -> bool:
    """Check for a finite real number."""
    return isinstance(value, (int, float, np.integer, np.floating)) and math.isfinite(value)
