"""Positions of a map that a design does not give: over all coils, close enough for the response of one."""

import numpy as np
import pytest
from support.boards import many_layers, round_spiral

from coilarray.design.body_tables import MOST_POSITIONS, array_window
from coilarray.geometry import Lattice, lattice_array

LARGE = round_spiral(20e-3, 6, 0.15e-3, 0.15e-3).coil()


@pytest.mark.parametrize(("count", "step"), [(1, 1.0e-3), (3, 3.5e-3)])
def test_a_coil_has_a_dozen_steps_and_one_alone_more(count, step):
    """40 mm / 32 = 1.25 mm and 40 mm / 12 = 3.33 mm, to half a millimetre."""
    array = lattice_array(many_layers(2), LARGE, Lattice("linear", 60e-3, count))
    bounds = np.reshape(array.outline_bounds, (2, 2)).T
    for places, (low, high) in zip(array_window(array, (0.0, 0.0)), bounds, strict=True):
        np.testing.assert_allclose(np.diff(places), step, rtol=1e-9)
        assert low - step < places[0] <= low + 1e-9
        assert high - 1e-9 <= places[-1] < high + step


def test_a_wide_board_has_wider_steps_rather_than_too_many_positions():
    array = lattice_array(many_layers(2), LARGE, Lattice("linear", 100.0, 2))  # m
    x, y = array_window(array, (0.0, 0.0))
    assert 0.5 * MOST_POSITIONS < len(x) * len(y) <= MOST_POSITIONS


def test_a_map_of_a_target_over_a_pad_has_some_hundred_positions():
    coil = round_spiral(5e-3, 6, 0.15e-3, 0.15e-3).coil()
    array = lattice_array(many_layers(2), coil, Lattice("square", 13e-3, 4, 4))
    counts = {table: len(x) * len(y) for table in ("indentation", "target")
              for x, y in [array_window(array, (0.0, 0.0), table=table)]}  # fmt: skip
    assert counts["indentation"] > 1500 > 800 > counts["target"] > 300
