"""The response to an indentation beside plates.

Who checks whom: the dent over layers of tests/elastomer/test_dent_over_layers.py in the resonance of one coil, written
down by hand; weak sheets over a perfect conductor, which have mirror images, for a finite sample; limits; a map put
through the circuit again.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from support.contacts import IDEAL, MESH, QUICK, first_coils_design
from support.refusals import refused

from coilarray import Design
from coilarray.circuit.board_circuit import board_circuit
from coilarray.circuit.coupling import design_circuit
from coilarray.circuit.network import changed_resonances, resonate
from coilarray.elastomer.dented_layer import dent_inductance
from coilarray.electromagnetics.flat_stack import Backing, Layer
from coilarray.errors import ElastomerError, MetalError
from coilarray.geometry import MATERIALS, Disc, FinitePlate, Material, Plate, Ring
from coilarray.metal import finite_plates, plate_mesh
from coilarray.paper.two_dimensional import line_response
from coilarray.response.map import inductance_changes, respond, response_map
from coilarray.response.setup import experiment, map_axes, wedge_inductance

PAIR = first_coils_design(2)
X = [-13.28e-3, 2e-3]
BACK = Plate("backplane", -4e-3, 1e-3, MATERIALS["steel"])


def beside(*plates: Plate | FinitePlate, design: Design = PAIR) -> Design:
    return replace(design, plates=plates)


def mapped(design: Design, **changes: Any) -> xr.Dataset:
    return response_map(design, **{"x": X, "y": [0.0], "imperfections": IDEAL, "accuracy": QUICK, **changes})


@pytest.fixture
def _coarse_plates(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mesh outlined plates coarsely, and take currents from such a mesh alone."""
    monkeypatch.setattr(finite_plates, "_ALONE", 1.0)
    for name, value in {"_MOST_BELOW": 100, "_OF_DISTANCE": 1.6, "_NEAR_COILS": 0.7}.items():
        monkeypatch.setattr(plate_mesh, name, value)


@pytest.fixture(scope="module")
def over_steel() -> xr.Dataset:
    return mapped(beside(BACK))


@pytest.fixture(scope="module")
def alone() -> xr.Dataset:
    return mapped(PAIR)


def test_one_coil_answers_with_its_change_of_inductance_and_loss() -> None:
    design = beside(BACK, design=first_coils_design(1))
    found = mapped(design, x=[0.0])
    pressed = experiment(design.indentation, design.sheets, map_axes(design, x=[0.0], y=[0.0]))
    backing = Backing(-3e-3, (Layer(1e-3, BACK.material.relative_permeability, BACK.material.conductivity),),
                      found.attrs["plate_frequency_Hz"])  # fmt: skip
    (level,) = pressed.levels
    change = dent_inductance(design.array, level.dents, pressed.points, MESH, backing=backing)[0, 0, 0, 0]
    assert float(found.inductance_change.squeeze()) == pytest.approx(change.real, rel=1e-9)
    loss = float(found.resistance_change.squeeze())
    assert loss == pytest.approx(-2 * np.pi * backing.frequency * change.imag, rel=1e-9)
    network = design_circuit(design, ideal=True)
    dented = replace(
        network,
        inductance=network.inductance + change.real,
        resistance=lambda f: network.resistance(f) + loss * np.asarray(f)[..., None, None] / backing.frequency,
    )
    flat, pressed_in = (resonate(one, design.plan[0]).frequency for one in (network, dented))
    # 1e-8: digits of both resonances
    assert float(found.delta.squeeze()) == pytest.approx((flat / pressed_in) ** 2 - 1, rel=1e-8)


@pytest.mark.slow
def test_iron_raises_the_response_and_a_screen_lowers_it(over_steel: xr.Dataset, alone: xr.Dataset) -> None:
    screened = mapped(beside(replace(BACK, material=MATERIALS["aluminium"])))
    iron = mapped(beside(replace(BACK, material=MATERIALS["ferrite"])))
    at_coil = {"depth": 0, "y": 0, "x": 0, "state": 0}
    values = [float(one.delta.isel(at_coil)) for one in (screened, alone, iron)]
    assert values[0] < 0.7 * values[1] < values[1] < values[2]
    assert values[0] < float(over_steel.delta.isel(at_coil)) < values[2]
    assert float(np.abs(iron.resistance_change).max()) < 1e-3 * float(np.abs(over_steel.resistance_change).max())


@pytest.mark.slow
def test_a_plate_of_nothing_and_a_far_one_leave_the_map(alone: xr.Dataset) -> None:
    for plate, error in (
        (replace(BACK, material=Material("nothing", 1e-9)), 1e-10),  # digits of the resonance
        (replace(BACK, z=-1.0), 1e-5),  # the cube of the coil's size over the distance
    ):
        found = mapped(beside(plate)).delta
        assert float(np.abs(found - alone.delta).max()) < error * float(np.abs(alone.delta).max())


def test_the_map_goes_through_the_circuit_again(over_steel: xr.Dataset) -> None:
    again = respond(beside(BACK), over_steel, ideal=True)
    xr.testing.assert_allclose(again.delta, over_steel.delta, rtol=1e-10)
    lossless = respond(
        beside(BACK), over_steel.assign(plate_resistance_change=0 * over_steel.plate_resistance_change), ideal=True
    )
    assert float(np.abs(lossless.delta - over_steel.delta).max()) > 1e-8  # the loss counts


@pytest.mark.slow
def test_changes_alone_are_those_of_the_map() -> None:
    axes = map_axes(beside(BACK), x=X, y=[0.0])
    found = response_map(beside(BACK), x=X, y=[0.0])  # with strays and the default mesh, as `inductance_changes`
    np.testing.assert_allclose(inductance_changes(beside(BACK), axes), found.inductance_change, rtol=1e-9)


@pytest.mark.slow
def test_a_tilted_sample_changes_what_plates_see_of_it() -> None:
    tilt = (0.01, 0.0)
    with_plate, without, far = (
        wedge_inductance(board_circuit(one), one.indentation.origin_point, tilt)
        for one in (beside(BACK), PAIR, beside(replace(BACK, z=-1.0)))
    )
    np.testing.assert_allclose(far, without, rtol=1e-3)
    assert np.abs(with_plate - without).max() > 0.1 * np.abs(without).max()


@pytest.mark.slow
@pytest.mark.usefixtures("_coarse_plates")
def test_a_wide_outline_is_an_infinite_plate() -> None:
    """In the map and in the flat inductance, but for the rim and for the dent's own field."""
    aluminium = MATERIALS["aluminium"]
    one = first_coils_design(1)
    wide = FinitePlate("backplane", Disc(19e-3), (*one.array.centres[0], -3.5e-3), 1e-3, aluminium)
    infinite = Plate("backplane", -4e-3, 1e-3, aluminium)
    assert one.indentation is not None
    tipped = replace(one, indentation=replace(one.indentation, material=MATERIALS["ferrite"]))
    found, expected = (mapped(replace(tipped, plates=(plate,)), x=[0.0]) for plate in (wide, infinite))
    # 7 mm of metal around the coil, and 1 % by the dent
    np.testing.assert_allclose(found.inductance, expected.inductance, rtol=5e-3)
    largest = float(np.abs(expected.delta).max())
    assert float(np.abs(found.delta - expected.delta).max()) < 2e-2 * largest
    # the share of the tip, and that of the tip at rest, which counts too
    np.testing.assert_allclose(found.metal_delta, expected.metal_delta, rtol=3e-2)


def test_every_state_has_the_change_at_its_own_frequency(over_steel: xr.Dataset) -> None:
    """Over steel δ at the frequency of the lower coil is 0.5 % off for the upper one, whose own is 4 % higher."""
    design = beside(BACK)
    network = design_circuit(design, ideal=True)
    states = [resonate(network, state) for state in design.plan]
    pressed = experiment(design.indentation, design.sheets, map_axes(design, x=X, y=[0.0]))
    (level,) = pressed.levels
    layers = (Layer(1e-3, BACK.material.relative_permeability, BACK.material.conductivity),)
    deltas = np.empty((2, 2, len(X)))
    for k, f in enumerate(state.frequency for state in states):
        backing = Backing(-3e-3, layers, f)
        (change,) = dent_inductance(design.array, level.dents, pressed.points, MESH, backing=backing)
        for m, state in enumerate(states):
            dented, _, _ = changed_resonances(network, state, network.inductance + change)
            deltas[k, m] = (state.frequency / dented) ** 2 - 1
    found = over_steel.delta.values[0, 0].T
    largest = np.abs(found).max()
    assert np.abs(deltas[[0, 1], [0, 1]] - found).max() < 1e-4 * largest  # the interpolation over frequency
    assert np.abs(deltas[[1, 0], [0, 1]] - found).max() > 1e-3 * largest


@pytest.mark.slow
@pytest.mark.usefixtures("_coarse_plates")
def test_a_finite_sample_over_a_plate_of_nothing_is_one_in_air(over_steel: xr.Dataset, alone: xr.Dataset) -> None:
    assert PAIR.indentation is not None
    finite = replace(PAIR, indentation=replace(PAIR.indentation, sample_bounds=(-24e-3, -16e-3, 24e-3, 16e-3)))
    nothing, none = replace(BACK, material=Material("nothing", 1e-9)), mapped(finite)
    found = mapped(beside(nothing, design=finite))
    np.testing.assert_allclose(found.inductance_change, none.inductance_change, rtol=1e-8)
    over = mapped(beside(BACK, design=finite))
    # the near sides raise the change by some per cent, over steel as without
    raised = [float((one / other).isel(depth=0, y=0, x=0, coil=0, other=0)) for one, other in (
        (over.inductance_change, over_steel.inductance_change), (none.inductance_change, alone.inductance_change)
    )]  # fmt: skip
    assert raised[0] - 1 == pytest.approx(raised[1] - 1, rel=0.3)


def test_refusals() -> None:
    steel = FinitePlate("coin", Ring(9e-3, 3e-3), (0.0, 0.0, -5e-3), 1e-3, MATERIALS["steel"])
    refused(MetalError, "must not have holes; 'coin' has", mapped, beside(steel))
    lid = Plate("lid", 20e-3, 1e-3, MATERIALS["copper"])
    refused(MetalError, "plate.1 'lid' lies above them", mapped, beside(BACK, lid))
    refused(ElastomerError, "needs every coil: use accuracy=None", mapped, beside(BACK), accuracy=1e-3)
    refused(MetalError, "the two-dimensional model does not include plates", line_response, beside(BACK))
