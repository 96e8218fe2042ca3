"""KiCad boards: s-expressions with their lines, layers, stack-ups, places, nets, every unreadable file.

Who checks whom: texts written in board_text.py or here, by KiCad's rules; pad places of rotated and flipped footprints
that KiCad 6.0.11 printed; a board that a real KiCad has loaded and saved again; arcs against the circle's formulas.
"""

import dataclasses
import math
import os
import shutil
import subprocess
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from support.board_text import KICAD_6, KICAD_7, KICAD_8, KICAD_9, board, pads, path, segment, via
from support.boards import reference_board
from support.refusals import refused

from coilarray.errors import BoardError
from coilarray.fabrication.kicad_reader import Quoted, parse_sexpr, read_kicad, read_sexpr
from coilarray.fabrication.kicad_writer import board_text
from coilarray.geometry import Stackup
from coilarray.geometry.arcs import CHORD_ERROR, arc_points

ROUNDING = 1e-15  # m: coordinates of 0.1 m in float64


def test_nodes_words_lines_and_escapes():
    root = parse_sexpr('(a 1 "1"\n  (b "two words" (c))\r\n\t(d -2.5e-3)\n\n(b x) )\n')
    assert root.name == "a"
    assert root.words == ("1", "1")
    assert [isinstance(word, Quoted) for word in root.words] == [False, True]
    assert [node.where for node in root.children("b", "d")] == ["text:2", "text:3", "text:5"]
    assert root.need("d").number() == -2.5e-3
    assert root.child("e") is None
    assert root.need("b").need("c").items == ()
    assert parse_sexpr(r'(a "say \"hi\" \\ \n (no list")').text() == 'say "hi" \\ \n (no list'
    assert parse_sexpr('(a "over\nlines" (b))').need("b").where == "text:2"
    # deep nesting is no recursion
    depth = 20_000
    node = parse_sexpr("(a " * depth + ")" * depth)
    for _ in range(depth - 1):
        (node,) = node.items
    assert node.items == ()


def test_texts_that_are_no_s_expression_and_what_a_node_does_not_have():
    for text, message in (
        ("", "text: the file is empty"),
        ("  \n \n", "text: the file is empty"),
        ("hello (a)", "text:1: the file must begin with a parenthesis; got 'hello'"),
        ("\n)", r"text:2: the file must begin with a parenthesis; got '\)'"),
        ("(a\n(b 1\n", r"text:2: the file ends inside \(b …\) of line 2"),
        ("(a\n(b 1)\n\n(c", r"text:4: the file ends inside \(c …\) of line 4"),
        ("(a\n(b 1)\n", r"text:2: the file ends inside \(a …\) of line 1"),
        ('(a\n (b "open)\n)', "text:2: the file ends inside the text that begins here"),
        ('(a "', "text:1: the file ends inside the text that begins here"),
        ("(a)\n(b)", r"text:2: nothing may follow the last parenthesis; got '\('"),
        ("(a))", r"text:1: nothing may follow the last parenthesis; got '\)'"),
    ):
        refused(BoardError, message, parse_sexpr, text)
    node = parse_sexpr("(a\n(b x))")
    refused(BoardError, r"text:1: \(a …\) must have a \(c …\)", node.need, "c")
    refused(BoardError, r"text:2: \(b …\) must have 2 words; got 1", node.need("b").text, 1)
    refused(BoardError, r"text:2: \(b …\) must have a number; got 'x'", node.need("b").number)
    for word in ("inf", "nan", "1e999"):
        refused(BoardError, f"must have a number; got '{word}'", parse_sexpr(f"(a {word})").number)


BOARD = board(path((0, 0), (5, 0), (5, 4)), via(5, 4), pads((0, 0), (3, 0)))


@given(part=st.floats(0, 1))
@settings(max_examples=30)
def test_a_board_cut_off_anywhere_is_one_named_error(part):
    cut = int(part * (len(BOARD.rstrip()) - 1))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "cut.kicad_pcb")
        file.write_text(BOARD[:cut], encoding="utf-8")
        refused(BoardError, r"^\S*cut\.kicad_pcb:(\d+:)? the file (ends inside|is empty)", read_kicad, file)


def test_files_that_cannot_be_read(tmp_path):
    message = r"none\.kicad_pcb: cannot be read: No such file"
    refused(BoardError, message, read_sexpr, tmp_path / "none.kicad_pcb")
    refused(BoardError, "cannot be read: Is a directory", read_sexpr, tmp_path)
    (binary := tmp_path / "b.kicad_pcb").write_bytes(b"\x89PNG\r\n\xff\x00")
    refused(BoardError, r"b\.kicad_pcb: the file is not UTF-8 text", read_sexpr, binary)


def test_kicad_5_to_10_and_other_formats_with_a_note(read):
    for version in (4, 20171130, KICAD_6, KICAD_7, KICAD_8, KICAD_9, 20260206, 20990101):
        found = read(board(segment((0, 0), (5, 2)), version=version))
        assert len(found.notes) == (version in (4, 20990101))
        (track,) = found.tracks
        np.testing.assert_allclose((track.start, track.end), [(0, 0), (5e-3, 2e-3)], atol=ROUNDING)
        assert (track.layer, track.net, track.width) == ("F.Cu", "A", 0.2e-3)
    assert "format 20990101; formats other than those of KiCad 5 to 10" in found.notes[0]


def test_files_that_are_no_board(read):
    for text, message in (
        ("(schematic x)", r":1: a KiCad board begins with \(kicad_pcb and .* this file begins with \(schematic"),
        ("(kicad_pcb (version x))", "must have a number; got 'x'"),
        (f"(kicad_pcb (version {KICAD_6}))", r"must have a \(layers …\)"),
        (f'(kicad_pcb (version {KICAD_6})\n(layers (44 "Edge.Cuts" user)))', ":2: the board has no copper layer"),
    ):
        refused(BoardError, message, read, text)


def test_layers_go_from_top_to_bottom_by_their_names(read):
    # KiCad 9 numbers them 0, 2, 4, 6 with the bottom before the inner ones
    text = board(segment((0, 0), (1, 0), layer="In2.Cu"), layers=4, version=KICAD_9)
    rows = '(0 "F.Cu" signal) (2 "B.Cu" power "ground") (6 "In2.Cu" signal "inner 2") (4 "In1.Cu" signal)'
    found = read(text[: text.index("(layers") + 7] + rows + text[text.index('(44 "Edge') :])
    assert found.stackup.names == ("F.Cu", "In1.Cu", "inner 2", "ground")
    assert found.tracks[0].layer == "inner 2"


def test_stackups_that_are_said_or_given(read):
    # sublayers are capacitors in series
    stackup = read(board(setup=SUBLAYERS)).stackup
    assert stackup.copper_thickness == pytest.approx((70e-6, 35e-6))
    assert stackup.dielectric_thickness == pytest.approx((0.4e-3,))
    assert stackup.epsilon_r == pytest.approx((0.4 / (0.1 / 4.4 + 0.3 / 3.3),))
    # a given one takes the place of the board's
    given_layers = Stackup(("top", "bottom"), (18e-6, 18e-6), (0.1e-3,), (3.3,))
    found = read(board(segment((0, 0), (1, 0), layer="B.Cu"), setup=SUBLAYERS), given_layers)
    assert found.stackup is given_layers
    assert found.tracks[0].layer == "bottom"
    assert found.assumed == {}
    refused(BoardError, "has 4 copper layers and the given stack-up 2", read, board(layers=4), given_layers)


SUBLAYERS = """(stackup
  (layer "F.Cu" (type "copper") (thickness 0.07))
  (layer "dielectric 1" (type "prepreg") (thickness 0.1 locked) (material "FR4") (epsilon_r 4.4) addsublayer
    (thickness 0.3) (material "polyimide") (epsilon_r 3.3))
  (layer "B.Cu" (type "copper") (thickness 0.035)))"""


def test_what_the_stackup_does_not_say_is_assumed_and_said(read):
    bare = read(board(layers=4, thickness="1"))
    assert bare.stackup.copper_thickness == (35e-6,) * 4
    assert sum(bare.stackup.dielectric_thickness) == pytest.approx(1e-3 - 4 * 35e-6)
    assert bare.stackup.epsilon_r == (4.5,) * 3
    keys = ("copper_thickness_um", "dielectric_thickness_mm", "dielectric_epsilon_r")
    copper, slab, epsilon = (f"stackup.{key}" for key in keys)
    assert set(bare.assumed) == {copper, slab, epsilon}
    assert set(read(board(setup=SUBLAYERS.replace("(epsilon_r 3.3)", ""))).assumed) == {epsilon}
    thin = read(board(setup=SUBLAYERS.replace("(thickness 0.07)", "").replace("(thickness 0.3)", "")))
    assert set(thin.assumed) == {copper, slab}
    assert thin.stackup.dielectric_thickness == pytest.approx((1.6e-3 - 70e-6,))
    assert thin.stackup.epsilon_r == pytest.approx((2 / (1 / 4.4 + 1 / 3.3),))  # equal parts in series
    assert read(board(layers=1)).stackup.dielectric_thickness == ()
    message = r"b\.kicad_pcb:2: a board of 0\.1 mm, .* is too thin for its 4 copper layers"
    refused(BoardError, message, read, board(layers=4, thickness="0.1"))


def test_stackups_that_cannot_be(read):
    for setup, message in (
        (SUBLAYERS.replace('"B.Cu"', '"In1.Cu"'), "must list the copper layers F.Cu, B.Cu; got F.Cu, In1.Cu"),
        (SUBLAYERS.replace("0.07", "-0.07"), "a layer thickness must be positive and finite"),
        (SUBLAYERS.replace("4.4", "0.4").replace("3.3", "0.4"), "a relative permittivity must be at least 1"),
        (SUBLAYERS.replace("4.4", "x"), "must have a number; got 'x'"),
    ):
        refused(BoardError, rf"b\.kicad_pcb:\d+: .*{message}", read, board(setup=setup))


def test_places_and_nets(read):
    text = "(segment (start 103 98) (end 104 101.5) (width 0.2) (layer F.Cu) (net 0))"
    (track,) = read(board(text)).tracks
    np.testing.assert_allclose((track.start, track.end), [(3e-3, 2e-3), (4e-3, -1.5e-3)], atol=ROUNDING)
    (track,) = read(board(text, setup="")).tracks
    np.testing.assert_allclose(track.start, (103e-3, -98e-3), atol=ROUNDING)
    assert track.net is None
    through, blind = read(board(via(0, 0), via(1, 2, layers=("In1.Cu", "B.Cu"), kind="blind"), layers=4)).holes
    assert [through.layers, blind.layers] == [("F.Cu", "In1.Cu", "In2.Cu", "B.Cu"), ("In1.Cu", "In2.Cu", "B.Cu")]
    assert (blind.x, blind.y) == pytest.approx((1e-3, 2e-3))
    assert (blind.drill, blind.pad, blind.net, blind.kind) == (0.3e-3, 0.6e-3, "A", "via")
    names = {"1": "A", "2": "B", "0": None, '"A"': "A", '"1"': "1", '""': None, '"Net-(J1-Pad1)"': "Net-(J1-Pad1)"}
    for net, name in names.items():
        assert read(board(segment((0, 0), (1, 0), net=net))).tracks[0].net == name
    message = r"b\.kicad_pcb:\d+: net 7 is not in the board's list of nets"
    refused(BoardError, message, read, board(segment((0, 0), (1, 0), net="7")))


# What KiCad 6.0.11 wrote for one footprint turned by 30°, and for it flipped and turned, and where it said that the
# pads are, in mm with y down.
FOOTPRINTS = """
(footprint "" (layer "F.Cu") (at 50 40 30)
  (pad "1" thru_hole circle (at 1 2 30) (size 1.2 0.8) (drill 0.5) (layers *.Cu *.Mask) (net 1 "A"))
  (pad "2" smd circle (at 3 -1 30) (size 1.2 0.8) (layers "F.Cu" "F.Paste" "F.Mask") (net 1 "A")))
(footprint "" (layer "B.Cu") (at 70 40 -30)
  (pad "1" thru_hole circle (at 1 -2 330) (size 1.2 0.8) (drill 0.5) (layers *.Cu *.Mask) (net 1 "A"))
  (pad "2" smd circle (at 3 1 330) (size 1.2 0.8) (layers "B.Cu" "B.Paste" "B.Mask") (net 1 "A")))
(footprint "" (layer "B.Cu") (at 90 40 100)
  (pad "1" thru_hole circle (at 1 -2 100) (size 1.2 0.8) (drill 0.5) (layers *.Cu *.Mask) (net 1 "A"))
  (pad "2" smd circle (at 3 1 100) (size 1.2 0.8) (layers "B.Cu" "B.Paste" "B.Mask") (net 1 "A")))
"""
THROUGH = [(51.866025, 41.232051), (71.866025, 38.767949), (87.856736, 39.362489)]
SURFACE = [(52.098076, 37.633975, "F.Cu"), (72.098076, 42.366025, "B.Cu"), (90.463863, 36.871929, "B.Cu")]


def test_pads_of_turned_and_flipped_footprints(read):
    found = read(board(FOOTPRINTS, setup=""))
    for hole, (x, y) in zip(found.holes, THROUGH, strict=True):
        assert (hole.x * 1e3, -hole.y * 1e3) == pytest.approx((x, y), abs=1e-6)  # KiCad rounds to 1 nm
        assert (hole.kind, hole.number, hole.drill, hole.pad, hole.net) == ("pad", "1", 0.5e-3, 0.8e-3, "A")
        assert hole.layers == ("F.Cu", "B.Cu")
    for pad, (x, y, layer) in zip(found.pads, SURFACE, strict=True):
        assert (pad.x * 1e3, -pad.y * 1e3) == pytest.approx((x, y), abs=1e-6)
        assert (pad.layer, pad.number, pad.size) == (layer, "2", 0.8e-3)


def footprint(*inside, at="100 100"):
    return f'(footprint "x" (layer "F.Cu") (at {at}) {" ".join(inside)})'


def test_slots_and_pads_of_some_layers(read):
    inside = (
        '(pad "1" thru_hole oval (at 0 0) (size 2 1) (drill oval 1.2 0.6 (offset 0.1 0)) (layers *.Cu))',
        '(pad "" np_thru_hole circle (at 1 0) (size 2 2) (drill 2) (layers *.Cu *.Mask))',
        '(pad "2" smd rect (at 2 0) (size 2 1) (layers "F.Paste"))',
        '(pad "3" connect rect (at 3 0) (size 2 1) (layers "F&B.Cu"))',
    )
    found = read(board(footprint(*inside)))
    assert [(slot.drill, slot.pad, slot.net) for slot in found.holes] == [(0.6e-3, 1e-3, None)]
    assert [(pad.number, pad.layer) for pad in found.pads] == [("3", "F.Cu"), ("3", "B.Cu")]
    # a hole has the pads of its own layers
    one_side = '(pad "1" thru_hole circle (at 0 0) (size 2 2) (drill 1) (layers "F.Cu" "*.Mask"))'
    outer = '(pad "2" thru_hole circle (at 5 0) (size 2 2) (drill 1) (layers "F&B.Cu"))'
    kept = "(remove_unused_layers yes) (keep_end_layers yes)"
    removed = f'(pad "3" thru_hole circle (at 0 0) (size 2 2) (drill 1) (layers "*.Cu") {kept})'
    first, *others = read(board(footprint(one_side, outer, removed), layers=4)).holes
    assert first.layers == ("F.Cu",)
    for hole in others:
        assert hole.layers == ("F.Cu", "In1.Cu", "In2.Cu", "B.Cu")
        areas_mm = [area.area * 1e6 for area in hole.copper.values()]
        assert areas_mm == pytest.approx([math.pi, math.pi / 4, math.pi / 4, math.pi], rel=1e-3)  # 128 corners


PRIMITIVES = "(options (clearance outline) (anchor rect)) (primitives (gr_line (start 0 0) (end 5 0) (width 1)))"


@pytest.mark.parametrize(
    ("pad", "bounds", "area"),
    [
        ("rect (at 0 0) (size 4 1)", (-2, -0.5, 2, 0.5), 4),
        ("rect (at 0 0 90) (size 4 1)", (-0.5, -2, 0.5, 2), 4),
        ("rect (at 3 1 45) (size 2 2)", (3 - 2**0.5, -1 - 2**0.5, 3 + 2**0.5, -1 + 2**0.5), 4),
        ("oval (at 0 0) (size 4 1)", (-2, -0.5, 2, 0.5), 3 + math.pi / 4),
        ("oval (at 0 0) (size 1 4)", (-0.5, -2, 0.5, 2), 3 + math.pi / 4),
        ("circle (at 0 0) (size 1 1) (drill (offset 1 2))", (0.5, -2.5, 1.5, -1.5), math.pi / 4),
        ("roundrect (at 0 0) (size 4 2) (roundrect_rratio 0.25)", (-2, -1, 2, 1), 8 - (4 - math.pi) / 4),
        ("trapezoid (at 0 0) (size 4 2) (rect_delta 0 1)", (-2.5, -1, 2.5, 1), 10),
        (f"custom (at 1 0 90) (size 1 1) {PRIMITIVES}", (0.5, -0.5, 1.5, 0.5), 1),
    ],
)
def test_shapes_of_pads(read, pad, bounds, area):
    (found,) = read(board(footprint(f'(pad "1" smd {pad} (layers "F.Cu"))'))).pads
    np.testing.assert_allclose(np.array(found.shape.bounds) * 1e3, bounds, atol=2e-3)  # rounded corners are shrunk
    assert found.shape.area * 1e6 == pytest.approx(area, rel=3e-3)  # circles have 32 to 128 corners
    assert found.copper == {"F.Cu": found.shape}


def test_pads_and_drawings_turn_with_their_footprint(read):
    (found,) = read(board(footprint('(pad "1" smd rect (at 2 0 90) (size 4 1) (layers "F.Cu"))', at="100 100 30"))).pads
    x, y = 2 * math.cos(math.radians(30)), 2 * math.sin(math.radians(30))
    np.testing.assert_allclose(np.array(found.shape.bounds) * 1e3, (x - 0.5, y - 2, x + 0.5, y + 2), atol=1e-9)
    # drawings do turn with it
    line = '(fp_line (start 0 0) (end 3 0) (layer "F.Cu") (stroke (width 0.2) (type solid)))'
    (found,) = read(board(footprint(line, at="110 100 90"))).tracks
    assert (*found.start, *found.end) == pytest.approx((10e-3, 0, 10e-3, 3e-3), abs=1e-9)
    assert (found.what, found.width) == ("a drawn line", 0.2e-3)
    # and so does what is drawn in a pad
    custom = f'(pad "1" smd custom (at 1 0 90) (size 1 1) {PRIMITIVES} (layers "F.Cu"))'
    (found,) = read(board(footprint(custom))).tracks
    assert (*found.start, *found.end) == pytest.approx((1e-3, 0, 1e-3, 5e-3), abs=1e-9)
    assert found.what == "a drawn line in a pad"


def test_a_footprint_alone_and_the_arcs_of_kicad_5(tmp_path):
    text = """# of a generator
(module coil (layer F.Cu) (fp_text reference L7 (at 0 0) (layer F.SilkS)) (fp_text value "2 uH" (at 0 0) (layer F.Fab))
 (fp_arc (start 0 0) (end 3 0) (angle 180) (layer In2.Cu) (width 0.2))
 (pad 1 thru_hole circle (at 3 0) (size 1 1) (drill 0.5) (layers *.Cu)))"""
    (file := tmp_path / "coil.kicad_mod").write_text(text)
    found = read_kicad(file)
    assert found.stackup.names == ("F.Cu", "In1.Cu", "In2.Cu", "B.Cu")
    places = np.array([found.tracks[0].start, *(track.end for track in found.tracks)]) * 1e3
    np.testing.assert_allclose(np.hypot(*places.T), 3, atol=2e-3)
    np.testing.assert_allclose(places[[0, -1]], [(3, 0), (-3, 0)], atol=1e-9)
    assert places[1:-1, 1].max() < 0  # clockwise on the sheet, where y is down
    assert {(track.part, track.layer) for track in found.tracks} == {("L7", "In2.Cu")}
    assert [(hole.part, hole.value, hole.number) for hole in found.holes] == [("L7", "2 uH", "1")]


@given(radius=st.floats(0.05e-3, 20e-3), first=st.floats(-4, 4), turn=st.floats(-6.2, 6.2), part=st.floats(0.1, 0.9))
@example(radius=5e-5, first=0.0, turn=1.138671875, part=0.5)  # three pieces err by more than CHORD_ERROR
@settings(max_examples=40)
def test_pieces_of_an_arc_stay_on_it_and_keep_its_area(radius, first, turn, part):
    assume(abs(turn) > 0.05)
    centre = np.array([3e-3, -2e-3])

    def on_circle(angle):
        return tuple((centre + radius * np.array([math.cos(angle), math.sin(angle)])).tolist())

    points = arc_points(on_circle(first), on_circle(first + part * turn), on_circle(first + turn))
    assert tuple(points[0]) == on_circle(first)
    assert tuple(points[-1]) == on_circle(first + turn)
    away = np.hypot(*(points - centre).T) - radius
    # the centre from three points at least 5 mrad apart: 1e-18 m of rounding over their sagitta, 3e-6 of the radius
    assert np.abs(away).max() <= CHORD_ERROR * 1.01 + 1e-6 * radius
    middle = 0.5 * (points[1:] + points[:-1])
    assert np.abs(np.hypot(*(middle - centre).T) - radius).max() <= CHORD_ERROR * 1.01 + 1e-6 * radius
    # the sector that the pieces cut out is that of the arc
    (x, y), (u, v) = (points[:-1] - centre).T, (points[1:] - centre).T
    assert 0.5 * abs((x * v - u * y).sum()) == pytest.approx(0.5 * radius**2 * abs(turn), rel=1e-5)


def test_arcs_that_are_lines_or_circles_or_flat():
    assert arc_points((0, 0), (1e-3, 0), (2e-3, 0)).tolist() == [[0, 0], [2e-3, 0]]
    whole = arc_points((1e-3, 0), (-1e-3, 0), (1e-3, 0))
    assert np.hypot(*np.diff(whole, axis=0).T).sum() == pytest.approx(2 * math.pi * 1e-3, rel=1e-3)  # zigzag of 0.9 µm
    assert arc_points((0, 0), (0, 0), (0, 0)).tolist() == [[0, 0], [0, 0]]
    for rise in (1e-9, 1e-8, 1e-7):
        # 20 m from end to end: the radius is up to 5e10 m, over which 0.9 µm is below the rounding of 1
        points = arc_points((-10.0, 0.0), (0.0, rise), (10.0, 0.0))
        assert len(points) < 10
        assert np.abs(points[:, 1]).max() <= CHORD_ERROR


def test_a_curved_track(read):
    text = '(arc (start 101 100) (mid 100 99) (end 99 100) (width 0.15) (layer "B.Cu") (net 2) (tstamp 0))'
    tracks = read(board(text)).tracks
    assert (*tracks[0].start, *tracks[-1].end) == pytest.approx((1e-3, 0, -1e-3, 0))
    assert all(track.start[1] > 0 for track in tracks[1:])  # over the top: y is down in the file
    assert {(track.layer, track.net, track.width) for track in tracks} == {("B.Cu", "B", 0.15e-3)}
    assert all(a.end == b.start for a, b in pairwise(tracks))


ZONE = """(zone (net 1) (net_name "A") (layer "F.Cu") (tstamp 0) (hatch edge 0.5)
  (fill yes (thermal_gap 0.5)) (polygon (pts (xy 100 100) (xy 110 100) (xy 110 90) (xy 100 90)))
  (filled_polygon (layer "F.Cu") (pts (xy 101 99) (xy 109 99) (xy 109 91) (xy 101 91))))"""


def areas(read, *items, **options):
    return read(board(*items, **options)).areas


def test_zones_and_teardrops(read):
    (zone,) = areas(read, ZONE)
    assert (zone.layer, zone.net, zone.what) == ("F.Cu", "A", "a filled zone")
    assert zone.shape.area == pytest.approx(64e-6)
    assert zone.shape.bounds == pytest.approx((1e-3, 1e-3, 9e-3, 9e-3))
    bare = ZONE[: ZONE.index("(filled_polygon")] + ")"
    assert areas(read, bare) == ()
    assert "1 × zone without a fill" in read(board(bare)).notes[0]
    assert areas(read, bare.replace("(hatch", "(keepout (tracks not_allowed)) (hatch")) == ()


def drawn(kind, *parts, layer='(layer "F.Cu")', width="(width 0.2)"):
    return f"(gr_{kind} {' '.join(parts)} {layer} {width})"


@pytest.mark.parametrize(
    ("text", "area"),
    [
        (drawn("line", "(start 100 100)", "(end 110 100)"), 10 * 0.2 + math.pi * 0.01),
        (drawn("line", "(start 100 100)", "(end 110 100)", width="(stroke (width 0.2) (type solid))"), 2.0314),
        (drawn("arc", "(start 101 100)", "(mid 100 99)", "(end 99 100)"), math.pi * 0.2 + math.pi * 0.01),
        (drawn("circle", "(center 100 100)", "(end 102 100)", "(fill none)"), 2 * math.pi * 2 * 0.2),
        (drawn("circle", "(center 100 100)", "(end 102 100)", "(fill solid)"), math.pi * 2.1**2),
        (drawn("rect", "(start 100 100)", "(end 110 104)", "(fill yes)", width="(width 0)"), 40),
        (drawn("rect", "(start 100 100)", "(end 110 104)"), 28 * 0.2 - (4 - math.pi) * 0.01),
        (drawn("poly", "(pts (xy 100 100) (xy 110 100) (xy 110 104))", width="(width 0)"), 20),
        (drawn("poly", "(pts (xy 0 0) (arc (start 2 0) (mid 1 1) (end 0 0)))", width="(width 0)"), math.pi / 2),
        (drawn("curve", "(pts (xy 0 0) (xy 1 0) (xy 2 0) (xy 3 0))"), 3 * 0.2 + math.pi * 0.01),
    ],
)
def test_drawn_copper(read, text, area):
    found = read(board(text))
    items = (*found.tracks, *found.areas)
    shape = shapely.union_all([item.copper["F.Cu"] for item in items])
    assert {item.net for item in items} == {None}
    assert shape.area * 1e6 == pytest.approx(area, rel=5e-3)  # round caps have 32 corners, circles 0.9 µm chords


def test_what_is_on_other_layers_is_no_copper(read):
    silk = drawn("line", "(start 100 100)", "(end 110 100)", layer='(layer "F.SilkS")')
    mask = drawn("line", "(start 100 100)", "(end 110 100)", layer='(layers "F.Cu" "F.Mask")')
    assert len(read(board(silk, mask)).tracks) == 1
    # a track with an opened mask is one
    opened = segment((0, 0), (5, 2)).replace('(layer "F.Cu")', '(layers "F.Cu" "F.Mask")')
    assert read(board(opened, version=KICAD_9)).tracks[0].layer == "F.Cu"
    # the edge of the board
    edge = drawn("rect", "(start 90 95)", "(end 130 110)", layer='(layer "Edge.Cuts")', width="(width 0.1)")
    assert read(board(edge)).edge == pytest.approx((-10e-3, -10e-3, 30e-3, 5e-3))
    assert read(board(segment((0, 0), (1, 0)))).edge is None


ON_FRONT, FONT = '(layer "F.Cu")', "(effects (font (size 1 1)))"


@pytest.mark.parametrize(
    ("item", "what"),
    [
        (f'(gr_text "H" (at 105 100) {ON_FRONT} {FONT})', "1 × (gr_text …)"),
        (f'(gr_text "H" (at 105 100) (hide no) {ON_FRONT} {FONT})', "1 × (gr_text …)"),
        (f"(dimension (type aligned) {ON_FRONT} (pts (xy 100 100) (xy 110 100)) (height 3))", "1 × (dimension …)"),
        (footprint(f'(property "Value" "10k" (at 2 0 0) {ON_FRONT} {FONT})'), "1 × (property …)"),
        ('(hyperloop (start 1 1) (end 2 2) (net "A"))', "1 × (hyperloop …)"),
        (f'(gr_text "H" (at 105 100) (layer "F.SilkS") {FONT})', None),
        (f'(gr_text "H" (at 105 100) {ON_FRONT} hide {FONT})', None),
        (f'(gr_text "H" (at 105 100) {ON_FRONT} (hide yes) {FONT})', None),
        (f"(generated {ON_FRONT} (base_line (pts (xy 100 100) (xy 110 90))))", None),
        (f"(image (at 100 100) {ON_FRONT})", None),
    ],
)
def test_whatever_else_is_on_copper_is_noted(read, item, what):
    found = read(board(item))
    assert found.areas == ()
    assert [note.rpartition(": ")[2] for note in found.notes] == ([f"{what}."] if what else [])


@pytest.mark.parametrize(
    ("item", "message"),
    [
        (segment((0, 0), (1, 0), width="0"), r"\(width …\) must be positive; got 0"),
        (segment((0, 0), (1, 0), layer="In7.Cu"), "there is no copper layer In7.Cu; the board has F.Cu, B.Cu"),
        (segment((0, 0), (1, 0), layer="F.SilkS"), "a track must lie on a copper layer; got F.SilkS"),
        ("(segment (start 1 2) (width 1) (layer F.Cu))", r"\(segment …\) must have a \(end …\)"),
        ("(segment (start 1) (end 1 2) (width 1) (layer F.Cu))", r"\(start …\) must have 2 words; got 1"),
        (
            segment((0, 0), (1, 0)).replace('r "F.Cu"', 'rs "F.Cu" "B.Cu"'),
            "must lie on one copper layer; got F.Cu, B.Cu",
        ),
        ("(arc (start 1 2) (mid 1 1e30) (end 2 2) (width 1) (layer F.Cu))", r"within 10000 mm; got 1, 1e\+30"),
        (via(0, 0, layers=("F.Cu",)), "a via must join two copper layers; got F.Cu"),
        (footprint('(pad "1" thru_hole circle (at 0 0) (size 1 1) (drill 0))'), "must have a positive diameter; got 0"),
        (drawn("curve", "(pts (xy 0 0) (xy 1 0))"), "a curve must have 4 points; got 2"),
        (drawn("poly", "(pts)"), r"\(pts …\) must have points; got none"),
    ],
)
def test_items_that_cannot_be(read, item, message):
    text = board("", item)
    line = text[: text.index(item)].count("\n") + 1
    refused(BoardError, rf"b\.kicad_pcb:{line}: .*{message}", read, text)


SAVE_AGAIN = "import pcbnew, sys; pcbnew.SaveBoard(sys.argv[2], pcbnew.LoadBoard(sys.argv[1]))"


@pytest.mark.slow
def test_a_board_that_kicad_has_saved_again_reads_the_same(tmp_path, read):
    python = shutil.which("python3", path=os.defpath)
    if python is None or subprocess.run([python, "-c", "import pcbnew"], capture_output=True, check=False).returncode:
        pytest.skip("the system's python has no pcbnew")
    edge = '(gr_rect (start 0 0) (end 300 200) (layer "Edge.Cuts") (width 0.1) (fill none) (tstamp 0))'
    text = board_text(reference_board(turns=5, through_holes=False), "board", "").rstrip()[:-1]
    before = read(text + edge + FOOTPRINTS.replace('"A"', '"C1"') + ")\n")
    environment = {**os.environ, "KICAD_CONFIG_HOME": str(tmp_path)}
    files = [str(tmp_path / name) for name in ("b.kicad_pcb", "again.kicad_pcb")]
    subprocess.run([python, "-c", SAVE_AGAIN, *files], check=True, capture_output=True, env=environment, timeout=600)
    after = read_kicad(tmp_path / "again.kicad_pcb")
    assert (after.stackup, after.edge) == (before.stackup, before.edge)
    for kind in ("tracks", "holes", "pads"):  # KiCad writes them in an order of its own
        pieces = ((dataclasses.replace(item, where="") for item in getattr(one, kind)) for one in (before, after))
        assert len({tuple(sorted(map(repr, each))) for each in pieces}) == 1
