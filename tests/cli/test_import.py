"""``coilarray import BOARD``: boards become designs that every other command takes; each mistake is one line."""

from pathlib import Path

import numpy as np
import pytest
from support.board_text import board, pads, path, segment, square_spiral, via
from support.boards import FOUR_LAYERS
from support.command_line import runner, successes

from coilarray import load_design
from coilarray.cli.main import main
from coilarray.electromagnetics.inductance import inductance_matrix
from coilarray.fabrication.kicad_writer import board_text
from coilarray.geometry import Array, Placement, Spiral

pytestmark = pytest.mark.usefixtures("own_folder")
_, refused = runner("import")
good, answer = successes("import")

SPIRAL = square_spiral()


def write(text, name="b.kicad_pcb"):
    Path(name).write_text(text, encoding="utf-8")
    return name


def small_array():
    coil = Spiral(6, 8e-3, 5, 0.15e-3, 0.15e-3).coil()
    pairs = (("L1", "L2"), ("L3", "L4"))
    placements = (Placement(f"c{k + 1}", coil, pairs[k], 8e-3 * k, 0.0) for k in range(2))
    return Array(FOUR_LAYERS, tuple(placements))


@pytest.mark.slow
def test_a_board_becomes_a_design_with_the_same_matrix(capsys):
    array = small_array()
    out = good(capsys, write(board_text(array, "board", "")), "back.toml")
    assert out.splitlines()[-2:] == ["wrote back.toml", "next: coilarray check back.toml, coilarray report back.toml"]
    rows = [line.split() for line in out.splitlines() if line.startswith("c")]
    assert rows[1][:6] == ["coil", "net", "shape", "layers", "turns", "length"]
    assert [row[:5] for row in rows[2:]] == [["c1", "c1", "shape1", "L1", "L2"], ["c2", "c2", "shape1", "L3", "L4"]]
    design = load_design("back.toml")
    assert (design.name, design.source) == ("b", "imported from b.kicad_pcb")
    # 0.5 nm of rounding over gaps of 0.15 mm
    L, before = (inductance_matrix(each.conductors()) for each in (design.array, array))
    np.testing.assert_allclose(L, before, rtol=1e-6)
    for command in (("check",), ("impedance", "--allow-violations")):
        assert main([command[0], "back.toml", *command[1:]]) == 0


def test_json_says_what_was_found_and_what_was_left_out(capsys):
    text = board(
        path(*SPIRAL[:6], width="0.3"),
        path(*SPIRAL[5:], width="0.2"),
        pads(SPIRAL[0], SPIRAL[-1]),
        path((20, 0), (30, 0), (30, 1), (20, 1), (20, 2), (30, 2), net="2"),
        nets=("/coil A", "GND"),
    ).replace('(net 1 "A")', '(net 1 "/coil A")')
    found = answer(capsys, write(text))
    assert (found["board"], found["design"]) == ("b.kicad_pcb", "design.toml")
    (coil,) = found["coils"]
    assert (coil["name"], coil["net"], coil["shape"], coil["layers"], coil["vias"]) == (
        "coil_A", "/coil A", "shape1", ["F.Cu"], 0
    )  # fmt: skip
    assert coil["trace_widths_m"] == [0.2e-3, 0.3e-3]
    assert coil["turns"] == pytest.approx(3, abs=0.1)
    assert set(found["left_out"]) == {"GND"}
    assert set(found["assumed"]) >= {"stackup.copper_thickness_um", "board.margin_mm", "coils.*.via.plating_um"}
    assert load_design("design.toml").array.placements[0].coil.widths[0].min() == 0.2e-3


def test_what_is_left_out_and_noted_is_printed(capsys):
    meander = path((20, 0), (30, 0), (30, 1), (20, 1), (20, 2), (30, 2), net="2")
    text = board(path(*SPIRAL), via(*SPIRAL[3]), meander, version=20990101)
    out = good(capsys, write(text))
    assert "other copper; lengths in mm\nnet  turns  length  why it is no coil\nB" in out
    assert "assumed: stackup.dielectric_epsilon_r: the board file does not say; FR-4, 4.5\n" in out
    assert "note: The board has KiCad's format 20990101" in out
    assert "note: A: 1 of the holes on the path join none" in out


@pytest.mark.slow
def test_copper_without_a_net_has_none_in_the_table(capsys):
    out = good(capsys, write(board(path(*SPIRAL, net="0"))))
    assert ["coil1", "–", "shape1"] in [line.split()[:3] for line in out.splitlines()]
    assert "note: coil1: the current enters at (−5, 5) mm on F.Cu, where its first track is" in out
    assert "note: board files have no fabrication rules, so the design has no [fab]" in out
    found = answer(capsys, "b.kicad_pcb", "--force")
    assert found["coils"][0]["net"] is None
    assert "no [fab]" in found["notes"][-1]


def test_only_the_wanted_nets(capsys):
    text = board(path(*SPIRAL), path((20, 0), (30, 0), net="2"))
    good(capsys, write(text), "--nets", " B , A", "d.toml")
    assert load_design("d.toml").array.names == ("B", "A")


@pytest.mark.slow
def test_a_stackup_from_a_design(capsys):
    file = write(board_text(small_array(), "board", ""))
    good(capsys, file, "--stackup", "gast2020")
    assert load_design("design.toml").array.stackup == load_design("gast2020").array.stackup
    message = refused(capsys, file, "--stackup", "gast_fem", "--force")
    assert "the board has 4 copper layers and the given stack-up 2" in message


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["none.kicad_pcb"], "none.kicad_pcb: cannot be read: No such file"),
        (["b.kicad_pcb", "--nets", "C"], "b.kicad_pcb: there is no net 'C'; the board has A, B."),
        (["b.kicad_pcb", "--nets", " , "], "b.kicad_pcb: --nets must name at least one net; got ' , '"),
        (["b.kicad_pcb", "--stackup", "none.toml"], "there is no design file none.toml"),
        (["b.kicad_pcb/x.kicad_pcb"], "b.kicad_pcb/x.kicad_pcb: cannot be read: Not a directory"),
        (["b.txt"], "b.txt: must be a folder or an intact zip of Gerber files"),
        (["b.PcbDoc"], "b.PcbDoc: files of this program are not read; export Gerber and drill files"),
        (["b.kicad_pcb", "--from", "U1.1"], "--from and --to are given together"),
        (["b.kicad_pcb", "--from", "U1.1", "--to", "U1.2"], "there is no pad 'U1.1'; give a pad as U1.3"),
        (["b.kicad_pcb", "--layer", "L1=x"], "--layer and --drill-format are for Gerber files"),
        (["cut.kicad_pcb"], "cut.kicad_pcb:9: the file ends inside"),
    ],
)
def test_mistakes_are_one_line_and_leave_no_file(capsys, arguments, message):
    text = board(path(*SPIRAL), segment((20, 0), (30, 0), net="2"), segment((25, 0), (25, 5), net="2"))
    write(text)
    write(text, "b.txt")
    write(text, "b.PcbDoc")
    write("\n".join(text.splitlines()[:9]), "cut.kicad_pcb")
    before = sorted(Path().iterdir())
    assert message in refused(capsys, *arguments)
    assert sorted(Path().iterdir()) == before


def footprint(name, *pads_at, net='1 "A"'):
    """Footprint of surface pads 1, 2, … at places in mm, y down on the sheet from its origin."""
    inside = "".join(
        f'(pad "{k}" smd rect (at {x} {y}) (size 0.4 0.4) (layers "F.Cu") (net {net}))'
        for k, (x, y) in enumerate(pads_at, start=1)
    )
    return f'(footprint "x" (layer "F.Cu") (at 100 100) (property "Reference" "{name}") {inside})'


@pytest.mark.slow
def test_what_is_found_is_listed_with_an_estimate_and_ends_can_be_chosen(capsys):
    """A spiral with a lead that branches to a capacitor and to a chip."""
    lead = [path(SPIRAL[0], (-5, 8)), path((-5, 8), (-8, 8)), path((-5, 8), (-5, 12))]
    parts = footprint("C4", (-8.1, -8.1)), footprint("U1", (-5.1, -12.1), (20, 20))
    file = write(board(path(*SPIRAL), *lead, *parts))
    out = good(capsys, file, "--list", "--picture", "coils.png")
    assert Path("coils.png").stat().st_size > 0
    assert not Path("design.toml").exists()
    (row,) = [line.split() for line in out.splitlines() if line.startswith("A ")]
    L, length = float(row[5]), float(row[6])
    assert 0.05 < L < 0.3
    assert length == pytest.approx(98.0, abs=0.2)  # to the fork, 3 mm from the spiral
    found = answer(capsys, file)
    assert "A: what leads on to C4.1 and U1.1 is left out." in found["notes"]
    for end, more in (("U1.1", 4), ("C4.1", 3), ("-5,12", 4)):
        chosen = answer(capsys, file, "--from", end, "--to", "-2,3", "--list")
        assert chosen["coils"][0]["length_m"] == pytest.approx(98e-3 + more * 1e-3, abs=0.2e-3)
        assert chosen["coils"][0]["inductance_H"] * 1e6 > L - 5e-4


@pytest.mark.slow
def test_a_board_without_a_coil_shows_the_place_that_prevents_it(capsys):
    bridged = board(path(*SPIRAL), segment((0, -5), (0, -4)), path((20, 0), (30, 0), (20, 0.4), net="2"))
    message = refused(capsys, write(bridged), "--picture", "place.png")
    assert "no coil was found. Net A" in message
    assert "a track closes a ring of copper on F.Cu at (0, −4.5) mm" in message.replace("(0, -4.5)", "(0, −4.5)")
    assert "The picture place.png shows the place" in message
    assert Path("place.png").stat().st_size > 0
