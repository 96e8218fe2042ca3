"""The coupling of coils as arcs from centre to centre."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from coilarray.viz.datasets.triangles import polylines

if TYPE_CHECKING:
    import pyvista

COUPLING = "k"
"""Name of the array of coupling coefficients."""

_RISE = 0.3  # height of an arc over its span: neighbours' arcs stay below those of coils farther apart
_POINTS = 33  # of an arc
_SIDES = 16  # of a tube


def coupling_arcs(
    centres: npt.ArrayLike, coupling: npt.ArrayLike, *, height: float = 0.0, least: float = 0.0
) -> pyvista.PolyData:
    """Join every pair of coils by an arc.

    Parameters
    ----------
    centres : array_like, shape (coils, 2)
        In m.
    coupling : array_like, shape (coils, coils)
        Coefficients k = M/√(L L), symmetric.
    height : float
        Of the ends of the arcs in m.
    least : float
        Pairs with a smaller |k| are left out.

    Returns
    -------
    pyvista.PolyData
        In mm; one polyline a pair, parabolas that rise by 0.3 of their span, with the cell arrays ``"coil"``,
        ``"other"`` (positions of the coils) and ``"k"``. Empty where no pair is left.

    Raises
    ------
    ValueError
        A matrix that is not of as many coils as there are centres.

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
        As `coupling_arcs` returns them.
    widest : float
        Radius in mm of the arc of the largest |k|.

    Returns
    -------
    pyvista.PolyData
        In mm; closed tubes with the point array ``"k"``.
    """
    import pyvista

    if not arcs.n_lines:
        return pyvista.PolyData()
    k = arcs.cell_data[COUPLING]
    strongest = max(float(np.abs(k).max()), np.finfo(float).tiny)
    tubes = [
        _tube(np.asarray(arcs.get_cell(n).points), float(one), widest * abs(float(one)) / strongest)
        for n, one in enumerate(k)
    ]
    merged: pyvista.PolyData = pyvista.merge(tubes)
    return merged


def _arc(start: npt.NDArray[np.float64], end: npt.NDArray[np.float64], height: float) -> npt.NDArray[np.float64]:
    """Points of a parabola in an upright plane, in m."""
    share = np.linspace(0.0, 1.0, _POINTS)
    along = start + share[:, None] * (end - start)
    rise = 4 * _RISE * float(np.linalg.norm(end - start)) * share * (1 - share)
    return np.column_stack((along, height + rise))


def _tube(points: npt.NDArray[np.float64], k: float, radius: float) -> pyvista.PolyData:
    import pyvista

    tube: pyvista.PolyData = pyvista.lines_from_points(points).tube(radius=radius, n_sides=_SIDES, capping=True)
    tube.clear_data()
    tube.point_data[COUPLING] = np.full(tube.n_points, k)
    return tube
