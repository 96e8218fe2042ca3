"""Results over a board: arcs, surfaces, and ellipses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.response.dataset import on_board
from coilarray.viz.datasets.meshes import MM_PER_M, polylines

if TYPE_CHECKING:
    import pyvista
    import xarray as xr


COUPLING, DELTA = "k", "delta (1)"
"""Names of the arrays of coupling coefficients and of relative changes of inductance."""

_RISE = 0.3  # height of an arc over its span; neighbours' arcs stay below arcs of coils farther apart
_POINTS_OF_ARC, _SIDES_OF_TUBE = 33, 16
_POINTS_OF_ELLIPSE = 145  # every 2.5°
_DENSE = 4  # points of a draped line in the least step of the map


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


def coupling_arcs(
    centres: npt.ArrayLike, coupling: npt.ArrayLike, *, height: float = 0.0, least: float = 0.0
) -> pyvista.PolyData:
    """Join every pair of coils by an arc in mm.

    `centres` (coils, 2) and the `height` of the ends are in m. A pair with |k| below `least` has no
    arc. Arcs are parabolas that rise by 0.3 of their span, with the cell arrays ``"coil"``,
    ``"other"`` (indices of the coils) and ``"k"``.
    """
    places, k = np.asarray(centres, dtype=np.float64), np.asarray(coupling, dtype=np.float64)
    share = np.linspace(0.0, 1.0, _POINTS_OF_ARC)
    pairs = [(i, j) for i, j in combinations(range(len(places)), 2) if abs(k[i, j]) >= least]
    lines = []
    for start, end in ((places[i], places[j]) for i, j in pairs):
        rise = 4 * _RISE * float(np.linalg.norm(end - start)) * share * (1 - share)
        lines.append(np.column_stack((start + share[:, None] * (end - start), height + rise)))
    arcs = polylines(lines)
    if pairs:
        first, second = np.array(pairs).T
        arcs.cell_data["coil"], arcs.cell_data["other"] = first, second
        arcs.cell_data[COUPLING] = k[first, second]
    return arcs


def arc_tubes(arcs: pyvista.PolyData, widest: float) -> pyvista.PolyData:
    """Give `coupling_arcs` radii in proportion to |k|, `widest` in mm."""
    from coilarray.viz.extra_3d import pyvista

    if not arcs.n_lines:
        return pyvista.PolyData()
    k = arcs.cell_data[COUPLING]
    strongest = max(float(np.abs(k).max()), np.finfo(float).tiny)
    tubes = []
    for n, value in enumerate(k.tolist()):
        line = pyvista.lines_from_points(np.asarray(arcs.get_cell(n).points))
        tube = line.tube(radius=widest * abs(value) / strongest, n_sides=_SIDES_OF_TUBE, capping=True)
        tube.clear_data()
        tube.point_data[COUPLING] = np.full(tube.n_points, value)
        tubes.append(tube)
    merged: pyvista.PolyData = pyvista.merge(tubes)
    return merged


def response_surface(
    response: xr.Dataset,
    state: str,
    depth: int = -1,
    *,
    outlines: Sequence[npt.ArrayLike] = (),
    height: float = 0.0,
    relief: float = 0.0,
    above: float = 0.0,
) -> tuple[pyvista.PolyData, pyvista.PolyData]:
    """Surface of a state's δ with coils' outlines, in mm.

    The point array is ``"delta (1)"``. `height` in m is the height of δ = 0, and `relief` the rise
    at the largest |δ|. `outlines`, corners (n, 2) on the board in m, lie `above` the surface, one
    polyline for each part over the map.
    """
    from scipy.interpolate import RegularGridInterpolator  # half of the import time of this package

    from coilarray.viz.extra_3d import pyvista

    at = on_board(of_state(at_depth(response, depth), state))
    x, y = (np.asarray(at[name].values, dtype=np.float64) for name in ("x", "y"))
    nx, ny = len(x), len(y)
    if min(nx, ny) < 2:
        raise ValueError(f"a map needs at least two positions along x and along y; got {nx} and {ny}.")
    delta = np.asarray(at.delta.transpose("y", "x").values, dtype=np.float64)
    numbers = np.nan_to_num(delta)
    z = height + relief * numbers / max(float(np.abs(numbers).max()), np.finfo(float).tiny)
    first = (np.arange(nx - 1) + nx * np.arange(ny - 1)[:, None]).ravel()
    faces = np.column_stack((np.full_like(first, 4), first, first + 1, first + 1 + nx, first + nx))
    points = np.column_stack((*(axis.ravel() for axis in np.meshgrid(x, y)), z.ravel()))
    surface = pyvista.PolyData(points * MM_PER_M, faces=faces.ravel())
    surface.point_data[DELTA] = delta.ravel()

    height_at = RegularGridInterpolator((y, x), z + above)
    step = float(min(np.diff(x).min(), np.diff(y).min())) / _DENSE
    lines = []
    for outline in outlines:
        dense = shapely.get_coordinates(shapely.segmentize(shapely.LinearRing(np.asarray(outline)), step))
        inside = np.all((dense >= (x[0], y[0])) & (dense <= (x[-1], y[-1])), axis=1)
        for run in np.split(np.arange(len(dense)), np.flatnonzero(np.diff(inside)) + 1):
            if inside[run[0]] and len(run) > 1:
                lines.append(np.column_stack((dense[run], height_at(dense[run][:, ::-1]))))
    return surface, polylines(lines)


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
