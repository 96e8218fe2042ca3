"""Elastomer sheets, flat and dented, and the indenter."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray
from coilarray.geometry.elastomer import Indenter, Sheet
from coilarray.viz.datasets.meshes import MM_PER_M, solid_mesh, triangles

if TYPE_CHECKING:
    import pyvista
    import trimesh
    import xarray as xr


_ANGLES, _RADII = 271, 96  # directions and circles of a dent's mesh, 1° and, near the axis, 1/9000 of its width
_OPENED = (-math.pi / 2, math.pi)  # directions that stay when the quarter at the lower left is cut out


def sheet_meshes(
    parts: Mapping[str, trimesh.Trimesh], lift: float = 0.0, spread: float = 0.0
) -> dict[str, pyvista.PolyData]:
    """Surfaces of the sheets in mm by name, lowest first.

    The `parts` are solids in m. In an exploded view `lift` is the height in m of the lowest sheet
    above the board, `spread` the height of every other sheet above the sheet below it.
    """
    solids = {key.removeprefix("sheet/"): solid for key, solid in parts.items() if key.startswith("sheet/")}
    in_order = sorted(solids, key=lambda name: float(solids[name].bounds[0, 2]))
    return {
        name: solid_mesh(solids[name]).translate((0.0, 0.0, (lift + place * spread) * MM_PER_M))
        for place, name in enumerate(in_order)
    }


def indenter_outline(indenter: Indenter, height: float) -> tuple[FloatArray, FloatArray]:
    """Radius (or half the width) and height above the tip in m.

    Above its own shape an indenter continues as a rod.
    """
    # Heights that grow as squares give even steps of the radius at a round tip.
    z = height * np.linspace(0.0, 1.0, _RADII) ** 2
    r = np.array([indenter.radius_at(level) for level in z.tolist()])
    return np.r_[0.0, r], np.r_[0.0, z]


def dented_sheet_meshes(
    indentation: xr.Dataset,
    sheets: Sequence[Sheet],
    centre: tuple[float, float],
    extent: tuple[float, float, float, float],
) -> dict[str, pyvista.PolyData]:
    """Surfaces of the deformed sheets in mm by name.

    The quarter of lower x and y is cut out. The `indentation` is at one depth. `centre` is x and y
    of the indenter, `extent` x_min, y_min, x_max, y_max of the flat sheet, in m.
    """
    plane = indentation.attrs["symmetry"] == "plane"
    angles, lengths = _rays(centre, extent, float(indentation.r[-1]), plane=plane)
    radii = lengths[:, None] * np.linspace(0.0, 1.0, _RADII) ** 2  # fine near the axis, at the dent
    at = (indentation.isel(interface=k) for k in range(len(sheets) + 1))
    faces = [_displaced(angles, radii, centre, face, plane=plane) for face in at]
    return {sheet.name: _opened_solid(faces[k], faces[k + 1]) for k, sheet in enumerate(sheets)}


def indenter_mesh(
    indenter: Indenter,
    tip: float,
    centre: tuple[float, float],
    extent: tuple[float, float, float, float],
    height: float,
) -> pyvista.PolyData:
    """Surface of an indenter in mm, cut open as in `dented_sheet_meshes`.

    `tip` is the height in m of its tip. A cylinder goes from end to end of the extent.
    """
    plane, end = indenter.symmetry == "plane", indenter.radius_at(height)
    angles, lengths = _rays(centre, extent, end, plane=plane)
    radii = lengths[:, None] * np.sin(np.linspace(0.0, math.pi / 2, _RADII))  # fine at the rim, where a ball is steep
    distance = np.abs(radii * np.cos(angles)[:, None]) if plane else radii
    x, y = centre[0] + radii * np.cos(angles)[:, None], centre[1] + radii * np.sin(angles)[:, None]
    # A distance that rounding has put beyond the rim has no height.
    bottom = tip + indenter.profile(np.minimum(distance, end))
    return _opened_solid(np.stack((x, y, bottom), axis=-1), np.stack((x, y, np.full_like(x, tip + height)), axis=-1))


def _rays(
    centre: tuple[float, float], extent: tuple[float, float, float, float], end: float, *, plane: bool
) -> tuple[FloatArray, FloatArray]:
    """Directions over three quarters, and lengths in m to `end`."""
    (x, y), (x_min, y_min, x_max, y_max) = centre, extent
    if not (x_min < x < x_max and y_min < y < y_max):
        raise ValueError(f"centre must be inside the extent {extent}; got {centre}.")
    if plane:
        x_min, x_max, end = max(x_min, x - end), min(x_max, x + end), math.inf
    corners = [math.atan2(v - y, u - x) for u, v in ((x_max, y_min), (x_max, y_max), (x_min, y_max))]
    angles = np.unique(np.r_[np.linspace(*_OPENED, _ANGLES), corners])
    cosine, sine = np.cos(angles), np.sin(angles)
    across = np.where(cosine > 0, x_max - x, x - x_min)
    along = np.where(sine > 0, y_max - y, y - y_min)
    with np.errstate(divide="ignore"):  # a ray along an axis never meets the sides parallel to it
        return angles, np.minimum(np.minimum(across / np.abs(cosine), along / np.abs(sine)), end)


def _displaced(
    angles: FloatArray, radii: FloatArray, centre: tuple[float, float], face: xr.Dataset, *, plane: bool
) -> FloatArray:
    """Displaced points of an interface in m, shape (angles, radii, 3)."""
    x, y = radii * np.cos(angles)[:, None], radii * np.sin(angles)[:, None]
    distance = np.abs(x) if plane else radii
    outwards, upwards = (
        np.interp(distance, face.r.values, face[name].values) for name in ("displacement_r", "displacement_z")
    )
    along = centre[0] + x + outwards * (np.sign(x) if plane else np.cos(angles)[:, None])
    across = centre[1] + y + (0.0 if plane else outwards * np.sin(angles)[:, None])
    return np.stack((along, across, float(face.height) + upwards), axis=-1)


def _opened_solid(bottom: FloatArray, top: FloatArray) -> pyvista.PolyData:
    """Close the solid between faces (angles, radii, 3) in m."""
    rays, circles = bottom.shape[:2]
    # Point [ray, circle] of a face. All rays begin at the same point on the axis.
    lower = np.arange(rays * circles).reshape(rays, circles)
    lower[:, 0] = lower[0, 0]
    upper = lower + rays * circles

    def strip(a: npt.NDArray[np.intp], b: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
        """Triangles between two rows of points."""
        quads = np.stack((a[:-1], a[1:], b[1:], b[:-1]), axis=-1)
        return np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))

    faces = [
        *(strip(upper[k], upper[k + 1]) for k in range(rays - 1)),
        *(strip(lower[k + 1], lower[k]) for k in range(rays - 1)),
        strip(lower[:, -1], upper[:, -1]),
        strip(lower[0], upper[0]),
        strip(upper[-1], lower[-1]),
    ]
    corners = np.concatenate(faces)
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a)]  # on the axis one side of a quad is a point
    used, numbers = np.unique(corners, return_inverse=True)
    points = np.concatenate((bottom.reshape(-1, 3), top.reshape(-1, 3)))[used]
    return triangles(points, numbers.reshape(corners.shape))
