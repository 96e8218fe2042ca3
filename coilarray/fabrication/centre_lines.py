"""Centre lines of narrow shapes of copper."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.geometry.copper import groups

_NARROW = 10.0  # (perimeter / 2)² over area, 8:1 of a rectangle, from which a shape is followed along its centre
_STEP = 1 / 4  # of the mean width: distance of points on the outline. The centre line zigzags by 0.8 % of the width
_OPPOSITE = 2.0  # way along the outline over the distance of its ends, from which these are opposite sides
_STRAIGHT = 1 / 40  # of the width, within which the centre line is made of straight pieces
_WIDE, _PARTS = 1.0, 0.02  # a shape with more than this share of its area farther from its edge than this width is wide
_MOST_POINTS = 100_000


def centre_lines(shape: BaseGeometry) -> list[tuple[FloatArray, FloatArray]]:
    """Find the centre lines (n, 2) of a narrow shape, with widths (n − 1,), all in m.

    They are the medial axis: the edges between the Voronoi cells of points on the outline whose
    points lie on opposite sides (Blum 1967; Attali and Montanvert 1997). They end half a width
    before the shape does. There are none of a compact shape.

    >>> ((line, widths),) = centre_lines(shapely.box(0, 0, 10e-3, 0.5e-3))
    >>> (line * 1e3).round(2).tolist(), (widths * 1e3).round(2).tolist()
    ([[0.25, 0.25], [9.75, 0.25]], [0.5])
    """
    from scipy.spatial import Voronoi

    found = []
    for part in shapely.get_parts(shape):
        area, length = part.area, part.length
        if not area or length**2 / 4 < _NARROW * area:
            continue
        mean = 2 * area / length
        if length / (_STEP * mean) > _MOST_POINTS or part.buffer(-_WIDE * mean).area > _PARTS * area:
            continue
        outline = shapely.get_rings(shapely.segmentize(part, _STEP * mean))
        rings = [shapely.get_coordinates(ring)[:-1] for ring in outline]
        number = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
        steps = [np.hypot(*np.diff(ring, axis=0, append=ring[:1]).T) for ring in rings]
        along = np.concatenate([np.append(0.0, np.cumsum(step)[:-1]) for step in steps])
        around = np.array([step.sum() for step in steps])[number]
        points = np.vstack(rings)
        cells = Voronoi(points)
        p, q = cells.ridge_points.T
        ridges = np.array(cells.ridge_vertices)
        way = np.abs(along[p] - along[q])
        way = np.where(number[p] == number[q], np.minimum(way, around[p] - way), np.inf)
        inside = shapely.contains_xy(part, *cells.vertices.T)
        apart = np.hypot(*(points[p] - points[q]).T)
        kept = (ridges >= 0).all(axis=1) & inside[ridges].all(axis=1) & (way >= _OPPOSITE * apart)
        shapely.prepare(part)
        kept[kept] = shapely.covers(part, shapely.linestrings(cells.vertices[ridges[kept]]))  # not across a slot
        for chain in _chains(cells.vertices, ridges[kept], part):
            line = shapely.get_coordinates(shapely.LineString(chain).simplify(_STRAIGHT * mean))
            middle = shapely.points((line[1:] + line[:-1]) / 2)
            found.append((line, np.asarray(2 * shapely.distance(part.boundary, middle))))
    return found


def _chains(places: FloatArray, edges: IntArray, shape: shapely.Polygon) -> list[FloatArray]:
    """Join edges between `places` to lines (n, 2), without branches shorter than the copper is wide."""
    from scipy.spatial import KDTree

    grain = 1e-9 * float(np.ptp(places[edges.ravel()], axis=0).max()) if len(edges) else 0.0
    same = groups(len(places), KDTree(places).query_pairs(grain, output_type="ndarray"))
    around: dict[int, list[int]] = {}
    for a, b in np.array(same)[edges].tolist():
        if a != b and b not in around.get(a, ()):
            around.setdefault(a, []).append(b)
            around.setdefault(b, []).append(a)
    while True:
        chains = _runs(around)
        forks = {node for node, others in around.items() if len(others) > 2}
        short = [
            chain if chain[-1] in forks else chain[::-1]
            for chain in chains
            if (chain[0] in forks) != (chain[-1] in forks)
            and len(around[chain[-1 if chain[0] in forks else 0]]) == 1
            and float(np.hypot(*np.diff(places[chain], axis=0).T).sum())
            < 2 * shape.boundary.distance(shapely.Point(places[chain[0] if chain[0] in forks else chain[-1]]))
        ]
        if not short:
            return [places[chain] for chain in chains]
        for chain in short:
            for a, b in pairwise(chain):
                around[a].remove(b)
                around[b].remove(a)
                if not around[a]:
                    del around[a]


def _runs(around: dict[int, list[int]]) -> list[list[int]]:
    """Divide a graph into runs between ends and forks, and rings."""
    used: set[tuple[int, int]] = set()
    found = []
    for start in sorted(around, key=lambda node: len(around[node]) == 2):  # rings last
        for following in around[start]:
            if (start, following) in used or (len(around[start]) == 2 and (following, start) in used):
                continue
            run, came, here = [start], start, following
            while True:
                used |= {(came, here), (here, came)}
                run.append(here)
                if len(around[here]) != 2 or here == start:
                    break
                came, here = here, next(other for other in around[here] if other != came)
            found.append(run)
    return found
