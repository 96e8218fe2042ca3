"""First-order sensitivity of the states of a scan.

Who checks whom: the resonance against `network.resonate`, currents against `circuit.active_coil`, δ against the
change of the resonance that `network.changed_resonances` finds, to its order.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.active_coil import active_coil

from coilarray.circuit import state_sensitivity as ways
from coilarray.circuit.board_circuit import bare_network
from coilarray.circuit.network import Network, SampledMatrix, changed_resonances, resonate
from coilarray.circuit.state_sensitivity import resonances, state_sensitivity
from coilarray.design.scan_states import ScanState, Switches, paper_plan
from coilarray.errors import NetworkError

NAMES = ("a", "b", "c", "d")
SWITCHES = Switches(on_resistance=2.5)
PLANS = {
    "all grounded": paper_plan(NAMES),
    "all open": tuple(ScanState(name, ((name, -1),), others="open") for name in NAMES),
    "some open": (
        ScanState("a", (("a", 1),), exceptions={"c": "open"}),
        ScanState("d", (("d", 1),), others="open", exceptions={"a": "ground", "b": "ground"}),
        ScanState("d again", (("d", 1),)),
    ),
}


def coils(seed):
    """Inductance matrix of four coils that couple with up to 0.3, of different sizes."""
    random = np.random.default_rng(seed)
    k = random.uniform(-0.3, 0.3, (4, 4))
    k = np.triu(k, 1) + np.triu(k, 1).T + np.eye(4)
    size = random.uniform(3e-3, 8e-3, 4)
    return k * np.outer(size, size), random.uniform(5, 40, 4), random


def network(L, R):
    return bare_network(NAMES, L, R, SWITCHES)


def test_currents_are_those_of_one_active_coil():
    L, R, _ = coils(2)
    states = state_sensitivity(network(L, R), PLANS["all grounded"])
    for a in range(4):
        frequency = 1 / (2 * np.pi * np.sqrt(states.base_inductance[a] * SWITCHES.tank_capacitance))
        one = active_coil(L, R, a, frequency, short_resistance=2 * SWITCHES.on_resistance)
        assert states.currents[:, a] == pytest.approx(one.currents, abs=1e-9)


def slopes(circuit, plan, change, step=1e-5):
    """Slope of δ = (f₀/f)² along a change of L for each state, by the resonances on both sides."""
    for flat in (resonate(circuit, state) for state in plan):
        changed = circuit.inductance + np.array([step, -step])[:, None, None] * change
        up, down = changed_resonances(circuit, flat, changed)[0]
        yield ((flat.frequency / up) ** 2 - (flat.frequency / down) ** 2) / (2 * step)


@pytest.mark.slow
@settings(max_examples=15)
@given(st.integers(0, 1000), st.sampled_from(sorted(PLANS)))
def test_delta_is_the_slope_of_the_resonance(seed, which):
    L, R, random = coils(seed)
    if np.linalg.eigvalsh(L).min() < 0.05 * np.diag(L).min():
        return  # coils that are nearly one: the second order is large
    change = random.normal(size=(4, 4)) * np.sqrt(np.outer(np.diag(L), np.diag(L)))
    change = change + change.T
    delta = state_sensitivity(network(L, R), PLANS[which]).delta(change)
    # the central difference errs by the third order, 1e-10 of terms up to 1e3, and by 1e-12/1e-5 of the frequency
    assert delta == pytest.approx(list(slopes(network(L, R), PLANS[which], change)), rel=1e-6, abs=1e-5)


def test_many_changes_at_once():
    L, R, random = coils(3)
    change = 1e-9 * random.normal(size=(2, 5, 4, 4))
    states = state_sensitivity(network(L, R), PLANS["some open"])
    assert states.measured.tolist() == [0, 3, 3]
    delta = states.delta(change)
    assert delta.shape == (2, 5, 3)
    assert delta[1, 2] == pytest.approx(states.delta(change[1, 2]), rel=1e-12)


STRAYS = Switches(2.5, 13e-12, 30e-12, 50e-12, 20e-9)


def lossy(switches, random):
    """Coils with winding and mutual capacitance and a resistance matrix that depends on frequency."""
    L, R, _ = coils(5)
    between = np.zeros((4, 4))
    between[0, 1] = between[1, 0] = 11e-12
    f = np.geomspace(0.5e6, 8e6, 15)
    matrices = np.array([np.diag(R) * (1 + 0.1 * (one / 2e6) ** 2) for one in f])
    matrices[:, 0, 1] = matrices[:, 1, 0] = -0.2
    return Network(NAMES, L, SampledMatrix(f, matrices), random.uniform(5e-12, 2e-11, 4), between, switches)


@pytest.mark.slow
@pytest.mark.parametrize("changes", [{}, {"on_resistance": 0.0}, {"off_capacitance": 0.0}, {"tank_at": "coil"}])
def test_many_states_together_are_each_by_itself(changes, monkeypatch):
    circuit = lossy(replace(STRAYS, **changes), np.random.default_rng(6))
    plan = PLANS["all grounded"]
    monkeypatch.setattr(ways, "_FEW", 100)
    alone, one_by_one = state_sensitivity(circuit, plan), resonances(circuit, plan)
    monkeypatch.setattr(ways, "_FEW", 0)
    together, at_once = state_sensitivity(circuit, plan), resonances(circuit, plan)
    # resonances are found to 1e-12, the slopes by the same difference; of interpolation 1e-13 is left
    np.testing.assert_allclose(together.base_inductance, alone.base_inductance, rtol=1e-11)
    np.testing.assert_allclose(together.weights, alone.weights, rtol=1e-9)
    np.testing.assert_allclose(together.currents, alone.currents, rtol=0, atol=1e-11)
    for a, b in zip(at_once, one_by_one, strict=True):
        assert a.frequency == pytest.approx(b.frequency, rel=1e-11)
        assert [a.impedance, a.parallel_resistance] == pytest.approx([b.impedance, b.parallel_resistance], rel=1e-9)
        np.testing.assert_allclose(a.currents, b.currents, rtol=0, atol=1e-11)


@pytest.mark.parametrize("plan", PLANS.values(), ids=PLANS)
def test_coils_alone_are_solved_as_any_others(plan, monkeypatch):
    L, R, _ = coils(7)
    quick = state_sensitivity(network(L, R), plan)
    monkeypatch.setattr(ways, "_is_bare", lambda circuit: False)
    general = state_sensitivity(network(L, R), plan)
    np.testing.assert_allclose(quick.base_inductance, general.base_inductance, rtol=1e-11)
    np.testing.assert_allclose(quick.weights, general.weights, rtol=3e-8)  # a slope by difference, of 1e-8
    np.testing.assert_allclose(quick.currents, general.currents, rtol=0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("others", ["ground", "open", "ground one end", "load"])
def test_delta_of_a_lossy_circuit_is_the_slope_of_its_resonance(others):
    random = np.random.default_rng(8)
    circuit = lossy(STRAYS, random)
    plan = [ScanState(name, ((name, 1),), others=others) for name in NAMES]
    change = random.normal(size=(4, 4)) * np.sqrt(np.outer(*2 * [np.diag(circuit.inductance)]))
    change = change + change.T
    delta = state_sensitivity(circuit, plan).delta(change)
    # as above; and R between two samples turns at a resonance that moves past one: none lies so near
    assert delta == pytest.approx(list(slopes(circuit, plan, change)), rel=1e-6, abs=1e-5)


@pytest.mark.parametrize(("plan", "switches", "message"), [
    ([ScanState("both", (("a", 1), ("b", 1)))], SWITCHES, "state both must measure one coil"),
    ([ScanState("x", (("x", 1),))], SWITCHES, "'x'"),
    (paper_plan(NAMES), replace(SWITCHES, on_resistance=5e3), "state a has no resonance"),
])  # fmt: skip
def test_what_cannot_be_treated_is_refused(plan, switches, message):
    L, R, _ = coils(4)
    with pytest.raises(NetworkError, match=message):
        state_sensitivity(replace(network(L, R), switches=switches), plan)
