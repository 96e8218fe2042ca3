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
from dataclasses import dataclass

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
from coilarray.metal.half_body import MIRROR, ROWS, EddyBody

_DEPTHS = 3.0  # least thickness in skin depths


def require_skin(plate: FinitePlate, frequencies: FloatArray, others: Sequence[object]) -> None:
    """Refuse magnetic plates with which this is not computed: MetalError; `others` are plates and sheets beside it."""
    depth = max(plate.material.skin_depth(f) for f in frequencies.tolist())
    if plate.thickness < _DEPTHS * depth:
        raise MetalError(
            f"a magnetic plate with an outline must be at least {_DEPTHS:g} skin depths thick; {plate.name!r} is "
            f"{plate.thickness * 1e3:.4g} mm thick and has a skin depth of {depth * 1e3:.3g} mm at "
            f'{float(frequencies.min()):.4g} Hz: make it thicker, or infinite with shape = "plate".'
        )
    if plate.outline.holes:
        raise MetalError(
            f"a magnetic plate with an outline must have no holes; {plate.name!r} has some: leave them out."
        )
    if others:
        names = ", ".join(str(getattr(other, "name", other)) for other in others)
        raise MetalError(
            f"a magnetic plate with an outline is computed only without other plates and magnetic sheets; beside "
            f'{plate.name!r} there are {names}: leave one of them out, or make it infinite with shape = "plate".'
        )


def magnetic_changes(
    body: EddyBody, paths: Sequence[Conductor], plate: FinitePlate, where: FloatArray, frequencies: FloatArray
) -> ComplexArray:
    """ΔZ/jω in H by a magnetic plate at centres `where` (places, 3) in m, (places, f, paths, paths)."""
    change = np.zeros((len(where), len(frequencies), len(paths), len(paths)), dtype=np.complex128)
    lengths = _lengths(plate, frequencies)
    for sign, (b, t) in zip((1, -1), _loads(body, paths, plate, where), strict=True):
        change += parity_change(body, sign, b, t, lengths)
    return change


def magnetic_currents(body: EddyBody, paths: Sequence[Conductor], plate: FinitePlate, frequency: float) -> ComplexArray:
    """N × H in A/m for 1 A in each path at the plate's centre, (paths, 2k, 3) along the board's axes.

    On the triangles of the upper half and of its mirror image.
    """
    found: ComplexArray = np.zeros((len(paths), 2 * len(body.mesh.triangles), 3), dtype=np.complex128)
    (length,) = _lengths(plate, np.array([frequency])).tolist()
    for sign, (b, t) in zip((1, -1), _loads(body, paths, plate, np.array([plate.centre])), strict=True):
        problem = _problem(body, sign, b, t)
        total = np.zeros((len(body.mesh.nodes), len(paths)), dtype=np.complex128)
        total[problem.used] = (problem.u + problem.answer(length))[:, 0]
        upper = np.stack([np.asarray(K @ total).T for K in body.currents], axis=-1)
        found += np.concatenate((upper, -sign * MIRROR * upper), axis=1)  # of an odd potential they are even
    return np.asarray(found @ plate.axes)


def _lengths(plate: FinitePlate, frequencies: FloatArray) -> ComplexArray:
    """ℓ in m at frequencies in Hz."""
    depths = np.array([plate.material.skin_depth(f) for f in frequencies.tolist()])
    return np.asarray(plate.material.relative_permeability * depths * (1 - 1j) / 2)


def _loads(
    body: EddyBody, paths: Sequence[Conductor], plate: FinitePlate, where: FloatArray
) -> list[tuple[FloatArray, FloatArray]]:
    """`EddyBody.linked_to` of even and of odd potentials, each of shape (nodes, places, paths)."""
    n, shape = len(body.mesh.nodes), (len(where), len(paths))
    require_memory(8.0 * 8 * n * math.prod(shape), f"a plate at {len(where)} places", "compute fewer")
    parts: list[list[tuple[FloatArray, FloatArray]]] = [[], []]
    for fields in fields_on(body, paths, plate, where):
        for sign, of in zip((1, -1), parts, strict=True):
            of.append(body.linked_to(fields, sign))
    joined = ([np.concatenate(each, axis=1).reshape(n, *shape) for each in zip(*of, strict=True)] for of in parts)
    return [(b, t) for b, t in joined]


@dataclass(frozen=True, eq=False)
class _Problem:
    """Λ and S of the upper half for the nodes `used`, with b/µ0, t and u of shape (used, places, paths)."""

    used: IntArray
    outer: FloatArray
    S: FloatArray
    b: FloatArray
    t: FloatArray
    u: FloatArray

    def load(self, length: complex) -> ComplexArray:
        """Return c for ℓ in m."""
        return np.asarray(length * self.t - self.b)

    def answer(self, length: complex) -> ComplexArray:
        """Return φ in A for ℓ in m."""
        c = self.load(length)
        x = lu_solve(lu_factor(2 * (self.outer + length * self.S)), c.reshape(len(c), -1))
        return np.asarray(x.reshape(c.shape))


def _problem(body: EddyBody, sign: int, b: FloatArray, t: FloatArray) -> _Problem:
    n = len(body.mesh.nodes)
    used = np.arange(n) if sign > 0 else np.setdiff1d(np.arange(n), body.mesh.ring)
    S = stiffness(body)[used][:, used]
    b, t = b[used] / MU_0, t[used] / MU_0
    known = slice(1, None) if sign > 0 else slice(None)  # a constant is free
    u = np.zeros_like(t)
    u[known] = -splu((2 * S)[known, known].tocsc()).solve(t[known].reshape(-1, t[0].size)).reshape(t[known].shape)
    return _Problem(used, exterior(body, sign)[np.ix_(used, used)], S.toarray(), b, t, u)


def parity_change(body: EddyBody, sign: int, b: FloatArray, t: FloatArray, lengths: ComplexArray) -> ComplexArray:
    """Share of the potentials that are even (sign 1) or odd about the mid-plane, (places, f, paths, paths) in H.

    `b` in Wb/A and `t` in T·m/A, shape (nodes, places, paths), are those of `EddyBody.linked_to`; `lengths` (f,) are ℓ
    in m.
    """
    problem = _problem(body, sign, b, t)
    inside = np.einsum("npi,npj->pij", problem.u, problem.b, optimize=True)
    along = np.einsum("npi,npj->pij", problem.u, problem.t, optimize=True)

    def at(length: complex) -> ComplexArray:
        both = np.einsum("npi,npj->pij", problem.load(length), problem.answer(length), optimize=True)
        found = -MU_0 * (both - inside + length * along)
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
    mirrored = np.ascontiguousarray((corners * MIRROR)[:, ::-1])  # their normals point outwards too
    K = np.zeros((k, n))
    for other, nodes, part in ((corners, mesh.triangles, 1), (mirrored, mesh.triangles[:, ::-1], sign)):

        def work(rows: tuple[int, int], other: FloatArray = other, nodes: IntArray = nodes, part: int = part) -> None:
            double_layers(
                corners[slice(*rows)], other, np.ascontiguousarray(nodes), part / (4 * np.pi), K[slice(*rows)]
            )

        run_blocks(work, ranges(k, ROWS))
    share = np.zeros((k, n))
    np.add.at(share, (np.repeat(np.arange(k), 3), mesh.triangles.ravel()), np.repeat(body.areas / 3, 3))
    rest = share / 2 - K
    V = (own + sign * image) / (4 * np.pi)
    W = (M - sign * M_image) / MU_0
    made = W + rest.T @ cho_solve(cho_factor(V, check_finite=False), rest, check_finite=False)
    return np.asarray((made + made.T) / 2)
