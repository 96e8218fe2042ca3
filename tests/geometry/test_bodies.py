"""Plates, materials and indenters: what is refused, heights, areas, cuts against heights, skin depth."""

import math
from typing import get_args

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from support.refusals import refused

from coilarray.errors import GeometryError
from coilarray.geometry import (
    MATERIAL_SOURCES,
    MATERIALS,
    Cone,
    CylinderEdge,
    Disc,
    FinitePlate,
    FlatPunch,
    Hemisphere,
    Indenter,
    Material,
    Paraboloid,
    Plate,
    Polygon,
    Rectangle,
    Ring,
)

COPPER = MATERIALS["copper"]


def test_every_named_material_has_its_source():
    assert MATERIAL_SOURCES.keys() == MATERIALS.keys()
    assert all(name == material.name for name, material in MATERIALS.items())


def test_skin_depth():
    """66 µm in copper at 1 MHz, √(2/ωµσ), smaller by the root of µr; none without conductivity."""
    assert COPPER.skin_depth(1e6) == pytest.approx(66.1e-6, rel=1e-3)
    steel = Material("magnetic copper", COPPER.conductivity, 100.0)
    assert steel.skin_depth(1e6) == pytest.approx(COPPER.skin_depth(1e6) / 10)
    assert Material("lossless", 0.0, 10.0).skin_depth(1e6) == math.inf


@pytest.mark.parametrize(
    ("outline", "area"),
    [
        (Disc(10e-3), math.pi * 1e-4),
        (Ring(10e-3, 5e-3), math.pi * 0.75e-4),
        (Rectangle(4e-3, 2e-3), 8e-6),
        (Polygon(((0, 0), (2e-3, 0), (0, 1e-3))), 1e-6),
    ],
)
def test_outlines_have_their_area(outline, area):
    assert shapely.Polygon(outline.exterior, outline.holes).area == pytest.approx(area, rel=1e-12)


def test_tilted_plate():
    """It rises towards its direction by sin(tilt), keeps lengths, and is highest at that end."""
    plate = FinitePlate("target", Rectangle(20e-3, 10e-3), (1e-3, 2e-3, 5e-3), 1e-3, COPPER, math.pi / 6, math.pi / 2)
    ends = plate.on_board(np.array([[0.0, -5e-3], [0.0, 5e-3], [10e-3, 0.0]]))
    np.testing.assert_allclose(ends[1] - ends[0], [0, 10e-3 * math.cos(math.pi / 6), 5e-3], atol=1e-15)
    np.testing.assert_allclose(ends[2], [11e-3, 2e-3, 5e-3], atol=1e-15)
    np.testing.assert_allclose(plate.axes @ plate.axes.T, np.eye(3), atol=1e-15)
    half = 0.5e-3 * math.cos(math.pi / 6)
    assert plate.heights == pytest.approx((2.5e-3 - half, 7.5e-3 + half))
    assert Plate("ground", -2e-3, 0.5e-3, COPPER).heights == pytest.approx((-2e-3, -1.5e-3))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Material("x", -1.0), "conductivity of 'x' must be at least 0"),
        (lambda: Material("x", 1.0, 0.5), "relative permeability of 'x' must be at least 1"),
        (lambda: Material("x", 0.0), "it has neither"),
        (lambda: Plate("p", math.nan, 1e-3, COPPER), "height of plate 'p' must be finite"),
        (lambda: Plate("p", 0.0, 0.0, COPPER), "thickness of plate 'p' must be positive"),
        (lambda: Ring(1e-3, 2e-3), "inner radius of a ring must be less"),
        (lambda: Polygon(((0, 0), (1, 0))), "at least 3 finite corners; got 2"),
        (lambda: Polygon(((0, 0), (1, 1), (1, 0), (0, 1))), "must not cross or touch itself"),
        (lambda: FinitePlate("p", Disc(1e-3), (0, 0, 1e-3), 1e-4, COPPER, math.pi / 2), "less than 90 degrees; got 90"),
        (lambda: FinitePlate("p", Disc(1e-3), (0, 0, math.inf), 1e-4, COPPER), "place of plate 'p' must be finite"),
    ],
)
def test_what_cannot_be_is_refused(make, message):
    with pytest.raises(GeometryError, match=message):
        make()


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
