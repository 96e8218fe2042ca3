"""Touchstone files of an impedance matrix over frequency, and the file of a network by its suffix."""

from __future__ import annotations

import importlib
import math
import re
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.exchange.spice import plain_names, spice_subcircuit
from coilarray.compute.files import write_text
from coilarray.errors import MissingDependencyError, OutputError

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
        Of the coils, one port each; as `plain_names` in the file's comments.
    impedance : array_like of complex, shape (frequencies, n, n)
        Impedance matrix in Ω, all ports open but the driven one.
    frequencies : array_like, shape (frequencies,)
        In Hz, rising; 0 is allowed.
    path : Path or str
        Ends in ``.sNp`` with the number of ports N. Written whole or not at all.
    reference_resistance : float
        Of every port in Ω.

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
    skrf = _scikit_rf()
    network = skrf.Network(frequency=skrf.Frequency.from_f(f, unit="hz"), z=Z, z0=reference_resistance)
    network.port_names = list(ports)
    write_text(target, network.write_touchstone(target.name, return_string=True, form="ri"))


def _scikit_rf() -> ModuleType:
    try:
        return importlib.import_module("skrf")
    except ImportError:
        raise MissingDependencyError(
            'Touchstone files need scikit-rf, which is not installed: pip install "coilarray[rf]".'
        ) from None


def export_network(design_coupling: xr.Dataset, path: Path | str, frequencies: npt.ArrayLike | None = None) -> None:
    """Write the network of a coupling result in the format that the suffix names.

    Parameters
    ----------
    design_coupling : xarray.Dataset
        As `coilarray.couple` or `coilarray.couple_design` returns it.
    path : Path or str
        ``.cir`` or ``.sub``: a SPICE subcircuit; ``.sNp`` with N coils: a Touchstone file of R + jωL at 50 Ω.
    frequencies : array_like, shape (frequencies,), optional
        Of the Touchstone file in Hz; by default 201 from a tenth of the lowest resonance to ten times the highest.

    Raises
    ------
    OutputError
        Another suffix, or a file that cannot be written.
    ValueError, MissingDependencyError
        As `spice_subcircuit` and `touchstone`; also a dataset that is no coupling result.

    Notes
    -----
    The resistances are those of the result, at direct current and the same at every frequency.

    Examples
    --------
    >>> from coilarray import couple
    >>> export_network(couple(["A", "B"], [[2e-6, 1e-6], [1e-6, 2e-6]], 1.0, 1e-9), "array.txt")
    Traceback (most recent call last):
    coilarray.errors.OutputError: a network of 2 coils is written as .cir, .sub or .s2p; got array.txt.
    """
    target = Path(path)
    missing = {"coil", "inductance", "resistance", "frequency"} - set(map(str, design_coupling.variables))
    if missing:
        raise ValueError(f"a coupling result is needed, as coilarray.couple returns it; {min(missing)} is missing.")
    names = [str(name) for name in design_coupling["coil"].values]
    L, R = design_coupling["inductance"].values, design_coupling["resistance"].values
    suffix = target.suffix.lower()
    if suffix in (".cir", ".sub"):
        title = str(design_coupling.attrs.get("design", ""))
        write_text(target, spice_subcircuit(names, L, R, title=title))
    elif re.fullmatch(r"\.s\d+p", suffix):
        if frequencies is None:
            resonances = design_coupling["frequency"].values
            f = np.geomspace(resonances.min() / 10, resonances.max() * 10, _POINTS)
        else:
            f = np.asarray(frequencies, dtype=np.float64)
        touchstone(names, np.diag(R) + 2j * np.pi * f[..., None, None] * L, f, target)
    else:
        raise OutputError(
            f"a network of {len(names)} coils is written as .cir, .sub or .s{len(names)}p; got {target.name}."
        )
