"""A position over a backplane, from the design file on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.contacts import coarse_maps, first_coils

from coilarray.design.model import parse_design
from coilarray.localize.forward import forward_model
from coilarray.localize.inverse import locate
from coilarray.response.map import response_map


def over_backplane(count, distance_mm=1.0):
    """Return a design of so many coils, with a plate so far below the board."""
    plate = f"""
[[plate]]
name = "backplane"
material = "aluminium"
thickness_mm = 1.0
distance_mm = {distance_mm}
side = "below"
"""
    return parse_design(first_coils(count) + plate)


pytestmark = pytest.mark.slow

DESIGN = over_backplane(3)


def test_an_indentation_over_a_backplane_is_located() -> None:
    x, y = np.arange(-4e-3, 4.1e-3, 2e-3), np.arange(-4.5e-3, 4.6e-3, 3e-3)
    place, depths = (1.3e-3, 1.1e-3), np.array([0.4e-3, 0.7e-3, 1e-3])
    with coarse_maps():
        model = forward_model(response_map(DESIGN, x=x, y=y, depths=depths))
        of_air = forward_model(response_map(replace(DESIGN, plates=()), x=x, y=y, depths=depths))
        seen = response_map(DESIGN, x=[place[0]], y=[place[1]], depths=[0.6e-3]).delta.values.ravel()
    found = locate(model, seen).best
    # splines of a table of 2 and 3 mm; the board is nearly a mirror of itself along y
    assert [found.x, abs(found.y)] == pytest.approx(place, abs=0.1e-3)
    assert found.depth == pytest.approx(0.6e-3, rel=0.02)
    # read with the map of coils alone, the same δ is a dent half as deep, or none at all
    assert locate(of_air, seen).verdict != "located" or locate(of_air, seen).best.depth < 0.45e-3
