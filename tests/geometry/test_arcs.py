"""Arcs: corners of lines that are rounded, and boards of arcs written as arcs and read back."""

import math

import ezdxf
import numpy as np
import pytest
import shapely
from support.boards import arcs_board

from coilarray.fabrication.drawings import write_dxf
from coilarray.geometry.arcs import CHORD_ERROR, Arc, arc_size, coarser_line, pieces_of, rounded_line

BOARD = arcs_board()
ARCS = sum(len(arcs) for place in BOARD.placements for arcs in place.coil.arcs)


def test_paths_of_a_dxf_drawing_have_bulges(tmp_path):
    write_dxf(BOARD, tmp_path / "board.dxf")
    paths = [line for line in ezdxf.readfile(tmp_path / "board.dxf").modelspace() if line.dxf.layer.startswith("path_")]
    bulges = [bulge for line in paths for *_, bulge in line.get_points() if bulge]
    assert len(bulges) == ARCS
    lines = [line for place in BOARD.placements for line, _, _ in place.traces()]
    arcs = [arcs for place in BOARD.placements for arcs in place.coil.arcs]
    for path, line, expected in zip(paths, lines, arcs, strict=True):
        begun = [(x, y, bulge) for x, y, _, _, bulge in path.get_points() if bulge]
        wanted = [(*(line[arc.first] * 1e3), arc.bulge) for arc in expected]
        np.testing.assert_allclose(np.array(begun).reshape(-1, 3), np.array(wanted).reshape(-1, 3), atol=1e-8)


CORNERS = np.array([(0, 0), (4e-3, 0), (4e-3, 3e-3), (1e-3, 3e-3), (0, 6e-3)])
RADII = [1e-3, 0.0, 2e-3]


def test_rounded_corners():
    line, arcs = rounded_line(CORNERS, RADII)
    sizes = [arc_size(*arc.points(line)) for arc in arcs]
    assert [radius for radius, _ in sizes] == pytest.approx([1e-3, 2e-3], rel=1e-9)  # rounding
    sharp = math.atan2(3, -1) - math.pi
    assert [turn for _, turn in sizes] == pytest.approx([math.pi / 2, sharp], rel=1e-9)
    pieces = list(pieces_of(line, arcs))
    assert [piece.bulge != 0 for piece in pieces] == [False, True, False, False, True, False]
    assert [piece.first for piece in pieces[1:]] == [piece.last for piece in pieces[:-1]]
    # the corners' tangents, and the arcs, which the pieces follow to the error
    buffered = shapely.LineString(line).buffer(1.01 * CHORD_ERROR)
    for arc in arcs:
        begin, middle, end = map(np.array, arc.points(line))
        assert buffered.covers(shapely.Point(middle))
        assert np.hypot(*(middle - (begin + end) / 2)) == pytest.approx(abs(arc.bulge) * np.hypot(*(end - begin)) / 2)


def test_coarser_lines_keep_what_is_straight_and_the_area():
    line, arcs = rounded_line(CORNERS, RADII)
    coarse, pieces = coarser_line(line, arcs, math.pi / 8)
    assert (
        len(coarse) == len(pieces) + 1 == 4 + 4 + 4 + 1
    )  # straight pieces, those of arcs of 90° and 72°, the last end
    ends = [k for piece in pieces_of(line, arcs) for k in (piece.first, piece.last)]
    assert {tuple(point) for point in line[ends].tolist()} <= {tuple(point) for point in coarse.tolist()}
    assert shapely.Polygon(coarse).area == pytest.approx(shapely.Polygon(line).area, rel=1e-12)
    assert (np.diff(pieces) >= 0).all()
    assert Arc(3, 9, 0.2).shifted(2) == Arc(5, 11, 0.2)
