"""Quantities of the circuit: every state of the scan where the converter oscillates, with all losses and strays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from coilarray.hardware.chips.ldc1614_limits import DRIVE_WINDOW, check_channel
from coilarray.studies.quantities.couplings import COIL
from coilarray.studies.quantities.evaluation import Evaluation
from coilarray.studies.quantities.quantity import Option, quantity, read_name


@quantity(
    "effective_inductance_uH", "µH", "circuit",
    "inductance of a measured coil, its neighbours terminated as the scan has them", COIL,
)  # fmt: skip
def _effective_inductance(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    return _of(evaluation, "effective_inductance", options["coil"]) * 1e6


@quantity("frequency_MHz", "MHz", "circuit", "resonance of a measured coil with the tank", COIL)
def _frequency(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    return _of(evaluation, "frequency", options["coil"]) * 1e-6


@quantity("effective_resistance_ohm", "Ω", "circuit", "AC resistance of a measured coil at its resonance", COIL)
def _effective_resistance(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    return _of(evaluation, "effective_resistance", options["coil"])


@quantity("parallel_resistance_kohm", "kΩ", "circuit", "R_p of a measured coil with the tank at its resonance", COIL)
def _parallel_resistance(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    return _of(evaluation, "parallel_resistance", options["coil"]) * 1e-3


@quantity("self_resonance_MHz", "MHz", "circuit", "self-resonance of a measured coil, without the tank", COIL)
def _self_resonance(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    return _of(evaluation, "state_self_resonance", options["coil"]) * 1e-6


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
    names = ("frequency", "parallel_resistance", "loaded_quality_factor", "state_self_resonance")
    margins = []
    for state in zip(*(evaluation.scan[name].values.tolist() for name in names), strict=True):
        window = next(limit for limit in check_channel(*state) if limit.name == DRIVE_WINDOW)
        margins.append(min(window.value / window.low - 1, 1 - window.value / window.high))
    return min(margins)


def _of(evaluation: Evaluation, name: str, coil: str) -> float:
    values: npt.NDArray[np.float64] = evaluation.scan[name].values
    return float(values[evaluation.state_of(coil)])


RESONATORS = (
    _effective_inductance, _effective_resistance, _parallel_resistance, _frequency, _self_resonance, _quality,
    _self_resonance_margin, _drive_margin,
)  # fmt: skip
