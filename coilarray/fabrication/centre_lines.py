"""Centre lines of narrow shapes of copper."""

from __future__ import annotations

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
    points lie on opposite sides (Blum 1967; Attali and Montanvert 1997). They end about half a
    width before the shape does. There are none of a compact shape.

    >>> ((line, widths),) = centre_lines(shapely.box(0, 0, 10e-3, 0.5e-3))
    >>> sorted((line * 1e3).round(2).tolist()), (widths * 1e3).round(2).tolist()
    ([[0.3, 0.25], [9.7, 0.25]], [0.5])
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
    same = np.array(groups(len(places), KDTree(places).query_pairs(grain, output_type="ndarray")))
    edges = np.unique(np.sort(same[edges], axis=1), axis=0)
    lines = shapely.linestrings(places[edges[edges[:, 0] != edges[:, 1]]])
    while True:
        lines = shapely.get_parts(shapely.line_merge(shapely.multilinestrings(lines)))
        ends = shapely.points(np.array([shapely.get_coordinates(line)[[0, -1]] for line in lines]).reshape(-1, 2, 2))
        _, number, count = np.unique(shapely.get_coordinates(ends), axis=0, return_inverse=True, return_counts=True)
        meet = count[number].reshape(-1, 2)
        narrow = shapely.length(lines)[:, None] < 2 * shapely.distance(shape.boundary, ends)
        short = ((meet[:, ::-1] == 1) & (meet > 2) & narrow).any(axis=1)
        if not short.any():
            return [shapely.get_coordinates(line) for line in lines]
        lines = lines[~short]
