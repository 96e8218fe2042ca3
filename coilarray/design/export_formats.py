"""Names of the export formats of a board. The module loads nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

Format = Literal["kicad", "gerber", "dxf", "svg", "step", "stl", "glb"]
"""Format of an exported board."""

SUFFIXES: Mapping[Format, tuple[str, ...]] = {
    "kicad": ("",), "gerber": (".zip",), "dxf": (".dxf",), "svg": (".svg",), "step": (".step", ".stp"),
    "stl": (".stl",), "glb": (".glb",),
}  # fmt: skip
"""Suffixes of the files of each format. KiCad's files lie in a folder, whose name has no suffix."""
