"""Settings of a scan in JSON, as in recordings.

The tables define the allowed values.
"""

from __future__ import annotations

import json
from typing import Annotated, Any

from pydantic import Field, ValidationError

from coilarray.design.keys import Table
from coilarray.design.readout import INTERNAL_CLOCK
from coilarray.design.toml_file import first_error
from coilarray.errors import HardwareError
from coilarray.hardware.chips.converters import Family
from coilarray.hardware.chips.ldc1614 import (
    CHANNELS,
    EXTERNAL_CLOCK_RANGE,
    INTERNAL_CLOCK_RANGE,
    MOST_DISCARDED,
)

SCHEMA = 2
"""Version of the settings in JSON. Version 1 waited for the nominal clock."""
MOST_STATES = 255
"""Largest number of states of a scan."""


def settings_values(text: str) -> tuple[dict[str, Any], str]:
    """Return the values of `ScanSettings` and their given hash.

    See `coilarray.hardware.scan.settings.ScanSettings`. Text that is not JSON, or a value outside its range, raises a
    HardwareError.
    """
    try:
        document = json.loads(text)
        file = _File.model_validate(document)
    except ValidationError as error:  # it is a ValueError too
        raise HardwareError(f"scan settings: {first_error(error, document)}") from None
    except (ValueError, RecursionError) as error:
        raise HardwareError(f"scan settings: not valid JSON: {error}.") from None
    return file.values(), file.hash


_Code = Annotated[int, Field(ge=0, le=0xFFFF)]
_Words = Annotated[str, Field(pattern=r"^([0-9a-f]{2})*$", max_length=4096)]


class _StateTable(Table):
    """One state in JSON."""

    name: str
    words: _Words
    drive: Annotated[int, Field(ge=0, le=31)]
    channel: Annotated[int, Field(ge=0, lt=CHANNELS)] = 0
    settle_count: _Code | None = None
    fin_divider: _Code | None = None


class _File(Table):
    """Settings in JSON."""

    schema_: Annotated[int, Field(ge=1, le=SCHEMA)] = Field(alias="schema")
    hash: Annotated[str, Field(pattern=r"^[0-9A-F]{4}$")]
    states: Annotated[list[_StateTable], Field(min_length=1, max_length=MOST_STATES)]
    safe_words: _Words
    wiring: _Words
    clock: Annotated[float, Field(ge=EXTERNAL_CLOCK_RANGE[0], le=INTERNAL_CLOCK_RANGE[1])]
    external_clock: bool
    rcount: _Code
    settle_count: _Code
    fin_divider: _Code
    fref_divider: Annotated[int, Field(ge=1, le=0x3FF)]
    offset: _Code
    deglitch: _Code
    slowest_clock: Annotated[float, Field(gt=0, le=INTERNAL_CLOCK_RANGE[1])] | None = None
    discard: Annotated[int, Field(ge=0, le=MOST_DISCARDED)] = 0
    scanned: Annotated[int, Field(ge=1, le=CHANNELS)] = 1
    family: Family = "LDC"

    def values(self) -> dict[str, Any]:
        """Return the values of `ScanSettings`.

        Its states have the values of `StateSettings`.
        """
        own = self.model_dump(exclude={"schema_", "hash"})
        if self.slowest_clock is None:
            own["slowest_clock"] = INTERNAL_CLOCK if self.external_clock else self.clock
        for table, name in ((own, "safe_words"), (own, "wiring"), *((state, "words") for state in own["states"])):
            table[name] = bytes.fromhex(table[name])
        return own
