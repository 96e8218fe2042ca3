"""Files of a network: SPICE subcircuit or Touchstone file.

The suffix of the file names its format.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import numpy.typing as npt

from coilarray.circuit.exchange.ladder import fit_ladder
from coilarray.circuit.exchange.spice import spice_subcircuit
from coilarray.circuit.exchange.touchstone import touchstone
from coilarray.circuit.network import Network, SampledMatrix
from coilarray.circuit.state_sensitivity import resonances
from coilarray.compute.arrays import FloatArray
from coilarray.compute.files import write_text
from coilarray.design.scan_states import paper_plan
from coilarray.errors import OutputError

_POINTS = 201


def export_network(
    network: Network, path: Path | str, frequencies: npt.ArrayLike | None = None, *, title: str = ""
) -> None:
    """Write the coils of a network to a file.

    The suffix names the format. The switches are left out.

    Parameters
    ----------
    network : Network
        Coils and switches, for example from `coilarray.circuit.coupling.design_circuit`.
    path : Path or str
        ``.cir`` or ``.sub`` for a SPICE subcircuit. ``.sNp`` with N coils for a Touchstone file at 50 Ω, with one port
        per coil.
    frequencies : array_like, shape (frequencies,), optional
        Frequencies of the Touchstone file in Hz. By default 201 from a tenth of the lowest resonance to ten times the
        highest, with each coil in turn and all others grounded.
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
    A subcircuit has the inductance matrix and the capacitances across and between the coils. For every coil it has a
    ladder of positive elements fitted to its resistance at the network's own frequencies (`fit_ladder`), or one
    resistor if there is only one frequency. Its comments give the quality of the fit. A ladder loses inductance as its
    resistance grows, as eddy currents do and the package's L does not. The coil's own inductor is therefore less by the
    ladder's inductance at the coil's resonance, where both agree. The contribution of the coils' eddy currents to each
    other's resistance (1 % of it) is left out. The impedance matrix of a Touchstone file has all of it, every coil
    floating, with the resistance matrix of the network at each frequency.

    Examples
    --------
    >>> from coilarray.circuit.board_circuit import bare_network
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
    across, between = network.winding_capacitance, network.mutual_capacitance
    if suffix in (".cir", ".sub"):
        write_text(target, _subcircuit(network, title))
        return
    f = exchange_frequencies(network) if frequencies is None else np.asarray(frequencies, dtype=np.float64)
    # For floating coils, a capacitance between two adds a twelfth across each, see `Network`.
    apart = between - np.diag(np.diag(between))
    Y_C = np.diag(across + apart.sum(axis=1) / 12)
    R_f = np.array([network.resistance(one) for one in f.ravel().tolist()]).reshape(*f.shape, *L.shape)
    omega = 2 * np.pi * f[..., None, None]
    L_f = L if network.dispersion is None else L + np.array([network.dispersion(one) for one in f.tolist()])
    Z = R_f + 1j * omega * L_f
    touchstone(names, np.linalg.solve(np.eye(len(L)) + 1j * omega * Z @ Y_C, Z), f, target)


def exchange_frequencies(network: Network) -> FloatArray:
    """Frequencies (f,) of a file in Hz.

    They reach from a tenth of the lowest resonance to ten times the highest. These are the resonances of each coil in
    turn with all others grounded. A coil without a resonance raises a NetworkError.
    """
    found = _grounded_resonances(network)
    return np.geomspace(found.min() / 10, found.max() * 10, _POINTS)


def _grounded_resonances(network: Network) -> FloatArray:
    """Resonance frequency of each coil in Hz, shape (n,).

    All other coils are grounded.
    """
    return np.array([one.frequency for one in resonances(network, paper_plan(network.names))])


def _subcircuit(network: Network, title: str) -> str:
    """Write the coils of a network as a SPICE subcircuit.

    Its resistances follow the resistances of the network.
    """
    L, found = network.inductance, _grounded_resonances(network)
    middle = network.resistance(float(np.exp(np.log(found).mean())))
    if not isinstance(network.resistance, SampledMatrix) or len(network.resistance.frequencies) == 1:
        ladders, comments = [], []
        resistance, inductance = np.diag(middle), L
    else:
        f, R = network.resistance.frequencies, np.diagonal(network.resistance.matrices, axis1=1, axis2=2)
        ladders = [fit_ladder(f, own) for own in R.T]
        resistance = np.array([ladder.direct for ladder in ladders])
        extra = np.array([ladder.inductance(at) for ladder, at in zip(ladders, found, strict=True)])
        inductance = L - np.diag(extra)
        misfit = max(np.abs(ladder.resistance(f) / own - 1).max() for ladder, own in zip(ladders, R.T, strict=True))
        drift = max(
            np.abs(ladder.inductance(f) - at_rest).max() / own
            for ladder, at_rest, own in zip(ladders, extra, np.diag(L), strict=True)
        )
        own = np.sqrt(np.diag(middle))
        others = np.abs(middle / np.outer(own, own) - np.eye(len(L))).max()
        comments = [
            f"R(f) of each coil is a ladder of positive elements: from {f[0] / 1e6:.4g} to {f[-1] / 1e6:.4g} MHz "
            f"within {100 * misfit:.2g} %; it changes L by at most {100 * drift:.2g} %, by nothing at the coil's "
            "resonance"
        ]
        if len(L) > 1:
            comments.append(
                f"without what the eddy currents make of each other's resistance, at most {100 * others:.2g} % of it"
            )
    if network.dispersion is not None:
        changes = np.diagonal(network.dispersion.matrices, axis1=1, axis2=2) / np.diag(L)
        span = network.dispersion.frequencies
        comments.append(
            f"L is that at the working frequency; the plates change it by up to {100 * np.abs(changes).max():.2g} % "
            f"from {span[0] / 1e6:.4g} to {span[-1] / 1e6:.4g} MHz"
        )
    comments += [f"without {part}" for part in network.left_out]
    return spice_subcircuit(
        network.names,
        inductance,
        resistance,
        capacitance=network.winding_capacitance,
        mutual_capacitance=network.mutual_capacitance,
        sections=[list(zip(one.resistances.tolist(), one.inductances.tolist(), strict=True)) for one in ladders],
        title=title,
        comments=comments,
    )
