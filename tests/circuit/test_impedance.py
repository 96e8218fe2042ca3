"""The circuit of a design: its parts put together, against the parts alone and against limits."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from support.active_coil import active_coil
from threadpoolctl import threadpool_info, threadpool_limits

from coilarray import couple_design, dc_resistance, load_design, parse_design
from coilarray.circuit.coupling import (
    close_channels,
    couple,
    design_circuit,
    part_switches,
    scan_design,
    sweep_design,
    sweep_frequencies,
    sweep_range,
    terminations_of,
)
from coilarray.compute.threads import Recent
from coilarray.design.bundled import read
from coilarray.electromagnetics.capacitance import coil_capacitance, self_resonance
from coilarray.electromagnetics.resistance import resistance_matrix

pytestmark = pytest.mark.slow

STARTER = read("starter")


@pytest.fixture(scope="module")
def design():
    return load_design("starter")


@pytest.fixture(scope="module")
def scan(design):
    return scan_design(design)


def test_low_frequency_is_the_direct_current_network(design):
    sweep = sweep_design(design, [500.0, 1000.0])
    L = couple_design(design).inductance.values
    R = dc_resistance(design.array)
    capacitance = scan_design(design).winding_capacitance
    for k in range(3):
        expected = active_coil(L, R, k, 1000.0, short_resistance=design.circuit.short_resistance)
        # the measured coil's own two switches; at 1 kHz capacitance and eddy currents are worth 1e-6
        assert float(sweep.impedance_real[1, k]) == pytest.approx(
            expected.effective_resistance + design.circuit.short_resistance, rel=1e-5
        )
        # a capacitance across a resistance takes R² C from L: Im 1/(1/(R + jωL) + jωC) = ω (L − R² C) to first order
        taken = R[k] ** 2 * float(capacitance[k])
        assert float(sweep.apparent_inductance[1, k]) == pytest.approx(expected.apparent_inductance - taken, rel=3e-6)


def test_the_circuit_takes_one_thread_of_the_linear_algebra(design):
    """With two of them the circuit of 64 coils takes five times the processor time, most of it spent in waiting."""
    seen = []

    def look(done, total):
        seen.extend(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")

    with threadpool_limits(2, user_api="blas"):
        scan_design(design, elastomer=False, progress=look)
        sweep_design(design, [1e6], progress=look)
    assert set(seen) == {1}


def test_capacitance_raises_the_apparent_inductance(design, scan):
    coupling = couple_design(design)
    assert (scan.effective_inductance.values > coupling.ideal_effective_inductance.values).all()
    # L/(1 − ω² L C) with the coil's own capacitance and what its neighbours add, at most the mutual capacitance
    omega = 2 * np.pi * scan.frequency.values
    L = coupling.ideal_effective_inductance.values
    C = scan.winding_capacitance.values
    between = -scan.capacitance.values.copy()
    np.fill_diagonal(between, 0)
    assert (scan.effective_inductance.values > 0.999 * L / (1 - omega**2 * L * C)).all()
    assert (scan.effective_inductance.values < 1.001 * L / (1 - omega**2 * L * (C + between.sum(axis=1)))).all()


def test_resonance_belongs_to_tank_and_coil(design, scan):
    L, Q = scan.effective_inductance.values, scan.quality_factor.values
    omega = 2 * np.pi * scan.frequency.values
    C = design.circuit.capacitance
    np.testing.assert_allclose(omega**2 * L * C, 1, rtol=1e-14)
    np.testing.assert_allclose(scan.parallel_resistance, Q * omega * L, rtol=1e-9)
    # all is stored in tank and coil: Q of the resonator is R_p √(C/L) to first order, with L without the winding's C
    own = np.diag(couple_design(design).inductance)
    stored = scan.parallel_resistance * np.sqrt((C + scan.winding_capacitance.values) / own)
    np.testing.assert_allclose(scan.loaded_quality_factor, stored, rtol=0.02)
    assert (scan.loaded_quality_factor.values > Q).all()
    # R_p = (1 + Q²) R
    np.testing.assert_allclose(scan.parallel_resistance, (1 + Q**2) * scan.effective_resistance, rtol=1e-6)
    # the board is its own mirror image, but that one outer coil's lead is on its neighbour's side: 1e-3
    assert float(scan.frequency[0]) == pytest.approx(float(scan.frequency[2]), rel=1e-3)


def test_a_plan_of_each_coil_in_turn_has_the_numbers_of_the_coupling(design, scan):
    coupling = couple_design(design)
    assert coupling.attrs["left_out"] == ""
    for name in ("frequency", "effective_inductance", "effective_resistance", "quality_factor"):
        np.testing.assert_array_equal(scan[name].values, coupling[name].values)
    np.testing.assert_array_equal(scan.current_real.values, coupling.current_real.values)


def test_the_ideal_stands_beside_the_true_circuit(design):
    true, ideal = couple_design(design), couple_design(design, ideal=True)
    assert ideal.attrs["left_out"] == "alternating-current resistance of the copper; stray capacitances and inductances"
    np.testing.assert_array_equal(true.ideal_frequency.values, ideal.frequency.values)
    np.testing.assert_array_equal(true.ideal_effective_inductance.values, ideal.effective_inductance.values)
    plain = couple(
        design.array.names, true.inductance, true.resistance, design.circuit.capacitance,
        terminations_of(design), design.circuit.short_resistance,
    )  # fmt: skip
    np.testing.assert_array_equal(plain.frequency.values, ideal.frequency.values)


def test_the_network_is_computed_once(design):
    network = design_circuit(design)
    assert design_circuit(load_design("starter")) is network
    assert design_circuit(replace(design, sheets=())) is not network


def test_many_coils_without_the_copper_of_others(design, monkeypatch):
    monkeypatch.setattr("coilarray.circuit.board_circuit._MOST_TOGETHER", 2)
    monkeypatch.setattr("coilarray.circuit.board_circuit._KEPT", Recent(2))
    many, network = couple_design(design), design_circuit(design)
    assert many.attrs["left_out"] == "losses in the copper of other coils"
    alone = resistance_matrix([design.array.conductors()[1]], float(many.frequency[1])).resistance.values[0, 0, 0]
    R = network.resistance(float(many.frequency[1]))
    assert R[1, 1] == pytest.approx(alone, rel=1e-4)  # interpolated between nine frequencies over a tenth
    assert np.count_nonzero(R) == 3


def test_parts_are_those_of_the_modules(design, scan):
    C = coil_capacitance(design.array, design.sheets, relative_permittivity=design.circuit.elastomer_permittivity)
    np.testing.assert_allclose(scan.winding_capacitance, C.coil_capacitance, rtol=1e-12)
    L = couple_design(design).inductance.values
    np.testing.assert_allclose(scan.self_resonance, self_resonance(np.diag(L), C.coil_capacitance.values), rtol=1e-9)
    R = resistance_matrix(design.array, scan.attrs["ac_resistance_frequency_Hz"]).resistance.values[0]
    # interpolated between nine frequencies over a tenth
    np.testing.assert_allclose(scan.ac_resistance, np.diag(R), rtol=1e-4)
    assert (scan.resistance_ratio > 1).all()
    assert (scan.winding_capacitance > scan.bare_winding_capacitance).all()
    assert ((scan.elastomer_delta > 0) & (scan.dent_delta_bound > 0)).all()
    words_and_codes = {"resistance_model", "broken_limit", "drive_code", "path_drive_code"}
    for name, variable in scan.data_vars.items():
        assert "units" in variable.attrs or variable.dtype == bool or name in words_and_codes


def test_states_of_several_coils():
    scan = '[[scan]]\nname = "{}"\nmeasure = ["coil1", "{}"]\nothers = "open"\n'
    design = parse_design("\n".join([STARTER, scan.format("series", "coil2"), scan.format("against", "-coil2")]))
    sweep = sweep_design(design, [1000.0])
    L = couple_design(design).inductance.values
    expected = L[0, 0] + L[1, 1] + 2 * np.array([1, -1]) * L[0, 1]
    # R² C of the windings is 2e-5 of L at any low frequency
    np.testing.assert_allclose(sweep.apparent_inductance[0], expected, rtol=4e-5)
    scan = scan_design(design, elastomer=False)
    # the couplings are negative: against each other there is more inductance, and a lower frequency
    assert float(scan.frequency[1]) < float(scan.frequency[0])
    np.testing.assert_allclose(scan.current_real[:, 1], [1, -1], atol=0.02)


def test_scan_states_follow_the_terminations():
    terminations = 'default_termination = "short"\nterminations = { coil3 = "open" }'
    text = STARTER.replace('default_termination = "short"', terminations)
    scan = '\n[[scan]]\nname = "s"\nmeasure = ["coil1"]\n'
    texts = (text + scan, STARTER + scan + 'exceptions = { coil3 = "open" }\n', text + scan + 'others = "ground"\n')
    implicit, explicit, grounded = (
        float(scan_design(parse_design(one), elastomer=False).frequency[0]) for one in texts
    )
    assert implicit == explicit
    assert grounded > implicit


def test_open_neighbours_with_stray_capacitance_take_part():
    grounded = scan_design(load_design("starter"), elastomer=False)
    text = STARTER.replace('default_termination = "short"', 'default_termination = "open"')
    opened = scan_design(parse_design(text), elastomer=False)
    text = text.replace("terminal_capacitance_pF = 0 ", "terminal_capacitance_pF = 42 ")
    stray = scan_design(parse_design(text), elastomer=False)
    assert (opened.frequency < grounded.frequency).all()
    assert (stray.frequency < opened.frequency).all()


def test_permittivity_is_a_parameter():
    air = scan_design(parse_design(STARTER.replace("elastomer_permittivity = 3.0", "elastomer_permittivity = 1.0")))
    np.testing.assert_allclose(air.winding_capacitance, air.bare_winding_capacitance, rtol=1e-12)
    np.testing.assert_allclose(air.elastomer_delta, 0, atol=1e-15)


def test_the_part_of_the_switches_is_shown_beside_a_design_that_does_not_count_it(design, scan):
    assert "part_frequency" not in scan
    named = replace(design, circuit=replace(design.circuit, part="ADG739"))
    shown = scan_design(named, elastomer=False)
    np.testing.assert_array_equal(shown.frequency, scan.frequency)
    counted = replace(named, circuit=replace(named.circuit, switches=part_switches(named)))
    alone = scan_design(counted, elastomer=False)
    assert "part_frequency" not in alone  # it is the frequency
    # resistance and dispersion are interpolated between samples around another frequency
    np.testing.assert_allclose(shown.part_frequency, alone.frequency, rtol=1e-4)
    # more capacitance across the coil, to first order: f ∝ 1/√C; the winding's own, left out, is at most 2 % of it
    wholes = [one.circuit.switches.across_coil for one in (design, counted)]
    np.testing.assert_allclose(shown.part_frequency / scan.frequency, (wholes[0] / wholes[1]) ** 0.5, rtol=0.01)


def test_progress(design):
    seen = []
    scan_design(design, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1][0] == seen[-1][1]
    seen.clear()
    sweep_design(design, [1e5, 2e5, 3e5], progress=lambda done, total: seen.append((done, total)))
    assert seen == [(1, 3), (2, 3), (3, 3)]


def test_close_channels():
    found = close_channels(["a", "b", "c"], [1.0e6, 1.029e6, 1.031e6])
    assert [(a, b) for a, b, _ in found] == [("b", "c"), ("a", "b")]
    assert close_channels(["a"], [1e6]) == []


@pytest.mark.parametrize("frequencies", [[], [0.0], [-1.0], [1e6, 1e6], [2e6, 1e6], [np.nan], [[1e6]]])
def test_bad_frequencies(design, frequencies):
    with pytest.raises(ValueError, match="frequencies must be positive, finite and rising"):
        sweep_design(design, frequencies)


def test_half_grounded_and_loaded_neighbours_are_the_same_in_table_and_scan():
    """Every termination that a design can have, not only shorts and opens."""
    design = load_design("starter")
    ends = {"coil1": "ground one end", "coil3": "load"}
    design = replace(design, circuit=replace(design.circuit, terminations=ends))
    coupling, scan = couple_design(design), scan_design(design, elastomer=False)
    assert coupling.termination.values.tolist() == ["ground one end", "short", "load"]
    np.testing.assert_array_equal(scan.frequency.values, coupling.frequency.values)
    assert (couple_design(load_design("starter")).frequency.values != coupling.frequency.values).all()


@pytest.mark.parametrize(("own", "highest"), [(3e6, 8e6), (18e6, 22.5e6), (90e6, 8e6)])
def test_a_sweep_reaches_beyond_a_self_resonance_that_is_near(own, highest):
    """Four times the resonance of 2 MHz, unless the self-resonance lies between that and ten times it."""
    scan = xr.Dataset({"frequency": ("state", [1e6, 4e6]), "state_self_resonance": ("state", [2e6, own])})
    assert sweep_range(scan) == pytest.approx((0.2e6, highest), rel=1e-12)


def test_a_sweep_has_more_frequencies_towards_self_resonances():
    """Straight lines between the points of L/(1 − (f/f_0)²) are within 2 % of it, down to 2 % of f_0 from its pole."""
    own = np.array([5e6, 7e6, 90e6])  # the last beyond the range
    scan = xr.Dataset({"frequency": ("state", [2e6] * 3), "state_self_resonance": ("state", own)})
    f, even = sweep_frequencies(scan, 60), np.geomspace(*sweep_range(scan), 60)
    assert np.isin(even, f).all()
    assert (np.diff(f) > 0).all()
    below = f[(f > 0.5 * own[0]) & (f <= 0.98 * own[0])]
    curve, middle = 1 / (1 - (below / own[0]) ** 2), (below[1:] + below[:-1]) / 2
    line = (curve[1:] + curve[:-1]) / 2
    assert (line * (1 - (middle / own[0]) ** 2)).max() < 1.02
    peak = 1 / (1 + (40 * (f / own[0] - own[0] / f)) ** 2)  # Re Z of a coil of quality 40, of its peak
    assert peak.max() == 1.0
    assert (peak[f < own[0]].max(), peak[f > own[0]].max()) == pytest.approx((0.28, 0.28), abs=0.02)  # 2 % off it
    narrow = sweep_frequencies(scan, 3, (4e6, 6e6))
    assert (narrow[0], narrow[-1]) == (4e6, 6e6)
    assert own[0] in narrow
    scan["state_self_resonance"] = ("state", [np.inf] * 3)
    np.testing.assert_array_equal(sweep_frequencies(scan, 60), np.geomspace(0.2e6, 8e6, 60))
