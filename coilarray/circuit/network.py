"""The array behind its switches: nodal analysis of any termination of every coil.

Each coil is a branch of the coupled impedance Z(ω) = R(ω) + jωL between its two terminals, with its winding
capacitance across. A terminal goes through a closed switch to one net (converter side A or B, ground, or a link
between coils in series) and through open switches, as capacitors, to the others. With the node voltages v and the
branch currents i, modified nodal analysis (Ho, Ruehli & Brennan, IEEE Trans. Circuits Syst. 22, 504, 1975) is

    [ Y   A ] [v]   [j]
    [ Aᵀ −Z ] [i] = [0].
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from coilarray.circuit.active_coil import PortImpedance, checked_network
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import ranges
from coilarray.design.scan_states import Passive, ScanState, Switches, check_state
from coilarray.errors import NetworkError

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

# how far from the bare coil a resonance is looked for, and in how many steps of a tenth
_SEARCH, _SEARCH_POINTS = 30.0, 72
_FINE_POINTS = 172  # steps of 2 %
_BYTES_AN_ENTRY = 48.0  # of a circuit's matrix: itself, without the references, and as it is factored
_AT_ONCE = 16  # frequencies; many at once save time, a search seldom needs all
_SLOPE_STEP = 1e-4  # of the frequency; the difference errs by 1e-8
_NEWTON_STEPS, _NEWTON_TOLERANCE = 40, 1e-12  # relative
_GROUND, _SIDE_A, _SIDE_B = "ground", "A", "B"


@dataclass(frozen=True, eq=False)
class Network:
    """Coils and switches, to be solved in any state at any frequency.

    Parameters
    ----------
    names : tuple of str, length n
        Of the coils.
    inductance : ndarray, shape (n, n)
        In H.
    resistance : callable
        Takes a frequency in Hz and returns the resistance matrix, shape (n, n), in Ω.
    winding_capacitance : ndarray, shape (n,)
        Lumped capacitance across each coil in F.
    mutual_capacitance : ndarray, shape (n, n)
        Capacitance C_ij between two coils, each at one potential, in F; symmetric, the diagonal is not used.
    switches : Switches
        The rest of the circuit.

    Raises
    ------
    NetworkError
        Shapes that do not fit, or a capacitance that is negative or not finite.

    Notes
    -----
    The voltage of a coil runs linearly from end to end, and where two coils lie above each other their turns cross in
    all combinations. The energy is then C_ij/2 ((m_i − m_j)² + (d_i² + d_j²)/12) with the mean m and the difference d
    of a coil's two ends. Four capacitors C_ij/4 from end to end have d²/4 in place of d²/12; C_ij/6 less across each
    coil makes that good.
    """

    names: tuple[str, ...]
    inductance: FloatArray
    resistance: Callable[[float], FloatArray]
    winding_capacitance: FloatArray
    mutual_capacitance: FloatArray
    switches: Switches

    def __post_init__(self) -> None:
        n = len(self.names)
        if self.inductance.shape != (n, n):
            raise NetworkError(f"{n} coils need an inductance matrix ({n}, {n}); got {self.inductance.shape}.")
        checked_network(self.inductance, 0.0)  # symmetric and positive definite
        capacitance = self.winding_capacitance
        if capacitance.shape != (n,) or not (np.isfinite(capacitance).all() and (capacitance >= 0).all()):
            raise NetworkError(f"{n} coils need {n} winding capacitances, finite and not negative; got {capacitance}.")
        mutual = self.mutual_capacitance
        if mutual.shape != (n, n) or not np.array_equal(mutual, mutual.T) or not (mutual >= 0).all():
            raise NetworkError(f"{n} coils need a mutual capacitance matrix ({n}, {n}), symmetric and not negative.")


@dataclass(frozen=True, eq=False)
class StateResult(PortImpedance):
    """What the converter sees in one state at one frequency.

    Parameters
    ----------
    frequency : float
        In Hz.
    impedance : complex
        In Ω, between the sides of the converter without the tank's capacitor.
    state : ScanState
        The state.
    admittance : complex
        In S, with the tank's capacitor.
    currents : ndarray of complex, shape (n,)
        Through every coil in A per A in the first measured one.
    """

    state: ScanState
    admittance: complex
    currents: ComplexArray

    @property
    def quality_factor(self) -> float:
        """Q = Im Z/Re Z of the coils without the tank; infinite without losses. See `loaded_quality`."""
        return self.impedance.imag / self.impedance.real if self.impedance.real > 0 else math.inf

    @property
    def parallel_resistance(self) -> float:
        """R_p = 1/Re Y in Ω, what the converter must replace at resonance; infinite without losses."""
        return 1 / self.admittance.real if self.admittance.real > 0 else math.inf


def solve_state(network: Network, state: ScanState, frequency: float) -> StateResult:
    """Solve one state at one frequency.

    Parameters
    ----------
    network : Network
        Coils and switches.
    state : ScanState
        The multiplexer's state.
    frequency : float
        In Hz.

    Returns
    -------
    StateResult

    Raises
    ------
    NetworkError
        A coil that is not there or stands twice in the state, a frequency that is not positive and finite, or a
        singular network.

    Examples
    --------
    >>> from coilarray.design.scan_states import ScanState, Switches
    >>> L, R, C = np.array([[50e-6]]), np.array([[10.0]]), np.zeros((1, 1))
    >>> one = Network(("a",), L, lambda f: R, C[0], C, Switches(2.5))
    >>> result = solve_state(one, ScanState("a", (("a", 1),)), 2e6)
    >>> round(result.effective_inductance * 1e6, 6), round(result.effective_resistance, 6)
    (50.0, 15.0)
    """
    check_state(state, network.names)
    if not (math.isfinite(frequency) and frequency > 0):
        raise NetworkError(f"frequency must be positive and finite; got {frequency} Hz.")
    at = np.array([frequency])
    impedance, currents, admittance = _solve_with_tank(network, state, at, network.inductance)
    first = network.names.index(state.measured[0][0])
    own = currents[0] / (currents[0, first] * state.measured[0][1])
    return StateResult(frequency, complex(impedance[0]), state, complex(admittance[0]), own)


def impedances(network: Network, state: ScanState, frequencies: FloatArray) -> ComplexArray:
    """Impedance of one state between the sides of the converter at many frequencies, without the tank's capacitor.

    Parameters
    ----------
    network, state
        As in `solve_state`.
    frequencies : ndarray, shape (f,)
        In Hz, positive and finite.

    Returns
    -------
    ndarray of complex, shape (f,)
        In Ω.

    Raises
    ------
    NetworkError
        As `solve_state`.
    """
    check_state(state, network.names)
    if not (np.isfinite(frequencies).all() and (frequencies > 0).all()):
        raise NetworkError(f"frequencies must be positive and finite; got {frequencies}.")
    blocks = ranges(len(frequencies), _AT_ONCE)
    return np.concatenate(
        [_solve_with_tank(network, state, frequencies[low:high], network.inductance)[0] for low, high in blocks]
    )


def _solve_with_tank(
    network: Network,
    state: ScanState,
    frequencies: FloatArray,
    inductances: FloatArray,
    winding_capacitances: FloatArray | None = None,
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """As `_solve`, and the admittances (f,) in S with the tank's capacitor."""
    switches = network.switches
    measured = {name for name, _ in state.measured}
    winding = network.winding_capacitance if winding_capacitances is None else winding_capacitances
    at_coil = np.full(len(network.names), switches.tank_capacitance if switches.tank_at == "coil" else 0.0)
    bare_tank = np.array([0.0 if name in measured else c for name, c in zip(network.names, at_coil, strict=True)])
    impedance, currents = _solve(network, state, frequencies, winding + bare_tank, inductances)
    if not impedance.all():
        raise NetworkError(f"state {state.name} shorts the converter at {frequencies[0]:.6g} Hz.")
    if switches.tank_at == "converter":
        admittance = 1 / impedance + 2j * math.pi * frequencies * switches.tank_capacitance
    else:
        admittance = 1 / _solve(network, state, frequencies, winding + at_coil, inductances)[0]
    return impedance, currents, admittance


def resonate(network: Network, state: ScanState) -> StateResult:
    """Solve one state where the converter oscillates, Im Y = 0.

    Parameters
    ----------
    network, state
        As in `solve_state`.

    Returns
    -------
    StateResult
        At the resonance that continues the one of the measured coils alone with the tank.

    Raises
    ------
    NetworkError
        As `solve_state`; also where there is no resonance from a thirtieth to thirty times the frequency of the
        measured coils alone with one tank capacitor.
    """
    check_state(state, network.names)
    start = 1 / (2 * math.pi * math.sqrt(_bare_inductance(network, state) * network.switches.tank_capacitance))

    def susceptance(frequencies: FloatArray) -> FloatArray:
        return _solve_with_tank(network, state, frequencies, network.inductance)[2].imag

    # Im Y grows with frequency through a parallel resonance. It mostly lies near the start; where strays or several
    # tanks move it far away, the lowest crossing counts.
    crossing = _upward_crossing(susceptance, start / 1.3 * np.array([1.0, 1.3**2]))
    if crossing is None:
        crossing = _upward_crossing(susceptance, start * np.geomspace(1 / _SEARCH, _SEARCH, _SEARCH_POINTS))
    if crossing is None:
        raise NetworkError(
            f"state {state.name} has no resonance between {start / _SEARCH:.4g} and {start * _SEARCH:.4g} Hz."
        )
    return solve_state(network, state, crossing)


def loaded_quality(network: Network, result: StateResult) -> float:
    """Quality factor of the whole resonator, Q = (ω/2) (dB/dω)/G at resonance with Y = G + jB.

    It counts what every inductance and capacitance stores, switches and bus included; `StateResult.quality_factor` is
    that of the coils without the tank.

    Parameters
    ----------
    network : Network
        Coils and switches.
    result : StateResult
        As `resonate` returns it.

    Returns
    -------
    float
        Infinite without losses.
    """
    if result.admittance.real <= 0:
        return math.inf
    step = _SLOPE_STEP * result.frequency
    above, below = (
        solve_state(network, result.state, result.frequency + sign * step).admittance.imag for sign in (1, -1)
    )
    return result.frequency / 2 * (above - below) / (2 * step) / result.admittance.real


def self_resonance_of(network: Network, result: StateResult) -> float:
    """Lowest frequency above a resonance at which the state without its tank turns from coil to capacitor, in Hz.

    Parameters
    ----------
    network, result
        As in `loaded_quality`.

    Returns
    -------
    float
        Infinite where there is none below thirty times the resonance.
    """

    def susceptance(frequencies: FloatArray) -> FloatArray:
        return np.asarray((1 / impedances(network, result.state, frequencies)).imag)

    # fine steps: modes of several coils lie close together
    crossing = _upward_crossing(susceptance, result.frequency * np.geomspace(1, _SEARCH, _FINE_POINTS))
    return math.inf if crossing is None else crossing


def resonances_near(
    network: Network, result: StateResult, inductances: FloatArray, winding_capacitances: FloatArray | None = None
) -> FloatArray:
    """Frequencies of a resonance while inductances and capacitances change a little.

    Parameters
    ----------
    network : Network
        Coils and switches.
    result : StateResult
        As `resonate` returns it for this network.
    inductances : ndarray, shape (cases, n, n)
        In H, in place of the network's own.
    winding_capacitances : ndarray, shape (cases, n), optional
        In F, in place of the network's own; a change may make them negative, as the tank is in parallel.

    Returns
    -------
    ndarray, shape (cases,)
        In Hz.

    Raises
    ------
    NetworkError
        A resonance that Newton's method does not find from the given one.

    Notes
    -----
    Newton's method on Im Y(f) = 0 for all cases at once, with the slope of the given resonance: the error falls by
    about the relative change of L at every step.
    """
    f0 = result.frequency
    pair = f0 * np.array([1 - _SLOPE_STEP, 1 + _SLOPE_STEP])
    below, above = _solve_with_tank(network, result.state, pair, network.inductance)[2].imag
    slope = (above - below) / (pair[1] - pair[0])
    frequencies = np.full(len(inductances), f0)
    for _ in range(_NEWTON_STEPS):
        solved = _solve_with_tank(network, result.state, frequencies, inductances, winding_capacitances)
        step = solved[2].imag / slope
        frequencies -= step
        if not len(step) or np.abs(step).max() <= _NEWTON_TOLERANCE * f0:
            return frequencies
    raise NetworkError(
        f"state {result.state.name}: no resonance found near {f0:.6g} Hz for a changed inductance matrix; "
        f"the last step of Newton's method was {np.abs(step).max():.3g} Hz."
    )


def _upward_crossing(function: Callable[[FloatArray], FloatArray], grid: FloatArray) -> float | None:
    """Lowest zero that a function crosses upwards between neighbours of a rising grid."""

    def at(point: float) -> float:
        return float(function(np.array([point]))[0])

    for start, stop in ranges(len(grid) - 1, _AT_ONCE):
        part = grid[start : stop + 1]
        values = function(part)
        upward = np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0))
        if upward.size:
            low, high = part[upward[0] : upward[0] + 2].tolist()
            return float(brentq(at, low, high, xtol=1e-12 * low, rtol=1e-14))
    return None


def _bare_inductance(network: Network, state: ScanState) -> float:
    """Inductance of the measured coils joined as in the state, all else left out."""
    chosen = [network.names.index(name) for name, _ in state.measured]
    sense = np.array([sense for _, sense in state.measured], dtype=np.float64)
    L = network.inductance[np.ix_(chosen, chosen)] * np.outer(sense, sense)
    if state.connection == "series":
        return float(L.sum())
    return float(1 / np.linalg.inv(L).sum())


@dataclass(frozen=True)
class _Circuit:
    """Everything but the coils: branches of an impedance, which may be zero, and capacitors, by names of nodes."""

    branches: list[tuple[str, str, complex | npt.NDArray[np.complexfloating]]]
    capacitors: list[tuple[str, str, float | FloatArray]]


def _solve(
    network: Network, state: ScanState, frequencies: FloatArray, across: FloatArray, inductances: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """Impedances (f,) between the converter's sides in Ω and the coils' currents (f, n) in A per A fed in there.

    `inductances` (n, n) and the capacitances `across` the coils (n,) may have one more axis in front, (f,).
    """
    omega = 2 * math.pi * frequencies
    circuit = _wire(network, state, omega, across)
    coils = [(f"{name}.1", f"{name}.2") for name in network.names]
    pairs = [*coils, *((a, b) for a, b, _ in circuit.branches), *((a, b) for a, b, _ in circuit.capacitors)]
    number: dict[str, int] = {_GROUND: 0, "converter A": 1, "converter B": 2}
    ends = np.array([[number.setdefault(name, len(number)) for name in pair] for pair in pairs])
    reference = _references(ends)
    # in units of the first coil's reactance all entries are of order one
    unit = omega * network.inductance[0, 0]
    nodes, n, branches = len(number), len(coils), len(coils) + len(circuit.branches)
    require_memory(
        _BYTES_AN_ENTRY * len(omega) * (nodes + branches) ** 2, f"the circuit of {n} coils at {len(omega)} frequencies"
    )
    matrix = np.zeros((len(omega), nodes + branches, nodes + branches), dtype=np.complex128)
    for k, (a, b) in enumerate(ends[:branches].tolist()):
        matrix[:, [a, nodes + k], [nodes + k, a]] += 1
        matrix[:, [b, nodes + k], [nodes + k, b]] -= 1
    for (a, b), (_, _, farads) in zip(ends[branches:].tolist(), circuit.capacitors, strict=True):
        admittance = (1j * omega * farads * unit)[:, None]
        matrix[:, [a, b], [a, b]] += admittance
        matrix[:, [a, b], [b, a]] -= admittance
    R = np.array([network.resistance(frequency) for frequency in frequencies.tolist()])
    matrix[:, nodes : nodes + n, nodes : nodes + n] = (
        -(R + 1j * omega[:, None, None] * inductances) / unit[:, None, None]
    )
    for k, (_, _, impedance) in enumerate(circuit.branches):
        matrix[:, nodes + n + k, nodes + n + k] = -impedance / unit
    source = np.zeros((matrix.shape[1], 1), dtype=np.complex128)
    source[1], source[2] = 1, -1
    keep = np.setdiff1d(np.arange(len(source)), reference)
    solution = np.zeros(matrix.shape[:2], dtype=np.complex128)
    try:
        solution[:, keep] = np.linalg.solve(matrix[:, keep[:, None], keep], source[keep])[..., 0]
    except np.linalg.LinAlgError:
        raise NetworkError(f"state {state.name} makes a singular network at {frequencies[0]:.6g} Hz.") from None
    return (solution[:, 1] - solution[:, 2]) * unit, solution[:, nodes : nodes + n]


def _wire(network: Network, state: ScanState, omega: FloatArray, across: FloatArray) -> _Circuit:
    """Connect every element of the circuit but the coils."""
    switches = network.switches
    branches: list[tuple[str, str, complex | npt.NDArray[np.complexfloating]]] = []
    capacitors: list[tuple[str, str, float | FloatArray]] = []
    for (name, nets), farads in zip(_nets(network.names, state).items(), np.moveaxis(across, -1, 0), strict=True):
        for end, closed in enumerate(nets, start=1):
            terminal = f"{name}.{end}"
            if closed:
                branches.append((terminal, closed, switches.on_resistance))
            capacitors += [
                (terminal, net, switches.off_capacitance) for net in (_SIDE_A, _SIDE_B, _GROUND) if net != closed
            ]
            capacitors.append((terminal, _GROUND, switches.terminal_capacitance))
        if _passive(state, name) == "load":
            branches.append((f"{name}.1", f"{name}.2", state.load_resistance))
        capacitors.append((f"{name}.1", f"{name}.2", farads))
    mutual = network.mutual_capacitance
    for i, j in combinations(range(len(network.names)), 2):
        a, b, farads = network.names[i], network.names[j], float(mutual[i, j])
        capacitors += [(f"{a}.{end}", f"{b}.{other}", farads / 4) for end in (1, 2) for other in (1, 2)]
        capacitors += [(f"{coil}.1", f"{coil}.2", -farads / 6) for coil in (a, b)]
    for side in (_SIDE_A, _SIDE_B):
        branches.append((f"converter {side}", side, 1j * omega * switches.lead_inductance))
        capacitors.append((side, _GROUND, switches.bus_capacitance))
    return _Circuit(branches, [capacitor for capacitor in capacitors if np.any(capacitor[2])])


def _passive(state: ScanState, name: str) -> Passive | None:
    """Say what closes a coil; None where it is measured."""
    if any(name == measured for measured, _ in state.measured):
        return None
    return state.exceptions.get(name, state.others)


def _nets(names: Sequence[str], state: ScanState) -> dict[str, tuple[str, str]]:
    """Net of both terminals of every coil in the order of `names`; empty where the terminal is open."""
    nets: dict[str, tuple[str, str]] = {}
    closed: dict[Passive, tuple[str, str]] = {
        "ground": (_GROUND, _GROUND),
        "ground one end": (_GROUND, ""),
        "ground other end": ("", _GROUND),
        "open": ("", ""),
        "load": ("", ""),
    }
    for name in names:
        passive = _passive(state, name)
        if passive is not None:
            nets[name] = closed[passive]
    last = len(state.measured) - 1
    for k, (name, sense) in enumerate(state.measured):
        series = state.connection == "series"
        first = _SIDE_A if k == 0 or not series else f"link {k}"
        second = _SIDE_B if k == last or not series else f"link {k + 1}"
        nets[name] = (first, second) if sense == 1 else (second, first)
    return {name: nets[name] for name in names}


def _references(ends: npt.NDArray[np.int64]) -> list[int]:
    """One node of every part of the circuit that nothing joins to the others: no current can leave there."""
    count = int(ends.max()) + 1
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    parts, label = connected_components(graph, directed=False)
    return [int(np.flatnonzero(label == part)[0]) for part in range(parts)]
