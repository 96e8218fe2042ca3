"""First-order sensitivity of the states of a scan.

Who checks whom: the resonance against `network.resonate`, currents against `circuit.active_coil`, δ against the
change of the resonance that `network.resonances_near` finds, to its order.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coilarray.circuit.active_coil import active_coil
from coilarray.circuit.network import Network, resonances_near, resonate
from coilarray.circuit.state_sensitivity import state_sensitivity
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
    none = np.zeros_like(L)
    return Network(NAMES, L, lambda frequency: np.diag(R), none[0], none, SWITCHES)


@pytest.mark.parametrize("plan", PLANS.values(), ids=PLANS)
def test_states_are_those_of_the_network(plan):
    L, R, _ = coils(1)
    states = state_sensitivity(NAMES, L, R, SWITCHES, plan)
    for k, state in enumerate(plan):
        flat = resonate(network(L, R), state)
        base = 1 / ((2 * np.pi * flat.frequency) ** 2 * SWITCHES.tank_capacitance)
        assert states.base_inductance[k] == pytest.approx(base, rel=1e-11)  # both resonances are found to 1e-12
        sense = state.measured[0][1]
        assert states.currents[:, k] == pytest.approx(sense * flat.currents, abs=1e-9)


def test_currents_are_those_of_one_active_coil():
    L, R, _ = coils(2)
    states = state_sensitivity(NAMES, L, R, SWITCHES, PLANS["all grounded"])
    for a in range(4):
        frequency = 1 / (2 * np.pi * np.sqrt(states.base_inductance[a] * SWITCHES.tank_capacitance))
        one = active_coil(L, R, a, frequency, short_resistance=2 * SWITCHES.on_resistance)
        assert states.currents[:, a] == pytest.approx(one.currents, abs=1e-9)


@settings(max_examples=15)
@given(st.integers(0, 1000), st.sampled_from(sorted(PLANS)))
def test_delta_is_the_slope_of_the_resonance(seed, which):
    L, R, random = coils(seed)
    if np.linalg.eigvalsh(L).min() < 0.05 * np.diag(L).min():
        return  # coils that are nearly one: the second order is large
    change = random.normal(size=(4, 4)) * np.outer(np.sqrt(np.diag(L)), np.sqrt(np.diag(L)))
    change = change + change.T
    states = state_sensitivity(NAMES, L, R, SWITCHES, PLANS[which])
    one = states.delta(change)
    step = 1e-5
    for k, state in enumerate(PLANS[which]):
        flat = resonate(network(L, R), state)
        up, down = resonances_near(network(L, R), flat, L + np.array([step, -step])[:, None, None] * change)
        slope = ((flat.frequency / up) ** 2 - (flat.frequency / down) ** 2) / (2 * step)
        # the central difference errs by the third order, 1e-10 of terms up to 1e3, and by 1e-12/1e-5 of the frequency
        assert one[k] == pytest.approx(slope, rel=1e-6, abs=1e-5)


def test_many_changes_at_once():
    L, R, random = coils(3)
    change = 1e-9 * random.normal(size=(2, 5, 4, 4))
    states = state_sensitivity(NAMES, L, R, SWITCHES, PLANS["some open"])
    assert states.measured.tolist() == [0, 3, 3]
    delta = states.delta(change)
    assert delta.shape == (2, 5, 3)
    assert delta[1, 2] == pytest.approx(states.delta(change[1, 2]), rel=1e-12)


@pytest.mark.parametrize(
    ("plan", "switches", "message"),
    [
        ([ScanState("both", (("a", 1), ("b", 1)))], SWITCHES, "state both must measure one coil"),
        ([ScanState("a", (("a", 1),), others="load")], SWITCHES, "state a must measure one coil"),
        ([ScanState("x", (("x", 1),))], SWITCHES, "'x'"),
        (paper_plan(NAMES), replace(SWITCHES, off_capacitance=1e-12), "off_capacitance of the switches must be 0"),
        (paper_plan(NAMES), replace(SWITCHES, lead_inductance=1e-9), "lead_inductance of the switches must be 0"),
        (paper_plan(NAMES), replace(SWITCHES, tank_at="coil"), "tank must stand at the converter"),
        (paper_plan(NAMES), replace(SWITCHES, on_resistance=5e3), "state a has no resonance"),
    ],
)
def test_what_cannot_be_treated_is_refused(plan, switches, message):
    L, R, _ = coils(4)
    with pytest.raises(NetworkError, match=message):
        state_sensitivity(NAMES, L, R, switches, plan)
