"""A soft layered body under large deformations, pressed by a rigid body: nearly incompressible neo-Hookean sheets.

With F the deformation gradient, J = det F and p a pressure that jumps from element to element, the stationary point of

    Π = ∫ (μ/2 (J^(−2/3) F:F − 3) + p (J − 1) − p²/2K) w + ½ uᵀ springs u − Σ_j f_j G_j

under G_j ≥ 0, f_j ≥ 0, f_j G_j = 0, where the mean gap over hat j at the place to which its points have moved is

    G_j = ∫ψ_j (outline(r + u_r) − depth − u_z) w dr / ∫ψ_j w dr.

The derivative of G_j by u is normal to the indenter: the contact has no friction. For small u this is
`coilarray.elastomer.elasticity` under `coilarray.elastomer.contact`. Newton's method, whose contact set is where
c f_j > G_j (a semi-smooth Newton method), goes from depth to depth.

P. Wriggers, Nonlinear Finite Element Methods, Springer 2008, sections 3.3.1
(material) and 10.4 (mixed elements); M. Hintermüller, K. Ito, K. Kunisch, SIAM J. Optim. 13 (2002) 865 (contact set).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.linalg.lapack import dgbtrf, dgbtrs
from skfem import BilinearForm, LinearForm

from coilarray.elastomer.contact_grid import ContactGrid, hoop_strain, linear_pressures, quadrature_weights, weight
from coilarray.errors import ElastomerError
from coilarray.geometry import Cone, CylinderEdge, FlatPunch, Hemisphere, Indenter, Paraboloid

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]

EDGE = 0.05
"""Sharp edges, which would cut the sheet, are rounded with this part of the radius: it costs about as much of a punch's
force."""
EDGE_ELEMENTS = 10
"""Most elements across a contact with such an edge: those at the edge are then a fifth of its rounding."""
TIP = 0.05
"""A cone's point is blunted over this part of the contact radius, which takes about 0.1 % of the force."""

_STEEPEST = math.radians(80)  # beyond this slope the side of an indenter goes on straight
_MOST_STEPS = 16  # of Newton's method at one depth
_LEAST_DAMPING = 1 / 64
_CONVERGED = 1e-7  # of the depth: the last step, whose square is what is left
_LEAST_STEP = 1 / 64  # of the way from one depth to the next
_FARTHEST_AHEAD = 1.5  # steps to which the last one is continued
_MOST_TRIALS = 16  # steps of that way, taken or not
_SOFT = 1e-5  # 1/K that the tangent has at least: what it leaves of a volume error in one step
_PRESSURES = 3  # 1, ξ and η in every element


@dataclass(frozen=True)
class Outline:
    """An indenter's height above its tip, its slope and its curvature at any radius, in a unit of length.

    `tip` is the radius over which a cone's point is blunted: under a sharp one the strain has no bound.
    """

    indenter: Indenter
    unit: float
    tip: float = 0.0

    def __call__(self, r: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Height, slope and second derivative at radii `r`; smooth beyond the end of the indenter."""
        body = self.indenter
        start, radius = math.inf, 1.0  # of the arc in which the side rises
        height, slope, bend = np.zeros_like(r), np.zeros_like(r), np.zeros_like(r)
        if isinstance(body, Hemisphere | CylinderEdge):
            start, radius = 0.0, body.radius / self.unit
        elif isinstance(body, FlatPunch | Cone) and math.isfinite(body.radius):
            radius = EDGE * body.radius / self.unit
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
    """State of the body at a depth: displacement `u` (n,), pressures `p` (3, elements), forces on the hats `f` (m,)."""

    depth: float
    u: FloatArray
    p: FloatArray
    f: FloatArray

    def moved(self, step: _Vector, share: float) -> Pressed:
        """Return the state after a share of a step."""
        return replace(self, u=self.u + share * step.u, p=self.p + share * step.p, f=self.f + share * step.f)

    def towards(self, depth: float, before: Pressed) -> Pressed:
        """Continue to a depth on the line through the state before; the state itself where that says little of it."""
        share = (depth - self.depth) / (self.depth - before.depth) if before.depth else math.inf
        if share > _FARTHEST_AHEAD:
            return self
        ahead = _Vector(self.u - before.u, self.p - before.p, self.f - before.f)
        return self.moved(ahead, share)


@dataclass(frozen=True, eq=False)
class _Vector:
    """A step or a residual of all unknowns: displacement (n,), pressures (3, elements), forces or gaps (m,)."""

    u: FloatArray
    p: FloatArray
    f: FloatArray

    @property
    def size(self) -> float:
        """Largest displacement."""
        return float(np.abs(self.u).max())


_Tangent = Callable[[_Vector], _Vector | None]
"""The step that cancels a residual; None where there is none."""


@dataclass(frozen=True, eq=False)
class _Gaps:
    """Mean gaps G (m,), their derivatives by u (n, m), and the second derivative of the outline above each point."""

    mean: FloatArray
    slopes: Any
    bend: FloatArray


@dataclass(frozen=True, eq=False)
class _Strained:
    """Deformation at the quadrature points (elements, points): F as its 5 entries, J, ∂ln J/∂F, μ J^(−2/3), p."""

    F: FloatArray
    D: FloatArray
    J: FloatArray
    g: FloatArray
    a: FloatArray
    p: FloatArray


class SoftBody:
    """A meshed stack for large deformations under one indenter."""

    def __init__(self, grid: ContactGrid, outline: Outline) -> None:
        self.grid, self.outline = grid, outline
        basis, r = grid.basis, grid.basis.global_coordinates()[0]
        self._count, self._dofs = basis.N, basis.element_dofs
        self._measure, self._local = quadrature_weights(basis, grid.symmetry), linear_pressures(basis)
        # entries rr, rz, zr, zz and the hoop of F for each basis function: (5, functions, elements, points)
        self._strain = np.stack(
            [
                [u.grad[0, 0], u.grad[0, 1], u.grad[1, 0], u.grad[1, 1], hoop_strain(grid.symmetry, u, r)]
                for (u,) in basis.basis
            ],
            axis=1,
        )
        rows = np.ascontiguousarray(self._strain.transpose(2, 3, 0, 1))  # (elements, points, 5, functions)
        self._rows, self._columns = rows, rows.reshape(len(rows), -1, rows.shape[-1]).transpose(0, 2, 1)
        self._squash = grid.squash[:, None]
        local = self._local[:, None, None, :] * self._local[None, :, None, :] * self._measure
        self._pressures = local.sum(axis=-1).transpose(2, 0, 1)  # ∫ p q w of each element
        at = grid.top.global_coordinates()[0]
        self._top = weight(grid.symmetry, at)
        width = np.gradient(grid.radii)
        self._give = width / (grid.mass * grid.shear.max())  # about how far a unit of force pushes a hat

    @cached_property
    def _order(self) -> tuple[IndexArray, IndexArray]:
        """Places of the displacements, −1 where held, and of the hats' forces among the unknowns.

        They are ordered by r and then z, each hat above the top: neighbours are near each other.
        """
        r, z = np.hstack((self.grid.basis.doflocs, [self.grid.radii, np.ones_like(self.grid.radii)])).round(12)
        free = np.setdiff1d(np.arange(len(r)), self.grid.held)
        place = np.full(len(r), -1)
        place[free[np.lexsort((free, z[free], r[free]))]] = np.arange(len(free))
        return place[: self._count], place[self._count :]

    @cached_property
    def _band(self) -> tuple[int, IndexArray, BoolArray]:
        """Half width of the ordered tangent, place of each element's entry in the band, and which are free."""
        (place, hats), grid = self._order, self.grid
        at = place[self._dofs]
        row, column = np.broadcast_arrays(at[:, None], at[None])
        free = (row >= 0) & (column >= 0)
        over = np.full(grid.hats.N, -1)
        over[grid.used] = hats
        moved, pressed = np.broadcast_arrays(place[grid.top.element_dofs][:, None], over[grid.hats.element_dofs])
        coupled = (moved >= 0) & (pressed >= 0)
        wide = max(int((row - column)[free].max()), int(np.abs(moved - pressed)[coupled].max()))
        return wide, (wide + row - column)[free] * self._unknowns + column[free], free

    @property
    def _unknowns(self) -> int:
        """Number of free displacements and forces."""
        return int(max(place.max() for place in self._order)) + 1

    def at_rest(self) -> Pressed:
        """Return the state before contact."""
        elements = self._dofs.shape[1]
        return Pressed(0.0, np.zeros(self._count), np.zeros((_PRESSURES, elements)), np.zeros(len(self.grid.used)))

    def press(self, depths: FloatArray) -> Iterator[Pressed]:
        """Yield the state at each of some rising depths in thicknesses, from one to the next.

        ElastomerError where no step is small enough for Newton's method: the strains are too large for the mesh.
        """
        state = before = self.at_rest()
        for depth in depths:
            whole = step = depth - state.depth
            trials = 0
            while state.depth < depth:
                trials += 1
                to = depth if step >= depth - state.depth else state.depth + step
                start = state.towards(to, before)
                found = self._solved(start, to)
                if found is None and start is not state:
                    found = self._solved(state, to)
                if found is not None:
                    before, state, step = state, found, 2 * step
                elif step < _LEAST_STEP * whole or trials >= _MOST_TRIALS:
                    raise ElastomerError(
                        f"the contact converges up to a depth of {state.depth:.3g} thicknesses of the sheets; "
                        f"it must be less than {depth:.3g}, the mesh finer, or the strain linear."
                    )
                else:
                    step /= 2
            yield state

    def _solved(self, state: Pressed, depth: float) -> Pressed | None:
        """State at a depth by Newton's method; None where it does not converge from the given state.

        A step is halved until what the same tangent says of the next step is shorter: P. Deuflhard, Newton Methods for
        Nonlinear Problems, Springer 2004, section 3.3.
        """
        state = replace(state, depth=depth)
        strained, gaps, touching = self._strained(state), self._gaps(state), None
        for _ in range(_MOST_STEPS):
            if strained is None:
                return None
            new = self._give * state.f > gaps.mean
            state = replace(state, f=np.where(new, state.f, 0.0))
            tangent = self._tangent(strained, gaps, state, new)
            step = None if tangent is None else tangent(self._residual(strained, gaps, state, new))
            if tangent is None or step is None:
                return None
            moved = step.size
            if moved <= _CONVERGED * depth and touching is not None and np.array_equal(new, touching):
                return state.moved(step, 1.0) if (state.f >= 0).all() else None
            touching, damping = new, 1.0
            while True:
                trial = state.moved(step, damping)
                strained = self._strained(trial)
                if strained is not None:
                    gaps = self._gaps(trial)
                    following = tangent(self._residual(strained, gaps, trial, new))
                    if following is not None and following.size <= (1 - damping / 4) * moved:
                        break
                damping /= 2
                if damping < _LEAST_DAMPING:
                    return None
            state = trial
        return None

    def _strained(self, state: Pressed) -> _Strained | None:
        """Deformation in a state; None where an element is turned inside out."""
        F = np.einsum("cieq,ie->ceq", self._strain, state.u[self._dofs], optimize=True)
        F[[0, 3, 4]] += 1
        D = F[0] * F[3] - F[1] * F[2]
        if (D <= 0).any() or (F[4] <= 0).any():
            return None
        J = D * F[4]
        g = np.stack([F[3] / D, -F[2] / D, -F[1] / D, F[0] / D, 1 / F[4]])
        return _Strained(F, D, J, g, self.grid.shear[:, None] * J ** (-2 / 3), state.p.T @ self._local)

    def _residual(self, s: _Strained, gaps: _Gaps, state: Pressed, touching: BoolArray) -> _Vector:
        """∂Π/∂u, ∂Π/∂p and the mean gaps of the touching hats: all are zero in a solution."""
        stress = s.a * (s.F - (s.F**2).sum(axis=0) / 3 * s.g) + s.p * s.J * s.g
        nodal = np.einsum("cieq,ceq->ie", self._strain, stress * self._measure, optimize=True)
        force = np.bincount(self._dofs.ravel(), nodal.ravel(), self._count) + self.grid.springs @ state.u
        volume = self._local @ ((s.J - 1 - self._squash * s.p) * self._measure).T
        return _Vector(force - gaps.slopes @ state.f, volume, np.where(touching, gaps.mean, 0.0))

    def _tangents(self, s: _Strained) -> tuple[FloatArray, FloatArray]:
        """∂²Π/∂u² (elements, functions, functions) and ∂²Π/∂u∂p (elements, functions, 3), without contact."""
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
        acted = np.matmul(H.transpose(2, 3, 0, 1), self._rows)
        stiffness = np.matmul(self._columns, acted.reshape(len(acted), -1, acted.shape[-1]))
        swelling = (s.J * g * self._measure).transpose(1, 2, 0)[:, :, None, :] @ self._rows
        return stiffness, np.matmul(swelling[:, :, 0].transpose(0, 2, 1), self._local.T)

    def _gaps(self, state: Pressed) -> _Gaps:
        """Gaps between the top where it is now and the indenter at its depth."""
        grid = self.grid
        u_r, u_z = np.asarray(grid.top.interpolate(state.u))
        height, slope, bend = self.outline(grid.top.global_coordinates()[0] + u_r)
        weighing = LinearForm(lambda psi, w: psi * w.gap * w.weight)
        leaning = BilinearForm(lambda psi, v, w: (w.slope * v[0] - v[1]) * psi * w.weight)
        mean = weighing.assemble(grid.hats, gap=height - state.depth - u_z, weight=self._top)[grid.used] / grid.mass
        slopes = leaning.assemble(grid.hats, grid.top, slope=slope, weight=self._top).tocsc()[:, grid.used]
        return _Gaps(mean, slopes @ sparse.diags_array(1 / grid.mass), bend)

    def _bending(self, gaps: _Gaps, f: FloatArray) -> Any:
        """−Σ f ∂²G/∂u² (n, n)."""
        grid, nodal = self.grid, np.zeros(self.grid.hats.N)
        nodal[grid.used] = f / grid.mass
        pressure = np.asarray(grid.hats.interpolate(nodal))
        form = BilinearForm(lambda u, v, w: -w.bend * u[0] * v[0] * w.weight)
        return form.assemble(grid.top, bend=pressure * gaps.bend, weight=self._top)

    def _tangent(self, s: _Strained, gaps: _Gaps, state: Pressed, touching: BoolArray) -> _Tangent | None:
        """Factorise the tangent; None where it is singular. Pressures are eliminated element by element.

        In the tangent 1/K is at least `_SOFT`, in the residual it is what it is: the solution is the same.
        """
        stiffness, coupling = self._tangents(s)
        inverse = np.linalg.inv(np.maximum(self._squash, _SOFT)[..., None] * self._pressures)
        stiffness += np.matmul(np.matmul(coupling, inverse), coupling.transpose(0, 2, 1))
        (wide, places, free), (place, hats), n = self._band, self._order, self._unknowns
        band = np.zeros((3 * wide + 1, n))  # LAPACK wants room for the pivoting above
        band[wide:] = np.bincount(places, stiffness.transpose(1, 2, 0)[free], (2 * wide + 1) * n).reshape(-1, n)

        def add(rows: IndexArray, columns: IndexArray, values: FloatArray) -> None:
            inside = (rows >= 0) & (columns >= 0)
            rows, columns = rows[inside], columns[inside]
            np.add.at(band, (2 * wide + rows - columns, columns), values[inside])

        springs = (self.grid.springs + self._bending(gaps, state.f)).tocoo()
        add(place[springs.row], place[springs.col], springs.data)
        slopes = gaps.slopes.multiply(touching).tocoo()
        add(place[slopes.row], hats[slopes.col], -slopes.data)
        add(hats[slopes.col], place[slopes.row], slopes.data)  # closed gaps: G + ∂G/∂u du = 0
        add(hats, hats, np.where(touching, 0.0, 1.0))
        factors, pivots, info = dgbtrf(band, wide, wide, overwrite_ab=True)
        if info:
            return None

        def step(residual: _Vector) -> _Vector | None:
            swelling = np.matmul(inverse, residual.p.T[..., None])
            nodal = np.matmul(coupling, swelling)[..., 0].T
            force = -residual.u - np.bincount(self._dofs.ravel(), nodal.ravel(), self._count)
            right = np.zeros(n)
            right[place[place >= 0]], right[hats] = force[place >= 0], -residual.f
            found = dgbtrs(factors, wide, wide, right, pivots)[0]
            u = np.where(place >= 0, found[place], 0.0)
            p = np.matmul(inverse, np.matmul(coupling.transpose(0, 2, 1), u[self._dofs].T[..., None]))
            taken = _Vector(u, (p + swelling)[..., 0].T, found[hats])
            return taken if math.isfinite(taken.size) else None

        return step
