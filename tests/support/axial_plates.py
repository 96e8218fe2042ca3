"""Finite elements for discs and rings about the axis of circular loops: what their eddy currents and iron change.

With ψ = r A' of the field that the metal adds, and ψ_s = r A_s of the loops by elliptic integrals,

    a(ψ, v) = ∫ (∇ψ·∇v/µr + jωµ0σ ψ v)/r = f(v) = ∫_metal ((1 − 1/µr) ∇ψ_s·∇v − jωµ0σ ψ_s v)/r,
    ΔL − jΔR/ω = 2π/µ0 (f(ψ_s) + f(ψ)),

so that only the metal is a source, and a small change is no difference of large numbers. Rectangles of the second order
on lines that crowd at all faces and beside the loops: the error of the change is that of ψ in energy, of the fourth
order but for the corners of iron.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.special import ellipe, ellipk
from skfem import Basis, BilinearForm, ElementQuad2, LinearForm, MeshQuad
from skfem.helpers import dot, grad

from coilarray.constants import MU_0
from coilarray.geometry.bodies import Disc
from coilarray.metal.half_body import EddyBody
from coilarray.metal.plate_mesh import plate_meshes
from support.axial_field import symmetric


@dataclass(frozen=True)
class AxialPlate:
    """A ring, inner < r < outer and bottom < z < top in m, about the axis; a disc has the inner radius 0."""

    inner: float
    outer: float
    bottom: float
    top: float
    conductivity: float
    permeability: float = 1.0

    def skin_depth(self, frequency):
        return 1 / np.sqrt(np.pi * frequency * MU_0 * self.permeability * self.conductivity)


@BilinearForm
def energy(u, v, w):
    return dot(grad(u), grad(v)) * w.reluctivity / w.x[0]


@BilinearForm
def eddies(u, v, w):
    return u * v / w.x[0]


@LinearForm
def magnetised(v, w):
    return dot(w.slope, grad(v)) / w.x[0]


@LinearForm
def driven(v, w):
    return w.value * v / w.x[0]


def loops_potential(loops, r, z):
    """r A and its gradient of loops (radius, height) in m in series with 1 A, divided by µ0."""
    value, slope = np.zeros_like(r), np.zeros((2, *r.shape))
    for a, height in loops:
        up = z - height
        far, near = (a + r) ** 2 + up**2, (a - r) ** 2 + up**2
        m = 4 * a * r / far
        K, E = ellipk(m), ellipe(m)
        value += np.sqrt(far) / (2 * np.pi) * ((1 - m / 2) * K - E)
        slope[0] += r / (2 * np.pi * np.sqrt(far)) * (K + (a**2 - r**2 - up**2) / near * E)
        slope[1] -= up / (2 * np.pi * np.sqrt(far)) * (-K + (a**2 + r**2 + up**2) / near * E)
    return value, slope


def change_on(mesh, inside, loops, plate, frequency):
    """ΔL − jΔR/ω in H of loops in series by the elements `inside` a mesh of the half-plane r > 0."""
    basis = Basis(mesh, ElementQuad2(), intorder=6)
    metal = Basis(mesh, ElementQuad2(), elements=np.flatnonzero(inside), intorder=8)
    loss, iron = 2j * np.pi * frequency * MU_0 * plate.conductivity, 1 - 1 / plate.permeability
    matrix = energy.assemble(basis, reluctivity=np.where(inside, 1 - iron, 1.0)[:, None])
    matrix = matrix + loss * eddies.assemble(metal)
    r, z = np.asarray(metal.global_coordinates())
    value, slope = loops_potential(loops, r, z)
    load = iron * magnetised.assemble(metal, slope=slope) - loss * driven.assemble(metal, value=value)
    own = ((iron * (slope**2).sum(axis=0) - loss * value**2) / r * metal.dx).sum()
    free = np.setdiff1d(np.arange(basis.N), basis.get_dofs().flatten())
    return 2 * np.pi * MU_0 * (own + load[free] @ symmetric(matrix[free][:, free].tocsc()).solve(load[free]))


def axial_change(loops, plate, frequency, fineness=1.0, far=60.0):
    """ΔL − jΔR/ω in H of loops (radius, height) in m in series by a plate, at z = 0 in its middle.

    The first lines beside a face are a quarter of the skin depth or an eighth of the thickness from it, and each step
    is 1.4 times the one before; `fineness` 2 halves all. The potential is zero at `far` sizes of loops and plate.
    """
    radii, heights = np.array(loops).T
    gap = max(plate.bottom - heights.max(), heights.min() - plate.top)
    size = max(radii.max(), gap, plate.outer)
    fine = min(plate.skin_depth(frequency) / 4, (plate.top - plate.bottom) / 8, gap / 4) / fineness
    corner = fine / 20 if plate.permeability > 1 else fine
    edges = [edge for edge in (plate.inner, plate.outer) if edge]
    places = {0.0: size / 10 / fineness, far * size: far * size}
    places |= {a: min(gap, a) / 4 / fineness for a in radii.tolist() if all(abs(a - edge) > 2 * fine for edge in edges)}
    places |= dict.fromkeys(edges, min(corner, (plate.outer - plate.inner) / 8 / fineness))
    faces = [(plate.bottom, corner), (plate.top, corner)]
    upwards = [(-far * size, far * size), *faces, (far * size, far * size)]
    r, z = (lines(some, 1.4 ** (1 / fineness)) for some in (sorted(places.items()), upwards))
    mesh = MeshQuad.init_tensor(r, z)
    middle = mesh.p[:, mesh.t].mean(axis=1)
    inside = (middle[0] > plate.inner) & (middle[0] < plate.outer)
    inside &= (middle[1] > plate.bottom) & (middle[1] < plate.top)
    return change_on(mesh, inside, loops, plate, frequency)


def axial_truth(loops, plate, frequency, fineness=1.4):
    """ΔL − jΔR/ω in H, and its own error, of the real part and of the imaginary one.

    The mesh of half as many elements errs more than three times as much. An edge at half the distance, 30 sizes, moves
    both parts by less than 1e-5 of them.
    """
    middle = (plate.bottom + plate.top) / 2
    plate = replace(plate, bottom=plate.bottom - middle, top=plate.top - middle)
    loops = [(a, height - middle) for a, height in loops]
    best, coarse = (axial_change(loops, plate, frequency, one) for one in (fineness, fineness / 1.4))
    mesh = coarse - best
    return best, complex(abs(mesh.real) / 2 + 1e-5 * abs(best.real), abs(mesh.imag) / 2 + 1e-5 * abs(best.imag))


def lines(places, growth):
    """Lines through rising places, each with the distance of its next line, which grow by a factor between them."""
    found = [np.array([places[0][0]])]
    for (start, first), (stop, last) in pairwise(places):
        left, right = [0.0], [0.0]
        while left[-1] + right[-1] < stop - start:
            steps = first * growth ** (len(left) - 1), last * growth ** (len(right) - 1)
            shorter = left if steps[0] <= steps[1] else right
            shorter.append(shorter[-1] + min(steps))
        scale = (stop - start) / (left[-1] + right[-1])
        found.append(np.unique(np.concatenate((start + scale * np.array(left)[1:], stop - scale * np.array(right)))))
    together = np.concatenate(found)
    return together[np.concatenate(([True], np.diff(together) > 1e-13))]


def sphere_body(radius, fineness):
    """A sphere of a radius in m: the mesh of a disc's face drawn over half of it."""
    face = plate_meshes(Disc(1.0), 1.0, fineness)[1]
    top = face.triangles[~face.rim]
    nodes = face.nodes[: top.max() + 1, :2]
    edge = np.unique(face.triangles[face.rim])
    edge = edge[edge < len(nodes)]
    distance = np.hypot(*nodes.T)
    angle = np.pi / 2 * np.minimum(distance / distance[edge].mean(), 1.0)
    angle[edge] = np.pi / 2
    turned = nodes * (np.sin(angle) / np.maximum(distance, 1e-12))[:, None]
    height = np.cos(angle)
    height[edge] = 0.0
    points = radius * np.column_stack((turned, height))
    return EddyBody(replace(face, nodes=points, triangles=top, rim=np.zeros(len(top), bool), ring=edge))
