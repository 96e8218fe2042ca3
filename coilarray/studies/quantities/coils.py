"""Quantities of the coils: shapes and margins, inductances and couplings, and the circuit of every state."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.circuit.converter_limits import DRIVE_WINDOW, check_channel
from coilarray.errors import GoalError
from coilarray.studies.quantities.evaluation import Evaluation, outlines
from coilarray.studies.quantities.quantity import Option, Quantity, quantity, read_name, read_pair

LENGTH_RULES = (
    "trace width", "spacing within net", "clearance", "annular ring", "drill", "hole spacing", "edge clearance",
    "copper thickness", "board size",
)  # fmt: skip
"""Rules whose margin is a length."""

FARTHEST = 9.0
"""Number of limits above which the margin of a distance is not measured and counts as this many limits."""


def _length_rule(given: Any) -> str | None:
    return read_name(given) if given in LENGTH_RULES else None


@quantity("board_area_mm2", "mm²", "geometry", "area of the rectangular board")
def _board_area(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    x_min, y_min, x_max, y_max = evaluation.design.array.bounds
    return (x_max - x_min) * (y_max - y_min) * 1e6


@quantity("span_mm", "mm", "geometry", "extent of the windings' outlines along x")
def _span(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    return float(np.ptp(outlines(evaluation.design)[:, 0])) * 1e3


@quantity("covered_mm2", "mm²", "geometry", "area within the outline of at least one winding")
def _covered(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    placements = evaluation.design.array.placements
    shapes = [shapely.Polygon(place.to_board(place.coil.outline)) for place in placements]
    return float(shapely.area(shapely.union_all(shapes))) * 1e6


@quantity(
    "fab_margin_mm", "mm", "geometry",
    "smallest margin of the fabrication rules about lengths, negative where broken; the check takes more than -0.001 "
    "as kept",
    Option(
        "rule", f"one of {', '.join(LENGTH_RULES)}", _length_rule,
        "this rule alone; distances count up to nine times their limit. All by default", bare=True,
    ),
)  # fmt: skip
def _fab_margin(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Smallest margin in mm of all length rules or of one."""
    wanted = options.get("rule")
    margins = [m.margin * 1e3 for m in evaluation.margins if m.unit == "m" and wanted in (None, m.rule)]
    rules = evaluation.design.rules
    limits = {"clearance": rules.min_gap, "spacing within net": rules.min_gap, "hole spacing": rules.min_hole_spacing}
    if wanted in limits:  # distances far beyond the limit are not listed
        margins.append(FARTHEST * limits[wanted] * 1e3)
    if not margins:
        raise GoalError(f"the rules of {evaluation.design.name} do not limit its {wanted}.")
    return min(margins)


@quantity(
    "fab_broken", "1", "geometry", "number of broken fabrication rules, layers and nets apart; counts and ratios too"
)
def _fab_broken(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    return float(sum(not margin.kept for margin in evaluation.margins))


LAYOUT = (_board_area, _span, _covered, _fab_margin, _fab_broken)


COIL = Option("coil", "the name of a coil", read_name, "which coil", required=True, bare=True)
"""Name of one coil, which is required."""


@quantity("rms_k", "1", "coupling", "root mean square of the coupling coefficients of all pairs")
def _rms_k(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    return float(np.sqrt(np.mean(_pairs(evaluation) ** 2)))


@quantity("worst_k", "1", "coupling", "largest |k| of all pairs")
def _worst_k(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    return float(np.abs(_pairs(evaluation)).max())


@quantity(
    "k", "1", "coupling", "coupling coefficient of one pair, with its sign",
    Option("coils", "the names of two coils", read_pair, "which pair", required=True, bare=True),
)  # fmt: skip
def _k(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    first, second = (evaluation.coil(name) for name in options["coils"])
    return float(evaluation.coupling[first, second])


@quantity("inductance_uH", "µH", "coupling", "self-inductance with sheets and plates, others open", COIL)
def _inductance(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    place = evaluation.coil(options["coil"])
    return float(evaluation.inductance[place, place]) * 1e6


def _pairs(evaluation: Evaluation) -> npt.NDArray[np.float64]:
    count = len(evaluation.design.array.names)
    if count < 2:
        raise GoalError(f"the design {evaluation.design.name} has only one coil, and so no coupling.")
    return np.asarray(evaluation.coupling[np.triu_indices(count, 1)])


COUPLINGS = (_rms_k, _worst_k, _k, _inductance)


def _of_state(name: str, unit: str, variable: str, scale: float, says: str) -> Quantity:
    """Make the quantity of a variable of the scan in the state that measures one coil alone."""

    @quantity(name, unit, "circuit", says, COIL)
    def of_state(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
        return _of(evaluation, variable, options["coil"]) * scale

    return of_state


@quantity(
    "q", "1", "circuit", "quality factor of a measured coil with AC resistance",
    Option("coil", COIL.must_be, read_name, "which coil; the worst state by default", bare=True),
)  # fmt: skip
def _quality(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    if "coil" in options:
        return _of(evaluation, "quality_factor", options["coil"])
    return float(evaluation.scan.quality_factor.min())


@quantity("srf_margin", "1", "circuit", "self-resonance over frequency, worst state")
def _self_resonance_margin(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    return float((evaluation.scan.state_self_resonance / evaluation.scan.frequency).min())


@quantity(
    "drive_margin", "1", "circuit",
    "relative distance of R_p to the nearer end of the LDC1614's window of 1 to 100 kΩ, worst state; negative outside",
)  # fmt: skip
def _drive_margin(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Smallest relative distance from the limits of the drive window."""
    names = ("frequency", "parallel_resistance", "loaded_quality_factor", "state_self_resonance")
    margins = []
    for state in zip(*(evaluation.scan[name].values.tolist() for name in names), strict=True):
        window = next(limit for limit in check_channel(*state) if limit.name == DRIVE_WINDOW)
        margins.append(min(window.value / window.low - 1, 1 - window.value / window.high))
    return min(margins)


@quantity(
    "converter_unread", "1", "circuit",
    "number of values that no LDC1614 can read, of those that the other quantities come from, or of the states",
)  # fmt: skip
def _unread(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    if not evaluation.judged:
        _ = evaluation.scan  # which updates the count
    return float(evaluation.unread)


def _of(evaluation: Evaluation, name: str, coil: str) -> float:
    values: npt.NDArray[np.float64] = evaluation.scan[name].values
    return float(values[evaluation.state_of(coil)])


RESONATORS = (
    _of_state(
        "effective_inductance_uH", "µH", "effective_inductance", 1e6,
        "inductance of a measured coil, its neighbours terminated as the scan has them",
    ),
    _of_state("effective_resistance_ohm", "Ω", "effective_resistance", 1.0,
              "AC resistance of a measured coil at its resonance"),
    _of_state("parallel_resistance_kohm", "kΩ", "parallel_resistance", 1e-3,
              "R_p of a measured coil with the tank at its resonance"),
    _of_state("frequency_MHz", "MHz", "frequency", 1e-6, "resonance of a measured coil with the tank"),
    _of_state("self_resonance_MHz", "MHz", "state_self_resonance", 1e-6,
              "self-resonance of a measured coil, without the tank"),
    _quality, _self_resonance_margin, _drive_margin, _unread,
)  # fmt: skip
