"""Terminations: what every coil of an array looks like from the one that is measured.

One coil is active; each other one is shorted to ground through a resistance, or open. With jωL the inductance matrix,
R the coils' resistances and Z_p the terminations of the passive coils p, the active coil a sees

    Z = R_a + jωL_aa + ω² M_ap (R_p + Z_p + jωL_pp)⁻¹ M_pa,      L_eff = Im Z/ω,      R_eff = Re Z.

For ideal shorts and no resistance this is L_eff = L_aa − M_ap L_pp⁻¹ M_pa.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

Termination = Literal["short", "open"]
"""What closes a passive coil: ``"short"`` to ground, or ``"open"``, nothing."""

_FREQUENCY_STEPS = 50
_FREQUENCY_TOLERANCE = 1e-14


def all_open(count: int) -> tuple[Termination, ...]:
    """Return the terminations of `count` coils that are all open."""
    one: tuple[Termination] = ("open",)
    return one * count


def all_shorted(count: int) -> tuple[Termination, ...]:
    """Return the terminations of `count` coils that are all shorted to ground."""
    one: tuple[Termination] = ("short",)
    return one * count


@dataclass(frozen=True, eq=False)
class ActiveCoil:
    """What one active coil sees; amounts per ampere of its current.

    Parameters
    ----------
    frequency : float
        In Hz, where everything below holds.
    impedance : complex
        Of the active coil with its passive neighbours, in Ω.
    currents : ndarray of complex, shape (coils,)
        In A per A of the active coil: 1 for the active one, 0 for open ones.
    contributions : ndarray, shape (coils,)
        Part of each passive coil in L_eff − L in H: Re(M_ak i_k), 0 for the active one. They add up to L_eff − L.
    """

    frequency: float
    impedance: complex
    currents: ComplexArray
    contributions: FloatArray

    @property
    def effective_inductance(self) -> float:
        """L_eff = Im Z/ω in H."""
        return self.impedance.imag / (2 * math.pi * self.frequency)

    @property
    def effective_resistance(self) -> float:
        """R_eff = Re Z in Ω."""
        return self.impedance.real


def active_coil(
    inductance: npt.ArrayLike,
    resistance: npt.ArrayLike,
    active: int,
    frequency: float,
    terminations: Sequence[Termination] | None = None,
    short_resistance: float = 0.0,
) -> ActiveCoil:
    """Solve the array with one active coil.

    Parameters
    ----------
    inductance : array_like, shape (n, n)
        Inductance matrix in H.
    resistance : array_like, shape (n,) or scalar
        Of each coil in Ω.
    active : int
        Index of the coil that carries the measuring current.
    frequency : float
        In Hz.
    terminations : sequence of {"short", "open"}, length n, optional
        Of each coil while it is passive; the active one's is not used. All shorted by default.
    short_resistance : float
        Resistance in Ω of a short to ground, the switches included.

    Returns
    -------
    ActiveCoil

    Raises
    ------
    ValueError
        Shapes that do not fit, an index out of range, or a frequency or resistance that is not allowed.

    Examples
    --------
    >>> result = active_coil([[2e-6, 1e-6], [1e-6, 2e-6]], 0.0, 0, 1e6)
    >>> round(result.effective_inductance * 1e6, 6)  # L (1 − k²)
    1.5
    """
    L, R = checked_network(inductance, resistance)
    n = len(L)
    states = ["short"] * n if terminations is None else list(terminations)
    if len(states) != n or not set(states) <= {"short", "open"}:
        raise ValueError(f"terminations must be {n} of 'short' or 'open'; got {states}.")
    if not 0 <= active < n:
        raise ValueError(f"the active coil must be 0 to {n - 1}; got {active}.")
    if not (math.isfinite(frequency) and frequency > 0):
        raise ValueError(f"frequency must be positive and finite; got {frequency} Hz.")
    if not (math.isfinite(short_resistance) and short_resistance >= 0):
        raise ValueError(f"short_resistance must be finite and not negative; got {short_resistance} Ω.")
    omega = 2 * math.pi * frequency
    shorted = [k for k in range(n) if k != active and states[k] == "short"]
    currents = np.zeros(n, dtype=np.complex128)
    currents[active] = 1
    if shorted:
        passive = 1j * omega * L[np.ix_(shorted, shorted)] + np.diag(R[shorted] + short_resistance)
        currents[shorted] = np.linalg.solve(passive, -1j * omega * L[shorted, active])
    impedance = complex(R[active] + 1j * omega * (L[active] @ currents))
    contributions = np.real(L[active] * currents)
    contributions[active] = 0
    return ActiveCoil(frequency, impedance, currents, contributions)


def resonance(
    inductance: npt.ArrayLike,
    resistance: npt.ArrayLike,
    active: int,
    capacitance: float,
    terminations: Sequence[Termination] | None = None,
    short_resistance: float = 0.0,
) -> ActiveCoil:
    """Solve the array where the active coil resonates with its capacitor, f = 1/(2π √(L_eff(f) C)).

    Parameters
    ----------
    inductance, resistance, active, terminations, short_resistance
        As in `active_coil`.
    capacitance : float
        In F, across the active coil.

    Returns
    -------
    ActiveCoil

    Raises
    ------
    ValueError
        As `active_coil`; also a capacitance that is not positive and finite.
    RuntimeError
        No convergence, which needs passive coils far stronger than coils can be.

    Examples
    --------
    >>> round(resonance([[50e-6]], 0.0, 0, 120e-12).frequency / 1e6, 4)
    2.0547
    """
    if not (math.isfinite(capacitance) and capacitance > 0):
        raise ValueError(f"capacitance must be positive and finite; got {capacitance} F.")
    L, R = checked_network(inductance, resistance)
    if not 0 <= active < len(L):
        raise ValueError(f"the active coil must be 0 to {len(L) - 1}; got {active}.")
    frequency = 1 / (2 * math.pi * math.sqrt(L[active, active] * capacitance))
    for _ in range(_FREQUENCY_STEPS):
        state = active_coil(L, R, active, frequency, terminations, short_resistance)
        following = 1 / (2 * math.pi * math.sqrt(state.effective_inductance * capacitance))
        if abs(following - frequency) <= _FREQUENCY_TOLERANCE * frequency:
            return state
        frequency = following
    raise RuntimeError(f"the resonance of coil {active} did not converge in {_FREQUENCY_STEPS} steps.")


def checked_network(inductance: npt.ArrayLike, resistance: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return an inductance matrix, shape (n, n) in H, and resistances, shape (n,) in Ω, that can belong together.

    Raises
    ------
    ValueError
        Shapes that do not fit, values that are not finite, a diagonal that is not positive, a negative resistance.
    """
    L = np.asarray(inductance, dtype=np.float64)
    if L.ndim != 2 or L.shape[0] != L.shape[1] or not L.size:
        raise ValueError(f"an inductance matrix must be square; got shape {L.shape}.")
    if not np.isfinite(L).all() or not (np.diag(L) > 0).all():
        raise ValueError("an inductance matrix must be finite with a positive diagonal.")
    try:
        R = np.array(np.broadcast_to(np.asarray(resistance, dtype=np.float64), (len(L),)))
    except ValueError:
        raise ValueError(f"resistance must be one number or {len(L)}; got shape {np.shape(resistance)}.") from None
    if not (np.isfinite(R).all() and (R >= 0).all()):
        raise ValueError(f"resistances must be finite and not negative; got {R.min()} Ω.")
    return L, R
