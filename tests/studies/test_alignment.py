"""Scale and shift of one map onto another: found again where they are known, told with the right uncertainty."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.localize_boards import ROW, bells, response

from coilarray.localize.forward import forward_model
from coilarray.studies.comparison import align

SHIFT = (2e-3, 2e-3)
AXES = (np.arange(-20e-3, 20.1e-3, 1e-3) + at for at in ROW[0])
WIDE = response(lambda points: bells(points, ROW[:1]), ["coil1"], *AXES, [1e-3])
MODEL = forward_model(WIDE)


def grid(step=2e-3, half=10e-3):
    """Places (n, 3) about the coil, well inside the table."""
    axis = np.arange(-half, half + step / 2, step)
    x, y = np.meshgrid(axis + ROW[0][0], axis)
    return np.column_stack((x.ravel(), y.ravel(), np.full(x.size, 1e-3)))


def moved(places, shift=(0.0, 0.0)):
    return bells(places - [*shift, 0.0], ROW[:1])[:, 0]


GRID = grid()


@given(scale=st.floats(0.2, 3.0), shift=st.tuples(st.floats(-1.8e-3, 1.8e-3), st.floats(-1.8e-3, 1.8e-3)))
@settings(max_examples=25)
def test_scale_and_shift_are_found_again(scale, shift):
    found = align(MODEL, GRID, scale * moved(GRID, shift), largest_shift=SHIFT)
    # a cubic spline through positions 1 mm apart follows a bell of 8 mm to 1e-4 of its height
    assert found.scale == pytest.approx(scale, rel=3e-4)
    np.testing.assert_allclose(found.shift, shift, atol=2e-6)
    assert not found.at_limit
    assert found.used.all()


@pytest.mark.slow
def test_deviations_are_those_of_repeated_noisy_maps():
    """With noise that differs from place to place, against the scatter of 150 fits, which is known to 6 %."""
    shift, sigma = (0.5e-3, -0.3e-3), np.where(GRID[:, 0] > ROW[0][0], 3e-5, 1e-5)
    noisy = 1.2 * moved(GRID, shift) + sigma * np.random.default_rng(0).standard_normal((150, len(GRID)))
    runs = [align(MODEL, GRID, values, largest_shift=SHIFT, noise=sigma) for values in noisy]
    unknowns = np.array([(run.scale, *run.shift) for run in runs])
    told = np.array([(run.scale_std, *run.shift_std) for run in runs]).mean(axis=0)
    np.testing.assert_allclose(unknowns.std(axis=0), told, rtol=0.23)  # four standard deviations of a scatter of 150
    away = (unknowns.mean(axis=0) - [1.2, *shift]) / told
    assert np.abs(away).max() < 5 / np.sqrt(150) + 0.1  # the mean; 0.1 for the spline


def test_without_noise_given_the_scatter_of_what_remains_counts():
    values = moved(GRID) + 2e-5 * np.random.default_rng(1).standard_normal(len(GRID))
    alone, given_noise = (align(MODEL, GRID, values, largest_shift=SHIFT, noise=noise) for noise in (None, 2e-5))
    assert alone.scatter == pytest.approx(2e-5, rel=0.3)  # 121 places: 6 % is one standard deviation
    np.testing.assert_allclose(alone.scale_std / given_noise.scale_std, alone.scatter / 2e-5, rtol=1e-9)
    assert alone.scale == given_noise.scale


def test_a_shift_beyond_the_reach_is_told():
    half = (0.5e-3, 0.5e-3)
    found = align(MODEL, GRID, moved(GRID, (1e-3, 0.0)), largest_shift=half)
    assert found.at_limit
    assert found.shift[0] == pytest.approx(0.5e-3, rel=1e-2)
    assert not align(MODEL, GRID, moved(GRID, (0.4e-3, 0.0)), largest_shift=half).at_limit


def test_nothing_is_extrapolated():
    places = grid(half=19e-3)
    found = align(MODEL, places, moved(places, (1e-3, 0.0)), largest_shift=(1.5e-3, 0.0))
    np.testing.assert_array_equal(found.used, np.abs(places[:, 0] - ROW[0][0]) <= 18.5e-3)
    assert np.isnan(found.shift[1])  # its reach is 0
    assert found.shift[0] == pytest.approx(1e-3, abs=2e-6)


def test_few_places_tell_the_scale_alone():
    few, one = (align(MODEL, GRID[:n], 1.5 * moved(GRID[:n]), largest_shift=SHIFT) for n in (7, 1))
    assert [few.scale, one.scale] == pytest.approx([1.5, 1.5], rel=1e-3)
    assert np.isnan(few.shift).all()
    assert few.used.all()
    assert np.isnan([one.scale_std, one.scatter]).all()  # one place has no scatter


def test_a_shift_that_the_noise_hides_is_not_told():
    values = 1e-2 * np.random.default_rng(2).standard_normal(len(GRID))
    found = align(MODEL, GRID, values, largest_shift=SHIFT, noise=1e-2)
    assert np.isnan(found.shift).all()
    assert found.scale_std > 0.5
    assert not found.at_limit


@pytest.mark.parametrize("factor", [0.0, 1e-200])  # the square of the latter is 0
def test_flat_maps_tell_nothing(factor):
    found = align(forward_model(WIDE.assign(delta=factor * WIDE.delta)), GRID, moved(GRID), largest_shift=SHIFT)
    assert np.isnan([found.scale, found.scale_std, *found.shift, *found.shift_std]).all()
    zero = align(MODEL, GRID, np.zeros(len(GRID)), largest_shift=SHIFT)
    assert zero.scale == 0
    assert np.isnan(zero.shift).all()
    nowhere = align(MODEL, GRID + np.array([1.0, 0.0, 0.0]), moved(GRID), largest_shift=SHIFT)
    assert np.isnan(nowhere.scale)
    assert not nowhere.used.any()
