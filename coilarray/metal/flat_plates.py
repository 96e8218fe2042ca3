"""Eddy currents and iron of infinite plates, by plane waves.

The reflection of each plane wave of the coils' field follows
`coilarray.electromagnetics.flat_stack`. Between reflectors with r_u above and r_l below, at the
distance D, waves go up and down 1/(1 − r_u r_l e^{−2kD}) times.

Near the copper there are too many short waves for the integral. For them alone the reflection is
approximated as Σ c e^{−2kd} with a few real distances d, the mutual inductance to images at these
distances with the cross-section of their bars. The remainder is integrated.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.linalg import qr

from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.threads import Progress
from coilarray.constants import MU_0
from coilarray.electromagnetics.field import Source, as_conductors
from coilarray.electromagnetics.flat_layer import (
    Board,
    board_below,
    mirrored,
    reflected_inductance,
    require_below,
    top_of,
    wavenumbers,
)
from coilarray.electromagnetics.flat_stack import Layer, layer_waves, with_gaps
from coilarray.electromagnetics.inductance import Accuracy, mutual_inductance
from coilarray.errors import GeometryError
from coilarray.geometry import Conductor, Plate, Sheet
from coilarray.metal.frequencies import checked_frequencies
from coilarray.metal.layered_air import layer_of, layers_apart

# −ln of the error of the rules over the spectrum, and the largest error of the images' sum against
# the reflection
_DIGITS: dict[Accuracy, float] = {"full": 16.0, "screen": 8.0}
_FIT: dict[Accuracy, float] = {"full": 3e-5, "screen": 1e-4}
_LONGEST = 1e-3  # radians across the board, longer waves carry 1e-10 of the inductance
_AROUND = 160.0  # radians across the board, the integral takes longer waves and images take shorter waves
_FITTED, _SMALLEST = 200, 1e-7  # waves of a fit, and its smallest singular values
_RATIO = 1.15  # ratio of the distances among which the distances of images are chosen


def plate_inductance(
    source: Source,
    plates: Sequence[Plate],
    frequencies: npt.ArrayLike,
    sheets: Sequence[Sheet] = (),
    *,
    accuracy: Accuracy = "full",
) -> ComplexArray:
    """Change of the inductance matrix by infinite plates, in H.

    The result (f, paths, paths) is the change of the impedance over jω relative to the sheets
    alone, ΔL − jΔR/ω, symmetric. Add it to the inductance in air and to
    `coilarray.electromagnetics.flat_layer.layer_inductance`.

    Parameters
    ----------
    source : Array, Conductor, polyline or sequence of them
        See `coilarray.electromagnetics.field.as_conductors`. The paths lie between the plates and
        below the sheets.
    plates : sequence of Plate
        Plates in any order, each above or below all paths. None may reach into another or into the
        sheets.
    frequencies : array_like, shape (f,)
        Frequencies in Hz, at least 0.
    sheets : sequence of Sheet
        Sheets upwards from z = 0, of any permeabilities.
    accuracy : {"full", "screen"}
        Accuracy as in `coilarray.inductance_matrix`. The error of ``screen`` is up to 1e-3 of the
        change itself.

    Raises
    ------
    GeometryError
        A plate that is neither above nor below all paths, or touches them, a plate that reaches
        into another plate or into a magnetic sheet, a source that describes no path.
    ElastomerError
        A path that reaches into a magnetic sheet or above it.
    MetalError
        Frequencies that are not a one-dimensional array of finite numbers of at least 0.

    Notes
    -----
    The current density is uniform in every bar. Paths with open ends are taken as they are, as in
    `layer_inductance`. Otherwise the result is exact at any frequency, to 5e-6 of the largest
    entry. A plate nearer than a sixth of the board's extent costs up to thirty times a
    `mutual_inductance` more.

    Examples
    --------
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
    around = _around(paths, cases, sheets, omega)
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
class _Stack:
    """Layers outwards from a face in m, away from coils."""

    face: float
    layers: tuple[Layer, ...]


@dataclass(frozen=True, eq=False)
class _Around:
    """Surroundings of the paths above and below, in every case.

    The paths lie between `bottom` and `top` in m. Each of the cases has a stack above and a stack
    below. `sheets` is the stack above without plates. Waves are counted from the `faces` on the
    `sides` that hold anything in any case (0 above, 1 below). The kinds of waves are the sides to
    which they leave a path and from which they finally reach a path: up–up (0, 0), up–down (0, 1),
    which includes down–up, and down–down (1, 1).
    """

    stacks: tuple[tuple[_Stack, _Stack], ...]
    sheets: _Stack
    faces: tuple[float, float]
    sides: tuple[int, ...]
    top: float
    bottom: float
    nearest: float
    omega: FloatArray

    @property
    def kinds(self) -> list[tuple[int, int]]:
        """Kinds of waves that occur."""
        return list(itertools.combinations_with_replacement(self.sides, 2))

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
        step = np.array([0.0, 0.0, 2 * (up - down + lift)])
        return [Conductor(p.vertices + step, p.widths, p.thicknesses, name=f"image of {p.name}") for p in paths]

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
        by_sheets = _reflection(k, self.omega, self.sheets, self.sheets.face - up)
        cases = []
        for above, below in self.stacks:
            r_u = _reflection(k, self.omega, above, above.face - up)
            r_l = _reflection(k, self.omega, below, down - below.face)
            trip = np.exp(-2 * k * (up - down)) if len(self.sides) == 2 else 0.0
            again = r_u * r_l * trip
            parts = {(0, 0): r_u - by_sheets + by_sheets * again, (0, 1): 2 * r_u * r_l, (1, 1): r_l}
            cases.append(np.stack([parts[kind] / (1 - again) for kind in self.kinds], axis=1))
        return np.concatenate(cases)


def _around(
    paths: Sequence[Conductor], cases: Sequence[Sequence[Plate]], sheets: Sequence[Sheet], omega: FloatArray
) -> _Around:
    """Surroundings of paths, for several cases of plates."""
    top, bottom = max(map(top_of, paths)), -max(top_of(mirrored(path, 0.0)) for path in paths)
    gaps = []
    for plate in itertools.chain(*cases):
        low, high = plate.heights
        gaps.append(low - top if low + high > top + bottom else bottom - high)
        if gaps[-1] <= 0:
            raise GeometryError(
                f"plate {plate.name!r} must lie above all paths, from z = {top:g} m, or below them, up to {bottom:g} "
                f"m; it lies from {low:g} to {high:g} m."
            )
    for plates in cases:
        layers_apart(plates, sheets)
    alone = _above((), sheets, top)
    for path in paths:
        require_below(path, alone.face)
    stacks = tuple((_above(plates, sheets, top), _below(plates, top)) for plates in cases)
    faces = (min(above.face for above, _ in stacks), max(below.face for _, below in stacks))
    sides = tuple(side for side, face in enumerate(faces) if math.isfinite(face))
    return _Around(stacks, alone, faces, sides, top, bottom, 2 * min(gaps), omega)


def stack_below(plates: Sequence[Plate]) -> tuple[float, tuple[Layer, ...]]:
    """Return upper face in m and layers of plates below z = 0."""
    stack = _below(plates, 0.0)
    return stack.face, stack.layers


def _above(plates: Sequence[Plate], sheets: Sequence[Sheet], top: float) -> _Stack:
    """Sheets and plates above the paths, upwards."""
    heights = itertools.accumulate((sheet.thickness for sheet in sheets), initial=0.0)
    layers = [
        (z, Layer(sheet.thickness, sheet.relative_permeability)) for z, sheet in zip(heights, sheets, strict=False)
    ]
    return _stacked([*layers, *((plate.z, layer_of(plate)) for plate in plates if plate.z >= top)])


def _below(plates: Sequence[Plate], top: float) -> _Stack:
    """Plates below the paths, downwards."""
    stack = _stacked([(-plate.heights[1], layer_of(plate)) for plate in plates if plate.z < top])
    return _Stack(-stack.face, stack.layers)


def _stacked(layers: Sequence[tuple[float, Layer]]) -> _Stack:
    """Combine layers by their faces in m with the air between."""
    found = sorted(
        ((z, layer) for z, layer in layers if layer.permeability != 1 or layer.conductivity), key=lambda one: one[0]
    )
    if not found:
        return _Stack(math.inf, ())
    return _Stack(found[0][0], with_gaps(found, found[0][0]))


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


def _reflection(k: FloatArray, omega: FloatArray, stack: _Stack, distance: float) -> ComplexArray:
    """Reflected part of waves (f, n) at a distance in m from the face."""
    if not stack.layers:
        return np.zeros((len(omega), len(k)), dtype=np.complex128)
    return layer_waves(stack.layers, k, omega[:, None]).reflection * np.exp(-2 * k * distance)
