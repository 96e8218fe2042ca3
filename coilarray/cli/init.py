"""``coilarray init``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from coilarray.errors import DesignError, OutputError


def init(
    file: Annotated[Path, typer.Argument(help="File to write.")] = Path("design.toml"),
    bundled: Annotated[str, typer.Option("--from", help="Bundled design to copy.")] = "starter",
    force: Annotated[bool, typer.Option("--force", help="Replace a file that exists.")] = False,
) -> None:
    """Write a commented design file to start from.

    Example: coilarray init my_board.toml
    """
    from coilarray import designs
    from coilarray.files import write_text

    if bundled not in designs.names():
        raise DesignError(f"there is no bundled design {bundled!r}; there are {', '.join(designs.names())}.")
    if file.is_dir():
        raise OutputError(f"{file} is a folder; name a file in it.")
    if file.exists() and not force:
        raise OutputError(f"{file} exists; --force replaces it.")
    write_text(file, designs.read(bundled))
    typer.echo(f"wrote {file}; next: coilarray check {file}")
