"""Links over poses: M of single poses by other methods, two resonators, moved scenes and exchanged boards."""

import math
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from coilarray import Array, Board, Design, Spiral, couple_design, mutual_inductance
from coilarray.design.model import Circuit
from coilarray.design.ports import Port
from coilarray.errors import DesignError
from coilarray.geometry import FinitePlate, Pose, Rectangle
from coilarray.geometry.bodies import MATERIALS
from coilarray.studies.link import columns, link, moved_boards, pose_grid, pose_of, together

READER = Array.row(Spiral(4, 20e-3, 3, 0.5e-3, 0.5e-3), 2, pitch=24e-3)
TAG = Spiral(6, 12e-3, 4, 0.3e-3, 0.3e-3).as_array()
PAIR = Design(READER, boards=(Board(TAG, Pose(z=8e-3), "tag"),))
STATED = 1e-4  # of the larger L, between boards a trace width or more apart
HEIGHTS = pose_grid(z=[4e-3, 12e-3], x=[0.0, 3e-3, 6e-3])


def exact(pose, reader=READER, tag=TAG):
    return mutual_inductance(reader.conductors(), [path.posed(pose) for path in tag.conductors()])[:, 0]


def test_each_pose_has_the_mutual_inductance_of_its_coils():
    found = link(PAIR, {"tag": HEIGHTS})
    assert dict(found.sizes) == {"x": 3, "z": 2, "pair": 2}
    assert found.pair.values.tolist() == ["coil1,tag/coil1", "coil2,tag/coil1"]
    largest = np.diag(READER.inductance).max()
    for place, pose in np.ndenumerate(HEIGHTS.values):
        np.testing.assert_allclose(found.mutual_inductance.values[place], exact(pose), atol=STATED * largest, rtol=0)
    L1, L2 = READER.inductance.values[0, 0], TAG.inductance.values[0, 0]
    # no sheets: k by its definition, with the L of each board alone
    np.testing.assert_allclose(found.coupling, found.mutual_inductance / math.sqrt(L1 * L2), rtol=1e-9)
    assert found.mutual_inductance.attrs["units"] == "H"
    assert "induced_voltage" not in found


def test_each_pose_is_that_of_a_design_with_the_board_there():
    found = link(PAIR, {"tag": HEIGHTS})
    there = couple_design(moved_boards(PAIR, {"tag": HEIGHTS}, 3)).inductance.values
    # the same integral over the same paths
    np.testing.assert_allclose(found.mutual_inductance.values[1, 1], there[:2, 2], rtol=1e-9)


def test_boards_may_change_places_and_the_whole_scene_move():
    turn = Pose(1e-3, 2e-3, 7e-3, (0.3, -0.2, 0.5))
    M = link(PAIR, {"tag": [turn]}).mutual_inductance.values
    back = Pose.of(turn.rotation.T, -turn.rotation.T @ turn.shift)
    swapped = Design(TAG, boards=(Board(READER, Pose(z=9e-3), "reader"),))
    np.testing.assert_allclose(link(swapped, {"reader": [back]}).mutual_inductance.values, M, rtol=1e-4)
    scene = Pose(0.1, -0.2, 0.3, (1.0, 0.5, -2.0))
    moved = replace(PAIR, pose=scene, boards=(Board(TAG, scene.after(Pose(z=8e-3)), "tag"),))
    # the same paths elsewhere: rounding of 1e-16 of 0.4 m, over the pitch
    np.testing.assert_allclose(link(moved, {"tag": [scene.after(turn)]}).mutual_inductance.values, M, rtol=1e-6)


def test_boards_that_move_together_keep_their_coupling_with_each_other():
    lid = Board(TAG, Pose(x=4e-3, z=14e-3, turn=(0.1, 0.0, 0.0)), "lid")
    three = replace(PAIR, boards=(*PAIR.boards, lid))
    poses = together(three, ["tag", "lid"], pose_grid(z=[8e-3, 11e-3]))
    found = link(three, poses)
    between = found.mutual_inductance.sel(pair="tag/coil1,lid/coil1").values
    np.testing.assert_allclose(between, between[0], rtol=1e-6)
    one = found.mutual_inductance.sel(pair="coil1,lid/coil1").values[1]
    lifted = Pose(z=3e-3).after(lid.pose)
    assert one == pytest.approx(exact(lifted)[0], abs=STATED * READER.inductance.values[0, 0])
    assert pose_of(three, "lid") == lid.pose


@pytest.fixture(scope="module")
def resonators():
    """Two equal coils with series capacitors at 6.78 MHz."""
    coil = Spiral(4, 20e-3, 3, 0.5e-3, 0.5e-3).as_array()
    C = 1 / ((2 * np.pi * 6.78e6) ** 2 * float(coil.inductance.values[0, 0]))
    ports = (Port("coil1", 1.0, None, C), Port("other/coil1", None, 1.0, C))
    circuit = Circuit(ports=ports, link_frequency=6.78e6)
    return Design(coil, boards=(Board(coil, Pose(z=5e-3), "other"),), circuit=circuit)


def test_two_equal_resonators_split_by_their_coupling(resonators):
    found = link(resonators, {"other": pose_grid(z=[3e-3, 6e-3])})
    k = np.abs(found.coupling.values[:, 0])
    expected = 6.78e6 * (1 / np.sqrt(1 - k) - 1 / np.sqrt(1 + k))
    # the windings' own capacitance, a hundredth of C, is left out there
    np.testing.assert_allclose(found.splitting, expected, rtol=2e-2)
    assert (found.efficiency.values[:, 0, 0] <= found.best_efficiency.values[:, 0]).all()
    assert (found.available_efficiency.values <= found.efficiency.values).all()
    np.testing.assert_allclose(found.induced_voltage, 2 * np.pi * 6.78e6 * np.abs(found.mutual_inductance), rtol=1e-12)


def test_ports_that_do_not_oscillate_have_no_resonances(resonators):
    source, load = resonators.circuit.ports
    for ohm, numbers in ((60.0, [1, 2]), (1e3, [0, 0])):
        ports = replace(source, source_resistance=ohm), replace(load, load_resistance=ohm)
        design = replace(resonators, circuit=replace(resonators.circuit, ports=ports))
        found = link(design, {"other": pose_grid(z=[1e-3, 5e-3])})
        assert found.resonances.values.tolist() == numbers
        assert ("splitting" in found) == any(numbers)


def test_largest_efficiency_is_that_of_kq(resonators):
    """k²Q₁Q₂/(1 + √(1 + k²Q₁Q₂))² of two coils of equal Q."""
    from coilarray.electromagnetics.resistance import resistance_matrix

    found = link(resonators, {"other": [Pose(z=6e-3)]}, frequency=3e6)
    coil = resonators.array
    R = float(resistance_matrix(coil, [3e6]).resistance.values[0, 0, 0])
    kq = abs(float(found.coupling.values[0, 0])) * 2 * np.pi * 3e6 * float(coil.inductance.values[0, 0]) / R
    assert found.best_efficiency.values[0, 0] == pytest.approx(kq**2 / (1 + math.sqrt(1 + kq**2)) ** 2, rel=1e-6)


def test_kept_results_are_not_computed_again(tmp_path, monkeypatch):
    first = link(PAIR, {"tag": HEIGHTS}, keep=tmp_path)
    monkeypatch.setattr("coilarray.studies.link.moved_inductance", None)
    xr.testing.assert_identical(link(PAIR, {"tag": HEIGHTS}, keep=tmp_path), first)


def test_columns_are_in_mm_and_degrees():
    swing = [Pose(z=20e-3, turn=(0.0, angle, 0.0)) for angle in (0.0, 0.2)]
    assert columns(link(PAIR, {"tag": swing})).pose.values.tolist() == [1, 2]
    flat = columns(link(PAIR, {"tag": pose_grid(z=20e-3, turn_y=[0.0, math.pi / 6])}))
    assert flat.turn_y_deg.values.tolist() == [0.0, 30.0]
    assert "k[coil1,tag/coil1]" in flat


def test_poses_are_counted_as_they_are_done():
    seen = []
    link(PAIR, {"tag": HEIGHTS}, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(6, 6)]


TWO = replace(PAIR, boards=(*PAIR.boards, Board(TAG, Pose(z=20e-3))))
PLATE = FinitePlate("shield", Rectangle(20e-3, 20e-3), (0.0, 0.0, -10e-3), 1e-3, MATERIALS["aluminium"])
BAD = {
    "unknown board": (PAIR, {"antenna": HEIGHTS}, "antenna.*tag"),
    "no board moves": (PAIR, {}, "at least one board"),
    "no boards at all": (Design(READER), {"tag": HEIGHTS}, "places no boards"),
    "no poses": (PAIR, {"tag": []}, "poses of tag.*none"),
    "no pose": (PAIR, {"tag": [None]}, "poses of tag.*None"),
    "other numbers of poses": (TWO, {"tag": HEIGHTS, "board3": [Pose(z=20e-3)]}, "board3"),
    "cut through": (
        PAIR, {"tag": [Pose(z=8e-3), Pose(z=0.2e-3)]}, r"tag cut through each other at pose 2, tag at \(0, 0, 0.2\) mm",
    ),
    "moved boards that cut through": (
        TWO, {"tag": [Pose(z=8e-3)], "board3": [Pose(z=8e-3)]}, "tag and board3 cut through",
    ),
    "metal": (replace(PAIR, plates=(PLATE,)), {"tag": HEIGHTS}, "shield"),
}  # fmt: skip


@pytest.mark.parametrize(("design", "poses", "message"), BAD.values(), ids=BAD)
def test_what_cannot_be_is_named(design, poses, message):
    with pytest.raises(DesignError, match=message):
        link(design, poses)


@pytest.mark.parametrize("frequency", [0.0, -1e6, math.nan, math.inf])
def test_frequencies_that_are_none_are_refused(frequency):
    with pytest.raises(DesignError, match="frequency"):
        link(PAIR, {"tag": HEIGHTS}, frequency=frequency)


@pytest.mark.parametrize("axes", [{"z": []}, {"z": [1e-3, math.nan]}, {"x": [1e-3, 1e-3]}, {"x": np.zeros((2, 2))},
                                  {"x": np.arange(400), "y": np.arange(400)}])  # fmt: skip
def test_grids_that_are_none_are_refused(axes):
    with pytest.raises(DesignError, match="poses"):
        pose_grid(**axes)
