"""The coupling of an array: every coil active in turn, its neighbours as terminated."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import metadata

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.active_coil import Termination, all_open, all_shorted, checked_network, resonance
from coilarray.compute.threads import Progress
from coilarray.design.model import Design
from coilarray.elastomer.flat_layer import layer_inductance
from coilarray.electromagnetics.inductance import Accuracy, coupling_matrix, inductance_matrix
from coilarray.electromagnetics.resistance import dc_resistance
from coilarray.errors import NetworkError

FloatArray = npt.NDArray[np.float64]


def couple_design(design: Design, progress: Progress | None = None) -> xr.Dataset:
    """Compute the coupling of a design.

    Parameters
    ----------
    design : Design
        As `coilarray.load_design` returns it.
    progress : callable, optional
        Called with (done, total) as the inductance matrix is computed.

    Returns
    -------
    xarray.Dataset
        As `couple`, under the flat sheets; also ``sheet_inductance`` (coil, other) in H, the part that the magnetic
        sheets have in it, the coils' centres ``x`` and ``y`` in m, and the attributes of `provenance`.

    Examples
    --------
    >>> from coilarray import load_design
    >>> result = couple_design(load_design("gast2020"))
    >>> round(float(result.open_inductance[0]) * 1e6, 1), round(float(result.coupling[0, 1]), 3)
    (58.2, -0.051)
    """
    conductors = design.array.conductors()
    circuit = design.circuit
    inductance, by_sheets = design_inductance(design, progress)
    result = couple(
        design.array.names,
        inductance,
        dc_resistance(conductors, circuit.resistivity),
        circuit.capacitance,
        shorts_of(design),
        circuit.short_resistance,
    )
    result["sheet_inductance"] = (
        ("coil", "other"), by_sheets, {"units": "H", "long_name": "part of the magnetic sheets in the inductance"}
    )  # fmt: skip
    centres = design.array.centres
    result = result.assign_coords(
        x=("coil", centres[:, 0], {"units": "m", "long_name": "centre of the coil, x"}),
        y=("coil", centres[:, 1], {"units": "m", "long_name": "centre of the coil, y"}),
    )
    return result.assign_attrs(provenance(design))


def design_inductance(
    design: Design, progress: Progress | None = None, *, accuracy: Accuracy = "full"
) -> tuple[FloatArray, FloatArray]:
    """Inductance matrix of a design under its flat sheets.

    Parameters
    ----------
    design : Design
        As `coilarray.load_design` returns it.
    progress : callable, optional
        Called with (done, total) as the matrix of the bare board is computed.
    accuracy : {"full", "screen"}
        As in `coilarray.inductance_matrix`.

    Returns
    -------
    inductance : ndarray, shape (n, n)
        In H, the magnetic sheets included.
    by_sheets : ndarray, shape (n, n)
        The part of it that the magnetic sheets make.
    """
    conductors = design.array.conductors()
    by_sheets = layer_inductance(conductors, design.sheets, accuracy=accuracy)
    return inductance_matrix(conductors, progress, accuracy=accuracy) + by_sheets, by_sheets


def shorts_of(design: Design) -> list[Termination]:
    """Return for each coil whether it is a short or open while another one is measured; half a short is open."""
    return ["short" if passive == "ground" else "open" for passive in design.terminations.values()]


def provenance(design: Design) -> dict[str, str]:
    """Return what a result must carry to be repeated: design, its hash and the package's version."""
    return {
        "design": design.name,
        "design_hash": design.digest,
        "coilarray_version": metadata.version("coilarray"),
    }


def couple(
    names: Sequence[str],
    inductance: npt.ArrayLike,
    resistance: npt.ArrayLike,
    capacitance: float,
    terminations: Sequence[Termination] | None = None,
    short_resistance: float = 0.0,
) -> xr.Dataset:
    """Make each coil active in turn, the others closed by their terminations.

    Parameters
    ----------
    names : sequence of str, length n
        Of the coils.
    inductance : array_like, shape (n, n)
        In H.
    resistance : array_like, shape (n,) or scalar
        In Ω.
    capacitance : float
        Of the tank in F.
    terminations : sequence of {"short", "open"}, length n, optional
        Of each coil while it is passive; all shorted by default (the plan of Gast & Zimmermann 2020).
    short_resistance : float
        In Ω.

    Returns
    -------
    xarray.Dataset
        Dimensions ``coil`` (the active one) and ``other``. In SI, units in the attributes: ``inductance``,
        ``coupling``, ``current_real`` and ``current_imag`` (A per A), ``contribution`` to L_eff (coil, other);
        ``resistance``, ``open_inductance``, ``effective_inductance``, ``inductance_change`` (relative),
        ``effective_resistance``, ``quality_factor``, ``open_frequency``, ``frequency`` (coil); and the
        coils' ``termination``.

    Raises
    ------
    NetworkError
        As `resonance`.
    """
    L, R = checked_network(inductance, resistance)
    n = len(names)
    if L.shape != (n, n):
        raise NetworkError(f"{n} names need an inductance matrix of shape ({n}, {n}); got {L.shape}.")
    states = tuple(terminations) if terminations is not None else all_shorted(n)
    solved = [resonance(L, R, a, capacitance, states, short_resistance) for a in range(n)]
    alone = [resonance(L, R, a, capacitance, all_open(n)) for a in range(n)]
    effective = np.array([state.effective_inductance for state in solved])
    own = np.diag(L).copy()
    effective_resistance = np.array([state.effective_resistance for state in solved])
    frequency = np.array([state.frequency for state in solved])
    currents = np.array([state.currents for state in solved])
    with np.errstate(divide="ignore"):
        quality = 2 * np.pi * frequency * effective / effective_resistance
    pair, single = ("coil", "other"), ("coil",)
    return xr.Dataset(
        {
            "inductance": (pair, L, {"units": "H", "long_name": "inductance matrix"}),
            "coupling": (pair, coupling_matrix(L), {"units": "1", "long_name": "coupling coefficient"}),
            "resistance": (single, R, {"units": "ohm", "long_name": "DC resistance"}),
            "open_inductance": (single, own, {"units": "H", "long_name": "inductance, all other coils open"}),
            "effective_inductance": (single, effective, {"units": "H", "long_name": "inductance as terminated"}),
            "inductance_change": (single, effective / own - 1, {"units": "1", "long_name": "L_eff/L - 1"}),
            "effective_resistance": (single, effective_resistance, {"units": "ohm", "long_name": "R as terminated"}),
            "quality_factor": (single, quality, {"units": "1", "long_name": "Q from DC resistances"}),
            "open_frequency": (
                single, np.array([s.frequency for s in alone]), {"units": "Hz", "long_name": "resonance, others open"}
            ),
            "frequency": (single, frequency, {"units": "Hz", "long_name": "resonance as terminated"}),
            "current_real": (pair, currents.real, {"units": "A/A", "long_name": "in-phase current of each coil"}),
            "current_imag": (pair, currents.imag, {"units": "A/A", "long_name": "quadrature current of each coil"}),
            "contribution": (
                pair, np.array([s.contributions for s in solved]), {"units": "H", "long_name": "part in L_eff - L"}
            ),
            "termination": (single, np.array(states, dtype=object), {"long_name": "state while passive"}),
        },
        coords={"coil": list(names), "other": list(names)},
        attrs={"capacitance_F": capacitance, "short_resistance_ohm": short_resistance},
    )  # fmt: skip
