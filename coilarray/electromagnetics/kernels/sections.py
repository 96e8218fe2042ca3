"""Cross-sections of parallel traces: mean logarithms, fields, eddy-current modes.

The mutual inductance per length of two infinitely long parallel bars is −µ0/2π times the mean of ln
r over both cross-sections. In closed form this is the fourth difference of a fourth antiderivative
of ln r (twice in x, twice in z; the two-dimensional limit of Hoer & Love, J. Res. NBS 69C, 127,
1965),

    F(x, z) = −[(x⁴ − 6x²z² + z⁴)/2 · ln(x² + z²) − 4x³z·atan(z/x) − 4xz³·atan(x/z)]/24,

with 25/12 to subtract. The differences cancel as (distance/size)⁴. Cells further apart than `NEAR`
sizes therefore take the expansion of Re ln ζ, ζ = x + iz, in the moments of the cells. The first
moment left out is the sixth.

Eddy currents flow in filaments in the cross-sections. With the filament currents I_k = y_k √a_k
(cell area a_k), Ohm's and Faraday's laws in every trace read

    y + jβ (M y + s) = U √a/ρ,   M_km = −√(a_k a_m) ⟨ln r⟩_km,   β = ωµ0 ℓ²/(2πρ)

in units of a length ℓ. Here s is the source of an incident field and ½ρΣ|y|² the loss per length. A
uniform current density is y ∝ √a. The rest, orthogonal to it in every trace, carries no net current
and needs no voltage U. With the eigenpairs (λ, v) of M on that space each mode responds as −jβ
(vᵀs)/(1 + jβλ), at every frequency from one decomposition.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from coilarray.compute.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from coilarray.electromagnetics.kernels import kernel
from coilarray.electromagnetics.kernels.segments import cross, dot, log_of_ratio, moved, norm

NEAR = 6.0  # sides of the larger cell up to which the closed form is used
Trace = tuple[float, float, float, float]  # centre x and z, width and thickness
Basis = tuple[FloatArray, FloatArray, FloatArray]  # cells, √area and currents of one trace (`response_basis`)


def lateral_axes(vertices: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Horizontal unit vectors u × z (n, 3), and a mask without vertical segments."""
    steps = np.diff(vertices, axis=0)
    across = np.hypot(steps[:, 0], steps[:, 1])
    flat = across > 1e-9 * np.linalg.norm(steps, axis=1)
    safe = np.where(flat, across, 1.0)
    return np.column_stack((steps[:, 1] / safe, -steps[:, 0] / safe, np.zeros(len(steps)))) * flat[:, None], flat


def gauss_points(
    vertices: FloatArray, widths: FloatArray, segments: IntArray, rules: Sequence[tuple[float, int]]
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Gauss points along segments: segment (n,), length in m (n,), point (n, 3).

    `rules` has (least length in widths, points), rising. The points keep half a width away from the
    corners, where the field of the next centre line has no bound.
    """
    steps = np.diff(vertices, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    slender = lengths / widths
    gauss = {count: np.polynomial.legendre.leggauss(count) for _, count in rules}
    counts = [max(count for least, count in rules if value >= least) for value in slender[segments]]
    of_point = np.repeat(segments, counts)
    weight = 0.5 * np.concatenate([gauss[count][1] for count in counts]) * lengths[of_point]
    node = np.concatenate([gauss[count][0] for count in counts]) * np.maximum(1.0 - 1.0 / slender[of_point], 0.0)
    return of_point, weight, vertices[of_point] + 0.5 * (1.0 + node)[:, None] * steps[of_point]


@kernel
def _antiderivative(x: float, z: float) -> float:
    """Return −24 F of the module's text, even in x and z."""
    x, z = abs(x), abs(z)
    x2, z2 = x * x, z * z
    r2 = x2 + z2
    if r2 == 0.0:
        return 0.0
    angle = math.atan2(z, x)
    quartic = 0.5 * (x2 * x2 - 6.0 * x2 * z2 + z2 * z2) * math.log(r2)
    return quartic - 4.0 * x * z * (x2 * angle + z2 * (0.5 * math.pi - angle))


@kernel
def _moments(w1: float, t1: float, w2: float, t2: float) -> tuple[float, float]:
    """Halved variance difference and quarter cumulants of two cells' offset."""
    a1, a2, b1, b2 = w1 * w1, w2 * w2, t1 * t1, t2 * t2
    sx, sz = (a1 + a2) / 12.0, (b1 + b2) / 12.0
    fourth = (a1 * a1 + a2 * a2 + b1 * b1 + b2 * b2) / 80.0 + (a1 * a2 + b1 * b2) / 24.0 - 6.0 * sx * sz
    return 0.5 * (sx - sz), 0.25 * fourth


@kernel
def _far_mean_log(x: float, z: float, spread: float, fourth: float) -> float:
    """Mean of ln r of cells (x, z) apart by `_moments`, without a branch."""
    r2 = x * x + z * z
    inverse = 1.0 / r2
    cosine, sine = (x * x - z * z) * inverse, 2.0 * x * z * inverse
    logarithm = log_of_ratio(r2, 1.0, (r2 - 1.0) / (r2 + 1.0))
    return 0.5 * logarithm - spread * cosine * inverse - fourth * (cosine * cosine - sine * sine) * (inverse * inverse)


@kernel
def _near_mean_log(x: float, z: float, w1: float, t1: float, w2: float, t2: float) -> float:
    """Mean of ln r between cells w1 × t1 and w2 × t2 in closed form."""
    total = 0.0
    for i in range(4):
        xi = x + (0.5 * w1 if i & 1 else -0.5 * w1) + (0.5 * w2 if i & 2 else -0.5 * w2)
        sign_x = 1.0 if (i & 1) == (i >> 1) else -1.0
        for k in range(4):
            zk = z + (0.5 * t1 if k & 1 else -0.5 * t1) + (0.5 * t2 if k & 2 else -0.5 * t2)
            sign_z = 1.0 if (k & 1) == (k >> 1) else -1.0
            total += sign_x * sign_z * _antiderivative(xi, zk)
    return -total / (24.0 * w1 * t1 * w2 * t2) - 25.0 / 12.0


@kernel
def pair_logs(first: FloatArray, second: FloatArray, x: float, z: float, out: FloatArray) -> None:
    """Mean of ln r between the cells of two traces (x, z) apart.

    Cells `first` (n, 4) hold x, z, width, thickness about the trace's centre, `second` (4, m) the
    same by row, so that the processor takes several at once.
    """
    xs, zs, ws, ts = second[0], second[1], second[2], second[3]
    for i in range(first.shape[0]):
        dx, dz, w, t = x - first[i, 0], z - first[i, 1], first[i, 2], first[i, 3]
        for k in range(xs.shape[0]):
            spread, fourth = _moments(w, t, ws[k], ts[k])
            out[i, k] = _far_mean_log(dx + xs[k], dz + zs[k], spread, fourth)
        for k in range(xs.shape[0]):
            near = NEAR * max(w, t, ws[k], ts[k])
            if (dx + xs[k]) ** 2 + (dz + zs[k]) ** 2 <= near * near:
                out[i, k] = _near_mean_log(dx + xs[k], dz + zs[k], w, t, ws[k], ts[k])


@kernel
def transverse_fields(
    points: FloatArray, own: IntArray, lateral: FloatArray, normal: FloatArray, vertices: FloatArray, out: FloatArray
) -> None:
    """Field H of unit current in a polyline, in 1/m.

    `own` (n,) is the row of `vertices` where each point's own segment begins, which adds nothing.
    `out` (n, 2) receives H·lateral and H·normal, by the formula of `kernels.segments`.
    """
    for i in range(points.shape[0]):
        at = points[i, 0], points[i, 1], points[i, 2]
        field = (0.0, 0.0, 0.0)
        v = moved(at, -1.0, (vertices[0, 0], vertices[0, 1], vertices[0, 2]))
        b = norm(v)
        for s in range(vertices.shape[0] - 1):
            u, a = v, b
            v = moved(at, -1.0, (vertices[s + 1, 0], vertices[s + 1, 1], vertices[s + 1, 2]))
            b = norm(v)
            if s == own[i]:
                continue
            along, normal_to = dot(u, v), cross(u, v)  # u × v = d × u
            if along < 0.0:
                c2 = dot(normal_to, normal_to)
                if c2 == 0.0:
                    continue
                factor = (a + b) * (a * b - along) / (a * b * c2)
            else:
                factor = (a + b) / (a * b * (a * b + along))
            field = moved(field, factor, normal_to)
        scale = 1.0 / (4.0 * math.pi)
        out[i, 0] = scale * dot(field, (lateral[i, 0], lateral[i, 1], lateral[i, 2]))
        out[i, 1] = scale * dot(field, (normal[i, 0], normal[i, 1], normal[i, 2]))


def cosine_edges(size: float, count: int) -> FloatArray:
    """Cell edges (count + 1,) from −size/2 to size/2, finest at both ends."""
    return -0.5 * size * np.cos(np.pi * np.arange(count + 1) / count)


def cell_counts(width: float, thickness: float, longer: int, shorter: int) -> tuple[int, int]:
    """Even numbers of cells per side, `longer` for squares, fewer across thin sides."""
    aspect = min(width, thickness) / max(width, thickness)
    few = 2 * round((shorter + (longer - shorter) * aspect) / 2)
    return (longer, few) if width >= thickness else (few, longer)


def mesh(x_edges: FloatArray, z_edges: FloatArray) -> FloatArray:
    """Cells of a grid, (cells, 4) with x, z, width, thickness."""
    x, z = 0.5 * (x_edges[1:] + x_edges[:-1]), 0.5 * (z_edges[1:] + z_edges[:-1])
    columns = np.meshgrid(x, z, indexing="ij") + np.meshgrid(np.diff(x_edges), np.diff(z_edges), indexing="ij")
    return np.ascontiguousarray(np.column_stack([column.ravel() for column in columns]))


def _without_net_current(M: FloatArray, uniform: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Eigenpairs of M orthogonal to `uniform`, and M `uniform` there."""
    coupling = M @ uniform
    coupling -= uniform * (uniform @ coupling)
    # P M P, P = 1 − u uᵀ, from P M u = coupling
    projected = (
        M
        - np.outer(uniform, coupling)
        - np.outer(coupling, uniform)
        - np.outer(uniform, uniform @ M @ uniform * uniform)
    )
    values, vectors = np.linalg.eigh(projected)
    null = int(np.argmax(np.abs(uniform @ vectors)))  # the eigenvector that is `uniform` itself
    return np.delete(values, null), np.delete(vectors, null, axis=1), coupling


def isolated_modes(
    width: float, thickness: float, longer: int, shorter: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Modes of an isolated trace that fields excite.

    They are excited by its own current, a field along its thickness, and a field along its width.
    Each result (2, modes) has rows of λ (ℓ²) and squared excitation (ℓ⁴): (vᵀMu)² of the unit
    uniform current u, (Σ v x√a)², (Σ v z√a)². By symmetry one quarter is meshed.
    """
    nx, nz = cell_counts(width, thickness, longer, shorter)
    cells = mesh(cosine_edges(width, nx)[nx // 2 :], cosine_edges(thickness, nz)[nz // 2 :])
    root = np.sqrt(cells[:, 2] * cells[:, 3])
    # with the cells themselves and with their images in x, in z and in both
    direct, in_x, in_z, in_both = (
        _logs(cells, cells * [x, z, 1.0, 1.0], 0.0, 0.0) for x, z in ((1, 1), (-1, 1), (1, -1), (-1, -1))
    )
    found = []
    for parity_x, parity_z in ((1.0, 1.0), (-1.0, 1.0), (1.0, -1.0)):
        logs = direct + parity_x * in_x + parity_z * in_z + parity_x * parity_z * in_both
        M = -root[:, None] * logs * root
        if parity_x == parity_z:
            values, vectors, source = _without_net_current(M, root / np.linalg.norm(root))
            strength = (source @ vectors) ** 2
        else:
            values, vectors = np.linalg.eigh(M)
            strength = 4.0 * ((root * cells[:, 0 if parity_x < 0 else 1]) @ vectors) ** 2  # four quarters
        found.append(np.stack((values, strength)))
    return found[0], found[1], found[2]


def response_basis(
    width: float, thickness: float, longer: int, shorter: int, betas: FloatArray, tolerance: float
) -> Basis:
    """Cells (n, 4), √area (n,) and currents (n, basis) of a trace.

    The first current is uniform. The others span, to `tolerance`, the response to its own current
    and to incident potentials Re and Im (x + jz)^k, k = 1..4 (Taylor series, fading as 2^−k).
    """
    nx, nz = cell_counts(width, thickness, longer, shorter)
    cells = mesh(cosine_edges(width, nx), cosine_edges(thickness, nz))
    root = np.sqrt(cells[:, 2] * cells[:, 3])
    uniform = root / np.linalg.norm(root)
    M = -root[:, None] * _logs(cells, cells, 0.0, 0.0) * root
    values, vectors, own = _without_net_current(M, uniform)
    place = (cells[:, 0] + 1j * cells[:, 1]) / (0.5 * max(width, thickness))
    potentials = [part * root for k in range(1, 5) for part in ((place**k).real, (place**k).imag)]
    sources = vectors.T @ np.column_stack([own, *potentials])
    weights = 0.5 ** np.array([0, 0, 0, 1, 1, 2, 2, 3, 3])
    answers = []
    for beta in betas:
        answer = sources / (1.0 + 1j * beta * values)[:, None]
        answer *= weights / np.linalg.norm(answer, axis=0)
        answers += [answer.real, answer.imag]
    left, size, _ = np.linalg.svd(np.hstack(answers), full_matrices=False)
    kept = vectors @ left[:, size > tolerance * size[0]]
    return cells, root, np.column_stack((uniform, kept))


def _logs(first: FloatArray, second: FloatArray, x: float, z: float) -> FloatArray:
    """Mean logarithms between the cells of two traces (x, z) apart."""
    logs = np.empty((len(first), len(second)))
    pair_logs(first, np.ascontiguousarray(second.T), x, z, logs)
    return logs


@dataclass(frozen=True, eq=False)
class Section:
    """Parallel traces reduced to their eddy modes, in lengths of `unit`.

    `values` and `vectors` are eigenpairs of the interaction of all modes. `own` (modes, traces) is
    the source of each trace's unit uniform current, `x` and `z` (modes,) of a unit potential
    gradient. `first` (traces + 1,) is the first mode of each trace.
    """

    unit: float
    areas: FloatArray
    first: IntArray
    values: FloatArray
    vectors: FloatArray
    own: FloatArray
    x: FloatArray
    z: FloatArray

    def answer(self, sources: FloatArray, beta: FloatArray) -> ComplexArray:
        """Amplitudes −jβ/(1 + jβM) s of sources (modes, n), (frequencies, modes, n)."""
        modal = self.vectors.T @ sources
        factor = -1j * beta[:, None] / (1.0 + 1j * beta[:, None] * self.values)
        amplitude = self.vectors @ (factor[:, :, None] * modal).transpose(1, 0, 2).reshape(len(modal), -1)
        return np.asarray(amplitude.reshape(len(modal), len(beta), -1).transpose(1, 0, 2), dtype=np.complex128)

    def losses(self, sources: FloatArray, beta: FloatArray) -> FloatArray:
        """Sum |y|² of the eddy currents of each trace, (frequencies, traces, n)."""
        return np.asarray(np.add.reduceat(np.abs(self.answer(sources, beta)) ** 2, self.first[:-1], axis=1))


def interaction(first: Basis, second: Basis, x: float, z: float) -> FloatArray:
    """Matrix M between the currents of two traces (x, z) apart."""
    (cells, root, V), (other_cells, other_root, other_V) = first, second
    return np.asarray(-(root[:, None] * V).T @ _logs(cells, other_cells, x, z) @ (other_root[:, None] * other_V))


def section(
    traces: Sequence[Trace],
    basis: Callable[[float, float], Basis],
    between: Callable[[tuple[float, float], tuple[float, float], float, float], FloatArray],
) -> Section:
    """Reduce parallel traces to their eddy modes, by the basis of a size and interactions of two."""
    unit = max(max(w, t) for _, _, w, t in traces)
    scaled = [tuple(round(value / unit, 9) for value in trace) for trace in traces]
    bases = [basis(w, t) for _, _, w, t in scaled]
    start = np.cumsum([0, *(vectors.shape[1] for _, _, vectors in bases)])
    M = np.empty((start[-1], start[-1]))
    for i, (xi, zi, *size_i) in enumerate(scaled):
        for k, (xk, zk, *size_k) in enumerate(scaled[: i + 1]):
            x, z = round(xk - xi, 8), round(zk - zi, 8)
            block = between((size_i[0], size_i[1]), (size_k[0], size_k[1]), x, z)
            M[start[i] : start[i + 1], start[k] : start[k + 1]] = block
            M[start[k] : start[k + 1], start[i] : start[i + 1]] = block.T
    uniform = np.zeros(start[-1], dtype=bool)
    uniform[start[:-1]] = True
    values, vectors = np.linalg.eigh(M[np.ix_(~uniform, ~uniform)])
    gradients = [np.concatenate([V[:, 1:].T @ (root * cells[:, axis]) for cells, root, V in bases]) for axis in (0, 1)]
    areas = np.array([w * t for _, _, w, t in scaled])
    first = start - np.arange(len(start))
    return Section(unit, areas, first, values, vectors, M[np.ix_(~uniform, uniform)], gradients[0], gradients[1])


def bundle_factors(
    bundle: Section, alone: Sequence[Section], x: FloatArray, z: FloatArray, sign: FloatArray, mean: FloatArray,
    delta: FloatArray,
) -> FloatArray:  # fmt: skip
    """Heat of each trace in a bundle over its heat alone.

    Shape (3, frequencies, traces), for the current `sign` in all, a uniform field along z, and
    along x. `mean` (traces, 2) is the true field of unit current along x (for `sign` 1, reversed
    with the current) and z. Its difference to the bundle's own field acts as an incident field.
    """
    dx, dz = x[:, None] - x, z[:, None] - z
    r2 = dx**2 + dz**2
    np.fill_diagonal(r2, np.inf)
    along_x = sign * mean[:, 0] - (dz / r2) @ sign / (2 * np.pi)
    along_z = mean[:, 1] + (dx / r2) @ sign / (2 * np.pi)
    counts = np.diff(bundle.first)
    incident = bundle.x * np.repeat(along_z, counts) - bundle.z * np.repeat(along_x, counts)
    current = bundle.own @ (sign / np.sqrt(bundle.areas)) / bundle.unit + 2 * np.pi * incident
    heat = bundle.losses(np.column_stack((current, bundle.x, bundle.z)), (bundle.unit / delta) ** 2 / np.pi)
    single = {
        id(one): one.losses(
            np.column_stack((one.own[:, 0] / (one.unit * np.sqrt(one.areas)), one.x, one.z)),
            (one.unit / delta) ** 2 / np.pi,
        )[:, 0]
        for one in alone
    }
    separate = np.stack([single[id(one)] for one in alone], axis=1)
    uniform = 1.0 / (bundle.areas * bundle.unit**2)
    field = (2 * np.pi) ** 2 * (mean[:, 1] ** 2 * separate[..., 1] + mean[:, 0] ** 2 * separate[..., 2])
    own = (uniform + heat[..., 0]) / (uniform + separate[..., 0] + field)
    return np.stack((own, heat[..., 1] / separate[..., 1], heat[..., 2] / separate[..., 2]))
