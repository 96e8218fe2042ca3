"""DXF drawings, read back by ezdxf: units, layers, areas, paths, holes; and everything that cannot be written."""

from dataclasses import replace

import ezdxf
import numpy as np
import pytest
import shapely
from support.boards import VIA, WOUND, many_layers, reference_board
from support.refusals import refused

from coilarray.errors import OutputError
from coilarray.fabrication.drawings import write_dxf
from coilarray.geometry import Array, Placement, PlatedHole, path_coil
from coilarray.geometry.copper import board_outline, copper_by_layer, drills

ROUNDING = 1e-9  # mm: coordinates are written with nine digits after the point


def two_widths():
    line = np.array([(0, 0), (8e-3, 0), (8e-3, 5e-3), (1e-3, 5e-3)])
    back = np.array([(1e-3, 5e-3), (-2e-3, 5e-3)])
    coil = path_coil([line, back], [[0.2e-3, 0.5e-3, 0.3e-3], [0.4e-3]], 0.2e-3, VIA, PlatedHole(0.5e-3, 1e-3))
    return Array(many_layers(2), (Placement("A", coil, ("L1", "L2"), 1e-3, -2e-3, 0.3),))


BOARDS = {"reference": reference_board(count=2), **WOUND, "two widths": two_widths()}


def written(array, folder):
    path = folder / "board.dxf"
    write_dxf(array, path)
    return ezdxf.readfile(path)


@pytest.fixture(params=BOARDS.values(), ids=BOARDS.keys(), scope="module")
def read(request, tmp_path_factory):
    return request.param, written(request.param, tmp_path_factory.mktemp("dxf"))


def on_layer(drawing, layer):
    return [entity for entity in drawing.modelspace() if entity.dxf.layer == layer]


def region(drawing, layer):
    """Area between the rings of a layer, by the even-odd rule."""
    rings = [shapely.LinearRing(list(entity.vertices())) for entity in on_layer(drawing, layer)]
    return shapely.build_area(shapely.GeometryCollection(rings))


def in_mm(shape):
    return shapely.transform(shape, lambda xy: xy * 1e3)


def assert_same_area(drawing, array):
    for name in array.stackup.names:
        expected = in_mm(shapely.union_all(list(copper_by_layer(array)[name].values())))
        got = region(drawing, f"copper_{name}")
        # every edge may be off by the rounding
        assert got.area == pytest.approx(expected.area, abs=ROUNDING * expected.length, rel=0)
        assert got.area == pytest.approx(expected.area, rel=1e-8)
        assert got.bounds == pytest.approx(expected.bounds, abs=ROUNDING)


def test_the_drawing_is_sound_and_in_millimetres(read):
    array, drawing = read
    audit = drawing.audit()
    assert [*audit.errors, *audit.fixes] == []
    assert drawing.header["$INSUNITS"] == 4  # mm
    assert drawing.header["$MEASUREMENT"] == 1  # metric
    bounds = np.array(array.bounds) * 1e3
    assert drawing.header["$EXTMIN"][:2] == pytest.approx(bounds[:2], abs=ROUNDING)
    assert drawing.header["$EXTMAX"][:2] == pytest.approx(bounds[2:], abs=ROUNDING)


def test_copper_is_that_of_the_board(read):
    array, drawing = read
    assert_same_area(drawing, array)
    for name in array.stackup.names:
        outlines = on_layer(drawing, f"copper_{name}")
        assert all(outline.closed and not outline.has_width for outline in outlines)
        pieces = [shapely.get_parts(copper) for copper in copper_by_layer(array)[name].values()]
        assert len(outlines) == sum(len(shapely.get_rings(parts)) for parts in pieces)


def test_centre_lines_carry_their_widths(read):
    array, drawing = read
    for name in array.stackup.names:
        layer = drawing.layers.get(f"path_{name}")
        assert layer.is_off()  # the same copper again
        assert layer.dxf.plot == 0
        traces = [
            (line, widths, placement.coil.arcs_of(k))
            for placement in array.placements
            for k, (line, widths, layer) in enumerate(placement.traces())
            if layer == name
        ]
        for path, (line, widths, arcs) in zip(on_layer(drawing, f"path_{name}"), traces, strict=True):
            assert not path.closed
            points = np.array(path.get_points("xyse"))
            # arcs are test_arcs.py's
            ends = [k for k in range(len(line)) if not any(arc.first < k < arc.last for arc in arcs)]
            np.testing.assert_allclose(points[:, :2], line[ends] * 1e3, rtol=0, atol=ROUNDING)
            np.testing.assert_allclose(points[:-1, 2:].T, (widths[ends[:-1]] * 1e3,) * 2, rtol=1e-12)


def test_holes_edge_and_names(read):
    array, drawing = read
    circles = [entity for entity in drawing.modelspace() if entity.dxftype() == "CIRCLE"]
    holes = [hole for hole in drills(array) if hole.drilled]
    got = sorted((*circle.dxf.center.vec2, circle.dxf.radius) for circle in circles)
    expected = sorted((hole.x * 1e3, hole.y * 1e3, hole.diameter / 2 * 1e3) for hole in holes)
    np.testing.assert_allclose(got, expected, rtol=0, atol=ROUNDING)
    through = sum(hole.layers == array.stackup.names for hole in holes)
    assert sum(circle.dxf.layer == "drill" for circle in circles) == through
    (edge,) = on_layer(drawing, "outline")
    assert edge.closed
    assert shapely.Polygon(list(edge.vertices())).bounds == pytest.approx(in_mm(board_outline(array)).bounds)
    texts = {text.dxf.text: text.get_placement()[1] for text in on_layer(drawing, "silk")}
    assert {name: tuple(at.vec2) for name, at in texts.items()} == {
        placement.name: pytest.approx((placement.x * 1e3, placement.y * 1e3), abs=ROUNDING)
        for placement in array.placements
    }
    assert {entity.dxf.layer for entity in drawing.modelspace()} <= {layer.dxf.name for layer in drawing.layers}


@pytest.mark.lowest
def test_holes_that_are_not_through_lie_on_layers_of_their_own(tmp_path):
    drawing = written(BOARDS["four layers, blind holes"], tmp_path)
    layers = {entity.dxf.layer for entity in drawing.modelspace() if entity.dxftype() == "CIRCLE"}
    assert layers == {"drill_L1_L2", "drill_L2_L3", "drill_L3_L4"}  # the terminals are pads
    assert layers == {layer.dxf.name for layer in drawing.layers if layer.dxf.name.startswith("drill")}


def board_of_layers(*names):
    coil = path_coil([[(0, 0), (1e-2, 0)]], 0.2e-3, 0.2e-3, VIA)
    return Array(replace(many_layers(len(names)), names=names), (Placement("A", coil, names[:1], 0, 0),))


def test_names_of_layers_that_cannot_be(tmp_path):
    for names, message in (
        (("top/1",), "names of layers must be free of"),
        (("a", "b*"), "names of layers must be free of"),
        (("top", "TOP"), "names of layers must differ in more than capitals; got top, TOP"),
    ):
        refused(OutputError, message, write_dxf, board_of_layers(*names), tmp_path / "board.dxf")
    assert list(tmp_path.iterdir()) == []
