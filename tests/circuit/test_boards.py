"""Circuits of several boards against one board with the same coils, and under a move of the whole scene."""

import math
from dataclasses import replace

import numpy as np
import pytest

import coilarray as ca
from coilarray.circuit import board_circuit as making
from coilarray.circuit.coupling import operating_field, scan_design
from coilarray.design.model import Board, Circuit, Design
from coilarray.electromagnetics.inductance import inductance_matrix
from coilarray.geometry import MATERIALS, Plate, Pose, Spiral
from coilarray.geometry.array import Array

COIL = Array.row(Spiral(6, 10e-3, 4, 0.2e-3, 0.2e-3), 1)
ROW = Array.row(Spiral(4, 8e-3, 3, 0.2e-3, 0.2e-3), 2, pitch=12e-3)
FACING = Pose(x=1e-3, z=6e-3, turn=(math.pi, 0.1, 0.0))
PAIR = Design(ROW, boards=(Board(COIL, FACING, "receiver"),))


@pytest.fixture(scope="module")
def coupled():
    """Coupling of a row and a tilted receiver."""
    return ca.couple_design(PAIR)


def test_inductances_are_those_of_all_paths_in_space(coupled):
    L = inductance_matrix(PAIR.conductors(), allow_overlaps=True)
    np.testing.assert_allclose(coupled.inductance, L, atol=1e-4 * L.max())  # stated
    assert coupled.sel(coil="receiver/coil1").z == 6e-3


def test_boards_side_by_side_are_one_board():
    row = Array.row(Spiral(4, 8e-3, 3, 0.2e-3, 0.2e-3), 2, pitch=30e-3)
    one = replace(row, placements=row.placements[:1])
    apart = Design(one, boards=(Board(one, Pose(x=30e-3), "b"),))
    whole, split = ca.couple_design(Design(row)), ca.couple_design(apart)
    for name in ("inductance", "resistance", "frequency", "quality_factor"):
        # 1e-4 of L between boards, and the capacitance between coils 30 mm apart
        np.testing.assert_allclose(split[name].values, whole[name].values, rtol=2e-4, atol=1e-4 * 2e-6)


def test_a_move_of_the_whole_scene_changes_nothing(coupled):
    whole = Pose(3e-3, -2e-3, 5e-3, (0.3, -0.2, 1.0))
    moved = ca.couple_design(replace(PAIR, pose=whole, boards=(Board(COIL, whole.after(FACING), "receiver"),)))
    np.testing.assert_allclose(moved.inductance, coupled.inductance, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(moved.frequency, coupled.frequency, rtol=1e-6)


def test_the_mirror_image_and_the_exchanged_boards_couple_alike(coupled):
    def mirrored(spiral):  # at the plane x = 0
        return replace(spiral, winding="cw", first_corner=math.pi - spiral.first_corner)

    single, pair = Spiral(6, 10e-3, 4, 0.2e-3, 0.2e-3), Spiral(4, 8e-3, 3, 0.2e-3, 0.2e-3)
    rx, ry, rz = FACING.turn
    facing = replace(FACING, x=-FACING.x, turn=(rx, -ry, -rz))
    image = Design(
        Array.row(mirrored(pair), 2, pitch=12e-3), boards=(Board(Array.row(mirrored(single), 1), facing, "receiver"),)
    )
    exchanged = Design(COIL, pose=FACING, boards=(Board(ROW, name="row"),))
    for other, order in ((image, [1, 0, 2]), (exchanged, [1, 2, 0])):
        L = ca.couple_design(other).inductance.values[np.ix_(order, order)]
        # M between boards is summed in another order: 1e-4 of the larger L is stated
        np.testing.assert_allclose(np.abs(L), np.abs(coupled.inductance), atol=1e-6 * L.max())


def test_each_board_has_its_own_copper_and_the_circuit_is_that_of_the_whole(coupled):
    cold = Design(COIL, circuit=Circuit(resistivity=1e-8))
    there = ca.couple_design(Design(ROW, boards=(Board(cold, FACING, "receiver"),)))
    assert float(there.resistance[2] / coupled.resistance[2]) == pytest.approx(1e-8 / 1.72e-8, rel=0.01)
    np.testing.assert_array_equal(there.resistance[:2], coupled.resistance[:2])
    opened = ca.couple_design(replace(PAIR, circuit=Circuit(terminations={"receiver/coil1": "open"})))
    assert opened.termination.values.tolist() == ["short", "short", "open"]
    assert float(opened.inductance_change[0]) != float(coupled.inductance_change[0])


def test_what_is_left_out_between_boards_is_named():
    scan = scan_design(PAIR)
    assert "capacitance between boards" in scan.attrs["left_out"]
    assert scan.capacitance.sel(coil="receiver/coil1", other="coil1") == 0


def test_boards_are_not_computed_again_when_one_of_many_moves(monkeypatch):
    once, made = making._new_windings, []
    monkeypatch.setattr(making, "_new_windings", lambda *given: made.append(given) or once(*given))
    single = [Spiral(4, (5 + size / 100) * 1e-3, 1, 0.2e-3, 0.2e-3).as_array() for size in range(9)]
    for height, fewest in ((1e-3, 9), (2e-3, 0)):
        made.clear()
        boards = [Board(coil, Pose(x=(k + 1) * 12e-3, z=height)) for k, coil in enumerate(single)]
        design = Design(COIL, boards=tuple(boards))
        assert len(making.board_circuit(design, accuracy="screen").inductance) == 10
        assert fewest <= len(made) <= fewest + 1


def test_the_field_is_that_of_all_boards(coupled):
    at = [0.0], [0.0], [3e-3]
    own = operating_field(PAIR, coupled, "receiver/coil1", *at, terminated=False).B.values.ravel()
    alone = COIL.field(FACING.undo([[0.0, 0.0, 3e-3]]))[0] @ FACING.rotation.T
    np.testing.assert_allclose(own, alone, rtol=1e-9)


def test_a_plate_behind_both_boards_is_an_image_of_both():
    """A perfect mirror: k with the plate is that of the paths with their images."""
    plate = Plate("wall", 20e-3, 1e-3, MATERIALS["copper"])
    beside = ca.couple_design(replace(PAIR, plates=(plate,)))
    assert (np.diag(beside.plate_inductance) < 0).all()
    through = ca.couple_design(Design(ROW, plates=(plate,)))
    # the coil of the other board adds nothing to the images of this one
    np.testing.assert_allclose(beside.plate_inductance[:2, :2], through.plate_inductance, rtol=1e-2)
