"""Scenes of several boards: every board is drawn where it is, and every coil has its name and value there."""

import math
from dataclasses import replace

import numpy as np
import pytest

from coilarray.circuit.coupling import couple_design, operating_currents
from coilarray.design.model import Board, Design
from coilarray.errors import GeometryError
from coilarray.geometry import Bend, Pose, Sheet, Spiral, Zone, solids
from coilarray.geometry.array import Array
from coilarray.viz.datasets.results import field_grid
from coilarray.viz.scenes.board import scene_of_currents
from coilarray.viz.scenes.design import View, scene_of_design
from coilarray.viz.scenes.results import CURRENT, field_box, field_planes, line_seeds

ROW = Array.row(Spiral(4, 8e-3, 3, 0.2e-3, 0.2e-3), 2, pitch=12e-3)
ONE = Array.row(Spiral(6, 10e-3, 4, 0.2e-3, 0.2e-3), 1)
TILTED = Pose(x=4e-3, y=-1e-3, z=12e-3, turn=(math.pi, 0.4, 0.2))
PAIR = Design(ROW, boards=(Board(ONE, TILTED, "lid"),))


def parts_of(scene):
    return {part.name: part for part in scene.parts}


def in_mm(solid, pose):
    return 1e3 * pose.apply(np.asarray(solid.vertices))


def test_each_board_is_drawn_at_its_pose():
    parts = parts_of(scene_of_design(PAIR))
    for pose, array, start in ((Pose(), ROW, ""), (TILTED, ONE, "lid: ")):
        for name, solid in solids(array).items():
            if name == "board":  # the drawn corners are the laminate's, in double precision
                np.testing.assert_allclose(parts[f"{start}board"].mesh.points, in_mm(solid, pose), atol=1e-9)
        copper = np.vstack([in_mm(one, pose) for key, one in solids(array).items() if key.startswith("copper/L1/")])
        drawn = np.reshape(parts[f"{start}copper L1"].mesh.bounds, (3, 2)).T
        np.testing.assert_allclose(drawn, [copper.min(axis=0), copper.max(axis=0)], atol=1e-9)
    numbers = set(parts["lid: copper L1"].mesh.cell_data["coil"].tolist())
    assert numbers == {2}  # of all coils of the design


def test_a_board_in_space_has_the_colour_of_its_sign():
    scene = scene_of_design(PAIR)
    copper = {part.colour for part in scene.parts if part.name.startswith("lid: copper")}
    assert scene.groups["lid"] == tuple(copper)
    assert scene.groups["copper L1"][0] not in copper


def test_names_stand_at_the_coils_in_space():
    places = {text.text: text.position for text in scene_of_design(PAIR).texts}
    np.testing.assert_allclose([places[name] for name in PAIR.coil_names], 1e3 * PAIR.centres, atol=1e-9)


def test_a_bent_board_is_bent_and_then_placed():
    bent = ONE.bent(Bend((Zone(10e-3),)))
    parts = parts_of(scene_of_design(Design(ROW, boards=(Board(bent, TILTED, "lid"),))))
    np.testing.assert_allclose(parts["lid: board"].mesh.points, in_mm(solids(bent)["board"], TILTED), atol=1e-9)


def test_loops_of_a_surface_are_drawn_together_without_a_laminate():
    around = [Pose(turn=(0.0, angle, 0.0)).after(Pose(z=20e-3)) for angle in (0.0, 2.0, 4.0)]
    loops = [replace(ONE, placements=(replace(ONE.placements[0], name=f"coil{k}"),)) for k in (1, 2, 3)]
    others = tuple(Board(loop, pose, "") for loop, pose in zip(loops[1:], around[1:], strict=True))
    parts = parts_of(scene_of_design(Design(loops[0], pose=around[0], boards=others)))
    assert {part.group for part in parts.values()} == {"copper L1", "copper L2", "barrels", ""}  # "" is the rulers
    copper = solids(ONE)["copper/L1/coil1"]
    drawn = parts["copper L1"].mesh
    np.testing.assert_allclose(drawn.points, np.vstack([in_mm(copper, pose) for pose in around]), atol=1e-9)
    np.testing.assert_array_equal(drawn.cell_data["coil"], np.repeat([0, 1, 2], len(copper.faces)))


def test_sheets_of_every_board_lie_on_it():
    sheet = Sheet("cover", 0.5e-3)
    design = Design(ROW, boards=(Board(Design(ONE, sheets=(sheet,)), TILTED, "lid"),))
    parts = parts_of(scene_of_design(design, View(show=("board", "elastomer"))))
    expected = in_mm(solids(ONE, (sheet,))["sheet/cover"], TILTED)
    np.testing.assert_allclose(parts["lid: sheet cover"].mesh.points, expected, atol=1e-9)


def test_arrows_run_along_the_turns_as_the_currents_flow():
    scene = scene_of_currents(PAIR.placed, [1.0, -0.25, 0.001], 0)  # of which the last is too weak for arrows
    parts = parts_of(scene)
    assert set(parts) == {"arrows of currents, measured", "arrows of currents, others"}
    longest = {}
    for name, coil, current in (("measured", 0, 1.0), ("others", 1, -0.25)):
        mesh = parts[f"arrows of currents, {name}"].mesh
        arrows = np.asarray(mesh.points).reshape(8, -1, 3)
        flows = np.asarray(mesh.point_data["I (A)"]).reshape(8, -1, 3)[:, 0]
        np.testing.assert_allclose(np.linalg.norm(flows, axis=1), abs(current))
        away = arrows.mean(axis=1) - [*ROW.centres[coil] * 1e3, 0.0]
        sense = np.sign(ROW.conductors()[coil].area[2])
        assert (np.sign(np.cross(away, flows)[:, 2]) == sense * np.sign(current)).all()
        np.testing.assert_allclose(np.abs(away[:, :2]).max(axis=1), 3.5, atol=0.01)  # the middle one of three turns
        longest[name] = max(np.linalg.norm(np.ptp(one, axis=0)) for one in arrows)
    assert longest["others"] == pytest.approx(longest["measured"] / 2, rel=0.05)  # the root of a quarter
    (lid,) = scene_of_currents(PAIR.placed, [0.0, 0.0, 1.0], 2).parts
    assert lid.group == "lid"
    assert np.linalg.norm(np.asarray(lid.mesh.points).mean(axis=0) - PAIR.centres[2] * 1e3) < 1.0


def test_the_current_of_a_grounded_neighbour_flows_against_the_sign_of_k():
    for pitch, overlap in ((12e-3, -1), (4e-3, 1)):
        design = Design(Array.row(Spiral(4, 8e-3, 3, 0.2e-3, 0.2e-3), 2, pitch=pitch))
        coupling = couple_design(design)
        assert np.sign(float(coupling.coupling[0, 1])) == overlap
        currents = operating_currents(design, coupling, "coil1").real
        parts = parts_of(scene_of_currents(design.placed, currents, 0))
        turns = []
        for k, name in enumerate(("measured", "others")):
            mesh = parts[f"arrows of currents, {name}"].mesh
            away = np.asarray(mesh.points) - [*design.array.centres[k] * 1e3, 0.0]
            turns.append(np.sign(np.cross(away, mesh.point_data["I (A)"])[:, 2].mean()))
        assert turns[0] * turns[1] == -overlap


@pytest.mark.slow
def test_copper_of_all_boards_has_the_colours_of_the_currents():
    parts = parts_of(scene_of_design(PAIR, View(show=("currents",), coil="lid/coil1")))
    currents = operating_currents(PAIR, couple_design(PAIR), "lid/coil1").real
    values = parts["copper L1"].mesh.cell_data
    np.testing.assert_allclose(values[CURRENT], currents[values["coil"]])
    assert np.isnan(parts["lid: copper L1"].mesh.cell_data[CURRENT]).all()  # the measured coil
    with pytest.raises(GeometryError, match="lid/coil1"):
        scene_of_design(PAIR, View(show=("currents",), coil="lid/coil2"))


def test_the_field_is_shown_around_the_coil_of_any_board():
    box = field_box(PAIR, "lid/coil1", 1e-3)
    middle = [(span.low + span.high) / 2 for span in box]
    # the box reaches down by the thickness of a board more than up
    np.testing.assert_allclose(middle, PAIR.centres[2] - [0, 0, ROW.stackup.thickness / 2], atol=1e-12)
    normal = PAIR.placed[-1].in_space([0.0, 0.0, 1.0]) - PAIR.placed[-1].in_space([0.0, 0.0, 0.0])
    x, y, z = (span.points for span in box)
    grid = field_grid(x, y, z, np.broadcast_to(1e-6 * normal, (len(x), len(y), len(z), 3)))
    seeds = TILTED.undo(line_seeds(PAIR, "lid/coil1", grid))
    np.testing.assert_allclose(seeds[:, 2], PAIR.field_height, atol=1e-12)
    level, upright = field_planes(PAIR, "coil1", 1e-3)
    corners = np.concatenate([board.pieces.reshape(-1, 3) for board in PAIR.placed])
    assert level[0].low == pytest.approx(corners[:, 0].min())
    assert upright[2].high > corners[:, 2].max()


@pytest.mark.parametrize(("height", "shown"), [(8e-3, 8e-3), (20e-3, 10e-3), (20.4e-3, 10e-3), (22e-3, 22e-3)])
def test_a_level_plane_cuts_no_copper_of_another_board(height, shown):
    above = Board(ONE, Pose(z=20e-3 - ONE.stackup.centre(ONE.placements[0].layers[0])), "lid")
    (_, _, z), _ = field_planes(Design(ROW, boards=(above,), field_height=height), "coil1", 1e-3)
    assert z.low == pytest.approx(shown, abs=0.2e-3)
    assert z.low == z.high
