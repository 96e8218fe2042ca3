"""How the interfaces of a stack answer a pressure on its top: one factorisation, any number of pressures.

The pressure is a sum of hat functions ψ_j on the vertices of the top. Not point forces on the nodes of the biquadratic
elements: under a uniform pressure the node on the axis carries none, so their sign would say nothing about contact.
Lengths are in thicknesses of the stack and stresses in the largest Young's modulus, which keeps the numbers near 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from skfem import BilinearForm, ElementQuad1, LinearForm

from coilarray.elastomer.contact_mesh import ContactMesh, ContactZone, contact_mesh, radial_points, vertical_points
from coilarray.elastomer.elasticity import elastic_body, weight
from coilarray.errors import ElastomerError
from coilarray.geometry import Indenter, Sheet

FloatArray = npt.NDArray[np.float64]

Base = Literal["bonded", "frictionless"]
"""How the lowest sheet lies on the board: glued, or free to slide but not to lift off."""


@dataclass(frozen=True, eq=False)
class Stack:
    """Sheets on a board in units of their own: lengths in thicknesses of the stack, stresses in the largest modulus.

    `length` in m and `stress` in Pa are these units. For every sheet, from the board up: `thicknesses`, `shear`, the
    shear modulus μ = E/(2(1 + ν)), and `squash`, the compressibility 1/K = 3(1 − 2ν)/E, each of shape (sheets,).
    """

    length: float
    stress: float
    thicknesses: FloatArray
    shear: FloatArray
    squash: FloatArray


def stack_of(sheets: Sequence[Sheet]) -> Stack:
    """Return the stack of some sheets; ElastomerError for none, or for one whose Young's modulus is not known."""
    if not sheets:
        raise ElastomerError("an indentation needs at least 1 sheet; got 0.")
    unknown = [sheet.name for sheet in sheets if sheet.youngs_modulus is None]
    if unknown:
        raise ElastomerError(f"Young's modulus of every sheet must be given; sheet {unknown[0]!r} has none.")
    thickness = np.array([sheet.thickness for sheet in sheets])
    modulus = np.array([sheet.youngs_modulus for sheet in sheets], dtype=float)
    ratio = np.array([sheet.poissons_ratio for sheet in sheets])
    length, stress = math.fsum(thickness), float(modulus.max())
    modulus = modulus / stress
    return Stack(length, stress, thickness / length, modulus / (2 * (1 + ratio)), 3 * (1 - 2 * ratio) / modulus)


@dataclass(frozen=True, eq=False)
class Compliance:
    """Answer of a stack to each hat of pressure, in the units of the stack.

    Parameters
    ----------
    r : ndarray, shape (n,)
        Radii of all nodes.
    heights : ndarray, shape (interfaces,)
        Heights of the interfaces from the board to the top.
    hats : ndarray, shape (m,)
        Radii of the vertices that carry the hats.
    mass : ndarray, shape (m,)
        ∫ψ_j w dr: what one unit of pressure of a hat weighs.
    profile : ndarray, shape (m,)
        ∫ψ_j profile w dr / ∫ψ_j w dr: mean height of the indenter over a hat.
    matrix : ndarray, shape (m, m)
        Mean sinking of the top over hat i under a unit load on hat j; symmetric.
    surfaces : ndarray, shape (2, interfaces, n, m)
        u_r and u_z of every interface under a unit load on each hat.
    """

    r: FloatArray
    heights: FloatArray
    hats: FloatArray
    mass: FloatArray
    profile: FloatArray
    matrix: FloatArray
    surfaces: FloatArray


def compliance(
    stack: Stack, indenter: Indenter, zone: ContactZone, base: Base, radius: float | None, mesh: ContactMesh
) -> Compliance:
    """Answer of a stack to the pressures under an indenter (in SI units), on all hats up to the end of the search.

    The expected `zone` of contact and the `radius` of the sample (half its width in plane strain; None for a wide one)
    are in thicknesses of the stack.
    """
    end = zone.search + mesh.extent if radius is None else radius
    levels = -np.append(np.cumsum(stack.thicknesses[::-1])[::-1], 0.0)  # from the top: it has the smallest elements
    r = radial_points(zone, 1.0, end, mesh)
    z = vertical_points(zone, levels, mesh)
    grid = contact_mesh(r, z)
    sheet = np.searchsorted(levels[1:-1], grid.p[1, grid.t].mean(axis=0))

    def held(basis: Any) -> npt.NDArray[np.intp]:
        on_board = ["u^2"] if base == "frictionless" else ["u^1", "u^2"]
        return np.union1d(basis.get_dofs("axis").all("u^1"), basis.get_dofs("bottom").all(on_board))

    symmetry = indenter.symmetry
    body = elastic_body(grid, symmetry, stack.shear[sheet], stack.squash[sheet], held, wide=radius is None)

    middle = grid.p[:, grid.facets].mean(axis=1)
    top = body.basis.boundary(np.flatnonzero((middle[1] == z[-1]) & (middle[0] < zone.search)))
    hats = top.with_element(ElementQuad1())
    used = hats.get_dofs(top.find).flatten()
    used = used[np.argsort(hats.doflocs[0, used])]

    pressing = BilinearForm(lambda psi, v, w: -psi * v[1] * weight(symmetry, w.x[0]))
    weighing = LinearForm(lambda psi, w: psi * w.height * weight(symmetry, w.x[0]))
    at = top.global_coordinates()[0]
    mass = weighing.assemble(hats, height=np.ones_like(at))[used]
    profile = weighing.assemble(hats, height=indenter.profile(at * stack.length) / stack.length)[used]
    loads = pressing.assemble(hats, top)[:, used].toarray() / mass
    u = body.displacements(loads)
    matrix = loads.T @ u

    lines = [_line(body.basis, np.flatnonzero(middle[1] == level)) for level in levels]
    surfaces = np.array([[u[line[k]] for line in lines] for k in range(2)])
    nodes = body.basis.doflocs[0, lines[-1][0]]
    return Compliance(nodes, levels - levels[0], hats.doflocs[0, used], mass, profile / mass, matrix, surfaces)


def _line(basis: Any, facets: npt.NDArray[np.intp]) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Degrees of freedom u_r and u_z on some facets, from the axis outwards."""
    on = basis.get_dofs(facets)
    r, z = (np.asarray(on.all(name)) for name in ("u^1", "u^2"))
    return r[np.argsort(basis.doflocs[0, r])], z[np.argsort(basis.doflocs[0, z])]
