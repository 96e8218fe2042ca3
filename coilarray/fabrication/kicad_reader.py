"""Read the copper of a KiCad board, ``.kicad_pcb`` of KiCad 6 and newer."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.errors import BoardError
from coilarray.fabrication.board import BoardCopper, CopperArea, Hole, SurfacePad, Track
from coilarray.fabrication.kicad_shapes import (
    GRAPHICS,
    KicadLayers,
    ToBoard,
    drawn_copper,
    drawn_outline,
    other_copper,
    pad_shape,
    pair,
    read_layers,
    zone_copper,
)
from coilarray.fabrication.sexpr import Node, Quoted, read_sexpr
from coilarray.geometry.arcs import Point, arc_points
from coilarray.geometry.copper import disc
from coilarray.geometry.stackup import Stackup

OLDEST_VERSION = 20211014
"""Format of KiCad 6."""
NEWEST_VERSION = 20241229
"""Format of KiCad 9, the newest that this reader knows."""

_PER_M = 1e3  # numbers in the file are in mm


def read_kicad(path: Path, stackup: Stackup | None = None) -> BoardCopper:
    """Read the conductors of a KiCad board.

    The copper is in the frame of the design. The auxiliary origin of the file ("drill and place file origin") is
    (0, 0), and y points up. Arcs are divided into pieces within 0.9 µm of them. A given `stackup` replaces the board's
    own, and must have the same number of copper layers. `assumed` lists the values that the file lacks: thicknesses and
    permittivities if it has no stack-up.

    Raises BoardError with file, line and reason if the file is not a KiCad board, is truncated, comes from KiCad 5 or
    older, or holds impossible values.

    A file of a format newer than KiCad 9's is read as far as it is understood, with a sentence in `notes`. Unknown
    objects with a net or on copper are put among the areas, so that no coil can contain them unnoticed. Texts and
    dimensions are put there too, as rectangles around them. Teardrops are left out, also with a note.
    """
    root = read_sexpr(path)
    if root.name != "kicad_pcb":
        raise BoardError(
            f"{root.where}: a KiCad board begins with (kicad_pcb; this file begins with ({root.name[:40]}."
        )
    notes = []
    version = root.need("version")
    number = version.number()
    if number < OLDEST_VERSION:
        raise BoardError(
            f"{version.where}: the board has KiCad's format {number:.0f}, older than KiCad 6 ({OLDEST_VERSION}); "
            "open it in a newer KiCad and save it."
        )
    if number > NEWEST_VERSION:
        notes.append(
            f"The board has KiCad's format {number:.0f}; formats newer than KiCad 9 ({NEWEST_VERSION}) are untested."
        )
    nets = {node.text(0): node.text(1) for node in root.children("net") if len(node.words) > 1}  # none from KiCad 10 on
    origin = root.child("setup", "aux_axis_origin")
    board = _Board(read_layers(root, stackup), nets, (0.0, 0.0) if origin is None else pair(origin))
    tracks: list[Track] = []
    holes: list[Hole] = []
    pads: list[SurfacePad] = []
    areas: list[CopperArea] = []
    outline: list[Point] = []
    teardrops = 0
    for node in root.items:
        if not isinstance(node, Node):
            continue
        if node.name in ("segment", "arc"):
            tracks += board.tracks(node)
        elif node.name == "via":
            holes.append(board.via(node))
        elif node.name == "zone" and node.child("attr", "teardrop"):  # which only widens the end of a track at a pad
            teardrops += 1
        elif node.name == "footprint":
            to_board = board.footprint(node)
            for pad in node.children("pad"):
                (hole, surface) = board.pad(pad, to_board)
                holes += hole
                pads += surface
            areas += board.areas(
                (item for item in node.items if isinstance(item, Node) and item.name != "pad"), to_board
            )
            outline += board.outline(node.children(*GRAPHICS), to_board)
        else:
            areas += board.areas([node], board.to_board)
            outline += board.outline([node], board.to_board)
    if teardrops:
        notes.append(f"{teardrops} teardrop{'s' if teardrops > 1 else ''} at the ends of tracks left out.")
    edge = shapely.MultiPoint(outline).bounds if outline else None
    copper = (tuple(tracks), tuple(holes), tuple(pads), board.layers.assumed, tuple(areas))
    return BoardCopper(str(path), board.layers.stackup, *copper, edge, tuple(notes))


@dataclass(frozen=True)
class _Board:
    """Context for reading the nodes of one file.

    It holds the copper layers, the names of the nets by number, and the origin of the design on KiCad's sheet in mm.
    """

    layers: KicadLayers
    nets: dict[str, str]
    origin: Point

    def to_board(self, x: float, y: float) -> Point:
        """Transform a place on KiCad's sheet to the board's frame.

        The place is in mm with y down, the result in m with y up.
        """
        return (x - self.origin[0]) / _PER_M, (self.origin[1] - y) / _PER_M

    def footprint(self, node: Node) -> ToBoard:
        """Return the transformation from a footprint to the board.

        The footprint's frame is in mm with y down, the board's in m.
        """
        place = node.need("at")
        x0, y0 = pair(place)
        turn = math.radians(place.number(2)) if len(place.words) > 2 else 0.0
        c, s = math.cos(turn), math.sin(turn)

        def to_board(x: float, y: float) -> Point:
            return self.to_board(x0 + c * x + s * y, y0 - s * x + c * y)

        return to_board

    def net(self, node: Node) -> str | None:
        """Return the net of a node. It is given by its name or number. Numbers refer to the board's table."""
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
        layer = self.layers.one(node)
        if layer is None:
            got = " ".join(word for part in node.children("layer", "layers") for word in part.words)
            raise BoardError(f"{node.where}: a track must lie on a copper layer; got {got or 'none'}.")
        width = _positive(node.need("width")) / _PER_M
        start, end = (self.to_board(*pair(node.need(name))) for name in ("start", "end"))
        points: list[Point] = [start, end]
        if node.name == "arc":
            middle = self.to_board(*pair(node.need("mid")))
            points = [(x, y) for x, y in arc_points(start, middle, end).tolist()]
        net = self.net(node)
        for first, last in pairwise(points):
            yield Track(layer, first, last, width, net, node.where)

    def via(self, node: Node) -> Hole:
        """Return a via as a hole through its layers. They are all layers from the first to the last that it names."""
        x, y = self.to_board(*pair(node.need("at")))
        ends = self.layers.all(node)
        if len(ends) < 2 and len(self.layers.names) > 1:
            raise BoardError(f"{node.where}: a via must join two copper layers; got {' '.join(ends) or 'none'}.")
        layers = self.layers.stackup.between(ends[0], ends[-1])
        drill, size = _positive(node.need("drill")) / _PER_M, _positive(node.need("size")) / _PER_M
        shapes = _kept(node, dict.fromkeys(layers, disc(x, y, size)), disc(x, y, drill))
        return Hole(x, y, drill, size, layers, self.net(node), "via", node.where, shapes=shapes)

    def pad(self, node: Node, to_board: ToBoard) -> tuple[list[Hole], list[SurfacePad]]:
        """Return a pad as hole or surface pads.

        The pad belongs to a footprint. There is a surface pad for each of its copper layers.
        """
        number, kind = node.text(0), node.text(1)
        if kind == "np_thru_hole":
            return [], []
        x, y = to_board(*pair(node.need("at")))
        size = min(pair(node.need("size"))) / _PER_M
        net = self.net(node)
        layers = self.layers.all(node)
        shape = pad_shape(node, to_board)
        if kind != "thru_hole":
            return [], [SurfacePad(x, y, layer, net, node.where, number, size, shape) for layer in layers]
        drill = node.need("drill")
        # of a slot, (drill oval 1 0.5), the smaller side
        diameters = [drill.number(k) for k, word in enumerate(drill.words) if word != "oval"]
        if not diameters or min(diameters) <= 0:
            raise BoardError(
                f"{drill.where}: a plated hole must have a positive diameter; got {' '.join(drill.words)}."
            )
        layers_between = self.layers.stackup.between(layers[0], layers[-1]) if layers else self.layers.stackup.names
        bore = min(diameters) / _PER_M
        shapes = _kept(node, dict.fromkeys(layers, shape), disc(x, y, bore))
        return [Hole(x, y, bore, size, layers_between, net, "pad", node.where, number, shapes)], []

    def areas(self, nodes: Iterable[Node], to_board: ToBoard) -> Iterator[CopperArea]:
        """Yield copper areas: zones, drawn shapes, texts and others.

        The others are any objects on copper or with a net.
        """
        for node in nodes:
            net = self.net(node) if node.name != "net" else None
            if node.name == "zone":
                if node.child("keepout") is None:
                    for layer, shape, what in zone_copper(node, self.layers, self.to_board):
                        yield CopperArea(layer, shape, net, what, node.where)
            elif node.name in GRAPHICS:
                for layer, shape, what in drawn_copper(node, self.layers, to_board):
                    yield CopperArea(layer, shape, net, what, node.where)
            elif names := self.layers.all(node):
                for shape, what in other_copper(node, to_board):
                    for name in names:
                        yield CopperArea(name, shape, net, what, node.where)
            elif net is not None:
                layer = self.layers.stackup.names[0]
                yield CopperArea(layer, shapely.Polygon(), net, f"an unknown ({node.name} …)", node.where)

    def outline(self, nodes: Iterable[Node], to_board: ToBoard) -> list[Point]:
        """Return points of the shapes on the board's edge layer."""
        found: list[Point] = []
        for node in nodes:
            if node.name in GRAPHICS and any("Edge.Cuts" in part.words for part in node.children("layer", "layers")):
                found += drawn_outline(node, to_board)
        return found


def _kept(node: Node, shapes: dict[str, BaseGeometry], barrel: BaseGeometry) -> dict[str, BaseGeometry]:
    """Return the pads of a hole, or its barrel.

    It is the barrel if KiCad may leave pads out because no track ends there.
    """
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
