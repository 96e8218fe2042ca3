"""Net check: connected pieces against a union, and every kind of fault made on purpose."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from support.boards import VIA, many_layers, one_coil, reference_board, stroked
from support.refusals import refused

from coilarray.errors import GeometryError
from coilarray.fabrication.nets import Barrel, NetFault, check_nets, connected_pieces
from coilarray.geometry import Array, Placement, PlatedHole, Spiral, copper_by_layer, drills, path_coil

Layers = dict[str, list[shapely.geometry.base.BaseGeometry]]

# from A's outermost turn, centred at x = −1.3 mm, to B's at 1.15 mm
BRIDGE = shapely.box(-1.35e-3, 0.2e-3, 1.15e-3, 0.3e-3)


def design_copper(array: Array) -> tuple[Layers, list[Barrel]]:
    """The design's own mitred outlines and holes."""
    layers = {layer: list(nets.values()) for layer, nets in copper_by_layer(array).items()}
    holes = [Barrel(h.x, h.y, h.diameter, h.layers) for h in drills(array) if len(h.layers) > 1]
    return layers, holes


def stroked_copper(array: Array) -> tuple[Layers, list[Barrel]]:
    """What round apertures draw: one piece a segment."""
    return {layer: stroked(array, layer) for layer in array.stackup.names}, design_copper(array)[1]


# Two small coils beside each other on L1 and L2 of four layers, vias through the board; and with blind holes.
SQUARE = Spiral(4, 6e-3, 4, 0.2e-3, 0.2e-3, first_corner=0.75 * np.pi).coil()
A, B = Placement("A", SQUARE, ("L1", "L2"), -4e-3, 0), Placement("B", SQUARE, ("L1", "L2"), 4e-3, 0)
TWO = Array(many_layers(4), (A, B))
BLIND = replace(TWO, through_holes=False)
LAYERS, HOLES = design_copper(TWO)
BLIND_LAYERS, BLIND_HOLES = design_copper(BLIND)


def without(layers: Layers, layer: str, shape: shapely.geometry.base.BaseGeometry) -> Layers:
    return {**layers, layer: [part - shape for part in layers[layer]]}


def having(layers: Layers, layer: str, shape: shapely.geometry.base.BaseGeometry) -> Layers:
    return {**layers, layer: [*layers[layer], shape]}


def point_on(coil: int, line: int, fraction: float) -> np.ndarray:
    placement = TWO.placements[coil]
    way = shapely.LineString(placement.to_board(placement.coil.lines[line]))
    return shapely.get_coordinates(way.interpolate(fraction, normalized=True))[0]


def faults(check: tuple[NetFault, ...]) -> list[tuple[str, tuple[str, ...], str]]:
    return [(fault.kind, fault.coils, fault.layer) for fault in check]


def crossing(array: Array, one: tuple[str, str], other: tuple[str, str]) -> shapely.Point:
    """Place where two coils, each given with its layer, lie above each other."""
    both = shapely.intersection(*(copper_by_layer(array)[layer][net] for layer, net in (one, other)))
    return max(shapely.get_parts(both), key=shapely.area).representative_point()


@given(st.lists(st.tuples(*[st.integers(0, 12)] * 2, *[st.integers(1, 4)] * 2), min_size=1, max_size=12))
@settings(max_examples=60)
def test_pieces_of_one_layer_are_the_parts_of_the_union(boxes: list[tuple[int, int, int, int]]) -> None:
    # on a grid of 1 mm, turned by 0.3 rad so that no edges lie on one another; corners that touch are left out
    c, s = 1e-3 * np.cos(0.3), 1e-3 * np.sin(0.3)
    upright = [shapely.box(x, y, x + w + 0.3, y + h + 0.3) for x, y, w, h in boxes]
    shapes = [shapely.affinity.affine_transform(box, (c, -s, s, c, 0, 0)) for box in upright]
    parts = sorted(part.area for part in shapely.get_parts(shapely.union_all(shapes)))
    assert sorted(piece["L1"].area for piece in connected_pieces({"L1": shapes}, [])) == pytest.approx(parts)


def test_a_hole_joins_only_the_layers_it_names_and_only_copper_at_its_wall() -> None:
    square = shapely.box(-1e-3, -1e-3, 1e-3, 1e-3)
    layers = {"L1": [square], "L2": [square], "L3": [square]}
    assert len(connected_pieces(layers, [Barrel(0, 0, 3e-4, ("L1", "L3"))])) == 2
    for radius, count in ((1.5e-4, 1), (2.5e-4, 2)):  # in the wider opening the barrel stands free
        ring = square - shapely.Point(0, 0).buffer(radius, quad_segs=32)
        assert len(connected_pieces({"L1": [ring], "L2": [square]}, [Barrel(0, 0, 3e-4, ("L1", "L2"))])) == count


def test_designs_and_boards_as_they_are_made_pass() -> None:
    array = reference_board(turns=10)
    assert check_nets(array, *design_copper(array)) == ()
    # drilled pads
    bores = shapely.union_all([shapely.Point(h.x, h.y).buffer(h.drill / 2) for h in HOLES])
    assert check_nets(TWO, {layer: [part - bores for part in parts] for layer, parts in LAYERS.items()}, HOLES) == ()
    # mitred and with round strokes; sharp corners, widths that change and layers used twice
    lines = [[(0, 0), (4e-3, 0), (0, 0.9e-3)], [(0, 0.9e-3), (0, 3e-3)], [(0, 3e-3), (4e-3, 3e-3)]]
    coil = path_coil(lines, [[3e-4, 2e-4], [2e-4], [5e-4]], 2e-4, VIA, PlatedHole(5e-4, 1e-3))
    varied = Array(many_layers(2), (Placement("A", coil, ("L1", "L2", "L1"), 0, 0),))
    for array, copper in product((TWO, BLIND, varied), (design_copper, stroked_copper)):
        assert check_nets(array, *copper(array)) == ()


def test_missing_vias_terminals_and_layers() -> None:
    via = next(hole for hole in drills(TWO) if hole.net == "B" and hole.kind == "via")
    check = check_nets(TWO, LAYERS, [h for h in HOLES if (h.x, h.y) != (via.x, via.y)])
    assert faults(check) == [("cut", ("B",), "L2")]
    (fault,) = check
    assert (fault.x, fault.y) == pytest.approx((via.x, via.y))
    place = f"({round(via.x * 1e3, 3):g}, {round(via.y * 1e3, 3):g}) mm"
    assert "terminal 2 of B" in fault.text
    assert fault.text.endswith(f"nothing joins L1 and L2 at {place}")
    # a terminal without copper
    bare = shapely.Point(A.to_board(SQUARE.terminal_points)[0]).buffer(0.6e-3)
    check = check_nets(TWO, {layer: [part - bare for part in parts] for layer, parts in LAYERS.items()}, HOLES)
    assert faults(check) == [("cut", ("A",), "L1")]
    assert check[0].text.startswith("terminal 1 of A has no copper on L1 at (")
    # a whole layer
    check = check_nets(TWO, {layer: parts for layer, parts in LAYERS.items() if layer != "L2"}, HOLES)
    assert faults(check) == [("cut", ("A",), "L2"), ("cut", ("B",), "L2")]
    assert all("nothing joins L1 and L2" in fault.text for fault in check)
    assert faults(check_nets(TWO, {}, [])) == [("cut", ("A",), "L1"), ("cut", ("B",), "L1")]  # no copper at all


@pytest.mark.slow
@given(coil=st.integers(0, 1), line=st.integers(0, 1), fraction=st.floats(0.1, 0.9))
@settings(max_examples=15)
def test_a_cut_track_is_found_where_it_is(coil: int, line: int, fraction: float) -> None:
    place, layer = point_on(coil, line, fraction), ("L1", "L2")[line]
    # wide enough for a mitred corner, 0.14 mm from the centre line; the next turn begins 0.3 mm from it
    check = check_nets(TWO, without(LAYERS, layer, shapely.Point(place).buffer(0.17e-3)), HOLES)
    assert faults(check) == [("cut", (TWO.names[coil],), layer)]
    (fault,) = check
    # the near side of the cut: its radius away, around a corner up to √2 of it
    assert np.hypot(fault.x - place[0], fault.y - place[1]) < 0.25e-3
    assert "its copper ends on" in fault.text


def test_bridges_between_coils() -> None:
    check = check_nets(TWO, having(LAYERS, "L1", BRIDGE), HOLES)
    assert faults(check) == [("bridge", ("A", "B"), "L1")]
    (fault,) = check
    assert BRIDGE.contains(shapely.Point(fault.x, fault.y))
    assert fault.text.startswith("A and B are joined on L1 at (")
    # three coils in a row
    three = TWO.with_placements([A, B, replace(B, name="C", x=12e-3)])
    layers, holes = design_copper(three)
    for x in (0.0, 8e-3):
        layers = having(layers, "L1", shapely.affinity.translate(BRIDGE, x))
    assert faults(check_nets(three, layers, holes)) == [("bridge", ("A", "B", "C"), "L1")]
    # coils that overlap in the design
    crowded = TWO.with_placements([A, replace(B, x=A.x + 5.9e-3)])
    check = check_nets(crowded, *design_copper(crowded))
    assert {fault.kind for fault in check} == {"bridge"}
    a, b = (shapely.box(*copper.bounds) for copper in copper_by_layer(crowded)["L1"].values())
    assert all((a & b).buffer(1e-5).contains(shapely.Point(fault.x, fault.y)) for fault in check)


def test_coils_joined_by_way_of_other_layers() -> None:
    stacked = TWO.with_placements([A, replace(B, x=A.x + 4.5e-3, layers=("L3", "L4"))])
    layers, holes = design_copper(stacked)
    assert check_nets(stacked, layers, holes) == ()
    place = crossing(stacked, ("L2", "A"), ("L3", "B"))
    check = check_nets(stacked, layers, [*holes, Barrel(place.x, place.y, 1e-4, ("L2", "L3"))])
    assert faults(check) == [("bridge", ("A", "B"), "L2"), ("foreign", (), "L2")]
    assert check[0].text.startswith("A and B are joined on L2 at (")
    assert "the design has no plated hole of 0.1 mm through L2, L3 at (" in check[1].text
    # over a layer that neither coil uses
    ends = [point_on(coil, 0, 0.5) for coil in (0, 1)]
    layers = having(BLIND_LAYERS, "L3", shapely.LineString(ends).buffer(1e-4))
    check = check_nets(BLIND, layers, [*BLIND_HOLES, *(Barrel(*end, 1e-4, ("L1", "L3")) for end in ends)])
    assert [fault[:2] for fault in faults(check)] == [("bridge", ("A", "B")), ("foreign", ()), ("foreign", ())]


def test_foreign_copper_and_holes() -> None:
    short = shapely.box(1.1e-3, 0.1e-3, 1.6e-3, 0.2e-3)  # from B's outermost turn to the next
    check = check_nets(TWO, having(LAYERS, "L1", short), HOLES)
    assert faults(check) == [("foreign", ("B",), "L1")]
    (fault,) = check
    assert short.contains(shapely.Point(fault.x, fault.y))
    assert fault.text.endswith("where B has some")
    # a via too many within a coil
    place = crossing(TWO, ("L1", "A"), ("L2", "A"))
    check = check_nets(TWO, LAYERS, [*HOLES, Barrel(place.x, place.y, 1e-4, ("L1", "L2"))])
    assert faults(check) == [("foreign", (), "L1")]
    # copper beside the coils
    check = check_nets(TWO, having(LAYERS, "L3", shapely.box(-1e-4, -5e-3, 1e-4, -4.8e-3)), HOLES)
    assert faults(check) == [("foreign", (), "L3")]
    assert check[0].text == "the design has no copper on L3 at (0, −4.9) mm"
    # a hole where a terminal is a mere pad
    pad = next(hole for hole in drills(BLIND) if not hole.drilled)
    check = check_nets(BLIND, BLIND_LAYERS, [*BLIND_HOLES, Barrel(pad.x, pad.y, pad.diameter, pad.layers)])
    assert faults(check) == [("foreign", (), pad.layers[0])]
    # a blind hole that goes too deep is another hole
    deeper = [replace(hole, layers=("L1", "L2", "L3")) for hole in BLIND_HOLES]
    kinds = [(fault.kind, fault.coils) for fault in check_nets(BLIND, BLIND_LAYERS, deeper)]
    assert kinds == [("missing", ("A",)), ("missing", ("B",)), ("foreign", ()), ("foreign", ())]


def test_missing_holes_pads_and_copper() -> None:
    terminal = next(hole for hole in drills(TWO) if hole.net == "A" and hole.kind == "terminal")
    check = check_nets(TWO, LAYERS, [h for h in HOLES if (h.x, h.y) != (terminal.x, terminal.y)])
    assert faults(check) == [("missing", ("A",), "L1")]
    assert "the plated hole of A at" in check[0].text
    pad = shapely.Point(terminal.x, terminal.y).buffer(0.6e-3)
    assert faults(check_nets(TWO, without(LAYERS, "L4", pad), HOLES)) == [("missing", ("A",), "L4")]
    # a neck in a trace
    neck = shapely.Point(point_on(0, 0, 0.5) + 0.1e-3).buffer(0.08e-3)
    assert faults(check_nets(TWO, without(LAYERS, "L1", neck), HOLES)) == [("missing", ("A",), "L1")]
    # a board of one layer has its holes
    line = [(0, 0), (5e-3, 0), (5e-3, 5e-3)]
    bare, array = (one_coil(path_coil([line], 2e-4, 2e-4, VIA, end)) for end in (None, PlatedHole(5e-4, 1e-3)))
    assert check_nets(bare, *design_copper(bare)) == ()
    layers, _ = design_copper(array)
    holes = [Barrel(h.x, h.y, h.diameter, h.layers) for h in drills(array)]
    assert check_nets(array, layers, holes) == ()
    assert faults(check_nets(array, layers, holes[1:])) == [("missing", ("A",), "L1")]


@pytest.mark.parametrize(("offset", "passed"), [(1e-6, True), (5e-6, False)])
def test_shapes_may_differ_by_the_tolerance(offset: float, passed: bool) -> None:
    for change in (offset, -offset):
        moved = {layer: [part.buffer(change, join_style="mitre") for part in parts] for layer, parts in LAYERS.items()}
        assert (check_nets(TWO, moved, HOLES) == ()) is passed
    shifted = [replace(hole, x=hole.x + offset) for hole in HOLES]
    assert (check_nets(TWO, LAYERS, shifted) == ()) is passed


def test_unknown_layers_are_refused() -> None:
    message = r"there is no copper layer 'F.Cu'; the stack-up has L1, L2, L3, L4"
    refused(GeometryError, message, check_nets, TWO, {"F.Cu": []}, [])
