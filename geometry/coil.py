"""A coil: centre lines on copper layers, joined by holes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.compute.arrays import FloatArray
from coilarray.errors import LARGEST, GeometryError, require_positive
from coilarray.geometry.arcs import Arc, arc_size, coarser_line, place_in_mm
from coilarray.geometry.conductor import CHORD, SMALLEST, SingleCoil
from coilarray.geometry.stackup import Stackup
from coilarray.geometry.usual_values import require_coil_size, warn_unusual

if TYPE_CHECKING:
    from coilarray.geometry.spiral import Winding


@dataclass(frozen=True)
class PlatedHole:
    """Drilled and plated hole, with round pads on every layer it reaches.

    `drill` is the diameter of the hole and so the outer diameter of the copper barrel, `pad` the larger
    diameter of the pads, and `plating` the thickness of the barrel, below half of `drill`, all in m.
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

        A thin tube of radius r has GMD r, a square of side a 0.447049 a (Grover 1946, ch. 3).
        """
        return (self.drill / 2) / 0.4470491559


@dataclass(frozen=True)
class Leads:
    """Two leads from a spiral's outer ends to its terminals.

    Both leave the corner at 45°, to either side, and then run outwards. `length` is the radial distance
    in m from the winding's end to the terminals, at least half of their `spacing` in m. `terminal` is
    the hole of each terminal.
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


VIA = PlatedHole(0.2e-3, 0.45e-3)  # usual hole that joins the layers of a coil
LEADS = Leads(2e-3, 1.5e-3, PlatedHole(0.5e-3, 1e-3))  # usual leads of a coil


@dataclass(frozen=True, eq=False)
class Coil(SingleCoil):
    """Centre lines of a coil, in current direction and its own frame.

    Raises GeometryError if a line has fewer than two points, a value is not finite, a point is
    repeated, ends do not meet, or there is not one width per segment.

    Parameters
    ----------
    lines : tuple of ndarray, each of shape (n, 2)
        Centre lines, each on one copper layer, x and y in m. Leads and the stubs to the vias are
        included. Each line begins at the end of the line before, where a via stands.
    widths : tuple of ndarray, each of shape (n − 1,)
        Width of every segment of every line in m.
    gap : float
        Distance of neighbouring turns, edge to edge, in m.
    via, terminal : PlatedHole
        Holes that join consecutive lines, and at both ends of the path. No terminal for bare ends.
    outline : ndarray, shape (m, 2)
        Closed outline of the winding without leads, x and y in m. The first point is not repeated.
    name : str
        Name of the shape in a design file. It may be empty.
    arcs : tuple of tuple of Arc
        Runs of pieces in every line that stand for arcs. They are manufactured as arcs, and the
        field is computed with larger pieces. Empty if all lines are straight.
    stackup : Stackup or None
        Board of the coil when it is alone, `Stackup.usual` by default. The lines lie on its
        uppermost layers.

    Attributes
    ----------
    wound : Spiral, RoundedSpiral or None
        The spiral that made the lines. `dataclasses.replace` does not copy it.
    """

    lines: tuple[FloatArray, ...]
    widths: tuple[FloatArray, ...]
    gap: float
    via: PlatedHole
    terminal: PlatedHole | None
    outline: FloatArray
    name: str = ""
    arcs: tuple[tuple[Arc, ...], ...] = ()
    stackup: Stackup | None = None
    wound: Winding | None = field(default=None, init=False)

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

    def __repr__(self) -> str:
        name, (width, height) = self.name or "coil", np.ptp(self.outline, axis=0) * 1e3
        lines = "1 line" if len(self.lines) == 1 else f"{len(self.lines)} lines"
        return f"<Coil {name}: {lines}, {width:.4g} × {height:.4g} mm>"

    def coil(self) -> Coil:
        """Return the coil itself."""
        return self

    def arcs_of(self, line: int) -> tuple[Arc, ...]:
        """Return the arcs of a `line`, given by its index."""
        return self.arcs[line] if self.arcs else ()

    def current_lines(self, chord: float = CHORD) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield lines (n, 2) and widths (n − 1,) in m for the field.

        The pieces of all arcs have the same angle, so the pieces of neighbouring turns are parallel. On the
        largest arc they deviate by `chord` times half the size of the outline. Bends within a trace have
        three pieces.
        """
        radii = [arc_size(*arc.points(line))[0] for k, line in enumerate(self.lines) for arc in self.arcs_of(k)]
        from_middle = self.outline - self.outline.mean(axis=0)  # bounds change as a coil is turned
        radius = float(np.hypot(*from_middle.T).max()) if radii else 0.0
        step = math.sqrt(8 * chord * radius / max(radii, default=1.0))
        for k, (line, widths) in enumerate(zip(self.lines, self.widths, strict=True)):
            points, pieces = coarser_line(line, self.arcs_of(k), step, small=0.6 * self.trace_width)
            yield points, widths[pieces]

    @cached_property
    def trace_width(self) -> float:
        """Trace width in m of most of the path's length."""
        widths, which = np.unique(np.concatenate(self.widths), return_inverse=True)
        lengths = np.concatenate([np.hypot(*np.diff(line, axis=0).T) for line in self.lines])
        share = np.bincount(which, weights=lengths) / lengths.sum()
        return float(widths[np.argmax(np.round(share, 9))])  # independent of the path's orientation

    @property
    def via_points(self) -> FloatArray:
        """Positions in m of the vias between lines, shape (lines − 1, 2)."""
        return np.array([line[-1] for line in self.lines[:-1]]).reshape(-1, 2)

    @property
    def terminal_points(self) -> FloatArray:
        """First and last point (2, 2) of the path in m."""
        return np.array([self.lines[0][0], self.lines[-1][-1]])


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

    Parameters
    ----------
    lines : sequence of array_like, each of shape (n, 2)
        x and y in m, each on one copper layer. Each line begins at the end of the line before.
    trace_width : float or sequence of array_like, each of shape (n − 1,)
        Width in m: a single number, or the width of every segment of each line.
    gap, via, terminal, name
        As in `Coil`.

    Returns
    -------
    Coil
        Its outline is the convex hull of the lines, widened by half a trace. Raises GeometryError
        as `Coil`, or if a line crosses itself.

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
    """Convex hull (n, 2) in m of a coil's lines, widened by half a trace."""
    hull = shapely.MultiPoint(np.vstack(coil.lines)).convex_hull.buffer(coil.trace_width / 2)
    return np.asarray(shapely.get_coordinates(hull)[:-1])


def _arrays(values: Sequence[npt.ArrayLike], message: str) -> tuple[FloatArray, ...]:
    try:
        return tuple(np.array(value, dtype=np.float64) for value in values)
    except (TypeError, ValueError):
        raise GeometryError(message) from None


def _refuse_self_crossing(line: FloatArray, index: int) -> None:
    closed = bool(np.array_equal(line[0], line[-1]))
    if shapely.LineString(line).is_simple and not closed:
        return
    segments = np.asarray(shapely.linestrings(np.stack((line[:-1], line[1:]), axis=1)))
    i, j = shapely.STRtree(segments).query(segments, predicate="intersects")
    for a, b in sorted(zip(i[i < j].tolist(), j[i < j].tolist(), strict=True)):
        shared = shapely.intersection(segments[a], segments[b])
        neighbours = b - a == 1 and shared.geom_type == "Point"  # which share their vertex
        if not neighbours and not (closed and a == 0 and b == len(segments) - 1):
            at = place_in_mm(*shared.centroid.coords[0])
            raise GeometryError(f"line {index} of a coil crosses itself: segments {a} and {b} meet at {at}.")
    at = place_in_mm(*line[0])
    raise GeometryError(f"line {index} of a coil must have two separate ends; it closes at {at}.")
