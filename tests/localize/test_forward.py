"""The forward model.

Who checks whom: splines against polynomials that they hold exactly and against the formula they interpolate, with the
order of the error; derivatives against differences; tables against the response map's own grid.
"""

from dataclasses import replace

import numpy as np
import pytest
from support.localize_boards import FIELD, bells, board, response

from coilarray import load_design, vary
from coilarray.errors import ElastomerError, LocalizeError
from coilarray.localize.forward import checked_noise, forward_model, table_grid

X, Y, H = np.linspace(-20e-3, 30e-3, 9), np.linspace(-9e-3, 9e-3, 7), np.linspace(0.3e-3, 1.5e-3, 5)


def polynomial(seed, degree_h, states=3):
    """δ = Σ c_ijk x^i y^j h^k in cm and mm, i and j up to 3; without terms in h⁰, so that δ(h = 0) = 0."""
    c = np.random.default_rng(seed).uniform(-1e-3, 1e-3, (4, 4, degree_h, states))

    def function(points):
        x, y, h = np.moveaxis(points * [1e2, 1e2, 1e3], -1, 0)
        powers = [v[..., None] ** np.arange(n) for v, n in ((x, 4), (y, 4), (h, degree_h))]
        return np.einsum("...i,...j,...k,ijks->...s", powers[0], powers[1], powers[2] * h[..., None], c)

    return function


def inside(model, count, seed=0):
    return np.random.default_rng(seed).uniform(model.lower, model.upper, (count, 3))


TABLE, GOOD = board(FIELD, 2e-3), board(FIELD, 4e-3)
MODEL = forward_model(TABLE)


@pytest.mark.parametrize(("depths", "degree_h"), [(H, 3), (H[:3], 3), (H[:2], 2)])
def test_polynomials_are_exact(depths, degree_h):
    """Cubic in x and y; in depth cubic from four planes on, with three planes and δ(0) = 0 a cubic as well."""
    function = polynomial(1, degree_h)
    model = forward_model(response(function, "abc", X, Y, depths))
    assert model.depth[0] == 0
    points = inside(model, 200)
    # rounding: coefficients of 1e-3 times powers up to 3³ · 1.5³
    assert model.delta(points) == pytest.approx(function(points), abs=1e-13)


def test_derivatives_of_polynomials_are_exact():
    function = polynomial(2, 3)
    model = forward_model(response(function, "abc", X, Y, H))
    points = inside(model, 50)
    for axis, step in enumerate((1e-4, 1e-4, 1e-5)):
        # a five-point formula is exact for degree 4
        at = [function(points + k * step * np.eye(3)[axis]) for k in (-2, -1, 1, 2)]
        exact = (at[0] - 8 * at[1] + 8 * at[2] - at[3]) / (12 * step)
        # rounding of δ of 1e-2 at 1e-16, over the step
        assert model.jacobian(points)[..., axis] == pytest.approx(exact, abs=1e-17 / step * 10 + 1e-9)


def test_nodes_are_kept():
    points = np.stack(np.meshgrid(TABLE.depth, TABLE.y, TABLE.x, indexing="ij")[::-1], axis=-1)
    # rounding of δ of 1e-2
    assert MODEL.delta(points) == pytest.approx(TABLE.delta.values, abs=1e-16)
    assert (forward_model(TABLE.transpose("state", "x", "depth", "y")).delta(points) == MODEL.delta(points)).all()


def test_error_falls_with_the_fourth_power_of_the_spacing():
    points = np.random.default_rng(0).uniform([-12e-3, -6e-3, 1e-3], [12e-3, 6e-3, 1e-3], (1000, 3))
    truth = bells(points, FIELD)
    # 1 mm is a plane of the table, so that the depth adds no error
    errors = [np.abs(forward_model(board(FIELD, step)).delta(points) - truth).max() for step in (2e-3, 1e-3, 0.5e-3)]
    assert errors[1] < 1e-3 * 4e-3  # of the peak
    # 16, more where the ends of the table still count on the coarse grids
    assert 14 < errors[1] / errors[2] < 20
    assert errors[0] > 14 * errors[1]


def test_one_depth_is_known():
    model = forward_model(board(FIELD, 2e-3, depth=[1e-3]))
    assert model.unknowns == 2
    assert model.jacobian([0, 0, 1e-3]).shape == (5, 2)
    # δ of the formula at the known depth, whatever is asked; the error of the spline as above
    assert model.delta([1e-3, 2e-3, 7.0]) == pytest.approx(bells([1e-3, 2e-3, 1e-3], FIELD), abs=2e-5)


def test_zero_plane_is_a_choice():
    assert forward_model(TABLE, zero_plane=False).lower[2] == 0.2e-3
    assert MODEL.lower[2] == 0
    assert np.abs(MODEL.delta([1e-3, 2e-3, 0.0])).max() == 0
    assert len(forward_model(board(FIELD, 2e-3, depth=[0.0, 0.5e-3, 1e-3])).depth) == 3


@pytest.mark.parametrize(("call", "message"), [
    (lambda: MODEL.select(["coil9"]), r"no state 'coil9'; there are coil1, coil2"),
    (lambda: MODEL.select([]), r"named once each"),
    (lambda: MODEL.select(["coil1", "coil1"]), r"named once each"),
    (lambda: MODEL.delta([[0, 0, 1e-3], [0, 0.02, 1e-3]]), r"y of a point .* -0\.01 to 0\.01 m; got 0\.02 m"),
    (lambda: MODEL.jacobian([0, 0, 5e-3]), r"depth of a point"),
    (lambda: MODEL.delta([np.nan, 0, 1e-3]), r"x of a point"),
    (lambda: MODEL.delta(1.0), r"last axis; got shape"),
    (lambda: MODEL.delta([1.0, 2.0]), r"last axis; got shape"),
    *[(lambda bad=bad: checked_noise(MODEL.states, bad), r"noise must be positive and finite")
      for bad in (0, -1e-5, np.nan, np.inf, [1e-5] * 4 + [0])],
    (lambda: checked_noise(MODEL.states, [1e-5] * 4), r"one for each of the 5 states; got shape \(4,\)"),
    (lambda: forward_model(GOOD.rename(delta="other")), r"delta over depth, y, x and state, .*; delta is missing"),
    (lambda: forward_model(GOOD.isel(depth=0)), r"delta is over y, x, state"),
    (lambda: forward_model(GOOD.drop_vars("x")), r"with coordinates; x is missing"),
    (lambda: forward_model(GOOD.isel(x=slice(3))), r"at least 4 positions along x; got 3"),
    (lambda: forward_model(GOOD.isel(y=slice(2))), r"at least 4 positions along y; got 2"),
    (lambda: forward_model(GOOD.isel(state=slice(0))), r"must have at least one value"),
    (lambda: forward_model(GOOD.where(GOOD.x > -0.01)), r"must be finite everywhere"),
    (lambda: forward_model(GOOD.isel(x=slice(None, None, -1))), r"x of a response must rise; got 0.015 after 0.019"),
    (lambda: forward_model(GOOD.assign_coords(depth=GOOD.depth - GOOD.depth.values[0] + 5e-324)),
     "depth of a response must begin with 0 or at 1e-09 or more; got 4.94066e-324"),
    (lambda: forward_model(GOOD.assign_coords(depth=GOOD.depth - 1e-3)), r"depth .* at least 0 .*; got -0\.0008"),
    (lambda: forward_model(GOOD.assign_coords(state=list("aabcd"))), r"different names; got a, a, b"),
])  # fmt: skip
def test_bad_arguments_and_tables(call, message):
    with pytest.raises(LocalizeError, match=message):
        call()


def test_table_covers_the_coils():
    """What a table of this grid is worth is in test_localize_inverse.py."""
    design = load_design("gast2020")
    depths, x, y = table_grid(design)
    # a fifth of 8 mm; the coils reach 11.5 mm in x beyond their centres, -13.28 to 53.12 mm, in y 11.5/cos 30°
    assert max(np.diff(x).max(), np.diff(y).max()) <= 1.6e-3 + 1e-12
    half, high = 11.5e-3, 11.5e-3 / np.cos(np.pi / 6)
    # outlines are those of the copper: the same to rounding
    assert [x[0], x[-1]] == pytest.approx([-13.28e-3 - half, 53.12e-3 + half], abs=1e-9)
    assert [y[0], y[-1]] == pytest.approx([-high, high], abs=1e-9)
    assert depths[-1] == pytest.approx(1.7e-3, rel=1e-12)
    depths, x, y = table_grid(design, spacing=3e-3, deepest=1.2e-3)
    assert max(np.diff(x).max(), np.diff(y).max()) <= 3e-3 + 1e-12
    assert depths[-1] == pytest.approx(1.2e-3, rel=1e-12)


def test_table_ends_where_the_contact_would_leave_the_sample():
    sides = {"indentation.sample_x_mm": [-60, 60], "indentation.sample_y_mm": [-11.5, 11.5]}
    design = vary(load_design("gast2020"), sides)
    _, x, y = table_grid(design)
    # of the ball of 2.5 mm 1.7 mm deep, where the table ends; along x the coils end first on the left, the sample right
    rim = np.sqrt(1.7 * (5 - 1.7)) * 1e-3
    assert [y[0], y[-1]] == pytest.approx([rim - 11.5e-3, 11.5e-3 - rim], abs=1e-9)
    assert [x[0], x[-1]] == pytest.approx([-24.78e-3, 60e-3 - rim], abs=1e-9)
    with pytest.raises(LocalizeError, match="the sample of gast2020 leaves no room over the coils"):
        table_grid(vary(design, {"indentation.sample_y_mm": [30, 40]}))


@pytest.mark.parametrize("value", [0.0, -1e-3, np.nan, np.inf])
def test_bad_spacings(value):
    design = load_design("gast_fem")
    for name in ("spacing", "deepest"):
        with pytest.raises(LocalizeError, match=f"{name} of a table must be positive and finite"):
            table_grid(design, **{name: value})
    with pytest.raises(ElastomerError, match=r"gast_fem has no \[indenter\]"):
        table_grid(replace(design, indentation=None))


def test_places_at_the_edge_may_be_rounded():
    """A place counted from another origin is not exactly on the edge; 5 pm beyond it is outside."""
    edge = np.array([MODEL.upper, MODEL.lower])
    away = np.array([[1.0], [-1.0]])
    np.testing.assert_array_equal(MODEL.delta(edge + 0.5e-12 * away), MODEL.delta(edge))
    with pytest.raises(LocalizeError, match="x of a point must be in the table"):
        MODEL.delta(edge + 5e-12 * away)
