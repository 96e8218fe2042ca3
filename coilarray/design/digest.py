"""Identity of a design as a hash of its values."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from coilarray.geometry import Array, Coil, FinitePlate, Material, Plate, RoundedSpiral
from coilarray.geometry.arcs import Arc
from coilarray.geometry.spiral import Winding

# 13.28 · 1e-3 m and 0.01328 m differ in the last bit, which must not make another design.
# Places and angles, for which zero is not a special value, count to 1 pm and 1 prad.
_DIGITS = 14
_PLACES = 12


def digest_of(*values: object) -> str:
    """Return the hexadecimal SHA-256 of values of any structure."""
    return hashlib.sha256(json.dumps([_plain(value) for value in values], sort_keys=True).encode()).hexdigest()


def _plain(value: Any) -> Any:
    """Return a value for JSON, dataclasses with the class's name."""
    match value:
        case bool() | str() | None:
            return value
        case int() | float() | np.number():
            return f"{float(value) + 0.0:.{_DIGITS - 1}e}"  # no minus zero. 1 and 1.0 are equal
        case Mapping():
            return {key: _plain(item) for key, item in value.items()}
        case tuple() | list():
            return [_plain(item) for item in value]
        case np.ndarray():
            return (np.round(value, _PLACES) + 0.0).tolist()
        case Array():
            return _array(value)
        case Material():
            return [_plain(value.conductivity), _plain(value.relative_permeability)]  # its name does not count
        case Plate():
            return [value.name, _plain(value.material), _plain(value.thickness), _plain(np.array(value.z))]
        case Winding():  # its name and the board of the coil alone do not count
            values = {field.name: getattr(value, field.name) for field in fields(value)}
            if isinstance(value, RoundedSpiral):  # a file has the direction of a corner, degrees away from a flat's
                values["direction"] = np.array(value.direction)
            values["winding_rule"] = "parallel" if value.is_parallel else "corner"  # a circle always has a rule
            return [type(value).__name__, *(_plain(values[key]) for key in values if key not in ("name", "stackup"))]
        case Arc():  # its bulge is computed, and the bulge of a short arc has few digits
            return [value.first, value.last, _plain(np.array(value.bulge))]
        case FinitePlate():
            shape = [value.outline, value.material, value.thickness, value.tilt, value.tilt_direction]
            return [value.name, _plain(shape), _plain(np.array(value.centre))]
    if not is_dataclass(value):
        raise TypeError(f"a design must be made of plain values; got {type(value).__name__}.")
    return [type(value).__name__, *(_plain(getattr(value, field.name)) for field in fields(value))]


def _array(array: Array) -> Any:
    """Return every coil shape once, without the lattice."""
    coils: dict[int, str] = {}
    placements: list[Any] = []
    for place in array.placements:
        if id(place.coil) not in coils:
            coils[id(place.coil)] = digest_of(_coil(place.coil))
        where = np.array([place.x, place.y, place.rotation])
        placements.append([place.name, coils[id(place.coil)], list(place.layers), _plain(where)])
    return [_plain(array.stackup), placements, _plain(array.board_margin), array.through_holes]


def _coil(coil: Coil) -> Any:
    """Return a spiral's sizes, or a coil's lines, without names."""
    if coil.wound is not None:
        return coil.wound
    lines = (coil.lines, coil.arcs) if coil.arcs else (coil.lines,)
    return *lines, coil.widths, coil.gap, coil.via, coil.terminal, coil.outline
