"""Plates in the circuit: their inductance and resistance over frequency in every network, table and file.

Checked against each other: the network's impedance and `plate_inductance`; many coils together and one state by itself;
the emulated board's network and the design's; a Touchstone file and the network.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import coilarray as ca
from coilarray.circuit import board_circuit as making
from coilarray.circuit.board_circuit import Plates, Windings, board_circuit
from coilarray.circuit.coupling import design_circuit, design_inductance, scan_design
from coilarray.circuit.network import Network, resonate, self_resonance_of, solve_state
from coilarray.circuit.network_files import export_network
from coilarray.circuit.state_sensitivity import resonances
from coilarray.errors import MetalError
from coilarray.hardware.scan.settings import board_network
from coilarray.metal.flat_plates import plate_inductance
from coilarray.metal.frequencies import FrequencyBand

SHIELD = ca.Plate("shield", -4e-3, 0.1e-3, ca.MATERIALS["stainless_steel"])


@pytest.fixture(scope="module")
def bare() -> ca.Design:
    """The coils of the starter without sheets; every other one open, so that each is alone."""
    design = replace(ca.load_design("starter"), sheets=(), indentation=None)
    return replace(design, circuit=replace(design.circuit, default_termination="open", switches=ca.Switches(2.5)))


@pytest.fixture(scope="module")
def shielded(bare: ca.Design) -> ca.Design:
    """The same above a steel foil that is as transparent as it screens: its L and R change most with frequency."""
    return replace(bare, plates=(SHIELD,))


@pytest.mark.slow
def test_a_coil_alone_has_the_impedance_of_coil_and_plate(bare: ca.Design, shielded: ca.Design) -> None:
    f = np.array([0.3e6, 3e6, 30e6])
    added = 2j * np.pi * f[:, None, None] * plate_inductance(bare.array, [SHIELD], f)
    with_plate, without = (_windings_alone(board_circuit(design).swept(f)) for design in (shielded, bare))
    for state in bare.plan:
        k = bare.array.names.index(state.name)
        for one, frequency in zip(added, f.tolist(), strict=True):
            change = (
                solve_state(with_plate, state, frequency).impedance - solve_state(without, state, frequency).impedance
            )
            assert change == pytest.approx(one[k, k], rel=1e-4)  # interpolated to 1e-5 of the largest


def _windings_alone(network: Network) -> Network:
    """Without capacitance, so that open coils do not count."""
    none = np.zeros_like(network.mutual_capacitance)
    return replace(network, winding_capacitance=none[0], mutual_capacitance=none)


def test_tables_have_the_plates_at_the_working_frequency(bare: ca.Design, shielded: ca.Design) -> None:
    result, plates = ca.couple_design(shielded), board_circuit(shielded).plates
    assert plates is not None
    working = result.attrs["working_frequency_Hz"]
    assert working == pytest.approx(float(result.ideal_frequency.mean()), rel=1e-2)
    expected = plate_inductance(bare.array, [SHIELD], [working])[0]
    scale = np.abs(expected).max()
    np.testing.assert_allclose(result.plate_inductance, expected.real, atol=1e-5 * scale)
    np.testing.assert_allclose(result.plate_resistance, -2 * np.pi * working * expected.imag, rtol=1e-3)
    np.testing.assert_allclose(result.inductance - result.plate_inductance, design_inductance(bare)[0], rtol=1e-12)
    assert (result.quality_factor.values < 0.75 * ca.couple_design(bare).quality_factor.values).all()
    assert result.attrs["left_out"] == "change of the losses in the copper by the plates; capacitance of the plates"
    ideal = design_circuit(shielded, ideal=True).resistance(working)
    np.testing.assert_allclose(ideal, np.diag(result.resistance) + plates.resistance, rtol=1e-4, atol=1e-6)


def test_interpolation_over_frequency(shielded: ca.Design) -> None:
    effect = board_circuit(shielded).windings.plate_effect(shielded.plates, 1e5, 1e7)
    f = np.array([1.03e5, 9.37e5, 9.9e6])
    expected = plate_inductance(shielded.array, [SHIELD], f)
    np.testing.assert_allclose(effect.at(f), expected, rtol=0, atol=1e-5 * np.abs(expected).max())
    with pytest.raises(MetalError, match=r"known from 100000 to 1e\+07 Hz; got 50000 to 50000 Hz"):
        effect.at(np.array([5e4]))


@pytest.mark.parametrize("factor", [9.0, 0.1])
def test_plates_are_computed_where_the_coils_oscillate(
    shielded: ca.Design, monkeypatch: pytest.MonkeyPatch, factor: float
) -> None:
    """A formula stands in for plates that change every inductance by a factor, at other frequencies by less."""
    L = design_inductance(replace(shielded, plates=()))[0]

    def samples(frequencies: np.ndarray) -> np.ndarray:
        return (factor - 1) * L * np.exp(-0.01 * np.log(frequencies / 3e6) ** 2)[:, None, None] * (1 - 0.01j)

    def effect(self: Windings, plates: object, low: float, high: float) -> Plates:
        band = FrequencyBand(low, high)
        return Plates(band, samples(band.nodes), np.sqrt(low * high))

    monkeypatch.setattr(Windings, "plate_effect", effect)
    # another digest for each: what is kept in memory is of no other test
    design = replace(shielded, plates=(replace(SHIELD, thickness=factor * 1e-4),))
    plates, network = board_circuit(design).plates, design_circuit(design, ideal=True)
    assert plates is not None
    for one in resonances(network, design.plan):
        k = design.array.names.index(one.state.name)
        own = L[k, k] + samples(np.array([one.frequency]))[0, k, k].real
        assert one.effective_inductance == pytest.approx(own, rel=1e-3)  # losses of 1 %, and 13 nodes a decade
        assert plates.band.holds(np.array([one.frequency]))


def test_many_coils_together_and_one_by_one(shielded: ca.Design) -> None:
    """Thirteen coils grounded at once are solved in another way than a state by itself."""
    row = ca.lattice_array(shielded.array.stackup, shielded.array.placements[0].coil, ca.Lattice("linear", 20e-3, 13))
    circuit = replace(shielded.circuit, default_termination="ground")
    network = design_circuit(replace(shielded, array=row, circuit=circuit), accuracy="screen")
    assert network.dispersion is not None
    plan = replace(shielded, array=row, circuit=circuit).plan
    together = resonances(network, plan)
    for k in (0, 6):
        assert together[k].frequency == pytest.approx(resonate(network, plan[k]).frequency, rel=1e-10)
    still = resonate(replace(network, dispersion=None), plan[0])
    assert abs(together[0].frequency / still.frequency - 1) > 1e-6  # the first coil does not work at the mean


def test_the_emulated_board_and_files_have_the_plates(shielded: ca.Design, tmp_path: Path) -> None:
    network = design_circuit(shielded)
    state, board = shielded.plan[0], board_network(shielded)
    assert solve_state(board, state, 2.7e6).impedance == solve_state(network, state, 2.7e6).impedance
    f = np.geomspace(1e6, 1e7, 5)
    swept = board_circuit(shielded).swept(f)
    export_network(swept, tmp_path / "three.cir")
    text = (tmp_path / "three.cir").read_text()
    assert "L is that at the working frequency; the plates change it by up to" in text
    assert "without capacitance of the plates" in text
    export_network(_windings_alone(swept), tmp_path / "three.s3p", f)
    skrf = pytest.importorskip("skrf")
    Z = skrf.Network(str(tmp_path / "three.s3p")).z
    assert swept.dispersion is not None
    L = np.array([swept.inductance + swept.dispersion(one) for one in f])
    np.testing.assert_allclose(Z.imag, 2 * np.pi * f[:, None, None] * L, rtol=1e-6, atol=1e-5)


@pytest.mark.slow
def test_a_plate_with_an_outline(bare: ca.Design, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wide one does what an infinite one does, alone and beside another, but for 1 % of the field beyond its rim."""
    coarse = partial(making.outlined_inductance, fineness=0.6)  # 0.6 % off in all, 0.4 % on the full mesh
    monkeypatch.setattr(making, "outlined_inductance", coarse)
    one = replace(bare, array=bare.array.with_placements(bare.array.placements[1:2]))
    wide = ca.Plate("wide", 5e-3, 0.5e-3, ca.MATERIALS["copper"])
    disc = ca.FinitePlate("disc", ca.Disc(25e-3), (0, 0, 5.25e-3), 0.5e-3, wide.material)
    assert 0 < board_circuit(replace(one, plates=(disc,))).plate_error_attributes["plate_error_inductance"] < 2e-2
    for others in ((), (SHIELD,)):
        endless, found = (
            board_circuit(one).windings.plate_effect((*others, plate), 3e6, 3e6).at(np.array([3e6])).real
            for plate in (wide, disc)
        )
        np.testing.assert_allclose(found, endless, rtol=0.02)


@pytest.mark.slow
def test_the_self_resonance_has_the_plates_at_its_own_frequency(shielded: ca.Design) -> None:
    """Not at that of the states, a quarter of it: 0.1 % lower in a foil that mostly screens there already."""
    state, found = shielded.plan[1], float(scan_design(shielded, elastomer=False).state_self_resonance[1])
    flat = resonate(design_circuit(shielded), state)
    there = board_circuit(shielded).swept(found * np.array([0.99, 1.0, 1.01]))
    # 5e-5: linear between samples that are 7 % apart
    assert found == pytest.approx(self_resonance_of(there, flat), rel=5e-5)
    assert self_resonance_of(design_circuit(shielded), flat) < (1 - 5e-4) * found
