"""Drawn boards, their statistics, and the linearised spread on functions of known derivatives."""

import math

import numpy as np
import pytest
from scipy.stats import kstest, norm, uniform

from coilarray.errors import GoalError
from coilarray.studies.tolerance import Contributor, Limit, draw, errors_of
from coilarray.studies.tolerance.analysis import deviation_error, kept

LAYERS = ("L1", "L2", "L3")


def etch(deviation_of_board, deviation_of_layer, distribution="normal"):
    """Board part and layer parts of one kind of error."""
    targets = tuple(f"etch.{layer}" for layer in LAYERS)
    board = Contributor("etch, board", "etch", "board", targets, distribution, deviation_of_board)
    parts = [
        Contributor(f"etch, layer {layer}", "etch", "layer", (target,), distribution, deviation_of_layer)
        for layer, target in zip(LAYERS, targets, strict=True)
    ]
    return (board, *parts)


@pytest.mark.parametrize(("distribution", "law"), [("normal", norm()), ("uniform", uniform(-(3**0.5), 2 * 3**0.5))])
def test_every_error_has_its_distribution(distribution, law):
    values = draw(etch(2e-6, 3e-6, distribution), 4096, seed=1)
    assert values.shape == (4096, 4)
    for column, deviation in zip(values.T, (2e-6, 3e-6, 3e-6, 3e-6), strict=True):
        # a right law falls below this probability in one of 1000 draws; the seed is fixed
        assert kstest(column / deviation, law.cdf).pvalue > 1e-3


def test_errors_are_independent():
    values = draw(etch(1.0, 1.0), 4096, seed=2)
    off = np.corrcoef(values.T)[np.triu_indices(4, 1)]
    assert np.abs(off).max() < 4 / math.sqrt(4096)  # four standard errors of no correlation


@pytest.mark.parametrize(("parts", "most", "rms"), [(8, 0.1, 0.04), (36, 0.12, 0.04), (90, 0.6, 0.13)])
def test_few_boards_of_many_errors_hardly_correlate(parts, most, rms):
    """As they come, 64 Sobol points have correlations of up to 0.7 among 36 errors; 1/√64 = 0.125 is that of chance."""
    for count in (64, 128, 256):
        values = draw([etch(1.0, 1.0)[0]] * parts, count, seed=0)
        off = np.corrcoef(values.T)[np.triu_indices(parts, 1)]
        assert np.abs(off).max() < most
        assert math.sqrt((off**2).mean()) < rms
        # and each has one board in each of as many equal parts of its range
        assert (np.sort((norm.cdf(values) * count).astype(int), axis=0).T == np.arange(count)).all()


def test_seeds_repeat():
    found = etch(1.0, 1.0)
    one, same, other = (draw(found, 64, seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other)
    # more boards begin with the same ones, so that the cache of a shorter run serves a longer one
    np.testing.assert_array_equal(draw(found, 100, 5)[:64], one)


@pytest.mark.parametrize(("parts", "count", "seed", "message"), [
    (4, -1, 0, "samples must be 0 to 1000000; got -1"), (4, 2_000_000, 0, "samples must be"),
    (4, 8, -1, "seed must not be"), (21202, 8, 0, "at most 21201 dimensions"),  # of Sobol's
])  # fmt: skip
def test_bad_draws_are_refused(parts, count, seed, message):
    assert draw(etch(1.0, 1.0), 0).shape == (0, 4)  # no board at all may be drawn
    with pytest.raises(GoalError, match=message):
        draw([etch(1.0, 1.0)[0]] * parts, count, seed)


def test_the_board_part_moves_all_layers_alike():
    found = etch(2.0, 3.0)
    values = draw(found, 4096, seed=3)
    errors = np.array([[errors_of(found, row)[f"etch.{layer}"] for layer in LAYERS] for row in values])
    np.testing.assert_allclose(errors, values[:, :1] + values[:, 1:], rtol=1e-12)
    # variances add up, and layers share the board's: 4 + 9 and 4, to four standard errors of a covariance
    np.testing.assert_allclose(np.cov(errors.T), 4 + 9 * np.eye(3), atol=4 * 13 * math.sqrt(2 / 4096))


@pytest.mark.parametrize(("law", "kurtosis"), [("normal", 3.0), ("uniform", 1.8)])
def test_the_standard_error_of_a_deviation(law, kurtosis):
    """Against s √((κ − 1)/4n) of a law of kurtosis κ, and against how the deviations of many draws scatter."""
    random = np.random.default_rng(0)
    n, repeats = 200, 4000
    draws = random.standard_normal((n, repeats)) if law == "normal" else random.uniform(-(3**0.5), 3**0.5, (n, repeats))
    assert deviation_error(np.ones((16, 2))).tolist() == [0, 0]
    told = deviation_error(draws)
    # sample kurtosis is low by some 3/n and more of its spread: 3 % at n = 200
    assert told.mean() == pytest.approx(math.sqrt((kurtosis - 1) / (4 * n)), rel=0.03)
    # scatter of 4000 deviations is known to 1/√8000
    assert draws.std(axis=0, ddof=1).std() == pytest.approx(told.mean(), rel=0.06)


def test_the_standard_error_of_few_boards_is_at_least_that_of_a_normal_law():
    """Eight values tell no fourth moment: from theirs alone 0.11 of σ was found where Sobol points were off by 0.27."""
    alike = np.array([-1.0, -1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0])
    assert deviation_error(alike) == pytest.approx(alike.std(ddof=1) / math.sqrt(14))


def test_limits_keep_what_lies_between():
    limits = [Limit("a", at_most=2.0), Limit("b", 1.0, 3.0), Limit("a", at_least=0.0)]
    values = np.array([[2.0, 1.0], [2.1, 2.0], [-1.0, 3.5], [math.nan, 2.0]])
    # a board without the value keeps no limit of it
    assert kept(limits, ["a", "b"], values).tolist() == [[1, 1, 1], [0, 1, 1], [1, 0, 0], [0, 1, 0]]
