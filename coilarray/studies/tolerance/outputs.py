"""Outputs of every board: quantities by name, and δ of every state at positions of the indenter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any

import numpy as np

from coilarray.design.model import Design, build_design
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.errors import GoalError
from coilarray.studies.quantities import Evaluation, request
from coilarray.studies.tolerance.perturb import perturb
from coilarray.studies.tolerance.tolerances import Positions

UNREAD = "unread values"
"""Name of an outcome that is not an output."""
_MOST_OF_ALL_PAIRS = 7  # coils, of which all pairs still make a readable table


def default_quantities(design: Design) -> tuple[str, ...]:
    """Names of all self-inductances and couplings.

    The couplings are between all pairs or, for many coils, between neighbours. These quantities are cheap.

    Examples
    --------
    >>> from coilarray import load_design
    >>> default_quantities(load_design("gast_fem"))
    ('inductance_uH[coil1]',)
    """
    coils = design.array.names
    few = len(coils) <= _MOST_OF_ALL_PAIRS
    of = combinations(range(len(coils)), 2) if few else sorted(design.array.neighbours)
    pairs = tuple(f"k[{coils[i]},{coils[j]}]" for i, j in of)
    return (*(("worst_k", "rms_k") if pairs else ()), *(f"inductance_uH[{coil}]" for coil in coils), *pairs)


@dataclass(frozen=True)
class Outputs:
    """Outputs of a board.

    They are quantities by name, and δ at positions. The names are canonical.
    """

    quantities: tuple[str, ...]
    positions: Positions | None = None
    accuracy: Accuracy = "screen"

    def names(self, design: Design) -> tuple[str, ...]:
        """Names of all outputs of a board of this design.

        Quantities come first, then δ by place and state.
        """
        states = [state.name for state in design.plan]
        deltas = [f"delta[{state},{place}]" for place in self.places() for state in states]
        return (*self.quantities, *deltas)

    def places(self) -> tuple[str, ...]:
        """Positions as they appear in names of outputs."""
        at = self.positions
        if at is None:
            return ()
        return tuple(f"x_mm={_mm(x)},y_mm={_mm(y)},depth_mm={_mm(at.depth)}" for y, x in product(at.y, at.x))

    def item(self, document: Mapping[str, Any], errors: Mapping[str, float]) -> dict[str, Any]:
        """Return one board as plain data, for `evaluate_board`.

        The data can be sent to another process.
        """
        at = self.positions
        return {
            "document": document,
            "errors": dict(errors),
            "quantities": list(self.quantities),
            "positions": None if at is None else {"x": list(at.x), "y": list(at.y), "depth": at.depth},
            "accuracy": self.accuracy,
        }


def wanted_outputs(
    design: Design, quantities: Sequence[str], positions: Positions | None, accuracy: Accuracy = "screen"
) -> Outputs:
    """Check the requested outputs, counting repeated quantities once.

    Raises GoalError if a quantity or coil is unknown, or if positions are given for a design without an indentation.
    """
    if positions is not None and design.indentation is None:
        raise GoalError(f"positions need [indenter] and [indentation], which the design {design.name} does not have.")
    requests = {one.key: one for one in map(request, quantities)}
    if not requests and positions is None:
        raise GoalError("at least one quantity or position must be asked for.")
    nominal = Evaluation(design, accuracy)
    for coil in (coil for one in requests.values() for coil in one.coils):
        nominal.coil(coil)
    return Outputs(tuple(requests), positions, accuracy)


def evaluate_board(item: Mapping[str, Any]) -> dict[str, float]:
    """Compute the outputs of one board, on a worker.

    `item` comes from `Outputs.item`, and the result has the names of `Outputs.names`. `UNREAD` is the number of values
    among them that no converter can read.

    Raises GoalError if the errors leave no board or the board does not have a quantity, and CoilarrayError if the
    physics cannot be solved.
    """
    document = item["document"]
    board = perturb(build_design(document, document["name"]), item["errors"])
    evaluation = Evaluation(board, item["accuracy"])
    values = {name: request(name).value(evaluation) for name in item["quantities"]}
    at = item["positions"]
    if at is None:
        return {**values, UNREAD: float(evaluation.unread)}
    positions = Positions(tuple(at["x"]), tuple(at["y"]), at["depth"])
    response = evaluation.response(np.array([positions.depth]), np.array(positions.x), np.array(positions.y))
    names = Outputs((), positions).names(board)
    deltas = dict(zip(names, response.delta.values[0].ravel().tolist(), strict=True))
    return {**values, **deltas, UNREAD: float(evaluation.unread)}


def _mm(length: float) -> str:
    """Write a length in mm, to the nanometre."""
    return f"{round(length * 1e3, 6):g}"
