"""Eddy currents by stream function on a symmetric body, and their surface impedance.

The equations (λ G + M) ψ = −b and λ of the faces are in docs/theory/metal.md, "Plates with an
outline". The currents K = ∇ψ × n of linear elements ψ are constant on each triangle: e_i/2A for
node i, e_i the side opposite to it. ψ is 0 on the outer rim at mid-height and a constant on each
hole's rim, with the flux through the hole in b. Currents that are even about the mid-plane (K_z
odd) do not couple to odd currents, so the upper half carries two problems of half the size, with
the currents' mirror images in M and b. Then ΔL = bᵀψ is symmetric and −Im ΔL positive semidefinite.

With k² = jωµ0σ and κ the wavenumber along the plate, a vector potential that is even about the
mid-plane is A cosh(γz)/cosh(γt/2) in the metal, γ² = κ² + k². In air it would be A
cosh(κz)/cosh(κt/2). So the current of each face, the jump of H from the air solution inside to the
air outside, is A (γ tanh(γt/2) − κ tanh(κt/2))/µ0, and λ is the ratio of A to it. An odd potential
has coth in place of tanh. At the rim, in the corner of a strip of metal, p_n = (2n + 1)π/t,

    F = Σ 8 k²/((2n + 1)²π² (p_n² + k²)^{3/2}),
    λ_along = µ0/(k² F),   λ_across = µ0 F/(1 − tanh(kt/2)/(kt/2)),

are the current along the rim beyond the current of the faces (A = 1 on all sides of the strip), and
the flux beyond the flux of the faces (H = 1 on all sides). For t ≫ δ both are the same (1 + j)/σδ.
For t ≪ δ there is no current along the rim, as the faces carry all of it.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from coilarray.compute.arrays import ComplexArray, FloatArray, IntArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import ranges, run_blocks
from coilarray.constants import MU_0
from coilarray.electromagnetics.flat_stack import Layer, layer_waves
from coilarray.electromagnetics.kernels.triangles import triangle_pairs
from coilarray.geometry.bodies import Material
from coilarray.metal.plate_mesh import HalfBody

_TERMS = 4096  # of F, whose remainder falls as their number squared, or in thick plates by itself
_STIFF = 1e-6  # of the thickness: below this |F| the rim carries no current along it, to double precision
_WEAK = 1e-6  # |k²| over κ² + 4/t², below which differences are taken by the derivative
_DEEP = 20.0  # real part of γt/2, beyond which tanh is 1


@dataclass(frozen=True)
class SurfaceImpedance:
    """λ = Z/jω in H of faces (even, odd) and rim (along, across)."""

    even: complex
    odd: complex
    along: complex
    across: complex


def surface_impedance(material: Material, thickness: float, frequency: float, kappa: float) -> SurfaceImpedance:
    """Compute the impedances of a plate without iron, in SI units."""
    if math.isinf(material.conductivity):
        return SurfaceImpedance(0, 0, 0, 0)
    even, odd = face_impedances(material, thickness, frequency, kappa)
    k = (1 + 1j) / material.skin_depth(frequency)
    x = k * thickness / 2
    # 1 − tanh(x)/x without cancellation
    short = x * x / 3 * (1 - 2 * x * x / 5 * (1 - 17 * x * x / 42)) if abs(x) < 0.05 else 1 - _tanh(x) / x
    odd_number = 2 * np.arange(_TERMS) + 1
    p = odd_number * np.pi / thickness
    F = complex((8 * k**2 / (odd_number**2 * np.pi**2 * (p**2 + k**2) ** 1.5)).sum())
    F += _STIFF * thickness * (1 - 1j) if abs(F) < _STIFF * thickness else 0
    return SurfaceImpedance(even, odd, along=MU_0 / (k**2 * F), across=MU_0 * F / short)


def model_error(material: Material, thickness: float, frequency: float, taken: float, kappa: float) -> FloatArray:
    """Relative errors (3,) of ΔL − jΔR/ω, ΔL and ΔR for the wavenumber `kappa`.

    They are of an infinite plate's reflection, due to λ at the κ `taken`, both in 1/m. With e =
    e^{−κt}, R = −½ Σ± (1 ± e)/(1 + 2κλ/(µ0 (1 ± e))), as each face lies in the field of both. A
    magnetic plate has R = (κℓ − 1)/(κℓ + 1) by `coilarray.metal.magnetic_plates`, and errors of
    |R|. The edges' error comes with its solution.
    """
    if math.isinf(material.conductivity):
        return np.zeros(3)
    if material.relative_permeability != 1:
        way = kappa * material.relative_permeability * material.skin_depth(frequency) * (1 - 1j) / 2
        layer = Layer(thickness, material.relative_permeability, material.conductivity)
        wave = complex(layer_waves([layer], np.array([kappa]), 2 * np.pi * frequency).reflection[0])
        return np.full(3, abs((way - 1) / (way + 1) - wave) / abs(wave))
    e = math.exp(-kappa * thickness)
    found, exact = (
        sum(part / (1 + 2 * kappa * value / (MU_0 * part)) for part, value in zip((1 + e, 1 - e), values, strict=True))
        for values in (face_impedances(material, thickness, frequency, at) for at in (taken, kappa))
    )
    return np.abs([found / exact - 1, found.real / exact.real - 1, found.imag / exact.imag - 1])


def face_impedances(material: Material, t: float, frequency: float, kappa: float) -> tuple[complex, complex]:
    """Impedances λ in H for even and odd fields at κ in 1/m."""
    k2 = 2j / material.skin_depth(frequency) ** 2
    own, tanh_own = kappa * t / 2, math.tanh(kappa * t / 2)
    if abs(k2) < _WEAK * (kappa**2 + 4 / t**2):
        even = k2 * t / 4 * (tanh_own / own + 1 - tanh_own**2)
        if own < 0.05:
            odd = k2 * t / 6 * (1 - 2 * own**2 / 15)
        else:
            odd = k2 * t / 4 * (1 / (own * tanh_own) - 1 / math.sinh(own) ** 2)
        return MU_0 / even, MU_0 / odd
    gamma = cmath.sqrt(kappa**2 + k2)
    tanh = _tanh(gamma * t / 2)
    return MU_0 / (gamma * tanh - kappa * tanh_own), MU_0 / (gamma / tanh - kappa / tanh_own)


def _tanh(x: complex) -> complex:
    return cmath.tanh(x) if x.real < _DEEP else 1.0


ROWS = 32  # triangles in one task of a pair integral
_AT_ONCE = 128  # rows, which stay in the cache
MIRROR = np.array([1.0, 1.0, -1.0])  # signs of the coordinates in the mirror image at the mid-plane
# ∫ λ_i φ_j dA over the area of a triangle, with λ_i linear and φ_j quadratic: first the functions
# of its corners, then of the middles of the opposite sides
_SHARES = np.hstack((np.eye(3) / 20 - 1 / 60, 2 / 15 - np.eye(3) / 15))


@dataclass(frozen=True, eq=False)
class Parity:
    """Problem of even (sign 1) or odd (−1) currents.

    `unknowns` (n, u) maps the unknowns to the nodes. M in H is for half the body. `faces`, `along`
    and `across` are the parts of G of the faces, and of the rim for currents along and across it.
    """

    sign: int
    unknowns: sp.csr_array
    M: FloatArray
    faces: FloatArray
    along: FloatArray
    across: FloatArray

    def matrix(self, impedance: SurfaceImpedance) -> ComplexArray:
        """Matrix λ G + M of the whole body, (u, u) in H."""
        face = impedance.even if self.sign > 0 else impedance.odd
        G = face * self.faces + impedance.along * self.along + impedance.across * self.across
        return np.asarray(2 * (self.M + G))


@dataclass(frozen=True, eq=False)
class EddyBody:
    """Matrices of a body for all fields, places, frequencies.

    A `finer` body has nodes between these.
    """

    mesh: HalfBody
    finer: EddyBody | None = None

    @property
    def finest(self) -> EddyBody:
        """Body over whose triangles fields are integrated."""
        return self.finer or self

    @cached_property
    def onto_finest(self) -> sp.csr_array:
        """Linear functions of this body at the finest nodes, (finest nodes, nodes)."""
        n, parents = len(self.mesh.nodes), None if self.finer is None else self.finer.mesh.parents
        if parents is None:
            return sp.eye_array(n, format="csr")
        rows = np.repeat(np.arange(len(parents)), 2)
        return sp.csr_array((np.full(parents.size, 0.5), (rows, parents.ravel())), shape=(len(parents), n))

    @cached_property
    def currents(self) -> tuple[sp.csr_array, ...]:
        """K_x, K_y and K_z (k, n) in 1/m of every triangle for ψ = 1 at each node."""
        corners = self.mesh.corners
        opposite = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
        K = opposite / (2 * self.areas)[:, None, None]
        return tuple(self.by_corner(K[..., axis]) for axis in range(3))

    @cached_property
    def areas(self) -> FloatArray:
        """Areas of the triangles in m²."""
        return np.asarray(np.sqrt((self._area_vectors**2).sum(axis=1)))

    @cached_property
    def _edges(self) -> tuple[IntArray, IntArray]:
        """Ends of edges (e, 2), and edges (k, 3) opposite to corners."""
        ends = np.stack((np.roll(self.mesh.triangles, -1, axis=1), np.roll(self.mesh.triangles, -2, axis=1)), axis=-1)
        edges, number = np.unique(np.sort(ends.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
        return edges, number.reshape(-1, 3)

    @cached_property
    def fluxes(self) -> tuple[sp.csr_array, ...]:
        """∫ ψ_i φ_j n dA in m², component by component, each (n, n + e).

        φ_j are the quadratic functions of the nodes and the middles of the edges, between which a
        field is interpolated. With linear functions the error would be 1 to 3 % of ΔL.
        """
        (edges, opposite), n, parts = self._edges, len(self.mesh.nodes), []
        rows = np.repeat(self.mesh.triangles, 6, axis=1).ravel()
        columns = np.tile(np.hstack((self.mesh.triangles, n + opposite)), (1, 3)).ravel()
        for axis in range(3):
            blocks = (self._area_vectors[:, axis, None, None] * _SHARES).ravel()
            parts.append(sp.csr_array((blocks, (rows, columns)), shape=(n, n + len(edges))))
        return tuple(parts)

    @cached_property
    def _area_vectors(self) -> FloatArray:
        corners = self.mesh.corners
        return np.asarray(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2)

    def by_corner(self, values: FloatArray) -> sp.csr_array:
        """Sparse matrix (k, n) of values (k, 3) at the triangles' corners."""
        where = np.repeat(np.arange(len(self.areas)), 3), self.mesh.triangles.ravel()
        return sp.csr_array((values.ravel(), where), shape=(len(self.areas), len(self.mesh.nodes)))

    @cached_property
    def integrals(self) -> tuple[FloatArray, FloatArray]:
        """∫∫ 1/r in m³ of all pairs of triangles, and with mirror images."""
        corners = self.mesh.corners
        image = pair_integrals(corners, np.ascontiguousarray(corners * MIRROR), mirrored=True)
        return pair_integrals(corners), image

    @cached_property
    def inductances(self) -> tuple[FloatArray, FloatArray]:
        """Inductances M (n, n) in H of the nodes' currents, and with their images."""
        own, image = self.integrals
        return inductance(self.currents, own, np.ones(3)), inductance(self.currents, image, MIRROR)

    @cached_property
    def gradients(self) -> list[sp.csr_array]:
        """∇ψ = n × K in 1/m of triangles for ψ = 1 at nodes, each (k, n)."""
        normals, K = self._area_vectors / self.areas[:, None], self.currents
        return [
            sp.csr_array(sp.diags_array(normals[:, one]) @ K[other] - sp.diags_array(normals[:, other]) @ K[one])
            for one, other in ((1, 2), (2, 0), (0, 1))
        ]

    def linked_to(self, B: FloatArray, sign: int) -> tuple[FloatArray, FloatArray]:
        """∫ ψ B·n in Wb and ∫ ∇ψ·B in T·m over the whole body, (nodes, fields).

        Potentials are even (sign 1) or odd about the mid-plane, B (fields, points, 3) is in T.
        """
        body, down = self.finest, self.onto_finest.T.tocsr()
        field, through = body._through(B, sign)
        middles = field[:, len(body.mesh.nodes) :][:, body._edges[1]].mean(axis=2) * body.areas[:, None]
        along = sum(G.T @ middles[..., axis].T for axis, G in enumerate(body.gradients))
        return np.asarray(down @ through), np.asarray(down @ along)

    def _through(self, B: FloatArray, sign: int) -> tuple[FloatArray, FloatArray]:
        """Fields folded onto the upper half, and their ∫ ψ B·n, for potentials of a sign."""
        n = self.fluxes[0].shape[1]
        field = B[:, :n] + sign * MIRROR * B[:, n : 2 * n]
        return field, np.sum([N @ field[..., axis].T for axis, N in enumerate(self.fluxes)], axis=0)

    @cached_property
    def parities(self) -> tuple[Parity, Parity]:
        """Even and odd problem."""
        k, n = len(self.mesh.triangles), len(self.mesh.nodes)
        require_memory(8.0 * (2 * k * k + 6 * n * n), f"the eddy currents on {k} triangles", "use a coarser mesh")
        K, M = self.currents, self.inductances
        free = np.setdiff1d(np.arange(n), np.concatenate((self.mesh.ring, *self.mesh.hole_rings)))
        ones = [
            sp.csr_array((np.ones(len(ring)), (ring, np.zeros(len(ring), int))), (n, 1))
            for ring in self.mesh.hole_rings
        ]
        everything = sp.eye_array(n, format="csr")
        bases = (sp.hstack((everything[:, free], *ones), format="csr"), everything[:, 1:])  # odd: all but a constant
        face, rim = self.areas * ~self.mesh.rim, self.areas * self.mesh.rim
        parts = [
            sum(K[axis].T @ sp.diags_array(areas) @ K[axis] for axis in axes)
            for areas, axes in ((face, (0, 1, 2)), (rim, (0, 1)), (rim, (2,)))
        ]
        made = []
        for sign, basis in zip((1, -1), bases, strict=True):
            dense = np.asarray(basis.T @ (M[0] + sign * M[1]) @ basis)
            stiff = [(basis.T @ part @ basis).toarray() for part in parts]
            made.append(Parity(sign, basis, (dense + dense.T) / 2, *stiff))
        return made[0], made[1]

    @property
    def points(self) -> FloatArray:
        """Points in m of nodes, edges' middles, their images, and holes."""
        mesh, edges = self.finest.mesh, self.finest._edges[0]
        caps = [np.column_stack((points, np.zeros(len(points)))) for points, _ in mesh.caps]
        half = np.concatenate((mesh.nodes, mesh.nodes[edges].mean(axis=1)))
        return np.concatenate((half, half * MIRROR, *caps))

    def linked(self, B: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fluxes b of even and of odd currents, (u, fields), for B (fields, points, 3) in T."""
        body, down = self.finest, self.onto_finest.T.tocsr()
        # B is an axial vector, so that its flux is even where a potential is odd
        even, odd = (
            np.asarray(parity.unknowns.T @ (down @ body._through(B, -parity.sign)[1])) for parity in self.parities
        )
        start, first = 2 * body.fluxes[0].shape[1], len(even) - len(body.mesh.caps)
        for hole, (_, weights) in enumerate(body.mesh.caps):
            even[first + hole] += 2 * B[:, start : start + len(weights), 2] @ weights
            start += len(weights)
        return even, odd


def pair_integrals(corners: FloatArray, other: FloatArray | None = None, *, mirrored: bool = False) -> FloatArray:
    """∫∫ 1/r in m³ of all pairs of triangles, (k, k) or (k, l).

    The pairs are with `other` triangles, or with `mirrored` images of the same.
    """
    second = corners if other is None else other
    integrals = np.zeros((len(corners), len(second)))
    symmetric = mirrored or other is None

    def work(rows: tuple[int, int]) -> None:
        first = rows[0] if symmetric else len(second)
        triangle_pairs(corners[rows[0] : rows[1]], second, first, integrals[rows[0] : rows[1]])

    run_blocks(work, ranges(len(corners), ROWS)[::-1])  # the longest rows first
    if symmetric:
        for start, stop in ranges(len(corners), _AT_ONCE):
            integrals[start:stop, stop:] = integrals[stop:, start:stop].T
            own = integrals[start:stop, start:stop]
            own += np.tril(own, -1).T
    return integrals


def inductance(
    currents: Sequence[sp.csr_array],
    integrals: FloatArray,
    signs: FloatArray,
    others: Sequence[sp.csr_array] | None = None,
) -> FloatArray:
    """Inductances of currents on triangles, (n, m) in H.

    They are µ0/4π Σ signs K K' times integrals (k, l) in m³, for K_x, K_y and K_z (k, n) and (l, m)
    in 1/m. Without `others` the integrals are of the same triangles, or of their images.
    """
    second = currents if others is None else others
    total = np.zeros((currents[0].shape[1], second[0].shape[1]))
    terms = [(K.T.tocsr(), other.T.tocsr(), sign) for K, other, sign in zip(currents, second, signs, strict=True)]

    def work(rows: tuple[int, int]) -> None:
        for K, other, sign in terms:
            potentials = K[slice(*rows)] @ integrals
            total[slice(*rows)] += sign * (other @ np.ascontiguousarray(potentials.T)).T

    run_blocks(work, ranges(len(total), _AT_ONCE))
    return np.asarray(MU_0 / (4 * np.pi) * total)
