"""Flat parts of current paths and their mirror images.

The layers of a planar coil are such parts, and a layer is often another layer turned over. Neumann's integral of two
parts equals the integral of their mirror images, so pairs that differ only by a reflection are computed once.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray, IntArray

BoolArray = npt.NDArray[np.bool_]

MOST_PARTS = 16  # of one path; a path with more parts is not cut
_MIRRORS = np.array(list(itertools.product((1.0, -1.0), repeat=3)))


@dataclass(frozen=True, eq=False)
class PathParts:
    """Parts of several paths and their distinct shapes.

    `tables` are rows of `kernels.paths`, (segments, 12), of the distinct parts from the origin. `flat` and `upright`
    (distinct,) mark the parts at one height, and the parts that run straight up and down. `first` (paths + 1,) is the
    number of the first part of each path, and at the end the number of all parts. Part k is the distinct part
    `number[k]`, mirrored by the signs `mirror[k]` of its coordinates and moved to `origin[k]` in m from the start of
    its path. `sign[k]` is −1 if the current runs the other way.
    """

    tables: list[FloatArray]
    flat: BoolArray
    upright: BoolArray
    first: IntArray
    number: IntArray
    mirror: FloatArray
    sign: FloatArray
    origin: FloatArray


def find_parts(tables: Sequence[FloatArray], quanta: FloatArray) -> PathParts:
    """Cut paths into parts in their order.

    Each path is rows of `kernels.paths`. `quanta` (paths,) are differences in m that do not make another part. Parts of
    different quanta are never equal.
    """
    cut = [_cut(table, quantum) for table, quantum in zip(tables, quanta.tolist(), strict=True)]
    first = np.concatenate(([0], np.cumsum([len(parts) for parts in cut])))
    parts = [part for of_path in cut for part in of_path]
    steps = np.repeat(quanta, np.diff(first))
    points = [_vertices(part) for part in parts]
    spans = np.array([np.abs(p[-1] - p[0]) for p in points])  # the same for a mirror image
    marks = np.column_stack(([float(len(part)) for part in parts], steps, spans, [part[:, 6].sum() for part in parts]))
    slack = np.column_stack((np.zeros((len(parts), 2)), np.outer(steps, (2.0, 2.0, 2.0)), 2.0 * marks[:, 0] * steps))
    number, mirror, sign = np.zeros(len(parts), dtype=np.int64), np.ones((len(parts), 3)), np.ones(len(parts))
    origin = np.array([p[0] for p in points])
    distinct: list[int] = []
    for k, part in enumerate(parts):
        number[k] = len(distinct)
        for candidate in np.flatnonzero((np.abs(marks[distinct] - marks[k]) <= slack[k]).all(axis=1)).tolist():
            found = _image(parts[distinct[candidate]], part, steps[k])
            if found is not None:
                number[k], mirror[k], sign[k] = candidate, *found
                if sign[k] < 0:
                    origin[k] = points[k][-1]
                break
        else:
            distinct.append(k)
    chosen = [_from_origin(parts[k]) for k in distinct]
    height = np.array([np.ptp(points[k][:, 2]) for k in distinct])
    upright = np.array([not table[:, 3:5].any() for table in chosen])
    return PathParts(chosen, height <= steps[distinct], upright, first, number, mirror, sign, origin)


def mirrored(table: FloatArray, mirror: FloatArray) -> FloatArray:
    """Rows of a part whose coordinates get the given signs.

    The lateral direction stays to the left of the current.
    """
    image = table.copy()
    image[:, :3] *= mirror
    image[:, 3:6] *= mirror
    image[:, 7:10] *= mirror * (mirror[0] * mirror[1])
    return image


def _from_origin(table: FloatArray) -> FloatArray:
    return np.ascontiguousarray(np.column_stack((table[:, :3] - table[0, :3], table[:, 3:])))


def _is_level(table: FloatArray) -> BoolArray:
    return np.asarray(table[:, 5] == 0.0)


def _cut(table: FloatArray, quantum: float) -> list[FloatArray]:
    """Cut a path into flat runs of segments at one height, and the rest."""
    level = _is_level(table)
    change = (level[1:] != level[:-1]) | (level[1:] & (np.abs(np.diff(table[:, 2])) > quantum))
    cuts = np.flatnonzero(change) + 1
    return np.split(table, cuts) if len(cuts) < MOST_PARTS else [table]


def _vertices(table: FloatArray) -> FloatArray:
    return np.vstack((table[:, :3], table[-1:, :3] + table[-1:, 3:6] * table[-1:, 6:7]))


def _image(table: FloatArray, other: FloatArray, quantum: float) -> tuple[FloatArray, float] | None:
    """Mirror and current direction that relate two parts, or None."""
    points, sizes = _vertices(table), table[:, [6, 10, 11]]
    others, other_sizes = _vertices(other), other[:, [6, 10, 11]]
    for sign in (1.0, -1.0):
        order = slice(None, None, int(sign))
        if (np.abs(sizes - other_sizes[order]) > quantum).any():
            continue
        steps, other_steps = points - points[0], others[order] - others[order][0]
        for mirror in _MIRRORS:
            if (np.abs(mirror * steps - other_steps) <= quantum).all():
                return mirror, sign
    return None
