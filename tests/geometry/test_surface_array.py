"""Surfaces, points spread over them, and coils on them, against spheres, cylinders and tilted circles."""

import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from support.refusals import refused

from coilarray import coupling_matrix, inductance_matrix, self_inductance
from coilarray.constants import MU_0
from coilarray.errors import GeometryError
from coilarray.geometry import (
    Array,
    PlatedHole,
    Pose,
    RoundedSpiral,
    Spiral,
    Stackup,
    path_coil,
    solids,
)
from coilarray.geometry.rules import FabRules, check_rules
from coilarray.geometry.surface import Surface, neighbours, spread
from coilarray.geometry.surface_array import SurfaceLattice, Wrap, levels, resized, sizes_by_distance

STRIP = Stackup(("L1",), (35e-6,), (), ())
LOOP = RoundedSpiral(20e-3, 20e-3, 1, 0.2e-3, 0.2e-3, corner_radius=10e-3, layers=1, leads=None)


def ball(radius, fineness=4, pose=None):
    """Sphere about the origin, its triangles' corners on it."""
    mesh = trimesh.creation.icosphere(fineness, radius)
    return Surface(mesh.vertices if pose is None else pose.apply(mesh.vertices), mesh.faces)


def circle(radius, width=0.1e-3, sides=120):
    """A circular coil with a gap of 0.1° at its start, whose turn has the area of the circle."""
    turn = np.linspace(np.radians(0.05), 2 * np.pi - np.radians(0.05), sides + 1)
    grown = radius * (1 + math.pi**2 / 3 / sides**2)
    return path_coil([grown * np.column_stack((np.cos(turn), np.sin(turn)))], width, width, PlatedHole(1e-4, 2e-4))


def tilted_circles(a, b, centre, normal, n=400):
    """Mutual inductance of two circular filaments by the trapezoidal rule in both angles (spectral)."""
    t = 2 * np.pi * np.arange(n) / n
    first = a * np.column_stack((np.cos(t), np.sin(t), 0 * t))
    u = np.cross([0.0, 1.0, 0.0] if abs(normal[1]) < 0.9 else [1.0, 0.0, 0.0], normal)
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    second = centre + b * (np.cos(t)[:, None] * u + np.sin(t)[:, None] * v)
    along = a * np.column_stack((-np.sin(t), np.cos(t), 0 * t))
    there = b * (-np.sin(t)[:, None] * u + np.cos(t)[:, None] * v)
    apart = np.linalg.norm(first[:, None] - second, axis=2)
    return MU_0 / (4 * np.pi) * (2 * np.pi / n) ** 2 * ((along @ there.T) / apart).sum()


def angles(points):
    unit = points / np.linalg.norm(points, axis=1, keepdims=True)
    return np.degrees(np.arccos(np.clip(unit @ unit.T, -1, 1)))


def test_twelve_points_are_an_icosahedron():
    """Icosahedron: 63.43° between neighbours. 400 samples a point place it to about a degree."""
    points = spread(ball(0.1), 12)
    apart = angles(points) + 999 * np.eye(12)
    np.testing.assert_allclose(apart.min(axis=1), math.degrees(math.acos(1 / math.sqrt(5))), atol=1.5)
    assert len(neighbours(ball(0.1), points)) == 30
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 0.1, rtol=1e-3)  # on chords of its triangles


@pytest.mark.parametrize(("count", "angle"), [(2, 180.0), (4, 109.47), (6, 90.0)])
def test_few_points_are_regular(count, angle):
    apart = angles(spread(ball(0.1), count)) + 999 * np.eye(count)
    np.testing.assert_allclose(apart.min(axis=1), angle, atol=3)


def test_mirror():
    helmet = Surface.dome((97e-3, 117e-3, 100e-3), skirt=50e-3)
    points = spread(helmet, 8, "x")
    turned = points * (-1, 1, 1)
    assert np.linalg.norm(turned[:, None] - points, axis=2).min(axis=1).max() < 1e-12
    np.testing.assert_array_equal(points, spread(helmet, 8, "x"))


def test_points_turn_with_the_surface():
    """To a sample of the surface, which rounding may give to another point."""
    shape = Surface.dome((30e-3, 40e-3, 25e-3), skirt=10e-3)
    pose = Pose(0.1, 0.2, -0.3, (0.3, 1.1, -2.0))
    turned = Surface(pose.apply(shape.vertices), shape.faces)
    np.testing.assert_allclose(spread(turned, 9), pose.apply(spread(shape, 9)), atol=0.2e-3)


@pytest.mark.lowest
def test_dome():
    """Area of a hemisphere and its cylinder, less the chords' share, and normals outwards."""
    finger = Surface.dome((8e-3, 8e-3, 8e-3), skirt=12e-3)
    assert finger.area == pytest.approx(2 * math.pi * 8e-3 * 20e-3, rel=2e-3)
    assert ((finger.normals * finger.vertices).sum(axis=1) > 0).all()
    inwards = Surface(finger.vertices, finger.faces[:, ::-1])
    np.testing.assert_allclose(inwards.normals, finger.normals, atol=1e-12)


def test_nearest_points_of_a_sphere():
    """Near and far, inside and outside. Triangles have sides of 4°, over which the nearest point may lie beside."""
    points = np.random.default_rng(1).normal(size=(200, 3)) * 0.1
    places, normals = ball(0.1).nearest(points)
    unit = points / np.linalg.norm(points, axis=1, keepdims=True)
    np.testing.assert_allclose(places, 0.1 * unit, atol=0.1 * 0.04)
    np.testing.assert_allclose(normals, unit, atol=0.04)
    corners = ball(0.1, 1)
    for point, place in zip(points[:20], corners.nearest(points[:20])[0], strict=True):
        each = trimesh.triangles.closest_point(corners.vertices[corners.faces], np.tile(point, (len(corners.faces), 1)))
        assert np.linalg.norm(place - point) == pytest.approx(np.linalg.norm(each - point, axis=1).min(), abs=1e-15)


def test_normals_and_upright_turn():
    sphere = ball(0.1)
    lattice = SurfaceLattice(sphere, spread(sphere, 12), ("L1",))
    for array, pose in lattice.boards(LOOP, STRIP):
        z = pose.rotation[:, 2]
        np.testing.assert_allclose(z, pose.shift / np.linalg.norm(pose.shift), atol=5e-3)
        assert pose.rotation[2, 1] >= 0  # y points up the slope
        assert abs(pose.rotation[2, 0]) < 1e-12  # x is level
        assert array.centres.tolist() == [[0.0, 0.0]]
        assert np.linalg.norm(pose.shift) == pytest.approx(0.1 + STRIP.thickness, rel=1.5e-3)


def test_published_tilted_circles():
    """Grover's example of two planes at 60°, as Babic et al. (IEEE Trans. Magn. 46, 3591, 2010) quote it."""
    normal = np.array([0.0, -math.sqrt(0.75), 0.5])
    assert tilted_circles(0.16, 0.1, np.array([0, 0.043301, 0.175]), normal) == pytest.approx(13.6113e-9, rel=1e-5)


@pytest.mark.parametrize("apart", [0.5, 0.9])
def test_two_loops_on_a_sphere(apart):
    """Loops of radius 20 mm, of thin wire, `apart` rad on a sphere of 100 mm, against tilted circles.

    Wire of 0.1 mm, the chords of 120 sides and the gap of 0.1° change M by some 1e-4 of L each.
    """
    sphere = ball(0.1, 5)
    points = sphere.nearest(0.1 * np.array([(0, 0, 1), (math.sin(apart), 0, math.cos(apart))]))[0]
    coil = circle(20e-3)
    paths = [a.conductors()[0].posed(pose) for a, pose in SurfaceLattice(sphere, points, ("L1",)).boards(coil, STRIP)]
    L = inductance_matrix(paths)
    height = 0.1 + STRIP.thickness / 2
    there = height * np.array([math.sin(apart), 0, math.cos(apart)]) - (0, 0, height)
    expected = tilted_circles(20e-3, 20e-3, there, np.array([math.sin(apart), 0, math.cos(apart)]))
    assert L[0, 1] == pytest.approx(expected, abs=1e-3 * abs(expected) + 2e-4 * L[0, 0])


def test_turned_surface_has_the_same_couplings():
    """About z, which is the upward direction: all frames turn with the surface."""
    shape = Surface.dome((30e-3, 40e-3, 25e-3), skirt=10e-3)
    pose = Pose(turn=(0.0, 0.0, 1.234))
    points = spread(shape, 5)
    turned = Surface(pose.apply(shape.vertices), shape.faces)
    found = []
    for surface, places in ((shape, points), (turned, pose.apply(points))):
        boards = SurfaceLattice(surface, places, ("L1",), np.full(5, 30e-3), wrapped=True).boards(LOOP, STRIP)
        found.append(inductance_matrix([a.conductors()[0].posed(at) for a, at in boards], allow_overlaps=True))
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-6 * found[0].max())


def test_wrapped_on_a_sphere_is_a_circle():
    """A point at r from the middle of the board goes along a normal, to the angle atan(r/R) on the sphere."""
    sphere = ball(0.1, 5)
    top = sphere.nearest([[0.0, 0.0, 0.1]])[0]
    ((array, pose),) = SurfaceLattice(sphere, top, ("L1",), wrapped=True).boards(circle(40e-3), STRIP)
    path = array.conductors()[0].posed(pose)
    height = 0.1 + STRIP.thickness / 2
    angle = math.atan(40e-3 / (0.1 + STRIP.thickness))
    np.testing.assert_allclose(np.hypot(*path.vertices[:, :2].T), height * math.sin(angle), rtol=2e-3)
    np.testing.assert_allclose(path.vertices[:, 2], height * math.cos(angle), rtol=2e-3)
    middles = (path.vertices[1:] + path.vertices[:-1]) / 2
    outwards = middles / np.linalg.norm(middles, axis=1, keepdims=True)
    assert np.abs((path.across * outwards).sum(axis=1)).max() < 5e-3  # widths are tangential


def test_wrapped_on_a_large_cylinder_is_flat():
    """The radius is 100 times the coil's: L changes by the square of that, times some 0.1."""
    wide = Surface.dome((1.0, 1.0, 0.1), skirt=2.0)
    place = wide.nearest([[1.0, 0.0, -1.0]])[0]
    flat, wrapped = (
        self_inductance(SurfaceLattice(wide, place, ("L1",), wrapped=how).boards(LOOP, STRIP)[0][0].conductors())[0]
        for how in (False, True)
    )
    assert wrapped == pytest.approx(flat, rel=2e-4)  # chords of the cylinder's triangles are 33 mm long


def test_beyond_a_rim_the_surface_goes_on():
    tube = Surface.dome((10e-3, 10e-3, 10e-3), skirt=10e-3)
    at_rim = tube.nearest([[10e-3, 0.0, -9e-3]])
    pose = Pose.of(np.column_stack(([0, 1, 0], [0, 0, 1], [1, 0, 0])), at_rim[0][0])
    below = pose.apply(Wrap(tube, pose).surface([[0.0, -4e-3, 0.0]]))[0]
    np.testing.assert_allclose(below, [10e-3, 0.0, -13e-3], atol=1e-5)


def test_overlapping_coils_differ_in_level():
    sphere = ball(0.1)
    points = spread(sphere, 12)
    found = np.array(levels(points, np.full(12, 60e-3)))
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    overlaps = (apart < 0.12) & ~np.eye(12, dtype=bool)
    assert overlaps.sum() == 60  # five neighbours each
    assert not (overlaps & (found[:, None] == found)).any()
    assert found.max() == 3  # the icosahedron's graph needs four
    assert levels(points, np.full(12, 10e-3)) == [0] * 12
    lattice = SurfaceLattice(sphere, points, ("L1",), np.full(12, 0.12), step=1e-3, wrapped=True)
    heights = [np.linalg.norm(pose.shift) for _, pose in lattice.boards(LOOP, STRIP)]
    assert (np.round((np.array(heights) - min(heights)) / 1e-3) == found).all()


HELMET = Surface.dome((97e-3, 117e-3, 100e-3), skirt=50e-3)
CAPSULE = trimesh.creation.capsule(height=12e-3, radius=8e-3, count=[48, 48])


@pytest.mark.parametrize(("surface", "count", "mirror"), [
    (HELMET, 8, "x"), (HELMET, 16, "x"), pytest.param(HELMET, 32, None, marks=pytest.mark.slow),
    (Surface(CAPSULE.vertices, CAPSULE.faces), 12, None),
], ids=["8", "16", "32", "fingertip"])  # fmt: skip
def test_helmets_and_a_fingertip(surface, count, mirror):
    """Nearest neighbours of points of equal parts of the area A are sqrt(2 A/(n sqrt 3)) apart, were all hexagons."""
    points = spread(surface, count, mirror)
    apart = np.linalg.norm(points[:, None] - points, axis=2) + np.diag(np.full(count, math.inf))
    hexagons = math.sqrt(2 * surface.area / (math.sqrt(3) * count))
    assert 0.7 < apart.min() / hexagons < apart.min(axis=1).max() / hexagons < 1.15
    lattice = SurfaceLattice(surface, points, ("L1",), sizes_by_distance(surface, points, 1.3), wrapped=True)
    paths = lattice.conductors(LOOP, STRIP)
    assert [path.name for path in paths] == [f"coil{k + 1}" for k in range(count)]
    heights = [np.linalg.norm(surface.nearest(path.vertices)[0] - path.vertices, axis=1) for path in paths]
    assert min(height.min() for height in heights) > 0  # all above the surface


@pytest.mark.parametrize("coil", [
    Spiral(6, 16e-3, 5, 0.2e-3, 0.2e-3),
    RoundedSpiral(20e-3, 12e-3, 4, 0.2e-3, 0.2e-3, corner_radius=3e-3),
    LOOP,
    circle(10e-3),
])  # fmt: skip
def test_resized(coil):
    """A coil in its own width is itself, and in another it keeps its trace."""
    shape = coil.coil()
    half = resized(shape, 11e-3)
    assert half.trace_width == shape.trace_width
    sides = np.ptp(half.outline, axis=0)
    corners = (
        1.0 if shape.wound is None or shape.wound.sides == 4 else math.cos(math.pi / 6)
    )  # of hexagons across flats
    assert sides.max() == pytest.approx(11e-3 / corners)
    back = resized(half, 2 * 11e-3)
    np.testing.assert_allclose(np.ptp(back.outline, axis=0), 2 * sides, rtol=1e-9)


def test_cut():
    """Flat loops that overlap on a small sphere pass through each other; wrapped ones do not."""
    sphere = ball(25e-3)
    points = sphere.nearest(25e-3 * np.array([(0, 0, 1), (math.sin(0.8), 0, math.cos(0.8))]))[0]
    lattice = SurfaceLattice(sphere, points, ("L1",), np.array([24e-3, 22.8e-3]), step=0.3e-3)
    refused(GeometryError, "coils coil1 and coil2 cut through each other", lattice.boards, LOOP, STRIP)
    assert len(replace(lattice, wrapped=True).boards(LOOP, STRIP)) == 2


@pytest.mark.parametrize(("change", "message"), [
    ({"points": [(0.0, 0.0, 0.2)]}, "on the surface"),
    ({"points": [(0.0, 0.0, math.nan)]}, "points must be finite"),
    ({"points": [(0.0, 0.0)]}, "points must have shape"),
    ({"points": np.zeros((0, 3))}, "points must have shape"),
    ({"points": [(0.0, 0.0, 0.1), (0.0, 0.0, 0.1)]}, "points must be apart"),
    ({"points": ["here"]}, "points must be numbers"),
    ({"sizes": [1e-2, 1e-2]}, "sizes must be 1"),
    ({"sizes": [-1e-2]}, "sizes must be positive"),
    ({"names": ("a", "b")}, "names must be 1"),
    ({"step": 0.0}, "step of levels must be positive"),
    ({"rotation": math.inf}, "rotation must be finite"),
])  # fmt: skip
def test_impossible_lattices(change, message):
    given = {"points": [(0.0, 0.0, 0.1)], "layers": ("L1",)}
    refused(GeometryError, message, SurfaceLattice, ball(0.1), **(given | change))


def test_too_wide_to_wrap():
    lattice = SurfaceLattice(ball(10e-3), [(0.0, 0.0, 10e-3)], ("L1",), [40e-3], wrapped=True)
    refused(GeometryError, "half of its width", lattice.boards, LOOP, STRIP)


CUBE = trimesh.creation.box((0.1, 0.1, 0.1))


@pytest.mark.parametrize(("vertices", "faces", "message"), [
    (CUBE.vertices, np.zeros((0, 3), int), "1 to 500000 triangles; got 0"),
    (CUBE.vertices, CUBE.faces + 1, "must name its 8 vertices"),
    (CUBE.vertices * math.nan, CUBE.faces, "finite"),
    (CUBE.vertices * 1e-3, CUBE.faces, "is its unit right"),
    (CUBE.vertices * 1e3, CUBE.faces, "is its unit right"),
    (CUBE.vertices * (1, 1, 0), CUBE.faces, "two triangles at most|volume"),
    (CUBE.vertices * (1, 0, 0), CUBE.faces, "flat"),
    (np.vstack((CUBE.vertices, CUBE.vertices + 1)), np.vstack((CUBE.faces, CUBE.faces + 8)), "one piece; got 2"),
    (np.vstack((CUBE.vertices, [(0, 0, 1)])), np.vstack((CUBE.faces, [(*CUBE.edges[0], 8)])), "two triangles at most"),
    (CUBE.vertices, np.vstack((CUBE.faces[:1, ::-1], CUBE.faces[1:])), "one orientation"),
    (CUBE.vertices[:, :2], CUBE.faces, "vertices \\(n, 3\\)"),
    ("no", CUBE.faces, "vertices of three numbers"),
])  # fmt: skip
def test_no_surface(vertices, faces, message):
    refused(GeometryError, message, Surface, vertices, faces)


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply", ".off"])
def test_files(tmp_path, suffix):
    """In mm, as usual for printers."""
    mesh = trimesh.creation.icosphere(2, 30.0)
    mesh.export(tmp_path / f"ball{suffix}")
    surface = Surface.read(tmp_path / f"ball{suffix}")
    assert surface.area == pytest.approx(mesh.area * 1e-6, rel=1e-5)
    assert len(surface.vertices) == len(mesh.vertices)  # an STL file repeats them
    metres = Surface.read(tmp_path / f"ball{suffix}", unit=1e-2)
    assert metres.area == pytest.approx(100 * surface.area)


@pytest.mark.parametrize(("name", "content", "message"), [
    ("a.stl", None, "cannot read"),
    ("a.stl", b"", "not a mesh|no triangles"),
    ("a.stl", b"solid nothing\nendsolid nothing\n", "not a mesh|no triangles"),
    ("a.obj", b"v 0 0 x\n", "not a mesh|no triangles"),
    ("a.ply", b"\x00\xff\x80", "not a mesh|no triangles"),
    ("a.txt", b"", ".stl, .obj, .ply, .off"),
])  # fmt: skip
def test_no_mesh_file(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    refused(GeometryError, message, Surface.read, tmp_path / name)


@pytest.mark.parametrize(("arguments", "message"), [
    (((1e-2, 1e-2),), "three"),
    (((1e-2, 1e-2, -1e-2),), "positive"),
    (((1e-2, 1e-2, 1e-2), -1e-3), "skirt"),
    (((1e-2, 1e-2, 1e-2), math.nan), "skirt"),
])  # fmt: skip
def test_no_dome(arguments, message):
    refused(GeometryError, message, Surface.dome, *arguments)


@pytest.mark.parametrize(("count", "mirror", "message"), [
    (0, None, "1 to 1000"), (1001, None, "1 to 1000"), (2.0, None, "whole"), (True, None, "whole"), (4, "z", "mirror"),
])  # fmt: skip
def test_no_points(count, mirror, message):
    refused(GeometryError, message, spread, ball(0.1, 2), count, mirror)
    beside = ball(0.1, 2, Pose(x=1.0))
    refused(GeometryError, "both sides of the mirror", spread, beside, 4, "x")


def test_couplings_of_an_icosahedron_are_equal():
    """All 30 neighbours of 12 loops are alike, to the degree of their places."""
    sphere = ball(0.1)
    points = spread(sphere, 12)
    boards = SurfaceLattice(sphere, points, ("L1",), np.full(12, 60e-3)).boards(LOOP, STRIP)
    k = coupling_matrix(inductance_matrix([array.conductors()[0].posed(pose) for array, pose in boards]))
    near = [k[pair] for pair in neighbours(sphere, points)]
    assert np.ptp(near) < 0.15 * abs(np.mean(near))
    assert np.mean(near) < 0  # side by side


def test_solids_of_a_wrapped_board_are_closed_and_have_no_rule_of_bends():
    board = Array.row(Spiral(6, 20e-3, 4, 0.3e-3, 0.3e-3), 1).bent(Wrap(ball(50e-3, 5), Pose(z=50e-3)))
    for name, solid in solids(board).items():
        assert solid.is_watertight, name
    far = np.linalg.norm(solids(board)["board"].vertices + np.array([0, 0, 50e-3]), axis=1)
    assert np.ptp(far) < 0.3e-3  # the thickness of the laminate, 0.2 mm, and the facets of the sphere
    assert not [margin for margin in check_rules(board, FabRules()) if margin.rule == "bend ratio"]
