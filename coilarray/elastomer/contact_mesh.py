"""Meshes for a contact: rectangles in (r, z), small under the indenter and larger outside."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from skfem import MeshQuad

from coilarray.compute.arrays import FloatArray
from coilarray.errors import ElastomerError

_MARGIN = 1.1  # elements grow from this multiple of the expected contact radius on
_NEAR = 6.0  # thicknesses from the contact, beyond which the elements grow without bound
_SUBSTEPS = 8  # of the march that places the points, per element
_TIP_ELEMENTS = 3  # across the radius of a blunted point


@dataclass(frozen=True)
class ContactMesh:
    """Fineness and extent of a contact's mesh.

    Fewer than 4 elements, growth that is not above 1 and at most 2, or an extent that is not finite and at least 1
    raise an ElastomerError.

    Parameters
    ----------
    elements : int
        Number of elements across the contact radius.
    growth : float
        Ratio of neighbouring elements away from the contact. It also determines the number of elements in a sheet.
    extent : float
        Radius of the mesh of a wide sample, beyond the contact, in thicknesses of the stack.
    """

    elements: int = 40
    growth: float = 1.3
    extent: float = 25.0

    def __post_init__(self) -> None:
        """Check the values."""
        if self.elements < 4:
            raise ElastomerError(f"elements across a contact must be at least 4; got {self.elements}.")
        if not 1 < self.growth <= 2:
            raise ElastomerError(f"growth of a contact's mesh must be above 1 and at most 2; got {self.growth}.")
        if not (math.isfinite(self.extent) and self.extent >= 1):
            raise ElastomerError(
                f"extent of a contact's mesh must be finite and at least 1 thickness; got {self.extent}."
            )

    def refined(self) -> ContactMesh:
        """Return a mesh with half the size of every element."""
        return ContactMesh(2 * self.elements, math.sqrt(self.growth), self.extent)


@dataclass(frozen=True)
class ContactZone:
    """Expected edge of the contact, in any unit of length.

    The edge is at `smallest` at the least depth and at `largest` at the greatest. Contact is searched up to the radius
    `search`. It is `sharp` if the indenter ends there and the contact reaches its edge, where the pressure is singular.
    If the indenter has a point, it is blunted over the radius `tip`.
    """

    smallest: float
    largest: float
    search: float
    sharp: bool = False
    tip: float = 0.0


def graded(start: float, end: float, size: Callable[[float], float], least: int = 1) -> FloatArray:
    """Points from `start` to `end` about size(x) apart, in `least` intervals or more."""
    fine = [start]
    while fine[-1] < end:
        fine.append(fine[-1] + size(fine[-1]) / _SUBSTEPS)
    steps = len(fine) - 1
    last = steps - 1 + (end - fine[-2]) / (fine[-1] - fine[-2])  # the march meets the end here
    count = max(least, math.ceil(last / _SUBSTEPS))
    points = np.interp(np.linspace(0, last, count + 1), np.arange(steps + 1), fine)
    points[-1] = end
    return points


def _finest(zone: ContactZone, mesh: ContactMesh) -> float:
    """Smallest element: at the edge of a sharp indenter, else under the tip."""
    finest = zone.largest / mesh.elements**2 if zone.sharp else zone.smallest / mesh.elements
    return min(finest, zone.tip / _TIP_ELEMENTS or math.inf)


def radial_points(zone: ContactZone, thickness: float, end: float, mesh: ContactMesh) -> FloatArray:
    """Radii of the mesh's vertices up to `end`, with the end of the search."""
    n, edge, slope = mesh.elements, zone.largest, mesh.growth - 1
    finest = zone.largest / n**2  # at a sharp edge

    def size(r: float) -> float:
        contact = max(zone.smallest, min(r, edge)) / n + slope * max(0.0, r - _MARGIN * edge)
        wave = slope * (thickness / 2 + max(0.0, r - edge - _NEAR * thickness))
        corner = finest + slope * abs(r - edge) if zone.sharp else math.inf
        point = zone.tip / _TIP_ELEMENTS + slope * r if zone.tip else math.inf
        return min(contact, wave, corner, point)

    if zone.search >= end:
        return graded(0.0, end, size)
    return np.concatenate((graded(0.0, zone.search, size), graded(zone.search, end, size)[1:]))


def vertical_points(zone: ContactZone, levels: FloatArray, mesh: ContactMesh) -> FloatArray:
    """Levels of the mesh's vertices from the board to 0, with all interfaces."""
    slope, total = mesh.growth - 1, -float(levels[0])
    finest = _finest(zone, mesh)

    def size(below: float) -> float:
        return min(finest + slope * below, slope * total)

    least = math.ceil(1 / slope)
    pieces = [levels[:1]]
    for lower, upper in pairwise(levels):
        pieces.append(-graded(-upper, -lower, size, least)[-2::-1])
    return np.concatenate(pieces)


def contact_mesh(r: FloatArray, z: FloatArray) -> MeshQuad:
    """Rectangles between radii and levels: axis, outer, bottom and top."""
    return MeshQuad.init_tensor(r, z).with_boundaries(
        {
            "axis": lambda x: x[0] == r[0],
            "outer": lambda x: x[0] == r[-1],
            "bottom": lambda x: x[1] == z[0],
            "top": lambda x: x[1] == z[-1],
        }
    )
