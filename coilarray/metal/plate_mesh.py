"""Triangles on a plate's upper half: face, and rim to mid-thickness.

Currents follow the local width and crowd at the rim. Strips lead inwards from every place of the
rim, with widths that grow as the squares of their numbers towards the middle of the largest circle
that touches the rim there. Inside them is a lattice, joined by Delaunay's triangulation. The two
meshes of a plate are nested: every triangle of the coarse mesh is four of the fine mesh, so that
their results can be extrapolated.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt
import shapely
from scipy.spatial import Delaunay
from shapely.geometry.base import BaseGeometry

from coilarray.compute.arrays import BoolArray, FloatArray, IntArray
from coilarray.errors import GeometryError, require_positive
from coilarray.geometry.bodies import Outline

# lengths in the coarse mesh for fineness 1
_ALONG = 28  # pieces of all rims together, if the plate is not narrow
_WIDEST, _FINEST = 1.7, 0.17  # largest and smallest piece of the rim, of the radius of the circle that touches it
_OF_HEIGHT = 0.6  # of the height of the copper: piece of a narrow plate's rim, along which its field varies
_TURN = 0.7  # radians of a disc's rim in a piece, otherwise as far from its chord, 6 % of the radius of the circle
_AT_CORNERS = 0.4  # piece beside a convex corner, of half the width of the plate there
_AT_REENTRANT = 0.15  # piece beside a reentrant corner, where currents turn sharply
_GRADING = 0.4  # growth of the pieces with the distance
_STRIPS, _DEPTH = 4, 0.8  # strips from the rim inwards, and the part of the circle's radius that they fill
_LATTICE = 0.6  # step of the lattice inside, of the radius of the circles nearby
_THIN = 0.03  # of the inscribed radius: half thickness below which the rim is one strip
_UPPER = 0.25  # of half the thickness: upper strip of the rim
_OF_DISTANCE = 0.8  # of the distance from the copper: largest side of a triangle
_NEAR_COILS = 0.35  # of the windings' width or distance: smallest side that these require
_MOST_BELOW = 430  # squares of the smallest side on the area of a plate that copper covers
_SAMPLES = 300  # of all rims, at which the widths are measured
_CORNER = 0.35  # radians: sharper turns of an outline are corners
_TRIED = (1.0, 1.3, 1.7, 2.2)  # of the fineness, if triangles of the coarser meshes would overlap
_COARSEST = 0.5  # fineness by which pieces of curves and narrow places are never longer
_SAGITTA = 2e-4  # of the inscribed radius: allowed deviation from the outline
_MOST_NODES = 6000
Number = TypeVar("Number", np.float64, np.int64)
Sizes: TypeAlias = Callable[[FloatArray], FloatArray]  # required side of a triangle in m at points (n, 2) in m


@dataclass(frozen=True, eq=False)
class HalfBody:
    """Upper half of a body that is its mirror image.

    `nodes` (n, 3) are in m about the centre. `triangles` (k, 3) are anticlockwise seen from
    outside, and `rim` (k,) marks the triangles of the rim. `ring` and `hole_rings` have the nodes
    at z = 0. `caps` has, for each hole, points (m, 2) in m and their share of its area in m². Each
    node of the finer mesh lies midway between its `parents` (n, 2) in the coarser.
    """

    nodes: FloatArray
    triangles: IntArray
    rim: BoolArray
    ring: IntArray
    hole_rings: tuple[IntArray, ...]
    caps: tuple[tuple[FloatArray, FloatArray], ...]
    parents: IntArray | None = None

    @property
    def corners(self) -> FloatArray:
        """Corners of the triangles in m, shape (k, 3, 3)."""
        return np.ascontiguousarray(self.nodes[self.triangles])


@dataclass(frozen=True, eq=False)
class Footprint:
    """Area of the copper as seen from a moving plate.

    `area` has its outlines in the plate's plane in m. `height` in m is the least distance from it
    across the plane. `spread` in m is the least width of any winding from turn to turn.
    """

    area: BaseGeometry
    height: float
    spread: float


def inscribed_radius(outline: Outline) -> float:
    """Radius in m of the largest circle in an outline."""
    return float(shapely.maximum_inscribed_circle(_plane(outline)).length)


def plate_meshes(
    outline: Outline, thickness: float, fineness: float = 1.0, above: Footprint | None = None
) -> tuple[HalfBody, HalfBody]:
    """Mesh a plate's upper half twice, with halved element lengths.

    `fineness` 2 has half the lengths of 1. The meshes are finer near the copper `above` or below.
    """
    require_positive("fineness of a mesh", fineness, "")
    plane = _plane(outline)
    for number, finer in enumerate(_TRIED, 1):
        coarse = _laid_out(plane, thickness, finer * fineness, above)
        fine = coarse.refined()
        if fine.meshed and coarse.meshed:
            break
        if number == len(_TRIED):
            raise GeometryError(f"the outline of a plate, {plane.area * 1e6:.4g} mm², could not be meshed.")
    count = sum(map(len, fine.levels)) + len(fine.inner)
    if count > _MOST_NODES:
        raise GeometryError(
            f"a plate must not be so large or so narrow: {plane.area * 1e6:.4g} mm² with a rim of "
            f"{plane.length * 1e3:.4g} mm, an inscribed radius of {coarse.inscribed * 1e3:.3g} mm and the coils so "
            f"near need {count} nodes; at most {_MOST_NODES}."
        )
    return coarse.body(), fine.body()


@dataclass(frozen=True, eq=False)
class _Layout:
    """Places of a plate's nodes, and its triangles, in m.

    From the `places` (n,) along each of the `rims` a row of nodes goes inwards by `depths` of its
    way (n, 2). `core` has the triangles of the rows' ends and the `inner` points (m, 2). `heights`
    are the heights of the rim's nodes over half the thickness. Triangles in holes, over which the
    coils' flux is integrated, are of the `sizes`, at most a `step`.
    """

    rims: tuple[_Rim, ...]
    places: tuple[FloatArray, ...]
    ways: tuple[FloatArray, ...]
    depths: FloatArray
    inner: FloatArray
    core: IntArray
    heights: FloatArray
    thickness: float
    inscribed: float
    step: float
    sizes: Sizes
    parents: IntArray | None = None

    @cached_property
    def loops(self) -> list[FloatArray]:
        """Nodes (n, 2) in m of each rim, a polygon of the same area."""
        return [rim.chords(place) for rim, place in zip(self.rims, self.places, strict=True)]

    @property
    def levels(self) -> list[FloatArray]:
        """Nodes (n, 2) in m of all rings at every depth."""
        start, way = np.concatenate(self.loops), np.concatenate(self.ways)
        return [start + depth * way for depth in self.depths.tolist()]

    @property
    def order(self) -> list[IntArray]:
        """Indices of each ring's nodes at one depth."""
        starts = np.cumsum([0, *map(len, self.places)]).tolist()
        return [np.arange(first, stop) for first, stop in itertools.pairwise(starts)]

    def refined(self) -> _Layout:
        """Divide triangles in four, with new rim nodes on the outline."""
        places, ways, deepest = [], [], self.depths[-1]
        for rim, place, loop, way in zip(self.rims, self.places, self.loops, self.ways, strict=True):
            after = np.append(place[1:], place[0] + rim.length)
            places.append(_interleaved(place, (place + after) / 2))
            ends = loop + deepest * way
            ends = _interleaved(ends, (ends + np.roll(ends, -1, axis=0)) / 2)
            ways.append((ends - rim.chords(places[-1])) / max(deepest, 1e-9))
        on_rings = sum(map(len, self.places))
        number = np.arange(on_rings + len(self.inner))  # of the old nodes among the new
        number[:on_rings] *= 2
        number[on_rings:] += on_rings
        sides = np.sort(np.stack((self.core, np.roll(self.core, -1, axis=1)), axis=-1), axis=-1)
        edges, which = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True)
        along = {
            (min(start, stop), max(start, stop)): 2 * start + 1
            for loop in self.order
            for start, stop in zip(loop.tolist(), np.roll(loop, -1).tolist(), strict=True)
        }
        middles = np.array([along.get((start, stop), -1) for start, stop in edges.tolist()])
        new = middles < 0
        middles[new] = 2 * on_rings + len(self.inner) + np.arange(new.sum())
        points = np.concatenate((self.levels[-1], self.inner))
        inner = np.concatenate((self.inner, points[edges[new]].mean(axis=1)))
        a, b, c = number[self.core].T
        ab, bc, ca = middles[which.reshape(-1, 3)].T
        core = np.concatenate(
            [np.column_stack(three) for three in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
        return replace(
            self,
            places=tuple(places),
            ways=tuple(ways),
            depths=_with_middles(self.depths),
            inner=inner,
            core=core,
            heights=_with_middles(self.heights),
            step=self.step / 2,
            sizes=lambda points: self.sizes(points) / 2,
            parents=self._parents(edges[new]),
        )

    def _parents(self, edges: IntArray) -> IntArray:
        """Parents of refined nodes, `edges` of new inner nodes."""
        width, levels = sum(map(len, self.places)), len(self.depths)
        column = np.concatenate([_interleaved(loop, loop) for loop in self.order])
        after = np.concatenate([_interleaved(loop, np.roll(loop, -1)) for loop in self.order])
        rows = []
        for level in range(2 * levels - 1):
            here, inwards = level // 2 * width, (level + 1) // 2 * width
            rows.append(np.column_stack((column + inwards, after + here)))
        inner = np.arange(len(self.inner)) + levels * width
        rows += [np.column_stack((inner, inner)), edges + (levels - 1) * width]
        starts = [0, *((levels + k) * width + len(self.inner) for k in range(len(self.heights) - 1))]
        for level in range(1, 2 * len(self.heights) - 1):
            rows.append(np.column_stack((column + starts[level // 2], after + starts[(level + 1) // 2])))
        return np.concatenate(rows)

    @cached_property
    def face(self) -> tuple[FloatArray, IntArray]:
        """Nodes (n, 2) in m and triangles (k, 3) of the face."""
        levels = self.levels
        width = len(levels[0])
        bands = [
            _band(loop + (level + 1) * width, loop + level * width)
            for level in range(len(levels) - 1)
            for loop in self.order
        ]
        triangles = np.concatenate((*bands, self.core + (len(levels) - 1) * width))
        return np.concatenate((*levels, self.inner)), triangles

    @property
    def meshed(self) -> bool:
        """True if the triangles cover the face exactly once."""
        areas = _areas(*self.face)
        expected = sum(float(_cross(loop, np.roll(loop, -1, axis=0)).sum()) / 2 for loop in self.loops)
        return bool((areas > 0).all()) and abs(areas.sum() - expected) < 1e-6 * expected

    def body(self) -> HalfBody:
        (plane, on_face), order = self.face, self.order
        width = sum(map(len, order))
        nodes = [np.column_stack((plane, np.full(len(plane), self.thickness / 2)))]
        triangles, upper, count = [on_face], order, len(plane)
        for height in self.heights[1:].tolist():
            lower = [loop + count for loop in order]
            nodes.append(np.column_stack((plane[:width], np.full(width, height * self.thickness / 2))))
            triangles += [_band(above, below) for above, below in zip(upper, lower, strict=True)]
            upper, count = lower, count + width
        together = np.concatenate(triangles)
        caps = []  # points and weights in m² of a quadratic rule for each hole
        for hole in (loop[::-1] for loop in self.loops[1:]):
            finest = float(self.sizes(np.concatenate((hole, [hole.mean(axis=0)]))).min())
            points, inside = _lattice([hole], self.step, finest, self.sizes)
            points = np.concatenate((hole, points))
            places = np.einsum("pc,kcd->pkd", np.full((3, 3), 1 / 6) + np.eye(3) / 2, points[inside])
            caps.append((places.reshape(-1, 2), np.tile(_areas(points, inside) / 3, 3)))
        return HalfBody(
            np.concatenate(nodes),
            together,
            np.arange(len(together)) >= len(on_face),
            upper[0],
            tuple(upper[1:]),
            tuple(caps),
            self.parents,
        )


def _laid_out(plane: shapely.Polygon, thickness: float, fineness: float, above: Footprint | None) -> _Layout:
    """Lay out the coarser mesh: rims, strips inwards, lattice inside."""
    inscribed = float(shapely.maximum_inscribed_circle(plane).length)
    outer, *holes = (ring.simplify(_SAGITTA * inscribed).coords for ring in (plane.exterior, *plane.interiors))
    plane = shapely.orient_polygons(shapely.Polygon(outer, holes))
    along, height = max(plane.length / _ALONG, _FINEST * inscribed), 0.0 if above is None else above.height
    step = min(_WIDEST * inscribed, along) / fineness

    def least(area: float) -> float:
        """Smallest side in m that the copper requires on an area in m²."""
        if above is None:
            return step
        smallest = math.sqrt(min(area, above.area.area) / _MOST_BELOW)
        return min(step, max(_NEAR_COILS * max(above.spread, above.height), smallest) / fineness)

    def required(points: FloatArray, finest: float, largest: float) -> FloatArray:
        """Sides in m at points (n, 2) in m, from `finest` to `largest`."""
        if above is None or finest == step:
            return np.full(len(points), largest)
        distances = np.hypot(shapely.distance(above.area, shapely.points(points)), above.height)
        return np.clip(_OF_DISTANCE / fineness * distances, finest, largest)

    finest = least(plane.area)
    rims = [_Rim(ring) for ring in (plane.exterior, *plane.interiors)]
    largest = min(max(_WIDEST * inscribed, _OF_HEIGHT * height), along) / fineness
    sides = partial(required, finest=finest, largest=largest)
    places, apart = _divided(rims, sides, max(fineness, _COARSEST), height)

    nodes = [rim.at(place) for rim, place in zip(rims, places, strict=True)]
    points, normals = (np.concatenate(part) for part in zip(*nodes, strict=True))
    samples = np.concatenate([rim.at(rim.samples(plane.length / _SAMPLES))[0] for rim in rims])
    radii = _graded(points, np.minimum(_touching(points, normals, samples, np.concatenate(apart)), inscribed), 1.0)
    strips = max(round(_STRIPS * fineness), 2)
    depths = _DEPTH * (np.arange(strips + 1) / strips) ** 2
    for share in (0.0, depths[-1]):  # the last strip, which is the widest, is no wider than required
        widest = required(points + share * radii[:, None] * normals, finest, step)
        radii = np.minimum(radii, widest / (depths[-1] - depths[-2]))
    radii = _graded(points, radii, 1.0)
    ways = np.split(radii[:, None] * normals, np.cumsum([len(place) for place in places])[:-1])
    loops = [rim.chords(place) for rim, place in zip(rims, places, strict=True)]
    while len(depths) > 1 and not _has_room(loops, ways, depths[-1]):
        depths = depths[:-1]

    last = [loop + depths[-1] * way for loop, way in zip(loops, ways, strict=True)]
    edge = np.concatenate(last)
    lengths = [np.hypot(*(np.roll(loop, -1, axis=0) - loop).T) for loop in last]
    spacings = [(length + np.roll(length, 1)) / 2 for length in lengths]  # of every node and its neighbours
    local = np.maximum(_LATTICE / fineness * radii, np.concatenate(spacings))

    def inside(points: FloatArray) -> FloatArray:
        return np.minimum(required(points, finest, step), _graded(points, local, _GRADING, edge))

    smallest = max(min(float(inside(edge).min()), finest), float(np.ptp(edge, axis=0).max()) / 400)
    inner, core = _lattice(last, step, min(smallest, step), inside)
    on_rim = [1.0, 0.0] if thickness / 2 <= _THIN * inscribed / fineness else [1.0, 1 - _UPPER, 0.0]
    of_holes = least(max((shapely.Polygon(hole).area for hole in plane.interiors), default=plane.area))
    return _Layout(
        rims=tuple(rims),
        places=tuple(places),
        ways=tuple(ways),
        depths=depths,
        inner=inner,
        core=core,
        heights=np.array(on_rim),
        thickness=thickness,
        inscribed=inscribed,
        step=step,
        sizes=partial(required, finest=of_holes, largest=step),
    )


def _plane(outline: Outline) -> shapely.Polygon:
    return shapely.orient_polygons(shapely.Polygon(outline.exterior, outline.holes))


class _Rim:
    """Ring by corners (n, 2) and places (n + 1,) along it, `ends`, in m.

    `before` and `after` (n, 2) are the unit normals to the left at both ends of every side,
    `middle` at the corners. `turns` (n,) are the angles there in rad, positive to the left. The
    corners `sharp` turn sharply.
    """

    def __init__(self, ring: shapely.LinearRing) -> None:
        self.corners = np.array(ring.coords)[:-1]
        sides = np.roll(self.corners, -1, axis=0) - self.corners
        lengths = np.hypot(*sides.T)
        normal = np.column_stack((-sides[:, 1], sides[:, 0])) / lengths[:, None]
        last = np.roll(normal, 1, axis=0)
        self.turns = np.arctan2(_cross(last, normal), (last * normal).sum(axis=1))
        self.middle = last + normal
        self.middle /= np.maximum(np.hypot(*self.middle.T), 1e-9)[:, None]
        turned = np.abs(self.turns) > _CORNER
        self.before = np.where(turned[:, None], normal, self.middle)
        self.after = np.where(np.roll(turned, -1)[:, None], normal, np.roll(self.middle, -1, axis=0))
        self.ends, self.sharp = np.append(0.0, np.cumsum(lengths)), np.flatnonzero(turned)
        self.length = float(self.ends[-1])

    def at(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points (n, 2) and unit normals to the left, places in m."""
        places = places % self.length
        side = np.clip(np.searchsorted(self.ends, places, side="right") - 1, 0, len(self.corners) - 1)
        share = ((places - self.ends[side]) / np.diff(self.ends)[side])[:, None]
        points = (1 - share) * self.corners[side] + share * np.roll(self.corners, -1, axis=0)[side]
        normals = (1 - share) * self.before[side] + share * self.after[side]
        normals = np.where(share < 1e-9, self.middle[side], normals)
        return points, normals / np.hypot(*normals.T)[:, None]

    def chords(self, places: FloatArray) -> FloatArray:
        """Corners (n, 2) at places in m of an equal-area polygon."""
        points, normals = self.at(places)
        side = np.searchsorted(self.ends, places % self.length, side="right") - 1
        start = self.corners[side]
        swept = np.append(0.0, np.cumsum(_cross(self.corners, np.roll(self.corners, -1, axis=0))))  # twice the area
        twice = swept[side] + _cross(start, points) + (places // self.length) * swept[-1]
        after = np.roll(points, -1, axis=0)
        between = np.diff(np.append(twice, twice[0] + swept[-1])) - _cross(points, after)
        length = np.hypot(*(after - points).T)
        out = (between + np.roll(between, 1)) / 2 / (length + np.roll(length, 1))
        here, sharp = (np.round(at / self.length, 12) for at in (places % self.length, self.ends[self.sharp]))
        turned = np.isin(here, sharp)
        return np.asarray(points - np.where(turned, 0.0, out)[:, None] * normals)

    def section_lengths(self, places: FloatArray) -> FloatArray:
        """Length in m between the sharp corners around each place."""
        sharp = self.ends[self.sharp]
        between = np.diff(np.append(sharp, sharp[0] + self.length)) if len(sharp) else np.array([self.length])
        return np.asarray(between[np.searchsorted(sharp, places, side="right") - 1])

    def samples(self, step: float) -> FloatArray:
        """Places in m at most a `step` apart, with corners and some between."""
        steps = np.minimum(step, self.section_lengths(self.ends[:-1]) / 6)
        counts = np.ceil(np.diff(self.ends) / steps - 1e-9).astype(int)
        sides = zip(self.ends[:-1], np.diff(self.ends), counts, strict=True)
        return np.concatenate([start + length * np.arange(count) / count for start, length, count in sides])


def _divided(
    rims: Sequence[_Rim], wanted: Sizes, fineness: float, height: float
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Places in m of the nodes on all rims, and distances to their own rim."""
    whole = sum(rim.length for rim in rims)
    places = [rim.samples(whole / _SAMPLES) for rim in rims]
    found = [rim.at(place) for rim, place in zip(rims, places, strict=True)]
    points, normals = (np.concatenate(part) for part in zip(*found, strict=True))
    radii = _graded(points, _touching(points, normals, points, np.zeros(len(points))), 1.0)
    across = _across(points, normals, [len(place) for place in places]) / 2
    sizes = np.minimum(np.maximum(_WIDEST * radii, _OF_HEIGHT * height) / fineness, wanted(points))
    first = 0
    for rim, place in zip(rims, places, strict=True):
        for corner in rim.sharp.tolist():
            number = first + int(np.argmin(np.abs(place - rim.ends[corner])))
            least = (_AT_REENTRANT if rim.turns[corner] < 0 else _AT_CORNERS) / fineness * across[number]
            sizes = np.minimum(sizes, least + _GRADING * np.hypot(*(points - points[number]).T))
        first += len(place)
    sections = [rim.section_lengths(place) for rim, place in zip(rims, places, strict=True)]
    sizes = _graded(points, np.minimum(sizes, np.concatenate(sections)), _GRADING)
    made, of_nodes, first = [], [], 0
    for rim, place in zip(rims, places, strict=True):
        own = slice(first, first + len(place))
        starts = rim.ends[rim.sharp] if len(rim.sharp) else np.zeros(1)
        cuts = np.append(starts, starts[0] + rim.length)
        turning = rim.ends[:-1], np.where(np.abs(rim.turns) > _CORNER, 0.0, np.abs(rim.turns))
        fewest = 1 if len(starts) > 2 else 8 // len(starts)
        nodes = [
            _section(rim, start, stop, place, sizes[own], radii[own], turning, fewest, fineness)
            for start, stop in itertools.pairwise(cuts.tolist())
        ]
        together = np.concatenate(nodes)
        made.append(together)
        of_nodes.append(np.interp(together, place, np.minimum(0.9 * sizes, 1.5 * radii)[own], period=rim.length))
        first += len(place)
    return made, of_nodes


def _section(
    rim: _Rim,
    start: float,
    stop: float,
    places: FloatArray,
    sizes: FloatArray,
    radii: FloatArray,
    turning: tuple[FloatArray, FloatArray],
    fewest: int,
    fineness: float,
) -> FloatArray:
    """Divide a rim between places in m by sizes, radii, turns."""
    fine = np.linspace(start, stop, 1 + max(64, 4 * math.ceil((stop - start) / float(sizes.min()))))
    middles = (fine[1:] + fine[:-1]) / 2
    pieces = np.diff(fine) / np.interp(middles, places, sizes, period=rim.length)
    at, angles = turning
    at = start + (at - start) % rim.length
    within = (at < stop - 1e-12) & (at > start + 1e-12) & (angles > 0)
    if within.any():  # spread over the sides around each corner
        order = np.argsort(at[within])
        total = np.append(0.0, np.cumsum(angles[within][order]))
        ends = np.concatenate(([start], at[within][order], [stop]))
        turned = np.interp(fine, (ends[1:] + ends[:-1]) / 2, total)
        radius = np.interp(middles, places, radii, period=rim.length)
        pieces = np.maximum(pieces, np.sqrt(np.diff(turned) * np.diff(fine) / radius) * fineness / _TURN)
    sums = np.append(0.0, np.cumsum(pieces))
    count = max(math.ceil(sums[-1] - 1e-6), fewest)
    return np.asarray(np.interp(np.arange(count) * sums[-1] / count, sums, fine))


def _touching(points: FloatArray, normals: FloatArray, samples: FloatArray, apart: FloatArray) -> FloatArray:
    """Radii in m of the largest circles left of a rim, by samples.

    Samples nearer than `apart` (n,) in m do not count.
    """
    away = samples[None] - points[:, None]
    squares, height = (away**2).sum(axis=2), np.einsum("nsi,ni->ns", away, normals)
    counted = (height > 1e-9 * np.sqrt(squares)) & (squares > apart[:, None] ** 2)
    return np.asarray(np.where(counted, squares / np.where(counted, 2 * height, 1.0), np.inf).min(axis=1))


def _across(points: FloatArray, normals: FloatArray, counts: Sequence[int]) -> FloatArray:
    """Distances in m from the rims' points (n, 2) to the next rim."""
    after, first = [], 0
    for count in counts:
        after.append(first + np.roll(np.arange(count), -1))
        first += count
    side = points[np.concatenate(after)] - points
    away = points[None] - points[:, None]
    turn = normals[:, None, 0] * side[None, :, 1] - normals[:, None, 1] * side[None, :, 0]
    turn = np.where(np.abs(turn) > 1e-12 * np.hypot(*side.T), turn, np.inf)
    along = (away[..., 0] * side[None, :, 1] - away[..., 1] * side[None, :, 0]) / turn
    share = (away[..., 0] * normals[:, None, 1] - away[..., 1] * normals[:, None, 0]) / turn
    hit = (along > 1e-6 * np.hypot(*np.ptp(points, axis=0))) & (share >= -1e-9) & (share <= 1 + 1e-9)
    return np.asarray(np.where(hit, along, np.inf).min(axis=1))


def _graded(points: FloatArray, values: FloatArray, growth: float, among: FloatArray | None = None) -> FloatArray:
    """Least of values (n,) `among` points plus `growth` times the distance, at points (m, 2)."""
    among = points if among is None else among
    return np.asarray((values + growth * np.hypot(*np.moveaxis(points[:, None] - among, 2, 0))).min(axis=1))


def _has_room(loops: Sequence[FloatArray], ways: Sequence[FloatArray], depth: float) -> bool:
    """Test whether loops moved inwards stay simple, apart and nested."""
    outer, *holes = moved = [loop + depth * way for loop, way in zip(loops, ways, strict=True)]
    flat = all(
        (_areas(np.concatenate((loop, inner)), _band(np.arange(len(loop)) + len(loop), np.arange(len(loop)))) > 0).all()
        for loop, inner in zip(loops, moved, strict=True)
    )
    return flat and bool(shapely.Polygon(outer, holes).is_valid)


def _lattice(loops: Sequence[FloatArray], step: float, finest: float, wanted: Sizes) -> tuple[FloatArray, IntArray]:
    """Points and triangles of a triangular lattice inside loops.

    The loops' points come first. Each halved step keeps the coarser lattice's points.
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
    starts = np.cumsum([0, *map(len, loops)]).tolist()
    sides = [(k, k + 1) for first, stop in itertools.pairwise(starts) for k in range(first, stop - 1)]
    sides += [(stop - 1, first) for first, stop in itertools.pairwise(starts)]
    triangles = _with_sides(together, Delaunay(together).simplices.astype(np.int64), sides)
    double = _areas(together, triangles)
    triangles[double < 0] = triangles[double < 0, ::-1]
    inside = shapely.contains_xy(plane, together[triangles].mean(axis=1)) & (np.abs(double) > 1e-9 * size**2)
    return points, triangles[inside]


def _with_sides(points: FloatArray, triangles: IntArray, sides: Sequence[tuple[int, int]]) -> IntArray:
    """Exchange diagonals of a triangulation until it has all `sides` (S. W. Sloan, 1993)."""
    found = [tuple(three) for three in triangles.tolist()]
    beside: dict[tuple[int, int], set[int]] = {}
    for k, three in enumerate(found):
        for pair in itertools.combinations(sorted(three), 2):
            beside.setdefault(pair, set()).add(k)

    def turn(a: int, b: int, c: int) -> float:
        (ax, ay), (bx, by), (cx, cy) = places[a], places[b], places[c]
        return float((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))

    def crosses(a: int, b: int, p: int, q: int) -> bool:
        return turn(a, b, p) * turn(a, b, q) < 0 and turn(p, q, a) * turn(p, q, b) < 0

    places = points.tolist()
    for a, b in sides:
        if (min(a, b), max(a, b)) in beside:
            continue
        waiting = [pair for pair in beside if not {a, b} & {*pair} and crosses(a, b, *pair)]
        for _ in range(100 * len(waiting)):
            if not waiting:
                break
            p, q = waiting.pop(0)
            one, other = beside[p, q]
            (r,), (s,) = {*found[one]} - {p, q}, {*found[other]} - {p, q}
            if not crosses(p, q, r, s):  # the two triangles do not form a convex quadrangle yet
                waiting.append((p, q))
                continue
            for k in (one, other):
                for pair in itertools.combinations(sorted(found[k]), 2):
                    beside[pair].discard(k)
            del beside[p, q]
            found[one], found[other] = (p, r, s), (q, r, s)
            for k in (one, other):
                for pair in itertools.combinations(sorted(found[k]), 2):
                    beside.setdefault(pair, set()).add(k)
            if {r, s} != {a, b} and not {a, b} & {r, s} and crosses(a, b, r, s):
                waiting.append((min(r, s), max(r, s)))
    return np.array(found)


def _cross(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])


def _interleaved(one: npt.NDArray[Number], other: npt.NDArray[Number]) -> npt.NDArray[Number]:
    return np.stack((one, other), axis=1).reshape(2 * len(one), *one.shape[1:])


def _with_middles(values: FloatArray) -> FloatArray:
    return np.append(_interleaved(values[:-1], (values[1:] + values[:-1]) / 2), values[-1])


def _band(upper: IntArray, lower: IntArray) -> IntArray:
    """Triangles between two closed rows of equally many nodes."""
    after, below = np.roll(upper, -1), np.roll(lower, -1)
    return np.concatenate((np.column_stack((upper, lower, below)), np.column_stack((upper, below, after))))


def _areas(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Areas in m², positive for anticlockwise corners."""
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return np.asarray(((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])) / 2)
