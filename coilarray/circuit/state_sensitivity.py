"""How every state of a scan answers to small changes of the inductance matrix, to first order.

Let Y = (R + jωL)⁻¹ be the admittance matrix of the coils that carry a current, the resistances of the switches that
measure or ground them included. The converter sees Y_aa of the measured coil a beside the capacitor C of the tank and
oscillates where Im Y_aa + ωC = 0. A change ΔL makes ΔY_aa = −jω Y_aa² iᵀ ΔL i with the currents i_p = Y_pa/Y_aa, and
what the converter takes for an inductance, L = 1/(ω²C), changes by

    δ_a = Re(w_a i_aᵀ ΔL i_a),   w_a = −2 Y_aa²/(Im dY_aa/dω + C),

which is ΔL/L for a coil without losses and neighbours. All Y of one group of coils come from one decomposition,
R V = L V ρ with VᵀLV = 1, as Y(ω) = V (ρ + jω)⁻¹ Vᵀ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh

from coilarray.circuit.active_coil import checked_network
from coilarray.design.scan_states import ScanState, Switches, check_state
from coilarray.errors import NetworkError

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
IntArray = npt.NDArray[np.int64]

_NEWTON_STEPS, _NEWTON_TOLERANCE = 40, 1e-12  # relative


@dataclass(frozen=True, eq=False)
class StateSensitivity:
    """States of a scan at their resonances, and what changes of the inductance matrix do to them.

    Parameters
    ----------
    measured : ndarray of int, shape (states,)
        Number of the coil that each state measures.
    base_inductance : ndarray, shape (states,)
        L = 1/(ω²C) in H, as the converter sees it.
    currents : ndarray of complex, shape (coils, states)
        Through every coil in A per A of the measured one.
    weights : ndarray of complex, shape (states,)
        w in 1/H.
    """

    measured: IntArray
    base_inductance: FloatArray
    currents: ComplexArray
    weights: ComplexArray

    def delta(self, change: FloatArray) -> FloatArray:
        """Relative change of every state's inductance, shape (…, states), for changes (…, coils, coils) in H."""
        energy = np.einsum("pa,...pq,qa->...a", self.currents, change, self.currents, optimize=True)
        return np.asarray((self.weights * energy).real)


def state_sensitivity(
    names: Sequence[str],
    inductance: npt.ArrayLike,
    resistance: npt.ArrayLike,
    switches: Switches,
    plan: Sequence[ScanState],
) -> StateSensitivity:
    """Solve every state of a scan at its resonance.

    Parameters
    ----------
    names : sequence of str, length n
        Of the coils.
    inductance : array_like, shape (n, n)
        In H.
    resistance : array_like, shape (n,) or scalar
        In Ω, at all frequencies.
    switches : Switches
        Closed switches and the tank, nothing else.
    plan : sequence of ScanState
        Each measures one coil; every other one is grounded at both ends or open.

    Returns
    -------
    StateSensitivity

    Raises
    ------
    NetworkError
        A state of another kind, switches with stray capacitances or inductances, a matrix of no real coils, or a state
        without a resonance.

    Notes
    -----
    States in which the same coils carry a current share one decomposition: all of a plan that grounds every other coil.

    Examples
    --------
    >>> from coilarray.design.scan_states import paper_plan
    >>> L = [[2e-6, 0.2e-6], [0.2e-6, 2e-6]]
    >>> states = state_sensitivity(("a", "b"), L, 0.0, Switches(), paper_plan(("a", "b")))
    >>> np.round(states.base_inductance * 1e6, 6)  # L (1 − k²)
    array([1.98, 1.98])
    >>> np.round(states.delta(np.diag([1e-9, 0.0])), 6)
    array([5.05e-04, 5.00e-06])
    """
    L, R = checked_network(inductance, resistance)
    _require_bare(switches)
    measured, carrying = _carrying(names, plan)
    omega = np.empty(len(plan))
    weights = np.empty(len(plan), dtype=np.complex128)
    currents = np.zeros((len(L), len(plan)), dtype=np.complex128)
    groups, group_of = np.unique(carrying, axis=0, return_inverse=True)
    for g, group in enumerate(groups):
        coils, states = np.flatnonzero(group), np.flatnonzero(group_of.ravel() == g)
        own = np.searchsorted(coils, measured[states])
        omega[states], weights[states], part = _solve(
            L[np.ix_(coils, coils)], R[coils] + 2 * switches.on_resistance, own, switches.tank_capacitance
        )
        currents[np.ix_(coils, states)] = part
    lost = np.flatnonzero(~(omega > 0))
    if len(lost):
        raise NetworkError(f"state {plan[lost[0]].name} has no resonance: its resistance is too large for its coil.")
    return StateSensitivity(measured, 1 / (omega**2 * switches.tank_capacitance), currents, weights)


def _require_bare(switches: Switches) -> None:
    for what in ("off_capacitance", "terminal_capacitance", "bus_capacitance", "lead_inductance"):
        if getattr(switches, what):
            raise NetworkError(
                f"{what} of the switches must be 0 to treat the states one by one; got {getattr(switches, what):g}."
            )
    if switches.tank_at != "converter":
        raise NetworkError(
            f"the tank must stand at the converter to treat the states one by one; got {switches.tank_at!r}."
        )


def _carrying(names: Sequence[str], plan: Sequence[ScanState]) -> tuple[IntArray, npt.NDArray[np.bool_]]:
    """Find the number of the coil that each state measures, and which coils carry a current in it, (states, coils)."""
    number = {name: k for k, name in enumerate(names)}
    measured = np.zeros(len(plan), dtype=np.int64)
    carrying = np.zeros((len(plan), len(names)), dtype=np.bool_)
    for row, state in enumerate(plan):
        check_state(state, names)
        closed = {state.others, *state.exceptions.values()}
        if len(state.measured) != 1 or not closed <= {"ground", "open"}:
            raise NetworkError(
                f"state {state.name} must measure one coil, every other one grounded or open, to be treated by itself."
            )
        carrying[row] = state.others == "ground"
        for name, passive in state.exceptions.items():
            carrying[row, number[name]] = passive == "ground"
        measured[row] = number[state.measured[0][0]]
        carrying[row, measured[row]] = True
    return measured, carrying


def _solve(
    L: FloatArray, R: FloatArray, measured: IntArray, capacitance: float
) -> tuple[FloatArray, ComplexArray, ComplexArray]:
    """Angular frequencies (states,), not a number without a resonance, w (states,) and currents (coils, states)."""
    rate, V = eigh(np.diag(R), L)
    square = V[measured] ** 2
    omega = 1 / np.sqrt(np.diag(L)[measured] * capacitance)
    step = omega
    for _ in range(_NEWTON_STEPS):
        own, slope = _own_admittance(rate, square, omega)
        step = (own.imag + omega * capacitance) / (slope.imag + capacitance)
        omega = omega - step
    own, slope = _own_admittance(rate, square, omega)
    omega = np.where(np.abs(step) <= _NEWTON_TOLERANCE * omega, omega, np.nan)
    currents = V @ (V[measured] / (rate + 1j * omega[:, None])).T / own
    return omega, -2 * own**2 / (slope.imag + capacitance), currents


def _own_admittance(rate: FloatArray, square: FloatArray, omega: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Y_aa of every state and its slope with ω."""
    pole = 1 / (rate + 1j * omega[:, None])
    return (square * pole).sum(axis=1), (-1j * square * pole**2).sum(axis=1)
