"""Copper outlines: area against length × width, pads on the right layers, unions, the edge of the board.

Who checks whom: `trace_outline` against the closed formula and against the general buffer of GEOS.
"""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from support.boards import (
    FOUR_LAYERS,
    LEADS,
    SHEETS,
    VIA,
    WOUND,
    length,
    many_layers,
    one_coil,
    reference_board,
    round_spiral,
    small_board,
    wound_board,
)
from support.refusals import refused

from coilarray.errors import GeometryError, OutputError
from coilarray.fabrication.solid_files import write_solids
from coilarray.geometry import Array, Placement, Sheet, Spiral, path_coil, solids
from coilarray.geometry.coil import Coil
from coilarray.geometry.copper import board_outline, copper_by_layer, copper_features, disc, drills, trace_outline


@pytest.mark.parametrize("sides", [3, 4, 6, None])
@pytest.mark.parametrize("winding", ["ccw", "cw"])
def test_area_of_a_mitred_trace_is_length_times_width(sides, winding):
    turns = (15, 0.1e-3, 0.12e-3)
    spiral = (
        round_spiral(8e-3, *turns, winding=winding)
        if sides is None
        else Spiral(sides, 16e-3, *turns, 0.3, winding=winding)
    )
    line = spiral.centre_line()
    outline = trace_outline(line, 0.1e-3)
    assert outline.is_valid
    assert not outline.interiors
    # what a mitre adds outside it takes inside; rounding of coordinates 80 times the width over up to 1440 corners
    assert outline.area == pytest.approx(length(line) * 0.1e-3, rel=1e-11)


@given(sides=st.sampled_from([3, 4, 5, 6, 8]), corner=st.floats(-7, 7), turns=st.integers(1, 12))
@settings(max_examples=30)
def test_outline_is_the_buffer_of_the_line(sides, corner, turns):
    line = Spiral(sides, 16e-3, turns, 0.15e-3, 0.15e-3, corner).centre_line()
    outline = trace_outline(line, 0.15e-3)
    buffer = shapely.LineString(line).buffer(0.075e-3, cap_style="flat", join_style="mitre", mitre_limit=4)
    # corners of up to 60° are not simplified by the buffer: rounding only
    assert shapely.symmetric_difference(outline, buffer).area < 1e-9 * outline.area


def test_traces_that_cross_end_short_or_turn_back():
    w = 0.2e-3
    line = np.array([(0, 0), (4e-3, 0), (4e-3, 2e-3), (2e-3, 2e-3), (2e-3, -2e-3)])
    outline = trace_outline(line, w)
    assert outline.is_valid
    assert len(outline.interiors) == 1
    assert outline.area == pytest.approx(length(line) * w - w * w, rel=1e-9)  # wedges reach 0.1 % of w inside
    # a stub shorter than the width keeps all its copper
    stub = 0.05e-3
    outline = trace_outline(np.array([(0, 0), (1e-3, 0), (1e-3, stub)]), w)
    # the first segment, the square that the mitre adds, and the half of the stub that lies beyond the first segment
    assert outline.area == pytest.approx(1e-3 * w + w * w / 4 + stub * w / 2, rel=1e-6)  # wedges as above
    # a reversal is cut off flat
    sharp = math.radians(5)
    tip = np.array([(0, 0), (5e-3, 0), (5e-3 * (1 - math.cos(sharp)), 5e-3 * math.sin(sharp))])
    assert trace_outline(tip, w).bounds[2] < 5e-3 + w


def test_each_coil_has_one_trace_a_layer_and_pads_where_its_holes_are():
    array = reference_board()
    features = copper_features(array)
    traces = [(feature.net, feature.layer) for feature in features if feature.kind == "trace"]
    assert traces == [(p.name, layer) for p in array.placements for layer in p.layers]
    for kind, holes_a_coil, diameter in (("via", 1, VIA.pad), ("terminal", 2, LEADS.terminal.pad)):
        pads = [feature for feature in features if feature.kind == kind]
        assert len(pads) == 6 * holes_a_coil * 4
        # a polygon of 128 corners lacks (2π/128)²/6 = 4e-4 of the circle
        assert pads[0].shape.area == pytest.approx(math.pi / 4 * diameter**2, rel=5e-4)


def test_holes_end_where_they_are_needed_when_they_are_not_drilled_through():
    lines = [[(k * 1e-3, 0), ((k + 1) * 1e-3, 0)] for k in range(3)]
    coil = path_coil(lines, 1e-4, 1e-4, VIA, LEADS.terminal)
    placement = Placement("A", coil, ("L3", "L1", "L2"), 0, 0)
    blind = drills(Array(FOUR_LAYERS, (placement,), through_holes=False))
    assert [(hole.kind, hole.layers, hole.drilled) for hole in blind] == [
        ("via", ("L1", "L2", "L3"), True), ("via", ("L1", "L2"), True), ("terminal", ("L3",), False),
        ("terminal", ("L2",), False),
    ]  # fmt: skip
    through = drills(Array(FOUR_LAYERS, (placement,)))
    assert {(hole.layers, hole.drilled) for hole in through} == {(FOUR_LAYERS.names, True)}
    assert [hole.x for hole in through] == pytest.approx([1e-3, 2e-3, 0, 3e-3])
    # a board of one layer is drilled
    coil = path_coil([[(0, 0), (1e-2, 0)]], 1e-4, 1e-4, VIA, LEADS.terminal)
    for through in (True, False):
        assert [hole.drilled for hole in drills(one_coil(coil, through_holes=through))] == [True, True]


@pytest.mark.parametrize("through_holes", [True, False])
def test_the_copper_of_a_layer_is_its_features(through_holes):
    array = reference_board(count=2, turns=10, through_holes=through_holes)
    assert list(copper_by_layer(array)) == list(array.stackup.names)
    for layer, nets in copper_by_layer(array).items():
        for net, copper in nets.items():
            own = [piece.shape for piece in copper_features(array) if (piece.layer, piece.net) == (layer, net)]
            apart = shapely.symmetric_difference(copper, shapely.union_all(own)).area
            assert apart < 1e-12 * copper.area  # moved after they are united: the rounding of coordinates


def test_the_outline_holds_all_copper_and_circles_are_fine_enough():
    array = reference_board()
    outline = board_outline(array)
    assert outline.bounds == array.bounds
    assert all(outline.contains(feature.shape) for feature in copper_features(array))
    circle = disc(1e-3, 2e-3, 1e-3)
    corners = shapely.get_coordinates(circle) - (1e-3, 2e-3)
    np.testing.assert_allclose(np.hypot(*corners.T), 0.5e-3, rtol=1e-12)
    sagitta = 0.5e-3 - min(np.hypot(*(a + b)) / 2 for a, b in pairwise(corners))
    assert sagitta < 0.2e-6


VOLUME = 1e-9  # relative: triangulated prisms of coordinates up to 1000 times their height, in float64


def holes_of(array, layer):
    holes = [hole for hole in drills(array) if hole.drilled and layer in hole.layers]
    return shapely.union_all([disc(hole.x, hole.y, hole.diameter) for hole in holes])


BOARDS = {
    "reference": reference_board(count=2),
    **WOUND,
    "reference, blind holes": reference_board(count=2, turns=10, through_holes=False),
    "inner terminal": wound_board(6, 1),
    "holes through another coil": small_board(
        placements=tuple(replace(one, x=one.x / 5) for one in small_board().placements)
    ),
}


@pytest.fixture(params=BOARDS.values(), ids=BOARDS.keys(), scope="module")
def built(request):
    return request.param, solids(request.param, SHEETS)


def test_every_solid_is_closed_and_copper_has_its_volume(built):
    array, parts = built
    for name, solid in parts.items():
        assert solid.is_watertight, name
        assert solid.is_winding_consistent, name
        assert solid.volume > 0, name
    # the volume of copper is its area times its thickness
    seen = set()
    for layer in array.stackup.names:
        bottom, top = array.stackup.span(layer)
        for net, copper in copper_by_layer(array)[layer].items():
            solid = parts[f"copper/{layer}/{net}"]
            area = shapely.difference(copper, holes_of(array, layer)).area
            assert solid.volume == pytest.approx(area * (top - bottom), rel=VOLUME)
            assert solid.bounds[:, 2] == pytest.approx([bottom, top], abs=1e-15)
            seen.add(f"copper/{layer}/{net}")
    assert seen == {name for name in parts if name.startswith("copper/")}


def test_barrels_are_hollow_and_span_their_layers(built):
    array, parts = built
    for net in array.names:
        own = [hole for hole in drills(array) if hole.net == net and hole.drilled]
        assert sum(name.startswith(f"barrel/{net}/") for name in parts) == len(own)
        for n, hole in enumerate(own):
            solid = parts[f"barrel/{net}/{n}"]
            bottom, top = array.stackup.span(hole.layers[-1])[0], array.stackup.span(hole.layers[0])[1]
            outer, inner = hole.diameter / 2, hole.diameter / 2 - hole.plating
            polygon = 64 * math.sin(2 * math.pi / 128) * (outer**2 - inner**2)  # regular, 128 corners
            assert solid.volume == pytest.approx(polygon * (top - bottom), rel=VOLUME)
            assert solid.bounds[:, 2] == pytest.approx([bottom, top], abs=1e-15)


def test_laminate_fills_the_board_and_sheets_are_stacked_on_it(built):
    array, parts = built
    area = board_outline(array).area
    assert parts["sheet/base"].bounds[:, 2] == pytest.approx([0, 6e-3], abs=1e-15)
    assert parts["sheet/magnetic"].bounds[:, 2] == pytest.approx([6e-3, 8e-3], abs=1e-15)
    assert parts["sheet/magnetic"].volume == pytest.approx(area * 2e-3, rel=VOLUME)
    stackup = array.stackup
    if len(stackup.names) == 1:
        assert "board" not in parts
        return
    through = [disc(hole.x, hole.y, hole.diameter) for hole in drills(array) if hole.layers == stackup.names]
    area = shapely.difference(board_outline(array), shapely.union_all(through)).area
    height = stackup.thickness - stackup.copper_thickness[0] - stackup.copper_thickness[-1]
    assert parts["board"].volume == pytest.approx(area * height, rel=VOLUME)
    assert parts["board"].bounds[1, 2] == pytest.approx(-stackup.copper_thickness[0], abs=1e-15)


@pytest.mark.lowest
def test_solids_that_touch_are_closed_and_sheets_differ_in_name():
    line = np.array([(0, 0), (4e-3, 0), (4e-3, 4e-3), (2e-3, 4e-3), (2e-3, -2e-3)])
    array = one_coil(Coil((line,), (np.full(4, 2e-4),), 2e-4, VIA, None, np.zeros((0, 2))))
    solid = solids(array)["copper/L1/A"]
    assert solid.is_watertight
    assert solid.volume == pytest.approx(copper_by_layer(array)["L1"]["A"].area * 35e-6, rel=VOLUME)
    twice = (Sheet("base", 1e-3), Sheet("base", 2e-3))
    refused(GeometryError, "sheet names must differ; got base, base", solids, BOARDS["triangle"], twice)


@pytest.fixture(scope="module")
def parts():
    return solids(BOARDS["triangle"], SHEETS)


def test_mesh_files_are_in_millimetres(parts, tmp_path):
    path = tmp_path / "coil.STL"
    write_solids(parts, path)
    mesh = trimesh.load_mesh(path)
    expected = sum(solid.volume for solid in parts.values())
    assert mesh.volume == pytest.approx(expected * 1e9, rel=1e-4)  # single precision in the file
    assert mesh.extents[2] == pytest.approx((8e-3 + many_layers(2).thickness) * 1e3, rel=1e-6)
    assert list(tmp_path.iterdir()) == [path]  # no temporary is left


def test_scene_file_keeps_names_and_is_in_metres_with_y_up(parts, tmp_path):
    path = tmp_path / "coil.glb"
    write_solids(parts, path)
    scene = trimesh.load_scene(path)
    assert set(scene.geometry) == set(parts)
    assert set(scene.graph.nodes_geometry) == set(parts)
    x, height, depth = scene.extents
    outline = np.diff(np.reshape(board_outline(BOARDS["triangle"]).bounds, (2, 2)), axis=0)[0]
    # single precision in the file
    assert (x, depth, height) == pytest.approx((*outline, 8e-3 + many_layers(2).thickness), rel=1e-6)
    colours = {name: tuple(scene.geometry[name].visual.vertex_colors[0]) for name in parts}
    assert colours["copper/L1/A"] != colours["board"] != colours["sheet/base"]


def test_files_that_cannot_be_leave_nothing_and_writing_leaves_the_solids_alone(parts, tmp_path):
    message = r"the suffix must be \.stl or \.glb; got '\.obj'"
    refused(OutputError, message, write_solids, parts, tmp_path / "coil.obj")
    refused(OutputError, "there are no solids", write_solids, {}, tmp_path / "coil.stl")
    message = r"cannot write .*coil\.stl: No such file or directory"
    refused(OutputError, message, write_solids, parts, tmp_path / "missing" / "coil.stl")
    assert list(tmp_path.iterdir()) == []
    before = {name: solid.vertices.copy() for name, solid in parts.items()}
    write_solids(parts, tmp_path / "coil.stl")
    write_solids(parts, tmp_path / "coil.glb")
    for name, solid in parts.items():
        np.testing.assert_array_equal(solid.vertices, before[name])
