"""Quantities of the shapes alone: sizes and the margins of the fabrication rules."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import shapely

from coilarray.errors import GoalError
from coilarray.studies.quantities.evaluation import Evaluation, outlines
from coilarray.studies.quantities.quantity import Option, quantity, read_name

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
    """Smallest margin of the length rules.

    It is in mm, of all rules or of one rule.
    """
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
