"""Finite elements for circular loops about the axis of any materials: what these do to inductance and loss."""

import numpy as np
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, ElementQuad2, ElementTriP2, MeshQuad, MeshTri

from coilarray.constants import MU_0

FAR = 0.16  # m, where the potential is held at zero


def loop_inductance(loops, materials, frequency, near, edges, finest):
    """ΔL − jΔR/ω in H, shape (loops,), of loops (radius, height) in m by materials, against vacuum on the same mesh.

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

    @BilinearForm
    def energy(u, v, w):
        r = w.x[0]
        return w.reluctivity * (u.grad[1] * v.grad[1] * r + (u.grad[0] * r + u) * (v.grad[0] * r + v) / r)

    @BilinearForm
    def loss(u, v, w):
        return w.conductivity * u * v * w.x[0]

    r, z = np.asarray(basis.global_coordinates())
    mu, sigma = materials(r, z)
    free = np.setdiff1d(np.arange(basis.N), basis.get_dofs().flatten())
    sources = np.zeros((basis.N, len(loops)))
    for number, (radius, height) in enumerate(loops):
        probe = basis.probes(np.array([[radius], [height]]))
        sources[:, number] = radius * probe.toarray().ravel()
    vacuum = energy.assemble(basis, reluctivity=np.ones_like(r))
    filled = energy.assemble(basis, reluctivity=1 / mu)
    if frequency:
        filled = filled + 2j * np.pi * frequency * MU_0 * loss.assemble(basis, conductivity=sigma)
    fields = [splu(m[free][:, free].tocsc()).solve(sources[free].astype(m.dtype)) for m in (vacuum, filled)]
    return 2 * np.pi * MU_0 * (sources[free] * (fields[1] - fields[0])).sum(axis=0)


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

        @BilinearForm
        def energy(u, v, w):
            r = w.x[0]
            return w.reluctivity * (u.grad[1] * v.grad[1] * r + (u.grad[0] * r + u) * (v.grad[0] * r + v) / r)

        matrix = energy.assemble(basis, reluctivity=np.where(inside, 1 / mu, 1.0)[:, None] * np.ones(basis.dx.shape))
        sources = np.zeros((basis.N, len(loops)))
        for number, loop in enumerate(loops):
            distance = np.hypot(*(basis.doflocs.T - loop).T)
            assert distance.min() < 1e-9
            sources[np.argmin(distance), number] = loop[0]
        free = np.setdiff1d(np.arange(basis.N), basis.get_dofs().flatten())
        found.append(sources[free].T @ splu(matrix[free][:, free].tocsc()).solve(sources[free]))
    return 2 * np.pi * MU_0 * (found[0] - found[1])
