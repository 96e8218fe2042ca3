"""``coilarray export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from coilarray.cli import shared
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

    kicad: a project with board and footprints. gerber: a zip of Gerber X2 and Excellon files for a
    board house. Both are read back and checked before they replace anything: every coil must be in
    one piece and isolated from the others. dxf, svg: drawings in mm. step, stl: solids in mm. glb:
    a scene for viewers.

    Example: coilarray export gast2020 --to gerber --out board.zip
    """
    from coilarray.design.export import export as write

    opened = shared.open_design(design, allow_violations=allow_violations)
    target = out or Path(
        {"kicad": f"{opened.name}-kicad", "gerber": f"{opened.name}-gerber.zip"}.get(to, f"{opened.name}.{to}")
    )
    if to != "kicad":
        shared.check_file("--out", target, SUFFIXES[to])
    elif target.suffix.startswith(".kicad"):
        raise OutputError(f"--out must be a folder, as kicad has several files; got {target}.")
    else:
        shared.check_folder(target)
    shared.require_new(target, force=force)
    exported = write(opened, target, to, sheets=not no_sheets, allow_faults=allow_violations)
    written, faults = exported.files, exported.net_faults
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


def _readable(size: int) -> str:
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.1f} kB"
