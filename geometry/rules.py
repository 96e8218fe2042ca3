"""Fabrication rules as margins of each limit, and paths whose copper overlaps."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import MM, PLAIN, true_minus
from coilarray.compute.threads import Recent
from coilarray.errors import LARGEST, GeometryError, RuleViolationError
from coilarray.geometry.arcs import place_in_mm
from coilarray.geometry.array import Array, Placement
from coilarray.geometry.conductor import Conductor
from coilarray.geometry.copper import (
    MITRE_LIMIT,
    Drill,
    copper_by_layer,
    drills,
    drills_of,
    simple_outline,
    trace_outline,
)
from coilarray.geometry.stackup import Stackup

if TYPE_CHECKING:
    from coilarray.compute.threads import Progress

# Margins above −1 µm count as kept. The sides of successive turns of a polygonal spiral may not be
# quite parallel: turns of nominal gap s come as close as s − (w + s)·tan(π/N)·δ, with δ the
# difference of their tilts. Fabricators state their limits to 10 µm.
KEPT_WITHIN = 1e-6
_DECIMALS = 6  # of a length in m, as it is judged to 1 µm

_LARGEST = ("aspect ratio", "blind holes", "copper thickness", "layer count", "board size")  # limits from above
_HORIZON = 10.0  # limits. Pieces of copper that are further apart are not listed
_TRACE_DETOUR = 3.0  # way along a trace over the distance across that makes separate pieces, see `check_rules`
_PAD_DETOUR = 1.5  # the same for a pad and the trace that leaves it. A right angle at the pad has 1.42


@dataclass(frozen=True)
class FabRules:
    """Limits of a fabricator.

    The defaults suit common four-layer prototype services. They do not limit the board itself. Raises
    GeometryError if a limit is negative or not finite.

    Parameters
    ----------
    min_trace, min_drill : float
        Narrowest trace and smallest hole in m.
    min_gap : float
        Smallest distance in m of separate copper on one layer, also within one net.
    min_annular_ring : float
        Narrowest copper ring around a hole in m.
    min_edge_clearance : float
        Smallest distance in m of copper to the edge of the board.
    min_hole_spacing : float
        Smallest distance in m of two holes, wall to wall.
    max_layers : int or None
        Most copper layers.
    max_outer_copper, max_inner_copper : float or None
        Thickest copper in m of the outer and of the inner layers for which the other limits hold.
    max_aspect_ratio : float or None
        Largest ratio of the depth of a hole to its diameter.
    max_board : tuple of float or None
        Largest sides of the board in m, in either orientation.
    blind_holes : bool
        If False, every hole must go through the whole board.
    min_bend_ratio : float or None
        Smallest ratio of the inner radius of a bend to the thickness of the board. None for
        `usual_bend_ratio`.
    """

    min_trace: float = 0.1e-3
    min_gap: float = 0.1e-3
    min_drill: float = 0.2e-3
    min_annular_ring: float = 0.1e-3
    min_edge_clearance: float = 0.3e-3
    min_hole_spacing: float = 0.25e-3
    max_layers: int | None = None
    max_outer_copper: float | None = None
    max_inner_copper: float | None = None
    max_aspect_ratio: float | None = None
    max_board: tuple[float, float] | None = None
    blind_holes: bool = True
    min_bend_ratio: float | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            for number in () if value is None else value if isinstance(value, tuple) else (value,):
                if not 0 <= number <= LARGEST:
                    unit = "" if field.name in ("max_layers", "max_aspect_ratio", "min_bend_ratio") else " m"
                    raise GeometryError(f"{field.name} must be finite and not negative; got {number}{unit}.")

    def most_copper(self, layer: int, layers: int) -> float | None:
        """Thickest copper in m of `layer` of `layers`, None without a limit."""
        return self.max_inner_copper if 0 < layer < layers - 1 else self.max_outer_copper


BEND_RATIO_SOURCE = "usual for a bend that does not move, IPC-2223: 10 for one or two copper layers, 20 for more"
"""Reason for the ratio that holds where none is given."""


def usual_bend_ratio(layers: int) -> float:
    """Smallest ratio of the inner radius of a bend to the thickness of a board.

    IPC-2223 as board houses quote it (All Flex, I-Connect007, 11 October 2019), for a board of
    `layers` copper layers that is bent once. Bends that move need ten times as much.
    """
    return 10.0 if layers <= 2 else 20.0


@dataclass(frozen=True)
class Margin:
    """Margin of one rule at its worst place.

    It belongs to one `layer` and to one net or pair of nets, or to the board. The `rule` is "trace
    width", "spacing within net", "clearance", "annular ring", "drill", "hole spacing", "edge
    clearance", "aspect ratio", "bend ratio", "blind holes", "copper thickness", "layer count" or
    "board size". For holes the layer is the topmost that they pierce, and it is empty for the board
    as a whole. The `feature` is the net, both nets joined by " – ", or "board".

    `limit`, measured `value`, and the `margin` between them, positive if the rule is kept, have the
    `unit` "m", or none for a ratio or a count. `x` and `y` are the place on the board in m, None
    for rules without a place. `leads` are the coils of a broken clearance whose leads or terminals
    are there, outside their windings.
    """

    rule: str
    layer: str
    feature: str
    margin: float
    limit: float
    value: float
    x: float | None
    y: float | None
    unit: str = "m"
    leads: str = ""

    def __repr__(self) -> str:
        unit = MM if self.unit else PLAIN
        value, limit, margin = (unit.text(number, ".4") for number in (self.value, self.limit, self.margin))
        place = "" if self.x is None or self.y is None else f" at x {MM.text(self.x, '.4')}, y {MM.text(self.y, '.4')}"
        where = ", ".join(text for text in (self.rule, self.layer, self.feature) if text)
        verdict = "kept" if self.kept else "broken"
        return f"<Margin {verdict}: {where}: {value}, limit {limit}, margin {margin}{place}>"

    @property
    def kept(self) -> bool:
        """Whether the limit is kept to within `KEPT_WITHIN`."""
        return self.margin > -KEPT_WITHIN

    @property
    def at_most(self) -> bool:
        """Whether the limit is a largest value, not a smallest."""
        return self.rule in _LARGEST


def check_rules(array: Array, rules: FabRules, *, progress: Progress | None = None) -> tuple[Margin, ...]:
    """Measure every fabrication rule on every layer and on the board.

    `progress` is called with (done, total) as the work on the `array` and its `rules` goes on.

    Returns
    -------
    tuple of Margin
        A margin for each rule, layer and net or pair of nets, the smallest margin first. The order
        is: broken counts and ratios, broken lengths, kept lengths and ratios of the copper and its
        holes, and kept limits of the bare board. Distances beyond ten limits are not listed.

    Notes
    -----
    Pads count on every layer that their hole pierces, so a hole through foreign copper shows as a
    clearance. A terminal's pad without a hole has neither drill nor ring.

    The spacing within one net is the smallest distance of two places of its copper on one layer
    that face each other across a gap. The way between them along the copper is at least three times
    the distance of their centre lines, or one and a half times from a pad. Corners of 39° and more
    and the directly neighbouring segments of a path are joined copper, not a gap. Pads on which no
    trace of that layer ends, and two separate lines of one coil on one layer, always count.

    Overlapping copper of two nets has the value −d, with d the diameter of the largest circle in
    the overlap. The value is continuous at contact and saturates at the width of the narrower
    trace.

    Examples
    --------
    >>> from coilarray.geometry import Array, Placement, PlatedHole, Stackup, path_coil
    >>> coil = path_coil([[(0, 0), (1e-2, 0)]], 0.2e-3, 0.2e-3, PlatedHole(0.3e-3, 0.6e-3))
    >>> board = Array(
    ...     Stackup(("top",), (35e-6,), (), ()),
    ...     (Placement("A", coil, ("top",), 0, 0), Placement("B", coil, ("top",), 0, 0.35e-3)),
    ... )
    >>> worst = check_rules(board, FabRules())[0]
    >>> worst.rule, worst.feature, round(worst.margin * 1e3, 6)
    ('clearance', 'A – B', 0.05)
    """
    return _MEASURED.get((array, rules), lambda: _measured(array, rules, progress))


def _measured(array: Array, rules: FabRules, progress: Progress | None) -> tuple[Margin, ...]:
    """Margins of all rules, the smallest first."""
    holes = tuple(pad for pad in drills(array) if pad.drilled)
    done, total = itertools.count(1), len(array.stackup.names) * len(array.placements)
    low, high = np.reshape(array.bounds, (2, 2))
    margins = [*_of_board(array, holes, rules), *_holes(array, holes, rules)]
    for placement in array.placements:
        coil = placement.coil
        for layer in dict.fromkeys(placement.layers):
            line = min((float(coil.widths[k].min()), k) for k in placement.lines_on(layer))[1]
            widths, points = coil.widths[line], coil.lines[line]
            longest = int(np.argmax(np.where(widths == widths.min(), np.hypot(*np.diff(points, axis=0).T), -1.0)))
            place = placement.to_board(points[longest : longest + 2]).mean(axis=0)
            margins.append(_margin("trace width", layer, placement.name, float(widths.min()), rules.min_trace, place))
    for layer, copper in copper_by_layer(array).items():
        for net, shape in copper.items():
            xy = shapely.get_coordinates(shape)
            inside = np.column_stack((xy - low, high - xy)).min(axis=1)
            k = int(np.argmin(inside))
            margins.append(_margin("edge clearance", layer, net, float(inside[k]), rules.min_edge_clearance, xy[k]))
        for found in _clearances(layer, copper, rules):
            margins.append(found if found.kept else replace(found, leads=_leads_at(array, found)))
        nearest: dict[tuple[int, tuple[str, ...]], _Gap | None] = {}  # equal coils: same gaps
        for placement in array.placements:
            key = id(placement.coil), placement.layers
            if key not in nearest:
                nearest[key] = _gap_within(array, placement.at_origin(), layer, rules.min_gap)
            if (gap := nearest[key]) is not None:
                place = placement.to_board(gap[1])
                margins.append(_margin("spacing within net", layer, placement.name, gap[0], rules.min_gap, place))
            if progress is not None:
                progress(next(done), total)

    return worst_first(margins)


def worst_first(margins: Iterable[Margin]) -> tuple[Margin, ...]:
    """Sort margins, the broken ones first and those of the bare board last.

    A copper thickness as ordered has no margin at all and would hide the margins of the traces.
    Margins that are equal but for rounding stand in the order of their layers and nets.
    """

    def rank(margin: Margin) -> tuple[int, bool, float, str, str]:
        place = 0 if not margin.kept else 2 if margin.feature == "board" else 1
        value = round(margin.margin, 12)
        return place, (margin.unit == "m") != margin.kept, value, margin.layer, margin.feature

    return tuple(sorted(margins, key=rank))


# A command refuses broken rules first, and its report shows the same margins later.
_MEASURED: Recent[tuple[Margin, ...]] = Recent(4)


def require_rules(array: Array, rules: FabRules) -> None:
    """Raise RuleViolationError with the worst of broken rules."""
    require_kept(check_rules(array, rules))


def require_kept(margins: Iterable[Margin]) -> None:
    """Raise RuleViolationError if a margin of `check_rules` is broken."""
    broken = [margin for margin in margins if not margin.kept]
    if not broken:
        return
    worst = broken[0]
    more = "" if len(broken) == 1 else f"; {len(broken) - 1} more {'is' if len(broken) == 2 else 'are'} broken"
    layer = f" on layer {worst.layer}" if worst.layer else ""
    leads = f", at leads of {worst.leads}," if worst.leads else ""
    place = "" if worst.x is None or worst.y is None else f" at {place_in_mm(worst.x, worst.y)}"
    value, margin, limit = (
        f"{round(number * 1e3, 3):.5g} mm" if worst.unit == "m" else f"{number:.4g}"
        for number in (worst.value, worst.margin, worst.limit)
    )
    raise RuleViolationError(
        f"{worst.rule} of {worst.feature}{leads}{layer} is {value}{place}, "
        f"margin {margin} to the limit of {limit}{more}."
    )


def broken_rules(margins: Iterable[Margin]) -> list[str]:
    """Sentence about the worst place of each broken rule.

    >>> board = Margin("board size", "", "board", -0.01, 0.3, 0.31, None, None)
    >>> copper = Margin("clearance", "L2", "coil7 – coil12", -0.3e-3, 0.15e-3, -0.15e-3, 0.0, 0.0)
    >>> for sentence in broken_rules([board, copper]):
    ...     print(sentence)
    The board house's limit of board size is broken: 310 mm; its limit is 300 mm.
    The copper of coil7 and coil12 overlaps on L2, by up to 0.15 mm.
    """
    worst: dict[str, Margin] = {}
    for margin in margins:
        if margin.kept:
            continue
        if margin.rule not in worst or margin.margin < worst[margin.rule].margin - KEPT_WITHIN:  # alike: the first
            worst[margin.rule] = margin
    sentences = []
    for margin in worst.values():
        unit = MM if margin.unit else PLAIN
        lengths = (round(one, _DECIMALS) for one in (margin.value, margin.limit, -margin.value))
        value, limit, deep = (true_minus(unit.text(one, ".5")) for one in lengths)
        if margin.rule == "clearance" and margin.value < 0:
            nets = margin.feature.replace(" – ", " and ")
            leads = f", at leads of {margin.leads}" if margin.leads else ""
            sentences.append(f"The copper of {nets} overlaps on {margin.layer}, by up to {deep}{leads}.")
            continue
        feature = "" if margin.feature == "board" else f" at {margin.feature}"
        layer = f" on {margin.layer}" if margin.layer else ""
        house = f"The board house's limit of {margin.rule} is broken"
        sentences.append(f"{house}{feature}{layer}: {value}; its limit is {limit}.")
    return sentences


def _margin(
    rule: str, layer: str, feature: str, value: float, limit: float, place: npt.ArrayLike | None = None, unit: str = "m"
) -> Margin:
    x, y = (None, None) if place is None else np.asarray(place, dtype=np.float64).tolist()
    margin = limit - value if rule in _LARGEST else value - limit
    return Margin(rule, layer, feature, margin, limit, value, x, y, unit)


def _of_board(array: Array, holes: tuple[Drill, ...], rules: FabRules) -> Iterator[Margin]:
    """Margins of the bare board and of the depths of holes."""
    stackup, count = array.stackup, len(array.stackup.names)
    if rules.max_layers is not None:
        yield _margin("layer count", "", "board", count, rules.max_layers, unit="")
    for k, (layer, copper) in enumerate(zip(stackup.names, stackup.copper_thickness, strict=True)):
        limit = rules.most_copper(k, count)
        if limit is not None:
            yield _margin("copper thickness", layer, "board", copper, limit)
    if rules.max_board is not None:
        x_min, y_min, x_max, y_max = array.bounds
        for side, limit in zip(sorted((x_max - x_min, y_max - y_min)), sorted(rules.max_board), strict=True):
            yield _margin("board size", "", "board", side, limit)
    radius = math.inf if array.form is None else array.form.inner_radius(array.bounds, stackup.thickness)
    if math.isfinite(radius):
        ratio = radius / stackup.thickness
        limit = usual_bend_ratio(count) if rules.min_bend_ratio is None else rules.min_bend_ratio
        yield _margin("bend ratio", "", "board", ratio, limit, unit="")
    if holes and rules.max_aspect_ratio is not None:
        ratios = [
            (stackup.span(hole.layers[0])[1] - stackup.span(hole.layers[-1])[0]) / hole.diameter for hole in holes
        ]
        k = int(np.argmax(ratios))
        place = (holes[k].x, holes[k].y)
        layer, net = holes[k].layers[0], holes[k].net
        yield _margin("aspect ratio", layer, net, ratios[k], rules.max_aspect_ratio, place, unit="")
    if not rules.blind_holes:
        blind = [hole for hole in holes if hole.layers != stackup.names]
        yield _margin("blind holes", "", "board", len(blind), 0, unit="")


def _holes(array: Array, holes: tuple[Drill, ...], rules: FabRules) -> Iterator[Margin]:
    """Worst margins of drill, ring and hole spacing by net."""
    if not holes:
        return
    for net in array.names:
        own = [hole for hole in holes if hole.net == net]
        if own:
            thin = min(own, key=lambda hole: hole.diameter)
            yield _margin("drill", thin.layers[0], net, thin.diameter, rules.min_drill, (thin.x, thin.y))
            ring = min(own, key=lambda hole: hole.pad - hole.diameter)
            width = (ring.pad - ring.diameter) / 2
            yield _margin("annular ring", ring.layers[0], net, width, rules.min_annular_ring, (ring.x, ring.y))
    centre = np.array([(hole.x, hole.y) for hole in holes])
    radius = np.array([hole.diameter / 2 for hole in holes])
    i, j = np.triu_indices(len(holes), 1)
    wall = np.hypot(*(centre[i] - centre[j]).T) - radius[i] - radius[j]
    seen: set[tuple[str, str]] = set()
    for k in np.argsort(wall):
        a, b = holes[i[k]], holes[j[k]]
        if wall[k] > _HORIZON * rules.min_hole_spacing:
            return
        shared = [layer for layer in a.layers if layer in b.layers]
        if shared and (a.net, b.net) not in seen:
            seen.add((a.net, b.net))
            feature = a.net if a.net == b.net else f"{a.net} – {b.net}"
            place = 0.5 * (centre[i[k]] + centre[j[k]])
            yield _margin("hole spacing", shared[0], feature, float(wall[k]), rules.min_hole_spacing, place)


def _clearances(layer: str, copper: dict[str, BaseGeometry], rules: FabRules) -> Iterator[Margin]:
    """Distances in m of nets up to ten limits, −d if they overlap."""
    nets = list(copper)
    if len(nets) < 2:
        return
    shapes = np.array([copper[net] for net in nets])
    shapely.prepare(shapes)
    boxes = np.array([shapely.box(*shape.bounds) for shape in shapes])
    i, j = shapely.STRtree(boxes).query(boxes, predicate="dwithin", distance=_HORIZON * rules.min_gap)
    for a, b in sorted(zip(i[i < j].tolist(), j[i < j].tolist(), strict=True)):  # a tree's order is its own
        bridge = shapely.shortest_line(shapes[a], shapes[b])
        value, place = float(shapely.length(bridge)), shapely.get_coordinates(bridge).mean(axis=0)
        if value == 0:  # diameter and centre of the largest circle in an overlap
            parts = shapely.get_parts(shapely.intersection(shapes[a], shapes[b]))
            parts = parts[shapely.area(parts) > 0]
            if parts.size:
                radii = shapely.maximum_inscribed_circle(parts, tolerance=KEPT_WITHIN / 10)
                k = int(np.argmax(shapely.length(radii)))
                value, place = -2 * float(shapely.length(radii[k])), shapely.get_coordinates(radii[k])[0]
        if value <= _HORIZON * rules.min_gap:
            yield _margin("clearance", layer, f"{nets[a]} – {nets[b]}", value, rules.min_gap, place)


def _leads_at(array: Array, found: Margin) -> str:
    """Names of the two coils that have the place outside their winding."""
    if found.x is None or found.y is None:
        return ""
    near = KEPT_WITHIN + max(found.value, 0.0)
    place, nets = shapely.Point(found.x, found.y), found.feature.split(" – ")
    windings = {one.name: shapely.Polygon(one.to_board(one.coil.outline)) for one in array.placements}
    return " and ".join(net for net in nets if net in windings and windings[net].distance(place) > near)


_Gap = tuple[float, FloatArray]
"""Edge-to-edge distance in m of two places of one net, and the place between them, shape (2,)."""


def _gap_within(array: Array, placement: Placement, layer: str, limit: float) -> _Gap | None:
    """Smallest gap between pieces of one net on a layer."""
    coil = placement.coil
    holes = [pad for pad in drills_of(array, placement) if layer in pad.layers]
    traces = [(placement.to_board(coil.lines[k]), coil.widths[k] / 2) for k in placement.lines_on(layer)]
    found: list[_Gap | None] = []
    for a, b in itertools.combinations(holes, 2):  # pads that no short trace joins
        copper = (a.pad + b.pad) / 2
        joined = (line for line, _ in traces if None not in (_end_at(line, a), _end_at(line, b)))
        if not any(np.hypot(*np.diff(line, axis=0).T).sum() <= _PAD_DETOUR * (copper + limit) for line in joined):
            middle = np.array([0.5 * (a.x + b.x), 0.5 * (a.y + b.y)])
            found.append((math.hypot(a.x - b.x, a.y - b.y) - copper, middle))
    for line, half in traces:
        found += _pads_to_trace(line, half, holes, limit)
        found += [_trace_to_itself(line, half, limit, within=_HORIZON * limit)]
    found += [_trace_to_trace(one, other, within=_HORIZON * limit) for one, other in itertools.combinations(traces, 2)]
    gaps = [gap for gap in found if gap is not None and gap[0] <= _HORIZON * limit]
    return min(gaps, key=lambda gap: gap[0], default=None)


def _segments(line: FloatArray) -> npt.NDArray[np.object_]:
    return np.asarray(shapely.linestrings(np.stack((line[:-1], line[1:]), axis=1)))


def _trace_to_trace(
    one: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray], within: float
) -> _Gap | None:
    """Smallest gap up to `within` (m) of two half-wide traces."""
    segments, others = _segments(one[0]), _segments(other[0])
    i, j = shapely.STRtree(others).query(segments, predicate="dwithin", distance=one[1].max() + other[1].max() + within)
    if not len(i):
        return None
    gaps = shapely.distance(segments[i], others[j]) - one[1][i] - other[1][j]
    k = int(np.argmin(gaps))
    bridge = shapely.get_coordinates(shapely.shortest_line(segments[i[k]], others[j[k]]))
    return float(gaps[k]), bridge.mean(axis=0)


def _trace_to_itself(line: FloatArray, half: FloatArray, limit: float, within: float) -> _Gap | None:
    """Smallest gap up to `within` (m) within a trace."""
    near = min(float(4 * half.max()), within)
    while (gap := _gap_to_itself(line, half, limit, near)) is None and near < within:
        near = min(4 * near, within)  # a wide search costs the square of the number of segments
    return gap


def _gap_to_itself(line: FloatArray, half: FloatArray, limit: float, within: float) -> _Gap | None:
    """Gap up to `within` (m) within a trace, in one search."""
    segments = _segments(line)
    x_min, y_min, x_max, y_max = shapely.bounds(segments).T
    r = 2 * half.max() + within
    # boxes that overlap, which is cheaper than distances: those are computed below anyway
    i, j = shapely.STRtree(segments).query(shapely.box(x_min - r, y_min - r, x_max + r, y_max + r))
    i, j = i[j > i + 1], j[j > i + 1]
    copper = half[i] + half[j]  # from centre line to centre line where the edges meet
    step = np.diff(line, axis=0)
    length = np.hypot(*step.T)
    start = np.concatenate(([0.0], np.cumsum(length)))
    between = start[j] - start[i + 1]  # way from the end of segment i to the beginning of segment j
    joined = _TRACE_DETOUR * (copper + limit)
    along = step / length[:, None]
    a, b, distance = _nearest_beyond(line[j] - line[i + 1], along[i], along[j], length[i], length[j], joined - between)
    counts = (between + a + b >= _TRACE_DETOUR * distance) & (distance <= copper + within)
    if not counts.any():
        return None
    k = int(np.argmin(np.where(counts, distance - copper, np.inf)))
    place = 0.5 * (line[i[k] + 1] - a[k] * along[i[k]] + line[j[k]] + b[k] * along[j[k]])
    return float(distance[k] - copper[k]), place


def _nearest_beyond(
    apart: FloatArray,
    along_i: FloatArray,
    along_j: FloatArray,
    length_i: FloatArray,
    length_j: FloatArray,
    way: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Nearest places on pairs of segments, `way` apart along both.

    Lengths (n,) and vectors (n, 2) are in m. `apart` runs from the end of segment i to the
    beginning of segment j, and `along_…` are unit vectors. The difference apart + a·t_i + b·t_j of
    the places a back from the end of i and b onwards on j is linear, so its length is convex on the
    polygon 0 ≤ a ≤ l_i, 0 ≤ b ≤ l_j, a + b ≥ way, inf if that is empty. The minimum is zero inside,
    where the segments cross, or lies on an edge, as the distance of a point to a segment.
    """
    zero, least = np.zeros_like(way), np.maximum(way, 0.0)
    one = np.ones_like(way)
    edges = (  # where t = 0, direction in (a, b), range of t
        (length_i, zero, zero, one, np.maximum(way - length_i, 0), length_j),
        (zero, length_j, one, zero, np.maximum(way - length_j, 0), length_i),
        (zero, zero, zero, one, least, length_j),
        (zero, zero, one, zero, least, length_i),
        (zero, way, one, -one, np.maximum(way - length_j, 0), np.minimum(way, length_i)),
    )
    a0, b0, da, db, low, high = (np.array(column) for column in zip(*edges, strict=True))
    offset = apart + a0[..., None] * along_i + b0[..., None] * along_j
    direction = da[..., None] * along_i + db[..., None] * along_j
    square = np.maximum((direction**2).sum(axis=-1), 1e-30)  # zero for a hairpin's last edge
    t = np.clip(-(offset * direction).sum(axis=-1) / square, low, np.maximum(low, high))
    distance = np.where(low <= high, np.linalg.norm(offset + t[..., None] * direction, axis=-1), np.inf)
    a, b = a0 + t * da, b0 + t * db
    # of equally near places on parallel sides take the place furthest along
    best = np.argmin(distance - 1e-9 * (a + b), axis=0), np.arange(len(way))
    a, b, distance = a[best], b[best], distance[best]

    cross = along_i[:, 0] * along_j[:, 1] - along_i[:, 1] * along_j[:, 0]
    safe = np.where(cross == 0, 1.0, cross)
    a_cross = -(apart[:, 0] * along_j[:, 1] - apart[:, 1] * along_j[:, 0]) / safe
    b_cross = -(along_i[:, 0] * apart[:, 1] - along_i[:, 1] * apart[:, 0]) / safe
    crosses = (cross != 0) & (a_cross >= 0) & (a_cross <= length_i) & (b_cross >= 0) & (b_cross <= length_j)
    crosses &= a_cross + b_cross >= way
    return np.where(crosses, a_cross, a), np.where(crosses, b_cross, b), np.where(crosses, 0.0, distance)


def _end_at(line: FloatArray, hole: Drill) -> str | None:
    """Return which end of a line is at a pad."""
    near = np.hypot(*(line[[0, -1]] - (hole.x, hole.y)).T) < 1e-9
    return "first" if near[0] else "last" if near[1] else None


def _pads_to_trace(line: FloatArray, half: FloatArray, holes: list[Drill], limit: float) -> Iterator[_Gap]:
    """Gaps between pads and traces that do not enter them."""
    for hole in holes:
        end = _end_at(line, hole)
        points, radius = (line[::-1], half[::-1]) if end == "last" else (line, half)
        step = np.diff(points, axis=0)
        length = np.hypot(*step.T)
        start = np.concatenate(([0.0], np.cumsum(length)[:-1]))
        joined = 0.0 if end is None else _PAD_DETOUR * (hole.pad / 2 + radius + limit)
        low = np.clip(joined - start, 0, None)
        along = step / length[:, None]
        offset = points[:-1] - (hole.x, hole.y)
        t = np.clip(-(offset * along).sum(axis=1), low, np.maximum(low, length))
        distance = np.where(low <= length, np.hypot(*(offset + t[:, None] * along).T), np.inf)
        if end is not None:
            distance[start + t < _PAD_DETOUR * distance] = np.inf
        k = int(np.argmin(distance - radius))
        yield float(distance[k]) - hole.pad / 2 - float(radius[k]), points[k] + t[k] * along[k]


_NO_GAP = FabRules(min_gap=0.0)
_JOINED = FabRules().min_gap  # the corners that the rules count as joined copper, by their default
_ALIKE = 1e-9  # of a size: equal but for rounding


@dataclass(frozen=True, eq=False)
class _Trace:
    """Consecutive flat bars of path number `path`, in m.

    The centre line has the shape (n + 1, 2), the widths (n,). Traces of one `shape` are equal but
    for the place. `closed` is True if the trace is the whole path and its end meets its beginning.
    """

    path: int
    line: FloatArray
    widths: FloatArray
    z: float
    thickness: float
    closed: bool
    shape: int

    @cached_property
    def outline(self) -> shapely.Polygon:
        return trace_outline(self.line, self.widths)

    def is_level_with(self, other: _Trace) -> bool:
        return abs(self.z - other.z) < (0.5 - _ALIKE) * (self.thickness + other.thickness)


_Place = tuple[_Trace, _Trace, float, float, float]
"""Two traces (or one twice), their distance in m, negative for an overlap, and x and y in m."""


def require_apart(conductors: Sequence[Conductor], stackup: Stackup | None = None) -> None:
    """Raise GeometryError if flat bars overlap at one height.

    Distances are measured as in `coilarray.geometry.check_rules`. Copper may overlap by up to 1 µm,
    the tolerance of the rules, and the end of a path may meet its beginning. Bars that are not
    flat, such as vias, are left out. With the `stackup` the error names the layer instead of the
    height.

    >>> bars = [Conductor([[0, y, 0], [1e-2, y, 0]], 2e-4, 35e-6, name=name) for name, y in (("A", 0), ("B", 1.5e-4))]
    >>> require_apart(bars)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    coilarray.errors.GeometryError: copper of A – B overlaps on z 0 mm at (..., 0.075) mm, by 0.05 mm.
    """
    shapes: dict[bytes, int] = {}
    traces = [trace for number, one in enumerate(conductors) for trace in _traces(number, one, shapes)]
    for one, other, distance, x, y in itertools.chain(_within(traces), _between(traces)):
        if distance <= -KEPT_WITHIN:
            names = " – ".join(conductors[number].name for number in dict.fromkeys((one.path, other.path)))
            layers = {} if stackup is None else {stackup.centre(name): f"layer {name}" for name in stackup.names}
            at = layers.get(one.z, f"z {one.z * 1e3:.4g} mm")
            raise GeometryError(
                f"copper of {names} overlaps on {at} at {place_in_mm(x, y)}, by {-distance * 1e3:.4g} mm."
            )


def _traces(number: int, conductor: Conductor, shapes: dict[bytes, int]) -> Iterator[_Trace]:
    """Yield the flat runs of a path, recording their shapes."""
    vertices, z = conductor.vertices, conductor.vertices[:, 2]
    level = (np.abs(np.diff(z)) <= _ALIKE * conductor.lengths) & (np.abs(conductor.across[:, 2]) <= _ALIKE)
    flat = level & (conductor.widths > 0)
    ends = np.flatnonzero(np.diff(np.concatenate(([False], flat, [False])))).tolist()
    for start, stop in zip(ends[::2], ends[1::2], strict=True):
        line, widths = vertices[start : stop + 1, :2], conductor.widths[start:stop]
        closed = stop - start == len(flat) and np.hypot(*(line[-1] - line[0])) <= (widths[0] + widths[-1]) / 2
        key = _steps(line - line[0], line).tobytes() + widths.tobytes()
        thickness = float(conductor.thicknesses[start:stop].min())
        yield _Trace(
            number, line, widths, float(z[start]), thickness, bool(closed), shapes.setdefault(key, len(shapes))
        )


def _steps(way: FloatArray, line: FloatArray) -> FloatArray:
    """Vectors in small fractions of a line's size, without −0."""
    return np.asarray(np.round(way / (_ALIKE * np.abs(line - line[0]).max())) + 0.0)


def _within(traces: Sequence[_Trace]) -> Iterator[_Place]:
    """Yield nearest places of one path that face each other."""
    for trace in {trace.shape: trace for trace in traces}.values():
        # the cheaper of two that agree
        if np.ptp(trace.widths) > 0 or simple_outline(trace.line, float(trace.widths[0])) is None:
            for line, widths in _opened(trace) if trace.closed else [(trace.line, trace.widths)]:
                gap = _trace_to_itself(line, widths / 2, _JOINED, within=0.0)
                if gap is not None:
                    yield trace, trace, gap[0], *gap[1].tolist()
    for _, own in itertools.groupby(traces, key=lambda trace: trace.path):
        for one, other in itertools.combinations(own, 2):
            if one.is_level_with(other):
                gap = _trace_to_trace((one.line, one.widths / 2), (other.line, other.widths / 2), within=0.0)
                if gap is not None:
                    yield one, other, gap[0], *gap[1].tolist()


def _opened(trace: _Trace) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield a closed trace without either end, which are joined."""
    for line, widths in ((trace.line, trace.widths), (trace.line[::-1], trace.widths[::-1])):
        step = np.diff(line, axis=0)
        way = np.cumsum(np.hypot(*step.T))
        left = _TRACE_DETOUR * (float(widths.max()) + _JOINED)
        if left < way[-1]:
            k = int(np.searchsorted(way, left, side="right"))
            begin = line[k + 1] - (way[k] - left) / np.hypot(*step[k]) * step[k]
            yield np.vstack((begin, line[k + 1 :])), widths[k:]


def _between(traces: Sequence[_Trace]) -> Iterator[_Place]:
    """Yield places where two paths meet, equal pairs once."""
    margin = MITRE_LIMIT / 2 * np.array([trace.widths.max() for trace in traces])
    low = np.array([trace.line.min(axis=0) for trace in traces]).reshape(-1, 2) - margin[:, None]
    high = np.array([trace.line.max(axis=0) for trace in traces]).reshape(-1, 2) + margin[:, None]
    boxes = np.array(shapely.box(*low.T, *high.T))
    i, j = shapely.STRtree(boxes).query(boxes, predicate="intersects")
    seen = set()
    for a, b in sorted(zip(i[i < j].tolist(), j[i < j].tolist(), strict=True)):
        one, other = traces[a], traces[b]
        if one.path == other.path or not one.is_level_with(other):
            continue
        alike = (one.shape, other.shape, *_steps(other.line[0] - one.line[0], one.line).tolist())
        if alike in seen:
            continue
        seen.add(alike)
        if shapely.dwithin(shapely.LineString(one.line), shapely.LineString(other.line), float(margin[a] + margin[b])):
            for found in _clearances("", {"one": one.outline, "other": other.outline}, _NO_GAP):
                if found.x is not None and found.y is not None:
                    yield one, other, found.value, found.x, found.y
