"""Meshes in mm of boards, plates and balls, and VTK files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from coilarray.geometry import Ball, FinitePlate, Plate
from coilarray.geometry.bodies import Body
from coilarray.geometry.copper import plate_solid

if TYPE_CHECKING:
    import pyvista
    import trimesh


MM_PER_M = 1e3

_BALL = (48, 32)  # meridians and circles of latitude of a ball


def triangles(points: npt.NDArray[np.float64], faces: npt.NDArray[np.integer]) -> pyvista.PolyData:
    """Triangles in mm from points (n, 3) in m and corners (m, 3)."""
    from coilarray.viz.extra_3d import pyvista

    return pyvista.PolyData(points * MM_PER_M, faces=np.insert(faces, 0, 3, axis=1).ravel())


def polylines(points: Sequence[npt.NDArray[np.float64]]) -> pyvista.PolyData:
    """Polylines in mm from arrays of points (n, 3) in m."""
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
    """Join solids in m into a surface in mm with numbers in ``"coil"``."""
    from coilarray.viz.extra_3d import pyvista

    present = [(solid, number) for solid, number in solids if solid is not None]
    if not present:
        return pyvista.PolyData()
    starts = np.cumsum([0, *(len(solid.vertices) for solid, _ in present)])
    faces = [np.asarray(solid.faces) + start for (solid, _), start in zip(present, starts, strict=False)]
    mesh = triangles(np.vstack([np.asarray(solid.vertices) for solid, _ in present]), np.vstack(faces))
    mesh.cell_data["coil"] = np.concatenate([np.full(len(solid.faces), number) for solid, number in present])
    return mesh


def copper_mesh(parts: Mapping[str, trimesh.Trimesh], names: Sequence[str], layer: str) -> pyvista.PolyData:
    """Surface of the copper of one layer in mm.

    The cell array ``"coil"`` is the index in `names` of each triangle's coil.
    """
    return merged([(parts.get(f"copper/{layer}/{name}"), index) for index, name in enumerate(names)])


def barrel_mesh(parts: Mapping[str, trimesh.Trimesh], names: Sequence[str]) -> pyvista.PolyData:
    """Surface of all barrels in mm, as in `copper_mesh`."""
    return merged(
        [
            (solid, index)
            for index, name in enumerate(names)
            for key, solid in parts.items()
            if key.rpartition("/")[0] == f"barrel/{name}"
        ]
    )


def board_mesh(parts: Mapping[str, trimesh.Trimesh]) -> pyvista.PolyData:
    """Surface of the laminate in mm, or empty."""
    from coilarray.viz.extra_3d import pyvista

    return solid_mesh(parts["board"]) if "board" in parts else pyvista.PolyData()


VTK_SUFFIXES = {"PolyData": ".vtp", "RectilinearGrid": ".vtr", "UnstructuredGrid": ".vtu"}
"""Suffix of the file of a dataset, by the name of its class."""


def vtk_text(mesh: pyvista.DataSet) -> str:
    """Text of a PolyData or grid as VTK's XML file."""
    from vtkmodules import vtkIOXML

    # The text is written in memory, because VTK is silent, or crashes, if it cannot write a file.
    writer: Any = getattr(vtkIOXML, f"vtkXML{type(mesh).__name__}Writer")()
    writer.SetInputData(mesh)
    writer.SetDataModeToBinary()
    writer.WriteToOutputStringOn()
    writer.Write()
    return str(writer.GetOutputString())


def plate_mesh(plate: Plate | FinitePlate, within: tuple[float, float, float, float]) -> pyvista.PolyData:
    """Surface of a plate in mm, cut to `within` in m if infinite."""
    return solid_mesh(plate_solid(plate, within))


def body_mesh(
    body: Body, place: tuple[float, float, float], within: tuple[float, float, float, float]
) -> pyvista.PolyData:
    """Surface of a body in mm about its centre or lower face."""
    from coilarray.viz.extra_3d import pyvista

    if isinstance(body, Ball):
        meridians, circles = _BALL
        middle = tuple(MM_PER_M * value for value in place)
        ball: pyvista.PolyData = pyvista.Sphere(
            radius=MM_PER_M * body.radius, center=middle, theta_resolution=meridians, phi_resolution=circles
        )
        return ball
    mesh = plate_mesh(body, within)
    away = (0.0, 0.0, place[2] - body.z) if isinstance(body, Plate) else np.subtract(place, body.centre)
    return mesh.translate(np.multiply(MM_PER_M, away), inplace=False)
