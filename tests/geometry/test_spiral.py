"""Spirals: the vertex rule, closed formulas for length and area, sizes, symmetry, and every bad input.

Who checks whom: the rule written out here and the lengths of another program (tests/reference) against `Spiral`.
"""

import math
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.boards import length, swept_area
from support.references import rows
from support.refusals import refused

from coilarray.errors import GeometryError
from coilarray.geometry import RoundedSpiral, Spiral, apothem_from_size
from coilarray.geometry.arcs import arc_size


@pytest.mark.parametrize("row", rows("polygon_spirals_dc"), ids=lambda row: f"{row['N_sides']}x{row['layers']}")
def test_vertices_and_length_agree_with_the_reference_rule(row):
    sides, turns, layers = int(row["N_sides"]), int(row["n_turns_per_layer"]), int(row["layers"])
    edge, w, s = (float(row[key]) * 1e-3 for key in ("ap_edge_mm", "w_mm", "s_mm"))
    spiral = Spiral(sides, edge, turns, w, s)
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


@pytest.mark.parametrize("sides", [3, 4, 6, 12])
def test_length_of_a_segment_follows_the_cosine_rule(sides):
    spiral = Spiral(sides, 10e-3, 7, 0.15e-3, 0.2e-3)
    line = spiral.centre_line()
    r = np.hypot(*line.T)
    expected = np.sqrt(r[:-1] ** 2 + r[1:] ** 2 - 2 * r[:-1] * r[1:] * math.cos(2 * math.pi / sides))
    np.testing.assert_allclose(np.hypot(*np.diff(line, axis=0).T), expected, rtol=1e-12)  # rounding


ROUND = {
    "circle": RoundedSpiral(10e-3, 10e-3, 8, 0.1e-3, 0.1e-3, 5e-3),
    "racetrack": RoundedSpiral(20e-3, 10e-3, 8.5, 0.1e-3, 0.1e-3, 5e-3),
    "rectangle": RoundedSpiral(20e-3, 12e-3, 8, 0.1e-3, 0.1e-3),
    "rounded": RoundedSpiral(12e-3, 20e-3, 8.25, 0.1e-3, 0.1e-3, 3e-3),
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
    "spiral", [*ROUND.values(), Spiral(6, 8e-3, 5 + 1 / 6, 0.2e-3, 0.15e-3, 0.4)], ids=[*ROUND, "sharp"]
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
        plain, turned = (Spiral(sides, 6e-3, 4, 0.15e-3, 0.15e-3, first, winding) for first in (0.0, start))
    else:
        plain, turned = (
            RoundedSpiral(12e-3, 12e-3, 4, 0.15e-3, 0.15e-3, 3e-3, sides, first, winding) for first in (0.0, start)
        )
    c, s = math.cos(start), math.sin(start)
    expected = plain.centre_line(layer) @ np.array([[c, s], [-s, c]])
    # rounding of an angle of about 10 rad at a radius of at most 12 mm
    np.testing.assert_allclose(turned.centre_line(layer), expected, rtol=0, atol=1e-15 if sharp else 1e-14)


def test_size_across_flats_and_corners():
    for sides, across, apothem in ((6, "flats", 5.0), (6, "corners", 4.330127), (4, "corners", 3.535534)):
        assert apothem_from_size(10e-3, sides, across=across) * 1e3 == pytest.approx(apothem, abs=1e-6)  # digits given


def test_outline_has_the_given_sizes():
    outline = Spiral(6, apothem_from_size(23e-3, 6, across="corners"), 3, 0.1e-3, 0.1e-3).outline()
    assert np.hypot(*outline.T) == pytest.approx(11.5e-3, rel=1e-12)
    # points lie on and up to 0.9 µm outside the arcs, and enclose their area
    circle = RoundedSpiral(10e-3, 10e-3, 3, 0.1e-3, 0.1e-3, 5e-3).outline()
    assert np.hypot(*circle.T) == pytest.approx(5e-3, abs=0.9e-6)
    assert swept_area(np.vstack((circle, circle[:1]))) == pytest.approx(math.pi * 25e-6, rel=1e-9)


BAD = [0.0, -1e-3, math.nan, math.inf]


def test_sizes_and_turns_that_cannot_be():
    good = {"outer_apothem": 5e-3, "turns": 3, "trace_width": 1e-4, "gap": 1e-4}
    for name, value in product(good, BAD):
        refused(GeometryError, f"{name} must be positive and finite", Spiral, 6, **{**good, name: value})
    for sides in (2, 0, -6):
        refused(GeometryError, "sides must be at least 3", Spiral, sides, **good)
        refused(GeometryError, "sides must be at least 3", apothem_from_size, 1e-2, sides, across="flats")
    for corner in (math.nan, math.inf):
        refused(GeometryError, "first_corner must be finite", Spiral, 6, **good, first_corner=corner)
    refused(GeometryError, "winding must be 'ccw' or 'cw'; got 'left'", Spiral, 6, **good, winding="left")
    refused(GeometryError, "turns must be a multiple of 1/6", Spiral, 6, **{**good, "turns": 3.1})
    refused(GeometryError, r"30 turns .*; at most 24\.5 turns fit", Spiral, 6, 5.01e-3, 30, 1e-4, 1e-4)
    Spiral(6, 5.01e-3, 24.5, 1e-4, 1e-4)
    good = {"extent": 12e-3, "breadth": 10e-3, "turns": 3, "trace_width": 1e-4, "gap": 1e-4}
    for name, value in product(good, BAD):
        refused(GeometryError, f"{name} must be positive and finite", RoundedSpiral, **{**good, name: value})
    refused(GeometryError, "must be equal for 6 sides", RoundedSpiral, **good, sides=6)
    for radius in (-1e-3, 5.1e-3, math.nan):
        refused(GeometryError, "corner_radius must be 0 to 5 mm", RoundedSpiral, **good, corner_radius=radius)
    refused(GeometryError, "turns must be a multiple of 1/4", RoundedSpiral, **{**good, "turns": 3.1})
    refused(
        GeometryError,
        r"30 turns .*; at most 24\.5 turns fit",
        RoundedSpiral,
        **{**good, "breadth": 10.02e-3, "turns": 30},
    )
    for size in BAD:
        refused(GeometryError, "size must be positive and finite", apothem_from_size, size, 6, across="corners")
    message = "across flats or corners; got 'diagonal'"
    refused(GeometryError, message, apothem_from_size, 1e-2, 6, across="diagonal")
