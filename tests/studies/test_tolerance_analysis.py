"""The whole analysis and located positions against closed forms, drawn boards, and smooth boards of known formula."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from scipy.linalg import block_diag
from support.contacts import coarse_maps, linear
from support.localize_boards import FIELD, ROW, bells, board
from support.tolerance_boards import (
    COPPER,
    DEPTH_OF_LOOP,
    DIELECTRIC,
    RADIUS,
    WIDTH,
    coaxial_loops,
    coaxial_loops_slope,
    loops,
)

from coilarray import load_design
from coilarray.compute.store import open_store
from coilarray.constants import MU_0
from coilarray.design.vary import vary
from coilarray.errors import GoalError, LocalizeError
from coilarray.localize.forward import forward_model
from coilarray.response.map import response_map
from coilarray.studies.quantities import evaluate
from coilarray.studies.tolerance import Spread, Tolerances, analyse, check_analysis, load_tolerances
from coilarray.studies.tolerance.analysis import shifts_at
from coilarray.studies.tolerance.tolerances import Limit, Positions, contributors, draw, errors_of, perturb

pytestmark = pytest.mark.slow

K = "k[upper,lower]"
STARTER = load_design("starter")
SMALL = Tolerances({
    "etch": Spread(board=1e-8, layer=2e-8), "registration": Spread("uniform", board=1e-7, layer=2e-7),
    "dielectric": Spread(board=1e-4, layer=1e-4), "copper": Spread("uniform", board=1e-3, layer=1e-3),
})  # fmt: skip


def of(result, output, contributor):
    return float(result.effect.sel(output=output, contributor=contributor))


@pytest.fixture(scope="module")
def small():
    """Errors so small that nothing bends, of loops side by side so that registration counts."""
    return analyse(loops(4.0), SMALL, samples=64, seed=1, accuracy="full")


def test_the_distance_of_coaxial_loops_acts_as_maxwell_says():
    """dk/dh = M'(h)/L: a dielectric thicker by a part p takes the loops p d apart, and leaves L alone."""
    sigma = 1e-3
    result = analyse(loops(), Tolerances({"dielectric": Spread(board=sigma)}), samples=0, accuracy="full")
    L = float(result.nominal.sel(output="inductance_uH[upper]")) * 1e-6
    effect = of(result, K, "dielectric, board")
    # the loops are polygons, open by a part of 1e-4: 2e-4 of M; their wire is 0.02 of the distance wide: (0.02)²
    assert float(result.nominal.sel(output=K)) * L == pytest.approx(coaxial_loops(DEPTH_OF_LOOP), rel=1e-3)
    assert effect * L == pytest.approx(coaxial_loops_slope(DEPTH_OF_LOOP) * DIELECTRIC * sigma, rel=1e-3)
    assert abs(of(result, "inductance_uH[upper]", "dielectric, board")) < 1e-12


def test_copper_acts_by_the_distance_of_the_middle_planes():
    """Copper thicker by t moves the middle of its layer by t/2, and that of the next one below by t."""
    sigma = 1e-2
    result = analyse(loops(), Tolerances({"copper": Spread(layer=sigma)}), samples=0, accuracy="full")
    L = evaluate(loops(), ["inductance_uH[upper]"])["inductance_uH[upper]"] * 1e-6
    away = coaxial_loops_slope(DEPTH_OF_LOOP) * COPPER / 2 * sigma / L
    # besides, L of the thicker one falls: dk/k = −dL/2L, to be taken off
    for layer, coil in (("L1", "upper"), ("L2", "lower")):
        name = f"copper, layer {layer}"
        own = -of(result, f"inductance_uH[{coil}]", name) * 1e-6 / (2 * L) * float(result.nominal.sel(output=K))
        # as in the test above, of a part of the effect
        assert of(result, K, name) - own == pytest.approx(away, rel=2e-3)


def test_etch_acts_on_a_loop_as_the_geometric_mean_distance_says():
    """L = µ0 r (ln(8r/g) − …), so that dL = −µ0 r dg/g; g = 0.2235 (w + t) for a bar: dg/g = dw/(w + t)."""
    sigma = 0.1e-6
    result = analyse(loops(), Tolerances({"etch": Spread(layer=sigma)}), samples=0, accuracy="full")
    effect = of(result, "inductance_uH[upper]", "etch, layer L1") * 1e-6
    # 0.2235 holds to 0.3 % over all shapes of bars, its slope to some per cent (Grover, table 1)
    assert effect == pytest.approx(-MU_0 * RADIUS * sigma / (WIDTH + COPPER), rel=0.05)
    assert abs(of(result, "inductance_uH[upper]", "etch, layer L2")) < 1e-12


def test_small_errors_are_linear_board_by_board(small):
    units = small.error.values / small.deviation.values
    predicted = small.nominal.values + units @ small.effect.values
    miss = np.abs(small.value.values - predicted) / small.linear_deviation.values
    # errors of 1e-7 m of 1e-3 m: second order is 1e-4 of the first at three standard deviations
    assert miss.max() < 1e-2


def test_the_drawn_spread_is_the_linear_one(small):
    off = (small.ratio - 1) / small.ratio_error
    # three outputs; Sobol points lie closer than the error of independent ones
    assert (abs(off) < 3).all()
    assert (small.ratio_error < 0.12).all()
    np.testing.assert_allclose(small.sample_mean, small.nominal, atol=float(small.linear_deviation.max()) / 4)
    low, high = small.percentiles.values
    # 64 boards have one or two beyond each end; the quantile is known to a fifth of the spread or so
    np.testing.assert_allclose(high - low, 2 * 1.96 * small.linear_deviation, rtol=0.3)


def test_effects_of_layers_and_shares_of_the_variance_add_up(small):
    for kind, of_board, of_layer in (("etch", 1e-8, 2e-8), ("dielectric", 1e-4, 1e-4), ("copper", 1e-3, 1e-3)):
        parts = [name for name in small.contributor.values if name.startswith(f"{kind}, layer")]
        total = small.effect.sel(contributor=parts).sum("contributor") / of_layer
        # linear by construction: the same differences, added
        np.testing.assert_allclose(small.effect.sel(contributor=f"{kind}, board") / of_board, total, rtol=1e-12)
    np.testing.assert_allclose(small.share.sum("contributor"), 1, rtol=1e-12)
    np.testing.assert_allclose((small.effect**2).sum("contributor"), small.linear_deviation**2, rtol=1e-12)


def test_layers_shifted_alike_do_not_count(small):
    """Loops without holes between them: only the shift of one against the other changes k."""
    upper, lower = (of(small, K, f"registration_x, layer {layer}") for layer in ("L1", "L2"))
    # the ends of a line stay where they are: one of 100 segments, half of it moved
    assert upper == pytest.approx(-lower, rel=0.05)
    assert abs(of(small, K, "registration_x, board")) < 0.05 * abs(upper)
    # nothing changes to first order where the shift is across the line between the loops, but for those ends
    assert abs(of(small, K, "registration_y, layer L1")) < 0.05 * abs(upper)


def test_registration_is_the_shift_of_a_loop():
    """Against the coupling of a design with a loop that stands elsewhere."""
    step, sigma = 2e-6, 1e-6
    errors = Tolerances({"registration": Spread(layer=sigma)})
    result = analyse(loops(4.0), errors, samples=0, quantities=[K], accuracy="full")
    near, far = (evaluate(loops(4.0 + sign * step * 1e3), [K])[K] for sign in (-1, 1))
    slope = (far - near) / (2 * step)
    # the ends that stay: 1 % of a loop
    assert of(result, K, "registration_x, layer L2") == pytest.approx(slope * sigma, rel=0.03)


def test_the_yield_of_a_normal_output_is_known():
    design, errors = loops(), Tolerances({"dielectric": Spread(board=1e-4)})
    free = analyse(design, errors, samples=0, quantities=[K])
    nominal, deviation = float(free.nominal[0]), float(free.linear_deviation[0])
    limits = (
        Limit(K, at_most=nominal + 1.2815515655 * deviation),
        Limit(K, at_least=nominal - 0.6744897502 * deviation),
        Limit(K, nominal - 10 * deviation, nominal + 10 * deviation),
    )
    known = [0.9, 0.75, 1.0, 0.65]
    result = analyse(design, replace(errors, limits=limits), samples=64, quantities=[K])
    np.testing.assert_allclose(result.linear_yield, known, atol=1e-3)  # 65536 even points in one dimension
    # Sobol points in one dimension: one of 64 at each quantile
    np.testing.assert_allclose(result.sample_yield, known, atol=2 / 64)
    assert (result.sample_yield_low <= known).all()
    assert (result.sample_yield_high >= known).all()
    assert result.limit.values[-1] == "all limits"


def test_boards_that_fail_are_counted_with_the_reason():
    """Traces of 20 µm with an etch of 12 µm: P(z < −20/12) = 4.8 % have no trace left."""
    hard = Tolerances({"etch": Spread(board=12e-6)}, limits=(Limit(K, at_most=1.0),))
    result = analyse(loops(), hard, samples=64, quantities=[K])
    failed = result.failure.values != ""
    assert failed.sum() == pytest.approx(0.0478 * 64, abs=1)  # Sobol points in one dimension
    assert all(
        "no board can be made with these errors: trace_width must be positive" in reason
        for reason in result.failure.values[failed]
    )
    np.testing.assert_array_equal(np.isnan(result.value.values[:, 0]), failed)
    np.testing.assert_array_equal(result.error.values[failed, 0] <= -20e-6, True)
    assert float(result.sample_yield[-1]) == 1 - failed.mean()
    assert np.isfinite(result.sample_deviation).all()


def test_seeds_repeat_to_the_last_digit(tmp_path):
    few = Tolerances({"dielectric": Spread(board=1e-4), "copper": Spread("uniform", board=1e-3)})

    def run(seed, cache=None):
        return analyse(loops(), few, samples=8, seed=seed, quantities=[K], cache=cache)

    one, other = run(1), run(2)
    xr.testing.assert_identical(run(1), one)
    assert not np.array_equal(one.value, other.value)
    np.testing.assert_array_equal(one.effect, other.effect)
    cache = open_store(tmp_path)
    xr.testing.assert_identical(run(1, cache=cache), one)
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}
    assert kept
    xr.testing.assert_identical(run(1, cache=cache), one)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")} == kept


def test_the_spread_of_screened_inductances_is_right_to_a_hundredth():
    """Changes of L and k of the reference board by typical errors, in units of their spread."""
    names = ["inductance_uH[coil1]", "k[coil1,coil2]", "k[coil1,coil3]", "k[coil3,coil6]"]
    design = load_design("gast2020")
    found = contributors(design, load_tolerances())
    boards = [perturb(design, errors_of(found, row)) for row in draw(found, 3, seed=4)[1:]]
    changes = {}
    for accuracy in ("full", "screen"):
        nominal, *others = (list(evaluate(one, names, accuracy=accuracy).values()) for one in (design, *boards))
        changes[accuracy] = np.array(others) - nominal
    # standard deviations of `coilarray tolerance gast2020`
    spread = np.array([0.127, 1.15e-3, 5.0e-5, 3.1e-5])
    assert (np.abs(changes["full"]) > 0.05 * spread).any(axis=0).all()  # else there is nothing to compare
    off = np.abs(changes["screen"] - changes["full"]) / spread
    # measured 0.020 for k of coils 1 and 3, whose spread is a twentieth of that of neighbours
    assert (off.max(axis=0) < [0.01, 0.01, 0.025, 0.01]).all()


AT = Positions((0.0,), (0.0,), 1e-3)


@pytest.mark.parametrize(("wanted", "arguments", "message"), [
    (SMALL, {"samples": 7}, "samples must be 0 or at least 8; got 7"),
    (SMALL, {"samples": -8}, "samples must be 0 to"), (SMALL, {"seed": -1}, "seed must not be negative"),
    (SMALL, {"quantities": ["worst"]}, "no quantity 'worst'"),
    (SMALL, {"quantities": ["k[upper,nobody]"]}, "no coil 'nobody'"),
    (SMALL, {"quantities": ["peak_delta"]}, r"no \[indenter\]"),
    (replace(SMALL, limits=(Limit("worst", at_most=1.0),)), {"quantities": [K]},
     r"the limit worst ≤ 1 does not name an output; there are k\[upper,lower\]"),
    (replace(SMALL, positions=AT), {}, "positions need"), (Tolerances({"etch": Spread(board=45e-6)}), {},
     r"etch\.L1 .*one standard deviation or less, cannot be made: .*trace_width"),
    # both boards next to the nominal one are possible, but some of the eight drawn ones are not
    (Tolerances({"dielectric": Spread(board=0.99)}), {"samples": 8, "quantities": [K]},
     r"fewer than 8 of 8 boards have k\[upper,lower\]: no board can be made with these errors"),
])  # fmt: skip
def test_bad_arguments_are_refused(wanted, arguments, message):
    with pytest.raises(GoalError, match=message):
        analyse(loops(), wanted, **{"samples": 0, **arguments})


@pytest.mark.parametrize(("place", "message"), [
    (Positions((0.0, 0.09), (0.0,), 1e-3), "x must be -19 to 19 mm, in the table of starter; got 90"),
    (Positions((0.0,), (0.09,), 1e-3), "y must be "), (Positions((0.0,), (0.0,), 1.0), "depth must be "),
    (AT, "3 unknowns need at least as many states; the scan has coil1, coil2"),
])  # fmt: skip
def test_positions_are_refused_before_the_table_is_computed(monkeypatch, place, message):
    late = "coilarray.studies.tolerance.analysis.table_for"
    monkeypatch.setattr(late, lambda *_, **__: pytest.fail("the table must come last"))
    design = vary(STARTER, {"array.columns": 2}) if "unknowns" in message else STARTER
    wanted = Tolerances({"placement": Spread(board=1e-5)}, positions=place)
    for check in (check_analysis, analyse):
        with pytest.raises(LocalizeError, match=message):
            check(design, wanted, samples=0, quantities=["span_mm"])


LARGEST = 4e-3  # m


@pytest.fixture(scope="module")
def field():
    """A board without symmetry: x, y and depth are told everywhere."""
    return forward_model(board(FIELD))


# two positions, one depth
PLACES = Positions((1e-3, 3e-3), (2e-3,), 1e-3, 1e-6)


def test_the_linear_map_undoes_the_model(field):
    """P J = 1 at each place and nothing between places; of what is no shift it takes the least squares."""
    shifts = shifts_at(field, PLACES, LARGEST)
    assert shifts.determined == ((0, 1, 2), (0, 1, 2))
    jacobian = field.jacobian(shifts.points)
    # a pseudo-inverse of a matrix of condition 10
    np.testing.assert_allclose(shifts.matrix() @ block_diag(*jacobian / 1e3), np.eye(6), atol=1e-12)  # per mm
    change = np.random.default_rng(0).normal(size=(2, len(field.states))) * 1e-6
    wanted = [np.linalg.lstsq(J, c, rcond=None)[0] * 1e3 for J, c in zip(jacobian, change, strict=True)]
    np.testing.assert_allclose(shifts.matrix() @ change.ravel(), np.concatenate(wanted), rtol=1e-9)
    assert shifts.names(("a", "b"))[:4] == ("shift_x_mm[a]", "shift_y_mm[a]", "shift_depth_mm[a]", "shift_x_mm[b]")
    assert shifts.undetermined(("a", "b")) == ()


def test_the_solver_finds_where_the_board_reads_from(field):
    """Δδ of an indenter that is somewhere else: both solver and map lead there."""
    shifts = shifts_at(field, PLACES, LARGEST)
    away = np.array([20e-6, -30e-6, 5e-6])
    change = (bells(shifts.points + away, FIELD) - bells(shifts.points, FIELD)).reshape(1, -1)
    located, found = shifts.located(change)
    # the table errs by 1e-6 of δ in steps of 1 mm
    np.testing.assert_allclose(located[0].reshape(2, 3), np.tile(away * 1e3, (2, 1)), atol=1e-3)
    assert found == 2
    # second order: (30 µm)² against lengths of some mm
    np.testing.assert_allclose(shifts.matrix() @ change[0], located[0], atol=1e-3)


def test_what_a_symmetric_board_cannot_tell_is_left_out():
    row = forward_model(board(ROW))
    shifts = shifts_at(row, Positions((5e-3,), (0.0, 5e-3), 1e-3, 1e-6), LARGEST)
    assert shifts.determined == ((0, 2), (0, 1, 2))
    assert shifts.undetermined(("on the line", "off it")) == ("y at on the line",)
    assert shifts.names(("on", "off"))[:3] == ("shift_x_mm[on]", "shift_depth_mm[on]", "shift_x_mm[off]")
    assert shifts.matrix().shape == (5, 2 * len(ROW))
    # so weak a reading tells nothing at all
    assert shifts_at(row, Positions((5e-3,), (0.0,), 1e-3, 1.0), LARGEST).determined == ((),)


def test_a_reading_of_nothing_has_no_position(field):
    shifts = shifts_at(field, PLACES, LARGEST)
    located, found = shifts.located(-field.delta(shifts.points).reshape(1, -1))
    assert np.isnan(located).all()
    assert found == 0
    none, _ = shifts.located(np.zeros((0, 2 * len(field.states))))
    assert none.shape == (0, 6)


def test_positions_must_be_in_the_table_and_states_enough(field):
    with pytest.raises(LocalizeError, match="x of a point must be in the table"):
        shifts_at(field, Positions((1.0,), (0.0,), 1e-3), LARGEST)
    with pytest.raises(LocalizeError, match="3 unknowns need at least as many states"):
        shifts_at(field.select(field.states[:2]), PLACES, LARGEST)


LINEAR = linear(load_design("starter"))
PLACE = "x_mm=3,y_mm=3,depth_mm=0.4"
PRESSED = Positions((3e-3,), (3e-3,), 0.4e-3, 1e-7)


@pytest.fixture(scope="module")
def table():
    """Response of the starter around the position, fine enough for its derivatives."""
    x = y = np.linspace(2e-3, 4e-3, 5)
    with coarse_maps():
        yield response_map(LINEAR, depths=[0.35e-3, 0.4e-3, 0.45e-3], x=x, y=y)


@pytest.fixture(scope="module")
def placed(table):
    errors = Tolerances({"placement": Spread(board=0.05e-3)}, positions=PRESSED)
    with coarse_maps():
        return analyse(LINEAR, errors, samples=8, quantities=["span_mm"], table=table)


def test_a_misplaced_elastomer_is_located_where_it_is_pressed(placed):
    """The board reads δ(x + a): so the position is off by a, along its own axis alone."""
    assert placed.attrs["undetermined"] == ""
    for axis, other in (("x", "y"), ("y", "x")):
        # derivatives of splines of 0.5 mm steps
        assert of(placed, f"shift_{axis}_mm[{PLACE}]", f"placement_{axis}, board") == pytest.approx(0.05, rel=0.02)
        assert abs(of(placed, f"shift_{axis}_mm[{PLACE}]", f"placement_{other}, board")) < 0.02 * 0.05
    assert float(placed.linear_deviation.sel(output=f"shift_depth_mm[{PLACE}]")) < 0.02 * 0.05


def test_the_real_solver_finds_the_same_shifts(placed):
    shifts = [f"shift_x_mm[{PLACE}]", f"shift_y_mm[{PLACE}]"]
    # as above, over the 0.1 mm that drawn boards reach
    np.testing.assert_allclose(placed.value.sel(output=shifts), placed.error.values * 1e3, atol=3e-3)
    assert (abs(placed.ratio.sel(output=shifts) - 1) < 3 * placed.ratio_error.sel(output=shifts)).all()
    assert placed.attrs["found"] == "8 of 8 readings"


def test_a_stronger_sheet_answers_more(table):
    errors = Tolerances({"permeability": Spread(board=0.02)}, positions=PRESSED)
    with coarse_maps():
        result = analyse(LINEAR, errors, samples=0, quantities=["span_mm"], table=table)
    name = f"delta[coil2,{PLACE}]"
    change = of(result, name, "permeability, board") / float(result.nominal.sel(output=name)) / 0.02
    # δ ∝ β = (μr − 1)/(μr + 1) over a thick sheet gives dlnβ/dlnμr = 2μr/(μr² − 1) = 0.86 at 2.7, over a thin one
    # δ ∝ μr − 1/μr gives (μr² + 1)/(μr² − 1) = 1.32; it is neither
    assert 0.8 < change < 1.6
