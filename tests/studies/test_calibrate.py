"""Calibration: the solver, posterior and evidence against closed forms, ellipses with what is left out, and mistakes.

Who checks whom: linear models, whose posterior, evidence and errors are known in closed form; the box of a normal
distribution by SciPy; seeded data for the coverage of errors with the noise given and estimated. Campaigns of the
emulator are in test_calibrate_campaigns.py.
"""

import numpy as np
import pytest
import xarray as xr
from scipy.stats import multivariate_normal, norm
from support.contacts import coarse_maps, first_coils_design

from coilarray import calibrate, load_design
from coilarray.compute.store import open_store
from coilarray.design.model import build_design
from coilarray.errors import GoalError, LocalizeError
from coilarray.geometry import Seat
from coilarray.paper.ellipse_model import published_map, published_model
from coilarray.response.map import Imperfections, response_map
from coilarray.studies.calibrate import calibration
from coilarray.studies.calibrate.calibration import calibrated_imperfections, posterior_draws
from coilarray.studies.calibrate.fit import Problem, bounded_normal, fit, information, together
from coilarray.studies.calibrate.plan import PLANS, DataTable, Plan, load_plan, measurement

PAPER = load_design("gast2020")
MU, STIFF, DEPTH = "elastomer.1.relative_permeability", "elastomer.1.youngs_modulus_kPa", "imperfections.depth_error_mm"
TIME = np.linspace(0, 3, 40)


def check_plan(document):
    return PLANS.check(Plan, document, "plan")


def decay(p):
    return p[0] * np.exp(-p[1] * TIME) + p[2] * TIME


def posed(measured, *, std=0.02, estimated=False, low=(0, 0.1, -1), high=(5, 4, 2), start=(1, 0.5, 0), prior=None):
    n = len(low)
    mean, spread = (np.full(n, np.nan), np.full(n, np.inf)) if prior is None else map(np.array, prior)
    numbers = (measured, np.full(len(measured), std), np.ones(len(measured)))
    freedom = 0.0 if estimated else np.inf
    return Problem(*(np.array(one, dtype=float) for one in (low, high, start)), mean, spread, *numbers, freedom)


def driven(problem, function):
    """Fit one problem with a quick function, which may return a text."""
    driver = together([fit(problem)])
    points = next(driver)
    while True:
        try:
            points = driver.send([function(point) for _, point in points])
        except StopIteration as stop:
            return stop.value[0]


@pytest.mark.slow
@pytest.mark.parametrize("estimated", [False, True])
def test_errors_of_a_nonlinear_fit_cover(estimated):
    true, random, off = np.array([2.0, 1.3, 0.4]), np.random.default_rng(1), []
    for _ in range(200):
        data = decay(true) + 0.02 * random.standard_normal(len(TIME))
        problem = posed(data, std=1.0 if estimated else 0.02, estimated=estimated)
        found = driven(problem, decay)
        assert found.converged
        assert found.evaluations < 25
        off.append((found.point - true) / np.sqrt(np.diag(np.linalg.inv(information(problem, found)))))
    # 200 fits tell the size of their scatter to 5 %; with 37 degrees of freedom Student's is 2.8 % wider
    assert np.std(off, axis=0) == pytest.approx(1.0 + 0.028 * estimated, abs=0.17)
    assert np.abs(np.mean(off, axis=0)).max() < 3.3 / np.sqrt(200)


def test_steps_where_there_is_no_model_are_not_taken():
    def broken(point):
        return "no contact" if point[0] > 2.2 else decay(point)

    found = driven(posed(decay([2.0, 1.3, 0.4])), broken)
    assert found.converged
    assert found.point == pytest.approx([2.0, 1.3, 0.4], abs=1e-3)  # a twentieth of the standard deviations
    nothing = driven(posed(decay([2.0, 1.3, 0.4]), start=(3, 1, 0)), broken)
    assert (nothing.problem, nothing.evaluations) == ("no contact", 1)


def test_bounds_and_priors_are_kept():
    data = decay([2.0, 1.3, 0.4])
    found = driven(posed(data, high=(1.5, 4, 2)), decay)
    assert (found.point[0], found.converged) == (1.5, True)
    # a linear model of one unknown: the mean of prior and data, weighted by their information
    problem = posed(np.array([3.0, 3.4]), std=0.5, low=[-9], high=[9], start=[0], prior=([1.0], [0.25]))
    found = driven(problem, lambda p: np.array([p[0], p[0]]))
    assert found.point[0] == pytest.approx((8 * 3.2 + 16 * 1.0) / 24, abs=0.01)  # a twentieth of the deviation
    assert information(problem, found)[0, 0] == pytest.approx(24, rel=1e-6)


@pytest.mark.parametrize("low", [[-1.0, 0.0], [0.5, -5.0], [4.0, 4.0]])
def test_a_normal_distribution_in_a_box(low):
    mean, covariance, high = np.array([0.0, 3.0]), np.array([[1.0, 0.9], [0.9, 1.0]]), np.array([5.0, 6.0])
    draws, inside = bounded_normal(mean, covariance, np.array(low), high, 2000)
    expected = multivariate_normal.cdf(high, mean, covariance, lower_limit=low)
    # 1e-3: both integrals are by quasi-random numbers
    assert inside == pytest.approx(np.log(expected), abs=5e-3)
    assert ((draws >= low) & (draws <= high)).all()
    # against draws from the whole distribution that happen to lie inside, but far in the tail
    whole = np.random.default_rng(0).multivariate_normal(mean, covariance, 400_000)
    whole = whole[((whole >= low) & (whole <= high)).all(axis=1)]
    if len(whole) > 500:
        assert draws.mean(axis=0) == pytest.approx(whole.mean(axis=0), abs=4 / np.sqrt(min(len(whole), 2000)))


@pytest.fixture
def line(monkeypatch):
    """Instead of a response the straight line whose intercept is μr and whose slope is the depth's error in mm."""

    def evaluate(item):
        mu = item["document"]["elastomer"][1]["relative_permeability"]
        slope = item["imperfections"].get("depth_error_mm", 0.0)
        x = np.array(item["request"]["x"])
        values = mu + slope * x + item["document"]["array"]["pitch_mm"] - 13.28
        return {str(k): value for k, value in enumerate(values.tolist())}

    monkeypatch.setattr(calibration, "evaluate_model", evaluate)


X = np.linspace(-1.0, 2.0, 12)


def straight(intercept, slope, seed=0, std=0.1):
    noise = std * np.random.default_rng(seed).standard_normal(len(X))
    delta = (intercept + slope * X + noise)[None, None, :, None]
    coords = {"depth": [1e-3], "y": [0.0], "x": X, "state": ["coil1"]}
    return xr.Dataset({"delta": (("depth", "y", "x", "state"), delta)}, coords)


def test_evidence_of_linear_models_is_the_closed_form(line):
    """A line with and without a slope: ∫ of the likelihood over a flat and a normal prior, by the normal's own form."""
    data, slope = straight(2.6, 0.15), {"entry": DEPTH, "low": -50.0, "high": 50.0, "prior_mean": 0.1, "prior_std": 0.3}
    choices = [{"name": "level"}, {"name": "sloping", "unknown": [slope]}]
    plan = check_plan({
        "data": {"delta_std": 0.1}, "unknown": [{"entry": MU, "low": 1.0, "high": 9.0}],
        "alternative": [{"name": "form", "choice": choices}],
    })  # fmt: skip
    found = calibrate(PAPER, data, plan).dataset
    measured = data.delta.values.ravel()
    by_hand = {}
    for name, columns, prior, mean in (
        ("level", np.ones((12, 1)), np.diag([1e6]), [5.0]),
        ("sloping", np.column_stack((np.ones(12), X)), np.diag([1e6, 0.09]), [5.0, 0.1]),
    ):
        # the flat prior 1/8 as a normal one so wide that it is flat: its density at the middle is 1/√(2π·1e6)
        spread = 0.01 * np.eye(12) + columns @ prior @ columns.T
        wide = multivariate_normal.logpdf(measured, columns @ mean, spread)
        by_hand[name] = wide - np.log(8.0) - norm.logpdf(0.0, scale=1e3)
    for name, expected in by_hand.items():
        # 1e-3: the intercept is 2.4 from the middle of the wide normal prior, 3e-6 of its ln, and the box
        assert float(found.log_evidence.sel(combination=name)) == pytest.approx(expected, abs=5e-3)
    odds = np.exp(by_hand["sloping"] - by_hand["level"])
    assert float(found.probability.sel(combination="sloping")) == pytest.approx(odds / (1 + odds), abs=2e-3)
    best = found.sel(combination="sloping")
    rows = np.column_stack((np.ones(12), X)) / 0.1
    covariance = np.linalg.inv(rows.T @ rows + np.diag([0, 1 / 0.09]))
    assert best["std"].values == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-5)
    between = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
    assert float(best.correlation[0, 1]) == pytest.approx(between, rel=1e-5)
    assert best.posterior.std("draw").values == pytest.approx(best["std"].values, rel=0.05)  # 1000 draws
    assert int(best.determined) == 2
    band = np.sqrt(np.einsum("ij,jk,ik->i", 0.1 * rows, covariance, 0.1 * rows))
    assert best.model_std.values == pytest.approx(band, rel=1e-5)


def test_what_the_data_cannot_tell_is_said(line):
    """Only the sum of μr and pitch shows: one direction is told, and the other is one against the other."""
    found = calibrate(PAPER, straight(2.7, 0.0), {MU: (2.0, 4.0), "array.pitch_mm": (13.0, 14.0)}).dataset
    assert (int(found.determined[0]), found.attrs["noise_is"]) == (1, "estimated")
    (said,) = str(found.undetermined.values[0]).splitlines()
    assert "array.pitch_mm by +0.258 mm" in said
    assert "elastomer.1.relative_permeability by -0.258" in said
    assert said.endswith(": changes the data by 0 of their noise")
    assert float(found.correlation[0, 0, 1]) < -0.95
    # the bounds alone limit the two: the interval is theirs, not the infinite one of the slopes
    assert (found.low.values[0] >= [2.0, 13.0]).all()
    assert (found.high.values[0] <= [4.0, 14.0]).all()


def test_data_of_another_board_are_refused():
    """gast2020's coils have a pitch of 13.28 mm and the origin in coil2."""
    here = straight(2.6, 0.0).assign_coords(
        coil=["coil2", "coil3"], coil_x=("coil", [0, 12e-3]), coil_y=("coil", [0, 0])
    )
    with pytest.raises(GoalError, match=r"another board.* their coil3 is at \(12, 0\) mm .* design at \(13.28, 0\) mm"):
        measurement(here, DataTable(), PAPER)
    near = here.assign_coords(coil_x=("coil", [0, 13.4e-3]))
    assert len(measurement(near, DataTable(), PAPER).values) == 12


def test_noise_is_that_of_the_data_by_state(line):
    noisy = straight(2.6, 0.0).assign(delta_std=("x", np.full(12, 0.2)))
    given = measurement(noisy.assign_attrs(repeats=4), DataTable(), PAPER)
    assert (given.noise_freedom, given.std[0]) == (np.inf, pytest.approx(0.1))
    noisy.delta_std.attrs["found_from"] = "repeats"
    assert measurement(noisy.assign_attrs(repeats=4), DataTable(), PAPER).noise_freedom == 12 * 3
    noisy.delta_std.attrs["found_from"] = "baselines"
    assert measurement(noisy, DataTable(), PAPER).noise_freedom == pytest.approx(2 * 11**2 / 32)
    gap = straight(2.6, 0.0).where(lambda one: one.x > -0.9)
    assert measurement(gap, DataTable(delta_std=0.3), PAPER).weight.tolist() == [0.0] + 11 * [1.0]
    assert measurement(gap, DataTable(), PAPER).noise_freedom == 0


def test_ellipses_leave_undetermined_levels_and_x0_out():
    found = measurement(published_model(), DataTable(states=["coil1", "coil2"]), PAPER)
    table = xr.Dataset(
        {"weight": ("row", found.weight), "value": ("row", found.values)},
        {key: ("row", list(values)) for key, values in found.coords.items()},
    )
    x0 = table.where(table.quantity == "x0", drop=True)
    assert not x0.weight.any()
    A = table.where((table.quantity == "A") & (table.state == "coil1"), drop=True)
    # a polynomial of five coefficients is five numbers; two of ten levels are not in the window
    assert A.weight.values.tolist() == [0.0, 0.0] + 8 * [0.5]
    assert np.isnan(A.value.values).tolist() == [True, True] + 8 * [False]
    peaks = table.where(table.quantity == "peak", drop=True)
    # that of coil 2 would be far beyond the levels of which the polynomial is known
    assert peaks.weight.values.tolist() == [1.0, 0.0]
    assert found.noise_freedom == 0


def test_tested_states_are_only_predicted():
    found = measurement(published_model(), DataTable(states=["coil1", "coil2"], tested=["coil2"]), PAPER)
    state = np.array(found.coords["state"])
    assert found.weight[state == "coil1"].sum() == 9  # four numbers of A and of B, and the peak
    assert not found.weight[state == "coil2"].any()
    assert np.isfinite(found.values[state == "coil2"]).any()
    with pytest.raises(GoalError, match="tested names the state 'coil3'; there are coil1, coil2"):
        measurement(published_model(), DataTable(states=["coil1", "coil2"], tested=["coil3"]), PAPER)
    with pytest.raises(GoalError, match="nothing to fit"):
        measurement(published_model(), DataTable(tested=list(published_model().names)), PAPER)


def test_draws_are_designs_of_the_posterior(line):
    plan = check_plan({"unknown": [
        {"entry": [MU, STIFF], "low": 2.0, "high": 4.0}, {"entry": DEPTH, "low": -50.0, "high": 50.0},
    ]})  # fmt: skip
    found = calibrate(PAPER, straight(2.6, 0.15), plan)
    drawn = posterior_draws(PAPER, found.dataset, 40)
    sheets = [design.sheets[1] for design, _ in drawn]
    for sheet in sheets:  # the two entries share one value
        assert sheet.youngs_modulus == pytest.approx(1e3 * sheet.relative_permeability, rel=1e-12)
    best = found.dataset.isel(combination=0)
    # 40 draws: their mean to 0.5 of a standard deviation, three times its error
    for values, unit, k in (
        ([sheet.relative_permeability for sheet in sheets], 1.0, 0),
        ([errors.depth_error for _, errors in drawn], 1e-3, 1),
    ):
        assert np.mean(values) == pytest.approx(unit * best["value"].values[k], abs=0.5 * unit * best["std"].values[k])
    assert calibrated_imperfections(found.dataset) == found.imperfections
    with pytest.raises(GoalError, match="from 1 to 1000; got 1001"):
        posterior_draws(PAPER, found.dataset, 1001)
    with pytest.raises(GoalError, match="must have value, posterior and entries"):
        calibrated_imperfections(straight(2.6, 0.15))


def test_evaluations_are_kept(line, tmp_path):
    asked = []
    data, store = straight(2.6, 0.0), open_store(tmp_path)

    def counted(done, total):
        asked.append((done, total))

    first = calibrate(PAPER, data, {MU: (2.0, 4.0)}, keep=str(tmp_path), progress=counted)
    kept = store.keys()
    assert len(kept) == len(asked) == int(first.dataset.evaluations[0])
    again = calibrate(PAPER, data, {MU: (2.0, 4.0)}, keep=tmp_path)
    assert store.keys() == kept
    xr.testing.assert_identical(first.dataset, again.dataset)
    assert first.values == again.values
    assert again.design.sheets[1].relative_permeability == pytest.approx(first.values[MU], rel=1e-12)


def test_choices_set_and_take_away(line):
    across = "coils.hexagon.outer_across_"
    corners = {"name": "corners", "set": {f"{across}corners_mm": 23.0}, "without": [f"{across}flats_mm"]}
    wrong = {"name": "wrong", "without": ["coils.hexagon.no_such_key"]}
    plan = check_plan({
        "unknown": [{"entry": MU, "low": 2.0, "high": 4.0}],
        "alternative": [{"name": "size", "choice": [{"name": "flats"}, corners, wrong]}],
    })  # fmt: skip
    found = calibrate(PAPER, straight(2.6, 0.0), plan).dataset
    # an entry that the design lacks, and that only one choice has
    radius = {"name": "finite", "unknown": [{"entry": "indentation.sample_radius_mm", "low": 20.0, "high": 60.0}]}
    sample = check_plan({
        "unknown": [{"entry": MU, "low": 2.0, "high": 4.0}],
        "alternative": [{"name": "sample", "choice": [{"name": "wide"}, radius]}],
    })  # fmt: skip
    cases = [calibration._case_of(calibration.as_file(PAPER), sample, choices) for choices in sample.combinations()]
    own = PAPER.sheets[1].relative_permeability
    assert [case.start.tolist() for case in cases] == [[own], [own, 40.0]]
    assert cases[1].changed(cases[1].start)[0]["indentation"]["sample_radius_mm"] == 40
    assert found["choice_of_size"].values.tolist()[-1] == "wrong"
    assert "no_such_key is not in the design" in str(found.problem.values[-1])
    assert found.probability.values == pytest.approx([0.5, 0.5, 0.0])  # the line knows nothing of coils


@pytest.mark.slow
def test_drift_is_added_in_the_order_of_a_campaign():
    design = first_coils_design(2)
    axes = {"depths": [0.5e-3, 1e-3], "x": [-2e-3, 0.0, 2e-3], "y": [0.0, 2e-3]}

    def mapped(**imperfections):
        return response_map(design, **axes, imperfections=Imperfections(**imperfections, network="ideal")).delta

    with coarse_maps():
        plain, drifting, by_columns = mapped(), mapped(drift=1e-5), mapped(column_drift=1e-5)
    for found, order in ((drifting, ("y", "x", "depth")), (by_columns, ("x", "y", "depth"))):
        added = (found - plain).isel(state=0).transpose(*order).values.ravel()
        assert added == pytest.approx(np.linspace(0, 1e-5, 12), abs=1e-12)  # 1e-12: rounding of δ


@pytest.mark.parametrize(
    ("name", "count", "start"),
    [
        ("table_a1", 8, [0.215, 2.7, 166.0, 0.0]),
        ("table_a1_asymmetry", 7, []),
        ("table_a1_sample", 3, [0.49, 2.7, 166.0, 0.0, 0.067, 5.3]),
    ],
)
def test_the_bundled_plans_fit_the_design(name, count, start):
    plan = load_plan(name)
    assert len(plan.combinations()) == count
    for choices in plan.combinations():
        case = calibration._case_of(calibration.as_file(PAPER), plan, choices)
        assert case.start.tolist()[: len(start)] == start
        built = build_design(case.changed(case.start)[0], name)
        if name == "table_a1":
            sizes, order, base = (choice.name for choice in choices)
            width, height = np.ptp(built.array.placements[0].coil.outline, axis=0)
            assert (height if "corners" in sizes else width) == pytest.approx(23e-3, rel=1e-12)
            assert built.array.placements[1].layers == (("L3", "L4") if "below" in order else ("L1", "L2"))
            assert built.indentation.base == ("bonded" if base == "bonded" else Seat(5e6))


UNKNOWN = {"entry": MU, "low": 1.0, "high": 4.0}
TWICE = {"name": "b", "set": {MU: 2}}


@pytest.mark.parametrize(("document", "text"), [
    ({}, r"at least one \[\[unknown\]\] in every combination"),
    ({"unknown": [{**UNKNOWN, "low": 5.0}]}, "unknown.0 needs low below high; got 5 and 4"),
    ({"unknown": [{**UNKNOWN, "start": 5.0}]}, "needs start from low to high; got 5"),
    ({"unknown": [{**UNKNOWN, "prior_std": 1.0}]}, "both prior_mean and prior_std"),
    ({"unknown": [{**UNKNOWN, "prior_mean": 5.0, "prior_std": 1.0}]}, "needs prior_mean from low to high; got 5"),
    ({"unknown": [{**UNKNOWN, "entry": "imperfections.dirt"}]}, "needs an imperfection of .* got imper"),
    ({"unknown": [UNKNOWN, UNKNOWN]}, "names elastomer.1.relative_permeability in more than one "),
    ({"unknown": [UNKNOWN], "alternative": [{"name": "a", "choice": [TWICE]}]}, "sets .* twice"),
    ({"unknown": [UNKNOWN], "data": {"level": [1e-4]}}, "data has no key 'level'; did you mean levels"),
    ({"unknown": [{**UNKNOWN, "entry": []}]}, "unknown.0.entry must"),
    ({"unknown": [UNKNOWN], "schema": 2}, "schema must"),
    ({"unknown": [UNKNOWN], "alternative": [{"name": "a", "choice": []}]}, "alternative.0.choice must"),
    ({"unknown": [UNKNOWN], "data": {"parameters": ["C"]}}, "data.parameters.0 must"),
])  # fmt: skip
def test_mistakes_of_a_plan(document, text):
    with pytest.raises(GoalError, match=text):
        check_plan(document)


@pytest.mark.parametrize(("data", "unknowns", "text"), [
    (None, {MU: (1.0,)}, "must have low and high, or low, high and start"),
    (None, {"array.pitch_cm": (1.0, 2.0)}, "no combination has a fit: gast2020: array has no key 'pitch_cm'"),
    (None, {"coils.hexagon.turns_per_layer": (20.5, 30.5)}, "turns must be a multiple of"),
    (straight(2.6, 0.0).assign_coords(state=["coil9"]), {MU: (1.0, 4.0)}, "scan of gast2020 has no state 'coil9'"),
    (published_map().drop_vars("delta"), {MU: (1.0, 4.0)}, "response must have delta over"),
    (straight(2.6, 0.0) * np.nan, {MU: (1.0, 4.0)}, "have nothing to fit"),
])  # fmt: skip
def test_mistakes_of_a_calibration(data, unknowns, text):
    with pytest.raises((GoalError, LocalizeError), match=text):
        calibrate(PAPER, data, unknowns)
