"""Results over a board: field, eddies, arcs, surfaces, and ellipses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray
from coilarray.errors import GeometryError
from coilarray.viz.datasets.meshes import MM_PER_M, polylines

if TYPE_CHECKING:
    import pyvista
    import xarray as xr


COUPLING, DELTA = "k", "delta (1)"
"""Names of the arrays of coupling coefficients and of relative changes of inductance."""

_RISE = 0.3  # height of an arc over its span; neighbours' arcs stay below arcs of coils farther apart
_POINTS_OF_ARC, _SIDES_OF_TUBE = 33, 16
_POINTS_OF_ELLIPSE = 145  # every 2.5°


def at_depth(dataset: xr.Dataset, depth: int) -> xr.Dataset:
    """One depth of a dataset by its index, or ValueError."""
    count = dataset.sizes["depth"]
    if not -count <= depth < count:
        raise ValueError(f"depth must be the position of one of {count} depths; got {depth}.")
    return dataset.isel(depth=depth)


def of_state(dataset: xr.Dataset, state: str) -> xr.Dataset:
    """One state of a dataset by its name, or ValueError."""
    names = [str(name) for name in dataset.state.values]
    if state not in names:
        raise ValueError(f"state must be one of {', '.join(names)}; got {state!r}.")
    return dataset.sel(state=state)


def coupling_arcs(centres: npt.ArrayLike, coupling: npt.ArrayLike, *, least: float = 0.0) -> pyvista.PolyData:
    """Join pairs of coils at `centres` in m by arcs in mm, above `least` |k|."""
    # Parabolas rise by 0.3 of their span, with the cell arrays "coil", "other" (indices of the coils) and "k".
    places, k = np.asarray(centres, dtype=np.float64), np.asarray(coupling, dtype=np.float64)
    places = np.column_stack((places, np.zeros((len(places), 3 - places.shape[1]))))
    share = np.linspace(0.0, 1.0, _POINTS_OF_ARC)
    pairs = [(i, j) for i, j in combinations(range(len(places)), 2) if abs(k[i, j]) >= least]
    lines = []
    for start, end in ((places[i], places[j]) for i, j in pairs):
        rise = 4 * _RISE * float(np.linalg.norm(end - start)) * share * (1 - share)
        lines.append(start + share[:, None] * (end - start) + np.outer(rise, (0.0, 0.0, 1.0)))
    arcs = polylines(lines)
    if pairs:
        first, second = np.array(pairs).T
        arcs.cell_data["coil"], arcs.cell_data["other"] = first, second
        arcs.cell_data[COUPLING] = k[first, second]
    return arcs


def arc_tubes(arcs: pyvista.PolyData, widest: float) -> pyvista.PolyData:
    """Give `coupling_arcs` radii in proportion to |k|, `widest` in mm."""
    if not arcs.n_lines:
        return arcs
    lines = arcs.copy()
    k = np.repeat(lines.cell_data[COUPLING], _POINTS_OF_ARC)
    lines.clear_data()
    lines.point_data[COUPLING] = k
    lines.point_data["radius"] = widest * np.abs(k) / max(float(np.abs(k).max()), np.finfo(float).tiny)
    tubes: pyvista.PolyData = lines.tube(scalars="radius", absolute=True, n_sides=_SIDES_OF_TUBE, capping=True)
    return tubes


def semi_axis_factor(confidence: float) -> float:
    """Semi-axes of an ellipse in standard deviations."""
    return math.sqrt(-2 * math.log1p(-confidence))


def uncertainty_ellipse(
    centre: tuple[float, float],
    covariance: npt.NDArray[np.float64],
    confidence: float = 0.95,
    *,
    magnification: float = 1.0,
    height: float = 0.0,
) -> pyvista.PolyData:
    """Ellipse in mm around a position with given probability.

    The `centre` is in m, the `covariance` (2, 2) of the Gaussian errors of x and y in m². (r − r̂)ᵀ
    Σ⁻¹ (r − r̂) = q with q the quantile of χ² for two degrees of freedom, −2 ln(1 − confidence).
    With the Cholesky factor Σ = L Lᵀ it is r̂ + √q L (cos t, sin t), times the `magnification`.
    """
    angle = np.linspace(0.0, 2 * np.pi, _POINTS_OF_ELLIPSE)
    circle = semi_axis_factor(confidence) * np.column_stack((np.cos(angle), np.sin(angle)))
    points = np.asarray(centre) + magnification * circle @ np.linalg.cholesky(covariance).T
    return polylines([np.column_stack((points, np.full(_POINTS_OF_ELLIPSE, height)))])


FIELD, AMOUNT = "B (T)", "|B| (T)"  # names of the point arrays of the vectors and their magnitudes
EDDY, EDDY_AMOUNT = "K (A/m)", "|K| (A/m)"
"""Names of the point arrays of arrows, for the current per width and its magnitude."""

MOST_MEMORY = 1e9  # largest memory of a field for a picture, in bytes
_OFF = 0.12  # height of an arrow above its face over the spacing, to keep it out of the metal
_BYTES_A_POINT = 220.0  # measured maximum, 110 in a box, 170 to 220 on planes, which are drawn
_LONGEST_LINE = 8.0  # length in diagonals of the grid
_LINE_STEP = 0.25  # distance between points of a line, in cells
_BACK = 0.6  # distance of a closed line from its seed, over the largest distance before


def require_memory(points: int, what: str) -> None:
    """Refuse a field with more points than `MOST_MEMORY` holds."""
    needed = points * _BYTES_A_POINT
    if needed > MOST_MEMORY:
        raise GeometryError(
            f"{what} gives {points:.3g} points, about {needed / 1e9:.3g} GB of memory; at most "
            f"{MOST_MEMORY / 1e9:g} GB is allowed: widen the spacing."
        )


def field_grid(x: npt.ArrayLike, y: npt.ArrayLike, z: npt.ArrayLike, field: npt.ArrayLike) -> pyvista.RectilinearGrid:
    """Put B (nx, ny, nz, 3) in T on a plane or in a box in mm."""
    # Point arrays are "B (T)" and "|B| (T)". The coordinates in m ascend, a single value makes a plane.
    from coilarray.viz.extra_3d import pyvista

    axes = [np.atleast_1d(np.asarray(axis, dtype=np.float64)) for axis in (x, y, z)]
    for letter, axis in zip("xyz", axes, strict=True):
        if axis.ndim != 1 or axis.size == 0 or not (np.diff(axis) > 0).all():
            raise ValueError(f"{letter} of a field grid must be one ascending row of numbers; got {axis}.")
    vectors = np.asarray(field, dtype=np.float64)
    shape = (*(axis.size for axis in axes), 3)
    if vectors.shape != shape:
        raise ValueError(f"field must have shape (nx, ny, nz, 3) = {shape}; got {vectors.shape}.")
    grid = pyvista.RectilinearGrid(*(axis * MM_PER_M for axis in axes))
    grid.point_data[FIELD] = vectors.transpose(2, 1, 0, 3).reshape(-1, 3)  # VTK counts x fastest
    grid.point_data[AMOUNT] = np.linalg.norm(grid.point_data[FIELD], axis=1)
    return grid


def field_arrows(grid: pyvista.RectilinearGrid, spacing: float) -> pyvista.PolyData:
    """Arrows in mm along B, with the grid's arrays."""
    # They are a `spacing` in m apart, and as long as this times √(|B|/max), to be visible where the field is weak.
    kept = [_thinned(np.asarray(axis, dtype=np.float64), spacing * MM_PER_M) for axis in (grid.x, grid.y, grid.z)]
    nx, ny, _ = grid.dimensions
    i, j, k = np.meshgrid(*kept, indexing="ij")
    chosen = (i + nx * (j + ny * k)).ravel()
    return arrows_at(np.asarray(grid.points)[chosen], np.asarray(grid.point_data[FIELD])[chosen], spacing)


def arrows_at(
    points: npt.NDArray[np.float64],
    vectors: npt.NDArray[np.float64],
    spacing: float,
    names: tuple[str, str] = (FIELD, AMOUNT),
    largest: float | None = None,
) -> pyvista.PolyData:
    """Arrows along vectors (n, 3) about points in mm."""
    # `names` are the arrays of vectors and magnitude. The `largest`, by default the strongest, is `spacing` in m long.
    from coilarray.viz.extra_3d import pyvista

    amount = np.linalg.norm(vectors, axis=1)
    top = float(amount.max(initial=0.0)) if largest is None else largest
    at = pyvista.PolyData(points)
    at.point_data[names[0]] = vectors
    at.point_data["size"] = np.sqrt(amount / max(top, np.finfo(float).tiny))
    arrow = pyvista.Arrow(
        start=(-0.5, 0.0, 0.0), tip_length=0.35, tip_radius=0.14, shaft_radius=0.05, tip_resolution=12,
        shaft_resolution=8,
    )  # fmt: skip
    arrows: pyvista.PolyData = at.glyph(orient=names[0], scale="size", factor=spacing * MM_PER_M, geom=arrow)
    arrows.clear_data()
    arrows.point_data[names[0]] = np.repeat(vectors, arrow.n_points, axis=0)
    arrows.point_data[names[1]] = np.repeat(amount, arrow.n_points)
    return arrows


@dataclass(frozen=True, eq=False)
class Eddies:
    """Eddy currents of one body at an instant."""

    points: FloatArray  # (n, 3) on the board in m
    normals: FloatArray  # (n, 3), outward unit vectors of its face
    density: FloatArray  # (n, 3), current per width in A/m


def eddy_arrows(eddies: Eddies, spacing: float, largest: float) -> pyvista.PolyData:
    """Arrows along eddy currents in mm, one per cube of `spacing`."""
    # An arrow as strong as `largest` in A/m is as long as the spacing.
    away = (eddies.points - eddies.points.min(axis=0)) / spacing
    cubes = np.floor(away + 0.5)
    order = np.argsort(np.linalg.norm(away - cubes, axis=1), kind="stable")  # the nearest to each cube's centre first
    _, first = np.unique(cubes[order], axis=0, return_index=True)
    chosen = np.sort(order[first])
    points = eddies.points[chosen] + _OFF * spacing * eddies.normals[chosen]
    return arrows_at(MM_PER_M * points, eddies.density[chosen], spacing, (EDDY, EDDY_AMOUNT), largest)


def field_lines(grid: pyvista.RectilinearGrid, seeds: npt.ArrayLike) -> pyvista.PolyData:
    """Follow B both ways, in mm with the point array ``"|B| (T)"``."""
    # A line ends if it leaves the grid or has come round once, at its return through the plane across B at the seed.
    from coilarray.viz.extra_3d import pyvista

    points = np.asarray(seeds, dtype=np.float64).reshape(-1, 3)
    along, against = _followed(grid, points, "forward"), _followed(grid, points, "backward")
    lines, amounts = [], []
    for seed in sorted(along.keys() | against.keys()):
        line, amount = along.get(seed, _NOWHERE)
        end = _first_round(line)
        if end is None:
            before, amount_before = against.get(seed, _NOWHERE)
            line = np.vstack((before[:0:-1], line))
            amount = np.concatenate((amount_before[:0:-1], amount))
        lines.append(line[:end])
        amounts.append(amount[:end])
    if not lines:
        return pyvista.PolyData()
    result = polylines([line / MM_PER_M for line in lines])
    result.point_data[AMOUNT] = np.concatenate(amounts)
    return result


def _thinned(axis: npt.NDArray[np.float64], distance: float) -> list[int]:
    def apart(first: int) -> list[int]:
        kept = [first]
        for k in range(first + 1, len(axis)):
            if axis[k] - axis[kept[-1]] >= distance * (1 - 1e-9):
                kept.append(k)
        return kept

    return apart((len(axis) - 1 - apart(0)[-1]) // 2)


_Line = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]
_NOWHERE: _Line = (np.empty((0, 3)), np.empty(0))


def _followed(
    grid: pyvista.RectilinearGrid, seeds: npt.NDArray[np.float64], way: Literal["forward", "backward"]
) -> dict[int, _Line]:
    """Line (m, 3) in mm and |B| in T from every seed."""
    from coilarray.viz.extra_3d import pyvista

    found = grid.streamlines_from_source(
        pyvista.PolyData(seeds * MM_PER_M), vectors=FIELD, integration_direction=way, integrator_type=4, step_unit="cl",
        initial_step_length=_LINE_STEP, max_length=_LONGEST_LINE * float(grid.length), max_steps=20_000,
        terminal_speed=0.0, compute_vorticity=False,
    )  # fmt: skip
    if not found.n_cells:
        return {}
    points, amounts = np.asarray(found.points, dtype=np.float64), np.asarray(found.point_data[AMOUNT])
    cells = {int(seed): found.get_cell(k).point_ids for k, seed in enumerate(found.cell_data["SeedIds"])}
    return {seed: (points[at], amounts[at]) for seed, at in cells.items() if len(at) > 1}


def _first_round(line: npt.NDArray[np.float64]) -> int | None:
    """Count the points until a line closes, or None."""
    if len(line) < 2:
        return None
    away = line - line[0]
    ahead, distance = away @ away[1] >= 0, np.linalg.norm(away, axis=1)
    near = distance < _BACK * np.maximum.accumulate(distance)
    back = np.flatnonzero(ahead[1:] & ~ahead[:-1] & near[1:])
    return int(back[0]) + 2 if back.size else None
