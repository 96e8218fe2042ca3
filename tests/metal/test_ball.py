"""A ball of metal or ferrite over the coils, and in its dent.

Who checks whom: polarisabilities against Bessel functions and limits; every multipole in air against the coils' field,
by Biot–Savart; a small ball against −2π a³ B²/µ0; reflections of sheets, plates and dents against finite elements about
the axis; shallow dents against flat sheets; the coupled matrix against reciprocity and losses.
"""

import numpy as np
import pytest
from scipy.special import lpmv, spherical_in
from support.axial_field import ball_over_sheets
from support.references import polygon

from coilarray import load_design
from coilarray.constants import MU_0
from coilarray.elastomer.dent import Dent
from coilarray.electromagnetics.field import magnetic_field
from coilarray.electromagnetics.flat_stack import Backing, Layer
from coilarray.errors import MetalError
from coilarray.geometry import MATERIALS, Ball, Disc, FinitePlate, Material, Plate, Sheet
from coilarray.metal.ball import _normalised, ball_inductance, indenter_inductance, polarisabilities

RADIUS = 2.5e-3
PERFECT = Material("perfect", np.inf)
SHEETS = (Sheet("base", 6e-3), Sheet("magnetic", 2e-3, 2.6))
LOOPS = [(3e-3, -1e-3), (7e-3, -1e-3), (11e-3, -1e-3)]  # radius and height in m
COILS = [polygon(360, *loop) for loop in LOOPS]


@pytest.mark.parametrize("name", ["copper", "steel", "ferrite"])
def test_polarisabilities_follow_wait(name):
    material, frequency = MATERIALS[name], np.array([1e2, 1e4, 1.5e6])
    mu, order = material.relative_permeability, np.arange(1, 9)
    x = RADIUS * np.sqrt(2j * np.pi * frequency * MU_0 * mu * material.conductivity)[:, None]
    r = x * spherical_in(order - 1, x) / spherical_in(order, x)
    expected = order / (order + 1) * (r - order - (order + 1) * mu) / (r - order + order * mu)
    given = polarisabilities(RADIUS, material, frequency, 8)
    assert given == pytest.approx(expected, rel=1e-10)  # rounding
    static = polarisabilities(RADIUS, material, np.array([0.0]), 8)[0]
    assert static == pytest.approx(-order * (mu - 1) / (order * mu + order + 1), abs=1e-15)
    assert (given.imag >= 0).all()


def test_polarisabilities_never_overflow_and_become_perfect():
    deep = polarisabilities(0.1, MATERIALS["copper"], np.array([1e9]), 60)[0]
    order = np.arange(1, 61)
    # to first order α falls by (2l + 1)/(l + 1) δ(1 + j)/(2a)·l: skin depth 2 µm in 100 mm
    assert deep == pytest.approx(order / (order + 1), rel=3e-3)
    assert (polarisabilities(0.1, PERFECT, np.array([0.0, 1e6]), 60) == order / (order + 1)).all()


def test_small_ball_is_a_dipole():
    """−2π a³ B_i·B_j/µ0, beside the axes of two coils; the field varies by 1 % over the ball."""
    coils = [polygon(360, 10e-3), polygon(6, 12e-3, -2e-3)]
    at = np.array([[3e-3, 2e-3, 8e-3]])
    a = 0.1e-3
    fields = np.array([magnetic_field([coil], at)[0] for coil in coils])
    change = ball_inductance(coils, Ball(a, PERFECT), at, [1e6])[0, 0]
    # 1e-3: the filaments of the circle have corners; the next order is (a/8 mm)²
    assert change.real == pytest.approx(-2 * np.pi * a**3 / MU_0 * fields @ fields.T, rel=1e-3)


@pytest.mark.parametrize("name", ["aluminium", "steel"])
def test_multipoles_in_air_follow_the_field_on_the_ball(name):
    """ΔL_ij = −µ0 Σ_lm (2l + 1) α_l a^(2l+1) A_lm,i A_lm,j, with A_lm from the normal field on a sphere."""
    coils, at, orders = (
        [polygon(6, 9e-3, 0.0), polygon(3, 12e-3, -1e-3, centre=(8e-3, 0))],
        np.array([4e-3, 1e-3, 6e-3]),
        14,
    )
    nodes, weights = np.polynomial.legendre.leggauss(24)
    phi = 2 * np.pi * np.arange(48) / 48
    cos, turn = (part.ravel() for part in np.meshgrid(nodes, phi, indexing="ij"))
    rule = np.repeat(weights, 48) * 2 * np.pi / 48
    normal = np.column_stack((np.sqrt(1 - cos**2) * np.cos(turn), np.sqrt(1 - cos**2) * np.sin(turn), cos))
    radial = np.array([(magnetic_field([coil], at + RADIUS * normal) * normal).sum(axis=1) for coil in coils]) / MU_0
    alpha = polarisabilities(RADIUS, MATERIALS[name], np.array([1e5]), orders)[0]
    expected = np.zeros((2, 2), dtype=complex)
    for order in range(1, orders + 1):
        # the addition theorem sums over m: −R ∂Ψ/∂R = −l Ψ_l
        legendre = np.polynomial.legendre.Legendre.basis(order)(np.clip(normal @ normal.T, -1, 1))
        energy = (radial * rule) @ legendre @ (radial * rule).T * (2 * order + 1) / (4 * np.pi)
        expected -= MU_0 * (2 * order + 1) * alpha[order - 1] / order**2 * RADIUS**3 * energy
    change = ball_inductance(coils, Ball(RADIUS, MATERIALS[name]), [at], [1e5])[0, 0]
    # 1e-6: the 14 orders leave out (2.5/6)^28; the waves are cut where they have fallen by e^−16
    assert change == pytest.approx(expected, rel=1e-5)


def test_changes_are_reciprocal_and_lossy():
    array = load_design("gast2020").array
    places = [[-20e-3, 0, 12e-3], [-14e-3, 3e-3, 10.5e-3], [0, 0, 14e-3]]
    for name in ("copper", "steel"):
        change = ball_inductance(array, Ball(RADIUS, MATERIALS[name]), places, [1e3, 1e6], SHEETS)
        assert (change == change.swapaxes(-1, -2)).all()
        losses = np.linalg.eigvalsh(-change.imag)
        assert (losses.min(axis=-1) > -1e-12 * losses.max(axis=-1)).all()
    near, far = ball_inductance(COILS, Ball(RADIUS, PERFECT), [[0, 0, 0.2], [0, 0, 0.4]], [1e6])[:, 0, 2, 2].real
    assert near / far == pytest.approx(64, rel=0.05)  # the sixth power, once the distance is large against the loop


@pytest.mark.slow
@pytest.mark.parametrize("gap", [0.0, 2e-3])
@pytest.mark.parametrize(("material", "frequency"), [(MATERIALS["ferrite"], 0.0), (Material("metal", 7e6, 20.0), 1e3)])
def test_ball_over_sheets_agrees_with_finite_elements(gap, material, frequency):
    centre = 8e-3 + gap + RADIUS
    expected = ball_over_sheets(LOOPS, RADIUS, centre, material, frequency)
    change = ball_inductance(COILS, Ball(RADIUS, material), [[0, 0, centre]], [frequency], SHEETS)[0, 0].diagonal()
    # elements of 0.1 mm at the ball, 0.2 mm and 0.05 mm: 4e-3, 1e-3; the boundary at 160 mm 1e-3
    assert expected == pytest.approx(change, rel=4e-3)


def test_small_ball_over_a_perfect_conductor_sees_the_mirrored_coils():
    coils, a = [polygon(60, 10e-3, -0.5e-3), polygon(6, 12e-3, -2e-3)], 0.1e-3
    at, back = np.array([[3e-3, 2e-3, 8e-3]]), Plate("back", -6e-3, 1e-3, PERFECT)
    mirrored = [coil * [1, 1, -1] + [0, 0, -10e-3] for coil in coils]  # with the current turned round
    fields = np.array([
        (magnetic_field([coil], at) - magnetic_field([image], at))[0]
        for coil, image in zip(coils, mirrored, strict=True)
    ])  # fmt: skip
    change = ball_inductance(coils, Ball(a, PERFECT), at, [1e6, 2e6], (), [back])[0]
    # the next order is (a/8 mm)², and the ball's own image (a/16 mm)³
    assert change[0].real == pytest.approx(-2 * np.pi * a**3 / MU_0 * fields @ fields.T, rel=1e-3)
    assert change[1] == pytest.approx(change[0], rel=1e-12)


@pytest.mark.slow
def test_a_wide_disc_sends_back_the_field_of_a_near_ball():
    """0.6 % by higher multipoles and the mesh; without what is sent back it would be 1.9 %."""
    ball, aluminium = Ball(RADIUS, MATERIALS["ferrite"]), MATERIALS["aluminium"]
    at = [[1e-3, 0.0, 1e-3 + RADIUS], [4e-3, 2e-3, 4e-3 + RADIUS]]
    disc = FinitePlate("disc", Disc(16e-3), (0.0, 0.0, -3e-3), 1e-3, aluminium)
    coils = [polygon(24, 6e-3, -0.5e-3, centre=(1e-3, 0.0)), polygon(24, 5e-3, -0.8e-3, centre=(-3e-3, 2e-3))]
    found = ball_inductance(coils, ball, at, [1e6], (), [disc], fineness=0.35)
    exact = ball_inductance(coils, ball, at, [1e6], (), [Plate("plate", -3.5e-3, 1e-3, aluminium)])
    np.testing.assert_allclose(found, exact, atol=8e-3 * np.abs(exact).max())


def test_a_plate_of_nothing_leaves_what_a_ball_does():
    arguments = COILS[:2], Ball(RADIUS, MATERIALS["steel"]), [[1e-3, 0, 11e-3]], [1e5], SHEETS
    nothing = Plate("nothing", -6e-3, 1e-3, Material("nothing", 1e-6))
    np.testing.assert_allclose(ball_inductance(*arguments, [nothing]), ball_inductance(*arguments), rtol=1e-9)


@pytest.mark.slow
def test_ball_over_sheets_and_a_plate_agrees_with_finite_elements():
    """Touching ferrite, sheets, coils and 2 mm of aluminium at 2.3 skin depths."""
    centre, ferrite, aluminium, frequency = 8e-3 + RADIUS, MATERIALS["ferrite"], MATERIALS["aluminium"], 1e4
    of_plate = (-6e-3, -4e-3, aluminium.conductivity)
    expected = ball_over_sheets(LOOPS, RADIUS, centre, ferrite, frequency, plate=of_plate)
    plate = Plate("plate", -6e-3, 2e-3, aluminium)
    change, alone = (
        ball_inductance(COILS, Ball(RADIUS, ferrite), [[0, 0, centre]], [frequency], SHEETS, plates)[0, 0].diagonal()
        for plates in ([plate], [])
    )
    # elements of 0.1 mm at the ball, as without the plate; in the plate of 0.8 mm, of the skin depth
    np.testing.assert_allclose(expected.real, change.real, rtol=1e-2)
    assert (change.real < 0.6 * alone.real).all()


REFUSED = {
    "in the sheets": (
        {"centres": [[0, 0, 9e-3]]},
        r"must lie above the sheets, at z >= 8 mm; it reaches down to z = 6.5 mm",
    ),
    "too near": (
        {"centres": [[0, 0, 1.02 * RADIUS]], "sheets": (), "source": [polygon(6, 9e-3)]},
        "must be at least .* mm from the copper; got 0.05",
    ),
    "centres": ({"centres": [[0, 0]]}, r"shape \(n, 3\); got shape \(1, 2\)"),
    "frequencies": ({"frequencies": [-1.0]}, "frequencies must be .* at least 0; got"),
    "coils": ({"source": [polygon(6, 9e-3, 1e-3)]}, "coils must lie at z <= 0"),
    "plates": (
        {"plates": [Plate("lid", 20e-3, 1e-3, PERFECT)]},
        "beside plates below the coils; the top of 'lid' is at z = 21 mm",
    ),
}


@pytest.mark.parametrize(("changes", "message"), REFUSED.values(), ids=REFUSED.keys())
def test_refusals(changes, message):
    given = {"source": COILS[:1], "centres": [[0, 0, 12e-3]], "frequencies": [1e6], "sheets": SHEETS} | changes
    with pytest.raises(MetalError, match=message):
        ball_inductance(ball=Ball(RADIUS, PERFECT), **given)


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
