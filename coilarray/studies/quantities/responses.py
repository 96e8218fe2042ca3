"""Quantities of the response to an indentation: its size, its width and the distortion of the paper's ellipses."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from coilarray.errors import GoalError
from coilarray.paper.distortion import DELTAS, ellipse_curves
from coilarray.studies.quantities.couplings import COIL
from coilarray.studies.quantities.evaluation import Evaluation
from coilarray.studies.quantities.quantity import Option, quantity, read_name, read_positive

_STEPS = 8  # positions of a line in the thickness of all sheets (tests/studies/test_quantities.py)


DEPTH = Option("depth_mm", "a number of mm above 0", read_positive, "how deep; the design's first depth by default")
"""Depth of an indentation."""


@quantity(
    "peak_delta", "1", "response",
    "δ of a coil pressed at its centre, or the largest δ pressed at the middle of the array",
    Option("coil", COIL.must_be, read_name, "which coil; the array by default", bare=True), DEPTH,
)  # fmt: skip
def _peak_delta(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Compute δ at a coil's centre.

    Without a coil it is the largest δ at the middle of the coils.
    """
    depth = evaluation.depth(options.get("depth_mm"))
    if "coil" in options:
        state, (x, y) = evaluation.state_of(options["coil"]), evaluation.centre(options["coil"])
        return float(_line(evaluation, y, depth, x)(x)[state])
    centres = evaluation.design.array.centres - evaluation.indentation.origin_point
    x, y = ((centres.min(axis=0) + centres.max(axis=0)) / 2).tolist()
    return float(_line(evaluation, y, depth, x)(x).max())


@quantity(
    "response_width_mm", "mm", "response",
    "distance along x, through the coil's centre, of the first and the last place with half the maximum of δ",
    COIL, DEPTH,
)  # fmt: skip
def _response_width(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Width in mm of a coil's response.

    It is measured at half the peak.
    """
    name = options["coil"]
    state, (x, y) = evaluation.state_of(name), evaluation.centre(name)
    line = _line(evaluation, y, evaluation.depth(options.get("depth_mm")), x)
    delta = CubicSpline(line.x, line(line.x)[:, state], extrapolate=False)
    turning = delta.derivative().roots()
    tops = delta(turning[np.isfinite(turning)])  # a spline that is zero somewhere has roots there that are NaN
    if not tops.size or tops.max() <= 0:
        raise GoalError(f"{name} of {evaluation.design.name} has no response with a peak.")
    half = float(tops.max()) / 2
    if max(delta(line.x[[0, -1]])) >= half:
        raise GoalError(f"δ of {name} does not fall to half its peak on both sides within the sample.")
    return float(np.ptp(delta.solve(half))) * 1e3


@quantity(
    "x0_distortion_mm", "mm", "response",
    "root mean square over δ = 1e-4 to 1e-3 of fitted x0 less the coil's centre, where determined, in its map",
    Option("coil", COIL.must_be, read_name, "which coil; the worst of those in the map by default", bare=True),
)  # fmt: skip
def _x0_distortion(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    """Root mean square of x0 in mm.

    It is the shift of the ellipses from the coil's centre, for the worst coil.
    """
    setup, given = evaluation.indentation.in_ellipse_window(), options.get("coil")
    if given is not None:
        evaluation.state_of(given)  # refused before the map is computed
    response = evaluation.response(np.array(setup.depths[:1]), np.array(setup.x), np.array(setup.y))
    coils = [given] if given is not None else _peaks_within(evaluation, response)
    states = [str(response.state.values[evaluation.state_of(coil)]) for coil in coils]
    curves = ellipse_curves(response, states, DELTAS)
    rms = []
    for coil, x0 in zip(coils, curves.determined_x0, strict=True):
        there = x0[np.isfinite(x0)] - evaluation.centre(coil)[0]
        if there.size:
            rms.append(math.sqrt(float(np.mean(there**2))) * 1e3)
    if not rms:
        raise GoalError(f"the map of {evaluation.design.name} has no ellipses between δ = 1e-4 and 1e-3.")
    return max(rms)


def _line(evaluation: Evaluation, y: float, depth: float, through: float) -> CubicSpline:
    """Spline of δ of every state over x.

    y and depth are in m. Raises GoalError if the line does not reach `through`.
    """
    thickness = sum(sheet.thickness for sheet in evaluation.design.sheets)
    low, high, _, _ = evaluation.window(depth, beyond=thickness)
    if not low <= through <= high:
        raise GoalError(
            f"the indenter at x = {through * 1e3:.4g} mm is outside the sample of {evaluation.design.name}."
        )
    x = np.linspace(low, high, math.ceil(_STEPS * (high - low) / thickness) + 4)
    response = evaluation.response(np.array([depth]), x, np.array([y]))
    return CubicSpline(x, response.delta.values[0, 0])


def _peaks_within(evaluation: Evaluation, response: xr.Dataset) -> list[str]:
    """Coils on the map's x axis with peaks inside.

    A peak is the largest δ of the coil.
    """
    near = np.diff(response.y.values).min(initial=np.inf) / 2
    inside = []
    for name, state in evaluation.own_states.items():
        hill = response.delta.values[0, :, :, state]
        row, column = np.unravel_index(int(np.argmax(hill)), hill.shape)
        within = 0 < row < hill.shape[0] - 1 and 0 < column < hill.shape[1] - 1
        if within and abs(evaluation.centre(name)[1]) <= near:
            inside.append(name)
    if not inside:
        raise GoalError(
            f"no coil of {evaluation.design.name} is on the x axis of its map with the largest δ inside the map."
        )
    return inside


RESPONSES = (_peak_delta, _response_width, _x0_distortion)
