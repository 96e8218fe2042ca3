"""Closed forms for coils of constant R and L.

They hold at one frequency and check `coilarray.circuit.network`. One coil is active. Each other coil is shorted to
ground through a resistance, or open. With jωL the inductance matrix, R the coils' resistances and Z_p the terminations
of the passive coils p, the active coil a sees

    Z = R_a + jωL_aa + ω² M_ap (R_p + Z_p + jωL_pp)⁻¹ M_pa.

For ideal shorts and no resistance Im Z/ω = L_aa − M_ap L_pp⁻¹ M_pa. Capacitance, switches and the tank are left to the
network.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.errors import NetworkError

Termination = Literal["short", "open"]
"""Termination of a passive coil.

It is ``"short"`` to ground, or ``"open"``.
"""

_ASYMMETRY = 1e-9  # of k; a matrix exchanged by hand may have lost digits
_LEAST_EIGENVALUE = 1e-12  # of the coupling matrix; entries are rounded to 1e-16, their rules err by 1e-6


@dataclass(frozen=True, eq=False)
class PortImpedance:
    """Impedance in Ω between two terminals at one frequency.

    The frequency is in Hz.
    """

    frequency: float
    impedance: complex

    @property
    def apparent_inductance(self) -> float:
        """Im Z/ω in H."""
        return self.impedance.imag / (2 * math.pi * self.frequency)

    @property
    def effective_resistance(self) -> float:
        """R_eff = Re Z in Ω."""
        return self.impedance.real


@dataclass(frozen=True, eq=False)
class ActiveCoil(PortImpedance):
    """Impedance and currents of one active coil.

    Its neighbours are passive. Amounts are per ampere of its current. `impedance` is its impedance in Ω at a
    `frequency` in Hz. `currents` (coils,) are 1 for the active coil and 0 for open coils. `contributions` (coils,) are
    the parts of the passive coils in Im Z/ω − L in H: Re(M_ak i_k), and 0 for the active coil.
    """

    currents: ComplexArray
    contributions: FloatArray


@dataclass(frozen=True, eq=False)
class EveryActiveCoil:
    """Impedances and currents with each coil active in turn.

    They hold at one frequency in Hz. `impedances` (n,) in Ω are of each active coil with its passive neighbours. Entry
    (p, a) of `currents` (n, n) is the current in coil p per ampere of the active coil a.
    """

    frequency: float
    impedances: ComplexArray
    currents: ComplexArray

    @property
    def apparent_inductance(self) -> FloatArray:
        """Im Z/ω in H, shape (n,)."""
        return np.asarray(self.impedances.imag / (2 * math.pi * self.frequency))

    @property
    def effective_resistance(self) -> FloatArray:
        """R_eff = Re Z in Ω, shape (n,)."""
        return np.asarray(self.impedances.real)


def impedance_matrix(inductance: npt.ArrayLike, resistance: npt.ArrayLike, frequency: float) -> ComplexArray:
    """Compute the impedance matrix of the coils in Ω.

    Z = R + jωL gives the voltages at their terminals for the currents in them.

    Parameters
    ----------
    inductance, resistance, frequency
        See `active_coil`.

    Returns
    -------
    ndarray of complex, shape (n, n)
        Z in Ω.

    Raises
    ------
    NetworkError
        Shapes that do not fit, a matrix that no real coils have, or a frequency or resistance that is not allowed.

    Examples
    --------
    >>> Z = impedance_matrix([[2e-6, 1e-6], [1e-6, 2e-6]], 3.0, 1e6 / (2 * np.pi))
    >>> np.round(Z, 9)
    array([[3.+2.j, 0.+1.j],
           [0.+1.j, 3.+2.j]])
    """
    L, R = checked_network(inductance, resistance)
    check_frequency(frequency)
    return _impedance(L, R, frequency)


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
        Resistance of each coil in Ω.
    active : int
        Index of the coil that carries the measuring current.
    frequency : float
        Frequency in Hz.
    terminations : sequence of {"short", "open"}, length n, optional
        Termination of each coil while it is passive. The entry of the active coil is not used. All shorted by default.
    short_resistance : float
        Resistance in Ω of a short to ground, the switches included.

    Returns
    -------
    ActiveCoil
        Apparent inductance in H and resistance in Ω of the active coil, and the currents of all.

    Raises
    ------
    NetworkError
        Shapes that do not fit, an index out of range, or a frequency or resistance that is not allowed.

    Examples
    --------
    >>> result = active_coil([[2e-6, 1e-6], [1e-6, 2e-6]], 0.0, 0, 1e6)
    >>> round(result.apparent_inductance * 1e6, 6)  # L (1 − k²)
    1.5
    """
    L, R = checked_network(inductance, resistance)
    shorted = _checked_shorts(len(L), active, terminations, short_resistance)
    check_frequency(frequency)
    Z = _impedance(L, R, frequency)
    currents = np.zeros(len(L), dtype=np.complex128)
    currents[active] = 1
    if shorted:
        passive = Z[np.ix_(shorted, shorted)] + short_resistance * np.eye(len(shorted))
        currents[shorted] = np.linalg.solve(passive, -Z[shorted, active])
    contributions = np.real(L[active] * currents)
    contributions[active] = 0
    return ActiveCoil(frequency, complex(Z[active] @ currents), currents, contributions)


def every_active_coil(
    inductance: npt.ArrayLike, resistance: npt.ArrayLike, frequency: float, short_resistance: float = 0.0
) -> EveryActiveCoil:
    """Solve the array for each coil active in turn.

    All other coils are shorted to ground. One factorisation serves all of them.

    Parameters
    ----------
    inductance, resistance, frequency, short_resistance
        See `active_coil`.

    Returns
    -------
    EveryActiveCoil
        The same quantities for every coil in turn, as arrays.

    Raises
    ------
    NetworkError
        Shapes that do not fit, or a frequency or resistance that is not allowed.

    Notes
    -----
    With the resistance r of a short in series with every coil, also the active one, the admittance matrix of the ports
    is Y = (R + r + jωL)⁻¹. A port with all others shorted shows 1/Y_aa, of which r is the active coil's own, and the
    currents are Y_pa/Y_aa.

    Examples
    --------
    >>> result = every_active_coil([[2e-6, 1e-6], [1e-6, 4e-6]], 0.0, 1e6)
    >>> np.round(result.apparent_inductance * 1e6, 6)  # L (1 − k²)
    array([1.75, 3.5 ])
    """
    L, R = checked_network(inductance, resistance)
    _checked_shorts(len(L), 0, None, short_resistance)
    check_frequency(frequency)
    admittance = np.asarray(np.linalg.inv(_impedance(L, R + short_resistance, frequency)), dtype=np.complex128)
    own = admittance.diagonal()
    return EveryActiveCoil(frequency, 1 / own - short_resistance, admittance / own)


def checked_network(inductance: npt.ArrayLike, resistance: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return a valid inductance matrix and resistances.

    The matrix has shape (n, n) in H, the resistances shape (n,) in Ω. Shapes that do not fit, values that are not
    finite, a diagonal that is not positive, or a negative resistance raise a NetworkError.
    """
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
    # k and L have the same signs of eigenvalues (Sylvester). The eigenvalues of k do not depend on the size of the
    # coils.
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


def checked_terminations(n: int, terminations: Sequence[Termination] | None) -> list[Termination]:
    """Return the termination of each of n passive coils.

    All coils are shorted by default.
    """
    states: list[Termination] = ["short"] * n if terminations is None else list(terminations)
    if len(states) != n or not set(states) <= {"short", "open"}:
        raise NetworkError(f"terminations must be {n} of 'short' or 'open'; got {states}.")
    return states


def _checked_shorts(
    n: int, active: int, terminations: Sequence[Termination] | None, short_resistance: float
) -> list[int]:
    """Return the indices of the passive coils that are shorted."""
    states = checked_terminations(n, terminations)
    if not 0 <= active < n:
        raise NetworkError(f"the active coil must be 0 to {n - 1}; got {active}.")
    if not (math.isfinite(short_resistance) and short_resistance >= 0):
        raise NetworkError(f"short_resistance must be finite and not negative; got {short_resistance} Ω.")
    return [k for k in range(n) if k != active and states[k] == "short"]


def _impedance(L: FloatArray, R: FloatArray, frequency: float) -> ComplexArray:
    return np.asarray(np.diag(R) + 2j * math.pi * frequency * L)
