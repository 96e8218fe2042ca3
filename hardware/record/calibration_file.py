"""TOML file with the constants of a board.

The keys have units in their names. The values have full precision and are checked on reading. A file of
`save_calibration` ends in a checksum of the whole file. A file that a person wrote has ``checksum = "none"`` instead.
"""

from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import Field

from coilarray.compute.checksum import sealed, unsealed
from coilarray.compute.files import write_bytes
from coilarray.design.keys import Table
from coilarray.design.toml_file import TomlFiles
from coilarray.errors import DamagedError, HardwareError
from coilarray.hardware.record.baseline_drift import HIGHEST_ORDER, Drift
from coilarray.hardware.record.channel_calibration import BoardCalibration, Channel, ClockFrom, InductancesFrom

SCHEMA = 1
"""Version of the format."""

_KIND = "coilarray board calibration"
_CALIBRATIONS = TomlFiles("calibration", HardwareError)
_BY_HAND = re.compile(r'^checksum\s*=\s*"none"', re.MULTILINE)


def calibration_to_toml(calibration: BoardCalibration) -> str:
    """Return the constants of a board as TOML.

    `calibration_from_toml` reads the text without loss.

    Examples
    --------
    >>> calibration = BoardCalibration("by hand", "2025-01-01", "XMC 2Go", False, "", 43.2e6, None, "settings")
    >>> calibration_from_toml(calibration_to_toml(calibration)) == calibration
    True
    """
    document = {
        "schema": SCHEMA,
        "kind": _KIND,
        "source": calibration.source,
        "made": calibration.made,
        "board": calibration.board,
        "emulated": calibration.emulated,
        "design_hash": calibration.design_hash,
        "clock": {
            "frequency_Hz": calibration.clock,
            "from": calibration.clock_from,
            "standard_error_Hz": calibration.clock_error,
        },
        "capacitances_from": calibration.inductances_from,
        "channel": [channel_record(channel) for channel in calibration.channels],
        "drift": [_keyed(_Drift, {**asdict(drift), "boot": f"{drift.boot:08X}"}) for drift in calibration.drifts],
    }
    return tomli_w.dumps(_without_nothing(document))


def calibration_from_toml(text: str, origin: str = "calibration") -> BoardCalibration:
    """Read the constants of a board from TOML.

    `origin` names the file in messages. A HardwareError is raised for text that is not TOML or of another kind, an
    unknown or missing key, or a value outside its range. Its message is one line with the key, the given value and the
    allowed values.
    """
    document = _CALIBRATIONS.parse(text, origin)
    if document.get("kind") != _KIND:
        raise HardwareError(f'{origin} is not a calibration of a board: it must have kind = "{_KIND}".')
    file = _CALIBRATIONS.check(_File, document, origin)
    try:
        return file.build()
    except HardwareError as error:
        raise HardwareError(f"{origin}: {error}") from None


def save_calibration(calibration: BoardCalibration, path: Path) -> None:
    """Write the constants of a board with a checksum.

    A failure raises an OutputError.
    """
    write_bytes(path, sealed(calibration_to_toml(calibration).encode()))


def load_calibration(path: str | Path) -> BoardCalibration:
    """Read a file with the constants of a board.

    A HardwareError is raised for a file that cannot be read, is invalid, does not match its checksum, or has lost its
    last line.
    """
    text = _CALIBRATIONS.text(path)
    try:
        unsealed(text.encode(), path)
    except DamagedError as error:
        if _BY_HAND.search(text) is None:
            raise HardwareError(f'{error} Where a person wrote it, checksum = "none" must be its first line.') from None
    return calibration_from_toml(text, str(path))


def channel_record(channel: Channel) -> dict[str, Any]:
    """Return a channel under the keys of the file.

    The keys have the units in their names.
    """
    return _keyed(_Channel, asdict(channel))


def _keyed(table: type[Table], values: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a table under the file's keys."""
    return {field.alias or name: values[name] for name, field in table.model_fields.items()}


def _without_nothing(document: dict[str, Any]) -> dict[str, Any]:
    """Leave out keys without a value, and empty tables."""
    return {
        key: _without_nothing(value) if isinstance(value, dict) else value
        for key, value in document.items()
        if value is not None and value != []
    }


_Name = Annotated[str, Field(min_length=1, max_length=200)]
_Text = Annotated[str, Field(max_length=2000)]
_Positive = Annotated[float, Field(gt=0)]
_Count = Annotated[int, Field(ge=0, le=1_000_000)]


class _Clock(Table):
    """``[clock]``: the frequency that the converter counts with."""

    frequency: _Positive = Field(alias="frequency_Hz")
    """Clock of the converter."""
    standard_error: Annotated[float, Field(ge=0)] | None = Field(alias="standard_error_Hz", default=None)
    """Its standard error."""
    origin: ClockFrom = Field(alias="from")
    """Where it is from."""


class _Channel(Table):
    """``[[channel]]``: the tank of one state of the scan."""

    state: _Name
    """State of the scan."""
    capacitance: _Positive = Field(alias="capacitance_F")
    """Capacitance of its tank."""
    standard_error: Annotated[float, Field(ge=0)] = Field(alias="standard_error_F")
    """Its standard error."""
    inductance: _Positive = Field(alias="inductance_H")
    """Inductance with which it was found."""


class _Drift(Table):
    """``[[drift]]``: how the inductance of one state moved in one session while nothing pressed."""

    session: _Count
    """Session of the recording."""
    boot: Annotated[str, Field(pattern=r"^[0-9A-F]{8}$")]
    """Number of the board's session."""
    started: float = Field(alias="started_s")
    """When the session began, in seconds since the epoch."""
    state: _Name
    """State of the scan."""
    start: float = Field(alias="start_s")
    """Time of the first scan at rest, from the first scan of the recording."""
    stop: float = Field(alias="stop_s")
    """Time of the last one."""
    gap: Annotated[float, Field(ge=0)] = Field(alias="gap_s")
    """Longest time between two of them; by so much the curve may be extrapolated."""
    inductance: _Positive = Field(alias="inductance_H")
    """Inductance at rest in the middle of that time."""
    coefficients: Annotated[list[float], Field(min_length=1, max_length=HIGHEST_ORDER)]
    """Coefficients of the polynomial of its relative change, over −1 to 1."""
    covariance: Annotated[list[list[float]], Field(max_length=HIGHEST_ORDER + 1)]
    """Their covariance, with the inductance's."""
    scatter: Annotated[float, Field(ge=0)]
    """Relative standard deviation of one scan about the curve."""
    smooth: bool
    """Whether the scans scatter about the curve randomly; else no such curve describes the drift."""

    def build(self) -> Drift:
        """Return the drift."""
        covariance = tuple(tuple(row) for row in self.covariance)
        own = {"boot": int(self.boot, 16), "coefficients": tuple(self.coefficients), "covariance": covariance}
        return Drift(**{**self.model_dump(), **own})


class _File(Table):
    """The whole file."""

    schema_: Annotated[int, Field(ge=SCHEMA, le=SCHEMA)] = Field(alias="schema")
    """Version of the file format."""
    kind: Literal["coilarray board calibration"]
    """What the file is."""
    checksum: Literal["none"] | None = None
    """Given where a person wrote or changed the file, which then needs no last line with a checksum."""
    source: _Text
    """Recording that it is from."""
    made: _Text
    """When it was made."""
    board: _Text
    """Board that was measured."""
    emulated: bool
    """Whether the board was emulated."""
    design_hash: _Text
    """Hash of the design that was measured."""
    clock: _Clock
    capacitances_from: InductancesFrom | None = None
    """Inductances with which the capacitances were found."""
    channel: Annotated[list[_Channel], Field(max_length=1000)] = Field(default_factory=list)
    drift: Annotated[list[_Drift], Field(max_length=100_000)] = Field(default_factory=list)

    def build(self) -> BoardCalibration:
        """Return the constants."""
        return BoardCalibration(
            source=self.source,
            made=self.made,
            board=self.board,
            emulated=self.emulated,
            design_hash=self.design_hash,
            clock=self.clock.frequency,
            clock_error=self.clock.standard_error,
            clock_from=self.clock.origin,
            inductances_from=self.capacitances_from,
            channels=tuple(Channel(**channel.model_dump()) for channel in self.channel),
            drifts=tuple(drift.build() for drift in self.drift),
        )
