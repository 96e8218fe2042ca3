"""Boards of designs as files, which are checked for fabrication."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from coilarray.compute.files import hidden_prefix, make_folder, remove_left, writing
from coilarray.errors import OutputError, RuleViolationError

if TYPE_CHECKING:  # not loaded for the help of a command
    from coilarray.design.model import Board, Design, DesignFile
    from coilarray.geometry.array import Array

Format = Literal["kicad", "gerber", "dxf", "svg", "step", "stl", "glb"]  # format of an exported board
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
    net_faults: tuple[str, ...] = ()


def export(
    design: Design | DesignFile,
    path: str | Path,
    to: Format | None = None,
    *,
    sheets: bool = True,
    allow_faults: bool = False,
) -> Exported:
    """Write the boards of a design.

    Solids of several boards are one assembly, each board at its pose. Of the other formats every
    board has files of its own: folders in the folder of ``"kicad"``, or files with the name of the
    board at the end, as in ``link-receiver.zip``. All of them are written, or none.

    Parameters
    ----------
    design : Design or DesignFile
        Design of one or several boards.
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
        An unknown format or suffix, a file that cannot be written, or a format that cannot have a
        board: STEP a bent one, drawings and board houses a loop on a surface.
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
    from coilarray.design.boards import named_boards
    from coilarray.design.model import design_of

    design = design_of(design)
    if to is not None and to not in SUFFIXES:
        raise OutputError(f"to must be one of {', '.join(SUFFIXES)}; got {to!r}.")
    target = Path(path)
    kind = to or next((kind for kind, suffixes in SUFFIXES.items() if target.suffix.lower() in suffixes), None)
    if kind is None:
        *most, last = (suffix for suffixes in SUFFIXES.values() for suffix in suffixes if suffix)
        raise OutputError(f"cannot write {target}: the suffix must be {', '.join(most)} or {last}.")
    if kind in ("step", "stl", "glb"):
        from coilarray.fabrication.solid_files import PlacedArray, assembled, write_solids, write_step

        loops = len(design.placed) > len(named_boards(design))
        boards = [
            PlacedArray(
                board.array, board.design.sheets if sheets else (), board.pose, board.prefix,
                bool(board.name) or not loops,
            )
            for board in design.placed
        ]  # fmt: skip
        if kind == "step":
            write_step(boards, target, name=design.name)
        else:
            write_solids(assembled(boards), target)
        return Exported((target,))
    places = board_targets(design, target, kind)
    if len(places) == 1:
        return _write_board(design.placed[0], target, target, kind, allow_faults=allow_faults)
    faults: list[str] = []
    files: list[Path] = []
    with writing(target):
        folder = next(folder for folder in target.absolute().parents if folder.is_dir())
        remove_left(folder)
        with tempfile.TemporaryDirectory(prefix=hidden_prefix(target.name), dir=folder) as temporary:
            staged = Path(temporary)
            for board, place in zip(design.placed, places, strict=True):
                at = staged / place.relative_to(target.parent)
                at.parent.mkdir(parents=True, exist_ok=True)
                written = _write_board(board, at, place, kind, allow_faults=allow_faults)
                files += [target.parent / file.relative_to(staged) for file in written.files]
                faults += written.net_faults
            for file in files:
                if file.is_dir():
                    raise OutputError(f"cannot write {file}: a folder has that name.")
                make_folder(file.parent)
            for file in files:
                (staged / file.relative_to(target.parent)).replace(file)
    return Exported(tuple(files), tuple(faults))


def board_targets(design: Design, target: Path, to: Format) -> tuple[Path, ...]:
    """Return the file or folder of each board, or the one file of all solids.

    Loops of a surface, and boards whose files would have one name, raise an OutputError.
    """
    from coilarray.design.boards import named_boards

    if to in ("step", "stl", "glb") or len(design.placed) == 1:
        return (target,)
    if len(named_boards(design)) < len(design.placed):
        raise OutputError(
            f"cannot write {target}: {design.name} has loops on a surface, which go to stl, glb or, if flat, step."
        )
    names = [(board.name or "").replace("/", "-") for board in design.placed[1:]]
    own = design.name if to == "kicad" else ""
    if len({name.casefold() for name in (own, *names)}) <= len(names):
        raise OutputError(
            f"cannot write {target}: boards must have names that differ as files; got {', '.join(names)}."
        )
    if to == "kicad":
        return tuple(target / name for name in (own, *names))
    return (target, *(target.with_stem(f"{target.stem}-{name}") for name in names))


def _write_board(board: Board, path: Path, shown: Path, kind: Format, *, allow_faults: bool) -> Exported:
    """Write the fabrication files of one board, whose place is `shown` in messages."""
    from coilarray.fabrication.drawings import write_dxf, write_svg
    from coilarray.fabrication.gerber_writer import write_gerbers
    from coilarray.fabrication.kicad_writer import write_kicad

    design, faults = board.design, list[str]()
    array, title = design.array, design.title or design.name
    name = board.name.replace("/", "-") if board.name else design.name

    def check(made: Path) -> None:
        start = f"{board.name}: " if board.name else ""
        faults.extend(f"{start}{fault}" for fault in _net_faults(array, made, kind))
        if faults and not allow_faults:
            listed = "; ".join(faults)
            raise RuleViolationError(f"{shown} is not written, as its copper would not be that of the coils: {listed}.")

    files: tuple[Path, ...] = (path,)
    if kind == "kicad":
        files = write_kicad(array, path, name=name, rules=design.rules, title=title, check=check)
    elif kind == "gerber":
        write_gerbers(array, path, name=name, check=check)
    elif kind == "dxf":
        write_dxf(array, path)
    else:
        write_svg(array, path, title=title)
    return Exported(files, tuple(faults))


def _net_faults(array: Array, board: Path, to: Format) -> list[str]:
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
    known = {layer: shapes for layer, shapes in layers.items() if shapes or layer in array.stackup.names}
    return [fault.text for fault in check_nets(array, known, holes)[:_SHOWN_FAULTS]]
