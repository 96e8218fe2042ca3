"""Coils on a surface: places, sizes and levels of boards of one coil each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.compute.arrays import FloatArray
from coilarray.errors import GeometryError, require_finite, require_positive
from coilarray.geometry.array import Array, Placement
from coilarray.geometry.coil import Coil
from coilarray.geometry.conductor import Conductor, SingleCoil
from coilarray.geometry.pose import Pose
from coilarray.geometry.spiral import RoundedSpiral, Spiral
from coilarray.geometry.stackup import Stackup
from coilarray.geometry.surface import Surface, neighbours

_OFF, _SAME = 0.02, 1e-6  # of the mean distance of points: how far one may be from the surface, and two at one place
_UPRIGHT = 1e-6  # sine of the angle between a normal and z, below which y takes the place of z
_CHORD = 0.05  # of a wrapped path's extent: longest piece that is laid on the surface
_KEPT = 0.5  # of a coil's half width, at least, that a wrapped coil must keep
_FINE = 1e-3  # of a path's length: shortest pieces whose distances are measured
_VERTICAL = 0.1  # sine of the angle to the normal, below which a piece is a via
_TILES = 24  # along the longer edge of a board
_UNEVEN = (3 - math.sqrt(5)) / 2  # golden section: no corner of copper is at such a part of a tile


@dataclass(frozen=True, eq=False)
class SurfaceLattice:
    """Coils on a surface, each flat and tangent or wrapped onto it.

    Every coil has a board of its own, whose lower face touches the surface and whose z axis is the
    surface's normal. Its y axis points up the slope, towards +z, or along y where the surface is
    level.

    Coils that overlap lie on different levels above the surface, as few as a colouring of the
    overlaps finds. Makers of wire loops instead bend a bridge into a wire where it crosses another
    (B. Keil et al., Magn. Reson. Med. 70, 248, 2013), which a flat board cannot do.

    The centres of the coils are `points` (n, 3) in m on the `surface`, as `spread` finds them.
    Every coil has the copper `layers`, and one of the `sizes` (n,) in m: its diameter, size across
    flats, or longer side, None for the width of the shape. `rotation` is its counter-clockwise turn
    in rad about its normal. `step` is the height of a level in m, None for twice the thickness of
    the board, and `levels` the level of every coil, from 0, None for those of the function
    `levels`. `wrapped` coils are laid onto the surface instead of left flat. The `names` are coil1,
    coil2, … by default. Raises GeometryError for points off the surface or at one place, or sizes,
    names or a step that do not fit.

    >>> from coilarray.geometry import Spiral
    >>> finger = Surface.dome((8e-3, 8e-3, 8e-3), skirt=12e-3)
    >>> lattice = SurfaceLattice(finger, [(0, 0, 8e-3), (8e-3, 0, -6e-3)], ("L1", "L2"))
    >>> boards = lattice.boards(Spiral(6, 5e-3, 4, 0.1e-3, 0.1e-3), Stackup.usual(2, 1))
    >>> [(array.names, round(pose.z * 1e3, 1)) for array, pose in boards]
    [(('coil1',), 8.3), (('coil2',), -6.0)]
    """

    surface: Surface
    points: FloatArray
    layers: tuple[str, ...]
    sizes: FloatArray | None = None
    rotation: float = 0.0
    step: float | None = None
    wrapped: bool = False
    names: tuple[str, ...] | None = None
    levels: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        from scipy.spatial import cKDTree

        points = _numbers("points", self.points)
        if points.ndim != 2 or points.shape[1] != 3 or not len(points):
            raise GeometryError(f"points must have shape (n >= 1, 3); got {points.shape}.")
        object.__setattr__(self, "points", points)
        places = self.on_surface[0]
        scale = math.sqrt(self.surface.area / len(points))
        if len(points) > 1:
            apart = np.asarray(cKDTree(points).query(points, k=2)[0])[:, 1]
            if apart.min() < _SAME * scale:
                raise GeometryError(f"points must be apart; point {int(np.argmin(apart))} is at another one's place.")
            scale = min(scale, float(apart.mean()))
        away = np.linalg.norm(places - points, axis=1)
        k = int(np.argmax(away))
        if away[k] > _OFF * scale:
            raise GeometryError(
                f"points must lie on the surface, to {_OFF * scale * 1e3:.2g} mm; point {k} lies "
                f"{away[k] * 1e3:.3g} mm beside it."
            )
        if self.sizes is not None:
            sizes = _numbers("sizes", self.sizes)
            if sizes.shape != (len(points),):
                raise GeometryError(f"sizes must be {len(points)}, one a point; got shape {sizes.shape}.")
            for size in sizes.tolist():
                require_positive("sizes", size, " mm")
            object.__setattr__(self, "sizes", sizes)
        for key in ("names", "levels"):
            given = getattr(self, key)
            if given is not None and len(given) != len(points):
                raise GeometryError(f"{key} must be {len(points)}, one a point; got {len(given)}.")
        if self.step is not None:
            require_positive("step of levels", self.step, " mm")
        require_finite("rotation", self.rotation)

    @cached_property
    def on_surface(self) -> tuple[FloatArray, FloatArray]:
        """Nearest points of the surface in m, and its normals there, (n, 3) each."""
        return self.surface.nearest(self.points)

    def boards(
        self, coil: SingleCoil, stackup: Stackup, *, board_margin: float = 2e-3, through_holes: bool = True
    ) -> tuple[tuple[Array, Pose], ...]:
        """Return the board of every coil, and its pose.

        All have the shape of `coil` in their sizes, and their own `stackup`. `board_margin` and
        `through_holes` are as in `Array`. Raises GeometryError as the shape in another size, or for
        flat coils that cut through each other.
        """
        found = self._placed(coil, stackup, board_margin, through_holes)
        if not self.wrapped:
            _refuse_cuts([array.conductors()[0].posed(pose) for array, pose in found])
        return found

    def conductors(self, coil: SingleCoil, stackup: Stackup) -> tuple[Conductor, ...]:
        """Return the paths in m of a `coil` on its `stackup`, also if they cut through each other."""
        return tuple(array.conductors()[0].posed(pose) for array, pose in self._placed(coil, stackup))

    def _placed(
        self, coil: SingleCoil, stackup: Stackup, board_margin: float = 2e-3, through_holes: bool = True
    ) -> tuple[tuple[Array, Pose], ...]:
        """Boards and poses, as in `boards`, without its check."""
        shape = coil.coil()
        sizes = [size_of(shape)] * len(self.points) if self.sizes is None else self.sizes.tolist()
        sized = {size: resized(shape, size) for size in set(sizes)}
        coils = [sized[size] for size in sizes]
        names = self.names or tuple(f"coil{k + 1}" for k in range(len(coils)))
        poses = self.poses(coils, stackup)
        found = []
        for name, one, pose in zip(names, coils, poses, strict=True):
            place = Placement(name, one, self.layers, 0.0, 0.0, self.rotation)
            form = Wrap(self.surface, pose) if self.wrapped else None
            found.append((Array(stackup, (place,), board_margin, through_holes, form=form), pose))
        found[0] = replace(found[0][0], lattice=OnSurface(self, shape)), found[0][1]
        return tuple(found)

    def poses(self, coils: Sequence[Coil], stackup: Stackup) -> tuple[Pose, ...]:
        """Return the pose of the boards of all `coils` in their sizes, on levels of a `stackup`."""
        places, normals = self.on_surface
        radii = np.array([np.hypot(*coil.outline.T).max() for coil in coils])
        step = 2 * stackup.thickness if self.step is None else self.step
        found_levels = levels(places, radii) if self.levels is None else self.levels
        heights = stackup.thickness + step * np.array(found_levels)
        found = []
        for place, normal, height in zip(places, normals, heights, strict=True):
            up = np.array([0.0, 0.0, 1.0] if math.hypot(normal[0], normal[1]) > _UPRIGHT else [0.0, 1.0, 0.0])
            y = up - (up @ normal) * normal
            y /= np.linalg.norm(y)
            found.append(Pose.of(np.column_stack((np.cross(y, normal), y, normal)), place + height * normal))
        return tuple(found)


@dataclass(frozen=True, eq=False)
class OnSurface:
    """Lattice, and shape of the coils before they were resized, of the first of a surface's boards."""

    lattice: SurfaceLattice
    coil: Coil


@dataclass(frozen=True, eq=False)
class Wrap:
    """Form of a board that is laid onto a surface.

    A point of the board goes along the normal at the nearest point of the surface, to its own height
    above it. Beyond a rim the surface goes on straight. Lengths are kept in the middle of the board
    only. `pose` is that of the flat board, in whose coordinates the wrapped board stays.
    """

    carrier: Surface
    pose: Pose

    @cached_property
    def height(self) -> float:
        """Height in m of the board's origin above the surface."""
        place, normal = self.carrier.nearest(self.pose.shift)
        return float((self.pose.shift - place[0]) @ normal[0])

    def surface(self, points: npt.ArrayLike) -> FloatArray:
        """Return points of the flat board where the wrapped board has them."""
        flat = np.asarray(points, dtype=np.float64)
        return self._laid(flat.reshape(-1, 3))[0].reshape(flat.shape)

    def bent(self, path: Conductor) -> Conductor:
        """Return a path of the flat board in pieces on the wrapped board, widths tangential."""
        longest = _CHORD * float(np.ptp(path.vertices, axis=0).max())
        row, starts, middles = path.pieces(np.ceil(path.lengths / longest))
        vertices = self._laid(np.vstack((starts, path.vertices[-1:])))[0]
        normals = self._laid(middles)[1]
        along = np.diff(vertices, axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        across = np.cross(normals, along)
        vertical = np.linalg.norm(across, axis=1) < _VERTICAL
        across[vertical] = path.across[row][vertical]
        sizes = path.widths[row], path.thicknesses[row], path.areas[row]
        return Conductor(vertices, *sizes, path.name, across)

    def require_fits(self, bounds: tuple[float, float, float, float], thickness: float) -> None:
        """Refuse a board that keeps less than half of its width on the surface."""
        x_min, y_min, x_max, y_max = bounds
        edges = np.array([(x_min, 0, 0), (x_max, 0, 0), (0, y_min, 0), (0, y_max, 0)])
        kept = np.linalg.norm(self.surface(edges) - self.surface(np.zeros(3)), axis=1) / np.linalg.norm(edges, axis=1)
        if kept.min() < _KEPT:
            raise GeometryError(
                f"a wrapped coil must keep half of its width on the surface; a board of {(x_max - x_min) * 1e3:.4g} × "
                f"{(y_max - y_min) * 1e3:.4g} mm keeps {100 * kept.min():.0f} %."
            )

    def strips(self, bounds: tuple[float, float, float, float]) -> tuple[shapely.Polygon, ...]:
        """Return tiles of the flat board, which are nearly flat on the surface."""
        x_min, y_min, x_max, y_max = bounds
        size = max(x_max - x_min, y_max - y_min) / _TILES
        x, y = (
            low + size * (np.arange(-1, math.ceil((high - low) / size) + 1) + _UNEVEN)
            for low, high in ((x_min, x_max), (y_min, y_max))
        )
        low, high = np.meshgrid(x[:-1], y[:-1]), np.meshgrid(x[1:], y[1:])
        return tuple(np.asarray(shapely.box(*low, *high)).ravel().tolist())

    def inner_radius(self, bounds: tuple[float, float, float, float], thickness: float) -> float:
        """Return inf: boards on surfaces have no rule for their bend."""
        return math.inf

    def _laid(self, flat: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points on the wrapped board and normals there, (n, 3) each, in the board's coordinates."""
        there = self.pose.apply(flat * (1.0, 1.0, 0.0))
        places, normals = self.carrier.nearest(there)
        down = ((there - places) * normals).sum(axis=1, keepdims=True)
        return self.pose.undo(there + (self.height + flat[:, 2:] - down) * normals), normals @ self.pose.rotation


def sizes_by_distance(surface: Surface, points: FloatArray, ratio: float) -> FloatArray:
    """Size coils at `points` (n, 3) of a `surface` in m: `ratio` times the mean distance of neighbours.

    Flat circles decouple at a ratio of 1.32.
    """
    centres = np.asarray(points, dtype=np.float64)
    pairs = np.array(neighbours(surface, centres)).reshape(-1, 2)
    apart = np.tile(np.linalg.norm(centres[pairs[:, 0]] - centres[pairs[:, 1]], axis=1), 2)
    held = np.bincount(pairs.T.ravel(), minlength=len(centres))
    return np.asarray(ratio * np.bincount(pairs.T.ravel(), apart, len(centres)) / np.maximum(held, 1))


def levels(centres: FloatArray, radii: FloatArray) -> list[int]:
    """Give coils that overlap different levels, few in all.

    The coil with the most levels beside it comes next (D. Brélaz, Commun. ACM 22, 251, 1979).
    `centres` (n, 3) and largest `radii` (n,) are in m.
    """
    apart = np.linalg.norm(centres[:, None] - centres, axis=2)
    overlaps = (apart < radii[:, None] + radii) & ~np.eye(len(centres), dtype=bool)
    found = np.full(len(centres), -1)
    for _ in range(len(centres)):
        beside = [set(found[row & (found >= 0)].tolist()) for row in overlaps]
        open_ones = np.flatnonzero(found < 0).tolist()
        following = max(open_ones, key=lambda k: (len(beside[k]), overlaps[k].sum(), -k))
        found[following] = next(level for level in range(len(centres)) if level not in beside[following])
    return found.tolist()


def resized(coil: Coil, size: float) -> Coil:
    """Return a coil of a width in m, as in `SurfaceLattice`, with the same traces."""
    share = size / size_of(coil)
    if isinstance(coil.wound, Spiral):
        return replace(coil.wound, diameter=size).coil()
    if isinstance(coil.wound, RoundedSpiral):
        extent, breadth, radius = (share * getattr(coil.wound, key) for key in ("extent", "breadth", "corner_radius"))
        return replace(coil.wound, extent=extent, breadth=breadth, corner_radius=radius).coil()
    return replace(coil, lines=tuple(share * line for line in coil.lines), outline=share * coil.outline)


def size_of(coil: Coil) -> float:
    """Width of a `coil` in m, as in `resized`."""
    if isinstance(coil.wound, Spiral):
        return coil.wound.diameter
    if isinstance(coil.wound, RoundedSpiral):
        return max(coil.wound.extent, coil.wound.breadth)
    return float(np.ptp(coil.outline, axis=0).max())


def _refuse_cuts(paths: Sequence[Conductor]) -> None:
    """Raise GeometryError if bars of two paths are nearer than their diagonals.

    At any angle to each other, bars that are farther do not meet.
    """
    from scipy.spatial import cKDTree

    trees, sizes = [], []
    for path in paths:
        diagonal = float(np.hypot(path.widths, path.thicknesses).max())
        _, starts, middles = path.pieces(np.ceil(path.lengths / max(diagonal, _FINE * path.lengths.sum())))
        trees.append(cKDTree(np.vstack((starts, middles))))
        sizes.append(diagonal)
    for i, k in combinations(range(len(paths)), 2):
        needed = (sizes[i] + sizes[k]) / 2
        near = float(np.min(trees[i].query(trees[k].data, distance_upper_bound=needed)[0]))
        if near < needed:
            raise GeometryError(
                f"coils {paths[i].name} and {paths[k].name} cut through each other: their traces are {near * 1e3:.3g} "
                f"mm apart and need {needed * 1e3:.3g} mm; another step of the levels, or wrapped coils, part them."
            )


def _numbers(what: str, values: npt.ArrayLike) -> FloatArray:
    """Finite numbers of any shape, or GeometryError."""
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise GeometryError(f"{what} must be numbers; got {values!r:.60}.") from None
    if not np.isfinite(array).all():
        raise GeometryError(f"{what} must be finite; at least one is not.")
    array.setflags(write=False)
    return array
