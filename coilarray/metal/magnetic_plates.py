"""Magnetic metal with an outline whose skin depth is small: steel targets.

Currents that run in the metal's skin leave no field deep inside, but iron also leads flux along its surface. With
k = (1 + j)/δ the field in the skin falls as e^{−kζ}, and div B = 0 gives at the surface, n outwards,

    H_n = −∇·(ℓ H_t),   ℓ = µr/k = µr δ (1 − j)/2

(Leontovich's condition): ℓ = 0 is a perfect conductor, ℓ → ∞ perfect iron. Outside H = H_c − ∇φ with the coils' H_c.
With the exterior's Λ = −∂/∂n on the closed surface, and linear functions v on its triangles,

    (Λ + ℓ S) φ = ℓ t − b/µ0,   S = ∫ ∇v·∇v',  t = ∫ ∇v·H_c,  b = ∫ v B_c·n,
    Λ = W + (½ − K)ᵀ V⁻¹ (½ − K),

V and K the single layer and the double layer of 1/4πr, W = M/µ0 the energy of the currents ∇v × n
(`coilarray.metal.half_body`); M. Costabel's symmetric coupling, for which O. Steinbach, Numerical Approximation Methods
for Elliptic Boundary Value Problems (2008), ch. 6. In the metal's place H_c = −∇u, with S u = −t, and by reciprocity

    ΔL_ij − jΔR_ij/ω = −µ0 (c_iᵀ (Λ + ℓ S)⁻¹ c_j − u_iᵀ b_j/µ0 + ℓ u_iᵀ t_j),   c = ℓ t − b/µ0.

The skin depth is at most a third of the thickness, and small against the width. A hole would need a cut.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from scipy.linalg import cho_factor, cho_solve, lu_factor, lu_solve
from scipy.sparse.linalg import splu

from coilarray.compute.arrays import ComplexArray, FloatArray, IntArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import ranges, run_blocks
from coilarray.constants import MU_0
from coilarray.electromagnetics.kernels.triangles import double_layers
from coilarray.errors import MetalError
from coilarray.geometry import Conductor
from coilarray.geometry.plate import FinitePlate
from coilarray.metal.coupled_plates import fields_on
from coilarray.metal.half_body import EddyBody

_DEPTHS = 3.0  # least thickness in skin depths
_ROWS = 32  # triangles a task
_MIRROR = np.array([1.0, 1.0, -1.0])


def require_skin(plate: FinitePlate, frequencies: FloatArray, others: Sequence[object]) -> None:
    """Refuse magnetic plates with which this is not computed: MetalError; `others` are plates and sheets beside it."""
    depth = max(plate.material.skin_depth(f) for f in frequencies.tolist())
    if plate.thickness < _DEPTHS * depth:
        raise MetalError(
            f"a magnetic plate with an outline must be at least {_DEPTHS:g} skin depths thick; {plate.name!r} is "
            f"{plate.thickness * 1e3:.4g} mm thick and has a skin depth of {depth * 1e3:.3g} mm at "
            f"{float(frequencies.min()):.4g} Hz."
        )
    if plate.outline.holes:
        raise MetalError(f"a magnetic plate with an outline must have no holes; {plate.name!r} has some.")
    if others:
        names = ", ".join(str(getattr(other, "name", other)) for other in others)
        raise MetalError(
            f"a magnetic plate with an outline is computed only without other plates and magnetic sheets; beside "
            f"{plate.name!r} there are {names}."
        )


def magnetic_changes(
    body: EddyBody, paths: Sequence[Conductor], plate: FinitePlate, where: FloatArray, frequencies: FloatArray
) -> ComplexArray:
    """ΔZ/jω in H by a magnetic plate at centres `where` (places, 3) in m, (places, f, paths, paths)."""
    n = len(body.mesh.nodes)
    shape = (len(where), len(paths))
    require_memory(8.0 * 4 * n * math.prod(shape), f"a plate at {len(where)} places", "compute fewer")
    loads: list[list[tuple[FloatArray, FloatArray]]] = [[], []]
    for fields in fields_on(body, paths, plate, where):
        for sign, parts in zip((1, -1), loads, strict=True):
            parts.append(body.linked_to(fields, sign))
    depths = np.array([plate.material.skin_depth(f) for f in frequencies.tolist()])
    lengths = plate.material.relative_permeability * depths * (1 - 1j) / 2
    change = np.zeros((len(where), len(frequencies), len(paths), len(paths)), dtype=np.complex128)
    for sign, parts in zip((1, -1), loads, strict=True):
        b, t = (np.concatenate(each, axis=1).reshape(n, *shape) for each in zip(*parts, strict=True))
        change += parity_change(body, sign, b, t, lengths)
    return change


def parity_change(body: EddyBody, sign: int, b: FloatArray, t: FloatArray, lengths: ComplexArray) -> ComplexArray:
    """Share of the potentials that are even (sign 1) or odd about the mid-plane, (places, f, paths, paths) in H.

    `b` in Wb/A and `t` in T·m/A, shape (nodes, places, paths), are those of `EddyBody.linked_to`; `lengths` (f,) are ℓ
    in m.
    """
    b, t = b / MU_0, t / MU_0
    n = len(body.mesh.nodes)
    used = np.arange(n) if sign > 0 else np.setdiff1d(np.arange(n), body.mesh.ring)
    outer, S = exterior(body, sign)[np.ix_(used, used)], stiffness(body)[used][:, used]
    b, t = b[used], t[used]
    known = slice(1, None) if sign > 0 else slice(None)  # a constant is free
    u = np.zeros_like(t)
    u[known] = -splu((2 * S)[known, known].tocsc()).solve(t[known].reshape(-1, t[0].size)).reshape(t[known].shape)
    inside = np.einsum("npi,npj->pij", u, b, optimize=True)
    along = np.einsum("npi,npj->pij", u, t, optimize=True)
    dense = S.toarray()

    def at(length: complex) -> ComplexArray:
        c = length * t - b
        x = lu_solve(lu_factor(2 * (outer + length * dense)), c.reshape(len(c), -1)).reshape(c.shape)
        found = -MU_0 * (np.einsum("npi,npj->pij", c, x, optimize=True) - inside + length * along)
        return np.asarray((found + found.swapaxes(1, 2)) / 2)

    return np.stack([at(length) for length in lengths.tolist()], axis=1)


def stiffness(body: EddyBody) -> sp.csr_array:
    """∫ ∇v·∇v' over the upper half of a body, dimensionless, shape (n, n)."""
    areas = sp.diags_array(body.areas)
    return sp.csr_array(sum(G.T @ areas @ G for G in body.gradients))


def exterior(body: EddyBody, sign: int) -> FloatArray:
    """Λ of the upper half of a body in m for even (sign 1) or odd potentials about the mid-plane, (n, n)."""
    (own, image), (M, M_image), mesh = body.integrals, body.inductances, body.mesh
    k, n = len(mesh.triangles), len(mesh.nodes)
    corners = mesh.corners
    mirrored = np.ascontiguousarray((corners * _MIRROR)[:, ::-1])  # their normals point outwards too
    K = np.zeros((k, n))
    for other, nodes, part in ((corners, mesh.triangles, 1), (mirrored, mesh.triangles[:, ::-1], sign)):

        def work(rows: tuple[int, int], other: FloatArray = other, nodes: IntArray = nodes, part: int = part) -> None:
            double_layers(
                corners[slice(*rows)], other, np.ascontiguousarray(nodes), part / (4 * np.pi), K[slice(*rows)]
            )

        run_blocks(work, ranges(k, _ROWS))
    share = np.zeros((k, n))
    np.add.at(share, (np.repeat(np.arange(k), 3), mesh.triangles.ravel()), np.repeat(body.areas / 3, 3))
    rest = share / 2 - K
    V = (own + sign * image) / (4 * np.pi)
    W = (M - sign * M_image) / MU_0
    made = W + rest.T @ cho_solve(cho_factor(V, check_finite=False), rest, check_finite=False)
    return np.asarray((made + made.T) / 2)
