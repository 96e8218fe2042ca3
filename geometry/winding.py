"""Turns of a path, their poles, and cuts across them.

Nothing depends on where a coil lies or how it is turned. Directions and places are taken from the
path itself, never from the first of several equal places.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.compute.arrays import FloatArray, IntArray

_REACH = math.pi  # largest distance in pitches within a bundle: no ratio of round lengths, as below
_NEXT = math.sqrt(3)  # pitches within which a turn has a neighbour on its line
_ABOVE = math.sqrt(0.5)  # pitches sideways: layers are staggered by half a pitch at most
_ALONGSIDE = 0.9  # cosine of the largest angle between neighbouring turns
_PARALLEL = 0.985  # of one turn in ten at 30° from the others, or all spread over 20°
_STEEPEST = 0.35  # cosine to a ray's normal below which a trace runs along the ray: a stub
_WITHIN = (3 - math.sqrt(5)) / 2  # golden section: symmetry puts nothing there
_GRAIN = 1e-9  # of the size of a path
_SAME = 1e-6  # of a distance: places of a symmetric coil have the same distance but for rounding
_NO_AREA = 1e-6  # of the area that is enclosed: rounding between lines above each other
_POLE = 1 / 3  # of the most turns: a pole has more
_RAYS = 180
_BLOCK = 64
_HALVINGS = 8


@dataclass(frozen=True, eq=False)
class FlatPath:
    """A current path seen from above, with `points` (n + 1, 2) in m.

    `widths` (n,) are the widths in m of the pieces between them, and `line` (n,) the number of each
    piece's line, which is on one layer. Vias are pieces of no length.
    """

    points: FloatArray
    widths: FloatArray
    line: IntArray

    @classmethod
    def of_lines(cls, lines: Sequence[FloatArray], widths: Sequence[FloatArray]) -> FlatPath:
        """Join lines (n, 2) with widths (n − 1,), in m."""
        numbers = [np.append(np.full(len(width), k), -1) for k, width in enumerate(widths)]
        with_vias = [np.append(width, 0.0) for width in widths]
        return cls(np.vstack(lines), np.concatenate(with_vias)[:-1], np.concatenate(numbers)[:-1])

    @property
    def steps(self) -> FloatArray:
        """Vectors along the pieces in m, shape (n, 2)."""
        return np.diff(self.points, axis=0)

    @property
    def along(self) -> FloatArray:
        """Length (n + 1,) in m along the path up to every point."""
        return np.append(0.0, np.cumsum(np.hypot(*self.steps.T)))

    def between(self, begin: float, end: float) -> FloatArray:
        """Points (m, 2) in m between two places along the path."""
        along = self.along
        inside = (along > begin) & (along < end)
        return np.vstack((self.at(np.array([begin])), self.points[inside], self.at(np.array([end]))))

    def at(self, s: FloatArray) -> FloatArray:
        """Points (n, 2) in m at places `s` (m) along the path."""
        along = self.along
        return np.column_stack([np.interp(s, along, axis) for axis in self.points.T])


@dataclass(frozen=True)
class Pole:
    """Place in m about which a path winds."""

    x: float
    y: float
    turns: float


@dataclass(frozen=True, eq=False)
class Cut:
    """Turns crossed by a ray from a pole, outwards.

    `piece` (k,) is the piece of the path. `across` (k,) are the perpendicular distances of the
    turns and `along` (k,) the places along the path, in m. `sign` (k,) is 1 for a current
    anticlockwise about the pole.
    """

    piece: IntArray
    across: FloatArray
    along: FloatArray
    sign: FloatArray


@dataclass(frozen=True, eq=False)
class Turns:
    """Winding part of a path from `begin` to `end` (m)."""

    path: FlatPath
    begin: float
    end: float
    pitch: float
    poles: tuple[Pole, ...]

    def cuts(self, rays: int) -> list[Cut]:
        """Cut the turns by rays from every pole."""
        return [cut for pole in self.poles for cut in self.about(pole, rays) if len(cut.piece)]

    def enough_cuts(self, least: int, most: int, crossings: float) -> list[Cut]:
        """Cut by `least` to `most` rays per pole, for about `crossings`."""
        wound = max(abs(pole.turns) for pole in self.poles)
        return self.cuts(min(max(math.ceil(crossings / wound), least), most))

    def own_turns(self, pole: Pole) -> float:
        """Count the turns from the first to the last about a pole."""
        sense = math.copysign(1.0, pole.turns)
        along = np.concatenate([cut.along[cut.sign == sense] for cut in self.about(pole, _RAYS)])
        return turns_about(self.path.between(along.min(), along.max()), (pole.x, pole.y)) if len(along) else pole.turns

    def about(self, pole: Pole, rays: int) -> list[Cut]:
        """Cut by rays from one pole, with cuts without turns."""
        inset = _WITHIN * (self.end - self.begin)
        places = self.path.at(np.array([self.begin + inset, self.end - inset])) - (pole.x, pole.y)
        away = np.hypot(*places.T)
        x, y = places[1] if away[1] > (1 + _SAME) * away[0] else places[0]
        first = math.atan2(y, x)
        # the angle from the pole to a place of the path, so that the rays turn and mirror with it.
        # Of two places with the same distance from the ends it is the outer place, so the choice of
        # the path's beginning has no influence
        sense = math.copysign(1.0, pole.turns)
        return [self._cut(pole, first + sense * 2 * math.pi * ray / rays) for ray in range(rays)]

    def _cut(self, pole: Pole, angle: float) -> Cut:
        path = self.path
        direction = np.array([[math.cos(angle), math.sin(angle)]])
        crossed, u, part, cosine = _crossings(path, np.array([[pole.x, pole.y]]), direction)
        piece = np.flatnonzero(crossed[0])
        u, part, cosine = u[0][piece], part[0][piece], cosine[0][piece]
        along = path.along[piece] + part * np.hypot(*path.steps[piece].T)
        keep = (u > 0) & (np.abs(cosine) > _STEEPEST) & (along > self.begin) & (along < self.end)
        order = np.flatnonzero(keep)[np.argsort(u[keep], kind="stable")]
        piece, u, along, cosine = piece[order], u[order], along[order], cosine[order]
        if not len(piece):
            return Cut(piece, u, along, cosine)
        steep = np.abs(cosine)
        steps = np.diff(u) * 0.5 * (steep[1:] + steep[:-1])
        bundle = np.concatenate(([0], np.cumsum(steps > _REACH * self.pitch)))
        most = np.flatnonzero(bundle == np.bincount(bundle).argmax())
        across = np.append(u[0] * steep[0], steps).cumsum()
        along_turns = path.steps[piece[most]] * np.sign(cosine[most])[:, None]
        along_turns /= np.hypot(*along_turns.T)[:, None]
        if np.hypot(*along_turns.mean(axis=0)) < _PARALLEL:
            most = most[:0]
        return Cut(piece[most], across[most], along[most], np.sign(cosine[most]))


def find_turns(path: FlatPath) -> Turns | None:
    """Find the winding part of a path, without its leads.

    From either end, a path is a lead up to the first place beside or above which another part of it
    runs in the same direction about a pitch away.
    """
    steps = path.steps
    length = np.hypot(*steps.T)
    real = np.flatnonzero(length > 0)
    every = real[:: max(1, len(real) // 256)]  # enough for a mean
    distance = _beside(path, path.points[every] + _WITHIN * steps[every], every)[0]
    weight = length[every]
    width = float(np.average(path.widths[real], weights=length[real]))
    # turns that are near count most, and turns without a neighbour do not count
    pitch = float((weight / distance).sum() / (weight / distance**2).sum()) if np.isfinite(distance).any() else 0.0
    pitch = max(pitch, width)
    begin = _lead(path, pitch)
    if begin is None:
        return None
    back = FlatPath(path.points[::-1], path.widths[::-1], path.line[::-1])
    end = float(path.along[-1]) - (_lead(back, pitch) or 0.0)
    poles = _poles(path.between(begin, end)) if end > begin else ()
    return Turns(path, begin, end, pitch, poles) if poles else None


def _crossings(
    path: FlatPath, origins: FloatArray, directions: FloatArray
) -> tuple[npt.NDArray[np.bool_], FloatArray, FloatArray, FloatArray]:
    """Crossings of lines with the pieces of a path.

    All arrays have the shape (lines, pieces): whether a piece is crossed, the place on the line in m
    from its point, the place on the piece from 0 to 1, and the cosine between the piece and the normal
    of the line, positive if the piece goes to the left.
    """
    x, y = path.points.T
    dx, dy = directions[:, :1], directions[:, 1:]
    ox, oy = x - origins[:, :1], y - origins[:, 1:]
    side, u = dx * oy - dy * ox, dx * ox + dy * oy
    crossed = (side[:, :-1] < 0) != (side[:, 1:] < 0)
    rise = np.diff(side, axis=1)
    part = np.divide(-side[:, :-1], rise, out=np.zeros_like(rise), where=crossed)
    length = np.hypot(*path.steps.T)
    cosine = np.divide(rise, length, out=np.zeros_like(rise), where=crossed)
    return crossed, u[:, :-1] + part * np.diff(u, axis=1), part, cosine


def _beside(path: FlatPath, places: FloatArray, piece: IntArray) -> tuple[FloatArray, FloatArray]:
    """Distances (m,) in m from places (m, 2) to parallel parts.

    The parts run in the direction of the path, first on the same line, second on other lines. The
    places lie on the pieces of number `piece` (m,). A distance without such a part is infinite.
    """
    length = np.hypot(*path.steps.T)
    tangent = path.steps[piece] / length[piece][:, None]
    normal = np.column_stack((tangent[:, 1], -tangent[:, 0]))
    crossed, u, _, cosine = _crossings(path, places, normal)
    own = path.line[piece][:, None] == path.line
    distance = np.where(crossed & (cosine > _ALONGSIDE), np.abs(u), np.inf)
    next_to = np.where(own & (distance > 0.5 * path.widths), distance, np.inf).min(axis=1)
    return next_to, np.where(own, np.inf, distance).min(axis=1)


def _lead(path: FlatPath, pitch: float) -> float | None:
    """Length in m of a path's first lead."""
    along = path.along
    total = float(along[-1])
    step = pitch / 2

    def winds(s: FloatArray) -> npt.NDArray[np.bool_]:
        piece = np.clip(np.searchsorted(along, s, side="right") - 1, 0, len(path.line) - 1)
        next_to, above = _beside(path, path.at(s), piece)
        return np.asarray((next_to < _NEXT * pitch) | (above < _ABOVE * pitch))

    for block in range(math.ceil(total / (step * _BLOCK))):
        s = step * (np.arange(block * _BLOCK, (block + 1) * _BLOCK, dtype=np.float64) + _WITHIN)
        s = s[s < total]
        found = np.flatnonzero(winds(s)) if len(s) else s
        if len(found):
            high = float(s[found[0]])
            low = max(high - step, 0.0)
            for _ in range(_HALVINGS):
                tried = np.asarray(np.linspace(low, high, 34)[1:-1], dtype=np.float64)
                good = np.flatnonzero(winds(tried))
                low, high = (tried[good[0] - 1] if good[0] else low, tried[good[0]]) if len(good) else (tried[-1], high)
            return float(high)
    return None


def _poles(points: FloatArray) -> tuple[Pole, ...]:
    """Places about which a path (n, 2), closed, winds most."""
    ring = np.vstack((points, points[:1]))
    # on a fine grid: edges of layers above each other are the same but for rounding, which must not
    # separate faces
    grain = _GRAIN * float(np.ptp(points, axis=0).max())
    edges = shapely.union_all(shapely.linestrings(np.stack((ring[:-1], ring[1:]), axis=1)), grid_size=grain)
    faces = shapely.get_parts(shapely.polygonize([edges]))
    area = shapely.area(faces)
    real = area > _NO_AREA * area.sum()
    faces, area = faces[real], area[real]
    if not len(faces):
        return ()
    (x0, y0), (x1, y1) = ring[:-1].T, ring[1:].T
    px, py = (axis[:, None] for axis in shapely.get_coordinates(shapely.point_on_surface(faces)).T)
    left = (x1 - x0) * (py - y0) - (px - x0) * (y1 - y0)
    up, down = (y0 <= py) & (y1 > py) & (left > 0), (y0 > py) & (y1 <= py) & (left < 0)
    times = up.sum(axis=1) - down.sum(axis=1)
    middles = shapely.get_coordinates(shapely.centroid(faces))
    found = []
    for sense in (1, -1):
        inside = np.flatnonzero(sense * times > _POLE * np.abs(times).max())
        for region in shapely.get_parts(shapely.union_all(faces[inside])):
            own = inside[shapely.contains(region, shapely.point_on_surface(faces[inside]))]
            weight = area[own] * times[own] ** 2
            x, y = (weight @ middles[own] / weight.sum()).tolist()
            found.append((float(weight.sum()), Pole(x, y, turns_about(points, (x, y)))))
    most = max(weight for weight, _ in found)
    return tuple(pole for weight, pole in found if weight > 1e-3 * most)


def turns_about(points: FloatArray, place: tuple[float, float]) -> float:
    """Count the turns of a path (n, 2) about a place, anticlockwise."""
    about = points - np.array(place)
    a, b = about[:-1], about[1:]
    return float(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)).sum() / (2 * math.pi))
