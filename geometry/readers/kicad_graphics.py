"""Copper of a KiCad board that is no track: drawn lines and shapes, filled zones."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.errors import BoardError
from coilarray.geometry.readers.arcs import arc_points
from coilarray.geometry.readers.kicad_layers import KicadLayers
from coilarray.geometry.readers.sexpr import Node

Point = tuple[float, float]
ToBoard = Callable[[float, float], Point]  # from the numbers of the file, in mm, to the frame of the board, in m

_DRAWN = {
    "line": "a drawn line",
    "arc": "a drawn arc",
    "circle": "a drawn circle",
    "rect": "a drawn rectangle",
    "poly": "a drawn polygon",
    "curve": "a drawn curve",
}
GRAPHICS = tuple(f"{kind}_{shape}" for kind in ("gr", "fp") for shape in _DRAWN)
"""Names of the nodes that `drawn_copper` and `drawn_outline` take."""

_CURVE_PIECES = 64
_FARTHEST = 1e4  # mm; KiCad itself ends at 2147
_PER_M = 1e3  # numbers in the file are in mm


def drawn_copper(node: Node, layers: KicadLayers, to_board: ToBoard) -> Iterator[tuple[str, BaseGeometry, str]]:
    """Give layer, shape in m and kind of a drawn shape, for every copper layer that it lies on."""
    names = layers.all(node)
    if not names:
        return
    shape = drawn_shape(node, to_board)
    for name in names:
        yield name, shape, _DRAWN[node.name.split("_")[1]]


def drawn_shape(node: Node, to_board: ToBoard) -> BaseGeometry:
    """Return what a drawn shape covers, in m, wherever it lies."""
    kind = node.name.split("_")[1]
    outline = drawn_outline(node, to_board)
    # a line of no width is no copper, unless its inside is filled
    shape: BaseGeometry = shapely.LineString(outline).buffer(max(_width(node) / 2, 1e-9))
    if kind in ("circle", "rect", "poly") and _filled(node, kind) and len(outline) > 3:
        shape = shapely.union(shapely.Polygon(outline).buffer(0), shape)
    return shape


def drawn_outline(node: Node, to_board: ToBoard) -> list[Point]:
    """Return the line that a drawn shape follows, in m; closed shapes end where they begin."""
    kind = node.name.split("_")[1]
    if kind in ("poly", "curve"):
        points = list(_points(node, to_board))
        return _bezier(node, points) if kind == "curve" else [*points, points[0]]
    if kind == "circle":
        centre, rim = to_board(*pair(node.need("center"))), to_board(*pair(node.need("end")))
        opposite = (2 * centre[0] - rim[0], 2 * centre[1] - rim[1])
        return _as_list(arc_points(rim, opposite, rim))
    first, last = pair(node.need("start")), pair(node.need("end"))
    if kind == "arc":
        return _as_list(arc_points(to_board(*first), to_board(*pair(node.need("mid"))), to_board(*last)))
    if kind == "rect":
        corners = (first, (last[0], first[1]), last, (first[0], last[1]), first)
        return [to_board(*corner) for corner in corners]
    return [to_board(*first), to_board(*last)]


def pair(node: Node) -> Point:
    """Return the first two numbers of a node, a place or a size in mm; BoardError for one that no board has."""
    x, y = node.number(0), node.number(1)
    if max(abs(x), abs(y)) > _FARTHEST:
        raise BoardError(f"{node.where}: ({node.name} …) must lie within {_FARTHEST:g} mm; got {x:g}, {y:g}.")
    return x, y


def zone_copper(zone: Node, layers: KicadLayers, to_board: ToBoard) -> Iterator[tuple[str, BaseGeometry, str]]:
    """Give layer, shape in m and kind of every filled area of a zone, or its outline where it is not filled."""
    fills = list(zone.children("filled_polygon"))
    for fill in fills:
        name = layers.one(fill) if fill.child("layer") else next(iter(layers.all(zone)), None)
        if name is not None:
            yield name, _polygon(fill, to_board), "a filled zone"
    if not fills:
        outline = zone.child("polygon")
        shape = shapely.Polygon() if outline is None else _polygon(outline, to_board)
        for name in layers.all(zone):
            yield name, shape, "a zone"


def is_teardrop(zone: Node) -> bool:
    """Whether a zone only widens the end of a track at a pad."""
    attributes = zone.child("attr")
    return attributes is not None and attributes.child("teardrop") is not None


def _polygon(node: Node, to_board: ToBoard) -> BaseGeometry:
    points = list(_points(node, to_board))
    return shapely.Polygon(points).buffer(0) if len(points) > 2 else shapely.Polygon()


def _points(node: Node, to_board: ToBoard) -> Iterator[Point]:
    points = node.need("pts")
    for item in points.children("xy", "arc"):
        if item.name == "xy":
            yield to_board(*pair(item))
        else:
            start, middle, end = (to_board(*pair(item.need(name))) for name in ("start", "mid", "end"))
            yield from _as_list(arc_points(start, middle, end))
    if not points.items:
        raise BoardError(f"{points.where}: (pts …) must have points; got none.")


def _bezier(node: Node, points: list[Point]) -> list[Point]:
    if len(points) != 4:
        raise BoardError(f"{node.where}: a curve must have 4 points; got {len(points)}.")
    p0, p1, p2, p3 = np.array(points)
    t = np.linspace(0, 1, _CURVE_PIECES + 1)[:, None]
    return _as_list(p0 * (1 - t) ** 3 + 3 * p1 * t * (1 - t) ** 2 + 3 * p2 * t**2 * (1 - t) + p3 * t**3)


def _as_list(points: npt.NDArray[np.float64]) -> list[Point]:
    return [(x, y) for x, y in points.tolist()]


def _width(node: Node) -> float:
    stroke = node.child("stroke") or node
    width = stroke.child("width")
    return 0.0 if width is None else width.number() / _PER_M


def _filled(node: Node, kind: str) -> bool:
    fill = node.child("fill")
    return kind == "poly" if fill is None else fill.text() in ("solid", "yes")
