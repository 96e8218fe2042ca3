"""Metal in scenes: bodies where they lie, currents as they flow, and a slider that says what the library computes."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from coilarray import load_design
from coilarray.design.vary import vary
from coilarray.errors import MetalError
from coilarray.geometry import MATERIALS, Ball, Disc, FinitePlate, Plate, Ring, Target
from coilarray.geometry.copper import plate_solid
from coilarray.response.target import target_map
from coilarray.viz.datasets.results import EDDY, EDDY_AMOUNT, field_lines
from coilarray.viz.scenes import metal
from coilarray.viz.scenes import results as fields
from coilarray.viz.scenes.design import View, board_and_metal, scene_of_design
from coilarray.viz.scenes.metal import WorkingPoint, around_board, eddies_of_plates

ALUMINIUM = MATERIALS["aluminium"]


BACKPLANE = Plate("backplane", -6e-3, 1e-3, ALUMINIUM)


@pytest.fixture(scope="module")
def design():
    """The starter board, with a steel ball that is moved over it."""
    ball = Target(Ball(4e-3, MATERIALS["steel"]), (1e-3, 4e-3), (0.0, 8e-3), (0.0, 3e-3))
    return replace(load_design("starter"), target=ball)


@pytest.fixture(scope="module")
def few_turns():
    """One coil of a few turns in air."""
    one = vary(load_design("starter"), {"array.columns": 1, "coils.hexagon.turns_per_layer": 4})
    return replace(one, sheets=(), indentation=None)


@pytest.fixture(scope="module")
def shown(design):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(metal, "_STEPS", 0)  # no positions between those of the design
        return scene_of_design(design, View(show=board_and_metal(design), coil="coil2"))


def test_the_solid_of_a_plate_is_its_outline_times_its_thickness_where_it_lies():
    outline = Ring(6e-3, 2e-3)
    plate = FinitePlate("ring", outline, (1e-3, 2e-3, 9e-3), 1.5e-3, ALUMINIUM, tilt=0.2, tilt_direction=1.0)
    solid = plate_solid(plate, (0.0, 0.0, 1.0, 1.0))
    assert solid.is_watertight
    assert solid.volume == pytest.approx(math.pi * (36 - 4) * 1e-6 * 1.5e-3, rel=1e-9)  # polygons of the same area
    np.testing.assert_allclose(solid.bounds[:, 2], plate.heights, rtol=1e-9)
    np.testing.assert_allclose(solid.center_mass, plate.centre, rtol=1e-9)


@pytest.mark.slow
def test_plates_and_target_lie_where_the_design_says(design, shown):
    parts = {part.name: part for part in shown.parts}
    plated = scene_of_design(replace(design, plates=(BACKPLANE,), target=None), View(show=("board", "plates")))
    parts |= {part.name: part for part in plated.parts}
    low_x, low_y, high_x, high_y = around_board(design.array)
    bounds = np.array([low_x, high_x, low_y, high_y, *BACKPLANE.heights]) * 1e3
    np.testing.assert_allclose(parts["plate backplane"].mesh.bounds, bounds, rtol=1e-6)  # single precision
    assert parts["plate backplane"].group == "backplane: infinite plate of aluminium, 1 mm"
    assert "Infinite plates, drawn as far as the board: backplane." in plated.notes
    centre = design.array.centres[design.array.names.index("coil2")]
    nearest = [min(values, key=lambda value, c=c: abs(value - c)) for values, c in zip(
        (design.target.x, design.target.y), centre, strict=True)]  # fmt: skip
    labels = shown.slider.labels
    assert (labels[0], labels[-1]) == ("1 mm", "4 mm")
    for step, label in enumerate(labels):
        body = parts[f"target {step}"]
        assert body.step == step
        x_min, x_max, y_min, y_max, z_min, z_max = body.mesh.bounds
        assert z_min == pytest.approx(design.top * 1e3 + float(label.split()[0]), abs=2e-3)  # three digits
        # a ball of 48 meridians
        assert ((x_min + x_max) / 2, (y_min + y_max) / 2) == pytest.approx(np.multiply(1e3, nearest), abs=1e-3)
        assert z_max - z_min == pytest.approx(8.0, abs=1e-3)


@pytest.mark.slow
def test_every_position_says_what_the_library_computes(design, shown):
    x, y = (min(values, key=abs) for values in (design.target.x, design.target.y))
    found = target_map(design, distances=[4e-3], x=[x], y=[y]).isel(distance=0, x=0, y=0).sel(state="coil2")
    first, others = shown.slider.notes[-1]
    assert first.startswith("target at 4 mm, coil2: δ = ")
    assert f"δ = {float(found.delta) * 100:+.3g} %".replace("-", "−") in first
    assert f"f = {float(found.frequency) * 1e-6:.4f} MHz" in first
    assert others.startswith("δ of the others: coil1 ")
    # a picture shows the first position alone
    still = shown.still()
    assert [part.name for part in still.parts if part.name.startswith("target")] == ["target 0"]
    assert shown.slider.notes[0][0] in still.notes
    assert still.slider is None


@pytest.mark.slow
def test_eddy_currents_run_against_the_coil_on_the_upper_face(few_turns):
    (middle,) = few_turns.array.centres
    shield = Plate("shield", 5e-3, 2e-3, ALUMINIUM)
    scene = scene_of_design(replace(few_turns, plates=(shield,)), View(show=("plates", "eddies"), others_open=True))
    (arrows,) = (part.mesh for part in scene.parts if part.name == "eddies of plate 0")
    path = few_turns.array.conductors()[0].vertices
    turning = np.cross(path[:-1], path[1:])[:, 2].sum()
    points, K = np.asarray(arrows.points, dtype=float), np.asarray(arrows.point_data[EDDY])
    away = points - [*(middle * 1e3), 7.0]
    assert np.sign(np.cross(away, K)[:, 2].sum()) == -np.sign(turning)
    np.testing.assert_allclose(np.linalg.norm(K, axis=1), arrows.point_data[EDDY_AMOUNT], rtol=1e-6)
    # on the upper face, but for the arrows' own thickness
    assert np.abs(points[:, 2] - 7.0).max() < 1.5
    assert any("while the coil's current is largest" in note for note in scene.notes)  # many skin depths


def test_eddy_currents_of_a_plate_with_an_outline_are_those_through_its_thickness(few_turns, monkeypatch):
    """The solver gives the upper half and its mirror image; tests/metal holds its numbers."""
    upper = np.array([[[0.0, 0, 7], [3, 0, 7], [0, 3, 7]]]) * 1e-3
    solved = SimpleNamespace(
        corners=np.concatenate((upper, upper * [1, 1, 5 / 7])),
        density=np.array([[[1, 2, 0], [3, 4j, 0]]], dtype=complex),
    )
    monkeypatch.setattr(metal, "eddy_currents", lambda *_: [[solved]])
    coin = FinitePlate("coin", Disc(4e-3), (0.0, 0.0, 6e-3), 2e-3, ALUMINIUM)
    operation = WorkingPoint(np.array([2.0 + 0j]), 2e6)
    ((points, normals, K),) = eddies_of_plates(few_turns, [coin], operation, around_board(few_turns.array))
    np.testing.assert_allclose(points, [[1e-3, 1e-3, 7e-3]])
    np.testing.assert_allclose(normals, [[0, 0, 1]])
    np.testing.assert_allclose(K, [[8, 4 + 8j, 0]])


@pytest.mark.slow
def test_eddy_currents_at_all_distances_have_one_scale(few_turns, monkeypatch):
    monkeypatch.setattr("coilarray.viz.scenes.metal._STEPS", 0)  # no positions between those of the design
    body = Plate("target", 0.0, 1e-3, ALUMINIUM)
    moving = replace(few_turns, target=Target(body, (2e-3, 6e-3), (0.0,), (0.0,)))
    scene = scene_of_design(moving, View(show=("target", "eddies"), distance=6e-3))
    assert scene.slider.labels[scene.slider.first] == "6 mm"
    strongest = [
        float(part.mesh.point_data[EDDY_AMOUNT].max()) for part in scene.parts if part.name.startswith("eddies")
    ]
    assert strongest[0] > 1.1 * strongest[1]  # the nearer, the stronger
    (scale,) = scene.scales
    assert 0.5 < scale.high / strongest[0] < 2.5  # but for 2 % of the places, and to a round number


def test_what_is_not_there_is_refused(design):
    bare = replace(design, plates=(), target=None)
    assert board_and_metal(bare) == ("board",)
    with pytest.raises(MetalError, match=r"has no \[target\]"):
        scene_of_design(bare, View(show=("target",)))
    with pytest.raises(MetalError, match="eddy currents need plates or a target"):
        scene_of_design(bare, View(show=("eddies",)))
    disc = FinitePlate("coin", Disc(5e-3), (0.0, 0.0, -9e-3), 1e-3, ALUMINIUM)
    with pytest.raises(MetalError, match="B beside a plate with an outline is not computed; starter has 'coin'"):
        scene_of_design(replace(bare, plates=(disc,)), View(show=("field",)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["plate above", "plate below", "target"])
def test_lines_of_b_go_along_metal_and_end_only_at_the_box(few_turns, kind, monkeypatch):
    plate = Plate("shield", -6e-3 if kind == "plate below" else 2.5e-3, 2e-3, ALUMINIUM)
    target = Target(replace(plate, name="target"), (2.5e-3, 5e-3), (0.0,), (0.0,))
    design = replace(few_turns, **({"target": target} if kind == "target" else {"plates": (plate,)}))
    followed = []

    def watched(grid, seeds):
        followed.append((grid, field_lines(grid, seeds)))
        return followed[0][1]

    monkeypatch.setattr(fields, "field_lines", watched)
    shown = View(show=("target" if kind == "target" else "plates", "lines"), others_open=True)
    scene = scene_of_design(design, shown)
    (grid, lines) = followed[0]
    words = "the target at 2.5 mm" if kind == "target" else "the plates"
    assert any(f"beside {words}" in note for note in scene.notes)
    assert scene.slider is None or len(scene.slider.labels) == 1  # what is shown is for this distance
    low, high = np.reshape(grid.bounds, (3, 2)).T
    inside = np.array(plate.heights) * 1e3
    skin = ALUMINIUM.skin_depth(2e6) * 1e3  # mm; the coil oscillates at more
    half = np.array([np.diff(axis)[-1] / 2 for axis in (grid.x, grid.y, grid.z)])  # of a cell at the rim of the box
    assert lines.n_cells == 31
    for k in range(lines.n_cells):
        points = np.asarray(lines.get_cell(k).points)
        depth = points[:, 2] - inside[0] if kind != "plate below" else inside[1] - points[:, 2]
        assert (
            depth.max() < 5 * skin
        )  # a hundredth of a hundredth of its flux goes deeper: B_z there over that at the coil
        ends = points[[0, -1]]
        at_box = (np.minimum(ends - low, high - ends) < half).any(axis=1)
        length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        back = np.linalg.norm(ends[1] - ends[0]) < 0.2 * length
        assert back or at_box.all()


def test_b_beside_metal_that_is_not_computed_is_refused_by_name(design):
    linear = load_design("linear_position")
    with pytest.raises(
        MetalError, match="B beside a plate with an outline is not computed; linear_position has 'target'"
    ):
        scene_of_design(linear, View(show=("board", "target", "lines")))
    with pytest.raises(MetalError, match="B beside a sphere is not computed; the target of starter is one"):
        scene_of_design(design, View(show=("target", "field")))
    pressed = replace(design.indentation, material=ALUMINIUM)
    with pytest.raises(MetalError, match="B beside an indenter of metal or ferrite is not computed"):
        scene_of_design(replace(design, target=None, indentation=pressed), View(show=("dent", "map")))
