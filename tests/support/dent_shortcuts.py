"""Two common approximations of a dent, for comparison only.

Neither is accurate for dents of the size of the sheet. `first_order` takes the slope of the energy at the flat face,
where the field changes fast with depth. `born` takes the magnetisation by the incident field alone and ignores the
demagnetisation of the sheet. `coilarray.elastomer.scattering.scatter` solves the dented sheet.
"""

from __future__ import annotations

import numpy as np
from scipy.special import jv, jvp

from coilarray.compute.arrays import FloatArray
from coilarray.constants import MU_0
from coilarray.elastomer.dent import Dent
from coilarray.elastomer.dented_layer import dent_energies
from coilarray.elastomer.scattering import LayerMesh, Scattering
from coilarray.electromagnetics.flat_stack import coil_segments, flat_profile

_NODES = 8  # of a Gauss–Legendre rule for every half period of the shortest wave
_SLOPE = 1e-6  # step of a difference in heights, over the shortest wavelength


def shortcut_inductance(source, dents, positions, shortcut):
    """`dent_inductance` with `first_order` or `born` in place of the full solution."""
    mesh = LayerMesh()

    def solve(dent: Dent, wavenumbers: FloatArray, weights: FloatArray, deepest: float) -> Scattering:
        return shortcut(dent, wavenumbers, weights, mesh.harmonics)

    return MU_0 * dent_energies(dents, positions, coil_segments(source), solve, mesh)


def first_order(dent: Dent, wavenumbers: FloatArray, weights: FloatArray, highest: int) -> Scattering:
    """Change of energy to first order in the displacement.

    The dent is about an axis, and its faces are displaced. Hadamard's formula: if a face with μ1 below and μ2 above
    moves up by f, the energy at constant currents changes by ∫ f [(μ1 − μ2) H_t² + (1/μ2 − 1/μ1) B_n²] dS with the
    fields of the flat sheets. Wavenumbers and weights in 1/m follow from
    `coilarray.elastomer.scattering.wavenumber_rule`.
    """
    r, rule = _radii(dent, wavenumbers)
    moved = dent.faces(r) * (r * rule)[:, None]
    mu = (1.0, *dent.permeabilities, 1.0)
    step = _SLOPE / wavenumbers[-1]
    energies = [np.zeros((len(wavenumbers),) * 2) for _ in range(highest + 1)]
    for face in dent.contrasts:
        level = dent.heights[face]
        at, beside = flat_profile(wavenumbers, np.array([level, level + step]), dent.thicknesses, dent.permeabilities)
        normal = mu[face + 1] * (beside - at) / step
        along, across = mu[face] - mu[face + 1], 1 / mu[face + 1] - 1 / mu[face]
        for m in range(highest + 1):
            value, slope, turn = _radial(m, r, wavenumbers)
            energies[m] += along * np.outer(at, at) * _weighted(moved[:, face], slope, turn)
            energies[m] += across * np.outer(normal, normal) * _weighted(moved[:, face], value)
    return Scattering(wavenumbers, weights, (np.eye(len(wavenumbers)),) * (highest + 1), tuple(energies))


def born(dent: Dent, wavenumbers: FloatArray, weights: FloatArray, highest: int) -> Scattering:
    """Change of energy with the sheets magnetised by incident waves.

    The magnetisation is by the incident field alone, otherwise as in `first_order`. It is ∫ (μ − 1) H_s·H_s dV of the
    dented minus the flat sheets, with the field H_s in free space.
    """
    r, rule = _radii(dent, wavenumbers)
    both = wavenumbers[:, None] + wavenumbers
    displaced = dent.heights + dent.faces(r)
    mu = (1.0, *dent.permeabilities, 1.0)
    energies = [np.zeros_like(both) for _ in range(highest + 1)]
    patterns = [_radial(m, r, wavenumbers) for m in range(highest + 1)]
    for face in dent.contrasts:  # ∫ e^{−(k + k')z} dz from the old to the new position of the face
        jump = mu[face] - mu[face + 1]
        for here, weight, height in zip(range(len(r)), r * rule, displaced[:, face], strict=True):
            change = jump * weight * (np.exp(-both * dent.heights[face]) - np.exp(-both * height)) / both
            for m, (value, slope, turn) in enumerate(patterns):
                parts = (slope[here], turn[here], wavenumbers * value[here])
                energies[m] += change * sum(np.outer(part, part) for part in parts)
    return Scattering(wavenumbers, weights, (np.eye(len(wavenumbers)),) * (highest + 1), tuple(energies))


def _radii(dent: Dent, wavenumbers: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of an integral over the dent's radius.

    They are fine enough for the shortest wave.
    """
    panels = int(np.ceil(dent.extent * wavenumbers[-1] / np.pi))
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    edges = np.linspace(0, dent.extent, panels + 1)
    half = np.diff(edges) / 2
    return ((edges[:-1] + half)[:, None] + half[:, None] * nodes).ravel(), (half[:, None] * weights).ravel()


def _radial(m: int, r: FloatArray, wavenumbers: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """J_m(kr), its slope in 1/m and m/r times it.

    Each has the shape (r, k).
    """
    kr = np.outer(r, wavenumbers)
    value = jv(m, kr)
    return value, jvp(m, kr) * wavenumbers, m * value / r[:, None]


def _weighted(weight: FloatArray, *parts: FloatArray) -> FloatArray:
    """Sum weight × part × part' over radii, (k, k)."""
    return np.asarray(sum((part * weight[:, None]).T @ part for part in parts))
