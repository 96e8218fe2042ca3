"""An array: coils on a board with their layers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np
import shapely
import shapely.affinity

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.compute.display_units import MM
from coilarray.errors import GeometryError, require_finite, require_positive, require_whole, shown
from coilarray.geometry.arcs import SIDES, Side, place_in_mm
from coilarray.geometry.coil import Coil
from coilarray.geometry.conductor import CHORD, Conductor, Form, SeveralCoils, SingleCoil
from coilarray.geometry.spiral import RoundedSpiral
from coilarray.geometry.stackup import Stackup

if TYPE_CHECKING:
    from coilarray.geometry.surface_array import OnSurface

_SHAPES = {3: "triangular", 4: "square", 6: "hexagonal", 8: "octagonal"}
_MOST_NAMES = 12  # of coils, in a row of a table
_NEAREST = 1.01  # of the least distance: limit for neighbours
_SAME_PLACE = 1e-9  # m: distances that differ by less are equal


@dataclass(frozen=True, eq=False)
class Placement:
    """One coil on the board.

    The `name`, unique in the array, is also that of the net. `coil` is the shape of the coil, and
    `layers` the copper layer of each of its lines, in order. A layer may carry several lines. `x`
    and `y` in m are the position of the coil's centre, and `rotation` is its counter-clockwise turn
    in rad about it. Raises GeometryError if a position is not finite, the number of layers differs
    from the number of lines, a via joins a layer to itself, or two lines meet on one layer.
    """

    name: str
    coil: Coil
    layers: tuple[str, ...]
    x: float
    y: float
    rotation: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "coil", self.coil.coil())  # a spiral stands for its coil
        if not all(math.isfinite(value) for value in (self.x, self.y, self.rotation)):
            raise GeometryError(
                f"position of {self.name} must be finite; got x {self.x} m, y {self.y} m, rotation {self.rotation} rad."
            )
        if len(self.layers) != len(self.coil.lines):
            needed, wound = len(self.coil.lines), self.coil.wound
            why = f"{needed} lines_mm" if wound is None else f"winding_layers = {wound.layers}"
            why += " and return_lead = true" if wound is not None and wound.return_lead else ""
            raise GeometryError(
                f"layers of {self.name} must be {needed}, as its shape has {why}; "
                f"got {len(self.layers)}: {', '.join(self.layers)}."
            )
        for k, (layer, following) in enumerate(pairwise(self.layers)):
            if layer == following:
                raise GeometryError(
                    f"lines {k} and {k + 1} of {self.name} are joined by a via and must lie on different copper "
                    f"layers; got {layer} for both."
                )
        for i, j in combinations(range(len(self.layers)), 2):
            if self.layers[i] != self.layers[j]:
                continue
            shared = shapely.LineString(self.coil.lines[i]).intersection(shapely.LineString(self.coil.lines[j]))
            if not shared.is_empty:
                at = place_in_mm(*shapely.get_coordinates(shared)[0])
                raise GeometryError(f"lines {i} and {j} of {self.name} meet on {self.layers[i]}, at {at} of the coil.")

    def __repr__(self) -> str:
        place = f"({self.x * 1e3:.4g}, {self.y * 1e3:.4g}) mm"
        return f"<Placement {self.name}: {self.coil!r} on {', '.join(self.layers)} at {place}>"

    def lines_on(self, layer: str) -> tuple[int, ...]:
        """Return the indices of the lines on a layer."""
        return tuple(k for k, name in enumerate(self.layers) if name == layer)

    def to_board(self, points: FloatArray) -> FloatArray:
        """Transform points (n, 2) in m of the coil to the board."""
        c, s = math.cos(self.rotation), math.sin(self.rotation)
        return np.asarray(points @ np.array([[c, s], [-s, c]]) + np.array([self.x, self.y]))

    def at_origin(self) -> Placement:
        """Return the same coil at the origin, not turned."""
        return replace(self, x=0.0, y=0.0, rotation=0.0)

    def conductor(self, stackup: Stackup, chord: float = CHORD) -> Conductor:
        """Return the path on a `stackup` in m, vias included, with a `chord`."""
        via = (self.coil.via.bar_width, self.coil.via.bar_width, self.coil.via.barrel_area)
        vertices: list[FloatArray] = []
        sections: list[tuple[float, float, float]] = []  # widths, thicknesses and areas
        for (line, own), layer in zip(self.coil.current_lines(chord), self.layers, strict=True):
            vertices.append(np.column_stack((self.to_board(line), np.full(len(line), stackup.centre(layer)))))
            thickness = stackup.copper_thickness[stackup.index(layer)]
            sections += [(width, thickness, width * thickness) for width in own.tolist()] + [via]
        widths, thicknesses, areas = np.array(sections[:-1]).T
        return Conductor(np.vstack(vertices), widths, thicknesses, areas, self.name)

    def traces(self) -> Iterator[tuple[FloatArray, FloatArray, str]]:
        """Yield lines (n, 2) on the board, widths (n − 1,) in m, and layers."""
        for line, widths, layer in zip(self.coil.lines, self.coil.widths, self.layers, strict=True):
            yield self.to_board(line), widths, layer


LatticeKind = Literal["single", "linear", "square", "hexagonal", "triangle", "rings"]
"""Kind of lattice, as in `Lattice`."""


@dataclass(frozen=True)
class Lattice:
    """Equal coils on a regular lattice.

    Parameters
    ----------
    kind : {"single", "linear", "square", "hexagonal", "triangle", "rings"}
        Single: one point. Linear: one row. Square: rows one pitch apart. Hexagonal: rows √3/2 pitch
        apart, with every second row shifted by half a pitch, so every inner point has six
        neighbours one pitch away. Triangle: points of a hexagonal lattice in as many rows as
        columns, each row shorter by one. Rings: a point of a hexagonal lattice and its neighbours
        ring by ring, counter-clockwise from `direction`.
    pitch : float or None
        Distance of neighbours in m. None for a single coil.
    columns, rows : int
        Coils per row and number of rows. A linear lattice and a triangle have one row given. A
        single point and rings have one column and one row given.
    layers : tuple of tuple of str
        Sets of copper layers that the coils use in turn along a row.
    direction : float
        Angle of the rows in rad.
    rotation : float
        Counter-clockwise turn of every coil in rad.
    layer_shift : int or None
        Steps in `layers` from row to row, so that neighbours differ. By default it is −1 on a
        hexagonal lattice, 2 for four sets on a square lattice, and 1 otherwise.
    names : tuple of str or None
        Names of the coils row by row. By default coil1, coil2, …
    rings : int
        Rings about the middle: 1 ring makes seven coils, 2 rings make nineteen.
    """

    kind: LatticeKind
    pitch: float | None = None
    columns: int = 1
    rows: int = 1
    layers: tuple[tuple[str, ...], ...] = (("L1", "L2"),)
    direction: float = 0.0
    rotation: float = 0.0
    layer_shift: int | None = None
    names: tuple[str, ...] | None = None
    rings: int = 0

    def placements(self, coil: SingleCoil) -> tuple[Placement, ...]:
        """Return the coil placed on every point, row by row.

        Raises GeometryError if there are no layers, or if names and points differ in number.
        """
        points, indices = lattice(
            self.kind, self.pitch, self.columns, self.rows, rings=self.rings, direction=self.direction
        )
        names = tuple(f"coil{k + 1}" for k in range(len(points))) if self.names is None else self.names
        if len(names) != len(points):
            raise GeometryError(f"a lattice of {len(points)} points must have as many names; got {len(names)}.")
        if not self.layers:
            raise GeometryError("a lattice must have at least one set of layers; got none.")
        # (i − j) mod 3 differs between all neighbours of a hexagonal lattice. On a square lattice
        # (i + j) mod 2 differs between all neighbours, and (i + 2j) mod 4 between diagonal
        # neighbours too.
        default = -1 if self.kind in ("hexagonal", "triangle", "rings") else 2 if len(self.layers) == 4 else 1
        shift = default if self.layer_shift is None else self.layer_shift
        shape = coil.coil()
        return tuple(
            Placement(name, shape, self.layers[(i + shift * j) % len(self.layers)], x, y, self.rotation)
            for name, (x, y), (i, j) in zip(names, points.tolist(), indices.tolist(), strict=True)
        )


@dataclass(frozen=True)
class Connector:
    """Row of plated holes along one edge of the board.

    Each coil has two holes, in the order of the coils along the edge, the `side` of the board.
    `pitch` and `distance` in m are those of the holes from each other, and of their centres from
    the outermost point of the coils. `at` is the middle of the row along the edge in m, None for
    the middle of the array. `trace_width` and `gap` of the leads from other copper are in m, None
    for the values of the coils.
    """

    side: Side = "bottom"
    pitch: float = 2.54e-3
    distance: float = 5e-3
    at: float | None = None
    trace_width: float | None = None
    gap: float | None = None

    def __post_init__(self) -> None:
        if self.side not in SIDES:
            raise GeometryError(
                f"side of the connector must be {', '.join(SIDES[:-1])} or {SIDES[-1]}; got {self.side!r}."
            )
        for name in ("pitch", "distance", "trace_width", "gap"):
            value = getattr(self, name)
            if value is not None:
                require_positive(f"{name} of the connector", value, " mm")
        if self.at is not None:
            require_finite("the place of the connector", self.at)


@dataclass(frozen=True, eq=False)
class Routing:
    """Array and connector from which `route_leads` made other placements."""

    array: Array
    connector: Connector
    placements: tuple[Placement, ...]


@dataclass(frozen=True, eq=False)
class Array(SeveralCoils):
    """Coils on one board.

    Raises GeometryError without a coil, for coils of one name, a negative margin, an unknown layer,
    or a board that cannot have this form.

    Parameters
    ----------
    stackup : Stackup
        The board's layers.
    placements : tuple of Placement
        At least one coil. All names differ, and all layers are in the stack-up.
    board_margin : float
        Distance in m from the outermost copper to the edge of the rectangular board.
    through_holes : bool
        True: every hole is drilled through the whole board. False: it spans only the layers it
        joins.
    lattice, routing : Lattice or OnSurface, Routing, or None
        How `lattice_array`, `SurfaceLattice.boards` or `coilarray.geometry.connector.route_leads` made
        the placements: hints for design files, without effect if the placements were changed since.
    form : Form or None
        Shape of the board in space, such as a `Bend`, which `conductors` and solids follow. The
        placements, the bounds, and all that is fabricated and checked stay flat. None for a flat
        board.
    """

    stackup: Stackup
    placements: tuple[Placement, ...]
    board_margin: float = 2e-3
    through_holes: bool = True
    lattice: Lattice | OnSurface | None = None
    routing: Routing | None = None
    form: Form | None = None

    def __post_init__(self) -> None:
        if not self.placements:
            raise GeometryError("an array must have at least one coil; got none.")
        names = self.names
        if len(set(names)) != len(names):
            raise GeometryError(f"coil names must differ; got {', '.join(names)}.")
        if not (math.isfinite(self.board_margin) and self.board_margin >= 0):
            raise GeometryError(f"board_margin must be finite and not negative; got {self.board_margin} m.")
        for placement in self.placements:
            for layer in placement.layers:
                self.stackup.index(layer)
        if self.form is not None:
            self.form.require_fits(self.bounds, self.stackup.thickness)

    def __repr__(self) -> str:
        return f"<Array: {array_words(self)}>"

    @classmethod
    def row(
        cls,
        coil: SingleCoil,
        count: int,
        pitch: float | None = None,
        *,
        stackup: Stackup | None = None,
        board_margin: float = 2e-3,
        through_holes: bool = True,
    ) -> Array:
        """Place `count` equal coils, coil1, coil2, …, in a row along x.

        The `pitch` is the distance of neighbours in m, None for one coil. Coils that overlap have
        copper layers of their own: every second, third, … coil uses the same layers. The default
        `stackup` is the stack-up of the coil, or `Stackup.usual` with as many layers as are needed.
        `board_margin` and `through_holes` are as in `Array`. Raises GeometryError as
        `lattice_array`, or if the board has too few layers for coils that overlap.

        >>> from coilarray.geometry import Spiral
        >>> row = Array.row(Spiral(6, 16e-3, 12, 0.15e-3, 0.15e-3), 3, pitch=11e-3)
        >>> [place.layers for place in row.placements]
        [('L1', 'L2'), ('L3', 'L4'), ('L1', 'L2')]
        """
        if not isinstance(coil, SingleCoil):
            raise GeometryError(f"a row is of one coil, such as a Spiral; got {shown(coil)}.")
        require_whole("count", count, 1)
        shape = coil.coil()
        layers = len(shape.lines)
        sets = 1
        if pitch is not None:  # as many as keep overlapping coils apart
            require_positive("pitch", pitch)
            outline, near = shapely.Polygon(shape.outline), (1 - _SAME_PLACE) * shape.gap
            moved = (shapely.affinity.translate(outline, steps * pitch) for steps in range(1, count))
            sets = next((k for k, other in enumerate(moved, start=1) if outline.distance(other) >= near), count)
        board = stackup or shape.stackup or Stackup.usual(layers, sets)
        if len(board.names) < sets * layers:
            overlapping = f", as {sets} neighbours overlap" if sets > 1 else ""
            raise GeometryError(
                f"coils of {layers} layers need {sets * layers} copper layers{overlapping}; "
                f"the stackup has {len(board.names)}: {', '.join(board.names)}."
            )
        own = tuple(board.names[k * layers : (k + 1) * layers] for k in range(sets))
        points = Lattice("linear", pitch, count, layers=own)
        return lattice_array(board, shape, points, board_margin=board_margin, through_holes=through_holes)

    def as_array(self) -> Array:
        """Return the array itself."""
        return self

    @cached_property
    def flat(self) -> Array:
        """The flat board, from which it was bent, or itself."""
        return self if self.form is None else replace(self, form=None)

    def bent(self, form: Form) -> Array:
        """Return the board bent to a form, such as a `Bend`.

        Raises GeometryError if the board cannot have this `form`.

        >>> from coilarray.geometry import Bend, Spiral, Zone
        >>> strip = Array.row(Spiral(6, 10e-3, 6, 0.15e-3, 0.15e-3), 3, pitch=10.5e-3)
        >>> around = strip.bent(Bend((Zone(8e-3),), axis=math.pi / 2))
        >>> [round(float(path.centre[2]) * 1e3, 1) for path in around.conductors()]
        [-6.1, -0.7, -6.1]
        """
        return replace(self, form=form)

    @property
    def unrouted(self) -> Array:
        """The array before its leads were routed, or itself."""
        return self if self.routing is None else self.routing.array

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coils in order."""
        return tuple(placement.name for placement in self.placements)

    @property
    def centres(self) -> FloatArray:
        """Centres of the coils in m, shape (coils, 2)."""
        return np.array([[placement.x, placement.y] for placement in self.placements])

    @property
    def places(self) -> FloatArray:
        """Centres of the coils on the bent board in m, shape (coils, 3)."""
        flat = np.column_stack((self.centres, np.zeros(len(self.placements))))
        return flat if self.form is None else self.form.surface(flat)

    @property
    def least_distance(self) -> float:
        """Smallest distance in m between two coils, inf for one."""
        gaps = np.linalg.norm(self.centres[:, None] - self.centres, axis=-1)
        return float(gaps[~np.eye(len(gaps), dtype=bool)].min(initial=np.inf))

    @property
    def neighbours(self) -> tuple[tuple[int, int], ...]:
        """Pairs of coils at the least distance, to within a hundredth."""
        one, other = np.triu_indices(len(self.placements), 1)
        near = np.hypot(*(self.centres[one] - self.centres[other]).T) <= _NEAREST * self.least_distance
        return tuple(zip(one[near].tolist(), other[near].tolist(), strict=True))

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """Edges of the board in m: x_min, y_min, x_max, y_max."""
        points, radii = [], []
        for placement in self.placements:
            coil = placement.coil
            for line, width, _ in placement.traces():
                points.append(line)
                radii.append(np.maximum(np.append(width, 0.0), np.append(0.0, width)) / 2)
            for hole, at in ((coil.via, coil.via_points), (coil.terminal, coil.terminal_points)):
                if hole is not None and len(at):
                    points.append(placement.to_board(at))
                    radii.append(np.full(len(at), hole.pad / 2))
        xy = np.vstack(points)
        r = np.concatenate(radii)[:, None] + self.board_margin
        x_min, y_min = (xy - r).min(axis=0).tolist()
        x_max, y_max = (xy + r).max(axis=0).tolist()
        return x_min, y_min, x_max, y_max

    @property
    def outline_bounds(self) -> tuple[float, float, float, float]:
        """x_min, y_min, x_max, y_max in m of coils without leads."""
        outlines = np.vstack([placement.to_board(placement.coil.outline) for placement in self.placements])
        x_min, y_min, x_max, y_max = np.concatenate((outlines.min(axis=0), outlines.max(axis=0))).tolist()
        return x_min, y_min, x_max, y_max

    @property
    def middle_coil(self) -> str:
        """Name of the (first) coil nearest to the middle of all centres."""
        x, y = ((self.centres.min(axis=0) + self.centres.max(axis=0)) / 2).tolist()
        distance = np.hypot(*(self.centres - (x, y)).T)
        return self.names[int(np.flatnonzero(distance <= distance.min() + _SAME_PLACE)[0])]

    def with_placements(self, placements: Sequence[Placement]) -> Array:
        """Return the same board with other `placements`, checked again."""
        return replace(self, placements=tuple(placements))


def lattice_array(
    stackup: Stackup, coil: SingleCoil, lattice: Lattice, *, board_margin: float = 2e-3, through_holes: bool = True
) -> Array:
    """Place one coil on every point of a lattice.

    `stackup`, `board_margin` and `through_holes` are as in `Array`. All coils have the shape of
    `coil`, a Spiral, RoundedSpiral or Coil, and the positions and layers of the `lattice`.

    Returns
    -------
    Array
        Coils named coil1, coil2, … row by row, unless the lattice has names.

    Examples
    --------
    >>> from coilarray.geometry import Spiral
    >>> coil = Spiral(6, 16e-3, 12, 0.15e-3, 0.15e-3)
    >>> board = Stackup(("L1", "L2"), (35e-6, 35e-6), (0.2e-3,), (4.5,))
    >>> row = lattice_array(board, coil, Lattice("linear", pitch=20e-3, columns=3))
    >>> row.names, row.centres[:, 0].tolist()
    (('coil1', 'coil2', 'coil3'), [-0.02, 0.0, 0.02])
    """
    return Array(stackup, lattice.placements(coil), board_margin, through_holes, lattice)


def lattice(
    kind: LatticeKind,
    pitch: float | None = None,
    columns: int = 1,
    rows: int = 1,
    *,
    rings: int = 0,
    direction: float = 0.0,
) -> tuple[FloatArray, IntArray]:
    """Points (n, 2) in m of a regular lattice about the origin, and their steps.

    They are in the order of rows or rings, with `pitch`, `columns`, `rows`, `rings` and `direction`
    of a `kind` as in `Lattice`. Raises GeometryError if the pitch is not positive and finite, a
    count is below 1, or the kind does not have rows, columns or rings.
    """
    if pitch is None and (columns > 1 or rows > 1 or rings > 0):
        raise GeometryError("a lattice of more than one coil must have a pitch; got none.")
    pitch = 1.0 if pitch is None else pitch  # which one coil does not notice
    require_positive("pitch", pitch)
    require_finite("direction of a lattice", direction)
    if columns < 1 or rows < 1:
        raise GeometryError(f"columns and rows must be at least 1; got {columns} and {rows}.")
    if kind in ("linear", "triangle") and rows != 1:
        raise GeometryError(f"a {kind} lattice takes one row; got {rows}.")
    if kind in ("single", "rings") and (rows, columns) != (1, 1):
        raise GeometryError(f"a lattice of kind {kind} has no rows and columns; got {rows} and {columns}.")
    if (kind == "rings") != (rings > 0):
        raise GeometryError(
            f"a lattice of kind rings must have at least one ring, any other none; got {rings} for {kind}."
        )
    row, column = np.divmod(np.arange(rows * columns), columns)
    if kind == "rings":
        # each ring starts at its corner at angle 0
        around = [np.zeros((1, 2), dtype=np.int64)]
        corners = np.array([(1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1)])
        for ring in range(1, rings + 1):
            along = np.arange(ring)[None, :, None] * (np.roll(corners, -1, axis=0) - corners)[:, None]
            around.append((ring * corners[:, None] + along).reshape(-1, 2))
        i, row = np.vstack(around).T
    elif kind == "hexagonal":
        i = column - row // 2
    elif kind == "triangle":
        row, i = np.divmod(np.arange(columns**2), columns)
        i, row = i[i + row < columns], row[i + row < columns]
    elif kind in ("single", "linear", "square"):
        i = column
    else:
        raise GeometryError(f"lattice must be single, linear, square, hexagonal, triangle or rings; got {kind!r}.")
    slant, rise = (0.0, 1.0) if kind == "square" else (0.5, math.sqrt(3) / 2)
    points = np.column_stack((pitch * (i + slant * row), pitch * rise * row))
    points -= 0.5 * (points.min(axis=0) + points.max(axis=0))
    c, s = math.cos(direction), math.sin(direction)
    return points @ np.array([[c, s], [-s, c]]), np.column_stack((i, row))


def array_words(array: Array) -> str:
    """Describe number, shape, size and spacing of the coils.

    Circles, and windings that step in at every corner, have the size of their copper added.

    >>> from coilarray import load_design
    >>> array_words(load_design("proximity").array)
    '1 round coil of 29 × 29 mm (copper 28.848 × 28.848 mm)'
    """
    array = array.unrouted
    outlines = [place.coil.outline for place in array.placements]
    shapes = {_shape(place.coil) for place in array.placements}
    shape = shapes.pop() if len(shapes) == 1 else ""
    sizes = {tuple(f"{side:.4g}" for side in MM.of(np.ptp(outline, axis=0))) for outline in outlines}
    coppers = set(map(copper_words, {id(place.coil): place.coil for place in array.placements}.values()))
    copper = coppers.pop() if len(coppers) == 1 else ""
    size = f" of {' × '.join(sizes.pop())} mm{copper}" if len(sizes) == 1 else ""
    if len(outlines) == 1:
        return f"1 {shape}coil{size}"
    return f"{len(outlines)} {shape}coils{size}, neighbours {MM.of(array.least_distance):.4g} mm apart"


def copper_words(coil: Coil) -> str:
    """Return a winding's copper size in brackets, or ""."""
    if coil.wound is None or coil.wound.is_parallel:
        return ""
    spiral = coil.wound
    lines = shapely.MultiLineString([spiral.centre_line(layer) for layer in range(spiral.layers)])
    copper = lines.buffer(spiral.width / 2, cap_style="flat", join_style="mitre")
    width, height = np.ptp(np.reshape(copper.bounds, (2, 2)), axis=0)
    shown = " × ".join(f"{round(float(MM.of(side)), 3):g}" for side in (width, height))  # to 1 µm
    return f" (copper {shown} mm)"


def array_facts(array: Array) -> list[tuple[str, str]]:
    """Facts about a board, as rows of name and value."""
    names, layers = array.names, array.stackup.names
    shown = names if len(names) <= _MOST_NAMES else (*names[:_MOST_NAMES], f"and {len(names) - _MOST_NAMES} more")
    x_min, y_min, x_max, y_max = array.bounds
    bent = ""
    if array.form is not None:
        radius = array.form.inner_radius(array.bounds, array.stackup.thickness)
        bent = f", bent to an inner radius of {MM.of(radius):.4g} mm" if math.isfinite(radius) else ", not flat"
    return [
        ("coils", array_words(array)),
        ("names", ", ".join(shown)),
        ("board", f"{MM.of(x_max - x_min):.4g} × {MM.of(y_max - y_min):.4g} mm{bent}, copper {', '.join(layers)}"),
    ]


def _shape(coil: Coil) -> str:
    """Return the word for a coil's shape and a blank."""
    if coil.wound is None:
        return ""
    spiral = coil.wound
    if not isinstance(spiral, RoundedSpiral):
        return f"{_SHAPES.get(spiral.sides, f'{spiral.sides}-sided')} "
    if spiral.is_circle:
        return "round "
    if spiral.sides != 4:
        return f"rounded {_SHAPES.get(spiral.sides, f'{spiral.sides}-sided')} "
    if spiral.corner_radius >= min(spiral.extent, spiral.breadth) / 2:
        return "racetrack "
    return "square " if spiral.extent == spiral.breadth else "rectangular "
