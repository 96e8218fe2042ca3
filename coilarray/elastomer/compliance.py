"""Response of the interfaces of a stack to pressure on its top, by one factorisation."""

from __future__ import annotations

from dataclasses import dataclass

from skfem import BilinearForm, LinearForm

from coilarray.compute.arrays import FloatArray
from coilarray.elastomer.contact_grid import ContactGrid, Stack, weight
from coilarray.elastomer.elasticity import elastic_grid
from coilarray.geometry import Indenter


@dataclass(frozen=True, eq=False)
class Compliance:
    """Response of a stack to each of m hats of pressure, in its units.

    `profile` (m,) is ∫ψ_j profile w dr / ∫ψ_j w dr, the mean height of the indenter over a hat. `matrix` (m, m),
    symmetric, is the mean sinking of the top over hat i under a unit load on hat j. `surfaces` (2, interfaces, n, m)
    are u_r and u_z of every interface under a unit load on each hat.
    """

    grid: ContactGrid
    profile: FloatArray
    matrix: FloatArray
    surfaces: FloatArray


def compliance(stack: Stack, indenter: Indenter, grid: ContactGrid) -> Compliance:
    """Response of a meshed stack to pressures under an indenter in SI units."""
    symmetry, used = grid.symmetry, grid.used
    pressing = BilinearForm(lambda psi, v, w: -psi * v[1] * weight(symmetry, w.x[0]))
    weighing = LinearForm(lambda psi, w: psi * w.height * weight(symmetry, w.x[0]))
    at = grid.top.global_coordinates()[0]
    profile = weighing.assemble(grid.hats, height=indenter.profile(at * stack.length) / stack.length)[used]
    loads = pressing.assemble(grid.hats, grid.top)[:, used].toarray() / grid.mass
    u = elastic_grid(grid).displacements(loads)
    return Compliance(grid, profile / grid.mass, loads.T @ u, grid.moved(u))
