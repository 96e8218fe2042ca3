"""Arrays and stack-ups: lattice distances and colourings, the frame of the board, heights, every bad input."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.boards import FOUR_LAYERS, LEADS, VIA, many_layers, one_coil
from support.refusals import refused

import coilarray as ca
from coilarray.constants import RESISTIVITY_COPPER
from coilarray.errors import GeometryError
from coilarray.geometry import Array, Placement, Sheet, Spiral, Stackup, lattice, path_coil

COIL = path_coil([[(0, 0), (1e-2, 0)], [(1e-2, 0), (1e-2, 5e-3)]], 2e-4, 2e-4, VIA)


def neighbours(points, pitch):
    apart = np.hypot(*np.moveaxis(points[:, None] - points[None], -1, 0))
    return np.abs(apart - pitch) < 1e-9 * pitch  # rounding


@pytest.mark.parametrize(("kind", "inner", "edges"), [("linear", 2, 4), ("square", 4, 31), ("hexagonal", 6, 43)])
def test_lattice_neighbours_are_one_pitch_away(kind, inner, edges):
    rows = 1 if kind == "linear" else 4
    points, indices = lattice(kind, 3e-3, 5, rows, direction=0.7)
    near = neighbours(points, 3e-3)
    assert near.sum(axis=1).max() == inner
    assert near.sum() == 2 * edges  # 5 points, 4 steps; 5·3 + 4·4; 4·4 + 3·9
    apart = np.hypot(*np.moveaxis(points[:, None] - points[None], -1, 0))
    assert apart[~np.eye(len(points), dtype=bool)].min() == pytest.approx(3e-3, rel=1e-9)
    assert len(np.unique(indices, axis=0)) == len(points)


def test_neighbours_of_an_array_are_the_nearest_pairs():
    """Of two columns one unit apart in rows of one and a half: only those in a row."""
    places = tuple(
        Placement(f"c{k}", COIL, ("L1", "L2"), x, y) for k, (x, y) in enumerate([(0, 0), (1, 0), (0, 1.5), (1, 1.5)])
    )
    assert Array(many_layers(2), places).neighbours == ((0, 1), (2, 3))
    assert Array(many_layers(2), places[:1]).neighbours == ()


def test_colours_keep_neighbours_apart():
    points, indices = lattice("hexagonal", 1.0, 6, 5)
    colour = (indices[:, 0] - indices[:, 1]) % 3
    i, j = np.nonzero(neighbours(points, 1.0))
    assert (colour[i] != colour[j]).all()
    steps = {tuple(step) for step in (indices[j] - indices[i]).tolist()}
    assert steps == {(1, 0), (-1, 0), (0, 1), (0, -1), (1, -1), (-1, 1)}
    rings, indices = lattice("rings", 1.0, rings=2)
    i, j = np.nonzero(neighbours(rings, 1.0))
    assert len(i) == 2 * 42  # 6 spokes, 6 around the first ring, 6 · 3 to the second, 12 around it
    assert ((indices[:, 0] - indices[:, 1])[i] % 3 != (indices[:, 0] - indices[:, 1])[j] % 3).all()
    np.testing.assert_allclose(rings[[0, 1, 7]], [[0, 0], [1, 0], [2, 0]], atol=1e-15)  # centre, then ring by ring
    assert lattice("single")[0].tolist() == [[0, 0]]
    triangle, indices = lattice("triangle", 1.0, 3)
    i, j = np.nonzero(neighbours(triangle, 1.0))
    assert (len(triangle), len(i)) == (6, 2 * 9)  # three by three sides
    assert ((indices[:, 0] - indices[:, 1])[i] % 3 != (indices[:, 0] - indices[:, 1])[j] % 3).all()
    points, indices = lattice("square", 1.0, 4, 3)
    i, j = np.nonzero(neighbours(points, 1.0))
    assert (indices.sum(axis=1)[i] % 2 != indices.sum(axis=1)[j] % 2).all()


@given(direction=st.floats(-7, 7), kind=st.sampled_from(["square", "hexagonal"]))
def test_direction_only_rotates_about_the_origin(direction, kind):
    plain, _ = lattice(kind, 1.0, 3, 4)
    turned, _ = lattice(kind, 1.0, 3, 4, direction=direction)
    c, s = math.cos(direction), math.sin(direction)
    np.testing.assert_allclose(turned, plain @ np.array([[c, s], [-s, c]]), atol=1e-14)  # rounding
    np.testing.assert_allclose(0.5 * (plain.min(axis=0) + plain.max(axis=0)), 0, atol=1e-15)


def test_lattices_and_sheets_that_cannot_be():
    for pitch in (0.0, -1.0, math.nan, math.inf):
        refused(GeometryError, "pitch must be positive and finite", lattice, "square", pitch, 2, 2)
    refused(GeometryError, "columns and rows must be at least 1; got 0 and 1", lattice, "linear", 1.0, 0)
    refused(GeometryError, "a linear lattice takes one row; got 2", lattice, "linear", 1.0, 2, 2)
    refused(GeometryError, "more than one coil must have a pitch", lattice, "square", None, 2)
    refused(GeometryError, "of kind rings has no rows and columns; got 1 and 2", lattice, "rings", 1.0, 2, rings=1)
    refused(GeometryError, "at least one ring, any other none; got 0 for rings", lattice, "rings", 1.0)
    message = "lattice must be single, linear, square, hexagonal, triangle or rings; got 'round'"
    refused(GeometryError, message, lattice, "round", 1.0, 2, 2)
    for value in (0.0, -1e-3, math.nan, math.inf):
        refused(GeometryError, "thickness of sheet 'base' must be positive and finite", Sheet, "base", value)
    for mu in (0.5, math.nan, math.inf):
        refused(GeometryError, "relative permeability of sheet 'base' must be at least 1", Sheet, "base", 1e-3, mu)


def test_a_placement_turns_and_moves_and_bounds_hold_all_copper():
    placement = Placement("A", COIL, ("L1", "L2"), 1e-3, 2e-3, math.pi / 2)
    moved = placement.to_board(np.array([[1e-2, 0.0], [0.0, 0.0]]))
    np.testing.assert_allclose(moved, [[1e-3, 12e-3], [1e-3, 2e-3]], atol=1e-17)  # rounding of cos 90°
    array = Array(FOUR_LAYERS, (Placement("A", COIL, ("L1", "L2"), 0, 0),), board_margin=1e-3)
    # the path reaches from (0, 0) to (10, 5) mm, its trace by 0.1 mm more, its via pad at (10, 0) by 0.225 mm
    np.testing.assert_allclose(np.array(array.bounds) * 1e3, [-1.1, -1.225, 11.225, 6.1], rtol=1e-12)


def test_conductor_follows_the_layers_and_the_vias():
    array = one_coil(Spiral(6, 16e-3, 10, 0.12e-3, 0.13e-3, layers=4).coil())
    coil, (wire,) = array.placements[0].coil, array.conductors()
    vertical = np.hypot(*np.diff(wire.vertices[:, :2], axis=0).T) == 0
    assert vertical.sum() == 3
    np.testing.assert_allclose(wire.lengths[vertical], 0.2e-3 + 35e-6, rtol=1e-9)  # dielectric and two half layers
    np.testing.assert_allclose(wire.areas[vertical], VIA.barrel_area)
    np.testing.assert_allclose(wire.areas[~vertical], coil.trace_width * 35e-6)
    in_plane = sum(float(np.hypot(*np.diff(line, axis=0).T).sum()) for line in coil.lines)
    assert wire.lengths[~vertical].sum() == pytest.approx(in_plane, rel=1e-12)
    np.testing.assert_allclose(wire.vertices[[0, -1], :2], coil.terminal_points, atol=1e-18)


def test_placements_and_arrays_that_cannot_be():
    for key, value in product(("x", "y", "rotation"), (math.nan, math.inf)):
        place = {"x": 0.0, "y": 0.0, key: value}
        refused(GeometryError, "position of A must be finite", Placement, "A", COIL, ("L1", "L2"), **place)
    message = "layers of .* must be 2, as its shape has 2 lines_mm; got 1"
    refused(GeometryError, message, Placement, "A", COIL, ("L1",), 0, 0)
    message = "lines 0 and 1 of A are joined by a via and must lie on different copper layers; got L1"
    refused(GeometryError, message, Placement, "A", COIL, ("L1", "L1"), 0, 0)
    placement, unknown = (Placement("A", COIL, ("L1", last), 0, 0) for last in ("L2", "top"))
    refused(GeometryError, "at least one coil", Array, FOUR_LAYERS, ())
    refused(GeometryError, "coil names must differ; got A, A", Array, FOUR_LAYERS, (placement, placement))
    message = "there is no copper layer 'top'; the stack-up has L1, L2, L3, L4"
    refused(GeometryError, message, Array, FOUR_LAYERS, (unknown,))
    for margin in (-1e-3, math.nan, math.inf):
        message = "board_margin must be finite and not negative"
        refused(GeometryError, message, Array, FOUR_LAYERS, (placement,), board_margin=margin)


def test_heights_run_down_from_the_top_face():
    assert FOUR_LAYERS.thickness == pytest.approx(4 * 35e-6 + 3 * 0.215e-3, rel=1e-12)
    assert FOUR_LAYERS.span("L1") == pytest.approx((-35e-6, 0.0))
    assert FOUR_LAYERS.span("L4")[0] == pytest.approx(-FOUR_LAYERS.thickness, rel=1e-12)
    assert FOUR_LAYERS.centre("L2") == pytest.approx(-(35e-6 + 0.215e-3 + 17.5e-6), rel=1e-12)
    assert FOUR_LAYERS.between("L4", "L2") == ("L2", "L3", "L4")
    assert many_layers(1).thickness == 35e-6


def test_stackups_that_cannot_be():
    for change, message in (
        ({"names": (), "copper_thickness": ()}, "at least one copper layer"),
        ({"names": ("L1", "L1")}, "names must differ; got L1, L1"),
        ({"copper_thickness": (35e-6,)}, "2 copper layers need 2 copper thicknesses; got 1"),
        ({"dielectric_thickness": ()}, "need 1 dielectric thicknesses; got 0"),
        ({"epsilon_r": (4.5, 4.5)}, "need 1 dielectric permittivities; got 2"),
        ({"copper_thickness": (35e-6, 0.0)}, "layer thickness must be positive and finite; got 0"),
        ({"dielectric_thickness": (math.nan,)}, "layer thickness must be positive and finite; got nan"),
        ({"epsilon_r": (0.5,)}, "relative permittivity must be at least 1; got 0.5"),
        ({"epsilon_r": (math.nan,)}, "relative permittivity must be at least 1; got nan"),
    ):
        good = {"names": ("L1", "L2"), "copper_thickness": (35e-6, 35e-6)}
        good |= {"dielectric_thickness": (0.2e-3,), "epsilon_r": (4.5,)}
        refused(GeometryError, message, Stackup, **{**good, **change})


def test_the_middle_coil_is_that_of_the_board_not_of_the_list():
    flower = [(0.0, 0.0), *((math.cos(k * math.pi / 3), math.sin(k * math.pi / 3)) for k in range(6))]
    places = tuple(
        Placement(f"coil{k}", COIL, ("L1", "L2"), 50e-3 * x, 50e-3 * y) for k, (x, y) in enumerate(flower, start=1)
    )
    array = Array(FOUR_LAYERS, places)
    assert array.middle_coil == "coil1"
    assert Array(FOUR_LAYERS, places[1:]).middle_coil == "coil2"  # all as near: the first one
    x_min, y_min, x_max, y_max = array.outline_bounds
    outline = COIL.outline
    np.testing.assert_allclose((x_min, x_max), (-50e-3 + outline[:, 0].min(), 50e-3 + outline[:, 0].max()))
    assert array.bounds[1] <= y_min < y_max <= array.bounds[3]


SPIRAL = ca.Spiral(sides=6, diameter=16e-3, turns=12, width=0.15e-3, gap=0.15e-3)
ROW = ca.Array.row(SPIRAL, 3, pitch=11e-3)
POINTS = np.array([[0.0, 0.0, 1e-3], [3e-3, -2e-3, 2e-3]])


def test_a_spiral_and_its_coil_answer_alike():
    (path,) = ROW.conductors()[:1]
    for one in (SPIRAL, SPIRAL.coil(), ca.RoundedSpiral(16e-3, 16e-3, 12, 0.15e-3, 0.15e-3, sides=6)):
        assert one.inductance == float(ca.self_inductance(one)[0]) == float(ca.self_inductance(one.conductors())[0])
        assert one.resistance == float(ca.dc_resistance(one)[0])
        np.testing.assert_array_equal(one.field(POINTS, 2.0), ca.magnetic_field(one, POINTS, 2.0))
    assert SPIRAL.inductance == SPIRAL.coil().inductance
    # ρ Σ l / A of the bars
    assert SPIRAL.resistance == pytest.approx(RESISTIVITY_COPPER * (path.lengths / path.areas).sum(), rel=1e-12)


def test_an_array_answers_as_the_functions():
    L = ca.inductance_matrix(ROW.conductors())
    np.testing.assert_array_equal(ROW.inductance, L)
    np.testing.assert_array_equal(ROW.coupling, ca.coupling_matrix(L))
    np.testing.assert_array_equal(ROW.resistance, ca.dc_resistance(ROW))
    np.testing.assert_array_equal(ROW.field(POINTS, [1, 0, -2]), ca.magnetic_field(ROW, POINTS, [1, 0, -2]))
    assert ROW.coupling.dims == ("coil", "other")
    assert float(ROW.coupling.sel(coil="coil1", other="coil3")) == ROW.coupling[0, 2]
    # every coil of the row is the coil alone, to rounding of the place
    np.testing.assert_allclose(np.diag(ROW.inductance), SPIRAL.inductance, rtol=1e-9)


def test_every_kind_of_source():
    design = ca.Design(ROW)
    for source in (ROW, design, list(ROW.conductors()), [ROW]):
        np.testing.assert_array_equal(ca.inductance_matrix(source), ROW.inductance)
    np.testing.assert_array_equal(ca.couple_design(ROW).inductance, ca.couple_design(design).inductance)
    np.testing.assert_array_equal(ca.inductance_matrix([SPIRAL]), [[SPIRAL.inductance]])
    for nothing in (5, None, "gast2020", [None], [], [SPIRAL, 5]):
        refused(ca.errors.GeometryError, "path", ca.self_inductance, nothing)


def test_coils_that_overlap_have_layers_of_their_own():
    assert [place.layers for place in ROW.placements] == [("L1", "L2"), ("L3", "L4"), ("L1", "L2")]
    assert ROW.stackup.thickness == pytest.approx(1.6e-3)
    assert all(margin.margin >= 0 for margin in ca.check_rules(ROW, ca.FabRules()) if margin.rule == "clearance")
    side_by_side = ca.Array.row(SPIRAL, 3, pitch=16.2e-3)  # more than the gap apart
    assert side_by_side.stackup.names == ("L1", "L2")
    assert len(ca.Array.row(SPIRAL, 5, pitch=5e-3).stackup.names) == 8
    assert len(ca.Array.row(replace(SPIRAL, layers=4), 2, pitch=11e-3).stackup.names) == 8
    two = ca.Stackup.uniform(("top", "bottom"))
    assert ca.Array.row(replace(SPIRAL, stackup=two), 2, pitch=20e-3).stackup == two
    message = "need 4 copper layers, as 2 neighbours overlap; .* has 2"
    refused(ca.errors.GeometryError, message, ca.Array.row, SPIRAL, 2, 11e-3, stackup=two)
    refused(ca.errors.GeometryError, "pitch must be positive", ca.Array.row, SPIRAL, 2, 0.0)


def test_the_usual_construction():
    assert (SPIRAL.via, SPIRAL.leads) == (VIA, LEADS)
    assert SPIRAL.first_corner == pytest.approx(np.pi / 2)
    for sides in range(3, 13):  # a side faces the neighbour of a row
        outline = ca.Spiral(sides, 16e-3, 2, 0.15e-3, 0.15e-3).outline()
        assert np.sort(outline[:, 0])[-2:] == pytest.approx(8e-3, rel=1e-12)
    assert ca.Placement("A", SPIRAL, ("L1", "L2"), 0, 0).coil is SPIRAL.coil()
