"""Datasets are checked as arrays: where they lie, how large they are, which coil they belong to."""

import math

import numpy as np
import pytest
import shapely
from support.boards import SHEETS, reference_board

from coilarray.geometry.copper import copper_features, drills, solids
from coilarray.viz.datasets.meshes import barrel_mesh, board_mesh, copper_mesh, sheet_meshes
from coilarray.viz.datasets.results import field_grid

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
    grid = field_grid(x, y, z, field)
    assert grid.dimensions == (4, 3, len(z))
    np.testing.assert_allclose(grid.point_data["B (T)"] * 1e3, grid.points, rtol=1e-6)


def test_a_field_of_another_shape_is_refused():
    with pytest.raises(ValueError, match=r"\(2, 1, 1, 3\); got \(1, 2, 1, 3\)"):
        field_grid([0, 1], [0], [0], np.zeros((1, 2, 1, 3)))
    with pytest.raises(ValueError, match="x of a field grid must be one ascending row"):
        field_grid([1, 0], [0], [0], np.zeros((2, 1, 1, 3)))
