"""One design has one circuit: every place that shows what the converter sees of a coil shows the same number.

Who is compared: the coupling, the scan of `impedance`, the tables of the report, the base of the response, the studio,
the state sensitivity, and the emulated board behind the converter.
"""

import numpy as np
import pytest
from support.contacts import IDEAL

from coilarray import couple_design, load_design, response_map
from coilarray.circuit.coupling import design_circuit, scan_design, sweep_design
from coilarray.circuit.network import resonate
from coilarray.circuit.state_sensitivity import state_sensitivity
from coilarray.hardware.emulator.board import LIFTED
from coilarray.hardware.emulator.sensor_world import SensorWorld
from coilarray.hardware.scan.settings import board_network
from coilarray.report.tables import coil_table, state_table
from coilarray.viz.studio.numbers import circuit_of, state_of

pytestmark = pytest.mark.slow


def test_every_place_shows_the_same_coil(tmp_path):
    design = load_design("gast2020")
    coupling = couple_design(design)
    f, L = float(coupling.frequency[0]), float(coupling.effective_inductance[0])
    assert pytest.approx(1 / ((2 * np.pi * f) ** 2 * design.circuit.capacitance), rel=1e-14) == L
    first = coil_table(design, coupling).records()[0]
    state = state_table(scan_design(design, elastomer=False)).records()[0]
    settings = {name: "measure" if name == "coil1" else "ground" for name in design.array.names}
    by_hand = resonate(circuit_of(design).network, state_of(settings))
    board = SensorWorld(board_network(design), lambda: None)
    emulated = board.resonator(design.plan[0], LIFTED, 25.0).frequency
    base = response_map(design, x=[0.0], y=[0.0]).base_inductance
    linear = state_sensitivity(design_circuit(design), design.plan).base_inductance
    for frequency in (first["frequency_Hz"], state["frequency_Hz"], by_hand.frequency, emulated):
        assert frequency == pytest.approx(f, rel=1e-9)
    inductances = (first["effective_inductance_H"], state["effective_inductance_H"], by_hand.effective_inductance)
    for inductance in (*inductances, float(base[0]), float(linear[0])):
        assert inductance == pytest.approx(L, rel=1e-9)
    # what leaves something out says so, everywhere the same too
    ideal = response_map(design, x=[0.0], y=[0.0], imperfections=IDEAL).base_inductance
    assert first["ideal_effective_inductance_H"] == pytest.approx(float(ideal[0]), rel=1e-9)
    assert abs(L / float(ideal[0]) - 1) > 0.1


@pytest.mark.parametrize("name", ["starter", "gast_fem"])
def test_each_coil_has_one_resonance_and_one_quality_factor(name):
    """Of three coils and of a single one: the table of coils, that of states, and the impedance over frequency."""
    design = load_design(name)
    coupling, scan = couple_design(design), scan_design(design, elastomer=False)
    for quantity in ("frequency", "effective_inductance", "effective_resistance", "quality_factor"):
        np.testing.assert_allclose(coupling[quantity], scan[quantity], rtol=1e-9)
    f, coil = float(coupling.frequency[0]), design.array.names[0]
    swept = sweep_design(design, f).sel(state=coil).isel(frequency=0)
    # R at this frequency itself, and between nine; with the tank the quality factor has a name of its own
    assert float(swept.quality_factor) == pytest.approx(float(coupling.quality_factor[0]), rel=2e-4)
    assert abs(float(scan.loaded_quality_factor[0] / scan.quality_factor[0]) - 1) > 1e-3
