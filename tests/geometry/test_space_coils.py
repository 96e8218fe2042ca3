"""Wire coils in space against their formulas, and the pose of boards.

Formulas: Rosa & Grover, Bull. Bureau of Standards 8, 1 (1912) for solenoids, Nagaoka's factor from Lorenz; rings and
toroids by Maxwell; pairs and saddles by Biot and Savart.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ellipe, ellipk

from coilarray import inductance_matrix, magnetic_field, mutual_inductance, self_inductance
from coilarray.constants import MU_0
from coilarray.electromagnetics.field import vector_potential
from coilarray.errors import GeometryError
from coilarray.geometry import Conductor, space_coils
from coilarray.geometry.pose import Pose
from coilarray.geometry.space_coils import helix, helmholtz_pair, maxwell_pair, rogowski, saddle, solenoid, toroid

ANGLES = st.floats(-7, 7)


def single_layer_inductance(diameter, length, turns, wire):
    """Solenoid of round wire: current sheet by Lorenz, less Rosa's corrections for wire and spacing."""
    k2 = diameter**2 / (diameter**2 + length**2)
    K, E, rest = ellipk(k2), ellipe(k2), 1 - k2
    sheet = 4 / (3 * math.pi * math.sqrt(rest)) * (rest / k2 * (K - E) + E - math.sqrt(k2))
    sheet *= MU_0 * math.pi * diameter**2 / 4 * turns**2 / length
    own = 1.25 - math.log(2 * length / turns / wire)
    between = math.log(2 * math.pi) - 1.5 - math.log(turns) / (6 * turns) - 0.33084236 / turns - 1 / (120 * turns**3)
    return sheet - MU_0 * diameter / 2 * turns * (own + between)


def axial_inductance(diameter, length):
    """Straight current of 1 A spread over a cylinder: the mean of parallel filaments over the angle between them."""
    apart = diameter * np.sin(np.pi * (np.arange(400) + 0.5) / 800)
    pairs = np.arcsinh(length / apart) - np.hypot(1, apart / length) + apart / length
    return MU_0 * length / (2 * np.pi) * pairs.mean()


def ring_inductance(radius, wire):
    a = wire / 2
    return (
        MU_0 * radius * (math.log(8 * radius / a) - 1.75 + a**2 / (8 * radius**2) * (math.log(8 * radius / a) + 1 / 3))
    )


@pytest.mark.slow
@pytest.mark.parametrize(("diameter", "length", "turns", "wire"), [
    (20e-3, 40e-3, 40, 0.5e-3), (50e-3, 20e-3, 10, 1e-3), (10e-3, 15e-3, 30, 0.3e-3),
])  # fmt: skip
def test_solenoid(diameter, length, turns, wire):
    """The formula is of rings; a helix has a current along the axis as well. Both neglect the slant of the turns."""
    coil = solenoid(diameter, length, turns, wire)
    expected = single_layer_inductance(diameter, length, turns, wire) + axial_inductance(diameter, length)
    assert self_inductance(coil)[0] == pytest.approx(expected, rel=1.5e-3)
    assert coil.area[2] == pytest.approx(turns * math.pi * diameter**2 / 4, rel=1e-12)


@pytest.mark.parametrize("gap", [0.0, 0.1, 1.0])
def test_turns_that_touch(gap):
    """Rings of wire side by side against Maxwell's formula, exact for round wires but for (wire/diameter)²."""
    radius, wire, turns = 20e-3, 1e-3, 4
    pitch = (1 + gap) * wire
    ring, _ = space_coils.loop_pair(radius, 0.1, wire)
    rings = [ring.posed(Pose(z=k * pitch)) for k in range(turns)]
    height = pitch * np.arange(1, turns)
    k2 = 4 * radius**2 / (4 * radius**2 + height**2)
    between = MU_0 * radius * ((2 / np.sqrt(k2) - np.sqrt(k2)) * ellipk(k2) - 2 / np.sqrt(k2) * ellipe(k2))
    expected = turns * ring_inductance(radius, wire) + 2 * ((turns - np.arange(1, turns)) * between).sum()
    # as stated; squares in place of circles change the distance of wires that touch by 0.5 %
    assert inductance_matrix(rings, allow_overlaps=True).sum() == pytest.approx(expected, rel=2e-3)


def test_ring():
    upper, _ = space_coils.loop_pair(25e-3, 1.0, 1e-3)
    assert self_inductance(upper)[0] == pytest.approx(ring_inductance(25e-3, 1e-3), rel=5e-4)  # as stated


def test_pairs_have_the_field_of_their_formulas():
    R = 50e-3
    z = np.array([-2e-3, 0.0, 2e-3])
    axis = np.column_stack((0 * z, 0 * z, z))
    even = magnetic_field(helmholtz_pair(R, 1e-3), axis)[:, 2]
    # polygons of the circle's area: 72 sides change a field by less than (2π/72)^4
    assert even[1] == pytest.approx(0.8**1.5 * MU_0 / R, rel=6e-5)
    assert abs(even @ [1, -2, 1]) / even[1] < 1e-5  # no second derivative: only (z/R)^4 is left
    steep = magnetic_field(maxwell_pair(R, 1e-3), axis)[:, 2]
    assert abs(steep[1]) < 1e-12 * abs(steep[0])
    gradient = 48 / 49 * math.sqrt(3 / 7) * MU_0 / R**2
    assert (steep[2] - steep[0]) / 4e-3 == pytest.approx(gradient, rel=6e-5)


@pytest.mark.slow
def test_wound_pairs_are_mirror_images():
    for pair, sign in ((helmholtz_pair(30e-3, 1e-3, 5), 1), (maxwell_pair(30e-3, 1e-3, 5), -1)):
        L = inductance_matrix(pair)
        assert L[0, 0] == pytest.approx(L[1, 1], rel=1e-9)
        assert sign * L[0, 1] > 0


def test_saddle():
    a, length, angle = 10e-3, 40e-3, 2 * math.pi / 3
    half, far = math.sin(angle / 2), math.hypot(a, length / 2)
    legs = 2 * MU_0 / (4 * math.pi * a) * length / far * half
    arcs = 4 * MU_0 / (4 * math.pi) * a * length / 2 / far**3 * half
    field = magnetic_field([saddle(a, length, angle, 1e-3, segments=360)], [[0, 0, 0]])[0]
    assert field[0] == pytest.approx(legs + arcs, rel=1e-5)  # chords of one degree
    assert np.abs(field[1:]).max() < 1e-12 * field[0]


@pytest.mark.slow
def test_toroid_and_rogowski_coil():
    R, a, N = 20e-3, 5e-3, 60
    linked = MU_0 * N * (R - math.sqrt(R**2 - a**2))
    coil, ring = rogowski(R, a, N, 0.4e-3), toroid(R, a, N, 0.4e-3)
    wires = [[[x, 0, -50], [x, 0, 50]] for x in (0, 9e-3, 40e-3)]
    inside, aside, outside = mutual_inductance([coil], wires)[0]
    # a helix of 60 turns of 36 chords, each of the circle's area
    assert inside == pytest.approx(linked, rel=2e-5)
    assert aside == pytest.approx(linked, rel=2e-4)
    assert abs(outside) < 1e-4 * linked
    # a field along the axis links with the loop of the toroid; of the coil that leads back πa²/2 is left, by chords
    assert ring.area[2] == pytest.approx(math.pi * (R**2 + a**2 / 2), rel=1e-3)
    assert coil.area[2] == pytest.approx(math.pi * a**2 / 2, rel=0.25)
    # thin wires turn by turn: Rosa's corrections of straight windings on the mean pitch
    spaced = 1.25 - math.log(2 * 2 * math.pi * R / N / 0.4e-3) + 0.336
    expected = N * linked - MU_0 * a * N * spaced + MU_0 * R * (math.log(8 * R / a) - 2)
    assert self_inductance(ring)[0] == pytest.approx(expected, rel=0.01)  # the pitch varies by a quarter


def test_twisted_pair():
    go, back = space_coils.twisted_pair(200e-3, 1e-3, 20e-3, 0.5e-3)
    L = inductance_matrix([go, back])
    loop = L.sum()  # both in the sense of their own path: out and back
    # parallel wires, as the twist is slow: µ0/π (ln(d/r) + 1/4) per length of wire; ends and twist are a hundredth
    straight = go.lengths.sum() * MU_0 / math.pi * (math.log(1e-3 / 0.25e-3) + 0.25)
    assert loop == pytest.approx(straight, rel=0.02)
    far, close = [[5e-3, 0, 100e-3]], space_coils.twisted_pair(200e-3, 1e-3, 4e-3, 0.5e-3)
    straight = space_coils.twisted_pair(200e-3, 1e-3, 100.0, 0.5e-3)
    assert np.linalg.norm(magnetic_field(close, far)) < 0.02 * np.linalg.norm(magnetic_field(straight, far))


def test_helix_on_a_rectangle():
    frame = helix([(-5e-3, -2e-3), (5e-3, -2e-3), (5e-3, 2e-3), (-5e-3, 2e-3)], turns=2.25, pitch=1e-3, wire=0.3e-3)
    x, y, z = frame.vertices.T
    assert (x.min(), x.max(), y.min(), y.max()) == pytest.approx((-5e-3, 5e-3, -2e-3, 2e-3))
    assert np.diff(z) == pytest.approx(1e-3 / 28e-3 * np.hypot(np.diff(x), np.diff(y)))
    assert frame.vertices[-1] == pytest.approx((2e-3, -2e-3, 1.125e-3))  # a quarter of the way around
    assert np.abs((frame.across * np.diff(frame.vertices, axis=0)).sum(axis=1)).max() < 1e-15


@pytest.mark.parametrize(("make", "named"), [
    (lambda: solenoid(20e-3, 10e-3, 40, 0.5e-3), "0.5 mm"), (lambda: solenoid(-1, 1, 1, 1), "diameter"),
    (lambda: helix([(0, 0), (1, 1), (1, 0), (0, 1)], 1, 1, 0.1), "cross"),
    (lambda: helix([(0, 0), (1, 1)], 1, 1, 0.1), "shape"),
    (lambda: saddle(1, 1, 7, 0.1), "7"), (lambda: toroid(5e-3, 5e-3, 10, 1e-3), "10 turns"),
    (lambda: helmholtz_pair(10e-3, 1e-3, 20), "20 turns"), (lambda: space_coils.twisted_pair(1, 1e-3, 1, 2e-3), "2 mm"),
    (lambda: helix([(0, 0), (1, 0), (1, 1)], 1, 1, 0.1, segments=2), "segments of .* at least 3"),
    (lambda: solenoid(1, 1, 1, 0.1, segments=0), "segments"), (lambda: solenoid(1, 1, "a", 0.1), "turns"),
    (lambda: toroid(20e-3, 5e-3, 2.5, 1e-3), "2.5"), (lambda: helmholtz_pair(1, 0.01, 2.5), "2.5"),
    (lambda: helix("abc", 1, 1, 0.1), "profile"), (lambda: solenoid(1, 1, 1e30, 1e-31), "turns"),
    (lambda: space_coils.twisted_pair(0.1, 1e-3, 1e-9, 1e-4), "pitch"),
])  # fmt: skip
def test_impossible_coils_are_refused(make, named):
    with pytest.raises(GeometryError, match=named):
        make()


@settings(max_examples=30, deadline=None)
@given(st.tuples(ANGLES, ANGLES, ANGLES), st.tuples(ANGLES, ANGLES, ANGLES))
def test_poses_combine(first, second):
    one, two = Pose(1e-3, -2e-3, 3e-3, first), Pose(-4e-3, 5e-3, 0.5e-3, second)
    points = np.random.default_rng(0).normal(size=(5, 3))
    np.testing.assert_allclose(two.after(one).apply(points), two.apply(one.apply(points)), atol=1e-7)
    np.testing.assert_allclose(one.undo(one.apply(points)), points, atol=1e-12)


@pytest.mark.parametrize(
    "turn", [(0, 0, 1e17), (1e14, -1e10, 3e5), (0, math.pi / 2 + 1e-6, 0.3), (0.1, -math.pi / 2, 2)]
)
def test_rotations_are_orthogonal_and_combine_at_any_angle(turn):
    pose, other = Pose(turn=turn), Pose(turn=(0.2, 0.3, -0.4))
    np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(other.after(pose).rotation, other.rotation @ pose.rotation, atol=1e-13)
    np.testing.assert_allclose(Pose().after(pose).rotation, pose.rotation, atol=1e-13)


@pytest.mark.parametrize(
    "wrong", [{"x": "1"}, {"z": None}, {"y": float("nan")}, {"turn": (0, 0)}, {"turn": (0, "a", 0)}, {"x": 1j}]
)
def test_impossible_poses_are_refused(wrong):
    with pytest.raises(GeometryError, match="a pose must have"):
        Pose(**wrong)


def test_turns_are_about_fixed_axes_in_order():
    quarter = math.pi / 2
    assert Pose(turn=(quarter, 0, quarter)).apply([0, 1, 0]).tolist() == [0, 0, 1]
    assert Pose(turn=(0, 0, quarter)).after(Pose(turn=(quarter, 0, 0))).apply([0, 0, 1]).tolist() == pytest.approx(
        [1, 0, 0]
    )


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(st.tuples(ANGLES, ANGLES, ANGLES))
def test_inductance_knows_no_direction(turn):
    """Traces of two layers with vias: L and M of a whole board in any pose, to the digits of the sums."""
    coils = [helix([(0, 0), (4e-3, 0), (4e-3, 3e-3), (0, 3e-3)], 2, 0.4e-3, 0.2e-3).posed(Pose(x=x)) for x in (0, 6e-3)]
    flat = [Conductor(c.vertices, 0.3e-3, 35e-6, across=(0.3, 1.0, 2.0)) for c in coils]
    pose = Pose(3e-3, 0, 0, turn)
    for paths in (coils, flat):
        moved = inductance_matrix([path.posed(pose) for path in paths], allow_overlaps=True)
        np.testing.assert_allclose(moved, inductance_matrix(paths, allow_overlaps=True), rtol=1e-6, atol=1e-16)


def test_a_width_along_its_segment_is_refused():
    with pytest.raises(GeometryError, match="segment 1 has"):
        Conductor([[0, 0, 0], [1, 0, 0], [1, 1, 0]], 0.1, 0.01, across=[0, 1, 0])


@pytest.mark.slow
def test_area_is_the_flux_of_a_distant_dipole():
    """A = µ0/4π m × r/r³ far away: the moment by the path's own potential."""
    coil = helix([(0, 0), (4e-3, 0), (4e-3, 3e-3), (0, 3e-3)], 2.4, 0.4e-3, 0.2e-3)
    closed = np.vstack((coil.vertices, coil.vertices[:1]))
    r = np.array([0.7, -0.4, 0.6])
    expected = MU_0 / (4 * math.pi) * np.cross(coil.area, r) / np.linalg.norm(r) ** 3
    at = r + coil.centre
    # the next multipole is smaller by size over distance
    np.testing.assert_allclose(vector_potential([closed], at), expected, rtol=0, atol=5e-3 * np.linalg.norm(expected))
