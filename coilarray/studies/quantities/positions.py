"""Accuracy with which readings determine the position: the Cramér–Rao bound over a region."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.errors import GoalError
from coilarray.localize.forward import forward_model
from coilarray.localize.identifiability import identifiability
from coilarray.response.coordinates import from_board
from coilarray.response.interpolation import even_row
from coilarray.studies.quantities.evaluation import Evaluation
from coilarray.studies.quantities.quantity import Option, quantity, read_positive, read_rectangle
from coilarray.studies.quantities.responses import DEPTH

# Against half the spacing and twice the depths the medians of σ_x are accurate to 1 % and the medians of σ_h to 3 %
# (tests/studies/test_quantities.py), and from one mesh to the next they scatter by less.
_STEPS = 6  # positions of the table in the thickness of all sheets
_DEPTHS = (0.85, 1.0, 1.15)  # of the table, relative to the requested depth; δ = 0 at the depth 0 too
_PLACES = (40, 20)  # of the median; even numbers leave out the middle line of a board, where y is not determined


_OPTIONS = (
    Option(
        "region_mm",
        "[x_min, x_max, y_min, y_max] in mm, rising",
        read_rectangle,
        "where on the board; over the outlines of all coils by default",
    ),
    DEPTH,
    Option(
        "noise",
        "a number above 0",
        read_positive,
        "standard deviation of every δ; by default that of the noise budget",
    ),
)


@quantity(
    "position_error_mm", "mm", "table",
    "least standard deviation of x, the depth unknown too: Cramér–Rao bound, median over a region", *_OPTIONS,
)  # fmt: skip
def _position_error(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    return _median(evaluation, options, "sigma_x")


@quantity(
    "depth_error_mm", "mm", "table",
    "least standard deviation of the depth: Cramér–Rao bound, median over a region", *_OPTIONS,
)  # fmt: skip
def _depth_error(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    return _median(evaluation, options, "sigma_h")


def _median(evaluation: Evaluation, options: Mapping[str, Any], name: str) -> float:
    """Median over a region of the standard deviation in mm."""
    depth = evaluation.depth(options.get("depth_mm"))
    given = options.get("region_mm")
    if given is None:
        x_min, x_max, y_min, y_max = evaluation.window(_DEPTHS[-1] * depth)
    else:
        edges, origin = [edge * 1e-3 for edge in given], evaluation.indentation.origin_point
        (x_min, x_max), (y_min, y_max) = from_board(edges[:2], origin[0]), from_board(edges[2:], origin[1])
    step = sum(sheet.thickness for sheet in evaluation.design.sheets) / _STEPS
    table = evaluation.response(depth * np.array(_DEPTHS), even_row(x_min, x_max, step), even_row(y_min, y_max, step))
    bound = identifiability(
        forward_model(table),
        depth,
        noise=options.get("noise"),
        x=_middles(x_min, x_max, _PLACES[0]),
        y=_middles(y_min, y_max, _PLACES[1]),
    )
    median = float(np.median(bound[name].values)) * 1e3
    if math.isinf(median):
        raise GoalError(
            f"the readings of {evaluation.design.name} do not determine the position and depth of the indenter."
        )
    return median


def _middles(start: float, stop: float, count: int) -> FloatArray:
    """Middles of equal parts of an interval."""
    return start + (stop - start) * (np.arange(count) + 0.5) / count


POSITIONS = (_position_error, _depth_error)
