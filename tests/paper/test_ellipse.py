"""The ellipse model: level curves, their ellipses, polynomials, and the position where two ellipses meet.

Who checks whom: fitted ellipses against the exact ones of a hill with elliptic level curves, with measured convergence
in the level's width and in the refinement; the axis-aligned conic against Gal's with all its terms; intersections
against closed forms and points on both ellipses; the whole on the simulated board against the indenter's positions.
"""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from hypothesis import assume, given
from hypothesis import strategies as st
from support.contacts import IDEAL
from support.ellipses import readings_at, x_errors

from coilarray import load_design, response_map
from coilarray.errors import LocalizeError
from coilarray.paper.ellipse import Ellipse, closes, fit_ellipse, fit_ellipses, refined_map, standard_errors
from coilarray.paper.ellipse_model import (
    CENTRE_SHARE,
    CoilEllipses,
    EllipseModel,
    crossing,
    ellipse_model,
    intersect,
    locate_x,
    published_model,
)
from coilarray.response.dataset import in_ellipse_window

pytestmark = pytest.mark.slow

COILS = ["coil1", "coil2", "coil3"]
WINDOW_X = np.arange(-26e-3, 26.1e-3, 2e-3)
WINDOW_Y = np.arange(-6e-3, 6.1e-3, 2e-3)
WIDE_X, WIDE_Y = np.arange(-14e-3, 16.1e-3, 1e-3), np.arange(-12e-3, 12.1e-3, 1e-3)
PEAK, CENTRE, SLOPE, A, B = 1e-3, 1e-3, 1.0, 6e-3, 5e-3  # of the hill: x0 = CENTRE + SLOPE δ in m


def hill(x, y):
    """δ with exactly elliptic level curves, A √ln(PEAK/δ) by B √ln(PEAK/δ), whose centre moves with δ."""
    X, Y = np.meshgrid(x, y)
    low, high = np.full(X.shape, 1e-30), np.full(X.shape, PEAK)
    for _ in range(80):  # bisection
        middle = (low + high) / 2
        outside = ((X - CENTRE - SLOPE * middle) / A) ** 2 + (Y / B) ** 2 > np.log(PEAK / middle)
        low, high = np.where(outside, low, middle), np.where(outside, middle, high)
    return (low + high) / 2


HILL = hill(WINDOW_X, WINDOW_Y)


def response(delta, x=WINDOW_X, y=WINDOW_Y, states=("coil1",)):
    delta = np.asarray(delta)
    if delta.ndim == 2:
        delta = delta[:, :, None]
    coords = {"depth": [1e-3], "y": y, "x": x, "state": list(states)}
    return xr.Dataset({"delta": (("depth", "y", "x", "state"), delta[None])}, coords)


def hill_errors(fits):
    """Root mean squares over the levels up to 0.8 of the peak of the errors of x0, A and B in m."""
    fit = fits.isel(state=0)
    fit = fit.isel(step=np.flatnonzero((fit.refused.values == "") & (fit.delta.values < 0.8 * PEAK)))
    delta = fit.delta.values
    size = np.sqrt(np.log(PEAK / delta))
    misses = (fit.x0.values - CENTRE - SLOPE * delta, fit.A.values - A * size, fit.B.values - B * size)
    return np.array([np.sqrt(np.mean(miss**2)) for miss in misses])


def noisy(dataset, seed, sigma=1e-5):
    noise = np.random.default_rng(seed).standard_normal(dataset.delta.shape)
    return dataset.assign(delta=dataset.delta + sigma * noise)


def determined(fits):
    """Levels whose points determine their ellipse; NaN for the others."""
    return fits.where((fits.refused == "") & ~fits.undetermined)


def sized(ellipse):
    return [ellipse.x0, ellipse.A, ellipse.B]


@pytest.fixture(scope="module")
def wide():
    return response(hill(WIDE_X, WIDE_Y), WIDE_X, WIDE_Y)


@pytest.fixture(scope="module")
def board():
    """The simulated sensor response matrix of the paper's board, in the paper's window, neighbours grounded."""
    return in_ellipse_window(response_map(load_design("gast2020"), imperfections=IDEAL))


@pytest.fixture(scope="module")
def off_grid():
    """The same board at 240 places that are not on the grid, between the centres of coils 1 and 3."""
    random = np.random.default_rng(20)
    x, y = (np.sort(random.uniform(-reach, reach, n)) for reach, n in ((13.28e-3, 20), (6e-3, 12)))
    return response_map(load_design("gast2020"), x=x, y=y, imperfections=IDEAL)


@given(
    st.floats(-0.02, 0.02), st.tuples(*[st.floats(1e-3, 0.02)] * 2), st.floats(-3.0, 3.0), st.floats(2.0, 6.0)
)  # fmt: skip
def test_points_on_an_ellipse_give_it_back(x0, semi, start, span):
    angle = start + span * np.linspace(0, 1, 40)
    fitted = fit_ellipse(x0 + semi[0] * np.cos(angle), semi[1] * np.sin(angle))
    # 1e-8: rounding of 1e-16, times the condition of an arc of 2 rad, below 1e7
    assert sized(fitted) == pytest.approx([x0, *semi], rel=1e-8, abs=1e-8 * max(semi))


@given(shift=st.floats(-0.1, 0.1), scale=st.floats(1e-3, 1e3))
def test_fit_follows_shift_and_scale(shift, scale):
    random = np.random.default_rng(1)
    angle, ring = random.uniform(0, 4, 60), random.uniform(0.9, 1.1, 60)
    x, y = 5e-3 * ring * np.cos(angle), 4e-3 * ring * np.sin(angle)
    one, other = fit_ellipse(x, y), fit_ellipse(shift + scale * x, -scale * y)
    # 1e-9: rounding of x + shift, at most 1e-16 · 0.1/5e-6
    assert (other.x0 - shift) / scale == pytest.approx(one.x0, abs=1e-9 * max(1, 0.1 / scale))
    assert [other.A / scale, other.B / scale] == pytest.approx([one.A, one.B], rel=1e-9 * max(1, 1 / scale))


def gal(x, y):
    """O. Gal's conic with all five terms, its centre and semi-axes along x and y."""
    mean_x, mean_y = x.mean(), y.mean()
    u, v = x - mean_x, y - mean_y
    a, _, c, d, e = np.linalg.lstsq(np.stack([u**2, u * v, v**2, u, v], axis=1), np.ones_like(u), rcond=None)[0]
    F = 1 + d**2 / (4 * a) + e**2 / (4 * c)
    return mean_x - d / (2 * a), np.sqrt(F / a), np.sqrt(F / c)


def test_fit_is_gals_where_points_are_symmetric():
    """Points that mirror at y = 0 leave no xy and no y term: the two conics are one, on an ellipse or not."""
    random = np.random.default_rng(2)
    angle, ring = random.uniform(0, 2.5, 50), random.uniform(0.8, 1.2, 50)
    x, y = 1e-3 + 5e-3 * ring * np.cos(angle), 4e-3 * ring * np.sin(angle)
    x, y = np.concatenate((x, x)), np.concatenate((y, -y))
    # 1e-10: rounding of the normal equations' solution
    assert sized(fit_ellipse(x, y)) == pytest.approx(gal(x, y), rel=1e-10)


def test_distance_is_along_the_ray():
    ellipse = Ellipse(1e-3, 5e-3, 4e-3)
    assert ellipse.distance([7e-3, 1e-3, 1e-3], [0.0, 3e-3, 0.0]) == pytest.approx([1e-3, -1e-3, -5e-3], rel=1e-12)


def test_refined_map_is_exact_for_cubics_and_at_the_samples():
    x, y = np.array([0.0, 1.0, 2.5, 3.0, 4.0]) * 1e-3, np.arange(6) * 1e-3

    def cubic(x, y):
        return 1e5 * np.add.outer(y**3, -(x**3)) + 30 * np.multiply.outer(y, x**2)

    refined = refined_map(xr.DataArray(cubic(x, y), {"y": y, "x": x}, ("y", "x")), 4)
    # 1e-12: rounding of numbers of 1e-5
    assert refined.values == pytest.approx(cubic(refined.x.values, refined.y.values), abs=1e-12 * 1e-2)
    assert refined.values[::4, ::4] == pytest.approx(cubic(x, y), abs=1e-12 * 1e-2)


def test_refined_map_converges_with_the_grid():
    """A cubic spline without free ends errs with the fourth power of the spacing."""
    errors = []
    for n in (13, 25, 49):
        axis = np.linspace(0, 12e-3, n)
        wave = np.sin(np.add.outer(axis / 4e-3, axis / 3e-3))
        refined = refined_map(xr.DataArray(wave, {"y": axis, "x": axis}, ("y", "x")), 5)
        exact = np.sin(np.add.outer(refined.y.values / 4e-3, refined.x.values / 3e-3))
        errors.append(np.abs(refined.values - exact).max())
    assert (np.log2(np.divide(errors[:2], errors[1:])) > 3.5).all()


def test_errors_fall_with_the_width_of_a_level_and_the_refinement(wide):
    def found(width, parts):
        return hill_errors(fit_ellipses(wide, refinement=parts, threshold=width))

    errors = np.array([found(width, 40) for width in (2e-5, 1e-5, 5e-6)])
    # with levels of ±2e-5 A and B err by 0.05 mm, by the width of the level alone
    assert errors[0] == pytest.approx([1e-6, 51e-6, 43e-6], rel=0.1)
    # ±5e-6: below 3 µm of 5 mm, and x0, which moves by 0.8 mm, to below 1 µm
    assert (errors[2] < [1e-6, 3e-6, 3e-6]).all()
    # the squared misfit enters: order 2; a little more where a level of δ = 3e-5 is as wide as high
    assert np.log2(errors[:-1, 1:] / errors[1:, 1:]) == pytest.approx(np.full((2, 2), 2.3), abs=0.5)
    # narrow levels need a fine map: their points fill the level evenly only then
    coarse, default, fine = found(5e-6, 5), found(5e-6, 20), errors[2]
    assert coarse[0] > 5 * default[0] > 10 * fine[0]  # x0: measured 6.4, 0.7 and 0.25 µm, first order and better
    assert (fine[1:] < coarse[1:] / 2).all()  # A and B: down to the level's width


def test_hill_in_a_window_that_cuts_it():
    # the levels' width as above, and more where an arc is left: measured 0.003, 0.079 and 0.089 mm
    assert (hill_errors(fit_ellipses(response(HILL))) < [5e-6, 0.1e-3, 0.1e-3]).all()


def test_every_step_says_what_it_is(wide):
    two = xr.concat([wide, (wide / 2).assign_coords(state=["coil2"])], "state")
    fits = fit_ellipses(two, states=["coil1", "coil2"], step=1.3e-4)
    assert fits.level.values == pytest.approx(1.3e-4 * np.arange(1, 8), rel=1e-12)
    assert fits.refused.sel(state="coil1").values.tolist() == [""] * 7
    assert fits.refused.sel(state="coil2").values.tolist() == [""] * 3 + ["above the largest δ"] * 4
    kept = fits.refused == ""
    assert all((np.isfinite(fits[name]) == kept).all() for name in ("delta", "x0", "A", "B", "rms"))
    assert all(fits[name].attrs["units"] for name in ("delta", "x0", "A", "B", "rms"))
    assert (np.abs(fits.delta - fits.level).where(kept, 0) < fits.attrs["threshold"]).all()
    assert fits.peak.values == pytest.approx([PEAK, PEAK / 2], rel=1e-3)
    delta = fits.delta.sel(state="coil2").values[:3]
    # half the hill has the same ellipses at half the δ; 0.1 mm: the level's width
    assert fits.A.sel(state="coil2").values[:3] == pytest.approx(A * np.sqrt(np.log(PEAK / 2 / delta)), abs=0.1e-3)


def test_steps_without_an_ellipse_are_refused(wide):
    assert "too few points" in fit_ellipses(wide, refinement=1, threshold=1e-6).refused.values
    X, Y = np.meshgrid(WINDOW_X, WINDOW_Y)
    waist = 1 + (Y / 20e-3) ** 2 - 0.1 * (Y / 6e-3) ** 6  # narrowest at y = 0: the levels are hyperbolas rather
    ridge = PEAK * np.exp(-((X / 8e-3) ** 2)) * waist
    reasons = fit_ellipses(response(np.stack([ridge, HILL], axis=-1), states=COILS[:2])).refused
    assert (reasons.sel(state="coil1")[10:25] == "no ellipse").all()
    assert (reasons.sel(state="coil2") == "").sum() > 30


@pytest.mark.parametrize("spread", [(-np.pi, np.pi), (-1.0, 1.0)])
def test_standard_errors_are_the_scatter_of_fits(spread):
    """A whole ellipse and an arc of it, 40 points with independent errors along the ray."""
    random, angle = np.random.default_rng(3), np.linspace(*spread, 40)
    true, fits, errors = Ellipse(-3e-3, 9e-3, 6e-3), [], []
    for _ in range(400):
        away = 1 + 3e-3 * random.standard_normal(len(angle))
        x, y = true.x0 + away * true.A * np.cos(angle), away * true.B * np.sin(angle)
        fits.append(fit_ellipse(x, y))
        errors.append(standard_errors(fits[-1], x, y, len(x)))
    scatter = np.std([[one.x0, one.A, one.B] for one in fits], axis=0, ddof=1)
    # 400 fits tell their scatter to 3.5 %
    assert np.sqrt(np.mean(np.square(errors), axis=0)) == pytest.approx(scatter, rel=0.12)
    # four points that stand for one have twice the errors of as many independent ones, but for the freedom
    x, y = true.x0 + 1.01 * true.A * np.cos(angle), true.B * np.sin(angle)
    alike = [standard_errors(fit_ellipse(x, y), x, y, count) for count in (400, 100)]
    assert np.divide(alike[1], alike[0]) == pytest.approx(2 * np.sqrt(397 / 400 * 100 / 97), rel=1e-6)


def test_points_of_one_arc_do_not_determine_an_ellipse():
    assert closes(np.array([-1.5, 0.0, 1.5]), 0.0, 3.0)
    assert not closes(np.array([-1.4, 0.0, 3.0]), 0.0, 3.0)
    assert not closes(np.array([]), 0.0, 3.0)


def test_a_depth_is_chosen_in_metres():
    deep = xr.concat([MAP, (2 * MAP).assign_coords(depth=[1.5e-3])], "depth")
    assert float(fit_ellipses(deep, 1.5e-3).peak[0]) == pytest.approx(2 * PEAK, rel=1e-3)
    xr.testing.assert_identical(fit_ellipses(deep), fit_ellipses(MAP))


def test_states_with_a_peak_in_the_map_are_taken():
    three = response(np.stack([HILL, hill(WINDOW_X - 26e-3, WINDOW_Y), HILL / 20], axis=-1), states=COILS)
    assert fit_ellipses(three).state.values.tolist() == ["coil1"]


def test_far_points_of_a_noisy_map_are_left_out():
    """Only the points of the hill count."""
    quiet = response(HILL)
    spot = quiet.copy(deep=True)
    spot.delta[0, 3, -2] += 6e-5  # 23 mm away from the hill
    found, reference = (fit_ellipses(one).isel(state=0) for one in (spot, quiet))
    # the spline spreads the spot a little; the hill's foot moves by micrometres, with the spot x0 would by millimetres
    assert float(np.abs(found.x0 - reference.x0).max()) < 10e-6


def test_refinement_of_the_board(board):
    """Study of the default: 20 parts are within 0.03 mm of 80 in x0 and A, 5 are not."""
    fine = determined(fit_ellipses(board, states=COILS, refinement=80))

    def largest(parts, *names):
        fits = determined(fit_ellipses(board, states=COILS, refinement=parts))
        return max(float(np.abs(fits[name] - fine[name]).max()) for name in names)

    # measured 0.075 and 0.022 mm
    assert largest(5, "x0", "A") > 0.05e-3
    assert largest(20, "x0", "A") < 0.03e-3
    # B of 13 mm is that of an arc within ±6 mm; measured 0.69 and 0.13 mm
    assert largest(20, "B") < 0.15e-3 < largest(5, "B")


MAP = response(HILL)
GAP = MAP.where((MAP.y != WINDOW_Y[2]) | (MAP.x != WINDOW_X[3]))
SPIKE = MAP.assign(delta=MAP.delta.where((MAP.y != WINDOW_Y[2]) | (MAP.x != WINDOW_X[3]), -99.0))
"""Its largest sample is that of `MAP`, and that of its spline is far above."""


@pytest.mark.parametrize(("dataset", "settings", "text"), [
    (MAP.drop_vars("delta"), {}, "must have delta over .*; delta is missing"),
    (MAP.isel(depth=0), {}, "must have delta over .*; delta is over"),
    (MAP, {"depth": 1}, "has the depths 1 mm; got 1000 mm"),
    (MAP, {"depth": 2e-3}, "has the depths 1 mm; got 2 mm"),
    (MAP, {"states": ["coil9"]}, "no state 'coil9'"),
    (MAP, {"states": []}, "one state or more"),
    (MAP, {"states": ["coil1", "coil1"]}, "each once"),
    (MAP, {"refinement": 0}, "refinement must be a positive integer; got 0"),
    (MAP, {"refinement": 2.5}, "refinement must be a positive integer"),
    (MAP, {"threshold": 0.0}, "threshold must be positive"),
    (MAP, {"step": -1e-5}, "step must be positive"),
    (GAP, {"states": ["coil1"]}, r"δ at \(-20, -2\) mm is not"),
    (MAP.isel(y=slice(3, None)), {"states": ["coil1"]}, "edge of the map"),
    (MAP.isel(y=slice(2, 5)), {}, "at least 4 positions along y; got 3"),
    (MAP.isel(x=slice(12, 15)), {}, "at least 4 positions along x; got 3"),
    (MAP.assign_coords(y=WINDOW_Y[::-1]), {}, "y of a response must rise"),
    (0 * MAP, {}, "no closed curves"),
    (MAP - 2e-3, {}, "no closed curves"),
    (MAP, {"states": ["coil1"], "step": 2e-3}, "no level of coil1 is an ellipse"),
    (1e3 * MAP, {}, "a largest δ of 1 in steps of 3e-05 makes 3.33e.04 levels on .* at most 3000"),
    (MAP, {"refinement": 200, "step": 1e-6}, "levels on 6.* refined points; at most 160 "),
    (SPIKE, {}, "a largest δ of 43.* levels on .* at most"),
    (MAP.assign_coords(coil=["coil1"], coil_y=("coil", [12e-3])), {}, "for coils in one row, .* coil1 is at y = 12 mm"),
])  # fmt: skip
def test_bad_maps_and_settings_are_named(dataset, settings, text):
    with pytest.raises(LocalizeError, match=text):
        fit_ellipses(dataset, **settings)


def straight(name, x0, A, B, highest=1e-3, centre=1e-3):
    """A coil with A and B that fall linearly to a fifth over the range of δ, from 0."""
    A, B = ((0.0, 0.0, 0.0, size * -0.8 / highest, size) for size in (A, B))
    return CoilEllipses(name, (0.0, 0.0, 0.0, 0.0, x0), A, B, 0.0, highest, centre)


ROW = EllipseModel(tuple(straight(name, 13e-3 * k, 12e-3, 10e-3) for k, name in enumerate(COILS, start=-1)))


def test_polynomials_give_quartics_back(wide):
    fits = fit_ellipses(wide)
    delta = fits.delta.values
    p = {"x0": (1e9, -2e6, 3e3, 2.0, 1e-3), "A": (-7e9, 4e6, 2e4, -32.0, 20e-3), "B": (-3e10, 7e7, -6e4, 8.0, 13e-3)}
    (coil,) = ellipse_model(fits.assign({name: (fits.x0.dims, np.polyval(c, delta)) for name, c in p.items()})).coils
    at = np.linspace(1e-4, 1e-3, 7)
    for value, c in zip(coil.curves(at), p.values(), strict=True):
        # 1e-12 m: rounding, times the condition of a fit in δ over its peak
        assert value == pytest.approx(np.polyval(c, at), abs=1e-12)
    assert coil.lowest == pytest.approx(float(delta.min()) - 2e-5, rel=1e-12)
    assert coil.highest == pytest.approx(float(fits.peak[0]) + 2e-5, rel=1e-12)
    assert coil.centre == pytest.approx(CENTRE_SHARE * float(fits.peak[0]), rel=1e-12)


def test_too_few_levels_for_a_polynomial(wide):
    with pytest.raises(LocalizeError, match="coil1 has 4 levels with an ellipse; a polynomial of degree 4 needs 5"):
        ellipse_model(fit_ellipses(wide, states=["coil1"], step=2.4e-4))


def test_semiaxis_addition_is_on_one_axis_alone():
    for before, after in zip(ROW.coils, ROW.with_semiaxis_addition().coils, strict=True):
        x0, A, B = (now - then for now, then in zip(after.curves(4e-4), before.curves(4e-4), strict=True))
        assert (float(x0), float(B)) == (0.0, 0.0)
        assert A == pytest.approx(0.2e-3, rel=1e-12)
    assert ROW.with_semiaxis_addition(0.0) == ROW


def test_ellipses_of_one_shape_have_a_linear_equation():
    # 3-4-5
    assert crossing(Ellipse(-3.0, 5.0, 5.0), Ellipse(3.0, 5.0, 5.0)) == pytest.approx((0.0, 4.0), rel=1e-12, abs=1e-12)
    # circles after y → 2y: x = (R1² − R2² + d²)/2d from the first centre
    x, y = crossing(Ellipse(0.0, 5.0, 2.5), Ellipse(8.0, 4.0, 2.0))
    assert (x, y) == pytest.approx(((25 - 16 + 64) / 16, np.sqrt(25 - (73 / 16) ** 2) / 2), rel=1e-12)


@given(
    st.tuples(st.floats(-2, -0.5), st.floats(0.5, 2)), st.tuples(st.floats(-0.4, 0.4), st.floats(0.1, 3)),
    st.tuples(*[st.floats(0.7, 1.4)] * 2),
)  # fmt: skip
def test_a_point_on_both_ellipses_is_found(x0, at, shape):
    x, y = at
    # B/A = shape, and A so that the point is on the ellipse
    pair = [Ellipse(c, (size := np.hypot(x - c, y / q)), q * size) for c, q in zip(x0, shape, strict=True)]
    k = [(e.B / e.A) ** 2 for e in pair]
    if k[0] != k[1]:  # the other root, by the sum of both
        other = 2 * (k[0] * x0[0] - k[1] * x0[1]) / (k[0] - k[1]) - x
        assume(not (x0[0] < other < x0[1] and all(abs(other - e.x0) < e.A for e in pair)))
    found = crossing(*pair)
    assert found == pytest.approx(at, rel=1e-6, abs=1e-6)  # 1e-6: |y| is the root of a small difference
    assert crossing(*pair[::-1]) == pytest.approx(found, rel=1e-9, abs=1e-9)
    mirrored = crossing(*(Ellipse(-e.x0, e.A, e.B) for e in pair))
    assert mirrored == pytest.approx((-found[0], found[1]), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    "pair", [(Ellipse(-3.0, 4.0, 2.0), Ellipse(3.0, 2.0, 7.0)), (Ellipse(0.0, 5.0, 5.0), Ellipse(1.0, 4.0, 2.0))]
)
def test_touching_ellipses_meet_on_the_axis(pair):
    # from outside at x = 1, from inside at x = 5
    assert crossing(*pair) == (pytest.approx(pair[0].x0 + pair[0].A, rel=1e-9), 0)


def test_intersection_names_case_and_coils():
    x, y = -6e-3, 3e-3
    place = intersect(ROW, {coil.name: readings_at(coil, x, y)[0] for coil in ROW.coils[:2]}, "coil1", "coil2")
    assert (place.case, place.coils) == ("two points", ("coil1", "coil2"))
    assert (place.x, place.y) == pytest.approx((x, y), abs=1e-9)
    place = intersect(ROW, {coil.name: readings_at(coil, x, 0.0)[0] for coil in ROW.coils[:2]}, "coil1", "coil2")
    assert (place.case, place.x) == ("touching", pytest.approx(x, abs=1e-9))


MIDDLE = straight("coil2", 0.0, 12e-3, 10e-3, highest=1.4e-3, centre=0.5e-3)
NEAR = EllipseModel((straight("coil1", -13e-3, 20e-3, 14e-3), MIDDLE, straight("coil3", 13e-3, 20e-3, 14e-3)))


def readings_of(model, x, y):
    return {coil.name: found[0] if (found := readings_at(coil, x, y)) else 1e-6 for coil in model.coils}


def placed(model, readings, coils, place):
    """Assert that readings are located by some coils at a place."""
    found = locate_x(model, readings)
    assert (found.case, found.coils) == ("two points" if "coil2" in coils else "adjacent coils", coils)
    assert (found.x, found.y) == pytest.approx(place, abs=1e-9)


def test_adjacent_coils_near_a_centre():
    # a reading that is not used but for the case
    placed(NEAR, {**readings_of(NEAR, 0.5e-3, 1e-3), "coil2": 1.3e-3}, ("coil1", "coil3"), (0.5e-3, 1e-3))
    readings = readings_of(NEAR, 3e-3, 2e-3)
    for centre, coils in ((readings["coil2"], ("coil1", "coil3")), (1.001 * readings["coil2"], ("coil2", "coil3"))):
        model = EllipseModel((NEAR.coils[0], replace(NEAR.coils[1], centre=centre), NEAR.coils[2]))
        placed(model, readings, coils, (3e-3, 2e-3))


def test_usual_pair_is_the_largest_and_its_greater_neighbour():
    placed(ROW, {**readings_of(ROW, 7e-3, 2e-3), "coil7": 5.0}, ("coil2", "coil3"), (7e-3, 2e-3))
    readings = {**readings_of(NEAR, 6e-3, 2e-3), "coil1": 0.5e-3}
    assert readings["coil2"] >= NEAR["coil2"].centre
    with pytest.raises(LocalizeError, match="do not meet"):  # so the usual pair is taken
        intersect(NEAR, readings, "coil1", "coil3")
    placed(NEAR, readings, ("coil2", "coil3"), (6e-3, 2e-3))


def crossing_in_mm(*pair):
    return crossing(*(Ellipse(*(1e-3 * value for value in given)) for given in pair))


GOOD = {"coil1": 3e-4, "coil2": 4e-4, "coil3": 1e-4}
COIL = ROW.coils[0]


@pytest.mark.parametrize(("call", "text"), [
    (lambda: EllipseModel(()), "at least one coil"),
    (lambda: EllipseModel((COIL, COIL)), "each coil a different name"),
    (lambda: ROW["coil9"], "the model has no coil 'coil9'"),
    (lambda: locate_x(EllipseModel((COIL,)), GOOD), "two coils are needed"),
    (lambda: intersect(ROW, GOOD, "coil1", "coil1"), "got coil1 twice"),
    (lambda: replace(COIL, x0=(0.0, 0.0, np.nan, 0.0, 0.0)), "5 finite coefficients"),
    (lambda: replace(COIL, x0=(0.0, 0.0, 0.0, 0.0)), "5 finite coefficients"),
    (lambda: replace(COIL, lowest=1e-3), "must rise"),
    (lambda: replace(COIL, centre=np.nan), "centre of coil1 must be positive"),
    (lambda: replace(COIL, A=(0.0, 0.0, 0.0, 0.0, -1e-3)).ellipse(5e-4), "has no ellipse at δ"),
    (lambda: Ellipse(0.0, 1.0, -1.0), "positive semi-axes"),
    (lambda: fit_ellipse([0, 1], [0, 1]), "at least three finite points"),
    (lambda: fit_ellipse([0, 1, np.nan], [0, 1, 2]), "at least three finite points"),
    (lambda: fit_ellipse([0, 1, 2], [0, 1]), "the same shape"),
    (lambda: fit_ellipse([1, 1, 1], [2, 2, 2]), "not all the same"),
    (lambda: fit_ellipse([0, 1, 2, 3], [0, 0, 0, 0]), "more than one conic"),
    # a parabola and a hyperbola
    (lambda: fit_ellipse([0.0, 1, 4, 9, 1, 4, 9], [0.0, 1, 2, 3, -1, -2, -3]), "not an ellipse"),
    (lambda: fit_ellipse([1.0, 1.25, 5 / 3, 1.25, 5 / 3], [0.0, 0.75, 4 / 3, -0.75, -4 / 3]), "not an ellipse"),
    (lambda: crossing_in_mm((-3, 2, 2), (3, 3, 2)), "do not meet: 1 mm lie between them"),
    (lambda: crossing_in_mm((0, 5, 5), (1, 2, 2)), "one lies within the other"),
    (lambda: crossing_in_mm((0, 5, 5), (0, 5, 5)), "one lies within the other"),
    (lambda: crossing_in_mm((-0.1, 5, 2), (0.1, 2, 5)), "more than one x"),
    (lambda: locate_x(ROW, {"coil1": 3e-4, "coil2": 4e-4}), "the reading of coil3 is missing"),
    (lambda: locate_x(ROW, {**GOOD, "coil3": np.nan}), "the reading of coil3 must be finite; got nan"),
    (lambda: locate_x(ROW, {**GOOD, "coil1": np.inf}), "the reading of coil1 must be finite"),
    (lambda: locate_x(ROW, {**GOOD, "coil2": 2e-3}), "δ of coil2 must be within the model, 0 to 0.001; got 0.002"),
    (lambda: locate_x(ROW, {**GOOD, "coil1": -1e-5, "coil3": -2e-5}), "δ of coil1 must be within the model"),
    (lambda: locate_x(ROW, {**GOOD, "coil1": 9e-4, "coil2": 9e-4}), "coil1 and coil2 give no position, .* do not meet"),
])  # fmt: skip
def test_bad_points_ellipses_readings_and_models_are_named(call, text):
    with pytest.raises(LocalizeError, match=text):
        call()


def test_ellipses_of_the_simulated_board(board):
    """Against Table A1, to which the board is calibrated by A, B and peaks of these coils, not by x0."""
    fits = fit_ellipses(board)
    assert fits.state.values.tolist() == COILS  # coil 4's centre is just beyond the window
    model = ellipse_model(fits)
    assert ellipse_model(fits.isel(state=[2, 0, 1])) == model  # ordered along the row
    assert model.names == tuple(COILS)
    levels = np.array([3e-4, 5e-4, 8e-4])
    x0, A, B = np.moveaxis([model[k].curves(levels) for k in COILS], 1, 0)
    theirs = np.moveaxis([published_model()[k].curves(levels) for k in COILS], 1, 0)
    # 12 %: what the fit leaves of A of coil 2 and of B of all
    assert A == pytest.approx(theirs[1], rel=0.12)
    assert B == pytest.approx(theirs[2], rel=0.12)
    # grounded neighbours move coil 1 outwards by 0.15 to 0.3 mm, coils between two neighbours by less than 0.1 mm
    assert (x0[0] < -13.28e-3 - 0.1e-3).all()
    assert (x0[0] > -13.28e-3 - 0.35e-3).all()
    assert x0[1:] == pytest.approx(np.array([[0.0] * 3, [13.28e-3] * 3]), abs=0.1e-3)
    # the lowest levels of the outer coils are one arc across the window, whose ellipse is far from the coil
    astray = fits.undetermined.values
    assert astray[[0, 2]][:, 0].all()
    assert not astray[1].any()
    assert model["coil1"].lowest > 1e-4 > model["coil2"].lowest


def test_x_of_the_simulated_board_on_its_grid(board):
    """The paper has 0.8 mm over its window; here two ellipses meet nearly everywhere, and x is right to 0.3 mm."""
    model = ellipse_model(fit_ellipses(board))
    for addition, fewest in ((0.0, 80), (0.2e-3, 91)):  # larger ellipses meet everywhere
        errors, lost = x_errors(model.with_semiaxis_addition(addition), board)
        assert len(errors) + lost == 91
        assert len(errors) >= fewest
        assert np.abs(errors).max() < 0.35e-3  # measured 0.19 and 0.27 mm


def test_x_of_the_simulated_board_with_noise(board, off_grid):
    """Noise of 1e-5 in every δ, of the map and of the readings; places that are not on the grid."""
    model = ellipse_model(fit_ellipses(noisy(board, 0), states=COILS)).with_semiaxis_addition()
    errors, lost = x_errors(model, noisy(off_grid, 100))
    assert len(errors) + lost == 240
    assert len(errors) > 200
    # the paper's figure; measured rms of 0.17 to 0.22 mm, of which one place in two hundred may have four times
    assert np.mean(np.abs(errors) < 0.8e-3) > 0.99
