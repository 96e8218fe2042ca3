"""Nodal analysis of the array behind its switches.

Any termination of every coil is treated. Each coil is a branch of the coupled impedance Z(ω) = R(ω)
+ jωL between its two terminals, with its winding capacitance across. A terminal goes through a
closed switch to one net (converter side A or B, ground, or a link between coils in series) and
through open switches, as capacitors, to the others. The modified nodal analysis of Ho, Ruehli &
Brennan (IEEE Trans. Circuits Syst. 22, 504, 1975) is used. With the node voltages v, the coils'
currents i and the currents s of the closed switches,

    Y v + A i + B s = j,    Aᵀv = Z i,    Bᵀv = R s.

The voltage of a terminal behind a closed switch is the voltage of its net plus R s, so that s
replaces it among the unknowns. This is exact for any R, zero included.

The surroundings of the coils come first. These are the impedances N between the coils' places c and
the converter p of all the rest, with the tank's capacitance C across each coil, so that nothing
floats. With the capacitances C_w across the coils, the currents for one ampere from the converter
follow from

    (Z + N_cc (1 + jω(C_w − C) Z)) i = N_cp.

Capacitors and resistors have no resonance, so N is as smooth over ω as 1/ω. A few frequencies serve
thousands of circuits that differ in their inductances and, a little, in their frequency.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BarycentricInterpolator
from scipy.optimize import brentq
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from coilarray.compute.arrays import ComplexArray, FloatArray, IntArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import ranges
from coilarray.design.scan_states import Passive, ScanState, Switches, check_state
from coilarray.errors import NetworkError

_SEARCH, _SEARCH_STEP = 30.0, 0.096  # search of a resonance: range around the frequency of the bare coil, and steps
_FINE_POINTS = 172  # steps of 2 %
_BYTES_AN_ENTRY = 48.0  # of a circuit's matrix: the matrix, its copy without the references, and its factors
_ROUNDING = 1e-17  # error of the interpolated values
_MATRIX_VALUES = 1_000_000  # of all circuit matrices solved at once. More do not fit into the caches of a processor
_AT_ONCE = 16  # frequencies. Many at once save time, but a search seldom needs all
SLOPE_STEP = 1e-4  # relative frequency step of the differences for a slope, whose error is 1e-8
NEWTON_STEPS, NEWTON_TOLERANCE = 40, 1e-12  # most Newton steps, and the relative step of convergence
# Secant method: least slope over the first slope, and longest step over the frequency.
_LEAST_SLOPE, _LONGEST_STEP = 0.1, 0.3
_GROUND, _SIDE_A, _SIDE_B = "ground", "A", "B"
_ASYMMETRY = 1e-9  # of k. A matrix exchanged by hand may have lost digits
_LEAST_EIGENVALUE = 1e-12  # of the coupling matrix. Entries are rounded to 1e-16, their rules err by 1e-6


@dataclass(frozen=True, eq=False)
class SampledMatrix:
    """Matrices (f, n, n) at rising frequencies, constant beyond."""

    frequencies: FloatArray
    matrices: FloatArray

    def __call__(self, frequency: float | FloatArray) -> FloatArray:
        """Return the matrices (…, n, n) at frequencies in Hz."""
        f, values = self.frequencies, self.matrices
        if len(f) == 1:
            return np.asarray(values[0])
        k = np.clip(f.searchsorted(frequency) - 1, 0, len(f) - 2)
        share = np.clip((frequency - f[k]) / (f[k + 1] - f[k]), 0.0, 1.0)[..., None, None]
        return np.asarray((1 - share) * values[k] + share * values[k + 1])


@dataclass(frozen=True, eq=False)
class Network:
    """Coils and switches, to be solved in any state.

    `names` are the names of the n coils. The inductance matrix (n, n) is in H. `resistance` takes
    frequencies in Hz and returns matrices (…, n, n) in Ω, or a single matrix for all.
    `winding_capacitance` (n,) lies across each coil, in F. `mutual_capacitance` (n, n) C_ij in F
    between two coils, each at one potential, is symmetric, and its diagonal is not used. `left_out`
    lists the parts of the board's circuit that are not included. `dispersion` is the inductance at
    a frequency less `inductance`, in H.

    The voltage of a coil runs linearly from end to end. If two coils lie above each other, their
    turns cross in all combinations. The energy is then C_ij/2 ((m_i − m_j)² + (d_i² + d_j²)/12)
    with the mean m and the difference d of a coil's two ends. Four capacitors C_ij/4 from end to
    end have d²/4 in place of d²/12. Reducing the capacitance across each coil by C_ij/6 corrects
    this.
    """

    names: tuple[str, ...]
    inductance: FloatArray
    resistance: Callable[[float | FloatArray], FloatArray]
    winding_capacitance: FloatArray
    mutual_capacitance: FloatArray
    switches: Switches
    left_out: tuple[str, ...] = ()
    dispersion: SampledMatrix | None = None

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

    def __repr__(self) -> str:
        names = self.names if len(self.names) <= 6 else (*self.names[:5], "…", self.names[-1])
        low, high = self.inductance.diagonal().min() * 1e6, self.inductance.diagonal().max() * 1e6
        return f"<Network of {len(self.names)} coils: {', '.join(names)}; {low:.4g} to {high:.4g} µH>"


@dataclass(frozen=True, eq=False)
class StateResult:
    """Impedance of one state at one frequency in Hz.

    The `impedance` in Ω is between the sides of the converter without the tank's capacitor. The
    `admittance` in S includes it. `currents` (n,) are in A per A in the first measured coil.
    """

    frequency: float
    impedance: complex
    state: ScanState
    admittance: complex
    currents: ComplexArray

    @property
    def apparent_inductance(self) -> float:
        """Im Z/ω in H."""
        return self.impedance.imag / (2 * math.pi * self.frequency)

    @property
    def effective_resistance(self) -> float:
        """R_eff = Re Z in Ω."""
        return self.impedance.real

    @property
    def quality_factor(self) -> float:
        """Q = Im Z/Re Z without the tank."""
        return self.impedance.imag / self.impedance.real if self.impedance.real > 0 else math.inf

    @property
    def parallel_resistance(self) -> float:
        """R_p = 1/Re Y in Ω, which the converter compensates."""
        return 1 / self.admittance.real if self.admittance.real > 0 else math.inf


@dataclass(frozen=True, eq=False)
class Resonance(StateResult):
    """State at Im Y = 0, where the converter oscillates.

    With the tank across the converter 1/Z = 1/R_p − jωC, so that Q = R_p/(ωL_eff) and R_eff =
    R_p/(1 + Q²) hold exactly. A coil L with a resistance R in series, alone across C, has L_eff = L
    + R²/(ω²L).
    """

    tank_capacitance: float

    @property
    def effective_inductance(self) -> float:
        """L_eff = 1/(ω²C) in H, as the converter takes it."""
        return 1 / ((2 * math.pi * self.frequency) ** 2 * self.tank_capacitance)


def checked_network(inductance: npt.ArrayLike, resistance: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return a valid inductance (n, n) and resistances (n,)."""
    L = np.asarray(inductance, dtype=np.float64)
    if L.ndim != 2 or L.shape[0] != L.shape[1] or not L.size:
        raise NetworkError(f"an inductance matrix must be square; got shape {L.shape}.")
    if not np.isfinite(L).all() or not (np.diag(L) > 0).all():
        raise NetworkError("an inductance matrix must be finite with a positive diagonal.")
    root = np.sqrt(np.diag(L))
    k = L / np.outer(root, root)
    i, j = np.unravel_index(int(np.argmax(np.abs(k - k.T))), k.shape)
    if abs(k[i, j] - k[j, i]) > _ASYMMETRY:
        raise NetworkError(
            f"an inductance matrix must be symmetric; between coils {i + 1} and {j + 1} it has {L[i, j]} H "
            f"and {L[j, i]} H."
        )
    # k has the signs of the eigenvalues of L (Sylvester), whatever the size of the coils.
    values, vectors = np.linalg.eigh((k + k.T) / 2)
    if values[0] <= _LEAST_EIGENVALUE:
        raise NetworkError(
            f"an inductance matrix must be positive definite; the smallest of the {len(k)} eigenvalues of its "
            f"coupling coefficients is {values[0]:.6g}, mostly of coil {int(np.argmax(np.abs(vectors[:, 0]))) + 1}: "
            "two coils are in the same place, or the matrix is not that of real coils."
        )
    try:
        R = np.array(np.broadcast_to(np.asarray(resistance, dtype=np.float64), (len(L),)))
    except ValueError:
        raise NetworkError(f"resistance must be one number or {len(L)}; got shape {np.shape(resistance)}.") from None
    if not (np.isfinite(R).all() and (R >= 0).all()):
        raise NetworkError(f"resistances must be finite and not negative; got {R.min()} Ω.")
    return L, R


def check_frequency(frequency: float | FloatArray) -> None:
    """Refuse frequencies in Hz that are not positive and finite."""
    if not (np.isfinite(frequency) & np.greater(frequency, 0)).all():
        raise NetworkError(f"frequency must be positive and finite; got {frequency} Hz.")


def coil_impedance(network: Network, frequencies: FloatArray) -> ComplexArray:
    """Return the impedance matrices R + jωL (f, n, n) in Ω of the coils alone."""
    L = network.inductance if network.dispersion is None else network.inductance + network.dispersion(frequencies)
    return np.asarray(network.resistance(frequencies) + 2j * np.pi * frequencies[..., None, None] * L)


def floating_capacitance(network: Network) -> FloatArray:
    """Return the capacitance (n,) in F across each coil if all of them float, see `Network`."""
    between = network.mutual_capacitance
    return np.asarray(network.winding_capacitance + (between.sum(axis=1) - np.diag(between)) / 12)


def solve_state(network: Network, state: ScanState, frequency: float) -> StateResult:
    """Solve one state at one frequency in Hz."""
    check_state(state, network.names)
    check_frequency(frequency)
    at = np.array([frequency])
    impedance, currents, admittance = _solve_with_tank(network, _wire(network, state), at, network.inductance)
    first = network.names.index(state.measured[0][0])
    own = currents[0] / (currents[0, first] * state.measured[0][1])
    return StateResult(frequency, complex(impedance[0]), state, complex(admittance[0]), own)


def impedances(network: Network, state: ScanState, frequencies: FloatArray) -> ComplexArray:
    """Return the impedance (f,) in Ω without the tank."""
    check_state(state, network.names)
    check_frequency(frequencies)
    blocks, wiring = ranges(len(frequencies), _AT_ONCE), _wire(network, state)
    return np.concatenate(
        [_solve_with_tank(network, wiring, frequencies[low:high], network.inductance)[0] for low, high in blocks]
    )


def driven(network: Network, state: ScanState, frequencies: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Return the admittance with tank and currents at one volt."""
    switches = network.switches
    at_coil = switches.tank_capacitance if switches.tank_at == "coil" else 0.0
    across = network.winding_capacitance + at_coil
    wiring = _wire(network, state)
    around = _around(network, wiring, frequencies)
    impedance, currents = _solve(network, wiring, around, frequencies, across, network.inductance)
    tank = 0.0 if at_coil else 2j * math.pi * frequencies * switches.tank_capacitance
    return 1 / impedance + tank, currents / impedance[:, None]


def susceptance_slope(network: Network, state: ScanState, frequency: float) -> float:
    """Return the slope of Im Y with tank in S/Hz."""
    low, high = frequency * (1 - SLOPE_STEP), frequency * (1 + SLOPE_STEP)
    below, above = driven(network, state, np.array([low, high]))[0].imag
    return float((above - below) / (high - low))


def _solve_with_tank(
    network: Network, wiring: _Wiring, frequencies: FloatArray, inductances: FloatArray | ComplexArray
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    switches, state = network.switches, wiring.state
    measured = {name for name, _ in state.measured}
    winding = network.winding_capacitance
    at_coil = np.full(len(network.names), switches.tank_capacitance if switches.tank_at == "coil" else 0.0)
    bare_tank = np.array([0.0 if name in measured else c for name, c in zip(network.names, at_coil, strict=True)])
    around = _around(network, wiring, frequencies)
    impedance, currents = _solve(network, wiring, around, frequencies, winding + bare_tank, inductances)
    if not impedance.all():
        raise NetworkError(f"state {state.name} shorts the converter at {frequencies[0]:.6g} Hz.")
    if switches.tank_at == "converter":
        admittance = 1 / impedance + 2j * math.pi * frequencies * switches.tank_capacitance
    else:
        admittance = 1 / _solve(network, wiring, around, frequencies, winding + at_coil, inductances)[0]
    return impedance, currents, admittance


def resonate(network: Network, state: ScanState) -> Resonance:
    """Solve one state at its resonance, Im Y = 0.

    It is sought from a thirtieth of the frequency of the measured coils alone with one tank
    capacitor to thirty times the frequency with all other coils ideally shorted.
    """
    check_state(state, network.names)
    chosen = [network.names.index(name) for name, _ in state.measured]
    sense = np.array([sense for _, sense in state.measured], dtype=np.float64)
    series, inverse = state.connection == "series", np.linalg.inv(network.inductance)[np.ix_(chosen, chosen)]
    bare, shorted = network.inductance[np.ix_(chosen, chosen)], np.linalg.inv(inverse)
    both = [float(sense @ (L if series else np.linalg.inv(L)) @ sense) for L in (bare, shorted)]
    alone, least = both if series else (1 / one for one in both)  # others open, and ideally shorted
    start = 1 / (2 * math.pi * math.sqrt(alone * network.switches.tank_capacitance))
    low, high = start / _SEARCH, start * _SEARCH * math.sqrt(alone / least)
    wiring = _wire(network, state)

    def susceptance(frequencies: FloatArray) -> FloatArray:
        return _solve_with_tank(network, wiring, frequencies, network.inductance)[2].imag

    # Im Y grows through a parallel resonance. If it is not near the start, the lowest counts.
    crossing = _upward_crossing(susceptance, start / 1.3 * np.array([1.0, 1.3**2]))
    if crossing is None:
        points = math.ceil(math.log(high / low) / _SEARCH_STEP) + 1
        crossing = _upward_crossing(susceptance, np.geomspace(low, high, points))
    if crossing is None:
        raise NetworkError(
            f"state {state.name} has no resonance between {low:.4g} and {high:.4g} Hz; "
            f"capacitance_pF is {network.switches.tank_capacitance * 1e12:.4g}."
        )
    return Resonance(**vars(solve_state(network, state, crossing)), tank_capacitance=network.switches.tank_capacitance)


def loaded_quality(network: Network, result: StateResult) -> float:
    """Return the quality (ω/2) (dB/dω)/G of all inductances and capacitances."""
    if result.admittance.real <= 0:
        return math.inf
    return result.frequency / 2 * susceptance_slope(network, result.state, result.frequency) / result.admittance.real


def self_resonance_of(network: Network, result: StateResult) -> float:
    """Return the self-resonance in Hz of a state without tank.

    It is the lowest frequency above a resonance at which the state turns from coil to capacitor, or
    infinite if there is none below 30 times the resonance.
    """
    wiring = _wire(network, result.state)

    def susceptance(frequencies: FloatArray) -> FloatArray:
        return np.asarray((1 / _solve_with_tank(network, wiring, frequencies, network.inductance)[0]).imag)

    # Fine steps, because modes of several coils lie close together.
    crossing = _upward_crossing(susceptance, result.frequency * np.geomspace(1, _SEARCH, _FINE_POINTS))
    return math.inf if crossing is None else crossing


def cases_at_once(network: Network) -> int:
    """Return how many cases of `changed_resonances` fit into memory."""
    return max(1, _MATRIX_VALUES // (2 * len(network.names) + 3) ** 2)


def changed_resonances(
    network: Network,
    result: StateResult,
    inductances: FloatArray | ComplexArray | Callable[[FloatArray], FloatArray | ComplexArray],
    cases: int | None = None,
) -> tuple[FloatArray, ComplexArray, ComplexArray]:
    """Follow a resonance while inductances change.

    `inductances` (cases, n, n) in H, or a function of frequencies (cases,) in Hz, have losses −ΔR/ω
    as imaginary parts. Returns frequencies in Hz, impedances in Ω and admittances with the tank in
    S.
    """
    wiring, f0 = _wire(network, result.state), result.frequency
    if not callable(inductances):
        constant, cases = inductances, len(inductances)

    def solve(at: FloatArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        changed = inductances(at) if callable(inductances) else constant
        return _solve_with_tank(network, wiring, at, changed)

    first = susceptance_slope(network, result.state, f0)
    frequencies: FloatArray = np.full(cases or 1, f0)
    slope, before, step = np.full_like(frequencies, first), np.zeros_like(frequencies), np.zeros_like(frequencies)
    for _ in range(NEWTON_STEPS):
        B, last = solve(frequencies)[2].imag, step
        moved = last != 0
        slope[moved] = (B[moved] - before[moved]) / -last[moved]
        slope[~(slope > _LEAST_SLOPE * first)] = first  # also replaces NaN
        step = np.clip(B / slope, -_LONGEST_STEP * frequencies, _LONGEST_STEP * frequencies)
        frequencies, before = frequencies - step, B
        # Steps shrink: the next is less than this step times its ratio to the last.
        share = np.divide(step, last, out=np.ones_like(step), where=moved)
        settled = np.minimum(np.abs(share), 1.0) * np.abs(step) <= NEWTON_TOLERANCE * f0
        if settled.all():
            impedance, _, admittance = solve(frequencies)
            return frequencies, impedance, admittance
        step[settled] = 0.0
    raise NetworkError(
        f"state {result.state.name}: no resonance found near {f0:.6g} Hz for a changed inductance matrix; the last "
        f"step of the secant method was {np.abs(step).max(initial=0):.3g} Hz."
    )


def _upward_crossing(function: Callable[[FloatArray], FloatArray], grid: FloatArray) -> float | None:
    """Lowest upward zero crossing between neighbours of a grid."""

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


@dataclass(frozen=True, eq=False)
class _Wiring:
    """Nodes of a state, two for each coil.

    A switch or load joins each of the terminals `closed` (k,) to the node of `nets` (k,) with a
    `resistance` (k,) in Ω. `capacitance` (nodes, nodes) in F is the Maxwell matrix of all
    capacitors, with the tank's across every coil in place of the winding's own. `kept` leaves out a
    reference node of every part of the circuit that nothing joins to the others, as no current can
    leave such a part.
    """

    state: ScanState
    closed: IntArray
    nets: IntArray
    resistance: FloatArray
    capacitance: FloatArray
    port: tuple[int, int]
    kept: IntArray


def _solve(
    network: Network,
    wiring: _Wiring,
    around: ComplexArray,
    frequencies: FloatArray,
    across: FloatArray,
    inductances: FloatArray | ComplexArray,
) -> tuple[ComplexArray, ComplexArray]:
    """Impedances (f,) in Ω, and currents (f, n) per ampere.

    `inductances` (n, n) and the capacitances `across` the coils (n,) may have a further axis (f,)
    in front. Imaginary parts of the inductances are losses, −ΔR/ω.
    """
    jw = 2j * math.pi * frequencies[:, None]
    L = inductances if network.dispersion is None else inductances + network.dispersion(frequencies)
    Z = network.resistance(frequencies) + jw[..., None] * L
    more = jw * (across - network.switches.tank_capacitance)
    seen, to_port, at_port = around[:, :-1, :-1], around[:, :-1, -1:], around[:, -1, -1]
    try:
        currents = np.linalg.solve(Z + seen + seen @ (more[..., None] * Z), to_port)
    except np.linalg.LinAlgError:
        raise _singular(wiring, frequencies) from None
    taken = currents + more[..., None] * (Z @ currents)
    leads = jw[:, 0] * 2 * network.switches.lead_inductance  # in series with the converter
    return np.asarray(at_port - (to_port * taken).sum(axis=(1, 2)) + leads), np.asarray(currents[..., 0])


def _around(network: Network, wiring: _Wiring, frequencies: FloatArray) -> ComplexArray:
    """Impedances (f, n + 1, n + 1) in Ω of the coils' places and the converter, see the module."""
    n, nodes = len(network.names), len(wiring.capacitance)
    low, high = float(frequencies.min()), float(frequencies.max())
    half, middle = (high - low) / 2, (high + low) / 2
    # The nearest pole is at the frequency zero. The error is ρ to the power of −points.
    rho = math.inf if high == low else (middle + math.sqrt(low * high)) / half
    points = 1 - math.floor(math.log(_ROUNDING) / math.log(rho))
    few = points < len(frequencies)
    angle = math.pi * (np.arange(points) + 0.5) / points
    at = middle + half * np.cos(angle) if few else frequencies
    require_memory(
        _BYTES_AN_ENTRY * (len(at) * nodes**2 + len(frequencies) * n**2),
        f"the circuit of {n} coils at {len(frequencies)} frequencies",
    )
    # In units of the tank's reactance all entries are of order one.
    tank, kept, closed, nets = network.switches.tank_capacitance, wiring.kept, wiring.closed, wiring.nets
    unit = 1 / (2 * math.pi * at * tank)[:, None, None]
    flat = 1j / tank * wiring.capacitance
    for net in np.unique(nets):
        flat[:, net] += flat[:, closed[nets == net]].sum(axis=1)
    matrix = np.repeat(flat[None], len(at), axis=0)
    matrix[:, :, closed] *= wiring.resistance / unit
    matrix[:, closed, closed] += 1
    matrix[:, nets, closed] -= 1
    plus, minus = (np.append(np.arange(end, 2 * n, 2), wiring.port[end]) for end in (0, 1))
    source = np.zeros((nodes, n + 1))
    source[plus, range(n + 1)], source[minus, range(n + 1)] = 1, -1
    solution = np.zeros((len(at), *source.shape), dtype=np.complex128)
    try:
        solution[:, kept] = np.linalg.solve(matrix[:, kept[:, None], kept], source[kept])
    except np.linalg.LinAlgError:
        raise _singular(wiring, frequencies) from None
    # Maps currents of closed switches to the voltages behind them. A net is behind no switch.
    solution[:, closed] = solution[:, nets] + solution[:, closed] * (wiring.resistance[:, None] / unit)
    found = (solution[:, plus] - solution[:, minus]) * unit
    if not few:
        return found
    weights = (-1.0) ** np.arange(points) * np.sin(angle)
    shares = BarycentricInterpolator(at, np.eye(points), wi=weights)(frequencies)
    return np.asarray(np.einsum("fk,kab->fab", shares, found))


def _singular(wiring: _Wiring, frequencies: FloatArray) -> NetworkError:
    return NetworkError(f"state {wiring.state.name} gives a singular network at {frequencies[0]:.6g} Hz.")


def _wire(network: Network, state: ScanState) -> _Wiring:
    """Connect every element except the capacitances across the coils."""
    switches, n = network.switches, len(network.names)
    number = {_GROUND: 2 * n, _SIDE_A: 2 * n + 1, _SIDE_B: 2 * n + 2}
    nets = _nets(network.names, state)
    for link in sorted({net for pair in nets.values() for net in pair} - {"", *number}):
        number[link] = 2 * n + len(number)
    joined: list[tuple[int, int, float]] = []
    capacitors = [(number[side], number[_GROUND], switches.bus_capacitance) for side in (_SIDE_A, _SIDE_B)]
    for terminal, closed in enumerate(net for pair in nets.values() for net in pair):
        if closed:
            joined.append((terminal, number[closed], switches.on_resistance))
        capacitors += [
            (terminal, number[net], switches.off_capacitance) for net in (_SIDE_A, _SIDE_B, _GROUND) if net != closed
        ]
        capacitors.append((terminal, number[_GROUND], switches.terminal_capacitance))
    measured = {name for name, _ in state.measured}
    passive = {name: state.exceptions.get(name, state.others) for name in network.names if name not in measured}
    loads = [k for k, name in enumerate(network.names) if passive.get(name) == "load"]
    joined += [(2 * k, 2 * k + 1, state.load_resistance) for k in loads]
    nodes, coils = 2 * n + len(number), np.arange(2 * n).reshape(n, 2)
    capacitors += [(first, second, switches.tank_capacitance) for first, second in coils.tolist()]
    capacitance = np.zeros((nodes, nodes))
    capacitance[: 2 * n, : 2 * n] = between_coils(network.mutual_capacitance)
    a, b, farads = (np.array(column) for column in zip(*capacitors, strict=True))
    for rows, columns, sign in ((a, a, 1), (b, b, 1), (a, b, -1), (b, a, -1)):
        np.add.at(capacitance, (rows, columns), sign * farads)
    terminals, ends, resistance = (np.array(column) for column in zip(*joined, strict=True))
    pairs = np.concatenate((coils, np.stack((terminals, ends), axis=1), np.argwhere(capacitance)))
    graph = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(nodes, nodes))
    parts, label = connected_components(graph, directed=False)
    # a reference of every separate part: ground, or a node behind no switch
    free = np.setdiff1d(np.arange(nodes), terminals)
    ground = number[_GROUND]
    references = [ground if label[ground] == part else int(free[label[free] == part][0]) for part in range(parts)]
    kept = np.setdiff1d(np.arange(nodes), references)
    port = number[_SIDE_A], number[_SIDE_B]
    return _Wiring(state, terminals, ends, resistance, capacitance, port, kept)


def between_coils(mutual: FloatArray) -> FloatArray:
    """Maxwell matrix (2n, 2n) in F between coils, see `Network`."""
    apart = mutual - np.diag(np.diag(mutual))
    stamp = np.kron(np.diag(apart.sum(axis=1)), np.eye(2) / 2 - np.array([[1, -1], [-1, 1]]) / 6)
    return np.asarray(stamp - np.kron(apart, np.ones((2, 2)) / 4))


def _nets(names: Sequence[str], state: ScanState) -> dict[str, tuple[str, str]]:
    """Nets of both terminals of every coil, empty if open."""
    closed: dict[Passive, tuple[str, str]] = {
        "ground": (_GROUND, _GROUND),
        "ground one end": (_GROUND, ""),
        "ground other end": ("", _GROUND),
    }
    nets = {name: closed.get(state.exceptions.get(name, state.others), ("", "")) for name in names}
    last, series = len(state.measured) - 1, state.connection == "series"
    for k, (name, sense) in enumerate(state.measured):
        first = _SIDE_A if k == 0 or not series else f"link {k}"
        second = _SIDE_B if k == last or not series else f"link {k + 1}"
        nets[name] = (first, second) if sense == 1 else (second, first)
    return nets
