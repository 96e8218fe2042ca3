"""The response of large arrays.

Who checks whom: δ within reach against `response_map`, which solves every coil at every position and the whole circuit;
a board of 64 coils against the changes of all of them at some positions; a map from tables against one without.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from support.lattices import hexagonal

import coilarray.response.local as local_module
from coilarray import load_design
from coilarray.circuit.active_coil import every_active_coil
from coilarray.circuit.coupling import design_inductance
from coilarray.circuit.state_sensitivity import state_sensitivity
from coilarray.compute.memory import MemoryLimitError
from coilarray.design.bundled import read
from coilarray.design.model import parse_design
from coilarray.design.scan_states import ScanState
from coilarray.elastomer.contact import indent
from coilarray.elastomer.dent import dent_of
from coilarray.elastomer.dented_layer import dent_inductance
from coilarray.elastomer.scattering import LayerMesh
from coilarray.electromagnetics.resistance import dc_resistance
from coilarray.errors import ElastomerError, NetworkError
from coilarray.response.local import dense_response, local_response
from coilarray.response.map import response_map

PAPER = load_design("gast2020")
ROW = {"x": np.linspace(-26e-3, 26e-3, 9), "y": np.linspace(-6e-3, 6e-3, 3)}
LATTICE = {"x": np.linspace(-7e-3, 7e-3, 5), "y": np.linspace(-7e-3, 7e-3, 5)}


MESH = LayerMesh(harmonics=6, width=0.5, rows=3)  # coarse, and the same for both


def quick(matrix):
    """Known inductances, so that only what depends on the dent is computed, on a coarse mesh."""
    return {"inductance": lambda: matrix.inductance.values, "mesh": MESH}


def largest(a, b):
    """Largest difference of two maps in parts of the peak of the second."""
    return float(np.abs(a.delta.values - b.delta.values).max() / np.abs(b.delta.values).max())


@pytest.fixture(scope="module")
def row():
    return response_map(PAPER, depths=[0.0, 0.5e-3, 1e-3], mesh=MESH, **ROW)


@pytest.fixture(scope="module")
def field():
    return response_map(hexagonal(4, 4), mesh=MESH, **LATTICE)


@pytest.fixture(scope="module")
def one(row):
    told = []
    local = local_response(PAPER, x=[0.0], y=[0.0], progress=lambda *done: told.append(done), **quick(row))
    assert told[-1] == (1, 1)
    return local


@pytest.mark.parametrize("error", [1e-2, 1e-3])
def test_a_row_answers_as_when_all_is_solved(row, error):
    local = local_response(PAPER, depths=[0.0, 0.5e-3, 1e-3], error=error, **ROW, **quick(row))
    dense = dense_response(local)
    assert dense.delta.dims == row.delta.dims
    assert largest(dense, row) < error
    for depth in (1, 2):  # each depth by its own peak, for the reach is that of the deepest
        assert largest(dense.isel(depth=depth), row.isel(depth=depth)) < 1.5 * error
    assert (dense.delta.values[0] == 0).all()  # nothing is moved
    # both resonances are found to 1e-12
    assert local.base_inductance.values == pytest.approx(row.base_inductance.values, rel=1e-11)
    assert local.force.values == pytest.approx(row.force.values, rel=1e-12)


@pytest.mark.parametrize("error", [1e-2, 1e-3])
def test_a_lattice_answers_as_when_all_is_solved(field, error):
    local = local_response(hexagonal(4, 4), error=error, **LATTICE, **quick(field))
    assert largest(dense_response(local), field) < error
    assert (local.sizes["near"] < 16) == (error > 1e-3)


def test_to_be_linear_leaves_out_little(row):
    R = dc_resistance(PAPER.array.conductors(), PAPER.circuit.resistivity)
    circuit = PAPER.circuit
    states = state_sensitivity(PAPER.array.names, row.inductance.values, R, circuit.switches, PAPER.plan)
    linear = row.assign(delta=(row.delta.dims, states.delta(row.inductance_change.values)))
    # second order in ΔL/L of 8e-4, for a part of ΔL that neighbours pass on; measured 1.4e-5
    assert largest(linear, row) < 3e-5


def test_what_is_not_near_is_zero_and_near_states_are_the_nearest(field):
    design = hexagonal(4, 4)
    local = local_response(design, error=0.05, **LATTICE, **quick(field))
    dense = dense_response(local)
    x, y = np.meshgrid(local.x, local.y)
    centres = np.column_stack((local.coil_x, local.coil_y))
    distance = np.hypot(x[..., None] - centres[:, 0], y[..., None] - centres[:, 1])
    # a coil's leads put the middle of its rectangle a millimetre off its centre
    assert (dense.delta.values[0][distance > local.attrs["state_reach_m"] + 2e-3] == 0).all()
    assert (dense.delta.values[0][distance < local.attrs["state_reach_m"] - 2e-3] != 0).all()
    none = local.near_state.values < 0
    assert none.any()
    assert (local.delta.values[0][none] == 0).all()


def test_large_boards_answer_as_all_their_coils_together():
    """Currents of 64 coils and all inductance changes, in place of a whole map."""
    design = hexagonal(8, 8, turns=10)
    setup = design.indentation
    L, R = design_inductance(design)[0], dc_resistance(design.array.conductors(), design.circuit.resistivity)
    contact = indent(design.sheets, setup.indenter, [1e-3], base=setup.base)
    x = design.array.centres[27, 0] + [0.0, 5e-3]
    y = design.array.centres[27, 1]
    dent = dent_of(contact.isel(depth=0), design.sheets)
    change = dent_inductance(design.array, [dent], np.column_stack((x, [y, y])), MESH)[0]
    states = state_sensitivity(design.array.names, L, R, design.circuit.switches, design.plan)
    full = states.delta(change)
    local = dense_response(local_response(design, x=x, y=[y], inductance=lambda: L, mesh=MESH))
    assert np.abs(local.delta.values[0, 0] - full).max() < 1e-3 * np.abs(full).max()
    # the same currents as of another solution, with the effective inductance in place of the resonance: losses are 2e-3
    middle = int(np.argmax(full[0]))
    frequency = 1 / (2 * np.pi * np.sqrt(states.base_inductance[middle] * design.circuit.capacitance))
    every = every_active_coil(L, R, frequency, design.circuit.short_resistance)
    i = every.currents[:, middle]
    plain = (i @ change[0] @ i).real / every.effective_inductance[middle]
    assert full[0, middle] == pytest.approx(plain, rel=5e-3)


def test_tables_give_what_single_offsets_give(row, monkeypatch):
    few = local_response(PAPER, error=0.02, x=[-26e-3, 0.0, 26e-3], y=[-6e-3, 0.0], **quick(row))
    tables = []
    whole = local_module.amplitude_table
    monkeypatch.setattr(local_module, "amplitude_table", lambda *a: tables.append(a) or whole(*a))
    x, y = np.linspace(-26e-3, 26e-3, 131), np.linspace(-6e-3, 6e-3, 17)
    many = local_response(PAPER, error=0.02, x=x, y=y, **quick(row))
    assert tables
    picked = dense_response(many).sel(x=few.x, y=few.y, method="nearest")
    # amplitudes are left out to 0.3 of the error, of other ones in each
    assert largest(picked, dense_response(few)) < 0.02 * 0.3


def test_open_neighbours_carry_nothing(row):
    text = read("gast2020").replace('default_termination = "short" ', 'default_termination = "open" ')
    opened = parse_design(text)
    places = {"x": [-13.28e-3, -6e-3, 2e-3], "y": [0.0]}
    local = dense_response(local_response(opened, **places, **quick(row)))
    assert largest(local, response_map(opened, mesh=MESH, **places)) < 1e-3


def test_maps_can_be_stored(one, tmp_path):
    one.to_netcdf(tmp_path / "local.nc", engine="h5netcdf")
    with xr.open_dataset(tmp_path / "local.nc", engine="h5netcdf") as stored:
        assert dense_response(stored.load()).delta.values.tolist() == dense_response(one).delta.values.tolist()
        assert all("units" in stored[name].attrs for name in (*stored.data_vars, "x", "y", "depth", "coil_x"))
        assert stored.attrs["design_hash"] == PAPER.digest


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"error": 1e-5}, "error must be 0.0001 to 0.1 of the peak; got 1e-05"),
        ({"error": np.nan}, "error must be"),
        ({"x": [1.0, 0.0]}, "x must be finite and rising"),
        ({"y": [2.0]}, "y must be at most 1.0 m"),
        ({"depths": [np.inf]}, "depths must be finite"),
    ],
)
def test_bad_input(changes, message):
    with pytest.raises(ElastomerError, match=message):
        local_response(PAPER, **changes)


def test_designs_that_cannot_be_treated(row):
    with pytest.raises(ElastomerError, match=r"no \[indenter\]"):
        local_response(replace(PAPER, indentation=None))
    text = read("gast2020").replace("step_mm = 2", "sample_x_mm = [-20, 20]\nsample_y_mm = [-8, 8]\nstep_mm = 2", 1)
    with pytest.raises(ElastomerError, match=r"at \(-19, 0\) mm the contact of .* mm radius is outside the sample"):
        local_response(parse_design(text), x=[-19e-3], y=[0.0])
    pair = ScanState("pair", (("coil1", 1), ("coil2", 1)))
    both = replace(PAPER, circuit=replace(PAPER.circuit, plan=(pair,)))
    with pytest.raises(NetworkError, match="state pair must measure one coil"):
        local_response(both, x=[0.0], y=[0.0], **quick(row))


def test_memory_is_checked_before_it_is_taken(row, one, monkeypatch):
    monkeypatch.setenv("COILARRAY_MEMORY_GB", "1e-9")
    with pytest.raises(MemoryLimitError, match=r"a map of 1 × 1 × 1 × 6 values needs about .* GB"):
        dense_response(one)
    monkeypatch.setenv("COILARRAY_MEMORY_GB", "0.05")
    with pytest.raises(MemoryLimitError, match=r"the response at 1000000 positions needs about .* GB"):
        local_response(PAPER, x=np.linspace(-26e-3, 26e-3, 10000), y=np.linspace(-6e-3, 6e-3, 100), **quick(row))
