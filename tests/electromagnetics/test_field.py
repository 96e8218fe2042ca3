"""The field of straight segments.

Who checks whom: B on the axis and off it against closed forms (elliptic integrals), B and A against mpmath near the
wire and far from it, B against the curl of A, identities for both.
"""

import itertools
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import config
from scipy.spatial.transform import Rotation
from scipy.special import ellipe, ellipk
from support.references import polygon

from coilarray import magnetic_field, mutual_inductance
from coilarray.constants import MU_0
from coilarray.electromagnetics.field import grid_points, vector_potential
from coilarray.errors import GeometryError
from coilarray.geometry import Conductor

pytestmark = pytest.mark.nojit

# threads and forks are those of compiled code; as plain Python they take half a minute
compiled = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="numba is switched off")
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0.2], [0.3, 0.8, -0.1], [0, 0, 0]])


def test_finite_wire():
    x, rho = np.linspace(-2, 3, 11), 0.37
    wire, points = [[[0, 0, 0], [1, 0, 0]]], np.column_stack((x, np.full(11, rho), np.zeros(11)))
    B, A = magnetic_field(wire, points), vector_potential(wire, points)
    # B = µ0 I/(4πρ) (sin β − sin α), Jackson ch. 5; 1e-13: a dozen roundings
    expected = MU_0 / (4 * np.pi * rho) * (x / np.hypot(x, rho) - (x - 1) / np.hypot(x - 1, rho))
    np.testing.assert_allclose(B[:, 2], expected, rtol=1e-13)
    assert (B[:, :2] == 0).all()
    expected = MU_0 / (4 * np.pi) * (np.arcsinh(x / rho) - np.arcsinh((x - 1) / rho))
    np.testing.assert_allclose(A[:, 0], expected, rtol=1e-13)


def _loop_field(rho, z):
    """Radial and axial B of a circle of radius 1 m and 1 A (Smythe, Static and Dynamic Electricity, 7.10)."""
    alpha2, beta2 = (1 - rho) ** 2 + z**2, (1 + rho) ** 2 + z**2
    m = 1 - alpha2 / beta2
    K, E = ellipk(m), ellipe(m)
    c = MU_0 / (2 * np.pi * np.sqrt(beta2))
    return c * z / rho * (-K + (1 + rho**2 + z**2) / alpha2 * E), c * (K + (1 - rho**2 - z**2) / alpha2 * E)


def test_circular_loop_converges_with_second_order():
    points = [[0.4, 0, 0.3], [1.3, 0, 0.1], [0.9, 0, -0.2], [0.2, 0, 2.0]]
    exact = np.array([[radial, 0, axial] for radial, axial in (_loop_field(x, z) for x, _, z in points)])
    errors = [np.abs(magnetic_field([polygon(n, 1.0)], points) - exact).max() for n in (128, 256, 512)]
    # inscribed polygons: second order, nearly reached where sides are shorter than the distance to the wire
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2, atol=0.02)


def test_dipole_far_away():
    points = 1e4 * np.array([[0.3, 0.2, 0.9], [1, 0, 0], [-0.5, 0.5, -0.1]])
    r = np.linalg.norm(points, axis=1)[:, None]
    square = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0], [1, 1, 0]]) / 2
    moment = np.array([0, 0, 1.0])  # A m²
    dipole = MU_0 / (4 * np.pi) * (3 * points * (points @ moment)[:, None] / r**5 - moment / r**3)
    # the quadrupole of a square vanishes: the correction is (size/distance)² = 1e-8; the sum of four nearly opposite
    # segments keeps 1e-16 · (distance/size)² = 1e-8 of its value
    np.testing.assert_allclose(magnetic_field([square], points), dipole, rtol=1e-7, atol=1e-7 * np.abs(dipole).max())
    A = MU_0 / (4 * np.pi) * np.cross(moment, points) / r**3
    np.testing.assert_allclose(vector_potential([square], points), A, rtol=1e-7, atol=1e-7 * np.abs(A).max())


@pytest.mark.parametrize("distance", [1e-1, 1e-3, 1e-6, 1e-9])
def test_near_the_wire(distance):
    with mpmath.workdps(40):
        point = [0.3, 0.06 + distance, 0.03]
        q, x = (np.array([mpmath.mpf(value) for value in vector]) for vector in ([1.0, 0.2, 0.1], point))
        u, v, d = x, x - q, q
        nu, nv, nd = (mpmath.sqrt(w @ w) for w in (u, v, d))
        B = MU_0 / (4 * np.pi) * (np.cross(d, u) * (nu + nv) / (nu * nv * (nu * nv + u @ v))).astype(float)
        A = MU_0 / (4 * np.pi) * (d / nd * mpmath.log((nu + nv + nd) / (nu + nv - nd))).astype(float)
    segment = [[[0, 0, 0], [1.0, 0.2, 0.1]]]
    # the points' own rounding, 1e-16 of the length, is that part of the distance
    rel = 1e-14 + 1e-15 / distance
    np.testing.assert_allclose(magnetic_field(segment, point), B, rtol=0, atol=rel * np.abs(B).max())
    np.testing.assert_allclose(vector_potential(segment, point), A, rtol=0, atol=rel * np.abs(A).max())


def test_vector_potential_at_any_distance():
    # the logarithm's argument runs through all its powers of two: A = µ0 I/4π · 2 atanh(|d|/(|u| + |v|))
    points = np.random.default_rng(1).normal(size=(300, 3)) * np.logspace(-7, 7, 300)[:, None] + [0.4, 0, 0]
    with mpmath.workdps(40):
        exact = []
        for point in points.tolist():
            x, y, z = map(mpmath.mpf, point)
            both = mpmath.sqrt(x**2 + y**2 + z**2) + mpmath.sqrt((x - 1) ** 2 + y**2 + z**2)
            exact.append(float(2 * mpmath.atanh(1 / both)) * MU_0 / (4 * np.pi))
    # 2e-14: some twenty roundings, near and far
    np.testing.assert_allclose(vector_potential([[[0, 0, 0], [1, 0, 0]]], points)[:, 0], exact, rtol=2e-14)


def test_on_the_wire_a_segment_adds_nothing():
    wire, beyond = [[0, 0, 0], [1, 0, 0]], [2.0, 0, 0]
    points = [[0, 0, 0], [0.5, 0, 0], [1, 0, 0], [0.5, 1e-14, 0]]
    assert (vector_potential([wire], points) == 0).all()
    # on the line but beyond the end: B is zero, A is not
    assert (magnetic_field([wire], [*points, beyond]) == 0).all()
    assert vector_potential([wire], beyond)[0] == pytest.approx(MU_0 / (4 * np.pi) * np.log(2), rel=1e-14)
    # at a vertex the other segments still count
    corner = magnetic_field([TRIANGLE], TRIANGLE[0])
    np.testing.assert_allclose(corner, magnetic_field([TRIANGLE[1:3]], TRIANGLE[0]), rtol=1e-14)


def _derivatives(field, points, step):
    """d field_i/d x_j by the fourth-order central difference, shape (n, 3, 3)."""
    out = np.empty((len(points), 3, 3))
    for j, e in enumerate(step * np.eye(3)):
        f = [field([TRIANGLE], points + k * e) for k in (-2, -1, 1, 2)]
        out[:, :, j] = (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * step)
    return out


def test_divergence_and_curl():
    points = np.random.default_rng(1).uniform([-1, -1, -0.1], [1.5, 1.5, 2.4], (40, 3))
    points = points[points[:, 2] > 0.4]  # away from the wire, where the differences converge
    B = magnetic_field([TRIANGLE], points)
    dB, dA = (_derivatives(field, points, 1e-3) for field in (magnetic_field, vector_potential))
    curl = np.column_stack((dA[:, 2, 1] - dA[:, 1, 2], dA[:, 0, 2] - dA[:, 2, 0], dA[:, 1, 0] - dA[:, 0, 1]))
    # truncation (step/distance)⁴ ≈ 4e-11 and rounding 1e-16 · distance/step ≈ 1e-13, times small factors
    scale = np.abs(B).max()
    np.testing.assert_allclose(np.trace(dB, axis1=1, axis2=2), 0, atol=1e-8 * scale)
    np.testing.assert_allclose(curl, B, atol=1e-8 * scale)
    # curl B = 0 where no current flows
    np.testing.assert_allclose(dB, np.swapaxes(dB, 1, 2), atol=1e-8 * scale)


def test_circulation_is_the_enclosed_current():
    # a circle of 96 points around one side: the rule converges geometrically, 0.6^96 < 1e-20
    angle = 2 * np.pi * np.arange(96) / 96
    middle, direction = 0.5 * (TRIANGLE[0] + TRIANGLE[1]), TRIANGLE[1] - TRIANGLE[0]
    u = np.cross(direction, [0, 0, 1])
    u /= np.linalg.norm(u)
    v = np.cross(direction / np.linalg.norm(direction), u)
    radius = 0.2
    points = middle + radius * (np.outer(np.cos(angle), u) + np.outer(np.sin(angle), v))
    tangent = -np.outer(np.sin(angle), u) + np.outer(np.cos(angle), v)
    B = magnetic_field([TRIANGLE], points, currents=2.5)
    assert (B * tangent).sum() * 2 * np.pi * radius / 96 == pytest.approx(2.5 * MU_0, rel=1e-12)


def test_flux_is_the_circulation_of_the_potential_and_the_mutual_inductance():
    other = np.array([[0.1, 0.1, 0.5], [0.7, 0.1, 0.5], [0.7, 0.9, 0.6], [0.1, 0.9, 0.6], [0.1, 0.1, 0.5]])
    nodes, weights = np.polynomial.legendre.leggauss(24)
    total = 0.0
    for start, end in itertools.pairwise(other):
        points = start + np.outer(0.5 * (nodes + 1), end - start)
        total += (vector_potential([TRIANGLE], points) @ (end - start) * weights).sum() / 2
    # the sides are as far from the wire as they are long: 24 nodes leave nothing
    assert mutual_inductance([TRIANGLE], [other])[0, 0] == pytest.approx(total, rel=1e-11)


@settings(max_examples=30)
@given(st.tuples(*[st.floats(0, 6.28)] * 3), st.tuples(*[st.floats(-5, 5)] * 3), st.floats(1e-6, 1e6))
def test_rotation_translation_and_scale(angles, shift, scale):
    R = Rotation.from_euler("XYZ", angles).as_matrix()
    points = np.array([[0.5, 0.3, 0.7], [2, -1, 0.5]])
    B = magnetic_field([TRIANGLE], points)
    moved = magnetic_field([scale * (TRIANGLE @ R.T + shift)], scale * (points @ R.T + shift))
    # rounding of coordinates up to 9 lengths from the origin
    np.testing.assert_allclose(moved * scale, B @ R.T, rtol=0, atol=1e-13 * np.abs(B).max())


def test_many_conductors_currents_and_blocks():
    paths, currents = [polygon(5, 1.0, k * 0.3) for k in range(3)], [1.0, -2.0, 0.0]
    points = np.random.default_rng(0).uniform(-2, 2, (2000, 3))  # several blocks and a rest
    together = magnetic_field(paths, points, currents)
    apart = sum(i * magnetic_field([path], points) for i, path in zip(currents, paths, strict=True))
    np.testing.assert_allclose(together, apart, rtol=0, atol=1e-13 * np.abs(apart).max())
    np.testing.assert_array_equal(magnetic_field(paths, points[777], currents), together[777])
    assert magnetic_field(paths, points.reshape(40, 50, 3), currents).shape == (40, 50, 3)
    assert magnetic_field(paths, np.zeros((0, 3))).shape == (0, 3)


@compiled
def test_two_threads_at_once():
    points = np.random.default_rng(0).uniform(-2, 2, (60000, 3))
    alone = magnetic_field([TRIANGLE], points)
    with ThreadPoolExecutor(4) as pool:
        for B in pool.map(lambda _: magnetic_field([TRIANGLE], points), range(8)):
            np.testing.assert_array_equal(B, alone)


@compiled
@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_forked_child_can_go_on():
    # in a process of its own: threads are used, then it forks, then both sides compute
    script = (
        "import os, numpy as np; from coilarray import magnetic_field; p = np.ones((60000, 3)); "
        "t = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]; magnetic_field([t], p); child = os.fork(); B = magnetic_field([t], p); "
        "os._exit(0) if child == 0 else None; _, status = os.waitpid(child, 0); raise SystemExit(status != 0)"
    )
    done = subprocess.run([sys.executable, "-c", script], timeout=600, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr


def test_one_path_may_come_bare():
    points = [0.2, 0.1, 0.4]
    expected = magnetic_field([TRIANGLE], points)
    for source in (TRIANGLE, TRIANGLE.tolist(), Conductor(TRIANGLE), [Conductor(TRIANGLE)]):
        np.testing.assert_array_equal(magnetic_field(source, points), expected)


def test_grid_points():
    grid = grid_points([0, 1], [2, 3, 4], 5)
    assert grid.shape == (2, 3, 1, 3)
    assert grid[1, 2, 0].tolist() == [1, 4, 5]
    for axes, message in ((([0, np.nan], 0, 0), "x must be"), ((0, [[1]], 0), "y must be")):
        with pytest.raises(GeometryError, match=message):
            grid_points(*axes)


@pytest.mark.parametrize("size", [1e-29, 1e-9, 1e3, 1e30])
def test_fields_of_any_size_stay_numbers(size):
    points = np.array([[0.5, 0, 0.1], [1e-9, 1e-10, 0], [0, 0, 0], [1, 1, 1]])
    B, A = magnetic_field([TRIANGLE], points), vector_potential([TRIANGLE], points)
    # B falls with the size and A does not change; 1e-12 for rounding next to the wire
    np.testing.assert_allclose(magnetic_field([TRIANGLE * size], points * size) * size, B, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(vector_potential([TRIANGLE * size], points * size), A, rtol=1e-6, atol=1e-18)


def test_progress_counts_up():
    seen = []
    magnetic_field([TRIANGLE], np.zeros((30000, 3)) + 1, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1][0] == seen[-1][1]
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


@pytest.mark.parametrize(("arguments", "message"), [
    (([TRIANGLE], [1, 2]), r"points must have shape \(\.\.\., 3\); got \(2,\)"),
    (([TRIANGLE], [1, 2, np.nan]), "points must be finite"),
    (([TRIANGLE], [1, 2, 1e200]), "points must be at most 1e"),
    (([TRIANGLE], "here"), "points must be numbers"),
    (([TRIANGLE], [1, 2, 3], 1e300), "currents must be finite and at most"),
    (([TRIANGLE], [1, 2, 3], "much"), "currents must be one number or 1"),
    (([TRIANGLE * 1e200], [1, 2, 3]), "vertices of path 1 must be at most"),
    (([TRIANGLE], [1, 2, 3], [1, 2]), r"currents must be one number or 1, one a path; got shape \(2,\)"),
    (([TRIANGLE], [1, 2, 3], np.inf), "currents must be finite"),
    (([], [1, 2, 3]), "at least one current path"),
    (([[[0, 0, 0]]], [1, 2, 3]), "vertices of path 1 must have shape"),
    (([[[0, 0, 0], [0, 0, 0]]], [1, 2, 3]), "segment 0 of path 1 has length zero"),
    (([[[0, 0, 0], [1, np.nan, 0]]], [1, 2, 3]), "vertex 1 is not"),
])  # fmt: skip
def test_bad_input(arguments, message):
    with pytest.raises(GeometryError, match=message):
        magnetic_field(*arguments)
