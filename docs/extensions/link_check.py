"""Check of the finished pages: every link leads to a file and a place in it, and nothing is loaded from a network."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

from sphinx.errors import ExtensionError

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_TAG = re.compile(r"<(\w+)\s([^>]*)>")
_ATTRIBUTE = re.compile(r'\b(href|src|id|name|rel)="([^"]*)"')
_LOADED = ("icon", "stylesheet", "preload")  # relations of <link>
_NOT_READ = ("_static", "_sources", "_downloads")


def _tags(page: Path) -> list[tuple[str, dict[str, str]]]:
    text = page.read_text(encoding="utf-8")
    return [(tag, dict(_ATTRIBUTE.findall(attributes))) for tag, attributes in _TAG.findall(text)]


def _file(folder: Path, path: str) -> Path | None:
    """Return the file that a link in a page of a folder leads to; None where there is none."""
    found = (folder / unquote(path)).resolve()
    return found if found.exists() else None


def faults(folder: Path) -> Iterator[str]:
    """Yield a line for everything in built pages that does not work in a browser without a network."""
    pages = [page for page in sorted(folder.rglob("*.html")) if page.relative_to(folder).parts[0] not in _NOT_READ]
    tags = {page.resolve(): _tags(page) for page in pages}
    places = {page: {given[key] for _, given in tags[page] for key in ("id", "name") if key in given} for page in tags}
    file_at = cache(_file)  # the menu is on every page
    for page, found in tags.items():
        for tag, given in found:
            target = given.get("href") or given.get("src")
            if not target:
                continue
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                outside = parts.scheme != "data" and (tag != "link" or given.get("rel") in _LOADED)
                if tag != "a" and outside:
                    yield f"{page.relative_to(folder.resolve())} loads {target}"
                continue
            file = file_at(page.parent, parts.path) if parts.path else page
            if file is None:
                yield f"{page.relative_to(folder.resolve())} links to {target}, which is missing"
            elif parts.fragment and file in places and unquote(parts.fragment) not in places[file]:
                yield f"{page.relative_to(folder.resolve())} links to {target}, where there is no such place"


def _check(app: Sphinx, exception: Exception | None) -> None:
    if exception is None and app.builder.name == "html" and (found := list(dict.fromkeys(faults(Path(app.outdir))))):
        raise ExtensionError("\n".join([f"{len(found)} links of the pages do not work without a network:", *found]))


def setup(app: Sphinx) -> dict[str, bool]:
    """Check when the pages are written."""
    app.connect("build-finished", _check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
