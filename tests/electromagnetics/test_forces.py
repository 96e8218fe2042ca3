"""Force and torque on current paths against closed forms, gradients of M, and Newton's third law."""

import math

import numpy as np
import pytest
from scipy.special import ellipe, ellipk

from coilarray import mutual_inductance
from coilarray.constants import MU_0
from coilarray.electromagnetics.forces import forces
from coilarray.errors import GeometryError
from coilarray.geometry.pose import Pose
from coilarray.geometry.space_coils import loop_pair, solenoid


def ring(radius, sides=720):
    turn = np.linspace(0, 2 * np.pi, sides + 1)
    grown = radius * math.sqrt(2 * np.pi / sides / math.sin(2 * np.pi / sides))
    points = grown * np.column_stack((np.cos(turn), np.sin(turn), 0 * turn))
    points[-1] = points[0]
    return points


def coaxial_force(a, b, z):
    """Force of two coaxial circular currents of 1 A (Smythe, Static and Dynamic Electricity, 7.19)."""
    k2 = 4 * a * b / ((a + b) ** 2 + z**2)
    elliptic = ellipk(k2) - (2 - k2) / (2 * (1 - k2)) * ellipe(k2)
    return MU_0 * z * math.sqrt(k2) / (2 * math.sqrt(a * b)) * elliptic


@pytest.mark.parametrize(("a", "b", "z"), [(1.0, 1.0, 0.5), (1.0, 0.5, 0.2), (1.0, 1.0, 0.05)])
def test_coaxial_circles(a, b, z):
    force, torque = forces([ring(b) + np.array([0, 0, z])], [ring(a)])
    assert force[0, 2] == pytest.approx(coaxial_force(a, b, z), rel=2e-8)  # 720 chords of the circle's area
    assert np.abs(force[0, :2]).max() < 1e-12 * abs(force[0, 2])
    assert np.abs(torque).max() < 1e-12 * abs(force[0, 2])


def test_action_is_reaction():
    first, second = loop_pair(10e-3, 8e-3, 0.5e-3, turns=3)
    second = second.posed(Pose(4e-3, 1e-3, -2e-3, (0.3, -0.2, 0.1)))
    # helices are not closed: lead both back far away
    first, second = (np.vstack((p.vertices, p.vertices[:1])) for p in (first, second))
    on_second, turned = forces([second], [first], 2.0, 3.0)
    on_first, turned_back = forces([first], [second], 3.0, 2.0)
    size = np.linalg.norm(on_first)
    np.testing.assert_allclose(on_first, -on_second, atol=1e-6 * size)
    np.testing.assert_allclose(turned, -turned_back, atol=1e-6 * size * 10e-3)


def test_force_and_torque_are_slopes_of_the_mutual_inductance():
    """F = I₁I₂ ∇M and T = I₁I₂ dM/dφ, by central differences with an error of h² M'''."""
    fixed = ring(10e-3, 72)
    moved = ring(6e-3, 72)
    pose = Pose(3e-3, -2e-3, 5e-3, (0.4, 0.2, 0.0))

    def inductance(step):
        return float(mutual_inductance([fixed], [step.apply(pose.apply(moved))])[0, 0])

    force, torque = forces([pose.apply(moved)], [fixed], 2.0, 3.0)
    h = 1e-5
    for axis, name in enumerate("xyz"):
        slope = (inductance(Pose(**{name: h})) - inductance(Pose(**{name: -h}))) / (2 * h)
        assert force[0, axis] == pytest.approx(6 * slope, rel=2e-5)
        turn = np.eye(3)[axis] * 1e-4
        about = (inductance(Pose(turn=tuple(turn))) - inductance(Pose(turn=tuple(-turn)))) / 2e-4
        assert torque[0, axis] == pytest.approx(6 * about, rel=2e-5)


def test_a_dipole_is_a_small_loop():
    class Dipole:
        """Magnet with magpylib's door: moment of 1 A m² along z at the origin."""

        def getB(self, points):  # noqa: N802 (of magpylib)
            r = np.linalg.norm(points, axis=1, keepdims=True)
            along = points[:, 2:] / r
            return MU_0 / (4 * math.pi) * (3 * along * points / r - [0, 0, 1]) / r**3

    at = [0.03, 0.02, 0.05]
    coil = solenoid(20e-3, 10e-3, 5, 1e-3).posed(Pose(*at))
    small = ring(1e-4, 36)
    area = math.pi * 1e-8
    by_magnet, _ = forces(coil, Dipole())
    by_loop, _ = forces(coil, [small], 1.0, 1 / area)
    np.testing.assert_allclose(by_magnet, by_loop, atol=1e-5 * np.linalg.norm(by_magnet))  # (0.1 mm/60 mm)²


def test_a_path_in_its_own_source_is_refused():
    with pytest.raises(GeometryError, match="path 1 meets"):
        forces([ring(1.0, 12)], [ring(1.0, 12) + np.array([0.01, 0, 0])])


@pytest.mark.parametrize("wrong", [{"currents": [1, 2]}, {"currents": float("nan")}, {"about": (0, 0)}])
def test_bad_values_are_named(wrong):
    with pytest.raises(GeometryError, match=next(iter(wrong))):
        forces([ring(1.0, 12)], [ring(1.0, 12) + np.array([0, 0, 1])], **wrong)


def test_a_current_along_the_field_has_no_force():
    force, torque = forces([[[0, 0, -1], [0, 0, 1]]], [ring(1.0, 36)])
    assert np.abs(force).max() < 1e-20
    assert np.abs(torque).max() < 1e-20


def test_a_field_that_is_not_finite_is_refused():
    class Broken:
        def getB(self, points):  # noqa: N802 (of magpylib)
            return np.full_like(points, np.nan)

    with pytest.raises(GeometryError, match="finite"):
        forces([ring(1.0, 12)], Broken())
