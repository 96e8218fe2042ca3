"""One page of all commands, each with its example, of the keys of a design file, and of the first Python functions."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from command_pages import examples, table_row, write_page

from coilarray.cli.main import GROUPS, summary
from coilarray.design.keys import sections_of
from coilarray.design.tables import Document

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_PAGE = "made/cheat_sheet.md"
_PYTHON = (
    ("ca.Spiral(sides=6, diameter=16e-3, turns=12, width=0.15e-3, gap=0.15e-3, layers=2)", "a coil"),
    ("ca.Array.row(coil, 3, pitch=11e-3)", "a row of coils"),
    ('ca.new_design("pad", "4x4", size=12e-3).design', "a design that can be made"),
    ("ca.load_design(file)", "a design file"),
    ("coil.inductance, coil.resistance, array.coupling", "numbers of a coil and of an array"),
    ("array.field(points, currents), ca.magnetic_field(paths, points)", "flux density in T"),
    ("ca.inductance_matrix(paths), ca.couple_design(design)", "L, M and k"),
    ("array.plot(), array.show()", "pictures"),
)


def _keys() -> Iterator[tuple[str, str]]:
    """Name of every table of a design file, and its keys, each once."""
    found: dict[str, dict[str, None]] = {}
    for section in sections_of(Document):
        name = section.path or "top of the file"
        found.setdefault(re.sub(r"\.N(?=\.|$)", "", name), {}).update(dict.fromkeys(key.name for key in section.keys))
    for name, keys in found.items():
        yield f"`{name}`", ", ".join(f"`{key}`" for key in keys)


def _table(first: str, second: str, rows: Iterator[tuple[str, str]]) -> list[str]:
    return [table_row((first, second)), "| --- | --- |", *map(table_row, rows), ""]


def page() -> str:
    """Return the page in Markdown."""
    commands = (
        (summary(name).removesuffix("."), f"`` {examples(name)[0]} ``") for names in GROUPS.values() for name in names
    )
    python = ((meaning, f"`` {code} ``") for code, meaning in _PYTHON)
    lines = [
        "# Cheat sheet",
        "",
        "Every command has `--help`, and `coilarray keys WORD` explains a key of a design file.",
        "",
    ]
    lines += [":::{div} cheat", "## Commands", "", *_table("to", "type", commands)]
    lines += ["## Design files", "", *_table("table", "keys", _keys())]
    lines += [
        "## Python",
        "",
        "All values are in SI units. The package is imported as `ca`.",
        "",
        *_table("for", "type", python),
        ":::",
    ]
    return "\n".join(lines)


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the page before Sphinx looks for it."""
    app.connect("builder-inited", lambda app: write_page(Path(app.srcdir) / _PAGE, page()))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
