"""Coils' field on a sphere over a dent, and the reflection by the dented sheets.

A body on a sphere of radius a responds to the harmonics P_l of the potential there. With P̂_l normalised over sin θ dθ,
the harmonics c_l = ∫ U P̂_l sin θ dθ of the coils' dented potential U_d = U_f + ψ have two parts. The first are the
harmonics of the flat sheets' U_f at the places that the mapping of `coilarray.elastomer.scattering` gives. From them pᵀ
a_d⁻¹ Δa(U_f, ·) is subtracted, with the load p of P̂_l on the sphere. A layer of the strength P̂_l' on it makes the
harmonics pᵀ a_d⁻¹ p', whose values in air are known. The reflection by the sheets is the difference to air on the same
elements, so that the layer needs no elements of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.compute.threads import run_blocks
from coilarray.elastomer.dent import Dent
from coilarray.elastomer.scattering import DentedSpace, LayerMesh, radial_pattern

_NODES = 48  # of the integral over the sphere, from pole to pole


@dataclass(frozen=True, eq=False)
class SphereInDent:
    """Harmonics on a sphere for m from 0, l from max(m, 1) to the orders.

    `fields`, each (orders, k), are harmonics of the dented potential for the incident potential e^{−kz} J_m(kr).
    `returned`, each (orders, orders), are harmonics in 1/m that the sheets add for a layer of unit strength.
    """

    fields: tuple[FloatArray, ...]
    returned: tuple[FloatArray, ...]


def sphere_in_dent(
    dent: Dent, radius: float, height: float, wavenumbers: FloatArray, orders: int, mesh: LayerMesh
) -> SphereInDent:
    """Solve the dented sheets for a sphere about the dent's axis.

    Its radius and height are in m, the `wavenumbers` (k,) of the coils' field in 1/m.
    """
    space = DentedSpace(dent, mesh)
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    r, z = radius * np.sqrt(1 - nodes**2), height + radius * nodes
    unmoved = _unmoved(dent, r, z)
    at = space.basis.probes(np.array([r, unmoved]))
    profile = space.background(z, wavenumbers) + space.reaction(unmoved, wavenumbers)
    air = space.air()

    def solve(m: int) -> tuple[FloatArray, FloatArray]:
        """Fields and reflections of one harmonic."""
        harmonics = _normalised(orders, m, nodes) * weights
        layers = np.asarray(at.T @ harmonics.T)
        count = layers.shape[1]
        solved = space.energies(m, np.hstack((layers, space.force(m, space.waves(m, wavenumbers)))))
        seen = harmonics @ (radial_pattern("axial", m, r, wavenumbers) * profile)
        return seen - solved[:count, count:], solved[:count, :count] - space.energies(m, layers, air)

    every = run_blocks(solve, range(orders + 1))
    return SphereInDent(tuple(fields for fields, _ in every), tuple(returned for _, returned in every))


def _unmoved(dent: Dent, r: FloatArray, z: FloatArray) -> FloatArray:
    """Heights in m in the flat sheets of points in the dented sheets."""
    anchors, faces = dent.anchors()
    moved = dent.faces(r)[:, list(faces)]
    still = np.zeros((len(r), 1))
    low = [still] if len(anchors) == len(faces) + 2 else []
    heights = anchors + np.concatenate([*low, moved, still], axis=1)
    inside = [np.interp(height, row, anchors) for height, row in zip(z, heights, strict=True)]
    return np.where((z > anchors[0]) & (z < anchors[-1]), inside, z)


def _normalised(orders: int, m: int, x: FloatArray) -> FloatArray:
    """Normalised associated Legendre functions P_l^m(x), shape (l, n).

    They are for l = max(m, 1) to `orders`, with ∫ P² dx = 1 and no sign of Condon and Shortley. They follow from the
    recurrence in l of the normalised functions, whose terms stay within the range of numbers at any order. The
    factorials and P_l^m themselves do not. Holmes and Featherstone, J. Geodesy 76, 279 (2002), Eqs. 11 to 13.
    """
    odd = np.arange(1, 2 * m, 2)
    found = [np.sqrt((m + 0.5) * np.prod(odd / (odd + 1))) * (1 - x**2) ** (m / 2)]
    before = np.zeros_like(x)
    for order in range(m + 1, orders + 1):
        a = math.sqrt((4 * order**2 - 1) / (order**2 - m**2))
        b = math.sqrt(((order - 1) ** 2 - m**2) / (4 * (order - 1) ** 2 - 1))
        found.append(a * (x * found[-1] - b * before))
        before = found[-2]
    return np.array(found[max(1 - m, 0) :])
