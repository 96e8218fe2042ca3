"""Ranges of entries, from coils and fabrication limits.

The design itself lies in every range, so a search never has to leave out its start.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from coilarray.design.model import Design, DesignFile
from coilarray.errors import GoalError

_MOST_CHOICES = 12  # of copper layers; more would need more points than a search has
_WIDER, _SMALLER = 1.25, 0.6  # relative to the present pitch or size
_OVERLAP = 0.5  # of the distance at which coils touch: nearer coils are nearly one coil
_TURNS_LESS, _TURNS_MORE = 0.4, 0.3  # of the turns


@dataclass(frozen=True)
class Row:
    """Table of a goal file, with its origin."""

    table: dict[str, Any]
    says: str


@dataclass(frozen=True)
class Pair:
    """Two coils with distance and touching distance in m.

    `shared` is whether they share copper layers.
    """

    names: tuple[str, str]
    distance: float
    touching: float
    share_copper: bool


def pairs(design: Design) -> list[Pair]:
    """All pairs of coils, the nearest first, from the middle."""
    places = design.array.placements
    middle = (design.array.centres.min(axis=0) + design.array.centres.max(axis=0)) / 2
    found, outlines = [], {place.name: place.to_board(place.coil.outline) - (place.x, place.y) for place in places}
    for one, other in itertools.combinations(places, 2):
        away = np.array([other.x - one.x, other.y - one.y])
        distance = float(np.hypot(*away))
        off = float(np.hypot(*((one.x + other.x) / 2 - middle[0], (one.y + other.y) / 2 - middle[1])))
        shares = bool(set(one.layers) & set(other.layers))
        ahead, behind = (outlines[place.name] @ (away / (distance or 1.0)) for place in (one, other))
        pair = Pair((one.name, other.name), distance, float(ahead.max() - behind.min()), shares)
        found.append((round(distance * 1e9), shares, round(off * 1e9), pair))
    return [pair for *_, pair in sorted(found, key=lambda known: known[:3])]


def neighbours(design: Design) -> Pair:
    """Two neighbours in the middle, if possible on different copper."""
    known = pairs(design)
    if not known:
        raise GoalError(f"the design {design.name} has only one coil, and so no coupling.")
    near = known[: len(design.array.neighbours)]
    return next((pair for pair in near if not pair.share_copper), near[0])


def pitch_ranges(file: DesignFile) -> list[Row]:
    """Range of the pitch of a lattice of several coils."""
    design, pitch = file.design, file.values.get("array.pitch_mm")
    known = pairs(design)
    if not isinstance(pitch, int | float) or not known:
        return []
    gap = design.rules.min_gap
    # a distance between two coils is the pitch times a constant ratio
    apart = max((pitch * (one.touching + gap) / one.distance for one in known if one.share_copper), default=0.0)
    near = neighbours(design)
    closest = pitch * _OVERLAP * near.touching / near.distance
    if apart > closest:
        low, why = apart, "nearer, coils on the same copper would meet"
    else:
        low, why = closest, "nearer, neighbours would be all but one coil"
    return [_between("array.pitch_mm", pitch, low, _WIDER * pitch, f"{why}; up to a quarter more than it is")]


def size_ranges(file: DesignFile) -> list[Row]:
    """Ranges of spirals' outer sizes that do not touch."""
    design = file.design
    room = min(
        ((one.distance - design.rules.min_gap) / one.touching for one in pairs(design) if one.share_copper),
        default=_WIDER,
    )
    if "array.pitch_mm" in file.values:
        room = _WIDER  # the lattice makes room
    more, why = min(_WIDER, room), "three fifths of that to a quarter more, as far as there is room"
    return [_between(key, size, _SMALLER * size, more * size, why) for key, size in _of_coils(file, "outer_")]


def turns_ranges(file: DesignFile) -> list[Row]:
    """Ranges of all turns per layer in whole steps."""
    ranges = []
    for key, turns in _of_coils(file, "turns_per_layer"):
        low = turns - min(max(1, round(_TURNS_LESS * turns)), math.ceil(turns) - 1)
        high = turns + max(1, round(_TURNS_MORE * turns))
        ranges.append(
            Row({"entry": key, "low": low, "high": high, "step": 1}, f"{turns:g} as it is, and whole turns around it")
        )
    return ranges


def trace_ranges(file: DesignFile) -> list[Row]:
    """Ranges of trace widths and gaps down to [fab]."""
    rules = file.design.rules
    limits = (("trace_width_mm", rules.min_trace * 1e3), ("gap_mm", rules.min_gap * 1e3))
    return [
        Row({"entry": key, "low": round(limit, 9), "high": value}, "from the limit of [fab] to what it is")
        for name, limit in limits
        for key, value in _of_coils(file, name)
        if value > limit * (1 + 1e-6)
    ]


def layer_choices(file: DesignFile) -> list[Row]:
    """Possible sets of copper layers, which coils take in turn."""
    sets = file.values.get("array.layers")
    if not isinstance(sets, list) or len(sets) < 2 or len(file.design.array.names) < 2:
        return []
    names, size = file.design.array.stackup.names, len(sets[0])
    used = [layer for one in sets for layer in one]
    if len(set(used)) < len(used) or any(len(one) != size for one in sets):
        return []
    choices, now = [sets], sorted(map(sorted, sets))
    for choice in _disjoint(names, size, len(sets)):
        if sorted(map(sorted, choice)) != now:
            choices.append(choice)
        if len(choices) > _MOST_CHOICES:
            return []
    if len(choices) == 1:
        return []
    return [Row({"entry": "array.layers", "choices": choices}, "as it is, and the other ways to share the layers")]


def termination_choices(file: DesignFile) -> list[Row]:
    """Possible terminations of unmeasured coils, if there are several."""
    key = "circuit.default_termination"
    now = file.values.get(key)
    if now not in ("short", "open") or len(file.design.array.names) < 2:
        return []
    return [Row({"entry": key, "choices": ["short", "open"]}, f"what closes the passive coils; {now} as it is")]


def rounded(value: float, digits: int, *, up: bool) -> float:
    """Round a number up or down to some digits.

    >>> rounded(13.28, 3, up=True), rounded(-0.0123, 1, up=False)
    (13.3, -0.02)
    """
    if value == 0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - digits + 1)
    steps = (math.ceil if up else math.floor)(round(value / unit, 6))
    return float(f"{steps * unit:.12g}")


def _between(key: str, now: float, low: float, high: float, why: str) -> Row:
    """Make a range of three digits with the present value."""
    ends = {"low": min(rounded(low, 3, up=True), now), "high": max(rounded(high, 3, up=True), now)}
    return Row({"entry": key, **ends}, f"{now:g} as it is; {why}")


def _of_coils(file: DesignFile, begins: str) -> list[tuple[str, float]]:
    """Numbers of used spirals, by keys that begin with `begins`."""
    used = {place.coil.name for place in file.design.array.placements}
    return [
        (key, float(value))
        for key, value in file.values.items()
        for name in used
        if key.startswith(f"coils.{name}.{begins}")
        and f"coils.{name}.turns_per_layer" in file.values
        and isinstance(value, int | float)
    ]


def _disjoint(names: tuple[str, ...], size: int, count: int) -> Iterator[list[list[str]]]:
    """Yield the ways to choose disjoint sets of layers."""
    if count == 0:
        yield []
        return
    for first in itertools.combinations(range(len(names)), size):
        # every set begins after the set before, so no way is repeated
        for rest in _disjoint(
            tuple(n for k, n in enumerate(names) if k > first[0] and k not in first), size, count - 1
        ):
            yield [[names[k] for k in first], *rest]
