"""``coilarray init``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from coilarray.cli import shared
from coilarray.errors import DesignError, OutputError


def init(
    file: Annotated[Path, typer.Argument(help="File to write.")] = Path("design.toml"),
    copied: Annotated[str, typer.Option("--from", help="Bundled design to copy.")] = "starter",
    force: shared.Force = False,
) -> None:
    """Write a commented design file to start from.

    Example: coilarray init my_board.toml
    """
    from coilarray.compute.files import write_text
    from coilarray.design import bundled

    if copied not in bundled.names():
        raise DesignError(f"there is no bundled design {copied!r}; there are {', '.join(bundled.names())}.")
    if file.is_dir():
        raise OutputError(f"{file} is a folder; name a file in it.")
    if file.exists() and not force:
        raise OutputError(f"{file} exists; --force replaces it.")
    write_text(file, bundled.read(copied))
    typer.echo(f"wrote {file}; next: coilarray check {file}")
