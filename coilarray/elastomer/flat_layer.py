"""The flat magnetic sheet above the board: what it adds to the inductance matrix, exactly.

One slab of relative permeability μr and thickness t whose lower face lies above all paths. With β = (μr − 1)/(μr + 1)
and F(h) the mutual inductance in free space of path i and the mirror image of path j, lifted by h,

    ΔM = Σ_n β^(2n+1) [F(2nt) − F(2(n+1)t)] = β F(0) − (1 − β²) Σ_{n>0} β^(2n−1) F(2nt).

The image is the path mirrored at the lower face together with its current: horizontal parts keep their direction,
vertical ones turn round. At that face the image's own B has the same part across it as the path's, and the opposite
part along it. So below, path and β times the image give (1 + β) B_z and (1 − β) H_t of the path alone; above, 1 + β
times the path's own B matches both since (1 + β)/μr = 1 − β. The upper face mirrors this back, and so on.

Images that lie near are taken one by one, with the cross-section of their bars. The rest of the series is summed at
once in the spectrum of plane waves, where it is geometric, Σ_n β^(2n) e^{−2nkt} = 1/(1 − β² e^{−2kt}): with
J(k) = ∫ e^{i(k_x x + k_y y)} e^{kz} dl along a path, z counted from the face, and J' its conjugate with J_z reversed,

    F(h) = µ0/4π ∫₀^∞ dk e^{−kh} ⟨J_i·J'_j⟩,   ⟨ ⟩ the mean over the directions of k.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from coilarray.compute.threads import Progress, run_blocks
from coilarray.constants import MU_0
from coilarray.electromagnetics.inductance import Accuracy, mutual_inductance, standing_for_all
from coilarray.electromagnetics.kernels.cuts import lateral_axes
from coilarray.electromagnetics.source import Source, as_conductors
from coilarray.errors import ElastomerError
from coilarray.geometry import Conductor, Sheet

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
ComplexArray = npt.NDArray[np.complex128]

_NEAR = 1 / 16  # of the board: the spectrum takes images (twice the gap) from there on; it costs (board/distance)²
_BALANCE = 0.025  # between the costs of an image and of the spectrum, for sheets so thin that many images lie near
_WIDTHS = 4.0  # images nearer than this many widths are near: the series in _mean_wave errs by 1e-11 beyond
# −ln of the error of every rule over the spectrum against the sum of all parts without their signs: 1.4e-11, 3e-4
_DIGITS: dict[Accuracy, float] = {"full": 25.0, "screen": 8.0}
_WIDEST_PANEL = 200.0  # radians across the board; wider ones save nothing
_LOWEST = 2.0**-60  # of the highest wavenumber; below there is nothing to integrate
_SAME_SHAPE = 1e-12  # of the size; paths that differ by less share a spectrum
_BLOCKS = 64  # of wavenumbers, each of which is summed before the next


@dataclass(frozen=True)
class Slab:
    """One magnetic region: height of its lower face and thickness in m, and relative permeability, above 1."""

    lower: float
    thickness: float
    relative_permeability: float

    @property
    def reflection(self) -> float:
        """β = (μr − 1)/(μr + 1), the strength of the first image."""
        return (self.relative_permeability - 1) / (self.relative_permeability + 1)

    @property
    def transmission(self) -> float:
        """1 − β², what passes the lower face upwards and back, without cancellation."""
        return 4 / (self.relative_permeability + 1) * (self.relative_permeability / (self.relative_permeability + 1))


def magnetic_slab(sheets: Sequence[Sheet]) -> Slab | None:
    """Return the one magnetic region of a stack of sheets upwards from z = 0; None where no sheet is magnetic.

    Neighbouring sheets of one permeability make one slab. ElastomerError for magnetic sheets of different permeability,
    or with another sheet between them.

    Examples
    --------
    >>> magnetic_slab([Sheet("base", 6e-3), Sheet("magnetic", 2e-3, 2.7)])
    Slab(lower=0.006, thickness=0.002, relative_permeability=2.7)
    """
    magnetic = [k for k, sheet in enumerate(sheets) if sheet.relative_permeability > 1]
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


def layer_inductance(
    source: Source, sheets: Sequence[Sheet], *, progress: Progress | None = None, accuracy: Accuracy = "full"
) -> FloatArray:
    """Change of the inductance matrix of current paths by flat sheets above them.

    Parameters
    ----------
    source : CoilArray, Conductor, polyline or sequence of them
        See `coilarray.electromagnetics.source.as_conductors`; below the magnetic sheet. Thin filaments are allowed.
    sheets : sequence of Sheet
        Sheets upwards from z = 0, wide against the coils. At most one magnetic region, see `magnetic_slab`.
    progress : callable, optional
        Called with (done, total) as the work goes on.
    accuracy : {"full", "screen"}
        Accuracy as in `coilarray.inductance_matrix`; ``screen`` errs by up to 1e-3 of the change itself.

    Returns
    -------
    ndarray, shape (paths, paths)
        Inductance in H, symmetric, to be added to the matrix without sheets. Zero where no sheet is magnetic.

    Raises
    ------
    ElastomerError
        More than one magnetic region, or a path that reaches into it (thin filaments: or touches it).
    GeometryError
        A source that describes no path.

    Notes
    -----
    ΔM = Σ_n β^(2n+1) [M(Z + 2nt) − M(Z + 2(n+1)t)], β = (μr − 1)/(μr + 1), Z the sum of both paths' distances from the
    sheet's lower face and M their mutual inductance in free space at that distance: for circles Hurley & Duffy, IEEE
    Trans. Magn. 33, 2282 (1997). The current density is uniform in every bar; vertical ones count as
    thin. Exact to 1e-10 of the largest entry, but for images so near that they need `mutual_inductance`: to its 1e-6 of
    L. Closed paths with any currents I have IᵀΔM I > 0.

    Paths with open ends are taken as they are, as in `inductance_matrix`, so that the pieces of a path add up to the
    whole. Closing the coils of the reference board by a straight line between their terminals, 1.5 mm apart, would
    change ΔM of a coil with itself by −0.10 % and with its neighbour by −0.33 %: so much depends on leads not drawn.

    A sheet much thinner than its distance from the copper costs nothing extra; one that lies on the copper costs one
    `inductance_matrix` for each image within some 1/16 of the board's extent, fewer where that makes many.

    Examples
    --------
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
    board = _board(paths, slab, accuracy)
    near = _near_images(board, slab)
    nodes = _wavenumbers(board, slab, near)
    for n in range(near):
        change += _weight(slab, n) * mutual_inductance(paths, _images(paths, slab, n), accuracy=accuracy)
        if progress is not None:
            progress(n + 1, near + min(_BLOCKS, len(nodes)))
    rest = None if progress is None else lambda done, total: progress(near + done, near + total)
    change += _spectral_rest(board, slab, near, nodes, rest)
    return (change + change.T) / 2


def _weight(slab: Slab, n: int) -> float:
    """Weight of F(2nt) in the series."""
    beta = slab.reflection
    return beta if n == 0 else float(-slab.transmission * beta ** (2 * n - 1))


def _images(paths: Sequence[Conductor], slab: Slab, n: int) -> list[Conductor]:
    """Paths mirrored at the lower face and lifted by 2nt."""
    lift = np.array([0.0, 0.0, 2 * (slab.lower + n * slab.thickness)])
    return [
        Conductor(path.vertices * [1, 1, -1] + lift, path.widths, path.thicknesses, name=f"image {n} of {path.name}")
        for path in paths
    ]


@dataclass(frozen=True, eq=False)
class _Shape:
    """A path about its own origin, lengths in m.

    `vertices`, shape (m, 3); `starts` and `ends`, shape (n,), the vertices of each bar; `across`, shape (n, 2), half
    its width as a vector; `up`, shape (n,), the vertical part of half its thickness; `weights`, shape (n,), of how many
    alike it stands for. Vertical bars are thin.
    """

    vertices: FloatArray
    starts: IntArray
    ends: IntArray
    across: FloatArray
    up: FloatArray
    weights: FloatArray


@dataclass(frozen=True, eq=False)
class _Board:
    """Distinct shapes of the paths, and which one lies where below the sheet; lengths in m.

    A kind of path is one of the `shapes`, `shape_of` (kinds,), at one of the `heights` (kinds,) from the sheet's lower
    face. `kind_of` (paths,) and `origins` (paths, 2) say where they lie. `extent` is the largest horizontal distance,
    `gap` that of the highest copper from its image, `size` the largest width or thickness, `digits` the accuracy.
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


def _board(paths: Sequence[Conductor], slab: Slab, accuracy: Accuracy) -> _Board:
    corners = np.concatenate([path.vertices for path in paths])
    span = np.ptp(corners, axis=0)
    tops = [_top(path, slab.lower) for path in paths]
    origins = np.array([[*path.vertices[0, :2], path.vertices[:, 2].max()] for path in paths])
    shapes: list[_Shape] = []
    known: dict[bytes, int] = {}
    shape_of = []
    for path, origin in zip(paths, origins, strict=True):
        shape = _shape(path, origin, accuracy)
        table = np.concatenate([part.ravel() for part in (shape.vertices, shape.across, shape.up, shape.weights)])
        key = np.round(table / (_SAME_SHAPE * span.max())).astype(np.int64).tobytes()
        if key not in known:
            known[key] = len(shapes)
            shapes.append(shape)
        shape_of.append(known[key])
    heights = origins[:, 2] - slab.lower
    table = np.column_stack((shape_of, np.round(heights / (_SAME_SHAPE * span.max()))))
    _, first, kind_of = np.unique(table, axis=0, return_index=True, return_inverse=True)
    return _Board(
        shapes,
        np.array(shape_of)[first],
        heights[first],
        kind_of,
        origins[:, :2],
        extent=math.hypot(span[0], span[1]),
        gap=2 * max(slab.lower - max(tops), 0.0),
        size=max(float(max(path.widths.max(), path.thicknesses.max())) for path in paths),
        digits=_DIGITS[accuracy],
    )


def _shape(path: Conductor, origin: FloatArray, accuracy: Accuracy) -> _Shape:
    lateral, _ = lateral_axes(path.vertices)
    rows, weights = standing_for_all(path, accuracy)
    needed, places = np.unique(np.concatenate((rows, rows + 1)), return_inverse=True)
    return _Shape(
        path.vertices[needed] - origin,
        starts=places[: len(rows)],
        ends=places[len(rows) :],
        across=(lateral[:, :2] * path.widths[:, None] / 2)[rows],
        up=_upward(path)[rows],
        weights=weights,
    )


def _upward(path: Conductor) -> FloatArray:
    """Vertical part of half the thickness of every bar in m."""
    level = np.hypot(*np.diff(path.vertices[:, :2], axis=0).T) / path.lengths
    return np.asarray(level * path.thicknesses / 2)


def _top(path: Conductor, face: float) -> float:
    """Height of a path's highest copper in m, which must lie below the sheet's lower face."""
    ends = np.maximum(path.vertices[1:, 2], path.vertices[:-1, 2])
    top = float((ends + _upward(path)).max())
    rounding = 1e-12 * float(np.abs(path.vertices).max())
    if top > face + rounding or (path.is_filament and top > face - rounding):
        raise ElastomerError(
            f"paths must lie below the magnetic sheet, whose lower face is at z = {face:g} m; "
            f"{path.name} reaches z = {top:g} m."
        )
    return top


def _near_images(board: _Board, slab: Slab) -> int:
    """Count the images that are taken one by one."""
    cheapest = float(np.cbrt(_BALANCE * slab.thickness * board.extent**2))
    least = max(min(_NEAR * board.extent, cheapest), _WIDTHS * board.size)
    return max(math.ceil((least - board.gap) / (2 * slab.thickness)), 0)


def _nodes(radians: float, digits: float) -> int:
    """Nodes of the rules that integrate e^{ix}, |x| ≤ radians, to the tolerance.

    A Gauss rule errs like M ρ^(−2n) with M = exp(radians (ρ − 1/ρ)/2), the maximum on the ellipse ρ (Trefethen,
    Approximation Theory and Approximation Practice, thm. 19.3), n points on half a circle in the same way on the
    strip |Im θ| < ln ρ. ρ = 3 is near the best.
    """
    return math.ceil((radians * 4 / 3 + digits) / (2 * math.log(3)))


def _wavenumbers(board: _Board, slab: Slab, near: int) -> list[tuple[float, float]]:
    """Nodes and weights in 1/m of the integral over k, up to where e^{−kh} is below the tolerance.

    Panels that double keep their distance from the poles of 1/(1 − β² e^{−2kt}), the nearest of which is at
    k = ln β/t < 0.
    """
    nearest = board.gap + 2 * near * slab.thickness
    highest = board.digits / nearest
    pole = math.log1p(2 / (slab.relative_permeability - 1)) / slab.thickness
    lowest = max(min(pole, 0.5 / slab.thickness, highest / 8), _LOWEST * highest)
    edges = [0.0, lowest]
    while edges[-1] < highest:
        edges.append(min(2 * edges[-1], edges[-1] + _WIDEST_PANEL / (board.extent + nearest), highest))
    nodes = []
    for start, stop in itertools.pairwise(edges):
        half = (stop - start) / 2
        x, weight = np.polynomial.legendre.leggauss(_nodes(half * board.extent, board.digits))
        nodes += list(zip((start + half * (1 + x)).tolist(), (half * weight).tolist(), strict=True))
    return nodes


@dataclass(frozen=True, eq=False)
class _Grid:
    """Distinct offsets between the paths of an array in rows and columns, by which pairs share their integrals.

    `x` and `y` in m; `column` and `row`, shape (paths, paths), say which of them each pair has.
    """

    x: FloatArray
    y: FloatArray
    column: IntArray
    row: IntArray


def _grid(board: _Board) -> _Grid | None:
    """Return the offsets of the paths where there are far fewer than pairs, else None."""
    steps = board.origins[:, None] - board.origins
    numbers = np.round(steps / (_SAME_SHAPE * max(board.extent, board.gap))).astype(np.int64)
    axes = []
    for axis in (0, 1):
        _, first, inverse = np.unique(numbers[..., axis], return_index=True, return_inverse=True)
        axes.append((steps[..., axis].ravel()[first], inverse.reshape(numbers.shape[:2])))
    (x, column), (y, row) = axes
    alike = len(x) * len(y) * len(board.heights) ** 2 < 3 * board.kind_of.size**2  # products of scalars, of vectors
    return _Grid(x, y, column, row) if alike else None


def _spectral_rest(
    board: _Board, slab: Slab, near: int, nodes: list[tuple[float, float]], progress: Progress | None
) -> FloatArray:
    """Sum of the images from `near` on, in H."""
    grid = _grid(board)

    def total(some: list[tuple[float, float]]) -> FloatArray:
        return np.asarray(sum(weight * _rest(slab, near, k) * _spectral_products(board, grid, k) for k, weight in some))

    blocks = [nodes[start::_BLOCKS] for start in range(min(_BLOCKS, len(nodes)))]  # wavenumbers cost more as they rise
    sums = MU_0 / (4 * np.pi) * np.sum(run_blocks(total, blocks, progress), axis=0)
    return np.asarray(sums if grid is None else sums[board.kind_of[:, None], board.kind_of, grid.column, grid.row])


def _rest(slab: Slab, near: int, k: float) -> float:
    """Σ of the weights times e^{−2nkt} from n = `near` on."""
    fall = -math.expm1(-2 * k * slab.thickness)
    series = slab.transmission + slab.reflection**2 * fall  # 1 − β² e^{−2kt}
    if near == 0:
        return slab.reflection * fall / series
    return _weight(slab, near) * math.exp(-2 * near * k * slab.thickness) / series


def _spectral_products(board: _Board, grid: _Grid | None, k: float) -> FloatArray:
    """Mean of J_i·J'_j over the directions of one wavenumber in 1/m, in m².

    Shape (paths, paths) without a grid of offsets, else (kinds, kinds, x, y).
    """
    n = _nodes(k * board.extent, board.digits)
    angle = np.pi * np.arange(n) / n  # the other half circle has the conjugates
    waves = k * np.column_stack((np.cos(angle), np.sin(angle)))
    shapes = np.array([_transform(shape, waves, k) for shape in board.shapes])
    J = shapes[board.shape_of] * np.exp(k * board.heights)[:, None, None]
    if grid is None:
        J = J[board.kind_of] * np.exp(1j * _along(waves, board.origins).T)[:, None]
    mirrored = np.conj(J) * np.array([1.0, 1.0, -1.0])[:, None]
    if grid is None:
        return np.asarray((J.reshape(len(J), -1) @ mirrored.reshape(len(J), -1).T).real / n)
    along_x, along_y = (
        np.exp(1j * np.outer(offsets, wave)) for offsets, wave in zip((grid.x, grid.y), waves.T, strict=True)
    )
    products = np.einsum("acn,bcn->abn", J, mirrored)
    return np.asarray(((products[:, :, None] * along_x) @ along_y.T).real / n)


def _transform(shape: _Shape, waves: FloatArray, k: float) -> ComplexArray:
    """Give ∫ e^{i(k_x x + k_y y)} e^{kz} dl along a path of bars, shape (3, n) in m; `waves`, shape (n, 2) in 1/m."""
    corner = np.exp(1j * _along(waves, shape.vertices) + k * shape.vertices[:, 2])
    begin, end = corner[:, shape.starts], corner[:, shape.ends]
    steps = shape.vertices[shape.ends] - shape.vertices[shape.starts]
    # along a bar the mean is (difference of the ends)/2c, and (tanh c)/c times their mean where that loses digits
    c = 0.5j * _along(waves, steps) + 0.5 * k * steps[:, 2]
    short = np.abs(c) < 1e-3
    both = (end + begin)[short]
    c2 = c[short] ** 2
    c[short] = 1.0
    mean = (end - begin) / (2 * c)
    mean[short] = both / 2 * (1 - c2 / 3)
    mean *= _mean_wave(-(_along(waves, shape.across) ** 2)) * _mean_wave((k * shape.up) ** 2)
    return np.asarray([(mean * (shape.weights * step)).sum(axis=1) for step in steps.T])


def _along(waves: FloatArray, vectors: FloatArray) -> FloatArray:
    """Give k·v of the horizontal parts, shape (waves, vectors); threads within `@` would hinder ours."""
    return np.asarray(waves[:, :1] * vectors[:, 0] + waves[:, 1:] * vectors[:, 1])


def _mean_wave(c2: FloatArray) -> FloatArray:
    """Mean of e^{cs} over −1 ≤ s ≤ 1 for c² down to −1 and up to 1: sinh(c)/c by its series."""
    return np.asarray(1 + c2 / 6 * (1 + c2 / 20 * (1 + c2 / 42 * (1 + c2 / 72))))
