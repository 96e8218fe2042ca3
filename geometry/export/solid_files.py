"""Solids as files: STL and PLY in millimetres for slicers, GLB in metres for viewers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from coilarray.compute.files import require_suffix, write_bytes
from coilarray.errors import OutputError

if TYPE_CHECKING:
    import trimesh

_MM = 1e3
COLOURS = {
    "copper": (200, 117, 51, 255),
    "barrel": (184, 134, 72, 255),
    "board": (24, 92, 52, 160),
    "sheet": (110, 110, 118, 90),
}
"""Red, green, blue and opacity, up to 255, of each kind of solid, by the first part of its key."""
_OTHER = (160, 160, 160, 255)
# glTF's up is y: (x, y, z) becomes (x, z, −y)
_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def write_solids(solids: Mapping[str, trimesh.Trimesh], path: Path) -> None:
    """Write solids to one file.

    The suffix determines the format.

    Parameters
    ----------
    solids : mapping of str to trimesh.Trimesh
        Solids in m, as made by `coilarray.geometry.solids`.
    path : Path
        File name. ``.stl`` and ``.ply`` hold all solids in one mesh, in mm, as slicers expect. ``.glb`` holds a scene
        of named and coloured nodes, in m and with y up, as glTF demands.

    Raises
    ------
    OutputError
        If the suffix is different, there are no solids, or the file cannot be written.
    """
    import trimesh  # slow to import

    suffix = path.suffix.lower()
    require_suffix(path, ".stl", ".ply", ".glb")
    if not solids:
        raise OutputError(f"cannot write {path}: there are no solids.")
    if suffix == ".glb":
        data = _scene(solids).export(file_type="glb")
    else:
        merged: Any = trimesh.util.concatenate(
            [mesh.copy() for mesh in solids.values()]
        )  # trimesh is typed in part only
        merged.vertices *= _MM
        data = merged.export(file_type=suffix[1:])
    write_bytes(path, data)


def _scene(solids: Mapping[str, trimesh.Trimesh]) -> Any:
    """Make a scene of coloured solids.

    The solids are named, and y is up.
    """
    import trimesh

    scene: Any = trimesh.Scene()
    for name, solid in solids.items():
        mesh = solid.copy()
        colour = np.array(COLOURS.get(name.split("/")[0], _OTHER), dtype=np.uint8)
        mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=np.tile(colour, (len(mesh.vertices), 1)))
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    scene.apply_transform(_Y_UP)
    return scene
