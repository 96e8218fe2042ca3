"""Shapes of the pads in KiCad's footprints."""

from __future__ import annotations

import math

import numpy as np
import shapely
from shapely import affinity
from shapely.geometry.base import BaseGeometry

from coilarray.geometry.readers.kicad_graphics import GRAPHICS, Point, ToBoard, drawn_shape, pair
from coilarray.geometry.readers.sexpr import Node

_PER_M = 1e3  # numbers in the file are in mm


def pad_shape(pad: Node, to_board: ToBoard) -> BaseGeometry:
    """Return what a pad covers, in m in the frame of the board; of a shape that is not known, its rectangle.

    Parameters
    ----------
    pad : Node
        Its (pad …).
    to_board : callable
        From the footprint's frame.
    """
    place = pad.need("at")
    x0, y0 = to_board(*pair(place))
    turn = math.radians(place.number(2)) if len(place.words) > 2 else 0.0  # on the sheet, not in the footprint
    c, s = math.cos(turn), math.sin(turn)

    def of_pad(x: float, y: float) -> Point:
        """From the pad's own frame in mm, y down."""
        return x0 + (c * x + s * y) / _PER_M, y0 + (s * x - c * y) / _PER_M

    drill = pad.child("drill")
    offset = None if drill is None else drill.child("offset")
    x, y = (0.0, 0.0) if offset is None else pair(offset)
    flat = affinity.translate(_flat(pad), x, y)
    shapes = [shapely.transform(flat, lambda at: np.array([of_pad(x, y) for x, y in at.tolist()]))]
    primitives = pad.child("primitives")
    if primitives is not None:
        shapes += [drawn_shape(node, of_pad) for node in primitives.children(*GRAPHICS)]
    return shapely.union_all(shapes)


def _flat(pad: Node) -> BaseGeometry:
    """Shape about the origin, in mm, neither turned nor moved."""
    width, height = pair(pad.need("size"))
    kind = pad.text(2) if len(pad.words) > 2 else "rect"
    if kind in ("circle", "oval"):
        length = abs(width - height) / 2 if kind == "oval" else 0.0
        way = (length, 0.0) if width > height else (0.0, length)
        line = shapely.LineString((way, (-way[0], -way[1])))
        return line.buffer((width if kind == "circle" else min(width, height)) / 2, quad_segs=32)
    delta = pad.child("rect_delta")  # of a trapezoid
    wider, higher = (0.0, 0.0) if delta is None else pair(delta)[::-1]
    x, y = (width + abs(wider)) / 2, (height + abs(higher)) / 2
    box = shapely.box(-x, -y, x, y)
    ratio = pad.child("roundrect_rratio")
    radius = 0.0 if ratio is None or kind != "roundrect" else min(ratio.number(), 0.5) * min(width, height)
    return box.buffer(-radius * 0.999).buffer(radius * 0.999, quad_segs=32)
