"""Recordings as datasets, and their correction by reference coils.

The datasets are the response of a campaign, in the form of simulations, and the time series of all scans.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.compute.arrays import FloatArray
from coilarray.compute.checksum import with_checksums
from coilarray.design.scan_states import referenced_names
from coilarray.errors import HardwareError
from coilarray.hardware.record.campaign import Campaign
from coilarray.hardware.record.recording import GridPlace, RecordedScan, Recording, iso_time
from coilarray.hardware.scan.readings import ScanReading, Verdict, read_scan
from coilarray.response.dataset import coil_coordinates, origin_attributes

Capacitances = Mapping[str, float] | float | None

BASELINE_SCANS = 10
"""Number of first scans from which δ of a time series counts."""
VERDICTS: tuple[Verdict, ...] = ("good", "doubtful", "bad")
"""Verdicts in the order of the numbers of ``verdict``."""
_WORDS = {
    "msb": "register DATA0_MSB with its error flags", "lsb": "register DATA0_LSB", "status": "register STATUS",
    "fault": "0, or why there are no words",
}  # fmt: skip
"""Raw words of a conversion in their order."""
_WHEN = {"received": "s", "session": "", "sequence": "", "stage": "", "finished": "", "depth": "m", "y": "m", "x": "m"}
"""Fields of a `_Row` that are coordinates of the series as they are, with their units."""


def recorded_response(
    recording: Recording,
    *,
    capacitances: Capacitances = None,
    clock: float | None = None,
    partial: bool = False,
) -> xr.Dataset:
    """Return the measured response of a campaign.

    It has the form of a simulated response from `coilarray.response.map.response_map`.

    Parameters
    ----------
    recording : Recording
        Recording of a campaign.
    capacitances : mapping of str to float, or float, optional
        Capacitance of the tank in F, by state. The recorded values by default. It affects ``base_inductance`` only.
    clock : float, optional
        Clock of the converter in Hz if it is known better than while measuring. It affects ``base_inductance`` only.
    partial : bool
        Whether to accept positions that are not measured yet. They are NaN.

    Returns
    -------
    xarray.Dataset
        ``delta`` (depth, y, x, state) is (L_peak − L_0)/L_0, the mean over the repeats. ``base_inductance`` (state) is
        the mean L_0 in H. Coordinates are in m. ``delta_std`` (depth, y, x, state) is the standard deviation of one
        repeat. It comes from the repeats if there are several. Otherwise it is the same for all positions and comes
        from the differences of successive baselines (NaN for a single position). ``doubtful`` (depth, y, x, state)
        marks readings outside the specification of the data sheet. The attributes name the equipment, and ``emulated``
        is 0 for a real board.

    Notes
    -----
    L_0 is measured again at every position before the indenter touches, as in the paper (eq. 2), so that a slow drift
    does not affect δ.
    """
    campaign, design = _campaign(recording), recording.design
    base, peak, doubtful, baselines = _measured(recording, campaign, capacitances, clock)
    delta = peak / base - 1
    count = np.isfinite(delta).sum(axis=0)
    missing = int((count == 0).any(axis=-1).sum())
    if missing and not partial:
        places = campaign.size // campaign.repeats
        raise HardwareError(f"{recording.path} is not complete: {missing} of {places} positions are not measured yet.")
    mean = _mean(delta)
    if campaign.repeats > 1:
        squares = np.nansum((delta - mean) ** 2, axis=0)
        deviation = np.where(count > 1, np.sqrt(squares / np.maximum(count - 1, 1)), np.nan)
        found_from = "repeats"
    else:
        deviation = np.where(count > 0, _from_steps(baselines, campaign.scans), np.nan)
        found_from = "baselines"
    dims = ("depth", "y", "x", "state")
    return xr.Dataset(
        {
            "delta": (dims, mean, {"units": "1", "long_name": "relative change of inductance"}),
            "delta_std": (
                dims, deviation,
                {"units": "1", "long_name": "standard deviation of one delta", "found_from": found_from},
            ),
            "base_inductance": (
                "state", _mean(baselines), {"units": "H", "long_name": "L_0 as the converter sees it"}
            ),
            "doubtful": (dims, doubtful.any(axis=0), {"long_name": "beyond what the data sheet promises"}),
        },
        coords={
            "depth": ("depth", list(campaign.depths), {"units": "m", "long_name": "depth of the indentation"}),
            "y": ("y", list(campaign.y), {"units": "m"}),
            "x": ("x", list(campaign.x), {"units": "m"}),
            "state": list(recording.states),
            **coil_coordinates(design.indentation, design.array.names, design.array.centres),
        },
        attrs={**_provenance(recording), "repeats": campaign.repeats, **_indentation(recording)},
    )  # fmt: skip


def recorded_series(
    recording: Recording,
    *,
    baseline: int = BASELINE_SCANS,
    capacitances: Capacitances = None,
    clock: float | None = None,
) -> xr.Dataset:
    """Return every scan of any recording in time order.

    Parameters
    ----------
    baseline : int
        Number of first scans at rest whose mean is L_0 of δ.
    capacitances, clock
        Constants of the board, see `recorded_response`.

    Returns
    -------
    xarray.Dataset
        Over ``scan`` and ``state``: ``frequency`` in Hz, ``inductance`` in H and ``delta``, NaN if the verdict is bad;
        ``verdict`` 0 good, 1 doubtful, 2 bad; the raw words ``msb``, ``lsb``, ``status`` and ``fault``. Coordinates of
        a scan: ``time`` in s from the first scan, by the board's clock within a session; ``received`` in s since the
        epoch; ``session``, ``sequence``, ``stage``; ``finished``, whether it belongs to a position that was measured to
        its end; ``depth``, ``y``, ``x`` in m, NaN if unknown; ``temperature`` in °C if the recording has temperatures,
        likewise.
    """
    if baseline < 1:
        raise HardwareError(f"baseline must be at least 1 scan; got {baseline}.")
    finished = recording.positions()
    rows = [_row(scan, _reading(recording, scan, capacitances, clock), finished) for scan in recording.scans()]
    if not rows:
        raise HardwareError(f"{recording.path} has no scan yet.")
    frequency, inductance, verdicts, raw = (np.array([row[k] for row in rows]) for k in range(4))
    first = inductance[[not row.depth > 0 for row in rows]][:baseline]
    dims = ("scan", "state")
    return xr.Dataset(
        {
            "frequency": (dims, frequency, {"units": "Hz", "long_name": "frequency of the oscillation"}),
            "inductance": (dims, inductance, {"units": "H", "long_name": "inductance as the converter sees it"}),
            "delta": (
                dims, inductance / _mean(first) - 1,
                {"units": "1", "long_name": "relative change of inductance", "baseline_scans": len(first)},
            ),
            "verdict": (
                dims, verdicts,
                {"long_name": "verdict", "flag_values": [0, 1, 2], "flag_meanings": " ".join(VERDICTS)},
            ),
            **{name: (dims, raw[..., k], {"long_name": text}) for k, (name, text) in enumerate(_WORDS.items())},
        },
        coords={
            "time": ("scan", _times(rows), {"units": "s"}),
            **{
                name: ("scan", [getattr(row, name) for row in rows], {"units": unit} if unit else {})
                for name, unit in _WHEN.items()
            },
            **_temperatures(rows),
            "state": list(recording.states),
        },
        attrs=_provenance(recording),
    )  # fmt: skip


def response_csv(response: xr.Dataset) -> str:
    """Return a measured response as CSV.

    The columns are depth_m, y_m, x_m, state, delta, delta_std for every position and state. The last column is a
    checksum of the lines up to there, and the last line has a checksum of all lines.
    """
    in_metres = response[["delta", "delta_std"]].rename(depth="depth_m", y="y_m", x="x_m")
    table = in_metres.to_dataframe(dim_order=["depth_m", "y_m", "x_m", "state"])
    return with_checksums(table[["delta", "delta_std"]].to_csv(lineterminator="\n"))


def series_csv(series: xr.Dataset) -> str:
    """Return a time series as CSV for ``coilarray locate``.

    The columns are time_s and δ of every state, empty if unknown. If the series has temperatures, ``temperature_C``
    follows, nan if unknown. The last column is a checksum of the lines up to there, and the last line has a checksum of
    all lines.
    """
    table = series.delta.to_pandas()
    table.index = series.time.to_index().rename("time_s")
    if "temperature" in series.coords:
        table["temperature_C"] = [f"{value:.3f}" for value in series.temperature.values]
    return with_checksums(table.to_csv(lineterminator="\n"))


def _campaign(recording: Recording) -> Campaign:
    if recording.campaign is None:
        raise HardwareError(f"{recording.path} holds no campaign, only a time series.")
    return Campaign.from_json(recording.campaign)


def _measured(
    recording: Recording, campaign: Campaign, capacitances: Capacitances, clock: float | None
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_], FloatArray]:
    """Return L_0 and L_peak over (repeat, depth, y, x, state)."""
    shape = (campaign.repeats, len(campaign.depths), len(campaign.y), len(campaign.x), len(recording.states))
    sums = {"baseline": np.zeros(shape), "peak": np.zeros(shape)}
    counts = {"baseline": np.zeros(shape[:-1]), "peak": np.zeros(shape[:-1])}
    doubtful = np.zeros(shape, dtype=bool)
    baselines = []
    for scan in recording.scans(finished=True):
        if scan.stage not in sums or scan.place is None:
            continue
        node = _node(recording, campaign, scan.place)
        states = _reading(recording, scan, capacitances, clock).states
        inductance = np.array([_number(state.inductance) for state in states])
        sums[scan.stage][node] += inductance
        counts[scan.stage][node] += 1
        doubtful[node] |= np.array([state.verdict != "good" for state in states])
        if scan.stage == "baseline":
            baselines.append(inductance)
    with np.errstate(invalid="ignore"):  # 0/0 at positions that were not measured
        base, peak = (sums[name] / counts[name][..., None] for name in ("baseline", "peak"))
    return base, peak, doubtful, np.array(baselines).reshape(-1, shape[-1])


def _node(recording: Recording, campaign: Campaign, place: GridPlace) -> tuple[int, int, int, int]:
    """Return the indices (repeat, depth, y, x) of a place."""
    if not 0 <= place.number < campaign.size or campaign.places[place.number] != place:
        raise HardwareError(f"{recording.path} is damaged: position {place.number} is not of its campaign.")
    row, k = divmod(place.number, len(campaign.depths))
    row, i = divmod(row, len(campaign.x))
    repeat, j = divmod(row, len(campaign.y))
    return repeat, k, j, i


def _from_steps(baselines: FloatArray, scans: int) -> FloatArray:
    """Estimate the standard deviation of δ by state.

    Differences of successive L_0 are used, in which a drift cancels. This is von Neumann's estimate. δ is a difference
    as well, between two means of the given number of scans.
    """
    if len(baselines) < 2:
        return np.full(baselines.shape[-1], np.nan)
    return np.asarray(np.sqrt(np.mean(np.diff(baselines, axis=0) ** 2, axis=0) / scans) / _mean(baselines))


def _mean(values: FloatArray) -> FloatArray:
    """Mean of the rows without NaN."""
    count = np.isfinite(values).sum(axis=0)
    return np.asarray(np.where(count > 0, np.nansum(values, axis=0), np.nan) / np.maximum(count, 1))


def _reading(recording: Recording, scan: RecordedScan, capacitances: Capacitances, clock: float | None) -> ScanReading:
    session = recording.sessions[scan.session]
    return read_scan(
        scan.scan, session.settings, session.capacitances if capacitances is None else capacitances, clock=clock
    )


class _Row(NamedTuple):
    """A scan of a time series."""

    frequency: FloatArray
    inductance: FloatArray
    verdict: npt.NDArray[np.int8]
    raw: npt.NDArray[np.uint16]
    time: float
    received: float
    session: int
    sequence: int
    stage: str
    finished: bool
    depth: float
    temperature: float
    y: float
    x: float


def _row(scan: RecordedScan, reading: ScanReading, finished: Container[int | None]) -> _Row:
    """Make the row of a scan."""
    raw, states, place = scan.scan, reading.states, scan.place
    when = (raw.time, raw.received, scan.session, raw.sequence, scan.stage, scan.position in finished)
    where = (math.nan, math.nan) if place is None else (place.y, place.x)
    return _Row(
        np.array([_number(state.frequency) for state in states]),
        np.array([_number(state.inductance) for state in states]),
        np.array([VERDICTS.index(state.verdict) for state in states], dtype=np.int8),
        np.array([(one.msb, one.lsb, one.status, one.fault) for one in raw.samples], dtype=np.uint16),
        *when,
        _number(scan.depth),
        _number(scan.temperature),
        *where,
    )


def _temperatures(rows: Sequence[_Row]) -> dict[str, Any]:
    """Return the temperature coordinate if any scan has it."""
    values = np.array([row.temperature for row in rows])
    return {"temperature": ("scan", values, {"units": "degC"})} if np.isfinite(values).any() else {}


def _times(scans: Sequence[_Row]) -> list[float]:
    """Time in s of every scan from the first.

    The board's clock counts within a session, and the computer's clock between sessions.
    """
    times: list[float] = []
    first = start = 0.0
    for k, scan in enumerate(scans):
        if k == 0 or scan.session != scans[k - 1].session:
            first = scan.time
            since = scan.received - scans[0].received
            start = 0.0 if k == 0 else max(since, times[-1])  # virtual time may run ahead of the computer's
        times.append(start + scan.time - first)
    return times


def _indentation(recording: Recording) -> dict[str, str | float]:
    setup = recording.design.indentation
    if setup is None:
        return {}
    return {"indenter": setup.indenter.name, "base": str(setup.base), **origin_attributes(setup)}


def _provenance(recording: Recording) -> dict[str, str | int]:
    """Return the attributes that name the equipment."""
    session = recording.sessions[0]
    return {
        "source": "measured",
        "emulated": int(recording.emulated),
        "board": session.identity.kind,
        "started": iso_time(session.started),
        "design": session.design,
        "design_hash": session.design_hash,
        "wiring": session.wiring,
        "wired": int(session.settings.wired),
        "settings_hash": f"{session.settings.hash:04X}",
        "coilarray_version": session.version,
    }


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def less_reference(delta: Mapping[str, npt.ArrayLike], reference: Sequence[str]) -> dict[str, FloatArray]:
    """Return δ less the mean δ of the reference coils.

    `delta` has δ of every state by name, a number of one scan or an array over scans, NaN if unknown. δ of the other
    states is returned. It is NaN if a state or any reference has no value: a mean over fewer references would jump by
    their noise.

    Notes
    -----
    A drift d multiplies every L by 1 + d, so that δ becomes δ + d + δ d. The last term, 10⁻⁸ for d = 10⁻⁵ and δ = 10⁻³,
    remains.

    Examples
    --------
    >>> left = less_reference({"coil1": [5e-6, 7e-4 + 9e-6], "far": [5e-6, 9e-6]}, ["far"])
    >>> np.round(left["coil1"], 9)
    array([0.    , 0.0007])
    """
    others = referenced_names(tuple(delta), reference, HardwareError)
    mean = np.mean([np.asarray(delta[name], dtype=np.float64) for name in reference], axis=0)
    return {name: np.asarray(np.asarray(delta[name], dtype=np.float64) - mean) for name in others}


def response_less_reference(response: xr.Dataset, reference: Sequence[str]) -> xr.Dataset:
    """Return a response less the reference coils.

    The response is measured or simulated. The mean δ of the reference coils is subtracted from δ of the other states.
    If the response has ``delta_std``, the noise of the mean is added to it.
    """
    others = list(referenced_names(tuple(response.state.values.tolist()), reference, HardwareError))
    mean = response.delta.sel(state=list(reference)).mean("state", skipna=False)
    left = response.sel(state=others)
    left["delta"] = (left.delta - mean).assign_attrs(response.delta.attrs)
    if "delta_std" in left:
        taken = response.delta_std.sel(state=list(reference))
        added = (taken**2).sum("state", skipna=False) / len(reference) ** 2
        left["delta_std"] = np.sqrt(left.delta_std**2 + added).assign_attrs(response.delta_std.attrs)
    return left.assign_attrs(reference_coils=", ".join(reference))
