"""AC resistance of the coils.

Who checks whom:

    quantity            reference tables   closed form        other model           finer mesh or rule
    mean logarithms                        GMD of a square    Gauss quadrature
    single trace        ac_single_trace    low f: ω², √f                            x
    parallel traces     ac_parallel_traces one trace alone                          x (basis)
    resistance matrix   (via the above)    DC, induced loss   2-D bundle of a       x (Gauss points)
                                           of a square loop   long racetrack
"""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support.boards import one_coil, round_spiral
from support.coil_paths import spiral_path
from support.parallel_traces import parallel_traces
from support.references import rows

import coilarray.electromagnetics.resistance as module
from coilarray import dc_resistance, load_design, magnetic_field
from coilarray.compute.threads import Recent, serial_algebra
from coilarray.constants import MU_0, RESISTIVITY_COPPER
from coilarray.electromagnetics.kernels.sections import NEAR, isolated_modes, pair_logs
from coilarray.electromagnetics.resistance import WIDE, cross_section, resistance_matrix, skin_depth
from coilarray.errors import GeometryError
from coilarray.geometry import Conductor, Spiral

W, T = 0.15e-3, 35e-6
BAR = Conductor([[0, 0, 0], [1, 0, 0]], W, T)


def racetrack(turns, width, pitch, inner, length):
    """A long rectangular spiral with its long sides along y, the first at x = inner."""
    points = []
    for k in range(turns):
        a, b = inner + k * pitch, length / 2 + k * pitch
        points += [(a, -b + pitch if k else -b), (a, b), (-a, b), (-a, -b)]
    return Conductor([(x, y, 0.0) for x, y in points], width, T, name="racetrack")


def mean_log(x, z, w1, t1, w2, t2):
    out = np.empty((1, 1))
    with np.errstate(divide="ignore", invalid="ignore"):  # the far series, infinite at 0, gives way to the closed form
        pair_logs(np.array([[0.0, 0.0, w1, t1]]), np.array([[0.0], [0.0], [w2], [t2]]), x, z, out)
    return float(out[0, 0])


def gauss_mean_log(x, z, w1, t1, w2, t2, n=16):
    node, weight = np.polynomial.legendre.leggauss(n)
    a, b = node[:, None] / 2, node[None, :] / 2
    dx = (x + w2 * a - w1 * b).ravel()
    dz = (z + t2 * a - t1 * b).ravel()
    both = (weight[:, None] * weight[None, :]).ravel() / 4
    return float(both @ (0.5 * np.log(dx[:, None] ** 2 + dz**2)) @ both)


@pytest.mark.nojit
@pytest.mark.parametrize("place", [(2.0, 1.0), (0.0, 3.0), (-4.0, 0.2)])
def test_mean_log_against_quadrature(place):
    sizes = (1.0, 0.5, 0.7, 1.0)
    # 16 Gauss points leave 1e-12 at these distances; the closed form cancels (distance/size)⁴ of 1e-16
    assert mean_log(*place, *sizes) == pytest.approx(gauss_mean_log(*place, *sizes), abs=1e-11)


@pytest.mark.nojit
def test_mean_log_of_a_square_with_itself():
    # geometric mean distance of a square of side 1: Maxwell, A Treatise on Electricity and Magnetism, art. 692
    expected = np.log(2) / 3 + np.pi / 3 - 25 / 12
    assert mean_log(0.0, 0.0, 1.0, 1.0, 1.0, 1.0) == pytest.approx(expected, rel=1e-14)  # rounding


def test_far_expansion_meets_the_closed_form():
    for angle in np.linspace(0, np.pi, 9):
        places = (NEAR * (1 + d) * np.array([np.cos(angle), np.sin(angle)]) for d in (-1e-12, 1e-12))
        inside, outside = (mean_log(*place, 1.0, 0.4, 0.8, 1.0) for place in places)
        # the sixth moments that the expansion leaves out: about (1/6)⁶/800
        assert outside == pytest.approx(inside, abs=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("row", rows("ac_single_trace"), ids=lambda r: "-".join(list(r.values())[:3]))
def test_single_trace_reference(row):
    width, thickness = float(row["w_mm"]) * 1e-3, float(row["t_mm"]) * 1e-3
    trace = cross_section(width, thickness, float(row["f_MHz"]) * 1e6)
    # both meshes are converged to 1e-3 or so (the table's header); asked for are 1 % and 3 %, measured 2e-3 at most
    assert float(trace.resistance_ratio) == pytest.approx(float(row["ratio_extrap"]), rel=3e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("aspect", "mesh"), [(1.0, (64, 64)), (0.35, (72, 32)), (0.035, (96, 32))])
def test_single_mesh(aspect, mesh):
    # the study that set SINGLE_MESH, up to MOST_SKIN_DEPTHS
    beta = np.array([2.0, 10, 50, 100, module.MOST_SKIN_DEPTHS]) ** 2 / np.pi
    with serial_algebra():
        coarse, fine = (isolated_modes(1.0, aspect, *cells) for cells in (module.SINGLE_MESH, mesh))
    for k in range(3):
        a, b = (module._mode_sum(modes[k], beta) + (k == 0) for modes in (coarse, fine))
        # measured at most 2.3e-3; 5e-3 for the lateral field of thin traces (third set), which has few cells
        np.testing.assert_allclose(a, b, rtol=3e-3 if k < 2 else 6e-3)


def test_uniform_field_at_low_frequency():
    trace, squared = cross_section(W, T, 1e3), (2 * np.pi * 1e3 * MU_0) ** 2
    # ω²µ0² t w³/12ρ: eddy currents of a thin strip in a uniform field, no reaction (w/δ = 0.07: 1e-6);
    # cells of constant density miss their own inner variation, 1e-3 with 48 cells and 6e-3 with 22
    assert trace.normal_field_loss == pytest.approx(squared * T * W**3 / 12 / RESISTIVITY_COPPER, rel=1e-3)
    assert trace.lateral_field_loss == pytest.approx(squared * W * T**3 / 12 / RESISTIVITY_COPPER, rel=6e-3)


def test_single_trace_limits():
    excess = cross_section(W, T, [1e2, 2e4, 4e4]).resistance_ratio - 1
    # f → 0: R_dc; the excess, 1e-12 at 100 Hz, is ∝ f² up to (w/δ)⁴/500 at 40 kHz
    assert excess[0] == pytest.approx(0.0, abs=1e-10)
    assert excess[2] / excess[1] == pytest.approx(4.0, rel=1e-3)
    # skin limit of a square: R ∝ √f; corners add O(δ/w), 3 % here
    side = 1e-3
    f = RESISTIVITY_COPPER / (np.pi * MU_0 * (side / np.array([75.0, 150.0])) ** 2)
    ratio = cross_section(side, side, f).resistance_ratio
    assert ratio[1] / ratio[0] == pytest.approx(2.0, rel=3e-2)
    # and more than the current spread evenly over the perimeter would lose: w/4δ
    assert ratio[1] > 150 / 4


@settings(max_examples=25)
@given(st.floats(0.05, 20.0), st.floats(1e5, 1e7), st.floats(0.5, 3.0))
def test_only_sizes_in_skin_depths_count(scale, frequency, conductivity):
    first = cross_section(W, T, frequency)
    second = cross_section(scale * W, scale * T, frequency / scale**2 / conductivity, RESISTIVITY_COPPER / conductivity)
    # rounding of the aspect ratio in the cache, 1e-12
    assert second.resistance_ratio == pytest.approx(first.resistance_ratio, rel=1e-9)
    unit = second.normal_field_loss * conductivity / RESISTIVITY_COPPER
    assert unit == pytest.approx(first.normal_field_loss / RESISTIVITY_COPPER, rel=1e-9)


def test_width_and_thickness_change_places():
    flat, upright = cross_section(W, T, 5e6), cross_section(T, W, 5e6)
    assert upright.resistance_ratio == pytest.approx(flat.resistance_ratio, rel=1e-9)  # same mesh turned, rounding
    assert upright.normal_field_loss == pytest.approx(flat.lateral_field_loss, rel=1e-9)


def reference_bundle(row):
    n, levels = int(row["n_traces"]), [float(z) * 1e-3 for z in row["z_list_mm"].split(";")]
    width, thickness, pitch = (float(row[f"{key}_mm"]) * 1e-3 for key in ("w", "t", "pitch"))
    x, z = np.tile(np.arange(n) * pitch, len(levels)), np.repeat(levels, n)
    return width, thickness, x, z, float(row["f_MHz"]) * 1e6


@pytest.mark.slow
@pytest.mark.parametrize("row", rows("ac_parallel_traces"), ids=lambda r: "-".join(list(r.values())[:6]))
def test_parallel_traces_reference(row):
    width, thickness, x, z, f = reference_bundle(row)
    result = parallel_traces(width, thickness, x, z, 1.0, f)
    ratio = result.resistance_ratio
    assert result.loss_ratio.mean() == pytest.approx(ratio.mean(), rel=1e-10)  # energy: all heat is fed in, rounding
    # the table's two meshes differ by up to 0.5 %, ours is the finer one on one layer and between them on two, and
    # four digits are printed; asked for are 1 % and 3 %, measured 9e-3 at most, 1e-3 for traces up to two skin depths
    narrow = width <= WIDE * skin_depth(f)
    expected = [float(row[key]) for key in ("ratio_fine", "Rmax_ratio", "Rmin_ratio")]
    np.testing.assert_allclose([ratio.mean(), ratio.max(), ratio.min()], expected, rtol=1e-3 if narrow else 1e-2)


@pytest.mark.slow
def test_one_parallel_trace_is_the_single_trace():
    for f in (1e6, 1e7, 3e7):
        alone = parallel_traces(W, T, 0.0, 0.0, 2.0, f)
        # meshes of 48 and 30 cells; the coarser one costs 4e-3 at 30 MHz
        np.testing.assert_allclose(alone.loss_ratio, cross_section(W, T, f).resistance_ratio, rtol=5e-3)


@pytest.mark.slow
def test_basis_tolerance(monkeypatch):
    x, z = np.tile(np.arange(6) * 0.25e-3, 2), np.repeat([0.0, 0.15e-3], 6)
    found = []
    for tolerance in (module.BASIS_TOLERANCE, 1e-4):
        monkeypatch.setattr(module, "BASIS_TOLERANCE", tolerance)
        monkeypatch.setattr(module, "_INTERACTIONS", Recent(4096))
        found.append([parallel_traces(0.2e-3, T, x, z, 1.0, f).loss_ratio for f in (1e6, 5e6, 2e7)])
        module._basis.cache_clear()
        module._section.cache_clear()
    # gaps of a quarter width, where the Taylor series of the basis is stretched most
    np.testing.assert_allclose(*found, rtol=2e-3)


@pytest.mark.slow
def test_opposite_currents_crowd_and_mirror():
    f = 5e6
    same, opposite = (parallel_traces(W, T, [0, 0], [0, 0.1e-3], [1, s], f) for s in (1, -1))
    # the facing go-and-return pair spreads its current over the faces; the pair in phase pushes it to the edges
    assert same.loss_ratio[0] > opposite.loss_ratio[0] > 1
    assert same.loss_ratio[0] == pytest.approx(same.loss_ratio[1], rel=1e-9)  # mirror images, rounding


@pytest.fixture(scope="module")
def board():
    return load_design("gast2020").array.conductors()


@pytest.mark.slow
def test_direct_current_limit(board):
    result = resistance_matrix(board, 10.0)
    # excess ∝ f²: 4e-4 at 100 kHz is 4e-12 at 10 Hz
    np.testing.assert_allclose(np.diag(result.resistance[0]), dc_resistance(board), rtol=1e-10)
    np.testing.assert_allclose(result.dc_resistance, dc_resistance(board), rtol=1e-15)
    assert result.resistance.attrs["units"] == "ohm"
    excess = resistance_matrix(board[:2], [1e4, 2e4]).resistance.values - np.diag(dc_resistance(board[:2]))
    # eddy reaction is of order (w/δ)⁴/500 = 1e-5 at 20 kHz; rounding of R against its excess: 1e-16/1e-6
    np.testing.assert_allclose(excess[1] / excess[0], 4.0, rtol=1e-4)


@pytest.mark.slow
def test_neither_place_nor_order_of_the_coils_matters(board):
    R = resistance_matrix(board[:4], 1.7e6).resistance.values[0]
    # traces that are wider by 1e-12 share nothing with the others that was computed before
    moved = [
        Conductor(coil.vertices + np.array([0.1, -0.2, 0.3]), coil.widths * (1 + 1e-12), coil.thicknesses, coil.areas)
        for coil in board[:4]
    ]
    again = resistance_matrix(moved[::-1], 1.7e6).resistance.values[0]
    # places of 0.3 m are rounded to 5e-17 m, 1e-12 of the distances between turns
    np.testing.assert_allclose(again[::-1, ::-1], R, rtol=0, atol=1e-10 * R.max())


@pytest.mark.slow
def test_symmetric_and_positive_definite(board):
    R = resistance_matrix(board, np.geomspace(1e5, 2e7, 7)).resistance.values
    np.testing.assert_allclose(R, R.transpose(0, 2, 1), rtol=0, atol=1e-14 * R.max())  # rounding
    # more than DC loss for any currents: R − R_dc is positive definite too
    assert np.linalg.eigvalsh(R - np.diag(dc_resistance(board))).min() > 0


NARROW = [
    row for row in rows("ac_parallel_traces") for w, *_, f in [reference_bundle(row)] if w <= WIDE * skin_depth(f)
]


@pytest.mark.parametrize("row", NARROW, ids=lambda r: "-".join(list(r.values())[:6]))
def test_transverse_field_alone_on_the_bundles(row):
    width, thickness, x, z, f = reference_bundle(row)
    bars = [Conductor([[a, -10, b], [a, 10, b]], width, thickness) for a, b in zip(x, z, strict=True)]
    result = resistance_matrix(bars, f)
    assert (result.model == "transverse field").all()
    one = np.ones(len(bars))
    ratio = float(one @ result.resistance.values[0] @ one / result.dc_resistance.sum())
    # 20 m for infinity; uniform fields overrate the excess by up to a tenth, R by 4e-4 at most
    assert ratio == pytest.approx(float(row["ratio_fine"]), rel=1e-3)


@pytest.mark.slow
def test_racetrack_against_its_two_sides():
    turns, width, pitch, inner, length = 8, 0.3e-3, 0.4e-3, 2e-3, 0.4
    f = np.geomspace(1e5, 3e7, 6)
    coil = resistance_matrix(racetrack(turns, width, pitch, inner, length), f)
    assert coil.model.values[:, 0].tolist() == ["transverse field"] + 5 * ["section filaments"]
    side = inner + np.arange(turns) * pitch
    x, current = np.concatenate((side, -side)), np.repeat([1.0, -1.0], turns)
    bundle = [parallel_traces(width, T, x, 0.0, current, frequency).loss_ratio.mean() for frequency in f]
    # ends are 2 % of the length; the cut holds one side, the other acts as a uniform field; mesh 5e-3. Measured 1e-2
    np.testing.assert_allclose(coil.resistance[:, 0, 0] / coil.dc_resistance[0], bundle, rtol=1.5e-2)


@pytest.mark.slow
@pytest.mark.parametrize("path", [
    spiral_path(Spiral(6, 20e-3, 20, 0.15e-3, 0.15e-3)),
    spiral_path(Spiral(6, 20e-3, 20, 0.15e-3, 0.15e-3), (0.0, -0.2e-3)),
    spiral_path(Spiral(6, 12e-3, 10, 0.2e-3, 0.05e-3)),
    spiral_path(round_spiral(9e-3, 6, 0.15e-3, 0.15e-3)),
    spiral_path(Spiral(4, 30e-3, 6, 1e-3, 0.2e-3)),
], ids=["hexagon", "two layers", "tight", "circle", "wide"])  # fmt: skip
def test_switch_between_models(path):
    switch = RESISTIVITY_COPPER / (np.pi * MU_0 * (path.widths[0] / WIDE) ** 2)
    result = resistance_matrix(path, switch * np.array([1 - 1e-9, 1 + 1e-9]))
    assert result.model.values[:, 0].tolist() == ["transverse field", "section filaments"]
    below, above = result.resistance.values[:, 0, 0]
    # the jump: what a uniform field over each trace leaves out at w = 2δ; measured at most 6.5e-4
    assert above == pytest.approx(below, rel=1e-3)


def test_gauss_points(board, monkeypatch):
    default = resistance_matrix(board[:2], 1.7e6).resistance.values
    monkeypatch.setattr(module, "POINTS", ((0.0, 32),))
    fine = resistance_matrix(board[:2], 1.7e6).resistance.values
    # of an excess of 10 % of R: measured 2e-4 of R
    np.testing.assert_allclose(default, fine, rtol=0, atol=5e-4 * fine.max())


def test_loss_induced_in_an_open_neighbour():
    # a small trace in the middle of a large square loop, carrying nothing: ½ g |H|² per length
    half, length = 20e-3, 1e-3
    loop = Conductor(half * np.array([[1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]), W, T)
    trace = Conductor([[-length / 2, 0, 0], [length / 2, 0, 0]], W, T)
    f = 5e5
    both = resistance_matrix([loop, trace], f).resistance.values[0]
    alone = resistance_matrix([loop], f).resistance.values[0, 0, 0]
    H = float(magnetic_field([loop], [0, 0, 0])[2]) / MU_0
    induced = length * float(cross_section(W, T, f).normal_field_loss) * H**2
    # the field varies by (length/half)² = 6e-4 at most along the trace; the difference costs 1e-16·R/induced = 1e-6
    assert both[0, 0] - alone == pytest.approx(induced, rel=1e-3)


@pytest.mark.slow
@settings(max_examples=8)
@given(st.floats(0.2, 5.0), st.floats(0.0, 6.0), st.floats(-1.0, 1.0))
def test_scaled_turned_and_moved_coil(scale, angle, shift):
    path = spiral_path(Spiral(6, 8e-3, 5, 0.2e-3, 0.1e-3))
    turned = Rotation.from_euler("z", angle).apply(scale * path.vertices)
    moved = Conductor(turned + shift, scale * path.widths, scale * path.thicknesses)
    f = np.array([3e5, 4e6])
    first, second = resistance_matrix(path, f), resistance_matrix(moved, f / scale**2)
    assert (first.model == second.model).all()
    # coordinates differ by roundings, and lengths in units of the width are rounded to 1e-8
    np.testing.assert_allclose(scale * second.resistance.values, first.resistance.values, rtol=1e-6)


@pytest.mark.parametrize("path", [
    spiral_path(Spiral(6, 12e-3, 4, 0.2e-3, 0.05e-3)),
    spiral_path(Spiral(4, 30e-3, 3, 1e-3, 0.2e-3)),
], ids=["narrow", "wide"])  # fmt: skip
def test_vertices_on_straight_runs_change_nothing(path):
    pieces, count = 8, len(path.vertices) - 1
    share = np.arange(pieces)[:, None] / pieces
    cut = np.vstack([a + share * (b - a) for a, b in pairwise(path.vertices)] + [path.vertices[-1:]])
    finer = Conductor(cut, *(np.repeat(v, pieces) for v in (path.widths, path.thicknesses, path.areas)), path.name)
    assert (len(finer.straightened().vertices), len(path.straightened().vertices)) == (count + 1, count + 1)
    frequencies = [1e5, 1e7]
    one, many = (resistance_matrix(each, frequencies).resistance.values for each in (path, finer))
    assert many == pytest.approx(one, rel=1e-12)  # coordinates differ by roundings


def test_vias_keep_their_direct_resistance():
    path = Conductor([[0, 0, 0], [0, 0, -1e-3]], 0.2e-3, 0.2e-3, areas=1e-8)
    R = resistance_matrix(path, [1e3, 1e7]).resistance[:, 0, 0]
    np.testing.assert_allclose(R, RESISTIVITY_COPPER * 1e-3 / 1e-8, rtol=1e-14)  # no part of it depends on f


@pytest.mark.parametrize("trace_width", [0.5e-3, 0.55e-3])
def test_where_a_round_winding_starts_changes_nothing(trace_width):
    """A line through the centre crosses its two halves alike and in opposite directions: only one half counts."""
    resistances = []
    for direction in (0.0, 1.0, np.pi / 2):
        coil = round_spiral(20e-3, 6, trace_width, 0.2e-3, direction=direction).coil()
        (path,) = one_coil(coil).conductors()
        resistances.append(float(resistance_matrix(path, 3.6e6).resistance[0, 0, 0]))
    np.testing.assert_allclose(resistances, resistances[0], rtol=1e-9)  # coordinates differ by roundings


@pytest.mark.parametrize(("out", "past"), [(5e-3, 5e-3), (5e-3, 80e-3), (5e-3, -80e-3)])
def test_leads_do_not_change_the_winding(out, past):
    """However far leads go out and past the turns, the winding keeps its losses."""
    winding = spiral_path(Spiral(6, 32e-3, 15, 0.15e-3, 0.15e-3, first_corner=0.0), (0.0, -1.5e-3))
    start, end = winding.vertices[[0, -1]]  # one above the other, on the x axis
    way, beside = np.array([[out, past, 0], [out, 0, 0]]), np.array([[out + 2e-3, 0, 0], [out + 2e-3, past, 0]])
    path = Conductor(np.vstack((start + way, winding.vertices, end + beside)), 0.15e-3, T)
    alone, led = (resistance_matrix(each, 2e6) for each in (winding, path))
    leads = cross_section(0.15e-3, T, 2e6).resistance_ratio * (led.dc_resistance - alone.dc_resistance).values
    # the leads, 0.7 to 9 % of the length, have some of the field of the turns, and these of theirs; measured 1.4e-4
    np.testing.assert_allclose(led.resistance.values.ravel() - leads, alone.resistance.values.ravel(), rtol=5e-4)


def test_straight_wire():
    wire = Conductor([[0, 0, 0], [0, 1e-2, 0]], W, T)
    result = resistance_matrix(wire, [5e6, 2e7])
    assert (result.model == "section filaments").all()
    # alone its factor is 1
    expected = cross_section(W, T, [5e6, 2e7]).resistance_ratio
    np.testing.assert_allclose(result.resistance[:, 0, 0] / result.dc_resistance[0], expected, rtol=1e-9)


@pytest.mark.parametrize("frequency", [0.0, -1.0, np.nan, np.inf])
@pytest.mark.parametrize("solve", [lambda f: cross_section(W, T, f), lambda f: resistance_matrix(BAR, [1e6, f])])
def test_bad_frequency(solve, frequency):
    with pytest.raises(ValueError, match=r"frequency must be positive and finite; got"):
        solve(frequency)


@pytest.mark.parametrize(("call", "message"), [
    *((lambda rho=rho: cross_section(W, T, 1e6, rho), "resistivity must be positive") for rho in (0.0, -1.0, np.nan)),
    *((lambda rho=rho: resistance_matrix(BAR, 1e6, rho), "resistivity must be") for rho in (0.0, -1.0, np.nan)),
    (lambda: cross_section(-1.0, T, 1e6), "width of a trace must be positive and finite"),
    (lambda: cross_section(1.0, T, 1e8), "at most 300 skin depths"),
    (lambda: resistance_matrix(BAR.vertices, 1e6), "path 1 has segments without a cross-section"),
    (lambda: resistance_matrix(Conductor(BAR.vertices, areas=1e-8), 1e6), "without a cross-section"),
    (lambda: resistance_matrix(BAR, []), "frequencies must have shape"),
])  # fmt: skip
def test_bad_input(call, message):
    with pytest.raises(ValueError, match=message) as caught:
        call()
    assert isinstance(caught.value, GeometryError) == ("frequencies" not in message)
