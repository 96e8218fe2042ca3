"""A scene as files of VTK, which ParaView opens: every part with all its arrays."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from coilarray.compute.files import make_folder
from coilarray.errors import OutputError
from coilarray.viz.scenes.scene import Scene

_UNSAFE = re.compile(r"[^0-9A-Za-z._-]+")


def save_vtk(scene: Scene, path: Path) -> tuple[Path, ...]:
    """Write a scene for ParaView, lengths in mm.

    Parameters
    ----------
    scene : Scene
        Scene to write, with its arrays in SI units and without its colours.
    path : Path
        A name that ends in .vtm gives one multi-block file, with its blocks in the folder of that name beside it. Any
        other name is a folder that gets one file per part (.vtp, .vtu or .vtr).

    Returns
    -------
    tuple of Path
        Written files: the .vtm, or those of the parts.

    Raises
    ------
    OutputError
        If the files cannot be written; earlier files are kept.
    """
    import pyvista

    if path.suffix.lower() == ".vtm":
        blocks = pyvista.MultiBlock({part.name: part.mesh for part in scene.parts})
        return _placed(lambda folder: blocks.save(folder / path.name), path.parent, [path.stem, path.name])
    make_folder(path)
    suffixes = {"PolyData": ".vtp", "RectilinearGrid": ".vtr", "UnstructuredGrid": ".vtu"}
    names = {part.name: _UNSAFE.sub("_", part.name) + suffixes[type(part.mesh).__name__] for part in scene.parts}
    if len(set(names.values())) < len(names):  # two layers whose names differ in signs alone
        names = {part: f"{k:02d}_{name}" for k, (part, name) in enumerate(names.items())}

    def write(folder: Path) -> None:
        for part in scene.parts:
            part.mesh.save(folder / names[part.name])

    return _placed(write, path, list(names.values()))


def _placed(write: Callable[[Path], None], folder: Path, names: Sequence[str]) -> tuple[Path, ...]:
    """Let `write` fill a temporary folder, then move what it made into `folder`, in the order of `names`."""
    try:
        temporary = Path(tempfile.mkdtemp(prefix=".vtk-", dir=folder))
    except OSError as error:
        raise OutputError(f"cannot write into {folder}: {error.strerror}.") from None
    try:
        write(temporary)
        for name in names:
            target = folder / name
            if target.is_dir():
                shutil.rmtree(target)
            (temporary / name).replace(target)
    except OSError as error:
        raise OutputError(f"cannot write into {folder}: {error.strerror or error}.") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return tuple(folder / name for name in names)
