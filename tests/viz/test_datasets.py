"""Datasets are checked as arrays and as physics: where they lie, how large they are, and what they show."""

import math

import numpy as np
import pytest
import shapely
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import chdtr
from support.boards import SHEETS, reference_board

from coilarray.electromagnetics.field import grid_points, magnetic_field, vector_potential
from coilarray.errors import GeometryError
from coilarray.geometry.copper import copper_features, drills, solids
from coilarray.viz.datasets import results
from coilarray.viz.datasets.meshes import barrel_mesh, board_mesh, copper_mesh, sheet_meshes, surface_of

COPPER, DIELECTRIC = 35e-6, 0.215e-3


@pytest.fixture(scope="module")
def board():
    return reference_board(count=3, turns=5)


@pytest.fixture(scope="module")
def parts(board):
    return solids(board, SHEETS)


def test_copper_has_the_volume_of_its_outline(board, parts):
    mesh = copper_mesh(parts, board.names, "L1")
    shapes = shapely.union_all([feature.shape for feature in copper_features(board) if feature.layer == "L1"])
    holes = shapely.union_all([shapely.Point(d.x, d.y).buffer(d.diameter / 2) for d in drills(board)])
    expected = shapes.difference(holes).area * COPPER
    # circles here have 64 corners, those of the solids may have more: 2e-3 of the area of the pads
    assert mesh.volume * 1e-9 == pytest.approx(expected, rel=2e-3)
    assert mesh.is_manifold


def test_copper_lies_on_its_layer_and_says_which_coil_it_is(board, parts):
    for layer in board.stackup.names:
        z_min, z_max = copper_mesh(parts, board.names, layer).bounds[4:]
        assert (z_min, z_max) == pytest.approx(np.multiply(board.stackup.span(layer), 1e3), abs=1e-6)
    mesh = copper_mesh(parts, board.names, "L3")
    coil = mesh.cell_data["coil"]
    centres = mesh.cell_centers().points[:, 0]
    assert set(coil.tolist()) == {0, 1, 2}  # C2 winds here; C1 and C3 have pads
    middle = board.placements[1].x * 1e3
    assert (np.abs(centres[coil == 1] - middle) < 11.6).all()
    assert (centres[coil == 0] < middle).all()
    assert copper_mesh(parts, board.names, "L9").n_cells == 0
    assert board_mesh({}).n_cells == 0


def test_barrels_are_those_of_the_holes_and_of_their_coils(board, parts):
    mesh = barrel_mesh(parts, board.names)
    bodies = mesh.split_bodies()
    assert len(bodies) == len(drills(board)) == 9
    area = sum(math.pi * 25e-6 * (hole.diameter - 25e-6) for hole in drills(board))
    # a circle of 64 corners or more misses at most 2e-3 of its area
    assert mesh.volume * 1e-9 == pytest.approx(area * board.stackup.thickness, rel=3e-3)
    assert np.bincount(np.unique(mesh.cell_data["coil"])).tolist() == [1, 1, 1]
    box = parts["board"]
    mesh = barrel_mesh({"barrel/C1/0": box, "barrel/C11/0": box, "barrel/C1/1": box}, ["C1", "C11"])
    assert np.bincount(mesh.cell_data["coil"]).tolist() == [2 * len(box.faces), len(box.faces)]


def test_the_board_fills_its_outline(board, parts):
    x_min, x_max, y_min, y_max, *_ = board_mesh(parts).bounds
    assert (x_min, y_min, x_max, y_max) == pytest.approx(np.multiply(board.bounds, 1e3))


@pytest.mark.parametrize(("lift", "spread"), [(0.0, 0.0), (20e-3, 5e-3)])
def test_sheets_lie_on_each_other_or_are_lifted(parts, lift, spread):
    meshes = sheet_meshes(parts, lift, spread)
    assert list(meshes) == ["base", "magnetic"]
    assert meshes["base"].bounds[4:] == pytest.approx((1e3 * lift, 1e3 * lift + 6))
    bottom = 1e3 * (lift + spread) + 6
    assert meshes["magnetic"].bounds[4:] == pytest.approx((bottom, bottom + 2))


@pytest.mark.parametrize("z", [[2e-3], [2e-3, 3e-3, 5e-3]])
@pytest.mark.lowest
def test_every_vector_stands_at_its_point(z):
    x, y = [0.0, 1e-3, 3e-3, 4e-3], [-1e-3, 0.0, 2e-3]
    field = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)  # the vector at a point is its position
    grid = results.field_grid(x, y, z, field)
    assert grid.dimensions == (4, 3, len(z))
    np.testing.assert_allclose(grid.point_data["B (T)"] * 1e3, grid.points, rtol=1e-6)


def test_a_field_of_another_shape_is_refused():
    with pytest.raises(ValueError, match=r"\(2, 1, 1, 3\); got \(1, 2, 1, 3\)"):
        results.field_grid([0, 1], [0], [0], np.zeros((1, 2, 1, 3)))
    with pytest.raises(ValueError, match="x of a field grid must be one ascending row"):
        results.field_grid([1, 0], [0], [0], np.zeros((2, 1, 1, 3)))


CENTRES = np.array([[-10e-3, 0.0], [0.0, 1e-3], [10e-3, 0.0], [3e-3, 15e-3]])
K = np.array([[1, -0.05, 0.001, 0.02], [-0.05, 1, -0.04, 0], [0.001, -0.04, 1, -0.01], [0.02, 0, -0.01, 1]])


def test_arcs_end_at_the_centres_of_their_coils_and_weak_ones_can_be_left_out():
    arcs = results.coupling_arcs(CENTRES, K)
    assert arcs.n_lines == 6
    for n in range(6):
        points = np.asarray(arcs.get_cell(n).points)
        first, second = (int(arcs.cell_data[name][n]) for name in ("coil", "other"))
        np.testing.assert_allclose(points[0], [*CENTRES[first] * 1e3, 0.0], atol=1e-6)
        np.testing.assert_allclose(points[-1], [*CENTRES[second] * 1e3, 0.0], atol=1e-6)
        assert arcs.cell_data[results.COUPLING][n] == K[first, second]
        span = np.linalg.norm(CENTRES[first] - CENTRES[second]) * 1e3
        assert points[:, 2].max() == pytest.approx(0.3 * span)
        # upright: the middle of the arc is over the middle of its coils
        np.testing.assert_allclose(points[16, :2], (CENTRES[first] + CENTRES[second]) / 2 * 1e3, atol=1e-6)
    arcs = results.coupling_arcs(CENTRES, K, least=0.02)
    assert sorted(zip(arcs.cell_data["coil"].tolist(), arcs.cell_data["other"].tolist(), strict=True)) == [
        (0, 1), (0, 3), (1, 2),
    ]  # fmt: skip
    assert results.coupling_arcs(CENTRES, K, least=1).n_cells == 0
    assert results.arc_tubes(results.coupling_arcs(CENTRES, K, least=1), 1.0).n_cells == 0


def test_tubes_are_as_thick_as_the_coupling():
    arcs = results.coupling_arcs(CENTRES, K, least=0.01)
    tubes = results.arc_tubes(arcs, 0.5)
    k, points = tubes.point_data[results.COUPLING], np.asarray(tubes.points)
    assert set(k) == set(arcs.cell_data[results.COUPLING]) == {-0.05, -0.04, 0.02, -0.01}
    for n, one in enumerate(arcs.cell_data[results.COUPLING]):
        line = np.asarray(arcs.get_cell(n).points)
        nearest = np.linalg.norm(points[k == one][:, None] - line, axis=2).min(axis=1)
        assert nearest.max() == pytest.approx(0.5 * abs(one) / 0.05, rel=1e-3)


def hills():
    x, y, h = np.linspace(-6e-3, 6e-3, 13), np.linspace(-4e-3, 4e-3, 5), np.array([0.5e-3, 1e-3])
    bell = np.exp(-((x - 1e-3) ** 2 + y[:, None] ** 2) / (4e-3) ** 2)
    delta = np.stack([h[:, None, None] * bell, -2 * h[:, None, None] * bell], axis=-1)
    coords = {"depth": h, "y": y, "x": x, "state": ["a", "b"]}
    return xr.Dataset({"delta": (("depth", "y", "x", "state"), delta)}, coords)


def test_what_cannot_be_drawn_over_a_board_is_refused():
    with pytest.raises(ValueError, match="state must be one of a, b; got 'c'"):
        results.of_state(hills(), "c")
    with pytest.raises(ValueError, match="depth must be the position of one of 2 depths; got 2"):
        results.at_depth(hills(), 2)


@settings(max_examples=30)
@given(
    st.floats(1e-6, 1e-2), st.floats(1e-6, 1e-2), st.floats(-0.99, 0.99), st.floats(0.05, 0.999),
    st.sampled_from([1.0, 20.0]),
)  # fmt: skip
def test_an_ellipse_is_its_covariance(sx, sy, correlation, confidence, magnification):
    covariance = np.array([[sx**2, correlation * sx * sy], [correlation * sx * sy, sy**2]])
    centre = (3e-3, -7e-3)
    ellipse = results.uncertainty_ellipse(centre, covariance, confidence, magnification=magnification, height=1e-3)
    points = np.asarray(ellipse.points, dtype=float)
    assert (points[:, 2] == 1.0).all()
    away = (points[:-1, :2] * 1e-3 - centre) / magnification
    # every point has the Mahalanobis distance whose χ² with two degrees of freedom has the confidence
    distance = np.einsum("ni,ij,nj->n", away, np.linalg.inv(covariance), away)
    # single precision in mm, at worst 7e-3/1e-6 of the centre and 1/(1 − ρ²) of the inverse
    np.testing.assert_allclose(chdtr(2, distance), confidence, atol=0.05)
    # equal steps of the angle: the mean of r rᵀ is q/2 Σ
    q = -2 * math.log(1 - confidence)
    np.testing.assert_allclose(
        away.T @ away / len(away), q / 2 * covariance, rtol=2e-2, atol=2e-2 * q * covariance.max()
    )


RADIUS = 8e-3
ANGLE = np.linspace(0, 2 * np.pi, 181)
LOOP = np.column_stack((RADIUS * np.cos(ANGLE), RADIUS * np.sin(ANGLE), 0 * ANGLE))


def density(x, y, z):
    """B of 1 A in the loop on a grid, as a dataset of the near field."""
    axes = {name: np.atleast_1d(np.asarray(axis, dtype=float)) for name, axis in zip("xyz", (x, y, z), strict=True)}
    return results.field_grid(x, y, z, magnetic_field([LOOP], grid_points(*axes.values())))


@pytest.fixture(scope="module")
def box():
    """A box about the loop, without points within 0.25 mm of its plane."""
    z = np.arange(-14.75e-3, 15e-3, 0.5e-3)
    x = np.arange(-20e-3, 20.1e-3, 0.5e-3)
    return density(x, x, z)


def flux(grid, axis):
    """Integral of the component of B along an axis over a plane, in T·mm²."""
    surface = surface_of(grid).point_data_to_cell_data()
    area = surface.compute_cell_sizes(length=False, volume=False).cell_data["Area"]
    return float(surface.cell_data[results.FIELD][:, axis] @ area)


def test_no_flux_leaves_a_closed_surface():
    spans = [np.linspace(-3e-3, 9e-3, 61), np.linspace(-4e-3, 5e-3, 46), np.linspace(1e-3, 7e-3, 31)]
    out, through = 0.0, 0.0
    for axis in range(3):
        for end, sign in ((0, -1), (-1, 1)):
            at = [np.array([span[end]]) if k == axis else span for k, span in enumerate(spans)]
            amount = flux(density(*at), axis)
            out += sign * amount
            through += abs(amount)
    # 0.2 mm cells, bilinear: (0.2/3)²/12 of a field that changes over some 3 mm
    assert abs(out) < 5e-4 * through
    assert through > 0


def test_arrows_lie_along_the_field():
    x, z = np.linspace(-12e-3, 12e-3, 25), np.linspace(2e-3, 8e-3, 7)
    arrows = results.field_arrows(density(x, [1e-3], z), 2e-3)
    places = grid_points(x[::2], [1e-3], z[::2]).reshape(-1, 3)  # 1 mm apart: every second point
    B = magnetic_field([LOOP], places)
    amount = np.linalg.norm(B, axis=1, keepdims=True)
    each = np.asarray(arrows.points, dtype=float).reshape(len(places), -1, 3)
    given = arrows.point_data[results.FIELD].reshape(each.shape)
    np.testing.assert_allclose(given, np.broadcast_to(B[:, None], given.shape), rtol=1e-9)
    along = np.einsum("nkc,nc->nk", each - 1e3 * places[:, None], B / amount)
    # from tail to tip it lies about its place; single precision
    for end, found in ((-1, along.min(axis=1)), (1, along.max(axis=1))):
        np.testing.assert_allclose(found, end * np.sqrt(amount / amount.max())[:, 0], rtol=1e-4)


def test_lines_keep_their_flux(box):
    # B_ρ = −∂A_φ/∂z and B_z = ∂(ρA_φ)/ρ∂ρ: on a line of B the flux 2πρ A_φ through its circle is one
    seeds = [[2e-3, 0, 3e-3], [0, 4e-3, 3e-3], [-5e-3, 1e-3, 3e-3], [6e-3, 0, 3e-3]]
    lines = results.field_lines(box, seeds)
    assert lines.n_lines == 4
    for k, seed in enumerate(seeds):
        points = np.asarray(lines.get_cell(k).points) * 1e-3
        near = np.linalg.norm(points - seed, axis=1).min()
        assert near < 0.15e-3  # a step is a quarter of a cell
        rho = np.hypot(*points[:, :2].T)
        A = vector_potential([LOOP], points)
        phi = (A[:, 1] * points[:, 0] - A[:, 0] * points[:, 1]) / rho
        far = np.abs(np.abs(points[:, 2])) > 0.75e-3  # between the planes next to the loop B is interpolated across it
        stream = (rho * phi)[far]
        # cells of 0.5 mm beside a wire 2 mm away at the least: (0.5/2)²/12 along a fourth of the way round
        assert np.ptp(stream) < 0.03 * stream.mean()


def test_a_line_goes_round_once_or_leaves_both_ways(box):
    (line,) = (np.asarray(results.field_lines(box, [[6.5e-3, 0, 2e-3]]).get_cell(0).points),)
    length = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    # about the wire, 1.5 to 3 mm away from it, and back to where it began
    assert 2 * np.pi * 1.5 < length < 2 * np.pi * 4
    assert np.linalg.norm(line[-1] - line[0]) < 0.05 * length
    middle = line - [8.0, 0.0, 0.0]
    turned = np.unwrap(np.arctan2(middle[:, 2], middle[:, 0]))
    assert abs(turned[-1] - turned[0]) == pytest.approx(2 * np.pi, abs=0.3)
    line = np.asarray(results.field_lines(box, [[0.5e-3, 0, 2e-3]]).get_cell(0).points)
    low, high = box.bounds[4:]
    assert line[:, 2].min() == pytest.approx(low, abs=0.5)
    assert line[:, 2].max() == pytest.approx(high, abs=0.5)
    empty = box.copy()
    empty.point_data[results.FIELD] = np.zeros((empty.n_points, 3))
    assert results.field_lines(empty, [[0, 0, 3e-3]]).n_cells == 0


def test_memory_is_refused_above_the_limit_of_the_right_size():
    results.require_memory(1_000_000, "a spacing")
    with pytest.raises(
        GeometryError, match=r"^a spacing of 0.1 mm gives 1e\+08 points, about 22 GB of memory; at most"
    ):
        results.require_memory(100_000_000, "a spacing of 0.1 mm")
