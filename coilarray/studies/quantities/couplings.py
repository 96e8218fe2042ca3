"""Quantities of the inductance matrix under the flat sheets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from coilarray.errors import GoalError
from coilarray.studies.quantities.evaluation import Evaluation
from coilarray.studies.quantities.quantity import Option, Quantity, read_name, read_pair


def rms_k(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Root mean square of the coupling coefficients of all pairs."""
    return float(np.sqrt(np.mean(_pairs(evaluation) ** 2)))


def worst_k(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Largest |k| of all pairs."""
    return float(np.abs(_pairs(evaluation)).max())


def k(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Coupling coefficient of one pair, with its sign."""
    first, second = (evaluation.coil(name) for name in options["coils"])
    return float(evaluation.coupling[first, second])


def inductance(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Self-inductance of a coil in µH, all others open."""
    place = evaluation.coil(options["coil"])
    return float(evaluation.inductance[place, place]) * 1e6


def _pairs(evaluation: Evaluation) -> npt.NDArray[np.float64]:
    count = len(evaluation.design.array.names)
    if count < 2:
        raise GoalError(f"the design {evaluation.design.name} has one coil alone, which couples with none.")
    return np.asarray(evaluation.coupling[np.triu_indices(count, 1)])


COIL = Option("coil", "the name of a coil", read_name, "which coil", required=True, bare=True)
"""One coil that must be named."""

COUPLINGS = (
    Quantity("rms_k", "1", "root mean square of the coupling coefficients of all pairs", "coupling", rms_k),
    Quantity("worst_k", "1", "largest |k| of all pairs", "coupling", worst_k),
    Quantity(
        "k",
        "1",
        "coupling coefficient of one pair, with its sign",
        "coupling",
        k,
        (Option("coils", "the names of two coils", read_pair, "which pair", required=True, bare=True),),
    ),
    Quantity("inductance_uH", "µH", "self-inductance under the sheets, others open", "coupling", inductance, (COIL,)),
)
