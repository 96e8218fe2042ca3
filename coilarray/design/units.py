"""Common base of the tables of all TOML files.

Unknown keys are refused by name. Numbers have a unit and bounds.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from coilarray.errors import listed, shown

SCALES: Mapping[str, float] = {
    "mm": 1e-3, "um": 1e-6, "deg": math.pi / 180, "mrad": 1e-3, "kPa": 1e3, "pF": 1e-12, "nH": 1e-9, "uH": 1e-6,
    "MHz": 1e6, "percent": 1e-2,
}  # fmt: skip
"""SI value of each unit at the end of a key or an option."""

_ENTRY_UNITS = {
    "mm": "mm", "per_mm": "1/mm", "mm_per_mm": "mm/mm", "um": "µm",
    "deg": "deg", "mrad": "mrad", "pF": "pF", "nH": "nH", "MHz": "MHz", "kPa": "kPa",
    "kPa_per_mm": "kPa/mm", "MS_per_m": "MS/m", "ohm": "ohm", "ohm_m": "ohm m", "percent": "%",
    "ppm": "ppm", "ppm_per_K": "ppm/K", "ppm_per_V": "ppm/V", "ps": "ps", "mV": "mV", "V": "V", "K": "K",
    "Hz": "Hz", "F": "F", "H": "H", "s": "s", "Pa": "Pa",
}  # fmt: skip


def entry_unit(key: str) -> str:
    """Return the unit of an entry of a file.

    The entry is given by its dotted key. The unit has the form that tables show. It is "1" for an entry without a unit.

    Examples
    --------
    >>> entry_unit("array.pitch_mm"), entry_unit("circuit.resistivity_ohm_m"), entry_unit("array.columns")
    ('mm', 'ohm m', '1')
    >>> entry_unit("seat_stiffness_slope_x_per_mm"), entry_unit("seat_gap_slope_x_mm_per_mm")
    ('1/mm', 'mm/mm')
    >>> entry_unit("stackup.dielectric_thickness_mm.1")
    'mm'
    """
    last = next((part for part in reversed(key.split(".")) if not part.isdecimal()), "")  # the key of the list
    ends = [end for end in _ENTRY_UNITS if last.endswith(f"_{end}")]
    return _ENTRY_UNITS[max(ends, key=len)] if ends else "1"


# Bounds far beyond any board: a typo is refused at once instead of overflowing or running for hours.
Millimetres = Annotated[float, Field(gt=0, le=10_000)]
Micrometres = Annotated[float, Field(gt=0, le=100_000)]
LimitMillimetres = Annotated[float, Field(ge=0, le=10_000)]
Position = Annotated[float, Field(ge=-100_000, le=100_000)]
Point = Annotated[list[Position], Field(min_length=2, max_length=2)]
Range = Annotated[list[Position], Field(min_length=2, max_length=2)]
Degrees = Annotated[float, Field(ge=-36_000, le=36_000)]
Relative = Annotated[float, Field(ge=1, le=1e6)]
Name = Annotated[str, Field(min_length=1, pattern=r"^[A-Za-z0-9_.+][A-Za-z0-9_.+-]*$")]


class Table(BaseModel):
    """A table of the file: unknown keys, wrong types and numbers that are not finite are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False, validate_default=True)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, table: object) -> object:
        """Name the allowed keys beside an unknown key.

        ``extra="forbid"`` alone does not do this.
        """
        known = sorted(field.alias or name for name, field in cls.model_fields.items())
        for key in table if isinstance(table, Mapping) else ():
            if key not in known:
                close = difflib.get_close_matches(str(key), known, n=1) or [
                    name for name in known if len(str(key)) > 3 and str(key) in name
                ]
                hint = f"did you mean {close[0]}? Allowed" if close else "allowed"
                raise PydanticCustomError(
                    "unknown_key", "{hint}", {"hint": f"has no key {shown(key)}; {hint} are {listed(known)}"}
                )
        return table


class Bounds(Table):
    """Bounds of what a table names: at least one, and the lower one not above the upper one."""

    at_least: float | None = None
    """Least value, in the unit of the quantity, as the largest."""
    at_most: float | None = None
    """Largest value."""

    @model_validator(mode="after")
    def _some_room(self) -> Bounds:
        if self.at_least is None and self.at_most is None:
            raise ValueError("needs at_least, at_most or both")
        if self.at_least is not None and self.at_most is not None and not self.at_least <= self.at_most:
            raise ValueError(f"needs at_least up to at_most; got {self.at_least:g} and {self.at_most:g}")
        return self


def in_si(table: Table, *without: str) -> dict[str, Any]:
    """Return the values of a table in SI.

    Their keys have no unit. Lists become tuples, and `without` names are left out.
    """
    values = {}
    for key in type(table).model_fields:
        if key not in without:
            name, _, unit = key.rpartition("_")
            values[name if unit in SCALES else key] = _times(getattr(table, key), SCALES.get(unit))
    return values


def _times(value: Any, scale: float | None) -> Any:
    if isinstance(value, list):
        return tuple(_times(item, scale) for item in value)
    return value if scale is None or value is None else value * scale


def require_rising(key: str, values: Sequence[float]) -> None:
    """Refuse values that do not rise.

    Each must be greater than the previous value. The ValueError is for a validator.
    """
    if not all(low < high for low, high in pairwise(values)):
        raise ValueError(f"needs {key} that rise from each to the next; got {values}")
