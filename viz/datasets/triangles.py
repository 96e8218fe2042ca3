"""Surfaces in mm from the solids of the geometry, which are in m."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    import pyvista
    import trimesh

MM_PER_M = 1e3


def triangles(points: npt.NDArray[np.float64], faces: npt.NDArray[np.integer]) -> pyvista.PolyData:
    """Triangles in mm from points in m, shape (n, 3), and their numbers, shape (m, 3)."""
    import pyvista

    return pyvista.PolyData(points * MM_PER_M, faces=np.insert(faces, 0, 3, axis=1).ravel())


def polylines(points: Sequence[npt.NDArray[np.float64]]) -> pyvista.PolyData:
    """One polyline in mm for each array of points in m, shape (n, 3)."""
    import pyvista

    counts = [len(line) for line in points]
    starts = np.cumsum([0, *counts])
    lines = [np.r_[count, start + np.arange(count)] for count, start in zip(counts, starts, strict=False)]
    return pyvista.PolyData(np.vstack(points) * MM_PER_M, lines=np.concatenate(lines)) if counts else pyvista.PolyData()


def solid_mesh(solid: trimesh.Trimesh) -> pyvista.PolyData:
    """Return the surface of a solid in m as triangles in mm."""
    return triangles(np.asarray(solid.vertices), np.asarray(solid.faces))


def surface_of(mesh: pyvista.DataSet) -> pyvista.PolyData:
    """Return the surface of a grid with its arrays; a surface itself as it is."""
    import pyvista
    from vtkmodules.vtkFiltersGeometry import vtkGeometryFilter

    if isinstance(mesh, pyvista.PolyData):
        return mesh
    filter_ = vtkGeometryFilter()  # PyVista's own name for it has changed three times
    filter_.SetInputData(mesh)
    filter_.Update()
    return pyvista.wrap(filter_.GetOutput())


def merged(solids: Sequence[tuple[trimesh.Trimesh | None, int]]) -> pyvista.PolyData:
    """Join into one surface in mm several solids in m.

    Parameters
    ----------
    solids : sequence of (trimesh.Trimesh or None, int)
        Each with the number that its triangles get in the cell array ``"coil"``; None is left out.
    """
    import pyvista

    points, faces, numbers = [], [], []
    offset = 0
    for solid, number in solids:
        if solid is None:
            continue
        points.append(np.asarray(solid.vertices))
        faces.append(np.asarray(solid.faces) + offset)
        numbers.append(np.full(len(solid.faces), number))
        offset += len(solid.vertices)
    if not numbers:
        return pyvista.PolyData()
    mesh = triangles(np.vstack(points), np.vstack(faces))
    mesh.cell_data["coil"] = np.concatenate(numbers)
    return mesh
