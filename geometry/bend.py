"""Flexible boards bent about lines in their plane.

The neutral plane keeps its lengths: it becomes a cylinder, a cone, or cylinders with flat parts
between. Points above it move along the normal of the bent surface.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.compute.arrays import FloatArray
from coilarray.errors import LARGEST, GeometryError, require_finite, require_positive
from coilarray.geometry.conductor import Conductor

_STEP = 0.04  # rad of a bend along one chord, at most: 1/24 of its square is 7e-5 of a length
_MOST_PIECES = 1e6
_LEAST_LEFT = 1e-3  # of a length on the neutral plane, which is left at a height inside the bend
_TOUCH = 1e-12  # m; zones that overlap by less are beside each other
_SAGITTA = 6e-5  # of a path's extent, between a chord and the bent surface: some 3e-5 of L
_FACET = 0.06  # rad of a bend along one facet of a solid, at most: 2 µm from the surface at a radius of 5 mm
_UNEVEN = (3 - math.sqrt(5)) / 2  # golden section: no corner of copper is at such a part of a range
_BEYOND = 1e-3  # rad, by which strips reach beyond a board

Bounds = tuple[float, float, float, float]  # edges of a flat board in m: x_min, y_min, x_max, y_max


@dataclass(frozen=True)
class Zone:
    """Bent strip of a board.

    The `radius` of the neutral plane is in m. Positive radii bend the edges down, negative ones up.
    `at` is the distance of the strip's middle line from the origin in m, across the axis of the
    bend, and `width` the strip's in m, by default all of the board. Raises GeometryError for a
    radius of zero, a width that is not positive, or values that are not finite.
    """

    radius: float
    at: float = 0.0
    width: float = math.inf

    def __post_init__(self) -> None:
        require_finite("radius and place of a bend", self.radius, self.at)
        if not 1 / LARGEST < abs(self.radius):
            raise GeometryError(f"radius of a bend must not be zero; got {self.radius} m.")
        if self.width != math.inf:
            require_positive("width of a bend", self.width)


@dataclass(frozen=True)
class Bend:
    """Bend of a flexible board.

    The `zones` are bent strips across the axis, which do not overlap. `axis` is the direction in
    rad of the lines about which the board is bent, from the x axis, and `neutral` the height in m
    of the plane that keeps its lengths. `apex` is the distance in m along the axis from the origin
    to the apex of a cone, positive or negative, None for cylinders. The single zone then covers the
    board, and its radius holds at the origin. Raises GeometryError without zones, for zones that
    overlap, a cone of several zones or with its apex at the origin, or values that are not finite.

    >>> finger = Bend((Zone(8e-3),))
    >>> finger.surface([[0.0, 8e-3 * math.pi / 2, 0.0]]).round(9).tolist()
    [[0.0, 0.008, -0.008]]
    """

    zones: tuple[Zone, ...]
    axis: float = 0.0
    neutral: float = 0.0
    apex: float | None = None

    def __post_init__(self) -> None:
        require_finite("axis and neutral plane of a bend", self.axis, self.neutral)
        if not self.zones:
            raise GeometryError("a bend must have at least one zone; got none.")
        spans = sorted((zone.at - zone.width / 2, zone.at + zone.width / 2) for zone in self.zones)
        for (low, high), (start, stop) in pairwise(spans):
            if high - start > _TOUCH:
                raise GeometryError(
                    f"zones of a bend must not overlap; the one from {low * 1e3:g} to {high * 1e3:g} mm meets the one "
                    f"from {start * 1e3:g} to {stop * 1e3:g} mm."
                )
        if self.apex is not None:
            require_finite("apex of a bend", self.apex)
            if len(self.zones) > 1 or self.zones[0].width != math.inf or not abs(self.apex) > 1 / LARGEST:
                raise GeometryError("a cone must be one zone without a width, and its apex away from the origin.")

    def surface(self, points: npt.ArrayLike) -> FloatArray:
        """Return points of the flat board where the bend takes them.

        `points` and result have the shape (..., 3) and are in m. Raises GeometryError for heights
        inside a bend that it does not leave room for.
        """
        flat = np.asarray(points, dtype=np.float64)
        place, _, normal = self._neutral_surface(flat.reshape(-1, 3) @ self._frame.T)
        height = flat.reshape(-1, 3)[:, 2:] - self.neutral
        for zone in self.zones:
            if (1 + height / zone.radius <= _LEAST_LEFT).any():
                raise GeometryError(
                    f"a bend of {zone.radius * 1e3:g} mm must be larger than the heights inside it; they reach "
                    f"{float(np.abs(height).max()) * 1e3:g} mm from the neutral plane."
                )
        return np.asarray((place + height * normal) @ self._frame + (0.0, 0.0, self.neutral)).reshape(flat.shape)

    def turned(self, points: npt.ArrayLike, directions: npt.ArrayLike) -> FloatArray:
        """Return directions at points of the flat board as they are on the bent board.

        `points` of shape (n, 3) are in m. The lengths of the `directions`, shape (n, 3), are kept,
        without unit.
        """
        _, along, normal = self._neutral_surface(np.asarray(points, dtype=np.float64) @ self._frame.T)
        ways = np.asarray(directions, dtype=np.float64) @ self._frame.T
        across = np.cross(normal, along)
        return np.asarray((ways[:, :1] * along + ways[:, 1:2] * across + ways[:, 2:] * normal) @ self._frame)

    def bent(self, path: Conductor) -> Conductor:
        """Return a current path of the flat board on the bent board.

        The segments of the `path` are cut into chords, and widths stay tangential to the surface.
        """
        if not isinstance(path, Conductor):
            raise GeometryError(f"path must be a Conductor, as in coil.conductors(); got {path!r:.60}.")
        steps = np.diff(path.vertices, axis=0)
        curvature = self._largest_curvature(path.vertices)
        longest = min(_STEP / curvature, math.sqrt(8 * _SAGITTA * np.ptp(path.vertices, axis=0).max() / curvature))
        # on a cone every direction but the generator's own is bent
        way = np.abs(steps @ self._frame[1]) if self.apex is None else np.linalg.norm(steps, axis=1)
        count = np.maximum(1, np.ceil(way / longest))
        if count.sum() > _MOST_PIECES:
            raise GeometryError(
                f"a bend of {1e3 / curvature:g} mm must need at most {_MOST_PIECES:g} chords; "
                f"{path.name} takes {count.sum():.3g}."
            )
        row, starts, middles = path.pieces(count)
        vertices = self.surface(np.vstack((starts, path.vertices[-1:])))
        across = self.turned(middles, path.across[row])
        return Conductor(vertices, path.widths[row], path.thicknesses[row], path.areas[row], path.name, across)

    def strips(self, bounds: Bounds) -> tuple[shapely.Polygon, ...]:
        """Return strips of the flat board that are nearly flat on the bent board.

        They are in m and cover the board of edges `bounds`, as in `Array.bounds`. The bend turns
        each by 0.06 rad at most.
        """
        low, high = self._reach(bounds, 1)
        start, stop = self._reach(bounds, 0)
        size = high - low + stop - start
        if self.apex is not None:
            away, far = -np.sign(self.apex), 2 * (size + abs(self.apex))
            alpha = np.arctan2((low, low, high, high), away * (np.array([start, stop, start, stop]) - self.apex))
            step = _FACET * math.sin(math.atan(abs(self.zones[0].radius / self.apex)))
            turns = _levels(float(alpha.min()) - _BEYOND, float(alpha.max()) + _BEYOND, step)
            ends = np.column_stack((self.apex + away * far * np.cos(turns), far * np.sin(turns)))
            starts = np.tile((self.apex, 0.0), (len(ends), 1))
        else:
            ranges = [(zone.at - zone.width / 2, zone.at + zone.width / 2, abs(zone.radius)) for zone in self.zones]
            inside = [(max(low, one), min(high, other), radius) for one, other, radius in ranges]
            parts = [_levels(one, other, _FACET * radius) for one, other, radius in inside if one < other]
            levels = np.unique(np.concatenate(([low - size, high + size], *parts)))
            starts, ends = (np.column_stack((np.full_like(levels, at), levels)) for at in (start - size, stop + size))
        frame = self._frame[:2, :2]
        corners = np.stack((starts[:-1] @ frame, ends[:-1] @ frame, ends[1:] @ frame, starts[1:] @ frame), axis=1)
        return tuple(shapely.Polygon(strip) for strip in corners)

    def inner_radius(self, bounds: Bounds, thickness: float) -> float:
        """Return the least radius of curvature of the inner face of a board.

        The radius in m is of the face towards the axis of the bend. `bounds` are the edges of the
        flat board, as in `Array.bounds`, and its upper face is at z = 0, `thickness` in m above the
        lower one.
        """
        share = 1.0
        if self.apex is not None:
            share = float(np.abs(_corners(bounds) @ self._frame[0, :2] - self.apex).min()) / abs(self.apex)
        return min(share * abs(zone.radius) - self._inside(zone.radius, thickness) for zone in self.zones)

    def neutral_radius(self, inner: float, thickness: float) -> float:
        """Return the radius of the neutral plane for one of the inner face.

        Both radii in m, the result as of a `Zone`, are negative if the edges are bent up. The board
        has the `thickness` of `inner_radius`, and `inner` is the radius of its inner face.
        """
        return inner + math.copysign(self._inside(inner, thickness), inner)

    def between(self, near: float, far: float, bounds: Bounds, thickness: float) -> Bend:
        """Return the bend of a board around a round body, a cylinder or a cone.

        The axis and the neutral plane stay. `near` and `far` are the radii in m of the body at both
        ends of the board along the axis, negative if the edges are bent up, `bounds` and
        `thickness` as in `inner_radius`. Raises GeometryError for radii that differ by the length
        of the board or more, or a cone whose apex lies between the board and the origin.
        """
        if near == far:
            return replace(self, zones=(Zone(self.neutral_radius(near, thickness)),), apex=None)
        start, stop = self._reach(bounds, 0)
        sine = (abs(far) - abs(near)) / (stop - start)
        if not abs(sine) < 1:
            raise GeometryError(
                f"the radii of a cone must differ by less than the {(stop - start) * 1e3:.4g} mm of the board along "
                f"its axis; got {near * 1e3:.4g} and {far * 1e3:.4g} mm."
            )
        cosine = math.sqrt(1 - sine**2)
        radius = abs(near) + self._inside(near, thickness) * cosine - sine * start  # of the circle at the origin
        if radius <= 0:
            raise GeometryError("the apex of a cone must not lie between the board and the origin.")
        return replace(self, zones=(Zone(math.copysign(radius / cosine, near)),), apex=-radius / sine)

    def end_radii(self, bounds: Bounds, thickness: float) -> tuple[float, float]:
        """Return the radii of the round body at both ends of a board, as in `between`.

        They are in m, where the axis starts and where it ends, and equal for a cylinder. `bounds`
        and `thickness` are as in `inner_radius`.
        """
        radius, slope = self.zones[0].radius, 0.0
        if self.apex is not None:
            slope = -math.copysign(math.atan(abs(radius / self.apex)), self.apex)
        depth = abs(radius) - self._inside(radius, thickness)
        near, far = (depth * math.cos(slope) + math.sin(slope) * end for end in self._reach(bounds, 0))
        return math.copysign(near, radius), math.copysign(far, radius)

    def _inside(self, radius: float, thickness: float) -> float:
        """Distance of the neutral plane from the inner face in m, by the sign of a radius."""
        return self.neutral + thickness if radius > 0 else -self.neutral

    def _reach(self, bounds: Bounds, axis: int) -> tuple[float, float]:
        """Lowest and highest place of a board in m, along the axis (0) or across it (1)."""
        places = _corners(bounds) @ self._frame[axis, :2]
        return float(places.min()), float(places.max())

    def require_fits(self, bounds: Bounds, thickness: float) -> None:
        """Refuse a board that cannot be bent so.

        `bounds` and `thickness` are as in `inner_radius`. Raises GeometryError for an inner radius
        below the thickness, a zone beside the board, an apex on the board, or a board that would
        meet itself.
        """
        along, across = self._frame[:2, :2] @ _corners(bounds).T
        low, high = self._reach(bounds, 1)
        if self.apex is not None and (np.sign(self.apex) * (self.apex - along) <= _TOUCH).any():
            raise GeometryError(
                f"the apex of a cone must lie beyond the board, which reaches from {along.min() * 1e3:.4g} to "
                f"{along.max() * 1e3:.4g} mm along the axis; it is at {self.apex * 1e3:.4g} mm."
            )
        radius = self.inner_radius(bounds, thickness)
        if radius < thickness:
            raise GeometryError(
                f"the inner radius of a bend must be at least the board's thickness of {thickness * 1e3:.4g} mm; "
                f"got {radius * 1e3:.4g} mm."
            )
        for zone in self.zones:
            first, last = max(low, zone.at - zone.width / 2), min(high, zone.at + zone.width / 2)
            if last <= first:
                raise GeometryError(
                    f"a zone of a bend must lie on the board, from {low * 1e3:.4g} to {high * 1e3:.4g} mm across the "
                    f"axis; got one at {zone.at * 1e3:.4g} mm."
                )
            turn = (last - first) / abs(zone.radius)
            if self.apex is not None:
                slope = math.atan(abs(zone.radius / self.apex))
                turn = float(np.ptp(np.arctan2(across, np.abs(self.apex - along)))) / math.sin(slope)
            if turn >= 2 * math.pi:
                raise GeometryError(
                    f"a bent board must not meet itself; a bend of {abs(zone.radius) * 1e3:.4g} mm turns it by "
                    f"{math.degrees(turn):.4g} degrees."
                )
        if self.apex is None:
            knots = [low, high, *(zone.at + side * zone.width / 2 for zone in self.zones for side in (-1, 1))]
            knots = sorted({min(max(knot, low), high) for knot in knots})
            steps = [np.linspace(one, other, 1 + math.ceil((other - one) / (_FACET * self.least_radius)))[1:]
                     for one, other in pairwise(knots)]  # fmt: skip
            s = np.concatenate(([low], *steps))
            place, _, normal = self._neutral_surface(np.column_stack((np.zeros_like(s), s)))
            faces = [(place + (height - self.neutral) * normal)[:, 1:] for height in (0.0, -thickness)]
            outline = shapely.Polygon(np.vstack((faces[0], faces[1][::-1])))
            if not outline.is_valid:
                raise GeometryError(
                    f"a bent board must not meet itself; it does {np.ptp(s) * 1e3:.4g} mm wide with bends of "
                    f"{', '.join(f'{zone.radius * 1e3:.4g}' for zone in self.zones)} mm."
                )

    @property
    def least_radius(self) -> float:
        """Smallest radius of the neutral plane in m at the origin's distance from the apex."""
        return min(abs(zone.radius) for zone in self.zones)

    @property
    def _frame(self) -> FloatArray:
        """Unit vectors along the axis, across it, and upwards, as rows."""
        c, s = math.cos(self.axis), math.sin(self.axis)
        return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])

    def _largest_curvature(self, points: FloatArray) -> float:
        """Largest curvature in 1/m over points (n, 3)."""
        if self.apex is None:
            return 1 / self.least_radius
        nearest = float(np.abs(points @ self._frame[0] - self.apex).min())
        return abs(self.apex) / (self.least_radius * max(nearest, 1e-9 * abs(self.apex)))

    def _neutral_surface(self, local: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Places on the bent neutral plane, its direction along the axis and its normal, (n, 3) each.

        Coordinates are along the axis, across it, and upwards.
        """
        if self.apex is not None:
            return self._cone(local)
        across, up, angle = _bent_line(self.zones, local[:, 1])
        along = np.tile((1.0, 0.0, 0.0), (len(local), 1))
        normal = np.column_stack((np.zeros(len(local)), np.sin(angle), np.cos(angle)))
        return np.column_stack((local[:, 0], across, up)), along, normal

    def _cone(self, local: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the same for a cone, whose generators meet at the apex."""
        assert self.apex is not None
        radius = self.zones[0].radius
        # normal curvature at the distance ρ from the apex: 1/(ρ tan β), and the angle about the cone's axis α/sin β
        slope = math.atan(abs(radius) / abs(self.apex))
        away = -np.sign(self.apex)
        from_apex = np.column_stack((away * (local[:, 0] - self.apex), local[:, 1]))
        rho, alpha = np.hypot(*from_apex.T), np.arctan2(from_apex[:, 1], from_apex[:, 0])
        if (from_apex[:, 0] <= 1e-9 * abs(self.apex)).any():
            raise GeometryError(f"the apex of a cone must lie beyond the copper; it is at {self.apex * 1e3:g} mm.")
        phi, bend = alpha / math.sin(slope), float(np.sign(radius))
        c, s = np.cos(phi), np.sin(phi)
        sine, cosine = math.sin(slope), math.cos(slope)
        # the generator through the origin stays where it is: the cone's axis is tilted by β against it
        ahead = rho * (cosine**2 + sine**2 * c)
        down = rho * sine * cosine * (1 - c)
        place = np.column_stack((self.apex + away * ahead, rho * sine * s, -bend * down))
        outwards = np.column_stack((away * (cosine**2 + sine**2 * c), sine * s, -bend * sine * cosine * (1 - c)))
        around = np.column_stack((-away * sine * s, c, -bend * cosine * s))
        # the direction of the axis, between the generator and the circle through each point
        along = np.cos(alpha)[:, None] * outwards - np.sin(alpha)[:, None] * around
        return place, away * along, away * np.cross(outwards, around)


def _corners(bounds: Bounds) -> FloatArray:
    """Corners (4, 2) of a board."""
    return shapely.get_coordinates(shapely.box(*bounds))[:4]


def _levels(low: float, high: float, step: float) -> FloatArray:
    """Values from `low` to `high` by a step at most, none at a round number."""
    count = 1 + math.ceil((high - low) / step)
    return np.asarray(low + (high - low) * (np.arange(count) + _UNEVEN) / count)


def _bent_line(zones: Sequence[Zone], s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place across and up, and angle downwards, of points `s` of a line that is bent in zones.

    At s = 0 the line keeps its place and its direction.
    """
    ends = [zone.at + side * zone.width / 2 for zone in zones for side in (-1, 1)]
    knots = np.array([end for end in ends if math.isfinite(end)])
    across, up, angle = np.zeros_like(s), np.zeros_like(s), np.zeros_like(s)
    for side in (1.0, -1.0):
        way, edges = side * s, side * knots
        edges = np.concatenate(([0.0], np.sort(edges[edges > 0]), [np.inf]))
        y, z, turn = 0.0, 0.0, 0.0
        for low, high in pairwise(edges.tolist()):
            middle = side * (low + min(high, low + 1.0)) / 2
            curvature = next((1 / zone.radius for zone in zones if abs(middle - zone.at) < zone.width / 2), 0.0)
            here = (way >= low) & (way < high) & ((side > 0) | (way > 0))
            at_y, up[here], turned = _arc(y, z, turn, curvature, way[here] - low)
            across[here], angle[here] = side * at_y, side * turned
            if math.isfinite(high):
                y, z, turn = (float(value[0]) for value in _arc(y, z, turn, curvature, np.array([high - low])))
    return across, up, angle


def _arc(y: float, z: float, turn: float, curvature: float, length: FloatArray) -> tuple[FloatArray, ...]:
    """Follow an arc from a place and direction over lengths in m."""
    angle = turn + curvature * length
    half = 0.5 * curvature * length
    chord = length * np.sinc(half / np.pi)
    return y + chord * np.cos(turn + half), z - chord * np.sin(turn + half), angle
