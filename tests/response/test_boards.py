"""Responses of several boards against one board with the same coils."""

from dataclasses import replace

import numpy as np
import pytest

import coilarray as ca
from coilarray.design.model import Board, Design, Indentation
from coilarray.geometry import MATERIALS, Ball, Hemisphere, Pose, Sheet, Spiral, Target
from coilarray.geometry.array import Array

ROW = replace(Array.row(Spiral(4, 8e-3, 3, 0.2e-3, 0.2e-3), 2, pitch=14e-3), board_margin=0.5e-3)
LEFT = replace(ROW, placements=ROW.placements[:1])
RIGHT = replace(ROW, placements=(replace(ROW.placements[1], x=0.0, name="coil1"),))
BESIDE = (Board(RIGHT, Pose(x=ROW.placements[1].x), "other"),)


def test_a_dent_over_two_boards_is_a_dent_over_one():
    pressed = Indentation(Hemisphere(5e-3), (0.5e-3,), x=(-2e-3, 3e-3), y=(0.0,))
    sheets = Sheet("base", 2e-3, 1.0, 50e3), Sheet("magnetic", 1e-3, 2.0, 80e3)
    whole = ca.response_map(Design(ROW, sheets=sheets, indentation=pressed))
    apart = ca.response_map(Design(LEFT, sheets=sheets, indentation=pressed, boards=BESIDE))
    # M between boards to 1e-4 of L, which moves δ by less than that of itself
    np.testing.assert_allclose(apart.delta, whole.delta, rtol=1e-4)
    assert apart.state.values.tolist() == ["coil1", "other/coil1"]
    np.testing.assert_allclose(apart.coil_x, whole.coil_x, atol=1e-12)


@pytest.mark.slow
def test_a_target_over_two_boards_is_a_target_over_one():
    ball = Target(Ball(4e-3, MATERIALS["copper"]), (3e-3,), x=(0.0, 4e-3), y=(0.0,))
    whole = ca.target_map(Design(ROW, target=ball))
    apart = ca.target_map(Design(LEFT, target=ball, boards=BESIDE))
    np.testing.assert_allclose(apart.delta, whole.delta, rtol=2e-4)
