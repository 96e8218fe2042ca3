"""Files of the options --settings and --plan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import Field, model_validator

from coilarray.design.keys import Name, Table
from coilarray.design.toml_file import TomlFiles
from coilarray.errors import HardwareError

_Drive = Annotated[int, Field(ge=0, le=31)]
_Row = Annotated[list[float], Field(min_length=1, max_length=1000)]
_Ends = Annotated[list[float], Field(min_length=2, max_length=2)]
_Count = Annotated[int, Field(ge=1, le=1000)]
_File = TypeVar("_File", bound=Table)


class BoardSettings(Table):
    """Settings of a board, all of them optional."""

    coils: list[Name] | None = None
    """Coils at the channels of the port, in that order.

    They are needed if the design has more coils than the port has channels.
    """
    states: list[Name] | None = None
    """States of the scan to measure, by default all."""
    clock: Annotated[float, Field(gt=0)] | None = Field(alias="clock_MHz", default=None)
    """Clock of the converter, measured or external.

    By default it is the port's, or 43.4, typical of the internal oscillator. It may be as low as
    35, so that scans take a quarter longer while the clock is not given.
    """
    external_clock: bool = False
    """Whether the clock is external, at the pin CLKIN."""
    discard: Annotated[int, Field(ge=0, le=15)] = 0
    """Conversions of each state to discard after the converter wakes."""
    drive: _Drive | None = None
    """Drive current (IDRIVE) of all coils, by default the design's."""
    drives: dict[Name, _Drive] = Field(default_factory=dict)
    """Drive currents of single coils."""
    thermometer: Annotated[str, Field(min_length=1)] | None = None
    """File of a thermometer, read once a second and recorded.

    It is hwmon, a thermal zone or the 1-wire bus of Linux (in 0.001 °C), or any file with a number
    that has a decimal point (in °C). The emulator has its own.
    """
    allow_violations: bool = False
    """Whether the design may break a fabrication rule.

    The inductance of overlapping traces is not meaningful.
    """
    baseline_scans: Annotated[int, Field(ge=2, le=100_000)] = 10
    """First scans of a live display, without an indentation, as baseline."""
    noise: Annotated[float, Field(gt=0, le=1)] | None = None
    """Standard deviation of δ beside the scatter of live readings.

    It is independent for each coil. By default it is the noise budget's standard deviation of
    changes since the baseline, independent and common to all.
    """
    replay_speed: Annotated[float, Field(ge=0, le=1000)] = 1.0
    """Speed of a replay: 1 as recorded, 0 without waiting."""

    @model_validator(mode="after")
    def _clock_is_known(self) -> BoardSettings:
        if self.external_clock and self.clock is None:
            raise ValueError(" must have clock_MHz beside external_clock")
        return self


class StageTable(Table):
    """``[stage]``: a machine for G-code, x and y on the board, z = 0 at contact."""

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
    """Height over the sheets in travel and for baselines."""
    home: bool = False
    """Whether to home it first, $H of GRBL or G28 of Marlin.

    It is needed where it restarts as its port opens.
    """


class CampaignPlan(Table):
    """Grid and sequence of a campaign, by default the design's."""

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
    """Mover of the indenter, by default a person with prompts."""


def read_file(model: type[_File], kind: str, path: Path | None) -> _File:
    """Read a file of --settings or --plan, by default the defaults."""
    files = TomlFiles(kind, HardwareError)
    return model() if path is None else files.check(model, files.parse(files.text(path), str(path)), str(path))
