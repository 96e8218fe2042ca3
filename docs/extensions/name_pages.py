"""A page for every public name, in groups, from the docstrings."""

from __future__ import annotations

import importlib
import inspect
import itertools
import re
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from command_pages import write_page

import coilarray
from coilarray.geometry import MATERIAL_SOURCES, MATERIALS

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_DOCS = Path(__file__).parents[1]
_FOLDER = "reference/python"
# module of a name, its beginning → group
_GROUPS: Mapping[str, str] = {
    "coilarray.errors": "Errors",
    "coilarray.design": "Designs",
    "coilarray.geometry": "Geometry",
    "coilarray.electromagnetics": "Fields and inductance",
    "coilarray.circuit": "Circuit",
    "coilarray.elastomer": "Response",
    "coilarray.response": "Response",
    "coilarray.localize": "Position",
    "coilarray.studies": "Studies and report",
    "coilarray.report": "Studies and report",
    "coilarray.compute": "Errors",
}
_ORDER = tuple(dict.fromkeys([*list(_GROUPS.values())[1:], "Errors"]))
_ROOMS = {"coilarray.viz": "Pictures", "coilarray.hardware": "Boards"}
_BEYOND = "Beyond the top level"
_BEYOND_ROW = re.compile(r"^\| `(coilarray\.[\w.]+)\.(\w+)`((?:, `\w+`)*) \|", re.MULTILINE)


def _names() -> dict[str, list[str]]:
    """Full names of everything public by group."""
    groups: dict[str, list[str]] = {group: [] for group in (*_ORDER, *_ROOMS.values(), _BEYOND)}
    for name in coilarray.__all__:
        value = getattr(coilarray, name)
        module = getattr(value, "__module__", "coilarray.geometry")
        group = next((words for start, words in _GROUPS.items() if module.startswith(start)), "Geometry")
        groups[group].append(f"coilarray.{name}")
    for room, group in _ROOMS.items():
        groups[group] += [f"{room}.{name}" for name in importlib.import_module(room).__all__]
    for module, first, others in _BEYOND_ROW.findall((_DOCS / "helpers.md").read_text(encoding="utf-8")):
        groups[_BEYOND] += [f"{module}.{name}" for name in (first, *re.findall(r"\w+", others))]
    return groups


def returning() -> Iterator[tuple[str, bool, str, str]]:
    """Yield name, whether a property, return annotation and docstring of everything public that returns something."""
    for full in itertools.chain(*_names().values()):
        value = _value(full)
        members = {full: value} if callable(value) else {}
        if inspect.isclass(value):
            members = {f"{full}.{name}": one for name, one in vars(value).items() if not name.startswith("_")}
        for name, one in members.items():
            is_property = isinstance(one, property | cached_property)
            code = one.fget if isinstance(one, property) else getattr(one, "func", getattr(one, "__func__", one))
            if inspect.isfunction(code := inspect.unwrap(code)):
                annotation = str(inspect.signature(code).return_annotation)
                if annotation not in ("None", "NoReturn"):
                    yield name, is_property, annotation, inspect.getdoc(code) or ""


def _value(full: str) -> object:
    module, _, name = full.rpartition(".")
    return getattr(importlib.import_module(module), name)


_MATERIALS = "Mapping of materials by their names in files, at 20 °C where nothing else is said."


def _materials() -> list[str]:
    lines = [
        ".. py:data:: coilarray.MATERIALS",
        "",
        f"   {_MATERIALS}",
        "",
        ".. list-table::",
        "   :header-rows: 1",
        "",
    ]
    rows = [("name", "conductivity (MS/m)", "µr", "grade, source and what is assumed")]
    for name, one in MATERIALS.items():
        conductivity, mu = f"{one.conductivity / 1e6:.4g}", f"{one.relative_permeability:g}"
        rows.append((f"``{name}``", conductivity, mu, MATERIAL_SOURCES[name]))
    return lines + [f"   {'  -' if column else '* -'} {cell}" for row in rows for column, cell in enumerate(row)]


def _page(full: str) -> str:
    value = _value(full)
    kind = "autoclass" if inspect.isclass(value) else "autofunction"
    lines = [full, "=" * len(full), "", *([f".. {kind}:: {full}"] if callable(value) else _materials())]
    if inspect.isclass(value) and not issubclass(value, BaseException):
        lines.append("   :members:")
    return "\n".join([*lines, ""])


def _first_line(full: str) -> str:
    value = _value(full)
    text = inspect.getdoc(value) if callable(value) else _MATERIALS
    return (text or "").split("\n\n")[0].replace("\n", " ")


def _write(app: Sphinx) -> None:
    folder = Path(app.srcdir) / _FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    words = "``import coilarray as ca`` offers all but the last three groups. Everything takes and returns SI units."
    lines = ["Python", "======", "", words, ""]
    for group, names in _names().items():
        lines += [group, "-" * len(group), "", ".. list-table::", "   :widths: 30 70", ""]
        links = {full: f"{full.removeprefix('coilarray.')} <{full}>" for full in sorted(names)}
        for full, link in links.items():
            write_page(folder / f"{full}.rst", _page(full))
            lines += [f"   * - :doc:`{link}`", f"     - {_first_line(full)}"]
        lines += ["", ".. toctree::", "   :hidden:", "", *(f"   {link}" for link in links.values()), ""]
    write_page(folder / "index.rst", "\n".join(lines))


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before Sphinx looks for them."""
    app.connect("builder-inited", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
