"""``coilarray export``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from coilarray.cli import shared
from coilarray.cli.shared import remember, require_own
from coilarray.compute.files import remove_left
from coilarray.design.export import SUFFIXES, Format
from coilarray.errors import OutputError


def export(
    design: shared.DesignArgument = None,
    *,
    to: Annotated[Format, typer.Option("--to", help="Format to write.")],
    out: Annotated[
        Path | None, shared.out_option("File to write (a folder for kicad); named after the design by default.")
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
    are read back and checked before they replace anything: every coil must be in one piece and isolated from the
    others. dxf, svg: drawings in mm. step, stl: solids in mm. glb: a scene for viewers.

    Example: coilarray export gast2020 --to gerber --out board.zip
    """
    from coilarray.design.export import export as write

    if out is not None:
        _check(out, to, force=force)
    opened = shared.open_design(design, allow_violations=allow_violations)
    target = Path(_default_name(opened.name, to)) if out is None else out
    if out is None:
        _check(target, to, force=force)
    exported = write(opened, target, to, sheets=not no_sheets, allow_faults=allow_violations)
    written, faults = exported.files, exported.net_faults
    remember("export", written)
    sizes = [path.stat().st_size for path in written]
    lines = [f"wrote {path} ({_readable(size)})" for path, size in zip(written, sizes, strict=True)]
    lines += [f"warning: {fault}" for fault in faults]
    if to in ("kicad", "gerber") and not faults:
        count = len(opened.array.names)
        coils = "1 coil, in one piece" if count == 1 else f"{count} coils, each in one piece and isolated"
        lines.append(f"check of the copper as written: {coils}")
    files = [{"path": str(path), "bytes": size} for path, size in zip(written, sizes, strict=True)]
    shared.print_result(
        {**shared.design_record(opened), "format": to, "files": files, "net_faults": list(faults)},
        as_json=as_json,
        lines=lines,
    )


def _default_name(name: str, to: Format) -> str:
    if to == "kicad":
        return f"{name}-kicad"
    return f"{name}-gerber.zip" if to == "gerber" else f"{name}.{to}"


def _check(target: Path, to: Format, *, force: bool) -> None:
    """Refuse before any work a target that could not be written."""
    try:
        if to == "kicad":
            _check_project_folder(target)
        else:
            shared.check_file("--out", target, SUFFIXES[to])
        folder = target if target.is_dir() else target.parent
        if not os.access(folder, os.W_OK | os.X_OK):
            raise OutputError(f"cannot write {target}: the folder {folder} is not writable.")
        remove_left(folder)
        require_own("export", [target, *target.rglob("*")], force=force)
    except OSError as error:
        raise OutputError(f"cannot write {target}: {error.strerror}.") from None


def _check_project_folder(target: Path) -> None:
    if target.suffix.startswith(".kicad"):
        raise OutputError(f"--out must be a folder, as kicad has several files; got {target}.")
    if target.exists() and not target.is_dir():
        raise OutputError(f"cannot write {target}: a file has that name, and kicad needs a folder.")
    if not target.parent.is_dir():
        raise OutputError(f"cannot write {target}: there is no folder {target.parent}.")


def _readable(size: int) -> str:
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.1f} kB"
