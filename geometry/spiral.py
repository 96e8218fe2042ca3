"""Spirals: layers with straight or round corners, wound in series with vias and leads.

The rules "parallel" and "corner" are in docs/theory/conductors.md, "Shape of a winding". With many
sides the step inwards of one pitch w + s can be longer than the last side. The next turn then
begins on an earlier side, and the remaining sides are left out. With "corner", vertex k of a spiral
with sharp corners lies at the angle 2πk/N from the first corner, on the polygon with the apothem
(outer edge apothem − w/2) − (w + s)·k/N. With round corners, side k of a layer, counted from 0,
lies w/2 + (w + s)·k/N further in.

The corner after side k is an arc with the same centre in every turn, so the gap s is kept in the
corners too. Where the radius would fall below one trace width, it is one trace width. A circle is a
square with the largest possible corner radius: quarter circles joined by straight pieces of a
quarter pitch.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.errors import GeometryError, require_positive, require_whole
from coilarray.geometry.arcs import Arc, rounded_line
from coilarray.geometry.coil import LEADS, VIA, Coil, Leads, PlatedHole
from coilarray.geometry.conductor import SingleCoil
from coilarray.geometry.stackup import Stackup
from coilarray.geometry.usual_values import require_coil_size, warn_unusual

Sense = Literal["ccw", "cw"]  # sense of rotation of the current seen from above (+z)
WindingRule = Literal["parallel", "corner"]
"""Rule by which turns step in: on the last side only, or partly at every corner."""
_TOUCH = 1e-9  # of a gap: rounding


def across_flats(across_corners: float, sides: int) -> float:
    """Size in m across the flats of a regular polygon.

    `across_corners` is its size in m across corners. For an odd number of `sides`, these are twice
    the apothem and twice the circumradius.

    >>> round(across_flats(23e-3, 6) * 1e3, 4)
    19.9186
    """
    require_positive("size across corners", across_corners)
    if sides < 3:
        raise GeometryError(f"sides must be at least 3; got {sides}.")
    return across_corners * math.cos(math.pi / sides)


@dataclass(frozen=True, kw_only=True)
class Construction:
    """Layers, vias, leads and board of a wound coil."""

    layers: int = 2
    via: PlatedHole = VIA
    leads: Leads | None = LEADS
    return_lead: bool = False
    stackup: Stackup | None = None
    name: str = ""
    winding: Sense = "ccw"
    winding_rule: WindingRule = "parallel"


class Winding(Construction, SingleCoil):
    """Base of spirals with N sides per turn."""

    sides: int
    turns: float
    width: float
    gap: float

    def __repr__(self) -> str:
        sizes = [field for field in fields(self) if not field.kw_only]
        others = [field for field in fields(self) if field.kw_only and getattr(self, field.name) != field.default]
        values = ", ".join(f"{field.name}={getattr(self, field.name)!r}" for field in sizes + others)
        return f"{type(self).__name__}({values})"

    def coil(self) -> Coil:
        """Wind the layers in series, with vias and leads.

        Vias lie on the corner's ray, where their pads keep the gap to the windings and leads of
        every layer, so that they can be drilled through the whole board. Several vias at one corner
        spread to both sides of the ray. Raises GeometryError if there is no layer, no room for a
        via inside the winding, or a return lead without leads or with an even number of layers.

        >>> coil = Spiral(6, 20e-3, 10, 0.15e-3, 0.15e-3).coil()
        >>> len(coil.lines), coil.via_points.shape
        (2, (1, 2))
        """
        return _wound(self)

    @property
    def pitch(self) -> float:
        """Distance in m between neighbouring turns, centre to centre."""
        return self.width + self.gap

    @property
    def steps(self) -> int:
        """Number of sides in one layer."""
        return round(self.turns * self.sides)

    @property
    def is_parallel(self) -> bool:
        """Whether each turn is parallel to the enclosing shape."""
        return self.winding_rule == "parallel"

    @property
    def inner_apothem(self) -> float:
        """Apothem in m of the centre line's inner end."""
        turns_in = (self.steps - 1) // self.sides if self.is_parallel else self.turns
        return self._apothem - self.width / 2 - self.pitch * turns_in

    def centre_line(self, layer: int = 0) -> FloatArray:
        """Vertices (n, 2) of one layer in m, along the current.

        Even layers, counted from 0, run inwards, odd layers outwards. Arcs are short straight
        pieces. If parallel sides are too short for the step inwards, there are fewer than steps + 1
        vertices.
        """
        return self._line(layer)[0]

    def arcs(self, layer: int = 0) -> tuple[Arc, ...]:
        """Return the arcs of one layer's centre line, in order."""
        return self._line(layer)[1]

    @abstractmethod
    def outline(self) -> FloatArray:
        """Corners (n, 2) in m of the nominal outer copper edge."""

    def rim(self, step: int) -> FloatArray:
        """Start (2,) in m of the outermost side `step`: its middle or beginning."""
        sides = self._sides_at(step)
        points = self._corners if len(sides) == 2 else self._foot
        return np.asarray(points(sides, np.full(len(sides), self.width / 2))[0])

    def junction(self, layer: int) -> FloatArray:
        """Point (2,) in m between a `layer` and the next.

        If the ends do not meet, they lie about the ray through it. With sharp parallel corners it is the
        corner where a further turn would begin.
        """
        if not self._starts_at_corner:
            return np.asarray(self.centre_line(layer)[-1])
        step = (layer + 1) * self.steps
        inset = self.width / 2 + (self.pitch * (self.steps // self.sides) if layer % 2 == 0 else 0.0)
        return np.asarray(self._corners(np.array([step - 1, step]), np.full(2, inset))[0])

    def outwards(self, step: int) -> FloatArray:
        """Direction (2,) of the leads after a `step`, opposite to vias inside."""
        between = self._normals(self._sides_at(step))[0].sum(axis=0)
        return np.asarray(between / float(np.hypot(*between)))

    @property
    @abstractmethod
    def _apothem(self) -> float:
        """Half of the smaller outer size in m."""

    @property
    @abstractmethod
    def _starts_at_corner(self) -> bool:
        """Whether the turns are parallel and have sharp corners."""

    def _sides_at(self, step: int) -> IntArray:
        """Numbers of the sides that meet where side `step` starts, one in its middle."""
        return np.array([step - 1, step] if self._starts_at_corner else [step])

    @abstractmethod
    def _normals(self, sides: IntArray) -> tuple[FloatArray, FloatArray]:
        """Outward normals (n, 2) and distances in m of enclosing sides."""

    @abstractmethod
    def _stepped_line(self, layer: int) -> tuple[FloatArray, tuple[Arc, ...]]:
        """Centre line and arcs of a layer without sharp corners."""

    def _insets(self, inwards: IntArray) -> FloatArray:
        """Distances in m of sides from the enclosing shape."""
        turns = inwards // self.sides if self.is_parallel else inwards / self.sides
        return np.asarray(self.width / 2 + self.pitch * turns)

    def _radii(self, inset: FloatArray) -> FloatArray:
        """Radii (n − 1,) in m of corners between sides."""
        return np.zeros(len(inset) - 1)

    def _corners(self, sides: IntArray, inset: FloatArray) -> FloatArray:
        """Intersections (n − 1, 2) in m of sides moved in by `inset`."""
        normal, distance = self._normals(sides)
        (a, b), p = (normal[:-1], normal[1:]), distance - inset
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        x = (p[:-1] * b[:, 1] - p[1:] * a[:, 1]) / cross
        y = (p[1:] * a[:, 0] - p[:-1] * b[:, 0]) / cross
        return np.column_stack((x, y))

    def _foot(self, sides: IntArray, inset: FloatArray) -> FloatArray:
        """Points in m of moved sides nearest to the centre."""
        normal, distance = self._normals(sides)
        return np.asarray((distance - inset)[:, None] * normal)

    def _line(self, layer: int) -> tuple[FloatArray, tuple[Arc, ...]]:
        """Centre line (n, 2) in m of one layer, and its arcs."""
        if not self._starts_at_corner:
            return self._stepped_line(layer)
        number = np.arange(-1, self.steps + 1)  # the first and the last only bound
        sides = layer * self.steps + number if layer % 2 == 0 else (layer + 1) * self.steps - 1 - number
        line = self._parallel_corners(sides, self._insets(np.maximum(number, 0)))[0]
        return line if layer % 2 == 0 else line[::-1], ()

    def _parallel_corners(self, sides: IntArray, inset: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Corners in m between parallel sides, and their radii.

        Sides that are too short for the step inwards are left out, so the next turn begins before them.
        """
        while True:
            corners, radii = self._corners(sides, inset), self._radii(inset)
            normal, distance = self._normals(sides)
            (ax, ay), (bx, by) = normal[:-1].T, normal[1:].T
            turn = np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
            tangent = radii * np.tan(np.abs(turn) / 2)
            along = np.sign(turn[:-1, None]) * np.column_stack((-normal[1:-1, 1], normal[1:-1, 0]))
            straight = (np.diff(corners, axis=0) * along).sum(axis=1) - tangent[:-1] - tangent[1:]
            near = 1e-12 * float(distance.max())
            # arcs may touch end to end, but sharp corners must not coincide
            short = straight < np.where(tangent[:-1] + tangent[1:] > 0, -near, near)
            if not short.any():
                return corners, radii
            kept = np.concatenate(([True], ~short, [True]))
            sides, inset = sides[kept], inset[kept]

    def _turned(self, steps: npt.ArrayLike) -> FloatArray:
        """Angle in rad after steps, with the winding's sign."""
        # the whole number of steps keeps corners of different turns and layers on the same rays
        angle = 2 * math.pi * (np.asarray(steps) % self.sides) / self.sides
        return np.asarray(angle if self.winding == "ccw" else -angle)

    def _require_turns(self, least: float, direction: str) -> None:
        """Raise GeometryError if turns come within `least` (m)."""
        outer = self._apothem
        require_whole("layers", self.layers, 1)
        if not math.isfinite(getattr(self, direction)):
            raise GeometryError(f"{direction} must be finite; got {getattr(self, direction)}.")
        if self.winding not in ("ccw", "cw"):
            raise GeometryError(f"winding must be 'ccw' or 'cw'; got {self.winding!r}.")
        if self.winding_rule not in ("parallel", "corner"):
            raise GeometryError(f"winding_rule must be 'parallel' or 'corner'; got {self.winding_rule!r}.")
        steps = self.turns * self.sides
        if abs(steps - round(steps)) > 1e-9 * steps:
            near = max(round(steps), 1)
            raise GeometryError(
                f"turns must be a multiple of 1/{self.sides}, for example {near / self.sides:.12g}; got {self.turns:g}."
            )
        deepest = self.steps // self.sides if self.is_parallel else self.turns
        if outer - self.width / 2 - self.pitch * deepest <= least:
            pitches = max((outer - self.width / 2 - least) / self.pitch, 0.0)
            fit = math.floor(pitches * self.sides) / self.sides
            if self.is_parallel and pitches:  # the last turn steps in at its end only
                fit = math.floor(pitches) + 1 - 1 / self.sides
            raise GeometryError(
                f"{self.turns:g} turns of {self.width * 1e3:g} mm trace and {self.gap * 1e3:g} mm gap do not "
                f"fit into {outer * 1e3:g} mm from edge to centre; at most {fit:.4g} turns fit."
            )


@dataclass(frozen=True, repr=False)
class Spiral(Winding):
    """Polygonal spiral coil, such as a hexagon or a square.

    Even layers are wound inwards, odd layers outwards. A layer begins at a corner of the outermost
    turn, where the layer before ended, so the current keeps its sense of rotation. The outer ends
    of two layers lie above each other, the inner ends symmetrically about the corner, where a via
    joins them. Raises GeometryError if a size is not positive and finite, if there are fewer than 3
    sides, or if the turns do not fit.

    Parameters
    ----------
    sides : int
        Number of sides of the polygon, at least 3.
    diameter : float
        Size in m across flats, from outer copper edge to outer copper edge. For odd `sides` it is
        twice the apothem.
    turns : float
        Turns per layer, a positive multiple of 1/sides.
    width, gap : float
        Width of the trace and of the gap between turns in m.
    first_corner : float, optional
        Angle in rad of the corner where the outermost turn starts and the leads leave. 0 is the +x
        axis. By default a side faces +x, and it is the corner nearest to +y.
    layers : int
        Copper layers that are wound in series. With an odd number the path ends inside.
    via : PlatedHole
        Hole that joins consecutive layers.
    leads : Leads or None
        Leads to the terminals. None for bare ends.
    return_lead : bool
        For an odd number of layers, add a layer with a straight trace from the inner end out to the
        second terminal.
    stackup, name
        As in `Coil`.
    winding : {"ccw", "cw"}
        Sense of rotation of the current seen from above (+z).
    winding_rule : {"parallel", "corner"}
        "parallel": all sides of the outermost turn lie at the stated size, and each turn steps in
        on its last side, or a few sides earlier if sides are shorter than a step. "corner": each
        corner lies 1/sides of a pitch further in than the corner before. No side is then parallel
        to the enclosing polygon, and only the first corner reaches it.

    Examples
    --------
    >>> coil = Spiral(sides=6, diameter=16e-3, turns=12, width=0.15e-3, gap=0.15e-3, layers=2)
    >>> f"{coil.inductance * 1e6:.1f} µH, {coil.resistance:.1f} Ω"
    '10.1 µH, 3.4 Ω'
    """

    sides: int
    diameter: float
    turns: float
    width: float
    gap: float
    first_corner: float = None  # type: ignore[assignment]  # set in __post_init__

    def __post_init__(self) -> None:
        require_whole("sides", self.sides, 3)
        for name in ("diameter", "turns", "width", "gap"):
            require_positive(name, getattr(self, name), "")
        require_coil_size(self.diameter)
        sizes = (("outer_across_flats_mm", self.diameter), ("trace_width_mm", self.width), ("gap_mm", self.gap))
        warn_unusual(sizes)
        if vars(self)["first_corner"] is None and self.sides >= 3:
            side = 2 * math.pi / self.sides
            upwards = side * (0.5 + round((math.pi / 2 - side / 2) / side))
            object.__setattr__(self, "first_corner", upwards)
        self._require_turns(self.width / 2, "first_corner")

    def outline(self) -> FloatArray:
        """Corners (sides, 2) in m of the nominal outer copper edge."""
        return self._on_rays(np.arange(self.sides), np.full(self.sides, self.diameter / 2))

    @property
    def _apothem(self) -> float:
        return self.diameter / 2

    @property
    def _starts_at_corner(self) -> bool:
        return self.is_parallel

    def _sides_at(self, step: int) -> IntArray:
        return np.array([step - 1, step])

    def _stepped_line(self, layer: int) -> tuple[FloatArray, tuple[Arc, ...]]:
        k = np.arange(self.steps + 1)
        inwards = k if layer % 2 == 0 else self.steps - k
        apothem = (self.diameter / 2 - self.width / 2) - self.pitch * inwards / self.sides
        return self._on_rays(layer * self.steps + k, apothem), ()

    def _normals(self, sides: IntArray) -> tuple[FloatArray, FloatArray]:
        half = math.pi / self.sides if self.winding == "ccw" else -math.pi / self.sides
        angle = self.first_corner + half + self._turned(sides)
        return np.column_stack((np.cos(angle), np.sin(angle))), np.full(len(sides), self.diameter / 2)

    def _on_rays(self, steps: IntArray, apothem: FloatArray) -> FloatArray:
        """Points in m at steps, on polygons of given apothems."""
        radius = apothem / math.cos(math.pi / self.sides)
        angle = self.first_corner + self._turned(steps)
        return np.column_stack((radius * np.cos(angle), radius * np.sin(angle)))


@dataclass(frozen=True, repr=False)
class RoundedSpiral(Winding):
    """Spiral coil with round or sharp corners, wound as a `Spiral`.

    It may be a rectangle, a racetrack, a circle or a rounded polygon.

    Raises GeometryError as `Spiral`, if the two sizes differ without four sides, or if the radius
    does not fit.

    Parameters
    ----------
    extent, breadth : float
        Sizes in m between the outer copper edges, along the direction in which the winding starts
        and across it. For a number of sides other than four, both are equal to twice the apothem.
    turns, width, gap, layers, via, leads, return_lead, stackup, name, winding
        As in `Spiral`.
    corner_radius : float
        Radius in m of the outer copper edge at the corners, up to half of the smaller size. 0 for
        sharp corners.
    sides : int
        Sides of the enclosing polygon, at least 3.
    direction : float
        Angle in rad of the middle of the outermost turn's first side, seen from the centre. The
        turn starts there. With parallel sides and sharp corners it starts at the beginning of the
        side.
    winding_rule : {"parallel", "corner"}
        As in `Spiral`. A circle always follows "corner": its outer edge starts on the circle of the
        stated size and approaches the centre steadily.

    Examples
    --------
    >>> circle = RoundedSpiral(20e-3, 20e-3, 8, 0.2e-3, 0.2e-3, corner_radius=10e-3)
    >>> [round(float(x) * 1e3, 6) + 0.0 for x in circle.centre_line()[0]], len(circle.arcs())
    ([9.9, 0.0], 32)
    """

    extent: float
    breadth: float
    turns: float
    width: float
    gap: float
    corner_radius: float = 0.0
    sides: int = 4
    direction: float = 0.0

    def __post_init__(self) -> None:
        require_whole("sides", self.sides, 3)
        for name in ("extent", "breadth", "turns", "width", "gap"):
            require_positive(name, getattr(self, name), "")
        require_coil_size(max(self.extent, self.breadth))
        sizes = (("outer_width_mm", self.extent), ("outer_height_mm", self.breadth))
        warn_unusual((*sizes, ("trace_width_mm", self.width), ("gap_mm", self.gap)))
        if self.sides != 4 and self.breadth != self.extent:
            raise GeometryError(
                f"extent and breadth must be equal for {self.sides} sides; got {self.extent} m and {self.breadth} m."
            )
        smaller = self._apothem
        if not 0 <= self.corner_radius <= smaller * (1 + 1e-12):
            raise GeometryError(
                f"corner_radius must be 0 to {smaller * 1e3:g} mm, half of the smaller size; "
                f"got {self.corner_radius * 1e3:g} mm."
            )
        self._require_turns(max(self.width / 2, min(self.corner_radius, self.width)), "direction")

    @property
    def is_circle(self) -> bool:
        """Whether the enclosing shape is a circle."""
        return self.sides == 4 and self.extent == self.breadth == 2 * self.corner_radius

    @property
    def is_parallel(self) -> bool:
        """Whether turns are parallel to the enclosing shape."""
        return super().is_parallel and not self.is_circle

    @property
    def is_racetrack(self) -> bool:
        """Whether the enclosing shape ends in half circles."""
        return self.sides == 4 and self.corner_radius == min(self.extent, self.breadth) / 2

    def outline(self) -> FloatArray:
        """Points (n, 2) in m of the nominal outer copper edge."""
        sides = np.arange(self.sides + 1)
        middle = self._corners(sides, np.zeros(self.sides + 1))
        line = np.vstack((self._foot(sides[:1], np.zeros(1)), middle, self._foot(sides[:1], np.zeros(1))))
        return rounded_line(line, [self.corner_radius] * self.sides)[0][:-1]

    @property
    def _apothem(self) -> float:
        return min(self.extent, self.breadth) / 2

    @property
    def _starts_at_corner(self) -> bool:
        return self.is_parallel and not self.corner_radius

    def _radii(self, inset: FloatArray) -> FloatArray:
        least = min(self.corner_radius, self.width)
        return np.maximum(self.corner_radius - np.maximum(inset[:-1], inset[1:]), least)

    def _stepped_line(self, layer: int) -> tuple[FloatArray, tuple[Arc, ...]]:
        k = np.arange(self.steps + 1)
        inset = self._insets(k if layer % 2 == 0 else self.steps - k)
        sides = layer * self.steps + k
        ends = self._foot(sides[[0, -1]], inset[[0, -1]])
        if self.is_parallel:
            inner, radii = self._parallel_corners(sides, inset)
        else:
            inner, radii = self._corners(sides, inset), self._radii(inset)
        if self.corner_radius:
            # the first and the last half side may be slightly too short for the arc
            half = math.tan(math.pi / self.sides)
            for end in (0, -1):
                radii[end] = min(radii[end], float(np.hypot(*(ends[end] - inner[end]))) / half)
        return rounded_line(np.vstack((ends[:1], inner, ends[1:])), radii.tolist())

    def _normals(self, sides: IntArray) -> tuple[FloatArray, FloatArray]:
        angle = self.direction + self._turned(sides)
        distance = np.where((self.sides == 4) & (sides % 2 == 1), self.breadth, self.extent) / 2
        return np.column_stack((np.cos(angle), np.sin(angle))), distance


class _NoRoomBesideLeadsError(GeometryError):
    """A pad does not fit beside the leads."""


@lru_cache(maxsize=64)  # searches and sweeps change the array around one coil a thousand times
def _wound(spiral: Winding) -> Coil:
    """Wind a spiral, or name the lead spacing it needs."""
    try:
        return _wind(spiral)
    except _NoRoomBesideLeadsError as error:
        message, leads = str(error)[:-1], spiral.leads
    if leads is None:
        raise GeometryError(f"{message}.")

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
    if fits(widest):
        spacing = bisect_left(range(widest), True, lo=least, key=fits) / 10
        longer = f" with leads.length_mm of {spacing / 2:g}" if spacing * 1e-3 / 2 > leads.length else ""
        message += f"; leads.spacing_mm of {spacing:g}{longer} makes it"
    raise GeometryError(f"{message}.")


def _wind(spiral: Winding) -> Coil:
    winding_layers, via, leads = spiral.layers, spiral.via, spiral.leads
    if spiral.return_lead and (winding_layers % 2 == 0 or leads is None):
        raise GeometryError(
            "return_lead of a coil's shape needs leads and an odd number of winding layers (its table leads, and "
            f"winding_layers); got {winding_layers} {'without' if leads is None else 'with'} leads."
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


def _lead(end: FloatArray, outwards: FloatArray, leads: Leads, side: float) -> FloatArray:
    """Knee and terminal (2, 2) to the left (`side` 1) or right (−1)."""
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
    """Positions in m of holes at the ends of the first layers.

    A hole may be drilled through the whole board, so its pad must clear the windings, leads and holes
    of every layer. Holes at the same corner are spread like a fan.
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

    They lie on rays from `end` about `direction`, towards the centre if `inside`. The `pads` (m,) keep
    the gap to all copper and to one another. `begins` are the beginnings of the stubs to each pad,
    `lines` the centre lines to be cleared, `fixed` the other holes with their pads, all in m.
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
