"""Clock and tank capacitances of a board, and their file.

δ, a ratio of inductances, depends on neither. Clock and capacitance give L its scale. A file of
`save_calibration` ends in a checksum of the whole file. A file that a person wrote has ``checksum =
"none"`` instead.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tomli_w
import xarray as xr
from pydantic import Field, model_validator

from coilarray.compute.files import sealed, unsealed, write_bytes
from coilarray.design.keys import Table
from coilarray.design.toml_file import TomlFiles
from coilarray.errors import DamagedError, HardwareError, require_positive
from coilarray.hardware.chips.ldc1614 import EXTERNAL_CLOCK_RANGE, INTERNAL_CLOCK_RANGE
from coilarray.hardware.record.recorded_response import at_rest, recorded_response, recorded_series
from coilarray.hardware.record.recording import Recording
from coilarray.response.map import Imperfections, response_map

CAPACITANCES = (1e-12, 1e-6)  # least and greatest plausible capacitance of a tank in F
CLOCKS = (min(EXTERNAL_CLOCK_RANGE[0], INTERNAL_CLOCK_RANGE[0]), INTERNAL_CLOCK_RANGE[1])
"""Lowest and highest clock of a converter in Hz."""

_LEAST_SCANS = 2  # at rest, for a standard error
_KIND = "coilarray board calibration"
_CALIBRATIONS = TomlFiles("calibration", HardwareError)
_BY_HAND = re.compile(r'^checksum\s*=\s*"none"', re.MULTILINE)
_Text = Annotated[str, Field(max_length=2000)]
_NotNegative = Annotated[float, Field(ge=0)]


class Channel(Table):
    """Tank of one state.

    Losses and an error of the clock count as capacitance, so that the lossless L = 1/((2πf)² C) is
    right.
    """

    state: Annotated[str, Field(min_length=1, max_length=200)]
    """State of the scan."""
    capacitance: Annotated[float, Field(ge=CAPACITANCES[0], le=CAPACITANCES[1])] = Field(alias="capacitance_F")
    """Capacitance across the coil."""
    standard_error: _NotNegative = Field(alias="standard_error_F")
    """Its standard error, from the scatter of the frequency and the error of the inductance."""
    inductance: Annotated[float, Field(gt=0)] = Field(alias="inductance_H")
    """Inductance with which it was found."""


class BoardCalibration(Table):
    """Constants of a board, as its file has them.

    The capacitances follow from known inductances or from the simulated design. With the latter,
    measured and simulated L agree by construction, which is not a test.
    """

    schema_: Literal[1] = Field(alias="schema", default=1)
    """Version of the file format."""
    kind: Literal["coilarray board calibration"] = "coilarray board calibration"
    """Kind of the file."""
    checksum: Literal["none"] | None = None
    """Given if a person wrote or changed the file, which then needs no checksum."""
    source: _Text = ""
    """Command that made it."""
    made: _Text = ""
    """Date and time, as ISO 8601."""
    board: _Text
    """Board that was measured."""
    emulated: bool
    """Whether the board was emulated."""
    design_hash: _Text
    """Hash of the design that was measured."""
    clock: Annotated[float, Field(ge=CLOCKS[0], le=CLOCKS[1])] = Field(alias="clock_Hz")
    """Clock of the converter."""
    clock_error: _NotNegative | None = Field(alias="clock_standard_error_Hz", default=None)
    """Its standard error, None if the clock is taken from the settings."""
    clock_from: Literal["settings", "known frequency"]
    """Source of the clock."""
    capacitances_from: Literal["known inductances", "design"] | None = None
    """Source of the inductances with which the capacitances were found."""
    channels: Annotated[list[Channel], Field(max_length=1000)] = Field(default_factory=list)
    """Tanks, none if no inductances were given."""

    @model_validator(mode="after")
    def _states_differ(self) -> BoardCalibration:
        if len(self.capacitances) < len(self.channels):
            raise ValueError(" must have a state of its own for each of its channels")
        if bool(self.channels) != (self.capacitances_from is not None):
            raise ValueError(" must have capacitances_from if it has channels, and only then")
        return self

    @property
    def capacitances(self) -> dict[str, float]:
        """Capacitances in F by state."""
        return {channel.state: channel.capacitance for channel in self.channels}


def calibrate_board(
    recording: Recording,
    *,
    inductances: Mapping[str, float] | None = None,
    inductance_error: float = 0.0,
    from_design: bool = False,
    known_frequency: tuple[str, float] | None = None,
    frequency_error: float = 0.0,
    source: str = "",
    made: str = "",
) -> BoardCalibration:
    """Calibrate a board with a recording's scans at rest."""
    if inductances is not None and from_design:
        raise HardwareError("inductances must be either known or simulated, not both.")
    series = recorded_series(recording)
    rest = series.frequency.values[at_rest(series)]

    def frequency_of(state: str) -> tuple[float, float]:
        """Mean frequency of a state in Hz with relative error."""
        if state not in recording.states:
            raise HardwareError(f"{recording.path} has no state {state!r}; there are {', '.join(recording.states)}.")
        values = rest[:, recording.states.index(state)]
        values = values[np.isfinite(values)]
        if len(values) < _LEAST_SCANS:
            raise HardwareError(f"{recording.path} must have at least {_LEAST_SCANS} good scans of {state} at rest.")
        mean = float(values.mean())
        return mean, float(values.std(ddof=1) / math.sqrt(len(values))) / mean

    session = recording.sessions[0]
    ratio, clock_error = 1.0, None
    if known_frequency is not None:
        state, known = known_frequency
        require_positive("a known frequency", known, " Hz", HardwareError)
        read, error = frequency_of(state)
        ratio = known / read
        clock_error = session.settings.clock * ratio * math.hypot(error, frequency_error)
    if from_design:
        inductances = simulated_inductances(recording)
    channels = []
    for state, inductance in (inductances or {}).items():
        require_positive(f"inductance of {state}", inductance, " H", HardwareError)
        read, error = frequency_of(state)
        capacitance = 1 / ((2 * math.pi * read * ratio) ** 2 * inductance)
        deviation = capacitance * math.hypot(2 * error, inductance_error)
        keys = {"capacitance_F": capacitance, "standard_error_F": deviation, "inductance_H": inductance}
        channels.append({"state": state, **keys})
    document = {
        "source": source,
        "made": made,
        "board": session.identity.kind,
        "emulated": recording.emulated,
        "design_hash": session.design_hash,
        "clock_Hz": session.settings.clock * ratio,
        "clock_standard_error_Hz": clock_error,
        "clock_from": "settings" if known_frequency is None else "known frequency",
        "capacitances_from": None if not channels else "design" if from_design else "known inductances",
        "channels": channels,
    }
    return _CALIBRATIONS.check(BoardCalibration, document, str(recording.path))


def calibrated_response(recording: Recording, calibration: BoardCalibration, *, partial: bool = False) -> xr.Dataset:
    """Return the response of a campaign with the board's calibration."""
    # Its attributes `calibration`, `calibration_board` and `capacitance_from` are sources.
    if calibration.emulated != recording.emulated:
        kinds = ("a real", "an emulated")
        raise HardwareError(
            f"the calibration is of {kinds[calibration.emulated]} board, {recording.path} of "
            f"{kinds[recording.emulated]} one."
        )
    session = recording.sessions[0]
    if calibration.design_hash != session.design_hash:
        raise HardwareError(
            f"the calibration is of a board with the design {calibration.design_hash[:12] or 'unknown'}, "
            f"{recording.path} of one with {session.design_hash[:12]}."
        )
    capacitances = {**session.capacitances, **calibration.capacitances}
    response = recorded_response(recording, capacitances=capacitances, clock=calibration.clock, partial=partial)
    said = {"calibration": calibration.source, "calibration_board": calibration.board}
    if calibration.capacitances_from is not None:
        said["capacitance_from"] = calibration.capacitances_from
    return response.assign_attrs(said)


def simulated_inductances(recording: Recording) -> dict[str, float]:
    """Return the simulated L_0 in H of every recorded state."""
    # an ideal circuit, so that all strays count as capacitance
    design, setup = recording.design, recording.design.indentation
    if setup is None:
        raise HardwareError(
            f"the design {design.name} has no [indenter] and [indentation], and so no simulated response; "
            "give known inductances."
        )
    depths, x, y = (axis[len(axis) // 2 : len(axis) // 2 + 1] for axis in (setup.depths, setup.x, setup.y))
    ideal = Imperfections(network="ideal")
    base = response_map(design, depths=depths, x=x, y=y, imperfections=ideal).base_inductance
    return {state: float(base.sel(state=state)) for state in recording.states}


def calibration_to_toml(calibration: BoardCalibration) -> str:
    """Return the constants of a board as TOML."""
    return tomli_w.dumps(calibration.model_dump(by_alias=True, exclude_none=True))


def save_calibration(calibration: BoardCalibration, path: Path) -> None:
    """Write the constants of a board with a checksum."""
    write_bytes(path, sealed(calibration_to_toml(calibration).encode()))


def load_calibration(path: str | Path) -> BoardCalibration:
    """Read a file with the constants of a board."""
    text = _CALIBRATIONS.text(path)
    try:
        unsealed(text.encode(), path)
    except DamagedError as error:
        if _BY_HAND.search(text) is None:
            raise HardwareError(f'{error} If a person wrote it, checksum = "none" must be its first line.') from None
    document = _CALIBRATIONS.parse(text, str(path))
    if document.get("kind") != _KIND:
        raise HardwareError(f'{path} is not a calibration of a board: it must have kind = "{_KIND}".')
    return _CALIBRATIONS.check(BoardCalibration, document, str(path))
