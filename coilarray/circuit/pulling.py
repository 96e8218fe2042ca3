"""Two converters that run at the same time.

Each converter keeps its own tank oscillating, with a current of constant amplitude in phase with
its voltage. The tanks are coupled by the mutual inductance of their coils. Then the frequencies
are pulled apart, the amplitudes beat, or both oscillate at one frequency of the pair, as in the
locking of a single oscillator (R. Adler, Proc. IRE 34, 351, 1946).

With the voltages v of the tanks, C v̈ + L⁻¹ v = 0 without losses. Of the symmetric matrix
W = C^(−1/2) L⁻¹ C^(−1/2) the eigenvalues are the squared frequencies of the normal modes, and
Ω = W^(1/2) couples the complex amplitudes a of the tanks,

    da/dt = jΩ a − γ (a − A a/|a|),

with the amplitude A of a tank alone and γ = R/(2L). Slowly varying amplitudes leave out about 1/Q²
of the frequency.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

from coilarray.circuit.board_circuit import board_circuit
from coilarray.circuit.network import checked_network, coil_impedance
from coilarray.circuit.ports import PortCircuit, coil_endings, port_impedance
from coilarray.compute.arrays import FloatArray
from coilarray.design.model import Design
from coilarray.design.ports import Port
from coilarray.errors import NetworkError, require_positive

_SETTLED, _BEATS, _SAMPLES = 12.0, 24, 4000  # times 1/γ until the beat is periodic, beats, and samples of them
_LEAST_AMPLITUDE = 1e-6  # of a tank alone, below which its converter has no phase to follow
_SLOWEST = 1e-2  # rate of a lock that is awaited, over the damping
_NEAR = 4.0  # distance of frequencies within which a lock is awaited, over its rate


class Pulling(NamedTuple):
    """Frequencies of two tanks, alone and with both converters running.

    All are in Hz. `alone`, shape (2,), are the resonances, each with the other coil open. `modes`,
    shape (2,), are the normal modes of both tanks, rising, without losses. `together`, shape (2,),
    are the mean frequencies while both run, and `beat` is that of the beat, 0 if both have one
    frequency.
    """

    alone: FloatArray
    modes: FloatArray
    together: FloatArray
    beat: float

    @property
    def shifts(self) -> FloatArray:
        """Relative shifts (2,) of the mean frequencies, without unit."""
        return np.asarray(self.together / self.alone - 1)


def pulling(
    inductance: npt.ArrayLike,
    resistance: npt.ArrayLike,
    capacitance: npt.ArrayLike,
    amplitudes: npt.ArrayLike = (1.0, 1.0),
) -> Pulling:
    """Return what two converters make of each other's frequency.

    Tanks that are much farther apart than k f shift each other by the square of k f over four times
    their distance, as passive tanks do. Closer ones lock near one of the two modes. Of equal tanks
    either mode is stable, and the start decides. Frequencies within 0.005/Q of each other count as
    one.

    The `inductance` matrix (2, 2) of the coils is in H, the `resistance` (2,) in series with them
    in Ω, the `capacitance` (2,) of the tanks, or one for both, in F. Of the `amplitudes` (2,) of
    the tanks alone in V the ratio counts. Raises NetworkError for another number of coils, or
    values that are not positive.

    >>> pair = pulling([[50e-6, 1e-6], [1e-6, 53e-6]], [10.0, 10.0], 120e-12)
    >>> [f"{1e-6 * f:.4f}" for f in (*pair.alone, *pair.together)], f"{pair.beat * 1e-3:.1f} kHz"
    (['2.0547', '1.9957', '2.0607', '1.9903'], '70.4 kHz')
    """
    L, R = checked_network(inductance, resistance)
    if len(L) != 2:
        raise NetworkError(f"two converters need an inductance matrix (2, 2); got {L.shape}.")
    C, V = (np.broadcast_to(np.asarray(one, dtype=np.float64), (2,)) for one in (capacitance, amplitudes))
    for name, values, unit in (("resistance", R, " Ω"), ("capacitance", C, " F"), ("amplitude", V, " V")):
        for value in values.tolist():
            require_positive(f"{name} of a tank", value, unit, NetworkError)
    alone = 1 / np.sqrt(np.diag(L) * C)
    squares, vectors = np.linalg.eigh(np.linalg.inv(L) / np.sqrt(np.outer(C, C)))
    modes = np.sqrt(squares)
    omega = vectors * modes @ vectors.T
    damping, drive = R / (2 * np.diag(L)), np.sqrt(C) * V
    middle = float(np.diag(omega).mean())
    spread = omega - middle * np.eye(2)

    def slope(_: float, state: FloatArray) -> FloatArray:
        a = state[:2] + 1j * state[2:]
        size = np.maximum(np.abs(a), _LEAST_AMPLITUDE * drive)
        moved = 1j * (spread @ a) - damping * (a - drive * a / size)
        return np.concatenate((moved.real, moved.imag))

    gamma, distance = float(damping.min()), abs(omega[1, 1] - omega[0, 0])
    rate = min(max(2 * omega[0, 1] ** 2 / gamma, _SLOWEST * gamma), gamma)  # at which weakly coupled phases lock
    settled = _SETTLED / gamma + (_SETTLED / rate if distance < _NEAR * rate else 0.0)
    end = float(settled + _BEATS * 2 * math.pi / max(distance, rate))
    times = np.linspace(settled, end, _SAMPLES)
    start = drive * np.exp(1j * np.array([0.0, math.pi / 3]))
    found = solve_ivp(
        slope,
        (0.0, end),
        np.concatenate((start.real, start.imag)),
        "DOP853",
        times,
        rtol=1e-8,
        atol=1e-9 * float(drive.mean()),
    )
    phases = np.unwrap(np.angle(found.y[:2] + 1j * found.y[2:]), axis=1)
    apart = phases[1] - phases[0]
    turns = abs(apart[-1] - apart[0]) / (2 * math.pi)
    if turns < 1:  # locked: the last tenth is at rest
        tail = slice(-_SAMPLES // 10, None)
        rate = (phases[:, tail][:, -1] - phases[:, tail][:, 0]).mean() / (times[tail][-1] - times[tail][0])
        together = np.full(2, middle + rate)
    else:  # whole beats, from the first sample on
        whole = np.sign(apart[-1] - apart[0]) * 2 * math.pi * math.floor(turns)
        rising = np.abs(apart - apart[0])
        last = float(np.interp(abs(whole), np.maximum.accumulate(rising), times))
        advance = np.array([np.interp(last, times, phase) - phase[0] for phase in phases])
        together = middle + advance / (last - settled)
    beat = 0.0 if turns < 1 else abs(float(together[1] - together[0])) / (2 * math.pi)
    return Pulling(alone / (2 * math.pi), modes / (2 * math.pi), together / (2 * math.pi), beat)


def converter_pair(design: Design, first: str, second: str) -> Pulling:
    """Return the pulling of two converters at two coils of a design.

    The coils of the `design` are named `first` and `second`. Each has a tank of its own behind two
    closed switches, and the other coils are terminated. Raises NetworkError for an unknown coil, or
    the same coil twice.
    """
    if first == second:
        raise NetworkError(f"two converters need two coils; got {first!r} twice.")
    circuit, switches = board_circuit(design), design.circuit.switches
    ports = Port(first, 1.0), Port(second, 1.0)
    C = switches.across_coil
    own = [circuit.network.inductance[k, k] for k, name in enumerate(circuit.network.names) if name in (first, second)]
    frequency = 1 / (2 * math.pi * math.sqrt(float(np.mean(own or [1.0])) * C))
    there = PortCircuit(circuit.network.names, ports, frequency, coil_endings(design))
    Z = port_impedance(there, coil_impedance(circuit.network, np.array([frequency])), frequency)[0]
    added = circuit.network.winding_capacitance
    across = C + np.array([added[circuit.network.names.index(name)] for name in (first, second)])
    resistance = np.diag(Z).real + design.circuit.short_resistance
    return pulling(Z.imag / (2 * math.pi * frequency), resistance, across)
