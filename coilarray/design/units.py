"""What the tables of all our TOML files share: unknown keys refused by name, numbers with their unit and bounds."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

# Bounds far beyond any board: a typo is refused where it stands instead of overflowing or running for hours.
Millimetres = Annotated[float, Field(gt=0, le=10_000)]
Micrometres = Annotated[float, Field(gt=0, le=100_000)]
LimitMillimetres = Annotated[float, Field(ge=0, le=10_000)]
Position = Annotated[float, Field(ge=-100_000, le=100_000)]
Degrees = Annotated[float, Field(ge=-36_000, le=36_000)]
Picofarads = Annotated[float, Field(ge=1e-6, le=1e12)]
StrayPicofarads = Annotated[float, Field(ge=0, le=1e6)]
Nanohenries = Annotated[float, Field(ge=0, le=1e9)]
Ohms = Annotated[float, Field(ge=0, le=1e9)]
LoadOhms = Annotated[float, Field(gt=0, le=1e9)]
Resistivity = Annotated[float, Field(ge=1e-10, le=1.0)]
Relative = Annotated[float, Field(ge=1, le=1e6)]
Turns = Annotated[float, Field(gt=0, le=1000)]
Kilopascals = Annotated[float, Field(ge=1e-6, le=1e9)]
PoissonsRatio = Annotated[float, Field(ge=0, le=0.5)]
HalfAngle = Annotated[float, Field(gt=0, lt=90)]
StepMillimetres = Annotated[float, Field(ge=1e-3, le=10_000)]
Point = Annotated[list[Position], Field(min_length=2, max_length=2)]
Positions = Annotated[list[Position], Field(min_length=1, max_length=100_000)]
Range = Annotated[list[Position], Field(min_length=2, max_length=2)]
Name = Annotated[str, Field(min_length=1, pattern=r"^[A-Za-z0-9_.+][A-Za-z0-9_.+-]*$")]


class Table(BaseModel):
    """A table of the file: unknown keys, wrong types and numbers that are not finite are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False, validate_default=True)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, table: object) -> object:
        """Name the allowed keys beside an unknown one, which `extra="forbid"` alone does not."""
        known = sorted(field.alias or name for name, field in cls.model_fields.items())
        for key in table if isinstance(table, Mapping) else ():
            if key not in known:
                close = difflib.get_close_matches(str(key), known, n=1)
                hint = f"did you mean {close[0]}? " if close else ""
                raise PydanticCustomError(
                    "unknown_key", "{hint}", {"hint": f"has no key {key!r}; {hint}Allowed are {', '.join(known)}"}
                )
        return table
