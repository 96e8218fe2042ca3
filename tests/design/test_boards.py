"""Several boards in space: names, poses, files, identity, and what is refused."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from support.refusals import refused

import coilarray as ca
from coilarray.compute.netcdf import load_part, save_dataset
from coilarray.compute.store import open_store
from coilarray.design.bundled import read
from coilarray.design.model import Board, Design, build_design_file, design_facts, load_design_file
from coilarray.design.vary import vary
from coilarray.design.write import design_text
from coilarray.errors import DesignError
from coilarray.geometry import Bend, Pose, Spiral, Zone
from coilarray.geometry.array import Array
from coilarray.geometry.board_clearance import cut_through, hull_distance
from coilarray.hardware.emulator.board import emulated_board
from coilarray.hardware.scan.wiring import load_wiring
from coilarray.paper.two_dimensional import line_response
from coilarray.studies.quantities.catalogue import evaluate
from coilarray.studies.tolerance.tolerances import contributors, error_names, load_tolerances, perturb

COIL = Array.row(Spiral(6, 10e-3, 4, 0.2e-3, 0.2e-3), 1)
ROW = Array.row(Spiral(4, 8e-3, 3, 0.2e-3, 0.2e-3), 2, pitch=12e-3)
FACING = Pose(x=1e-3, z=6e-3, turn=(math.pi, 0.0, 0.0))
PLACED = """
[[boards]]
name = "receiver"  # over it
design = "receiver.toml"
z_mm = 8.0
turn_deg = [180, 0, 0]
"""


@pytest.fixture
def files(tmp_path):
    """Folder with a design that places another file."""
    (tmp_path / "receiver.toml").write_text(read("proximity"))
    (tmp_path / "link.toml").write_text(read("starter") + PLACED)
    return tmp_path


def test_coils_have_the_names_of_their_boards_and_lie_in_space():
    design = Design(ROW, boards=(Board(COIL, FACING, "receiver"), Board(COIL, Pose(z=-9e-3))))
    assert design.coil_names == ("coil1", "coil2", "receiver/coil1", "board3/coil1")
    assert [path.name for path in design.conductors()] == list(design.coil_names)
    np.testing.assert_allclose(design.centres[2:], [[1e-3, 0, 6e-3], [0, 0, -9e-3]], atol=1e-18)
    assert [state.name for state in design.plan] == list(design.coil_names)


def test_boards_of_a_board_follow_it():
    inner = Design(COIL, boards=(Board(COIL, Pose(z=5e-3), "lid"),))
    design = Design(ROW, boards=(Board(inner, Pose(x=40e-3, turn=(0.0, math.pi / 2, 0.0)), "box"),))
    assert design.coil_names[2:] == ("box/coil1", "box/lid/coil1")
    # a turn about y by 90° takes z to x
    np.testing.assert_allclose(design.centres[3], [45e-3, 0.0, 0.0], atol=1e-15)


def test_a_design_tells_of_its_boards():
    design = Design(ROW, boards=(Board(COIL, FACING, "receiver"),), name="pair")
    facts = dict(design_facts(design))
    assert "(1, 0, 6) mm" in facts["board receiver"]
    assert "(180, 0, 0)°" in facts["board receiver"]
    assert "receiver" in repr(design)
    assert design._repr_html_().count("<img") == 2  # both boards


def test_a_board_may_be_placed_several_times_and_its_place_counts():
    one = Design(ROW, boards=(Board(COIL, FACING, "a"), Board(COIL, Pose(z=-9e-3), "b")))
    same = Design(ROW, boards=(Board(COIL, FACING, "a"), Board(COIL, Pose(z=-9e-3), "b")))
    other = Design(ROW, boards=(Board(COIL, FACING, "a"), Board(COIL, Pose(z=-9.001e-3), "b")))
    assert one.digest == same.digest
    assert len({one.digest, other.digest, Design(ROW).digest}) == 3


def test_a_file_is_read_beside_the_file_that_places_it_and_saved_from_anywhere(files):
    link = load_design_file(files / "link.toml")
    assert link.design.coil_names[-1] == "receiver/coil1"
    (files / "sub").mkdir()
    ca.save_design(link, files / "sub" / "copy.toml")
    text = (files / "sub" / "copy.toml").read_text()
    assert 'design = "../receiver.toml"' in text
    assert "# over it" in text
    assert ca.load_design(files / "sub" / "copy.toml").digest == link.design.digest


def test_the_identity_covers_the_files_that_a_design_refers_to(files):
    before = ca.load_design(files / "link.toml").digest
    text = read("proximity")
    (files / "receiver.toml").write_text(text.replace("gap_mm = 0.15", "gap_mm = 0.151", 1))
    assert ca.load_design(files / "link.toml").digest != before


def test_entries_of_a_board_are_varied_by_its_name(files):
    link = load_design_file(files / "link.toml")
    higher = vary(link, {"boards.receiver.z_mm": 12.0})
    assert higher.centres[-1].tolist() == [0.0, 0.0, 12e-3]
    assert vary(link, {"boards.0.z_mm": 12.0}).digest == higher.digest


def test_a_design_made_in_python_is_saved_with_its_boards(tmp_path):
    design = Design(ROW, boards=(Board(COIL, FACING, "receiver"),), name="pair")
    ca.save_design(design, tmp_path / "pair.toml")
    assert ca.load_design(tmp_path / "pair.toml").digest == design.digest
    assert build_design_file(ca.design_document(design)).design.digest == design.digest


def naming(*words):
    """Pattern of a message with all these words."""
    return "".join(f"(?=.*{re.escape(word)})" for word in words)


BAD = {
    "cut": (lambda: Design(ROW, boards=(Board(COIL, Pose(z=0.1e-3), "lid"),)), "lid", "cut through", "higher"),
    "twice": (lambda: Design(ROW, boards=(Board(COIL, FACING, "a"), Board(COIL, Pose(z=-9e-3), "a"))), "a/coil1"),
    "type": (lambda: Board("starter"), "Array or a Design", "starter"),
    "plates": (
        lambda: Design(COIL, boards=(Board(ca.load_design("gast2020"), Pose(z=30e-3), "skin"),)),
        "skin", "magnetic",
    ),
    "moved": (lambda: replace(ca.load_design("gast2020"), pose=Pose(z=1e-3)), "Pose()"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_boards_that_cannot_be_are_refused(case):
    make, *told = BAD[case]
    refused(DesignError, naming(*told), make)


@pytest.mark.parametrize(
    ("entry", "told"),
    [
        ('design = "link.toml"', ("link.toml", "itself")),
        ('design = "nowhere.toml"', ("nowhere.toml",)),
        ("z_mm = nan", ("boards.0.z_mm", "nan")),
        ("turn_deg = [0, 90]", ("boards.0.turn_deg", "3")),
        ('name = "a/b"', ("boards.0.name", "a/b")),
    ],
)
def test_wrong_entries_are_refused_by_key(files, entry, told):
    key = entry.split(" ")[0]
    lines = [line for line in PLACED.splitlines() if not line.startswith(key)]
    (files / "link.toml").write_text("\n".join([read("starter"), *lines, entry, ""]))
    refused(DesignError, naming(*told), ca.load_design, files / "link.toml")


def test_the_distance_of_hulls_is_known_in_closed_form():
    cube = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    assert hull_distance(cube, np.add(cube, [3.0, 0, 0]))[0] == pytest.approx(
        2, rel=1e-6
    )  # weighted sums of shares, 1e-6
    # corner to corner along a diagonal, and edge to edge
    assert hull_distance(cube, np.add(cube, [2.0, 2, 2]))[0] == pytest.approx(math.sqrt(3), rel=1e-6)
    turned = Pose(x=3.0, turn=(0, 0, math.pi / 4)).apply(cube - 0.5)
    assert hull_distance(cube - 0.5, turned)[0] == pytest.approx(3 - 0.5 - math.sqrt(0.5), rel=1e-6)
    assert cut_through(cube[None], np.add(cube, [[0.0, 0, 1]])[None]) is None  # they touch
    assert cut_through(cube[None], np.add(cube, [[0.0, 0, 0.999]])[None]) is not None


def test_a_bent_board_leaves_room_inside_its_bend():
    strip = Array.row(Spiral(4, 8e-3, 3, 0.2e-3, 0.2e-3), 3, pitch=10e-3)
    around = strip.bent(Bend((Zone(8e-3),), axis=math.pi / 2))
    inside, across = Pose(z=-8e-3, turn=(math.pi / 2, 0.0, 0.0)), Pose(z=-8e-3, x=8e-3)
    small = Array.row(Spiral(4, 4e-3, 2, 0.2e-3, 0.2e-3), 1, board_margin=0.5e-3)
    assert Design(around, boards=(Board(small, inside, "bone"),)).coil_names[-1] == "bone/coil1"
    refused(DesignError, naming("bone", "cut through"), Design, around, boards=(Board(small, across, "bone"),))


ONE_BOARD = {
    "calibration": lambda pair: ca.calibrate(pair, None, {}),
    "two-dimensional": lambda pair: line_response(pair, "coil1"),
    "emulated": lambda pair: emulated_board(pair, load_wiring()),
    "resistance": ca.dc_resistance,
    "board_area": lambda pair: evaluate(pair, ["board_area_mm2"]),
    "covered": lambda pair: evaluate(pair, ["covered_mm2"]),
    "span": lambda pair: evaluate(pair, ["span_mm"]),
}


@pytest.mark.parametrize("what", ONE_BOARD)
def test_functions_of_one_board_name_the_others(what):
    pair = Design(ROW, boards=(Board(COIL, FACING, "receiver"),), name="pair")
    refused(DesignError, naming(what, "one flat board", "pair", "receiver"), ONE_BOARD[what], pair)


def test_quantities_are_of_all_boards():
    pair = Design(ROW, boards=(Board(COIL, FACING, "receiver"),))
    found = evaluate(pair, ["k[coil1,receiver/coil1]", "inductance_uH[receiver/coil1]", "worst_k"])
    coupling = ca.coupling_matrix(ca.inductance_matrix(pair.conductors(), allow_overlaps=True))
    assert found["k[coil1,receiver/coil1]"] == pytest.approx(coupling[0, 2], abs=1e-4)
    assert found["worst_k"] == pytest.approx(np.abs(coupling[np.triu_indices(3, 1)]).max(), abs=1e-4)


def test_boards_have_fabrication_errors_of_their_own():
    pair = Design(ROW, boards=(Board(COIL, FACING, "receiver"),))
    assert {"etch.L1", "receiver/etch.L1", "receiver/dielectric.L1-L2"} <= set(error_names(pair))
    assert "receiver/capacitance" not in error_names(pair)  # its tank is not used here
    thin = perturb(pair, {"receiver/etch.L1": -50e-6})
    assert thin.boards[0].array.placements[0].coil.widths[0][0] == pytest.approx(0.15e-3)
    assert thin.array.placements[0].coil.widths[0][0] == pytest.approx(0.2e-3)
    shares = [one for one in contributors(pair, load_tolerances()) if "etch, board" in one.name]
    assert [one.targets for one in shares] == [("etch.L1", "etch.L2"), ("receiver/etch.L1", "receiver/etch.L2")]


def test_a_kept_result_is_not_used_when_the_file_of_a_board_has_changed(tmp_path):
    for turns in (4, 3):
        receiver = Array.row(Spiral(6, 10e-3, turns, 0.2e-3, 0.2e-3), 1)
        ca.save_design(Design(receiver), tmp_path / "receiver.toml")
        (tmp_path / "link.toml").write_text(design_text(Design(COIL)) + PLACED)
        link, store = load_design_file(tmp_path / "link.toml"), open_store(tmp_path / "store")
        key = "k[coil1,receiver/coil1]"
        found = ca.sweep(link, {"boards.receiver.z_mm": [8.0]}, [key], accuracy="screen", keep=store.folder)
        assert float(found[key][0]) == pytest.approx(evaluate(link.design, [key])[key], abs=1e-3)


def test_a_board_that_was_changed_in_python_is_saved_as_it_is(files, tmp_path):
    link = ca.load_design(files / "link.toml")
    changed = replace(link, boards=(replace(link.boards[0], of=COIL),))
    assert vary(changed, {}).digest == changed.digest != link.digest
    (tmp_path / "sub").mkdir()
    ca.save_design(changed, tmp_path / "sub" / "changed.toml")
    assert ca.load_design(tmp_path / "sub" / "changed.toml").digest == changed.digest
    ca.save_design(link, tmp_path / "sub" / "same.toml")
    assert 'design = "../receiver.toml"' in (tmp_path / "sub" / "same.toml").read_text()


def test_names_of_coils_of_boards_are_kept_in_netcdf(tmp_path):
    dataset = xr.Dataset({"k[coil1,receiver/coil1]": ("a/b", [1.0])}, {"coil": ("a/b", ["receiver/coil1"])})
    save_dataset(dataset, tmp_path / "k.nc")
    xr.testing.assert_identical(load_part(tmp_path / "k.nc"), dataset)
