"""Drawings of a live display as plain values.

Curves of δ with presses, their list, and the trail.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import number_text, true_minus
from coilarray.design.model import Design
from coilarray.localize.inverse import Location
from coilarray.localize.presses import Press
from coilarray.viz.palette import INK, coil_colours
from coilarray.viz.studio.history import History
from coilarray.viz.studio.top_view import TopView

TAB, WINDOW = (520.0, 300.0), (1500.0, 400.0)
"""Width and height of the drawing of the curves in the studio and in a separate window, in its own unit."""

_LEFT, _RIM, _TOP, _FOOT = 64.0, 10.0, 16.0, 44.0  # about the axes
_LEAST_RANGE = 2e-6  # of δ, so that noise of a board at rest does not fill the picture
_ROOM = 0.06  # of the range of δ, above and below
_TICKS = 6


def state_colours(design: Design) -> dict[str, str]:
    """Colour of each state.

    It is the colour of the first coil that the state measures, as in every picture.
    """
    colours = coil_colours(design.array.names, design.array.centres)
    return {state.name: colours.get(state.measured[0][0], INK) for state in design.plan}


def curves(
    history: History, span: float, colours: Mapping[str, str], presses: Iterable[Press], size: tuple[float, float] = TAB
) -> dict[str, Any]:
    """Curves of δ over the last `span` in s.

    `span` is one of the `SPANS`. The drawing has ticks and the presses as marks. The axis of δ reaches from the least
    to the largest value shown.
    """
    times, least, largest = history.values(span)
    stop = max(history.end, span)
    start, right, bottom = stop - span, size[0] - _RIM, size[1] - _FOOT
    low, high = _limits(least, largest)

    def across(time: float) -> float:
        return round(_LEFT + (right - _LEFT) * (time - start) / span, 1)

    def down(delta: float) -> float:
        return round(bottom - (bottom - _TOP) * (delta - low) / (high - low), 1)

    shown = [
        {"name": name, "colour": colours.get(name, INK), "path": _path(times, least[k], largest[k], across, down)}
        for k, name in enumerate(history.states)
    ]
    marks = []
    for press in presses:
        end = history.end if press.end is None else press.end
        if end >= start:
            left = max(across(press.begin), _LEFT)
            marks.append({"number": press.number, "x": left, "width": max(round(across(end) - left, 1), 1.0)})
    return {
        "box": f"0 0 {size[0]:g} {size[1]:g}",
        "axes": {"x": _LEFT, "y": _TOP, "width": right - _LEFT, "height": bottom - _TOP},
        "x": [{"at": across(tick), "text": f"{tick:g}"} for tick in _ticks(start, stop)],
        "y": [{"at": down(tick * 1e-6), "text": true_minus(f"{tick:g}")} for tick in _ticks(low * 1e6, high * 1e6)],
        "curves": shown,
        "presses": marks,
    }


def _path(times: FloatArray, least: FloatArray, largest: FloatArray, across: Any, down: Any) -> str:
    """Path of a curve.

    It goes through the least and the largest value of each time. It is broken at times without values.
    """
    parts, before, reach = [], False, 0.0
    for time, a, b in zip(times.tolist(), least.tolist(), largest.tolist(), strict=True):
        if math.isnan(a):
            before = False
            continue
        x, first, last = across(time), a, b
        if before and abs(b - reach) < abs(a - reach):  # continue with the nearer value
            first, last = b, a
        parts.append(f"{'L' if before else 'M'}{x:g},{down(first):g}")
        if first != last or not before:
            parts.append(f"L{x:g},{down(last):g}")
        before, reach = True, last
    return "".join(parts)


def _limits(least: FloatArray, largest: FloatArray) -> tuple[float, float]:
    """Find the limits of the axis of δ."""
    known = np.isfinite(least)
    low = float(least[known].min(initial=0.0)) if known.any() else 0.0
    high = float(largest[known].max(initial=0.0)) if known.any() else 0.0
    missing = max(_LEAST_RANGE - (high - low), 0.0)
    room = _ROOM * (high - low + missing)
    return low - missing / 2 - room, high + missing / 2 + room


def _ticks(low: float, high: float) -> list[float]:
    ticks = MaxNLocator(_TICKS, steps=[1, 2, 5, 10]).tick_values(low, high)
    return [float(f"{tick:.12g}") + 0.0 for tick in ticks if low <= tick <= high]


def press_row(press: Press) -> dict[str, Any]:
    """Texts of a press for a list.

    They are number, begin, duration, place, depth, and the largest δ.
    """
    place, depth = "–", "–"
    if press.location is not None and press.location.modes:
        best = press.location.modes[0]
        known = (*best.known_deviations, None, None, None)[:3]
        x, y, depth = map(_length, (best.x, best.y, best.depth), known)
        place = f"{x}, {y}"
    return {
        "number": press.number,
        "begin": f"{press.begin:.2f}",
        "lasted": "…" if press.end is None else f"{press.end - press.begin:.2f}",
        "place": place,
        "depth": depth,
        "delta": true_minus(f"{press.delta * 1e6:+.0f}"),
    }


def press_places(view: TopView, presses: Iterable[Press]) -> list[dict[str, Any]]:
    """Known places of presses with their numbers."""
    places = []
    for press in presses:
        if press.location is not None and press.location.modes:
            x, y = view.point(press.location.modes[0].x, press.location.modes[0].y)
            places.append({"number": press.number, "x": x, "y": y})
    return places


def _length(value: float, sigma: float | None) -> str:
    return number_text(value * 1e3, 2) + ("" if sigma is None else f" ± {sigma * 1e3:.2f}")


def nearest_place(location: Location, before: tuple[float, float] | None) -> tuple[float, float]:
    """Place in m of the mode nearest the last place.

    So no trail jumps. Without a place before, it is the place of the best mode.
    """
    modes = location.modes
    if before is None:
        return modes[0].x, modes[0].y
    best = min(modes, key=lambda mode: math.hypot(mode.x - before[0], mode.y - before[1]))
    return best.x, best.y


def trail_lines(view: TopView, trail: Sequence[tuple[int, float, float]]) -> list[dict[str, Any]]:
    """Lines of a trail of places.

    A place is (number of the press, x, y in m). The lines are paler with age. No line goes from press to press.
    """
    lines = []
    for k, ((press, *start), (other, *end)) in enumerate(pairwise(trail), start=1):
        if press == other:
            (x1, y1), (x2, y2) = view.point(*start), view.point(*end)
            lines.append({"x1": x1, "y1": y1, "x2": x2, "y2": y2, "opacity": round(k / len(trail), 2)})
    return lines
