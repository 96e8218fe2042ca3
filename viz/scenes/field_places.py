"""Points at which a scene needs a coil's field.

Two planes, a box, and seeds of field lines.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.design.model import Design
from coilarray.geometry.array import CoilArray

Axes = tuple[FloatArray, FloatArray, FloatArray]

_WIDE, _TALL = 2.2, 1.6  # half sides of the box along and across the board, in radii of the coil
_IN_SKIN = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)  # depths in skin depths
_OFF = 1e-8  # m from a face of a plate to a point on either side; B along the face may jump
_RINGS = ((0.15, 6), (0.4, 8), (0.65, 8), (0.9, 8))  # rings of seeds: radius in inner radii, and number of seeds


@dataclass(frozen=True)
class Span:
    """Points of one axis from `low` to `high` in m."""

    low: float
    high: float
    spacing: float

    @property
    def count(self) -> int:
        """Number of points."""
        return math.ceil((self.high - self.low) / self.spacing * (1 - 1e-12)) + 1

    @property
    def points(self) -> FloatArray:
        """Points of the axis in m."""
        return np.linspace(self.low, self.high, self.count)


Spans = tuple[Span, Span, Span]
"""Spans of x, y and z."""


def count_of(places: Iterable[Spans]) -> int:
    """Count the points of several grids."""
    return sum(x.count * y.count * z.count for x, y, z in places)


def field_planes(design: Design, coil: str, spacing: float) -> tuple[Spans, Spans]:
    """Level and upright plane for a coil's field.

    The level plane is at the design's field height.
    """
    x_min, y_min, x_max, y_max = design.array.bounds
    z, y = design.field_height, float(_middle_and_radii(design.array, coil)[0][1])
    along, across = Span(x_min, x_max, spacing), Span(y_min, y_max, spacing)
    top = max(2 * z, (y_max - y_min) / 2)
    return ((along, across, Span(z, z, spacing)), (along, Span(y, y, spacing), Span(min(spacing, z), top, spacing)))


def field_box(design: Design, coil: str, spacing: float) -> Spans:
    """Box about a coil."""
    (x, y), _, radius = _middle_and_radii(design.array, coil)
    wide, tall = _WIDE * radius, _TALL * radius
    bottom = -design.array.stackup.thickness - tall
    return Span(x - wide, x + wide, spacing), Span(y - wide, y + wide, spacing), Span(bottom, tall, spacing)


def points_of_box(design: Design, box: Spans) -> Axes:
    """Axes of a box without points in the copper."""
    x, y, z = box
    above = np.arange(z.spacing / 2, z.high + z.spacing / 2, z.spacing)
    below = np.arange(-design.array.stackup.thickness - z.spacing / 2, z.low - z.spacing / 2, -z.spacing)[::-1]
    return x.points, y.points, np.concatenate((below, above))


def beside_faces(design: Design, heights: FloatArray, frequency: float) -> FloatArray:
    """Heights in m with added points at infinite plates.

    Below its face the field of a plate changes over a skin depth, at a frequency in Hz.
    """
    found = [heights]
    for plate in design.plates:
        skin = plate.material.skin_depth(frequency)
        depths = np.array([0.0, *(share * skin for share in _IN_SKIN)])
        depths = depths[depths < plate.thickness / 2]
        low, high = plate.heights
        found.append(np.concatenate(([low - _OFF, high + _OFF], low + _OFF + depths, high - _OFF - depths)))
    every = np.unique(np.concatenate(found))
    return np.asarray(every[(every >= heights[0]) & (every <= heights[-1])])


def line_seeds(design: Design, coil: str) -> FloatArray:
    """Seeds of field lines, (n, 3) in m.

    They are on rings above a coil, at the design's field height or under the metal there.
    """
    centre, inner, _ = _middle_and_radii(design.array, coil)
    free = min((plate.heights[0] for plate in design.plates if plate.heights[0] > 0), default=math.inf)
    height = design.field_height if design.field_height < free else free / 2
    rings = []
    for share, count in _RINGS:
        angle = 2 * np.pi * (np.arange(count) + 0.25) / count
        ring = centre + share * inner * np.column_stack((np.cos(angle), np.sin(angle)))
        rings.append(np.column_stack((ring, np.full(count, height))))
    return np.vstack(rings)


def _middle_and_radii(array: CoilArray, coil: str) -> tuple[FloatArray, float, float]:
    """Centre and radii of a coil's outline in m."""
    place = array.placements[array.names.index(coil)]
    outline = place.to_board(place.coil.outline)
    low, high = outline.min(axis=0), outline.max(axis=0)
    return (low + high) / 2, float((high - low).min()) / 2, float((high - low).max()) / 2
