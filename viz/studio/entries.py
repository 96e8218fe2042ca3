"""Entries of a design with a slider.

Their labels, units and ranges.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from coilarray.design.keys import entry_unit
from coilarray.design.model import DesignFile
from coilarray.errors import DesignError

_SYMBOLS = {"deg": "°", "ohm": "Ω", "1": ""}
_WHOLE = ("columns", "rows", "sides", "winding_layers", "rings")
_COIL = {
    "turns_per_layer": "turns a layer", "winding_layers": "layers in series",
    "outer_across_corners_mm": "outer size, corners", "outer_across_flats_mm": "outer size, flats",
    "outer_diameter_mm": "outer diameter", "outer_width_mm": "outer width", "outer_height_mm": "outer height",
    "corner_radius_mm": "corner radius", "trace_width_mm": "trace width", "gap_mm": "gap", "sides": "sides",
    "first_corner_deg": "first corner",
}  # fmt: skip
_LEADS = {
    "length_mm": "length of the leads", "spacing_mm": "distance of the terminals", "pad_mm": "pads of the terminals",
    "drill_mm": "holes of the terminals",
}  # fmt: skip
_ARRAY = {
    "pitch_mm": "pitch", "columns": "columns", "rows": "rows", "rings": "rings",
    "direction_deg": "direction of the rows", "rotation_deg": "rotation of each coil",
}  # fmt: skip
_NOT_OF = {
    "single": ("rows", "direction_deg"),
    "rings": ("rows",),
    "triangle": ("rows",),
}  # entries of _ARRAY that a lattice lacks
_CONNECTOR = {
    "pitch_mm": "distance of the holes", "distance_mm": "distance from the coils", "trace_width_mm": "traces to it",
    "gap_mm": "gap between them",
}  # fmt: skip
_SHEET = {
    "thickness_mm": "thickness", "relative_permeability": "relative permeability",
    "youngs_modulus_kPa": "Young's modulus",
}  # fmt: skip
_INDENTER = {"radius_mm": "radius", "half_angle_deg": "half angle"}
_BODY = {
    "distance_mm": "distance", "z_mm": "height of the lower face", "thickness_mm": "thickness",
    "diameter_mm": "diameter", "inner_diameter_mm": "inner diameter", "width_mm": "width", "height_mm": "height",
    "tilt_deg": "tilt", "tilt_direction_deg": "direction of the tilt", "x_mm": "x", "y_mm": "y",
    "conductivity_MS_per_m": "conductivity", "relative_permeability": "relative permeability",
}  # fmt: skip
_SEAT = {"seat_stiffness_kPa_per_mm": "stiffness", "seat_shear_kPa_per_mm": "stiffness along the board"}
_CIRCUIT = {
    "capacitance_pF": "tank capacitance", "short_resistance_ohm": "resistance to ground",
    "switch_off_capacitance_pF": "open switch", "terminal_capacitance_pF": "terminal to ground",
    "bus_capacitance_pF": "bus to ground",
}  # fmt: skip
_FAB = {
    "min_trace_mm": "narrowest trace", "min_gap_mm": "least gap", "min_drill_mm": "smallest hole",
    "min_annular_ring_mm": "narrowest ring", "min_edge_clearance_mm": "copper to edge",
}  # fmt: skip
_STEPS_IN_A_DECADE = 100
_TURN = 180.0  # range of an angle in degrees to both sides
_RANGE_OF_ZERO = 10.0  # upper end of a slider whose value is zero


@dataclass(frozen=True)
class Entry:
    """Entry with a slider.

    A typed number may lie beyond its ends.
    """

    key: str  # dotted, as for `coilarray.design.vary.vary`
    label: str  # without the unit
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
    """Read a typed number.

    Any other text raises a DesignError with the key.
    """
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
    for name in dict.fromkeys(key.split(".")[1] for key in values if key.startswith("coils.")):
        yield from _table(values, f"coils.{name}", f"Coil {name}", _COIL)
        yield from _table(values, f"coils.{name}.leads", f"Coil {name}", _LEADS)
    without = _NOT_OF.get(str(values.get("array.lattice")), ())
    yield from _table(values, "array", "Array", {key: label for key, label in _ARRAY.items() if key not in without})
    yield from _table(values, "connector", "Connector", _CONNECTOR)
    for k in itertools.takewhile(lambda k: f"elastomer.{k}.name" in values, itertools.count()):
        yield from _table(values, f"elastomer.{k}", f"Elastomer {values[f'elastomer.{k}.name']}", _SHEET)
    for k in itertools.takewhile(lambda k: f"plate.{k}.name" in values, itertools.count()):
        yield from _table(values, f"plate.{k}", f"Plate {values[f'plate.{k}.name']}", _BODY)
    yield from _table(values, "target", "Target", _BODY)
    yield from _table(values, "indentation", "Seat", _SEAT)
    yield from _table(values, "indenter", "Indenter", _INDENTER)
    yield from _table(values, "circuit", "Circuit", _CIRCUIT)
    yield from _stackup(values)
    yield from _table(values, "board", "Board", {"margin_mm": "margin"})
    yield from _table(values, "field", "Board", {"height_mm": "height of the field's plane"})
    yield from _table(values, "fab", "Limits of the board house", _FAB)


def _table(values: Mapping[str, object], table: str, group: str, named: Mapping[str, str]) -> Iterator[Entry]:
    for name, label in named.items():
        value = values.get(f"{table}.{name}")
        if isinstance(value, int | float) and not isinstance(value, bool):
            yield _entry(f"{table}.{name}", name, label, group, float(value))


def _stackup(values: Mapping[str, object]) -> Iterator[Entry]:
    for name, label in (("copper_thickness_um", "copper"), ("dielectric_thickness_mm", "dielectric")):
        numbers = values.get(f"stackup.{name}")
        for k, value in enumerate(numbers if isinstance(numbers, list) else ()):
            yield _entry(f"stackup.{name}.{k}", name, f"{label} {k + 1}", "Board", float(value))


def _entry(key: str, name: str, label: str, group: str, value: float) -> Entry:
    """Make an entry with the range of its slider."""
    unit = entry_unit(name)
    unit = _SYMBOLS.get(unit, unit)
    if unit == "°" and name != "half_angle_deg":
        return Entry(key, label, unit, group, value, min(-_TURN, value), max(_TURN, value), 1.0)
    if name in _WHOLE:
        least = 3.0 if name == "sides" else 1.0
        return Entry(key, label, unit, group, value, least, max(2 * value, least + 7), 1.0)
    low, high, step = _range(value)
    if name == "turns_per_layer":
        return Entry(key, label, unit, group, value, max(math.floor(low), 1.0), math.ceil(high), 1.0)
    if name == "relative_permeability":
        low = max(low, 1.0)
    return Entry(key, label, unit, group, value, low, high, step)


def _range(value: float) -> tuple[float, float, float]:
    """Half and twice a value, and a step.

    The step is a hundredth of the value's decade.
    """
    if value <= 0:
        return min(value, 0.0), _RANGE_OF_ZERO, _RANGE_OF_ZERO / 100
    step = 10.0 ** math.floor(math.log10(value)) / _STEPS_IN_A_DECADE
    low, high = (round(round(bound / step) * step, 12) for bound in (value / 2, 2 * value))
    return low, high, round(step, 12)
