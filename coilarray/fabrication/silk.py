"""Places for the coils' names on the silk screen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from coilarray.compute.arrays import FloatArray
from coilarray.geometry.array import Array
from coilarray.geometry.copper import board_outline, disc, drills

# Heights of the letters in m, the first that fits. Below 0.8 mm KiCad warns and screens blur.
_SIZES = (1.0e-3, 0.8e-3)
# The widest letters of KiCad's stroke font are this many heights wide with their gap, descenders
# included so high.
_LETTER_WIDTH = 1.2
_LETTER_HEIGHT = 1.8
# Clearance in m of ink from pads and other names, and from the edge of the board.
_CLEARANCE = 0.15e-3
_EDGE = 0.5e-3
# Spacing in m of the places that are tried.
_STEP = 0.5e-3


@dataclass(frozen=True)
class Label:
    """Middle and letter height of a coil's name, in m."""

    x: float
    y: float
    size: float


def silk_labels(array: Array) -> tuple[Label | None, ...]:
    """Place the coils' names near their centres.

    A name keeps clear of all pads, other names and the edge. It is None if it does not fit within
    the coil's winding.
    """
    holes = [disc(hole.x, hole.y, hole.pad + 2 * _CLEARANCE) for hole in drills(array)]
    inside = board_outline(array).buffer(-_EDGE, join_style="mitre")
    free = shapely.difference(inside, shapely.union_all(holes))
    shapely.prepare(free)
    labels: list[Label | None] = []
    taken = np.zeros((0, 4))
    for placement in array.placements:
        # a grid over the coil's winding, the places nearest to its centre first
        outline = placement.to_board(placement.coil.outline)
        count = np.ceil(0.5 * np.ptp(outline, axis=0) / _STEP).astype(int)
        x, y = np.meshgrid(*(_STEP * np.arange(-n, n + 1) for n in count))
        grid = np.column_stack((x.ravel(), y.ravel()))
        middle = 0.5 * (outline.min(axis=0) + outline.max(axis=0))
        places: FloatArray = middle + grid[np.argsort(np.hypot(*grid.T), kind="stable")]
        label = None
        for size in _SIZES:
            half = 0.5 * np.array([_LETTER_WIDTH * len(placement.name), _LETTER_HEIGHT]) * size
            boxes = np.hstack((places - half, places + half))
            beyond = boxes[:, None, :2] >= taken[:, 2:] + _CLEARANCE
            before = boxes[:, None, 2:] <= taken[:, :2] - _CLEARANCE
            clear = np.all(np.any(beyond | before, axis=2), axis=1)
            fits = np.flatnonzero(shapely.contains(free, shapely.box(*boxes.T)) & clear)
            if len(fits):
                label = Label(float(places[fits[0], 0]), float(places[fits[0], 1]), size)
                taken = np.vstack((taken, boxes[fits[0]]))
                break
        labels.append(label)
    return tuple(labels)
