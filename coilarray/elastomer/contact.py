"""Contact of a rigid indenter with elastomer sheets: depth, force, radius.

With f_j the force on hat j of the pressure and C the compliance of the top, the mean gap between
the indenter and hat i is

    G_i = profile_i − depth + Σ_j C_ij f_j,      f_j ≥ 0,  G_j ≥ 0,  f_j G_j = 0.

This linear complementarity problem has a symmetric positive definite matrix. Its only solution is
the minimum of ½ fᵀCf + fᵀG(f = 0) over f ≥ 0, a small problem for each depth. The default,
`coilarray.elastomer.finite_strain`, follows large deformations. In both cases the contact has
neither friction nor adhesion (K. L. Johnson, Contact Mechanics, Cambridge University Press 1985,
section 5.9).

C follows from linear elasticity. Displacement u and pressure p in the half plane (r, z), strain ε
and bulk modulus K = E/(3(1 − 2ν)):

    ∫ (2μ dev ε(u) : dev ε(v) − p div v) w = load(v)         for every v,
    ∫ (−q div u − p q/K) w = 0                               for every q.

w = r about an axis, where u_r/r is the hoop strain, and w = 1 in plane strain. p is finite for ν =
0.5, where 1/K = 0. Biquadratic displacement with a linear pressure in each element, discontinuous
between elements, is stable: D. Boffi, F. Brezzi, M. Fortin, Mixed Finite Element Methods and
Applications, Springer 2013, section 8.6.3. The matrix of a system with a slightly larger 1/K has a
factorisation in any symmetric order, here with little fill-in (R. J. Vanderbei, SIAM J. Optim. 5
(1995) 100). A few steps of iterative refinement lead from it to 1/K itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy import sparse
from scipy.linalg import LinAlgError, cholesky, solve_triangular
from scipy.optimize import nnls
from scipy.sparse.linalg import splu
from skfem import BilinearForm, LinearForm

from coilarray.compute.arrays import FloatArray, IndexArray
from coilarray.compute.netcdf import variables
from coilarray.compute.threads import serial_algebra
from coilarray.elastomer.contact_grid import (
    ContactGrid,
    ContactMesh,
    ContactZone,
    Stack,
    contact_grid,
    hoop_strain,
    linear_pressures,
    quadrature_weights,
    stack_of,
    weight,
)
from coilarray.elastomer.finite_strain import EDGE_ELEMENTS, TIP, Outline, SoftBody
from coilarray.errors import LARGEST, ElastomerError
from coilarray.geometry import Cone, Indenter, Seat, Sheet
from coilarray.geometry.elastomer import Base, RigidBase, Strain, Symmetry

DEFAULT_MESH = ContactMesh()  # force to about 0.1 % and contact radius to about 0.3 %, by a convergence study

_SEARCH = 4.0  # contact is searched up to profile = 4 depths, over an incompressible film it ends at 3 or less
_COARSE = ContactMesh(elements=8, growth=1.5)  # for the first guess of the contact radius
_GUESSES = 4
_NOMINAL = 0.01  # depth in thicknesses for which the mesh is made if no depth is above zero
_TAIL = 4  # the last quarter of the elements of a contact determines its radius
_BEYOND_EDGE = 1.2  # material within this many radii of a sharp indenter may come under it
_RESIDUAL = 1e-9  # of the complementarity problem, relative to the depth
_SOFT = 1e-6  # added 1/K of the factorised system in 1/μ: each refinement leaves at most 1e-5 of the error
_REFINEMENTS = 2


def _hat_forces(system: Compliance, depth: float) -> FloatArray:
    """Force on each hat at a depth above zero in thicknesses.

    It is in the stack's units over 2π (axial) or 2 (plane strain).
    """
    failed = f"the contact at a depth of {depth:.3g} thicknesses does not converge:"
    start = system.profile - depth
    matrix = (system.matrix + system.matrix.T) / 2  # symmetric but for roundings of the factorisation
    try:
        if not (matrix.diagonal() > 0).all():  # also NaN
            raise LinAlgError("no compliance")
        scale = 1 / np.sqrt(matrix.diagonal())  # hats of all sizes count alike
        lower = cholesky(scale[:, None] * matrix * scale, lower=True)
        force = scale * nnls(lower.T, -solve_triangular(lower, scale * start, lower=True))[0]
    except LinAlgError as error:  # the motion of the sheets as a whole hides their deformation
        raise ElastomerError(f"{failed} the seat or the lowest sheets are too soft to hold the others.") from error
    except RuntimeError as error:
        raise ElastomerError(f"{failed} {error}.") from error
    gap = start + matrix @ force
    residual = float(np.abs(np.minimum(gap, matrix.diagonal() * force)).max()) / depth
    if not residual <= _RESIDUAL:
        raise ElastomerError(f"{failed} its residual must be at most {_RESIDUAL:.0e} of the depth; got {residual:.1e}.")
    return np.asarray(force)


def contact_radius(hats: FloatArray, pressure: FloatArray, tail: int) -> float:
    """Radius at which the pressure of a smooth indenter ends.

    It is finer than the mesh and follows from the last `tail` elements. Near the edge a, p = √s (c₀
    + c₁s) with s = a − r. The moments F_k = ∫p (r − r₀)ᵏ dr of the tail beyond r₀ are more reliable
    than values of p, which oscillate next to the edge. Elimination of c₀ and c₁ leaves 8 F₀L² − 56
    F₁L + 63 F₂ = 0 for L = a − r₀, whose smaller root is the edge.
    """
    last = int(np.flatnonzero(pressure)[-1])
    first = max(0, last - tail)
    r, p = hats[first : last + 2] - hats[first], pressure[first : last + 2]
    middle_r, middle_p = (r[1:] + r[:-1]) / 2, (p[1:] + p[:-1]) / 2
    moments = [
        float(np.diff(r) @ (p[:-1] * r[:-1] ** k + 4 * middle_p * middle_r**k + p[1:] * r[1:] ** k)) / 6
        for k in range(3)  # Simpson's rule, exact for a linear p
    ]
    root = math.sqrt(max(0.0, 49 * moments[1] ** 2 - 31.5 * moments[0] * moments[2]))
    return float(hats[first] + (7 * moments[1] - root) / (2 * moments[0]))


@dataclass(frozen=True)
class _Case:
    """Stack, indenter and support of a contact, with the sample's radius."""

    stack: Stack
    indenter: Indenter
    base: Base
    radius: float | None

    def grid(self, zone: ContactZone, mesh: ContactMesh) -> ContactGrid:
        return contact_grid(self.stack, self.indenter.symmetry, zone, self.base, self.radius, mesh)

    def cut(self, height: float) -> float:
        """Radius of the indenter at a height, within the sample."""
        radius = self.indenter.radius_at(height * self.stack.length) / self.stack.length
        return radius if self.radius is None else min(radius, self.radius)


@dataclass(frozen=True, eq=False)
class _Solution:
    """Forces on hats, contact radii, and faces' u_r and u_z, by depth."""

    grid: ContactGrid
    force: FloatArray
    end: FloatArray
    moved: FloatArray


def _contact(system: Compliance, zone: ContactZone, depth: float, mesh: ContactMesh) -> tuple[FloatArray, float]:
    """Force on every hat and contact radius, within the search."""
    force, grid = _hat_forces(system, depth), system.grid
    if force[-1] > 0:
        return force, zone.search
    return force, contact_radius(grid.radii, force / grid.mass, mesh.elements // _TAIL)


def _expected_zone(case: _Case, least: float, greatest: float) -> ContactZone:
    zone = ContactZone(case.cut(least) / 2, case.cut(greatest), case.cut(_SEARCH * greatest))
    for _ in range(_GUESSES):
        system = compliance(case.stack, case.indenter, case.grid(zone, _COARSE))
        smallest, largest = (_contact(system, zone, depth, _COARSE)[1] for depth in (least, greatest))
        resolved = smallest > zone.smallest / 2
        zone = ContactZone(smallest, largest, zone.search, sharp=largest == zone.search)
        if resolved:
            break
    return zone


def _small_strain(case: _Case, zone: ContactZone, depths: FloatArray, mesh: ContactMesh) -> _Solution:
    system = compliance(case.stack, case.indenter, case.grid(zone, mesh))
    force, end = np.zeros((len(depths), len(system.profile))), np.zeros(len(depths))
    for k in np.flatnonzero(depths > 0):
        force[k], end[k] = _contact(system, zone, float(depths[k]), mesh)
    return _Solution(system.grid, force, end, np.moveaxis(system.surfaces @ force.T, -1, 0))


def _finite_strain(case: _Case, zone: ContactZone, depths: FloatArray, mesh: ContactMesh) -> _Solution:
    """Contacts under large strain at rising depths."""
    if zone.sharp:  # material beyond the edge may come under it
        wider = zone.search * _BEYOND_EDGE
        zone = replace(zone, search=wider if case.radius is None else min(wider, case.radius))
        mesh = replace(mesh, elements=min(mesh.elements, EDGE_ELEMENTS))
    if isinstance(case.indenter, Cone):
        zone = replace(zone, tip=TIP * zone.smallest)
    grid = case.grid(zone, mesh)
    body = SoftBody(grid, Outline(case.indenter, case.stack.length, zone.tip))
    states = {0.0: body.at_rest()}
    rising = np.unique(depths[depths > 0])
    with serial_algebra():  # threads cost more than they gain on these narrow bands
        states.update(zip(rising.tolist(), body.press(rising), strict=True))
    ordered = [states[depth] for depth in depths.tolist()]
    moved = np.array([grid.moved(state.u) for state in ordered])
    force = np.array([body.forces(state) for state in ordered])
    end = np.zeros(len(depths))
    for k in np.flatnonzero(depths > 0):
        now = grid.radii + np.interp(grid.radii, grid.r, moved[k, 0, -1])
        last = int(np.flatnonzero(force[k])[-1])
        if last == len(now) - 1 or zone.sharp:
            end[k] = now[last]
        else:
            end[k] = contact_radius(now, force[k] / grid.mass, mesh.elements // _TAIL)
    return _Solution(grid, force, end, moved)


def _check_arguments(sheets: Sequence[Sheet], base: Base, radius: float | None, strain: str) -> None:
    names = ["board", *(sheet.name for sheet in sheets)]
    if len(set(names)) < len(names):
        raise ElastomerError(f"names of the sheets must differ from each other and from 'board'; got {names[1:]}.")
    if not isinstance(base, Seat) and base not in get_args(RigidBase):
        raise ElastomerError(f"base must be {', '.join(map(repr, get_args(RigidBase)))} or a Seat; got {base!r}.")
    if strain not in get_args(Strain):
        raise ElastomerError(f"strain must be {' or '.join(map(repr, get_args(Strain)))}; got {strain!r}.")
    if radius is not None and not 0 < radius <= LARGEST:
        raise ElastomerError(f"radius of a sample must be positive and finite; got {radius * 1e3:g} mm.")


def indent(
    sheets: Sequence[Sheet],
    indenter: Indenter,
    depths: npt.ArrayLike,
    *,
    base: Base = "bonded",
    radius: float | None = None,
    strain: Strain = "finite",
    accuracy: ContactMesh = DEFAULT_MESH,
) -> xr.Dataset:
    """Press a rigid indenter into elastomer sheets.

    Parameters
    ----------
    sheets : sequence of Sheet
        Sheets from the board up, bonded to each other.
    indenter : Indenter
        Its symmetry decides between a body of revolution and plane strain.
    depths : array_like, shape (d,) or scalar
        Distances of the tip below the flat top in m. At 0 the tip just touches.
    base : {"bonded", "frictionless"} or Seat
        Support of the lowest sheet: a rigid board to which it is glued or on which it slides, or a
        soft seat (Winkler foundation).
    radius : float, optional
        Radius in m of a sample with a free edge and the indenter at its centre. In plane strain it
        is half the width. Without a radius the sample is laterally infinite.
    strain : {"finite", "linear"}
        Large deformations of neo-Hookean sheets, which take some seconds, or linear elasticity.
    accuracy : ContactMesh
        Fineness and extent of the mesh.

    Returns
    -------
    xarray.Dataset
        Dimensions depth, interface ("board" and the upper face of each sheet, by its name) and r
        (undeformed radius). displacement_r and displacement_z (depth, interface, r) are in m,
        positive upwards. force (depth) is in N, in plane strain in N/m. contact_radius (depth) in m
        is the radius at which the pressure ends on the deformed surface. pressure (depth, r) is in
        Pa on the top. height (interface) is in m, in the flat state.

    Raises
    ------
    ElastomerError
        A sheet without Young's modulus, a depth that is not allowed, folds an interface or exceeds
        the radius of a ball or cylinder, a contact that extends beyond the sample or does not
        converge, an unknown base.

    Notes
    -----
    The edge of the mesh of a wide sample is far away. It carries the traction of the material
    beyond it: u_r = B/r (in plane strain a constant), the field of a layer that slides as a whole.
    The field of a bonded layer has decayed there.

    Under large deformations the edge of a punch is rounded with its `edge_radius`, as a sharp edge
    would cut the sheet. With a smaller edge radius the computation stops at a smaller depth.

    Examples
    --------
    >>> from coilarray.geometry import Hemisphere
    >>> sheet = Sheet("silicone", thickness=6e-3, youngs_modulus=100e3, poissons_ratio=0.5)
    >>> dent = indent([sheet], Hemisphere(radius=2.5e-3), [0.5e-3, 1e-3])
    >>> [f"{force:.2f} N" for force in dent.force.values]
    ['0.12 N', '0.36 N']
    """
    stack = stack_of(sheets)
    _check_arguments(sheets, base, radius, strain)
    depth = np.atleast_1d(np.asarray(depths, dtype=float))
    if depth.ndim != 1 or not depth.size:
        raise ElastomerError(f"depths must be one row of numbers, at least one; got shape {depth.shape}.")
    for value in depth[~((depth >= 0) & (depth < stack.length))]:  # also NaN
        raise ElastomerError(
            "depth of an indentation must be from 0 to below the thickness of all sheets, "
            f"{stack.length * 1e3:.4g} mm; got {value * 1e3:.4g} mm."
        )
    if depth.max(initial=0.0) > indenter.height:
        raise ElastomerError(
            f"a {indenter.name} can be pressed in by at most its radius, {indenter.height * 1e3:g} mm: what is above "
            f"it is not known; got a depth of {depth.max() * 1e3:g} mm."
        )
    case = _Case(stack, indenter, base, None if radius is None else radius / stack.length)
    scaled = depth / stack.length
    pressed = scaled[scaled > 0] if scaled.any() else np.array([_NOMINAL])
    zone = _expected_zone(case, float(pressed.min()), float(pressed.max()))
    solution = (_finite_strain if strain == "finite" else _small_strain)(case, zone, scaled, accuracy)
    beyond = (solution.force[:, -1] > 0) & (scaled > 0)
    if beyond.any() and zone.search < indenter.largest_radius / stack.length:
        raise ElastomerError(
            f"the contact must end inside the sample, within a radius of {zone.search * stack.length * 1e3:.4g} mm; "
            f"at a depth of {depth[beyond][0] * 1e3:.4g} mm it does not."
        )
    names = ["board", *(sheet.name for sheet in sheets)]
    heights = stack.levels - stack.levels[0]
    for at, displacement in zip(depth, solution.moved, strict=True):
        r, z = solution.grid.r + displacement[0], heights[:, None] + displacement[1]
        for k, name in enumerate(names):
            rising = (np.diff(r[k]) > 0).all()  # False if NaN
            if not rising or (k and not (z[k] > np.interp(r[k], r[k - 1], z[k - 1])).all()):
                raise ElastomerError(
                    f"depth of an indentation must leave every interface unfolded; at {at * 1e3:.4g} mm that of "
                    f"{name!r} folds."
                )
    return _dataset(case, solution, names, depth, heights, strain)


def _dataset(
    case: _Case, solution: _Solution, names: list[str], depth: FloatArray, heights: FloatArray, strain: Strain
) -> xr.Dataset:
    """Results in SI units, from the stack's units and depths in m."""
    length, stress, axial = case.stack.length, case.stack.stress, case.indenter.symmetry == "axial"
    whole = 2 * math.pi * length**2 if axial else 2 * length  # hats weigh r dr, or dr of one half
    grid, force, moved = solution.grid, solution.force, solution.moved
    pressure = np.array([np.interp(grid.r, grid.radii, row / grid.mass, right=0.0) for row in force])
    where, edge = ("depth", "interface", "r"), "contact radius" if axial else "half width of the contact"
    rows = (
        ("displacement_r", where, moved[:, 0] * length, "m", "displacement outwards"),
        ("displacement_z", where, moved[:, 1] * length, "m", "displacement upwards"),
        ("force", ("depth",), force.sum(axis=1) * whole * stress, "N" if axial else "N/m", "force on the indenter"),
        ("contact_radius", ("depth",), solution.end * length, "m", edge),
        ("pressure", ("depth", "r"), pressure * stress, "Pa", "pressure on the undeformed top"),
    )
    axes = (
        ("depth", ("depth",), depth, "m", "depth of the indentation"),
        ("interface", ("interface",), names, "1", "interface"),
        ("r", ("r",), grid.r * length, "m", "distance from the indenter's axis"),
        ("height", ("interface",), heights * length, "m", "height of the flat interface"),
    )
    return xr.Dataset(
        variables(*rows),
        coords=variables(*axes),
        attrs={
            "symmetry": case.indenter.symmetry,
            "base": str(case.base),
            "strain": strain,
            "indenter": repr(case.indenter),
        },
    )


def elastic_response(
    basis: Any, symmetry: Symmetry, shear: FloatArray, squash: FloatArray, springs: Any, held: IndexArray
) -> Callable[[FloatArray], FloatArray]:
    """Factorise an elastic system, for coefficients (n, k) of the displacement under nodal loads (n, k).

    `shear` and `squash` are μ and 1/K, `springs` (n, n) is added, `held` displacements are zero.
    """
    r = basis.global_coordinates()[0]
    # strain rr, zz, hoop, √2 rz of each basis function, (functions, 4, elements, points)
    strain = np.stack(
        [
            [u.grad[0, 0], u.grad[1, 1], hoop_strain(symmetry, u, r), (u.grad[0, 1] + u.grad[1, 0]) / np.sqrt(2)]
            for (u,) in basis.basis
        ]
    )
    trace = strain[:, :3].sum(axis=1)
    strain[:, :3] -= trace[:, None] / 3
    measure, local = quadrature_weights(basis, symmetry), linear_pressures(basis)
    u, p = basis.element_dofs, np.arange(3 * len(measure)).reshape(3, -1)
    unknowns = basis.N + p.size
    free = np.setdiff1d(np.arange(unknowns), held)
    work = np.einsum("iceq,jceq,eq->ije", strain, strain, 2 * shear[:, None] * measure, optimize=True)
    stiffness = _scattered(work, u, u) + springs
    divergence = _scattered(-np.einsum("kq,ieq,eq->kie", local, trace, measure, optimize=True), p, u)

    def system(squash: FloatArray) -> Any:
        """Matrix of the free unknowns for 1/K of the elements."""
        bulk = -np.einsum("kq,lq,eq->kle", local, local, squash[:, None] * measure, optimize=True)
        blocks = [[stiffness, divergence.T], [divergence, _scattered(bulk, p, p)]]
        return sparse.block_array(blocks).tocsc()[free][:, free]

    exact, options = system(squash), {"SymmetricMode": True}
    factors = splu(system(squash + _SOFT / shear), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)

    def displacements(loads: FloatArray) -> FloatArray:
        right, found = (np.zeros((unknowns, loads.shape[1])) for _ in range(2))
        right[: len(loads)] = loads
        solution = factors.solve(right[free])
        for _ in range(_REFINEMENTS):
            solution += factors.solve(right[free] - exact @ solution)
        found[free] = solution
        return found[: len(loads)]

    return displacements


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
    u = elastic_response(grid.basis, symmetry, grid.shear, grid.squash, grid.springs, grid.held)(loads)
    return Compliance(grid, profile / grid.mass, loads.T @ u, grid.moved(u))
