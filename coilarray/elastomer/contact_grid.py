"""Mesh of a contact: stack, support, and hats of pressure.

The mesh consists of rectangles in (r, z), small under the indenter and larger outside. The pressure
is a sum of hat functions ψ_j on the vertices of the top. Point forces on the nodes of the
biquadratic elements would not do: under a uniform pressure the node on the axis carries none, so
their sign would not indicate contact. Lengths are in thicknesses of the stack and stresses in the
largest Young's modulus.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import sparse
from skfem import Basis, BilinearForm, ElementQuad1, ElementQuad2, ElementVector, LinearForm, MeshQuad

from coilarray.compute.arrays import FloatArray, IndexArray
from coilarray.errors import ElastomerError
from coilarray.geometry import Seat, Sheet
from coilarray.geometry.elastomer import Base, Symmetry

_MARGIN = 1.1  # elements grow from this multiple of the expected contact radius on
_NEAR = 6.0  # thicknesses from the contact, beyond which the elements grow without bound
_SUBSTEPS = 8  # of the march that places the points, per element
_TIP_ELEMENTS = 3  # across the radius of a blunted point
_BENT = 6.0  # lengths (D/k)^¼ beyond which a plate on a seat sinks by 1 % of its value at the force
_QUADRATURE = 5  # exact for products of two biquadratic functions and r


@dataclass(frozen=True)
class ContactMesh:
    """Fineness and extent of a contact's mesh.

    There are `elements` across the contact radius, at least 4. Neighbouring elements away from the
    contact have the ratio `growth`, above 1 and at most 2, which also determines the number of
    elements in a sheet. The mesh of a wide sample has the radius `extent` beyond the contact, in
    thicknesses of the stack, at least 1. Other values raise an ElastomerError.
    """

    elements: int = 40
    growth: float = 1.3
    extent: float = 25.0

    def __post_init__(self) -> None:
        if self.elements < 4:
            raise ElastomerError(f"elements across a contact must be at least 4; got {self.elements}.")
        if not 1 < self.growth <= 2:
            raise ElastomerError(f"growth of a contact's mesh must be above 1 and at most 2; got {self.growth}.")
        if not (math.isfinite(self.extent) and self.extent >= 1):
            raise ElastomerError(
                f"extent of a contact's mesh must be finite and at least 1 thickness; got {self.extent}."
            )

    def refined(self) -> ContactMesh:
        """Return a mesh with half the size of every element."""
        return ContactMesh(2 * self.elements, math.sqrt(self.growth), self.extent)


@dataclass(frozen=True)
class ContactZone:
    """Expected edge of the contact, in any unit of length.

    It is at `smallest` at the least depth and at `largest` at the greatest. Contact is searched up
    to the radius `search`. It is `sharp` if it reaches the indenter's edge, where the pressure is
    singular. A point of the indenter is blunted over the radius `tip`.
    """

    smallest: float
    largest: float
    search: float
    sharp: bool = False
    tip: float = 0.0


def graded(start: float, end: float, size: Callable[[float], float], least: int = 1) -> FloatArray:
    """Points from `start` to `end` about size(x) apart, in `least` intervals or more."""
    fine = [start]
    while fine[-1] < end:
        fine.append(fine[-1] + size(fine[-1]) / _SUBSTEPS)
    steps = len(fine) - 1
    last = steps - 1 + (end - fine[-2]) / (fine[-1] - fine[-2])  # the march meets the end here
    count = max(least, math.ceil(last / _SUBSTEPS))
    points = np.interp(np.linspace(0, last, count + 1), np.arange(steps + 1), fine)
    points[-1] = end
    return points


def radial_points(zone: ContactZone, thickness: float, end: float, mesh: ContactMesh) -> FloatArray:
    """Radii of the vertices up to `end`, with the search's end."""
    n, edge, slope = mesh.elements, zone.largest, mesh.growth - 1
    finest = zone.largest / n**2  # at a sharp edge

    def size(r: float) -> float:
        contact = max(zone.smallest, min(r, edge)) / n + slope * max(0.0, r - _MARGIN * edge)
        wave = slope * (thickness / 2 + max(0.0, r - edge - _NEAR * thickness))
        corner = finest + slope * abs(r - edge) if zone.sharp else math.inf
        point = zone.tip / _TIP_ELEMENTS + slope * r if zone.tip else math.inf
        return min(contact, wave, corner, point)

    if zone.search >= end:
        return graded(0.0, end, size)
    return np.concatenate((graded(0.0, zone.search, size), graded(zone.search, end, size)[1:]))


def vertical_points(zone: ContactZone, levels: FloatArray, mesh: ContactMesh) -> FloatArray:
    """Levels of the vertices up to 0, with all interfaces."""
    slope, total = mesh.growth - 1, -float(levels[0])
    # at a sharp indenter's edge, else under the tip
    finest = zone.largest / mesh.elements**2 if zone.sharp else zone.smallest / mesh.elements
    finest = min(finest, zone.tip / _TIP_ELEMENTS or math.inf)

    def size(below: float) -> float:
        return min(finest + slope * below, slope * total)

    least = math.ceil(1 / slope)
    pieces = [levels[:1]]
    for lower, upper in pairwise(levels):
        pieces.append(-graded(-upper, -lower, size, least)[-2::-1])
    return np.concatenate(pieces)


def contact_mesh(r: FloatArray, z: FloatArray) -> MeshQuad:
    """Rectangles between radii and levels: axis, outer, bottom and top."""
    return MeshQuad.init_tensor(r, z).with_boundaries(
        {
            "axis": lambda x: x[0] == r[0],
            "outer": lambda x: x[0] == r[-1],
            "bottom": lambda x: x[1] == z[0],
            "top": lambda x: x[1] == z[-1],
        }
    )


def weight(symmetry: Symmetry, r: FloatArray) -> FloatArray:
    """Measure over dr dz: r about an axis, 1 in plane strain."""
    return r if symmetry == "axial" else np.ones_like(r)


def hoop_strain(symmetry: Symmetry, u: Any, r: FloatArray) -> FloatArray:
    """Return u_r/r about an axis, 0 in plane strain."""
    return np.asarray(u[0] / r if symmetry == "axial" else np.zeros_like(r))


def quadrature_weights(basis: Any, symmetry: Symmetry) -> FloatArray:
    """Weights of ∫ … w dr dz at the quadrature points, (elements, points)."""
    return np.asarray(basis.dx * weight(symmetry, basis.global_coordinates()[0]))


def linear_pressures(basis: Any) -> FloatArray:
    """Pressure functions 1, ξ and η at the quadrature points, (3, points)."""
    return np.stack([np.ones(basis.dx.shape[1]), *(basis.X - 0.5)])


@dataclass(frozen=True, eq=False)
class Stack:
    """Sheets on a board, in their thickness and largest modulus.

    `length` in m and `stress` in Pa are these units. `shear` is the shear modulus μ = E/(2(1 + ν)),
    and `squash` the compressibility 1/K = 3(1 − 2ν)/E, by sheet from the board up.
    """

    length: float
    stress: float
    thicknesses: FloatArray
    shear: FloatArray
    squash: FloatArray

    @property
    def levels(self) -> FloatArray:
        """Heights of board and interfaces, the top at 0."""
        return -np.append(np.cumsum(self.thicknesses[::-1])[::-1], 0.0)


def stack_of(sheets: Sequence[Sheet]) -> Stack:
    """Return the stack of sheets with known Young's moduli."""
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
class ContactGrid:
    """A meshed stack in its own units.

    `basis` is the basis of the displacement (biquadratic, n functions) and `held` its degrees of
    freedom that are zero. `shear` and `squash` (elements,) are μ and 1/K. `springs` (n, n) is the
    stiffness of the support and of the material beyond the outer edge. `top` and `hats` are the
    bases of displacement and pressure where contact is searched. `used` are the hats' degrees of
    freedom from the axis outwards, with `mass` = ∫ψ_j w dr. `lines` has the degrees of freedom u_r
    and u_z on every interface, at the radii `r`.
    """

    symmetry: Symmetry
    basis: Any
    held: IndexArray
    shear: FloatArray
    squash: FloatArray
    springs: Any
    top: Any
    hats: Any
    used: IndexArray
    radii: FloatArray
    mass: FloatArray
    r: FloatArray
    lines: tuple[tuple[IndexArray, IndexArray], ...]

    def moved(self, u: FloatArray) -> FloatArray:
        """Return u_r and u_z of every interface, (2, interfaces, r, …)."""
        return np.array([[u[line[k]] for line in self.lines] for k in range(2)])


def displacement_basis(mesh: MeshQuad) -> Any:
    """Biquadratic displacement on rectangles in (r, z)."""
    return Basis(mesh, ElementVector(ElementQuad2()), intorder=_QUADRATURE)


def contact_grid(
    stack: Stack, symmetry: Symmetry, zone: ContactZone, base: Base, radius: float | None, mesh: ContactMesh
) -> ContactGrid:
    """Mesh a stack for contacts in an expected zone.

    The sample's `radius` is in thicknesses, None if wide, half the width in plane strain.
    """
    bending = 0.0  # distance in thicknesses: lengths (D/k)^¼ of a plate on a soft seat, D = Eh³/9 for ν = 0.5
    if isinstance(base, Seat):
        bending = _BENT * float((9 * base.stiffness * stack.length / stack.stress) ** -0.25)
    end = zone.search + max(mesh.extent, bending) if radius is None else radius
    levels = stack.levels
    r, z = radial_points(zone, 1.0, end, mesh), vertical_points(zone, levels, mesh)
    grid = contact_mesh(r, z)
    sheet = np.searchsorted(levels[1:-1], grid.p[1, grid.t].mean(axis=0))
    basis = displacement_basis(grid)
    shear = stack.shear[sheet]

    springs = sparse.csr_array((basis.N, basis.N))
    if radius is None:
        springs = springs + far_field(basis, symmetry, shear)
    axis = basis.get_dofs("axis").all("u^1")
    if isinstance(base, Seat):
        unit = stack.length / stack.stress
        normal, tangential = base.stiffness * unit, base.shear * unit
        winkler = BilinearForm(
            lambda u, v, w: (normal * u[1] * v[1] + tangential * u[0] * v[0]) * weight(symmetry, w.x[0])
        )
        springs = springs + winkler.assemble(basis.boundary("bottom"))
        held = axis
    else:
        held = np.union1d(axis, basis.get_dofs("bottom").all(["u^2"] if base == "frictionless" else ["u^1", "u^2"]))

    middle = grid.p[:, grid.facets].mean(axis=1)
    top = basis.boundary(np.flatnonzero((middle[1] == z[-1]) & (middle[0] < zone.search)))
    hats = top.with_element(ElementQuad1())
    used = hats.get_dofs(top.find).flatten()
    used = used[np.argsort(hats.doflocs[0, used])]
    mass = LinearForm(lambda psi, w: psi * weight(symmetry, w.x[0])).assemble(hats)[used]
    lines = tuple(_line(basis, np.flatnonzero(middle[1] == level)) for level in levels)
    return ContactGrid(
        symmetry=symmetry,
        basis=basis,
        held=held,
        shear=shear,
        squash=stack.squash[sheet],
        springs=springs,
        top=top,
        hats=hats,
        used=used,
        radii=hats.doflocs[0, used],
        mass=mass,
        r=basis.doflocs[0, lines[-1][0]],
        lines=lines,
    )


def _line(basis: Any, facets: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Degrees of freedom u_r and u_z on facets, from the axis outwards."""
    on = basis.get_dofs(facets)
    r, z = (np.asarray(on.all(name)) for name in ("u^1", "u^2"))
    return r[np.argsort(basis.doflocs[0, r])], z[np.argsort(basis.doflocs[0, z])]


def far_field(basis: Any, symmetry: Symmetry, shear: FloatArray) -> Any:
    """Traction ∫2μ u_r/r v_r w under which u_r = B/r (plane: constant) continues outside."""
    edge = basis.boundary("outer")

    def form(u: Any, v: Any, w: Any) -> Any:
        return 2 * w.shear * hoop_strain(symmetry, u, w.x[0]) * v[0] * weight(symmetry, w.x[0])

    return BilinearForm(form).assemble(edge, shear=np.tile(shear[edge.tind][:, None], edge.X.shape[-1]))
