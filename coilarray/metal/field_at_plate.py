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
from coilarray.metal.layered_air import ITSELF, Image

ALONE = np.ones((1, 1))
"""Weights of one image."""
_STEP = 0.25  # of the grid, of its height over the copper: errs by some 1e-5 of the field
_MARGIN = 4  # steps around the places
_AT_ONCE = 16384  # places of the splines a task
_SAME_HEIGHT = 1e-9  # of the height


def field_at(
    paths: Sequence[Conductor], points: FloatArray, images: Sequence[Image] = (ITSELF,), weights: FloatArray = ALONE
) -> FloatArray:
    """B in T of 1 A in each path's images at points (n, 3) in m, (sums, paths, n, 3).

    The images lie beyond the copper from there, and are summed with `weights` (sums, images).
    """
    corners = np.concatenate([path.vertices for path in paths])
    top, bottom = float(corners[:, 2].max()), float(corners[:, 2].min())
    levels = np.round(points[:, 2] / (_SAME_HEIGHT * np.abs(points[:, 2]).max())).astype(np.int64)
    _, first, level = np.unique(levels, return_index=True, return_inverse=True)
    total = np.zeros((len(weights), len(paths), *points.shape))
    x0, y0 = points[:, :2].min(axis=0)
    x1, y1 = points[:, :2].max(axis=0)
    direct = np.zeros(len(points), dtype=bool)
    for number, place in enumerate(points[first]):
        here = np.flatnonzero(level == number)
        seen = [float(image.back.of(place)[2]) for image in images]
        step = _STEP * min(max(z - top, bottom - z) for z in seen)
        if ((x1 - x0) / step + 2 * _MARGIN) * ((y1 - y0) / step + 2 * _MARGIN) > 0.5 * len(here):
            direct[here] = True
            continue
        x, y = (low + step * np.arange(-_MARGIN, math.ceil((high - low) / step) + _MARGIN + 1)
                for low, high in ((x0, x1), (y0, y1)))  # fmt: skip
        grid = np.stack(np.meshgrid(x, y, place[2:], indexing="ij"), axis=-1).reshape(-1, 3)
        values = np.moveaxis(_summed(paths, grid, images, weights), 2, 0).reshape(len(x), len(y), -1)
        along = make_interp_spline(x, values, k=5)
        both = make_interp_spline(y, along.c.swapaxes(0, 1), k=5)
        spline = NdBSpline((along.t, both.t), np.ascontiguousarray(both.c.swapaxes(0, 1)), 5)
        pieces = [here[start:stop] for start, stop in ranges(len(here), _AT_ONCE)]

        def at(some: IntArray, spline: NdBSpline = spline) -> FloatArray:
            return np.asarray(spline(points[some, :2]))

        found = np.concatenate(run_blocks(at, pieces)).reshape(len(here), len(weights), len(paths), 3)
        total[:, :, here] = np.moveaxis(found, 0, 2)
    if direct.any():
        total[:, :, direct] = _summed(paths, points[direct], images, weights)
    return total


def _summed(paths: Sequence[Conductor], points: FloatArray, images: Sequence[Image], weights: FloatArray) -> FloatArray:
    """B (sums, paths, n, 3) in T by sums over the segments."""
    total = np.zeros((len(weights), len(paths), *points.shape))
    for image, shares in zip(images, weights.T, strict=True):
        # where the image sends its field is where the path sends it, mirrored; B is an axial vector
        seen, turned = image.back.of(points), [image.sign, image.sign, 1.0]
        for number, path in enumerate(paths):
            total[:, number] += shares[:, None, None] * (magnetic_field(path, seen) * turned)
    return total
