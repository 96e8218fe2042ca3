"""Ellipses of every level of one map: those of `fit_ellipses`, with the scatter that repeated measurements have."""

import numpy as np
import pytest
from support.localize_boards import ROW, board

import coilarray.studies.comparison
from coilarray.paper.ellipse import PARAMETERS, fit_ellipses
from coilarray.paper.ellipse_model import published_map
from coilarray.studies.comparison import level_curves

pytestmark = pytest.mark.slow

MAP = published_map().sel(state=["coil2"])
NOISE = np.full((7, 27), 1e-5)
DEVIATIONS = [f"{name}_std" for name in PARAMETERS]


def stacked(curves, names=PARAMETERS):
    return np.array([curves[name] for name in names])


def test_values_are_those_of_the_fit(monkeypatch):
    curves, fits = level_curves(MAP), fit_ellipses(MAP)
    np.testing.assert_array_equal(stacked(curves), [fits[name].values[0] for name in PARAMETERS])
    np.testing.assert_array_equal(curves.level, fits.level)
    assert curves.ellipse_problem == ""
    assert np.isnan(stacked(curves, DEVIATIONS)).all()  # without noise
    monkeypatch.setattr(coilarray.studies.comparison, "REPLICATES", 2)
    quiet = level_curves(MAP, 0 * NOISE)
    for name in PARAMETERS:
        known = np.isfinite(quiet[name])
        np.testing.assert_allclose(quiet[f"{name}_std"][known], 0.0, atol=1e-15)  # rounding of the mean
        assert np.isnan(quiet[f"{name}_std"][~known]).all()


def test_deviations_are_the_scatter_of_repeated_measurements():
    """16 copies against the scatter of 12 other ones about the same map: each is known to about a fifth."""
    told = level_curves(MAP, NOISE)
    random, runs = np.random.default_rng(5), []
    for _ in range(12):
        noisy = level_curves(MAP.assign(delta=MAP.delta + 1e-5 * random.standard_normal(MAP.delta.shape)))
        runs.append(stacked(noisy)[:, :50])
    ratio = stacked(told, DEVIATIONS)[:, 5:50] / np.nanstd(runs, axis=0, ddof=1)[:, 5:50]
    # the median over 45 levels, neighbours of which share points; √(18² + 21²) % each
    np.testing.assert_allclose(np.nanmedian(ratio, axis=1), 1.0, atol=0.35)


def test_noise_that_takes_the_hill_away_is_survived():
    low = board(ROW[:1], peak=1e-4, depth=[1e-3]).isel(state=[0])
    curves = level_curves(low.assign(delta=low.delta * 3), np.full((21, 17), 1e-3))
    assert curves.ellipse_problem == ""
    assert np.isfinite(curves.x0).any()


@pytest.mark.parametrize(("change", "words"), [
    (lambda delta: delta.where(delta.x > 0), "the map has gaps"),
    (lambda delta: -abs(delta), "no closed curves"),
    (lambda delta: delta.x + 0 * delta, "no closed curves"),
])  # fmt: skip
def test_maps_without_ellipses_say_why(change, words):
    curves = level_curves(MAP.assign(delta=change(MAP.delta).transpose(*MAP.delta.dims)), NOISE)
    assert words in str(curves.ellipse_problem.values)
    assert curves.sizes["level"] == 0
