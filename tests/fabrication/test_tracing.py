"""Nets of a board become coils: order, direction, layers, widths; what is no path is a named error with its place.

Who checks whom: boards written by board_text.py against the arrays and points that they were written from; the
inductance matrix before and after; turns, lengths and gaps against formulas of the square spiral.
"""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from support.board_text import KICAD_8, board, pads, pair, path, segment, square_spiral, via
from support.boards import many_layers, one_coil
from support.refusals import refused

from coilarray.errors import BoardError
from coilarray.fabrication.board import BoardCopper, Hole, SurfacePad, Track
from coilarray.fabrication.copper_graph import require_followable
from coilarray.fabrication.tracing import trace_coils, traced_array, turn_gap
from coilarray.geometry import PlatedHole, Spiral, Stackup

GRID = 1e-9  # m: resolution of KiCad's files; a point is off by half of it at most
TWO_LAYERS = Stackup(("top", "bottom"), (35e-6, 35e-6), (1e-3,), (4.5,))
SPIRAL = square_spiral()
INNER, OUTER = SPIRAL[-1], SPIRAL[0]


def copper(*tracks, holes=(), pads=(), net="A"):
    """Board of tracks given as (layer, start, end) or (layer, start, end, width), in mm."""
    made = []
    for k, (layer, a, b, *width) in enumerate(tracks):
        start, end = ((x * 1e-3, y * 1e-3) for x, y in (a, b))
        made.append(Track(layer, start, end, *(width or (0.2e-3,)), net, f"file:{k + 1}"))
    return BoardCopper("file", TWO_LAYERS, tuple(made), tuple(holes), tuple(pads))


def line(*points, layer="top"):
    return [(layer, a, b) for a, b in pairwise(points)]


def traced(board_copper, net="A"):
    (coil,) = trace_coils(board_copper, [net]).coils
    return coil


def as_array(board_copper, nets=None):
    """What the coils of a board make."""
    return traced_array(board_copper, trace_coils(board_copper, nets).coils)


def end_pads(numbers):
    """Pads with these numbers at the outer and the inner end of the spiral."""
    return tuple(
        SurfacePad(x * 1e-3, y * 1e-3, "top", "A", "file:pad", number, 1e-3)
        for (x, y), number in zip((OUTER, INNER), numbers, strict=True)
    )


def hole(x, y, *, net="A", kind="via", number="", pad=0.6e-3):
    return Hole(x / 1e3, y / 1e3, 0.3e-3, pad, ("top", "bottom"), net, kind, "file:hole", number)


@pytest.mark.slow
@given(st.sampled_from([3, 4, 6, 24]), st.integers(1, 4), st.sampled_from(["ccw", "cw"]), st.floats(-3, 3))
@settings(max_examples=12)
def test_any_spiral_keeps_its_sense_turns_and_length(sides, layers, winding, rotation):
    spiral = Spiral(sides, 12e-3, 6, 0.15e-3, 0.2e-3, winding=winding)
    array = one_coil(replace(spiral, layers=layers, return_lead=layers % 2 == 1).coil(), rotation=rotation)
    placement, names = array.placements[0], array.stackup.names
    tracks = [
        Track(layer, tuple(a), tuple(b), 0.15e-3, "A", "file:1")
        for part, _, layer in placement.traces()
        for a, b in pairwise(part.tolist())
    ]
    vias = [Hole(x, y, 2e-4, 4.5e-4, names, "A", "via", "f") for x, y in placement.to_board(placement.coil.via_points)]
    ends = placement.to_board(placement.coil.terminal_points)
    terminals = [Hole(x, y, 5e-4, 1e-3, names, "A", "pad", "f", str(k + 1)) for k, (x, y) in enumerate(ends)]
    shuffled = np.random.default_rng(1).permutation(len(tracks))
    turned = [replace(track, start=track.end, end=track.start) for track in tracks]
    mixed = tuple((tracks if k % 3 else turned)[k] for k in shuffled)
    coil = traced(BoardCopper("f", array.stackup, mixed, (*vias, *terminals[::-1]), ()))
    for new, old in zip(coil.lines, placement.coil.lines, strict=True):
        np.testing.assert_allclose(new, placement.to_board(old), rtol=0, atol=1e-15)
    assert coil.layers == placement.layers
    sense = 1 if winding == "ccw" else -1
    # leads and stubs sweep less than a fifth of a turn
    assert sense * coil.turns == pytest.approx(6 * layers, abs=0.2)
    # the area's centre is off the spiral's by less than a pitch
    assert math.hypot(*coil.centre) < 0.35e-3


def test_where_the_current_enters(read):
    cases = (
        *((("1", "2"), OUTER), (("2", "1"), INNER), (("A10", "A2"), INNER), (("3", "2"), INNER), (("", "7"), INNER)),
        *((("1", ""), OUTER), (("2", ""), INNER), (("", "2"), OUTER)),  # a lone 2 is the second terminal
    )
    for numbers, first in cases:
        coil = traced(replace(copper(*line(*SPIRAL)), pads=end_pads(numbers)))
        assert coil.lines[0][0] * 1e3 == pytest.approx(first)
        assert [end.number for end in coil.ends] == (list(numbers) if first == OUTER else list(numbers[::-1]))
    # without numbers it enters where the file begins
    for numbers in (("", ""), ("1", "1")):
        for points in (SPIRAL, SPIRAL[::-1]):
            coil = traced(replace(copper(*line(*points)), pads=end_pads(numbers)))
            assert coil.lines[0][0] * 1e3 == pytest.approx(points[0])
    assert traced(copper(("top", (0, 0), (1, 0)))).lines[0].tolist() == [[0, 0], [1e-3, 0]]
    assert traced(copper(("top", (1, 0), (0, 0)))).lines[0].tolist() == [[1e-3, 0], [0, 0]]


def test_widths_and_layers_go_with_their_tracks():
    tracks = (("top", (0, 0), (1, 0), 0.3e-3), ("top", (3, 0), (1, 0), 0.2e-3), ("top", (3, 0), (3, 4), 0.4e-3))
    coil = traced(copper(*tracks))
    assert coil.widths[0].tolist() == [0.3e-3, 0.2e-3, 0.4e-3]
    assert coil.length == pytest.approx(7e-3)
    # where copper lies twice the wider one counts
    coil = traced(copper(("top", (0, 0), (6, 0), 0.2e-3), ("top", (4, 0), (9, 0), 0.5e-3)))
    assert coil.widths[0].tolist() == [0.2e-3, 0.5e-3, 0.5e-3]
    # a path over vias and back to its layer
    tracks = [*line((0, 0), (5, 0)), *line((5, 0), (5, 2), layer="bottom"), *line((5, 2), (0, 2))]
    coil = traced(copper(*tracks, holes=[hole(5, 0), hole(5, 2)]))
    assert coil.layers == ("top", "bottom", "top")
    assert [(via.x, via.y) for via in coil.vias] == [(5e-3, 0), (5e-3, 2e-3)]
    array = traced_array(copper(*tracks), [coil]).array
    assert array.placements[0].lines_on("top") == (0, 2)


def test_ends_that_are_joined():
    tracks = [("top", (0, 0), (5, 0.0004)), ("top", (5.0004, 0), (9, 0)), ("bottom", (9.0005, 0), (9, 5))]
    coil = traced(copper(*tracks, holes=[hole(9, 0)]))
    assert [len(part) for part in coil.lines] == [3, 2]
    assert coil.lines[0][-1].tolist() == coil.lines[1][0].tolist() == [9e-3, 0]
    # loose ends whose round caps meet
    coil = traced(copper(("top", (0, 0), (5, 0)), ("top", (5.08, 0.02), (9, 0))))
    np.testing.assert_allclose(coil.lines[0] * 1e3, [(0, 0), (5, 0), (5.08, 0.02), (9, 0)], atol=1e-12)
    # copper that does not overlap is apart, and the longest way is the path
    assert traced(copper(("top", (0, 0), (5, 0)), ("top", (5.19, 0), (9, 0)))).length == pytest.approx(9e-3)
    assert traced(copper(("top", (0, 0), (5, 0)), ("top", (5.21, 0), (9, 0)))).length == pytest.approx(5e-3)
    # a track that ends in a pad beside its centre is continued
    pad, track = SurfacePad(0, 0, "top", "A", "file:pad", "1", 1e-3), ("top", (0.3, 0.2), (5, 0.2))
    coil = traced(copper(track, holes=[hole(5.1, 0.1)], pads=[pad]))
    np.testing.assert_allclose(coil.lines[0] * 1e3, [(0, 0), (0.3, 0.2), (5, 0.2), (5.1, 0.1)], atol=1e-12)
    note = "A: pads without a hole at its ends left out; the trace ends in their centres."
    assert traced_array(copper(), [coil]).notes[1] == note
    assert traced(copper(track, pads=[replace(pad, size=0.5e-3)])).ends == (None, None)


def test_copper_that_lies_twice_is_one_path():
    for tracks in (
        *([(0, 6), (4, 9)], [(0, 9), (2, 3)], [(0, 9), (9, 0)]),  # overlapping, inside, twice
        *([(0, 5), (5, 9), (3, 7), (3, 7)], [(0, 9), (4, 4)]),  # over a joint, no length
    ):
        coil = traced(copper(*(("top", (a, 0), (b, 0)) for a, b in tracks)))
        assert coil.length == pytest.approx(9e-3, rel=1e-12)
        np.testing.assert_allclose(sorted(coil.lines[0][[0, -1], 0]), [0, 9e-3], atol=1e-15)
        assert (np.diff(coil.lines[0][:, 0]) > 0).all() or (np.diff(coil.lines[0][:, 0]) < 0).all()


def test_branches_crossings_and_rings():
    for tracks, length in (
        ([*line((0, 0), (5, 0), (9, 0)), ("top", (5, 0), (5, 3))], 9),  # the longest way
        ([("top", (0, 0), (9, 0)), ("top", (5, 0), (5, 6))], 11),
        ([*line((0, 0), (9, 0)), ("top", (4, 0), (4, 0.15))], 9),  # a whisker in the copper
        ([*line((0, 0), (9, 0)), ("top", (9, 0.05), (9, 5))], 9.05 + 4.95),  # an end in the other's side
    ):
        coil = traced(copper(*tracks))
        assert coil.length * 1e3 == pytest.approx(length, rel=1e-6)
    for ring in (line((0, 0), (5, 0), (5, 4), (0, 0)), line((0, 0), (9, 0), (9, 5), (5, 5), (5, -9))):
        refused(BoardError, r"file:\d: a track closes a ring of copper on top at", traced, copper(*ring))


def test_crossings_and_double_vias():
    # two vias side by side are one joint
    tracks = [*line((0, 0), (5, 0), (6, 0)), *line((5, 0), (6, 0), (9, 0), layer="bottom")]
    coil = traced(copper(*tracks, holes=[hole(5, 0), hole(6, 0)]))
    assert coil.length == pytest.approx(9e-3)
    assert coil.layers == ("top", "bottom")
    # on another layer a path may cross itself
    tracks = [*line((0, 0), (9, 0), (9, 5), (5, 5)), *line((5, 5), (5, -5), layer="bottom")]
    assert traced(copper(*tracks, holes=[hole(5, 5)])).layers == ("top", "bottom")


def test_nets_that_are_not_there(read):
    found = read(board(path(*SPIRAL), pads((20, 20), net='2 "B"'), nets=("COIL_A", "B")))
    bare = copper(*line(*SPIRAL), net=None)
    tracks = [segment((k, 0), (k, 1), net=str(k + 1)) for k in range(20)]
    many = read(board(*tracks, nets=tuple(f"net{k:02}" for k in range(20))))
    for copper_read, net, message in (
        (found, "COIL_B", r"there is no net 'COIL_B'; did you mean COIL_A\? The board has B, COIL_A\.$"),
        (found, "B", r"b\.kicad_pcb: net B has no track\.$"),
        (bare, "A", "there is no net 'A'; the copper of the board has no nets"),
        (many, "x", "and 8 more"),
    ):
        refused(BoardError, message, trace_coils, copper_read, [net])


ZONE = """(zone (net {net}) (layer "F.Cu") (tstamp 0) (hatch edge 0.5)
  (polygon (pts (xy {x} 100) (xy {x1} 100) (xy {x1} 90) (xy {x} 90))))"""


def test_copper_that_is_no_track(read):
    # a zone without a fill, copper elsewhere or on the other layer, and whiskers change nothing
    for item in (
        ZONE.format(net=1, x=150, x1=160), ZONE.format(net=0, x=104, x1=110), ZONE.format(net=2, x=104, x1=110),
        '(gr_line (start 1 1) (end 2 2) (width 0.1) (layer "B.Cu") (net 1))',
        '(gr_line (start 95 90) (end 95 96) (width 0.1) (layer "F.Cu"))',
        segment((-5, 0), (-8, 0), net="0"), segment((-6, 0), (-8, 0), net="0"),
    ):  # fmt: skip
        (coil,) = trace_coils(read(board(path(*SPIRAL), item)), ["A"]).coils
        assert abs(coil.turns) == pytest.approx(3, abs=0.1)


def surface_pad(x, y, width, height, *, net="A", at="file:pad"):
    """Return a rectangular pad on top, in mm."""
    corners = np.array((x - width / 2, y - height / 2, x + width / 2, y + height / 2)) * 1e-3
    return SurfacePad(x * 1e-3, y * 1e-3, "top", net, at, "", min(width, height) * 1e-3, shapely.box(*corners))


BELOW = (0, -4.5)  # the outermost turns cross x = 0 at y = −5 and −4


@pytest.mark.parametrize("net", ["A", None])
def test_a_pad_or_via_across_turns_makes_no_coil(net):
    spiral = copper(*line(*SPIRAL))
    for short in (
        {"pads": (surface_pad(*BELOW, 0.3, 2, net=net),)},
        {"holes": (hole(*BELOW, pad=1.2e-3, net=net),)},
        {"pads": (surface_pad(0, -4.8, 0.3, 0.4, net=net), surface_pad(0, -4.3, 0.3, 0.8, net=net))},  # a chain
    ):
        message = r"file:(pad|hole): a (pad|via) closes a ring of copper on top at"
        refused(BoardError, message, trace_coils, replace(spiral, **short))


def test_pads_and_holes_beside_turns():
    tracks = [*line((0, 0), (9, 0)), *line((9, 0), (9, 5), (4, 5), (4, -5), layer="bottom")]
    assert traced(copper(*tracks, holes=[hole(9, 0)])).layers == ("top", "bottom")
    message = r"a via closes a ring of copper on bottom at \(3.9, 0"
    refused(BoardError, message, traced, copper(*tracks, holes=[hole(9, 0), hole(3.8, 0)]))
    # a pad left out where no track ends is a barrel alone, which the trace at 0.3 mm passes
    passing = [*line((0, 0), (9, 0)), *line((9, 0), (9, 5), (4, 5), (4, 0.3), (3, 0.3), layer="bottom")]
    refused(BoardError, "a via closes a ring", traced, copper(*passing, holes=[hole(9, 0), hole(3.5, 0)]))
    thin = replace(hole(3.5, 0), shapes={"top": shapely.Point(3.5e-3, 0).buffer(0.3e-3)})
    assert traced(copper(*passing, holes=[hole(9, 0), thin])).layers == ("top", "bottom")
    # pads that only widen the path
    at_the_end, along_a_side, around_a_corner = (*OUTER, 1.5, 1.5), (-5, 0, 0.8, 3), (-4.95, -4.95, 0.5, 0.5)
    for pad in (at_the_end, along_a_side, around_a_corner, (20, 20, 5, 5)):
        assert traced(copper(*line(*SPIRAL), pads=(surface_pad(*pad),))).turns == pytest.approx(3, abs=0.1)


def test_copper_of_any_net_or_none_that_joins_turns_makes_no_coil():
    spiral = copper(*line(*SPIRAL), net=None)
    assert [coil.name for coil in trace_coils(spiral).coils] == ["coil1"]
    for short in (
        copper(("top", (0, -4.9), (0, -4.1), 0.3e-3), net=None),  # ends between the centre lines
        copper(("top", (0, -4.95), (3, -4.05), 0.2e-3), net="B"),
        *(copper(holes=[hole(*BELOW, pad=1.2e-3, net=net)]) for net in (None, "B")),
    ):
        both = replace(spiral, tracks=spiral.tracks + short.tracks, holes=short.holes)
        refused(BoardError, r"closes a ring of copper on top", trace_coils, both)


def test_nets_that_are_joined_and_coils_that_are_joined():
    # a coil of drawn lines ties the nets of its pads
    holes = [hole(*OUTER, kind="pad", number="1"), hole(*INNER, kind="pad", net="B", number="2")]
    (tie,) = trace_coils(copper(*line(*SPIRAL), holes=holes, net=None)).coils
    assert (tie.net, tie.name) == ("A, B", "A_B")
    assert [end.number for end in tie.ends] == ["1", "2"]
    # two coils in series with a pad between
    two = copper(*line(*SPIRAL[::-1], *((-11 - x, y) for x, y in SPIRAL)))
    (series,) = trace_coils(two).coils
    assert [round(abs(pole.turns)) for pole in series.poles] == [3, 3]
    found = trace_coils(replace(two, pads=(surface_pad(-5.5, 5, 0.5, 0.5),))).coils
    assert [coil.name for coil in found] == ["A", "A_2"]
    assert [round(abs(coil.turns)) for coil in found] == [3, 3]


def test_the_back_and_the_margin_of_a_board(read):
    found = as_array(read(board(path(*SPIRAL))))
    assert found.array.stackup == Stackup(("F.Cu",), (35e-6,), (), ())
    assert "B.Cu has no copper and is left out: the design has one layer, F.Cu." in found.notes
    assert not any("dielectric" in key for key in found.assumed)
    both = read(board(path(*SPIRAL), via(20, 20, net="2")))
    assert as_array(both).array.stackup == both.stackup
    # the margin is the nearest edge
    even, uneven = (
        as_array(replace(copper(*line(*SPIRAL)), edge=(-8e-3, -8e-3, *corner)))
        for corner in ((8e-3, 8e-3), (20e-3, 3e-3))
    )
    assert (even.array.board_margin, uneven.array.board_margin) == (pytest.approx(2.9e-3), 0)
    assert not any("margin" in text for text in (*even.notes, *even.assumed))
    assert any("2.9, 2.9, 14.9, -2.1 mm" in note for note in uneven.notes)


def test_without_names_the_nets_that_wind_are_coils(read):
    bent, closed = path((20, 0), (30, 0), (30, 5), net="2"), path((40, 0), (50, 0), (45, 5), (40, 0), net="3")
    items = (path(*SPIRAL), bent, closed, path(*((x + 60, y) for x, y in SPIRAL), net="0"))
    found = trace_coils(read(board(*items, nets=("A", "B", "C", "D"))))
    assert [coil.name for coil in found.coils] == ["A", "coil1"]
    (left,) = found.left_out  # the bent track is too short to wind
    assert left.name == "C"
    assert "closes a ring" in left.reason


def test_what_is_a_coil(read):
    loop = [(6 * math.cos(a), 6 * math.sin(a)) for a in np.radians(np.linspace(10, 350, 60))]
    assert len(trace_coils(copper(*line((12, loop[0][1]), *loop, (12, loop[-1][1])))).coils) == 1
    meander = copper(*line((0, 0), (9, 0), (9, 1), (0, 1), (0, 2), (9, 2), (9, 3), (0, 3)))
    message = r"no coil was found. Net A \(0.102 turns, 39 mm\) looks most like one: it makes 0.10 turns"
    refused(BoardError, message, trace_coils, meander)
    refused(BoardError, "there is no copper that could be a coil", trace_coils, read(board(pads((0, 0)))))


def test_names_of_coils_are_new_or_in_the_given_order_of_nets_which_need_not_wind(read):
    text = board(path(*SPIRAL), path(*((x + 60, y) for x, y in SPIRAL), net="0"), nets=("coil1",))
    assert [coil.name for coil in trace_coils(read(text)).coils] == ["coil1", "coil2"]
    text = board(path(*SPIRAL), path((20, 0), (30, 0), net="2"))
    assert [coil.name for coil in trace_coils(read(text), ["B", "A", "B"]).coils] == ["B", "A"]


def test_turns_length_and_gap_of_a_square_spiral():
    coil = traced(copper(*line(*SPIRAL)))
    # from the corner at (-5, 5) anticlockwise; the last side ends 1 mm beyond a whole turn's corner
    assert coil.turns == pytest.approx(3, abs=0.1)
    assert coil.length == pytest.approx(sum(math.dist(a, b) for a, b in pairwise(SPIRAL)) * 1e-3)
    assert math.hypot(*coil.centre) < 0.5e-3
    assert turn_gap(coil.lines, coil.layers, coil.widths) == pytest.approx(0.8e-3)
    assert traced(copper(*line(*SPIRAL[::-1]))).turns == pytest.approx(-coil.turns)
    # the gap takes widths off and leaves other layers out
    wide, points = [np.full(len(SPIRAL) - 1, 0.5e-3)], np.array(SPIRAL) * 1e-3
    assert turn_gap([points], ["top"], wide) == pytest.approx(0.5e-3)
    assert turn_gap([points, points + 0.3e-3], ["top", "bottom"], wide * 2) == pytest.approx(0.5e-3)


def test_paths_without_turns_or_gap():
    found = as_array(copper(*line((0, 0), (9, 0), (9, 1), (0, 1))), ["A"])
    assert found.array.placements[0].coil.gap == 0.2e-3
    assert "coils.A.gap_mm" in found.assumed
    # a path that runs around nothing
    coil = traced(copper(*line((0, 0), (5, 0), (9, 0))))
    assert coil.turns == 0
    assert coil.centre == pytest.approx((4.5e-3, 0))


def test_holes_of_several_sizes_or_depths_or_that_lead_nowhere(read):
    tracks = [*line((0, 0), (5, 0)), *line((5, 0), (5, 2), layer="bottom"), *line((5, 2), (0, 2))]
    tracks += line((0, 2), (0, 4), layer="bottom")
    holes = [hole(5, 0), hole(5, 2, pad=0.8e-3), hole(0, 2, pad=0.8e-3)]
    found = as_array(copper(*tracks, holes=holes), ["A"])
    assert found.array.placements[0].coil.via == PlatedHole(0.3e-3, 0.8e-3)
    assert found.notes[:-1] == ("A: vias of several sizes, all taken as the commonest.",)
    # blind and through holes together
    tracks = [("L1", (0, 0), (5, 0)), ("L2", (5, 0), (5, 2)), ("L3", (5, 2), (0, 2))]
    names = many_layers(4).names
    vias = [replace(hole(5, 0), layers=names), replace(hole(5, 2), layers=names[1:3])]
    found = as_array(replace(copper(*tracks, holes=vias), stackup=many_layers(4)), ["A"])
    assert not found.array.through_holes
    assert "some do not" in found.notes[0]
    # vias at the ends
    array = as_array(read(board(path(*SPIRAL), via(*OUTER), via(*INNER, size="0.6")))).array
    assert array.placements[0].coil.terminal == PlatedHole(0.3e-3, 0.6e-3)
    # a pad no larger than its hole
    tracks = [*line((0, 0), (5, 0)), *line((5, 0), (5, 2), layer="bottom")]
    message = "file:hole: hole of A: pad of a hole must be larger than its drill"
    for kind in ("via", "pad"):
        refused(BoardError, message, as_array, copper(*tracks, holes=[hole(5, 0, pad=0.3e-3, kind=kind)]), ["A"])
    # holes that lead nowhere
    board_copper = copper(*line(*SPIRAL), holes=[hole(-5, 0), hole(*OUTER), hole(20, 20)])
    coil = traced(board_copper)
    assert [(via.x, via.y) for via in coil.passed] == [(-5e-3, 0)]
    assert coil.vias == ()
    notes = traced_array(board_copper, [coil]).notes
    assert notes[:-1] == (
        "A: one end has a plated hole and the other none; both taken without.",
        "A: 1 of the holes on the path join none of its lines and are left out.",
    )


def test_shapes_that_differ_by_more_than_the_grid_are_two():
    def two(shift):
        moved = np.add(SPIRAL, (30, 0))
        moved[5, 0] += shift
        tracks = (*copper(*line(*SPIRAL)).tracks, *copper(*line(*moved), net="B").tracks)
        first, second = as_array(replace(copper(), tracks=tracks)).array.placements
        return first.coil is second.coil

    assert two(1e-6)  # 1 nm
    assert not two(5e-6)


PITCH, OUTSIDE = 1.0, 10.0  # mm


def half_circles(turns):
    """Start, middle and end of every arc on the front, inwards, and on the back, outwards; mm, y up, anticlockwise."""
    front, back = [], []
    for k in range(turns):
        r = OUTSIDE - k * PITCH
        front.append(((r, 0), (0, r), (-r, 0)))
        front.append(((-r, 0), (-PITCH / 2, -(r - PITCH / 2)), (r - PITCH, 0)))
        r = OUTSIDE - (turns - k) * PITCH
        back.append(((r, 0), (-PITCH / 2, r + PITCH / 2), (-(r + PITCH), 0)))
        back.append(((-(r + PITCH), 0), (0, -(r + PITCH)), (r + PITCH, 0)))
    return front, back


@pytest.mark.slow
def test_a_coil_of_arcs_beside_a_ground_plane(read):
    """As people draw it in KiCad 8: arcs, a header turned by 90°, a plane, a teardrop."""
    front, back = half_circles(5)
    arcs = [
        f'(arc {pair("start", *a)} {pair("mid", *b)} {pair("end", *c)} (width 0.25) (layer "{layer}") (net 1))'
        for layer, half in (("F.Cu", front), ("B.Cu", back))
        for a, b, c in 1e-3 * np.array(half)
    ]
    leads = [path((14, 1.27), (10, 0), width="0.25"), path((5, 0), (3.5, 0), width="0.25")]
    leads += [path(*ends, width="0.25", layer="B.Cu") for ends in (((3.5, 0), (5, 0)), ((10, 0), (14, -1.27)))]
    header = pads((0, 0), (2.54, 0), turn=-90, at=(14, 1.27), net='1 "/coil (1)"', size="1.7 1.7")
    fill = '(filled_polygon (layer "F.Cu") (pts (xy {0} {2}) (xy {1} {2}) (xy {1} {3}) (xy {0} {3})))'
    plane = f'(zone (net 2) (layers "F&B.Cu") {fill.format(81, 119, 114, 119)})'
    drop = f'(zone (net 1) (layer "F.Cu") (attr (teardrop (type padvia))) {fill.format(103.5, 104.5, 99.8, 100.2)})'
    items = (*arcs[::-1], *leads, header, via(3.5, 0, size="0.8", drill="0.4"), plane, drop)
    ground = path((-19, -18), (19, -18), net="2")
    nets, users = ("/coil (1)", "GND"), ("F.Cu", "back side")
    copper_read = read(board(*items, ground, version=KICAD_8, nets=nets, users=users, thickness="0.8"))
    tracing = trace_coils(copper_read)
    (coil,) = tracing.coils
    assert coil.name == "/coil (1)"
    assert coil.layers == ("F.Cu", "back side")
    assert [(via.x, via.y, via.pad) for via in coil.vias] == [(pytest.approx(3.5e-3), 0, 0.8e-3)]
    assert [end.number for end in coil.ends] == ["1", "2"]
    np.testing.assert_allclose(coil.path[[0, -1]], [(14e-3, 1.27e-3), (14e-3, -1.27e-3)], atol=1e-15)
    assert coil.turns == pytest.approx(10, abs=0.05)
    length = sum(math.pi * math.dist(a, c) / 2 for a, _, c in front + back)
    # pieces that zigzag by 0.9 µm about arcs of 5 to 10 mm are longer by a third of that over the radius
    assert coil.length * 1e3 == pytest.approx(length + 3 + 2 * math.hypot(4, 1.27), rel=6e-5)
    found = traced_array(copper_read, [coil])
    placement = found.array.placements[0]
    assert placement.coil.gap == pytest.approx(0.75e-3, abs=2e-6)  # chords beside chords
    assert placement.coil.terminal == PlatedHole(0.5e-3, 1.7e-3)
    assert math.hypot(placement.x, placement.y) < 0.3e-3
    assert set(found.assumed) >= {"stackup.dielectric_thickness_mm", "stackup.copper_thickness_um"}


def test_tracks_that_lie_across_each_other_too_often_are_refused_at_once():
    """Random lines over a square, of whose bounds a ninth hold a point: 60,000 ends and 30,000 lines meet 2e8 times."""
    ends = np.random.default_rng(1).uniform(0, 0.1, (30_000, 4)).tolist()
    crossing = shapely.linestrings([[(a, b), (c, d)] for a, b, c, d in ends])
    refused(BoardError, "a:1: 30000 tracks .* about 2e.08 times", require_followable, crossing, "a:1")
    require_followable(shapely.linestrings([[(a, b), (a + 1e-3, b)] for a, b, _, _ in ends]), "a:1")
