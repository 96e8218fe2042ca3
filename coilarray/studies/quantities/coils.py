"""Quantities of shapes, margins, inductances, couplings and the circuit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import shapely

from coilarray.circuit.converter_limits import DRIVE_WINDOW, check_channel
from coilarray.compute.arrays import FloatArray
from coilarray.errors import GoalError
from coilarray.studies.quantities.evaluation import Evaluation
from coilarray.studies.quantities.quantity import Option, Quantity, read_name, read_pair

LENGTH_RULES = (
    "trace width", "spacing within net", "clearance", "annular ring", "drill", "hole spacing", "edge clearance",
    "copper thickness", "board size",
)  # fmt: skip
"""Rules whose margin is a length."""
FARTHEST = 9.0
"""Margin in limits above which a distance is not measured."""
COIL = Option("coil", "the name of a coil", read_name, "which coil", required=True, bare=True)
"""Name of one coil, which is required."""


def coil_or(says: str) -> Option:
    """Option for a coil's name that is not required."""
    return Option("coil", COIL.must_be, read_name, f"which coil; {says} by default", bare=True)


def _board_area(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    x_min, y_min, x_max, y_max = evaluation.design.array.bounds
    return (x_max - x_min) * (y_max - y_min) * 1e6


def _span(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    x_min, _, x_max, _ = evaluation.design.array.outline_bounds
    return (x_max - x_min) * 1e3


def _covered(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    placements = evaluation.design.array.placements
    shapes = [shapely.Polygon(place.to_board(place.coil.outline)) for place in placements]
    return float(shapely.area(shapely.union_all(shapes))) * 1e6


def _fab_margin(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Smallest margin in mm of one or all length rules."""
    wanted = options.get("rule")
    margins = [m.margin * 1e3 for m in evaluation.margins if m.unit == "m" and wanted in (None, m.rule)]
    rules = evaluation.design.rules
    limits = {"clearance": rules.min_gap, "spacing within net": rules.min_gap, "hole spacing": rules.min_hole_spacing}
    if wanted in limits:  # distances far beyond the limit are not listed
        margins.append(FARTHEST * limits[wanted] * 1e3)
    if not margins:
        raise GoalError(f"the rules of {evaluation.design.name} do not limit its {wanted}.")
    return min(margins)


def _inductance(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    place = evaluation.coil(options["coil"])
    return float(evaluation.inductance[place, place]) * 1e6


def _pairs(evaluation: Evaluation) -> FloatArray:
    """Coupling coefficients of all pairs."""
    count = len(evaluation.design.array.names)
    if count < 2:
        raise GoalError(f"the design {evaluation.design.name} has only one coil, and so no coupling.")
    return np.asarray(evaluation.coupling[np.triu_indices(count, 1)])


def _of_state(name: str, unit: str, variable: str, scale: float, says: str) -> Quantity:
    """Quantity of a scan's variable for one coil alone."""

    def of_state(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
        return float(evaluation.scan[variable].values[evaluation.state_of(options["coil"])]) * scale

    return Quantity(name, unit, "circuit", says, of_state, (COIL,))


def _quality(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    quality = evaluation.scan.quality_factor.values
    return float(quality[evaluation.state_of(options["coil"])] if "coil" in options else quality.min())


def _drive_margin(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Smallest relative distance from the limits of the drive window."""
    names = ("frequency", "parallel_resistance", "loaded_quality_factor", "state_self_resonance")
    margins = []
    for state in zip(*(evaluation.scan[name].values.tolist() for name in names), strict=True):
        window = next(limit for limit in check_channel(*state) if limit.name == DRIVE_WINDOW)
        margins.append(min(window.value / window.low - 1, 1 - window.value / window.high))
    return min(margins)


def _unread(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    if not evaluation.judged:
        _ = evaluation.scan  # which updates the count
    return float(evaluation.unread)


COILS = (
    Quantity("board_area_mm2", "mm²", "geometry", "area of the rectangular board", _board_area),
    Quantity("span_mm", "mm", "geometry", "extent of the windings' outlines along x", _span),
    Quantity("covered_mm2", "mm²", "geometry", "area within the outline of at least one winding", _covered),
    Quantity(
        "fab_margin_mm", "mm", "geometry",
        "smallest margin of the fabrication rules about lengths, negative where broken; the check takes more than "
        "-0.001 as kept", _fab_margin,
        (Option("rule", f"one of {', '.join(LENGTH_RULES)}",
                lambda given: read_name(given) if given in LENGTH_RULES else None,
                "this rule alone; distances count up to nine times their limit. All by default", bare=True),),
    ),
    Quantity(
        "fab_broken", "1", "geometry",
        "number of broken fabrication rules, layers and nets apart; counts and ratios too",
        lambda evaluation, _: float(sum(not margin.kept for margin in evaluation.margins)),
    ),
    Quantity(
        "rms_k", "1", "coupling", "root mean square of the coupling coefficients of all pairs",
        lambda evaluation, _: float(np.sqrt(np.mean(_pairs(evaluation) ** 2))),
    ),
    Quantity(
        "worst_k", "1", "coupling", "largest |k| of all pairs",
        lambda evaluation, _: float(np.abs(_pairs(evaluation)).max()),
    ),
    Quantity(
        "k", "1", "coupling", "coupling coefficient of one pair, with its sign",
        lambda evaluation, options: float(evaluation.coupling[tuple(map(evaluation.coil, options["coils"]))]),
        (Option("coils", "the names of two coils", read_pair, "which pair", required=True, bare=True),),
    ),
    Quantity(
        "inductance_uH", "µH", "coupling", "self-inductance with sheets and plates, others open", _inductance, (COIL,)
    ),
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
    Quantity("q", "1", "circuit", "quality factor of a measured coil with AC resistance", _quality,
             (coil_or("the worst state"),)),
    Quantity(
        "srf_margin", "1", "circuit", "self-resonance over frequency, worst state",
        lambda evaluation, _: float((evaluation.scan.state_self_resonance / evaluation.scan.frequency).min()),
    ),
    Quantity(
        "drive_margin", "1", "circuit",
        "relative distance of R_p to the nearer end of the LDC1614's window of 1 to 100 kΩ, worst state; negative "
        "outside", _drive_margin,
    ),
    Quantity(
        "converter_unread", "1", "circuit",
        "number of values that no LDC1614 can read, of those that the other quantities come from, or of the states",
        _unread,
    ),
)  # fmt: skip
"""Quantities by rising cost."""
