"""Files of the options --settings of a board and --plan of a campaign."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from coilarray.design.keys import Name, Table
from coilarray.design.toml_file import TomlFiles
from coilarray.errors import HardwareError

_SETTINGS, _PLANS = TomlFiles("settings", HardwareError), TomlFiles("plan", HardwareError)
_Drive = Annotated[int, Field(ge=0, le=31)]
_Row = Annotated[list[float], Field(min_length=1, max_length=1000)]
_Ends = Annotated[list[float], Field(min_length=2, max_length=2)]
_Count = Annotated[int, Field(ge=1, le=1000)]


class BoardSettings(Table):
    """Settings of a board, all of them optional."""

    coils: list[Name] | None = None
    """Coils at the channels of the port, in that order; needed if the design has more coils than the port channels."""
    states: list[Name] | None = None
    """States of the scan to measure; all of them by default."""
    clock: Annotated[float, Field(gt=0)] | None = Field(alias="clock_MHz", default=None)
    """Clock of the converter, measured or external. By default that of the port, or 43.4, typical of the internal
    oscillator. It may be as low as 35, so that scans take a quarter longer while the clock is not given."""
    external_clock: bool = False
    """Whether the clock is an external one, at the pin CLKIN."""
    discard: Annotated[int, Field(ge=0, le=15)] = 0
    """Conversions of each state to discard after the converter wakes."""
    drive: _Drive | None = None
    """Drive current (IDRIVE) of all coils; from the design by default."""
    drives: dict[Name, _Drive] = Field(default_factory=dict)
    """Drive currents of single coils."""
    thermometer: Annotated[str, Field(min_length=1)] | None = None
    """File of a thermometer, read once a second and recorded: hwmon, a thermal zone or the 1-wire bus of Linux (in
    0.001 °C), or any file with a number that has a decimal point (in °C). The emulator has its own."""
    allow_violations: bool = False
    """Whether the design may break a fabrication rule; the inductance of overlapping traces is not meaningful."""
    baseline_scans: Annotated[int, Field(ge=2, le=100_000)] = 10
    """First scans of a live display, without an indentation, that are the baseline of δ."""
    noise: Annotated[float, Field(gt=0, le=1)] | None = None
    """Standard deviation of δ in addition to the scatter of the readings of a live display, independent for each coil.
    By default that of changes since the baseline in the noise budget, independent and common to all."""
    replay_speed: Annotated[float, Field(ge=0, le=1000)] = 1.0
    """Speed of a replay by a live display: 1 as recorded, 0 as fast as possible."""

    @model_validator(mode="after")
    def _clock_is_known(self) -> BoardSettings:
        if self.external_clock and self.clock is None:
            raise ValueError(" must have clock_MHz beside external_clock")
        return self


def read_settings(path: Path | None) -> BoardSettings:
    """Read a settings file; the defaults without one."""
    if path is None:
        return BoardSettings()
    return _SETTINGS.check(BoardSettings, _SETTINGS.parse(_SETTINGS.text(path), str(path)), str(path))


class StageTable(Table):
    """``[stage]``: a machine that takes G-code, with x and y on the board and z = 0 at contact."""

    machine: Literal["grbl", "marlin"]
    """Its firmware."""
    port: Annotated[str, Field(min_length=1)]
    """Its serial port."""
    x: _Ends = Field(alias="x_mm")
    """Least and greatest x of its travel, on the board."""
    y: _Ends = Field(alias="y_mm")
    """Least and greatest y of its travel."""
    depth: Annotated[float, Field(gt=0, le=100)] = Field(alias="depth_mm")
    """Greatest depth below the point of contact."""
    clearance: Annotated[float, Field(gt=0, le=100)] = Field(alias="clearance_mm", default=2.0)
    """Height over the sheets at which it travels and the baselines are measured."""
    home: bool = False
    """Whether to home it first, $H of GRBL or G28 of Marlin; needed where it restarts as its port opens."""


class CampaignPlan(Table):
    """Grid and sequence of a campaign, all of it optional: the design has a grid of its own."""

    x: _Row | None = Field(alias="x_mm", default=None)
    """Positions along x on the board, rising."""
    y: _Row | None = Field(alias="y_mm", default=None)
    """Positions along y, likewise."""
    depths: _Row | None = Field(alias="depth_mm", default=None)
    """Depths of the indentations, rising."""
    repeats: _Count = 1
    """Number of passes over the whole grid."""
    average: _Count = 1
    """Number of scans at every baseline and every peak."""
    dwell: Annotated[float, Field(ge=0, le=3600)] = Field(alias="dwell_s", default=0.5)
    """Wait at full depth before the peak is measured."""
    speed: Annotated[float, Field(gt=0, le=100)] = Field(alias="speed_mm_s", default=1.5)
    """Speed of the indenter, down and up."""
    stage: StageTable | None = None
    """What moves the indenter; a person, prompted for every position, by default."""


def read_plan(path: Path | None) -> CampaignPlan:
    """Read the plan of a campaign; that of the design without one."""
    if path is None:
        return CampaignPlan()
    return _PLANS.check(CampaignPlan, _PLANS.parse(_PLANS.text(path), str(path)), str(path))
