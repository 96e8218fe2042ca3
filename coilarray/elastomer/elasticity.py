"""Linear elasticity of a layered body, also incompressible.

Displacement u and pressure p in the half plane (r, z), strain ε and bulk modulus K = E/(3(1 − 2ν)):

    ∫ (2μ dev ε(u) : dev ε(v) − p div v) w = load(v)         for every v,
    ∫ (−q div u − p q/K) w = 0                               for every q.

w = r about an axis, where u_r/r is the hoop strain, and w = 1 in plane strain. p is finite for ν =
0.5, where 1/K = 0. Biquadratic displacement with a linear pressure in each element, discontinuous
between elements, is stable: D. Boffi, F. Brezzi, M. Fortin, Mixed Finite Element Methods and
Applications, Springer 2013, section 8.6.3.

The matrix of a system with a slightly larger 1/K has a factorisation in any symmetric order, here
with little fill-in (R. J. Vanderbei, SIAM J. Optim. 5 (1995) 100). A few steps of iterative
refinement lead from it to 1/K itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from skfem import BilinearForm, LinearForm

from coilarray.compute.arrays import FloatArray, IndexArray
from coilarray.elastomer.contact_grid import (
    ContactGrid,
    Stack,
    hoop_strain,
    linear_pressures,
    quadrature_weights,
    weight,
)
from coilarray.geometry import Indenter
from coilarray.geometry.elastomer import Symmetry

_SOFT = 1e-6  # added 1/K of the factorised system in 1/μ: each refinement leaves at most 1e-5 of the error
_REFINEMENTS = 2


@dataclass(frozen=True, eq=False)
class ElasticBody:
    """Assembled and factorised elastic system of n basis functions."""

    basis: Any
    _free: IndexArray
    _solve: Callable[[FloatArray], FloatArray]
    _unknowns: int

    def displacements(self, loads: FloatArray) -> FloatArray:
        """Coefficients (n, k) of the displacement under k nodal loads (n, k)."""
        right = np.zeros((self._unknowns, loads.shape[1]))
        right[: len(loads)] = loads
        solution = np.zeros_like(right)
        solution[self._free] = self._solve(right[self._free])
        return solution[: len(loads)]


def elastic_body(
    basis: Any, symmetry: Symmetry, shear: FloatArray, squash: FloatArray, springs: Any, held: IndexArray
) -> ElasticBody:
    """Assemble and factorise the mixed system on n functions.

    `shear` and `squash` are μ and 1/K, `springs` (n, n) is added, `held` displacements are zero.
    """
    stiffness, divergence = _blocks(basis, symmetry, shear)
    blocks = [[stiffness + springs, divergence.T], [divergence, _bulk(basis, symmetry, squash)]]
    free = np.setdiff1d(np.arange(basis.N + divergence.shape[0]), held)
    system = sparse.block_array(blocks).tocsc()[free][:, free]
    blocks[1][1] = _bulk(basis, symmetry, squash + _SOFT / shear)
    softer = sparse.block_array(blocks).tocsc()[free][:, free]
    options = {"SymmetricMode": True}
    factors = splu(softer, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)

    def solve(right: FloatArray) -> FloatArray:
        solution = factors.solve(right)
        for _ in range(_REFINEMENTS):
            solution += factors.solve(right - system @ solution)
        return np.asarray(solution)

    return ElasticBody(basis, free, solve, basis.N + divergence.shape[0])


def _blocks(basis: Any, symmetry: Symmetry, shear: FloatArray) -> tuple[Any, Any]:
    """Matrices ∫2μ dev ε(u) : dev ε(v) w and −∫q div u w with q = 1, ξ and η in every element."""
    strain = _strains(basis, symmetry)
    trace = strain[:, :3].sum(axis=1)
    strain[:, :3] -= trace[:, None] / 3
    measure, local = quadrature_weights(basis, symmetry), linear_pressures(basis)
    u, p = basis.element_dofs, _pressure_dofs(measure)
    stiffness = np.einsum("iceq,jceq,eq->ije", strain, strain, 2 * shear[:, None] * measure, optimize=True)
    divergence = -np.einsum("kq,ieq,eq->kie", local, trace, measure, optimize=True)
    return _scattered(stiffness, u, u), _scattered(divergence, p, u)


def _bulk(basis: Any, symmetry: Symmetry, squash: FloatArray) -> Any:
    """Matrix of −∫p q/K w for the pressures of `_blocks`."""
    measure, local = quadrature_weights(basis, symmetry), linear_pressures(basis)
    p = _pressure_dofs(measure)
    return _scattered(-np.einsum("kq,lq,eq->kle", local, local, squash[:, None] * measure, optimize=True), p, p)


def _pressure_dofs(measure: FloatArray) -> IndexArray:
    """Return the indices of every element's three pressures, (3, elements)."""
    return np.arange(3 * len(measure)).reshape(3, -1)


def _strains(basis: Any, symmetry: Symmetry) -> FloatArray:
    """Strain rr, zz, hoop, √2 rz of each basis function, (functions, 4, elements, points)."""
    r = basis.global_coordinates()[0]
    return np.stack(
        [
            [u.grad[0, 0], u.grad[1, 1], hoop_strain(symmetry, u, r), (u.grad[0, 1] + u.grad[1, 0]) / np.sqrt(2)]
            for (u,) in basis.basis
        ]
    )


def _scattered(values: FloatArray, rows: IndexArray, columns: IndexArray) -> Any:
    """Sum matrices (i, j, elements) of rows (i, elements) and columns into one."""
    shape = values.shape
    where = np.broadcast_to(rows[:, None], shape).ravel(), np.broadcast_to(columns[None], shape).ravel()
    return sparse.coo_array((values.ravel(), where), shape=(rows.max() + 1, columns.max() + 1)).tocsr()


@dataclass(frozen=True, eq=False)
class Compliance:
    """Response of a stack to m hats of pressure.

    `profile` (m,) is ∫ψ_j profile w dr / ∫ψ_j w dr. `matrix` (m, m), symmetric, is the mean sinking
    of the top over hat i under a unit load on hat j. `surfaces` (2, interfaces, n, m) are u_r and
    u_z of every interface under a unit load on each hat.
    """

    grid: ContactGrid
    profile: FloatArray
    matrix: FloatArray
    surfaces: FloatArray


def compliance(stack: Stack, indenter: Indenter, grid: ContactGrid) -> Compliance:
    """Response of a meshed stack to an indenter in SI units."""
    symmetry, used = grid.symmetry, grid.used
    pressing = BilinearForm(lambda psi, v, w: -psi * v[1] * weight(symmetry, w.x[0]))
    weighing = LinearForm(lambda psi, w: psi * w.height * weight(symmetry, w.x[0]))
    at = grid.top.global_coordinates()[0]
    profile = weighing.assemble(grid.hats, height=indenter.profile(at * stack.length) / stack.length)[used]
    loads = pressing.assemble(grid.hats, grid.top)[:, used].toarray() / grid.mass
    body = elastic_body(grid.basis, symmetry, grid.shear, grid.squash, grid.springs, grid.held)
    u = body.displacements(loads)
    return Compliance(grid, profile / grid.mass, loads.T @ u, grid.moved(u))
