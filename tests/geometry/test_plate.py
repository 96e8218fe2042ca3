"""Plates and materials: what is refused, heights of tilted plates, areas of outlines, skin depth."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import shapely

from coilarray.errors import GeometryError
from coilarray.geometry import (
    MATERIAL_SOURCES,
    MATERIALS,
    Disc,
    FinitePlate,
    Material,
    Outline,
    Plate,
    Polygon,
    Rectangle,
    Ring,
)

COPPER = MATERIALS["copper"]


def test_every_named_material_has_its_source() -> None:
    assert MATERIAL_SOURCES.keys() == MATERIALS.keys()
    assert all(name == material.name for name, material in MATERIALS.items())


def test_skin_depth() -> None:
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
def test_outlines_have_their_area(outline: Outline, area: float) -> None:
    assert shapely.Polygon(outline.exterior, outline.holes).area == pytest.approx(area, rel=1e-12)


def test_tilted_plate() -> None:
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
    ("make", "refused"),
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
def test_what_cannot_be_is_refused(make: Callable[[], object], refused: str) -> None:
    with pytest.raises(GeometryError, match=refused):
        make()
