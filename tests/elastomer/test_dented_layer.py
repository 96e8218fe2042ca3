"""The dented magnetic sheet.

Who checks whom: the flat profile against its image form and the interface conditions; the spectrum against Biot–Savart;
the flat sheet in the spectrum against the image series (which uses Neumann's integral); a dent that lifts a whole sheet
against two flat sheets; small depths against the first-order formula and weak sheets against Born's, neither of which
meshes anything; and all of it against the three-dimensional FEM whose results benchmarks/dented_layer_3d.json keeps.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.special import jv, jvp
from support.axial_field import dented_loops
from support.first_assumed import first_assumed
from support.references import circle, polygon

from coilarray import magnetic_field
from coilarray.compute.arrays import FloatArray
from coilarray.constants import MU_0
from coilarray.elastomer.contact import indent
from coilarray.elastomer.dent import Dent, Motion, dent_of
from coilarray.elastomer.dented_layer import dent_energies, dent_inductance
from coilarray.elastomer.scattering import LayerMesh, Scattering, radial_pattern, wavenumber_rule
from coilarray.electromagnetics.flat_layer import layer_inductance
from coilarray.electromagnetics.flat_stack import (
    coil_segments,
    flat_profile,
    harmonics_about,
    reflection,
    segment_spectra,
    turned_spectra,
)
from coilarray.errors import ElastomerError
from coilarray.geometry import Conductor, Hemisphere, Pose, Sheet

_NODES = 8  # of a Gauss–Legendre rule for every half period of the shortest wave
_SLOPE = 1e-6  # step of a difference in heights, over the shortest wavelength


def shortcut_inductance(source, dents, positions, shortcut):
    """`dent_inductance` with `first_order` or `born` in place of the full solution."""
    mesh = LayerMesh()

    def solve(dent: Dent, wavenumbers: FloatArray, weights: FloatArray, deepest: float) -> Scattering:
        return shortcut(dent, wavenumbers, weights, mesh.harmonics)

    return MU_0 * dent_energies(dents, positions, coil_segments(source), solve, mesh)


def first_order(dent: Dent, wavenumbers: FloatArray, weights: FloatArray, highest: int) -> Scattering:
    """Change of energy to first order in the displacement.

    The dent is about an axis, and its faces are displaced. Hadamard's formula: if a face with μ1 below and μ2 above
    moves up by f, the energy at constant currents changes by ∫ f [(μ1 − μ2) H_t² + (1/μ2 − 1/μ1) B_n²] dS with the
    fields of the flat sheets. Wavenumbers and weights in 1/m follow from
    `coilarray.elastomer.scattering.wavenumber_rule`.
    """
    r, rule = _radii(dent, wavenumbers)
    moved = dent.faces(r) * (r * rule)[:, None]
    mu = (1.0, *dent.permeabilities, 1.0)
    step = _SLOPE / wavenumbers[-1]
    energies = [np.zeros((len(wavenumbers),) * 2) for _ in range(highest + 1)]
    for face in dent.contrasts:
        level = dent.heights[face]
        at, beside = flat_profile(wavenumbers, np.array([level, level + step]), dent.thicknesses, dent.permeabilities)
        normal = mu[face + 1] * (beside - at) / step
        along, across = mu[face] - mu[face + 1], 1 / mu[face + 1] - 1 / mu[face]
        for m in range(highest + 1):
            value, slope, turn = _radial(m, r, wavenumbers)
            energies[m] += along * np.outer(at, at) * _weighted(moved[:, face], slope, turn)
            energies[m] += across * np.outer(normal, normal) * _weighted(moved[:, face], value)
    return Scattering(wavenumbers, weights, (np.eye(len(wavenumbers)),) * (highest + 1), tuple(energies))


def born(dent: Dent, wavenumbers: FloatArray, weights: FloatArray, highest: int) -> Scattering:
    """Change of energy with the sheets magnetised by incident waves.

    The magnetisation is by the incident field alone, otherwise as in `first_order`. It is ∫ (μ − 1) H_s·H_s dV of the
    dented minus the flat sheets, with the field H_s in free space.
    """
    r, rule = _radii(dent, wavenumbers)
    both = wavenumbers[:, None] + wavenumbers
    displaced = dent.heights + dent.faces(r)
    mu = (1.0, *dent.permeabilities, 1.0)
    energies = [np.zeros_like(both) for _ in range(highest + 1)]
    patterns = [_radial(m, r, wavenumbers) for m in range(highest + 1)]
    for face in dent.contrasts:  # ∫ e^{−(k + k')z} dz from the old to the new position of the face
        jump = mu[face] - mu[face + 1]
        for here, weight, height in zip(range(len(r)), r * rule, displaced[:, face], strict=True):
            change = jump * weight * (np.exp(-both * dent.heights[face]) - np.exp(-both * height)) / both
            for m, (value, slope, turn) in enumerate(patterns):
                parts = (slope[here], turn[here], wavenumbers * value[here])
                energies[m] += change * sum(np.outer(part, part) for part in parts)
    return Scattering(wavenumbers, weights, (np.eye(len(wavenumbers)),) * (highest + 1), tuple(energies))


def _radii(dent: Dent, wavenumbers: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of an integral over the dent's radius.

    They are fine enough for the shortest wave.
    """
    panels = int(np.ceil(dent.extent * wavenumbers[-1] / np.pi))
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    edges = np.linspace(0, dent.extent, panels + 1)
    half = np.diff(edges) / 2
    return ((edges[:-1] + half)[:, None] + half[:, None] * nodes).ravel(), (half[:, None] * weights).ravel()


def _radial(m: int, r: FloatArray, wavenumbers: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """J_m(kr), its slope in 1/m and m/r times it.

    Each has the shape (r, k).
    """
    kr = np.outer(r, wavenumbers)
    value = jv(m, kr)
    return value, jvp(m, kr) * wavenumbers, m * value / r[:, None]


def _weighted(weight: FloatArray, *parts: FloatArray) -> FloatArray:
    """Sum weight × part × part' over radii, (k, k)."""
    return np.asarray(sum((part * weight[:, None]).T @ part for part in parts))


pytestmark = pytest.mark.slow

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
COIL = polygon(6, 8e-3, -0.1e-3)
NEIGHBOUR = polygon(6, 8e-3, -0.1e-3, centre=(9e-3, 0.0))
PAIR = [COIL, NEIGHBOUR]
PLACES = np.array([[0.0, 0.0], [6e-3, 1e-3], [13e-3, -3e-3]])  # centre, flank, outside
THICKNESSES = (6e-3, 2e-3)
FLAT = (Sheet("base", 6e-3), Sheet("magnetic", 2e-3, 2.7))
LAYERS, RISING = (THICKNESSES, (1.0, 2.7)), np.array([0.0, 1e-3, 2e-3])
COARSE = LayerMesh(harmonics=6, width=0.5, rows=3)  # for what holds on any mesh


def smooth_dent(depth=1e-3, width=3e-3, mu=2.7, thicknesses=THICKNESSES):
    """Top dented by `depth`, the interface by 0.64 of it, with a raised ring."""
    r = np.linspace(0, 30e-3, 301)
    shape = (1 - r**2 / (3 * width**2)) * np.exp(-(r**2) / (2 * width**2))
    return Dent(thicknesses, (1.0, mu), r, -depth * np.column_stack((0 * r, 0.64 * shape, shape)))


def plateau(lower, upper, mu=2.7):
    """Both faces of the magnetic sheet lifted evenly out to 60 mm, then back to zero."""
    r = np.concatenate((np.linspace(0, 60e-3, 61), np.linspace(61e-3, 90e-3, 30)))
    fade = np.where(r <= 60e-3, 1.0, np.cos(np.pi / 2 * np.clip((r - 60e-3) / 30e-3, 0, 1)) ** 2)
    return Dent(THICKNESSES, (1.0, mu), r, np.column_stack((0 * r, lower * fade, upper * fade)))


@pytest.fixture(scope="module")
def usual():
    """Change of the pair by the usual dent at the places, on the default mesh."""
    return dent_inductance(PAIR, [smooth_dent()], PLACES)[0]


@pytest.mark.parametrize("m", [0, 1, 2, 6, 15])
def test_lateral_patterns_are_bessel_functions(m):
    r, wavenumbers = np.linspace(0, 40e-3, 41), np.linspace(1.0, 2000.0, 60)  # both sides of kr = m
    expected = jv(m, np.outer(r, wavenumbers))
    np.testing.assert_allclose(radial_pattern("axial", m, r, wavenumbers), expected, rtol=0, atol=2e-15)  # rounding


@given(st.floats(50, 3000), st.floats(1.0, 500), st.floats(0.1e-3, 8e-3), st.floats(0.1e-3, 8e-3))
@settings(max_examples=20)
def test_flat_profile_meets_the_interface_conditions(k, mu, base, thickness):
    waves, sheets = np.array([k]), ((base, thickness), (1.0, mu))
    for height, below, above in ((base, 1.0, mu), (base + thickness, mu, 1.0)):
        d = 1e-4 / k  # one-sided differences of second order err by (kd)² = 1e-8
        g = flat_profile(waves, height + d * np.array([-2.0, -1.0, 0.0, 1.0, 2.0]), *sheets)[:, 0]
        under = (3 * g[2] - 4 * g[1] + g[0]) / (2 * d)
        over = (-3 * g[2] + 4 * g[3] - g[4]) / (2 * d)
        # relative to k g, the size of a slope; differences of g lose 1e-16/1e-4
        assert below * under == pytest.approx(above * over, abs=1e-6 * max(1.0, mu) * k * g[2])
    at_base = flat_profile(waves, np.zeros(1), *sheets)[0, 0]
    assert reflection(waves, *sheets)[0] == pytest.approx(at_base - 1, abs=1e-12)


def test_flat_profile_is_the_image_series():
    k, mu, z1, t, z = np.array([100.0, 700.0]), 3.0, 6e-3, 2e-3, 7e-3
    beta, n = (mu - 1) / (mu + 1), np.arange(60)[:, None]
    down = beta ** (2 * n + 1) * np.exp(-k * (2 * (z1 + (n + 1) * t) - z))
    images = (1 - beta) * (beta ** (2 * n) * np.exp(-k * (z + 2 * n * t)) + down).sum(axis=0)
    # 1e-12: 60 terms with a ratio of 1/4
    assert flat_profile(k, np.array([z]), (z1, t), (1.0, mu))[0] == pytest.approx(images, rel=1e-12)


def test_spectrum_gives_the_field_of_biot_savart():
    k, weights = wavenumber_rule(5e-3, 40e-3, LayerMesh(decays=30.0))
    about, r, theta, z = np.array([[5e-3, -2e-3]]), 4e-3, 0.7, 5e-3
    harmonics = harmonics_about(segment_spectra(coil_segments(PAIR), k), about, 40)[:, 0]
    m, measure = np.arange(41), weights * k / (2 * np.pi) * k * np.exp(-k * z)
    angular = np.exp(1j * m * theta) * np.where(m == 0, 1, 2)
    H_z = np.einsum("k,kcm,km,m->c", measure, harmonics, jv(m, np.outer(k, np.full(41, r))), angular).real
    point = [about[0, 0] + r * np.cos(theta), about[0, 1] + r * np.sin(theta), z]
    for coil, H in zip(PAIR, H_z, strict=True):
        # 1e-9: wavenumbers to e^(−30), harmonics to J_40(k r) far beyond the turning point
        assert magnetic_field(coil, [point])[0, 2] / MU_0 == pytest.approx(H, rel=1e-9)


def test_a_turned_spectrum_is_that_of_turned_segments():
    k, _ = wavenumber_rule(5e-3, 40e-3, LayerMesh())
    deep = [np.add(coil, [0, 0, -1e-3 * np.sign(coil[0, 0])]) - [0, 0, 1e-3] for coil in PAIR]
    deep[0][2:5, 2] -= 0.8e-3  # a path that is not flat
    flat = segment_spectra(coil_segments(deep), k)

    def largest_error(size):
        slope = np.array([0.8, -0.6]) * size
        turned = []
        for coil, centre in zip(deep, np.column_stack((flat.centres, [0, 0])), strict=True):
            own = coil - centre
            turned.append(np.column_stack((own[:, :2] + own[:, 2:] * slope, own[:, 2] - own[:, :2] @ slope)) + centre)
        expected = harmonics_about(segment_spectra(coil_segments(turned), k), PLACES, 4)
        found = harmonics_about(turned_spectra(flat, tuple(slope)), PLACES, 4)
        still = harmonics_about(flat, PLACES, 4)
        return np.array([np.abs(each - expected).max() / np.abs(still).max() for each in (found, still)])

    errors = np.array([largest_error(size) for size in (2e-3, 1e-3)])
    # to first order: half the slope leaves half of the change, but a quarter of the error
    np.testing.assert_allclose(errors[0] / errors[1], [4, 2], rtol=0.05)
    assert errors[0, 0] < 0.02 * errors[0, 1]


def test_flat_sheet_in_the_spectrum_is_the_image_series():
    k, weights = wavenumber_rule(6e-3, 60e-3, LayerMesh(decays=15.0))
    c = harmonics_about(segment_spectra(coil_segments(PAIR), k), np.zeros((1, 2)), 24)[:, 0]
    R = reflection(k, THICKNESSES, (1.0, 2.7))
    twice = np.where(np.arange(25) == 0, 1, 2)
    change = -2 * MU_0 * np.einsum("k,kim,kjm,m->ij", weights * k**2 * R / (2 * np.pi), c, c.conj(), twice).real
    # 1e-8: wavenumbers to e^(−30); 24 harmonics of a coil 17 mm wide at wavenumbers that count, below 1.5/mm
    assert layer_inductance(PAIR, FLAT) == pytest.approx(change, rel=1e-8)


@pytest.mark.parametrize(("lower", "upper"), [(-0.5e-3, -0.5e-3), (0.0, -0.6e-3), (-0.4e-3, 0.2e-3)])
def test_a_wide_dent_is_another_flat_sheet(lower, upper):
    moved = (Sheet("base", 6e-3 + lower), Sheet("magnetic", 2e-3 + upper - lower, 2.7))
    expected = layer_inductance(PAIR, moved) - layer_inductance(PAIR, FLAT)
    # 2e-3: the sheet comes back at 60 to 90 mm, where the coils' field energy has fallen by (8/60)³
    assert dent_inductance(PAIR, [plateau(lower, upper)], [[0.0, 0.0]])[0, 0] == pytest.approx(expected, rel=2e-3)


def test_small_depths_are_of_first_order():
    errors = []
    for depth in (0.04e-3, 0.02e-3):
        dent = smooth_dent(depth)
        full = dent_inductance(PAIR, [dent], PLACES)[0]
        linear = shortcut_inductance(PAIR, [dent], PLACES, first_order)[0]
        errors.append(np.abs(full - linear).max() / np.abs(full).max())
    assert errors[1] < 0.01
    # the remainder is of second order in the depth: halved with it, relative to ΔL
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.15)


def test_weak_sheets_follow_born():
    errors = []
    for mu in (1.04, 1.02):
        dent = smooth_dent(mu=mu)
        full, weak = dent_inductance(PAIR, [dent], PLACES)[0], shortcut_inductance(PAIR, [dent], PLACES, born)[0]
        errors.append(np.abs(full - weak).max() / np.abs(full).max())
    assert errors[1] < 0.03
    # demagnetisation is of second order in μ − 1: relative to ΔL it halves with it
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.15)


@pytest.mark.parametrize("mu", [1 + 1e-9, 1.0001, 1.01])
@pytest.mark.parametrize("thickness", [1e-6, 2e-3])
def test_the_error_is_a_part_of_the_contrast(mu, thickness):
    shape = smooth_dent()
    faces = shape.displacement[:, [0, 1, 1]] * [1, 1, 1 - 1e-3]  # stretched a little
    dent = Dent((6e-3, thickness), (1.0, mu), shape.radius, faces)
    full, weak = dent_inductance(PAIR, [dent], PLACES)[0], shortcut_inductance(PAIR, [dent], PLACES, born)[0]
    # 2e-4 from the default mesh, 2 (μ − 1) from the demagnetisation, which Born leaves out, and roundings over μ − 1
    assert np.abs(full - weak).max() < (2e-4 + 2 * (mu - 1) + 1e-15 / (mu - 1)) * np.abs(weak).max()


def test_a_sheet_that_lies_on_the_board():
    """Sparse rings just below it, whose field changes within it by much; without volume, so that much cancels."""
    loops = [(radius * 1e-3, height * 1e-3) for height in (-0.1, -0.3) for radius in (3, 5, 7, 9)]
    sheet = Sheet("magnetic", 4e-3, 2.7, youngs_modulus=100e3, poissons_ratio=0.4999)
    dent = dent_of(indent([sheet], Hemisphere(2.5e-3), 1e-3, strain="linear").isel(depth=0), [sheet])
    expected = dented_loops(loops, 4e-3, 2.7, lambda r: dent.faces(r)[:, 1])
    # polygons of the circles' area
    paths = [circle(96, radius / np.sqrt(np.sinc(2 / 96)), height) for radius, height in loops]
    change = dent_inductance(paths, [dent], [[0.0, 0.0]])[0, 0]
    # 1e-2 is what LayerMesh states, and 3e-3 from the reference's mesh; with elements that had to follow the rings' own
    # field it was 0.18 of the sum
    assert np.abs(change - expected).max() < 1.3e-2 * np.abs(expected).max()
    assert change.sum() == pytest.approx(expected.sum(), rel=1e-2)


def test_shortcuts_are_wrong_for_real_dents(usual):
    for shortcut in (first_order, born):
        change = shortcut_inductance([COIL], [smooth_dent()], PLACES[:1], shortcut)[0, 0, 0, 0]
        assert not 0.95 < change / usual[0, 0, 0] < 1.05


def test_the_three_dimensional_fem_agrees():
    pytest.importorskip("pyamg", reason="the test extra is not installed")
    sys.path.insert(0, str(BENCHMARKS))
    from dented_layer_3d import SmoothDent

    kept = json.loads((BENCHMARKS / "dented_layer_3d.json").read_text(encoding="utf-8"))
    shape, r = SmoothDent(**kept["dent"]), np.linspace(0, 60e-3, 1201)
    dent = Dent(THICKNESSES, (1.0, 2.7), r, np.column_stack((0 * r, shape.bottom(r), shape.top(r))))
    paths = first_assumed().array.conductors()[1:3]
    assert [path.name for path in paths] == kept["coils"]
    assert [place["place"] for place in kept["places"]] == ["centre", "flank", "outside"]
    for place in kept["places"]:
        change = dent_inductance(paths, [dent], [[place["x"], place["y"]]])[0, 0]
        # 2e-3, where 1e-2 is required: 2e-4 of the largest entry from our mesh, and their own estimated error
        np.testing.assert_allclose(change, place["extrapolated"], rtol=2e-3)


@pytest.mark.parametrize(("finer", "tolerance"), [
    ({"harmonics": 14}, 1e-5), ({"decays": 12.0}, 6e-5), ({"width": 0.125}, 2e-4), ({"rows": 12}, 2e-4),
    ({"growth": 1.1}, 2e-4), ({"rank": 1e-10}, 1e-8),
])  # fmt: skip
def test_defaults_are_converged(usual, finer, tolerance):
    """Changes against the defaults, relative to the largest entry at each place: none is above 2e-4."""
    fine = dent_inductance(PAIR, [smooth_dent()], PLACES, replace(LayerMesh(), **finer))[0]
    assert (np.abs(fine - usual).max(axis=(1, 2)) / np.abs(fine).max(axis=(1, 2))).max() < tolerance


def test_elements_converge_with_the_order_of_the_energy():
    dent, error = smooth_dent(), []
    exact = dent_inductance([COIL], [dent], PLACES[:1], LayerMesh(width=0.08, rows=16, growth=1.1))[0, 0, 0, 0]
    for rows, width in ((2, 0.6), (4, 0.3)):
        mesh = LayerMesh(rows=rows, width=width, growth=1.2 ** (2 / rows))
        error.append(abs(dent_inductance([COIL], [dent], PLACES[:1], mesh)[0, 0, 0, 0] / exact - 1))
    # quadratic elements: energies of fourth order where the field is smooth; half of it allowed for the far air, whose
    # elements keep their growth
    assert np.log2(error[0] / error[1]) > 2.5


@given(st.floats(-np.pi, np.pi), st.floats(-30e-3, 30e-3), st.floats(-30e-3, 30e-3))
@settings(max_examples=3)
def test_moving_and_turning_the_board_changes_nothing(angle, dx, dy):
    def moved(points):
        return np.add(Rotation.from_euler("z", angle).apply(points), [dx, dy, 0])

    places = moved(np.pad(PLACES, ((0, 0), (0, 1))))[:, :2]
    here = dent_inductance(PAIR, [smooth_dent()], PLACES, COARSE)
    there = dent_inductance([moved(coil) for coil in PAIR], [smooth_dent()], places, COARSE)
    # 1e-9 of the largest: the rule over the wavenumbers depends on the coils' bounding circle
    assert there == pytest.approx(here, abs=1e-9 * np.abs(here).max())


def test_sheets_that_move_with_their_dent_see_the_coils_move_the_other_way():
    motion = Motion(lift=0.1e-3, slope=(0.01, -0.006), pivot=9e-3)
    (along_x, along_y), place, dent = motion.slope, PLACES[1], smooth_dent()
    turn = np.array([[1.0, 0.0, along_x], [0.0, 1.0, along_y], [-along_x, -along_y, 1.0]])
    pair = [np.subtract(coil, [0, 0, 0.3e-3]) for coil in PAIR]
    axis = np.array([*place, motion.pivot])
    turned = [(coil - axis) @ turn.T + axis - [0, 0, motion.lift] for coil in pair]
    still, there = (dent_inductance(coils, [dent], [place], COARSE)[0, 0] for coils in (pair, turned))
    here = dent_inductance(pair, [dent.moved(motion)], [place], COARSE)[0, 0]
    # the turn is to first order, and lateral motions of deeper coils are of second
    np.testing.assert_allclose(here - still, there - still, rtol=0.01)


def test_the_change_is_symmetric_and_mirrors(usual):
    assert (usual == usual.transpose(0, 2, 1)).all()
    mirrored = dent_inductance(PAIR, [smooth_dent()], PLACES * [1, -1])[0]
    assert mirrored == pytest.approx(usual, abs=1e-12 * np.abs(usual).max())
    near, _, far = usual[:, 0, 0]  # a dent brings iron nearer, and its ring takes it away
    assert near > 0 > far


def test_a_sheet_cut_in_two_is_the_same_sheet(usual):
    whole = smooth_dent()
    middle = whole.displacement[:, 1:].mean(axis=1)
    faces = np.column_stack((whole.displacement[:, :2], middle, whole.displacement[:, 2]))
    halves = Dent((6e-3, 1e-3, 1e-3), (1.0, 2.7, 2.7), whole.radius, faces)
    # the faces between count nowhere, but the anchors stand otherwise: the error of the mesh
    assert dent_inductance(PAIR, [halves], PLACES)[0] == pytest.approx(usual, rel=1e-3, abs=2e-4 * usual.max())


def test_several_depths_at_once_are_the_same_as_one_by_one(usual):
    assert (dent_inductance(PAIR, [smooth_dent(mu=1.0)], PLACES) == 0).all()  # an unmagnetic sheet
    shallow, none, deep = dent_inductance(PAIR, [smooth_dent(0.5e-3), smooth_dent(0.0), smooth_dent(1e-3)], PLACES)
    assert (none == 0).all()  # an undented one
    # the mesh of several depths serves the deepest: the error of the mesh
    assert shallow == pytest.approx(dent_inductance(PAIR, [smooth_dent(0.5e-3)], PLACES)[0], abs=3e-4 * usual.max())
    assert deep == pytest.approx(usual, abs=3e-4 * usual.max())


def test_open_paths_are_closed_between_their_ends():
    ring = circle(24, 8e-3)
    opened, closed = (dent_inductance([path], [smooth_dent()], PLACES, COARSE) for path in (ring[:-1], ring))
    assert opened == pytest.approx(closed, rel=1e-12)


@pytest.mark.parametrize(("call", "message"), [
    (lambda: dent_inductance([COIL], [smooth_dent()], [[0.0, np.nan]]), "positions must be finite"),
    (lambda: dent_inductance([COIL], [smooth_dent()], [0.0, 1.0]), "shape"),
    (lambda: dent_inductance([np.add(COIL, [0, 0, 1e-3])], [smooth_dent()], PLACES), "below the sheets"),
    (lambda: dent_inductance([COIL], [smooth_dent(), smooth_dent(mu=3.0)], PLACES), "same sheets"),
    (lambda: dent_inductance([COIL], [replace(smooth_dent(), symmetry="plane")], PLACES), "about an axis"),
    (lambda: dent_inductance([COIL], [smooth_dent(0.19e-3, thicknesses=(0.2e-3, 0.1e-3))], PLACES * 100), "too close"),
    (lambda: Dent(*LAYERS, RISING, np.array([[0, 0, -2e-3], [0, 0, -1e-3], [0, 0, 0]])), "faces of sheet 2 cross"),
    (lambda: Dent(*LAYERS, RISING, np.zeros((3, 2))), r"shape \(3, 3\)"),
    (lambda: Dent(*LAYERS, RISING[::-1], np.zeros((3, 3))), "rise from 0"),
    (lambda: Dent(*LAYERS, RISING, np.full((3, 3), np.nan)), "finite"),
])  # fmt: skip
def test_bad_input_and_impossible_dents(call, message):
    with pytest.raises(ElastomerError, match=message):
        call()


def test_a_wide_dent_lowers_the_sheets_also_over_tilted_coils():
    """Against the difference of two flat sheets: what a dent of 30 diameters of the coils approaches."""
    angle = np.linspace(0, 2 * np.pi, 13)
    loop = Conductor(np.column_stack((2e-3 * np.cos(angle), 2e-3 * np.sin(angle), 0 * angle)))
    coils = [loop.posed(Pose(z=-3e-3)), loop.posed(Pose(x=1e-3, z=-4e-3, turn=(0.5, 0.3, 0.0)))]
    r, depth = np.linspace(0, 96e-3, 97), 0.1e-3
    lowered = -depth / 2 * (1 - np.tanh((r - 60e-3) / 8e-3))
    dent = Dent((3e-3, 2e-3), (1.0, 3.0), r, np.column_stack((0 * r, lowered, lowered)))
    flat = [layer_inductance(coils, [Sheet("gap", gap), Sheet("iron", 2e-3, 3.0)]) for gap in (3e-3, 3e-3 - depth)]
    # the field of a coil falls as (2/60)³ up to the edge of the dent
    np.testing.assert_allclose(dent_inductance(coils, [dent], [[0, 0]])[0, 0], flat[1] - flat[0], rtol=1e-3)
