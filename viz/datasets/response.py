"""A map of the sensor's response as a surface over the board."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from coilarray.viz.datasets.elastomer import at_depth
from coilarray.viz.datasets.triangles import MM_PER_M, polylines

if TYPE_CHECKING:
    import pyvista
    import xarray as xr

FloatArray = npt.NDArray[np.float64]

DELTA = "delta (1)"
"""Name of the point array of relative changes of inductance."""

_DENSE = 4  # points of a draped line in the least step of the map


def response_surface(
    response: xr.Dataset,
    state: str,
    depth: int = -1,
    *,
    origin: tuple[float, float] = (0.0, 0.0),
    height: float = 0.0,
    relief: float = 0.0,
) -> pyvista.PolyData:
    """Drape δ of one state over the positions of the indenter.

    Parameters
    ----------
    response : xarray.Dataset
        ``delta`` (depth, y, x, state) as `coilarray.response.map.response_map` returns it, computed or measured.
    state : str
        Which state of the scan.
    depth : int
        Position of the depth in the dataset; the deepest by default.
    origin : tuple of float
        Place of the map's origin on the board in m.
    height : float
        Of δ = 0 above the board in m.
    relief : float
        Rise in m at the largest |δ|; 0 lays the map flat.

    Returns
    -------
    pyvista.PolyData
        In mm; one quadrilateral between each four positions, with the point array ``"delta (1)"``.

    Raises
    ------
    ValueError
        A state or depth that the map does not have, or fewer than two positions along x or y.
    """
    import pyvista

    x, y, delta = _map_of(response, state, depth)
    nx, ny = len(x), len(y)
    along, across = np.meshgrid(x + origin[0], y + origin[1])
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
    origin: tuple[float, float] = (0.0, 0.0),
    height: float = 0.0,
    relief: float = 0.0,
) -> pyvista.PolyData:
    """Lay outlines of coils on the surface of a map.

    Parameters
    ----------
    response, state, depth, origin, height, relief
        As in `response_surface`.
    outlines : sequence of array_like, shape (n, 2)
        Corners on the board in m.

    Returns
    -------
    pyvista.PolyData
        In mm; what lies over the map, in one polyline or several. Empty where no outline meets it.

    Raises
    ------
    ValueError
        As `response_surface`.
    """
    from scipy.interpolate import RegularGridInterpolator  # half of the time that this package takes to import

    x, y, delta = _map_of(response, state, depth)
    rise = RegularGridInterpolator((y, x), _rise(delta))
    lines = []
    for outline in outlines:
        at = _dense(np.asarray(outline, dtype=np.float64), float(min(np.diff(x).min(), np.diff(y).min())) / _DENSE)
        at = at - origin
        inside = (at[:, 0] >= x[0]) & (at[:, 0] <= x[-1]) & (at[:, 1] >= y[0]) & (at[:, 1] <= y[-1])
        for run in np.split(np.arange(len(at)), np.flatnonzero(np.diff(inside)) + 1):
            if inside[run[0]] and len(run) > 1:
                z = height + relief * rise(at[run][:, ::-1])
                lines.append(np.column_stack((at[run] + origin, z)))
    return polylines(lines)


def _map_of(response: xr.Dataset, state: str, depth: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions along x and y in m, and δ of shape (y, x)."""
    at = at_depth(response, depth)
    states = [str(name) for name in at.state.values]
    if state not in states:
        raise ValueError(f"state must be one of {', '.join(states)}; got {state}.")
    x, y = (np.asarray(at[name].values, dtype=np.float64) for name in ("x", "y"))
    if min(len(x), len(y)) < 2:
        raise ValueError(f"a map needs at least two positions along x and along y; got {len(x)} and {len(y)}.")
    return x, y, np.asarray(at.delta.transpose("y", "x", "state").sel(state=state).values, dtype=np.float64)


def _rise(delta: FloatArray) -> FloatArray:
    """δ over the largest |δ|; 0 where it is NaN."""
    numbers = np.nan_to_num(delta)
    return np.asarray(numbers / max(float(np.abs(numbers).max()), np.finfo(float).tiny))


def _dense(corners: FloatArray, step: float) -> FloatArray:
    """Points of a closed outline, at most a step apart."""
    ring = np.vstack((corners, corners[:1]))
    length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(ring, axis=0), axis=1))]
    places = np.unique(np.r_[np.linspace(0.0, length[-1], math.ceil(length[-1] / step) + 1), length])
    return np.column_stack([np.interp(places, length, ring[:, k]) for k in range(2)])
