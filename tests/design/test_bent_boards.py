"""Bent boards in design files: radii of the inner face, cones, strips, and what is refused by its key."""

import json
import math
from dataclasses import replace

import pytest

from coilarray import Array, Design, Spiral, load_design, parse_design, save_design
from coilarray.cli.main import main
from coilarray.design.model import build_design, build_design_file, load_design_file
from coilarray.design.vary import vary, vary_document
from coilarray.design.write import design_document, design_text
from coilarray.errors import DesignError
from coilarray.geometry import Bend, Zone

FILE = load_design_file("proximity")
PLAIN = {key: table for key, table in FILE.document.items() if key not in ("target", "plate", "assumed")}
THICKNESS = FILE.design.array.stackup.thickness


def bent(**board):
    return build_design({**PLAIN, "board": PLAIN.get("board", {}) | board})


BOARDS = {
    "cylinder": {"bend_radius_mm": 25},
    "upwards": {"bend_radius_mm": -25, "bend_axis_deg": 90},
    "cone": {"bend_radius_mm": 20, "bend_far_radius_mm": 25.3},
    "skew cone upwards": {"bend_radius_mm": -33.3, "bend_far_radius_mm": -20.123, "bend_axis_deg": 30,
                          "bend_neutral_mm": -0.3},
    "strips": {"bends": [{"radius_mm": 20, "at_mm": -5, "width_mm": 4},
                         {"radius_mm": -17.7, "at_mm": 5, "width_mm": 3}]},
}  # fmt: skip


@pytest.mark.parametrize("board", BOARDS.values(), ids=BOARDS)
def test_a_bent_board_is_written_and_read(board, tmp_path):
    design = bent(**board)
    assert design.digest != bent().digest
    assert build_design(design_document(design)).digest == design.digest
    assert parse_design(design_text(design)).digest == design.digest
    save_design(design, tmp_path / "bent.toml")
    assert load_design(tmp_path / "bent.toml").digest == design.digest
    entries = design_document(design)["board"]
    assert {key: entries[key] for key in board} == board


def test_radii_are_those_of_the_inner_face():
    """The middle plane keeps its lengths, half the thickness further out."""
    assert bent(bend_radius_mm=25).array.form.zones[0].radius == pytest.approx(25e-3 + THICKNESS / 2)
    assert bent(bend_radius_mm=-25).array.form.zones[0].radius == pytest.approx(-25e-3 - THICKNESS / 2)
    upwards = bent(bend_radius_mm=-25, bend_neutral_mm=-0.1).array.form
    assert upwards.zones[0].radius == pytest.approx(-25.1e-3)
    assert upwards.neutral == pytest.approx(-0.1e-3)


def test_a_cone_touches_both_radii():
    """Points of the inner face at both ends lie on circles of the radii given, about one axis."""
    design = bent(bend_radius_mm=20, bend_far_radius_mm=30)
    x_min, _, x_max, _ = design.array.bounds
    for x, radius in ((x_min, 20e-3), (x_max, 30e-3)):
        # three points at the same distance from the apex
        rho = x - design.array.form.apex
        points = [
            (design.array.form.apex + rho * math.cos(a), rho * math.sin(a), -THICKNESS) for a in (-0.02, 0.0, 0.02)
        ]
        a, b, c = design.array.form.surface(points)
        sides = [math.dist(*pair) for pair in ((a, b), (b, c), (a, c))]
        half = sum(sides) / 2
        area = math.sqrt(half * math.prod(half - side for side in sides))
        assert math.prod(sides) / (4 * area) == pytest.approx(radius, rel=1e-6)  # circumradius


def test_comments_of_a_file_are_kept(tmp_path):
    path = tmp_path / "board.toml"
    path.write_text(design_text(bent()).replace("[board]", "[board] # flexible\nbend_radius_mm = 30.0 # our pipe"))
    file = load_design_file(path)
    save_design(file, tmp_path / "again.toml")
    assert "bend_radius_mm = 30.0 # our pipe" in (tmp_path / "again.toml").read_text()
    wider = vary(file, {"board.bend_radius_mm": 40.0})
    assert wider.array.form.zones[0].radius == pytest.approx(40e-3 + THICKNESS / 2)


def test_python_boards_have_entries():
    row = Array.row(Spiral(6, 10e-3, 4, 0.3e-3, 0.3e-3), 2, pitch=11e-3)
    strip = Design(row.bent(Bend((Zone(9e-3, 1e-3, 3e-3),), axis=math.pi / 2, neutral=-0.2e-3)))
    entries = design_document(strip)["board"]
    assert entries["bends"] == [{"radius_mm": pytest.approx(9 - 0.07), "at_mm": 1.0, "width_mm": 3.0}]
    assert (entries["bend_axis_deg"], entries["bend_neutral_mm"]) == (90.0, -0.2)
    assert vary(strip, {"board.bends.0.radius_mm": 12.0}).array.form.zones[0].radius == pytest.approx(12.07e-3)


@pytest.mark.parametrize(("board", "key", "value"), [
    ({"bend_radius_mm": 0}, "bend_radius_mm", "0"),
    ({"bend_radius_mm": 0.9 * THICKNESS * 1e3}, "board.bend_radius_mm", f"{0.9 * THICKNESS * 1e3:.4g} mm"),
    ({"bend_radius_mm": 3}, "board.bend_radius_mm", "meet itself"),
    ({"bend_far_radius_mm": 5}, "bend_far_radius_mm", "bend_radius_mm"),
    ({"bend_radius_mm": 20, "bend_far_radius_mm": -5}, "bend_far_radius_mm", "-5"),
    ({"bend_radius_mm": 20, "bend_far_radius_mm": 200}, "board.bend_radius_mm", "200"),
    ({"bend_radius_mm": 20, "bends": BOARDS["strips"]["bends"]}, "bend_radius_mm", "board.bends"),
    ({"bends": [{"radius_mm": 0, "at_mm": 0, "width_mm": 1}]}, "bends.0.radius_mm", "0"),
    ({"bends": [{"radius_mm": 9, "at_mm": -50, "width_mm": 4}]}, "board.bends", "-50"),
    ({"bends": [{"radius_mm": 9, "at_mm": 0, "width_mm": 4}, {"radius_mm": 9, "at_mm": 1, "width_mm": 4}]},
     "board.bends", "overlap"),
])  # fmt: skip
def test_impossible_bends_are_refused_by_their_key(board, key, value):
    with pytest.raises(DesignError) as refused:
        bent(**board)
    assert key in str(refused.value)
    assert value in str(refused.value)


def test_magnetic_sheets_are_refused_on_a_bent_board():
    with pytest.raises(DesignError, match=r"elastomer\.1\.relative_permeability"):
        vary(load_design_file("starter"), {"board.bend_radius_mm": 40})


def test_the_usual_ratio_of_a_bend_is_marked_as_assumed():
    file = build_design_file({**PLAIN, "board": {"bend_radius_mm": 25}})
    assert file.values["fab.min_bend_ratio"] == 10.0
    assert "IPC-2223" in file.assumed["fab.min_bend_ratio"]
    given = build_design_file({**PLAIN, "board": {"bend_radius_mm": 25}, "fab": {"min_bend_ratio": 12.5}})
    assert given.values["fab.min_bend_ratio"] == given.design.rules.min_bend_ratio == 12.5
    assert "fab.min_bend_ratio" not in given.assumed
    assert given.design.digest != file.design.digest
    assert "fab.min_bend_ratio" not in FILE.values


def test_check_of_a_bent_board(tmp_path, capsys):
    coil = Array.row(Spiral(4, 10e-3, 1, 0.3e-3, 0.3e-3, layers=1), 1)
    save_design(Design(coil.bent(Bend((Zone(20 * coil.stackup.thickness, width=1e-3),)))), tmp_path / "bent.toml")
    assert main(["check", str(tmp_path / "bent.toml")]) == 0
    assert "IPC-2223" in capsys.readouterr().out
    assert main(["check", str(tmp_path / "bent.toml"), "--json"]) == 0
    (margin,) = [row for row in json.loads(capsys.readouterr().out)["rules"] if row["rule"] == "bend ratio"]
    assert (margin["value"], margin["limit"]) == (pytest.approx(19.0), 10.0)  # the upper face is the neutral one


def test_comments_of_strips_are_kept(tmp_path):
    text = design_text(bent()) + "\n[[board.bends]] # the hinge\nradius_mm = 9.0\nat_mm = 1.0\nwidth_mm = 4.0\n"
    (tmp_path / "board.toml").write_text(text)
    file = load_design_file(tmp_path / "board.toml")
    changed = replace(file, document=vary_document(file.document, {"board.bends.0.radius_mm": 12.5}))
    save_design(changed, tmp_path / "again.toml")
    assert "[[board.bends]] # the hinge\nradius_mm = 12.5" in (tmp_path / "again.toml").read_text()
