"""A page for every command, from its own help: what it does, an example, its options."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from coilarray.cli.main import GROUPS, program, summary

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_WIDE = 2000  # characters, so that the help of an option stands in one line
FOLDER = "reference/commands"


def _help_of(name: str) -> str:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        program(name)(
            [*name.split(), "--help-all"],
            prog_name="coilarray",
            standalone_mode=False,
            terminal_width=_WIDE,
            max_content_width=_WIDE,
        )
    return printed.getvalue()


def _sections(text: str) -> dict[str, list[str]]:
    """Lines of the help under their headings; the description under ""."""
    found: dict[str, list[str]] = {"": []}
    heading = ""
    for line in text.splitlines():
        if match := re.fullmatch(r"([A-Z]\w+):", line):
            heading = match[1]
            found[heading] = []
        elif line.startswith("Usage:"):
            found["Usage"] = [line.removeprefix("Usage:").strip()]
        else:
            found[heading].append(line.removeprefix("  "))
    return found


def table_row(cells: Iterable[str]) -> str:
    """Return a line of a table in Markdown."""
    return f"| {' | '.join(cell.replace('|', _PIPE) for cell in cells)} |"


_PIPE = "\\|"
_RANGE = re.compile(r"; (?:([\d.]+)&lt;=)?x(>|&lt;)=([\d.]+)\]")


def _option(name: str) -> str:
    """Return an option or argument with the kind of its value in words of the command line, not of Python."""
    return re.sub(r"<list\[(\w+)\]>", r"<\1>...", name).replace(" range>", ">")


def _range(text: str) -> str:
    """Return a meaning whose default is followed by what is allowed, in words."""

    def words(found: re.Match[str]) -> str:
        low, sign, high = found.groups()
        return f"; {low} to {high}]" if low else f"; {'at least' if sign == '>' else 'at most'} {high}]"

    return _RANGE.sub(words, text)


def _table(lines: list[str], first: str) -> list[str]:
    joined = re.sub(r"\n {4,}", "  ", "\n".join(lines))  # the help of a long option stands in a line of its own
    rows = [re.split(r"\s{2,}", line.strip(), maxsplit=1) for line in joined.splitlines() if line.strip()]
    table = [f"| {first} | meaning |", "| --- | --- |"]
    for name, *meaning in rows:
        cells = f"`` {_option(name)} ``", _range(_prose(" ".join(meaning)))
        table.append(table_row(cells))
    return [":::{div} stacked", *table, ":::", ""]


_TYPED = re.compile(
    r"(?<![\w-])--\w[\w-]*(?:=[^\s;)]*[^\s;,.:)])?"
    r"|(?<![^\s(])(?:[\w.]+=|/dev/|(?:i2c|ftdi|usb|grbl|marlin):)[^\s;)]*(?:\.\.\.|[^\s;,.:)])"
)


def _prose(text: str) -> str:
    """Return a line of the help in Markdown; options, ports and values of keys are set as code."""
    pieces = re.split(r"(`+[^`]*`+)", text.replace("<", "&lt;"))  # what is code already stands at odd places
    pieces[::2] = [_TYPED.sub(r"`\g<0>`", piece) for piece in pieces[::2]]
    return "".join(pieces)


def _paragraphs(parts: dict[str, list[str]]) -> list[str]:
    """Paragraphs of a description, each in one line."""
    return [text.replace("\n", " ").strip() for text in "\n".join(parts[""]).strip().split("\n\n")]


def examples(name: str) -> list[str]:
    """Return the command lines that the help of a command shows."""
    texts = _paragraphs(_sections(_help_of(name)))
    return [text.removeprefix("Example: ") for text in texts if text.startswith("Example: ")]


def page(name: str) -> str:
    """Return the page of a command in Markdown."""
    parts = _sections(_help_of(name))
    lines = [f"# coilarray {name}", "", "```text", parts["Usage"][0], "```", ""]
    for text in _paragraphs(parts):
        if text and not text.startswith("Example: "):
            lines += [_prose(text), ""]
    if typed := examples(name):
        lines += ["```sh", *typed, "```", ""]
    for heading, first in (("Arguments", "argument"), ("Options", "option")):
        if heading in parts:
            lines += [f"## {heading}", "", *_table(parts[heading], first)]
    return "\n".join(lines)


def _write(app: Sphinx) -> None:
    folder = Path(app.srcdir) / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["# Commands", "", "Every command has `--help`; lengths are in the units that their names say.", ""]
    for group, commands in GROUPS.items():
        lines += [f"## {group}", "", "| command | what it does |", "| --- | --- |"]
        files = {name: name.replace(" ", "_") for name in commands}
        lines += [f"| [{name}]({file}.md) | {summary(name)} |" for name, file in files.items()]
        lines += ["", "```{toctree}", ":hidden:", *files.values(), "```", ""]
        for name, file in files.items():
            write_page(folder / f"{file}.md", page(name))
    write_page(folder / "index.md", "\n".join(lines))


def write_page(path: Path, text: str) -> None:
    """Write a page where it changed, so that Sphinx reads only those again."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before Sphinx looks for them."""
    app.connect("builder-inited", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
