"""What touches a coil: copper that must not, and its own pads and holes where they join turns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import dist

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely.geometry.base import BaseGeometry

from coilarray.errors import BoardError
from coilarray.geometry.readers.board_copper import CopperArea, Hole, SurfacePad, Track
from coilarray.geometry.readers.traced_coil import TracedCoil

Copper = Track | Hole | SurfacePad | CopperArea

_OVERLAP = 1e-6  # m: copper that meets by less only touches


def copper_of(item: Copper) -> dict[str, BaseGeometry]:
    """Return the copper of an item, in m, on every layer that it reaches."""
    if isinstance(item, Track):
        return {item.layer: shapely.LineString((item.start, item.end)).buffer(item.width / 2)}
    if isinstance(item, Hole):
        return {layer: item.copper(layer) for layer in item.layers}
    if isinstance(item, SurfacePad):
        return {item.layer: item.copper}
    return {item.layer: item.shape}


class Obstacles:
    """Copper that no coil may touch; `whose` says for messages what it belongs to: "without a net", "of net A"."""

    def __init__(self, copper: Iterable[Copper], whose: str = "without a net") -> None:
        self._whose = whose
        self._found = [(item, layer, shape) for item in copper for layer, shape in copper_of(item).items()]
        self._tree = shapely.STRtree([shape for _, _, shape in self._found])

    def refuse_contact(self, what: str, coil: TracedCoil, own: frozenset[int] = frozenset()) -> None:
        """Raise where one of them lies on the path; `own` are the ids of items that belong to the path itself."""
        segments = list(_segments(coil))
        lines = [segment.line for segment in segments]
        reach = [max(segment.width / 2 - _OVERLAP, 0.0) for segment in segments]
        for k, index in self._tree.query(lines, predicate="dwithin", distance=reach).T.tolist():
            item, layer, _ = self._found[index]
            if layer == segments[k].layer and id(item) not in own:
                at = _mm(*lines[k].coords[0])
                raise BoardError(f"{item.where}: {_kind(item)} {self._whose} touches {what} on {layer} at {at}.")


def refuse_bridges(what: str, coil: TracedCoil, items: Sequence[Copper]) -> None:
    """Raise where pads or holes, each with all that overlap it, meet a path in more than one stretch.

    Parameters
    ----------
    what : str
        The coil in messages.
    coil : TracedCoil
        The path.
    items : sequence of Track, Hole, SurfacePad
        Of the coil's own net.

    Notes
    -----
    Along the path the stretches within a pad's copper must follow each other: out of the copper it may run no longer
    than its width there, which is a bend beside the pad.
    """
    segments = list(_segments(coil))
    tree = shapely.STRtree([segment.line for segment in segments])
    shapes = [copper_of(item) for item in items]
    for group in _overlapping(shapes):
        stretches = sorted(
            (*_stretch(segments[index], shape, reach), index)
            for k in group
            for layer, shape in shapes[k].items()
            for index in tree.query(shape, predicate="dwithin", distance=coil.widest / 2).tolist()
            if segments[index].layer == layer
            and shapely.dwithin(shape, segments[index].line, reach := max(segments[index].width / 2 - _OVERLAP, 0.0))
        )
        covered = stretches[0][1] if stretches else 0.0
        for begin, end, index in stretches:
            segment = segments[index]
            if begin - covered > segment.width:
                item = items[group[0]]
                at = _mm(*segment.line.interpolate(begin - segment.begin).coords[0])
                raise BoardError(
                    f"{item.where}: {_kind(item)} bridges turns of {what}: it also touches it on {segment.layer} at "
                    f"{at}."
                )
            covered = max(covered, end)


@dataclass(frozen=True, eq=False)
class _Segment:
    """A straight piece of a path, which begins `begin` m along it."""

    layer: str
    line: shapely.LineString
    width: float
    begin: float


def _segments(coil: TracedCoil) -> Iterator[_Segment]:
    along = 0.0
    for line, layer, widths in zip(coil.lines, coil.layers, coil.widths, strict=True):
        for (a, b), width in zip(pairwise(line.tolist()), widths.tolist(), strict=True):
            yield _Segment(layer, shapely.LineString((a, b)), width, along)
            along += dist(a, b)


def _stretch(segment: _Segment, shape: BaseGeometry, reach: float) -> tuple[float, float]:
    """Begin and end, along the path, of the part of a segment whose copper meets a shape."""
    part = shapely.get_coordinates(segment.line & shape.buffer(reach + _OVERLAP))
    along = shapely.line_locate_point(segment.line, shapely.points(part))
    return segment.begin + float(along.min()), segment.begin + float(along.max())


def _overlapping(shapes: Sequence[dict[str, BaseGeometry]]) -> list[list[int]]:
    """Sort the indices of items into groups that hang together."""
    entries = [(k, layer, shape) for k, layers in enumerate(shapes) for layer, shape in layers.items()]
    if not entries:
        return []
    geometries = np.array([shape for _, _, shape in entries], dtype=object)
    pairs = shapely.STRtree(geometries).query(geometries, predicate="intersects").T.tolist()
    met = np.array([(entries[i][0], entries[j][0]) for i, j in pairs if entries[i][1] == entries[j][1]]).reshape(-1, 2)
    graph = coo_array((np.ones(len(met)), (met[:, 0], met[:, 1])), shape=(len(shapes), len(shapes)))
    count, group = connected_components(graph, directed=False)
    return [np.flatnonzero(group == number).tolist() for number in range(count)]


def _kind(item: Copper) -> str:
    if isinstance(item, CopperArea):
        return item.what
    if isinstance(item, Hole):
        return f"a {item.kind}"
    return "a track" if isinstance(item, Track) else "a pad"


def _mm(x: float, y: float) -> str:
    return f"({x * 1e3:.4g}, {y * 1e3:.4g}) mm"
