"""Infinite plates by plane waves: inductance, eddy currents and field.

The reflections, and the images of the short waves of a plate near the copper, are in
docs/theory/metal.md, "Infinite plates". The images have the cross-section of the bars, and the
remainder is integrated.

Field and currents on grids follow from the vertical flux density b of every plane wave
(`coilarray.electromagnetics.flat_stack`). B along the layers is ∇(b'/k²). The induced field is E =
ẑ × ∇(jω b/k²), so that the current through a layer is K = ẑ × ∇ψ, ψ = jωσ/k² ∫ b dz.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.linalg import qr

from coilarray.compute.arrays import ComplexArray, FloatArray, NumberArray
from coilarray.compute.threads import Progress
from coilarray.constants import MU_0
from coilarray.electromagnetics.field import Source, as_conductors, grid_points, magnetic_field
from coilarray.electromagnetics.flat_layer import (
    Board,
    board_below,
    mirrored,
    reflected_inductance,
    require_below,
    top_of,
    wavenumbers,
)
from coilarray.electromagnetics.flat_stack import (
    Layer,
    Segments,
    coil_segments,
    gradients_on_grid,
    layer_waves,
    mirrored_segments,
    segment_spectra,
    wave_count,
    wave_rule,
    with_gaps,
)
from coilarray.electromagnetics.inductance import mutual_inductance
from coilarray.electromagnetics.neumann import Accuracy
from coilarray.errors import GeometryError, MetalError
from coilarray.geometry import Conductor, Plate, Pose, Sheet
from coilarray.geometry.bodies import TOUCHING
from coilarray.metal.frequencies import checked_frequencies

# −ln of the error of the rules over the spectrum, and the largest error of the images' sum against
# the reflection
_DIGITS: dict[Accuracy, float] = {"full": 16.0, "screen": 8.0}
_FIT: dict[Accuracy, float] = {"full": 3e-5, "screen": 1e-4}
_LONGEST = 1e-3  # radians across the board, longer waves carry 1e-10 of the inductance
_AROUND = 160.0  # radians across the board, the integral takes longer waves and images take shorter waves
_FITTED, _SMALLEST = 200, 1e-7  # waves of a fit, and its smallest singular values
_RATIO = 1.15  # ratio of the distances among which the distances of images are chosen
_DECAYS = 12.0  # decay lengths of the fields at the highest wavenumber, which leaves out 6e-6
_MOST_WAVENUMBERS = 1500
_PERFECT = 1e16  # S/m, for a perfect conductor: at 1 kHz its skin depth is 0.2 µm


def layer_of(plate: Plate) -> Layer:
    """Return a plate as an infinite layer."""
    return Layer(plate.thickness, plate.material.relative_permeability, plate.material.conductivity)


def _sheet_layers(sheets: Sequence[Sheet]) -> list[tuple[float, Layer]]:
    """Lower faces in m and layers of sheets from z = 0."""
    heights = itertools.accumulate((sheet.thickness for sheet in sheets), initial=0.0)
    return [(z, Layer(one.thickness, one.relative_permeability)) for z, one in zip(heights, sheets, strict=False)]


def layers_apart(plates: Sequence[Plate], sheets: Sequence[Sheet]) -> list[tuple[float, float, Layer]]:
    """Order plates and magnetic sheets by height, with faces in m."""
    bodies = [(*plate.heights, layer_of(plate), f"plate {plate.name!r}") for plate in plates]
    bodies += [
        (low, low + layer.thickness, layer, f"sheet {sheet.name!r}")
        for (low, layer), sheet in zip(_sheet_layers(sheets), sheets, strict=True)
        if sheet.magnetic
    ]
    bodies.sort(key=lambda body: body[0])
    for (low, high, _, one), (start, _, _, other) in itertools.pairwise(bodies):
        if start < high - TOUCHING:
            raise GeometryError(
                f"plates and magnetic sheets must not overlap; {one} lies from z = {low:g} to {high:g} m and {other} "
                f"begins at {start:g} m."
            )
    return [body[:3] for body in bodies]


def plate_inductance(
    source: Source,
    plates: Sequence[Plate],
    frequencies: npt.ArrayLike,
    sheets: Sequence[Sheet] = (),
    *,
    accuracy: Accuracy = "full",
) -> ComplexArray:
    """Change of the inductance matrix by infinite plates, in H.

    The result (f, paths, paths) is the change of the impedance over jω relative to the `sheets`
    alone, ΔL − jΔR/ω, symmetric. Add it to the inductance in air and to
    `coilarray.electromagnetics.flat_layer.layer_inductance`. The paths of the `source` lie between
    the `plates`, each above or below all of them, and below the sheets upwards from z = 0. The
    `frequencies` (f,) in Hz are at least 0. The `accuracy` is that of
    `coilarray.inductance_matrix`, where ``screen`` errs by up to 1e-3 of the change itself. Raises
    GeometryError for a plate that touches the paths, another plate or a magnetic sheet,
    ElastomerError for a path that reaches into a magnetic sheet or above it, and MetalError for
    other frequencies.

    The current density is uniform in every bar, and open ends stay open, as in `layer_inductance`.
    Otherwise the result is exact at any frequency, to 5e-6 of the largest entry. A plate nearer
    than a sixth of the board's extent costs up to thirty times a `mutual_inductance` more.

    An aluminium plate of 1 mm, 2 mm above a square loop.

    >>> from coilarray.geometry import MATERIALS
    >>> square = [[0, 0, 0], [2e-2, 0, 0], [2e-2, 2e-2, 0], [0, 2e-2, 0], [0, 0, 0]]
    >>> change = plate_inductance([square], [Plate("target", 2e-3, 1e-3, MATERIALS["aluminium"])], [1e6])
    >>> print(f"{change[0, 0, 0].real * 1e9:.2f} nH")
    -16.26 nH
    """
    return np.asarray(plate_inductances(source, [plates], frequencies, sheets, accuracy=accuracy)[0])


def plate_inductances(
    source: Source,
    cases: Sequence[Sequence[Plate]],
    frequencies: npt.ArrayLike,
    sheets: Sequence[Sheet] = (),
    *,
    accuracy: Accuracy = "full",
    progress: Progress | None = None,
) -> ComplexArray:
    """Compute `plate_inductance` for cases of plates, (cases, f, paths, paths).

    The spectra of the paths, which cost most, are computed once.
    """
    paths = as_conductors(source)
    omega = 2 * np.pi * checked_frequencies(frequencies)
    shape = (len(cases), len(omega), len(paths), len(paths))
    if not any(cases):
        return np.zeros(shape, dtype=np.complex128)
    around = _Around(paths, cases, sheets, omega)
    boards = [replace(board, digits=_DIGITS[accuracy]) for board in around.boards(paths, accuracy)]
    extent, highest = boards[0].extent, boards[0].digits / around.nearest
    lifts, shares, split = _images(around, min(_AROUND / extent, highest), highest, extent, _FIT[accuracy])
    k, steps = np.array(wavenumbers(boards[0], around.lowest(split, extent), split, around.nearest)).T
    weights = around.weights(k)
    change: ComplexArray = np.zeros((len(weights), 1, 1), dtype=np.complex128)
    if shares is not None:
        weights = weights - shares @ np.exp(-2 * np.outer(lifts, k))
        used = list(zip(*np.nonzero(shares.any(axis=0)), strict=True))
        for done, (pair, number) in enumerate(used):
            images = around.images(paths, pair, lifts[number])
            mutual = mutual_inductance(paths, images, accuracy=accuracy)
            change = change + shares[:, pair, number, None, None] * mutual
            if progress is not None:
                progress(done + 1, 2 * len(used))
    weights = weights * around.damping(k) * steps
    first = 0 if shares is None else 1
    rest = None if progress is None else lambda done, total: progress(first * total + done, (1 + first) * total)
    change = (change + reflected_inductance(boards, k.tolist(), weights, progress=rest)).reshape(shape)
    return np.asarray((change + change.swapaxes(-1, -2)) / 2)


@dataclass(frozen=True)
class Stack:
    """Layers outwards from a face in m, away from coils."""

    face: float
    layers: tuple[Layer, ...]

    def reflection(self, k: FloatArray, omega: FloatArray, distance: float) -> ComplexArray:
        """Reflected part of waves (f, n) at a distance in m from the face."""
        if not self.layers:
            return np.zeros((len(omega), len(k)), dtype=np.complex128)
        return layer_waves(self.layers, k, omega[:, None]).reflection * np.exp(-2 * k * distance)


class _Around:
    """Surroundings of the paths above and below, in every case of plates.

    The paths lie between `bottom` and `top` in m. Each of the cases has a stack above and a stack
    below. `sheets` is the stack above without plates. Waves are counted from the `faces` on the
    `sides` that hold anything in any case (0 above, 1 below). The kinds of waves are the sides to
    which they leave a path and from which they finally reach a path: up–up (0, 0), up–down (0, 1),
    which includes down–up, and down–down (1, 1).
    """

    def __init__(
        self, paths: Sequence[Conductor], cases: Sequence[Sequence[Plate]], sheets: Sequence[Sheet], omega: FloatArray
    ) -> None:
        top, bottom = max(map(top_of, paths)), -max(top_of(mirrored(path, 0.0)) for path in paths)
        gaps = []
        for plate in itertools.chain(*cases):
            low, high = plate.heights
            gaps.append(low - top if low + high > top + bottom else bottom - high)
            if gaps[-1] <= 0:
                raise GeometryError(
                    f"plate {plate.name!r} must lie above all paths, from z = {top:g} m, or below them, up to "
                    f"{bottom:g} m; it lies from {low:g} to {high:g} m."
                )
        for plates in cases:
            layers_apart(plates, sheets)
        self.sheets = _above((), sheets, top)
        for path in paths:
            require_below(path, self.sheets.face)
        self.top, self.bottom, self.nearest, self.omega = top, bottom, 2 * min(gaps), omega
        self.stacks = [(_above(plates, sheets, top), stack_below(plates, top)) for plates in cases]
        self.faces = min(above.face for above, _ in self.stacks), max(below.face for _, below in self.stacks)
        sides = [side for side, face in enumerate(self.faces) if math.isfinite(face)]
        self.sides, self.kinds = sides, list(itertools.combinations_with_replacement(sides, 2))

    @property
    def ways(self) -> FloatArray:
        """Shortest length in m of each kind of waves."""
        across = self.faces[0] - self.faces[1]
        ways = {(0, 0): 2 * (self.faces[0] - self.top), (1, 1): 2 * (self.bottom - self.faces[1])}
        return np.array([ways.get(kind, 2 * across - (self.top - self.bottom)) for kind in self.kinds])

    def damping(self, k: FloatArray) -> FloatArray:
        """Decay of each kind of waves from face to face, (kinds, k)."""
        distances = [self.faces[0] - self.faces[1] if kind == (0, 1) else 0.0 for kind in self.kinds]
        return np.asarray(np.exp(-np.outer(distances, k)))

    def boards(self, paths: Sequence[Conductor], accuracy: Accuracy) -> list[Board]:
        """Paths below the upper face, and mirrored at the lower."""
        return [
            board_below(paths, self.faces[0], accuracy)
            if side == 0
            else board_below([mirrored(path, 0.0) for path in paths], -self.faces[1], accuracy)
            for side in self.sides
        ]

    def images(self, paths: Sequence[Conductor], kind: int, lift: float) -> list[Conductor]:
        """Images of the paths for a kind of waves, twice the lift away."""
        up, down = self.faces
        match self.kinds[kind]:
            case (0, 0):
                return [mirrored(path, up + lift) for path in paths]
            case (1, 1):
                return [mirrored(path, down - lift) for path in paths]
        return [path.posed(Pose(z=2 * (up - down + lift)), f"image of {path.name}") for path in paths]

    def lowest(self, highest: float, extent: float) -> float:
        """Smallest wavenumber in 1/m at which the reflection changes.

        Poles: −jωμ0σd/2 of a thin plate, −ln((μ + 1)/(μ − 1))/d of an iron plate.
        """
        slowest = float(self.omega[self.omega > 0].min(initial=math.inf))
        scales = [highest / 8]
        for layer in {layer for case in self.stacks for stack in case for layer in stack.layers}:
            scales.append(0.5 / layer.thickness)
            if layer.permeability > 1:
                scales.append(math.log1p(2 / (layer.permeability - 1)) / layer.thickness)
            if layer.conductivity:
                scales.append(slowest * MU_0 * layer.conductivity * layer.thickness / 2)
        return max(min(scales), _LONGEST / extent)

    def weights(self, k: FloatArray) -> ComplexArray:
        """Weights (cases · f, kinds, k) of returning waves, without the `damping`."""
        up, down = self.faces
        by_sheets = self.sheets.reflection(k, self.omega, self.sheets.face - up)
        cases = []
        for above, below in self.stacks:
            r_u = above.reflection(k, self.omega, above.face - up)
            r_l = below.reflection(k, self.omega, down - below.face)
            trip = np.exp(-2 * k * (up - down)) if len(self.sides) == 2 else 0.0
            again = r_u * r_l * trip
            parts = {(0, 0): r_u - by_sheets + by_sheets * again, (0, 1): 2 * r_u * r_l, (1, 1): r_l}
            cases.append(np.stack([parts[kind] / (1 - again) for kind in self.kinds], axis=1))
        return np.concatenate(cases)


def _above(plates: Sequence[Plate], sheets: Sequence[Sheet], top: float) -> Stack:
    """Sheets and plates above the paths, upwards."""
    return _stacked([*_sheet_layers(sheets), *((plate.z, layer_of(plate)) for plate in plates if plate.z >= top)])


def stack_below(plates: Sequence[Plate], top: float = 0.0) -> Stack:
    """Return the plates below a height in m, downwards."""
    stack = _stacked([(-plate.heights[1], layer_of(plate)) for plate in plates if plate.z < top])
    return Stack(-stack.face, stack.layers)


def _stacked(layers: Sequence[tuple[float, Layer]]) -> Stack:
    """Combine layers by their faces in m with the air between."""
    found = sorted(
        ((z, layer) for z, layer in layers if layer.permeability != 1 or layer.conductivity), key=lambda one: one[0]
    )
    if not found:
        return Stack(math.inf, ())
    return Stack(found[0][0], with_gaps(found, found[0][0]))


def _images(
    around: _Around, split: float, highest: float, extent: float, tolerance: float
) -> tuple[FloatArray, ComplexArray | None, float]:
    """Distances in m and shares of images for short waves.

    The shares (cases · f, kinds, distances) hold for waves from `split` to `highest` in 1/m, the
    third result is the wavenumber from which they hold to the `tolerance`. They are None if the
    integral takes all waves. Every image costs a `mutual_inductance`, so the fewest are chosen, in
    the order of a QR factorisation with pivots.
    """
    ways, every = around.ways, np.geomspace(1 / extent, highest, _FITTED)
    largest = np.abs(around.weights(every) * np.exp(-np.outer(ways, every))).max(axis=(1, 2))
    while split < highest:
        k = np.geomspace(split, highest, _FITTED)
        wanted = around.weights(k) * np.exp(-np.outer(ways, k))
        needed = np.flatnonzero((np.abs(wanted).max(axis=2) > tolerance * largest[:, None]).any(axis=0)).tolist()
        count = math.ceil(math.log(4 * highest / split) / math.log(_RATIO))
        lifts = np.array([0.0, *np.geomspace(0.5 / highest, 2 / split, count)])
        waves = {kind: np.exp(-2 * np.outer(k, lifts) - ways[kind] * k[:, None]) for kind in needed}
        order = qr(waves[min(needed, key=ways.__getitem__)], mode="r", pivoting=True)[1] if needed else np.zeros(0, int)
        for few in range(1, len(order) + 1):
            chosen = np.sort(order[:few])
            shares = np.zeros((*wanted.shape[:2], few), dtype=np.complex128)
            error = np.zeros(len(wanted))
            for kind in needed:
                images = waves[kind][:, chosen]
                shares[:, kind] = np.linalg.lstsq(images, wanted[:, kind].T, rcond=_SMALLEST)[0].T
                error = np.maximum(error, np.abs(shares[:, kind] @ images.T - wanted[:, kind]).max(axis=1))
            if (error <= tolerance * largest).all():
                return lifts[chosen], shares, split
        split *= 2
    return np.zeros(0), None, highest


def _layers(
    plates: Sequence[Plate], sheets: Sequence[Sheet], lowest: float
) -> tuple[tuple[Layer, ...], tuple[Layer, ...]]:
    """Layers upwards from z = 0, and downwards from the lowest copper in m."""
    bodies = [(plate.z, layer_of(plate)) for plate in plates]
    bodies = [(z, replace(layer, conductivity=min(layer.conductivity, _PERFECT))) for z, layer in bodies]
    bodies += _sheet_layers(sheets)
    above = [body for body in bodies if body[0] >= 0]
    below = [(lowest - low - layer.thickness, layer) for low, layer in bodies if low < 0]
    up, down = (with_gaps(sorted(side, key=lambda body: body[0]), 0.0) for side in (above, below))
    return up, down


class _Waves:
    """Waves of coils and their reflections between both sides, summed on a grid.

    The Gauss–Legendre nodes `k` reach to `highest` in 1/m. `up` and `down` are the layers above
    z = 0 and below the lowest copper.
    """

    def __init__(
        self,
        segments: Sequence[Segments],
        currents: npt.ArrayLike,
        sides: tuple[Sequence[Layer], Sequence[Layer]],
        frequency: float,
        highest: float,
        x: FloatArray,
        y: FloatArray,
    ) -> None:
        points, ends = np.concatenate([one.start for one in segments]), np.array([x[[0, -1]], y[[0, -1]]])
        low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
        extent = float(np.hypot(*np.maximum(ends[:, 1] - low, high - ends[:, 0])))  # from place to coil
        count = wave_count(highest, extent)
        if count > _MOST_WAVENUMBERS:
            raise MetalError(
                f"B at {_DECAYS / highest * 1e3:.3g} mm from the coils on {extent * 1e3:.4g} mm would need {count} "
                f"wavenumbers; {_MOST_WAVENUMBERS} are allowed: choose points farther from the board."
            )
        self.k, self._weights = wave_rule(highest, count)
        self._x, self._y = x, y
        self.up, self.down = (layer_waves(side, self.k, 2 * np.pi * frequency) for side in sides)
        amount, lowest = np.asarray(currents, dtype=np.complex128), float(points[:, 2].min())
        carrying = [one for one, current in zip(segments, amount.tolist(), strict=True) if current]
        self._coils = carrying, mirrored_segments(carrying, lowest / 2)
        self._currents = amount[amount != 0]
        self._between = np.exp(self.k * lowest)  # e^{−kD} between both reference planes

    def on_grid(
        self,
        above: bool,
        profiles: Sequence[ComplexArray] | ComplexArray,
        slopes: NumberArray,
        free: tuple[FloatArray, FloatArray] | None = None,
    ) -> ComplexArray:
        """Sum the waves with profiles over height, (3, n, nx, ny).

        The result is ∇ along the plane of the waves times `profiles` and the waves times `slopes`,
        each (n, k), less `free`, per unit of b at the side's first face.
        """
        own, other = (self.up, self.down) if above else (self.down, self.up)
        mine = (1 + own.reflection) / (1 - own.reflection * other.reflection * self._between**2)
        total = np.zeros((3, len(profiles), len(self._x), len(self._y)), dtype=np.complex128)
        for to_side, amplitude in ((True, mine), (False, mine * other.reflection * self._between)):
            along, across = np.asarray(profiles) * amplitude, slopes * amplitude
            if to_side and free is not None:
                along, across = along - free[0], across - free[1]
            if not (along.any() or across.any()):
                continue
            spectra = segment_spectra(self._coils[0 if to_side == above else 1], self.k)
            both = [np.concatenate((one.real, one.imag)) for one in (along, across)]
            real, imaginary = np.split(gradients_on_grid(spectra, self._x, self._y, self._weights, *both), 2, axis=2)
            total += np.tensordot(self._currents, real + 1j * imaginary, axes=1)
        return total


def plate_currents(
    source: Source,
    currents: npt.ArrayLike,
    plates: Sequence[Plate],
    frequency: float,
    x: FloatArray,
    y: FloatArray,
    sheets: Sequence[Sheet] = (),
    *,
    blur: float,
) -> ComplexArray:
    """Compute the eddy currents (plates, nx, ny, 2) in infinite plates.

    They are in A/m, integrated over the thickness. `blur` in m is the standard deviation of the
    Gaussian over which they are averaged, as near a plate they follow every single turn.
    """
    segments = coil_segments(source)
    lowest = float(min(one.start[:, 2].min() for one in segments))
    nearest = min(max(plate.heights[0], lowest - plate.heights[1]) for plate in plates)
    highest = min(_DECAYS / max(nearest, 1e-9), np.sqrt(2 * _DECAYS) / blur)
    waves = _Waves(segments, currents, _layers(plates, sheets, lowest), frequency, highest, x, y)
    smooth = np.exp(-((waves.k * blur) ** 2) / 2)
    found = np.zeros((len(plates), len(x), len(y), 2), dtype=np.complex128)
    for above, side in ((True, waves.up), (False, waves.down)):
        edges = np.cumsum([layer.thickness for layer in side.layers])
        on_side = [n for n, plate in enumerate(plates) if (plate.z >= 0) == above]
        middles = [sum(plates[n].heights) / 2 for n in on_side]
        numbers = np.searchsorted(edges, [z if above else lowest - z for z in middles]).tolist()
        factor = 2j * np.pi * frequency * MU_0 / waves.k * smooth
        profiles = [side.layers[n].conductivity * side.integral(n) * factor for n in numbers]
        if on_side:
            psi = waves.on_grid(above, profiles, np.zeros((len(on_side), len(waves.k))))
            for number, stream in zip(on_side, np.moveaxis(psi, 1, 0), strict=True):
                found[number] = np.stack((-stream[1], stream[0]), axis=-1)
    return found


def plate_field(
    source: Source,
    currents: npt.ArrayLike,
    plates: Sequence[Plate],
    frequency: float,
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    sheets: Sequence[Sheet] = (),
) -> ComplexArray:
    """Compute B (nx, ny, nz, 3) between plates and magnetic sheets, in T.

    B is also given inside and behind plates and sheets, but not between the lowest copper and the
    top of the board. Before the first plate or sheet the returning waves are added to the exact
    field of the coils. From there on the field consists of waves only, because a field of 1e-17
    behind a thick plate would be lost in a difference. They close coils whose ends lie apart by a
    straight line, by whose field B jumps at the first face.
    """
    paths = as_conductors(source)
    segments = coil_segments(paths)
    lowest = float(min(one.start[:, 2].min() for one in segments))
    beside = z[(z <= 0) & (z >= lowest)]
    if beside.size:
        raise MetalError(
            f"B beside plates is computed above the board and below its copper at {lowest * 1e3:.4g} mm; "
            f"got a height of {beside[0] * 1e3:.4g} mm."
        )
    beyond = np.where(z > 0, z, lowest - z)
    sides = _layers(plates, sheets, lowest)
    # thickness of the air before the first body on each side
    gaps = [(one[0].thickness if one[0] == Layer(one[0].thickness) else 0.0) if one else math.inf for one in sides]
    near, far = np.where(z > 0, *gaps), np.where(z > 0, *gaps[::-1])
    before = beyond < near
    ways = np.where(before, np.minimum(2 * near - beyond, 2 * far + beyond), beyond)
    waves = _Waves(segments, currents, sides, frequency, _DECAYS / float(ways.min()), x, y)
    k = waves.k
    found = np.zeros((len(x), len(y), len(z), 3), dtype=np.complex128)
    if before.any():
        places, amount = grid_points(x, y, z[before]), np.asarray(currents, dtype=np.complex128)
        parts = [magnetic_field(paths, places, part) for part in (amount.real, amount.imag)]
        found[:, :, before] = parts[0] + 1j * parts[1]
    for above, side in ((True, waves.up), (False, waves.down)):
        heights = np.flatnonzero(z > 0 if above else z < 0)
        if not heights.size:
            continue
        b, rise = np.moveaxis(np.array([side.at(float(beyond[n])) for n in heights]), 1, 0)
        free = np.where(before[heights, None], np.exp(-np.outer(beyond[heights], k)), 0.0)
        sign = 1.0 if above else -1.0  # of the derivative over z
        known = -sign * MU_0 * free, MU_0 * k * free
        B = waves.on_grid(above, sign * MU_0 * rise / k, MU_0 * k * b, known)
        found[:, :, heights] += np.moveaxis(B, (0, 1), (3, 2))
    return found
