"""Inductance matrices of bars and filaments.

Who checks whom: closed forms and other programs in test_references.py; here the pair rules against a brute-force mean
over both cross-sections, and the identities that every inductance matrix obeys.
"""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support.coil_paths import at_height
from support.references import polygon

from coilarray import coupling_matrix, inductance_matrix, load_design, mutual_inductance, self_inductance
from coilarray.constants import MU_0
from coilarray.electromagnetics import neumann
from coilarray.electromagnetics.inductance import rectangular_bars, straight_filaments
from coilarray.errors import GeometryError
from coilarray.geometry import Conductor, Pose, Spiral

W, T = 0.15e-3, 35e-6
BAR = Conductor([[0, 0, 0], [10e-3, 0, 0]], W, T)


def hexagon(radius=5e-3, z=0.0, centre=(0.0, 0.0)):
    vertices = polygon(6, radius, z, centre=centre)
    vertices[-1, 1] -= 1e-4  # an open loop
    return Conductor(vertices, W, T)


def _brute_force(first, second, n=8):
    """Mean of the filament formula over both cross-sections, four Gauss rules, for single segments."""
    (nodes_w, weights_w), (nodes_t, weights_t) = np.polynomial.legendre.leggauss(n), np.polynomial.legendre.leggauss(3)

    def strands(bar):
        start, end = bar.vertices
        along = (end - start) / np.linalg.norm(end - start)
        lateral = bar.across[0]
        for u, weight_u in zip(nodes_w, weights_w, strict=True):
            for v, weight_v in zip(nodes_t, weights_t, strict=True):
                offset = u / 2 * bar.widths[0] * lateral + v / 2 * bar.thicknesses[0] * np.cross(along, lateral)
                yield weight_u * weight_v / 4, start + offset, end + offset

    return sum(p * q * straight_filaments(*a, *b) for p, *a in strands(first) for q, *b in strands(second))


@pytest.mark.parametrize(("start", "end"), [
    ([1e-3, 0.3e-3, 0], [9e-3, 0.3e-3, 0]),  # the next turn
    ([1e-3, 0.3e-3, 0], [9e-3, 0.33e-3, 0]),  # the next turn of a spiral, slightly tilted
    ([9e-3, 0.6e-3, 0], [1e-3, 0.62e-3, 0]),  # two turns on, the other way
    ([0, 0, 0.25e-3], [10e-3, 0, 0.25e-3]),  # the layer below
    ([2e-3, 3e-3, 0.25e-3], [4e-3, -3e-3, 0.25e-3]),  # a crossing on another layer
    ([10.5e-3, 0.3e-3, 0], [14e-3, 6e-3, 0]),  # round the corner
    ([0, 5e-3, 0], [10e-3, 5e-3, 0]),  # far
])  # fmt: skip
def test_pairs_of_bars_against_a_mean_over_the_cross_sections(start, end):
    second = Conductor([start, end], W, T)
    # the rules are set for 1e-7 across the width and 1e-5 of the thickness' own 1 %
    assert pytest.approx(_brute_force(BAR, second), rel=1e-6) == mutual_inductance(BAR, second)[0, 0]


@pytest.mark.parametrize(("shift", "sense", "rel"), [
    # the rules are set for 1e-7 across the width and 1e-5 of the thickness' own 1 %
    (0.16e-3, 1, 3e-7), (0.2e-3, 1, 3e-7), (0.3e-3, 1, 3e-7), (0.6e-3, 1, 3e-7), (1.5e-3, 1, 3e-7), (3e-3, 1, 3e-7),
    # bars that touch use the exact integral
    (W, 1, 1e-10), (W / 2, 1, 1e-10), (W / 2, -1, 1e-10), (0.0, 1, 1e-10),
])  # fmt: skip
def test_parallel_bars_against_the_exact_integral(shift, sense, rel):
    second = Conductor([[0, shift, 0], [10e-3, shift, 0]][::sense], W, T)
    exact = sense * rectangular_bars((10e-3, W, T), (10e-3, W, T), (0, shift, 0))
    assert mutual_inductance(BAR, second)[0, 0] == pytest.approx(exact, rel=rel)


@pytest.mark.parametrize(("w1", "w2"), [(1e-3, 0.2e-3), (1e-3, 0.5e-3), (0.2e-3, 0.1e-3)])
@pytest.mark.parametrize("place", [(0.0, 0.1e-3), (0.3e-3, 0.0), (0.0, 0.0), (0.4e-3, 0.25e-3), (2.5e-3, 0.1e-3)])
def test_parallel_bars_of_different_width(w1, w2, place):
    y, z = place
    first = Conductor(BAR.vertices, w1, T)
    second = Conductor([[2e-3, y, z], [8e-3, y, z]], w2, T)
    # from corner to corner, where the bars' middle lines are y apart
    exact = rectangular_bars((10e-3, w1, T), (6e-3, w2, T), (2e-3, y + w1 / 2 - w2 / 2, z))
    # side by side and beyond their size the thickness is two nodes: 1e-6 of the pair
    assert mutual_inductance(first, second)[0, 0] == pytest.approx(exact, rel=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "height"), [(9.0, 0.1e-3), (4.0, 0.2e-3), (30.0, 0.1e-3)])
def test_wide_bars_that_cross_on_another_layer(degrees, height):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    first = Conductor([[-5e-3, 0, 0], [5e-3, 0, 0]], 1e-3, T)
    second = Conductor([[-5e-3 * c, -5e-3 * s, height], [5e-3 * c, 5e-3 * s, height]], 1e-3, T)
    # an error of the rule or of the brute force: both see a singularity a tenth of the width away
    assert mutual_inductance(first, second)[0, 0] == pytest.approx(_brute_force(first, second, 20), rel=1e-5)


def test_a_cut_trace_has_the_inductance_of_the_whole():
    cut = Conductor([[0, 0, 0], [3e-3, 0, 0], [3.7e-3, 0, 0], [10e-3, 0, 0]], W, T)
    # collinear pieces meet end to end: exact bars, to the quadrature's 1e-11
    assert self_inductance(cut)[0] == pytest.approx(self_inductance(BAR)[0], rel=1e-9)


def test_reuse_of_equal_pairs_changes_nothing(monkeypatch):
    array = load_design("starter").array
    summed = []
    for name in ("_own_sum", "_pair_sum"):
        original = getattr(neumann, name)
        monkeypatch.setattr(neumann, name, lambda *rest, sum_=original: summed.append(sum_) or sum_(*rest))
    monkeypatch.setattr(neumann, "_BLOCKS_A_PAIR", 1)
    monkeypatch.setattr(neumann, "MOST_NODES", 0)  # none by equivalent currents
    reused = inductance_matrix(array)
    # alone: a layer and the via with itself, and the two layers; neighbours: the upper layers, which lie as the lower
    # ones and as those of the neighbours on the other side, and on either side the two other pairs and the vias; next
    # but one: the upper layers, the two other pairs, the vias
    assert len(summed) == 3 + (1 + 2 * 3) + 4
    # the same coils an offset of 1 nm away share nothing
    paths = [replace(c, vertices=np.add(c.vertices, [0, 0, 1e-9 * k * k])) for k, c in enumerate(array.conductors())]
    # a shift of 1 nm changes neighbours' M by about 1e-6
    np.testing.assert_allclose(inductance_matrix(paths), reused, rtol=3e-6)


def test_direction_and_order():
    a, b = hexagon(), hexagon(4e-3, 1e-3, (3e-3, 1e-3))
    M = mutual_inductance(a, b)[0, 0]
    turned = Conductor(b.vertices[::-1], b.widths, b.thicknesses)
    assert mutual_inductance(a, turned)[0, 0] == pytest.approx(-M, rel=1e-12)
    # the two orders of one pair use the rules with the parts exchanged
    assert mutual_inductance(b, a)[0, 0] == pytest.approx(M, rel=1e-9)
    assert self_inductance(turned)[0] == pytest.approx(self_inductance(b)[0], rel=1e-9)


shifts = st.floats(-0.02, 0.02)


@pytest.mark.slow
@settings(max_examples=25)
@given(st.floats(0, 6.28), shifts, shifts, shifts)
def test_rotation_and_translation(angle, x, y, z):
    paths = [hexagon(), hexagon(4e-3, 1e-3, (3e-3, 1e-3)), hexagon(5e-3, -1e-3, (-7e-3, 2e-3))]
    L = inductance_matrix(paths)
    turn = Rotation.from_euler("z", angle)
    moved = [replace(p, vertices=np.add(turn.apply(p.vertices.copy()), [x, y, z])) for p in paths]
    # rounding of coordinates; the choice between rules may fall otherwise at its edge, where they agree to 1e-7
    np.testing.assert_allclose(inductance_matrix(moved), L, rtol=1e-7, atol=1e-7 * L.max())


@pytest.mark.parametrize("scale", [1e-12, 1e-6, 0.3, 1e6])
def test_scales_with_length_however_small(scale):
    unit, scaled = (
        inductance_matrix([Conductor(hexagon(1.0, z).vertices * size, 0.03 * size, 1e-2 * size) for z in (0.0, 0.5)])
        for size in (1.0, scale)
    )
    np.testing.assert_allclose(scaled, scale * unit, rtol=1e-12)  # the same sums, rounded otherwise


def test_a_coil_far_away_changes_nothing_for_those_near():
    # what counts as the same shape and place must not grow with the distance: these radii differ by 3e-4
    near = [hexagon(5e-3), hexagon(5.0015e-3), hexagon(5e-3, 2e-3), hexagon(5e-3, 2.001e-3)]
    alone = mutual_inductance(near, near)  # they lie in each other's copper, which a matrix refuses
    assert abs(alone[0, 2] / alone[0, 3] - 1) > 1e-4
    for away in (1e3, 1e7, 1e9):
        every = [*near, hexagon(centre=(away, 0))]
        together = mutual_inductance(every, every)[:4, :4]
        np.testing.assert_allclose(together, alone, rtol=1e-7)  # 1e-8 of a coil's size is the same at most


def _filaments_in_many_digits(*ends):
    """Campbell's formula for two filaments that are not parallel, in H, with 60 digits."""
    with mpmath.workdps(60):
        p1, p2, q1, q2 = (np.array([mpmath.mpf(float(value)) for value in point]) for point in ends)

        def norm(a):
            return mpmath.sqrt(a @ a)

        def potential(x, start, end):
            both, length = norm(x - start) + norm(x - end), norm(end - start)
            return mpmath.log((both + length) / (both - length))

        l1, l2 = norm(p2 - p1), norm(q2 - q1)
        u, v, d = (p2 - p1) / l1, (q2 - q1) / l2, q1 - p1
        w, cosine = np.cross(u, v), u @ v
        sine2, sine = w @ w, norm(w)
        foot_1, foot_2, height = np.cross(d, v) @ w / sine2, np.cross(d, u) @ w / sine2, abs(d @ w) / sine
        a, b = (-foot_1, l1 - foot_1), (-foot_2, l2 - foot_2)
        total = a[1] * potential(p2, q1, q2) - a[0] * potential(p1, q1, q2)
        total += b[1] * potential(q2, p1, p2) - b[0] * potential(q1, p1, p2)
        for i, p in enumerate((p1, p2)):
            for j, q in enumerate((q1, q2)):
                angle = mpmath.atan2(height**2 * cosine + a[i] * b[j] * sine2, height * sine * norm(p - q))
                total -= (1 if i == j else -1) * height / sine * angle
        return float(MU_0 / (4 * mpmath.pi) * cosine * total)


@pytest.mark.parametrize("ratio", [1.0, 1e-3])
@pytest.mark.parametrize("height", [1e-6, 1e-2])
@pytest.mark.parametrize("angle", [1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1.0])
def test_filaments_that_cross_at_a_small_angle(angle, height, ratio):
    # just above each other, in their middles; a short one is a thousandth of the other
    along = 0.5 * ratio * np.array([np.cos(angle), np.sin(angle), 0])
    centre = np.array([0.4, 0, height])
    ends = [0, 0, 0], [1, 0, 0], centre - along, centre + along
    # the skew form errs like 1e-17/sin²: up to 1e-8 where the panels take over, 1e-9 at the angles here
    expected = _filaments_in_many_digits(*ends)
    assert straight_filaments(*ends) == pytest.approx(expected, rel=1e-9)
    assert straight_filaments(ends[0], ends[1], ends[3], ends[2]) == pytest.approx(-expected, rel=1e-9)


def test_the_matrix_of_the_board_is_symmetric_and_positive_definite():
    L = inductance_matrix(load_design("gast2020").array)
    np.testing.assert_array_equal(L, L.T)
    assert (np.linalg.eigvalsh(L) > 0).all()
    assert (np.abs(coupling_matrix(L) - np.eye(6)) < 1).all()
    # the board is its own mirror image but for the winding: equal self-inductance to the last digits
    np.testing.assert_allclose(np.diag(L), L[0, 0], rtol=1e-12)


@pytest.mark.slow
@settings(max_examples=20)
@given(st.lists(st.tuples(shifts, shifts, st.floats(0.001, 0.02)), min_size=1, max_size=4))
def test_positive_definite_for_any_placement(places):
    L = inductance_matrix([hexagon(z=k * 5e-3 + z, centre=(x, y)) for k, (x, y, z) in enumerate(places)])
    assert np.linalg.eigvalsh(L).min() > 0


def test_series_connection_adds():
    # one path of two layers against the sum over its pieces
    spiral = Spiral(6, 10e-3, 4, W, W)
    upper, lower = at_height(spiral.centre_line(0), 0.0), at_height(spiral.centre_line(1), -0.5e-3)
    pieces = [Conductor(upper, W, T), Conductor(np.vstack((upper[-1:], lower[:1])), W, W), Conductor(lower, W, T)]
    sizes = (np.concatenate([getattr(piece, size) for piece in pieces]) for size in ("widths", "thicknesses"))
    whole = Conductor(np.vstack((upper, lower)), *sizes)
    # pairs within a path keep their cross-section further out than pairs of two paths
    assert self_inductance(whole)[0] == pytest.approx(inductance_matrix(pieces).sum(), rel=2e-5)


def test_wide_trace_against_the_current_sheet_limit():
    # a long flat strip: L = µ0 l/2π (ln(2l/w) + 1/2), Terman 1943, to the order (w/l)
    length, width = 1.0, 1e-3
    L = self_inductance(Conductor([[0, 0, 0], [length, 0, 0]], width, 1e-9))[0]
    expected = MU_0 * length / (2 * np.pi) * (np.log(2 * length / width) + 0.5)
    assert pytest.approx(expected, rel=2 * width / length) == L


@pytest.mark.parametrize(("call", "message"), [
    (lambda: inductance_matrix([[[0, 0, 0], [1, 0, 0]]]), "the self-inductance of a thin filament is infinite"),
    (lambda: self_inductance(np.array([[0, 0, 0], [1, 0, 0.0]])), "path 1 has segments without a cross-section"),
    (lambda: straight_filaments([0, 0, 0], [1, 0, 0], [0.5, 0, 0], [2, 0, 0]), "overlap on one line"),
    (lambda: straight_filaments([0, 0, 0], [0, 0, 0], [0.5, 0, 0], [2, 0, 0]), "the first filament has length"),
    (lambda: mutual_inductance([[[0, 0, 0], [1, 0, 0]]], [[[0, 0, 0], [1, 0, 0]]]), "path 1 and path 1 overlap"),
    (lambda: rectangular_bars((1, 0, 1)), "length, width and thickness of a bar must be positive"),
    (lambda: rectangular_bars((1, 1, 1), offset=(np.nan, 0, 0)), "offset between two bars must be finite"),
    (lambda: Conductor([[0, 0, 0], [1, 0, 0]], -1.0, 1.0), "widths of path must be finite and not negative"),
    (lambda: Conductor([[0, 0, 0], [1, 0, 0]], 1.0, 0.0), "both zero or both positive"),
    (lambda: Conductor([[0, 0, 0], [1, 0, 0]], [1.0, 2.0], 1.0), "widths of path must be one number or 1"),
    (lambda: inductance_matrix(hexagon(), accuracy="fast"), "accuracy must be one of full, screen; got 'fast'"),
    (lambda: mutual_inductance(hexagon(), hexagon(z=1e-3), accuracy="fast"), "accuracy must be one of full"),
    (lambda: straight_filaments([0, 0, 0], [1, 2, 3], [0.5, 1, 1.5], [2, 4, 6]), "overlap on one line"),
    (lambda: straight_filaments([0, 0, 0], [1, 2, 3], [2, 4, 6], [0.5, 1, 1.5]), "overlap on one line"),
    (lambda: rectangular_bars((1e200, 1, 1)), "length, width and thickness of a bar must be positive"),
    (lambda: rectangular_bars((1, 1e-200, 1)), "length, width and thickness of a bar must be positive"),
    (lambda: rectangular_bars((1, 1)), "length, width and thickness of a bar must be positive"),
    (lambda: rectangular_bars((1, 1, 1), offset=(0, 0, 1e200)), "offset between two bars must be finite"),
    (lambda: Conductor([[0, 0, 0], [1e200, 0, 0]]), "vertices of path must be at most"),
    (lambda: Conductor([[0, 0, 0], [1e-60, 0, 0]]), "segment 0 of path has length zero"),
    (lambda: Conductor([[0, 0, 0], [1, 0, 0]], 1e-200, 1.0), "widths of path must be zero or 1e-30 to"),
])  # fmt: skip
def test_bad_input(call, message):
    with pytest.raises(GeometryError, match=message):
        call()


def test_bad_matrices():
    for matrix, message in (([[1.0, 0.0]], "square"), ([[np.inf]], "be finite"), ([[-1.0]], "self-inductance must be")):
        with pytest.raises(ValueError, match=message):
            coupling_matrix(matrix)


TILTS = {"in a plane": (0.0, 0.0, 0.5), "tilted": (0.6, 0.0, 0.5), "steep": (1.2, 0.3, 0.7)}


@pytest.mark.parametrize("turn", TILTS.values(), ids=TILTS)
@pytest.mark.parametrize(("distance", "rel"), [(1.6e-3, 5e-6), (5.5e-3, 5e-6), (9e-3, 5e-4)])
def test_thick_bars_at_an_angle(turn, distance, rel):
    """Square bars near each other by four nodes of their thicknesses, and as their middles from 6 sides on.

    There the mean over a square differs from the middle by the ends of the bars only, which closed paths do not have.
    """
    first = Conductor([[0, 0, 0], [20e-3, 0, 0]], 1e-3, 1e-3)
    second = Conductor([[-8e-3, 0, 0], [9e-3, 0, 0]], 1e-3, 1e-3).posed(Pose(10e-3, 0, distance, turn))
    assert mutual_inductance(first, second)[0, 0] == pytest.approx(_brute_force(first, second), rel=rel)
