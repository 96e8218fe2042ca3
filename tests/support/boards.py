"""Boards that several tests of the geometry share."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from coilarray.geometry import (
    Array,
    Coil,
    Leads,
    Placement,
    PlatedHole,
    RoundedSpiral,
    Sheet,
    Spiral,
    Stackup,
    across_flats,
    drills,
    lattice,
)

VIA = PlatedHole(0.2e-3, 0.45e-3)
LEADS = Leads(2e-3, 1.5e-3, PlatedHole(0.5e-3, 1e-3))
FOUR_LAYERS = Stackup(("L1", "L2", "L3", "L4"), (35e-6,) * 4, (0.215e-3,) * 3, (4.5,) * 3)
SHEETS = (Sheet("base", 6e-3), Sheet("magnetic", 2e-3, 2.7))


def length(line: np.ndarray[Any, Any]) -> float:
    """Length of a line of points of shape (n, 2)."""
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def swept_area(line: np.ndarray[Any, Any]) -> float:
    """Area swept by the ray from the origin, counted positive counter-clockwise."""
    x, y = line.T
    return float(0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def many_layers(count: int) -> Stackup:
    """Stack-up of `count` copper layers L1, L2, …"""
    names = tuple(f"L{k + 1}" for k in range(count))
    return Stackup(names, (35e-6,) * count, (0.2e-3,) * (count - 1), (4.5,) * (count - 1))


def one_coil(coil: Coil, *, rotation: float = 0.0, through_holes: bool = True) -> Array:
    """Board of just this coil on as many layers as it has."""
    stackup = many_layers(len(coil.lines))
    return Array(stackup, (Placement("A", coil, stackup.names, 0, 0, rotation),), through_holes=through_holes)


def wound_board(sides: int, layers: int, rotation: float = 0.0, *, through_holes: bool = True) -> Array:
    """Board of one coil of six turns with leads."""
    spiral = Spiral(sides, 12e-3, 6, 0.15e-3, 0.15e-3)
    return one_coil(replace(spiral, layers=layers).coil(), rotation=rotation, through_holes=through_holes)


def round_spiral(radius: float, turns: float, width: float, gap: float, **more: Any) -> RoundedSpiral:
    """Winding of a circle."""
    return RoundedSpiral(2 * radius, 2 * radius, turns, width, gap, radius, **more)


WOUND = {
    "triangle": wound_board(3, 2, 0.4),
    "four layers, blind holes": wound_board(4, 4, 1.0, through_holes=False),
    "circle": one_coil(round_spiral(6e-3, 6, 0.15e-3, 0.15e-3).coil(), rotation=-2.0),
}
SMALL = Spiral(6, 6e-3, 4, 0.2e-3, 0.2e-3).coil()


def small_board(**changes: object) -> Array:
    """Two small coils on the upper and on the lower two of four layers, one of them turned."""
    first = Placement("A", SMALL, ("L1", "L2"), -5e-3, 1e-3)
    return replace(Array(FOUR_LAYERS, (first, Placement("B", SMALL, ("L3", "L4"), 5e-3, -1e-3, 0.4))), **changes)


def stroked(array: Array, layer: str) -> list[shapely.Geometry]:
    """What round apertures draw on a layer: a piece for each segment and pad, in m."""
    pieces = [shapely.Point(h.x, h.y).buffer(h.pad / 2, quad_segs=32) for h in drills(array) if layer in h.layers]
    for placement in array.placements:
        for points, widths, on in placement.traces():
            if on == layer:
                ends = shapely.linestrings(np.stack((points[:-1], points[1:]), axis=1))
                pieces += list(shapely.buffer(ends, widths / 2, quad_segs=32))
    return pieces


def drawn_copper(file: Any) -> shapely.Geometry:
    """What the objects of a Gerber file that gerbonara has read cover, in m."""
    shapes = []
    for item in file.objects:
        places = [(item.x, item.y)] if hasattr(item, "x") else [(item.x1, item.y1), (item.x2, item.y2)]
        way = shapely.Point(places[0]) if len(places) == 1 else shapely.LineString(places)
        shapes.append(way.buffer(item.aperture.equivalent_width("mm") / 2, quad_segs=32))
    return shapely.affinity.scale(shapely.union_all(shapes), 1e-3, 1e-3, origin=(0, 0))


def reference_board(*, count: int = 6, turns: int = 30, through_holes: bool = True) -> Array:
    """Two-layer coils C1, C2, … of hexagonal turns in a row, alternately on L1, L2 and on L3, L4."""
    flats = across_flats(23e-3, 6)
    coil = Spiral(6, flats, turns, 0.1e-3, 0.1e-3).coil()
    points, _ = lattice("linear", 13.28e-3, count)
    pairs = (("L1", "L2"), ("L3", "L4"))
    placements = tuple(Placement(f"C{k + 1}", coil, pairs[k % 2], x, y) for k, (x, y) in enumerate(points.tolist()))
    return Array(FOUR_LAYERS, placements, through_holes=through_holes)


def square_turns(
    turns: int, size: float, pitch: float, centre: float = 0.0, sense: int = 1
) -> list[tuple[float, float]]:
    """A square spiral inwards from (−size, −size), anticlockwise for sense 1."""
    left, right, low, high = -size, size, -size, size
    points = [(left, low)]
    for _ in range(turns):
        points += [(right, low), (right, high), (left + pitch, high)]
        low, left = low + pitch, left + pitch
        points.append((left, low))
        right, high = right - pitch, high - pitch
    return [(centre + sense * x, y) for x, y in points]


def arcs_board() -> Array:
    """A circle, a racetrack that is wound the other way and turned, and a rounded rectangle with an odd layer."""
    shapes = (
        (round_spiral(4e-3, 4, 0.2e-3, 0.2e-3), 2, 0.0),
        (RoundedSpiral(7e-3, 12e-3, 4, 0.2e-3, 0.2e-3, 3.5e-3, winding="cw"), 2, 0.7),
        (RoundedSpiral(10e-3, 6e-3, 3, 0.2e-3, 0.2e-3, 1e-3, direction=math.pi / 2), 1, 0.0),
    )
    places = []
    for k, (spiral, layers, rotation) in enumerate(shapes):
        coil = replace(spiral, layers=layers, return_lead=layers == 1).coil()
        places.append(Placement(f"coil{k + 1}", coil, ("L1", "L2"), 16e-3 * k, 1e-3 * k, rotation))
    return Array(many_layers(2), tuple(places))
