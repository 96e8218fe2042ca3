"""HTML for reports and notebooks: tables, and the display of values in notebooks."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape

_MANY_COLUMNS = 13  # from which a page prints them smaller
# notebooks set all cells to the right
_STYLE = "<style>.coilarray th, .coilarray td { text-align: left; } .coilarray img { max-width: 100%; }</style>"


def html_table(headers: Sequence[str], rows: Iterable[Sequence[str]], mark: str | None = None) -> str:
    """Return a table as HTML, with all text escaped.

    `headers` may be empty. Rows with a cell of the text `mark` get the class ``mark``.
    """
    many = ' class="many"' if len(headers) > _MANY_COLUMNS else ""
    head = f"\n<thead><tr>{_cells('th', headers)}</tr></thead>" if headers else ""
    body = [(' class="mark"' if mark is not None and mark in row else "", _cells("td", row)) for row in rows]
    lines = "".join(f"<tr{kind}>{cells}</tr>\n" for kind, cells in body)
    return f"<table{many}>{head}\n<tbody>\n{lines}</tbody></table>"


def html_card(title: str, *parts: str) -> str:
    """Return the display of a value in a notebook: a title and parts as HTML."""
    return f'<div class="coilarray">{_STYLE}<strong>{escape(title)}</strong>{"".join(parts)}</div>'


def png_url(png: bytes) -> str:
    """Return a PNG file as a data URL."""
    return f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"


def _cells(tag: str, texts: Sequence[str]) -> str:
    return "".join(f"<{tag}>{escape(text)}</{tag}>" for text in texts)
