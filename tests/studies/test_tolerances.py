"""Tolerance files, drawn boards and their errors on geometry, R, L and the tank by closed forms."""

import math
import pickle
import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest, norm, uniform
from support.tolerance_boards import WIDTH, loops

from coilarray import load_design
from coilarray.circuit.coupling import couple_design, design_inductance
from coilarray.electromagnetics.resistance import dc_resistance
from coilarray.errors import GoalError
from coilarray.geometry import MATERIALS, Disc, FinitePlate, Plate, Target
from coilarray.studies.tolerance import Spread, Tolerances, load_tolerances, typical_text
from coilarray.studies.tolerance.analysis import deviation_error, kept
from coilarray.studies.tolerance.tolerances import (
    Contributor,
    Limit,
    Positions,
    contributors,
    draw,
    error_names,
    errors_of,
    parse_tolerances,
    perturb,
)

EVERY_TABLE = """
schema = 1
others = "none"
quantities = ["worst_k", "rms_k"]
etch = { board_um = 5, layer_um = 2.5 }
registration = { distribution = "uniform", layer_um = 30 }
rotation = { layer_mrad = 0.2 }
dielectric = { board_percent = 3 }
copper = { layer_percent = 4 }
placement = { board_mm = 0.1 }
permeability = { board_percent = 5 }
elastomer = { layer_mm = 0.05 }
capacitance = { distribution = "uniform", board_percent = 5 }
plate_distance = { board_mm = 0.02, layer_mm = 0.03 }
plate_thickness = { layer_percent = 2 }
conductivity = { board_percent = 3 }
target_tilt = { board_mrad = 6 }
positions = { x_mm = [-26, 0], y_mm = [4], depth_mm = 1, noise = 2e-5 }
limit = [{ quantity = "worst_k", at_most = 0.06 }, { quantity = "rms_k", at_least = 0.0, at_most = 0.03 }]
assumed = { etch = "a guess" }
"""


def test_every_table_is_read_in_si():
    read = parse_tolerances(EVERY_TABLE)
    wanted = {
        "etch": Spread("normal", 5e-6, 2.5e-6), "rotation": Spread("normal", 0.0, 0.2e-3),
        "registration": Spread("uniform", 0.0, 30e-6 / math.sqrt(3)),  # a half width
        "dielectric": Spread("normal", 0.03, 0.0), "copper": Spread("normal", 0.0, 0.04),
        "placement": Spread("normal", 0.1e-3, 0.0), "permeability": Spread("normal", 0.05, 0.0),
        "elastomer": Spread("normal", 0.0, 0.05e-3), "capacitance": Spread("uniform", 0.05 / math.sqrt(3), 0.0),
        "plate_distance": Spread("normal", 0.02e-3, 0.03e-3), "plate_thickness": Spread("normal", 0.0, 0.02),
        "conductivity": Spread("normal", 0.03, 0.0), "target_tilt": Spread("normal", 6e-3, 0.0),
    }  # fmt: skip
    assert read.spreads.keys() == wanted.keys()
    for name, spread in wanted.items():
        found = read.spreads[name]
        assert found.distribution == spread.distribution
        # one product in floating point
        assert (found.board, found.layer) == pytest.approx((spread.board, spread.layer), rel=1e-15)
    assert read.quantities == ("worst_k", "rms_k")
    assert read.positions == Positions((-0.026, 0.0), (0.004,), 0.001, 2e-5)
    assert read.limits == (Limit("worst_k", at_most=0.06), Limit("rms_k", 0.0, 0.03))
    assert read.assumed == {"etch": "a guess"}


def test_typical_values_are_all_assumed():
    typical = load_tolerances()
    assert typical.spreads.keys() == typical.assumed.keys() == parse_tolerances(EVERY_TABLE).spreads.keys()
    assert all(typical.assumed.values())
    assert parse_tolerances(typical_text()).spreads == typical.spreads


def test_tables_that_are_not_given_are_typical_and_assumed_or_have_no_error(tmp_path):
    text, typical, etch = "schema = 1\n[etch]\nlayer_um = 1", load_tolerances(), {"etch": Spread("normal", 0.0, 1e-6)}
    read = parse_tolerances(text)
    assert read.spreads == {**typical.spreads, **etch}
    assert read.assumed == {key: reason for key, reason in typical.assumed.items() if key != "etch"}
    path = tmp_path / "etch.toml"
    path.write_text('others = "none"\n' + text, encoding="utf-8")
    alone = load_tolerances(path)
    assert (alone.spreads, alone.assumed) == (etch, {})


def test_contributors_are_the_parts_that_a_design_has():
    design = load_design("gast2020")
    found, layers, axes = contributors(design, load_tolerances()), 4, 2
    assert Counter(one.table for one in found) == {
        "etch": 1 + layers, "registration": axes * (1 + layers), "rotation": 1 + layers, "dielectric": 1 + layers - 1,
        "copper": 1 + layers, "placement": axes, "permeability": 1, "elastomer": 1 + 2, "capacitance": 1,
    }  # fmt: skip
    assert len({one.name for one in found}) == len(found)
    (board,) = [one for one in found if (one.table, one.part) == ("dielectric", "board")]
    assert board.targets == ("dielectric.L1-L2", "dielectric.L2-L3", "dielectric.L3-L4")
    # loops without elastomer have no placement, permeability or sheet
    found = contributors(loops(), load_tolerances())
    assert {one.table for one in found} == {"etch", "registration", "rotation", "dielectric", "copper", "capacitance"}
    with pytest.raises(GoalError, match="no error of loops has a spread"):
        contributors(loops(), Tolerances({"permeability": Spread(board=0.1)}))


HEAD = "schema = 1\n"


@pytest.mark.parametrize(("text", "message"), [
    ("", "schema is missing"), ("schema = 2", "schema must be at most 1; got 2"),
    (HEAD + 'others = "all"', "others must be 'typical' or 'none'; got 'all'"),
    (HEAD + "[etching]", "did you mean etch?"),
    (HEAD + "[etch]\nboard_mm = 1", "etch has no key 'board_mm'; did you mean board_um?"),
    (HEAD + "[etch]\nboard_um = -1", "etch.board_um must be at least 0; got -1"),
    (HEAD + "[placement]\nlayer_mm = 1", "placement has no key 'layer_mm'"),
    (HEAD + "[placement]", "placement.board_mm is missing"),
    (HEAD + "[positions]\nx_mm = [1, 0]\ny_mm = [0]\ndepth_mm = 1", "positions needs x_mm that rise"),
    (HEAD + '[[limit]]\nquantity = "rms_k"', "limit.0 needs at_least, at_most or both"),
    (HEAD + '[[limit]]\nquantity = "rms_k"\nat_least = 2\nat_most = 1', "limit.0 needs at_least up to at_most"),
    (HEAD + '[assumed]\netch = "x"', "assumed.etch does not name a table of errors of the file"),
    (HEAD + "[etch]\nboard_um = nan", "etch.board_um must be"),
    (HEAD + '[etch]\nboard_um = "5"', "etch.board_um must be"),
    (HEAD + '[etch]\ndistribution = "flat"', "etch.distribution must be"),
    (HEAD + "quantities = [3]", "quantities.0 must"),
    (HEAD + "[dielectric]\nboard_percent = 101", "dielectric.board_percent must be at most 100; got 101"),
    (HEAD + "[positions]\nx_mm = [0]\ny_mm = [0]", "positions.depth_mm is missing"),
    (HEAD + "[positions]\nx_mm = []\ny_mm = [0]\ndepth_mm = 1", "positions.x_mm must"),
    (HEAD + "[positions]\nx_mm = [0]\ny_mm = [0]\ndepth_mm = 0", "positions.depth_mm must be greater than 0"),
    (HEAD + "[positions]\nx_mm = [0]\ny_mm = [0]\ndepth_mm = 1\nnoise = 0", "positions.noise must be greater than 0"),
    (HEAD + "[[limit]]\nat_most = 1", "limit.0.quantity is missing"),
])  # fmt: skip
def test_mistakes_are_one_line_that_names_the_file(tmp_path, text, message):
    path = tmp_path / "fab.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(GoalError, match=rf"^{re.escape(str(path))}: .*{re.escape(message)}.*\Z"):
        load_tolerances(path)
    with pytest.raises(GoalError, match="there is no tolerance file"):  # the others are those of any design file
        load_tolerances(tmp_path / "missing.toml")


NAMES_OF_LAYERS = ("L1", "L2", "L3")


def etch(deviation_of_board, deviation_of_layer, distribution="normal"):
    """Board part and layer parts of one kind of error."""
    targets = tuple(f"etch.{layer}" for layer in NAMES_OF_LAYERS)
    board = Contributor("etch, board", "etch", "board", targets, distribution, deviation_of_board)
    parts = [
        Contributor(f"etch, layer {layer}", "etch", "layer", (target,), distribution, deviation_of_layer)
        for layer, target in zip(NAMES_OF_LAYERS, targets, strict=True)
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
    errors = np.array([[errors_of(found, row)[f"etch.{layer}"] for layer in NAMES_OF_LAYERS] for row in values])
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


GAST = load_design("gast2020")
STARTER = load_design("starter")
ROUNDING = 1e-12  # relative, of a few operations in double precision


def resistances(design):
    return dc_resistance(design.array.conductors(), design.circuit.resistivity)


def heights(design):
    return np.array([design.array.stackup.centre(name) for name in design.array.stackup.names])


def test_every_error_makes_another_board_which_travels_to_another_process():
    boards = {perturb(GAST, {name: 1e-6}).digest for name in error_names(GAST)}
    assert len(boards | {GAST.digest}) == len(error_names(GAST)) + 1
    board, errors = perturb(GAST, {"etch.L1": 1e-6, "copper.L2": 0.1}), {"copper.L2": 0.1, "etch.L1": 1e-6}
    assert board.digest == perturb(GAST, errors).digest == pickle.loads(pickle.dumps(board)).digest


@settings(max_examples=20)
@given(st.floats(-0.9, 5.0))
def test_resistance_goes_with_one_over_width_and_thickness(part):
    design = loops()
    found = resistances(perturb(design, {"etch.L1": part * WIDTH, "copper.L2": 0.2}))
    np.testing.assert_allclose(found, resistances(design) / [1 + part, 1.2], rtol=ROUNDING)


def test_etch_leaves_the_middle_line_and_the_pitch():
    etched = perturb(GAST, {f"etch.L{k}": -12e-6 for k in range(1, 5)})
    for before, after in zip(GAST.array.placements, etched.array.placements, strict=True):
        for line, other in zip(before.coil.lines, after.coil.lines, strict=True):
            np.testing.assert_array_equal(line, other)
        # half a nanometre: pitch and widths are read as millimetres
        assert after.coil.gap == pytest.approx(before.coil.gap + 12e-6, abs=1e-15)
        assert after.coil.trace_width == pytest.approx(before.coil.trace_width - 12e-6, abs=1e-15)


def test_a_layer_has_its_etch_alone():
    etched = perturb(GAST, {"etch.L4": 5e-6}).array.placements  # of the first coil, not of the second
    widths = [[float(width[0]) for width in place.coil.widths] for place in etched[:2]]
    np.testing.assert_allclose(widths, [[1e-4, 1.05e-4], [1e-4, 1e-4]], rtol=ROUNDING)


def test_dielectrics_and_copper_move_the_layers_below():
    before = heights(GAST)
    thicker = heights(perturb(GAST, {"dielectric.L2-L3": 0.1}))
    sunk = -0.1 * GAST.array.stackup.dielectric_thickness[1]
    np.testing.assert_allclose(thicker - before, [0, 0, sunk, sunk], atol=1e-18)
    # the middle of thicker copper sinks by half of what it gains, for the upper face stays
    plated = heights(perturb(GAST, {"copper.L2": 0.2}))
    np.testing.assert_allclose(plated - before, [0, -3.5e-6, -7e-6, -7e-6], atol=1e-18)


def test_holes_stay_and_the_rest_of_the_layer_moves():
    shift = np.array([20e-6, -30e-6])
    moved = perturb(GAST, {"registration_x.L2": shift[0], "registration_y.L2": shift[1]}).array.placements
    for before, after in zip(GAST.array.placements, moved, strict=True):
        np.testing.assert_array_equal(after.coil.via_points, before.coil.via_points)
        np.testing.assert_array_equal(after.coil.terminal_points, before.coil.terminal_points)
        for layer, line, other in zip(before.layers, before.coil.lines, after.coil.lines, strict=True):
            expected = np.tile(shift if layer == "L2" else (0, 0), (len(line) - 2, 1))
            # coordinates of some cm, to rounding
            np.testing.assert_allclose((other - line)[1:-1], expected, atol=1e-16)


def test_registration_is_in_the_frame_of_the_board():
    first, *others = GAST.array.placements
    turned = replace(first, rotation=0.7)
    board = replace(GAST, array=GAST.array.with_placements([turned, *others]))
    after = perturb(board, {"registration_x.L3": 10e-6}).array.placements[0]
    away = after.to_board(after.coil.lines[0]) - turned.to_board(turned.coil.lines[0])
    np.testing.assert_allclose(away[1:-1], np.tile([10e-6, 0], (len(away) - 2, 1)), atol=1e-16)


def test_rotation_is_about_the_middle_of_the_board():
    angle = 2e-4
    after = perturb(GAST, {"rotation.L3": angle}).array
    x_min, y_min, x_max, y_max = GAST.array.bounds
    middle = np.array([x_min + x_max, y_min + y_max]) / 2
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    for place, moved in zip(GAST.array.placements[::2], after.placements[::2], strict=True):
        wanted = (place.to_board(place.coil.lines[0]) - middle) @ turn.T + middle
        np.testing.assert_allclose(moved.to_board(moved.coil.lines[0])[1:-1], wanted[1:-1], atol=1e-16)
    # coils without copper on L3 are left alone
    np.testing.assert_array_equal(after.placements[1].coil.lines[0], GAST.array.placements[1].coil.lines[0])


@pytest.mark.slow
def test_all_layers_shifted_alike_couple_as_before():
    """But for the ends at the holes, whose last segments turn a little."""
    shift = {f"registration_x.L{k}": 50e-6 for k in range(1, 5)}
    L, moved = (design_inductance(design)[0] for design in (STARTER, perturb(STARTER, shift)))
    one = design_inductance(perturb(STARTER, {"registration_x.L1": 50e-6, "registration_x.L2": 50e-6}))[0]
    # a shift of one coil against the next by as much changes M some hundred times more
    assert np.abs(moved - L).max() < 0.02 * np.abs(one - L).max()


def test_sheets_have_their_thickness_and_the_magnetic_ones_their_permeability():
    sheets = perturb(GAST, {"permeability": 0.1, "elastomer.magnetic": -0.1e-3}).sheets
    found = [(sheet.relative_permeability, sheet.thickness) for sheet in sheets]
    np.testing.assert_allclose(
        found, [(1.0, 6e-3), (1.1 * GAST.sheets[1].relative_permeability, 1.9e-3)], rtol=ROUNDING
    )


def test_permeability_of_a_half_space_is_its_mirror_image():
    """A thick sheet adds β F with β = (μr − 1)/(μr + 1), so that ΔL changes by 2 dμr/(μr + 1)²/β of itself."""
    sheets = """
[[elastomer]]
name = "gap"
thickness_mm = 2.0
[[elastomer]]
name = "magnetic"
thickness_mm = 200.0
relative_permeability = 3.0
"""
    design, error = loops(sheets=sheets), 1e-4
    before, after = (design_inductance(one)[1] for one in (design, perturb(design, {"permeability": error})))
    expected = 2 * 3 * error / 4**2 / (2 / 4)
    # second order in the error, which is 1e-4
    np.testing.assert_allclose(after / before - 1, expected, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*resistivity_ohm_m of 1e-10")
def test_frequency_goes_with_one_over_the_root_of_the_tank():
    design = loops(extra="[circuit]\nresistivity_ohm_m = 1e-10")
    slow = perturb(design, {"capacitance": 0.21})
    f, lower = (couple_design(one, ideal=True).frequency.values for one in (design, slow))
    # f² LC = 1 − R² C/L: losses count by 1e-6
    np.testing.assert_allclose(f / lower, 1.1, rtol=1e-6)
    assert slow.circuit.switches.tank_capacitance == slow.circuit.capacitance


@pytest.mark.parametrize(("errors", "message"), [
    ({"etch.L9": 1e-6}, "no error 'etch.L9'"), ({"etch": 1e-6}, "no error 'etch'"),
    ({"placement_z": 1e-6}, "did you mean placement_"), ({"etch.L1": math.nan}, "etch.L1 must be finite"),
    ({"etch.L1": -0.1e-3}, "no board can be made with these errors: trace_width must be positive"),
    ({"etch.L1": 0.21e-3}, "no board can be made with these errors: gap must be positive"),
    ({"dielectric.L1-L2": -1.0}, "no board can be made with these errors: a layer thickness"),
    ({"copper.L1": -1.5}, "no board can be made with these errors: a layer thickness"),
    ({"elastomer.base": -6e-3}, "no board can be made with these errors: thickness of sheet 'base'"),
    ({"permeability": -0.9}, "no board can be made with these errors: relative permeability"),
    ({"permeability": -1.2}, "permeability must be above"), ({"capacitance": -1.0}, "capacitance must be above"),
])  # fmt: skip
def test_bad_errors_are_refused_in_one_line(errors, message):
    with pytest.raises(GoalError, match=r"^[^\n]+$") as caught:
        perturb(GAST, errors)
    assert message in str(caught.value)


def test_plates_keep_or_move_their_face_near_the_coils_and_a_target_adds_its_tilts():
    aluminium, brass = MATERIALS["aluminium"], MATERIALS["brass"]
    plates = (
        Plate("cover", 12e-3, 1e-3, aluminium),
        FinitePlate("back", Disc(8e-3), (0.0, 0.0, -5e-3), 2e-3, brass, tilt=0.1),
    )
    body = FinitePlate("target", Disc(8e-3), (0.0, 0.0, 0.0), 1e-3, aluminium, tilt=0.03, tilt_direction=math.pi / 2)
    design = replace(STARTER, plates=plates, target=Target(body, (1e-3,), (0.0,), (0.0,)))
    assert set(error_names(design)) - set(error_names(STARTER)) == {
        "plate_distance.cover", "plate_distance.back", "plate_thickness.cover", "plate_thickness.back", "conductivity",
        "target_tilt_x", "target_tilt_y",
    }  # fmt: skip
    errors = {"plate_distance.back": 0.2e-3, "plate_thickness.cover": 0.1, "plate_thickness.back": 0.1}
    found = perturb(design, {**errors, "conductivity": -0.2, "target_tilt_x": 0.04})
    cover, back = found.plates
    np.testing.assert_allclose(cover.heights, (12e-3, 13.1e-3), rtol=ROUNDING)
    assert back.heights[1] == pytest.approx(plates[1].heights[1] - 0.2e-3, rel=ROUNDING)
    assert back.thickness == pytest.approx(2.2e-3, rel=ROUNDING)
    conductivities = [one.material.conductivity for one in (cover, back, found.target.body)]
    before = [aluminium.conductivity, brass.conductivity, aluminium.conductivity]
    np.testing.assert_allclose(conductivities, np.multiply(0.8, before), rtol=ROUNDING)
    tilted = found.target.body
    assert (tilted.tilt, tilted.tilt_direction) == pytest.approx((0.05, math.atan2(3, 4)), rel=1e-12)
    sheet, (upper, lower) = STARTER.sheets[0].name, STARTER.array.stackup.names[:2]
    touching = replace(design, plates=(plates[0].lifted(STARTER.top - 12e-3),), target=None)
    thicker = {f"elastomer.{sheet}": 20e-6, f"dielectric.{upper}-{lower}": 0.1, "plate_distance.cover": -30e-6}
    found = perturb(touching, thicker)
    assert found.plates[0].heights[0] == pytest.approx(found.top, rel=ROUNDING)
    assert found.top == pytest.approx(STARTER.top + 20e-6, rel=ROUNDING)
    for error in ("plate_thickness.cover", "conductivity"):
        with pytest.raises(GoalError, match="must be above −1"):
            perturb(design, {error: -1.0})


def test_a_misplaced_elastomer_takes_its_sample_along():
    """The bounds of the sample are from the origin of the map, which moves with the elastomer."""
    before, after = GAST.indentation, perturb(GAST, {"placement_x": 0.1e-3, "placement_y": -0.2e-3}).indentation
    np.testing.assert_allclose(np.subtract(after.origin_point, before.origin_point), [0.1e-3, -0.2e-3], atol=1e-15)
    assert after.sample_bounds == before.sample_bounds
