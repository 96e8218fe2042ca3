"""Position and depth from one reading.

Who checks whom: solutions against the truth that made the reading, by formula, by the model and by the response map
between the positions of the table; regions and residuals against their probabilities; the search against many random
starts; the goal of accuracy against the Cramér–Rao bound, which says where it can be met.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2, ncx2
from support.contacts import IDEAL, coarse_maps, first_coils, first_coils_design
from support.localize_boards import FIELD, ROW, bells, board

from coilarray.design.model import parse_design
from coilarray.elastomer.scattering import LayerMesh
from coilarray.errors import LocalizeError
from coilarray.localize.forward import forward_model, table_grid, whitening_of
from coilarray.localize.identifiability import covariance_of, fisher_information
from coilarray.localize.inverse import deviance, locate, locate_all, refine
from coilarray.response.map import MapAccuracy, response_map

pytestmark = pytest.mark.slow

NOISE = 1e-5
REGION = chi2.ppf(0.95, 3)
MIRROR = np.array([1, -1, 1])


@pytest.fixture(scope="module")
def field():
    return forward_model(board(FIELD))


def between_the_coils(count, seed=0):
    """Points of the field where several coils answer, 0.5 to 1.5 mm deep."""
    return np.random.default_rng(seed).uniform([-9e-3, -6e-3, 0.5e-3], [9e-3, 6e-3, 1.5e-3], (count, 3))


def noisy(delta, noise=NOISE, seed=0):
    return delta + noise * np.random.default_rng(seed).standard_normal(delta.shape)


def places(modes):
    return np.array([[mode.x, mode.y, mode.depth] for mode in modes])


def best_places(locations):
    return places([location.best for location in locations])


def share(found, verdict):
    return np.mean([location.verdict == verdict for location in found])


def test_truth_comes_back(field):
    truth = between_the_coils(200)
    found = locate_all(field, field.delta(truth))
    assert share(found, "found") == 1
    # a micrometre in the plane; in depth as much of the depth as it is of 10 mm
    assert np.abs(best_places(found) - truth).max(axis=0) == pytest.approx([0, 0, 0], abs=1e-6)
    assert max(location.chi_square for location in found) < 1e-4
    # of the formula, the spline between its nodes included
    fine = forward_model(board(FIELD, 0.5e-3, np.linspace(0.2e-3, 1.8e-3, 33)))
    truth = between_the_coils(50, 1)
    # splines err by 1e-7 here (test_localize_forward.py) where δ changes by 5e-4 a mm
    assert best_places(locate_all(fine, bells(truth, FIELD))) == pytest.approx(truth, abs=1e-6)


def test_known_depth():
    known = forward_model(board(FIELD, depth=[1e-3]))
    truth = between_the_coils(50, 2)
    truth[:, 2] = 1e-3
    found = locate_all(known, known.delta(truth))
    assert best_places(found) == pytest.approx(truth, abs=1e-6)
    assert found[0].best.covariance.shape == (2, 2)
    assert found[0].degrees_of_freedom == 3


def test_both_signs_of_y_are_modes():
    row = forward_model(board(ROW))
    truth = np.random.default_rng(3).uniform([-8e-3, 2e-3, 0.6e-3], [20e-3, 6e-3, 1.4e-3], (50, 3))
    for point, location in zip(truth, locate_all(row, row.delta(truth)), strict=True):
        assert location.ambiguous
        first, second = places(location.modes[:2])
        # the mirrored modes are found each for itself, to the search's tolerance
        assert second == pytest.approx(first * MIRROR, abs=1e-6)
        assert np.abs(first[1]) == pytest.approx(point[1], abs=1e-6)
        assert location.modes[0].chi_square == pytest.approx(location.modes[1].chi_square, abs=1e-4)
    (middle,) = locate(row, row.delta([4e-3, 0.0, 1e-3])).modes
    assert abs(middle.y) < 0.5e-3  # y² is what δ tells: y is found to the square root of the tolerance


@settings(max_examples=10)
@given(st.permutations(range(5)), st.integers(0, 49))
def test_order_of_the_coils_is_of_no_effect(field, order, k):
    reading = noisy(field.delta(between_the_coils(50, 4)))[k]
    names = [field.states[one] for one in order]
    first = locate(field, reading)
    by_name = dict(zip(names, reading[order], strict=True))
    for other in (locate(field.select(names), reading[order]), locate(field, by_name)):
        assert places(other.modes) == pytest.approx(places(first.modes), abs=1e-7)
        assert other.chi_square == pytest.approx(first.chi_square, abs=1e-5)


def test_noise_of_each_coil_counts(field):
    """A coil whose noise is huge is as good as absent."""
    reading = noisy(field.delta([2e-3, 1e-3, 1e-3]))
    reading[3] += 3e-4
    deaf = locate(field, reading, noise=[1e-5, 1e-5, 1e-5, 1.0, 1e-5]).best
    kept = [0, 1, 2, 4]
    without = locate(field.select([field.states[k] for k in kept]), reading[kept])
    assert places([deaf]) == pytest.approx(places([without.best]), abs=1e-8)
    assert without.degrees_of_freedom == 1


def test_ellipsoids_of_gaussian_modes_hold_the_truth(field):
    truth = between_the_coils(1500, 5)
    found = locate_all(field, noisy(field.delta(truth), seed=6))
    modes = [(one.best, place) for one, place in zip(found, truth, strict=True) if one.best.gaussian]
    away = np.array([place - [mode.x, mode.y, mode.depth] for mode, place in modes])
    distances = np.einsum("ni,nij,nj->n", away, np.array([mode.information for mode, _ in modes]), away)
    held = distances <= chi2.ppf(0.95, 3)
    assert len(held) > 0.8 * len(truth)
    assert 0.93 < np.mean(held) < 0.97  # 95 % ± 0.6 % by counting


def test_residuals_have_their_probability(field):
    found = locate_all(field, noisy(field.delta(between_the_coils(2000, 7)), seed=8), alarm=0.05)
    assert {location.degrees_of_freedom for location in found} <= {2, 3}
    assert 0.035 < share(found, "no fit") < 0.065  # 5 % ± 0.5 % by counting, three times that
    assert np.mean(np.array([location.probability for location in found]) < 0.5) == pytest.approx(0.5, abs=0.035)


def test_readings_of_no_position_are_told(field):
    """Power of the residual test: a departure d from all positions is seen as a χ² of non-centrality d²."""
    truth = between_the_coils(1000, 9)
    # the direction in which δ leaves the surface of all positions: the last left singular vector of the Jacobian
    away = np.linalg.svd(field.jacobian(truth))[0][..., -1]
    found = locate_all(field, noisy(field.delta(truth) + 5 * NOISE * away, seed=9))
    # 90 % ± 1 % by counting; the surface is curved by some more
    assert share(found, "no fit") == pytest.approx(ncx2.sf(chi2.isf(1e-3, 2), 2, 25), abs=0.04)
    reasons = [one.reason for one in found if one.verdict == "no fit"]
    assert "no position of the table explains the reading" in reasons[0]
    # the wrong sign
    for location in locate_all(field, -field.delta(between_the_coils(50, 15))):
        assert location.verdict in ("no fit", "outside")
        assert location.probability < 1e-3


def test_nothing_pressed(field):
    found = locate_all(field, noisy(np.zeros((1000, 5)), seed=10), alarm=0.05)
    # 95 % ± 0.7 % by counting, three times that
    assert 0.93 < share(found, "nothing pressed") < 0.97
    quiet = next(location for location in found if location.verdict == "nothing pressed")
    assert (quiet.modes, quiet.degrees_of_freedom) == ((), 5)
    with pytest.raises(LocalizeError, match=r"there is no position: nothing is pressed"):
        _ = quiet.best


def test_presses_outside_the_table_are_told():
    """A table that ends where the coils still answer."""
    table = board(FIELD)
    small = forward_model(table.sel(x=slice(-6.5e-3, 6.5e-3), y=slice(-5.5e-3, 5.5e-3), depth=slice(0, 1.3e-3)))
    random = np.random.default_rng(11)

    def inside(count):
        return random.uniform([-5e-3, -4e-3, 0.6e-3], [5e-3, 4e-3, 1.2e-3], (count, 3))

    for axis, far in ((0, 9e-3), (0, -9e-3), (1, 8e-3), (1, -8e-3), (2, 1.6e-3)):
        truth = inside(50)
        truth[:, axis] = far
        found = locate_all(small, bells(truth, FIELD))
        # where only one coil answers, a press on the border fits as well: then "border"
        assert share(found, "outside") + share(found, "border") == pytest.approx(1)
        assert share(found, "outside") >= 0.9
    found = locate_all(small, noisy(small.delta(inside(300))))
    assert share(found, "outside") + share(found, "no fit") <= 0.01  # 1e-3 of false alarms each


def test_a_press_on_the_border_is_marked(field):
    readings = noisy(field.delta(np.tile([field.upper[0], 4e-3, 1e-3], (100, 1))), seed=12)
    marked = [location for location in locate_all(field, readings) if location.verdict == "border"]
    # on the border or just inside it: the noise decides, half and half with ± 5 % by counting
    assert 30 < len(marked) < 70
    assert marked[0].best.border == ("x",)
    assert "border of the table in x; the indenter may be outside" in marked[0].reason


@pytest.fixture(scope="module")
def paper():
    """Model of the left half of the board, and δ by the response map between the positions of its table."""
    design, quick = (
        first_coils_design(4),
        {"imperfections": IDEAL, "accuracy": MapAccuracy(mesh=LayerMesh(harmonics=8, width=0.3, rows=4))},
    )
    depths, x, y = table_grid(design, deepest=1.7e-3)
    table = response_map(design, depths=depths, x=x[x < 15e-3], y=y, **quick)
    random = np.random.default_rng(2020)
    grid = [random.uniform(*ends) for ends in ((0.5e-3, 1.5e-3, 4), (-17e-3, 10e-3, 8), (-8e-3, 8e-3, 5))]
    depth, along, across = (np.sort(axis) for axis in grid)
    truth = response_map(design, depths=depth, x=along, y=across, **quick)
    points = np.stack(np.meshgrid(depth, across, along, indexing="ij")[::-1], axis=-1).reshape(-1, 3)
    return table, points, truth.delta.values.reshape(len(points), -1)


@pytest.fixture(scope="module")
def paper_model(paper):
    return forward_model(paper[0])


def test_table_is_fine_enough(paper, paper_model):
    """Errors of the spline at 160 places and depths between those of the table."""
    table, points, delta = paper
    error = np.abs(paper_model.delta(points) - delta).max()
    assert error < 2e-6  # a fifth of the noise, mostly the scatter of the contact's mesh from depth to depth
    jacobian = paper_model.jacobian(points)[..., 2].reshape(4, -1)
    miss = (paper_model.delta(points) - delta).reshape(4, -1)
    shift = (jacobian * miss).sum(axis=1) / (jacobian**2).sum(axis=1)
    assert np.abs(shift).max() < 1e-6  # m: 0.1 % of 1 mm
    assert (rest := np.abs(miss - jacobian * shift[:, None]).max()) < 1e-6
    coarse = forward_model(table.isel(x=slice(None, None, 2), y=slice(None, None, 2)))
    inside = (points <= coarse.upper).all(axis=1)
    assert np.abs(coarse.delta(points[inside]) - delta[inside]).max() > 5 * rest


def test_search_finds_what_many_random_starts_find(paper, paper_model):
    _, points, delta = paper
    readings = noisy(delta, seed=13)[::9]
    found = locate_all(paper_model, readings, noise=NOISE)
    starts = np.random.default_rng(14).uniform(paper_model.lower, paper_model.upper, (len(readings), 100, 3))
    starts[:, 0] = points[::9]
    weights = whitening_of(paper_model, NOISE)
    _, chi_square = refine(paper_model, np.repeat(readings, 100, axis=0), starts.reshape(-1, 3), weights)
    least = chi_square.reshape(-1, 100).min(axis=1)
    # of what counts in the region, 7.8; one reading of the 40 may end in a side valley
    assert np.sort([one.best.chi_square - low for one, low in zip(found, least, strict=True) if one.modes])[-2] < 0.1


def test_regions_hold_the_truth(paper, paper_model):
    """Coverage of the joint 95 % region of x, y and depth, at the noise of the goal."""
    _, points, delta = paper
    readings, truth = np.concatenate([noisy(delta, seed=seed) for seed in range(7)]), np.tile(points, (7, 1))
    each = zip(readings, truth, locate_all(paper_model, readings, noise=NOISE), strict=True)
    held = [
        deviance(paper_model, one, found, point, noise=NOISE).item() <= REGION
        for one, point, found in each
        if found.modes
    ]
    assert len(held) > 1000
    assert 0.92 <= np.mean(held) <= 0.98


def allowed(model, points, noise):
    """Where 1.96 standard deviations of the Cramér–Rao bound are within 0.1 mm of x and 3 % of the depth."""
    sigma = np.sqrt(np.diagonal(covariance_of(fisher_information(model, points, noise)), axis1=1, axis2=2))
    return (1.96 * sigma[:, 0] <= 0.1e-3) & (1.96 * sigma[:, 2] <= 0.03 * points[:, 2]), sigma


def test_goal_is_beyond_the_bound_at_a_noise_of_ten_parts_per_million(paper, paper_model):
    """δ of 1e-4 to 2.6e-3 is too little for three unknowns: no place of this board allows both x and depth."""
    ok, sigma = allowed(paper_model, paper[1], NOISE)
    assert not ok.any()
    assert 1.96 * np.median(sigma[:, 0]) > 0.1e-3


def test_goal_is_met_where_the_bound_allows_it(paper, paper_model):
    """At the noise of readings averaged a thousandfold."""
    _, points, delta = paper
    noise = 3e-7
    ok, _ = allowed(paper_model, points, noise)
    away = []
    for seed in range(5):
        away.append(best_places(locate_all(paper_model, noisy(delta, noise, seed)[ok], noise=noise)) - points[ok])
    error = np.abs(np.concatenate(away))
    assert len(error) >= 200
    assert np.quantile(error[:, 0], 0.95) <= 0.1e-3
    assert np.quantile(error[:, 2] / np.tile(points[ok, 2], 5), 0.95) <= 0.03


def test_bad_readings_are_refused(field):
    good = dict(zip(field.states, field.delta([2e-3, 1e-3, 1e-3]).tolist(), strict=True))
    bad = {
        r"no state 'coil9'": {**good, "coil9": 1e-4},
        r"every state; coil2 is missing": {name: value for name, value in good.items() if name != "coil2"},
        r"that of coil3 is nan": {**good, "coil3": np.nan},
        r"that of coil3 is inf": {**good, "coil3": np.inf},
        r"between -1 and 1; that of coil1 is 12": {**good, "coil1": 12.0},
        r"δ must be numbers; got": {**good, "coil1": "much"},
        r"one δ for each of 5 states; got shape \(4,\)": list(good.values())[:4],
        r"got shape \(\)": 1e-4,
        r"got shape \(1, 5\)": [list(good.values())],
    }
    for message, reading in bad.items():
        with pytest.raises(LocalizeError, match=message):
            locate(field, reading)
    # in a stream they spoil nothing else
    stream = [reading for pair in zip(bad.values(), [good] * len(bad), strict=True) for reading in pair]
    found = locate_all(field, stream)
    assert [location.verdict for location in found] == ["refused", "found"] * len(bad)
    assert found[2].reason == "a reading must have δ of every state; coil2 is missing."
    assert found[2].probability is None
    assert places([found[-1].best]) == pytest.approx(places([locate(field, good).best]), abs=1e-12)
    assert locate_all(field, []) == []
    readings = field.delta(between_the_coils(3))  # rows of an array are readings
    readings[1, 2] = np.nan
    assert [location.verdict for location in locate_all(field, readings)] == ["found", "refused", "found"]


def test_bad_arguments(field):
    reading = field.delta([2e-3, 1e-3, 1e-3])
    for noise in (0, -1e-5, np.nan, [1e-5] * 4):
        with pytest.raises(LocalizeError, match=r"noise must be"):
            locate(field, reading, noise=noise)
    for value in (0, 1, -0.1, np.nan):
        with pytest.raises(LocalizeError, match=r"confidence must be between 0 and 1"):
            locate(field, reading, confidence=value)
        with pytest.raises(LocalizeError, match=r"alarm must be between 0 and 1"):
            locate(field, reading, alarm=value)
    with pytest.raises(LocalizeError, match=r"3 unknowns need at least as many states; the model has coil1, coil2"):
        locate(field.select(["coil1", "coil2"]), reading[:2])
    with pytest.raises(LocalizeError, match=r"in the table"):
        deviance(field, reading, locate(field, reading), [1.0, 0.0, 1e-3])


def test_an_indentation_over_a_backplane_is_located() -> None:
    plate = """
[[plate]]
name = "backplane"
material = "aluminium"
thickness_mm = 1.0
distance_mm = 1.0
side = "below"
"""
    design = parse_design(first_coils(3) + plate)
    x, y = np.arange(-4e-3, 4.1e-3, 2e-3), np.arange(-4.5e-3, 4.6e-3, 3e-3)
    place, depths = (1.3e-3, 1.1e-3), np.array([0.4e-3, 0.7e-3, 1e-3])
    with coarse_maps():
        model = forward_model(response_map(design, x=x, y=y, depths=depths))
        of_air = forward_model(response_map(replace(design, plates=()), x=x, y=y, depths=depths))
        seen = response_map(design, x=[place[0]], y=[place[1]], depths=[0.6e-3]).delta.values.ravel()
    found = locate(model, seen).best
    # splines of a table of 2 and 3 mm; the board is nearly a mirror of itself along y
    assert [found.x, abs(found.y)] == pytest.approx(place, abs=0.1e-3)
    assert found.depth == pytest.approx(0.6e-3, rel=0.02)
    # read with the map of coils alone, the same δ is a dent half as deep, or none at all
    assert locate(of_air, seen).verdict != "located" or locate(of_air, seen).best.depth < 0.45e-3
