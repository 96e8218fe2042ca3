"""Copper in copper: whether the bars of two current paths share space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.errors import GeometryError
from coilarray.geometry.conductor import Conductor
from coilarray.geometry.values import place_in_mm

_TOUCHING = 1e-6  # of the smallest size of both bars: so deep may rounding put one into another that it touches
_AT_ONCE = 1 << 20  # pairs of bars


def require_apart(conductors: Sequence[Conductor]) -> None:
    """Raise GeometryError where bars of two different paths share space, which would be one conductor.

    Bars may touch, and those at whose common end one path goes on as the other may overlap as at a corner, as those of
    one path may. Thin filaments share no space.

    Notes
    -----
    Two boxes are apart where one of 15 axes separates them: the edges of both and their cross products (Gottschalk, Lin
    & Manocha, SIGGRAPH 1996). Only bars of the same height whose bounds overlap are compared.

    Examples
    --------
    >>> first, second = (Conductor([[0, y, 0], [1e-2, y, 0]], 1e-3, 35e-6, name=str(y)) for y in (0.0, 5e-4))
    >>> require_apart([first, second])
    Traceback (most recent call last):
    coilarray.errors.GeometryError: copper of 0.0 and 0.0005 overlaps at (5, 0.25) mm.
    """
    bars = [_Bars(conductor) for conductor in conductors if not conductor.is_filament]
    slabs = [(k, slab) for k, path in enumerate(bars) for slab in path.slabs()]
    if len(bars) < 2:
        return
    boxes = np.array(
        [np.concatenate((bars[k].low[rows].min(axis=0), bars[k].high[rows].max(axis=0))) for k, rows in slabs]
    )
    flat = shapely.box(*boxes[:, [0, 1, 3, 4]].T)
    i, j = shapely.STRtree(flat).query(flat)
    owner = np.array([k for k, _ in slabs])
    wanted = (i < j) & (owner[i] != owner[j]) & (boxes[i, 2] < boxes[j, 5]) & (boxes[j, 2] < boxes[i, 5])
    for a, b in zip(i[wanted].tolist(), j[wanted].tolist(), strict=True):
        (k, rows), (m, others) = slabs[a], slabs[b]
        found = _overlap(bars[k], rows, bars[m], others)
        if found is not None:
            names = f"{bars[k].name} and {bars[m].name}"
            raise GeometryError(f"copper of {names} overlaps at {place_in_mm(found[0], found[1])}.")


class _Bars:
    """Boxes (n,) of a path: centres, unit axes and half sizes (n, 3), (n, 3, 3) and (n, 3), and their bounds."""

    def __init__(self, conductor: Conductor) -> None:
        self.name = conductor.name
        ends = np.diff(conductor.vertices, axis=0)
        along = ends / conductor.lengths[:, None]
        level = np.hypot(along[:, 0], along[:, 1])
        upright = level < 1e-12
        safe = np.where(upright, 1.0, level)
        across = np.column_stack((-along[:, 1] / safe, along[:, 0] / safe, np.zeros(len(along))))
        across[upright] = (1.0, 0.0, 0.0)  # as `Conductor` lays the width of a vertical segment
        self.centre = (conductor.vertices[:-1] + conductor.vertices[1:]) / 2
        self.axes = np.stack((along, across, np.cross(along, across)), axis=1)
        self.half = np.column_stack((conductor.lengths, conductor.widths, conductor.thicknesses)) / 2
        reach = (np.abs(self.axes) * self.half[:, :, None]).sum(axis=1)
        self.low, self.high = self.centre - reach, self.centre + reach

    def slabs(self) -> list[IntArray]:
        """Numbers of the bars that lie at one height, for every height."""
        heights = np.column_stack((self.low[:, 2], self.high[:, 2]))
        step = float(self.half.min()) / 8
        _, of_bar = np.unique(np.round(heights / step), axis=0, return_inverse=True)
        return [np.flatnonzero(of_bar.ravel() == k) for k in range(int(of_bar.max()) + 1)]


def _overlap(one: _Bars, rows: IntArray, other: _Bars, others: IntArray) -> FloatArray | None:
    """Return a point between the first two bars that share space, or None."""
    for start in range(0, len(rows), max(1, _AT_ONCE // len(others))):
        part = rows[start : start + max(1, _AT_ONCE // len(others))]
        near = (one.low[part][:, None] < other.high[others]) & (other.low[others] < one.high[part][:, None])
        i, j = np.nonzero(near.all(axis=2))
        for first in range(0, len(i), _AT_ONCE // 64):
            a, b = part[i[first : first + _AT_ONCE // 64]], others[j[first : first + _AT_ONCE // 64]]
            within = np.flatnonzero(_share_space(one, a, other, b))
            if len(within):
                k = within[0]
                return np.asarray((one.centre[a[k]] + other.centre[b[k]]) / 2)
    return None


def _share_space(one: _Bars, a: IntArray, other: _Bars, b: IntArray) -> npt.NDArray[np.bool_]:
    """Whether bars, pair by pair, overlap by more than touching."""
    P, Q, way = one.axes[a], other.axes[b], other.centre[b] - one.centre[a]
    crossed = np.cross(P[:, :, None], Q[:, None]).reshape(len(a), 9, 3)
    size = np.linalg.norm(crossed, axis=2, keepdims=True)
    parallel = size < 1e-6  # such an axis separates nothing that the edges do not
    crossed = np.where(parallel, P[:, :1], crossed / np.where(parallel, 1.0, size))
    axes = np.concatenate((P, Q, crossed), axis=1)
    reach = np.zeros(axes.shape[:2])
    for bars, chosen, own in ((one, a, P), (other, b, Q)):
        reach += (np.abs(np.einsum("nij,nkj->nik", axes, own)) * bars.half[chosen][:, None]).sum(axis=2)
    depth = reach - np.abs(np.einsum("nij,nj->ni", axes, way))
    least = 2 * np.minimum(one.half[a].min(axis=1), other.half[b].min(axis=1))
    return np.asarray((depth > _TOUCHING * least[:, None]).all(axis=1) & ~_joined(one, a, other, b))


def _joined(one: _Bars, a: IntArray, other: _Bars, b: IntArray) -> npt.NDArray[np.bool_]:
    """Whether one path goes on, pair by pair, where the other ends: the bars share one end of their centre lines."""
    ends, others = (
        bars.centre[chosen][:, None] + bars.axes[chosen, :1] * bars.half[chosen, :1, None] * np.array([[-1.0], [1.0]])
        for bars, chosen in ((one, a), (other, b))
    )
    apart = np.linalg.norm(ends[:, :, None] - others[:, None], axis=3)
    shared = apart <= _TOUCHING * np.minimum(one.half[a, 0], other.half[b, 0])[:, None, None]
    return np.asarray(shared.sum(axis=(1, 2)) == 1)
