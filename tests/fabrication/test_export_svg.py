"""SVG drawings, read back as XML: size, layers, paths, holes and names; and everything that cannot be written."""

import re
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import shapely
from support.boards import VIA, WOUND, reference_board, wound_board

from coilarray.fabrication.drawings import write_svg
from coilarray.geometry import Array, Placement, Stackup, copper_by_layer, drills, path_coil

ROUNDING = 0.501e-4  # mm: coordinates are written with four digits after the point
SVG = "{http://www.w3.org/2000/svg}"
LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
MODE = "{http://www.inkscape.org/namespaces/inkscape}groupmode"
BOARDS = {"reference": reference_board(count=2), **WOUND}


@pytest.fixture(params=BOARDS.values(), ids=BOARDS.keys(), scope="module")
def read(request, tmp_path_factory):
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


def test_the_page_is_the_board_in_millimetres_in_layers_of_their_own_colour(read):
    array, root = read
    x, y, width, height = map(float, root.get("viewBox").split())
    assert (root.get("width"), root.get("height")) == (f"{width:g}mm", f"{height:g}mm")
    x_min, y_min, x_max, y_max = np.array(array.bounds) * 1e3
    margin = 0.5
    # the page begins at the upper edge, where −y is least
    assert (x, y) == pytest.approx((x_min - margin, -y_max - margin), abs=ROUNDING)
    assert (x + width, y + height) == pytest.approx((x_max + margin, -y_min + margin), abs=2 * ROUNDING)
    assert root.find(f"{SVG}title").text == "a board"
    layers = groups(root)
    assert list(layers) == ["outline", *reversed(array.stackup.names), "drills", "names"]
    assert all(group.get(MODE) == "layer" for group in layers.values())
    colours = {layers[name].get("fill") for name in array.stackup.names}
    assert len(colours) == len(array.stackup.names)
    identities = [element.get("id") for element in root.iter() if element.get("id") is not None]
    assert len(set(identities)) == len(identities) == len(layers) + 1


def test_copper_is_that_of_the_board(read):
    array, root = read
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
                np.testing.assert_allclose(corners, wanted * 1e3, rtol=0, atol=ROUNDING)
            area = shapely.build_area(shapely.GeometryCollection([shapely.LinearRing(ring) for ring in got])).area
            # every edge may be off by the rounding in x and y
            assert area == pytest.approx(shape.area * 1e6, abs=np.sqrt(2) * ROUNDING * shape.length * 1e3, rel=0)
            assert area == pytest.approx(shape.area * 1e6, rel=1e-4)  # the errors of many edges cancel


def test_edge_holes_and_names(read):
    array, root = read
    layers = groups(root)
    (edge,) = layers["outline"]
    (corners,) = rings(edge)
    low_high = np.array(array.bounds).reshape(2, 2) * 1e3
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], low_high, rtol=0, atol=ROUNDING)
    holes = [[float(circle.get(key)) for key in ("cx", "cy", "r")] for circle in layers["drills"]]
    drilled = [hole for hole in drills(array) if hole.drilled]
    expected = [(hole.x * 1e3, hole.y * 1e3, hole.diameter / 2 * 1e3) for hole in drilled]
    np.testing.assert_allclose(holes, expected, rtol=0, atol=ROUNDING)
    for text, placement in zip(layers["names"], array.placements, strict=True):
        assert text.text == placement.name
        x, y = map(float, re.fullmatch(r"translate\((\S+) (\S+)\) scale\(1 -1\)", text.get("transform")).groups())
        assert (x, y) == pytest.approx((placement.x * 1e3, placement.y * 1e3), abs=ROUNDING)


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
