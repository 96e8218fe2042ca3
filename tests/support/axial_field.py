"""Finite elements for circular loops about the axis of any materials: what these do to inductance and loss."""

import numpy as np
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, ElementQuad2, ElementTriP2, MeshQuad, MeshTri

from coilarray.constants import MU_0
from coilarray.elastomer.dent import Dent

FAR = 0.16  # m, where the potential is held at zero


@BilinearForm
def energy(u, v, w):
    r = w.x[0]
    return w.reluctivity * (u.grad[1] * v.grad[1] * r + (u.grad[0] * r + u) * (v.grad[0] * r + v) / r)


@BilinearForm
def loss(u, v, w):
    return w.conductivity * u * v * w.x[0]


def disc_region(radius, bottom, top):
    """Where a disc about the axis is, and the distances from its faces and rim, as `loop_inductance` takes them."""
    middle, half = (bottom + top) / 2, (top - bottom) / 2

    def inside(r, z):
        return (r < radius) & (z > bottom) & (z < top)

    def edges(r, z):
        beside, over = r - radius, np.abs(z - middle) - half
        return np.where(inside(r, z), np.minimum(-beside, -over), np.hypot(np.maximum(beside, 0), np.maximum(over, 0)))

    return inside, edges


def vacuum(r, z):
    """Return relative permeability and conductivity at points."""
    return np.ones_like(r), np.zeros_like(r)


def loop_inductance(loops, materials, frequency, near, edges, finest, others=vacuum):
    """ΔL − jΔR/ω in H, shape (loops,), of loops (radius, height) in m by materials, against others on the same mesh.

    `materials(r, z)` gives relative permeability and conductivity at points; faces at every 2 mm are on lines of the
    mesh. Elements within their own size of a surface, from which `edges(r, z)` are the distances in m, are divided
    until they are at most `finest` m; those where `near(r, z)` holds are at most 8 times larger.
    """
    outwards = np.array([0, 2, 4, 6, 8, 10, 12, 14, 16, 20, 26, 36, 52, 80, 120, FAR * 1e3]) * 1e-3
    mesh = MeshTri.init_tensor(outwards, np.concatenate((-outwards[:0:-1], outwards)))
    while True:
        corners = mesh.p[:, mesh.t]
        size = np.ptp(corners, axis=1).max(axis=0)
        r, z = corners.mean(axis=1)
        close = edges(r, z) < size
        source = np.min([np.hypot(r - a, z - h) for a, h in loops], axis=0) < 2 * size
        wanted = np.where(close, finest, np.where(near(r, z), 8 * finest, FAR))
        wanted = np.minimum(wanted, np.where(source, 16 * finest, FAR))
        wanted = np.minimum(wanted, np.maximum(0.25 * np.hypot(r, z), 2e-3))
        split = np.flatnonzero(size > wanted * 1.001)
        if not len(split):
            break
        mesh = mesh.refined(split)
    basis = Basis(mesh, ElementTriP2(), intorder=6)

    sources = np.zeros((basis.N, len(loops)))
    for number, (radius, height) in enumerate(loops):
        probe = basis.probes(np.array([[radius], [height]]))
        sources[:, number] = radius * probe.toarray().ravel()
    free = np.setdiff1d(np.arange(basis.N), basis.get_dofs().flatten())
    fields = []
    for mu, sigma in (one(*np.asarray(basis.global_coordinates())) for one in (materials, others)):
        matrix = energy.assemble(basis, reluctivity=1 / mu)
        if frequency and sigma.any():
            matrix = matrix + 2j * np.pi * frequency * MU_0 * loss.assemble(basis, conductivity=sigma)
        matrix = matrix[free][:, free].tocsc()
        fields.append(symmetric(matrix).solve(sources[free].astype(matrix.dtype)))
    return 2 * np.pi * MU_0 * (sources[free] * (fields[0] - fields[1])).sum(axis=0)


def symmetric(matrix):
    """Factors of a symmetric matrix of finite elements, whose diagonal needs no pivots: fewer than any order has."""
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def dent_over_metal(loops, dent, region, permeability, conductivity, frequency):
    """What a dent in two sheets does to loops over metal, in H, shape (loops,).

    `region` says where the metal is, and gives the distances from its faces, as `disc_region` does.
    """
    inside, edges = region
    base, top = dent.thicknesses[0], sum(dent.thicknesses)

    def materials(dented):
        def at(r, z):
            faces, metal = dented * dent.faces(r), inside(r, z)
            sheet = (z > base + faces[..., 1]) & (z < top + faces[..., 2])
            mu = np.where(metal, permeability, np.where(sheet, dent.permeabilities[1], 1.0))
            return mu, np.where(metal, conductivity, 0.0)

        return at

    def surfaces(r, z):
        faces = dent.faces(r)
        moved = np.minimum(np.abs(z - base - faces[..., 1]), np.abs(z - top - faces[..., 2]))
        return np.minimum(np.where(r < 9e-3, moved, 1.0), edges(r, z))

    def near(r, z):
        return (r < 9e-3) & (np.abs(z) < 7e-3)

    return loop_inductance(loops, materials(1.0), frequency, near, surfaces, 1.25e-4, materials(0.0))


def ball_over_sheets(loops, radius, centre, material, frequency, *, dent=None, plate=None):
    """What a ball over sheets of 6 and 2 mm, the upper one with µr = 2.6, does to loops in H, shape (loops,).

    The ball's centre is at a height `centre` in m. The sheets are flat, or those of a dent; below the loops there is a
    plate where the heights of its faces and its conductivity are given.
    """
    bottom, top, conductivity = plate or (0.0, 0.0, 0.0)

    def faces(r):
        moved = np.zeros((*np.shape(r), 3)) if dent is None else dent.faces(r)
        return 6e-3 + moved[..., 1], 8e-3 + moved[..., 2]

    def materials(with_ball):
        def at(r, z):
            low, high = faces(r)
            inside = np.hypot(r, z - centre) < radius
            around = np.where((z > low) & (z < high) & ~inside, 2.6, 1.0)
            metal = np.where((z > bottom) & (z < top), conductivity, 0.0)
            ball = inside & with_ball
            return np.where(ball, material.relative_permeability, around), np.where(ball, material.conductivity, metal)

        return at

    def surfaces(r, z):
        of_ball = np.abs(np.hypot(r, z - centre) - radius)
        if dent is None:
            return of_ball
        dented = np.minimum(*(np.abs(z - face) for face in faces(r)))
        return np.minimum(of_ball, np.where(r < 8e-3, dented, 1.0))

    def near(r, z):
        return (np.hypot(r, z - centre) < 1.5 * radius) | (z > bottom) & (z < top) & (r < 20e-3)

    return loop_inductance(loops, materials(True), frequency, near, surfaces, 1e-4, materials(False))


def pit(base=4e-3, mu=3.0):
    """Sheets of a base and 2 mm of a permeability, pressed in by 1.5 mm at the top, for `dent_over_metal`."""
    r = np.linspace(0, 20e-3, 201)
    shape = -1.5e-3 * np.exp(-((r / 3e-3) ** 2))
    return Dent((base, 2e-3), (1.0, mu), r, np.column_stack((0 * r, 0.8 * shape, shape)))


def dented_loops(loops, thickness, mu, top, zone=6e-3, step=0.125e-3):
    """ΔL in H, shape (loops, loops), of loops (radius, height) in m by a dent in one sheet on z = 0, against flat.

    `top(r)` is how far its upper face moves up. The vector potential, on one mesh whose nodes are moved or not: lines
    at every `step` in r to 10 mm, and in z at 0.1 mm from −0.4 mm up to the face, where loops must lie on them.
    """
    outwards = np.geomspace(step, FAR / 4, 24)
    r = np.concatenate((np.arange(0, 10e-3 + step / 2, step), 10e-3 + np.cumsum(outwards)))
    inner = np.arange(-4, round(thickness * 1e4) + 1) * 1e-4
    z = np.concatenate(
        (
            -0.4e-3 - np.cumsum(outwards)[::-1],
            inner,
            thickness + np.linspace(0, zone, 25)[1:],
            thickness + zone + outwards,
        )
    )
    flat = MeshQuad.init_tensor(r, z)
    height = flat.p[1]
    share = np.interp(height, [0, thickness, thickness + zone], [0.0, 1.0, 0.0])
    inside = (flat.p[1][flat.t].mean(axis=0) > 0) & (flat.p[1][flat.t].mean(axis=0) < thickness)
    found = []
    for moved in (top(flat.p[0]) * share, 0 * height):
        basis = Basis(MeshQuad(np.array([flat.p[0], height + moved]), flat.t), ElementQuad2(), intorder=5)
        matrix = energy.assemble(basis, reluctivity=np.where(inside, 1 / mu, 1.0)[:, None] * np.ones(basis.dx.shape))
        sources = np.zeros((basis.N, len(loops)))
        for number, loop in enumerate(loops):
            distance = np.hypot(*(basis.doflocs.T - loop).T)
            assert distance.min() < 1e-9
            sources[np.argmin(distance), number] = loop[0]
        free = np.setdiff1d(np.arange(basis.N), basis.get_dofs().flatten())
        found.append(sources[free].T @ symmetric(matrix[free][:, free].tocsc()).solve(sources[free]))
    return 2 * np.pi * MU_0 * (found[0] - found[1])
