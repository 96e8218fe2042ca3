"""Copper in copper: traces of an array that would be one conductor where they are counted as two."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import combinations

import numpy as np
import shapely

from coilarray.errors import GeometryError
from coilarray.geometry.array import CoilArray, Placement
from coilarray.geometry.coil import Coil
from coilarray.geometry.copper import MITRE_LIMIT, simple_outline, trace_outline
from coilarray.geometry.rules import KEPT_WITHIN, FabRules, Gap, clearances, trace_to_itself, trace_to_trace
from coilarray.geometry.values import place_in_mm

_NO_GAP = FabRules(min_gap=0.0)
_JOINED = FabRules().min_gap  # the corners that the rules count as joined copper, by their default


def require_apart(array: CoilArray) -> None:
    """Raise GeometryError if traces of two coils, or two turns of one coil, overlap on a layer.

    Measured as `coilarray.geometry.check_rules` does: the outlines of the traces of different coils, and within a coil
    the places that face each other across the way of the current. Traces may touch, and overlap by up to 1 µm as the
    limits of the rules may be missed by so much. Pads and holes are left to the rules.

    Examples
    --------
    >>> from coilarray.geometry import CoilArray, Placement, PlatedHole, Stackup, path_coil
    >>> coil = path_coil([[(0, 0), (1e-2, 0)]], 0.2e-3, 0.2e-3, PlatedHole(0.2e-3, 0.4e-3))
    >>> places = (Placement("A", coil, ("top",), 0, 0), Placement("B", coil, ("top",), 0, 0.15e-3))
    >>> require_apart(CoilArray(Stackup(("top",), (35e-6,), (), ()), places))
    Traceback (most recent call last):
    coilarray.errors.GeometryError: copper of A – B overlaps on layer top at (9.975, 0.075) mm, by 0.05 mm.
    """
    problem = _overlap(array)
    if problem:
        raise GeometryError(problem)


@lru_cache(maxsize=16)  # of the arrays in use: a design is computed with more than once
def _overlap(array: CoilArray) -> str:
    """Where the first overlap is, empty if there is none."""
    for layer in array.stackup.names:
        here = [one for one in array.placements if one.lines_on(layer)]
        for placement in here:
            gap = _overlap_within(placement.coil, placement.lines_on(layer))
            if gap is not None:
                x, y = placement.to_board(gap[1]).tolist()
                return _text(placement.name, layer, x, y, -gap[0])
        for one, other in _near_pairs(here, layer):
            copper = {each.name: shapely.union_all(_outlines(each, layer)) for each in (one, other)}
            for margin in clearances(layer, copper, _NO_GAP):
                if not margin.kept and margin.x is not None and margin.y is not None:
                    return _text(margin.feature, layer, margin.x, margin.y, -margin.value)
    return ""


def _near_pairs(here: Sequence[Placement], layer: str) -> Iterator[tuple[Placement, Placement]]:
    """Give the pairs of coils whose traces on a layer may meet; of those that lie to each other alike, one."""
    radius = np.array([_radius(one.coil, one.lines_on(layer)) for one in here])
    centres = np.array([(one.x, one.y) for one in here]).reshape(-1, 2)
    boxes = shapely.box(*(centres - radius[:, None]).T, *(centres + radius[:, None]).T)
    i, j = shapely.STRtree(boxes).query(boxes, predicate="intersects")
    seen = set()
    for a, b in zip(i[i < j].tolist(), j[i < j].tolist(), strict=True):
        one, other = here[a], here[b]
        c, s = math.cos(one.rotation), math.sin(one.rotation)
        apart = (centres[b] - centres[a]) @ np.array([[c, -s], [s, c]]) / radius[a]  # in the frame of the first coil
        turn = (other.rotation - one.rotation) / (2 * math.pi) % 1.0
        alike = (
            one.coil,
            one.lines_on(layer),
            other.coil,
            other.lines_on(layer),
            *np.round((*apart, turn), 9).tolist(),
        )
        if alike in seen:
            continue
        seen.add(alike)
        # a mitred corner stands out by so many half widths
        distance = MITRE_LIMIT * max(max(float(w.max()) for w in each.coil.widths) for each in (one, other))
        if shapely.dwithin(_centre_lines(one, layer), _centre_lines(other, layer), distance):
            yield one, other


def _centre_lines(placement: Placement, layer: str) -> shapely.MultiLineString:
    return shapely.MultiLineString([placement.to_board(placement.coil.lines[k]) for k in placement.lines_on(layer)])


@lru_cache(maxsize=256)
def _radius(coil: Coil, lines: tuple[int, ...]) -> float:
    """Radius in m about a coil's centre within which its traces lie."""
    return max(float(np.hypot(*coil.lines[k].T).max() + MITRE_LIMIT * coil.widths[k].max() / 2) for k in lines)


def _text(coils: str, layer: str, x: float, y: float, depth: float) -> str:
    return f"copper of {coils} overlaps on layer {layer} at {place_in_mm(x, y)}, by {depth * 1e3:.4g} mm."


def _outlines(placement: Placement, layer: str) -> list[shapely.Polygon]:
    """Outlines of the traces of a coil on a layer, in the frame of the board in m."""
    return [shapely.transform(_outline(placement.coil, line), placement.to_board) for line in placement.lines_on(layer)]


@lru_cache(maxsize=256)  # one of the coils of a lattice stands for all
def _outline(coil: Coil, line: int) -> shapely.Polygon:
    return trace_outline(coil.lines[line], coil.widths[line])


@lru_cache(maxsize=256)
def _overlap_within(coil: Coil, lines: tuple[int, ...]) -> Gap | None:
    """Deepest overlap of the lines of a coil that lie on one layer, in its own frame; None if there is none."""
    traces = [(coil.lines[k], coil.widths[k] / 2) for k in lines]
    found = [
        trace_to_itself(line, half, _JOINED, within=0.0)
        for line, half in traces
        if np.ptp(half) > 0 or simple_outline(line, 2 * float(half[0])) is None  # the cheaper of two that agree
    ]
    found += [trace_to_trace(one, other, within=0.0) for one, other in combinations(traces, 2)]
    deep = [gap for gap in found if gap is not None and gap[0] <= -KEPT_WITHIN]
    return min(deep, key=lambda gap: gap[0], default=None)
