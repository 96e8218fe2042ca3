"""Linear elasticity of layers by spectral elements: box, wide stack.

The system of a box is factorised once for any number of loads. The displacement u has the energy ½
∫ 2μ dev ε : dev ε + K (Π div u)² dV + ½ Σ springs u², where Π projects on the polynomials of degree
p − 1 of each element. This is the mixed method with a pressure −K Π div u that is discontinuous
between elements, the pressure eliminated element by element. It does not lock as ν → 0.5 (D. Boffi,
F. Brezzi, M. Fortin, Mixed Finite Element Methods and Applications, Springer 2013, section 8.6.3).
With nodes at the Gauss–Lobatto points (C. Canuto et al., Spectral Methods, Springer 2006, section
2.3) an element's matrix is made of Kronecker products of small one-dimensional matrices. The
Cholesky factorisation goes along x from one slab of elements to the next.

A wide (laterally infinite) stack under an axisymmetric pressure is solved by Hankel transform (I.
N. Sneddon, Fourier Transforms, McGraw-Hill 1951, section 54). Each wavenumber k of the pressure, p
= p̂(k) J_0(kr), makes u_z = W(z) J_0(kr) and u_r = U(z) J_1(kr). With the seat's stiffness n and
shear s, the profiles are the stationary point of

    ½ ∫ 2μ (k²U² + W'²) + μ (U' − kW)² − ⅔ μ (W' + kU)² + K (Π(W' + kU))² dz
        + ½ (n W² + s U²)(bottom) + p̂ W(top).

Lengths and stresses are in the units of a `coilarray.elastomer.contact_grid.Stack`.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.polynomial import legendre
from scipy.interpolate import CubicSpline
from scipy.linalg import cholesky, solve_triangular
from scipy.special import j0, j1

from coilarray.compute.arrays import BoolArray, FloatArray, IndexArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import serial_algebra
from coilarray.elastomer.contact_grid import Stack, graded
from coilarray.electromagnetics.flat_stack import wave_rule
from coilarray.geometry import Seat
from coilarray.geometry.elastomer import Base

_DIGITS = 12  # digits of springs in units of the stack, slabs with equal digits are alike
_COPIES = 3  # of a slab's matrix at a time, beside the matrices of all widths

_MIRRORED = np.array([1.0, -1.0, 1.0])[:, None, None, None]  # sign of u_x, u_y and u_z of a mirror image in y
_EVEN_HELD = np.array([False, True, False])  # u_y is zero in the middle of a box that is its own mirror image

SOFTEST = 1e-5  # least 1/K in units of the stack; an incompressible sheet is treated as a sheet of ν = 0.499998
_DEGREE = 8  # of the profiles in an element
_SMOOTH = 1 / 3  # of the contact radius, over which a pressure is smoothed, which determines the highest wavenumber
_CUT = 5.0  # highest wavenumber times that radius, where 5e-5 of the pressure is left
_SPARE = 40  # wavenumbers above two a period
_RATIO = 0.1  # distance of wavenumbers relative to themselves in tables of the profiles, accurate to 1e-5
_FINEST, _GROWTH = 0.03, 0.03  # distance of the radii of the tables, and its growth with the radius


@dataclass(frozen=True, eq=False)
class Axis:
    """Elements along an axis: their rising edges and degree."""

    edges: FloatArray
    degree: int

    @cached_property
    def reference(self) -> FloatArray:
        """Gauss–Lobatto points of the element from −1 to 1, (degree + 1,)."""
        inner = legendre.legroots(legendre.legder(np.eye(self.degree + 1)[self.degree]))
        return np.concatenate(([-1.0], np.sort(inner.real), [1.0]))

    @cached_property
    def nodes(self) -> FloatArray:
        """Nodes in rising order, shape (n,)."""
        left, width = self.edges[:-1, None], np.diff(self.edges)[:, None]
        return np.append((left + width * (self.reference[:-1] + 1) / 2).ravel(), self.edges[-1])

    @cached_property
    def weights(self) -> FloatArray:
        """Weights of the Gauss–Lobatto rule, shape (n,)."""
        p = self.degree
        own = 2 / (p * (p + 1) * legendre.legval(self.reference, np.eye(p + 1)[p]) ** 2)
        weights = np.zeros(len(self.nodes))
        for element, width in enumerate(np.diff(self.edges)):
            weights[self.of(element)] += own * width / 2
        return weights

    def of(self, element: int) -> slice:
        """Nodes of an element."""
        return slice(element * self.degree, (element + 1) * self.degree + 1)

    def shapes(self, at: FloatArray, derivative: int = 0) -> FloatArray:
        """Shape functions on −1 to 1 or a derivative, (points, degree + 1)."""
        coefficients = np.linalg.inv(legendre.legvander(self.reference, self.degree))
        slopes = legendre.legder(coefficients, derivative)
        return np.asarray(legendre.legvander(at, len(slopes) - 1) @ slopes)

    def basis(self, points: FloatArray, derivative: int = 0) -> FloatArray:
        """Shape functions of all nodes or a derivative, (points, n)."""
        element = np.clip(np.searchsorted(self.edges, points, side="right") - 1, 0, len(self.edges) - 2)
        width = np.diff(self.edges)[element]
        local = self.shapes(2 * (points - self.edges[element]) / width - 1, derivative)
        values = np.zeros((len(points), len(self.nodes)))
        columns = element[:, None] * self.degree + np.arange(self.degree + 1)
        np.put_along_axis(values, columns, local * (2 / width[:, None]) ** derivative, axis=1)
        return values

    def rule(self, widest: float) -> tuple[FloatArray, FloatArray]:
        """Gauss–Legendre points and weights in elements, about `widest` apart."""
        points, weights = [], []
        for left, width in zip(self.edges[:-1], np.diff(self.edges), strict=True):
            x, w = legendre.leggauss(self.degree + 1 + int(width / widest))
            points.append(left + width * (x + 1) / 2)
            weights.append(width * w / 2)
        return np.concatenate(points), np.concatenate(weights)


@dataclass(frozen=True, eq=False)
class ElementMatrices:
    """Integrals over an element of shape functions φ and Legendre polynomials L.

    `mass` ∫φφ, `mixed` ∫φ'φ and `stiffness` ∫φ'φ' are of shape (n, n). `mean` ∫L_a φ and `slope`
    ∫L_a φ', (degree, n), have their rows divided by the norm of L_a.
    """

    mass: FloatArray
    mixed: FloatArray
    stiffness: FloatArray
    mean: FloatArray
    slope: FloatArray

    def product(self, test: bool, trial: bool) -> FloatArray:
        """∫ of test function times trial function, or of their derivatives."""
        if test and trial:
            return self.stiffness
        if test or trial:
            return self.mixed if test else self.mixed.T
        return self.mass


def element_matrices(axis: Axis, width: float) -> ElementMatrices:
    """Integrals over an element of an axis."""
    x, w = legendre.leggauss(axis.degree + 1)
    value, slope = axis.shapes(x), axis.shapes(x, 1)
    polynomials = legendre.legvander(x, axis.degree - 1) * np.sqrt(2 * np.arange(axis.degree) + 1) / np.sqrt(width)
    weighted = w[:, None] * value
    return ElementMatrices(
        mass=width / 2 * value.T @ weighted,
        mixed=slope.T @ weighted,
        stiffness=2 / width * slope.T @ (w[:, None] * slope),
        mean=width / 2 * polynomials.T @ weighted,
        slope=polynomials.T @ (w[:, None] * slope),
    )


def element_stiffness(parts: tuple[ElementMatrices, ...], shear: float, squash: float) -> FloatArray:
    """Stiffness of a box-shaped element by (component, x node, y node, z node)."""

    def product(test: int, trial: int) -> FloatArray:
        x, y, z = (part.product(test == axis, trial == axis) for axis, part in enumerate(parts))
        size = len(x) * len(y) * len(z)
        return np.asarray(np.einsum("ai,bj,ck->abcijk", x, y, z).reshape(size, size))

    gradients = [[product(i, j) for j in range(3)] for i in range(3)]  # ∫ ∂_i φ ∂_j φ
    laplace = sum(gradients[i][i] for i in range(3))
    blocks = [
        [
            shear * (gradients[j][i] - 2 / 3 * gradients[i][j] + (laplace if i == j else 0.0))  # test i, trial j
            for j in range(3)
        ]
        for i in range(3)
    ]
    # ∫ L div φ for the products L of Legendre polynomials of the degrees `modes`
    degree = len(parts[0].mean)
    modes = np.array([mode for mode in itertools.product(range(degree), repeat=3) if sum(mode) < degree])
    columns = []
    for component in range(3):
        rows = [
            (part.slope if axis == component else part.mean)[mode]
            for axis, (part, mode) in enumerate(zip(parts, modes.T, strict=True))
        ]
        columns.append(np.einsum("mx,my,mz->mxyz", *rows).reshape(len(modes), -1))
    swelling = np.hstack(columns)
    return np.asarray(np.block(blocks) + swelling.T @ swelling / max(squash, SOFTEST))


@dataclass(frozen=True, eq=False)
class _Slab:
    """Cholesky factor of a slab, and its links to both faces."""

    lower: FloatArray
    before: FloatArray
    after: FloatArray


@dataclass(frozen=True, eq=False)
class _Factors:
    """Cholesky factors of a box or of its lower half.

    The factors are within its slabs, equal ones stored once with their numbers, then of faces
    between them, each with its link to the next. `kept` are the free displacements in a plane
    across x, (3, ny, nz).
    """

    kept: IndexArray
    slabs: tuple[tuple[_Slab, list[int]], ...]
    faces: tuple[tuple[FloatArray, FloatArray], ...]
    last: FloatArray

    def solve(self, loads: FloatArray, degree: int) -> FloatArray:
        """Displacements under loads, both (nx, 3, ny, nz, cases)."""
        nx, cases, p = len(loads), loads.shape[-1], degree
        right = loads.reshape(nx, -1, cases)[:, self.kept]
        n = len(self.kept)

        def within(slab: _Slab, values: FloatArray, trans: Literal[0, 1]) -> FloatArray:
            """Solve a triangular system for (slabs, inner, cases)."""
            side_by_side = values.transpose(1, 0, 2).reshape(values.shape[1], -1)
            found = solve_triangular(slab.lower, side_by_side, lower=True, trans=trans, check_finite=False)
            return np.asarray(found.reshape(len(found), -1, cases).transpose(1, 0, 2))

        inner = right[:-1].reshape(-1, p, n, cases)[:, 1:].reshape(-1, (p - 1) * n, cases)
        for slab, numbers in self.slabs:
            inner[numbers] = part = within(slab, inner[numbers], 0)
            first = np.array(numbers) * p
            right[first] -= slab.before.T @ part
            right[first + p] -= slab.after.T @ part
        found = right[::p].copy()
        for k, (lower, link) in enumerate(self.faces):
            found[k] = solve_triangular(lower, found[k], lower=True, check_finite=False)
            found[k + 1] -= link.T @ found[k]
        found[-1] = solve_triangular(self.last, found[-1], lower=True, check_finite=False)
        found[-1] = solve_triangular(self.last, found[-1], lower=True, trans=1, check_finite=False)
        for k in reversed(range(len(self.faces))):
            lower, link = self.faces[k]
            found[k] = solve_triangular(lower, found[k] - link @ found[k + 1], lower=True, trans=1, check_finite=False)
        solution = np.zeros((nx, int(np.prod(loads.shape[1:-1])), cases))
        for slab, numbers in self.slabs:
            at = np.array(numbers)
            part = inner[at] - slab.before @ found[at] - slab.after @ found[at + 1]
            planes = (at[:, None] * p + np.arange(1, p)).ravel()
            solution[np.ix_(planes, self.kept)] = within(slab, part, 1).reshape(-1, n, cases)
        solution[::p, self.kept] = found
        return solution.reshape(loads.shape)


@dataclass(frozen=True, eq=False)
class Box:
    """Layered box, factorised, elements of z from the board up.

    A box symmetric in y is stored as two halves, of even and of odd displacements.
    """

    axes: tuple[Axis, Axis, Axis]
    _parts: tuple[_Factors, ...]

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Numbers of x nodes, components, y nodes, z nodes."""
        x, y, z = (len(axis.nodes) for axis in self.axes)
        return x, 3, y, z

    @property
    def mirrored(self) -> bool:
        """Whether the box is its own mirror image in y."""
        return len(self._parts) == 2

    def displacements(self, loads: FloatArray) -> FloatArray:
        """Displacements under nodal loads, both (nx, 3, ny, nz, cases)."""
        degree = self.axes[0].degree
        if not self.mirrored:
            return self._parts[0].solve(loads, degree)
        middle = loads.shape[2] // 2
        below, above = loads[:, :, : middle + 1] / 2, _MIRRORED * loads[:, :, : middle - 1 : -1] / 2
        below[:, :, -1] /= 2  # each half has half of the plane in the middle
        above[:, :, -1] /= 2
        even, odd = (part.solve(below + sign * above, degree) for part, sign in zip(self._parts, (1, -1), strict=True))
        return np.concatenate((even + odd, _MIRRORED * (even - odd)[:, :, -2::-1]), axis=2)


@serial_algebra()
def factorised(
    axes: tuple[Axis, Axis, Axis], shear: FloatArray, squash: FloatArray, springs: FloatArray, held: BoolArray
) -> Box:
    """Assemble and factorise a box.

    `shear` and `squash` (elements along z,) are μ and 1/K. `springs` (3, nx, ny) are at the bottom,
    where the components `held` (3,) are zero.
    """
    x, y, z = axes
    p, ny, nz = x.degree, len(y.nodes), len(z.nodes)
    widths, rows = np.diff(x.edges), np.diff(y.edges)
    alike = np.allclose(rows, rows[::-1]) and np.allclose(springs, springs[..., ::-1])
    mirrored = alike and len(rows) % 2 == 0
    plane = 3 * (ny // (1 + mirrored) + 1) * nz
    inner, distinct = (p - 1) * plane, np.unique(widths.round(9)).tolist()
    stored = len(widths) * (inner * (inner + 2 * plane) + 2 * plane**2)
    require_memory(
        8.0 * ((1 + mirrored) * stored + (len(distinct) + _COPIES) * (inner + 2 * plane) ** 2),
        f"a sample of {float(np.ptp(x.edges)):.3g} by {float(np.ptp(y.edges)):.3g} of its thicknesses",
        "take smaller sample_x_mm and sample_y_mm, or leave them out for a wide sample",
    )
    if mirrored:
        rows, ny = rows[: len(rows) // 2], ny // 2 + 1
        springs = springs[..., :ny].copy()
        springs[..., -1] /= 2
    size = 3 * ny * nz
    number = np.arange(size).reshape(3, ny, nz)
    bottom = np.zeros((len(x.nodes), 3, ny, nz))
    bottom[..., 0] = springs.transpose(1, 0, 2)
    diagonal = bottom.reshape(len(x.nodes), size)

    def slab(width: float) -> FloatArray:
        """Stiffness of a slab of elements between two x planes."""
        total = np.zeros((p + 1, size, p + 1, size)).reshape((p + 1) * size, -1)
        along = element_matrices(x, width)
        for (row, depth), (level, height) in itertools.product(enumerate(rows), enumerate(np.diff(z.edges))):
            matrices = (along, element_matrices(y, depth), element_matrices(z, height))
            matrix = element_stiffness(matrices, float(shear[level]), float(squash[level]))
            own = number[:, y.of(row), z.of(level)]
            where = (own[:, None] + size * np.arange(p + 1)[None, :, None, None]).ravel()
            total[np.ix_(where, where)] += matrix
        return total

    slabs = {same: slab(same) for same in distinct}
    parts = []
    for zero in (_EVEN_HELD, ~_EVEN_HELD) if mirrored else (np.zeros(3, dtype=bool),):
        free = np.ones((3, ny, nz), dtype=bool)
        free[held, :, 0] = free[zero, -1] = False
        kept = np.flatnonzero(free)
        parts.append(_factors(slabs, widths, kept, diagonal[:, kept], p, size))
    return Box(axes, tuple(parts))


def _factors(
    slabs: dict[float, FloatArray], widths: FloatArray, kept: IndexArray, diagonal: FloatArray, p: int, size: int
) -> _Factors:
    """Factorise slabs (stiffness by width, springs (nx, kept)) and faces between them."""
    n = len(kept)
    inner, faces = (kept + size * np.arange(1, p)[:, None]).ravel(), (kept, kept + size * p)
    known: dict[tuple[float, bytes], tuple[_Slab, tuple[FloatArray, ...], list[int]]] = {}
    found = []
    own = np.diag(diagonal[0])
    for k, width in enumerate(widths.round(9).tolist()):
        springs = diagonal[k * p + 1 : (k + 1) * p].ravel()
        key = width, springs.round(_DIGITS).tobytes()
        if key not in known:
            whole = slabs[width]
            matrix = np.asfortranarray(whole[np.ix_(inner, inner)])
            matrix[range(len(matrix)), range(len(matrix))] += springs
            lower = cholesky(matrix, lower=True, overwrite_a=True, check_finite=False)
            links = np.asfortranarray(whole[np.ix_(inner, np.concatenate(faces))])
            links = solve_triangular(lower, links, lower=True, overwrite_b=True, check_finite=False)
            taken = links.T @ links
            before, across, after = (
                whole[np.ix_(*pair)] - taken[rows, columns]
                for pair, rows, columns in (
                    ((faces[0], faces[0]), slice(n), slice(n)),
                    ((faces[0], faces[1]), slice(n), slice(n, None)),
                    ((faces[1], faces[1]), slice(n, None), slice(n, None)),
                )
            )
            known[key] = _Slab(lower, links[:, :n], links[:, n:]), (before, across, after), []
        _, (before, across, after), numbers = known[key]
        numbers.append(k)
        lower = cholesky(own + before, lower=True, overwrite_a=True, check_finite=False)
        link = solve_triangular(lower, across, lower=True, check_finite=False)
        found.append((lower, link))
        own = after - link.T @ link + np.diag(diagonal[(k + 1) * p])
    alike = tuple((slab, numbers) for slab, _, numbers in known.values())
    return _Factors(kept, alike, tuple(found), cholesky(own, lower=True, check_finite=False))


def wide_field(
    stack: Stack, base: Base, r: FloatArray, pressure: FloatArray, heights: FloatArray, extent: float
) -> tuple[CubicSpline, CubicSpline]:
    """Displacement and stress of a wide stack about the axis, splines of radii (…).

    The pressures (cases, n) are linear between radii, the heights −1 to 0. The first spline gives
    u_r and u_z, the second σ_rr, hoop stress and σ_rz, (…, 2 or 3, cases, heights).
    """
    loaded = np.flatnonzero((pressure > 0).any(axis=0))
    contact = float(r[min(loaded[-1] + 1, len(r) - 1)]) if len(loaded) else 1.0
    highest = _CUT / (_SMOOTH * contact)
    count = int(np.ceil(highest * extent / np.pi)) + _SPARE
    k, rule = wave_rule(highest, count)
    spread = (k * _SMOOTH * contact) ** 2 / 2
    smooth = (1 + spread) * np.exp(-spread)  # keeps the force and its second moments unchanged
    # ∫ p J_0(kr) r dr
    x, w = legendre.leggauss(4)
    width, rise = np.diff(r)[:, None], (x + 1) / 2
    at = r[:-1, None] + width * rise
    values = pressure[:, :-1, None] * (1 - rise) + pressure[:, 1:, None] * rise
    loads = (values * at * width * w / 2).reshape(len(pressure), -1)
    used = (loads != 0).any(axis=0)
    strength = loads[:, used] @ j0(np.outer(at.ravel()[used], k)) * smooth * rule * k
    few = graded(float(k[0]), float(k[-1]), lambda k: _RATIO * k)
    profiles = (CubicSpline(few, profile)(k) for profile in _profiles(stack, base, few, heights))
    radii = graded(0.0, extent, lambda r: _FINEST + _GROWTH * r)
    kr = np.outer(k, radii)
    even, odd = j0(kr), j1(kr)
    ratio = np.where(radii > 0, odd / np.where(radii > 0, radii, 1.0), k[:, None] / 2)  # J_1(kr)/r

    def summed(profile: FloatArray, waves: FloatArray) -> FloatArray:
        """Sum over k, shape (radii, cases, heights)."""
        return np.stack([waves.T @ (load[:, None] * profile) for load in strength], axis=1)

    W, U, isotropic, widening, shearing = profiles
    hoop = summed(2 * widening, ratio)  # 2μ u_r/r
    mean = summed(isotropic, even)
    stress = [mean + summed(2 * k[:, None] * widening, even) - hoop, mean + hoop, summed(shearing, odd)]
    moved = [summed(U, odd), summed(W, even)]
    return CubicSpline(radii, np.stack(moved, axis=1)), CubicSpline(radii, np.stack(stress, axis=1))


def _profiles(stack: Stack, base: Base, k: FloatArray, heights: FloatArray) -> tuple[FloatArray, ...]:
    """Profiles W, U, −p − ⅔ μ div u, μU, μ(U' − kW) under unit pressures, (k, heights)."""
    # edges of elements, finer towards the top, and their sheets
    bounds, sheet = [stack.levels[0]], []
    for number, upper in enumerate(stack.levels[1:]):
        while (gap := upper - bounds[-1]) > 0:
            step = max(0.35 * (0.05 - bounds[-1]), 0.05)  # shorter waves matter closer to the top
            bounds.append(upper if gap < 1.5 * step else bounds[-1] + step)
            sheet.append(number)
    edges, sheet_of = np.array(bounds), np.array(sheet)
    axis = Axis(edges, _DEGREE)
    n = len(axis.nodes)
    constant, linear, square = (np.zeros((2 * n, 2 * n)) for _ in range(3))  # coefficients of the powers of k
    bulk = []
    for element, width in enumerate(np.diff(edges)):
        part, own = element_matrices(axis, float(width)), axis.of(element)
        mu, soft = stack.shear[sheet_of[element]], max(float(stack.squash[sheet_of[element]]), SOFTEST)
        w, u = own, slice(n + own.start, n + own.stop)
        constant[w, w] += mu * 4 / 3 * part.stiffness + part.slope.T @ part.slope / soft
        constant[u, u] += mu * part.stiffness
        square[w, w] += mu * part.mass
        square[u, u] += mu * 4 / 3 * part.mass + part.mean.T @ part.mean / soft
        cross = -mu * (part.mixed.T + 2 / 3 * part.mixed) + part.slope.T @ part.mean / soft  # test W, trial U
        linear[w, u] += cross
        linear[u, w] += cross.T
        bulk.append((part, soft))
    free = np.ones(2 * n, dtype=bool)
    if isinstance(base, Seat):
        unit = stack.length / stack.stress
        constant[0, 0] += base.stiffness * unit
        constant[n, n] += base.shear * unit
    else:
        free[[0, n] if base == "bonded" else [0]] = False
    where = np.ix_(free, free)
    system = constant[where] + k[:, None, None] * linear[where] + (k**2)[:, None, None] * square[where]
    load = np.zeros((len(k), 2 * n))
    load[:, n - 1] = -1.0
    solution = np.zeros_like(load)
    solution[:, free] = np.linalg.solve(system, load[:, free][..., None])[..., 0]
    W, U = solution[:, :n], solution[:, n:]

    value, slope = axis.basis(heights), axis.basis(heights, 1)
    holding = np.clip(np.searchsorted(edges, heights, side="right") - 1, 0, len(edges) - 2)
    mu = stack.shear[sheet_of[holding]]
    isotropic = np.empty((len(k), len(heights)))
    for e in np.unique(holding).tolist():
        here, own, (part, soft) = holding == e, axis.of(e), bulk[e]
        local = 2 * (heights[here] - edges[e]) / (edges[e + 1] - edges[e]) - 1
        norms = np.sqrt((2 * np.arange(_DEGREE) + 1) / (edges[e + 1] - edges[e]))
        modes = legendre.legvander(local, _DEGREE - 1) * norms
        amount = W[:, own] @ part.slope.T + k[:, None] * (U[:, own] @ part.mean.T)
        isotropic[:, here] = amount @ modes.T / soft
    isotropic -= 2 / 3 * mu * (W @ slope.T + k[:, None] * (U @ value.T))
    shearing = mu * (U @ slope.T - k[:, None] * (W @ value.T))
    return W @ value.T, U @ value.T, isotropic, mu * (U @ value.T), shearing
