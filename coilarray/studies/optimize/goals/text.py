"""Goal as the text of a goal file, with a comment beside everything that was derived from the design."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from coilarray.studies.optimize.goal import Goal

_TABLES = ("variable", "objective", "constraint")


def goal_text(goal: Goal, comments: Mapping[str, str], head: str) -> str:
    """Write a goal as the text of a goal file.

    `coilarray.studies.optimize.goal.parse_goal` reads it back. `comments` has a line for each table by its place, such
    as "variable.0". `head` are the lines at the top.
    """
    document = goal.model_dump(mode="json", by_alias=True, exclude_unset=True)
    lines = [*(f"# {line}".rstrip() for line in head.splitlines()), ""]
    lines += [f"{key} = {_value(value)}" for key, value in document.items() if key not in (*_TABLES, "search")]
    for table in _TABLES:
        for k, entries in enumerate(document.get(table, [])):
            lines += ["", f"[[{table}]]"]
            if f"{table}.{k}" in comments:
                lines.append(f"# {comments[f'{table}.{k}']}")
            lines += _entries(entries)
    lines += ["", "[search]", *_entries(document.get("search", {}))]
    return "\n".join(lines) + "\n"


def _entries(table: Mapping[str, Any]) -> list[str]:
    ordered = sorted(table, key=lambda key: key != "quantity")  # the quantity of a bound comes first
    return [f"{key} = {_value(table[key])}" for key in ordered if table[key] is not None]


def _value(value: Any) -> str:
    """Return a plain value as TOML.

    Inner lists have one line each.
    """
    if isinstance(value, list) and any(isinstance(part, list) for part in value):
        return "[\n" + "".join(f"    {json.dumps(part, ensure_ascii=False)},\n" for part in value) + "]"
    return json.dumps(value, ensure_ascii=False)
