"""Copper, barrels, laminate and current paths of a board."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from coilarray.geometry.conductor import Conductor
from coilarray.viz.datasets.triangles import merged, polylines, solid_mesh

if TYPE_CHECKING:
    import pyvista
    import trimesh


def copper_mesh(parts: Mapping[str, trimesh.Trimesh], names: Sequence[str], layer: str) -> pyvista.PolyData:
    """Surface of the copper of one layer in mm.

    Parameters
    ----------
    parts : mapping of str to trimesh.Trimesh
        Solids in m from `coilarray.geometry.solids.solids`. The keys ``"copper/<layer>/<coil>"`` are used.
    names : sequence of str
        Names of the coils in order.
    layer : str
        Name of the copper layer.

    Returns
    -------
    pyvista.PolyData
        Surface in mm. The cell array ``"coil"`` is the index in `names` of the coil of each triangle. Empty if the
        layer has no copper.
    """
    return merged([(parts.get(f"copper/{layer}/{name}"), index) for index, name in enumerate(names)])


def barrel_mesh(parts: Mapping[str, trimesh.Trimesh], names: Sequence[str]) -> pyvista.PolyData:
    """Surface of all barrels in mm.

    It has the cell array ``"coil"`` as in `copper_mesh`. `parts` and `names` are the same as there. The keys
    ``"barrel/..."`` are used.

    Returns
    -------
    pyvista.PolyData
        Surface in mm.
    """
    return merged(
        [
            (solid, index)
            for index, name in enumerate(names)
            for key, solid in parts.items()
            if key.rpartition("/")[0] == f"barrel/{name}"
        ]
    )


def board_mesh(parts: Mapping[str, trimesh.Trimesh]) -> pyvista.PolyData:
    """Surface of the laminate of a board in mm.

    The laminate is one of the `parts`. If the stack-up has no laminate, the surface is empty.

    Returns
    -------
    pyvista.PolyData
        Surface in mm.
    """
    from coilarray.viz.extra_3d import pyvista

    return solid_mesh(parts["board"]) if "board" in parts else pyvista.PolyData()


def path_lines(conductors: Sequence[Conductor]) -> pyvista.PolyData:
    """Paths of `conductors` in mm as polylines.

    Each polyline has its index in the cell array ``"coil"``.

    Returns
    -------
    pyvista.PolyData
        Polylines in mm.

    Examples
    --------
    >>> from coilarray.geometry import Conductor
    >>> lines = path_lines([Conductor([[0, 0, 0], [2e-3, 0, 0], [2e-3, 1e-3, 0]])])
    >>> lines.n_lines, lines.n_points
    (1, 3)
    """
    mesh = polylines([conductor.vertices for conductor in conductors])
    mesh.cell_data["coil"] = np.arange(len(conductors))
    return mesh


def with_coil_values(mesh: pyvista.DataSet, values: npt.ArrayLike, name: str) -> pyvista.DataSet:
    """Copy a mesh and add values of the coils.

    The mesh has the cell array ``"coil"``. The copy has the value of its coil in every cell as the array `name`.
    `values`, shape (coils,), are in the unit in `name`, with NaN for a coil without a value. An empty mesh stays empty.
    """
    result: pyvista.DataSet = mesh.copy()
    if mesh.n_cells:
        result.cell_data[name] = np.asarray(values, dtype=np.float64)[mesh.cell_data["coil"]]
    return result
