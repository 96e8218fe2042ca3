"""Quantities of the circuit: every state of the scan in which the converter oscillates, with all losses and strays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from coilarray.circuit.converter_limits import DRIVE_WINDOW, check_channel
from coilarray.studies.quantities.couplings import COIL
from coilarray.studies.quantities.evaluation import Evaluation
from coilarray.studies.quantities.quantity import Option, Quantity, quantity, read_name


def _of_state(name: str, unit: str, variable: str, scale: float, says: str) -> Quantity:
    """Make the quantity of a variable of the scan.

    It belongs to the state that measures one coil alone.
    """

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
