"""Ellipses of every level of one map: those of `fit_ellipses`, with the scatter that repeated measurements have."""

import numpy as np
import pytest
from support.localize_boards import ROW, board

from coilarray.paper.ellipse import PARAMETERS, STEP, fit_ellipses
from coilarray.paper.published import published_map
from coilarray.studies.comparison import level_axis, level_curves

pytestmark = pytest.mark.slow

MAP = published_map().sel(state=["coil2"])
NOISE = np.full((7, 27), 1e-5)


def test_values_are_those_of_the_fit():
    curves, fits = level_curves(MAP), fit_ellipses(MAP)
    np.testing.assert_array_equal(curves.values, [fits[name].values[0] for name in PARAMETERS])
    np.testing.assert_allclose(level_axis(curves.values.shape[1]), fits.level.values, rtol=1e-12)
    assert level_axis(2).tolist() == [STEP, 2 * STEP]
    assert np.isnan(curves.deviations).all()
    assert curves.problem == ""


def test_deviations_are_the_scatter_of_repeated_measurements():
    """16 copies against the scatter of 12 other ones about the same map: each is known to about a fifth."""
    told = level_curves(MAP, NOISE, replicates=16, seed=1)
    random, runs = np.random.default_rng(5), []
    for _ in range(12):
        noisy = level_curves(MAP.assign(delta=MAP.delta + 1e-5 * random.standard_normal(MAP.delta.shape)))
        runs.append(noisy.values[:, :50])
    ratio = told.deviations[:, 5:50] / np.nanstd(runs, axis=0, ddof=1)[:, 5:50]
    # the median over 45 levels, neighbours of which share points; √(18² + 21²) % each
    np.testing.assert_allclose(np.nanmedian(ratio, axis=1), 1.0, atol=0.35)
    one, again, other = (level_curves(MAP, NOISE, replicates=3, seed=seed).deviations for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert (one != other).any()


def test_without_noise_or_copies_there_is_no_deviation():
    assert np.isnan(level_curves(MAP, NOISE, replicates=1).deviations).all()
    quiet = level_curves(MAP, 0 * NOISE, replicates=2)
    told = np.isfinite(quiet.values)
    np.testing.assert_allclose(quiet.deviations[told], 0.0, atol=1e-15)  # rounding of the mean
    assert np.isnan(quiet.deviations[~told]).all()


def test_noise_that_takes_the_hill_away_is_survived():
    low = board(ROW[:1], peak=1e-4, depth=[1e-3]).isel(state=[0])
    curves = level_curves(low.assign(delta=low.delta * 3), np.full((21, 17), 1e-3), replicates=3)
    assert curves.problem == ""
    assert curves.values.shape == curves.deviations.shape


@pytest.mark.parametrize(("change", "words"), [
    (lambda delta: delta.where(delta.x > 0), "the map has gaps"),
    (lambda delta: -delta, "no closed curves"),
    (lambda delta: delta.x + 0 * delta, "no closed curves"),
])  # fmt: skip
def test_maps_without_ellipses_say_why(change, words):
    curves = level_curves(MAP.assign(delta=change(MAP.delta).transpose(*MAP.delta.dims)), NOISE)
    assert words in curves.problem
    assert curves.values.shape == curves.deviations.shape == (3, 0)
