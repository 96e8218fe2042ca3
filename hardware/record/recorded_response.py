"""Recordings as datasets: the response of a campaign, and all scans; correction by reference coils."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.compute.arrays import BoolArray, FloatArray
from coilarray.compute.files import with_checksums
from coilarray.compute.netcdf import variables
from coilarray.design.scan_states import referenced_names
from coilarray.errors import HardwareError
from coilarray.hardware.record.campaign import Campaign
from coilarray.hardware.record.recording import Recording, iso_time
from coilarray.hardware.scan.readings import Verdict, read_scan
from coilarray.response.dataset import coil_coordinates, origin_attributes

Capacitances = Mapping[str, float] | float | None

BASELINE_SCANS = 10  # number of first scans from which δ of a time series counts
VERDICTS: tuple[Verdict, ...] = ("good", "doubtful", "bad")
"""Verdicts in the order of the numbers of ``verdict``."""
_WORDS = {  # raw words of a conversion in their order
    "msb": "register DATA0_MSB with its error flags",
    "lsb": "register DATA0_LSB",
    "status": "register STATUS",
    "fault": "0, or why there are no words",
}
_WHEN = {  # coordinates of a scan, with their units
    "received": "s",
    "session": "",
    "sequence": "",
    "stage": "",
    "finished": "",
    "place": "",
    "depth": "m",
    "y": "m",
    "x": "m",
    "temperature": "degC",
}


def recorded_response(
    recording: Recording, *, capacitances: Capacitances = None, clock: float | None = None, partial: bool = False
) -> xr.Dataset:
    """Return the measured response of a campaign.

    It has the form of a simulated response from `coilarray.response.map.response_map`. L_0 is
    measured again at every position before the indenter touches, as in the paper (eq. 2), so that a
    slow drift does not affect δ. Capacitances in F, recorded by default, and the clock in Hz affect
    ``base_inductance`` only. With `partial` positions that are not measured yet are NaN.

    ``delta`` (depth, y, x, state) is (L_peak − L_0)/L_0, the mean over the repeats.
    ``base_inductance`` (state) is the mean L_0 in H. Coordinates are in m. ``delta_std``, of the
    shape of ``delta``, is the standard deviation of one repeat. Without repeats it is the same for
    all positions and comes from the differences of successive baselines (NaN for a single
    position). ``doubtful`` marks readings outside the specification of the data sheet.
    """
    if recording.campaign is None:
        raise HardwareError(f"{recording.path} holds no campaign, only a time series.")
    campaign, design = Campaign.from_json(recording.campaign), recording.design
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
        # Differences of successive L_0, in which a drift cancels: von Neumann's estimate. δ is a
        # difference as well.
        step = (
            np.sqrt(np.mean(np.diff(baselines, axis=0) ** 2, axis=0) / campaign.scans) if len(baselines) > 1 else np.nan
        )
        deviation = np.where(count > 0, step / _mean(baselines), np.nan)
        found_from = "baselines"
    dims, std = ("depth", "y", "x", "state"), {"found_from": found_from}
    setup = design.indentation
    indentation: dict[str, str | float] = {}
    if setup is not None:
        indentation = {"indenter": setup.indenter.name, "base": str(setup.base), **origin_attributes(setup)}
    response = xr.Dataset(
        variables(
            ("delta", dims, mean, "1", "relative change of inductance"),
            ("delta_std", dims, deviation, "1", "standard deviation of one delta"),
            ("base_inductance", ("state",), _mean(baselines), "H", "L_0 as the converter sees it"),
            ("doubtful", dims, doubtful.any(axis=0), "", "beyond what the data sheet promises"),
        ),
        coords={
            "depth": ("depth", list(campaign.depths), {"units": "m", "long_name": "depth of the indentation"}),
            "y": ("y", list(campaign.y), {"units": "m"}),
            "x": ("x", list(campaign.x), {"units": "m"}),
            "state": list(recording.states),
            **coil_coordinates(setup, design.array.names, design.array.centres),
        },
        attrs={**_provenance(recording), "repeats": campaign.repeats, **indentation},
    )
    response.delta_std.attrs |= std
    return response


def _measured(
    recording: Recording, campaign: Campaign, capacitances: Capacitances, clock: float | None
) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray]:
    """Give L_0, L_peak and doubt (repeat, depth, y, x, state), and L_0 by scan."""
    series = recorded_series(recording, capacitances=capacitances, clock=clock)
    series = series.isel(scan=np.flatnonzero(series.finished.values))
    if (series.place.values >= campaign.size).any():
        raise HardwareError(f"{recording.path} is damaged: a position is not of its campaign.")
    repeat, j, i, k = np.unravel_index(
        series.place.values, (campaign.repeats, len(campaign.y), len(campaign.x), len(campaign.depths))
    )
    node = np.stack((repeat, k, j, i))
    shape = (campaign.repeats, len(campaign.depths), len(campaign.y), len(campaign.x))
    inductance, means = series.inductance.values, []
    for stage in ("baseline", "peak"):
        of_stage = series.stage.values == stage
        total, count = np.zeros((*shape, inductance.shape[1])), np.zeros(shape)
        np.add.at(total, tuple(node[:, of_stage]), inductance[of_stage])
        np.add.at(count, tuple(node[:, of_stage]), 1)
        with np.errstate(invalid="ignore"):  # 0/0 at positions that were not measured
            means.append(total / count[..., None])
    doubtful = np.zeros((*shape, inductance.shape[1]), dtype=bool)
    np.logical_or.at(doubtful, tuple(node), series.verdict.values > 0)
    return means[0], means[1], doubtful, inductance[series.stage.values == "baseline"]


def recorded_series(
    recording: Recording,
    *,
    baseline: int = BASELINE_SCANS,
    capacitances: Capacitances = None,
    clock: float | None = None,
) -> xr.Dataset:
    """Return every scan of any recording in time order.

    `baseline` is the number of first scans at rest whose mean is L_0. Over ``scan`` and ``state``
    the dataset has ``frequency`` in Hz, ``inductance`` in H and ``delta``, NaN if the verdict is
    bad, ``verdict`` (0 good, 1 doubtful, 2 bad), and the raw words ``msb``, ``lsb``, ``status`` and
    ``fault``. Coordinates of a scan are ``time`` in s from the first scan (by the board's clock
    within a session), ``received`` in s since the epoch, ``session``, ``sequence``, ``stage``,
    ``place`` (its number in the campaign, −1 if none), ``finished`` (whether its position was
    measured to its end), and ``depth``, ``y``, ``x`` in m and ``temperature`` in °C, NaN if
    unknown.
    """
    if baseline < 1:
        raise HardwareError(f"baseline must be at least 1 scan; got {baseline}.")
    finished = recording.positions()
    columns: dict[str, list[Any]] = {name: [] for name in ("frequency", "inductance", "verdict", "raw", *_WHEN)}
    times: list[float] = []
    for one in recording.scans():
        raw, session = one.scan, recording.sessions[one.session]
        known = session.capacitances if capacitances is None else capacitances
        states = read_scan(raw, session.settings, known, clock=clock).states
        if not times or one.session != columns["session"][-1]:
            first, start = raw.time, 0.0
            if times:  # virtual time may run ahead of the computer's
                start = max(raw.received - columns["received"][0], times[-1])
        times.append(start + raw.time - first)
        row = {
            "frequency": [_number(state.frequency) for state in states],
            "inductance": [_number(state.inductance) for state in states],
            "verdict": [VERDICTS.index(state.verdict) for state in states],
            "raw": [(word.msb, word.lsb, word.status, word.fault) for word in raw.samples],
            "received": raw.received,
            "session": one.session,
            "sequence": raw.sequence,
            "stage": one.stage,
            "finished": one.position in finished,
            "place": -1 if one.place is None else one.place.number,
            "depth": _number(one.depth),
            "y": math.nan if one.place is None else one.place.y,
            "x": math.nan if one.place is None else one.place.x,
            "temperature": _number(one.temperature),
        }
        for name, value in row.items():
            columns[name].append(value)
    if not times:
        raise HardwareError(f"{recording.path} has no scan yet.")
    frequency, inductance = (np.array(columns[name], dtype=np.float64) for name in ("frequency", "inductance"))
    raw_words = np.array(columns["raw"], dtype=np.uint16)
    coords = {name: ("scan", columns[name], {"units": unit} if unit else {}) for name, unit in _WHEN.items()}
    if not np.isfinite(columns["temperature"]).any():
        del coords["temperature"]
    first_rest = inductance[~(np.array(columns["depth"]) > 0)][:baseline]
    dims = ("scan", "state")
    series = xr.Dataset(
        variables(
            ("frequency", dims, frequency, "Hz", "frequency of the oscillation"),
            ("inductance", dims, inductance, "H", "inductance as the converter sees it"),
            ("delta", dims, inductance / _mean(first_rest) - 1, "1", "relative change of inductance"),
            ("verdict", dims, np.array(columns["verdict"], dtype=np.int8), "", "verdict"),
            *((name, dims, raw_words[..., k], "", text) for k, (name, text) in enumerate(_WORDS.items())),
        ),
        coords={"time": ("scan", times, {"units": "s"}), **coords, "state": list(recording.states)},
        attrs=_provenance(recording),
    )
    series.delta.attrs["baseline_scans"] = len(first_rest)
    series.verdict.attrs |= {"flag_values": [0, 1, 2], "flag_meanings": " ".join(VERDICTS)}
    return series


def at_rest(series: xr.Dataset) -> BoolArray:
    """Mark the scans of a series at rest, shape (scan,)."""
    return np.asarray(~(series.depth.values > 0))


def response_csv(response: xr.Dataset) -> str:
    """Return a measured response as CSV."""
    # depth_m, y_m, x_m, state, delta, delta_std of every position and state, and a checksum of the lines up to
    # there; the last line has a checksum of all lines
    in_metres = response[["delta", "delta_std"]].rename(depth="depth_m", y="y_m", x="x_m")
    table = in_metres.to_dataframe(dim_order=["depth_m", "y_m", "x_m", "state"])
    return with_checksums(table[["delta", "delta_std"]].to_csv(lineterminator="\n"))


def series_csv(series: xr.Dataset) -> str:
    """Return a time series as CSV for ``coilarray locate``."""
    # time_s, δ of every state, empty if unknown, temperature_C if known, and checksums as in `response_csv`
    table = series.delta.to_pandas()
    table.index = series.time.to_index().rename("time_s")
    if "temperature" in series.coords:
        table["temperature_C"] = [f"{value:.3f}" for value in series.temperature.values]
    return with_checksums(table.to_csv(lineterminator="\n"))


def _mean(values: FloatArray) -> FloatArray:
    """Mean of the rows without NaN."""
    count = np.isfinite(values).sum(axis=0)
    return np.asarray(np.where(count > 0, np.nansum(values, axis=0), np.nan) / np.maximum(count, 1))


def _provenance(recording: Recording) -> dict[str, str | int]:
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

    Only the other states are returned. δ is NaN if a state or any reference has no value: a mean
    over fewer references would jump by their noise. A drift d multiplies every L by 1 + d, so that
    δ becomes δ + d + δ d. The last term, 10⁻⁸ for d = 10⁻⁵ and δ = 10⁻³, remains.

    >>> left = less_reference({"coil1": [5e-6, 7e-4 + 9e-6], "far": [5e-6, 9e-6]}, ["far"])
    >>> np.round(left["coil1"], 9)
    array([0.    , 0.0007])
    """
    others = referenced_names(tuple(delta), reference, HardwareError)
    mean = np.mean([np.asarray(delta[name], dtype=np.float64) for name in reference], axis=0)
    return {name: np.asarray(np.asarray(delta[name], dtype=np.float64) - mean) for name in others}


def response_less_reference(response: xr.Dataset, reference: Sequence[str]) -> xr.Dataset:
    """Return a response less the mean δ of its reference coils."""
    # The noise of that mean is added to ``delta_std``.
    others = list(referenced_names(tuple(response.state.values.tolist()), reference, HardwareError))
    mean = response.delta.sel(state=list(reference)).mean("state", skipna=False)
    left = response.sel(state=others)
    left["delta"] = (left.delta - mean).assign_attrs(response.delta.attrs)
    if "delta_std" in left:
        taken = response.delta_std.sel(state=list(reference))
        added = (taken**2).sum("state", skipna=False) / len(reference) ** 2
        left["delta_std"] = np.sqrt(left.delta_std**2 + added).assign_attrs(response.delta_std.attrs)
    return left.assign_attrs(reference_coils=", ".join(reference))
