"""The coils' field in air at a plate or at its image.

The positions of a plate parallel to the board share a few heights. At heights where the field is smooth enough, far
enough from the copper, it is interpolated on a grid by splines of the fifth order.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import NdBSpline, make_interp_spline

from coilarray.compute.arrays import FloatArray
from coilarray.compute.threads import ranges, run_blocks
from coilarray.electromagnetics.field import magnetic_field
from coilarray.geometry import Conductor
from coilarray.metal.layered_air import ITSELF, Image

ALONE = np.ones((1, 1))  # weights of one image
_STEP = 0.25  # step of the grid over its height above the copper, with an error of some 1e-5 of the field
_MARGIN = 4  # steps of the grid beyond the places
_AT_ONCE = 16384  # places of the splines per task
_IMAGES_AT_ONCE = 2**17  # places in all images together
_SAME_HEIGHT = 1e-9  # of the height


@dataclass(frozen=True, eq=False)
class FieldOfImages:
    """Field B of 1 A in each path's images, summed with `weights` (sums, images).

    At heights of many places the field comes from `splines`, by their height in units of `unit` in m.
    """

    paths: Sequence[Conductor]
    images: Sequence[Image]
    weights: FloatArray
    unit: float
    splines: Mapping[int, NdBSpline]

    def at(self, points: FloatArray) -> FloatArray:
        """Return B in T at points (n, 3) in m, (n, sums, paths, 3)."""
        levels = _levels(points[:, 2], self.unit)
        total = np.zeros((len(points), len(self.weights), len(self.paths), 3))
        direct = np.ones(len(points), dtype=bool)
        for level, spline in self.splines.items():
            here = np.flatnonzero(levels == level)
            if not len(here):
                continue
            direct[here] = False
            pieces = [points[here[start:stop], :2] for start, stop in ranges(len(here), _AT_ONCE)]
            total[here] = np.concatenate(run_blocks(spline, pieces)).reshape(len(here), *total.shape[1:])
        if direct.any():
            total[direct] = _summed(self.paths, points[direct], self.images, self.weights)
        return total


def field_of_images(
    paths: Sequence[Conductor],
    places: FloatArray,
    offsets: FloatArray,
    images: Sequence[Image] = (ITSELF,),
    weights: FloatArray = ALONE,
) -> FieldOfImages:
    """Prepare the field at `offsets` (k, 3) in m from `places` (n, 3)."""
    corners = np.concatenate([path.vertices for path in paths])
    top, bottom = float(corners[:, 2].max()), float(corners[:, 2].min())
    heights = (places[:, None, 2] + offsets[:, 2]).ravel()
    unit = _SAME_HEIGHT * float(np.abs(heights).max())
    levels, first, counts = np.unique(_levels(heights, unit), return_index=True, return_counts=True)
    low = places[:, :2].min(axis=0) + offsets[:, :2].min(axis=0)
    high = places[:, :2].max(axis=0) + offsets[:, :2].max(axis=0)
    splines = {}
    for k in np.flatnonzero(counts > 2 * (2 * _MARGIN) ** 2):  # the smallest grid
        place = np.array([0.0, 0.0, heights[first[k]]])
        seen = [float(image.back.of(place)[2]) for image in images]
        step = _STEP * min(max(z - top, bottom - z) for z in seen)
        if np.prod((high - low) / step + 2 * _MARGIN) > 0.5 * counts[k]:
            continue
        x, y = (start + step * np.arange(-_MARGIN, math.ceil((end - start) / step) + _MARGIN + 1)
                for start, end in zip(low.tolist(), high.tolist(), strict=True))  # fmt: skip
        grid = np.stack(np.meshgrid(x, y, place[2:], indexing="ij"), axis=-1).reshape(-1, 3)
        values = _summed(paths, grid, images, weights).reshape(len(x), len(y), -1)
        along = make_interp_spline(x, values, k=5)
        both = make_interp_spline(y, along.c.swapaxes(0, 1), k=5)
        splines[int(levels[k])] = NdBSpline((along.t, both.t), np.ascontiguousarray(both.c.swapaxes(0, 1)), 5)
    return FieldOfImages(paths, images, weights, unit, splines)


def _levels(heights: FloatArray, unit: float) -> npt.NDArray[np.int64]:
    return np.round(heights / unit).astype(np.int64)


def _summed(paths: Sequence[Conductor], points: FloatArray, images: Sequence[Image], weights: FloatArray) -> FloatArray:
    """Sum B in T over all segments and images, (n, sums, paths, 3)."""
    total = np.zeros((len(points), len(weights), len(paths), 3))
    # B is an axial vector
    turned = np.array([[image.sign, image.sign, 1.0] for image in images])[:, None]
    for start, stop in ranges(len(points), max(_IMAGES_AT_ONCE // len(images), 1)):
        # the field of an image at a place is the mirrored field of the path at the mirrored place
        seen = np.stack([image.back.of(points[start:stop]) for image in images])
        for number, path in enumerate(paths):
            B = np.tensordot(weights, magnetic_field(path, seen) * turned, axes=1)
            total[start:stop, :, number] = B.swapaxes(0, 1)
    return total
