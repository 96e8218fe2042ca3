"""First-order response of scan states to inductance changes.

Many states are solved at once. One volt between the sides of the converter drives the currents i
through the coils. By reciprocity a change ΔL of the inductance matrix changes the admittance there,
the tank included, by ΔY = −jω iᵀ ΔL i. The converter oscillates at B = Im Y = 0, and its value of
the inductance, L = 1/(ω²C), changes by

    δ_a = ΔL/L = −2 Δω/ω = Re(w_a i_aᵀ ΔL i_a),   w_a = −2 y_a²/(dB/dω),

with the currents i_a per ampere of the measured coil and y_a, its own per volt. This is ΔL/L for a
coil without losses and neighbours. Three methods give i and B:

- Coils of constant R and L alone, others grounded or open: all states of a group come from one
  decomposition R V = L V ρ with VᵀLV = 1, as the admittance matrix is Y(ω) = V (ρ + jω)⁻¹ Vᵀ.
- All others grounded, with strays and a resistance that depends on frequency: measuring a coil is
  grounding it at the sides of the converter. The factors of the grounded array serve all states.
  They are sampled at few frequencies and interpolated, as the resonances lie close together.
- Any other state by itself: `coilarray.circuit.network`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BarycentricInterpolator
from scipy.linalg import eigh
from scipy.sparse import csc_array, eye_array
from scipy.sparse.linalg import splu

from coilarray.circuit.network import (
    NEWTON_STEPS,
    NEWTON_TOLERANCE,
    SLOPE_STEP,
    Network,
    Resonance,
    SampledMatrix,
    between_coils,
    driven,
    resonate,
    susceptance_slope,
)
from coilarray.compute.arrays import ComplexArray, FloatArray, IntArray
from coilarray.compute.threads import serial_algebra
from coilarray.design.scan_states import ScanState, check_state
from coilarray.errors import NetworkError

# Frequencies of a group of states: first two far apart, then Chebyshev points. Interpolation over a
# relative half-width w errs by (w/2)^points.
_FAR, _SPAN, _PAD, _POINTS, _ROUNDS = 0.1, 0.02, 2e-3, 6, 20
_FEW = 12  # coils up to which a state by itself costs less than the samples


@dataclass(frozen=True, eq=False)
class StateSensitivity:
    """Scan states at resonance and their response to inductance changes.

    `base_inductance` (states,) is L = 1/(ω²C) in H. `currents` (coils, states) are in A per A of
    the measured coil. `weights` (states,) are the factors w in 1/H.
    """

    measured: IntArray
    base_inductance: FloatArray
    currents: ComplexArray
    weights: ComplexArray

    def delta(self, change: FloatArray) -> FloatArray:
        """Return δ (…, states) by changes of inductances in H."""
        energy = np.einsum("pa,...pq,qa->...a", self.currents, change, self.currents, optimize=True)
        return np.asarray((self.weights * energy).real)


@serial_algebra()
def state_sensitivity(network: Network, states: Sequence[ScanState]) -> StateSensitivity:
    """Solve states that measure one coil each at their resonances."""
    names = network.names
    for state in states:
        check_state(state, names)
        if len(state.measured) != 1:
            raise NetworkError(f"state {state.name} must measure one coil; it measures {len(state.measured)}.")
    omega, slope = np.full(len(states), np.nan), np.empty(len(states))
    currents = np.zeros((len(names), len(states)), dtype=np.complex128)
    for rows, found in _together(network, states, fewest=1):
        omega[rows], slope[rows], currents[:, rows] = found.omega, found.slope, found.currents
        lost = np.flatnonzero(np.isnan(found.omega))
        if len(lost):
            name = states[rows[lost[0]]].name
            raise NetworkError(f"state {name} has no resonance: its resistance is too large for its coil.")
    for row in np.flatnonzero(np.isnan(omega)).tolist():
        frequency = resonate(network, states[row]).frequency
        omega[row], slope[row] = 2 * np.pi * frequency, susceptance_slope(network, states[row], frequency) / (2 * np.pi)
        currents[:, row] = driven(network, states[row], np.array([frequency]))[1][0]
    measured = _measured(network, states)
    own = currents[measured, np.arange(len(states))]
    base = 1 / (omega**2 * network.switches.tank_capacitance)
    return StateSensitivity(measured, base, currents / own, -2 * own**2 / slope)


@serial_algebra()
def resonances(network: Network, states: Sequence[ScanState]) -> list[Resonance]:
    """Solve states as `resonate`, but faster for many coils."""
    for state in states:
        check_state(state, network.names)
    C = network.switches.tank_capacitance
    solved: dict[int, Resonance] = {}
    for rows, found in _together(network, states) if network.switches.tank_at == "converter" else ():
        measured = _measured(network, [states[row] for row in rows])
        for k, row in enumerate(rows):
            omega, admittance = float(found.omega[k]), complex(found.admittance[k])
            if omega > 0:  # else `resonate` decides
                own = found.currents[:, k] / found.currents[measured[k], k] * states[row].measured[0][1]
                impedance = 1 / (admittance - 1j * omega * C)
                solved[row] = Resonance(omega / (2 * np.pi), impedance, states[row], admittance, own, C)
    return [solved[k] if k in solved else resonate(network, state) for k, state in enumerate(states)]


class _States(NamedTuple):
    """Resonances, NaN without any, in 1/s, Y in S, dB/dω in F, i (coils, states) in A/V."""

    omega: FloatArray
    admittance: ComplexArray
    slope: FloatArray
    currents: ComplexArray


def _measured(network: Network, states: Sequence[ScanState]) -> IntArray:
    number = {name: k for k, name in enumerate(network.names)}
    return np.array([number[state.measured[0][0]] for state in states], dtype=np.int64)


def _together(network: Network, states: Sequence[ScanState], fewest: int = _FEW) -> Iterator[tuple[list[int], _States]]:
    """Yield groups for a faster method, coils alone from `fewest` coils on, others from `_FEW`."""
    n, bare = len(network.names), _is_bare(network)
    groups: dict[bytes, list[int]] = {}
    for row, state in enumerate(states):
        passive = {**state.exceptions, **{name: "ground" for name, _ in state.measured}}
        # coils that are measured or grounded at both ends
        closed = np.array([passive.get(name, state.others) == "ground" for name in network.names], dtype=np.bool_)
        plain = bare and n >= fewest and {state.others, *state.exceptions.values()} <= {"ground", "open"}
        if len(state.measured) == 1 and (plain or (n > _FEW and closed.all())):
            groups.setdefault(closed.tobytes(), []).append(row)
    for mask, rows in groups.items():
        measured = _measured(network, [states[row] for row in rows])
        if not bare:
            yield rows, _sampled_states(network, measured)
            continue
        coils = np.flatnonzero(np.frombuffer(mask, dtype=np.bool_))
        some = _bare_states(network, coils, np.searchsorted(coils, measured))
        currents = np.zeros((n, len(rows)), dtype=np.complex128)
        currents[coils] = some.currents
        yield rows, some._replace(currents=currents)


def _is_bare(network: Network) -> bool:
    """Whether a network is of constant R and L only."""
    switches, resistance = network.switches, network.resistance
    strays = (switches.off_capacitance, switches.terminal_capacitance, switches.bus_capacitance)
    capacitance = any(strays) or network.winding_capacitance.any() or network.mutual_capacitance.any()
    constant = isinstance(resistance, SampledMatrix) and len(resistance.frequencies) == 1 and not network.dispersion
    diagonal = constant and np.count_nonzero(resistance(1.0)) == np.count_nonzero(np.diag(resistance(1.0)))
    return bool(diagonal and not capacitance and not switches.lead_inductance and switches.tank_at == "converter")


def _bare_states(network: Network, coils: IntArray, measured: IntArray) -> _States:
    """Solve some coils of constant resistance at once."""
    L = network.inductance[np.ix_(coils, coils)]
    R = np.diag(network.resistance(1.0))[coils] + 2 * network.switches.on_resistance
    capacitance = network.switches.tank_capacitance
    rate, V = eigh(np.diag(R), L)
    square = V[measured] ** 2
    omega = 1 / np.sqrt(np.diag(L)[measured] * capacitance)
    for _ in range(NEWTON_STEPS):
        pole = 1 / (rate + 1j * omega[:, None])
        admittance = (square * pole).sum(axis=1) + 1j * omega * capacitance
        slope = (-1j * square * pole**2).sum(axis=1).imag + capacitance
        step = admittance.imag / slope
        if not (np.abs(step) > NEWTON_TOLERANCE * omega).any():
            break
        omega = omega - step
    omega = np.where((np.abs(step) <= NEWTON_TOLERANCE * omega) & (omega > 0), omega, np.nan)
    return _States(omega, admittance, slope, np.asarray(V @ (V[measured] * pole).T, dtype=np.complex128))


def _sampled_states(network: Network, measured: IntArray) -> _States:
    """Solve coils with strays and any resistance, all others grounded."""
    n, C, count = len(network.names), network.switches.tank_capacitance, len(measured)
    omega = 1 / np.sqrt(np.diag(network.inductance)[measured] * (C + network.winding_capacitance[measured]))
    switches = network.switches
    across = network.winding_capacitance + (C if switches.tank_at == "coil" else 0.0)
    ground = np.full(2 * n, 2 * switches.off_capacitance + switches.terminal_capacitance)
    pairs = np.kron(np.diag(across), [[1, -1], [-1, 1]])
    K = csc_array(between_coils(network.mutual_capacitance) + pairs + np.diag(ground))  # without the converter, in F
    found = _States(omega, np.empty(count, np.complex128), np.empty(count), np.empty((n, count), np.complex128))
    for group in _groups(omega, _FAR, np.empty(0)):  # B = βω − α/ω nearly, from two frequencies
        ends = np.array([omega[group].min() * (1 - _FAR), omega[group].max() * (1 + _FAR)])
        below, above = (_driven_together(network, K, measured[group], at)[0].imag for at in ends)
        alpha, beta = np.linalg.solve(np.stack((-1 / ends, ends), axis=1), np.stack((below, above)))
        omega[group] = np.sqrt(alpha / beta)
    knots = network.resistance.frequencies if isinstance(network.resistance, SampledMatrix) else np.empty(0)
    todo = np.arange(count)
    for _ in range(_ROUNDS):
        missed = []
        for part in _groups(omega[todo], _SPAN, 2 * np.pi * knots):
            group = todo[part]
            low, high = omega[group].min() * (1 - _PAD), omega[group].max() * (1 + _PAD)
            inside = 2 * np.pi * knots[(2 * np.pi * knots > low) & (2 * np.pi * knots < high)]
            middle = float(np.median(omega[group]))
            low, high = max([low, *inside[inside <= middle]]), min([high, *inside[inside > middle]])
            some = _interpolated(network, K, measured[group], omega[group], low, high)
            away = (some.omega < low * (1 - NEWTON_TOLERANCE)) | (some.omega > high * (1 + NEWTON_TOLERANCE))
            for whole, values in zip(found, some, strict=True):
                whole[..., group] = values
            missed.append(group[away])
        todo = np.concatenate(missed)
        if not len(todo):
            return found
    omega[todo] = np.nan
    return found


def _groups(values: FloatArray, span: float, edges: FloatArray) -> Iterator[IntArray]:
    """Yield indices of close values on one side of edges."""
    order, segment = np.argsort(values), np.searchsorted(edges, values)
    while len(order):
        same = (values[order] <= values[order[0]] * (1 + span)) & (segment[order] == segment[order[0]])
        yield order[same]
        order = order[~same]


def _interpolated(
    network: Network, K: csc_array, measured: IntArray, omega: FloatArray, low: float, high: float
) -> _States:
    """Solve states with resonances between two angular frequencies."""
    angle = np.pi * (np.arange(_POINTS) + 0.5) / _POINTS
    nodes = (low + high) / 2 + (high - low) / 2 * np.cos(angle)
    admittances, currents = zip(*(_driven_together(network, K, measured, at) for at in nodes.tolist()), strict=True)
    Y, lagrange = np.array(admittances), BarycentricInterpolator(nodes, np.eye(_POINTS))

    def susceptance(points: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("ak,ka->a", lagrange(points), Y.imag))

    for _ in range(NEWTON_STEPS):
        above, below = (susceptance(omega * (1 + sign * SLOPE_STEP)) for sign in (1, -1))
        slope = (above - below) / (2 * SLOPE_STEP * omega)
        step = susceptance(omega) / slope
        omega = omega - step
        if not (np.abs(step) > NEWTON_TOLERANCE * omega).any():
            break
    omega = np.where((np.abs(step) <= NEWTON_TOLERANCE * omega) & (omega > 0), omega, np.nan)
    shares = lagrange(omega)
    return _States(
        omega,
        np.einsum("ak,ka->a", shares, Y),
        slope,
        np.einsum("ak,kpa->pa", shares, np.array(currents), optimize=True),
    )


def _driven_together(
    network: Network, K: csc_array, measured: IntArray, omega: float
) -> tuple[ComplexArray, ComplexArray]:
    """Admittances (states,) and currents (coils, states) for one volt.

    The terminals t have the voltages v = q − r (jωK v + A i). Here q are the voltages behind their
    closed switches of resistance r, K their capacitances without the converter and A i the coil
    currents that leave them. With the coils' Aᵀ v = Z i and H = (1 + jω r K)⁻¹ this is i = P q, P =
    (Z + r AᵀHA)⁻¹ AᵀH, and the switches carry the currents D q, D = jωK (H − r HA P) + A P. A side
    of the converter also acts through open switches: with κ = jω r c as a part κ of its voltage in
    every q, and by the current s = jωc times the voltage across each.
    """
    n, switches = len(network.names), network.switches
    r, s = switches.on_resistance, 1j * omega * switches.off_capacitance
    kappa = r * s
    H = np.asarray(splu(csc_array(eye_array(2 * n) + 1j * omega * r * K)).solve(np.eye(2 * n, dtype=np.complex128)))
    HA = H[:, 0::2] - H[:, 1::2]
    frequency, L = omega / (2 * np.pi), network.inductance
    Z = network.resistance(frequency) + 1j * omega * (
        L if network.dispersion is None else L + network.dispersion(frequency)
    )
    P = np.asarray(np.linalg.inv(Z + r * (HA[0::2] - HA[1::2])) @ HA.T, dtype=np.complex128)
    total = P.sum(axis=1)  # currents for one volt behind all switches
    ends = P.reshape(n, n, 2)

    def of_own(left: ComplexArray, right: ComplexArray) -> ComplexArray:
        return np.asarray(np.einsum("aei,iaf->aef", left.reshape(n, 2, -1), right.reshape(-1, n, 2), optimize=True))

    coil, sign = np.arange(n), np.array([1, -1])
    KHA, entries = K @ np.ascontiguousarray(HA), K.tocoo()
    KH = np.zeros((n, 2, 2), dtype=np.complex128)  # for each coil's own terminals
    own = entries.row // 2
    np.add.at(KH, (own, entries.row % 2), entries.data[:, None] * H.reshape(2 * n, n, 2)[entries.col, own])
    D = 1j * omega * (KH - r * of_own(KHA, P))
    D = (D + sign[:, None] * ends[coil, coil][:, None, :])[measured]
    sums = 1j * omega * (K @ H.sum(axis=1) - r * KHA @ total) + np.kron(total, sign)
    all_sums, sums = sums.sum(), sums.reshape(n, 2)[measured]
    # Currents that leave A and B for a voltage of one side: H − r HA P = 1 − r D, with sums g.
    g, bus = 1 - r * sums, 1j * omega * switches.bus_capacitance
    rest = kappa * (2 * n - r * all_sums)
    sides = (
        (1 - kappa) * D
        + kappa * sums[:, :, None]
        - s * ((1 - kappa) * g[:, None, :] + rest - (1 - kappa) * (np.eye(2) - r * D) - kappa * g[:, :, None])
    )
    sides += np.eye(2) * (2 * n * s + bus) - s
    (aa, ab), (_, bb) = np.moveaxis(sides, 0, -1)
    common = aa + bb + 2 * ab
    with np.errstate(divide="ignore", invalid="ignore"):  # without strays nothing leads to ground
        mean = np.where(np.abs(common) > 1e-12 * np.abs(aa), -(aa - bb) / (2 * common), 0.0)
    admittance = (aa + bb - 2 * ab) / 4 + (aa - bb) * mean / 2
    plus, minus = ends[:, measured, 0], ends[:, measured, 1]
    currents = (1 - kappa) * (plus * (mean + 0.5) + minus * (mean - 0.5)) + 2 * kappa * mean * total[:, None]
    behind_leads = 1 + 2j * omega * switches.lead_inductance * admittance
    tank = 1j * omega * switches.tank_capacitance if switches.tank_at == "converter" else 0.0
    return admittance / behind_leads + tank, currents / behind_leads
