"""Surfaces in mm from solids in m."""

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
    """Triangles in mm from points in m.

    The points have shape (n, 3). The indices of their corners have shape (m, 3).
    """
    from coilarray.viz.extra_3d import pyvista

    return pyvista.PolyData(points * MM_PER_M, faces=np.insert(faces, 0, 3, axis=1).ravel())


def polylines(points: Sequence[npt.NDArray[np.float64]]) -> pyvista.PolyData:
    """Polylines in mm from arrays of points in m.

    Each array has shape (n, 3).
    """
    from coilarray.viz.extra_3d import pyvista

    counts = [len(line) for line in points]
    starts = np.cumsum([0, *counts])
    lines = [np.r_[count, start + np.arange(count)] for count, start in zip(counts, starts, strict=False)]
    return pyvista.PolyData(np.vstack(points) * MM_PER_M, lines=np.concatenate(lines)) if counts else pyvista.PolyData()


def solid_mesh(solid: trimesh.Trimesh) -> pyvista.PolyData:
    """Surface of a solid in m as triangles in mm."""
    return triangles(np.asarray(solid.vertices), np.asarray(solid.faces))


def surface_of(mesh: pyvista.DataSet) -> pyvista.PolyData:
    """Surface of a grid with its arrays."""
    from vtkmodules.vtkFiltersGeometry import vtkGeometryFilter

    from coilarray.viz.extra_3d import pyvista

    if isinstance(mesh, pyvista.PolyData):
        return mesh
    filter_ = vtkGeometryFilter()  # PyVista has renamed its own three times
    filter_.SetInputData(mesh)
    filter_.Update()
    return pyvista.wrap(filter_.GetOutput())


def merged(solids: Sequence[tuple[trimesh.Trimesh | None, int]]) -> pyvista.PolyData:
    """Join solids in m into one surface in mm.

    Each solid has the value of its cells in ``"coil"``. None is left out.
    """
    from coilarray.viz.extra_3d import pyvista

    present = [(solid, number) for solid, number in solids if solid is not None]
    if not present:
        return pyvista.PolyData()
    starts = np.cumsum([0, *(len(solid.vertices) for solid, _ in present)])
    faces = [np.asarray(solid.faces) + start for (solid, _), start in zip(present, starts, strict=False)]
    mesh = triangles(np.vstack([np.asarray(solid.vertices) for solid, _ in present]), np.vstack(faces))
    mesh.cell_data["coil"] = np.concatenate([np.full(len(solid.faces), number) for solid, number in present])
    return mesh
