"""Scenes of results over a board: fields, coupling, response, location."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import true_minus
from coilarray.design.model import Board, Design
from coilarray.geometry.pose import Pose
from coilarray.viz.datasets import results as meshes
from coilarray.viz.datasets.meshes import polylines, surface_of
from coilarray.viz.datasets.results import AMOUNT, FIELD, field_arrows, field_lines
from coilarray.viz.palette import GREY, INDIGO, INK, WINE
from coilarray.viz.scenes.board import Box, CoilColours, cut_upright
from coilarray.viz.scenes.scene import DECADE, Part, Scale, Scene, Text, about_zero, rounded_up

if TYPE_CHECKING:
    import pyvista
    import xarray as xr

    from coilarray.localize.inverse import Location, Mode


CURRENT = "current in phase (A/A)"  # name of the cell array of currents, per ampere of the measured coil
CONFIDENCE = 0.95  # probability that the drawn ellipse of a position contains the true one
_LEAST, _LABELLED = 0.03, 0.25  # least |k| of an arc, and of an arc with a number, over the largest |k|
_ALL = 6  # largest number of coils with arcs of weak coupling
_WIDEST = 0.02  # radius of the widest arc over the distance of the nearest coils
_SEEN, _CROSS = 0.04, 0.018  # least semi-axis of an ellipse and half length of a cross, over the board's length


def scene_of_coupling(coupling: xr.Dataset) -> Scene:
    """Scene of arcs between all pairs of coils of `couple_design`."""
    centres = np.column_stack([coupling[axis].values for axis in "xyz" if axis in coupling])
    k = coupling.coupling.values
    apart = ~np.eye(len(k), dtype=bool)
    pairs = np.abs(k[apart])
    if not pairs.size or pairs.max() == 0:
        return Scene(notes=("There is only one coil, and so no coupling.",) if not pairs.size else ())
    strongest = float(pairs.max())
    least = (_LEAST if len(k) <= _ALL else _LABELLED) * strongest
    arcs = meshes.coupling_arcs(centres, k, least=least)
    nearest = float(np.linalg.norm(centres[:, None] - centres, axis=-1)[apart].min()) * 1e3
    tubes = meshes.arc_tubes(arcs, _WIDEST * nearest)
    scale = about_zero(meshes.COUPLING, "coupling k", "", k[apart])
    texts = []
    for n, value in enumerate(arcs.cell_data[meshes.COUPLING].tolist()):
        if abs(value) >= _LABELLED * strongest:
            points = np.asarray(arcs.get_cell(n).points)
            x, y, z = points[len(points) // 2].tolist()
            texts.append(Text(true_minus(f"{value:+.3f}"), (x, y, z + 0.2 * nearest), 16.0, group="coupling"))
    left_out = arcs.n_lines < len(k) * (len(k) - 1) // 2
    notes = (f"Arcs: coupling k; between ±{least:.1g} it is left out.",) if left_out else ()
    part = Part("coupling", tubes, "coupling", scale=scale, ambient=0.35, diffuse=0.7, upright=True)
    return Scene((part,), tuple(texts), notes)


def colours_of_currents(currents: npt.ArrayLike, active: int) -> CoilColours:
    """Colour the coils by currents in A per A of the `active`, complex, (coils,)."""
    values = np.asarray(currents, dtype=np.complex128).real.copy()
    values[active] = np.nan
    scale = about_zero(CURRENT, "current in phase", "A/A", values)
    return CoilColours(values, replace(scale, missing=INK))


def colours_of_delta(values: npt.ArrayLike, least: float = 0.0) -> CoilColours:
    """Colour the coils by δ (coils,), NaN without a value."""
    # up to `least` at least, so that noise does not look like a touch
    numbers = np.asarray(values, dtype=np.float64)
    small = not np.nanmax(np.abs(numbers), initial=0.0) >= least
    return CoilColours(
        numbers, about_zero(meshes.DELTA, "δ", "", np.append(numbers, (-least, least)) if small else numbers)
    )


def scene_of_location(location: Location, bounds: Box, top: float, truth: tuple[float, float] | None = None) -> Scene:
    """Scene of a `location`'s possible positions, in m on the board."""
    # `bounds` are x_min, y_min, x_max, y_max, `top` is the height of the pins. A cross marks the `truth`.
    parts: list[Part] = []
    length = max(bounds[2] - bounds[0], bounds[3] - bounds[1])
    notes = [_summary(location)]
    finite = {k: mode for k, mode in enumerate(location.modes) if np.isfinite(mode.covariance[:2, :2]).all()}
    # the least factor 1, 2, 5, … with which the largest ellipse is visible
    wanted = _SEEN * length / max(map(_semi_axis, finite.values()), default=math.inf)
    decade = 10.0 ** math.floor(math.log10(max(wanted, 1.0)))
    factor = next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= wanted * (1 - 1e-12))
    label = "95 % ellipse" + ("" if factor == 1 else f", drawn {factor:g} × as large")
    for k, mode in enumerate(location.modes):
        at = (mode.x, mode.y)
        group, colour = ("located", INK) if k == 0 else ("may also be", GREY)
        pin = polylines([np.array([[*at, 0.0], [*at, top]])])
        parts.append(Part(f"pin {k}", pin, group, colour, line_width=4.0, lit=False))
        if k not in finite:
            notes.append("No ellipse: to first order this reading does not depend on one direction.")
            continue
        if _semi_axis(mode) > length:
            notes.append("95 % ellipses longer than the board are not drawn.")
            continue
        if not mode.gaussian:
            notes.append("The likelihood is not Gaussian: the ellipse is its shape near the position only.")
        for name, height in (("", 0.0), (" above", top)):
            covariance = mode.covariance[:2, :2]
            ellipse = meshes.uncertainty_ellipse(at, covariance, CONFIDENCE, magnification=factor, height=height)
            on_board = cut_upright(ellipse, bounds)
            if on_board.n_cells:
                parts.append(Part(f"ellipse {k}{name}", on_board, label, WINE, line_width=4.0, lit=False))
    if truth is not None:
        (x, y), half = truth, _CROSS * length
        ends = [[x - half, y, top], [x + half, y, top]], [[x, y - half, top], [x, y + half, top]]
        cross = polylines([np.array(line) for line in ends])
        parts.append(Part("truth", cross, "indenter", INDIGO, line_width=3.0, lit=False))
    return Scene(tuple(parts), notes=tuple(dict.fromkeys(notes)))


def _summary(location: Location) -> str:
    from coilarray.localize.inverse import mode_text  # loads SciPy

    if not location.modes:
        return f"{location.verdict}: {location.reason}"
    others = len(location.modes) - 1
    also = "" if not others else f"; {others} more position{' fits' if others == 1 else 's fit'}"
    return f"{location.verdict}: {mode_text(location.best)} (standard deviations){also}"


def _semi_axis(mode: Mode) -> float:
    """Longer semi-axis of an ellipse in m."""
    return meshes.semi_axis_factor(CONFIDENCE) * math.sqrt(float(np.linalg.eigvalsh(mode.covariance[:2, :2])[-1]))


Axes = tuple[FloatArray, FloatArray, FloatArray]

_WIDE, _TALL = 2.5, 1.8  # half sides of the box along and across the board, in radii of the coil
_FINE, _GROWTH = 1.3, 1.2  # half side in which its points are equally far apart, and growth of the steps beyond it
_IN_SKIN = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)  # depths in skin depths
_OFF = 1e-8  # m from a face of a plate to a point on either side; B along the face may jump
_DECADES = 2.0  # range of |B| that the colours resolve, in powers of ten
_ARROWS = 150  # about the number of arrows on a plane
_SEE_THROUGH = 0.85  # opacity of a plane where B is strongest
_TUBE = 0.0011  # radius of a line over the diagonal of its box
_HEAD = 9.0, 3.2  # length and radius of an arrowhead over the radius of its line
_SIDES, _LINES = 6, 5  # half-planes through the middle of the coil with seeds, and number of seeds in each
_CLOSED = 0.05  # distance of the ends of a closed line over its size
_STEPS = 60  # steps from the middle to the edge of the coil between which the flux is summed


@dataclass(frozen=True)
class Span:
    """Points of one axis from `low` to `high` in m."""

    low: float
    high: float
    spacing: float
    fine: float = math.inf  # distance in m from the middle beyond which the steps grow

    @property
    def count(self) -> int:
        """Number of points."""
        if math.isinf(self.fine):
            return math.ceil((self.high - self.low) / self.spacing * (1 - 1e-12)) + 1
        return 2 * len(_steps((self.high - self.low) / 2, self.spacing, self.fine)) - 1

    @property
    def points(self) -> FloatArray:
        """Points of the axis in m."""
        if math.isinf(self.fine):
            return np.linspace(self.low, self.high, self.count)
        away = _steps((self.high - self.low) / 2, self.spacing, self.fine)
        return (self.low + self.high) / 2 + np.concatenate((-away[:0:-1], away))


def _steps(length: float, spacing: float, fine: float) -> FloatArray:
    """Distances from 0 to a length in m whose steps grow beyond `fine`."""
    equal = math.ceil(fine / spacing)
    count = math.ceil(math.log1p(max(length - fine, 0.0) / spacing * (_GROWTH - 1)) / math.log(_GROWTH)) + 1
    growing = equal * spacing + spacing * np.cumsum(_GROWTH ** np.arange(1, count + 1))
    every = np.concatenate((spacing * np.arange(equal + 1), growing))
    return np.asarray(every[: int(np.searchsorted(every, length * (1 - 1e-9))) + 1])


Spans = tuple[Span, Span, Span]  # spans of x, y and z


def count_of(places: Iterable[Spans]) -> int:
    """Count the points of several grids."""
    return sum(x.count * y.count * z.count for x, y, z in places)


def field_planes(design: Design, coil: str, spacing: float) -> tuple[Spans, Spans]:
    """Level and upright plane for a coil's field."""
    (x_min, y_min, _), (x_max, y_max, high) = _extent(design)
    z = _clear_height(design, design.pose.z + design.field_height, spacing)
    y = float(_middle_and_radius(design, coil)[0][1])
    along, across = Span(x_min, x_max, spacing), Span(y_min, y_max, spacing)
    low, top = (
        design.pose.z + min(spacing, design.field_height),
        max(z + design.field_height, high + (y_max - y_min) / 2),
    )
    return ((along, across, Span(z, z, spacing)), (along, Span(y, y, spacing), Span(low, top, spacing)))


def _clear_height(design: Design, height: float, spacing: float) -> float:
    """Height of a level plane that cuts no board's copper, in m."""
    # A plane in the copper of a board is moved down, half-way to the copper below.
    spans = []
    for board in design.placed:
        copper = np.concatenate([path.vertices[:, 2] for path in board.conductors()])
        spans.append((float(copper.min()), float(copper.max())))
    cut = [low for low, high in spans if low - spacing / 2 < height < high + spacing / 2]
    below = max((high for _, high in spans if cut and high < min(cut)), default=None)
    return height if below is None else (below + min(cut)) / 2


def field_box(design: Design, coil: str, spacing: float) -> Spans:
    """Box about a coil."""
    (x, y, z), radius = _middle_and_radius(design, coil)
    wide, tall, fine = _WIDE * radius, _TALL * radius, _FINE * radius
    bottom = z - design.array.stackup.thickness - tall
    along, across = (Span(middle - wide, middle + wide, spacing, fine) for middle in (x, y))
    return along, across, Span(bottom, z + tall, spacing, fine)


def is_flat(design: Design) -> bool:
    """Check for one flat board at its own place, whose copper a grid of points can avoid."""
    return design.array.form is None and not design.boards and design.pose == Pose()


def points_of_box(design: Design, box: Spans) -> Axes:
    """Axes of a box outside the copper of a flat board, across which B_z is interpolated."""
    x, y, z = box
    if not is_flat(design):
        return x.points, y.points, z.points
    above = z.spacing / 2 + _steps(z.high - z.spacing / 2, z.spacing, z.fine / 2)
    return x.points, y.points, np.concatenate((-design.array.stackup.thickness - above[::-1], above))


def beside_faces(design: Design, heights: FloatArray, frequency: float) -> FloatArray:
    """Heights in m with more below plates' faces, by skin depth."""
    found = [heights]
    for plate in design.plates:
        skin = plate.material.skin_depth(frequency)
        depths = np.array([0.0, *(share * skin for share in _IN_SKIN)])
        depths = depths[depths < plate.thickness / 2]
        low, high = plate.heights
        found.append(np.concatenate(([low - _OFF, high + _OFF], low + _OFF + depths, high - _OFF - depths)))
    every = np.unique(np.concatenate(found))
    return np.asarray(every[(every >= heights[0]) & (every <= heights[-1])])


def line_seeds(design: Design, coil: str, grid: pyvista.RectilinearGrid) -> FloatArray:
    """Seeds of field lines with equal flux between them, (n, 3) in m.

    They are in half-planes through the middle of the coil, the first two of them along the board.
    The flux of a ring about the middle, ∫ B_n 2π r dr, is divided equally among the seeds of each
    half-plane. `grid` has B.
    """
    from coilarray.viz.extra_3d import pyvista

    board = board_of(design, coil)
    centre, outer = _in_plane(board, coil)
    free = min((plate.heights[0] for plate in design.plates if plate.heights[0] > 0), default=math.inf)
    height = design.field_height if design.field_height < free else free / 2
    radii = outer * np.linspace(0.0, 1.0, _STEPS + 1)
    seeds = [board.in_space([*centre, height])]
    normal = board.in_space([*centre, height + 1.0]) - seeds[0]
    for angle in np.pi * np.arange(_SIDES) * 2 / _SIDES:
        flat = centre + np.outer(radii, (math.cos(angle), math.sin(angle)))
        places = board.in_space(np.column_stack((flat, np.full(len(flat), height))))
        at = pyvista.PolyData(places * 1e3).sample(grid)
        along = np.where(at.point_data["vtkValidPointMask"], at.point_data[FIELD] @ normal, 0.0)
        flux = np.concatenate(([0.0], np.cumsum(np.diff(radii**2) * (along[1:] + along[:-1]) / 2)))
        top = int(np.abs(flux).argmax())
        shares = (np.arange(_LINES) + 0.5) / _LINES * abs(flux[top])
        radius = np.interp(shares, np.maximum.accumulate(np.abs(flux[: top + 1])), radii[: top + 1])
        one = centre + np.outer(radius, (math.cos(angle), math.sin(angle)))
        seeds.extend(board.in_space(np.column_stack((one, np.full(len(one), height)))))
    return np.asarray(seeds)


def board_of(design: Design, coil: str) -> Board:
    """Board in space that has a coil."""
    return next(board for board in design.placed if coil in board.coil_names)


def _extent(design: Design) -> FloatArray:
    """Lowest and highest x, y and z of all boards in m, shape (2, 3)."""
    if is_flat(design):
        x_min, y_min, x_max, y_max = design.array.bounds
        return np.array([(x_min, y_min, -design.array.stackup.thickness), (x_max, y_max, 0.0)])
    corners = np.concatenate([board.pieces.reshape(-1, 3) for board in design.placed])
    return np.array([corners.min(axis=0), corners.max(axis=0)])


def _in_plane(board: Board, coil: str) -> tuple[FloatArray, float]:
    """Centre (2,) and larger half side of a coil's outline in m on its flat board."""
    place = board.array.placements[board.coil_names.index(coil)]
    outline = place.to_board(place.coil.outline)
    low, high = outline.min(axis=0), outline.max(axis=0)
    return (low + high) / 2, float((high - low).max()) / 2


def _middle_and_radius(design: Design, coil: str) -> tuple[FloatArray, float]:
    """Centre (3,) in space and larger half side of a coil's outline in m."""
    board = board_of(design, coil)
    centre, radius = _in_plane(board, coil)
    return board.in_space([*centre, 0.0]), radius


def scale_of_field(grids: Sequence[pyvista.DataSet], part: float = 1.0) -> Scale:
    """Logarithmic scale of |B|, up to the value that a part of each grid's points does not exceed."""
    amounts = [np.asarray(grid.point_data[AMOUNT]) for grid in grids if grid.n_points]
    largest = max((float(np.quantile(amount, part)) for amount in amounts), default=0.0)
    high = rounded_up(largest, DECADE) if largest > 0 else 1.0
    return Scale(AMOUNT, "magnitude of B", "T", high / 10**_DECADES, high, logarithmic=True)


def scene_of_slices(slices: Sequence[pyvista.RectilinearGrid], scale: Scale) -> Scene:
    """Scene of planes of `flux_density`, by |B|, clearer where it is weak."""
    # Lines are at 1, 2 and 5 times powers of ten. Arrows are on upright planes, or on a single one.
    parts = []
    powers = np.arange(math.floor(math.log10(scale.low)), math.ceil(math.log10(scale.high)))
    levels = np.outer(10.0**powers, DECADE[:3]).ravel()
    for k, plane in enumerate(slices):
        sides = np.ptp(np.reshape(plane.bounds, (3, 2)), axis=1)
        level = plane.dimensions[2] == 1
        group = f"B on the {'level' if level else 'upright'} plane"
        surface = surface_of(plane)
        if not surface.n_cells:  # the whole plane is in metal
            continue
        look: dict[str, Any] = {"opacity": _SEE_THROUGH, "fade": True, "lit": False, "upright": not level}
        parts.append(Part(f"plane {k}", surface, group, scale=scale, **look))
        lines = surface.contour(levels[(levels > scale.low) & (levels < scale.high)].tolist(), scalars=AMOUNT)
        if lines.n_cells:
            parts.append(Part(f"contours {k}", lines, group, INK, opacity=0.7, lit=False, line_width=1.5))
        if not level or len(slices) == 1:
            spacing = math.sqrt(float(np.prod(sides[sides > 0])) / _ARROWS) * 1e-3
            arrows = surface_of(field_arrows(plane, spacing).threshold(scale.low, scalars=AMOUNT))
            if arrows.n_cells:
                parts.append(Part(f"arrows {k}", arrows, "B as arrows", INK, ambient=0.4))
    notes = ("Contours at 1, 2 and 5 times powers of ten. Arrows: length as the root of the magnitude.",)
    return Scene(tuple(parts), notes=notes if parts else ())


def scene_of_lines(grid: pyvista.RectilinearGrid, seeds: npt.ArrayLike, scale: Scale) -> Scene:
    """Scene of thin field lines of B with arrowheads through `seeds`, (n, 3) in m."""
    from coilarray.viz.extra_3d import pyvista

    lines = field_lines(grid, seeds)
    if not lines.n_cells:
        return Scene()
    radius, heads = _TUBE * float(grid.length), []
    closed = 0
    for k in range(lines.n_cells):
        points = np.asarray(lines.get_cell(k).points)
        closed += bool(np.linalg.norm(points[-1] - points[0]) < _CLOSED * np.ptp(points, axis=0).max())
        middle = min(max(int(np.argmax(np.abs(points[:, 2] - points[0, 2]))), 1), len(points) - 2)
        along = points[middle + 1] - points[middle - 1]
        head = pyvista.Cone(
            center=points[middle], direction=along, height=_HEAD[0] * radius, radius=_HEAD[1] * radius, resolution=16
        )
        head.clear_data()
        head.point_data[AMOUNT] = np.full(head.n_points, lines.point_data[AMOUNT][lines.get_cell(k).point_ids[middle]])
        heads.append(head)
    tubes = lines.tube(radius=radius, n_sides=8)
    both = tubes.append_polydata(*heads)
    ends = f"{closed} close, the others leave the picture" if closed < lines.n_cells else "all close"
    note = f"Lines of B, in each half-plane with equal flux between them: {ends}."
    part = Part("field lines", both, "lines of B", scale=scale, ambient=0.45, diffuse=0.6, upright=True)
    return Scene((part,), notes=(note,))
