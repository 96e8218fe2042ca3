"""Change of a field's energy by a dent in sheets.

The equations of the dent's potential ψ, with the energies a_f and a_d of the flat and of the dented
sheets and Δa = a_d − a_f, are in docs/theory/elastomer.md, "Dented magnetic sheet". The dented
space is mapped to the flat space by moving heights only, z = Z + w(r, Z). There Δa is an integral
of known coefficients that vanish where nothing moves, and the total potential U_f with flat sheets
is known in closed form.

Only the faces that move may contribute, otherwise the error of the elements is as large for sheets
that hardly differ from air. So let U be the field in an infinite medium of the lowest sheet, a_0
its energy and c = a − a_0. It satisfies Laplace's equation wherever something moves, so that U at
the moved places, Ũ = U(r, z), has a_0,d(Ũ, V) = a_0,f(U, V). With the flat faces' own part χ = U_f
− U the dented potential is U_d = U_f + ψ = Ũ + χ + η, where

    a_d(η, V) = −F(V),   F(V) = Δa(χ, V) + h(V),
    h(V) = c_d(Ũ, V) − c_f(U, V) = Σ (μ_b − μ_a) ∫ V (∂_n Ũ − ∂_n U) dS

is a sum over the faces with μ_b below and μ_a above, where V is the same on the dented and on the
flat face, and

    Δa(U_f,i, U_d,j) = h_i(Ũ_j) + Σ (μ_b − μ_a) ∫ (Ũ_j − U_j) ∂_n U_i dS
                     + h_i(χ_j) + h_j(χ_i) + Δa(χ_i, χ_j) + F_j(η_i).

Every term is proportional to the contrast of the moved faces. The elements use U only on these
faces, so neither its strength near the coils nor the air far away matters to them.

Layers below the coils send the field of coils and dent back up. With the energies Γ of the dent
over air, amplitudes a of the potential make the wave D(k) = −½ Γ a below the sheets (by reciprocity
with a coil there). The layers return −w D for it, and with the amplitudes a_f of the coils between
these layers and the flat sheets

    a = a_f − w D = (1 − ½ w Γ)⁻¹ a_f:  the change follows from Γ (1 − ½ w Γ)⁻¹ and a_f.

The dent is symmetric about its axis, so each harmonic e^{imθ} of the field is a separate problem in
(r, Z). In plane strain the even and the odd part in x take the place of the harmonics.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from scipy.linalg.blas import dtrsm
from scipy.linalg.lapack import dpotrf
from scipy.sparse import csr_matrix, vstack
from scipy.special import j0, j1, jv
from skfem import Basis, BilinearForm, ElementQuad2, MeshQuad

from coilarray.compute.arrays import ComplexArray, FloatArray, IntArray, NumberArray
from coilarray.compute.threads import run_blocks
from coilarray.elastomer.dent import Dent
from coilarray.electromagnetics.flat_stack import Backing, flat_profile, wave_count, wave_rule
from coilarray.errors import ElastomerError

_REACH = 2  # columns that couple: the nodes of a quadratic element
_MOST_WAVENUMBERS = 2000
_FACE_NODES = 2  # of a Gauss–Legendre rule between the knots of a dented face
_SAME = 1e-12  # m, below which two places are the same
_ROUNDING = 1e-6  # of an element, within which a number of elements counts as whole
# energies of all harmonics as a `TensorGrid` splits them: without and with m²
Blocks: TypeAlias = tuple[FloatArray, FloatArray | None]


class TensorGrid:
    """Grid nodes that couple only over the next two columns.

    The columns are eliminated from the outermost to the middle, all rows at once: a block Cholesky
    decomposition A = L Lᵀ. For a force f only the half L⁻¹f is needed, as fᵀA⁻¹f = |L⁻¹f|². The
    points (2, nodes) are without the first and the last row and the outermost column.
    """

    def __init__(self, nodes: FloatArray) -> None:
        (radii, self._column), (heights, self._row) = (np.unique(x.round(12), return_inverse=True) for x in nodes)
        self._column = len(radii) - 1 - self._column
        self.columns, self.rows = len(radii), len(heights)

    def blocks(self, matrix: csr_matrix) -> FloatArray:
        """Parts of a symmetric matrix by column, distance and rows."""
        entries = matrix.tocoo()
        distance = self._column[entries.row] - self._column[entries.col]
        at = distance >= 0
        blocks = np.zeros((self.columns, _REACH + 1, self.rows, self.rows))
        first, second = entries.row[at], entries.col[at]
        blocks[self._column[second], distance[at], self._row[first], self._row[second]] = entries.data[at]
        return blocks[1:, :, 1:-1, 1:-1]

    def forces(self, forces: FloatArray) -> FloatArray:
        """Parts of forces (nodes, n) by column, force and row."""
        parts = np.zeros((self.columns, forces.shape[1], self.rows))
        parts[self._column, :, self._row] = forces
        return parts[1:, :, 1:-1]


def energies(blocks: FloatArray, forces: FloatArray) -> FloatArray:
    """Return fᵀA⁻¹f (forces, forces) of a positive definite matrix A.

    Matrix and forces are in the parts of a `TensorGrid`, columns left out at the end held.
    """
    columns, count, rows = forces.shape
    near, far = rows + rows, rows + rows + count
    # for every column: itself, its coupling to the next column, the forces, and its coupling to the
    # column after that
    parts = np.concatenate((blocks[:columns, 0], blocks[:columns, 1], forces, blocks[:columns, 2]), axis=1)
    total = np.zeros((count, count))
    for k, part in enumerate(parts):
        half, bad = dpotrf(part[:rows].T, lower=True, overwrite_a=True)
        if bad:
            raise ElastomerError("a dent folds the sheets: it must be less deep.")
        end = len(part) if part[far:].any() else far
        solved = dtrsm(1.0, half, part[rows:end].T, lower=True, overwrite_b=True)
        met = solved.T @ solved
        total += met[rows:-rows, rows:-rows] if end > far else met[rows:, rows:]
        if k + 1 < columns:
            parts[k + 1, :rows] -= met[:rows, :rows]
            parts[k + 1, near:far] -= met[rows : rows + count, :rows]
        if k + 2 < columns and end > far:
            parts[k + 1, rows:near] -= met[-rows:, :rows]
            parts[k + 2, :rows] -= met[-rows:, -rows:]
            parts[k + 2, near:far] -= met[rows : rows + count, -rows:]
    return total


@dataclass(frozen=True)
class LayerMesh:
    """Accuracy of the magnetic problem.

    `harmonics` is the highest harmonic about the indenter. Wavenumbers up to `decays` over the
    clearance are used, the rest is below e^(−2·decays) of the incident energy. `width` is that of
    the elements in the middle, relative to the radius of the dent's half depth or the clearance,
    whichever is smaller, and `growth` the ratio of neighbours outside. There are `rows` of elements
    over the height of each sheet and of the moved air. Incident patterns below the part `rank` of
    the strongest are left out. The defaults err by up to 1e-3 of the largest entry, and by up to
    1e-2 for the dent of a small ball in a sheet that lies on the board, under few turns.
    """

    harmonics: int = 10
    decays: float = 8.0
    width: float = 0.2
    rows: int = 6
    growth: float = 1.2
    rank: float = 1e-7

    def coarser(self) -> LayerMesh:
        """Return a mesh for small corrections, four times cheaper, to some 0.3 %."""
        harmonics, rows = max(5, self.harmonics // 2), max(2, self.rows // 3)
        return LayerMesh(harmonics, 0.55 * self.decays, max(0.5, self.width), rows, self.growth**2, 100 * self.rank)


@dataclass(frozen=True, eq=False)
class Scattering:
    """Change of energy by a dent, harmonic by harmonic.

    `wavenumbers` and `weights` (k,) in 1/m are of the integral. Each of the `patterns` (rank, k) is
    a share of each wavenumber's incident field. Each of the `energies` (rank, rank) in m is Δa(U_f,
    U_d) between the patterns, without μ0 and the integral over the angle.
    """

    wavenumbers: FloatArray
    weights: FloatArray
    patterns: tuple[NumberArray, ...]
    energies: tuple[NumberArray, ...]

    def over(self, backing: Backing, dent: Dent) -> Scattering:
        """Add layers below the coils, which make the patterns complex.

        The patterns are for the waves of each of `Backing.seen`.
        """
        if not backing.layers:
            return self
        around = self.wavenumbers, dent.thicknesses, dent.permeabilities, dent.motion.lift
        to_and_fro = self.weights * backing.between(*around)[1] / 2
        ways = backing.arriving(*around)
        arriving: ComplexArray = np.concatenate(ways)

        def energies(patterns: NumberArray, own: NumberArray) -> ComplexArray:
            return np.asarray(np.linalg.solve(np.eye(len(own)) - own @ (patterns * to_and_fro) @ patterns.T, own + 0j))

        return Scattering(
            np.tile(self.wavenumbers, len(ways)),
            np.tile(self.weights, len(ways)),
            tuple(np.tile(patterns, len(ways)) * arriving for patterns in self.patterns),
            tuple(map(energies, self.patterns, self.energies)),
        )

    def amplitudes(self, waves: FloatArray) -> list[NumberArray]:
        """Amplitudes (parts, rank, n) of the patterns for the first harmonics.

        `waves` (harmonics, parts, k, n) are the amplitudes of potentials per wavenumber. Their
        parts are the real and imaginary parts or other parts that share no energy.
        """
        return [(patterns * self.weights) @ own for patterns, own in zip(self.patterns, waves, strict=False)]

    def energy(self, amplitudes: Sequence[NumberArray], of_coils: IntArray, factors: FloatArray) -> NumberArray:
        """Change of the energy between all coils, (positions, coils, coils).

        `of_coils` (positions, coils) gives the index of each coil's `amplitudes`. `factors`
        (harmonics,) is the integral over the angle, 2π and 4π, or the two halves in plane strain.
        """

        def of(m: int) -> NumberArray:
            b = amplitudes[m][..., of_coils].transpose(2, 3, 0, 1)
            one, two = (values.reshape(*b.shape[:2], -1) for values in (factors[m] * b, b @ self.energies[m]))
            return np.asarray(one @ two.transpose(0, 2, 1))

        total = np.sum(run_blocks(of, range(len(amplitudes))), axis=0)
        return np.asarray((total + total.transpose(0, 2, 1)) / 2)


def wavenumber_rule(clearance: float, extent: float, mesh: LayerMesh) -> tuple[FloatArray, FloatArray]:
    """Gauss–Legendre nodes and weights from 0 to decays/clearance, in 1/m.

    `clearance` is the least height in m above the coils of a moved face where the material changes,
    `extent` the largest distance in m between points of coil and dent.
    """
    highest = mesh.decays / clearance
    count = wave_count(highest, extent)
    if count > _MOST_WAVENUMBERS:
        raise ElastomerError(
            f"a dented face comes within {clearance * 1e3:.3g} mm of coils on {extent * 1e3:.3g} mm: too close for "
            f"this method, which would need {count} wavenumbers; {_MOST_WAVENUMBERS} are allowed."
        )
    return wave_rule(highest, count)


def scatter(
    dent: Dent, wavenumbers: FloatArray, weights: FloatArray, mesh: LayerMesh, deepest: float | None = None
) -> Scattering:
    """Solve the dented sheets for the incident fields of `wavenumber_rule`.

    `deepest` is the largest displacement in m of a series of dents that share one mesh.
    """
    space = DentedSpace(dent, mesh, deepest)
    scale = np.sqrt(wavenumbers * weights)
    kinds: Sequence[int] = range(mesh.harmonics + 1) if dent.symmetry == "axial" else (0, 1)

    def solve(m: int) -> tuple[FloatArray, FloatArray]:
        waves = space.waves(m, wavenumbers)
        incident = waves.dented * scale
        strengths, mixed = np.linalg.eigh(incident.T @ incident)  # squares of the singular values
        mixed = mixed[:, strengths > mesh.rank**2 * strengths[-1]]
        patterns = Waves(**{name: values @ (scale[:, None] * mixed) for name, values in vars(waves).items()})
        force = space.force(m, patterns)
        return mixed.T / scale, space.unanswered(m, patterns) - space.energies(m, force)

    solved = run_blocks(solve, kinds)
    return Scattering(wavenumbers, weights, tuple(p for p, _ in solved), tuple(e for _, e in solved))


@dataclass(frozen=True, eq=False)
class Waves:
    """Incident waves of one harmonic on a `DentedSpace`, (points, n).

    `reaction` is χ at the moved nodes. On the faces `reflected`, `flat` and `dented` are χ, U and
    Ũ, `normal` and `dented_normal` ∂_n U and ∂_n Ũ in 1/m, times the area over the flat area.
    """

    reaction: FloatArray
    reflected: FloatArray
    flat: FloatArray
    dented: FloatArray
    normal: FloatArray
    dented_normal: FloatArray


class DentedSpace:
    """Elements of sheets and air with a dent at nodes `moved`."""

    def __init__(self, dent: Dent, mesh: LayerMesh, deepest: float | None = None) -> None:
        self.dent = dent
        self.basis = Basis(_grid(dent, mesh, deepest), ElementQuad2(), intorder=6)
        r, z = np.asarray(self.basis.global_coordinates())
        mu = np.array([1.0, *dent.permeabilities, 1.0])[np.searchsorted(dent.heights, z)]
        # slopes ∂w/∂Z and ∂w/∂r of the map z = Z + w(r, Z), 0 beyond the anchors
        w, slope = dent.anchored(r), dent.anchored(r, 1)
        stretch, shear = np.zeros_like(r), np.zeros_like(r)
        for k, (lower, upper) in enumerate(pairwise(dent.anchors(deepest).tolist())):
            here = (z > lower) & (z < upper)
            share = (z[here] - lower) / (upper - lower)
            stretch[here] = (w[here, k + 1] - w[here, k]) / (upper - lower)
            shear[here] = (1 - share) * slope[here, k] + share * slope[here, k + 1]
        one, rise = np.ones_like(mu), (1 + shear**2) / (1 + stretch)
        flat = _Forms(self.basis, mu, one, np.zeros_like(mu), one, dent.symmetry)
        self._change = _Forms(self.basis, mu, stretch, -shear, rise - 1, dent.symmetry)
        self.moved = np.unique(self._change.gradient.nonzero()[0])
        self._parted = TensorGrid(self.basis.doflocs)
        both = None if flat.around is None or self._change.around is None else flat.around + self._change.around
        self._dented = self._blocks(flat.gradient + self._change.gradient, both)
        self._mapping = one, 1 + stretch, -shear, rise
        self._faces = _Faces(self.basis, dent)

    def _blocks(self, gradient: csr_matrix, around: csr_matrix | None) -> Blocks:
        """Parts of the energies without and with m²."""
        return self._parted.blocks(gradient), None if around is None else self._parted.blocks(around)

    def background(self, z: FloatArray, wavenumbers: FloatArray) -> FloatArray:
        """Profile of U over heights (n,) in m and wavenumbers (k,) in 1/m."""
        return np.asarray(2 / (1 + self.dent.permeabilities[0]) * np.exp(-np.outer(z, wavenumbers)))

    def reaction(self, z: FloatArray, wavenumbers: FloatArray) -> FloatArray:
        """Profile of χ, with the arguments of `background`."""
        dent = self.dent
        total = flat_profile(wavenumbers, z, dent.thicknesses, dent.permeabilities)
        return total - self.background(z, wavenumbers)

    def waves(self, m: int, wavenumbers: FloatArray) -> Waves:
        """Waves of one harmonic at all wavenumbers in 1/m."""
        faces, symmetry = self._faces, self.dent.symmetry
        nodes_r, nodes_z = self.basis.doflocs[:, self.moved]
        reaction = _by_distinct_value(nodes_z, lambda z: self.reaction(z, wavenumbers))
        reaction *= _by_distinct_value(nodes_r, lambda r: radial_pattern(symmetry, m, r, wavenumbers))
        pattern = radial_pattern(symmetry, m, faces.r, wavenumbers)
        if symmetry == "axial":
            next_one = radial_pattern(symmetry, m + 1, faces.r, wavenumbers)
            slope = m * pattern / faces.r[:, None] - wavenumbers * next_one
        else:
            slope = (2 * m - 1) * wavenumbers * radial_pattern(symmetry, 1 - m, faces.r, wavenumbers)
        lateral, slope = (np.tile(values, (len(faces.z) // len(faces.r), 1)) for values in (pattern, slope))
        flat, dented = (self.background(z, wavenumbers) for z in (faces.z, faces.z + faces.up))
        reflected = lateral * _by_distinct_value(faces.z, lambda z: self.reaction(z, wavenumbers))
        normal, dented_normal = (
            -wavenumbers * lateral * flat,
            -(wavenumbers * lateral + faces.slope[:, None] * slope) * dented,
        )
        return Waves(reaction, reflected, lateral * flat, lateral * dented, normal, dented_normal)

    def force(self, m: int, waves: Waves) -> FloatArray:
        """F(V) for all V, of n waves of one harmonic, (nodes, n)."""
        faces = self._faces
        of_faces = faces.trace.T @ (faces.weights[:, None] * (waves.dented_normal - waves.normal))
        return np.asarray(self._change.harmonic(m)[:, self.moved] @ waves.reaction + of_faces)

    def unanswered(self, m: int, waves: Waves) -> FloatArray:
        """Δa(U_f, U_d) − F(η) between n waves of one harmonic."""
        weights, gained = self._faces.weights[:, None], waves.dented_normal - waves.normal
        own = (waves.dented + 2 * waves.reflected).T @ (weights * gained)
        own += (waves.dented - waves.flat).T @ (weights * waves.normal)
        change = self._change.harmonic(m)[self.moved][:, self.moved]
        return np.asarray((own + own.T) / 2 + waves.reaction.T @ (change @ waves.reaction))

    def air(self) -> Blocks:
        """Energies of the same moved elements in air."""
        air = _Forms(self.basis, *self._mapping, self.dent.symmetry)
        return self._blocks(air.gradient, air.around)

    def energies(self, m: int, forces: FloatArray, blocks: Blocks | None = None) -> FloatArray:
        """fᵀ a⁻¹ f of forces (nodes, n) on a harmonic, a the dent's or given energies."""
        gradient, around = blocks or self._dented
        # on the axis the potential is zero, unless it is the same all round
        parts = self._parted.forces(forces)[: self._parted.columns - 1 - min(m, 1)]
        return energies(gradient if around is None else gradient + m**2 * around, parts)


class _Faces:
    """Gauss points on the faces that move, between edges and knots, at the same `r` on each.

    `z` is their height, `up` their displacement and `slope` its slope. `weights` are of an integral
    with the contrast. `trace` (points, nodes) gives the values of elements there. Between knots a
    dent is a cubic, which the elements' own points would not integrate.
    """

    def __init__(self, basis: Basis, dent: Dent) -> None:
        mu, heights = np.array([*dent.permeabilities, 1.0]), dent.heights
        edges = np.unique(basis.mesh.p[0])
        knots = np.unique(np.concatenate((edges, dent.radius)).round(12))
        knots = knots[knots <= dent.extent]
        nodes, rule = np.polynomial.legendre.leggauss(_FACE_NODES)
        half = np.diff(knots)[:, None] / 2
        r = (knots[:-1, None] + half * (1 + nodes)).ravel()
        area = (half * rule).ravel() * (r if dent.symmetry == "axial" else 1.0)
        up, slope = dent.faces(r), dent.faces(r, 1)
        element = np.searchsorted(edges, r) - 1
        t = (r - edges[element]) / np.diff(edges)[element]
        shapes = np.column_stack(((1 - t) * (1 - 2 * t), 4 * t * (1 - t), t * (2 * t - 1)))
        columns, rows = 2 * element[:, None] + np.arange(3), np.repeat(np.arange(len(r)), 3)
        moving = [face for face in dent.contrasts if dent.displacement[:, face].any()]
        traces = []
        for face in moving:
            along = np.flatnonzero(np.abs(basis.doflocs[1] - heights[face]) < _SAME)
            along = along[np.argsort(basis.doflocs[0, along])]  # corners and middles of the edges in turn
            traces.append(csr_matrix((shapes.ravel(), (rows, along[columns].ravel())), (len(r), basis.N)))
        self.r, self.z = r, np.repeat(heights[moving], len(r))
        self.up, self.slope = up[:, moving].T.ravel(), slope[:, moving].T.ravel()
        self.weights = np.concatenate([(mu[face - 1] - mu[face]) * area for face in moving])
        self.trace: csr_matrix = vstack(traces, format="csr")


class _Forms:
    """Energies ∫ μ (a ∂rU ∂rV + b (∂rU ∂zV + ∂zU ∂rV) + c ∂zU ∂zV + a m²/r² U V) r dr dz."""

    def __init__(
        self, basis: Basis, mu: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray, symmetry: str
    ) -> None:
        axial = symmetry == "axial"

        @BilinearForm
        def gradient(u, v, w):  # type: ignore[no-untyped-def]
            mixed = u.grad[0] * v.grad[1] + u.grad[1] * v.grad[0]
            energy = w.a * u.grad[0] * v.grad[0] + w.b * mixed + w.c * u.grad[1] * v.grad[1]
            return w.mu * energy * (w.x[0] if axial else 1.0)

        @BilinearForm
        def around(u, v, w):  # type: ignore[no-untyped-def]
            return w.mu * w.a * u * v / w.x[0]

        self.gradient: csr_matrix = gradient.assemble(basis, mu=mu, a=a, b=b, c=c)
        self.around: csr_matrix | None = around.assemble(basis, mu=mu, a=a) if axial else None

    def harmonic(self, m: int) -> csr_matrix:
        """Energy of one harmonic, in plane strain of either parity."""
        return self.gradient if self.around is None else self.gradient + m**2 * self.around


def radial_pattern(symmetry: str, m: int, r: FloatArray, wavenumbers: FloatArray) -> FloatArray:
    """Pattern (r, k): J_m(kr), or cos kx and sin kx in plane strain.

    scipy's J_m takes as long as twenty steps of the recurrence J_{n+1} = (2n/x) J_n − J_{n−1}, and
    more than its power series. The steps lose no digits for n ≤ x, the series for x ≤ 3m/4
    (Abramowitz and Stegun, 9.1.10, 9.1.27 and 9.12).
    """
    x = np.outer(r, wavenumbers)
    if symmetry != "axial":
        return np.cos(x) if m == 0 else np.sin(x)
    if m < 2:
        return np.asarray(j1(x) if m else j0(x))
    found, near, far = np.empty_like(x), x <= 0.75 * m, x >= m
    found[~near & ~far] = jv(m, x[~near & ~far])
    half = x[near] / 2
    series = np.ones_like(half)
    for k in range(m + 14, 0, -1):
        series = 1 - half**2 / (k * (k + m)) * series
    found[near] = half**m / math.factorial(m) * series
    x = x[far]
    before, last = j0(x), j1(x)
    for n in range(1, m):
        before, last = last, 2 * n / x * last - before
    found[far] = last
    return found


def _by_distinct_value(values: FloatArray, function: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Apply a function to distinct values only, which mesh lines share."""
    distinct, inverse = np.unique(np.round(values, 12), return_inverse=True)  # to a picometre
    return np.asarray(function(distinct)[inverse])


def _grid(dent: Dent, mesh: LayerMesh, deepest: float | None) -> MeshQuad:
    """Rectangles in (r, Z), even where heights move, growing outside."""
    heights = dent.anchors(deepest)
    moved = np.abs(dent.displacement).max(axis=1)
    around = np.flatnonzero(moved > moved.max() / 2)[-1] + np.arange(2)  # neighbours, for a smoothly changing mesh
    around = np.minimum(around, len(moved) - 1)
    half = float(np.interp(-moved.max() / 2, -moved[around], dent.radius[around]))
    fine = mesh.width * min(half, dent.clearance)
    far = 2 * float(heights[-1])
    core = fine * np.arange(np.ceil(min(3 * half, dent.extent) / fine - _ROUNDING))
    radii = np.concatenate((core, _growing(core[-1], dent.extent + far, fine, mesh.growth)[1:]))
    rows = np.unique(np.concatenate([np.linspace(*pair, mesh.rows + 1) for pair in pairwise(heights.tolist())]))
    first, last = (float(np.diff(rows)[k]) for k in (0, -1))
    below = rows[0] - _growing(0.0, far, first, 1.5)[1:][::-1]
    above = rows[-1] + _growing(0.0, far, last, 1.5)[1:]
    return MeshQuad.init_tensor(radii, np.concatenate((below, rows, above)))


def _growing(start: float, stop: float, first: float, ratio: float) -> FloatArray:
    """Points from start to stop with growing distances from `first` on."""
    count = max(1, int(np.ceil(np.log1p((stop - start) * (ratio - 1) / first) / np.log(ratio))))
    steps = ratio ** np.arange(count)
    return np.concatenate(([start], start + (stop - start) * np.cumsum(steps) / steps.sum()))
