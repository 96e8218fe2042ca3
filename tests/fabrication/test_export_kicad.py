"""KiCad projects: every piece of copper in its place, the limits as rules; and what a real KiCad says of them.

The text is checked with the reader's parser, the copper against `drills` and `copper_by_layer`, the whole by KiCad's
own design rule check and plots, read back by gerbonara.
"""

from __future__ import annotations

import json
import math
import re
import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from support.boards import FOUR_LAYERS, LEADS, VIA, many_layers, one_coil, reference_board
from support.kicad_tools import Kicad, find_kicad
from support.refusals import refused

from coilarray.design.model import load_design
from coilarray.errors import OutputError, RuleViolationError
from coilarray.fabrication.drawings import silk_labels
from coilarray.fabrication.kicad_reader import Node, parse_sexpr, read_sexpr
from coilarray.fabrication.kicad_writer import copper_names, quoted, write_kicad
from coilarray.geometry import Array, FabRules, Placement, PlatedHole, Spiral, Stackup, path_coil
from coilarray.geometry.array import Lattice, lattice_array
from coilarray.geometry.copper import board_outline, disc, drills

RULES = FabRules()
# KiCad counts in nanometres: half of one is lost in rounding, and a line begins where the one before ended to 1 nm
NANOMETRE = 1e-9
HEXAGON = Spiral(6, 8e-3, 6, 0.1e-3, 0.1e-3, first_corner=math.pi / 2)


def hexagonal_board(winding_layers: int, *, bare: bool = False) -> Array:
    """Nine coils on a hexagonal lattice, each on all layers, with blind and buried holes."""
    coil = replace(HEXAGON, layers=winding_layers, leads=None if bare else LEADS).coil()
    stackup = many_layers(winding_layers)
    names = tuple(f"C{k + 1}" for k in range(9))
    array = lattice_array(stackup, coil, Lattice("hexagonal", 13e-3, 3, 3, (stackup.names,), names=names))
    turned = [replace(placement, rotation=0.1 * k) for k, placement in enumerate(array.placements)]
    return replace(array, placements=tuple(turned), through_holes=False)


def pairs_board() -> Array:
    """Three coils on three pairs of six layers, blind holes: terminals lie on inner layers too."""
    coil = HEXAGON.coil()
    pairs = (("L1", "L2"), ("L3", "L4"), ("L5", "L6"))
    placements = tuple(Placement(f"C{k + 1}", coil, pair, 5e-3 * k, 0.0) for k, pair in enumerate(pairs))
    return Array(many_layers(6), placements, through_holes=False)


def winding_and_return() -> Array:
    """Two widths, and a path that comes back to its first layer."""
    out, back = [(0, 0), (5e-3, 0), (5e-3, 4e-3)], [(2e-3, 4e-3), (2e-3, 2e-3), (1e-3, 2e-3)]
    widths = [[0.3e-3, 0.2e-3], [0.25e-3], [0.15e-3, 0.2e-3]]
    holes = (PlatedHole(0.3e-3, 0.6e-3), PlatedHole(0.5e-3, 1e-3))
    coil = path_coil([out, [out[-1], back[0]], back], widths, 0.2e-3, *holes)
    return Array(FOUR_LAYERS, (Placement("A", coil, ("L1", "L3", "L1"), 1e-3, -2e-3, 0.7),))


def single_layer() -> Array:
    return one_coil(Spiral(6, 8e-3, 4, 0.2e-3, 0.2e-3, layers=1).coil())


BOARDS = {
    **{name: lambda name=name: load_design(name).array for name in ("gast2020", "starter", "gast_fem")},
    "hexagonal, blind holes": lambda: hexagonal_board(4),
    "two widths": winding_and_return,
    "one layer": single_layer,
}


@pytest.fixture(params=BOARDS.values(), ids=BOARDS.keys(), scope="module")
def exported(request, tmp_path_factory) -> tuple[Array, tuple[Path, ...], Node]:
    """A board, the files of its project, and the first of them read back."""
    array = request.param()
    files = write_kicad(array, tmp_path_factory.mktemp("kicad") / "project", name="board", rules=RULES)
    return array, files, read_sexpr(files[0])


def coil_of_one_line(length: float, stackup: Stackup = FOUR_LAYERS) -> Array:
    coil = path_coil([[(0, 0), (length, 0)]], 1e-3, 1e-3, VIA)
    return Array(stackup, (Placement("A", coil, ("L1",), 0, 0),))


def export(array: Array, folder: Path, **options: Any) -> tuple[Path, ...]:
    return write_kicad(array, folder / "project", **{"name": "board", "rules": RULES, **options})


def written(array: Array, folder: Path) -> Node:
    """The board's file, read back."""
    return read_sexpr(export(array, folder)[0])


def position(node: Node, name: str = "at") -> np.ndarray[Any, Any]:
    """Point of KiCad's in m."""
    return np.array([node.need(name).number(0), node.need(name).number(1)]) * 1e-3


@given(st.text(st.characters(exclude_categories=["Cs"])))
def test_quoted_text_is_read_back(text: str) -> None:
    assert parse_sexpr(f"(name {quoted(text)})").text() == text


def test_pads_of_terminals(tmp_path: Path) -> None:
    for k, footprint in enumerate(written(reference_board(turns=5), tmp_path).children("footprint"), start=1):
        assert footprint.need("fp_text").words[:2] == ("reference", f"C{k}")
        pads = list(footprint.children("pad"))
        assert [pad.words for pad in pads] == [("1", "thru_hole", "circle"), ("2", "thru_hole", "circle")]
        assert all(pad.need("layers").words == ("*.Cu", "*.Mask") for pad in pads)
        assert all(pad.need("net").words == (str(k), f"C{k}") for pad in pads)
    # that are not drilled
    first, second, third = written(pairs_board(), tmp_path).children("footprint")
    layers = [[pad.need("layers").words for pad in footprint.children("pad")] for footprint in (first, second, third)]
    assert layers == [[("F.Cu", "F.Mask"), ("In1.Cu",)], [("In2.Cu",), ("In3.Cu",)], [("In4.Cu",), ("B.Cu", "B.Mask")]]
    assert all(pad.words[1] == "smd" for pad in first.children("pad"))
    # a bare end has a pad that adds no copper
    array = hexagonal_board(4, bare=True)
    for footprint in written(array, tmp_path).children("footprint"):
        one, two = footprint.children("pad")
        assert one.words[1] == two.words[1] == "smd"
        assert (one.need("layers").words, two.need("layers").words) == (("F.Cu",), ("B.Cu",))
        assert one.need("size").number() * 1e-3 == pytest.approx(array.placements[0].coil.trace_width, rel=1e-12)


def test_stack_up_and_layers(tmp_path: Path) -> None:
    names, epsilon_r = ("top", "power", "signal.2", "low"), (4.5, 4.2, 1 / 0.3)
    stackup = Stackup(names, (35e-6, 18e-6, 17.5e-6, 70e-6), (0.1e-3, 0.71e-3, 0.2e-3), epsilon_r)
    coil = path_coil([[(0, 0), (1e-2, 0)], [(1e-2, 0), (1e-2, 5e-3)]], 1e-3, 1e-3, VIA)
    board = written(Array(stackup, (Placement("A", coil, ("top", "low"), 0, 0),)), tmp_path)
    table = [node for node in board.need("layers").items if isinstance(node, Node)]
    assert [(node.name, *node.words) for node in table[:4]] == [
        ("0", "F.Cu", "signal", "top"), ("1", "In1.Cu", "signal", "power"), ("2", "In2.Cu", "signal", "signal.2"),
        ("31", "B.Cu", "signal", "low"),
    ]  # fmt: skip
    slabs = list(board.need("setup").need("stackup").children("layer"))
    assert [node.text() for node in slabs[:3] + slabs[-3:]] == [
        *("F.SilkS", "F.Paste", "F.Mask"),
        *("B.Mask", "B.Paste", "B.SilkS"),
    ]
    assert [node.need("type").text() for node in slabs[4:-3:2]] == ["prepreg", "core", "prepreg"]
    assert board.need("general").need("thickness").number() * 1e-3 == pytest.approx(stackup.thickness, rel=1e-12)
    # a board of one layer has an empty back; its title is the name where there is none
    titled = read_sexpr(export(single_layer(), tmp_path, title='Six "coils"')[0])
    board = written(single_layer(), tmp_path)
    titles = [each.need("title_block").need("title").text() for each in (titled, board)]
    assert titles == ['Six "coils"', "board"]
    names = [node.text() for node in board.need("layers").items if isinstance(node, Node)]
    assert [name for name in names if name.endswith(".Cu")] == ["F.Cu", "B.Cu"]
    assert {track.need("layer").text() for track in board.children("segment")} == {"F.Cu"}
    (footprint,) = board.children("footprint")
    assert {pad.need("layers").words for pad in footprint.children("pad")} == {("F.Cu", "*.Mask")}


def test_the_sheet_grows_with_the_board(tmp_path: Path) -> None:
    papers = {0.2: "A4", 0.3: "A3", 0.45: "A2", 0.7: "A1", 1.0: "A0", 1.12: "User 1205 85"}
    for width, paper in papers.items():
        board = written(coil_of_one_line(width), tmp_path)
        assert board.need("paper").words == tuple(paper.split())
        assert board.need("setup").need("grid_origin").words == board.need("setup").need("aux_axis_origin").words
        if paper == "A4":  # the board in its middle, and the origin on whole micrometres
            corners = [position(board.need("gr_rect"), end) for end in ("start", "end")]
            assert np.abs(np.mean(corners, axis=0) - (148.5e-3, 105e-3)).max() < 1e-6


def test_every_piece_has_an_identifier_of_its_own_that_stays(tmp_path: Path) -> None:
    files = export(reference_board(), tmp_path)
    for file in files:
        identifiers = re.findall(r"\(tstamp ([^)]*)\)", file.read_text())
        assert len(identifiers) == len(set(identifiers))
    assert len(re.findall(r"\(tstamp ", files[0].read_text())) > 1000
    # the same design gives the same bytes
    written(reference_board(turns=5), tmp_path)
    first = contents(tmp_path)
    shutil.rmtree(tmp_path / "project")
    written(reference_board(turns=5), tmp_path)
    assert contents(tmp_path) == first


def test_names_meet_no_pad_no_name_and_no_edge(exported: Any) -> None:
    array = exported[0]
    labels = silk_labels(array)
    assert None not in labels
    # letters of KiCad's font are at most 1.2 heights apart and reach from 0.9 below to 0.9 above their middle
    boxes = [
        shapely.box(at.x - 0.6 * n * at.size, at.y - 0.9 * at.size, at.x + 0.6 * n * at.size, at.y + 0.9 * at.size)
        for at, n in zip(labels, map(len, array.names), strict=True)
    ]
    pads = shapely.union_all([disc(hole.x, hole.y, hole.pad) for hole in drills(array)])
    for k, box in enumerate(boxes):
        assert box.distance(pads) > 0.1e-3 or pads.is_empty
        assert board_outline(array).boundary.distance(box) > 0.49e-3
        assert all(box.distance(other) > 0.1e-3 for other in boxes[:k])


def test_a_name_without_a_place_is_not_printed(tmp_path: Path) -> None:
    array = one_coil(Spiral(6, 6e-3, 3, 0.2e-3, 0.2e-3, leads=None).coil())
    long = array.with_placements((replace(array.placements[0], name="a_name_of_thirty_letters_or_more"),))
    assert silk_labels(long) == (None,)
    (footprint,) = written(long, tmp_path).children("footprint")
    assert footprint.need("fp_text").need("layer").text() == "F.Fab"


def test_the_limits_are_the_rules_of_the_project(tmp_path: Path) -> None:
    rules = FabRules(0.11e-3, 0.12e-3, 0.23e-3, 0.14e-3, 0.35e-3, 0.26e-3)
    project = json.loads(export(hexagonal_board(4), tmp_path, rules=rules)[1].read_text())
    limits = project["board"]["design_settings"]["rules"]
    assert limits == {
        "allow_blind_buried_vias": True, "allow_microvias": False, "min_clearance": 0.12,
        "min_copper_edge_clearance": 0.35, "min_hole_clearance": 0.12, "min_hole_to_hole": 0.26,
        "min_through_hole_diameter": 0.23, "min_track_width": 0.11, "min_via_annular_width": 0.14,
        "min_via_diameter": 0.51,
    }  # fmt: skip
    (default,) = project["net_settings"]["classes"]
    assert default == {"name": "Default", "clearance": 0.12, "track_width": 0.1, "via_diameter": 0.45, "via_drill": 0.2}
    assert project["meta"]["filename"] == "board.kicad_pro"


def test_one_footprint_a_shape_and_set_of_layers(tmp_path: Path) -> None:
    files = export(reference_board(turns=5), tmp_path)[3:]
    assert [(file.parent.name, file.name) for file in files] == [("board.pretty", f"C{k}.kicad_mod") for k in (1, 2)]
    first, second = (read_sexpr(file) for file in files)
    assert first.need("descr").text() == "winding of C1, C3, C5 on L1, L2"
    assert second.need("descr").text() == "winding of C2, C4, C6 on L3, L4"
    table = read_sexpr(tmp_path / "project" / "fp-lib-table").need("lib")
    assert (table.need("name").text(), table.need("uri").text()) == ("board", "${KIPRJMOD}/board.pretty")


def test_a_footprint_is_the_winding_about_its_middle(exported: Any) -> None:
    array, files, _ = exported
    for file in files[3:]:
        footprint = read_sexpr(file)
        placement = array.placements[array.names.index(file.stem)]
        assert footprint.need("tags").text().startswith("net tie")
        lines = list(footprint.children("fp_line"))
        segments = [pair for line in placement.coil.lines for pair in pairwise(line)]
        for drawn, (start, end) in zip(lines, segments, strict=True):
            assert np.abs(position(drawn, "start") * (1, -1) - start).max() < 1.1 * NANOMETRE
            assert np.abs(position(drawn, "end") * (1, -1) - end).max() < 1.1 * NANOMETRE
        widths = [drawn.need("width").number() * 1e-3 for drawn in lines]
        assert widths == pytest.approx(np.concatenate(placement.coil.widths), abs=0.6 * NANOMETRE)
        pads = {pad.text(): position(pad) * (1, -1) for pad in footprint.children("pad")}
        vias = placement.coil.via_points
        assert list(pads) == [*(f"V{k + 1}" for k in range(len(vias))), "1", "2"]
        assert np.abs(np.array(list(pads.values())) - [*vias, *placement.coil.terminal_points]).max() < 0.6 * NANOMETRE


def test_layers_that_kicad_cannot_hold(tmp_path: Path) -> None:
    for stackup, message in (
        (many_layers(3), "must have one copper layer or an even number up to 32; got 3"),
        (many_layers(34), "must have one copper layer or an even number up to 32; got 34"),
        (replace(FOUR_LAYERS, names=("L1", "a:b", "L3", "L4")), "got 'a:b'"),
        (replace(FOUR_LAYERS, names=("L1", " ", "L3", "L4")), "not empty"),
        (replace(FOUR_LAYERS, names=("L1", "signal", "L3", "L4")), "got 'signal'"),
        (replace(FOUR_LAYERS, names=("L1", "a\nb", "L3", "L4")), "printable"),
        (replace(FOUR_LAYERS, names=("L1", "F.Cu", "L3", "L4")), "another name for KiCad, where it would be In1.Cu"),
        (replace(FOUR_LAYERS, names=("L1", "F.Mask", "L3", "L4")), "'F.Mask' must have another name"),
    ):
        refused(OutputError, re.escape(message), export, coil_of_one_line(1e-2, stackup), tmp_path)
        assert not list(tmp_path.iterdir())
    # KiCad's own in their places are allowed
    names = ("F.Cu", "In1.Cu", "In2.Cu", "B.Cu")
    assert copper_names(replace(FOUR_LAYERS, names=names)) == dict(zip(names, names, strict=True))
    assert list(copper_names(many_layers(32)).values())[-2:] == ["In30.Cu", "B.Cu"]


def test_names_that_cannot_be_files(tmp_path: Path) -> None:
    for name in ("", "a b", "a/b", "-x", 'a"b', "ä"):
        array = single_layer()
        other = array.with_placements((replace(array.placements[0], name=name),))
        refused(OutputError, "name of a project for KiCad must be letters, digits", export, array, tmp_path, name=name)
        refused(OutputError, "name of a coil for KiCad must be letters, digits", export, other, tmp_path)
        assert not list(tmp_path.iterdir())


def test_a_board_larger_than_any_sheet_or_with_no_place_to_go(tmp_path: Path) -> None:
    message = r"must be at most 1139 mm wide and high; got 1505 mm x 5 mm"
    refused(OutputError, message, export, coil_of_one_line(1.5), tmp_path)
    refused(OutputError, r"cannot write .*: No such file or directory", export, single_layer(), tmp_path / "nowhere")
    (tmp_path / "project").write_text("mine")
    refused(OutputError, r"cannot make the folder .*: a file has that name", export, single_layer(), tmp_path)
    assert (tmp_path / "project").read_text() == "mine"


OTHER = reference_board(turns=3)


def test_a_new_export_replaces_its_own_files_only(tmp_path: Path) -> None:
    written(single_layer(), tmp_path)
    (tmp_path / "project" / "notes.txt").write_text("mine")
    assert len(list(written(OTHER, tmp_path).children("footprint"))) == 6
    assert (tmp_path / "project" / "notes.txt").read_text() == "mine"
    assert [file.name for file in tmp_path.iterdir()] == ["project"]


def contents(folder: Path) -> dict[str, bytes | None]:
    """Bytes of every file and None for every folder."""
    return {str(path): None if path.is_dir() else path.read_bytes() for path in sorted(folder.rglob("*"))}


@pytest.mark.parametrize("old", ["board", "notes", "nothing"])
def test_a_board_that_is_refused_leaves_all_as_it_was(tmp_path: Path, old: str) -> None:
    if old == "board":
        written(single_layer(), tmp_path)
    elif old == "notes":
        (tmp_path / "project").mkdir()
        (tmp_path / "project" / "notes.txt").write_text("mine")
    before = contents(tmp_path)

    def refuse(board: Path) -> None:
        assert len(list(read_sexpr(board).children("footprint"))) == 6  # the new one
        raise RuleViolationError("not this one")

    refused(RuleViolationError, "not this one", export, OTHER, tmp_path, check=refuse)
    assert contents(tmp_path) == before


@pytest.fixture(scope="module")
def kicad() -> Kicad:
    found = find_kicad()
    if isinstance(found, str):
        pytest.skip(found)
    return found


@pytest.mark.slow
def test_kicad_finds_nothing(exported: Any, kicad: Kicad) -> None:
    assert kicad.findings(exported[1][0]) == []


@pytest.mark.slow
def test_kicad_finds_what_is_wrong_and_nothing_else(kicad: Kicad, tmp_path: Path) -> None:
    """So that finding nothing means something."""
    board = export(single_layer(), tmp_path)[0]
    text = board.read_text()
    pad = re.search(r'\(pad "1".*?(\(at [^)]*\))', text)
    assert pad is not None
    text = re.sub(r'(\(fp_text reference "A" )\(at [^)]*\)', rf"\1{pad[1]}", text)
    tracks = re.findall(r"\n  \(segment .*", text)
    board.write_text(text.replace(tracks[5], ""))
    kinds = {finding.split(":")[0] for finding in kicad.findings(board)}
    assert {"unconnected_items", "track_dangling", "silk_over_copper"} <= kinds
    # KiCad 9 says that a pad on an inner layer cannot be reached, which is so; KiCad 6 says nothing
    findings = kicad.findings(export(pairs_board(), tmp_path)[0])
    assert {finding.split(":")[0] for finding in findings} <= {"padstack"}
    assert len(findings) in (0, 4)


@pytest.mark.slow
@pytest.mark.parametrize("array", [OTHER, winding_and_return(), single_layer()], ids=["spirals", "widths", "one layer"])
def test_kicad_takes_the_footprints(array: Array, kicad: Kicad, tmp_path: Path) -> None:
    """Placed on an empty board, the terminals on two nets: the check compares them with the library, and is content."""
    files = export(array, tmp_path)
    for file in files[3:]:
        board = files[0].with_name(f"{file.stem}.kicad_pcb")
        board.write_text(with_footprint(files[0].read_text(), file.read_text(), f"board:{file.stem}"))
        board.with_suffix(".kicad_pro").write_bytes(files[1].read_bytes())
        assert kicad.findings(board) == []


def with_footprint(board: str, footprint: str, link: str) -> str:
    """Text of the board without its coils, with a footprint in their place and nets on pads 1 and 2."""
    x, y = parse_sexpr(board).need("setup").need("aux_axis_origin").words
    footprint = re.sub(r'\(footprint ".*', f'(footprint "{link}" (layer "F.Cu") (at {x} {y})', footprint, count=1)
    for number in ("1", "2"):
        pad = rf'(\(pad "{number}".*)\)$'
        footprint = re.sub(pad, rf'\1 (net {number} "N{number}"))', footprint, flags=re.MULTILINE)
    empty = re.sub(r"\n  \((segment|via|net [1-9]) .*|\n  \(footprint (.|\n)*?\n  \)", "", board)
    nets = '  (net 1 "N1")\n  (net 2 "N2")\n'
    return empty.removesuffix(")\n") + nets + footprint + ")\n"
