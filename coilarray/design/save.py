"""Designs as commented files.

The comments come from the file, else from the bundled ``starter``.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from pathlib import Path

from coilarray.compute.files import write_text
from coilarray.design import bundled
from coilarray.design.edit import edited_text
from coilarray.design.model import Design, DesignFile
from coilarray.design.write import design_text, document_text

_COMMENTED = "starter"
_WIDTH, _LONGEST_LINE = 34, 120
_HEADER = re.compile(r"\[\[?([^\]]+)\]\]?\s*(?:#\s*(.*))?$")
_ENTRY = re.compile(r"""(?:#\s)?([\w"'.]+)\s*=\s*(?:"[^"]*"|[^"#])*(?:#\s*(.*))?$""")


def save_design(design: Design | DesignFile, path: str | Path) -> None:
    """Write a design as a commented TOML file.

    Parameters
    ----------
    design : Design or DesignFile
        A file keeps its keys, its comments and its layout. For a design made in Python all keys are written, with the
        comments that the bundled ``starter`` has for them.
    path : str or Path
        File to write. An existing file is replaced.

    Raises
    ------
    OutputError
        A file that cannot be written.
    """
    write_text(Path(path), file_text(design) if isinstance(design, DesignFile) else with_comments(design_text(design)))


def file_text(file: DesignFile) -> str:
    """Return the text of a design file from its document.

    It is as close as possible to the original text.
    """
    return edited_text(file.text, file.document) or with_comments(document_text(file.document))


def keeps_comments(file: DesignFile) -> bool:
    """Check whether `file_text` keeps the comments of the file.

    The comments belong to the original text, if it has any.
    """
    return "#" not in file.text or edited_text(file.text, file.document) is not None


def with_comments(text: str) -> str:
    r"""Return the text of a design file with comments.

    A comment is added behind every key and above every table that `starter` explains. Lines that would get too long
    stay as they are, and so do keys in a table that has no keys in `starter`.

    Examples
    --------
    >>> print(with_comments("[board]\nmargin_mm = 2.0\n"), end="")
    [board]
    margin_mm = 2.0                   # from the outermost copper to the edge
    """
    tables, keys = _explained()
    lines, before = [], ""
    for line, table, key in _read(text):
        above, behind = tables.get(table, ("", "")) if table != before else ("", "")
        before = table
        comment = keys.get((table, key), "") if key is not None else behind
        commented = f"{line:{_WIDTH - 1}} # {comment}"
        lines += [above] if above else []
        lines.append(commented if comment and len(commented) <= _LONGEST_LINE else line)
    return "\n".join(lines) + "\n"


@functools.cache
def _explained() -> tuple[dict[str, tuple[str, str]], dict[tuple[str, str], str]]:
    """Return the comments of ``starter`` for tables and keys.

    They are above and behind the headers of tables, and behind their keys. Tables and keys that are commented out count
    as well.
    """
    tables: dict[str, tuple[str, str]] = {}
    keys: dict[tuple[str, str], str] = {}
    above: list[str] = []
    for line, table, key in _read(bundled.read(_COMMENTED)):
        if key is not None and (found := _ENTRY.match(line)) and found[2]:
            keys.setdefault((table, key), found[2])
        elif line.startswith("[") and (found := _HEADER.match(line)):
            tables.setdefault(table, ("\n".join(above), found[2] or ""))
        above = [*above, line] if line.startswith("# ") and key is None else []
    return tables, keys


def _read(text: str) -> Iterator[tuple[str, str, str | None]]:
    """Yield every line with its table and key.

    Coil shapes have the table ``*``. The key is None for a line without a key.
    """
    table = ""
    for line in text.splitlines():
        found = _HEADER.match(line.removeprefix("# "))  # a table that is commented out counts too
        if found:
            parts = found[1].split(".")
            table = ".".join([parts[0], "*", *parts[2:]]) if parts[0] == "coils" else found[1]
            yield line, table, None
            continue
        entry = _ENTRY.match(line)
        yield line, table, entry[1].strip("\"'") if entry else None
