"""Touchstone files of an impedance matrix over frequency."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from coilarray.circuit.exchange.spice import plain_names
from coilarray.compute.extras import import_extra
from coilarray.compute.files import write_text
from coilarray.errors import OutputError, require_positive


def touchstone(
    names: Sequence[str],
    impedance: npt.ArrayLike,
    frequencies: npt.ArrayLike,
    path: Path | str,
    *,
    reference_resistance: float = 50.0,
) -> None:
    """Write scattering parameters of an array as Touchstone file.

    The file is of version 1, with real and imaginary parts.

    Parameters
    ----------
    names : sequence of str, length n
        Names of the coils, one port each. The file's comments hold them as `plain_names`.
    impedance : array_like of complex, shape (frequencies, n, n)
        Impedance matrix in Ω, all ports open but the driven port.
    frequencies : array_like, shape (frequencies,)
        Frequencies in Hz, rising. 0 is allowed.
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
        raise ValueError(f"impedance must have shape ({len(f)}, n, n), one matrix per frequency; got {Z.shape}.")
    if not np.isfinite(Z).all():
        raise ValueError("impedances must be finite; at least one is not.")
    if not (np.isfinite(f).all() and f[0] >= 0 and (np.diff(f) > 0).all()):
        raise ValueError("frequencies must be finite, not negative and rising.")
    require_positive("reference_resistance", reference_resistance, " Ω", ValueError)
    ports = plain_names(names, Z.shape[1])
    target = Path(path)
    if target.suffix.lower() != f".s{len(ports)}p":
        raise OutputError(f"a Touchstone file of {len(ports)} ports must end in .s{len(ports)}p; got {target.name}.")
    skrf = import_extra("skrf", "Touchstone files", package="scikit-rf", extra="rf")
    network = skrf.Network(frequency=skrf.Frequency.from_f(f, unit="hz"), z=Z, z0=reference_resistance)
    network.port_names = list(ports)
    write_text(target, network.write_touchstone(target.name, return_string=True, form="ri"))
