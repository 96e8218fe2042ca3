"""The scalar potential in flat sheets on the board, one wavenumber at a time.

Above its coil the magnetic field is H = −∇Ψ with Ψ = Σ ψ e^{ik·x} e^{−kz}. In flat sheets each wavenumber keeps its
pattern in the plane and changes only its profile over the height, e^{−kz} → g(z). The electric potential above the
board is the same with permittivities, but for its base: the copper holds it at z = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np

from coilarray.compute.arrays import FloatArray

Base: TypeAlias = Literal["open", "grounded"]
"""What is below z = 0: air, where the field comes from, or electrodes that hold the potential at z = 0."""


def flat_profile(
    wavenumbers: FloatArray,
    z: FloatArray,
    thicknesses: Sequence[float],
    permeabilities: Sequence[float],
    base: Base = "open",
) -> FloatArray:
    """Total potential g(z), shape (n, k), in flat sheets for an incident potential e^{−kz}, or for g(0) = 1.

    `wavenumbers`, shape (k,), of the pattern in the plane are positive, in 1/m; the heights `z`, shape (n,), in m from
    0, the lower face of the lowest sheet. Sheets, with thicknesses in m and relative permeabilities (or
    permittivities), lie upwards from there, and air above. The base is air with an incident potential below ("open"),
    or electrodes at z = 0 that hold the potential 1 ("grounded").

    g and μ ∂g/∂z are continuous. With q = −μ g'/(k g), which is 1 in the air above, each sheet of thickness d changes
    q from its upper to its lower face as a line changes an admittance, q_l = μ (q_u + μ tanh kd)/(μ + q_u tanh kd);
    the incident and the reflected potential below give g(0) = 2/(1 + q). On electrodes of the potential V the energy
    per area is ½ ε0 k q |V|². Written with decaying exponentials only.
    """
    faces = _face_admittances(wavenumbers, thicknesses, permeabilities)
    edges = np.concatenate(([0.0], np.cumsum(thicknesses)))
    profile = np.empty((len(z), len(wavenumbers)))
    below = 2 / (1 + faces[0]) if base == "open" else np.ones_like(wavenumbers)
    for lower, d, mu, upper_q in zip(edges[:-1], thicknesses, permeabilities, faces[1:], strict=True):
        here = (z >= lower) & (z <= lower + d)
        profile[here] = below * _through(wavenumbers, z[here, None] - lower, d, upper_q / mu)
        below = below * _through(wavenumbers, np.array(d), d, upper_q / mu)
    above = z >= edges[-1]
    profile[above] = below * np.exp(-wavenumbers * (z[above, None] - edges[-1]))
    return profile


def reflection(wavenumbers: FloatArray, thicknesses: Sequence[float], permeabilities: Sequence[float]) -> FloatArray:
    """Reflected potential at the lower face of flat sheets, R e^{kz} for an incident e^{−kz}.

    Pattern and sheets are as in `flat_profile`. R = (1 − q)/(1 + q), shape (k,), from −1 to 0: magnetic sheets draw the
    flux in, which raises the inductance.
    """
    q = _face_admittances(wavenumbers, thicknesses, permeabilities)[0]
    return np.asarray((1 - q) / (1 + q))


def _face_admittances(
    wavenumbers: FloatArray, thicknesses: Sequence[float], permeabilities: Sequence[float]
) -> list[FloatArray]:
    """Return q at every face, from the lowest to the highest."""
    q = np.ones_like(wavenumbers)
    faces = [q]
    for d, mu in zip(reversed(thicknesses), reversed(permeabilities), strict=True):
        tanh = np.tanh(wavenumbers * d)
        q = mu * (q + mu * tanh) / (mu + q * tanh)
        faces.append(q)
    return faces[::-1]


def _through(wavenumbers: FloatArray, height: FloatArray, d: float, ratio: FloatArray) -> FloatArray:
    """Potential at a height in a sheet over that at its lower face; `ratio` is q/μ at its upper face."""
    rest = 1 - ratio
    up = np.exp(-wavenumbers * height) * (1 + ratio + rest * np.exp(-2 * wavenumbers * (d - height)))
    return np.asarray(up / (1 + ratio + rest * np.exp(-2 * wavenumbers * d)))
