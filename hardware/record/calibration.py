"""Constants of a board: clock, tank capacitances and drift, from a recording, and their TOML file.

The drift belongs to a recording. δ, a ratio of frequencies, depends only on the drift. Clock and capacitance give L its
scale. The keys of the file have units in their names. A file of `save_calibration` ends in a checksum of the whole
file. A file that a person wrote has ``checksum = "none"`` instead.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tomli_w
import xarray as xr
from pydantic import Field

from coilarray.compute.checksum import sealed, unsealed
from coilarray.compute.files import write_bytes
from coilarray.design.keys import Table
from coilarray.design.toml_file import TomlFiles
from coilarray.errors import DamagedError, HardwareError, require_positive
from coilarray.hardware.chips.ldc1614 import EXTERNAL_CLOCK_RANGE, INTERNAL_CLOCK_RANGE
from coilarray.hardware.record.campaign import Campaign
from coilarray.hardware.record.recorded_response import recorded_response, recorded_series
from coilarray.hardware.record.recording import Recording
from coilarray.hardware.record.stability import HIGHEST_ORDER, Drift, at_rest, fit_drifts
from coilarray.response.map import response_map

ClockFrom = Literal["settings", "known frequency"]
InductancesFrom = Literal["known inductances", "design"]

CAPACITANCES = (1e-12, 1e-6)
"""Least and greatest plausible capacitance of a tank in F."""

_LEAST_SCANS = 2  # at rest, for a standard error
_MOST_ERROR = 0.5  # relative, of a known inductance or frequency


@dataclass(frozen=True)
class Channel:
    """Tank of one state.

    Losses and an error of the clock count as capacitance, so that L computed with it is right.
    """

    state: str
    capacitance: float  # across the coil in F; with the frequency at rest the lossless L = 1/((2πf)² C) is right
    standard_error: float  # F, from the scatter of the frequency and the known inductance
    inductance: float  # known inductance in H from which the capacitance was computed

    def __post_init__(self) -> None:
        """Raise HardwareError for an implausible value."""
        low, high = CAPACITANCES
        if not low <= self.capacitance <= high:
            raise HardwareError(
                f"capacitance_F of {self.state} must be {low * 1e12:g} to {high * 1e12:g} pF; "
                f"got {self.capacitance * 1e12:.4g} pF."
            )
        if not (math.isfinite(self.standard_error) and self.standard_error >= 0):
            raise HardwareError(f"standard_error_F of {self.state} must be finite and not negative.")
        require_positive(f"inductance_H of {self.state}", self.inductance, " H", HardwareError)


@dataclass(frozen=True)
class BoardCalibration:
    """Constants of a board.

    The capacitances follow from known inductances or from the simulated design. With the latter, measured and simulated
    L agree by construction, which is not a test.
    """

    source: str  # for readers
    made: str  # date and time, as ISO 8601
    board: str  # identity of the board
    emulated: bool
    design_hash: str
    clock: float  # of the converter in Hz
    clock_error: float | None  # standard error in Hz; None if the clock is taken from the settings
    clock_from: ClockFrom
    inductances_from: InductancesFrom | None = None
    channels: tuple[Channel, ...] = ()  # empty if no inductances were given
    drifts: tuple[Drift, ...] = field(default=())  # of the recording that the constants were computed from

    def __post_init__(self) -> None:
        """Raise HardwareError for an implausible or repeated value."""
        low, high = min(EXTERNAL_CLOCK_RANGE[0], INTERNAL_CLOCK_RANGE[0]), INTERNAL_CLOCK_RANGE[1]
        if not low <= self.clock <= high:
            raise HardwareError(
                f"the clock must be {low / 1e6:g} to {high / 1e6:g} MHz; got {self.clock / 1e6:.4g} MHz."
            )
        if self.clock_error is not None and not (math.isfinite(self.clock_error) and self.clock_error >= 0):
            raise HardwareError(f"the standard error of the clock must not be negative; got {self.clock_error} Hz.")
        for key, names in (
            ("[[channel]]", [one.state for one in self.channels]),
            ("[[drift]] of a session", [(one.session, one.state) for one in self.drifts]),
        ):
            if len(set(names)) < len(names):
                raise HardwareError(f"every {key} of a calibration must have a state of its own.")
        if bool(self.channels) != (self.inductances_from is not None):
            raise HardwareError(
                "capacitances_from must give the source of the capacitances if any [[channel]] has one."
            )

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
    order: int | None = None,
    source: str = "",
    made: str = "",
) -> BoardCalibration:
    """Calibrate a board with a recording's scans at rest."""
    if inductances is not None and from_design:
        raise HardwareError("inductances must be either known or simulated, not both.")
    for name, value in (("inductances", inductance_error), ("frequency", frequency_error)):
        if not 0 <= value <= _MOST_ERROR:
            raise HardwareError(f"the relative error of the {name} must be 0 to {_MOST_ERROR:g}; got {value:g}.")
    series = recorded_series(recording)
    read, read_error = _mean_frequencies(series)
    session = recording.sessions[0]
    ratio, clock_error = 1.0, None
    if known_frequency is not None:
        state, known = known_frequency
        ratio = _known("frequency", "Hz", known) / _of_state(read, state, recording)
        clock_error = session.settings.clock * ratio * math.hypot(read_error[state] / read[state], frequency_error)
    if from_design:
        inductances = simulated_inductances(recording)
    channels = []
    for state, inductance in (inductances or {}).items():
        frequency = _of_state(read, state, recording) * ratio
        capacitance = 1 / ((2 * math.pi * frequency) ** 2 * _known(f"inductance of {state}", "H", inductance))
        relative = math.hypot(2 * read_error[state] / read[state], inductance_error)
        channels.append(Channel(state, capacitance, capacitance * relative, inductance))
    capacitances = {**session.capacitances, **{channel.state: channel.capacitance for channel in channels}}
    return BoardCalibration(
        source=source,
        made=made,
        board=session.identity.kind,
        emulated=recording.emulated,
        design_hash=session.design_hash,
        clock=session.settings.clock * ratio,
        clock_error=clock_error,
        clock_from="settings" if known_frequency is None else "known frequency",
        inductances_from=None if not channels else "design" if from_design else "known inductances",
        channels=tuple(channels),
        drifts=fit_drifts(_with_inductances(series, capacitances, ratio), _sessions(recording), order=order),
    )


def calibrated_response(recording: Recording, calibration: BoardCalibration, *, partial: bool = False) -> xr.Dataset:
    """Return the measured response of a campaign, calibrated.

    It uses the constants of the board and L_0 from its drift. A drift is used if it is smooth and belongs to a session
    of this recording. Otherwise L_0 is measured at every position, as in `recorded_response`. That response has in
    addition ``drift_removed`` (state) and two attributes. ``calibration`` is the source of the calibration, and
    ``calibration_board`` is the calibrated board. If the calibration has capacitances, ``capacitance_from`` is their
    origin. If the drift was removed, ``delta_std`` follows from it.
    """
    if calibration.emulated != recording.emulated:
        kinds = ("a real", "an emulated")
        raise HardwareError(
            f"the calibration is of {kinds[calibration.emulated]} board, {recording.path} of "
            f"{kinds[recording.emulated]} one."
        )
    design = recording.sessions[0].design_hash
    if calibration.design_hash != design:
        raise HardwareError(
            f"the calibration is of a board with the design {calibration.design_hash[:12] or 'unknown'}, "
            f"{recording.path} of one with {design[:12]}."
        )
    capacitances = {**recording.sessions[0].capacitances, **calibration.capacitances}
    response = recorded_response(recording, capacitances=capacitances, clock=calibration.clock, partial=partial)
    series = recorded_series(recording, capacitances=capacitances, clock=calibration.clock)
    sessions = _sessions(recording)
    drifts = {
        (one.session, one.state): one
        for one in calibration.drifts
        if one.smooth and (one.boot, one.started) in sessions[one.session : one.session + 1]
    }
    scans = Campaign.from_json(recording.campaign or "").scans
    removed = []
    for j, state in enumerate(recording.states):
        of_sessions = [drifts.get((session, state)) for session in range(len(sessions))]
        removed.append(_remove_drift(response, series, j, of_sessions, scans))
    if any(removed):
        before = response.delta_std.attrs["found_from"]
        response.delta_std.attrs["found_from"] = "drift" if all(removed) else f"drift, or {before} where it stays"
    said = {"calibration": calibration.source, "calibration_board": calibration.board}
    if calibration.inductances_from is not None:
        said["capacitance_from"] = calibration.inductances_from
    return response.assign(drift_removed=("state", removed)).assign_attrs(said)


def simulated_inductances(recording: Recording) -> dict[str, float]:
    """Return the simulated L_0 in H of every recorded state.

    The design is in an ideal circuit, so that all strays count as capacitance.
    """
    design, setup = recording.design, recording.design.indentation
    if setup is None:
        raise HardwareError(
            f"the design {design.name} has no [indenter] and [indentation], and so no simulated response; "
            "give known inductances."
        )
    depths, x, y = (axis[len(axis) // 2 : len(axis) // 2 + 1] for axis in (setup.depths, setup.x, setup.y))
    base = response_map(design, depths=depths, x=x, y=y, ideal=True).base_inductance
    return {state: float(base.sel(state=state)) for state in recording.states}


def _remove_drift(
    response: xr.Dataset, series: xr.Dataset, state: int, drifts: Sequence[Drift | None], scans: int
) -> bool:
    """Replace δ of a state by δ from its drift."""
    peaks = (series.stage.values == "peak") & series.finished.values
    peaks &= np.isfinite(series.inductance.values[:, state])
    sessions = series.session.values[peaks]
    if not len(sessions):
        return False
    level, deviation = np.empty((2, len(sessions)))
    for session in np.unique(sessions):
        drift, own = drifts[session], sessions == session
        if drift is None:
            return False
        level[own], error = drift.at(series.time.values[peaks][own])
        deviation[own] = np.hypot(drift.scatter / math.sqrt(scans), error)
    node = tuple(np.searchsorted(response[name].values, series[name].values[peaks]) for name in ("depth", "y", "x"))
    delta = series.inductance.values[peaks, state] / level - 1
    count, total, spread = sums = np.zeros((3, *response.delta.shape[:-1]))
    for target, values in zip(sums, (np.isfinite(delta), np.nan_to_num(delta), np.nan_to_num(deviation)), strict=True):
        np.add.at(target, node, values)
    measured = np.isfinite(response.delta.values[..., state]) & (count > 0)
    response.delta.values[measured, state] = total[measured] / count[measured]
    response.delta_std.values[measured, state] = spread[measured] / count[measured]
    return True


def _mean_frequencies(series: xr.Dataset) -> tuple[dict[str, float], dict[str, float]]:
    """Return the mean frequencies at rest in Hz."""
    rest = at_rest(series)
    means, errors = {}, {}
    for k, state in enumerate(series.state.values.tolist()):
        values = series.frequency.values[rest, k]
        values = values[np.isfinite(values)]
        if len(values) >= _LEAST_SCANS:
            means[state] = float(values.mean())
            errors[state] = float(values.std(ddof=1) / math.sqrt(len(values)))
    return means, errors


def _with_inductances(series: xr.Dataset, capacitances: Mapping[str, float], ratio: float) -> xr.Dataset:
    """Return a series with other capacitances and clock."""
    C = np.array([capacitances[state] for state in series.state.values.tolist()])
    return series.assign(inductance=1 / ((2 * np.pi * series.frequency * ratio) ** 2 * xr.DataArray(C, dims="state")))


def _sessions(recording: Recording) -> list[tuple[int, float]]:
    """Return the board's number and start of every session."""
    return [(session.identity.boot, session.started) for session in recording.sessions]


def _of_state(frequencies: Mapping[str, float], state: str, recording: Recording) -> float:
    if state not in recording.states:
        raise HardwareError(f"{recording.path} has no state {state!r}; there are {', '.join(recording.states)}.")
    if state not in frequencies:
        raise HardwareError(f"{recording.path} must have at least {_LEAST_SCANS} good scans of {state} at rest.")
    return frequencies[state]


def _known(name: str, unit: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0):
        raise HardwareError(f"a known {name} must be positive and finite; got {value:g} {unit}.")
    return value


SCHEMA = 1
"""Version of the format."""

_KIND = "coilarray board calibration"
_CALIBRATIONS = TomlFiles("calibration", HardwareError)
_BY_HAND = re.compile(r'^checksum\s*=\s*"none"', re.MULTILINE)


def calibration_to_toml(calibration: BoardCalibration) -> str:
    """Return the constants of a board as TOML."""
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
        "drift": [_keyed(_DriftTable, {**asdict(drift), "boot": f"{drift.boot:08X}"}) for drift in calibration.drifts],
    }
    return tomli_w.dumps(_without_nothing(document))


def calibration_from_toml(text: str, origin: str = "calibration") -> BoardCalibration:
    """Read the constants of a board from TOML."""
    document = _CALIBRATIONS.parse(text, origin)
    if document.get("kind") != _KIND:
        raise HardwareError(f'{origin} is not a calibration of a board: it must have kind = "{_KIND}".')
    file = _CALIBRATIONS.check(_File, document, origin)
    try:
        return file.build()
    except HardwareError as error:
        raise HardwareError(f"{origin}: {error}") from None


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
            raise HardwareError(f'{error} Where a person wrote it, checksum = "none" must be its first line.') from None
    return calibration_from_toml(text, str(path))


def channel_record(channel: Channel) -> dict[str, Any]:
    """Return a channel under the keys of the file."""
    return _keyed(_ChannelTable, asdict(channel))


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


class _ChannelTable(Table):
    """``[[channel]]``: the tank of one state of the scan."""

    state: _Name
    """State of the scan."""
    capacitance: _Positive = Field(alias="capacitance_F")
    """Capacitance of its tank."""
    standard_error: Annotated[float, Field(ge=0)] = Field(alias="standard_error_F")
    """Its standard error."""
    inductance: _Positive = Field(alias="inductance_H")
    """Inductance with which it was found."""


class _DriftTable(Table):
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
    channel: Annotated[list[_ChannelTable], Field(max_length=1000)] = Field(default_factory=list)
    drift: Annotated[list[_DriftTable], Field(max_length=100_000)] = Field(default_factory=list)

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
