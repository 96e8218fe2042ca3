"""The field of a coil: on planes with arrows, as lines, and as surfaces of equal |B|."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from coilarray.viz.datasets.field import AMOUNT, field_arrows, field_lines, field_surfaces
from coilarray.viz.datasets.triangles import surface_of
from coilarray.viz.palette import INK
from coilarray.viz.scenes.scene import Part, Scale, Scene

if TYPE_CHECKING:
    import pyvista

FloatArray = npt.NDArray[np.float64]

_DECADES = 2.0  # of |B| that the colours tell apart
_ARROWS = 34  # along the longest side of a plane
_SEE_THROUGH = 0.8  # opacity of a plane
_VEIL = 0.3  # opacity of a surface
_TUBE = 0.0012  # radius of a line over the diagonal of its box


def scale_of_field(planes: Sequence[pyvista.DataSet], decades: float = _DECADES) -> Scale:
    """Return the one scale of |B| for all pictures of a field: its ends are equal ratios below the largest amount.

    Parameters
    ----------
    planes : sequence of pyvista.DataSet
        With the point array ``"|B| (T)"``.
    decades : float
        Powers of ten from end to end.
    """
    largest = max((float(np.asarray(plane.point_data[AMOUNT]).max(initial=0.0)) for plane in planes), default=0.0)
    high = largest if largest > 0 else 1.0
    return Scale(AMOUNT, "magnitude of B", "T", high / 10**decades, high, logarithmic=True)


def scene_of_slices(slices: Sequence[pyvista.RectilinearGrid], scale: Scale) -> Scene:
    """Return planes coloured by |B| with arrows along B; where |B| is below the scale, there is nothing.

    Parameters
    ----------
    slices : sequence of pyvista.RectilinearGrid
        Planes as `coilarray.viz.datasets.flux_density` makes them.
    scale : Scale
        From `scale_of_field`.
    """
    parts = []
    for k, plane in enumerate(slices):
        low, high = np.reshape(plane.bounds, (3, 2)).T
        spacing = float((high - low).max()) / _ARROWS * 1e-3
        surface = surface_of(plane).clip_scalar(scalars=AMOUNT, value=scale.low, invert=False)
        colour = scale.typical_colour(surface.point_data[AMOUNT])
        parts.append(Part(f"plane {k}", surface, "B on planes", colour, scale, opacity=_SEE_THROUGH, lit=False))
        arrows = surface_of(field_arrows(plane, spacing).threshold(scale.low, scalars=AMOUNT))
        parts.append(Part(f"arrows {k}", arrows, "B as arrows", INK, ambient=0.4))
    return Scene(tuple(parts), notes=("Arrows: length as the root of the magnitude.",) if parts else ())


def scene_of_lines(grid: pyvista.RectilinearGrid, seeds: npt.ArrayLike, scale: Scale) -> Scene:
    """Return lines of B through some points as thin tubes.

    Parameters
    ----------
    grid : pyvista.RectilinearGrid
        A box of B.
    seeds : array_like, shape (n, 3)
        In m.
    scale : Scale
        From `scale_of_field`.
    """
    lines = field_lines(grid, seeds)
    if not lines.n_cells:
        return Scene()
    tubes = lines.tube(radius=_TUBE * float(grid.length), n_sides=8)
    colour = scale.typical_colour(lines.point_data[AMOUNT])
    return Scene((Part("field lines", tubes, "lines of B", colour, scale, ambient=0.5, diffuse=0.6),))


def scene_of_surfaces(grid: pyvista.RectilinearGrid, levels: Sequence[float], scale: Scale) -> Scene:
    """Return surfaces of equal |B| as veils.

    Parameters
    ----------
    grid : pyvista.RectilinearGrid
        A box of B.
    levels : sequence of float
        In T.
    scale : Scale
        From `scale_of_field`.
    """
    surfaces = field_surfaces(grid, levels)
    if not surfaces.n_cells:
        return Scene()
    colour = scale.typical_colour(levels)
    part = Part("field surfaces", surfaces, "surfaces of equal B", colour, scale, opacity=_VEIL, ambient=0.4)
    return Scene((part,))
