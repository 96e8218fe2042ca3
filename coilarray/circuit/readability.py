"""Readability of states and map positions by a converter.

Values that no converter can read stay in their dataset, marked. They are left out of ranges,
deviations and largest values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
import xarray as xr

from coilarray.circuit.converter_limits import (
    AMPLITUDE_HIGH,
    AMPLITUDE_LOW,
    AMPLITUDES,
    BROKEN,
    DRIVE_CURRENTS,
    broken_limit,
    check_channel,
    decisive_limits,
    drive_codes,
    shared_drive,
)
from coilarray.compute.arrays import BoolArray, FloatArray
from coilarray.compute.display_units import MM, true_minus
from coilarray.compute.netcdf import variables
from coilarray.design.model import Design

RESONATOR = ("frequency", "parallel_resistance", "quality_factor")
"""Variables of a state that decide its readability."""


def readability(
    design: Design, over: tuple[str, ...], values: Mapping[str, FloatArray], base: Mapping[str, FloatArray]
) -> dict[str, tuple[tuple[str, ...], Any, dict[str, str]]]:
    """Return the variables for the readability by a converter.

    `values` and `base` hold the `RESONATOR` quantities at every position (…, states) and of the
    coils alone (states,). ``amplitude`` in V is with the drive current of the coil alone.
    ``drive_code`` is the IDRIVE of the coil alone. ``path_drive_code`` reads the most positions and
    the coil alone, ``path_readable`` is with it, and ``alone_readable`` tells whether it reads the
    coil alone.
    """
    if not design.readout.converter:
        return {}
    of, alone = ([np.asarray(one[name], dtype=np.float64) for name in RESONATOR] for one in (values, base))
    broken, of_alone = (broken_limit(one[0], one[1], one[2]) for one in (of, alone))
    codes = np.where(of_alone == 0, drive_codes(alone[1]), -1)
    current = np.where(codes < 0, np.nan, np.array(DRIVE_CURRENTS)[codes])
    path, served, first = np.full(len(codes), -1), np.zeros(broken.shape, dtype=bool), np.zeros(len(codes), dtype=bool)
    for k in range(len(codes)):
        f, R_p, Q = (np.append(one[..., k], lone[k]) for one, lone in zip(of, alone, strict=True))
        path[k] = shared_drive(f, R_p, Q)
        if path[k] >= 0:
            read = broken_limit(f, R_p, Q, int(path[k])) == 0
            served[..., k], first[k] = read[:-1].reshape(broken.shape[:-1]), read[-1]
    state = ("state",)
    named = ", ".join(f"{k} {word}" for k, word in enumerate(BROKEN))
    return variables(
        ("readable", over, broken == 0, "", "readable"),
        ("broken_limit", over, broken.astype(np.int8), "", f"broken limit: {named}"),
        ("amplitude", over, 4 * of[1] * current / np.pi, "V", "amplitude, drive of the coil alone"),
        ("path_readable", over, served, "", "readable with the drive of the path"),
        ("drive_code", state, codes, "", "IDRIVE of the coil alone"),
        ("path_drive_code", state, path, "", "IDRIVE of the path"),
        ("alone_readable", state, first, "", "whether it reads the coil alone"),
    )


def readable_of(response: xr.Dataset) -> xr.DataArray:
    """Return where a converter reads a map, by default everywhere."""
    delta = response["delta"]
    if "readable" not in response:
        return xr.ones_like(delta, dtype=bool)
    return response["readable"].broadcast_like(delta).transpose(*delta.dims)


def with_reasons(dataset: xr.Dataset, more: Sequence[str] = ()) -> tuple[xr.Dataset, tuple[str, ...]]:
    """Return a dataset with reasons, and its marks for tables.

    `more` are further variables of `readability`, which come first. Marks that are the same
    everywhere are left out.
    """
    if "broken_limit" not in dataset:
        return dataset, ()
    words, numbers = np.array(["", *BROKEN[1:]], dtype=object), dataset["broken_limit"]
    named = numbers.copy(data=words[numbers.values]).assign_attrs(long_name="broken limit")
    broken = ("broken_limit",) if numbers.values.any() else ()
    path = ("path_readable",) if (dataset["path_readable"] != dataset["readable"]).any() else ()
    return dataset.assign(broken_limit=named), (*more, "readable", *path, *broken)


@dataclass(frozen=True)
class PathDrive:
    """Drive of the sensor over all positions of one state.

    `code` is the IDRIVE of the coil alone, and `path_code` reads the most positions and the coil
    alone, −1 for none. `least` and `most` are the ends of the amplitude in V with `code`, and
    `place` is where it is farthest from the allowed range. `path_code` reads `read` of `positions`.
    `heights` are the distances or depths that it reads at the place of the least R_p.
    """

    state: str
    code: int
    path_code: int
    least: float
    most: float
    place: str
    read: int
    positions: int
    alone: bool
    heights: str

    @property
    def extreme(self) -> float:
        """Amplitude in V farthest from the allowed range."""
        return self.least if AMPLITUDE_LOW / self.least > self.most / AMPLITUDE_HIGH else self.most

    @property
    def kept(self) -> bool:
        """Whether the drive keeps the amplitude at every position."""
        return AMPLITUDES[0] <= self.least and self.most <= AMPLITUDES[1]


def path_drives(response: xr.Dataset) -> list[PathDrive]:
    """Return the drive over positions of every map state."""
    found: list[PathDrive] = []
    if "amplitude" not in response or "y" not in response.amplitude.dims:
        return found
    height = "distance" if "distance" in response.dims else "depth"
    for k, state in enumerate(response.state.values.tolist()):
        of = response[["amplitude", "path_readable", "parallel_resistance"]].isel(state=k).transpose(height, "y", "x")
        amplitude, read = of.amplitude.values, of.path_readable.values
        away = np.maximum(amplitude / AMPLITUDE_HIGH, AMPLITUDE_LOW / amplitude)
        worst = np.unravel_index(int(np.nan_to_num(away).argmax()), away.shape)
        _, row, column = np.unravel_index(int(of.parallel_resistance.values.argmin()), away.shape)
        found.append(
            PathDrive(
                state, int(response.drive_code[k]), int(response.path_drive_code[k]), float(amplitude.min()),
                float(amplitude.max()), _place(of.amplitude, worst), int(read.sum()), read.size,
                bool(response.alone_readable[k]), _spans(response[height].values, read[:, row, column], height),
            )
        )  # fmt: skip
    return found


def reading_lines(response: xr.Dataset) -> list[str]:
    """Return sentences on the parts that the converter misses."""
    if "broken_limit" not in response:
        return []
    lines, broken = [], response["broken_limit"]
    f, R_p, Q = (response[name].values for name in RESONATOR)
    for kind, (value, low, high) in enumerate(decisive_limits(f, R_p, Q), start=1):
        there = broken.values == kind
        if there.any():
            away = np.where(there, np.maximum(value / high, low / value), 0.0)
            worst = np.unravel_index(int(away.argmax()), away.shape)
            limits = check_channel(float(f[worst]), float(R_p[worst]), float(Q[worst]))
            said = next(limit.words for limit in limits if not limit.kept)
            count = f"{there.sum()} of {there.size} values, the worst " if there.ndim > 1 else ""
            lines.append(f"The converter cannot read {count}{_place(broken, worst)}: {said}.")
    drives = [one for one in path_drives(response) if one.code >= 0 and not one.kept]
    if drives:
        one = min(drives, key=lambda one: min(one.least, AMPLITUDE_LOW * AMPLITUDE_HIGH / one.most))
        more = f", as of {len(drives)} states" if len(drives) > 1 else ""
        current = f"IDRIVE {one.path_code} ({DRIVE_CURRENTS[one.path_code] * 1e6:.0f} µA)"
        if one.read == one.positions and one.alone:
            help_ = f"{current} reads all of its positions, and the coil alone."
        else:
            there = f": {one.heights} where R_p is the least" if one.heights else ""
            help_ = (
                f"No drive current reads all of its {one.positions} positions and the coil alone; {current} reads "
                f"{one.read}{there}{', and the coil alone' if one.alone else ''}."
            )
        lines.append(
            f"With the drive current of the coil alone, IDRIVE {one.code}, the amplitude of {one.place} is "
            f"{one.extreme:.2g} V{more}; {AMPLITUDE_LOW:g} to {AMPLITUDE_HIGH:g} V are allowed. {help_}"
        )
    return lines


def _place(values: xr.DataArray, index: Sequence[np.intp]) -> str:
    """Name the position of an index."""
    at = values[dict(zip(values.dims, index, strict=True))]
    words = [str(at.state.values)]
    words += [
        f"{MM.text(at[dim])} {word}" for dim, word in (("distance", "away"), ("depth", "deep")) if dim in at.coords
    ]
    if max(values.sizes.get("x", 1), values.sizes.get("y", 1)) > 1:
        words.append(true_minus(f"x {float(at.x) * 1e3:.4g}, y {float(at.y) * 1e3:.4g} mm"))
    return ", ".join(words)


def _spans(values: FloatArray, chosen: BoolArray, what: str) -> str:
    """Write the chosen of rising lengths in m as spans."""
    parts = []
    for read, group in groupby(zip(values.tolist(), chosen.tolist(), strict=True), key=lambda pair: pair[1]):
        inside = [MM.text(value) for value, _ in group]
        if read:
            parts.append(inside[0] if len(inside) == 1 else f"{inside[0]} to {inside[-1]}")
    return ", ".join(parts)
