"""Usual ranges of values, and likely wrong units.

A value is unusual only if a thousandth or the thousandfold of it would be usual. The ranges extend
from coils 0.1 mm wide to the coils of wireless chargers, 1 m wide.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from coilarray.errors import GeometryError, UnusualValueWarning

_COIL, _TRACE, _PAD = (0.05, 1000), (0.001, 30), (0.002, 30)
_COPPER, _BODY, _LIMIT, _CAPACITANCE = (1, 500), (0.05, 2000), (0.001, 20), (0.05, 5e6)
USUAL: Mapping[str, tuple[float, float]] = {
    **dict.fromkeys(
        ("outer_across_flats_mm", "outer_across_corners_mm", "outer_diameter_mm", "outer_width_mm", "outer_height_mm",
         "sizes_mm"),
        _COIL,
    ),
    "corner_radius_mm": (0.005, 500),
    **dict.fromkeys(("trace_width_mm", "gap_mm"), _TRACE),
    **dict.fromkeys(("drill_mm", "pad_mm", "terminal_drill_mm", "terminal_pad_mm"), _PAD),
    **dict.fromkeys(("copper_thickness_um", "plating_um", "terminal_plating_um"), _COPPER),
    "dielectric_thickness_mm": (0.003, 20),
    "youngs_modulus_kPa": (1, 20000),
    **dict.fromkeys(("length_mm", "spacing_mm"), (0.01, 1000)),
    "margin_mm": (0.01, 100),
    **dict.fromkeys(("pitch_mm", "diameter_mm", "inner_diameter_mm", "width_mm", "height_mm"), _BODY),
    **dict.fromkeys(("distance_mm", "distances_mm"), (0.02, 2000)),
    "thickness_mm": (0.005, 200),
    **dict.fromkeys(("radius_mm", "sample_radius_mm", "edge_radius_mm"), (0.01, 500)),
    **dict.fromkeys(("bend_radius_mm", "bend_far_radius_mm"), (0.1, 5000)),
    **dict.fromkeys(("radii_mm", "skirt_mm"), (0.5, 5000)),
    "unit_mm": (0.0005, 5000),
    "level_step_mm": (0.005, 50),
    "depths_mm": (0.002, 50),
    "step_mm": (0.005, 500),
    **dict.fromkeys(
        ("min_trace_mm", "min_gap_mm", "min_drill_mm", "min_annular_ring_mm", "min_edge_clearance_mm",
         "min_hole_spacing_mm"), _LIMIT,
    ),
    "max_board_mm": (5, 5000),
    **dict.fromkeys(("max_inner_copper_um", "max_outer_copper_um"), _COPPER),
    **dict.fromkeys(
        ("switch_off_capacitance_pF", "terminal_capacitance_pF", "bus_capacitance_pF"), _CAPACITANCE
    ),
    "capacitance_pF": (1, 5e6),
    "lead_inductance_nH": (0.01, 1e5),
    "short_resistance_ohm": (0.001, 1000),
    **dict.fromkeys(("load_ohm", "source_ohm"), (0.001, 1e7)),
    **dict.fromkeys(("series_pF", "parallel_pF"), (0.05, 1e9)),
    "link_frequency_MHz": (1e-5, 1e4),
    "resistivity_ohm_m": (5e-9, 3e-6),
    "conductivity_MS_per_m": (1e-3, 100),
    "clock_MHz": (0.5, 500),
    **dict.fromkeys(("dielectric_epsilon_r", "elastomer_permittivity"), (1, 200)),
}  # fmt: skip
"""Least and largest usual value of each key of a design file, in the unit of its name."""
_UNITS = {
    "mm": "mm", "um": "µm", "pF": "pF", "nH": "nH", "ohm": "Ω", "ohm_m": "Ω·m", "MHz": "MHz", "MS_per_m": "MS/m",
    "kPa": "kPa", "r": "", "permittivity": "",
}  # fmt: skip
LARGEST_COIL = 10.0  # largest possible size of a coil in m
THINNEST_COPPER, THICKEST_DIELECTRIC = 1e-6, 50e-3  # bounds in m of the layers of a board
_reading: ContextVar[bool] = ContextVar("_reading", default=False)


def slip(key: str, value: float) -> str:
    """Return an unusual value and its likely unit, or "".

    >>> slip("target.distances_mm.0", 0.001), slip("coils.c.gap_mm", 0.15)
    ('0.001 mm is unusual: 1 mm?', '')
    """
    name = next((part for part in reversed(key.split(".")) if not part.isdecimal()), "")
    if name not in USUAL or not value:
        return ""
    least, most = USUAL[name]
    meant = value * 1e3 if value < least else value * 1e-3
    if least <= value <= most or not least <= meant <= most:
        return ""
    unit = next(words for end, words in _UNITS.items() if name.endswith(f"_{end}"))
    return f"{value:g} {unit}".rstrip() + f" is unusual: {meant:.4g} {unit}".rstrip() + "?"


def unusual_values(table: Mapping[str, Any]) -> list[str]:
    """Return a line for each unusual value of a design."""
    found = ((name, slip(name, number)) for name, number in _numbers(table, ""))
    return list(dict.fromkeys(f"{name} of {words}" for name, words in found if words))


def _numbers(value: object, name: str) -> Iterator[tuple[str, float]]:
    """Yield all numbers of a table with their names, rows of tables counted from 0."""
    if isinstance(value, Mapping):
        for key, one in value.items():
            yield from _numbers(one, f"{name}.{key}" if name else key)
    elif isinstance(value, (list, tuple)):
        for k, one in enumerate(value):
            yield from _numbers(one, f"{name}.{k}" if isinstance(one, Mapping) else name)
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        yield name, float(value)


def warn_unusual(values: Iterable[tuple[str, float]]) -> None:
    """Warn of unusual values in SI, except in `reading`."""
    if _reading.get():
        return
    for key, value in values:
        if words := slip(key, value * (1e6 if key.endswith("_um") else 1e3)):
            text = f"{key.rpartition('_')[0]} of {words} Lengths are in m."
            warnings.warn(text, UnusualValueWarning, stacklevel=4)


@contextmanager
def reading() -> Iterator[None]:
    """Suppress warnings of single values while a file is read."""
    token = _reading.set(True)
    try:
        yield
    finally:
        _reading.reset(token)


def require_coil_size(size: float) -> None:
    """Raise GeometryError for a coil size above 10 m."""
    if size > LARGEST_COIL:
        raise GeometryError(
            f"a coil must be at most {LARGEST_COIL:g} m wide; got {size:g} m. Lengths are in m: {size * 1e-3:g} m?"
        )
