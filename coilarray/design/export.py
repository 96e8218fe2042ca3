"""Boards of designs as files, which are checked for fabrication."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from coilarray.errors import OutputError, RuleViolationError

if TYPE_CHECKING:  # not loaded for the help of a command
    from coilarray.design.model import Design, DesignFile

Format = Literal["kicad", "gerber", "dxf", "svg", "step", "stl", "glb"]
"""Format of an exported board."""

SUFFIXES: Mapping[Format, tuple[str, ...]] = {
    "kicad": ("",),
    "gerber": (".zip",),
    "dxf": (".dxf",),
    "svg": (".svg",),
    "step": (".step", ".stp"),
    "stl": (".stl",),
    "glb": (".glb",),
}
"""Suffixes of the files of each format. KiCad's files lie in a folder, whose name has no suffix."""

_SHOWN_FAULTS = 3


@dataclass(frozen=True)
class Exported:
    """Written `files`, and up to three `net_faults` in their copper."""

    files: tuple[Path, ...]
    net_faults: tuple[str, ...]


def export(
    design: Design | DesignFile,
    path: str | Path,
    to: Format | None = None,
    *,
    sheets: bool = True,
    allow_faults: bool = False,
) -> Exported:
    """Write the board of a design.

    Parameters
    ----------
    design : Design or DesignFile
        Design of the board.
    path : str or Path
        File to write, or folder for ``"kicad"``. An existing file is replaced, whole or not at all,
        as are the files of the project in a folder.
    to : {"kicad", "gerber", "dxf", "svg", "step", "stl", "glb"}, optional
        Format. By default it follows from the suffix, and is ``"kicad"`` for a name without a
        suffix.
    sheets : bool
        Include the elastomer sheets in ``"step"``, ``"stl"`` and ``"glb"``.
    allow_faults : bool
        Write a board even if its copper, read back, differs from its coils.

    Returns
    -------
    Exported
        The files that were written, and the faults found by reading them back.

    Raises
    ------
    OutputError
        An unknown format or suffix, or a file that cannot be written.
    RuleViolationError
        A coil that is cut or touches another in KiCad or Gerber files, read back.
    MissingDependencyError
        A library that the format needs is not installed.

    Examples
    --------
    >>> from coilarray import load_design
    >>> export(load_design("starter"), "board.txt")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    coilarray.errors.OutputError: cannot write board.txt: the suffix must be .zip, .dxf, .svg, .step, .stp, .stl or ...
    """
    from coilarray.design.model import design_of

    design = design_of(design)
    if to is not None and to not in SUFFIXES:
        raise OutputError(f"to must be one of {', '.join(SUFFIXES)}; got {to!r}.")
    target = Path(path)
    kind = to or next((kind for kind, suffixes in SUFFIXES.items() if target.suffix.lower() in suffixes), None)
    if kind is None:
        *most, last = (suffix for suffixes in SUFFIXES.values() for suffix in suffixes if suffix)
        raise OutputError(f"cannot write {target}: the suffix must be {', '.join(most)} or {last}.")
    faults: list[str] = []

    def check(board: Path) -> None:
        """Read the board back and refuse its faults."""
        faults.extend(_net_faults(design, board, kind))
        if faults and not allow_faults:
            listed = "; ".join(faults)
            raise RuleViolationError(
                f"{target} is not written, as its copper would not be that of the coils: {listed}."
            )

    array, covering, title = design.array, design.sheets if sheets else (), design.title or design.name
    files: tuple[Path, ...] = (target,)
    if kind == "kicad":
        from coilarray.fabrication.kicad_writer import write_kicad

        files = write_kicad(array, target, name=design.name, rules=design.rules, title=title, check=check)
    elif kind == "gerber":
        from coilarray.fabrication.gerber_writer import write_gerbers

        write_gerbers(array, target, name=design.name, check=check)
    elif kind == "dxf":
        from coilarray.fabrication.drawings import write_dxf

        write_dxf(array, target)
    elif kind == "svg":
        from coilarray.fabrication.drawings import write_svg

        write_svg(array, target, title=title)
    elif kind == "step":
        from coilarray.fabrication.solid_files import write_step

        write_step(array, target, name=design.name, sheets=covering)
    else:
        from coilarray.fabrication.solid_files import write_solids
        from coilarray.geometry.copper import solids

        write_solids(solids(array, covering), target)
    return Exported(files, tuple(faults))


def _net_faults(design: Design, board: Path, to: Format) -> list[str]:
    """Return the first three faults of a board, read back."""
    from coilarray.fabrication.nets import board_layers, check_nets

    if to == "kicad":
        from coilarray.fabrication.kicad_reader import read_kicad

        copper = read_kicad(board)
    else:
        from coilarray.fabrication.gerber_reader import read_gerbers

        copper = read_gerbers(board)
    layers, holes = board_layers(copper)
    # KiCad gives a board of one copper layer an empty back.
    known = {layer: shapes for layer, shapes in layers.items() if shapes or layer in design.array.stackup.names}
    return [fault.text for fault in check_nets(design.array, known, holes)[:_SHOWN_FAULTS]]
