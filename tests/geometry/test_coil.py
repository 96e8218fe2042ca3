"""Coils: layers in series meet at their vias, the current keeps its sense, pads stand clear, bad input is refused.

Clearances of whole coils are measured in test_geometry_rules.py by an independent route.
"""

import math
import re
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from support.boards import LEADS, VIA, swept_area
from support.refusals import refused

from coilarray.errors import GeometryError
from coilarray.geometry import Coil, Leads, PlatedHole, Spiral, path_coil

SPIRAL = Spiral(6, 16e-3, 10, 0.12e-3, 0.13e-3, 0.3)


@pytest.mark.parametrize("winding", ["ccw", "cw"])
@pytest.mark.parametrize("turns", [10, 10 + 1 / 6])
@pytest.mark.parametrize("layers", [1, 2, 3, 4, 5, 6])
def test_layers_in_series_meet_and_add_their_turns(layers, turns, winding):
    spiral = Spiral(6, 16e-3, turns, 0.12e-3, 0.13e-3, 0.3, winding=winding)
    coil = replace(spiral, layers=layers, leads=None).coil()
    assert (len(coil.lines), coil.via_points.shape) == (layers, (layers - 1, 2))
    for line, following in pairwise(coil.lines):
        np.testing.assert_array_equal(line[-1], following[0])
    sense = 1 if winding == "ccw" else -1
    total = sum(swept_area(line) for line in coil.lines)
    alone = sum(swept_area(spiral.centre_line(layer)) for layer in range(layers))
    # stubs leave the ray of their corner only in a fan, where they sweep far less than one turn
    assert sense * total == pytest.approx(sense * alone, rel=2e-3)
    assert sense * total > 0


def test_leads_and_what_stands_at_their_ends():
    coil = SPIRAL.coil()
    first, second = coil.terminal_points
    corner = SPIRAL.centre_line()[0]
    radial = corner / np.hypot(*corner)
    assert np.hypot(*(first - second)) == pytest.approx(LEADS.spacing, rel=1e-9)  # rounding
    assert (coil.terminal_points - corner) @ radial == pytest.approx(LEADS.length, rel=1e-9)
    # a return lead brings an odd coil out again
    for layers in (1, 3):
        coil = replace(SPIRAL, layers=layers, return_lead=True).coil()
        assert len(coil.lines) == layers + 1
        np.testing.assert_array_equal(coil.lines[-2][-1], coil.lines[-1][0])
        first, second = coil.terminal_points
        assert np.hypot(*(first - second)) == pytest.approx(LEADS.spacing, rel=1e-9)  # rounding
    # without it the coil ends at an inner terminal
    coil = replace(SPIRAL, layers=1).coil()
    assert np.hypot(*coil.terminal_points[1]) < np.hypot(*SPIRAL.centre_line()[-1]) - LEADS.terminal.pad / 2
    bare = replace(SPIRAL, layers=1, leads=None).coil()
    assert bare.terminal is None
    np.testing.assert_array_equal(bare.lines[0], SPIRAL.centre_line())


def test_an_inner_via_clears_both_sides_of_its_corner_by_the_gap():
    coil = replace(SPIRAL, leads=None).coil()
    via = coil.via_points[0]
    line = SPIRAL.centre_line()[-7:]
    a, step = line[:-1], np.diff(line, axis=0)
    t = np.clip(((via - a) * step).sum(axis=1) / (step**2).sum(axis=1), 0, 1)
    distance = np.hypot(*(a + t[:, None] * step - via).T).min()
    needed = VIA.pad / 2 + SPIRAL.gap + SPIRAL.width / 2
    # nearest place on a grid of 1/2000 of the inner radius
    assert needed <= distance <= needed + np.hypot(*line[-1]) / 2000


def test_hole_dimensions():
    hole = PlatedHole(0.3e-3, 0.6e-3, 20e-6)
    assert hole.barrel_area == pytest.approx(math.pi * (0.15e-3**2 - 0.13e-3**2), rel=1e-12)  # rounding
    # ln GMD of a square of side a is ln a + ln(2)/3 + π/3 − 25/12 (Grover 1946, ch. 3), that of a tube its radius
    gmd_of_unit_square = math.exp(math.log(2) / 3 + math.pi / 3 - 25 / 12)
    assert hole.bar_width * gmd_of_unit_square == pytest.approx(0.15e-3, rel=1e-9)  # digits of the constant


BAD = [0.0, -1e-3, math.nan, math.inf]


def test_holes_and_leads_that_cannot_be():
    sizes = {"drill": 0.2e-3, "pad": 0.5e-3, "plating": 20e-6}
    for name, value in product(sizes, BAD):
        refused(GeometryError, f"{name} of a hole must be positive and finite", PlatedHole, **{**sizes, name: value})
    refused(GeometryError, "pad of a hole must be larger than its drill", PlatedHole, 0.5e-3, 0.5e-3)
    refused(GeometryError, "plating must be below half the drill", PlatedHole, 0.2e-3, 0.5e-3, 0.1e-3)
    sizes = {"length": 2e-3, "spacing": 1e-3, "terminal": VIA}
    for name, value in product(("length", "spacing"), BAD):
        refused(GeometryError, f"{name} of the leads must be positive and finite", Leads, **{**sizes, name: value})
    refused(GeometryError, "at least half their spacing", Leads, 0.4e-3, 1e-3, VIA)
    straight = replace(SPIRAL, leads=Leads(1e-3, 2e-3, VIA)).coil()  # the knee is the terminal
    assert np.hypot(*np.diff(straight.terminal_points, axis=0)[0]) == pytest.approx(2e-3, rel=1e-9)


def test_windings_that_cannot_be():
    for layers in (0, -1, 2.5, "2"):
        refused(GeometryError, "layers must be a whole number of at least 1; got", replace, SPIRAL, layers=layers)
    message = "return_lead of a coil's shape needs leads and an odd number of winding layers .* got 2 with leads"
    refused(GeometryError, message, replace(SPIRAL, return_lead=True).coil)
    refused(GeometryError, "got 1 without leads", replace(SPIRAL, layers=1, leads=None, return_lead=True).coil)
    message = r"no room for a pad of 0\.45 mm inside the winding"
    refused(GeometryError, message, Spiral(6, 6e-3, 14, 0.1e-3, 0.1e-3, leads=None).coil)
    narrow, wide = Leads(2e-3, 0.6e-3, PlatedHole(0.2e-3, 0.45e-3)), PlatedHole(0.2e-3, 1.45e-3)
    message = r"no room for a pad of 1\.45 mm outside the winding, beside the leads; leads\.spacing_mm of (.*) makes it"
    with pytest.raises(GeometryError, match=message) as error:
        replace(SPIRAL, layers=4, via=wide, leads=narrow).coil()
    fitting = float(re.search(message, str(error.value))[1]) * 1e-3
    assert replace(SPIRAL, layers=4, via=wide, leads=replace(narrow, spacing=fitting)).coil().via_points.shape == (3, 2)


LINE = [(0, 0), (1e-2, 0)]


def test_paths_that_cannot_be():
    for lines, message in (
        ([], "at least one line; got none"),
        ([[]], r"shape \(n >= 2, 2\)"),
        ([[(0, 0)]], r"shape \(n >= 2, 2\); got \(1, 2\)"),
        ([[(0, 0, 0), (1, 0, 0)]], r"shape \(n >= 2, 2\); got \(2, 3\)"),
        ([["a", "b"]], "must be numbers"),
        ([[(0, 0), (1,)]], "must be numbers"),
        ([[(0, 0), (math.nan, 0)]], "not finite"),
        ([[(0, 0), (math.inf, 0)]], "not finite"),
        ([[(0, 0), (1e-2, 0), (1e-2, 0)]], "repeats a point"),
        ([[(0, 0), (1e-2, 0), (1e-2, 1e-2), (5e-3, -1e-2)]], r"segments 0 and 2 meet at \(7\.5, 0\) mm"),
        ([[(0, 0), (1e-2, 0), (5e-3, 0)]], "crosses itself: segments 0 and 1"),
        ([[(0, 0), (1e-2, 0), (1e-2, 1e-2), (0, 0)]], "closes at"),
        ([LINE, LINE], "line 1 of a coil must begin where line 0 ends; they are 10 mm apart"),
    ):
        refused(GeometryError, message, path_coil, lines, 1e-4, 1e-4, VIA)


def test_path_coils_keep_their_lines_and_sizes():
    coil = path_coil([LINE], 1e-4, 1e-4, VIA)
    assert isinstance(coil, Coil)
    np.testing.assert_array_equal(coil.lines[0], LINE)
    for array in (coil.lines[0][0], coil.widths[0]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    for value in BAD:
        refused(GeometryError, "trace_width must be positive", path_coil, [LINE], value, 1e-4, VIA)
        refused(GeometryError, "gap must be positive and finite", path_coil, [LINE], 1e-4, value, VIA)


@pytest.mark.parametrize("layers", [2, 4, 6])
@pytest.mark.parametrize("angle", np.radians([17.3, 30.0, 90.0]).tolist())
def test_holes_turn_and_mirror_with_the_coil(layers, angle):
    """A pad that just fits beside a lead does so at any angle: rounding decides nothing."""
    leads = Leads(4e-3, 1.5e-3, PlatedHole(0.5e-3, 1e-3))

    def wound(**turned):
        more = {"first_corner": 0.0, "layers": layers, "leads": leads, **turned}
        via = PlatedHole(0.2e-3, 0.6e-3 if layers == 4 else 0.4e-3)
        return Spiral(6, 1.5e-3 * layers, 2, 0.3e-3, 0.3e-3, via=via, **more).coil()

    c, s = np.cos(angle), np.sin(angle)
    rounding = 1e-15  # m
    changed = wound(), wound(first_corner=angle), wound(winding="cw")
    for line, turned, mirrored in zip(*(coil.lines for coil in changed), strict=True):
        np.testing.assert_allclose(turned, line @ np.array([[c, s], [-s, c]]), rtol=0, atol=rounding)
        np.testing.assert_allclose(mirrored, line * [1, -1], rtol=0, atol=rounding)
