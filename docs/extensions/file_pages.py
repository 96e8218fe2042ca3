"""Pages of every key of every TOML file, from the tables that read them: unit, allowed values, default, meaning."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import types
import typing
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from command_pages import write_page
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from coilarray.design.units import Table, entry_unit

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
        "board_calibration", "coilarray.hardware.record.calibration_file", "_File", "Calibration of a board",
        "Constants of one board, which `coilarray board calibrate` finds in a recording.",
    ),
)  # fmt: skip


@cache
def _meanings(table: type[Table]) -> dict[str, str]:
    """Texts beneath the fields of a table's class."""
    (node,) = ast.parse(inspect.getsource(table)).body
    assert isinstance(node, ast.ClassDef)
    found = {}
    for statement, following in zip(node.body, [*node.body[1:], None], strict=True):
        match statement, following:
            case ast.AnnAssign(target=ast.Name(id=key)), ast.Expr(value=ast.Constant(value=str(text))):
                found[key] = " ".join(text.split())
    return found


def _meaning(table: type[Table], key: str) -> str:
    return next((_meanings(base)[key] for base in table.__mro__ if _is_table(base) and key in _meanings(base)), "")


def _is_table(kind: object) -> bool:
    return isinstance(kind, type) and issubclass(kind, Table) and kind is not Table


def _parts(annotation: Any) -> tuple[Any, ...]:
    return typing.get_args(annotation)


def _tables(annotation: Any) -> Iterator[type[Table]]:
    """Every table that an annotation may hold."""
    if _is_table(annotation):
        yield annotation
    for part in _parts(annotation):
        yield from _tables(part)


def _number(bound: Any) -> str:
    """Return a bound with all its digits, thousands apart, and a minus sign."""
    whole = float(bound).is_integer()
    return (f"{int(bound):,}".replace(",", "\u202f") if whole else f"{bound:g}").replace("-", "−")


def _bounds(metadata: tuple[Any, ...] | list[Any]) -> str:
    ends = [rule for rule in metadata if isinstance(rule, Ge | Le)]
    match ends:
        case [Ge(ge=low), Le(le=high)]:
            return f"always {low}" if low == high else f"{_number(low)} to {_number(high)}"
    match [rule for rule in metadata if isinstance(rule, MinLen | MaxLen)]:
        case [MinLen(min_length=least), MaxLen(max_length=most)] if least == most:
            return f"{most} of them"
    words = []
    for rule in metadata:
        match rule:
            case Ge(ge=bound):
                words.append(f"at least {_number(bound)}")
            case Gt(gt=bound):
                words.append(f"above {_number(bound)}")
            case Le(le=bound):
                words.append(f"at most {_number(bound)}")
            case Lt(lt=bound):
                words.append(f"below {_number(bound)}")
            case MinLen(min_length=count) if count > 1:
                words.append(f"at least {count} of them")
            case MaxLen(max_length=count):
                words.append(f"at most {count} of them")
            case FieldInfo(metadata=inner):
                words.append(_bounds(inner))
    return ", ".join(word for word in words if word)


_WORDS = {float: "number", int: "whole number", str: "text", bool: "`true` or `false`"}


def _allowed(annotation: Any) -> str:
    """Return what an annotation allows, in words."""
    origin = typing.get_origin(annotation)
    if origin is typing.Annotated:
        base, *metadata = _parts(annotation)
        words, bounds = _allowed(base), _bounds(metadata).replace("of them", "characters" if base is str else "of them")
        return f"{words}, {bounds}" if bounds else words
    if origin is typing.Literal:
        return ", ".join(f'`"{value}"`' for value in _parts(annotation))
    if origin in (typing.Union, types.UnionType):
        return ", or ".join(dict.fromkeys(_allowed(part) for part in _parts(annotation) if part is not type(None)))
    if origin is list:
        return f"list: {_allowed(_parts(annotation)[0])}"
    if origin is dict:
        return f"table: {_allowed(_parts(annotation)[1])} by name"
    return _WORDS.get(annotation, "any value")


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "none, required"
    value = field.default_factory() if field.default_factory is not None else field.default  # type: ignore[call-arg]
    if value in (None, PydanticUndefined) or value == [] or value == {}:
        return ""
    return f"`{_toml(value)}`"


def _toml(value: Any) -> str:
    """Return a value as it would stand in a file."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return f"{value:g}" if isinstance(value, float) else json.dumps(value, ensure_ascii=False)


def _rows(table: type[Table]) -> list[str]:
    rows = []
    for name, field in table.model_fields.items():
        if any(_tables(field.annotation)):
            continue
        key, unit = field.alias or name, entry_unit(field.alias or name)
        allowed = _allowed(
            typing.Annotated[(field.annotation, *field.metadata)] if field.metadata else field.annotation
        )
        cells = (f"`{key}`", "" if unit == "1" else unit, allowed, _default(field), _meaning(table, name))
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return rows


def _heading(table: type[Table], path: str) -> str:
    """Return the path of a table, with its shape or kind where that decides which keys it has."""
    kinds = [
        str(value)
        for key in ("shape", "lattice")
        if key in table.model_fields and typing.get_origin(table.model_fields[key].annotation) is typing.Literal
        for value in _parts(table.model_fields[key].annotation)
    ]
    if not path:
        return "Top of the file"
    return f"{path}: {', '.join(kinds)}" if kinds else path


def _sections(table: type[Table], path: str, seen: set[tuple[type[Table], str]], holder: str = "") -> Iterator[str]:
    """Yield the lines of a table and of the tables within it; `holder` is the meaning of the key that holds it."""
    if (table, path) in seen:
        return
    seen.add((table, path))
    if rows := _rows(table):
        title = (inspect.getdoc(table) or "").split("\n\n")[0].replace("\n", " ")
        if holder and not table.__doc__:  # one class for several keys says nothing of them
            title = f"``[{path}]``: {holder[0].lower()}{holder[1:]} {title}"
        yield from ("", f"## {_heading(table, path)}", "", *([title, ""] if path else []))
        lines = ("| key | unit | allowed | default | meaning |", "| --- | --- | --- | --- | --- |", *rows)
        yield from (":::{div} stacked", *lines, ":::")
    for name, field in table.model_fields.items():
        for inner in _tables(field.annotation):
            key = f"{path}.{field.alias or name}".removeprefix(".")
            if "dict" in str(typing.get_origin(field.annotation)):
                key += ".NAME"
            yield from _sections(inner, key, seen, _meaning(table, name))


def page(module: str, name: str, title: str, words: str) -> str:
    """Return the page of a kind of file in Markdown."""
    table = getattr(importlib.import_module(module), name)
    return "\n".join([f"# {title}", "", words, *_sections(table, "", set()), ""])


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
