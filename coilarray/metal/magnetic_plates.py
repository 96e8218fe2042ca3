"""Finite magnetic plates with a small skin depth.

The condition H_n = −∇·(ℓ H_t), the equation (Λ + ℓ S) φ = ℓ t − b/µ0 and the edges are in
docs/theory/metal.md, "Magnetic plates with an outline". In Costabel's symmetric coupling

    Λ = W + (½ − K)ᵀ V⁻¹ (½ − K),

with V and K the single layer and the double layer of 1/4πr, and W = M/µ0 the energy of the currents
∇v × n (`coilarray.metal.half_body`). In the metal's place H_c = −∇u, with S u = −t, and by
reciprocity

    ΔL_ij − jΔR_ij/ω = −µ0 (c_iᵀ (Λ + ℓ S)⁻¹ c_j − u_iᵀ b_j/µ0 + ℓ u_iᵀ t_j),   c = ℓ t − b/µ0.

Between sheets and infinite plates, G = 1/4πr also has the images of
`coilarray.metal.coupled_plates`: shares of charges and double layers, of the other sign in mirror
images. H_c is then the coils' field between the layers. Holes would need cuts.

With the same H along an edge on both faces the strip of `coilarray.metal.half_body` has, for t ≫ δ,
F = (1 − 8/πkt)/k: at each of its two edges the surface is short of 8/(2√2 π) = 0.9 skin depths,
about a half on either side. H_t is about constant up to the distance |ℓ| from the edge. Farther
away it falls as along a perfect conductor, with the third root of the distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import scipy.sparse as sp
import shapely
from scipy.linalg import block_diag, lu_factor, lu_solve
from scipy.sparse.linalg import splu

from coilarray.compute.arrays import ComplexArray, FloatArray, IntArray, NumberArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import ranges, run_blocks
from coilarray.constants import MU_0
from coilarray.electromagnetics.kernels.triangles import double_layers
from coilarray.errors import MetalError
from coilarray.geometry import Conductor
from coilarray.geometry.bodies import FinitePlate
from coilarray.metal.coupled_plates import ITSELF, ONE_IMAGE, Image, PlatesInAir, PosedPlate, distinct_sums, loads_of
from coilarray.metal.half_body import MIRROR, ROWS, EddyBody, inductance, pair_integrals

_DEPTHS = 3.0  # least thickness in skin depths
_AT_EDGE = 0.5  # skin depths on either side of an edge


def require_skin(plate: FinitePlate, frequencies: FloatArray, others: Sequence[FinitePlate]) -> None:
    """Raise MetalError for a magnetic plate that is not computed."""
    depth = max(plate.material.skin_depth(f) for f in frequencies.tolist())
    if plate.thickness < _DEPTHS * depth:
        raise MetalError(
            f"a magnetic plate with an outline must be at least {_DEPTHS:g} skin depths thick; {plate.name!r} is "
            f"{plate.thickness * 1e3:.4g} mm thick and has a skin depth of {depth * 1e3:.3g} mm at "
            f'{float(frequencies.min()):.4g} Hz: make it thicker, or infinite with shape = "plate".'
        )
    if plate.outline.holes:
        raise MetalError(f"a magnetic plate with an outline must not have holes; {plate.name!r} has: leave them out.")
    if others:
        names = ", ".join(other.name for other in others)
        raise MetalError(
            f"a magnetic plate with an outline must be the only one with an outline; beside {plate.name!r} "
            f'there are {names}: leave one of them out, or make it infinite with shape = "plate".'
        )


def magnetic_changes(around: PlatesInAir, plate: PosedPlate) -> tuple[ComplexArray, FloatArray]:
    """ΔZ/jω (places, f, paths, paths) in H by a magnetic plate, and edge errors."""
    lengths, paths = _lengths(plate.plate, around.air.frequencies).tolist(), len(around.paths)
    edges = np.zeros((len(plate.where), len(lengths), paths))
    change = np.zeros((*edges.shape, paths), dtype=np.complex128)
    for group in around.groups(plate.where):
        problems = _problems(around, replace(plate, where=plate.where[group]))
        for k, (of, length) in enumerate(zip(problems, lengths, strict=True)):
            depth = plate.plate.material.skin_depth(float(around.air.frequencies[k]))
            near = stiffness(plate.body, _beside_edges(plate.body, _AT_EDGE * depth, abs(length)))
            for one in of:
                outside = one.answer(length)
                change[group, k] += one.change(length, outside)
                edges[group, k] += one.energy(near, outside) * abs(length)
    return change, edges


def magnetic_currents(around: PlatesInAir, plate: PosedPlate, *, alone: bool = False) -> list[ComplexArray]:
    """Compute n × H in A/m for 1 A in each path, by frequency.

    The arrays (paths, 2k, 3) are along the board's axes, on the triangles of the upper half and of
    its mirror image. With `alone` they produce the plate's field without magnetic charges.
    """
    lengths = _lengths(plate.plate, around.air.frequencies).tolist()
    currents, n = _currents(plate), len(plate.body.mesh.nodes)
    found = []
    for of, length in zip(_problems(around, plate), lengths, strict=True):
        total = np.zeros((2 * n, len(around.paths)), dtype=np.complex128)
        for one in of:
            outside = one.answer(length)[:, 0]
            total += np.asarray(one.basis @ (one.double_layer(outside) if alone else one.u[:, 0] + outside))
        found.append(np.stack([np.asarray(K @ total).T for K in currents], axis=-1))
    return found


def _lengths(plate: FinitePlate, frequencies: FloatArray) -> ComplexArray:
    """Length ℓ in m at frequencies in Hz."""
    depths = np.array([plate.material.skin_depth(f) for f in frequencies.tolist()])
    return np.asarray(plate.material.relative_permeability * depths * (1 - 1j) / 2)


class Potentials:
    """Operators and loads for potentials on a body.

    Λ and S are in m, and b/µ0, t and u (unknowns, places, paths), where b and t are given in Wb and
    T·m. `basis` maps the unknowns to the nodes of the upper half, then the lower. `means` integrate
    the functions over the triangles and `rest` is ½ − K, both in m². `known` leaves an unknown out
    if a constant is free.
    """

    def __init__(
        self,
        basis: sp.csr_array,
        means: sp.csr_array,
        rest: NumberArray,
        outer: NumberArray,
        S: sp.csr_array,
        b: NumberArray,
        t: NumberArray,
        known: slice,
    ) -> None:
        self.basis, self.means, self.rest, self.outer, self.known = basis, means, rest, outer, known
        self.S, self.b, self.t, self.u = S.toarray(), b / MU_0, t / MU_0, np.zeros_like(t)
        loads = self.t[known].reshape(-1, t[0].size)
        self.u[known] = -splu(S[known, known].tocsc().astype(t.dtype)).solve(loads).reshape(t[known].shape)

    def answer(self, length: complex) -> ComplexArray:
        """Return φ in A for ℓ in m."""
        c = length * self.t - self.b
        x = lu_solve(lu_factor(self.outer + length * self.S), c.reshape(len(c), -1))
        return np.asarray(x.reshape(c.shape))

    def double_layer(self, outside: ComplexArray) -> ComplexArray:
        """Density ν in A of a double layer with the outer potential φ.

        (½ + K) ν = φ for potentials (unknowns, paths), tested by the linear functions' means.
        """
        known, weighed = self.known, self.means.T @ sp.diags_array(1 / np.asarray(self.means.sum(axis=1)))
        matrix = np.asarray(weighed @ np.asarray(self.means - self.rest))[known, known]
        found = np.zeros_like(outside)
        found[known] = lu_solve(lu_factor(matrix), np.asarray(weighed @ (self.means @ outside))[known])
        return found

    def energy(self, stiff: sp.csr_array, outside: ComplexArray) -> FloatArray:
        """µ0 ∫ |H_t|² (places, paths) in H/m on a part of given `stiffness`, for φ in A."""
        total, n = self.u + outside, stiff.shape[0]
        on_nodes = np.asarray(self.basis @ total.reshape(len(total), -1))
        halves = (on_nodes[:n], on_nodes[n:])
        found = sum((half.conj() * (stiff @ half)).real.sum(axis=0) for half in halves) / 2
        return np.asarray(MU_0 * found).reshape(total.shape[1:])

    def change(self, length: complex, outside: ComplexArray) -> ComplexArray:
        """ΔZ/jω (places, paths, paths) in H for given ℓ in m and φ in A."""
        inside = np.einsum("npi,npj->pij", self.u, self.b, optimize=True)
        along = np.einsum("npi,npj->pij", self.u, self.t, optimize=True)
        both = np.einsum("npi,npj->pij", length * self.t - self.b, outside, optimize=True)
        found = -MU_0 * (both - inside + length * along)
        return np.asarray((found + found.swapaxes(1, 2)) / 2)


def of_parity(body: EddyBody, sign: int, b: FloatArray, t: FloatArray) -> Potentials:
    """Even (sign 1) or odd potentials in air, for loads of `EddyBody.linked_to`."""
    used, basis = _bases(body)[0 if sign > 0 else 1]
    V, rest, W = exterior(body, sign)
    S = stiffness(body)[used][:, used]
    means, rest = _means(body)[:, used], rest[:, used]
    outer = _outer(V, rest, W[np.ix_(used, used)])
    return Potentials(basis, means, rest, outer, S, b[used], t[used], slice(1 if sign > 0 else 0, None))


def _beside_edges(body: EddyBody, depth: float, length: float) -> FloatArray:
    """Shares of each triangle's ∫ H² (k,) near an edge, for |ℓ|."""
    nodes, edge = body.mesh.nodes, shapely.LinearRing(body.mesh.nodes[body.mesh.ring, :2])

    def grown(away: FloatArray | float) -> FloatArray:
        """∫ H² from an edge to a distance in m."""
        return np.minimum(away, length) + 3 * length * (np.cbrt(np.maximum(np.asarray(away) / length, 1.0)) - 1)

    away = shapely.distance(edge, shapely.points(nodes[:, :2])) + nodes[:, 2].max() - nodes[:, 2]
    corners = grown(away)[body.mesh.triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    reached, span = grown(depth) - low, high - low
    # a triangle with three corners at the same distance from the edge, as in a corner of the
    # outline, is inside or outside
    return np.asarray(np.clip(np.divide(reached, span, out=np.sign(reached), where=span > 0), 0.0, 1.0))


def stiffness(body: EddyBody, shares: FloatArray | float = 1.0) -> sp.csr_array:
    """∫ ∇v·∇v' over shares of triangles, equal on both halves, (n, n)."""
    areas = sp.diags_array(2 * body.areas * shares)
    return sp.csr_array(sum(G.T @ areas @ G for G in body.gradients))


def exterior(body: EddyBody, sign: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Exterior operators V in m³, ½ − K in m² and W in m of a parity.

    Shapes (k, k), (k, n) and (n, n), by the triangles and the nodes of the upper half.
    """
    (own, image), (M, M_image), mesh = body.integrals, body.inductances, body.mesh
    corners, n = mesh.corners, len(mesh.nodes)
    mirrored = np.ascontiguousarray((corners * MIRROR)[:, ::-1])  # the normals point outwards too
    K = _double_layers(corners, corners, mesh.triangles, n)
    K += sign * _double_layers(corners, mirrored, mesh.triangles[:, ::-1], n)
    rest = _means(body).toarray() / 2 - 2 * K
    return (own + sign * image) / (2 * np.pi), rest, 2 * (M - sign * M_image) / MU_0


def _means(body: EddyBody) -> sp.csr_array:
    """Integrals (k, n) in m² of linear functions over triangles of both halves."""
    return body.by_corner(np.repeat(2 * body.areas / 3, 3))


def _problems(around: PlatesInAir, plate: PosedPlate) -> list[list[Potentials]]:
    """Potentials by frequency, even and odd if layers allow."""
    body, count = plate.body, len(around.air.frequencies)
    if not around.air.layers:
        loads = _loads(around.paths, plate, [ITSELF], ONE_IMAGE)
        return [[of_parity(body, sign, b[0], t[0]) for sign, (b, t) in zip((1, -1), loads, strict=True)]] * count
    images = around.images_of_coils(plate)
    if not images:  # behind a plate that no wave passes
        return [[]] * count
    weights, number = distinct_sums(images)
    bases = _bases(body)
    by_parity = list(zip(_loads(around.paths, plate, images, weights), bases, strict=True))
    stiff, whole = stiffness(body), _means(body)
    S = sp.block_diag([stiff[used][:, used] for used, _ in bases], format="csr")
    means = sp.block_diag([whole[:, used] for used, _ in bases], format="csr")
    basis = sp.hstack([onto for _, onto in bases], format="csr")
    found = []
    for k, (rest, outer) in enumerate(_between_layers(around, plate)):
        real, imaginary = number[k], number[count + k]
        b, t = (
            np.concatenate([load[part][real, used] + 1j * load[part][imaginary, used] for load, (used, _) in by_parity])
            for part in (0, 1)
        )
        found.append([Potentials(basis, means, rest, outer, S, b, t, slice(1, None))])
    return found


def _bases(body: EddyBody) -> list[tuple[IntArray, sp.csr_array]]:
    """Upper half's free nodes (odd: without rim), and their map, of both parities."""
    nodes, found = np.arange(len(body.mesh.nodes)), []
    for sign, used in ((1, nodes), (-1, np.setdiff1d(nodes, body.mesh.ring))):
        upper = sp.eye_array(len(nodes), format="csr")[:, used]
        found.append((used, sp.vstack((upper, sign * upper), format="csr")))
    return found


def _currents(plate: PosedPlate) -> list[sp.csr_array]:
    """∇v × n along the board's axes on both halves, each (2k, 2n) in 1/m."""
    halves = [
        sp.block_diag((K, -mirror * K), format="csr")
        for K, mirror in zip(plate.body.currents, MIRROR.tolist(), strict=True)
    ]
    return [sum(plate.plate.axes[own, axis] * halves[own] for own in range(3)) for axis in range(3)]


def _between_layers(around: PlatesInAir, plate: PosedPlate) -> list[tuple[NumberArray, NumberArray]]:
    """Operators ½ − K (2k, u) in m² and Λ (u, u) in m with reflections, by frequency."""
    body, images = plate.body, around.images_of(plate, plate)
    k, n = len(body.mesh.triangles), len(body.mesh.nodes)
    shares = np.array([image.shares for image in images]).T.reshape(len(around.air.frequencies), -1)
    distinct, number = np.unique(shares, axis=0, return_inverse=True)
    size = 16.0 if shares.imag.any() else 8.0
    require_memory(size * len(distinct) * 9 * k * k, f"the potentials on {k} triangles", "use a coarser mesh")
    parts = [exterior(body, sign) for sign in (1, -1)]
    used, maps = zip(*_bases(body), strict=True)
    vacuum = (
        block_diag(*(V for V, _, _ in parts)),
        block_diag(*(rest[:, nodes] for (_, rest, _), nodes in zip(parts, used, strict=True))),
        block_diag(*(W[np.ix_(nodes, nodes)] for (_, _, W), nodes in zip(parts, used, strict=True))),
    )
    basis = sp.hstack(maps, format="csr")
    currents = [K @ basis for K in _currents(plate)]
    corners = plate.corners.copy()
    corners[k:] = corners[k:, ::-1]  # so that all normals point outwards
    nodes = np.concatenate((body.mesh.triangles, body.mesh.triangles[:, ::-1] + n))
    every: list[list[NumberArray]] = [
        [part.astype(np.complex128) if size > 8 else part.copy() for part in vacuum] for _ in distinct
    ]
    for image, of_image in zip(images, distinct.T, strict=True):
        seen = np.ascontiguousarray(image.of(corners))
        integrals = pair_integrals(corners, seen, mirrored=image.sign < 0)
        turned = seen[:, ::-1] if image.sign < 0 else seen
        K = _double_layers(corners, turned, nodes[:, ::-1] if image.sign < 0 else nodes, 2 * n) @ basis
        W = inductance(currents, integrals, np.array([1.0, 1.0, image.sign])) / MU_0
        V, K = _parities(_parities(integrals / (4 * np.pi)).T).T, _parities(K)
        for total, share in zip(every, of_image.tolist(), strict=True):
            weight = share if size > 8 else share.real
            total[0] += image.sign * weight * (V + V.T) / 2
            total[1] -= image.sign * weight * K
            total[2] += weight * (W + W.T) / 2
    made = [(total[1], _outer(*total)) for total in every]
    return [made[k] for k in number.ravel()]


def _parities(values: FloatArray) -> FloatArray:
    """Sum and difference of the values on both halves, (2k, n)."""
    upper, lower = np.split(values, 2)
    return np.concatenate((upper + lower, upper - lower))


def _outer(V: NumberArray, rest: NumberArray, W: NumberArray) -> NumberArray:
    """Outer operator Λ = W + (½ − K)ᵀ V⁻¹ (½ − K), made symmetric."""
    made = W + rest.T @ lu_solve(lu_factor(V, check_finite=False), rest, check_finite=False)
    return np.asarray((made + made.T) / 2)


def _double_layers(corners: FloatArray, other: FloatArray, nodes: IntArray, count: int) -> FloatArray:
    """K (triangles, count) in m² of layers on triangles with corners `nodes`."""
    K = np.zeros((len(corners), count))
    others, numbers = np.ascontiguousarray(other), np.ascontiguousarray(nodes)

    def work(rows: tuple[int, int]) -> None:
        start, stop = rows
        double_layers(corners[start:stop], others, numbers, 1 / (4 * np.pi), K[start:stop])

    run_blocks(work, ranges(len(corners), ROWS))
    return K


def _loads(
    paths: Sequence[Conductor], plate: PosedPlate, images: Sequence[Image], weights: FloatArray
) -> list[tuple[FloatArray, FloatArray]]:
    """`EddyBody.linked_to` (sums, nodes, places, paths) of images' sums, by parity."""
    body, n = plate.body, len(plate.body.mesh.nodes)
    count = len(weights) * len(plate.where) * len(paths)
    require_memory(8.0 * 8 * n * count, f"a plate at {len(plate.where)} places", "compute fewer")
    return loads_of([partial(body.linked_to, sign=sign) for sign in (1, -1)], plate, paths, images, weights)
