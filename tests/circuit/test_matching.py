"""Matching and compensation, against closed forms, the S-parameters they aim at, and ngspice."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.refusals import refused
from support.spice import needs_ngspice, run_ngspice

from coilarray.circuit.matching import (
    TOLERANCES,
    capacitors,
    compensated,
    l_match,
    matched_port,
    standard_value,
    tolerance_corners,
    with_standard_values,
)
from coilarray.circuit.network_files import spice_subcircuit
from coilarray.circuit.ports import PortCircuit, input_impedance, port_impedance, power_transfer, scattering
from coilarray.design.ports import Port
from coilarray.errors import NetworkError

F = 13.56e6
OMEGA = 2 * math.pi * F
PLACES = ("coil", "terminals")


@settings(max_examples=40, deadline=None)
@given(
    R=st.floats(0.1, 20.0), Q=st.floats(5.0, 500.0), share=st.floats(0.01, 0.99), where=st.sampled_from(PLACES)
)  # fmt: skip
def test_two_capacitors_match_any_resistance_between_that_of_coil_and_tank(R, Q, share, where):
    Z = complex(R, R * Q)
    wanted = R * (1 + Q * Q) ** share
    series, parallel = l_match(Z, F, wanted, where)
    port = Port("a", wanted, None, series, parallel, where)
    there = PortCircuit(("a",), (port,), F)
    found = port_impedance(there, [[Z]], F)
    # the resistance of a high Q is the small part of numbers Q² larger: 1e-16 × 250 000 and room
    assert abs(scattering(found, wanted)[0, 0]) < 1e-9
    # the same port from its bare coil, and with lossy capacitors
    again = matched_port(replace(there, ports=(port.with_capacitors(None, None),)), [[Z]], "a")
    assert again.ports[0].capacitances == pytest.approx((series, parallel), rel=1e-6)


@pytest.mark.parametrize("where", PLACES)
def test_a_match_counts_losses_of_the_capacitors(where):
    there = PortCircuit(("a",), (Port("a", 50.0, None, None, None, where, 200.0),), F)
    made = matched_port(there, [[1 + 100j]], "a")
    assert abs(scattering(port_impedance(made, [[1 + 100j]], F), 50.0)[0, 0]) < 1e-8
    assert made.ports[0].capacitor_quality == 200.0


@pytest.mark.parametrize("topology", ["SS", "SP", "PS", "PP"])
def test_topologies_have_the_textbook_capacitors(topology):
    """Without losses, the table of Wang, Covic & Stielau (2004), of which L₂ enters the secondary alone."""
    L1, L2, M, R = 20e-6, 10e-6, 3e-6, 5.0
    w = 2 * math.pi * 100e3
    C2 = 1 / (w**2 * L2)
    left = L1 - M**2 / L2
    C1 = {
        "SS": 1 / (w**2 * L1),
        "SP": 1 / (w**2 * left),
        "PS": L1 / ((w * M**2 * w / R) ** 2 + (w * L1) ** 2),
        "PP": left / ((M**2 * R / L2**2) ** 2 + (w * left) ** 2),
    }[topology]
    there = PortCircuit(("a", "b"), (Port("a", 1.0), Port("b", None, R)), 100e3)
    Z = 1j * w * np.array([[L1, M], [M, L2]]) + 1e-9 * np.eye(2)  # an open tank without losses has no impedance
    made = compensated(there, Z, topology)
    kinds = {"S": "series", "P": "parallel"}
    assert [(coil, kind) for coil, kind, _ in capacitors(made)] == [
        (coil, kinds[letter]) for coil, letter in zip("ab", topology, strict=True)
    ]
    # the open tank of the load has 1e10 of its impedance with the load, and cancels to 1e-6
    assert [C for *_, C in capacitors(made)] == pytest.approx([C1, C2], rel=1e-6)
    seen = input_impedance(made, port_impedance(made, Z, 100e3))[0]
    assert abs(seen.imag) < 1e-5 * abs(seen)


@needs_ngspice
def test_ngspice_sees_a_match(tmp_path):
    L, R = np.array([[2e-6, 0.2e-6], [0.2e-6, 1e-6]]), [1.0, 0.6]
    ports = Port("a", 50.0), Port("b", None, 300.0, None, 120e-12)
    made = matched_port(PortCircuit(("a", "b"), ports, F), np.diag(R) + 1j * OMEGA * L, "a")
    (_, _, series), (_, _, across), _ = capacitors(made)
    lines = [
        "X1 c0 0 c1 0 coilarray", f"CS t0 c0 {series!r}", f"CP c0 0 {across!r}", "CL c1 0 120e-12", "RL c1 0 300",
        "RS e0 t0 50", "V1 e0 0 dc 0 ac 1",
    ]  # fmt: skip
    terminal = run_ngspice(tmp_path, spice_subcircuit(("a", "b"), L, R), lines, "v(t0)", [F])
    assert terminal == pytest.approx([0.5], abs=1e-9)  # half of the source's voltage: 50 Ω


def test_standard_values():
    for series, count in (("E12", 12), ("E24", 24), ("E96", 96)):
        one_decade = sorted({standard_value(C, series) for C in np.geomspace(1.0, 9.999, 5000)} - {10.0})
        assert len(one_decade) == count
        assert all(standard_value(C, series) == C for C in one_decade)
        # neighbours are apart by about twice the tolerance of the series
        steps = [high / low - 1 for low, high in pairwise([*one_decade, 10.0])]
        assert 1.2 * TOLERANCES[series] < np.mean(steps) < 2.6 * TOLERANCES[series]
    assert standard_value(4.75e-10, "E96") == 4.75e-10


def test_standard_values_and_tolerances_change_the_result():
    L, R = np.array([[2e-6, 0.2e-6], [0.2e-6, 2e-6]]), np.eye(2)
    Z = R + 1j * OMEGA * L
    exact = compensated(PortCircuit(("a", "b"), (Port("a", 1.0), Port("b", None, 20.0)), F), Z, "SS")
    rounded = with_standard_values(exact, "E24")
    assert [C for *_, C in capacitors(rounded)] == [68e-12, 68e-12]
    corners = list(tolerance_corners(rounded, 0.05))
    assert len({tuple(C for *_, C in capacitors(one)) for one in corners}) == 4

    def efficiency(there):
        return float(power_transfer(there, port_impedance(there, Z, F)).efficiency[0, 0])

    # a second coil off resonance by the reactance X: the load sees less by 1/(1 + X²/(R₂ + r)²) of the reflected part
    for one in (exact, rounded, *corners):
        X = OMEGA * 2e-6 - 1 / (OMEGA * one.ports[1].series_capacitance)
        reflected = (OMEGA * 0.2e-6) ** 2 * 21 / (21**2 + X**2)
        assert efficiency(one) == pytest.approx(20 / 21 * reflected / (reflected + 1), rel=1e-12)
    assert min(map(efficiency, corners)) < efficiency(rounded) <= efficiency(exact)


ONE = PortCircuit(("a", "b"), (Port("a", 50.0), Port("b", None, 5.0)), F)
Z2 = np.array([[1 + 100j, 10j], [10j, 1 + 100j]])


@pytest.mark.parametrize(
    ("words", "call"),
    [
        (r"more than 1 Ω .* got 0.5 Ω", lambda: l_match(1 + 100j, F, 0.5)),
        (r"less than 1.*e\+04 Ω; got 20000 Ω", lambda: l_match(1 + 100j, F, 20e3)),
        (r"positive parts; got 1 -5j Ω", lambda: l_match(1 - 5j, F)),
        (r"frequency .* got 0", lambda: l_match(1 + 5j, 0.0)),
        (r"resistance .* got -1", lambda: l_match(1 + 5j, F, -1.0)),
        (r"source_ohm or load_ohm, which a, b have; got 'c'", lambda: matched_port(ONE, Z2, "c")),
        (r"SS, SP, PS, PP; got 'SX'", lambda: compensated(ONE, Z2, "SX")),
        (r"one source_ohm .* got 1 and 0", lambda: compensated(replace(ONE, ports=ONE.ports[:1]), Z2, "SS")),
        (r"capacitance", lambda: compensated(ONE, Z2.conj(), "SS")),
        (r"E12, E24, E96; got 'E6'", lambda: standard_value(1e-12, "E6")),
        (r"got 0", lambda: standard_value(0.0)),
        (r"above 0 and below 1; got 1", lambda: next(tolerance_corners(ONE, 1.0))),
    ],
)
def test_what_cannot_be_matched_is_refused(words, call):
    refused(NetworkError, words, call)
