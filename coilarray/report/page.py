"""HTML pages of sections, with the origin of each page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime

import jinja2

from coilarray.compute.table import Block, Group, Section, html_blocks, text_table


def html_page(
    heading: str,
    lead: Sequence[Block],
    sections: Sequence[Section],
    *,
    title: str = "",
    top: Sequence[Block] = (),
    scene: str | None = None,
    contents: bool = False,
) -> str:
    """Return a self-contained page.

    `lead` comes before the list of contents, `top` after it. `scene` is a page with a turnable
    board, in place of the first picture of `top`.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("coilarray.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html.j2").render(
        title=title or heading, heading=heading, lead=html_blocks(lead), top=html_blocks(top), scene=scene,
        sections=sections, contents=contents, blocks=html_blocks,
    )  # fmt: skip


def provenance_section(made: Mapping[str, object], *notes: str) -> Section:
    """Return the origin of a page as its last section."""
    names = {"design_hash": "design hash (SHA-256)", "coilarray_version": "coilarray"}
    rows = [(names.get(key, key.replace("_", " ")), str(value)) for key, value in made.items()]
    return Section("Provenance", (Group("text", (text_table(("made", "with"), rows),)), *notes))


def now() -> str:
    """Return the date and time in UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")
