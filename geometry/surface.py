"""Triangulated surfaces that carry coils, and points spread over them."""

from __future__ import annotations

import hashlib
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.compute.threads import ranges
from coilarray.errors import GeometryError, require_finite, require_positive, shown
from coilarray.geometry.copper import groups

if TYPE_CHECKING:
    import trimesh
    from scipy.spatial import cKDTree

FILES = (".stl", ".obj", ".ply", ".off")  # kinds of mesh files
MOST_COILS = 1000
Mirror = Literal["x", "y"]  # axis across a mirror plane through the origin
_FROM, _TO = 1e-3, 10.0  # m: sizes of a surface whose unit is right
_MOST_FACES = 500_000
_SECTIONS, _RINGS = 72, 18  # of a dome: chords lie 1e-3 of its radius below it
_A_COIL, _SAMPLES = 400, 40_000  # samples of the surface for each coil, and at most
_POINTS_AT_ONCE = 1000
_LONGEST = 0.07  # of a surface's size: side of a triangle that is searched as one
_PICOMETRE_DIGITS = 12  # of a place in m
_STEPS, _FURTHER, _STILL = 300, 1.6, 3e-4  # of the relaxation: over-relaxed, until steps of the mean distance
_EQUAL = 1e-6  # of a distance: the first of such samples is taken, so that rounding makes no other choice
_BORDER = 0.02  # of a coil's samples on its border with a neighbour, at least
_SIZE = 1e3
_FLAT = 1e-9  # of the squared size: area of a face that has no normal


@dataclass(frozen=True, eq=False)
class Surface:
    """Surface of triangles, closed or with a rim.

    Its normals point outwards, away from the inside of a closed surface, and from the middle of an
    open one. The corners of the triangles are `vertices` (n, 3) in m, and `faces` (m, 3) the
    numbers of the corners of every triangle. `dome_sizes` are radii and skirt in m from which
    `dome` made the surface: a hint for design files, as `file`, from which `read` has it, and its
    `unit` in m.

    Raises GeometryError for no triangles or too many, numbers that are not finite, a size outside 1
    mm to 10 m, which a wrong unit makes, several pieces, an edge of more than two triangles,
    triangles of opposite orientation beside each other, or a closed surface without a volume.

    >>> finger = Surface.dome((8e-3, 8e-3, 8e-3), skirt=12e-3)
    >>> finger.area / (2 * math.pi * 8e-3 * (8e-3 + 12e-3)) > 0.998
    True
    """

    vertices: FloatArray
    faces: IntArray
    dome_sizes: tuple[float, ...] | None = None
    file: str | None = None
    unit: float = 1e-3

    def __post_init__(self) -> None:
        import trimesh  # slow to import

        try:
            points = np.asarray(self.vertices, dtype=np.float64)
            corners = np.asarray(self.faces, dtype=np.int64)
        except (TypeError, ValueError):
            raise GeometryError("a surface must have vertices of three numbers and faces of three counts.") from None
        if points.ndim != 2 or points.shape[1:] != (3,) or corners.ndim != 2 or corners.shape[1:] != (3,):
            raise GeometryError(
                f"a surface must have vertices (n, 3) and faces (m, 3); got {points.shape} and {corners.shape}."
            )
        if not 0 < len(corners) <= _MOST_FACES:
            raise GeometryError(f"a surface must have 1 to {_MOST_FACES} triangles; got {len(corners)}.")
        if corners.min() < 0 or corners.max() >= len(points):
            raise GeometryError(f"faces of a surface must name its {len(points)} vertices; got {corners.max()}.")
        points = points[np.unique(corners)] if not np.isfinite(points).all() else points
        if not np.isfinite(points).all():
            raise GeometryError("vertices of a surface must be finite; at least one is not.")
        size = float(np.ptp(points, axis=0).max())
        if not _FROM <= size <= _TO:
            raise GeometryError(
                f"a surface must be {_FROM * 1e3:g} mm to {_TO:g} m wide; got {size * 1e3:.4g} mm: is its unit right?"
            )
        # trimesh compares lengths, areas and volumes with constants that suit a size of a thousand
        scale = _SIZE / size
        mesh = trimesh.Trimesh(scale * points, corners, process=True)
        mesh.update_faces(mesh.area_faces > _FLAT * _SIZE**2)
        mesh.update_faces(mesh.unique_faces())
        mesh.remove_unreferenced_vertices()
        _check(mesh)
        if _volume(mesh) < 0:
            mesh.invert()
        for key, array in (("vertices", mesh.vertices / scale), ("faces", mesh.faces)):
            plain = np.array(array)
            plain.setflags(write=False)
            object.__setattr__(self, key, plain)

    @classmethod
    def read(cls, path: Path, unit: float = 1e-3) -> Surface:
        """Read a mesh file at a `path`, of a kind in `FILES`.

        Mesh files do not name the `unit` of their lengths, here in m.
        """
        import trimesh

        require_positive("unit of a surface", unit)
        if path.suffix.lower() not in FILES:
            raise GeometryError(f"surface must be a file {', '.join(FILES)}; got {shown(path.name)}.")
        try:
            content = path.read_bytes()
        except OSError as error:
            raise GeometryError(f"cannot read the surface {shown(path.name)}: {error.strerror}.") from None
        try:
            mesh = trimesh.load_mesh(io.BytesIO(content), file_type=path.suffix[1:].lower())
            vertices, faces = np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces)
        except Exception:  # which readers of damaged files raise of every kind
            raise GeometryError(f"{shown(path.name)} is not a mesh that can be read.") from None
        if not len(faces):
            raise GeometryError(f"{shown(path.name)} has no triangles.")
        return cls(unit * vertices, faces, file=str(path), unit=unit)

    @classmethod
    def dome(cls, radii: Sequence[float], skirt: float = 0.0) -> Surface:
        """Return half an ellipsoid on an elliptic cylinder: a fingertip, or a helmet.

        The ellipsoid's centre is the origin and its upper half points along z. `radii` are its half
        axes along x, y and z in m, and the cylinder, open below, goes down by `skirt` in m.
        """
        if len(radii) != 3:
            raise GeometryError(f"radii of a dome must be three; got {len(radii)}.")
        for radius in radii:
            require_positive("radii of a dome", radius, " mm")
        require_finite("skirt of a dome", skirt)
        if skirt < 0:
            raise GeometryError(f"skirt of a dome must not be negative; got {skirt * 1e3:g} mm.")
        angle = np.linspace(0.0, math.pi / 2, _RINGS + 1)
        profile = np.column_stack((np.sin(angle), radii[2] * np.cos(angle)))
        profile[[0, -1]] = (0.0, radii[2]), (1.0, 0.0)
        down = np.linspace(0.0, -skirt, 1 + math.ceil(skirt / (max(radii) * math.pi / 2 / _RINGS)))[1:]
        profile = np.vstack((profile, np.column_stack((np.ones(len(down)), down))))
        turn, along = 2 * np.pi * np.arange(_SECTIONS) / _SECTIONS, np.arange(1, _SECTIONS + 1)
        rings = [np.column_stack((r * np.cos(turn), r * np.sin(turn), 0 * turn + z)) for r, z in profile[1:].tolist()]
        following = np.roll(along, -1)
        faces = [np.column_stack((0 * along, along, following))]
        for above in range(0, _SECTIONS * (len(rings) - 1), _SECTIONS):
            a, b, c, d = above + along, above + following, above + _SECTIONS + along, above + _SECTIONS + following
            faces += [np.column_stack((a, c, d)), np.column_stack((a, d, b))]
        vertices = np.vstack((profile[:1, [0, 0, 1]], *rings)) * (radii[0], radii[1], 1.0)
        return cls(vertices, np.vstack(faces), (*map(float, radii), float(skirt)))

    @cached_property
    def area(self) -> float:
        """Area in m²."""
        a, b, c = np.moveaxis(self._triangles[0], 1, 0)
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    @cached_property
    def normals(self) -> FloatArray:
        """Dimensionless unit normals at the vertices, shape (n, 3)."""
        import trimesh

        scale = _SIZE / np.ptp(self.vertices, axis=0).max()
        return np.array(trimesh.Trimesh(scale * self.vertices, self.faces, process=False).vertex_normals)

    def nearest(self, points: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Find the nearest points (n, 3) of the surface in m to `points` (n, 3), and unit normals (n, 3).

        Normals are interpolated between those of the vertices.
        """
        import trimesh

        triangles: Any = trimesh.triangles  # trimesh is typed in part only
        given = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        corners, middles, radii, whole = self._triangles
        places, face = np.empty_like(given), np.empty(len(given), dtype=np.int64)
        for start, stop in ranges(len(given), _POINTS_AT_ONCE):
            some = given[start:stop]
            apart, first = self._tree.query(some)
            within = self._tree.query_ball_point(some, apart + radii[first] + radii.max())
            one = np.repeat(np.arange(len(some)), [len(faces) for faces in within])
            other = np.concatenate([np.asarray(faces, dtype=np.int64) for faces in within])
            size, middle = radii[other, None], middles[other]
            unit = (corners[other] - middle[:, None]) / size[:, None]
            near = size * triangles.closest_point(unit, (some[one] - middle) / size) + middle
            away = np.linalg.norm(near - some[one], axis=1)
            order = np.lexsort((away, one))
            best = order[np.unique(one[order], return_index=True)[1]]
            places[start:stop], face[start:stop] = near[best], other[best]
        around = self.vertices[self.faces[whole[face]]]
        size = np.ptp(around, axis=1).max(axis=1, keepdims=True)
        weights = triangles.points_to_barycentric((around - places[:, None]) / size[:, None], np.zeros_like(places))
        normals = (weights[:, :, None] * self.normals[self.faces[whole[face]]]).sum(axis=1)
        return places, normals / np.linalg.norm(normals, axis=1, keepdims=True)

    def samples(self, count: int) -> FloatArray:
        """Return about `count` points (m, 3) in m, evenly over the area."""
        import trimesh

        edge = math.sqrt(4 / math.sqrt(3) * self.area / count)
        remesh: Any = trimesh.remesh  # trimesh is typed in part only
        vertices, faces = remesh.subdivide_to_size(self.vertices, self.faces, 1.4 * edge, max_iter=20)
        corners = vertices[faces]
        a, b, c = np.moveaxis(corners, 1, 0)
        weight = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
        middle = (np.arange(count) + 0.5) / count * weight[-1]
        return np.asarray(corners[np.searchsorted(weight, middle)].mean(axis=1))

    @cached_property
    def digest(self) -> str:
        """Hexadecimal SHA-256 of the triangles, their corners to 1 pm."""
        corners = np.round(self.vertices, _PICOMETRE_DIGITS) + 0.0
        return hashlib.sha256(corners.tobytes() + self.faces.tobytes()).hexdigest()

    @cached_property
    def _tree(self) -> cKDTree:
        """Middles of the triangles for searches."""
        from scipy.spatial import cKDTree

        return cKDTree(self._triangles[1])

    @cached_property
    def _triangles(self) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        """Parts of the triangles that are small beside the surface.

        Their corners (m, 3, 3), middles (m, 3) and distances (m,) of the corners from them, in m,
        and the triangles that they are of.
        """
        import trimesh

        remesh: Any = trimesh.remesh  # trimesh is typed in part only
        longest = _LONGEST * float(np.ptp(self.vertices, axis=0).max())
        vertices, faces, whole = remesh.subdivide_to_size(
            self.vertices, self.faces, longest, max_iter=20, return_index=True
        )
        corners = vertices[faces]
        middles = corners.mean(axis=1)
        # a millionth more, for the rounding of distances
        radii = (1 + 1e-6) * np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
        return corners, middles, radii, np.asarray(whole)


def _check(mesh: trimesh.Trimesh) -> None:
    """Raise GeometryError unless a mesh is one surface with two sides."""
    if not len(mesh.faces):
        raise GeometryError("a surface must have an area; all of its triangles are flat.")
    of_edge = np.unique(np.sort(mesh.edges, axis=1), axis=0, return_counts=True)[1]
    if (of_edge > 2).any():
        raise GeometryError(
            f"edges of a surface must have two triangles at most; {np.count_nonzero(of_edge > 2)} edges have more."
        )
    if not mesh.is_winding_consistent:
        raise GeometryError("triangles of a surface must have one orientation; some beside each other are turned over.")
    pieces = len(set(groups(len(mesh.vertices), mesh.edges)))
    if pieces > 1:
        raise GeometryError(f"a surface must be of one piece; got {pieces}.")
    if mesh.is_watertight and abs(_volume(mesh)) < _FLAT * mesh.area * mesh.scale:
        raise GeometryError("a closed surface must have a volume; got one that is folded flat.")


def _volume(mesh: trimesh.Trimesh) -> float:
    """Volume between a mesh and its middle, positive if normals point outwards."""
    from_middle = mesh.triangles_center - np.average(mesh.triangles_center, axis=0, weights=mesh.area_faces)
    return float((mesh.area_faces * (mesh.face_normals * from_middle).sum(axis=1)).sum() / 3)


def spread(surface: Surface, count: int, mirror: Mirror | None = None) -> FloatArray:
    """Spread points evenly over a surface.

    Every point is where it has the least mean squared distance to its part of the surface, the part
    that is nearer to it than to the other points (Lloyd's method). The first points are those
    farthest from all before, so that the same surface always has the same points. On a sphere 12
    points are the corners of an icosahedron to 1°.

    The `surface` must be thicker than the distance of neighbours. The `count` of points is 1 to
    1000. `mirror` is the axis across a plane through the origin at which surface and points are
    mirrored, if any. The result has the shape (count, 3) and is in m. Raises GeometryError for a
    wrong number, or a surface that is not on both sides of the mirror.

    >>> helmet = Surface.dome((97e-3, 117e-3, 100e-3), skirt=50e-3)
    >>> spread(helmet, 8, mirror="x").shape
    (8, 3)
    """
    if not isinstance(count, (int, np.integer)) or isinstance(count, bool) or not 1 <= count <= MOST_COILS:
        raise GeometryError(f"count of points on a surface must be a whole number, 1 to {MOST_COILS}; got {count!r}.")
    if mirror is not None and mirror not in get_args(Mirror):
        raise GeometryError(f"mirror must be one of {', '.join(get_args(Mirror))}; got {mirror!r}.")
    samples = surface.samples(min(_A_COIL * count, _SAMPLES))
    if mirror is None:
        return _relaxed(surface, samples, _farthest(samples, [], count), None)[0]
    axis = get_args(Mirror).index(mirror)
    turned = np.where(np.arange(3) == axis, -1.0, 1.0)
    samples = samples[samples[:, axis] > 0]
    if not len(samples) or surface.vertices[:, axis].min() >= 0:
        raise GeometryError(f"a surface must be on both sides of the mirror, {mirror} = 0.")
    spacing = math.sqrt(surface.area / count)
    line = samples[samples[:, axis] < spacing / 4] * np.where(np.arange(3) == axis, 0.0, 1.0)
    found = []
    # as many points on the mirror as give the least mean distance
    for single in range(count % 2, min(count, 2 + math.ceil(2 * math.sqrt(count))) + 1, 2):
        if single and not len(line):
            continue
        on_line = _farthest(line, [], single)
        away = _farthest(samples[samples[:, axis] > spacing / 4], list(on_line), (count - single) // 2)
        start = np.vstack((on_line.reshape(-1, 3), away.reshape(-1, 3), away.reshape(-1, 3) * turned))
        found.append(_relaxed(surface, np.vstack((samples, samples * turned)), start, (axis, single)))
    return min(found, key=lambda one: round(one[1] / spacing**2, 6))[0]


def _farthest(samples: FloatArray, points: list[FloatArray], count: int) -> FloatArray:
    """Choose samples (count, 3) farthest from all points before, at first from their middle."""
    least = np.linalg.norm(samples[:, None] - points, axis=2).min(axis=1) if points else None
    found: list[FloatArray] = []
    for _ in range(count):
        from_middle = -np.linalg.norm(samples - samples.mean(axis=0), axis=1) if least is None else least
        best = from_middle.max()
        chosen = samples[int(np.flatnonzero(from_middle >= best - _EQUAL * abs(best))[0])]
        found.append(chosen)
        apart = np.linalg.norm(samples - chosen, axis=1)
        least = apart if least is None else np.minimum(least, apart)
    return np.array(found).reshape(-1, 3)


def _relaxed(
    surface: Surface, samples: FloatArray, points: FloatArray, mirror: tuple[int, int] | None
) -> tuple[FloatArray, float]:
    """Relax points and return them with their mean squared distance in m²."""
    from scipy.spatial import cKDTree

    def mirrored(points: FloatArray) -> FloatArray:
        if mirror is not None:
            axis, single = mirror
            half = (len(points) - single) // 2
            points[:single, axis] = 0.0
            points[single + half :] = points[single : single + half] * np.where(np.arange(3) == axis, -1.0, 1.0)
        return points

    for _ in range(_STEPS):
        owner = cKDTree(points).query(samples)[1]
        held = np.bincount(owner, minlength=len(points))
        sums = np.column_stack([np.bincount(owner, samples[:, k], len(points)) for k in range(3)])
        middle = np.where(held[:, None] > 0, sums / np.maximum(held, 1)[:, None], points)
        moved = mirrored(points + _FURTHER * (middle - points))
        still = np.linalg.norm(moved - points, axis=1).max() < _STILL * math.sqrt(surface.area / len(points))
        points = moved
        if still:
            break
    mean = float(np.mean(np.square(cKDTree(points).query(samples)[0])))
    return mirrored(surface.nearest(points)[0]), mean


def neighbours(surface: Surface, points: FloatArray) -> tuple[tuple[int, int], ...]:
    """Pairs i < k of points (n, 3) in m whose parts of a surface have a common border.

    A part is what is nearer to a point than to all others. Borders shorter than about a tenth of a
    part's width do not count.
    """
    from scipy.spatial import cKDTree

    if len(points) < 2:
        return ()
    two = np.sort(cKDTree(points).query(surface.samples(min(4 * _A_COIL * len(points), _SAMPLES)), k=2)[1], axis=1)
    pairs, held = np.unique(two, axis=0, return_counts=True)
    near = held > _BORDER * held.sum() / len(points)
    return tuple((int(i), int(k)) for i, k in pairs[near].tolist())
