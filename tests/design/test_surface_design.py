"""Design files of coils on a surface, and the bundled helmet."""

import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from support.refusals import refused

from coilarray import Board, Pose, couple_design, coupling_matrix, inductance_matrix, load_design
from coilarray.cli.compute import _coils
from coilarray.design.bundled import read
from coilarray.design.model import Design, build_design, load_design_file, parse_design
from coilarray.design.write import design_document, save_design
from coilarray.errors import DesignError
from coilarray.geometry import RoundedSpiral, Stackup, SurfaceLattice
from coilarray.geometry.surface import Surface, neighbours
from coilarray.geometry.surface_array import Wrap, sizes_by_distance

STRIP = Stackup(("L1",), (35e-6,), (), ())
FINGER = """
schema = 1
name = "finger"
[stackup]
layers = ["L1"]
copper_thickness_um = [35]
[coils.loop]
shape = "circle"
outer_diameter_mm = 5
turns_per_layer = 1
winding_layers = 1
trace_width_mm = 0.2
gap_mm = 0.2
[array]
lattice = "surface"
coil = "loop"
layers = ["L1"]
SURFACE
"""
DOME = 'surface = "dome"\nradii_mm = [8, 8, 8]\nskirt_mm = 12\n'


def finger(keys, more=""):
    return parse_design(FINGER.replace("SURFACE", keys) + more)


def test_fingertip():
    """Twelve coils around a fingertip of radius 8 mm, a cylinder with a hemisphere, as the issue asks for."""
    design = finger(DOME + "count = 12\nsize_over_distance = 1.3\nwrapped = true\n")
    assert design.coil_names == tuple(f"coil{k + 1}" for k in range(12))
    assert [board.name for board in design.placed] == [""] * 12
    surface = Surface.dome((8e-3, 8e-3, 8e-3), 12e-3)
    places, _ = surface.nearest(design.centres)
    heights = np.linalg.norm(design.centres - places, axis=1)
    steps = (heights - 35e-6) / 70e-6  # levels of twice the board, on the lower face of which they stand
    np.testing.assert_allclose(steps, np.round(steps), atol=0.02)
    wraps = [board.array.form for board in design.placed]
    assert all(isinstance(wrap, Wrap) for wrap in wraps)
    assert {wrap.carrier.digest for wrap in wraps} == {surface.digest}
    sizes = [np.ptp(board.array.placements[0].coil.outline, axis=0).max() for board in design.placed]
    np.testing.assert_allclose(sizes, sizes_by_distance(surface, places, 1.3), rtol=0.02)


def test_points_and_sizes():
    design = finger(DOME + "points_mm = [[0, 0, 8], [8, 0, -6]]\nsizes_mm = [4, 6]\nnames = ['top', 'side']\n")
    assert design.coil_names == ("top", "side")
    np.testing.assert_allclose(design.centres, [[0, 0, 8.035e-3], [8.035e-3, 0, -6e-3]], atol=1e-5)
    assert [path.name for path in design.conductors()] == ["top", "side"]
    sides = [np.ptp(path.vertices, axis=0).max() for path in design.conductors()]
    np.testing.assert_allclose(sides, [3.8e-3, 5.8e-3], atol=0.5e-3)  # less a trace, and the step of the turn


def test_mesh_beside_the_file(tmp_path):
    """The content of the mesh counts, not its path."""
    digests = {}
    for folder, radius in (("a", 30.0), ("b", 30.0), ("c", 30.3)):
        where = tmp_path / folder
        where.mkdir()
        trimesh.creation.icosphere(3, radius).export(where / f"{folder}.stl")
        keys = f'surface = "{folder}.stl"\ncount = 4\nmirror = "x"\nwrapped = true\n'
        (where / "design.toml").write_text(FINGER.replace("SURFACE", keys), encoding="utf-8")
        file = load_design_file(where / "design.toml")
        digests[folder] = file.design.digest
        save_design(file, where / "again.toml")
        assert (where / "again.toml").read_text(encoding="utf-8").count(f'"{folder}.stl"') == 1
        assert load_design(where / "again.toml").digest == file.design.digest
    assert digests["a"] == digests["b"] != digests["c"]


def test_digest_of_flat_and_wrapped():
    keys = DOME + "count = 2\n"
    found = {finger(keys + more).digest for more in ("", "wrapped = true\n", "rotation_deg = 1\n")}
    assert len(found) == 3
    assert finger(keys).digest == finger(keys).digest


def test_placed_as_a_board():
    """A surface array within another design is moved as a whole, and its coils may overlap."""
    alone = finger(DOME + "count = 12\nsize_over_distance = 1.3\nwrapped = true\n")
    pose = Pose(x=0.05, turn=(0.0, math.pi / 2, 0.0))
    both = Design(alone.array, boards=(Board(alone, pose, "there"),))
    assert both.coil_names == ("coil1", *(f"there/coil{k + 1}" for k in range(12)))
    np.testing.assert_allclose(both.centres[1:], pose.apply(alone.centres), atol=1e-12)


@pytest.mark.parametrize(("keys", "more", "message"), [
    ('surface = "dome"\ncount = 2\n', "", "array needs radii_mm"),
    (DOME, "", "array needs exactly one of count and points_mm"),
    (DOME + "count = 2\npoints_mm = [[0, 0, 8]]\n", "", "array needs exactly one of count and points_mm"),
    (DOME + "count = 0\n", "", "array.count must be at least 1; got 0"),
    (DOME + "count = 1001\n", "", "array.count must be at most 1000; got 1001"),
    (DOME + "points_mm = [[0, 0]]\n", "", "array.points_mm.0 must have at least 3"),
    (DOME + "points_mm = [[0, 0, 9]]\n", "", "array: points must lie on the surface.*1 mm"),
    (DOME + "count = 2\nsizes_mm = [1]\n", "", "array: sizes must be 2"),
    (DOME + "count = 2\nsizes_mm = [1, 2]\nsize_over_distance = 1\n", "", "at most one of sizes_mm"),
    (DOME + "count = 1\nsize_over_distance = 1\n", "", "size_over_distance for several"),
    (DOME + "count = 1\nsizes_mm = [60]\nwrapped = true\n", "", "array: a wrapped coil must keep half"),
    (DOME + "count = 2\nunit_mm = 2\n", "", "unit_mm for mesh files"),
    (DOME + "points_mm = [[0, 0, 8]]\nmirror = 'x'\n", "", "mirror beside count"),
    (DOME + "count = 2\nmirror = 'z'\n", "", "array.mirror must be 'x' or 'y'; got 'z'"),
    (DOME.replace("8, 8, 8", "8, 8"), "", "array.radii_mm must have at least 3"),
    (DOME.replace("8, 8, 8", "8000, 8000, 8000") + "count = 2\n", "", "array.surface: .*unit"),
    ('surface = "none.stl"\ncount = 2\n', "", "array.surface: cannot read.*none.stl"),
    ('surface = "none.txt"\ncount = 2\n', "", "array.surface: surface must be a file .stl"),
    ('surface = "none.stl"\ncount = 2\nskirt_mm = 3\n', "", "skirt_mm for surface = \"dome\""),
    (DOME + "count = 2\nlattices = 3\n", "", "array has no key 'lattices'"),
    (DOME.replace("L1", "L2") + "count = 2\ncolumns = 3\n", "", "array has no key 'columns'"),
    (DOME + "count = 2\n", "[connector]\n", "connector needs one flat board"),
    (DOME + "count = 2\n", "[board]\nbend_radius_mm = 20\n", "board.bend needs one flat board"),
])  # fmt: skip
def test_impossible_files(keys, more, message):
    refused(DesignError, message, finger, keys, more)


def test_summary_names_the_neighbours_of_all_boards():
    """What `coilarray report` prints last: the coils at the least distance in space."""
    design = finger(DOME + "points_mm = [[0, 0, 8], [8, 0, -6], [8, 0, 0]]\n")
    rows = _coils(design, couple_design(design, ideal=True)).rows
    assert [str(row[-1]).split()[0] for row in rows] == ["coil3", "coil3", "coil2"]


@pytest.mark.slow
def test_helmet():
    """Sixteen loops whose neighbours overlap: the largest |k| left is 0.007, the issue allows 0.03."""
    design = load_design("helmet")
    k = np.abs(coupling_matrix(inductance_matrix(design.conductors(), allow_overlaps=True)))
    surface = design.array.form.carrier
    pairs = neighbours(surface, surface.nearest(design.centres)[0])
    assert len(design.coil_names) == 16
    assert len(pairs) == 35  # 3 n − 3 − 10 of the rim
    assert max(k[pair] for pair in pairs) == pytest.approx(0.007, abs=1e-3)
    far = k - np.eye(16)
    for i, j in pairs:
        far[i, j] = far[j, i] = 0.0
    assert far.max() == pytest.approx(0.027, abs=2e-3)


def test_design_made_in_python(tmp_path):
    """Written with its surface, and not at all where no file has the surface."""
    surface = Surface.dome((8e-3, 8e-3, 8e-3), 12e-3)
    lattice = SurfaceLattice(surface, [(0, 0, 8e-3), (8e-3, 0, -6e-3)], ("L1",), [4e-3, 5e-3], rotation=0.5)
    boards = lattice.boards(
        RoundedSpiral(5e-3, 5e-3, 1, 0.2e-3, 0.2e-3, corner_radius=2.5e-3, layers=1, leads=None), STRIP
    )
    (first, pose), *others = boards
    design = Design(first, boards=tuple(Board(array, at, "") for array, at in others), pose=pose)
    save_design(design, tmp_path / "a.toml")
    again = load_design(tmp_path / "a.toml")
    np.testing.assert_allclose(again.centres, design.centres, atol=1e-9)  # as written
    assert build_design(design_document(design)).digest == design.digest
    moved = replace(design, pose=Pose())
    refused(DesignError, "boards without names", design_document, moved)
    by_hand = replace(surface, dome_sizes=None)
    (first, pose), *others = replace(lattice, surface=by_hand).boards(boards[0][0].placements[0].coil, STRIP)
    design = Design(first, boards=tuple(Board(array, at, "") for array, at in others), pose=pose)
    refused(DesignError, "cannot hold a mesh", design_document, design)


def test_a_board_inside_a_helmet_is_placed():
    """At the origin, where the first loop lies in its own coordinates only."""
    design = parse_design(read("helmet") + '\n[[boards]]\nname = "probe"\ndesign = "proximity"\n')
    assert design.coil_names[-1] == "probe/coil1"
