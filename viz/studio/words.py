"""Quantities, entries and limits of runs in words, and numbers before and after a change."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from coilarray.compute.display_units import DisplayUnit, number_text, value_text
from coilarray.compute.table import Table, Value
from coilarray.design.keys import entry_unit, key_in_si
from coilarray.design.model import Design
from coilarray.studies.quantities import QUANTITIES
from coilarray.viz.studio.view import plan_of
from coilarray.viz.studio.work import SYMBOLS, Work

MOST_SHOWN = 200  # largest number of rows of a table
NO_PREVIEW: Mapping[str, Any] = {"rows": [], "plan": None, "name": "", "trigger": "", "point": ""}
"""State of the page without a design to compare with."""

NO_ROWS: Mapping[str, Any] = {"head": [], "rows": []}
"""State of the page without a table of `with_changes`."""

_EQUAL = 1e-9  # relative difference that is rounding
_FOUR = DisplayUnit(digits=4, significant=True)
_WORDS = {  # quantities whose names say less than these words
    "span_mm": "extent of the coils along x", "covered_mm2": "area covered by coils",
    "fab_margin_mm": "tightest margin of the board house", "fab_broken": "broken limits of the board house",
    "rms_k": "root mean square of k", "worst_k": "largest |k| of two coils", "q": "quality factor",
    "srf_margin": "self-resonance over frequency", "drive_margin": "margin of the converter's drive",
    "converter_unread": "values that no LDC1614 can read", "peak_delta": "peak of δ",
    "x0_distortion_mm": "distortion of x0", "position_error_mm": "standard deviation of x",
    "depth_error_mm": "standard deviation of the depth", "target_delta": "δ of the target",
    "target_deviation_um": "standard deviation of a distance", "target_q": "quality factor beside the target",
}  # fmt: skip


def words(name: str) -> str:
    """Name of a quantity or of an entry in words, without its unit.

    >>> words("array.pitch_mm"), words("worst_k"), words("k[coil1,coil2]")
    ('pitch', 'largest |k| of two coils', 'k of coil1 and coil2')
    >>> words("|effective_inductance_uH[coil2] − 18|"), words("coils.hexagon.turns_per_layer")
    ('effective inductance of coil2 less 18', 'turns per layer of hexagon')
    """
    bare = quantity_of(name)
    base, _, options = bare.partition("[")
    parts = options.rstrip("]").split(",") if options else []
    if base in QUANTITIES:
        text = _WORDS.get(base) or key_in_si(base)[0].removesuffix("_mm2").replace("_", " ")
        coils = " and ".join(part for part in parts if "=" not in part)
        rest = [
            f", {key_in_si(key)[0].replace('_', ' ')} {value}"
            for key, _, value in (p.partition("=") for p in parts if "=" in p)
        ]
        text = f"{text}{f' of {coils}' if coils else ''}{''.join(rest)}"
    else:
        *tables, key = [part for part in base.split(".") if not part.isdecimal()]
        text = key_in_si(key)[0].replace("_", " ")
        text += f" of {tables[1]}" if len(tables) > 1 else ""
    target = name.strip("|").partition(" − ")[2]
    return f"{text} less {target}" if target else text


def unit_of(name: str) -> str:
    """Symbol of the unit of a quantity or an entry, or empty."""
    bare = quantity_of(name)
    known = QUANTITIES.get(bare.partition("[")[0])
    unit = known.unit if known is not None else entry_unit(bare)
    return SYMBOLS.get(unit, unit)


def axis_label(name: str) -> str:
    """Words with unit of a quantity, distance or entry.

    >>> axis_label("array.pitch_mm"), axis_label("worst_k")
    ('pitch (mm)', 'largest |k| of two coils')
    """
    unit = unit_of(name)
    return f"{words(name)} ({unit})" if unit else words(name)


def with_unit(name: str, value: object) -> str:
    """Value of a quantity or an entry with its unit.

    >>> with_unit("array.pitch_mm", 10.755), with_unit("array.layers", [["L1", "L2"], ["L3", "L4"]])
    ('10.755 mm', 'L1 L2, L3 L4')
    """
    if isinstance(value, list):
        return ", ".join(" ".join(map(str, one)) if isinstance(one, list) else str(one) for one in value)
    unit = unit_of(name) if isinstance(value, int | float) else ""
    rounded = name.partition("[")[0] in QUANTITIES
    text = _FOUR.texts([value])[0] if rounded and isinstance(value, float) else value_text(value)
    return f"{text} {unit}".strip()


def limit_words(limit: str) -> str:
    """Words of a limit such as ``span_mm <= 89.4``."""
    name, relation, value = limit.rsplit(" ", 2)
    sides = {">=": "at least", "<=": "at most"}
    return f"{words(name)} {sides.get(relation, relation)} {with_unit(name, float(value))}"


def quantity_of(name: str) -> str:
    """Quantity of an objective, without its target."""
    return name.strip("|").partition(" − ")[0]


def with_changes(table: Table, before: Table | None, keys: int = 1) -> dict[str, Any]:
    """Table for the page, each number with its change against an earlier table."""
    # Rows and columns belong together by their first `keys` cells and by their names.
    known = {} if before is None else {row[:keys]: row for row in before.rows}
    places = {} if before is None else {column.name: k for k, column in enumerate(before.columns)}
    numbers = [k for k, column in enumerate(table.columns) if column.unit]
    rows = []
    for row in table.rows:
        old, line = known.get(row[:keys]), list[Value](row)
        for k in numbers:
            now, at = row[k], places.get(table.columns[k].name)
            was = old[at] if old is not None and at is not None else ""
            line[k] = ""
            if isinstance(now, float | int) and isinstance(was, float | int):
                line[k] = "" if math.isclose(now, was, rel_tol=_EQUAL) else float(now) - float(was)
        rows.append(tuple(line))
    shown, changes = table.known().cells(), replace(table, rows=tuple(rows)).cells()
    return {
        "head": [{"text": one.header, "means": one.meaning} for one in table.columns],
        "rows": [
            {
                "name": str(row[0]), "mark": bool(table.mark) and table.mark in texts,
                "cells": [
                    {"text": text, "change": _change_text(now, difference, change) if k in numbers else ""}
                    for k, (text, now, difference, change) in enumerate(zip(texts, row, line, cells, strict=True))
                ],
            }
            for row, line, texts, cells in zip(table.rows, rows, shown, changes, strict=True)
        ],
    }  # fmt: skip


def _change_text(now: Value, difference: Value, text: str) -> str:
    """Change with its sign, and in per cent where it is a share of something."""
    if not isinstance(difference, float) or isinstance(now, str):
        return ""
    was = float(now) - difference
    share = f" ({number_text(100 * difference / abs(was), 1, '+')} %)" if abs(was) > abs(difference) * _EQUAL else ""
    return f"{'+' if difference > 0 else ''}{text}{share}"


def preview(
    work: Work,
    changes: Mapping[str, Any],
    before: Mapping[str, float],
    after: Mapping[str, float],
    violations: Mapping[str, float],
) -> dict[str, Any]:
    """Sizes, entries and quantities before and after, with violated limits."""
    changed = work.with_document(work.document_with(changes)).design
    limits = {limit.rsplit(" ", 2)[0]: (limit, broken) for limit, broken in violations.items()}
    old, new = (_size_words(design) for design in (work.design, changed))
    rows: list[dict[str, Any]] = [{"words": name, "before": old[name], "after": new[name]} for name in new]
    values = work.opened.values
    rows += [
        {"words": words(key), "before": with_unit(key, _entry(values, key)), "after": with_unit(key, value)}
        for key, value in changes.items()
    ]
    for name, value in after.items():
        limit, broken = limits.get(name, ("", 0.0))
        was = before.get(name)
        share = f" ({100 * (value - was) / abs(was):+.1f} %)".replace("-", "−") if was and value != was else ""
        rows.append({
            "words": words(name), "before": "–" if was is None else with_unit(name, was),
            "after": with_unit(name, value) + share, "limit": limit_words(limit) if limit else "",
            "broken": broken > 0,
        })  # fmt: skip
    rows = [{"limit": "", "broken": False, **row, "same": row["before"] == row["after"]} for row in rows]
    return {"rows": rows, "plan": plan_of(changed)}


def _entry(values: Mapping[str, Any], key: str) -> Any:
    table, _, place = key.rpartition(".")
    return values[table][int(place)] if key not in values and place.isdecimal() and table in values else values.get(key)


def _size_words(design: Design) -> dict[str, str]:
    x_min, y_min, x_max, y_max = (1e3 * edge for edge in design.array.bounds)
    board = f"{x_max - x_min:.2f} × {y_max - y_min:.2f} mm"
    count, layers = len(design.coil_names), len(design.array.stackup.names)
    return {"board": board, "coils": str(count), "copper layers": str(layers)}
