"""Touchstone files of an impedance matrix over frequency, and the file of a network by its suffix."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from coilarray.circuit.exchange.spice import plain_names, spice_subcircuit
from coilarray.circuit.network import Network
from coilarray.circuit.state_sensitivity import resonances
from coilarray.compute.files import write_text
from coilarray.design.scan_states import paper_plan
from coilarray.errors import OutputError
from coilarray.geometry.extras import import_extra

_POINTS = 201


def touchstone(
    names: Sequence[str],
    impedance: npt.ArrayLike,
    frequencies: npt.ArrayLike,
    path: Path | str,
    *,
    reference_resistance: float = 50.0,
) -> None:
    """Write the scattering parameters of an array as a Touchstone file (version 1, real and imaginary parts).

    Parameters
    ----------
    names : sequence of str, length n
        Names of the coils, one port each; as `plain_names` in the file's comments.
    impedance : array_like of complex, shape (frequencies, n, n)
        Impedance matrix in Ω, all ports open but the driven one.
    frequencies : array_like, shape (frequencies,)
        Frequencies in Hz, rising; 0 is allowed.
    path : Path or str
        File that ends in ``.sNp`` with the number of ports N. Written whole or not at all.
    reference_resistance : float
        Resistance of every port in Ω.

    Raises
    ------
    ValueError
        Shapes that do not fit, values that are not finite, frequencies that do not rise, no frequency, a reference
        that is not positive, or names as in `plain_names`.
    OutputError
        Another suffix, or a file that cannot be written.
    MissingDependencyError
        scikit-rf is not installed.

    Notes
    -----
    S = (Z − R₀)(Z + R₀)⁻¹ (Kurokawa, IEEE Trans. MTT 13, 194, 1965, for one real R₀). S has all digits of a double,
    but a port far from R₀ has |S| near 1 and loses about max(|Z|/R₀, R₀/|Z|) in relative precision.

    Examples
    --------
    >>> touchstone(["A"], [[[3 + 600j]]], [2e6], "array.s2p")
    Traceback (most recent call last):
    coilarray.errors.OutputError: a Touchstone file of 1 ports must end in .s1p; got array.s2p.
    """
    Z = np.asarray(impedance, dtype=np.complex128)
    f = np.asarray(frequencies, dtype=np.float64)
    if f.ndim != 1 or not f.size:
        raise ValueError(f"at least one frequency is needed, as one row; got shape {f.shape}.")
    if Z.ndim != 3 or Z.shape[0] != len(f) or Z.shape[1] != Z.shape[2] or not Z.size:
        raise ValueError(f"impedance must have shape ({len(f)}, n, n), a matrix a frequency; got {Z.shape}.")
    if not np.isfinite(Z).all():
        raise ValueError("impedances must be finite; at least one is not.")
    if not (np.isfinite(f).all() and f[0] >= 0 and (np.diff(f) > 0).all()):
        raise ValueError("frequencies must be finite, not negative and rise from one to the next.")
    if not (math.isfinite(reference_resistance) and reference_resistance > 0):
        raise ValueError(f"reference_resistance must be positive and finite; got {reference_resistance} Ω.")
    ports = plain_names(names, Z.shape[1])
    target = Path(path)
    if target.suffix.lower() != f".s{len(ports)}p":
        raise OutputError(f"a Touchstone file of {len(ports)} ports must end in .s{len(ports)}p; got {target.name}.")
    skrf = import_extra("skrf", "Touchstone files", package="scikit-rf", extra="rf")
    network = skrf.Network(frequency=skrf.Frequency.from_f(f, unit="hz"), z=Z, z0=reference_resistance)
    network.port_names = list(ports)
    write_text(target, network.write_touchstone(target.name, return_string=True, form="ri"))


def export_network(
    network: Network, path: Path | str, frequencies: npt.ArrayLike | None = None, *, title: str = ""
) -> None:
    """Write the coils of a network, without its switches, in the format that the suffix names.

    Parameters
    ----------
    network : Network
        Coils and switches, for example from `coilarray.circuit.coupling.design_circuit`.
    path : Path or str
        ``.cir`` or ``.sub``: a SPICE subcircuit; ``.sNp`` with N coils: a Touchstone file at 50 Ω, a port a coil.
    frequencies : array_like, shape (frequencies,), optional
        Frequencies of the Touchstone file in Hz; by default 201 from a tenth of the lowest resonance to ten times the
        highest, those of each coil in turn with all others grounded.
    title : str
        First comment of a subcircuit.

    Raises
    ------
    OutputError
        Another suffix, or a file that cannot be written.
    NetworkError
        A coil without a resonance.
    ValueError, MissingDependencyError
        As `spice_subcircuit` and `touchstone`.

    Notes
    -----
    A subcircuit has the resistance of every coil at the mean resonance, the same at all frequencies, the inductance
    matrix, and the capacitances across and between the coils; what the coils' eddy currents make of each other's
    resistance (1 % of it) is left out. The impedance matrix of a Touchstone file has all of it, every coil floating,
    with the resistance matrix of the network at each frequency.

    Examples
    --------
    >>> from coilarray.circuit.coupling import bare_network
    >>> from coilarray.design.scan_states import Switches
    >>> pair = bare_network(("A", "B"), np.array([[2e-6, 1e-6], [1e-6, 2e-6]]), np.ones(2), Switches())
    >>> export_network(pair, "array.txt")
    Traceback (most recent call last):
    coilarray.errors.OutputError: a network of 2 coils is written as .cir, .sub or .s2p; got array.txt.
    """
    target, names, L = Path(path), network.names, network.inductance
    suffix = target.suffix.lower()
    if suffix not in (".cir", ".sub") and not re.fullmatch(r"\.s\d+p", suffix):
        raise OutputError(
            f"a network of {len(names)} coil{'s' * (len(names) > 1)} is written as .cir, .sub or .s{len(names)}p; "
            f"got {target.name}."
        )
    found = np.array([one.frequency for one in resonances(network, paper_plan(names))])
    across, between = network.winding_capacitance, network.mutual_capacitance
    if suffix in (".cir", ".sub"):
        at = float(np.exp(np.log(found).mean()))
        comments = [f"R at {at:.6g} Hz, constant over frequency: a ladder fitted to R(f) is not written"]
        comments += [f"without {part}" for part in network.left_out]
        R = np.diag(network.resistance(at))
        text = spice_subcircuit(
            names, L, R, capacitance=across, mutual_capacitance=between, title=title, comments=comments
        )
        write_text(target, text)
        return
    if frequencies is None:
        f = np.geomspace(found.min() / 10, found.max() * 10, _POINTS)
    else:
        f = np.asarray(frequencies, dtype=np.float64)
    # floating coils: a capacitance between two adds a twelfth across each, see `Network`
    apart = between - np.diag(np.diag(between))
    Y_C = np.diag(across + apart.sum(axis=1) / 12)
    R_f = np.array([network.resistance(one) for one in f.ravel().tolist()]).reshape(*f.shape, *L.shape)
    omega = 2 * np.pi * f[..., None, None]
    Z = R_f + 1j * omega * L
    touchstone(names, np.linalg.solve(np.eye(len(L)) + 1j * omega * Z @ Y_C, Z), f, target)
