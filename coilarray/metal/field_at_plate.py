"""The coils' field in air where a plate is, or where the image of one is.

Many places of a plate parallel to the board share a few heights, so there the field is taken from a grid by splines of
the fifth order, as far from the copper as it is smooth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.interpolate import NdBSpline, make_interp_spline

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.compute.threads import ranges, run_blocks
from coilarray.electromagnetics.field import magnetic_field
from coilarray.geometry import Conductor

_STEP = 0.25  # of the grid, of its height over the copper: errs by some 1e-5 of the field
_MARGIN = 4  # steps around the places
_AT_ONCE = 16384  # places of the splines a task
_SAME_HEIGHT = 1e-9  # of the height


def field_at(paths: Sequence[Conductor], points: FloatArray) -> FloatArray:
    """B in T of 1 A in each path at points (n, 3) in m beyond the copper; (paths, n, 3)."""
    corners = np.concatenate([path.vertices for path in paths])
    top, bottom = float(corners[:, 2].max()), float(corners[:, 2].min())
    levels = np.round(points[:, 2] / (_SAME_HEIGHT * np.abs(points[:, 2]).max())).astype(np.int64)
    _, first, level = np.unique(levels, return_index=True, return_inverse=True)
    total = np.zeros((len(paths), *points.shape))
    x0, y0 = points[:, :2].min(axis=0)
    x1, y1 = points[:, :2].max(axis=0)
    direct = np.zeros(len(points), dtype=bool)
    for number, z in enumerate(points[first, 2].tolist()):
        here = np.flatnonzero(level == number)
        step = _STEP * max(z - top, bottom - z)
        if ((x1 - x0) / step + 2 * _MARGIN) * ((y1 - y0) / step + 2 * _MARGIN) > 0.5 * len(here):
            direct[here] = True
            continue
        x, y = (low + step * np.arange(-_MARGIN, math.ceil((high - low) / step) + _MARGIN + 1)
                for low, high in ((x0, x1), (y0, y1)))  # fmt: skip
        grid = np.stack(np.meshgrid(x, y, [z], indexing="ij"), axis=-1).reshape(-1, 3)
        values = np.moveaxis(_summed(paths, grid), 0, 1).reshape(len(x), len(y), -1)
        along = make_interp_spline(x, values, k=5)
        both = make_interp_spline(y, along.c.swapaxes(0, 1), k=5)
        spline = NdBSpline((along.t, both.t), np.ascontiguousarray(both.c.swapaxes(0, 1)), 5)
        pieces = [here[start:stop] for start, stop in ranges(len(here), _AT_ONCE)]

        def at(some: IntArray, spline: NdBSpline = spline) -> FloatArray:
            return np.asarray(spline(points[some, :2]))

        found = run_blocks(at, pieces)
        total[:, here] = np.moveaxis(np.concatenate(found).reshape(len(here), len(paths), 3), 1, 0)
    if direct.any():
        total[:, direct] = _summed(paths, points[direct])
    return total


def _summed(paths: Sequence[Conductor], points: FloatArray) -> FloatArray:
    """B (paths, n, 3) in T by sums over the segments."""
    return np.stack([magnetic_field(path, points) for path in paths])
