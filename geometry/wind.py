"""Windings in series on several layers, with vias and leads."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import shapely

from coilarray.compute.arrays import FloatArray
from coilarray.errors import GeometryError
from coilarray.geometry.coil import Coil, Leads

if TYPE_CHECKING:
    from coilarray.geometry.spiral import Winding

_TOUCH = 1e-9  # of a gap: rounding


@lru_cache(maxsize=64)  # searches and sweeps change the array around one coil a thousand times
def wind(spiral: Winding) -> Coil:
    """Wind a spiral, naming the lead spacing a pad needs."""
    try:
        return _wind(spiral)
    except _NoRoomBesideLeadsError as error:
        raise GeometryError(f"{str(error)[:-1]}{_remedy(spiral)}.") from None


class _NoRoomBesideLeadsError(GeometryError):
    """A pad does not fit beside the leads."""


def _wind(spiral: Winding) -> Coil:
    winding_layers, via, leads = spiral.layers, spiral.via, spiral.leads
    if winding_layers < 1:
        raise GeometryError(f"a coil must have at least one winding layer; got {winding_layers}.")
    if spiral.return_lead and (winding_layers % 2 == 0 or leads is None):
        raise GeometryError(
            f"a return lead needs leads and an odd number of winding layers; got {winding_layers} "
            f"{'without' if leads is None else 'with'} leads."
        )
    windings = [spiral.centre_line(layer) for layer in range(winding_layers)]
    sense = 1.0 if spiral.winding == "ccw" else -1.0
    last, steps = winding_layers - 1, winding_layers * spiral.steps
    ends_inside = winding_layers % 2 == 1
    first_lead = last_lead = np.zeros((0, 2))
    if leads is not None:
        first_lead = _lead(windings[0][0], spiral.outwards(0), leads, -sense)
        if spiral.return_lead:
            corner = spiral.rim(steps)
            last_lead = np.vstack((corner, _lead(corner, spiral.outwards(steps), leads, sense)))
        elif not ends_inside:
            last_lead = _lead(windings[last][-1], spiral.outwards(steps), leads, sense)

    # the hole at the end of each layer: of every layer but the last, and of the last if it ends
    # inside at a hole
    pads = [via.pad] * last
    if leads is not None and ends_inside:
        pads.append(via.pad if spiral.return_lead else leads.terminal.pad)
    holes = _hole_points(spiral, windings, pads, leads, first_lead, last_lead)

    lines, begin = list(windings), [len(first_lead)] + [1] * last
    for layer, hole in enumerate(holes):
        lines[layer] = np.vstack((lines[layer], hole))
        if layer < last:
            lines[layer + 1] = np.vstack((hole, lines[layer + 1]))
    lines[0] = np.vstack((first_lead[::-1], lines[0]))
    if spiral.return_lead:
        lines.append(np.vstack((holes[last], last_lead)))
    else:
        lines[last] = np.vstack((lines[last], last_lead))
    widths = tuple(np.full(len(line) - 1, spiral.width) for line in lines)
    arcs = [tuple(arc.shifted(count) for arc in spiral.arcs(layer)) for layer, count in enumerate(begin)]
    arcs += [()] * (len(lines) - len(arcs))
    terminal = None if leads is None else leads.terminal
    outline, arcs_if_any = spiral.outline(), tuple(arcs) if any(arcs) else ()
    coil = Coil(tuple(lines), widths, spiral.gap, via, terminal, outline, spiral.name, arcs_if_any, spiral.stackup)
    object.__setattr__(coil, "wound", spiral)
    return coil


def _remedy(spiral: Winding) -> str:
    """Hint of the least lead spacing (to 0.1 mm) or ""."""
    leads = spiral.leads
    if leads is None:
        return ""

    def fits(tenths: int) -> bool:
        spacing = tenths * 1e-4
        wider = replace(leads, spacing=spacing, length=max(leads.length, spacing / 2))
        try:
            _wind(replace(spiral, leads=wider))
        except GeometryError:
            return False
        return True

    least = math.ceil(leads.spacing * 1e4)
    widest = 2 * least + math.ceil(4e4 * spiral.via.pad)
    if not fits(widest):
        return ""
    spacing = bisect_left(range(widest), True, lo=least, key=fits) / 10
    longer = f" with leads.length_mm of {spacing / 2:g}" if spacing * 1e-3 / 2 > leads.length else ""
    return f"; leads.spacing_mm of {spacing:g}{longer} makes it"


def _lead(end: FloatArray, outwards: FloatArray, leads: Leads, side: float) -> FloatArray:
    """Knee and terminal (2, 2) of one lead.

    `side` is +1 to the left seen outwards, −1 to the right.
    """
    tangent = np.array([-outwards[1], outwards[0]])
    half = leads.spacing / 2
    knee = end + half * (outwards + side * tangent)
    terminal = end + leads.length * outwards + side * half * tangent
    return np.array([terminal]) if np.allclose(knee, terminal, rtol=0, atol=1e-9) else np.array([knee, terminal])


def _hole_points(
    spiral: Winding,
    windings: Sequence[FloatArray],
    pads: Sequence[float],
    leads: Leads | None,
    first_lead: FloatArray,
    last_lead: FloatArray,
) -> list[FloatArray]:
    """Positions in m of holes at the ends of layers.

    They belong to the first `len(pads)` layers. A hole may be drilled through the whole board, so
    its pad must clear the windings, leads and holes of every layer. Holes at the same corner are
    spread like a fan.
    """
    lines = [*windings]
    fixed: list[tuple[FloatArray, float]] = []  # holes already placed: point and pad
    if leads is not None:
        lines.append(np.vstack((windings[0][:1], first_lead)))
        fixed.append((first_lead[-1], leads.terminal.pad))
        if len(last_lead):
            before = windings[-1][-1:] if len(windings) % 2 == 0 else last_lead[:0]
            lines.append(np.vstack((before, last_lead)))
            fixed.append((last_lead[-1], leads.terminal.pad))
    places: dict[tuple[bool, int], list[int]] = {}
    for layer in range(len(pads)):
        places.setdefault((layer % 2 == 0, (layer + 1) * spiral.steps % spiral.sides), []).append(layer)
    points: dict[int, FloatArray] = {}
    for (inside, step), layers in places.items():
        begins = [[line[end] for line, end in zip(windings[k : k + 2], (-1, 0), strict=False)] for k in layers]
        own = np.array([pads[layer] for layer in layers])
        direction = spiral.outwards(step) * (-1 if inside else 1)
        fan = _fan(spiral, spiral.junction(layers[0]), direction, own, begins, lines, fixed, inside=inside)
        for layer, point, stubs in zip(layers, fan, begins, strict=True):
            points[layer] = point
            fixed.append((point, pads[layer]))
            lines += [np.stack((begin, point)) for begin in stubs]
    return [points[layer] for layer in range(len(pads))]


def _fan(
    spiral: Winding,
    end: FloatArray,
    direction: FloatArray,
    pads: FloatArray,
    begins: Sequence[Sequence[FloatArray]],
    lines: Sequence[FloatArray],
    fixed: Sequence[tuple[FloatArray, float]],
    *,
    inside: bool,
) -> FloatArray:
    """Nearest points (m, 2) in m where all pads have clearance.

    They lie on rays from `end` about `direction`, towards the centre if `inside`. The `pads` (m,)
    keep the gap to all copper and to one another. `begins` are the beginnings of the stubs to each
    pad, `lines` the centre lines to be cleared, and `fixed` the other holes with their pad
    diameters, all in m.
    """
    m = len(pads)
    gap = (1 - _TOUCH) * spiral.gap  # a pad that just fits does so in every orientation of the coil
    # to the other side for a winding of the other sense, which is the mirror image
    across = (1 if spiral.winding == "ccw" else -1) * np.array([-direction[1], direction[0]])
    clear_of_trace = pads / 2 + gap + spiral.width / 2
    longest = float(np.hypot(*end)) if inside else 4 * m * float(clear_of_trace.max())
    distance = np.linspace(0.0, longest, 2001 if m == 1 else 401)[1:]
    obstacles = shapely.MultiLineString(list(lines))
    shapely.prepare(obstacles)
    # no stub leaves at less than 45° to the side of a circle
    openings = [0.0] if m == 1 else np.radians(np.linspace(4.0, min(60.0, 90.0 / (m - 1)), 29)).tolist()
    best = math.inf
    found: FloatArray | None = None
    for opening in openings:
        angle = opening * (np.arange(m) - (m - 1) / 2)
        rays = np.cos(angle)[:, None] * direction + np.sin(angle)[:, None] * across
        reachable = distance[distance < best]
        points = end + reachable[:, None, None] * rays
        clear = np.ones((len(points), m), dtype=bool)
        for centre, pad in fixed:
            clear &= np.hypot(*np.moveaxis(points - centre, -1, 0)) >= (pads + pad) / 2 + gap
            for i in range(m):
                beside = _to_stubs(centre, begins[i], points[:, i])
                clear[:, i] &= beside >= pad / 2 + gap + spiral.width / 2
        free = np.asarray(clear.all(axis=1))
        for i in range(m - 1):  # neighbours in the fan: pad beside pad, and either pad beside the other's stubs
            free &= 2 * reachable * math.sin(opening / 2) >= (pads[i] + pads[i + 1]) / 2 + gap
            for j, other in ((i, i + 1), (i + 1, i)):
                free &= _to_stubs(points[:, j], begins[other], points[:, other]) >= clear_of_trace[j]
        for i in range(m):  # last, and only if it decides: it takes by far the longest
            there = np.flatnonzero(free)
            free[there] = ~shapely.dwithin(shapely.points(points[there, i]), obstacles, float(clear_of_trace[i]))
        if free.any():
            first = int(np.argmax(free))
            best, found = float(reachable[first]), points[first]
    if found is None:
        where = (
            f"inside the winding, whose inner apothem is {spiral.inner_apothem * 1e3:.4g} mm"
            if inside
            else "outside the winding, beside the leads"
        )
        sizes = [f"{pad * 1e3:g} mm" for pad in dict.fromkeys(pads.tolist())]
        what = f"a pad of {sizes[0]}" if m == 1 else f"{m} pads of {' and '.join(sizes)}"
        kind = GeometryError if inside else _NoRoomBesideLeadsError
        raise kind(f"there is no room for {what} {where}.")
    return found


def _to_stubs(centre: FloatArray, begins: Sequence[FloatArray], ends: FloatArray) -> FloatArray:
    """Distance (n,) in m of places from the nearest stub."""
    nearest = np.full(len(ends), math.inf)
    for begin in begins:
        along = ends - begin
        share = np.clip(((centre - begin) * along).sum(axis=1) / (along**2).sum(axis=1), 0, 1)
        nearest = np.minimum(nearest, np.hypot(*(begin + share[:, None] * along - centre).T))
    return nearest
