"""Overlapping copper of paths or of turns of one path."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, combinations, groupby

import numpy as np
import shapely

from coilarray.compute.arrays import FloatArray
from coilarray.errors import GeometryError
from coilarray.geometry.arcs import place_in_mm
from coilarray.geometry.conductor import Conductor
from coilarray.geometry.copper import MITRE_LIMIT, simple_outline, trace_outline
from coilarray.geometry.rules import KEPT_WITHIN, TRACE_DETOUR, FabRules, clearances, trace_to_itself, trace_to_trace
from coilarray.geometry.stackup import Stackup

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
    for one, other, distance, x, y in chain(_within(traces), _between(traces)):
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
    flat = (np.abs(np.diff(z)) <= _ALIKE * conductor.lengths) & (conductor.widths > 0)
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
                gap = trace_to_itself(line, widths / 2, _JOINED, within=0.0)
                if gap is not None:
                    yield trace, trace, gap[0], *gap[1].tolist()
    for _, own in groupby(traces, key=lambda trace: trace.path):
        for one, other in combinations(own, 2):
            if one.is_level_with(other):
                gap = trace_to_trace((one.line, one.widths / 2), (other.line, other.widths / 2), within=0.0)
                if gap is not None:
                    yield one, other, gap[0], *gap[1].tolist()


def _opened(trace: _Trace) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield a closed trace without either end.

    End and beginning are joined to each other.
    """
    for line, widths in ((trace.line, trace.widths), (trace.line[::-1], trace.widths[::-1])):
        step = np.diff(line, axis=0)
        way = np.cumsum(np.hypot(*step.T))
        left = TRACE_DETOUR * (float(widths.max()) + _JOINED)
        if left < way[-1]:
            k = int(np.searchsorted(way, left, side="right"))
            begin = line[k + 1] - (way[k] - left) / np.hypot(*step[k]) * step[k]
            yield np.vstack((begin, line[k + 1 :])), widths[k:]


def _between(traces: Sequence[_Trace]) -> Iterator[_Place]:
    """Yield the places where traces of two paths meet.

    Pairs with the same relative position are measured once.
    """
    margin = MITRE_LIMIT / 2 * np.array([trace.widths.max() for trace in traces])
    low = np.array([trace.line.min(axis=0) for trace in traces]).reshape(-1, 2) - margin[:, None]
    high = np.array([trace.line.max(axis=0) for trace in traces]).reshape(-1, 2) + margin[:, None]
    boxes = np.array(shapely.box(*low.T, *high.T))
    i, j = shapely.STRtree(boxes).query(boxes, predicate="intersects")
    seen = set()
    for a, b in zip(i[i < j].tolist(), j[i < j].tolist(), strict=True):
        one, other = traces[a], traces[b]
        if one.path == other.path or not one.is_level_with(other):
            continue
        alike = (one.shape, other.shape, *_steps(other.line[0] - one.line[0], one.line).tolist())
        if alike in seen:
            continue
        seen.add(alike)
        if shapely.dwithin(shapely.LineString(one.line), shapely.LineString(other.line), float(margin[a] + margin[b])):
            for found in clearances("", {"one": one.outline, "other": other.outline}, _NO_GAP):
                if found.x is not None and found.y is not None:
                    yield one, other, found.value, found.x, found.y
