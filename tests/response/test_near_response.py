"""Response maps of the coils near the indenter alone.

Who checks whom: δ of near coils against δ of all, which solves every coil at every position and the whole circuit;
a board of 64 coils against the changes of all of them at some positions; a map from tables against one without.
"""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from support.active_coil import active_coil
from support.contacts import IDEAL, MESH, QUICK, coarse_maps
from support.first_assumed import hexagonal

import coilarray.response.map as map_module
import coilarray.response.near as near_module
from coilarray import load_design
from coilarray.circuit.board_circuit import bare_network
from coilarray.circuit.coupling import design_circuit, design_inductance
from coilarray.circuit.state_sensitivity import state_sensitivity
from coilarray.design.bundled import read
from coilarray.design.model import parse_design
from coilarray.design.scan_states import ScanState
from coilarray.elastomer.dent import dent_of
from coilarray.elastomer.dented_layer import dent_inductance
from coilarray.electromagnetics.resistance import dc_resistance
from coilarray.errors import ElastomerError, MemoryLimitError, NetworkError
from coilarray.response.map import Imperfections, MapAccuracy, respond, response_map
from coilarray.response.setup import contact_at

pytestmark = pytest.mark.slow

PAPER = load_design("gast2020")
ROW = {"x": np.linspace(-26e-3, 26e-3, 9), "y": np.linspace(-6e-3, 6e-3, 3)}
LATTICE = {"x": np.linspace(-7e-3, 7e-3, 5), "y": np.linspace(-7e-3, 7e-3, 5)}
FIELD = hexagonal(4, 4)


def quick(matrix, reach=None):
    """Known inductances in the ideal circuit, so that only what depends on the dent is computed, on a coarse mesh."""
    R = dc_resistance(PAPER.array.conductors(), PAPER.circuit.resistivity)
    names = matrix.coil.values.tolist()
    network = bare_network(names, matrix.inductance.values, np.resize(R, len(names)), PAPER.circuit.switches)
    return {"imperfections": Imperfections(network=network), "accuracy": MapAccuracy(reach, MESH)}


def largest(a, b):
    """Largest difference of two maps in parts of the peak of the second."""
    return float(np.abs(a.delta.values - b.delta.values).max() / np.abs(b.delta.values).max())


@pytest.fixture(scope="module")
def row():
    return response_map(PAPER, depths=[0.0, 0.5e-3, 1e-3], accuracy=QUICK, imperfections=IDEAL, **ROW)


@pytest.fixture(scope="module")
def field():
    return response_map(FIELD, accuracy=QUICK, imperfections=IDEAL, **LATTICE)


@pytest.mark.parametrize("error", [1e-2, 1e-3])
def test_a_row_answers_as_when_all_is_solved(row, error):
    seen = []
    given = {"depths": [0.0, 0.5e-3, 1e-3], **ROW, **quick(row, error)}
    near = response_map(PAPER, progress=lambda *counted: seen.append(counted), **given)
    assert seen[-1] == (2, 2)  # one step for each depth above 0
    assert largest(near, row) < error
    for depth in (1, 2):  # each depth by its own peak, for the cut-off is that of the deepest
        assert largest(near.isel(depth=depth), row.isel(depth=depth)) < 1.5 * error
    assert (near.delta.values[0] == 0).all()  # nothing is moved
    # both resonances are found to 1e-12
    assert near.base_inductance.values == pytest.approx(row.base_inductance.values, rel=1e-11)
    # one dataset type: all but the changes of every coil, and what was left out
    assert set(row.variables) - set(near.variables) == {"inductance_change"}
    for name in set(row.variables) & set(near.variables):
        assert (near[name].dims, near[name].attrs) == (row[name].dims, row[name].attrs)
        if name == "common_noise":  # Q is that of each coil's own resistance where only near coils count: 4 % here
            np.testing.assert_allclose(near[name], row[name], rtol=0.05)
        elif name not in ("delta", "base_inductance"):
            xr.testing.assert_identical(near[name].variable, row[name].variable)
    assert set(near.attrs) - set(row.attrs) == {"state_cutoff_m", "coil_cutoff_m"}
    assert (near.attrs["error_of_peak"], row.attrs["error_of_peak"]) == (error, 0.0)
    with pytest.raises(ElastomerError, match="only the near coils has no inductance changes"):
        respond(PAPER, near)


@pytest.mark.parametrize("error", [1e-2, 1e-3])
def test_a_lattice_answers_as_when_all_is_solved(field, error):
    near = response_map(FIELD, **LATTICE, **quick(field, error))
    assert largest(near, field) < error
    assert (near.delta.values != 0).all(axis=-1).any() == (error == 1e-3)  # somewhere every state is near


def test_imperfections_count_with_near_coils_too():
    given = Imperfections(
        tilt=(0.01, 0.0), offset=(1e-3, -0.5e-3), depth_error=0.1e-3, thickness_errors={"base": 0.2e-3},
        noise=1e-5, seed=3,
    )  # fmt: skip
    places = {"depths": [0.2e-3], "x": [-11e-3, 2e-3], "y": [0.0], "imperfections": given}
    with coarse_maps():
        near, full = (
            response_map(load_design("starter"), accuracy=MapAccuracy(reach, MESH), **places) for reach in (1e-3, None)
        )
    # the same noise in both
    assert largest(near, full) < 1e-3
    assert near.inductance.values == pytest.approx(full.inductance.values, rel=1e-12)


def test_the_automatic_choice_goes_by_the_size_of_the_map(row, monkeypatch):
    def error(reach):
        return response_map(PAPER, x=[0.0], y=[0.0], **quick(row, reach)).attrs["error_of_peak"]

    assert error("auto") == 0
    monkeypatch.setattr(map_module, "_AUTO_VALUES", 35)  # below the 36 pairs of coils
    assert error("auto") == 1e-3
    assert error(None) == 0


def test_to_be_linear_leaves_out_little(row):
    network = replace(design_circuit(PAPER, ideal=True), inductance=row.inductance.values)
    states = state_sensitivity(network, PAPER.plan)
    # second order in ΔL/L, for the part of ΔL that neighbours pass on, k of it; measured 0.4 of that, 4.5e-5
    L = row.inductance.values
    allowed = abs(L[0, 1]) / np.sqrt(L[0, 0] * L[1, 1]) * float(row.delta.max())
    assert largest(row.assign(delta=(row.delta.dims, states.delta(row.inductance_change.values))), row) < allowed


def test_states_beyond_the_cut_off_are_zero(field):
    near = response_map(FIELD, **LATTICE, **quick(field, 0.05))
    x, y = np.meshgrid(near.x, near.y)
    distance = np.hypot(x[..., None] - near.coil_x.values, y[..., None] - near.coil_y.values)
    cutoff, delta = near.attrs["state_cutoff_m"], near.delta.values[0]
    # a coil's leads put the middle of its rectangle a millimetre off its centre
    assert (delta[distance > cutoff + 2e-3] == 0).all()
    assert (delta[distance < cutoff - 2e-3] != 0).all()
    assert (delta == 0).any()


def test_large_boards_answer_as_all_their_coils_together():
    """Currents of 64 coils and all inductance changes, in place of a whole map."""
    design = hexagonal(8, 8, turns=5)
    setup = design.indentation
    L, R = design_inductance(design)[0], dc_resistance(design.array.conductors(), design.circuit.resistivity)
    contact = contact_at(setup, design.sheets, np.array([1e-3]))
    x, y = design.array.centres[27, 0] + [0.0, 5e-3], design.array.centres[27, 1]
    dent = dent_of(contact.isel(depth=0), design.sheets)
    change = dent_inductance(design.array, [dent], np.column_stack((x, [y, y])), MESH)[0]
    states = state_sensitivity(design_circuit(design, ideal=True), design.plan)
    full = states.delta(change)
    network = replace(design_circuit(design, ideal=True), inductance=L)
    local = response_map(
        design, x=x, y=[y], imperfections=Imperfections(network=network), accuracy=MapAccuracy(1e-3, MESH)
    )
    assert np.abs(local.delta.values[0, 0] - full).max() < 1e-3 * np.abs(full).max()
    # the same currents as of another solution, with the effective inductance in place of the resonance: losses are 2e-3
    middle = int(np.argmax(full[0]))
    frequency = 1 / (2 * np.pi * np.sqrt(states.base_inductance[middle] * design.circuit.capacitance))
    one = active_coil(L, R, int(states.measured[middle]), frequency, short_resistance=design.circuit.short_resistance)
    i = one.currents
    assert full[0, middle] == pytest.approx((i @ change[0] @ i).real / one.apparent_inductance, rel=5e-3)


def test_tables_give_what_single_offsets_give(row, monkeypatch):
    few = response_map(PAPER, x=[-26e-3, 0.0, 26e-3], y=[-6e-3, 0.0], **quick(row, 0.02))
    tables, whole = [], near_module.amplitude_table
    monkeypatch.setattr(near_module, "amplitude_table", lambda *a: tables.append(a) or whole(*a))
    x, y = np.linspace(-26e-3, 26e-3, 105), np.linspace(-6e-3, 6e-3, 13)
    many = response_map(PAPER, x=x, y=y, **quick(row, 0.02))
    assert tables
    # amplitudes are left out to 0.3 of the error, of other ones in each
    assert largest(many.sel(x=few.x, y=few.y, method="nearest"), few) < 0.02 * 0.3


def test_open_neighbours_carry_nothing(row):
    opened = parse_design(read("gast2020").replace('default_termination = "short" ', 'default_termination = "open" '))
    places = {"x": [-13.28e-3, -6e-3, 2e-3], "y": [0.0]}
    local = response_map(opened, **places, **quick(row, 1e-3))
    assert largest(local, response_map(opened, accuracy=QUICK, imperfections=IDEAL, **places)) < 1e-3


@pytest.mark.parametrize("reach", [1e-5, np.nan, 0.5, "all"])
def test_bad_errors(reach):
    with pytest.raises(ElastomerError, match='accuracy must be None, "auto" or the error of δ, '):
        response_map(PAPER, accuracy=reach)


def test_designs_that_cannot_be_treated(row, monkeypatch):
    both = replace(PAPER, circuit=replace(PAPER.circuit, scan=(ScanState("pair", (("coil1", 1), ("coil2", 1))),)))
    few = {"x": [0.0], "y": [0.0]}
    with pytest.raises(NetworkError, match="state pair must measure one coil"):
        response_map(both, **few, **quick(row, 1e-3))
    monkeypatch.setattr(map_module, "_AUTO_VALUES", 0)
    assert response_map(both, **few, **quick(row, "auto")).attrs["error_of_peak"] == 0.0  # every coil in its place


def test_memory_is_checked_before_it_is_taken(row, monkeypatch):
    monkeypatch.setenv("COILARRAY_MEMORY_GB", "0.05")
    across = {"x": np.linspace(-26e-3, 26e-3, 10000), "y": np.linspace(-6e-3, 6e-3, 110)}
    with pytest.raises(MemoryLimitError, match=r"a map of 1 depths at 1100000 positions with 6 coils needs about"):
        response_map(PAPER, **across, **quick(row, 1e-3))
    across["y"] = across["y"][:100]
    with pytest.raises(MemoryLimitError, match=r"the response at 1000000 positions needs about .* GB"):
        response_map(PAPER, **across, **quick(row, 1e-3))
