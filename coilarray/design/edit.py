"""Changes in TOML texts that keep comments, order and layout."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from difflib import SequenceMatcher
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Array

from coilarray.design.write import document_text


def edited_text(text: str, document: Mapping[str, Any]) -> str | None:
    r"""Return the text of a TOML file changed to `document`.

    Items of a list are identified by their name, or content. New entries are added at the end of
    their table. The result is None if the change needs a new text.

    >>> text = "# mine\n[board]\nmargin_mm = 2.0  # as wide as the seal\n"
    >>> print(edited_text(text, {"board": {"margin_mm": 3.5}}), end="")
    # mine
    [board]
    margin_mm = 3.5  # as wide as the seal
    """
    if not text:
        return None
    try:
        file = tomlkit.parse(text)
        _edit(file, tomllib.loads(text), document)
        found = tomlkit.dumps(file)
        return found if tomllib.loads(found) == document else None
    except (TOMLKitError, tomllib.TOMLDecodeError):  # a layout that tomlkit cannot change
        return None


def _edit(table: Any, old: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Change a table of the file from `old` to `wanted`."""
    for key in [key for key in old if key not in wanted]:
        del table[key]
    for key, value in wanted.items():
        if key not in old:
            table[key] = _item(value)
        elif _is_other(old[key], value):
            if isinstance(old[key], Mapping) and isinstance(value, Mapping):
                _edit(table[key], old[key], value)
            elif isinstance(table[key], AoT) and value and all(isinstance(item, Mapping) for item in value):
                _edit_tables(table[key], old[key], value)
            elif isinstance(old[key], list) and isinstance(value, list) and old[key] and value:
                _edit_list(table[key], old[key], value)
            else:
                table[key] = _item(value)


def _edit_tables(tables: AoT, old: Sequence[Mapping[str, Any]], wanted: Sequence[Mapping[str, Any]]) -> None:
    """Change a list of tables, with comments of kept tables."""
    before, after, there = list(map(_known_by, old)), list(map(_known_by, wanted)), list(tables)
    found = []
    for k, (name, item) in enumerate(zip(after, wanted, strict=True)):
        renamed = len(old) == len(wanted) and before[k] not in after
        at = before.index(name) if name in before else k if renamed else None
        if at is None:
            found.append(_item(item))
        else:
            _edit(there[at], old[at], item)
            found.append(there[at])
    del tables[:]
    for table in found:
        tables.append(table)


def _edit_list(items: Array, old: Sequence[Any], wanted: Sequence[Any]) -> None:
    """Change a list, with comments of kept items."""
    before, after = list(map(_known_by, old)), list(map(_known_by, wanted))
    for _, first, end, start, stop in SequenceMatcher(None, before, after, autojunk=False).get_opcodes()[::-1]:
        both = min(end - first, stop - start)
        for k in range(both):
            was, value = old[first + k], wanted[start + k]
            if isinstance(was, Mapping) and isinstance(value, Mapping):
                _edit(items[first + k], was, value)
            elif isinstance(was, list) and isinstance(value, list) and was and value:
                _edit_list(items[first + k], was, value)
            elif _is_other(was, value):
                items[first + k] = _item(value)
        del items[first + both : end]
        for k in range(both, stop - start):
            items.insert(first + k, _item(wanted[start + k]))


def _known_by(item: Any) -> str:
    """Return the name of a table, or an item's text."""
    return str(item["name"]) if isinstance(item, Mapping) and "name" in item else repr(item)


def _is_other(before: Any, after: Any) -> bool:
    """Check whether a value has changed.

    23.0 is 23, but 1 is not true.
    """
    return bool(before != after) or isinstance(before, bool) != isinstance(after, bool)


def _item(value: Any) -> Any:
    """Return a new value in the layout of package files."""
    return tomlkit.parse(document_text({"k": value}))["k"]
