"""Closed forms of coils of constant R and L, which check the network.

With jωL the inductance matrix, R the coils' resistances and Z_p the terminations of the passive coils p, the active
coil a sees Z = R_a + jωL_aa + ω² M_ap (R_p + Z_p + jωL_pp)⁻¹ M_pa.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from coilarray.circuit.coupling import Termination
from coilarray.circuit.network import checked_network
from coilarray.compute.arrays import ComplexArray, FloatArray


@dataclass(frozen=True, eq=False)
class ActiveCoil:
    """Impedance of an active coil in Ω, the currents (n,) per ampere of it, and the parts Re(M_ak i_k) in H."""

    frequency: float
    impedance: complex
    currents: ComplexArray
    contributions: FloatArray

    @property
    def apparent_inductance(self) -> float:
        return self.impedance.imag / (2 * math.pi * self.frequency)

    @property
    def effective_resistance(self) -> float:
        return self.impedance.real


def active_coil(
    inductance: npt.ArrayLike,
    resistance: npt.ArrayLike,
    active: int,
    frequency: float,
    terminations: Sequence[Termination] | None = None,
    short_resistance: float = 0.0,
) -> ActiveCoil:
    """Solve the array with one active coil, the others "short" (by default) or "open"."""
    L, R = checked_network(inductance, resistance)
    states = terminations or ["short"] * len(L)
    shorted = [k for k in range(len(L)) if k != active and states[k] == "short"]
    Z = np.diag(R) + 2j * math.pi * frequency * L
    currents = np.zeros(len(L), dtype=np.complex128)
    currents[active] = 1
    if shorted:
        passive = Z[np.ix_(shorted, shorted)] + short_resistance * np.eye(len(shorted))
        currents[shorted] = np.linalg.solve(passive, -Z[shorted, active])
    contributions = np.real(L[active] * currents)
    contributions[active] = 0
    return ActiveCoil(frequency, complex(Z[active] @ currents), currents, contributions)
