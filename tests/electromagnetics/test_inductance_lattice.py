"""Large arrays: equivalent currents against sums over segments, and the matrix of a lattice."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.coil_paths import spiral_path

from coilarray import Conductor, inductance_matrix, load_design, mutual_inductance
from coilarray.electromagnetics.kernels.paths import mutual_sum
from coilarray.electromagnetics.neumann import (
    MOST_NODES,
    MUTUAL_NEAR_WIDTHS,
    bounding_boxes,
    equivalent_currents,
    nodes_needed,
    segment_table,
)
from coilarray.geometry import Spiral

WINDING = load_design("gast2020").array.conductors()[0]
PITCH = 13.28e-3


def moved(shift=(0.0, 0.0, 0.0), angle=0.0):
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    vertices = (WINDING.vertices - WINDING.vertices[0]) @ turn.T + shift
    return Conductor(vertices, WINDING.widths, WINDING.thicknesses, WINDING.areas)


ORIGIN = moved()
L = float(inductance_matrix(ORIGIN)[0, 0])


def by_segments(first, second, reach=0.0):
    """Centre lines alone, as the nodes of this winding of 230 widths; what the width adds is tested below."""
    a, b = segment_table(first), segment_table(second)
    return 1e-7 * mutual_sum(a, b, second.vertices[0] - first.vertices[0], 0, len(a), reach, 0)


def sides(path):
    return np.stack((path.vertices[:-1], path.vertices[1:]), axis=1)


def needed(first, second):
    a, b = bounding_boxes([first.vertices]), bounding_boxes([second.vertices])
    return nodes_needed(a, b, np.zeros((1, 3)))[0]


def by_nodes(first, second, count, count_z):
    (p, a), (q, b) = (equivalent_currents(sides(path), count, count_z) for path in (first, second))
    return 1e-7 * np.sum(a @ b.T / np.linalg.norm(p[:, None] - q, axis=2))


@pytest.mark.slow
@settings(max_examples=25)
@given(st.floats(0, 2 * np.pi), st.floats(0, np.pi / 2), st.floats(24e-3, 200e-3), st.floats(0, 2 * np.pi))
def test_equivalent_currents_against_segments(azimuth, elevation, distance, angle):
    level = distance * np.cos(elevation)
    other = moved((level * np.cos(azimuth), level * np.sin(azimuth), distance * np.sin(elevation)), angle)
    counts = needed(ORIGIN, other)
    if counts.max() > MOST_NODES:
        return  # these are summed by segments
    # 3e-8 of L is what the package promises; measured 2.4e-8 above each other, where two nodes across just suffice
    assert by_nodes(ORIGIN, other, *counts) == pytest.approx(by_segments(ORIGIN, other), abs=3e-8 * L, rel=0)


@pytest.mark.parametrize("shift", [(2 * PITCH, 0, 0), (0, 30e-3, 0), (0, 0, 20e-3)])
def test_more_nodes_converge_geometrically(shift):
    other = moved(shift)
    exact = by_segments(ORIGIN, other)
    errors = [abs(by_nodes(ORIGIN, other, n, 4) - exact) / L for n in (4, 6, 8, 10, 12)]
    # ρ ≥ 1.5 along every side: four times less for two nodes more in both paths, until the rules of the sum over
    # segments are reached, 1e-9
    assert all(after < max(before / 2, 2e-9) for before, after in itertools.pairwise(errors[1:]))
    assert errors[-1] < errors[0] / 100


@pytest.mark.parametrize("widths", [13, 53, 107])
@pytest.mark.parametrize("apart", [1.9, 2.4, 4.0])
def test_widths_of_small_windings_count_from_afar(widths, apart):
    # square coils of two layers beside each other, so that sides of one are parallel to those of the other
    width = 0.15e-3
    spiral = Spiral(4, widths * width, min(widths // 8 + 1, 10), width, 0.15e-3 if widths > 20 else 0.05e-3)
    coil = spiral_path(spiral, (0.0, -0.2e-3))
    shift = np.array([apart * widths * width, 0.0, 0.0])
    both = inductance_matrix([coil, Conductor(coil.vertices + shift, width, 35e-6)])
    assert needed(coil, Conductor(coil.vertices + shift)).max() <= MOST_NODES
    table = segment_table(coil)
    exact, centre_lines = (1e-7 * mutual_sum(table, table, shift, 0, len(table), reach, 4) for reach in (1e9, 0.0))
    # two lines a bar leave terms of the fourth order in width over distance: measured 1.4e-7 for 13 widths; at 107
    # widths the nearest pair is summed by segments
    assert both[0, 1] == pytest.approx(exact, abs=2e-7 * both[0, 0], rel=0)
    if apart == 1.9 and widths < 100:
        assert abs(centre_lines - exact) > 2.5e-7 * both[0, 0]  # which the lines alone would leave out


def test_a_flat_path_needs_one_node_across():
    square = Conductor([[0, 0, 0], [1e-2, 0, 0], [1e-2, 1e-2, 0], [0, 1e-2, 0], [0, 1e-4, 0]])
    far = Conductor(square.vertices + np.array([0.03, 0.01, 0.0]))
    assert needed(square, far)[1] == 1
    # three nodes a side would do for 1e-3; 16 nodes leave rounding
    assert by_nodes(square, far, 16, 1) == pytest.approx(by_segments(square, far), rel=1e-9)


def test_overlapping_boxes_are_never_interpolated():
    for shift in ((0, 0, 0), (PITCH, 0, 0), (0, 0, 1e-3), (20e-3, 0, 0)):
        assert needed(ORIGIN, moved(shift)).max() > MOST_NODES


def _lattice(rows):
    """Hexagonal, on three heights so that no neighbours share copper."""
    return [
        moved(((c + 0.5 * (r % 2)) * PITCH, r * PITCH * np.sqrt(0.75), -0.5e-3 * ((c - r // 2 - r) % 3)))
        for r in range(rows)
        for c in range(rows)
    ]


@pytest.mark.slow
def test_matrix_of_a_lattice():
    coils = _lattice(8)
    M = inductance_matrix(coils, allow_overlaps=True)  # next but one share copper
    np.testing.assert_array_equal(M, M.T)
    # equal shapes have equal self-inductances to the last digit: they are computed once
    assert (np.diag(M) == M[0, 0]).all()
    assert M[0, 0] == pytest.approx(L, rel=1e-12)
    assert np.linalg.eigvalsh(M)[0] > 0  # stored energy is positive for every set of currents
    for i, j in np.random.default_rng(3).integers(0, len(coils), (12, 2)).tolist():
        if i != j:
            # 3e-8 for what is far, 1e-9 for what is near: the two ways round differ by the rules along segments
            near_widths = MUTUAL_NEAR_WIDTHS if needed(coils[i], coils[j]).max() > MOST_NODES else 0.0
            assert M[i, j] == pytest.approx(by_segments(coils[i], coils[j], near_widths), abs=3e-8 * L)


@pytest.mark.slow
def test_turned_copies():
    rng = np.random.default_rng(4)
    coils = [moved((30e-3 * k, 28e-3 * m, 0), rng.uniform(0, 6)) for k in range(3) for m in range(3)]
    M = inductance_matrix(coils, allow_overlaps=True)  # leads cross turns beside them
    # turning a path changes its self-inductance by the rules' error alone
    np.testing.assert_allclose(np.diag(M), L, rtol=1e-6)
    np.testing.assert_allclose(mutual_inductance(coils[:2], coils[2:]), M[:2, 2:], atol=3e-8 * L)
