"""Leads of all coils, routed to pads without crossing.

The leads run on a grid of their own pitch, straight or at 45°, each on the layer on which its coil
ends. They take the shortest way that keeps the gap to all copper there and to the leads routed
before. A way across a coil's winding, on another layer, counts as longer.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.errors import GeometryError
from coilarray.geometry.arcs import SIDES, Arc, rounded_line
from coilarray.geometry.array import Array, Connector, Placement, Routing
from coilarray.geometry.coil import Coil
from coilarray.geometry.copper import disc, drills, trace_outline
from coilarray.geometry.stackup import Stackup

_ACROSS = 4.0  # weight of a way across a winding, over the same way beside it
_MOST_NODES = 90_000  # of the grid: a larger board gets a coarser grid
_SHARE = 0.49  # of a piece between two corners, which may both be rounded: the arcs must not meet
_TRIES = 4  # orders of the coils, each beginning with the coil that found no way
_FIRST_LOOK = 1.5  # times the straight line: ways up to this length are looked for first
_LOOK_AHEAD = 10  # corners of a way that a single corner may replace
_NANOMETRE = 9  # digits of m: rounding errors of a design's lengths must not change a way
_AROUND = 4.0  # room around coils and pads, in pitches of the pads


def route_leads(array: Array, connector: Connector) -> Array:
    """Route both ends of every coil to a connector.

    The holes of the connector take the place of the coils' own terminals.

    In the result each coil of the `array` has a path of its own to its holes of the `connector`,
    and `Array.routing` holds the array itself. Raises GeometryError if a coil has no leads, pads
    overlap, or a lead finds no way.

    >>> from coilarray.geometry import Lattice, Leads, PlatedHole, RoundedSpiral, Stackup, lattice_array
    >>> via, leads = PlatedHole(0.25e-3, 0.5e-3), Leads(1e-3, 1e-3, PlatedHole(0.8e-3, 1.4e-3))
    >>> coil = RoundedSpiral(12e-3, 12e-3, 8, 0.2e-3, 0.2e-3, 2e-3, via=via, leads=leads)
    >>> board = Stackup(("L1", "L2"), (35e-6, 35e-6), (0.2e-3,), (4.5,))
    >>> routed = route_leads(lattice_array(board, coil, Lattice("linear", 16e-3, 2)), Connector("bottom"))
    >>> ends = [place.to_board(place.coil.terminal_points) for place in routed.placements]
    >>> sorted(round(float(x) * 1e3, 2) for end in ends for x in end[:, 0])
    [-3.01, -0.47, 2.07, 4.61]
    """
    key = tuple((p.name, p.coil, p.layers, p.x, p.y, p.rotation) for p in array.placements)
    placements = _routed(array.stackup, array.through_holes, key, connector)
    return replace(array, placements=placements, routing=Routing(array, connector, placements))


_Place = tuple[str, Coil, tuple[str, ...], float, float, float]


@lru_cache(maxsize=16)  # a design is read several times, and its routes stay
def _routed(
    stackup: Stackup, through_holes: bool, places: tuple[_Place, ...], connector: Connector
) -> tuple[Placement, ...]:
    array = Array(stackup, tuple(Placement(*place) for place in places), through_holes=through_holes)
    for place in array.placements:
        if place.coil.terminal is None:
            raise GeometryError(f"{place.name} has no leads that could be routed to a connector.")
    quarters = (SIDES.index("bottom") - SIDES.index(connector.side)) % 4  # which turn the side to the bottom
    turned = []
    for place in array.placements:
        x, y = (np.array([place.x, place.y]) @ _turn(quarters)).tolist()
        turned.append(replace(place, x=x, y=y, rotation=place.rotation + quarters * math.pi / 2))
    board = array.with_placements(turned)
    farthest: NoWayError | None = None
    orders = [_along_the_edge(board, near_first=near_first) for near_first in (True, False)]
    bare = _Grid(board, connector, _pads(board, connector, orders[0]))  # every order has the same pads
    for begun in orders[: 1 if orders[0] == orders[1] else 2]:
        order, tried = begun, list[list[int]]()
        grid = bare.with_pads(_pads(board, connector, order))
        while len(tried) < _TRIES and order not in tried:
            tried.append(order)
            try:
                ways = grid.ways(order)
            except NoWayError as error:
                hopeless = farthest is not None and error.routed <= farthest.routed and 2 * error.routed < len(order)
                farthest = error if farthest is None or error.routed > farthest.routed else farthest
                if hopeless and len(tried) > 1:
                    break
                order = [error.coil, *(coil for coil in order if coil != error.coil)]
                continue
            return tuple(
                _with_ways(place, [way @ _turn(-quarters) for way in ways[k]], grid.width)
                for k, place in enumerate(array.placements)
            )
    assert farthest is not None  # the only way out of the loop
    raise farthest


class NoWayError(GeometryError):
    """No way from a `coil` to its pad after `routed` others."""

    def __init__(self, coil: int, message: str) -> None:
        super().__init__(message)
        self.coil = coil
        self.routed = 0


def _turn(quarters: int) -> FloatArray:
    """Matrix of counter-clockwise quarter turns of points, free of rounding."""
    c, s = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarters % 4]
    return np.array([[c, s], [-s, c]], dtype=np.float64)


def _along_the_edge(array: Array, *, near_first: bool) -> list[int]:
    """Order of the coils along the edge, then by distance."""
    ends = np.array([place.to_board(place.coil.terminal_points).mean(axis=0) for place in array.placements])
    x, y = ends.T
    apart = min((place.coil.terminal.pad for place in array.placements if place.coil.terminal), default=1e-3)
    column = np.round(x / apart)  # coils less than a pad beside one another
    return [int(k) for k in np.lexsort((y if near_first else -y, column))]


def _pads(array: Array, connector: Connector, order: Sequence[int]) -> FloatArray:
    """Positions (coils, 2, 2) in m of all pads."""
    largest = max(place.coil.terminal.pad for place in array.placements if place.coil.terminal)
    if connector.pitch <= largest:
        raise GeometryError(
            f"pitch of the connector must be more than the pads of {largest * 1e3:g} mm; "
            f"got {connector.pitch * 1e3:g} mm: pitch_mm, or leads.pad_mm of the coils."
        )
    margin = replace(array, board_margin=0.0)
    x_min, y_min, x_max, _ = margin.bounds
    sense = -1.0 if connector.side in ("left", "top") else 1.0  # of the edge, turned to the bottom
    middle = (x_min + x_max) / 2 if connector.at is None else sense * connector.at
    first = middle - connector.pitch * (2 * len(order) - 1) / 2
    pads = np.empty((len(order), 2, 2))
    pads[:, :, 1] = y_min - connector.distance
    for k, coil in enumerate(order):
        place = array.placements[coil]
        own = first + connector.pitch * (2 * k + np.arange(2))
        ends = place.to_board(place.coil.terminal_points)[:, 0]
        pads[coil, :, 0] = own if ends[0] <= ends[1] else own[::-1]
    return pads


class _Grid:
    """Grid of nodes and edges, with occupied edges per layer."""

    def __init__(self, array: Array, connector: Connector, pads: FloatArray) -> None:
        self.array, self.connector, self.pads = array, connector, pads
        first = array.placements[0].coil
        self.width, self.gap = connector.trace_width or first.trace_width, connector.gap or first.gap
        self.clearance = self.gap + self.width / 2
        x_min, _, x_max, y_max = replace(array, board_margin=0.0).bounds
        room = _AROUND * max(connector.pitch, 2 * (self.width + self.gap))
        x_min, x_max = min(x_min, pads[..., 0].min()) - room, max(x_max, pads[..., 0].max()) + room
        bottom = float(pads[0, 0, 1])
        self.step = max(
            1.01 * (self.width / 2 + self.clearance), math.sqrt((x_max - x_min) * (y_max + room - bottom) / _MOST_NODES)
        )
        x_min, self.step = round(x_min, _NANOMETRE), round(self.step, _NANOMETRE)
        columns, rows = int((x_max - x_min) / self.step) + 1, int((y_max + room - bottom) / self.step) + 2
        i, j = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
        # the row of the pads is a line of the grid
        nodes = np.column_stack((x_min + self.step * i.ravel(), bottom + self.step * (j.ravel() - 1.0)))
        self.nodes = np.round(nodes, _NANOMETRE)
        number = np.arange(len(self.nodes)).reshape(i.shape)
        pairs = (
            (number[:-1], number[1:]),
            (number[:, :-1], number[:, 1:]),
            (number[:-1, :-1], number[1:, 1:]),
            (number[:-1, 1:], number[1:, :-1]),
        )
        self.start, self.stop = (np.concatenate([pair[k].ravel() for pair in pairs]) for k in (0, 1))
        self.length = np.hypot(*(self.nodes[self.start] - self.nodes[self.stop]).T)
        ends = np.stack((self.nodes[self.start], self.nodes[self.stop]), axis=1)
        self.tree = shapely.STRtree(np.asarray(shapely.linestrings(ends)))
        self.windings = shapely.union_all(
            [shapely.Polygon(place.to_board(place.coil.outline)) for place in array.placements]
        )
        self.length[self.tree.query(self.windings, predicate="intersects")] *= _ACROSS
        self.around = self.clearance + 1.5 * self.step  # a lead may be this near its trace
        for place in array.placements:
            wound = place.coil.wound
            if wound is not None and wound.leads is not None and wound.leads.length < self.around:
                raise GeometryError(
                    f"leads.length_mm of {place.name} must be at least {self.around * 1e3:.4g} for a connector; "
                    f"got {wound.leads.length * 1e3:g}."
                )
        self.copper: dict[str, list[_Taken]] = {}
        holes = drills(array)
        for layer in array.stackup.names:
            self.copper[layer] = []
            for k, place in enumerate(array.placements):
                for line in place.lines_on(layer):
                    outline = trace_outline(place.to_board(place.coil.lines[line]), place.coil.widths[line])
                    self._take([layer], outline, (k, line))
                for end in (0, 1):
                    if layer == place.layers[-end]:  # the lead turns by up to 90°
                        x, y = place.to_board(place.coil.terminal_points)[end].tolist()
                        widest = max(self.width, float(place.coil.widths[-end][-end]))
                        self._take([layer], disc(x, y, math.sqrt(2) * widest), (k, "lead", end))
        for hole in holes:
            if hole.kind == "via":
                self._take(hole.layers, disc(hole.x, hole.y, hole.pad), None)

    def with_pads(self, pads: FloatArray) -> _Grid:
        """Return the grid with other pads (coils, 2, 2)."""
        grid = self._copy()
        grid.pads = pads
        for k, place in enumerate(grid.array.placements):
            assert place.coil.terminal is not None  # refused before
            for end in (0, 1):
                x, y = pads[k, end].tolist()
                grid._take(list(grid.copper), disc(x, y, place.coil.terminal.pad), (k, "pad", end))
        return grid

    def _copy(self) -> _Grid:
        """Return the grid with its own record of occupied edges."""
        grid = copy.copy(self)
        grid.copper = {layer: list(taken) for layer, taken in self.copper.items()}
        return grid

    def ways(self, order: Sequence[int]) -> dict[int, list[FloatArray]]:
        """Route the coils in order, then straighten both ways of each."""
        grid = self._copy()
        found: dict[int, list[FloatArray]] = {}
        for coil in order:
            try:
                found[coil] = [grid._way(coil, end) for end in (0, 1)]
            except NoWayError as error:
                error.routed = len(found)
                raise
        for coil, ways in found.items():
            for end in (0, 1):
                layer, owner = grid.array.placements[coil].layers[-end], (coil, "lead", end)
                foreign = np.array([piece.shape for piece in grid._foreign(coil, end)])
                ways[end] = grid._with_fewer_corners(ways[end], foreign, grid._ahead(coil, end))
                grid.copper[layer] = [piece for piece in grid.copper[layer] if piece.owner != owner]
                grid._take([layer], trace_outline(ways[end], grid.width), owner)
        return found

    def _foreign(self, coil: int, end: int) -> list[_Taken]:
        """Copper on a lead's layer, less its pad and its trace's end."""
        place = self.array.placements[coil]
        line = (coil, len(place.coil.lines) - 1 if end else 0)
        x, y = place.to_board(place.coil.terminal_points)[end].tolist()
        pieces = []
        for piece in self.copper[place.layers[-end]]:
            if piece.owner == line:
                shape = piece.shape.difference(disc(x, y, 2 * self.around))
                pieces.append(_Taken(shape, line, self.tree.query(shape, predicate="intersects")))
            elif piece.owner not in ((coil, "pad", end), (coil, "lead", end)):
                pieces.append(piece)
        return pieces

    def _way(self, coil: int, end: int) -> FloatArray:
        """Find the shortest way from coil to pad."""
        from scipy.sparse import coo_array  # loaded for boards with a connector only
        from scipy.sparse.csgraph import dijkstra

        place, layer = self.array.placements[coil], self.array.placements[coil].layers[-end]
        begin, pad = place.to_board(place.coil.terminal_points)[end], self.pads[coil, end]
        taken = self._foreign(coil, end)
        foreign = np.array([piece.shape for piece in taken])
        free = np.ones(len(self.length), dtype=np.bool_)
        for piece in taken:
            free[piece.edges] = False
        first, last = len(self.nodes), len(self.nodes) + 1
        hops = [self._hops(begin, foreign, self._ahead(coil, end)), self._hops(pad, foreign, np.zeros(2))]
        start = np.concatenate((self.start[free], np.full(len(hops[0]), first), np.full(len(hops[1]), last)))
        stop, places = np.concatenate((self.stop[free], *hops)), np.vstack((self.nodes, begin, pad))
        length = np.round(
            np.append(self.length[free], np.hypot(*(places[start] - places[stop])[free.sum() :].T)), _NANOMETRE
        )
        graph = coo_array((length, (start, stop)), shape=(len(places),) * 2).tocsr()
        for limit in (_FIRST_LOOK * float(np.hypot(*(pad - begin))), math.inf):
            distance, before = dijkstra(
                graph, directed=False, indices=np.array(first), return_predecessors=True, limit=limit
            )
            if math.isfinite(distance[last]):
                break
        if math.isfinite(distance[last]):
            nodes = [last]
            while nodes[-1] != first:
                nodes.append(int(before[nodes[-1]]))
            way = _straightened(places[nodes[::-1]])
            self._take([layer], trace_outline(way, self.width), (coil, "lead", end))
            return way
        raise NoWayError(
            coil,
            f"the lead of {place.name} on {layer} cannot be routed to the {self.connector.side} edge with "
            f"{self.width * 1e3:g} mm trace and {self.gap * 1e3:g} mm gap; make room by array.pitch_mm, "
            "connector.distance_mm or connector.trace_width_mm, or let the coils' leads leave at another side.",
        )

    def _ahead(self, coil: int, end: int) -> FloatArray:
        """Direction in which a lead arrives and cannot turn back."""
        place = self.array.placements[coil]
        line = place.to_board(place.coil.lines[-end])[:: 1 if end else -1]
        direction: FloatArray = line[-1] - line[-2]
        return direction

    def _with_fewer_corners(self, way: FloatArray, others: npt.NDArray[np.object_], ahead: FloatArray) -> FloatArray:
        """Replace corners of a way (n, 2) by fewer that are free.

        The way begins in the direction `ahead` or to its side.
        """
        short, k = [way[0]], 0
        while k < len(way) - 1:
            best, corner = k + 1, None
            for j in range(min(k + _LOOK_AHEAD, len(way) - 1), k + 1, -1):
                across = bool(shapely.intersects(self.windings, shapely.LineString(way[k : j + 1])))
                apart = way[j] - way[k]
                slanting = np.sign(apart) * np.abs(apart).min()
                for knee in (way[k] + slanting, way[j] - slanting):
                    first = way[j] if np.array_equal(knee, way[k]) else knee
                    if k == 0 and (first - way[0]) @ ahead < 0:
                        continue
                    line = shapely.LineString((way[k], knee, way[j]))
                    if not np.any(shapely.intersects(others, line)) and across >= shapely.intersects(
                        self.windings, line
                    ):
                        best, corner = j, knee
                        break
                if corner is not None:
                    break
            short += [way[best]] if corner is None else [corner, way[best]]
            k = best
        return _straightened(np.array(short))

    def _hops(self, place: FloatArray, others: npt.NDArray[np.object_], ahead: FloatArray) -> IntArray:
        """Nodes that a straight piece reaches ahead of a place."""
        apart = self.nodes - place
        close = np.flatnonzero((np.hypot(*apart.T) <= 1.5 * self.step) & (apart @ ahead >= 0))
        hops = np.asarray(shapely.linestrings([(place, node) for node in self.nodes[close]]))
        return close[~shapely.intersects(others[:, None], hops).any(axis=0)]

    def _take(self, layers: Sequence[str], shape: BaseGeometry, owner: _Owner) -> None:
        """Block edges near copper, except for the owner's leads."""
        near = shape.buffer(self.clearance).simplify(1e-3 * self.clearance)
        taken = _Taken(near, owner, self.tree.query(near, predicate="intersects"))
        for layer in layers:
            self.copper[layer].append(taken)


_Owner = tuple[int, int] | tuple[int, str, int] | None


class _Taken(NamedTuple):
    """Copper widened by its clearance, with owner and grid edges."""

    shape: BaseGeometry
    owner: _Owner
    edges: IntArray


def _straightened(way: FloatArray) -> FloatArray:
    """Leave out repeated points and points without a turn."""
    step = np.diff(way, axis=0)
    way = way[np.append(True, np.hypot(*step.T) > 1e-9 * np.ptp(way))]
    along = np.diff(way, axis=0)
    along /= np.hypot(*along.T)[:, None]
    turns = np.hypot(*(along[1:] - along[:-1]).T) > 1e-9
    return way[np.concatenate(([True], turns, [True]))]


def _with_ways(place: Placement, ways: Sequence[FloatArray], width: float) -> Placement:
    """Return a coil with rounded ways from its ends to pads."""
    coil = place.coil
    c, s = math.cos(place.rotation), math.sin(place.rotation)
    lines, widths, arcs = list(coil.lines), list(coil.widths), list(coil.arcs) or [()] * len(coil.lines)
    for k, way in zip((0, -1), ways, strict=True):
        own = (way - (place.x, place.y)) @ np.array([[c, -s], [s, c]])
        sense = -1 if k == 0 else 1  # the path begins with the first lead's pad
        line = lines[k][::sense]
        corners = np.vstack((line[-2], own))
        step = np.diff(corners, axis=0)
        length = np.hypot(*step.T)
        along = step / length[:, None]
        cosine = np.clip((along[:-1] * along[1:]).sum(axis=1), -1 + 1e-9, 1)
        tangent = np.sqrt((1 - cosine) / (1 + cosine))
        room = _SHARE * np.minimum(length[:-1], length[1:])
        lead, bends = rounded_line(corners, np.minimum(width / 2, room / np.maximum(tangent, 1e-9)).tolist())
        outwards = np.vstack((line[:-1], lead[1:]))
        turned = [arc.shifted(len(line) - 2) for arc in bends]
        if k == 0:
            most = len(outwards) - 1
            turned = [Arc(most - arc.last, most - arc.first, -arc.bulge) for arc in turned[::-1]]
            arcs[k] = (*turned, *(arc.shifted(len(outwards) - len(line)) for arc in arcs[k]))
        else:
            arcs[k] = (*arcs[k], *turned)
        lines[k] = outwards[::sense]
        widths[k] = np.concatenate((widths[k][::sense], np.full(len(outwards) - len(line), width)))[::sense]
    led = replace(coil, lines=tuple(lines), widths=tuple(widths), arcs=tuple(arcs) if any(arcs) else ())
    return replace(place, coil=led)
