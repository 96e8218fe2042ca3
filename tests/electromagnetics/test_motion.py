"""Mutual inductance over poses against the sums over all segments and against Maxwell's and Grover's formulas."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ellipe, ellipk

from coilarray import Array, Spiral, inductance_matrix, load_design, mutual_inductance
from coilarray.constants import MU_0
from coilarray.electromagnetics.motion import moved_inductance
from coilarray.errors import GeometryError
from coilarray.geometry import Conductor, Pose, loop_pair

COIL = Spiral(6, 16e-3, 12, 0.15e-3, 0.15e-3)
STATED = 1e-4
"""Of the larger self-inductance, where coils are a trace width or more apart."""
REFERENCES = Path(__file__).parents[1] / "reference" / "ref_circular_filaments.csv"


@pytest.fixture(scope="module")
def boards():
    six, one = load_design("gast2020").array.conductors(), COIL.conductors()
    return six, one, max(inductance_matrix(six).max(), inductance_matrix(one).max())


@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(
    gap=st.floats(0.2e-3, 30e-3), across=st.tuples(st.floats(-20e-3, 20e-3), st.floats(-20e-3, 20e-3)),
    turn=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-3, 3)), flat=st.booleans(),
)  # fmt: skip
def test_stated_accuracy(boards, gap, across, turn, flat):
    six, one, largest = boards
    turn = (0.0, 0.0, turn[2]) if flat else turn
    tilted = Pose(turn=turn).apply(one[0].vertices)[:, 2].min()
    pose = Pose(*across, gap - tilted, turn)
    found = moved_inductance(six, one, [pose])[0]
    np.testing.assert_allclose(found, mutual_inductance(six, [one[0].posed(pose)]), rtol=0, atol=STATED * largest)


def circle(radius, sides=360):
    turn = 2 * np.pi * np.arange(sides + 1) / sides
    grown = radius * math.sqrt(2 * np.pi / sides / math.sin(2 * np.pi / sides))
    points = grown * np.column_stack((np.cos(turn), np.sin(turn), 0 * turn))
    points[-1] = points[0]
    return points


@pytest.mark.slow
def test_circular_filaments():
    """All rows whose circles are well apart: 360 chords of the circle's area are right to 1e-5."""
    with REFERENCES.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    tried = 0
    for row in rows:
        a, b, x, y, z, nx, ny, nz, expected = (float(value) for value in list(row.values())[1:10])
        normal = np.array([nx, ny, nz]) / math.sqrt(nx**2 + ny**2 + nz**2)
        pose = Pose(x, y, z, (0.0, math.acos(normal[2]), math.atan2(normal[1], normal[0])))
        near = np.linalg.norm(pose.apply(circle(b))[:, None] - circle(a), axis=-1).min()
        if near > 0.05 * min(a, b):
            tried += 1
            (((M,),),) = moved_inductance([circle(a)], [circle(b)], [pose])
            assert M * 1e9 == pytest.approx(expected, rel=1e-5), row
    assert tried > 15


def test_whole_scenes_move_and_boards_change_places():
    row = Array.row(COIL, 2, 20e-3)
    pose, scene = Pose(3e-3, 1e-3, 6e-3, (0.2, -0.1, 1.0)), Pose(0.1, -0.2, 0.3, (1.0, 0.5, -2.0))
    M = moved_inductance(row, COIL, [pose])[0]
    moved = [path.posed(scene) for path in row.conductors()]
    # the same paths, seen from elsewhere: rounding of 1e-16 of 0.4 m, over the pitch
    np.testing.assert_allclose(moved_inductance(moved, COIL, [scene.after(pose)])[0], M, rtol=1e-7)
    there = [path.posed(pose) for path in COIL.conductors()]
    np.testing.assert_allclose(moved_inductance(there, row, [Pose()])[0].T, M, rtol=1e-5)


def test_no_poses_are_refused():
    with pytest.raises(GeometryError, match="pose"):
        moved_inductance(COIL, COIL, [])


WIDE = Conductor([[-20e-3, -20e-3, 0], [20e-3, -20e-3, 0], [20e-3, 20e-3, 0], [-20e-3, 20e-3, 0], [-20e-3, -16e-3, 0]],
                 4e-3, 35e-6)  # fmt: skip
LONG = Conductor(2.5 * WIDE.vertices, 0.5e-3, 35e-6)
MANY = Spiral(4, 40e-3, 40, 0.2e-3, 0.15e-3, layers=1)
CASES = {
    "many turns close together": (MANY, Pose(3e-3, 1e-3, 1e-3, (math.pi, 0, 0))),
    "many turns, farther": (MANY, Pose(3e-3, 1e-3, 4e-3, (math.pi, 0, 0))),
    "wide traces": (Spiral(4, 60e-3, 20, 0.5e-3, 0.5e-3, layers=1), Pose(-7e-3, 4e-3, 7e-3, (0.1, 0.2, 1.0))),
    "a wide turn a width away": (WIDE, Pose(z=4e-3)),
    "sides longer than the gap": (LONG, Pose(z=0.5e-3, turn=(0, 0, 0.3))),
    "upright": (COIL, Pose(8e-3, 0, 20e-3, (math.pi / 2, 0, 0))),
}  # fmt: skip


@pytest.mark.parametrize(("coil", "pose"), CASES.values(), ids=CASES)
def test_close_and_wide_windings(coil, pose):
    """Where few turns or two filaments do not stand for a winding, its bars are summed."""
    paths = coil.conductors() if isinstance(coil, Spiral) else [coil]
    largest = inductance_matrix(paths, allow_overlaps=True).max()
    found = moved_inductance(paths, paths, pose)[0]
    exact = mutual_inductance(paths, [path.posed(pose) for path in paths])
    np.testing.assert_allclose(found, exact, rtol=0, atol=STATED * largest)


def test_square_bars_at_a_distance():
    """Rings of wire by Maxwell's formula: the centre lines, as a square section is harmonic to the fourth order."""
    ring, _ = loop_pair(20e-3, 0.1, 1e-3)
    ring = ring.posed(Pose(z=-0.05))
    heights = np.array([3e-3, 5e-3, 10e-3, 30e-3])
    found = moved_inductance(ring, ring, [Pose(z=z) for z in heights])[:, 0, 0]
    k2 = 4 * 20e-3**2 / (4 * 20e-3**2 + heights**2)
    expected = MU_0 * 20e-3 * ((2 / np.sqrt(k2) - np.sqrt(k2)) * ellipk(k2) - 2 / np.sqrt(k2) * ellipe(k2))
    largest = inductance_matrix(ring, allow_overlaps=True)[0, 0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-4 * largest)  # 72 chords and the finite section


def test_overlapping_filaments_are_refused():
    square = np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0], [0, 0, 0]])
    for shift in (0.0, 0.01):
        with pytest.raises(GeometryError, match="overlap"):
            moved_inductance([square], [square], Pose(x=shift))


@pytest.mark.parametrize("poses", [[None], np.zeros(3), "xyz"])
def test_poses_that_are_none_are_named(poses):
    with pytest.raises(GeometryError, match="poses must be one Pose or more; got"):
        moved_inductance(COIL, COIL, poses)


def test_tilted_loops_of_a_helmet():
    """Wide loops nearer to each other than their sides are long, where no side has a series of turns."""
    tilts = [Pose(turn=(0.0, 0.6 * k, 0.3 * k)) for k in range(3)]
    loops = [Conductor(circle(25e-3, 24), 3e-3, 35e-6).posed(Pose(*(0.1 * t.rotation[:, 2]), t.turn)) for t in tilts]
    found = moved_inductance(loops[:1], loops[1:], Pose())[0]
    largest = inductance_matrix(loops[0])[0, 0]
    np.testing.assert_allclose(found, mutual_inductance(loops[:1], loops[1:]), rtol=0, atol=STATED * largest)
