"""Wire coils in space: solenoids, saddles, pairs, toroids and twisted wires.

A round wire is a bar of square section with the same geometric mean distance of itself, and hence
the same inductance, and with the wire's area for its resistance. Turns are regular polygons of the
circle's area.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.compute.arrays import FloatArray
from coilarray.errors import GeometryError, require_positive
from coilarray.geometry.conductor import Conductor
from coilarray.geometry.pose import Pose

SEGMENTS = 72
"""Segments of a whole turn, by default.

L of a ring is right to 6e-4 for wires below a tenth of its radius. Turns that touch are
right to 2e-3 of L, and M of wires below a twentieth of the radius, three diameters or more apart,
to 2e-4 of the larger L.
"""
# Geometric mean distance of a circle from itself over its diameter, and of a square over its side.
_ROUND, _SQUARE = 0.5 * math.exp(-0.25), 0.4470491559
_COUNTS = ("turns", "segments")
_MOST = 1e5  # turns, and segments of a turn
_CLOSED = 1e-9  # of a profile's size; a first and last point that are nearer are one


def helix(
    profile: npt.ArrayLike, turns: float, pitch: float, wire: float, *, segments: int = SEGMENTS, name: str = "helix"
) -> Conductor:
    """Wind a wire on a prism of any closed profile.

    The corners of the `profile`, shape (n, 2), are of the middle of the wire in m, seen along the
    axis z. Counter-clockwise ones give a current that circles counter-clockwise while it rises. The
    `pitch` in m is the rise of a turn, and the path runs from z = −turns·pitch/2 to turns·pitch/2.
    A turn has at least as many `segments`. `wire` and `name` are as in `solenoid`. Raises
    GeometryError for a profile that crosses itself, or values that are not positive and finite.

    >>> frame = helix([(-5e-3, -2e-3), (5e-3, -2e-3), (5e-3, 2e-3), (-5e-3, 2e-3)], turns=3, pitch=1e-3, wire=0.5e-3)
    >>> round(float(frame.lengths.sum()) * 1e3, 1)
    84.1
    """
    try:
        corners = np.asarray(profile, dtype=np.float64)
    except (TypeError, ValueError):
        raise GeometryError(f"profile of {name} must be points x, y; got {profile!r:.60}.") from None
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3 or not np.isfinite(corners).all():
        raise GeometryError(f"profile of {name} must be three or more finite points x, y; got shape {corners.shape}.")
    if np.linalg.norm(corners[0] - corners[-1]) <= _CLOSED * np.ptp(corners, axis=0).max():
        corners = corners[:-1]
    if not shapely.LinearRing(corners).is_simple:
        raise GeometryError(f"profile of {name} must not cross itself.")
    _require(name, turns=turns, pitch=pitch, wire=wire, segments=segments)
    if turns < 1 / segments:
        raise GeometryError(f"turns of {name} must be at least one segment, {1 / segments:.3g}; got {turns:g}.")
    corners = np.vstack((corners, corners[:1]))
    sides = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    pieces = np.maximum(1, np.round(segments * sides / sides.sum()))
    number = np.concatenate([k + np.arange(n) / n for k, n in enumerate(pieces.tolist())])
    once = np.interp(number, np.arange(len(corners)), np.append(0.0, np.cumsum(sides))) / sides.sum()
    at = (np.arange(math.ceil(turns))[:, None] + once).ravel()
    at = np.append(at[at < turns - _CLOSED], turns)
    corner = np.interp(at % 1.0, np.append(once, 1.0), np.append(number, len(sides)))
    xy = [np.interp(corner, np.arange(len(corners)), corners[:, axis]) for axis in (0, 1)]
    points = np.column_stack((*xy, (at - turns / 2) * pitch))
    return _wire(points, wire, name)


def solenoid(
    diameter: float, length: float, turns: float, wire: float, *, segments: int = SEGMENTS, name: str = "solenoid"
) -> Conductor:
    """Wind a wire on a round cylinder along z.

    The `diameter` of the winding in m is from middle to middle of the wire, its `length` in m is
    `turns` times its pitch, and its middle is the origin. The diameter of the `wire` is in m. A
    turn has as many `segments`. `name` is that of the path. Raises GeometryError for values that
    are not positive and finite, or a wire that does not fit between the turns.

    >>> from coilarray import self_inductance
    >>> coil = solenoid(diameter=20e-3, length=40e-3, turns=40, wire=0.5e-3)
    >>> round(float(self_inductance(coil)[0]) * 1e6, 2)
    12.84
    """
    _require(name, diameter=diameter, length=length, turns=turns, wire=wire, segments=segments)
    if turns > 1 and wire > length / turns:
        raise GeometryError(f"wire of {name} must fit the pitch of {length / turns * 1e3:g} mm; got {wire * 1e3:g} mm.")
    return helix(_circle(diameter / 2, segments), turns, length / turns, wire, segments=segments, name=name)


def saddle(
    radius: float, length: float, angle: float, wire: float, *, segments: int = SEGMENTS, name: str = "saddle"
) -> Conductor:
    """Bend a rectangular loop about a cylinder along z.

    The cylinder has a `radius` in m. The straight sides have a `length` in m, the arcs an `angle`
    in rad, below 2π, with their middle on +x. The closed path is counter-clockwise seen from
    outside, so that its field points along +x. `wire`, `name` and errors are as in `solenoid`, and
    a whole circle has as many `segments`.

    Two saddles, one turned by π about z with its current reversed, have a homogeneous field along x
    if `angle` is 2π/3 and `length` is four radii (Ginsberg & Melchner, Rev. Sci. Instrum. 41, 122,
    1970).

    >>> import math
    >>> loop = saddle(radius=10e-3, length=40e-3, angle=2 * math.pi / 3, wire=1e-3)
    >>> round(float(loop.lengths.sum()) * 1e3, 1)
    121.9
    """
    _require(name, radius=radius, length=length, angle=angle, wire=wire, segments=segments)
    if angle >= 2 * math.pi:
        raise GeometryError(f"angle of {name} must be below 2π; got {angle:g} rad.")
    count = max(2, round(segments * angle / (2 * math.pi)))
    turn = np.linspace(-angle / 2, angle / 2, count + 1)
    arc = radius * np.column_stack((np.cos(turn), np.sin(turn)))
    lower = np.column_stack((arc, np.full(len(arc), -length / 2)))
    upper = np.column_stack((arc[::-1], np.full(len(arc), length / 2)))
    return _wire(np.vstack((lower, upper, lower[:1])), wire, name)


def loop_pair(
    radius: float,
    distance: float,
    wire: float,
    turns: int = 1,
    *,
    opposed: bool = False,
    segments: int = SEGMENTS,
    name: str = "pair",
) -> tuple[Conductor, Conductor]:
    """Place two equal round coils on the axis z.

    The upper and the lower coil of a `radius` in m have their middles at a `distance` in m. The
    `turns` of each are wound side by side. If `opposed`, the current of the lower coil is reversed.
    `wire` and `segments` are as in `solenoid`, and the names are `name` with "/upper" and "/lower".
    Raises GeometryError for values that are not positive and finite, or coils that meet.
    """
    _require(name, radius=radius, distance=distance, wire=wire, turns=turns, segments=segments)
    _require_whole(name, turns)
    if turns * wire >= distance:
        raise GeometryError(
            f"coils of {name} must not meet: {turns} turns of {wire * 1e3:g} mm are wider than the distance of "
            f"{distance * 1e3:g} mm."
        )
    if turns == 1:
        ring = np.column_stack((_circle(radius, segments), np.zeros(segments + 1)))
        coil = _wire(ring, wire, name)
    else:
        coil = helix(_circle(radius, segments), turns, wire, wire, segments=segments, name=name)
    upper = coil.posed(Pose(z=distance / 2), f"{name}/upper")
    # mirrored at the plane z = 0, as a helix turned over would start elsewhere
    down = coil.vertices * (1.0, 1.0, -1.0) - (0.0, 0.0, distance / 2)
    lower = _wire(down[::-1] if opposed else down, wire, f"{name}/lower")
    return upper, lower


def helmholtz_pair(
    radius: float, wire: float, turns: int = 1, *, segments: int = SEGMENTS, name: str = "helmholtz"
) -> tuple[Conductor, Conductor]:
    """Place two coils a radius apart, for a homogeneous field.

    At their middle the field is (4/5)^(3/2) µ0 N I/R, and its second derivative is zero. The
    `radius` R in m, the diameter of the `wire` in m, the number N of `turns`, `segments`, `name`,
    result and errors are as in `loop_pair`.

    >>> from coilarray import magnetic_field
    >>> pair = helmholtz_pair(radius=50e-3, wire=1e-3)
    >>> round(float(magnetic_field(pair, [[0, 0, 0]], [1.0, 1.0])[0, 2]) * 1e6, 2)
    17.98
    """
    return loop_pair(radius, radius, wire, turns, segments=segments, name=name)


def maxwell_pair(
    radius: float, wire: float, turns: int = 1, *, segments: int = SEGMENTS, name: str = "maxwell"
) -> tuple[Conductor, Conductor]:
    """Place two opposed coils √3 radii apart, for an even gradient.

    At their middle dBz/dz is 48/49 √(3/7) µ0 N I/R², and its second derivative is zero. The
    `radius` R in m, the diameter of the `wire` in m, the number N of `turns`, `segments`, `name`,
    result and errors are as in `loop_pair`.
    """
    return loop_pair(radius, math.sqrt(3) * radius, wire, turns, opposed=True, segments=segments, name=name)


def toroid(
    radius: float, section_radius: float, turns: int, wire: float, *, segments: int = 36, name: str = "toroid"
) -> Conductor:
    """Wind a wire on a ring about z, whose ends meet.

    The inductance of a current sheet in its place is µ0 N² (R − √(R² − a²)). The field between
    separate turns and the loop of the ring itself add some percent. The `radius` R of the ring's
    middle and the `section_radius` a of the turns are in m, N is the number of `turns`. `wire`,
    `segments` and `name` are as in `solenoid`. Raises GeometryError for values that are not
    positive and finite, turns as large as the ring, or a wire that does not fit inside the ring.
    """
    return _wire(_toroid(radius, section_radius, turns, wire, segments, name), wire, name)


def rogowski(
    radius: float, section_radius: float, turns: int, wire: float, *, segments: int = 36, name: str = "rogowski"
) -> Conductor:
    """Wind a wire on a ring and lead it back within the turns.

    The way back along the ring's middle removes the loop of the ring itself, so that only currents
    through the ring induce a voltage: M = µ0 N (R − √(R² − a²)). The `radius` R and
    `section_radius` a in m, the number N of `turns`, the diameter of the `wire` in m, `segments`,
    `name` and errors are as in `toroid`.
    """
    points = _toroid(radius, section_radius, turns, wire, segments, name)
    back = np.linspace(2 * np.pi, 0.0, max(turns, SEGMENTS) + 1)[1:-1]
    middle = radius * np.column_stack((np.cos(back), np.sin(back), 0 * back))
    return _wire(np.vstack((points, middle)), wire, name)


def twisted_pair(
    length: float, distance: float, pitch: float, wire: float, *, segments: int = 36, name: str = "twisted"
) -> tuple[Conductor, Conductor]:
    """Twist two wires about the axis z, the second leading back.

    The pair has a `length` in m from the origin upwards, and a whole turn a `pitch` in m. The
    middles of the wires are at a `distance` in m. A whole turn has as many `segments`. `wire` is as
    in `solenoid`, and the names are `name` with "/go" and "/return". Raises GeometryError for
    values that are not positive and finite, or wires that overlap.
    """
    _require(name, length=length, distance=distance, pitch=pitch, wire=wire, segments=segments)
    if wire > distance:
        raise GeometryError(f"wires of {name} must not overlap: {wire * 1e3:g} mm at {distance * 1e3:g} mm.")
    if length / pitch > _MOST:
        raise GeometryError(f"length over pitch of {name} must be at most {_MOST:g}; got {length / pitch:g}.")
    count = max(2, math.ceil(segments * length / pitch))
    z = np.linspace(0.0, length, count + 1)
    turn = 2 * np.pi * z / pitch
    go = np.column_stack((distance / 2 * np.cos(turn), distance / 2 * np.sin(turn), z))
    back = (go * (-1.0, -1.0, 1.0))[::-1]
    return _wire(go, wire, f"{name}/go"), _wire(back, wire, f"{name}/return")


def _toroid(radius: float, section_radius: float, turns: int, wire: float, segments: int, name: str) -> FloatArray:
    """Points of a toroid that ends where it starts."""
    _require(name, radius=radius, section_radius=section_radius, turns=turns, wire=wire, segments=segments)
    _require_whole(name, turns)
    inner = radius - section_radius
    if inner <= wire / 2 or 2 * math.pi * inner < turns * wire:
        raise GeometryError(
            f"{name} must have room for {turns} turns of {wire * 1e3:g} mm inside its ring; its inner radius is "
            f"{inner * 1e3:g} mm."
        )
    circle = _circle(section_radius, segments)
    outwards, down = np.vstack((np.tile(circle[:-1], (int(turns), 1)), circle[:1])).T
    along = 2 * np.pi * np.arange(len(outwards)) / (turns * segments)
    points = np.column_stack(((radius + outwards) * np.cos(along), (radius + outwards) * np.sin(along), -down))
    points[-1] = points[0]
    return points


def _circle(radius: float, segments: int) -> FloatArray:
    """Return a closed regular polygon of a circle's area, counter-clockwise from +x."""
    turn = 2 * np.pi * np.arange(segments + 1) / segments
    grown = radius * math.sqrt(2 * math.pi / segments / math.sin(2 * math.pi / segments))
    circle = grown * np.column_stack((np.cos(turn), np.sin(turn)))
    circle[-1] = circle[0]
    return circle


def _wire(points: FloatArray, wire: float, name: str) -> Conductor:
    """Path of a round wire, its bars' sides carried along without a twist."""
    side = wire * _ROUND / _SQUARE
    along = np.diff(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.empty_like(along)
    least = int(np.argmin(np.abs(along[0])))
    previous = np.cross(along[0], np.eye(3)[least])
    for k, direction in enumerate(along):
        previous = previous - (previous @ direction) * direction
        previous /= np.linalg.norm(previous)
        across[k] = previous
    return Conductor(points, side, side, math.pi / 4 * wire**2, name, across)


def _require(name: str, **values: float) -> None:
    """Raise GeometryError unless all values are positive and finite, and counts whole and not too many."""
    for key, value in values.items():
        if not isinstance(value, (int, float, np.integer, np.floating)):
            raise GeometryError(f"{key} of {name} must be a number; got {value!r:.60}.")
        require_positive(f"{key} of {name}", value, "" if key in _COUNTS else " m")
        if key in _COUNTS and value > _MOST:
            raise GeometryError(f"{key} of {name} must be at most {_MOST:g}; got {value:g}.")
        if key == "segments" and (value < 3 or value != int(value)):
            raise GeometryError(f"segments of {name} must be a whole number, at least 3; got {value:g}.")


def _require_whole(name: str, turns: float) -> None:
    if turns != int(turns):
        raise GeometryError(f"turns of {name} must be a whole number; got {turns:g}.")
