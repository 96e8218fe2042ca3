"""``coilarray export``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from coilarray.cli import shared
from coilarray.errors import OutputError, RuleViolationError

if TYPE_CHECKING:
    from collections.abc import Callable

    from coilarray.design.model import Design

Format = Literal["kicad", "gerber", "dxf", "svg", "step", "stl", "glb"]
# what a name given by the user must end in; KiCad's files lie in a folder
_SUFFIXES: dict[str, tuple[str, ...]] = {
    "gerber": (".zip",),
    "dxf": (".dxf",),
    "svg": (".svg",),
    "step": (".step", ".stp"),
    "stl": (".stl",),
    "glb": (".glb",),
}


def export(
    design: shared.DesignArgument = None,
    *,
    to: Annotated[Format, typer.Option("--to", help="Format to write.")],
    out: Annotated[
        Path | None, shared.out_option("File to write, for kicad a folder; named after the design by default.")
    ] = None,
    no_sheets: Annotated[
        bool, typer.Option("--no-sheets", help="Leave the elastomer out of step, stl and glb.")
    ] = False,
    force: shared.Force = False,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Write a board for fabrication or for another program.

    kicad: a project with board and footprints. gerber: a zip of Gerber X2 and Excellon files for a board house. Both
    are read back before they replace anything, and every coil must be in one piece and apart from the others. dxf, svg:
    drawings in mm. step, stl: solids in mm. glb: a scene for viewers.

    Example: coilarray export gast2020 --to gerber --out board.zip
    """
    if out is not None:
        _check(out, to, force=force)
    opened = shared.open_design(design, allow_violations=allow_violations)
    target = Path(_default_name(opened.name, to)) if out is None else out
    if out is None:
        _check(target, to, force=force)
    faults: list[str] = []

    def check(board: Path) -> None:
        faults.extend(_net_faults(opened, board, to))
        if faults and not allow_violations:
            listed = "; ".join(faults)
            raise RuleViolationError(f"{target} is not written: its copper is not that of the coils: {listed}.")

    written = _write(opened, target, to, check, with_sheets=not no_sheets)
    sizes = [path.stat().st_size for path in written]
    lines = [f"wrote {path} ({_readable(size)})" for path, size in zip(written, sizes, strict=True)]
    lines += [f"warning: {fault}" for fault in faults]
    if to in ("kicad", "gerber") and not faults:
        lines.append(f"net check of the copper as written: {len(opened.array.names)} coils, each whole and by itself")
    files = [{"path": str(path), "bytes": size} for path, size in zip(written, sizes, strict=True)]
    shared.print_result(
        {**shared.design_record(opened), "format": to, "files": files, "net_faults": faults},
        as_json=as_json,
        lines=lines,
    )


def _default_name(name: str, to: Format) -> str:
    if to == "kicad":
        return f"{name}-kicad"
    return f"{name}-gerber.zip" if to == "gerber" else f"{name}.{to}"


def _check(target: Path, to: Format, *, force: bool) -> None:
    """Refuse before any work what could not be written after it.

    Raises
    ------
    OutputError
        A name that does not fit the format, a folder that is missing or cannot be written, or something of that name
        without --force.
    """
    try:
        if to == "kicad":
            _check_project_folder(target)
        else:
            shared.check_file("--out", target, _SUFFIXES[to])
        folder = target if target.is_dir() else target.parent
        if not os.access(folder, os.W_OK | os.X_OK):
            raise OutputError(f"cannot write {target}: nothing may be written in the folder {folder}.")
        occupied = any(target.iterdir()) if target.is_dir() else target.exists()
    except OSError as error:
        raise OutputError(f"cannot write {target}: {error.strerror}.") from None
    if occupied and not force:
        raise OutputError(f"{target} exists; --force replaces {'the files in it' if to == 'kicad' else 'it'}.")


def _check_project_folder(target: Path) -> None:
    if target.suffix.startswith(".kicad"):
        raise OutputError(f"--out must be a folder, in which kicad has several files; got {target}.")
    if target.exists() and not target.is_dir():
        raise OutputError(f"cannot write {target}: a file has that name, and kicad needs a folder.")
    if not target.parent.is_dir():
        raise OutputError(f"cannot write {target}: there is no folder {target.parent}.")


def _write(
    opened: Design, target: Path, to: Format, check: Callable[[Path], None], *, with_sheets: bool
) -> tuple[Path, ...]:
    """Write one format and return the files that it made; `check` sees a board before it is in its place."""
    array, sheets = opened.array, opened.sheets if with_sheets else ()
    if to == "kicad":
        from coilarray.geometry.export.kicad import write_kicad

        return write_kicad(
            array, target, name=opened.name, rules=opened.rules, title=opened.title or opened.name, check=check
        )
    if to == "gerber":
        from coilarray.geometry.export.gerber import write_gerbers

        write_gerbers(array, target, name=opened.name, check=check)
    elif to == "dxf":
        from coilarray.geometry.export.dxf import write_dxf

        write_dxf(array, target)
    elif to == "svg":
        from coilarray.geometry.export.svg import write_svg

        write_svg(array, target, title=opened.title or opened.name)
    elif to == "step":
        from coilarray.geometry.export.step import write_step

        write_step(array, target, name=opened.name, sheets=sheets)
    else:
        from coilarray.geometry.export.solid_files import write_solids
        from coilarray.geometry.solids import solids

        write_solids(solids(array, sheets), target)
    return (target,)


def _net_faults(opened: Design, board: Path, to: Format) -> list[str]:
    """Read a board back: coils that are cut or touch, foreign copper, wrong nets; at most the first three."""
    from coilarray.geometry.connectivity import board_layers, check_names, check_nets

    if to == "kicad":
        from coilarray.geometry.readers.kicad_board import read_kicad

        copper = read_kicad(board)
    else:
        from coilarray.geometry.readers.gerber_board import read_gerbers

        copper = read_gerbers(board)
    layers, holes = board_layers(copper)
    # KiCad gives a board of one copper layer an empty back
    known = {layer: shapes for layer, shapes in layers.items() if shapes or layer in opened.array.stackup.names}
    found = check_nets(opened.array, known, holes).faults or check_names(opened.array, copper)
    return [fault.text for fault in found[:3]]


def _readable(size: int) -> str:
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.1f} kB"
