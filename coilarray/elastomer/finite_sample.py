"""Sides and uneven seat of a sample: corrected dent and inductance.

With u∞ the displacement of a wide sample on an even, two-sided seat under the pressure of the
contact, the true displacement of a rectangular sample is u∞ + w. In the sample w solves linear
elasticity without load on the top. Its sides take the tractions −σ∞·n that make them free. The
bottom takes the difference between the uneven and the even seat, −(k(x, y) − k0) u∞. All of this is
far from the contact and smooth, so few elements give w (`coilarray.elastomer.box`), and u∞ and σ∞
are exact. A seat that can be lifted off does not pull anywhere. With g the gap of a seat that is
not flat, its pressure is

    k(x, y) max(0, −(u_z + g)).

It is the pressure of the two-sided seat and a traction t = k(x, y) max(0, u_z + g) ≥ 0 that cancels
its pull, found at the nodes of the bottom by a semi-smooth Newton method. The result is the
difference from the sample at rest under its weight.

The indenter keeps its depth h. If w lifts the contact by w̄ on average, the contact is the contact
of a wide sample at the depth h + s with s = w̄ (1 + s F'/F), since far from the contact w depends
on its force F alone (Saint-Venant). `coilarray.response.setup` lifts and tilts the dent with the
sample under it.

The shifts f(x, y) of the magnetic faces by sides and seat are small compared with the thickness, so
that the inductance changes to first order (Hadamard's formula). If a face with μ1 below and μ2
above moves up by f,

    ΔL_ij = μ0 ∫ f [(μ1 − μ2) H_t,i·H_t,j + (1/μ2 − 1/μ1) B_n,i B_n,j] dS

with the fields of the flat sheets, permeabilities relative to μ0 and B in units of μ0. Dents
themselves are solved by `coilarray.elastomer.scattering`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.interpolate import PPoly
from scipy.linalg import cho_factor, cho_solve

from coilarray.compute.arrays import BoolArray, ComplexArray, FloatArray, NumberArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import serial_algebra
from coilarray.constants import MU_0
from coilarray.elastomer.box import Axis, Box, factorised, wide_field
from coilarray.elastomer.contact_grid import graded, stack_of
from coilarray.elastomer.scattering import LayerMesh, wavenumber_rule
from coilarray.electromagnetics.field import Source, as_conductors
from coilarray.electromagnetics.flat_stack import (
    Backing,
    coil_segments,
    flat_profile,
    gradients_on_grid,
    segment_centres,
    segment_spectra,
)
from coilarray.errors import ElastomerError
from coilarray.geometry import EVEN, Seat, Sheet, Unevenness
from coilarray.geometry.elastomer import Base

_ANCHOR = 1e-6  # stress per displacement, in units of the stack, that keeps a sliding sample from drifting
_POINTS = 0.1, 0.2  # spacing of points on a side: thicknesses, or part of the distance to a contact if larger
_PLACES = 400  # at a time, which bounds the memory
_RANK = 1e-5  # of the strongest pattern of the loads of all places: weaker ones are left out, and err by less
_NEWTON_STEPS = 60
_EVENLY = 0.01  # of the distance between two places, by which a third place may be off their line


@dataclass(frozen=True)
class BoxMesh:
    """Elements of a sample, lengths in thicknesses of the stack.

    Elements are as wide as `edge` at the sides, with the `growth` of that width per distance, up to
    `widest`. They are as wide as `beside` next to contacts near a side or over an uneven seat, with
    the growth `spread` per distance of the contacts from these sides. A sheet is one element high.
    """

    degree: int = 3
    edge: float = 0.6
    growth: float = 0.8
    widest: float = 2.0
    beside: float = 0.8
    spread: float = 0.6

    def along(self, low: float, high: float, places: FloatArray, across: float) -> Axis:
        """Elements between two sides, for contacts `across` from the other sides."""
        middle = (low + high) / 2
        reach, beside = float(np.abs(places - middle).max()), self.beside + self.spread * across

        def size(x: float) -> float:
            beyond = max(abs(x - middle) - reach, 0.0)
            return min(self.edge + self.growth * min(x - low, high - x), self.widest, beside + self.growth * beyond)

        half = graded(low, middle, lambda x: max(size(x), self.edge))
        return Axis(np.concatenate((half, (low + high) - half[-2::-1])), self.degree)


# the effect of sides on the responses of gast2020 is accurate to 2 %, by a convergence study
DEFAULT_BOX_MESH = BoxMesh()


@dataclass(frozen=True)
class Sample:
    """Rectangular sample with free sides, `bounds` in m from the map's origin."""

    bounds: tuple[float, float, float, float]
    unevenness: Unevenness = EVEN
    mesh: BoxMesh = field(default=DEFAULT_BOX_MESH)


@dataclass(frozen=True, eq=False)
class SampleCorrection:
    """Correction for a finite sample in m.

    `depth` (depths, places) is the shift s of the depth at which the wide sample is pressed.
    `moved` (depths, places, levels, nx, ny) is w_z at every interface on the nodes of `x` and `y`.
    `lifted` (depths, places, nx, ny) is the distance of the bottom from a seat that can be left.
    `wide` gives u_z of the wide sample (…, depths, levels) at radii (…), in units of `length`.
    """

    x: Axis
    y: Axis
    depth: FloatArray
    moved: FloatArray
    lifted: FloatArray
    wide: PPoly
    length: float

    def at_indenter(self, places: FloatArray, levels: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Mean w_z (depths, places) in m of levels under the indenter, and slopes (…, 2)."""
        mean = self.moved[:, :, list(levels)].mean(axis=2) if len(levels) else 0 * self.moved[:, :, 0]
        (x, dx), (y, dy) = (
            (axis.basis(at), axis.basis(at, 1)) for axis, at in zip((self.x, self.y), places.T, strict=True)
        )
        rise, *slopes = (
            np.einsum("dpxy,px,py->dp", mean, *shapes, optimize=True) for shapes in ((x, y), (dx, y), (x, dy))
        )
        return rise, np.stack(slopes, axis=-1)

    def beyond(self, radii: FloatArray, level: int) -> FloatArray:
        """Displacement u_z of the wide sample at a level, (…, depths) in m."""
        wide = PPoly(np.ascontiguousarray(self.wide.c[..., level]), self.wide.x)
        return self.length * np.asarray(wide(radii / self.length))


@serial_algebra()
def sample_correction(
    sheets: Sequence[Sheet],
    base: Base,
    sample: Sample,
    places: FloatArray,
    r: FloatArray,
    pressure: FloatArray,
    force_slope: FloatArray,
) -> SampleCorrection:
    """Solve a finite sample for contacts at all places.

    The `places` (places, 2) in m count from the origin of the sample's bounds. The `pressure`
    (depths, n) in Pa is linear between distances `r` (n,) from the axis in m. `force_slope`
    (depths,) is F'/F of the contact with its depth, in 1/m.
    """
    problem = _Problem(sheets, base, sample, places, r, pressure)
    depths, count, length = len(pressure), len(places), problem.stack.length
    shape = (depths, count, len(problem.levels_at), *problem.plan)
    require_memory(
        16.0 * float(np.prod(shape)),
        f"a finite sample with {count} positions at {depths} depths",
        "take fewer of them, or leave sample_x_mm and sample_y_mm out for a wide sample",
    )
    depth, moved, lifted = np.zeros((depths, count)), np.zeros(shape), np.zeros((depths, count, *problem.plan))
    slope = force_slope * length
    lift = _Lift(problem) if sample.unevenness.lifts else None
    for start in range(0, count, _PLACES):
        block = slice(start, min(start + _PLACES, count))
        for case in range(depths):
            faces = problem.moved(places[block] / length, case)
            mean = np.einsum("xyp,px,py->p", faces[-1], *problem.ring(places[block], case), optimize=True)
            if lift is None:
                _require_small(mean, slope[case])
                shift = mean / (1 - mean * slope[case])
                moved[case, block] = np.moveaxis(faces * (1 + shift * slope[case]), -1, 0)
            else:
                shift, moved[case, block], lifted[case, block] = lift.solve(
                    places[block], case, faces, mean, float(slope[case])
                )
            depth[case, block] = shift
    x, y = (Axis(axis.edges * length, axis.degree) for axis in problem.box.axes[:2])
    return SampleCorrection(x, y, depth * length, moved * length, lifted * length, problem.upwards, length)


def _require_small(mean: FloatArray, slope: float) -> None:
    if not (mean * slope < 1).all():  # also NaN
        raise ElastomerError(
            f"the seat and sides must change a contact by less than its own depth; one is lifted {mean.max():.3g} "
            "thicknesses."
        )


class _Problem:
    """Sample in units of its stack, factorised, with its loads."""

    def __init__(
        self,
        sheets: Sequence[Sheet],
        base: Base,
        sample: Sample,
        places: FloatArray,
        r: FloatArray,
        pressure: FloatArray,
    ) -> None:
        self.stack = stack = stack_of(sheets)
        self.unevenness = sample.unevenness
        x_min, y_min, x_max, y_max = (edge / stack.length for edge in sample.bounds)
        mesh = sample.mesh
        z = Axis(stack.levels, mesh.degree)
        at, corners = places / stack.length, np.array([[x_min, y_min], [x_max, y_max]])
        from_sides = np.abs(at[:, None] - corners).min(axis=(0, 1))
        even = not any(sample.unevenness.stiffness_slope)
        x = mesh.along(x_min, x_max, at[:, 0], even * float(from_sides[1]))
        y = mesh.along(y_min, y_max, at[:, 1], even * float(from_sides[0]))
        self.plan = len(x.nodes), len(y.nodes)
        self.area = np.outer(x.weights, y.weights)
        self.stiffness, self.factor = self._seat(base, x, y)
        springs = self.stiffness[:, None, None] * self.factor * self.area
        springs[:2] += _ANCHOR * self.area
        held = np.zeros(3, dtype=bool)
        if not isinstance(base, Seat):
            held[:] = base == "bonded", base == "bonded", True
        self.box: Box = factorised((x, y, z), stack.shear, stack.squash, springs, held)
        self.levels_at = np.arange(len(stack.levels)) * mesh.degree
        self._points = max(_POINTS[0], _POINTS[1] * float(from_sides.min()))
        z_points, z_rule = z.rule(self._points)
        self._z = (z_rule[:, None] * z.basis(z_points)).T
        heights, inside = np.concatenate((z_points, stack.levels)), len(z_points)
        extent = np.hypot(*np.abs(at[:, None] - corners).max(axis=(0, 1)))
        radii, scaled = r / stack.length, pressure / stack.stress
        moved, stress = wide_field(stack, base, radii, scaled, heights, float(extent) * 1.01 + 1)
        self.upwards = _part(moved, np.s_[1, :, inside:])
        self._stress = [_part(stress, np.s_[:, case, :inside]) for case in range(len(scaled))]
        self._bottom = [_part(moved, np.s_[:, case, inside]) for case in range(len(scaled))]
        first, third = (np.trapezoid(scaled * radii**power, radii, axis=1) for power in (1, 3))
        self._ring = np.sqrt(third / np.where(first > 0, first, 1.0))

    def _seat(self, base: Base, x: Axis, y: Axis) -> tuple[FloatArray, FloatArray]:
        """Stiffness (3,) of the even seat, and its factor at nodes."""
        length, uneven = self.stack.length, self.unevenness
        along_x, along_y = (slope * length for slope in uneven.stiffness_slope)
        factor = 1 + along_x * x.nodes[:, None] + along_y * y.nodes
        if not isinstance(base, Seat):
            if uneven != EVEN:
                raise ElastomerError(f"an uneven or lifting seat must be a Seat; got the base {base!r}.")
            return np.zeros(3), factor
        if not factor.min() > 0:  # also NaN
            raise ElastomerError(
                f"the stiffness of a seat must be positive on the whole sample; its slope of "
                f"{uneven.stiffness_slope} per m takes it to {factor.min():.3g} of that at the origin."
            )
        unit = length / self.stack.stress
        return np.array([base.shear, base.shear, base.stiffness]) * unit, factor

    def faces(self, displacement: FloatArray) -> FloatArray:
        """w_z at every level, shape (levels, nx, ny, cases)."""
        return np.moveaxis(displacement[:, 2][:, :, self.levels_at], 2, 0)

    def moved(self, places: FloatArray, case: int) -> FloatArray:
        """Vertical w_z at levels under a pressure, (levels, nx, ny, places).

        The loads of many places are sums of few patterns, which are solved.
        """
        loads = self.loads(places, case).reshape(-1, len(places))
        loaded = np.flatnonzero(loads.any(axis=1))
        sizes, patterns = np.linalg.eigh(loads[loaded].T @ loads[loaded])
        patterns = patterns[:, sizes > _RANK**2 * max(sizes[-1], np.finfo(float).tiny)]
        few = np.zeros((len(loads), patterns.shape[1]))
        few[loaded] = loads[loaded] @ patterns
        return np.asarray(self.faces(self.box.displacements(few.reshape(*self.box.shape, -1))) @ patterns.T)

    def ring(self, places: FloatArray, case: int) -> tuple[FloatArray, FloatArray]:
        """Weights along x and y of a smooth function's mean over the contact.

        For a quadratic function it is the mean over four points at the root mean square radius.
        """
        x, y, _ = self.box.axes
        weights = []
        for k, axis in enumerate((x, y)):
            at, offset = places[:, k] / self.stack.length, self._ring[case] / np.sqrt(2)
            weights.append((axis.basis(at - offset) + axis.basis(at + offset)) / 2)
        return weights[0], weights[1]

    def loads(self, places: FloatArray, case: int) -> FloatArray:
        """Nodal loads of w for one pressure, (nx, 3, ny, nz, places)."""
        x, y, _ = self.box.axes
        loads = np.zeros((*self.box.shape, len(places)))
        for plane in (0, -1):
            at, rule = y.rule(self._points)
            traction = self._traction(x.nodes[plane] - places[:, 0], at - places[:, 1, None], case, across=0)
            force = np.einsum("cpqz,qn,zm->cnmp", traction, rule[:, None] * y.basis(at), self._z.T, optimize=True)
            loads[plane] += force if plane == 0 else -force
            at, rule = x.rule(self._points)
            traction = self._traction(at - places[:, 0, None], y.nodes[plane] - places[:, 1], case, across=1)
            force = np.einsum("cpqz,qn,zm->ncmp", traction, rule[:, None] * x.basis(at), self._z.T, optimize=True)
            loads[:, :, plane] += force if plane == 0 else -force
        if (self.factor != 1).any():
            more = (self.factor - 1) * self.area
            loads[:, :, :, 0] -= (
                self.stiffness[None, :, None, None] * more[:, None, :, None] * self.bottom(places, case)
            )
        return loads

    def _traction(self, dx: FloatArray, dy: FloatArray, case: int, across: int) -> FloatArray:
        """Traction σ∞ on a plane across an axis, (3, places, points, heights)."""
        dx, dy = np.broadcast_arrays(dx[:, None] if dx.ndim == 1 else dx, dy[:, None] if dy.ndim == 1 else dy)
        r = np.hypot(dx, dy)
        radial, hoop, shear = np.moveaxis(np.asarray(self._stress[case](r)), 2, 0)
        cos, sin = (dx / r)[..., None], (dy / r)[..., None]
        mixed = (radial - hoop) * cos * sin
        if across == 0:
            return np.array([radial * cos**2 + hoop * sin**2, mixed, shear * cos])
        return np.array([mixed, radial * sin**2 + hoop * cos**2, shear * sin])

    def bottom(self, places: FloatArray, case: int) -> FloatArray:
        """Displacement u∞ at the nodes of the bottom, (nx, 3, ny, places)."""
        x, y, _ = self.box.axes
        dx = x.nodes[:, None, None] - places[:, 0]
        dy = y.nodes[None, :, None] - places[:, 1]
        r = np.hypot(dx, dy)
        along, up = np.moveaxis(np.asarray(self._bottom[case](r)), -1, 0)
        safe = np.where(r > 0, r, 1.0)
        return np.stack([along * dx / safe, along * dy / safe, up], axis=1)


def _part(spline: PPoly, which: tuple[int | slice, ...]) -> PPoly:
    return PPoly(np.ascontiguousarray(spline.c[:, :, *which]), spline.x)


class _Lift:
    """Seat that only pushes, its bottom's response, and its rest."""

    def __init__(self, problem: _Problem) -> None:
        self._problem = problem
        nx, ny = problem.plan
        require_memory(
            16.0 * len(problem.levels_at) * (nx * ny) ** 2,
            f"a seat that can lift under a sample of {nx} by {ny} nodes",
            "take smaller sample_x_mm and sample_y_mm",
        )
        x, y, _ = problem.box.axes
        along_x, along_y = problem.unevenness.gap_slope
        self._gap = np.maximum(along_x * x.nodes[:, None] + along_y * y.nodes, 0.0).ravel()
        self._push = (problem.stiffness[2] * problem.factor * problem.area).ravel()
        own = ny // 2 + 1 if problem.box.mirrored else ny  # forces above the middle follow by symmetry
        answers = []
        for row in range(nx):  # of nodes of the bottom, with a unit force upwards on each in turn
            forces = np.zeros((*problem.box.shape, own))
            forces[row, 2, range(own), 0, range(own)] = 1.0
            found = problem.faces(problem.box.displacements(forces))
            answers.append(np.concatenate((found, found[:, :, ::-1, ny - own - 1 :: -1][..., : ny - own]), axis=-1))
        self._answers = np.concatenate(answers, axis=-1).reshape(-1, nx * ny, nx * ny)  # levels, node, forced node
        root = np.sqrt(self._push)
        self._scaled = root[:, None] * self._answers[0] * root
        weight = problem.unevenness.weight / problem.stack.stress
        loads = np.zeros((*problem.box.shape, 1))
        loads[:, 2, :, -1, 0] = -weight * problem.area
        loads[:, 2, :, 0, 0] = -(self._push * self._gap).reshape(nx, ny)
        self._start = problem.faces(problem.box.displacements(loads))[0, ..., 0].ravel()
        nothing = self._rest = np.zeros(nx * ny)
        _, self._rest, self._height = self._settled(nothing, nothing, 0.0, 0.0, self._start + self._gap)

    def _settled(
        self, own: FloatArray, under: FloatArray, mean: float, slope: float, guess: FloatArray
    ) -> tuple[float, FloatArray, FloatArray]:
        """Shift of the depth, traction t, and u_z plus gap.

        On a two-sided seat the bottom would be at `own` times the load beside the state at rest,
        and the contact lifted by `mean` times the load. `under` is its lift by the tractions at the
        nodes. While the same nodes are lifted, t is linear in the load 1 + s F'/F, and s = a + b (1
        + s F'/F). Newton's steps go from one set of nodes to another, first where the `guess` of
        u_z plus gap is positive.
        """
        linear, lifted = np.column_stack((self._start + self._gap, own)), guess > 0
        root = np.sqrt(self._push)
        for _ in range(_NEWTON_STEPS):
            at = np.flatnonzero(lifted)
            inner = np.eye(len(at)) - self._scaled[np.ix_(at, at)]
            factors = cho_factor(inner, lower=True, overwrite_a=True, check_finite=False)
            pulls = root[at, None] * cho_solve(factors, root[at, None] * linear[at], check_finite=False)
            at_rest, per_load = under[at] @ pulls + (-under @ self._rest, mean)
            shift = float((at_rest + per_load) / (1 - per_load * slope))
            load = np.array([1.0, 1 + shift * slope])
            traction = np.zeros(len(own))
            traction[at] = pulls @ load
            height = linear @ load + self._answers[0] @ traction
            before, lifted = lifted, height > 0
            if (lifted == before).all():
                _require_small(np.array(per_load), slope)
                return shift, traction, height
        raise ElastomerError("a sample on a seat that can lift must find its rest; it needs more weight on the seat.")

    def solve(
        self, places: FloatArray, case: int, faces: FloatArray, mean: FloatArray, slope: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Shift (places,), w_z (places, levels, nx, ny) and lift (places, nx, ny)."""
        problem = self._problem
        wide = problem.bottom(places / problem.stack.length, case)[:, 2].reshape(-1, len(places))
        along_x, along_y = problem.ring(places, case)
        shifts, tractions = np.empty(len(places)), []
        heights: list[FloatArray] = []
        for p in range(len(places)):
            under = np.outer(along_x[p], along_y[p]).ravel() @ self._answers[-1]
            own = wide[:, p] + faces[0, ..., p].ravel()
            guess = self._expected(places[: p + 1], heights)
            shifts[p], traction, height = self._settled(own, under, float(mean[p]), slope, guess)
            tractions.append(traction - self._rest)
            heights.append(height)
        more = self._answers @ np.transpose(tractions)
        moved = faces * (1 + shifts * slope) + more.reshape(faces.shape)
        lifts = np.maximum(heights, 0.0).reshape(-1, *problem.plan)
        return shifts, np.moveaxis(moved, -1, 0), lifts

    def _expected(self, places: FloatArray, heights: list[FloatArray]) -> FloatArray:
        """Guess of u_z plus gap from one or two earlier places."""
        if not heights:
            return self._height
        *before, here = places
        near = int(np.hypot(*(before - here).T).argmin())
        beyond = np.hypot(*(before + here - 2 * places[near]).T)
        far = int(beyond.argmin())
        evenly = beyond[far] < _EVENLY * np.hypot(*(places[near] - here))
        return 2 * heights[near] - heights[far] if evenly else heights[near]


_STEP = 1e-6  # of a difference in heights, over the shortest wavelength
_SPACING = 0.5  # of the points of the integral, in heights of the lowest magnetic face
_FADED = 2.5  # thicknesses of the stack beyond the sample where the wide sample's displacement is still subtracted
_FAINT = 1e-4  # of its largest displacement, below which the wide sample counts as at rest
_SHIFTED_AT_ONCE = 64  # at a time, which bounds the memory


def shift_inductance(
    source: Source,
    sheets: Sequence[Sheet],
    correction: SampleCorrection,
    places: FloatArray,
    origin: tuple[float, float],
    mesh: LayerMesh,
    backing: Backing | None = None,
) -> ComplexArray:
    """Change ΔL − jΔR/ω by a sample's shifts in H, (depths, places, coils, coils)."""
    count = len(as_conductors(source))
    pairs = np.triu_indices(count)
    own, other = (np.eye(count)[numbers] for numbers in pairs)
    change = shift_energy(source, sheets, correction, places, origin, mesh, own, other, backing)
    full = np.zeros((*change.shape[:2], count, count), dtype=np.complex128)
    full[..., pairs[0], pairs[1]] = full[..., pairs[1], pairs[0]] = change
    return full


def shift_energy(
    source: Source,
    sheets: Sequence[Sheet],
    correction: SampleCorrection,
    places: FloatArray,
    origin: tuple[float, float],
    mesh: LayerMesh,
    own: NumberArray,
    other: NumberArray,
    backing: Backing | None = None,
) -> ComplexArray:
    """Change iᵀ ΔL j by a sample's shifts, (depths, places, n).

    It is in H per A² of i and j (n, coils). The `places` in m count from the map's `origin` on the
    board. Outside the sample the shift removes the wide sample's displacement.
    """
    depths, count, levels = correction.moved.shape[:3]
    mu = (1.0, *(sheet.relative_permeability for sheet in sheets), 1.0)
    faces = [face for face in range(levels) if mu[face] != mu[face + 1]]
    coils = coil_segments(source)
    seen = [coils] if backing is None else backing.seen(coils)
    if backing is not None:
        own, other = (each @ backing.currents(len(coils)).T for each in (own, other))
    change = np.zeros((depths, count, len(own)), dtype=np.complex128)
    if not faces:
        return change
    thicknesses = [sheet.thickness for sheet in sheets]
    heights = np.concatenate(([0.0], np.cumsum(thicknesses)))[faces]
    beyond = _FADED * sum(thicknesses)
    (x, wx, inside_x), (y, wy, inside_y) = (
        _points(axis, beyond, _SPACING * float(heights[0])) for axis in (correction.x, correction.y)
    )
    centres, radius = segment_centres(seen[0])
    centres = centres - origin
    extent = float(np.hypot(*(np.array([x[[0, -1]], y[[0, -1]]])[:, None] - centres.T[..., None])).max()) + radius
    wavenumbers, weights = wavenumber_rule(float(heights[0]), extent, mesh.coarser())
    step = _STEP / wavenumbers[-1]
    at, above = (flat_profile(wavenumbers, heights + up, thicknesses, mu[1:-1]) for up in (0.0, step))
    on_grid = x + origin[0], y + origin[1], weights
    fields: NumberArray
    if backing is None:
        fields = gradients_on_grid(segment_spectra(coils, wavenumbers), *on_grid, at, (above - at) / step)
    else:
        fields = np.zeros((len(centres), 3, len(faces), len(x), len(y)), dtype=np.complex128)
        for images, arriving in zip(seen, backing.arriving(wavenumbers, thicknesses, mu[1:-1]), strict=True):
            profiles, slopes = (
                np.concatenate((values * arriving.real, values * arriving.imag)) for values in (at, (above - at) / step)
            )
            both = gradients_on_grid(segment_spectra(images, wavenumbers), *on_grid, profiles, slopes)
            fields += both[:, :, : len(faces)] + 1j * both[:, :, len(faces) :]

    shapes_x, shapes_y = correction.x.basis(x[inside_x]), correction.y.basis(y[inside_y])
    outside = ~(inside_x[:, None] & inside_y)
    at_x, at_y = (grid[outside] for grid in np.meshgrid(x, y, indexing="ij"))
    for number, face in enumerate(faces):
        H = fields[:, :, number]
        along, across = MU_0 * (mu[face] - mu[face + 1]), MU_0 * (1 / mu[face + 1] - 1 / mu[face]) * mu[face + 1] ** 2
        one, two = (np.tensordot(currents, H, axes=1) for currents in (own, other))
        density = along * (one[:, :2] * two[:, :2]).sum(axis=1) + across * one[:, 2] * two[:, 2]
        density *= wx[:, None] * wy
        within = np.ascontiguousarray(density[:, inside_x][:, :, inside_y])
        nodal = shapes_x.T @ within @ shapes_y
        change += correction.moved[:, :, face].reshape(depths, count, -1) @ nodal.reshape(len(own), -1).T
        known = correction.wide.x * correction.length
        size = np.abs(correction.beyond(known, face)).max(axis=1)
        end = float(known[np.flatnonzero(size >= _FAINT * size.max())[-1]])  # beyond it the sample is still
        lost = density[:, outside].T
        for start in range(0, count, _SHIFTED_AT_ONCE):
            block = slice(start, start + _SHIFTED_AT_ONCE)
            r = np.hypot(at_x - places[block, 0, None], at_y - places[block, 1, None])
            wide, near = np.zeros((depths, *r.shape)), r < end
            wide[:, near] = correction.beyond(r[near], face).T
            change[:, block] -= wide @ lost
    return change


def _points(axis: Axis, beyond: float, spacing: float) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Points and weights to `beyond` both ends, and a mask inside."""
    inner, inner_weights = axis.rule(spacing)
    node, rule = leggauss(int(np.ceil(beyond / spacing)) + 2)
    step, rule = beyond * (node + 1) / 2, beyond * rule / 2
    low, high = axis.edges[0], axis.edges[-1]
    points = np.concatenate((low - step[::-1], inner, high + step))
    weights = np.concatenate((rule[::-1], inner_weights, rule))
    return points, weights, (points > low) & (points < high)
