"""Scenes of a coil's field: planes, arrows, lines, surfaces."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray
from coilarray.design.model import Design
from coilarray.geometry.array import Array
from coilarray.viz.datasets.field import AMOUNT, field_arrows, field_lines, field_surfaces
from coilarray.viz.datasets.meshes import surface_of
from coilarray.viz.palette import INK
from coilarray.viz.scenes.scene import Part, Scale, Scene

if TYPE_CHECKING:
    import pyvista

Axes = tuple[FloatArray, FloatArray, FloatArray]

_WIDE, _TALL = 2.2, 1.6  # half sides of the box along and across the board, in radii of the coil
_IN_SKIN = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)  # depths in skin depths
_OFF = 1e-8  # m from a face of a plate to a point on either side; B along the face may jump
_DECADES = 2.0  # range of |B| that the colours resolve, in powers of ten
_ARROWS = 34  # number of arrows along the longest side of a plane
_SEE_THROUGH, _VEIL = 0.8, 0.3  # opacities of a plane and of a surface
_TUBE = 0.0012  # radius of a line over the diagonal of its box
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
    """Level and upright plane for a coil's field."""
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
    """Axes of a box outside the copper, across which B_z is interpolated."""
    x, y, z = box
    above = np.arange(z.spacing / 2, z.high + z.spacing / 2, z.spacing)
    below = np.arange(-design.array.stackup.thickness - z.spacing / 2, z.low - z.spacing / 2, -z.spacing)[::-1]
    return x.points, y.points, np.concatenate((below, above))


def beside_faces(design: Design, heights: FloatArray, frequency: float) -> FloatArray:
    """Heights in m with more below plates' faces, by skin depth."""
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
    """Seeds of field lines, (n, 3) in m."""
    centre, inner, _ = _middle_and_radii(design.array, coil)
    free = min((plate.heights[0] for plate in design.plates if plate.heights[0] > 0), default=math.inf)
    height = design.field_height if design.field_height < free else free / 2
    rings = []
    for share, count in _RINGS:
        angle = 2 * np.pi * (np.arange(count) + 0.25) / count
        ring = centre + share * inner * np.column_stack((np.cos(angle), np.sin(angle)))
        rings.append(np.column_stack((ring, np.full(count, height))))
    return np.vstack(rings)


def _middle_and_radii(array: Array, coil: str) -> tuple[FloatArray, float, float]:
    """Centre and radii of a coil's outline in m."""
    place = array.placements[array.names.index(coil)]
    outline = place.to_board(place.coil.outline)
    low, high = outline.min(axis=0), outline.max(axis=0)
    return (low + high) / 2, float((high - low).min()) / 2, float((high - low).max()) / 2


def scale_of_field(planes: Sequence[pyvista.DataSet]) -> Scale:
    """Logarithmic scale of |B|."""
    largest = max((float(np.asarray(plane.point_data[AMOUNT]).max(initial=0.0)) for plane in planes), default=0.0)
    high = largest if largest > 0 else 1.0
    return Scale(AMOUNT, "magnitude of B", "T", high / 10**_DECADES, high, logarithmic=True)


def scene_of_slices(slices: Sequence[pyvista.RectilinearGrid], scale: Scale) -> Scene:
    """Scene of planes of `flux_density` coloured by |B| above the scale's end."""
    parts = []
    for k, plane in enumerate(slices):
        low, high = np.reshape(plane.bounds, (3, 2)).T
        spacing = float((high - low).max()) / _ARROWS * 1e-3
        surface = surface_of(plane).clip_scalar(scalars=AMOUNT, value=scale.low, invert=False)
        if not surface.n_cells:  # the whole plane is in metal
            continue
        parts.append(Part(f"plane {k}", surface, "B on planes", scale=scale, opacity=_SEE_THROUGH, lit=False))
        arrows = surface_of(field_arrows(plane, spacing).threshold(scale.low, scalars=AMOUNT))
        parts.append(Part(f"arrows {k}", arrows, "B as arrows", INK, ambient=0.4))
    left_out = f"B below {100 / 10**_DECADES:g} % of its largest is left out."
    notes = (f"{left_out} Arrows: length as the root of the magnitude.",) if parts else ()
    return Scene(tuple(parts), notes=notes)


def scene_of_lines(grid: pyvista.RectilinearGrid, seeds: npt.ArrayLike, scale: Scale) -> Scene:
    """Scene of thin field lines of B through `seeds`, (n, 3) in m."""
    lines = field_lines(grid, seeds)
    if not lines.n_cells:
        return Scene()
    tubes = lines.tube(radius=_TUBE * float(grid.length), n_sides=8)
    return Scene((Part("field lines", tubes, "lines of B", scale=scale, ambient=0.5, diffuse=0.6),))


def scene_of_surfaces(grid: pyvista.RectilinearGrid, levels: Sequence[float], scale: Scale) -> Scene:
    """Scene of translucent surfaces of equal |B| in T."""
    surfaces = field_surfaces(grid, levels)
    if not surfaces.n_cells:
        return Scene()
    return Scene((Part("field surfaces", surfaces, "surfaces of equal B", scale=scale, opacity=_VEIL, ambient=0.4),))
