"""Scene as VTK files for ParaView, with all arrays."""

from __future__ import annotations

import re
import shutil
import tempfile
from pathlib import Path
from xml.sax.saxutils import quoteattr

from coilarray.compute.files import hidden_prefix, remove_left, writing
from coilarray.errors import OutputError
from coilarray.viz.datasets.meshes import VTK_SUFFIXES, vtk_text
from coilarray.viz.scenes.scene import Scene

_UNSAFE = re.compile(r"[^0-9A-Za-z._-]+")


def save_vtk(scene: Scene, path: Path) -> tuple[Path, ...]:
    """Write a scene for ParaView, lengths in mm.

    Raises OutputError if the files cannot be written. Earlier files are kept then.

    Parameters
    ----------
    scene : Scene
        Scene to write, with its arrays in SI units and without its colours.
    path : Path
        Multi-block file, .vtm. The files of its parts (.vtp, .vtu or .vtr) are in the folder of
        this name beside it.

    Returns
    -------
    tuple of Path
        The folder and the file.
    """
    files = [
        f"{path.stem}/{k:02d}_{_UNSAFE.sub('_', part.name)}{VTK_SUFFIXES[type(part.mesh).__name__]}"
        for k, part in enumerate(scene.parts)
    ]
    blocks = [
        f"<DataSet index={quoteattr(str(k))} name={quoteattr(part.name)} file={quoteattr(file)}/>\n"
        for k, (part, file) in enumerate(zip(scene.parts, files, strict=True))
    ]
    kind = "vtkMultiBlockDataSet"
    index = f'<VTKFile type="{kind}" version="1.0">\n<{kind}>\n{"".join(blocks)}</{kind}>\n</VTKFile>\n'
    folder, placed = path.parent, (path.with_suffix(""), path)
    if placed[0].exists() and not path.exists():
        raise OutputError(f"cannot write {path}: there is a folder {placed[0]}, which is not of such a file.")
    with (
        writing(f"into {folder}"),
        tempfile.TemporaryDirectory(prefix=hidden_prefix("vtk"), dir=folder, ignore_cleanup_errors=True) as temporary,
    ):
        remove_left(folder)
        Path(temporary, path.stem).mkdir()
        for part, file in zip(scene.parts, files, strict=True):
            Path(temporary, file).write_text(vtk_text(part.mesh), encoding="utf-8")
        Path(temporary, path.name).write_text(index, encoding="utf-8")
        for target in placed:
            if target.is_dir():
                shutil.rmtree(target)
            Path(temporary, target.name).replace(target)
    return placed
