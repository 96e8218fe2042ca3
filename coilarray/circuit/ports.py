"""Links between ports: S-parameters, efficiency, and resonances.

The coils are known by their impedance matrix Z(ω) = R(ω) + jωL, and their ports by what
`coilarray.design.ports.Port` says. With the currents i and voltages u of the coils, and the
voltages w of the terminals behind series capacitors, Kirchhoff's laws are

    Z i − u = 0,    Y(ω) (u, w) + A i = j

for the currents j into the terminals. The ports bypass the multiplexer, and every coil floats, so
that each port counts its voltage from its own second terminal. Capacitances C are taken as
C (1 − j/Q). All functions work for many impedance matrices at once, of any leading shape (…).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.linalg
import xarray as xr

from coilarray.circuit.board_circuit import board_circuit
from coilarray.circuit.coupling import provenance
from coilarray.circuit.network import Network, coil_impedance, floating_capacitance
from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.netcdf import variables
from coilarray.compute.threads import serial_algebra
from coilarray.design.model import Design, DesignFile, design_of
from coilarray.design.ports import Port
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.errors import NetworkError

_BAND = 3.0  # factor around the frequency of the link within which its R holds for a resonance
_SAMPLES = 9  # of R(f) over the frequencies
_OSCILLATES = 0.5  # least quality factor of an oscillation
_LOAD = 50.0  # Ω, of a loaded coil, as in a state of a scan


@dataclass(frozen=True, eq=False)
class PortCircuit:
    """Ports of coils, and what the coils without a port are connected to.

    The n coils have `names`, in the order of their impedance matrix, and at most one of the `ports`
    each. The `frequency` of the link is in Hz. `endings` (n,) is the resistance in Ω across each
    coil without a port, infinite for an open coil and open by default. `across` (n,) is the
    capacitance of each winding in F, which lies across its coil, by default none. Raises
    NetworkError without a port, or for a port of an unknown coil.

    Two coils of Q = 100 that are coupled by 10 %, both resonant at 1 MHz:

    >>> L, R = np.array([[10e-6, 1e-6], [1e-6, 10e-6]]), 2 * np.pi * 0.1 * np.eye(2)
    >>> C = 1 / ((2 * np.pi * 1e6) ** 2 * 10e-6)
    >>> ports = Port("a", source_resistance=1.0, series_capacitance=C), Port("b", None, 6.3, C)
    >>> pair = PortCircuit(("a", "b"), ports, 1e6)
    >>> Z = port_impedance(pair, R + 2j * np.pi * 1e6 * L, 1e6)
    >>> power_transfer(pair, Z).efficiency.round(3)
    array([[0.819]])
    >>> [f"{f / 1e6:.3f}" for f in port_resonances(pair, L, R)[0]]  # near 1/√(1 ± k)
    ['0.957', '1.049']
    """

    names: tuple[str, ...]
    ports: tuple[Port, ...]
    frequency: float
    endings: FloatArray | None = None
    across: FloatArray | None = None

    def __post_init__(self) -> None:
        if not self.ports:
            raise NetworkError("a link needs at least one port; circuit.ports names none.")
        for port in self.ports:
            if port.coil not in self.names:
                raise NetworkError(f"a port names the coil {port.coil!r}; there are {', '.join(self.names)}.")

    @property
    def active(self) -> tuple[Port, ...]:
        """The m ports with a source or a load, in order."""
        return tuple(port for port in self.ports if port.resistance is not None)

    @property
    def resistances(self) -> FloatArray:
        """Resistances (m,) in Ω of the sources and loads."""
        return np.array([port.resistance for port in self.active])

    @property
    def sources(self) -> list[int]:
        """Places of the sources among the active ports."""
        return [k for k, port in enumerate(self.active) if port.source_resistance is not None]

    @property
    def loads(self) -> list[int]:
        """Places of the loads among the active ports."""
        return [k for k, port in enumerate(self.active) if port.load_resistance is not None]

    def without_capacitors(self) -> PortCircuit:
        """Return the circuit with the terminals at the coils."""
        return replace(self, ports=tuple(port.with_capacitors(None, None) for port in self.ports))


def port_circuit(design: Design, network: Network | None = None) -> PortCircuit:
    """Return the ports of a design, the other coils with their terminations.

    A grounded coil is closed through its two switches, a loaded coil by 50 Ω. All others are open,
    also a coil with one end at ground, as the ports float. The `network` of the design has the
    capacitances of the windings, which are left out without it. A design without ports raises a
    NetworkError.
    """
    circuit = design.circuit
    if not circuit.ports or circuit.link_frequency is None:
        raise NetworkError(f"{design.name} has no [[circuit.ports]], which a link needs.")
    across = None if network is None else floating_capacitance(network)
    return PortCircuit(tuple(design.terminations), circuit.ports, circuit.link_frequency, coil_endings(design), across)


def coil_endings(design: Design) -> FloatArray:
    """Return the resistance (n,) in Ω that terminates each coil, infinite for an open one."""
    closed = {"ground": design.circuit.short_resistance, "load": _LOAD}
    return np.array([closed.get(passive, math.inf) for passive in design.terminations.values()])


class _Admittances(NamedTuple):
    """Capacitors and resistors of a port circuit.

    `conductance` and `capacitance` (n + q, n + q) in S and F are between the coils' nodes and the q
    nodes behind series capacitors. The row of a coil that is closed by a resistance r instead is
    u + r i = 0, with `current` (n,) = r. `terminals` are the nodes of the active ports.
    """

    conductance: FloatArray
    capacitance: FloatArray
    current: FloatArray
    terminals: list[int]


def _admittances(circuit: PortCircuit) -> _Admittances:
    """Connect the elements of all ports, without sources and loads."""
    n, omega = len(circuit.names), 2 * math.pi * circuit.frequency
    nodes = n + sum(port.series_capacitance is not None for port in circuit.ports)
    G, C, current, last = np.zeros((nodes, nodes)), np.zeros((nodes, nodes)), np.ones(n), n
    terminals = []
    for port in circuit.ports:
        coil = terminal = circuit.names.index(port.coil)
        loss = 0.0 if port.capacitor_quality is None else omega / port.capacitor_quality
        if port.series_capacitance is not None:
            terminal, last = last, last + 1
            stamp = port.series_capacitance * np.array([[1, -1], [-1, 1]])
            C[np.ix_((coil, terminal), (coil, terminal))] += stamp
            G[np.ix_((coil, terminal), (coil, terminal))] += loss * stamp
        if port.parallel_capacitance is not None:
            node = coil if port.parallel_at == "coil" else terminal
            C[node, node] += port.parallel_capacitance
            G[node, node] += loss * port.parallel_capacitance
        if port.resistance is not None:
            terminals.append(terminal)
    if circuit.across is not None:
        C[range(n), range(n)] += circuit.across
    own = {port.coil for port in circuit.ports}
    for k, name in enumerate(circuit.names):
        if name not in own and circuit.endings is not None and math.isfinite(r := float(circuit.endings[k])):
            G[k, k], C[k, k], current[k] = 1.0, r * C[k, k], r
    return _Admittances(G, C, current, terminals)


def port_solution(
    circuit: PortCircuit, impedance: npt.ArrayLike, frequency: npt.ArrayLike
) -> tuple[ComplexArray, ComplexArray]:
    """Return what `port_impedance` does, and the coils' currents.

    The currents (…, n, m) are in A per ampere into each active port.
    """
    Z, f = np.asarray(impedance, dtype=np.complex128), np.asarray(frequency, dtype=np.float64)
    n, elements = len(circuit.names), _admittances(circuit)
    if Z.shape[-2:] != (n, n):
        raise NetworkError(f"{n} coils need an impedance matrix (…, {n}, {n}); got shape {Z.shape}.")
    if not (np.isfinite(f).all() and (f > 0).all()):
        raise NetworkError(f"frequencies of ports must be positive and finite; got {f[~(f > 0)].flat[0]} Hz.")
    if not elements.terminals:
        raise NetworkError("circuit.ports must have a source_ohm or a load_ohm; got only capacitors.")
    nodes = len(elements.conductance)
    shape = np.broadcast_shapes(Z.shape[:-2], f.shape)
    matrix = np.zeros((*shape, n + nodes, n + nodes), dtype=np.complex128)
    matrix[..., :n, :n], matrix[..., :n, n : 2 * n] = Z, -np.eye(n)
    matrix[..., n : 2 * n, :n] = np.diag(elements.current)
    matrix[..., n:, n:] = elements.conductance + 2j * np.pi * f[..., None, None] * elements.capacitance
    driven = np.zeros((n + nodes, len(elements.terminals)))
    rows = n + np.array(elements.terminals)
    driven[rows, range(len(rows))] = 1.0
    solution: ComplexArray = np.asarray(np.linalg.solve(matrix, driven), dtype=np.complex128)
    return solution[..., rows, :], solution[..., :n, :]


def port_impedance(circuit: PortCircuit, impedance: npt.ArrayLike, frequency: npt.ArrayLike) -> ComplexArray:
    """Return the impedance matrix between the terminals of all active ports.

    The `impedance` matrices (…, n, n) in Ω of the coils of a `circuit`, for example R + jωL at
    every pose of a board, hold at a `frequency` (…) in Hz. The result, shape (…, m, m), holds the
    open-circuit impedances in Ω, without the resistances of the sources and loads. Raises
    NetworkError for a frequency that is not positive, a matrix of another size, or no source and no
    load.
    """
    return port_solution(circuit, impedance, frequency)[0]


def scattering(impedance: ComplexArray, resistances: npt.ArrayLike) -> ComplexArray:
    """Return the S-parameters (…, m, m) of ports, without unit.

    The `impedance` (…, m, m) is in Ω, and the reference `resistances` (m,) or one for all are in Ω.
    With power waves S = r^(−1/2) (Z − r) (Z + r)^(−1) r^(1/2) (Kurokawa, IEEE Trans. MTT 13, 194,
    1965), so that the square of S_ji is the power in the resistance of port j over the available
    power of a source in port i.

    >>> scattering(np.array([[150.0 + 0j]]), 50.0).real
    array([[0.5]])
    """
    m = impedance.shape[-1]
    r = np.broadcast_to(np.asarray(resistances, dtype=np.float64), (m,))
    return np.asarray(np.eye(m) - 2 * np.sqrt(r)[:, None] * np.linalg.inv(impedance + np.diag(r)) * np.sqrt(r))


def input_impedance(circuit: PortCircuit, impedance: ComplexArray) -> ComplexArray:
    """Return the impedance (…, m) in Ω at the terminals of each active port.

    All other ports of the `circuit` have their sources and loads. `impedance` (…, m, m) in Ω is a
    result of `port_impedance`.
    """
    r = circuit.resistances
    own = np.diagonal(np.linalg.inv(impedance + np.diag(r)), axis1=-2, axis2=-1)
    return np.asarray(1 / own - r)


class Transfer(NamedTuple):
    """Transfer from each of s sources to each of l loads.

    Every source is taken alone. The others are replaced by their resistances. `input_impedance` (…,
    s) is in Ω at the terminals of each source. The power in the load over the power that enters the
    terminals is `efficiency`, that over the available power of the source `available_efficiency`,
    and `voltage_ratio` the voltage of the load over the open-circuit voltage of the source, all
    dimensionless of the shape (…, s, l).
    """

    input_impedance: ComplexArray
    efficiency: FloatArray
    available_efficiency: FloatArray
    voltage_ratio: ComplexArray


def power_transfer(circuit: PortCircuit, impedance: ComplexArray) -> Transfer:
    """Return efficiencies between the ports of a `circuit`.

    `impedance` (…, m, m) in Ω is a result of `port_impedance`. Without a source or without a load a
    NetworkError is raised.
    """
    r, sources, loads = circuit.resistances, circuit.sources, circuit.loads
    for found, key in ((sources, "source_ohm"), (loads, "load_ohm")):
        if not found:
            raise NetworkError(f"an efficiency needs a port with {key}; circuit.ports has none.")
    admittance: ComplexArray = np.asarray(np.linalg.inv(impedance + np.diag(r)), dtype=np.complex128)
    currents = np.moveaxis(admittance[..., sources], -1, -2)  # (…, s, m) in A per V
    own = currents[..., range(len(sources)), sources]
    at_terminals = 1 / own - r[sources]
    power = np.abs(currents[..., loads]) ** 2 * r[loads]  # twice the power in the loads, in W per V²
    entering = np.abs(own) ** 2 * at_terminals.real
    available = 1 / (4 * r[sources])
    return Transfer(
        at_terminals, power / entering[..., None], power / available[:, None], -currents[..., loads] * r[loads]
    )


class BestLink(NamedTuple):
    """Largest efficiency that two coils allow, with any network at both.

    All have the shape (…). `kq` is the dimensionless figure of merit U, of two coils without
    further losses k √(Q₁Q₂), `efficiency` the largest, U²/(1 + √(1 + U²))², dimensionless, and
    `load` the impedance in Ω at the second coil that reaches it.
    """

    kq: FloatArray
    efficiency: FloatArray
    load: ComplexArray


def best_link(impedance: npt.ArrayLike) -> BestLink:
    """Return the largest efficiency of a link, and its load.

    The `impedance` matrices (…, 2, 2) of the two coils are in Ω. Both ends are matched at the same
    time by conjugate images (S. Roberts, Proc. IRE 34, 198, 1946). U is the magnitude of Z₂₁ over
    √(R₁₁R₂₂ − R₁₂²), k √(Q₁Q₂) for two coils (M. Kurs et al., Science 317, 83, 2007).

    >>> link = best_link([[1 + 100j, 10j], [10j, 1 + 100j]])  # k = 0.1, Q = 100
    >>> f"{link.kq:.4g}, {link.efficiency:.4f}, {link.load:.3f}"
    '10, 0.8190, 10.050-100.000j'
    """
    Z = np.asarray(impedance, dtype=np.complex128)
    R, X = Z.real, Z.imag
    square = (R[..., 0, 1] ** 2 + X[..., 0, 1] ** 2) / (R[..., 0, 0] * R[..., 1, 1] - R[..., 0, 1] ** 2)
    root = np.sqrt(1 + square)
    share = R[..., 0, 1] / R[..., 0, 0]
    resistance = root * (R[..., 1, 1] - share * R[..., 0, 1])
    return BestLink(np.sqrt(square), square / (1 + root) ** 2, resistance - 1j * (X[..., 1, 1] - share * X[..., 0, 1]))


def port_resonances(
    circuit: PortCircuit, inductance: FloatArray, resistance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the resonances of the ports with their sources and loads.

    They are the natural oscillations e^(st) of the whole `circuit`. Two equal resonators that are
    coupled by k have f₀/√(1 ± k), as long as their losses do not exceed the coupling. `inductance`
    and `resistance` (n, n) of the coils in H and Ω are those at the frequency of the link.

    Returned are the frequencies (modes,) in Hz, rising, from a third of the link's frequency to
    three times of it, and the dimensionless quality factors (modes,) abs(s)/(−2 Re s).
    """
    n, elements, omega = len(circuit.names), _admittances(circuit), 2 * math.pi * circuit.frequency
    nodes = len(elements.conductance)
    G = elements.conductance.copy()
    for node, r in zip(elements.terminals, circuit.resistances.tolist(), strict=True):
        G[node, node] += 1 / r
    L, R = np.asarray(inductance, dtype=np.float64), np.asarray(resistance, dtype=np.float64)
    unit = omega * float(np.diag(L).mean())  # of impedance, so that all entries are of order one
    still, moving = np.zeros((2, n + nodes, n + nodes))
    still[:n, :n], still[:n, n : 2 * n] = R / unit, -np.eye(n)
    still[n : 2 * n, :n], still[n:, n:] = np.diag(elements.current), G * unit
    moving[:n, :n], moving[n:, n:] = omega * L / unit, omega * elements.capacitance * unit
    s: ComplexArray = np.asarray(scipy.linalg.eigvals(-still, moving), dtype=np.complex128)
    s = s[np.isfinite(s)]
    found = s[(s.imag > 0) & (s.imag < _BAND) & (s.imag > 1 / _BAND) & (np.abs(s) > -2 * _OSCILLATES * s.real)]
    found = found[np.argsort(found.imag)]
    with np.errstate(divide="ignore"):  # without losses
        return found.imag * circuit.frequency, np.abs(found) / np.maximum(-2 * found.real, 0.0)


@serial_algebra()
def design_ports(
    design: Design, frequencies: npt.ArrayLike | None = None, accuracy: Accuracy = "full"
) -> tuple[PortCircuit, Network]:
    """Return the ports of a design with the capacitances of its windings, and its network.

    The losses of the network hold at the frequency of the link and between the rising `frequencies`
    (n,) in Hz. The `accuracy` of the inductance matrix is that of `coilarray.inductance_matrix`. A
    design without ports, or frequencies that are not positive and rising, raise a NetworkError.
    """
    frequency = port_circuit(design).frequency
    f = np.atleast_1d(np.asarray(frequency if frequencies is None else frequencies, dtype=np.float64))
    if f.ndim != 1 or not f.size or not np.isfinite(f).all() or f[0] <= 0 or (np.diff(f) <= 0).any():
        raise NetworkError(f"frequencies of ports must be positive, finite and rising; got {f.ravel()[:3]} Hz.")
    low, high = min(f[0], frequency), max(f[-1], frequency)
    nodes = np.geomspace(low, high, _SAMPLES) if high > low else f[:1]
    network = board_circuit(design, accuracy=accuracy).swept(np.unique(np.append(nodes, frequency)))
    return port_circuit(design, network), network


@serial_algebra()
def solve_ports(
    design: Design | DesignFile, frequencies: npt.ArrayLike | None = None, *, accuracy: Accuracy = "full"
) -> xr.Dataset:
    """Compute the links between the ports of a design.

    The rising `frequencies` (n,) are in Hz, by default that of the `design`'s link alone. The
    `accuracy` of the inductance matrix is that of `coilarray.inductance_matrix`. Raises
    NetworkError for a design without ports or without any source and load, or a frequency that is
    not positive.

    The result has over ``frequency`` and ``port``, all with a source or a load: ``s_real`` and
    ``s_imag`` (port, other) for the resistances of sources and loads as references,
    ``input_resistance`` and ``input_reactance`` at the terminals. If there are sources and loads,
    over ``source`` and ``load``: ``efficiency``, ``available_efficiency`` and ``voltage_ratio`` of
    `power_transfer`, and for the two coils alone ``kq``, ``best_efficiency`` and the load that
    reaches it, ``best_load_resistance`` and ``best_load_reactance``. Over ``mode``, at the
    frequency of the link: ``mode_frequency`` and ``mode_quality`` of `port_resonances`.
    """
    design = design_of(design)
    there, network = design_ports(design, frequencies, accuracy)
    f = np.atleast_1d(np.asarray(there.frequency if frequencies is None else frequencies, dtype=np.float64))
    coils = coil_impedance(network, f)
    Z = port_impedance(there, coils, f)
    S, r, own = scattering(Z, there.resistances), there.resistances, input_impedance(there, Z)
    names = np.array([port.coil for port in there.active], dtype=object)
    at_link = coil_impedance(network, np.array([there.frequency]))[0]
    modes, quality = port_resonances(there, at_link.imag / (2 * np.pi * there.frequency), at_link.real)
    of_port, pair, link = ("frequency", "port"), ("frequency", "port", "other"), ("frequency", "source", "load")
    rows: list[tuple[str, tuple[str, ...], Any, str, str]] = [
        ("reference_resistance", ("port",), r, "ohm", "resistance of the source or load"),
        ("s_real", pair, S.real, "1", "S, real part"),
        ("s_imag", pair, S.imag, "1", "S, imaginary part"),
        ("input_resistance", of_port, own.real, "ohm", "input resistance"),
        ("input_reactance", of_port, own.imag, "ohm", "input reactance"),
        ("mode_frequency", ("mode",), modes, "Hz", "resonance"),
        ("mode_quality", ("mode",), quality, "1", "quality factor"),
    ]
    coords: dict[str, Any] = {"frequency": ("frequency", f, {"units": "Hz", "long_name": "frequency"}), "port": names}
    if there.sources and there.loads:
        moved = power_transfer(there, Z)
        ends = [[(a, b) for b in there.loads] for a in there.sources]
        bare = port_impedance(there.without_capacitors(), coils, f)
        best = [[best_link(bare[..., pair, :][..., pair]) for pair in map(list, row)] for row in ends]

        def of_pairs(name: str) -> ComplexArray:
            return np.moveaxis(np.array([[getattr(one, name) for one in row] for row in best]), -1, 0)

        load = of_pairs("load")
        rows += [
            ("efficiency", link, moved.efficiency, "1", "efficiency"),
            ("available_efficiency", link, moved.available_efficiency, "1", "share of the available power"),
            ("voltage_ratio", link, np.abs(moved.voltage_ratio), "1", "voltage of the load over that of the source"),
            ("kq", link, of_pairs("kq").real, "1", "kQ of the coils"),
            ("best_efficiency", link, of_pairs("efficiency").real, "1", "largest efficiency of the coils"),
            ("best_load_resistance", link, load.real, "ohm", "best load at the coil, resistance"),
            ("best_load_reactance", link, load.imag, "ohm", "best load at the coil, reactance"),
        ]
        coords |= {"source": names[there.sources], "load": names[there.loads]}
    left_out = "; ".join(network.left_out)
    attributes = {**provenance(design), "link_frequency_Hz": there.frequency, "left_out": left_out}
    return xr.Dataset(variables(*rows), {**coords, "other": names}, attributes)
