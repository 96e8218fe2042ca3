"""Triangles on the upper half of a plate: its upper face, and its rim down to the middle of its thickness.

A plate is its own mirror image at its mid-plane, so this half is enough. Currents crowd at the rim: strips along it
that grow inwards, then a lattice, joined by Delaunay's triangulation.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import shapely
from scipy.spatial import Delaunay

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.errors import GeometryError, require_positive
from coilarray.geometry.plate import Outline

_ALONG = 90  # pieces of all rims together, where the plate is not narrow
_WIDEST, _FINEST = 1.4, 0.06  # largest and smallest piece of the rim, of the inscribed radius
_FIRST, _GROWTH, _STRIPS = 0.02, 2.0, 0.35  # first strip, ratio of neighbours and width of all, of the inscribed radius
_LATTICE = 0.08  # step of the lattice inside, of the inscribed radius, where the rim's pieces are not longer
_CORNER = 0.25  # of half the thickness: height of the strip of the rim below its edge
_LARGEST_CORNER = 0.5  # the same of any coarser mesh
_SAGITTA = 0.02  # of a piece of the rim: deviation from the outline that is let pass
_OF_DISTANCE = 0.5  # of the distance from the copper: largest side of a triangle
_MOST_NODES = 6000


@dataclass(frozen=True, eq=False)
class HalfBody:
    """Upper half of a body that is its own mirror image at z = 0.

    `nodes` (n, 3) in m about the centre; `triangles` (k, 3), anticlockwise seen from outside; `rim` (k,) marks those of
    the rim. `ring` has the nodes at z = 0 of the outer rim, `hole_rings` those of each hole. `caps` has, for each hole,
    points (m, 2) in m and their share of its area in m². `inscribed` is the radius in m of the largest circle in it.
    """

    nodes: FloatArray
    triangles: IntArray
    rim: npt.NDArray[np.bool_]
    ring: IntArray
    hole_rings: tuple[IntArray, ...]
    caps: tuple[tuple[FloatArray, FloatArray], ...]
    inscribed: float

    @property
    def corners(self) -> FloatArray:
        """Corners of the triangles in m, shape (k, 3, 3)."""
        return np.ascontiguousarray(self.nodes[self.triangles])


@dataclass(frozen=True, eq=False)
class Footprint:
    """Where copper is, seen from a plate that moves: its outlines `area` in the plate's plane in m.

    `height` in m is the least distance from it across the plane, and `radius` in m half the width of the smallest coil.
    """

    area: shapely.Geometry
    height: float
    radius: float

    def distances(self, points: FloatArray) -> FloatArray:
        """Distances in m of points (n, 2) of the plate from the copper."""
        return np.asarray(np.hypot(shapely.distance(self.area, shapely.points(points)), self.height))


Sizes: TypeAlias = Callable[[FloatArray], FloatArray]
"""Gives the wanted side of a triangle in m at points (n, 2) in m, shape (n,)."""


def inscribed_radius(outline: Outline) -> float:
    """Radius in m of the largest circle in an outline."""
    return float(shapely.maximum_inscribed_circle(_plane(outline)).length)


def plate_mesh(outline: Outline, thickness: float, fineness: float = 1.0, above: Footprint | None = None) -> HalfBody:
    """Mesh the upper half of a plate with an outline about its centre.

    `fineness` 2 has half the lengths of 1; the mesh is finer where the plate is near the copper `above` or below it.
    GeometryError for a fineness that is not positive and finite, and for an outline too large or narrow.
    """
    require_positive("fineness of a mesh", fineness, "")
    plane, inscribed = _plane(outline), inscribed_radius(outline)
    along = min(_WIDEST * inscribed, max(plane.length / _ALONG, _FINEST * inscribed)) / fineness
    step = max(along, _LATTICE * inscribed / fineness)
    finest = step if above is None else min(step, _LATTICE * max(above.radius, above.height) / fineness)

    def wanted(points: FloatArray) -> FloatArray:
        if above is None or finest == step:
            return np.full(len(points), step)
        return np.clip(_OF_DISTANCE / fineness * above.distances(points), finest, step)

    loops = [_divided(ring, along, wanted) for ring in (plane.exterior, *plane.interiors)]
    insets = _insets(loops, inscribed, along, fineness)
    rings = [[_inset(loop, inset) for loop in loops] for inset in insets]  # level by level, from the rim inwards
    starts = np.cumsum([0, *(len(loop) for loop in loops)])
    order = [np.arange(first, stop) for first, stop in itertools.pairwise(starts.tolist())]
    triangles = [
        _band(loop + (level + 1) * starts[-1], loop + level * starts[-1])
        for level in range(len(rings) - 1)
        for loop in order
    ]
    rim_points = np.concatenate([points for level in rings for points in level])
    inner_points, inner_triangles = _lattice(rings[-1], step, finest, wanted)
    triangles.append(inner_triangles + (len(rings) - 1) * starts[-1])
    plane_points = np.concatenate((rim_points, inner_points))
    area = _area(plane_points, np.concatenate(triangles))
    expected = sum(_loop_area(loop) for loop in loops)
    if len(plane_points) > _MOST_NODES:
        raise GeometryError(
            f"a plate must not be so large or so narrow: {plane.area * 1e6:.4g} mm² with a rim of "
            f"{plane.length * 1e3:.4g} mm, an inscribed radius of {inscribed * 1e3:.3g} mm and the coils so near need "
            f"{len(plane_points)} nodes; at most {_MOST_NODES}."
        )
    if abs(area - expected) > 1e-6 * expected:
        raise GeometryError(
            f"the outline of a plate could not be meshed: {area * 1e6:.6g} of {expected * 1e6:.6g} mm²."
        )
    nodes = [np.column_stack((plane_points, np.full(len(plane_points), thickness / 2)))]
    corner = min(_CORNER / fineness, _LARGEST_CORNER)
    heights = [1.0, corner, 0.0] if thickness > _FIRST * inscribed / fineness else [1.0, 0.0]
    heights = [thickness / 2 * (1 - height) if 0 < height < 1 else thickness / 2 * height for height in heights]
    upper, count = order, len(plane_points)
    on_face = sum(len(some) for some in triangles)
    for height in heights[1:]:
        lower = [loop + count for loop in order]
        nodes.append(np.column_stack((np.concatenate(loops), np.full(starts[-1], height))))
        triangles += [_band(above, below) for above, below in zip(upper, lower, strict=True)]
        upper, count = lower, count + int(starts[-1])
    together = np.concatenate(triangles)
    return HalfBody(
        np.concatenate(nodes),
        together,
        np.arange(len(together)) >= on_face,
        upper[0],
        tuple(upper[1:]),
        tuple(_cap(loop[::-1], step) for loop in loops[1:]),
        inscribed,
    )


def _plane(outline: Outline) -> shapely.Polygon:
    return shapely.orient_polygons(shapely.Polygon(outline.exterior, outline.holes))


def _divided(ring: shapely.LinearRing, along: float, wanted: Sizes) -> FloatArray:
    """Corners of a ring and places between them, at most `along` apart; corners of a fine curve are thinned."""
    corners = np.array(ring.simplify(_SAGITTA * along).coords)
    sides = np.diff(corners, axis=0)
    pieces = []
    for start, side in zip(corners, sides, strict=False):
        length = math.hypot(*side)
        middles = start + side * (
            (np.arange(max(1, math.ceil(length / along))) + 0.5)[:, None] * min(along / length, 1)
        )
        count = math.ceil(length / min(along, float(wanted(middles).min())) - 1e-9)
        pieces.append(start + side * (np.arange(count) / count)[:, None])
    return np.concatenate(pieces)


def _inset(loop: FloatArray, inset: float) -> FloatArray:
    """Move the sides of a loop to their left by `inset` in m."""
    sides = np.roll(loop, -1, axis=0) - loop
    sides /= np.hypot(*sides.T)[:, None]
    normal = np.column_stack((-sides[:, 1], sides[:, 0]))
    before = np.roll(normal, 1, axis=0)
    return np.asarray(loop + inset * (normal + before) / (1 + (normal * before).sum(axis=1))[:, None])


def _insets(loops: Sequence[FloatArray], inscribed: float, along: float, fineness: float) -> list[float]:
    """Places in m of the strips' edges from the rim: as many strips as have room in every corner."""
    width, places = _FIRST * inscribed / fineness, [0.0]
    while width < 0.8 * along and places[-1] + width < _STRIPS * inscribed:
        places.append(places[-1] + width)
        width *= _GROWTH
    while len(places) > 1 and not _has_room(loops, places[-1]):
        places.pop()
    return places


def _has_room(loops: Sequence[FloatArray], inset: float) -> bool:
    """Whether the loops, moved inwards, stay simple, apart, and inside each other as they were."""
    outer, *holes = [_inset(loop, inset) for loop in loops]
    sides = [np.roll(loop, -1, axis=0) - loop for loop in loops]
    moved = [np.roll(loop, -1, axis=0) - loop for loop in (outer, *holes)]
    forward = all(
        ((old * new).sum(axis=1) > 0.1 * (old * old).sum(axis=1)).all() for old, new in zip(sides, moved, strict=True)
    )
    return forward and bool(shapely.Polygon(outer, holes).is_valid)


def _lattice(loops: Sequence[FloatArray], step: float, finest: float, wanted: Sizes) -> tuple[FloatArray, IntArray]:
    """Points of a triangular lattice inside loops, and the triangles of the loops' points followed by these.

    Each step divided by two has the points of the coarser one among its own.
    """
    plane = shapely.Polygon(loops[0], loops[1:])
    shapely.prepare(plane)
    levels = math.ceil(math.log2(step / finest) - 1e-9)
    size = step / 2**levels
    x0, y0, x1, y1 = plane.bounds
    up = np.arange(math.ceil((y1 - y0) / (size * math.sqrt(3) / 2)) + 1)
    right = np.arange(-(len(up) // 2) - 1, math.ceil((x1 - x0) / size) + 1)
    i, j = (index.ravel() for index in np.meshgrid(right, up, indexing="ij"))
    points = np.column_stack((x0 + size * (i + 0.5 * j), y0 + size * math.sqrt(3) / 2 * j))
    inside = shapely.contains_xy(plane, points)
    i, j, points = i[inside], j[inside], points[inside]
    level = np.sum([((i | j) % 2**k == 0) for k in range(1, levels + 1)], axis=0) if levels else np.zeros(len(i))
    sizes = wanted(points)
    kept = (level == levels) | (size * 2.0**level > sizes / math.sqrt(2))
    points, sizes = points[kept], sizes[kept]
    points = points[shapely.distance(plane.boundary, shapely.points(points)) > 0.6 * sizes]
    together = np.concatenate((*loops, points))
    triangles = Delaunay(together).simplices.astype(np.int64)
    a, b, c = np.moveaxis(together[triangles], 1, 0)
    double = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    triangles[double < 0] = triangles[double < 0, ::-1]
    inside = shapely.contains_xy(plane, (a + b + c) / 3) & (np.abs(double) > 1e-9 * size**2)
    return points, triangles[inside]


def _band(upper: IntArray, lower: IntArray) -> IntArray:
    """Triangles between two closed rows of as many nodes, `lower` to the right of `upper` in its direction."""
    after, below = np.roll(upper, -1), np.roll(lower, -1)
    return np.concatenate((np.column_stack((upper, lower, below)), np.column_stack((upper, below, after))))


def _cap(loop: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Points of a rule over a hole's area, with their weights in m²."""
    points, triangles = _lattice([loop], step, step, lambda places: np.full(len(places), step))
    a, b, c = np.moveaxis(np.concatenate((loop, points))[triangles], 1, 0)
    area = ((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])) / 2
    return (a + b + c) / 3, area


def _area(points: FloatArray, triangles: IntArray) -> float:
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return float(((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])).sum() / 2)


def _loop_area(loop: FloatArray) -> float:
    """Area in m² to the left of a loop; negative for a hole."""
    x, y = loop.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)
