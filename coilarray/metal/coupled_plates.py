"""Finite plates between infinite layers: images, coils' field, matrices.

Reflection and transmission by infinite plates and sheets are taken as images of currents between
the layers. A source is at the height s in one gap of air and a place at z in the same or a higher
gap. z_l is the lower face of the lower gap and z_u the upper face of the upper gap. Waves leave the
source upwards or downwards and arrive from below or from above, by the ways

    2 z_u − s − z,   s + z − 2 z_l,   z − s,   2 (z_u − z_l) + s − z,

the first two by an odd number of reflections, as from a mirror image of the source, the last two by
an even number. In a single gap the third is 2 (z_u − z_l) + z − s, as the direct wave is not
included. Each way has the weight w(k) e^{−k·way}. With ρ_u and ρ_l the reflections at the faces of
the source's gap of height D, w contains 1/(1 − ρ_u ρ_l e^{−2kD}) for all waves that go up and down
in it. A sum Σ c e^{−2kd} with a few real distances d approximates w. These are images farther away
by 2d, real for currents of any shape in any body. Horizontal currents keep their direction in every
image, vertical currents reverse in mirror images.

The positions of a plate parallel to the board share a few heights. Where the coils' field in air is
smooth enough, far from the copper, it is interpolated on a grid by splines of the fifth order.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.interpolate import NdBSpline, make_interp_spline
from scipy.linalg import block_diag, lu_factor, lu_solve

from coilarray.compute.arrays import ComplexArray, FloatArray, IntArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import ranges, run_blocks
from coilarray.electromagnetics.field import as_conductors, magnetic_field
from coilarray.electromagnetics.flat_stack import Layer, layer_waves, with_gaps
from coilarray.errors import MetalError
from coilarray.geometry import Conductor, Plate, Sheet
from coilarray.geometry.bodies import TOUCHING, FinitePlate
from coilarray.metal.flat_plates import layers_apart
from coilarray.metal.half_body import MIRROR, EddyBody, SurfaceImpedance, inductance, pair_integrals

_DIGITS = 14.0  # −ln of the amplitude of the shortest waves that are included
_LONGEST = 0.1  # radians across all bodies, longer waves carry 1e-4 of a coupling
_WAVES = 120  # of a fit
_TOLERANCE = 2e-4  # of the largest wave
_RATIOS = (math.inf, 4.0, 2.8, 2.0, 1.6, 1.3)  # of the distances (inf for a single image)
_SMALLEST = 1e-7  # singular value of a fit
_LEFT_OUT = 5e-5  # of the largest wave: weaker images are left out
_NOTHING = 1e-6  # of the unobstructed wave: passes a thick plate, and acts by its square


@dataclass(frozen=True, eq=False)
class Image:
    """Image at `sign` times the height plus `offset` in m, shares (f,)."""

    sign: int
    offset: float
    shares: ComplexArray

    def of(self, points: FloatArray) -> FloatArray:
        """Images in m of points (..., 3)."""
        return points * [1.0, 1.0, self.sign] + [0.0, 0.0, self.offset]

    @property
    def back(self) -> Image:
        """Same image with source and place exchanged."""
        return self if self.sign < 0 else Image(self.sign, -self.offset, self.shares)


ITSELF = Image(1, 0.0, np.ones(1, dtype=np.complex128))  # the source itself, in air


@dataclass(frozen=True, eq=False)
class LayeredAir:
    """Infinite layers, faces (n, 2) in m, air between, frequencies in Hz."""

    layers: tuple[Layer, ...]
    faces: FloatArray
    frequencies: FloatArray

    @classmethod
    def between(cls, plates: Sequence[Plate], sheets: Sequence[Sheet], frequencies: FloatArray) -> LayeredAir:
        """Combine plates and sheets from z = 0, which may not overlap."""
        bodies = layers_apart(plates, sheets)
        faces = np.array([body[:2] for body in bodies]).reshape(-1, 2)
        return cls(tuple(body[2] for body in bodies), faces, frequencies)

    def gap(self, low: float, high: float, what: str) -> int:
        """Find the gap that contains all heights in m, or raise MetalError."""
        number = int((self.faces[:, 0] < (low + high) / 2).sum())
        floor, roof = self.gap_faces(number)
        if low < floor - TOUCHING or high > roof + TOUCHING:
            raise MetalError(
                f"{what} must lie between infinite plates and magnetic sheets, not in them; it reaches from "
                f"{low * 1e3:.4g} to {high * 1e3:.4g} mm and the faces next to it lie at {floor * 1e3:.4g} and "
                f"{roof * 1e3:.4g} mm."
            )
        return number

    def gap_faces(self, number: int) -> tuple[float, float]:
        """Heights in m of a gap's faces, infinite without a body."""
        floor = self.faces[number - 1, 1] if number else -math.inf
        return float(floor), float(self.faces[number, 0]) if number < len(self.faces) else math.inf

    def images(self, source: tuple[int, float, float], place: tuple[int, float, float], extent: float) -> list[Image]:
        """Find the images of a source without the source itself.

        `source` and `place` are gap, least and greatest height in m, `extent` is horizontal, in m.
        """
        if not self.layers:
            return []
        if source[0] > place[0]:
            return [image.back for image in self.images(place, source, extent)]
        floor, roof = self.gap_faces(source[0])[0], self.gap_faces(place[0])[1]
        same = source[0] == place[0]
        through = 2 * (roof - floor)
        nearest = max(place[1] - source[2], 0.0)
        ways = (  # shortest way, sign, offset, and the direction of images farther away
            (2 * roof - source[2] - place[2], -1, 2 * roof, 1),
            (source[1] + place[1] - 2 * floor, -1, 2 * floor, -1),
            (through + place[1] - source[2] if same else nearest, 1, -through if same else 0.0, -1),
            (through + source[1] - place[2], 1, through, 1),
        )
        found = []
        for number, (way, sign, offset, outwards) in enumerate(ways):
            if math.isinf(way):
                continue
            shortest = max(way, TOUCHING)
            k = np.geomspace(_LONGEST / (extent + shortest), _DIGITS / shortest, _WAVES)
            weights = self.weights(k, source[0], place[0])[number]
            for distance, shares in _fitted(k, weights, shortest, extent):
                found.append(Image(sign, offset + outwards * 2 * distance, shares))
        return found

    def weights(self, k: FloatArray, source: int, place: int) -> tuple[ComplexArray, ...]:
        """Weights (f, k) of the four ways between gaps."""
        omega = 2 * np.pi * self.frequencies[:, None]
        floor, roof = self.gap_faces(source)
        up, down = (layer_waves(self._outwards(source, up=side), k, omega) for side in (True, False))
        trip = np.exp(-2 * k * (roof - floor)) if math.isfinite(roof - floor) else 0.0
        again = 1 / (1 - up.reflection * down.reflection * trip)
        if source == place:
            both = up.reflection * down.reflection * again
            return up.reflection * again, down.reflection * again, both, both
        start = self.gap_faces(place)[0]
        edges = roof + np.cumsum([0.0, *(layer.thickness for layer in up.layers)])
        number = int(np.abs(edges - start).argmin())
        out = up.faces[number]
        back = np.zeros_like(out)
        if number < len(up.layers):
            r = up.beyond[number]
            out = out / (1 + r * np.exp(-2 * k * up.layers[number].thickness))
            back = out * r
        passed = (1 + up.reflection) * again * np.exp(k * (start - roof))
        return passed * back, passed * out * down.reflection, passed * out, passed * back * down.reflection

    def _outwards(self, gap: int, *, up: bool) -> tuple[Layer, ...]:
        """Layers outwards from a gap, with the air between them."""
        floor, roof = self.gap_faces(gap)
        if up:
            return with_gaps(list(zip(self.faces[gap:, 0].tolist(), self.layers[gap:], strict=True)), roof)
        inner = (-self.faces[:gap, 1][::-1]).tolist()
        return with_gaps(list(zip(inner, self.layers[:gap][::-1], strict=True)), -floor)


def _fitted(k: FloatArray, weights: ComplexArray, way: float, extent: float) -> list[tuple[float, ComplexArray]]:
    """Distances in m and shares (f,) of images for weights (f, k)."""
    # two loops couple by the square of the wave that both see, and less for waves beyond the extent
    counted = np.exp(-k * way) * np.minimum(k * (extent + way), 1.0) ** 2
    wanted = weights * counted
    largest = np.abs(wanted).max()
    allowed = max(_TOLERANCE * largest, _NOTHING * counted.max())
    if largest <= allowed:
        return []
    for ratio in _RATIOS:
        count = 0 if math.isinf(ratio) else math.ceil(math.log(4 * k[-1] / k[0]) / math.log(ratio))
        distances = np.array([0.0, *np.geomspace(0.5 / k[-1], 2 / k[0], count)])
        waves = np.exp(-2 * np.outer(k, distances)) * counted[:, None]
        shares = np.linalg.lstsq(waves, wanted.T, rcond=_SMALLEST)[0]
        if np.abs(waves @ shares - wanted.T).max() <= allowed:
            break
    else:
        raise MetalError(
            f"the reflection by infinite plates and magnetic sheets must be a sum of images to {_TOLERANCE:g}; "
            f"{count} images of a source {way * 1e3:.4g} mm away by reflection, {extent * 1e3:.4g} mm wide, err by "
            f"{np.abs(waves @ shares - wanted.T).max() / largest:.2g}: move plates with an outline farther away from "
            "them."
        )
    strengths = np.abs(shares).max(axis=1) * np.abs(waves).max(axis=0)
    return [
        (distance, share)
        for distance, share, strength in zip(distances.tolist(), shares, strengths.tolist(), strict=True)
        if strength > _LEFT_OUT * largest
    ]


ONE_IMAGE = np.ones((1, 1))  # weights of one image
_STEP = 0.25  # step of the grid over its height above the copper, with an error of some 1e-5 of the field
_MARGIN = 4  # steps of the grid beyond the places
_AT_ONCE = 16384  # places of the splines per task
_IMAGES_AT_ONCE = 2**17  # places in all images together
_SAME_HEIGHT = 1e-9  # of the height
_POINTS_AT_ONCE = 2**18  # of the field, which bounds the memory
_LOOPS_AT_ONCE = 64  # places of dipoles
# loops of two by two about x, y and z
_SQUARE = np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0]])
_SQUARES = np.array([np.roll(_SQUARE, k, axis=1) for k in (1, 2, 0)])


def _field_of_images(
    paths: Sequence[Conductor], places: FloatArray, offsets: FloatArray, images: Sequence[Image], weights: FloatArray
) -> Callable[[FloatArray], FloatArray]:
    """Field B in T of 1 A in each path's images, a function of points (n, 3) in m.

    Its shape is (n, sums, paths, 3), the sums with `weights` (sums, images). The points are at
    `offsets` (k, 3) in m from `places` (n, 3). Heights of many points have splines.
    """
    corners = np.concatenate([path.vertices for path in paths])
    top, bottom = float(corners[:, 2].max()), float(corners[:, 2].min())
    heights = (places[:, None, 2] + offsets[:, 2]).ravel()
    unit = _SAME_HEIGHT * float(np.abs(heights).max())
    levels, first, counts = np.unique(np.round(heights / unit), return_index=True, return_counts=True)
    low = places[:, :2].min(axis=0) + offsets[:, :2].min(axis=0)
    high = places[:, :2].max(axis=0) + offsets[:, :2].max(axis=0)
    splines = {}
    for k in np.flatnonzero(counts > 2 * (2 * _MARGIN) ** 2):  # the smallest grid
        place = np.array([0.0, 0.0, heights[first[k]]])
        seen = [float(image.back.of(place)[2]) for image in images]
        step = _STEP * min(max(z - top, bottom - z) for z in seen)
        if np.prod((high - low) / step + 2 * _MARGIN) > 0.5 * counts[k]:
            continue
        x, y = (
            start + step * np.arange(-_MARGIN, math.ceil((end - start) / step) + _MARGIN + 1)
            for start, end in zip(low.tolist(), high.tolist(), strict=True)
        )
        grid = np.stack(np.meshgrid(x, y, place[2:], indexing="ij"), axis=-1).reshape(-1, 3)
        values = _summed(paths, grid, images, weights).reshape(len(x), len(y), -1)
        along = make_interp_spline(x, values, k=5)
        both = make_interp_spline(y, along.c.swapaxes(0, 1), k=5)
        splines[levels[k]] = NdBSpline((along.t, both.t), np.ascontiguousarray(both.c.swapaxes(0, 1)), 5)

    def field(points: FloatArray) -> FloatArray:
        level_of = np.round(points[:, 2] / unit)
        total = np.zeros((len(points), len(weights), len(paths), 3))
        direct = ~np.isin(level_of, list(splines))
        for level, spline in splines.items():
            here = np.flatnonzero(level_of == level)
            if len(here):
                pieces = [points[here[start:stop], :2] for start, stop in ranges(len(here), _AT_ONCE)]
                total[here] = np.concatenate(run_blocks(spline, pieces)).reshape(len(here), *total.shape[1:])
        if direct.any():
            total[direct] = _summed(paths, points[direct], images, weights)
        return total

    return field


def _summed(paths: Sequence[Conductor], points: FloatArray, images: Sequence[Image], weights: FloatArray) -> FloatArray:
    """Sum B in T over all segments and images, (n, sums, paths, 3)."""
    total = np.zeros((len(points), len(weights), len(paths), 3))
    # B is an axial vector
    turned = np.array([[image.sign, image.sign, 1.0] for image in images])[:, None]
    for start, stop in ranges(len(points), max(_IMAGES_AT_ONCE // len(images), 1)):
        # the field of an image at a place is the mirrored field of the path at the mirrored place
        seen = np.stack([image.back.of(points[start:stop]) for image in images])
        for number, path in enumerate(paths):
            B = np.tensordot(weights, magnetic_field(path, seen) * turned, axes=1)
            total[start:stop, :, number] = B.swapaxes(0, 1)
    return total


@dataclass(frozen=True, eq=False)
class PosedPlate:
    """Plate at centres (places, 3) in m, with impedances by frequency."""

    body: EddyBody
    plate: FinitePlate
    where: FloatArray
    impedances: Sequence[SurfaceImpedance]

    @cached_property
    def corners(self) -> FloatArray:
        """Corners in m of all triangles at the first place."""
        upper = self.body.mesh.corners
        return np.ascontiguousarray(np.concatenate((upper, upper * MIRROR)) @ self.plate.axes + self.where[0])

    @cached_property
    def currents(self) -> list[sp.csr_array]:
        """K along the board's axes for unit unknowns, even ones first, each (2k, u)."""
        even, odd = self.body.parities
        parts = []
        for K, mirror in zip(self.body.currents, MIRROR, strict=True):
            one, two = K @ even.unknowns, K @ odd.unknowns
            parts.append(sp.block_array([[one, two], [mirror * one, -mirror * two]], format="csr"))
        return [sum(self.plate.axes[own, axis] * parts[own] for own in range(3)) for axis in range(3)]


@dataclass(frozen=True, eq=False)
class EddyCurrents:
    """Currents on the faces and the rim of a plate.

    `density` (coils, k, 3) in A/m is for 1 A in each coil, on triangles with `corners` (k, 3, 3) in
    m on the board. The current of a thin plate is the sum over its faces. The current of a magnetic
    plate is the current in its skin, n × H.
    """

    corners: FloatArray
    density: ComplexArray


@dataclass(frozen=True, eq=False)
class SolvedPlates:
    """Finite non-magnetic plates, solved together for coils.

    They have the factors of their matrices, by frequency, and fluxes b (f, unknowns, 1, paths) in
    Wb/A.
    """

    around: PlatesInAir
    plates: Sequence[PosedPlate]
    factors: Sequence[tuple[ComplexArray, IntArray]]
    b: ComplexArray

    def change(self) -> ComplexArray:
        """Return the change of the inductance matrix (f, paths, paths) in H."""
        found = [
            -np.tensordot(b[:, 0].T, lu_solve(factors, b[:, 0], check_finite=False), axes=1)
            for factors, b in zip(self.factors, self.b, strict=True)
        ]
        both = np.array(found)
        return np.asarray((both + both.swapaxes(-1, -2)) / 2)

    def eddy_currents(self) -> list[list[EddyCurrents]]:
        """Return the currents for 1 A in each coil, by frequency."""
        starts = np.cumsum([0, *(one.currents[0].shape[1] for one in self.plates)]).tolist()
        found = []
        for factors, b in zip(self.factors, self.b, strict=True):
            potentials = -lu_solve(factors, b[:, 0], check_finite=False)
            currents = []
            for plate, (start, stop) in zip(self.plates, itertools.pairwise(starts), strict=True):
                density = np.stack([(K @ potentials[start:stop]).T for K in plate.currents], axis=-1)
                currents.append(EddyCurrents(plate.corners, density))
            found.append(currents)
        return found

    def returned(self, places: FloatArray, size: float) -> ComplexArray:
        """Return the field in T reflected to dipoles of 1 A·m², (n, f, 3, 3).

        The dipoles are square loops of a `size` in m at one height, along the board's axes.
        """
        found = []
        for start, stop in ranges(len(places), _LOOPS_AT_ONCE):
            loops = [place + size / 2 * square for place in places[start:stop] for square in _SQUARES]
            around = replace(self.around, paths=as_conductors(loops))
            b = np.concatenate([around.linked([one])[0][:, :, 0] for one in self.plates], axis=1) / size**2
            b = b.reshape(*b.shape[:2], -1, 3)
            parts = [
                -np.einsum("upa,upb->pab", own, lu_solve(factors, own.reshape(len(own), -1)).reshape(own.shape))
                for factors, own in zip(self.factors, b, strict=True)
            ]
            found.append(np.stack(parts, axis=1))
        return np.concatenate(found)


@dataclass(frozen=True, eq=False)
class PlatesInAir:
    """Coils and plates in the air between infinite layers."""

    paths: Sequence[Conductor]
    air: LayeredAir

    def __post_init__(self) -> None:
        self.air.gap(*self._coils, "the coils")

    def solved(self, plates: Sequence[PosedPlate]) -> SolvedPlates:
        """Solve plates together."""
        sizes = [one.currents[0].shape[1] for one in plates]
        starts = np.cumsum([0, *sizes]).tolist()
        count, frequencies = starts[-1], len(self.air.frequencies)
        require_memory(32.0 * frequencies * count**2, f"plates of {count} unknowns", "use a coarser mesh")
        whole = np.zeros((frequencies, count, count), dtype=np.complex128)
        for k, one in enumerate(plates):
            own = slice(starts[k], starts[k + 1])
            whole[:, own, own] = self.matrices(one)
            for m in range(k):
                other = slice(starts[m], starts[m + 1])
                whole[:, other, own] = self.mutual(plates[m], one)
                whole[:, own, other] = whole[:, other, own].swapaxes(1, 2)

        def factorised(matrix: ComplexArray) -> tuple[ComplexArray, IntArray]:
            factors, pivots = lu_factor(matrix, overwrite_a=True, check_finite=False)
            return factors, pivots.astype(np.int64)

        b = np.concatenate([self.linked([one])[0] for one in plates], axis=1)
        return SolvedPlates(self, plates, run_blocks(factorised, whole), b)

    def matrices(self, plate: PosedPlate) -> ComplexArray:
        """Matrices (f, u, u) in H of a plate with its reflections at the layers."""
        blocks = ([parity.matrix(one) for parity in plate.body.parities] for one in plate.impedances)
        own = np.array([block_diag(*both) for both in blocks], dtype=np.complex128)  # real in perfect conductors
        images = self.images_of(plate, plate)
        if not images:
            return own
        weights, number = distinct_sums(images)
        sums = np.zeros((len(weights), *own.shape[1:]))
        for image, shares in zip(images, weights.T, strict=True):
            integrals = pair_integrals(plate.corners, image.of(plate.corners), mirrored=image.sign < 0)
            M = inductance(plate.currents, integrals, np.array([1.0, 1.0, image.sign]))
            for row in np.flatnonzero(shares):
                sums[row] += shares[row] * M
        sums = (sums + sums.swapaxes(1, 2)) / 2
        for k, (real, imaginary) in enumerate(zip(*np.split(number, 2), strict=True)):
            own[k].real += sums[real]
            own[k].imag += sums[imaginary]
        return own

    def mutual(self, one: PosedPlate, other: PosedPlate) -> ComplexArray:
        """Mutual inductance of two plates in H, (f, u, v)."""
        images = self.images_of(other, one)
        if self._gap(one)[0] == self._gap(other)[0]:
            images.append(Image(1, 0.0, np.ones(len(self.air.frequencies), dtype=np.complex128)))
        sizes = (one.currents[0].shape[1], other.currents[0].shape[1])
        total = np.zeros((len(self.air.frequencies), *sizes), dtype=np.complex128)
        for image in images:
            integrals = pair_integrals(one.corners, image.of(other.corners))
            M = inductance(one.currents, integrals, np.array([1.0, 1.0, image.sign]), other.currents)
            total += image.shares[:, None, None] * M
        return total

    def linked(self, meshes: Sequence[PosedPlate]) -> list[ComplexArray]:
        """Fluxes (f, u, places, paths) in Wb/A of the coils in meshes of a plate."""
        plate = meshes[-1]
        images = self.images_of_coils(plate)
        counts = [sum(parity.unknowns.shape[1] for parity in one.body.parities) for one in meshes]
        frequencies = len(self.air.frequencies)
        shapes = [(frequencies, count, len(plate.where), len(self.paths)) for count in counts]
        require_memory(32.0 * sum(map(math.prod, shapes)), f"a plate at {len(plate.where)} places", "compute fewer")
        if not images:  # behind a plate that no wave passes
            return [np.zeros(shape, dtype=np.complex128) for shape in shapes]
        weights, number = distinct_sums(images)
        used = weights.any(axis=1)
        real, imaginary = np.split(number, 2)
        alike = not (np.ptp(real) or np.ptp(imaginary))  # at all frequencies, as for sheets
        every = []
        every_flux = linked_fluxes(meshes, self.paths, images, weights[used])
        for shape, fluxes in zip(shapes, every_flux, strict=True):
            b = np.zeros((len(weights), *shape[1:]))
            b[used] = np.concatenate(fluxes, axis=1)
            found = np.empty((1 if alike else frequencies, *shape[1:]), dtype=np.complex128)
            for k, total in enumerate(found):
                total.real, total.imag = b[real[k]], b[imaginary[k]]
            every.append(np.broadcast_to(found, shape))
        return every

    def groups(self, where: FloatArray) -> list[IntArray]:
        """Group places (n, 3) in m by height, or take all together in air."""
        if not self.air.layers:
            return [np.arange(len(where))]
        _, number = np.unique(np.round(where[:, 2] / (_SAME_HEIGHT * np.abs(where[:, 2]).max())), return_inverse=True)
        return [np.flatnonzero(number == k) for k in range(number.max() + 1)]

    def images_of_coils(self, plate: PosedPlate) -> list[Image]:
        """Images of coils, and visible coils, as a plate sees."""
        low, high = self._coils
        gap, place = self.air.gap(low, high, "the coils"), self._gap(plate)
        images = self.air.images((gap, low, high), place, self._wide(plate))
        if gap == place[0]:
            images.append(Image(1, 0.0, np.ones(len(self.air.frequencies), dtype=np.complex128)))
        return images

    @cached_property
    def _coils(self) -> tuple[float, float]:
        heights = np.concatenate([path.vertices[:, 2] for path in self.paths])
        return float(heights.min()), float(heights.max())

    def _gap(self, plate: PosedPlate) -> tuple[int, float, float]:
        low, high = float(plate.corners[..., 2].min()), float(plate.corners[..., 2].max())
        return self.air.gap(low, high, f"plate {plate.plate.name!r}"), low, high

    def images_of(self, source: PosedPlate, place: PosedPlate) -> list[Image]:
        """Images of a plate's currents as a plate sees them."""
        wide = max(self._wide(source), self._wide(place))
        return self.air.images(self._gap(source), self._gap(place), wide)

    def _wide(self, plate: PosedPlate) -> float:
        """Greatest horizontal distance in m between coils and a plate anywhere."""
        points = np.concatenate([path.vertices[:, :2] for path in self.paths])
        moved = plate.where[:, :2] - plate.where[0, :2]
        low, high = plate.corners.min(axis=(0, 1))[:2], plate.corners.max(axis=(0, 1))[:2]
        ends = np.array([points.min(axis=0), points.max(axis=0), low + moved.min(axis=0), high + moved.max(axis=0)])
        return float(np.hypot(*np.ptp(ends, axis=0)))


def distinct_sums(images: Sequence[Image]) -> tuple[FloatArray, IntArray]:
    """Distinct real weights of images, (sums, images), and their numbers.

    The numbers are of the real, then the imaginary parts. Sheets alone reflect alike at all f.
    """
    shares = np.array([image.shares for image in images]).T
    parts = np.concatenate((shares.real, shares.imag))
    weights, number = np.unique(parts, axis=0, return_inverse=True)
    return weights, number.ravel()


def linked_fluxes(
    meshes: Sequence[PosedPlate],
    paths: Sequence[Conductor],
    images: Sequence[Image] = (ITSELF,),
    weights: FloatArray = ONE_IMAGE,
) -> list[tuple[FloatArray, FloatArray]]:
    """Fluxes b (sums, u, positions, paths) of even and odd unknowns, in Wb/A.

    They are for several meshes of a plate with the same points.
    """
    bodies, where = [one.body for one in meshes], meshes[-1].where
    count = sum(parity.unknowns.shape[1] for body in bodies for parity in body.parities)
    values = 2.0 * count * len(where) * len(paths) * len(weights)
    require_memory(8.0 * values, f"a plate at {len(where)} places", "compute fewer")
    return loads_of([body.linked for body in bodies], meshes[-1], paths, images, weights)


def loads_of(
    functions: Sequence[Callable[[FloatArray], tuple[FloatArray, FloatArray]]],
    posed: PosedPlate,
    paths: Sequence[Conductor],
    images: Sequence[Image],
    weights: FloatArray,
) -> list[tuple[FloatArray, FloatArray]]:
    """Apply functions to B in T along the plate's axes, two arrays (sums, u, places, paths) each.

    B (fields, points, 3) is at the body's points, by images of 1 A in the paths, for as many places
    at once as memory allows.
    """
    plate, where = posed.plate, posed.where
    offsets = posed.body.points @ plate.axes
    field = _field_of_images(paths, where, offsets, images, weights)
    parts: list[list[list[FloatArray]]] = [[] for _ in functions]
    for start, stop in ranges(len(where), max(_POINTS_AT_ONCE // (len(offsets) * len(weights)), 1)):
        points = (where[start:stop, None] + offsets).reshape(-1, 3)
        B = field(points).reshape(stop - start, len(offsets), len(weights), len(paths), 3)
        # the component of a point at all places is contiguous, because the sums run over the points
        along = np.ascontiguousarray(B.transpose(4, 1, 2, 0, 3)).reshape(3, len(offsets), -1)
        fields = (along if plate.tilt == 0 else np.tensordot(plate.axes, along, axes=1)).T
        for function, of in zip(functions, parts, strict=True):
            loads = (b.reshape(len(b), len(weights), -1, len(paths)) for b in function(fields))
            of.append([np.moveaxis(b, 1, 0) for b in loads])
    joined = ([np.concatenate(each, axis=2) for each in zip(*of, strict=True)] for of in parts)
    return [(one, other) for one, other in joined]
