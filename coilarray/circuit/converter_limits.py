"""Limits of converters of the LDC1614 family, and their drive.

States and map positions that no converter can read stay in their dataset, marked. They are left out
of ranges, deviations and largest values.

Sources are Texas Instruments SNOSCY9A: electrical characteristics (R_p), table 42 (drive current),
table 43 (frequencies), section 8.1.5 (amplitude, equation 12). The FDC2214 has the same core
(SNOSCZ5B).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.compute.arrays import BoolArray, FloatArray, IntArray
from coilarray.compute.display_units import MM, DisplayUnit, display_unit, true_minus
from coilarray.compute.netcdf import variables
from coilarray.design.model import Design
from coilarray.design.readout import INTERNAL_CLOCK

REFERENCE = INTERNAL_CLOCK / 2
"""Reference frequency in Hz: the typical 43.4 MHz by the divider 2 that one channel needs."""
AMPLITUDE_LOW, AMPLITUDE_HIGH = 1.2, 1.8
"""Allowed peak voltage in V: the sensor measures poorly below it, the input clamps act above it."""
DRIVE_WINDOW = "R_p (Ω)"  # name of the limit of `check_channel` by `RESISTANCE`
RESISTANCE = (1e3, 100e3)  # allowed parallel resistance of a sensor in Ω. The rows of table 42 are for 0.6 to 90 kΩ.
SENSOR_FREQUENCY = (1e3, 10e6)  # allowed frequency of a sensor in Hz
AMPLITUDES = (0.99 * AMPLITUDE_LOW, 1.02 * AMPLITUDE_HIGH)  # allowed peak voltage in V with the rounding of table 42
DIVIDED_FROM = 8.75e6  # sensor frequency in Hz that needs a FIN_DIVIDER of 2
_LARGEST_SHARE_OF_REFERENCE = 0.25
LARGEST_SHARE_OF_SELF_RESONANCE = 0.8  # largest sensor frequency over the self-resonance of its coil
_SMALLEST_QUALITY = 1.0
LARGEST_INPUT_DIVIDER = 15  # largest FIN_DIVIDER
# IDRIVE codes 0 to 31: current in µA, smallest and largest R_p in kΩ.
_DRIVE = (
    (16, 60.0, 90.0), (18, 51.8, 77.6), (20, 44.6, 66.9), (23, 38.4, 57.6), (28, 33.7, 49.7), (32, 29.5, 42.8),
    (40, 23.6, 36.9), (46, 20.5, 31.8), (52, 18.1, 27.4), (59, 16.1, 23.6), (72, 13.1, 20.4), (82, 11.5, 17.6),
    (95, 9.92, 15.1), (110, 8.57, 13.0), (127, 7.42, 11.2), (146, 6.46, 9.69), (169, 5.58, 8.35), (195, 4.83, 7.20),
    (212, 4.45, 6.21), (244, 3.86, 5.35), (297, 3.17, 4.61), (342, 2.76, 3.97), (424, 2.22, 3.42), (489, 1.93, 2.95),
    (551, 1.71, 2.54), (635, 1.48, 2.19), (763, 1.24, 1.89), (880, 1.07, 1.63), (1017, 0.93, 1.40),
    (1173, 0.80, 1.21), (1355, 0.70, 1.05), (1563, 0.60, 0.90),
)  # fmt: skip
DRIVE_CURRENTS = tuple(1e-6 * microamperes for microamperes, _, _ in _DRIVE)
"""Currents of the IDRIVE codes 0 to 31 in A."""
_NAMES = ("sensor frequency (Hz)", DRIVE_WINDOW, "amplitude (V peak)", "quality factor")
BROKEN = ("none", "frequency", "R_p", "amplitude", "Q")  # words for the numbers of `broken_limit`
RESONATOR = ("frequency", "parallel_resistance", "quality_factor")  # variables of a state that decide its readability


@dataclass(frozen=True)
class Drive:
    """Sensor drive: IDRIVE code, current I in A, and peak voltage 4 R_p I/π in V."""

    code: int
    current: float
    amplitude: float


@dataclass(frozen=True)
class Limit:
    """Limit of the converter: a value between `low` and `high`."""

    name: str
    value: float
    low: float
    high: float

    @property
    def kept(self) -> bool:
        """Whether the value is in the range."""
        return self.low <= self.value <= self.high

    @property
    def words(self) -> str:
        """Text of name, value and range in customary units."""
        name, value, allowed = self._texts()
        return f"{name} is {value}; it must be {allowed}"

    @property
    def refusal(self) -> str:
        """Text of the limit as the sentence of an error."""
        name, value, allowed = self._texts()
        return f"{name} must be {allowed}; got {value}."

    def _texts(self) -> tuple[str, str, str]:
        name, _, unit = self.name.removesuffix(")").partition(" (")
        digits = ".6" if not unit and float(self.value).is_integer() else ".4"  # of a count, and of a measure
        value, low, high = (shown_unit(unit, one).text(one, digits) for one in (self.value, self.low, self.high))
        if math.isinf(self.high):
            allowed = f"at least {low}"
        else:
            allowed = f"at most {high}" if self.low <= 0 else f"{low} to {high}"
        return name, value, allowed


def shown_unit(unit: str, value: float) -> DisplayUnit:
    """Return the customary unit of a value."""
    if unit == "Ω" or (unit == "Hz" and value < 1e6):
        return DisplayUnit(f"k{unit}", 1e-3)
    return display_unit(unit)


def drive_for(parallel_resistance: float) -> Drive | None:
    """Return the drive setting of a coil.

    It is the largest current whose row of table 42 holds R_p in Ω at resonance, and whose amplitude
    stays below the clamps. It is None if no row holds R_p.
    """
    require_each_positive(parallel_resistance=parallel_resistance)
    code = int(drive_codes(np.array(parallel_resistance)))
    if code < 0:
        return None
    current = DRIVE_CURRENTS[code]
    return Drive(code, current, 4 * parallel_resistance * current / math.pi)


def drive_codes(parallel_resistance: FloatArray) -> IntArray:
    """Return the IDRIVE codes of `drive_for`, −1 for none."""
    within, any_row = (np.full(parallel_resistance.shape, -1) for _ in range(2))
    for code, (current, low, high) in enumerate(_DRIVE):
        held = (parallel_resistance >= low * 1e3) & (parallel_resistance <= high * 1e3)
        # Some rows of the table exceed the clamps by a few percent. Their neighbours below do not.
        below = held & (4e-6 * current * parallel_resistance / math.pi <= AMPLITUDE_HIGH)
        within[below], any_row[held] = code, code
    return np.where(within >= 0, within, any_row)


def decisive_limits(
    frequency: npt.ArrayLike, parallel_resistance: npt.ArrayLike, quality_factor: npt.ArrayLike, code: int | None = None
) -> list[tuple[FloatArray, FloatArray | float, FloatArray | float]]:
    """Return values and ranges of the limits in `BROKEN`."""
    f, R_p, Q = (np.asarray(one, dtype=np.float64) for one in (frequency, parallel_resistance, quality_factor))
    codes = drive_codes(R_p) if code is None else np.asarray(code)
    amplitude = 4 * R_p * np.array(DRIVE_CURRENTS)[np.maximum(codes, 0)] / math.pi
    low, high = AMPLITUDES
    # Without a row the smallest current is tried. Too low an R_p has broken its own limit already.
    of_amplitude = (np.where(codes < 0, 0.0, low), np.where(codes < 0, AMPLITUDE_HIGH, high))
    quality = Q, _SMALLEST_QUALITY, math.inf
    return [(f, *SENSOR_FREQUENCY), (R_p, *RESISTANCE), (amplitude, *of_amplitude), quality]


def broken_limit(
    frequency: npt.ArrayLike, parallel_resistance: npt.ArrayLike, quality_factor: npt.ArrayLike, code: int | None = None
) -> IntArray:
    """Return the place in `BROKEN` of the first broken limit.

    Frequencies in Hz, R_p at resonance in Ω and quality factors have shape (…). The IDRIVE `code`
    of each sensor comes from `drive_for` by default, so that a limit is broken by any drive.
    """
    limits = decisive_limits(frequency, parallel_resistance, quality_factor, code)
    every = np.stack(np.broadcast_arrays(*((one >= low) & (one <= high) for one, low, high in limits)))
    return np.where(every.all(axis=0), 0, 1 + every.argmin(axis=0))


def shared_drive(frequency: FloatArray, parallel_resistance: FloatArray, quality_factor: FloatArray) -> int:
    """Return the IDRIVE code that reads most sensors, or −1.

    Of codes that read equally many, the code that exceeds 1.8 V at the fewest counts, where clamps
    shift the frequency, then the largest current. Below 0.6 V the oscillation may stop.
    """
    best = (0, 0, -1)
    for code, current in enumerate(DRIVE_CURRENTS):
        read = broken_limit(frequency, parallel_resistance, quality_factor, code) == 0
        above = 4 * current * parallel_resistance / math.pi > AMPLITUDE_HIGH
        if read.any():
            best = max(best, (int(read.sum()), -int((read & above).sum()), code))
    return best[2]


def check_channel(
    frequency: float,
    parallel_resistance: float,
    quality_factor: float,
    self_resonance: float = math.inf,
    *,
    reference: float = REFERENCE,
    divider: int | None = None,
    code: int | None = None,
) -> tuple[Limit, ...]:
    """Return every limit of one channel, kept or not.

    FIN_DIVIDER is the least allowed by default, and the IDRIVE `code` is from `drive_for`. An R_p
    that is allowed but too large for every row of table 42 breaks the limit of the amplitude with
    the smallest drive current. Only channel 0 can be driven harder than `DRIVE_WINDOW` allows, down
    to 250 Ω (HIGH_CURRENT_DRV). An uncalibrated
    internal oscillator may be a fifth below `reference`.
    """
    require_each_positive(frequency=frequency, quality_factor=quality_factor, self_resonance=self_resonance)
    require_each_positive(reference=reference, parallel_resistance=parallel_resistance)
    if divider is None:
        divider = min(least_divider(frequency, reference), LARGEST_INPUT_DIVIDER)
    require_each_positive(divider=divider)
    share = frequency / divider / reference
    decisive = decisive_limits(frequency, parallel_resistance, quality_factor, code)
    sensor, resistance, amplitude, quality = (
        Limit(name, float(value), float(low), float(high))
        for name, (value, low, high) in zip(_NAMES, decisive, strict=True)
    )
    limits = [
        sensor,
        Limit("sensor frequency by divider over reference", share, 0, _LARGEST_SHARE_OF_REFERENCE),
        Limit("frequency over self-resonance", frequency / self_resonance, 0, LARGEST_SHARE_OF_SELF_RESONANCE),
        resistance,
        quality,
        Limit("FIN_DIVIDER", divider, 2 if frequency >= DIVIDED_FROM else 1, LARGEST_INPUT_DIVIDER),
    ]
    if amplitude.low > 0:
        limits.append(amplitude)
    elif resistance.kept:
        limits.append(replace(amplitude, name="amplitude with the smallest drive current (V peak)"))
    return tuple(limits)


def channels_of(scan: xr.Dataset) -> list[tuple[str, float, float, float, float]]:
    """Return state, frequency, R_p, Q and self-resonance of a scan, none without a converter."""
    names = ("state", "frequency", "parallel_resistance", "loaded_quality_factor", "state_self_resonance")
    return list(zip(*(scan[name].values.tolist() for name in names), strict=True)) if "readable" in scan else []


def least_divider(frequency: float, reference: float) -> int:
    """Return the least FIN_DIVIDER of any size."""
    least = math.floor(4 * frequency / reference) + 1  # below a quarter, not at it
    return max(least, 2 if frequency >= DIVIDED_FROM else 1)


def require_each_positive(**values: float) -> None:
    """Refuse named values that are not positive with a ValueError."""
    for name, value in values.items():
        if not value > 0:
            raise ValueError(f"{name} must be positive; got {value}.")


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
    if not design.readout.is_judged:
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
    at = values[dict(zip(values.dims, index, strict=True))]
    words = [str(at.state.values)]
    words += [
        f"{MM.text(at[dim])} {word}" for dim, word in (("distance", "away"), ("depth", "deep")) if dim in at.coords
    ]
    if max(values.sizes.get("x", 1), values.sizes.get("y", 1)) > 1:
        words.append(true_minus(f"x {float(at.x) * 1e3:.4g}, y {float(at.y) * 1e3:.4g} mm"))
    return ", ".join(words)


def _spans(values: FloatArray, chosen: BoolArray, what: str) -> str:
    parts = []
    for read, group in groupby(zip(values.tolist(), chosen.tolist(), strict=True), key=lambda pair: pair[1]):
        inside = [MM.text(value) for value, _ in group]
        if read:
            parts.append(inside[0] if len(inside) == 1 else f"{inside[0]} to {inside[-1]}")
    return ", ".join(parts)
