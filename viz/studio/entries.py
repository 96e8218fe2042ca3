"""Entries of a design with a slider: labels, meanings, units and ranges."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

from coilarray.design.keys import entry_unit, key_in_si, keys_of
from coilarray.design.model import DesignFile
from coilarray.design.tables import Document
from coilarray.errors import DesignError

_SYMBOLS = {"deg": "°", "ohm": "Ω", "1": ""}
_WHOLE = ("columns", "rows", "sides", "winding_layers", "rings")
_COIL = (
    "turns_per_layer", "winding_layers", "outer_across_corners_mm", "outer_across_flats_mm", "outer_diameter_mm",
    "outer_width_mm", "outer_height_mm", "corner_radius_mm", "trace_width_mm", "gap_mm", "sides", "first_corner_deg",
)  # fmt: skip
_BODY = (
    "distance_mm", "z_mm", "thickness_mm", "diameter_mm", "inner_diameter_mm", "width_mm", "height_mm", "tilt_deg",
    "tilt_direction_deg", "x_mm", "y_mm", "conductivity_MS_per_m", "relative_permeability",
)  # fmt: skip
_CIRCUIT = (
    "capacitance_pF", "short_resistance_ohm", "switch_off_capacitance_pF", "terminal_capacitance_pF",
    "bus_capacitance_pF",
)  # fmt: skip
_FAB = ("min_trace_mm", "min_gap_mm", "min_drill_mm", "min_annular_ring_mm", "min_edge_clearance_mm")
_SHOWN: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("coils.NAME", "Coil", _COIL),
    ("coils.NAME.leads", "Coil", ("length_mm", "spacing_mm", "pad_mm", "drill_mm")),
    ("array", "Array", ("pitch_mm", "columns", "rows", "rings", "direction_deg", "rotation_deg")),
    ("connector", "Connector", ("pitch_mm", "distance_mm", "trace_width_mm", "gap_mm")),
    ("elastomer.N", "Elastomer", ("thickness_mm", "relative_permeability", "youngs_modulus_kPa")),
    ("plate.N", "Plate", _BODY),
    ("target", "Target", _BODY),
    ("indentation", "Seat", ("seat_stiffness_kPa_per_mm", "seat_shear_kPa_per_mm")),
    ("indenter", "Indenter", ("radius_mm", "half_angle_deg")),
    ("circuit", "Circuit", _CIRCUIT),
    ("stackup", "Board", ("copper_thickness_um", "dielectric_thickness_mm")),
    ("board", "Board", ("margin_mm",)),
    ("field", "Field", ("height_mm",)),
    ("fab", "Limits of the board house", _FAB),
)
"""Tables with their headings and the keys that have a slider, in the order of the panel."""
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
    """List a design's main entries in the shown order.

    Examples
    --------
    >>> from coilarray.design.model import load_design_file
    >>> pitch = next(e for e in entries_of(load_design_file("gast2020")) if e.key == "array.pitch_mm")
    >>> pitch.label, pitch.unit, pitch.value, pitch.low, pitch.high, pitch.step
    ('pitch', 'mm', 13.28, 6.6, 26.6, 0.1)
    """
    return tuple(_entries(file.values))


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
    """Text of a value in its field.

    It has all its significant digits.

    Examples
    --------
    >>> text_of(13.28), text_of(30.0), text_of(1.7e-8)
    ('13.28', '30', '1.7e-08')
    """
    return f"{value:.12g}"


def _entries(values: Mapping[str, object]) -> Iterator[Entry]:
    """Go through the entries of all tables."""
    meanings = _meanings()
    without = _NOT_OF.get(str(values.get("array.lattice")), ())
    names = dict.fromkeys(key.split(".")[1] for key in values if key.startswith("coils."))
    for name in names:
        for path, group, keys in _SHOWN[:2]:
            yield from _table(values, path.replace("NAME", name), f"{group} {name}", keys, meanings, path)
    for path, group, keys in _SHOWN[2:]:
        table, k = path.removesuffix(".N"), 0
        while table != path and f"{table}.{k}.name" in values:
            heading = f"{group} {values[f'{table}.{k}.name']}"
            yield from _table(values, f"{table}.{k}", heading, keys, meanings, path)
            k += 1
        chosen = [key for key in keys if path != "array" or key not in without]
        yield from _table(values, path, group, chosen, meanings, path)


@cache
def _meanings() -> Mapping[str, str]:
    """Meanings of all keys; to collect them takes longer than all the rest of a change of an entry."""
    return {key.dotted: key.meaning for key in reversed(keys_of(Document))}


def _table(
    values: Mapping[str, object], table: str, group: str, keys: Sequence[str], meanings: Mapping[str, str], path: str
) -> Iterator[Entry]:
    """Entries of one table; of a list every number."""
    for key in keys:
        value = values.get(f"{table}.{key}")
        words, meaning = key_in_si(key)[0].replace("_", " "), meanings.get(f"{path}.{key}", "")
        words += " of the leads" if path.endswith(".leads") else ""
        if isinstance(value, list):
            for k, number in enumerate(value):
                yield _entry(f"{table}.{key}.{k}", key, f"{words} {k + 1}", meaning, group, float(number))
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield _entry(f"{table}.{key}", key, words, meaning, group, float(value))


def _entry(key: str, name: str, label: str, meaning: str, group: str, value: float) -> Entry:
    """Make an entry with the range of its slider."""
    unit = entry_unit(name)
    unit = _SYMBOLS.get(unit, unit)
    if unit == "°" and name != "half_angle_deg":
        low, high, step = min(-_TURN, value), max(_TURN, value), 1.0
    elif name in _WHOLE:
        least = 3.0 if name == "sides" else 1.0
        low, high, step = least, max(2 * value, least + 7), 1.0
    else:
        low, high, step = _range(value)
        if name == "turns_per_layer":
            low, high, step = max(math.floor(low), 1.0), math.ceil(high), 1.0
        if name == "relative_permeability":
            low = max(low, 1.0)
    return Entry(key, label, meaning, unit, group, value, low, high, step)


def _range(value: float) -> tuple[float, float, float]:
    """Half and twice a value, and a step."""
    if value <= 0:
        return min(value, 0.0), _RANGE_OF_ZERO, _RANGE_OF_ZERO / 100
    step = 10.0 ** math.floor(math.log10(value)) / _STEPS_IN_A_DECADE
    low, high = (round(round(bound / step) * step, 12) for bound in (value / 2, 2 * value))
    return low, high, round(step, 12)
