"""The noise budget.

Who checks whom: thermal noise against a simulated oscillator, jitter against sums of random periods, losses against the
network solved twice, temperature against the emulated board's own physics, totals against sums by hand.
"""

from dataclasses import replace

import numpy as np
import pytest
from support.refusals import refused

from coilarray import load_design
from coilarray.circuit.board_circuit import bare_network
from coilarray.circuit.converter_limits import REFERENCE
from coilarray.circuit.network import loaded_quality, resonate
from coilarray.circuit.noise_budget import budget_of
from coilarray.design.model import Circuit, build_design
from coilarray.design.readout import INTERNAL_CLOCK, LARGEST_RCOUNT, Readout
from coilarray.design.scan_states import ScanState, Switches
from coilarray.design.tables import ReadoutTable
from coilarray.design.write import design_document
from coilarray.errors import DesignError, NetworkError
from coilarray.hardware.chips.ldc1614 import conversion_time, reference_divider

PAPER = load_design("gast2020")
NAMES = tuple(state.name for state in PAPER.plan)
SIX = np.full(6, 2e6), np.full(6, 40.0)


def of(budget, name):
    """The one cause whose name begins so."""
    (cause,) = [cause for cause in budget.causes if cause.name.startswith(name)]
    return cause


def budget(readout=None, switches=None, frequency=SIX[0], quality=SIX[1]):
    design = replace(PAPER, readout=readout or Readout())
    if switches is not None:
        design = replace(design, circuit=replace(design.circuit, switches=switches))
    return budget_of(design, frequency, quality)


def test_settings_are_those_of_the_converter():
    readout = Readout()
    assert (readout.clock, readout.rcount) == (INTERNAL_CLOCK, LARGEST_RCOUNT)
    assert readout.reference_divider == reference_divider(INTERNAL_CLOCK)
    assert readout.conversion_time == conversion_time(LARGEST_RCOUNT, REFERENCE)
    assert readout.counting_limit == pytest.approx(9.54e-7, rel=1e-3)


def test_resolution_is_the_published_one_where_it_was_published():
    """SNOA944 as quoted: 8e-7 of f at RCOUNT 0x800, so 1.6e-6 of L; a quarter of the variance at four times RCOUNT."""
    short, long = (of(budget(Readout(rcount=rcount)), "resolution").noise[0] for rcount in (0x800, 0x2000))
    assert (short, short / long) == pytest.approx((1.6e-6, 2.0))


def test_thermal_noise_is_that_of_a_simulated_oscillator():
    """A tank turns by ω dt, its losses kick the voltage with 4kT/R per Hz, its amplitude is held: phases diffuse."""
    capacitance, quality, cycles, steps, oscillators = 120e-12, 40.0, 40, 24, 3000
    omega, volts = 2 * np.pi * 2e6, 1e-4  # so small that phases diffuse visibly in 40 cycles
    resistance = quality / (omega * capacitance)
    step = 2 * np.pi / omega / steps
    kick = np.sqrt(2 * 1.380649e-23 * 298 / resistance * step) / capacitance  # V; half of 4kT/R per Hz, both sides
    random = np.random.default_rng(5)
    state = volts * np.exp(2j * np.pi * random.random(oscillators))  # voltage and current times √(L/C)
    turns = np.zeros(oscillators)
    for _ in range(cycles * steps):
        before = state
        state = state * np.exp(-1j * omega * step) + kick * random.standard_normal(oscillators)
        state *= volts / np.abs(state)
        turns += np.angle(state / before)
    duration = cycles * steps * step
    measured = np.std(turns / (omega * duration))
    rcount = 0x800  # the budget's duration is that of a conversion: scaled from it with the root
    readout = Readout(rcount=rcount, amplitude=volts)
    expected = of(budget(readout), "thermal").noise[0] / 2 * np.sqrt(readout.conversion_time / duration)
    # 3000 oscillators tell a standard deviation to 1.3 %
    assert measured == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("external", [False, True])
def test_jitter_adds_up_in_a_free_oscillator_and_not_in_a_crystal(external):
    """Sums of 200 periods, each with its error; against a resonator every edge errs about its own place."""
    random, period, jitter, periods = np.random.default_rng(2), 1 / 43.4e6, 40e-12, 2 * (16 * 6 + 4)
    readout = Readout(rcount=6, clock_jitter=jitter, external_clock=external)
    assert readout.conversion_time == pytest.approx(periods * period)
    if external:
        edges = jitter * random.standard_normal((4000, 2))  # of the first and the last; a period errs by one of them
        errors = edges[:, 1] - edges[:, 0]
    else:
        errors = jitter * random.standard_normal((4000, periods)).sum(axis=1)
    assert readout.jitter_noise == pytest.approx(np.std(errors) / (periods * period), rel=0.05)  # 4000 tell it to 1.1 %


@pytest.mark.parametrize("resistance", [5.0, 12.0, 30.0])
@pytest.mark.parametrize("winding", [0.0, 15e-12])
def test_losses_change_the_resonance_as_the_network_says(resistance, winding):
    """Copper and switches warmer by a little: L_eff of the circuit solved twice against the budget's closed form."""
    state, L = ScanState("coil1", (("coil1", 1),)), np.array([[50e-6]])
    switches, readout = Switches(on_resistance=2.5), Readout(copper_per_kelvin=4e-3, switch_per_kelvin=2e-3)

    def circuit(warmer):
        closed = replace(switches, on_resistance=2.5 * (1 + 2e-3 * warmer))
        bare = bare_network(("coil1",), L, np.array([resistance * (1 + 4e-3 * warmer)]), closed)
        return replace(bare, winding_capacitance=np.array([winding]))

    cold, warm = (resonate(circuit(warmer), state) for warmer in (0.0, 1e-3))
    quality = loaded_quality(circuit(0.0), cold)
    found = budget(readout, switches, np.full(6, cold.frequency), np.full(6, quality))
    drift = of(found, "resistance of the copper").drift[0] + of(found, "resistance of the switches").drift[0]
    # 1/Q² of the second order, 0.3 %; the switches' share is found without the winding's capacitance, an eighth of all
    allowed = 5e-3 + winding / 120e-12 * 2 * 5.0 / (resistance + 5.0)
    assert (warm.effective_inductance / cold.effective_inductance - 1) / 1e-3 == pytest.approx(drift, rel=allowed)


def test_a_circuit_without_losses_has_none_of_their_drift():
    found = budget(quality=np.full(6, np.inf))
    assert not of(found, "resistance of the copper").drift.any()
    assert not of(found, "thermal").noise.any()
    assert np.isfinite(found.sigma).all()


def test_drifts_are_those_of_their_coefficients():
    """L is as the clock squared, as the capacitance, as the size."""
    found = budget()
    drifts = [of(found, name).drift[0] for name in ("clock with temperature", "capacitor", "expansion")]
    assert drifts == pytest.approx([-26e-6, 30e-6, 14e-6])
    crystal = budget(Readout(external_clock=True, clock_per_kelvin=-0.5e-6))
    assert of(crystal, "clock with temperature").drift[0] == pytest.approx(-1e-6)


def test_totals_are_sums_in_quadrature():
    found = budget(Readout(averaged_scans=4, baseline_scans=16, temperature_change=0.2, supply_change=0.0))
    squares = sum(cause.noise**2 for cause in found.causes), sum(cause.drift**2 for cause in found.causes)
    assert found.noise == pytest.approx(np.sqrt(squares[0] * (1 / 4 + 1 / 16)))
    assert found.sigma == pytest.approx(np.hypot(found.noise, 0.2 * np.sqrt(squares[1])))
    assert found.largest == found.sigma.max()
    common = sum(one**2 for one in found.common.values())
    assert found.sigma == pytest.approx(np.sqrt(found.independent**2 + common))
    assert found.independent == pytest.approx(found.noise)  # the tank is at the converter: all drift is common


def test_a_reference_coil_takes_out_what_is_common_and_adds_its_noise():
    quality = np.array([40.0, 40.0, 40.0, 40.0, 40.0, 30.0])
    whole = budget(Readout(supply_change=0.01), quality=quality)
    left = whole.referenced(["coil6"])
    assert left.states == NAMES[:5]
    for name in ("clock with temperature", "clock with the supply", "capacitor", "expansion"):
        assert not of(left, name).change.any()
    # thermal noise, 1 % of the whole, is not the same at the other Q
    assert left.scan_noise == pytest.approx(np.sqrt(2) * whole.scan_noise[:5], rel=1e-4)
    copper = of(whole, "resistance of the copper").drift
    assert of(left, "resistance of the copper").drift == pytest.approx(copper[:5] - copper[5])
    both = whole.referenced(["coil5", "coil6"])
    assert both.scan_noise == pytest.approx(np.sqrt(1.5) * whole.scan_noise[:4], rel=1e-4)


def test_capacitors_at_the_coils_are_not_common():
    found = budget(switches=replace(PAPER.circuit.switches, tank_at="coil")).referenced(["coil6"])
    assert of(found, "capacitor").drift == pytest.approx(np.sqrt(2) * 30e-6 * np.ones(5))


def test_the_table_of_a_design_file_is_read_and_written():
    entries = {"rcount": 2048, "clock_MHz": 40.0, "external_clock": True, "resolution_ppm": 1.2, "clock_ppm_per_K": 0.7}
    design = build_design({**design_document(PAPER), "readout": entries})
    readout = Readout(rcount=2048, clock=40e6, external_clock=True, resolution=1.2e-6, clock_per_kelvin=0.7e-6)
    assert design.readout == readout
    assert design_document(design)["readout"] == entries
    assert (Readout(**ReadoutTable().in_si()), "readout" in design_document(PAPER)) == (Readout(), False)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"rcount": 4}, "rcount of a read-out must be 5 to 65535; got 4"),
        ({"clock": 0.0}, "clock of a read-out must be positive; got 0.0"),
        ({"clock_jitter": -1e-12}, "clock_jitter of a read-out must not be negative"),
        ({"board_per_kelvin": np.nan}, "board_per_kelvin of a read-out must be finite"),
        ({"averaged_scans": 0}, "averaged_scans of a read-out must be positive"),
    ],
)
def test_a_read_out_that_cannot_be_is_refused(values, message):
    refused(DesignError, message, Readout, **values)


def test_a_circuit_is_not_needed_for_the_states():
    """Series states have four switches in the loop, parallel ones half as much resistance as one."""
    states = (ScanState("s", (("coil1", 1), ("coil2", 1))), ScanState("p", (("coil1", 1), ("coil2", 1)), "parallel"))
    design = replace(PAPER, circuit=Circuit(Switches(on_resistance=2.0), scan=states))
    found = budget_of(design, np.full(2, 2e6), np.full(2, 10.0))
    drift = of(found, "resistance of the switches").drift
    assert drift[0] / drift[1] == pytest.approx(4.0)


def test_a_size_that_is_given_is_not_assumed_even_where_it_is_the_usual_one():
    entries = {"capacitor_ppm_per_K": 30.0, "resolution_ppm": 0.8, "clock_jitter_ps": 0.0}
    design = build_design({**design_document(PAPER), "readout": entries})
    given, left = (budget_of(one, *SIX) for one in (design, PAPER))
    for name in ("capacitor", "resolution"):
        assert (of(given, name).assumed, of(left, name).assumed) == (False, True)
        assert of(given, name).source == "[readout] of the design"
    assert given.sigma == pytest.approx(left.sigma)
    assert design_document(design)["readout"] == entries


def test_some_states_are_chosen_by_name():
    chosen = budget(quality=np.linspace(30, 40, 6)).select(["coil5", "coil2"])
    whole = budget(quality=np.linspace(30, 40, 6))
    assert chosen.sigma == pytest.approx(whole.sigma[[4, 1]])
    refused(NetworkError, "the budget has no state 'far'", whole.select, ["far"])
