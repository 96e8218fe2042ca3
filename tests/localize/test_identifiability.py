"""How well a board tells position and depth, also with noise that is common to all coils.

Who checks whom: the bound against its closed form on a board whose δ is linear; against the scatter of many solutions
on a board without symmetry; singular where a board is symmetric; more coils never tell less; W against the covariance
it is made of; locations with common drift against the ± they state.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2
from support.localize_boards import FIELD, ROW, board, response

from coilarray.errors import LocalizeError
from coilarray.localize.forward import forward_model, whitening, whitening_of
from coilarray.localize.identifiability import covariance_of, fisher_information, identifiability
from coilarray.localize.inverse import deviance, locate, locate_all

AXIS = np.linspace(-10e-3, 10e-3, 5)
SLOPES = np.array([[0.1, 0.0, 0.3], [-0.05, 0.1, 0.5], [0.0, -0.1, 0.4], [0.02, 0.03, -0.1]])  # 1/m
NOISE = np.array([1e-5, 2e-5, 1e-5, 4e-5])


def linear_board(states=4):
    return response(lambda p: p @ SLOPES[:states].T, "abcd"[:states], AXIS, AXIS, [0.0, 1e-3, 2e-3])


@pytest.fixture(scope="module")
def field():
    return forward_model(board(FIELD))


def test_closed_form_of_a_linear_board():
    model = forward_model(linear_board())
    information = fisher_information(model, [[1e-3, 2e-3, 1e-3], [-4e-3, 0.0, 0.5e-3]], NOISE)
    expected = SLOPES.T @ np.diag(NOISE**-2) @ SLOPES
    # rounding of slopes of 0.1 over steps of 0.5 mm: 1e-13
    assert information[0] == pytest.approx(expected, rel=1e-10, abs=1e-9 * expected.max())
    assert information[1] == pytest.approx(information[0], rel=1e-10, abs=1e-9 * expected.max())
    board_map = identifiability(model, 1e-3, noise=NOISE, x=[0.0, 1e-3], y=[2e-3])
    sigma = np.sqrt(np.diag(np.linalg.inv(expected)))
    for name, value in zip(("sigma_x", "sigma_y", "sigma_h"), sigma, strict=True):
        assert board_map[name].dims == ("y", "x")
        assert board_map[name].values == pytest.approx(np.full((1, 2), value), rel=1e-9)
        assert board_map[name].attrs["units"] == "m"
    unit = np.sqrt([*[max(expected[0, 0], expected[1, 1])] * 2, expected[2, 2]])
    scaled = expected / np.outer(unit, unit)
    assert board_map.condition.values[0, 0] == pytest.approx(np.linalg.cond(scaled), rel=1e-9)
    assert board_map.attrs["depth"] == 1e-3
    assert board_map.attrs["noise"] == NOISE.tolist()


def test_bound_grows_with_the_noise(field):
    one, ten = (identifiability(field, 1e-3, noise=noise) for noise in (1e-5, 1e-4))
    for name in ("sigma_x", "sigma_y", "sigma_h"):
        assert ten[name].values == pytest.approx(10 * one[name].values, rel=1e-9)
    assert ten.condition.values == pytest.approx(one.condition.values, rel=1e-6)
    assert one.condition.min() >= 1


@pytest.mark.parametrize("root", [np.zeros((3, 3)), np.diag([1, 0, 1]), np.ones((1, 3)), 1e4 * np.array([[1, 2, 3]])])
def test_singular_information_bounds_nothing(root):
    assert (covariance_of(root.T @ root.astype(float)) == np.where(np.eye(3), np.inf, 0)).all()


def test_middle_line_of_a_symmetric_board_is_singular():
    row = forward_model(board(ROW))
    board_map = identifiability(row, 1e-3, x=np.linspace(-10e-3, 20e-3, 7), y=[-3e-3, 0.0, 3e-3])
    assert np.isinf(board_map.sigma_y.values[1]).all()
    assert np.isinf(board_map.condition.values[1]).all()
    assert np.isfinite(board_map.sigma_y.values[[0, 2]]).all()
    # both sides alike, to the rounding of the spline times the condition
    assert board_map.sigma_y.values[0] == pytest.approx(board_map.sigma_y.values[2], rel=1e-6)
    # far from all coils nothing is told
    near, far = (identifiability(row, 1e-3, x=[x], y=[4e-3]).sigma_x.item() for x in (-4e-3, -20.9e-3))
    assert far > 20 * near


def test_one_depth_leaves_two_unknowns(field):
    models = (forward_model(board(FIELD, depth=[1e-3])), field)
    known, unknown = (identifiability(model, 1e-3, x=[1e-3], y=[2e-3]) for model in models)
    assert "sigma_h" not in known
    # the same x block of the information; one more unknown never helps
    assert known.sigma_x.item() <= unknown.sigma_x.item()


@settings(max_examples=20)
@given(st.floats(-12e-3, 12e-3), st.floats(-8e-3, 8e-3), st.floats(0.3e-3, 1.7e-3))
def test_more_coils_never_tell_less(field, x, y, depth):
    all_coils = fisher_information(field, [x, y, depth], 1e-5)
    fewer = fisher_information(field.select(field.states[:4]), [x, y, depth], 1e-5)
    # the difference of the informations has no negative eigenvalue but for rounding
    assert np.linalg.eigvalsh(all_coils - fewer).min() >= -1e-12 * np.linalg.eigvalsh(all_coils).max()


@pytest.mark.slow
def test_solutions_scatter_as_the_bound_says(field):
    """Maximum likelihood reaches the bound where the noise is small: CRB against Monte Carlo."""
    truth = np.array([2e-3, 1e-3, 1.1e-3])
    readings = field.delta(truth) + 1e-5 * np.random.default_rng(7).standard_normal((1500, 5))
    found = np.array([[b.x, b.y, b.depth] for b in (location.best for location in locate_all(field, readings))])
    bound = covariance_of(fisher_information(field, truth, 1e-5))
    whitened = np.linalg.solve(np.linalg.cholesky(bound), (found - truth).T)
    # unit covariance: variances of 1500 samples scatter by √(2/1500) = 3.7 %, means by 2.6 %; four times that
    assert np.cov(whitened) == pytest.approx(np.eye(3), abs=0.15)
    assert whitened.mean(axis=1) == pytest.approx(np.zeros(3), abs=0.11)


OWN, DRIFT = 1e-6, 1e-5
POINT = np.array([2e-3, 1e-3, 1e-3])
CAUSES = (np.full(5, DRIFT), DRIFT * np.array([0.1, -0.2, 0.3, 0.2, -0.1]))


def covariance(own, causes):
    return np.diag(np.broadcast_to(own, len(causes[0])) ** 2) + sum(np.outer(c, c) for c in causes)


@pytest.fixture(scope="module")
def drifting():
    """A board without symmetry whose coils drift together ten times as much as each scatters."""
    return replace(forward_model(board(FIELD)), noise=OWN, common=CAUSES)


@pytest.mark.parametrize("causes", [CAUSES[:1], CAUSES, (*CAUSES, CAUSES[0])])
def test_whitened_noise_is_of_unit_covariance(causes):
    own = OWN * np.array([[1, 2, 3, 4, 5], [2, 2, 2, 2, 2]])
    W = whitening(own, np.array(causes).T)
    for k, deviations in enumerate(own):
        matrix = W.of(k).slopes(np.eye(5))
        assert matrix @ covariance(deviations, causes) @ matrix.T == pytest.approx(np.eye(5), abs=1e-11)  # rounding
        assert W.residuals(np.ones(5))[k] == pytest.approx(matrix.sum(axis=1), rel=1e-9)


def test_one_cause_has_the_closed_form():
    own = OWN * np.arange(1, 6)
    u = CAUSES[1] / own
    shrunk = np.eye(5) - (1 - 1 / np.sqrt(1 + u @ u)) * np.outer(u, u) / (u @ u)
    assert whitening(own, CAUSES[1][:, None]).slopes(np.eye(5)) == pytest.approx(shrunk / own, rel=1e-9, abs=1e-6 / OWN)


@pytest.mark.slow
def test_the_scatter_is_what_is_stated(drifting):
    """200 readings: their variances over those stated are χ²/199, of which 99.9 % are within 0.70 and 1.36."""
    random = np.random.default_rng(3)
    drift = random.standard_normal((200, 2)) @ np.array(CAUSES)
    readings = drifting.delta(POINT) + OWN * random.standard_normal((200, 5)) + drift
    found = locate_all(drifting, readings)
    places = np.array([[one.best.x, one.best.y, one.best.depth] for one in found])
    stated = np.diag(covariance_of(fisher_information(drifting, POINT)))
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 199) / 199
    assert ((places.var(axis=0, ddof=1) / stated > low) & (places.var(axis=0, ddof=1) / stated < high)).all()
    assert np.mean([one.best.deviations**2 for one in found], axis=0) == pytest.approx(stated, rel=0.05)
    # two degrees of freedom: five coils less three unknowns; the mean of 200 scatters by 2/√200 = 0.14
    assert np.mean([one.chi_square for one in found]) == pytest.approx(2.0, abs=0.45)
    away = [deviance(drifting, reading, one, POINT).item() for reading, one in zip(readings, found, strict=True)]
    assert np.mean(np.array(away) <= chi2.ppf(0.95, 3)) == pytest.approx(0.95, abs=0.05)  # 0.015 by 200 draws
    # one σ for both parts states far more than the scatter: what this test is about
    whole = np.hypot(OWN, drifting.common_noise)
    assert (np.diag(covariance_of(fisher_information(drifting, POINT, whole))) > 2 * stated).any()


def test_nothing_is_pressed_where_all_coils_drift_together(drifting):
    assert locate(drifting, 1.5 * CAUSES[0]).verdict == "nothing pressed"
    assert locate(drifting, 1.5 * CAUSES[0], noise=OWN).verdict != "nothing pressed"


def test_without_a_common_part_sigma_divides(drifting):
    zero = replace(drifting, common=(np.zeros(5),))
    J = drifting.jacobian(POINT)
    np.testing.assert_allclose(fisher_information(zero, POINT), J.T @ J / OWN**2, rtol=1e-12)
    reading = drifting.delta(POINT) + OWN * np.array([1, -1, 2, 0, 1])
    with_zero, without = locate(zero, reading).best, locate(drifting, reading, noise=OWN).best
    assert with_zero.chi_square == pytest.approx(without.chi_square, rel=1e-12)
    assert [with_zero.x, with_zero.y, with_zero.depth] == pytest.approx([*POINT], abs=1e-5)
    for name in ("x", "y", "depth"):
        assert getattr(with_zero, name) == pytest.approx(getattr(without, name), rel=1e-12)


@pytest.mark.parametrize("error", [0.0, 0.05])
def test_the_best_mode_is_where_the_deviance_is_least(drifting, error):
    """Also where the table errs: the error by the mesh counts in the same way in the search and in the region."""
    model = replace(drifting, errors=(error,) * 5 if error else ())
    reading = model.delta(POINT) * (1 + 0.05 * np.array([1, -1, 1, 1, -1])) + CAUSES[0]
    found = locate(model, reading)
    best = np.array([found.best.x, found.best.y, found.best.depth])
    assert deviance(model, reading, found, best) == pytest.approx(0.0, abs=1e-9 * found.chi_square)
    around = best + found.best.deviations * np.random.default_rng(0).standard_normal((100, 3))
    assert deviance(model, reading, found, around).min() > -1e-4  # where the search stops, below a hundredth of σ
    assert (found.verdict == "found") == (error > 0)


def test_the_covariance_less_a_reference(drifting):
    """A reading less the mean of two coils is A δ: its covariance is A Σ Aᵀ."""
    model = drifting.referenced(["coil2", "coil5"])
    A = np.eye(5)[[0, 2, 3]] - np.array([0, 0.5, 0, 0, 0.5])
    matrix = whitening_of(model, None).slopes(np.eye(3))
    np.testing.assert_allclose(matrix @ A @ covariance(OWN, CAUSES) @ A.T @ matrix.T, np.eye(3), atol=1e-11)


def test_a_response_brings_its_common_noise():
    names = ["clock", "capacitor"]
    table = board(FIELD).assign(common_noise=(("drift_cause", "state"), np.array(CAUSES))).assign_attrs(noise=OWN)
    model = forward_model(table.assign_coords(drift_cause=names))
    np.testing.assert_array_equal(model.common, CAUSES)
    few = model.select(["coil4", "coil2", "coil1"])
    np.testing.assert_array_equal(few.common, np.array(CAUSES)[:, [3, 1, 0]])
    np.testing.assert_allclose(few.common_noise, DRIFT * np.sqrt(1 + np.array([0.2, -0.2, 0.1]) ** 2), rtol=1e-12)


def test_bad_input(field):
    for depth, wrong, message in (
        (5e-3, {}, r"depth of a point must be in the table"),
        (1e-3, {"x": [1.0]}, r"x of a point must be in the table"),
        (1e-3, {"x": [[0.0, 1e-3]]}, r"rows of positions; got shapes \(1, 2\)"),
        *((1e-3, {"noise": noise}, r"noise must be positive") for noise in (0.0, -1.0, np.nan)),
    ):
        with pytest.raises(LocalizeError, match=message):
            identifiability(field, depth, **wrong)
