"""Quantities of a target: its effect on a coil at a distance, and the range and resolution of its distance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from coilarray.errors import GoalError
from coilarray.geometry import Plate
from coilarray.response.coordinates import from_board
from coilarray.response.target_range import FACTOR, ranges_of
from coilarray.studies.quantities.couplings import COIL
from coilarray.studies.quantities.evaluation import Evaluation
from coilarray.studies.quantities.quantity import Option, Quantity, quantity, read_number, read_positive

_DISTANCE = Option(
    "distance_mm", "a number of mm above 0", read_positive, "how far; the design's least distance by default"
)
_PLACE = tuple(
    Option(f"{axis}_mm", "a number of mm", read_number, f"{axis} of the target on the board; over the coil by default")
    for axis in "xy"
)
_NOISE = Option(
    "noise",
    "a number above 0",
    read_positive,
    "standard deviation of δ in a reading; by default that of the noise budget",
)
_OVER = (_DISTANCE, *_PLACE)


def _with_target(name: str, unit: str, variable: str, scale: float, says: str) -> Quantity:
    """Make the quantity of a variable of the target's map."""

    @quantity(name, unit, "target", f"{says}, with the target at a distance", COIL, *_OVER)
    def with_target(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
        at = evaluation.taken(_over(evaluation, options, [evaluation.distance(options.get("distance_mm"))]))
        return scale * float(at[variable].item())

    return with_target


@quantity(
    "target_range_mm", "mm", "target",
    f"distance at which |δ| of a coil has fallen to {FACTOR:g} times the noise; the design's last one where it has not",
    COIL, *_PLACE, _NOISE,
)  # fmt: skip
def _range(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Largest detected distance in mm."""
    found = _ranges(_every_distance(evaluation, options), options)
    value = float(found.range.item())
    if math.isnan(value):
        raise GoalError(
            f"{options['coil']} of {evaluation.design.name} does not detect the target at any distance that the "
            "converter reads."
        )
    return value * 1e3


@quantity(
    "target_deviation_um", "µm", "target", "standard deviation of a distance from one reading",
    COIL, *_OVER, _NOISE,
)  # fmt: skip
def _deviation(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Compute the standard deviation of the distance in µm."""
    distance = evaluation.distance(options.get("distance_mm"))
    known = _every_distance(evaluation, options, distance)
    deviations = _ranges(known, options).distance_deviation.values[:, 0]
    value = float(deviations[np.abs(known.distance.values - distance).argmin()])
    if math.isnan(value):
        raise GoalError(
            f"the converter does not read {options['coil']} of {evaluation.design.name} with the target at "
            f"{distance * 1e3:g} mm, or at no other of its distances."
        )
    return value * 1e6


def _ranges(response: xr.Dataset, options: Mapping[str, Any]) -> xr.Dataset:
    return ranges_of(response, options.get("noise", response.attrs["sigma"]))


def _every_distance(evaluation: Evaluation, options: Mapping[str, Any], wanted: float | None = None) -> xr.Dataset:
    """Map of one coil at all distances.

    The distances belong to the design. A wanted distance is added.
    """
    distances = sorted({*evaluation.target.distances, *([] if wanted is None else [wanted])})
    if len(distances) < 2:
        raise GoalError(
            f"range and deviation need at least two distances of the target; {evaluation.design.name} has one."
        )
    return _over(evaluation, options, distances)


def _over(evaluation: Evaluation, options: Mapping[str, Any], distances: Sequence[float]) -> xr.Dataset:
    """Map of one coil's state at some distances in m.

    The target is over the coil, or at the place given in the options.
    """
    name, target = options["coil"], evaluation.target
    state = evaluation.state_of(name)
    place = evaluation.design.array.centres[evaluation.coil(name)]
    if isinstance(target.body, Plate):
        place = np.array(target.origin_point)
    at = [options.get("x_mm"), options.get("y_mm")]
    places = [float(middle) if given is None else given * 1e-3 for middle, given in zip(place, at, strict=True)]
    (x,), (y,) = (from_board([one], origin) for one, origin in zip(places, target.origin_point, strict=True))
    return evaluation.target_map(distances, x, y).isel(state=[state])


TARGETS = (
    _with_target("target_delta", "1", "delta", 1.0, "relative change of a coil's inductance"),
    _with_target("target_inductance_uH", "µH", "effective_inductance", 1e6, "inductance of a measured coil"),
    _with_target("target_resistance_ohm", "Ω", "effective_resistance", 1.0, "AC resistance of a measured coil"),
    _with_target("target_frequency_MHz", "MHz", "frequency", 1e-6, "resonance of a measured coil with the tank"),
    _with_target("target_q", "1", "quality_factor", 1.0, "quality factor of a measured coil"),
    _with_target("target_parallel_resistance_kohm", "kΩ", "parallel_resistance", 1e-3, "R_p of a measured coil"),
    _range,
    _deviation,
)
