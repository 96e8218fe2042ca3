"""Datasets for pictures: the model's solids, paths and fields as PyVista meshes, with no window and no colours.

Every coordinate of a dataset is in mm, because people read pictures of boards in mm; the values of its arrays stay in
SI and their names say the unit, as in ``"B (T)"``. PyVista is imported when the first dataset is made.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from coilarray.geometry.conductor import Conductor

if TYPE_CHECKING:
    import pyvista
    import trimesh

MM_PER_M = 1e3


def solid_mesh(solid: trimesh.Trimesh) -> pyvista.PolyData:
    """Return the surface of a solid in m as triangles in mm."""
    return _triangles(np.asarray(solid.vertices), np.asarray(solid.faces))


def copper_mesh(parts: Mapping[str, trimesh.Trimesh], names: Sequence[str], layer: str) -> pyvista.PolyData:
    """Return the surface of all the copper of one layer.

    Parameters
    ----------
    parts : mapping of str to trimesh.Trimesh
        From `coilarray.geometry.solids.solids`, in m; the keys ``"copper/<layer>/<coil>"`` are used.
    names : sequence of str
        Names of the coils in order.
    layer : str
        Name of the copper layer.

    Returns
    -------
    pyvista.PolyData
        In mm, with the cell array ``"coil"``: position in `names` of the coil that a triangle belongs to. Empty where
        the layer carries no copper.
    """
    return _merged([(parts.get(f"copper/{layer}/{name}"), index) for index, name in enumerate(names)])


def barrel_mesh(parts: Mapping[str, trimesh.Trimesh], names: Sequence[str]) -> pyvista.PolyData:
    """Return the surface of all barrels, in mm, with the cell array ``"coil"`` as in `copper_mesh`."""
    return _merged(
        [
            (solid, index)
            for index, name in enumerate(names)
            for key, solid in parts.items()
            if key.rpartition("/")[0] == f"barrel/{name}"
        ]
    )


def board_mesh(parts: Mapping[str, trimesh.Trimesh]) -> pyvista.PolyData:
    """Return the surface of the laminate in mm; empty where the stack-up has none."""
    import pyvista

    return solid_mesh(parts["board"]) if "board" in parts else pyvista.PolyData()


def sheet_meshes(
    parts: Mapping[str, trimesh.Trimesh], lift: float = 0.0, spread: float = 0.0
) -> dict[str, pyvista.PolyData]:
    """Return the surfaces of the elastomer sheets by name, in mm, the lowest first.

    Parameters
    ----------
    parts : mapping of str to trimesh.Trimesh
        As in `copper_mesh`; the keys ``"sheet/<name>"`` are used.
    lift : float
        For an exploded view: height in m by which the lowest sheet is raised above the board.
    spread : float
        Height in m by which every further sheet is raised above the one below it.
    """
    solids = {key.removeprefix("sheet/"): solid for key, solid in parts.items() if key.startswith("sheet/")}
    in_order = sorted(solids, key=lambda name: float(solids[name].bounds[0, 2]))
    return {
        name: solid_mesh(solids[name]).translate((0.0, 0.0, (lift + place * spread) * MM_PER_M))
        for place, name in enumerate(in_order)
    }


def path_lines(conductors: Sequence[Conductor]) -> pyvista.PolyData:
    """Draw current paths as one polyline a conductor.

    Returns
    -------
    pyvista.PolyData
        In mm, with the cell array ``"coil"``: position of the conductor.

    Examples
    --------
    >>> from coilarray.geometry import Conductor
    >>> lines = path_lines([Conductor([[0, 0, 0], [2e-3, 0, 0], [2e-3, 1e-3, 0]])])
    >>> lines.n_lines, lines.n_points
    (1, 3)
    """
    import pyvista

    counts = [len(conductor.vertices) for conductor in conductors]
    starts = np.cumsum([0, *counts])
    lines = [np.r_[count, start + np.arange(count)] for count, start in zip(counts, starts, strict=False)]
    mesh = pyvista.PolyData(
        np.vstack([conductor.vertices for conductor in conductors]) * MM_PER_M, lines=np.concatenate(lines)
    )
    mesh.cell_data["coil"] = np.arange(len(counts))
    return mesh


def field_grid(
    x: npt.ArrayLike, y: npt.ArrayLike, z: npt.ArrayLike, field: npt.ArrayLike, name: str = "B (T)"
) -> pyvista.RectilinearGrid:
    """Put vectors on a plane or in a box.

    Parameters
    ----------
    x, y, z : array_like, shapes (nx,), (ny,), (nz,)
        Ascending coordinates in m; one value makes a plane.
    field : array_like, shape (nx, ny, nz, 3)
        Vectors in the unit that `name` says.
    name : str
        Name of the array of points, with its unit.

    Returns
    -------
    pyvista.RectilinearGrid
        In mm, with the vectors as point array `name`.

    Raises
    ------
    ValueError
        Coordinates that do not ascend, or a field of another shape.

    Examples
    --------
    >>> field_grid([0, 1e-3], [0, 1e-3, 2e-3], [0], [[[[0, 0, 1e-6]]] * 3] * 2).dimensions
    (2, 3, 1)
    """
    import pyvista

    axes = [np.atleast_1d(np.asarray(axis, dtype=np.float64)) for axis in (x, y, z)]
    for letter, axis in zip("xyz", axes, strict=True):
        if axis.ndim != 1 or axis.size == 0 or not (np.diff(axis) > 0).all():
            raise ValueError(f"{letter} of a field grid must be one ascending row of numbers; got {axis}.")
    vectors = np.asarray(field, dtype=np.float64)
    shape = (*(axis.size for axis in axes), 3)
    if vectors.shape != shape:
        raise ValueError(f"field must have shape (nx, ny, nz, 3) = {shape}; got {vectors.shape}.")
    grid = pyvista.RectilinearGrid(*(axis * MM_PER_M for axis in axes))
    grid.point_data[name] = vectors.transpose(2, 1, 0, 3).reshape(-1, 3)  # VTK counts x fastest
    return grid


def _merged(solids: Sequence[tuple[trimesh.Trimesh | None, int]]) -> pyvista.PolyData:
    """Join into one surface in mm several solids in m, each triangle with the number given beside its solid."""
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
    mesh = _triangles(np.vstack(points), np.vstack(faces))
    mesh.cell_data["coil"] = np.concatenate(numbers)
    return mesh


def _triangles(points: npt.NDArray[np.float64], faces: npt.NDArray[np.integer]) -> pyvista.PolyData:
    """Triangles in mm from points in m, shape (n, 3), and their numbers, shape (m, 3)."""
    import pyvista

    return pyvista.PolyData(points * MM_PER_M, faces=np.insert(faces, 0, 3, axis=1).ravel())
