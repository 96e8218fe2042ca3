"""Meshes in mm of boards, bodies, sheets and indenters, and VTK files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray
from coilarray.geometry import Ball, FinitePlate, Placement, Plate
from coilarray.geometry.bodies import Body
from coilarray.geometry.copper import plate_solid
from coilarray.geometry.elastomer import Indenter, Sheet

if TYPE_CHECKING:
    import pyvista
    import trimesh
    import xarray as xr


MM_PER_M = 1e3
RISE = "u_z (m)"  # name of the point array of the upward displacement of a dented sheet, not exaggerated
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
    """Surface of the copper of one layer in mm, `names` by cell in ``"coil"``."""
    return merged([(parts.get(f"copper/{layer}/{name}"), index) for index, name in enumerate(names)])


def along_turn(place: Placement, count: int) -> tuple[FloatArray, FloatArray, float]:
    """Take steps along the middle turn of a coil's path."""
    # Points (count, 2) just behind and ahead of each place on the board, and the distance of the places, in m.
    outline = place.to_board(place.coil.outline)
    middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
    turns = []
    for line, *_ in place.traces():
        angle = np.unwrap(np.arctan2(line[:, 1] - middle[1], line[:, 0] - middle[0]))
        turns.append((np.maximum.accumulate(np.abs(angle - angle[0])), line))
    turned, line = max(turns, key=lambda turn: float(turn[0][-1]))  # of the layer that has most of the turns
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))))
    start, end = np.interp(turned[-1] / 2 + np.array([-math.pi, math.pi]), turned, along).tolist()
    step = (end - start) / count
    behind, ahead = (
        np.column_stack([np.interp(start + step * (np.arange(count) + share), along, axis) for axis in line.T])
        for share in (0.49, 0.51)
    )
    return behind, ahead, step


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


_ANGLES, _RADII = 271, 96  # directions and circles of a dent's mesh, 1° and, near the axis, 1/9000 of its width
_OPENED = (-math.pi / 2, math.pi)  # directions that stay when the quarter at the lower left is cut out


def sheet_meshes(
    parts: Mapping[str, trimesh.Trimesh], lift: float = 0.0, spread: float = 0.0
) -> dict[str, pyvista.PolyData]:
    """Surfaces of sheets, solids in m, in mm by name, lowest first."""
    # `lift` is the height in m of the lowest above the board, `spread` of every other above the sheet below it.
    solids = {key.removeprefix("sheet/"): solid for key, solid in parts.items() if key.startswith("sheet/")}
    in_order = sorted(solids, key=lambda name: float(solids[name].centroid[2]))
    return {
        name: solid_mesh(solids[name]).translate((0.0, 0.0, (lift + place * spread) * MM_PER_M))
        for place, name in enumerate(in_order)
    }


def indenter_outline(indenter: Indenter, height: float) -> tuple[FloatArray, FloatArray]:
    """Radius (or half the width) and height above the tip in m, with a rod."""
    # Heights that grow as squares give even steps of the radius at a round tip.
    z = height * np.linspace(0.0, 1.0, _RADII) ** 2
    r = np.array([indenter.radius_at(level) for level in z.tolist()])
    return np.r_[0.0, r], np.r_[0.0, z]


def dented_sheet_meshes(
    indentation: xr.Dataset,
    sheets: Sequence[Sheet],
    centre: tuple[float, float],
    extent: tuple[float, float, float, float],
    exaggeration: float = 1.0,
    opened: bool = True,
) -> dict[str, pyvista.PolyData]:
    """Deformed sheets in mm by name, with the point array ``"u_z (m)"``."""
    # If `opened`, the quarter of lower x and y is cut out. `centre` is x and y of the indenter, `extent` x_min,
    # y_min, x_max, y_max of the flat sheet, in m. Displacements are multiplied by `exaggeration`.
    plane = indentation.attrs["symmetry"] == "plane"
    angles, lengths = _rays(centre, extent, float(indentation.r[-1]), plane=plane, opened=opened)
    radii = lengths[:, None] * np.linspace(0.0, 1.0, _RADII) ** 2  # fine near the axis, at the dent
    at = (indentation.isel(interface=k) for k in range(len(sheets) + 1))
    faces = [_displaced(angles, radii, centre, face, exaggeration, plane=plane) for face in at]
    return {sheet.name: _closed_solid(faces[k], faces[k + 1]) for k, sheet in enumerate(sheets)}


def indenter_mesh(
    indenter: Indenter,
    tip: float,
    centre: tuple[float, float],
    extent: tuple[float, float, float, float],
    height: float,
    exaggeration: float = 1.0,
    opened: bool = True,
) -> pyvista.PolyData:
    """Surface of an indenter in mm, cut open as in `dented_sheet_meshes`."""
    # `tip` is its height in m. A cylinder goes from end to end of the extent. Heights above the tip are exaggerated.
    plane, end = indenter.symmetry == "plane", indenter.radius_at(height / exaggeration)
    angles, lengths = _rays(centre, extent, end, plane=plane, opened=opened)
    radii = lengths[:, None] * np.sin(np.linspace(0.0, math.pi / 2, _RADII))  # fine at the rim, where a ball is steep
    distance = np.abs(radii * np.cos(angles)[:, None]) if plane else radii
    x, y = centre[0] + radii * np.cos(angles)[:, None], centre[1] + radii * np.sin(angles)[:, None]
    # A distance that rounding has put beyond the rim has no height.
    bottom = tip + exaggeration * indenter.profile(np.minimum(distance, end))
    return _closed_solid(np.stack((x, y, bottom), axis=-1), np.stack((x, y, np.full_like(x, tip + height)), axis=-1))


def _rays(
    centre: tuple[float, float], extent: tuple[float, float, float, float], end: float, *, plane: bool, opened: bool
) -> tuple[FloatArray, FloatArray]:
    """Directions all around or over three quarters, and lengths in m to `end`."""
    (x, y), (x_min, y_min, x_max, y_max) = centre, extent
    if not (x_min < x < x_max and y_min < y < y_max):
        raise ValueError(f"centre must be inside the extent {extent}; got {centre}.")
    if plane:
        x_min, x_max, end = max(x_min, x - end), min(x_max, x + end), math.inf
    corners = [math.atan2(v - y, u - x) for u, v in ((x_max, y_min), (x_max, y_max), (x_min, y_max))]
    if not opened:
        corners.append(math.atan2(y_min - y, x_min - x))
    angles = np.unique(np.r_[np.linspace(*(_OPENED if opened else (-math.pi, math.pi)), _ANGLES), corners])
    cosine, sine = np.cos(angles), np.sin(angles)
    across = np.where(cosine > 0, x_max - x, x - x_min)
    along = np.where(sine > 0, y_max - y, y - y_min)
    with np.errstate(divide="ignore"):  # a ray along an axis never meets the sides parallel to it
        return angles, np.minimum(np.minimum(across / np.abs(cosine), along / np.abs(sine)), end)


def _displaced(
    angles: FloatArray, radii: FloatArray, centre: tuple[float, float], face: xr.Dataset, factor: float, *, plane: bool
) -> FloatArray:
    """Displaced points of an interface and their rise in m, shape (angles, radii, 4)."""
    x, y = radii * np.cos(angles)[:, None], radii * np.sin(angles)[:, None]
    distance = np.abs(x) if plane else radii
    outwards, upwards = (
        np.interp(distance, face.r.values, face[name].values) for name in ("displacement_r", "displacement_z")
    )
    outwards = factor * outwards
    along = centre[0] + x + outwards * (np.sign(x) if plane else np.cos(angles)[:, None])
    across = centre[1] + y + (0.0 if plane else outwards * np.sin(angles)[:, None])
    return np.stack((along, across, float(face.height) + factor * upwards, upwards), axis=-1)


def _closed_solid(bottom: FloatArray, top: FloatArray) -> pyvista.PolyData:
    """Close the solid between faces (angles, radii, 3 or 4) in m."""
    rays, circles = bottom.shape[:2]
    # Point [ray, circle] of a face. All rays begin at the same point on the axis.
    lower = np.arange(rays * circles).reshape(rays, circles)
    lower[:, 0] = lower[0, 0]
    upper = lower + rays * circles

    def strip(a: npt.NDArray[np.intp], b: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
        quads = np.stack((a[:-1], a[1:], b[1:], b[:-1]), axis=-1)
        return np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))

    faces = [
        *(strip(upper[k], upper[k + 1]) for k in range(rays - 1)),
        *(strip(lower[k + 1], lower[k]) for k in range(rays - 1)),
        strip(lower[:, -1], upper[:, -1]),
    ]
    if not np.allclose(bottom[0, -1], bottom[-1, -1], atol=1e-9):
        faces += [strip(lower[0], upper[0]), strip(upper[-1], lower[-1])]
    corners = np.concatenate(faces)
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a)]  # on the axis one side of a quad is a point
    used, numbers = np.unique(corners, return_inverse=True)
    points = np.concatenate((bottom, top)).reshape(-1, bottom.shape[-1])[used]
    solid = triangles(points[:, :3], numbers.reshape(corners.shape))
    if points.shape[1] > 3:
        solid.point_data[RISE] = points[:, 3]
    return solid
