"""Shapes of the indenters.

Who checks whom: heights against the equation of each body, cuts against heights, round ones against the paraboloid.
"""

import math
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.refusals import refused

from coilarray.errors import GeometryError
from coilarray.geometry import Cone, CylinderEdge, FlatPunch, Hemisphere, Indenter, Paraboloid

R = 2.5e-3
ALL = [Hemisphere(R), Paraboloid(R), FlatPunch(R), Cone(1.2), Cone(0.5, R), CylinderEdge(R)]


def test_every_indenter_is_listed():
    assert {type(one) for one in ALL} == set(get_args(Indenter))
    assert len({one.name for one in ALL}) == len(get_args(Indenter))
    assert [one.name for one in ALL if one.symmetry == "plane"] == ["cylinder edge"]
    assert all(one.symmetry in ("axial", "plane") for one in ALL)


@pytest.mark.parametrize("indenter", ALL)
def test_profile_starts_at_the_tip_and_never_falls(indenter):
    r = np.linspace(0, 2 * R, 401).reshape(1, -1)
    height = indenter.profile(r)
    assert height.shape == r.shape
    assert height[0, 0] == 0
    within = r <= indenter.largest_radius
    assert np.isfinite(height[within]).all()
    assert np.isinf(height[~within]).all()
    assert (np.diff(height[within]) >= 0).all()


@given(height=st.floats(1e-9, 3 * R), index=st.integers(0, len(ALL) - 1))
def test_cut_is_the_inverse_of_the_profile(height, index):
    indenter = ALL[index]
    r = indenter.radius_at(height)
    assert 0 < r <= indenter.largest_radius
    if r < indenter.largest_radius:
        # both ways round once; near the rim of a ball the slope r/√(R² − r²) enlarges that
        assert float(indenter.profile(r)) == pytest.approx(height, rel=1e-6)
    else:
        assert float(indenter.profile(r)) <= height * (1 + 1e-12)


@pytest.mark.parametrize("indenter", [Hemisphere(R), CylinderEdge(R)])
def test_round_bodies_satisfy_the_equation_of_a_circle(indenter):
    r = np.linspace(0, R, 50)
    # (R − height)² + r² = R²; a few roundings
    assert (R - indenter.profile(r)) ** 2 + r**2 == pytest.approx(np.full(50, R**2), rel=1e-14)


def test_balls_near_their_tip_and_cones():
    r = np.array([1e-9, 1e-7, 1e-5])
    ball, paraboloid = Hemisphere(R).profile(r), Paraboloid(R).profile(r)
    # next term of the series: r⁴/(8R³), relative r²/(4R²) = 4e-6; no digits lost at r = 1 nm
    assert ball == pytest.approx(paraboloid, rel=5e-6)
    assert ball[-1] / paraboloid[-1] - 1 == pytest.approx((r[-1] / (2 * R)) ** 2, rel=1e-3)  # further terms: 1e-5
    assert Cone(math.atan(4.0)).profile([0.0, 1e-3]) == pytest.approx([0.0, 0.25e-3], rel=1e-12)  # roundings
    assert Cone(math.atan(4.0)).largest_radius == math.inf


def test_bodies_that_cannot_be():
    for body in (Hemisphere, Paraboloid, FlatPunch, CylinderEdge):
        for radius in (0.0, -1e-3, math.inf, math.nan):
            refused(GeometryError, "must be positive and finite; got", body, radius)
    for angle in (0.0, -0.1, math.pi / 2, math.nan):
        refused(GeometryError, "between 0 and π/2", Cone, angle)
    for radius in (0.0, -1.0, math.nan):
        refused(GeometryError, "radius of a cone must be positive", Cone, 1.0, radius)
