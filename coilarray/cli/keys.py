"""``coilarray keys``."""

from __future__ import annotations

import difflib
from typing import Annotated

import typer

from coilarray.cli import shared
from coilarray.errors import DesignError


def keys(
    word: Annotated[
        str | None, typer.Argument(metavar="WORD", help="Only keys that have this word in their name or meaning.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the keys as JSON, and nothing else.")] = False,
) -> None:
    """List the keys of a design file and what they mean.

    NAME stands for a name of yours, and N for a number from 0: coils.hexagon.gap_mm,
    elastomer.0.thickness_mm. So a key is given to sweep, optimize and tolerance too. In brackets
    are the shapes or lattices that have it.

    Example: coilarray keys

    Example: coilarray keys trace_width
    """
    from coilarray.compute.table import text_table
    from coilarray.design.keys import keys_of
    from coilarray.design.tables import Document

    known = keys_of(Document)
    found = [key for key in known if word is None or word.lower() in f"{key.dotted} {key.meaning}".lower()]
    if not found:
        close = difflib.get_close_matches(str(word), {key.name for key in known}, n=1)
        hint = f"; did you mean {close[0]}?" if close else "; `coilarray keys` lists all."
        raise DesignError(f"no key of a design file has {word!r} in its name or meaning{hint}")
    if as_json:
        columns = ("kinds", "unit", "allowed", "default", "meaning")
        shared.print_json([{"key": key.dotted, **{name: getattr(key, name) for name in columns}} for key in found])
        return
    rows = [
        (
            f"{key.dotted} ({', '.join(key.kinds)})" if key.kinds else key.dotted,
            key.unit,
            key.allowed,
            key.default,
            key.meaning,
        )
        for key in found
    ]
    table = text_table(("key", "unit", "allowed", "default", "meaning"), rows)
    typer.echo(table.text(shared.terminal_width()))
