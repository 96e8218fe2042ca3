"""Copper of KiCad boards and footprints, and S-expressions that know their lines."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely
from shapely import affinity
from shapely.geometry.base import BaseGeometry

from coilarray.compute.arrays import FloatArray
from coilarray.compute.files import text_of_file
from coilarray.errors import BoardError, GeometryError
from coilarray.fabrication.board import (
    BoardCopper,
    Copper,
    CopperArea,
    Hole,
    Slab,
    SurfacePad,
    Track,
    completed_stackup,
)
from coilarray.geometry.arcs import Point, arc_points
from coilarray.geometry.copper import disc
from coilarray.geometry.stackup import Stackup

OLDEST_VERSION = 20171130  # format of KiCad 5
NEWEST_VERSION = 20260206  # format of KiCad 10, the newest that this reader knows
_PER_M = 1e3  # numbers in the file are in mm
_COPPER = re.compile(r"F\.Cu|In(\d+)\.Cu|B\.Cu")
_DRAWN = {"line": "line", "arc": "arc", "circle": "circle", "rect": "rectangle", "poly": "polygon", "curve": "curve"}
_NO_COPPER = ("generated", "image", "layer", "pad")  # copper elsewhere in the file
GRAPHICS = tuple(f"{kind}_{shape}" for kind in ("gr", "fp") for shape in _DRAWN)
ToBoard = Callable[[float, float], Point]  # from mm of the file to m on the board


def read_kicad(path: Path, stackup: Stackup | None = None) -> BoardCopper:
    """Read the conductors of a KiCad board or footprint from its drill origin, y up.

    Arcs are divided into pieces within 0.9 µm of them. Drawn lines, arcs and curves of the board,
    of footprints and of custom pads are tracks, drawn polygons are areas. Formats of KiCad 5 to 10
    are known; others are read as far as they are understood, with a note. Texts, dimensions, zones
    without a fill and unknown objects on copper are left out with a note.
    """
    root = read_sexpr(path)
    if root.name in ("footprint", "module"):
        root = _around_footprint(root)
    if root.name != "kicad_pcb":
        raise BoardError(
            f"{root.where}: a KiCad board begins with (kicad_pcb and a footprint with (footprint; this file begins "
            f"with ({root.name[:40]}."
        )
    notes = []
    version = root.child("version")
    number = OLDEST_VERSION if version is None else version.number()
    if not OLDEST_VERSION <= number <= NEWEST_VERSION:
        notes.append(
            f"The board has KiCad's format {number:.0f}; formats other than those of KiCad 5 to 10 "
            f"({OLDEST_VERSION} to {NEWEST_VERSION}) are untested."
        )
    nets = {node.text(0): node.text(1) for node in root.children("net") if len(node.words) > 1}  # none in KiCad 10
    origin = root.child("setup", "aux_axis_origin")
    board = _Board(*read_layers(root, stackup), nets, (0.0, 0.0) if origin is None else pair(origin))
    found: list[Copper] = []
    outline: list[Point] = []
    for node in root.items:
        if not isinstance(node, Node):
            continue
        if node.name in ("segment", "arc"):
            found += board.tracks(node)
        elif node.name == "via":
            found.append(board.via(node))
        elif node.name in ("footprint", "module"):
            to_board, part, value = board.footprint(node), *_reference(node)
            for item in node.items:
                if not isinstance(item, Node):
                    continue
                if item.name == "pad":
                    found += board.pad(item, to_board, part, value)
                else:
                    found += board.drawn(item, to_board, part)
                    outline += board.outline(item, to_board)
        else:
            found += board.drawn(node, board.to_board)
            outline += board.outline(node, board.to_board)
    edge = shapely.MultiPoint(outline).bounds if outline else None
    tracks = tuple(item for item in found if isinstance(item, Track))
    holes = tuple(item for item in found if isinstance(item, Hole))
    pads = tuple(item for item in found if isinstance(item, SurfacePad))
    areas = tuple(item for item in found if isinstance(item, CopperArea) and not item.shape.is_empty)
    bare = Counter(item.what for item in found if isinstance(item, CopperArea) and item.shape.is_empty)
    if bare:
        left_out = ", ".join(f"{count} × {what}" for what, count in bare.items())
        notes.append(f"Copper that is not followed is left out: {left_out}.")
    return BoardCopper(str(path), board.stackup, tracks, holes, pads, board.assumed, areas, edge, tuple(notes))


def _around_footprint(footprint: Node) -> Node:
    """Return a board that has only a footprint, with the layers that it names."""
    on = (layer for item in footprint.items if isinstance(item, Node) for layer in item.children("layer", "layers"))
    named = [match for layer in on for word in layer.words if (match := _COPPER.fullmatch(word))]
    inner = max((int(match[1] or 0) for match in named), default=0)
    names = ["F.Cu", *(f"In{k}.Cu" for k in range(1, inner + 1)), "B.Cu"]
    rows = tuple(Node(str(k), (name, "signal"), footprint.where) for k, name in enumerate(names))
    return Node("kicad_pcb", (Node("layers", rows, footprint.where), footprint), footprint.where)


def _reference(footprint: Node) -> tuple[str, str]:
    """Return the reference of a footprint ("U1") and its value, empty if it has none."""
    found = {"reference": "", "value": ""}
    for node in footprint.children("fp_text", "property"):
        if len(node.words) > 1 and node.words[0].lower() in found:
            found[node.words[0].lower()] = node.words[1]
    reference = found["reference"]
    return "" if reference in ("REF**", "${REFERENCE}") else reference, found["value"]


@dataclass(frozen=True)
class _Board:
    """Context of a file: layers, nets, and origin in mm."""

    stackup: Stackup
    names: dict[str, str]  # names of the stack-up, which the user gave, by KiCad's layers (F.Cu, In1.Cu, …, B.Cu)
    assumed: dict[str, str]
    nets: dict[str, str]
    origin: Point

    def one_layer(self, node: Node) -> str | None:
        """Return a node's copper layer, or None."""
        if node.child("layers") is None:
            node.need("layer")
        found = self.layers(node)
        if len(found) > 1:
            raise BoardError(f"{node.where}: ({node.name} …) must lie on one copper layer; got {', '.join(found)}.")
        return found[0] if found else None

    def layers(self, node: Node) -> tuple[str, ...]:
        """Return the copper layers of a node, top to bottom."""
        words = {word for found in node.children("layers", "layer") for word in found.words}
        if "*.Cu" in words:
            return self.stackup.names
        if "F&B.Cu" in words:
            words |= {"F.Cu", "B.Cu"}
        layers = [word for word in words if _COPPER.fullmatch(word)]
        for layer in layers:
            if layer not in self.names:
                known = ", ".join(self.names)
                raise BoardError(f"{node.where}: there is no copper layer {layer}; the board has {known}.")
        found = {self.names[layer] for layer in layers}
        return tuple(name for name in self.stackup.names if name in found)

    def to_board(self, x: float, y: float) -> Point:
        """Transform mm with y down to m with y up."""
        return (x - self.origin[0]) / _PER_M, (self.origin[1] - y) / _PER_M

    def footprint(self, node: Node) -> ToBoard:
        """Return the transformation from a footprint (mm) to the board (m)."""
        place = node.child("at")  # none in a library
        x0, y0 = (0.0, 0.0) if place is None else pair(place)
        turn = 0.0 if place is None or len(place.words) < 3 else math.radians(place.number(2))
        c, s = math.cos(turn), math.sin(turn)

        def to_board(x: float, y: float) -> Point:
            return self.to_board(x0 + c * x + s * y, y0 - s * x + c * y)

        return to_board

    def net(self, node: Node) -> str | None:
        """Return the net of a node by name or number."""
        net = node.child("net")
        if net is None:
            return None
        word = net.text()
        if isinstance(word, Quoted) or not word.isdecimal():
            return str(word) or None
        if word not in self.nets and word != "0":
            raise BoardError(f"{net.where}: net {word} is not in the board's list of nets.")
        return self.nets.get(word) or None

    def tracks(self, node: Node) -> Iterator[Track]:
        """Yield the straight pieces of a segment or an arc."""
        layer = self.one_layer(node)
        if layer is None:
            got = " ".join(word for part in node.children("layer", "layers") for word in part.words)
            raise BoardError(f"{node.where}: a track must lie on a copper layer; got {got or 'none'}.")
        width = _positive(node.need("width")) / _PER_M
        start, end = (self.to_board(*pair(node.need(name))) for name in ("start", "end"))
        points: list[Point] = [start, end]
        if node.name == "arc":
            points = _as_list(arc_points(start, self.to_board(*pair(node.need("mid"))), end))
        net = self.net(node)
        for first, last in pairwise(points):
            yield Track(layer, first, last, width, net, node.where)

    def via(self, node: Node) -> Hole:
        """Return a via as a hole through its layers."""
        x, y = self.to_board(*pair(node.need("at")))
        ends = self.layers(node)
        if len(ends) < 2 and len(self.names) > 1:
            raise BoardError(f"{node.where}: a via must join two copper layers; got {' '.join(ends) or 'none'}.")
        layers = self.stackup.between(ends[0], ends[-1])
        drill, size = _positive(node.need("drill")) / _PER_M, _positive(node.need("size")) / _PER_M
        shapes = _kept(node, dict.fromkeys(layers, disc(x, y, size)), disc(x, y, drill))
        return Hole(x, y, drill, size, layers, self.net(node), "via", node.where, shapes=shapes)

    def pad(self, node: Node, to_board: ToBoard, part: str = "", value: str = "") -> Iterator[Copper]:
        """Yield a pad as hole or surface pads by layer, and what is drawn in it."""
        number, kind = node.text(0), node.text(1)
        if kind == "np_thru_hole":
            return
        x, y = to_board(*pair(node.need("at")))
        size = min(pair(node.need("size"))) / _PER_M
        net, layers = self.net(node), self.layers(node)
        shape, of_pad = pad_shape(node, to_board)
        primitives = node.child("primitives")
        for item in () if primitives is None else primitives.children(*GRAPHICS):
            yield from self.graphic(item, of_pad, layers, net, part, " in a pad")
        if kind != "thru_hole":
            for layer in layers:
                yield SurfacePad(x, y, layer, net, node.where, number, size, shape, part, value)
            return
        drill = node.need("drill")
        # of a slot, (drill oval 1 0.5), the smaller side
        diameters = [drill.number(k) for k, word in enumerate(drill.words) if word != "oval"]
        if not diameters or min(diameters) <= 0:
            raise BoardError(
                f"{drill.where}: a plated hole must have a positive diameter; got {' '.join(drill.words)}."
            )
        layers_between = self.stackup.between(layers[0], layers[-1]) if layers else self.stackup.names
        bore = min(diameters) / _PER_M
        shapes = _kept(node, dict.fromkeys(layers, shape), disc(x, y, bore))
        yield Hole(x, y, bore, size, layers_between, net, "pad", node.where, number, shapes, part, value)

    def drawn(self, node: Node, to_board: ToBoard, part: str = "") -> Iterator[Track | CopperArea]:
        """Yield a zone or drawn shape by layer, or other copper without a shape."""
        net = self.net(node) if node.name != "net" else None
        names = self.layers(node)
        hidden = any(
            "hide" in part.words or any(hide.words[:1] != ("no",) for hide in part.children("hide"))
            for part in (node, *node.children("effects"))
        )
        if node.name in GRAPHICS:
            yield from self.graphic(node, to_board, names, net, part) if names else ()
        elif node.name == "zone":
            yield from self.zone(node, names, net) if node.child("keepout") is None else ()
        elif (names or net is not None) and node.name not in _NO_COPPER and not hidden:
            yield CopperArea("", shapely.Polygon(), net, f"({node.name} …)", node.where)

    def graphic(
        self, node: Node, to_board: ToBoard, layers: Sequence[str], net: str | None, part: str, where: str = ""
    ) -> Iterator[Track | CopperArea]:
        """Yield a drawn shape as tracks along its line, or as an area if it is filled."""
        what = f"a drawn {_DRAWN[node.name.split('_')[1]]}{where}"
        outline, width, filled = drawn_shape(node, to_board)
        if filled:
            shape: BaseGeometry = shapely.Polygon(outline).buffer(0)
            shape = shape | shapely.LineString(outline).buffer(width / 2) if width > 0 else shape
            yield from (
                CopperArea(layer, each, net, what, node.where, part)
                for layer in layers for each in shapely.get_parts(shape).tolist()
            )  # fmt: skip
        elif width > 0:
            for layer in layers:
                for first, last in pairwise(outline):
                    yield Track(layer, first, last, width, net, node.where, what, part)

    def zone(self, zone: Node, names: tuple[str, ...], net: str | None) -> Iterator[CopperArea]:
        """Yield the filled areas of a zone, without a shape if it has none."""
        fills = list(zone.children("filled_polygon"))
        for fill in fills:
            name = self.one_layer(fill) if fill.child("layer") else next(iter(names), None)
            if name is not None:
                yield CopperArea(name, _polygon(fill, self.to_board), net, "a filled zone", zone.where)
        if not fills and names:
            yield CopperArea("", shapely.Polygon(), net, "zone without a fill", zone.where)

    def outline(self, node: Node, to_board: ToBoard) -> list[Point]:
        """Return points of a shape on the board's edge layer."""
        on_edge = any("Edge.Cuts" in part.words for part in node.children("layer", "layers"))
        return drawn_outline(node, to_board) if on_edge and node.name in GRAPHICS else []


def _kept(node: Node, shapes: dict[str, BaseGeometry], barrel: BaseGeometry) -> dict[str, BaseGeometry]:
    """Return the pads of a hole, its barrel where KiCad may leave one out without a track."""
    removed = node.child("remove_unused_layers")
    if removed is None or removed.words[:1] == ("no",):
        return shapes
    keep = node.child("keep_end_layers")
    ends = list(shapes)[:: max(len(shapes) - 1, 1)] if keep is not None and keep.words[:1] != ("no",) else []
    return {layer: shape if layer in ends else barrel for layer, shape in shapes.items()}


def _positive(node: Node) -> float:
    value = node.number()
    if value <= 0:
        raise BoardError(f"{node.where}: ({node.name} …) must be positive; got {value:g}.")
    return value


def read_layers(root: Node, stackup: Stackup | None = None) -> tuple[Stackup, dict[str, str], dict[str, str]]:
    """Read the stack-up, the names and the assumed values of a `_Board`."""
    table = root.need("layers")
    user_names = {}
    depths = {"F.Cu": 0.0, "B.Cu": math.inf}
    for node in table.items:
        if isinstance(node, Node) and (match := _COPPER.fullmatch(node.text())):
            words = node.words
            user_names[str(words[0])] = str(words[2]) if len(words) > 2 else str(words[0])
            depths.setdefault(str(words[0]), float(match[1] or 0))
    order = sorted(user_names, key=depths.__getitem__)
    if not order:
        raise BoardError(f"{table.where}: the board has no copper layer.")
    if stackup is not None:
        if len(stackup.names) != len(order):
            raise BoardError(
                f"{table.where}: the board has {len(order)} copper layers and the given stack-up {len(stackup.names)}."
            )
        return stackup, dict(zip(order, stackup.names, strict=True)), {}
    assumed: dict[str, str] = {}
    given = root.child("setup", "stackup")
    thicknesses: list[float | None] = [None] * len(order)
    slabs: list[list[Slab]] = [[(None, None)]] * (len(order) - 1)
    if given is not None:
        thicknesses, slabs = _given(given, order)
    whole = root.child("general", "thickness")
    board = None if whole is None else whole.number() / _PER_M
    names = [user_names[name] for name in order]
    try:
        built = completed_stackup(names, thicknesses, slabs, board, "the board file does", assumed)
    except GeometryError as error:
        raise BoardError(f"{(given or whole or table).where}: {error}") from None
    return built, {name: user_names[name] for name in order}, assumed


def _given(given: Node, order: list[str]) -> tuple[list[float | None], list[list[Slab]]]:
    """Thicknesses of copper, None if unknown, and the dielectrics between."""
    copper: dict[str, float | None] = {}
    slabs: list[list[Slab]] = []
    for layer in given.children("layer"):
        if _COPPER.fullmatch(layer.text()):
            copper[layer.text()] = next((thickness for thickness, _ in _sublayers(layer)), None)
            slabs.append([])
        elif slabs:
            slabs[-1] += [slab for slab in _sublayers(layer) if slab != (None, None)]
    if list(copper) != order:
        raise BoardError(
            f"{given.where}: the stack-up must list the copper layers {', '.join(order)}; got {', '.join(copper)}."
        )
    return list(copper.values()), slabs[:-1]


def _sublayers(layer: Node) -> Iterator[Slab]:
    """Yield thickness in m and permittivity of every sublayer."""
    thickness = epsilon = None
    for item in layer.items:
        if item == "addsublayer":
            yield thickness, epsilon
            thickness = epsilon = None
        elif isinstance(item, Node) and item.name == "thickness":
            thickness = item.number() / _PER_M
        elif isinstance(item, Node) and item.name == "epsilon_r":
            epsilon = item.number()
    yield thickness, epsilon


_CURVE_PIECES = 64
_FARTHEST = 1e4  # mm: KiCad itself ends at 2147


def drawn_shape(node: Node, to_board: ToBoard) -> tuple[list[Point], float, bool]:
    """Line in m that a drawn shape on any layer follows, its width in m, and whether it is filled."""
    kind = node.name.split("_")[1]
    outline = drawn_outline(node, to_board)
    stroke, fill = (node.child("stroke") or node).child("width"), node.child("fill")
    filled = kind == "poly" if fill is None else fill.text() in ("solid", "yes")
    width = 0.0 if stroke is None else stroke.number() / _PER_M
    return outline, width, kind in ("circle", "rect", "poly") and filled and len(outline) > 3


def drawn_outline(node: Node, to_board: ToBoard) -> list[Point]:
    """Line in m that a drawn shape follows."""
    kind = node.name.split("_")[1]
    if kind == "poly":
        points = list(_points(node, to_board))
        return [*points, points[0]]
    if kind == "curve":
        points = list(_points(node, to_board))
        if len(points) != 4:
            raise BoardError(f"{node.where}: a curve must have 4 points; got {len(points)}.")
        p0, p1, p2, p3 = np.array(points)
        t = np.linspace(0, 1, _CURVE_PIECES + 1)[:, None]
        return _as_list(p0 * (1 - t) ** 3 + 3 * p1 * t * (1 - t) ** 2 + 3 * p2 * t**2 * (1 - t) + p3 * t**3)
    if kind == "circle":
        centre, rim = to_board(*pair(node.need("center"))), to_board(*pair(node.need("end")))
        opposite = (2 * centre[0] - rim[0], 2 * centre[1] - rim[1])
        return _as_list(arc_points(rim, opposite, rim))
    first, last = pair(node.need("start")), pair(node.need("end"))
    if kind == "arc" and node.child("mid") is None:  # KiCad 5 has the centre, the start and the angle, clockwise
        angle = math.radians(node.need("angle").number())
        x, y = last[0] - first[0], last[1] - first[1]
        on_arc = [
            (first[0] + x * math.cos(a) - y * math.sin(a), first[1] + x * math.sin(a) + y * math.cos(a))
            for a in (0.0, angle / 2, angle)
        ]
        begin, middle, end = (to_board(*place) for place in on_arc)
        return _as_list(arc_points(begin, middle, end))
    if kind == "arc":
        return _as_list(arc_points(to_board(*first), to_board(*pair(node.need("mid"))), to_board(*last)))
    if kind == "rect":
        corners = (first, (last[0], first[1]), last, (first[0], last[1]), first)
        return [to_board(*corner) for corner in corners]
    return [to_board(*first), to_board(*last)]


def pair(node: Node) -> Point:
    """Return the first two numbers of a node, in mm."""
    x, y = node.number(0), node.number(1)
    if max(abs(x), abs(y)) > _FARTHEST:
        raise BoardError(f"{node.where}: ({node.name} …) must lie within {_FARTHEST:g} mm; got {x:g}, {y:g}.")
    return x, y


def _polygon(node: Node, to_board: ToBoard) -> BaseGeometry:
    points = list(_points(node, to_board))
    return shapely.Polygon(points).buffer(0) if len(points) > 2 else shapely.Polygon()


def _points(node: Node, to_board: ToBoard) -> Iterator[Point]:
    """Yield the points of a node's (pts …) in m, arcs divided."""
    points = node.need("pts")
    for item in points.children("xy", "arc"):
        if item.name == "xy":
            yield to_board(*pair(item))
        else:
            start, middle, end = (to_board(*pair(item.need(name))) for name in ("start", "mid", "end"))
            yield from _as_list(arc_points(start, middle, end))
    if not points.items:
        raise BoardError(f"{points.where}: (pts …) must have points; got none.")


def _as_list(points: FloatArray) -> list[Point]:
    return [(x, y) for x, y in points.tolist()]


def pad_shape(pad: Node, to_board: ToBoard) -> tuple[BaseGeometry, ToBoard]:
    """Area in m of a pad, a rectangle by default, and the transformation from its own frame."""
    place = pad.need("at")
    x0, y0 = to_board(*pair(place))
    turn = math.radians(place.number(2)) if len(place.words) > 2 else 0.0  # on the sheet
    c, s = math.cos(turn), math.sin(turn)

    def of_pad(x: float, y: float) -> Point:
        """Transform from the pad's own frame in mm, y down."""
        return x0 + (c * x + s * y) / _PER_M, y0 + (s * x - c * y) / _PER_M

    offset = pad.child("drill", "offset")
    x, y = (0.0, 0.0) if offset is None else pair(offset)
    flat = affinity.translate(_flat(pad), x, y)
    return shapely.transform(flat, lambda at: np.array([of_pad(x, y) for x, y in at.tolist()])), of_pad


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


_REMARK = re.compile(r"\A(?:[ \t]*#[^\n]*\n)*")  # at the beginning of a generator's file
_TOKEN = re.compile(r'[()]|"(?:[^"\\]|\\.)*"|[^\s()"]+|"', re.DOTALL)  # last: an open quote
_ESCAPE = re.compile(r"\\(.)", re.DOTALL)
_ESCAPED = {"n": "\n", "r": "\r", "t": "\t"}


class Quoted(str):
    """String in quotes: ``"1"`` is a name, ``1`` a number."""

    __slots__ = ()


@dataclass(frozen=True, eq=False)
class Node:
    """List ``(name item …)`` of an s-expression, which begins at "file:line"."""

    name: str
    items: tuple[Node | str, ...]
    where: str

    @property
    def words(self) -> tuple[str, ...]:
        """Items that are words."""
        return tuple(item for item in self.items if isinstance(item, str))

    def children(self, *names: str) -> Iterator[Node]:
        """Yield the inner lists of some names, in order."""
        return (item for item in self.items if isinstance(item, Node) and item.name in names)

    def child(self, *names: str) -> Node | None:
        """Return the first list of a name, or nested names."""
        found: Node | None = self
        for name in names:
            found = None if found is None else next(found.children(name), None)
        return found

    def need(self, name: str) -> Node:
        """Return the first list of a name, or raise BoardError."""
        found = self.child(name)
        if found is None:
            raise BoardError(f"{self.where}: ({self.name} …) must have a ({name} …).")
        return found

    def text(self, index: int = 0) -> str:
        """Return a word, or raise BoardError if it is missing."""
        words = self.words
        if index >= len(words):
            raise BoardError(f"{self.where}: ({self.name} …) must have {index + 1} words; got {len(words)}.")
        return words[index]

    def number(self, index: int = 0) -> float:
        """Return a word as a finite number, or raise BoardError."""
        word = self.text(index)
        try:
            value = float(word)
        except ValueError:
            value = float("nan")
        if not abs(value) < float("inf"):
            raise BoardError(f"{self.where}: ({self.name} …) must have a number; got {word!r}.")
        return value


def read_sexpr(path: Path) -> Node:
    """Read the only s-expression of a file of UTF-8 text, or raise BoardError."""
    try:
        text = text_of_file(path)
    except UnicodeDecodeError:
        raise BoardError(f"{path}: the file is not UTF-8 text.") from None
    except OSError as error:
        raise BoardError(f"{path}: cannot be read: {error.strerror}.") from None
    return parse_sexpr(text, str(path))


def parse_sexpr(text: str, name: str = "text") -> Node:
    """Read one s-expression from a text that messages call `name`, or raise BoardError."""
    text = _REMARK.sub("", text)
    open_lists: list[tuple[str, list[Node | str]]] = []
    root: Node | None = None
    line, done = 1, 0
    for match in _TOKEN.finditer(text):
        token = match[0]
        line += text.count("\n", done, match.start())
        done = match.start()
        where = f"{name}:{line}"
        if token == '"':
            raise BoardError(f"{where}: the file ends inside the text that begins here.")
        if root is not None:
            raise BoardError(f"{where}: nothing may follow the last parenthesis; got {token[:40]!r}.")
        if token == "(":
            open_lists.append((where, []))
        elif not open_lists:
            raise BoardError(f"{where}: the file must begin with a parenthesis; got {token[:40]!r}.")
        elif token == ")":
            node = _node(*open_lists.pop())
            if open_lists:
                open_lists[-1][1].append(node)
            else:
                root = node
        elif token.startswith('"'):
            word = _ESCAPE.sub(lambda match: _ESCAPED.get(match[1], match[1]), token[1:-1])
            open_lists[-1][1].append(Quoted(word))
        else:
            open_lists[-1][1].append(token)
    if open_lists:
        innermost = _node(*open_lists[-1])
        last = text.count("\n", 0, len(text.rstrip())) + 1
        begun = innermost.where.rpartition(":")[2]
        raise BoardError(f"{name}:{last}: the file ends inside ({innermost.name} …) of line {begun}.")
    if root is None:
        raise BoardError(f"{name}: the file is empty.")
    return root


def _node(where: str, items: list[Node | str]) -> Node:
    if items and isinstance(items[0], str):
        return Node(str(items[0]), tuple(items[1:]), where)
    return Node("", tuple(items), where)
