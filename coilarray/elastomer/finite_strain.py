"""Large deformations of nearly incompressible neo-Hookean sheets.

With F the deformation gradient, J = det F and p a pressure that is discontinuous between elements,
the solution is the stationary point of

    Π = ∫ (μ/2 (J^(−2/3) F:F − 3) + p (J − 1) − p²/2K) w + ½ uᵀ springs u − Σ_j f_j G_j

under G_j ≥ 0, f_j ≥ 0, f_j G_j = 0. The mean gap over hat j at the deformed positions x = r + u_r
of its points is

    G_j = ∫ψ_j (outline(x) − depth − u_z) w(x) dx / ∫ψ_j w dr.

The forces on the hats are then a pressure f_j/∫ψ_j w dr that is normal to the deformed surface, as
its derivative by u shows. So the contact has no friction, and a surface that waves between the hats
gains nothing by it. With the gap over the undeformed area the pressure would keep its direction
there. Under a tip, where it exceeds 2μ, such waves would grow. A contact that reaches the free edge
of a sample uses the undeformed area. Otherwise the edge would gain by moving outwards if the last
hat's gap is zero only on average. For small u this is `coilarray.elastomer.contact`.

Newton's method goes from depth to depth. Each of its steps solves the contact under a tangent: gaps
are closed while forces push on them and where they would be below zero (a semi-smooth Newton
method). A tangent serves for several steps as long as they shrink fast. Most tangents have only a
part of the stress that the contact brings. They are positive definite and cheap. Exact tangents
follow if steps shrink slowly. They need not be positive definite, since only the contact holds the
compressed surface.

P. Wriggers, Nonlinear Finite Element Methods, Springer 2008, sections 3.3.1 (material) and 10.4
(mixed elements). M. Hintermüller, K. Ito, K. Kunisch, SIAM J. Optim. 13 (2002) 865 (contact set).
P. Deuflhard, Newton Methods for Nonlinear Problems, Springer 2004, chapter 3 (damping, repeated use
of tangents).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from typing import Any

import numpy as np
from scipy import sparse
from scipy.linalg.lapack import dpbtrf, dtbtrs
from scipy.sparse.linalg import splu

from coilarray.compute.arrays import BoolArray, FloatArray, IndexArray
from coilarray.elastomer.contact_grid import ContactGrid, hoop_strain, linear_pressures, quadrature_weights, weight
from coilarray.errors import ElastomerError
from coilarray.geometry import Cone, CylinderEdge, FlatPunch, Hemisphere, Indenter, Paraboloid

EDGE_ELEMENTS = 10  # most across a contact with a sharp edge; those at the edge are then a fifth of its rounding
TIP = 0.05  # of the contact radius, over which a cone's point is blunted, which reduces the force by about 0.1 %

_STEEPEST = math.radians(80)  # beyond this slope the side of an indenter is straight
_MOST_TANGENTS = 32  # from one depth to the next, contacts that converge take 2 to 8
_MOST_AT_ONCE = 8  # tangents at the depth of one step
_LEAST_DAMPING = 1 / 32
_CONVERGED = 1e-9  # of the depth: the last step times the rate at which steps shrink
_FAR = 0.01  # of the depth: a larger step changes the tangent
_FAST, _SLOW = 0.3, 0.5  # rates up to which a tangent is used again, if it is exact or found far away, and otherwise
_STRESSED = 0.25  # share of the contact's stress in a tangent that is not exact
_LEAST_STEP = 1 / 16  # of the way from one depth to the next
_FARTHEST_AHEAD = 1.5  # steps to which the last one is continued
_MOST_SETS = 20  # of closed gaps that are tried under one tangent
_SOFT = 1e-5  # least 1/K of a tangent, the part of a volume error that one step leaves
_PIVOT = 1e-3  # of the greatest in its column: least entry on the diagonal of an exact tangent to stay there
_PRESSURES = 3  # 1, ξ and η in every element
_R, _Z, _STRETCH = range(3)  # of a displacement at a boundary: u_r, u_z and ∂u_r/∂r


@dataclass(frozen=True)
class Outline:
    """Height, slope and curvature of an indenter in a unit of length.

    `tip` is the radius over which a cone's point is blunted. Under a sharp point the strain is
    unbounded.
    """

    indenter: Indenter
    unit: float
    tip: float = 0.0

    def __call__(self, r: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Height above the tip, slope and second derivative at radii `r`.

        They are smooth beyond the end of the indenter.
        """
        body = self.indenter
        start, radius = math.inf, 1.0  # of the arc in which the side rises
        height, slope, bend = np.zeros_like(r), np.zeros_like(r), np.zeros_like(r)
        if isinstance(body, Hemisphere | CylinderEdge):
            start, radius = 0.0, body.radius / self.unit
        elif isinstance(body, FlatPunch | Cone) and math.isfinite(body.radius):
            radius = body.rounding / self.unit
            start = body.radius / self.unit - radius
        if isinstance(body, Cone):
            steep, distance = 1 / math.tan(body.half_angle), np.hypot(r, self.tip)
            height, slope = steep * distance, steep * r / distance
            bend = steep * self.tip**2 / distance**3
        elif isinstance(body, Paraboloid):
            curvature = self.unit / body.radius
            height, slope, bend = curvature * r**2 / 2, curvature * r, np.full_like(r, curvature)
        if math.isinf(start):
            return height, slope, bend
        along = np.maximum(r - start, 0.0)
        arc = np.minimum(along, radius * math.sin(_STEEPEST))
        cosine = np.sqrt(1 - (arc / radius) ** 2)
        rising = radius * (1 - cosine) + (along - arc) * math.tan(_STEEPEST)
        turning = np.where((along > arc) | (r < start), 0.0, 1 / (radius * cosine**3))
        return height + rising, slope + arc / (radius * cosine), bend + turning


@dataclass(frozen=True, eq=False)
class Pressed:
    """State at a depth: displacement (n,), pressures (3, elements), forces (m,)."""

    depth: float
    u: FloatArray
    p: FloatArray
    f: FloatArray

    def moved(self, step: _Vector, share: float) -> Pressed:
        """Return the state after a share of a step."""
        f = (1 - share) * self.f + share * step.f  # exact zeros after a whole step
        return replace(self, u=self.u + share * step.u, p=self.p + share * step.p, f=f)

    def towards(self, depth: float, before: Pressed) -> Pressed:
        """Extrapolate two states linearly to a depth, if it is near."""
        share = (depth - self.depth) / (self.depth - before.depth) if before.depth else math.inf
        if share > _FARTHEST_AHEAD:
            return self
        f = np.maximum(self.f + share * (self.f - before.f), 0.0)
        return replace(self, u=self.u + share * (self.u - before.u), p=self.p + share * (self.p - before.p), f=f)


@dataclass(frozen=True, eq=False)
class _Vector:
    """Residual or step: displacement, pressures, and gaps or forces."""

    u: FloatArray
    p: FloatArray
    f: FloatArray

    @property
    def size(self) -> float:
        """Largest displacement."""
        return float(np.abs(self.u).max())


# the step that cancels a residual of a state with some forces, or None if there is none
_Tangent = Callable[[_Vector, FloatArray], _Vector | None]


@dataclass(frozen=True, eq=False)
class _Gaps:
    """Mean gaps G (m,) and their derivatives.

    The derivatives are by the top's u (t, m) and by the depth (m,), less than 0. At the top's
    points, `shifts` and `swells` (points, t), sparse, are the derivatives of gap and area by u, and
    `bend` the outline's second derivative.
    """

    mean: FloatArray
    slopes: FloatArray
    reach: FloatArray
    shifts: Any
    swells: Any
    gap: FloatArray
    area: FloatArray
    bend: FloatArray


@dataclass(frozen=True, eq=False)
class _Strained:
    """Deformation at quadrature points: F (5 entries), J, ∂ln J/∂F, μ J^(−2/3), p."""

    F: FloatArray
    D: FloatArray
    J: FloatArray
    g: FloatArray
    a: FloatArray
    p: FloatArray


class SoftBody:
    """Meshed stack for large deformations under an indenter."""

    def __init__(self, grid: ContactGrid, outline: Outline) -> None:
        self.grid, self.outline = grid, outline
        basis, r = grid.basis, grid.basis.global_coordinates()[0]
        self._count, self._dofs = basis.N, np.ascontiguousarray(basis.element_dofs.T)
        self._measure, self._local = quadrature_weights(basis, grid.symmetry), linear_pressures(basis)
        # entries rr, rz, zr, zz and the hoop of F for each basis function: (elements, points, 5,
        # functions)
        strain = np.array(
            [
                [u.grad[0, 0], u.grad[0, 1], u.grad[1, 0], u.grad[1, 1], hoop_strain(grid.symmetry, u, r)]
                for (u,) in basis.basis
            ]
        ).transpose(2, 3, 1, 0)
        self._strain = np.ascontiguousarray(strain)
        self._entries = self._strain.reshape(len(strain), -1, strain.shape[-1])
        self._squash = grid.squash[:, None]
        local = self._local[:, None, None, :] * self._local[None, :, None, :] * self._measure
        masses = local.sum(axis=-1).transpose(2, 0, 1)  # ∫ p q w of each element
        self._bulk = np.linalg.inv(np.maximum(self._squash, _SOFT)[..., None] * masses)
        top = grid.top
        self._length, self._r = top.dx.ravel(), top.global_coordinates()[0].ravel()
        self._moving = bool(grid.radii[-1] < grid.r[-1])  # the area over which gaps are taken moves with the body
        free = np.setdiff1d(np.arange(self._count), grid.held)
        touched = np.intersect1d(top.element_dofs, free)
        outwards, upwards, stretch = (_on_boundary(top, touched, k) for k in (_R, _Z, _STRETCH))
        moving = (outwards != 0).any(axis=0) | (upwards != 0).any(axis=0)
        self._touched = touched[moving]
        self._outwards, self._upwards, self._stretch, self._hats = (
            sparse.csr_array(one)
            for one in (outwards[:, moving], upwards[:, moving], stretch[:, moving], _on_boundary(grid.hats, grid.used))
        )
        felt = abs(self._outwards) + abs(self._upwards)
        self._near = (felt.T @ felt).nonzero()
        self._springs = grid.springs.tocoo()
        # a narrow band of the free displacements, with the contact last, so that its end gives the
        # response to forces on hats
        r, z = self.grid.basis.doflocs.round(12)
        self._order = free[np.lexsort((free, z[free], -r[free]))]
        place = np.full(self._count, -1)
        place[self._order] = np.arange(len(free))
        self._first = int(place[self._touched].min())  # of the contact
        pairs = (
            np.broadcast_arrays(self._dofs[:, :, None], self._dofs[:, None]),
            (self._springs.row, self._springs.col),
            [self._touched[side] for side in self._near],
        )
        row, column = (place[np.concatenate([pair[k].ravel() for pair in pairs])] for k in range(2))
        self._kept = np.flatnonzero((row >= column) & (column >= 0))  # the tangent is symmetric
        below = (row - column)[self._kept]
        self._height = int(below.max()) + 1
        self._places = column[self._kept] * self._height + below

    def at_rest(self) -> Pressed:
        """Return the state before contact."""
        elements = len(self._dofs)
        return Pressed(0.0, np.zeros(self._count), np.zeros((_PRESSURES, elements)), np.zeros(len(self.grid.used)))

    def press(self, depths: FloatArray) -> Iterator[Pressed]:
        """Yield the states at rising depths in thicknesses.

        Each solution starts from the state before. Raises ElastomerError if no step is small enough
        for Newton's method. Then the strains are too large for the mesh.
        """
        state = before = self.at_rest()
        for depth in depths:
            whole = step = depth - state.depth
            tangents = iter(range(_MOST_TANGENTS))
            while state.depth < depth:
                to = depth if step >= depth - state.depth else state.depth + step
                found = self._solved(state.towards(to, before), to, tangents)
                if found is not None:
                    before, state, step = state, found, 2 * step
                elif step < _LEAST_STEP * whole:
                    body, mm = self.outline.indenter, self.outline.unit * 1e3
                    edged = isinstance(body, FlatPunch | Cone) and math.isfinite(body.radius)
                    raise ElastomerError(
                        f"the contact converges up to a depth of {state.depth * mm:.3g} mm; it must be less than "
                        f"{depth * mm:.3g} mm,{' the edge rounder (edge_radius),' * edged} the mesh finer, or the "
                        "strain linear."
                    )
                else:
                    step /= 2
            yield state

    def _solved(self, state: Pressed, depth: float, tangents: Iterator[int]) -> Pressed | None:
        """State at a depth by Newton's method with halved steps, or None."""
        state = replace(state, depth=depth)
        strained, gaps, exact = self._strained(state), self._gaps(state), False
        for _ in islice(tangents, _MOST_AT_ONCE):
            if strained is None or (tangent := self._tangent(strained, gaps, state, exact)) is None:
                return None
            if (step := tangent(self._residual(strained, gaps, state), state.f)) is None:
                return None
            far, rate = step.size > _FAR * depth, 0.0
            while rate <= (_FAST if far or exact else _SLOW):
                damping = 1.0
                while damping >= _LEAST_DAMPING:
                    trial = state.moved(step, damping)
                    strained = self._strained(trial)
                    if strained is not None:
                        gaps = self._gaps(trial)
                        following = tangent(self._residual(strained, gaps, trial), trial.f)
                        if following is not None and following.size <= (1 - damping / 4) * step.size:
                            break
                    damping /= 2
                else:
                    if exact or far:
                        return None
                    strained, gaps = self._strained(state), self._gaps(state)
                    break  # an exact tangent may give a shorter step
                rate = 1.0 if damping < 1 else following.size / step.size if step.size else 0.0
                state, step = trial, following
                if rate * step.size <= _CONVERGED * depth and damping == 1:
                    return state.moved(step, 1.0)
            exact = not far
        return None

    def _strained(self, state: Pressed) -> _Strained | None:
        """Deformation in a state, None if an element is inverted."""
        entries = self._entries @ state.u[self._dofs][..., None]
        F = np.ascontiguousarray(entries.reshape(*self._measure.shape, 5).transpose(2, 0, 1))
        F[[0, 3, 4]] += 1
        D = F[0] * F[3] - F[1] * F[2]
        if not ((D > 0).all() and (F[4] > 0).all()):  # also NaN
            return None
        J = D * F[4]
        g = np.stack([F[3] / D, -F[2] / D, -F[1] / D, F[0] / D, 1 / F[4]])
        return _Strained(F, D, J, g, self.grid.shear[:, None] * J ** (-2 / 3), state.p.T @ self._local)

    def _residual(self, s: _Strained, gaps: _Gaps, state: Pressed) -> _Vector:
        """∂Π/∂u, ∂Π/∂p and the mean gaps."""
        stress = (s.a * (s.F - (s.F**2).sum(axis=0) / 3 * s.g) + s.p * s.J * s.g) * self._measure
        nodal = self._entries.swapaxes(1, 2) @ stress.transpose(1, 2, 0).reshape(len(self._dofs), -1, 1)
        force = self._gathered(nodal) + self.grid.springs @ state.u
        force[self._touched] -= gaps.slopes @ state.f
        volume = self._local @ ((s.J - 1 - self._squash * s.p) * self._measure).T
        return _Vector(force, volume, gaps.mean)

    def _gathered(self, nodal: FloatArray) -> FloatArray:
        """Sum the elements' contributions to their functions, (n,)."""
        return np.asarray(np.bincount(self._dofs.ravel(), nodal.ravel(), self._count), dtype=float)

    def _tangents(self, s: _Strained) -> tuple[FloatArray, FloatArray]:
        """∂²Π/∂u² and ∂²Π/∂u∂p of every element without contact."""
        g, square = s.g, (s.F**2).sum(axis=0)
        second = np.zeros((5, 5, *s.J.shape))  # ∂² ln J/∂F²
        second[:4, :4] = -g[:4, None] * g[None, :4]
        for i, j, sign in ((0, 3, 1), (3, 0, 1), (1, 2, -1), (2, 1, -1)):
            second[i, j] += sign / s.D
        second[4, 4] = -(g[4] ** 2)
        outer, mixed = g[:, None] * g[None], s.F[:, None] * g[None]
        H = s.a * (-2 / 3 * (mixed + mixed.swapaxes(0, 1)) + square * (2 / 9 * outer - second / 3))
        H += s.p * s.J * (outer + second)
        H[range(5), range(5)] += s.a
        H *= self._measure
        acted = H.transpose(2, 3, 0, 1) @ self._strain
        columns = self._entries.swapaxes(1, 2)
        stiffness = columns @ acted.reshape(self._entries.shape)
        swelling = (s.J * g * self._measure).transpose(1, 2, 0)[:, :, None, :] @ self._strain
        return stiffness, swelling[:, :, 0].transpose(0, 2, 1) @ self._local.T

    def _gaps(self, state: Pressed) -> _Gaps:
        """Gaps between the deformed top and the indenter."""
        u, grid = state.u[self._touched], self.grid
        x, stretch = self._r + self._outwards @ u, 1 + self._stretch @ u
        height, slope, bend = self.outline(x)
        gap = height - state.depth - self._upwards @ u
        if self._moving:
            measure = weight(grid.symmetry, x)
            area, swells = measure * stretch, _scaled(self._stretch, measure)
            if grid.symmetry == "axial":
                swells = swells + _scaled(self._outwards, stretch)
        else:
            area, swells = weight(grid.symmetry, self._r), 0 * self._stretch
        shifts = _scaled(self._outwards, slope) - self._upwards
        sums = _scaled(self._hats, self._length).T  # sums over the hats of values at the points
        slopes = (sums @ (_scaled(shifts, area) + _scaled(swells, gap))).toarray().T / grid.mass
        mean, reach = (sums @ one / grid.mass for one in (gap * area, area))
        return _Gaps(mean, slopes, reach, shifts, swells, gap, area, bend)

    def _bending(self, gaps: _Gaps, f: FloatArray) -> FloatArray:
        """Second derivative of −Σ f_j G_j by the top's u, (t, t)."""
        pressure = self._hats @ (f / self.grid.mass) * self._length
        half = gaps.shifts.T @ _scaled(gaps.swells, pressure)
        half = half + self._outwards.T @ _scaled(self._outwards, pressure * gaps.area * gaps.bend / 2)
        if self._moving and self.grid.symmetry == "axial":
            half = half + self._outwards.T @ _scaled(self._stretch, pressure * gaps.gap)
        return np.asarray(-(half + half.T).toarray())

    def forces(self, state: Pressed) -> FloatArray:
        """Vertical forces (m,) of the deformed surface on the hats."""
        return state.f * self._gaps(state).reach

    def _tangent(self, s: _Strained, gaps: _Gaps, state: Pressed, exact: bool) -> _Tangent | None:
        """Factorise the tangent, or return None if it is singular.

        Pressures are eliminated element by element, with 1/K at least `_SOFT`. The residual has its
        true value, so the solution is the same, as with the part of the pressure that a tangent
        leaves out. An indefinite tangent is made exact.
        """
        share = 1.0 if exact else _STRESSED
        stiffness, coupling = self._tangents(replace(s, p=share * s.p))
        stiffness += coupling @ self._bulk @ coupling.swapaxes(1, 2)
        bending = self._bending(gaps, share * state.f)
        entries = np.concatenate((stiffness.ravel(), self._springs.data, bending[self._near]))[self._kept]
        leaning = np.zeros((self._count, len(state.f)))
        leaning[self._touched] = gaps.slopes
        leaning = leaning[self._order]
        size, first = len(leaning), 0 if exact else self._first
        forwards: Callable[[FloatArray], FloatArray]
        backwards: Callable[[FloatArray], FloatArray]
        if exact:
            column, below = np.divmod(self._places, self._height)
            lower: Any = sparse.csc_array((entries, (column + below, column)), shape=(size, size))
            whole, how = (lower + sparse.tril(lower, -1).T).tocsc(), {"SymmetricMode": True}
            try:
                forwards = splu(whole, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=_PIVOT, options=how).solve
            except RuntimeError:
                return None
            pushed, backwards = forwards(leaning), np.asarray
        else:
            band = np.bincount(self._places, entries, self._height * size).reshape(size, -1).T
            factor, info = dpbtrf(band, lower=True, overwrite_ab=True)
            if info:
                return self._tangent(s, gaps, state, exact=True)
            forwards, backwards = (partial(_swept, factor, transposed) for transposed in "NT")
            leaning = pushed = _swept(factor[:, first:], "N", leaning[first:])
        compliance = leaning.T @ pushed

        def step(residual: _Vector, f: FloatArray) -> _Vector | None:
            """Step that cancels a residual, or None."""
            swelling = self._bulk @ residual.p.T[..., None]
            force = -residual.u - self._gathered(coupling @ swelling)
            y = forwards(force[self._order])
            forces = self._forces(compliance, residual.f + leaning.T @ y[first:] - compliance @ f, f > 0)
            if forces is None:
                return None
            y[first:] += pushed @ (forces - f)
            u = np.zeros(self._count)
            u[self._order] = backwards(y)
            p = self._bulk @ (coupling.swapaxes(1, 2) @ u[self._dofs][..., None]) + swelling
            taken = _Vector(u, p[..., 0].T, forces)
            return taken if math.isfinite(taken.size) else None

        return step

    def _forces(self, compliance: FloatArray, gaps: FloatArray, closed: BoolArray) -> FloatArray | None:
        """Find forces that close gaps (first `closed`) without pulling, or None."""
        for _ in range(_MOST_SETS):
            f = np.zeros(len(gaps))
            try:
                f[closed] = np.linalg.solve(compliance[np.ix_(closed, closed)], -gaps[closed])
            except np.linalg.LinAlgError:
                return None
            now = np.where(closed, f > 0, gaps + compliance @ f < 0)
            if np.array_equal(now, closed):
                return f
            closed = now
        return None


def _scaled(matrix: Any, factors: FloatArray) -> Any:
    """Multiply each row of a sparse matrix by a factor."""
    data = matrix.data * np.repeat(factors, np.diff(matrix.indptr))
    return sparse.csr_array((data, matrix.indices, matrix.indptr), shape=matrix.shape)


def _swept(factor: FloatArray, transposed: str, right: FloatArray) -> FloatArray:
    """Solve a lower band matrix, or its transpose ("T")."""
    return np.asarray(dtbtrs(factor, right, uplo="L", trans=transposed)[0])


def _on_boundary(basis: Any, dofs: IndexArray, component: int | None = None) -> FloatArray:
    """Functions of a basis, or a component or ∂u_r/∂r, at a boundary's points."""
    facets, points = basis.dx.shape
    place = np.full(basis.N, len(dofs))
    place[dofs] = np.arange(len(dofs))
    found = np.zeros((facets, points, len(dofs) + 1))
    for (value,), at in zip(basis.basis, place[basis.element_dofs], strict=True):
        part = value.grad[0, 0] if component == _STRETCH else value if component is None else value[component]
        found[np.arange(facets)[:, None], np.arange(points), at[:, None]] += np.asarray(part)
    return found[..., :-1].reshape(facets * points, -1)
