"""Entries with a slider: labels, meanings, units and ranges."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache

from coilarray.design.keys import Key, entry_unit, key_in_si, keys_of
from coilarray.design.model import DesignFile
from coilarray.design.tables import Document
from coilarray.errors import DesignError

_SYMBOLS = {"deg": "°", "ohm": "Ω", "1": ""}
_GROUPS = {
    "coils.NAME": "Coil", "coils.NAME.leads": "Coil", "array": "Array", "connector": "Connector",
    "elastomer.N": "Elastomer", "plate.N": "Plate", "target": "Target", "indentation": "Indentation",
    "indenter": "Indenter", "circuit": "Circuit", "stackup": "Board", "board": "Board", "field": "Field",
    "fab": "Limits of the board house",
}  # fmt: skip
"""Tables whose numbers have sliders, with headings, in shown order."""
_NOT_OF = {"single": ("rows", "direction_deg"), "rings": ("rows",), "triangle": ("rows",)}
"""Keys of [array] that a lattice lacks."""
_STEPS_IN_A_DECADE = 100
_TURN = 180.0  # range of an angle in degrees to both sides
_RANGE_OF_ZERO = 10.0  # upper end of a slider whose value is zero


@dataclass(frozen=True)
class Entry:
    """Entry with a slider."""

    key: str  # dotted, as for `coilarray.design.vary.vary`
    label: str  # key in words, without the unit
    meaning: str  # sentence of the reference
    unit: str  # of all numbers, or empty
    group: str  # heading above the entry
    value: float
    low: float
    high: float
    step: float


def entries_of(file: DesignFile) -> tuple[Entry, ...]:
    """List the numbers of a design in the shown order."""
    values, known = file.values, _keys()
    found: dict[str, list[Entry]] = {path: [] for path in _GROUPS}
    without = _NOT_OF.get(str(values.get("array.lattice")), ())
    for dotted, value in values.items():
        path = re.sub(r"\.\d+\.", ".N.", dotted)
        name = re.match(r"coils\.(.+?)\.(leads\.)?\w+$", dotted)
        if name:
            path = dotted.replace(f"coils.{name[1]}.", "coils.NAME.", 1)
        key = known.get(path)
        if key is None or key.path not in _GROUPS or (key.path == "array" and key.name in without):
            continue
        table = dotted.removesuffix(f".{key.name}")
        of = f" {name[1]}" if name else f" {values[f'{table}.name']}" if key.path.endswith(".N") else ""
        group = _GROUPS[key.path] + of
        words = key_in_si(key.name)[0].replace("_", " ") + (" of the leads" if key.path.endswith(".leads") else "")
        numbers = value if isinstance(value, list) else [value]
        for k, number in enumerate(numbers):
            if isinstance(number, int | float) and not isinstance(number, bool):
                many = isinstance(value, list)
                label, at = (f"{words} {k + 1}", f"{dotted}.{k}") if many else (words, dotted)
                found[key.path].append(_entry(key, at, label, group, float(number)))
    return tuple(entry for entries in found.values() for entry in entries)


@cache
def _keys() -> dict[str, Key]:
    """Keys of a design, stored because collecting them is slow."""
    return {key.dotted: key for key in reversed(keys_of(Document))}


def _entry(key: Key, dotted: str, label: str, group: str, value: float) -> Entry:
    """Make an entry with the range of its slider."""
    unit = entry_unit(key.name)
    unit = _SYMBOLS.get(unit, unit)
    allowed = re.search(r", ([−\d.]+) to ([\d.\u202f]+)", key.allowed)
    if unit == "°" and key.name != "half_angle_deg":
        low, high, step = min(-_TURN, value), max(_TURN, value), 1.0
    elif key.allowed.startswith("whole number"):
        low, high, step = 1.0, max(2 * value, 8.0), 1.0
    elif value <= 0:
        low, high, step = min(value, 0.0), _RANGE_OF_ZERO, _RANGE_OF_ZERO / 100
    else:
        step = 10.0 ** math.floor(math.log10(value)) / _STEPS_IN_A_DECADE
        low, high = (round(round(bound / step) * step, 12) for bound in (value / 2, 2 * value))
        step = round(step, 12)
        if key.name == "turns_per_layer":
            low, high, step = max(math.floor(low), 1.0), math.ceil(high), 1.0
    if allowed:
        least, most = (float(bound.replace("−", "-").replace("\u202f", "")) for bound in allowed.groups())
        low, high = max(low, least), min(high, most)
    return Entry(dotted, label, key.meaning, unit, group, value, low, high, step)


def number_of(key: str, text: str) -> float:
    """Read a typed number, or raise DesignError with its key."""
    try:
        if "_" in text:  # only Python reads it as a number
            raise ValueError
        value = float(text.strip().replace("−", "-"))
    except ValueError:
        raise DesignError(f"{key} must be a number; got {text.strip()[:40]!r}.") from None
    if not math.isfinite(value):
        raise DesignError(f"{key} must be a finite number; got {text.strip()[:40]!r}.")
    return value


def place_text(value: float) -> str:
    """Text of a coordinate in m, shown in mm."""
    return f"{value * 1e3:.2f}".replace("-0.00", "0.00")


def text_of(value: float) -> str:
    """Text of a value with all its significant digits.

    >>> text_of(13.28), text_of(30.0), text_of(1.7e-8)
    ('13.28', '30', '1.7e-08')
    """
    return f"{value:.12g}"
