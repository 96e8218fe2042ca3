"""Spirals: both rules, closed formulas for length and area, sizes, gaps, symmetry, and every bad input.

Who checks whom: the rule of corners written out here and the lengths of another program (tests/reference) against
`Spiral`; the rule of parallel sides against the sizes and gaps that it promises, formulas, and shapely's distances.
"""

import math
from dataclasses import replace
from itertools import pairwise, product

import ezdxf
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from support.boards import arcs_board, length, swept_area
from support.references import rows
from support.refusals import refused

from coilarray.errors import GeometryError
from coilarray.fabrication.drawings import write_dxf
from coilarray.geometry import RoundedSpiral, Spiral, across_flats
from coilarray.geometry.arcs import CHORD_ERROR, Arc, arc_size, coarser_line, pieces_of, rounded_line


@pytest.mark.parametrize("row", rows("polygon_spirals_dc"), ids=lambda row: f"{row['N_sides']}x{row['layers']}")
def test_vertices_and_length_agree_with_the_reference_rule(row):
    sides, turns, layers = int(row["N_sides"]), int(row["n_turns_per_layer"]), int(row["layers"])
    edge, w, s = (float(row[key]) * 1e-3 for key in ("ap_edge_mm", "w_mm", "s_mm"))
    spiral = Spiral(sides, 2 * edge, turns, w, s, 0.0, winding_rule="corner")
    k = np.arange(sides * turns + 1)
    radius = ((edge - w / 2) - (w + s) * k / sides) / math.cos(math.pi / sides)
    expected = radius[:, None] * np.column_stack((np.cos(2 * np.pi * k / sides), np.sin(2 * np.pi * k / sides)))
    # the same formula evaluated at angles reduced by whole turns: rounding of angles up to 200 rad
    np.testing.assert_allclose(spiral.centre_line(0), expected, rtol=0, atol=1e-13 * edge * 200)
    # outward layers are the mirror image in y, traversed backwards
    np.testing.assert_allclose(spiral.centre_line(1), (expected * (1, -1))[::-1], rtol=0, atol=1e-13 * edge * 200)
    assert spiral.inner_apothem == pytest.approx(radius[-1] * math.cos(math.pi / sides), rel=1e-12)
    total = sum(length(spiral.centre_line(layer)) for layer in range(layers))
    assert total * 1e3 == pytest.approx(float(row["length_mm"]), rel=5e-6)  # printed with 6 digits


ROUND = {
    "circle": RoundedSpiral(10e-3, 10e-3, 8, 0.1e-3, 0.1e-3, 5e-3),
    "racetrack": RoundedSpiral(20e-3, 10e-3, 8.5, 0.1e-3, 0.1e-3, 5e-3),
    "rectangle": RoundedSpiral(20e-3, 12e-3, 8, 0.1e-3, 0.1e-3, winding_rule="corner"),
    "rounded": RoundedSpiral(12e-3, 20e-3, 8.25, 0.1e-3, 0.1e-3, 3e-3),
    "stepping rounded": RoundedSpiral(12e-3, 20e-3, 8.25, 0.1e-3, 0.1e-3, 3e-3, winding_rule="corner"),
    "hexagon": RoundedSpiral(12e-3, 12e-3, 8, 0.1e-3, 0.1e-3, 4e-3, 6),
}


def arc_by_arc(spiral, layer=0):
    """Length of a centre line and area that it sweeps from the origin, from its straight pieces and true arcs."""
    line, arcs = spiral.centre_line(layer), spiral.arcs(layer)
    corners = [k for k in range(len(line)) if not any(arc.first < k < arc.last for arc in arcs)]
    chords = line[corners]
    total, area = length(chords), swept_area(chords)
    for arc in arcs:
        radius, turn = arc_size(*arc.points(line))
        total += radius * (abs(turn) - 2 * math.sin(abs(turn) / 2))
        area += radius**2 * (turn - math.sin(turn)) / 2  # the segment beyond the chord
    return total, area


@pytest.mark.parametrize("spiral", ROUND.values(), ids=ROUND)
def test_round_spirals_have_the_length_and_area_of_their_arcs(spiral):
    for layer in range(2):
        line = spiral.centre_line(layer)
        total, area = arc_by_arc(spiral, layer)
        # pieces enclose the area of their arcs and are longer by φ²/24 of up to 3.4°
        assert length(line) == pytest.approx(total, rel=2e-4)
        assert swept_area(line) == pytest.approx(area, rel=1e-7)
        assert area > 0
    np.testing.assert_allclose(spiral.centre_line(0)[-1], spiral.centre_line(1)[0], atol=1e-15)


def test_a_circle_of_arcs_is_as_long_as_the_spiral_of_archimedes():
    outer, inner, pitch = 4.95e-3, 4.95e-3 - 8 * 0.2e-3, 0.2e-3
    total, _ = arc_by_arc(ROUND["circle"])
    # each quarter circle has the radius at its end, an eighth of a pitch less than on the mean of its quarter turn, and
    # a straight piece of a quarter pitch
    assert total == pytest.approx(math.pi * (outer + inner) * 8 + 32 * pitch * (1 / 4 - math.pi / 16), rel=1e-12)


@pytest.mark.parametrize(
    "spiral",
    [
        *ROUND.values(),
        Spiral(6, 16e-3, 5 + 1 / 6, 0.2e-3, 0.15e-3, 0.4),
        Spiral(5, 16e-3, 5, 2e-4, 1e-4, 0, winding="cw", winding_rule="corner"),
    ],
    ids=[*ROUND, "a sixth", "stepping"],
)
@pytest.mark.parametrize("winding", ["ccw", "cw"])
def test_layers_meet_and_keep_the_sense_of_rotation(spiral, winding):
    spiral = replace(spiral, winding=winding)
    lines = [spiral.centre_line(layer) for layer in range(4)]
    for line, following in pairwise(lines):
        np.testing.assert_allclose(line[-1], following[0], rtol=0, atol=1e-15)  # the same formula
    for line in lines:
        x, y = line.T
        assert ((1 if winding == "ccw" else -1) * (x[:-1] * y[1:] - x[1:] * y[:-1]) > 0).all()


@given(
    st.sampled_from([3, 6, 12, 4]), st.floats(-10, 10), st.booleans(), st.sampled_from(["ccw", "cw"]), st.integers(0, 3)
)
def test_the_direction_of_the_start_only_rotates(sides, start, sharp, winding, layer):
    if sharp:
        plain, turned = (Spiral(sides, 12e-3, 4, 0.15e-3, 0.15e-3, first, winding=winding) for first in (0.0, start))
    else:
        plain, turned = (
            RoundedSpiral(12e-3, 12e-3, 4, 0.15e-3, 0.15e-3, 3e-3, sides, first, winding=winding)
            for first in (0.0, start)
        )
    c, s = math.cos(start), math.sin(start)
    expected = plain.centre_line(layer) @ np.array([[c, s], [-s, c]])
    # rounding of an angle of about 10 rad at a radius of at most 12 mm
    np.testing.assert_allclose(turned.centre_line(layer), expected, rtol=0, atol=1e-15 if sharp else 1e-14)


@st.composite
def parallel_spirals(draw):
    """A winding of parallel sides with sharp corners, and how far its enclosing sides are from the centre."""
    w, s = draw(st.floats(0.05e-3, 1e-3)), draw(st.floats(0.05e-3, 1e-3))
    sides, whole = draw(st.sampled_from([3, 4, 5, 6, 8, 12])), draw(st.integers(1, 12))
    turns = whole + draw(st.integers(0, sides - 1)) / sides
    # the innermost side is longer than the step inwards, which `test_a_step_longer_than_a_side` looks at
    step = (w + s) / math.sin(2 * math.pi / sides) / math.tan(math.pi / sides) / 2
    size = w + (w + s) * whole + step + draw(st.floats(1e-5, 5e-3))
    more = {"winding": draw(st.sampled_from(["ccw", "cw"]))}
    if sides == 4 and draw(st.booleans()):
        longer = size * draw(st.floats(1, 3))
        direction = draw(st.sampled_from([0.0, math.pi / 2, 1.0]))
        extents = [2 * size, 2 * longer] if draw(st.booleans()) else [2 * longer, 2 * size]
        return RoundedSpiral(*extents, turns, w, s, direction=direction, **more)
    return Spiral(sides, 2 * size, turns, w, s, draw(st.floats(-7, 7)), **more)


def normals(spiral):
    """Directions of the enclosing sides, shape (sides, 2), and their distances, from the corners of the outline."""
    outline = spiral.outline()
    along = np.roll(outline, -1, axis=0) - outline
    normal = np.column_stack((along[:, 1], -along[:, 0])) / np.hypot(*along.T)[:, None]
    distance = (normal * outline).sum(axis=1)
    return normal * np.sign(distance)[:, None], np.abs(distance)


@given(parallel_spirals(), st.integers(0, 3))
def test_parallel_sides_have_the_stated_size_and_keep_the_gap(spiral, layer):
    line = spiral.centre_line(layer)
    normal, distance = normals(spiral)
    w, pitch = spiral.width, spiral.pitch
    size = float(distance.max())
    # copper reaches each enclosing side: half a trace beyond the outermost centre line
    np.testing.assert_allclose((line @ normal.T).max(axis=0) + w / 2, distance, rtol=0, atol=1e-12 * size)
    # every piece is parallel to a side and a whole number of pitches further in than the outermost ones
    along = np.diff(line, axis=0)
    slant = np.abs(along @ normal.T) / np.hypot(*along.T)[:, None]
    which = slant.argmin(axis=1)
    assert slant.min(axis=1).max() < 1e-9
    if spiral.sides % 2:  # sides of an even number have opposites; the nearer one is meant
        inset = distance[which] - (line[:-1] * normal[which]).sum(axis=1) - w / 2
        assert np.abs(inset / pitch - np.round(inset / pitch)).max() < 1e-9 * size / pitch
    assert len(along) == spiral.steps
    # pieces a turn apart, and almost a turn apart: exactly one pitch, where there is a second turn beside the first
    pieces = shapely.linestrings(np.stack((line[:-1], line[1:]), axis=1))
    n = spiral.sides
    apart = [shapely.distance(pieces[:-k], pieces[k:]).min() for k in range(n - 1, min(n + 2, len(pieces)))]
    assert min(apart) >= pitch - 1e-12 * size
    if len(pieces) > n:
        assert apart[1] == pytest.approx(pitch, abs=1e-12 * size)


@pytest.mark.parametrize("sides", [3, 4, 5, 6, 8])
@pytest.mark.parametrize("turns", [1, 7])
def test_length_and_area_of_parallel_sides(sides, turns):
    spiral = Spiral(sides, 20e-3, turns, 0.15e-3, 0.2e-3, 0.3)
    a, p = 10e-3 - 0.075e-3, 0.35e-3
    tangent, sine = math.tan(math.pi / sides), math.sin(2 * math.pi / sides)
    apothems = a - p * np.arange(turns)
    # closed polygons; the last side of each is shorter by p/sine, and the first of the next one longer by as much
    total = 2 * sides * tangent * apothems.sum() - p / sine
    area = sides * tangent * (apothems**2).sum() - a * p / sine / 2
    for layer in (0, 1):
        assert length(spiral.centre_line(layer)) == pytest.approx(total, rel=1e-12)  # rounding
        assert swept_area(spiral.centre_line(layer)) == pytest.approx(area, rel=1e-12)


@pytest.mark.parametrize("sides", [7, 12, 24, 64, 200])
def test_a_step_longer_than_a_side_begins_on_the_side_before(sides):
    spiral = Spiral(sides, 8e-3, 9, 0.2e-3, 0.2e-3)
    line = spiral.centre_line()
    normal, distance = normals(spiral)
    reached = (line @ normal.T).max(axis=0) + 0.1e-3
    missing = distance - reached
    # where the last sides of the outermost turn are left out as well, the step has begun there
    assert -1e-15 < missing.min() <= missing.max() < 0.4e-3
    assert missing[: 3 * sides // 4 if sides > 24 else sides].max() < 1e-15
    assert np.hypot(*line.T).min() > 4e-3 - 0.1e-3 - 9 * 0.4e-3
    apart, turns = turn_by_turn(spiral, line)
    assert 8.7 < turns <= 9  # the innermost step takes up to a quarter of a turn
    assert apart == pytest.approx(0.4e-3, abs=1e-15)


def turn_by_turn(spiral, line):
    """Pairs of pieces of a line that are half a turn and more apart: the least distance in m."""
    turned = np.unwrap(np.arctan2(line[:, 1], line[:, 0])) * (1 if spiral.winding == "ccw" else -1)
    assert (np.diff(turned) > 0).all()
    pieces = shapely.linestrings(np.stack((line[:-1], line[1:]), axis=1))
    i, j = np.nonzero(turned[None, :-1] - turned[1:, None] > math.pi)
    return float(shapely.distance(pieces[i], pieces[j]).min()), (turned[-1] - turned[0]) / (2 * math.pi)


ROUNDED = {
    "rectangle": RoundedSpiral(20e-3, 12e-3, 8, 0.1e-3, 0.1e-3, 3e-3),
    "racetrack": RoundedSpiral(12e-3, 20e-3, 8, 0.1e-3, 0.1e-3, 6e-3, winding="cw"),
    **{
        f"{n} sides": RoundedSpiral(12e-3, 12e-3, 8, 0.1e-3, 0.1e-3, radius, n, 0.4)
        for n, radius in ((3, 2e-3), (5, 5e-3), (6, 6e-3), (12, 5e-3), (40, 6e-3))
    },
}


@pytest.mark.parametrize("spiral", ROUNDED.values(), ids=ROUNDED)
def test_rounded_turns_have_the_stated_size_and_keep_the_gap(spiral):
    normal, distance = normals(replace(spiral, corner_radius=0.0))
    for layer in (0, 1):
        line = spiral.centre_line(layer)
        reached = (line @ normal.T).max(axis=0) + 0.05e-3
        missing = distance - reached
        # the arcs that stand for round ends reach up to 0.9 µm further
        assert missing.min() > -0.9e-6
        # where corners leave no room for the step, the last sides of the outermost turn are left out
        room = spiral.corner_radius < 6e-3 or spiral.is_racetrack
        assert np.count_nonzero(missing > 0.9e-6) <= (0 if room else spiral.sides / 3)
    # pieces of up to 3.4° of arcs about one centre are nearer by 1 − cos 1.7° = 4.4e-4
    assert turn_by_turn(spiral, line)[0] == pytest.approx(0.2e-3, rel=4.4e-4)


@given(parallel_spirals())
def test_every_second_layer_is_the_mirror_image_run_outwards(spiral):
    first, second = spiral.centre_line(0), spiral.centre_line(1)
    corner = spiral.junction(0)
    if spiral.steps % spiral.sides == 0:
        end = first[-1] - corner
        # symmetrical about the corner: as far from it, along its two sides
        assert np.hypot(*end) == pytest.approx(np.hypot(*(second[0] - corner)), rel=1e-9)
        np.testing.assert_allclose(second[-1], first[0], rtol=0, atol=1e-12 * np.ptp(first))
    else:
        np.testing.assert_allclose(second[0], first[-1], rtol=0, atol=1e-12 * np.ptp(first))
    if isinstance(spiral, Spiral):  # a rectangle is no mirror image of itself about a corner
        assert length(first) == pytest.approx(length(second), rel=1e-9)
        assert swept_area(first) == pytest.approx(swept_area(second), rel=1e-9)


def test_size_across_flats_and_corners():
    for sides, flats in ((6, 8.660254), (4, 7.071068)):
        assert across_flats(10e-3, sides) * 1e3 == pytest.approx(flats, abs=1e-6)  # digits given


def test_outline_has_the_given_sizes():
    outline = Spiral(6, across_flats(23e-3, 6), 3, 0.1e-3, 0.1e-3).outline()
    assert np.hypot(*outline.T) == pytest.approx(11.5e-3, rel=1e-12)
    # points lie on and up to 0.9 µm outside the arcs, and enclose their area
    circle = RoundedSpiral(10e-3, 10e-3, 3, 0.1e-3, 0.1e-3, 5e-3).outline()
    assert np.hypot(*circle.T) == pytest.approx(5e-3, abs=0.9e-6)
    assert swept_area(np.vstack((circle, circle[:1]))) == pytest.approx(math.pi * 25e-6, rel=1e-9)


BAD = [0.0, -1e-3, math.nan, math.inf]


def test_sizes_and_turns_that_cannot_be():
    good = {"diameter": 10e-3, "turns": 3, "width": 1e-4, "gap": 1e-4}
    for name, value in product(good, BAD):
        refused(GeometryError, f"{name} must be positive and finite", Spiral, 6, **{**good, name: value})
        refused(GeometryError, f"{name} must be a number; got '3'", Spiral, 6, **{**good, name: "3"})
    for sides in (2, 0, -6, "6"):
        refused(GeometryError, "sides must be a whole number of at least 3", Spiral, sides, **good)
    for sides in (2, 0, -6):
        refused(GeometryError, "sides must be at least 3", across_flats, 1e-2, sides)
    for corner in (math.nan, math.inf):
        refused(GeometryError, "first_corner must be finite", Spiral, 6, **good, first_corner=corner)
    refused(GeometryError, "winding must be 'ccw' or 'cw'; got 'left'", Spiral, 6, **good, winding="left")
    refused(GeometryError, "turns must be a multiple of 1/6", Spiral, 6, **{**good, "turns": 3.1})
    many = (6, 10.02e-3, 30, 1e-4, 1e-4)
    refused(GeometryError, r"30 turns .*; at most 24\.83 turns fit", Spiral, *many)
    refused(GeometryError, r"30 turns .*; at most 24\.5 turns fit", Spiral, *many, winding_rule="corner")
    refused(GeometryError, "at most 0 turns fit", Spiral, 6, 1e-4, 1, 1e-4, 1e-4)
    for turns, rule in ((24 + 5 / 6, "parallel"), (24.5, "corner")):
        Spiral(6, 10.02e-3, turns, 1e-4, 1e-4, winding_rule=rule)
    refused(GeometryError, "winding_rule must be 'parallel' or 'corner'; got 'c'", Spiral, 6, **good, winding_rule="c")
    good = {"extent": 12e-3, "breadth": 10e-3, "turns": 3, "width": 1e-4, "gap": 1e-4}
    for name, value in product(good, BAD):
        refused(GeometryError, f"{name} must be positive and finite", RoundedSpiral, **{**good, name: value})
    refused(GeometryError, "must be equal for 6 sides", RoundedSpiral, **good, sides=6)
    for radius in (-1e-3, 5.1e-3, math.nan):
        refused(GeometryError, "corner_radius must be 0 to 5 mm", RoundedSpiral, **good, corner_radius=radius)
    refused(GeometryError, "turns must be a multiple of 1/4", RoundedSpiral, **{**good, "turns": 3.1})
    message = r"30 turns .*; at most 24\.75 turns fit"
    refused(GeometryError, message, RoundedSpiral, **{**good, "breadth": 10.02e-3, "turns": 30})
    for size in BAD:
        refused(GeometryError, "size across corners must be positive and finite", across_flats, size, 6)


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
