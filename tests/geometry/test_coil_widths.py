"""Coils with a width a segment and several lines on a layer: copper, conductor, rules, capacitance, design files.

Who checks whom: closed formulas for areas, resistances and distances; a coil of one width given as a number and as
arrays; a spiral against the same spiral with a jumper, half a millimetre of it led over another layer.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from support.boards import FOUR_LAYERS, VIA, many_layers
from support.refusals import refused

from coilarray.constants import RESISTIVITY_COPPER
from coilarray.design.model import parse_design
from coilarray.electromagnetics.capacitance import coil_capacitance
from coilarray.electromagnetics.inductance import inductance_matrix
from coilarray.electromagnetics.resistance import dc_resistance
from coilarray.errors import DesignError, GeometryError
from coilarray.geometry.array import Array, Placement
from coilarray.geometry.coil import path_coil
from coilarray.geometry.copper import copper_by_layer, copper_features, drills, solids, trace_outline, uniform_runs
from coilarray.geometry.rules import FabRules, check_rules
from coilarray.geometry.spiral import Spiral

ROUNDING = 1e-12  # relative, or m on a board of centimetres: a few operations in float64
NARROW, WIDE = 0.2e-3, 0.6e-3
BENT = [(0.0, 0.0), (4e-3, 0.0), (4e-3, 3e-3), (9e-3, 3e-3)]


def on_board(*placements, layers=4, **options):
    return Array(many_layers(layers), tuple(placements), **options)


def one_line(widths, line=BENT, layer="L1", **options):
    """Board of one coil A of one line."""
    return on_board(Placement("A", path_coil([line], widths, 1e-4, VIA), (layer,), 0, 0), **options)


def margins(array, rule):
    return {(m.layer, m.feature): m for m in check_rules(array, FabRules()) if m.rule == rule}


def test_the_trace_width_is_that_of_most_of_the_length_and_runs_of_one_width_meet():
    assert path_coil([BENT], [[WIDE, NARROW, NARROW]], 1e-4, VIA).trace_width == NARROW  # 8 of 12 mm
    assert path_coil([BENT], [[NARROW, NARROW, WIDE]], 1e-4, VIA).trace_width == NARROW  # 7 of 12 mm
    assert path_coil([BENT[:3]], [[NARROW, WIDE]], 1e-4, VIA).trace_width == NARROW
    assert path_coil([BENT[1:]], [[NARROW, WIDE]], 1e-4, VIA).trace_width == WIDE
    runs = uniform_runs(np.array(BENT), np.array([WIDE, NARROW, NARROW]))
    assert [(len(piece), width) for piece, width in runs] == [(2, WIDE), (3, NARROW)]
    np.testing.assert_array_equal(runs[0][0][-1], runs[1][0][0])


def test_widths_that_cannot_be():
    for widths, message in (
        ([], "a coil of 1 lines must have as many arrays of widths; got 0"),
        ([[1e-4]], r"line 0 of a coil must have 3 widths, one a segment; got shape \(1,\)"),
        ([[[1e-4]] * 3], r"got shape \(3, 1\)"),
        ([[1e-4, 0.0, 1e-4]], "trace_width must be positive, 1e-30 to 1e.30 m; got 0.0 m on line 0"),
        ([[1e-4, -1e-4, 1e-4]], "trace_width must be positive, 1e-30 to 1e.30 m; got -0.0001 m"),
        ([[1e-4, math.nan, 1e-4]], "trace_width must be positive, 1e-30 to 1e.30 m; got nan m"),
        ([[1e-4, 1e-300, 1e-4]], "trace_width must be positive, 1e-30 to 1e.30 m; got 1e-300 m"),
        ([["a", "b", "c"]], "trace_width must be a number, or numbers"),
        ("wide", "trace_width must be a number, or numbers"),
    ):
        refused(GeometryError, message, path_coil, [BENT], widths, 1e-4, VIA)


@given(widths=st.lists(st.floats(0.05e-3, 0.5e-3), min_size=2, max_size=8))
@settings(max_examples=50)
def test_a_straight_trace_has_the_area_of_its_rectangles(widths):
    line = np.column_stack((2e-3 * np.arange(len(widths) + 1), np.zeros(len(widths) + 1)))
    outline = trace_outline(line, widths)
    # straight on, the joint of the smaller width lies inside both rectangles
    assert outline.area == pytest.approx(2e-3 * sum(widths), rel=1e-9)  # rounding of the union
    assert outline.geom_type == "Polygon"
    assert outline.is_valid


@pytest.mark.parametrize("angle", [10, 45, 90, 135])
def test_a_corner_between_two_widths_is_filled_by_the_narrower(angle):
    phi = math.radians(angle)
    line = np.array([(-5e-3, 0), (0, 0), (5e-3 * math.cos(phi), 5e-3 * math.sin(phi))])
    outline = trace_outline(line, [NARROW, WIDE])
    assert outline.geom_type == "Polygon"
    both = shapely.union(*(trace_outline(line[k : k + 2], width) for k, width in enumerate((NARROW, WIDE))))
    assert shapely.covers(outline.buffer(1e-9), shapely.union(both, shapely.Point(0, 0).buffer(NARROW / 2)))
    # and nothing more: the round joint adds at most half of its disc
    assert outline.area <= both.area + math.pi * NARROW**2 / 8 + 1e-15


def test_every_segment_has_its_own_width():
    widths = [NARROW, WIDE, 0.3e-3]
    array = one_line([widths], layer="L2")
    (wire,) = array.conductors()
    np.testing.assert_array_equal(wire.widths, widths)
    resistance = RESISTIVITY_COPPER * (np.array([4e-3, 3e-3, 5e-3]) / (np.array(widths) * 35e-6)).sum()
    assert dc_resistance(array)[0] == pytest.approx(resistance, rel=ROUNDING)
    x_min, y_min, x_max, y_max = one_line([[NARROW, NARROW, WIDE]]).bounds
    # bounds take half the width to all sides of every corner
    assert (x_min, y_min) == pytest.approx((-2e-3 - NARROW / 2, -2e-3 - NARROW / 2), rel=ROUNDING)
    assert (x_max, y_max) == pytest.approx((11e-3 + WIDE / 2, 5e-3 + WIDE / 2), rel=ROUNDING)
    worst = margins(one_line([[WIDE, 0.08e-3, NARROW]]), "trace width")[("L1", "A")]
    assert (worst.value, worst.x, worst.y) == pytest.approx((0.08e-3, 4e-3, 1.5e-3), rel=ROUNDING)


def test_gaps_count_from_the_wide_part():
    pitch = 0.6e-3
    array = one_line([[NARROW, NARROW, WIDE]], [(0, 0), (5e-3, 0), (5e-3, pitch), (0, pitch)])
    value = margins(array, "spacing within net")[("L1", "A")].value
    assert value == pytest.approx(pitch - (NARROW + WIDE) / 2, abs=ROUNDING)
    # beside a pad
    line = [(-3e-3, 1e-3), (3e-3, 1e-3), (3e-3, -2e-3), (0, -2e-3), (0, 0)]
    coil = path_coil([line, [(0, 0), (0, -1e-3)]], [[WIDE] + [NARROW] * 3, [NARROW]], 1e-4, VIA)
    value = margins(on_board(Placement("A", coil, ("L1", "L2"), 0, 0)), "spacing within net")[("L1", "A")].value
    assert value == pytest.approx(1e-3 - VIA.pad / 2 - WIDE / 2, abs=ROUNDING)
    # of two nets
    a = Placement("A", path_coil([BENT[:2]], NARROW, 1e-4, VIA), ("L1",), 0, 0)
    line = [(0, 1e-3), (2e-3, 1e-3), (4e-3, 1e-3)]
    b = Placement("B", path_coil([line], [[NARROW, WIDE]], 1e-4, VIA), ("L1",), 0, 0)
    worst = margins(on_board(a, b), "clearance")[("L1", "A – B")]
    assert worst.value == pytest.approx(1e-3 - (NARROW + WIDE) / 2, abs=ROUNDING)
    assert worst.x > 2e-3 - ROUNDING


def three_lines(apart=1e-3):
    """On L1 to a via, on L2 up, and on L1 back beside the first."""
    lines = [[(0, 0), (5e-3, 0)], [(5e-3, 0), (5e-3, apart)], [(5e-3, apart), (0, apart)]]
    return Placement("A", path_coil(lines, [[NARROW], [NARROW], [WIDE]], 1e-4, VIA), ("L1", "L2", "L1"), 0, 0)


def test_a_path_may_return_to_a_layer():
    array = on_board(three_lines())
    assert array.placements[0].lines_on("L1") == (0, 2)
    (wire,) = array.conductors()
    heights = [FOUR_LAYERS.centre("L1") if k in (0, 1, 4, 5) else many_layers(4).centre("L2") for k in range(6)]
    np.testing.assert_allclose(wire.vertices[:, 2], heights, rtol=ROUNDING)
    assert [f.layer for f in copper_features(array) if f.kind == "trace"] == ["L1", "L2", "L1"]
    assert [hole.layers for hole in drills(on_board(three_lines(), through_holes=False))] == [("L1", "L2")] * 2
    area = copper_by_layer(on_board(three_lines(), through_holes=False))["L1"]["A"].area
    # two traces and two pads, less what they share: a strip of half a disc, and half a disc
    R, h = VIA.pad / 2, NARROW / 2
    shared = R**2 * math.asin(h / R) + h * math.sqrt(R**2 - h**2) + math.pi * R**2 / 2
    assert area == pytest.approx(5e-3 * (NARROW + WIDE) + 2 * math.pi * R**2 - shared, rel=1e-4)  # discs of 128 corners
    assert all(solid.is_watertight for solid in solids(array).values())


def test_separate_lines_of_a_net_keep_their_spacing():
    faces = ((NARROW + WIDE) / 2, (VIA.pad + WIDE) / 2, VIA.pad)
    for apart in (0.45e-3, 0.6e-3, 1e-3):
        worst = margins(on_board(three_lines(apart)), "spacing within net")[("L1", "A")]
        assert worst.value == pytest.approx(apart - max(faces), abs=ROUNDING)
    # far from their vias
    first, last = [(0, 0), (5e-3, 0), (5e-3, -3e-3)], [(5e-3, 3e-3), (4e-3, 0.5e-3), (0, 0.5e-3)]
    coil = path_coil([first, [first[-1], last[0]], last], NARROW, 1e-4, VIA)
    worst = margins(on_board(Placement("A", coil, ("L1", "L3", "L1"), 0, 0)), "spacing within net")[("L1", "A")]
    assert worst.value == pytest.approx(0.5e-3 - NARROW, abs=ROUNDING)
    assert 0 <= worst.y <= 0.5e-3
    # lines that meet on a layer
    lines = [[(0, 0), (5e-3, 0)], [(5e-3, 0), (5e-3, 2e-3)], [(5e-3, 2e-3), (2e-3, 2e-3), (2e-3, -1e-3)]]
    coil, message = path_coil(lines, NARROW, 1e-4, VIA), r"lines 0 and 2 of A meet on L1, at \(2, 0\) mm of the coil"
    refused(GeometryError, message, Placement, "A", coil, ("L1", "L2", "L1"), 0, 0)
    assert Placement("A", coil, ("L1", "L2", "L3"), 0, 0).lines_on("L1") == (0,)


SPIRAL = Spiral(6, 12e-3, 4, 0.3e-3, 0.3e-3)


def plain_and_jumpered():
    """A spiral of one line, and of three: half a millimetre out of the middle of a segment is a line of its own."""
    line = replace(SPIRAL, layers=1, leads=None).coil().lines[0]
    k = 3 * len(line) // 5
    middle, step = (line[k] + line[k + 1]) / 2, line[k + 1] - line[k]
    first, second = (middle + along * 0.25e-3 * step / np.hypot(*step) for along in (-1, 1))
    lines = [np.vstack((line[: k + 1], first)), np.stack((first, second)), np.vstack((second, line[k + 1 :]))]
    plain, jumped = (path_coil(parts, 0.3e-3, 0.3e-3, VIA) for parts in ([line], lines))
    return Placement("A", plain, ("L1",), 0, 0), Placement("A", jumped, ("L1", "L4", "L1"), 0, 0)


def test_a_jumper_changes_the_winding_little():
    one, other = (on_board(placement, through_holes=False) for placement in plain_and_jumpered())
    a, b = (coil_capacitance(array).isel(coil=0) for array in (one, other))
    # half a millimetre of 130 mm; the charge between its layers is all that is new
    assert float(b.turn_to_turn) == pytest.approx(float(a.turn_to_turn), rel=0.02)
    assert abs(b.interlayer) < 0.02 * a.turn_to_turn
    L, plain = (inductance_matrix(board.conductors())[0, 0] for board in (other, one))
    assert L == pytest.approx(plain, rel=5e-3)


def test_a_winding_of_two_widths_lies_between_those_of_one():
    def lumped(first, second):
        lines = Spiral(6, 8e-3, 4, 0.2e-3, 0.2e-3, leads=None).coil().lines
        widths = [np.full(len(lines[0]) - 1, first), np.full(len(lines[1]) - 1, second)]
        array = on_board(Placement("A", path_coil(lines, widths, 0.2e-3, VIA), ("L1", "L2"), 0, 0), layers=2)
        return coil_capacitance(array).coil_capacitance.item()

    # more copper at the same place has more capacitance
    assert lumped(0.1e-3, 0.1e-3) < lumped(0.1e-3, 0.3e-3) < lumped(0.3e-3, 0.3e-3)
    assert lumped(0.1e-3, 0.3e-3) == pytest.approx(lumped(0.3e-3, 0.1e-3), rel=0.03)  # L1 has air above, as L2 below


def test_widths_of_a_design_file():
    path = """
    schema = 1
    name = "tapered"
    stackup = { layers = ["top"], copper_thickness_um = [35] }
    coils.bent = { shape = "path", gap_mm = 0.2, lines_mm = [[[0, 0], [4, 0], [4, 3], [9, 3]]], trace_width_mm = WIDTH }
    array.lattice = "free"
    array.placements = [{ name = "a", coil = "bent", layers = ["top"], x_mm = 0, y_mm = 0 }]
    """
    for text, widths, bare in (
        ("[[0.2, 0.6, 0.3]]", [0.2e-3, 0.6e-3, 0.3e-3], False),
        ("0.2, terminals = false", [0.2e-3] * 3, True),
    ):
        coil = parse_design(path.replace("WIDTH", text)).array.placements[0].coil
        np.testing.assert_allclose(coil.widths[0], widths, rtol=ROUNDING)
        assert (coil.terminal is None) is bare
    for width, message in (
        ("'wide'", "coils.bent.trace_width_mm must be a number; got 'wide'"),
        ("[0.2, 0.2, 0.2]", "coils.bent.trace_width_mm.0 must be a list; got 0.2"),
        ("[[0.2, 0.0, 0.2]]", "coils.bent.trace_width_mm.0.1 must be greater than 0; got 0.0"),
        ("[[0.2]]", "coils.bent: line 0 of a coil must have 3 widths"),
    ):
        refused(DesignError, message, parse_design, path.replace("WIDTH", width))
