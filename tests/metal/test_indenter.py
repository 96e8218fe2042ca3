"""A ball of metal or ferrite in its dent: against finite elements about the axis, and against flat sheets elsewhere."""

import numpy as np
import pytest
from scipy.special import lpmv
from support.axial_field import ball_over_sheets
from support.references import polygon

from coilarray.elastomer.dent import Dent
from coilarray.electromagnetics.flat_stack import Backing, Layer
from coilarray.geometry import MATERIALS, Ball, Material, Sheet
from coilarray.metal.ball import _normalised, ball_inductance, indenter_inductance

RADIUS = 2.5e-3
LOOPS = [(3e-3, -1e-3), (7e-3, -1e-3), (11e-3, -1e-3)]  # radius and height in m
COILS = [polygon(360, *loop) for loop in LOOPS]
MU = 2.6


def pressed(depth, ball_radius=RADIUS):
    """Sheets of 6 and 2 mm around a ball: they touch it to 0.9 mm from its axis and fall away from it beyond."""
    r = np.linspace(0, 40e-3, 401)
    edge = 0.9e-3
    ball = -depth + r**2 / (ball_radius + np.sqrt(np.maximum(ball_radius**2 - r**2, 0)))
    slope = edge / np.sqrt(ball_radius**2 - edge**2)
    rim = -depth + ball_radius - np.sqrt(ball_radius**2 - edge**2)
    top = np.where(r < edge, ball, rim * np.exp(slope / rim * (r - edge)))
    return Dent((6e-3, 2e-3), (1.0, MU), r, np.column_stack((0 * r, 0.6 * top, top)))


@pytest.mark.slow
@pytest.mark.parametrize(("material", "frequency"), [(MATERIALS["ferrite"], 0.0), (Material("metal", 3e7), 1e5)])
def test_ball_in_a_dent_agrees_with_finite_elements(material, frequency):
    """Flat sheets under the tip would be 9 % off for the metal and 2 % for ferrite at 0.5 mm in bonded sheets."""
    dent = pressed(1e-3)
    expected = ball_over_sheets(LOOPS, RADIUS, 7e-3 + RADIUS, material, frequency, dent=dent)
    change = indenter_inductance(COILS, Ball(RADIUS, material), [dent], np.zeros((1, 2)), frequency)[0, 0].diagonal()
    # finite elements of 0.1 mm, as beside flat sheets (test_ball.py)
    assert expected == pytest.approx(change, rel=5e-3)


@pytest.mark.slow
def test_ball_in_a_dent_over_a_plate_agrees_with_finite_elements():
    """Ferrite 1 mm deep, and 2 mm of aluminium at 2.3 skin depths below the coils."""
    dent, frequency, ferrite, aluminium = pressed(1e-3), 1e4, MATERIALS["ferrite"], MATERIALS["aluminium"]
    plate = (-5e-3, -3e-3, aluminium.conductivity)
    expected = ball_over_sheets(LOOPS, RADIUS, 7e-3 + RADIUS, ferrite, frequency, dent=dent, plate=plate)
    backing = Backing(-3e-3, (Layer(2e-3, 1.0, aluminium.conductivity),), frequency)
    arguments = COILS, Ball(RADIUS, ferrite), [dent], np.zeros((1, 2)), frequency
    change, alone = (indenter_inductance(*arguments, None, one)[0, 0].diagonal() for one in (backing, None))
    # elements as without the plate, and what the plate sends back of the field of ball and dent
    np.testing.assert_allclose(change.real, expected.real, rtol=1.5e-2)
    assert (change.real < 0.7 * alone.real).all()


@pytest.mark.slow
def test_shallow_dents_become_flat_sheets():
    """Beside the axis, where all harmonics count: a dent of 1 µm against the ball on flat sheets."""
    coils, places = [*COILS, polygon(6, 9e-3, -0.5e-3, centre=(13e-3, 2e-3))], np.array([[0.0, 0.0], [5e-3, 3e-3]])
    ball = Ball(RADIUS, MATERIALS["steel"])
    r = np.linspace(0, 20e-3, 101)
    top = -1e-6 * np.exp(-((r / 2e-3) ** 2))
    dent = Dent((6e-3, 2e-3), (1.0, MU), r, np.column_stack((0 * r, 0.6 * top, top)))
    dented = indenter_inductance(coils, ball, [dent], places, 1e6)[0]
    sheets = (Sheet("base", 6e-3), Sheet("magnetic", 2e-3, MU))
    flat = ball_inductance(coils, ball, [[*place, 8e-3 + RADIUS] for place in places], [1e6], sheets)[:, 0]
    # the elements under the ball, which is 1 µm lower
    assert dented == pytest.approx(flat, rel=3e-3)


def test_harmonics_on_a_sphere_are_orthonormal_at_any_order():
    """∫ P_l P_n dx = δ by a Gauss rule that is exact for them, to rounding; the signs are those of scipy's, without
    that of Condon and Shortley. Factorials up to 200! leave the range of numbers."""
    x, weights = np.polynomial.legendre.leggauss(128)
    for m in (0, 1, 2, 80, 119, 120):
        P = _normalised(120, m, x)
        assert len(P) == 121 - max(m, 1)
        np.testing.assert_allclose((P * weights) @ P.T, np.eye(len(P)), atol=1e-11)
        if m < 3:
            other = (-1) ** m * lpmv(m, 4, x)
            assert (P[4 - max(m, 1)] * weights) @ other > 0.999 * np.sqrt(weights @ other**2)
