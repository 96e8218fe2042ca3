"""The flat magnetic sheet and the inductance matrix.

Who checks whom: ref_slab_circular_filament.csv (mpmath, two ways) for circles; the image series added up with
`mutual_inductance` alone for any shape; dipoles and their images by magnetic charges for the directions. The near
images and the spectrum check each other by where they share the series.
"""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from scipy.special import j0, j1
from support.first_assumed import first_assumed
from support.patience import lasting
from support.references import polygon, rows

from coilarray import couple_design, inductance_matrix, load_design, magnetic_field, mutual_inductance
from coilarray.constants import MU_0
from coilarray.design.bundled import read
from coilarray.design.model import parse_design
from coilarray.electromagnetics import flat_layer
from coilarray.electromagnetics.field import as_conductors
from coilarray.electromagnetics.flat_layer import Slab, layer_inductance, magnetic_slab, mirrored
from coilarray.errors import ElastomerError, GeometryError
from coilarray.geometry import Conductor, Pose, Sheet, Spiral

BASE, MAGNETIC = Sheet("base", 6e-3), Sheet("magnetic", 2e-3, 2.7)
STACK = [BASE, MAGNETIC]
HEXAGON = polygon(6, 8e-3, -1e-3)
THICK = 1e3  # m: a half space to the distance over the thickness cubed, 1e-15


def _of_circles(a, b, z1, z2, thickness, mu_r, d):
    """ΔM of two circles in m: polygons of 48, 96 and 192 sides, extrapolated in 1/n² and 1/n⁴; its measured order."""
    M = []
    for n in (48, 96, 192):
        loops = [polygon(n, a, -z1), polygon(n, b, -z2, centre=(d, 0.0))]
        M.append(layer_inductance(loops, [Sheet("magnetic", thickness, mu_r)])[0, 1])
    first = [(4 * fine - coarse) / 3 for coarse, fine in itertools.pairwise(M)]
    return (16 * first[1] - first[0]) / 15, np.log2(abs((M[1] - M[0]) / (M[2] - M[1])))


@pytest.mark.slow
@pytest.mark.parametrize("row", rows("slab_circular_filament"), ids=lambda row: "-".join(list(row.values())[:7]))
def test_reference(row):
    a, b, z1, z2, t, d = (float(row[f"{key}_mm"]) * 1e-3 for key in ("a", "b", "z1", "z2", "t", "d"))
    M, order = _of_circles(a, b, z1, z2, min(t, THICK), float(row["mu_r"]), d)
    assert order == pytest.approx(2, abs=0.1)  # inscribed polygons; the next term of the series moves it by less
    # 1e-8: the third term of the series, with sides shorter than the distances
    assert pytest.approx(float(row["dM_images_nH"]), rel=1e-8) == M * 1e9


FERRITE = (10e-3, 10e-3, 8e-3, 0.3e-3, 150.0, 0.0)
FAR = (6e-3, 6e-3, 20e-3, 1e-3, 2000.0, 40e-3)  # many images, far beside


@pytest.mark.slow
@pytest.mark.parametrize(("a", "b", "Z", "t", "mu_r", "d"), [FERRITE, (4e-3, 9e-3, 5e-3, 3e-3, 1.05, 7e-3), FAR])
def test_hankel_integrals(a, b, Z, t, mu_r, d):
    beta = (mu_r - 1) / (mu_r + 1)

    def integrand(k):
        fall = math.exp(-2 * k * t)
        return j1(k * a) * j1(k * b) * j0(k * d) * math.exp(-k * Z) * beta * (1 - fall) / (1 - beta**2 * fall)

    # beyond k = 45/Z the exponential is 3e-20
    value, error = quad(integrand, 0, 45 / Z, limit=2000, epsrel=1e-12, epsabs=0)
    M, _ = _of_circles(a, b, Z / 2, Z / 2, t, mu_r, d)
    assert pytest.approx(MU_0 * np.pi * a * b * value, rel=1e-8) == M
    assert error < 1e-9 * abs(value)


@pytest.mark.lowest
def test_coils_on_other_layers_are_of_other_kinds():
    """NumPy 2.0.0 alone returns the kinds in another shape, and the coupling was 0.0834."""
    text = read("starter").replace("turns_per_layer = 12", "turns_per_layer = 3").replace("columns = 3", "columns = 2")
    design = parse_design(text)
    both, sheets = design.array.conductors(), design.sheets
    alone = [layer_inductance([path], sheets)[0, 0] for path in both]
    np.testing.assert_allclose(np.diag(layer_inductance(both, sheets)), alone, rtol=1e-6)  # of the accuracy "full"
    k = couple_design(design).coupling.values[0, 1]
    assert k == pytest.approx(0.0508, abs=5e-5)  # to the digits that are printed


def _box(lift=0.0, turn=0.3):
    """Open path with level, slanted and vertical parts, its ends 1 mm apart."""
    corners = np.array([[0, 0, -4], [9, 0, -4], [9, 0, -8], [9, 7, -8], [2, 9, -3], [0, 7, -3], [0, 1, -3]]) * 1e-3
    return Rotation.from_euler("z", turn).apply(corners) + np.array([0, 0, lift])


PATHS = [_box(), _box(1e-3, 2.0), polygon(5, 8e-3, -2e-3)]
LINE = Spiral(6, 24e-3, 4, 1e-3, 0.4e-3).centre_line(0)
SPIRAL = Conductor(np.column_stack((LINE, np.full(len(LINE), -0.1e-3))), 1e-3, 0.2e-3, name="spiral")


def _series(paths, slab, terms):
    """The image series as it is written, every term by `mutual_inductance`."""
    F = []
    for n in range(terms + 1):
        lift = [0, 0, 2 * (slab.lower + n * slab.thickness)]
        images = [Conductor(p.vertices * [1, 1, -1] + lift, p.widths, p.thicknesses) for p in paths]
        F.append(mutual_inductance(paths, images))
    return sum(slab.reflection ** (2 * n + 1) * (F[n] - F[n + 1]) for n in range(terms))


def test_image_series():
    paths = as_conductors(PATHS)
    # β² = 0.21: 20 terms leave 3e-14; the rules along filaments are good to 1e-11 of the parts, which cancel by 1e2
    change = layer_inductance(paths, STACK)
    np.testing.assert_allclose(change, _series(paths, magnetic_slab(STACK), 20), rtol=1e-9, atol=1e-10 * change.max())
    paths = load_design("gast2020").array.conductors()[:2]
    change = layer_inductance(paths, STACK)
    # mutual_inductance leaves the cross-section out beyond 40 widths, the spectrum does not: measured 1.8e-5
    np.testing.assert_allclose(change, _series(paths, magnetic_slab(STACK), 8), rtol=4e-5)


def _strands(bars):
    """Filaments at Gauss nodes of the cross-sections of level bars, and their weights."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    lines, shares = [], []
    ends = zip(bars.vertices[:-1], bars.vertices[1:], bars.widths, bars.thicknesses, strict=True)
    for start, end, width, thickness in ends:
        along = (end - start) / np.linalg.norm(end - start)
        for (x, p), (y, q) in itertools.product(zip(nodes, weights, strict=True), repeat=2):
            offset = x * width / 2 * np.array([-along[1], along[0], 0]) + [0, 0, y * thickness / 2]
            lines.append(np.array([start + offset, end + offset]))
            shares.append(p * q / 4)
    return lines, np.array(shares)


@pytest.mark.slow
@pytest.mark.parametrize(("width", "thickness", "angle"), [(1e-3, 0.2e-3, 5.0), (0.5e-3, 0.5e-3, 4.0)])
def test_cross_section(width, thickness, angle):
    # images from three widths on; a corner, so that pairs are parallel and not
    corner = np.array([[0, 0, -1e-3], [9e-3, 0, -1e-3], [9e-3 + 6e-3 * np.cos(angle), 6e-3 * np.sin(angle), -1e-3]])
    bars, stack = Conductor(corner, width, thickness), [Sheet("base", 1.5e-3), MAGNETIC]
    slab = magnetic_slab(stack)
    assert flat_layer._near_images(flat_layer.board_below((bars,), slab.lower, "full"), slab) == 0
    lines, shares = _strands(bars)
    filaments = shares @ _series(as_conductors(lines), slab, 14) @ shares
    change = layer_inductance([bars], stack)[0, 0]
    # 1e-8: four nodes across bars whose distance is three and more widths; β^28 = 3e-10 ends the series
    assert change == pytest.approx(filaments, rel=1e-8)
    assert abs(layer_inductance([corner], stack)[0, 0] / change - 1) > 1e-4  # the cross-section counts here


@pytest.mark.slow
@pytest.mark.parametrize("mu_r", [1.3, 2.7, 300.0])
def test_near_images_and_spectrum_share_the_series(monkeypatch, mu_r):
    stack = [Sheet("base", 1e-3), Sheet("magnetic", 1.5e-3, mu_r)]
    spectrum = layer_inductance(PATHS, stack)
    for near in (1, 2, 7):
        monkeypatch.setattr(flat_layer, "_near_images", lambda board, slab, near=near: near)
        # 1e-11 of the parts by the rules along filaments, 1e-12 by those over the spectrum
        np.testing.assert_allclose(layer_inductance(PATHS, stack), spectrum, rtol=1e-10, atol=1e-10 * spectrum.max())


def test_rules_over_the_spectrum_converge(monkeypatch):
    paths = [polygon(6, 11e-3, -1e-3), polygon(6, 11e-3, -1.5e-3, centre=(60e-3, 5e-3))]
    stack = [Sheet("base", 3e-3), Sheet("magnetic", 0.5e-3, 50.0)]
    errors = []
    monkeypatch.setitem(flat_layer.DIGITS, "full", 40.0)
    finest = layer_inductance(paths, stack)
    for digits in (5.0, 10.0, 15.0, 25.0):
        monkeypatch.setitem(flat_layer.DIGITS, "full", digits)
        errors.append(abs(layer_inductance(paths, stack) - finest).max() / finest.max())
    # geometric: each step of 5 takes e⁻⁵ = 1/148 by the bound, and at least a tenth of that is seen
    assert errors[2] < errors[1] / 15 < errors[0] / 15**2
    assert errors[3] < 1e-11  # the default; measured 2e-12


def _loop(centre, normal, radius):
    n = np.asarray(normal) / np.linalg.norm(normal)
    u = np.cross(n, [0, 0, 1.0] if abs(n[2]) < 0.9 else [1.0, 0, 0])
    u /= np.linalg.norm(u)
    flat = polygon(6, radius)
    return np.asarray(centre) + flat[:, :1] * u + flat[:, 1:2] * np.cross(n, u)


normals = st.tuples(*(st.floats(-1, 1) for _ in range(3))).filter(lambda n: np.linalg.norm(n) > 0.1)


@pytest.mark.slow
@settings(max_examples=8)
@given(normals, normals)
def test_directions_by_dipoles(first, second):
    # small loops below a half space; their images as pairs of magnetic charges, each −β of the charge it mirrors
    radius, z, places = 1e-5, -5e-3, ([0.0, 0.0, -5e-3], [3e-3, 1e-3, -5e-3])
    loops = [_loop(place, n, radius) for place, n in zip(places, (first, second), strict=True)]
    moments = [1.5 * math.sqrt(3) * radius**2 * np.array(n) / np.linalg.norm(n) for n in (first, second)]
    image = 0.5 * moments[0] * [-1, -1, 1]  # μr = 3
    r = np.array(places[1]) - np.array([0, 0, -z])
    distance = np.linalg.norm(r)
    field = MU_0 / (4 * np.pi) * (3 * r * (image @ r) / distance**2 - image) / distance**3
    M = layer_inductance(loops, [Sheet("magnetic", THICK, 3.0)])[0, 1]
    # the loops' size over their distance squared: 1e-6; images taken as Neumann sums of 1e-11 of parts 1e4 as large
    assert pytest.approx(field @ moments[1], abs=1e-5 * np.linalg.norm(field) * np.linalg.norm(moments[1])) == M


def test_image_meets_the_boundary_conditions():
    loop = np.vstack((_box(), _box()[:1]))  # closed
    slab = Slab(1e-3, THICK, 2.7)
    image = [flat_layer.mirrored(path, slab.lower) for path in as_conductors([loop])]
    points = np.array([[1e-3, 2e-3, 1e-3], [-6e-3, 4e-3, 1e-3], [20e-3, -9e-3, 1e-3]])
    own, mirrored = magnetic_field([loop], points), magnetic_field(image, points)
    below, above = own + slab.reflection * mirrored, (1 + slab.reflection) * own
    scale = 1e-12 * abs(own).max()  # rounding
    np.testing.assert_allclose(below[:, 2], above[:, 2], atol=scale)  # B across the face
    np.testing.assert_allclose(below[:, :2], above[:, :2] / 2.7, atol=scale)  # µ0 H along it


def test_infinite_permeability_is_one_image():
    paths, mirrored = ([polygon(6, 8e-3, z), polygon(6, 8e-3, z, centre=(9e-3, 0))] for z in (-1e-3, 13e-3))
    change = layer_inductance(paths, [BASE, Sheet("magnetic", 2e-3, 1e300)])
    # rules over the spectrum: 1e-11
    np.testing.assert_allclose(change, mutual_inductance(paths, mirrored), rtol=1e-10)


def test_weak_and_thin_sheets_are_of_first_order():
    def of_sheet(thickness, mu_r):
        return layer_inductance([HEXAGON], [BASE, Sheet("magnetic", thickness, mu_r)])[0, 0]

    # φ → kt (μr − 1/μr)/2 for t → 0: minus the slope of the image's M over its height
    above, below = (mutual_inductance([HEXAGON], [polygon(6, 8e-3, 13e-3 + z)])[0, 0] for z in (1e-6, -1e-6))
    slope = (above - below) / 2e-6
    errors = [of_sheet(t, 5.0) / (-t * (5.0 - 0.2) / 2 * slope) - 1 for t in (2e-6, 1e-6)]
    assert errors[0] / errors[1] == pytest.approx(2, abs=0.01)  # the next term is of first order in t
    assert abs(errors[1]) < 1e-3
    weak = [of_sheet(2e-3, 1 + chi) / chi for chi in (1e-6, 1e-9)]
    # 1 + 1e-9 keeps seven digits of the susceptibility
    assert weak[0] == pytest.approx(weak[1], rel=2e-6)


def _random_loop(seed, z):
    corners = np.random.default_rng(seed).uniform([-8e-3, -8e-3, -16e-3 - z], [8e-3, 8e-3, -z], (6, 3))
    return np.vstack((corners, corners[:1]))


@pytest.mark.slow
@settings(max_examples=10)
@given(
    st.lists(st.integers(0, 10**6), min_size=1, max_size=4, unique=True), st.floats(1.5e-3, 10e-3),
    st.floats(0.1e-3, 20e-3), st.floats(1.01, 1e4),
)  # fmt: skip
def test_positive_definite_for_any_closed_shapes(seeds, z, thickness, mu_r):
    change = layer_inductance([_random_loop(seed, z) for seed in seeds], [Sheet("magnetic", thickness, mu_r)])
    np.testing.assert_array_equal(change, change.T)
    assert np.linalg.eigvalsh(change).min() > 0


@pytest.mark.slow
@settings(max_examples=5)
@given(st.floats(0, 6.28), st.floats(-0.05, 0.05), st.floats(0.2, 5.0))
def test_rotation_translation_and_scale(angle, x, scale):
    paths = [_box(), polygon(5, 8e-3, -2e-3)]
    moved = [np.add(Rotation.from_euler("z", angle).apply(path), [x, 2 * x, 0]) * scale for path in paths]
    stack = [Sheet("base", 1e-3), MAGNETIC]
    scaled = [Sheet(sheet.name, sheet.thickness * scale, sheet.relative_permeability) for sheet in stack]
    change = layer_inductance(paths, stack)
    # other directions of k, other panels: 1e-11
    np.testing.assert_allclose(layer_inductance(moved, scaled), scale * change, rtol=1e-10, atol=1e-10 * change.max())


def test_pieces_and_directions_add_up():
    whole = _box()
    pieces = [whole[:3], whole[2:5], whole[4:]]
    # parts that cancel, each to 1e-11
    assert layer_inductance(pieces, STACK).sum() == pytest.approx(layer_inductance([whole], STACK)[0, 0], rel=1e-9)
    b = polygon(4, 5e-3, -2e-3, centre=(2e-3, 1e-3))
    change, turned = layer_inductance([HEXAGON, b], STACK), layer_inductance([HEXAGON, b[::-1]], STACK)
    np.testing.assert_allclose(turned, change * [[1, -1], [-1, 1]], rtol=1e-12)  # rounding
    assert change[0, 1] > 0  # two loops in one sense on one axis


@pytest.mark.slow
def test_closer_thicker_and_stronger_sheets_add_more():
    for stacks in (
        [[Sheet("base", z), MAGNETIC] for z in (8e-3, 4e-3, 2e-3, 0.5e-3, 0.05e-3)],
        [[BASE, Sheet("magnetic", t, 2.7)] for t in (0.1e-3, 1e-3, 3e-3, 30e-3, 1.0)],
        [[BASE, Sheet("magnetic", 2e-3, mu_r)] for mu_r in (1.0, 1.1, 2.0, 20.0, 2e4)],
    ):
        assert (np.diff([layer_inductance([HEXAGON], stack)[0, 0] for stack in stacks]) > 0).all()
    # a half space of infinite permeability adds the whole image, and no sheet more
    image = mutual_inductance([HEXAGON], [polygon(6, 8e-3, 13e-3)])[0, 0]
    assert layer_inductance([HEXAGON], [BASE, Sheet("magnetic", 30e-3, 2e4)])[0, 0] < image


def test_sheet_on_the_copper():
    # bars that touch the sheet, and so their own images, against a sheet a hair above
    paths = [SPIRAL, Conductor(polygon(6, 8e-3, -1e-3), 0.5e-3, 0.5e-3)]
    on, above = layer_inductance(paths, [MAGNETIC]), layer_inductance(paths, [Sheet("tape", 1e-6), MAGNETIC])
    # 2 µm of the image's distance, against a mean distance in the trace of some 0.2 mm
    np.testing.assert_allclose(on, above, rtol=5e-3)
    assert (on > above).all()
    # the half space can at most double an inductance: what it adds is β L for copper at the face, less by its depth
    assert on[0, 0] < magnetic_slab([MAGNETIC]).reflection * inductance_matrix(paths)[0, 0]


def test_equal_sheets_merge():
    whole = layer_inductance([HEXAGON], [BASE, MAGNETIC, Sheet("cover", 1e-3)])
    halves = [Sheet("lower", 1.2e-3, 2.7), Sheet("upper", 0.8e-3, 2.7)]
    assert magnetic_slab([BASE, *halves]) == Slab(6e-3, 2e-3, 2.7)
    np.testing.assert_allclose(layer_inductance([HEXAGON], [BASE, *halves]), whole, rtol=1e-12)
    # cutting the base, or lowering the coil in place of it, changes nothing
    cut = [Sheet("a", 2e-3), Sheet("b", 4e-3), MAGNETIC]
    np.testing.assert_allclose(layer_inductance([HEXAGON], cut), whole, rtol=1e-12)
    np.testing.assert_allclose(layer_inductance([polygon(6, 8e-3, -7e-3)], [MAGNETIC]), whole, rtol=1e-12)
    assert magnetic_slab([BASE]) is None
    for stack in ([], [BASE], [BASE, Sheet("cover", 1e-3, 1.0)]):
        np.testing.assert_array_equal(layer_inductance([HEXAGON, polygon(4, 3e-3, 2e-3)], stack), np.zeros((2, 2)))


@pytest.mark.slow
def test_effect_on_the_reference_board():
    board = first_assumed().array
    L, change = inductance_matrix(board), layer_inductance(board, STACK)
    np.testing.assert_array_equal(change, change.T)
    relative = change / L
    # a coil's inductance rises by 2 %; the sheet guides flux past the neighbour's far side, which lowers |M|
    assert relative[0, 0] == pytest.approx(0.0203, abs=5e-4)
    assert relative[0, 1] == pytest.approx(-0.0500, abs=5e-4)
    # equal coils on equal layers, to rounding
    np.testing.assert_allclose(change[[0, 1, 0], [0, 1, 2]], change[[2, 3, 2], [2, 3, 4]], rtol=1e-10)
    assert change[0, 0] > change[1, 1]  # on the upper layers, nearer to the sheet
    coils, last = board.conductors()[:2], (0.1e-3, 35e-6)
    ends = [np.vstack((coil.vertices, coil.vertices[:1])) for coil in coils]
    closed = [Conductor(v, [*c.widths, last[0]], [*c.thicknesses, last[1]]) for v, c in zip(ends, coils, strict=True)]
    relative = layer_inductance(closed, STACK) / change[:2, :2] - 1
    # what the docstring says of open ends, to the digits given there
    assert relative[0] == pytest.approx([-0.0010, -0.0033], abs=5e-5)


def test_equal_shapes_share_a_spectrum(monkeypatch):
    shapes, whole = [], flat_layer._transform
    monkeypatch.setattr(flat_layer, "_transform", lambda shape, *rest: shapes.append(id(shape)) or whole(shape, *rest))
    layer_inductance(load_design("starter").array, STACK)
    assert len(set(shapes)) == 1


SEVERAL = r"must lie on each other and have one .*got 'a' .*, 'c' "
THROUGH = Conductor([[0, 0, 0], [1e-3, 0, 7e-3], [2e-3, 0, 0]], 0.1e-3, 35e-6, name="coil 3")


@pytest.mark.parametrize(("paths", "stack", "error", "message"), [
    ([HEXAGON, THROUGH], STACK, ElastomerError, r"below the magnetic .*z = 0\.006 m; coil 3 reaches z = 0\.007"),
    # half of a bar's thickness counts, and it may touch; a filament may not
    ([Conductor(polygon(6, 8e-3), 0.1e-3, 35e-6, name="trace")], [MAGNETIC], ElastomerError, r"trace .* 1\.75e-05"),
    ([polygon(6, 8e-3)], [MAGNETIC], ElastomerError, "path 1 reaches z = 0 m"),
    ([HEXAGON], [Sheet("a", 1e-3, 2.7), BASE, Sheet("c", 1e-3, 2.7)], ElastomerError, SEVERAL),
    ([HEXAGON], [Sheet("a", 1e-3, 2.7), Sheet("c", 1e-3, 5.0)], ElastomerError, SEVERAL),
    ([HEXAGON], [BASE, Sheet("a", 1e-3, 5.0), Sheet("c", 1e-3, 2.7), BASE], ElastomerError, SEVERAL),
    ([], STACK, GeometryError, "at least one current path"),
    ([[[0, 0, 0], [1, 0, np.nan]]], STACK, GeometryError, "must be finite"),
])  # fmt: skip
def test_refuses_paths_in_the_sheet_several_regions_and_what_is_none(paths, stack, error, message):
    with pytest.raises(error, match=message):
        layer_inductance(paths, stack)


def test_a_layer_that_would_take_hours_is_refused_before_any_work():
    angle = np.linspace(0, 2 * np.pi, 20_001)
    ring = 50.0 * np.column_stack((np.cos(angle), np.sin(angle), 0 * angle))
    with lasting(5.0), pytest.raises(GeometryError, match=r"20001 corners .* times the work that is allowed"):
        layer_inductance([ring], [Sheet("base", 5e-3), Sheet("magnetic", 2e-3, 2.7)])


def test_tilted_bars_keep_their_widths_in_a_mirror():
    """Against the image in a thick iron body: β times M with the mirrored path, widths and all."""
    loop = Conductor([[0, 0, 0], [1e-2, 0, 0], [1e-2, 1e-2, 0], [0, 1e-2, 0], [0, 1e-4, 0]], 1e-3, 35e-6)
    paths = [loop, loop.posed(Pose(x=2e-3, z=-6e-3, turn=(0.4, 0.3, 0.1)))]
    change = layer_inductance(paths, [Sheet("air", 2e-3), Sheet("iron", 50.0, 3.0)])
    images = 0.5 * mutual_inductance(paths, [mirrored(path, 2e-3) for path in paths])
    np.testing.assert_allclose(change, images, rtol=3e-8)  # the accuracy of distant pairs
