"""Links between ports.

Who checks whom:

====================  ===================================================================================
transfer, impedance   ngspice, and the multiplexer's nodal analysis where both treat a circuit
efficiency            k²Q₁Q₂ in closed form, power balance from the coils' currents
resonances            f₀/√(1 ± k), and the peaks that ngspice finds
S-parameters          reciprocity, |S|² against the available power, one port in closed form
====================  ===================================================================================
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.coil_paths import random_matrix
from support.refusals import refused
from support.spice import needs_ngspice, run_ngspice

from coilarray import load_design
from coilarray.circuit.network import Network, solve_state
from coilarray.circuit.network_files import spice_subcircuit
from coilarray.circuit.ports import (
    PortCircuit,
    best_link,
    port_circuit,
    port_impedance,
    port_resonances,
    port_solution,
    power_transfer,
    scattering,
)
from coilarray.design.ports import Port
from coilarray.design.scan_states import ScanState, Switches
from coilarray.errors import DesignError, NetworkError

F = 13.56e6
OMEGA = 2 * math.pi * F
NAMES = ("reader", "tag", "third")
PORTS = (
    Port("reader", 50.0, None, 60e-12, 150e-12, "coil", 300.0),
    Port("tag", None, 1500.0, 90e-12, 40e-12, "terminals"),
)


def pair(k, Q=(100.0, 150.0), L=(2e-6, 5e-6)):
    """Impedance matrices of two coupled coils at F."""
    M = k * math.sqrt(L[0] * L[1])
    inductance = np.array([[L[0], M], [M, L[1]]])
    return inductance, np.diag([OMEGA * L[0] / Q[0], OMEGA * L[1] / Q[1]])


def bench(ports, subcircuit, resistance):
    """Lines of ngspice for the ports of three coils, the third closed by a resistance; the source has one volt.

    A capacitor of the quality Q at F has the conductance ωC/Q beside it.
    """
    name = subcircuit.split(".subckt ", 1)[1].split()[0]
    lines = [f"X1 c0 0 c1 0 c2 0 {name}", f"R9 c2 0 {resistance!r}"]
    for k, port in enumerate(ports):
        terminal = f"t{k}" if port.series_capacitance else f"c{k}"
        across = f"c{k}" if port.parallel_at == "coil" else terminal
        for letter, C, ends in (
            ("S", port.series_capacitance, f"c{k} {terminal}"),
            ("P", port.parallel_capacitance, f"{across} 0"),
        ):
            lines += [f"C{letter}{k} {ends} {C!r}"] if C else []
            if C and port.capacitor_quality:
                lines.append(f"R{letter}{k} {ends} {port.capacitor_quality / (OMEGA * C)!r}")
        if port.source_resistance:
            lines += [f"V{k} e{k} 0 dc 0 ac 1", f"RT{k} e{k} {terminal} {port.source_resistance!r}"]
        else:
            lines.append(f"RT{k} {terminal} 0 {port.load_resistance!r}")
    return lines


@needs_ngspice
def test_transfer_and_input_impedance_agree_with_ngspice(tmp_path):
    """Both solve in double precision the same circuit, so 1e-9 has room for a thousandfold loss of digits."""
    L, R, C = 1e-6 * np.eye(3) * 0 + random_matrix(3, 4) * 1e-6, np.array([0.5, 2.0, 1.0]), np.array([3e-12, 4e-12, 0])
    frequencies = [0.8 * F, F, 1.3 * F]
    text = spice_subcircuit(NAMES, L, R, capacitance=C)
    lines = bench(PORTS, text, 7.0)
    there = PortCircuit(NAMES, PORTS, F, np.array([0, 0, 7.0]), C)
    f = np.array(frequencies)
    Z = port_impedance(there, np.diag(R) + 2j * np.pi * f[:, None, None] * L, f)
    found = power_transfer(there, Z)
    load = run_ngspice(tmp_path, text, lines, "v(t1)", frequencies)
    np.testing.assert_allclose(found.voltage_ratio[:, 0, 0], load, rtol=1e-9)
    own = run_ngspice(tmp_path, text, lines, "v(t0)", frequencies)
    np.testing.assert_allclose(found.input_impedance[:, 0], 50 * own / (1 - own), rtol=1e-8)
    # |S21|² is the power in the load over the available power |V|²/(4 r)
    S = scattering(Z, there.resistances)
    np.testing.assert_allclose(np.abs(S[:, 1, 0]) ** 2, np.abs(load) ** 2 / 1500 * 4 * 50, rtol=1e-9)
    np.testing.assert_allclose(found.available_efficiency[:, 0, 0], np.abs(S[:, 1, 0]) ** 2, rtol=1e-12)
    np.testing.assert_allclose(S[:, 0, 0], (found.input_impedance[:, 0] - 50) / (found.input_impedance[:, 0] + 50))


@needs_ngspice
@pytest.mark.parametrize("k", [0.05, 0.2])
def test_ngspice_peaks_at_the_resonances(tmp_path, k):
    """Of two equal resonators with little loss: the current peaks at each mode, off by less than 1/(8Q²) of it."""
    L, R = pair(k, (2000.0, 2000.0), (2e-6, 2e-6))
    C = 1 / (OMEGA**2 * 2e-6)
    ports = Port("a", 0.05, None, C), Port("b", None, 0.05, C)
    modes, quality = port_resonances(PortCircuit(("a", "b"), ports, F), L, R)
    # losses shift a mode by about 1/(8 Q²) of it, and the modes into each other by as little
    np.testing.assert_allclose(modes, F / np.sqrt([1 + k, 1 - k]), rtol=1e-6)
    lines = [
        "X1 c0 0 c1 0 coilarray", f"C0 t0 c0 {C!r}", f"C1 c1 t1 {C!r}", "R0 e0 t0 0.05", "R1 t1 0 0.05",
        "V1 e0 0 dc 0 ac 1",
    ]  # fmt: skip
    text = spice_subcircuit(("a", "b"), L, np.diag(R))
    for mode, Q in zip(modes.tolist(), quality.tolist(), strict=True):
        steps = np.linspace(-0.4, 0.4, 5) / Q
        power = np.abs(run_ngspice(tmp_path, text, lines, "v(t1)", (mode * (1 + steps)).tolist())) ** -2
        curve = np.polyfit(steps, power, 2)  # of a resonance 1/|v|² is a parabola
        assert abs(-curve[1] / (2 * curve[0])) < 0.02 / Q  # the other mode bends it by about 1/(k Q)


def test_efficiency_of_the_best_load():
    L, R = pair(0.1)
    U = 0.1 * math.sqrt(100 * 150)
    best = best_link(R + 1j * OMEGA * L)
    assert best.kq == pytest.approx(U, rel=1e-12)
    assert best.efficiency == pytest.approx(U**2 / (1 + math.sqrt(1 + U**2)) ** 2, rel=1e-12)
    assert best.load.real == pytest.approx(R[1, 1] * math.sqrt(1 + U**2), rel=1e-12)

    def efficiency(load):
        ports = Port("a", 50.0), Port("b", None, load, 1 / (OMEGA**2 * L[1, 1]))
        there = PortCircuit(("a", "b"), ports, F)
        return float(power_transfer(there, port_impedance(there, R + 1j * OMEGA * L, F)).efficiency[0, 0])

    # with the reactance of the second coil cancelled, the efficiency is η₂ r/(1 + r) of both circuits
    load = float(best.load.real)
    assert efficiency(load) == pytest.approx(best.efficiency, rel=1e-12)
    for off in (0.5, 0.99, 1.01, 3.0):
        share = load * off / (load * off + R[1, 1])
        reflected = (OMEGA * L[0, 1]) ** 2 / (load * off + R[1, 1])
        assert efficiency(load * off) == pytest.approx(share * reflected / (reflected + R[0, 0]), rel=1e-12)
        assert efficiency(load * off) < best.efficiency


matrices = st.integers(0, 10_000)


@settings(max_examples=20, deadline=None)
@given(seed=matrices)
def test_no_other_load_is_better(seed):
    """Of coils that also heat each other's copper: efficiency at the best load, and beside it in every direction."""
    rng = np.random.default_rng(seed)
    root = rng.uniform(0.2, 1.0, (2, 2))
    Z = root @ root.T + 0.1 * np.eye(2) + 1j * OMEGA * 1e-7 * random_matrix(2, seed)

    def efficiency(load):
        ratio = Z[1, 0] / (Z[1, 1] + load)  # of the currents
        return abs(ratio) ** 2 * load.real / (Z[0, 0] - Z[0, 1] * ratio).real

    best = best_link(Z)
    assert efficiency(best.load) == pytest.approx(best.efficiency, rel=1e-9)
    for step in 0.01 * best.load.real * np.exp(2j * np.pi * np.arange(6) / 6):
        assert efficiency(best.load + step) < best.efficiency


@settings(max_examples=20, deadline=None)
@given(seed=matrices)
def test_reciprocity_and_power_balance(seed):
    """Of any board with three ports and an ending: nothing is made or lost, by the currents in all resistances."""
    rng = np.random.default_rng(seed)
    L = random_matrix(4, seed) * 1e-6
    root = rng.uniform(0.2, 1.0, (4, 4))
    R = root @ root.T + 0.1 * np.eye(4)  # losses of coils in each other too
    ports = (
        Port("a", 30.0, None, 80e-12, 120e-12), Port("b", None, 200.0, 150e-12, 60e-12, "terminals"),
        Port("c", None, 10.0, None, 90e-12),
    )  # fmt: skip
    there = PortCircuit(("a", "b", "c", "d"), ports, F, np.array([0, 0, 0, 5.0]))
    Z, currents = port_solution(there, R + 1j * OMEGA * L, F)
    S, r = scattering(Z, there.resistances), there.resistances
    np.testing.assert_allclose(S, S.T, rtol=0, atol=1e-9)
    into = np.linalg.solve(Z + np.diag(r), [1.0, 0, 0])  # currents for one volt at the first port
    i = currents @ into
    entering = abs(into[0]) ** 2 * power_transfer(there, Z).input_impedance[0].real
    lost = (i.conj() @ R @ i).real + 5.0 * abs(i[3]) ** 2
    loads = np.abs(into[1:]) ** 2 * r[1:]
    assert entering == pytest.approx(lost + loads.sum(), rel=1e-9)
    np.testing.assert_allclose(power_transfer(there, Z).efficiency[0], loads / entering, rtol=1e-9)


@settings(max_examples=20, deadline=None)
@given(seed=matrices, factor=st.floats(0.1, 10.0), speed=st.floats(0.1, 10.0))
def test_scaling_of_impedances_and_frequency(seed, factor, speed):
    L, R = random_matrix(3, seed) * 1e-6, np.diag([0.5, 2.0, 1.0])

    def scaled(port, by, faster):
        capacitances = {
            name: None if (C := getattr(port, name)) is None else C / by / faster
            for name in ("series_capacitance", "parallel_capacitance")
        }
        resistances = {
            name: None if (r := getattr(port, name)) is None else r * by
            for name in ("source_resistance", "load_resistance")
        }
        return replace(port, **capacitances, **resistances)

    def parameters(by, faster):
        ports = tuple(scaled(port, by, faster) for port in PORTS)
        there = PortCircuit(NAMES, ports, F * faster, np.array([0, 0, 7.0 * by]))
        Z = by * (R + 1j * OMEGA * L)
        modes = port_resonances(there, L * by / faster, R * by)
        return scattering(port_impedance(there, Z, F * faster), there.resistances), modes[0] / faster

    S, modes = parameters(1.0, 1.0)
    other, others = parameters(factor, speed)
    np.testing.assert_allclose(other, S, rtol=0, atol=1e-9)
    np.testing.assert_allclose(others, modes, rtol=1e-9)


def test_poses_at_once_are_each_pose():
    L = np.array([pair(k)[0] for k in (0.01, 0.1, 0.3)])
    Z = pair(0.1)[1] + 1j * OMEGA * L
    there = PortCircuit(("a", "b"), (replace(PORTS[0], coil="a"), replace(PORTS[1], coil="b")), F)
    every = power_transfer(there, port_impedance(there, Z, F))
    for k, one in enumerate(Z):
        alone = power_transfer(there, port_impedance(there, one, F))
        np.testing.assert_allclose(every.efficiency[k], alone.efficiency, rtol=1e-13)
        np.testing.assert_allclose(every.input_impedance[k], alone.input_impedance, rtol=1e-13)


@pytest.mark.parametrize("others", ["ground", "open", "load"])
def test_the_multiplexer_gives_the_same_impedance(others):
    """Of a plain port, with the other coils behind the same switches; the measured coil's are in series there."""
    L, R = random_matrix(3, 2) * 1e-6, np.diag([0.5, 2.0, 1.0])
    network = Network(NAMES, L, lambda f: R, np.zeros(3), np.zeros((3, 3)), Switches(on_resistance=2.5))
    state = solve_state(network, ScanState("s", (("reader", 1),), others=others), F)
    ending = {"ground": 5.0, "open": math.inf, "load": 50.0}[others]
    there = PortCircuit(NAMES, (Port("reader", 50.0),), F, np.full(3, ending))
    assert port_impedance(there, R + 1j * OMEGA * L, F)[0, 0] == pytest.approx(state.impedance - 5.0, rel=1e-12)


def test_a_tank_without_source_and_load_is_a_relay():
    """Three equal resonators in a row: f₀/√(1 + √2 k), f₀, f₀/√(1 − √2 k), from the eigenvalues of the couplings."""
    k, C = 0.1, 1 / (OMEGA**2 * 1e-6)
    L = 1e-6 * np.array([[1, k, 0], [k, 1, k], [0, k, 1]])
    ports = tuple(Port(name, parallel_capacitance=C) for name in NAMES)
    modes, quality = port_resonances(PortCircuit(NAMES, ports, F), L, np.zeros((3, 3)))
    np.testing.assert_allclose(modes, F / np.sqrt([1 + math.sqrt(2) * k, 1, 1 - math.sqrt(2) * k]), rtol=1e-9)
    assert (quality > 1e6).all()  # without losses, to rounding


DESIGN = load_design("gast2020")


def with_ports(*ports, frequency=F):
    return replace(DESIGN, circuit=replace(DESIGN.circuit, ports=ports, link_frequency=frequency))


def test_terminations_of_a_design_stay():
    circuit = replace(DESIGN.circuit, terminations={"coil3": "open", "coil4": "load"})
    design = replace(DESIGN, circuit=replace(circuit, ports=(Port("coil1", 50.0),), link_frequency=F))
    assert port_circuit(design).endings.tolist() == [5.0, 5.0, math.inf, 50.0, 5.0, 5.0]


@pytest.mark.parametrize(
    ("words", "make"),
    [
        (r"series_capacitance .* coil1 .* -1e-12", lambda: Port("coil1", 50.0, series_capacitance=-1e-12)),
        (r"parallel_capacitance .* 0", lambda: Port("coil1", 50.0, parallel_capacitance=0.0)),
        (r"load_resistance .* inf", lambda: Port("coil1", None, math.inf)),
        (r"coil1 .* 50 Ω .* 3 Ω", lambda: Port("coil1", 50.0, 3.0)),
        (r"series_capacitance 1e-12 F alone", lambda: Port("coil1", series_capacitance=1e-12)),
        (r"parallel_at .* 'middle'", lambda: Port("coil1", parallel_at="middle")),
        (r"circuit\.ports\.0\.coil .* coil1, .* 'coil9'", lambda: with_ports(Port("coil9"))),
        (r"circuit\.ports\.1\.coil .* 'coil1'", lambda: with_ports(Port("coil1"), Port("coil1"))),
        (r"link_frequency_MHz", lambda: with_ports(Port("coil1"), frequency=None)),
        (r"link_frequency .* -1", lambda: with_ports(Port("coil1"), frequency=-1.0)),
    ],
)
def test_refused_ports(words, make):
    refused(DesignError, words, make)


@pytest.mark.parametrize(
    ("words", "call"),
    [
        ("load_ohm", lambda there, Z: power_transfer(there, port_impedance(there, Z, F))),
        ("positive and finite; got 0", lambda there, Z: port_impedance(there, Z, [F, 0.0])),
        (r"\(…, 2, 2\).*\(3, 3\)", lambda there, Z: port_impedance(there, np.eye(3), F)),
        ("source_ohm or a load_ohm", lambda there, Z: port_impedance(replace(there, ports=(Port("a"),)), Z, F)),
        ("circuit.ports names none", lambda there, Z: replace(there, ports=())),
        (r"'c'; there are a, b", lambda there, Z: replace(there, ports=(Port("c"),))),
        (r"gast2020 .*\[\[circuit.ports\]\]", lambda there, Z: port_circuit(DESIGN)),
    ],
)
def test_refused_circuits(words, call):
    L, R = pair(0.1)
    refused(NetworkError, words, call, PortCircuit(("a", "b"), (Port("a", 50.0),), F), R + 1j * OMEGA * L)
