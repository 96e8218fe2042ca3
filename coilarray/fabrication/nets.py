"""Check of nets on copper itself, by which pieces are connected."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, combinations
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.compute.arrays import FloatArray
from coilarray.geometry.arcs import Point, place_in_mm
from coilarray.geometry.array import Array, Placement
from coilarray.geometry.copper import Drill, disc, drills, groups, segment_rectangles, trace_outline

if TYPE_CHECKING:
    from coilarray.fabrication.board import BoardCopper, Copper

# Copper closer than this is one piece: files round to 1 nm, no board house separates 10 nm.
_TOUCHING = 1e-8
# A barrel reaches copper that begins this far from its wall: polygons of round holes lie up to 0.3
# µm off the circle.
_BARREL_MARGIN = 1e-6
_TOLERANCE = 2e-6  # m, by which shapes may differ
# Corners sharper than this have their mitre cut off by some outlines, so a round end may stand out
# there.
_SHARP = np.cos(np.radians(100.0))


@dataclass(frozen=True)
class Barrel:
    """Plated wall of a hole, with lengths in m."""

    x: float
    y: float
    drill: float
    layers: tuple[str, ...]


# in the order of results: several coils in one piece, a terminal cut off, and other copper or holes
FaultKind = Literal["bridge", "cut", "missing", "foreign"]
Place = Sequence[float] | FloatArray


@dataclass(frozen=True)
class NetFault:
    """Difference at x and y in m between the copper of a file and its coils."""

    kind: FaultKind
    coils: tuple[str, ...]
    layer: str
    x: float
    y: float
    text: str


def connected_pieces(
    layers: Mapping[str, Sequence[BaseGeometry]], holes: Sequence[Barrel]
) -> tuple[dict[str, BaseGeometry], ...]:
    """Sort copper in m into pieces connected by touching and by walls of holes."""
    parts = {layer: _parts(copper) for layer, copper in layers.items()}
    first = dict(zip(parts, np.cumsum([0, *map(len, parts.values())]).tolist(), strict=False))
    count = sum(map(len, parts.values()))
    centres = np.array([shapely.Point(hole.x, hole.y) for hole in holes], dtype=object)
    radius = np.array([hole.drill / 2 + _BARREL_MARGIN for hole in holes])
    met = []
    for layer, shapes in parts.items():
        tree = shapely.STRtree(shapes)
        i, j = tree.query(shapes, predicate="dwithin", distance=_TOUCHING)
        met.append(np.column_stack((i, j)) + first[layer])
        piercing = np.array([k for k, hole in enumerate(holes) if layer in hole.layers], dtype=np.int64)
        if len(piercing):
            h, j = tree.query(centres[piercing], predicate="dwithin", distance=radius[piercing])
            met.append(np.column_stack((piercing[h] + count, j + first[layer])))
    label = np.array(groups(count + len(holes), np.vstack(met) if met else ()))
    pieces: dict[int, dict[str, BaseGeometry]] = {}
    for layer, shapes in parts.items():
        of_layer = label[first[layer] : first[layer] + len(shapes)]
        for piece in np.unique(of_layer).tolist():
            pieces.setdefault(piece, {})[layer] = shapely.union_all(shapes[of_layer == piece])
    return tuple(pieces.values())


def board_layers(board: BoardCopper) -> tuple[dict[str, list[BaseGeometry]], list[Barrel]]:
    """Copper and holes of a board, as input of `check_nets`."""
    layers: dict[str, list[BaseGeometry]] = {layer: [] for layer in board.stackup.names}
    items: list[Copper] = [*board.tracks, *board.holes, *board.pads, *board.areas]
    for item in items:
        for layer, shape in item.copper.items():
            layers[layer].append(shape)
    return layers, [Barrel(hole.x, hole.y, hole.drill, hole.layers) for hole in board.holes]


def check_nets(
    array: Array, layers: Mapping[str, Sequence[BaseGeometry]], holes: Sequence[Barrel]
) -> tuple[NetFault, ...]:
    """Compare the copper of a file with its coils: bridges, cuts, missing and foreign copper."""
    # Shapes may differ by `_TOLERANCE`. Copper of a coil must be present also if it carries no current. Copper that
    # joins turns of one coil is foreign.
    for layer in layers:
        array.stackup.index(layer)
    pieces = connected_pieces(layers, holes)
    design_holes = drills(array)
    coils = [_Coil.of(placement, design_holes) for placement in array.placements]
    # the pieces lie apart
    parts = {layer: _parts([piece[layer] for piece in pieces if layer in piece]) for layer in layers}
    copper = {layer: shapely.MultiPolygon(shapes.tolist()) for layer, shapes in parts.items()}
    foreign_holes = [hole for hole in holes if not any(_same(hole, drill) for drill in design_holes)]
    faults: list[NetFault] = []
    for hole in foreign_holes:
        text = f"the design has no plated hole of {hole.drill * 1e3:.4g} mm through {', '.join(hole.layers)}"
        faults.append(_fault("foreign", (), hole.layers[0], (hole.x, hole.y), text))
    for piece in pieces:
        owners = [
            coil
            for coil in coils
            if any(
                layer in piece and shapely.intersects(piece[layer], shapely.LineString(line))
                for line, layer in zip(coil.lines, coil.line_layers, strict=True)
            )
        ]
        if len(owners) > 1:
            faults.append(_bridge(piece, owners, foreign_holes))
        else:
            faults += _foreign_copper(piece, owners or coils)
    for coil in coils:
        cut = coil.cut(pieces)
        faults += coil.missing(copper, holes) if cut is None else [cut]
    return tuple(sorted(faults, key=lambda fault: get_args(FaultKind).index(fault.kind)))


def _fault(kind: FaultKind, coils: tuple[str, ...], layer: str, place: Place, text: str) -> NetFault:
    """Make a fault, with its place in mm appended."""
    return NetFault(kind, coils, layer, float(place[0]), float(place[1]), f"{text} at {place_in_mm(*place)}")


@dataclass(frozen=True, eq=False)
class _Coil:
    """Copper of one coil on each layer: `least` narrower, `most` wider by the tolerance."""

    name: str
    lines: tuple[FloatArray, ...]
    line_layers: tuple[str, ...]
    drills: tuple[Drill, ...]
    least: dict[str, BaseGeometry]
    most: dict[str, BaseGeometry]

    @staticmethod
    def of(placement: Placement, design_holes: Iterable[Drill]) -> _Coil:
        """Make the outlines of a placement with the tolerance."""
        own = tuple(drill for drill in design_holes if drill.net == placement.name)
        least: dict[str, list[BaseGeometry]] = {}
        most: dict[str, list[BaseGeometry]] = {}
        for line, widths, layer in placement.traces():
            ends = np.stack((line[:-1], line[1:]), axis=1)
            rectangles = np.asarray(shapely.polygons(segment_rectangles(ends, widths - 2 * _TOLERANCE)))
            least.setdefault(layer, []).extend(rectangles)
            wider = widths + 2 * _TOLERANCE
            most.setdefault(layer, []).append(trace_outline(line, wider))
            # discs of round strokes that may exceed it at ends, sharp corners and changes of width
            step = np.diff(line, axis=0)
            along = step / np.hypot(*step.T)[:, None]
            sharp = (along[:-1] * along[1:]).sum(axis=1) < _SHARP
            stands_out = np.concatenate(([True], sharp | (np.diff(wider) != 0), [True]))
            diameters = np.maximum(np.append(wider, 0.0), np.append(0.0, wider))
            most[layer] += [
                disc(x, y, d)
                for (x, y), d in zip(line[stands_out].tolist(), diameters[stands_out].tolist(), strict=True)
            ]
        for drill in own:
            for layer in drill.layers:
                least.setdefault(layer, []).append(disc(drill.x, drill.y, drill.pad - 2 * _TOLERANCE))
                most.setdefault(layer, []).append(disc(drill.x, drill.y, drill.pad + 2 * _TOLERANCE))
        bored = shapely.union_all([disc(d.x, d.y, d.diameter + 2 * _TOLERANCE) for d in own if d.drilled])
        return _Coil(
            placement.name,
            tuple(line for line, _, _ in placement.traces()),
            placement.layers,
            own,
            {layer: shapely.union_all(shapes) - bored for layer, shapes in least.items()},
            {layer: shapely.union_all(shapes) for layer, shapes in most.items()},
        )

    def cut(self, pieces: Sequence[Mapping[str, BaseGeometry]]) -> NetFault | None:
        """Find where the path leaves the first terminal's piece."""
        begin, end = self.lines[0][0], self.lines[-1][-1]
        first, last = self.line_layers[0], self.line_layers[-1]
        piece = next((piece for piece in pieces if self._reached(piece, begin, first)), None)
        if piece is None:
            return _fault("cut", (self.name,), first, begin, f"terminal 1 of {self.name} has no copper on {first}")
        if self._reached(piece, end, last):
            return None
        bored = shapely.union_all([disc(d.x, d.y, d.diameter) for d in self.drills if d.drilled])
        off = f"terminal 2 of {self.name} at {place_in_mm(*end)} is cut off: "
        for k, (line, layer) in enumerate(zip(self.lines, self.line_layers, strict=True)):
            way = shapely.LineString(line)
            lost = shapely.get_coordinates(way - bored - piece.get(layer, shapely.Polygon()))
            if not len(lost):
                continue
            if k > 0 and not self._reached(piece, line[0], layer):
                text = f"{off}nothing joins {self.line_layers[k - 1]} and {layer}"
                return _fault("cut", (self.name,), layer, line[0], text)
            along = shapely.line_locate_point(way, shapely.points(lost))
            return _fault("cut", (self.name,), layer, lost[np.argmin(along)], f"{off}its copper ends on {layer}")
        return _fault("cut", (self.name,), last, end, f"{off}no copper on {last}")

    def _reached(self, piece: Mapping[str, BaseGeometry], point: FloatArray, layer: str) -> bool:
        """Whether a piece or its hole reaches a point."""
        here = [d for d in self.drills if d.drilled and np.hypot(d.x - point[0], d.y - point[1]) < 1e-9]
        radius = max((drill.diameter / 2 for drill in here), default=0.0) + _BARREL_MARGIN
        return layer in piece and bool(shapely.dwithin(piece[layer], shapely.Point(point), radius))

    def missing(self, copper: Mapping[str, BaseGeometry], holes: Sequence[Barrel]) -> Iterator[NetFault]:
        """Holes and copper of the coil missing in a file."""
        for drill in self.drills:
            if drill.drilled and not any(_same(hole, drill) for hole in holes):
                text = f"the plated hole of {self.name} at {place_in_mm(drill.x, drill.y)} is missing"
                yield NetFault("missing", (self.name,), drill.layers[0], drill.x, drill.y, text)
        for layer, least in self.least.items():
            for place in _places(shapely.get_parts(least - copper.get(layer, shapely.Polygon())), _TOLERANCE**2):
                yield _fault("missing", (self.name,), layer, place, f"copper of {self.name} is missing on {layer}")


def _bridge(piece: Mapping[str, BaseGeometry], owners: Sequence[_Coil], foreign_holes: Sequence[Barrel]) -> NetFault:
    """Fault of several coils in one piece, where they meet."""
    names = tuple(coil.name for coil in owners)
    shared = (
        (layer, place)
        for layer in piece
        for one, other in combinations([coil.most[layer] for coil in owners if layer in coil.most], 2)
        for place in _places(shapely.get_parts(one & other))
    )
    bores = (
        (hole.layers[0], (hole.x, hole.y))
        for hole in foreign_holes
        if any(shapely.dwithin(piece.get(layer), shapely.Point(hole.x, hole.y), hole.drill) for layer in hole.layers)
    )
    strays = ((stray.layer, (stray.x, stray.y)) for stray in _foreign_copper(piece, owners))
    begin = owners[0].line_layers[0], owners[0].lines[0][0]
    layer, place = next(chain(shared, bores, strays, [begin]))
    return _fault("bridge", names, layer, place, f"{' and '.join(names)} are joined on {layer}")


def _foreign_copper(piece: Mapping[str, BaseGeometry], coils: Sequence[_Coil]) -> Iterator[NetFault]:
    """Copper of a piece outside all the given coils."""
    names = (coils[0].name,) if len(coils) == 1 else ()
    for layer, copper in piece.items():
        allowed = shapely.union_all([coil.most[layer] for coil in coils if layer in coil.most])
        for x, y in _places(shapely.get_parts(copper - allowed), _TOLERANCE**2):
            text = f"the design has no copper on {layer} at {place_in_mm(x, y)}"
            text += f", where {names[0]} has some" if names else ""
            yield NetFault("foreign", names, layer, x, y, text)


def _same(hole: Barrel, drill: Drill) -> bool:
    """Whether a hole of a file is a designed hole."""
    return (
        drill.drilled
        and bool(np.hypot(hole.x - drill.x, hole.y - drill.y) <= _TOLERANCE)
        and abs(hole.drill - drill.diameter) <= 2 * _TOLERANCE
        and set(hole.layers) == set(drill.layers)
    )


def _places(parts: Iterable[BaseGeometry], smallest: float = 0.0) -> list[Point]:
    """Point in m inside every part above `smallest` (m²)."""
    points = [part.representative_point() for part in parts if part.area > smallest]
    return [(point.x, point.y) for point in points]


def _parts(copper: Iterable[BaseGeometry]) -> npt.NDArray[np.object_]:
    parts = shapely.get_parts(np.array(list(copper), dtype=object))
    return np.asarray(parts[shapely.area(parts) > 0])
