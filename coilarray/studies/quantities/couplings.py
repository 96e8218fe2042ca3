"""Quantities of the inductance matrix under the flat sheets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from coilarray.errors import GoalError
from coilarray.studies.quantities.evaluation import Evaluation
from coilarray.studies.quantities.quantity import Option, quantity, read_name, read_pair

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
