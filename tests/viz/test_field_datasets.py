"""Pictures of B are checked as physics: no flux out of a closed surface, arrows and lines along B, |B| on surfaces."""

import numpy as np
import pytest

from coilarray.electromagnetics.field import grid_points, magnetic_field, vector_potential
from coilarray.errors import GeometryError
from coilarray.viz.datasets import results as field
from coilarray.viz.datasets.meshes import surface_of

RADIUS = 8e-3
ANGLE = np.linspace(0, 2 * np.pi, 181)
LOOP = np.column_stack((RADIUS * np.cos(ANGLE), RADIUS * np.sin(ANGLE), 0 * ANGLE))


def density(x, y, z):
    """B of 1 A in the loop on a grid, as a dataset of the near field."""
    axes = {name: np.atleast_1d(np.asarray(axis, dtype=float)) for name, axis in zip("xyz", (x, y, z), strict=True)}
    return field.field_grid(x, y, z, magnetic_field([LOOP], grid_points(*axes.values())))


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
    return float(surface.cell_data[field.FIELD][:, axis] @ area)


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
    arrows = field.field_arrows(density(x, [1e-3], z), 2e-3)
    places = grid_points(x[::2], [1e-3], z[::2]).reshape(-1, 3)  # 1 mm apart: every second point
    B = magnetic_field([LOOP], places)
    amount = np.linalg.norm(B, axis=1, keepdims=True)
    each = np.asarray(arrows.points, dtype=float).reshape(len(places), -1, 3)
    given = arrows.point_data[field.FIELD].reshape(each.shape)
    np.testing.assert_allclose(given, np.broadcast_to(B[:, None], given.shape), rtol=1e-9)
    along = np.einsum("nkc,nc->nk", each - 1e3 * places[:, None], B / amount)
    # from tail to tip it lies about its place; single precision
    for end, found in ((-1, along.min(axis=1)), (1, along.max(axis=1))):
        np.testing.assert_allclose(found, end * np.sqrt(amount / amount.max())[:, 0], rtol=1e-4)


def test_lines_keep_their_flux(box):
    # B_ρ = −∂A_φ/∂z and B_z = ∂(ρA_φ)/ρ∂ρ: on a line of B the flux 2πρ A_φ through its circle is one
    seeds = [[2e-3, 0, 3e-3], [0, 4e-3, 3e-3], [-5e-3, 1e-3, 3e-3], [6e-3, 0, 3e-3]]
    lines = field.field_lines(box, seeds)
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
    (line,) = (np.asarray(field.field_lines(box, [[6.5e-3, 0, 2e-3]]).get_cell(0).points),)
    length = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    # about the wire, 1.5 to 3 mm away from it, and back to where it began
    assert 2 * np.pi * 1.5 < length < 2 * np.pi * 4
    assert np.linalg.norm(line[-1] - line[0]) < 0.05 * length
    middle = line - [8.0, 0.0, 0.0]
    turned = np.unwrap(np.arctan2(middle[:, 2], middle[:, 0]))
    assert abs(turned[-1] - turned[0]) == pytest.approx(2 * np.pi, abs=0.3)
    line = np.asarray(field.field_lines(box, [[0.5e-3, 0, 2e-3]]).get_cell(0).points)
    low, high = box.bounds[4:]
    assert line[:, 2].min() == pytest.approx(low, abs=0.5)
    assert line[:, 2].max() == pytest.approx(high, abs=0.5)
    empty = box.copy()
    empty.point_data[field.FIELD] = np.zeros((empty.n_points, 3))
    assert field.field_lines(empty, [[0, 0, 3e-3]]).n_cells == 0


def test_a_surface_has_its_magnitude(box):
    levels = [40e-6, 20e-6]
    surfaces = field.field_surfaces(box, levels)
    found = surfaces.point_data[field.AMOUNT]
    np.testing.assert_allclose(np.unique(found), sorted(levels), rtol=1e-6)  # single precision
    far = np.abs(surfaces.points[:, 2]) > 0.75  # mm
    true = np.linalg.norm(magnetic_field([LOOP], np.asarray(surfaces.points)[far] * 1e-3), axis=1)
    # linear between points 0.5 mm apart: (0.5/3)²/8 where |B| falls as 1/r within 3 mm of the wire
    np.testing.assert_allclose(true, found[far], rtol=1e-2)
    assert field.field_surfaces(box, [1.0]).n_cells == 0


def test_memory_is_refused_above_the_limit_of_the_right_size():
    field.require_memory(1_000_000, "a spacing")
    with pytest.raises(
        GeometryError, match=r"^a spacing of 0.1 mm gives 1e\+08 points, about 22 GB of memory; at most"
    ):
        field.require_memory(100_000_000, "a spacing of 0.1 mm")
