"""Measured beside simulated response: what is known to differ is found, what is the same is said to be the same."""

import numpy as np
import pytest
import xarray as xr
from support.localize_boards import ROW, bells, response

import coilarray.studies.comparison
from coilarray.errors import LocalizeError
from coilarray.paper.ellipse import PARAMETERS, fit_ellipses
from coilarray.paper.ellipse_model import published_map
from coilarray.studies.comparison import compare_responses, level_curves

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("no_noisy_copies")]

STATES = ["coil1", "coil2", "coil3"]
NOISE = 1e-5
FIGURES = ("scale", "rms_before", "rms_after", "correlation_before", "correlation_after")


def world(scale=1.0, shift=(0.0, 0.0), x=26e-3, y=8e-3, step=2e-3, depth=(1e-3,), states=STATES):
    """Response of the bells, scaled and shifted."""
    axes = (np.arange(-reach, reach + step / 2, step) for reach in (x, y))
    hills = lambda points: scale * bells(points - [*shift, 0.0], ROW[:3], peak=1.2e-3)  # noqa: E731
    return response(lambda points: hills(points)[..., : len(states)], states, *axes, list(depth))


def noisy(dataset, seed=0, noise=NOISE):
    delta = dataset.delta + noise * np.random.default_rng(seed).standard_normal(dataset.delta.shape)
    return dataset.assign(delta=delta, delta_std=xr.full_like(dataset.delta, noise))


WIDE = world(x=30e-3, y=12e-3, step=1e-3)
"""What is simulated: finer than what is measured, and larger by more than a shift."""
NARROW = world(x=12e-3, states=["coil2"])


def compared(measured, simulated=WIDE, **options):
    return compare_responses(measured, simulated, **options)


def test_a_map_is_equal_to_itself():
    measured = published_map()
    found = compared(measured, measured)
    np.testing.assert_allclose(found.scale, 1.0, rtol=0, atol=1e-14)  # rounding of sums of 125 products
    np.testing.assert_allclose(found["shift"], 0.0, atol=1e-15)
    np.testing.assert_allclose(found.correlation_before, 1.0, atol=1e-14)
    for name in ("residual_before", "residual_after"):
        np.testing.assert_allclose(found[name], 0.0, atol=1e-17)  # rounding of a spline at its own knots
    for name in PARAMETERS:
        np.testing.assert_allclose(found[name][0], found[name][1], atol=1e-9)
    np.testing.assert_allclose(found.delta[0], measured.delta)
    assert not found.at_limit.any()
    assert (found.attrs["noise_from"], found.attrs["points_left_out"]) == ("residuals", 0)
    assert found.attrs["measured_source"] == measured.attrs["source"]


@pytest.mark.parametrize("seed", range(4))
def test_scale_and_shift_are_recovered_within_their_uncertainty(seed):
    scale, shift = 1.15, (0.45e-3, -0.3e-3)
    found = compared(noisy(world(scale, shift), seed))
    # 9 numbers of each of 4 seeds: beyond 3.9 standard deviations once in 300 runs of the test; seeds are fixed
    assert (np.abs(found.scale - scale) / found.scale_std).max() < 3.9
    assert (np.abs(found["shift"] - np.array(shift)) / found.shift_std).max() < 3.9
    assert (found.scale_std < 2e-3).all()
    assert (found.shift_std < 0.02e-3).all()
    # what remains is the noise: its mean square over 27·9 positions has a relative standard deviation of √(2/243)
    np.testing.assert_allclose(found.rms_after, NOISE, rtol=4 * np.sqrt(0.5 / 243))
    np.testing.assert_allclose(found.noise, NOISE, rtol=1e-12)
    assert (found.rms_before > 5 * found.rms_after).all()
    assert (found.correlation_after > found.correlation_before).all()
    assert (found.points == 243).all()


def test_the_uncertainties_are_those_of_repeated_measurements(monkeypatch):
    """Every figure's standard deviation against the scatter over 30 seeds, which is known to 13 %."""
    none = level_curves(-NARROW)
    monkeypatch.setattr(coilarray.studies.comparison, "level_curves", lambda *_: none)
    measured = world(1.1, (0.3e-3, 0.0))
    runs = [compared(noisy(measured, seed)) for seed in range(30)]
    for name in (*FIGURES, "shift"):
        seen = np.std([run[name].values for run in runs], axis=0, ddof=1)
        told = np.mean([run[f"{name}_std"].values for run in runs], axis=0)
        np.testing.assert_allclose(told, seen, rtol=0.52, err_msg=name)  # four of its standard deviations


def test_residuals_are_the_difference():
    measured = noisy(world(1.1))
    found = compared(measured, world())
    np.testing.assert_allclose(found.residual_before, measured.delta - world().delta, atol=1e-17)
    simulated = found.delta.sel(source="simulated")
    np.testing.assert_allclose(simulated, world().delta, atol=1e-17)
    inner = {"x": slice(-20e-3, 20e-3), "y": slice(-4e-3, 4e-3)}
    remains = (measured.delta - found.scale * simulated).sel(inner)
    # the shift of a few µm that noise feigns moves a slope of 1e-3 a mm by 1e-5 at most
    np.testing.assert_allclose(found.residual_after.sel(inner), remains, atol=1e-5)
    used = found.residual_before.isel(x=slice(1, -1), y=slice(1, -1))
    assert (found.points == 25 * 7).all()  # by a shift of one spacing inside the simulated map
    np.testing.assert_allclose(found.rms_before, np.sqrt((used**2).mean(("x", "y"))), rtol=1e-12)


def test_simulated_positions_are_interpolated_never_extrapolated():
    fine = world(x=19e-3, y=20e-3, step=1.1e-3)
    measured = noisy(world())
    found = compared(measured, fine)
    outside = np.abs(measured.x.values) > 19e-3
    assert np.isnan(found.residual_before.values[:, :, outside]).all()
    assert np.isnan(found.delta.sel(source="simulated").values[:, :, outside]).all()
    assert np.isfinite(found.residual_before.values[:, :, ~outside]).all()
    assert found.attrs["points_left_out"] == 9 * outside.sum() * 3
    np.testing.assert_allclose(found.scale, 1.0, atol=0.01)
    window = measured.isel(x=np.flatnonzero(~outside))
    fits = fit_ellipses(window, states=["coil2"])  # the measured ellipses are of the common window
    np.testing.assert_array_equal(found.x0.sel(source="measured", state="coil2")[0, : fits.sizes["step"]], fits.x0[0])


def test_ellipses_of_both_are_side_by_side(monkeypatch):
    monkeypatch.setattr(coilarray.studies.comparison, "REPLICATES", 8)
    told = []
    simulated = WIDE.sel(state=["coil2"])
    found = compared(noisy(world(1.0, (0.5e-3, 0.0))), simulated, progress=lambda *counted: told.append(counted))
    assert told == [(1, 2), (2, 2)]
    of = found.sel(state="coil2").isel(depth=0)
    known = np.isfinite(of.x0).all("source") & (of.level < 9e-4) & (of.level > 2e-4)
    apart = (of.x0.sel(source="measured") - of.x0.sel(source="simulated"))[known.values]
    assert known.sum() > 20
    # the mean over levels of a shift of 0.5 mm; each is known to about 0.05 mm and neighbours share points
    assert float(apart.mean()) == pytest.approx(0.5e-3, abs=0.05e-3)
    deviation = of.x0_std.sel(source="measured")[known.values]
    assert (deviation > 0).all()
    assert np.isnan(of.x0_std.sel(source="simulated")).all()
    assert (np.abs(apart - 0.5e-3) < 5 * deviation).mean() > 0.95
    np.testing.assert_allclose(found.level, 3e-5 * np.arange(1, found.sizes["level"] + 1), rtol=1e-12)


def test_states_that_one_alone_has_are_named():
    first, second = world(), world().assign_coords(state=["coil2", "coil3", "coil9"])
    found = compared(first, second)
    assert found.state.values.tolist() == ["coil2", "coil3"]
    assert (found.attrs["only_measured"], found.attrs["only_simulated"]) == ("coil1", "coil9")
    with pytest.raises(LocalizeError, match="no state in common: measured coil1, coil2, coil3; simulated a, b, c"):
        compared(first, first.assign_coords(state=["a", "b", "c"]))
    found = compared(first, first.isel(state=[2, 0, 1]))  # matched by name, not by place
    np.testing.assert_allclose(found.scale, 1.0, atol=1e-13)


def test_every_depth_has_its_own_figures():
    depths = [0.5e-3, 1e-3, 1.5e-3]
    simulated = world(depth=[0.5e-3, 0.75e-3, 1e-3, 1.25e-3])
    found = compared(world(1.2, depth=depths), simulated)
    assert found.depth.values.tolist() == depths[:2]
    assert found.attrs["depths_left_out"] == "0.0015"
    assert found.scale.shape == (2, 3)
    np.testing.assert_allclose(found.scale, 1.2, atol=1e-12)
    between = compared(world(depth=[0.9e-3]), simulated)
    np.testing.assert_allclose(between.scale, 1.0, atol=1e-3)  # a cubic in depth through four planes and zero
    with pytest.raises(LocalizeError, match="no depth in common: measured 2 mm; simulated 1 mm"):
        compared(world(depth=[2e-3]), world())


def test_gaps_of_a_measurement_are_left_out():
    measured = noisy(world(1.1))
    measured.delta[0, 3, 4, 0] = np.nan
    measured.delta_std[0, 3, 4, 0] = np.nan
    found = compared(measured)
    assert found.points.values.tolist() == [[242, 243, 243]]
    np.testing.assert_allclose(found.scale, 1.1, atol=0.01)
    assert found.ellipse_problem.sel(source="measured").values.tolist() == [["the map has gaps.", "", ""]]
    assert np.isnan(found.residual_after[0, 3, 4, 0])
    assert found.attrs["points_left_out"] == 0
    with pytest.raises(LocalizeError, match="no measured position is in the simulated map"):
        compared(measured.assign(delta=measured.delta * np.nan))


def test_a_line_of_positions_tells_no_shift_across():
    found = compared(noisy(world()).sel(y=[0.0]))
    assert np.isnan(found["shift"].sel(axis="y")).all()
    assert np.isfinite(found["shift"].sel(axis="x")).all()
    problems = found.ellipse_problem.sel(source="measured").values.ravel()
    assert all("at least 4 positions along y" in text for text in problems)
    np.testing.assert_allclose(found.scale, 1.0, atol=0.02)


def test_two_measurements_share_their_noise():
    found = compared(noisy(world(), 1, 3e-5), noisy(world(), 2, 4e-5))
    np.testing.assert_allclose(found.noise, 5e-5, rtol=1e-12)
    np.testing.assert_allclose(found.rms_after, 5e-5, rtol=0.2)
    assert (np.abs(found.scale - 1) < 4 * found.scale_std).all()


def test_noise_that_some_positions_do_not_tell_is_that_of_the_others():
    measured = noisy(world())
    measured.delta_std[0, :4, :, 1] = np.nan
    np.testing.assert_allclose(compared(measured).noise, NOISE, rtol=1e-12)
    measured.delta_std[:] = np.nan
    assert compared(measured).attrs["noise_from"] == "residuals"
    of_state = world().assign(delta_std=("state", [1e-5, 2e-5, 3e-5]))
    np.testing.assert_allclose(compared(of_state).noise, [[1e-5, 2e-5, 3e-5]])


def test_inductances_stand_beside_each_other():
    first = world().assign(base_inductance=("state", [1e-6, 2e-6, 3e-6]))
    found = compared(first, world().isel(state=[1, 2]).assign(base_inductance=("state", [4e-6, 5e-6])))
    np.testing.assert_allclose(found.base_inductance, [[2e-6, 3e-6], [4e-6, 5e-6]])
    assert "base_inductance" not in compared(first, world())


@pytest.mark.parametrize(("change", "words"), [
    (lambda m, s: (m.drop_vars("delta"), s), "a measured response must have delta"),
    (lambda m, s: (m.assign(delta=m.delta / 0.0), s), "delta of a measured response must be finite"),
    (lambda m, s: (m.assign_coords(state=["a", "a", "b"]), s), "different names; got a, a, b"),
    (lambda m, s: (m.isel(x=slice(None, None, -1)), s), "x of a measured response must rise"),
    (lambda m, s: (m.isel(x=slice(0, 0)), s), "at least one value"),
    (lambda m, s: (m, s.drop_vars("state")), "state is missing"),
    (lambda m, s: (m.assign(delta_std=m.delta * 0 - 1), s), "delta_std of a measured response must be finite"),
    (lambda m, s: (m.assign(delta_std=("coil", [1.0])), s), "delta_std of a measured response must be over"),
    (lambda m, s: (m, s.drop_vars("delta")), "a simulated response must have delta"),
    (lambda m, s: (m, s.isel(x=slice(3))), "at least 4 positions along x"),
    (lambda m, s: (m, s.assign(delta=s.delta * np.nan)), "delta of a response must be finite"),
    (lambda m, s: (m, s.assign(delta_std=s.delta / 0.0)), "delta_std of a simulated response must be finite"),
    (lambda m, s: (m.assign_coords(x=m.x + 1.0), s), "no measured position is in the simulated map"),
])  # fmt: skip
@pytest.mark.filterwarnings("ignore:divide by zero", "ignore:invalid value")
def test_bad_responses(change, words):
    with pytest.raises(LocalizeError, match=words):
        compared(*change(world(), world()))


@pytest.mark.parametrize("value", [-1e-3, np.nan])
def test_bad_largest_shift(value):
    with pytest.raises(LocalizeError, match="largest_shift must be finite and not negative"):
        compared(NARROW, NARROW, largest_shift=value)
