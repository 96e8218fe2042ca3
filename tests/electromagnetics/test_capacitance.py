"""Capacitance of strips in layered dielectrics and of coils.

Who checks whom: strips against finite elements and closed forms (tables in references/), plates with fringing in
closed form, exact scaling and sum rules, and their own convergence; coils against rings of charge in free space (no
code in common), series formulas, and the limits of the areas that overlap.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ellipk
from support.parallel_traces import interlayer_capacitance
from support.patience import lasting
from support.references import rows

from coilarray import load_design
from coilarray.constants import EPSILON_0
from coilarray.electromagnetics import capacitance as module
from coilarray.electromagnetics.capacitance import coil_capacitance, elastomer_effect, self_resonance
from coilarray.electromagnetics.layered_strips import LayeredMedium, crossed_grid_capacitance, strip_capacitance
from coilarray.errors import GeometryError
from coilarray.geometry import Array, Placement, PlatedHole, Sheet, Spiral, Stackup, path_coil

MM = 1e-3
VIA = PlatedHole(0.2e-3, 0.45e-3)
AIR = LayeredMedium((), (1.0, 1.0))


def _numbers(table):
    return [{key: float(value) for key, value in row.items()} for row in rows(table)]


@pytest.mark.parametrize("v", _numbers("capacitance_interlayer"))
def test_interlayer_against_finite_elements(v):
    w, s, h, t = (v[key] * MM for key in ("w_mm", "s_mm", "h_mm", "t_mm"))
    C = interlayer_capacitance(w, s, h, v["eps_r"], t) * 1e12
    # 1.3 %: the charge on the side walls is left out, which only lowers C (by 1.1 % where t/h is largest)
    assert 0.987 * v["C_pF_per_m"] < C < 1.0001 * v["C_pF_per_m"]
    # without thickness the upper face and its neighbourhood is missing too: 2.6 %
    assert interlayer_capacitance(w, s, h, v["eps_r"]) * 1e12 == pytest.approx(v["C_pF_per_m"], rel=0.026)


@pytest.mark.parametrize("v", _numbers("capacitance_coplanar_strips"))
def test_coplanar_strips_against_the_closed_form(v):
    w, s = v["w_mm"] * MM, v["s_mm"] * MM
    period = 40 * (2 * w + s)

    def pair(epsilon_below):
        medium = LayeredMedium((), (1.0, epsilon_below))
        return -strip_capacitance(medium, [0, 0], [-(w + s) / 2, (w + s) / 2], [w, w], period=period)[0, 1] * 1e12

    # 1e-3: the field of the images, π²/3 · (mean distance of the charges/period)², changes C by less than this; the
    # cutoff leaves less still
    assert pair(1.0) == pytest.approx(v["C_air_pF_per_m"], rel=1e-3)
    assert pair(4.5) == pytest.approx(v["C_halfspace_er4.5_pF_per_m"], rel=1e-3)


@settings(max_examples=10)
@given(k=st.floats(1, 1e6), data=st.data())
def test_green_function_is_the_inverse_of_the_tridiagonal_matrix(k, data):
    d = data.draw(st.lists(st.floats(1e-5, 1e-2), min_size=1, max_size=4))
    epsilon = data.draw(st.lists(st.floats(1, 10), min_size=len(d) + 2, max_size=len(d) + 2))
    Y = np.zeros((len(d) + 1,) * 2)
    Y[0, 0], Y[-1, -1] = epsilon[0], epsilon[-1]
    for i, (thickness, e) in enumerate(zip(d, epsilon[1:-1], strict=True)):
        x = min(k * thickness, 300.0)
        Y[i : i + 2, i : i + 2] += e * np.array([[1 / np.tanh(x), -1 / np.sinh(x)], [-1 / np.sinh(x), 1 / np.tanh(x)]])
    G = LayeredMedium(tuple(d), tuple(epsilon)).green(np.array([k]))[0]
    # 1e-5: at k = 1/m Y is nearly singular, and its inverse loses ten digits that the recursion keeps
    np.testing.assert_allclose(G, np.linalg.inv(EPSILON_0 * k * Y), rtol=1e-5, atol=1e-9 * G.max())


@pytest.mark.parametrize("b_over_d", [10, 20, 40])
def test_wide_strips_are_plates_with_fringing(b_over_d):
    d, b = 0.1e-3, 0.1e-3 * b_over_d
    medium = LayeredMedium((d,), (1.0, 1.0, 1.0))
    C = strip_capacitance(medium, [0, 1], [0, 0], [b, b], period=20 * b, basis=20)[0, 0]
    # Palmer, Trans. AIEE 56, 363 (1937): error of the order (d/b)² ln² relative; images of the line dipole less
    plate = EPSILON_0 * (b / d + (1 + math.log(2 * math.pi * b / d)) / math.pi)
    assert pytest.approx(plate, rel=(math.log(b_over_d) / b_over_d) ** 2 / math.pi**2 + 5e-4) == C


def test_narrow_gaps_make_a_solid_plate():
    C = interlayer_capacitance(0.29e-3, 0.01e-3, 0.2e-3, 4.5, basis=12)
    # 1 %: the slots, 5 % of the height wide, let a little field through
    assert pytest.approx(4.5 * EPSILON_0 * 0.3e-3 / 0.2e-3, rel=0.01) == C


@settings(max_examples=15)
@given(epsilon=st.floats(1, 12), size=st.floats(0.05, 20))
def test_capacitance_scales_with_permittivity_not_with_size(epsilon, size):
    planes, x, w = [0, 0, 1], np.array([-0.2, 0.25, 0.1]) * MM, np.array([0.2, 0.3, 0.25]) * MM
    unit = strip_capacitance(LayeredMedium((0.2e-3,), (1, 1, 1)), planes, x, w, period=4 * MM)
    medium = LayeredMedium((0.2e-3 * size,), (epsilon,) * 3)
    scaled = strip_capacitance(medium, planes, x * size, w * size, period=4 * MM * size)
    # 1e-4: exact but for a wavenumber more or less at the cutoff, where rounding decides
    np.testing.assert_allclose(scaled, epsilon * unit, rtol=1e-4)


def test_matrix_is_symmetric_and_rows_sum_to_zero():
    planes, x, w = [0, 0, 1, 1], np.array([0.2, 0.5, 0.25, 0.6]) * MM, np.full(4, 0.15 * MM)
    open_space = LayeredMedium((0.2e-3,), (1, 4.5, 1))
    C = strip_capacitance(open_space, planes, x, w, period=5 * MM)
    np.testing.assert_array_equal(C, C.T)
    np.testing.assert_allclose(C.sum(axis=1), 0, atol=1e-12 * C.max())  # neutral, up to rounding
    assert (C[~np.eye(4, dtype=bool)] < 0).all()


def test_strips_mirrored_are_strips_doubled():
    x, w = np.array([0.4, 0.7]) * MM, np.array([0.2, 0.2]) * MM
    half = strip_capacitance(AIR, [0, 0], x, w, period=2 * MM, mirror=True)
    both = strip_capacitance(AIR, [0] * 4, [*x, *-x], [*w, *w], [0, 1, 0, 1], period=4 * MM)
    np.testing.assert_allclose(both, 2 * half, rtol=1e-10)  # the same sums, split


def test_a_shift_of_all_strips_changes_nothing():
    medium = LayeredMedium((0.1e-3,), (1, 4.5, 2))
    x, w = np.array([0.0, 0.3, 0.1]) * MM, np.array([0.2, 0.1, 0.3]) * MM
    first, second = (strip_capacitance(medium, [0, 0, 1], x + d, w, period=1 * MM) for d in (0, 0.37e-3))
    np.testing.assert_allclose(first, second, rtol=1e-10)


def test_convergence_with_the_basis():
    medium, w = LayeredMedium((0.1e-3,), (1, 4.5, 1)), [0.3e-3] * 2
    values = [strip_capacitance(medium, [0, 1], [0, 0], w, period=5e-4, basis=b, cutoff=2e7)[0, 0] for b in (1, 3, 9)]
    errors = np.abs(np.array(values[:2]) / values[2] - 1)
    assert errors[0] > 0.01  # one function is not enough for a trace three times as wide as its distance
    assert errors[1] < 1e-5  # the default, three, is: its error is the square of that of the charge density
    by_default = interlayer_capacitance(0.3e-3, 0.2e-3, 0.1e-3, 4.5)
    assert by_default == pytest.approx(values[2], rel=1e-3)  # what the default cutoff leaves, see below


def test_convergence_with_the_harmonics_is_of_second_order():
    """The tail is added in its first asymptotic term, so the next one is left: (ka)⁻²."""
    medium = LayeredMedium((), (1.0, 4.5))
    x, w = [-0.1e-3, 0.1e-3], [0.12e-3] * 2

    def value(ka):
        return -strip_capacitance(medium, [0, 0], x, w, period=4e-3, cutoff=ka / 0.06e-3)[0, 1]

    exact = value(3000)
    # the term oscillates with cos 2ka: take the largest of a period
    coarse, fine = (max(abs(value(ka + d) / exact - 1) for d in np.linspace(0, 3, 8)) for ka in (10, 160))
    assert 1.6 < math.log(coarse / fine) / math.log(16) < 2.4  # 2 predicted; the maximum is sampled
    assert coarse < 3e-3


def test_crossed_grids_are_the_mean_over_the_shift_of_parallel_ones():
    medium = LayeredMedium((0.15e-3,), (1.0, 4.5, 1.0))
    w, p = 0.15e-3, 0.3e-3
    mean = np.mean([interlayer_capacitance(w, p - w, 0.15e-3, 4.5, offset=p * i / 8) for i in range(8)])
    C = crossed_grid_capacitance(medium, [0, 1], [w, w], [p, p], [0, 1], [0, 1])
    # exp(−4πh/p) = 2e-3 of the harmonics' part is what comes back
    assert -C[0, 1] * p == pytest.approx(mean, rel=2e-3)
    np.testing.assert_allclose(C.sum(axis=1), 0, atol=1e-9 * C[0, 0])


def _board(layers, h=0.2e-3, epsilon=4.5, copper=35e-6):
    return Stackup(tuple("ABCDEF"[:layers]), (copper,) * layers, (h,) * (layers - 1), (epsilon,) * (layers - 1))


def _one(layers, spiral, **board):
    coil = replace(spiral, layers=layers, via=VIA, leads=None).coil()
    return Array(_board(layers, **board), (Placement("c", coil, tuple("ABCDEF"[:layers]), 0.0, 0.0),))


def _winding(array):
    """Capacitance of the first coil alone, in air."""
    return module._winding(array.stackup, array.placements[0], ((), (1.0,)))


HEXAGON = Spiral(6, 16e-3, 20, 0.15e-3, 0.15e-3)


def test_two_facing_layers_joined_inside_are_a_third():
    array = _one(2, HEXAGON)
    winding = _winding(array)
    facing = -winding.layers[0, 1]
    # 3 %: beyond the formula, the outer edge's fringing carries the full voltage (0.44 h of 6 mm, threefold)
    assert winding.interlayer == pytest.approx(facing / 3, rel=0.03)
    length = np.hypot(*np.diff(np.vstack(array.placements[0].coil.lines), axis=0).T).sum() / 2
    per_length = np.mean([interlayer_capacitance(0.15e-3, 0.15e-3, 0.2e-3, 4.5, 35e-6, offset=o) for o in (0, 1.5e-4)])
    # 6 %: fringing at the two edges of the winding, 2 · 0.44 h of 6 mm and more at this open copper
    assert facing == pytest.approx(per_length * length, rel=0.06)
    assert winding.turn_to_turn < 0.05 * winding.total


@pytest.mark.slow
@pytest.mark.parametrize("n", [2, 3, 4])
def test_layers_in_series(n):
    """Every pair of layers has the mean square of its voltage; for adjacent ones alone that is Zolfaghari's formula."""
    closed = Spiral(6, 16e-3, 20, 0.26e-3, 0.04e-3)
    s = np.linspace(0, 1, 1001)  # along a layer, from outside to inside
    V = np.array([(i + (s if i % 2 == 0 else 1 - s)) / n for i in range(n)])
    for spiral in (closed, HEXAGON):
        winding = _winding(_one(n, spiral, h=0.1e-3))
        pairs = sum(-winding.layers[i, j] * np.trapezoid((V[i] - V[j]) ** 2, s) for i in range(n) for j in range(i))
        # 4 %: beyond both formulas, the fringing at the winding's outer edge has more than the mean voltage
        assert winding.interlayer == pytest.approx(pairs, rel=0.04)
        zolfaghari = -4 * sum(winding.layers[i, i + 1] for i in range(n - 1)) / (3 * n**2)
        if spiral is closed:  # through open copper a layer sees the one after the next: 10 % and more
            assert winding.interlayer == pytest.approx(zolfaghari, rel=0.04)


def _rings(array):
    """Lumped capacitance of a coil in free space from rings of charge, one a turn, as wires of radius w/4."""
    placement = array.placements[0]
    lengths = [np.hypot(*np.diff(line, axis=0).T) for line in placement.coil.lines]
    starts = np.cumsum([0.0, *(length.sum() for length in lengths)])
    radius, height, voltage = [], [], []
    for line, layer, length, start in zip(placement.coil.lines, placement.layers, lengths, starts[:-1], strict=True):
        turns = np.abs(np.unwrap(np.arctan2(line[:, 1], line[:, 0])) - np.arctan2(line[0, 1], line[0, 0])) / 2 / np.pi
        middles = np.arange(round(turns[-1])) + 0.5
        radius += np.interp(middles, turns, np.hypot(*line.T)).tolist()
        voltage += ((start + np.interp(middles, turns, np.append(0, np.cumsum(length)))) / starts[-1]).tolist()
        height += [array.stackup.centre(layer)] * len(middles)
    R, Z, V = np.array(radius), np.array(height), np.array(voltage)
    d = np.where(np.eye(len(R), dtype=bool), placement.coil.trace_width / 4, np.abs(Z[:, None] - Z))
    far = np.hypot(R[:, None] + R, d)
    # potential of a ring of charge q: q K(m)/(2π² ε0 far), m = 4 R R'/far² (Jackson, problem of the charged ring)
    C = np.linalg.inv(ellipk(4 * R[:, None] * R / far**2) / (2 * math.pi**2 * EPSILON_0 * far))
    total = C.sum(axis=1)
    return float(V @ (C - np.outer(total, total) / total.sum()) @ V)


@pytest.mark.slow
@pytest.mark.parametrize(("layers", "h"), [(1, 1.0), (2, 0.5e-3), (2, 1.5e-3)])
def test_coil_in_free_space_against_rings_of_charge(layers, h):
    array = _one(layers, Spiral(64, 40e-3, 20, 0.1e-3, 0.2e-3), h=h, epsilon=1.0, copper=10e-6)
    # 3 %: one row of straight strips and their mirror image stand for rings; the ends of the path fall between rays
    assert _winding(array).total == pytest.approx(_rings(array), rel=0.03)


@pytest.mark.slow
def test_rays_images_and_basis_are_converged(monkeypatch):
    array = load_design("starter").array
    base = _winding(array).total
    # as said in the module
    for name, value, rel in (
        ("_RAYS", (9, 9, 0.0), 2e-3),
        ("_MIRROR_DISTANCE", 4.0, 3e-4),
        ("_basis", lambda *_: 6, 1e-4),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(module, name, value)
            assert _winding(array).total == pytest.approx(base, rel=rel)


@pytest.mark.slow
def test_oblique_cuts_see_the_perpendicular_distances(monkeypatch):
    """Rays cut a square at different angles; the row of strips must be the same."""
    array = _one(2, Spiral(4, 16e-3, 20, 0.15e-3, 0.15e-3))
    five = _winding(array).total
    monkeypatch.setattr(module, "_RAYS", (4, 4, 0.0))
    assert _winding(array).total == pytest.approx(five, rel=0.02)  # other samples of the ends


@pytest.mark.slow
def test_bundled_board():
    C = coil_capacitance(load_design("gast2020").array)
    assert ((C.coil_capacitance > 10e-12) & (C.coil_capacitance < 60e-12)).all()
    np.testing.assert_allclose(C.coil_capacitance, C.interlayer + C.turn_to_turn + C.leads, rtol=1e-12)
    matrix = C.capacitance.values
    np.testing.assert_allclose(matrix, matrix.T, rtol=1e-12)
    assert (matrix[~np.eye(6, dtype=bool)] <= 0).all()
    assert (np.diag(matrix) >= -(matrix.sum(axis=1) - np.diag(matrix)) * (1 - 1e-12)).all()
    apart = np.abs(np.subtract.outer(np.arange(6), np.arange(6)))
    assert (matrix[apart == 1] < -1e-12).all()  # neighbours overlap
    assert (matrix[apart > 1] == 0).all()  # the next ones do not
    assert {C[name].attrs["units"] for name in C.data_vars} == {"F"}
    assert float(C.coil_capacitance[0]) == _winding(load_design("gast2020").array).total


def _pair(turn=0.0, shift=(0.0, 0.0), layers=("A", "B")):
    coil = replace(HEXAGON, layers=1, via=VIA, leads=None).coil()
    places = Placement("one", coil, (layers[0],), 0.0, 0.0), Placement("two", coil, (layers[1],), *shift, rotation=turn)
    return Array(_board(2), places)


@pytest.mark.slow
def test_coils_above_each_other_have_the_capacitance_of_their_area():
    coil = Spiral(64, 16e-3, 20, 0.15e-3, 0.15e-3, layers=1, via=VIA, leads=None).coil()
    placements = (Placement("one", coil, ("A",), 0, 0), Placement("two", coil, ("B",), 0, 0, rotation=0.5))
    C = -coil_capacitance(Array(_board(2), placements)).capacitance.values[0, 1]
    length = np.hypot(*np.diff(coil.lines[0], axis=0).T).sum()
    # 2 %: the ends of the two spirals, turned, do not quite cover each other; mean over the shift, not aligned (0.4 %)
    assert pytest.approx(interlayer_capacitance(0.15e-3, 0.15e-3, 0.2e-3, 4.5, 35e-6) * length, rel=0.02) == C
    turned, straight = (-coil_capacitance(_pair(turn=t)).capacitance.values[0, 1] for t in (math.pi / 6, 0.0))
    dodecagon, hexagon = 12 * math.tan(math.pi / 12), 6 * math.tan(math.pi / 6)
    hole = (2 / 8) ** 2
    expected = (dodecagon - (2 * hexagon - dodecagon) * hole) / (hexagon * (1 - hole))
    # 2 %: the overlap of two hexagons 30° apart is a dodecagon; likewise, nearly, for the holes
    assert turned / straight == pytest.approx(expected, rel=0.02)


@pytest.mark.slow
def test_the_matrix_is_that_of_the_overlap_alone():
    np.testing.assert_array_equal(coil_capacitance(_pair(shift=(20e-3, 0))).capacitance.values, 0)
    first = coil_capacitance(_pair(shift=(10e-3, 0))).capacitance.values[0, 1]
    mirrored = coil_capacitance(_pair(shift=(-10e-3, 0), turn=math.pi)).capacitance.values[0, 1]
    # 2 %: a hexagon is its own image under half a turn, its spiral is not: half a pitch at the edge
    assert first == pytest.approx(mirrored, rel=0.02)
    assert first < 0


@pytest.mark.slow
def test_a_coil_between_two_others_shields():
    coil = replace(HEXAGON, layers=1, via=VIA, leads=None).coil()
    three = tuple(Placement(layer, coil, (layer,), 0, 0) for layer in "ABC")
    alone = -coil_capacitance(Array(_board(3), three[::2])).capacitance.values[0, 1]
    shielded = -coil_capacitance(Array(_board(3), three)).capacitance.values[0, 2]
    assert 0 < shielded < 0.2 * alone  # traces as wide as the gaps, half a pitch·4/3 away: little goes through


def test_self_resonance():
    np.testing.assert_allclose(self_resonance([57e-6, 4 * 57e-6], 16e-12), np.array([5.2702e6, 2.6351e6]), rtol=1e-4)


@pytest.mark.slow
def test_elastomer_adds_capacitance_and_apparent_inductance():
    coil = Spiral(6, 16e-3, 8, 0.15e-3, 0.15e-3, via=VIA, leads=None).coil()
    places = Placement("upper", coil, ("A", "B"), 0, 0), Placement("lower", coil, ("C", "D"), 5e-3, 0)
    array, sizes = Array(_board(4), places), ((1e-3, 0.5e-3), (6e-3, 5e-3))
    thin, thick = (elastomer_effect(array, 3.0, 120e-12, (Sheet("base", d),), undisturbed=u) for d, u in sizes)
    for effect in (thin, thick):
        C = effect.without.values
        np.testing.assert_allclose(effect.change, effect.with_elastomer - effect.without, rtol=1e-9)
        np.testing.assert_allclose(effect.apparent_delta, effect.change / (120e-12 + C), rtol=1e-9)
        assert (effect.dent_bound > 0).all()
    # the upper coil lies on the face the elastomer touches, the lower one below two layers of copper gaps
    assert thick.change[0] > 5 * thick.change[1] > 0
    assert (thick.dent_bound < 0.2 * thin.dent_bound).all()  # the field falls off with the height
    at_once = elastomer_effect(array, 3.0, 120e-12)
    assert (at_once.dent_bound >= at_once.apparent_delta).all()  # nothing known: no less than all of it
    assert (elastomer_effect(array, 4.0, 120e-12).change > at_once.change).all()


def _hairpin():
    hairpin = path_coil([[(0, 0), (1e-2, 0)], [(1e-2, 0), (0, 0)]], 0.2e-3, 0.2e-3, VIA)
    return Array(_board(2), (Placement("hairpin", hairpin, ("A", "B"), 0, 0),))


def _fat():
    array = _one(2, HEXAGON)
    coil = array.placements[0].coil
    wide = replace(coil, widths=tuple(np.full_like(widths, 0.32e-3) for widths in coil.widths))
    return array.with_placements([replace(array.placements[0], coil=wide)])


@pytest.mark.parametrize(("call", "message"), [
    (lambda: strip_capacitance(AIR, [0, 0], [0, 1e-4], [2e-4] * 2, period=1e-2), "copper overlaps on plane 0"),
    (lambda: strip_capacitance(AIR, [0], [0], [2e-4], period=1e-4), "do not fit into the period of 0.1 mm"),
    (lambda: strip_capacitance(AIR, [0], [0], [1e-4], period=1e-3, mirror=True), "do not fit"),
    (lambda: coil_capacitance(_one(2, HEXAGON), relative_permittivity=0.5), "at least 1; got 0.5"),
    (lambda: coil_capacitance(_pair(shift=(1e-3, 0), layers=("A", "A"))), "one and two overlaps on A"),
    (lambda: coil_capacitance(_hairpin()), "winding of hairpin must have turns beside each other"),
    (lambda: coil_capacitance(_fat()), "c: copper of its turns overlaps"),
])  # fmt: skip
def test_bad_geometry_is_refused_in_one_line(call, message):
    with pytest.raises(GeometryError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("call", "message"), [
    (lambda: self_resonance(0.0, 1e-12), "inductance must be finite and positive; got 0.0 H"),
    (lambda: elastomer_effect(_one(2, HEXAGON), 3.0, -1e-12), "tank_capacitance must be finite and not negative"),
    (lambda: elastomer_effect(_one(2, HEXAGON), 3.0, 0.0, undisturbed=-1.0), "undisturbed must be finite"),
])  # fmt: skip
def test_bad_arguments_are_refused_in_one_line(call, message):
    with pytest.raises(ValueError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("thickness", "width"), [(1e-9, 0.15e-3), (0.2e-3, 1e-9)])
def test_strips_that_would_take_hours_are_refused_before_any_work(thickness, width):
    medium = LayeredMedium((thickness,), (1.0, 4.5, 1.0))
    centres = 0.3e-3 * np.arange(40)
    with lasting(1.0), pytest.raises(GeometryError, match=r"would take .* times the work that is allowed"):
        strip_capacitance(medium, [0, 1] * 20, centres, [width] * 40, period=1.0)
