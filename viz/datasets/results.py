"""Results over a board: couplings as arcs, a response as a surface, a position with its ellipse."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.compute.arrays import FloatArray
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
    """Join every pair of coils by an arc.

    Parameters
    ----------
    centres : array_like, shape (coils, 2)
        Centres of the coils in m.
    coupling : array_like, shape (coils, coils)
        Coefficients k = M/√(L L), symmetric.
    height, least : float
        Height of the ends of the arcs in m, and smallest |k| of a pair that has an arc.

    Returns
    -------
    pyvista.PolyData
        Polylines in mm, one per pair. They are parabolas that rise by 0.3 of their span. The cell arrays are
        ``"coil"``, ``"other"`` (indices of the coils) and ``"k"``. Empty if no pair is left.

    Raises
    ------
    ValueError
        If the size of the matrix differs from the number of centres.

    Examples
    --------
    >>> arcs = coupling_arcs([[0, 0], [1e-2, 0]], [[1, -0.1], [-0.1, 1]])
    >>> arcs.n_lines, arcs.bounds[1], float(arcs.cell_data["k"][0])
    (1, 10.0, -0.1)
    """
    places = np.asarray(centres, dtype=np.float64)
    k = np.asarray(coupling, dtype=np.float64)
    if k.shape != (len(places),) * 2:
        raise ValueError(f"{len(places)} coils need a coupling matrix of that size; got shape {k.shape}.")
    pairs = [(i, j) for i, j in combinations(range(len(places)), 2) if abs(k[i, j]) >= least]
    arcs = polylines([_arc(places[i], places[j], height) for i, j in pairs])
    if pairs:
        first, second = np.array(pairs).T
        arcs.cell_data["coil"], arcs.cell_data["other"] = first, second
        arcs.cell_data[COUPLING] = k[first, second]
    return arcs


def arc_tubes(arcs: pyvista.PolyData, widest: float) -> pyvista.PolyData:
    """Give arcs a thickness in proportion to |k|.

    Parameters
    ----------
    arcs : pyvista.PolyData
        Result of `coupling_arcs`.
    widest : float
        Radius in mm of the arc with the largest |k|.

    Returns
    -------
    pyvista.PolyData
        Closed tubes in mm with the point array ``"k"``.
    """
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
    height: float = 0.0,
    relief: float = 0.0,
) -> pyvista.PolyData:
    """Surface of δ of one state over the indenter's positions.

    Parameters
    ----------
    response : xarray.Dataset
        Computed or measured response with ``delta`` (depth, y, x, state), as from
        `coilarray.response.map.response_map`. It lies over its place on the board.
    state, depth : str and int
        Name of the state of the scan, and index of the depth in the dataset. The default is the deepest.
    height, relief : float
        Height of δ = 0 above the board, and rise at the largest |δ| in m. A rise of 0 makes the surface flat.

    Returns
    -------
    pyvista.PolyData
        Surface in mm, with a quadrilateral between each four positions and the point array ``"delta (1)"``.

    Raises
    ------
    ValueError
        If the map has no such state or depth, or fewer than two positions along x or y.
    """
    from coilarray.viz.extra_3d import pyvista

    x, y, delta = _map_of(response, state, depth)
    nx, ny = len(x), len(y)
    along, across = np.meshgrid(x, y)
    z = height + relief * _rise(delta)
    first = (np.arange(nx - 1) + nx * np.arange(ny - 1)[:, None]).ravel()
    faces = np.column_stack((np.full_like(first, 4), first, first + 1, first + 1 + nx, first + nx))
    points = np.column_stack((along.ravel(), across.ravel(), z.ravel()))
    mesh = pyvista.PolyData(points * MM_PER_M, faces=faces.ravel())
    mesh.point_data[DELTA] = delta.ravel()
    return mesh


def draped_outlines(
    response: xr.Dataset,
    state: str,
    outlines: Sequence[npt.ArrayLike],
    depth: int = -1,
    *,
    height: float = 0.0,
    relief: float = 0.0,
) -> pyvista.PolyData:
    """Lay outlines of coils on the surface of a response.

    Parameters
    ----------
    response, state, depth, height, relief
        As in `response_surface`.
    outlines : sequence of array_like, shape (n, 2)
        Corners on the board in m.

    Returns
    -------
    pyvista.PolyData
        Polylines in mm, one for each part of the outlines over the map. Empty if no outline meets the map.

    Raises
    ------
    ValueError
        As `response_surface`.
    """
    from scipy.interpolate import RegularGridInterpolator  # half of the import time of this package

    x, y, delta = _map_of(response, state, depth)
    rise = RegularGridInterpolator((y, x), _rise(delta))
    step = float(min(np.diff(x).min(), np.diff(y).min())) / _DENSE
    lines = []
    for outline in outlines:
        at = _dense(np.asarray(outline, dtype=np.float64), step)
        inside = (at[:, 0] >= x[0]) & (at[:, 0] <= x[-1]) & (at[:, 1] >= y[0]) & (at[:, 1] <= y[-1])
        for run in np.split(np.arange(len(at)), np.flatnonzero(np.diff(inside)) + 1):
            if inside[run[0]] and len(run) > 1:
                z = height + relief * rise(at[run][:, ::-1])
                lines.append(np.column_stack((at[run], z)))
    return polylines(lines)


def semi_axis_factor(confidence: float) -> float:
    """Semi-axes of an ellipse in standard deviations, √ of the quantile of χ² for two degrees of freedom."""
    return math.sqrt(-2 * math.log1p(-confidence))


def uncertainty_ellipse(
    centre: tuple[float, float],
    covariance: npt.ArrayLike,
    confidence: float = 0.95,
    *,
    magnification: float = 1.0,
    height: float = 0.0,
) -> pyvista.PolyData:
    """Ellipse that contains the position with a given probability.

    The errors are Gaussian.

    Parameters
    ----------
    centre : tuple of float
        x and y in m.
    covariance : array_like, shape (2, 2)
        Covariance of x and y in m², symmetric and positive definite.
    confidence : float
        Probability, between 0 and 1.
    magnification, height : float
        Factor by which the ellipse is drawn too large, and its height above the board in m.

    Returns
    -------
    pyvista.PolyData
        One closed polyline in mm.

    Raises
    ------
    ValueError
        If the covariance has another shape or is not positive definite, or the confidence is not between 0 and 1.

    Notes
    -----
    (r − r̂)ᵀ Σ⁻¹ (r − r̂) = q with q the quantile of χ² for two degrees of freedom, −2 ln(1 − confidence). With the
    Cholesky factor Σ = L Lᵀ it is r̂ + √q L (cos t, sin t).

    Examples
    --------
    >>> ellipse = uncertainty_ellipse((0, 0), [[1e-6, 0], [0, 4e-6]])
    >>> [round(edge, 3) for edge in ellipse.bounds[:4]]
    [-2.448, 2.448, -4.895, 4.895]
    """
    sigma = np.asarray(covariance, dtype=np.float64)
    if sigma.shape != (2, 2) or not np.isfinite(sigma).all():
        raise ValueError(f"covariance must be a finite matrix of shape (2, 2); got {sigma.tolist()}.")
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must be between 0 and 1; got {confidence}.")
    try:
        factor = np.linalg.cholesky(sigma)
    except np.linalg.LinAlgError:
        raise ValueError(f"covariance must be positive definite; got {sigma.tolist()}.") from None
    angle = np.linspace(0.0, 2 * np.pi, _POINTS_OF_ELLIPSE)
    circle = np.column_stack((np.cos(angle), np.sin(angle)))
    points = np.asarray(centre) + magnification * semi_axis_factor(confidence) * circle @ factor.T
    return polylines([np.column_stack((points, np.full(_POINTS_OF_ELLIPSE, height)))])


def position_pin(centre: tuple[float, float], bottom: float, top: float) -> pyvista.PolyData:
    """Upright line in mm at a position in m."""
    return polylines([np.array([[*centre, bottom], [*centre, top]])])


def _arc(start: FloatArray, end: FloatArray, height: float) -> FloatArray:
    """Points of a parabola in an upright plane in m."""
    share = np.linspace(0.0, 1.0, _POINTS_OF_ARC)
    along = start + share[:, None] * (end - start)
    rise = 4 * _RISE * float(np.linalg.norm(end - start)) * share * (1 - share)
    return np.column_stack((along, height + rise))


def _map_of(response: xr.Dataset, state: str, depth: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions along x and y in m, and δ (y, x), of a map."""
    at = on_board(of_state(at_depth(response, depth), state))
    x, y = (np.asarray(at[name].values, dtype=np.float64) for name in ("x", "y"))
    if min(len(x), len(y)) < 2:
        raise ValueError(f"a map needs at least two positions along x and along y; got {len(x)} and {len(y)}.")
    return x, y, np.asarray(at.delta.transpose("y", "x").values, dtype=np.float64)


def _rise(delta: FloatArray) -> FloatArray:
    """δ over the largest |δ|, 0 where δ is NaN."""
    numbers = np.nan_to_num(delta)
    return np.asarray(numbers / max(float(np.abs(numbers).max()), np.finfo(float).tiny))


def _dense(corners: FloatArray, step: float) -> FloatArray:
    """Points of a closed outline, at most a step apart."""
    return shapely.get_coordinates(shapely.segmentize(shapely.LinearRing(corners), step))
