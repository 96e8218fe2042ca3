"""Parts of a scene as VTK actors, the same ones for windows, pictures and pages. None of this needs a screen."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from coilarray.viz.datasets.triangles import surface_of
from coilarray.viz.scenes.scene import Part

if TYPE_CHECKING:
    import pyvista

_BAKED = "colour"  # array of red, green and blue
_SHARP = 30.0  # degrees between triangles whose edge stays sharp
_BEHIND = 2.0  # units of polygon offset


def actor_of(part: Part, pixel: float = 1.0) -> Any:
    """Make the actor of a part.

    Parameters
    ----------
    part : Part
        What is to be drawn.
    pixel : float
        Pixels for one in a picture 900 pixels high.

    Returns
    -------
    pyvista.Actor
        Its colours are in the mesh, so that every renderer shows the same.
    """
    import pyvista

    mesh = _surface(part)
    mapper: Any = pyvista.DataSetMapper(dataset=mesh)
    if part.scale is None:
        mapper.scalar_visibility = False
    else:
        on_cells = part.scale.array in part.mesh.cell_data
        mapper.SetScalarModeToUseCellFieldData() if on_cells else mapper.SetScalarModeToUsePointFieldData()
        mapper.SelectColorArray(_BAKED)
        mapper.SetColorModeToDirectScalars()
        mapper.scalar_visibility = True
    if part.sunk:
        mapper.SetResolveCoincidentTopologyToPolygonOffset()
        mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(_BEHIND, _BEHIND)
    properties = pyvista.Property(
        color=part.colour,
        opacity=part.opacity,
        line_width=part.line_width * pixel,
        lighting=part.lit,
        ambient=part.ambient,
        diffuse=part.diffuse,
        interpolation="Phong" if part.smooth else "Flat",
    )
    return pyvista.Actor(mapper=mapper, prop=properties, name=part.name)


def _surface(part: Part) -> pyvista.PolyData:
    """Return the surface of a part's mesh with nothing but its baked colours and normals."""
    mesh: Any = surface_of(part.mesh)
    surface: pyvista.PolyData = mesh.copy(deep=False)
    surface.clear_data()
    surface.points = np.asarray(mesh.points, dtype=np.float32)  # as graphics cards take them
    if part.scale is not None:
        on_cells = part.scale.array in mesh.cell_data
        values = (mesh.cell_data if on_cells else mesh.point_data)[part.scale.array]
        target = surface.cell_data if on_cells else surface.point_data
        target[_BAKED] = np.ascontiguousarray(part.scale.colours_of(values))
    if part.smooth:
        surface = surface.compute_normals(
            cell_normals=False, split_vertices=True, feature_angle=_SHARP, auto_orient_normals=False
        )
    return surface
