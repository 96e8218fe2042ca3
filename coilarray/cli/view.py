"""``coilarray view``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from coilarray.cli.shared import AllowViolations, DesignArgument, open_design
from coilarray.errors import OutputError


def view(
    design: DesignArgument = None,
    screenshot: Annotated[
        Path | None, typer.Option("--screenshot", help="Write a picture (.png) and open no window.")
    ] = None,
    no_sheets: Annotated[bool, typer.Option("--no-sheets", help="Leave the elastomer out.")] = False,
    allow_violations: AllowViolations = False,
) -> None:
    """Show the board in three dimensions.

    In a window, or as a picture with --screenshot.

    Example: coilarray view gast2020 --screenshot board.png
    """
    if screenshot is not None and screenshot.suffix.lower() != ".png":
        raise OutputError(f"--screenshot must end in .png; got {screenshot}.")
    from coilarray.viz import save_board_picture, show_board

    opened = open_design(design, allow_violations=allow_violations)
    sheets = () if no_sheets else opened.sheets
    if screenshot is None:
        show_board(opened.array, sheets)
        return
    save_board_picture(opened.array, screenshot, sheets)
    typer.echo(f"wrote {screenshot}")
