"""Cameras for scenes, without perspective.

Without it lengths can be compared. The cameras are aimed at the whole scene.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

Side = Literal["oblique", "top", "front", "right"]
"""Side of the view: obliquely from the front, straight from above, from the front along y, or from the right."""

_ANGLES = {"oblique": (48.0, -97.0), "top": (90.0, -90.0), "front": (0.0, -90.0), "right": (0.0, 0.0)}
FILLED = 0.88
"""Share of the picture's height or width that a scene fills."""


@dataclass(frozen=True)
class Direction:
    """Direction from the scene to the camera in rad."""

    elevation: float
    azimuth: float


def direction(side: Side) -> Direction:
    """Direction of a side."""
    elevation, azimuth = _ANGLES[side]
    return Direction(math.radians(elevation), math.radians(azimuth))


@dataclass(frozen=True)
class Camera:
    """Camera without perspective."""

    position: tuple[float, float, float]  # mm
    focus: tuple[float, float, float]  # mm, point in the centre of its picture
    up: tuple[float, float, float]
    scale: float  # half the visible height in mm


def aim(
    bounds: tuple[float, float, float, float, float, float],
    size: tuple[int, int],
    towards: Direction,
    left: float = 0.0,
    right: float = 0.0,
    bottom: float = 0.0,
) -> Camera:
    """Aim a camera at the centre of a box.

    `bounds` are x_min, x_max, y_min, y_max, z_min, z_max in mm. The shares `left`, `right` and `bottom` of the
    picture's width and height stay free at its edges, for a legend, colour bars and notes.
    """
    sine, cosine = math.sin(towards.elevation), math.cos(towards.elevation)
    out = np.array([cosine * math.cos(towards.azimuth), cosine * math.sin(towards.azimuth), sine])
    along = np.array([-math.sin(towards.azimuth), math.cos(towards.azimuth), 0.0])
    return _aimed(bounds, size, out, along, left, right, bottom)


def aim_again(
    camera: Camera,
    bounds: tuple[float, float, float, float, float, float],
    size: tuple[int, int],
    left: float,
    right: float,
) -> Camera:
    """Aim a camera at the centre of another box.

    The other arguments are the same as for `aim`.
    """
    out = np.array(camera.position) - camera.focus
    along = np.cross(camera.up, out)
    return _aimed(bounds, size, out / np.linalg.norm(out), along / np.linalg.norm(along), left, right)


def _aimed(
    bounds: tuple[float, float, float, float, float, float],
    size: tuple[int, int],
    out: npt.NDArray[np.float64],
    along: npt.NDArray[np.float64],
    left: float,
    right: float,
    bottom: float = 0.0,
) -> Camera:
    """Aim from a direction.

    `along` is the direction from left to right.
    """
    up = np.cross(out, along)
    corners = np.array(list(itertools.product(*np.reshape(bounds, (3, 2)))))
    seen = corners @ np.column_stack((along, up))
    middle, extent = (seen.min(axis=0) + seen.max(axis=0)) / 2, np.ptp(seen, axis=0)
    width, height = size
    free = 1.0 - left - right
    scale = max(float(extent[1]) / (1.0 - bottom), float(extent[0]) * height / (width * free)) / 2 / FILLED
    shift = (right - left) * scale * width / height  # of the centre towards the free side
    focus = (middle[0] + shift) * along + (middle[1] - bottom * scale) * up
    distance = 2.0 * float(np.linalg.norm(np.ptp(corners, axis=0)))
    return Camera(_triple(focus + distance * out), _triple(focus), _triple(up), scale)


def seen_from(camera: Camera, points: npt.ArrayLike, size: tuple[int, int]) -> npt.NDArray[np.float64]:
    """Places of points in a picture of a given size.

    The points have shape (n, 3) in mm. The places have shape (n, 2), and go from 0 to 1 across and up.
    """
    focus, up = np.array(camera.focus), np.array(camera.up)
    out = np.array(camera.position) - focus
    along = np.cross(up, out / np.linalg.norm(out))
    away = np.asarray(points, dtype=np.float64) - focus
    half = np.array([camera.scale * size[0] / size[1], camera.scale])
    return np.asarray(away @ np.column_stack((along, up)) / half / 2 + 0.5)


def _triple(vector: npt.NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z
