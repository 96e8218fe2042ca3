"""The sensor response matrix and the two-dimensional model.

Who checks whom: δ of one coil alone against ΔL/L; the resonance of the whole circuit against the reciprocity formula
iᵀ ΔL i; a tilted sample against a level one where it is level, and its interpolation against more nodes; the flat part
of the wires against the image series of a long loop; a lifted sheet against another flat one.
"""

from dataclasses import replace

import numpy as np
import pytest
from support.active_coil import active_coil
from support.contacts import IDEAL, QUICK, contacts_of, first_coils_design

import coilarray.response.changes as response_module
import coilarray.response.setup as response_setup
from coilarray import load_design
from coilarray.compute.netcdf import load_part, save_dataset
from coilarray.compute.store import Store
from coilarray.design.bundled import read
from coilarray.design.model import parse_design
from coilarray.elastomer.contact import DEFAULT_MESH
from coilarray.elastomer.dent import Dent
from coilarray.electromagnetics.flat_layer import layer_inductance
from coilarray.electromagnetics.inductance import inductance_matrix
from coilarray.electromagnetics.resistance import dc_resistance
from coilarray.errors import ElastomerError
from coilarray.geometry import Conductor, Cone, FlatPunch, Sheet
from coilarray.paper.two_dimensional import cross_section, line_dent_inductance, line_inductance, line_response
from coilarray.response.map import Imperfections, response_map

pytestmark = pytest.mark.slow

PAPER = load_design("gast2020")
FEM = load_design("gast_fem")
PAIR = first_coils_design(2)
X = [-13.28e-3, -6e-3, 2e-3]


def nominal(design=PAPER, **changes):
    """Response in the ideal circuit, which takes no seconds to make, on a coarse mesh."""
    return response_map(design, **{"x": X, "y": [0.0], "imperfections": IDEAL, "accuracy": QUICK, **changes})


def ideal(**imperfections):
    return Imperfections(network="ideal", **imperfections)


@pytest.fixture(scope="module")
def plain():
    return nominal()


def test_one_coil_alone_answers_with_its_own_change():
    result = nominal(FEM, depths=[1e-3], x=[0.0, 5e-3])
    own = result.inductance_change.values[0, 0, :, 0, 0] / result.inductance.values[0, 0]
    coil = dc_resistance(FEM.array.conductors(), FEM.circuit.resistivity)[0]
    R = coil + FEM.circuit.short_resistance  # the measured coil's switches are the same as in a short
    loss = R**2 * FEM.circuit.capacitance / result.inductance.values[0, 0]
    # 1/(ω²C) = L/(1 − R²C/L) of a lossy coil grows by (1 − R²C/L) as much as L, to first order: 1e-5
    assert result.delta.values[0, 0, :, 0] == pytest.approx(own * (1 - loss), rel=1e-5)


def test_response_follows_the_reciprocity_formula(plain):
    """To first order L_eff changes by Re iᵀ ΔL i with the currents of all coils."""
    L, R = plain.inductance.values, dc_resistance(PAPER.array.conductors(), PAPER.circuit.resistivity)
    for a in range(6):
        f = 1 / (2 * np.pi * np.sqrt(float(plain.base_inductance[a]) * PAPER.circuit.capacitance))
        state = active_coil(L, R, a, f, short_resistance=PAPER.circuit.short_resistance)
        change = plain.inductance_change.values[0, 0]
        linear = np.einsum("i,pij,j->p", state.currents, change, state.currents).real / state.apparent_inductance
        # 2e-3 of the largest: second order in ΔL is 1e-3, and losses shift the resonance a little
        assert plain.delta.values[0, 0, :, a] == pytest.approx(linear, abs=2e-3 * 6.9e-4)


def test_response_is_largest_at_the_coil_and_wide_on_a_seat(plain):
    with contacts_of(DEFAULT_MESH):
        delta = response_map(PAPER, x=X, y=[0.0], imperfections=IDEAL).delta.values[0, 0]
    assert delta[0].argmax() == 0
    # the paper fits about 1.22e-3; twice the error of 5e-5 that it has where the board is calibrated to it
    assert delta[0, 0] == pytest.approx(1.22e-3, abs=1e-4)
    # a plate's dent is wide, the paper has positive tails to 17 mm; without a seat they are negative beyond 9 mm
    assert delta[2, 0] > 0
    bonded = replace(PAPER, indentation=replace(PAPER.indentation, base="bonded"))
    assert nominal(bonded).delta.values[0, 0, 2, 0] < 0
    assert plain.delta.values[0, 0] == pytest.approx(delta, abs=0.01 * delta.max())  # the coarse meshes of these tests


def test_open_neighbours_and_strays_change_little(plain):
    opened = parse_design(read("gast2020").replace('default_termination = "short" ', 'default_termination = "open" '))
    assert opened.plan[0].exceptions["coil2"] == "open"
    without, strays = nominal(opened).delta.values, nominal(imperfections=None).delta.values
    largest, L = plain.delta.values.max(), plain.inductance.values
    # each of two neighbours takes k² off L_eff, adds k² of its own change and 2k of that of M, which is about k of ΔL
    k = abs(L[0, 1]) / np.sqrt(L[0, 0] * L[1, 1])
    assert 1e-4 < np.abs(without - plain.delta.values).max() / largest < 8 * k**2
    assert 1e-5 < np.abs(strays - plain.delta.values).max() / largest < 0.01


def test_depths_are_rising_and_zero_depth_is_zero():
    result = nominal(depths=[0.0, 0.5e-3, 1e-3])
    assert (result.delta.values[0] == 0).all()  # to the last digit: nothing has changed
    assert 0 < result.delta.values[1, 0, 0, 0] < result.delta.values[2, 0, 0, 0]
    assert (np.diff(result.force.values) > 0).all()


@pytest.mark.parametrize("circuit", [IDEAL, None])
def test_a_sheet_of_the_permeability_of_air_does_nothing(circuit):
    """μr = 1: δ is 0 to the last digit, with strays and losses too."""
    air = replace(PAPER, sheets=tuple(replace(sheet, relative_permeability=1.0) for sheet in PAPER.sheets))
    result = response_map(air, depths=[1e-3], x=[0.0, 5e-3], y=[0.0], imperfections=circuit)
    assert (result.inductance_change.values == 0).all()
    assert (result.delta.values == 0).all()


def test_imperfections_are_another_experiment(plain):
    shifted = nominal(x=np.subtract(X, 1e-3), imperfections=ideal(offset=(1e-3, 0.0)))
    assert shifted.delta.values == pytest.approx(plain.delta.values, rel=1e-9)
    deeper = nominal(depths=[0.9e-3], imperfections=ideal(depth_error=0.1e-3))
    assert deeper.delta.values == pytest.approx(plain.delta.values, rel=1e-9)
    thinner = nominal(imperfections=ideal(thickness_errors={"base": -0.5e-3}))
    assert float(thinner.delta[0, 0, 0, 0]) > float(plain.delta[0, 0, 0, 0])
    sheets = (replace(PAPER.sheets[0], thickness=5.5e-3), PAPER.sheets[1])
    assert thinner.delta.values == pytest.approx(nominal(replace(PAPER, sheets=sheets)).delta.values, rel=1e-12)


def test_a_tilted_sample_is_locally_a_thicker_and_deeper_one():
    tilted = nominal(PAIR, imperfections=ideal(tilt=(0.0, 0.02)))
    # on y = 0 nothing is raised; the flat matrix takes the thickness between the coils, all of them on y = 0
    assert tilted.delta.values == pytest.approx(nominal(PAIR).delta.values, rel=1e-9)
    tilt, rise = Imperfections(tilt=(0.01, 0.0)), 0.01 * X[0]
    thicker = Imperfections(thickness_errors={"base": rise})
    tilted, one = (
        nominal(PAIR, imperfections=replace(tilt, network="ideal")),
        nominal(PAIR, x=X[:1], imperfections=replace(tilt, network="ideal")),
    )
    local = nominal(PAIR, depths=[1e-3 + rise], x=X[:1], imperfections=replace(thicker, network="ideal"))
    # 1e-3: four nodes over ±0.13 mm; L_0 is that of another wedge
    change, expected = (one.inductance_change.values[0, 0, 0] for one in (tilted, local))
    assert change == pytest.approx(expected, rel=1e-3, abs=1e-13)
    # 2e-3: the map interpolates between four heights, the one place is solved at its own
    assert one.delta.values[0, 0, 0, 0] == pytest.approx(tilted.delta.values[0, 0, 0, 0], rel=2e-3)


def test_nodes_of_the_wedge_are_enough(monkeypatch):
    tilted = Imperfections(tilt=(0.02, 0.0))
    few = nominal(PAIR, imperfections=replace(tilted, network="ideal")).delta.values
    monkeypatch.setattr(response_setup, "_WEDGE_NODES", 7)
    many = nominal(PAIR, imperfections=replace(tilted, network="ideal")).delta.values
    # the contact's own mesh differs from node to node by some 3e-4, a coarse one as the default; two nodes err by 2e-3
    assert few == pytest.approx(many, abs=1e-3 * many.max())


def test_noise_has_its_size_and_its_seed():
    grid = {"depths": [1e-3], "x": np.linspace(-20e-3, -16e-3, 20), "y": np.linspace(0, 1e-3, 15)}
    quiet = nominal(FEM, **grid).delta.values
    noisy = [nominal(FEM, **grid, imperfections=ideal(noise=1e-5, seed=s)).delta.values for s in (1, 1, 2)]
    assert (noisy[0] == noisy[1]).all()
    assert (noisy[0] != noisy[2]).any()
    # two readings: √2 σ; 300 samples give it to 4 %, three times that allowed
    assert np.std(noisy[0] - quiet) == pytest.approx(np.sqrt(2) * 1e-5, rel=0.12)


def test_parts_are_used_again(tmp_path, monkeypatch):
    whole = nominal(PAIR).delta.values
    monkeypatch.setattr(response_module, "_POSITIONS", 2)
    first = nominal(PAIR, keep=Store(tmp_path).dataset).delta.values
    assert first == pytest.approx(whole, abs=1e-5 * first.max())  # other wavenumbers
    assert len(list(tmp_path.rglob("*.nc"))) == 2
    other = replace(PAIR, sheets=(replace(PAIR.sheets[0], thickness=4e-3), PAIR.sheets[1]))  # finds none of its own
    assert (nominal(other, keep=Store(tmp_path).dataset).delta.values == nominal(other).delta.values).all()
    with monkeypatch.context() as patch:
        patch.setattr(response_module, "dent_inductance", None)  # not needed any more
        assert (nominal(PAIR, keep=Store(tmp_path).dataset).delta.values == first).all()
    for part in tmp_path.rglob("*.nc"):  # damaged
        part.write_bytes(part.read_bytes()[:100])
    assert (nominal(PAIR, keep=Store(tmp_path).dataset).delta.values == first).all()


def test_dataset_is_complete_and_can_be_stored(plain, tmp_path):
    save_dataset(plain, tmp_path / "r.nc")
    stored = load_part(tmp_path / "r.nc")
    assert stored.delta.dims == ("depth", "y", "x", "state")
    assert all("units" in stored[name].attrs for name in (*stored.data_vars, "x", "y", "depth", "coil_x"))
    assert stored.attrs["design_hash"] == PAPER.digest
    assert plain.coil_x.values[1] == 0.0  # the map's origin is coil 2


OUTSIDE = read("gast2020").replace("step_mm = 2", "sample_x_mm = [-20, 20]\nsample_y_mm = [-8, 8]\nstep_mm = 2", 1)


@pytest.mark.parametrize(("changes", "message"), [
    ({"depths": [9e-3]}, "deep|depth"),
    ({"depths": [1e-3, 0.5e-3]}, "depths must be finite and rising"),
    ({"x": [np.nan]}, "x must be finite"),
    ({"imperfections": Imperfections(thickness_errors={"foam": 1e-3})}, "foam.*base, magnetic"),
    ({"imperfections": Imperfections(tilt=(0.1, 0.0))}, "no contact"),
    ({"design": parse_design(OUTSIDE), "x": [-19e-3]}, "outside the sample"),
    ({"design": replace(PAPER, indentation=None)}, r"no \[indenter\]"),
])  # fmt: skip
def test_bad_input_of_the_response(changes, message):
    with pytest.raises(ElastomerError, match=message):
        nominal(**changes)


LONG, WIDE = 2.0, 20e-3
CORNERS = [(1, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)]
LOOP = Conductor([[x * WIDE / 2, y * LONG / 2, 0] for x, y in CORNERS], 1e-3, 35e-6)
SHEETS = (Sheet("base", 6e-3), Sheet("magnetic", 2e-3, 2.7))
WIRES = cross_section(LOOP, 0.0)


def test_wires_are_a_long_loop():
    # the ends of the loop add of the order of their width to its length
    assert line_inductance(WIRES, ()) * LONG == pytest.approx(inductance_matrix(LOOP)[0, 0], rel=0.02)
    by_sheet = line_inductance(WIRES, SHEETS) - line_inductance(WIRES, ())
    assert by_sheet * LONG == pytest.approx(layer_inductance(LOOP, SHEETS)[0, 0], rel=0.02)


def test_a_wide_groove_is_another_flat_sheet():
    r = np.concatenate((np.linspace(0, 100e-3, 101), np.linspace(105e-3, 200e-3, 20)))
    fade = np.where(r <= 100e-3, 1.0, np.cos(np.pi / 2 * (r - 100e-3) / 100e-3) ** 2)
    lift = np.column_stack((0 * r, -0.4e-3 * fade, 0.2e-3 * fade))
    change = line_dent_inductance(WIRES, [Dent((6e-3, 2e-3), (1.0, 2.7), r, lift, "plane")], [0.0])[0, 0]
    moved = (Sheet("base", 5.6e-3), Sheet("magnetic", 2.6e-3, 2.7))
    # 3e-3: the field has fallen by (10/100)² where the sheet comes back, and it counts as its square there
    assert change == pytest.approx(line_inductance(WIRES, moved) - line_inductance(WIRES, SHEETS), rel=3e-3)


def test_the_two_dimensional_model_is_symmetric_and_too_strong():
    with contacts_of(DEFAULT_MESH):
        flat = line_response(FEM, depths=[1e-3], x=[-8e-3, 0.0, 8e-3])
        full = response_map(FEM, depths=[1e-3], x=[0.0], y=[0.0], imperfections=IDEAL)
    assert flat.delta.dims == full.delta.dims
    assert (flat.base_inductance.attrs["units"], flat.force.attrs["units"]) == ("H/m", "N/m")
    assert flat.inductance.values == [flat.base_inductance.values]
    left, middle, right = flat.delta.values[0, 0, :, 0]
    assert left == pytest.approx(right, rel=0.02)  # the two sides of the winding differ by part of a turn
    # a groove along the whole coil in place of a dent: a factor of two to three
    assert middle / float(full.delta[0, 0, 0, 0]) == pytest.approx(2.29, abs=0.03)  # as the README says


DENT = Dent((6e-3, 2e-3), (1.0, 2.7), np.array([0.0, 1e-3]), np.zeros((2, 3)))


def pressed_by(indenter):
    return replace(FEM, indentation=replace(FEM.indentation, indenter=indenter))


@pytest.mark.parametrize(("call", "message"), [
    (lambda: Imperfections(depth_error=np.nan), "finite"),
    (lambda: Imperfections(noise=-1), "noise must not be negative; got -1"),
    (lambda: Imperfections(seed=-1), "seed must not be negative; got -1"),
    (lambda: Imperfections(tilt=(0.5, 0.0)), r"tilt must be at most 0.1.*0.5"),
    (lambda: line_response(FEM, "coil9"), "no coil 'coil9'"),
    (lambda: line_response(replace(FEM, indentation=None)), r"no \[indenter\]"),
    (lambda: line_response(pressed_by(FlatPunch(2e-3))), "round indenter"),
    (lambda: line_response(pressed_by(Cone(0.5, radius=2e-3))), "round indenter"),
    (lambda: cross_section(LOOP, 10.0), "as often to as fro"),
    (lambda: line_dent_inductance(WIRES, [DENT], [0.0]), "plane strain"),
    (lambda: line_dent_inductance(WIRES, [replace(DENT, symmetry="plane")], [np.inf]), "finite"),
    (lambda: line_inductance(replace(WIRES, z=WIRES.z + 1e-3), SHEETS), "below the sheets"),
    (lambda: line_inductance(replace(WIRES, widths=0 * WIRES.widths), SHEETS), "cross-sections"),
])  # fmt: skip
def test_bad_imperfections_and_input_of_the_two_dimensional_model(call, message):
    with pytest.raises(ElastomerError, match=message):
        call()
