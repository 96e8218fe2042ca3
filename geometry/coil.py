"""A coil: centre lines on copper layers, joined in series by plated holes, with two terminals."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.compute.arrays import FloatArray
from coilarray.errors import LARGEST, GeometryError, require_positive
from coilarray.geometry.arcs import Arc, arc_size, coarser_line
from coilarray.geometry.conductor import SMALLEST
from coilarray.geometry.spiral import Winding
from coilarray.geometry.usual_values import require_coil_size, warn_unusual
from coilarray.geometry.values import place_in_mm

CHORD = 1e-3
"""Deviation of straight pieces from a coil's largest arc, over half its size, by default."""
_TOUCH = 1e-9  # of a gap: rounding


@dataclass(frozen=True)
class PlatedHole:
    """Drilled and plated hole with round pads.

    It has a pad on every layer it reaches.

    Parameters
    ----------
    drill : float
        Diameter of the drilled hole in m (outer diameter of the copper barrel).
    pad : float
        Diameter of the pad in m, larger than `drill`.
    plating : float
        Thickness of the copper barrel in m, below half of `drill`.
    """

    drill: float
    pad: float
    plating: float = 25e-6

    def __post_init__(self) -> None:
        for name in ("drill", "pad", "plating"):
            require_positive(f"{name} of a hole", getattr(self, name), " mm")
        warn_unusual((("drill_mm", self.drill), ("pad_mm", self.pad), ("plating_um", self.plating)))
        if self.pad <= self.drill:
            raise GeometryError(
                f"pad of a hole must be larger than its drill of {self.drill * 1e3:g} mm; got {self.pad * 1e3:g} mm."
            )
        if self.plating >= self.drill / 2:
            raise GeometryError(
                f"plating must be below half the drill of {self.drill * 1e3:g} mm; got {self.plating * 1e3:g} mm."
            )

    @property
    def barrel_area(self) -> float:
        """Conducting cross-section in m² of the barrel."""
        return math.pi * self.plating * (self.drill - self.plating)

    @property
    def bar_width(self) -> float:
        """Side in m of the barrel's equivalent square bar.

        Bar and barrel have the same geometric mean distance (GMD).

        A thin tube of radius r has GMD r. A square of side a has GMD 0.447049 a (Grover 1946, ch. 3).
        """
        return (self.drill / 2) / 0.4470491559


@dataclass(frozen=True)
class Leads:
    """Two leads from a spiral's outer ends to its terminals.

    Both leave the corner at 45°, to either side, and then run outwards.

    Parameters
    ----------
    length : float
        Radial distance in m from the winding's end to the terminals, at least half of `spacing`.
    spacing : float
        Distance in m between the two terminals.
    terminal : PlatedHole
        Hole of each terminal.
    """

    length: float
    spacing: float
    terminal: PlatedHole

    def __post_init__(self) -> None:
        for name in ("length", "spacing"):
            require_positive(f"{name} of the leads", getattr(self, name), " mm")
        warn_unusual((("length_mm", self.length), ("spacing_mm", self.spacing)))
        if self.length < self.spacing / 2:
            raise GeometryError(
                f"length of the leads must be at least half their spacing of {self.spacing * 1e3:g} mm; "
                f"got {self.length * 1e3:g} mm."
            )


@dataclass(frozen=True)
class Wound:
    """Arguments from which `spiral_coil` wound a coil."""

    spiral: Winding
    winding_layers: int
    via: PlatedHole
    leads: Leads | None = None
    return_lead: bool = False


@dataclass(frozen=True, eq=False)
class Coil:
    """Centre lines of a coil, in current direction.

    The lines are in the coil's own frame.

    Raises GeometryError if a line has fewer than two points, a value is not finite, a point is repeated, ends do not
    meet, or there is not one width per segment.

    Parameters
    ----------
    lines : tuple of ndarray, each of shape (n, 2)
        Centre lines, each on one copper layer, x and y in m. Leads and the stubs to the vias are included. Each line
        begins at the end of the line before, where a via stands.
    widths : tuple of ndarray, each of shape (n − 1,)
        Width of every segment of every line in m.
    gap : float
        Distance of neighbouring turns, edge to edge, in m.
    via : PlatedHole
        Hole that joins consecutive lines.
    terminal : PlatedHole or None
        Hole at both ends of the path. None for bare ends.
    outline : ndarray, shape (m, 2)
        Closed outline of the winding without leads, x and y in m. The first point is not repeated.
    name : str
        Name of the shape in a design file. It may be empty.
    arcs : tuple of tuple of Arc
        Runs of pieces in every line that stand for arcs. They are manufactured as arcs, and the field is computed with
        larger pieces. Empty if all lines are straight.

    Attributes
    ----------
    wound : Wound or None
        The spiral from which `spiral_coil` made the lines. `dataclasses.replace` does not copy it, so it is present
        only while the lines are the lines of the spiral.
    """

    lines: tuple[FloatArray, ...]
    widths: tuple[FloatArray, ...]
    gap: float
    via: PlatedHole
    terminal: PlatedHole | None
    outline: FloatArray
    name: str = ""
    arcs: tuple[tuple[Arc, ...], ...] = ()
    wound: Wound | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        require_positive("gap", self.gap)
        if not self.lines:
            raise GeometryError("a coil must have at least one line; got none.")
        for k, line in enumerate(self.lines):
            if line.ndim != 2 or line.shape[1] != 2 or line.shape[0] < 2:
                raise GeometryError(f"line {k} of a coil must be points of shape (n >= 2, 2); got {line.shape}.")
            if not (np.abs(line) <= LARGEST).all():
                raise GeometryError(f"line {k} of a coil has a coordinate that is not finite or beyond {LARGEST:g} m.")
            if (np.hypot(*np.diff(line, axis=0).T) <= 1e-12 * np.ptp(line)).any():
                raise GeometryError(f"line {k} of a coil repeats a point.")
            line.setflags(write=False)
        for k, (line, following) in enumerate(pairwise(self.lines)):
            apart = float(np.hypot(*(following[0] - line[-1])))
            if apart > 1e-9:
                raise GeometryError(
                    f"line {k + 1} of a coil must begin where line {k} ends; they are {apart * 1e3:g} mm apart."
                )
        self.outline.setflags(write=False)
        if len(self.widths) != len(self.lines):
            raise GeometryError(
                f"a coil of {len(self.lines)} lines must have as many arrays of widths; got {len(self.widths)}."
            )
        for k, (line, widths) in enumerate(zip(self.lines, self.widths, strict=True)):
            if widths.shape != (len(line) - 1,):
                raise GeometryError(
                    f"line {k} of a coil must have {len(line) - 1} widths, one a segment; got shape {widths.shape}."
                )
            wrong = widths[~((widths >= SMALLEST) & (widths <= LARGEST))]
            if wrong.size:
                limits = f"positive, {SMALLEST:g} to {LARGEST:g} m"
                raise GeometryError(f"trace_width must be {limits}; got {wrong[0]} m on line {k} of a coil.")
            widths.setflags(write=False)

    def arcs_of(self, line: int) -> tuple[Arc, ...]:
        """Return the arcs of a line, given by its index.

        Returns
        -------
        tuple of Arc
            Arcs of the line, in the order of the path. Empty if the line is straight.
        """
        return self.arcs[line] if self.arcs else ()

    def current_lines(self, chord: float = CHORD) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield each line and its widths for the field computation.

        Arcs are divided into pieces of a suitable size. The pieces of all arcs have the same angle, so the pieces of
        neighbouring turns are parallel. On the largest arc they deviate by `chord` times half the size of the outline.
        Bends within a trace have three pieces.

        Yields
        ------
        ndarray, shape (n, 2), and ndarray, shape (n − 1,)
            Vertices of a line in m, and the widths of its pieces in m.
        """
        radii = [arc_size(*arc.points(line))[0] for k, line in enumerate(self.lines) for arc in self.arcs_of(k)]
        from_middle = self.outline - self.outline.mean(axis=0)  # not the bounds, which change as a coil is turned
        radius = float(np.hypot(*from_middle.T).max()) if radii else 0.0
        step = math.sqrt(8 * chord * radius / max(radii, default=1.0))
        for k, (line, widths) in enumerate(zip(self.lines, self.widths, strict=True)):
            points, pieces = coarser_line(line, self.arcs_of(k), step, small=0.6 * self.trace_width)
            yield points, widths[pieces]

    @cached_property
    def trace_width(self) -> float:
        """Trace width in m of most of the path's length.

        Of several widths with the same length it is the smallest.
        """
        widths, which = np.unique(np.concatenate(self.widths), return_inverse=True)
        lengths = np.concatenate([np.hypot(*np.diff(line, axis=0).T) for line in self.lines])
        share = np.bincount(which, weights=lengths) / lengths.sum()
        return float(widths[np.argmax(np.round(share, 9))])  # the orientation of a path has no influence

    @property
    def via_points(self) -> FloatArray:
        """Positions in m of the vias between consecutive lines.

        The array has the shape (lines − 1, 2).
        """
        return np.array([line[-1] for line in self.lines[:-1]]).reshape(-1, 2)

    @property
    def terminal_points(self) -> FloatArray:
        """First and last point of the path, in m.

        The array has the shape (2, 2).
        """
        return np.array([self.lines[0][0], self.lines[-1][-1]])


def spiral_coil(
    spiral: Winding,
    winding_layers: int,
    via: PlatedHole,
    leads: Leads | None = None,
    *,
    return_lead: bool = False,
    name: str = "",
) -> Coil:
    """Wind a spiral on several layers in series.

    Vias are moved off the winding's end, inwards or outwards along the corner's ray, just far enough for their pads to
    keep the gap to the windings and leads of every layer. They can then be drilled through the whole board. Several
    vias at one corner spread to both sides of the ray.

    Parameters
    ----------
    spiral : Spiral or RoundedSpiral
        Winding of each layer.
    winding_layers : int
        Number of layers, at least 1. With an odd number the path ends inside the winding.
    via : PlatedHole
        Hole that joins consecutive layers.
    leads : Leads, optional
        Leads to the terminals. By default the path begins and ends at the winding's ends, without terminal pads.
    return_lead : bool
        For an odd number of layers, add a layer with a straight trace from the inner end out to the second terminal.
        Requires `leads`.
    name : str
        Name of the shape in a design file.

    Returns
    -------
    Coil
        The coil about the origin, its path in m.

    Raises
    ------
    GeometryError
        If there is no layer, or no room for a via inside the winding.

    Examples
    --------
    >>> from coilarray.geometry import Spiral
    >>> spiral = Spiral(6, 10e-3, 10, 0.15e-3, 0.15e-3)
    >>> coil = spiral_coil(spiral, 2, PlatedHole(0.2e-3, 0.45e-3))
    >>> len(coil.lines), coil.via_points.shape
    (2, (1, 2))
    """
    return _wound(Wound(spiral, winding_layers, via, leads, return_lead), name)


@lru_cache(maxsize=64)  # searches and sweeps change the array around one coil a thousand times
def _wound(of: Wound, name: str) -> Coil:
    try:
        return _wind(of, name)
    except _NoRoomBesideLeadsError as error:
        raise GeometryError(f"{str(error)[:-1]}{_remedy(of)}.") from None


class _NoRoomBesideLeadsError(GeometryError):
    """A pad does not fit beside the leads.

    Wider spacing may help.
    """


def _wind(of: Wound, name: str) -> Coil:
    """Wind a spiral as `spiral_coil` does, without the cache."""
    spiral, winding_layers, via, leads = of.spiral, of.winding_layers, of.via, of.leads
    if winding_layers < 1:
        raise GeometryError(f"a coil must have at least one winding layer; got {winding_layers}.")
    if of.return_lead and (winding_layers % 2 == 0 or leads is None):
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
        if of.return_lead:
            corner = spiral.rim(steps)
            last_lead = np.vstack((corner, _lead(corner, spiral.outwards(steps), leads, sense)))
        elif not ends_inside:
            last_lead = _lead(windings[last][-1], spiral.outwards(steps), leads, sense)

    # the hole at the end of each layer: of every layer but the last, and of the last if it ends inside at a hole
    pads = [via.pad] * last
    if leads is not None and ends_inside:
        pads.append(via.pad if of.return_lead else leads.terminal.pad)
    holes = _hole_points(spiral, windings, pads, leads, first_lead, last_lead)

    lines, begin = list(windings), [len(first_lead)] + [1] * last
    for layer, hole in enumerate(holes):
        lines[layer] = np.vstack((lines[layer], hole))
        if layer < last:
            lines[layer + 1] = np.vstack((hole, lines[layer + 1]))
    lines[0] = np.vstack((first_lead[::-1], lines[0]))
    if of.return_lead:
        lines.append(np.vstack((holes[last], last_lead)))
    else:
        lines[last] = np.vstack((lines[last], last_lead))
    widths = tuple(np.full(len(line) - 1, spiral.trace_width) for line in lines)
    arcs = [tuple(arc.shifted(count) for arc in spiral.arcs(layer)) for layer, count in enumerate(begin)]
    arcs += [()] * (len(lines) - len(arcs))
    terminal = None if leads is None else leads.terminal
    outline, arcs_if_any = spiral.outline(), tuple(arcs) if any(arcs) else ()
    coil = Coil(tuple(lines), widths, spiral.gap, via, terminal, outline, name, arcs_if_any)
    object.__setattr__(coil, "wound", of)
    return coil


def _remedy(of: Wound) -> str:
    """Hint of the lead spacing that a pad needs.

    The spacing is given to 0.1 mm. The hint is empty if no spacing helps.
    """
    if of.leads is None:
        return ""

    def fits(tenths: int) -> bool:
        """Whether the coil fits a lead spacing.

        The spacing is in tenths of mm.
        """
        assert of.leads is not None
        spacing = tenths * 1e-4
        wider = replace(of.leads, spacing=spacing, length=max(of.leads.length, spacing / 2))
        try:
            _wind(replace(of, leads=wider), "")
        except GeometryError:
            return False
        return True

    least = math.ceil(of.leads.spacing * 1e4)
    widest = 2 * least + math.ceil(4e4 * of.via.pad)
    if not fits(widest):
        return ""
    spacing = bisect_left(range(widest), True, lo=least, key=fits) / 10
    longer = f" with leads.length_mm of {spacing / 2:g}" if spacing * 1e-3 / 2 > of.leads.length else ""
    return f"; leads.spacing_mm of {spacing:g}{longer} makes it"


def path_coil(
    lines: Sequence[npt.ArrayLike],
    trace_width: float | Sequence[npt.ArrayLike],
    gap: float,
    via: PlatedHole,
    terminal: PlatedHole | None = None,
    *,
    name: str = "",
) -> Coil:
    """Make a coil of any shape from its centre lines.

    Each line lies on one copper layer.

    Parameters
    ----------
    lines : sequence of array_like, each of shape (n, 2)
        x and y in m. Each line begins at the end of the line before.
    trace_width : float or sequence of array_like, each of shape (n − 1,)
        Width in m: a single number, or the width of every segment of each line.
    gap : float
        Distance of neighbouring turns, edge to edge, in m.
    via : PlatedHole
        Hole that joins consecutive lines.
    terminal : PlatedHole, optional
        Hole at both ends of the path.
    name : str
        Name of the shape in a design file.

    Returns
    -------
    Coil
        The coil. Its outline is the convex hull of the lines, widened by half a trace.

    Raises
    ------
    GeometryError
        For the reasons given in `Coil`, or if a line crosses itself.

    Examples
    --------
    >>> line = [(0, 0), (1e-2, 0), (1e-2, 1e-2)]
    >>> coil = path_coil([line], [[0.2e-3, 0.3e-3]], 0.2e-3, PlatedHole(0.3e-3, 0.6e-3))
    >>> coil.trace_width, coil.widths[0].tolist()
    (0.0002, [0.0002, 0.0003])
    """
    arrays = _arrays(lines, "the lines of a coil must be numbers of shape (n, 2).")
    if isinstance(trace_width, (int, float)):
        widths = tuple(np.full(max(line.size // 2 - 1, 0), float(trace_width)) for line in arrays)
    else:
        widths = _arrays(trace_width, "trace_width must be a number, or numbers of shape (n − 1,) for each line.")
    coil = Coil(arrays, widths, gap, via, terminal, outline=np.zeros((0, 2)), name=name)
    require_coil_size(float(np.ptp(np.vstack(arrays), axis=0).max()))
    warn_unusual([("gap_mm", gap), *(("trace_width_mm", width) for width in set(np.concatenate(widths).tolist()))])
    for k, line in enumerate(arrays):
        _refuse_self_crossing(line, k)
    return replace(coil, outline=hull_outline(coil))


def hull_outline(coil: Coil) -> FloatArray:
    """Convex hull of a coil, widened by half a trace.

    It is given by x and y in m, without repeating the first point.
    """
    hull = shapely.MultiPoint(np.vstack(coil.lines)).convex_hull.buffer(coil.trace_width / 2)
    return np.asarray(shapely.get_coordinates(hull)[:-1])


def _arrays(values: Sequence[npt.ArrayLike], message: str) -> tuple[FloatArray, ...]:
    try:
        return tuple(np.array(value, dtype=np.float64) for value in values)
    except (TypeError, ValueError):
        raise GeometryError(message) from None


def _refuse_self_crossing(line: FloatArray, index: int) -> None:
    """Raise GeometryError with the place if a line touches itself."""
    closed = bool(np.array_equal(line[0], line[-1]))
    string = shapely.LineString(line)
    if string.is_simple and not closed:
        return
    crossing = _first_crossing(line)
    if crossing is not None:
        i, j, point = crossing
        at = place_in_mm(*point)
        raise GeometryError(f"line {index} of a coil crosses itself: segments {i} and {j} meet at {at}.")
    at = place_in_mm(*line[0])
    raise GeometryError(f"line {index} of a coil must have two separate ends; it closes at {at}.")


def _first_crossing(line: FloatArray) -> tuple[int, int, FloatArray] | None:
    """Find the first two segments that meet.

    The place in m is returned too.
    """
    segments = [shapely.LineString(pair) for pair in np.stack((line[:-1], line[1:]), axis=1)]
    tree = shapely.STRtree(segments)
    i, j = tree.query(segments, predicate="intersects")
    last = len(segments) - 1
    closed = bool(np.array_equal(line[0], line[-1]))
    for a, b in sorted(zip(i.tolist(), j.tolist(), strict=True)):
        if b - a < 1 or (closed and a == 0 and b == last):
            continue
        shared = shapely.intersection(segments[a], segments[b])
        if b - a == 1 and shared.geom_type == "Point":
            continue  # neighbours share their vertex
        return a, b, np.array(shared.centroid.coords[0])
    return None


def _lead(end: FloatArray, outwards: FloatArray, leads: Leads, side: float) -> FloatArray:
    """Knee and terminal of one lead, shape (2, 2).

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

    They belong to the first `len(pads)` layers. A hole may be drilled through the whole board, so its pad must clear
    the windings, leads and holes of every layer. Holes at the same corner are spread like a fan.
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
        fan = _Fan(
            spiral.junction(layers[0]),
            spiral.outwards(step) * (-1 if inside else 1),
            np.array([pads[layer] for layer in layers]),
            begins,
        )
        for k, layer, point in zip(
            range(len(layers)), layers, _fan(spiral, fan, lines, fixed, inside=inside), strict=True
        ):
            points[layer] = point
            fixed.append((point, pads[layer]))
            lines += [np.stack((begin, point)) for begin in begins[k]]
    return [points[layer] for layer in range(len(pads))]


@dataclass(frozen=True)
class _Fan:
    """Holes at one place, with their rays, pads and stubs.

    Place and direction of the rays have the shape (2,), the pads have the shape (m,). Lengths are in m.
    """

    place: FloatArray
    direction: FloatArray
    pads: FloatArray
    begins: list[list[FloatArray]]


def _fan(
    spiral: Winding,
    fan: _Fan,
    lines: Sequence[FloatArray],
    fixed: Sequence[tuple[FloatArray, float]],
    *,
    inside: bool,
) -> FloatArray:
    """Nearest points in m where all pads have clearance.

    The points have the shape (m, 2) and lie on rays from a place. The pads keep the gap to all copper and to one
    another. `lines` are the centre lines to be cleared, each of shape (n, 2). `fixed` are the other holes, by place and
    pad diameter. All are in m. The rays run towards the centre if `inside`.
    """
    end, direction, pads = fan.place, fan.direction, fan.pads
    m = len(pads)
    gap = (1 - _TOUCH) * spiral.gap  # a pad that just fits does so in every orientation of the coil
    # to the other side for a winding of the other sense, which is the mirror image
    across = (1 if spiral.winding == "ccw" else -1) * np.array([-direction[1], direction[0]])
    clear_of_trace = pads / 2 + gap + spiral.trace_width / 2
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
                beside = _to_stubs(centre, fan.begins[i], points[:, i])
                clear[:, i] &= beside >= pad / 2 + gap + spiral.trace_width / 2
        free = np.asarray(clear.all(axis=1))
        for i in range(m - 1):  # neighbours in the fan: pad beside pad, and either pad beside the other's stubs
            free &= 2 * reachable * math.sin(opening / 2) >= (pads[i] + pads[i + 1]) / 2 + gap
            for j, other in ((i, i + 1), (i + 1, i)):
                free &= _to_stubs(points[:, j], fan.begins[other], points[:, other]) >= clear_of_trace[j]
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
    """Distance in m of places from the nearest stub.

    The places have the shape (2,) or (n, 2), and `ends` has the shape (n, 2). The result has the shape (n,).
    """
    nearest = np.full(len(ends), math.inf)
    for begin in begins:
        along = ends - begin
        share = np.clip(((centre - begin) * along).sum(axis=1) / (along**2).sum(axis=1), 0, 1)
        nearest = np.minimum(nearest, np.hypot(*(begin + share[:, None] * along - centre).T))
    return nearest
