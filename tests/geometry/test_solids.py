"""Solids: watertight, volume = area × thickness, at the right height; and the files they are written to."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
import trimesh
from support.boards import SHEETS, VIA, WOUND, many_layers, one_coil, reference_board, small_board, wound_board
from support.refusals import refused

from coilarray.errors import GeometryError, OutputError
from coilarray.fabrication.solid_files import write_solids
from coilarray.geometry import Sheet, solids
from coilarray.geometry.coil import Coil
from coilarray.geometry.copper import board_outline, copper_by_layer, disc, drills

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
