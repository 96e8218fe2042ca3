"""Arrays written as design files: what is read back is the array to 1 nm, with its assumptions and shared shapes."""

import dataclasses
import difflib
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.boards import FOUR_LAYERS, VIA, many_layers, reference_board

from coilarray import load_design, load_design_file
from coilarray.design.model import Design, parse_design, parse_design_file
from coilarray.design.vary import vary_chosen
from coilarray.design.write import (
    design_names,
    design_text,
    document_text,
    edited_text,
    file_text,
    save_design,
    shape_names,
    with_comments,
)
from coilarray.errors import DesignError
from coilarray.geometry import Array, Placement, PlatedHole, Spiral, Stackup, path_coil

GRID = 1e-9  # m: places are rounded to it


def text(array, name="copy", assumed=None):
    return design_text(Design(array, name=name, source="a test"), assumed)


def same(found, array):
    assert [p.layers for p in found.placements] == [p.layers for p in array.placements]
    assert (found.through_holes, found.board_margin) == (array.through_holes, pytest.approx(array.board_margin))
    for new, old in zip(found.conductors(), array.conductors(), strict=True):
        # half a grid step of the line and half of the placement, in x and in y
        np.testing.assert_allclose(new.vertices, old.vertices, rtol=0, atol=1.5 * GRID)
        np.testing.assert_allclose(new.areas, old.areas, rtol=1e-9)
    for new, old in zip(found.placements, array.placements, strict=True):
        for one, other in ((new.coil.via, old.coil.via), (new.coil.terminal, old.coil.terminal)):
            assert (one is None) == (other is None)
            if one is not None:
                assert (one.drill, one.pad) == pytest.approx((other.drill, other.pad))
        assert new.coil.gap == pytest.approx(old.coil.gap)


def mixed_array():
    tapered = path_coil(
        [[(0, 0), (4e-3, 0), (4e-3, 3e-3)], [(4e-3, 3e-3), (0, 3e-3)], [(0, 3e-3), (0, 1e-3), (3e-3, 1e-3)]],
        [[0.2e-3, 0.35e-3], [0.3e-3], [0.2e-3, 0.2e-3]],
        0.25e-3,
        PlatedHole(0.25e-3, 0.5e-3, 20e-6),
    )
    spiral = Spiral(5, 8e-3, 5, 0.15e-3, 0.15e-3).coil()
    placements = (
        Placement("tapered", tapered, ("L1", "L2", "L1"), 1.23456e-3, -2e-3, 0.3),
        Placement("one", spiral, ("L1", "L2"), 20e-3, 0, -2.0),
        Placement("two", spiral, ("L3", "L4"), 20e-3, 10e-3),
    )
    return Array(FOUR_LAYERS, placements, board_margin=0.5e-3, through_holes=False)


def test_widths_repeated_layers_rotations_and_bare_ends_come_back():
    array = mixed_array()
    found = parse_design(text(array)).array
    same(found, array)
    assert found.placements[0].coil.terminal is None
    assert found.placements[0].coil.via.plating == pytest.approx(20e-6)
    assert found.placements[0].coil.widths[0].tolist() == [0.2e-3, 0.35e-3]
    assert found.placements[1].coil is found.placements[2].coil
    document = tomllib.loads(text(array))
    assert list(document["coils"]) == ["shape1", "shape2"] == sorted(set(shape_names(array)))
    assert document["coils"]["shape2"]["trace_width_mm"] == 0.15


def test_points_stand_one_a_line_and_no_line_is_long():
    lines = text(mixed_array()).splitlines()
    assert "        [4.0, 3.0]," in lines
    assert 'layers = ["L1", "L2", "L1"]' in lines
    assert max(map(len, lines)) <= 120
    many = path_coil([np.column_stack((np.arange(200) * 1e-3, np.arange(200) % 2 * 1e-3))], 2e-4, 2e-4, VIA)
    varied = path_coil(many.lines, [np.linspace(2e-4, 3e-4, 199).round(9)], 2e-4, VIA)
    array = Array(many_layers(1), (Placement("A", varied, ("L1",), 0, 0),))
    assert max(map(len, text(array).splitlines())) <= 120
    same(parse_design(text(array)).array, array)


@pytest.mark.parametrize(("given_names", "expected"), [
    (["/coil1", "coil1"], ["coil1", "coil1_2"]),
    (["Net-(J1-Pad1)", "-x", "", "a b/c"], ["Net-_J1-Pad1_", "x", "_", "a_b_c"]),
    (["Ω1", "µ2"], ["_1", "_2"]), (["a b", "a/b", "a_b"], ["a_b", "a_b_2", "a_b_3"]),
    (["F.Cu", "In1.Cu", "+3V3"], ["F.Cu", "In1.Cu", "+3V3"]),
])  # fmt: skip
def test_names_become_ones_that_a_design_can_have(given_names, expected):
    assert design_names(given_names) == dict(zip(given_names, expected, strict=True))


@pytest.mark.slow
@given(names=st.lists(st.text(min_size=0, max_size=8), min_size=1, max_size=6, unique=True))
@settings(max_examples=20)
def test_any_names_make_a_readable_design(names):
    coil = path_coil([[(0, 0), (1e-3, 0)]], 2e-4, 2e-4, VIA)
    placements = tuple(Placement(name, coil, (names[0],), 0, k * 1e-3) for k, name in enumerate(names))
    array = Array(Stackup((names[0],), (35e-6,), (), ()), placements)
    found = parse_design(text(array, name=names[0])).array
    assert len(set(found.names)) == len(names)


def test_assumptions_are_carried_to_the_keys_they_are_of():
    board = {"stackup.dielectric_epsilon_r": "FR-4", "board.margin_mm": "none given"}
    assumed = {**board, "coils.*.via.plating_um": "usual", "coils.two.gap_mm": "a guess"}
    file = parse_design_file(text(mixed_array(), assumed=assumed))
    plating = {f"coils.shape{k}.via.plating_um": "usual" for k in (1, 2)}
    assert file.assumed == {**board, **plating, "coils.shape2.gap_mm": "a guess"}
    assert file.design.source == "a test"
    assert parse_design_file(text(mixed_array())).assumed == {}


def test_names_with_dots_find_their_shape():
    coil = path_coil([[(0, 0), (1e-3, 0)]], 2e-4, 2e-4, VIA)
    other = path_coil([[(0, 0), (2e-3, 0)]], 2e-4, 2e-4, VIA)
    placements = (Placement("a", coil, ("L1",), 0, 0), Placement("a.gap_mm", other, ("L1",), 0, 1e-3))
    array = Array(many_layers(1), placements)
    reasons = parse_design_file(text(array, assumed={"coils.a.gap_mm": "1", "coils.a.gap_mm.gap_mm": "2"})).assumed
    assert reasons == {"coils.shape1.gap_mm": "1", "coils.shape2.gap_mm": "2"}


def test_an_assumption_of_nothing_is_refused_when_read():
    with pytest.raises(DesignError, match=r"assumed\.'board\.colour' names no value of the design"):
        parse_design(text(reference_board(), assumed={"board.colour": "green"}))


def test_a_saved_design_is_commented_and_the_same(tmp_path):
    """A file keeps its own comments; a design made in Python gets the meanings of its keys and tables."""
    starter = load_design_file("starter")
    meanings = ("# Number of layers of the winding", "# Capacitance of the tank", "# copper layers and dielectrics")
    for design, comments in ((starter, ("# in series, joined by vias", "# of the tank")), (starter.design, meanings)):
        save_design(design, tmp_path / "d.toml")
        saved = (tmp_path / "d.toml").read_text(encoding="utf-8")
        assert load_design(tmp_path / "d.toml").digest == starter.design.digest
        assert [saved.count(comment) for comment in comments] == [1] * len(comments)
    short = {"name": "base", "thickness_mm": 3.0, "exceptions": {"coil1": "open"}}
    assert tomllib.loads(document_text({"elastomer": [short, short]})) == {"elastomer": [short, short]}


def test_a_comment_makes_no_line_too_long():
    line = f'source = "{"long " * 20}"'
    assert with_comments(line) == f"{line}\n"


COMMENTED = """# of the file
schema = 1   # version

# above a table
[stackup] # behind its header
layers = ["L1", "L#2"]   # a sign in a text
copper_um = [
  35.0, # in a list
  # on a line of its own
  35.0,
] # behind it
# at the end of a table

# above a table below another
[coils.hex.via]
drill_mm = 0.2

# first of a list
[[elastomer]]
name = "base" # its name
thickness_mm = 3.0

# second of a list
[[elastomer]]
name = "top"
E_kPa = 1.0 # its own

[circuit]
ends = { coil1 = "open" } # inline
# at the very end
"""


BEFORE = tomllib.loads(COMMENTED)
STACKUP, (BASE, TOP) = BEFORE["stackup"], BEFORE["elastomer"]


@pytest.mark.parametrize(("changes", "lost", "kept"), [
    ({}, (), COMMENTED),
    ({"schema": 2, "title": "new"}, (), "schema = 2   # version"),
    ({"stackup": STACKUP | {"copper_um": [35.0, 70.0], "layers": ["L1"]}}, (), 'layers = ["L1"]   # a sign in a text'),
    ({"stackup": STACKUP | {"copper_um": [35.0]}}, (), "# on a line of its own\n] # behind it"),
    ({"stackup": STACKUP | {"copper_um": [35.0, 35.0, 18.0]}}, (), "  35.0,\n  18.0,\n] # behind it"),
    ({"coils": {"hex": {"via": {"drill_mm": 0.3}}}}, (), "[coils.hex.via]\ndrill_mm = 0.3"),
    ({"coils": {"hex": {"gap_mm": 0.1, "via": {"drill_mm": 0.2}}}}, (), "[coils.hex]\ngap_mm = 0.1"),
    ({"elastomer": [TOP]}, ("# its name", "# second of a list"), '[[elastomer]]\nname = "top"\nE_kPa = 1.0 # its own'),
    ({"elastomer": [TOP, BASE]}, (), 'name = "top"\nE_kPa = 1.0 # its own\n\n[[elastomer]]\nname = "base" # its name'),
    ({"elastomer": [BASE | {"name": "low"}, TOP]}, (), 'name = "low" # its name\nthickness_mm = 3.0'),
    ({"elastomer": [BASE, TOP, {"name": "lid"}]}, (), '[[elastomer]]\nname = "lid"'),
    ({"circuit": {"ends": {"coil1": "open", "coil2": "load"}, "C_pF": 9}}, (), '# at the very end\nC_pF = 9'),
    ({"assumed": {"a.b": "why"}}, (), '# at the very end\n\n[assumed]\n"a.b" = "why"'),
])  # fmt: skip
def test_comments_stay_where_a_document_changes(changes, lost, kept):
    """Every place of a comment, and every kind of change: value, in a list, of a list of tables, new and removed."""
    found = edited_text(COMMENTED, BEFORE | changes)
    assert tomllib.loads(found) == BEFORE | changes
    assert kept in found
    comments = [f"#{line.rpartition('#')[2]}" for line in COMMENTED.splitlines() if "#" in line]
    assert [one for one in comments if one not in found] == list(lost)


@pytest.mark.parametrize(("text", "document", "expected"), [
    ('a = [\n  {name = "b", k = 1}, # of b\n  {name = "c", k = [1, 2]} # of c\n]\n',
     {"a": [{"name": "d"}, {"name": "c", "k": [1]}]},
     'a = [\n  {name = "d" }, # of b\n  {name = "c", k = [1]} # of c\n]\n'),
    ("a = [1, 2, # two\n  3]\n", {"a": [2, 3]}, "a = [2, # two\n  3]\n"),
    ("board.x = 2 # of x\n# of z\nz = 1\n", {"board": {"x": 2, "y": True}, "z": 2},
     'board.x = 2 # of x\nboard.y = true\n# of z\nz = 2\n'),
    ("board.x = 2 # of x\n# of z\nz = 1\n", {"board": {"x": 2, "d": {"e f": 1}}, "z": 1}, None),
])  # fmt: skip
def test_comments_stay_in_lists_of_several_lines_and_beside_dotted_keys(text, document, expected):
    found = edited_text(text, document)
    assert found == expected


@pytest.mark.parametrize("name", ["gast2020", "gast_fem", "starter"])
def test_a_file_with_a_changed_entry_keeps_its_text(name):
    file = load_design_file(name)
    changes = {"board.margin_mm": 3.25, "circuit.capacitance_pF": 91}
    changed = dataclasses.replace(file, document=vary_chosen(file.document, changes))
    before, after = file.text.splitlines(), file_text(changed, Path()).splitlines()
    different = [line for line in difflib.ndiff(before, after) if line[0] in "+-"]
    assert len(different) <= 3 * len(changes)  # two lines of each, and a reason why it was assumed
    assert tomllib.loads("\n".join(after)) == changed.document
    assert sum("#" in line for line in after) == sum("#" in line for line in before)
