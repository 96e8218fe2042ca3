"""Response and located position over the errors of boards, of real boards and of smooth ones of known formula."""

import numpy as np
import pytest
from scipy.linalg import block_diag
from support.contacts import coarse_maps, linear
from support.localize_boards import FIELD, ROW, bells, board

from coilarray import load_design
from coilarray.errors import LocalizeError
from coilarray.localize.forward import forward_model
from coilarray.response.map import response_map
from coilarray.studies.tolerance import Positions, Spread, Tolerances, analyse
from coilarray.studies.tolerance.analysis import shifts_at

pytestmark = pytest.mark.slow

LARGEST = 4e-3  # m


def of(result, output, contributor):
    return float(result.effect.sel(output=output, contributor=contributor))


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


STARTER = linear(load_design("starter"))
PLACE = "x_mm=3,y_mm=3,depth_mm=0.4"
AT = Positions((3e-3,), (3e-3,), 0.4e-3, 1e-7)


@pytest.fixture(scope="module")
def table():
    """Response of the starter around the position, fine enough for its derivatives."""
    x = y = np.linspace(2e-3, 4e-3, 5)
    with coarse_maps():
        yield response_map(STARTER, depths=[0.35e-3, 0.4e-3, 0.45e-3], x=x, y=y)


@pytest.fixture(scope="module")
def placed(table):
    errors = Tolerances({"placement": Spread(board=0.05e-3)}, positions=AT)
    return analyse(STARTER, errors, samples=8, quantities=["span_mm"], table=table)


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
    errors = Tolerances({"permeability": Spread(board=0.02)}, positions=AT)
    result = analyse(STARTER, errors, samples=0, quantities=["span_mm"], table=table)
    name = f"delta[coil2,{PLACE}]"
    change = of(result, name, "permeability, board") / float(result.nominal.sel(output=name)) / 0.02
    # δ ∝ β = (μr − 1)/(μr + 1) over a thick sheet gives dlnβ/dlnμr = 2μr/(μr² − 1) = 0.86 at 2.7, over a thin one
    # δ ∝ μr − 1/μr gives (μr² + 1)/(μr² − 1) = 1.32; it is neither
    assert 0.8 < change < 1.6
