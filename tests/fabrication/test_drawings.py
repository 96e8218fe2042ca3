"""Drawings of boards, DXF read back by ezdxf and SVG as XML: units, layers, areas, paths, holes and names."""

import re
from dataclasses import replace
from xml.etree import ElementTree as ET

import ezdxf
import numpy as np
import pytest
import shapely
from support.boards import VIA, WOUND, many_layers, reference_board, wound_board
from support.refusals import refused

from coilarray.errors import OutputError
from coilarray.fabrication.drawings import write_dxf, write_svg
from coilarray.geometry import Array, Placement, PlatedHole, Stackup, path_coil
from coilarray.geometry.copper import board_outline, copper_by_layer, drills

DXF_ROUNDING = 1e-9  # mm: coordinates are written with nine digits after the point


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
def dxf(request, tmp_path_factory):
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
        assert got.area == pytest.approx(expected.area, abs=DXF_ROUNDING * expected.length, rel=0)
        assert got.area == pytest.approx(expected.area, rel=1e-8)
        assert got.bounds == pytest.approx(expected.bounds, abs=DXF_ROUNDING)


def test_the_drawing_is_sound_and_in_millimetres(dxf):
    array, drawing = dxf
    audit = drawing.audit()
    assert [*audit.errors, *audit.fixes] == []
    assert drawing.header["$INSUNITS"] == 4  # mm
    assert drawing.header["$MEASUREMENT"] == 1  # metric
    bounds = np.array(array.bounds) * 1e3
    assert drawing.header["$EXTMIN"][:2] == pytest.approx(bounds[:2], abs=DXF_ROUNDING)
    assert drawing.header["$EXTMAX"][:2] == pytest.approx(bounds[2:], abs=DXF_ROUNDING)


def test_copper_in_dxf_is_that_of_the_board(dxf):
    array, drawing = dxf
    assert_same_area(drawing, array)
    for name in array.stackup.names:
        outlines = on_layer(drawing, f"copper_{name}")
        assert all(outline.closed and not outline.has_width for outline in outlines)
        pieces = [shapely.get_parts(copper) for copper in copper_by_layer(array)[name].values()]
        assert len(outlines) == sum(len(shapely.get_rings(parts)) for parts in pieces)


def test_centre_lines_carry_their_widths(dxf):
    array, drawing = dxf
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
            # arcs are tests/geometry/test_spiral.py's
            ends = [k for k in range(len(line)) if not any(arc.first < k < arc.last for arc in arcs)]
            np.testing.assert_allclose(points[:, :2], line[ends] * 1e3, rtol=0, atol=DXF_ROUNDING)
            np.testing.assert_allclose(points[:-1, 2:].T, (widths[ends[:-1]] * 1e3,) * 2, rtol=1e-12)


def test_holes_edge_and_names_in_dxf(dxf):
    array, drawing = dxf
    circles = [entity for entity in drawing.modelspace() if entity.dxftype() == "CIRCLE"]
    holes = [hole for hole in drills(array) if hole.drilled]
    got = sorted((*circle.dxf.center.vec2, circle.dxf.radius) for circle in circles)
    expected = sorted((hole.x * 1e3, hole.y * 1e3, hole.diameter / 2 * 1e3) for hole in holes)
    np.testing.assert_allclose(got, expected, rtol=0, atol=DXF_ROUNDING)
    through = sum(hole.layers == array.stackup.names for hole in holes)
    assert sum(circle.dxf.layer == "drill" for circle in circles) == through
    (edge,) = on_layer(drawing, "outline")
    assert edge.closed
    assert shapely.Polygon(list(edge.vertices())).bounds == pytest.approx(in_mm(board_outline(array)).bounds)
    texts = {text.dxf.text: text.get_placement()[1] for text in on_layer(drawing, "silk")}
    assert {name: tuple(at.vec2) for name, at in texts.items()} == {
        placement.name: pytest.approx((placement.x * 1e3, placement.y * 1e3), abs=DXF_ROUNDING)
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


SVG_ROUNDING = 0.501e-4  # mm: coordinates are written with four digits after the point
SVG = "{http://www.w3.org/2000/svg}"
LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
MODE = "{http://www.inkscape.org/namespaces/inkscape}groupmode"


@pytest.fixture(params=list(BOARDS.values())[:-1], ids=list(BOARDS)[:-1], scope="module")
def svg(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("svg") / "board.svg"
    write_svg(request.param, path, title="a board")
    return request.param, ET.parse(path).getroot()


def groups(root):
    board = root.find(f"{SVG}g")
    assert board.get("transform") == "scale(1 -1)"  # y upwards
    return {group.get(LABEL): group for group in board}


def rings(path):
    """Corners of every closed ring of a path of straight lines, each of shape (n, 2)."""
    data = path.get("d")
    assert re.fullmatch(r"[MZ0-9., -]*", data)
    found = re.findall("M(.*?)Z", data)
    return [np.array([corner.split(",") for corner in ring.split()], dtype=float) for ring in found]


def test_the_page_is_the_board_in_millimetres_in_layers_of_their_own_colour(svg):
    array, root = svg
    x, y, width, height = map(float, root.get("viewBox").split())
    assert (root.get("width"), root.get("height")) == (f"{width:g}mm", f"{height:g}mm")
    x_min, y_min, x_max, y_max = np.array(array.bounds) * 1e3
    margin = 0.5
    # the page begins at the upper edge, where −y is least
    assert (x, y) == pytest.approx((x_min - margin, -y_max - margin), abs=SVG_ROUNDING)
    assert (x + width, y + height) == pytest.approx((x_max + margin, -y_min + margin), abs=2 * SVG_ROUNDING)
    assert root.find(f"{SVG}title").text == "a board"
    layers = groups(root)
    assert list(layers) == ["outline", *reversed(array.stackup.names), "drills", "names"]
    assert all(group.get(MODE) == "layer" for group in layers.values())
    colours = {layers[name].get("fill") for name in array.stackup.names}
    assert len(colours) == len(array.stackup.names)
    identities = [element.get("id") for element in root.iter() if element.get("id") is not None]
    assert len(set(identities)) == len(identities) == len(layers) + 1


def test_copper_in_svg_is_that_of_the_board(svg):
    array, root = svg
    for name in array.stackup.names:
        group = groups(root)[name]
        assert group.get("fill-rule") == "evenodd"
        copper = copper_by_layer(array)[name]
        assert [path.find(f"{SVG}title").text for path in group] == list(copper)
        for path, shape in zip(group, copper.values(), strict=True):
            expected = [shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(shapely.get_parts(shape))]
            got = rings(path)
            assert len(got) == len(expected)
            for corners, wanted in zip(got, expected, strict=True):
                np.testing.assert_allclose(corners, wanted * 1e3, rtol=0, atol=SVG_ROUNDING)
            area = shapely.build_area(shapely.GeometryCollection([shapely.LinearRing(ring) for ring in got])).area
            # every edge may be off by the rounding in x and y
            assert area == pytest.approx(shape.area * 1e6, abs=np.sqrt(2) * SVG_ROUNDING * shape.length * 1e3, rel=0)
            assert area == pytest.approx(shape.area * 1e6, rel=1e-4)  # the errors of many edges cancel


def test_edge_holes_and_names_in_svg(svg):
    array, root = svg
    layers = groups(root)
    (edge,) = layers["outline"]
    (corners,) = rings(edge)
    low_high = np.array(array.bounds).reshape(2, 2) * 1e3
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], low_high, rtol=0, atol=SVG_ROUNDING)
    holes = [[float(circle.get(key)) for key in ("cx", "cy", "r")] for circle in layers["drills"]]
    drilled = [hole for hole in drills(array) if hole.drilled]
    expected = [(hole.x * 1e3, hole.y * 1e3, hole.diameter / 2 * 1e3) for hole in drilled]
    np.testing.assert_allclose(holes, expected, rtol=0, atol=SVG_ROUNDING)
    for text, placement in zip(layers["names"], array.placements, strict=True):
        assert text.text == placement.name
        x, y = map(float, re.fullmatch(r"translate\((\S+) (\S+)\) scale\(1 -1\)", text.get("transform")).groups())
        assert (x, y) == pytest.approx((placement.x * 1e3, placement.y * 1e3), abs=SVG_ROUNDING)


def test_equal_boards_give_equal_bytes_and_any_name_is_kept(tmp_path):
    for name in ("a.svg", "b.svg"):
        write_svg(wound_board(5, 2, 1.0), tmp_path / name)
    first = (tmp_path / "a.svg").read_bytes()
    assert first == (tmp_path / "b.svg").read_bytes()
    coil = path_coil([[(0, 0), (1e-2, 0)]], 0.2e-3, 0.2e-3, VIA)
    board = Stackup(('<top> & "µ"',), (35e-6,), (), ())
    write_svg(Array(board, (Placement("A<&>'\"ü", coil, board.names, 0, 0),)), tmp_path / "board.svg", title="<&>")
    root = ET.parse(tmp_path / "board.svg").getroot()
    assert root.find(f"{SVG}title").text == "<&>"
    (path,) = groups(root)['<top> & "µ"']
    assert path.find(f"{SVG}title").text == "A<&>'\"ü"
