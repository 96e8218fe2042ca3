"""Plates, targets and balls of metal, and eddy currents.

The eddy currents are arrows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray
from coilarray.geometry import Ball, FinitePlate, Plate
from coilarray.geometry.solids import plate_solid
from coilarray.geometry.target import Body
from coilarray.viz.datasets.field import arrows_at
from coilarray.viz.datasets.triangles import MM_PER_M, solid_mesh

if TYPE_CHECKING:
    import pyvista


EDDY, EDDY_AMOUNT = "K (A/m)", "|K| (A/m)"
"""Names of the point arrays of arrows, for the current per width and its magnitude."""

_BALL = (48, 32)  # meridians and circles of latitude of a ball
_OFF = 0.12  # height of an arrow above its face over the spacing, to keep it out of the metal


@dataclass(frozen=True, eq=False)
class Eddies:
    """Eddy currents of one body.

    `points`, shape (n, 3), are places on the board in m. `normals`, shape (n, 3), are the outward unit vectors of its
    face there. `density`, shape (n, 3), is the current per width at one instant in A/m.
    """

    points: FloatArray
    normals: FloatArray
    density: FloatArray


def plate_mesh(plate: Plate | FinitePlate, within: tuple[float, float, float, float]) -> pyvista.PolyData:
    """Surface of a plate in mm.

    An infinite plate is cut to the rectangle x_min, y_min, x_max, y_max in m.
    """
    return solid_mesh(plate_solid(plate, within))


def ball_mesh(radius: float, centre: tuple[float, float, float]) -> pyvista.PolyData:
    """Surface of a ball in mm.

    Radius and centre are in m.
    """
    from coilarray.viz.extra_3d import pyvista

    meridians, circles = _BALL
    middle = tuple(MM_PER_M * value for value in centre)
    ball: pyvista.PolyData = pyvista.Sphere(
        radius=MM_PER_M * radius, center=middle, theta_resolution=meridians, phi_resolution=circles
    )
    return ball


def body_mesh(
    body: Body, place: tuple[float, float, float], within: tuple[float, float, float, float]
) -> pyvista.PolyData:
    """Surface of a body in mm at its place.

    The place in m belongs to its centre, or to the lower face of an infinite plate.
    """
    if isinstance(body, Ball):
        return ball_mesh(body.radius, place)
    mesh = plate_mesh(body, within)
    away = (0.0, 0.0, place[2] - body.z) if isinstance(body, Plate) else np.subtract(place, body.centre)
    return mesh.translate(np.multiply(MM_PER_M, away), inplace=False)


def eddy_arrows(eddies: Eddies, spacing: float, largest: float) -> pyvista.PolyData:
    """Arrows along eddy currents in mm.

    There is an arrow in each cube with sides of the spacing in m. An arrow as strong as `largest` in A/m is as long as
    the spacing.
    """
    chosen = _one_a_cube(eddies.points, spacing)
    points = eddies.points[chosen] + _OFF * spacing * eddies.normals[chosen]
    return arrows_at(MM_PER_M * points, eddies.density[chosen], spacing, (EDDY, EDDY_AMOUNT), largest)


def _one_a_cube(points: FloatArray, side: float) -> npt.NDArray[np.intp]:
    """Index of the point nearest to each cube's centre.

    Cubes without points are left out.
    """
    cubes = np.floor((points - points.min(axis=0)) / side + 0.5)
    off = np.linalg.norm((points - points.min(axis=0)) / side - cubes, axis=1)
    order = np.argsort(off, kind="stable")
    _, first = np.unique(cubes[order], axis=0, return_index=True)
    return np.asarray(np.sort(order[first]))
