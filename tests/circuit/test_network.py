"""The circuit behind the switches, against `coilarray.circuit.active_coil` and against closed forms for two coils."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import simpson
from support.active_coil import active_coil
from support.coil_paths import random_matrix

from coilarray.circuit.network import (
    Network,
    between_coils,
    changed_resonances,
    loaded_quality,
    resonate,
    self_resonance_of,
    solve_state,
)
from coilarray.design.scan_states import ScanState, Switches, paper_plan
from coilarray.errors import NetworkError

L2 = np.array([[50e-6, -3e-6], [-3e-6, 40e-6]])
F = 1.9e6
OMEGA = 2 * np.pi * F


def network(L, R=0.0, C=0.0, mutual=0.0, **switches):
    n = len(L)
    R, C, between = R * np.eye(n), np.full(n, float(C)), np.full((n, n), float(mutual))
    return Network(tuple("abcdefgh"[:n]), np.asarray(L), lambda f: R, C, between, Switches(**switches))


def measure(*coils, connection="series", **others):
    chosen = tuple((name.lstrip("-"), -1 if name.startswith("-") else 1) for name in coils)
    return ScanState("+".join(coils), chosen, connection, **others)


@settings(max_examples=30)
@given(st.integers(1, 6), st.integers(0, 10**6), st.floats(0, 40), st.floats(0, 20))
def test_the_paper_plan_is_the_reduction_of_the_matrix(n, seed, resistance, on):
    """Nodal analysis against the direct formula: two independent ways to the same impedance."""
    L = random_matrix(n, seed)
    result = solve_state(network(L, resistance, on_resistance=on), paper_plan("abcdef"[:n])[0], F)
    # both ends of a grounded coil go through a switch; so do both ends of the measured one
    expected = active_coil(L, resistance, 0, F, short_resistance=2 * on)
    assert result.impedance == pytest.approx(expected.impedance + 2 * on, rel=1e-11)
    np.testing.assert_allclose(result.currents, expected.currents, rtol=0, atol=1e-11)


def test_series_and_parallel():
    M = L2[0, 1]
    for coils, connection, expected in (
        (("a", "b"), "series", L2[0, 0] + L2[1, 1] + 2 * M),
        (("a", "-b"), "series", L2[0, 0] + L2[1, 1] - 2 * M),
        (("a", "b"), "parallel", (L2[0, 0] * L2[1, 1] - M**2) / (L2[0, 0] + L2[1, 1] - 2 * M)),
        (("a", "-b"), "parallel", (L2[0, 0] * L2[1, 1] - M**2) / (L2[0, 0] + L2[1, 1] + 2 * M)),
    ):
        result = solve_state(network(L2), measure(*coils, connection=connection), F)
        assert result.apparent_inductance == pytest.approx(expected, rel=1e-12)
    # the sense of one coil alone changes nothing
    alone = solve_state(network(L2), measure("-a", others="open"), F)
    assert alone.apparent_inductance == pytest.approx(50e-6, rel=1e-12)


def _coil(capacitance=0.0):
    """Impedance of the first coil alone with a capacitance across it."""
    return 1 / (1 / (1j * OMEGA * 50e-6) + 1j * OMEGA * capacitance)


@pytest.mark.parametrize(("circuit", "state", "Z"), [
    # series coils pass through every switch
    (network(L2, 10.0, on_resistance=2.5), measure("a", "b"), 20 + 4 * 2.5 + 1j * OMEGA * 84e-6),
    (network(L2, 10.0), measure("a", others="load", load_resistance=33.0),
     10 + 1j * OMEGA * 50e-6 + (OMEGA * 3e-6) ** 2 / (10 + 33 + 1j * OMEGA * 40e-6)),
    # terminal 1 sits on A: open switches to B and ground; terminal 2 on B: open to A and ground.
    # Across the coil: two of them, and the two to ground in series
    (network(L2[:1, :1], off_capacitance=13e-12), measure("a"), _coil(2.5 * 13e-12)),
    (network(L2[:1, :1], bus_capacitance=50e-12, lead_inductance=20e-9), measure("a"),
     _coil(25e-12) + 2j * OMEGA * 20e-9),
], ids=["series", "load", "off capacitance", "bus and leads"])  # fmt: skip
def test_impedance_in_closed_form(circuit, state, Z):
    assert solve_state(circuit, state, F).impedance == pytest.approx(Z, rel=1e-12)


def test_open_and_one_end():
    circuit = network(L2, 10.0)
    for others in ("open", "ground one end", "ground other end"):
        result = solve_state(circuit, measure("a", others=others), F)
        assert result.apparent_inductance == pytest.approx(50e-6, rel=1e-12)
        assert abs(result.currents[1]) < 1e-12


def test_an_open_coil_with_capacitance_is_not_passive():
    C = 100e-12
    result = solve_state(network(L2, 0.0, C=C), measure("a", others="open"), F)
    # the measured coil has the capacitance as well, in parallel
    Z = 1j * OMEGA * 50e-6 + (OMEGA * 3e-6) ** 2 / (1j * OMEGA * 40e-6 + 1 / (1j * OMEGA * C))
    Z = 1 / (1 / Z + 1j * OMEGA * C)
    assert result.impedance == pytest.approx(Z, rel=1e-11)
    # below its own resonance it raises the inductance, above it lowers it, as a short does
    own = 1 / (2 * np.pi * math.sqrt(40e-6 * C))
    for f, sign in ((0.8 * own, 1), (1.25 * own, -1)):
        z = solve_state(network(L2, 0.0, C=C), measure("a", others="open"), f).impedance
        assert np.sign((1 / (1 / z - 2j * np.pi * f * C)).imag / (2 * np.pi * f) - 50e-6) == sign


def test_capacitance_to_a_grounded_neighbour():
    C = 9e-12
    L = np.diag([50e-6, 40e-6])
    result = solve_state(network(L, 0.0, mutual=C), measure("a", exceptions={"b": "ground"}), F)
    # the coil floats: its mean is at the neighbour's potential and only d²/12 is left, C/12
    assert result.impedance == pytest.approx(1 / (1 / (1j * OMEGA * 50e-6) + 1j * OMEGA * C / 12), rel=1e-9)
    # both neighbours' ends open: it takes the mean as well; the energy is the same
    free = solve_state(network(L, 0.0, mutual=C), measure("a", others="open"), 1e3)
    assert free.apparent_inductance == pytest.approx(50e-6, rel=1e-6)


def test_resonance_where_the_susceptance_vanishes():
    result = resonate(network(L2, 12.0), measure("a"))
    assert abs(result.admittance.imag) < 1e-9 * OMEGA * 120e-12
    # for a series R the phase is zero at ω² = 1/LC − R²/L²
    state = active_coil(L2, 12.0, 0, result.frequency)
    L, R = state.apparent_inductance, state.effective_resistance
    assert result.frequency == pytest.approx(math.sqrt(1 / (L * 120e-12) - (R / L) ** 2) / (2 * math.pi), rel=1e-9)
    # what the converter takes for L: that of the coil and R²/(ω²L)
    assert result.effective_inductance == pytest.approx(L + (R / result.frequency / 2 / math.pi) ** 2 / L, rel=1e-9)
    lossless = resonate(network(L2), measure("a"))
    assert lossless.effective_inductance == pytest.approx(active_coil(L2, 0.0, 0, F).apparent_inductance, rel=1e-9)
    assert lossless.quality_factor == math.inf
    # Q = R_p/(ωL_eff), R_eff = R_p/(1 + Q²), and R_p = L/(R C)
    Q, R_p = result.quality_factor, result.parallel_resistance
    assert R_p == pytest.approx(Q * 2 * math.pi * result.frequency * result.effective_inductance, rel=1e-9)
    assert R == pytest.approx(R_p / (1 + Q**2), rel=1e-9)
    assert result.parallel_resistance == pytest.approx(L / (R * 120e-12), rel=1e-9)


def test_tank_at_the_coil():
    # with ideal switches it does not matter where the tank stands while all others are grounded
    at_converter = resonate(network(L2, 12.0), measure("a"))
    at_coil = resonate(network(L2, 12.0, tank_at="coil"), measure("a"))
    assert at_coil.frequency == pytest.approx(at_converter.frequency, rel=1e-9)
    assert at_coil.effective_inductance == pytest.approx(at_converter.effective_inductance, rel=1e-9)
    # switch resistance is inside the tank at the converter and outside at the coil
    near = resonate(network(L2, 12.0, on_resistance=5.0), measure("a"))
    far = resonate(network(L2, 12.0, on_resistance=5.0, tank_at="coil"), measure("a"))
    assert near.parallel_resistance < 0.7 * far.parallel_resistance
    # an open neighbour with a tank of its own takes part
    free = resonate(network(L2, 12.0, tank_at="coil"), measure("a", others="open"))
    assert free.effective_inductance != pytest.approx(50e-6, rel=1e-3)


STRAYS = {
    "on_resistance": 3.0, "off_capacitance": 1e-12, "terminal_capacitance": 42e-12, "bus_capacitance": 65e-12,
    "lead_inductance": 20e-9,
}  # fmt: skip


def test_passivity():
    circuit = network(random_matrix(4, 1), 8.0, C=10e-12, mutual=5e-12, **STRAYS)
    for state in (measure("a"), measure("b", "-c"), measure("a", "d", connection="parallel", others="open")):
        for f in np.geomspace(1e3, 1e8, 60):
            assert solve_state(circuit, state, f).impedance.real > 0


def test_many_circuits_at_once_are_each_by_itself():
    # what is around the coils is interpolated over the frequencies of all; of one it is computed where it is
    circuit = network(random_matrix(3, 2), 8.0, C=10e-12, mutual=5e-12, **STRAYS)
    changed = circuit.inductance * np.linspace(0.7, 1.4, 40)[:, None, None]
    for state in (measure("a"), measure("b", "-c"), measure("a", others="open"), measure("c", others="load")):
        together, _, _ = changed_resonances(circuit, resonate(circuit, state), changed)
        alone = [resonate(replace(circuit, inductance=L), state).frequency for L in changed]
        np.testing.assert_allclose(together, alone, rtol=2e-12)  # the tolerance of both searches


def test_mutual_capacitance_stores_the_energy_of_linear_voltages():
    # C/2 ((m_i − m_j)² + (d_i² + d_j²)/12) for any four voltages: the mean over both windings
    C, v, s = 9e-12, np.array([0.7, -0.2, 1.3, 0.4]), np.linspace(0, 1, 201)
    first, second = v[0] + (v[1] - v[0]) * s, v[2] + (v[3] - v[2]) * s
    energy = C / 2 * simpson(simpson((first[:, None] - second) ** 2, x=s), x=s)  # exact for squares
    assert v @ between_coils(np.array([[0, C], [C, 0]])) @ v / 2 == pytest.approx(energy, rel=1e-12)


def test_loaded_quality():
    # tank and coil alone: ω L/R of the coil to first order; the slope gives R_p √(C/L) (1 − 1/Q²)^½
    plain = network(L2[:1, :1], 12.0)
    result = resonate(plain, measure("a"))
    assert loaded_quality(plain, result) == pytest.approx(result.quality_factor, rel=2 / result.quality_factor**2)
    assert loaded_quality(network(L2), resonate(network(L2), measure("a"))) == math.inf
    # strays store too: more Q than the coil with its strays taken for an inductance
    circuit = network(L2[:1, :1], 12.0, **STRAYS)
    result = resonate(circuit, measure("a"))
    stored = result.parallel_resistance * math.sqrt((120e-12 + (65e-12 + 42e-12) / 2) / 50e-6)
    assert loaded_quality(circuit, result) == pytest.approx(stored, rel=0.03)
    assert loaded_quality(circuit, result) > 1.2 * result.quality_factor


def test_self_resonance_of_a_state():
    C = 20e-12
    circuit = network(L2, 5.0, C=C)
    found = self_resonance_of(circuit, resonate(circuit, measure("a", "b", others="open")))
    # two coils in series, a capacitance across each: the lowest mode of (L − 1/(ω² C)) i = 0 at the port
    omega2 = np.linalg.eigvals(np.linalg.inv(L2 * C)).real
    assert found == pytest.approx(math.sqrt(omega2.min()) / (2 * math.pi), rel=0.05)
    bare = network(L2, 5.0)
    assert self_resonance_of(bare, resonate(bare, measure("a"))) == math.inf


def test_resonances_far_from_the_bare_coil():
    heavy = resonate(network(L2, 12.0, bus_capacitance=1e-9), measure("a"))
    # a lossy coil in parallel to the tank: ω² = (1 − 1/Q²)/LC with the coil's Q, to second order
    Q = heavy.quality_factor
    expected = math.sqrt((1 - 1 / Q**2) / (heavy.apparent_inductance * 120e-12)) / (2 * math.pi)
    assert heavy.frequency == pytest.approx(expected, rel=2 / Q**4)
    # a tank on each of two coils in series: half the capacitance across twice the inductance and more
    pair = resonate(network(L2, 12.0, tank_at="coil"), measure("a", "b"))
    one = resonate(network(L2, 12.0, tank_at="coil"), measure("a", others="open"))
    assert pair.frequency == pytest.approx(one.frequency, rel=0.15)


@pytest.mark.parametrize(("call", "message"), [
    (lambda: solve_state(network(L2), measure("x"), F), "names the coil 'x'; there are a, b"),
    (lambda: solve_state(network(L2), measure(), F), "measures no coil"),
    (lambda: solve_state(network(L2), measure("a", "a"), F), "measures a coil twice"),
    (lambda: solve_state(network(L2), measure("a", exceptions={"a": "open"}), F), "a and also makes it open"),
    (lambda: solve_state(network(L2), measure("a", exceptions={"q": "open"}), F), "names the coil 'q'"),
    (lambda: solve_state(network(L2), measure("a", others="loose"), F), "got 'loose'"),
    (lambda: solve_state(network(L2), measure("a", connection="ring"), F), "in series or parallel; got 'ring'"),
    (lambda: solve_state(network(L2), ScanState("s", (("a", 2),)), F), "the sense 1 or -1"),
    (lambda: solve_state(network(L2), measure("a", load_resistance=-1.0), F), "load_resistance of state a must be"),
    (lambda: solve_state(network(L2), measure("a"), 0.0), "frequency must be positive"),
    (lambda: network(np.array([[1, 2], [2, 1]])), "must be positive definite"),
    (lambda: network(np.array([[np.nan]])), "must be finite"),
    (lambda: network(L2, on_resistance=-1), "on_resistance must be finite and not negative"),
    (lambda: network(L2, tank_capacitance=0), "tank_capacitance must be positive"),
    (lambda: network(L2, tank_at="moon"), "tank_at must be 'converter' or 'coil'; got 'moon'"),
    (lambda: network(L2, mutual=-1e-12), "a mutual capacitance matrix"),
    (lambda: network(L2, C=-1e-12), "winding capacitances, finite and not negative"),
    (lambda: replace(network(L2), names=("a",)), "1 coils need an inductance matrix"),
    (lambda: resonate(network(L2, 1e6), measure("a")), "state a has no resonance between"),
])  # fmt: skip
def test_bad_networks_are_refused_by_name(call, message):
    with pytest.raises(NetworkError, match=message):
        call()
