"""Quantities of the circuit: every state of the scan where the converter oscillates, with all losses and strays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from coilarray.hardware.chips.ldc1614_limits import DRIVE_WINDOW, check_channel
from coilarray.studies.quantities.couplings import COIL
from coilarray.studies.quantities.evaluation import Evaluation
from coilarray.studies.quantities.quantity import Option, Quantity, read_name


def effective_inductance(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Inductance of the measured coil in µH, its neighbours terminated."""
    return _of(evaluation, "effective_inductance", options["coil"]) * 1e6


def frequency(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Resonance of the measured coil with the tank in MHz."""
    return _of(evaluation, "frequency", options["coil"]) * 1e-6


def quality(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Quality factor of the measured coil, the least of all states where none is named."""
    if "coil" in options:
        return _of(evaluation, "quality_factor", options["coil"])
    return float(evaluation.scan.quality_factor.min())


def self_resonance_margin(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Self-resonance over the frequency, the least of all states."""
    return float((evaluation.scan.state_self_resonance / evaluation.scan.frequency).min())


def drive_margin(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Relative distance of R_p to the nearer end of the LDC1614's drive window, the least of all states."""
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
    Quantity(
        "effective_inductance_uH",
        "µH",
        "inductance of a measured coil, its neighbours terminated as the scan has them",
        "circuit",
        effective_inductance,
        (COIL,),
    ),
    Quantity("frequency_MHz", "MHz", "resonance of a measured coil with the tank", "circuit", frequency, (COIL,)),
    Quantity(
        "q",
        "1",
        "quality factor of a measured coil with AC resistance",
        "circuit",
        quality,
        (Option("coil", COIL.must_be, read_name, "which coil; the worst state by default", bare=True),),
    ),
    Quantity("srf_margin", "1", "self-resonance over frequency, worst state", "circuit", self_resonance_margin),
    Quantity(
        "drive_margin",
        "1",
        "relative distance of R_p to the nearer end of the LDC1614's drive window, worst state; negative outside",
        "circuit",
        drive_margin,
    ),
)
