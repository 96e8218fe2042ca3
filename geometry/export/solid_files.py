"""Solids as files: STL and PLY in millimetres for slicers, GLB in metres for viewers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from coilarray.compute.files import write_atomically
from coilarray.errors import OutputError

if TYPE_CHECKING:
    import trimesh

_MM = 1e3
# red, green, blue, opacity of each kind of solid, the first part of its key
_COLOURS = {
    "copper": (200, 117, 51, 255),
    "barrel": (184, 134, 72, 255),
    "board": (24, 92, 52, 160),
    "sheet": (110, 110, 118, 90),
}
_OTHER = (160, 160, 160, 255)
# glTF's up is y: (x, y, z) becomes (x, z, −y)
_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def write_solids(solids: Mapping[str, trimesh.Trimesh], path: Path) -> None:
    """Write solids to one file, the format by its suffix.

    Parameters
    ----------
    solids : mapping of str to trimesh.Trimesh
        As `coilarray.geometry.solids` gives them, in m.
    path : Path
        ``.stl`` and ``.ply``: all solids in one mesh, in mm, as slicers expect. ``.glb``: a scene of named and
        coloured nodes, in m and with y up, as glTF demands.

    Raises
    ------
    OutputError
        Another suffix, no solids, or a file that cannot be written.
    """
    import trimesh  # slow to import

    suffix = path.suffix.lower()
    if suffix not in (".stl", ".ply", ".glb"):
        raise OutputError(f"cannot write {path}: the suffix must be .stl, .ply or .glb; got {path.suffix!r}.")
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

    def write(temporary: Path) -> None:
        temporary.write_bytes(data)

    write_atomically(path, write)


def _scene(solids: Mapping[str, trimesh.Trimesh]) -> Any:
    import trimesh

    scene: Any = trimesh.Scene()
    for name, solid in solids.items():
        mesh = solid.copy()
        colour = np.array(_COLOURS.get(name.split("/")[0], _OTHER), dtype=np.uint8)
        mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=np.tile(colour, (len(mesh.vertices), 1)))
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    scene.apply_transform(_Y_UP)
    return scene
