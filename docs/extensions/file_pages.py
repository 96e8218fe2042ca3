"""Pages of every key of every TOML file, from the tables that read them: unit, allowed values, default, meaning."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from command_pages import table_row, write_page

from coilarray.design.keys import REQUIRED, Key, Section, sections_of

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_FOLDER = "reference/files"
FILES = (
    (
        "design", "coilarray.design.tables", "Document", "Design file",
        "Describes a board, what lies on it and how it is read out. `coilarray init` writes one with comments, "
        "`coilarray check` reads and checks one.",
    ),
    (
        "goal", "coilarray.studies.optimize.goal", "Goal", "Goal of an optimisation",
        "What `coilarray optimize` may change and what it makes better. `coilarray optimize --template` writes one.",
    ),
    (
        "tolerance", "coilarray.studies.tolerance.tolerances", "_File", "Manufacturing tolerances",
        "Errors of a fabricator, for `coilarray tolerance`; the bundled file of typical ones is its default.",
    ),
    (
        "calibration_plan", "coilarray.studies.calibrate.plan", "Plan", "Plan of a calibration",
        "What `coilarray calibrate` fits to a measurement.",
    ),
    (
        "wiring", "coilarray.hardware.scan.wiring", "_File", "Wiring of a board",
        "Which switch joins which end of which coil to what, for `coilarray board test`, `measure` and `live`.",
    ),
    (
        "board_settings", "coilarray.cli.board.files", "BoardSettings", "Settings of a board",
        "What rarely changes of a board, for the option `--settings` of `coilarray board test`, `measure` and `live`.",
    ),
    (
        "campaign_plan", "coilarray.cli.board.files", "CampaignPlan", "Plan of a campaign",
        "Grid, sequence and stage, for the option `--plan` of `coilarray board campaign`.",
    ),
    (
        "board_calibration", "coilarray.hardware.record.calibration", "BoardCalibration", "Calibration of a board",
        "Constants of one board, which `coilarray board calibrate` finds in a recording.",
    ),
)  # fmt: skip


_PLAIN = re.compile(r'"[^"]*"|\btrue or false\b')


def _row(key: Key) -> str:
    default = f"`{key.default}`" if key.default not in ("", REQUIRED) else key.default
    allowed = _PLAIN.sub(lambda found: f"`{found[0]}`".replace(" or ", "` or `"), key.allowed)
    cells = (f"`{key.name}`", key.unit, allowed, default, key.meaning)
    return table_row(cells)


def _lines(section: Section) -> Iterator[str]:
    """Lines of a table, none without keys."""
    if not section.keys:
        return
    title = (inspect.getdoc(section.table) or "").split("\n\n")[0].replace("\n", " ")
    if section.holder and not section.table.__doc__:  # one class for several keys says nothing of them
        title = f"``[{section.path}]``: {section.holder[0].lower()}{section.holder[1:]} {title}"
    path = section.path or "Top of the file"
    heading = f"{path}: {', '.join(section.kinds)}" if section.kinds else path
    yield from ("", f"## {heading}", "", *([title, ""] if section.path else []))
    lines = ("| key | unit | allowed | default | meaning |", "| --- | --- | --- | --- | --- |")
    yield from (":::{div} stacked", *lines, *map(_row, section.keys), ":::")


def page(module: str, name: str, title: str, words: str) -> str:
    """Return the page of a kind of file in Markdown."""
    table = getattr(importlib.import_module(module), name)
    lines = [line for section in sections_of(table) for line in _lines(section)]
    return "\n".join([f"# {title}", "", words, *lines, ""])


def _write(app: Sphinx) -> None:
    folder = Path(app.srcdir) / _FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for name, *what in FILES:
        write_page(folder / f"{name}.md", page(*what))
    lines = [
        "# Files",
        "",
        "All are TOML; a key's last part is its unit, and numbers of a key without one are counts or ratios. A mistake "
        "is one line that names the key.",
        "",
    ]
    lines += ["```{toctree}", *(name for name, *_ in FILES), "```", ""]
    write_page(folder / "index.md", "\n".join(lines))


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before Sphinx looks for them."""
    app.connect("builder-inited", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
