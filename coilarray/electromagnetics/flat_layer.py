"""Exact effect of a flat magnetic sheet on inductance.

The sheet is one slab of relative permeability μr and thickness t, whose lower face lies above all
paths. With β = (μr − 1)/(μr + 1) and F(h) the mutual inductance in free space of path i and the
mirror image of path j, lifted by h,

    ΔM = Σ_n β^(2n+1) [F(2nt) − F(2(n+1)t)] = β F(0) − (1 − β²) Σ_{n>0} β^(2n−1) F(2nt).

The image is the path mirrored at the lower face with its current: horizontal parts keep their
direction, vertical parts turn round. Near images have the cross-section of their bars. The rest is
summed at once in the spectrum of plane waves, Σ_n β^(2n) e^{−2nkt} = 1/(1 − β² e^{−2kt}), as is the
reflection by any flat body above or below the paths: with J(k) of docs/theory/metal.md, "Infinite
plates", and z counted from a face above all paths,

    F(h) = µ0/4π ∫₀^∞ dk e^{−kh} ⟨J_i·J'_j⟩,   ⟨ ⟩ the mean over the directions of k.

A body that reflects waves with a factor of their wavenumber has this factor in place of e^{−kh}. A
face below all paths is a face above the mirrored paths. A wave between both faces counts with
⟨J_i·J'_j⟩ of one board and the other.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import ComplexArray, FloatArray, IntArray, NumberArray
from coilarray.compute.threads import Progress, run_blocks
from coilarray.constants import MU_0
from coilarray.electromagnetics.field import Source, as_conductors, first_of_each
from coilarray.electromagnetics.inductance import Accuracy, mutual_inductance
from coilarray.electromagnetics.kernels.turns import find_series, series_members, series_rules
from coilarray.electromagnetics.neumann import segment_table
from coilarray.errors import ElastomerError, GeometryError
from coilarray.geometry import Conductor, Sheet

_NEAR = 1 / 16  # of the board; beyond it the spectrum takes the images (twice the gap), at a cost of (board/distance)²
_BALANCE = 0.025  # balance of the costs of an image and of the spectrum, for thin sheets with many near images
_WIDTHS = 4.0  # widths up to which images are near; beyond, the series in _mean_wave errs by 1e-11
WeightArray = FloatArray | npt.NDArray[np.complex128]
# −ln of the error of every rule over the spectrum, relative to the sum of all parts without their
# signs: 1.4e-11, 3e-4.
DIGITS: dict[Accuracy, float] = {"full": 25.0, "screen": 8.0}
_WIDEST_PANEL = 200.0  # radians across the board; wider panels save nothing
_LOWEST = 2.0**-60  # of the highest wavenumber; below there is nothing to integrate
_SAME_SHAPE = 1e-12  # of the size; paths that differ by less share a spectrum
_BLOCKS = 64  # of wavenumbers, each summed before the next
_MOST_SUMS = 1e8  # numbers in the sums of all blocks
_MOST_WAVES = 1e10  # waves times corners, some minutes on a core


@dataclass(frozen=True)
class Slab:
    """Magnetic region: height of its lower face and thickness in m, μr > 1."""

    lower: float
    thickness: float
    relative_permeability: float

    @property
    def reflection(self) -> float:
        """Strength of the first image, β = (μr−1)/(μr+1)."""
        return (self.relative_permeability - 1) / (self.relative_permeability + 1)

    @property
    def transmission(self) -> float:
        """Transmission 1 − β² through the lower face and back, without cancellation."""
        return 4 / (self.relative_permeability + 1) * (self.relative_permeability / (self.relative_permeability + 1))


def magnetic_slab(sheets: Sequence[Sheet]) -> Slab | None:
    """Return the magnetic region of sheets from z = 0, or None."""
    magnetic = [k for k, sheet in enumerate(sheets) if sheet.magnetic]
    if not magnetic:
        return None
    first, last = magnetic[0], magnetic[-1]
    permeability = sheets[first].relative_permeability
    if any(sheet.relative_permeability != permeability for sheet in sheets[first : last + 1]):
        found = ", ".join(
            f"{sheets[k].name!r} (sheet {k + 1}, μr {sheets[k].relative_permeability:g})" for k in magnetic
        )
        raise ElastomerError(
            "magnetic sheets must lie on each other and have one relative permeability, so that they make one slab; "
            f"got {found}."
        )
    heights = [0.0, *itertools.accumulate(sheet.thickness for sheet in sheets)]
    return Slab(heights[first], math.fsum(sheet.thickness for sheet in sheets[first : last + 1]), permeability)


def layer_inductance(source: Source, sheets: Sequence[Sheet], *, accuracy: Accuracy = "full") -> FloatArray:
    """Compute the change of inductance (paths, paths) by flat sheets in H.

    It is symmetric, to be added to the matrix without sheets, and zero if no sheet is magnetic. The
    paths of the `source`, also thin filaments, lie below the magnetic sheet. The `sheets` go
    upwards from z = 0, wide against the coils, with at most one magnetic region (`magnetic_slab`).
    A second region, or a path that reaches into it (a thin filament: or touches it), raises an
    ElastomerError. The `accuracy` is that of `coilarray.inductance_matrix`, where ``screen`` errs
    by up to 1e-3 of the change itself.

    The series of the module, for circles that of Hurley & Duffy, IEEE Trans. Magn. 33, 2282 (1997),
    holds for a uniform current density in every bar. The result is exact to 1e-10 of the largest
    entry, near images to 1e-6 of L. Closed paths with any currents I have IᵀΔM I > 0. Paths with
    open ends are taken as they are, so that the pieces of a path add up to the whole. A sheet that
    lies on the copper costs one `inductance_matrix` for each of a few near images.

    A sheet 6 mm above a square loop.

    >>> square = [[0, 0, 0], [2e-2, 0, 0], [2e-2, 2e-2, 0], [0, 2e-2, 0], [0, 0, 0]]
    >>> change = layer_inductance([square], [Sheet("base", 6e-3), Sheet("magnetic", 2e-3, 2.7)])
    >>> round(float(change[0, 0]) * 1e9, 4)
    0.9809
    """
    paths = as_conductors(source)
    slab = magnetic_slab(sheets)
    change = np.zeros((len(paths), len(paths)))
    if slab is None:
        return change
    for path in paths:
        require_below(path, slab.lower)
    board = board_below(paths, slab.lower, accuracy)
    near = _near_images(board, slab)
    # Waves count up to the k at which e^{−kh} is below the tolerance. Panels that double keep their
    # distance from the poles of 1/(1 − β² e^{−2kt}), the nearest of which is at k = ln β/t < 0.
    nearest = board.gap + 2 * near * slab.thickness
    highest = board.digits / nearest
    pole = math.log1p(2 / (slab.relative_permeability - 1)) / slab.thickness
    lowest = min(pole, 0.5 / slab.thickness, highest / 8)
    k, weights = np.array(wavenumbers(board, lowest, highest, nearest)).T
    require_few_waves(board, k.tolist())
    for n in range(near):
        images = [mirrored(path, slab.lower + n * slab.thickness) for path in paths]
        change += _weight(slab, n) * mutual_inductance(paths, images, accuracy=accuracy)
    # the sum of the weights times e^{−2nkt} from n = `near` on
    fall = -np.expm1(-2 * k * slab.thickness)
    series = slab.transmission + slab.reflection**2 * fall  # 1 − β² e^{−2kt}
    first = slab.reflection * fall if near == 0 else _weight(slab, near) * np.exp(-2 * near * k * slab.thickness)
    shares = first / series
    change += reflected_inductance([board], k.tolist(), (weights * shares)[None, None])[0].real
    return (change + change.T) / 2


def _weight(slab: Slab, n: int) -> float:
    """Weight of F(2nt) in the series."""
    beta = slab.reflection
    return beta if n == 0 else float(-slab.transmission * beta ** (2 * n - 1))


def mirrored(path: Conductor, height: float) -> Conductor:
    """Return the path and its current mirrored at a height in m."""
    lift = np.array([0.0, 0.0, 2 * height])
    vertices, across = path.vertices * [1, 1, -1] + lift, path.across * [1, 1, -1]
    return Conductor(vertices, path.widths, path.thicknesses, name=f"image of {path.name}", across=across)


def require_below(path: Conductor, face: float) -> None:
    """Raise ElastomerError unless a path's highest copper is below a face in m."""
    top = top_of(path)
    rounding = 1e-12 * float(np.abs(path.vertices).max())
    if top > face + rounding or (path.is_filament and top > face - rounding):
        raise ElastomerError(
            f"paths must lie below the magnetic sheet, whose lower face is at z = {face:g} m; "
            f"{path.name} reaches z = {top:g} m."
        )


def _near_images(board: Board, slab: Slab) -> int:
    """Count the images that are taken individually."""
    spectrum = board.digits / DIGITS["full"] * board.extent  # fewer digits take fewer waves
    least = max(min(_NEAR * spectrum, math.cbrt(_BALANCE * slab.thickness * spectrum**2)), _WIDTHS * board.size)
    return max(math.ceil((least - board.gap) / (2 * slab.thickness)), 0)


@dataclass(frozen=True, eq=False)
class _Shape:
    """Path about its own origin, lengths in m.

    `sides` (2, n, 3) are half the width and half the thickness of each bar as vectors, `weights`
    (n,) the number of equal bars.
    """

    vertices: FloatArray
    starts: IntArray
    ends: IntArray
    sides: FloatArray
    weights: FloatArray


@dataclass(frozen=True, eq=False)
class Board:
    """Distinct path shapes and places below a face, lengths in m.

    A kind of path is one of the `shapes`, `shape_of` (kinds,), at one of the `heights` (kinds,)
    from the face. `kind_of` (paths,) and `origins` (paths, 2) give the kind and place of each path.
    `extent` is the largest horizontal distance, `gap` the distance of the highest copper from its
    image, `size` the largest width or thickness, and `digits` the accuracy.
    """

    shapes: list[_Shape]
    shape_of: IntArray
    heights: FloatArray
    kind_of: IntArray
    origins: FloatArray
    extent: float
    gap: float
    size: float
    digits: float


def board_below(paths: Sequence[Conductor], face: float, accuracy: Accuracy) -> Board:
    """Sort paths below a face in m by shape and place."""
    corners = np.concatenate([path.vertices for path in paths])
    span = np.ptp(corners, axis=0)
    origins = np.array([[*path.vertices[0, :2], path.vertices[:, 2].max()] for path in paths])
    grain = _SAME_SHAPE * span.max()
    keys = []
    for path, origin in zip(paths, origins, strict=True):
        table = np.concatenate([part.ravel() for part in (path.vertices - origin, path.widths, path.thicknesses)])
        directions = np.round(path.across / _SAME_SHAPE).astype(np.int64)
        keys.append(np.round(table / grain).astype(np.int64).tobytes() + directions.tobytes())
    examples, shape_of = first_of_each(keys)
    heights = origins[:, 2] - face
    kinds = np.column_stack((shape_of, np.round(heights / grain)))
    _, first, kind_of = np.unique(kinds, axis=0, return_index=True, return_inverse=True)
    return Board(
        [_shape(paths[k], origins[k], accuracy) for k in examples],
        shape_of[first],
        heights[first],
        kind_of.ravel(),
        origins[:, :2],
        extent=math.hypot(span[0], span[1]),
        gap=2 * max(face - max(map(top_of, paths)), 0.0),
        size=max(float(max(path.widths.max(), path.thicknesses.max())) for path in paths),
        digits=DIGITS[accuracy],
    )


def _shape(path: Conductor, origin: FloatArray, accuracy: Accuracy) -> _Shape:
    """Describe a path by its bars about an origin."""
    rows, weights = np.arange(len(path.lengths)), np.ones(len(path.lengths))
    if accuracy == "screen":  # a few turns, between which quantities are smooth
        series = find_series(segment_table(path))
        rows, weights = series_members(series, *series_rules(int(series[:, 2].max())))
    needed, places = np.unique(np.concatenate((rows, rows + 1)), return_inverse=True)
    return _Shape(
        path.vertices[needed] - origin,
        starts=places[: len(rows)],
        ends=places[len(rows) :],
        sides=np.stack([side[rows] for side in _half_sides(path)]),
        weights=weights,
    )


def _half_sides(path: Conductor) -> tuple[FloatArray, FloatArray]:
    """Half the width and half the thickness of every bar as vectors (n, 3) in m."""
    normals = np.cross(np.diff(path.vertices, axis=0) / path.lengths[:, None], path.across)
    return path.across * path.widths[:, None] / 2, normals * path.thicknesses[:, None] / 2


def top_of(path: Conductor) -> float:
    """Height of a path's highest copper in m."""
    ends = np.maximum(path.vertices[1:, 2], path.vertices[:-1, 2])
    return float((ends + sum(np.abs(side[:, 2]) for side in _half_sides(path))).max())


def _nodes(radians: float, digits: float) -> int:
    """Nodes of rules for e^{ix}, |x| ≤ radians.

    A Gauss rule errs like M ρ^(−2n) with M = exp(radians (ρ − 1/ρ)/2), the maximum on the ellipse ρ
    (Trefethen, Approximation Theory and Approximation Practice, thm. 19.3), and so do n points on
    half a circle on the strip |Im θ| < ln ρ. ρ = 3 is near the best.
    """
    return math.ceil((radians * 4 / 3 + digits) / (2 * math.log(3)))


def wavenumbers(board: Board, lowest: float, highest: float, distance: float) -> list[tuple[float, float]]:
    """Nodes and weights in 1/m of an integral up to `highest`.

    Panels double from `lowest`, so that they keep their distance from poles at wavenumbers of that
    size, up to the width that the `distance` in m between a path and an image, and the board allow.
    """
    edges = [0.0, max(lowest, _LOWEST * highest)]
    while edges[-1] < highest:
        edges.append(min(2 * edges[-1], edges[-1] + _WIDEST_PANEL / (board.extent + distance), highest))
    nodes = []
    for start, stop in itertools.pairwise(edges):
        half = (stop - start) / 2
        x, weight = np.polynomial.legendre.leggauss(_nodes(half * board.extent, board.digits))
        nodes += list(zip((start + half * (1 + x)).tolist(), (half * weight).tolist(), strict=True))
    return nodes


def _grid(board: Board, other_kinds: int) -> tuple[tuple[FloatArray, FloatArray], list[IntArray]] | None:
    """Offsets x and y in m between paths and their numbers by pair, or None if most differ."""
    steps = board.origins[:, None] - board.origins
    rounded = np.round(steps / (_SAME_SHAPE * max(board.extent, board.gap))).astype(np.int64)
    offsets, numbers = [], []
    for axis in (0, 1):
        _, first, inverse = np.unique(rounded[..., axis], return_index=True, return_inverse=True)
        offsets.append(steps[..., axis].ravel()[first])
        numbers.append(inverse.reshape(rounded.shape[:2]))
    x, y = offsets
    products = len(x) * len(y) * len(board.heights) * other_kinds  # of scalars, else of vectors
    return ((x, y), numbers) if products < 3 * board.kind_of.size**2 else None


def reflected_inductance(
    boards: Sequence[Board], nodes: Sequence[float], weights: WeightArray, *, progress: Progress | None = None
) -> WeightArray:
    """Sum reflected waves over wavenumbers, (m, paths, paths) in H.

    The sum is µ0/4π Σ_k w ⟨J_i·J'_j⟩. `boards` has the board below a face above, and may have the
    mirrored board below a face below. `weights` (m, pairs, nodes) are for the pairs of boards with
    themselves and, between both, of one with the other.
    """
    require_few_waves(boards[0], nodes)
    grid = _grid(boards[0], len(boards[-1].heights))
    offsets = None if grid is None else grid[0]
    pairs = list(itertools.combinations_with_replacement(range(len(boards)), 2))

    def total(numbers: range) -> list[WeightArray]:
        sums: list[WeightArray] = [np.zeros(1)] * len(pairs)
        for n in numbers:
            for p, product in enumerate(_products(boards, pairs, offsets, nodes[n])):
                sums[p] = sums[p] + weights[:, p, n].reshape(-1, *[1] * product.ndim) * product
        return sums

    every = range(len(nodes))  # wavenumbers cost more as they rise
    count = min(_BLOCKS, len(nodes), max(int(_MOST_SUMS / len(weights) / len(boards[0].kind_of) ** 2), 1))
    blocks = [every[start::count] for start in range(count)]
    found = run_blocks(total, blocks, progress=progress)
    change: WeightArray = np.zeros(1)
    for p, (a, b) in enumerate(pairs):
        sums = MU_0 / (4 * np.pi) * np.sum([sums[p] for sums in found], axis=0)
        if grid is not None:
            sums = sums[:, boards[a].kind_of[:, None], boards[b].kind_of, *grid[1]]
        change = change + sums
    return change


def require_few_waves(board: Board, nodes: Sequence[float]) -> None:
    """Raise GeometryError if a board's spectra at nodes in 1/m take hours."""
    waves = sum(_nodes(k * board.extent, board.digits) for k in nodes)
    corners = sum(len(shape.vertices) for shape in board.shapes)
    if waves * corners > _MOST_WAVES:
        raise GeometryError(
            f"{corners} corners of copper over {board.extent * 1e3:.3g} mm, {board.gap / 2 * 1e3:.3g} mm from a layer, "
            f"would take {waves * corners / _MOST_WAVES:.2g} times the work that is allowed; use fewer corners."
        )


def _products(
    boards: Sequence[Board], pairs: Sequence[tuple[int, int]], offsets: tuple[FloatArray, FloatArray] | None, k: float
) -> list[FloatArray]:
    """Mean of J_i·J'_j at k in m², (paths, paths), or (kinds, kinds, x, y) with `offsets`."""
    n = _nodes(k * boards[0].extent, boards[0].digits)
    angle = np.pi * np.arange(n) / n  # the other half circle has the conjugates
    waves = k * np.column_stack((np.cos(angle), np.sin(angle)))
    J = []
    for board in boards:  # the spectrum of every kind of path about its origin, (kinds, 3, n) in m
        shapes = np.array([_transform(shape, waves, k) for shape in board.shapes])
        J.append(shapes[board.shape_of] * np.exp(k * board.heights)[:, None, None])
    if offsets is None:
        places = np.exp(1j * _along(waves, boards[0].origins).T)[:, None]
        J = [own[board.kind_of] * places for own, board in zip(J, boards, strict=True)]
    mirrored = [np.conj(own) * np.array([1.0, 1.0, -1.0])[:, None] for own in J]
    if offsets is None:
        flat, others = ([one.reshape(len(one), -1) for one in each] for each in (J, mirrored))
        return [np.asarray((flat[a] @ others[b].T).real / n) for a, b in pairs]
    along_x, along_y = (np.exp(1j * np.outer(steps, wave)) for steps, wave in zip(offsets, waves.T, strict=True))
    products = [np.einsum("acn,bcn->abn", J[a], mirrored[b]) for a, b in pairs]
    return [np.asarray(((one[:, :, None] * along_x) @ along_y.T).real / n) for one in products]


def _transform(shape: _Shape, waves: FloatArray, k: float) -> ComplexArray:
    """Integrate ∫ e^{i(k_x x + k_y y)} e^{kz} dl along bars, (3, n) in m."""
    corner = np.exp(1j * _along(waves, shape.vertices) + k * shape.vertices[:, 2])
    begin, end = corner[:, shape.starts], corner[:, shape.ends]
    steps = shape.vertices[shape.ends] - shape.vertices[shape.starts]
    # Along a bar the mean is (difference of the ends)/2c. Where that loses digits, it is (tanh c)/c
    # times the mean of the ends.
    c = 0.5j * _along(waves, steps) + 0.5 * k * steps[:, 2]
    short = np.abs(c) < 1e-3
    both = (end + begin)[short]
    c2 = c[short] ** 2
    c[short] = 1.0
    mean = (end - begin) / (2 * c)
    mean[short] = both / 2 * (1 - c2 / 3)
    for side in shape.sides:
        mean *= _mean_wave(_along(waves, side), k * side[:, 2])
    return np.asarray([(mean * (shape.weights * step)).sum(axis=1) for step in steps.T])


def _along(waves: FloatArray, vectors: FloatArray) -> FloatArray:
    """Compute k·v of horizontal parts, (waves, vectors), without `@`, whose threads compete."""
    return np.asarray(waves[:, :1] * vectors[:, 0] + waves[:, 1:] * vectors[:, 1])


def _mean_wave(phase: FloatArray, growth: FloatArray) -> NumberArray:
    """Mean sinh(c)/c of e^{cs} over −1 ≤ s ≤ 1 for c = i phase + growth, a series for |c| ≤ 1."""
    # sides of a flat board's bars are level or upright
    both = phase * growth
    c2 = growth**2 - phase**2 + (2j * both if both.any() else 0.0)
    if np.abs(c2).max() > 1:
        c = np.sqrt(c2.astype(np.complex128))
        c[c == 0] = 1e-9
        wave = np.sinh(c) / c
        return wave if np.iscomplexobj(c2) else np.asarray(wave.real)
    return np.asarray(1 + c2 / 6 * (1 + c2 / 20 * (1 + c2 / 42 * (1 + c2 / 72))))
