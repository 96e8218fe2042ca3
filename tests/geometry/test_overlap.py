"""Copper in copper: bars against boxes whose overlap is known, and the same answer as the fabrication rules give."""

from __future__ import annotations

import numpy as np
import pytest
from support.refusals import refused

from coilarray import FabRules, check_rules, inductance_matrix, load_design, vary
from coilarray.errors import GeometryError
from coilarray.geometry import Conductor
from coilarray.geometry.overlap import require_apart

WIDTH, THICKNESS = 1e-3, 0.1e-3


def bar(start, end, name="second"):
    return Conductor([start, end], WIDTH, THICKNESS, name=name)


FIRST = bar((0, 0, 0), (10e-3, 0, 0), "first")


@pytest.mark.parametrize(
    ("start", "end"),
    [
        ((0, 0.99e-3, 0), (10e-3, 0.99e-3, 0)),  # beside it, 10 µm too near
        ((0, 0, 0.09e-3), (10e-3, 0, 0.09e-3)),  # above it
        ((9.99e-3, 0, 0), (12e-3, 0, 0)),  # behind its end
        ((5e-3, -5e-3, 0), (5e-3, 5e-3, 0)),  # across it
        ((5e-3, 0, -5e-3), (5e-3, 0, 5e-3)),  # a via through it
        ((0, -5e-3, -1e-3), (10e-3, 5e-3, 1e-3)),  # aslant
        ((0, 0, 0), (10e-3, 0, 0)),  # itself
        ((1e-3, 0, 0), (2e-3, 0, 0)),  # within it
    ],
)
def test_bars_that_share_space(start, end):
    refused(GeometryError, "copper of first and second overlaps at", require_apart, [FIRST, bar(start, end)])
    refused(GeometryError, "copper of second and first overlaps at", inductance_matrix, [bar(start, end), FIRST])


@pytest.mark.parametrize(
    ("start", "end"),
    [
        ((0, 1e-3, 0), (10e-3, 1e-3, 0)),  # they touch
        ((0, 0, 0.1e-3), (10e-3, 0, 0.1e-3)),
        ((10e-3, 0, 0), (12e-3, 0, 0)),
        ((0, 1.01e-3, 0), (10e-3, 1.01e-3, 0)),
        ((5e-3, -5e-3, 0.11e-3), (5e-3, 5e-3, 0.11e-3)),  # crosses above
        ((8e-3, -5.9e-3, 0), (16e-3, 2.1e-3, 0)),  # aslant, its bounds overlap, it does not
        ((10e-3, 0, 0), (10e-3, 5e-3, 0)),  # goes on around the corner
        ((10e-3, 0, 0), (10e-3, 0, 5e-3)),  # goes on as a via
    ],
)
def test_bars_that_do_not(start, end):
    require_apart([FIRST, bar(start, end)])


def test_thin_filaments_and_one_path_share_nothing():
    require_apart([Conductor(FIRST.vertices, name="a"), Conductor(FIRST.vertices, name="b")])
    require_apart([Conductor([[0, 0, 0], [1e-2, 0, 0], [5e-3, 1e-5, 0], [5e-3, 1e-2, 0]], WIDTH, THICKNESS)])


def test_random_bars_are_judged_as_by_their_points():
    """Points inside both: bars that have one overlap, and bars that are found apart have none."""
    random = np.random.default_rng(5)
    inside = np.stack(np.meshgrid(*[np.linspace(-0.49, 0.49, 21)] * 3), axis=-1).reshape(-1, 3)
    met = 0
    for _ in range(200):
        one, other = (random.uniform(-1e-3, 1e-3, (2, 3)) for _ in range(2))
        first, second = (Conductor(ends, 0.5e-3, 0.3e-3, name="bar") for ends in (one, other))
        share = _within(second, _points(first, inside)).any() or _within(first, _points(second, inside)).any()
        met += int(share)
        if share:
            refused(GeometryError, "overlaps", require_apart, [first, second])
    assert 20 < met < 180


def _frame(conductor):
    (along,) = np.diff(conductor.vertices, axis=0) / conductor.lengths[:, None]
    across = np.array([-along[1], along[0], 0.0]) / np.hypot(along[0], along[1])
    return np.stack((along, across, np.cross(along, across)))


def _points(conductor, inside):
    sizes = np.array([conductor.lengths[0], conductor.widths[0], conductor.thicknesses[0]])
    return conductor.vertices.mean(axis=0) + (inside * sizes) @ _frame(conductor)


def _within(conductor, points):
    sizes = np.array([conductor.lengths[0], conductor.widths[0], conductor.thicknesses[0]])
    return (np.abs((points - conductor.vertices.mean(axis=0)) @ _frame(conductor).T) < sizes / 2).all(axis=1)


@pytest.mark.parametrize("name", ["starter", "gast2020"])
def test_a_board_is_judged_as_by_the_rules(name):
    """The bundled boards are apart; all coils on one pair of layers overlap by the rules and by the bars."""
    design = load_design(name)
    require_apart(design.array.conductors())
    assert not [one for one in _clearances(design.array) if one.value < 0]
    flat = vary(design, {"array.layers": [["L1", "L2"]]}).array
    overlapping = {one.feature for one in _clearances(flat) if one.value < 0}
    assert "coil1 – coil2" in overlapping
    refused(GeometryError, "copper of coil1 and coil2 overlaps", inductance_matrix, flat)


def _clearances(array):
    return [one for one in check_rules(array, FabRules()) if one.rule == "clearance"]
