"""Scene as VTK files for ParaView, with all arrays of every part."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

from coilarray.compute.files import hidden_prefix, make_folder, remove_left, writing
from coilarray.viz.datasets.meshes import VTK_SUFFIXES, vtk_text
from coilarray.viz.scenes.scene import Part, Scene

_UNSAFE = re.compile(r"[^0-9A-Za-z._-]+")


def save_vtk(scene: Scene, path: Path) -> tuple[Path, ...]:
    """Write a scene for ParaView, lengths in mm.

    Raises OutputError if the files cannot be written. Earlier files are kept.

    Parameters
    ----------
    scene : Scene
        Scene to write, with its arrays in SI units and without its colours.
    path : Path
        A name that ends in .vtm gives one multi-block file, with its blocks in the folder of this name beside it. Any
        other name is a folder that gets one file per part (.vtp, .vtu or .vtr).

    Returns
    -------
    tuple of Path
        Written files, which are the .vtm, or the files of the parts.
    """
    if path.suffix.lower() == ".vtm":
        files = [f"{path.stem}/{path.stem}_{k}{_suffix(part)}" for k, part in enumerate(scene.parts)]

        def write_blocks(folder: Path) -> None:
            (folder / path.stem).mkdir()
            _write(scene, files, folder)
            (folder / path.name).write_text(_index(scene, files), encoding="utf-8")

        return _placed(write_blocks, path.parent, [path.stem, path.name])
    make_folder(path)
    names = [_UNSAFE.sub("_", part.name) + _suffix(part) for part in scene.parts]
    if len(set(names)) < len(names):  # two layers whose names differ only in signs
        names = [f"{k:02d}_{name}" for k, name in enumerate(names)]
    return _placed(lambda folder: _write(scene, names, folder), path, names)


def _suffix(part: Part) -> str:
    return VTK_SUFFIXES[type(part.mesh).__name__]


def _write(scene: Scene, names: Sequence[str], folder: Path) -> None:
    for part, name in zip(scene.parts, names, strict=True):
        (folder / name).write_text(vtk_text(part.mesh), encoding="utf-8")


def _index(scene: Scene, files: Sequence[str]) -> str:
    """Text of a .vtm file, listing its blocks' files."""
    blocks = [
        f"<DataSet index={quoteattr(str(k))} name={quoteattr(part.name)} file={quoteattr(file)}/>\n"
        for k, (part, file) in enumerate(zip(scene.parts, files, strict=True))
    ]
    kind = "vtkMultiBlockDataSet"
    return f'<VTKFile type="{kind}" version="1.0">\n<{kind}>\n{"".join(blocks)}</{kind}>\n</VTKFile>\n'


def _placed(write: Callable[[Path], None], folder: Path, names: Sequence[str]) -> tuple[Path, ...]:
    """Fill a folder through a temporary folder, in the order of `names`."""
    with (
        writing(f"into {folder}"),
        tempfile.TemporaryDirectory(prefix=hidden_prefix("vtk"), dir=folder, ignore_cleanup_errors=True) as temporary,
    ):
        remove_left(folder)
        write(Path(temporary))
        for name in names:
            target = folder / name
            if target.is_dir():
                shutil.rmtree(target)
            Path(temporary, name).replace(target)
    return tuple(folder / name for name in names)
