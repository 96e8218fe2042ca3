"""Capacitors that match or compensate the coils of a link.

Two networks match a source or load to a coil of less resistance: a capacitor across the coil, and
one in series (the usual antenna of NFC), or the one in series at the coil. The four topologies of
wireless power name the capacitors of the first and of the second coil, S in series or P in
parallel: SS, SP, PS and PP.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt
from scipy.optimize import root

from coilarray.circuit.ports import PortCircuit, input_impedance, port_impedance
from coilarray.compute.arrays import FloatArray
from coilarray.design.ports import Port
from coilarray.errors import NetworkError, require_positive

Topology = Literal["SS", "SP", "PS", "PP"]  # compensation of the first and the second coil, in series or in parallel
Series = Literal["E12", "E24", "E96"]  # series of standard values (IEC 60063)
_E24 = (1.0, 1.1, 1.2, 1.3, 1.5, 1.6, 1.8, 2.0, 2.2, 2.4, 2.7, 3.0, 3.3, 3.6, 3.9, 4.3, 4.7, 5.1, 5.6, 6.2, 6.8, 7.5,
        8.2, 9.1)  # fmt: skip
_VALUES = {"E12": _E24[::2], "E24": _E24, "E96": tuple(round(10 ** (k / 96), 2) for k in range(96))}
TOLERANCES = {"E12": 0.1, "E24": 0.05, "E96": 0.01}  # relative tolerance that goes with each series
_MATCHED = 1e-9  # of the resistance
_MOST_CORNERS = 12  # capacitors


def standard_value(value: float, series: Series = "E24") -> float:
    """Return the nearest value of a series, by ratio.

    >>> standard_value(104e-12), standard_value(104e-12, "E96"), standard_value(9.9e-9, "E12")
    (1e-10, 1.05e-10, 1e-08)
    """
    if series not in get_args(Series):
        raise NetworkError(f"series must be one of {', '.join(get_args(Series))}; got {series!r}.")
    require_positive("a value of a series", value, "", NetworkError)
    decade = math.floor(math.log10(value))
    steps = (*_VALUES[series], 10.0)
    return float(f"{min(steps, key=lambda step: abs(math.log(step * 10.0**decade / value)))}e{decade}")


def l_match(
    impedance: complex, frequency: float, resistance: float = 50.0, parallel_at: Literal["coil", "terminals"] = "coil"
) -> tuple[float, float]:
    """Return the capacitors that make a coil look like a resistance.

    The parallel capacitor across the coil raises the resistance to the wanted one, and the series
    capacitor cancels the reactance that is left. In the other order the series capacitor leaves
    just the reactance X for which R + X²/R is the wanted resistance, and the parallel capacitor
    cancels it (D. M. Pozar, Microwave Engineering, section 5.1).

    The `impedance` of the coil in Ω, with all that is coupled to it, holds at the `frequency` in
    Hz. The wanted `resistance` is in Ω, and `parallel_at` is the place of the parallel capacitor.
    Returned are the series and the parallel capacitance in F. Raises NetworkError for a coil that
    is no inductance with losses, or a resistance that two capacitors do not reach.

    >>> series, parallel = l_match(1 + 100j, 13.56e6)
    >>> f"{series * 1e12:.2f} pF, {parallel * 1e12:.1f} pF"
    '16.64 pF, 100.8 pF'
    """
    R, X = impedance.real, impedance.imag
    omega = 2 * math.pi * frequency
    require_positive("frequency of a match", frequency, " Hz", NetworkError)
    require_positive("resistance of a match", resistance, " Ω", NetworkError)
    if not (R > 0 and X > 0):
        raise NetworkError(f"a match needs a coil with losses, R + jX of positive parts; got {R:.4g} {X:+.4g}j Ω.")
    most = R + X * X / R
    if not R < resistance < most:
        raise NetworkError(
            f"two capacitors match a coil of {R:.4g} {X:+.4g}j Ω to more than {R:.4g} Ω and less than {most:.4g} Ω; "
            f"got {resistance:g} Ω."
        )
    if parallel_at == "coil":
        G, B = R / (R * R + X * X), -X / (R * R + X * X)
        left = -math.sqrt(G / resistance - G * G)  # susceptance beside the parallel capacitor
        return G / (omega * resistance * -left), (left - B) / omega
    left = math.sqrt(R * resistance - R * R)  # reactance behind the series capacitor
    return 1 / (omega * (X - left)), left / (omega * (R * R + left * left))


def matched_port(circuit: PortCircuit, impedance: npt.ArrayLike, coil: str) -> PortCircuit:
    """Match the port of a coil to its source or load with two capacitors.

    The other ports of the `circuit` stay as they are, and losses of the capacitors count. The
    `impedance` matrix (n, n) of the coils in Ω is that at the frequency of the link, and `coil` the
    name of the coil. A coil without source or load, or a resistance that `l_match` does not reach,
    raises a NetworkError.
    """
    port = next((port for port in circuit.active if port.coil == coil), None)
    if port is None:
        there = ", ".join(port.coil for port in circuit.active) or "none"
        raise NetworkError(f"a match needs a port with source_ohm or load_ohm, which {there} have; got {coil!r}.")
    wanted = float(port.resistance or 0.0)
    guess = l_match(_at_coil(circuit, impedance, port), circuit.frequency, wanted, port.parallel_at)

    def made(logarithms: FloatArray) -> PortCircuit:
        return _with_port(circuit, port.with_capacitors(*np.exp(logarithms).tolist()))

    def missed(logarithms: FloatArray) -> list[float]:
        Z = _at_terminals(made(logarithms), impedance, port) / wanted
        return [Z.real - 1, Z.imag]

    found = root(missed, np.log(guess), tol=_MATCHED)
    if not np.abs(missed(found.x)).max() < 1e3 * _MATCHED:
        raise NetworkError(
            f"two capacitors of quality {port.capacitor_quality:g} do not match {coil} to {wanted:g} Ω; the nearest "
            f"has {_at_terminals(made(found.x), impedance, port):.4g} Ω."
        )
    return made(found.x)


def compensated(circuit: PortCircuit, impedance: npt.ArrayLike, topology: Topology) -> PortCircuit:
    """Compensate the reactances of a link with one capacitor at each coil.

    The capacitor of the coil with the load resonates with its inductance. The capacitor of the coil
    with the source makes its terminals a resistance, with the load as it is. Without losses these
    are the values of Wang, Covic & Stielau (IEEE Trans. Ind. Electron. 51, 148, 2004) for the
    `topology`. The `circuit` has one source and one load, and the `impedance` matrix (n, n) of the
    coils in Ω is that at the frequency of the link. Another topology or number of sources and
    loads, or a load that makes the coil with the source a capacitance, raise a NetworkError.
    """
    if topology not in get_args(Topology):
        raise NetworkError(f"topology must be one of {', '.join(get_args(Topology))}; got {topology!r}.")
    if len(circuit.sources) != 1 or len(circuit.loads) != 1:
        raise NetworkError(
            f"a compensated link has one source_ohm and one load_ohm in circuit.ports; got {len(circuit.sources)} and "
            f"{len(circuit.loads)}."
        )
    omega = 2 * math.pi * circuit.frequency
    first, second = circuit.active[circuit.sources[0]], circuit.active[circuit.loads[0]]
    bare = circuit.without_capacitors()
    own = complex(port_impedance(bare, impedance, circuit.frequency)[circuit.loads[0], circuit.loads[0]])
    if not own.imag > 0:
        raise NetworkError(f"no capacitor compensates {second.coil}, which is a capacitance by itself: {own:.4g} Ω.")
    circuit = _with_port(circuit, _compensating(second, topology[1], 1 / (omega * own.imag)))
    seen = _at_coil(circuit, impedance, first)
    reactance = seen.imag if topology[0] == "S" else abs(seen) ** 2 / seen.imag
    if not reactance > 0:
        raise NetworkError(
            f"no capacitor compensates {first.coil}: with {second.coil} and its load it is {seen:.4g} Ω, a capacitance."
        )
    return _with_port(circuit, _compensating(first, topology[0], 1 / (omega * reactance)))


def with_standard_values(circuit: PortCircuit, series: Series = "E24") -> PortCircuit:
    """Return the `circuit` with the nearest values of a `series` for all capacitors."""
    return _with_values(circuit, [standard_value(C, series) for _, _, C in capacitors(circuit)])


def tolerance_corners(circuit: PortCircuit, tolerance: float) -> Iterator[PortCircuit]:
    """Yield the `circuit` with every capacitor at either end of its tolerance.

    The relative `tolerance`, for example of `TOLERANCES`, is above 0 and below 1. More than twelve
    capacitors raise a NetworkError.
    """
    if not 0 < tolerance < 1:
        raise NetworkError(f"tolerance of capacitors must be above 0 and below 1; got {tolerance:g}.")
    found = capacitors(circuit)
    if len(found) > _MOST_CORNERS:
        raise NetworkError(f"tolerances are combined for at most {_MOST_CORNERS} capacitors; got {len(found)}.")
    for signs in itertools.product((-1, 1), repeat=len(found)):
        yield _with_values(circuit, [(1 + tolerance * sign) * C for sign, (_, _, C) in zip(signs, found, strict=True)])


def capacitors(circuit: PortCircuit) -> list[tuple[str, str, float]]:
    """Return coil, "series" or "parallel", and capacitance in F of every capacitor."""
    return [
        (port.coil, kind, C)
        for port in circuit.ports
        for kind, C in zip(("series", "parallel"), port.capacitances, strict=True)
        if C is not None
    ]


def _with_values(circuit: PortCircuit, values: Iterable[float]) -> PortCircuit:
    left = iter(values)
    ports = [port.with_capacitors(*(C and next(left) for C in port.capacitances)) for port in circuit.ports]
    return replace(circuit, ports=tuple(ports))


def _with_port(circuit: PortCircuit, port: Port) -> PortCircuit:
    return replace(circuit, ports=tuple(port if one.coil == port.coil else one for one in circuit.ports))


def _compensating(port: Port, kind: str, capacitance: float) -> Port:
    return port.with_capacitors(capacitance, None) if kind == "S" else port.with_capacitors(None, capacitance)


def _at_coil(circuit: PortCircuit, impedance: npt.ArrayLike, port: Port) -> complex:
    """Impedance in Ω of a port's coil, the other ports as they are."""
    bare = port.with_capacitors(None, None)
    return _at_terminals(_with_port(circuit, bare), impedance, bare)


def _at_terminals(circuit: PortCircuit, impedance: npt.ArrayLike, port: Port) -> complex:
    """Impedance in Ω at the terminals of a port."""
    Z = port_impedance(circuit, impedance, circuit.frequency)
    own = next(k for k, one in enumerate(circuit.active) if one.coil == port.coil)
    return complex(input_impedance(circuit, Z)[own])
