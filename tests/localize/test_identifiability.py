"""How well a board tells position and depth.

Who checks whom: the bound against its closed form on a board whose δ is linear; against the scatter of many solutions
on a board without symmetry; singular where a board is symmetric; more coils never tell less.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.localize_boards import FIELD, ROW, board, response

from coilarray.errors import LocalizeError
from coilarray.localize.forward import forward_model
from coilarray.localize.identifiability import covariance_of, fisher_information, identifiability
from coilarray.localize.inverse import locate_all

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


def test_covariance_is_the_inverse():
    factor = np.random.default_rng(0).standard_normal((7, 3, 3)) * [1e4, 1e3, 1e6]
    information = factor.swapaxes(1, 2) @ factor
    # conditions of up to 1e4 after scaling, times rounding
    assert covariance_of(information) == pytest.approx(np.linalg.inv(information), rel=1e-9)


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


def test_bad_input(field):
    for depth, wrong, message in (
        (5e-3, {}, r"depth of a point must be in the table"),
        (1e-3, {"x": [1.0]}, r"x of a point must be in the table"),
        (1e-3, {"x": [[0.0, 1e-3]]}, r"rows of positions; got shapes \(1, 2\)"),
        *((1e-3, {"noise": noise}, r"noise must be positive") for noise in (0.0, -1.0, np.nan)),
    ):
        with pytest.raises(LocalizeError, match=message):
            identifiability(field, depth, **wrong)
