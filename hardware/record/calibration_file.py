"""The file of a board's constants: TOML, units in the names of the keys, full precision, checked when it is read."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import Field

from coilarray.design.toml_file import TomlFiles
from coilarray.design.units import Table
from coilarray.errors import HardwareError
from coilarray.hardware.record.baseline_drift import HIGHEST_ORDER, Drift
from coilarray.hardware.record.channel_calibration import BoardCalibration, Channel, ClockFrom, InductancesFrom

SCHEMA = 1
"""Version of the format."""

_KIND = "coilarray board calibration"
_CALIBRATIONS = TomlFiles("calibration", HardwareError)
_MOST_BYTES = 10_000_000


def calibration_to_toml(calibration: BoardCalibration) -> str:
    """Write the constants of a board.

    Parameters
    ----------
    calibration : BoardCalibration

    Returns
    -------
    str
        Read back by `calibration_from_toml`, every number as it was.

    Examples
    --------
    >>> calibration = BoardCalibration("by hand", "2025-01-01", "XMC 2Go", False, "", 43.2e6, None, "settings")
    >>> calibration_from_toml(calibration_to_toml(calibration)) == calibration
    True
    """
    clock: dict[str, object] = {"frequency_Hz": calibration.clock, "from": calibration.clock_from}
    if calibration.clock_error is not None:
        clock["standard_error_Hz"] = calibration.clock_error
    document: dict[str, object] = {
        "schema": SCHEMA,
        "kind": _KIND,
        "source": calibration.source,
        "made": calibration.made,
        "board": calibration.board,
        "emulated": calibration.emulated,
        "design_hash": calibration.design_hash,
        "clock": clock,
    }
    if calibration.inductances_from is not None:
        document["capacitances_from"] = calibration.inductances_from
    document["channel"] = [
        {
            "state": channel.state,
            "capacitance_F": channel.capacitance,
            "standard_error_F": channel.standard_error,
            "inductance_H": channel.inductance,
        }
        for channel in calibration.channels
    ]
    document["drift"] = [
        {
            "session": drift.session,
            "boot": f"{drift.boot:08X}",
            "started_s": drift.started,
            "state": drift.state,
            "start_s": drift.start,
            "stop_s": drift.stop,
            "gap_s": drift.gap,
            "inductance_H": drift.inductance,
            "coefficients": list(drift.coefficients),
            "covariance": [list(row) for row in drift.covariance],
            "scatter": drift.scatter,
            "smooth": drift.smooth,
        }
        for drift in calibration.drifts
    ]
    return tomli_w.dumps({key: value for key, value in document.items() if value != []})


def calibration_from_toml(text: str, origin: str = "calibration") -> BoardCalibration:
    """Read what `calibration_to_toml` wrote.

    Parameters
    ----------
    text : str
        Of the file.
    origin : str
        Names it in messages.

    Returns
    -------
    BoardCalibration

    Raises
    ------
    HardwareError
        Text that is no TOML or of another kind, an unknown or missing key, a value outside its range: one line that
        names the key, what was given and what is allowed.
    """
    document = _CALIBRATIONS.parse(text, origin)
    if document.get("kind") != _KIND:
        raise HardwareError(f'{origin} is no calibration of a board: it must have kind = "{_KIND}".')
    file = _CALIBRATIONS.check(_File, document, origin)
    try:
        return file.build()
    except HardwareError as error:
        raise HardwareError(f"{origin}: {error}") from None


def load_calibration(path: str | Path) -> BoardCalibration:
    """Read a file of a board's constants.

    Raises
    ------
    HardwareError
        A file that cannot be read, and what `calibration_from_toml` refuses.
    """
    with suppress(OSError, ValueError):  # reading says why it cannot be read
        if Path(path).stat().st_size > _MOST_BYTES:
            raise HardwareError(f"{path} must be at most {_MOST_BYTES} bytes long.")
    return calibration_from_toml(_CALIBRATIONS.text(path), str(path))


_Name = Annotated[str, Field(min_length=1, max_length=200)]
_Text = Annotated[str, Field(max_length=2000)]
_Positive = Annotated[float, Field(gt=0)]
_Count = Annotated[int, Field(ge=0, le=1_000_000)]


class _Clock(Table):
    """[clock]."""

    frequency: _Positive = Field(alias="frequency_Hz")
    standard_error: Annotated[float, Field(ge=0)] | None = Field(alias="standard_error_Hz", default=None)
    origin: ClockFrom = Field(alias="from")


class _Channel(Table):
    """[[channel]]."""

    state: _Name
    capacitance: _Positive = Field(alias="capacitance_F")
    standard_error: Annotated[float, Field(ge=0)] = Field(alias="standard_error_F")
    inductance: _Positive = Field(alias="inductance_H")


class _Drift(Table):
    """[[drift]]."""

    session: _Count
    boot: Annotated[str, Field(pattern=r"^[0-9A-F]{8}$")]
    started: float = Field(alias="started_s")
    state: _Name
    start: float = Field(alias="start_s")
    stop: float = Field(alias="stop_s")
    gap: Annotated[float, Field(ge=0)] = Field(alias="gap_s")
    inductance: _Positive = Field(alias="inductance_H")
    coefficients: Annotated[list[float], Field(min_length=1, max_length=HIGHEST_ORDER)]
    covariance: Annotated[list[list[float]], Field(max_length=HIGHEST_ORDER + 1)]
    scatter: Annotated[float, Field(ge=0)]
    smooth: bool

    def build(self) -> Drift:
        """Return the drift."""
        own: dict[str, Any] = self.model_dump()
        own["boot"] = int(self.boot, 16)
        own["coefficients"] = tuple(self.coefficients)
        own["covariance"] = tuple(tuple(row) for row in self.covariance)
        return Drift(**own)


class _File(Table):
    """The whole file."""

    schema_: Annotated[int, Field(ge=SCHEMA, le=SCHEMA)] = Field(alias="schema")
    kind: Literal["coilarray board calibration"]
    source: _Text
    made: _Text
    board: _Text
    emulated: bool
    design_hash: _Text
    clock: _Clock
    capacitances_from: InductancesFrom | None = None
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
